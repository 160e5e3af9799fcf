//! Single-pass scans of a subtree's records, all of which are in one run. Skips and states are
//! checked on the way.

use super::dense::{DenseBlock, DenseRows, dense_block};
use super::record::{FOUR_STATES, LOW_STATE_BITS, Record, with_record_type};
use spinney_container::LevelCounts;
use spinney_container::{INNER, LEAF, RecordLayout, state_of};

/// Error: the records of a subtree are inconsistent.
#[derive(Debug)]
pub(crate) struct BadSkip;

/// Panic message for errors that cannot occur, since records are checked when they are copied.
pub(in crate::store) const RECORDS_ARE_CHECKED: &str = "records were checked before they were copied";

/// Levels of the deepest trees.
const MAX_LEVELS: usize = 32;

/// Visitor of a subtree's records: receives the level and a run of siblings, and the dense block of
/// a run that is one record.
type ShowRecords<'a, R> = &'a mut dyn FnMut(u8, &[R], Option<&DenseBlock<'_>>);

/// Passes all records of a subtree of `levels` levels to `show`, in preorder, with their levels
/// below its root and with the dense block of a record that has one. Siblings of the last level,
/// which has most of the records, are passed together.
///
/// (A kernel, compiled for each width and fan-out. The visitor is called through a pointer, since
/// it is another function for each type, too.)
///
/// # Errors
/// If skips or states do not form a tree that is complete here. Some records have been passed to
/// `show` by then.
fn each_record<R: Record>(records: &[R], levels: u8, show: ShowRecords<'_, R>) -> Result<(), BadSkip> {
    // Per level, for the ancestors of the record: end of the subtree, and number of children still
    // missing.
    let mut ends = [0; MAX_LEVELS + 1];
    let mut missing = [0; MAX_LEVELS + 1];
    (ends[0], missing[0]) = (records.len() as u32, 1);
    let mut level = 0;
    let (mut inner, mut shown) = (0, 0);
    let levels = usize::from(levels).min(MAX_LEVELS);
    let mut i = 0;
    while let Some(record) = records.get(i) {
        // Stops at level 0 at the latest, whose end is that of all records.
        while i >= ends[level] as usize {
            level -= 1;
        }
        let end = i + record.skip() as usize;
        // Invariant: a subtree ends within its parent's, so `ends` never grow from level to level,
        // and `level < levels` keeps the indices within both arrays. So each record is a child of
        // exactly one node, and the sum at the end shows whether all children were found. Records
        // are copied without any further check.
        if level >= levels || missing[level] == 0 || end <= i || end > ends[level] as usize {
            return Err(BadSkip);
        }
        missing[level] -= 1;
        shown += 1;
        if record.is_dense() {
            let block = dense_to_cells(records, i, levels - level).ok_or(BadSkip)?;
            show(level as u8, &records[i..=i], Some(&block));
            i = end;
            continue;
        }
        let children = inner_children(record);
        if has_cut(record) || (children > 0 && level + 1 == levels) {
            return Err(BadSkip);
        }
        inner += children;
        show(level as u8, &records[i..=i], None);
        i += 1;
        level += 1;
        ends[level] = end as u32;
        missing[level] = children as u8;
        // The last level has most of the records and needs no bookkeeping: its nodes have no INNER
        // children, so each skip is 1, and their number is what the parent claims.
        if level + 1 == levels {
            let last = &records[i..end];
            let is_last = |record: &R| {
                record.skip() == 1 && !record.is_dense() && states(record) & LOW_STATE_BITS << 1 == 0
            };
            if last.len() != children || !last.iter().all(is_last) {
                return Err(BadSkip);
            }
            shown += children;
            show(level as u8, last, None);
            i = end;
        }
    }
    // There is one record per INNER child, plus the root's. No parent had too many, so if the sum
    // is right, none has too few.
    if inner + 1 == shown { Ok(()) } else { Err(BadSkip) }
}

/// Returns the dense block of a record, if it reaches down to the cells, which are `levels` levels
/// below the record's node.
#[inline(never)]
fn dense_to_cells<R: Record>(records: &[R], at: usize, levels: usize) -> Option<DenseBlock<'_>> {
    let block = dense_block(records, at)?;
    (usize::from(block.levels) == levels && block.kind.is_leaves()).then_some(block)
}

/// Returns the states of all children, without other bits.
#[inline]
fn states<R: Record>(record: &R) -> u32 {
    record.states() & (u32::MAX >> (32 - 2 * R::CHILDREN))
}

/// Returns whether a child's state is CUT, which has both bits set.
#[inline]
fn has_cut<R: Record>(record: &R) -> bool {
    let states = states(record);
    states & states >> 1 & LOW_STATE_BITS != 0
}

