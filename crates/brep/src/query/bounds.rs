//! Bounding box of a model's surface: stored, or found by the octree.

use super::visited::{Recent, half_of};
use crate::{ExactModel, FaceBuffer, Faces, ModelNode, ModelNodeState};
use spinney_base::Result;

impl ExactModel {
    /// Returns the exact minimum and maximum world coordinates of the surface: those of the stored
    /// sums. In files without sums, reads cells of the octree that may extend beyond the box found
    /// so far.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn bounds(&self) -> Result<[[f64; 3]; 2]> {
        // (The tree of a corrupt file may have no faces.)
        Ok(self.grid_bounds()?.unwrap_or([[0; 3]; 2]).map(|corner| self.grid().to_world(corner)))
    }

    /// Returns the minimum and maximum grid coordinates of the surface; `None` without faces.
    pub(crate) fn grid_bounds(&self) -> Result<Option<[[i32; 3]; 2]>> {
        match self.stored_sums()? {
            Some(sums) => Ok(sums.mass.bounds),
            None => self.bounds_of_octree(),
        }
    }

    fn bounds_of_octree(&self) -> Result<Option<[[i32; 3]; 2]>> {
        let nothing = [[i32::MAX; 3], [i32::MIN; 3]];
        let mut traversal = BoundsTraversal {
            model: self,
            found: nothing,
            recent: Recent::new(),
            buffer: FaceBuffer::default(),
        };
        traversal.node(&self.root()?)?;
        Ok((traversal.found != nothing).then_some(traversal.found))
    }
}

struct BoundsTraversal<'a> {
    model: &'a ExactModel,
    found: [[i32; 3]; 2],
    recent: Recent,
    buffer: FaceBuffer,
}

impl BoundsTraversal<'_> {
    fn node(&mut self, node: &ModelNode<'_>) -> Result<()> {
        if node.state() == ModelNodeState::Inner {
            let bounds = node.bounds(self.model.grid());
            for child in 0..8 {
                // (Tested before the child is looked up, which takes longer.)
                if self.is_wanted(half_of(&bounds, child)) {
                    self.node(&self.model.child(node, child)?)?;
                }
            }
        }
        for number in node.faces() {
            if self.recent.is_known(number) {
                continue;
            }
            self.model.face(number, &mut self.buffer)?;
            for point in self.buffer.face().points {
                let [low, high] = &mut self.found;
                for (axis, at) in point.iter().enumerate() {
                    low[axis] = low[axis].min(*at);
                    high[axis] = high[axis].max(*at);
                }
            }
        }
        Ok(())
    }

    /// Returns whether a cell extends beyond the box found so far.
    fn is_wanted(&self, [low, high]: [[i64; 3]; 2]) -> bool {
        let [min, max] = self.found.map(|corner| corner.map(|at| 2 * i64::from(at)));
        // Walls are half a unit outside of a cell's points.
        (0..3).any(|axis| low[axis] + 1 < min[axis] || max[axis] < high[axis] - 1)
    }
}
