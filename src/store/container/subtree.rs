//! Single passes over the records of a subtree, all of which is in one segment; skips and states are checked
//! on the way.

use super::level_counts::LevelCounts;
use super::record::{
    CUT, FOUR_STATES, INNER, LEAF, LOW_STATE_BITS, Record, RecordLayout, STATE_BITS, state_of,
    with_record_type,
};

/// The records of a subtree contradict each other.
#[derive(Debug)]
pub(crate) struct BadSkip;

/// Message of errors that cannot be, since records are checked when they are taken over.
pub(in crate::store) const RECORDS_ARE_CHECKED: &str = "records are checked before they are taken";

/// Levels of the deepest trees.
const MAX_LEVELS: usize = 32;

/// Shows all records of a subtree of so many levels, in preorder, with their levels below its root.
///
/// (A kernel: compiled for each width and fan-out, and for what is done with the records.)
///
/// # Errors
/// If skips or states do not make a tree that is complete here; some records have been shown then.
#[inline]
pub(crate) fn each_record<R: Record>(
    records: &[R],
    levels: u8,
    mut show: impl FnMut(u8, &R),
) -> Result<(), BadSkip> {
    // Of the nodes that the record is in: where the subtree ends, and how many children have not come yet.
    let mut ends = [0; MAX_LEVELS + 1];
    let mut missing = [0; MAX_LEVELS + 1];
    (ends[0], missing[0]) = (records.len() as u32, 1);
    let mut level = 0;
    let mut inner = 0;
    let levels = usize::from(levels).min(MAX_LEVELS);
    let mut i = 0;
    while let Some(record) = records.get(i) {
        // Ends at level 0 at the latest, where the end is that of all records.
        while i >= ends[level] as usize {
            level -= 1;
        }
        let end = i + record.skip() as usize;
        let children = inner_children(record);
        // A subtree ends within its parent's, so ends never grow from level to level; `level < levels` keeps
        // the accounts within their arrays.
        if level >= levels
            || missing[level] == 0
            || end <= i
            || end > ends[level] as usize
            || has_cut(record)
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
        // The last level has most of the records, and no account to be kept: its nodes are records without
        // INNER children, so each skip is 1, and there are as many as the parent claims.
        if level + 1 == levels {
            let last = &records[i..end];
            let is_last = |record: &R| record.skip() == 1 && states(record) & LOW_STATE_BITS << 1 == 0;
            if last.len() != children || !last.iter().all(is_last) {
                return Err(BadSkip);
            }
            last.iter().for_each(|record| show(level as u8, record));
            i = end;
        }
    }
    // One record for each INNER child, and the root's. No parent has had too many, so with the sum right none
    // has too few.
    if inner + 1 == records.len() { Ok(()) } else { Err(BadSkip) }
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

/// Shows all leaves of a subtree of so many levels with their cells.
///
/// # Errors
/// As [`each_record`].
#[inline]
pub(crate) fn each_leaf<R: Record>(
    records: &[R],
    levels: u8,
    mut leaf: impl FnMut(R::Bytes, u64),
) -> Result<(), BadSkip> {
    each_record(records, levels, |level, record: &R| {
        let cells = 1u64 << (R::AXES * usize::from(levels - level - 1));
        let states = record.states();
        for child in 0..R::CHILDREN {
            if state_of(states, child) == LEAF {
                leaf(record.values()[child], cells);
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

/// LEAF children (in the lower half) and INNER ones (in the upper half) of the records of each level.
fn nodes_per_level<R: Record>(records: &[R], levels: u8) -> Result<[u64; MAX_LEVELS + 1], BadSkip> {
    let mut sums = [0u64; MAX_LEVELS + 1];
    each_record(records, levels, |level, record| sums[usize::from(level)] += leaf_inner_counts(record))?;
    Ok(sums)
}

/// Copies the first levels (one at least) of the subtree that begins with the first of some records; what
/// lies deeper becomes CUT.
///
/// # Errors
/// If skips lead out of the node, or to the same records more than once: then they would make many of few.
pub(in crate::store) fn upper_levels(
    layout: RecordLayout,
    records: &[u8],
    levels: u8,
) -> Result<Vec<u8>, BadSkip> {
    let mut above = Vec::new();
    with_record_type!(layout, R => copy_levels::<R>(R::of(records), 0, levels, &mut above))?;
    Ok(above)
}

/// Adds the first levels of the subtree whose record has a number; tells where the subtree ends.
fn copy_levels<R: Record>(
    records: &[R],
    at: usize,
    levels: u8,
    above: &mut Vec<u8>,
) -> Result<usize, BadSkip> {
    let record = records.get(at).ok_or(BadSkip)?;
    let end = at + record.skip() as usize;
    let records = records.get(..end).ok_or(BadSkip)?;
    // Copied first, for its position in preorder; states and skip are known when the children are copied, and
    // set then.
    let start = above.len();
    above.extend_from_slice(record.as_bytes());
    let mut states = record.states();
    let mut next = at + 1;
    for child in 0..R::CHILDREN {
        if record.state(child) != INNER {
            continue;
        }
        let child_end = if levels > 1 {
            copy_levels(records, next, levels - 1, above)?
        } else {
            states |= u32::from(CUT) << (STATE_BITS * child);
            next + records.get(next).ok_or(BadSkip)?.skip() as usize
        };
        if child_end <= next || child_end > end {
            return Err(BadSkip);
        }
        next = child_end;
    }
    let skip = (above.len() - start) / size_of::<R>();
    let copied = R::new(states, record.values(), skip as u32);
    above[start..start + size_of::<R>()].copy_from_slice(copied.as_bytes());
    Ok(end)
}

#[cfg(test)]
mod tests {
    use zerocopy::IntoBytes;

    use super::*;
    use crate::space::Dimension;
    use crate::store::container::record::QuadRecord;
    use crate::tree::Form;
    use crate::value::{SampleType, ValueType};

    type Byte = QuadRecord<1>;

    fn show(records: &[(u32, u32)], levels: u8) -> Option<Vec<u8>> {
        let records: Vec<Byte> =
            records.iter().map(|(states, skip)| Record::new(*states, &[[0]; 4], *skip)).collect();
        let mut shown = Vec::new();
        each_record(&records, levels, |level, _: &Byte| shown.push(level)).ok().map(|()| shown)
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
    fn upper_levels_are_cut_off_and_checked() {
        let form = Form::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
        let upper = |records: &[(u32, u32)], levels| {
            let bytes: Vec<Byte> =
                records.iter().map(|(states, skip)| Record::new(*states, &[[7]; 4], *skip)).collect();
            let above = upper_levels(RecordLayout::new(form), bytes.as_bytes(), levels).ok()?;
            Some(Byte::of(&above).iter().map(|record| (record.states(), record.skip())).collect::<Vec<_>>())
        };
        let good = [(0b1001_1000, 5), (0b10, 2), (0, 1), (0b0110, 2), (0, 1)];
        assert_eq!(upper(&good, 1), Some(vec![(0b1101_1100, 1)]));
        assert_eq!(upper(&good, 2), Some(vec![(0b1001_1000, 3), (0b11, 1), (0b0111, 1)]));
        assert_eq!(upper(&good, 3), Some(good.to_vec()));
        // Two levels are copied, so nobody looks at the third.
        assert_eq!(upper(&[(0b10, 3), (0b10, 2), (0, 9)], 3), None);
        for bad in [
            &[(0b10, 2), (0, 0)][..],
            &[(0b10, 2), (0, 2), (0, 1)],
            &[(0b1010, 3), (0, 2), (0, 2)],
            &[(0b10, 1)],
            &[(0, 2)],
            &[],
        ] {
            assert_eq!((upper(bad, 1), upper(bad, 2)), (None, None), "{bad:?}");
        }
    }

    #[test]
    fn nodes_are_counted_by_level() {
        let states = [0b1001_1010, 0b01_01_01_00, 0b01, 0];
        let records: [Byte; 4] =
            [(0, 4), (1, 1), (2, 1), (3, 1)].map(|(i, skip)| Record::new(states[i], &[[0]; 4], skip));
        let mut counts = LevelCounts::default();
        let form = Form::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
        count_nodes(RecordLayout::new(form), records.as_bytes(), 2, 5, &mut counts).unwrap();
        assert_eq!(counts.levels()[5..], [[0; 3], [0, 1, 3], [8, 4, 0]]);
    }
}
