//! Entropy coder with adaptive probabilities: rANS (Duda, arXiv:1311.2540) with two 64-bit states
//! that alternate, and 32-bit words.
//!
//! Two states let a processor look up a symbol for one while it still computes the other.
//!
//! One set of functions writes and reads ([`BitCoder`]), so the two directions cannot diverge.
//! Invariant of all these functions: control flow and contexts depend only on what has been coded
//! before, never on what is to be written.

use crate::adaptive::{Adaptive, AdaptiveSymbols};

/// Coder that either writes or reads bits. Functions that use it define both directions at once.
pub(crate) trait BitCoder: Sized {
    /// Whether bits are read. The values passed in are then ignored.
    const READS: bool;

    /// Writes a bit, or reads one.
    fn bit(&mut self, probability: &mut Adaptive, bit: bool) -> bool;
    /// Writes one of [`SYMBOLS`] symbols, or reads one.
    fn symbol(&mut self, probabilities: &mut AdaptiveSymbols, symbol: usize) -> usize;
    /// Writes or reads up to 32 bits that are equally often 0 and 1.
    fn short(&mut self, bits: u32, count: u32) -> u32;

    /// Writes or reads up to 64 bits that are equally often 0 and 1, the lower 32 first.
    #[inline(always)]
    fn raw(&mut self, bits: u64, count: u32) -> u64 {
        if count <= 32 {
            return u64::from(self.short(bits as u32, count));
        }
        let lower = self.short(bits as u32, 32);
        u64::from(self.short((bits >> 32) as u32, count - 32)) << 32 | u64::from(lower)
    }

    /// Writes or reads a number of any size: its bit count, then its bits.
    fn number(&mut self, number: u64) -> u64 {
        let bits = self.raw(u64::from(u64::BITS - number.leading_zeros()), 7).min(64) as u32;
        self.raw(number, bits)
    }

    /// Writes or reads a signed number of any size.
    fn signed(&mut self, number: i64) -> i64 {
        unfold(self.number(fold(number)))
    }
}

/// Moves the sign of a number to the lowest bit, so that small numbers of both signs are small: 2n,
/// or -2n - 1.
#[inline(always)]
pub(crate) fn fold(number: i64) -> u64 {
    (number << 1 ^ number >> 63) as u64
}

/// Reverses [`fold`].
#[inline(always)]
pub(crate) fn unfold(folded: u64) -> i64 {
    (folded >> 1) as i64 ^ -((folded & 1) as i64)
}

/// Minimum state between two symbols.
const LOW: u64 = 1 << 32;
/// Probabilities add up to 2 to the power of this.
const TOTAL_BITS: u32 = 16;

/// Bit writer. Symbols are encoded once all are known, the last one first: each state is a stack,
/// from which a reader takes first what was pushed last.
#[derive(Default)]
pub(crate) struct BitWriter {
    /// Length and start of each symbol's range in 2^16, in reading order.
    parts: Vec<(u16, u16)>,
    /// Raw bits, in words from the lowest bit up, and those that do not fill a word yet.
    raw: Vec<u32>,
    some: u64,
    count: u32,
}

impl BitCoder for BitWriter {
    const READS: bool = false;

    #[inline(always)]
    fn bit(&mut self, probability: &mut Adaptive, bit: bool) -> bool {
        let set = probability.set;
        // (Neither length is 2^16, since probabilities are never 0 or 1.)
        self.parts.push(if bit { (set, 0) } else { (0u16.wrapping_sub(set), set) });
        probability.update(bit);
        bit
    }

    #[inline(always)]
    fn symbol(&mut self, probabilities: &mut AdaptiveSymbols, symbol: usize) -> usize {
        let (start, frequency) = probabilities.part(symbol);
        self.parts.push((frequency as u16, start as u16));
        probabilities.update(symbol);
        symbol
    }

    #[inline(always)]
    fn short(&mut self, bits: u32, count: u32) -> u32 {
        self.some |= u64::from(bits) << self.count;
        self.count += count;
        if self.count >= u32::BITS {
            self.raw.push(self.some as u32);
            self.some >>= u32::BITS;
            self.count -= u32::BITS;
        }
        bits
    }
}

