//! Whether dividing cells parts their faces: where it does not, cells are leaves of many faces.

use super::LEAF_SIZE;

/// How many times faces have come to be listed since their number was last halved, while cells were divided.
///
/// Faces of a bundle of long thin ones, or of ones that pass through each other everywhere, are in all children of a cell
/// again; the octree would take space that goes with a power of its depth.
#[derive(Clone, Copy)]
pub(super) struct Spread {
    /// Faces of the cell where counting began.
    faces: u64,
    times: f64,
    /// Cells with at most so many are divided in any case.
    few: u64,
}

/// Times that faces may come to be listed, until their number must have been halved.
const MAX_TIMES: f64 = 8.0;

/// Faces of a cell that is divided in any case where cells are divided until their planes have a point in common, as in the literature.
const FEW: usize = 48;

impl Spread {
    /// That of a cell with so many faces, around which nothing was divided, in a tree whose leaves may have so many without more ado.
    pub(super) fn new(faces: u64, leaf_size: usize) -> Spread {
        let few = if leaf_size == 0 { FEW } else { leaf_size.max(LEAF_SIZE) };
        Spread { faces, times: 1.0, few: few as u64 }
    }

    /// That behind a division of a cell with so many faces, where its children have these; `None` if it parts nothing, and the cell
    /// is better left as it is.
    // Invariant: a function of the tree above the cell alone. Files are the same whatever memory there is, and so wherever
    // the division in memory begins.
    pub(super) fn divided(self, faces: u64, children: [u64; 8]) -> Option<Spread> {
        let listed: u64 = children.iter().sum();
        let times = self.times * listed as f64 / faces as f64;
        let with_all = children.iter().filter(|count| **count == faces).count();
        let is_useless = with_all > 1 && listed == with_all as u64 * faces;
        let is_too_much = is_useless || times > MAX_TIMES;
        (!is_too_much || faces <= self.few).then_some(Spread { times, ..self })
    }

    /// That of a child with so many faces.
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
        // (A single child has a part of space for itself.)
        assert!(all.divided(100, [100, 0, 0, 0, 0, 0, 0, 0]).is_some());
        assert!(all.divided(12, [12; 8]).is_some() && all.divided(13, [13; 8]).is_none());
        assert!(Spread::new(100, 0).divided(48, [48; 8]).is_some());
        // Twice as many with each division, of which none has less than half of the faces: the fourth is too much.
        let mut spread = all;
        for _ in 0..3 {
            spread = spread.divided(100, [50, 50, 50, 50, 0, 0, 0, 0]).unwrap().of_child(51);
        }
        assert!(spread.divided(100, [50, 50, 50, 50, 0, 0, 0, 0]).is_none());
        assert!(spread.of_child(50).divided(50, [25, 25, 25, 25, 0, 0, 0, 0]).is_some());
    }
}
