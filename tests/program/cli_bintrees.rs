//! `spinney dump --as bintree`, and `spinney build` of its output.

use std::fs;

use crate::common::command::{complaint, spinney, stdout};

#[test]
fn dumps_are_built_to_the_same_tree() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let fixture = |name: &str| format!("{}/fixtures/{name}", env!("CARGO_MANIFEST_DIR"));
    spinney(&["-q", "build", &fixture("island_elevation.tif"), "-o", &path("heights.goblin")]).success();
    for tree in [
        fixture("v1/classes.goblin"),
        fixture("v1/rgba.goblin"),
        fixture("v1/ball.goblin"),
        path("heights.goblin"),
    ] {
        for more in [&[][..], &["--adaptive"]] {
            let text = stdout(&[&["dump", &tree, "--as", "bintree"], more].concat());
            assert_eq!(text.lines().count(), 1);
            fs::write(path("text.bintree"), &text).unwrap();
            spinney(&["-q", "build", &path("text.bintree"), "-o", &path("again.goblin")]).success();
            assert_eq!(
                stdout(&["dump", &path("again.goblin"), "--codes"]),
                stdout(&["dump", &tree, "--codes"])
            );
            assert_eq!(stdout(&[&["dump", &path("again.goblin"), "--as", "bintree"], more].concat()), text);
        }
    }
    assert!(
        stdout(&["dump", &path("again.goblin"), "--as", "bintree"])
            .starts_with("bintree:alternating:xy:8:f32:256x200 G")
    );
    // Through a view.
    let turned = stdout(&["dump", &fixture("v1/classic.goblin"), "--as", "bintree", "--view", "rotate=180"]);
    assert!(turned.starts_with("bintree:alternating:xy:3:u8:8x8 GG"), "{turned}");
}

#[test]
fn invalid_bintrees_are_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let (text, tree) = (path("text.bintree"), path("tree.goblin"));
    let refused = |bytes: &[u8], more: &[&str]| {
        fs::write(&text, bytes).unwrap();
        complaint(&[&["build", &text, "-o", &tree], more].concat(), 1)
    };
    let good = b"bintree:alternating:xy:3:u8:8x8 G1W";
    for (bytes, expected) in [
        (&b""[..], "byte 0: got its end"),
        (b"\xff", "got invalid UTF-8 at byte 0"),
        (b"bintree:alternating:xy:3:u8:8x8 G1", "byte 34: got its end, expected both halves of every node"),
    ] {
        let said = refused(bytes, &[]);
        assert!(said.contains("text.bintree") && said.contains(expected), "{said}");
    }
    for (more, expected) in [
        (&["--nodata", "0"][..], "--nodata"),
        (&["--depth", "5"], "--depth"),
        (&["--grid", "xyz"], "--grid"),
        (&["--cells", "64"], "which --cells needs"),
        (&[text.as_str()], "got 2 inputs, expected one expression"),
    ] {
        let said = refused(good, more);
        assert!(said.contains(expected), "{said}");
    }
    let large = [&good[..], &vec![b' '; 1 << 20]].concat();
    let said = refused(&large, &["--memory", "1M"]);
    assert!(said.contains("--memory"), "{said}");
    assert!(!fs::exists(&tree).unwrap());
    spinney(&["dump", &tree, "--adaptive"]).failure();
}
