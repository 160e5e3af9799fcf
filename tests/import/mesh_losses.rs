//! Losses that must be reported: cells wasted on vertices and levels of detail that no face uses or
//! that are distant, solids without an inside, and attributes that mesh formats cannot store.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use spinney::brep::{Face, Grid};
use spinney::export::{GltfOptions, MeshFormat, MeshRequest, export_exact, export_glb, export_mesh};
use spinney::import::mesh::{ExactOptions, Resolution, SolidOptions, import_exact, open_all, plan_models};
use spinney::query::{ContourLevels, ContourRequest};
use spinney::raw::brep::FaceList;
use spinney::raw::export::mesh::export_isosurfaces;
use spinney::raw::import::mesh::{InsideTest, SolidReport};
use spinney::raw::store::Tag;
use spinney::raw::value::Palette;
use spinney::{
    Crs, DataKind, Dataset, ExactModel, Frame, Metadata, OpenOptions, Output, Progress, Rule, SampleType,
    TreeType,
};

use crate::common::{OCT, byte, made, oct, opened, options, shared_data, value, with, write_cells};

/// Builds a model at 16 cells and opens the tree.
fn build(model: PathBuf, options: &SolidOptions) -> (Dataset, SolidReport) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("solid.goblin");
    let models = open_all(&[model], 64 << 20).unwrap();
    let report = plan_models(models, options).unwrap().build(Output::create(&path).unwrap(), &()).unwrap();
    (spinney::open(&path).unwrap(), report)
}

fn sixteen() -> SolidOptions {
    with(SolidOptions::new(), |it| it.resolution = Resolution::Cells(16))
}

/// Builds a model from a string.
fn build_text(name: &str, text: &str) -> (Dataset, SolidReport) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    std::fs::write(&path, text).unwrap();
    build(path, &sixteen())
}

const TETRAHEDRON: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

fn volume(tree: &Dataset) -> f64 {
    tree.solid(tree.depth(), &()).unwrap().world_volume()
}

