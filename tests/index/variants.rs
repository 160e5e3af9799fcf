//! Indexes of files of many layouts equal the trees of these files.

use std::path::PathBuf;

use crate::common::{Random, with};
use crate::compare::{Directory, assert_equal, assert_resolves, build, indexed, tree};
use crate::tiffs::{Chunks, Packing, Samples, Tiff};
use spinney::import::raster::ImportOptions;

/// Compares the index of a file with its tree.
fn check(directory: &Directory, tiff: &Tiff, levels: u8, what: &str) {
    let [source, index, whole] = ["a.tif", "a.goblin", "whole.goblin"].map(|name| directory.path(name));
    tiff.write(&source);
    build(std::slice::from_ref(&source), &index, &indexed(levels))
        .unwrap_or_else(|error| panic!("{what}: {error}"));
    tree(std::slice::from_ref(&source), &whole);
    assert_equal(&index, &whole, what);
    assert_resolves(&index, &whole, what);
}

const CHUNKS: [Chunks; 8] = [
    Chunks::Tiles(16, 16),
    Chunks::Strips(7),
    Chunks::Tiles(48, 48),
    Chunks::Strips(256),
    Chunks::Tiles(240, 96),
    Chunks::Strips(1),
    Chunks::Tiles(128, 128),
    Chunks::Tiles(512, 1024),
];
const PACKINGS: [Packing; 5] =
    [Packing::Deflate, Packing::None, Packing::Lzw, Packing::Zstd, Packing::PackBits];
const SAMPLES: [Samples; 11] = [
    Samples::Uint(8),
    Samples::Float(32),
    Samples::Int(16),
    Samples::Uint(16),
    Samples::Int(8),
    Samples::Float(64),
    Samples::Uint(12),
    Samples::Int(32),
    Samples::Float(16),
    Samples::Uint(32),
    Samples::Uint(64),
];

/// Returns a file whose layout is chosen by a number.
fn variant(number: usize) -> Tiff {
    let size = [[300, 130], [257, 90], [530, 61]][number % 3];
    let mut tiff = Tiff::new(size, 1);
    tiff.chunks = CHUNKS[number % CHUNKS.len()];
    tiff.packing = PACKINGS[number % PACKINGS.len()];
    tiff.samples = SAMPLES[number % SAMPLES.len()];
    // (Other values have one channel.)
    let has_channels = matches!(tiff.samples, Samples::Uint(8 | 12 | 16) | Samples::Float(16 | 32));
    tiff.channels = if has_channels { [1, 4, 3, 2][number % 4] } else { 1 };
    tiff.is_planar = tiff.channels > 1 && number % 5 < 3;
    tiff.is_big_endian = number % 13 % 3 == 1;
    let has_predictor = matches!(tiff.packing, Packing::Deflate | Packing::Lzw | Packing::Zstd);
    tiff.predictor = match tiff.samples {
        _ if !has_predictor => 1,
        Samples::Float(_) => [3, 1, 2][number % 17 % 3],
        Samples::Uint(12) => 1,
        _ => [2, 1][number % 17 % 2],
    };
    tiff = tiff.filled(number as u64);
    let mut random = Random(number as u64);
    match number % 7 % 4 {
        1 => tiff.nodata = Some("2"),
        2 => tiff.is_sparse = true,
        3 => {
            let mask = (0..size[0] * size[1]).map(|at| at % size[0] / 50 % 2 == 0 && random.below(9) > 0);
            tiff.mask = Some(mask.collect());
        }
        _ => {}
    }
    if let (Samples::Float(_), 0) = (tiff.samples, number % 2) {
        tiff.nodata = Some("nan");
        (0..500).for_each(|_| tiff.set(size.map(|side| random.below(side)), tiff.samples.nan()));
    }
    tiff.has_alpha = matches!(tiff.channels, 2 | 4) && number % 5 < 3;
    tiff.has_palette = tiff.channels == 1 && tiff.samples == Samples::Uint(8) && number.is_multiple_of(2);
    tiff
}

/// Compares every third layout, from one on.
fn check_variants(first: usize) {
    let directory = Directory::new();
    for number in (first..55).step_by(3) {
        let tiff = variant(number);
        let what = format!("{number}: {:?}", Tiff { pixels: Vec::new(), mask: None, ..tiff.clone() });
        check(&directory, &tiff, [2, 1, 4][number / 3 % 3], &what);
    }
}

#[test]
fn layouts() {
    check_variants(0);
}

#[test]
fn more_layouts() {
    check_variants(1);
}

#[test]
fn still_more_layouts() {
    check_variants(2);
}

