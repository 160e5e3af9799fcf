//! `spinney export` and `build` of chain codes.

use std::fs;

use crate::common::command::{spinney, stderr, stdout};

#[test]
fn regions_and_lines_become_chains_and_trees() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let [text, tree, some, roads, lines, wide] =
        ["a.chain", "a.goblin", "some.chain", "roads.csv", "lines.chain", "wide.goblin"].map(at);
    let map = "fixtures/v1/classes.goblin";
    for directions in ["4", "8"] {
        stdout(&["export", map, &text, "--directions", directions]);
        stdout(&["build", &text, "-o", &tree]);
        assert_eq!(stdout(&["stats", &tree, "--json"]), stdout(&["stats", map, "--json"]));
        assert!(stdout(&["diff", map, &tree]).contains("0 cells"), "{directions}");
    }
    // A chain code file works like an image, also on another tree's cells.
    stdout(&["build", &text, "-o", &wide, "--grid", map]);
    assert!(stdout(&["diff", map, &wide]).contains("0 cells"));
    stdout(&["export", map, "-o", &some, "--class", "3", "--level", "5"]);
    let found = fs::read_to_string(&some).unwrap();
    assert!(
        found.starts_with("freeman-chain-code 1\ndirections 4\nsize 32 25\ntype u8\nnodata 0\n"),
        "{found}"
    );
    assert!(
        found.lines().filter(|line| line.starts_with("region")).all(|line| line.starts_with("region 3 "))
    );

    fs::write(&roads, "wkt\n\"LINESTRING (300025 3199975, 300225 3199975)\"\n\"POINT (300025 3199975)\"\n")
        .unwrap();
    stdout(&["export", map, &lines, "--lines", &roads]);
    let found = fs::read_to_string(&lines).unwrap();
    assert!(found.ends_with("line 1 0 0\n0000\nend 1\n"), "{found}");
    for (arguments, expected) in [
        (&["export", map, &text, "--simplify", "3"][..], "--polygons"),
        (&["export", map, &text, "--smooth"], "--smooth works only with meshes of solids"),
        (&["export", map, &at("x.tif"), "--class", "3"], "--class works only with --polygons or .chain"),
        (
            &["export", map, &at("x.geojson"), "--polygons", "--directions", "8"],
            "--directions: has no effect on --polygons",
        ),
        (&["export", map, &text, "--directions", "6"], "4 or 8"),
        (
            &["export", map, &lines, "--lines", &roads, "--directions", "4"],
            "expected 8, since chains of lines",
        ),
        (
            &["export", map, &lines, "--lines", &roads, "--class", "4"],
            "--class and --connect: have no effect on --lines",
        ),
        (&["export", map, &lines, "--lines", &tree], "is not a feature file"),
        (&["export", "fixtures/v1/elevation.goblin", &text], "continuous values"),
        (&["show", &text], "a chain code"),
    ] {
        let message = stderr(spinney(arguments).failure());
        assert!(message.contains(expected), "{arguments:?}: {message}");
    }
    fs::write(&text, "freeman-chain-code 1\ndirections 8\nregion 7 0 0\n0123\n").unwrap();
    let message = stderr(spinney(&["build", &text, "-o", &tree]).failure());
    assert!(message.contains("a.chain: line 4: found a move to column 2, row -1"), "{message}");
}
