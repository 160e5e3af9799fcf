//! Streams of a packed segment's planes: bits of states, and raw bits, each from the lowest bit up.
//!
//! Eight states take turns, sample by sample, so that a processor overlaps the look-up for one with
//! the computation of others. A reader traverses both streams forwards. A writer emits states
//! backwards, since each state is a stack.

use crate::contexts::{Contexts, ESCAPE, FLAT, FlatContexts, MAX_PLANE_CONTEXTS, SYMBOLS};
use crate::lanes::Lane;
use crate::tables::{EncodeTable, Entry, Frequencies, Histogram, STATE_BITS, STATES};
use crate::vectorized::vectorized;

/// Number of states that take turns.
pub(crate) const STATE_COUNT: usize = 8;

/// Returns 64 bits from a bit position on, of which at least 57 are valid. Zeros follow the end.
#[inline(always)]
fn word(bytes: &[u8], bit: usize) -> u64 {
    let at = bit / 8;
    match bytes.get(at..at + 8) {
        Some(word) => u64::from_le_bytes(word.try_into().unwrap_or_default()) >> (bit % 8),
        None => last_word(bytes, bit),
    }
}

#[cold]
#[inline(never)]
fn last_word(bytes: &[u8], bit: usize) -> u64 {
    let rest = bytes.get(bit / 8..).unwrap_or_default();
    let mut word = [0; 8];
    word.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
    u64::from_le_bytes(word) >> (bit % 8)
}

/// Bit writer of the header.
#[derive(Default)]
pub(crate) struct HeaderWriter {
    bytes: Vec<u8>,
    rest: u64,
    count: u32,
}

impl HeaderWriter {
    /// Writes up to 32 bits.
    pub(crate) fn put(&mut self, bits: u64, count: u32) {
        self.rest |= bits << self.count;
        self.count += count;
        while self.count >= 8 {
            self.bytes.push(self.rest as u8);
            self.rest >>= 8;
            self.count -= 8;
        }
    }

    /// Returns the bytes. The last one is padded with zeros.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        if self.count > 0 {
            self.bytes.push(self.rest as u8);
        }
        self.bytes
    }
}

/// Bit reader of the header. Zeros follow the end.
pub(crate) struct HeaderReader<'b> {
    bytes: &'b [u8],
    bit: usize,
}

impl<'b> HeaderReader<'b> {
    pub(crate) fn new(bytes: &'b [u8]) -> HeaderReader<'b> {
        HeaderReader { bytes, bit: 0 }
    }

    /// Reads up to 32 bits.
    pub(crate) fn take(&mut self, count: u32) -> u64 {
        let bits = word(self.bytes, self.bit) & ((1 << count) - 1);
        self.bit += count as usize;
        bits
    }

    /// Returns whether all bytes were read, and the unread bits of the last one are 0.
    pub(crate) fn is_whole(&self) -> bool {
        self.bit.div_ceil(8) == self.bytes.len() && word(self.bytes, self.bit) == 0
    }
}

/// Masks of the lowest 0 to 63 bits: a load is cheaper than a shift by a variable.
static MASKS: [u64; 64] = {
    let mut masks = [0; 64];
    let mut bits = 0;
    while bits < 64 {
        masks[bits] = (1u64 << bits) - 1;
        bits += 1;
    }
    masks
};

/// Reader of both streams.
pub(crate) struct SymbolReader<'b> {
    states: [u32; STATE_COUNT],
    /// Bytes of the states' bits, and the position of the next bit.
    bits: &'b [u8],
    bit: usize,
    /// Bytes of the raw bits, and the position of the next bit.
    raw: &'b [u8],
    raw_bit: usize,
}

