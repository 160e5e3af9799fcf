//! `stats --zones -o`: unchanged features, joined with the statistics of their cells.

use spinney::import::feature::FeatureOptions;
use spinney::raw::import::feature::{Feature, FeatureAttribute, open_features};

use crate::common::command::{spinney, stderr, stdout};

const CLASSES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
const HEIGHTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_elevation.tif");
const DISTRICTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_districts.geojson");

/// Returns the attribute names and the features.
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
fn features_carry_the_statistics() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let tree = at("i.goblin");
    spinney(&["-q", "build", CLASSES, "-o", &tree]).success();
    let options = ["--edge", "area", "--measure", "count,majority,median,classes", "--quantiles", "0.1,0.9"];
    let statistics = stdout(&[&["stats", &tree, "--zones", DISTRICTS, "--json"], &options[..]].concat());
    let statistics: serde_json::Value = serde_json::from_str(&statistics).unwrap();
    let (_, came) = read(DISTRICTS);
    for ending in ["geojson", "gpkg", "fgb", "csv", "shp"] {
        let output = at(&format!("out.{ending}"));
        let all = [&["stats", &tree, "--zones", DISTRICTS, "-o", &output], &options[..]].concat();
        assert!(stderr(spinney(&all).success()).contains("2 features"));
        let (names, features) = read(&output);
        let index_of =
            |name: &str| names.iter().position(|own| own == name).unwrap_or_else(|| panic!("{names:?}"));
        assert_eq!(features.len(), 2);
        for (zone, feature) in statistics["zones"].as_array().unwrap().iter().zip(&features) {
            let found = |name: &str| number(&feature.attributes[index_of(name)]);
            let is_near = |found: f64, wanted: &serde_json::Value| {
                let wanted = wanted.as_f64().unwrap();
                assert!((found - wanted).abs() <= 1e-9 * wanted.abs(), "{ending}: {found} and {wanted}");
            };
            assert_eq!(zone["name"].as_str().unwrap(), feature.attributes[index_of("name")].to_text());
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
            // Rings of shapefiles have reversed orientation.
            let geometry =
                |features: &[Feature]| features.iter().map(|own| own.geometry.clone()).collect::<Vec<_>>();
            assert_eq!(geometry(&features), geometry(&came), "{ending}");
        }
    }
}

#[test]
fn all_features_are_kept_and_no_attribute_is_lost() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
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
    assert!(said.contains("statistic `mean` is written as `mean_2`"), "{said}");
    let (names, features) = read(&output);
    assert_eq!(names[..2], ["mean", "count"]);
    let (_, came) = read(&zones);
    for (found, came) in features.iter().zip(&came) {
        assert_eq!(
            (&found.id, &found.geometry, &found.attributes[0]),
            (&came.id, &came.geometry, &came.attributes[0])
        );
    }
    let index_of = |name: &str| names.iter().position(|own| own == name).unwrap();
    assert_eq!(features[1].attributes[index_of("mean_2")], FeatureAttribute::None);
    assert!(number(&features[2].attributes[index_of("mean_2")]) > 100.0);
    // Formats without such ids store them as an attribute; features are processed in batches if
    // they exceed the memory limit.
    let output = at("out.gpkg");
    spinney(&["-q", "stats", &tree, "--zones", &zones, "-o", &output, "--memory", "1000"]).success();
    let (names, features) = read(&output);
    let index_of = names.iter().position(|own| own == "id").unwrap();
    let ids: Vec<String> = features.iter().map(|own| own.attributes[index_of].to_text()).collect();
    assert_eq!(ids, ["5", "b", ""]);
    for (arguments, reason) in [
        (&["stats", &tree, "--zones", &zones, "-o", &at("x.tif")][..], "unknown format"),
        (&["stats", &tree, "--zones", DISTRICTS, "-o", DISTRICTS], "is an input and the output"),
        (&["stats", &tree, "--zones", &zones, "-o", &at("x.csv"), "--json"], "without --output"),
    ] {
        let said = stderr(spinney(arguments).failure());
        assert!(said.contains(reason), "{said}");
    }
}

