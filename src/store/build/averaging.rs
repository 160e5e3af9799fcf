//! The rules at work on a block: what is carried up from level to level to make representatives.

use super::subtree::{CHECKED, each_leaf};
use crate::store::goblin::{INNER, LEAF, Layout, Record, VOID};
use crate::tree::Child;
use crate::value::{Rule, Value, channelwise_max, channelwise_min, dominant, most_frequent};

/// A rule at work on a block, from the bottom up.
pub(in crate::store) trait Averaging<V: Value> {
    /// What is carried up for an INNER node.
    type Of: Copy + Default;

    /// The same for the parent of these children and its representative. `known` is empty if no child is INNER;
    /// a child has `cells` cells.
    fn merge(&mut self, states: &[u8], values: &[V], known: &[Self::Of], cells: u32) -> (Self::Of, V);

    /// The same for a subtree of records, checked, of so many levels.
    fn taken<D: Layout>(&mut self, records: &[D::Record<V>], levels: u8) -> Self::Of;
}

/// [`Rule::Mean`] and [`Rule::Occupancy`]: sums, and the cells they are shared among.
pub(in crate::store) struct Means {
    /// Whether cells that are VOID count.
    pub(in crate::store) with_void: bool,
}

impl<V: Value> Averaging<V> for Means {
    type Of = (V::BlockSums, u32);

    #[inline]
    fn merge(&mut self, states: &[u8], values: &[V], known: &[Self::Of], cells: u32) -> (Self::Of, V) {
        let mut sums = [V::BlockSums::default(); 8];
        let mut count = 0;
        for (i, state) in states.iter().enumerate() {
            match *state {
                LEAF => {
                    sums[i] = values[i].block_sums(cells);
                    count += cells;
                }
                INNER => {
                    sums[i] = known[i].0;
                    count += known[i].1;
                }
                _ if self.with_void => count += cells,
                _ => {}
            }
        }
        let sum = pairwise(&sums[..states.len()], V::add_block_sums);
        ((sum, count), V::block_mean(sum, count))
    }

    fn taken<D: Layout>(&mut self, records: &[D::Record<V>], levels: u8) -> Self::Of {
        let (sum, count) = block_sums_taken::<D, V>(records, 0, levels);
        (sum, if self.with_void { 1 << (D::AXES * levels as usize) } else { count })
    }
}

/// Sums and cells of a subtree, added up in the order in which building adds them.
fn block_sums_taken<D: Layout, V: Value>(
    records: &[D::Record<V>],
    at: usize,
    levels: u8,
) -> (V::BlockSums, u32) {
    let record = &records[at];
    let mut next = at + 1;
    let mut count = 0;
    let cells = 1 << (D::AXES * (levels as usize - 1));
    let sums = D::array(|child| match record.state(child) {
        LEAF => {
            count += cells;
            record.value(child).block_sums(cells)
        }
        INNER => {
            let (sum, cells) = block_sums_taken::<D, V>(records, next, levels - 1);
            next += records[next].skip() as usize;
            count += cells;
            sum
        }
        _ => V::BlockSums::default(),
    });
    (pairwise(sums.as_ref(), V::add_block_sums), count)
}

/// [`Rule::Majority`]: counts per class, as a range of one arena; in any order.
pub(in crate::store) struct Majorities<V> {
    pub(in crate::store) arena: Vec<(V, u64)>,
}

/// Lists of up to so many entries are searched from end to end, longer ones sorted: measured with 12 and with 200
/// classes at random.
const FEW: u32 = 64;

impl<V: Value> Majorities<V> {
    /// The counts of a node, by ascending value.
    pub(in crate::store) fn list(
        &self,
        (start, len): (u32, u32),
        node: Child<V, ()>,
        cells: u32,
    ) -> Vec<(V, u64)> {
        match node {
            Child::Void => Vec::new(),
            Child::Leaf(value) => vec![(value, cells as u64)],
            Child::Inner { .. } => {
                let mut counts = self.arena[start as usize..][..len as usize].to_vec();
                sum_by_value(&mut counts);
                counts
            }
        }
    }

