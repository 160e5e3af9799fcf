//! Warped trees against a naive model: every cell separately, from the projections' own formulas.

use std::sync::Arc;

use super::mapping::CellMap;
use super::*;
use crate::ops::view_source::ViewSource;
use crate::tree::{CellBlock, Child, MemTree, Source};
use spinney_base::TreeType;
use spinney_base::space::{Bounds, Cell, Dimension};
use spinney_base::value::{Rule, SampleType, Value, ValueType};
use spinney_crs::{Crs, Frame, web_mercator};

/// Raster of 64 x 64 cells, some of which are VOID.
struct Raster {
    frame: Frame,
    cell: fn(i64, i64) -> Option<u8>,
}

const SIDE: u64 = 64;

fn noise(x: i64, y: i64) -> Option<u8> {
    let mixed =
        ((x * 73_856_093) ^ (y * 19_349_663)).unsigned_abs().wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 56;
    (!mixed.is_multiple_of(11)).then_some(mixed as u8)
}

/// Large patches of few classes.
fn patches(x: i64, y: i64) -> Option<u8> {
    (x + y < 100).then_some((x / 20 + y / 30) as u8)
}

impl Raster {
    fn at(epsg: u32, affine: [f64; 6], cell: fn(i64, i64) -> Option<u8>) -> Raster {
        Raster { frame: Frame { crs: Some(Crs::epsg(epsg)), ..Frame::planar(affine) }, cell }
    }

    fn tree(&self) -> Arc<ViewSource> {
        let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
        let cell = |[x, y, _]: Cell| (self.cell)(x.into(), y.into()).map(|value| Value::from([value]));
        Arc::new(MemTree::from_cells(form, 6, Rule::Mean, &cell).into())
    }

    fn warped(&self, grid: &WarpGrid, resampling: Resampling) -> Warped {
        let options = WarpOptions { resampling: Some(resampling), ..WarpOptions::default() };
        Warped::new(self.tree(), &self.frame, grid, &options).unwrap()
    }

    /// Value of a cell, repeated around the world if the raster is.
    fn value(&self, x: i64, y: i64, turn: Option<i64>) -> Option<u8> {
        let x = if turn == Some(SIDE as i64) { x.rem_euclid(SIDE as i64) } else { x };
        let side = SIDE as i64;
        ((0..side).contains(&x) && (0..side).contains(&y)).then(|| (self.cell)(x, y))?
    }

