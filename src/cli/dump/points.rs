//! Trees of the literature that are divided at points, of a tree of points.

use std::fmt::Write as _;

use anyhow::Result;
use spinney::points::{PointTree, Selection};
use spinney::raw::partitions::{DividedPoint, DividedPoints, PointDivision};

/// Returns the structure as text, or its sizes.
pub(super) fn text(
    tree: &PointTree,
    division: PointDivision,
    (limit, is_stats): (u64, bool),
) -> Result<String> {
    super::check_count(tree.path(), tree.len(), "points", limit)?;
    let mut points = Vec::new();
    tree.select(&Selection::default(), Some(&[]), &(), &mut |columns| {
        points.extend((0..columns.len()).map(|point| columns.position(point)));
        Ok(())
    })?;
    let (grid, axes) = (tree.grid(), tree.dimension().axes());
    let nodes = DividedPoints::of(tree.dimension(), division, points).nodes();
    let mut text = String::new();
    if is_stats {
        let depth = nodes.iter().map(|node| node.depth).max().unwrap_or(0);
        // A node has its coordinates and a 32-bit number for each child.
        let children = if division == PointDivision::OneAxis { 2 } else { 1 << axes };
        writeln!(text, "nodes       {}", nodes.len())?;
        writeln!(text, "depth       {depth}")?;
        writeln!(text, "points      {}", tree.len())?;
        writeln!(text, "bytes       {}", nodes.len() * 4 * (axes + children))?;
        let (count, blocks) = tree.counts();
        writeln!(text, "file        {count} nodes, {blocks} blocks, {} bytes", tree.bytes())?;
        return Ok(text);
    }
    for DividedPoint { depth, side, point, count } in nodes {
        let world = grid.to_world(point);
        let numbers: Vec<String> = world[..axes].iter().map(f64::to_string).collect();
        writeln!(text, "{depth}\t{}\t{}\t{count}", name(side, (depth, axes), division), numbers.join(","))?;
    }
    Ok(text)
}

/// Name of a side of the node above.
fn name(side: usize, (depth, axes): (usize, usize), division: PointDivision) -> &'static str {
    const SIDES: [[&str; 2]; 3] = [["W", "E"], ["N", "S"], ["below", "above"]];
    const PARTS: [&str; 8] = ["NW", "NE", "SW", "SE", "NW above", "NE above", "SW above", "SE above"];
    const BELOW: [&str; 4] = ["NW below", "NE below", "SW below", "SE below"];
    match (depth, division) {
        (0, _) => "root",
        (_, PointDivision::OneAxis) => SIDES[(depth - 1) % axes][side],
        (_, PointDivision::AllAxes) if axes == 3 && side < 4 => BELOW[side],
        (_, PointDivision::AllAxes) => PARTS[side],
    }
}
