//! Trees of lines: building and queries on the command line.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::common::command::{complaint, spinney, stderr, stdout};

/// Writes the streets of a town as GeoJSON: a grid of straight ones and a ring of several lines,
/// with coordinates in tenths.
fn streets(directory: &Path) -> String {
    let mut features = Vec::new();
    for number in 0..20 {
        let at = f64::from(number) * 10.5;
        let ends = if number % 2 == 0 { [[at, 0.0], [at, 200.5]] } else { [[0.0, at], [200.5, at]] };
        features.push(format!(
            r#"{{"type":"Feature","properties":{{"name":"street {number}","lanes":{}}},"geometry":{{"type":"LineString","coordinates":[[{},{}],[{},{}]]}}}}"#,
            number % 3,
            ends[0][0],
            ends[0][1],
            ends[1][0],
            ends[1][1]
        ));
    }
    features.push(
        r#"{"type":"Feature","properties":{"name":"ring","lanes":null},"geometry":{"type":"MultiLineString","coordinates":[[[300,0],[310,0],[310,10]],[[310,20],[300,20],[300,10]]]}}"#.into(),
    );
    let path = directory.join("streets.geojson");
    let text = format!(
        r#"{{"type":"FeatureCollection","crs":{{"type":"name","properties":{{"name":"EPSG:25833"}}}},"features":[{}]}}"#,
        features.join(",\n")
    );
    fs::write(&path, text).unwrap();
    path.to_str().unwrap().into()
}

fn complaint_of(arguments: &[&str]) -> String {
    complaint(arguments, 1)
}

#[test]
fn lines_are_built_queried_and_exported() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (input, tree) = (streets(directory.path()), at("l.goblin"));
    stdout(&["build", &input, "-o", &tree, "--index", "lines", "--leaf-size", "4"]);
    let info = stdout(&["info", &tree, "--json"]);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert_eq!(
        (&info["features"], &info["segments"], &info["epsg"]),
        (&21.into(), &24.into(), &25833.into())
    );
    assert!((info["length"].as_f64().unwrap() - (20.0 * 200.5 + 40.0)).abs() < 1e-6);
    let text = stdout(&["info", &tree, "--levels"]);
    assert!(text.contains("quadtree of lines") && text.contains("level 0"), "{text}");
    assert_eq!(stdout(&["verify", &tree]), format!("{tree}: good\n"));
    // All features, and those of a window, complete.
    let all = at("all.geojson");
    stdout(&["get", &tree, "-o", &all]);
    let read = |path: &str| -> serde_json::Value {
        serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
    };
    let (written, given) = (read(&all), read(&input));
    for (written, given) in
        written["features"].as_array().unwrap().iter().zip(given["features"].as_array().unwrap())
    {
        assert_eq!(written["properties"], given["properties"]);
        let numbers =
            |value: &serde_json::Value| value["geometry"]["coordinates"].to_string().replace(".0", "");
        let written = numbers(written);
        let expected = numbers(given);
        assert!(written == expected || written == format!("[{expected}]"), "{written} {expected}");
    }
    let part = at("part.csv");
    stdout(&["get", &tree, &part, "--window", "299,-5,305,25", "--attribute", "name"]);
    let text = fs::read_to_string(&part).unwrap();
    assert!(text.lines().count() == 2 && text.contains("ring") && !text.contains("lanes"), "{text}");
    assert_eq!(stdout(&["stats", &tree, "--window", "1,1,2,2"]), "features    0\n");
    // It touches the junction of two streets.
    assert_eq!(stdout(&["stats", &tree, "--window", "21,10.5,21,10.5"]), "features    2\n");
    // A subset of features.
    let some = at("some.goblin");
    stdout(&["build", &input, "-o", &some, "--index", "lines", "--where", "lanes=1", "--attribute", "name"]);
    let info = stdout(&["info", &some]);
    assert!(info.contains("features    7\n") && info.contains("attributes  name\n"), "{info}");
}

