//! The layout of records: sizes, and where in a record its parts are.

use spinney_base::TreeType;
use spinney_base::space::Dimension;
use spinney_base::value::Value;

/// Bits of the state of one child.
pub const STATE_BITS: usize = 2;
/// The bits of one state.
const STATE_MASK: u32 = 3;

/// Size and field offsets of the records of a tree whose form is known at run time.
///
/// A quadtree's record has four values, states in one byte, skip in three; an octree's has eight values,
/// states in two bytes, two zero bytes, skip in four. The upper three bits of skip are the mark of dense blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordLayout {
    /// Quadtree or octree.
    pub dimension: Dimension,
    /// Bytes of a value.
    pub width: usize,
    /// Offset of the states, behind the values.
    states_at: usize,
    /// Bytes of a record.
    pub size: usize,
}

/// States and skip of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordHead {
    /// Two bits per child, child 0 lowest.
    pub states: u32,
    /// Number of places of records that this node's subtree occupies in its segment, this one included.
    pub skip: u32,
    /// The number of the kind of dense block that the subtree is stored as; 0 if it is stored as records.
    pub dense: u8,
}

/// Bits of the mark of dense blocks, the upper ones of skip.
const DENSE_BITS: u32 = 3;

/// Bits of skip that count places, in quadtrees and in octrees.
const QUAD_SKIP_BITS: u32 = 24 - DENSE_BITS;
const OCT_SKIP_BITS: u32 = 32 - DENSE_BITS;

impl RecordHead {
    /// The head that stands in the last four bytes of a quadtree's record: states, then skip and mark.
    #[inline]
    pub const fn of_quad(word: u32) -> RecordHead {
        let bits = word >> 8;
        let skip = bits & ((1 << QUAD_SKIP_BITS) - 1);
        RecordHead { states: word & 0xff, skip, dense: (bits >> QUAD_SKIP_BITS) as u8 }
    }

    /// The head that stands in the last eight bytes of an octree's record: states, zeros, then skip and mark.
    #[inline]
    pub const fn of_oct(word: u64) -> RecordHead {
        let bits = (word >> 32) as u32;
        let skip = bits & ((1 << OCT_SKIP_BITS) - 1);
        RecordHead { states: word as u32 & 0xffff, skip, dense: (bits >> OCT_SKIP_BITS) as u8 }
    }

    /// The last four bytes of a quadtree's record.
    #[inline]
    pub const fn to_quad(self) -> u32 {
        self.states & 0xff | (self.skip | (self.dense as u32) << QUAD_SKIP_BITS) << 8
    }

    /// The last eight bytes of an octree's record.
    #[inline]
    pub const fn to_oct(self) -> u64 {
        (self.states & 0xffff) as u64 | ((self.skip | (self.dense as u32) << OCT_SKIP_BITS) as u64) << 32
    }

    /// State of one child.
    #[inline]
    pub fn state(self, child: usize) -> u8 {
        state_of(self.states, child)
    }
}

/// State of one child among those of all.
#[inline]
pub const fn state_of(states: u32, child: usize) -> u8 {
    (states >> (STATE_BITS * child) & STATE_MASK) as u8
}

impl RecordLayout {
    /// The layout for trees of a form.
    #[inline]
    pub const fn new(form: TreeType) -> RecordLayout {
        RecordLayout::of_width(form.dimension, form.width())
    }

    /// The layout for values of so many bytes.
    #[inline]
    pub const fn of_width(dimension: Dimension, width: usize) -> RecordLayout {
        let states_at = dimension.children() * width;
        let rest = match dimension {
            Dimension::Quad => 4,
            Dimension::Oct => 8,
        };
        RecordLayout { dimension, width, states_at, size: states_at + rest }
    }

    /// Children of a node.
    #[inline]
    pub const fn children(&self) -> usize {
        self.dimension.children()
    }

    /// Bytes that an INNER node takes at least: those of its children's values, which a dense block has of it.
    #[inline]
    pub const fn least_node(&self) -> u64 {
        (self.children() * self.width) as u64
    }

    /// Records in so many bytes.
    #[inline]
    pub fn count(&self, records: &[u8]) -> usize {
        records.len() / self.size
    }

    /// States and skip of the record with a number; `None` where there is no such record.
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

    /// Value (LEAF) or representative (INNER, CUT) of a child of the record with a number; zeros for VOID.
    ///
    /// # Panics
    /// If there is no such record.
    #[inline]
    pub fn value(&self, records: &[u8], at: usize, child: usize) -> Value {
        let start = at * self.size + child * self.width;
        Value::read(&records[start..], self.width).expect("as many bytes as the record has")
    }

    /// The bytes of a subtree of so many records from the one with a number on; `None` where there are fewer.
    #[inline]
    pub fn subtree<'r>(&self, records: &'r [u8], at: usize, skip: u32) -> Option<&'r [u8]> {
        records.get(at * self.size..(at + skip as usize) * self.size)
    }

    /// Writes a record: its children's values, one after the other, and its head.
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
