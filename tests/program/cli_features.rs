//! Features in other commands: fill, combine with trees, search.

use crate::common::command::{complaint, spinney, stderr, stdout};

const CLASSES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
const DISTRICTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_districts.geojson");

/// Returns the number of cells that are not VOID, and of a class.
fn counts(file: &str, class: u64) -> (u64, u64) {
    let statistics: serde_json::Value = serde_json::from_str(&stdout(&["stats", file, "--json"])).unwrap();
    let classes = statistics["classes"].as_array().unwrap();
    let of = |row: &serde_json::Value| row["cells"].as_u64().unwrap();
    let found = classes.iter().find(|row| row["value"] == class);
    (classes.iter().map(of).sum(), found.map_or(0, of))
}

#[test]
fn features_fill_and_are_combined_and_searched() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (map, tree, zones) = (at("i.autumn"), at("i.goblin"), at("zones.goblin"));
    spinney(&["-q", "build", CLASSES, "-o", &map]).success();
    spinney(&["-q", "build", CLASSES, "-o", &tree]).success();
    // The districts' cells, as a tree built from them.
    spinney(&["-q", "build", DISTRICTS, "--grid", &tree, "-o", &zones]).success();
    let (inside, _) = counts(&zones, 1);
    let both = at("both.goblin");
    spinney(&["-q", "combine", "and", &tree, &zones, "-o", &both]).success();
    let found = at("found.goblin");
    let said = stderr(spinney(&["combine", "and", &tree, DISTRICTS, "-o", &found]).success());
    assert!(said.contains("island_districts.geojson: 2 features"), "{said}");
    let differences = stdout(&["diff", &both, &found]);
    assert!(differences.contains("blocks     0"), "{differences}");
    // A subset of features, and another rule.
    let north = at("north.goblin");
    spinney(&[
        "-q",
        "combine",
        "and",
        &tree,
        DISTRICTS,
        "--where",
        "name=North shore",
        "--edge",
        "touch",
        "-o",
        &north,
    ])
    .success();
    assert!(counts(&north, 1).0 < counts(&found, 1).0);
    // Blocks of a class within features have as many cells as the class has there.
    let blocks = stdout(&["find", &tree, "--class", "3", "--within", DISTRICTS, "--json"]);
    let sum: u64 = blocks
        .lines()
        .map(|line| {
            let block: serde_json::Value = serde_json::from_str(line).unwrap();
            block["size"][0].as_u64().unwrap() * block["size"][1].as_u64().unwrap()
        })
        .sum();
    assert_eq!(sum, counts(&both, 3).1);
    assert!(sum > 0);
    // Filled, and made VOID, in a commit each.
    let before = counts(&map, 7);
    let fill = ["-q", "edit", &map, "fill", "--zones", DISTRICTS];
    spinney(&[&fill[..], &["--value", "7"]].concat()).success();
    assert!(counts(&map, 7).1 >= inside && counts(&map, 7).1 <= inside + before.1);
    spinney(&[&fill[..], &["--void"]].concat()).success();
    let log = stdout(&["log", &map]);
    assert!(log.contains("3, ") && log.contains("Fill") && !log.contains("4, "), "{log}");
    for (arguments, what) in [
        (&["edit", &map, "fill", "--window", "0,0,4,4", "--value", "3", "--where", "a=1"][..], "--zones"),
        (&["edit", &map, "fill", "--zones", DISTRICTS, "--value", "name"], "classes"),
        (&["edit", &map, "fill", "--zones", DISTRICTS, "--value", "256"], "u8"),
        (&["edit", &map, "fill", "--zones", DISTRICTS, "--value", "1,2"], "1 number"),
        (&["edit", &map, "fill", "--zones", CLASSES, "--value", "1"], "is not a feature file"),
        (&["combine", "or", &tree, &zones, "--where", "a=1", "-o", &at("x.goblin")], "features"),
        (&["combine", "or", &tree, DISTRICTS, "--where", "name=x", "-o", &at("x.goblin")], "at least one"),
        (&["find", &tree, "--class", "3", "--edge", "touch"], "--within"),
    ] {
        let said = complaint(arguments, 1);
        assert!(said.contains(what), "{arguments:?}: {said}");
    }
    assert!(!directory.path().join("x.goblin").exists());
}

/// Returns longitude and latitude of a web mercator position, by its formula.
fn degrees(x: f64, y: f64) -> [f64; 2] {
    let radius = 6_378_137.0;
    [(x / radius).to_degrees(), (y / radius).tanh().asin().to_degrees()]
}

