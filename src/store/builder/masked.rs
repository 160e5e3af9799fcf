//! The rules and the tally of blocks in whose cells samples may be missing: like the others', but a channel is made of
//! those cells alone that have a sample in it.
//!
//! Kernels, chosen once per block for values of such a type; all other blocks know nothing of this.

use std::marker::PhantomData;

use zerocopy::IntoBytes;

use super::averaging::{Averaging, from_value, pairwise};
use super::block::{Block, for_leaves};
use super::tally::pairwise_sums;
use crate::store::container::{INNER, LEAF, Record, VOID};
use crate::value::{Native, Rule, Tally, Value, ValueType, erase, native};

/// A value of known type, with zeros where samples are missing, and where there are some.
#[inline]
fn present<V: Native>(value_type: ValueType, bytes: &[u8]) -> (V, [bool; 4]) {
    let value = Value::from_bytes(bytes);
    (native::<V>(value_type.with_zeros(value)), value_type.present(value))
}

/// Adds cells to the counts of the channels that have a sample.
#[inline]
fn count(counts: &mut [u32; 4], present: [bool; 4], cells: u32) {
    for (count, present) in counts.iter_mut().zip(present) {
        *count += if present { cells } else { 0 };
    }
}

/// [`Rule::Mean`]: sums, and the cells that they are shared among, per channel.
pub(super) struct MaskedMeans<V> {
    value_type: ValueType,
    value: PhantomData<V>,
}

impl<V: Native> MaskedMeans<V> {
    pub(super) fn new(value_type: ValueType) -> Self {
        MaskedMeans { value_type, value: PhantomData }
    }

    /// The mean of each channel; missing where no cell has a sample.
    fn mean(&self, sums: V::BlockSums, counts: [u32; 4]) -> Value {
        let missing = self.value_type.all_missing().unwrap_or_default();
        self.value_type.by_channel(|channel| match counts[channel] {
            0 => missing,
            cells => erase(V::block_mean(sums, cells)),
        })
    }

    /// Sums and cells of a subtree, added up in the order in which building adds them.
    fn of_records<R: Record>(&self, records: &[R], at: usize, levels: u8) -> (V::BlockSums, [u32; 4]) {
        let record = &records[at];
        let mut next = at + 1;
        let mut counts = [0; 4];
        let cells = 1 << (R::AXES * (levels as usize - 1));
        let mut sums = [V::BlockSums::default(); 8];
        for (child, sum) in sums[..R::CHILDREN].iter_mut().enumerate() {
            match record.state(child) {
                LEAF => {
                    let (value, there) = present::<V>(self.value_type, record.values()[child].as_bytes());
                    count(&mut counts, there, cells);
                    *sum = value.block_sums(cells);
                }
                INNER => {
                    let below = self.of_records(records, next, levels - 1);
                    next += records[next].skip() as usize;
                    counts = add(counts, below.1);
                    *sum = below.0;
                }
                _ => {}
            }
        }
        (pairwise(&sums[..R::CHILDREN], V::add_block_sums), counts)
    }
}

fn add(a: [u32; 4], b: [u32; 4]) -> [u32; 4] {
    std::array::from_fn(|channel| a[channel] + b[channel])
}

impl<V: Native, R: Record> Averaging<R> for MaskedMeans<V> {
    type Of = (V::BlockSums, [u32; 4]);

    fn merge(
        &mut self,
        states: &[u8],
        values: &[R::Bytes],
        known: &[Self::Of],
        cells: u32,
    ) -> (Self::Of, R::Bytes) {
        let mut sums = [V::BlockSums::default(); 8];
        let mut counts = [0; 4];
        for (i, state) in states.iter().enumerate() {
            match *state {
                LEAF => {
                    let (value, there) = present::<V>(self.value_type, values[i].as_bytes());
                    count(&mut counts, there, cells);
                    sums[i] = value.block_sums(cells);
                }
                INNER => {
                    sums[i] = known[i].0;
                    counts = add(counts, known[i].1);
                }
                _ => {}
            }
        }
        let sums = pairwise(&sums[..R::CHILDREN], V::add_block_sums);
        ((sums, counts), from_value::<R>(self.mean(sums, counts)))
    }

    fn reused(&mut self, records: &[R], levels: u8) -> Self::Of {
        self.of_records(records, 0, levels)
    }
}

/// [`Rule::Min`] and [`Rule::Max`].
pub(super) struct MaskedExtremes {
    value_type: ValueType,
    join: fn(ValueType, Value, Value) -> Value,
}

impl MaskedExtremes {
    pub(super) fn new(value_type: ValueType, rule: Rule) -> Self {
        MaskedExtremes { value_type, join: if rule == Rule::Min { ValueType::min } else { ValueType::max } }
    }
}

impl<R: Record> Averaging<R> for MaskedExtremes {
    type Of = ();

    fn merge(&mut self, states: &[u8], values: &[R::Bytes], _: &[()], _: u32) -> ((), R::Bytes) {
        let some = states.iter().zip(values).filter(|(state, _)| **state != VOID);
        let values = some.map(|(_, value)| Value::from_bytes(value.as_bytes()));
        let extreme = values.reduce(|a, b| self.value_type.join_present(a, b, self.join));
        ((), from_value::<R>(extreme.unwrap_or_default()))
    }

    fn reused(&mut self, _: &[R], _: u8) {}
}

/// The tally of all the cells of a block, but for its classes.
pub(super) fn tally<V: Native, R: Record>(block: &Block) -> Tally {
    let value_type = block.form().value;
    let is_float = value_type.sample.is_float();
    let mut tally = Tally::void(value_type);
    let mut sums = V::BlockSums::default();
    let mut squares = V::BlockSquares::default();
    for_leaves::<R>(block, &mut |bytes, cells| {
        let value = Value::from_bytes(bytes.as_bytes());
        tally.count_cells(
            value,
            value,
            u64::from(cells),
            value_type.present(value).map(|is| if is { u64::from(cells) } else { 0 }),
        );
        // Sums of floating samples depend on the order of adding: see below.
        if !is_float {
            let value = native::<V>(value_type.with_zeros(value));
            sums = V::add_block_sums(sums, value.block_sums(cells));
            squares = V::add_block_squares(squares, value.block_squares(cells));
        }
    });
    (tally.sum, tally.squares) = if is_float {
        pairwise_sums::<V, R>(block, &|value: V| native::<V>(value_type.with_zeros(erase(value))))
    } else {
        (V::erase(V::widen(sums)), V::erase(V::widen_squares(squares)))
    };
    tally
}
