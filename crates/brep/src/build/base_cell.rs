//! Cells of a result's octree, and the nodes of a base model that they are.
//!
//! The base's grid is a cell of the result's grid: both have the same unit, and the base's grid
//! begins a multiple of its own width after the result's. So each node of the base is a cell of the
//! result, some levels further down.

use super::base::BaseModel;
use super::cells::Cell;
use crate::{Faces, ModelNode, ModelNodeState};
use spinney_base::Result;

/// The cell of a result's octree that is the root of the base.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct BaseRoot {
    /// Its level: 0 if both grids are the same.
    pub(crate) level: u8,
    /// Its position among the cells of its level.
    pub(crate) position: [u32; 3],
}

impl BaseRoot {
    /// Whether the base's grid is not that of the result.
    pub(crate) fn is_moved(self) -> bool {
        self != BaseRoot::default()
    }
}

/// Counterpart of a result's cell in the base.
pub(super) enum BaseCell<'a> {
    /// The base's root is one of the cell's descendants.
    Above,
    /// The cell is outside of the base's grid: no face of the base is in it.
    Outside,
    /// The cell is this node.
    Node(ModelNode<'a>),
}

impl<'a> BaseModel<'a> {
    /// Returns what the result's root is in the base.
    pub(super) fn root_cell(&self) -> Result<BaseCell<'a>> {
        match self.root.level {
            0 => self.model.root().map(BaseCell::Node),
            _ => Ok(BaseCell::Above),
        }
    }

    /// Returns what a child of a divided cell is in the base.
    pub(super) fn child_cell(
        &self,
        parent: &BaseCell<'a>,
        index: usize,
        child: &Cell,
    ) -> Result<BaseCell<'a>> {
        let BaseRoot { level, position } = self.root;
        match parent {
            BaseCell::Node(node) => self.model.child(node, index).map(BaseCell::Node),
            BaseCell::Outside => Ok(BaseCell::Outside),
            // (Cells above the root are at lower levels than it.)
            BaseCell::Above if position.map(|at| at >> (level - child.level)) != child.position => {
                Ok(BaseCell::Outside)
            }
            BaseCell::Above if child.level < level => Ok(BaseCell::Above),
            BaseCell::Above => self.model.root().map(BaseCell::Node),
        }
    }

    /// Returns the result's cell of a node.
    pub(super) fn cell_of(&self, node: &ModelNode<'_>, winding: i32) -> Cell {
        let BaseRoot { level, position } = self.root;
        let own = node.position();
        let position = [0, 1, 2].map(|axis| (position[axis] << node.level()) + own[axis]);
        Cell { level: level + node.level(), position, winding }
    }

    /// Returns whether a cell is divided like the base. Nodes below the result's maximum depth
    /// `depth` are joined.
    // Invariant: the result's octree is at most `depth` levels deep, or its cells would have no FD
    // codes. Nodes of the base are `root.level` levels deeper in the result than in the base.
    pub(super) fn is_divided(&self, cell: &Cell, base_cell: &BaseCell<'_>, depth: u8) -> bool {
        match base_cell {
            BaseCell::Above => true,
            BaseCell::Outside => false,
            BaseCell::Node(node) => node.state() == ModelNodeState::Inner && cell.level < depth,
        }
    }

    /// Moves a vertex of the base to the result's grid.
    pub(super) fn point(&self, point: [i32; 3]) -> [i32; 3] {
        let bits = self.model.grid().bits;
        [0, 1, 2].map(|axis| point[axis] + ((self.root.position[axis] << bits) as i32))
    }

    /// Collects a node's faces, those of all descendants if it is divided.
    pub(super) fn collect_faces(&self, node: &ModelNode<'_>, out: &mut Vec<u64>) -> Result<()> {
        if node.state() != ModelNodeState::Inner {
            out.extend(node.faces());
            return Ok(());
        }
        (0..8).try_for_each(|child| self.collect_faces(&self.model.child(node, child)?, out))
    }

    /// Returns whether the minimum corner of a cell is inside of the base.
    pub(super) fn is_inside(&self, base_cell: &BaseCell<'_>) -> Result<bool> {
        let BaseCell::Node(node) = base_cell else { return Ok(self.model.far_winding() != 0) };
        let mut node = node.clone();
        // (The first child has the same minimum corner.)
        while node.state() == ModelNodeState::Inner {
            node = self.model.child(&node, 0)?;
        }
        Ok(match node.state() {
            ModelNodeState::Leaf { inside, .. } => inside,
            state => state == ModelNodeState::Full,
        })
    }
}
