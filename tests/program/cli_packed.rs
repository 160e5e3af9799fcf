//! `--codec` and `--cache-memory`: packed files with the program.

use serde_json::Value as Json;
use spinney::{DataKind, Rule};

use crate::common::command::{complaint, spinney, stdout};
use crate::common::directory::TestDirectory;
use crate::common::{Cells, QUAD, goblin_bytes};

fn as_json(arguments: &[&str]) -> Json {
    serde_json::from_str(&stdout(arguments)).unwrap()
}

#[test]
fn files_are_packed_and_unpacked() {
    let temp = TestDirectory::new();
    let [from, packed, small, back] =
        ["plain.goblin", "packed.goblin", "small.goblin", "back.goblin"].map(|name| temp.name(name));
    let cells = Cells::random(QUAD, 3, [700, 600, 1], 30, true);
    std::fs::write(&from, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
    spinney(&["convert", &from, &packed, "--codec", "packed"]).success();
    spinney(&["convert", &packed, &back]).success();
    assert!(std::fs::read(&from).unwrap() == std::fs::read(&back).unwrap());
    spinney(&["transform", &packed, "-o", &small, "--codec", "packed"]).success();
    for file in [&packed, &small] {
        spinney(&["verify", file]).success();
        let info = as_json(&["info", file, "--json"]);
        assert_eq!(info["codec"], "packed");
        let levels = info["segment_levels"].as_array().unwrap();
        let sum = |name: &str| levels.iter().map(|level| level[name].as_u64().unwrap()).sum::<u64>();
        assert_eq!(sum("segments"), info["segments"].as_u64().unwrap());
        assert!(sum("bytes") < sum("plain_bytes") && sum("packed") > 0);
        let text = stdout(&["info", file]);
        assert!(
            text.contains("codec       packed\nsegments    level 0: 1, ") && text.contains(" unpacked\n"),
            "{text}"
        );
    }
    let info = stdout(&["info", &from]);
    assert!(
        info.contains("codec       plain\nsegments    level 0: 1, ") && !info.contains("unpacked"),
        "{info}"
    );
    // Results do not depend on the cache size.
    let expected = stdout(&["stats", &from, "--json"]);
    for cache in ["1", "64M"] {
        assert_eq!(stdout(&["stats", &packed, "--json", "--cache-memory", cache]), expected);
    }
}

const CLASSES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
const DISTRICTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_districts.geojson");

/// Returns the codec of each of a file's layers.
fn codecs(file: &str) -> Vec<Json> {
    let info = as_json(&["info", file, "--json"]);
    match info["layers"].as_array() {
        Some(layers) => layers.iter().map(|layer| layer["codec"].clone()).collect(),
        None => vec![info["codec"].clone()],
    }
}

#[test]
fn every_door_packs() {
    let temp = TestDirectory::new();
    let name = |name: &str| temp.name(name);
    let [map, warped, zones] = ["map.goblin", "warped.goblin", "zones.goblin"].map(name);
    let packed = ["--codec", "packed"];
    let run = |arguments: &[&str]| spinney(&[arguments, &packed].concat()).success();
    run(&["build", CLASSES, "-o", &map]);
    run(&["build", CLASSES, "-o", &warped, "--grid", "xyz"]);
    run(&["build", DISTRICTS, "-o", &zones, "--grid", &map]);
    let [again, moved, both, changed] =
        ["again.goblin", "moved.goblin", "both.goblin", "changed.goblin"].map(name);
    run(&["build", &map, "-o", &again, "--rule", "nearest"]);
    run(&["transform", &map, "mirror=x", "-o", &moved]);
    run(&["combine", "and", &map, DISTRICTS, "-o", &both]);
    run(&["diff", &map, &again, "-o", &changed]);
    let [stack, history, age] = ["stack.goblin", "map.autumn", "age.goblin"].map(name);
    run(&["build", CLASSES, "-o", &stack, "--stack"]);
    spinney(&["convert", &map, &history]).success();
    run(&["blame", &history, &age]);
    for file in [&map, &warped, &zones, &again, &moved, &both, &changed, &stack, &age] {
        assert_eq!(codecs(file), ["packed"], "{file}");
        spinney(&["verify", file]).success();
    }
    // Existing layers keep their codec, and the added one has the requested codec.
    spinney(&["edit", &stack, "add-layer", &map, "plain"]).success();
    run(&["edit", &stack, "add-layer", &map, "packed"]);
    assert_eq!(codecs(&stack), ["packed", "plain", "packed"]);
    let text = stdout(&["info", &stack]);
    assert_eq!(text.matches(", packed, ").count(), 2, "{text}");
}

/// Collects all images below a directory, by relative path.
fn collect_images(directory: &std::path::Path, found: &mut Vec<(String, Vec<u8>)>, from: &str) {
    for entry in std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap()) {
        let name = format!("{from}/{}", entry.file_name().to_str().unwrap());
        match entry.path().is_dir() {
            true => collect_images(&entry.path(), found, &name),
            false if name.ends_with(".png") => found.push((name, std::fs::read(entry.path()).unwrap())),
            false => {}
        }
    }
}

