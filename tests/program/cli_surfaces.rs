//! `spinney build --tin` as meshes of triangles, and what is made of surfaces and layers: isolines.

use std::fmt::Write as _;
use std::fs;

use crate::common::command::{spinney, stderr, stdout};

/// Returns boreholes on a grid of 5 x 5 with spacing 10, whose heights are three planes: ground at
/// `40 + x / 2`, coal at `30 - y / 4`, base at 0.
fn planes() -> String {
    let mut text = String::from("x,y,ground,coal,base\n");
    for [column, row] in (0..25).map(|at| [at % 5, at / 5]) {
        let [x, y] = [column, row].map(|at| f64::from(at) * 10.0);
        writeln!(text, "{x},{y},{},{},0", 40.0 + x / 2.0, 30.0 - y / 4.0).unwrap();
    }
    text
}

/// Returns the vertices of an OBJ file's objects, by their names.
fn objects(text: &str) -> Vec<(String, Vec<[f64; 3]>)> {
    let mut found: Vec<(String, Vec<[f64; 3]>)> = Vec::new();
    for line in text.lines() {
        match line.split_once(' ') {
            Some(("o", name)) => found.push((name.into(), Vec::new())),
            Some(("v", numbers)) => {
                let numbers: Vec<f64> = numbers.split(' ').map(|number| number.parse().unwrap()).collect();
                found.last_mut().unwrap().1.push([numbers[0], numbers[1], numbers[2]]);
            }
            _ => {}
        }
    }
    found
}

#[test]
fn surfaces_become_meshes() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [holes, faults, area, one, all, lines] =
        ["holes.csv", "faults.csv", "area.csv", "one.obj", "all.obj", "lines.csv"].map(at);
    fs::write(&holes, planes()).unwrap();
    fs::write(&faults, "wkt,z\n\"LINESTRING (5 5, 35 5)\",100\n").unwrap();
    fs::write(&area, "wkt\n\"POLYGON ((0 0, 40 0, 40 20, 0 20, 0 0))\"\n").unwrap();

    let printed = stderr(spinney(&["build", &holes, "-o", &one, "--tin", "ground"]).success());
    assert!(printed.contains("ground: 32 triangles, 25 vertices") && !printed.contains("next"), "{printed}");
    let found = objects(&fs::read_to_string(&one).unwrap());
    assert_eq!(found.len(), 1);
    assert_eq!((&found[0].0[..], found[0].1.len()), ("ground", 25));
    assert!(found[0].1.iter().all(|[x, _, z]| *z == 40.0 + x / 2.0));
    stdout(&["build", &holes, "-o", &one, "--tin", "ground", "--breaklines", &faults, "--outline", &area]);
    let found = objects(&fs::read_to_string(&one).unwrap());
    assert!(found[0].1.contains(&[5.0, 5.0, 100.0]));
    assert!(found[0].1.iter().all(|[_, y, _]| *y <= 20.0));

    // Several surfaces have one triangulation, and do not cross.
    stdout(&["build", &holes, "-o", &all, "--tin", "base,ground,coal"]);
    let found = objects(&fs::read_to_string(&all).unwrap());
    let names: Vec<&str> = found.iter().map(|(name, _)| &name[..]).collect();
    assert_eq!(names, ["base", "ground", "coal"]);
    for ((upper, lower), at) in found[0].1.iter().zip(&found[1].1).zip(&found[2].1) {
        assert!(upper[2] >= lower[2] && lower[2] >= at[2] && upper[..2] == at[..2]);
    }
    let ply = at("all.ply");
    let printed = stderr(spinney(&["build", &holes, "-o", &ply, "--tin", "ground,coal"]).success());
    assert!(printed.contains("the names of the surfaces"), "{printed}");
    // Isolines of one object.
    stdout(&["contours", &all, "--object", "coal", "--at", "25", "-o", &lines]);
    let text = fs::read_to_string(&lines).unwrap();
    assert!(text.contains("20") && text.lines().count() == 2, "{text}");
    for (arguments, expected) in [
        (&["contours", &all, "--every", "5", "-o", &lines][..], "one height at each position"),
        (&["contours", &all, "--object", "clay", "--every", "5", "-o", &lines], "base, ground, coal"),
        (&["contours", &all, "--object", "coal", "--side", "top", "--every", "5", "-o", &lines], "--side"),
        (&["build", &holes, "-o", &ply, "--tin", "ground", "--brep"], "--brep: has no effect"),
        (&["build", &holes, "-o", &ply, "--tin", "ground", "--cell", "1"], "--cell: has no effect"),
        (&["build", &holes, "-o", &ply, "--tin", "ground", "--unit", "m"], "--unit: has no effect"),
        (&["build", &holes, "-o", &at("x.stl"), "--tin", "ground"], "PLY, OBJ or OFF"),
        (&["build", &holes, "-o", &at("x.goblin"), "--tin", "ground", "--brep"], "-o ground.ply"),
        (&["build", &holes, "-o", &ply, "--cell", "1"], ".goblin"),
    ] {
        let printed = stderr(spinney(arguments).failure());
        assert!(printed.contains(expected), "{arguments:?}: {printed}");
    }
}

