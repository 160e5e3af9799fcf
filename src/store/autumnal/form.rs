//! The Autumnal record: an inner node's representative and, per child, a value or a pointer.
//!
//! A record has, in this order: two bits of state per child (VOID, LEAF, NEAR, FAR), the representative, and the fields
//! of the children that are not VOID: the value of a LEAF, or a pointer to an INNER child's record. A NEAR pointer is
//! the distance back to it, a FAR one its place in the file. Records are written after those that they point to.

use crate::store::goblin::Header;

/// More detail below, whose record is so many bytes before this one.
pub(super) const NEAR: u32 = 2;
/// More detail below, whose record is at this place of the file.
pub(super) const FAR: u32 = 3;

/// No record is longer: states, representative, and eight fields of at most 16 bytes.
pub(super) const LONGEST: usize = 2 + 16 + 8 * 16;

/// A record's head: its states and its representative.
pub(super) const HEAD_MOST: usize = 2 + 16;

/// How the records of a file are laid out.
#[derive(Clone)]
pub(super) struct Form {
    /// Children of a node.
    pub(super) children: usize,
    /// Bytes of a value.
    pub(super) value: usize,
    /// Bytes of the states.
    pub(super) states: usize,
    /// Bytes of a NEAR pointer, and of a FAR one.
    pub(super) near: u8,
    pub(super) far: u8,
    /// Bytes of the fields of four children, by their states.
    sizes: Box<[u16; 256]>,
}

impl Form {
    /// For pointers of so many bytes, at most 8.
    pub(super) fn new(header: &Header, near: u8, far: u8) -> Form {
        let value = header.value.size();
        let size = |state: usize| [0, value, usize::from(near), usize::from(far)][state & 3] as u16;
        let sizes = std::array::from_fn(|states| (0..4).map(|child| size(states >> (2 * child))).sum());
        let children = 1 << header.axes;
        Form { children, value, states: children / 4, near, far, sizes: Box::new(sizes) }
    }

    /// The states at the start of a record.
    #[inline]
    pub(super) fn states_of(&self, record: &[u8]) -> Option<u32> {
        match (self.states, record) {
            (1, [states, ..]) => Some(u32::from(*states)),
            (2, [low, high, ..]) => Some(u32::from(u16::from_le_bytes([*low, *high]))),
            _ => None,
        }
    }

    /// Where a child's field starts in a record.
    #[inline]
    pub(super) fn field(&self, states: u32, child: usize) -> usize {
        let before = states & ((1 << (2 * child)) - 1);
        self.head() + self.fields(before)
    }

    /// Bytes of states and representative.
    #[inline]
    pub(super) fn head(&self) -> usize {
        self.states + self.value
    }

    /// Bytes of all fields.
    #[inline]
    fn fields(&self, states: u32) -> usize {
        let low = usize::from(self.sizes[states as usize & 255]);
        if self.states > 1 { low + usize::from(self.sizes[states as usize >> 8 & 255]) } else { low }
    }

    /// Bytes of a record, its zone not counted.
    #[inline]
    pub(super) fn length(&self, states: u32) -> usize {
        self.head() + self.fields(states)
    }

    /// Bytes of a pointer.
    #[inline]
    pub(super) fn pointer_size(&self, state: u32) -> usize {
        usize::from(if state == NEAR { self.near } else { self.far })
    }

    /// Where the pointer in a field of a record leads; `None` if it is cut short or does not lead back.
    #[inline]
    pub(super) fn pointer(&self, record: &[u8], at: usize, state: u32, address: u64) -> Option<u64> {
        let length = self.pointer_size(state);
        let number = match record.get(at..at + 8) {
            Some(bytes) => {
                u64::from_le_bytes(bytes.try_into().expect("8 bytes")) & (u64::MAX >> (64 - 8 * length))
            }
            None => {
                let mut number = [0; 8];
                number[..length].copy_from_slice(record.get(at..at + length)?);
                u64::from_le_bytes(number)
            }
        };
        let target = if state == NEAR { address.checked_sub(number)? } else { number };
        (target < address).then_some(target)
    }

    /// The state and the bytes of a pointer from a record to another.
    pub(super) fn point(&self, from: u64, to: u64) -> (u32, [u8; 8], usize) {
        let distance = from - to;
        if distance >> (8 * self.near) == 0 {
            (NEAR, distance.to_le_bytes(), usize::from(self.near))
        } else {
            (FAR, to.to_le_bytes(), usize::from(self.far))
        }
    }
}

/// A field of a record that is still to be written.
#[derive(Clone, Copy, Debug)]
pub(super) enum Field<'a> {
    Void,
    Leaf(&'a [u8]),
    /// The address of the child's record.
    Inner(u64),
}
