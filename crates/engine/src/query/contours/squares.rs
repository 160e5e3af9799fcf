//! Marching squares: the course of lines through the squares between the centres of four
//! neighbouring cells.
//!
//! Values are linear along an edge. A value equal to a level is above it. A saddle belongs to the
//! side of the level that the mean of the four values is on. Corners, and the edges between them,
//! are numbered clockwise from the upper left. A line enters at the edge where, clockwise, corners
//! above the level end, and leaves where they begin, so that these corners are on its right.
//!
//! A square with a VOID corner is divided into quarters, as in GDAL. The value in the middle of two
//! or four corners is the mean of those that have values, so that lines continue to the edge of the
//! last cells.

use super::grid::{VOID, ValueGrid};
use super::levels::Levels;
use super::nodes::{EdgeNodes, Nodes, Tracing, away};
use spinney_base::Result;

/// Corners of a square as column and row, clockwise from the upper left.
const CORNERS: [[usize; 2]; 4] = [[0, 0], [1, 0], [1, 1], [0, 1]];

/// Links the nodes of all squares of a grid.
///
/// # Errors
/// If there are too many nodes.
pub(super) fn link_squares(grid: &ValueGrid, levels: &Levels, nodes: &mut Nodes) -> Result<()> {
    let [columns, rows] = grid.size;
    let across = (columns - 1) * rows;
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            let corners = CORNERS.map(|[right, down]| grid.index(column + right, row + down));
            let ranks = corners.map(|corner| grid.ranks[corner]);
            let least = ranks[0].min(ranks[1]).min(ranks[2].min(ranks[3]));
            if ranks.iter().all(|rank| *rank == least) {
                continue;
            }
            // Above, right, below, left.
            let edges = [
                row * (columns - 1) + column,
                across + row * columns + column + 1,
                (row + 1) * (columns - 1) + column,
                across + row * columns + column,
            ];
            let edges: [EdgeNodes; 4] =
                std::array::from_fn(|side| nodes.of_edge(edges[side], [ranks[side], ranks[(side + 1) % 4]]));
            let values = corners.map(|corner| grid.numbers[corner]);
            if least != VOID {
                link_square(nodes, levels, values, ranks, edges);
                continue;
            }
            let is_cut = |corner: usize| {
                let [right, down] = CORNERS[corner];
                ranks[corner] == VOID && grid.is_inside(column + right, row + down)
            };
            if nodes.tracing == (Tracing::Open { to_edges: false }) && (0..4).any(is_cut) {
                continue;
            }
            let centres = CORNERS.map(|[right, down]| grid.centre(column + right, row + down));
            Split::new(nodes, levels, centres, values, ranks, edges)?.link(nodes, levels)?;
        }
    }
    Ok(())
}

/// Links the lines through a square without VOID corners.
#[inline]
fn link_square(nodes: &mut Nodes, levels: &Levels, values: [f64; 4], ranks: [i32; 4], edges: [EdgeNodes; 4]) {
    let (least, most) = (ranks.into_iter().min().unwrap_or(0), ranks.into_iter().max().unwrap_or(0));
    let mut middle = None;
    for level in least..most {
        let is_high = ranks.map(|rank| rank > level);
        let is_saddle = is_high[0] == is_high[2] && is_high[1] == is_high[3];
        let ends = |side: &usize| !is_high[*side] && is_high[(side + 1) % 4];
        for start in (0..4).filter(|side| is_high[*side] && !is_high[(side + 1) % 4]) {
            let end = if !is_saddle {
                (0..4).find(ends).unwrap_or(start)
            } else if *middle
                .get_or_insert_with(|| levels.rank(values.map(|value| 0.25 * value).iter().sum()))
                > level
            {
                (start + 1) % 4
            } else {
                (start + 3) % 4
            };
            let node = |side: usize, above: u32| nodes.crossing(edges[side], level, above);
            let (from, to) = (node(start, 1), node(end, 1));
            let below = (node(end, 0), node(start, 0));
            nodes.link(from, to);
            if nodes.tracing == Tracing::Bands {
                nodes.link(below.0, below.1);
            }
        }
    }
}

/// A square with some VOID corners.
struct Split {
    values: [f64; 4],
    ranks: [i32; 4],
    edges: [EdgeNodes; 4],
    centres: [[f64; 2]; 4],
    /// Value and rank at the middle of each edge.
    middles: [(f64, i32); 4],
    /// Value and rank at the centre of the square.
    middle: (f64, i32),
    /// Centre of the square.
    place: [f64; 2],
    /// Nodes between the middle of an edge and the centre of the square.
    inner: [EdgeNodes; 4],
}

