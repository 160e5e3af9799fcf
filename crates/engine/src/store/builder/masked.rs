//! Means and statistics of blocks whose samples may be missing or transparent. As for other blocks,
//! but each channel includes only cells with a sample that counts.
//!
//! These are kernels, selected once per block by the value type. All other blocks have no cost from
//! them.

use std::marker::PhantomData;

use zerocopy::IntoBytes;

use super::averaging::{Averaging, decode, encode, from_value, pairwise};
use super::block::{Block, for_leaves};
use super::fold::fold;
use super::sums::pairwise_sums;
use crate::store::records::Record;
use spinney_base::array;
use spinney_base::value::{Native, Value, ValueType, ZoneStats, erase};
use spinney_container::{INNER, LEAF};

/// Returns a value whose missing channels have the samples of another value.
#[inline]
fn filled<V: Native, R: Record>(mut bytes: R::Bytes, present: [bool; 4], other: V) -> V {
    let size = V::TYPE.sample.size();
    let other = encode::<R, V>(other);
    let samples = bytes.as_mut_bytes().chunks_exact_mut(size).zip(other.as_bytes().chunks_exact(size));
    for ((sample, other), is_there) in samples.zip(present) {
        if !is_there {
            sample.copy_from_slice(other);
        }
    }
    decode::<R, V>(bytes)
}

/// Returns a value of known type, with zeros for samples that do not count, and which of them do.
#[inline]
fn present<V: Native, R: Record>(value_type: ValueType, bytes: R::Bytes) -> (V, [bool; 4]) {
    let present = value_type.mask.present(V::TYPE.sample.size(), bytes.as_bytes());
    (filled::<V, R>(bytes, present, decode::<R, V>(R::ZERO)), present)
}

/// Adds cells to the counts of the channels that have a sample.
#[inline]
fn count(counts: &mut [u32; 4], present: [bool; 4], cells: u32) {
    for (count, present) in counts.iter_mut().zip(present) {
        *count += if present { cells } else { 0 };
    }
}

/// [`Rule::Mean`] and [`Rule::Occupancy`]: sums, and the number of cells to divide by, per channel.
pub(super) struct MaskedMeans<V> {
    value_type: ValueType,
    /// Whether cells count that are VOID or have no sample.
    of_all: bool,
    value: PhantomData<V>,
}

impl<V: Native> MaskedMeans<V> {
    pub(super) fn new(value_type: ValueType, of_all: bool) -> Self {
        MaskedMeans { value_type, of_all, value: PhantomData }
    }

    /// Returns the mean of each channel; where no cell has a sample, that is the missing value, or
    /// transparent black.
    fn mean(&self, sums: V::BlockSums, counts: [u32; 4]) -> Value {
        let none = self.value_type.mean_of_none().unwrap_or_default();
        self.value_type.by_channel(|channel| match counts[channel] {
            0 => none,
            cells => erase(V::block_mean(sums, cells)),
        })
    }
}

fn add(a: [u32; 4], b: [u32; 4]) -> [u32; 4] {
    array::from_fn(|channel| a[channel] + b[channel])
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
                    let (value, there) = present::<V, R>(self.value_type, values[i]);
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
        if self.of_all {
            counts = [cells * R::CHILDREN as u32; 4];
        }
        ((sums, counts), from_value::<R>(self.mean(sums, counts)))
    }

    fn reused(&mut self, records: &[R], levels: u8) -> Self::Of {
        let leaf = |bytes, cells| {
            let (value, there) = present::<V, R>(self.value_type, bytes);
            let mut counts = [0; 4];
            count(&mut counts, there, cells);
            (value.block_sums(cells), counts)
        };
        let sum = |a: Self::Of, b: Self::Of| (V::add_block_sums(a.0, b.0), add(a.1, b.1));
        let (sums, counts) = fold(records, levels, &leaf, &|sums: &[Self::Of]| pairwise(sums, sum));
        (sums, if self.of_all { [1 << (R::AXES * levels as usize); 4] } else { counts })
    }
}

/// Returns the statistics of all cells of a block, without classes.
pub(super) fn tally<V: Native, R: Record>(block: &Block) -> ZoneStats {
    let value_type = block.form().value;
    let is_exact = const { !V::TYPE.sample.is_float() };
    let mut tally = ZoneStats::void(value_type);
    let (mut min, mut max) = (V::default(), V::default());
    let mut sums = V::BlockSums::default();
    let mut squares = V::BlockSquares::default();
    for_leaves::<R>(block, &mut |bytes, cells| {
        let (value, there) = present::<V, R>(value_type, bytes);
        // The extremes of a channel start with its first sample.
        let seen = array::map(tally.present, |cells| cells > 0);
        if seen != [true; 4] {
            min = filled::<V, R>(encode::<R, V>(min), seen, value);
            max = filled::<V, R>(encode::<R, V>(max), seen, value);
        }
        min = min.min(filled::<V, R>(bytes, there, min));
        max = max.max(filled::<V, R>(bytes, there, max));
        tally.cells += u64::from(cells);
        for (count, is_there) in tally.present.iter_mut().zip(there) {
            *count += if is_there { u64::from(cells) } else { 0 };
        }
        // Floating-point sums depend on the order of summation: see below.
        if is_exact {
            sums = V::add_block_sums(sums, value.block_sums(cells));
            squares = V::add_block_squares(squares, value.block_squares(cells));
        }
    });
    (tally.min, tally.max) = (erase(min), erase(max));
    (tally.sum, tally.squares) = if const { !V::TYPE.sample.is_float() } {
        (V::erase(V::widen(sums)), V::erase_squares(V::widen_squares(squares)))
    } else {
        pairwise_sums::<V, R>(block, &|value: V| present::<V, R>(value_type, encode::<R, V>(value)).0)
    };
    tally
}
