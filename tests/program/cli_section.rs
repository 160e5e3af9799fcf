//! Sections of exact models on the command line.

use serde_json::Value as Json;

use crate::common::command::{command, complaint, stderr, stdout};

/// A box of 4 x 6 x 8 steps of a half.
const BOX: &str = "OFF\n8 6 0\n0 0 0\n2 0 0\n2 3 0\n0 3 0\n0 0 4\n2 0 4\n2 3 4\n0 3 4\n4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";

#[test]
fn sections_of_a_box() {
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let [mesh, model] = ["box.off", "box.goblin"].map(name);
    std::fs::write(&mesh, BOX).unwrap();
    command(&["build", "-q", &mesh, "-o", &model, "--exact", "--grid", "0.5"]).assert().success();
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
    // Many planes, several ways, and none that meets it.
    let file = name("many.csv");
    let many = ["section", &model, "z=0.2..3.8/0.2", "plane=1,1,1,3", "x=9", "-o", &file];
    let told = stderr(command(&many).assert().success());
    assert!(told.contains("20 polygons in 21 planes"), "{told}");
    let rows = std::fs::read_to_string(&file).unwrap();
    assert_eq!(
        rows.lines().filter(|line| line.contains(",z,") && line.ends_with(",6")).count(),
        19,
        "{rows}"
    );
    // As drawing: what is in the plane fills it.
    let drawing = stdout(&["section", "-q", &model, "x=1", "-o", "-", "--format", "svg"]);
    assert!(drawing.contains("viewBox=\"0 -4 3 4\""), "{drawing}");
}

#[test]
fn what_has_no_sections_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let [mesh, model, cells, never] = ["box.off", "box.goblin", "cells.goblin", "never.svg"].map(name);
    std::fs::write(&mesh, BOX).unwrap();
    command(&["build", "-q", &mesh, "-o", &model, "--exact", "--grid", "0.5"]).assert().success();
    command(&["build", "-q", &mesh, "-o", &cells, "--cells", "8"]).assert().success();
    let refused = |plane: &str, file: &str, output: &str, code: i32| {
        complaint(&["section", file, plane, "-o", output], code)
    };
    for plane in ["w=1", "z", "z=nan", "z=0..1/0", "z=1..0/0.1", "z=0..1e30/1", "plane=1,2,3"] {
        assert!(refused(plane, &model, &never, 2).contains("expected"), "{plane}");
    }
    assert!(refused("plane=0,0,0,1", &model, &never, 1).contains("normal"));
    assert!(refused("z=1", &cells, &never, 1).contains("--exact"));
    assert!(refused("z=1", &name("nothing.goblin"), &never, 1).contains("nothing.goblin"));
    assert!(refused("z=1", &model, &name("never.txt"), 1).contains("unknown format"));
    assert!(refused("z=1", &model, &model, 1).contains("unknown format"));
    assert!(!folder.path().join("never.svg").exists());
}
