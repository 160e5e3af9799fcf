//! `stats --zones -o`: features as they came, joined with the statistics of the cells in them.

use spinney::import::feature::FeatureOptions;
use spinney::raw::import::feature::{Feature, FeatureAttribute, open_features};

use crate::common::command::{spinney, stderr, stdout};

const CLASSES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
const HEIGHTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_elevation.tif");
const DISTRICTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_districts.geojson");

/// Names of attributes, and the features.
fn read(path: &str) -> (Vec<String>, Vec<Feature>) {
    let mut reader = open_features(path.as_ref(), &FeatureOptions::default()).unwrap();
    let mut features = Vec::new();
    while let Some(feature) = reader.next().unwrap() {
        features.push(feature);
    }
    (reader.schema().attributes.iter().map(|(name, _)| name.clone()).collect(), features)
}

fn number(attribute: &FeatureAttribute) -> f64 {
    match attribute {
        FeatureAttribute::Integer(number) => *number as f64,
        FeatureAttribute::Number(number) => *number,
        other => panic!("{other:?}"),
    }
}

#[test]
fn features_carry_the_answers() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let tree = at("i.goblin");
    spinney(&["-q", "build", CLASSES, "-o", &tree]).success();
    let asked = ["--edge", "area", "--measure", "count,majority,median,classes", "--quantiles", "0.1,0.9"];
    let told = stdout(&[&["stats", &tree, "--zones", DISTRICTS, "--json"], &asked[..]].concat());
    let told: serde_json::Value = serde_json::from_str(&told).unwrap();
    let (_, came) = read(DISTRICTS);
    for ending in ["geojson", "gpkg", "fgb", "csv", "shp"] {
        let output = at(&format!("out.{ending}"));
        let all = [&["stats", &tree, "--zones", DISTRICTS, "-o", &output], &asked[..]].concat();
        assert!(stderr(spinney(&all).success()).contains("2 features"));
        let (names, features) = read(&output);
        let place =
            |name: &str| names.iter().position(|own| own == name).unwrap_or_else(|| panic!("{names:?}"));
        assert_eq!(features.len(), 2);
        for (zone, feature) in told["zones"].as_array().unwrap().iter().zip(&features) {
            let found = |name: &str| number(&feature.attributes[place(name)]);
            let is_near = |found: f64, wanted: &serde_json::Value| {
                let wanted = wanted.as_f64().unwrap();
                assert!((found - wanted).abs() <= 1e-9 * wanted.abs(), "{ending}: {found} and {wanted}");
            };
            assert_eq!(zone["name"].as_str().unwrap(), feature.attributes[place("name")].to_text());
            is_near(found("count"), &zone["cells"]);
            let channel = &zone["channels"][0];
            is_near(found("majority"), &channel["majority"]);
            is_near(found("median"), &channel["median"]);
            is_near(found("q10"), &channel["quantiles"]["0.1"]);
            for class in zone["classes"].as_array().unwrap() {
                is_near(found(&format!("area_{}", class["value"])), &class["area_m2"]);
            }
        }
        if ending != "shp" {
            // (Rings of shapefiles go the other way around.)
            let geometry =
                |features: &[Feature]| features.iter().map(|own| own.geometry.clone()).collect::<Vec<_>>();
            assert_eq!(geometry(&features), geometry(&came), "{ending}");
        }
    }
}

#[test]
fn all_features_are_kept_and_no_attribute_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let (tree, zones, output) = (at("h.goblin"), at("z.geojsonl"), at("out.geojson"));
    spinney(&["-q", "build", HEIGHTS, "-o", &tree]).success();
    let polygon =
        r#"{"type":"Polygon","coordinates":[[[-17.01,28.84],[-16.97,28.84],[-16.97,28.88],[-17.01,28.84]]]}"#;
    let lines = [
        r#"{"type":"Feature","id":5,"properties":{"mean":"x"},"geometry":null}"#.to_owned(),
        r#"{"type":"Feature","id":"b","properties":{"mean":"y"},"geometry":{"type":"Point","coordinates":[1,2]}}"#.to_owned(),
        format!(r#"{{"type":"Feature","properties":{{}},"geometry":{polygon}}}"#),
    ];
    std::fs::write(&zones, lines.join("\n")).unwrap();
    let said = stderr(spinney(&["stats", &tree, "--zones", &zones, "-o", &output]).success());
    assert!(said.contains("`mean` of the answers is `mean_2`"), "{said}");
    let (names, features) = read(&output);
    assert_eq!(names[..2], ["mean", "count"]);
    let (_, came) = read(&zones);
    for (found, came) in features.iter().zip(&came) {
        assert_eq!(
            (&found.id, &found.geometry, &found.attributes[0]),
            (&came.id, &came.geometry, &came.attributes[0])
        );
    }
    let place = |name: &str| names.iter().position(|own| own == name).unwrap();
    assert_eq!(features[1].attributes[place("mean_2")], FeatureAttribute::None);
    assert!(number(&features[2].attributes[place("mean_2")]) > 100.0);
    // Where a format has no such ids they are an attribute; in batches, when memory has no room for all at once.
    let output = at("out.gpkg");
    spinney(&["-q", "stats", &tree, "--zones", &zones, "-o", &output, "--memory", "1000"]).success();
    let (names, features) = read(&output);
    let place = names.iter().position(|own| own == "id").unwrap();
    let ids: Vec<String> = features.iter().map(|own| own.attributes[place].to_text()).collect();
    assert_eq!(ids, ["5", "b", ""]);
    for (arguments, reason) in [
        (&["stats", &tree, "--zones", &zones, "-o", &at("x.tif")][..], "unknown format"),
        (&["stats", &tree, "--zones", DISTRICTS, "-o", DISTRICTS], "is an input and the output"),
        (&["stats", &tree, "--zones", &zones, "-o", &at("x.csv"), "--json"], "standard output"),
    ] {
        let said = stderr(spinney(arguments).failure());
        assert!(said.contains(reason), "{said}");
    }
}

