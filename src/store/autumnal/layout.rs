//! The Autumnal record: an inner node's representative and, per child, a value or a pointer; or, of a small node, a run of
//! all the records below it.
//!
//! A small node ([`run_height`]) and all that is below it is one record: the representative, and a run of records and dense
//! blocks as it stands in a segment of a Goblin file. Of any other node the record has, in this order: two bits of state per child (VOID, LEAF, RELATIVE, ABSOLUTE), the
//! representative, and the fields of the children that are not VOID: the value of a LEAF, or a pointer to an
//! INNER child's record. A RELATIVE pointer is the distance back to it, an ABSOLUTE one its offset in the
//! file. Records are written after those that they point to.

use crate::space::Dimension;
use crate::store::container::dense::dense_levels;
use crate::store::container::record::{FOUR_STATES, state_of};
use crate::store::container::{Descend, LEAF, RecordLayout, VOID, descend_in};
use crate::tree::{Child, Children, Form, no_children};
use crate::value::{MAX_VALUE_SIZE, Value};

/// More detail below, whose record is so many bytes before this one.
pub(super) const RELATIVE: u8 = 2;
/// More detail below, whose record is at this offset of the file.
pub(super) const ABSOLUTE: u8 = 3;

/// Levels below the largest nodes whose records are runs: as many as those of the largest dense blocks.
#[inline]
pub(super) const fn run_height(dimension: Dimension) -> u8 {
    *dense_levels(dimension).end()
}

/// Bytes of the longest head of a record: its states and its representative.
pub(super) const MAX_HEAD: usize = 2 + MAX_VALUE_SIZE;

/// Bytes of the longest record: a head, and eight fields.
pub(super) const MAX_RECORD: usize = MAX_HEAD + 8 * MAX_VALUE_SIZE;

/// Bytes of the longest pointer.
const MAX_POINTER: usize = 8;

/// Room for any record, and behind it for all that the last field's value could have.
pub(super) type RecordBuffer = [u8; MAX_RECORD + MAX_VALUE_SIZE];

/// Layout of the records of a file.
#[derive(Clone)]
pub(super) struct PointeredLayout {
    /// Quadtree or octree, and the type of the values.
    pub(super) form: Form,
    /// Bytes of a value.
    width: usize,
    /// Bytes of the states: a byte for four children.
    state_bytes: usize,
    /// Bytes of a RELATIVE pointer, and of an ABSOLUTE one.
    pub(super) relative: u8,
    pub(super) absolute: u8,
    /// Bytes of the fields of four children, by their states.
    field_bytes: Box<[u16; FOUR_STATES]>,
    /// Layout of the records of runs.
    pub(super) run: RecordLayout,
    /// The way down in a run.
    pub(super) descend: Descend,
}

impl PointeredLayout {
    /// The layout with pointers of so many bytes, 1 to 8.
    pub(super) fn new(form: Form, relative: u8, absolute: u8) -> PointeredLayout {
        let width = form.width();
        let size = |state: usize| [0, width, usize::from(relative), usize::from(absolute)][state & 3] as u16;
        let field_bytes = std::array::from_fn(|states| (0..4).map(|child| size(states >> (2 * child))).sum());
        PointeredLayout {
            form,
            width,
            state_bytes: form.children() / 4,
            relative,
            absolute,
            field_bytes: Box::new(field_bytes),
            run: RecordLayout::new(form),
            descend: descend_in(RecordLayout::new(form)),
        }
    }

    /// Children of a node.
    #[inline]
    pub(super) fn children(&self) -> usize {
        self.form.children()
    }

    /// Bytes of a value.
    #[inline]
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// The states at the start of a record; `None` if it is cut short.
    #[inline]
    pub(super) fn states(&self, record: &[u8]) -> Option<u32> {
        match (self.state_bytes, record) {
            (1, [states, ..]) => Some(u32::from(*states)),
            (2, [low, high, ..]) => Some(u32::from(u16::from_le_bytes([*low, *high]))),
            _ => None,
        }
    }

