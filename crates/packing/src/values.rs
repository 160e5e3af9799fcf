//! Values of nodes: the table of a segment's values, and the coding of new ones.

use std::collections::HashMap;

use spinney_base::TreeType;
use spinney_base::value::SampleType;

use crate::adaptive::{Adaptive, AdaptiveSymbols};
use crate::bits::BitCoder;
use crate::blocks::channel_order;
use crate::nodes::{FIRST_VALUE, NOTHING, NewValues};
use crate::residuals::{SIZES, code_residual, initial_symbols, size_context};
use crate::samples;

/// Samples of a value as integers.
pub(crate) type Numbers = [i64; 4];

/// Returns the samples of a value.
pub(crate) fn numbers(form: TreeType, value: &[u8]) -> Numbers {
    let (sample, channels) = (form.value.sample, usize::from(form.value.channels));
    let mut numbers = [0; 4];
    let samples = value.chunks_exact(sample.size()).take(channels);
    numbers.iter_mut().zip(samples).for_each(|(number, bytes)| *number = samples::read(sample, bytes));
    numbers
}

/// Returns the bytes of a value.
pub(crate) fn bytes(form: TreeType, numbers: Numbers) -> [u8; 16] {
    let (sample, channels) = (form.value.sample, usize::from(form.value.channels));
    let mut bytes = [0; 16];
    let samples = bytes.chunks_exact_mut(sample.size()).take(channels);
    samples.zip(numbers).for_each(|(bytes, number)| samples::write(sample, number, bytes));
    bytes
}

/// Returns a key that sorts values in the order of section 7 of formats.md.
pub(crate) fn order(form: TreeType, numbers: &Numbers) -> [u64; 4] {
    let turned = if form.value.sample == SampleType::U64 { 0 } else { 1 << 63 };
    numbers.map(|number| number as u64 ^ turned)
}

/// Codes a sorted list of values, each as the difference from the one before. Returns `None` if
/// there are more than `most`.
pub(crate) fn code_table<K: BitCoder>(
    coder: &mut K,
    form: TreeType,
    table: &[Numbers],
    most: usize,
) -> Option<Vec<Numbers>> {
    let count = usize::try_from(coder.number(table.len() as u64)).ok().filter(|count| *count <= most)?;
    let (mut last, mut coded): (Numbers, Vec<_>) = ([0; 4], Vec::new());
    for at in 0..count {
        let value = table.get(at).copied().unwrap_or_default();
        for (channel, last) in last.iter_mut().enumerate().take(usize::from(form.value.channels)) {
            *last = last.wrapping_add(coder.signed(value[channel].wrapping_sub(*last)));
        }
        coded.push(last);
    }
    Some(coded)
}

/// Values in a table. New ones are coded by their index in it.
pub(crate) struct TableValues {
    bits: u32,
    count: usize,
    /// Probabilities of the bits of an index, by the bits above them.
    contexts: Vec<Adaptive>,
}

impl TableValues {
    pub(crate) fn new(count: usize) -> TableValues {
        let bits = usize::BITS - count.leading_zeros();
        TableValues { bits, count, contexts: vec![Adaptive::default(); 1 << bits] }
    }
}

impl NewValues for TableValues {
    fn new_value<K: BitCoder>(&mut self, coder: &mut K, symbol: u32, _: bool, _: &[u32]) -> Option<u32> {
        // (0 is VOID.)
        let number = if symbol == NOTHING { 0 } else { symbol.wrapping_sub(FIRST_VALUE - 1) };
        let mut path = 1;
        for bit in (0..self.bits).rev() {
            let is_set = coder.bit(&mut self.contexts[path], number >> bit & 1 == 1);
            path = path << 1 | usize::from(is_set);
        }
        match path - (1 << self.bits) {
            0 => Some(NOTHING),
            number => (number <= self.count).then_some(number as u32 + FIRST_VALUE - 1),
        }
    }
}

/// Values that are numbers. New ones are coded as the difference from the mean of their neighbours.
pub(crate) struct NumberValues {
    form: TreeType,
    /// Values, by symbol less [`FIRST_VALUE`]. A writer has all of them from the start, in
    /// ascending order; a reader appends each new one when it is decoded.
    ///
    /// Invariant: so a value has one symbol for the writer and another one for the reader. Symbols
    /// are not coded, and contexts depend only on whether two are equal, and on the values that
    /// they represent: on both sides, equal symbols are equal values.
    pub(crate) known: Vec<Numbers>,
    symbols: HashMap<Numbers, u32>,
    is_void: Adaptive,
    residuals: Vec<AdaptiveSymbols>,
}

impl NumberValues {
    /// Creates a coder with the values to be written, or with none.
    pub(crate) fn new(form: TreeType, known: Vec<Numbers>) -> NumberValues {
        let residuals = SIZES * usize::from(form.value.channels);
        let residuals = (0..residuals).map(|at| initial_symbols(at % SIZES)).collect();
        NumberValues { form, known, symbols: HashMap::new(), is_void: Adaptive::default(), residuals }
    }
}

impl NewValues for NumberValues {
    fn new_value<K: BitCoder>(
        &mut self,
        coder: &mut K,
        symbol: u32,
        may_be_void: bool,
        near: &[u32],
    ) -> Option<u32> {
        if may_be_void && coder.bit(&mut self.is_void, symbol == NOTHING) {
            return Some(NOTHING);
        }
        let near = near.iter().filter_map(|symbol| self.known.get(symbol.checked_sub(FIRST_VALUE)? as usize));
        let value = if K::READS { [0; 4] } else { self.known[(symbol - FIRST_VALUE) as usize] };
        let mut coded = [0; 4];
        let mut from_mean = [0; 4];
        for (channel, like) in channel_order(self.form) {
            let numbers = near.clone().map(|near| near[*channel]);
            let count = numbers.clone().count() as i128;
            let sum: i128 = numbers.clone().map(i128::from).sum();
            let mean = sum.checked_div_euclid(count).unwrap_or(0) as i64;
            let (least, most) = (numbers.clone().min().unwrap_or(0), numbers.max().unwrap_or(0));
            // (The range itself is the expected size: see `code_residual`.)
            let size = size_context(most.wrapping_sub(least) as u64);
            let expected = mean.wrapping_add(like.map_or(0, |like| from_mean[like]));
            let contexts = &mut self.residuals[channel * SIZES..][..SIZES];
            let residual = code_residual(coder, contexts, size, value[*channel].wrapping_sub(expected));
            coded[*channel] = expected.wrapping_add(residual);
            from_mean[*channel] = coded[*channel].wrapping_sub(mean);
        }
        if !K::READS {
            return Some(symbol);
        }
        // (Reduces the numbers to the range of the sample type.)
        let coded = numbers(self.form, &bytes(self.form, coded));
        let next = FIRST_VALUE + self.known.len() as u32;
        let symbol = *self.symbols.entry(coded).or_insert(next);
        if symbol == next {
            self.known.push(coded);
        }
        Some(symbol)
    }
}