impl<'b> SymbolReader<'b> {
    /// Creates a reader of the bytes of [`SymbolWriter::finish`]. Returns `None` if there are too
    /// few.
    pub(crate) fn new(bytes: &'b [u8]) -> Option<SymbolReader<'b>> {
        let (states, rest) = bytes.split_first_chunk::<STATE_COUNT>()?;
        let (length, rest) = rest.split_first_chunk::<4>()?;
        let (skipped, rest) = rest.split_first()?;
        let (bits, raw) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        Some(SymbolReader {
            states: states.map(u32::from),
            bits,
            bit: usize::from(*skipped % 32),
            raw,
            raw_bit: 0,
        })
    }

    /// Returns whether all bits have been read, and the states are 0.
    pub(crate) fn is_whole(&self) -> bool {
        self.states == [0; STATE_COUNT]
            && self.bit == self.bits.len() * 8
            && self.raw_bit.div_ceil(8) == self.raw.len()
            && word(self.raw, self.raw_bit) == 0
    }

    /// Reads a symbol in each context, and returns its meaning: the number of raw bits in the lower
    /// byte, and the upper bits of the number in the upper byte. `entries` has the decoding tables
    /// of all contexts.
    pub(crate) fn meanings(
        &mut self,
        entries: &[Entry; MAX_PLANE_CONTEXTS * STATES],
        flat: FlatContexts,
        contexts: &[u8],
        meanings: &mut [u16],
    ) {
        read_meanings((self.bits, entries), flat, &mut self.bit, &mut self.states, contexts, meanings);
    }

    /// Reads the raw bits of the symbols with these meanings, and completes the numbers.
    pub(crate) fn numbers<T: Lane>(&mut self, meanings: &[u16], numbers: &mut [T]) {
        read_numbers(self.raw, &mut self.raw_bit, meanings, numbers);
    }
}

vectorized! {
    fn read_meanings | read_meanings_baseline | read_meanings_avx2(
        source: (&[u8], &[Entry; MAX_PLANE_CONTEXTS * STATES]),
        flat: FlatContexts,
        position: &mut usize,
        states: &mut [u32; STATE_COUNT],
        contexts: &[u8],
        meanings: &mut [u16],
    ) {
        let (bytes, entries) = source;
        let mut bit = *position;
        let [mut s0, mut s1, mut s2, mut s3, mut s4, mut s5, mut s6, mut s7] = *states;
        // Invariant: states are below 256, since entries add up to less than that whatever bits
        // follow, and zeros follow the end of the bytes. So corrupt bytes yield other symbols, but
        // nothing worse. A word has enough bits for four entries of at most 8 bits each. `sum`
        // accumulates their counts in its lowest byte.
        macro_rules! step {
            ($word:ident, $sum:ident, $state:ident, $context:expr, $meaning:expr) => {
                let at = usize::from($context) << STATE_BITS | $state as usize;
                let entry = entries[at & (MAX_PLANE_CONTEXTS * STATES - 1)];
                $state = (entry >> 24) + ($word & MASKS[entry as usize & 31]) as u32;
                $word >>= entry & 63;
                *$meaning = (entry >> 8) as u16;
                $sum += entry & 255;
            };
        }
        let whole = contexts.len() / FLAT * FLAT;
        let (contexts, last) = contexts.split_at(whole);
        let (meanings, last_meanings) = meanings.split_at_mut(whole);
        for (contexts, meanings) in contexts.chunks_exact(FLAT).zip(meanings.chunks_exact_mut(FLAT)) {
            if contexts == [flat.context; FLAT] {
                let (mut word, mut sum, mut meaning) = (word(bytes, bit), 0, 0);
                step!(word, sum, s0, flat.all, &mut meaning);
                let _ = word;
                bit += sum as usize;
                if meaning == 0 {
                    meanings.fill(0);
                    continue;
                }
            }
            let [t0, t1, t2, t3, t4, t5, t6, t7] = meanings else { continue };
            let (mut first, mut sum) = (word(bytes, bit), 0);
            step!(first, sum, s0, contexts[0], t0);
            step!(first, sum, s1, contexts[1], t1);
            step!(first, sum, s2, contexts[2], t2);
            step!(first, sum, s3, contexts[3], t3);
            bit += sum as usize;
            let (mut second, mut sum) = (word(bytes, bit), 0);
            step!(second, sum, s4, contexts[4], t4);
            step!(second, sum, s5, contexts[5], t5);
            step!(second, sum, s6, contexts[6], t6);
            step!(second, sum, s7, contexts[7], t7);
            bit += sum as usize;
            let _ = (first, second);
        }
        for (context, meaning) in last.iter().zip(last_meanings) {
            let (mut word, mut sum) = (word(bytes, bit), 0);
            step!(word, sum, s0, *context, meaning);
            let _ = word;
            bit += sum as usize;
        }
        *position = bit;
        *states = [s0, s1, s2, s3, s4, s5, s6, s7];
    }
}

vectorized! {
    fn read_numbers | read_numbers_baseline | read_numbers_avx2<T>(
        bytes: &[u8],
        position: &mut usize,
        meanings: &[u16],
        numbers: &mut [T],
    ) {
        let mut bit = *position;
        let numbers = &mut numbers[..meanings.len()];
        // Numbers whose raw bits all fit into one word.
        macro_rules! some {
            ($($at:literal)*, $meanings:ident, $numbers:ident) => {
                let (mut word, mut sum) = (word(bytes, bit), 0);
                $({
                    let meaning = $meanings[$at];
                    let count = usize::from(meaning & 63);
                    let upper = u64::from(meaning >> 8) << count;
                    $numbers[$at] = T::from_i64((upper | word & MASKS[count]) as i64);
                    word >>= count;
                    sum += count;
                })*
                let _ = word;
                bit += sum;
            };
        }
        let one = |meaning: u16, bit: &mut usize| {
            let count = usize::from(meaning & 255);
            let above = u64::from(meaning >> 8).checked_shl(count as u32).unwrap_or(0);
            // (Two halves, the lower one first.)
            let lower = word(bytes, *bit) & MASKS[count.min(32)];
            let upper = word(bytes, *bit + 32) & MASKS[count.saturating_sub(32) % 64];
            *bit += count;
            T::from_i64((above | upper << 32 | lower) as i64)
        };
        let (eights, last) = meanings.as_chunks::<FLAT>();
        let (eight_numbers, last_numbers) = numbers.as_chunks_mut::<FLAT>();
        for (meanings, numbers) in eights.iter().zip(eight_numbers) {
            let four = |at: usize| {
                let [a, b, c, d] = [0, 1, 2, 3].map(|next| u64::from(meanings[at + next]));
                a | b << 16 | c << 32 | d << 48
            };
            // Union of the raw bit counts of all eight numbers, in four 16-bit lanes: an upper
            // bound for the tests below.
            let counts = (four(0) | four(4)) & 0x00ff_00ff_00ff_00ff;
            if counts == 0 {
                for (number, meaning) in numbers.iter_mut().zip(meanings) {
                    *number = T::from_i64((meaning >> 8).into());
                }
            } else if counts & 0x00f8_00f8_00f8_00f8 == 0 {
                some!(0 1 2 3 4 5 6 7, meanings, numbers);
            } else if T::BITS == 16 || counts & 0x00f0_00f0_00f0_00f0 == 0 {
                some!(0 1 2, meanings, numbers);
                some!(3 4 5, meanings, numbers);
                some!(6 7, meanings, numbers);
            } else {
                for (number, meaning) in numbers.iter_mut().zip(meanings) {
                    *number = one(*meaning, &mut bit);
                }
            }
        }
        last_numbers.iter_mut().zip(last).for_each(|(number, meaning)| *number = one(*meaning, &mut bit));
        *position = bit;
    }
}

/// Numbers of a channel to be written, in reading order.
#[derive(Default)]
pub(crate) struct Planes<T> {
    contexts: Vec<u8>,
    numbers: Vec<T>,
    symbols: Vec<u8>,
    /// End of each plane, and its context of minimum uncertainty.
    ends: Vec<(usize, FlatContexts)>,
}

impl<T: Lane> Planes<T> {
    /// Adds folded numbers of a plane, and their contexts.
    pub(crate) fn push(&mut self, contexts: &[u8], numbers: impl Iterator<Item = T>) {
        self.contexts.extend_from_slice(contexts);
        self.numbers.extend(numbers);
    }

