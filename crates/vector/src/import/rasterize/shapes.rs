//! Shapes in cells of a tree, and the parts of them that nodes have.
//!
//! Invariant: a node's part tells all that its cells need: the winding number at one point of the node, and every edge that may pass between that and any
//! other point of the node. A way from one point to another stays in the node, which is convex, so that the edges on it are among the part's. So children are made of their
//! parent's parts alone, and each edge is tested once a level.

use std::ops::Range;

use spinney_base::space::{Bounds, EdgeRule};

use super::edge::{Edge, PARTS, Point, centre};
use super::mask::Mask;
use super::slivers::have_no_centre_between;

/// Kind of a shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ShapeKind {
    /// Rings: a point that an odd number of them goes around is inside.
    Polygon,
    /// Edges alone.
    Line,
    /// Edges, and what is no farther from them than so many parts of cells.
    Wide(i64),
    /// Points, each an edge without a length.
    Points,
}

/// A shape with a value.
#[derive(Clone, Debug)]
pub(super) struct Shape {
    pub(super) kind: ShapeKind,
    /// Number of its value.
    pub(super) value: u32,
    /// Its edges among all.
    pub(super) edges: Range<usize>,
}

/// Shapes, those behind others on top of them.
#[derive(Debug, Default)]
pub(super) struct Shapes {
    pub(super) edges: Vec<Edge>,
    pub(super) shapes: Vec<Shape>,
    /// Whether only the centres of cells decide which cells polygons have.
    pub(super) centres_alone: bool,
}

/// The part of a shape that a node has.
#[derive(Clone, Debug)]
pub(super) struct Part {
    /// Number of the shape.
    pub(super) shape: u32,
    /// How many times a polygon winds round the centre of the node's first cell.
    pub(super) winding: i32,
    /// The edges that may meet the node, among those of all parts; nothing if the shape has all of it.
    pub(super) edges: Range<usize>,
}

impl Part {
    /// Whether the shape has all of the node.
    pub(super) fn is_whole(&self) -> bool {
        self.edges.is_empty()
    }

    /// Whether the node's first centre is inside.
    pub(super) fn is_inside(&self) -> bool {
        self.winding % 2 != 0
    }
}

/// The parts of all shapes that a node has, in the shapes' order.
#[derive(Debug, Default)]
pub(super) struct Parts {
    pub(super) parts: Vec<Part>,
    edges: Vec<u32>,
}

/// The centre of a node's first cell.
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

    /// The parts of a root with such a space.
    pub(super) fn root(&self, space: &Bounds) -> Parts {
        let (first, mut root) = (first_centre(space), Parts::default());
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

    /// The parts of the four children of a node, given the node's space. Time goes with the edges that the node has, four times.
    pub(super) fn children(&self, parts: &Parts, space: &Bounds, children: &[Bounds; 4]) -> [Parts; 4] {
        let mut found: [Parts; 4] = Default::default();
        let [first, last] = [first_centre(space), first_centre(&children[3])];
        for part in &parts.parts {
            // The way leads right, or up, or up and then right, from the node's first centre to those of its children.
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

    /// Adds the part of a shape that a node has, by the edges that it may have there.
    fn add_part(
        &self,
        parts: &mut Parts,
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
        // (What is between two edges and has no centre is not gone into: a node that is divided has cells of the polygon, and others.)
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
        let part = Part { shape, winding, edges: start..parts.edges.len() };
        if !part.is_whole() || (is_polygon && part.is_inside()) {
            parts.parts.push(part);
        }
    }

    /// Yields those cells of a block that are wanted, with their parts, given the block's parts and its first cell.
    pub(super) fn each_cell(
        &self,
        parts: &Parts,
        cell: Point,
        wanted: &[bool],
        each: &mut dyn FnMut(usize, &Parts, Point),
    ) {
        let side = wanted.len().isqrt();
        let block = Block { cell, side, wanted };
        if wanted.contains(&true) {
            self.each_cell_below(parts, &block, ([0; 2], side), each);
        }
    }

    fn each_cell_below(
        &self,
        parts: &Parts,
        block: &Block<'_>,
        (at, side): ([usize; 2], usize),
        each: &mut dyn FnMut(usize, &Parts, Point),
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

    /// The cells that a shape has by the rule for edges.
    pub(super) fn mask(&self, mask: &mut Mask, (parts, part): (&Parts, &Part), cell: Point, edge: EdgeRule) {
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

    /// The edges of a part.
    pub(super) fn edges_of<'a>(
        &'a self,
        parts: &'a Parts,
        part: &Part,
    ) -> impl Iterator<Item = &'a Edge> + Clone {
        parts.edges[part.edges.clone()].iter().map(|edge| &self.edges[*edge as usize])
    }
}

/// A block of cells, some of which are wanted.
struct Block<'a> {
    cell: Point,
    side: usize,
    wanted: &'a [bool],
}

impl Block<'_> {
    /// A square of its cells in the tree.
    fn bounds(&self, at: [usize; 2], side: usize) -> Bounds {
        let [x, y] = [0, 1].map(|axis| (self.cell[axis] + at[axis] as i64) as u64);
        Bounds { min: [x, y, 0], max: [x + side as u64, y + side as u64, 1] }
    }
}

impl Parts {
    /// Bytes of memory.
    pub(super) fn bytes(&self) -> usize {
        size_of::<Parts>()
            + self.parts.capacity() * size_of::<Part>()
            + self.edges.capacity() * size_of::<u32>()
    }

    /// Leaves out what lies below the last shape that has all of the node, which hides it.
    pub(super) fn uncovered(mut self) -> Parts {
        if let Some(top) = self.parts.iter().rposition(Part::is_whole) {
            self.parts.drain(..top);
        }
        self
    }
}
