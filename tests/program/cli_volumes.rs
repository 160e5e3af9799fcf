//! `spinney build` of volumes.

use std::fs;

use crate::common::command::{complaint, spinney, stderr, stdout};
use crate::common::mesh_file::read_ply;

/// Returns an array in which values decrease from the centre by 1 per cell.
fn ball() -> Vec<u8> {
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (44, 36, 40), }";
    let mut bytes = b"\x93NUMPY\x01\0\x76\0".to_vec();
    bytes.extend(format!("{header:117}\n").bytes());
    let square = |at: u32, middle: f32| (at as f32 + 0.5 - middle).powi(2);
    for z in 0..44 {
        for y in 0..36 {
            for x in 0..40 {
                let away = (square(x, 20.0) + square(y, 18.0) + square(z, 22.0)).sqrt();
                bytes.extend((16.0 - away).to_le_bytes());
            }
        }
    }
    bytes
}

#[test]
fn a_volume_becomes_a_tree_an_array_and_a_surface() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [array, tree, back, surface] = ["ball.npy", "ball.goblin", "back.npy", "ball.ply"].map(at);
    fs::write(&array, ball()).unwrap();
    spinney(&["-q", "build", &array, "-o", &tree, "--transform", "0.5,0.5,2"]).success();
    spinney(&["-q", "get", &tree, &back, "--window", "0,0,0,40,36,44"]).success();
    assert!(fs::read(&back).unwrap() == ball());
    spinney(&["-q", "contours", &tree, "--at", "6", "-o", &surface]).success();
    let read = read_ply(&fs::read(&surface).unwrap());
    read.check_closed("ball");
    let expected = std::f64::consts::PI * 1000.0 * 4.0 / 3.0 * 0.5;
    assert!((read.volume() / expected - 1.0).abs() < 0.01, "{}, not {expected}", read.volume());
    spinney(&["-q", "build", &array, "-o", &at("ball.autumn"), "--share", "--depth", "7"]).success();
    spinney(&["-q", "verify", &at("ball.autumn")]).success();
}

#[test]
fn options_without_a_meaning_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (array, tree) = (at("ball.npy"), at("ball.goblin"));
    fs::write(&array, ball()).unwrap();
    for (options, expected) in [
        (&["--band", "1"][..], "have no effect on volumes"),
        (&["--keep-transparent"], "have no effect on volumes"),
        (&["--grid", "xyz"], "have no effect on volumes"),
        (&["--max-zoom", "3"], "have no effect on volumes"),
        (&["--cells", "64"], "is not a model"),
        (&["--transform", "1,0,0,0,1,0"], "expected 3 numbers for a volume"),
        (&["--transform", "1,0,1"], "an invertible map"),
        (&["--depth", "5"], "6 to 19"),
        (&["--share"], ".autumn"),
        (&[&array], "got 2 inputs, expected one volume"),
    ] {
        let text = complaint(&[&["build", &array, "-o", &tree], options].concat(), 1);
        assert!(text.contains(expected), "{options:?}: {text}");
    }
    let text = complaint(&["build", &array, "-o", &tree, "--transform", "1,2"], 2);
    assert!(text.contains("for volumes 3 or 12"), "{text}");
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
}

#[test]
fn samples_alone_sections_and_nrrd_become_trees() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [raw, tree, nrrd, again, sections] = ["a.raw", "a.goblin", "a.nrrd", "b.goblin", "sections"].map(at);
    let samples: Vec<u8> = (0..4 * 3 * 2u16).flat_map(|number| (number * 300).to_be_bytes()).collect();
    fs::write(&raw, [&[9; 5][..], &samples].concat()).unwrap();
    let size = ["--raw-size", "4,3,2", "--raw-type", "u16", "--raw-skip", "5", "--big-endian"];
    let transform = ["--transform", "0.5,0.5,2"];
    spinney(&[&["build", &raw, "-o", &tree], &size[..], &transform].concat()).success();
    spinney(&["get", &tree, &nrrd]).success();
    spinney(&["build", &nrrd, "-o", &again]).success();
    let printed = |path: &str| stdout(&["point", path, "1.75,1.25,3", "--json"]);
    assert!(printed(&tree).contains("6900"), "{}", printed(&tree));
    assert_eq!(printed(&tree), printed(&again));
    let back = at("back.raw");
    spinney(&["get", &again, &back]).success();
    let little: Vec<u8> = samples.chunks(2).flat_map(|pair| [pair[1], pair[0]]).collect();
    assert_eq!(fs::read(&back).unwrap(), little);
    fs::create_dir(&sections).unwrap();
    for z in 0..2 {
        let slice = format!("z={z}");
        stdout(&["get", &tree, &format!("{sections}/{}.png", z + 9), "--slice", &slice]);
    }
    spinney(&[&["build", &sections, "-o", &again, "--pages", "z"][..], &transform].concat()).success();
    assert_eq!(printed(&tree), printed(&again));

    for (arguments, expected) in [
        (&["--raw-size", "4,3", "--raw-type", "u16"][..], "expected cells along x, y and z"),
        (&["--raw-size", "4,3,2", "--raw-type", "u12"], "expected u8, i8"),
        (&["--raw-size", "4,3,2"], "--raw-type"),
        (&["--big-endian"], "--raw-size"),
        (&["--raw-size", "4,3,2", "--raw-type", "u16"], "a.raw: the whole file: found 53 bytes, expected 48"),
        (&["--raw-size", "4,3,2", "--raw-type", "u16", "--pages", "z"], "got both, expected one"),
        (&["--raw-size", "4,3,2", "--raw-type", "u16", "--band", "1"], "have no effect on volumes"),
    ] {
        let printed = stderr(spinney(&[&["build", &raw, "-o", &tree], arguments].concat()).failure());
        assert!(printed.contains(expected), "{arguments:?}: {printed}");
    }
    let printed = stderr(spinney(&["build", &raw, &nrrd, "-o", &tree]).failure());
    assert!(printed.contains("got 2 inputs, expected one volume"), "{printed}");
    let printed = stderr(spinney(&["get", "fixtures/v1/classes.goblin", &nrrd]).failure());
    assert!(printed.contains("an image in an NRRD file"), "{printed}");
}