impl Split {
    fn new(
        nodes: &mut Nodes,
        levels: &Levels,
        centres: [[f64; 2]; 4],
        values: [f64; 4],
        ranks: [i32; 4],
        edges: [EdgeNodes; 4],
    ) -> Result<Split> {
        let mean = |corners: &[usize]| {
            let (mut sum, mut share) = (0.0, 0.0);
            let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
            for value in corners.iter().filter(|corner| ranks[**corner] != VOID).map(|corner| values[*corner])
            {
                (sum, share) = (sum + 0.25 * value, share + 0.25);
                (least, most) = (least.min(value), most.max(value));
            }
            if share == 0.0 {
                return (f64::NAN, VOID);
            }
            // (Rounding must not create a difference between equal values.)
            let mean = (sum / share).clamp(least, most);
            (mean, levels.rank(mean))
        };
        let middle = mean(&[0, 1, 2, 3]);
        let middles: [(f64, i32); 4] = std::array::from_fn(|side| mean(&[side, (side + 1) % 4]));
        let place = between(centres[0], centres[2]);
        let mut inner = [EdgeNodes::default(); 4];
        for side in (0..4).filter(|side| middles[*side].1 != VOID) {
            let ends = [between(centres[side], centres[(side + 1) % 4]), place];
            let (values, ranks) = ([middles[side].0, middle.0], [middles[side].1, middle.1]);
            inner[side] = nodes.add_inner(levels, ends, values, ranks)?;
        }
        Ok(Split { values, ranks, edges, centres, middles, middle, place, inner })
    }

    /// Links the lines through the quarters of corners with values, and the lines along the border
    /// between these quarters and the others.
    fn link(&self, nodes: &mut Nodes, levels: &Levels) -> Result<()> {
        for corner in (0..4).filter(|corner| self.ranks[*corner] != VOID) {
            let before = (corner + 3) % 4;
            let around = [
                (self.values[corner], self.ranks[corner]),
                self.middles[corner],
                self.middle,
                self.middles[before],
            ];
            let edges = [self.edges[corner], self.inner[corner], self.inner[before], self.edges[before]];
            link_square(nodes, levels, around.map(|(value, _)| value), around.map(|(_, rank)| rank), edges);
        }
        if !nodes.tracing.has_borders() {
            return Ok(());
        }
        let is_void = self.ranks.map(|rank| rank == VOID);
        let is_diagonal = is_void[0] == is_void[2] && is_void[1] == is_void[3];
        for start in (0..4).filter(|side| !is_void[*side] && is_void[(side + 1) % 4]) {
            let mut place = self.place;
            // Keep cells that only touch at a corner separate.
            if is_diagonal {
                let towards = self.centres[start];
                place =
                    std::array::from_fn(|axis| place[axis] + away() * (towards[axis] - place[axis]).signum());
            }
            let turn = (nodes.add_border(place, self.middle.1)?, self.middle.1);
            let ends = (0..4).map(|step| (start + 3 * step + 3) % 4);
            let end = { ends }.find(|side| is_void[*side] && !is_void[(side + 1) % 4]).unwrap_or(start);
            let stop = |side: usize| (self.edges[side], self.middles[side].1);
            link_border(nodes, stop(start), self.inner[start], turn);
            link_border(nodes, turn, self.inner[end], stop(end));
        }
        Ok(())
    }
}

/// Returns the midpoint of two points.
fn between(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]
}

/// Links the nodes along a border segment with values on its right, from one point with a rank to
/// another, including the nodes between them.
fn link_border(
    nodes: &mut Nodes,
    (from, before): (EdgeNodes, i32),
    edge: EdgeNodes,
    (to, after): (EdgeNodes, i32),
) {
    match nodes.tracing {
        Tracing::Open { .. } => {}
        Tracing::Bands => {
            let mut last = from.first;
            let mut pass = |level: i32, arriving: u32| {
                let arrived = nodes.crossing(edge, level, arriving);
                nodes.link(last, arrived);
                last = nodes.crossing(edge, level, 1 - arriving);
            };
            (before..after).for_each(|level| pass(level, 0));
            (after..before).rev().for_each(|level| pass(level, 1));
            nodes.link(last, to.first);
        }
        Tracing::Closed { low } => {
            let at = |point: EdgeNodes, level: i32| point.first + (level - point.low) as u32;
            (low..before.min(after)).for_each(|level| nodes.link(at(from, level), at(to, level)));
            for level in before.max(low)..after {
                nodes.link(nodes.crossing(edge, level, 1), at(to, level));
            }
            for level in after.max(low)..before {
                nodes.link(at(from, level), nodes.crossing(edge, level, 1));
            }
        }
    }
}