/// Returns JSON with each coordinate position changed.
fn moved(value: &serde_json::Value, change: &dyn Fn(f64, f64) -> [f64; 2]) -> serde_json::Value {
    use serde_json::Value;
    match value {
        Value::Array(numbers) if numbers.first().is_some_and(Value::is_number) => {
            let [x, y] = change(numbers[0].as_f64().unwrap(), numbers[1].as_f64().unwrap());
            let rest = numbers[2..].iter().map(|number| number.as_f64().unwrap());
            [x, y].into_iter().chain(rest).map(Value::from).collect()
        }
        Value::Array(members) => members.iter().map(|member| moved(member, change)).collect(),
        Value::Object(members) => {
            let member = |(name, member): (&String, &Value)| match name.as_str() {
                "coordinates" | "geometry" | "geometries" => (name.clone(), moved(member, change)),
                _ => (name.clone(), member.clone()),
            };
            members.iter().map(member).collect()
        }
        other => other.clone(),
    }
}

/// Returns whether two JSON values are equal, with numbers within a tolerance.
fn is_close(a: &serde_json::Value, b: &serde_json::Value, most: f64) -> bool {
    use serde_json::Value::{Array, Number, Object};
    match (a, b) {
        (Number(a), Number(b)) => (a.as_f64().unwrap() - b.as_f64().unwrap()).abs() <= most,
        (Array(a), Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_close(a, b, most)),
        (Object(a), Object(b)) => {
            a.len() == b.len() && a.iter().all(|(name, a)| b.get(name).is_some_and(|b| is_close(a, b, most)))
        }
        _ => a == b,
    }
}

/// Returns the features of a GeoJSON file.
fn features_of(path: &str) -> serde_json::Value {
    let text = std::fs::read_to_string(path).unwrap();
    serde_json::from_str::<serde_json::Value>(&text).unwrap()["features"].take()
}

const GEOMETRIES: [&str; 8] = [
    r#"{"type":"Point","coordinates":[1000.5,2000.25,5.5]}"#,
    r#"{"type":"MultiPoint","coordinates":[[10,20,1],[30,40,2]]}"#,
    r#"{"type":"LineString","coordinates":[[-500,7,1],[9000000,3000000,2],[5,6,3]]}"#,
    r#"{"type":"MultiLineString","coordinates":[[[0,0,1],[5,5,2]],[[7,7,3],[8,9,4],[10,12,5]]]}"#,
    r#"{"type":"Polygon","coordinates":[[[0,0,1],[100,0,2],[100,100,3],[0,100,4],[0,0,1]],[[10,10,5],[10,20,6],[20,20,7],[10,10,5]]]}"#,
    r#"{"type":"MultiPolygon","coordinates":[[[[0,0,1],[9,0,2],[9,9,3],[0,0,1]]],[[[20,0,4],[29,0,5],[29,9,6],[20,0,4]]]]}"#,
    r#"{"type":"GeometryCollection","geometries":[{"type":"Point","coordinates":[3,4,5]},{"type":"LineString","coordinates":[[1,2,3],[4,5,6]]}]}"#,
    "null",
];

