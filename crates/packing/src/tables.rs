//! Coding tables of contexts: tANS (Duda, arXiv:1311.2540) with 256 states.

use crate::contexts::{Contexts, ESCAPE, Kind, MAX_PLANE_CONTEXTS, SYMBOLS};
use crate::defaults;
use crate::lanes::Lane;
use crate::symbols::{HeaderReader, HeaderWriter};

/// Bits of a state.
pub(crate) const STATE_BITS: u32 = 8;
/// Number of states of a table, and sum of the frequencies of its symbols.
pub(crate) const STATES: usize = 1 << STATE_BITS;

/// Number of states of each symbol of a table.
pub(crate) type Frequencies = [u16; SYMBOLS];
/// Number of occurrences of each symbol.
pub(crate) type Histogram = [u32; SYMBOLS];

/// Returns the state of a table's slot. Slots of one symbol are consecutive; their states are
/// spread evenly.
#[inline(always)]
fn spread(part: usize) -> usize {
    part.wrapping_mul(STATES / 2 + STATES / 8 + 3) & (STATES - 1)
}

/// Returns the symbol of each state.
fn symbols(frequencies: &Frequencies) -> [u8; STATES] {
    let (mut symbols, mut part) = ([0; STATES], 0);
    for (symbol, count) in (0u8..).zip(frequencies) {
        for _ in 0..*count {
            symbols[spread(part)] = symbol;
            part += 1;
        }
    }
    symbols
}

/// Entry of a decoding table. From the lowest byte up: number of state bits to read, number of raw
/// bits, upper bits of the number, and the next state before the state bits are added.
pub(crate) type Entry = u32;

/// Builds a decoding table.
pub(crate) fn write_entries<T: Lane>(frequencies: &Frequencies, context: usize, entries: &mut [Entry]) {
    let meanings: [u32; SYMBOLS] = std::array::from_fn(|symbol| {
        let (upper, lower) = Contexts::<T>::meaning(context, symbol);
        lower << 8 | upper << 16
    });
    let mut next = frequencies.map(u32::from);
    for (entry, symbol) in entries.iter_mut().zip(symbols(frequencies)) {
        let symbol = usize::from(symbol) % SYMBOLS;
        let state = next[symbol].max(1);
        next[symbol] += 1;
        let bits = STATE_BITS.wrapping_sub(state.ilog2()) & 15;
        *entry = ((state << bits) & (STATES as u32 - 1)) << 24 | meanings[symbol] | bits;
    }
}

/// Encoding table.
#[derive(Clone)]
pub(crate) struct EncodeTable {
    /// States of each symbol, symbol by symbol.
    states: [u16; STATES],
    /// Per symbol: the index of its first state, less its frequency.
    first: [i16; SYMBOLS],
    /// Per symbol: what is added to a state so that the upper 16 bits are the number of bits to
    /// write.
    bits: [u32; SYMBOLS],
}

impl EncodeTable {
    /// Table without symbols.
    pub(crate) const EMPTY: EncodeTable =
        EncodeTable { states: [0; STATES], first: [0; SYMBOLS], bits: [0; SYMBOLS] };

    pub(crate) fn new(frequencies: &Frequencies) -> EncodeTable {
        let mut table = EncodeTable::EMPTY;
        let mut next = [0; SYMBOLS];
        let mut start = 0;
        for (symbol, count) in frequencies.iter().enumerate() {
            next[symbol] = start;
            table.first[symbol] = start as i16 - *count as i16;
            start += usize::from(*count);
            if let Some(less) = count.checked_sub(1) {
                // Writing this many bits brings a state into the range from `count` to less than
                // twice that. It takes `most` bits, or one fewer.
                let most = STATE_BITS - less.checked_ilog2().unwrap_or(0);
                table.bits[symbol] = (most << 16).wrapping_sub(u32::from(*count) << most);
            }
        }
        for (state, symbol) in symbols(frequencies).into_iter().enumerate() {
            let symbol = usize::from(symbol);
            table.states[next[symbol] % STATES] = (STATES + state) as u16;
            next[symbol] += 1;
        }
        table
    }

