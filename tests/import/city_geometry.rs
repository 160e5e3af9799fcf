//! CityJSON read and written again: shells and solids, levels of detail, addresses, extents and
//! units.

use std::path::Path;

use serde_json::{Value, json};
use spinney::brep::{Faces, MassProperties, Motion, TransformOptions, transform};
use spinney::export::{MeshFormat, export_exact};
use spinney::import::mesh::{ExactOptions, import_exact, open_all};
use spinney::{Error, ExactModel, Output, Result};

use crate::common::reported_models;

const MEMORY: u64 = 64 << 20;

fn import(path: &Path, out: &Path) -> Result<ExactModel> {
    let models = open_all(&[path.to_path_buf()], MEMORY)?;
    import_exact(models, &ExactOptions::new(), Output::create(out)?, &())?;
    ExactModel::open(out, &Default::default())
}

/// Imports a CityJSON file as a model.
fn model_of(file: &Value, directory: &Path) -> Result<ExactModel> {
    let path = directory.join("a.city.json");
    std::fs::write(&path, file.to_string()).unwrap();
    import(&path, &directory.join("a.goblin"))
}

/// Exports a model to CityJSON.
fn written(model: &ExactModel, directory: &Path) -> Value {
    let path = directory.join("b.city.json");
    export_exact(model, MeshFormat::CityJson, Output::create(&path).unwrap(), &()).unwrap();
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn identity() -> Motion {
    Motion::from_rows([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]).unwrap()
}

/// Returns the six sides of a box over eight consecutive vertices.
fn sides(first: usize, is_cavity: bool) -> Value {
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let sides = sides.map(|mut side: [usize; 4]| {
        if is_cavity {
            side.reverse();
        }
        [side.map(|corner| corner + first)]
    });
    json!(sides)
}

/// Returns the corners of a cube.
fn corners(low: i64, high: i64) -> Vec<[i64; 3]> {
    (0..8).map(|corner| [0, 1, 2].map(|axis| if corner >> axis & 1 == 0 { low } else { high })).collect()
}

fn file(objects: Value, vertices: Vec<[i64; 3]>, epsg: u32) -> Value {
    json!({
        "type": "CityJSON", "version": "2.0",
        "transform": { "scale": [0.001, 0.001, 0.001], "translate": [85000, 446000, 0] },
        "metadata": { "referenceSystem": format!("https://www.opengis.net/def/crs/EPSG/0/{epsg}") },
        "CityObjects": objects, "vertices": vertices
    })
}

/// Replaces vertex numbers in a geometry's nested lists by coordinates.
fn placed(list: &Value, file: &Value) -> Value {
    match list {
        Value::Array(list) => list.iter().map(|inner| placed(inner, file)).collect(),
        number => {
            let vertex = &file["vertices"][number.as_u64().unwrap() as usize];
            let coordinate = |axis: usize| {
                let at = vertex[axis].as_f64().unwrap() * file["transform"]["scale"][axis].as_f64().unwrap();
                at + file["transform"]["translate"][axis].as_f64().unwrap()
            };
            json!([0, 1, 2].map(|axis| (coordinate(axis) * 1e6).round() / 1e6))
        }
    }
}

/// Returns the bounds along x of each shell of each solid.
fn shells(solids: &Value, file: &Value) -> Vec<Vec<[f64; 2]>> {
    let span = |shell: &Value| {
        let mut span = [f64::INFINITY, f64::NEG_INFINITY];
        for point in
            placed(shell, file).as_array().unwrap().iter().flat_map(|face| face[0].as_array().unwrap())
        {
            let x = point[0].as_f64().unwrap();
            span = [span[0].min(x), span[1].max(x)];
        }
        span
    };
    solids
        .as_array()
        .unwrap()
        .iter()
        .map(|solid| solid.as_array().unwrap().iter().map(span).collect())
        .collect()
}

#[test]
fn cavities_and_bodies_are_shells_and_solids_of_their_own() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let semantics = |values: Value| json!({ "surfaces": [{ "type": "WallSurface" }, { "type": "RoofSurface" }], "values": values });
    let solid = json!({ "type": "Solid", "lod": "2.2", "boundaries": [sides(0, false), sides(8, true)],
        "semantics": semantics(json!([[0, 0, 0, 0, 0, 1], [0, null, 0, 0, 0, 0]])) });
    let several = json!({ "type": "MultiSolid", "lod": 1.3, "boundaries": [[sides(16, false)], [sides(24, false), sides(32, true)]] });
    let objects = json!({
        "cavity": { "type": "Building", "geometry": [solid] },
        "several": { "type": "GenericCityObject", "geometry": [several] },
        "plain": { "type": "Building", "geometry": [{ "type": "Solid", "lod": "2", "boundaries": [sides(40, false)] }] },
    });
    let vertices = [
        corners(0, 9000),
        corners(2000, 4000),
        corners(20000, 24000),
        corners(40000, 49000),
        corners(42000, 44000),
        corners(60000, 64000),
    ]
    .concat();
    let model = model_of(&file(objects, vertices, 7415), directory).unwrap();
    let found = written(&model, directory);
    let geometry = |name: &str| found["CityObjects"][name]["geometry"][0].clone();
    let kind = |name: &str| {
        assert_eq!(found["CityObjects"][name].get("lod"), None);
        (geometry(name)["type"].clone(), geometry(name)["lod"].clone())
    };
    assert_eq!(kind("cavity"), (json!("Solid"), json!("2.2")));
    assert_eq!(kind("several"), (json!("MultiSolid"), json!("1.3")));
    assert_eq!(kind("plain"), (json!("Solid"), json!("2")));
    let x = |list: &[[f64; 2]]| list.iter().map(|span| span.map(|x| x + 85000.0)).collect::<Vec<_>>();
    let hollow = x(&[[0.0, 9.0], [2.0, 4.0]]);
    assert_eq!(shells(&json!([geometry("cavity")["boundaries"]]), &found), std::slice::from_ref(&hollow));
    let mut solids = shells(&geometry("several")["boundaries"], &found);
    solids.sort_by(|a, b| a[0][0].total_cmp(&b[0][0]));
    assert_eq!(solids, [x(&[[20.0, 24.0]]), x(&[[40.0, 49.0], [42.0, 44.0]])]);
    // Semantics are nested like the shells.
    let semantics = geometry("cavity")["semantics"].clone();
    let types: Vec<Vec<Option<&str>>> = semantics["values"]
        .as_array()
        .unwrap()
        .iter()
        .map(|shell| {
            shell
                .as_array()
                .unwrap()
                .iter()
                .map(|number| {
                    number.as_u64().and_then(|number| semantics["surfaces"][number as usize]["type"].as_str())
                })
                .collect()
        })
        .collect();
    let count = |shell: usize, kind: Option<&str>| types[shell].iter().filter(|own| **own == kind).count();
    assert_eq!((count(0, Some("WallSurface")), count(0, Some("RoofSurface")), count(0, None)), (5, 1, 0));
    assert_eq!((count(1, Some("WallSurface")), count(1, Some("RoofSurface")), count(1, None)), (5, 0, 1));
    // Importing the exported file gives the same model.
    let again = import(&directory.join("b.city.json"), &directory.join("b.goblin")).unwrap();
    let volume = |model: &ExactModel| MassProperties::of(model, &()).unwrap().volume;
    assert_eq!(volume(&again), volume(&model));
    let about =
        |model: &ExactModel| (0..3).map(|part| model.part_attributes(part).unwrap()).collect::<Vec<_>>();
    assert_eq!(about(&again), about(&model));
    assert_eq!(written(&again, directory)["CityObjects"], found["CityObjects"]);
}

