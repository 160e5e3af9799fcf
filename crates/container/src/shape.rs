//! Rules that tell which nodes of a tree may own a segment, and how deep segments reach.

use spinney_base::space::Dimension;

/// Levels of records in a segment (`h`), where files are written.
#[inline]
pub const fn reach(dimension: Dimension) -> u8 {
    match dimension {
        Dimension::Quad => 8,
        Dimension::Oct => 6,
    }
}

/// Levels between nodes that may own a segment (`s`), where files are written.
pub const STRIDE: u8 = 2;

/// A subtree with more records than this owns a segment (`T`), where files are written.
pub const HEAVY_THRESHOLD: u32 = 4096;

/// The numbers of a file that say how its tree is cut into segments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Levels below the root.
    pub depth: u8,
    /// Levels of records in a segment; `h` in the format.
    pub reach: u8,
    /// Levels between candidates for a segment; `s` in the format. Divides `reach`.
    pub stride: u8,
    /// Candidates with more records below than this own a segment; `T` in the format.
    pub heavy_threshold: u32,
}

impl Shape {
    /// Whether trees of both shapes are cut into segments alike, depth aside.
    #[inline]
    pub fn is_cut_like(&self, other: &Shape) -> bool {
        (self.reach, self.stride, self.heavy_threshold) == (other.reach, other.stride, other.heavy_threshold)
    }

    /// Whether nodes of this level are candidates: they own a segment if they are heavy. The root is no
    /// candidate by this measure, it owns a segment anyway.
    #[inline]
    pub fn is_candidate(&self, level: u8) -> bool {
        let blocks = self.block_level();
        level > 0 && level <= blocks && (blocks - level).is_multiple_of(self.stride)
    }

    /// The deepest level of candidates: the level of the blocks that trees are built from.
    #[inline]
    pub fn block_level(&self) -> u8 {
        self.depth.saturating_sub(self.reach)
    }

    /// The deepest level, at most `level`, whose nodes can own a segment.
    #[inline]
    pub fn segment_level(&self, level: u8) -> u8 {
        let blocks = self.block_level();
        let level = level.min(blocks);
        let up = (blocks - level).next_multiple_of(self.stride);
        blocks.saturating_sub(up)
    }

    /// The level of the segment that cuts off below a candidate's own.
    #[inline]
    pub fn parent_segment_level(&self, level: u8) -> u8 {
        if level == 0 { 0 } else { self.segment_level(level - 1) }
    }

    /// The level above which segments stand together, behind all others: the *crown*. 0 where there is none.
    ///
    /// One read of it gives the overview of a whole file, and files of parts of a space can be put one behind the other under
    /// a new crown.
    #[inline]
    pub fn crown_level(&self) -> u8 {
        let blocks = self.block_level();
        blocks.saturating_sub(6).max(blocks.min(3))
    }

    /// The level of the INNER nodes that a segment of a node at `level` cuts off; the records above are in
    /// it.
    #[inline]
    pub fn cut_level(&self, level: u8) -> u8 {
        level.saturating_add(self.reach)
    }
}
