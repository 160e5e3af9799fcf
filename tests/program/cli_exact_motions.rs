//! Transformed exact models on the command line.

use std::path::Path;

use serde_json::{Value as Json, json};

use crate::common::command::{command, complaint, stderr, stdout};
use crate::common::directory::TestDirectory;

/// A wedge on a grid of thousandths.
struct Wedge {
    directory: TestDirectory,
    wedge: String,
}

const WEDGE: &str = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 2 0\n0 0 3\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

impl Wedge {
    fn new() -> Wedge {
        let mut made = Wedge { directory: TestDirectory::new(), wedge: String::new() };
        let mesh = made.name("wedge.off");
        made.wedge = made.name("wedge.goblin");
        std::fs::write(&mesh, WEDGE).unwrap();
        command(&["build", "-q", &mesh, "-o", &made.wedge, "--brep", "--snap", "0.001", "--unit", "in"])
            .assert()
            .success();
        made
    }

    fn name(&self, name: &str) -> String {
        self.directory.name(name)
    }

    /// Transforms with some operations and options. Returns the file and the messages.
    fn moved(&self, name: &str, arguments: &[&str]) -> (String, String) {
        let file = self.name(name);
        let all = [&["transform", &self.wedge, "-o", &file], arguments].concat();
        let message = stderr(command(&all).assert().success().stdout(""));
        command(&["verify", "-q", &file]).assert().success();
        (file, message)
    }
}

fn stats(file: &str, options: &[&str]) -> Json {
    serde_json::from_str(&stdout(&[&["stats", file, "--json"], options].concat())).unwrap()
}

#[test]
fn steps_move_models_in_the_world() {
    let directory = Wedge::new();
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
        let (file, message) = directory.moved("moved.goblin", steps);
        let found = stats(&file, &[]);
        assert_eq!((&found["bounds"], &found["volume"]), (&bounds, &json!(volume)), "{steps:?}");
        assert!(message.contains("exactly"), "{message}");
    }
    let (file, message) = directory.moved("moved.goblin", &["rotate=30", "--codec", "packed"]);
    assert!(message.contains("by at most 0.000") && message.contains(" in\n"), "{message}");
    let volume = stats(&file, &[])["volume"].as_f64().unwrap();
    assert!((volume - 1.0).abs() < 0.01 && volume != 1.0, "{volume}");
    let (file, message) = directory.moved("mm.goblin", &["scale=25.4", "crs=EPSG:25832", "--unit", "mm"]);
    assert!(message.contains("0.0254 mm"), "{message}");
    let info: Json = serde_json::from_str(&stdout(&["info", &file, "--json"])).unwrap();
    assert_eq!((&info["unit"], &info["epsg"]), (&json!("mm"), &json!(25832)));
    assert!(info["provenance"][1].as_str().unwrap().ends_with(": scale=25.4, crs=EPSG:25832"), "{info}");
    let (_, message) = directory.moved("coarse.goblin", &["--snap", "0.25"]);
    assert!(message.contains("units of 0.25 in,") && message.contains("to a new grid, exactly"), "{message}");
}

#[test]
fn queries_of_shifted_and_scaled_models() {
    let directory = Wedge::new();
    let wedge = &directory.wedge;
    let (file, _) = directory.moved("moved.goblin", &["translate=5,0,0", "scale=0.1"]);
    let view = ["--view", "translate=5,0,0", "--view", "scale=0.1"];
    let (mut seen, mut made) = (stats(wedge, &view), stats(&file, &[]));
    (seen["file"], made["file"]) = (Json::Null, Json::Null);
    assert_eq!(seen, made);
    for query in [
        &["point", "0.51,0.01,0.01"][..],
        &["point", "0.49,0.01,0.01"],
        &["find", "--leaf", "vertex"],
        &["section", "z=0.1", "-o", "-", "--format", "csv"],
    ] {
        let run = |file: &str, view: &[&str]| {
            let (command, rest) = query.split_first().unwrap();
            stdout(&[&[*command, file], rest, view].concat())
        };
        assert_eq!(run(wedge, &view), run(&file, &[]), "{query:?}");
    }
    let [seen, made] = ["seen.ply", "made.ply"].map(|name| directory.name(name));
    command(&[&["export", "-q", wedge, &seen], &view[..]].concat()).assert().success();
    command(&["export", "-q", &file, &made]).assert().success();
    assert!(std::fs::read(seen).unwrap() == std::fs::read(made).unwrap());
    let message = complaint(&["stats", wedge, "--view", "crop"], 1);
    assert!(message.contains("that moves coordinates"), "{message}");
}

