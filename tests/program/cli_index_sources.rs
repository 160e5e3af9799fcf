//! Sources of `spinney index`: patterns, STAC items and lists; and indexes next to their source.

use std::fs;
use std::path::Path;

use crate::common::command::{complaint, spinney, stderr, stdout};
use crate::common::directory::TestDirectory;

const RELIEF: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_elevation.tif");
const CLASSES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");

/// Statistics of a file, without its name.
fn stats(path: &str) -> String {
    let printed = stdout(&["stats", path, "--json"]);
    let mut json: serde_json::Value = serde_json::from_str(&printed).unwrap();
    json.as_object_mut().unwrap().remove("file");
    json.to_string()
}

/// A STAC item with two assets.
fn item(id: &str, assets: &[(&str, &str)]) -> String {
    let assets: Vec<String> = assets
        .iter()
        .map(|(name, href)| {
            format!("\"{name}\":{{\"href\":\"{href}\",\"type\":\"image/tiff; application=geotiff\",\"roles\":[\"data\"]}}")
        })
        .collect();
    format!(
        "{{\"type\":\"Feature\",\"stac_version\":\"1.0.0\",\"id\":\"{id}\",\"properties\":{{\"datetime\":\"2024-05-31T10:30:00Z\"}},\"assets\":{{{}}},\"links\":[]}}",
        assets.join(",")
    )
}

#[test]
fn an_index_next_to_a_raster_is_used() {
    let temp = TestDirectory::new();
    let tif = temp.copy(RELIEF, "relief.tif");
    let message = complaint(&["stats", &tif], 1);
    let advice = format!("`spinney build {tif} -o {}`", temp.name("relief.goblin"));
    assert!(
        message.contains("is a TIFF image, not a Spinney file") && message.contains(&advice),
        "{message}"
    );
    let index = temp.name("relief.tif.goblin");
    assert!(message.contains(&format!("`spinney index {tif} -o {index}`")), "{message}");

    spinney(&["-q", "index", &tif, "-o", &index]).success();
    let run = spinney(&["stats", &tif, "--json"]).success();
    assert_eq!(stderr(run), "");
    assert_eq!(stats(&tif), stats(&index));
    assert!(stdout(&["info", &tif]).contains("relief.tif.goblin"));
    let (cells, whole) = (temp.name("cells.npy"), temp.name("whole.goblin"));
    spinney(&["-q", "build", RELIEF, "-o", &whole]).success();
    for words in [
        &["get", &tif, &cells, "-q"][..],
        &["point", &tif, "1,1"],
        &["find", &tif, "--above", "1"],
        &["verify", &tif],
        &["transform", &tif, "crop", "-o", &temp.name("o.goblin")],
        &["combine", "max", &tif, &whole, "-o", &temp.name("o.goblin")],
        &["diff", &whole, &tif],
    ] {
        spinney(words).success();
    }
    let tree_cells = temp.name("tree.npy");
    spinney(&["-q", "get", &whole, &tree_cells]).success();
    assert!(fs::read(cells).unwrap() == fs::read(tree_cells).unwrap());
    let message = complaint(&["stats", &format!("{tif}@3")], 1);
    assert!(message.contains("relief.tif"), "{message}");

    // Commands that take rasters read the raster.
    spinney(&["-q", "build", &tif, "-o", &temp.name("again.goblin")]).success();
    assert!(!stdout(&["info", &temp.name("again.goblin")]).contains("sources "));
    spinney(&["-q", "index", &tif, "-o", &temp.name("again.goblin")]).success();
    // Nothing is written in place of the raster.
    let before = fs::read(&tif).unwrap();
    let message = complaint(&["edit", &tif, "add-layer", &whole], 1);
    assert!(message.contains("relief.tif: changing the layers of a raster"), "{message}");
    assert!(fs::read(&tif).unwrap() == before);
}

