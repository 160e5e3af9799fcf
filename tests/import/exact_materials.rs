//! Materials and numbers of faces: from mesh files to values of faces and back.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Mutex;

use spinney::brep::{Face, Faces, Grid, combine};
use spinney::export::{MeshFormat, export_exact};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::brep::{ModelBuilder, Triangulated};
use spinney::raw::export::mesh::ExactSummary;
use spinney::raw::import::mesh::ExactReport;
use spinney::{Codec, Error, ExactModel, Metadata, OpenOptions, Output, Progress, SetOperation};

/// Collects warnings.
#[derive(Default)]
struct Warnings(Mutex<String>);

impl Progress for Warnings {
    fn warn(&self, _: &Path, text: &str) {
        *self.0.lock().unwrap() += text;
    }
}

impl Warnings {
    fn take(&self) -> String {
        std::mem::take(&mut *self.0.lock().unwrap())
    }
}

const SIDES: [[usize; 4]; 6] =
    [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]];

/// A cube whose sides (z low, z high, y low, y high, x low, x high) have materials; the statement
/// is left out for `None`.
fn cube(low: i32, high: i32, materials: [Option<&[u8]>; 6]) -> Vec<u8> {
    let mut text = b"mtllib a.mtl\n".to_vec();
    for corner in 0..8 {
        let [x, y, z] = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { high } else { low });
        text.extend(format!("v {x} {y} {z}\n").bytes());
    }
    for (material, [a, b, c, d]) in materials.iter().zip(SIDES) {
        if let Some(name) = material {
            text.extend([b"usemtl ", *name, b"\n"].concat());
        }
        text.extend(format!("f {a} {b} {c} {d}\n").bytes());
    }
    text
}

fn built(input: &Path, path: &Path) -> (ExactModel, ExactReport) {
    let mut options = ExactOptions::new();
    options.snap = Some(0.001);
    let models = open_all(&[input.to_path_buf()], 64 << 20).unwrap();
    let report = import_exact(models, &options, Output::create(path).unwrap(), &()).unwrap();
    let model = ExactModel::open(path, &OpenOptions::new()).unwrap();
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
    (model, report)
}

fn exported(model: &ExactModel, path: &Path) -> (ExactSummary, String) {
    let warnings = Warnings::default();
    let output = Output::create(path).unwrap();
    let summary = export_exact(model, MeshFormat::of(path).unwrap(), output, &warnings).unwrap();
    (summary, warnings.take())
}

/// The values of each face in a column, and its colours, by the bounds of its vertices.
fn by_bounds(model: &dyn Faces, column: &str) -> BTreeMap<String, (Option<String>, Vec<[u8; 3]>)> {
    let mut found = BTreeMap::new();
    model
        .each_with_values(&[column], &mut |face, values| {
            let points: Vec<_> = face.points.iter().map(|point| model.grid().to_world(*point)).collect();
            let bound = |pick: fn(f64, f64) -> f64| {
                [0, 1, 2].map(|axis| points.iter().map(|point| point[axis]).reduce(pick).unwrap())
            };
            let key = format!("{:?} {:?}", bound(f64::min), bound(f64::max));
            found.insert(key, (values[0].clone(), face.colours.to_vec()));
            Ok(())
        })
        .unwrap();
    assert_eq!(found.len() as u64, model.len());
    found
}