#[test]
fn sides_of_models_have_isolines() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [holes, layers, lines] = ["holes.csv", "layers.goblin", "lines.csv"].map(at);
    fs::write(&holes, planes()).unwrap();
    stdout(&["build", &holes, "-o", &layers, "--tin", "ground,coal,base", "--brep"]);
    let contour = |arguments: &[&str]| {
        let _ = fs::remove_file(&lines);
        let arguments = [&["contours", &layers, "-o", &lines][..], arguments].concat();
        let printed = stderr(spinney(&arguments).success());
        (fs::read_to_string(&lines).unwrap(), printed)
    };
    /// The positions of the first line.
    fn points(text: &str) -> Vec<[f64; 2]> {
        let inside = text.split('(').nth(1).unwrap().split(')').next().unwrap();
        let numbers = inside.split(',').map(|point| {
            let numbers: Vec<f64> = point.trim().split(' ').map(|number| number.parse().unwrap()).collect();
            [numbers[0], numbers[1]]
        });
        numbers.collect()
    }
    let (text, printed) = contour(&["--object", "ground to coal", "--at", "45"]);
    assert!(printed.contains("32 triangles"), "{printed}");
    assert!(points(&text).iter().all(|[x, _]| (x - 10.0).abs() < 1e-9), "{text}");
    let below = ["--object", "ground to coal", "--side", "bottom", "--at", "25"];
    let (text, _) = contour(&below);
    assert!(points(&text).iter().all(|[_, y]| (y - 20.0).abs() < 1e-9), "{text}");
    let (same, _) = contour(&["--object", "coal to base", "--at", "25"]);
    assert_eq!(points(&same).len(), points(&text).len());
    let (_, printed) = contour(&["--object", "coal to base", "--side", "bottom", "--at", "25"]);
    assert!(printed.contains("heights are 0 to 0"), "{printed}");
    for (arguments, expected) in [
        (&["contours", &layers, "--every", "5", "-o", &lines][..], "choose one of its objects with --object"),
        (&["contours", &layers, "--object", "coal", "--every", "5", "-o", &lines], "ground to coal"),
        (&["contours", &layers, "--filled", "--every", "5", "-o", &lines], "--filled"),
        (
            &["contours", "fixtures/v1/elevation.goblin", "--every", "9", "-o", &lines, "--side", "top"],
            "--side",
        ),
    ] {
        let printed = stderr(spinney(arguments).failure());
        assert!(printed.contains(expected), "{arguments:?}: {printed}");
    }
}

