//! The sixteen set operations on two sets, shared by trees of cells, exact models and polygons.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::{Error, Result};

/// One of the sixteen Boolean operations on two sets A and B.
///
/// ```
/// use spinney::SetOperation;
///
/// let difference: SetOperation = "a-b".parse()?;
/// assert_eq!(difference, SetOperation::Difference);
/// assert!(difference.contains(true, false) && !difference.contains(true, true));
/// assert_eq!((difference.index(), difference.to_string()), (2, "a-b".into()));
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum SetOperation {
    /// The empty set.
    Empty,
    /// A and B.
    Intersection,
    /// A without B.
    Difference,
    /// A, whatever B is.
    First,
    /// B without A.
    ReverseDifference,
    /// B, whatever A is.
    Second,
    /// Elements of exactly one of the two.
    SymmetricDifference,
    /// A or B.
    Union,
    /// The complement of the union.
    Neither,
    /// The complement of the symmetric difference: both or neither.
    Equivalence,
    /// The complement of B.
    NotSecond,
    /// A, and the complement of B.
    FirstOrNotSecond,
    /// The complement of A.
    Complement,
    /// B, and the complement of A.
    SecondOrNotFirst,
    /// The complement of the intersection.
    NotBoth,
    /// Everything.
    Everything,
}

/// Names on the command line, by index. The first name is the one that is printed.
const NAMES: [&[&str]; 16] = [
    &["none"],
    &["intersection", "and"],
    &["a-b", "difference"],
    &["a"],
    &["b-a"],
    &["b"],
    &["xor"],
    &["union", "or"],
    &["nor"],
    &["xnor"],
    &["not-b"],
    &["a|!b"],
    &["not", "not-a", "complement"],
    &["b|!a"],
    &["nand"],
    &["all"],
];

impl SetOperation {
    /// All operations, by [index](SetOperation::index).
    pub const ALL: [SetOperation; 16] = [
        SetOperation::Empty,
        SetOperation::Intersection,
        SetOperation::Difference,
        SetOperation::First,
        SetOperation::ReverseDifference,
        SetOperation::Second,
        SetOperation::SymmetricDifference,
        SetOperation::Union,
        SetOperation::Neither,
        SetOperation::Equivalence,
        SetOperation::NotSecond,
        SetOperation::FirstOrNotSecond,
        SetOperation::Complement,
        SetOperation::SecondOrNotFirst,
        SetOperation::NotBoth,
        SetOperation::Everything,
    ];

    /// Returns the index of the operation, 0 to 15 (N. A. Tyukachev). The result contains
    ///
    /// - the elements of both sets if bit 0 is set,
    /// - those of A alone if bit 1 is set,
    /// - those of B alone if bit 2 is set,
    /// - those of neither set if bit 3 is set.
    pub const fn index(self) -> u8 {
        self as u8
    }

    /// Returns the operation with an index; `None` above 15.
    pub const fn from_index(index: u8) -> Option<SetOperation> {
        if index < 16 { Some(SetOperation::ALL[index as usize]) } else { None }
    }

    /// Whether the result contains an element, depending on whether A and B contain it.
    pub const fn contains(self, in_first: bool, in_second: bool) -> bool {
        let bit = 2 * !in_first as u8 + !in_second as u8;
        self.index() >> bit & 1 == 1
    }

    /// Whether the result contains the elements of neither set, so that only an outer limit bounds
    /// it.
    pub const fn is_unbounded(self) -> bool {
        self.index() & 8 != 0
    }

    /// Returns this operation without the elements of neither set.
    pub const fn bounded(self) -> SetOperation {
        SetOperation::ALL[(self.index() & 7) as usize]
    }

    /// Returns the operation whose result is the complement of this one's.
    pub const fn complement(self) -> SetOperation {
        SetOperation::ALL[(self.index() ^ 15) as usize]
    }

    /// Whether the operation has a meaning for more than two sets: applied to the first two, then
    /// to the result and the next one (a complement is that of the last result).
    pub const fn takes_many(self) -> bool {
        let bounded = if self.is_unbounded() { self.complement() } else { self };
        matches!(bounded.index(), 0 | 1 | 2 | 6 | 7)
    }

    /// Returns the operation that has the same result if A and B are exchanged.
    pub const fn exchanged(self) -> SetOperation {
        let index = self.index();
        SetOperation::ALL[(index & 0b1001 | index >> 1 & 0b10 | index << 1 & 0b100) as usize]
    }

    /// Returns the name on the command line.
    pub const fn name(self) -> &'static str {
        NAMES[self as usize][0]
    }
}

impl fmt::Display for SetOperation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Parses a name on the command line, or an index.
impl FromStr for SetOperation {
    type Err = Error;

    fn from_str(text: &str) -> Result<SetOperation> {
        let index = text.parse().ok().filter(|index| *index < NAMES.len());
        let index = index.or_else(|| NAMES.iter().position(|names| names.contains(&text)));
        index.map(|index| SetOperation::ALL[index]).ok_or_else(|| {
            let names = NAMES.map(|names| names[0]).join(", ");
            Error::invalid("set operation", format!("`{text}`"), format!("{names}, or an index from 0 to 15"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_indices_round_trip() {
        for (index, operation) in SetOperation::ALL.into_iter().enumerate() {
            assert_eq!((usize::from(operation.index()), operation as usize), (index, index));
            assert_eq!(SetOperation::from_index(index as u8), Some(operation));
            for name in NAMES[index].iter().map(|name| name.to_string()).chain([index.to_string()]) {
                assert_eq!(name.parse::<SetOperation>().unwrap(), operation);
            }
            assert_eq!(operation.to_string().parse::<SetOperation>().unwrap(), operation);
        }
        assert_eq!(SetOperation::from_index(16), None);
        for wrong in ["", "16", "-1", "A", "over"] {
            assert!(wrong.parse::<SetOperation>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn operations_are_what_their_names_say() {
        type Definition = fn(bool, bool) -> bool;
        let definitions: [Definition; 16] = [
            |_, _| false,
            |a, b| a && b,
            |a, b| a && !b,
            |a, _| a,
            |a, b| b && !a,
            |_, b| b,
            |a, b| a != b,
            |a, b| a || b,
            |a, b| !(a || b),
            |a, b| a == b,
            |_, b| !b,
            |a, b| a || !b,
            |a, _| !a,
            |a, b| b || !a,
            |a, b| !(a && b),
            |_, _| true,
        ];
        for (operation, definition) in SetOperation::ALL.into_iter().zip(definitions) {
            for (a, b) in [(false, false), (false, true), (true, false), (true, true)] {
                assert_eq!(operation.contains(a, b), definition(a, b), "{operation:?}");
                assert_eq!(operation.complement().contains(a, b), !definition(a, b), "{operation:?}");
                assert_eq!(operation.exchanged().contains(b, a), definition(a, b), "{operation:?}");
            }
            assert_eq!(operation.is_unbounded(), definition(false, false), "{operation:?}");
        }
    }
}
