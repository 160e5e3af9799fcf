//! Bits by adaptive probabilities: rANS (Duda, arXiv:1311.2540) with a state of 64 bits that takes and gives words of 32.

/// The probability that a bit is set, which follows the bits seen.
#[derive(Clone, Copy)]
pub(crate) struct Adaptive {
    /// In parts of 2^16.
    set: u16,
    /// Bits seen, up to [`MOST_SEEN`].
    seen: u16,
}

/// Beyond so many bits, each counts as much as the one before.
const MOST_SEEN: u16 = 127;
/// No probability comes nearer to 0 or 1 than this, in parts of 2^16.
const LEAST: u16 = 32;

/// Parts of 2^16 by which a probability moves to what was seen, by how much was seen before: 2 / (2n + 3).
static STEPS: [u32; MOST_SEEN as usize + 1] = {
    let mut steps = [0; MOST_SEEN as usize + 1];
    let mut seen = 0;
    while seen < steps.len() {
        steps[seen] = (2 << 16) / (2 * seen as u32 + 3);
        seen += 1;
    }
    steps
};

impl Default for Adaptive {
    fn default() -> Adaptive {
        Adaptive { set: 1 << 15, seen: 0 }
    }
}

impl Adaptive {
    #[inline(always)]
    fn update(&mut self, bit: bool) {
        let step = STEPS[usize::from(self.seen) & MOST_SEEN as usize];
        let room = if bit { u32::from(u16::MAX - LEAST - self.set) } else { u32::from(self.set - LEAST) };
        let change = (room * step >> 16) as u16;
        self.set = if bit { self.set + change } else { self.set - change };
        self.seen += u16::from(self.seen < MOST_SEEN);
    }
}

/// Symbols that [`AdaptiveSymbols`] tells apart.
pub(crate) const SYMBOLS: usize = 16;
/// No symbol is less probable than this, in parts of 2^16.
const LEAST_SYMBOL: i32 = 12;

/// The probabilities of 16 symbols, which follow the symbols seen.
#[derive(Clone, Copy)]
pub(crate) struct AdaptiveSymbols {
    /// Where each symbol's part of 2^16 begins.
    starts: [u16; SYMBOLS],
    /// Symbols seen, as long as that matters.
    seen: u16,
}

impl Default for AdaptiveSymbols {
    fn default() -> AdaptiveSymbols {
        AdaptiveSymbols { starts: std::array::from_fn(|symbol| (symbol << 12) as u16), seen: 0 }
    }
}

impl AdaptiveSymbols {
    /// Start and length of a symbol's part.
    #[inline(always)]
    fn part(&self, symbol: usize) -> (u32, u32) {
        let start = u32::from(self.starts[symbol]);
        let end = if symbol + 1 < SYMBOLS { u32::from(self.starts[symbol + 1]) } else { 1 << TOTAL_BITS };
        (start, end - start)
    }

    /// The symbol whose part has a number below 2^16.
    #[inline(always)]
    fn find(&self, low: u32) -> usize {
        let before: u16 = self.starts[1..].iter().map(|start| u16::from(u32::from(*start) <= low)).sum();
        usize::from(before)
    }

    /// Moves all starts to where they would be if nothing but this symbol came, by a sixteenth at first, then less.
    #[inline(always)]
    fn update(&mut self, symbol: usize) {
        let shift = RATES[usize::from(self.seen)];
        self.seen += u16::from(usize::from(self.seen) + 1 < RATES.len());
        for (at, start) in self.starts.iter_mut().enumerate() {
            let least = at as i32 * LEAST_SYMBOL;
            let most = (1 << TOTAL_BITS) - (SYMBOLS - at) as i32 * LEAST_SYMBOL;
            let goal = if at <= symbol { least } else { most };
            let moved = i32::from(*start) + (goal - i32::from(*start) >> shift);
            *start = moved as u16;
        }
    }
}

/// Shifts of [`AdaptiveSymbols::update`] by the symbols seen before.
static RATES: [u8; 81] = {
    let mut rates = [4; 81];
    let mut seen = 8;
    while seen < rates.len() {
        rates[seen] = if seen < 24 { 5 } else if seen < 80 { 6 } else { 7 };
        seen += 1;
    }
    rates
};

/// What codes bits, one way or the other.
pub(crate) trait BitCoder {
    /// Whether bits are read, so that those handed over do not count.
    const READS: bool;
    /// Writes a bit, or reads one.
    fn bit(&mut self, probability: &mut Adaptive, bit: bool) -> bool;
    /// Writes one of [`SYMBOLS`] symbols, or reads one.
    fn symbol(&mut self, probabilities: &mut AdaptiveSymbols, symbol: usize) -> usize;
    /// Writes or reads up to 16 bits that are as often set as not.
    fn short(&mut self, bits: u32, count: u32) -> u32;

