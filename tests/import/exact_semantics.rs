//! Semantics of city object surfaces: to face values and back.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::{Value, json};
use spinney::brep::{Face, Faces, Grid, combine};
use spinney::export::{MeshFormat, export_exact};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::brep::{ChosenParts, CombineReport, InsideRule, ModelBuilder, Triangulated};
use spinney::raw::export::mesh::ExactSummary;
use spinney::raw::import::mesh::{ExactReport, MeshFace};
use spinney::{Codec, ExactModel, Metadata, OpenOptions, Output, SetOperation};

use crate::common::exact::cuboid;
use crate::common::{Random, shared_data};

/// Returns the sides of a cube over eight consecutive vertices: the bottom first, the top second.
fn sides(first: usize) -> Value {
    let sides = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
    json!(sides.map(|side| [side.map(|corner: usize| first + corner)]))
}

/// The sides, oriented inwards.
fn turned(first: usize) -> Value {
    let mut sides: Vec<[Vec<u64>; 1]> = serde_json::from_value(sides(first)).unwrap();
    sides.iter_mut().for_each(|[ring]| ring.reverse());
    json!(sides)
}

fn corners(low: [i32; 3], size: i32) -> Vec<[i32; 3]> {
    let [x, y, z] = low;
    let square = |z: i32| [[x, y, z], [x + size, y, z], [x + size, y + size, z], [x, y + size, z]];
    [square(z), square(z + size)].concat()
}

