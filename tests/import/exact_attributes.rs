//! Attributes of city objects, through exact models and back.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};
use spinney::Result;
use spinney::brep::{Attributes, ExactModel, Faces};
use spinney::export::mesh::{ExactSummary, MeshFormat, export_exact};
use spinney::import::mesh::{
    self, ExactOptions, ExactReport, MeshFace, Model, ModelInfo, import_exact, open_all,
};
use spinney::io::Output;
use spinney::store::OpenOptions;

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

const TRANSFORM: &str = r#""transform":{"scale":[1,1,1],"translate":[0,0,0]}"#;

/// A cube of one unit as a geometry, and its vertices.
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
                "geographicalExtent": [0.5, 0, 0, 1, 1, 1] }},
            "thing": {{ "type": "GenericCityObject" }}
        }},
        "vertices":{vertices}}}"#
    )
}

/// City objects without their geometry.
fn objects(file: &Value) -> Map<String, Value> {
    let mut objects = file["CityObjects"].as_object().unwrap().clone();
    objects.values_mut().for_each(|object| _ = object.as_object_mut().unwrap().remove("geometry"));
    objects
}

#[test]
fn attributes_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("a.city.json"), text()).unwrap();
    let (model, report) = import(&[at("a.city.json")], &at("a.goblin"));
    assert_eq!(report.attributes, (2, 0));
    let attributes = model.attributes();
    let house = "{\"type\":\"Building\",\"children\":[\"house-0\"],\"attributes\":{\"year\":1948,\"height\":10.10,\
                 \"none\":null,\"roof\":{\"kind\":\"flat, \\\" red\\\"\",\"slopes\":[1,[2.50,true]]},\
                 \"naïve \\\\ key\":\"\\u00e9 \\t\"}}";
    assert_eq!(attributes.part(0), Some(house));
    assert!(attributes.part(1).unwrap().contains("\"geographicalExtent\":[0.5,0,0,1,1,1]"));
    assert_eq!(attributes.part(2), None);
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);

    let summary = export(&model, &at("b.city.json"), MeshFormat::CityJson);
    assert_eq!(summary.lost_attributes, 0);
    let [first, second] = ["a.city.json", "b.city.json"].map(|name| read(&at(name)));
    assert_eq!(objects(&second), objects(&first));
    let mut metadata = first["metadata"].clone();
    metadata.as_object_mut().unwrap().remove("geographicalExtent");
    assert_eq!(second["metadata"], metadata);
    assert_eq!(second["extensions"], first["extensions"]);
    // Texts are the same to the last digit, and the model is, too.
    let (again, _) = import(&[at("b.city.json")], &at("b.goblin"));
    assert_eq!(again.attributes(), attributes);
    assert_eq!(again.metadata().frame.crs, model.metadata().frame.crs);
    // A model of models keeps them as well.
    let (again, _) = import(&[at("a.goblin")], &at("c.goblin"));
    assert_eq!(again.attributes(), attributes);

    for (format, name) in [(MeshFormat::Ply, "a.ply"), (MeshFormat::Stl, "a.stl"), (MeshFormat::Obj, "a.obj")]
    {
        assert_eq!(export(&model, &at(name), format).lost_attributes, 3);
    }
}

