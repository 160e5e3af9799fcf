//! Bits by adaptive probabilities: rANS (Duda, arXiv:1311.2540) with two states of 64 bits that take turns, and give and take words of 32.
//!
//! One state's part can be looked up while the other's is still computed.

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
        let change = ((room * step) >> 16) as u16;
        self.set = if bit { self.set + change } else { self.set - change };
        self.seen += u16::from(self.seen < MOST_SEEN);
    }
}

/// Symbols that [`AdaptiveSymbols`] tells apart.
pub(crate) const SYMBOLS: usize = 16;
/// Bits of the sum of the probabilities of symbols: so few that processors compute with sixteen of them at once.
const SYMBOL_BITS: u32 = 15;
/// No symbol is less probable than this, in parts of 2^15.
const LEAST_SYMBOL: i16 = 6;

/// The probabilities of 16 symbols, which follow the symbols seen.
#[derive(Clone, Copy)]
pub(crate) struct AdaptiveSymbols {
    /// Where each symbol's part of 2^15 begins.
    starts: [i16; SYMBOLS],
    /// Symbols seen, as long as that matters.
    seen: u16,
}

impl Default for AdaptiveSymbols {
    fn default() -> AdaptiveSymbols {
        AdaptiveSymbols { starts: std::array::from_fn(|symbol| (symbol << 11) as i16), seen: 0 }
    }
}

impl AdaptiveSymbols {
    /// With parts of 2^15.
    pub(crate) fn new(parts: &[i16; SYMBOLS]) -> AdaptiveSymbols {
        let mut start = 0i16;
        let mut starts = [0; SYMBOLS];
        for (at, part) in starts.iter_mut().zip(parts) {
            *at = start;
            start = start.wrapping_add(*part);
        }
        AdaptiveSymbols { starts, seen: 0 }
    }
}

/// Where all parts would begin if nothing but one symbol came.
static GOALS: [[i16; SYMBOLS]; SYMBOLS] = {
    let mut goals = [[0; SYMBOLS]; SYMBOLS];
    let mut symbol = 0;
    while symbol < SYMBOLS {
        let mut at = 0;
        while at < SYMBOLS {
            let before = at as i16 * LEAST_SYMBOL;
            let behind = (1 << SYMBOL_BITS) - (SYMBOLS - at) as i32 * LEAST_SYMBOL as i32;
            goals[symbol][at] = if at <= symbol { before } else { behind as i16 };
            at += 1;
        }
        symbol += 1;
    }
    goals
};

impl AdaptiveSymbols {
    /// Start and length of a symbol's part, of 2^16.
    #[inline(always)]
    fn part(&self, symbol: usize) -> (u32, u32) {
        let start = self.starts[symbol] as u32;
        let end = if symbol + 1 < SYMBOLS { self.starts[symbol + 1] as u32 } else { 1 << SYMBOL_BITS };
        (start << 1, (end - start) << 1)
    }

    /// The symbol whose part has a number below 2^16.
    #[inline(always)]
    fn find(&self, low: u32) -> usize {
        let low = (low >> 1) as i16;
        let is_before = |at: usize| usize::from(self.starts[at & (SYMBOLS - 1)] <= low);
        let first = 4 * (is_before(4) + is_before(8) + is_before(12));
        first + is_before(first + 1) + is_before(first + 2) + is_before(first + 3)
    }

    /// Moves all starts to where they would be if nothing but this symbol came, by a sixteenth at first, then less.
    #[inline(always)]
    fn update(&mut self, symbol: usize) {
        let seen = usize::from(self.seen).min(RATES.len() - 1);
        let shift = RATES[seen];
        self.seen = seen as u16 + u16::from(seen + 1 < RATES.len());
        // (Read anew, all at once: else compilers put vectors together of what was compared before.)
        let starts = std::hint::black_box(&mut self.starts);
        let (before, goals) = (*starts, &GOALS[symbol & (SYMBOLS - 1)]);
        *starts = std::array::from_fn(|at| before[at] + ((goals[at] - before[at]) >> shift));
    }
}

