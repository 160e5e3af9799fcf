//! `spinney build`, `export` and `contours` of triangulated surfaces.

use std::fmt::Write as _;
use std::fs;

use crate::common::command::{spinney, stderr, stdout};

/// Returns boreholes on a grid of 5 x 5, with three heights.
fn boreholes() -> String {
    let mut text = String::from("x,y,ground,coal,base\n");
    for row in 0..5 {
        for column in 0..5 {
            let (x, y) = (column * 10, row * 10);
            // The coal crops out where x is below 20: its top is above the ground.
            writeln!(text, "{x},{y},{},{},{}", 30 + x, 50, 0).unwrap();
        }
    }
    text
}

#[test]
fn points_become_rasters_and_layers() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [wells, area, faults, raster, layers] =
        ["wells.csv", "area.csv", "faults.csv", "raster.goblin", "layers.goblin"].map(at);
    fs::write(&wells, boreholes()).unwrap();
    fs::write(&area, "wkt\n\"POLYGON ((0 0, 40 0, 40 20, 0 20, 0 0))\"\n").unwrap();
    fs::write(&faults, "wkt,z\n\"LINESTRING (5 5, 35 5)\",100\n").unwrap();

    let printed =
        stderr(spinney(&["build", &wells, "-o", &raster, "--tin", "ground", "--cell", "2"]).success());
    assert!(printed.contains("32 triangles, 20 x 20 cells"), "{printed}");
    assert_eq!(stdout(&["point", &raster, "15,15"]), "45\n");
    let lines = ["build", &wells, "-o", &raster, "--tin", "ground", "--cell", "1", "--breaklines", &faults];
    stdout(&lines);
    // Nine tenths of the way to the line at height 100.
    let height: f64 = stdout(&["point", &raster, "20.5,4.9"]).trim().parse().unwrap();
    assert!((93.0..=97.0).contains(&height), "{height}");
    let printed = stderr(
        spinney(&["build", &wells, "-o", &raster, "--tin", "ground", "--cell", "1", "--outline", &area])
            .success(),
    );
    assert!(printed.contains("40 x 20 cells"), "{printed}");

    let printed = stderr(
        spinney(&["build", &wells, "-o", &layers, "--tin", "ground,coal,base", "--brep", "--outline", &area])
            .success(),
    );
    // A wedge from x = 20 on, and everything below the coal.
    assert!(printed.contains("ground to coal: volume 4000, area 400"), "{printed}");
    assert!(
        printed.contains("coal to base: volume 40000, area 800") && printed.contains("clipped"),
        "{printed}"
    );
    let printed = stdout(&["stats", &layers]);
    assert!(printed.contains("44000"), "{printed}");
    stdout(&["verify", &layers]);
    let printed = stdout(&["find", &layers, "--object", "coal to base"]);
    assert!(printed.contains("coal to base"), "{printed}");

    for (arguments, expected) in [
        (&["--tin", "ground"][..], "--cell"),
        (&["--tin", "ground,coal", "--cell", "1"], "--brep"),
        (&["--tin", "ground", "--brep"], "expected at least two for layers"),
        (&["--tin", "depth", "--cell", "1"], "depth"),
        (&["--tin", "ground", "--cell", "1", "--outline", &faults], "not a polygon"),
        (&["--tin", "ground", "--depth", "4"], "--depth: has no effect"),
        (&["--cell", "1", "--outline", &area], "--tin"),
        (&["--tin", "ground", "--cell", "1", "--value", "3"], "--value: has no effect"),
    ] {
        let arguments = [&["build", &wells, "-o", &raster], arguments].concat();
        let printed = stderr(spinney(&arguments).failure());
        assert!(printed.contains(expected), "{arguments:?}: {printed}");
    }
    fs::write(&wells, "x,y,z\n0,0,1\n1,1,2\n2,2,3\n").unwrap();
    let printed = stderr(spinney(&["build", &wells, "-o", &raster, "--tin", "z", "--cell", "1"]).failure());
    assert!(printed.contains("not on one line"), "{printed}");
}

#[test]
fn rasters_become_surfaces_with_isolines() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [ply, obj, lines] = ["relief.ply", "relief.obj", "lines.csv"].map(at);
    let map = "fixtures/v1/elevation.goblin";
    let message = stderr(spinney(&["export", map, &ply, "--tin", "5"]).success());
    assert!(message.contains("cannot store the coordinate system EPSG:32628"), "{message}");
    stdout(&["export", map, &obj, "--tin", "5", "--level", "5"]);
    assert!(fs::read_to_string(&obj).unwrap().lines().any(|line| line.starts_with("f ")));
    let message = stderr(spinney(&["contours", &ply, "--every", "50", "-o", &lines]).success());
    assert!(message.contains("lines of") && message.contains("triangles"), "{message}");
    let text = fs::read_to_string(&lines).unwrap();
    assert!(text.lines().count() > 1 && text.contains("LINESTRING"), "{text}");
    for (arguments, expected) in [
        (&["export", map, &at("x.stl"), "--tin", "5"][..], "PLY, OBJ or OFF"),
        (&["export", map, &at("x.tif"), "--tin", "5"], "--tin works only with surfaces"),
        (&["export", map, &ply, "--tin=-1"], "at least 0"),
        (&["export", map, &ply, "--tin", "5", "--smooth"], "--smooth: has no effect on --tin"),
        (&["export", "fixtures/v1/classes.goblin", &ply, "--tin", "5"], "classes"),
        (&["export", "fixtures/v1/ball.goblin", &ply, "--tin", "5"], "octree"),
        (&["contours", &ply, "--every", "50", "--filled", "-o", &lines], "--filled"),
    ] {
        let message = stderr(spinney(arguments).failure());
        assert!(message.contains(expected), "{arguments:?}: {message}");
    }
}