    /// Replaces a state by its predecessor, by a symbol. Returns how many of the state's lowest
    /// bits must be written.
    #[inline(always)]
    pub(crate) fn back(&self, symbol: u8, state: &mut u32) -> u32 {
        let symbol = usize::from(symbol) % SYMBOLS;
        let bits = state.wrapping_add(self.bits[symbol]) >> 16 & 31;
        let at = (*state >> bits) as i32 + i32::from(self.first[symbol]);
        *state = u32::from(self.states[at as usize % STATES]);
        bits
    }
}

/// Bits of the weight of a symbol in a stored table.
const TABLE_WEIGHT_BITS: u32 = 5;
/// Weights that symbols may have: four per doubling.
const TABLE_WEIGHTS: [u32; 1 << TABLE_WEIGHT_BITS] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192,
    224, 256, 320, 384, 448,
];
/// Weight of the most frequent symbol of a stored table.
const MAX_TABLE_WEIGHT: u64 = 256;

/// Converts weights to frequencies that add up to [`STATES`]. A symbol with a weight other than 0
/// has at least 1. The largest frequency absorbs the rounding error.
pub(crate) fn of_weights(weights: &[u8; SYMBOLS]) -> Frequencies {
    let weights = weights.map(|weight| TABLE_WEIGHTS[usize::from(weight) % TABLE_WEIGHTS.len()]);
    let sum: u32 = weights.iter().sum();
    let mut frequencies = [0; SYMBOLS];
    if sum == 0 {
        frequencies[0] = STATES as u16;
        return frequencies;
    }
    let (mut rest, mut most) = (STATES as i32, 0);
    for (symbol, weight) in weights.into_iter().enumerate() {
        if weight > 0 {
            frequencies[symbol] = ((weight * STATES as u32 + sum / 2) / sum).max(1) as u16;
            rest -= i32::from(frequencies[symbol]);
        }
        if frequencies[symbol] > frequencies[most] {
            most = symbol;
        }
    }
    // Invariant: the largest frequency is at least a sixteenth of all states, and the others gain
    // less than that by rounding up.
    frequencies[most] = (i32::from(frequencies[most]) + rest).max(1) as u16;
    frequencies
}

/// Returns the weights that fit a histogram best. Rare symbols (below one in 1024) become escapes.
fn to_weights<T: Lane>(context: usize, histogram: &Histogram) -> [u8; SYMBOLS] {
    let mut histogram = histogram.map(u64::from);
    let all: u64 = histogram.iter().sum();
    if !matches!(Contexts::<T>::kind(context), Kind::Flat(_)) {
        for symbol in 0..ESCAPE {
            if histogram[symbol] * 1024 < all {
                histogram[ESCAPE] += std::mem::take(&mut histogram[symbol]);
            }
        }
    }
    let most = histogram.iter().copied().max().unwrap_or(1).max(1);
    histogram.map(|count| {
        if count == 0 {
            return 0;
        }
        // Nearest by ratio: up to the geometric mean of this weight and the next one.
        let scaled = count * MAX_TABLE_WEIGHT;
        let nearest = (1..TABLE_WEIGHTS.len() - 1).find(|at| {
            let between = u128::from(TABLE_WEIGHTS[*at]) * u128::from(TABLE_WEIGHTS[at + 1]);
            u128::from(scaled) * u128::from(scaled) < between * u128::from(most) * u128::from(most)
        });
        nearest.unwrap_or(TABLE_WEIGHTS.len() - 1) as u8
    })
}

/// Returns the size of the symbols of a histogram with some frequencies, in units of
/// 2^-[`COST_BITS`] bits. Returns `None` if a symbol has no code.
fn cost<T: Lane>(context: usize, histogram: &Histogram, frequencies: &Frequencies) -> Option<u64> {
    let mut sum = 0;
    for (symbol, count) in histogram.iter().enumerate().filter(|(_, count)| **count > 0) {
        let (coded, more) = match frequencies[symbol] {
            0 if matches!(Contexts::<T>::kind(context), Kind::Flat(_)) => return None,
            0 => (frequencies[ESCAPE], T::BITS - Contexts::<T>::meaning(context, symbol).1.min(T::BITS)),
            frequency => (frequency, 0),
        };
        if coded == 0 {
            return None;
        }
        let bits = (u64::from(STATE_BITS + more) << COST_BITS) - LOGS[usize::from(coded)];
        sum += u64::from(*count) * bits;
    }
    Some(sum)
}

