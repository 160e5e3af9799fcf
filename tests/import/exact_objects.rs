//! Objects of models: selected, inspected singly, left out, and measured.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use spinney::brep::Faces;
use spinney::export::{MeshFormat, VectorFormat, export_exact};
use spinney::import::feature::FeatureFilter;
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::raw::brep::{ChosenParts, ModelView};
use spinney::raw::export::vector::export_objects;
use spinney::raw::import::feature::choose_objects;
use spinney::raw::import::mesh::{ExactReport, parts_of};
use spinney::{Error, ExactModel, OpenOptions, Output};

use crate::common::exact::{Ring, cuboid, turned};
use crate::common::shared_data;

/// Writes a city of objects: name, type, attributes and faces without holes; with `parents` for
/// parts of other objects.
fn city(path: &Path, objects: &[(&str, Value, Vec<Vec<Ring>>)]) {
    let mut vertices: Vec<[i32; 3]> = Vec::new();
    let mut all = serde_json::Map::new();
    for (name, about, faces) in objects {
        let surfaces: Vec<Value> = faces
            .iter()
            .map(|rings| {
                let first = vertices.len();
                vertices.extend(&rings[0]);
                json!([(first..vertices.len()).collect::<Vec<_>>()])
            })
            .collect();
        let mut object = about.clone();
        object["geometry"] = json!([{ "type": "MultiSurface", "lod": "1", "boundaries": surfaces }]);
        all.insert((*name).into(), object);
    }
    let city = json!({
        "type": "CityJSON", "version": "2.0", "CityObjects": all, "vertices": vertices,
        "transform": { "scale": [1.0, 1.0, 1.0], "translate": [0.0, 0.0, 0.0] },
    });
    std::fs::write(path, city.to_string()).unwrap();
}

fn import(path: &Path, options: &ExactOptions) -> Result<(ExactModel, ExactReport), Error> {
    let target = path.with_extension("goblin");
    let models = open_all(&[path.to_path_buf()], 64 << 20)?;
    let report = import_exact(models, options, Output::create(&target)?, &())?;
    let model = ExactModel::open(&target, &OpenOptions::new())?;
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
    Ok((model, report))
}

/// One valid object, one open, one inside out, one that intersects itself, and two that intersect
/// each other.
fn street(directory: &Path) -> PathBuf {
    let at = |x: i32, size: i32| cuboid([x, 0, 0], [x + size, 10, 10]);
    let building = |height: i32| json!({ "type": "Building", "attributes": { "height": height } });
    let mut open = at(100, 10);
    open.pop();
    let path = directory.join("street.city.json");
    city(
        &path,
        &[
            ("right", building(10), at(0, 10)),
            ("open", building(20), open),
            ("inside-out", building(30), turned(at(200, 10))),
            ("through", building(40), [at(300, 10), at(305, 10)].concat()),
            ("left", json!({ "type": "Road" }), at(400, 10)),
            ("right-hand", json!({ "type": "Road" }), at(405, 10)),
            ("wing", json!({ "type": "BuildingPart", "parents": ["right"] }), at(50, 10)),
        ],
    );
    path
}

fn names(model: &ExactModel) -> Vec<&str> {
    model.parts().iter().map(String::as_str).collect()
}

#[test]
fn errors_name_objects() {
    let directory = tempfile::tempdir().unwrap();
    let path = street(directory.path());
    let error = import(&path, &ExactOptions::new()).err().unwrap().to_string();
    assert!(error.contains("of open") && error.contains("--skip-bad"), "{error}");
    let mut options = ExactOptions::new();
    options.parts = Some(BTreeSet::from([0, 4, 5]));
    let error = import(&path, &options).err().unwrap().to_string();
    assert!(error.contains("of left and right-hand"), "{error}");
    assert!(!path.with_extension("goblin").exists());
}