/// Losses of a shapefile are reported, and so is the coordinate system given for vertices.
#[test]
fn losses_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (tree, zones) = (at("i.goblin"), at("z.geojson"));
    spinney(&["-q", "build", CLASSES, "-o", &tree]).success();
    let text = std::fs::read_to_string(DISTRICTS).unwrap();
    let long = "x".repeat(300);
    let text = text.replace("\"name\":", &format!("\"description_of_it\": \"{long}\", \"name\":"));
    std::fs::write(&zones, &text).unwrap();
    let exported =
        |output: &str| stderr(spinney(&["stats", &tree, "--zones", &zones, "-o", output]).success());
    let said = exported(&at("z.shp"));
    assert!(said.contains("`description_of_it` is `descriptio`"), "{said}");
    assert!(said.contains("strings truncated to 254 bytes: 2"), "{said}");
    let said = exported(&at("z.gpkg"));
    assert!(!said.contains("truncated") && !said.contains("renamed"), "{said}");
    // Vertices declared by `--in` to be in the tree's system are written as such.
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

/// Squares in cells of a raster of 64 x 48: two that overlap in one feature, a duplicate, and a bow
/// tie.
const INVALID: &str = r#"{"type": "FeatureCollection", "features": [
    {"type": "Feature", "properties": {"v": 1}, "geometry": {"type": "MultiPolygon", "coordinates": [
        [[[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]], [[[5, 5], [15, 5], [15, 15], [5, 15], [5, 5]]]]}},
    {"type": "Feature", "properties": {"v": 2}, "geometry": {"type": "MultiPolygon", "coordinates": [
        [[[20, 0], [30, 0], [30, 10], [20, 10], [20, 0]]], [[[20, 0], [30, 0], [30, 10], [20, 10], [20, 0]]]]}},
    {"type": "Feature", "properties": {"v": 3}, "geometry": {"type": "Polygon", "coordinates": [
        [[40, 0], [60, 16], [60, 0], [40, 16], [40, 0]]]}}]}"#;

#[test]
fn parts_that_overlap_are_united_and_rings_that_cross_are_even_odd_everywhere() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
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

/// Returns eastings and northings in UTM zone 32 of longitude and latitude (WGS 84), by Krueger's
/// series (L. Krueger 1912).
fn utm([longitude, latitude]: [f64; 2]) -> [f64; 2] {
    let flattening = 1.0 / 298.257223563;
    let n: f64 = flattening / (2.0 - flattening);
    let radius = 6_378_137.0 / (1.0 + n) * (1.0 + n.powi(2) / 4.0 + n.powi(4) / 64.0);
    let series = [
        n / 2.0 - 2.0 / 3.0 * n.powi(2) + 5.0 / 16.0 * n.powi(3),
        13.0 / 48.0 * n.powi(2) - 3.0 / 5.0 * n.powi(3),
        61.0 / 240.0 * n.powi(3),
    ];
    let (east, sine) = ((longitude - 9.0).to_radians(), latitude.to_radians().sin());
    let eccentricity = 2.0 * n.sqrt() / (1.0 + n);
    let t = (sine.atanh() - eccentricity * (eccentricity * sine).atanh()).sinh();
    let (xi, eta) = (t.atan2(east.cos()), (east.sin() / (1.0 + t * t).sqrt()).atanh());
    let (mut x, mut y) = (eta, xi);
    for (index, factor) in series.into_iter().enumerate() {
        let twice = 2.0 * (index + 1) as f64;
        x += factor * (twice * xi).cos() * (twice * eta).sinh();
        y += factor * (twice * xi).sin() * (twice * eta).cosh();
    }
    [500_000.0 + 0.9996 * radius * x, 0.9996 * radius * y]
}

/// Returns longitude and latitude of a position in UTM zone 32, by Newton's method.
fn degrees([x, y]: [f64; 2]) -> [f64; 2] {
    let mut index_of = [9.0 + (x - 500_000.0) / 75_000.0, y / 111_200.0];
    for _ in 0..8 {
        let step = 1e-6;
        let [at, east, north] =
            [[0.0, 0.0], [step, 0.0], [0.0, step]].map(|[a, b]| utm([index_of[0] + a, index_of[1] + b]));
        let [a, c] = [0, 1].map(|axis| (east[axis] - at[axis]) / step);
        let [b, d] = [0, 1].map(|axis| (north[axis] - at[axis]) / step);
        let (dx, dy, det) = (x - at[0], y - at[1], a * d - b * c);
        index_of = [index_of[0] + (d * dx - b * dy) / det, index_of[1] + (a * dy - c * dx) / det];
    }
    index_of
}

