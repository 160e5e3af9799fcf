//! Transformed exact models on the command line.

use std::path::Path;

use serde_json::{Value as Json, json};
use tempfile::TempDir;

use crate::common::command::{command, complaint, stderr, stdout};

/// A wedge on a grid of thousandths.
struct Folder {
    folder: TempDir,
    wedge: String,
}

const WEDGE: &str = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 2 0\n0 0 3\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

impl Folder {
    fn new() -> Folder {
        let mut made = Folder { folder: tempfile::tempdir().unwrap(), wedge: String::new() };
        let mesh = made.name("wedge.off");
        made.wedge = made.name("wedge.goblin");
        std::fs::write(&mesh, WEDGE).unwrap();
        command(&["build", "-q", &mesh, "-o", &made.wedge, "--brep", "--snap", "0.001", "--unit", "in"])
            .assert()
            .success();
        made
    }

    fn name(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().into()
    }

    /// Transforms with some operations and options. Returns the file and the messages.
    fn moved(&self, name: &str, arguments: &[&str]) -> (String, String) {
        let file = self.name(name);
        let all = [&["transform", &self.wedge, "-o", &file], arguments].concat();
        let told = stderr(command(&all).assert().success().stdout(""));
        command(&["verify", "-q", &file]).assert().success();
        (file, told)
    }
}

fn stats(file: &str, options: &[&str]) -> Json {
    serde_json::from_str(&stdout(&[&["stats", file, "--json"], options].concat())).unwrap()
}

#[test]
fn steps_move_models_in_the_world() {
    let folder = Folder::new();
    for (steps, bounds, volume) in [
        (&["translate=1,-2,0.5"][..], json!([[1.0, -2.0, 0.5], [2.0, 0.0, 3.5]]), 1.0),
        (&["rotate=90"], json!([[-2.0, 0.0, 0.0], [0.0, 1.0, 3.0]]), 1.0),
        (&["rotate=90,x@0,0,1"], json!([[0.0, -2.0, 1.0], [1.0, 1.0, 3.0]]), 1.0),
        (&["mirror=z", "translate=0,0,3"], json!([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]), 1.0),
        (&["transpose"], json!([[0.0, 0.0, 0.0], [2.0, 1.0, 3.0]]), 1.0),
        (&["axes=+z,-x,+y"], json!([[0.0, -1.0, 0.0], [3.0, 0.0, 2.0]]), 1.0),
        (&["scale=2"], json!([[0.0, 0.0, 0.0], [2.0, 4.0, 6.0]]), 8.0),
        (&["scale=2,1"], json!([[0.0, 0.0, 0.0], [2.0, 2.0, 3.0]]), 2.0),
        (&["affine=1,0,0,0,0,-1,0,0,0,1,1,0"], json!([[0.0, -2.0, 0.0], [1.0, 0.0, 3.0]]), 1.0),
    ] {
        let (file, told) = folder.moved("moved.goblin", steps);
        let found = stats(&file, &[]);
        assert_eq!((&found["bounds"], &found["volume"]), (&bounds, &json!(volume)), "{steps:?}");
        assert!(told.contains("exactly"), "{told}");
    }
    let (file, told) = folder.moved("moved.goblin", &["rotate=30", "--codec", "packed"]);
    assert!(told.contains("by at most 0.000") && told.contains(" in\n"), "{told}");
    let volume = stats(&file, &[])["volume"].as_f64().unwrap();
    assert!((volume - 1.0).abs() < 0.01 && volume != 1.0, "{volume}");
    let (file, told) = folder.moved("mm.goblin", &["scale=25.4", "crs=EPSG:25832", "--unit", "mm"]);
    assert!(told.contains("0.0254 mm"), "{told}");
    let info: Json = serde_json::from_str(&stdout(&["info", &file, "--json"])).unwrap();
    assert_eq!((&info["unit"], &info["epsg"]), (&json!("mm"), &json!(25832)));
    assert!(info["provenance"][1].as_str().unwrap().ends_with(": scale=25.4, crs=EPSG:25832"), "{info}");
    let (_, told) = folder.moved("coarse.goblin", &["--snap", "0.25"]);
    assert!(told.contains("steps of 0.25 in,") && told.contains("all of them exactly"), "{told}");
}

#[test]
fn questions_see_models_through_shifts_and_factors() {
    let folder = Folder::new();
    let wedge = &folder.wedge;
    let (file, _) = folder.moved("moved.goblin", &["translate=5,0,0", "scale=0.1"]);
    let view = ["--view", "translate=5,0,0", "--view", "scale=0.1"];
    let (mut seen, mut made) = (stats(wedge, &view), stats(&file, &[]));
    (seen["file"], made["file"]) = (Json::Null, Json::Null);
    assert_eq!(seen, made);
    for question in [
        &["point", "0.51,0.01,0.01"][..],
        &["point", "0.49,0.01,0.01"],
        &["find", "--leaf", "vertex"],
        &["section", "z=0.1", "-o", "-", "--format", "csv"],
    ] {
        let ask = |file: &str, view: &[&str]| {
            let (command, rest) = question.split_first().unwrap();
            stdout(&[&[*command, file], rest, view].concat())
        };
        assert_eq!(ask(wedge, &view), ask(&file, &[]), "{question:?}");
    }
    let [seen, made] = ["seen.ply", "made.ply"].map(|name| folder.name(name));
    command(&[&["export", "-q", wedge, &seen], &view[..]].concat()).assert().success();
    command(&["export", "-q", &file, &made]).assert().success();
    assert!(std::fs::read(seen).unwrap() == std::fs::read(made).unwrap());
    let told = complaint(&["stats", wedge, "--view", "crop"], 1);
    assert!(told.contains("which move coordinates"), "{told}");
}

