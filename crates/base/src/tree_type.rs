//! Type of a tree, known at run time.

use std::fmt;

use crate::space::Dimension;
use crate::value::ValueType;

/// Dimension of a tree and type of its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TreeType {
    /// Quadtree or octree.
    pub dimension: Dimension,
    /// Type of the values.
    pub value: ValueType,
}

impl TreeType {
    /// Creates the type of trees with this dimension and these values.
    #[inline]
    pub const fn new(dimension: Dimension, value: ValueType) -> TreeType {
        TreeType { dimension, value }
    }

    /// Returns this type without a mask: all samples of its values count.
    #[must_use]
    #[inline]
    pub const fn without_mask(self) -> TreeType {
        TreeType { value: self.value.without_mask(), ..self }
    }

    /// Returns the number of axes.
    #[inline]
    pub const fn axes(self) -> usize {
        self.dimension.axes()
    }

    /// Returns the number of children of an INNER node.
    #[inline]
    pub const fn children(self) -> usize {
        self.dimension.children()
    }

    /// Returns the size of a value in bytes.
    #[inline]
    pub const fn width(self) -> usize {
        self.value.size()
    }
}

/// Formats the type for messages, with an article: "a quadtree of u8x3".
impl fmt::Display for TreeType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let article = if self.dimension == Dimension::Quad { "a" } else { "an" };
        write!(f, "{article} {} of {}", self.dimension.tree_name(), self.value)
    }
}
