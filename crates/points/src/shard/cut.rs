//! Divides space into shards with about equal point counts.

use std::collections::BTreeMap;

use super::{PointShard, deepest_units};
use crate::build::{MAX_NUMBERS, encoder_of};
use crate::grid::PointGrid;
use crate::import::PointImport;
use crate::source::PointSubset;
use spinney_base::space::{Bounds, Code, CodeRange};
use spinney_base::{Error, Result};

/// Approximate number of units per shard, for balance. With more units, more points would go to the
/// nodes above.
const UNITS: u64 = 8;
/// Limit for the number of non-empty units: with this many, units are not divided further.
const MAX_UNITS: u64 = 1 << 16;
/// Tolerance for points outside a file's header bounds: 2^-7 of its side, plus 16 grid units.
const MARGIN: (u32, i64) = (7, 16);

/// Division of a tree into shards.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PointCut {
    /// Level of the units.
    pub level: u8,
    /// Code range of each shard; together they cover all of space. `None` for shards without units.
    pub runs: Vec<Option<CodeRange>>,
    /// Total number of points, if known before reading.
    pub points: Option<u64>,
}

/// Divides an import into shards, based on the file headers. No point is read.
///
/// # Errors
/// If the points do not come from LAS or LAZ files, or a header is invalid.
pub fn cut(import: &PointImport, shards: u32) -> Result<PointCut> {
    let source = &*import.source;
    let path = source.path();
    import.options.check()?;
    if source.subsets().is_empty() {
        let advice = "shard LAS or LAZ files, or use `spinney build`, which runs in a single process";
        return Err(Error::unsupported(path, "sharding of points without bounds in a header", advice));
    }
    let points = source.subsets().iter().fold(0, |sum: u64, subset| sum.saturating_add(subset.count));
    if points >= MAX_NUMBERS {
        let expected = format!("fewer than {MAX_NUMBERS} in a file");
        return Err(Error::invalid("points", points.to_string(), expected));
    }
    let grid = encoder_of(source.schema()).grid;
    let lost =
        source.subsets().iter().find(|subset| subset.count > 0 && cells_of(&grid, subset, 0).is_empty());
    if let Some(PointSubset { count, bounds: [least, most] }) = lost {
        let found = format!("{count} points from {least:?} to {most:?} on the grid");
        return Err(Error::corrupt(path, "header", found, "a minimum that is at most the maximum"));
    }
    // Invariant: units are no deeper than the root's sampling cells. The first point of each unit
    // thus goes to the root, whatever precedes it, so shards are independent. The level is the
    // coarsest with enough units: the deeper the units, the more points go to the nodes above.
    let wanted = (u64::from(shards) * UNITS).min(MAX_UNITS);
    let (mut level, mut weights) = (0, weights_of(&grid, source.subsets(), 0));
    while level < deepest_units(&grid) && (weights.len() as u64) < wanted && shards > 1 {
        level += 1;
        weights = weights_of(&grid, source.subsets(), level);
    }
    let points = source.schema().count.map(|_| points);
    Ok(PointCut { level, runs: runs_of(&grid, &weights, shards), points })
}

/// Returns the indices of the files that may have points in a shard, by their header bounds plus a
/// tolerance.
pub(super) fn subsets_of(import: &PointImport, shard: &PointShard) -> Vec<usize> {
    let grid = encoder_of(import.source.schema()).grid;
    let touches = |subset: &PointSubset, run: CodeRange| {
        subset.count > 0 && run.cells(grid.dimension, shard.level, &cells_of(&grid, subset, shard.level)) > 0
    };
    let subsets = import.source.subsets().iter().enumerate();
    subsets
        .filter(|(_, subset)| shard.run().is_some_and(|run| touches(subset, run)))
        .map(|(number, _)| number)
        .collect()
}

/// Returns the range along an axis in which a file may have points.
fn reach(subset: &PointSubset, axis: usize) -> [i64; 2] {
    let [least, most] = subset.bounds.map(|position| i64::from(position[axis]));
    let margin = MARGIN.1 + ((most - least) >> MARGIN.0);
    [least - margin, most + margin]
}

