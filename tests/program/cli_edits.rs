//! `spinney edit` and related commands: `log`, `diff`, `revert`, `compact`, `publish`, and `@N`
//! wherever a file is expected.

use std::path::PathBuf;

use tempfile::TempDir;

use crate::common::command::{peak_memory, spinney, stderr, stdout};

const CLASSES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
const RGB: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_rgb.png");
const BALL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/ball.goblin");

struct Place {
    folder: TempDir,
}

impl Place {
    /// Writes the island's classes, to be edited.
    fn new() -> Place {
        let place = Place { folder: tempfile::tempdir().unwrap() };
        spinney(&["-q", "build", CLASSES, "-o", &place.at("i.autumn")]).success();
        place
    }

    fn at(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_string()
    }

    fn edit(&self, arguments: &[&str]) {
        let file = self.at("i.autumn");
        let mut all = vec!["-q", "edit", &file];
        all.extend(arguments);
        spinney(&all).success();
    }

    /// Returns all values, row by row; 0 is VOID.
    fn values(&self, name: &str) -> Vec<u8> {
        let arguments = ["get", &self.at(name), "-", "--format", "raw", "--nodata", "0"];
        spinney(&arguments).success().get_output().stdout.clone()
    }
}

/// Returns the values after some of them are changed.
fn changed(values: &[u8], cell: impl Fn(usize, usize) -> Option<u8>) -> Vec<u8> {
    let cells = values.iter().enumerate();
    cells.map(|(i, value)| cell(i % 256, i / 256).unwrap_or(*value)).collect()
}

#[test]
fn edits_outside_of_the_picture_are_refused() {
    let place = Place::new();
    let (file, far) = (place.at("i.autumn"), place.at("far.goblin"));
    let moved = ["--transform", "50,0,900000,0,-50,3200000"];
    spinney(&[&["build", "-q", CLASSES, "-o", &far][..], &moved].concat()).success();
    for edit in [
        &["fill", "--window", "256,0,9,9", "--value", "3"][..],
        &["fill", "--window", "0,200,9,9", "--void"],
        &["fill", "--in", "world", "--window", "0,0,10,10", "--value", "3"],
        // In the tree's space, but below the last row.
        &["fill", "--block", "/333", "--value", "3"],
        &["fill", "--polygon", "0,0 10,0 0,10", "--value", "3"],
        &["fill", "--polygon", "400000,3195000 410000,3195000 400000,3190000", "--value", "3"],
        &["paste", CLASSES, "--at", "256,0"],
        &["paste", &far],
        &["apply", "union", &far],
    ] {
        let said = stderr(spinney(&[&["edit", &file][..], edit].concat()).code(1));
        assert!(said.contains("outside"), "{edit:?}: {said}");
    }
    assert!(stdout(&["info", &file]).contains("commit      1"));
    // Partially inside: the inner cells are filled.
    place.edit(&["fill", "--window", "250,190,100,100", "--value", "3"]);
}

