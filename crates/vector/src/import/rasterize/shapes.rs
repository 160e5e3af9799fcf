//! Shapes in a tree's cells, and their parts in nodes.
//!
//! Invariant: a node's part determines the shape in all of its cells. It has the winding number at
//! one point of the node, and every edge that may pass between that point and any other point of
//! the node. A node is convex, so a path between two of its points stays inside, and meets only
//! edges of the part. Children thus depend only on their parent's parts, and each edge is tested
//! once per level.

use std::ops::Range;

use spinney_base::space::{Bounds, EdgeRule};

use super::edge::{Edge, PARTS, Point, centre};
use super::mask::Mask;
use super::slivers::have_no_centre_between;

/// Kind of a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ShapeKind {
    /// Rings: a point with an odd winding number is inside.
    Polygon,
    /// Edges only.
    Line,
    /// Edges with a radius in grid units.
    Wide(i64),
    /// Points, each an edge of length zero.
    Points,
}

/// Shape with a value.
#[derive(Clone, Debug)]
pub(super) struct Shape {
    pub(super) kind: ShapeKind,
    /// Number of its value.
    pub(super) value: u32,
    /// Range of its edges.
    pub(super) edges: Range<usize>,
}

/// Shapes; later ones are on top.
#[derive(Debug, Default)]
pub(super) struct Shapes {
    pub(super) edges: Vec<Edge>,
    pub(super) shapes: Vec<Shape>,
    /// Whether only cell centres decide which cells a polygon covers.
    pub(super) centres_alone: bool,
}

/// Part of a shape in a node.
#[derive(Clone, Debug)]
pub(super) struct ClippedShape {
    /// Index of the shape.
    pub(super) shape: u32,
    /// Winding number of a polygon at the centre of the node's first cell.
    pub(super) winding: i32,
    /// Range of the edges that may meet the node; empty if the shape covers all of it.
    pub(super) edges: Range<usize>,
}

impl ClippedShape {
    /// Returns whether the shape covers the entire node.
    pub(super) fn is_whole(&self) -> bool {
        self.edges.is_empty()
    }

    /// Returns whether the node's first centre is inside.
    pub(super) fn is_inside(&self) -> bool {
        self.winding % 2 != 0
    }
}

/// Parts of all shapes in a node, in the order of the shapes.
#[derive(Debug, Default)]
pub(super) struct ClippedShapes {
    pub(super) parts: Vec<ClippedShape>,
    edges: Vec<u32>,
}

/// Returns the centre of a node's first cell.
pub(super) fn first_centre(bounds: &Bounds) -> Point {
    [centre(bounds.min[0] as i64), centre(bounds.min[1] as i64)]
}

impl Shapes {
    /// Adds a shape of edges.
    pub(super) fn add(&mut self, kind: ShapeKind, value: u32, edges: impl Iterator<Item = Edge>) {
        let start = self.edges.len();
        self.edges.extend(edges);
        self.shapes.push(Shape { kind, value, edges: start..self.edges.len() });
    }

    /// Returns the parts of a root with these bounds.
    pub(super) fn root(&self, space: &Bounds) -> ClippedShapes {
        let (first, mut root) = (first_centre(space), ClippedShapes::default());
        for (number, shape) in self.shapes.iter().enumerate() {
            let edges = shape.edges.clone();
            let winding = match shape.kind {
                ShapeKind::Polygon => self.edges[edges.clone()].iter().map(|edge| edge.winding(first)).sum(),
                ShapeKind::Line | ShapeKind::Wide(_) | ShapeKind::Points => 0,
            };
            self.add_part(&mut root, (number as u32, winding), edges.map(|edge| edge as u32), space);
        }
        root
    }

    /// Returns the parts of a node's four children; `space` is the node's box. Cost: four tests per
    /// edge of the node.
    pub(super) fn children(
        &self,
        parts: &ClippedShapes,
        space: &Bounds,
        children: &[Bounds; 4],
    ) -> [ClippedShapes; 4] {
        let mut found: [ClippedShapes; 4] = Default::default();
        let [first, last] = [first_centre(space), first_centre(&children[3])];
        for part in &parts.parts {
            // The paths from the node's first centre to those of its children lead right, up, or up
            // and then right.
            let mut windings = [part.winding; 4];
            if self.shapes[part.shape as usize].kind == ShapeKind::Polygon {
                for edge in self.edges_of(parts, part) {
                    let up = edge.on_the_way_up(first, last[1]);
                    windings[1] += edge.on_the_way_right(first, last[0]);
                    windings[2] += up;
                    windings[3] += up + edge.on_the_way_right([first[0], last[1]], last[0]);
                }
            }
            for ((found, winding), space) in found.iter_mut().zip(windings).zip(children) {
                let edges = parts.edges[part.edges.clone()].iter().copied();
                self.add_part(found, (part.shape, winding), edges, space);
            }
        }
        found
    }

