//! Columns of at least a few thousand numbers, coded as tokens: fast, with probabilities that are
//! counted in advance.
//!
//! A number is split into a *token*, which determines its approximate magnitude, and the remaining
//! bits. Tokens are coded by rANS (Duda, arXiv:1311.2540) with two 32-bit states that alternate.
//! Their probabilities, in units of 2^-12, precede them. The remaining bits are stored raw. Each
//! *context* has its own probabilities; a reader must know each number's context before its token.

use crate::bits::{fold, unfold};
use crate::fixed_log::{LOG_BITS, log2};

/// Maximum number of contexts.
pub const MAX_CONTEXTS: usize = 8;

/// Probabilities add up to 2 to the power of this.
const TOTAL_BITS: u32 = 12;
const TOTAL: u32 = 1 << TOTAL_BITS;
/// Minimum state between two tokens.
const LOW: u32 = 1 << 16;

/// Numbers of at most this many bits have a token each. Fine tokens suit numbers of which some are
/// frequent while their neighbours are not, such as times between pulses.
const COARSE: u32 = 4;
const FINE: u32 = 9;
/// Maximum number of tokens.
const TOKENS: usize = tokens(FINE);

/// Returns the number of tokens that cover all numbers.
const fn tokens(fineness: u32) -> usize {
    (1 << fineness) + 4 * (64 - fineness as usize)
}

/// Returns the token of a number, and the number of remaining bits.
#[inline(always)]
fn token_of(number: u64, fineness: u32) -> (u16, u32) {
    if number < 1 << fineness {
        return (number as u16, 0);
    }
    // Four tokens for each power of two: 16, 20, 24, 28; 32, 40, ...
    let highest = 63 - number.leading_zeros();
    let rest = highest - 2;
    let token = (1 << fineness) + (highest - fineness) * 4 + (number >> rest) as u32 - 4;
    (token as u16, rest)
}

/// Returns the smallest number of a token, and the number of remaining bits.
#[inline(always)]
fn number_of(token: u16, fineness: u32) -> (u64, u32) {
    let token = u32::from(token);
    let Some(above) = token.checked_sub(1 << fineness) else { return (token.into(), 0) };
    let rest = above / 4 + fineness - 2;
    (u64::from(4 + above % 4) << rest, rest)
}

/// Bit writer, from the lowest bit of each byte up.
#[derive(Default)]
struct Bits {
    bytes: Vec<u8>,
    some: u64,
    count: u32,
}

impl Bits {
    #[inline(always)]
    fn put(&mut self, bits: u64, count: u32) {
        if count > 32 {
            self.put_short(bits & 0xffff_ffff, 32);
            return self.put_short(bits >> 32, count - 32);
        }
        self.put_short(bits, count);
    }

    #[inline(always)]
    fn put_short(&mut self, bits: u64, count: u32) {
        // Invariant: fewer than 32 bits are pending, so 32 more fit.
        self.some |= bits << self.count;
        self.count += count;
        if self.count >= 32 {
            self.bytes.extend_from_slice(&(self.some as u32).to_le_bytes());
            self.some >>= 32;
            self.count -= 32;
        }
    }

    fn finish(mut self) -> Vec<u8> {
        let left = self.count.div_ceil(8) as usize;
        self.bytes.extend_from_slice(&self.some.to_le_bytes()[..left]);
        self.bytes
    }
}

/// Reader of [`Bits`]. Zeros follow the last byte, which [`BitSlice::is_whole`] reports.
struct BitSlice<'b> {
    rest: &'b [u8],
    some: u64,
    count: u32,
    is_short: bool,
}

