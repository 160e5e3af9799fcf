//! Nearest-neighbour search among points in memory.

use super::block_index::{Best, BlockIndex, IndexedPoint};

/// Points in memory, for nearest-neighbour queries in space; those of a file are queries of
/// [`PointTree`](crate::PointTree).
pub struct PointIndex {
    index: BlockIndex,
    corners: [[f64; 3]; 2],
}

impl PointIndex {
    /// Bytes of memory for each point.
    pub const BYTES: u64 = size_of::<IndexedPoint>() as u64;

    /// Builds the index of points with finite coordinates. Points after the first 2^32 are left
    /// out.
    pub fn new(positions: &[[f64; 3]]) -> PointIndex {
        let point =
            |(number, position): (u32, &[f64; 3])| IndexedPoint { position: *position, number, axis: 0 };
        let points = (0..=u32::MAX).zip(positions).map(point).collect();
        let mut corners = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for position in positions {
            for (axis, at) in position.iter().enumerate() {
                corners[0][axis] = corners[0][axis].min(*at);
                corners[1][axis] = corners[1][axis].max(*at);
            }
        }
        PointIndex { index: BlockIndex::new(points, 3), corners }
    }

    /// Returns squared distances and numbers of the nearest points, at most `most` of them and none
    /// farther than `within`, by distance and then by number.
    pub fn nearest(&self, from: [f64; 3], most: usize, within: f64) -> Vec<(f64, u32)> {
        if most == 0 {
            return Vec::new();
        }
        let mut best = Best::new(most, within * within, 3);
        let [low, high] = &self.corners;
        let square = |axis: usize| (low[axis] - from[axis]).max(from[axis] - high[axis]).max(0.0).powi(2);
        self.index.search(0, from, [0, 1, 2].map(square), &mut best);
        best.finish().into_iter().map(|found| (found.square, found.number.1)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_those_of_a_scan() {
        // (A congruential generator; coordinates repeat, so that there are ties.)
        let mut state = 7u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 59) as f64
        };
        let mut point = || [next(), next(), next() / 2.0];
        let points: Vec<[f64; 3]> = (0..500).map(|_| point()).collect();
        let index = PointIndex::new(&points);
        for most in [0, 1, 5, 600] {
            for within in [0.0, 3.0, f64::INFINITY] {
                for _ in 0..20 {
                    let from = point();
                    let square =
                        |to: &[f64; 3]| (0..3).map(|axis| (to[axis] - from[axis]).powi(2)).sum::<f64>();
                    let mut expected: Vec<(f64, u32)> = points.iter().map(square).zip(0..).collect();
                    expected.retain(|(square, _)| *square <= within * within);
                    expected.sort_by(|a, b| a.partial_cmp(b).unwrap());
                    expected.truncate(most);
                    assert_eq!(index.nearest(from, most, within), expected);
                }
            }
        }
        assert_eq!(PointIndex::new(&[]).nearest([0.0; 3], 3, f64::INFINITY), []);
    }
}
