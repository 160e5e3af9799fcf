//! `spinney point` of a tree of points: the nearest points.

use std::io::{self, Write as _};

use anyhow::{Context as _, Result};
use spinney::points::PointTree;

use super::super::Global;
use super::super::args::{self, DEFAULT_MEMORY};
use super::super::point::Near;
use super::super::report::Work;

/// Prints the points nearest to each position, one output line each: the position's number,
/// distance, coordinates.
pub(crate) fn nearest(tree: &PointTree, positions: &[String], near: &Near, global: &Global) -> Result<()> {
    let mut positions: Vec<[f64; 3]> = args::positions(positions)?;
    for (number, point) in positions.iter_mut().enumerate() {
        let [x, y, z] = *point;
        let [x, y] = near.locator.locate([x, y]).with_context(|| format!("point {}", number + 1))?;
        *point = [x, y, z];
    }
    let work = Work::start(global, "positions")?;
    let found = tree.nearest(&positions, near.most, near.within, DEFAULT_MEMORY, &work)?;
    work.finish();
    let mut out = io::BufWriter::with_capacity(1 << 20, io::stdout().lock());
    for (number, found) in found.iter().enumerate() {
        if found.is_empty() {
            writeln!(out, "{}\tnone", number + 1)?;
        }
        for point in found {
            let [x, y, z] = point.position;
            writeln!(out, "{}\t{}\t{x},{y},{z}", number + 1, point.distance)?;
        }
    }
    Ok(out.flush()?)
}
