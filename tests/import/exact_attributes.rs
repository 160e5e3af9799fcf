//! Attributes of city objects, through exact models and back.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};
use spinney::brep::{Face, Faces, Grid};
use spinney::export::{MeshFormat, export_exact};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::brep::ModelBuilder;
use spinney::raw::export::mesh::ExactSummary;
use spinney::raw::import::mesh::{self, ExactReport, MeshFace, Model, ModelInfo};
use spinney::{ExactModel, Metadata, OpenOptions, Output, Result, SetOperation};

use crate::common::exact::cuboid;
use crate::common::shared_data;

fn import(inputs: &[PathBuf], path: &Path) -> (ExactModel, ExactReport) {
    let models = open_all(inputs, 64 << 20).unwrap();
    let report = import_exact(models, &ExactOptions::new(), Output::create(path).unwrap(), &()).unwrap();
    (ExactModel::open(path, &OpenOptions::new()).unwrap(), report)
}

fn export(model: &ExactModel, path: &Path, format: MeshFormat) -> ExactSummary {
    export_exact(model, format, Output::create(path).unwrap(), &()).unwrap()
}

fn read(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Returns the attributes of each part, and of files.
fn attributes(model: &ExactModel) -> (Vec<Option<String>>, Vec<String>) {
    let parts = (0..model.parts().len() as u32).map(|part| model.part_attributes(part).unwrap());
    (parts.collect(), model.file_attributes().unwrap())
}

const TRANSFORM: &str = r#""transform":{"scale":[1,1,1],"translate":[0,0,0]}"#;

/// Returns a unit cube as a geometry, and its vertices.
fn cube(x: i32) -> (String, String) {
    let sides = "[[[0,3,2,1]],[[4,5,6,7]],[[0,1,5,4]],[[1,2,6,5]],[[2,3,7,6]],[[3,0,4,7]]]";
    let geometry = format!(r#""geometry":[{{"type":"Solid","lod":"2","boundaries":[{sides}]}}]"#);
    let corner = |[dx, y, z]: [i32; 3]| format!("[{},{y},{z}]", x + dx);
    let square = |z: i32| [[0, 0, z], [1, 0, z], [1, 1, z], [0, 1, z]].map(corner).join(",");
    (geometry, format!("[{},{}]", square(0), square(1)))
}

/// A building whose part has the geometry.
fn text() -> String {
    let (geometry, vertices) = cube(0);
    format!(
        r#"{{"type":"CityJSON","version":"2.0",{TRANSFORM},
        "metadata" : {{ "title": "A \"house\"", "identifier": "id-7", "geographicalExtent": [0,0,0,9,9,9],
            "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415", "pointOfContact": {{"contactName": "N"}} }},
        "extensions": {{"Noise": {{"url": "https://example.com/noise.json", "version": "1.0"}}}},
        "CityObjects":{{
            "house": {{ "type": "Building", "children": [ "house-0" ],
                "attributes": {{ "year": 1948, "height": 10.10, "none": null, "roof": {{ "kind": "flat, \" red\"",
                    "slopes": [ 1, [ 2.50, true ] ] }}, "naïve \\ key": "\u00e9 \t" }} }},
            "house-0": {{ "type": "BuildingPart", "parents": ["house"], {geometry},
                "geographicalExtent": [0, 0.0, 0, 1, 1, 1] }},
            "thing": {{ "type": "GenericCityObject" }}
        }},
        "vertices":{vertices}}}"#
    )
}

/// Returns the city objects without their geometry.
fn objects(file: &Value) -> Map<String, Value> {
    let mut objects = file["CityObjects"].as_object().unwrap().clone();
    objects.values_mut().for_each(|object| _ = object.as_object_mut().unwrap().remove("geometry"));
    objects
}