/// Losses of a shapefile are told, and so is the system that corners were said to be in.
#[test]
fn what_is_lost_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let (tree, zones) = (at("i.goblin"), at("z.geojson"));
    spinney(&["-q", "build", CLASSES, "-o", &tree]).success();
    let text = std::fs::read_to_string(DISTRICTS).unwrap();
    let long = "x".repeat(300);
    let text = text.replace("\"name\":", &format!("\"description_of_it\": \"{long}\", \"name\":"));
    std::fs::write(&zones, &text).unwrap();
    let asked = |output: &str| stderr(spinney(&["stats", &tree, "--zones", &zones, "-o", output]).success());
    let said = asked(&at("z.shp"));
    assert!(said.contains("`description_of_it` is `descriptio`"), "{said}");
    assert!(said.contains("texts that are cut to 254 bytes: 2"), "{said}");
    let said = asked(&at("z.gpkg"));
    assert!(!said.contains("cut") && !said.contains("other names"), "{said}");
    // Corners that `--in` says to be in the tree's system are written as such.
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let mut unnamed = value.clone();
    unnamed.as_object_mut().unwrap().remove("crs");
    std::fs::write(&zones, unnamed.to_string()).unwrap();
    let output = at("w.geojson");
    spinney(&["-q", "stats", &tree, "--zones", &zones, "--in", "world", "-o", &output]).success();
    let system = |path: &str| {
        open_features(path.as_ref(), &FeatureOptions::default()).unwrap().schema().crs.clone().unwrap()
    };
    assert_eq!(system(&output), system(DISTRICTS));
}

/// Squares in cells of a raster of 64 x 48: two that overlap in one feature, the same twice, and a bow tie.
const INVALID: &str = r#"{"type": "FeatureCollection", "features": [
    {"type": "Feature", "properties": {"v": 1}, "geometry": {"type": "MultiPolygon", "coordinates": [
        [[[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]], [[[5, 5], [15, 5], [15, 15], [5, 15], [5, 5]]]]}},
    {"type": "Feature", "properties": {"v": 2}, "geometry": {"type": "MultiPolygon", "coordinates": [
        [[[20, 0], [30, 0], [30, 10], [20, 10], [20, 0]]], [[[20, 0], [30, 0], [30, 10], [20, 10], [20, 0]]]]}},
    {"type": "Feature", "properties": {"v": 3}, "geometry": {"type": "Polygon", "coordinates": [
        [[40, 0], [60, 16], [60, 0], [40, 16], [40, 0]]]}}]}"#;

#[test]
fn parts_that_overlap_are_united_and_rings_that_cross_are_even_odd_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let (zones, raster, tree) = (at("zones.geojson"), at("ones.pgm"), at("ones.goblin"));
    std::fs::write(&zones, INVALID).unwrap();
    std::fs::write(&raster, [&b"P5 64 48 255\n"[..], &[1; 64 * 48]].concat()).unwrap();
    spinney(&["-q", "build", &raster, "-o", &tree]).success();
    for (edge, bow) in [("area", 160.0), ("centre", 160.0)] {
        let command = ["stats", &tree, "--zones", &zones, "--in", "cells", "--edge", edge, "--json"];
        let found: serde_json::Value = serde_json::from_str(&stdout(&command)).unwrap();
        let counts = |name: &str| -> Vec<f64> {
            found["zones"].as_array().unwrap().iter().map(|zone| zone[name].as_f64().unwrap()).collect()
        };
        assert_eq!(counts("cells"), [175.0, 100.0, bow], "{edge}");
        assert_eq!(counts("void_cells"), [0.0; 3], "{edge}");
        let warned = stderr(spinney(&command).success());
        assert!(warned.contains("3 polygons are invalid") && warned.contains("united"), "{warned}");
    }
    // Rasterized: the same cells.
    let (classes, shares) = (at("classes.goblin"), at("shares.goblin"));
    let build = |more: &[&str], output: &str| {
        let command = [&["build", &zones, "--grid", &tree], more, &["-o", output]].concat();
        let warned = stderr(spinney(&command).success());
        assert!(warned.contains("3 polygons are invalid"), "{warned}");
    };
    build(&["--value", "v"], &classes);
    let found: serde_json::Value = serde_json::from_str(&stdout(&["stats", &classes, "--json"])).unwrap();
    assert_eq!(found["cells"].as_f64().unwrap(), 435.0, "{found}");
    build(&["--fractions"], &shares);
    let found: serde_json::Value = serde_json::from_str(&stdout(&["stats", &shares, "--json"])).unwrap();
    let channel = &found["channels"][0];
    assert_eq!(channel["max"].as_f64().unwrap(), 1.0, "{found}");
    let sum = channel["mean"].as_f64().unwrap() * found["cells"].as_f64().unwrap();
    assert!((sum - 435.0).abs() < 1e-3, "{found}");
}