impl BitWriter {
    /// Appends the encoded bytes.
    pub(crate) fn finish(self, bytes: &mut Vec<u8>) {
        let mut words = Vec::with_capacity(self.parts.len() / 16);
        let mut states = [LOW; 2];
        for (number, &(frequency, start)) in self.parts.iter().enumerate().rev() {
            // Invariant: the state is from 2^32 up to 2^64, before and after each symbol. A word is
            // emitted if the state would leave this range, which is exactly where a reader finds
            // its state below 2^32 and takes a word.
            let state = &mut states[number % 2];
            let frequency = u64::from(frequency);
            if *state >= frequency << (64 - TOTAL_BITS) {
                words.push(*state as u32);
                *state >>= 32;
            }
            *state = (*state / frequency) << TOTAL_BITS | (*state % frequency + u64::from(start));
        }
        states.iter().for_each(|state| bytes.extend_from_slice(&state.to_le_bytes()));
        let words = words.iter().rev();
        // (Raw words are read from the end, so their start need not be stored.)
        let last = (self.count > 0).then_some(self.some as u32);
        let words = words.chain(&last).chain(self.raw.iter().rev());
        words.for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
    }
}

/// Bit reader. Zeros follow the end of the bytes, which [`BitReader::is_whole`] reports. The work
/// on an untrusted segment is bounded by the size of its output.
#[derive(Clone, Copy)]
pub(crate) struct BitReader<'b> {
    /// State of the next symbol, and state of the one after it.
    state: u64,
    other: u64,
    rest: &'b [u8],
    is_short: bool,
    /// Raw bits that were taken from the end of `rest`.
    some: u64,
    count: u32,
}

impl<'b> BitReader<'b> {
    /// Creates a reader. Returns `None` if there are too few bytes, or invalid states.
    pub(crate) fn new(bytes: &'b [u8]) -> Option<BitReader<'b>> {
        let (state, rest) = bytes.split_first_chunk()?;
        let (other, rest) = rest.split_first_chunk()?;
        let (state, other) = (u64::from_le_bytes(*state), u64::from_le_bytes(*other));
        let is_state = state >= LOW && other >= LOW;
        is_state.then_some(BitReader { state, other, rest, is_short: false, some: 0, count: 0 })
    }

    /// Removes a symbol with a range of length `frequency` from the state, and switches to the
    /// other state.
    #[inline(always)]
    fn take(&mut self, frequency: u64, above_start: u64) {
        let mut state = frequency * (self.state >> TOTAL_BITS) + above_start;
        if state < LOW {
            state = state << 32 | u64::from(self.word());
        }
        (self.state, self.other) = (self.other, state);
    }

    #[inline(always)]
    fn word(&mut self) -> u32 {
        match self.rest.split_first_chunk() {
            Some((word, rest)) => {
                self.rest = rest;
                u32::from_le_bytes(*word)
            }
            None => {
                self.is_short = true;
                0
            }
        }
    }

    /// Returns whether all bytes were read, no bits were missing, and the final states are those of
    /// a writer.
    pub(crate) fn is_whole(&self) -> bool {
        !self.is_short && self.rest.is_empty() && self.state == LOW && self.other == LOW && self.some == 0
    }
}

impl BitCoder for BitReader<'_> {
    const READS: bool = true;

    #[inline(always)]
    fn bit(&mut self, probability: &mut Adaptive, _: bool) -> bool {
        let set = u64::from(probability.set);
        let low = self.state & 0xffff;
        let bit = low < set;
        let (frequency, start) = if bit { (set, 0) } else { (0x1_0000 - set, set) };
        self.take(frequency, low - start);
        probability.update(bit);
        bit
    }

    #[inline(always)]
    fn symbol(&mut self, probabilities: &mut AdaptiveSymbols, _: usize) -> usize {
        let low = (self.state & 0xffff) as u32;
        let symbol = probabilities.find(low);
        let (start, frequency) = probabilities.part(symbol);
        self.take(u64::from(frequency), u64::from(low - start));
        probabilities.update(symbol);
        symbol
    }

    #[inline(always)]
    fn short(&mut self, _: u32, count: u32) -> u32 {
        if self.count < count {
            let word = match self.rest.split_last_chunk() {
                Some((rest, word)) => {
                    self.rest = rest;
                    u32::from_le_bytes(*word)
                }
                None => {
                    self.is_short = true;
                    0
                }
            };
            self.some |= u64::from(word) << self.count;
            self.count += u32::BITS;
        }
        let bits = self.some & ((1 << count) - 1);
        self.some >>= count;
        self.count -= count;
        bits as u32
    }
}
