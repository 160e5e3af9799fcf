//! The record of segments: states and values of an INNER node's children.
//!
//! The builder writes records for both formats, and Goblin files store them. Value width and number
//! of children are known at run time ([`RecordLayout`]). Loops over very many records are compiled
//! for each width and fan-out ([`Record`], [`with_record_type`]).

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use spinney_base::space::Dimension;
use spinney_container::{RecordHead, RecordLayout, STATE_BITS, state_of};

/// The lower bit of each of 16 states. Multiplied by a state, it is 16 states that all equal that
/// one.
pub(crate) const LOW_STATE_BITS: u32 = 0x5555_5555;

/// Number of combinations of four states, which take one byte: the size of tables indexed by the
/// states of four children.
pub(crate) const FOUR_STATES: usize = 1 << (4 * STATE_BITS);

/// The record of an INNER node as stored on disk, with width and fan-out known at compile time.
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
    /// The value of VOID: all bytes zero.
    const ZERO: Self::Bytes;
    /// The layout of the record.
    const RECORD_LAYOUT: RecordLayout = RecordLayout::of_width(Self::DIMENSION, size_of::<Self::Bytes>());

    /// Returns the values of children that all have the same value.
    fn alike(value: Self::Bytes) -> Self::Values;
    /// Returns a record with the values of all children.
    fn new(head: RecordHead, values: &[Self::Bytes]) -> Self;
    /// Returns the children's values, child 0 first.
    fn values(&self) -> &[Self::Bytes];
    /// Returns the states: two bits per child, child 0 lowest.
    fn states(&self) -> u32;
    /// Returns the number of record slots that this node's subtree occupies in its segment,
    /// including this one.
    fn skip(&self) -> u32 {
        self.head().skip
    }
    /// Returns whether the subtree is marked as a dense block: [`RecordHead::dense`] is not 0.
    fn is_dense(&self) -> bool {
        self.head().dense != 0
    }
    /// Returns states and skip.
    fn head(&self) -> RecordHead;

    /// Returns the state of one child.
    #[inline]
    fn state(&self, child: usize) -> u8 {
        state_of(self.states(), child)
    }

    /// Returns bytes as records; empty if their number is not a multiple of the record size.
    #[inline]
    fn of(bytes: &[u8]) -> &[Self] {
        <[Self]>::ref_from_bytes(bytes).unwrap_or(&[])
    }
}

/// Returns the index of an INNER child's record; `None` if a skip leads out of the node.
///
/// The parent's own extent must have been checked. Does not read siblings after the child.
#[inline]
pub(crate) fn child_record<R: Record>(records: &[R], parent: usize, child: usize) -> Option<usize> {
    let record = records.get(parent)?;
    let end = parent + record.skip() as usize;
    // The records of the preceding INNER children are stored first, consecutively. (INNER is the
    // state with only the upper bit set.)
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
        let [states, skip @ ..] = head.to_quad().to_le_bytes();
        QuadRecord { values: values.try_into().expect("four values"), states, skip }
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
        RecordHead::of_quad(u32::from_le_bytes([self.states, a, b, c]))
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
        let [a, b, _, _, skip @ ..] = head.to_oct().to_le_bytes();
        OctRecord { values, states: [a, b], zero: [0; 2], skip }
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
        let skip = u64::from(u32::from_le_bytes(self.skip)) << 32;
        RecordHead::of_oct(skip | u64::from(self.states()))
    }
}

/// Evaluates an expression with a name bound to the record type of a [`RecordLayout`]: the entry to
/// loops over very many records.
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

/// Evaluates an expression with names bound to the value type of a [`TreeType`]
/// ([`Native`](spinney_base::value::Native)) and to its record type: the entry to kernels that
/// process very many records.
macro_rules! with_form_type {
    ($form:expr, $V:ident, $R:ident => $body:expr) => {{
        let form: spinney_base::TreeType = $form;
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

/// Selects types as [`with_form_type`] does, for code that builds blocks. In browsers only
/// blocks of rasters are built, for the cells of indexes.
macro_rules! with_block_type {
    ($form:expr, $V:ident, $R:ident => $body:expr) => {{
        let form: spinney_base::TreeType = $form;
        if cfg!(target_family = "wasm") {
            spinney_base::value::with_native_type!(form.value, $V => {
                type $R = $crate::store::records::record::QuadRecord<{ size_of::<$V>() }>;
                $body
            })
        } else {
            $crate::store::records::with_form_type!(form, $V, $R => $body)
        }
    }};
}

pub(crate) use with_block_type;

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::TreeType;
    use spinney_base::value::{SampleType, Value, ValueType};

    #[test]
    fn layouts_and_types_agree() {
        for dimension in [Dimension::Quad, Dimension::Oct] {
            for sample in SampleType::ALL {
                for channels in 1..=4 {
                    let value = ValueType::new(sample, channels);
                    if !value.is_supported() {
                        continue;
                    }
                    let layout = RecordLayout::new(TreeType::new(dimension, value));
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