#[test]
fn an_index_of_other_files_is_not_used() {
    let temp = TestDirectory::new();
    let (tif, other) = (temp.copy(RELIEF, "relief.tif"), temp.copy(RELIEF, "other.tif"));
    let index = temp.name("relief.tif.goblin");
    for words in [
        &["index", &other, "-o", &index][..],
        &["index", &tif, &other, "-o", &index],
        &["build", &tif, "-o", &index],
    ] {
        let _ = fs::remove_file(&index);
        spinney(&[&["-q"], words].concat()).success();
        let message = complaint(&["stats", &tif], 1);
        assert!(message.contains("is a TIFF image, not a Spinney file"), "{words:?}: {message}");
    }
    fs::write(&index, "text").unwrap();
    assert!(complaint(&["stats", &tif], 1).contains("is a TIFF image, not a Spinney file"));
    fs::remove_file(&index).unwrap();
    // A moved pair is one still; a longer raster is another one.
    spinney(&["-q", "index", &tif, "-o", &index]).success();
    fs::create_dir(temp.name("moved")).unwrap();
    for name in ["relief.tif", "relief.tif.goblin"] {
        fs::rename(temp.name(name), temp.name(&format!("moved/{name}"))).unwrap();
    }
    let moved = temp.name("moved/relief.tif");
    stats(&moved);
    let mut bytes = fs::read(&moved).unwrap();
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(9);
    fs::File::options().append(true).open(&moved).unwrap().set_modified(later).unwrap();
    let warned = stderr(spinney(&["stats", &moved]).success());
    assert!(warned.contains("relief.tif: was written again after its index was made"), "{warned}");
    assert_eq!(warned.matches("warning").count(), 1, "{warned}");
    bytes.push(0);
    fs::write(&moved, &bytes).unwrap();
    let message = complaint(&["stats", &moved], 1);
    assert!(message.contains("relief.tif: length: found") && message.contains("index --update"), "{message}");
}

/// An output never replaces a file that has cells of an input.
#[test]
fn sources_are_not_overwritten() {
    let temp = TestDirectory::new();
    let tif = temp.copy(RELIEF, "relief.tif");
    let index = temp.name("x.goblin");
    spinney(&["-q", "index", &tif, "-o", &index]).success();
    let before = fs::read(&tif).unwrap();
    for words in [
        &["export", &index, &tif][..],
        &["get", &index, &tif, "--window", "0,0,9,9"],
        &["transform", &index, "-o", &tif],
        &["convert", &index, &tif],
        &["index", "--update", &index, "-o", &tif],
    ] {
        let message = complaint(words, 1);
        assert!(message.contains("relief.tif: has cells of"), "{words:?}: {message}");
        assert!(fs::read(&tif).unwrap() == before, "{words:?}");
    }
    // The same holds for files of a manifest.
    let (part, all) = (temp.built(RELIEF, "part.goblin", &[]), temp.name("all.goblin"));
    spinney(&["-q", "manifest", &part, "-o", &all]).success();
    let before = fs::read(&part).unwrap();
    let message = complaint(&["transform", &all, "-o", &part], 1);
    assert!(message.contains("part.goblin: has cells of"), "{message}");
    assert!(fs::read(&part).unwrap() == before);
}

/// Names of sources are relative to the index itself, also if it is opened through a link.
#[cfg(unix)]
#[test]
fn links_to_indexes_are_followed() {
    let temp = TestDirectory::new();
    fs::create_dir(temp.name("data")).unwrap();
    let tif = temp.copy(RELIEF, "data/relief.tif");
    let (index, link) = (temp.name("data/x.goblin"), temp.name("link.goblin"));
    spinney(&["-q", "index", &tif, "-o", &index]).success();
    std::os::unix::fs::symlink("data/x.goblin", &link).unwrap();
    spinney(&["-q", "get", &link, &temp.name("o.npy")]).success();
    spinney(&["-q", "index", &tif, "-o", &link]).success();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    for name in [&link, &index] {
        spinney(&["-q", "get", name, &temp.name("o.npy")]).success();
    }
}