#[test]
fn objects_that_are_no_bodies_are_left_out() {
    let directory = tempfile::tempdir().unwrap();
    let path = street(directory.path());
    let mut options = ExactOptions::new();
    options.skip_bad = true;
    options.parts = Some(BTreeSet::from([0, 1, 2, 3, 4, 6]));
    let left_out = |report: &ExactReport| -> Vec<String> {
        report.skipped.iter().map(|object| format!("{}: {}", object.name, object.why)).collect()
    };
    let (model, report) = import(&path, &options).unwrap();
    assert_eq!(names(&model), ["right", "left", "wing"]);
    let lines = left_out(&report);
    assert!(lines[0].starts_with("open: open: 4 edges have a face on one side only, at "), "{lines:?}");
    assert!(lines[1].starts_with("inside-out: winding number -1, expected 0 or 1, at "), "{lines:?}");
    assert!(lines[2].starts_with("through: ") && lines.len() == 3, "{lines:?}");
    // Repairable or closable objects are not bad; intersecting objects become one solid.
    options.parts = None;
    options.repair = true;
    let (model, report) = import(&path, &options).unwrap();
    assert_eq!(names(&model), ["right", "inside-out", "through", "left", "right-hand", "wing"]);
    assert_eq!(left_out(&report).len(), 1);
    let volume = |model: &ExactModel| -> f64 {
        let parts = model.part_measures(1 << 20, &()).unwrap();
        parts.iter().map(|part| part.measures.volume).sum()
    };
    assert_eq!(volume(&model), 1000.0 + 1000.0 + 1500.0 + 1500.0 + 1000.0);
    options.close = true;
    let (model, report) = import(&path, &options).unwrap();
    assert_eq!((volume(&model), left_out(&report).len(), report.objects), (7000.0, 0, 7));
    // None remains.
    options = ExactOptions::new();
    options.skip_bad = true;
    options.parts = Some(BTreeSet::from([1, 2]));
    let error = import(&path, &options).err().unwrap();
    assert!(
        matches!(&error, Error::NotASolid { what, locations, .. } if what.contains("none") && locations.len() == 2),
        "{error}"
    );
    // Only options that are not set are advised.
    assert!(error.to_string().contains("`--close --repair`"), "{error}");
    options.close = true;
    options.parts = Some(BTreeSet::from([2]));
    let error = import(&path, &options).err().unwrap().to_string();
    assert!(error.contains("--repair, or build cells") && !error.contains("--close"), "{error}");
    // (Without any closed object, none would remain.)
    options = ExactOptions::new();
    options.parts = Some(BTreeSet::from([1]));
    let error = import(&path, &options).err().unwrap().to_string();
    assert!(error.contains("--close") && !error.contains("--skip-bad"), "{error}");
}

#[test]
fn objects_are_chosen_with_their_parts() {
    let directory = tempfile::tempdir().unwrap();
    let path = street(directory.path());
    let models = open_all(&[path], 64 << 20).unwrap();
    let (names, about) = parts_of(&models);
    for (filter, expected) in [
        ("type=Building", vec![0, 1, 2, 3, 6]),
        ("type=BuildingPart", vec![6]),
        ("type=Building,height>15", vec![1, 2, 3]),
        ("id=right", vec![0, 6]),
        ("height<=10", vec![0, 6]),
        ("type=Bridge", vec![]),
    ] {
        let filter: FeatureFilter = filter.parse().unwrap();
        let found = choose_objects(&filter, &names, &|part| Ok(about[part as usize].clone())).unwrap();
        assert_eq!(found.into_iter().collect::<Vec<_>>(), expected, "{filter}");
    }
}

