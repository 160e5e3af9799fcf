//! The kind of a tree, known at run time.

use std::fmt;

use crate::space::Dimension;
use crate::value::ValueType;

/// The dimension of a tree and the type of its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TreeType {
    /// Quadtree or octree.
    pub dimension: Dimension,
    /// Type of the values.
    pub value: ValueType,
}

impl TreeType {
    /// A tree of this dimension with values of this type.
    #[inline]
    pub const fn new(dimension: Dimension, value: ValueType) -> TreeType {
        TreeType { dimension, value }
    }

    /// The form with values of which all samples count.
    #[must_use]
    #[inline]
    pub const fn without_mask(self) -> TreeType {
        TreeType { value: self.value.without_mask(), ..self }
    }

    /// Number of axes.
    #[inline]
    pub const fn axes(self) -> usize {
        self.dimension.axes()
    }

    /// Children of an inner node.
    #[inline]
    pub const fn children(self) -> usize {
        self.dimension.children()
    }

    /// Bytes of a value.
    #[inline]
    pub const fn width(self) -> usize {
        self.value.size()
    }
}

/// For messages, with an article: "a quadtree of u8x3".
impl fmt::Display for TreeType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let article = if self.dimension == Dimension::Quad { "a" } else { "an" };
        write!(f, "{article} {} of {}", self.dimension.tree_name(), self.value)
    }
}
