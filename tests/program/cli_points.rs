//! Trees of points: building and queries on the command line.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::common::command::{command, complaint, spinney, stderr, stdout};

/// Writes a table of points on a slope, with classes. Returns its path and the points.
fn table(directory: &Path, count: u32) -> (String, Vec<([f64; 3], u32)>) {
    let mut state = 11u64;
    let mut random = |below: u64| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) % below
    };
    let mut text = String::from("x,y,z,class,name\n");
    let mut points = Vec::new();
    for number in 0..count {
        let [x, y] = [random(50_000), random(30_000)];
        let position = [500_000.0 + x as f64 / 100.0, 5_200_000.0 + y as f64 / 100.0, (x + y) as f64 / 200.0];
        let class = if number % 3 == 0 { 2 } else { 5 };
        writeln!(text, "{:.2},{:.2},{:.3},{class},p{number}", position[0], position[1], position[2]).unwrap();
        points.push((position, class));
    }
    let path = directory.join("points.csv");
    fs::write(&path, text).unwrap();
    (path.to_str().unwrap().into(), points)
}

fn within(position: &[f64; 3], [west, south, east, north]: [f64; 4]) -> bool {
    (west..=east).contains(&position[0]) && (south..=north).contains(&position[1])
}

/// Returns the coordinates and classes in the lines of a table, sorted.
fn lines(text: &str) -> Vec<String> {
    let mut lines: Vec<String> = text.lines().skip(1).map(str::to_owned).collect();
    lines.sort();
    lines
}

#[test]
fn points_go_from_a_table_into_las_and_back() {
    let directory = tempfile::tempdir().unwrap();
    let (csv, points) = table(directory.path(), 3000);
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let tree = name("p.goblin");
    let message = stderr(
        spinney(&[
            "build",
            &csv,
            "-o",
            &tree,
            "--index",
            "points",
            "--leaf-size",
            "200",
            "--crs",
            "EPSG:32632",
        ])
        .success(),
    );
    assert!(message.contains("left out: name") && message.contains("3000"), "{message}");
    let info = stdout(&["info", &tree]);
    assert!(
        info.contains("octree of points")
            && info.contains("units of 0.01, 0.01, 0.001")
            && info.contains("EPSG:32632"),
        "{info}"
    );
    assert_eq!(stdout(&["verify", &tree]).trim_end(), format!("{tree}: good"));

    let expected: Vec<String> = {
        let line = |(position, class): &([f64; 3], u32)| {
            format!("{:.2},{:.2},{:.3},{class}", position[0], position[1], position[2])
        };
        let mut expected: Vec<String> = points.iter().map(line).collect();
        expected.sort();
        expected
    };
    assert_eq!(lines(&stdout(&["get", &tree, "-", "--format", "csv"])), expected);
    for middle in [name("q.las"), name("q.laz")] {
        spinney(&["get", &tree, "-o", &middle]).success();
        let again = name("r.goblin");
        spinney(&["build", &middle, "-o", &again]).success();
        assert_eq!(
            lines(&stdout(&["get", &again, "-", "--format", "csv", "--attribute", "class"])),
            expected
        );
        assert!(stdout(&["info", &again]).contains("EPSG:32632"));
    }
    // PLY and NPY store no coordinate system.
    for middle in [name("q.ply"), name("q.npy")] {
        spinney(&["get", &tree, "-o", &middle]).success();
        let again = name("t.goblin");
        let crs = ["--crs", "EPSG:32632", "--leaf-size", "200"];
        spinney(&[&["build", &middle, "-o", &again, "--index", "points"], &crs[..]].concat()).success();
        assert_eq!(lines(&stdout(&["get", &again, "-", "--format", "csv"])), expected);
    }
    let refused = complaint(
        &["build", &name("q.ply"), &name("q.las"), "-o", &name("u.goblin"), "--index", "points"],
        1,
    );
    assert!(refused.contains("one tree per file"), "{refused}");
}