#[test]
fn attributes_round_trip() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::write(at("a.city.json"), text()).unwrap();
    let (model, report) = import(&[at("a.city.json")], &at("a.goblin"));
    assert_eq!((report.attributes, model.parts_with_attributes().unwrap()), (2, 2));
    let part = |part| model.part_attributes(part).unwrap();
    let house = "{\"type\":\"Building\",\"children\":[\"house-0\"],\"attributes\":{\"year\":1948,\"height\":10.10,\
                 \"none\":null,\"roof\":{\"kind\":\"flat, \\\" red\\\"\",\"slopes\":[1,[2.50,true]]},\
                 \"naïve \\\\ key\":\"\\u00e9 \\t\"}}";
    assert_eq!(part(0).as_deref(), Some(house));
    assert!(part(1).unwrap().contains("\"geographicalExtent\":[0,0.0,0,1,1,1]"));
    assert_eq!(part(2), None);
    // By name, and column by column.
    for (number, name) in (0..).zip(model.parts()) {
        assert_eq!(model.part_number(name).unwrap(), Some(number));
    }
    assert_eq!(["", "i", "zzz"].map(|name| model.part_number(name).unwrap()), [None; 3]);
    let columns = model.part_columns().unwrap();
    let column = |names: &[&str]| columns.iter().position(|column| column == names).unwrap() as u32;
    let values = |column: u32| {
        let mut all = Vec::new();
        let mut add = |part: u32, json: &str| {
            all.push((part, json.to_string()));
            Ok(())
        };
        model.each_part_value(column, &mut add).unwrap();
        all
    };
    let text = |part: u32, json: &str| (part, json.to_string());
    assert_eq!(values(column(&["type"])), [text(0, "\"Building\""), text(1, "\"BuildingPart\"")]);
    assert_eq!(values(column(&["attributes", "height"])), [text(0, "10.10")]);
    assert_eq!(values(column(&["attributes", "naïve \\ key"])), [text(0, "\"\\u00e9 \\t\"")]);
    assert_eq!(values(99), []);
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);

    let summary = export(&model, &at("b.city.json"), MeshFormat::CityJson);
    assert_eq!(summary.lost_attributes, 0);
    let [first, second] = ["a.city.json", "b.city.json"].map(|name| read(&at(name)));
    assert_eq!(objects(&second), objects(&first));
    let mut metadata = first["metadata"].clone();
    // The extent is that of the model.
    metadata["geographicalExtent"] = second["metadata"]["geographicalExtent"].clone();
    assert!(metadata["geographicalExtent"].is_array());
    assert_eq!(second["metadata"], metadata);
    assert_eq!(second["extensions"], first["extensions"]);
    // Strings are identical, including all digits, and so is the model.
    let (again, _) = import(&[at("b.city.json")], &at("b.goblin"));
    assert_eq!(attributes(&again), attributes(&model));
    assert_eq!(again.metadata().frame.crs, model.metadata().frame.crs);
    // A model built from a model keeps them as well.
    let (again, _) = import(&[at("a.goblin")], &at("c.goblin"));
    assert_eq!(attributes(&again), attributes(&model));

    for (format, name) in [(MeshFormat::Ply, "a.ply"), (MeshFormat::Stl, "a.stl"), (MeshFormat::Obj, "a.obj")]
    {
        assert_eq!(export(&model, &at(name), format).lost_attributes, 3);
    }
}