/// Returns the area of a convex ring, and of its intersection with a box.
fn areas(ring: &[[f64; 2]], [west, south, east, north]: [f64; 4]) -> [f64; 2] {
    let area = |ring: &[[f64; 2]]| {
        let [x, y] = ring.first().copied().unwrap_or_default();
        let ends = ring.iter().zip(ring.iter().cycle().skip(1));
        ends.map(|(a, b)| (a[0] - x) * (b[1] - y) - (b[0] - x) * (a[1] - y)).sum::<f64>().abs() / 2.0
    };
    let mut clipped = ring.to_vec();
    for (axis, at, side) in [(0, west, 1.0), (0, east, -1.0), (1, south, 1.0), (1, north, -1.0)] {
        let mut kept = Vec::new();
        for (a, b) in clipped.iter().zip(clipped.iter().cycle().skip(1)) {
            let [from, to] = [a, b].map(|corner| (corner[axis] - at) * side);
            if from >= 0.0 {
                kept.push(*a);
            }
            if (from < 0.0) != (to < 0.0) {
                let share = from / (from - to);
                kept.push([0, 1].map(|axis| a[axis] + (b[axis] - a[axis]) * share));
            }
        }
        clipped = kept;
    }
    [area(ring), area(&clipped)]
}

/// Builds a raster of ones of 64 x 48 cells, with a frame.
fn ones(directory: &std::path::Path, crs: &str, transform: &str) -> String {
    let (raster, tree) = (directory.join("ones.pgm"), directory.join("ones.goblin"));
    std::fs::write(&raster, [&b"P5 64 48 255\n"[..], &[1; 64 * 48]].concat()).unwrap();
    let [raster, tree] = [raster, tree].map(|path| path.to_str().unwrap().to_owned());
    spinney(&["-q", "build", &raster, "-o", &tree, "--crs", crs, "--transform", transform]).success();
    tree
}

/// West, south, east and north.
type Bounds = [f64; 4];
/// Zones: their coordinate system as a GeoJSON member, boxes, and the formula from there to a
/// raster's coordinates.
type ZonesOf<'z> = (&'z str, [Bounds; 5], fn([f64; 2]) -> [f64; 2]);

