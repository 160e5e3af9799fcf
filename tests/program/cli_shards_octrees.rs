//! Octrees built in shards, from volumes and from models.

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use crate::common::Random;
use crate::common::command::{complaint, spinney, stderr};
use crate::common::directory::TestDirectory;

/// Size of the volumes in cells: more than a unit of a tree of 8 levels along each axis.
const SIZE: [usize; 3] = [140, 90, 150];

impl TestDirectory {
    /// Compares the bytes of sharded builds of volumes or models with those of a single build.
    fn compare_octrees(&self, inputs: &[&str], options: &[&str], shards: &[u32]) {
        self.compare_with(["build", "plan"], &[inputs, options].concat(), shards);
    }
}

/// Returns a ball in noise, with uniform regions.
fn samples() -> Vec<u8> {
    let mut random = Random(7);
    let [width, height, planes] = SIZE;
    let positions =
        (0..planes).flat_map(|z| (0..height).flat_map(move |y| (0..width).map(move |x| [x, y, z])));
    let sample = |[x, y, z]: [usize; 3]| {
        let away =
            [(x, 70), (y, 45), (z, 75)].map(|(at, middle)| at.abs_diff(middle).pow(2)).iter().sum::<usize>();
        match away {
            0..1600 => 200,
            1600..4000 => random.below(9) as u8,
            _ => 3,
        }
    };
    positions.map(sample).collect()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

/// Returns a volume of floats as `numpy.save` writes it.
fn npy() -> Vec<u8> {
    let [width, height, planes] = SIZE;
    let header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({planes}, {height}, {width}), }}");
    let mut bytes = b"\x93NUMPY\x01\0\x76\0".to_vec();
    bytes.extend(format!("{header:117}\n").bytes());
    bytes.extend(samples().iter().flat_map(|sample| (f32::from(*sample) / 7.0).to_le_bytes()));
    bytes
}

#[test]
fn shards_of_volumes_make_the_bytes_of_a_build() {
    let temp = TestDirectory::new();
    let array = temp.write("a.npy", npy());
    temp.compare_octrees(&[&array], &["--transform", "0.1,0.5,2"], &[1, 2, 7, 64]);
    temp.compare_octrees(&[&array], &["--codec", "packed", "--max-error", "0.1", "--depth", "9"], &[3]);
    let [x, y, z] = SIZE;
    let raw = temp.write("a.raw", [&[9; 5][..], &samples()].concat());
    let size = format!("{x},{y},{z}");
    let layout = ["--raw-size", &size, "--raw-type", "u8", "--raw-skip", "5"];
    let void = [&layout[..], &["--nodata", "3", "--kind", "categorical"]].concat();
    temp.compare_octrees(&[&raw], &void, &[1, 7]);
    temp.compare_octrees(&[&raw], &[&void[..], &["--codec", "packed"]].concat(), &[2]);
    // So long that nodes are above the minimum top level.
    let long = temp.write("long.raw", &samples()[..160_000]);
    temp.compare_octrees(&[&long], &["--raw-size", "40000,2,2", "--raw-type", "u8"], &[5]);
    // Readable only from the start.
    temp.write("b.raw.gz", gzip(&samples()));
    let head = format!(
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: {x} {y} {z}\nencoding: gzip\ndata file: b.raw.gz\n"
    );
    let nrrd = temp.write("b.nhdr", head.as_bytes());
    temp.compare_octrees(&[&nrrd], &[], &[1, 2, 7]);
}

#[test]
fn shards_of_sections_make_the_bytes_of_a_build() {
    let temp = TestDirectory::new();
    let sections = |ending: &str| -> Vec<String> {
        fs::create_dir(temp.path(ending)).unwrap();
        (0..70).map(|z| temp.raster(&format!("{ending}/{z}.{ending}"), [z, 0], [150, 70])).collect()
    };
    let options = ["--pages", "z", "--crs", "EPSG:32632", "--transform", "10,10,10"];
    sections("tif");
    temp.compare_octrees(&[&temp.name("tif")], &options, &[1, 2, 7]);
    // Readable only from top to bottom, and in a custom order.
    let names = sections("png");
    let names: Vec<&str> = names.iter().rev().map(String::as_str).collect();
    temp.compare_octrees(&names, &options, &[3]);
}