/// Shifts of [`AdaptiveSymbols::update`] by the symbols seen before.
static RATES: [u8; 81] = {
    let mut rates = [4; 81];
    let mut seen = 8;
    while seen < rates.len() {
        rates[seen] = if seen < 24 {
            5
        } else if seen < 80 {
            6
        } else {
            7
        };
        seen += 1;
    }
    rates
};

/// What codes bits, one way or the other.
pub(crate) trait BitCoder: Sized {
    /// Whether bits are read, so that those handed over do not count.
    const READS: bool;

    /// Lets many bits be coded at once, for which a reader stays in registers.
    #[inline(always)]
    fn many(&mut self, code: impl FnOnce(&mut Self)) {
        code(self);
    }

    /// Writes a bit, or reads one.
    fn bit(&mut self, probability: &mut Adaptive, bit: bool) -> bool;
    /// Writes one of [`SYMBOLS`] symbols, or reads one.
    fn symbol(&mut self, probabilities: &mut AdaptiveSymbols, symbol: usize) -> usize;
    /// Writes or reads up to 32 bits that are as often set as not.
    fn short(&mut self, bits: u32, count: u32) -> u32;

    /// Writes or reads up to 64 bits that are as often set as not: the lower 32 first.
    #[inline(always)]
    fn raw(&mut self, bits: u64, count: u32) -> u64 {
        if count <= 32 {
            return u64::from(self.short(bits as u32, count));
        }
        let lower = self.short(bits as u32, 32);
        u64::from(self.short((bits >> 32) as u32, count - 32)) << 32 | u64::from(lower)
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
    /// Bits that are as often set as not, in words from the lowest bit up; and those that fill none yet.
    raw: Vec<u32>,
    some: u64,
    count: u32,
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
    /// The bytes of all bits.
    pub(crate) fn finish(self, bytes: &mut Vec<u8>) {
        let mut words = Vec::with_capacity(self.parts.len() / 16);
        let mut states = [LOW; 2];
        for (number, &(frequency, start)) in self.parts.iter().enumerate().rev() {
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
        // (Words of raw bits come from the end, so that nobody needs to know where they begin.)
        let last = (self.count > 0).then_some(self.some as u32);
        let words = words.chain(&last).chain(self.raw.iter().rev());
        words.for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
    }
}

/// Reads bits. What is missing at the end is read as zeros, and told by [`BitReader::is_whole`].
#[derive(Clone, Copy)]
pub(crate) struct BitReader<'b> {
    /// The state that the next part is taken of, and the one for the part after that.
    state: u64,
    other: u64,
    rest: &'b [u8],
    is_short: bool,
    /// Raw bits that were taken from the end of the rest.
    some: u64,
    count: u32,
}

impl<'b> BitReader<'b> {
    /// `None` if there are too few bytes, or states that nobody writes.
    pub(crate) fn new(bytes: &'b [u8]) -> Option<BitReader<'b>> {
        let (state, rest) = bytes.split_first_chunk()?;
        let (other, rest) = rest.split_first_chunk()?;
        let (state, other) = (u64::from_le_bytes(*state), u64::from_le_bytes(*other));
        let is_state = state >= LOW && other >= LOW;
        is_state.then_some(BitReader { state, other, rest, is_short: false, some: 0, count: 0 })
    }

    /// Takes a part of so many of 2^16 off the state, and turns to the other one.
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

    /// Whether there were as many bytes as bits, and the bits are what somebody wrote.
    pub(crate) fn is_whole(&self) -> bool {
        !self.is_short && self.rest.is_empty() && self.state == LOW && self.other == LOW && self.some == 0
    }
}

impl BitCoder for BitReader<'_> {
    const READS: bool = true;

    #[inline(always)]
    fn many(&mut self, code: impl FnOnce(&mut Self)) {
        let mut here = *self;
        code(&mut here);
        *self = here;
    }

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