impl<'b> BitSlice<'b> {
    fn new(rest: &'b [u8]) -> BitSlice<'b> {
        BitSlice { rest, some: 0, count: 0, is_short: false }
    }

    #[inline(always)]
    fn take(&mut self, count: u32) -> u64 {
        if count > 32 {
            let low = self.take(32);
            return low | self.take(count - 32) << 32;
        }
        if self.count < count {
            self.fill();
        }
        let bits = self.some & ((1 << count) - 1);
        self.some >>= count;
        self.count -= count;
        bits
    }

    #[inline(always)]
    fn fill(&mut self) {
        if let Some((word, rest)) = self.rest.split_first_chunk() {
            self.some |= u64::from(u32::from_le_bytes(*word)) << self.count;
            self.rest = rest;
        } else {
            self.is_short |= self.rest.is_empty();
            let mut word = [0; 4];
            word[..self.rest.len()].copy_from_slice(self.rest);
            self.some |= u64::from(u32::from_le_bytes(word)) << self.count;
            self.rest = &[];
        }
        self.count += 32;
    }

    /// Returns whether no bits were missing, and no byte is left.
    fn is_whole(&self) -> bool {
        !self.is_short && self.rest.is_empty()
    }
}

/// Probabilities of the tokens of one context.
struct Table {
    frequencies: Vec<u16>,
}

impl Table {
    /// Computes the probabilities nearest to token counts. Each token that occurs has a frequency
    /// of at least 1.
    fn of_counts(counts: &[u32]) -> Table {
        let all: u64 = counts.iter().map(|count| u64::from(*count)).sum();
        let mut frequencies = vec![0u16; counts.len()];
        let mut left = i64::from(TOTAL);
        for (frequency, count) in frequencies.iter_mut().zip(counts) {
            if *count > 0 {
                let part = (u64::from(*count) * u64::from(TOTAL) + all / 2) / all;
                *frequency = part.clamp(1, u64::from(TOTAL)) as u16;
                left -= i64::from(*frequency);
            }
        }
        // The rounding error is added to, or taken from, the most frequent tokens. (There are fewer
        // tokens than [`TOTAL`], so one has more than 1.)
        while left != 0 && all > 0 {
            let most = (0..counts.len())
                .max_by_key(|token| (frequencies[*token], TOKENS - token))
                .unwrap_or_default();
            let change = left.clamp(-i64::from(frequencies[most] / 2).max(1), i64::from(TOTAL));
            frequencies[most] = (i64::from(frequencies[most]) + change) as u16;
            left -= change;
        }
        Table { frequencies }
    }

    /// Writes the first and the last token that occur, and each frequency in between: its bit
    /// count, then all bits but the highest. After a frequency of 0 comes the number of further
    /// zeros, up to 15.
    fn write(&self, bits: &mut Bits) {
        let is_there = |token: &usize| self.frequencies[*token] > 0;
        let Some(first) = (0..self.frequencies.len()).find(is_there) else {
            // (The last token before the first: there are none.)
            return bits.put(1, 20);
        };
        let last = (0..self.frequencies.len()).rev().find(is_there).unwrap_or(first);
        bits.put((first | last << 10) as u64, 20);
        let mut rest = &self.frequencies[first..=last];
        while let Some((frequency, others)) = rest.split_first() {
            rest = others;
            let length = u16::BITS - frequency.leading_zeros();
            bits.put(length.into(), 4);
            if length == 0 {
                let more = rest.iter().take(15).take_while(|frequency| **frequency == 0).count();
                bits.put(more as u64, 4);
                rest = &rest[more..];
            } else if length > 1 {
                bits.put(u64::from(*frequency) & ((1 << (length - 1)) - 1), length - 1);
            }
        }
    }

    /// Reads what [`Table::write`] wrote. Returns `None` if the frequencies do not add up to
    /// [`TOTAL`].
    fn read(bits: &mut BitSlice<'_>, fineness: u32) -> Option<Table> {
        let mut frequencies = vec![0; tokens(fineness)];
        let (first, last) = (bits.take(10) as usize, bits.take(10) as usize);
        if (first, last) == (1, 0) {
            return Some(Table { frequencies });
        }
        let mut sum = 0;
        let mut rest = frequencies.get_mut(first..=last)?.iter_mut();
        while let Some(frequency) = rest.next() {
            let length = bits.take(4) as u32;
            if length == 0 {
                let more = bits.take(4) as usize;
                rest.by_ref().take(more).for_each(drop);
                continue;
            }
            let number = 1 << (length - 1) | bits.take(length - 1);
            *frequency = u16::try_from(number).ok().filter(|number| u32::from(*number) <= TOTAL)?;
            sum += u32::from(*frequency);
        }
        (sum == TOTAL).then_some(Table { frequencies })
    }
}

/// Constants for encoding a token.
#[derive(Clone, Copy, Default)]
struct SymbolRange {
    frequency: u32,
    start: u32,
    /// 2^44 divided by the frequency, rounded up.
    reciprocal: u64,
}

impl SymbolRange {
    /// Computes the constants of all tokens.
    fn all(table: &Table) -> Vec<SymbolRange> {
        let mut start = 0;
        let place = |frequency: &u16| {
            // (A small block has few of all tokens, and a division costs more than everything else
            // here.)
            if *frequency == 0 {
                return SymbolRange::default();
            }
            let frequency = u32::from(*frequency);
            let own = start;
            start += frequency;
            let reciprocal = (1u64 << 44).div_ceil(u64::from(frequency));
            SymbolRange { frequency, start: own, reciprocal }
        };
        table.frequencies.iter().map(place).collect()
    }