/// Queries for numbers work on models through any map, and report rounding; all others need a file.
#[test]
fn questions_see_models_through_any_map() {
    let folder = Folder::new();
    let wedge = &folder.wedge;
    let (file, _) = folder.moved("moved.goblin", &["rotate=90,x", "mirror=z", "translate=5,0,0"]);
    let view = ["--view", "rotate=90,x", "--view", "mirror=z", "--view", "translate=5,0,0"];
    let (mut seen, mut made) = (stats(wedge, &view), stats(&file, &[]));
    (seen["file"], made["file"]) = (Json::Null, Json::Null);
    assert_eq!(seen, made);
    for question in [
        &["point", "5.1,-0.1,-0.1", "5.1,0.1,0.1", "5,0,0"][..],
        &["point", "--distance", "5.25,-0.125,-0.25", "3,0,0"],
        &["point", "--rays", "all", "5.125,-0.25,4,0,0,-2"],
        &["section", "z=-0.5", "-o", "-", "--format", "csv"],
        &["stats", "--each"],
    ] {
        let ask = |file: &str, view: &[&str]| {
            let (command, rest) = question.split_first().unwrap();
            stdout(&[&[*command, file], rest, view].concat())
        };
        let numbers = |text: String| -> Vec<f64> {
            let words = text.split([',', ' ', '(', ')', '\t', '\n', '"']);
            let mut numbers: Vec<f64> = words.filter_map(|word| word.parse().ok()).collect();
            if question[0] == "section" {
                // Rings may begin anywhere, and repeat their first point.
                numbers.sort_by(f64::total_cmp);
                numbers.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
            }
            numbers
        };
        let [seen, made] = [ask(wedge, &view), ask(&file, &[])].map(numbers);
        let are_near = seen.iter().zip(&made).all(|(seen, made)| (seen - made).abs() < 1e-12);
        assert!(seen.len() == made.len() && are_near, "{question:?}: {seen:?} {made:?}");
    }
    let told = stderr(command(&["stats", wedge, "--view", "rotate=30"]).assert().success());
    assert!(told.contains("places are rounded"), "{told}");
    let told = stderr(command(&[&["stats", wedge], &view[..]].concat()).assert().success());
    assert!(!told.contains("rounded"), "{told}");
    let picture = folder.name("never.png");
    for question in [
        &["point", "--distance", "0,0,0", "--view", "scale=1,2,1"][..],
        &["find", "--leaf", "vertex", "--view", "rotate=90"],
        &["render", &picture, "--view", "rotate=30"],
        &["section", wedge, "-o", &picture, "--format", "csv", "--view", "mirror=x"],
        &["find", "--contacts", "--view", "scale=1,2,1"],
    ] {
        let (command, rest) = question.split_first().unwrap();
        let told = complaint(&[&[*command, wedge], rest].concat(), 1);
        assert!(told.contains("affine=") && told.contains("spinney transform"), "{told}");
    }
    assert!(!Path::new(&picture).exists());
}

#[test]
fn what_means_nothing_is_refused() {
    let folder = Folder::new();
    let (wedge, never) = (&folder.wedge, folder.name("never.goblin"));
    let cells = folder.name("cells.goblin");
    command(&["build", "-q", wedge, "-o", &cells, "--cells", "16"]).assert().success();
    let refuse = |arguments: &[&str]| {
        let told = complaint(&[&["transform"], arguments, &["-o", &never]].concat(), 1);
        assert!(!Path::new(&never).exists());
        told
    };
    for options in
        [&["--resampling", "nearest"][..], &["--allow-ballpark"], &["--move"], &["--max-error", "1"]]
    {
        let told = refuse(&[&[wedge, "mirror=x"], options].concat());
        assert!(told.contains(&format!("{} means nothing", options[0])), "{told}");
    }
    for options in [["--snap", "1"], ["--unit", "mm"]] {
        let told = refuse(&[&[&cells, "mirror=x"], &options[..]].concat());
        assert!(told.contains("is no exact model, which --"), "{told}");
    }
    for step in ["crop", "window=0,0,9,9", "depth=4", "warp=EPSG:3035", "components=26"] {
        let told = refuse(&[wedge, step]);
        assert!(told.contains(&format!("got `{step}`")) && told.contains("translate="), "{told}");
    }
    assert!(refuse(&[wedge, "affine=1,0,0,0,0,1,0,0,0,0,0,0"]).contains("can be undone"));
    assert!(refuse(&[wedge, "rotate=30", "--snap", "1e-9"]).contains("2^26"));
    assert!(refuse(&[wedge, "translate=1e15,0,0"]).contains("2^53"));
    let told = complaint(&["transform", wedge, "mirror=x", "-o", wedge], 1);
    assert!(told.contains("output"), "{told}");
}
