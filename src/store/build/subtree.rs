//! One go over the records of a subtree, all of which is in one segment: no recursion, and nothing is believed.

use super::counts::LevelCounts;
use crate::store::goblin::{INNER, LEAF, Layout, Record};
use crate::value::Value;

/// The records of a subtree contradict each other.
#[derive(Debug)]
pub(crate) struct BadSkip;

/// Why nothing can be wrong with records that were taken over.
pub(in crate::store) const CHECKED: &str = "records are checked before they are taken";

/// Levels of the deepest trees.
const MOST_LEVELS: usize = 32;

/// Shows all records of a subtree of so many levels, in preorder, with their levels below its root.
///
/// # Errors
/// If skips or states do not make a tree that is complete here; some records have been shown then.
#[inline]
pub(crate) fn each_record<D: Layout, V: Value>(
    records: &[D::Record<V>],
    levels: u8,
    mut show: impl FnMut(u8, &D::Record<V>),
) -> Result<(), BadSkip> {
    // Of the nodes that the record is in: where the subtree ends, and how many children have not come yet.
    let mut ends = [0; MOST_LEVELS + 1];
    let mut missing = [0; MOST_LEVELS + 1];
    (ends[0], missing[0]) = (records.len() as u32, 1);
    let mut level = 0;
    let mut inner = 0;
    let levels = usize::from(levels).min(MOST_LEVELS);
    let mut i = 0;
    while let Some(record) = records.get(i) {
        while i >= ends[level] as usize {
            level -= 1;
        }
        let end = i + record.skip() as usize;
        let children = inner_children::<D, V>(record);
        if level >= levels
            || missing[level] == 0
            || end <= i
            || end > ends[level] as usize
            || has_cut::<D, V>(record)
            || (children > 0 && level + 1 == levels)
        {
            return Err(BadSkip);
        }
        inner += children;
        missing[level] -= 1;
        show(level as u8, record);
        i += 1;
        level += 1;
        ends[level] = end as u32;
        missing[level] = children as u8;
        // The last level has most of the records, and no account to be kept.
        if level + 1 == levels {
            let last = &records[i..end];
            let is_last =
                |record: &D::Record<V>| record.skip() == 1 && states::<D, V>(record) & ALIKE << 1 == 0;
            if last.len() != children || !last.iter().all(is_last) {
                return Err(BadSkip);
            }
            last.iter().for_each(|record| show(level as u8, record));
            i = end;
        }
    }
    // One record for each INNER child, and the root's.
    if inner + 1 == records.len() { Ok(()) } else { Err(BadSkip) }
}

/// A state of 1 for each of up to 16 children.
const ALIKE: u32 = 0x5555_5555;

/// The states of all children, and nothing else.
#[inline]
fn states<D: Layout, V: Value>(record: &D::Record<V>) -> u32 {
    record.states() & (u32::MAX >> (32 - 2 * D::CHILDREN))
}

/// Whether a child's state is CUT, which has both bits set.
#[inline]
fn has_cut<D: Layout, V: Value>(record: &D::Record<V>) -> bool {
    let states = states::<D, V>(record);
    states & states >> 1 & ALIKE != 0
}

/// LEAF nodes (in the lower half) and INNER ones (in the upper half) by the states of four nodes. Counting bits
/// takes a dozen instructions on processors that are as old as programs must still run on.
const OF_FOUR: [u64; 256] = {
    let mut table = [0; 256];
    let mut states = 0;
    while states < 256 {
        let mut node = 0;
        while node < 4 {
            table[states] += match (states >> (2 * node)) as u8 & 3 {
                LEAF => 1,
                INNER => 1 << 32,
                _ => 0,
            };
            node += 1;
        }
        states += 1;
    }
    table
};

/// LEAF children (in the lower half) and INNER ones (in the upper half).
#[inline]
fn of_children<D: Layout, V: Value>(record: &D::Record<V>) -> u64 {
    let states = record.states() as usize;
    OF_FOUR[states & 255] + if D::CHILDREN > 4 { OF_FOUR[states >> 8 & 255] } else { 0 }
}