/// Without attributes the file has no attribute table.
#[test]
fn objects_without_a_type_have_no_attributes() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let (geometry, vertices) = cube(0);
    let object = format!(r#""CityObjects":{{"x":{{"type":"GenericCityObject",{geometry}}}}}"#);
    let text = format!(r#"{{"type":"CityJSON","version":"2.0",{TRANSFORM},{object},"vertices":{vertices}}}"#);
    std::fs::write(at("a.city.json"), text).unwrap();
    let (model, report) = import(&[at("a.city.json")], &at("a.goblin"));
    assert_eq!(report.attributes, 0);
    assert_eq!(attributes(&model), (vec![None], vec![]));
    export(&model, &at("b.city.json"), MeshFormat::CityJson);
    let (again, _) = import(&[at("b.city.json")], &at("b.goblin"));
    assert_eq!(again.parts(), model.parts());
    // The metadata has only the extent.
    let metadata = &read(&at("b.city.json"))["metadata"];
    assert_eq!(metadata.as_object().unwrap().keys().collect::<Vec<_>>(), ["geographicalExtent"]);
}

/// Sequences and several files: parts are concatenated; conflicting file metadata is dropped.
#[test]
fn sequences_and_several_files() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::write(at("a.city.json"), text()).unwrap();
    let first = format!(
        r#"{{"type":"CityJSON","version":"2.0",{TRANSFORM},"metadata":{{"title":"S"}},"CityObjects":{{}},"vertices":[]}}"#
    );
    let feature = |x: i32| {
        let (geometry, vertices) = cube(x);
        let object = format!(r#"{{"type":"Tunnel","attributes":{{"x":{x}}},{geometry}}}"#);
        format!(
            r#"{{"type":"CityJSONFeature","id":"t","CityObjects":{{"t{x}":{object}}},"vertices":{vertices}}}"#
        )
    };
    std::fs::write(at("s.city.jsonl"), [first, feature(5), feature(8)].join("\n")).unwrap();
    let (model, _) = import(&[at("s.city.jsonl")], &at("s.goblin"));
    export(&model, &at("s.city.json"), MeshFormat::CityJson);
    let file = read(&at("s.city.json"));
    let tunnel = |x: i32| json!({ "type": "Tunnel", "attributes": { "x": x } });
    assert_eq!(Value::from(objects(&file)), json!({ "t5": tunnel(5), "t8": tunnel(8) }));
    assert_eq!(
        file["metadata"],
        json!({ "title": "S", "geographicalExtent": [5.0, 0.0, 0.0, 9.0, 1.0, 1.0] })
    );

    // The sequence has no coordinate system, so the second file has none either.
    std::fs::write(at("b.city.json"), text().replace("referenceSystem", "other")).unwrap();
    let (model, report) = import(&[at("s.city.jsonl"), at("b.city.json")], &at("both.goblin"));
    assert_eq!(report.attributes, 4);
    let (parts, files) = attributes(&model);
    let has_attributes: Vec<bool> = parts.iter().map(Option::is_some).collect();
    assert_eq!((has_attributes, files.len()), (vec![true, true, true, true, false], 2));
    assert!(parts[2].as_ref().unwrap().starts_with("{\"type\":\"Building\""));
    let summary = export(&model, &at("both.city.json"), MeshFormat::CityJson);
    assert_eq!(summary.lost_attributes, 2);
    let file = read(&at("both.city.json"));
    assert_eq!(objects(&file)["t8"], tunnel(8));
    assert_eq!(objects(&file)["house"], objects(&read(&at("a.city.json")))["house"]);
    assert_eq!(file["metadata"], json!({ "geographicalExtent": [0.0, 0.0, 0.0, 9.0, 1.0, 1.0] }));
}

/// Attributes larger than a file's metadata: many objects, long values and names. Losses due to the
/// memory limit are reported.
#[test]
fn attributes_may_be_long() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let (geometry, vertices) = cube(0);
    let long = "x".repeat(15 << 20);
    // Objects of many kinds, so that there are more member lists than are cached.
    let object = |number: usize| {
        let members: Vec<String> =
            (0..13).filter(|bit| number >> bit & 1 == 1).map(|bit| format!("\"m{bit}\":{number}")).collect();
        format!("\"o{number}\":{{\"type\":\"Road\",\"attributes\":{{{}}}}}", members.join(","))
    };
    let objects: Vec<String> = (0..8192).map(object).collect();
    let own = format!(
        r#""{long}":{{"type":"Tunnel",{geometry}}},"b":{{"type":"Bridge","attributes":{{"about":"{long}"}}}}"#
    );
    let text = format!(
        r#"{{"type":"CityJSON","version":"2.0",{TRANSFORM},"CityObjects":{{{own},{}}},"vertices":{vertices}}}"#,
        objects.join(",")
    );
    std::fs::write(at("a.city.json"), text).unwrap();
    let models = open_all(&[at("a.city.json")], 512 << 20).unwrap();
    let output = Output::create(&at("a.goblin")).unwrap();
    let report = import_exact(models, &ExactOptions::new(), output, &()).unwrap();
    assert_eq!(report.attributes, 8194);
    for options in [OpenOptions::new(), OpenOptions::new().positioned(1 << 20)] {
        let model = ExactModel::open(&at("a.goblin"), &options).unwrap();
        assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
        assert_eq!((model.parts()[0].len(), model.parts().len()), (long.len(), 8194));
        let about = format!("{{\"type\":\"Bridge\",\"attributes\":{{\"about\":\"{long}\"}}}}");
        assert!(model.part_attributes(1).unwrap() == Some(about));
        for number in [0, 1, 77, 4095, 4096, 5000, 8191] {
            let part = model.part_number(&format!("o{number}")).unwrap().unwrap();
            let expected =
                format!("{{{}}}", object(number).split_once(":{").unwrap().1.strip_suffix("}").unwrap());
            assert_eq!(model.part_attributes(part).unwrap(), Some(expected));
        }
    }
    let error = mesh::open(&at("a.city.json"), 16 << 20).err().unwrap();
    assert!(matches!(error, spinney::Error::TooLarge { .. }), "{error}");
}