#[test]
fn materials_round_trip_with_and_without_colours() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let (oak, wall) = (Some(&b"oak"[..]), Some(&b"stone wall"[..]));
    // The first side has no material, and the statement of the last one ends the material.
    std::fs::write(at("a.obj"), cube(0, 4, [None, oak, None, wall, oak, Some(b"")])).unwrap();
    for has_colours in [false, true] {
        if has_colours {
            std::fs::write(at("a.mtl"), "newmtl oak\nKd 0.6 0.4 0.2\nnewmtl stone wall\nKd 0.5 0.5 0.5\n")
                .unwrap();
        }
        let (model, report) = built(&at("a.obj"), &at("a.goblin"));
        assert_eq!((report.lost_values, model.value_columns().unwrap()), (0, vec!["material".to_string()]));
        let faces = by_bounds(&model, "material");
        let names: Vec<_> = faces.values().flat_map(|(name, _)| name.as_deref()).collect();
        assert_eq!(names.len(), 4, "{names:?}");
        assert_eq!(faces["[0.0, 4.0, 0.0] [4.0, 4.0, 4.0]"].0.as_deref(), Some("\"stone wall\""));
        assert_eq!(faces["[0.0, 0.0, 0.0] [4.0, 0.0, 4.0]"].0.as_deref(), Some("\"oak\""));
        assert_eq!(faces["[4.0, 0.0, 0.0] [4.0, 4.0, 4.0]"].0, None);
        let (summary, warnings) = exported(&model, &at("b.obj"));
        assert_eq!((summary.has_library, summary.vertices, &*warnings), (has_colours, 8, ""));
        assert_eq!(at("b.mtl").exists(), has_colours);
        let text = std::fs::read_to_string(at("b.obj")).unwrap();
        assert_eq!(text.contains("mtllib b.mtl"), has_colours);
        let (again, report) = built(&at("b.obj"), &at("b.goblin"));
        assert_eq!((by_bounds(&again, "material"), report.lost_values), (faces, 0));
    }
    // If a material has several colours, vertices have them.
    let text = String::from_utf8(cube(0, 4, [oak; 6])).unwrap();
    std::fs::write(at("c.obj"), text.replace("v 0 0 0\n", "v 0 0 0 1 0 0\n")).unwrap();
    let (model, _) = built(&at("c.obj"), &at("c.goblin"));
    let (summary, warnings) = exported(&model, &at("d.obj"));
    assert_eq!((summary.has_library, &*warnings, at("d.mtl").exists()), (false, "", false));
    let (again, _) = built(&at("d.obj"), &at("d.goblin"));
    assert_eq!(by_bounds(&again, "material"), by_bounds(&model, "material"));
    // Formats without materials report them.
    for name in ["a.ply", "a.off", "a.stl", "a.city.json"] {
        let (summary, warnings) = exported(&model, &at(name));
        assert!(summary.lost_values && warnings.contains("values of faces (material)"), "{name}: {warnings}");
    }
}

/// A body of two materials, cut by one of a third: each face has the material of the face it is
/// part of.
#[test]
fn cuts_have_the_material_of_the_tool() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let (oak, ash) = (Some(&b"oak"[..]), Some(&b"ash"[..]));
    std::fs::write(at("a.obj"), cube(0, 4, [oak, ash, oak, ash, oak, ash])).unwrap();
    std::fs::write(at("b.obj"), cube(2, 6, [Some(b"steel"); 6])).unwrap();
    let (a, b) = (built(&at("a.obj"), &at("a.goblin")).0, built(&at("b.obj"), &at("b.goblin")).0);
    let output = Output::create(&at("c.goblin")).unwrap();
    combine(SetOperation::Difference, &[&a, &b], output, Codec::Plain, 64 << 20, &()).unwrap();
    let cut = ExactModel::open(&at("c.goblin"), &OpenOptions::new()).unwrap();
    let mut counts = BTreeMap::new();
    cut.each_with_values(&["material"], &mut |face, values| {
        let point = |point: &[i32; 3]| cut.grid().to_world(*point);
        let plane = (0..3).find_map(|axis| {
            let at = point(&face.points[0])[axis];
            face.points.iter().all(|other| point(other)[axis] == at).then_some(at)
        });
        let expected = match plane {
            Some(0.0) => "\"oak\"",
            Some(4.0) => "\"ash\"",
            Some(2.0) => "\"steel\"",
            other => panic!("a face in plane {other:?}"),
        };
        assert_eq!(values[0].as_deref(), Some(expected));
        *counts.entry(expected).or_insert(0) += 1;
        Ok(())
    })
    .unwrap();
    assert_eq!(counts, BTreeMap::from([("\"oak\"", 3), ("\"ash\"", 3), ("\"steel\"", 3)]));
    exported(&cut, &at("c.obj"));
    let (again, _) = built(&at("c.obj"), &at("d.goblin"));
    // (The lids are triangulated, as they are not convex.)
    let divided = Triangulated::of_concave(&cut).unwrap();
    assert_eq!(by_bounds(&again, "material"), by_bounds(&divided, "material"));
}

