//! Adaptive probabilities, which follow the bits and symbols seen.

/// Probability that a bit is set, which follows the bits seen.
#[derive(Clone, Copy)]
pub(crate) struct Adaptive {
    /// Probability in units of 2^-16.
    pub(crate) set: u16,
    /// Number of bits seen, up to [`MAX_SEEN`].
    seen: u16,
}

/// After this many bits, each further bit has the same weight.
const MAX_SEEN: u16 = 127;
/// Minimum distance of a probability from 0 and 1, in units of 2^-16.
const MIN_BIT: u16 = 32;

/// Fraction by which a probability moves towards the bit seen, by the number of bits seen before: 2
/// / (2n + 3), in units of 2^-16.
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
    /// Moves the probability towards the bit seen.
    #[inline(always)]
    pub(crate) fn update(&mut self, bit: bool) {
        // Invariant: `set` stays between MIN_BIT and 2^16 - 1 - MIN_BIT, as it never moves farther
        // than the distance to either bound. So neither bit's range is ever empty, and both fit
        // into 16 bits.
        let step = STEPS[usize::from(self.seen) & MAX_SEEN as usize];
        let gap = if bit { u32::from(u16::MAX - MIN_BIT - self.set) } else { u32::from(self.set - MIN_BIT) };
        let change = ((gap * step) >> 16) as u16;
        self.set = if bit { self.set + change } else { self.set - change };
        self.seen += u16::from(self.seen < MAX_SEEN);
    }
}

/// Number of symbols that [`AdaptiveSymbols`] distinguishes.
pub(crate) const SYMBOLS: usize = 16;
/// Probabilities of symbols add up to 2^15: few enough bits that processors compute with sixteen of
/// them at once.
const SYMBOL_BITS: u32 = 15;
/// Minimum probability of a symbol, in units of 2^-15.
const MIN_SYMBOL: i16 = 6;

/// Probabilities of 16 symbols, which follow the symbols seen.
#[derive(Clone, Copy)]
pub(crate) struct AdaptiveSymbols {
    /// Start of each symbol's range in 2^15.
    starts: [i16; SYMBOLS],
    /// Number of symbols seen, as long as it affects the rate.
    seen: u16,
}

impl Default for AdaptiveSymbols {
    fn default() -> AdaptiveSymbols {
        AdaptiveSymbols { starts: std::array::from_fn(|symbol| (symbol << 11) as i16), seen: 0 }
    }
}

impl AdaptiveSymbols {
    /// Creates probabilities in units of 2^-15.
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

/// Limits of all starts if only one symbol ever came.
static GOALS: [[i16; SYMBOLS]; SYMBOLS] = {
    let mut goals = [[0; SYMBOLS]; SYMBOLS];
    let mut symbol = 0;
    while symbol < SYMBOLS {
        let mut at = 0;
        while at < SYMBOLS {
            let before = at as i16 * MIN_SYMBOL;
            let after = (1 << SYMBOL_BITS) - (SYMBOLS - at) as i32 * MIN_SYMBOL as i32;
            goals[symbol][at] = if at <= symbol { before } else { after as i16 };
            at += 1;
        }
        symbol += 1;
    }
    goals
};

impl AdaptiveSymbols {
    /// Returns the start and the length of a symbol's range in 2^16.
    #[inline(always)]
    pub(crate) fn part(&self, symbol: usize) -> (u32, u32) {
        let start = self.starts[symbol] as u32;
        let end = if symbol + 1 < SYMBOLS { self.starts[symbol + 1] as u32 } else { 1 << SYMBOL_BITS };
        (start << 1, (end - start) << 1)
    }

    /// Returns the symbol whose range has a number below 2^16.
    #[inline(always)]
    pub(crate) fn find(&self, low: u32) -> usize {
        let low = (low >> 1) as i16;
        let is_before = |at: usize| usize::from(self.starts[at & (SYMBOLS - 1)] <= low);
        let first = 4 * (is_before(4) + is_before(8) + is_before(12));
        first + is_before(first + 1) + is_before(first + 2) + is_before(first + 3)
    }

    /// Moves all starts towards those that they would have if only this symbol came: by a sixteenth
    /// at first, then by less.
    #[inline(always)]
    pub(crate) fn update(&mut self, symbol: usize) {
        let seen = usize::from(self.seen).min(RATES.len() - 1);
        let shift = RATES[seen];
        self.seen = seen as u16 + u16::from(seen + 1 < RATES.len());
        // Invariant: each range stays at least as long as MIN_SYMBOL, since all starts move by the
        // same fraction of the way to goals that are at least that far apart. So every symbol can
        // come at any time, and no range ever covers all of 2^15. (`black_box` makes the compiler
        // load all starts again as a vector. Otherwise it assembles the vector from the scalars
        // that were compared before.)
        let starts = std::hint::black_box(&mut self.starts);
        let (before, goals) = (*starts, &GOALS[symbol & (SYMBOLS - 1)]);
        *starts = std::array::from_fn(|at| before[at] + ((goals[at] - before[at]) >> shift));
    }
}

/// Shifts of [`AdaptiveSymbols::update`], by the number of symbols seen before.
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
