//! Trees transformed and combined in shards: byte-identical to a single process, for all
//! operations.

use std::fs;
use std::time::Duration;

use crate::common::command::{complaint, spinney};
use crate::common::directory::TestDirectory;

const TRANSFORM: [&str; 2] = ["transform", "plan-transform"];
const COMBINE: [&str; 2] = ["combine", "plan-combine"];

/// Builds a tree of an image, with further options.
fn tree(temp: &TestDirectory, name: &str, at: [u64; 2], size: [u64; 2], options: &[&str]) -> String {
    let (raster, tree) =
        (temp.raster(&format!("{name}.tif"), at, size), temp.name(&format!("{name}.goblin")));
    spinney(&[&["-q", "build", &raster, "-o", &tree], options].concat()).success();
    tree
}

#[test]
fn shards_of_a_tree_make_the_bytes_of_a_transformation() {
    let temp = TestDirectory::new();
    let map = tree(&temp, "map", [0, 0], [1400, 1100], &["--kind", "categorical"]);
    let continuous = tree(&temp, "continuous", [0, 0], [1300, 1200], &["--nodata", "2", "--codec", "packed"]);
    // A copy of segments as stored; with each of them packed; and in a deeper tree, which copies
    // whole nodes.
    temp.compare_with(TRANSFORM, &[&map], &[1, 2, 7, 64]);
    temp.compare_with(TRANSFORM, &[&map, "--codec", "packed"], &[3]);
    temp.compare_with(TRANSFORM, &[&map, "tree-depth=14"], &[5]);
    temp.compare_with(TRANSFORM, &[&map, "translate=2048,0"], &[2, 7]);
    temp.compare_with(TRANSFORM, &[&map, "window=100,50,1100,1000", "rotate=90"], &[7]);
    temp.compare_with(TRANSFORM, &[&continuous, "scale=1.7", "crop"], &[4]);
    temp.compare_with(TRANSFORM, &[&continuous, "rotate=12", "--resampling", "nearest", "--move"], &[4]);
    temp.compare_with(TRANSFORM, &[&continuous, "warp=EPSG:3035,cell=11", "--resampling", "cubic"], &[4]);
    temp.compare_with(TRANSFORM, &[&continuous, &format!("like={map}"), "--codec", "packed"], &[3]);
    let sum = format!("calc=b1+other*2,other={map}");
    temp.compare_with(TRANSFORM, &[&continuous, &sum], &[5]);
}

#[test]
fn shards_of_trees_make_the_bytes_of_a_combination() {
    let temp = TestDirectory::new();
    let first = tree(&temp, "first", [0, 0], [1400, 1100], &["--nodata", "1"]);
    let second = tree(&temp, "second", [300, 200], [1500, 900], &["--nodata", "2"]);
    let third = tree(&temp, "third", [2500, 100], [300, 300], &[]);
    temp.compare_with(COMBINE, &["union", &first, &second], &[1, 2, 7, 64]);
    temp.compare_with(COMBINE, &["a-b", &first, &second, "--codec", "packed"], &[4]);
    temp.compare_with(COMBINE, &["xor", &first, &second, "--values", "b"], &[4]);
    temp.compare_with(COMBINE, &["over", &third, &second, &first], &[5]);
    temp.compare_with(COMBINE, &["add", &first, &second], &[3]);
    temp.compare_with(COMBINE, &["changed", &first, &second], &[3]);
    temp.compare_with(COMBINE, &["not", &first, "--margin", "40", "--fill", "9"], &[6]);
    temp.compare_with(COMBINE, &["nor", &first, &second, "--within", "900,-9000,20000,6000"], &[6]);
}

