//! The layout of records: sizes and field offsets.

use spinney_base::TreeType;
use spinney_base::space::Dimension;
use spinney_base::value::Value;

/// Bits of a child's state.
pub const STATE_BITS: usize = 2;
/// Mask of a child's state.
const STATE_MASK: u32 = 3;

/// Size and field offsets of a tree's records, for a tree type known at run time.
///
/// A quadtree's record has four values, states in one byte and `skip` in three. An octree's record
/// has eight values, states in two bytes, two zero bytes and `skip` in four. The upper three bits
/// of `skip` mark dense blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordLayout {
    /// Quadtree or octree.
    pub dimension: Dimension,
    /// Bytes of a value.
    pub width: usize,
    /// Offset of the states, which follow the values.
    states_at: usize,
    /// Bytes of a record.
    pub size: usize,
}

/// States and skip of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordHead {
    /// Two bits per child; child 0 has the lowest.
    pub states: u32,
    /// Number of record slots of this node's subtree in its segment, including its own.
    pub skip: u32,
    /// Kind number of the dense block that stores the subtree; 0 if it is stored as records.
    pub dense: u8,
}

/// Number of upper bits of `skip` that mark dense blocks.
const DENSE_BITS: u32 = 3;

/// Number of bits of `skip` that count record slots, in quadtrees and in octrees.
const QUAD_SKIP_BITS: u32 = 24 - DENSE_BITS;
const OCT_SKIP_BITS: u32 = 32 - DENSE_BITS;

impl RecordHead {
    /// Decodes the last four bytes of a quadtree's record: states, then skip and mark.
    #[inline]
    pub const fn of_quad(word: u32) -> RecordHead {
        let bits = word >> 8;
        let skip = bits & ((1 << QUAD_SKIP_BITS) - 1);
        RecordHead { states: word & 0xff, skip, dense: (bits >> QUAD_SKIP_BITS) as u8 }
    }

    /// Decodes the last eight bytes of an octree's record: states, zeros, then skip and mark.
    #[inline]
    pub const fn of_oct(word: u64) -> RecordHead {
        let bits = (word >> 32) as u32;
        let skip = bits & ((1 << OCT_SKIP_BITS) - 1);
        RecordHead { states: word as u32 & 0xffff, skip, dense: (bits >> OCT_SKIP_BITS) as u8 }
    }

    /// Encodes the last four bytes of a quadtree's record.
    #[inline]
    pub const fn to_quad(self) -> u32 {
        self.states & 0xff | (self.skip | (self.dense as u32) << QUAD_SKIP_BITS) << 8
    }

    /// Encodes the last eight bytes of an octree's record.
    #[inline]
    pub const fn to_oct(self) -> u64 {
        (self.states & 0xffff) as u64 | ((self.skip | (self.dense as u32) << OCT_SKIP_BITS) as u64) << 32
    }

    /// State of a child.
    #[inline]
    pub fn state(self, child: usize) -> u8 {
        state_of(self.states, child)
    }
}

/// Extracts the state of a child from the states of all.
#[inline]
pub const fn state_of(states: u32, child: usize) -> u8 {
    (states >> (STATE_BITS * child) & STATE_MASK) as u8
}

impl RecordLayout {
    /// The layout for a tree type.
    #[inline]
    pub const fn new(form: TreeType) -> RecordLayout {
        RecordLayout::of_width(form.dimension, form.width())
    }

    /// The layout for values of `width` bytes.
    #[inline]
    pub const fn of_width(dimension: Dimension, width: usize) -> RecordLayout {
        let states_at = dimension.children() * width;
        let rest = match dimension {
            Dimension::Quad => 4,
            Dimension::Oct => 8,
        };
        RecordLayout { dimension, width, states_at, size: states_at + rest }
    }

    /// Number of children of a node.
    #[inline]
    pub const fn children(&self) -> usize {
        self.dimension.children()
    }

    /// Minimum bytes of an INNER node: its children's values, which is what a dense block stores of
    /// it.
    #[inline]
    pub const fn least_node(&self) -> u64 {
        (self.children() * self.width) as u64
    }

    /// Number of records in a slice of bytes.
    #[inline]
    pub fn count(&self, records: &[u8]) -> usize {
        records.len() / self.size
    }

    /// States and skip of the record with index `at`; `None` if there is no such record.
    #[inline]
    pub fn head(&self, records: &[u8], at: usize) -> Option<RecordHead> {
        let start = at * self.size + self.states_at;
        Some(match self.dimension {
            Dimension::Quad => {
                RecordHead::of_quad(u32::from_le_bytes(records.get(start..start + 4)?.try_into().ok()?))
            }
            Dimension::Oct => {
                RecordHead::of_oct(u64::from_le_bytes(records.get(start..start + 8)?.try_into().ok()?))
            }
        })
    }

    /// Value (LEAF) or representative (INNER, CUT) of a child of the record with index `at`; zeros
    /// for VOID.
    ///
    /// # Panics
    /// If there is no such record.
    #[inline]
    pub fn value(&self, records: &[u8], at: usize, child: usize) -> Value {
        let start = at * self.size + child * self.width;
        Value::read(&records[start..], self.width).expect("as many bytes as the record has")
    }

    /// The bytes of `skip` record slots from index `at` on; `None` if there are fewer.
    #[inline]
    pub fn subtree<'r>(&self, records: &'r [u8], at: usize, skip: u32) -> Option<&'r [u8]> {
        records.get(at * self.size..(at + skip as usize) * self.size)
    }

    /// Writes a record: its children's values in order, and its head.
    #[inline]
    pub fn write(&self, record: &mut [u8], values: &[u8], head: RecordHead) {
        record[..self.states_at].copy_from_slice(values);
        self.write_head(record, head);
    }

    /// Sets a record's head.
    #[inline]
    pub fn write_head(&self, record: &mut [u8], head: RecordHead) {
        match self.dimension {
            Dimension::Quad => record[self.states_at..].copy_from_slice(&head.to_quad().to_le_bytes()),
            Dimension::Oct => record[self.states_at..].copy_from_slice(&head.to_oct().to_le_bytes()),
        }
    }
}
