//! Traces the lines through a tile of squares, as fragments that end at its edges.

use super::grid::ValueGrid;
use super::levels::Levels;
use super::nodes::{NONE, Nodes, Tracing};
use super::squares::link_squares;
use spinney_base::Result;

/// A point on an edge between two cells, where the fragments of two tiles meet. Ordered by row
/// first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct EdgeKey {
    pub(super) row: i64,
    column: i64,
    /// Whether the edge goes down to the next row.
    is_down: bool,
    /// Number of the point on the edge.
    number: u32,
}

/// A fragment of a line. The first and last points of a ring are equal.
pub(super) struct LineFragment {
    /// Number of the level or the band.
    pub(super) class: i32,
    /// Coordinates in cells.
    pub(super) points: Vec<[f64; 2]>,
    /// Points where it may continue at its start and its end.
    pub(super) ends: [Option<EdgeKey>; 2],
    pub(super) is_ring: bool,
}

/// Traces all lines through the squares of a grid.
///
/// # Errors
/// If there are too many points.
pub(super) fn trace(
    grid: &ValueGrid,
    levels: &Levels,
    tracing: Tracing,
    is_reversed: bool,
) -> Result<Vec<LineFragment>> {
    let mut nodes = Nodes::new(grid, levels, tracing, is_reversed)?;
    link_squares(grid, levels, &mut nodes)?;
    let mut fragments = Vec::new();
    let mut is_done = vec![false; nodes.points.len()];
    // First open fragments, then rings.
    for is_ring in [false, true] {
        for first in 0..nodes.points.len() {
            if nodes.next[first] == NONE || is_done[first] || (!is_ring && nodes.has_previous[first]) {
                continue;
            }
            let mut points = Vec::new();
            let (mut node, mut last) = (first as u32, first as u32);
            // Whether the last point must be kept even if its neighbours are in line with it.
            let mut stays = true;
            while node != NONE {
                let at = node as usize;
                push(&mut points, nodes.points[at], stays);
                stays = !nodes.is_border[at] || node == first as u32;
                if is_done[at] {
                    break;
                }
                (is_done[at], last) = (true, node);
                node = nodes.next[at];
            }
            let ends =
                if is_ring { [None; 2] } else { [first as u32, last].map(|node| key(grid, &nodes, node)) };
            fragments.push(LineFragment { class: nodes.classes[first], points, ends, is_ring });
        }
    }
    Ok(fragments)
}

/// Appends a point to a line. Replaces the last point if that may be dropped and is on the way to
/// the new one.
fn push(points: &mut Vec<[f64; 2]>, point: [f64; 2], stays: bool) {
    if let [.., before, last] = &mut points[..]
        && !stays
        && (0..2).any(|axis| before[axis] == last[axis] && last[axis] == point[axis])
    {
        *last = point;
    } else {
        points.push(point);
    }
}

/// Returns the key of a node where another tile may continue the line.
fn key(grid: &ValueGrid, nodes: &Nodes, node: u32) -> Option<EdgeKey> {
    let [columns, rows] = grid.size;
    let (edge, number) = nodes.edge_of(node)?;
    let across = (columns - 1) * rows;
    let is_down = edge >= across;
    let (width, edge) = if is_down { (columns, edge - across) } else { (columns - 1, edge) };
    let (column, row) = (edge % width, edge / width);
    let is_outer = if is_down { column == 0 || column == columns - 1 } else { row == 0 || row == rows - 1 };
    let (column, row) = (grid.origin[0] + column as i64, grid.origin[1] + row as i64);
    is_outer.then_some(EdgeKey { row, column, is_down, number })
}