    /// Ends a plane.
    pub(crate) fn end(&mut self, flat: FlatContexts) {
        self.ends.push((self.contexts.len(), flat));
    }

    /// Removes all planes, but keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.contexts.clear();
        self.numbers.clear();
        self.symbols.clear();
        self.ends.clear();
    }

    /// Returns the ranges of the planes.
    fn ranges(&self) -> Vec<(std::ops::Range<usize>, FlatContexts)> {
        let starts = std::iter::once(0).chain(self.ends.iter().map(|(end, _)| *end));
        starts.zip(&self.ends).map(|(start, (end, flat))| (start..*end, *flat)).collect()
    }

    /// Computes the symbols of all numbers, and counts them by context.
    pub(crate) fn count(&mut self) -> Box<[Histogram; MAX_PLANE_CONTEXTS]> {
        let mut histograms = Box::new([[0; SYMBOLS]; MAX_PLANE_CONTEXTS]);
        let noises: [u32; MAX_PLANE_CONTEXTS] =
            std::array::from_fn(|at| if at < Contexts::<T>::COUNT { Contexts::<T>::noise(at) } else { 0 });
        let first_sum = 2 * Contexts::<T>::SIZES;
        self.symbols.clear();
        self.symbols.resize(self.contexts.len(), 0);
        for (range, flat) in self.ranges() {
            let (contexts, numbers) = (&self.contexts[range.clone()], &self.numbers[range.clone()]);
            let symbols = &mut self.symbols[range];
            let eights = contexts.chunks(FLAT).zip(numbers.chunks(FLAT)).zip(symbols.chunks_mut(FLAT));
            for ((contexts, numbers), symbols) in eights {
                if contexts == [flat.context; FLAT] {
                    let is_other = usize::from(!is_zero(numbers));
                    histograms[usize::from(flat.all)][is_other] += 1;
                    if is_other == 0 {
                        continue;
                    }
                }
                for ((context, number), symbol) in contexts.iter().zip(numbers).zip(symbols) {
                    let context = usize::from(*context);
                    *symbol = if context >= first_sum {
                        Contexts::<T>::sum_symbol(number.bits())
                    } else {
                        Contexts::<T>::residual_symbol(number.bits(), noises[context])
                    };
                    histograms[context][usize::from(*symbol) % SYMBOLS] += 1;
                }
            }
        }
        histograms
    }
}

