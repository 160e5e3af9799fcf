//! Probabilities that follow what was seen.

/// The probability that a bit is set, which follows the bits seen.
#[derive(Clone, Copy)]
pub(crate) struct Adaptive {
    /// In parts of 2^16.
    pub(crate) set: u16,
    /// Bits seen, up to [`MAX_SEEN`].
    seen: u16,
}

/// Beyond so many bits, each counts as much as the one before.
const MAX_SEEN: u16 = 127;
/// No probability comes nearer to 0 or 1 than this, in parts of 2^16.
const LEAST: u16 = 32;

/// Parts of 2^16 by which a probability moves to what was seen, by how much was seen before: 2 / (2n + 3).
static STEPS: [u32; MAX_SEEN as usize + 1] = {
    let mut steps = [0; MAX_SEEN as usize + 1];
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
    /// Moves towards what was seen.
    #[inline(always)]
    pub(crate) fn update(&mut self, bit: bool) {
        // Invariant: `set` stays between LEAST and 2^16 - 1 - LEAST, as the room on either side is never left by more than it is. So
        // neither bit's part is ever empty, and both fit 16 bits.
        let step = STEPS[usize::from(self.seen) & MAX_SEEN as usize];
        let room = if bit { u32::from(u16::MAX - LEAST - self.set) } else { u32::from(self.set - LEAST) };
        let change = ((room * step) >> 16) as u16;
        self.set = if bit { self.set + change } else { self.set - change };
        self.seen += u16::from(self.seen < MAX_SEEN);
    }
}

/// Symbols that [`AdaptiveSymbols`] tells apart.
pub(crate) const SYMBOLS: usize = 16;
/// Bits of the sum of the probabilities of symbols: so few that processors compute with sixteen of them at once.
const SYMBOL_BITS: u32 = 15;
/// No symbol is less probable than this, in parts of 2^15.
const MIN_SYMBOL: i16 = 6;

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
            let before = at as i16 * MIN_SYMBOL;
            let behind = (1 << SYMBOL_BITS) - (SYMBOLS - at) as i32 * MIN_SYMBOL as i32;
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
    pub(crate) fn part(&self, symbol: usize) -> (u32, u32) {
        let start = self.starts[symbol] as u32;
        let end = if symbol + 1 < SYMBOLS { self.starts[symbol + 1] as u32 } else { 1 << SYMBOL_BITS };
        (start << 1, (end - start) << 1)
    }

    /// The symbol whose part has a number below 2^16.
    #[inline(always)]
    pub(crate) fn find(&self, low: u32) -> usize {
        let low = (low >> 1) as i16;
        let is_before = |at: usize| usize::from(self.starts[at & (SYMBOLS - 1)] <= low);
        let first = 4 * (is_before(4) + is_before(8) + is_before(12));
        first + is_before(first + 1) + is_before(first + 2) + is_before(first + 3)
    }

    /// Moves all starts to where they would be if nothing but this symbol came, by a sixteenth at first, then less.
    #[inline(always)]
    pub(crate) fn update(&mut self, symbol: usize) {
        let seen = usize::from(self.seen).min(RATES.len() - 1);
        let shift = RATES[seen];
        self.seen = seen as u16 + u16::from(seen + 1 < RATES.len());
        // Invariant: each part stays at least as long as MIN_SYMBOL: starts move by the same share of the way to goals that are at least
        // that far apart. So every symbol can come at any time, and a part never takes all of 2^15.
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
