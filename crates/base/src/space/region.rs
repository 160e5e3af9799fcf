//! Boxes of cells.

use serde::{Deserialize, Serialize};

/// A half-open box of cells on a plane: columns `x .. x + width`, rows `y .. y + height`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// First column.
    pub x: u64,
    /// First row.
    pub y: u64,
    /// Number of columns.
    pub width: u64,
    /// Number of rows.
    pub height: u64,
}

impl Region {
    /// The region with its corner at (`x`, `y`).
    pub fn new(x: u64, y: u64, width: u64, height: u64) -> Region {
        Region { x, y, width, height }
    }

    /// One past the last column.
    pub fn right(&self) -> u64 {
        self.x.saturating_add(self.width)
    }

    /// One past the last row.
    pub fn bottom(&self) -> u64 {
        self.y.saturating_add(self.height)
    }

    /// Number of cells.
    pub fn area(&self) -> u64 {
        self.width.saturating_mul(self.height)
    }

    /// No cells at all.
    pub fn is_empty(&self) -> bool {
        self.width == 0 || self.height == 0
    }

    /// The cells in both regions.
    pub fn intersect(&self, other: &Region) -> Region {
        let (x, y) = (self.x.max(other.x), self.y.max(other.y));
        let right = self.right().min(other.right()).max(x);
        let bottom = self.bottom().min(other.bottom()).max(y);
        Region { x, y, width: right - x, height: bottom - y }
    }

    /// Whether all of `other` lies inside.
    pub fn contains(&self, other: &Region) -> bool {
        self.x <= other.x
            && self.y <= other.y
            && other.right() <= self.right()
            && other.bottom() <= self.bottom()
    }
}
