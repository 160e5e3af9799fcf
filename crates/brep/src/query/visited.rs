//! Counts of nodes and faces that queries visit.

/// Numbers of nodes and faces that a query visited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Visited {
    /// Nodes of the octree.
    pub nodes: u64,
    /// Faces; some count repeatedly, if they were evicted in between.
    pub faces: u64,
}

/// Recently visited faces: large faces cut many cells, and should not be tested in each.
pub(super) struct Recent([u64; 64]);

impl Recent {
    pub(super) fn new() -> Recent {
        Recent([u64::MAX; 64])
    }

    /// Returns whether a face was visited recently, and records it.
    #[inline]
    pub(super) fn is_known(&mut self, number: u64) -> bool {
        let place = &mut self.0[number as usize % 64];
        std::mem::replace(place, number) == number
    }
}

/// Returns the box of a child, given the box of a node.
#[inline]
pub(crate) fn half_of([min, max]: &[[i64; 3]; 2], child: usize) -> [[i64; 3]; 2] {
    let half = (max[0] - min[0]) / 2;
    let low = std::array::from_fn(|axis| min[axis] + half * (child >> axis & 1) as i64);
    [low, low.map(|at| at + half)]
}
