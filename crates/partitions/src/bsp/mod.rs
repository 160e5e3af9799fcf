//! BSP trees: each node divides along an arbitrary line of the plane, or an arbitrary plane of
//! space (H. Fuchs, Z. Kedem, B. Naylor, *On visible surface generation by a priori tree
//! structures*, 1980).
//!
//! Coordinates are integers from 0 to 2^26 - 1, and all decisions are exact. Lines and planes are
//! those of the input, and vertices are intersections of such planes
//! ([`spinney_brep::ExactPlane`]). A tree of the plane is stored as a tree of prisms of height 1
//! over it, so that one implementation serves both. `facet.rs` has polygons in planes, `region.rs`
//! the cells of space. `build.rs` builds trees, `combine.rs` merges them, `sections.rs` finds the
//! boundary of the inside, `outlines.rs` and `polygons.rs` convert it to polygons, `blocks.rs`
//! provides quadtrees and octrees, and `text.rs` text.

mod blocks;
mod build;
mod combine;
mod facet;
mod outlines;
mod polygons;
mod region;
mod sections;
mod text;

pub use blocks::BspBlocks;
pub(crate) use build::Fragments;
pub use build::MAX_FRAGMENTS;
pub use text::PlaneText;

use spinney_base::space::Dimension;
use spinney_brep::ExactPlane;

use self::facet::Facet;
use crate::preorder::BinaryNode;

/// Fragment of a segment or face, in the line or plane of a node.
#[derive(Clone, Debug)]
pub struct BspFragment {
    /// Index of the segment, polygon, face or triangle that the fragment belongs to.
    pub source: usize,
    facet: Facet,
}

impl BspFragment {
    /// For fragments of triangles: the triangle's side that each edge lies on. Side 0 to 2 starts
    /// at the vertex with that index. `None` for edges that cuts created.
    pub fn sides(&self) -> impl Iterator<Item = Option<u8>> {
        self.facet.edges.iter().map(|edge| edge.side)
    }
}

/// Line or plane of a node, and the fragments in it.
#[derive(Clone, Debug)]
pub struct Division {
    plane: ExactPlane,
    /// Fragments of the input in the line or plane. A merged tree has none.
    pub fragments: Vec<BspFragment>,
}

impl Division {
    /// Division by a plane, without fragments.
    pub(crate) fn by(plane: ExactPlane) -> Division {
        Division { plane, fragments: Vec::new() }
    }

    pub(crate) fn plane(&self) -> &ExactPlane {
        &self.plane
    }

    /// Coefficients `([a, b, c], d)`, without a common divisor. The first side, at the back, is
    /// where `a x + b y + c z + d` is negative; the second side, in front, is where it is not. For
    /// lines, `c` is 0.
    pub fn descriptor(&self) -> ([i64; 3], i128) {
        let plane = self.plane.reduced();
        (plane.normal, -plane.offset)
    }
}

/// Node of a BSP tree: it divides, or is a cell, which is inside or not.
pub type BspNode = BinaryNode<Division, bool>;

/// Item of a traversal from back to front.
#[derive(Clone, Copy, Debug)]
pub enum BspItem<'a> {
    /// Fragment in the line or plane of a node.
    Fragment(&'a BspFragment),
    /// Cell: the index of its node, and whether it is inside.
    Cell(usize, bool),
}

/// BSP tree of the plane or of space, in memory.
///
/// ```
/// use spinney::SetOperation;
/// use spinney::raw::partitions::Bsp;
///
/// let square = |from: i32, to: i32| vec![[from, from], [to, from], [to, to], [from, to]];
/// let frame = Bsp::of_polygons(&[vec![square(0, 9), square(3, 6)]])?;
/// assert!(frame.is_inside([1, 4, 0]) && !frame.is_inside([4, 4, 0]));
/// let other = Bsp::of_polygons(&[vec![square(2, 5)]])?;
/// let corner = frame.combine(&other, SetOperation::Intersection, &())?;
/// assert_eq!(corner.outlines()?, [[[3.0, 3.0], [3.0, 5.0], [2.0, 5.0], [2.0, 2.0], [5.0, 2.0], [5.0, 3.0]]]);
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Bsp {
    dimension: Dimension,
    nodes: Vec<BspNode>,
}

impl Bsp {
    /// Tree of nodes in preorder.
    pub(crate) fn of_nodes(dimension: Dimension, nodes: Vec<BspNode>) -> Bsp {
        Bsp { dimension, nodes }
    }