/// Cells inside and outside of zones in other coordinate systems are those of the formulas, to 0.5
/// %.
#[test]
fn zones_in_other_coordinate_systems_match_the_formulas() {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let zones = file("zones.geojson");
    // Boxes in the coordinates of the zones: within the raster, partly outside, around it, entirely
    // outside, and at a distance.
    let in_degrees = [
        [9.01, 48.01, 9.04, 48.03],
        [9.05, 48.02, 9.2, 48.1],
        [8.5, 47.5, 9.5, 48.5],
        [9.5, 48.0, 9.6, 48.1],
        [11.0, 52.0, 12.0, 53.0],
    ];
    let [low, high] = [utm([9.0, 48.0]), utm([9.08, 48.045])];
    let in_metres = [
        [510_000.0, 5_320_000.0, 520_000.0, 5_330_000.0],
        [530_000.0, 5_330_000.0, 580_000.0, 5_390_000.0],
        [400_000.0, 5_200_000.0, 650_000.0, 5_500_000.0],
        [620_000.0, 5_320_000.0, 640_000.0, 5_340_000.0],
        [300_000.0, 5_800_000.0, 400_000.0, 5_900_000.0],
    ];
    // For each raster its bounds and the area of a cell; for its zones their coordinate system,
    // boxes and formula.
    let metres = ([low[0], high[1] - 4800.0, low[0] + 6400.0, high[1]], 1e4);
    let degrees_of_raster = ([9.0, 48.8 - 0.96, 9.0 + 1.28, 48.8], 4e-4);
    let declared = r#""crs":{"type":"name","properties":{"name":"EPSG:32632"}},"#;
    let transform = format!("100,0,{},0,-100,{}", low[0], high[1]);
    let cases: [(&str, &str, (Bounds, f64), ZonesOf<'_>); 2] = [
        ("EPSG:32632", &transform, metres, ("", in_degrees, utm)),
        ("EPSG:4326", "0.02,0,9,0,-0.02,48.8", degrees_of_raster, (declared, in_metres, degrees)),
    ];
    for (crs, transform, (extent, cell), (declared, boxes, formula)) in cases {
        let tree = ones(directory.path(), crs, transform);
        let ring = |[west, south, east, north]: [f64; 4]| {
            [[west, south], [east, south], [east, north], [west, north], [west, south]]
        };
        let feature = |bounds: &[f64; 4]| {
            let ring = ring(*bounds);
            format!(
                r#"{{"type":"Feature","properties":{{}},"geometry":{{"type":"Polygon","coordinates":[{ring:?}]}}}}"#
            )
        };
        let features: Vec<String> = boxes.iter().map(feature).collect();
        let text = format!(r#"{{"type":"FeatureCollection",{declared}"features":[{}]}}"#, features.join(","));
        std::fs::write(&zones, text).unwrap();
        let json = stdout(&["stats", &tree, "--zones", &zones, "--edge", "area", "--json"]);
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        let table = file("zones.csv");
        let command = ["stats", &tree, "--zones", &zones, "--edge", "area", "--measure", "count,outside"];
        spinney(&[&["-q"], &command[..], &["-o", &table]].concat()).success();
        let (names, rows) = read(&table);
        for (index, bounds) in boxes.into_iter().enumerate() {
            // Edges are straight in the zones' system: many vertices approximate the curve.
            let vertices = ring(bounds);
            let edges = vertices.windows(2).flat_map(|ends| {
                (0..400).map(|step| {
                    let share = f64::from(step) / 400.0;
                    formula([0, 1].map(|axis| ends[0][axis] + (ends[1][axis] - ends[0][axis]) * share))
                })
            });
            let [whole, inside] = areas(&edges.collect::<Vec<_>>(), extent).map(|area| area / cell);
            let zone = &json["zones"][index];
            let [cells, outside] = ["cells", "outside_cells"].map(|name| zone[name].as_f64().unwrap());
            let what = format!("{crs}, zone {index}: {cells} of {inside}, {outside} of {}", whole - inside);
            assert!((cells - inside).abs() <= 0.005 * inside + 1e-6, "{what}");
            assert!((outside - (whole - inside)).abs() <= 0.005 * whole, "{what}");
            let column = |name: &str| {
                let position = names.iter().position(|own| own == name).unwrap();
                number(&rows[index].attributes[position])
            };
            assert!(
                (column("count") - cells).abs() < 1e-6 && (column("outside") - outside).abs() < 1e-6 * whole
            );
        }
    }
}

/// Zones over octrees are columns with a volume.
#[test]
fn zones_of_octrees_have_volumes() {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (solid, tree, zones) = (file("box.csg"), file("box.goblin"), file("zones.geojson"));
    std::fs::write(&solid, "block(0,0,0, 4,4,3);\n").unwrap();
    spinney(&["-q", "build", &solid, "-o", &tree, "--cell", "0.25", "--unit", "m"]).success();
    // Half of it inside, and half outside: columns of 8 x 16 cells, 12 high.
    let ring = "[[-2,0],[2,0],[2,4],[-2,4],[-2,0]]";
    std::fs::write(&zones, format!(r#"{{"type":"FeatureCollection","crs":null,"features":[{{"type":"Feature","properties":{{}},"geometry":{{"type":"Polygon","coordinates":[{ring}]}}}}]}}"#)).unwrap();
    let arguments = ["stats", &tree, "--zones", &zones, "--in", "world", "--edge", "area"];
    let text = stdout(&arguments);
    assert!(text.contains("1536 cells") && text.contains("  24 m3") && !text.contains("m2"), "{text}");
    let json: serde_json::Value =
        serde_json::from_str(&stdout(&[&arguments[..], &["--json"]].concat())).unwrap();
    let zone = &json["zones"][0];
    assert_eq!((&zone["volume"], &zone["unit"]), (&24.0.into(), &"m".into()), "{zone}");
    assert_eq!((&zone["outside_cells"], zone.get("area_m2")), (&1536.0.into(), None), "{zone}");
    let table = stdout(&[&arguments[..], &["--csv"]].concat());
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    let column = rows[0].iter().position(|name| *name == "volume").unwrap();
    assert_eq!((rows[1][column], rows[0].contains(&"area_m2")), ("24", false), "{table}");
    // All cells.
    let text = stdout(&["stats", &tree]);
    assert!(
        text.contains("volume     48 m3\n") && text.contains("  volume   48 m3 (3072.000 cells"),
        "{text}"
    );
    let json: serde_json::Value = serde_json::from_str(&stdout(&["stats", &tree, "--json"])).unwrap();
    assert_eq!((&json["volume"], &json["unit"]), (&48.0.into(), &"m".into()), "{json}");
    // Classes as columns of features.
    let (labels, output) = (file("labels.goblin"), file("zones.csv"));
    spinney(&["-q", "transform", &tree, "components=6", "-o", &labels]).success();
    let written = ["stats", &labels, "--zones", &zones, "--in", "world", "-o", &output];
    spinney(&[&["-q"], &written[..]].concat()).success();
    let (names, rows) = read(&output);
    let position = names.iter().position(|name| name == "volume_1");
    let position = position.unwrap_or_else(|| panic!("{names:?}"));
    assert_eq!(number(&rows[0].attributes[position]), 24.0);
    // Degrees and heights have no common unit.
    let placed = file("placed.goblin");
    spinney(&["-q", "transform", &tree, "crs=EPSG:4326", "-o", &placed]).success();
    let text = stdout(&["stats", &placed, "--surface"]);
    let unknown = "unknown: degrees and heights";
    assert!(text.contains(&format!("volume     {unknown}")), "{text}");
    assert!(
        text.contains(&format!("  volume   {unknown}")) && text.contains(&format!("  surface  {unknown}")),
        "{text}"
    );
    let json: serde_json::Value =
        serde_json::from_str(&stdout(&["stats", &placed, "--surface", "--json"])).unwrap();
    assert!(
        json["volume"].is_null() && json["solid"]["volume"].is_null() && json["solid"]["surface"].is_null()
    );
    let arguments = ["stats", &placed, "--zones", &zones, "--in", "world", "--edge", "area", "--json"];
    let json: serde_json::Value = serde_json::from_str(&stdout(&arguments)).unwrap();
    assert!(json["zones"][0]["volume"].is_null() && json["zones"][0]["cells"] == 1536.0, "{json}");
    // The same for exact models, their objects, and layers between surfaces.
    let (cube, model, wells) = (file("cube.off"), file("cube.goblin"), file("wells.csv"));
    let vertices = "0 0 0\n4 0 0\n4 4 0\n0 4 0\n0 0 3\n4 0 3\n4 4 3\n0 4 3\n";
    let faces = "4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";
    std::fs::write(&cube, format!("OFF\n8 6 0\n{vertices}{faces}")).unwrap();
    spinney(&["-q", "build", &cube, "--brep", "-o", &model, "--crs", "EPSG:4326"]).success();
    let text = stdout(&["stats", &model]);
    assert!(
        text.contains(&format!("  volume   {unknown}")) && text.contains(&format!("  surface  {unknown}")),
        "{text}"
    );
    let json: serde_json::Value = serde_json::from_str(&stdout(&["stats", &model, "--json"])).unwrap();
    assert!(json["volume"].is_null() && json["surface"].is_null(), "{json}");
    assert!(stdout(&["stats", &model, "--each"]).contains(",true,6,,,0,3,"));
    std::fs::write(&wells, "x,y,a,b\n0,0,5,1\n4,0,5,1\n4,4,5,1\n0,4,5,1\n").unwrap();
    let layers = ["build", &wells, "-o", &model, "--tin", "a,b", "--brep", "--crs", "EPSG:4326"];
    let message = stderr(spinney(&layers).success());
    assert!(message.contains("a to b: volume and area unknown: degrees"), "{message}");
}
