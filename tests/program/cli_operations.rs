//! `spinney transform` and `spinney combine`, and queries through views.

use std::path::{Path, PathBuf};

use spinney::OpenOptions;
use spinney::raw::dataset;
use tempfile::TempDir;

use crate::common::command::{complaint, spinney, stderr, stdout};

/// Returns the island's classes, and a directory to work in.
fn island() -> (TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("island.goblin");
    let input = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
    spinney(&["-q", "build", input, "-o", file.to_str().unwrap()]).success();
    (directory, file)
}

fn cells(file: &Path) -> u64 {
    let tree = dataset::open(file, &OpenOptions::new()).unwrap();
    tree.statistics(None, &()).unwrap().cells
}

/// Returns all values of a raster, exported as raw samples.
fn raw(file: &str, more: &[&str]) -> Vec<u8> {
    let mut arguments = vec!["get", file, "-", "--format", "raw", "--nodata", "0"];
    arguments.extend(more);
    spinney(&arguments).success().get_output().stdout.clone()
}

#[test]
fn a_view_and_the_file_made_of_it_say_the_same() {
    let (directory, island) = island();
    let (file, out) = (island.to_str().unwrap(), directory.path().join("out.goblin"));
    let chains: [&[&str]; 8] = [
        &["calc='where(b1>=5,6,b1/2)',type=u8"],
        &["window=31,17,150,120", "calc=b1*2,type=u16", "mirror=y"],
        &["window=31,17,150,120"],
        &["rotate=90", "mirror=x"],
        &["rotate=30", "crop"],
        &["scale=0.4"],
        &["translate=5,7", "transpose"],
        &["window=303000,3194000,307000,3198000,in=world", "rotate=-12.5", "scale=1.5"],
    ];
    for chain in chains {
        let mut arguments = vec!["-q", "transform", file];
        arguments.extend(chain);
        arguments.extend(["-o", out.to_str().unwrap()]);
        spinney(&arguments).success();
        assert!(stdout(&["verify", out.to_str().unwrap()]).contains("good"), "{chain:?}");
        let views: Vec<&str> = chain.iter().flat_map(|step| ["--view", step]).collect();
        assert!(raw(file, &views) == raw(out.to_str().unwrap(), &[]), "{chain:?}");
        let mut stats = vec!["stats", file];
        stats.extend(&views);
        assert_eq!(stdout(&stats), stdout(&["stats", out.to_str().unwrap()]), "{chain:?}");
        let mut find = vec!["find", file, "--class", "6"];
        find.extend(&views);
        assert_eq!(stdout(&find), stdout(&["find", out.to_str().unwrap(), "--class", "6"]), "{chain:?}");
    }
    let point = stdout(&["point", file, "--view", "rotate=40", "305000,3196000"]);
    assert_eq!(point, stdout(&["point", file, "305000,3196000"]), "it stays where it is in the world");
    // Inputs of an operation are not overwritten.
    let step = format!("calc=b1-a,a={}", out.display());
    let refused = complaint(&["transform", file, &step, "-o", out.to_str().unwrap()], 1);
    assert!(refused.contains("out.goblin"), "{refused}");
}