#[test]
fn points_are_joined_to_the_nearest_lines() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (input, tree) = (streets(directory.path()), at("l.goblin"));
    stdout(&["build", &input, "-o", &tree, "--index", "lines"]);
    assert_eq!(stdout(&["point", &tree, "305,3"]), "1\t3\t305,0\t20\n");
    let two = stdout(&["point", &tree, "21,300", "305,3", "--nearest", "2", "--radius", "101"]);
    assert_eq!(two, "1\t99.5\t21,200.5\t2\n1\t100.5\t21,199.5\t19\n2\t3\t305,0\t20\n");
    assert_eq!(stdout(&["point", &tree, "1000,0", "--radius", "5"]), "1\tnone\n");
    let mut table = String::from("x,y,name\n");
    for number in 0..50 {
        writeln!(table, "{},{},house {number}", 3 * number, 7 * number % 200).unwrap();
    }
    let points = at("houses.csv");
    fs::write(&points, table).unwrap();
    let printed = stdout(&["stats", &tree, "--nearest", &points]);
    assert!(printed.starts_with("points      50, 50 of them joined to a line"), "{printed}");
    let joined = at("joined.geojson");
    stdout(&["stats", &tree, "--nearest", &points, "--attribute", "name", "-o", &joined]);
    let joined: serde_json::Value = serde_json::from_str(&fs::read_to_string(joined).unwrap()).unwrap();
    let features = joined["features"].as_array().unwrap();
    assert_eq!(features.len(), 50);
    for feature in features {
        let properties = &feature["properties"];
        let [x, y] = [0, 1].map(|axis| feature["geometry"]["coordinates"][axis].as_f64().unwrap());
        // The expected nearest street: streets are at multiples of 10.5, even ones along y, odd
        // ones along x.
        let squares = (0..20).map(|number| {
            let at = f64::from(number) * 10.5;
            let (across, along) = if number % 2 == 0 { (x - at, y) } else { (y - at, x) };
            across.hypot((along - 200.5).max(0.0))
        });
        let nearest = squares.fold(f64::MAX, f64::min);
        let distance = properties["distance"].as_f64().unwrap();
        assert!((distance - nearest).abs() < 1e-4, "{properties} {nearest}");
        let line = properties["line"].as_i64().unwrap();
        assert_eq!(properties["name_2"], format!("street {line}"));
    }
}