/// Writes features in web mercator with these geometries, ids and attributes of all types.
fn mercator(path: &str, geometries: &[&str]) -> serde_json::Value {
    let feature = |(number, geometry): (usize, &&str)| {
        format!(
            r#"{{"type":"Feature","id":{},"properties":{{"whole":{number},"part":{}.5,"name":"n {number}","is":{},"list":[{number}],"none":null}},"geometry":{geometry}}}"#,
            3 * number + 2,
            number * 7,
            number % 2 == 0
        )
    };
    let features: Vec<String> = geometries.iter().enumerate().map(feature).collect();
    let crs = r#""crs":{"type":"name","properties":{"name":"EPSG:3857"}}"#;
    let text = format!(r#"{{"type":"FeatureCollection",{crs},"features":[{}]}}"#, features.join(","));
    std::fs::write(path, text).unwrap();
    features_of(path)
}

#[test]
fn features_of_all_kinds_are_brought_to_another_system() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (input, output) = (at("in.geojson"), at("out.geojson"));
    let given = mercator(&input, &GEOMETRIES);
    // Each vertex is transformed by the formula; heights, ids and attributes stay.
    spinney(&["transform", &input, "warp=EPSG:4326", "-o", &output]).success();
    let expected = moved(&given, &degrees);
    assert!(is_close(&features_of(&output), &expected, 1e-9), "{:#}", features_of(&output));
    // Forth and back through all formats with mixed geometry types.
    for name in ["x.gpkg", "x.fgb", "x.csv", "x.geojson"] {
        let (other, back) = (at(name), at("back.geojson"));
        spinney(&["-q", "transform", &input, "warp=EPSG:4326", "-o", &other]).success();
        let steps = ["crs=EPSG:4326", "warp=EPSG:3857"];
        spinney(&["-q", "transform", &other, steps[0], steps[1], "-o", &back]).success();
        let found = features_of(&back);
        assert_eq!(found.as_array().unwrap().len(), 8, "{name}");
        for (found, given) in found.as_array().unwrap().iter().zip(given.as_array().unwrap()) {
            assert!(is_close(&found["geometry"], &given["geometry"], 1e-5), "{name}: {found} {given}");
            for own in ["whole", "part", "name"] {
                assert_eq!(found["properties"][own], given["properties"][own], "{name}: {found}");
            }
            let id = if matches!(name, "x.gpkg" | "x.geojson") {
                &found["id"]
            } else {
                &found["properties"]["id"]
            };
            assert_eq!(*id, given["id"], "{name}: {found}");
        }
        if name == "x.gpkg" {
            let mut reader = spinney::raw::import::feature::open_features(
                other.as_ref(),
                &spinney::import::feature::FeatureOptions::default(),
            )
            .unwrap();
            assert_eq!(reader.schema().crs.as_ref().unwrap().to_string(), "EPSG:4326");
            assert!(reader.next().unwrap().is_some());
        }
    }
    // Shapefiles have lines or polygons, with reversed outer rings.
    for geometry in &GEOMETRIES[2..6] {
        let given = mercator(&input, &[geometry]);
        let (other, back) = (at("x.shp"), at("back.geojson"));
        spinney(&["-q", "transform", &input, "warp=EPSG:4326", "-o", &other]).success();
        spinney(&["-q", "transform", &other, "warp=EPSG:3857", "-o", &back]).success();
        let vertices = |value: &serde_json::Value| -> Vec<[i64; 3]> {
            let text = value[0]["geometry"]["coordinates"].to_string().replace(['[', ']'], "");
            let numbers: Vec<f64> = text.split(',').map(|number| number.parse().unwrap()).collect();
            let rounded = |vertex: &[f64]| [0, 1, 2].map(|axis| (vertex[axis] * 1e4).round() as i64);
            let mut vertices: Vec<_> = numbers.chunks(3).map(rounded).collect();
            vertices.sort();
            vertices
        };
        assert_eq!(vertices(&features_of(&back)), vertices(&given), "{geometry}");
    }
}

