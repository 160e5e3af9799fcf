//! Smoothing of heights.

use crate::tin::Tin;

impl Tin {
    /// Smooths the heights `times` times (Laplacian smoothing, Field 1988, of heights only): each
    /// height moves half of the way to the mean of its neighbours' heights. Horizontal positions
    /// and triangles do not change. Vertices on breaklines and at the boundary keep their heights,
    /// so that faults stay sharp and adjacent volumes match. No height leaves the original range.
    #[must_use]
    pub fn smoothed(&self, times: u32) -> Tin {
        let mut is_pinned = vec![false; self.heights.len()];
        self.mesh.constraints.iter().flatten().for_each(|end| is_pinned[*end as usize] = true);
        self.mesh.boundary().iter().flatten().for_each(|end| is_pinned[*end as usize] = true);
        let mut heights = self.heights.clone();
        for _ in 0..times {
            let mut sums = vec![(0.0, 0u32); heights.len()];
            // (Around an interior vertex, each edge from it is the directed edge of exactly one
            // triangle, so each neighbour counts once.)
            for [a, b, c] in &self.mesh.triangles {
                for [from, to] in [[a, b], [b, c], [c, a]] {
                    sums[*from as usize].0 += heights[*to as usize];
                    sums[*from as usize].1 += 1;
                }
            }
            for ((height, (sum, count)), is_pinned) in heights.iter_mut().zip(sums).zip(&is_pinned) {
                if !is_pinned && count > 0 {
                    *height += (sum / f64::from(count) - *height) / 2.0;
                }
            }
        }
        Tin { mesh: self.mesh.clone(), heights }
    }
}