/// A house with a cavity, a window in a wall, and two walls of one surface; an object of two
/// solids; one without semantics; and two of a template.
fn city() -> Value {
    let house = json!({"type": "Building", "geometry": [{"type": "Solid", "lod": "2",
    "boundaries": [sides(0), turned(8)],
    "semantics": {
        "surfaces": [{"type": "GroundSurface"}, {"type": "RoofSurface", "slope": 0.5, "colour": "re\"d"},
            {"type": "WallSurface", "children": [3]}, {"type": "Window", "parent": 2}],
        "values": [[0, 1, 2, 2, null, 3], null],
    }}]});
    let solid = |first: usize, kind: &str| {
        json!({"type": "Solid", "lod": "2", "boundaries": [sides(first)],
            "semantics": {"surfaces": [{"type": kind}, {"type": "RoofSurface"}], "values": [[0, 1, 0, 0, 0, 0]]}})
    };
    let twins = json!({"type": "Building", "geometry": [solid(16, "WallSurface"), solid(24, "+Outside")]});
    let plain =
        json!({"type": "Building", "geometry": [{"type": "Solid", "lod": "2", "boundaries": [sides(32)]}]});
    let place = |x: i32| {
        json!({"type": "SolitaryVegetationObject", "geometry": [{"type": "GeometryInstance", "template": 0, "boundaries": [40],
            "transformationMatrix": [1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}]})
    };
    let template = json!({"type": "MultiSurface", "lod": "2", "boundaries": sides(0),
        "semantics": {"surfaces": [{"type": "+Bark"}, {"type": "+Leaves"}], "values": [0, 1, 0, 0, null, 0]}});
    let cubes = [([0, 0, 0], 10), ([2, 2, 2], 4), ([20, 0, 0], 5), ([30, 0, 0], 5), ([40, 0, 0], 5)];
    let mut vertices: Vec<[i32; 3]> = cubes.iter().flat_map(|(low, size)| corners(*low, *size)).collect();
    vertices.push([50, 0, 0]);
    json!({"type": "CityJSON", "version": "2.0", "transform": {"scale": [1, 1, 1], "translate": [0, 0, 0]},
        "CityObjects": {"house": house, "twins": twins, "plain": plain, "tree 1": place(0), "tree 2": place(10)},
        "geometry-templates": {"templates": [template], "vertices-templates": corners([0, 0, 0], 3)},
        "vertices": vertices})
}

fn import(input: &Path, path: &Path, options: &ExactOptions) -> (ExactModel, ExactReport) {
    let models = open_all(&[input.to_path_buf()], 64 << 20).unwrap();
    let report = import_exact(models, options, Output::create(path).unwrap(), &()).unwrap();
    let model = ExactModel::open(path, &OpenOptions::new()).unwrap();
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
    (model, report)
}

fn export(faces: &dyn Faces, path: &Path) -> (Value, ExactSummary) {
    let summary =
        export_exact(faces, MeshFormat::of(path).unwrap(), Output::create(path).unwrap(), &()).unwrap();
    let text = std::fs::read(path).unwrap();
    (serde_json::from_slice(&text).unwrap_or_default(), summary)
}

/// Returns the type of each face's surface and of its parent surfaces, in face order.
fn types(faces: &dyn Faces) -> Vec<String> {
    let mut all = Vec::new();
    faces
        .each_with_values(&["type", "parent"], &mut |_, values| {
            let parent = values[1].as_ref().map_or(String::new(), |parent| format!(" of {parent}"));
            all.push(values[0].as_deref().unwrap_or("-").trim_matches('"').to_string() + &parent);
            Ok(())
        })
        .unwrap();
    all
}

fn semantics(file: &Value, name: &str) -> Value {
    file["CityObjects"][name]["geometry"][0].get("semantics").cloned().unwrap_or_default()
}

#[test]
fn semantics_round_trip() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::write(at("a.city.json"), city().to_string()).unwrap();
    let (model, report) = import(&at("a.city.json"), &at("a.goblin"), &ExactOptions::new());
    assert_eq!((report.lost_values, model.len()), (0, 42));
    assert_eq!(model.value_columns().unwrap(), ["surface", "type", "attributes", "parent"]);
    let (wall, roof) = ("WallSurface", "RoofSurface");
    let house = ["GroundSurface", roof, wall, wall, "-", "Window of 2"];
    let twins = [
        wall, roof, wall, wall, wall, wall, "+Outside", roof, "+Outside", "+Outside", "+Outside", "+Outside",
    ];
    let tree = ["+Bark", "+Leaves", "+Bark", "+Bark", "-", "+Bark"];
    let expected = [&house[..], &["-"; 6], &twins, &["-"; 6], &tree, &tree].concat();
    assert_eq!(types(&model), expected);
    assert_eq!(model.face_value(2, 1).unwrap().as_deref(), Some("{\"slope\":0.5,\"colour\":\"re\\\"d\"}"));
    // Surfaces of an object are distinguished: the roofs of the twins are two.
    assert_eq!([13, 19].map(|face| model.face_value(0, face).unwrap().unwrap()), ["1", "3"]);

    let (file, summary) = export(&model, &at("b.city.json"));
    assert!(!summary.lost_values);
    let surfaces = json!([{"type": "GroundSurface"}, {"type": roof, "slope": 0.5, "colour": "re\"d"},
        {"type": wall, "children": [3]}, {"type": "Window", "parent": 2}]);
    let house = json!([[0, 1, 2, 2, null, 3], [null, null, null, null, null, null]]);
    assert_eq!(semantics(&file, "house"), json!({"surfaces": surfaces, "values": house}));
    let surfaces = json!([{"type": wall}, {"type": roof}, {"type": "+Outside"}, {"type": roof}]);
    let twins = json!({"surfaces": surfaces, "values": [[[0, 1, 0, 0, 0, 0]], [[2, 3, 2, 2, 2, 2]]]});
    assert_eq!(semantics(&file, "twins"), twins);
    assert_eq!(semantics(&file, "plain"), Value::Null);
    let tree =
        json!({"surfaces": [{"type": "+Bark"}, {"type": "+Leaves"}], "values": [[0, 1, 0, 0, null, 0]]});
    assert_eq!([semantics(&file, "tree 1"), semantics(&file, "tree 2")], [tree.clone(), tree]);

    // The exported file is read as the same, and models of models keep it.
    let (again, report) = import(&at("b.city.json"), &at("b.goblin"), &ExactOptions::new());
    assert_eq!((types(&again), report.lost_values), (types(&model), 0));
    let (again, _) = import(&at("a.goblin"), &at("c.goblin"), &ExactOptions::new());
    assert_eq!(export(&again, &at("c.city.json")).0, file);

    // Of selected objects, and of triangles.
    let some = ChosenParts::of(&model, &[1, 3].into()).unwrap();
    assert_eq!(semantics(&export(&some, &at("d.city.json")).0, "twins"), twins);
    let (cut, summary) = export(&Triangulated::of(&some).unwrap(), &at("e.city.json"));
    let values = semantics(&cut, "twins")["values"].clone();
    let counts = [0, 1].map(|solid| values[solid][0].as_array().unwrap().len());
    assert_eq!((summary.faces, counts), (36, [12; 2]));
    // Formats without semantics report the loss.
    assert!(export(&model, &at("a.ply")).1.lost_values);
}

