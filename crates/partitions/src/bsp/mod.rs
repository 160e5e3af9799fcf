//! BSP trees: each node divides along a line of the plane, or a plane of space, wherever it lies (H. Fuchs, Z. Kedem, B. Naylor, *On visible
//! surface generation by a priori tree structures*, 1980).
//!
//! Coordinates are whole numbers from 0 to below 2^26, and all decisions are exact: lines and planes are those of what was given, and
//! corners are where such planes meet ([`spinney_brep::ExactPlane`]). Trees of the plane are those of prisms of height 1 over it, so that everything is
//! written once: `facet.rs` has polygons in planes, `region.rs` the cells of space. `build.rs` makes trees, `combine.rs` merges them, `sections.rs` finds the
//! boundary of what is inside, `outlines.rs` makes polygons of it, `blocks.rs` quadtrees and octrees.

mod blocks;
mod build;
mod combine;
mod facet;
mod outlines;
mod region;
mod sections;

pub use blocks::BspBlocks;
pub use build::MAX_PIECES;

use spinney_base::space::Dimension;
use spinney_brep::ExactPlane;

use self::facet::Facet;
use crate::preorder::BinaryNode;

/// A piece of a segment or face in the line or plane of a node.
#[derive(Clone, Debug)]
pub struct BspPiece {
    /// Number of the segment, polygon, face or triangle that it is of.
    pub source: usize,
    facet: Facet,
}

impl BspPiece {
    /// Of pieces of triangles: the side of the triangle, 0 to 2 from that corner on, that each edge is a part of. Those that cuts made are of none.
    pub fn sides(&self) -> impl Iterator<Item = Option<u8>> {
        self.facet.edges.iter().map(|edge| edge.side)
    }
}

/// The line or plane of a node, and what lies in it.
#[derive(Clone, Debug)]
pub struct Division {
    plane: ExactPlane,
    /// The pieces in the line or plane, of what the tree was made of; a merged tree has none.
    pub pieces: Vec<BspPiece>,
}

impl Division {
    /// The descriptor: the first side is where `a x + b y + c z + d` is negative, the second one where it is not. `c` of lines is 0.
    pub fn descriptor(&self) -> ([i64; 3], i128) {
        (self.plane.normal, -self.plane.offset)
    }
}

/// Node of a BSP tree: it divides, or is a cell, which is inside or not.
pub type BspNode = BinaryNode<Division, bool>;

/// A view of a BSP tree.
#[derive(Clone, Copy, Debug)]
pub enum Seen<'a> {
    /// A piece in the line or plane of a node.
    Piece(&'a BspPiece),
    /// A cell, by the number of its node, and whether it is inside.
    Cell(usize, bool),
}

/// A BSP tree of the plane or of space, in memory.
///
/// ```
/// use spinney::SetOperation;
/// use spinney::raw::partitions::Bsp;
///
/// let square = |from: i32, to: i32| vec![[from, from], [to, from], [to, to], [from, to]];
/// let frame = Bsp::of_polygons(&[vec![square(0, 9), square(3, 6)]])?;
/// assert!(frame.is_inside([1, 4, 0]) && !frame.is_inside([4, 4, 0]));
/// let corner = frame.combine(&Bsp::of_polygons(&[vec![square(2, 5)]])?, SetOperation::Intersection)?;
/// assert_eq!(corner.outlines()?, [[[3.0, 3.0], [3.0, 5.0], [2.0, 5.0], [2.0, 2.0], [5.0, 2.0], [5.0, 3.0]]]);
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Bsp {
    dimension: Dimension,
    nodes: Vec<BspNode>,
}

impl Bsp {
    /// The nodes in preorder.
    pub fn nodes(&self) -> &[BspNode] {
        &self.nodes
    }

    /// The corners of a piece, of trees of the plane its ends.
    pub fn corners(&self, piece: &BspPiece) -> Vec<[f64; 3]> {
        let is_flat = self.dimension == Dimension::Quad;
        let corners = piece.facet.edges.iter().map(|edge| edge.start.near);
        corners.filter(|corner| !is_flat || corner[2] == 0.0).collect()
    }

    /// The number of the node in whose cell a point of the grid is; where it is on a line or plane, the side in front has it.
    pub fn locate(&self, point: [i32; 3]) -> usize {
        self.leaf_at(point.map(|at| 2 * i128::from(at)))
    }

    /// Whether a point of the grid is inside.
    pub fn is_inside(&self, point: [i32; 3]) -> bool {
        matches!(self.nodes[self.locate(point)], BinaryNode::Leaf(true))
    }

    /// The leaf of a point of the grid's halves, by twice its coordinates.
    fn leaf_at(&self, twice: [i128; 3]) -> usize {
        let mut at = 0;
        while let BinaryNode::Divided { by, second } = &self.nodes[at] {
            at = if height(&by.plane, twice) >= 0 { *second } else { at + 1 };
        }
        at
    }

    /// Hands out all cells and pieces so that none is behind one that was before it, as seen from a point of the grid. (Pieces whose line or plane
    /// the eye is in are seen from the edge, and come at any time.)
    pub fn back_to_front<'a>(&'a self, eye: [i32; 3], take: &mut dyn FnMut(Seen<'a>)) {
        let eye = eye.map(|at| 2 * i128::from(at));
        self.in_order(&|plane| height(plane, eye) >= 0, take);
    }

    /// Hands out the pieces and regions from back to front, as they are seen from far away in a direction.
    pub fn back_to_front_from_afar<'a>(&'a self, direction: [i32; 3], take: &mut dyn FnMut(Seen<'a>)) {
        let rises = |plane: &ExactPlane| {
            let along =
                plane.normal.iter().zip(direction).map(|(part, at)| i128::from(*part) * i128::from(at));
            along.sum::<i128>() >= 0
        };
        self.in_order(&rises, take);
    }

    /// Hands out all cells and pieces, those on the side of each plane on which the eye is last.
    fn in_order<'a>(&'a self, is_in_front: &dyn Fn(&ExactPlane) -> bool, take: &mut dyn FnMut(Seen<'a>)) {
        enum Step {
            Node(usize),
            Pieces(usize),
        }
        let mut pending = vec![Step::Node(0)];
        while let Some(step) = pending.pop() {
            match step {
                Step::Node(at) => match &self.nodes[at] {
                    BinaryNode::Leaf(inside) => take(Seen::Cell(at, *inside)),
                    BinaryNode::Divided { by, second } => {
                        let (near, far) =
                            if is_in_front(&by.plane) { (*second, at + 1) } else { (at + 1, *second) };
                        pending.extend([Step::Node(near), Step::Pieces(at), Step::Node(far)]);
                    }
                },
                Step::Pieces(at) => {
                    if let BinaryNode::Divided { by, .. } = &self.nodes[at] {
                        by.pieces.iter().for_each(|piece| take(Seen::Piece(piece)));
                    }
                }
            }
        }
    }
}

/// Twice the height of a point over a plane, of twice its coordinates.
fn height(plane: &ExactPlane, twice: [i128; 3]) -> i128 {
    let along: i128 = plane.normal.iter().zip(twice).map(|(part, at)| i128::from(*part) * at).sum();
    along - 2 * plane.offset
}

#[cfg(test)]
mod tests;
