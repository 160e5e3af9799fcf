//! Counts, lengths and bounds of many pieces of lines.

/// Levels that nodes have at most, and the root's.
pub(crate) const LEVELS: usize = 30;

/// Counts, lengths and bounds of pieces.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Statistics {
    /// Number of the pieces.
    pub segments: u64,
    /// How many are the first of their feature from each level on, by codes: in a node at that level, and those below on the way to it.
    pub firsts: [u64; LEVELS],
    /// The sum of their lengths.
    pub length: f64,
    /// Least and greatest place; the wrong way round if there are none.
    pub bounds: [[i32; 2]; 2],
}

impl Statistics {
    pub(crate) const NONE: Statistics =
        Statistics { segments: 0, firsts: [0; LEVELS], length: 0.0, bounds: [[i32::MAX; 2], [i32::MIN; 2]] };

    pub(crate) fn add(&mut self, other: &Statistics) {
        self.segments += other.segments;
        self.firsts.iter_mut().zip(other.firsts).for_each(|(own, other)| *own += other);
        self.length += other.length;
        self.reach(other.bounds);
    }

    pub(crate) fn reach(&mut self, [least, most]: [[i32; 2]; 2]) {
        for axis in 0..2 {
            self.bounds[0][axis] = self.bounds[0][axis].min(least[axis]);
            self.bounds[1][axis] = self.bounds[1][axis].max(most[axis]);
        }
    }

    /// Number of features that have pieces in a node at a level, of whose pieces these statistics are.
    pub(crate) fn features(&self, level: u8) -> u64 {
        self.firsts.iter().take(usize::from(level) + 1).sum()
    }
}
