//! Solids of cells: volumes after resampling, bounds of turned trees, thin and empty solids, and
//! the advice of messages about them.

use std::path::Path;

use crate::common::command::{spinney, stderr, stdout};

/// Writes a file.
fn written(directory: &Path, name: &str, text: &str) -> String {
    let path = directory.join(name);
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_string()
}

/// Builds a solid of CSG with more arguments; returns the file.
fn built(directory: &Path, name: &str, csg: &str, more: &[&str]) -> String {
    let source = written(directory, &format!("{name}.csg"), csg);
    let out = directory.join(format!("{name}.goblin")).to_str().unwrap().to_string();
    spinney(&[&["-q", "build", &source, "-o", &out], more].concat()).success();
    out
}

fn measures(file: &str) -> serde_json::Value {
    serde_json::from_str(&stdout(&["stats", file, "--json"])).unwrap()
}

/// Returns the volume of a solid, which is the same in all of its JSON.
fn volume(file: &str) -> f64 {
    let json = measures(file);
    let volume = json["solid"]["volume"].as_f64().unwrap();
    assert!((json["volume"].as_f64().unwrap() - volume).abs() < 1e-6 * volume.max(1.0), "{json}");
    volume
}

/// Runs a transformation; returns the volume of the result.
fn transformed(file: &str, steps: &[&str], out: &str) -> f64 {
    spinney(&[&["-q", "transform", file], steps, &["-o", out]].concat()).success();
    volume(out)
}

/// Returns the part of a message between two strings.
fn between<'a>(text: &'a str, from: &str, to: &str) -> &'a str {
    let rest = text.split_once(from).unwrap_or_else(|| panic!("{from} is in {text}")).1;
    rest.split_once(to).unwrap_or((rest, "")).0
}

/// The OFF file of a box.
fn off([x, y, z]: [f64; 3]) -> String {
    let mut text = "OFF\n8 6 0\n".to_string();
    for corner in 0..8 {
        let at = |axis: usize, side: f64| if corner >> axis & 1 > 0 { side } else { 0.0 };
        text += &format!("{} {} {}\n", at(0, x), at(1, y), at(2, z));
    }
    text + "4 0 2 3 1\n4 4 5 7 6\n4 0 1 5 4\n4 2 6 7 3\n4 0 4 6 2\n4 1 3 7 5\n"
}

#[test]
fn resampled_solids_keep_their_volume() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let out = directory.join("out.goblin").to_str().unwrap().to_string();
    let thin = built(directory, "thin", "block(0,0,0, 10,10,1);", &["--cell", "1"]);
    assert_eq!(volume(&thin), 100.0);
    // A cell has 255 steps of fullness, of which cells here have at least 76.
    let is_near = |found: f64, expected: f64| (found - expected).abs() < expected * 0.5 / 76.0;
    let steps: [&[&str]; 9] = [
        &["translate=0,0,0.5"],
        &["translate=-0.25,0.5,-0.5"],
        &["depth=3"],
        &["depth=2"],
        &["scale=1,1,1.5"],
        &["scale=0.3"],
        &["rotate=30,x"],
        &["rotate=40,1,2,3"],
        &["translate=0,0,0.5", "rotate=45", "scale=0.7"],
    ];
    for steps in steps {
        let found = transformed(&thin, steps, &out);
        assert!(is_near(found, 100.0), "{steps:?}: {found}");
        assert_eq!(stdout(&["verify", &out]).matches("good").count(), 1);
    }
    for level in ["3", "2"] {
        let text = stdout(&["stats", &thin, "--level", level, "--json"]);
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let found = json["solid"]["volume"].as_f64().unwrap();
        assert!(is_near(found, 100.0), "level {level}: {found}");
    }
    // Onto the cells of another solid, whose box is smaller: nothing is cut off.
    let coarse = built(directory, "coarse", "block(0,0,0, 7,7,7);", &["--cell", "3"]);
    let plate = built(directory, "plate", "block(0,0,0, 50,25,10);", &["--cell", "1"]);
    let found = transformed(&plate, &[&format!("like={coarse}")], &out);
    assert!(is_near(found, 12500.0), "{found}");
    // Combined with it, as it is.
    spinney(&["-q", "combine", "a-b", &plate, &coarse, "-o", &out]).success();
    // (By centres, cells of 3 fill 2 x 2 x 2 or 3 x 3 x 3 of them.)
    let removed = 12500.0 - volume(&out);
    assert!((volume(&coarse) - removed).abs() < 5.0, "{removed}");
}

