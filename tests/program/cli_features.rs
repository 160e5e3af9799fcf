//! Features in the program's other commands: filled, combined with trees, searched.

use crate::common::command::{complaint, spinney, stderr, stdout};

const CLASSES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
const DISTRICTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_districts.geojson");

/// Cells that are not VOID, and those of a class.
fn counts(file: &str, class: u64) -> (u64, u64) {
    let told: serde_json::Value = serde_json::from_str(&stdout(&["stats", file, "--json"])).unwrap();
    let classes = told["classes"].as_array().unwrap();
    let of = |row: &serde_json::Value| row["cells"].as_u64().unwrap();
    let found = classes.iter().find(|row| row["value"] == class);
    (classes.iter().map(of).sum(), found.map_or(0, of))
}

#[test]
fn features_fill_and_are_combined_and_searched() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let (map, tree, zones) = (at("i.autumn"), at("i.goblin"), at("zones.goblin"));
    spinney(&["-q", "build", CLASSES, "-o", &map]).success();
    spinney(&["-q", "build", CLASSES, "-o", &tree]).success();
    // The cells of the districts, as a tree that was made of them.
    spinney(&["-q", "build", DISTRICTS, "--grid", &tree, "-o", &zones]).success();
    let (inside, _) = counts(&zones, 1);
    let both = at("both.goblin");
    spinney(&["-q", "combine", "and", &tree, &zones, "-o", &both]).success();
    let found = at("found.goblin");
    let said = stderr(spinney(&["combine", "and", &tree, DISTRICTS, "-o", &found]).success());
    assert!(said.contains("island_districts.geojson: 2 features"), "{said}");
    let differences = stdout(&["diff", &both, &found]);
    assert!(differences.contains("blocks     0"), "{differences}");
    // Fewer features, and another rule.
    let north = at("north.goblin");
    spinney(&[
        "-q",
        "combine",
        "and",
        &tree,
        DISTRICTS,
        "--where",
        "name=North shore",
        "--edge",
        "touch",
        "-o",
        &north,
    ])
    .success();
    assert!(counts(&north, 1).0 < counts(&found, 1).0);
    // Blocks of a class within features have as many cells as the class has there.
    let blocks = stdout(&["find", &tree, "--class", "3", "--within", DISTRICTS, "--json"]);
    let sum: u64 = blocks
        .lines()
        .map(|line| {
            let block: serde_json::Value = serde_json::from_str(line).unwrap();
            block["size"][0].as_u64().unwrap() * block["size"][1].as_u64().unwrap()
        })
        .sum();
    assert_eq!(sum, counts(&both, 3).1);
    assert!(sum > 0);
    // Filled, and made VOID, in a commit each.
    let before = counts(&map, 7);
    let fill = ["-q", "edit", &map, "fill", "--zones", DISTRICTS];
    spinney(&[&fill[..], &["--value", "7"]].concat()).success();
    assert!(counts(&map, 7).1 >= inside && counts(&map, 7).1 <= inside + before.1);
    spinney(&[&fill[..], &["--void"]].concat()).success();
    let log = stdout(&["log", &map]);
    assert!(log.contains("3, ") && log.contains("Fill") && !log.contains("4, "), "{log}");
    for (arguments, what) in [
        (&["edit", &map, "fill", "--window", "0,0,4,4", "--value", "3", "--where", "a=1"][..], "--zones"),
        (&["edit", &map, "fill", "--zones", DISTRICTS, "--value", "name"], "classes"),
        (&["edit", &map, "fill", "--zones", DISTRICTS, "--value", "256"], "u8"),
        (&["edit", &map, "fill", "--zones", DISTRICTS, "--value", "1,2"], "1 number"),
        (&["edit", &map, "fill", "--zones", CLASSES, "--value", "1"], "no file of features"),
        (&["combine", "or", &tree, &zones, "--where", "a=1", "-o", &at("x.goblin")], "features"),
        (&["combine", "or", &tree, DISTRICTS, "--where", "name=x", "-o", &at("x.goblin")], "at least one"),
        (&["find", &tree, "--class", "3", "--edge", "touch"], "--within"),
    ] {
        let said = complaint(arguments, 1);
        assert!(said.contains(what), "{arguments:?}: {said}");
    }
    assert!(!folder.path().join("x.goblin").exists());
}