#[test]
fn heights_of_geometries_are_third_coordinates() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let tree = name("p.goblin");
    let feature =
        |geometry: &str| format!(r#"{{"type":"Feature","properties":{{"z":7}},"geometry":{geometry}}}"#);
    let json = |features: &[String]| {
        format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, features.join(","))
    };
    let several = feature(r#"{"type":"MultiPoint","coordinates":[[1,2,5],[3,4,0.5]]}"#);
    let measured = feature(r#"{"type":"Point","coordinates":[5,6,7,8]}"#);
    let flat = feature(r#"{"type":"Point","coordinates":[5,6]}"#);
    for (file, text, expected, warning) in [
        (
            "a.geojson",
            json(&[several.clone(), measured]),
            vec!["1,2,5.0,7", "3,4,0.5,7", "5,6,7.0,7"],
            "1 features",
        ),
        // If some points lack a height, those of the attribute count.
        ("b.geojson", json(&[several, flat]), vec!["1,2,7", "3,4,7", "5,6,7"], "1 features"),
        (
            "c.csv",
            "wkt\n\"POINT Z (1 2 3)\"\n\"MULTIPOINT ((4 5 6),(7 8 9))\"\n".into(),
            vec!["1,2,3", "4,5,6", "7,8,9"],
            "",
        ),
        (
            "d.csv",
            "wkt,z\n\"POINT M (1 2 3)\",3\n\"POINT M (3 4 5)\",2\n".into(),
            vec!["1,2,3", "3,4,2"],
            "2 features",
        ),
    ] {
        fs::write(name(file), text).unwrap();
        let warned = stderr(spinney(&["build", &name(file), "-o", &tree, "--index", "points"]).success());
        assert!(warned.contains(warning), "{file}: {warned}");
        assert_eq!(lines(&stdout(&["get", &tree, "-", "--format", "csv"])), expected, "{file}");
    }
}

#[test]
fn selections_match_a_scan_of_all_points() {
    let directory = tempfile::tempdir().unwrap();
    let (csv, points) = table(directory.path(), 4000);
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let tree = name("p.goblin");
    spinney(&["build", &csv, "-o", &tree, "--index", "points", "--leaf-size", "100"]).success();
    let window = [500_100.0, 5_200_050.0, 500_250.5, 5_200_200.0];
    let text = window.map(|number| number.to_string()).join(",");
    let found = stdout(&["get", &tree, "-", "--format", "csv", "--window", &text, "--where", "class=2"]);
    let expected = points.iter().filter(|(position, class)| within(position, window) && *class == 2).count();
    assert_eq!(lines(&found).len(), expected);
    let stats = stdout(&["stats", &tree, "--window", &text]);
    let expected = points.iter().filter(|(position, _)| within(position, window)).count();
    assert!(stats.starts_with(&format!("points      {expected}\n")), "{stats}");

    let zone = name("zone.geojson");
    let ring = "[[500100.003,5200050.003],[500250.003,5200050.003],[500100.003,5200200.003],[500100.003,5200050.003]]";
    fs::write(&zone, format!(r#"{{"type":"FeatureCollection","crs":null,"features":[{{"type":"Feature","properties":{{}},"geometry":{{"type":"Polygon","coordinates":[{ring}]}}}}]}}"#)).unwrap();
    let inside = |position: &[f64; 3]| {
        let [x, y] = [position[0] - 500_100.003, position[1] - 5_200_050.003];
        x > 0.0 && y > 0.0 && x + y < 150.0
    };
    let found = stdout(&["get", &tree, "-", "--format", "csv", "--within", &zone]);
    assert_eq!(lines(&found).len(), points.iter().filter(|(position, _)| inside(position)).count());

    let from = [500_123.4, 5_200_111.1, 20.0];
    let mut distances: Vec<f64> = points
        .iter()
        .map(|(position, _)| (0..3).map(|axis| (position[axis] - from[axis]).powi(2)).sum::<f64>().sqrt())
        .collect();
    distances.sort_by(f64::total_cmp);
    let nearest = stdout(&["point", &tree, "500123.4,5200111.1,20", "--nearest", "3"]);
    let found: Vec<f64> =
        nearest.lines().map(|line| line.split('\t').nth(1).unwrap().parse().unwrap()).collect();
    assert_eq!(found.len(), 3);
    found.iter().zip(&distances).for_each(|(found, expected)| assert!((found - expected).abs() < 1e-6));
    assert_eq!(stdout(&["point", &tree, "0,0,0", "--radius", "5"]), "1\tnone\n");
    // From standard input, in either notation; empty lines are skipped.
    let run = command(&["point", &tree, "--nearest", "3"])
        .write_stdin("500123.4 5200111.1\t20\n\n0,0\n")
        .assert()
        .success();
    let printed = String::from_utf8(run.get_output().stdout.clone()).unwrap();
    assert!(printed.starts_with(&nearest) && printed.lines().count() == 6, "{printed}");
    assert!(complaint(&["point", &tree, "1,2,3,4"], 1).contains("expected coordinates"));
}

/// Web mercator is a formula: inputs in degrees give the same results as inputs in metres.
#[test]
fn positions_and_polygons_in_other_systems_are_brought_to_the_tree() {
    let directory = tempfile::tempdir().unwrap();
    let (csv, points) = table(directory.path(), 4000);
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let tree = name("p.goblin");
    spinney(&["build", &csv, "-o", &tree, "--index", "points", "--crs", "EPSG:3857"]).success();
    let radius = 6_378_137.0;
    let degrees = |[x, y]: [f64; 2]| [(x / radius).to_degrees(), (y / radius).tanh().asin().to_degrees()];
    let [longitude, latitude] = degrees([500_123.4, 5_200_111.1]);
    let numbers = |text: &str| -> Vec<f64> {
        text.trim().split(['\t', ',', '\n']).map(|word| word.parse().unwrap()).collect()
    };
    let own = numbers(&stdout(&["point", &tree, "500123.4,5200111.1,20", "--nearest", "3"]));
    let position = format!("{longitude},{latitude},20");
    let other = numbers(&stdout(&["point", &tree, &position, "--nearest", "3", "--in", "lonlat"]));
    assert_eq!((own.len(), other.len()), (15, 15));
    assert!(own.iter().zip(&other).all(|(own, other)| (own - other).abs() < 1e-5), "{own:?} {other:?}");
    // A triangle in the tree, and one outside.
    let triangle = |west: f64, south: f64| {
        let corners = [[0.0, 0.0], [150.0, 0.0], [0.0, 150.0], [0.0, 0.0]];
        let ring = corners.map(|[x, y]| degrees([west + x, south + y]));
        let zone = name("zone.geojson");
        fs::write(&zone, format!(r#"{{"type":"Polygon","coordinates":[{ring:?}]}}"#)).unwrap();
        zone
    };
    let zone = triangle(500_100.003, 5_200_050.003);
    let inside = |position: &[f64; 3]| {
        let [x, y] = [position[0] - 500_100.003, position[1] - 5_200_050.003];
        x > 0.0 && y > 0.0 && x + y < 150.0
    };
    let found = stdout(&["get", &tree, "-", "--format", "csv", "--within", &zone]);
    assert_eq!(lines(&found).len(), points.iter().filter(|(position, _)| inside(position)).count());
    let zone = triangle(900_000.0, 100_000.0);
    assert!(lines(&stdout(&["get", &tree, "-", "--format", "csv", "--within", &zone])).is_empty());
    // For a tree without a coordinate system, coordinates are the tree's own.
    spinney(&["build", &csv, "-o", &tree, "--index", "points"]).success();
    assert!(complaint(&["point", &tree, "7,46", "--in", "lonlat"], 1).contains("--crs"));
    let warned = stderr(spinney(&["get", &tree, "-", "--format", "csv", "--within", &zone]).success());
    assert!(warned.contains("assumed to be in its own coordinates"), "{warned}");
}

#[test]
fn rasters_have_what_the_points_of_each_cell_come_to() {
    let directory = tempfile::tempdir().unwrap();
    let (csv, points) = table(directory.path(), 2500);
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let (tree, raster) = (name("p.goblin"), name("r.goblin"));
    spinney(&["build", &csv, "-o", &tree, "--index", "points", "--leaf-size", "300"]).success();
    let mut cells: HashMap<(i64, i64), Vec<f64>> = HashMap::new();
    for (position, _) in &points {
        let cell = ((position[0] / 20.0).floor() as i64, (position[1] / 20.0).ceil() as i64);
        cells.entry(cell).or_default().push(position[2]);
    }
    for rule in ["min", "max", "mean", "count"] {
        spinney(&["transform", &tree, &format!("raster={rule},cell=20"), "-o", &raster]).success();
        for ((column, row), heights) in cells.iter().take(40) {
            let (x, y) = (*column as f64 * 20.0 + 10.0, *row as f64 * 20.0 - 10.0);
            let found: f64 = stdout(&["point", &raster, &format!("{x},{y}")]).trim().parse().unwrap();
            let expected = match rule {
                "min" => heights.iter().copied().fold(f64::MAX, f64::min),
                "max" => heights.iter().copied().fold(f64::MIN, f64::max),
                "mean" => heights.iter().sum::<f64>() / heights.len() as f64,
                _ => heights.len() as f64,
            };
            assert!((found - expected).abs() < 1e-3, "{rule} {column},{row}: {found} {expected}");
        }
    }
}

const RASTER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");

#[test]
fn impossible_requests_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let (csv, _) = table(directory.path(), 30);
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let tree = name("p.goblin");
    spinney(&["build", &csv, "-o", &tree, "--index", "points"]).success();
    for (arguments, code, text) in [
        (&["get", &tree, "out.png"][..], 1, ".las"),
        (&["get", &tree, "-", "--format", "las"], 1, "standard output"),
        (&["get", &tree, "-", "--format", "csv", "--where", "colour=2"], 1, "class"),
        (&["get", &tree, "-", "--format", "csv", "--slice", "z=2"], 1, "--slice has no effect"),
        (&["transform", &tree, "rotate=3", "-o", &name("x.goblin")], 1, "raster="),
        (&["transform", &tree, "raster=mean,cell=0", "-o", &name("x.goblin")], 2, "the cell width"),
        (&["build", &name("none.las"), "-o", &name("x.goblin")], 1, "none.las"),
        (
            &["build", RASTER, "-o", &name("x.goblin"), "--index", "points"],
            1,
            "has no points, expected LAS, LAZ, PLY, NPY or features",
        ),
        (&["build", &csv, "-o", &name("x.autumn"), "--index", "points"], 1, ".goblin"),
        (&["show", &tree], 1, "tree of points"),
    ] {
        let message = complaint(arguments, code);
        assert!(message.contains(text), "{arguments:?}: {message}");
    }
    assert!(!directory.path().join("x.goblin").exists());
}

#[test]
fn times_of_commits_in_the_environment_are_ignored_where_there_are_no_commits() {
    let directory = tempfile::tempdir().unwrap();
    let (csv, _) = table(directory.path(), 30);
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let build = |arguments: &[&str]| {
        let mut command = command(arguments);
        command.env("SOURCE_DATE_EPOCH", "1700000000").assert()
    };
    build(&["build", &csv, "-o", &name("p.goblin"), "--index", "points"]).success();
    build(&["get", &name("p.goblin"), &name("p.las")]).success();
    build(&["shard", "plan", &name("p.las"), "-o", &name("job"), "--shards", "2"]).success();
    let refused =
        build(&["build", &csv, "-o", &name("q.goblin"), "--index", "points", "--time", "5"]).failure();
    assert!(stderr(refused).contains("--time"));
}
