//! Trees of points built in shards: byte-identical to a single build.

use std::fs;

use crate::common::command::{complaint, spinney};
use crate::common::directory::TestDirectory;

const BUILD: [&str; 2] = ["build", "plan"];

/// Adjacent and overlapping tiles of a scan, in files of several types.
fn tiles(temp: &TestDirectory) -> Vec<String> {
    let scan = temp.name("scan.goblin");
    spinney(&["-q", "build", "fixtures/island_points.laz", "-o", &scan]).success();
    let windows = [
        ("a.laz", "303000,3194000,305000,3196000"),
        ("b.las", "304900,3190000,309000,3199000"),
        ("c.laz", "300000,3195500,304000,3199000"),
    ];
    let tile = |(name, window): (&str, &str)| {
        let tile = temp.name(name);
        spinney(&["-q", "get", &scan, &tile, "--window", window]).success();
        tile
    };
    windows.map(tile).to_vec()
}

#[test]
fn shards_of_points_make_the_bytes_of_a_build() {
    let temp = TestDirectory::new();
    temp.compare_with(BUILD, &["fixtures/island_points.laz", "--leaf-size", "300"], &[1, 2, 7, 64]);
    let tiles = tiles(&temp);
    let tiles: Vec<&str> = tiles.iter().map(String::as_str).collect();
    temp.compare_with(BUILD, &tiles, &[3]);
    let options = ["--leaf-size", "100", "--where", "classification!=5,intensity>3", "--crs", "EPSG:32628"];
    temp.compare_with(BUILD, &[&tiles[..], &options[..]].concat(), &[5]);
    temp.compare_with(BUILD, &[&tiles[..], &["--attribute", "gps_time", "--leaf-size", "50"]].concat(), &[4]);
}

#[test]
fn points_that_have_changed_and_what_is_no_scan_are_refused() {
    let temp = TestDirectory::new();
    let tiles = tiles(&temp);
    let (job, merged) = (temp.name("job"), temp.name("merged.goblin"));
    let plan = ["shard", "plan", &tiles[0], &tiles[1], "-o", &job, "--shards", "2"];
    spinney(&[&["-q"], &plan[..]].concat()).success();
    // Repeating the same plan does nothing, another one is rejected.
    spinney(&[&["-q"], &plan[..]].concat()).success();
    complaint(&[&plan[..], &["--leaf-size", "7"]].concat(), 1);
    spinney(&["-q", "shard", "build", &job, "1"]).success();
    spinney(&["-q", "shard", "build", &job, "1"]).success();
    assert!(complaint(&["shard", "merge", &job, "-o", &merged], 1).contains("0 is missing"));
    fs::copy(&tiles[2], &tiles[0]).unwrap();
    let said = complaint(&["shard", "build", &job, "0"], 1);
    assert!(said.contains("a.laz") && said.contains("was planned"), "{said}");
    assert!(!temp.path("merged.goblin").exists());

    let refused = |words: &[&str], word: &str| {
        let said = complaint(&[&["shard", "plan", "-o", &temp.name("none")], words].concat(), 1);
        assert!(said.contains(word), "{words:?}: {said}");
        assert!(!temp.path("none").exists());
    };
    refused(&[&tiles[0], "--codec", "packed"], "--codec");
    refused(&[&tiles[0], "--stack"], "--stack: has no effect on points");
    refused(&[&tiles[0], "--attribute", "colour"], "colour");
    refused(&["fixtures/island_elevation.tif", "--where", "a=1"], "--where");
    refused(&["fixtures/island_elevation.tif", &tiles[0]], "island_elevation");
}
