//! Blocks in rows whose nodes have the values of their first children
//! ([`Rule::Nearest`](spinney_base::value::Rule::Nearest)), with counts of the cells' values.

use zerocopy::{FromBytes, IntoBytes};

use super::super::counts::ValueCounts;
use super::{RowBlock, child_pairs};
use crate::store::records::{Record, RecordLayout, with_record_type};
use spinney_base::value::Value;

/// Sets the values of all nodes of a block to those of their first children; returns the number of
/// cells per value.
pub(super) fn firsts(block: &mut RowBlock) -> Vec<(Value, u64)> {
    with_record_type!(RecordLayout::new(block.form), R => firsts_of::<R>(block))
}

/// Compiled for each width, without knowledge of the value type.
fn firsts_of<R: Record>(block: &mut RowBlock) -> Vec<(Value, u64)> {
    let mut counts = ValueCounts::default();
    let (mut last, mut cells) = (R::ZERO, 0);
    for value in block.levels[0].values_of::<R>() {
        // Adjacent cells often have equal values.
        if *value != last {
            counts.add(last.as_bytes(), cells);
            (last, cells) = (*value, 0);
        }
        cells += 1;
    }
    counts.add(last.as_bytes(), cells);
    for up in 1..=block.height {
        block.push_level();
        let (axes, side) = (block.form.axes(), block.side(up - 1));
        let (below, level) = block.last_two();
        let (children, nodes) = (below.values_of::<R>(), <[R::Bytes]>::mut_from_bytes(&mut level.values));
        for (row, nodes) in nodes.expect("whole values").chunks_exact_mut(side / 2).enumerate() {
            let [pairs, ..] = child_pairs(axes, side, children, row);
            nodes.iter_mut().zip(pairs).for_each(|(node, pair)| *node = pair[0]);
        }
    }
    counts.finish(block.form.value)
}
