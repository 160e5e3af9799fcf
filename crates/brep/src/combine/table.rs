//! Truth tables of set operations: which points belong to the result.

use super::node_table::OperandKind;
use spinney_base::{Error, Result, SetOperation};

/// A set operation on a number of bodies. On more than two bodies, the intersection is what is in
/// all bodies, the difference what is in the first only, the symmetric difference what is in an odd
/// number of bodies, the union what is in any. These four and the empty set have complements. One
/// body has the operations that do not depend on a second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct OperationTable {
    operation: SetOperation,
    count: usize,
    /// Whether all bodies matter, since their surfaces divide the result's faces.
    keeps_cuts: bool,
}

/// Fate of a whole face that touches no other body. (Regions of other faces have a `RegionFate`.)
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    Keep,
    Reverse,
    Drop,
}

impl OperationTable {
    pub(super) fn new(operation: SetOperation, count: usize) -> Result<OperationTable> {
        let (bodies, are_right) = match operation.index() {
            0 | 3 | 12 | 15 if count == 1 => ("at least one body", true),
            0 | 1 | 2 | 6 | 7 | 8 | 9 | 13 | 14 | 15 => ("at least two bodies", count >= 2),
            3 | 12 => ("one or two bodies", count <= 2 && count > 0),
            _ => ("two bodies", count == 2),
        };
        if !are_right {
            let found = format!("{count} for the operation {operation}");
            return Err(Error::invalid("bodies", found, bodies));
        }
        Ok(OperationTable { operation, count, keeps_cuts: false })
    }

    /// Returns the table of an operation on two bodies.
    pub(super) fn of_two(operation: SetOperation) -> OperationTable {
        OperationTable { operation, count: 2, keeps_cuts: false }
    }

    /// Returns the table for a result whose faces are divided along the surfaces of all bodies.
    pub(super) fn keeping_cuts(self) -> OperationTable {
        OperationTable { keeps_cuts: true, ..self }
    }

    /// Whether the result depends on a body.
    pub(super) fn depends_on(self, body: usize) -> bool {
        self.keeps_cuts
            || match self.operation {
                SetOperation::Empty | SetOperation::Everything => false,
                SetOperation::First | SetOperation::Complement => body == 0,
                SetOperation::Second | SetOperation::NotSecond => body == 1,
                _ => true,
            }
    }

    /// Returns the fate of a face of body `own`, from the winding number of each other body around
    /// it. The entry of `own` is ignored.
    pub(super) fn fate(self, own: usize, windings: &[i32]) -> Fate {
        let mut nodes: Vec<OperandKind> =
            windings.iter().map(|winding| OperandKind::uniform(*winding > 0)).collect();
        nodes[own] = OperandKind::Face;
        self.entry(&nodes).fate(own).unwrap_or(Fate::Drop)
    }

    /// Returns the bodies on which the result depends, and the operation on them.
    pub(super) fn on_relevant_bodies(self) -> (Vec<usize>, OperationTable) {
        let bodies: Vec<usize> = (0..self.count).filter(|body| self.depends_on(*body)).collect();
        let operation = match self.operation {
            SetOperation::Second => SetOperation::First,
            SetOperation::NotSecond => SetOperation::Complement,
            other => other,
        };
        let count = bodies.len().max(1);
        (bodies, OperationTable { operation, count, ..self })
    }

    /// Whether a point with these winding numbers belongs to the result.
    pub(super) fn is_inside(self, bodies: &[i32]) -> bool {
        self.includes(|body| bodies.get(body).is_some_and(|winding| *winding > 0))
    }

    /// Whether a point belongs to the result, from whether it is in each body.
    pub(super) fn includes(self, is_in: impl Fn(usize) -> bool) -> bool {
        if self.count <= 2 {
            return self.operation.contains(is_in(0), is_in(1));
        }
        let turned = self.operation.is_unbounded();
        let inside = match if turned { self.operation.complement() } else { self.operation } {
            SetOperation::Intersection => (0..self.count).all(&is_in),
            SetOperation::Difference => is_in(0) && !(1..self.count).any(&is_in),
            SetOperation::SymmetricDifference => (0..self.count).filter(|body| is_in(*body)).count() % 2 == 1,
            SetOperation::Union => (0..self.count).any(&is_in),
            _ => false,
        };
        inside != turned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tyukachev's table of sets, as bits of the operation: in A and B, in A only, in B only, in
    /// neither.
    #[test]
    fn tables_are_those_of_the_literature() {
        let windings = [[1, 1], [1, 0], [0, 1], [0, 0]];
        for operation in SetOperation::ALL {
            let table = OperationTable::new(operation, 2).unwrap();
            let found: u8 =
                (0..).zip(windings).map(|(bit, winding)| u8::from(table.is_inside(&winding)) << bit).sum();
            assert_eq!(found, operation.index());
            // Operations on many bodies match those on two where the third body adds nothing.
            let Ok(of_three) = OperationTable::new(operation, 3) else { continue };
            for [a, b] in windings {
                let nothing = of_three.is_inside(&[a, b, 0]);
                if matches!(operation.index(), 0 | 2 | 6 | 7 | 8 | 9 | 13 | 15) {
                    assert_eq!(nothing, table.is_inside(&[a, b]), "{operation}");
                }
            }
        }
        assert!(
            OperationTable::new(SetOperation::Union, 0).is_err()
                && OperationTable::new(SetOperation::ReverseDifference, 3).is_err()
        );
        assert!(
            OperationTable::new(SetOperation::Complement, 1).unwrap().is_inside(&[0])
                && !OperationTable::new(SetOperation::Complement, 1).unwrap().is_inside(&[1])
        );
    }
}
