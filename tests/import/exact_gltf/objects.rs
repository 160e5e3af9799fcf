//! Objects of binary glTF that is read: features, their names and attributes.

use serde_json::json;

use super::*;

/// Returns the names and attributes of all parts.
fn objects(model: &ExactModel) -> Vec<(String, Json)> {
    let about = |part: usize| {
        let text = model.part_attributes(part as u32).unwrap();
        text.map_or(Json::Null, |text| serde_json::from_str(&text).unwrap())
    };
    model.parts().iter().cloned().enumerate().map(|(part, name)| (name, about(part))).collect()
}

/// Returns the volume of each part in grid units.
fn volumes(model: &ExactModel) -> Vec<f64> {
    let mut sums = vec![0; model.parts().len()];
    model
        .each(&mut |face| {
            sums[face.part as usize] += face.six_volumes();
            Ok(())
        })
        .unwrap();
    sums.iter().map(|sum| *sum as f64 / 6.0 * model.grid().width().powi(3)).collect()
}

#[test]
fn objects_and_attributes_come_back() {
    let directory = tempfile::tempdir().unwrap();
    let attributes = [
        Some(
            r#"{"type":"Building","parents":["b"],"attributes":{"height":5.5,"type":"house","flag":true,"list":[1,{"a":null}],"id":9007199254740993}}"#,
        ),
        Some(
            r#"{"type":"Bridge","attributes":{"height":-3,"count":0,"flag":"true","name":"","text":"none"}}"#,
        ),
        Some(r#"{"attributes":{"height":1e9,"count":-2147483648,"id":7,"text":""}}"#),
    ];
    let model = described(&boxes(grid([0; 3], 0.125, 12)), &attributes);
    let path = directory.path().join("boxes.glb");
    for meshopt in [false, true] {
        exported(&model, &path, meshopt);
        let again = rebuilt(&path);
        let (found, expected) = (objects(&again), objects(&model));
        assert_eq!(found.len(), expected.len());
        for ((name, found), (expected_name, expected)) in found.iter().zip(&expected) {
            assert_eq!(name, expected_name);
            assert_eq!(
                found["attributes"].as_object().unwrap().len(),
                expected["attributes"].as_object().unwrap().len()
            );
            for (key, value) in expected["attributes"].as_object().unwrap() {
                let found = &found["attributes"][key];
                let is_same =
                    found == value || found.as_f64().is_some_and(|found| value.as_f64() == Some(found));
                assert!(is_same, "{name}, {key}: {found}, expected {value}");
            }
            for key in ["type", "parents"] {
                assert_eq!(found[key], expected[key], "{name}, {key}");
            }
        }
        for (found, expected) in volumes(&again).iter().zip(volumes(&model)) {
            assert!((found / expected - 1.0).abs() < 1e-6, "{found}, expected {expected}");
        }
        std::fs::remove_file(path.with_extension("goblin")).unwrap();
    }
}

/// Replaces the JSON of a binary glTF file that `change` changes.
fn changed(path: &Path, change: &dyn Fn(&mut Json)) -> PathBuf {
    let mut read = Read::chunks(path);
    change(&mut read.json);
    let mut text = serde_json::to_vec(&read.json).unwrap();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    let chunk = |bytes: &mut Vec<u8>, kind: &[u8], content: &[u8]| {
        bytes.extend((content.len() as u32).to_le_bytes());
        bytes.extend_from_slice(kind);
        bytes.extend_from_slice(content);
    };
    bytes.extend(2u32.to_le_bytes());
    bytes.extend((28 + text.len() as u32 + read.bin.len() as u32).to_le_bytes());
    chunk(&mut bytes, b"JSON", &text);
    chunk(&mut bytes, b"BIN\0", &read.bin);
    let path = path.with_file_name("changed.glb");
    std::fs::write(&path, bytes).unwrap();
    path
}

fn opened(path: &Path) -> Box<dyn spinney::raw::import::mesh::Model> {
    spinney::raw::import::mesh::open(path, MEMORY).unwrap()
}

#[test]
fn features_of_other_writers_are_parts() {
    let directory = tempfile::tempdir().unwrap();
    let attributes = [
        Some(r#"{"attributes":{"a":1}}"#),
        Some(r#"{"attributes":{"a":300}}"#),
        Some(r#"{"attributes":{"b":"x"}}"#),
    ];
    let model = described(&boxes(grid([0; 3], 0.125, 12)), &attributes);
    let path = directory.path().join("boxes.glb");
    exported(&model, &path, false);
    let names = |path: &Path| opened(path).info().parts.clone();
    let set = |json: &mut Json, key: &str, value: Json| {
        json["asset"]["generator"] = "another".into();
        json["meshes"][0]["primitives"][0]["extensions"]["EXT_mesh_features"]["featureIds"][0][key] = value;
    };
    // Without a table, features are numbered.
    let plain = changed(&path, &|json| {
        set(json, "propertyTable", Json::Null);
        json["nodes"][1]["name"] = "town".into();
    });
    assert_eq!(names(&plain), ["town 0", "town 1", "town 2"]);
    // As py3dtiles writes them.
    let batches = changed(&path, &|json| {
        json["asset"]["generator"] = "py3dtiles".into();
        let primitive = &mut json["meshes"][0]["primitives"][0];
        primitive["attributes"]["_BATCHID"] = primitive["attributes"]["_FEATURE_ID_0"].clone();
        primitive["extensions"] = json!({});
    });
    assert_eq!(names(&batches), ["node 1 0", "node 1 1", "node 1 2"]);
    // Vertices without a feature belong to the node.
    let null = changed(&path, &|json| set(json, "nullFeatureId", 1.into()));
    assert_eq!(names(&null), ["low", "häuser/3", "node 1"]);
    // A mesh that several nodes share has its parts several times.
    let shared = changed(&path, &|json| {
        set(json, "label", "buildings".into());
        json["nodes"][0]["children"] = json!([1, 2]);
        json["nodes"].as_array_mut().unwrap().push(json!({ "mesh": 0, "translation": [0, 0, 5000] }));
    });
    assert_eq!(names(&shared).len(), 6);
    assert_eq!(names(&shared)[3..], ["low #2", "a \"name\" #2", "häuser/3 #2"]);
    // A schema in another file.
    let external = changed(&path, &|json| {
        let root = &mut json["extensions"]["EXT_structural_metadata"];
        (root["schema"], root["schemaUri"]) = (Json::Null, "schema.json".into());
        root.as_object_mut().unwrap().remove("schema");
    });
    assert_eq!(names(&external), ["object 0", "object 1", "object 2"]);
    assert_eq!(opened(&external).remarks(), ["left out: 3 columns of property tables"]);
    // Types of properties: integers as enumeration, and scaled.
    let types = changed(&path, &|json| {
        json["asset"]["generator"] = "another".into();
        let root = &mut json["extensions"]["EXT_structural_metadata"];
        root["schema"]["enums"] = json!({ "kind": { "valueType": "INT32", "values":
            [{ "name": "one", "value": 1 }, { "name": "many", "value": 300 }] } });
        let views = root["propertyTables"][0]["properties"]["a0_a"].clone();
        let properties = &mut root["schema"]["classes"]["object"]["properties"];
        let absent = properties["a0_a"]["noData"].clone();
        properties["a0_a"] = json!({ "name": "a", "type": "ENUM", "enumType": "kind" });
        properties["double"] =
            json!({ "type": "SCALAR", "componentType": "INT32", "scale": 2, "noData": absent });
        properties["bits"] = json!({ "type": "BOOLEAN" });
        properties["pair"] = json!({ "type": "VEC2", "componentType": "INT16" });
        for name in ["double", "bits", "pair"] {
            root["propertyTables"][0]["properties"][name] = views.clone();
        }
    });
    let model = opened(&types);
    let about: Vec<Json> = (0..3)
        .map(|part| serde_json::from_str(model.info().attributes.part(part).unwrap()).unwrap())
        .collect();
    let expected = [
        json!({ "attributes": { "a": "one", "bits": true, "double": 2.0 } }),
        json!({ "attributes": { "a": "many", "bits": false, "double": 600.0 } }),
        json!({ "attributes": { "b": "x", "bits": false } }),
    ];
    assert_eq!(about, expected);
    assert_eq!(model.remarks(), ["left out: 1 column of a property table"]);
}

#[test]
fn corrupt_tables_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let model = file_of(&boxes(grid([0; 3], 0.125, 12)));
    let path = directory.path().join("boxes.glb");
    exported(&model, &path, false);
    type Change<'a> = (&'a str, &'a dyn Fn(&mut Json));
    let changes: [Change<'_>; 7] = [
        ("feature 2 of 2", &|json| json["propertyTables"][0]["count"] = 2.into()),
        ("rows", &|json| json["propertyTables"][0]["count"] = (1u64 << 62).into()),
        ("buffer view 99", &|json| json["propertyTables"][0]["properties"]["name"]["values"] = 99.into()),
        ("offset", &|json| json["propertyTables"][0]["properties"]["name"]["stringOffsets"] = 0.into()),
        ("class", &|json| json["propertyTables"][0]["class"] = "none".into()),
        ("property table 0 of 0", &|json| json["propertyTables"] = json!([])),
        ("a type of numbers", &|json| {
            json["schema"]["classes"]["object"]["properties"]["name"]["type"] = "SCALAR".into();
        }),
    ];
    for (expected, change) in changes {
        let path = changed(&path, &|json| change(&mut json["extensions"]["EXT_structural_metadata"]));
        let Err(error) = spinney::raw::import::mesh::open(&path, MEMORY) else { panic!("{expected}") };
        assert!(error.to_string().contains(expected), "{error}, expected {expected}");
    }
    // Any changed byte of the JSON is read or refused.
    let bytes = std::fs::read(&path).unwrap();
    let mut random = crate::common::Random(7);
    for _ in 0..3000 {
        let mut bytes = bytes.clone();
        let at = 20 + random.below(bytes.len() as u64 - 20) as usize;
        bytes[at] = random.below(256) as u8;
        std::fs::write(path.with_file_name("changed.glb"), &bytes).unwrap();
        if let Ok(mut model) = spinney::raw::import::mesh::open(&path.with_file_name("changed.glb"), MEMORY) {
            let _ = model.faces(&mut |_| Ok(()));
        }
    }
}

#[test]
fn both_names_of_meshopt_compression_are_read() {
    let directory = tempfile::tempdir().unwrap();
    let model = file_of(&boxes(grid([0; 3], 0.125, 12)));
    let path = directory.path().join("boxes.glb");
    exported(&model, &path, true);
    let renamed = |filter: Option<&str>| {
        changed(&path, &|json| {
            let text = json.to_string().replace("EXT_meshopt_compression", "KHR_meshopt_compression");
            *json = serde_json::from_str(&text).unwrap();
            if let Some(filter) = filter {
                json["bufferViews"][0]["extensions"]["KHR_meshopt_compression"]["filter"] = filter.into();
            }
        })
    };
    assert!((volume(&rebuilt(&renamed(None))) / volume(&model) - 1.0).abs() < 1e-6);
    let Err(error) = spinney::raw::import::mesh::open(&renamed(Some("COLOR")), MEMORY) else { panic!() };
    let error = error.to_string();
    assert!(error.contains("filter COLOR") && error.contains("EXT_meshopt_compression"), "{error}");
}

#[test]
fn surfaces_of_several_nodes_are_closed() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("torus.glb");
    // Grid units are no binary fractions, and coordinates are large.
    let grid = Grid { bits: 17, origin: [2_600_000_000, 1_200_000_000, -7], step: 1.0, divisor: 1000.0 };
    let model = file_of(&bumpy_torus(370, 200, grid));
    exported(&model, &path, false);
    assert!(Read::of(&path).origins.len() > 1);
    let again = rebuilt(&path);
    assert!((volume(&again) / volume(&model) - 1.0).abs() < 1e-6);
}

/// Values of faces are a second table; faces with different values share no vertices.
#[test]
fn values_of_faces_are_features() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let list = boxes(grid([0; 3], 0.125, 12));
    let output = Output::create(&at("model.goblin")).unwrap();
    let mut builder = ModelBuilder::new(output, list.grid().clone(), MEMORY).unwrap();
    let kind = |normal: [f64; 3]| match normal[2] {
        up if up > 0.0 => "RoofSurface",
        up if up < 0.0 => "GroundSurface",
        _ => "WallSurface",
    };
    let add = &mut |face: &spinney::brep::Face<'_>| {
        builder.push(face)?;
        if face.part == 2 {
            return Ok(());
        }
        builder.face_value("semantics", &json!({ "type": kind(face.area_vector()) }).to_string())?;
        builder.face_value("number", &face.part.to_string())
    };
    list.each(add).unwrap();
    for part in list.parts() {
        builder.part(part, None).unwrap();
    }
    builder.finish(&mut Metadata::default(), &()).unwrap();
    let model = ExactModel::open(&at("model.goblin"), &OpenOptions::new()).unwrap();
    exported(&model, &at("model.glb"), false);
    let read = Read::of(&at("model.glb"));
    let sets = &read.json["meshes"][0]["primitives"][0]["extensions"]["EXT_mesh_features"]["featureIds"];
    assert_eq!((sets[1]["featureCount"].as_u64(), sets[1]["propertyTable"].as_u64()), (Some(7), Some(1)));
    let table = read.table_of(1, "face");
    assert_eq!(read.faces.len(), 36);
    for (triangle, (rows, objects)) in read.triangles.iter().zip(read.faces.iter().zip(&read.rows)) {
        assert!(rows.iter().all(|row| *row == rows[0]));
        let [a, b, c] = *triangle;
        let [u, v] = [b, c].map(|p| [0, 1, 2].map(|axis| p[axis] - a[axis]));
        let normal = [0.0, 0.0, u[0] * v[1] - u[1] * v[0]];
        let found = (&table["semantics"][rows[0]], &table["number"][rows[0]]);
        match objects[0] {
            2 => assert_eq!(found, (&Json::Null, &Json::Null)),
            object => {
                let text = json!({ "type": kind(normal) }).to_string();
                assert_eq!(found, (&text.into(), &object.into()));
            }
        }
    }
    // A model without values has no such table.
    exported(&list, &at("list.glb"), false);
    let read = Read::of(&at("list.glb"));
    let tables = &read.json["extensions"]["EXT_structural_metadata"]["propertyTables"];
    assert!(read.faces.is_empty() && tables.as_array().unwrap().len() == 1);
}