    /// Nodes in preorder.
    pub fn nodes(&self) -> &[BspNode] {
        &self.nodes
    }

    /// Number of levels below the root.
    pub fn depth(&self) -> usize {
        let (mut depth, mut pending) = (0, vec![(0, 0)]);
        while let Some((at, level)) = pending.pop() {
            depth = depth.max(level);
            if let BinaryNode::Divided { second, .. } = &self.nodes[at] {
                pending.extend([(at + 1, level + 1), (*second, level + 1)]);
            }
        }
        depth
    }

    /// Vertices of a fragment; the two ends in trees of the plane.
    pub fn corners(&self, fragment: &BspFragment) -> Vec<[f64; 3]> {
        let is_flat = self.dimension == Dimension::Quad;
        let corners = fragment.facet.edges.iter().map(|edge| edge.start.near);
        corners.filter(|corner| !is_flat || corner[2] == 0.0).collect()
    }

    /// Returns the index of the leaf that contains a grid point. A point on a line or plane belongs
    /// to the side in front of it.
    pub fn locate(&self, point: [i32; 3]) -> usize {
        self.leaf_at(point.map(|at| 2 * i128::from(at)))
    }

    /// Whether a grid point is inside.
    pub fn is_inside(&self, point: [i32; 3]) -> bool {
        matches!(self.nodes[self.locate(point)], BinaryNode::Leaf(true))
    }

    /// Leaf of a point at half-integer coordinates, given twice its coordinates.
    fn leaf_at(&self, twice: [i128; 3]) -> usize {
        let mut at = 0;
        while let BinaryNode::Divided { by, second } = &self.nodes[at] {
            at = if height(&by.plane, twice) >= 0 { *second } else { at + 1 };
        }
        at
    }

    /// Calls `take` for all cells and fragments from back to front, as seen from a grid point: none
    /// is hidden by an earlier one. (Fragments whose line or plane contains the eye are seen
    /// edge-on, and may come at any time.)
    pub fn back_to_front<'a>(&'a self, eye: [i32; 3], take: &mut dyn FnMut(BspItem<'a>)) {
        let eye = eye.map(|at| 2 * i128::from(at));
        self.in_order(&|plane| height(plane, eye) >= 0, take);
    }

    /// Calls `take` for all cells and fragments from back to front, for a viewer at infinity in
    /// `direction`.
    pub fn back_to_front_from_afar<'a>(&'a self, direction: [i32; 3], take: &mut dyn FnMut(BspItem<'a>)) {
        let rises = |plane: &ExactPlane| {
            let along =
                plane.normal.iter().zip(direction).map(|(part, at)| i128::from(*part) * i128::from(at));
            along.sum::<i128>() >= 0
        };
        self.in_order(&rises, take);
    }

    /// Calls `take` for all cells and fragments. At each node, the viewer's side comes last.
    fn in_order<'a>(&'a self, is_in_front: &dyn Fn(&ExactPlane) -> bool, take: &mut dyn FnMut(BspItem<'a>)) {
        enum PendingItem {
            Node(usize),
            Fragments(usize),
        }
        let mut pending = vec![PendingItem::Node(0)];
        while let Some(step) = pending.pop() {
            match step {
                PendingItem::Node(at) => match &self.nodes[at] {
                    BinaryNode::Leaf(inside) => take(BspItem::Cell(at, *inside)),
                    BinaryNode::Divided { by, second } => {
                        let (near, far) =
                            if is_in_front(&by.plane) { (*second, at + 1) } else { (at + 1, *second) };
                        pending.extend([
                            PendingItem::Node(near),
                            PendingItem::Fragments(at),
                            PendingItem::Node(far),
                        ]);
                    }
                },
                PendingItem::Fragments(at) => {
                    if let BinaryNode::Divided { by, .. } = &self.nodes[at] {
                        by.fragments.iter().for_each(|fragment| take(BspItem::Fragment(fragment)));
                    }
                }
            }
        }
    }
}

/// Twice the value of a plane's equation at a point, given twice the point's coordinates.
fn height(plane: &ExactPlane, twice: [i128; 3]) -> i128 {
    let along: i128 = plane.normal.iter().zip(twice).map(|(part, at)| i128::from(*part) * at).sum();
    along - 2 * plane.offset
}

#[cfg(test)]
mod tests;