/// Without attributes there is nothing of them in the file.
#[test]
fn objects_of_no_type_have_none() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (geometry, vertices) = cube(0);
    let object = format!(r#""CityObjects":{{"x":{{"type":"GenericCityObject",{geometry}}}}}"#);
    let text = format!(r#"{{"type":"CityJSON","version":"2.0",{TRANSFORM},{object},"vertices":{vertices}}}"#);
    std::fs::write(at("a.city.json"), text).unwrap();
    let (model, report) = import(&[at("a.city.json")], &at("a.goblin"));
    assert_eq!(report.attributes, (0, 0));
    assert!(model.attributes().is_empty() && model.metadata().scoped_tags.is_empty());
    export(&model, &at("b.city.json"), MeshFormat::CityJson);
    let (again, _) = import(&[at("b.city.json")], &at("b.goblin"));
    assert_eq!(again.metadata().class_names, model.metadata().class_names);
    assert!(!std::fs::read_to_string(at("b.city.json")).unwrap().contains("metadata"));
}

/// Sequences, and several files: parts follow one another; what two files say of themselves is said of neither alone.
#[test]
fn sequences_and_several_files() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
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
    assert_eq!(file["metadata"], json!({ "title": "S" }));

    // (The sequence does not say where it lies: the second file is one that says nothing either.)
    std::fs::write(at("b.city.json"), text().replace("referenceSystem", "other")).unwrap();
    let (model, report) = import(&[at("s.city.jsonl"), at("b.city.json")], &at("both.goblin"));
    assert_eq!(report.attributes, (4, 0));
    let attributes = model.attributes();
    let numbers: Vec<u32> = attributes.parts().map(|(part, _)| part).collect();
    assert_eq!((numbers, attributes.files().len()), (vec![0, 1, 2, 3], 2));
    assert!(attributes.part(2).unwrap().starts_with("{\"type\":\"Building\""));
    let summary = export(&model, &at("both.city.json"), MeshFormat::CityJson);
    assert_eq!(summary.lost_attributes, 2);
    let file = read(&at("both.city.json"));
    assert_eq!(objects(&file)["t8"], tunnel(8));
    assert_eq!(objects(&file)["house"], objects(&read(&at("a.city.json")))["house"]);
    assert_eq!(file.get("metadata"), None);
}

/// Attributes that are too large are counted, in the report and in the file.
#[test]
fn too_many_attributes_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let long = format!("\"year\": \"{}\"", "x".repeat(Attributes::MOST_BYTES));
    std::fs::write(at("a.city.json"), text().replace("\"year\": 1948", &long)).unwrap();
    let (model, report) = import(&[at("a.city.json")], &at("a.goblin"));
    assert_eq!(report.attributes, (1, 1));
    assert_eq!(model.metadata().tags["model.lost_attributes"], "1");
    assert_eq!((model.attributes().part(0), model.attributes().part(1).is_some()), (None, true));
    // Long names take room of theirs.
    let name = "n".repeat(Attributes::MOST_BYTES);
    std::fs::write(at("b.city.json"), text().replace("\"thing\"", &format!("\"{name}\""))).unwrap();
    let (model, report) = import(&[at("b.city.json")], &at("b.goblin"));
    assert_eq!((report.attributes, model.parts()[2].len()), ((2, 0), name.len()));
}

#[test]
fn objects_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.city.json");
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

/// What a file says, with the faces of a tetrahedron for its own, which bound no body together.
struct Stand {
    info: ModelInfo,
}

impl Model for Stand {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let [low, high] = self.info.bounds;
        let corners = [low, [high[0], low[1], low[2]], [low[0], high[1], low[2]], [low[0], low[1], high[2]]];
        for side in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
            let points = side.map(|corner: usize| corners[corner]);
            each(&MeshFace { points: &points, ring_ends: &[3], colours: &[], part: 0 })?;
        }
        Ok(())
    }
}

/// All that real files say of their objects comes back.
#[test]
fn real_attributes_come_back() {
    let Some(data) = shared_data() else { return println!("skipped: no test data") };
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["DH_01_subs.city.json", "delft.json", "rotterdam_subset.json"] {
        let path = data.join("mesh/cityjson").join(name);
        let info = mesh::open(&path, 64 << 20).unwrap().info().clone();
        let models: Vec<Box<dyn Model>> = vec![Box::new(Stand { info })];
        let output = Output::create(&at("x.goblin")).unwrap();
        let report = import_exact(models, &ExactOptions::new(), output, &()).unwrap();
        assert!(report.attributes.0 > 0 && report.attributes.1 == 0, "{name}: {report:?}");
        let model = ExactModel::open(&at("x.goblin"), &OpenOptions::new()).unwrap();
        assert_eq!(export(&model, &at("x.city.json"), MeshFormat::CityJson).lost_attributes, 0);
        let (first, second) = (read(&path), read(&at("x.city.json")));
        assert_eq!(objects(&second), objects(&first), "{name}");
        let titles = [&first, &second].map(|file| file["metadata"].get("title").cloned());
        assert_eq!(titles[0], titles[1], "{name}");
    }
}
