//! The record of segments: what an inner node knows of its children.
//!
//! Records are written by the builder for both formats and stand in Goblin files. How wide a value is and how
//! many children there are is known at run time ([`RecordLayout`]); what goes over very many records is
//! compiled for each width and fan-out ([`Record`], [`with_record_type`]).

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use spinney_base::Form;
use spinney_base::space::Dimension;
use spinney_base::value::Value;

/// Bits of the state of one child.
pub(crate) const STATE_BITS: usize = 2;
/// The bits of one state.
const STATE_MASK: u32 = 3;
/// The lower bit of each of 16 states; times a state, 16 states that are all this one.
pub(crate) const LOW_STATE_BITS: u32 = 0x5555_5555;

/// The combinations of four states, which are one byte: the size of tables by the states of four children.
pub(crate) const FOUR_STATES: usize = 1 << (4 * STATE_BITS);

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

/// Skip and mark of the bits that hold both.
#[inline]
const fn split_skip(bits: u32, skip_bits: u32) -> (u32, u8) {
    (bits & ((1 << skip_bits) - 1), (bits >> skip_bits) as u8)
}

impl RecordHead {
    /// State of one child.
    #[inline]
    pub fn state(self, child: usize) -> u8 {
        state_of(self.states, child)
    }
}

/// State of one child among those of all.
#[inline]
pub(crate) const fn state_of(states: u32, child: usize) -> u8 {
    (states >> (STATE_BITS * child) & STATE_MASK) as u8
}

impl RecordLayout {
    /// The layout for trees of a form.
    pub const fn new(form: Form) -> RecordLayout {
        let states_at = form.children() * form.width();
        let rest = match form.dimension {
            Dimension::Quad => 4,
            Dimension::Oct => 8,
        };
        RecordLayout { dimension: form.dimension, width: form.width(), states_at, size: states_at + rest }
    }

    /// Children of a node.
    #[inline]
    pub const fn children(&self) -> usize {
        self.dimension.children()
    }

    /// Bytes that an INNER node takes at least: those of its children's values, which a dense block has of it.
    pub(crate) const fn least_node(&self) -> u64 {
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
        match self.dimension {
            Dimension::Quad => {
                let word = u32::from_le_bytes(records.get(start..start + 4)?.try_into().ok()?);
                let (skip, dense) = split_skip(word >> 8, QUAD_SKIP_BITS);
                Some(RecordHead { states: word & 0xff, skip, dense })
            }
            Dimension::Oct => {
                let word = u64::from_le_bytes(records.get(start..start + 8)?.try_into().ok()?);
                let (skip, dense) = split_skip((word >> 32) as u32, OCT_SKIP_BITS);
                Some(RecordHead { states: word as u32 & 0xffff, skip, dense })
            }
        }
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
    pub(crate) fn write_head(&self, record: &mut [u8], head: RecordHead) {
        let RecordHead { states, skip, dense } = head;
        match self.dimension {
            Dimension::Quad => {
                let skip = skip | u32::from(dense) << QUAD_SKIP_BITS;
                record[self.states_at..].copy_from_slice(&(states & 0xff | skip << 8).to_le_bytes());
            }
            Dimension::Oct => {
                let skip = skip | u32::from(dense) << OCT_SKIP_BITS;
                let word = u64::from(states & 0xffff) | u64::from(skip) << 32;
                record[self.states_at..].copy_from_slice(&word.to_le_bytes());
            }
        }
    }
}

/// One inner node, as it stands on disk, with width and fan-out known at compile time.
pub(crate) trait Record:
    FromBytes + IntoBytes + Immutable + KnownLayout + Unaligned + Copy + Send + Sync + 'static
{
    /// Quadtree or octree.
    const DIMENSION: Dimension;
    /// Number of axes.
    const AXES: usize = Self::DIMENSION.axes();
    /// Children of a node.
    const CHILDREN: usize = Self::DIMENSION.children();
    /// The bytes of a value.
    type Bytes: FromBytes
        + IntoBytes
        + Immutable
        + KnownLayout
        + Unaligned
        + Copy
        + PartialEq
        + std::fmt::Debug
        + Send
        + Sync;
    /// The bytes of the values of all children.
    type Values: AsRef<[Self::Bytes]>;
    /// No value: all bytes zero.
    const ZERO: Self::Bytes;
    /// The layout of the record.
    const RECORD_LAYOUT: RecordLayout = RecordLayout {
        dimension: Self::DIMENSION,
        width: size_of::<Self::Bytes>(),
        states_at: size_of::<Self::Values>(),
        size: size_of::<Self>(),
    };

    /// The values of children that are all alike.
    fn alike(value: Self::Bytes) -> Self::Values;
    /// A record of the values of all its children.
    fn new(head: RecordHead, values: &[Self::Bytes]) -> Self;
    /// The children's values, child 0 first.
    fn values(&self) -> &[Self::Bytes];
    /// Two bits per child, child 0 lowest.
    fn states(&self) -> u32;
    /// Number of places of records that this node's subtree occupies in its segment, this one included.
    fn skip(&self) -> u32 {
        self.head().skip
    }
    /// Whether the subtree is a dense block, or says so: [`RecordHead::dense`] is not 0.
    fn is_dense(&self) -> bool {
        self.head().dense != 0
    }
    /// States and skip.
    fn head(&self) -> RecordHead;

    /// State of one child.
    #[inline]
    fn state(&self, child: usize) -> u8 {
        state_of(self.states(), child)
    }

    /// Bytes as records; nothing if they are not a whole number of them.
    #[inline]
    fn of(bytes: &[u8]) -> &[Self] {
        <[Self]>::ref_from_bytes(bytes).unwrap_or(&[])
    }
}

/// Index of the record of an INNER child; `None` if a skip leads out of the node.
///
/// The parent's own extent must have been checked. Looks at no sibling behind the child.
#[inline]
pub(crate) fn child_record<R: Record>(records: &[R], parent: usize, child: usize) -> Option<usize> {
    let record = records.get(parent)?;
    let end = parent + record.skip() as usize;
    // Those of the children before it stand first, one after the other. (INNER is the state with only the
    // upper bit set.)
    let mut at = parent + 1;
    let states = record.states();
    let mut before = states >> 1 & !states & LOW_STATE_BITS & ((1 << (STATE_BITS * child)) - 1);
    while before != 0 {
        at += records.get(at)?.skip().max(1) as usize;
        before &= before - 1;
    }
    let skip = records.get(at)?.skip() as usize;
    (skip > 0 && at + skip <= end).then_some(at)
}

/// A record of a quadtree.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub(crate) struct QuadRecord<const WIDTH: usize> {
    values: [[u8; WIDTH]; 4],
    states: u8,
    skip: [u8; 3],
}