#[test]
fn sets_and_values() {
    let (directory, island) = island();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (a, b) = (island.to_str().unwrap().to_string(), path("b.goblin"));
    spinney(&["-q", "transform", &a, "translate=20,11", "--move", "-o", &b]).success();
    let combined = |operation: &str| {
        let out = path("out.goblin");
        spinney(&["-q", "combine", operation, &a, &b, "-o", &out]).success();
        assert!(stdout(&["verify", &out]).contains("good"), "{operation}");
        cells(Path::new(&out))
    };
    let (both, either) = (combined("and"), combined("union"));
    let whole = (cells(&island), cells(Path::new(&b)));
    assert_eq!(both + either, whole.0 + whole.1);
    assert_eq!(combined("xor"), either - both);
    assert_eq!(combined("a-b"), whole.0 - both);
    assert_eq!(combined("4"), whole.1 - both);
    assert_eq!(combined("equal") + combined("changed"), either);
    assert_eq!(combined("nand") + both, 276 * 211);
    let table = stdout(&["combine", "cross", &a, &b, "--json"]);
    let rows: serde_json::Value = serde_json::from_str(&table).unwrap();
    let sum: u64 = rows.as_array().unwrap().iter().map(|row| row["cells"].as_u64().unwrap()).sum();
    assert_eq!(sum, either);
    assert!(stdout(&["combine", "cross", &a, &b]).lines().count() > 10);
    // Aligned by frames, whatever was cut off.
    let (left, right, whole) = (path("left.goblin"), path("right.goblin"), path("whole.goblin"));
    spinney(&["-q", "transform", &a, "window=0,0,101,200", "-o", &left]).success();
    spinney(&["-q", "transform", &a, "window=101,0,155,200", "-o", &right]).success();
    spinney(&["-q", "combine", "union", &right, &left, "-o", &whole]).success();
    assert!(raw(&whole, &[]) == raw(&a, &[]));
    // Coarser cells count as blocks of fine ones.
    let coarse = path("coarse.goblin");
    spinney(&["-q", "transform", &a, "depth=7", "-o", &coarse]).success();
    spinney(&["-q", "combine", "mask", &a, &coarse, "-o", &whole]).success();
    assert_eq!(cells(Path::new(&whole)), cells(&island));
}

#[test]
fn refusals() {
    let (directory, island) = island();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (a, out) = (island.to_str().unwrap().to_string(), path("out.goblin"));
    let before = std::fs::read(&island).unwrap();
    let relief = path("relief.goblin");
    let input = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_elevation.tif");
    spinney(&["-q", "build", input, "-o", &relief]).success();
    let says = |arguments: &[&str], code: i32, words: &[&str]| {
        let text = stderr(spinney(arguments).code(code));
        assert!(words.iter().all(|word| text.contains(word)), "{arguments:?}: {text}");
        assert!(!Path::new(&out).exists());
    };
    says(&["transform", &a, "crop", "-o", &a], 1, &["input and the output"]);
    says(&["combine", "union", &relief, &a, "-o", &a], 1, &["input and the output"]);
    says(&["transform", &a, &format!("like={relief}"), "-o", &relief], 1, &["input and the output"]);
    says(&["combine", "unite", &a, &a, "-o", &out], 2, &["unknown operation"]);
    says(&["combine", "and", &a, "-o", &out], 1, &["two"]);
    says(&["combine", "cross", &a, &a, "-o", &out], 1, &["table"]);
    says(&["combine", "union", &a, &a], 1, &["--output"]);
    for step in ["spin=3", "window=1,2,3", "window=0,0,0,5", "scale=0", "rotate=x", "embed=/9", "affine=1,2"]
    {
        says(&["transform", &a, step, "-o", &out], 2, &["operation", step]);
    }
    for step in
        ["window=400,0,5,5", "translate=-300,0", "affine=1,1,0,1,1,0", "subtree=/0123012301", "depth=40"]
    {
        says(&["transform", &a, step, "-o", &out], 1, &["got", "expected"]);
    }
    says(&["transform", &path("none.goblin"), "-o", &out], 1, &["none.goblin", "cannot open"]);
    // Disjoint trees, as in two coordinate systems.
    let far = path("far.goblin");
    let classes = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
    spinney(&["-q", "build", classes, "--transform", "10,0,9e7,0,-10,9e7", "-o", &far]).success();
    for part in ["a", "intersection"] {
        let like = format!("like={far},extent={part}");
        says(&["transform", &a, &like, "-o", &out], 1, &["extent=union"]);
    }
    says(
        &["combine", "and", &a, &far, "--extent", "intersection", "-o", &out],
        1,
        &["--extent union", "share"],
    );
    // Boxes of the world, where cells are expected.
    for step in ["window=303000,3194000,304000,3195000", "window=303000,3194000,1000,1000"] {
        says(&["transform", &relief, step, "-o", &out], 1, &["the 256 x 200 cells", "append ,in=world"]);
    }
    says(
        &["transform", &relief, "warp=EPSG:3035,cel=30", "-o", &out],
        2,
        &["parameter of warp=: got `cel`, expected cell or resampling"],
    );
    // Commands name only formats and options that they have.
    let zones = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_districts.geojson");
    for words in [
        &["stats", &relief, "--zones", zones, "-o", &path("x.foo")][..],
        &["transform", zones, "warp=EPSG:3035", "-o", &path("x.foo")],
        &["combine", "and", zones, zones, "-o", &out],
    ] {
        says(words, 1, &[".gpkg"]);
        assert!(!complaint(words, 1).contains("--format"), "{words:?}");
    }
    says(&["combine", "and", zones, zones, "-o", &out], 1, &["the inputs are polygon files"]);
    says(&["export", &relief, &path("x.ply")], 1, &["is a quadtree", "add --tin ERROR"]);
    says(&["export", &relief, &path("x.glb")], 1, &["is a quadtree", "add --tin ERROR"]);
    says(&["export", &a, &path("x.gpkg")], 1, &["add --polygons"]);
    for name in ["x.png", "x.las", "x.npy"] {
        says(&["export", &relief, &path(name)], 1, &["use `spinney get"]);
    }
    says(&["export", &a, "-", "--format", "pmtiles"], 2, &["expected tif, chain", "geojson", "x.pmtiles"]);
    says(&["export", &a, "-", "--format", "geojson"], 1, &["add --polygons"]);
    says(&["export", &a, "-", "--format", "tif", "--polygons"], 1, &["--polygons only as geojson"]);
    let named = path("named.geojson");
    spinney(&["-q", "export", &a, &named, "--polygons"]).success();
    let printed = stdout(&["-q", "export", &a, "-", "--polygons", "--format", "geojson"]);
    assert!(printed == std::fs::read_to_string(&named).unwrap());
    // Directories, as inputs and of outputs.
    let directory = directory.path().to_str().unwrap();
    for command in ["info", "stats", "log"] {
        says(&[command, directory], 1, &[directory, "is a directory, expected a file"]);
    }
    says(&["verify", directory], 1, &[directory, "3D Tiles are not checked"]);
    for name in ["none/x.goblin", "none/x.autumn"] {
        let message = complaint(&["build", input, "-o", &path(name)], 1);
        let expected = format!("the directory {} does not exist", path("none"));
        assert!(message.contains(&expected) && !message.contains(".partial"), "{message}");
    }
    assert_eq!(std::fs::read(&island).unwrap(), before);
}

