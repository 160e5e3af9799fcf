//! Rules for cutting a tree into segments: which nodes may own a segment, and its depth.

use spinney_base::space::Dimension;

/// Levels of records in a segment (`h`) of written files.
#[inline]
pub const fn reach(dimension: Dimension) -> u8 {
    match dimension {
        Dimension::Quad => 8,
        Dimension::Oct => 6,
    }
}

/// Levels between nodes that may own a segment (`s`) in written files.
pub const STRIDE: u8 = 2;

/// Record count above which a subtree owns a segment (`T`) in written files.
pub const HEAVY_THRESHOLD: u32 = 4096;

/// Parameters that cut the tree of a file into segments.
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
    /// Returns whether trees of both shapes are cut into segments by the same rules. Depth does not
    /// matter.
    #[inline]
    pub fn is_cut_like(&self, other: &Shape) -> bool {
        (self.reach, self.stride, self.heavy_threshold) == (other.reach, other.stride, other.heavy_threshold)
    }

    /// Returns whether nodes of this level are candidates, which own a segment if they are heavy.
    /// The root is not a candidate: it always owns a segment.
    #[inline]
    pub fn is_candidate(&self, level: u8) -> bool {
        let blocks = self.block_level();
        level > 0 && level <= blocks && (blocks - level).is_multiple_of(self.stride)
    }

    /// Deepest level of candidates: the level of the blocks from which trees are built.
    #[inline]
    pub fn block_level(&self) -> u8 {
        self.depth.saturating_sub(self.reach)
    }

    /// Deepest level, at most `level`, whose nodes can own a segment.
    #[inline]
    pub fn segment_level(&self, level: u8) -> u8 {
        let blocks = self.block_level();
        let level = level.min(blocks);
        let up = (blocks - level).next_multiple_of(self.stride);
        blocks.saturating_sub(up)
    }

    /// Level of the segment that contains the CUT link to a candidate's segment.
    #[inline]
    pub fn parent_segment_level(&self, level: u8) -> u8 {
        if level == 0 { 0 } else { self.segment_level(level - 1) }
    }

    /// Level whose nodes are divided among shards. Segments above it are stored together, after all
    /// others: the *top levels*. 0 if there are none.
    ///
    /// One read of the top levels provides an overview of the whole file. Files of adjacent
    /// subtrees can be concatenated under new top levels.
    #[inline]
    pub fn shard_level(&self) -> u8 {
        let blocks = self.block_level();
        blocks.saturating_sub(6).max(blocks.min(3))
    }

    /// Level of the INNER nodes that are CUT in the segment of a node at `level`. The segment
    /// contains the records above.
    #[inline]
    pub fn cut_level(&self, level: u8) -> u8 {
        level.saturating_add(self.reach)
    }
}