#[test]
fn shards_of_trees_of_several_layers_and_of_many_files() {
    let temp = TestDirectory::new();
    let stack = |name: &str, seed: u64| {
        let rasters = [
            temp.raster(&format!("{name}a.tif"), [0, 0], [1200 + seed, 1000]),
            temp.raster(&format!("{name}b.tif"), [0, 0], [1200 + seed, 1000]),
        ];
        let tree = temp.name(&format!("{name}.goblin"));
        let words = ["-q", "build", &rasters[0], &rasters[1], "--stack", "--names", "a,b", "-o", &tree];
        spinney(&words).success();
        tree
    };
    let (first, second) = (stack("first", 0), stack("second", 8));
    temp.compare_with(TRANSFORM, &[&first, "window=10,20,1100,900"], &[1, 7]);
    temp.compare_with(TRANSFORM, &[&format!("{first}:b"), "scale=2"], &[3]);
    temp.compare_with(COMBINE, &["union", &first, &second], &[5]);
    let parts = [0, 1, 2].map(|part| tree(&temp, &format!("part{part}"), [part * 600, 0], [600, 700], &[]));
    let manifest = temp.name("all.manifest.json");
    spinney(&[&["-q", "manifest", "-o", &manifest], &parts.each_ref().map(String::as_str)[..]].concat())
        .success();
    temp.compare_with(TRANSFORM, &[&manifest, "translate=3,4"], &[4]);
    // A changed file of the manifest is not the planned input.
    let job = temp.name("job");
    spinney(&["-q", "shard", "plan-transform", &manifest, "-o", &job, "--shards", "2"]).success();
    let part = fs::File::options().append(true).open(&parts[1]).unwrap();
    let before = part.metadata().unwrap().modified().unwrap();
    part.set_modified(before + Duration::from_secs(3)).unwrap();
    let said = complaint(&["shard", "build", &job, "0"], 1);
    assert!(said.contains("part1.goblin") && said.contains("was planned"), "{said}");
}

#[test]
fn shards_of_a_tree_of_which_something_else_is_said() {
    let temp = TestDirectory::new();
    let map = tree(&temp, "map", [0, 0], [1400, 1100], &["--nodata", "1"]);
    let build = ["build", "plan"];
    temp.compare_with(build, &[&map, "--rule", "max"], &[1, 7]);
    temp.compare_with(build, &[&map, "--kind", "categorical", "--codec", "packed"], &[64]);
    temp.compare_with(
        build,
        &[&map, "--depth", "13", "--crs", "EPSG:3035", "--transform", "0.1,0,5,0,-0.3,7"],
        &[3],
    );
}

#[test]
fn shards_of_octrees_and_of_trees_that_are_edited() {
    let temp = TestDirectory::new();
    let (body, edited, again) = (temp.name("body.goblin"), temp.name("map.autumn"), temp.name("job"));
    let text = temp.path("body.csg");
    fs::write(&text, "difference(block(0,0,0, 4,3,2), cylinder(2,2,0, 2,2,2, 1));").unwrap();
    spinney(&["-q", "build", text.to_str().unwrap(), "-o", &body, "--cells", "150"]).success();
    temp.compare_with(TRANSFORM, &[&body, "rotate=30,1,1,0", "scale=1.5"], &[1, 7]);
    temp.compare_with(TRANSFORM, &[&body, "axes=+y,-x,+z"], &[64]);
    let raster = temp.raster("map.tif", [0, 0], [900, 1100]);
    spinney(&["-q", "build", &raster, "-o", &edited]).success();
    temp.compare_with(TRANSFORM, &[&edited, "mirror=x"], &[4]);
    spinney(&["-q", "shard", "plan-transform", &edited, "transpose", "-o", &again, "--shards", "2"])
        .success();
    spinney(&["-q", "edit", &edited, "fill", "--window", "0,0,30,30", "--value", "7"]).success();
    assert!(complaint(&["shard", "build", &again, "0"], 1).contains("map.autumn"));
}

#[test]
fn steps_that_shards_do_not_have_are_refused() {
    let temp = TestDirectory::new();
    let map = tree(&temp, "map", [0, 0], [300, 200], &["--kind", "categorical"]);
    let job = temp.name("job");
    let refused = |words: &[&str], word: &str| {
        let said = complaint(&[&["shard"], words, &["-o", &job]].concat(), 1);
        assert!(said.contains(word), "{words:?}: {said}");
        assert!(!temp.path("job").exists());
    };
    refused(&["plan-transform", &map, "components=4"], "components=4");
    refused(&["plan-transform", &map, "sieve=10"], "sieve=10");
    refused(&["plan-transform", "no.goblin"], "no.goblin");
    refused(&["plan-combine", "cross", &map, &map], "table");
    refused(&["plan-combine", "and", &map, "fixtures/island_districts.geojson"], "feature file");
    refused(&["plan-combine", "union", &map, "no.goblin"], "no.goblin");
    complaint(&["shard", "plan-transform", &map, "-o", &map], 1);
}