#[test]
fn exports_are_those_of_plain_files() {
    let temp = TestDirectory::new();
    let [plain, packed] = ["plain.goblin", "packed.goblin"].map(|name| temp.name(name));
    // Tiles are those of the world, whose cells take long to export as an image or as polygons.
    let [plain_world, packed_world] =
        ["plain_world.goblin", "packed_world.goblin"].map(|name| temp.name(name));
    spinney(&["build", CLASSES, "-o", &plain]).success();
    spinney(&["build", CLASSES, "-o", &plain_world, "--grid", "xyz"]).success();
    for (plain, packed) in [(&plain, &packed), (&plain_world, &packed_world)] {
        spinney(&["convert", plain, packed, "--codec", "packed"]).success();
    }
    for file in [&plain, &packed] {
        spinney(&["export", file, "-o", &format!("{file}.tif")]).success();
        spinney(&["export", file, "-o", &format!("{file}.geojson"), "--polygons"]).success();
        spinney(&["get", file, &format!("{file}.npy"), "--level", "6"]).success();
    }
    let mut tiles = [vec![], vec![]];
    for (file, tiles) in [&plain_world, &packed_world].into_iter().zip(&mut tiles) {
        let directory = format!("{file}.tiles");
        spinney(&["export", file, "-o", &format!("{directory}/{{z}}/{{x}}/{{y}}.png")]).success();
        collect_images(directory.as_ref(), tiles, "");
        tiles.sort();
    }
    assert!(tiles[0].len() > 5 && tiles[0] == tiles[1]);
    for kind in ["tif", "geojson", "npy"] {
        let [one, other] = [&plain, &packed].map(|file| std::fs::read(format!("{file}.{kind}")).unwrap());
        assert!(one == other, "{kind}");
    }
}

#[test]
fn history_is_packed() {
    let temp = TestDirectory::new();
    let [map, history, packed, plain] =
        ["map.goblin", "map.autumn", "packed.autumn", "plain.autumn"].map(|name| temp.name(name));
    spinney(&["build", CLASSES, "-o", &map]).success();
    spinney(&["convert", &map, &history]).success();
    for window in ["0,0,120,100", "60,80,150,110"] {
        spinney(&["edit", &history, "fill", "--window", window, "--value", "3"]).success();
    }
    spinney(&["compact", &history, "-o", &plain, "--keep", "9"]).success();
    spinney(&["compact", &history, "-o", &packed, "--keep", "9", "--pack"]).success();
    spinney(&["verify", &packed]).success();
    let size = |path: &str| std::fs::metadata(path).unwrap().len();
    assert!(size(&packed) < size(&plain), "{} {}", size(&packed), size(&plain));
    for commit in 1..=3 {
        let [old, new] = [&history, &packed].map(|path| stdout(&["stats", &format!("{path}@{commit}")]));
        assert_eq!(old, new);
    }
}

/// Exact models are packed when they are built and combined, take fewer bytes, and return the same
/// results.
#[test]
fn exact_models_are_packed() {
    const CHAPEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/chapel.goblin");
    const CROSSING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/crossing.goblin");
    let temp = TestDirectory::new();
    let [plain, packed, other] =
        ["plain.goblin", "packed.goblin", "other.goblin"].map(|name| temp.name(name));
    let size = |file: &str| std::fs::metadata(file).unwrap().len();
    for operation in ["build", "and"] {
        let make = |file: &str, options: &[&str]| match operation {
            "build" => spinney(&[&["build", CHAPEL, "--brep", "-o", file], options].concat()).success(),
            _ => spinney(&[&["combine", operation, CROSSING, CROSSING, "-o", file], options].concat())
                .success(),
        };
        make(&plain, &[]);
        make(&packed, &["--codec", "packed"]);
        assert!(3 * size(&packed) < 2 * size(&plain), "{} of {}", size(&packed), size(&plain));
        assert_eq!((codecs(&plain), codecs(&packed)), (vec!["plain".into()], vec!["packed".into()]));
        assert!(stdout(&["info", &packed]).contains("codec       packed\n"));
        spinney(&["verify", &packed]).success();
        let [expected, found] =
            [&plain, &packed].map(|file| stdout(&["export", file, "-o", "-", "--format", "off"]));
        assert!(expected == found && expected.len() > 100);
    }
    let text = complaint(
        &["combine", "or", CROSSING, CROSSING, "-o", &other, "--codec", "packed", "--max-error", "1"],
        1,
    );
    assert!(text.contains("which --max-error needs"), "{text}");
}

#[test]
fn packing_is_refused_where_there_are_no_segments() {
    let temp = TestDirectory::new();
    let [history, tree, other] = ["map.autumn", "map.goblin", "model.goblin"].map(|name| temp.name(name));
    for grid in [&[][..], &["--grid", "xyz"]] {
        let text = complaint(&[&["build", CLASSES, "-o", &history, "--codec", "packed"], grid].concat(), 1);
        assert!(text.contains("compact") && text.contains(".goblin"), "{text}");
    }
    let text = complaint(&["combine", "or", DISTRICTS, DISTRICTS, "-o", &tree, "--codec", "packed"], 1);
    assert!(text.contains("--codec"), "{text}");
    for wrong in [["--codec", "zip"], ["--cache-memory", "none"]] {
        complaint(&[&["build", CLASSES, "-o", &tree][..], &wrong].concat(), 2);
    }
    let model = temp.name("cube.off");
    std::fs::write(&model, "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n")
        .unwrap();
    complaint(&["build", &model, "-o", &other, "--brep", "--codec", "packed", "--max-error", "1"], 2);
    assert!(!std::path::Path::new(&history).exists() && !std::path::Path::new(&tree).exists());
}

#[test]
fn help_describes_packing() {
    for command in ["build", "convert", "transform", "combine", "blame", "diff"] {
        let help = stdout(&["help", command]).split_whitespace().collect::<Vec<_>>().join(" ");
        for word in ["--codec <plain|packed>", "--cache-memory <BYTES>", "[default: plain]"] {
            assert!(help.contains(word), "{command}: {word}");
        }
    }
    let help = stdout(&["help", "export", "tiles"]);
    assert!(help.contains("--png-effort") && !help.contains(" --codec"), "{help}");
    assert!(stdout(&["help", "convert"]).contains("whatever those of the file are"));
}
