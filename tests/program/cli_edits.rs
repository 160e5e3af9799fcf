//! `spinney edit` and related commands: `log`, `diff`, `revert`, `compact`, `publish`, and `@N`
//! wherever a file is expected.

use std::path::PathBuf;

use crate::common::command::{peak_memory, spinney, stderr, stdout};
use crate::common::directory::TestDirectory;

const CLASSES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
const RGB: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_rgb.png");
const BALL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/ball.goblin");

/// Writes the island's classes in a new directory, to be edited.
fn island() -> TestDirectory {
    let temp = TestDirectory::new();
    temp.built(CLASSES, "i.autumn", &[]);
    temp
}

impl TestDirectory {
    fn edit(&self, arguments: &[&str]) {
        let file = self.name("i.autumn");
        let mut all = vec!["-q", "edit", &file];
        all.extend(arguments);
        spinney(&all).success();
    }

    /// Returns all values, row by row; 0 is VOID.
    fn values(&self, name: &str) -> Vec<u8> {
        let arguments = ["get", &self.name(name), "-", "--format", "raw", "--nodata", "0"];
        spinney(&arguments).success().get_output().stdout.clone()
    }
}

/// Returns the values after some of them are changed.
fn changed(values: &[u8], cell: impl Fn(usize, usize) -> Option<u8>) -> Vec<u8> {
    let cells = values.iter().enumerate();
    cells.map(|(i, value)| cell(i % 256, i / 256).unwrap_or(*value)).collect()
}

#[test]
fn edits_outside_of_the_extent_are_rejected() {
    let temp = island();
    let (file, far) = (temp.name("i.autumn"), temp.name("far.goblin"));
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
    temp.edit(&["fill", "--window", "250,190,100,100", "--value", "3"]);
}

#[test]
fn every_edit_has_its_effect() {
    let temp = island();
    let first = temp.values("i.autumn");
    let mut now = first.clone();
    let in_box = |x: usize, y: usize| (10..50).contains(&x) && (20..30).contains(&y);
    temp.edit(&["fill", "--window", "10,20,40,10", "--value", "3"]);
    now = changed(&now, |x, y| in_box(x, y).then_some(3));
    assert_eq!(temp.values("i.autumn"), now);
    temp.edit(&["fill", "--block", "/30", "--void"]);
    now = changed(&now, |x, y| ((128..192).contains(&x) && (128..192).contains(&y)).then_some(0));
    assert_eq!(temp.values("i.autumn"), now);
    // A triangle in world coordinates: cells are 50 m wide, from 300000, 3200000.
    temp.edit(&["fill", "--polygon", "300000,3200000 301000,3200000 300000,3199000", "--value", "2"]);
    now = changed(&now, |x, y| (x + y < 19).then_some(2));
    assert_eq!(temp.values("i.autumn")[..256 * 18], now[..256 * 18]);
    let inside = temp.values("i.autumn").iter().zip(&now).filter(|(a, b)| a != b).count();
    assert!(inside <= 20, "only cells on the triangle's long side are a matter of rounding: {inside}");
    now = temp.values("i.autumn");
    let cells = temp.name("cells.csv");
    std::fs::write(&cells, "0,0,7\n\n1 0 6\n255,199,5\n2,0,void\n0;0;4\n").unwrap();
    temp.edit(&["set", &cells]);
    (now[0], now[1], now[2], now[256 * 199 + 255]) = (4, 6, 0, 5);
    assert_eq!(temp.values("i.autumn"), now);
    // The image itself, at another position, and then at its own.
    temp.edit(&["paste", CLASSES, "--at", "-100,60"]);
    now = changed(&now, |x, y| {
        let old = if x + 100 < 256 && y >= 60 { first[(y - 60) * 256 + x + 100] } else { 0 };
        (old != 0).then_some(old)
    });
    assert_eq!(temp.values("i.autumn"), now);
    temp.edit(&["paste", CLASSES, "--void"]);
    assert_eq!(temp.values("i.autumn"), first);
    temp.edit(&["apply", "a-b", &format!("{}@2", temp.name("i.autumn"))]);
    assert!(temp.values("i.autumn").iter().all(|value| *value == 0));
    assert_eq!(stdout(&["verify", &temp.name("i.autumn")]), format!("{}: good\n", temp.name("i.autumn")));
}