/// Fraction bits of costs and of [`LOGS`].
const COST_BITS: u32 = 12;
/// Logarithms of frequencies to base 2, computed bit by bit: for a number in [1, 2), the next bit
/// is set if its square is 2 or more.
const LOGS: [u64; STATES + 1] = {
    const ONE: u64 = 1 << 30;
    let mut logs = [0; STATES + 1];
    let mut number = 1;
    while number <= STATES {
        let whole = number.ilog2();
        let mut rest = ((number as u64) << 30) >> whole;
        let mut log = whole as u64;
        let mut bit = 0;
        while bit < COST_BITS {
            rest = (rest * rest) >> 30;
            let is_set = rest >= 2 * ONE;
            log = log << 1 | is_set as u64;
            rest >>= is_set as u32;
            bit += 1;
        }
        logs[number] = log;
        number += 1;
    }
    logs
};

/// Tables of all contexts of a channel.
pub(crate) type Tables = Vec<Frequencies>;

/// Chooses the tables of a channel, and writes those that are not the default.
pub(crate) fn choose<T: Lane>(
    histograms: &[Histogram; MAX_PLANE_CONTEXTS],
    header: &mut HeaderWriter,
) -> Tables {
    let defaults = defaults::tables::<T>();
    let chosen: Vec<Option<[u8; SYMBOLS]>> = (0..Contexts::<T>::COUNT)
        .map(|context| {
            let histogram = &histograms[context];
            if histogram.iter().all(|count| *count == 0) {
                return None;
            }
            let weights = to_weights::<T>(context, histogram);
            let bits = TABLE_WEIGHT_BITS * (last(&weights) + 1) + 4;
            let own = cost::<T>(context, histogram, &of_weights(&weights))
                .map(|cost| cost + (u64::from(bits) << COST_BITS));
            let default = cost::<T>(context, histogram, &defaults[context]);
            // (At least one of them has codes for all symbols: `own`.)
            let is_better = match (own, default) {
                (Some(own), Some(default)) => own < default,
                (own, _) => own.is_some(),
            };
            is_better.then_some(weights)
        })
        .collect();
    let count = chosen.iter().rposition(Option::is_some).map_or(0, |last| last + 1);
    header.put(count as u64, 8);
    for weights in &chosen[..count] {
        header.put(weights.is_some().into(), 1);
        if let Some(weights) = weights {
            header.put(last(weights).into(), 4);
            weights[..=last(weights) as usize]
                .iter()
                .for_each(|weight| header.put((*weight).into(), TABLE_WEIGHT_BITS));
        }
    }
    chosen
        .iter()
        .zip(defaults)
        .map(|(weights, default)| weights.as_ref().map_or(*default, of_weights))
        .collect()
}

/// Returns the last symbol whose weight is not 0.
fn last(weights: &[u8; SYMBOLS]) -> u32 {
    weights.iter().rposition(|weight| *weight > 0).unwrap_or(0) as u32
}

/// Reads the tables of a channel, by context; `None` for the default.
pub(crate) fn read<T: Lane>(header: &mut HeaderReader<'_>) -> Vec<Option<Frequencies>> {
    let count = (header.take(8) as usize).min(Contexts::<T>::COUNT);
    let mut tables = vec![None; Contexts::<T>::COUNT];
    for table in &mut tables[..count] {
        if header.take(1) == 1 {
            let mut weights = [0; SYMBOLS];
            let last = header.take(4) as usize;
            weights[..=last].iter_mut().for_each(|weight| *weight = header.take(TABLE_WEIGHT_BITS) as u8);
            *table = Some(of_weights(&weights));
        }
    }
    tables
}
