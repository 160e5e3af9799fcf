//! The two kinds of space that a tree can divide: planes and volumes.

/// Number of axes of a tree: two for a quadtree, three for an octree.
///
/// Children are numbered in Z order: bit 0 of the number is x, bit 1 is y, bit 2 is z. A quadtree's
/// children are therefore NW, NE, SW, SE (row 0 is north). The first four children of an octree
/// node are the quadtree children of its slice z = 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Dimension {
    /// Two axes: a quadtree.
    Quad,
    /// Three axes: an octree.
    Oct,
}

impl Dimension {
    /// Returns the dimension with this number of axes; `None` unless it is 2 or 3.
    pub const fn from_axes(axes: u8) -> Option<Dimension> {
        match axes {
            2 => Some(Dimension::Quad),
            3 => Some(Dimension::Oct),
            _ => None,
        }
    }

    /// Returns the number of axes: 2 or 3. It is also the number of path bits per level.
    #[inline]
    pub const fn axes(self) -> usize {
        self as usize + 2
    }

    /// Returns the number of children of an INNER node: 4 or 8.
    #[inline]
    pub const fn children(self) -> usize {
        1 << self.axes()
    }

    /// Returns the maximum depth of a tree whose codes fit 63 bits: 29 or 19.
    #[inline]
    pub const fn max_depth(self) -> u8 {
        match self {
            Dimension::Quad => 29,
            Dimension::Oct => 19,
        }
    }

    /// Returns the number of descendants `levels` below a node: 4 or 8 to that power.
    #[inline]
    pub const fn cells(self, levels: u8) -> u64 {
        1 << (self.axes() * levels as usize)
    }

    /// Returns the tree's name in messages: "quadtree" or "octree".
    pub const fn tree_name(self) -> &'static str {
        match self {
            Dimension::Quad => "quadtree",
            Dimension::Oct => "octree",
        }
    }
}