    /// Returns the state after this token.
    #[inline(always)]
    fn after(&self, state: u32) -> u32 {
        // Exact: the reciprocal times the frequency exceeds 2^44 by less than 2^12, and the state
        // is below 2^32.
        let whole = ((u128::from(state) * u128::from(self.reciprocal)) >> 44) as u32;
        (whole << TOTAL_BITS) + (state - whole * self.frequency + self.start)
    }
}

/// Token counts by context, for `below` tokens each.
struct Counts {
    counts: Vec<u32>,
    below: usize,
}

impl Counts {
    /// Counts fine tokens. Replaces each by its index among the tokens of all contexts.
    fn of(tokens: &mut [u16], contexts: &[u8]) -> Counts {
        let below = number_of_kinds(tokens.iter().copied());
        // (At most 8 times 732: the indices fit into 16 bits.)
        for (token, context) in tokens.iter_mut().zip(contexts) {
            *token += u16::from(*context) * below as u16;
        }
        let mut counts = vec![0; number_of_kinds(contexts.iter().map(|context| u16::from(*context))) * below];
        tokens.iter().for_each(|token| counts[usize::from(*token)] += 1);
        Counts { counts, below }
    }

    /// Returns the counts of coarse tokens.
    fn coarser(&self) -> Counts {
        let mut coarser = vec![0; self.counts.len()];
        for (own, all) in coarser.chunks_mut(self.below).zip(self.counts.chunks(self.below)) {
            for (token, count) in all.iter().enumerate().filter(|(_, count)| **count > 0) {
                own[usize::from(coarse_token(token as u16))] += count;
            }
        }
        Counts { counts: coarser, below: self.below }
    }