#[test]
fn every_edit_does_what_it_says() {
    let place = Place::new();
    let first = place.values("i.autumn");
    let mut now = first.clone();
    let in_box = |x: usize, y: usize| (10..50).contains(&x) && (20..30).contains(&y);
    place.edit(&["fill", "--window", "10,20,40,10", "--value", "3"]);
    now = changed(&now, |x, y| in_box(x, y).then_some(3));
    assert_eq!(place.values("i.autumn"), now);
    place.edit(&["fill", "--block", "/30", "--void"]);
    now = changed(&now, |x, y| ((128..192).contains(&x) && (128..192).contains(&y)).then_some(0));
    assert_eq!(place.values("i.autumn"), now);
    // A triangle in world coordinates: cells are 50 m wide, from 300000, 3200000.
    place.edit(&["fill", "--polygon", "300000,3200000 301000,3200000 300000,3199000", "--value", "2"]);
    now = changed(&now, |x, y| (x + y < 19).then_some(2));
    assert_eq!(place.values("i.autumn")[..256 * 18], now[..256 * 18]);
    let inside = place.values("i.autumn").iter().zip(&now).filter(|(a, b)| a != b).count();
    assert!(inside <= 20, "only cells on the triangle's long side are a matter of rounding: {inside}");
    now = place.values("i.autumn");
    let cells = place.at("cells.csv");
    std::fs::write(&cells, "0,0,7\n\n1 0 6\n255,199,5\n2,0,void\n0;0;4\n").unwrap();
    place.edit(&["set", &cells]);
    (now[0], now[1], now[2], now[256 * 199 + 255]) = (4, 6, 0, 5);
    assert_eq!(place.values("i.autumn"), now);
    // The image itself, at another position, and then at its own.
    place.edit(&["paste", CLASSES, "--at", "-100,60"]);
    now = changed(&now, |x, y| {
        let old = if x + 100 < 256 && y >= 60 { first[(y - 60) * 256 + x + 100] } else { 0 };
        (old != 0).then_some(old)
    });
    assert_eq!(place.values("i.autumn"), now);
    place.edit(&["paste", CLASSES, "--void"]);
    assert_eq!(place.values("i.autumn"), first);
    place.edit(&["apply", "a-b", &format!("{}@2", place.at("i.autumn"))]);
    assert!(place.values("i.autumn").iter().all(|value| *value == 0));
    assert_eq!(stdout(&["verify", &place.at("i.autumn")]), format!("{}: good\n", place.at("i.autumn")));
}

#[test]
fn arrays_of_cells_are_set() {
    let place = Place::new();
    let header = "{'descr': '<i4', 'fortran_order': False, 'shape': (3, 3), }";
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(118u16.to_le_bytes());
    bytes.extend(format!("{header:117}\n").bytes());
    for number in [5i32, 6, 1, 7, 6, 2, 5, 6, 3] {
        bytes.extend(number.to_le_bytes());
    }
    let array = place.at("cells.npy");
    std::fs::write(&array, &bytes).unwrap();
    place.edit(&["set", &array]);
    let values = place.values("i.autumn");
    assert_eq!(values[256 * 6 + 5..256 * 6 + 8][..3], [3, values[256 * 6 + 6], 2]);
    let file = place.at("i.autumn");
    for (bytes, message) in [
        (bytes[..bytes.len() - 3].to_vec(), "read"),
        ([&bytes[..10], header.replace("(3, 3)", "(9,)").as_bytes(), &[b' '; 90]].concat(), "array"),
        (bytes.iter().map(|byte| if *byte == b'<' { b'>' } else { *byte }).collect(), "`>i4`"),
    ] {
        std::fs::write(&array, bytes).unwrap();
        let text = stderr(spinney(&["edit", &file, "set", &array]).failure());
        assert!(text.contains(message), "{text}");
    }
    assert_eq!(stdout(&["log", &file, "--json"]).matches("\"number\"").count(), 2);
}

