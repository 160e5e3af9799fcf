//! Parts of the boundaries of two bodies, by what is in front of them and behind them: N. A. Tyukachev's indices of sets and of boundaries.

use spinney_base::SetOperation;

/// Part of the boundaries of two bodies, and what a set operation makes of it.
///
/// Sets have indices from 0 to 3: what is in both bodies, in the first alone, in the second alone, in neither. The index of a boundary is the sum of those
/// of the sets on its sides. (Index 3 is that of two parts, where faces lie on each other: those that look the same way are between both and neither, those that look
/// at each other are between the first alone and the second alone.)
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct BoundaryPart {
    /// Name of the part, in words.
    pub name: &'static str,
    /// The sets behind it and in front of it, as its faces look; faces of both bodies look as those of the first.
    pub sets: [u8; 2],
    /// Whether the result has each of these sets.
    pub is_inside: [bool; 2],
}

impl BoundaryPart {
    /// The index of the boundary: 1 to 5.
    pub fn index(&self) -> u8 {
        self.sets[0] + self.sets[1]
    }

    /// Whether the result has these faces: it has one of the sets and not the other.
    pub fn is_taken(&self) -> bool {
        self.is_inside[0] != self.is_inside[1]
    }

    /// Whether the result has their backs: what was in front of them is inside.
    pub fn is_turned(&self) -> bool {
        self.is_taken() && self.is_inside[1]
    }
}

/// The six parts of the boundaries of two bodies, and what a set operation makes of them: see [`combine`](super::combine()).
///
/// ```
/// use spinney::SetOperation;
/// use spinney::raw::brep::boundary_parts;
///
/// // The difference: the first body's faces outside of the second one, and the backs of the second one's inside of the first.
/// let taken = boundary_parts(SetOperation::Difference).into_iter().filter(|part| part.is_taken());
/// let found: Vec<_> = taken.map(|part| (part.index(), part.is_turned(), part.name)).collect();
/// assert_eq!(found[0], (4, false, "A's faces outside of B"));
/// assert_eq!(found[1], (1, true, "B's faces inside of A"));
/// assert_eq!(found[2], (3, false, "faces of both that look at each other"));
/// ```
pub fn boundary_parts(operation: SetOperation) -> [BoundaryPart; 6] {
    let parts = [
        ("A's faces outside of B", [1, 3]),
        ("A's faces inside of B", [0, 2]),
        ("B's faces outside of A", [2, 3]),
        ("B's faces inside of A", [0, 1]),
        ("faces of both that look the same way", [0, 3]),
        ("faces of both that look at each other", [1, 2]),
    ];
    parts.map(|(name, sets)| BoundaryPart {
        name,
        sets,
        is_inside: sets.map(|set| operation.index() >> set & 1 == 1),
    })
}
