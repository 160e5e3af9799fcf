//! Sets of a model's faces, as bit sets.

/// A set of face numbers.
pub(crate) struct FaceSet(Vec<u64>);

impl FaceSet {
    /// Creates an empty set for face numbers below `count`.
    pub(crate) fn new(count: u64) -> FaceSet {
        FaceSet(vec![0; count.div_ceil(64) as usize])
    }

    /// Adds a face to the set, or removes it.
    pub(crate) fn set(&mut self, number: u64, is_in: bool) {
        if let Some(word) = self.0.get_mut((number / 64) as usize) {
            let bit = 1 << (number % 64);
            *word = if is_in { *word | bit } else { *word & !bit };
        }
    }

    pub(crate) fn has(&self, number: u64) -> bool {
        self.0.get((number / 64) as usize).is_some_and(|word| word >> (number % 64) & 1 == 1)
    }

    /// Returns the numbers in the set, ascending.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = u32> {
        let of_word = |(index, word): (u32, &u64)| {
            let word = *word;
            (0..64).filter(move |bit| word >> bit & 1 == 1).map(move |bit| 64 * index + bit)
        };
        (0..).zip(&self.0).flat_map(of_word)
    }
}

/// Consecutive new numbers for the faces of a set, in their order.
pub(crate) struct Renumbering {
    set: FaceSet,
    /// Number of faces before each word of 64.
    before: Vec<u32>,
}

impl Renumbering {
    /// Numbers the faces of a set from 0.
    pub(crate) fn of(set: FaceSet) -> Renumbering {
        let before = set.0.iter().scan(0, |sum, word| {
            let before = *sum;
            *sum += word.count_ones();
            Some(before)
        });
        let before = before.collect();
        Renumbering { set, before }
    }

    /// Returns the number of faces in the set.
    pub(crate) fn len(&self) -> u32 {
        let last = self.set.0.last().map_or(0, |word| word.count_ones());
        self.before.last().map_or(0, |before| before + last)
    }

    /// Returns the new number of a face, or `None` if it is not in the set.
    pub(crate) fn number(&self, face: u64) -> Option<u32> {
        let word = self.set.0.get((face / 64) as usize)?;
        let below = word & ((1 << (face % 64)) - 1);
        self.set.has(face).then(|| self.before[(face / 64) as usize] + below.count_ones())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_count_those_before() {
        let mut set = FaceSet::new(300);
        (0..300).filter(|face| face % 7 == 3 || face % 64 == 63).for_each(|face| set.set(face, true));
        set.set(10, false);
        let listed: Vec<u32> = set.numbers().collect();
        let numbers = Renumbering::of(set);
        assert_eq!(numbers.len() as usize, listed.len());
        for face in 0..310u32 {
            let place = listed.iter().position(|listed| *listed == face);
            assert_eq!(numbers.number(face.into()), place.map(|place| place as u32), "{face}");
        }
    }
}
