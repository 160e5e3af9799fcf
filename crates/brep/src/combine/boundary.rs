//! Classes of the boundaries of two bodies, by the sets on both sides: N. A. Tyukachev's indices of
//! sets and boundaries.

use spinney_base::SetOperation;

/// A class of the boundaries of two bodies, and its use in a set operation.
///
/// Sets have indices from 0 to 3: in both bodies, in the first only, in the second only, in
/// neither. The index of a boundary is the sum of the indices of the sets on its two sides. (Two
/// classes have index 3, where faces of both bodies coincide. Faces with equal orientation separate
/// both from neither; faces with opposite orientation separate the first only from the second
/// only.)
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct BoundaryClass {
    /// Name of the class, in words.
    pub name: &'static str,
    /// Sets at the back and in front of the faces. Faces of both bodies are oriented as those of
    /// the first.
    pub sets: [u8; 2],
    /// Whether each of these sets is in the result.
    pub is_inside: [bool; 2],
}

impl BoundaryClass {
    /// Returns the index of the boundary: 1 to 5.
    pub fn index(&self) -> u8 {
        self.sets[0] + self.sets[1]
    }

    /// Whether the faces are in the result: exactly one of the two sets is.
    pub fn is_taken(&self) -> bool {
        self.is_inside[0] != self.is_inside[1]
    }

    /// Whether the faces are reversed in the result: the set in front of them is inside.
    pub fn is_turned(&self) -> bool {
        self.is_taken() && self.is_inside[1]
    }
}

/// Returns the six classes of the boundaries of two bodies, with their use in a set operation: see
/// [`combine`](super::combine()).
///
/// ```
/// use spinney::SetOperation;
/// use spinney::raw::brep::boundary_classes;
///
/// // The difference: faces of the first body outside of the second, and reversed faces of the
/// // second inside of the first.
/// let taken = boundary_classes(SetOperation::Difference).into_iter().filter(|class| class.is_taken());
/// let found: Vec<_> = taken.map(|class| (class.index(), class.is_turned(), class.name)).collect();
/// assert_eq!(found[0], (4, false, "A's faces outside of B"));
/// assert_eq!(found[1], (1, true, "B's faces inside of A"));
/// assert_eq!(found[2], (3, false, "faces of both, opposite orientation"));
/// ```
pub fn boundary_classes(operation: SetOperation) -> [BoundaryClass; 6] {
    let classes = [
        ("A's faces outside of B", [1, 3]),
        ("A's faces inside of B", [0, 2]),
        ("B's faces outside of A", [2, 3]),
        ("B's faces inside of A", [0, 1]),
        ("faces of both, same orientation", [0, 3]),
        ("faces of both, opposite orientation", [1, 2]),
    ];
    classes.map(|(name, sets)| BoundaryClass {
        name,
        sets,
        is_inside: sets.map(|set| operation.index() >> set & 1 == 1),
    })
}