#[test]
fn empty_results_are_warned_of() {
    let (directory, island) = island();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (relief, points) = (path("relief.goblin"), path("points.goblin"));
    let fixture = |name: &str| format!("{}/fixtures/{name}", env!("CARGO_MANIFEST_DIR"));
    spinney(&["-q", "build", &fixture("island_elevation.tif"), "-o", &relief]).success();
    spinney(&["-q", "build", &fixture("island_points.laz"), "-o", &points]).success();
    let mesh = path("box.off");
    std::fs::write(&mesh, "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n")
        .unwrap();
    let model = path("model.goblin");
    spinney(&["-q", "build", &mesh, "-o", &model, "--brep"]).success();
    let island = island.to_str().unwrap();
    for (words, expected) in [
        (&["find", island, "--class", "99"][..], "no cell satisfies the condition; values of the file are"),
        (&["find", &relief, "--above", "9000"], "no cell satisfies the condition; values of the file are"),
        (&["contours", &relief, "--at", "9000", "-o", &path("c.geojson")], "has no lines: values are"),
        (&["section", &model, "z=100", "-o", &path("s.svg")], "no plane cuts the model"),
        (&["get", &points, &path("p.csv"), "--in", "world", "--window", "0,0,1,1"], "has no points"),
        (&["export", island, &path("p.geojson"), "--polygons", "--class", "99"], "has no polygons"),
        (
            &[
                "build",
                &fixture("island_points.laz"),
                "-o",
                &path("e.goblin"),
                "--where",
                "classification=77",
            ],
            "no point satisfies the conditions",
        ),
    ] {
        let message = stderr(spinney(words).success());
        assert!(message.contains("warning") && message.contains(expected), "{words:?}: {message}");
    }
    assert!(
        !stderr(spinney(&["find", &relief, "--above", "0", "--limit", "0"]).success()).contains("warning")
    );
}