/// Returns a solid of revolution around z, given its outline of distances and heights, as OFF.
fn turned(outline: &[[f64; 2]], sides: usize) -> String {
    let mut text = String::new();
    let count = outline.len();
    writeln!(text, "OFF\n{} {} 0", count * sides, count * sides).unwrap();
    for side in 0..sides {
        let around = side as f64 / sides as f64 * std::f64::consts::TAU;
        for [away, height] in outline {
            writeln!(text, "{} {} {height}", away * around.cos(), away * around.sin()).unwrap();
        }
    }
    for (side, at) in (0..sides).flat_map(|side| (0..count).map(move |at| (side, at))) {
        let corner = |side: usize, at: usize| side % sides * count + at % count;
        let [a, b, c, d] =
            [corner(side, at), corner(side + 1, at), corner(side + 1, at + 1), corner(side, at + 1)];
        writeln!(text, "4 {a} {b} {c} {d}").unwrap();
    }
    text
}

/// Returns a torus.
fn torus() -> String {
    let at = |step: usize| step as f64 / 18.0 * std::f64::consts::TAU;
    let outline: Vec<[f64; 2]> =
        (0..18).map(|step| [10.0 + 4.0 * at(step).cos(), 4.0 * at(step).sin()]).collect();
    turned(&outline, 36)
}

/// A cube with colours by materials.
const CUBE: &str = "mtllib cube.mtl\nv 0 0 0\nv 8 0 0\nv 0 8 0\nv 8 8 0\nv 0 0 8\nv 8 0 8\nv 0 8 8\nv 8 8 8\n\
                    usemtl red\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nusemtl blue\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";

#[test]
fn shards_of_models_make_the_bytes_of_a_build() {
    let temp = TestDirectory::new();
    let torus = temp.write("torus.off", torus().as_bytes());
    temp.compare_octrees(&[&torus], &["--cells", "200"], &[1, 2, 7, 64]);
    temp.compare_octrees(&[&torus], &["--cell", "0.2", "--edge", "area", "--codec", "packed"], &[3]);
    temp.compare_octrees(&[&torus], &["--depth", "9", "--shell", "--up", "y", "--unit", "mm"], &[5]);
    // Along cell walls, with colours; and several models, as parts.
    let cube = temp.write("cube.obj", CUBE.as_bytes());
    temp.write("cube.mtl", b"newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n");
    temp.compare_octrees(&[&cube], &["--cell", "0.0625", "--attribute", "colour"], &[1, 7]);
    temp.compare_octrees(&[&cube, &torus], &["--cells", "150", "--attribute", "part"], &[4]);
    let corners = (0..8).map(|at| format!("v {} {} {}\n", at % 2 * 16384, at / 2 % 2, at / 4));
    let bar = corners.collect::<String>() + &CUBE[CUBE.find("usemtl").unwrap()..];
    let bar = temp.write("bar.obj", bar.as_bytes());
    temp.compare_octrees(&[&bar], &["--cells", "65536"], &[7]);
    // One with inconsistent face orientation, alone and among others.
    let odd = temp.write("odd.obj", CUBE.replace("f 1 3 4 2", "f 2 4 3 1").as_bytes());
    temp.compare_octrees(&[&odd], &["--cells", "100"], &[2]);
    temp.compare_octrees(&[&odd, &torus], &["--cells", "150", "--edge", "area"], &[7]);
}

#[test]
fn shards_of_a_scan_make_the_bytes_of_a_build() {
    let temp = TestDirectory::new();
    let mesh = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/mesh/rocker-arm.ply");
    if !mesh.exists() {
        eprintln!("skipped: there is no {}", mesh.display());
        return;
    }
    temp.compare_octrees(&[mesh.to_str().unwrap()], &["--cells", "300"], &[7]);
}