    /// Adds the part of a shape in a node, given candidate edges.
    fn add_part(
        &self,
        parts: &mut ClippedShapes,
        (shape, winding): (u32, i32),
        edges: impl Iterator<Item = u32>,
        space: &Bounds,
    ) {
        let reach = if let ShapeKind::Wide(radius) = self.shapes[shape as usize].kind { radius } else { 0 };
        let low = [space.min[0], space.min[1]].map(|cell| cell as i64 * PARTS - reach);
        let high = [space.max[0], space.max[1]].map(|cell| cell as i64 * PARTS + reach);
        let start = parts.edges.len();
        parts.edges.extend(edges.filter(|edge| self.edges[*edge as usize].may_meet(low, high)));
        let is_polygon = self.shapes[shape as usize].kind == ShapeKind::Polygon;
        // Edges without a cell centre between them are dropped. Only nodes that have both cells
        // inside the polygon and others are thus divided.
        if is_polygon && self.centres_alone {
            let edge = |number: &u32| &self.edges[*number as usize];
            let (first, side) = (first_centre(space), (space.max[0] - space.min[0]) as i64);
            let is_without = match &parts.edges[start..] {
                [one] => have_no_centre_between(&[edge(one)], first, side),
                [one, other] => have_no_centre_between(&[edge(one), edge(other)], first, side),
                _ => false,
            };
            if is_without {
                parts.edges.truncate(start);
            }
        }
        let part = ClippedShape { shape, winding, edges: start..parts.edges.len() };
        if !part.is_whole() || (is_polygon && part.is_inside()) {
            parts.parts.push(part);
        }
    }

    /// Yields the wanted cells of a block with their parts, given the block's parts and its first
    /// cell.
    pub(super) fn each_cell(
        &self,
        parts: &ClippedShapes,
        cell: Point,
        wanted: &[bool],
        each: &mut dyn FnMut(usize, &ClippedShapes, Point),
    ) {
        let side = wanted.len().isqrt();
        let block = Block { cell, side, wanted };
        if wanted.contains(&true) {
            self.each_cell_below(parts, &block, ([0; 2], side), each);
        }
    }

    fn each_cell_below(
        &self,
        parts: &ClippedShapes,
        block: &Block<'_>,
        (at, side): ([usize; 2], usize),
        each: &mut dyn FnMut(usize, &ClippedShapes, Point),
    ) {
        if side == 1 {
            let cell = [0, 1].map(|axis| block.cell[axis] + at[axis] as i64);
            return each(at[1] * block.side + at[0], parts, cell);
        }
        let half = side / 2;
        let corners = [at, [at[0] + half, at[1]], [at[0], at[1] + half], [at[0] + half, at[1] + half]];
        let children =
            self.children(parts, &block.bounds(at, side), &corners.map(|at| block.bounds(at, half)));
        for (at, parts) in corners.into_iter().zip(&children) {
            let mut rows = (at[1]..at[1] + half).map(|row| row * block.side + at[0]);
            if rows.any(|first| block.wanted[first..first + half].contains(&true)) {
                self.each_cell_below(parts, block, (at, half), each);
            }
        }
    }

    /// Sets the cells that a shape covers by the edge rule.
    pub(super) fn mask(
        &self,
        mask: &mut Mask,
        (parts, part): (&ClippedShapes, &ClippedShape),
        cell: Point,
        edge: EdgeRule,
    ) {
        let edges = || self.edges_of(parts, part);
        match self.shapes[part.shape as usize].kind {
            ShapeKind::Polygon if part.is_whole() => mask.fill(true),
            ShapeKind::Polygon => {
                mask.centres(edges(), cell, part.is_inside());
                if edge == EdgeRule::Touch {
                    mask.touch(edges(), cell, false);
                }
            }
            ShapeKind::Line => {
                mask.fill(false);
                mask.touch(edges(), cell, true);
            }
            ShapeKind::Wide(radius) => {
                mask.fill(false);
                mask.near(edges(), cell, radius);
            }
            ShapeKind::Points => {
                mask.fill(false);
                mask.points(edges(), cell);
            }
        }
    }

    /// Returns the edges of a part.
    pub(super) fn edges_of<'a>(
        &'a self,
        parts: &'a ClippedShapes,
        part: &ClippedShape,
    ) -> impl Iterator<Item = &'a Edge> + Clone {
        parts.edges[part.edges.clone()].iter().map(|edge| &self.edges[*edge as usize])
    }
}

/// Block of cells, some of which are wanted.
struct Block<'a> {
    cell: Point,
    side: usize,
    wanted: &'a [bool],
}

impl Block<'_> {
    /// Returns the bounds of a square of its cells in the tree.
    fn bounds(&self, at: [usize; 2], side: usize) -> Bounds {
        let [x, y] = [0, 1].map(|axis| (self.cell[axis] + at[axis] as i64) as u64);
        Bounds { min: [x, y, 0], max: [x + side as u64, y + side as u64, 1] }
    }
}

impl ClippedShapes {
    /// Returns the memory size in bytes.
    pub(super) fn bytes(&self) -> usize {
        size_of::<ClippedShapes>()
            + self.parts.capacity() * size_of::<ClippedShape>()
            + self.edges.capacity() * size_of::<u32>()
    }

    /// Drops the parts below the last shape that covers the entire node.
    pub(super) fn uncovered(mut self) -> ClippedShapes {
        if let Some(top) = self.parts.iter().rposition(ClippedShape::is_whole) {
            self.parts.drain(..top);
        }
        self
    }
}