/// Each object has its own volume, area, box and closedness.
#[test]
fn objects_are_measured_one_by_one() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.city.json");
    let hollow = [cuboid([0; 3], [10; 3]), turned(cuboid([2; 3], [5; 3]))].concat();
    // Two halves of a box, both open.
    let mut front = cuboid([20, 0, 0], [30, 10, 10]);
    let back = front.split_off(3);
    let kind = json!({ "type": "Building", "attributes": { "storeys": 3, "name": "a, \"b\"" } });
    city(&path, &[("hollow", kind, hollow), ("front", json!({}), front), ("back", json!({}), back)]);
    let (model, _) = import(&path, &ExactOptions::new()).unwrap();
    let parts = model.part_measures(1 << 20, &()).unwrap();
    let measured: Vec<(u32, bool, u64)> =
        parts.iter().map(|part| (part.part, part.is_closed, part.measures.faces)).collect();
    assert_eq!(measured, [(0, true, 12), (1, false, 3), (2, false, 3)]);
    assert_eq!(parts[0].measures.volume, 1000.0 - 27.0);
    assert_eq!(parts[0].measures.area, 600.0 + 54.0);
    assert_eq!(parts[0].measures.bounds, Some([[0.0; 3], [10.0; 3]]));
    assert!(matches!(model.part_measures(2 << 10, &()), Err(Error::TooLarge { .. })));
    let view = ModelView::from(model);
    let table = directory.path().join("t.csv");
    let output = Output::create(&table).unwrap();
    assert_eq!(export_objects(&view, None, output, VectorFormat::Csv, 1 << 20, &()).unwrap(), 3);
    let text = std::fs::read_to_string(&table).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0].trim_end(), "WKT,id,type,closed,faces,volume,area,zmin,zmax,x,y,z,name,storeys");
    assert!(
        lines[1].contains("hollow,Building,true,12,973,654,0,10,")
            && lines[1].contains(",\"a, \"\"b\"\"\",3"),
        "{text}"
    );
    assert!(lines[2].contains(",front,,false,3,,300,"), "{text}");
    let some = BTreeSet::from([2]);
    let output = Output::create(&table).unwrap();
    assert_eq!(export_objects(&view, Some(&some), output, VectorFormat::Csv, 1 << 20, &()).unwrap(), 1);
}

/// Selected objects are exported unchanged, with their attributes.
#[test]
fn some_objects_are_exported() {
    let directory = tempfile::tempdir().unwrap();
    let path = street(directory.path());
    let mut options = ExactOptions::new();
    (options.skip_bad, options.repair, options.close) = (true, true, true);
    let (model, _) = import(&path, &options).unwrap();
    let filter: FeatureFilter = "type=Building,height>=20".parse().unwrap();
    let chosen = choose_objects(&filter, model.parts(), &|part| model.part_attributes(part)).unwrap();
    let some = ChosenParts::of(&model, &chosen).unwrap();
    let mesh = directory.path().join("some.city.json");
    export_exact(&some, MeshFormat::CityJson, Output::create(&mesh).unwrap(), &()).unwrap();
    let (again, report) = import(&mesh, &ExactOptions::new()).unwrap();
    assert_eq!((names(&again), report.objects), (vec!["open", "inside-out", "through"], 3));
    let attributes = again.part_attributes(1).unwrap().unwrap();
    assert!(attributes.contains("\"height\":30") && attributes.contains("\"Building\""), "{attributes}");
    let volumes: Vec<f64> =
        again.part_measures(1 << 20, &()).unwrap().iter().map(|part| part.measures.volume).collect();
    assert_eq!(volumes, [1000.0, 1000.0, 1500.0]);
    assert!(ChosenParts::of(&model, &BTreeSet::from([99])).is_err());
}

/// All buildings of Delft become separate solids, whose volumes add up to that of the model.
#[test]
fn a_city_becomes_a_model() {
    let Some(directory) = shared_data() else { return };
    let path = directory.join("mesh/cityjson/delft.json");
    let there = tempfile::tempdir().unwrap();
    let target = there.path().join("delft.goblin");
    let models = open_all(&[path], 64 << 20).unwrap();
    let (names, about) = parts_of(&models);
    let filter: FeatureFilter = "type=Building".parse().unwrap();
    let mut options = ExactOptions::new();
    (options.close, options.skip_bad) = (true, true);
    options.parts = Some(choose_objects(&filter, &names, &|part| Ok(about[part as usize].clone())).unwrap());
    let report = import_exact(models, &options, Output::create(&target).unwrap(), &()).unwrap();
    assert_eq!((report.objects, report.skipped.len()), (160, 0));
    let model = ExactModel::open(&target, &OpenOptions::new()).unwrap();
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
    let parts = model.part_measures(1 << 20, &()).unwrap();
    assert!(parts.len() == 160 && parts.iter().all(|part| part.is_closed && part.measures.volume > 0.0));
    let sum: f64 = parts.iter().map(|part| part.measures.volume).sum();
    assert!((sum - 33_060.361_163_315).abs() < 1e-6, "{sum}");
}