    fn naive(&self, map: &CellMap, resampling: Resampling, [x, y]: [u64; 2]) -> Option<u8> {
        let turn = map.whole_turn();
        let place = |dx: f64, dy: f64| map.to_source([x as f64 + dx, y as f64 + dy]);
        if resampling.is_of_area() {
            let mut corners = [place(0.0, 0.0)?, place(1.0, 0.0)?, place(1.0, 1.0)?, place(0.0, 1.0)?];
            if let Some(turn) = turn {
                // From corner to corner, in quarters of a cell.
                let around = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
                for i in 1..4 {
                    let (from, to) = (around[i - 1], around[i]);
                    let mut column = corners[i - 1][0];
                    for step in 1..=4 {
                        let t = f64::from(step) / 4.0;
                        let next =
                            place(from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1]))?[0];
                        column = next + turn as f64 * ((column - next) / turn as f64).round();
                    }
                    corners[i][0] = column;
                }
            }
            return self.naive_area(corners, turn, resampling == Resampling::Majority);
        }
        let [column, row] = place(0.5, 0.5)?;
        let nearest = self.value(column.floor() as i64, row.floor() as i64, turn)?;
        let (first, top) = ((column - 0.5).floor(), (row - 0.5).floor());
        let (u, v) = (column - 0.5 - first, row - 0.5 - top);
        let at = |dx: i64, dy: i64| self.value(first as i64 + dx, top as i64 + dy, turn);
        if resampling == Resampling::Nearest {
            return Some(nearest);
        }
        let linear = || {
            let weights = [
                ((0, 0), (1.0 - u) * (1.0 - v)),
                ((1, 0), u * (1.0 - v)),
                ((0, 1), (1.0 - u) * v),
                ((1, 1), u * v),
            ];
            let there = weights
                .iter()
                .filter_map(|((dx, dy), weight)| at(*dx, *dy).map(|value| (f64::from(value), weight)));
            let (sum, total) = there
                .fold((0.0, 0.0), |(sum, total), (value, weight)| (sum + value * weight, total + weight));
            sum / total
        };
        let cubic = || {
            // Keys' function.
            let weight = |t: f64| match t.abs() {
                t if t <= 1.0 => 1.5 * t.powi(3) - 2.5 * t * t + 1.0,
                t => -0.5 * t.powi(3) + 2.5 * t * t - 4.0 * t + 2.0,
            };
            let mut sum = 0.0;
            for dy in -1..3 {
                for dx in -1..3 {
                    sum += weight(u - dx as f64) * weight(v - dy as f64) * f64::from(at(dx, dy)?);
                }
            }
            Some(sum)
        };
        let number = if resampling == Resampling::Cubic { cubic().unwrap_or_else(linear) } else { linear() };
        Some((number + 0.5).floor().clamp(0.0, 255.0) as u8)
    }

    /// Area by clipping the quadrangle against each cell (Sutherland and Hodgman).
    fn naive_area(&self, corners: [[f64; 2]; 4], turn: Option<i64>, is_majority: bool) -> Option<u8> {
        /// Relative tolerance of areas: sums of some hundred products of coordinates below 1.
        const ROUNDING: f64 = 1e-9;
        let rounding = ROUNDING * area_of(&corners).min(1.0);
        let range = |axis: usize| {
            let numbers = corners.map(|corner| corner[axis]);
            let low = numbers.into_iter().fold(f64::INFINITY, f64::min).floor() as i64;
            low..numbers.into_iter().fold(f64::NEG_INFINITY, f64::max).ceil() as i64
        };
        let (mut shares, mut met) = ([0.0; 256], Vec::new());
        for y in range(1) {
            for x in range(0) {
                if let Some(value) = self.value(x, y, turn) {
                    let area = clipped_area(&corners, x as f64, y as f64);
                    shares[usize::from(value)] += area;
                    if area > rounding {
                        met.push(value);
                    }
                }
            }
        }
        let area: f64 = shares.iter().sum();
        if area <= rounding {
            return None;
        }
        if is_majority {
            let most = shares.iter().copied().fold(0.0, f64::max);
            // The first of several, row by row.
            return met.into_iter().find(|value| shares[usize::from(*value)] >= most - rounding);
        }
        let sum: f64 = shares.iter().enumerate().map(|(value, share)| value as f64 * share).sum();
        Some((sum / area + 0.5).floor() as u8)
    }
}

fn clipped_area(corners: &[[f64; 2]; 4], x: f64, y: f64) -> f64 {
    let mut polygon: Vec<[f64; 2]> = corners.iter().map(|corner| [corner[0] - x, corner[1] - y]).collect();
    for (axis, edge, sign) in [(0, 0.0, 1.0), (0, 1.0, -1.0), (1, 0.0, 1.0), (1, 1.0, -1.0)] {
        let inside = |point: &[f64; 2]| sign * (point[axis] - edge);
        let mut next = Vec::new();
        for (i, a) in polygon.iter().enumerate() {
            let b = &polygon[(i + 1) % polygon.len()];
            let (here, there) = (inside(a), inside(b));
            if here >= 0.0 {
                next.push(*a);
            }
            if here * there < 0.0 {
                let t = here / (here - there);
                next.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
            }
        }
        polygon = next;
    }
    area_of(&polygon)
}

fn area_of(polygon: &[[f64; 2]]) -> f64 {
    let Some(&[x, y]) = polygon.first() else { return 0.0 };
    let moved: Vec<[f64; 2]> = polygon.iter().map(|point| [point[0] - x, point[1] - y]).collect();
    let pairs = moved.windows(2).map(|pair| pair[0][0] * pair[1][1] - pair[0][1] * pair[1][0]);
    pairs.sum::<f64>().abs() / 2.0
}

