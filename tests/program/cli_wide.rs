//! 64-bit integers in all commands: none is converted to floating point.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::common::command::{complaint, spinney, stdout};
use crate::common::directory::TestDirectory;
use crate::common::tiff_file::{Ifd, Values, file};

/// Numbers that are equal to their neighbours as f64, row by row; the last one is nodata.
const NUMBERS: [u64; 12] = {
    const A: u64 = (1 << 63) + 3;
    [A, A, A + 1, A + 2, A, A, A - 1, u64::MAX, 0, 1, (1 << 53) + 1, u64::MAX - 1]
};
const SIGNED: [i64; 12] = {
    const A: i64 = -(1 << 62) - 3;
    [A, A, A + 1, A + 2, A, A, A - 1, i64::MAX, 0, -1, (1 << 53) + 1, i64::MIN + 1]
};

impl TestDirectory {
    fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.name(name)).unwrap()
    }
}

/// Writes a TIFF file of 4 x 3 samples of 64 bits.
fn tiff(path: &str, bytes: Vec<u8>, format: u16, nodata: &'static str) {
    let image = Ifd::grey(4, 3, bytes).short(258, &[64]).short(339, &[format]);
    fs::write(path, file(&[image.tag(42113, Values::Text(nodata))])).unwrap();
}

fn unsigned() -> TestDirectory {
    let directory = TestDirectory::new();
    let bytes = NUMBERS.iter().flat_map(|number| number.to_le_bytes()).collect();
    tiff(&directory.name("u.tif"), bytes, 1, "18446744073709551614");
    spinney(&["-q", "build", &directory.name("u.tif"), "-o", &directory.name("u.goblin")]).success();
    directory
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&stdout(arguments)).unwrap()
}

#[test]
fn unsigned_numbers_are_preserved_in_images_points_and_searches() {
    let directory = unsigned();
    let tree = directory.name("u.goblin");
    // Single cells, few and many.
    for (index, number) in NUMBERS.iter().enumerate() {
        let expected = if *number == u64::MAX - 1 { "void".into() } else { number.to_string() };
        let cell = format!("{},{}", index % 4, index / 4);
        assert_eq!(stdout(&["point", "--in", "cells", &tree, &cell]).trim(), expected);
    }
    // Conditions distinguish adjacent integers.
    let cells = |arguments: &[&str]| {
        let lines = stdout(&[&["find", &tree, "--json"][..], arguments].concat());
        let blocks = lines.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        let sizes = blocks.map(|block| {
            block["size"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).product::<u64>()
        });
        sizes.sum::<u64>()
    };
    assert_eq!(cells(&["--class", "9223372036854775811"]), 4);
    assert_eq!(cells(&["--class", "9223372036854775812"]), 1);
    assert_eq!(cells(&["--above", "9223372036854775811"]), 3);
    assert_eq!(cells(&["--below", "9223372036854775811"]), 4);
    assert_eq!(cells(&["--above", "18446744073709551615"]), 0);
    assert_eq!(cells(&["--above", "9223372036854775811.0"]), 3);
    assert_eq!(cells(&["--class", "-1"]), 0);
    let found = stdout(&["find", &tree, "--class", "9223372036854775812"]);
    assert!(found.trim().ends_with(" 9223372036854775812"), "{found}");
    let found = json(&["find", &tree, "--class", "9223372036854775812", "--json"]);
    assert_eq!(found["value"], 9_223_372_036_854_775_812u64);
    // Statistics, and the file's metadata.
    let found = json(&["stats", &tree, "--json"]);
    assert_eq!((&found["channels"][0]["min"], &found["channels"][0]["max"]), (&0.into(), &u64::MAX.into()));
    let part = json(&["stats", &tree, "--window", "0,0,3,2", "--json"]);
    assert_eq!(part["channels"][0]["min"], (1u64 << 63) + 2);
    assert_eq!(part["channels"][0]["max"], (1u64 << 63) + 4);
    let info = json(&["info", &tree, "--json"]);
    assert_eq!((&info["nodata"], &info["value"]), (&(u64::MAX - 1).into(), &"u64".into()));
    assert!(stdout(&["info", &tree]).contains("max 18446744073709551615"));
}

