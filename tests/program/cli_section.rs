//! Sections of exact models on the command line.

use serde_json::Value as Json;

use crate::common::command::{command, complaint, stderr, stdout};

/// A box of 4 x 6 x 8 grid units of one half.
const BOX: &str = "OFF\n8 6 0\n0 0 0\n2 0 0\n2 3 0\n0 3 0\n0 0 4\n2 0 4\n2 3 4\n0 3 4\n4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";

#[test]
fn sections_of_a_box() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [mesh, model] = ["box.off", "box.goblin"].map(name);
    std::fs::write(&mesh, BOX).unwrap();
    command(&["build", "-q", &mesh, "-o", &model, "--brep", "--snap", "0.5"]).assert().success();
    // In space, and in the plane.
    let text = stdout(&["section", "-q", &model, "y=1.25", "-o", "-", "--format", "geojson"]);
    let found: Json = serde_json::from_str(&text).unwrap();
    let feature = &found["features"][0];
    assert_eq!((&feature["properties"]["plane"], &feature["properties"]["area"]), (&"y".into(), &8.into()));
    assert_eq!(
        (&feature["properties"]["at"], &feature["geometry"]["type"]),
        (&1.25.into(), &"Polygon".into())
    );
    let ring = feature["geometry"]["coordinates"][0].as_array().unwrap();
    assert!(ring.len() == 5 && ring.iter().all(|point| point[1] == 1.25), "{ring:?}");
    let flat = stdout(&["section", "-q", &model, "y=1.25", "-o", "-", "--format", "csv", "--flat"]);
    let line = flat.lines().nth(1).unwrap();
    for corner in ["0 0", "4 0", "4 2", "0 2"] {
        assert!(line.contains("POLYGON ((") && line.contains(corner), "{line}");
    }
    // Many planes, in several notations, and one that misses the solid.
    let file = name("many.csv");
    let many = ["section", &model, "z=0.2..3.8/0.2", "plane=1,1,1,3", "x=9", "-o", &file];
    let message = stderr(command(&many).assert().success());
    assert!(message.contains("20 polygons in 21 planes"), "{message}");
    let rows = std::fs::read_to_string(&file).unwrap();
    assert_eq!(
        rows.lines().filter(|line| line.contains(",z,") && line.ends_with(",6")).count(),
        19,
        "{rows}"
    );
    // As a drawing: the section fills it.
    let drawing = stdout(&["section", "-q", &model, "x=1", "-o", "-", "--format", "svg"]);
    assert!(drawing.contains("viewBox=\"0 -4 3 4\""), "{drawing}");
}

