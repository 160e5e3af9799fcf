//! A segment that is being read, and steps from record to record in it.

use std::borrow::Cow;
use std::marker::PhantomData;
use std::sync::Arc;

use zerocopy::FromBytes;

use super::record::{INNER, Layout, Record};
use crate::space::Code;
use crate::value::Value;

/// The bytes of a segment: seen where they are, or held by a cache.
#[derive(Clone)]
pub(in crate::store) enum Bytes<'a> {
    Seen(&'a [u8]),
    Held(Arc<Vec<u8>>),
}

impl<'a> From<Cow<'a, [u8]>> for Bytes<'a> {
    fn from(bytes: Cow<'a, [u8]>) -> Self {
        match bytes {
            Cow::Borrowed(bytes) => Bytes::Seen(bytes),
            Cow::Owned(bytes) => Bytes::Held(Arc::new(bytes)),
        }
    }
}

/// A segment: the records of part of a tree, in preorder.
#[derive(Clone)]
pub struct Segment<'a, D, V> {
    pub(in crate::store) code: Code<D>,
    /// Its number in the directory.
    pub(in crate::store) index: usize,
    pub(in crate::store) bytes: Bytes<'a>,
    /// Bytes that are records; class counts follow.
    pub(in crate::store) record_bytes: usize,
    pub(in crate::store) value: PhantomData<V>,
}

impl<D: Layout, V: Value> Segment<'_, D, V> {
    /// The node that owns it.
    pub fn code(&self) -> Code<D> {
        self.code
    }

    /// Its number in the directory.
    pub fn index(&self) -> usize {
        self.index
    }

    pub(in crate::store) fn all_bytes(&self) -> &[u8] {
        match &self.bytes {
            Bytes::Seen(bytes) => bytes,
            Bytes::Held(bytes) => bytes,
        }
    }

    /// The records.
    pub fn records(&self) -> &[D::Record<V>] {
        <[D::Record<V>]>::ref_from_bytes(&self.all_bytes()[..self.record_bytes]).unwrap_or(&[])
    }

    /// Cells of each value below the segment's node; empty unless the file counts classes.
    pub fn classes(&self) -> Vec<(V, u64)> {
        let size = size_of::<V::Wire>();
        let entries = self.all_bytes()[self.record_bytes..].chunks_exact(size + 8);
        let entry = |entry: &[u8]| {
            let value = V::from_wire(V::Wire::read_from_bytes(&entry[..size]).ok()?);
            Some((value, u64::from_le_bytes(entry[size..].try_into().ok()?)))
        };
        entries.filter_map(entry).collect()
    }
}

/// Where the children's records of the record at `place` are; `None` for children without a record here.
///
/// The record's own extent (`place .. place + skip`) must have been checked; every child's is checked here to lie
/// inside it and beside the others, so that no walk can leave the segment or go round in it.
#[inline]
pub(crate) fn child_places<D: Layout, V: Value>(
    records: &[D::Record<V>],
    place: usize,
) -> Option<D::Array<Option<u32>>> {
    let record = records[place];
    let end = place + record.skip() as usize;
    let mut next = place + 1;
    let mut good = true;
    let places = D::array(|child| {
        if record.state(child) != INNER || !good {
            return None;
        }
        let skip = if next < end { records[next].skip() as usize } else { 0 };
        good = skip > 0 && next + skip <= end;
        let place = next as u32;
        next += skip;
        Some(place)
    });
    good.then_some(places)
}

/// Where the record of one INNER child is: as [`child_places`], but looks at no sibling behind it.
#[inline]
pub(crate) fn child_place<D: Layout, V: Value>(
    records: &[D::Record<V>],
    place: usize,
    child: usize,
) -> Option<usize> {
    let record = &records[place];
    let end = place + record.skip() as usize;
    let mut next = place + 1;
    for before in 0..child {
        if record.state(before) == INNER {
            let skip = records.get(next)?.skip() as usize;
            next = next.checked_add(skip.max(1))?;
        }
    }
    let skip = records.get(next).filter(|_| next < end)?.skip() as usize;
    (skip > 0 && next + skip <= end).then_some(next)
}
