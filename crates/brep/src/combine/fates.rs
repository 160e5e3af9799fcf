//! Fates of the faces of a body, three bits for each.

use super::table::Fate;
use crate::face_set::FaceSet;

/// Fates of some faces of a body, by their numbers: of those of its octree, or of those with corners beside the grid.
pub(super) struct Fates {
    near: FaceSet,
    turned: FaceSet,
    dropped: FaceSet,
}

impl Fates {
    /// So many faces that are all kept.
    pub(super) fn new(count: u64) -> Fates {
        Fates { near: FaceSet::new(count), turned: FaceSet::new(count), dropped: FaceSet::new(count) }
    }

    /// The fate of a face; `None` of one that is near other bodies, which the arrangement tells.
    pub(super) fn of(&self, number: u64) -> Option<Fate> {
        // Invariant: all cells of a face that are far from other bodies have noted the same fate, since the
        // face leads from one to the other without meeting any; and a face with a cell that is near is in
        // `near`, which is looked at before. So the order in which cells are gone through does not matter.
        match (self.near.has(number), self.turned.has(number), self.dropped.has(number)) {
            (true, ..) => None,
            (_, _, true) => Some(Fate::Dropped),
            (_, true, _) => Some(Fate::Turned),
            _ => Some(Fate::Kept),
        }
    }

    /// Notes that a face is near other bodies.
    pub(super) fn set_near(&mut self, number: u64) {
        self.near.set(number, true);
    }

    /// Notes the fate of a face, unless it is near.
    pub(super) fn note(&mut self, number: u64, fate: Fate) {
        match fate {
            Fate::Kept => {}
            Fate::Turned => self.turned.set(number, true),
            Fate::Dropped => self.dropped.set(number, true),
        }
    }

    /// Notes the fate of a face that is not near after all.
    pub(super) fn settle(&mut self, number: u64, fate: Fate) {
        self.near.set(number, false);
        self.note(number, fate);
    }

    /// Whether the fate of any face that is not near is to be turned.
    pub(super) fn are_some_turned(&self) -> bool {
        self.turned.numbers().any(|face| !self.near.has(face.into()))
    }

    /// Numbers of the faces that are near other bodies, ascending.
    pub(super) fn near(&self) -> impl Iterator<Item = u32> {
        self.near.numbers()
    }
}
