//! `spinney point` of a tree of lines: the nearest lines.

use std::io::{self, Write as _};

use anyhow::{Context as _, Result};
use spinney::lines::LineTree;

use super::super::Global;
use super::super::args;
use super::super::point::Near;
use super::super::report::Work;

/// Prints the lines nearest to each position, one output line each: the position's number, the
/// distance, the nearest point, and the feature's number.
pub(crate) fn nearest(tree: &LineTree, positions: &[String], near: &Near, global: &Global) -> Result<()> {
    let mut positions: Vec<[f64; 2]> = args::positions(positions)?;
    for (number, point) in positions.iter_mut().enumerate() {
        *point = near.locator.locate(*point).with_context(|| format!("point {}", number + 1))?;
    }
    let work = Work::start(global, "positions")?;
    let found = tree.nearest(&positions, near.most, near.within, &work)?;
    work.finish();
    let mut out = io::BufWriter::with_capacity(1 << 20, io::stdout().lock());
    for (number, found) in found.iter().enumerate() {
        if found.is_empty() {
            writeln!(out, "{}\tnone", number + 1)?;
        }
        for line in found {
            let [x, y] = line.position;
            writeln!(out, "{}\t{}\t{x},{y}\t{}", number + 1, line.distance, line.feature)?;
        }
    }
    Ok(out.flush()?)
}
