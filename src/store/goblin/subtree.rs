//! One go over the records of a subtree, all of which is in one segment: no recursion, and nothing is believed.

use super::record::{LEAF, Layout, Record};
use crate::value::Value;

/// The records of a subtree contradict each other.
#[derive(Debug)]
pub(crate) struct BadSkip;

/// Why nothing can be wrong with records that were taken over.
pub(super) const CHECKED: &str = "records are checked before they are taken";

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
    // Ends of the subtrees that the record is in.
    let mut ends = [records.len(); MOST_LEVELS + 1];
    let mut level = 0;
    let mut inner = 0;
    let levels = usize::from(levels).min(MOST_LEVELS);
    let of_children = u32::MAX >> (32 - 2 * D::CHILDREN);
    for (i, record) in records.iter().enumerate() {
        while i >= ends[level] {
            level -= 1;
        }
        let end = i + record.skip() as usize;
        let states = record.states() & of_children;
        // Bit pairs: INNER is 2, CUT is 3.
        let (high, low) = (states >> 1 & ALIKE, states & ALIKE);
        if level >= levels
            || end <= i
            || end > ends[level]
            || high & low != 0
            || (high != 0 && level + 1 == levels)
        {
            return Err(BadSkip);
        }
        inner += high.count_ones() as usize;
        show(level as u8, record);
        level += 1;
        ends[level] = end;
    }
    // One record for each INNER child, and the root's.
    if inner + 1 == records.len() { Ok(()) } else { Err(BadSkip) }
}

const ALIKE: u32 = 0x5555_5555;

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

/// Adds the nodes below a subtree's root to the counts of VOID, LEAF and INNER nodes of each level, the first of which is
/// that below the root.
///
/// # Errors
/// As [`each_record`].
pub(super) fn count_nodes<D: Layout, V: Value>(
    records: &[D::Record<V>],
    levels: u8,
    counts: &mut [[u64; 3]],
) -> Result<(), BadSkip> {
    each_record::<D, V>(records, levels, |level, record| {
        if let Some(counts) = counts.get_mut(usize::from(level)) {
            // No child is CUT.
            let states = record.states() & (u32::MAX >> (32 - 2 * D::CHILDREN));
            let inner = (states >> 1 & ALIKE).count_ones() as u64;
            let leaves = (states & ALIKE).count_ones() as u64;
            counts[0] += D::CHILDREN as u64 - inner - leaves;
            counts[1] += leaves;
            counts[2] += inner;
        }
    })
}