/// Compares the cells of some boxes, of large ones every seventh; counts those that differ by one
/// at a tie of rounding.
fn compare(name: &str, raster: &Raster, grid: &WarpGrid, resampling: Resampling, boxes: &[[u64; 4]]) {
    let warped = raster.warped(grid, resampling);
    let map = CellMap::new(&grid.frame, &raster.frame, SIDE, false).unwrap();
    let (mut cells, mut present, mut close) = (0, 0, 0);
    for &[x, y, width, height] in boxes {
        let bounds = Bounds { min: [x, y, 0], max: [x + width, y + height, 1] };
        let mut block = CellBlock::void((width * height) as usize, 1);
        assert!(warped.draw(&bounds, &mut block.values, &mut block.present).unwrap());
        let step = if width * height > 1000 { 7 } else { 1 };
        for index in (0..(width * height)).step_by(step) {
            let at = [x + index % width, y + index / width];
            let found = block.present[index as usize].then_some(block.values[index as usize]);
            let expected = raster.naive(&map, resampling, at);
            cells += 1;
            present += u32::from(expected.is_some());
            if found != expected {
                let is_close = matches!((found, expected), (Some(a), Some(b)) if a.abs_diff(b) <= 1);
                assert!(is_close, "{name} {resampling} at {at:?}: {found:?}, not {expected:?}");
                close += 1;
            }
        }
    }
    assert!(cells < 20 || present > cells / 20, "{name}: {present} of {cells} cells have a value");
    // (Where a number is halfway between two integers, few cells may be rounded the other way.)
    assert!(close <= 1 + cells / 500, "{name} {resampling}: {close} of {cells} differ");
}

fn xyz(depth: u8) -> WarpGrid {
    WarpGrid { frame: web_mercator(depth), extent: [1 << depth, 1 << depth, 1] }
}

#[test]
fn cells_are_those_of_the_naive_model() {
    let degrees = 360.0 / SIDE as f64;
    let world = [degrees, 0.0, -180.0, 0.0, -degrees / 2.0, 90.0];
    let rasters = [
        ("world", Raster::at(4326, world, noise), xyz(7), [[0, 0, 128, 128], [100, 3, 5, 7]]),
        (
            "world from Greenwich",
            Raster::at(4326, [degrees, 0.0, 0.0, 0.0, -degrees / 2.0, 90.0], noise),
            xyz(7),
            [[0, 0, 128, 128], [50, 0, 30, 9]],
        ),
        (
            "Pacific",
            Raster::at(4326, [0.3, 0.0, 170.0, 0.0, -0.3, 10.0], noise),
            xyz(10),
            [[0, 480, 40, 64], [994, 480, 30, 64]],
        ),
        (
            "zone 32",
            Raster::at(32632, [3000.0, 0.0, 400_000.0, 0.0, -3000.0, 5_400_000.0], noise),
            xyz(14),
            [[8600, 5600, 110, 130], [8640, 5630, 17, 4]],
        ),
        (
            "turned",
            Raster::at(32632, [2000.0, 700.0, 400_000.0, 800.0, -2000.0, 5_400_000.0], noise),
            xyz(13),
            [[4300, 2800, 90, 80], [4310, 2820, 1, 1]],
        ),
        (
            "zone 1",
            Raster::at(32601, [9000.0, 0.0, 200_000.0, 0.0, -9000.0, 500_000.0], noise),
            xyz(12),
            [[0, 2020, 20, 60], [4060, 2020, 36, 60]],
        ),
        (
            "pole",
            Raster::at(3413, [120_000.0, 0.0, -3_840_000.0, 0.0, -120_000.0, 3_840_000.0], noise),
            xyz(7),
            [[0, 0, 128, 30], [30, 1, 9, 9]],
        ),
    ];
    for (name, raster, grid, boxes) in &rasters {
        for resampling in Resampling::ALL {
            compare(name, raster, grid, resampling, boxes);
        }
    }
}

