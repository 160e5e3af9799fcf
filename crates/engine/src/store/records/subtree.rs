//! Single passes over the records of a subtree, all of which is in one run; skips and states are checked on the way.

use super::dense::{DenseBlock, DenseRows, dense_block};
use super::record::{FOUR_STATES, LOW_STATE_BITS, Record, with_record_type};
use spinney_container::LevelCounts;
use spinney_container::{INNER, LEAF, RecordLayout, state_of};

/// The records of a subtree contradict each other.
#[derive(Debug)]
pub(crate) struct BadSkip;

/// Message of errors that cannot be, since records are checked when they are taken over.
pub(in crate::store) const RECORDS_ARE_CHECKED: &str = "records are checked before they are taken";

/// Levels of the deepest trees.
const MAX_LEVELS: usize = 32;

/// Visitor of the records of a subtree: of a run of siblings and its level, and of the dense block of a run that is one record.
type ShowRecords<'a, R> = &'a mut dyn FnMut(u8, &[R], Option<&DenseBlock<'_>>);

/// Shows all records of a subtree of so many levels, in preorder, with their levels below its root, and with their dense
/// blocks where they have some. Siblings of the last level, which have most of the records, are shown together.
///
/// (A kernel: compiled for each width and fan-out. What is done with the records is a pointer: it is another function for each type, too.)
///
/// # Errors
/// If skips or states do not make a tree that is complete here; some records have been shown then.
fn each_record<R: Record>(records: &[R], levels: u8, show: ShowRecords<'_, R>) -> Result<(), BadSkip> {
    // Of the nodes that the record is in: where the subtree ends, and how many children have not come yet.
    let mut ends = [0; MAX_LEVELS + 1];
    let mut missing = [0; MAX_LEVELS + 1];
    (ends[0], missing[0]) = (records.len() as u32, 1);
    let mut level = 0;
    let (mut inner, mut shown) = (0, 0);
    let levels = usize::from(levels).min(MAX_LEVELS);
    let mut i = 0;
    while let Some(record) = records.get(i) {
        // Ends at level 0 at the latest, where the end is that of all records.
        while i >= ends[level] as usize {
            level -= 1;
        }
        let end = i + record.skip() as usize;
        // Invariant: a subtree ends within its parent's, so that ends never grow from level to level, and
        // `level < levels` keeps the accounts within their arrays. So each record is one child of one node,
        // and in the end the sum tells whether all have come. What is copied record by record was seen here:
        // nobody looks again.
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
        // The last level has most of the records, and no account to be kept: its nodes are records without
        // INNER children, so each skip is 1, and there are as many as the parent claims.
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
    // One record for each INNER child, and the root's. No parent has had too many, so with the sum right none
    // has too few.
    if inner + 1 == shown { Ok(()) } else { Err(BadSkip) }
}

/// The dense block of a record, if it reaches down to the cells, which are so many levels below the record's node.
#[inline(never)]
fn dense_to_cells<R: Record>(records: &[R], at: usize, levels: usize) -> Option<DenseBlock<'_>> {
    let block = dense_block(records, at)?;
    (usize::from(block.levels) == levels && block.kind.is_leaves()).then_some(block)
}

/// The states of all children, and nothing else.
#[inline]
fn states<R: Record>(record: &R) -> u32 {
    record.states() & (u32::MAX >> (32 - 2 * R::CHILDREN))
}

/// Whether a child's state is CUT, which has both bits set.
#[inline]
fn has_cut<R: Record>(record: &R) -> bool {
    let states = states(record);
    states & states >> 1 & LOW_STATE_BITS != 0
}

/// LEAF nodes (in the lower half) and INNER ones (in the upper half) by the states of four nodes. Counting
/// bits takes a dozen instructions on processors that are as old as programs must still run on.
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

/// LEAF children (in the lower half) and INNER ones (in the upper half).
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

/// Shows all leaves of a subtree of so many levels with their cells; those of a dense block cell by cell, however they
/// condense.
///
/// # Errors
/// As [`each_record`].
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

/// A part of a subtree.
pub(crate) enum LeafOrBlock<'b, 'r, R: Record> {
    /// A leaf's value, and its cells.
    Leaf(R::Bytes, u64),
    /// A dense block, whose bottom nodes are cells.
    Block(&'b DenseBlock<'r>),
}

/// Shows all leaves of a subtree of so many levels, but dense blocks as a whole.
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
/// As [`each_record`]; nothing has been counted then.
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

/// LEAF children (in the lower half) and INNER ones (in the upper half) of the nodes of each level.
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
        let records: [Byte; 4] = [(0, 4), (1, 1), (2, 1), (3, 1)].map(|(i, skip)| record(states[i], skip, 0));
        let mut counts = LevelCounts::default();
        let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
        count_nodes(RecordLayout::new(form), records.as_bytes(), 2, 5, &mut counts).unwrap();
        assert_eq!(counts.levels()[5..], [[0; 3], [0, 1, 3], [8, 4, 0]]);
    }
}