#[test]
fn history_is_told_and_gone_back_in() {
    let place = Place::new();
    let file = place.at("i.autumn");
    let first = place.values("i.autumn");
    let note = ["-m", "A wood\nof beeches", "--author", "Ann", "--time", "951782400"];
    place.edit(&[&["fill", "--window", "0,0,100,100", "--value", "3"][..], &note].concat());
    let log = stdout(&["log", &file]);
    assert!(log.starts_with("     2, 2000-02-29 00:00:00, Ann: A wood\n       of beeches\n"), "{log}");
    let json: serde_json::Value =
        serde_json::from_str(&stdout(&["log", &file, "--json", "--limit", "1"])).unwrap();
    assert_eq!(json[0]["author"], "Ann");
    assert_eq!(json[0]["time"], 951_782_400);
    let info: serde_json::Value = serde_json::from_str(&stdout(&["info", &file, "--json"])).unwrap();
    assert_eq!((&info["format"], &info["commit"]["number"]), (&"Autumnal".into(), &2.into()));
    // Every query works on any commit.
    let old = format!("{file}@1");
    assert_eq!(place.values("i.autumn@1"), first);
    assert_ne!(place.values("i.autumn"), first);
    for question in
        [&["info", &old][..], &["stats", &old], &["find", &old, "--class", "6"], &["verify", &old]]
    {
        spinney(question).success();
    }
    let changes: serde_json::Value = serde_json::from_str(&stdout(&["diff", &old, &file, "--json"])).unwrap();
    let differ = first.iter().zip(&place.values("i.autumn")).filter(|(a, b)| a != b).count();
    assert_eq!(changes["added"].as_u64().unwrap() + changes["changed"].as_u64().unwrap(), differ as u64);
    let ranges = stdout(&["diff", &old, &file, "--ranges"]);
    let cells: u64 = ranges
        .lines()
        .map(|line| {
            line.split_once(' ')
                .map(|(a, b)| b.parse::<u64>().unwrap() - a.parse::<u64>().unwrap() + 1)
                .unwrap()
        })
        .sum();
    assert_eq!(cells, differ as u64);
    let tree = place.at("changes.goblin");
    spinney(&["-q", "diff", &old, &file, "-o", &tree]).success();
    spinney(&["-q", "revert", &file, "1"]).success();
    assert_eq!(place.values("i.autumn"), first);
    let text = stderr(spinney(&["revert", &file, "3"]).success());
    assert!(text.contains("nothing has changed"), "{text}");
    // Fewer commits in a new file, with their old numbers.
    let small = place.at("small.autumn");
    spinney(&["-q", "compact", &file, "-o", &small, "--commits", "1,2", "--share"]).success();
    assert_eq!(place.values("small.autumn@1"), first);
    assert_eq!(place.values("small.autumn"), place.values("i.autumn@2"));
    let text = stderr(spinney(&["compact", &file, "-o", &file]).failure());
    assert!(text.contains("is an input and the output"), "{text}");
    let text = stderr(spinney(&["info", &format!("{file}@9")]).failure());
    assert!(text.contains("commit: got 9"), "{text}");
}

#[test]
fn publishing_and_back_gives_the_same_bytes() {
    let place = Place::new();
    let built = place.at("built.goblin");
    spinney(&["-q", "build", CLASSES, "-o", &built]).success();
    let published = place.at("published.goblin");
    spinney(&["-q", "convert", &place.at("i.autumn"), &published]).success();
    assert!(std::fs::read(&built).unwrap() == std::fs::read(&published).unwrap());
    for share in [&["--share"][..], &[]] {
        let name = place.at(&format!("{}.autumn", share.len()));
        spinney(&[&["-q", "convert", &built, &name], share].concat()).success();
        spinney(&["-q", "convert", &name, &published]).success();
        assert!(std::fs::read(&built).unwrap() == std::fs::read(&published).unwrap());
    }
    // Results of other commands can be edited, too.
    let turned = place.at("turned.autumn");
    spinney(&["-q", "transform", &built, "rotate=90", "-o", &turned]).success();
    spinney(&["-q", "edit", &turned, "fill", "--window", "0,0,5,5", "--value", "1"]).success();
    let both = place.at("both.autumn");
    spinney(&["-q", "combine", "union", &built, &format!("{turned}@1"), "-o", &both]).success();
    spinney(&["-q", "verify", &turned, &both]).success();
    let ball = place.at("ball.autumn");
    spinney(&["-q", "convert", BALL, &ball, "--share"]).success();
    spinney(&["-q", "edit", &ball, "fill", "--window", "0,0,0,16,32,32", "--void"]).success();
    let solid = stdout(&["stats", &ball]);
    assert_ne!(solid, stdout(&["stats", &format!("{ball}@1")]));
    spinney(&["-q", "export", &ball, &place.at("ball.ply")]).success();
}

