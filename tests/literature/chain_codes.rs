//! Item 18 of the survey's operations: trees are built from chain codes of outlines and of
//! rasterized lines.

use std::path::Path;

use spinney::query::PolygonRequest;
use spinney::raw::export::{ChainDirections, ChainWriter, export_chain_code};
use spinney::raw::store::depth_for;
use spinney::raw::value::Palette;
use spinney::tree::{Slab, Slabs, build_slabs};
use spinney::{
    Bounds, BuildOptions, Crs, DataKind, Dimension, Frame, Metadata, Output, SampleType, TreeType, ValueType,
};

/// An image in one slab.
struct RasterSlab {
    extent: [u64; 3],
    cells: Option<Vec<u8>>,
}

impl Slabs for RasterSlab {
    fn extent(&self) -> [u64; 3] {
        self.extent
    }

    fn next(&mut self, slab: &mut Slab) -> spinney::Result<bool> {
        let Some(bytes) = self.cells.take() else { return Ok(false) };
        *slab = Slab { origin: [0; 3], size: self.extent, bytes, valid: None };
        Ok(true)
    }
}

/// Returns u16 classes in squares of several sizes; 0 is VOID.
fn classes(seed: u64, [width, height]: [u64; 2]) -> Vec<u16> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = |bound: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % bound
    };
    let mut cells = vec![0; (width * height) as usize];
    for _ in 0..60 {
        let (x, y, side, class) = (next(width), next(height), 1 << next(6), next(5) * 300);
        for row in y..(y + side).min(height) {
            for column in x..(x + side).min(width) {
                cells[(row * width + column) as usize] = class as u16;
            }
        }
    }
    cells
}

fn build(cells: &[u16], size: [u64; 2], metadata: Metadata, path: &Path) {
    let extent = [size[0], size[1], 1];
    let bytes = cells.iter().flat_map(|class| class.to_le_bytes()).collect();
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U16, 1));
    let options = BuildOptions::new(DataKind::Categorical, depth_for(extent)).metadata(metadata);
    let mut slabs = RasterSlab { extent, cells: Some(bytes) };
    build_slabs(form, &mut slabs, form.value.splat(0), &options, Output::create(path).unwrap(), &()).unwrap();
}

