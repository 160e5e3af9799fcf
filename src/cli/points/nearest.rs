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
pub(crate) fn nearest(tree: &PointTree, places: &[String], near: &Near, global: &Global) -> Result<()> {
    let mut places: Vec<[f64; 3]> = args::places(places)?;
    for (number, place) in places.iter_mut().enumerate() {
        let [x, y, z] = *place;
        let [x, y] = near.locator.locate([x, y]).with_context(|| format!("point {}", number + 1))?;
        *place = [x, y, z];
    }
    let work = Work::start(global, "places")?;
    let found = tree.nearest(&places, near.most, near.within, DEFAULT_MEMORY, &work)?;
    work.finish();
    let mut out = io::BufWriter::with_capacity(1 << 20, io::stdout().lock());
    for (number, found) in found.iter().enumerate() {
        if found.is_empty() {
            writeln!(out, "{}\tnone", number + 1)?;
        }
        for point in found {
            let [x, y, z] = point.place;
            writeln!(out, "{}\t{}\t{x},{y},{z}", number + 1, point.distance)?;
        }
    }
    Ok(out.flush()?)
}