#[test]
fn addresses_and_extents_follow_the_model() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let geometry = json!([{ "type": "Solid", "lod": "2", "boundaries": [sides(3, false)] }]);
    let address = json!([{ "Country": "NL", "location": { "type": "MultiPoint", "lod": "1", "boundaries": [0, 2] } }, { "a": 1.5 }]);
    let objects = json!({
        "part": { "type": "BuildingPart", "parents": ["whole"], "address": address, "geometry": geometry,
            "geographicalExtent": [85000, 446000, 0, 85004, 446004, 4] },
        "whole": { "type": "Building", "children": ["part"], "geographicalExtent": [85000, 446000, 0, 85004, 446004, 4] },
        "none": { "type": "Road", "geographicalExtent": [0, 0, 0, 1, 1, 1] },
    });
    let vertices = [vec![[1000, 1000, 9000], [0; 3], [2000, -3000, 500]], corners(0, 4000)].concat();
    let original = file(objects, vertices, 7415);
    let model = model_of(&original, directory).unwrap();
    let found = written(&model, directory);
    let points =
        |file: &Value| placed(&file["CityObjects"]["part"]["address"][0]["location"]["boundaries"], file);
    let positions = json!([[85001.0, 446001.0, 9.0], [85002.0, 445997.0, 0.5]]);
    assert_eq!((points(&original), points(&found)), (positions.clone(), positions));
    assert_eq!(found["vertices"].as_array().unwrap().len(), 10);
    let extents = |file: &Value| {
        ["part", "whole", "none"].map(|name| file["CityObjects"][name]["geographicalExtent"].clone())
    };
    let extent = json!([85000, 446000, 0, 85004, 446004, 4]);
    assert_eq!(
        found["metadata"]["geographicalExtent"],
        json!([85000.0, 446000.0, 0.0, 85004.0, 446004.0, 4.0])
    );
    assert_eq!(extents(&found), [extent.clone(), extent, Value::Null]);
    assert_eq!(found["CityObjects"]["part"]["address"][1], json!({ "a": 1.5 }));

    // Scaled by half around the origin, and moved 10 to the east.
    let (motion, moved) = (
        Motion::from_rows([[0.5, 0.0, 0.0, 10.0], [0.0, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.0]]).unwrap(),
        directory.join("m.goblin"),
    );
    transform(&model, &motion, &TransformOptions::new(MEMORY), Output::create(&moved).unwrap(), &()).unwrap();
    let model = ExactModel::open(&moved, &Default::default()).unwrap();
    assert!(
        model.part_attributes(0).unwrap().unwrap().contains("[42510.0,223000.0,0.0,42512.0,223002.0,2.0]")
    );
    let found = written(&model, directory);
    assert_eq!(points(&found), json!([[42510.5, 223000.5, 4.5], [42511.0, 222998.5, 0.25]]));
    let extent = json!([42510.0, 223000.0, 0.0, 42512.0, 223002.0, 2.0]);
    assert_eq!(found["metadata"]["geographicalExtent"], extent);
    assert_eq!(extents(&found), [extent.clone(), extent, Value::Null]);

    // Vertex numbers out of range.
    let text = original.to_string().replace("\"boundaries\":[0,2]", "\"boundaries\":[0,11]");
    let error = model_of(&serde_json::from_str(&text).unwrap(), directory).err().unwrap().to_string();
    assert!(error.contains("vertex 11 of 11"), "{error}");
}

