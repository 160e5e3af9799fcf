//! Regions of trees as polygons, which become the same trees again.

use std::fs;
use std::path::Path;

use rayon::prelude::*;
use spinney::export::{VectorFormat, export_polygons};
use spinney::import::feature::{FeatureValue, RasterizeOptions, plan_features};
use spinney::query::PolygonRequest;
use spinney::raw::import::rasterize::FeatureGrid;
use spinney::raw::ops::WarpGrid;
use spinney::raw::store::build_tree;
use spinney::tree::{MemTree, Slab, Slabs, build_slabs};
use spinney::{
    BuildOptions, Crs, DataKind, Dataset, Dimension, Frame, Metadata, Output, Rule, SampleType, TreeType,
    Value, ValueType,
};

use crate::common::Random;

/// An image of two-byte classes.
struct Classes {
    size: [u64; 2],
    cells: Vec<u16>,
}

impl Slabs for Classes {
    fn extent(&self) -> [u64; 3] {
        [self.size[0], self.size[1], 1]
    }

    fn next(&mut self, slab: &mut Slab) -> spinney::Result<bool> {
        let first = slab.bytes.is_empty() && !self.cells.is_empty();
        let bytes = self.cells.drain(..).flat_map(u16::to_le_bytes).collect();
        *slab = Slab { origin: [0; 3], size: self.extent(), bytes, valid: None };
        Ok(first)
    }
}

/// Writes a tree of classes, of which 0 is VOID.
fn tree(path: &Path, size: [u64; 2], cells: Vec<u16>, frame: Frame) -> Dataset {
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U16, 1));
    let depth = spinney::raw::store::depth_for([size[0], size[1], 1]).max(1);
    let options =
        BuildOptions::new(DataKind::Categorical, depth).metadata(Metadata { frame, ..Metadata::default() });
    let output = Output::create(path).unwrap();
    build_slabs(form, &mut Classes { size, cells }, Some(Value::from([0u16])), &options, output, &())
        .unwrap();
    spinney::open(path).unwrap()
}

/// Checks that a tree level's polygons, read as features, give the level's cells.
fn comes_back(directory: &Path, map: &Dataset, level: u8) {
    comes_back_by(directory, map, level, false);
    comes_back_by(directory, map, level, true);
}

/// Round trip of regions connected by edges, or also across corners.
fn comes_back_by(directory: &Path, map: &Dataset, level: u8, across_corners: bool) {
    let (path, again) = (directory.join("regions.geojson"), directory.join("again.goblin"));
    let mut request = PolygonRequest::new();
    (request.level, request.across_corners) = (Some(level), across_corners);
    let made =
        export_polygons(map, &request, Output::create(&path).unwrap(), VectorFormat::GeoJson, &()).unwrap();
    if made.count == 0 {
        assert_eq!(map.statistics(None, &()).unwrap().cells, 0);
        return;
    }
    let [width, height, _] = map.extent_at(level).max;
    let frame = map.metadata().frame.coarser(map.depth() - level);
    let mut options =
        RasterizeOptions::new(FeatureGrid::Like(WarpGrid { frame, extent: [width, height, 1] }));
    options.value = FeatureValue::Attribute("class".into());
    options.depth = Some(level.max(1));
    plan_features(&[path], &options, &()).unwrap().build(Output::create(&again).unwrap(), &()).unwrap();
    let read = spinney::open(&again).unwrap();
    let mut cells = 0;
    for y in 0..height {
        for x in 0..width {
            let (mut one, mut other) = (Default::default(), Default::default());
            let is_there = map.point([x, y, 0], level, &mut one).unwrap();
            let is_again = read.point([x, y, 0], read.depth(), &mut other).unwrap();
            assert_eq!(
                (is_there, one[0].to_f64()),
                (is_again, other[0].to_f64()),
                "{x}, {y} of level {level}"
            );
            cells += u64::from(is_there);
        }
    }
    assert_eq!(made.cells, cells);
}

#[test]
fn fixtures_become_polygons_and_the_same_cells_again() {
    let directory = tempfile::tempdir().unwrap();
    let map = spinney::open("fixtures/v1/classes.goblin").unwrap();
    for level in [8, 7, 5, 2] {
        comes_back(directory.path(), &map, level);
    }
    let cover = spinney::open("fixtures/v1/stack.goblin:cover").unwrap();
    comes_back(directory.path(), &cover, cover.depth());
    let path = directory.path().join("island.goblin");
    spinney::build("fixtures/island_classes.tif", &path).unwrap();
    let island = spinney::open(&path).unwrap();
    comes_back(directory.path(), &island, island.depth());
}

#[test]
fn a_thousand_small_maps_become_polygons_and_the_same_cells_again() {
    (0..1000u64).into_par_iter().for_each(|round| {
        let directory = tempfile::tempdir().unwrap();
        let mut random = Random(round + 1);
        let (size, classes) = ([1 + random.below(9), 1 + random.below(9)], 1 + random.below(4));
        let cells = (0..size[0] * size[1]).map(|_| random.below(classes + 1) as u16).collect();
        let map = tree(
            &directory.path().join("map.goblin"),
            size,
            cells,
            Frame::planar([1.0, 0.0, 0.0, 0.0, -1.0, 9.0]),
        );
        comes_back_by(directory.path(), &map, map.depth(), round % 2 > 0);
    });
}