    /// Writes or reads up to 64 bits that are as often set as not: the lowest 16 first.
    fn raw(&mut self, bits: u64, count: u32) -> u64 {
        let (mut read, mut at) = (0, 0);
        while at < count {
            let some = (count - at).min(16);
            read |= u64::from(self.short((bits >> at) as u32 & ((1 << some) - 1), some)) << at;
            at += some;
        }
        read
    }

    /// Writes or reads a number that may be of any size: how many bits it has, then these.
    fn number(&mut self, number: u64) -> u64 {
        let bits = self.raw(u64::from(u64::BITS - number.leading_zeros()), 7).min(64) as u32;
        self.raw(number, bits)
    }
}

/// The least state between two bits.
const LOW: u64 = 1 << 32;
/// Bits of the sum of all probabilities.
const TOTAL_BITS: u32 = 16;

/// Writes bits. They are coded when all are there, the last first.
#[derive(Default)]
pub(crate) struct BitWriter {
    /// Frequency and start of each bit's part of 2^16.
    parts: Vec<(u16, u16)>,
}

impl BitCoder for BitWriter {
    const READS: bool = false;

    #[inline(always)]
    fn bit(&mut self, probability: &mut Adaptive, bit: bool) -> bool {
        let set = probability.set;
        // (Neither is 2^16: probabilities stay between.)
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
        if count > 0 {
            self.parts.push((1 << (TOTAL_BITS - count) as u16, (bits << (TOTAL_BITS - count)) as u16));
        }
        bits
    }
}

impl BitWriter {
    /// The bytes of all bits.
    pub(crate) fn finish(self, bytes: &mut Vec<u8>) {
        let mut words = Vec::with_capacity(self.parts.len() / 16);
        let mut state = LOW;
        for (frequency, start) in self.parts.into_iter().rev() {
            let frequency = u64::from(frequency);
            if state >= frequency << (64 - TOTAL_BITS) {
                words.push(state as u32);
                state >>= 32;
            }
            state = (state / frequency) << TOTAL_BITS | (state % frequency + u64::from(start));
        }
        bytes.extend_from_slice(&state.to_le_bytes());
        words.iter().rev().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
    }
}

/// Reads bits. What is missing at the end is read as zeros, and told by [`BitReader::is_whole`].
pub(crate) struct BitReader<'b> {
    state: u64,
    rest: &'b [u8],
    is_short: bool,
}

impl<'b> BitReader<'b> {
    pub(crate) fn new(bytes: &'b [u8]) -> Option<BitReader<'b>> {
        let (state, rest) = bytes.split_first_chunk()?;
        Some(BitReader { state: u64::from_le_bytes(*state), rest, is_short: false })
    }

    #[inline(always)]
    fn refill(&mut self) {
        if self.state < LOW {
            self.more();
        }
    }

    #[inline(never)]
    fn more(&mut self) {
        let word = match self.rest.split_first_chunk() {
            Some((word, rest)) => {
                self.rest = rest;
                u32::from_le_bytes(*word)
            }
            None => {
                self.is_short = true;
                0
            }
        };
        self.state = self.state << 32 | u64::from(word);
    }

    /// Whether there were as many bytes as bits, and the bits are what somebody wrote.
    pub(crate) fn is_whole(&self) -> bool {
        !self.is_short && self.rest.is_empty() && self.state == LOW
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
        self.state = frequency * (self.state >> TOTAL_BITS) + low - start;
        probability.update(bit);
        self.refill();
        bit
    }

    #[inline(always)]
    fn symbol(&mut self, probabilities: &mut AdaptiveSymbols, _: usize) -> usize {
        let low = (self.state & 0xffff) as u32;
        let symbol = probabilities.find(low);
        let (start, frequency) = probabilities.part(symbol);
        self.state = u64::from(frequency) * (self.state >> TOTAL_BITS) + u64::from(low - start);
        probabilities.update(symbol);
        self.refill();
        symbol
    }

    #[inline(always)]
    fn short(&mut self, _: u32, count: u32) -> u32 {
        if count == 0 {
            return 0;
        }
        let (low, rest) = ((self.state & 0xffff) as u32, TOTAL_BITS - count);
        self.state = (self.state >> TOTAL_BITS << rest) + u64::from(low & ((1 << rest) - 1));
        self.refill();
        low >> rest
    }
}