#[test]
fn objects_of_templates_keep_their_level_of_detail() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let instance = |template: usize, x: u32| {
        json!({ "type": "GeometryInstance", "template": template, "boundaries": [0],
            "transformationMatrix": [1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] })
    };
    let solid =
        |lod: &str, first: usize| json!({ "type": "Solid", "lod": lod, "boundaries": [sides(first, false)] });
    let objects = json!({
        "of templates": { "type": "PlantCover", "geometry": [instance(0, 0), instance(1, 0)] },
        "of both": { "type": "PlantCover", "geometry": [solid("1.2", 0), instance(1, 10)] },
        "own": { "type": "PlantCover", "geometry": [instance(0, 20), solid("2.2", 8)] },
        "of points": { "type": "PlantCover", "geometry": [solid("1.2", 16), instance(2, 30)] },
    });
    let vertices = [corners(0, 4000), corners(40_000, 44_000), corners(60_000, 64_000)].concat();
    let mut original = file(objects, vertices, 7415);
    let points = json!({ "type": "MultiPoint", "lod": "3", "boundaries": [0] });
    original["geometry-templates"] = json!({ "templates": [solid("1.1", 0), solid("1.3", 0), points], "vertices-templates": corners(0, 3) });
    let found = written(&model_of(&original, directory).unwrap(), directory);
    let lod = |name: &str| found["CityObjects"][name]["geometry"][0]["lod"].as_str().unwrap().to_string();
    assert_eq!(["of templates", "of both", "own", "of points"].map(lod), ["1.3", "1.3", "2.2", "1.2"]);
}