#[test]
fn surfaces_are_smoothed_within_a_distance() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [holes, fault, mesh, raster, layers] =
        ["holes.csv", "fault.csv", "mesh.obj", "raster.goblin", "layers.goblin"].map(at);
    // A peak of 16 in the middle of a plane, and a lower surface with a peak just below it.
    let mut text = String::from("x,y,top,base\n");
    for [column, row] in (0..25).map(|at| [at % 5, at / 5]) {
        let is_peak = column == 2 && row == 2;
        writeln!(text, "{column},{row},{},{}", if is_peak { 16 } else { 0 }, if is_peak { 15 } else { -9 })
            .unwrap();
    }
    fs::write(&holes, text).unwrap();
    fs::write(&fault, "wkt\n\"LINESTRING (2 1, 2 2, 2 3)\"\n").unwrap();
    let peak = |arguments: &[&str]| {
        let arguments = [&["build", &holes, "-o", &mesh, "--tin", "top"][..], arguments].concat();
        let printed = stderr(spinney(&arguments).success());
        let found = objects(&fs::read_to_string(&mesh).unwrap()).remove(0).1;
        let height = found.iter().find(|at| at[..2] == [2.0, 2.0]).unwrap()[2];
        (height, found, printed)
    };
    let (height, _, printed) = peak(&["--smooth", "1"]);
    assert_eq!(height, 8.0);
    assert!(printed.contains("1 pass; heights of points moved by at most 8"), "{printed}");
    let (height, found, printed) = peak(&["--smooth", "50", "--smooth-distance", "2.5"]);
    assert!(height == 13.5 && printed.contains("at most 2.5"), "{height} {printed}");
    assert!(found.iter().all(|[x, y, z]| (*z == 0.0) || (x * (4.0 - x) * y * (4.0 - y) > 0.0)));
    let (height, _, printed) = peak(&["--smooth", "9", "--breaklines", &fault]);
    assert!(height == 16.0 && !printed.contains("at most 0"), "{height} {printed}");
    let (height, found, printed) = peak(&["--smooth", "3", "--keep-points"]);
    assert!(height == 16.0 && printed.contains("between points"), "{height} {printed}");
    assert!(found.len() > 25 + 3 * 16);
    for [x, y, z] in &found {
        let is_point = x.fract() == 0.0 && y.fract() == 0.0;
        assert!(!is_point || *z == if [*x, *y] == [2.0, 2.0] { 16.0 } else { 0.0 });
    }
    stdout(&["build", &holes, "-o", &raster, "--tin", "top", "--cell", "1", "--smooth", "1"]);

    // Layers do not cross after smoothing.
    let build = |arguments: &[&str]| {
        let _ = fs::remove_file(&layers);
        let arguments = [&["build", &holes, "-o", &layers, "--tin", "top,base", "--brep"][..], arguments];
        stderr(spinney(&arguments.concat()).success())
    };
    let volume = || stdout(&["stats", &layers]).lines().nth(1).unwrap().to_string();
    build(&[]);
    let before = volume();
    for arguments in [&["--smooth", "4"][..], &["--smooth", "4", "--keep-points"]] {
        let printed = build(arguments);
        assert!(printed.contains("4 passes; heights"), "{printed}");
        assert_ne!(volume(), before);
        stdout(&["verify", &layers]);
    }
    build(&["--smooth", "1", "--smooth-distance", "1"]);
    stdout(&["verify", &layers]);
    for (arguments, expected) in [
        (&["--smooth", "0"][..], "1..=10000"),
        (&["--smooth", "3", "--smooth-distance", "0"], "above 0"),
        (&["--smooth", "3", "--smooth-distance=-1"], "above 0"),
        (&["--smooth", "3", "--smooth-distance", "nan"], "above 0"),
        (&["--keep-points"], "--smooth"),
        (&["--smooth-distance", "1"], "--smooth"),
    ] {
        let arguments = [&["build", &holes, "-o", &mesh, "--tin", "top"][..], arguments].concat();
        let printed = stderr(spinney(&arguments).failure());
        assert!(printed.contains(expected), "{arguments:?}: {printed}");
    }
}

/// Returns the area of each object that the program reports.
fn areas(printed: &str) -> Vec<(String, f64)> {
    let lines = printed.lines().filter_map(|line| line.strip_prefix("object")?.trim().split_once(": area "));
    lines.map(|(name, area)| (name.to_owned(), area.parse().unwrap())).collect()
}

/// Fails unless the objects have these areas.
fn check_areas(printed: &str, expected: [f64; 2]) {
    let found = areas(printed);
    let names: Vec<&str> = found.iter().map(|(name, _)| &name[..]).collect();
    assert_eq!(names, ["ground to coal", "coal to base"], "{printed}");
    for ((_, area), expected) in found.iter().zip(expected) {
        assert!((area - expected).abs() < 1e-6, "{area} {expected}");
    }
}

