//! Points of lines on the edges between neighbouring cells. They are numbered edge by edge, and on
//! an edge level by level. Two tiles that share an edge number its points equally, which is how
//! their lines are joined.

use super::grid::{VOID, ValueGrid};
use super::levels::Levels;
use spinney_base::{Error, Result};

/// Kind of lines to trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tracing {
    /// Lines that end near missing values: before them, or at the edges of the last cells
    /// (`to_edges`).
    Open { to_edges: bool },
    /// Lines that return along the edges of the last cells. `low` is the minimum rank of all
    /// values.
    Closed { low: i32 },
    /// Borders of bands.
    Bands,
}

impl Tracing {
    /// Returns the number of nodes per point. Adjacent bands have separate nodes at the same point.
    fn sides(self) -> u32 {
        if self == Tracing::Bands { 2 } else { 1 }
    }

    /// Returns whether there are lines along the edges of the last cells.
    pub(super) fn has_borders(self) -> bool {
        !matches!(self, Tracing::Open { .. })
    }

    /// Returns the first level or band of the nodes of a border point, and the node count.
    fn first_at_border(self, rank: i32) -> (i32, u32) {
        match self {
            Tracing::Open { .. } => (rank, 0),
            Tracing::Closed { low } => (low, rank.saturating_sub(low).max(0) as u32),
            Tracing::Bands => (rank, 1),
        }
    }
}

/// Null node.
pub(super) const NONE: u32 = u32::MAX;

/// Maximum number of points in a tile: at least 64 MiB.
const MAX_POINTS: usize = 1 << 21;

/// Minimum distance of lines from cell centres, as a fraction of the distance between two centres.
/// Lines of a level therefore never touch, and areas have no seams, where values equal a level.
const AWAY: f64 = 1e-6;

/// Nodes of an edge. The node of a level has the number `first + (level - low)`, or twice that
/// offset for bands.
#[derive(Clone, Copy, Default)]
pub(super) struct EdgeNodes {
    pub(super) first: u32,
    pub(super) low: i32,
}

/// Numbered points, linked to their successors.
pub(super) struct Nodes {
    pub(super) tracing: Tracing,
    /// Whether to swap successors and predecessors.
    is_reversed: bool,
    /// First node of each edge between cells: edges along rows, then along columns, then the total
    /// count.
    edges: Vec<u32>,
    pub(super) points: Vec<[f64; 2]>,
    /// Number of the level or the band.
    pub(super) classes: Vec<i32>,
    /// Whether it is at the edge of a last cell.
    pub(super) is_border: Vec<bool>,
    pub(super) next: Vec<u32>,
    pub(super) has_previous: Vec<bool>,
}

impl Nodes {
    /// Numbers the points on all edges between cells of a grid.
    ///
    /// # Errors
    /// If there are too many points.
    pub(super) fn new(
        grid: &ValueGrid,
        levels: &Levels,
        tracing: Tracing,
        is_reversed: bool,
    ) -> Result<Nodes> {
        let [columns, rows] = grid.size;
        let mut nodes = Nodes {
            tracing,
            is_reversed,
            edges: Vec::with_capacity(2 * columns * rows + 1),
            points: Vec::new(),
            classes: Vec::new(),
            is_border: Vec::new(),
            next: Vec::new(),
            has_previous: Vec::new(),
        };
        for (axis, width, height) in [(0, columns - 1, rows), (1, columns, rows - 1)] {
            for row in 0..height {
                for column in 0..width {
                    nodes.edges.push(nodes.points.len() as u32);
                    let a = grid.index(column, row);
                    let b = if axis == 0 { a + 1 } else { a + columns };
                    if grid.ranks[a] != grid.ranks[b] {
                        let start = grid.centre(column, row);
                        let mut end = start;
                        end[axis] += 1.0;
                        let (values, ranks) =
                            ([grid.numbers[a], grid.numbers[b]], [grid.ranks[a], grid.ranks[b]]);
                        nodes.add_edge(levels, [start, end], values, ranks)?;
                    }
                }
            }
        }
        nodes.edges.push(nodes.points.len() as u32);
        Ok(nodes)
    }

