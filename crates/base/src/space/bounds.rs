//! Boxes of cells in up to three dimensions.

use super::dimension::Dimension;

/// A half-open box of nodes at one level: `min .. max` along each axis. An axis that the tree lacks
/// has `0 .. 1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Bounds {
    /// First node along each axis.
    pub min: [u64; 3],
    /// End along each axis: one past the last node.
    pub max: [u64; 3],
}

impl Bounds {
    /// Returns the box of all nodes at a level.
    #[inline]
    pub fn space(dimension: Dimension, level: u8) -> Bounds {
        let side = 1u64 << level;
        Bounds { min: [0; 3], max: [side, side, if dimension == Dimension::Oct { side } else { 1 }] }
    }

    /// Returns the box of all cells of a raster with this extent.
    #[inline]
    pub fn of_extent(extent: [u64; 3]) -> Bounds {
        Bounds { min: [0; 3], max: extent }
    }

    /// Returns the bounds of a node's `child`-th child, if this box is the node's.
    #[inline]
    pub fn child(&self, dimension: Dimension, child: usize) -> Bounds {
        let mut bounds = *self;
        for axis in 0..dimension.axes() {
            let middle = self.min[axis].midpoint(self.max[axis]);
            if child >> axis & 1 == 0 {
                bounds.max[axis] = middle;
            } else {
                bounds.min[axis] = middle;
            }
        }
        bounds
    }

    /// Returns the number of nodes along each axis.
    #[inline]
    pub fn size(&self) -> [u64; 3] {
        std::array::from_fn(|axis| self.max[axis].saturating_sub(self.min[axis]))
    }

    /// Returns the number of nodes, `u64::MAX` if there are more.
    #[inline]
    pub fn volume(&self) -> u64 {
        self.size().into_iter().fold(1, u64::saturating_mul)
    }

    /// Whether the box contains no nodes.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.size().contains(&0)
    }

    /// Returns the intersection of both boxes; empty if they are disjoint.
    #[inline]
    pub fn intersect(&self, other: &Bounds) -> Bounds {
        let min: [u64; 3] = std::array::from_fn(|axis| self.min[axis].max(other.min[axis]));
        Bounds { min, max: std::array::from_fn(|axis| self.max[axis].min(other.max[axis]).max(min[axis])) }
    }

    /// Returns the smallest box that contains this one and another.
    pub fn hull(&self, other: &Bounds) -> Bounds {
        Bounds {
            min: std::array::from_fn(|axis| self.min[axis].min(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].max(other.max[axis])),
        }
    }

    /// Returns this box relative to the `min` of a box that contains it.
    #[inline]
    pub fn within(&self, other: &Bounds) -> Bounds {
        let from = |at: [u64; 3]| std::array::from_fn(|axis| at[axis].saturating_sub(other.min[axis]));
        Bounds { min: from(self.min), max: from(self.max) }
    }

    /// Whether `other` lies within this box.
    #[inline]
    pub fn contains(&self, other: &Bounds) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.min[axis] && other.max[axis] <= self.max[axis])
    }
}
