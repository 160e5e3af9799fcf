//! Binary glTF of exact models.

use std::collections::BTreeSet;

use serde_json::Value as Json;
use spinney::Crs;
use spinney::brep::{Faces, Grid};

use super::*;

#[test]
fn models_are_read_back_with_objects_and_colours() {
    let directory = tempfile::tempdir().unwrap();
    let model = file_of(&boxes(grid([0; 3], 0.125, 12)));
    let path = directory.path().join("boxes.glb");
    assert_eq!(exported(&model, &path, false), 36);
    let read = Read::of(&path);
    assert_eq!(read.triangles.len(), 36);
    assert!((six_volumes(&read.triangles) / 6.0 - volume(&model)).abs() < 1e-6 * volume(&model));
    let names: Vec<Json> = model.parts().iter().map(|name| name.as_str().into()).collect();
    assert_eq!(read.table()["name"], names);
    let linear = |value: u8| {
        let value = f64::from(value) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    let colours = [[255, 0, 0], [0, 128, 255], [12, 200, 34]].map(|colour| colour.map(linear));
    for ((rows, found), triangle) in read.rows.iter().zip(&read.colours).zip(&read.triangles) {
        assert!(rows.iter().all(|row| *row == rows[0]));
        assert_eq!(rows[0], (triangle[0][0] / 125.0) as usize, "{triangle:?}");
        assert!(found.iter().all(|found| distance(*found, colours[rows[0]]) < 1e-4), "{found:?}");
    }
    for meshopt in [false, true] {
        exported(&model, &path, meshopt);
        let again = rebuilt(&path);
        assert!((volume(&again) - volume(&model)).abs() < 1e-6 * volume(&model), "{meshopt}");
        let mut colours = BTreeSet::new();
        again
            .each(&mut |face| {
                colours.extend(face.colours.iter().copied());
                Ok(())
            })
            .unwrap();
        assert_eq!(colours, [[0, 128, 255], [12, 200, 34], [255, 0, 0]].into(), "{meshopt}");
        std::fs::remove_file(path.with_extension("goblin")).unwrap();
    }
}

#[test]
fn attributes_are_columns() {
    let directory = tempfile::tempdir().unwrap();
    let attributes = [
        Some(
            r#"{"type": "Building", "attributes": {"height": 5.5, "übung": 1, "roof": "flat", "list": [1, 2]}}"#,
        ),
        Some(r#"{"type": "Bridge", "attributes": {"height": -3, "übung": "two", "roof": null}}"#),
        Some(r#"{"type": "Building", "attributes": {"height": 1e9, "roof": true}}"#),
    ];
    let model = described(&boxes(grid([0; 3], 0.125, 12)), &attributes);
    let path = directory.path().join("boxes.glb");
    for meshopt in [false, true] {
        exported(&model, &path, meshopt);
        if !meshopt {
            let table = Read::of(&path).table();
            let expected = [
                ("name", serde_json::json!(model.parts())),
                ("type", serde_json::json!(["Building", "Bridge", "Building"])),
                ("height", serde_json::json!([5.5, -3.0, 1e9])),
                // Columns that are not all numbers are strings.
                ("übung", serde_json::json!(["1", "two", null])),
                ("roof", serde_json::json!(["flat", null, "true"])),
                ("list", serde_json::json!(["[1,2]", null, null])),
            ];
            assert_eq!(table.len(), expected.len(), "{table:?}");
            for (name, values) in expected {
                assert_eq!(serde_json::json!(table[name]), values, "{name}");
            }
        }
        std::fs::remove_file(&path).unwrap();
    }
    // Parts without attributes, and attributes that are not JSON objects.
    let odd = described(&boxes(grid([0; 3], 0.125, 12)), &[None, Some("[1]"), Some(r#"{"height": 2}"#)]);
    exported(&odd, &path, false);
    let table = Read::of(&path).table();
    assert_eq!(serde_json::json!(table["height"]), serde_json::json!([null, null, 2]));
}

#[test]
fn units_become_metres() {
    let directory = tempfile::tempdir().unwrap();
    let model = file_of(&boxes(grid([0; 3], 0.125, 12)));
    let path = directory.path().join("mm.glb");
    let units = [
        (Some("mm"), None, 0.001),
        (Some("m"), None, 1.0),
        (Some("ft"), None, 0.3048),
        (Some("inch"), None, 0.0254),
        (Some("mm"), Some(28992), 0.001),
        (None, None, 1.0),
        // Survey feet.
        (None, Some(2263), 1200.0 / 3937.0),
    ];
    for (unit, crs, metres) in units {
        let placed = placed(&model, directory.path(), unit, crs.map(Crs::epsg));
        exported(&placed, &path, false);
        let found = six_volumes(&Read::of(&path).triangles) / 6.0;
        let expected = volume(&model) * f64::powi(metres, 3);
        assert!((found - expected).abs() < 1e-6 * expected, "{unit:?}: {found}, expected {expected}");
        std::fs::remove_file(directory.path().join("placed.goblin")).unwrap();
    }
}

#[test]
fn distant_coordinates_keep_their_precision() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("far.glb");
    // Millimetres at 4,000 km.
    let list =
        boxes(Grid { bits: 12, origin: [4_000_000_000, 4_000_000_000, -7], step: 1.0, divisor: 1000.0 });
    let model = file_of(&list);
    for meshopt in [false, true] {
        exported(&model, &path, meshopt);
        if !meshopt {
            let read = Read::of(&path);
            assert!(read.origins[0][0] > 3e6);
            let exact: BTreeSet<[i64; 3]> = (0..list.len())
                .flat_map(|number| list.get(number as usize).points.to_vec())
                .map(|point| model.grid().to_world(point).map(|at| (at * 1000.0).round() as i64))
                .collect();
            for point in read.triangles.as_flattened() {
                let nearest = point.map(|at| (at * 1000.0).round() as i64);
                assert!(exact.contains(&nearest), "{point:?}");
                assert!((0..3).all(|axis| (point[axis] * 1000.0 - nearest[axis] as f64).abs() < 3e-3));
            }
        }
        let again = rebuilt(&path);
        assert!((volume(&again) - volume(&model)).abs() < 1e-5 * volume(&model), "{meshopt}");
        std::fs::remove_file(path.with_extension("goblin")).unwrap();
    }
}

#[test]
fn degrees_become_metres_around_the_centre() {
    let directory = tempfile::tempdir().unwrap();
    // A box of 1e-3 x 1e-3 degrees and 10 m at 7 degrees east, 46 degrees north.
    let list = geographic_box();
    for (number, unit, height) in [(4979, None, 10.0), (4326, None, 10.0), (4937, Some("mm"), 0.01)] {
        let model = placed(&file_of(&list), directory.path(), unit, Some(Crs::epsg(number)));
        let path = directory.path().join("box.glb");
        exported(&model, &path, false);
        let read = Read::of(&path);
        // Half of 77.46 m and of 111.15 m, from PROJ's geodesics on the ellipsoid.
        for point in read.triangles.as_flattened() {
            let [x, y, z] = point.map(f64::abs);
            assert!((x - 38.73).abs() < 0.01 && (y - 55.576).abs() < 0.01, "EPSG:{number}: {point:?}");
            assert!((z - height / 2.0).abs() < 2e-3, "EPSG:{number}: {point:?}");
        }
        let about = &read.json["asset"]["extras"];
        assert_eq!(about["crs"], format!("EPSG:{number}"));
        let origin = [0, 1, 2].map(|axis| about["origin"][axis].as_f64().unwrap());
        assert!(distance(origin, [7.0005, 46.0005, height / 2.0]) < 1e-4, "{origin:?}");
        std::fs::remove_file(directory.path().join("placed.goblin")).unwrap();
    }
    // NAD27's shift to WGS 84 is a grid.
    let model = placed(&file_of(&list), directory.path(), None, Some(Crs::epsg(4267)));
    let output = Output::create(&directory.path().join("nad27.glb")).unwrap();
    let error = export_model_glb(&model, &GltfOptions::new(), output, &()).unwrap_err().to_string();
    assert!(error.contains("degrees of EPSG:4267") && error.contains("crs=EPSG:4326"), "{error}");
    let output = OutputDirectory::create(&directory.path().join("nad27")).unwrap();
    let error =
        export_model_tileset(&model, &GltfOptions::new(), output, MEMORY, &()).unwrap_err().to_string();
    assert!(error.contains("degrees of EPSG:4267") && error.contains("crs=EPSG:4326"), "{error}");
}
