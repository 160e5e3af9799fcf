//! Output of `info` and `stats` on positions, levels, classes and units.

use serde_json::{Value as Json, json};
use spinney::{DataKind, Rule};

use crate::common::command::{command, stderr, stdout};
use crate::common::{Cells, OCT, goblin_bytes};

const CLASSES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");

/// A cube at 10, 20, 30 with edges of 4.
const CUBE: &str = "OFF\n8 6 0
10 20 30\n14 20 30\n14 24 30\n10 24 30\n10 20 34\n14 20 34\n14 24 34\n10 24 34
4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";

fn as_json(arguments: &[&str]) -> Json {
    serde_json::from_str(&stdout(arguments)).unwrap()
}

#[test]
fn info_prints_the_bounds_of_octrees_on_every_axis() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (model, tree) = (name("cube.off"), name("cube.goblin"));
    std::fs::write(&model, CUBE).unwrap();
    let build = ["build", &model, "-o", &tree, "--cell", "0.5", "--unit", "mm", "--stats"];
    let said = stderr(command(&build).assert().success());
    assert!(said.contains("each 0.5 mm wide") && said.contains("by at most 0e0 mm"), "{said}");
    let text = stdout(&["info", &tree]);
    for line in [
        "transform   0.5, 0, 0, 10\n            0, 0.5, 0, 20\n            0, 0, 0.5, 30\n",
        "origin      10, 20, 30\n",
        "cell        0.5 x 0.5 x 0.5 mm\n",
        "world       10,20,30 to 14,24,34\n",
    ] {
        assert!(text.contains(line), "{line}{text}");
    }
    let info = as_json(&["info", &tree, "--json"]);
    assert_eq!(info["matrix"][2], json!([0.0, 0.0, 0.5, 30.0]));
    assert_eq!((&info["origin"], &info["cell"]), (&json!([10.0, 20.0, 30.0]), &json!([0.5, 0.5, 0.5])));
    assert_eq!(
        (&info["world"], &info["unit"]),
        (&json!([[10.0, 20.0, 30.0], [14.0, 24.0, 34.0]]), &json!("mm"))
    );
    let text = stdout(&["stats", &tree, "--surface"]);
    for part in ["lengths in mm\n", "volume   64 mm3 (", "96 mm2 of blocks"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert_eq!(as_json(&["stats", &tree, "--json"])["solid"]["unit"], "mm");
    // Without a declared unit none is reported.
    command(&["build", &model, "-o", &tree, "--cell", "0.5"]).assert().success();
    assert!(stdout(&["stats", &tree]).contains("unknown (`build --unit` sets it)"));
    assert!(as_json(&["info", &tree, "--json"])["unit"].is_null());
    let cells = Cells::random(OCT, 5, [12, 9, 10], 9, true);
    std::fs::write(&tree, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
    assert_eq!(as_json(&["info", &tree, "--json"])["unit"], "cells");
}

#[test]
fn info_prints_the_bounds_of_quadtrees() {
    let directory = tempfile::tempdir().unwrap();
    let tree = directory.path().join("i.goblin").to_str().unwrap().to_string();
    command(&["build", "-q", CLASSES, "-o", &tree]).assert().success();
    let text = stdout(&["info", &tree]);
    assert!(text.contains("cell        50 x 50 m\nworld       300000,3190000 to 312800,3200000\n"), "{text}");
    assert!(text.contains("record slots of 1 segment\n"), "{text}");
    let info = as_json(&["info", &tree, "--json"]);
    assert_eq!((&info["unit"], &info["cell"]), (&json!("m"), &json!([50.0, 50.0])));
    // Classes are printed as integers.
    for command in ["info", "stats"] {
        assert_eq!(as_json(&[command, &tree, "--json"])["classes"][0]["value"].to_string(), "1");
    }
    let found = stdout(&["find", &tree, "--class", "6", "--largest", "1", "--json"]);
    assert!(found.contains("\"value\":6}"), "{found}");
    let crossed = stdout(&["combine", "cross", &tree, &tree, "--json"]);
    assert!(crossed.contains('1') && !crossed.contains(".0"), "{crossed}");
}

#[test]
fn files_with_history_have_levels() {
    for share in [&["--share"][..], &[]] {
        let directory = tempfile::tempdir().unwrap();
        let name = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
        let (edited, published) = (name("i.autumn"), name("i.goblin"));
        command(&["build", "-q", CLASSES, "-o", &edited]).args(share).assert().success();
        let fill = ["fill", "--window", "3,5,90,70", "--value", "2"];
        command(&[&["edit", "-q", &edited][..], &fill].concat()).assert().success();
        command(&["convert", "-q", &edited, &published]).assert().success();
        let levels = |file: &str| as_json(&["info", file, "--json"])["levels"].clone();
        assert_eq!(levels(&edited), levels(&published));
        let table = |file: &str| stdout(&["info", file]).split_once("level  ").unwrap().1.to_string();
        assert_eq!(table(&edited).lines().nth(3), table(&published).lines().nth(3));
    }
}