#[test]
fn systems_of_features_are_declared_and_losses_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (input, output) = (at("in.geojson"), at("out.geojson"));
    // Declaring a coordinate system changes no coordinates.
    let given = mercator(&input, &GEOMETRIES);
    spinney(&["transform", &input, "crs=EPSG:25832", "-o", &output]).success();
    assert_eq!(features_of(&output).to_string().replace(".0", ""), given.to_string().replace(".0", ""));
    assert!(std::fs::read_to_string(&output).unwrap().contains("25832"));
    // Heights that only some features have, and a drawing.
    mercator(&input, &[GEOMETRIES[0], r#"{"type":"Point","coordinates":[1,2]}"#]);
    let said = stderr(spinney(&["transform", &input, "warp=EPSG:4326", "-o", &output]).success());
    assert!(said.contains("heights and measures of 1 features"), "{said}");
    assert_eq!(features_of(&output)[0]["geometry"]["coordinates"].as_array().unwrap().len(), 2);
    spinney(&["-q", "transform", &input, "warp=EPSG:4326", "-o", &at("x.svg")]).success();
    // Failed transformations leave no file.
    let (table, polar) = (at("table.csv"), at("polar.geojson"));
    std::fs::write(&table, "x,y\n5,95\n").unwrap();
    std::fs::write(
        &polar,
        r#"{"type":"Feature","id":"north","properties":{},"geometry":{"type":"Point","coordinates":[5,95]},"crs":{"type":"name","properties":{"name":"EPSG:4326"}}}"#,
    )
    .unwrap();
    let none = at("none.geojson");
    for (arguments, text) in [
        (&["transform", &table, "warp=EPSG:3857", "-o", &none][..], "crs=EPSG:NUMBER"),
        (
            &["transform", &polar, "warp=EPSG:3857", "-o", &none],
            "feature 1 (id \"north\") with a vertex at 5,95",
        ),
        (&["transform", &input, "-o", &none], "without an operation"),
        (&["transform", &input, "scale=2", "-o", &none], "features have two operations"),
        (&["transform", &input, "warp=EPSG:4326,cell=3", "-o", &none], "cell= or resampling="),
        (&["transform", &input, "warp=EPSG:4326", "--resampling", "nearest", "-o", &none], "--resampling"),
        (&["transform", &input, "warp=EPSG:4326", "--codec", "packed", "-o", &none], "--codec"),
        (&["transform", &input, "warp=EPSG:4326", "-o", &at("x.goblin")], "unknown format"),
        (&["transform", &input, "warp=EPSG:4326", "-o", &input], "is an input"),
        (&["transform", &input, "raster=mean,cell=1", "-o", &none], "raster="),
    ] {
        let message = complaint(arguments, 1);
        assert!(message.contains(text), "{arguments:?}: {message}");
    }
    assert!(!directory.path().join("none.geojson").exists());
}

/// Coordinates that are not degrees, in files that name no coordinate system.
#[test]
fn coordinates_beyond_degrees_need_a_system() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (map, out, tree) = (at("utm.geojson"), at("out.goblin"), at("i.goblin"));
    let ring = "[[303000,3194000],[307000,3194000],[307000,3198000],[303000,3194000]]";
    let text = format!(
        r#"{{"type":"Feature","properties":{{"v":1}},"geometry":{{"type":"Polygon","coordinates":[{ring}]}}}}"#
    );
    std::fs::write(&map, &text).unwrap();
    let (points, plane) = (at("points.csv"), at("plane.geojson"));
    std::fs::write(&points, "lon,lat\n303000,3194000\n").unwrap();
    std::fs::write(&plane, text.replacen('{', r#"{"crs":null,"#, 1)).unwrap();
    spinney(&["-q", "build", CLASSES, "-o", &tree]).success();
    let refused: [&[&str]; 7] = [
        &["build", &map, "-o", &out, "--cell", "25"],
        &["build", &map, "-o", &out, "--grid", &tree],
        &["build", &points, "-o", &out, "--index", "points"],
        &["stats", &tree, "--zones", &map],
        &["find", &tree, "--class", "3", "--within", &map],
        &["combine", "and", &tree, &map, "-o", &out],
        &["combine", "and", &map, DISTRICTS, "-o", &at("out.gpkg")],
    ];
    for words in refused {
        let said = complaint(words, 1);
        let parts = ["303000,3194000, which is not in degrees", "names no coordinate system", "EPSG:NUMBER"];
        assert!(parts.iter().all(|part| said.contains(part)), "{words:?}: {said}");
        let file = if words.contains(&points.as_str()) { "points.csv: " } else { "utm.geojson: " };
        assert!(said.contains(file), "{words:?}: {said}");
    }
    let declared = at("declared.geojson");
    spinney(&["-q", "transform", &map, "crs=EPSG:32628", "-o", &declared]).success();
    for words in [
        &["build", &map, "-o", &out, "--cell", "25", "--crs", "EPSG:32628"][..],
        &["build", &points, "-o", &out, "--index", "points", "--crs", "EPSG:32628"],
        &["build", &plane, "-o", &out, "--cell", "25"],
        &["build", &declared, "-o", &out, "--grid", &tree],
        &["stats", &tree, "--zones", &map, "--in", "world"],
        &["find", &tree, "--class", "3", "--within", &map, "--in", "world"],
    ] {
        spinney(words).success();
    }
}

/// Classes are given by value or by name, and parsers' errors are in words.
#[test]
fn classes_have_names_in_options() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (tree, map, plain) = (at("d.goblin"), at("d.autumn"), at("p.goblin"));
    for file in [&tree, &map] {
        spinney(&["-q", "build", DISTRICTS, "-o", file, "--cell", "100", "--value", "name"]).success();
    }
    spinney(&["-q", "build", DISTRICTS, "-o", &plain, "--cell", "100"]).success();
    let find = |class: &str| stdout(&["find", &tree, "--class", class, "--limit", "9"]);
    let info: serde_json::Value = serde_json::from_str(&stdout(&["stats", &tree, "--json"])).unwrap();
    let values: Vec<String> =
        info["classes"].as_array().unwrap().iter().map(|row| row["value"].to_string()).collect();
    let shore = find("North shore");
    assert!(!shore.is_empty() && values.iter().any(|value| find(value) == shore), "{shore}");
    let features = |class: &str| {
        let output = at("x.geojson");
        spinney(&["-q", "export", &tree, &output, "--polygons", "--class", class]).success();
        std::fs::read_to_string(output).unwrap()
    };
    assert!(features("North shore").contains("North shore"));
    spinney(&["-q", "edit", &map, "fill", "--window", "0,0,5,5", "--value", "North shore"]).success();
    let unknown = complaint(&["find", &tree, "--class", "beach"], 1);
    assert!(unknown.contains("d.goblin: --class: got beach") && unknown.contains("North shore"), "{unknown}");
    let unnamed = complaint(&["find", &plain, "--class", "beach"], 1);
    assert!(unnamed.contains("expected a number"), "{unnamed}");
    let filled = complaint(&["edit", &map, "fill", "--window", "0,0,5,5", "--value", "wood"], 1);
    assert!(filled.contains("--value: got wood"), "{filled}");
    for (words, expected) in [
        (&["build", CLASSES, "-o", &plain, "--nodata", "abc"][..], "'--nodata <NUMBER>': expected a number"),
        (&["shard", "build", &plain, "x"], "expected an integer"),
        (&["revert", &map, "last"], "expected an integer"),
    ] {
        let said = complaint(words, 2);
        assert!(said.contains(expected) && !said.contains("literal") && !said.contains("digit"), "{said}");
    }
}

/// Parameters of the library have the names of the options that set them.
#[test]
fn errors_name_options() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (tree, out) = (at("i.goblin"), at("o.goblin"));
    spinney(&["-q", "build", CLASSES, "-o", &tree]).success();
    for (words, expected) in [
        (&["build", CLASSES, CLASSES, "--stack", "--names", "a", "-o", &out][..], "--names: got 1"),
        (
            &["build", DISTRICTS, "-o", &out, "--cell", "100", "--value", "area"],
            "districts.geojson: --value: got area",
        ),
        (&["stats", &tree, "--zones", DISTRICTS, "--quantiles", "2"], "--quantiles: got 2"),
        (&["build", CLASSES, "-o", &out, "--max-bytes", "1024"], "bytes that --max-bytes allows"),
        (&["stats", &tree, "--zones", DISTRICTS, "--in", "lonlat"], "--in (in Python: crs=)"),
    ] {
        let said = complaint(words, 1);
        assert!(said.contains(expected), "{words:?}: {said}");
    }
}