/// A record of an octree.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub(crate) struct OctRecord<const WIDTH: usize> {
    values: [[u8; WIDTH]; 8],
    states: [u8; 2],
    zero: [u8; 2],
    skip: [u8; 4],
}

impl<const WIDTH: usize> Record for QuadRecord<WIDTH> {
    const DIMENSION: Dimension = Dimension::Quad;
    type Bytes = [u8; WIDTH];
    type Values = [[u8; WIDTH]; 4];
    const ZERO: [u8; WIDTH] = [0; WIDTH];

    #[inline]
    fn alike(value: [u8; WIDTH]) -> [[u8; WIDTH]; 4] {
        [value; 4]
    }
    #[inline]
    fn new(head: RecordHead, values: &[[u8; WIDTH]]) -> Self {
        let [a, b, c, _] = (head.skip | u32::from(head.dense) << QUAD_SKIP_BITS).to_le_bytes();
        QuadRecord {
            values: values.try_into().expect("four values"),
            states: head.states as u8,
            skip: [a, b, c],
        }
    }
    #[inline]
    fn values(&self) -> &[[u8; WIDTH]] {
        &self.values
    }
    #[inline]
    fn states(&self) -> u32 {
        self.states as u32
    }
    #[inline]
    fn head(&self) -> RecordHead {
        let [a, b, c] = self.skip;
        let (skip, dense) = split_skip(u32::from_le_bytes([a, b, c, 0]), QUAD_SKIP_BITS);
        RecordHead { states: self.states(), skip, dense }
    }
}

impl<const WIDTH: usize> Record for OctRecord<WIDTH> {
    const DIMENSION: Dimension = Dimension::Oct;
    type Bytes = [u8; WIDTH];
    type Values = [[u8; WIDTH]; 8];
    const ZERO: [u8; WIDTH] = [0; WIDTH];