#[test]
fn unsigned_numbers_round_trip_through_files() {
    let directory = unsigned();
    // As classes: means could be any number, which would leave none free for VOID.
    let tree = directory.name("classes.goblin");
    spinney(&["-q", "build", &directory.name("u.tif"), "--kind", "categorical", "-o", &tree]).success();
    let expected: Vec<u8> = NUMBERS.iter().flat_map(|number| number.to_le_bytes()).collect();
    for name in ["a.raw", "a.npy"] {
        spinney(&["-q", "get", &tree, &directory.name(name)]).success();
        assert!(directory.bytes(name).ends_with(&expected), "{name}");
    }
    assert!(String::from_utf8_lossy(&directory.bytes("a.npy")[..80]).contains("'<u8'"));
    // Another nodata value.
    spinney(&["-q", "get", &tree, &directory.name("b.raw"), "--nodata", "9223372036854775809"]).success();
    assert_eq!(directory.bytes("b.raw")[88..], ((1u64 << 63) + 1).to_le_bytes());
    // TIFF, and cloud-optimized, and trees built from these.
    spinney(&["-q", "get", &tree, &directory.name("a.tif")]).success();
    spinney(&["-q", "export", &tree, &directory.name("c.tif")]).success();
    for name in ["a.tif", "c.tif"] {
        let again = directory.name(&format!("{name}.goblin"));
        spinney(&["-q", "build", &directory.name(name), "--kind", "categorical", "-o", &again]).success();
        spinney(&["-q", "get", &again, &directory.name("again.raw")]).success();
        assert_eq!(directory.bytes("again.raw"), expected, "{name}");
        assert_eq!(json(&["info", &again, "--json"])["nodata"], u64::MAX - 1, "{name}");
    }
    assert!(String::from_utf8_lossy(&directory.bytes("c.tif")).contains(">18446744073709551615</Item>"));
    // PNG renders colours; EXR has no such samples.
    spinney(&["-q", "get", &tree, &directory.name("a.png")]).success();
    assert!(complaint(&["get", &tree, &directory.name("a.exr")], 1).contains("write .tif or .npy"));
}

#[test]
fn edits_and_classes_have_all_digits() {
    let directory = unsigned();
    let (tree, file) = (directory.name("u.goblin"), directory.name("u.autumn"));
    spinney(&["-q", "convert", &tree, &file]).success();
    let point = |cell: &str| stdout(&["point", "--in", "cells", &file, cell]).trim().to_string();
    spinney(&["-q", "edit", &file, "fill", "--window", "0,0,2,1", "--value", "9223372036854775813"])
        .success();
    assert_eq!([point("1,0"), point("0,1")], ["9223372036854775813", "9223372036854775811"]);
    fs::write(directory.name("cells.csv"), "0,0,9223372036854775815\n3,2,18446744073709551613\n1,1,void\n")
        .unwrap();
    spinney(&["-q", "edit", &file, "set", &directory.name("cells.csv")]).success();
    assert_eq!(
        [point("0,0"), point("3,2"), point("1,1")],
        ["9223372036854775815", "18446744073709551613", "void"]
    );
    // The same as rows of an array.
    let mut rows = b"\x93NUMPY\x01\0\x76\0".to_vec();
    rows.extend(format!("{:117}\n", "{'descr': '<u8', 'fortran_order': False, 'shape': (2, 3)}").bytes());
    rows.extend(
        [0, 0, (1 << 63) + 7, 1, 0, u64::MAX - 4].iter().flat_map(|number: &u64| number.to_le_bytes()),
    );
    fs::write(directory.name("cells.npy"), rows).unwrap();
    spinney(&["-q", "edit", &file, "set", &directory.name("cells.npy")]).success();
    assert_eq!([point("0,0"), point("1,0")], ["9223372036854775815", "18446744073709551611"]);
    for wrong in ["-1", "18446744073709551616", "0.5"] {
        let said = complaint(&["edit", &file, "fill", "--window", "0,0,1,1", "--value", wrong], 1);
        assert!(said.contains("u64"), "{said}");
    }
    // As classes, keeping the name of one that exceeds i64.
    let sidecar = "<PAMDataset><PAMRasterBand band=\"1\"><GDALRasterAttributeTable>\
        <FieldDefn index=\"0\"><Name>V</Name><Type>1</Type><Usage>5</Usage></FieldDefn>\
        <FieldDefn index=\"1\"><Name>N</Name><Type>2</Type><Usage>2</Usage></FieldDefn>\
        <Row index=\"0\"><F>9223372036854775811</F><F>most of it</F></Row>\
        <Row index=\"1\"><F>9223372036854775812</F><F>next to it</F></Row>\
        </GDALRasterAttributeTable></PAMRasterBand></PAMDataset>";
    fs::write(directory.name("u.tif.aux.xml"), sidecar).unwrap();
    let classes = directory.name("k.goblin");
    spinney(&["-q", "build", &directory.name("u.tif"), "-o", &classes]).success();
    let found = json(&["stats", &classes, "--json"]);
    let named = |value: u64| {
        let all = found["classes"].as_array().unwrap();
        let class = all.iter().find(|class| class["value"] == value).unwrap();
        (class["cells"].as_u64().unwrap(), class["name"].as_str().map(String::from))
    };
    assert_eq!(named((1 << 63) + 3), (4, Some("most of it".into())));
    assert_eq!(named((1 << 63) + 4), (1, Some("next to it".into())));
    assert_eq!(named((1 << 63) + 5), (1, None));
    assert!(stdout(&["info", &classes]).contains("9223372036854775812              1 cells  next to it"));
    spinney(&["-q", "get", &classes, &directory.name("k.tif")]).success();
    let aux_xml = fs::read_to_string(directory.name("k.tif.aux.xml")).unwrap();
    assert!(aux_xml.contains("<F>9223372036854775811</F><F>most of it</F>"), "{aux_xml}");
}

