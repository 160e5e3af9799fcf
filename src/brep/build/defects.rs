//! Defects of surfaces that bound no body: where, and of which faces.

/// Places that are kept.
pub(super) const MOST: usize = 100;

/// A place where a surface is no boundary of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Defect {
    /// Kind of the defect.
    pub kind: DefectKind,
    /// A point of the place, in the world.
    pub place: [f64; 3],
    /// Numbers of the faces of the model that are part of it, from 0 in the order of reading.
    pub faces: Vec<u64>,
}

/// Kinds of defects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DefectKind {
    /// Two faces pass through each other.
    Crossing,
    /// Two faces lie on each other, turned the same way.
    Overlap,
    /// The surface goes around this place so many times, where 0 or 1 is right: bodies overlap, or are inside out.
    Winding(i32),
    /// A chain of edges, of so many corners, that have a face on one side only.
    Boundary(usize),
}

/// The first defects of a part of space.
#[derive(Default)]
pub(super) struct Defects {
    /// Place in half units of the grid, and source numbers of faces to come.
    pub(super) list: Vec<Found>,
    pub(super) count: u64,
}

/// A defect on the grid.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Found {
    pub(super) kind: DefectKind,
    /// A point, in grid units.
    pub(super) at: [f64; 3],
    pub(super) faces: Vec<u32>,
}

impl Defects {
    pub(super) fn push(&mut self, found: Found) {
        // (A pair of faces is looked at in every cell that both cut.)
        if self
            .list
            .iter()
            .any(|known| known.kind == found.kind && known.faces == found.faces && !found.faces.is_empty())
        {
            return;
        }
        self.count += 1;
        if self.list.len() < MOST {
            self.list.push(found);
        }
    }

    pub(super) fn append(&mut self, other: Defects) {
        let beyond = other.count - other.list.len() as u64;
        other.list.into_iter().for_each(|found| self.push(found));
        self.count += beyond;
    }
}