    fn add(&mut self, point: [f64; 2], class: i32, is_border: bool) -> Result<u32> {
        if self.points.len() >= MAX_POINTS {
            let found = format!("more than {MAX_POINTS} contour points in 256 x 256 cells");
            return Err(Error::invalid("contour levels", found, "fewer levels"));
        }
        self.points.push(point);
        self.classes.push(class);
        self.is_border.push(is_border);
        self.next.push(NONE);
        self.has_previous.push(false);
        Ok(self.points.len() as u32 - 1)
    }

    /// Adds the nodes on a line between two points, one of which may be VOID.
    fn add_edge(
        &mut self,
        levels: &Levels,
        [start, end]: [[f64; 2]; 2],
        values: [f64; 2],
        [a, b]: [i32; 2],
    ) -> Result<()> {
        if a == VOID || b == VOID {
            let middle = [0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])];
            return self.add_border(middle, a.max(b)).map(drop);
        }
        for level in a.min(b)..a.max(b) {
            let share = level_share(levels.value(level), values);
            let at = |axis: usize| start[axis] + share * (end[axis] - start[axis]);
            for side in 0..self.tracing.sides() {
                self.add([at(0), at(1)], level + side as i32, false)?;
            }
        }
        Ok(())
    }

    /// Adds the nodes of a point at the edge of a last cell.
    pub(super) fn add_border(&mut self, point: [f64; 2], rank: i32) -> Result<EdgeNodes> {
        let (low, count) = self.tracing.first_at_border(rank);
        let first = self.points.len() as u32;
        for number in 0..count {
            self.add(point, low.saturating_add(number as i32), true)?;
        }
        Ok(EdgeNodes { first, low })
    }

    /// Adds the nodes on a line inside a square.
    pub(super) fn add_inner(
        &mut self,
        levels: &Levels,
        ends: [[f64; 2]; 2],
        values: [f64; 2],
        ranks: [i32; 2],
    ) -> Result<EdgeNodes> {
        let first = self.points.len() as u32;
        self.add_edge(levels, ends, values, ranks)?;
        Ok(EdgeNodes { first, low: ranks[0].min(ranks[1]) })
    }

    /// Returns the nodes of an edge between two cells with these ranks.
    #[inline]
    pub(super) fn of_edge(&self, edge: usize, [a, b]: [i32; 2]) -> EdgeNodes {
        let low = match (a == VOID || b == VOID, self.tracing) {
            (false, _) => a.min(b),
            (true, tracing) => tracing.first_at_border(a.max(b)).0,
        };
        EdgeNodes { first: self.edges[edge], low }
    }

    /// Returns the node where an edge crosses a level. For bands, `side` selects the band below (0)
    /// or above (1) the level; lines ignore it.
    #[inline]
    pub(super) fn crossing(&self, edge: EdgeNodes, level: i32, side: u32) -> u32 {
        match self.tracing {
            Tracing::Bands => edge.first + 2 * (level - edge.low) as u32 + side,
            _ => edge.first + (level - edge.low) as u32,
        }
    }

    /// Makes a node the successor of another one.
    #[inline]
    pub(super) fn link(&mut self, from: u32, to: u32) {
        let (from, to) = if self.is_reversed { (to, from) } else { (from, to) };
        self.next[from as usize] = to;
        self.has_previous[to as usize] = true;
    }

    /// Returns the edge of a node and the node's number on it, or `None` if the node is inside a
    /// square.
    pub(super) fn edge_of(&self, node: u32) -> Option<(usize, u32)> {
        let edge = self.edges.partition_point(|first| *first <= node).checked_sub(1)?;
        (edge + 1 < self.edges.len()).then(|| (edge, node - self.edges[edge]))
    }
}

/// Returns the position of a level between two values, as a fraction that keeps a distance from
/// both.
#[inline]
pub fn level_share(level: f64, [a, b]: [f64; 2]) -> f64 {
    // (Halves cannot overflow.)
    let share = (0.5 * level - 0.5 * a) / (0.5 * b - 0.5 * a);
    // (Halves of the smallest subnormals are 0.)
    if share.is_nan() { 0.5 } else { share.clamp(AWAY, 1.0 - AWAY) }
}

/// Returns the minimum distance of lines from each other, in cells.
pub(super) const fn away() -> f64 {
    AWAY
}