    /// Adds to the list that begins at `start` and is the arena's last.
    #[inline]
    fn add(&mut self, start: usize, value: V, cells: u64) {
        match self.arena[start..].iter_mut().find(|(other, _)| other.same(value)) {
            Some((_, sum)) => *sum += cells,
            None => self.arena.push((value, cells)),
        }
    }
}

impl<V: Value> Averaging<V> for Majorities<V> {
    type Of = (u32, u32);

    fn merge(&mut self, states: &[u8], values: &[V], known: &[Self::Of], cells: u32) -> (Self::Of, V) {
        let start = self.arena.len();
        let few = known.iter().map(|(_, len)| len).sum::<u32>() <= FEW;
        for (i, state) in states.iter().enumerate() {
            match *state {
                LEAF if few => self.add(start, values[i], cells as u64),
                LEAF => self.arena.push((values[i], cells as u64)),
                INNER => {
                    let (first, len) = known[i];
                    let range = first as usize..(first + len) as usize;
                    if few {
                        for place in range {
                            let (value, cells) = self.arena[place];
                            self.add(start, value, cells);
                        }
                    } else {
                        self.arena.extend_from_within(range);
                    }
                }
                _ => {}
            }
        }
        if !few {
            let len = sum_by_value_in(&mut self.arena[start..]);
            self.arena.truncate(start + len);
        }
        let majority = most_frequent(self.arena[start..].iter().copied()).unwrap_or_default();
        ((start as u32, (self.arena.len() - start) as u32), majority)
    }

    fn taken<D: Layout>(&mut self, records: &[D::Record<V>], levels: u8) -> Self::Of {
        let start = self.arena.len();
        let mut last = start;
        each_leaf::<D, V>(records, levels, |value, cells| {
            // Neighbours are alike.
            if !self.arena.get(last).is_some_and(|(other, _)| other.same(value)) {
                self.add(start, value, 0);
                let place = self.arena[start..].iter().position(|(other, _)| other.same(value));
                last = start + place.unwrap_or(0);
            }
            self.arena[last].1 += cells;
        })
        .expect(CHECKED);
        (start as u32, (self.arena.len() - start) as u32)
    }
}

/// The rules that look at the children alone.
pub(in crate::store) struct Local(pub(in crate::store) Rule);

impl<V: Value> Averaging<V> for Local {
    type Of = ();

    fn merge(&mut self, states: &[u8], values: &[V], _: &[()], _: u32) -> ((), V) {
        let some = || states.iter().zip(values).filter(|(state, _)| **state != VOID);
        let values = || some().map(|(_, value)| *value);
        let representative = match self.0 {
            Rule::Min => values().reduce(channelwise_min),
            Rule::Max => values().reduce(channelwise_max),
            Rule::Dominant => Some(dominant(some().map(|(state, value)| (*value, *state == INNER)))),
            Rule::Nearest | Rule::Mean | Rule::Majority | Rule::Occupancy => values().next(),
        };
        ((), representative.unwrap_or_default())
    }

    fn taken<D: Layout>(&mut self, _: &[D::Record<V>], _: u8) {}
}

/// Adds neighbours, then neighbours of those, and so on.
#[inline]
pub(in crate::store) fn pairwise<T: Copy>(items: &[T], add: impl Fn(T, T) -> T + Copy) -> T {
    match items {
        [a, b, c, d] => add(add(*a, *b), add(*c, *d)),
        _ => {
            let (left, right) = items.split_at(4);
            add(pairwise(left, add), pairwise(right, add))
        }
    }
}

/// Sorts a list of counts by value and makes one entry of equal values.
pub(in crate::store) fn sum_by_value<V: Value>(counts: &mut Vec<(V, u64)>) {
    let len = sum_by_value_in(counts);
    counts.truncate(len);
}

/// The same within a slice; returns how many entries are left at its start.
fn sum_by_value_in<V: Value>(counts: &mut [(V, u64)]) -> usize {
    counts.sort_unstable_by(|a, b| a.0.order(b.0));
    let mut len = 0;
    let mut next = 0;
    while let Some(&(value, mut sum)) = counts.get(next) {
        next += 1;
        while let Some((_, count)) = counts.get(next).filter(|(other, _)| other.same(value)) {
            sum += *count;
            next += 1;
        }
        counts[len] = (value, sum);
        len += 1;
    }
    len
}
