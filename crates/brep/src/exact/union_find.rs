//! Union-find: disjoint sets of numbers that can be merged.

/// Disjoint sets of the numbers from 0 on. A set's root is its smallest number, whatever the order
/// in which sets were merged.
///
/// Paths are halved (Tarjan and van Leeuwen, 1984): a look-up takes amortized logarithmic time.
/// Each number takes four bytes.
#[derive(Clone, Debug, Default)]
pub struct UnionFind {
    /// A smaller number of the same set, or the number itself for roots.
    parents: Vec<u32>,
}

impl UnionFind {
    /// Creates sets of one number each, for `count` numbers.
    pub fn new(count: usize) -> UnionFind {
        UnionFind { parents: (0..count as u32).collect() }
    }

    /// Returns the number of elements of all sets.
    pub(crate) fn len(&self) -> usize {
        self.parents.len()
    }

    /// Adds the next number, as a set of its own.
    pub(crate) fn push(&mut self) -> u32 {
        let number = self.parents.len() as u32;
        self.parents.push(number);
        number
    }

    /// Returns the smallest number of a number's set.
    #[inline]
    pub fn root(&mut self, mut number: u32) -> u32 {
        while self.parents[number as usize] != number {
            // Path halving.
            let above = self.parents[self.parents[number as usize] as usize];
            self.parents[number as usize] = above;
            number = above;
        }
        number
    }

    /// Merges the sets of two numbers, and returns the root.
    #[inline]
    pub fn join(&mut self, a: u32, b: u32) -> u32 {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b) as usize] = a.min(b);
        a.min(b)
    }

    /// Returns the root of each number's set.
    pub(crate) fn roots(&mut self) -> Vec<u32> {
        (0..self.parents.len() as u32).map(|number| self.root(number)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_are_the_least_numbers() {
        let mut sets = UnionFind::new(9);
        assert_eq!(sets.push(), 9);
        for (a, b, root) in [(8, 9, 8), (3, 5, 3), (9, 5, 3), (4, 4, 4), (7, 6, 6), (6, 9, 3)] {
            assert_eq!(sets.join(a, b), root);
        }
        assert_eq!(sets.roots(), [0, 1, 2, 3, 4, 3, 3, 3, 3, 3]);
        assert_eq!(sets.len(), 10);
    }

    /// Long chains in either direction, compared with sets that are relabelled one by one.
    #[test]
    fn chains_come_together() {
        let count = 500;
        for step in [1, 7, 499] {
            let (mut sets, mut labels) = (UnionFind::new(count), (0..count as u32).collect::<Vec<u32>>());
            for i in (0..count as u32 - 1).step_by(3) {
                let (a, b) = (i * step % count as u32, (i + 1) * step % count as u32);
                sets.join(a, b);
                let [one, other] = [labels[a as usize], labels[b as usize]];
                labels
                    .iter_mut()
                    .filter(|label| **label == one || **label == other)
                    .for_each(|l| *l = one.min(other));
            }
            assert_eq!(sets.roots(), labels);
        }
    }
}