/// Returns whether a file may have a point at a position.
pub(super) fn may_have(subset: &PointSubset, position: [i32; 3]) -> bool {
    (0..3).all(|axis| {
        let [least, most] = reach(subset, axis);
        (least..=most).contains(&position[axis].into())
    })
}

/// Returns the units at a level in which a file may have points; an empty box if its bounds are
/// inverted.
fn cells_of(grid: &PointGrid, subset: &PointSubset, level: u8) -> Bounds {
    let (mut min, mut max) = ([0; 3], [1; 3]);
    for axis in 0..grid.dimension.axes() {
        if subset.bounds[0][axis] > subset.bounds[1][axis] {
            return Bounds { min: [0; 3], max: [0; 3] };
        }
        let side = 1i64 << grid.bits;
        let cell = |position: i64| {
            (position - i64::from(grid.corner[axis])).clamp(0, side - 1) >> (grid.bits - level)
        };
        let [least, most] = reach(subset, axis);
        (min[axis], max[axis]) = (cell(least) as u64, cell(most) as u64 + 1);
    }
    Bounds { min, max }
}

/// Estimates the number of points in each non-empty unit at a level, by code.
fn weights_of(grid: &PointGrid, subsets: &[PointSubset], level: u8) -> BTreeMap<u64, u64> {
    let mut weights = BTreeMap::new();
    let side = (1i64 << (grid.bits - level)) as f64;
    for subset in subsets.iter().filter(|subset| subset.count > 0) {
        let Bounds { min, max } = cells_of(grid, subset, level);
        for z in min[2]..max[2] {
            for y in min[1]..max[1] {
                for x in min[0]..max[0] {
                    let cell = [x, y, z];
                    let mut points = subset.count as f64;
                    for (axis, step) in cell.iter().enumerate().take(grid.dimension.axes()) {
                        let [least, most] = reach(subset, axis)
                            .map(|position| (position - i64::from(grid.corner[axis])) as f64);
                        let first = *step as f64 * side;
                        let common = (most + 1.0).min(first + side) - least.max(first);
                        points *= (common / (most + 1.0 - least)).clamp(0.0, 1.0);
                    }
                    let unit = Code::from_cell(grid.dimension, level, cell.map(|step| step as u32));
                    let weight: &mut u64 = weights.entry(unit.expect("in the root").bits()).or_default();
                    *weight = weight.saturating_add(1 + points as u64);
                }
            }
        }
    }
    weights
}

/// Divides space into runs of units with about equal point counts.
fn runs_of(grid: &PointGrid, weights: &BTreeMap<u64, u64>, shards: u32) -> Vec<Option<CodeRange>> {
    let total: u128 = weights.values().map(|weight| u128::from(*weight)).sum();
    // A unit belongs to the shard that contains the middle of its points.
    let mut lasts: Vec<(u32, Code)> = Vec::new();
    let mut before = 0u128;
    for (unit, weight) in weights {
        let middle = 2 * before + u128::from(*weight);
        let shard = (middle * u128::from(shards) / (2 * total.max(1))).min(u128::from(shards) - 1) as u32;
        before += u128::from(*weight);
        let unit = Code::from_bits(grid.dimension, *unit).expect("codes of units");
        match lasts.last_mut() {
            Some(last) if last.0 == shard => last.1 = unit,
            _ => lasts.push((shard, unit)),
        }
    }
    let mut runs = vec![None; shards as usize];
    let mut first = 0;
    let all = CodeRange::ALL.ends()[1];
    for (number, (shard, unit)) in lasts.iter().enumerate() {
        let last = if number + 1 == lasts.len() { all } else { unit.last_bits() };
        runs[*shard as usize] = CodeRange::new(first, last);
        first = last + 1;
    }
    // Without points, the first shard gets all of space.
    if lasts.is_empty() {
        runs[0] = Some(CodeRange::ALL);
    }
    runs
}
