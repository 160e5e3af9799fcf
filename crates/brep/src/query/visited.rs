//! Counts of nodes and faces that questions visit on their way down.

/// Numbers of nodes and faces that were looked at for an answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Visited {
    /// Nodes of the octree.
    pub nodes: u64,
    /// Faces, those several times that were forgotten between.
    pub faces: u64,
}

/// Memory of the faces that were looked at last: large faces cut many cells, and need not be looked at in each.
pub(super) struct Recent([u64; 64]);

impl Recent {
    pub(super) fn new() -> Recent {
        Recent([u64::MAX; 64])
    }

    /// Whether a face was looked at and not forgotten; it is known from now on.
    #[inline]
    pub(super) fn is_known(&mut self, number: u64) -> bool {
        let place = &mut self.0[number as usize % 64];
        std::mem::replace(place, number) == number
    }
}

/// The box of a child, of the box of a node.
#[inline]
pub(crate) fn half_of([min, max]: &[[i64; 3]; 2], child: usize) -> [[i64; 3]; 2] {
    let half = (max[0] - min[0]) / 2;
    let low = std::array::from_fn(|axis| min[axis] + half * (child >> axis & 1) as i64);
    [low, low.map(|at| at + half)]
}
