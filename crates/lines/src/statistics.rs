//! Counts, lengths and bounds of line segments.

/// Maximum number of levels, including the root's.
pub(crate) const LEVELS: usize = 30;

/// Counts, length and bounds of line segments.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Statistics {
    /// Number of segments.
    pub segments: u64,
    /// Number of segments by their `first` level, see `LineSegment::first`.
    pub firsts: [u64; LEVELS],
    /// Total length.
    pub length: f64,
    /// Minimum and maximum coordinates; the minimum exceeds the maximum if there are no segments.
    pub bounds: [[i32; 3]; 2],
}

impl Statistics {
    pub(crate) const NONE: Statistics =
        Statistics { segments: 0, firsts: [0; LEVELS], length: 0.0, bounds: [[i32::MAX; 3], [i32::MIN; 3]] };

    pub(crate) fn add(&mut self, other: &Statistics) {
        self.segments += other.segments;
        self.firsts.iter_mut().zip(other.firsts).for_each(|(own, other)| *own += other);
        self.length += other.length;
        self.reach(other.bounds);
    }

    pub(crate) fn reach(&mut self, [least, most]: [[i32; 3]; 2]) {
        for axis in 0..3 {
            self.bounds[0][axis] = self.bounds[0][axis].min(least[axis]);
            self.bounds[1][axis] = self.bounds[1][axis].max(most[axis]);
        }
    }

    /// Number of distinct features in a node at `level`, if these are the statistics of the node's
    /// subtree.
    pub(crate) fn features(&self, level: u8) -> u64 {
        self.firsts.iter().take(usize::from(level) + 1).sum()
    }
}