fn is_zero<T: Lane>(numbers: &[T]) -> bool {
    numbers.iter().fold(T::default(), |all, number| all.or(*number)) == T::default()
}

/// Writer of both streams: raw bits in order, then states from the last channel to the first.
///
/// Invariant: states are written in exactly the reverse of the reading order: channels, planes,
/// eights of samples, then samples of an eight. The symbol that codes eight samples at once is
/// written after them. (These eights are not the groups of blocks of [`crate::groups`].)
#[derive(Default)]
pub(crate) struct SymbolWriter {
    raw: Vec<u32>,
    raw_rest: u64,
    raw_count: u32,
    words: Vec<u32>,
    rest: u64,
    count: u32,
    states: Option<[u32; STATE_COUNT]>,
}

impl SymbolWriter {
    /// Writes the raw bits of a channel whose numbers have been counted. Symbols without a code in
    /// their table become escapes.
    pub(crate) fn raw<T: Lane>(&mut self, planes: &mut Planes<T>, tables: &[Frequencies]) {
        // Per context and symbol: the symbol that is coded, and the number of its raw bits.
        let mut coded = Box::new([[(0u8, 0u8); SYMBOLS]; MAX_PLANE_CONTEXTS]);
        for (context, (coded, table)) in coded.iter_mut().zip(tables).enumerate() {
            for (symbol, coded) in coded.iter_mut().enumerate() {
                let symbol = if table[symbol] == 0 { ESCAPE } else { symbol };
                *coded = (symbol as u8, Contexts::<T>::meaning(context, symbol).1 as u8);
            }
        }
        let (mut rest, mut filled) = (self.raw_rest, self.raw_count);
        let words = &mut self.raw;
        let mut put = |bits: u64, count: u32| {
            rest |= (bits & ((1 << count) - 1)) << filled;
            filled += count;
            if filled >= 32 {
                words.push(rest as u32);
                rest >>= 32;
                filled -= 32;
            }
        };
        for (range, flat) in planes.ranges() {
            let (contexts, numbers) = (&planes.contexts[range.clone()], &planes.numbers[range.clone()]);
            let symbols = &mut planes.symbols[range];
            let eights = contexts.chunks(FLAT).zip(numbers.chunks(FLAT)).zip(symbols.chunks_mut(FLAT));
            for ((contexts, numbers), symbols) in eights {
                if contexts == [flat.context; FLAT] && is_zero(numbers) {
                    continue;
                }
                for ((context, number), symbol) in contexts.iter().zip(numbers).zip(symbols) {
                    let (code, count) = coded[usize::from(*context)][usize::from(*symbol) % SYMBOLS];
                    *symbol = code;
                    let (bits, count) = (number.bits(), u32::from(count));
                    if T::BITS > 32 && count > 32 {
                        put(bits, 32);
                        put(bits >> 32, count - 32);
                    } else {
                        put(bits, count);
                    }
                }
            }
        }
        (self.raw_rest, self.raw_count) = (rest, filled);
    }

