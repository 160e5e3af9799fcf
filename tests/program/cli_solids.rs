//! Octrees on the command line, as users type it.

use std::path::Path;

use serde_json::Value as Json;
use spinney::raw::import::raster::{self, Pixels};
use spinney::{DataKind, Region, Rule};
use tempfile::TempDir;

use crate::common::command::{command, complaint, stdout};
use crate::common::{Cells, OCT, QUAD, as_byte, byte, goblin_bytes, made};

/// A directory with trees to query.
struct Trees {
    directory: TempDir,
    /// A block of 6 x 4 x 3 cells at 2,1,0 in 10 x 9 x 5 cells.
    block: String,
    /// An octree of numbers.
    numbers: String,
    cells: Cells,
    quadtree: String,
}

impl Trees {
    fn new() -> Trees {
        let directory = tempfile::tempdir().unwrap();
        let store = |name: &str, bytes: Vec<u8>| {
            let path = directory.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path.to_str().unwrap().to_string()
        };
        let cells = made(OCT, [10, 9, 5], |[x, y, z]| {
            ((2..8).contains(&x) && (1..5).contains(&y) && z < 3).then(|| byte(255))
        });
        let block = store("block.goblin", goblin_bytes(&cells, Rule::Occupancy, DataKind::Continuous));
        let cells = Cells::random(OCT, 5, [12, 9, 10], 9, true);
        let numbers = store("numbers.goblin", goblin_bytes(&cells, Rule::Mean, DataKind::Continuous));
        let flat = Cells::random(QUAD, 5, [12, 9, 1], 9, true);
        let flat = goblin_bytes(&flat, Rule::Majority, DataKind::Categorical);
        let quadtree = store("quadtree.goblin", flat);
        Trees { directory, block, numbers, cells, quadtree }
    }

    fn name(&self, name: &str) -> String {
        self.directory.path().join(name).to_str().unwrap().into()
    }
}

fn read_image(path: &str) -> ([u64; 2], Vec<u8>) {
    let mut raster = raster::open(Path::new(path), &Default::default()).unwrap();
    let mut pixels = Pixels::default();
    let (width, height) = (raster.info().width, raster.info().height);
    raster.read(Region::new(0, 0, width, height), &mut pixels).unwrap();
    ([width, height], pixels.bytes)
}

/// Returns the shape and samples of an array of bytes.
fn array(path: &str) -> (String, Vec<u8>) {
    let bytes = std::fs::read(path).unwrap();
    let end = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8_lossy(&bytes[10..end]).into_owned();
    let shape = header.split_once("'shape': ").unwrap().1.split_once(')').unwrap().0.to_string();
    (shape + ")", bytes[end..].to_vec())
}