/// Faces that a repair splits keep their values.
#[test]
fn repairs_keep_semantics() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let mut city = city();
    // The second twin overlaps the first one.
    let vertices = city["vertices"].as_array_mut().unwrap();
    (24..32).for_each(|corner| vertices[corner][0] = json!(vertices[corner][0].as_i64().unwrap() - 7));
    std::fs::write(at("a.city.json"), city.to_string()).unwrap();
    let mut options = ExactOptions::new();
    (options.repair, options.inside) = (true, InsideRule::Nonzero);
    let (model, report) = import(&at("a.city.json"), &at("a.goblin"), &options);
    let repair = report.repair.unwrap();
    assert!(repair.divided > 0 && repair.removed > 0, "{repair:?}");
    let mut heights = Vec::new();
    model
        .each_with_values(&["type"], &mut |face, values| {
            if model.parts()[face.part as usize] == "twins" {
                let is_roof = face.points.iter().all(|point| model.grid().to_world(*point)[2] == 5.0);
                assert_eq!(values[0].as_deref() == Some("\"RoofSurface\""), is_roof, "{face:?}");
                heights.push(is_roof);
            }
            Ok(())
        })
        .unwrap();
    assert!(heights.contains(&true) && heights.contains(&false));
}

fn operation(operation: SetOperation, models: &[&ExactModel], path: &Path) -> (ExactModel, CombineReport) {
    let output = Output::create(path).unwrap();
    let report = combine(operation, models, output, Codec::Plain, 64 << 20, &()).unwrap();
    let model = ExactModel::open(path, &OpenOptions::new()).unwrap();
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
    (model, report)
}

/// All values of a face, by column name.
type Values = BTreeMap<String, String>;

/// Returns part, source and values of each face.
fn values(model: &ExactModel) -> Vec<(u32, u64, Values)> {
    let names = model.value_columns().unwrap();
    let columns: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut all = Vec::new();
    model
        .each_with_values(&columns, &mut |face, values| {
            let own = names.iter().cloned().zip(values.iter().cloned());
            let own = own.filter_map(|(name, value)| Some((name, value?)));
            all.push((face.part, face.source, own.collect()));
            Ok(())
        })
        .unwrap();
    all
}

/// Checks that a result's faces have the values of the operand faces they come from. Returns how
/// many have any.
fn check_values(result: &ExactModel, operands: &[&ExactModel]) -> usize {
    let mut expected: BTreeMap<u64, Values> = BTreeMap::new();
    let mut first_source = 0;
    for operand in operands {
        let mut last = 0;
        for (part, source, own) in values(operand) {
            last = last.max(source);
            let before = expected.insert(first_source + source, own.clone());
            assert!(before.is_none_or(|before| before == own), "part {part}, source {source}");
        }
        first_source += last + 1;
    }
    let found = values(result);
    for (part, source, own) in &found {
        assert_eq!(Some(own), expected.get(source), "part {part}, source {source}");
    }
    found.iter().filter(|(.., own)| !own.is_empty()).count()
}