    /// Writes the states of a channel, the last one first.
    #[inline(never)]
    pub(crate) fn states<T: Lane>(&mut self, planes: &Planes<T>, tables: &[Frequencies]) {
        let mut used = [false; MAX_PLANE_CONTEXTS];
        planes.contexts.iter().for_each(|context| used[usize::from(*context)] = true);
        planes.ends.iter().for_each(|(_, flat)| used[usize::from(flat.all)] = true);
        let mut all = vec![EncodeTable::EMPTY; MAX_PLANE_CONTEXTS];
        for ((table, frequencies), _) in all.iter_mut().zip(tables).zip(used).filter(|(_, used)| *used) {
            *table = EncodeTable::new(frequencies);
        }
        let Ok(tables) = <&[EncodeTable; MAX_PLANE_CONTEXTS]>::try_from(&all[..]) else { return };
        let mut states = self.states.unwrap_or([STATES as u32; STATE_COUNT]);
        let (mut rest, mut count) = (self.rest, self.count);
        let words = &mut self.words;
        macro_rules! put {
            ($context:expr, $symbol:expr, $state:expr) => {
                let before = $state;
                let bits = tables[usize::from($context)].back($symbol, &mut $state);
                rest = rest << bits | u64::from(before) & MASKS[bits as usize];
                count += bits;
            };
        }
        macro_rules! flush {
            () => {
                if count >= 32 {
                    count -= 32;
                    words.push((rest >> count) as u32);
                }
            };
        }
        for (range, flat) in planes.ranges().into_iter().rev() {
            let (contexts, numbers) = (&planes.contexts[range.clone()], &planes.numbers[range.clone()]);
            let symbols = &planes.symbols[range];
            let whole = contexts.len() / FLAT * FLAT;
            for (context, symbol) in contexts[whole..].iter().zip(&symbols[whole..]).rev() {
                put!(*context, *symbol, states[0]);
                flush!();
            }
            let eights =
                contexts.chunks_exact(FLAT).zip(numbers.chunks_exact(FLAT)).zip(symbols.chunks_exact(FLAT));
            for ((contexts, numbers), symbols) in eights.rev() {
                let is_flat = contexts == [flat.context; FLAT];
                let is_other = !is_flat || !is_zero(numbers);
                if is_other {
                    for lane in (0..STATE_COUNT).rev() {
                        put!(contexts[lane], symbols[lane], states[lane]);
                        if lane % 2 == 0 {
                            flush!();
                        }
                    }
                }
                if is_flat {
                    put!(flat.all, u8::from(is_other), states[0]);
                    flush!();
                }
            }
        }
        (self.states, self.rest, self.count) = (Some(states), rest, count);
    }

    /// Returns the bytes of both streams.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        let states = self.states.unwrap_or([STATES as u32; STATE_COUNT]);
        let mut bytes = states.map(|state| state as u8).to_vec();
        // (The first bits of the first word are not used.)
        let skipped = (32 - self.count) % 32;
        if self.count > 0 {
            self.words.push((self.rest << skipped) as u32);
        }
        bytes.extend_from_slice(&(4 * self.words.len() as u32).to_le_bytes());
        bytes.push(skipped as u8);
        self.words.iter().rev().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
        self.raw.iter().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
        bytes.extend_from_slice(&self.raw_rest.to_le_bytes()[..self.raw_count.div_ceil(8) as usize]);
        bytes
    }
}