#[test]
fn bounds_of_turned_solids_are_those_of_their_cells() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let out = directory.join("out.goblin").to_str().unwrap().to_string();
    let solid = built(
        directory,
        "drilled",
        "difference(block(0,0,0, 4,4,2), cylinder(2,2,-1, 2,2,3, 1));",
        &["--cells", "32"],
    );
    transformed(&solid, &["rotate=30,z"], &out);
    let json = measures(&out);
    let (cells, bounds) = (&json["solid"]["bounds_cells"], &json["solid"]["bounds"]);
    // The cells at the border are turned: a cell of 0.125 reaches at most 0.125 * 1.4 beyond.
    for axis in 0..2 {
        let [low, high] = [0, 1].map(|side| bounds[side][axis].as_f64().unwrap());
        assert!((-0.18..=0.0).contains(&low) && (4.0..=4.18).contains(&high), "{bounds} {cells}");
    }
    assert_eq!([bounds[0][2].as_f64(), bounds[1][2].as_f64()], [Some(0.0), Some(2.0)]);
    // Against all corners of all cells.
    let text = stdout(&["stats", &out]);
    assert!(text.contains(&format!("bounds   {}", (bounds[0][0].as_f64().unwrap() * 1e6).round() / 1e6)));
}

#[test]
fn thin_solids_come_with_advice_that_works() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let slab = written(directory, "slab.off", &off([1000.0, 1000.0, 4.0]));
    let out = directory.join("slab.goblin").to_str().unwrap().to_string();
    let build = |more: &[&str]| {
        let run = spinney(&[&["build", &slab, "-o", &out], more].concat()).success();
        String::from_utf8(run.get_output().stdout.clone()).unwrap() + &stderr(run)
    };
    let text = build(&["--cells", "64"]);
    assert_eq!(volume(&out), 0.0);
    assert!(text.contains("the cells have a volume of 0, the surface encloses 4000000"), "{text}");
    assert!(text.contains("--edge area gives each cell its share"), "{text}");
    let cell = between(&text, "--cell ", " makes").to_string();
    assert!(!build(&["--cell", &cell]).contains("the cells have a volume"));
    assert!((volume(&out) / 4e6 - 1.0).abs() < 0.1, "--cell {cell}: {}", volume(&out));
    assert!(!build(&["--cells", "64", "--edge", "area"]).contains("the cells have a volume"));
    assert!((volume(&out) / 4e6 - 1.0).abs() < 0.05, "{}", volume(&out));
    // Not even half full: nothing is drawn, with a word.
    let image = directory.join("slab.png").to_str().unwrap().to_string();
    let text = stderr(spinney(&["render", &out, &image, "--size", "40x30"]).success());
    assert!(text.contains("no cell is at least half full"), "{text}");
    // A thick solid has no warning.
    written(directory, "slab.off", &off([10.0, 8.0, 6.0]));
    assert!(!build(&["--cells", "16"]).contains("the cells have a volume"));
}

#[test]
fn empty_solids_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let path = |name: &str| directory.join(name).to_str().unwrap().to_string();
    let model = written(directory, "box.off", &off([3.0, 2.0, 1.0]));
    let (exact, empty, image) = (path("exact.goblin"), path("empty.goblin"), path("empty.png"));
    spinney(&["-q", "build", &model, "--brep", "-o", &exact]).success();
    spinney(&["-q", "combine", "a-b", &exact, &exact, "-o", &empty]).success();
    let says = |arguments: &[&str], expected: &str| {
        let text = stderr(spinney(arguments).success());
        assert!(text.contains(expected), "{arguments:?}: {text}");
    };
    says(&["render", &empty, &image, "--size", "40x30"], "has no faces, so nothing is drawn");
    says(&["show", &empty, "--size", "40x30"], "has no faces, so nothing is drawn");
    let text = stderr(spinney(&["build", &empty, "-o", &path("cells.goblin")]).failure());
    assert!(text.contains("the model is empty") && !text.contains("corrupt"), "{text}");
    let cells = path("cells.goblin");
    spinney(&["-q", "build", &model, "--cells", "8", "-o", &cells]).success();
    let nothing = path("nothing.goblin");
    spinney(&["-q", "combine", "a-b", &cells, &cells, "-o", &nothing]).success();
    says(&["render", &nothing, &image, "--size", "40x30"], "the tree is empty, so nothing is drawn");
    says(&["show", &nothing, "--size", "40x30"], "the tree is empty, so nothing is drawn");
}

