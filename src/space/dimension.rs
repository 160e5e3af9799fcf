//! The two dimensions a tree can have, as types.

use std::fmt::Debug;

/// The number of axes of a tree, known at compile time: [`Quad`] or [`Oct`].
///
/// Children are numbered in Z order: bit 0 of the number is x, bit 1 is y, bit 2 is z. A quadtree's
/// children are therefore NW, NE, SW, SE (row 0 is north), and the first four children of an octree's
/// node are the quadtree children of its slice z = 0.
pub trait Dimension: Copy + Debug + Default + Eq + Send + Sync + 'static {
    /// Number of axes: 2 or 3; also the bits of one step of a path.
    const AXES: usize;
    /// Children of an inner node: 4 or 8.
    const CHILDREN: usize = 1 << Self::AXES;
    /// The deepest tree whose codes fit 63 bits: 29 or 19.
    const MAX_DEPTH: u8;
    /// What a node is called when talking to people: "quadtree" or "octree".
    const TREE_NAME: &'static str;

    /// One item per child.
    type Array<T: Clone + Debug + Send + Sync>: Clone
        + Debug
        + AsRef<[T]>
        + AsMut<[T]>
        + IntoIterator<Item = T>
        + Send
        + Sync;

    /// Makes an array from a function of the child number.
    fn array<T: Clone + Debug + Send + Sync>(make: impl FnMut(usize) -> T) -> Self::Array<T>;
}

/// Two axes: a quadtree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Quad;

/// Three axes: an octree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Oct;

impl Dimension for Quad {
    const AXES: usize = 2;
    const MAX_DEPTH: u8 = 29;
    const TREE_NAME: &'static str = "quadtree";
    type Array<T: Clone + Debug + Send + Sync> = [T; 4];

    #[inline]
    fn array<T: Clone + Debug + Send + Sync>(make: impl FnMut(usize) -> T) -> [T; 4] {
        std::array::from_fn(make)
    }
}

impl Dimension for Oct {
    const AXES: usize = 3;
    const MAX_DEPTH: u8 = 19;
    const TREE_NAME: &'static str = "octree";
    type Array<T: Clone + Debug + Send + Sync> = [T; 8];

    #[inline]
    fn array<T: Clone + Debug + Send + Sync>(make: impl FnMut(usize) -> T) -> [T; 8] {
        std::array::from_fn(make)
    }
}