#[test]
fn regions_across_corners_have_several_polygons_and_an_area() {
    let directory = tempfile::tempdir().unwrap();
    let frame = Frame { crs: Some(Crs::epsg(32633)), ..Frame::planar([10.0, 0.0, 0.0, 0.0, -10.0, 40.0]) };
    #[rustfmt::skip]
    let cells = vec![
        1, 0, 1, 2,
        0, 1, 2, 2,
        1, 0, 1, 0,
    ];
    let map = tree(&directory.path().join("map.goblin"), [4, 3], cells, frame);
    let path = directory.path().join("regions.geojson");
    let mut request = PolygonRequest::new();
    request.across_corners = true;
    let output = Output::create(&path).unwrap();
    let made = export_polygons(&map, &request, output, VectorFormat::GeoJson, &()).unwrap();
    assert_eq!((made.count, made.polygons, made.cells), (2, 6, 8));
    let json: serde_json::Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    let summary = |feature: &serde_json::Value| {
        let kind = feature["geometry"]["type"].as_str().unwrap().to_string();
        let numbers = ["class", "cells", "area_m2"].map(|name| feature["properties"][name].as_f64().unwrap());
        (kind, numbers)
    };
    let mut features: Vec<_> = json["features"].as_array().unwrap().iter().map(summary).collect();
    features.sort_by(|a, b| a.1[0].total_cmp(&b.1[0]));
    assert_eq!(features[0], ("MultiPolygon".to_string(), [1.0, 5.0, 500.0]));
    assert_eq!(features[1].1, [2.0, 3.0, 300.0]);
}

#[test]
fn random_maps_become_polygons_and_the_same_cells_again() {
    let directory = tempfile::tempdir().unwrap();
    let mut random = Random(11);
    for round in 0..16 {
        // Some span several tiles; patches of a few sizes, with few and with many classes.
        let size = [[37, 21], [280, 60], [513, 20], [64, 64]][round % 4];
        let [patch, classes] = [[1, 2], [3, 4], [17, 900], [40, 3]][round / 4 % 4];
        let across = size[0] / patch + 1;
        let patches: Vec<u16> =
            (0..across * (size[1] / patch + 1)).map(|_| random.below(classes + 1) as u16).collect();
        let cells = (0..size[0] * size[1])
            .map(|at| patches[(at / size[0] / patch * across + at % size[0] / patch) as usize])
            .collect();
        // Planar, upside down, and rotated.
        let matrix = [
            [1.0, 0.0, 0.0, 0.0, -1.0, 600.0],
            [2.0, 0.0, 9.0, 0.0, 2.0, 3.0],
            [3.0, -4.0, 0.0, 4.0, 3.0, 0.0],
        ];
        let frame = Frame { crs: Some(Crs::epsg(32633)), ..Frame::planar(matrix[round % 3]) };
        let map = tree(&directory.path().join("map.goblin"), size, cells, frame);
        comes_back(directory.path(), &map, map.depth());
        comes_back(directory.path(), &map, map.depth() - 2);
    }
}

#[test]
fn classes_are_chosen_and_what_has_no_regions_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let map = spinney::open("fixtures/v1/classes.goblin").unwrap();
    let statistics = map.statistics(None, &()).unwrap();
    let (class, cells) = statistics.classes[1];
    let mut request = PolygonRequest::new();
    request.classes = Some(vec![class]);
    let path = directory.path().join("one.csv");
    let made =
        export_polygons(&map, &request, Output::create(&path).unwrap(), VectorFormat::Csv, &()).unwrap();
    assert_eq!(made.cells, cells);
    assert_eq!(fs::read_to_string(&path).unwrap().lines().count() as u64, made.count + 1);
    // 64-bit classes are exact.
    let wide = [9_007_199_254_740_993u64, 9_007_199_254_740_992, u64::MAX, 1];
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U64, 1));
    let cell = |at: [u32; 3]| Some(Value::from([wide[(at[0] + 2 * at[1]) as usize]]));
    let leaves = MemTree::from_cells(form, 1, Rule::Majority, &cell);
    let options = BuildOptions::new(DataKind::Categorical, 1);
    let path = directory.path().join("wide.goblin");
    build_tree(&leaves, [2, 2, 1], &options, Output::create(&path).unwrap(), &()).unwrap();
    let (wide_map, csv) = (spinney::open(&path).unwrap(), directory.path().join("wide.csv"));
    let output = Output::create(&csv).unwrap();
    export_polygons(&wide_map, &PolygonRequest::new(), output, VectorFormat::Csv, &()).unwrap();
    let text = fs::read_to_string(&csv).unwrap();
    assert!(wide.iter().all(|class| text.contains(&class.to_string())), "{text}");
    let heights = spinney::open("fixtures/v1/elevation.goblin").unwrap();
    let output = Output::create(&directory.path().join("no.csv")).unwrap();
    let refusal =
        export_polygons(&heights, &PolygonRequest::new(), output, VectorFormat::Csv, &()).unwrap_err();
    assert!(refusal.to_string().contains("contours"), "{refusal}");
    assert!(!directory.path().join("no.csv").exists());
}