#[test]
fn edits_and_combinations_of_unlike_cells() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let path = |name: &str| directory.join(name).to_str().unwrap().to_string();
    // A hole of 4 x 4 through a plate of 20 x 10 x 4, whose cells are smaller and offset.
    let drill = built(directory, "drill", "block(5,3,-3, 9,7,8);", &["--cell", "0.4"]);
    let plate = path("plate.autumn");
    let source = written(directory, "plate.csg", "block(0,0,0, 20,10,4);");
    spinney(&["-q", "build", &source, "--cell", "0.5", "-o", &plate]).success();
    spinney(&["-q", "edit", &plate, "apply", "a-b", &drill]).success();
    let (found, exact) = (volume(&plate), 20.0 * 10.0 * 4.0 - 4.0 * 4.0 * 4.0);
    assert!((found / exact - 1.0).abs() < 0.02, "{found}");
    // Three trees: both holes.
    let solid = built(directory, "solid", "block(0,0,0, 20,10,4);", &["--cell", "0.5"]);
    let second = built(directory, "second", "block(12,3,-3, 14,5,8);", &["--cell", "0.5"]);
    let out = path("out.goblin");
    let combined = |operation: &str, files: &[&str]| {
        spinney(&[&["-q", "combine", operation], files, &["-o", &out]].concat()).success();
        volume(&out)
    };
    let first = built(directory, "first", "block(5,3,-3, 9,7,8);", &["--cell", "0.5"]);
    assert_eq!(combined("a-b", &[&solid, &first, &second]), 800.0 - 64.0 - 16.0);
    assert_eq!(combined("and", &[&solid, &solid, &first]), 64.0);
    assert_eq!(combined("xor", &[&solid, &solid, &first]), 4.0 * 4.0 * 11.0);
    assert_eq!(combined("or", &[&solid, &first, &second]), 800.0 + 16.0 * 7.0 + 4.0 * 7.0);
    let text =
        stderr(spinney(&["combine", "b", &solid, &first, &second, "-o", &path("no.goblin")]).failure());
    assert!(text.contains("got 3, expected two"), "{text}");
}

#[test]
fn polygons_with_octrees() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let path = |name: &str| directory.join(name).to_str().unwrap().to_string();
    let plate = built(directory, "plate", "block(0,0,0, 20,10,4);", &["--cell", "1"]);
    let zone = written(
        directory,
        "zone.geojson",
        r#"{"type":"FeatureCollection","features":[{"type":"Feature","properties":{},"geometry":
        {"type":"Polygon","coordinates":[[[2,2],[8,2],[8,6],[2,6],[2,2]]]}}]}"#,
    );
    let cut = path("cut.goblin");
    spinney(&["-q", "combine", "and", &plate, &zone, "-o", &cut]).success();
    assert_eq!(volume(&cut), 6.0 * 4.0 * 4.0);
    // A column of some heights is a solid of its own.
    let column = written(directory, "column.csg", "prism([[2,2],[8,2],[8,6],[2,6]], 1, 4);");
    let [cells, low] = ["column.goblin", "low.goblin"].map(path);
    spinney(&["-q", "build", &column, "--grid", &plate, "-o", &cells]).success();
    spinney(&["-q", "combine", "and", &plate, &cells, "-o", &low]).success();
    assert_eq!(volume(&low), 6.0 * 4.0 * 3.0);
    let tree = path("plate.autumn");
    spinney(&["-q", "convert", &plate, &tree]).success();
    spinney(&["-q", "edit", &tree, "fill", "--zones", &zone, "--void"]).success();
    assert_eq!(volume(&tree), 20.0 * 10.0 * 4.0 - 6.0 * 4.0 * 4.0);
}
