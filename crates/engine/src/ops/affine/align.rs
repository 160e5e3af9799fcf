//! Trees with different frames over one grid of cells.

use super::map::AffineMap;
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame};

/// Position of a tree in a grid that it shares with others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// AffineMap from the tree's cells to the grid's; takes cells to whole blocks of cells.
    pub map: AffineMap,
    /// Cells of the grid along each axis; the same for all.
    pub extent: [u64; 3],
}

/// Coordinates agree if they are closer than this, in cells.
const CLOSE: f64 = 1e-3;

/// The finest of the trees' grids, large enough for all, and where each of them lies in it: trees may begin
/// at different cells, have cells that are powers of two apart, and be turned or mirrored along the axes.
/// `names` are for messages.
///
/// # Errors
/// If coordinate systems differ, or cells of one tree are no whole blocks of another's; the message names a
/// view that would make them so.
pub fn align(trees: &[(&str, &Frame, [u64; 3])]) -> Result<Vec<Alignment>> {
    let size = |frame: &Frame| AffineMap::from_rows(frame.matrix).determinant().abs();
    let Some(finest) = trees.iter().min_by(|a, b| size(a.1).total_cmp(&size(b.1))) else {
        return Ok(Vec::new());
    };
    let to_grid = AffineMap::from_rows(finest.1.matrix).inverse()?;
    // First all lie where the finest has its first cell at the origin; then all move to where no coordinate
    // is negative.
    let mut maps = Vec::new();
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for (name, frame, extent) in trees {
        Crs::check_same((finest.0, finest.1.crs.as_ref()), (name, frame.crs.as_ref()))?;
        let map = AffineMap::from_rows(frame.matrix).then(&to_grid);
        let map = without_rounding(&map, *extent).ok_or_else(|| {
            let [x, y, _] = map.to_rows();
            let found = format!(
                "cells that lie at {:.6},{:.6} and are {:.6} x {:.6} of those of {}",
                x[3],
                y[3],
                x[0].hypot(y[0]),
                x[1].hypot(y[1]),
                finest.0
            );
            let expected = format!(
                "whole cells, 1, 2, 4, ... times as large along the axes; `spinney transform {name} like={} -o OTHER` makes \
                 a tree that matches",
                finest.0
            );
            Error::invalid(format!("grid of {name}"), found, expected)
        })?;
        let (min, max) =
            map.bounding_box(glam::DVec3::ZERO, glam::DVec3::from(extent.map(|cells| cells as f64)));
        for axis in 0..3 {
            low[axis] = low[axis].min(min[axis].round());
            high[axis] = high[axis].max(max[axis].round());
        }
        maps.push(map);
    }
    let extent = std::array::from_fn(|axis| (high[axis] - low[axis]).max(1.0) as u64);
    let first = AffineMap::translation(low.map(|cell| -cell));
    Ok(maps.into_iter().map(|map| Alignment { map: map.then(&first), extent }).collect())
}

/// The map without rounding errors, if it takes whole cells to whole blocks of cells.
fn without_rounding(map: &AffineMap, extent: [u64; 3]) -> Option<AffineMap> {
    let mut rows = map.to_rows();
    let most = extent.into_iter().max().unwrap_or(1) as f64;
    for row in &mut rows {
        for number in &mut row[..3] {
            let power = 2f64.powi(number.abs().log2().round().clamp(-1.0, 60.0) as i32).copysign(*number);
            // What a factor is off adds up over all cells. (A zero's logarithm is clamped, and the zero stays
            // one.)
            if number.abs() * most < CLOSE {
                *number = 0.0;
            } else if power.abs() >= 1.0 && (*number - power).abs() * most < CLOSE {
                *number = power;
            } else {
                return None;
            }
        }
        if (row[3] - row[3].round()).abs() > CLOSE {
            return None;
        }
        row[3] = row[3].round();
    }
    let map = AffineMap::from_rows(rows);
    (map.keeps_axes() && map.inverse().is_ok()).then_some(map)
}