#[test]
fn crossings_with_other_lines_are_found() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (input, tree) = (streets(directory.path()), at("l.goblin"));
    stdout(&["build", &input, "-o", &tree, "--index", "lines", "--leaf-size", "4"]);
    // Along the first even streets, and one that ends on the ring; the third meets nothing.
    let rivers = at("rivers.csv");
    let lines = ["(-5 5,50 5)", "(305 -5,305 0)", "(250 250,260 260)"];
    let rows: Vec<String> = lines.map(|line| format!("\"LINESTRING {line}\",river\n")).into();
    fs::write(&rivers, format!("wkt,name\n{}", rows.concat())).unwrap();
    // Even streets are at x = 0, 21, 42, ...
    let printed = stdout(&["stats", &tree, "--crossing", &rivers]);
    assert_eq!(printed, "lines       3\nfeatures    4\ncrossings   4\n");
    let json = stdout(&["stats", &tree, "--crossing", &rivers, "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&json["features"], &json["crossings"]), (&4.into(), &4.into()));
    let bridges = at("bridges.csv");
    stdout(&["stats", &tree, "--crossing", &rivers, "--attribute", "name", "-o", &bridges]);
    let text = fs::read_to_string(&bridges).unwrap().replace('\r', "");
    let rows: Vec<&str> = text.lines().skip(1).collect();
    assert_eq!(rows.len(), 4, "{text}");
    assert!(text.starts_with("WKT,name,line,name_2\n"), "{text}");
    assert!(text.contains("POINT (21 5)\",river,2,street 2\n"), "{text}");
    assert!(text.contains("POINT (305 0)\",river,20,ring\n"), "{text}");
    let crossed = at("crossed.csv");
    stdout(&["get", &tree, &crossed, "--crossing", &rivers, "--attribute", "name"]);
    let text = fs::read_to_string(&crossed).unwrap().replace('\r', "");
    assert!(text.lines().count() == 5 && text.contains("street 4\n") && !text.contains("street 6"), "{text}");
    // Geometries other than lines, and files other than trees of lines.
    let points = at("points.csv");
    fs::write(&points, "x,y\n1,2\n").unwrap();
    assert!(complaint_of(&["stats", &tree, "--crossing", &points]).contains("not a line"));
    assert!(complaint_of(&["get", &tree, &rivers, "--crossing", &rivers]).contains("is an input"));
    let cells = at("cells.goblin");
    stdout(&["build", &input, "-o", &cells, "--cell", "5"]);
    assert!(complaint_of(&["get", &cells, &at("x.png"), "--crossing", &rivers]).contains("trees of lines"));
    assert!(complaint_of(&["stats", &cells, "--crossing", &rivers]).contains("trees of lines"));
}

/// Returns longitude and latitude of a web mercator position, by its formula.
fn degrees([x, y]: [f64; 2]) -> [f64; 2] {
    let radius = 6_378_137.0;
    [(x / radius).to_degrees(), (y / radius).tanh().asin().to_degrees()]
}

/// Web mercator is a formula: inputs in degrees give the same results as inputs in metres.
#[test]
fn positions_and_features_in_other_systems_are_brought_to_the_tree() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let input = streets(directory.path());
    let text = fs::read_to_string(&input).unwrap().replace("25833", "3857");
    fs::write(&input, text).unwrap();
    let tree = at("l.goblin");
    stdout(&["build", &input, "-o", &tree, "--index", "lines"]);
    // Positions: the distance and the nearest position are in the tree's coordinate system.
    let [longitude, latitude] = degrees([305.0, 3.0]);
    let position = format!("{longitude},{latitude}");
    for system in ["lonlat", "EPSG:4326", "EPSG:4258"] {
        let printed = stdout(&["point", &tree, &position, "--in", system]);
        let words: Vec<&str> = printed.trim().split(['\t', ',']).collect();
        let numbers: Vec<f64> = words.iter().map(|word| word.parse().unwrap()).collect();
        let expected = [1.0, 3.0, 305.0, 0.0, 20.0];
        assert_eq!(numbers.len(), 5, "{printed}");
        assert!(numbers.iter().zip(expected).all(|(own, other)| (own - other).abs() < 1e-4), "{printed}");
    }
    assert_eq!(stdout(&["point", &tree, "305,3", "--in", "EPSG:3857"]), "1\t3\t305,0\t20\n");
    assert!(complaint_of(&["point", &tree, "305,3", "--in", "cells"]).contains("there are no cells"));
    assert!(complaint_of(&["point", &tree, "5,95", "--in", "lonlat"]).contains("point 1"));
    // Points of a file: distances are in metres, and the points keep their own coordinate system.
    let positions: Vec<[f64; 2]> =
        (0..30).map(|number| [f64::from(7 * number), f64::from(11 * number % 190)]).collect();
    let feature = |kind: &str, coordinates: String, crs: &str| {
        format!(
            r#"{{"type":"FeatureCollection"{crs},"features":[{{"type":"Feature","properties":{{}},"geometry":{{"type":"{kind}","coordinates":{coordinates}}}}}]}}"#
        )
    };
    let collection = |positions: &[[f64; 2]]| {
        let points = positions.iter().map(|position| {
            format!(r#"{{"type":"Feature","properties":{{}},"geometry":{{"type":"Point","coordinates":{position:?}}}}}"#)
        });
        format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, points.collect::<Vec<_>>().join(","))
    };
    let (metres, lonlat) = (at("metres.geojson"), at("lonlat.geojson"));
    let crs = r#","crs":{"type":"name","properties":{"name":"EPSG:3857"}}"#;
    let in_metres =
        collection(&positions).replacen(r#""FeatureCollection""#, &format!(r#""FeatureCollection"{crs}"#), 1);
    fs::write(&metres, in_metres).unwrap();
    let in_degrees: Vec<[f64; 2]> = positions.iter().copied().map(degrees).collect();
    fs::write(&lonlat, collection(&in_degrees)).unwrap();
    let joined = |input: &str| -> Vec<(f64, i64, f64)> {
        let output = at("joined.geojson");
        stdout(&["stats", &tree, "--nearest", input, "-o", &output]);
        let text = fs::read_to_string(&output).unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let of_feature = |feature: &serde_json::Value| {
            let properties = &feature["properties"];
            let x = feature["geometry"]["coordinates"][0].as_f64().unwrap();
            (properties["distance"].as_f64().unwrap(), properties["line"].as_i64().unwrap(), x)
        };
        json["features"].as_array().unwrap().iter().map(of_feature).collect()
    };
    let (own, other) = (joined(&metres), joined(&lonlat));
    assert_eq!(own.len(), 30);
    for (number, (own, other)) in own.iter().zip(&other).enumerate() {
        assert!((own.0 - other.0).abs() < 1e-4, "{own:?} {other:?}");
        assert!(own.0 < 1e-4 || own.1 == other.1, "{own:?} {other:?}");
        assert!(
            (own.2 - positions[number][0]).abs() < 1e-9 && (other.2 - in_degrees[number][0]).abs() < 1e-7
        );
    }
    // Lines of a file: crossings are in the tree's coordinate system.
    let line = [[-5.0, 5.25], [50.0, 5.75]];
    fs::write(&metres, feature("LineString", format!("{line:?}"), crs)).unwrap();
    fs::write(&lonlat, feature("LineString", format!("{:?}", line.map(degrees)), "")).unwrap();
    let crossed = |input: &str| -> Vec<[f64; 2]> {
        let output = at("crossed.geojson");
        stdout(&["stats", &tree, "--crossing", input, "-o", &output]);
        let text = fs::read_to_string(&output).unwrap();
        assert!(text.contains("3857"), "{text}");
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let position = |feature: &serde_json::Value| {
            [0, 1].map(|axis| feature["geometry"]["coordinates"][axis].as_f64().unwrap())
        };
        json["features"].as_array().unwrap().iter().map(position).collect()
    };
    let (own, other) = (crossed(&metres), crossed(&lonlat));
    assert_eq!((own.len(), other.len()), (3, 3));
    for (own, other) in own.iter().zip(&other) {
        assert!((own[0] - other[0]).hypot(own[1] - other[1]) < 1e-3, "{own:?} {other:?}");
    }
    let names = |input: &str| {
        stdout(&["get", &tree, &at("names.csv"), "--crossing", input, "--attribute", "name"]);
        fs::read_to_string(at("names.csv")).unwrap()
    };
    assert_eq!(names(&metres), names(&lonlat));
    // A tree without a coordinate system.
    let (table, plain) = (at("plain.csv"), at("plain.goblin"));
    fs::write(&table, "wkt\n\"LINESTRING (0 0,100 0)\"\n").unwrap();
    stdout(&["build", &table, "-o", &plain, "--index", "lines"]);
    let printed = complaint_of(&["point", &plain, "5,5", "--in", "lonlat"]);
    assert!(printed.contains("coordinate system of the tree") && printed.contains("--crs"), "{printed}");
    let printed = stderr(spinney(&["stats", &plain, "--crossing", &lonlat]).success());
    assert!(printed.contains("assumed to be in its own coordinates"), "{printed}");
}

#[test]
fn invalid_arguments_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (input, tree) = (streets(directory.path()), at("l.goblin"));
    stdout(&["build", &input, "-o", &tree, "--index", "lines"]);
    let points = at("points.csv");
    fs::write(&points, "x,y\n1,2\n").unwrap();
    let message = complaint_of(&["build", &points, "-o", &at("x.goblin"), "--index", "lines"]);
    assert!(message.contains("--index points"), "{message}");
    let message = complaint_of(&["build", &input, "-o", &at("x.goblin"), "--index", "lines", "--cell", "3"]);
    assert!(message.contains("--cell: has no effect on lines"), "{message}");
    assert!(complaint_of(&["get", &tree, &at("x.png")]).contains("unknown format"));
    assert!(complaint_of(&["get", &tree, &at("x.csv"), "--level", "3"]).contains("--level has no effect"));
    assert!(complaint_of(&["get", &tree, &at("x.csv"), "--attribute", "height"]).contains("name, lanes"));
    assert!(complaint_of(&["render", &tree, &at("x.png")]).contains("a tree of lines"));
    assert!(complaint_of(&["stats", &tree, "--nearest", &input]).contains("not a single point"));
    // A corrupt byte is reported.
    let mut bytes = fs::read(&tree).unwrap();
    bytes[30] ^= 1;
    fs::write(&tree, bytes).unwrap();
    spinney(&["verify", &tree]).code(1);
}