#[test]
fn octrees_of_other_inputs_than_planned_are_refused() {
    let temp = TestDirectory::new();
    let job = temp.name("job");
    // A model's materials.
    let cube = temp.write("cube.obj", CUBE.as_bytes());
    let materials = temp.write("cube.mtl", b"newmtl red\nKd 1 0 0\n");
    let plan = |inputs: &[&str]| {
        fs::remove_dir_all(&job).unwrap_or_default();
        spinney(&[&["-q", "shard", "plan", "-o", &job, "--shards", "2"], inputs].concat()).success();
    };
    plan(&[&cube, "--attribute", "colour", "--cells", "50"]);
    let file = fs::File::options().append(true).open(&materials).unwrap();
    file.set_modified(file.metadata().unwrap().modified().unwrap() + Duration::from_secs(7)).unwrap();
    let said = complaint(&["shard", "build", &job, "1"], 1);
    assert!(said.contains("cube.mtl") && said.contains("was planned"), "{said}");
    // The samples of a volume.
    temp.write("a.raw", [1; 24]);
    let head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nencoding: raw\ndata file: a.raw\n";
    plan(&[&temp.write("a.nhdr", head.as_bytes())]);
    temp.write("a.raw", [1; 25]);
    assert!(complaint(&["shard", "build", &job, "1"], 1).contains("a.raw"));
    // An image added to a directory of sections.
    fs::create_dir(temp.path("sections")).unwrap();
    let first = temp.raster("sections/1.png", [0, 0], [9, 5]);
    plan(&[&temp.name("sections"), "--pages", "z"]);
    fs::copy(first, temp.path("sections/2.png")).unwrap();
    assert!(complaint(&["shard", "build", &job, "1"], 1).contains("2.png"));
    // A shard without work needs no input.
    spinney(&["-q", "shard", "build", &job, "0"]).success();
    fs::remove_file(temp.path("sections/2.png")).unwrap();
    spinney(&["-q", "shard", "build", &job, "1"]).success();
}

#[test]
fn octrees_that_shards_cannot_build_are_reported() {
    let temp = TestDirectory::new();
    let job = temp.name("job");
    let open = torus();
    let open = open.trim_end().rsplit_once('\n').unwrap().0.replacen(" 648 0", " 647 0", 1);
    let open = temp.write("open.off", open.as_bytes());
    let closed = temp.write("torus.off", torus().as_bytes());
    let array = temp.write("a.npy", npy());
    let raster = temp.raster("p.tif", [0, 0], [30, 20]);
    for (words, expected) in [
        (&[&*open][..], "--shell"),
        (&[&open, "--shell", "--brep"], "cannot be used with"),
        (&[&closed, "--brep"], "--brep: works only with `spinney build`"),
        (&[&closed, "--stats"], "--stats: works only with `spinney build`"),
        (&[&closed, "--leaf-size", "5"], "--leaf-size: works only with `spinney build`"),
        (&[&closed, "--nodata", "5"], "--nodata: works only with rasters and volumes"),
        (&[&closed, "--grid", "xyz"], "--grid: works only with `spinney build`"),
        (&[&array, "--cells", "5"], "is not a model"),
        (&[&array, &array], "expected one volume"),
        (&[&array, "--band", "1"], "have no effect on volumes"),
        (&[&raster, "--shell"], "is not a model"),
        // No server listens there: that is the error, rather than an unknown type.
        (&["http://127.0.0.1:9/a.ply", "--remote-timeout", "2"], "127.0.0.1:9"),
    ] {
        let said = stderr(spinney(&[&["shard", "plan", "-o", &job], words].concat()).failure());
        assert!(said.contains(expected), "{words:?}: {said}");
        assert!(!Path::new(&job).exists());
    }
    spinney(&["-q", "shard", "plan", "-o", &job, &open, "--shell", "--shards", "2"]).success();
}

#[test]
fn corrupt_plans_of_octrees_are_rejected() {
    let temp = TestDirectory::new();
    let job = temp.name("job");
    let model = temp.write("cube.obj", CUBE.as_bytes());
    spinney(&["-q", "shard", "plan", "-o", &job, &model, "--cells", "200", "--shards", "2"]).success();
    let plan = temp.path("job/plan.json");
    let json: serde_json::Value = serde_json::from_slice(&fs::read(&plan).unwrap()).unwrap();
    for (pointer, value, word) in [
        ("/work/solid/survey/bounds", r#"["1"]"#, "expected a sequence"),
        ("/work/solid/survey/bounds/0/0", r#""1e99""#, "bounds"),
        ("/work/solid/survey/bounds/0/0", r#""nan""#, "bounds"),
        ("/work/solid/survey/inside/0/0", r#""x""#, "ascending codes"),
        ("/work/solid/survey/inside/0/0", r#""7fffffffffffffe5""#, "ascending codes"),
        ("/work/solid/options/resolution", r#"{"cells": 0}"#, "cells along"),
        ("/work/solid/options/edge", r#""odd""#, "odd"),
        ("/work/solid/survey/is_divided", "null", "plan"),
        ("/work/solid/survey/bounds/0/0", r#""-0.5""#, "was planned"),
    ] {
        let mut bad = json.clone();
        *bad.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer} in {json}")) =
            serde_json::from_str(value).unwrap();
        fs::write(&plan, bad.to_string()).unwrap();
        let said = complaint(&["shard", "build", &job, "0"], 1);
        assert!(said.contains(word), "{pointer} {value}: {said}");
    }
}