    /// Estimates the size of tokens, probabilities and remaining bits, in units of 2^-[`LOG_BITS`]
    /// bits.
    fn cost(&self, fineness: u32) -> u64 {
        let mut bits = 0;
        for counts in self.counts.chunks(self.below) {
            let all: u64 = counts.iter().map(|count| u64::from(*count)).sum();
            for (token, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
                let (_, rest) = number_of(token as u16, fineness);
                let count = u64::from(*count);
                bits += count * (log2(all) - log2(count)) + ((count * u64::from(rest) + 9) << LOG_BITS);
            }
        }
        bits
    }
}

/// Returns the maximum of some numbers plus 1; 1 if there are none.
fn number_of_kinds(numbers: impl Iterator<Item = u16>) -> usize {
    // (`max` of an iterator would compare references, one by one.)
    usize::from(numbers.fold(0, u16::max)) + 1
}

/// Returns the coarse token of the smallest number of a fine one.
fn coarse_token(fine: u16) -> u16 {
    token_of(number_of(fine, FINE).0, COARSE).0
}

/// Appends numbers, each coded in its context. A reader must know how many numbers there are, and
/// the context of each.
///
/// `contexts` has a number below [`MAX_CONTEXTS`] for each number. If it is empty, all numbers are
/// in context 0.
///
/// ```
/// # use spinney_packing::{pack_numbers, unpack_numbers};
/// let numbers = [3, -5, 1 << 40, 0];
/// let mut bytes = Vec::new();
/// pack_numbers(&numbers, &[], &mut bytes);
/// let mut found = [0; 4];
/// let rest = unpack_numbers(&bytes, &[], &mut found).unwrap();
/// assert_eq!((found, rest), (numbers, &[][..]));
/// ```
pub fn pack_numbers(numbers: &[i64], contexts: &[u8], bytes: &mut Vec<u8>) {
    let mut tokens: Vec<u16> = numbers.iter().map(|number| token_of(fold(*number), FINE).0).collect();
    let fine = Counts::of(&mut tokens, contexts);
    let coarse = fine.coarser();
    let (fineness, counts) =
        if fine.cost(FINE) < coarse.cost(COARSE) { (FINE, fine) } else { (COARSE, coarse) };
    if fineness == COARSE {
        let own: Vec<u16> = (0..counts.below as u16).map(coarse_token).collect();
        let contexts = (0..counts.counts.len()).step_by(counts.below);
        let coarse: Vec<u16> =
            contexts.flat_map(|first| own.iter().map(move |token| first as u16 + token)).collect();
        tokens.iter_mut().for_each(|token| *token = coarse[usize::from(*token)]);
    }
    let tables: Vec<Table> = counts.counts.chunks(counts.below).map(Table::of_counts).collect();
    let mut head = Bits::default();
    head.put(u64::from(fineness == FINE), 1);
    tables.iter().for_each(|table| table.write(&mut head));
    let head = head.finish();
    let ranges: Vec<SymbolRange> = tables.iter().flat_map(SymbolRange::all).collect();
    // (Counts are indexed by fine tokens, of which there are more.)
    let last = (self::tokens(fineness) - 1) as u16;
    let rest = |token: u16| number_of(last.min(token), fineness).1;
    let rests: Vec<u32> = (0..counts.below as u16).map(rest).collect::<Vec<_>>().repeat(tables.len());
    let mut bits = Bits::default();
    if rests.iter().any(|rest| *rest > 0) {
        for (number, token) in numbers.iter().zip(&tokens) {
            let rest = rests[usize::from(*token)];
            bits.put(fold(*number) & ((1 << rest) - 1), rest);
        }
    }
    let bits = bits.finish();
    let mut words: Vec<u16> = Vec::with_capacity(numbers.len());
    let mut after = |state: u32, token: u16| {
        let place = ranges[usize::from(token)];
        if place.frequency == TOTAL {
            return state;
        }
        // Invariant: the state is from 2^16 up to 2^32, before and after each token. A word is
        // emitted if the state would leave this range, which is exactly where a reader finds its
        // state below 2^16 and takes a word.
        if state >= place.frequency << (32 - TOTAL_BITS) {
            words.push(state as u16);
            return place.after(state >> 16);
        }
        place.after(state)
    };
    let [mut even, mut odd] = [LOW; 2];
    let (pairs, last) = tokens.as_chunks::<2>();
    last.iter().for_each(|token| even = after(even, *token));
    for [first, second] in pairs.iter().rev() {
        odd = after(odd, *second);
        even = after(even, *first);
    }
    bytes.extend_from_slice(&(head.len() as u16).to_le_bytes());
    bytes.extend_from_slice(&(words.len() as u32).to_le_bytes());
    bytes.extend_from_slice(&(bits.len() as u32).to_le_bytes());
    bytes.extend_from_slice(&head);
    [even, odd].iter().for_each(|state| bytes.extend_from_slice(&state.to_le_bytes()));
    words.iter().rev().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
    bytes.extend_from_slice(&bits);
}

/// Reads as many numbers as `numbers` holds, written with the same contexts. Returns the bytes
/// after them, or `None` if the bytes are not those of a writer.
pub fn unpack_numbers<'b>(bytes: &'b [u8], contexts: &[u8], numbers: &mut [i64]) -> Option<&'b [u8]> {
    let used = number_of_kinds(contexts.iter().map(|context| u16::from(*context)));
    if used > MAX_CONTEXTS || !(contexts.is_empty() || contexts.len() == numbers.len()) {
        return None;
    }
    let (head, rest) = bytes.split_first_chunk()?;
    let (words, rest) = rest.split_first_chunk()?;
    let (bits, rest) = rest.split_first_chunk()?;
    let (words, bits) = (u32::from_le_bytes(*words) as usize, u32::from_le_bytes(*bits) as usize);
    let (head, rest) = rest.split_at_checked(u16::from_le_bytes(*head).into())?;
    let mut head = BitSlice::new(head);
    let fineness = if head.take(1) == 1 { FINE } else { COARSE };
    let tables = (0..used).map(|_| Table::read(&mut head, fineness)).collect::<Option<Vec<_>>>()?;
    if !head.is_whole() {
        return None;
    }
    let (states, rest) = rest.split_first_chunk::<8>()?;
    let (words, rest) = rest.split_at_checked(words.checked_mul(2)?)?;
    let (bits, rest) = rest.split_at_checked(bits)?;
    // Meaning of each slot of a state.
    let lookups: Vec<Vec<DecodeEntry>> =
        tables.iter().map(|table| DecodeEntry::all(table, fineness)).collect();
    let state = |at: usize| u32::from_le_bytes(states[at..at + 4].try_into().expect("four bytes"));
    let mut states = [state(0), state(4)];
    let mut words = words.as_chunks::<2>().0.iter();
    let mut bits = BitSlice::new(bits);
    let mut is_short = false;
    for (index, number) in numbers.iter_mut().enumerate() {
        let context = contexts.get(index).map_or(0, |context| usize::from(*context));
        let state = &mut states[index % 2];
        // (Without tokens, a context has no slots.)
        let part = lookups[context].get((*state & (TOTAL - 1)) as usize)?;
        if part.frequency < TOTAL as u16 {
            *state = u32::from(part.frequency) * (*state >> TOTAL_BITS) + u32::from(part.place);
            if *state < LOW {
                let word = words.next().map(|word| u16::from_le_bytes(*word));
                is_short |= word.is_none();
                *state = *state << 16 | u32::from(word.unwrap_or_default());
            }
        }
        let rest = if part.rest > 0 { bits.take(part.rest.into()) } else { 0 };
        *number = unfold(part.least | rest);
    }
    let is_whole = !is_short && words.next().is_none() && states == [LOW; 2] && bits.is_whole();
    is_whole.then_some(rest)
}