/// A tetrahedron that passes through both twins of the city, with values in one of the city's
/// columns and in one of its own. With `is_one`, all faces have one source.
fn tool(path: &Path, is_one: bool) -> ExactModel {
    let grid = Grid { bits: 16, origin: [0, -8000, -8000], step: 1.0, divisor: 1000.0 };
    let mut builder = ModelBuilder::new(Output::create(path).unwrap(), grid, 1 << 20).unwrap();
    let corners =
        [[21_003, 7001, 6007], [37_000, 10_011, 9002], [23_005, 15_000, 10_001], [26_000, 11_000, 17_003]];
    for (number, side) in (0..).zip([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]) {
        let points = side.map(|corner: usize| corners[corner]);
        let source = if is_one { 0 } else { number };
        let face = Face { number, points: &points, ring_ends: &[3], colours: &[], part: 0, source };
        builder.push(&face).unwrap();
        builder.face_value("type", "\"+Tool\"").unwrap();
        if number > 0 {
            builder.face_value("side", &number.to_string()).unwrap();
        }
    }
    builder.part("tool", None).unwrap();
    let built = builder.finish(&mut Metadata::default(), &()).unwrap();
    assert_eq!(built.defect_count, 0);
    ExactModel::open(path, &OpenOptions::new()).unwrap()
}

/// Returns a city, a tool (with one source for all faces if `is_one`), and the city minus the tool.
fn cut_city(directory: &Path, is_one: bool) -> ([ExactModel; 3], CombineReport) {
    let at = |name: &str| directory.join(name);
    std::fs::write(at("a.city.json"), city().to_string()).unwrap();
    let mut options = ExactOptions::new();
    options.snap = Some(0.001);
    let (city, _) = import(&at("a.city.json"), &at("a.goblin"), &options);
    let tool = tool(&at("b.goblin"), is_one);
    let (cut, report) = operation(SetOperation::Difference, &[&city, &tool], &at("c.goblin"));
    ([city, tool, cut], report)
}

/// Faces of results keep the values of the faces they come from, also if these are split, and in
/// results of results.
#[test]
fn operations_keep_values_of_faces() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let ([city, tool, cut], report) = cut_city(directory.path(), false);
    assert!(report.divided > 0 && cut.exact_faces().0 > 0, "{report:?}");
    assert_eq!((report.lost_columns, report.lost_values), (0, 0));
    assert!(check_values(&cut, &[&city, &tool]) > 20);
    let columns = |model: &ExactModel| model.value_columns().unwrap().into_iter().collect::<BTreeSet<_>>();
    let expected = ["attributes", "parent", "side", "surface", "type"].map(String::from);
    assert_eq!(columns(&cut), BTreeSet::from(expected));
    // What the tool has cut belongs to the objects of the city.
    let is_of_tool = |own: &Values| own.get("type").is_some_and(|kind| kind == "\"+Tool\"");
    assert!(values(&cut).iter().filter(|(.., own)| is_of_tool(own)).count() > 2);
    assert_eq!(cut.parts(), city.parts());

    // Complements, and results of results, in which proxy faces are recomputed.
    let (not, _) = operation(SetOperation::Complement, &[&cut], &at("d.goblin"));
    check_values(&not, &[&cut]);
    let (both, _) = operation(SetOperation::Intersection, &[&tool, &city], &at("e.goblin"));
    check_values(&both, &[&tool, &city]);
    let (whole, report) = operation(SetOperation::Union, &[&cut, &both], &at("f.goblin"));
    check_values(&whole, &[&cut, &both]);
    assert_eq!(report.lost_values, 0);
    // Disjoint operands are copied unchanged.
    let (far, _) = operation(SetOperation::Union, &[&city, &cut, &both, &tool], &at("g.goblin"));
    check_values(&far, &[&city, &cut, &both, &tool]);

    // Semantics are exported, without columns that are not semantics.
    let (file, _) = export(&cut, &at("c.city.json"));
    let kinds = |name: &str| -> BTreeSet<String> {
        let surfaces = semantics(&file, name)["surfaces"].clone();
        let kinds =
            surfaces.as_array().unwrap().iter().map(|surface| surface["type"].as_str().unwrap().into());
        kinds.collect()
    };
    assert_eq!(
        kinds("twins"),
        BTreeSet::from(["+Outside", "+Tool", "RoofSurface", "WallSurface"].map(String::from))
    );
    assert_eq!(semantics(&file, "house")["surfaces"].as_array().unwrap().len(), 4);
}