    /// The representative of a record's node; `None` if the record is cut short.
    #[inline]
    pub(super) fn representative(&self, record: &[u8]) -> Option<Value> {
        self.value(record, self.state_bytes)
    }

    /// Whether the record of a node with so many levels below it is a run.
    #[inline]
    pub(super) fn is_run(&self, height: u8) -> bool {
        height <= run_height(self.form.dimension)
    }

    /// Bytes of the run of a node with so many levels below it, given its first ones: the representative and the first record
    /// at least. `None` if they are fewer, or if it claims more records than the node can have.
    #[inline]
    pub(super) fn run_size(&self, bytes: &[u8], height: u8) -> Option<usize> {
        let skip = self.run.head(bytes.get(self.width..)?, 0)?.skip;
        // A tree without a uniform node: 1 + c + c^2 ... for c children.
        let most = (self.form.dimension.cells(height) - 1) / (self.children() as u64 - 1);
        (1..=most).contains(&u64::from(skip)).then(|| self.width + skip as usize * self.run.size)
    }

    /// Bytes of a run's representative and its first record.
    #[inline]
    pub(super) fn run_head(&self) -> usize {
        self.width + self.run.size
    }

    /// The value at an offset in a record; `None` if the record is cut short.
    #[inline]
    pub(super) fn value(&self, record: &[u8], at: usize) -> Option<Value> {
        Value::read(record.get(at..)?, self.width)
    }

    /// Bytes of states and representative: where the first field starts.
    #[inline]
    pub(super) fn head_size(&self) -> usize {
        self.state_bytes + self.width
    }

    /// Bytes of all fields.
    #[inline]
    fn field_size(&self, states: u32) -> usize {
        let low = usize::from(self.field_bytes[states as usize % FOUR_STATES]);
        if self.state_bytes > 1 {
            low + usize::from(self.field_bytes[states as usize / FOUR_STATES % FOUR_STATES])
        } else {
            low
        }
    }

    /// Bytes of a record, its zone not counted.
    #[inline]
    pub(super) fn record_size(&self, states: u32) -> usize {
        self.head_size() + self.field_size(states)
    }

    /// Offset of a child's field in a record.
    #[inline]
    pub(super) fn field(&self, states: u32, child: usize) -> usize {
        // With the states of the child and those behind it VOID, the record would end here.
        let before = states & ((1 << (2 * child)) - 1);
        self.record_size(before)
    }

    /// Bytes of a pointer of a state.
    #[inline]
    pub(super) fn pointer_size(&self, state: u8) -> usize {
        usize::from(if state == RELATIVE { self.relative } else { self.absolute })
    }

    /// Target of the pointer in a field, of a record that stands at `address`; `None` if it is cut short or
    /// does not lead back.
    #[inline]
    pub(super) fn follow(&self, record: &[u8], at: usize, state: u8, address: u64) -> Option<u64> {
        let size = self.pointer_size(state);
        let number = match record.get(at..at + MAX_POINTER) {
            // One load and a mask, where there are bytes enough behind the pointer.
            Some(bytes) => {
                u64::from_le_bytes(bytes.try_into().expect("8 bytes")) & (u64::MAX >> (64 - 8 * size))
            }
            None => {
                let mut number = [0; MAX_POINTER];
                number[..size].copy_from_slice(record.get(at..at + size)?);
                u64::from_le_bytes(number)
            }
        };
        let target = if state == RELATIVE { address.checked_sub(number)? } else { number };
        // Records come after those that they point to: whoever follows pointers gets ever nearer to the
        // file's start.
        (target < address).then_some(target)
    }

    /// The state and the number of a pointer from a record to another, which is before it.
    #[inline]
    fn point(&self, from: u64, to: u64) -> (u8, u64) {
        // Children are written before their parents: the distance is never negative.
        let distance = from - to;
        if distance >> (8 * self.relative) == 0 { (RELATIVE, distance) } else { (ABSOLUTE, to) }
    }