/// Features are columns of an octree's cells. Columns of a turned octree are not vertical: the
/// advice of the message works.
#[test]
fn features_are_columns_of_octrees() {
    const BALL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/ball.goblin");
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (zone, part) = (at("zone.geojson"), at("part.goblin"));
    let bounds = stdout(&["info", BALL, "--json"]);
    let size = &serde_json::from_str::<serde_json::Value>(&bounds).unwrap()["size"];
    let [width, height] = [0, 1].map(|axis| size[axis].as_f64().unwrap());
    let half = serde_json::json!({
        "type": "Polygon",
        "coordinates": [[[-1.0, -1.0], [width / 2.0, -1.0], [width / 2.0, height + 1.0], [-1.0, height + 1.0], [-1.0, -1.0]]],
    });
    std::fs::write(&zone, half.to_string()).unwrap();
    let cells = |file: &str| -> u64 {
        let text = stdout(&["stats", file, "--json"]);
        serde_json::from_str::<serde_json::Value>(&text).unwrap()["cells"].as_u64().unwrap()
    };
    spinney(&["combine", "and", BALL, &zone, "-o", &part]).success();
    assert!(cells(&part) > 0 && cells(&part) < cells(BALL));
    let (turned, upright) = (at("turned.goblin"), at("upright.goblin"));
    spinney(&["transform", BALL, "rotate=30,x", "-o", &turned]).success();
    for arguments in [
        &["combine", "and", &turned, &zone, "-o", &part][..],
        &["find", &turned, "--above", "1", "--within", &zone],
        &["stats", &turned, "--zones", &zone],
    ] {
        let said = complaint(arguments, 1);
        assert!(said.contains("spinney transform TREE like=OTHER -o NEW"), "{said}");
    }
    spinney(&["transform", &turned, &format!("like={BALL}"), "-o", &upright]).success();
    spinney(&["combine", "and", &upright, &zone, "-o", &part]).success();
    assert!(cells(&part) > 0 && cells(&part) < cells(&upright));
}