#[test]
fn invalid_objects_are_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.city.json");
    for (right, wrong) in [
        ("{ \"type\": \"GenericCityObject\" }", "[]"),
        ("{ \"type\": \"GenericCityObject\" }", "7"),
        ("\"metadata\" : {", "\"metadata\": 1, \"x\": {"),
        ("\"https://www.opengis.net/def/crs/EPSG/0/7415\"", "[1]"),
    ] {
        std::fs::write(&path, text().replace(right, wrong)).unwrap();
        let error = mesh::open(&path, 64 << 20).err().unwrap().to_string();
        assert!(error.contains("line "), "{wrong}: {error}");
    }
}

/// Replaces a model's faces by those of a tetrahedron, which bound no solid together, and keeps its
/// attributes.
struct TetrahedronModel {
    info: ModelInfo,
}

impl Model for TetrahedronModel {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let [low, high] = self.info.bounds;
        let corners = [low, [high[0], low[1], low[2]], [low[0], high[1], low[2]], [low[0], low[1], high[2]]];
        for side in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
            let points = side.map(|corner: usize| corners[corner]);
            each(&MeshFace { points: &points, ring_ends: &[3], colours: &[], part: 0, values: &[] })?;
        }
        Ok(())
    }
}

/// All attributes of objects in real files are preserved.
#[test]
fn real_attributes_round_trip() {
    let Some(data) = shared_data() else { return println!("skipped: no test data") };
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    for name in ["DH_01_subs.city.json", "delft.json", "rotterdam_subset.json"] {
        let path = data.join("mesh/cityjson").join(name);
        let info = mesh::open(&path, 64 << 20).unwrap().info().clone();
        let models: Vec<Box<dyn Model>> = vec![Box::new(TetrahedronModel { info })];
        let output = Output::create(&at("x.goblin")).unwrap();
        let report = import_exact(models, &ExactOptions::new(), output, &()).unwrap();
        assert!(report.attributes > 0, "{name}: {report:?}");
        let model = ExactModel::open(&at("x.goblin"), &OpenOptions::new()).unwrap();
        assert_eq!(export(&model, &at("x.city.json"), MeshFormat::CityJson).lost_attributes, 0);
        let (first, second) = (read(&path), read(&at("x.city.json")));
        assert_eq!(objects(&second), objects(&first), "{name}");
        let titles = [&first, &second].map(|file| file["metadata"].get("title").cloned());
        assert_eq!(titles[0], titles[1], "{name}");
    }
}

