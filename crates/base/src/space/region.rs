//! Boxes of cells in a plane.

use serde::{Deserialize, Serialize};

/// A half-open box of cells in a plane: columns `x .. x + width`, rows `y .. y + height`.
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
    /// Creates the region with its first cell at (`x`, `y`).
    pub fn new(x: u64, y: u64, width: u64, height: u64) -> Region {
        Region { x, y, width, height }
    }

    /// Returns the end of the columns: one past the last.
    pub fn right(&self) -> u64 {
        self.x.saturating_add(self.width)
    }

    /// Returns the end of the rows: one past the last.
    pub fn bottom(&self) -> u64 {
        self.y.saturating_add(self.height)
    }

    /// Returns the number of cells, `u64::MAX` if there are more.
    pub fn area(&self) -> u64 {
        self.width.saturating_mul(self.height)
    }

    /// Whether the region contains no cells.
    pub fn is_empty(&self) -> bool {
        self.width == 0 || self.height == 0
    }

    /// Returns the cells in both regions.
    pub fn intersect(&self, other: &Region) -> Region {
        let (x, y) = (self.x.max(other.x), self.y.max(other.y));
        let right = self.right().min(other.right()).max(x);
        let bottom = self.bottom().min(other.bottom()).max(y);
        Region { x, y, width: right - x, height: bottom - y }
    }

    /// Whether `other` lies within this region.
    pub fn contains(&self, other: &Region) -> bool {
        self.x <= other.x
            && self.y <= other.y
            && other.right() <= self.right()
            && other.bottom() <= self.bottom()
    }
}
