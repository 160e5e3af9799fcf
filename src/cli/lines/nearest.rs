//! `spinney point` of a tree of lines: the nearest lines.

use std::io::{self, Write as _};

use anyhow::{Context as _, Result, bail};
use spinney::lines::LineTree;

use super::super::Global;
use super::super::args;
use super::super::point::Near;
use super::super::report::Work;

/// Prints the lines nearest to each position, one output line each: the position's number, the
/// distance, the nearest point, and the feature's number. Distances from positions without a height
/// are those in x and y.
pub(crate) fn nearest(tree: &LineTree, positions: &[String], near: &Near, global: &Global) -> Result<()> {
    let mut positions: Vec<[f64; 3]> = args::positions(positions)?;
    for (number, [x, y, z]) in positions.iter_mut().enumerate() {
        if !z.is_nan() && tree.grid().axes() == 2 {
            bail!("point {}: got 3 coordinates, expected 2 for a tree of lines without heights", number + 1);
        }
        [*x, *y] = near.locator.locate([*x, *y]).with_context(|| format!("point {}", number + 1))?;
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
            let position: Vec<String> =
                super::coordinates(tree, &line.position).iter().map(f64::to_string).collect();
            writeln!(out, "{}\t{}\t{}\t{}", number + 1, line.distance, position.join(","), line.feature)?;
        }
    }
    Ok(out.flush()?)
}
