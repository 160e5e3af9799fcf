//! Boxes of the integer grid: octants and bounds of faces.

/// A box with its sides along the axes, from the least to the greatest coordinates. Units are those of the
/// grid that vertices are snapped to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Box3 {
    /// Least coordinates.
    pub min: [i64; 3],
    /// Greatest coordinates.
    pub max: [i64; 3],
}

impl Box3 {
    /// The least box around points, walls included; `None` without any.
    pub fn around(points: &[[i64; 3]]) -> Option<Box3> {
        let (&first, rest) = points.split_first()?;
        Some(rest.iter().fold(Box3 { min: first, max: first }, |all, point| Box3 {
            min: [0, 1, 2].map(|axis| all.min[axis].min(point[axis])),
            max: [0, 1, 2].map(|axis| all.max[axis].max(point[axis])),
        }))
    }

    /// Whether the inside of this box, without its walls, has a point in common with `other`, walls included.
    #[inline]
    pub(crate) fn inside_meets(&self, other: &Box3) -> bool {
        (0..3).all(|axis| other.min[axis] < self.max[axis] && other.max[axis] > self.min[axis])
    }

    /// Whether a point lies inside, not on a wall.
    #[inline]
    pub(crate) fn has_inside(&self, point: &[i64; 3]) -> bool {
        (0..3).all(|axis| self.min[axis] < point[axis] && point[axis] < self.max[axis])
    }

    /// Whether a point lies inside or on a wall.
    #[inline]
    pub fn contains(&self, point: &[i64; 3]) -> bool {
        (0..3).all(|axis| self.min[axis] <= point[axis] && point[axis] <= self.max[axis])
    }
}