#[test]
fn feet_are_converted_and_degrees_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let objects = json!({ "a": { "type": "Building", "geometry": [{ "type": "Solid", "lod": "2", "boundaries": [sides(0, false)] }] } });
    let of = |epsg: u32| model_of(&file(objects.clone(), corners(0, 10000), epsg), directory);
    for (epsg, unit) in [(7415, "m"), (2263, "us-ft"), (2222, "ft")] {
        let model = of(epsg).unwrap();
        assert_eq!(model.unit(), Some(unit), "{epsg}");
        // In the unit of the coordinate system, as before.
        let found = written(&model, directory);
        assert_eq!(
            placed(&json!([7, 0]), &found),
            json!([[85010.0, 446010.0, 10.0], [85000.0, 446000.0, 0.0]])
        );
    }
    let error = of(4326).err().unwrap();
    assert!(matches!(&error, Error::Unsupported { .. }) && error.to_string().contains("degrees"), "{error}");
    // Models in other units are converted to the unit of the system, or metres.
    let mut model = of(2263).unwrap();
    for (unit, crs, factor) in
        [("ft", Some(2263), 0.999_998), ("mm", Some(7415), 0.001), ("in", None, 0.0254)]
    {
        let path = directory.join("u.goblin");
        let mut options = TransformOptions::new(MEMORY);
        (options.unit, options.crs) = (Some(unit.into()), crs.map(spinney::Crs::epsg));
        if crs.is_none() {
            std::fs::write(
                directory.join("a.obj"),
                "v 0 0 0\nv 8 0 0\nv 0 8 0\nv 0 0 8\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n",
            )
            .unwrap();
            model = import(&directory.join("a.obj"), &directory.join("o.goblin")).unwrap();
        }
        transform(&model, &identity(), &options, Output::create(&path).unwrap(), &()).unwrap();
        let moved = ExactModel::open(&path, &Default::default()).unwrap();
        let found = written(&moved, directory);
        let (width, scale) = (moved.grid().width(), found["transform"]["scale"][0].as_f64().unwrap());
        assert!((scale / width / factor - 1.0).abs() < 1e-9, "{unit}: {scale} / {width}");
    }
    let mut options = TransformOptions::new(MEMORY);
    options.crs = Some(spinney::Crs::epsg(4979));
    transform(&model, &identity(), &options, Output::create(&directory.join("d.goblin")).unwrap(), &())
        .unwrap();
    let model = ExactModel::open(&directory.join("d.goblin"), &Default::default()).unwrap();
    let path = directory.join("d.city.json");
    let error = export_exact(&model, MeshFormat::CityJson, Output::create(&path).unwrap(), &()).unwrap_err();
    assert!(error.to_string().contains("degrees") && !path.exists(), "{error}");
}

#[test]
fn files_of_bug_reports_round_trip() {
    let Some(directory) = reported_models() else { return };
    let out = tempfile::tempdir().unwrap();
    let round = |name: &str| {
        let model = import(&directory.join(name), &out.path().join("a.goblin")).unwrap();
        (MassProperties::of(&model, &()).unwrap().volume, written(&model, out.path()))
    };
    let (volume, cavity) = round("cjr_cavity.city.json");
    let geometry = &cavity["CityObjects"]["a"]["geometry"][0];
    assert_eq!((volume, &geometry["type"], &geometry["lod"]), (56.0, &json!("Solid"), &json!("2.2")));
    assert_eq!(shells(&json!([geometry["boundaries"]]), &cavity), [[[85000.0, 85004.0], [85001.0, 85003.0]]]);
    let (volume, two) = round("cjr_two.city.json");
    let geometry = &two["CityObjects"]["a"]["geometry"][0];
    assert_eq!((volume, &geometry["type"]), (128.0, &json!("MultiSolid")));
    assert_eq!(shells(&geometry["boundaries"], &two), [[[85000.0, 85004.0]], [[85010.0, 85014.0]]]);
    let (_, address) = round("cj_addr.city.json");
    let numbers = &address["CityObjects"]["a"]["address"][0]["location"]["boundaries"];
    assert_eq!(placed(numbers, &address), json!([[85001.0, 446001.0, 9.0]]));
    assert_eq!(
        import(&directory.join("cj_unit.city.json"), &out.path().join("a.goblin")).unwrap().unit(),
        Some("us-ft")
    );
    // Text meshes of other programs, each with one box.
    let faces = |name: &str| {
        let mut model = open_all(&[directory.join(name)], MEMORY).unwrap().remove(0);
        let (mut faces, mut colours) = (0, Vec::<[u8; 3]>::new());
        model
            .faces(&mut |face| {
                faces += 1;
                colours.extend(face.colours);
                Ok(())
            })
            .unwrap();
        (faces, colours, model.remarks())
    };
    for name in [
        "off_counts_split.off",
        "off_face_split.off",
        "stl_end_loop.stl",
        "stl_end_solid.stl",
        "ply_nan_normal.ply",
    ] {
        assert_eq!(faces(name), (12, vec![], vec![]), "{name}");
    }
    assert_eq!(faces("stl_cat.stl"), (24, vec![], vec![]));
    let (count, _, remarks) = faces("stl_bin_count_less.stl");
    assert!(count == 6 && remarks[0].contains("6 facets"), "{remarks:?}");
    let (_, colours, _) = faces("coff_mixed.off");
    assert_eq!((colours.len(), colours.iter().filter(|colour| **colour == [255; 3]).count()), (36, 18));
}