#[test]
fn what_cannot_be_done_is_refused_and_changes_nothing() {
    let place = Place::new();
    let file = place.at("i.autumn");
    let goblin = place.at("i.goblin");
    spinney(&["-q", "convert", &file, &goblin]).success();
    let before = std::fs::read(&file).unwrap();
    let bad = place.at("bad.csv");
    std::fs::write(&bad, "1,2,3\n1,2\n").unwrap();
    let outside = place.at("outside.csv");
    std::fs::write(&outside, "256,0,3\n").unwrap();
    for (arguments, message) in [
        (&["edit", &goblin, "fill", "--window", "0,0,1,1", "--void"][..], "convert"),
        (&["edit", &file, "fill", "--window", "0,0,1,1", "--value", "300"], "numbers that u8 can hold"),
        (&["edit", &file, "fill", "--window", "0,0,1,1", "--value", "1,2"], "numbers that u8 can hold"),
        (&["edit", &file, "fill", "--value", "1"], "--window"),
        (&["edit", &file, "fill", "--block", "/4", "--void"], "no node"),
        (&["edit", &file, "fill", "--polygon", "1,1 2,2", "--void"], "three or more"),
        (&["edit", &file, "paste", RGB, "--at", "0,0"], "u8x3"),
        (&["edit", &file, "paste", RGB, "--at", "0,0"], RGB),
        (&["edit", &file, "paste", CLASSES, "--at", "256,0"], "outside"),
        (&["edit", &file, "paste", BALL, "--at", "0,0"], "octree"),
        (&["edit", &file, "paste", &file, "--at", "0,0"], "name a commit"),
        (&["edit", &file, "set", &bad], "line 2"),
        (&["edit", &file, "set", &outside], "one of [256, 200] cells"),
        (&["edit", &file, "apply", "cross", &goblin], "no operation that makes a tree"),
        (&["build", CLASSES, "-o", &file], "its history would be lost"),
        (&["build", CLASSES, "-o", &goblin, "--share"], ".autumn"),
        (&["build", &goblin, CLASSES, "-o", "x.autumn"], "`spinney combine` lays trees over each other"),
        (&["log", &goblin], "Autumnal"),
        (&["edit", &place.at("none.autumn"), "fill", "--window", "0,0,1,1", "--void"], "none.autumn"),
    ] {
        let text = stderr(spinney(arguments).failure());
        assert!(text.contains(message), "{arguments:?}: {text}");
    }
    // The last editor is noted in the first page, which is not content.
    let after = std::fs::read(&file).unwrap();
    assert!(before[4096..] == after[4096..before.len()]);
    assert_eq!(stdout(&["log", &file, "--json"]).matches("\"number\"").count(), 1);
    let names: Vec<PathBuf> =
        std::fs::read_dir(place.folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(names.len(), 4, "{names:?}");
}

#[test]
#[cfg(target_os = "linux")]
fn conversions_stay_within_memory() {
    let place = Place::new();
    let (large, file, back) = (place.at("large.goblin"), place.at("large.autumn"), place.at("back.goblin"));
    // 66 million cells, most of them next to other classes: the stored data far exceed the memory
    // limit.
    let noise = place.at("noise.csv");
    let lines = (0..200_000u64).map(|i| {
        let place = i.wrapping_mul(0x9E37_79B9_7F4A_7C15);
        format!("{},{},{}\n", place >> 20 & 8191, place >> 40 & 8191, i % 250 + 1)
    });
    std::fs::write(&noise, lines.collect::<String>()).unwrap();
    spinney(&["-q", "transform", &place.at("i.autumn"), "scale=32,41", "-o", &large]).success();
    spinney(&["-q", "convert", &large, &file]).success();
    let program = || std::process::Command::new(env!("CARGO_BIN_EXE_spinney"));
    let run = |arguments: &[&str]| {
        let mut child = program().args(arguments).args(["-q", "--threads", "2"]).spawn().unwrap();
        peak_memory(&mut child)
    };
    let cap = 72 << 20;
    for arguments in [
        &["edit", &file, "set", &noise][..],
        &["convert", &file, &back],
        &["convert", &back, &place.at("again.autumn"), "--share"],
        &["compact", &file, "-o", &place.at("small.autumn"), "--keep", "2"],
    ] {
        let peak = run(&[arguments, &["--memory", "16M"]].concat());
        assert!(peak < cap, "{arguments:?}: {} MiB", peak >> 20);
    }
    // Reverting takes no memory and has no option for it.
    assert!(run(&["revert", &file, "1"]) < cap);
}