#[test]
fn slices() {
    let trees = Trees::new();
    let out = trees.name("slice.png");
    command(&["get", &trees.block, &out, "--slice", "z=2"]).assert().success().stdout("");
    let (size, pixels) = read_image(&out);
    assert_eq!((size, pixels.iter().filter(|pixel| **pixel == 255).count()), ([10, 9], 24));
    // Vertical slices are upright: the block is at the bottom.
    command(&["get", &trees.block, &out, "--slice", "y=4"]).assert().success();
    let (size, pixels) = read_image(&out);
    assert_eq!((size, &pixels[..20], &pixels[42..48]), ([10, 5], &[0; 20][..], &[255; 6][..]));
    command(&["get", &trees.block, &out, "--slice", "x=2", "--window", "0,1,6,3"]).assert().success();
    let row = [0, 255, 255, 255, 255, 0];
    assert_eq!(read_image(&out), ([6, 3], [[0; 6], row, row].concat()));
    let raw = trees.name("slice.raw");
    command(&["get", &trees.block, &raw, "--slice", "x=2", "--window", "0,1,6,3"]).assert().success();
    assert_eq!(std::fs::read(&raw).unwrap(), [row, row, [0; 6]].concat());
    command(&["get", &trees.block, &out, "--slice", "x=5", "--level", "2"]).assert().success();
    assert_eq!(read_image(&out).0, [3, 2]);
    command(&["get", &trees.block, &out, "--slice", "x=5", "--size", "90x50"]).assert().success();
    assert_eq!(read_image(&out).0, [90, 50]);
    command(&["get", &trees.block, &out, "--slice", "z=2.5", "--in", "world"]).assert().success();
    assert!(complaint(&["get", &trees.block, &out, "--slice", "z=2.5"], 1).contains("--in world"));
    assert!(
        complaint(&["get", &trees.block, &out, "--slice", "y=9"], 1)
            .contains("cell y=9 is outside of the tree, expected 0 to 8")
    );
    assert!(
        complaint(&["get", &trees.block, &out, "--slice", "y=9.5", "--in", "world"], 1).contains("outside")
    );
    assert!(complaint(&["get", &trees.block, &out, "--slice", "w=1"], 2).contains("z=12"));
    assert!(
        complaint(&["get", &trees.block, &out, "--slice", "x=1", "--in", "world", "--window", "0,0,1,1"], 1)
            .contains("--window")
    );
    for slice in ["x=1", "z=0", "z=1"] {
        let text = complaint(&["get", &trees.quadtree, &out, "--slice", slice], 1);
        assert!(text.contains("is a quadtree, which has no slices"), "{text}");
    }
    assert!(complaint(&["get", &trees.block, &out, "--in", "world"], 1).contains("--window or --slice"));
}

#[test]
fn boxes_and_whole_octrees() {
    let trees = Trees::new();
    let out = trees.name("box.npy");
    command(&["get", &trees.numbers, &out, "--window", "3,2,1,5,4,6", "--nodata", "200"]).assert().success();
    let (shape, samples) = array(&out);
    assert_eq!(shape, "(6, 4, 5)");
    let mut expected = Vec::new();
    for (z, y) in (1..7).flat_map(|z| (2..6).map(move |y| (z, y))) {
        expected.extend((3..8).map(|x| trees.cells.get([x, y, z]).map_or(200, as_byte)));
    }
    assert_eq!(samples, expected);
    command(&["get", &trees.block, &out]).assert().success();
    let (shape, samples) = array(&out);
    assert_eq!(
        (shape.as_str(), samples.iter().map(|n| u64::from(*n)).sum::<u64>()),
        ("(5, 9, 10)", 72 * 255)
    );
    command(&["get", &trees.block, &out, "--level", "2"]).assert().success();
    assert_eq!(array(&out).0, "(2, 3, 3)");
    command(&["get", &trees.block, &out, "--window", "0,0,0,1,1,1", "--level", "0"]).assert().success();
    assert_eq!(array(&out), ("(1, 1, 1)".into(), vec![(72.0f64 * 255.0 / 4096.0).round() as u8]));
    command(&["get", &trees.block, &out, "--window", "1.5,0,0,2.5,1,2.5", "--in", "world"])
        .assert()
        .success();
    assert_eq!(array(&out), ("(3, 1, 2)".into(), vec![0; 6]));
    command(&["get", &trees.block, &out, "--window", "2,1,3,2"]).assert().success();
    assert_eq!(array(&out).0, "(5, 2, 3)");
    command(&["get", &trees.block, &out, "--slice", "0"]).assert().success();
    assert_eq!(array(&out).0, "(9, 10)");
    let refuse = |options: &[&str], code: i32| {
        complaint(&[&["get", &trees.block, &trees.name("never.npy")], options].concat(), code)
    };
    assert!(refuse(&["--window", "0,0,0,11,1,1"], 1).contains("10 x 9 x 5"));
    assert!(refuse(&["--window", "20,0,0,1,1,1"], 1).contains("10 x 9 x 5"));
    assert!(refuse(&["--window", "50,0,0,51,1,1", "--in", "world"], 1).contains("outside"));
    assert!(refuse(&["--window", "0,0,0,1,0,1"], 1).contains("at least 1 along each axis"));
    assert!(refuse(&["--window", "0.5,0,0,1,1,1"], 1).contains("add --in"));
    assert!(refuse(&["--window", "-1,0,0,1,1,1"], 1).contains("expected integers from 0"));
    assert!(refuse(&["--window", "0,0,0,1,1"], 2).contains("got 5 numbers, expected 4"));
    assert!(refuse(&["--level", "5"], 1).contains("0 to 4"));
    assert!(
        refuse(&["--window", "0,0,0,1,1,1", "--slice", "1"], 1)
            .contains("got 6 numbers, which select an array, expected 4")
    );
    assert!(refuse(&["--window", "0,0,0,1,1,1", "--format", "png"], 1).contains(".npy"));
    let quad = ["get", &trees.quadtree, &trees.name("never.npy"), "--window", "0,0,0,1,1,1"];
    assert!(complaint(&quad, 1).contains("quadtree"));
    assert!(!Path::new(&trees.name("never.npy")).exists());
}