    /// Whether a pointer can lead to an address.
    pub(super) fn can_point_to(&self, address: u64) -> bool {
        usize::from(self.absolute) == MAX_POINTER || address >> (8 * self.absolute) == 0
    }

    /// Writes a record that is to stand at `address` to a buffer, without a zone, and tells its size. INNER
    /// children have the addresses of their records.
    #[inline]
    pub(super) fn encode(
        &self,
        address: u64,
        representative: Value,
        children: &[Child<u64>],
        record: &mut RecordBuffer,
    ) -> usize {
        // Values and pointers are written with all the bytes that any could have, which is one store whatever
        // their width: what comes next is written over those that are too many.
        let mut end = self.state_bytes;
        record[end..end + MAX_VALUE_SIZE].copy_from_slice(&representative.to_bytes());
        end += self.width;
        let mut states = 0u16;
        for (step, child) in children.iter().enumerate() {
            let state = match child {
                Child::Void => VOID,
                Child::Leaf(value) => {
                    record[end..end + MAX_VALUE_SIZE].copy_from_slice(&value.to_bytes());
                    end += self.width;
                    LEAF
                }
                Child::Inner { node, .. } => {
                    let (state, number) = self.point(address, *node);
                    record[end..end + MAX_POINTER].copy_from_slice(&number.to_le_bytes());
                    end += self.pointer_size(state);
                    state
                }
            };
            states |= u16::from(state) << (2 * step);
        }
        record[..self.state_bytes].copy_from_slice(&states.to_le_bytes()[..self.state_bytes]);
        end
    }

    /// The children of the node whose record stands at `address`, INNER ones with the addresses of their
    /// records but without their representatives, and the record's size; `None` if it is cut short or a
    /// pointer does not lead back.
    pub(super) fn decode(&self, record: &[u8], address: u64) -> Option<(Children<u64>, usize)> {
        let states = self.states(record)?;
        let mut children = no_children();
        let mut at = self.head_size();
        for (step, child) in children[..self.children()].iter_mut().enumerate() {
            match state_of(states, step) {
                VOID => {}
                LEAF => {
                    *child = Child::Leaf(self.value(record, at)?);
                    at += self.width;
                }
                state => {
                    let node = self.follow(record, at, state, address)?;
                    *child = Child::Inner { representative: Value::ZERO, node };
                    at += self.pointer_size(state);
                }
            }
        }
        Some((children, at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::value::{SampleType, ValueType};

    #[test]
    fn records_come_back() {
        for dimension in [Dimension::Quad, Dimension::Oct] {
            for value in [ValueType::new(SampleType::U8, 3), ValueType::new(SampleType::F32, 4)] {
                let layout = PointeredLayout::new(Form::new(dimension, value), 2, 6);
                let leaf = |number: u8| Value::from_bytes(&vec![number; value.size()]);
                let inner = |node| Child::Inner { representative: Value::ZERO, node };
                let all = [
                    [Child::Leaf(leaf(1)); 8],
                    [inner(70_000); 8],
                    [inner(5); 8],
                    std::array::from_fn(|step| match step % 4 {
                        0 => Child::Void,
                        1 => inner(69_999),
                        2 => Child::Leaf(leaf(step as u8)),
                        _ => inner(12_288),
                    }),
                ];
                for children in all {
                    let mut expected = no_children();
                    expected[..layout.children()].copy_from_slice(&children[..layout.children()]);
                    let mut buffer: RecordBuffer = [7; MAX_RECORD + MAX_VALUE_SIZE];
                    let used = &expected[..layout.children()];
                    let size = layout.encode(80_000, leaf(9), used, &mut buffer);
                    let record = &buffer[..size];
                    let states = layout.states(record).unwrap();
                    assert_eq!(layout.record_size(states), size);
                    assert_eq!(layout.representative(record), Some(leaf(9)));
                    assert_eq!(layout.decode(record, 80_000), Some((expected, size)));
                    assert_eq!(layout.decode(&record[..size - 1], 80_000), None);
                }
            }
        }
    }
}