/// If faces of one source have different values, those that are split have none, which is reported.
#[test]
fn values_that_cannot_be_distinguished_are_dropped() {
    let directory = tempfile::tempdir().unwrap();
    let ([city, tool, cut], report) = cut_city(directory.path(), true);
    let last = values(&city).iter().map(|(_, source, _)| *source).max().unwrap();
    let of_tool = values(&cut).into_iter().filter(|(_, source, _)| *source > last);
    let of_tool: Vec<Values> = of_tool.map(|(.., own)| own).collect();
    assert!(
        of_tool.iter().all(BTreeMap::is_empty) && report.lost_values == of_tool.len() as u64,
        "{report:?}"
    );
    assert!(!of_tool.is_empty());
    // Faces that are not near the other operand keep theirs.
    let (copied, report) = operation(SetOperation::First, &[&tool], &directory.path().join("d.goblin"));
    assert_eq!((report.lost_values, values(&copied)), (0, values(&tool)));
}

/// Surfaces of real files are preserved: the same number of each type in each object.
#[test]
fn semantics_of_real_files_round_trip() {
    let Some(path) = shared_data().map(|data| data.join("mesh/cityjson/DH_01_subs.city.json")) else {
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let mut options = ExactOptions::new();
    (options.close, options.skip_bad, options.repair) = (true, true, true);
    let (model, report) = import(&path, &at("a.goblin"), &options);
    assert_eq!(report.lost_values, 0);
    let mut counts: BTreeMap<(u32, String), u32> = BTreeMap::new();
    let mut next = types(&model).into_iter();
    let mut count = |part: u32, kind: String| {
        *counts.entry((part, kind)).or_default() += 1;
        Ok(())
    };
    model.each(&mut |face| count(face.part, next.next().unwrap())).unwrap();
    let roofs = counts.keys().filter(|(_, kind)| kind == "RoofSurface").count();
    assert!(roofs > 5, "{roofs}");
    assert!(!export(&model, &at("b.city.json")).1.lost_values);
    let mut written = open_all(&[at("b.city.json")], 64 << 20).unwrap().remove(0);
    let mut found: BTreeMap<(u32, String), u32> = BTreeMap::new();
    let each = &mut |face: &MeshFace<'_>| {
        let kind = face.values.iter().find(|(name, _)| *name == "type");
        let kind = kind.map_or("-", |(_, json)| json.trim_matches('"'));
        *found.entry((face.part, kind.into())).or_default() += 1;
        Ok(())
    };
    written.faces(each).unwrap();
    assert_eq!((found, written.lost_values()), (counts, 0));
}

