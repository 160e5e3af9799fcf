//! Limits the division of cells: cells whose faces cannot be separated become leaves of many faces.

use super::LEAF_SIZE;

/// The factor by which the listed faces have multiplied by division since the face count was last
/// halved.
///
/// Bundles of long thin faces, or faces that intersect everywhere, are in all children of a cell
/// again; the octree's size would grow with a power of its depth.
#[derive(Clone, Copy)]
pub(super) struct Spread {
    /// Faces of the cell where counting began.
    faces: u64,
    times: f64,
    /// Cells with at most this many faces are divided in any case.
    few: u64,
}

/// Maximum factor until the face count must have been halved.
const MAX_TIMES: f64 = 8.0;

/// Face count up to which a cell is always divided, if `leaf_size` is 0: cells are then divided
/// until their planes share a point, as in the literature.
const FEW: usize = 48;

impl Spread {
    /// Starts counting at an undivided cell, for a tree with this leaf size.
    pub(super) fn new(faces: u64, leaf_size: usize) -> Spread {
        let few = if leaf_size == 0 { FEW } else { leaf_size.max(LEAF_SIZE) };
        Spread { faces, times: 1.0, few: few as u64 }
    }

    /// Returns the state after a division, given the face counts of a cell and its children.
    /// Returns `None` if the division separates nothing, and the cell should be a leaf.
    // Invariant: a function of the tree above the cell alone. So files do not depend on the
    // available memory, which decides where the division in memory begins.
    pub(super) fn divided(self, faces: u64, children: [u64; 8]) -> Option<Spread> {
        let listed: u64 = children.iter().sum();
        let times = self.times * listed as f64 / faces as f64;
        let with_all = children.iter().filter(|count| **count == faces).count();
        let is_useless = with_all > 1 && listed == with_all as u64 * faces;
        let is_too_much = is_useless || times > MAX_TIMES;
        (!is_too_much || faces <= self.few).then_some(Spread { times, ..self })
    }

    /// Returns the state of a child with this face count.
    pub(super) fn of_child(self, faces: u64) -> Spread {
        if 2 * faces <= self.faces { Spread { faces, times: 1.0, ..self } } else { self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bundles_are_not_divided() {
        let all = Spread::new(100, 12);
        assert!(all.divided(100, [100, 0, 0, 100, 0, 0, 0, 0]).is_none());
        // (A single child leaves out empty space.)
        assert!(all.divided(100, [100, 0, 0, 0, 0, 0, 0, 0]).is_some());
        assert!(all.divided(12, [12; 8]).is_some() && all.divided(13, [13; 8]).is_none());
        assert!(Spread::new(100, 0).divided(48, [48; 8]).is_some());
        // The lists double with each division, and no child has less than half of the faces: the
        // fourth division is too much.
        let mut spread = all;
        for _ in 0..3 {
            spread = spread.divided(100, [50, 50, 50, 50, 0, 0, 0, 0]).unwrap().of_child(51);
        }
        assert!(spread.divided(100, [50, 50, 50, 50, 0, 0, 0, 0]).is_none());
        assert!(spread.of_child(50).divided(50, [25, 25, 25, 25, 0, 0, 0, 0]).is_some());
    }
}
