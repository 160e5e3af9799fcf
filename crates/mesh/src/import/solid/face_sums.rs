//! Sums over the face fragments in a cell: see [`coverage`](super::coverage).

use spinney_brep::geometry::clipped::{ClippedPolygon, Point};

/// Sums over the faces in a cell that bound the inside.
#[derive(Clone, Copy, Default)]
pub(super) struct FaceSums {
    pub(super) cell: u32,
    /// Whether a face cuts the cell, rather than only lying in its wall.
    pub(super) is_cut: bool,
    /// Whether a face lies in its wall.
    pub(super) in_wall: bool,
    /// Whether the sums are those of the bounding faces only, rather than of all faces.
    pub(super) is_settled: bool,
    /// Projected area along each axis: `a` in the module documentation.
    pub(super) area: [f64; 3],
    /// Volume between the faces and the cell's end along each axis: `b` in the module
    /// documentation.
    pub(super) volume_after: [f64; 3],
    /// Fraction that is inside, once it is known: `c` in the module documentation.
    pub(super) share: Option<f64>,
}

impl FaceSums {
    /// Adds a face fragment in the cell. `weight` is the change of inside where the winding number
    /// increases by one.
    #[inline]
    pub(super) fn add(&mut self, polygon: &ClippedPolygon, cell: [usize; 3], weight: f64) {
        let Some((first, others)) = polygon.points().split_first() else { return };
        for pair in others.windows(2) {
            let [u, v]: [Point; 2] = [0, 1].map(|i| std::array::from_fn(|axis| pair[i][axis] - first[axis]));
            for axis in 0..3 {
                let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
                // Going up the axis through a face with its normal up the axis decreases the
                // winding number by one.
                let area = weight * (u[last] * v[next] - u[next] * v[last]) / 2.0;
                // Depth is linear over a triangle: its mean is the mean of its vertices.
                let mean = (first[axis] + pair[0][axis] + pair[1][axis]) / 3.0;
                self.area[axis] += area;
                self.volume_after[axis] += area * ((cell[axis] + 1) as f64 - mean);
            }
        }
    }
}