#[test]
fn malicious_names() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    // Names that are not UTF-8 stay distinct and keep their colours; long ones are dropped.
    let long = vec![b'x'; 5000];
    let names: [&[u8]; 6] =
        [b"\xe4 \x80", b"\xf6", "\u{e9}\u{4e16}".as_bytes(), &long, b"a\\\\b#c", b"\"q\""];
    std::fs::write(at("a.obj"), cube(0, 4, names.map(Some))).unwrap();
    std::fs::write(at("a.mtl"), b"newmtl \xe4 \x80\nKd 1 0 0\nnewmtl \xf6\nKd 0 0 1\n").unwrap();
    let (model, report) = built(&at("a.obj"), &at("a.goblin"));
    assert_eq!(report.lost_values, 1);
    let faces = by_bounds(&model, "material");
    let found: BTreeSet<_> = faces.values().filter_map(|(name, _)| name.clone()).collect();
    let expected = ["\u{e4} \u{80}", "\u{f6}", "\u{e9}\u{4e16}", "a\\\\b#c", "\"q\""];
    assert_eq!(found, expected.iter().map(|name| serde_json::json!(name).to_string()).collect());
    assert_eq!(faces["[0.0, 0.0, 0.0] [4.0, 4.0, 0.0]"].1, [[255, 0, 0]; 4]);
    assert_eq!(faces["[0.0, 0.0, 4.0] [4.0, 4.0, 4.0]"].1, [[0, 0, 255]; 4]);

    // Names of other sources may end lines and start statements.
    let grid = Grid::over([[0.0; 3], [10.0; 3]], Some(1.0)).unwrap();
    let mut builder = ModelBuilder::new(Output::create(&at("b.goblin")).unwrap(), grid, 1 << 20).unwrap();
    let corners = [[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]];
    let names = ["\"a\\nv 1 2 3\"", "\" end\\\\\"", "17", "{\"x\":1}"];
    for (number, side) in (0..).zip([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]) {
        let points = side.map(|corner: usize| corners[corner]);
        let face = Face { number, points: &points, ring_ends: &[3], colours: &[], part: 0, source: number };
        builder.push(&face).unwrap();
        builder.face_value("material", names[number as usize]).unwrap();
        builder.face_value("red", "1").unwrap();
        builder.face_value("a b", "1").unwrap();
    }
    builder.finish(&mut Metadata::default(), &()).unwrap();
    let model = ExactModel::open(&at("b.goblin"), &OpenOptions::new()).unwrap();
    let (summary, warnings) = exported(&model, &at("b.obj"));
    assert!(summary.lost_values && warnings.contains("values of faces (red, a b)"), "{warnings}");
    assert!(warnings.contains("of material names"), "{warnings}");
    let text = std::fs::read_to_string(at("b.obj")).unwrap();
    let written: Vec<_> = text.lines().filter_map(|line| line.strip_prefix("usemtl ")).collect();
    assert_eq!(written, ["a_v 1 2 3", "end_", "17", "{\"x\":1}"]);
    assert_eq!(text.lines().filter(|line| line.starts_with("v ")).count(), 4);
    let (_, warnings) = exported(&model, &at("b.ply"));
    assert!(warnings.contains("(red, a b, material)"), "{warnings}");
}

