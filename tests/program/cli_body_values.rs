//! `spinney build --body`: values within bodies, from samples.

use std::fmt::Write as _;
use std::path::Path;

use serde_json::Value as Json;
use spinney::Dataset;

use crate::common::Random;
use crate::common::command::{spinney, stderr, stdout};
use crate::common::directory::TestDirectory;

/// A tetrahedron with sides of 8 along the axes.
const WEDGE: &str = "OFF\n4 4 0\n0 0 0\n8 0 0\n0 8 0\n0 0 8\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

/// Returns the centres of the cells that are not VOID, in the world, and their values.
fn cells(tree: &Dataset) -> Vec<([f64; 3], f64)> {
    let bounds = tree.header().extent_bounds();
    let count = bounds.volume() as usize;
    let (mut bytes, mut valid) = (vec![0; 8 * count], vec![false; count]);
    tree.window(tree.depth(), &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
    let [columns, rows, _] = bounds.size().map(|size| size as usize);
    let centre = |index: usize| {
        let cell = [index % columns, index / columns % rows, index / columns / rows];
        tree.metadata().frame.to_world(cell.map(|cell| cell as f64 + 0.5))
    };
    let value = |index: usize| f64::from_le_bytes(bytes[8 * index..][..8].try_into().unwrap());
    (0..count).filter(|index| valid[*index]).map(|index| (centre(index), value(index))).collect()
}

fn open(path: &str) -> Dataset {
    let tree = spinney::open(Path::new(path)).unwrap();
    assert_eq!(tree.verify(1 << 24, &()).unwrap(), []);
    tree
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * a.abs().max(b.abs())
}

/// Random intervals of vertical holes over the tetrahedron: a table, and positions with values.
fn samples(count: usize) -> (String, Vec<([f64; 3], f64)>) {
    let mut random = Random(11);
    let mut number = |most: u64| (random.below(most * 16)) as f64 / 16.0;
    let (mut text, mut all) = (String::from("hole,X,Y,Z,From,To,density\n"), Vec::new());
    for hole in 0..count {
        let (x, y, from, length, value) = (number(8), number(8), number(8), number(2), number(5) - 2.0);
        writeln!(text, "h{hole},{x},{y},9,{from},{},{value}", from + length).unwrap();
        all.push(([x, y, 9.0 - from - length / 2.0], value));
    }
    (text, all)
}

/// Returns the value at a point by sorting all samples.
fn interpolated(samples: &[([f64; 3], f64)], at: [f64; 3], nearest: usize, radius: f64) -> Option<f64> {
    let square = |from: &[f64; 3]| (0..3).map(|axis| (from[axis] - at[axis]).powi(2)).sum::<f64>();
    let mut found: Vec<(f64, f64)> = samples.iter().map(|(from, value)| (square(from), *value)).collect();
    found.retain(|(square, _)| *square <= radius * radius);
    // (Stable: equally near samples stay in order.)
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(nearest);
    let exact: Vec<f64> =
        found.iter().filter(|(square, _)| *square == 0.0).map(|(_, value)| *value).collect();
    if !exact.is_empty() {
        return Some(exact.iter().sum::<f64>() / exact.len() as f64);
    }
    let sum: f64 = found.iter().map(|(square, _)| 1.0 / square).sum();
    (!found.is_empty()).then(|| found.iter().map(|(square, value)| value / square).sum::<f64>() / sum)
}

#[test]
fn values_are_those_of_a_naive_model() {
    let directory = TestDirectory::new();
    let (text, all) = samples(80);
    let [wedge, table] = [directory.write("wedge.off", WEDGE), directory.write("assays.csv", &text)];
    let [body, out] = ["body.goblin", "out.goblin"].map(|name| directory.name(name));
    stdout(&["build", &wedge, "-o", &body, "--brep", "--unit", "m"]);
    for (options, nearest, radius) in [
        (&[][..], 12, f64::INFINITY),
        (&["--nearest", "1"], 1, f64::INFINITY),
        (&["--nearest", "3", "--radius", "1.5"], 3, 1.5),
        (&["--nearest", "500"], 500, f64::INFINITY),
    ] {
        let words = ["build", &table, "-o", &out, "--body", &body, "--value", "density", "--cell", "0.5"];
        let message = stderr(spinney(&[&words[..], options].concat()).success());
        assert!(message.contains("80 intervals, at their middles"), "{message}");
        let tree = open(&out);
        assert_eq!(tree.metadata().band_names, ["density"]);
        let found = cells(&tree);
        let mut expected = Vec::new();
        for index in 0..16 * 16 * 16 {
            let at = [index % 16, index / 16 % 16, index / 256].map(|cell| f64::from(cell) * 0.5 + 0.25);
            if at.iter().sum::<f64>() < 8.0 {
                expected.extend(interpolated(&all, at, nearest, radius).map(|value| (at, value)));
            }
        }
        assert_eq!(found.len(), expected.len(), "{options:?}");
        assert!(found.len() < 1000 || radius.is_infinite());
        for (found, expected) in found.iter().zip(&expected) {
            assert!(found.0 == expected.0 && near(found.1, expected.1), "{found:?} {expected:?}");
        }
        let stats: Json = serde_json::from_str(&stdout(&["stats", &out, "--json"])).unwrap();
        let integral = expected.iter().map(|(_, value)| value * 0.125).sum::<f64>();
        assert!((stats["integral"].as_f64().unwrap() - integral).abs() < 1e-9, "{stats}");
        assert!(stdout(&["stats", &out]).contains("integral   "), "{options:?}");
        assert_eq!(stats["unit"], "m");
    }
}

/// Layers that share a surface through the centres of cells share no cell; equal values stay equal.
#[test]
fn constant_values_have_the_integral_of_the_volume() {
    let directory = TestDirectory::new();
    let wells = directory.write(
        "wells.csv",
        "x,y,top,coal,base\n0,0,10,4.5,0\n10,0,10,4.5,0\n0,10,10,4.5,0\n10,10,10,4.5,0\n",
    );
    let table = directory.write(
        "points.csv",
        "wkt,v\nPOINT Z (1 1 1),0.1\nPOINT Z (9 2 8),0.1\nPOINT Z (4 4 4.5),0.1\nPOINT Z (4 4 4.5),0.1\n",
    );
    let [body, out, cut] = ["body.goblin", "out.goblin", "cut.goblin"].map(|name| directory.name(name));
    stdout(&["build", &wells, "-o", &body, "--tin", "top,coal,base", "--brep"]);
    let build = |options: &[&str]| {
        let words = ["build", &table, "-o", &out, "--body", &body, "--value", "v", "--cell", "1"];
        let message = stderr(spinney(&[&words[..], options].concat()).success());
        let stats: Json = serde_json::from_str(&stdout(&["stats", &out, "--json"])).unwrap();
        (message, stats["cells"].as_u64().unwrap(), stats["integral"].as_f64().unwrap())
    };
    let (message, cells_of_top, integral) = build(&["--object", "top to coal"]);
    assert!(message.contains("4 points") && message.contains("top to coal"), "{message}");
    assert_eq!((cells_of_top, integral), (600, 0.1 * 600.0));
    let tree = open(&out);
    assert!(cells(&tree).iter().all(|(at, value)| at[2] >= 4.5 && *value == 0.1));
    assert!(
        tree.metadata().provenance.last().unwrap().contains("v within"),
        "{:?}",
        tree.metadata().provenance
    );
    assert!(tree.metadata().provenance.len() > 1, "that of the model");
    let (_, count, integral) = build(&["--object", "coal to base", "--type", "f32"]);
    assert_eq!((count, integral), (400, f64::from(0.1f32) * 400.0));
    assert_eq!(build(&[]).1, 1000);
    // An integral of occupancy would have no meaning.
    stdout(&["build", &body, "-o", &cut, "--cell", "1"]);
    assert!(!stdout(&["stats", &cut]).contains("integral"));
}

#[test]
fn bytes_depend_on_neither_memory_nor_threads() {
    let directory = TestDirectory::new();
    let wedge = directory.write("wedge.off", WEDGE);
    let table = directory.write("assays.csv", &samples(200).0);
    let body = directory.name("body.goblin");
    stdout(&["build", &wedge, "-o", &body, "--brep"]);
    let build = |name: &str, options: &[&str]| {
        let out = directory.name(name);
        let words = [
            "build",
            &table,
            "-o",
            &out,
            "--body",
            &body,
            "--value",
            "density",
            "--cells",
            "70",
            "--nearest",
            "2",
        ];
        stdout(&[&words[..], options].concat());
        std::fs::read(out).unwrap()
    };
    let first = build("a.goblin", &["--threads", "1"]);
    assert!(first == build("b.goblin", &["--threads", "3", "--memory", "32M"]));
}

#[test]
fn wrong_samples_and_bodies_are_refused() {
    let directory = TestDirectory::new();
    let wedge = directory.write("wedge.off", WEDGE);
    let [body, out] = ["body.goblin", "out.goblin"].map(|name| directory.name(name));
    stdout(&["build", &wedge, "-o", &body, "--brep", "--unit", "mm", "--crs", "EPSG:32632"]);
    for (text, options, expected) in [
        ("x,y,z,v\n1,1,1,a\n", &[][..], "1 have no number in `v`"),
        ("x,y,v\n1,1,1\n", &[], "1 no position in space"),
        ("x,y,z,v\n1,1,inf,1\n", &[], "1 no position in space"),
        ("x,y,z,v\n1,1,1,nan\n", &[], "1 have no number in `v`"),
        ("x,y,z,v\n", &[], "none in 0 features"),
        ("x,y,z,w\n1,1,1,1\n", &[], "`v`"),
        ("x,y,z,from,v\n1,1,1,1,1\n", &[], "`from` without `to`"),
        ("x,y,z,from,to,v\n1,1,1,1,2,1\n1,1,1,3,2,1\n", &[], "feature 2"),
        ("wkt,v\n\"LINESTRING Z (0 0 0, 1 1 1)\",1\n", &[], "not a point"),
        ("x,y,z,v\n1,1,1,1e300\n", &["--type", "f32"], "f64"),
        ("x,y,z,v\n1,1,1,1\n", &["--type", "u8"], "f32 or f64"),
        ("x,y,z,v\n1,1,1,1\n", &["--nearest", "0"], "at least 1"),
        ("x,y,z,v\n1,1,1,1\n", &["--radius=-1"], "at least 0"),
        ("x,y,z,v\n1,1,1,1\n", &["--object", "other"], "has no object other"),
        ("x,y,z,v\n1,1,1,1\n", &["--crs", "EPSG:32633"], "EPSG:32632"),
        ("x,y,z,v\n1,1,1,1\n", &["--crs", "EPSG:32632"], "mm"),
        ("x,y,z,v\n1,1,1,1\n", &["--edge", "area"], "--edge: has no effect"),
        ("x,y,z,v\n1,1,1,1\n", &["--cell", "1e-9"], "cells along the longest side"),
    ] {
        let table = directory.write("a.csv", text);
        let words = ["build", &table, "-o", &out, "--body", &body, "--value", "v"];
        let words = if options.contains(&"--cell") {
            words.to_vec()
        } else {
            [&words[..], &["--cell", "1"]].concat()
        };
        let message = stderr(spinney(&[&words[..], options].concat()).failure());
        assert!(message.contains(expected), "{text:?} {options:?}: {message}");
        assert!(!Path::new(&out).exists());
    }
    let table = directory.write("a.csv", "x,y,z,v\n1,1,1,1e308\n2,2,2,-1e308\n1e200,0,0,5\n");
    // Extreme numbers are no error; the mean lies between them.
    stdout(&["build", &table, "-o", &out, "--body", &body, "--value", "v", "--cell", "1"]);
    assert!(cells(&open(&out)).iter().all(|(_, value)| (-1e308..=1e308).contains(value)));
    for (words, expected) in [
        (&["--body", &wedge, "--value", "v"][..], "not an exact model"),
        (&["--body", &body], "--value"),
        (&["--body", &body, "--value", "3"], "--value"),
        (&["--nearest", "2", "--value", "v"], "--body"),
        (&["--body", &body, "--value", "v", "--brep"], "--brep"),
    ] {
        let message = stderr(spinney(&[&["build", &table, "-o", &out], words].concat()).failure());
        assert!(message.contains(expected), "{words:?}: {message}");
    }
    let message = stderr(spinney(&["build", &wedge, "-o", &out, "--body", &body, "--value", "v"]).failure());
    assert!(message.contains("point features"), "{message}");
}