/// Number of LEAF nodes (in the lower 32 bits) and INNER nodes (in the upper 32 bits) by the states
/// of four nodes. A table, because counting bits takes a dozen instructions on the oldest supported
/// processors.
const LEAF_INNER_COUNTS: [u64; FOUR_STATES] = {
    let mut table = [0; FOUR_STATES];
    let mut states = 0;
    while states < FOUR_STATES {
        let mut node = 0;
        while node < 4 {
            table[states] += match state_of(states as u32, node) {
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

/// Returns the numbers of LEAF children (in the lower 32 bits) and INNER children (in the upper 32
/// bits).
#[inline]
fn leaf_inner_counts<R: Record>(record: &R) -> u64 {
    let states = record.states() as usize;
    let upper = if R::CHILDREN > 4 { LEAF_INNER_COUNTS[states / FOUR_STATES % FOUR_STATES] } else { 0 };
    LEAF_INNER_COUNTS[states % FOUR_STATES] + upper
}

#[inline]
fn inner_children<R: Record>(record: &R) -> usize {
    (leaf_inner_counts(record) >> 32) as usize
}

/// Passes all leaves of a subtree of `levels` levels to `leaf`, with their number of cells. The
/// leaves of a dense block are passed cell by cell, even if they are equal.
///
/// # Errors
/// Those of [`each_record`].
#[inline]
pub(crate) fn each_leaf<R: Record>(
    records: &[R],
    levels: u8,
    mut leaf: impl FnMut(R::Bytes, u64),
) -> Result<(), BadSkip> {
    each_leaf_or_block(records, levels, |part| match part {
        LeafOrBlock::Leaf(value, cells) => leaf(value, cells),
        LeafOrBlock::Block(block) => block.each_leaf_in::<R>(block.whole(), &mut |value| leaf(value, 1)),
    })
}

/// A leaf or a dense block of a subtree.
pub(crate) enum LeafOrBlock<'b, 'r, R: Record> {
    /// A leaf's value, and its number of cells.
    Leaf(R::Bytes, u64),
    /// A dense block, whose bottom nodes are cells.
    Block(&'b DenseBlock<'r>),
}

/// Passes all leaves of a subtree of `levels` levels to `show`, but dense blocks as a whole.
///
/// # Errors
/// Those of [`each_record`].
#[inline]
pub(crate) fn each_leaf_or_block<R: Record>(
    records: &[R],
    levels: u8,
    mut show: impl FnMut(LeafOrBlock<'_, '_, R>),
) -> Result<(), BadSkip> {
    each_record(records, levels, &mut |level, run: &[R], block| {
        if let Some(block) = block {
            show(LeafOrBlock::Block(block));
            return;
        }
        let cells = 1u64 << (R::AXES * usize::from(levels - level - 1));
        for record in run {
            let states = record.states();
            for child in 0..R::CHILDREN {
                if state_of(states, child) == LEAF {
                    show(LeafOrBlock::Leaf(record.values()[child], cells));
                }
            }
        }
    })
}

/// Counts the nodes below a subtree's root, which is at `level`.
///
/// # Errors
/// Those of [`each_record`]; nothing has been counted then.
pub(in crate::store) fn count_nodes(
    layout: RecordLayout,
    records: &[u8],
    levels: u8,
    level: u8,
    counts: &mut LevelCounts,
) -> Result<(), BadSkip> {
    let sums = with_record_type!(layout, R => nodes_per_level(R::of(records), levels))?;
    let children = layout.children() as u64;
    let mut parents = 1;
    for (below, sum) in (1..).zip(sums) {
        let (leaves, inner) = (sum & u64::from(u32::MAX), sum >> 32);
        counts.add(level + below, [parents * children - leaves - inner, leaves, inner]);
        parents = inner;
        if parents == 0 {
            break;
        }
    }
    Ok(())
}

/// Returns the numbers of LEAF children (in the lower 32 bits) and INNER children (in the upper 32
/// bits) of each level's nodes.
fn nodes_per_level<R: Record>(records: &[R], levels: u8) -> Result<[u64; MAX_LEVELS + 1], BadSkip> {
    let mut sums = [0u64; MAX_LEVELS + 1];
    each_record(records, levels, &mut |level, run: &[R], block| match block {
        None => run.iter().for_each(|record| sums[usize::from(level)] += leaf_inner_counts(record)),
        Some(block) => {
            for (below, nodes) in (0..).zip(block.states::<R>().nodes_per_level()).skip(1) {
                sums[usize::from(level) + below as usize - 1] += nodes;
            }
        }
    })?;
    Ok(sums)
}

#[cfg(test)]
mod tests {
    use zerocopy::IntoBytes;

    use super::*;
    use crate::store::records::RecordHead;
    use crate::store::records::record::QuadRecord;
    use spinney_base::TreeType;
    use spinney_base::space::Dimension;
    use spinney_base::value::{SampleType, ValueType};

    type Byte = QuadRecord<1>;

    fn record(states: u32, skip: u32, value: u8) -> Byte {
        Record::new(RecordHead { states, skip, dense: 0 }, &[[value]; 4])
    }

    fn show(records: &[(u32, u32)], levels: u8) -> Option<Vec<u8>> {
        let records: Vec<Byte> = records.iter().map(|(states, skip)| record(*states, *skip, 0)).collect();
        let mut shown = Vec::new();
        let show =
            &mut |level, run: &[Byte], _: Option<&DenseBlock<'_>>| shown.extend(run.iter().map(|_| level));
        each_record(&records, levels, show).ok().map(|()| shown)
    }

    #[test]
    fn every_record_has_the_children_that_it_claims() {
        let good = [(0b1010, 6), (0b10, 2), (0, 1), (0b1010, 3), (0, 1), (0, 1)];
        for levels in [3, 4, 9, 200] {
            assert_eq!(show(&good, levels), Some(vec![0, 1, 2, 1, 2, 2]));
        }
        assert_eq!(show(&[(0, 1)], 1), Some(vec![0]));
        // One child too many in one node, one too few in another: the sum is right.
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
        let records: [Byte; 4] = [(0, 4), (1, 1), (2, 1), (3, 1)].map(|(i, skip)| record(states[i], skip, 0));
        let mut counts = LevelCounts::default();
        let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
        count_nodes(RecordLayout::new(form), records.as_bytes(), 2, 5, &mut counts).unwrap();
        assert_eq!(counts.levels()[5..], [[0; 3], [0, 1, 3], [8, 4, 0]]);
    }
}
