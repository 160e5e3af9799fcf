//! The command line, as users type it.

use std::path::{Path, PathBuf};
use std::process::{Command as Process, Stdio};

use serde_json::Value as Json;
use spinney::raw::import::raster::{self, Pixels};
use spinney::{DataKind, Region, Rule};
use tempfile::TempDir;

use crate::common::command::{command, complaint, stdout};
use crate::common::{CLASSIC, Cells, OCT, goblin_bytes};

fn json(arguments: &[&str]) -> Json {
    serde_json::from_str(&stdout(arguments)).unwrap()
}

fn fixture(name: &str) -> String {
    format!("{}/fixtures/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// A directory with the trees that are queried.
struct Trees {
    directory: TempDir,
    classic: String,
    octree: String,
}

impl Trees {
    fn new() -> Trees {
        let directory = tempfile::tempdir().unwrap();
        let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
        let (classic, octree) = (path("classic.goblin"), path("octree.goblin"));
        let image = fixture("classic.png");
        let rule = ["--rule", "dominant", "--kind", "categorical"];
        command(&["build", "-q", &image, "-o", &classic]).args(rule).assert().success().stderr("").stdout("");
        let cells = Cells::random(OCT, 5, [12, 9, 10], 9, true);
        std::fs::write(&octree, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
        Trees { directory, classic, octree }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().into()
    }
}

fn samples(path: &Path) -> Vec<u8> {
    let mut raster = raster::open(path, &Default::default()).unwrap();
    let mut pixels = Pixels::default();
    let (width, height) = (raster.info().width, raster.info().height);
    raster.read(Region::new(0, 0, width, height), &mut pixels).unwrap();
    pixels.bytes
}

#[test]
fn dump_gives_the_literature_back() {
    let trees = Trees::new();
    let table = stdout(&["dump", &trees.classic]);
    let rows: Vec<Vec<i32>> = table
        .lines()
        .map(|line| line.split_whitespace().map(|word| word.parse().unwrap()).collect())
        .collect();
    // Record 3's link is misprinted as 7.
    let expected = [
        [1, -1, -1, 1, -2, 11],
        [2, 1, -3, 1, -3, 5],
        [3, 1, 3, 3, 3, 4],
        [4, 3, 3, 1, 2, 5],
        [5, -3, 1, -2, -1, 9],
        [6, 3, 1, 3, 3, 7],
        [7, 3, 2, 2, 2, 8],
        [8, 1, 1, 2, 2, 9],
        [9, 2, 2, 1, -1, 11],
        [10, 1, 2, 1, 1, 11],
    ];
    assert_eq!(rows, expected);
    assert!(stdout(&["dump", &trees.classic, "--as", "df"]).starts_with("df:xy:3:u8:8x8 GG1G1333"));
    let codes = stdout(&["dump", &trees.classic, "--codes"]);
    assert_eq!(codes.lines().count(), 31);
    assert!(stdout(&["dump", &trees.octree, "--as", "df"]).starts_with("df:xyz:"));
    let message = complaint(&["dump", &trees.octree, "--limit", "1"], 1);
    assert!(
        message.contains(&format!("{}: tree: got ", trees.octree)) && message.contains("at most 1"),
        "{message}"
    );
    complaint(&["dump", &trees.classic, "--as", "df", "--codes"], 2);
}

#[test]
fn info_describes_files() {
    let trees = Trees::new();
    let text = stdout(&["info", &trees.classic]);
    assert!(text.contains("8 x 8") && text.contains("dominant") && text.contains("quadtree"), "{text}");
    let info = json(&["info", &trees.classic, "--json"]);
    assert_eq!(info["size"], serde_json::json!([8, 8]));
    assert_eq!((&info["depth"], &info["records"], &info["cells"]), (&3.into(), &10.into(), &64.into()));
    assert_eq!(info["bytes"].as_u64().unwrap(), std::fs::metadata(&trees.classic).unwrap().len());
    let sections = info["sections"].as_object().unwrap();
    assert_eq!(
        sections.values().map(|bytes| bytes.as_u64().unwrap()).sum::<u64>(),
        info["bytes"].as_u64().unwrap()
    );
    assert!(stdout(&["info", &trees.octree]).contains("12 x 9 x 10"));
    assert_eq!(json(&["info", &trees.octree, "--json"])["tree"], "octree");
    for name in ["ball", "classes", "classic", "elevation", "rgb", "segments"] {
        let file = fixture(&format!("v1/{name}.goblin"));
        assert!(stdout(&["info", &file]).contains("level "), "{name}");
        assert!(json(&["info", &file, "--json"])["depth"].is_u64(), "{name}");
    }
}

#[test]
fn get_writes_the_cells_that_were_read() {
    let trees = Trees::new();
    for name in ["a.png", "a.tif"] {
        command(&["get", "-q", &trees.classic, &trees.name(name)]).assert().success().stdout("");
        assert_eq!(samples(&trees.path(name)), CLASSIC.as_flattened(), "{name}");
        let window = ["--window", "3,1,4,2"];
        command(&["get", &trees.classic, &trees.name(name)]).args(window).assert().success();
        assert_eq!(samples(&trees.path(name)), [3, 3, 3, 1, 3, 3, 2, 1], "{name}");
        command(&["get", &trees.classic, &trees.name(name), "--level", "1"]).assert().success();
        assert_eq!(samples(&trees.path(name)), [1, 1, 1, 2], "{name}");
        command(&["get", &trees.classic, &trees.name(name), "--size", "16x16"]).assert().success();
        let large = samples(&trees.path(name));
        assert!((0..256).all(|i| large[i] == CLASSIC[i / 32][i % 16 / 2]), "{name}");
    }
    command(&["get", &trees.classic, &trees.name("a.raw")]).assert().success();
    assert_eq!(std::fs::read(trees.path("a.raw")).unwrap(), CLASSIC.as_flattened());
    command(&["get", &trees.classic, &trees.name("a.npy")]).assert().success();
    let array = std::fs::read(trees.path("a.npy")).unwrap();
    assert!(array.starts_with(b"\x93NUMPY") && array.ends_with(CLASSIC.as_flattened()));
    let run = command(&["get", &trees.classic, "-", "--format", "raw"]).assert().success();
    assert_eq!(run.get_output().stdout, CLASSIC.as_flattened());
    let elevation = fixture("v1/elevation.goblin");
    command(&["get", &elevation, &trees.name("a.exr"), "--level", "4"]).assert().success();
    assert!(!samples(&trees.path("a.exr")).is_empty());
    let run = command(&["get", &trees.octree, "-", "--format", "raw", "--slice", "9"]).assert().success();
    assert_eq!(run.get_output().stdout.len(), 12 * 9);
}

#[test]
fn boxes_are_in_world_coordinates() {
    let trees = Trees::new();
    let (placed, part) = (trees.name("placed.goblin"), trees.name("part.raw"));
    let transform = ["--transform", "10,0,1000,0,-10,2000", "--kind", "categorical"];
    command(&["build", "-q", &fixture("classic.png"), "-o", &placed]).args(transform).assert().success();
    command(&["get", &placed, &part, "--in", "world", "--window", "1030,1970,1070,1990"]).assert().success();
    assert_eq!(std::fs::read(&part).unwrap(), [3, 3, 3, 1, 3, 3, 2, 1]);
    assert_eq!(stdout(&["point", &placed, "--", "1035,1995", "-5,7"]), "3\noutside\n");
    assert_eq!(stdout(&["point", &placed, "-5,7", "1035,1995", "-5.5 -.7e3"]), "outside\n3\noutside\n");
    assert_eq!(stdout(&["point", &placed, "-5,7", "--level", "1", "1035,1995"]), "outside\n1\n");
    command(&["get", &placed, &part, "--in", "world", "--window", "-1030,-1970,1070,1990"])
        .assert()
        .success();
    assert!(complaint(&["point", &placed, "-5"], 2).contains("-5"));
    assert!(
        complaint(&["get", &placed, &part, "--window", "-1,0,4,4"], 1).contains("expected integers from 0")
    );
    assert!(
        complaint(&["get", &placed, &part, "--in", "world", "--window", "0,0,10,10"], 1)
            .contains("1000,1920,1080,2000")
    );
    complaint(&["get", &placed, &part, "--in", "world", "--window", "10,0,0,10"], 1);
}

#[test]
fn get_rejects_invalid_arguments() {
    let trees = Trees::new();
    let before = std::fs::read(&trees.classic).unwrap();
    assert!(
        complaint(&["get", &trees.classic, &trees.classic, "--format", "png"], 1)
            .contains("an input and the output")
    );
    assert_eq!(std::fs::read(&trees.classic).unwrap(), before);
    let out = trees.name("out.png");
    assert!(complaint(&["get", &trees.classic, &trees.name("out.gif")], 1).contains("unknown format"));
    complaint(&["get", &trees.classic, &out, "--level", "4"], 1);
    complaint(&["get", &trees.classic, &out, "--level", "1", "--size", "2x2"], 2);
    complaint(&["get", &trees.classic, &out, "--size", "0x2"], 2);
    complaint(&["get", &trees.classic, &out, "--window", "0,0,0,1"], 1);
    complaint(&["get", &trees.classic, &out, "--window", "1,2,3"], 2);
    for outside in ["8,0,2,2", "0,8,2,2", "900,900,2,2"] {
        for query in [&["get", &trees.classic, &out][..], &["stats", &trees.classic]] {
            let said = complaint(&[query, &["--window", outside]].concat(), 1);
            assert!(said.contains("outside of the tree, which has 8 x 8 cells"), "{said}");
        }
    }
    for step in ["window=8,0,2,2", "window=-2,0,2,2", "window=100,100,120,120,in=world"] {
        complaint(&["get", &trees.classic, &out, "--view", step], 1);
    }
    complaint(&["get", &trees.octree, &out, "--slice", "y=3", "--window", "0,10,2,2"], 1);
    complaint(&["get", &trees.octree, &out, "--slice", "10"], 1);
    // Rows that would exceed the memory limit.
    let most = u64::MAX.to_string();
    for request in [
        ["--window", "0,0,4000000000,1"],
        ["--window", &format!("0,0,{most},{most}")],
        ["--size", "4000000000x10"],
        ["--size", &format!("{most}x{most}")],
    ] {
        for format in ["png", "tif", "exr", "npy", "raw"] {
            let file = if format == "exr" { fixture("v1/elevation.goblin") } else { trees.classic.clone() };
            let text = complaint(&["get", &file, &out, "--format", format, request[0], request[1]], 1);
            assert!(text.contains("a row of") && text.contains("fewer columns"), "{request:?}: {text}");
        }
    }
    assert!(!trees.path("out.png").exists());
}

#[test]
fn points() {
    let trees = Trees::new();
    assert_eq!(stdout(&["point", "--in", "cells", &trees.classic, "3,0", "0,0", "8,0"]), "3\n1\noutside\n");
    assert_eq!(stdout(&["point", "--in", "cells", &trees.classic, "--level", "1", "7,7"]), "2\n");
    assert_eq!(stdout(&["point", "--in", "cells", &trees.classic, "--", "-1,0"]), "outside\n");
    let bulk = "0,0\n3 0\n7;6\n100,100\n";
    command(&["point", "--in", "cells", &trees.classic])
        .write_stdin(bulk)
        .assert()
        .success()
        .stdout("1\n3\n2\noutside\n");
    let many = "3,0\n".repeat(1_500_000);
    let run = command(&["point", "--in", "cells", &trees.classic]).write_stdin(many).assert().success();
    assert!(run.get_output().stdout == "3\n".repeat(1_500_000).into_bytes());
    let run =
        command(&["point", "--in", "cells", &trees.classic]).write_stdin("0,0\n\nhere\n").assert().code(1);
    let text = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(text.contains("standard input, line 3: got `here`, expected X,Y"), "{text}");
    assert!(
        complaint(&["point", &trees.classic, "1,1", "1,2,3,4"], 1)
            .contains("point 2: got `1,2,3,4`, expected X,Y")
    );
    complaint(&["point", &trees.classic, "nan,1"], 1);
    complaint(&["point", &trees.classic, "--level", "4", "1,1"], 1);
    assert_eq!(stdout(&["point", "--in", "cells", &trees.octree, "0,0,10", "12,0,0"]), "outside\noutside\n");
}

#[test]
fn statistics() {
    let trees = Trees::new();
    let count = |class: u8| CLASSIC.as_flattened().iter().filter(|value| **value == class).count() as u64;
    let stats = json(&["stats", &trees.classic, "--json"]);
    assert_eq!(stats["cells"], 64);
    for (i, class) in [1u8, 2, 3].into_iter().enumerate() {
        assert_eq!(stats["classes"][i]["cells"], count(class), "{class}");
    }
    let part = json(&["stats", &trees.classic, "--json", "--window", "3,1,4,2"]);
    assert_eq!((&part["cells"], &part["channels"][0]["mean"]), (&8.into(), &2.375.into()));
    let text = stdout(&["stats", &trees.classic]);
    assert!(
        text.contains("cells      64")
            && text.contains("area       unknown: the coordinate system has no EPSG number"),
        "{text}"
    );
    let degrees = trees.name("degrees.goblin");
    let georeference = ["--crs", "EPSG:4326", "--transform", "1,0,7,0,-1,50", "--kind", "categorical"];
    command(&["build", "-q", &fixture("classic.png"), "-o", &degrees]).args(georeference).assert().success();
    let text = stdout(&["stats", &degrees]);
    assert!(text.contains("area       unknown: cells in degrees"), "{text}");
    assert!(json(&["stats", &degrees, "--json"])["area_m2"].is_null());
    for command in ["stats", "info"] {
        let text = stdout(&[command, &trees.octree]);
        assert!(text.contains("channel 1") && text.contains("standard deviation 2."), "{text}");
        let found = json(&[command, &trees.octree, "--json"]);
        assert!(found["channels"][0]["standard_deviation"].is_f64(), "{found}");
    }
    assert!(json(&["stats", &trees.octree, "--json"])["histogram"].as_array().unwrap().len() == 16);
    let bins = |bins: &str| json(&["stats", &trees.octree, "--json", "--bins", bins])["histogram"].clone();
    assert_eq!((bins("0").as_array().unwrap().len(), bins("65536").as_array().unwrap().len()), (0, 65536));
    assert!(complaint(&["stats", &trees.octree, "--bins", "65537"], 2).contains("65536"));
}

#[test]
fn statistics_of_any_number_of_polygons_are_printed() {
    let trees = Trees::new();
    let document = trees.name("many.geojson");
    let squares = (0..300).map(|i| {
        let (x, y) = (i % 7, i / 7 % 7);
        let ring = format!("[[{x},{y}],[{0},{y}],[{0},{1}],[{x},{1}]]", x + 1 + i % 5, y + 2);
        let geometry =
            if i == 5 { "null".into() } else { format!(r#"{{"type":"Polygon","coordinates":[{ring}]}}"#) };
        format!(r#"{{"type":"Feature","id":{i},"properties":{{}},"geometry":{geometry}}}"#)
    });
    let squares = squares.collect::<Vec<_>>().join(",");
    std::fs::write(&document, format!(r#"{{"type":"FeatureCollection","features":[{squares}]}}"#)).unwrap();
    let words =
        ["stats", &trees.classic, "--zones", &document, "--measure", "majority,sum,median,void_share"];
    let words = [&words[..], &["--quantiles", "0.1,0.025", "--edge", "area"]].concat();
    for format in ["--json", "--csv"] {
        let printed = |memory: &str| stdout(&[&words[..], &[format, "--memory", memory]].concat());
        // Fewer than ten of 300 features at a time.
        assert_eq!(printed("8K"), printed("256M"));
    }
    let found = json(&[&words[..], &["--json"]].concat());
    let zones = found["zones"].as_array().unwrap();
    assert_eq!((zones.len(), &zones[5]["id"], &zones[5]["cells"]), (300, &5.into(), &0.0.into()));
    let table = stdout(&[&words[..], &["--csv"]].concat());
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert!(
        table.starts_with("zone,id,")
            && rows[0].ends_with(&["majority", "sum", "median", "void_share", "q10", "q2_5"])
    );
    for (number, zone) in zones.iter().enumerate().filter(|(_, zone)| zone["cells"] != 0.0) {
        let channel = &zone["channels"][0];
        // The class with the most cells, the first of tied ones.
        let classes = zone["classes"].as_array().unwrap();
        let most = classes.iter().map(|class| class["cells"].as_f64().unwrap()).fold(0.0, f64::max);
        let majority = classes.iter().find(|class| class["cells"].as_f64().unwrap() == most).unwrap();
        assert_eq!(channel["majority"], majority["value"]);
        let inside = zone["cells"].as_f64().unwrap() + zone["void_cells"].as_f64().unwrap();
        assert_eq!(zone["void_share"].as_f64().unwrap(), zone["void_cells"].as_f64().unwrap() / inside);
        let all = ((1 + number % 5) * 2) as f64;
        assert!((inside + zone["outside_cells"].as_f64().unwrap() - all).abs() < 1e-9, "{zone}");
        let row = rows.iter().find(|row| row[1] == number.to_string()).unwrap();
        let last = |back: usize| row[row.len() - back].parse::<f64>().unwrap();
        assert_eq!(Some(last(4)), channel["median"].as_f64());
        assert_eq!(Some(last(2)), channel["quantiles"]["0.1"].as_f64());
    }
    let text = stdout(&words);
    for printed in [" VOID", "  channel 1  sum ", "  majority ", "  median ", "  quantile 0.025 "] {
        assert!(text.contains(printed), "{printed}: {text}");
    }
    // Text and tables have the requested measures only.
    for other in [" outside", " cells", "min ", "mean ", "standard deviation", "minority", "variety"] {
        assert!(!text.contains(other), "{other}: {text}");
    }
    let columns = [&["zone", "id", "layer", "time", "channel"][..], &rows[0][rows[0].len() - 6..]].concat();
    assert_eq!(rows[0], columns);
    complaint(&[&words[..6], &["--quantiles", "2"]].concat(), 1);
    complaint(&[&words[..4], &["--measure", "middle"]].concat(), 2);
}

#[test]
fn statistics_of_polygons() {
    let trees = Trees::new();
    let document = trees.name("zones.geojson");
    let polygon = |name: &str, ring: &str| {
        format!(
            r#"{{"type":"Feature","properties":{{"name":"{name}"}},"geometry":{{"type":"Polygon","coordinates":[{ring}]}}}}"#
        )
    };
    let features = [
        polygon("all", "[[0,0],[8,0],[8,8],[0,8],[0,0]]"),
        polygon("half a column", "[[2,0],[2.5,0],[2.5,8],[2,8]]"),
        polygon("outside", "[[20,0],[28,0],[28,8]]"),
    ];
    std::fs::write(
        &document,
        format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, features.join(",")),
    )
    .unwrap();
    let whole = json(&["stats", &trees.classic, "--json"]);
    for border in ["centre", "area"] {
        let found = json(&["stats", &trees.classic, "--json", "--zones", &document, "--edge", border]);
        let zones = found["zones"].as_array().unwrap();
        assert_eq!(zones.len(), 3);
        assert_eq!((&zones[0]["name"], &zones[0]["cells"]), (&"all".into(), &64.0.into()));
        for (zone, class) in
            zones[0]["classes"].as_array().unwrap().iter().zip(whole["classes"].as_array().unwrap())
        {
            assert_eq!(zone["cells"].as_f64(), class["cells"].as_f64());
        }
        let half = if border == "area" { 4.0 } else { 0.0 };
        assert_eq!((&zones[1]["cells"], &zones[2]["cells"]), (&half.into(), &0.0.into()));
    }
    let text = stdout(&["stats", &trees.classic, "--zones", &document, "--edge", "area"]);
    assert!(
        text.contains("half a column  4 cells, and 0 VOID") && text.contains("outside  0 cells"),
        "{text}"
    );
    // By default, cells count by their centres.
    assert!(stdout(&["stats", &trees.classic, "--zones", &document]).contains("half a column  0 cells"));
    // Cells that are touched; selected features and attributes.
    let some = [
        "stats",
        &trees.classic,
        "--json",
        "--zones",
        &document,
        "--edge",
        "touch",
        "--where",
        "name=half a column",
    ];
    let found = json(&[&some[..], &["--attribute", "name"]].concat());
    assert_eq!((found["zones"].as_array().unwrap().len(), &found["zones"][0]["cells"]), (1, &8.0.into()));
    for (wrong, advice) in [
        (["--where", "name=missing"], "none with name=missing"),
        (["--where", "place=x"], "features' attributes: name"),
        (["--attribute", "name,place"], "features' attributes: name"),
    ] {
        let query = ["stats", &trees.classic, "--zones", &document, "--json"];
        let said = complaint(&[&query, &wrong[..]].concat(), 1);
        assert!(said.contains(advice), "{said}");
    }
    complaint(&["stats", &trees.classic, "--where", "name"], 2);
    complaint(&["stats", &trees.classic, "--edge", "area"], 2);
    complaint(&["stats", &trees.classic, "--zones", &document, "--window", "0,0,1,1"], 2);
    assert!(
        complaint(&["stats", &trees.classic, "--zones", &trees.name("none.geojson")], 1)
            .contains("none.geojson")
    );
    std::fs::write(&document, r#"{"type":"Point","coordinates":[1,2]}"#).unwrap();
    assert!(complaint(&["stats", &trees.classic, "--zones", &document], 1).contains("`Point`"));
}

#[test]
fn searches() {
    let trees = Trees::new();
    let covered = |arguments: &[&str]| {
        let lines = stdout(arguments);
        let blocks = lines.lines().map(|line| serde_json::from_str::<Json>(line).unwrap());
        let area = |block: Json| block["size"][0].as_u64().unwrap() * block["size"][1].as_u64().unwrap();
        blocks.map(area).sum::<u64>()
    };
    let count =
        |test: fn(u8) -> bool| CLASSIC.as_flattened().iter().filter(|value| test(**value)).count() as u64;
    assert_eq!(covered(&["find", &trees.classic, "--class", "3", "--json"]), count(|class| class == 3));
    assert_eq!(covered(&["find", &trees.classic, "--above", "1", "--json"]), count(|class| class > 1));
    assert_eq!(covered(&["find", &trees.classic, "--below", "2", "--json"]), count(|class| class < 2));
    assert_eq!(stdout(&["find", &trees.classic, "--class", "1", "--limit", "2"]).lines().count(), 2);
    assert_eq!(stdout(&["find", &trees.classic, "--class", "9"]), "");
    // By size, and by world position.
    let levels = |arguments: &[&str]| -> Vec<u8> {
        stdout(arguments).lines().map(|line| line.split(' ').nth(1).unwrap().parse().unwrap()).collect()
    };
    let mut all = levels(&["find", &trees.classic, "--class", "1"]);
    assert!(!all.is_sorted());
    all.sort_unstable();
    assert_eq!(levels(&["find", &trees.classic, "--class", "1", "--largest", "1000"]), all);
    assert_eq!(levels(&["find", &trees.classic, "--class", "1", "--largest", "3"]), all[..3]);
    complaint(&["find", &trees.classic, "--class", "1", "--largest", "0"], 2);
    let part = ["--window", "4,4,2,2", "--above", "0", "--largest", "1"];
    let text = stdout(&[&["find", &trees.classic][..], &part].concat());
    assert_eq!(text.split(' ').nth(4), Some("4,4,6,6"), "{text}");
    let found = json(&["find", &trees.octree, "--above", "-1", "--largest", "1", "--json"]);
    assert_eq!(found["world"], serde_json::json!([[0.0, 0.0, 0.0], [2.0, 2.0, 2.0]]));
    complaint(&["find", &trees.classic], 2);
    complaint(&["find", &trees.classic, "--class", "1", "--above", "1"], 2);
}

#[cfg(unix)]
#[test]
fn a_closed_pipe_is_not_reported() {
    let file = fixture("v1/segments.goblin");
    for arguments in [&["find", &file, "--above", "-1"][..], &["dump", &file, "--codes"], &["info", &file]] {
        let mut child = Process::new(assert_cmd::cargo::cargo_bin("spinney"))
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let run = child.wait_with_output().unwrap();
        assert_eq!(String::from_utf8_lossy(&run.stderr), "", "{arguments:?}");
    }
}

#[test]
fn verify_distinguishes_good_from_corrupt_files() {
    let trees = Trees::new();
    command(&["verify", &trees.classic]).assert().code(0);
    command(&["verify", &trees.octree]).assert().code(0);
    let mut bytes = std::fs::read(&trees.classic).unwrap();
    bytes[60] ^= 1;
    let bad = trees.name("bad.goblin");
    std::fs::write(&bad, bytes).unwrap();
    let run = command(&["verify", &bad]).assert().code(1);
    let text = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
    assert!(text.lines().any(|line| line.contains("segment")), "{text}");
    // A file that cannot be opened does not prevent the others from being checked.
    let missing = trees.name("missing.goblin");
    let run = command(&["verify", &missing, &bad, &trees.classic]).assert().code(1);
    let (out, err) = (run.get_output().stdout.clone(), run.get_output().stderr.clone());
    let (out, err) = (String::from_utf8(out).unwrap(), String::from_utf8(err).unwrap());
    assert!(err.lines().count() == 1 && err.contains(&missing), "{err}");
    assert!(out.contains(&bad) && out.ends_with(&format!("{}: good\n", trees.classic)), "{out}");
}

#[test]
fn help_has_examples() {
    for command in ["build", "info", "get", "point", "stats", "find", "dump", "verify"] {
        let text = stdout(&[command, "--help"]);
        assert!(text.contains("Examples:") && text.contains(&format!("  spinney {command} ")), "{command}");
    }
}

#[test]
fn completions_for_every_shell() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        assert!(stdout(&["completions", shell]).contains("spinney"), "{shell}");
    }
    complaint(&["completions", "csh"], 2);
}

#[test]
fn files_that_are_no_trees() {
    let trees = Trees::new();
    let (empty, text) = (trees.name("empty.goblin"), trees.name("text.goblin"));
    std::fs::write(&empty, "").unwrap();
    std::fs::write(&text, "hello\n".repeat(100)).unwrap();
    let missing = trees.name("missing.goblin");
    let directory = trees.directory.path().to_str().unwrap();
    for file in [&empty, &text, &missing, directory, &fixture("classic.png")] {
        let out = trees.name("never.png");
        let commands: [&[&str]; 7] = [
            &["info", file],
            &["get", file, &out],
            &["point", file, "1,1"],
            &["stats", file],
            &["find", file, "--above", "1"],
            &["dump", file],
            &["verify", file],
        ];
        for arguments in commands {
            assert!(complaint(arguments, 1).contains(file), "{arguments:?}");
        }
        assert!(!trees.path("never.png").exists());
    }
    for input in [&empty, &text, &missing, directory] {
        let out = trees.name("never.goblin");
        assert!(complaint(&["build", input, "-o", &out], 1).contains(input.trim_end_matches('/')));
        assert!(!trees.path("never.goblin").exists());
    }
    complaint(&[], 2);
    complaint(&["grow"], 2);
}