#[test]
fn arrays_of_cells_are_set() {
    let temp = island();
    let header = "{'descr': '<i4', 'fortran_order': False, 'shape': (3, 3), }";
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(118u16.to_le_bytes());
    bytes.extend(format!("{header:117}\n").bytes());
    for number in [5i32, 6, 1, 7, 6, 2, 5, 6, 3] {
        bytes.extend(number.to_le_bytes());
    }
    let array = temp.name("cells.npy");
    std::fs::write(&array, &bytes).unwrap();
    temp.edit(&["set", &array]);
    let values = temp.values("i.autumn");
    assert_eq!(values[256 * 6 + 5..256 * 6 + 8][..3], [3, values[256 * 6 + 6], 2]);
    let file = temp.name("i.autumn");
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
fn history_is_listed_and_reverted() {
    let temp = island();
    let file = temp.name("i.autumn");
    let first = temp.values("i.autumn");
    let note = ["-m", "A wood\nof beeches", "--author", "Ann", "--time", "951782400"];
    temp.edit(&[&["fill", "--window", "0,0,100,100", "--value", "3"][..], &note].concat());
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
    assert_eq!(temp.values("i.autumn@1"), first);
    assert_ne!(temp.values("i.autumn"), first);
    for query in [&["info", &old][..], &["stats", &old], &["find", &old, "--class", "6"], &["verify", &old]] {
        spinney(query).success();
    }
    let changes: serde_json::Value = serde_json::from_str(&stdout(&["diff", &old, &file, "--json"])).unwrap();
    let differ = first.iter().zip(&temp.values("i.autumn")).filter(|(a, b)| a != b).count();
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
    let tree = temp.name("changes.goblin");
    spinney(&["-q", "diff", &old, &file, "-o", &tree]).success();
    spinney(&["-q", "revert", &file, "1"]).success();
    assert_eq!(temp.values("i.autumn"), first);
    let text = stderr(spinney(&["revert", &file, "3"]).success());
    assert!(text.contains("nothing has changed"), "{text}");
    // Fewer commits in a new file, with their old numbers.
    let small = temp.name("small.autumn");
    spinney(&["-q", "compact", &file, "-o", &small, "--commits", "1,2", "--share"]).success();
    assert_eq!(temp.values("small.autumn@1"), first);
    assert_eq!(temp.values("small.autumn"), temp.values("i.autumn@2"));
    let text = stderr(spinney(&["compact", &file, "-o", &file]).failure());
    assert!(text.contains("is an input and the output"), "{text}");
    let text = stderr(spinney(&["info", &format!("{file}@9")]).failure());
    assert!(text.contains("commit: got 9"), "{text}");
}

#[test]
fn publishing_and_back_gives_the_same_bytes() {
    let temp = island();
    let built = temp.name("built.goblin");
    spinney(&["-q", "build", CLASSES, "-o", &built]).success();
    let published = temp.name("published.goblin");
    spinney(&["-q", "convert", &temp.name("i.autumn"), &published]).success();
    assert!(std::fs::read(&built).unwrap() == std::fs::read(&published).unwrap());
    for share in [&["--share"][..], &[]] {
        let name = temp.name(&format!("{}.autumn", share.len()));
        spinney(&[&["-q", "convert", &built, &name], share].concat()).success();
        spinney(&["-q", "convert", &name, &published]).success();
        assert!(std::fs::read(&built).unwrap() == std::fs::read(&published).unwrap());
    }
    // Results of other commands can be edited, too.
    let turned = temp.name("turned.autumn");
    spinney(&["-q", "transform", &built, "rotate=90", "-o", &turned]).success();
    spinney(&["-q", "edit", &turned, "fill", "--window", "0,0,5,5", "--value", "1"]).success();
    let both = temp.name("both.autumn");
    spinney(&["-q", "combine", "union", &built, &format!("{turned}@1"), "-o", &both]).success();
    spinney(&["-q", "verify", &turned, &both]).success();
    let ball = temp.name("ball.autumn");
    spinney(&["-q", "convert", BALL, &ball, "--share"]).success();
    spinney(&["-q", "edit", &ball, "fill", "--window", "0,0,0,16,32,32", "--void"]).success();
    let solid = stdout(&["stats", &ball]);
    assert_ne!(solid, stdout(&["stats", &format!("{ball}@1")]));
    spinney(&["-q", "export", &ball, &temp.name("ball.ply")]).success();
}

#[test]
fn what_cannot_be_done_is_refused_and_changes_nothing() {
    let temp = island();
    let file = temp.name("i.autumn");
    let goblin = temp.name("i.goblin");
    spinney(&["-q", "convert", &file, &goblin]).success();
    let before = std::fs::read(&file).unwrap();
    let bad = temp.name("bad.csv");
    std::fs::write(&bad, "1,2,3\n1,2\n").unwrap();
    let outside = temp.name("outside.csv");
    std::fs::write(&outside, "256,0,3\n").unwrap();
    for (arguments, message) in [
        (&["edit", &goblin, "fill", "--window", "0,0,1,1", "--void"][..], "convert"),
        (
            &["edit", &file, "fill", "--window", "0,0,1,1", "--value", "300"],
            "value: got 300, expected a number that u8 can store",
        ),
        (&["edit", &file, "fill", "--window", "0,0,1,1", "--value", "1,2"], "a number that u8 can store"),
        (&["edit", &file, "fill", "--value", "1"], "--window"),
        (&["edit", &file, "fill", "--polygon", "1,1 9,1 9,9", "--void"], "it is inside with --in cells"),
        (
            &[
                "edit",
                &file,
                "fill",
                "--in",
                "cells",
                "--polygon",
                "303000,3194000 304000,3194000 304000,3195000",
                "--void",
            ],
            "which is 0,0,256,200; it is inside with --in world",
        ),
        (&["edit", &file, "fill", "--block", "/4", "--void"], "expected a node of this tree"),
        (&["edit", &file, "fill", "--polygon", "1,1 2,2", "--void"], "at least 3"),
        (&["edit", &file, "paste", RGB, "--at", "0,0"], "u8x3"),
        (&["edit", &file, "paste", RGB, "--at", "0,0"], RGB),
        (&["edit", &file, "paste", CLASSES, "--at", "256,0"], "outside"),
        (&["edit", &file, "paste", BALL, "--at", "0,0"], "octree"),
        (&["edit", &file, "paste", &file, "--at", "0,0"], "use one of its commits"),
        (
            &["edit", &file, "set", &bad],
            "bad.csv: line 2: got `1,2`, expected X,Y and a number, or X,Y and `void`",
        ),
        (&["edit", &file, "set", RGB], "content: found a PNG image, expected lines of text"),
        (&["edit", &file, "set", &outside], "a cell of an extent of [256, 200] cells"),
        (&["edit", &file, "apply", "cross", &goblin], "expected an operation that makes a tree"),
        (&["build", CLASSES, "-o", &file], "its history would be lost"),
        (&["build", CLASSES, "-o", &goblin, "--share"], ".autumn"),
        (&["build", &goblin, CLASSES, "-o", "x.autumn"], "build one tree for each"),
        (
            &["build", &goblin, &goblin, "-o", "x.autumn"],
            "expected one tree; `spinney combine over` merges trees",
        ),
        (&["compact", &file, "-o", &temp.name("small.goblin")], "ends with .autumn, such as"),
        (&["info", &format!("{goblin}@2")], "commit: got 2, expected none: a Goblin file has no commits"),
        (&["info", &format!("{file}@99")], "commit: got 99, expected 1, the only commit"),
        (&["log", &goblin], "Autumnal"),
        (&["edit", &temp.name("none.autumn"), "fill", "--window", "0,0,1,1", "--void"], "none.autumn"),
    ] {
        let text = stderr(spinney(arguments).failure());
        assert!(text.contains(message), "{arguments:?}: {text}");
    }
    // The last editor is noted in the first page, which is not content.
    let after = std::fs::read(&file).unwrap();
    assert!(before[4096..] == after[4096..before.len()]);
    assert_eq!(stdout(&["log", &file, "--json"]).matches("\"number\"").count(), 1);
    let names: Vec<PathBuf> =
        std::fs::read_dir(temp.root()).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(names.len(), 4, "{names:?}");
}

#[test]
#[cfg(target_os = "linux")]
fn conversions_stay_within_memory() {
    let temp = island();
    let (large, file, back) =
        (temp.name("large.goblin"), temp.name("large.autumn"), temp.name("back.goblin"));
    // 66 million cells, most of them next to other classes: the stored data far exceed the memory
    // limit.
    let noise = temp.name("noise.csv");
    let lines = (0..200_000u64).map(|i| {
        let hash = i.wrapping_mul(0x9E37_79B9_7F4A_7C15);
        format!("{},{},{}\n", hash >> 20 & 8191, hash >> 40 & 8191, i % 250 + 1)
    });
    std::fs::write(&noise, lines.collect::<String>()).unwrap();
    spinney(&["-q", "transform", &temp.name("i.autumn"), "scale=32,41", "-o", &large]).success();
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
        &["convert", &back, &temp.name("again.autumn"), "--share"],
        &["compact", &file, "-o", &temp.name("small.autumn"), "--keep", "2"],
    ] {
        let peak = run(&[arguments, &["--memory", "16M"]].concat());
        assert!(peak < cap, "{arguments:?}: {} MiB", peak >> 20);
    }
    // Reverting takes no memory and has no option for it.
    assert!(run(&["revert", &file, "1"]) < cap);
}
