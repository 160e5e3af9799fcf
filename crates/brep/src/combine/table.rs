//! Tables of set operations: which places belong to the result.

use spinney_base::{Error, Result};

/// Set operations, by their numbers: bit 0 says that what is in both bodies belongs to the result, bit 1 what is in the
/// first alone, bit 2 what is in the second alone, bit 3 what is in neither. Of more than two bodies there are 0, 1 (what is in
/// all), 2 (in the first alone), 6 (in an odd number of them), 7 (in any) and the complements of these; of one, all that
/// depend on no second: 0, 3, 12 and 15.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct OperationTable {
    number: u8,
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
    pub(super) fn new(number: u8, count: usize) -> Result<OperationTable> {
        let (bodies, are_right) = match number {
            0 | 3 | 12 | 15 if count == 1 => ("one body or more", true),
            0 | 1 | 2 | 6 | 7 | 8 | 9 | 13 | 14 | 15 => ("two bodies or more", count >= 2),
            3 | 12 => ("one body or two", count <= 2 && count > 0),
            _ => ("two bodies", count == 2),
        };
        if number > 15 || !are_right {
            let found = format!("operation {number} of {count}");
            return Err(Error::invalid("bodies", found, format!("{bodies} for an operation from 0 to 15")));
        }
        Ok(OperationTable { number, count })
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
        let of_one = |number| OperationTable { number, count: 1 };
        match (self.number, self.count) {
            (0 | 15, _) => (Vec::new(), of_one(self.number)),
            (3 | 12, _) => (vec![0], of_one(self.number)),
            (5, 2) => (vec![1], of_one(3)),
            (10, 2) => (vec![1], of_one(12)),
            (_, count) => ((0..count).collect(), self),
        }
    }

    /// Whether a place belongs to the result that lies in those of the bodies.
    pub(super) fn is_inside(self, bodies: &[i32]) -> bool {
        let is_in = |body: usize| bodies.get(body).is_some_and(|winding| *winding > 0);
        if self.count <= 2 {
            let index = match (is_in(0), is_in(1)) {
                (true, true) => 0,
                (true, false) => 1,
                (false, true) => 2,
                (false, false) => 3,
            };
            return self.number >> index & 1 == 1;
        }
        // (Of two bodies these are the same as the table.)
        let (turned, base) =
            if self.number & 8 != 0 { (true, 15 - self.number) } else { (false, self.number) };
        let inside = match base {
            1 => (0..self.count).all(is_in),
            2 => is_in(0) && !(1..self.count).any(is_in),
            6 => (0..self.count).filter(|body| is_in(*body)).count() % 2 == 1,
            7 => (0..self.count).any(is_in),
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
        for number in 0..16 {
            let table = OperationTable::new(number, 2).unwrap();
            let found: u8 =
                (0..).zip(places).map(|(bit, place)| u8::from(table.is_inside(&place)) << bit).sum();
            assert_eq!(found, number);
            // Those of many are the same for two, and go on with the third where that is in nothing, or in what was there.
            let Ok(of_three) = OperationTable::new(number, 3) else { continue };
            for [a, b] in places {
                let nothing = of_three.is_inside(&[a, b, 0]);
                if matches!(number, 0 | 2 | 6 | 7 | 8 | 9 | 13 | 15) {
                    assert_eq!(nothing, table.is_inside(&[a, b]), "{number}");
                }
            }
        }
        assert!(
            OperationTable::new(16, 2).is_err()
                && OperationTable::new(7, 0).is_err()
                && OperationTable::new(4, 3).is_err()
        );
        assert!(
            OperationTable::new(12, 1).unwrap().is_inside(&[0])
                && !OperationTable::new(12, 1).unwrap().is_inside(&[1])
        );
    }
}