#[inline]
fn inner_children<D: Layout, V: Value>(record: &D::Record<V>) -> usize {
    (of_children::<D, V>(record) >> 32) as usize
}

/// Shows all leaves of a subtree of so many levels with their cells.
///
/// # Errors
/// As [`each_record`].
#[inline]
pub(crate) fn each_leaf<D: Layout, V: Value>(
    records: &[D::Record<V>],
    levels: u8,
    mut leaf: impl FnMut(V, u64),
) -> Result<(), BadSkip> {
    each_record::<D, V>(records, levels, |level, record| {
        let cells = 1u64 << (D::AXES * usize::from(levels - level - 1));
        let states = record.states();
        for child in 0..D::CHILDREN {
            if (states >> (2 * child)) as u8 & 3 == LEAF {
                leaf(record.value(child), cells);
            }
        }
    })
}

/// Counts the nodes below a subtree's root, which is at `level`.
///
/// # Errors
/// As [`each_record`]; nothing has been counted then.
pub(in crate::store) fn count_nodes<D: Layout, V: Value>(
    records: &[D::Record<V>],
    levels: u8,
    level: u8,
    counts: &mut LevelCounts,
) -> Result<(), BadSkip> {
    let mut sums = [0u64; MOST_LEVELS + 1];
    each_record::<D, V>(records, levels, |level, record| {
        sums[usize::from(level)] += of_children::<D, V>(record);
    })?;
    let mut parents = 1;
    for (below, sum) in (1..).zip(sums) {
        let (leaves, inner) = (sum & u64::from(u32::MAX), sum >> 32);
        counts.add(level + below, [parents * D::CHILDREN as u64 - leaves - inner, leaves, inner]);
        parents = inner;
        if parents == 0 {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::Quad;

    type Byte = [u8; 1];

    fn show(records: &[(u32, u32)], levels: u8) -> Option<Vec<u8>> {
        let records: Vec<<Quad as Layout>::Record<Byte>> =
            records.iter().map(|(states, skip)| Record::<Byte>::new(*states, |_| [0], *skip)).collect();
        let mut shown = Vec::new();
        each_record::<Quad, Byte>(&records, levels, |level, _| shown.push(level)).ok().map(|()| shown)
    }

    #[test]
    fn every_record_has_the_children_that_it_claims() {
        let good = [(0b1010, 6), (0b10, 2), (0, 1), (0b1010, 3), (0, 1), (0, 1)];
        for levels in [3, 4, 9, 200] {
            assert_eq!(show(&good, levels), Some(vec![0, 1, 2, 1, 2, 2]));
        }
        assert_eq!(show(&[(0, 1)], 1), Some(vec![0]));
        // A child too many here, one too few there: together as many as there should be.
        let bad = [(0b1010, 6), (0b10, 3), (0, 1), (0, 1), (0b1010, 2), (0, 1)];
        for levels in [2, 3, 4, 200] {
            assert_eq!(show(&bad, levels), None);
        }
        assert_eq!(show(&good, 2), None);
        assert_eq!(show(&good[..5], 3), None);
        assert_eq!(show(&[(0b11, 1)], 3), None);
    }

    #[test]
    fn nodes_are_counted_by_level() {
        let states = [0b1001_1010, 0b01_01_01_00, 0b01, 0];
        let records: Vec<<Quad as Layout>::Record<Byte>> = [(0, 4), (1, 1), (2, 1), (3, 1)]
            .map(|(i, skip)| Record::<Byte>::new(states[i], |_| [0], skip))
            .into();
        let mut counts = LevelCounts::default();
        count_nodes::<Quad, Byte>(&records, 2, 5, &mut counts).unwrap();
        assert_eq!(counts.levels()[5..], [[0; 3], [0, 1, 3], [8, 4, 0]]);
    }
}