    #[inline]
    fn alike(value: [u8; WIDTH]) -> [[u8; WIDTH]; 8] {
        [value; 8]
    }
    #[inline]
    fn new(head: RecordHead, values: &[[u8; WIDTH]]) -> Self {
        let values = values.try_into().expect("eight values");
        let skip = (head.skip | u32::from(head.dense) << OCT_SKIP_BITS).to_le_bytes();
        OctRecord { values, states: (head.states as u16).to_le_bytes(), zero: [0; 2], skip }
    }
    #[inline]
    fn values(&self) -> &[[u8; WIDTH]] {
        &self.values
    }
    #[inline]
    fn states(&self) -> u32 {
        u16::from_le_bytes(self.states) as u32
    }
    #[inline]
    fn head(&self) -> RecordHead {
        let (skip, dense) = split_skip(u32::from_le_bytes(self.skip), OCT_SKIP_BITS);
        RecordHead { states: self.states(), skip, dense }
    }
}

/// Evaluates an expression with a name bound to the type of a [`RecordLayout`]'s records: the way into what
/// goes over very many of them.
macro_rules! with_record_type {
    ($layout:expr, $R:ident => $body:expr) => {{
        use spinney_base::space::Dimension;
        use $crate::store::records::record::{OctRecord, QuadRecord};
        let layout: $crate::store::records::RecordLayout = $layout;
        macro_rules! with {
            ($Record:ty) => {{
                type $R = $Record;
                $body
            }};
        }
        match (layout.dimension, layout.width) {
            (Dimension::Quad, 1) => with!(QuadRecord<1>),
            (Dimension::Quad, 2) => with!(QuadRecord<2>),
            (Dimension::Quad, 3) => with!(QuadRecord<3>),
            (Dimension::Quad, 4) => with!(QuadRecord<4>),
            (Dimension::Quad, 6) => with!(QuadRecord<6>),
            (Dimension::Quad, 8) => with!(QuadRecord<8>),
            (Dimension::Quad, 12) => with!(QuadRecord<12>),
            (Dimension::Quad, 16) => with!(QuadRecord<16>),
            (Dimension::Oct, 1) => with!(OctRecord<1>),
            (Dimension::Oct, 2) => with!(OctRecord<2>),
            (Dimension::Oct, 3) => with!(OctRecord<3>),
            (Dimension::Oct, 4) => with!(OctRecord<4>),
            (Dimension::Oct, 6) => with!(OctRecord<6>),
            (Dimension::Oct, 8) => with!(OctRecord<8>),
            (Dimension::Oct, 12) => with!(OctRecord<12>),
            (Dimension::Oct, 16) => with!(OctRecord<16>),
            (_, width) => unreachable!("no tree has values of {width} bytes"),
        }
    }};
}

pub(crate) use with_record_type;

/// Evaluates an expression with names bound to the type of a [`Form`]'s values
/// ([`Native`](spinney_base::value::Native)) and to that of its records: the way into kernels that go over very many
/// records.
macro_rules! with_form_type {
    ($form:expr, $V:ident, $R:ident => $body:expr) => {{
        let form: spinney_base::Form = $form;
        spinney_base::value::with_native_type!(form.value, $V => match form.dimension {
            spinney_base::space::Dimension::Quad => {
                type $R = $crate::store::records::record::QuadRecord<{ size_of::<$V>() }>;
                $body
            }
            spinney_base::space::Dimension::Oct => {
                type $R = $crate::store::records::record::OctRecord<{ size_of::<$V>() }>;
                $body
            }
        })
    }};
}

pub(crate) use with_form_type;

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::value::{SampleType, ValueType};

    #[test]
    fn layouts_and_types_agree() {
        for dimension in [Dimension::Quad, Dimension::Oct] {
            for sample in SampleType::ALL {
                for channels in 1..=4 {
                    let value = ValueType::new(sample, channels);
                    if !value.is_supported() {
                        continue;
                    }
                    let layout = RecordLayout::new(Form::new(dimension, value));
                    with_record_type!(layout, R => {
                        assert_eq!(<R as Record>::RECORD_LAYOUT, layout);
                        let mut values = Vec::new();
                        for child in 0..R::CHILDREN {
                            let bytes = vec![child as u8 + 1; layout.width];
                            values.push(<R as Record>::Bytes::read_from_bytes(&bytes).unwrap());
                        }
                        let head = RecordHead { states: 0b10_01_00_11, skip: 0x1234, dense: 5 };
                        let record = R::new(head, &values);
                        let mut written = vec![0; layout.size];
                        layout.write(&mut written, values.as_bytes(), head);
                        assert_eq!(record.as_bytes(), written);
                        assert_eq!(layout.head(&written, 0), Some(head));
                        assert_eq!((record.head(), record.states(), record.skip()), (head, head.states, head.skip));
                        for (child, value) in values.iter().enumerate() {
                            assert_eq!(layout.value(&written, 0, child), Value::from_bytes(value.as_bytes()));
                        }
                    });
                }
            }
        }
    }
}
