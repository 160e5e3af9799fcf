//! Sums over the parts of faces that lie in a cell: see [`coverage`](super::coverage).

use spinney_brep::geometry::clipped::{ClippedPolygon, Point};

/// Sums over the faces in a cell that bound the inside.
#[derive(Clone, Copy, Default)]
pub(super) struct FaceSums {
    pub(super) cell: u32,
    /// Whether a face cuts the cell, and not only lies in its wall.
    pub(super) is_cut: bool,
    /// Whether a face lies in its wall.
    pub(super) in_wall: bool,
    /// Whether the sums are those of the faces that bound the inside, and not of all.
    pub(super) is_settled: bool,
    /// The area seen along each axis: `a` above.
    pub(super) area: [f64; 3],
    /// The volume behind it along each axis: `b` above.
    pub(super) behind: [f64; 3],
    /// The share that is inside, once it is known: `c` above.
    pub(super) share: Option<f64>,
}

impl FaceSums {
    /// Adds a face of which the cell has this part; `weight` is what inside changes by where the winding number goes up
    /// by one.
    #[inline]
    pub(super) fn add(&mut self, polygon: &ClippedPolygon, cell: [usize; 3], weight: f64) {
        let Some((first, others)) = polygon.points().split_first() else { return };
        for pair in others.windows(2) {
            let [u, v]: [Point; 2] = [0, 1].map(|i| std::array::from_fn(|axis| pair[i][axis] - first[axis]));
            for axis in 0..3 {
                let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
                // Behind a face that is seen from the front the winding number is one less.
                let area = weight * (u[last] * v[next] - u[next] * v[last]) / 2.0;
                // Depth is linear over a triangle: its mean is that of the corners.
                let mean = (first[axis] + pair[0][axis] + pair[1][axis]) / 3.0;
                self.area[axis] += area;
                self.behind[axis] += area * ((cell[axis] + 1) as f64 - mean);
            }
        }
    }
}
