//! Statistics of a block: exact counts, extremes and sums of its cells.
//!
//! These are kernels: compiled for each value type, selected once per block.

use super::averaging::decode;
use super::block::{Block, for_leaves};
use super::masked;
use super::sums::pairwise_sums;
use crate::store::records::{Record, with_block_type};
use spinney_base::value::{Native, Value, ValueType, ZoneStats, erase};
use spinney_container::LEAF;

/// Returns the statistics of all cells of a block; computed from class counts if these are known
/// and sums are exact.
pub(super) fn of_block(block: &Block, classes: Option<Vec<(Value, u64)>>) -> ZoneStats {
    let form = block.form();
    let mut tally = match &classes {
        Some(classes) if !form.value.sample.is_float() => sum_of_classes(form.value, classes),
        _ => with_block_type!(form, V, R => match form.value.is_masked() {
            true if V::CHANNELS > 1 => masked::tally::<V, R>(block),
            _ => of_leaves::<V, R>(block),
        }),
    };
    tally.classes = classes.unwrap_or_default();
    tally
}

/// Returns the statistics of cells with these counts per value, in ascending order. Sums must be
/// exact.
pub(super) fn of_classes(value_type: ValueType, classes: Vec<(Value, u64)>) -> ZoneStats {
    let tally = sum_of_classes(value_type, &classes);
    ZoneStats { classes, ..tally }
}

fn sum_of_classes(value_type: ValueType, classes: &[(Value, u64)]) -> ZoneStats {
    let classes = classes.iter().map(|(value, cells)| ZoneStats::leaf(value_type, *value, *cells, false));
    classes.fold(ZoneStats::void(value_type), |sum, class| ZoneStats::merge(&[&sum, &class]))
}

fn of_leaves<V: Native, R: Record>(block: &Block) -> ZoneStats {
    // (A constant, so that only one way of summing is compiled for each type.)
    let is_exact = const { !V::TYPE.sample.is_float() };
    let mut cells = 0u64;
    let (mut min, mut max) = any_leaf::<R>(block).map_or_else(Default::default, |bytes| {
        let value: V = decode::<R, V>(bytes);
        (value, value)
    });
    let mut sums = V::BlockSums::default();
    let mut squares = V::BlockSquares::default();
    for_leaves::<R>(block, &mut |bytes, count| {
        let value: V = decode::<R, V>(bytes);
        cells += count as u64;
        (min, max) = (min.min(value), max.max(value));
        // Floating-point sums depend on the order of summation: see below.
        if is_exact {
            sums = V::add_block_sums(sums, value.block_sums(count));
            squares = V::add_block_squares(squares, value.block_squares(count));
        }
    });
    let (sum, squares) = if const { !V::TYPE.sample.is_float() } {
        (V::erase(V::widen(sums)), V::erase_squares(V::widen_squares(squares)))
    } else {
        pairwise_sums::<V, R>(block, &|value| value)
    };
    ZoneStats {
        value_type: V::TYPE,
        cells,
        present: [cells; 4],
        min: erase(min),
        max: erase(max),
        sum,
        squares,
        classes: Vec::new(),
    }
}

/// Returns the value of any leaf.
fn any_leaf<R: Record>(block: &Block) -> Option<R::Bytes> {
    let at_hand = block.levels.iter().find_map(|level| {
        let index = level.states.iter().position(|state| *state == LEAF)?;
        Some(level.values_of::<R>()[index])
    });
    at_hand.or_else(|| {
        // All leaves are in copied records.
        let mut any = None;
        for_leaves::<R>(block, &mut |value, _| any = any.or(Some(value)));
        any
    })
}