#[test]
fn patterns_and_lists_name_sources() {
    let temp = TestDirectory::new();
    for directory in ["a", "b"] {
        fs::create_dir(temp.name(directory)).unwrap();
    }
    temp.copy(RELIEF, "a/1.tif");
    temp.copy(RELIEF, "b/2.tif");
    temp.write("b/2.txt", "text");
    let index = temp.name("x.goblin");
    spinney(&["-q", "index", &temp.name("*/*.tif"), "-o", &index]).success();
    let info = stdout(&["info", &index]);
    assert!(info.contains("a/1.tif") && info.contains("b/2.tif") && info.contains("2 files"), "{info}");
    let message = complaint(&["index", &temp.name("*/*.tiff"), "-o", &index], 1);
    assert!(message.contains("no file has such a name"), "{message}");
    let message = complaint(&["index", "https://h/*.tif", "-o", &index, "--no-remote"], 1);
    assert!(message.contains("--no-remote"), "{message}");
    let list = temp.write("b/list.txt", "2.tif\n../a/*.tif\n");
    spinney(&["-q", "index", &format!("@{list}"), "-o", &index]).success();
    assert!(stdout(&["info", &index]).contains("2 files"));
    let list = temp.write("b/list.txt", "https://127.0.0.1:1/x.tif\n");
    let message = complaint(&["index", &format!("@{list}"), "-o", &index, "--no-remote"], 1);
    assert!(message.contains("https://127.0.0.1:1/x.tif: a remote file"), "{message}");
}

#[test]
fn stac_items_name_sources() {
    let temp = TestDirectory::new();
    fs::create_dir(temp.name("data")).unwrap();
    temp.copy(RELIEF, "data/relief.tif");
    temp.copy(CLASSES, "data/classes.tif");
    let one = temp.write("one.json", item("one", &[("dem", "./data/relief.tif")]));
    let index = temp.name("x.goblin");
    spinney(&["-q", "index", &one, "-o", &index]).success();
    assert!(stdout(&["info", &index]).contains("data/relief.tif"));
    let both = item("two", &[("dem", "data/relief.tif"), ("cover", "data/classes.tif")]);
    for (name, text) in [
        ("two.json", both.clone()),
        ("two.ndjson", format!("{both}\n")),
        ("collection", format!("{{\"type\":\"FeatureCollection\",\"features\":[{both}]}}")),
    ] {
        let items = temp.write(name, text);
        let message = complaint(&["index", &items, "-o", &index], 1);
        assert!(message.contains("item two") && message.contains("--asset NAME: cover, dem"), "{message}");
        spinney(&["-q", "index", &items, "--asset", "cover", "-o", &index]).success();
        let info = stdout(&["info", &index]);
        assert!(info.contains("data/classes.tif") && !info.contains("relief"), "{info}");
    }
    // Layers of a stack have the items' times.
    spinney(&["-q", "index", &one, "--stack", "-o", &index]).success();
    assert!(stdout(&["info", &index, "--json"]).contains("\"2024-05-31T10:30:00Z\""));
    let message = complaint(&["index", &one, "-o", &index, "--no-external"], 1);
    assert!(
        message.contains("one.json: data in another file") && message.contains("--no-external"),
        "{message}"
    );
    let message = complaint(&["index", RELIEF, "--asset", "dem", "-o", &index], 1);
    assert!(message.contains("--asset: got dem, expected a source with STAC items"), "{message}");
    let other = temp.write("other.geojson", "{\"type\":\"FeatureCollection\",\"features\":[]}");
    let message = complaint(&["index", &other, "-o", &index], 1);
    assert!(message.contains("a GeoJSON document"), "{message}");
    assert!(Path::new(&index).exists());
}
