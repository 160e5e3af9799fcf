//! `spinney stats --labels`.

use std::fs;
use std::path::Path;

use crate::common::command::{complaint, spinney, stdout};

/// Builds a tree of a raster or, with planes, of a volume.
fn built(directory: &Path, name: &str, size: &[usize], values: &[u8], more: &[&str]) -> String {
    let input = match *size {
        [columns, rows] => {
            let input = directory.join(name).with_extension("png");
            let mut encoder =
                png::Encoder::new(fs::File::create(&input).unwrap(), columns as u32, rows as u32);
            encoder.set_color(png::ColorType::Grayscale);
            encoder.write_header().unwrap().write_image_data(values).unwrap();
            input
        }
        _ => {
            let input = directory.join(name).with_extension("npy");
            let shape: Vec<String> = size.iter().rev().map(usize::to_string).collect();
            let shape = shape.join(", ");
            let header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({shape}), }}");
            let header = format!("{header:117}\n");
            let array = [&b"\x93NUMPY\x01\x00\x76\x00"[..], header.as_bytes(), values].concat();
            fs::write(&input, array).unwrap();
            input
        }
    };
    let tree = directory.join(name).with_extension("goblin");
    let [input, tree] = [input, tree].map(|path| path.to_str().unwrap().to_string());
    spinney(&[&["-q", "build", &input, "-o", &tree, "--nodata", "0"], more].concat()).success();
    tree
}

#[test]
fn a_table_lists_labels() {
    let directory = tempfile::tempdir().unwrap();
    #[rustfmt::skip]
    let values = [
        3, 3, 0, 7,
        3, 7, 7, 7,
        5, 7, 0, 3,
    ];
    let placement = ["--transform", "10,0,100,0,-10,200", "--crs", "EPSG:32632", "--kind", "categorical"];
    let tree = built(directory.path(), "small", &[4, 3], &values, &placement);
    let head = "label,class,name,cells,area_m2,min_x,min_y,size_x,size_y,world_min_x,world_min_y,world_max_x,world_max_y,neighbours\n";
    let labels = "\
3,,,4,400,0,0,4,3,100,170,140,200,5:1 7:3
5,,,1,100,0,2,1,1,100,170,110,180,3:1 7:1
7,,,5,500,1,0,3,3,110,170,140,200,3:3 5:1
";
    assert_eq!(stdout(&["stats", &tree, "--labels", "-q"]), format!("{head}{labels}"));
    // Ordered by their first cells in Z order.
    let components = "\
1,3,,3,300,0,0,2,2,100,180,120,200,2:2 3:1
2,7,,5,500,1,0,3,3,110,170,140,200,1:2 3:1 4:1
3,5,,1,100,0,2,1,1,100,170,110,180,1:1 2:1
4,3,,1,100,3,2,1,1,130,170,140,180,2:1
";
    assert_eq!(
        stdout(&["stats", &tree, "--labels", "--connect", "4", "--csv", "-q"]),
        format!("{head}{components}")
    );
    // The same via a tree of labels, in a file.
    let (made, table) = (directory.path().join("labels.goblin"), directory.path().join("t.csv"));
    let [made, table] = [made.to_str().unwrap(), table.to_str().unwrap()];
    spinney(&["-q", "transform", &tree, "components=4", "-o", made]).success();
    spinney(&["-q", "stats", made, "--labels", "--classes", &tree, "-o", table, "--memory", "4K"]).success();
    assert_eq!(fs::read_to_string(table).unwrap(), format!("{head}{components}"));

    let json = stdout(&["stats", &tree, "--labels", "--json", "-q", "--view", "window=0,0,2,2"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let expected = serde_json::json!({ "labels": [
        { "label": 3, "class": null, "name": null, "cells": 3, "area_m2": 300.0, "min": [0, 0], "size": [2, 2],
          "world": [[100.0, 180.0], [120.0, 200.0]], "neighbours": [{ "label": 7, "faces": 2 }] },
        { "label": 7, "class": null, "name": null, "cells": 1, "area_m2": 100.0, "min": [1, 1], "size": [1, 1],
          "world": [[110.0, 180.0], [120.0, 190.0]], "neighbours": [{ "label": 3, "faces": 2 }] },
    ] });
    assert_eq!(json, expected);
}

#[test]
fn a_table_lists_labels_of_volumes() {
    let directory = tempfile::tempdir().unwrap();
    let tree =
        built(directory.path(), "volume", &[2, 2, 2], &[1, 1, 1, 2, 1, 0, 2, 2], &["--transform", "2,1,1"]);
    let expected = "\
label,class,name,cells,volume,min_x,min_y,min_z,size_x,size_y,size_z,world_min_x,world_min_y,world_min_z,world_max_x,world_max_y,world_max_z,neighbours
1,,,4,8,0,0,0,2,2,2,0,0,0,4,2,2,2:4
2,,,3,6,0,1,0,2,1,2,0,1,0,4,2,2,1:4
";
    assert_eq!(stdout(&["stats", &tree, "--labels", "-q"]), expected);
    let components = stdout(&["stats", &tree, "--labels", "--connect", "26", "-q"]);
    assert_eq!(components.lines().nth(1), Some("1,1,,4,8,0,0,0,2,2,2,0,0,0,4,2,2,2:4"));
    assert!(complaint(&["stats", &tree, "--labels", "--connect", "8"], 1).contains("6 or 26"));
}

#[test]
fn invalid_label_requests_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let small = built(directory.path(), "small", &[2, 2], &[1, 2, 3, 4], &[]);
    let large = built(directory.path(), "large", &[3, 2], &[1, 2, 3, 4, 5, 6], &[]);
    let refuse = |more: &[&str], code: i32, expected: &str| {
        let text = complaint(&[&["stats", &small], more].concat(), code);
        assert!(text.contains(expected), "{text}");
    };
    refuse(&["--labels", "--classes", &large], 1, "has other cells than the labels");
    refuse(&["--labels", "-o", "table.gpkg"], 1, "unknown format; use .csv or .json");
    refuse(&["--labels", "-o", &small], 1, "unknown format");
    refuse(&["--labels", "--zones", "x.geojson"], 2, "cannot be used with");
    refuse(&["--labels", "--connect", "5"], 2, "4 or 8");
    refuse(&["--connect", "4"], 2, "--labels");
    refuse(&["--csv"], 2, "--labels");
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 4);
}