/// Many surfaces of interleaved parts are preserved, and non-semantic values are reported.
#[test]
fn many_semantics_round_trip() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let grid = Grid { bits: 9, origin: [0; 3], step: 1.0, divisor: 1.0 };
    let about = |face: u64| format!("{{\"face\":{face},\"text\":\"{}\"}}", "x".repeat(600));
    let build = |name: &str, cells: i32, value: &dyn Fn(u64) -> Vec<(&'static str, String)>| {
        let mut builder =
            ModelBuilder::new(Output::create(&at(name)).unwrap(), grid.clone(), 1 << 20).unwrap();
        let mut number = 0;
        for cell in 0..cells {
            let low = [cell % 20, cell / 20 % 20, cell / 400].map(|at| 3 * at);
            for rings in cuboid(low, low.map(|at| at + 2)) {
                let (points, part) = (&rings[0][..], (cell / (cells / 3) % 2) as u32);
                let ends = [points.len()];
                let face = Face { number, points, ring_ends: &ends, colours: &[], part, source: number };
                builder.push(&face).unwrap();
                value(number).iter().for_each(|(column, json)| builder.face_value(column, json).unwrap());
                number += 1;
            }
        }
        ["one", "other"].iter().for_each(|name| builder.part(name, None).unwrap());
        builder.finish(&mut Metadata::default(), &()).unwrap();
        ExactModel::open(&at(name), &OpenOptions::new()).unwrap()
    };
    let model = build("a.goblin", 3000, &|face| {
        let parent = (face % 6 == 1).then(|| ("parent", (face - 1).to_string()));
        let own = [("surface", face.to_string()), ("type", "\"+Side\"".into()), ("attributes", about(face))];
        own.into_iter().chain(parent).collect()
    });
    let (file, summary) = export(&model, &at("a.city.json"));
    let mut without_parents = 0;
    for (name, firsts, count) in [("one", vec![0, 12_000], 12_000), ("other", vec![6000], 6000)] {
        let semantics = semantics(&file, name);
        let surfaces = semantics["surfaces"].as_array().unwrap();
        // Each box is a solid of one shell.
        let solids = semantics["values"].as_array().unwrap().iter();
        let shells = solids.flat_map(|solid| solid.as_array().unwrap());
        let values: Vec<&Value> = shells.flat_map(|shell| shell.as_array().unwrap()).collect();
        assert_eq!((surfaces.len(), values.len()), (count, count));
        let faces = firsts.iter().flat_map(|first| *first..first + 6000);
        for (value, face) in values.iter().zip(faces) {
            let surface = &surfaces[value.as_u64().unwrap() as usize];
            assert_eq!(surface["face"], face, "{name}");
            match surface["parent"].as_u64() {
                Some(parent) => {
                    let parent = &surfaces[parent as usize];
                    assert_eq!((&parent["face"], &parent["children"][0]), (&json!(face - 1), *value));
                }
                None => without_parents += u64::from(face % 6 == 1),
            }
        }
    }
    // They are processed in groups, which may separate a surface from its parent.
    assert!(without_parents < 5 && summary.lost_values == (without_parents > 0), "{without_parents}");
    // Invalid types and attributes, and surfaces without a type.
    let values = [
        vec![("type", "7"), ("attributes", "{}")],
        vec![("surface", "3")],
        vec![("type", "\"Wall\""), ("attributes", "[]")],
        vec![("type", "\"Wall\""), ("attributes", "{\"type\":1,\"a\":2}")],
        vec![("type", "\"Wall\""), ("parent", "77")],
        vec![],
    ];
    for (number, values) in values.iter().enumerate() {
        let own = values.iter().map(|(column, json)| (*column, json.to_string())).collect::<Vec<_>>();
        let model = build("b.goblin", 30, &|face| {
            if face == 8 { own.clone() } else { vec![("type", "\"Wall\"".into())] }
        });
        let (file, summary) = export(&model, &at("b.city.json"));
        assert_eq!(summary.lost_values, number < 5, "{values:?}");
        assert_eq!(
            semantics(&file, "other"),
            json!({"surfaces": [{"type": "Wall"}], "values": vec![[[0; 6]]; 10]})
        );
    }
}

/// Faces are read whatever the semantics are, or an error explains what is invalid.
#[test]
fn invalid_semantics_are_harmless() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.city.json");
    let text = city().to_string().into_bytes();
    let starts: Vec<usize> =
        (0..text.len()).filter(|at| text[*at..].starts_with(b"\"semantics\"")).map(|at| at + 11).collect();
    let mut random = Random(11);
    let (mut read, mut lost) = (0, 0);
    for _ in 0..600 {
        let mut text = text.clone();
        for _ in 0..=random.below(3) {
            let at = starts[random.below(starts.len() as u64) as usize] + random.below(150) as usize;
            text[at] = b"[]{},:\"0179n-. "[random.below(15) as usize];
        }
        std::fs::write(&path, &text).unwrap();
        let Ok(models) = open_all(std::slice::from_ref(&path), 64 << 20) else { continue };
        for mut model in models {
            let mut faces = 0;
            let outcome = model.faces(&mut |_| {
                faces += 1;
                Ok(())
            });
            if outcome.is_ok() {
                assert!(faces <= 42);
                read += 1;
                lost += u64::from(model.lost_values() > 0);
            }
        }
    }
    assert!(read > 30 && lost > 20, "{read} {lost}");
}