/// Tetrahedra in a row, each with four materials of its own.
fn many_materials(tetrahedra: usize) -> String {
    let mut text = String::new();
    for i in 0..tetrahedra {
        let [x, y] = [i % 200 * 2, i / 200 * 2];
        for [u, v, w] in [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]] {
            writeln!(text, "v {} {} {w}", x + u, y + v).unwrap();
        }
        for (side, [a, b, c]) in [[1, 3, 2], [1, 2, 4], [1, 4, 3], [2, 3, 4]].into_iter().enumerate() {
            let first = 4 * i;
            writeln!(text, "usemtl material {i}/{side}\nf {} {} {}", first + a, first + b, first + c)
                .unwrap();
        }
    }
    text
}

/// Names take memory within the budget, or are refused.
#[test]
fn materials_without_number() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::write(at("a.obj"), many_materials(25_000)).unwrap();
    let error = open_all(&[at("a.obj")], 16 << 20).map(|_| ()).unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
    let mut models = open_all(&[at("a.obj")], 256 << 20).unwrap();
    let mut count = 0u32;
    models[0]
        .faces(&mut |face| {
            let expected = format!("\"material {}/{}\"", count / 4, count % 4);
            assert_eq!(face.values, [("material", expected.as_str())]);
            count += 1;
            Ok(())
        })
        .unwrap();
    assert_eq!((count, models[0].lost_values()), (100_000, 0));
    drop(models);
    // (Fewer are built, since the octree takes longer than the names.)
    std::fs::write(at("b.obj"), many_materials(1000)).unwrap();
    let (model, _) = built(&at("b.obj"), &at("b.goblin"));
    let mut names = BTreeSet::new();
    model
        .each_face_value(0, &mut |_, json| {
            names.insert(json.to_string());
            Ok(())
        })
        .unwrap();
    assert_eq!(names.len(), 4000);
    exported(&model, &at("c.obj"));
    let (again, _) = built(&at("c.obj"), &at("c.goblin"));
    assert_eq!(by_bounds(&again, "material"), by_bounds(&model, "material"));
}

#[test]
fn numbers_round_trip_through_ply() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        element face 4\nproperty float quality\nproperty list uchar int vertex_indices\nproperty uint code\n\
        property list uchar float texcoord\nproperty double exact\nproperty uchar red\nproperty uchar green\n\
        property uchar blue\nproperty short code\nend_header\n";
    let rows = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n0.1 3 0 2 1 4294967295 0 1e-300 1 2 3 5\n\
        0.25 3 0 1 3 2 1 9 inf 1 2 3 5\nnan 3 0 3 2 3 0 0.1 1 2 3 5\n-7e30 3 1 2 3 4 0 -3 1 2 3 5\n";
    std::fs::write(at("a.ply"), format!("{header}{rows}")).unwrap();
    let (model, report) = built(&at("a.ply"), &at("a.goblin"));
    assert_eq!((report.lost_values, model.value_columns().unwrap().len()), (1, 3));
    let values = |model: &ExactModel, column: &str| {
        let all = by_bounds(model, column).into_values().filter_map(|(json, _)| json);
        all.collect::<BTreeSet<_>>()
    };
    let set = |values: &[&str]| values.iter().map(|value| value.to_string()).collect::<BTreeSet<_>>();
    assert_eq!(values(&model, "quality"), set(&["0.1", "0.25", "-7e30"]));
    assert_eq!(values(&model, "code"), set(&["4294967295", "2", "3", "4"]));
    assert_eq!(values(&model, "exact"), set(&["1e-300", "0.1", "-3.0"]));
    let (summary, warnings) = exported(&model, &at("b.ply"));
    assert!(!summary.lost_values && warnings.is_empty(), "{warnings}");
    let (again, report) = built(&at("b.ply"), &at("b.goblin"));
    assert_eq!(report.lost_values, 0);
    for column in ["quality", "exact"] {
        assert_eq!(by_bounds(&again, column), by_bounds(&model, column), "{column}");
    }
    // (Integers over 31 bits are doubles in PLY.)
    assert_eq!(values(&again, "code"), set(&["4294967295.0", "2.0", "3.0", "4.0"]));
    exported(&again, &at("c.ply"));
    assert_eq!(std::fs::read(at("b.ply")).unwrap(), std::fs::read(at("c.ply")).unwrap());
}