/// Returns the cells of a tree level; 0 is VOID.
fn cells(path: &Path, level: u8) -> Vec<u16> {
    let tree = spinney::open(path).unwrap();
    let bounds = tree.extent_at(level);
    let mut bytes = vec![0; bounds.volume() as usize * tree.header().form.value.size()];
    tree.window(level, &bounds, 0.0, &mut bytes, None).unwrap();
    match tree.header().form.value.sample {
        SampleType::U8 => bytes.into_iter().map(u16::from).collect(),
        _ => bytes.chunks(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect(),
    }
}

#[test]
fn item_18_trees_round_trip_through_chain_codes() {
    let directory = tempfile::tempdir().unwrap();
    let [tree, text, again] = ["a.goblin", "a.chain", "b.goblin"].map(|name| directory.path().join(name));
    for seed in 0..12 {
        let size = [1 + seed * 37 % 200, 1 + seed * 53 % 300];
        let raster = classes(seed, size);
        let mut frame = Frame::planar([10.0, 0.0, 500_000.25, 0.0, -10.0, 5_200_000.5]);
        frame.crs = Some(Crs::parse("EPSG:32632").unwrap());
        let metadata = Metadata {
            frame,
            nodata: Some(0.into()),
            class_names: [(300u64.into(), "Wood, \"old\"\nand new".to_owned())].into(),
            palette: Some(Palette { colours: vec![[0, 0, 0, 0], [1, 20, 255, 128]] }),
            ..Metadata::default()
        };
        build(&raster, size, metadata, &tree);
        for directions in [ChainDirections::Four, ChainDirections::Eight] {
            for level in [0, 1] {
                let map = spinney::open(&tree).unwrap();
                let level = map.depth().saturating_sub(level);
                let mut request = PolygonRequest::new();
                (request.level, request.across_corners) = (Some(level), seed % 2 == 0);
                let output = Output::create(&text).unwrap();
                let made = export_chain_code(&map, &request, directions, output, &()).unwrap();
                if made.count == 0 {
                    continue;
                }
                spinney::build(&text, &again).unwrap();
                let made = spinney::open(&again).unwrap();
                assert_eq!(made.header().extent[..2], map.extent_at(level).max[..2]);
                assert_eq!(cells(&again, made.depth()), cells(&tree, level), "{seed} {directions:?} {level}");
                let (stored, known) = (made.metadata(), map.metadata());
                let frame = known.frame.coarser(map.depth() - level);
                assert_eq!((stored.frame.affine(), &stored.frame.crs), (frame.affine(), &frame.crs));
                assert_eq!(
                    (&stored.nodata, &stored.class_names, &stored.palette),
                    (&known.nodata, &known.class_names, &known.palette)
                );
                assert_eq!(made.header().kind, DataKind::Categorical);
            }
        }
    }
}

#[test]
fn item_18_an_outline_is_filled_as_the_plane_is() {
    // A closed path in 8 directions with notches; a model tests each point.
    let directory = tempfile::tempdir().unwrap();
    let [text, tree] = ["outline.chain", "outline.goblin"].map(|name| directory.path().join(name));
    let chain = "55555556777777111077111111122333335444444";
    let start = [12i64, 1];
    let steps: [[i64; 2]; 8] = [[1, 0], [1, -1], [0, -1], [-1, -1], [-1, 0], [-1, 1], [0, 1], [1, 1]];
    let mut corners = vec![start];
    for code in chain.bytes() {
        let [x, y] = corners[corners.len() - 1];
        let step = steps[usize::from(code - b'0')];
        corners.push([x + step[0], y + step[1]]);
    }
    assert_eq!(corners.last(), Some(&start), "the example is closed");
    std::fs::write(
        &text,
        format!("freeman-chain-code 1\ndirections 8\nregion 1 {} {}\n{chain}\nend\n", start[0], start[1]),
    )
    .unwrap();
    spinney::build(&text, &tree).unwrap();
    let made = spinney::open(&tree).unwrap();
    let [width, height, _] = made.header().extent;
    let found = cells(&tree, made.depth());
    let is_inside = |[x, y]: [i64; 2]| {
        let mut is_inside = corners.contains(&[x, y]);
        if !is_inside {
            // A ray slightly below the row meets no vertex.
            for pair in corners.windows(2) {
                let ([ax, ay], [bx, by]) = (pair[0], pair[1]);
                let at = |y: f64| ax as f64 + (y - ay as f64) * (bx - ax) as f64 / (by - ay) as f64;
                is_inside ^= (ay > y) != (by > y) && at(y as f64 + 1e-3) < x as f64;
            }
        }
        is_inside
    };
    for y in 0..height as i64 {
        for x in 0..width as i64 {
            assert_eq!(found[(y * width as i64 + x) as usize] == 1, is_inside([x, y]), "{x},{y}");
        }
    }
    assert!(found.iter().filter(|cell| **cell == 1).count() > chain.len());
}

#[test]
fn item_18_lines_become_a_chain_code_and_a_tree() {
    let directory = tempfile::tempdir().unwrap();
    let [map, text, tree] =
        ["map.goblin", "lines.chain", "lines.goblin"].map(|name| directory.path().join(name));
    let size = [40, 30];
    build(&vec![1; 1200], size, Metadata::default(), &map);
    let line = [[2.5, 3.5], [20.5, 9.5], [20.5, 25.5], [60.5, 25.5]];
    let opened = spinney::open(&map).unwrap();
    let output = Output::create(&text).unwrap();
    let mut writer =
        ChainWriter::create(output, &opened, opened.depth(), ChainDirections::Eight, &()).unwrap();
    assert_eq!(writer.line(300u64.into(), &line).unwrap(), 1);
    writer.finish().unwrap();
    spinney::build(&text, &tree).unwrap();
    let made = spinney::open(&tree).unwrap();
    assert_eq!(made.header().extent, [40, 30, 1]);
    let found = cells(&tree, made.depth());
    // The traditional algorithm by its definition: in each column of a flat segment, the cell with
    // the nearest centre.
    let mut expected = vec![0u16; 1200];
    for x in 2..=20u64 {
        let y = (3.0 + (x - 2) as f64 * 6.0 / 18.0 + 0.5).floor() as u64;
        expected[(y * 40 + x) as usize] = 300;
    }
    (9..=25).for_each(|y| expected[y * 40 + 20] = 300);
    (20..40).for_each(|x| expected[25 * 40 + x] = 300);
    assert_eq!(found, expected);
    // A box of the image and its surroundings are the same cells in either API.
    let mut part = vec![0u8; 2 * 4];
    made.window(made.depth(), &Bounds { min: [19, 25, 0], max: [21, 27, 1] }, 0.0, &mut part, None).unwrap();
    assert_eq!(part, [0, 0, 44, 1, 0, 0, 0, 0]);
}
