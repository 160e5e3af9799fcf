//! Boxes of cells in up to three dimensions.

use super::dimension::Dimension;

/// A half-open box of nodes of one level: `min .. max` along each axis; `0 .. 1` along an axis that the tree
/// does not have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Bounds {
    /// First node along each axis.
    pub min: [u64; 3],
    /// One past the last.
    pub max: [u64; 3],
}

impl Bounds {
    /// All cells of a level.
    #[inline]
    pub fn space(dimension: Dimension, level: u8) -> Bounds {
        let side = 1u64 << level;
        Bounds { min: [0; 3], max: [side, side, if dimension == Dimension::Oct { side } else { 1 }] }
    }

    /// All cells of a picture of this size.
    #[inline]
    pub fn picture(extent: [u64; 3]) -> Bounds {
        Bounds { min: [0; 3], max: extent }
    }

    /// The part of a node's cells that its `child`-th child has.
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

    /// Nodes along each axis.
    #[inline]
    pub fn size(&self) -> [u64; 3] {
        std::array::from_fn(|axis| self.max[axis].saturating_sub(self.min[axis]))
    }

    /// Number of nodes.
    #[inline]
    pub fn volume(&self) -> u64 {
        self.size().into_iter().fold(1, u64::saturating_mul)
    }

    /// Whether there are none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.size().contains(&0)
    }

    /// The intersection of both boxes; empty if they do not meet.
    #[inline]
    pub fn intersect(&self, other: &Bounds) -> Bounds {
        let min: [u64; 3] = std::array::from_fn(|axis| self.min[axis].max(other.min[axis]));
        Bounds { min, max: std::array::from_fn(|axis| self.max[axis].min(other.max[axis]).max(min[axis])) }
    }

    /// The smallest box around this one and another.
    pub fn hull(&self, other: &Bounds) -> Bounds {
        Bounds {
            min: std::array::from_fn(|axis| self.min[axis].min(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].max(other.max[axis])),
        }
    }

    /// The box, counted from the first cell of another that it is in.
    #[inline]
    pub fn within(&self, other: &Bounds) -> Bounds {
        let from = |at: [u64; 3]| std::array::from_fn(|axis| at[axis].saturating_sub(other.min[axis]));
        Bounds { min: from(self.min), max: from(self.max) }
    }

    /// Whether all of `other` is inside.
    #[inline]
    pub fn contains(&self, other: &Bounds) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.min[axis] && other.max[axis] <= self.max[axis])
    }
}
