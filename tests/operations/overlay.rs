//! Set operations on polygon files: results of real and difficult pairs, attributes, coordinate
//! systems, and rejected inputs.

use std::path::{Path, PathBuf};

use spinney::export::VectorFormat;
use spinney::import::feature::FeatureOptions;
use spinney::raw::import::feature::{FeatureAttribute, PolygonLayer, read_polygons};
use spinney::raw::overlay::{OverlayOperation, OverlayReport, OverlayRequest, overlay_features};
use spinney::{Error, Output, Result};

fn read(path: &Path) -> PolygonLayer {
    read_polygons(path, &FeatureOptions::default()).unwrap()
}

fn made(paths: &[PathBuf], request: &OverlayRequest, output: &Path) -> Result<OverlayReport> {
    let layers = paths.iter().map(|path| (path.clone(), read(path))).collect();
    overlay_features(layers, request, Output::create(output)?, VectorFormat::of(output).unwrap(), &())
}

fn request(name: &str) -> OverlayRequest {
    OverlayRequest::new(OverlayOperation::named(name).unwrap())
}

fn collection(crs: Option<u32>, features: &[(&str, &str)]) -> String {
    let crs = crs.map_or(String::new(), |number| {
        format!(r#""crs":{{"type":"name","properties":{{"name":"EPSG:{number}"}}}},"#)
    });
    let feature = |(properties, rings): &(&str, &str)| {
        format!(
            r#"{{"type":"Feature","properties":{properties},"geometry":{{"type":"Polygon","coordinates":{rings}}}}}"#
        )
    };
    let features: Vec<String> = features.iter().map(feature).collect();
    format!(r#"{{"type":"FeatureCollection",{crs}"features":[{}]}}"#, features.join(","))
}

/// Returns the area of all polygons: outer rings minus holes, whatever their orientation.
fn area(layer: &PolygonLayer) -> f64 {
    let ring = |ring: &Vec<[f64; 2]>| {
        let next = ring.iter().cycle().skip(1);
        ring.iter().zip(next).map(|([x, y], [a, b])| (x * b - a * y) / 2.0).sum::<f64>().abs()
    };
    let polygon = |rings: &Vec<Vec<[f64; 2]>>| 2.0 * ring(&rings[0]) - rings.iter().map(ring).sum::<f64>();
    layer.clone().into_parts().iter().map(polygon).sum()
}

/// The pairs of rust-geo-booleanop: areas of its expected results.
#[test]
fn difficult_pairs_have_the_expected_areas() {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/poly2d/booleanop");
    let Ok(entries) = std::fs::read_dir(&directory) else {
        eprintln!("skipped: {} is not there", directory.display());
        return;
    };
    let scratch = tempfile::tempdir().unwrap();
    let mut count = 0;
    for entry in entries {
        let path = entry.unwrap().path();
        let Ok(all) = serde_json::from_slice::<serde_json::Value>(&std::fs::read(&path).unwrap()) else {
            continue;
        };
        let Some(features) = all["features"].as_array() else { continue };
        let written = |name: &str, feature: &serde_json::Value| {
            let path = scratch.path().join(name);
            let mut feature = feature.clone();
            feature["crs"] = serde_json::Value::Null;
            std::fs::write(&path, feature.to_string()).unwrap();
            path
        };
        let pair = [written("a.geojson", &features[0]), written("b.geojson", &features[1])];
        for wanted in &features[2..] {
            let properties = &wanted["properties"];
            // Skips results documented as wrong, and self-intersecting rings, nested shells and
            // holes outside of their shells, which it treats differently.
            let name = path.to_string_lossy();
            let is_other =
                ["selfintersecting", "issue71", "issue96"].iter().any(|other| name.contains(other));
            if !properties["comment"].is_null() || is_other {
                continue;
            }
            let name = match properties["operation"].as_str().unwrap() {
                "intersection" => "and",
                "diff" => "a-b",
                "diff_ba" => "b-a",
                other => other,
            };
            // Some results are not specified.
            if wanted["geometry"]["coordinates"].as_array().is_none_or(|own| own.is_empty()) {
                continue;
            }
            let output = scratch.path().join("c.geojson");
            let report = made(&pair, &request(name), &output).unwrap();
            let expected = area(&read(&written("wanted.geojson", wanted)));
            let off = (report.area - expected).abs();
            let scale = expected.abs().max(1.0) * 1e-6;
            assert!(
                off <= report.summary.area_bound + scale,
                "{}: {name}: {report:?} {expected}",
                path.display()
            );
            if report.parts > 0 {
                assert!((area(&read(&output)) - report.area).abs() <= scale);
            }
            count += 1;
        }
    }
    assert!(count > 50);
}

#[test]
fn parts_have_the_attributes_of_all_they_are_in() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let soils = collection(
        Some(25832),
        &[
            (r#"{"soil":"clay","name":"A"}"#, "[[[0,0],[4,0],[4,4],[0,4],[0,0]]]"),
            (r#"{"soil":"sand","name":"B"}"#, "[[[3,0],[8,0],[8,4],[3,4],[3,0]]]"),
        ],
    );
    let parcels =
        collection(Some(25832), &[(r#"{"owner":7,"name":"P"}"#, "[[[2,1],[6,1],[6,3],[2,3],[2,1]]]")]);
    std::fs::write(path("a.geojson"), soils).unwrap();
    std::fs::write(path("b.geojson"), parcels).unwrap();
    let pair = [path("a.geojson"), path("b.geojson")];
    for ending in ["geojson", "gpkg", "fgb", "csv", "shp"] {
        let output = path(&format!("c.{ending}"));
        let report = made(&pair, &request("and"), &output).unwrap();
        assert_eq!((report.parts, report.area), (2, 8.0));
        // Both soils exist in a strip, where the last one counts.
        assert_eq!(report.shared, 1);
        let layer = read(&output);
        let names: Vec<&str> = layer.attributes.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["soil", "name_1", "owner", "name_2"], "{ending}");
        let mut soils: Vec<_> = layer
            .features
            .iter()
            .map(|own| (own.attributes[0].to_text(), own.attributes[2].to_text()))
            .collect();
        soils.sort();
        let seven = || "7".to_string();
        assert_eq!(soils, [("clay".into(), seven()), ("sand".into(), seven())], "{ending}");
    }
    let output = path("parts.geojson");
    let report = made(&pair, &request("partition"), &output).unwrap();
    assert_eq!((report.parts, report.area), (6, 32.0));
    let layer = read(&output);
    let sources: Vec<_> =
        layer.features.iter().map(|own| [4, 5].map(|place| own.attributes[place].to_text())).collect();
    for wanted in [["1", ""], ["1,2", ""], ["2", ""], ["1", "1"], ["1,2", "1"], ["2", "1"]] {
        assert!(sources.contains(&wanted.map(String::from)), "{sources:?}");
    }
    assert_eq!(layer.crs.as_ref().and_then(|crs| crs.numbers()).map(|epsg| epsg.horizontal), Some(25832));
}

/// All sixteen operations by their numbers: which of four regions of a box they select.
#[test]
fn operations_are_sums_of_parts() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    std::fs::write(path("a.geojson"), collection(None, &[("{}", "[[[0,0],[4,0],[4,4],[0,4],[0,0]]]")]))
        .unwrap();
    std::fs::write(path("b.geojson"), collection(None, &[("{}", "[[[1,1],[7,1],[7,3],[1,3],[1,1]]]")]))
        .unwrap();
    let pair = [path("a.geojson"), path("b.geojson")];
    let areas = [6.0, 10.0, 6.0, 100.0 - 22.0];
    for number in 0..16u8 {
        let mut request = request(&number.to_string());
        let output = path("c.geojson");
        if number >= 8 {
            let error = made(&pair, &request, &output).unwrap_err();
            assert!(matches!(&error, Error::Invalid { what, .. } if what.contains("region")), "{error}");
            assert!(!output.exists());
        }
        request.within_box([-1.0, -1.0], [9.0, 9.0]);
        let report = made(&pair, &request, &output).unwrap();
        let wanted: f64 = (0..4).filter(|bit| number >> bit & 1 == 1).map(|bit| areas[bit]).sum();
        assert_eq!(report.area, wanted, "operation {number}");
        std::fs::remove_file(&output).unwrap();
    }
    // Any number of files.
    let three = [path("a.geojson"), path("b.geojson"), path("a.geojson")];
    for (name, wanted) in [("and", 6.0), ("union", 22.0), ("xor", 6.0 + 6.0), ("a-b", 0.0)] {
        assert_eq!(made(&three, &request(name), &path("d.geojson")).unwrap().area, wanted, "{name}");
    }
    assert!(made(&three, &request("b-a"), &path("d.geojson")).is_err());
}

#[test]
fn the_second_file_is_brought_to_the_first_ones_system() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let degrees = "[[[9,47],[9.001,47],[9.001,47.001],[9,47.001],[9,47]]]";
    std::fs::write(path("b.geojson"), collection(None, &[("{}", degrees)])).unwrap();
    let metres = "[[[400000,5100000],[600000,5100000],[600000,5300000],[400000,5300000],[400000,5100000]]]";
    std::fs::write(path("a.geojson"), collection(Some(25832), &[("{}", metres)])).unwrap();
    let pair = [path("a.geojson"), path("b.geojson")];
    let report = made(&pair, &request("and"), &path("c.gpkg")).unwrap();
    // About 76 by 111 metres, whose sides shrink by 0.0004.
    assert!((report.area - 76.06 * 111.18 * 0.9992).abs() < 10.0, "{}", report.area);
    assert_eq!(read(&path("c.gpkg")).crs.unwrap().numbers().unwrap().horizontal, 25832);
}

#[test]
fn output_is_deterministic_and_insufficient_memory_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let ring = |number: u32, turn: f64| {
        let at = |corner: u32| {
            let angle = std::f64::consts::TAU * f64::from(corner % 50) / 50.0 + turn;
            let away = 3.0 + f64::from(corner * 7 % 5) / 5.0;
            format!(
                "[{},{}]",
                f64::from(number % 10) * 4.0 + away * angle.cos(),
                f64::from(number / 10) * 4.0 + away * angle.sin()
            )
        };
        format!("[[{}]]", (0..51).map(at).collect::<Vec<_>>().join(","))
    };
    let rings: Vec<Vec<String>> =
        [0.0, 0.4].map(|turn| (0..60).map(|number| ring(number, turn)).collect()).to_vec();
    for (name, rings) in ["a.geojson", "b.geojson"].iter().zip(&rings) {
        let features: Vec<(&str, &str)> = rings.iter().map(|ring| (r#"{"x":1}"#, ring.as_str())).collect();
        std::fs::write(path(name), collection(None, &features)).unwrap();
    }
    let pair = [path("a.geojson"), path("b.geojson")];
    let outputs = ["one.gpkg", "two.gpkg"].map(path);
    for output in &outputs {
        made(&pair, &request("partition"), output).unwrap();
    }
    assert_eq!(std::fs::read(&outputs[0]).unwrap(), std::fs::read(&outputs[1]).unwrap());
    let little = OverlayRequest { memory: 100_000, ..request("partition") };
    let error = made(&pair, &little, &path("three.gpkg")).unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
    assert!(!path("three.gpkg").exists());
    let layer = read(&outputs[0]);
    assert!(
        layer.features.iter().all(|own| own.attributes.iter().any(|value| *value != FeatureAttribute::None))
    );
}