/// Queries for numbers work on models through any map, and report rounding; all others need a file.
#[test]
fn queries_of_models_under_any_affine_map() {
    let directory = Wedge::new();
    let wedge = &directory.wedge;
    let (file, _) = directory.moved("moved.goblin", &["rotate=90,x", "mirror=z", "translate=5,0,0"]);
    let view = ["--view", "rotate=90,x", "--view", "mirror=z", "--view", "translate=5,0,0"];
    let (mut seen, mut made) = (stats(wedge, &view), stats(&file, &[]));
    (seen["file"], made["file"]) = (Json::Null, Json::Null);
    assert_eq!(seen, made);
    for query in [
        &["point", "5.1,-0.1,-0.1", "5.1,0.1,0.1", "5,0,0"][..],
        &["point", "--distance", "5.25,-0.125,-0.25", "3,0,0"],
        &["point", "--rays", "all", "5.125,-0.25,4,0,0,-2"],
        &["section", "z=-0.5", "-o", "-", "--format", "csv"],
        &["stats", "--each"],
    ] {
        let run = |file: &str, view: &[&str]| {
            let (command, rest) = query.split_first().unwrap();
            stdout(&[&[*command, file], rest, view].concat())
        };
        let numbers = |text: String| -> Vec<f64> {
            let words = text.split([',', ' ', '(', ')', '\t', '\n', '"']);
            let mut numbers: Vec<f64> = words.filter_map(|word| word.parse().ok()).collect();
            if query[0] == "section" {
                // Rings may begin anywhere, and repeat their first point.
                numbers.sort_by(f64::total_cmp);
                numbers.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
            }
            numbers
        };
        let [seen, made] = [run(wedge, &view), run(&file, &[])].map(numbers);
        let are_near = seen.iter().zip(&made).all(|(seen, made)| (seen - made).abs() < 1e-12);
        assert!(seen.len() == made.len() && are_near, "{query:?}: {seen:?} {made:?}");
    }
    let message = stderr(command(&["stats", wedge, "--view", "rotate=30"]).assert().success());
    assert!(message.contains("positions are rounded"), "{message}");
    let message = stderr(command(&[&["stats", wedge], &view[..]].concat()).assert().success());
    assert!(!message.contains("rounded"), "{message}");
    let image = directory.name("never.png");
    for query in [
        &["point", "--distance", "0,0,0", "--view", "scale=1,2,1"][..],
        &["find", "--leaf", "vertex", "--view", "rotate=90"],
        &["render", &image, "--view", "rotate=30"],
        &["section", wedge, "-o", &image, "--format", "csv", "--view", "mirror=x"],
        &["find", "--contacts", "--view", "scale=1,2,1"],
    ] {
        let (command, rest) = query.split_first().unwrap();
        let message = complaint(&[&[*command, wedge], rest].concat(), 1);
        assert!(message.contains("affine=") && message.contains("spinney transform"), "{message}");
    }
    assert!(!Path::new(&image).exists());
}

#[test]
fn options_without_an_effect_are_refused() {
    let directory = Wedge::new();
    let (wedge, never) = (&directory.wedge, directory.name("never.goblin"));
    let cells = directory.name("cells.goblin");
    command(&["build", "-q", wedge, "-o", &cells, "--cells", "16"]).assert().success();
    let refuse = |arguments: &[&str]| {
        let message = complaint(&[&["transform"], arguments, &["-o", &never]].concat(), 1);
        assert!(!Path::new(&never).exists());
        message
    };
    for options in
        [&["--resampling", "nearest"][..], &["--allow-ballpark"], &["--move"], &["--max-error", "1"]]
    {
        let message = refuse(&[&[wedge, "mirror=x"], options].concat());
        assert!(message.contains(&format!("{} has no effect", options[0])), "{message}");
    }
    let message = refuse(&[&cells, "mirror=x", "--snap", "1"]);
    assert!(message.contains("is not an exact model, which --snap needs"), "{message}");
    for step in ["crop", "window=0,0,9,9", "depth=4", "warp=EPSG:3035", "components=26"] {
        let message = refuse(&[wedge, step]);
        assert!(message.contains(&format!("got `{step}`")) && message.contains("translate="), "{message}");
    }
    assert!(refuse(&[wedge, "affine=1,0,0,0,0,1,0,0,0,0,0,0"]).contains("invertible"));
    assert!(refuse(&[wedge, "rotate=30", "--snap", "1e-9"]).contains("2^26"));
    assert!(refuse(&[wedge, "translate=1e15,0,0"]).contains("2^53"));
    let message = complaint(&["transform", wedge, "mirror=x", "-o", wedge], 1);
    assert!(message.contains("output"), "{message}");
}
