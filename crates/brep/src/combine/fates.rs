//! Fates of a body's faces, three bits each.

use super::table::Fate;
use crate::face_set::FaceSet;

/// Fates of a body's faces, by number: of the faces of its octree, or of its exact faces.
pub(super) struct Fates {
    near: FaceSet,
    turned: FaceSet,
    dropped: FaceSet,
}

impl Fates {
    /// Creates the fates of `count` faces, all kept.
    pub(super) fn new(count: u64) -> Fates {
        Fates { near: FaceSet::new(count), turned: FaceSet::new(count), dropped: FaceSet::new(count) }
    }

    /// Returns the fate of a face; `None` if it is near other bodies, and the arrangement decides.
    pub(super) fn of(&self, number: u64) -> Option<Fate> {
        // Invariant: all cells of a face that are far from other bodies record the same fate, since
        // the face connects them without meeting another body. A face with a near cell is in
        // `near`, which is checked first. So the order in which cells are traversed does not
        // matter.
        match (self.near.has(number), self.turned.has(number), self.dropped.has(number)) {
            (true, ..) => None,
            (_, _, true) => Some(Fate::Drop),
            (_, true, _) => Some(Fate::Reverse),
            _ => Some(Fate::Keep),
        }
    }

    /// Marks a face as near other bodies.
    pub(super) fn set_near(&mut self, number: u64) {
        self.near.set(number, true);
    }

    /// Records the fate of a face. A face that is near stays so.
    pub(super) fn note(&mut self, number: u64, fate: Fate) {
        match fate {
            Fate::Keep => {}
            Fate::Reverse => self.turned.set(number, true),
            Fate::Drop => self.dropped.set(number, true),
        }
    }

    /// Unmarks a face as near. It has the fate that was recorded for it, or is kept.
    pub(super) fn unset_near(&mut self, number: u64) {
        self.near.set(number, false);
    }

    /// Records the fate of a face, and unmarks it as near.
    pub(super) fn settle(&mut self, number: u64, fate: Fate) {
        self.unset_near(number);
        self.note(number, fate);
    }

    /// Whether any face that is not near is reversed.
    pub(super) fn are_some_turned(&self) -> bool {
        self.turned.numbers().any(|face| !self.near.has(face.into()))
    }

    /// Yields the numbers of the faces near other bodies, ascending.
    pub(super) fn near(&self) -> impl Iterator<Item = u32> {
        self.near.numbers()
    }
}