#[test]
fn channels_are_interpolated_each_by_itself() {
    let number = |x: i64, y: i64, channel: i64| noise(x + 97 * channel, y).map_or(f32::NAN, f32::from);
    let degrees = 360.0 / SIDE as f64;
    for (epsg, affine, grid, part) in [
        (4326, [degrees, 0.0, -180.0, 0.0, -degrees / 2.0, 90.0], xyz(7), [0, 0, 128, 128]),
        (32632, [3000.0, 0.0, 400_000.0, 0.0, -3000.0, 5_400_000.0], xyz(14), [8600, 5600, 110, 130]),
    ] {
        let frame = Frame { crs: Some(Crs::epsg(epsg)), ..Frame::planar(affine) };
        for resampling in [Resampling::Bilinear, Resampling::Cubic] {
            let drawn = |channels: &[i64]| {
                let form =
                    TreeType::new(Dimension::Quad, ValueType::new(SampleType::F32, channels.len() as u8));
                let cell = |[x, y, _]: Cell| {
                    let numbers = channels.iter().map(|channel| number(x.into(), y.into(), *channel));
                    let numbers: Vec<f32> = numbers.collect();
                    let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
                    // (A cell without any number is VOID.)
                    numbers.iter().any(|number| !number.is_nan()).then(|| Value::from_bytes(&bytes))
                };
                let tree = Arc::new(MemTree::from_cells(form, 6, Rule::Mean, &cell).into());
                let options = WarpOptions { resampling: Some(resampling), ..WarpOptions::default() };
                let warped = Warped::new(tree, &frame, &grid, &options).unwrap();
                let [x, y, width, height] = part;
                let bounds = Bounds { min: [x, y, 0], max: [x + width, y + height, 1] };
                let mut block = CellBlock::void(bounds.volume() as usize, 4 * channels.len());
                assert!(warped.draw(&bounds, &mut block.values, &mut block.present).unwrap());
                block
            };
            let (first, second, both) = (drawn(&[0]), drawn(&[1]), drawn(&[0, 1]));
            let mut compared = 0;
            for (channel, single) in [first, second].into_iter().enumerate() {
                for cell in (0..single.present.len()).filter(|cell| single.present[*cell]) {
                    let expected = &single.values[4 * cell..][..4];
                    assert!(both.present[cell], "{epsg} {resampling}: cell {cell} is VOID");
                    let found = &both.values[8 * cell + 4 * channel..][..4];
                    assert_eq!(found, expected, "{epsg} {resampling}: channel {channel} of cell {cell}");
                    compared += 1;
                }
            }
            assert!(compared > both.present.len() / 2, "{compared} of {} cells", both.present.len());
        }
    }
}

#[test]
fn cells_far_larger_and_smaller_than_the_sources() {
    let degrees = 360.0 / SIDE as f64;
    let raster = Raster::at(4326, [degrees, 0.0, -180.0, 0.0, -degrees / 2.0, 90.0], noise);
    let turned =
        Raster::at(32632, [200_000.0, 70_000.0, 400_000.0, 80_000.0, -200_000.0, 5_400_000.0], noise);
    for (name, raster, depth, part) in [
        ("world", &raster, 0, [0, 0, 1, 1]),
        ("world", &raster, 2, [0, 0, 4, 4]),
        ("world", &raster, 12, [3000, 1000, 50, 50]),
        ("world", &raster, 20, [500_000, 400_000, 9, 9]),
        ("world", &raster, 26, [30_000_000, 25_000_000, 4, 4]),
        ("turned", &turned, 26, [35_600_000, 23_000_000, 4, 4]),
    ] {
        for resampling in [Resampling::Nearest, Resampling::Bilinear, Resampling::Area, Resampling::Majority]
        {
            compare(name, raster, &xyz(depth), resampling, &[part]);
        }
    }
}

