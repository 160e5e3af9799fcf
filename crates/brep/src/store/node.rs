//! Nodes of an exact model's octree, and their states.

use super::segment::{FULL, LEAF, LeafHead, LeafRule, ModelSegment, NEAR_FULL, NEAR_VOID, NodeKind, VOID};
use crate::Grid;

/// A node of a model's octree.
#[derive(Clone)]
pub struct ModelNode<'a> {
    pub(super) level: u8,
    pub(super) position: [u32; 3],
    pub(super) word: u32,
    pub(super) segment: ModelSegment<'a>,
    /// Whether it is the root of its segment.
    pub(super) begins_segment: bool,
}

/// State of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelNodeState {
    /// Outside of the body.
    Void,
    /// Inside of the body.
    Full,
    /// Divided: see [`ExactModel::children`](crate::ExactModel::children).
    Inner,
    /// Cut by faces: see [`ModelNode::faces`].
    Leaf {
        /// Kind of the cell: what the planes of its faces share.
        kind: NodeKind,
        /// How the planes define the inside.
        rule: LeafRule,
        /// Whether the cell's minimum corner is inside. A corner on a face is perturbed along x,
        /// much less along y, and still less along z.
        inside: bool,
    },
}

/// Returns the minimum and maximum coordinates of a cell, in half units of the grid.
fn bounds(level: u8, position: [u32; 3], grid: &Grid) -> [[i64; 3]; 2] {
    let width = 2i64 << (grid.bits - level);
    let low = position.map(|at| i64::from(at) * width - 1);
    [low, low.map(|low| low + width)]
}

/// Returns the minimum and maximum world coordinates of a cell.
pub(crate) fn world_box(level: u8, position: [u32; 3], grid: &Grid) -> [[f64; 3]; 2] {
    bounds(level, position, grid).map(|corner| grid.to_world_between(corner.map(|at| at as f64 / 2.0)))
}

impl ModelNode<'_> {
    /// Returns the node's level: the root is 0.
    pub fn level(&self) -> u8 {
        self.level
    }

    /// Returns the node's coordinates among the nodes of its level.
    pub fn position(&self) -> [u32; 3] {
        self.position
    }

    /// Returns the minimum and maximum coordinates of the node's cell, in half units of the grid.
    /// Walls are at odd multiples of half a unit, so no grid point is on a wall.
    pub fn bounds(&self, grid: &Grid) -> [[i64; 3]; 2] {
        bounds(self.level, self.position, grid)
    }

    /// Returns the minimum and maximum world coordinates of the node's cell.
    pub fn world_box(&self, grid: &Grid) -> [[f64; 3]; 2] {
        world_box(self.level, self.position, grid)
    }

    pub(crate) fn begins_segment(&self) -> bool {
        self.begins_segment
    }

    /// Returns the node's segment with other face numbers: see [`ModelSegment::renumbered`].
    pub(crate) fn renumbered_segment(
        &self,
        face: &dyn Fn(u32) -> Option<u32>,
        exact: &dyn Fn(u32) -> Option<u32>,
    ) -> Option<Vec<u8>> {
        self.segment.renumbered(face, exact)
    }

    /// Returns the state of the node.
    #[inline]
    pub fn state(&self) -> ModelNodeState {
        match self.word & 7 {
            VOID | NEAR_VOID => ModelNodeState::Void,
            FULL | NEAR_FULL => ModelNodeState::Full,
            LEAF => {
                let (LeafHead { kind, rule, inside }, _) = self.segment.leaf(self.word);
                ModelNodeState::Leaf { kind, rule, inside }
            }
            _ => ModelNodeState::Inner,
        }
    }

    /// Returns the winding number of the exact surface in the whole cell, if no face cuts it and no
    /// face with off-grid vertices is near it.
    pub(crate) fn winding(&self) -> Option<i32> {
        match self.word & 7 {
            VOID => Some(0),
            FULL => Some(1),
            _ => None,
        }
    }

    /// Returns the numbers of the faces that cut a leaf's cell, in an order without meaning; empty
    /// for other nodes.
    #[inline]
    pub fn faces(&self) -> impl Iterator<Item = u64> {
        let list = (self.word & 7 == LEAF).then(|| self.segment.leaf(self.word).1);
        list.into_iter().flatten()
    }

    /// Returns the numbers of faces with off-grid vertices near the cell of a node without
    /// children.
    pub(crate) fn near(&self) -> Vec<u32> {
        self.segment.near(self.word)
    }
}