#[test]
fn points_of_octrees() {
    let trees = Trees::new();
    assert_eq!(stdout(&["point", &trees.block, "2.5,1.5,0.5", "2.5,1.5,3.5"]), "255\nvoid\n");
    assert_eq!(stdout(&["point", "--in", "cells", &trees.block, "7,4,2", "8,4,2"]), "255\nvoid\n");
    assert_eq!(stdout(&["point", "--in", "cells", "--level", "0", &trees.block, "7,4,2"]), "4\n");
    assert!(complaint(&["point", &trees.block, "1,2"], 1).contains("got `1,2`, expected X,Y,Z"));
    let mut input = String::new();
    let mut expected = String::new();
    let extent = spinney::open(&trees.numbers).unwrap().header().extent;
    for i in 0..30_000u64 {
        let cell = [i % 13, i / 13 % 10, i / 130 % 11];
        input += &format!("{} {} {}\n", cell[0], cell[1], cell[2]);
        let is_outside = (0..3).any(|axis| cell[axis] >= extent[axis]);
        let nothing = if is_outside { "outside\n" } else { "void\n" };
        expected += &trees.cells.get(cell).map_or(nothing.into(), |number| format!("{}\n", as_byte(number)));
    }
    let run = command(&["point", "--in", "cells", &trees.numbers]).write_stdin(input).assert().success();
    assert!(run.get_output().stdout == expected.as_bytes());
    let turned = ["point", "--in", "cells", "--view", "mirror=x", &trees.block, "2,1,0", "1,1,0"];
    assert_eq!(stdout(&turned), "255\nvoid\n");
}

#[test]
fn statistics_of_solids() {
    let trees = Trees::new();
    let json = |arguments: &[&str]| -> Json { serde_json::from_str(&stdout(arguments)).unwrap() };
    let found = json(&["stats", &trees.block, "--json"]);
    let solid = &found["solid"];
    assert_eq!((&solid["volume"], &solid["level"]), (&72.0.into(), &4.into()));
    // The surface is computed on request.
    assert!(solid.as_object().unwrap().keys().all(|key| !key.contains("surface") && key != "faces"));
    let with_surface = json(&["stats", &trees.block, "--json", "--surface"]);
    assert_eq!(with_surface["solid"]["surface_of_blocks"], 2.0 * (24.0 + 18.0 + 12.0));
    assert_eq!(with_surface["solid"]["faces"], serde_json::json!([24, 36, 48]));
    assert_eq!(with_surface["solid"]["volume"], solid["volume"]);
    assert_eq!(solid["centre"], serde_json::json!([5.0, 3.0, 1.5]));
    assert_eq!(solid["bounds_cells"], serde_json::json!([[2, 1, 0], [8, 5, 3]]));
    let coarse = json(&["stats", &trees.block, "--json", "--level", "3"]);
    assert_eq!(coarse["solid"]["level"], 3);
    assert!((coarse["solid"]["volume"].as_f64().unwrap() - 72.0).abs() < 0.5);
    let text = stdout(&["stats", &trees.block]);
    assert!(text.contains("volume   72 (72.000 cells") && !text.contains("surface"), "{text}");
    assert!(stdout(&["stats", &trees.block, "--surface"]).contains("108 of blocks"));
    assert!(stdout(&["stats", &trees.numbers, "--surface"]).contains("of blocks"));
    // Trees that are not solids are reported as before.
    assert!(json(&["stats", &trees.numbers, "--json"])["solid"].is_null());
    assert!(!stdout(&["stats", &trees.numbers]).contains("solid"));
    let present = trees.cells.cells.iter().flatten().count() as f64;
    assert_eq!(json(&["stats", &trees.numbers, "--json", "--solid"])["solid"]["volume"], present);
    let turned = json(&["stats", &trees.block, "--json", "--view", "scale=2,2,2", "--view", "rotate=90,x"]);
    assert_eq!(turned["solid"]["volume_cells"], 8.0 * 72.0);
    assert!(complaint(&["stats", &trees.quadtree, "--solid"], 1).contains("quadtree"));
    assert!(complaint(&["stats", &trees.quadtree, "--surface"], 1).contains("quadtree"));
    assert!(complaint(&["stats", &trees.block, "--level", "5"], 1).contains("0 to 4"));
    assert!(
        complaint(&["stats", &trees.block, "--solid", "--window", "0,0,1,1"], 1).contains("whole octree")
    );
}