/// A box that overlaps the first one's corner, and one on its wall, with an edge along one of its
/// edges.
#[test]
fn what_two_models_have_in_common() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let built = |stem: &str, [x, y, z]: [i32; 3]| {
        let mut lines = BOX.lines().map(String::from).collect::<Vec<_>>();
        for line in &mut lines[2..10] {
            let at: Vec<i32> = line.split(' ').map(|word| word.parse().unwrap()).collect();
            *line = format!("{} {} {}", at[0] + x, at[1] + y, at[2] + z);
        }
        let [mesh, model] = ["off", "goblin"].map(|ending| name(&format!("{stem}.{ending}")));
        std::fs::write(&mesh, lines.join("\n")).unwrap();
        command(&["build", "-q", &mesh, "-o", &model, "--brep", "--snap", "0.5"]).assert().success();
        model
    };
    let [a, b, c] = [built("a", [0; 3]), built("b", [1, 1, 1]), built("c", [2, 0, 1])];
    let text = stdout(&["section", "-q", &a, &b, "-o", "-", "--format", "geojson"]);
    let found: Json = serde_json::from_str(&text).unwrap();
    let [feature] = &found["features"].as_array().unwrap()[..] else { panic!("{text}") };
    let properties = &feature["properties"];
    assert_eq!((&properties["kind"], &properties["length"]), (&"crossing".into(), &12.into()));
    let points = feature["geometry"]["coordinates"].as_array().unwrap();
    assert_eq!((points.len(), &points[0]), (7, &points[6]));
    // Each segment is within a wall of each solid, and has that wall on both sides.
    for side in ["a_left", "a_right", "b_left", "b_right"] {
        assert_eq!(properties[side].as_array().unwrap().len(), 6, "{side}");
    }
    assert_eq!(properties["a_left"], properties["a_right"]);
    assert_eq!(properties["b_left"], properties["b_right"]);
    // A common wall, from the other side; and two coincident edges.
    let message = stderr(command(&["section", &a, &c, "-o", &name("c.csv")]).assert().success());
    assert!(message.contains("0 where they touch (0), 1 area (9), 0 points"), "{message}");
    let rows = std::fs::read_to_string(name("c.csv")).unwrap();
    assert!(rows.contains("POLYGON Z ((") && rows.contains(",overlap,,9,opposite,"), "{rows}");
    // As mesh lines, drawing and table.
    for format in ["obj", "ply", "svg", "gpkg", "fgb"] {
        let file = name(&format!("lines.{format}"));
        command(&["section", "-q", &a, &b, "-o", &file]).assert().success();
        let bytes = std::fs::read(&file).unwrap();
        let text = String::from_utf8_lossy(&bytes);
        match format {
            "obj" => {
                assert!(text.matches("\nv ").count() == 6 && text.contains("\nl 1 2 3 4 5 6 1\n"), "{text}")
            }
            "ply" => {
                assert!(text.contains("element vertex 6\n") && text.contains("element edge 6\n"), "{text}");
                let end = text.find("end_header\n").unwrap() + "end_header\n".len();
                // The header text is ASCII. Three doubles; two ints, the feature, two doubles, four
                // faces.
                assert_eq!(bytes.len() - end, 6 * 24 + 6 * (12 + 16 + 16));
            }
            "svg" => {
                assert!(text.contains("data-kind=\"crossing\"") && text.contains("fill=\"none\""), "{text}")
            }
            "gpkg" => assert!(bytes.starts_with(b"SQLite format 3\0")),
            _ => assert!(bytes.starts_with(b"fgb\x03fgb") && text.contains("crossing")),
        }
    }
    let refused = |words: &[&str]| complaint(&[&["section", "-q"], words].concat(), 1);
    let never = name("never.shp");
    assert!(refused(&[&a, &b, "-o", &never]).contains("several geometry types"));
    assert!(refused(&[&a, &b, "z=1", "-o", &never]).contains("once for each"));
    assert!(refused(&[&a, &b, "--flat", "-o", &name("never.svg")]).contains("--flat"));
    // A grid of both would be too large: the units are the same.
    let far = name("far.goblin");
    command(&["transform", "-q", &a, "translate=100000000,0,0", "-o", &far]).assert().success();
    let message = refused(&[&a, &far, "-o", &name("never.svg")]);
    assert!(message.contains(&format!("{a}, {far}: grids: got an extent of 1000000")), "{message}");
    assert!(message.contains("in units of 0.5, expected at most 2^26 units"), "{message}");
    assert!(refused(&[&a, &name("a.off"), "-o", &name("never.svg")]).contains("a.off"));
    assert!(refused(&[&a, &b, "-o", &b, "--format", "ply"]).contains("input"));
    assert!(!std::path::Path::new(&never).exists() && !directory.path().join("never.svg").exists());
}

#[test]
fn files_without_sections_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [mesh, model, cells, never] = ["box.off", "box.goblin", "cells.goblin", "never.svg"].map(name);
    std::fs::write(&mesh, BOX).unwrap();
    command(&["build", "-q", &mesh, "-o", &model, "--brep", "--snap", "0.5"]).assert().success();
    command(&["build", "-q", &mesh, "-o", &cells, "--cells", "8"]).assert().success();
    let refused = |plane: &str, file: &str, output: &str, code: i32| {
        complaint(&["section", file, plane, "-o", output], code)
    };
    assert!(refused("z", &model, &never, 2).contains("no such file"));
    for plane in ["w=1", "z=nan", "z=0..1/0", "z=1..0/0.1", "z=0..1e30/1", "plane=1,2,3"] {
        assert!(refused(plane, &model, &never, 2).contains("expected"), "{plane}");
    }
    assert!(refused("plane=0,0,0,1", &model, &never, 1).contains("normal"));
    assert!(refused("z=1", &cells, &never, 1).contains("--brep"));
    assert!(refused("z=1", &name("nothing.goblin"), &never, 1).contains("nothing.goblin"));
    assert!(refused("z=1", &model, &name("never.txt"), 1).contains("unknown format"));
    assert!(refused("z=1", &model, &model, 1).contains("unknown format"));
    assert!(!directory.path().join("never.svg").exists());
}
