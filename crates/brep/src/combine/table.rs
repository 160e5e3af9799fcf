//! Tables of set operations: which places belong to the result.

use spinney_base::{Error, Result, SetOperation};

/// A set operation on a number of bodies. On more than two bodies, the intersection is what is in all, the difference what is in
/// the first alone, the symmetric difference what is in an odd number of them, the union what is in any; these and the empty
/// set have complements. On one body there are the operations that depend on no second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct OperationTable {
    operation: SetOperation,
    count: usize,
}

/// Fate of a face that touches no other body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    Kept,
    Turned,
    Dropped,
}

impl OperationTable {
    pub(super) fn new(operation: SetOperation, count: usize) -> Result<OperationTable> {
        let (bodies, are_right) = match operation.index() {
            0 | 3 | 12 | 15 if count == 1 => ("one body or more", true),
            0 | 1 | 2 | 6 | 7 | 8 | 9 | 13 | 14 | 15 => ("two bodies or more", count >= 2),
            3 | 12 => ("one body or two", count <= 2 && count > 0),
            _ => ("two bodies", count == 2),
        };
        if !are_right {
            let found = format!("{count} for the operation {operation}");
            return Err(Error::invalid("bodies", found, bodies));
        }
        Ok(OperationTable { operation, count })
    }

    /// The fate of a face of a body where it is in other bodies, or not; the body's own place does not matter.
    pub(super) fn fate(self, own: usize, places: &[i32]) -> Fate {
        let inside = |place: i32| {
            let mut places = places.to_vec();
            places[own] = place;
            self.is_inside(&places)
        };
        match (inside(0), inside(1)) {
            (false, true) => Fate::Kept,
            (true, false) => Fate::Turned,
            _ => Fate::Dropped,
        }
    }

    /// The bodies that the result depends on, and the operation on them.
    pub(super) fn on_those_that_matter(self) -> (Vec<usize>, OperationTable) {
        let of_one = |operation| OperationTable { operation, count: 1 };
        match (self.operation, self.count) {
            (SetOperation::Empty | SetOperation::Everything, _) => (Vec::new(), of_one(self.operation)),
            (SetOperation::First | SetOperation::Complement, _) => (vec![0], of_one(self.operation)),
            (SetOperation::Second, 2) => (vec![1], of_one(SetOperation::First)),
            (SetOperation::NotSecond, 2) => (vec![1], of_one(SetOperation::Complement)),
            (_, count) => ((0..count).collect(), self),
        }
    }

    /// Whether a place belongs to the result that lies in those of the bodies.
    pub(super) fn is_inside(self, bodies: &[i32]) -> bool {
        let is_in = |body: usize| bodies.get(body).is_some_and(|winding| *winding > 0);
        if self.count <= 2 {
            return self.operation.contains(is_in(0), is_in(1));
        }
        let turned = self.operation.is_unbounded();
        let inside = match if turned { self.operation.complement() } else { self.operation } {
            SetOperation::Intersection => (0..self.count).all(is_in),
            SetOperation::Difference => is_in(0) && !(1..self.count).any(is_in),
            SetOperation::SymmetricDifference => (0..self.count).filter(|body| is_in(*body)).count() % 2 == 1,
            SetOperation::Union => (0..self.count).any(is_in),
            _ => false,
        };
        inside != turned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tyukachev's table of the sets: A and B, A alone, B alone, neither, as bits of the operation.
    #[test]
    fn tables_are_those_of_the_literature() {
        let places = [[1, 1], [1, 0], [0, 1], [0, 0]];
        for operation in SetOperation::ALL {
            let table = OperationTable::new(operation, 2).unwrap();
            let found: u8 =
                (0..).zip(places).map(|(bit, place)| u8::from(table.is_inside(&place)) << bit).sum();
            assert_eq!(found, operation.index());
            // Those of many are the same for two, and go on with the third where that is in nothing, or in what was there.
            let Ok(of_three) = OperationTable::new(operation, 3) else { continue };
            for [a, b] in places {
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
