//! The Goblin record: what an inner node knows of its children.

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use crate::space::{Dimension, Oct, Quad};
use crate::value::Value;

/// Nothing there.
pub const VOID: u8 = 0;
/// One value all over.
pub const LEAF: u8 = 1;
/// More detail below, whose record is in this segment.
pub const INNER: u8 = 2;
/// More detail below, whose record is in another segment.
pub const CUT: u8 = 3;

/// One inner node, as it stands on disk.
pub trait Record<V: Value>:
    FromBytes + IntoBytes + Immutable + KnownLayout + Unaligned + Copy + Send + Sync + 'static
{
    /// A record; `states` has two bits per child, child 0 lowest.
    fn new(states: u32, values: impl Fn(usize) -> V, skip: u32) -> Self;
    /// Value (LEAF) or representative (INNER, CUT) of a child; the default value for VOID.
    fn value(&self, child: usize) -> V;
    /// The children's values as they stand on disk, child 0 first.
    fn wires(&self) -> &[V::Wire];
    /// Two bits per child, child 0 lowest.
    fn states(&self) -> u32;
    /// How many records this node's subtree occupies in its segment, this one included.
    fn skip(&self) -> u32;
    /// Sets [`Record::skip`].
    fn set_skip(&mut self, skip: u32);
    /// Sets [`Record::states`].
    fn set_states(&mut self, states: u32);

    /// State of one child.
    #[inline]
    fn state(&self, child: usize) -> u8 {
        (self.states() >> (2 * child)) as u8 & 3
    }
}

/// A record of a quadtree: four values, states in one byte, skip in three.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct QuadRecord<W> {
    values: [W; 4],
    states: u8,
    skip: [u8; 3],
}

/// A record of an octree: eight values, states in two bytes, two zero bytes, skip in four.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub struct OctRecord<W> {
    values: [W; 8],
    states: [u8; 2],
    zero: [u8; 2],
    skip: [u8; 4],
}

impl<V: Value> Record<V> for QuadRecord<V::Wire> {
    #[inline]
    fn new(states: u32, values: impl Fn(usize) -> V, skip: u32) -> Self {
        let [a, b, c, _] = skip.to_le_bytes();
        QuadRecord {
            values: std::array::from_fn(|i| values(i).to_wire()),
            states: states as u8,
            skip: [a, b, c],
        }
    }
    #[inline]
    fn value(&self, child: usize) -> V {
        V::from_wire(self.values[child & 3])
    }
    #[inline]
    fn wires(&self) -> &[V::Wire] {
        &self.values
    }
    #[inline]
    fn states(&self) -> u32 {
        self.states as u32
    }
    #[inline]
    fn skip(&self) -> u32 {
        let [a, b, c] = self.skip;
        u32::from_le_bytes([a, b, c, 0])
    }
    #[inline]
    fn set_skip(&mut self, skip: u32) {
        let [a, b, c, _] = skip.to_le_bytes();
        self.skip = [a, b, c];
    }
    #[inline]
    fn set_states(&mut self, states: u32) {
        self.states = states as u8;
    }
}

impl<V: Value> Record<V> for OctRecord<V::Wire> {
    #[inline]
    fn new(states: u32, values: impl Fn(usize) -> V, skip: u32) -> Self {
        OctRecord {
            values: std::array::from_fn(|i| values(i).to_wire()),
            states: (states as u16).to_le_bytes(),
            zero: [0; 2],
            skip: skip.to_le_bytes(),
        }
    }
    #[inline]
    fn value(&self, child: usize) -> V {
        V::from_wire(self.values[child & 7])
    }
    #[inline]
    fn wires(&self) -> &[V::Wire] {
        &self.values
    }
    #[inline]
    fn states(&self) -> u32 {
        u16::from_le_bytes(self.states) as u32
    }
    #[inline]
    fn skip(&self) -> u32 {
        u32::from_le_bytes(self.skip)
    }
    #[inline]
    fn set_skip(&mut self, skip: u32) {
        self.skip = skip.to_le_bytes();
    }
    #[inline]
    fn set_states(&mut self, states: u32) {
        self.states = (states as u16).to_le_bytes();
    }
}

/// How trees of a dimension are laid out in Goblin files.
pub trait Layout: Dimension {
    /// The record.
    type Record<V: Value>: Record<V>;
    /// Levels of records in a segment (`h`), where files are written.
    const REACH: u8;
    /// Levels between nodes that may own a segment (`s`), where files are written.
    const STRIDE: u8;
}

impl Layout for Quad {
    type Record<V: Value> = QuadRecord<V::Wire>;
    const REACH: u8 = 8;
    const STRIDE: u8 = 2;
}

impl Layout for Oct {
    type Record<V: Value> = OctRecord<V::Wire>;
    const REACH: u8 = 6;
    const STRIDE: u8 = 2;
}

/// A subtree with more records than this owns a segment (`T`), where files are written.
pub(in crate::store) const LIGHT: u32 = 4096;