#[test]
fn nodes_agree_with_their_cells() {
    let rasters = [
        Raster::at(32632, [3000.0, 0.0, 400_000.0, 0.0, -3000.0, 5_400_000.0], patches),
        Raster::at(4326, [5.625, 0.0, -180.0, 0.0, -2.8125, 90.0], patches),
        Raster::at(4326, [0.3, 0.0, 170.0, 0.0, -0.3, 10.0], patches),
    ];
    for (raster, depth) in rasters.iter().zip([13, 8, 11]) {
        for resampling in Resampling::ALL {
            let warped = raster.warped(&xyz(depth), resampling);
            let mut uniform = 0;
            check_node(&warped, warped.root().unwrap(), Bounds::space(Dimension::Quad, depth), &mut uniform);
            assert!(uniform > 20, "{uniform} nodes were settled at once");
        }
    }
}

/// Compares settled nodes with the cells below them.
fn check_node(warped: &Warped, child: Child<spinney_base::space::Code>, bounds: Bounds, uniform: &mut u32) {
    match child {
        Child::Inner { node, .. } if bounds.volume() > 256 => {
            let mut children = crate::tree::no_children();
            warped.children(&node, &mut children).unwrap();
            for (step, child) in children.into_iter().take(4).enumerate() {
                check_node(warped, child, bounds.child(Dimension::Quad, step), uniform);
            }
        }
        Child::Inner { .. } => {}
        settled => {
            // (Of large nodes, a sub-box.)
            let max = [0, 1, 2].map(|axis| bounds.max[axis].min(bounds.min[axis] + 200));
            let part = Bounds { max, ..bounds };
            let mut block = CellBlock::void(part.volume() as usize, 1);
            warped.draw(&part, &mut block.values, &mut block.present).unwrap();
            let expected = settled.value().map(|value| value.to_bytes()[0]);
            for (present, value) in block.present.iter().zip(&block.values) {
                assert_eq!(present.then_some(*value), expected, "{bounds:?}");
            }
            *uniform += 1;
        }
    }
}

#[test]
fn the_grid_of_web_maps_is_as_fine_as_the_raster() {
    let zoom = |frame: &Frame, extent| {
        WarpGrid::web_mercator(None, frame, extent, false).unwrap().extent[0].trailing_zeros() - 8
    };
    let degrees = |cell: f64| Frame {
        crs: Some(Crs::epsg(4326)),
        ..Frame::planar([cell, 0.0, -180.0, 0.0, -cell, 90.0])
    };
    // 40,075 km by 43,200 columns are 928 m; a cell of zoom 7 has 1,223 m.
    assert_eq!(zoom(&degrees(1.0 / 120.0), [43_200, 21_600, 1]), 7);
    assert_eq!(zoom(&degrees(1.0), [360, 180, 1]), 0);
    let metres = Frame {
        crs: Some(Crs::epsg(32632)),
        ..Frame::planar([10.0, 0.0, 500_000.0, 0.0, -10.0, 6_600_000.0])
    };
    // At 60 degrees north 20 m of the map are 10 m; zoom 13 has 19.1.
    assert_eq!(zoom(&metres, [100, 100, 1]), 13);
    let error = |zoom, frame: &Frame| {
        WarpGrid::web_mercator(zoom, frame, [10, 10, 1], false).unwrap_err().to_string()
    };
    assert!(error(Some(22), &metres).contains("0 to 21"));
    assert!(error(None, &Frame::identity()).contains("coordinate system of the raster: got none"));
}

#[test]
fn classes_are_not_interpolated() {
    for way in [Resampling::Bilinear, Resampling::Cubic, Resampling::Area] {
        assert!(
            way.check(spinney_base::value::DataKind::Categorical)
                .unwrap_err()
                .to_string()
                .contains("nearest or majority")
        );
        assert_eq!(way.name().parse::<Resampling>().unwrap(), way);
    }
    assert!("lanczos".parse::<Resampling>().is_err());
}