#[test]
fn images_of_solids() {
    let trees = Trees::new();
    let out = trees.name("solid.png");
    let render = |options: &[&str]| {
        command(&[&["render", "-q", &trees.block, &out], options].concat())
            .assert()
            .success()
            .stdout("")
            .stderr("");
        read_image(&out)
    };
    let (size, pixels) = render(&["--size", "60x40"]);
    assert_eq!((size, pixels.len()), ([60, 40], 60 * 40 * 3));
    let (_, pixels) =
        render(&["--size", "64x48", "--background", "#102030", "--orthographic", "--from", "180,0"]);
    assert_eq!(pixels[..3], [0x10, 0x20, 0x30]);
    let seen = pixels.chunks(3).filter(|pixel| *pixel != [0x10, 0x20, 0x30]).count();
    // Six cells wide and three high fill the width except for a margin; edges are rounded by a
    // fraction of a cell.
    let expected = (0.92f64 * 64.0).powi(2) / 2.0;
    assert!((seen as f64 / expected - 1.0).abs() < 0.25, "{seen} {expected}");
    let (_, pixels) =
        render(&["--size", "20x20", "--background", "transparent", "--up", "y", "--scale", "0.5"]);
    assert_eq!((pixels.len(), &pixels[..4]), (1600, &[0; 4][..]));
    render(&["--size", "20x20", "--view", "rotate=30,z", "--level", "3", "--samples", "1"]);
    let never = trees.name("never.png");
    let refuse =
        |options: &[&str], code: i32| complaint(&[&["render", &trees.block, &never], options].concat(), code);
    assert!(refuse(&["--level", "5"], 1).contains("0 to 4"));
    assert!(refuse(&["--size", "0x10"], 2).contains("WxH"));
    assert!(refuse(&["--size", "10000000x10"], 1).contains("65536"));
    assert!(refuse(&["--from", "10"], 2).contains("azimuth"));
    assert!(refuse(&["--from", "10,91"], 2).contains("-90 to 90"));
    assert!(refuse(&["--scale", "0"], 1).contains("scale"));
    assert!(refuse(&["--background", "sky"], 2).contains("#rrggbb"));
    assert!(refuse(&["--format", "exr"], 2).contains("png"));
    assert!(complaint(&["render", &trees.quadtree, &never], 1).contains("is a quadtree; use `spinney get`"));
    assert!(complaint(&["render", &trees.block, &trees.name("a.gif")], 1).contains("unknown format"));
    assert!(
        complaint(&["render", &trees.block, &trees.block, "--format", "png"], 1)
            .contains("input and the output")
    );
    assert!(!Path::new(&never).exists());
    let text = stdout(&["render", "--help"]);
    assert!(text.contains("Examples:") && text.contains("  spinney render ") && text.contains("1024x768"));
}