#[test]
fn only_what_faces_use_sets_the_cells() {
    let (alone, expected) = build_text("a.obj", TETRAHEDRON);
    assert!(expected.cells > 0);
    let points = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n9999 0 0\n";
    let off = format!("OFF\n5 4 0\n{points}3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n");
    let header = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 4\nproperty list uchar int vertex_indices\nend_header\n";
    let ply = format!("{header}{points}3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n");
    let facet = |corners: [&str; 3]| {
        let corners = corners.map(|corner| format!("vertex {corner}\n")).concat();
        format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
    };
    let [a, b, c, d] = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"];
    // A facet without three distinct vertices is not a face.
    let facets =
        [[a, c, b], [a, b, d], [a, d, c], [b, c, d], ["7 7 7", "7 7 7", "8 8 8"]].map(facet).concat();
    let stl = format!("solid a\n{facets}endsolid a\n");
    let obj = format!("{TETRAHEDRON}v 0 -5000 0\n");
    let shell = |z: u32| format!(r#"[[[[{z}, 2, 1]], [[{z}, 1, 3]], [[{z}, 3, 2]], [[1, 2, 3]]]]"#);
    let solid = |lod: &str, boundaries: &str| {
        format!(r#"{{"type": "Solid", "lod": "{lod}", "boundaries": {boundaries}}}"#)
    };
    let city = format!(
        r#"{{"type": "CityJSON", "version": "2.0", "transform": {{"scale": [1, 1, 1], "translate": [0, 0, 0]}},
        "CityObjects": {{"a": {{"type": "Building", "geometry": [{}, {}]}}}},
        "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-700, 0, 0]]}}"#,
        solid("1.2", &shell(4)),
        solid("2.2", &shell(0)),
    );
    for (name, text) in
        [("a.obj", obj), ("a.off", off), ("a.ply", ply), ("a.stl", stl), ("a.city.json", city)]
    {
        let (tree, report) = build_text(name, &text);
        assert_eq!(tree.metadata().frame.matrix, alone.metadata().frame.matrix, "{name}");
        assert_eq!((report.cells, volume(&tree)), (expected.cells, volume(&alone)), "{name}");
    }
}

#[test]
fn solids_without_an_interior_are_reported() {
    let doubled = format!("{TETRAHEDRON}f 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n");
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_string();
    for (text, inside) in [(doubled, InsideTest::Closed), (triangle, InsideTest::Open)] {
        let (_, report) = build_text("a.obj", &text);
        assert_eq!((report.cells, report.inside), (0, inside));
        let directory = tempfile::tempdir().unwrap();
        let model = directory.path().join("a.obj");
        std::fs::write(&model, text).unwrap();
        let (_, report) = build(model, &with(sixteen(), |it| it.shell = true));
        assert!(report.cells > 0);
    }
}

#[test]
fn files_that_lost_something() {
    let Some(directory) = shared_data().map(|directory| directory.join("hostile/mesh")) else { return };
    let measure = |name: &str| {
        let path = directory.join(name);
        if !Path::new(&path).is_file() {
            eprintln!("skipped: {} is not there", path.display());
            return None;
        }
        let (tree, report) = build(path, &sixteen());
        Some((volume(&tree), report.cells))
    };
    for (name, expected) in [("bom_silent.obj", 1.0), ("multilod.city.json", 1000.0)] {
        if let Some((found, _)) = measure(name) {
            assert!((found - expected).abs() < 1e-9 * expected, "{name}: {found}");
        }
    }
    if let Some((found, _)) = measure("stray.obj") {
        assert!((found - 1.0 / 6.0).abs() < 0.02, "{found}");
    }
    for name in ["triangle.obj", "dup_oppall.obj"] {
        assert!(measure(name).is_none_or(|(_, cells)| cells == 0), "{name}");
    }
}

#[test]
fn large_coordinates_are_coordinates() {
    let (_, expected) = build_text("a.obj", TETRAHEDRON);
    let of_size = |size: &str| {
        let vertices = format!("v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nv 0 0 {size}\n");
        format!("{vertices}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    };
    for size in ["3e38", "2.5e90", "1e-90"] {
        let (_, report) = build_text("a.obj", &of_size(size));
        assert_eq!((report.cells, report.collapsed), (expected.cells, 0), "{size}");
        // Vertices that no face uses do not matter, at any distance.
        let (_, report) = build_text("a.obj", &format!("{}v -3.4e38 3.4e38 1e300\n", of_size(size)));
        assert_eq!(report.cells, expected.cells, "{size}");
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.obj");
    let error_of = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let plan = plan_models(open_all(std::slice::from_ref(&path), 64 << 20).unwrap(), &sixteen());
        let output = Output::create(&directory.path().join("x.goblin")).unwrap();
        plan.and_then(|plan| plan.build(output, &())).unwrap_err().to_string()
    };
    // A very long face: relative to its length, all other faces are lines or points. The file is
    // valid, and the error does not call it corrupt.
    let far = format!("{TETRAHEDRON}v 3e38 -3e38 3e38\nf 1 2 5\n");
    let error = error_of(&far);
    for text in ["points or lines", "3e38", "outliers"] {
        assert!(error.contains(text) && !error.contains("corrupt"), "{error}");
    }
    let models = open_all(std::slice::from_ref(&path), 64 << 20).unwrap();
    let output = Output::create(&directory.path().join("x.goblin")).unwrap();
    let error = import_exact(models, &ExactOptions::new(), output, &()).unwrap_err().to_string();
    assert!(error.contains("points or lines") && !error.contains("corrupt"), "{error}");
    // Two such faces with an area: the other faces are counted as collapsed.
    let (_, report) = build_text("a.obj", &format!("{far}v 0 3e38 3e38\nf 1 5 6\n"));
    assert_eq!((report.faces, report.collapsed, report.triangles), (6, 5, 1));
    // Cells whose volume is not finite.
    for size in ["1e200", "1e-200"] {
        let error = error_of(&of_size(size));
        assert!(error.contains("scale the model"), "{error}");
    }
}

/// Collects warnings.
#[derive(Default)]
struct Warnings(Mutex<Vec<String>>);

impl Progress for Warnings {
    fn warn(&self, _: &Path, text: &str) {
        self.0.lock().unwrap().push(text.into());
    }
}

/// Returns the warning issued for a file: empty, or one line.
fn warnings(write: impl FnOnce(Output, &Warnings)) -> String {
    let (directory, warnings) = (tempfile::tempdir().unwrap(), Warnings::default());
    write(Output::create(&directory.path().join("mesh")).unwrap(), &warnings);
    let lines = warnings.0.into_inner().unwrap();
    assert!(lines.len() <= 1, "{lines:?}");
    lines.concat()
}

/// Checks that a line lists exactly the expected losses of all possible ones.
fn check_reported(line: &str, expected: &[&str], all: &[&str], what: &str) {
    for text in all {
        assert_eq!(line.contains(text), expected.contains(text), "{what}, `{text}`: {line}");
    }
    assert_eq!(line.is_empty(), expected.is_empty(), "{what}: {line}");
}

const MESHES: [MeshFormat; 4] = [MeshFormat::Ply, MeshFormat::Obj, MeshFormat::Stl, MeshFormat::Off];

#[test]
fn losses_of_meshes_of_trees_are_reported() {
    const ALL: [&str; 6] =
        ["colours", "values of cells", "names of classes", "the palette", "EPSG:28992", "length mm"];
    let [colours, values, names, palette, crs, unit] = ALL;
    let mut placed =
        Metadata { frame: Frame { crs: Some(Crs::epsg(28992)), ..Frame::identity() }, ..Metadata::default() };
    placed.set_tag(Tag::Unit, "mm");
    let mut named = Metadata { class_names: [(1.into(), "wall".into())].into(), ..placed.clone() };
    named.palette = Some(Palette { colours: vec![[1; 4]; 256] });
    let tree = |form: TreeType, (rule, kind): (Rule, DataKind), metadata: &Metadata| {
        let cells = made(form, [4; 3], |[x, ..]| Some(value(form.value, x + 1)));
        opened(|path| {
            write_cells(path, &cells, &options(rule, kind, cells.depth()).metadata(metadata.clone()));
        })
    };
    let mean = (Rule::Mean, DataKind::Continuous);
    let solid = tree(OCT, (Rule::Occupancy, DataKind::Continuous), &Metadata::default());
    let coloured = tree(oct(SampleType::U8, 3), mean, &placed);
    let classes = tree(OCT, (Rule::Majority, DataKind::Categorical), &named);
    let numbers = tree(oct(SampleType::F32, 1), mean, &placed);
    // A single value only marks existing cells.
    let full = made(OCT, [4; 3], |_| Some(byte(255)));
    let full =
        opened(|path| write_cells(path, &full, &options(Rule::Max, DataKind::Continuous, full.depth())));
    for format in MESHES {
        let (is_ply, is_off) = (format == MeshFormat::Ply, format == MeshFormat::Off);
        let cases: [(&str, &Dataset, Vec<&str>); 5] = [
            ("solid", &solid, vec![]),
            ("full", &full, vec![]),
            (
                "coloured",
                &coloured,
                if is_ply || is_off { vec![crs, unit] } else { vec![colours, crs, unit] },
            ),
            (
                "classes",
                &classes,
                if is_ply {
                    vec![names, palette, crs, unit]
                } else {
                    vec![values, names, palette, crs, unit]
                },
            ),
            ("numbers", &numbers, vec![values, crs, unit]),
        ];
        for (what, tree, expected) in cases {
            let line = warnings(|output, warnings| {
                export_mesh(tree, &MeshRequest::new(), output, format, warnings).unwrap();
            });
            check_reported(&line, &expected, &ALL, &format!("{what}, {format:?}"));
        }
        let line = warnings(|output, warnings| {
            let request = ContourRequest::new(ContourLevels::At(vec![0.5]));
            export_isosurfaces(&numbers, &request, output, format, warnings).unwrap();
        });
        check_reported(&line, &[crs, unit], &ALL, &format!("isosurface, {format:?}"));
    }
    // Palettes become colours there, and names are in a table.
    let of_models: [(&Dataset, Vec<&str>); 5] = [
        (&solid, vec![]),
        (&full, vec![]),
        // (Lengths are converted to metres.)
        (&coloured, vec![crs]),
        (&classes, vec![crs]),
        (&numbers, vec![values, crs]),
    ];
    for (tree, expected) in of_models {
        let line = warnings(|output, warnings| {
            export_glb(tree, &MeshRequest::new(), &GltfOptions::new(), output, warnings).unwrap();
        });
        check_reported(&line, &expected, &ALL, "glb");
    }
}

#[test]
fn losses_of_meshes_of_exact_models_are_reported() {
    const ALL: [&str; 5] = ["colours", "parts", "the name of the part", "EPSG:28992", "length mm"];
    let [colours, parts, name, crs, unit] = ALL;
    let directory = tempfile::tempdir().unwrap();
    let model = |text: &str, is_placed: bool| {
        let (path, file) = (directory.path().join("a.obj"), directory.path().join("a.goblin"));
        std::fs::write(&path, text).unwrap();
        let mut options = ExactOptions::new();
        if is_placed {
            (options.crs, options.unit) = (Some(Crs::epsg(28992)), Some("mm".into()));
        }
        let models = open_all(&[path], 64 << 20).unwrap();
        import_exact(models, &options, Output::create(&file).unwrap(), &()).unwrap();
        ExactModel::open(&file, &OpenOptions::new()).unwrap()
    };
    // One with colours, which has two parts; a part with a name; only faces.
    let red = TETRAHEDRON.replace("v 0 0 0", "v 0 0 0 1 0 0").replace("v 1 0 0", "v 1 0 0 1 0 0");
    let red = red.replace("v 0 1 0", "v 0 1 0 1 0 0").replace("v 0 0 1\n", "v 0 0 1 1 0 0\n");
    let [two, named, plain] = [
        model(&format!("o a\n{}", red.replace("f 1 4 3", "o b\nf 1 4 3")), true),
        model(&format!("o a\n{TETRAHEDRON}"), false),
        model(TETRAHEDRON, false),
    ];
    for format in [&MESHES[..], &[MeshFormat::CityJson]].concat() {
        let of_two: &[&str] = match format {
            MeshFormat::Obj => &[crs, unit],
            MeshFormat::Stl => &[colours, parts, crs, unit],
            // Coordinates are in the unit of the coordinate system.
            MeshFormat::CityJson => &[colours],
            _ => &[parts, crs, unit],
        };
        let has_names = matches!(format, MeshFormat::Obj | MeshFormat::CityJson);
        let of_named: &[&str] = if has_names { &[] } else { &[name] };
        for (what, model, expected) in
            [("two parts", &two, of_two), ("named", &named, of_named), ("plain", &plain, &[])]
        {
            let line = warnings(|output, warnings| {
                export_exact(model, format, output, warnings).unwrap();
            });
            check_reported(&line, expected, &ALL, &format!("{what}, {format:?}"));
        }
    }
    // A face with a hole, which is triangulated in most formats.
    let mut faces = FaceList::new(Grid::over([[0.0; 3], [9.0; 3]], Some(1.0)).unwrap(), vec!["mesh".into()]);
    let points = [[0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0], [3, 3, 0], [3, 6, 0], [6, 6, 0], [6, 3, 0]];
    faces.push(&Face { number: 0, points: &points, ring_ends: &[4, 8], colours: &[], part: 0, source: 0 });
    for format in [&MESHES[..], &[MeshFormat::CityJson]].concat() {
        let line = warnings(|output, warnings| {
            export_exact(&faces, format, output, warnings).unwrap();
        });
        check_reported(&line, &[], &ALL, &format!("a hole, {format:?}"));
    }
}