#[test]
fn vertical_sections_have_the_areas_of_formulas() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [holes, layers, out, line, mesh] =
        ["holes.csv", "layers.goblin", "out.geojson", "line.csv", "out.obj"].map(at);
    fs::write(&holes, planes()).unwrap();
    stdout(&["build", &holes, "-o", &layers, "--tin", "ground,coal,base", "--brep"]);
    let section = |along: &str, output: &str, more: &[&str]| {
        let arguments = [&["section", &layers, "--along", along, "-o", output][..], more].concat();
        stderr(spinney(&arguments).success())
    };
    // Between planes: 15 + x / 2 and 25 at y = 20, beyond both ends of the model.
    check_areas(&section("-10,20,50,20", &out, &[]), [1000.0, 1000.0]);
    check_areas(&section("50,20,-10,20", &out, &[]), [1000.0, 1000.0]);
    let diagonal = 25.0 * 40.0 * 2f64.sqrt();
    check_areas(&section("0,0,40,40", &out, &[]), [diagonal; 2]);
    // Along a wall, which has the model at its left.
    check_areas(&section("0,0,40,0", &out, &[]), [20.0 * 40.0, 1200.0]);
    // A line with a bend, in the model and out of it.
    let printed = section("10,20,30,20,30,50", &out, &[]);
    check_areas(&printed, [500.0 + 650.0, 500.0 + 450.0]);
    assert!(printed.contains("4 polygons along 2 segments"), "{printed}");
    let found: serde_json::Value = serde_json::from_str(&fs::read_to_string(&out).unwrap()).unwrap();
    let features = found["features"].as_array().unwrap();
    assert_eq!(features[2]["properties"]["segment"], 2);
    assert_eq!(features[2]["properties"]["object"], "ground to coal");
    assert!((features[2]["properties"]["area"].as_f64().unwrap() - 650.0).abs() < 1e-6);
    for point in features[2]["geometry"]["coordinates"][0].as_array().unwrap() {
        assert!((point[0].as_f64().unwrap() - 30.0).abs() < 1e-9);
    }
    // The line from files, as a line and as points; and coordinates in the section.
    for text in ["wkt\n\"LINESTRING (10 20, 30 20, 30 50)\"\n", "x,y\n10,20\n30,20\n30,50\n"] {
        fs::write(&line, text).unwrap();
        let printed = section(&line, &out, &["--flat"]);
        check_areas(&printed, [1150.0, 950.0]);
        let found: serde_json::Value = serde_json::from_str(&fs::read_to_string(&out).unwrap()).unwrap();
        let rings = found["features"].as_array().unwrap().iter();
        let points = rings.flat_map(|feature| feature["geometry"]["coordinates"][0].as_array().unwrap());
        let points: Vec<[f64; 2]> = points.map(|at| [0, 1].map(|axis| at[axis].as_f64().unwrap())).collect();
        let most = |axis: usize| points.iter().map(|at| at[axis]).fold(0.0, f64::max);
        assert!((most(0) - 40.0).abs() < 1e-6 && (most(1) - 55.0).abs() < 1e-6, "{points:?}");
    }
    // Triangles, as features and as faces.
    let printed = section(&line, &out, &["--triangles"]);
    check_areas(&printed, [1150.0, 950.0]);
    let found: serde_json::Value = serde_json::from_str(&fs::read_to_string(&out).unwrap()).unwrap();
    let triangles = found["features"].as_array().unwrap();
    let area: f64 = triangles.iter().map(|one| one["properties"]["area"].as_f64().unwrap()).sum();
    assert!((area - 2100.0).abs() < 1e-6);
    assert!(triangles.iter().all(|one| one["geometry"]["coordinates"][0].as_array().unwrap().len() == 4));
    section(&line, &mesh, &["--triangles"]);
    let text = fs::read_to_string(&mesh).unwrap();
    let names: Vec<String> = objects(&text).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["ground to coal", "coal to base"]);
    assert_eq!(text.lines().filter(|line| line.starts_with("f ")).count(), triangles.len());
    // Planes, object by object.
    let printed = stderr(spinney(&["section", &layers, "x=20", "--each", "-o", &out]).success());
    check_areas(&printed, [1000.0, 1000.0]);
    assert!(fs::read_to_string(&out).unwrap().contains("\"object\":\"coal to base\""));
    let printed = stderr(spinney(&["section", &layers, "x=20", "-o", &out]).success());
    assert!(printed.contains("area of 2000") && !printed.contains("object"), "{printed}");
    let printed = section("50,50,60,60", &out, &[]);
    assert!(printed.contains("the line is not over the model"), "{printed}");

    fs::write(&line, "wkt\n\"LINESTRING (1 2, 3 4)\"\n\"LINESTRING (1 2, 3 5)\"\n").unwrap();
    for (arguments, expected) in [
        (&["--along", &line, "-o", &out][..], "several lines"),
        (&["--along", &holes, "-o", &holes], "holes.csv"),
        (&["--along", "1,2,3", "-o", &out], "X,Y,X,Y"),
        (&["--along", "1,2", "-o", &out], "at least two"),
        (&["--along", "1,2,1,2", "-o", &out], "at least two"),
        (&["--along", "1,2,nan,2", "-o", &out], "finite"),
        (&["--along", "none.csv", "-o", &out], "an existing file"),
        (&["--along", "1,2,3,4"], "--output"),
        (&["--along", "1,2,3,4", "z=1", "-o", &out], "cannot be used with"),
        (&["z=1", "--triangles", "-o", &out], "only with --along"),
        (&[&layers, "--each", "-o", &out], "--each"),
        (&["--along", "1,2,3,4", "--triangles", "-o", &at("x.stl")], "PLY, OBJ or OFF"),
    ] {
        let printed = stderr(spinney(&[&["section", &layers], arguments].concat()).failure());
        assert!(printed.contains(expected) && !printed.contains("panicked"), "{arguments:?}: {printed}");
    }
}