/// Face values are preserved, singly and column by column, also for complements.
#[test]
fn values_of_faces_round_trip() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let grid = Grid { bits: 9, origin: [0; 3], step: 1.0, divisor: 1.0 };
    let mut builder = ModelBuilder::new(Output::create(&at("a.goblin")).unwrap(), grid, 1 << 20).unwrap();
    assert!(builder.face_value("first", "1").is_err(), "a value before all faces");
    let value = |column: u64, face: u64| -> Option<String> {
        let is_there = column == 0 || face.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 61 == column;
        is_there.then(|| {
            if column == 2 { format!("\"{}\"", "y".repeat(face as usize % 90)) } else { format!("{face}.50") }
        })
    };
    let mut number = 0;
    for cell in 0..3000 {
        let low = [cell % 20, cell / 20 % 20, cell / 400].map(|at| 3 * at);
        for rings in cuboid(low, low.map(|at| at + 2)) {
            let (points, colours, part) = (&rings[0][..], &[][..], 0);
            let face = Face { number, points, ring_ends: &[points.len()], colours, part, source: number };
            builder.push(&face).unwrap();
            for column in 0..3 {
                if let Some(value) = value(column, number) {
                    builder.face_value(&format!("column {column}"), &value).unwrap();
                }
            }
            number += 1;
        }
    }
    builder.finish(&mut Metadata::default(), &()).unwrap();
    for options in [OpenOptions::new(), OpenOptions::new().positioned(1 << 16)] {
        let model = ExactModel::open(&at("a.goblin"), &options).unwrap();
        assert_eq!((model.len(), model.verify(64 << 20, &()).unwrap()), (18_000, vec![]));
        assert_eq!(model.face_columns().unwrap(), [["column 0"], ["column 1"], ["column 2"]]);
        for column in 0..3 {
            let mut found = Vec::new();
            let mut add = |face: u32, json: &str| {
                found.push((face, json.to_string()));
                Ok(())
            };
            model.each_face_value(column, &mut add).unwrap();
            let expected = (0..18_000).filter_map(|face| Some((face as u32, value(column.into(), face)?)));
            assert!(found == expected.collect::<Vec<_>>(), "{column}");
            for face in (0..18_000).step_by(97) {
                assert_eq!(model.face_value(column, face).unwrap(), value(column.into(), face.into()));
            }
        }
        assert_eq!(model.face_value(3, 0).unwrap(), None);
        let output = Output::create(&at("b.goblin")).unwrap();
        let report = spinney::brep::combine(
            SetOperation::Complement,
            &[&model],
            output,
            spinney::Codec::Plain,
            64 << 20,
            &(),
        )
        .unwrap();
        assert_eq!((report.lost_columns, report.lost_values), (0, 0));
        let turned = ExactModel::open(&at("b.goblin"), &options).unwrap();
        assert_eq!(turned.face_columns().unwrap(), model.face_columns().unwrap());
        for face in (0..18_000).step_by(97) {
            for column in 0..3 {
                assert_eq!(turned.face_value(column, face).unwrap(), value(column.into(), face.into()));
            }
        }
    }
    let (again, report) = import(&[at("a.goblin")], &at("b.goblin"));
    assert_eq!((again.value_columns().unwrap().len(), report.lost_values), (3, 0));
    // (The faces of meshes are sorted. They are found by their vertices.)
    let numbers = |model: &ExactModel| {
        let mut numbers: HashMap<Vec<[i32; 3]>, u64> = HashMap::new();
        let add = &mut |face: &Face<'_>| {
            let mut points = face.points.to_vec();
            points.sort_unstable();
            numbers.insert(points, face.number);
            Ok(())
        };
        model.each(add).unwrap();
        numbers
    };
    let old = numbers(&ExactModel::open(&at("a.goblin"), &OpenOptions::new()).unwrap());
    let new = numbers(&again);
    assert!(old.len() == 18_000 && old != new);
    for (points, face) in old.iter().filter(|(_, face)| face.is_multiple_of(97)) {
        assert_eq!(again.face_value(1, new[points] as u32).unwrap(), value(1, *face));
    }
}
