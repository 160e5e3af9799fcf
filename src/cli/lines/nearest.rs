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
pub(crate) fn nearest(tree: &LineTree, places: &[String], near: &Near, global: &Global) -> Result<()> {
    let mut places: Vec<[f64; 2]> = args::places(places)?;
    for (number, place) in places.iter_mut().enumerate() {
        *place = near.locator.locate(*place).with_context(|| format!("point {}", number + 1))?;
    }
    let work = Work::start(global, "places")?;
    let found = tree.nearest(&places, near.most, near.within, &work)?;
    work.finish();
    let mut out = io::BufWriter::with_capacity(1 << 20, io::stdout().lock());
    for (number, found) in found.iter().enumerate() {
        if found.is_empty() {
            writeln!(out, "{}\tnone", number + 1)?;
        }
        for line in found {
            let [x, y] = line.place;
            writeln!(out, "{}\t{}\t{x},{y}\t{}", number + 1, line.distance, line.feature)?;
        }
    }
    Ok(out.flush()?)
}