/// Meaning of one of the 2^12 slots of a state.
#[derive(Clone, Copy)]
struct DecodeEntry {
    /// Smallest number of the token, and the number of remaining bits.
    least: u64,
    rest: u8,
    frequency: u16,
    /// Index of the slot among those of its token.
    place: u16,
}

impl DecodeEntry {
    /// Returns the meaning of all slots; empty if there are no tokens.
    fn all(table: &Table, fineness: u32) -> Vec<DecodeEntry> {
        let mut parts = Vec::new();
        for (token, frequency) in table.frequencies.iter().enumerate() {
            let (least, rest) = number_of(token as u16, fineness);
            let part = |place| DecodeEntry { least, rest: rest as u8, frequency: *frequency, place };
            parts.extend((0..*frequency).map(part));
        }
        parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random() -> impl FnMut() -> u64 {
        let mut state = 7u64;
        move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            state ^ state >> 33
        }
    }

    #[test]
    fn tokens_represent_all_numbers() {
        let mut random = random();
        let some = (0..10_000).map(|_| random() >> (random() % 64));
        for number in (0..5000).chain(some).chain([u64::MAX, 1 << 63, (1 << 63) - 1]) {
            for fineness in [COARSE, FINE] {
                let (token, rest) = token_of(number, fineness);
                let (least, bits) = number_of(token, fineness);
                assert_eq!(bits, rest);
                assert_eq!(least | number & ((1 << rest) - 1), number);
            }
        }
        assert_eq!(usize::from(token_of(u64::MAX, FINE).0), TOKENS - 1);
    }

    #[test]
    fn numbers_come_back() {
        let mut random = random();
        for count in [0, 1, 2, 3, 17, 1000, 20_000] {
            for kinds in [0, 1, 2, 5] {
                for size in [0, 1, 3, 20, 64] {
                    let number = |bits: u64| if size == 0 { 7 } else { (bits >> (64 - size)) as i64 };
                    let numbers: Vec<i64> = (0..count).map(|_| number(random())).collect();
                    let contexts: Vec<u8> = match kinds {
                        0 => Vec::new(),
                        // (Not all contexts occur.)
                        kinds => {
                            (0..count).map(|_| (random() >> 40) as u8 % kinds).map(|kind| kind & 6).collect()
                        }
                    };
                    let mut bytes = vec![1, 2];
                    pack_numbers(&numbers, &contexts, &mut bytes);
                    bytes.extend([9; 5]);
                    let mut found = vec![0; count];
                    let rest = unpack_numbers(&bytes[2..], &contexts, &mut found);
                    assert_eq!((rest, &found), (Some(&[9; 5][..]), &numbers), "{count} {kinds} {size}");
                }
            }
        }
    }

    #[test]
    fn corruption_is_an_error_or_changes_numbers_only() {
        let mut random = random();
        let numbers: Vec<i64> = (0..300).map(|_| (random() >> (40 + random() % 20)) as i64).collect();
        let contexts: Vec<u8> = (0..300).map(|index| (index % 3) as u8).collect();
        let mut bytes = Vec::new();
        pack_numbers(&numbers, &contexts, &mut bytes);
        let mut found = vec![0; 300];
        for _ in 0..20_000 {
            let mut corrupt = bytes.clone();
            let at = random() as usize % corrupt.len();
            corrupt[at] ^= 1 << (random() % 8);
            corrupt.truncate(corrupt.len() - (random() % 3) as usize);
            let _ = unpack_numbers(&corrupt, &contexts, &mut found);
        }
        for length in 0..bytes.len() {
            assert!(unpack_numbers(&bytes[..length], &contexts, &mut found).is_none());
        }
    }

    #[test]
    fn likely_numbers_take_few_bytes() {
        let mut random = random();
        let numbers: Vec<i64> = (0..40_000).map(|_| i64::from(random().is_multiple_of(20))).collect();
        let mut bytes = Vec::new();
        pack_numbers(&numbers, &[], &mut bytes);
        // (The entropy is 0.286 bits per number.)
        assert!(bytes.len() < 1500, "{}", bytes.len());
        bytes.clear();
        pack_numbers(&[5; 40_000], &[], &mut bytes);
        assert!(bytes.len() < 32, "{}", bytes.len());
    }
}