#[test]
fn signed_numbers_of_all_widths_round_trip() {
    let directory = TestDirectory::new();
    let bytes: Vec<u8> = SIGNED.iter().flat_map(|number| number.to_le_bytes()).collect();
    tiff(&directory.name("i.tif"), bytes.clone(), 2, "-9223372036854775807");
    let small: Vec<u8> = (0..12).map(|number| (number * 20 - 128) as i8 as u8).collect();
    let image = Ifd::grey(4, 3, small.clone()).short(339, &[2]);
    fs::write(directory.name("s.tif"), file(&[image])).unwrap();
    for (name, value, expected) in [("i", "i64", bytes), ("s", "i8", small)] {
        let tree = directory.name(&format!("{name}.goblin"));
        spinney(&["-q", "build", &directory.name(&format!("{name}.tif")), "-o", &tree]).success();
        assert_eq!(json(&["info", &tree, "--json"])["value"], value);
        for output in ["a.raw", "a.npy"] {
            spinney(&["-q", "get", &tree, &directory.name(output)]).success();
            assert!(directory.bytes(output).ends_with(&expected), "{name} {output}");
        }
        spinney(&["-q", "get", &tree, &directory.name("a.tif")]).success();
        spinney(&["-q", "build", &directory.name("a.tif"), "-o", &directory.name("again.goblin")]).success();
        spinney(&["-q", "get", &directory.name("again.goblin"), &directory.name("again.raw")]).success();
        assert_eq!(directory.bytes("again.raw"), expected);
    }
    let tree = directory.name("i.goblin");
    assert_eq!(
        stdout(&["point", "--in", "cells", &tree, "0,0", "2,0"]),
        "-4611686018427387907\n-4611686018427387906\n"
    );
    assert_eq!(json(&["info", &tree, "--json"])["nodata"], i64::MIN + 1);
    let found = stdout(&["find", &tree, "--below", "-4611686018427387907"]);
    assert_eq!(found.lines().count(), 1, "{found}");
    assert!(found.trim().ends_with(" -4611686018427387908"));
}

#[test]
fn means_of_large_numbers_that_are_alike_are_those_numbers() {
    // Large areas of one number, and halves of two numbers that differ by 2: through views, other
    // grids and images of other sizes.
    let directory = TestDirectory::new();
    let number = |x: usize| (1u64 << 63) + if x < 8 { 3 } else { 5 };
    let bytes: Vec<u8> = (0..16 * 16).flat_map(|index| number(index % 16).to_le_bytes()).collect();
    let image = Ifd::grey(16, 16, bytes).short(258, &[64]);
    fs::write(directory.name("a.tif"), file(&[image])).unwrap();
    spinney(&["-q", "build", &directory.name("a.tif"), "-o", &directory.name("a.goblin")]).success();
    let samples = |name: &str| -> Vec<u64> {
        let bytes = directory.bytes(name);
        bytes.chunks_exact(8).map(|bytes| u64::from_le_bytes(bytes.try_into().unwrap())).collect()
    };
    for exact in [&[][..], &["--exact"]] {
        let arguments = ["-q", "get", &directory.name("a.goblin"), &directory.name("s.raw"), "--size", "5x5"];
        spinney(&[&arguments[..], exact].concat()).success();
        let row = [3, 3, 4, 5, 5].map(|more| (1u64 << 63) + more);
        assert_eq!(samples("s.raw"), row.repeat(5), "{exact:?}");
    }
    spinney(&[
        "-q",
        "transform",
        &directory.name("a.goblin"),
        "scale=0.4",
        "-o",
        &directory.name("t.goblin"),
    ])
    .success();
    spinney(&["-q", "get", &directory.name("t.goblin"), &directory.name("t.raw"), "--nodata", "0"]).success();
    let found = samples("t.raw");
    assert!(
        found.iter().all(|number| (3..=5).contains(&number.wrapping_sub(1 << 63)) || *number == 0),
        "{found:?}"
    );
    assert!(found.contains(&((1 << 63) + 3)) && found.contains(&((1 << 63) + 5)));
    assert!(Path::new(&directory.name("t.raw")).exists());
}