#[test]
fn layouts_are_of_all_kinds() {
    let all: Vec<Tiff> = (0..55).map(variant).collect();
    for packing in PACKINGS {
        for samples in SAMPLES {
            let is_one = |tiff: &&Tiff| tiff.packing == packing && tiff.samples == samples;
            assert!(all.iter().any(|tiff| is_one(&tiff)), "{packing:?} {samples:?}");
        }
    }
    let count = |is: &dyn Fn(&Tiff) -> bool| all.iter().filter(|tiff| is(tiff)).count();
    for (what, found) in [
        ("planar", count(&|tiff| tiff.is_planar)),
        ("big-endian", count(&|tiff| tiff.is_big_endian && tiff.predictor > 1)),
        ("predictor 3", count(&|tiff| tiff.predictor == 3)),
        (
            "differences of floats",
            count(&|tiff| tiff.predictor == 2 && matches!(tiff.samples, Samples::Float(_))),
        ),
        ("masks", count(&|tiff| tiff.mask.is_some())),
        ("masks of planes", count(&|tiff| tiff.mask.is_some() && tiff.is_planar)),
        ("sparse", count(&|tiff| tiff.is_sparse)),
        ("alpha", count(&|tiff| tiff.has_alpha)),
        ("palettes", count(&|tiff| tiff.has_palette)),
        ("nodata", count(&|tiff| tiff.nodata == Some("2"))),
        ("NaN", count(&|tiff| tiff.nodata == Some("nan"))),
    ] {
        assert!(found > 1, "{what}: {found}");
    }
}

#[test]
fn sizes_and_depths() {
    let directory = Directory::new();
    let sizes = [
        [1, 1],
        [2, 1],
        [3, 5],
        [255, 255],
        [256, 256],
        [257, 257],
        [256, 1],
        [1000, 3],
        [1, 600],
        [512, 256],
    ];
    for (number, size) in sizes.into_iter().enumerate() {
        for levels in [1, 2, 4] {
            let mut tiff = Tiff::new(size, number as u64);
            tiff.chunks = if number % 2 == 0 { Chunks::Strips(3) } else { Chunks::Tiles(80, 112) };
            check(&directory, &tiff, levels, &format!("{size:?}, {levels} levels"));
        }
    }
    let source = directory.path("d.tif");
    Tiff::new([9, 7], 3).write(&source);
    for depth in 4..=12 {
        let levels = 1 << (depth % 3);
        let [index, whole] = ["d.goblin", "whole.goblin"].map(|name| directory.path(name));
        let deep = |options: ImportOptions| with(options, |it| it.depth = Some(depth));
        build(std::slice::from_ref(&source), &index, &deep(indexed(levels))).unwrap();
        build(std::slice::from_ref(&source), &whole, &deep(ImportOptions::new())).unwrap();
        let what = format!("depth {depth}, {levels} levels");
        assert_equal(&index, &whole, &what);
        assert_resolves(&index, &whole, &what);
    }
}

#[test]
fn uniform_and_empty_files() {
    let directory = Directory::new();
    let mut tiff = Tiff::new([600, 600], 1);
    for (number, nodata) in [(0, None), (5, None), (0, Some("0")), (0, Some("7"))] {
        tiff.fill([0, 0], [600, 600], number);
        tiff.nodata = nodata;
        for is_sparse in [false, true] {
            tiff.is_sparse = is_sparse;
            check(&directory, &tiff, 2, &format!("{number}, nodata {nodata:?}, sparse {is_sparse}"));
        }
    }
    // One cell that differs, in the last block.
    tiff.set([599, 599], 3);
    check(&directory, &tiff, 2, "one cell");
}

#[test]
fn options_of_the_tree_apply() {
    let directory = Directory::new();
    let [source, index, whole] = ["a.tif", "a.goblin", "whole.goblin"].map(|name| directory.path(name));
    let mut tiff = Tiff { channels: 4, has_alpha: true, ..Tiff::new([310, 70], 4) };
    for is_planar in [false, true] {
        tiff = Tiff { is_planar, ..tiff }.filled(9);
        tiff.write(&source);
        let mut all: Vec<ImportOptions> = Vec::new();
        for bands in [&["1"][..], &["3", "1"], &["2", "4"], &["1", "2", "3"]] {
            let bands = bands.iter().map(|band| band.parse().unwrap()).collect();
            all.push(with(ImportOptions::new(), |it| it.bands = Some(bands)));
        }
        all.push(with(ImportOptions::new(), |it| it.nodata = Some(0.into())));
        all.push(with(ImportOptions::new(), |it| it.keep_transparent = true));
        let one = || Some(vec!["2".parse().unwrap()]);
        for rule in ["majority", "dominant", "nearest"] {
            let kind = Some(spinney::DataKind::Categorical);
            all.push(with(ImportOptions::new(), |it| {
                (it.bands, it.kind, it.rule) = (one(), kind, Some(rule.parse().unwrap()));
            }));
        }
        for rule in ["min", "max"] {
            let kind = Some(spinney::DataKind::Continuous);
            all.push(with(ImportOptions::new(), |it| {
                (it.bands, it.kind, it.rule) = (one(), kind, Some(rule.parse().unwrap()));
            }));
        }
        for options in all {
            let what = format!("planar {is_planar}: {options:?}");
            let sources: [PathBuf; 1] = [source.clone()];
            build(&sources, &whole, &options).unwrap_or_else(|error| panic!("{what}: {error}"));
            build(&sources, &index, &with(options, |it| it.referenced = Some(2)))
                .unwrap_or_else(|error| panic!("{what}: {error}"));
            assert_equal(&index, &whole, &what);
            assert_resolves(&index, &whole, &what);
        }
    }
}
