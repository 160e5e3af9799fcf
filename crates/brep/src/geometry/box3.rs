//! Axis-aligned boxes on the integer grid: octants and bounds of faces.

/// An axis-aligned box. Units are those of the grid that vertices are snapped to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Box3 {
    /// Minimum coordinates.
    pub min: [i64; 3],
    /// Maximum coordinates.
    pub max: [i64; 3],
}

impl Box3 {
    /// Returns the bounding box of points, or `None` if there are no points.
    pub fn around(points: &[[i64; 3]]) -> Option<Box3> {
        let (&first, rest) = points.split_first()?;
        Some(rest.iter().fold(Box3 { min: first, max: first }, |all, point| Box3 {
            min: [0, 1, 2].map(|axis| all.min[axis].min(point[axis])),
            max: [0, 1, 2].map(|axis| all.max[axis].max(point[axis])),
        }))
    }

    /// Returns whether the interior of this box shares a point with the closed box `other`.
    #[inline]
    pub(crate) fn inside_meets(&self, other: &Box3) -> bool {
        (0..3).all(|axis| other.min[axis] < self.max[axis] && other.max[axis] > self.min[axis])
    }

    /// Returns whether a point is in the interior.
    #[inline]
    pub(crate) fn has_inside(&self, point: &[i64; 3]) -> bool {
        (0..3).all(|axis| self.min[axis] < point[axis] && point[axis] < self.max[axis])
    }

    /// Returns whether a point is inside or on a wall.
    #[inline]
    pub fn contains(&self, point: &[i64; 3]) -> bool {
        (0..3).all(|axis| self.min[axis] <= point[axis] && point[axis] <= self.max[axis])
    }
}
