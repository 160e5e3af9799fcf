//! A segment that is being read.

use spinney_base::io::FileBytes;
use spinney_base::space::Code;
use spinney_base::value::Value;

/// Bytes of the number of cells that follows each value among class counts.
pub(super) const COUNT_SIZE: usize = size_of::<u64>();

/// A segment: the records of part of a tree, in preorder.
#[derive(Clone)]
pub struct Segment<'a> {
    pub(super) code: Code,
    /// Its number in the directory.
    pub(super) index: usize,
    pub(super) bytes: FileBytes<'a>,
    /// Bytes that are records, of which there are as many; class counts follow.
    pub(super) record_bytes: usize,
    /// Bytes of a value.
    pub(super) width: usize,
}

impl<'a> Segment<'a> {
    /// The node that owns it.
    #[inline]
    pub fn code(&self) -> Code {
        self.code
    }

    /// Its number in the directory.
    #[inline]
    pub fn index(&self) -> usize {
        self.index
    }

    /// Records and class counts: as they stand in the file, or stood before they were packed.
    pub(crate) fn all_bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The records, one after the other; the file's [`RecordLayout`](crate::store::records::RecordLayout)
    /// tells what is where.
    #[inline]
    pub fn records(&self) -> &[u8] {
        &self.bytes[..self.record_bytes]
    }

    /// The records, if they are mapped: for as long as the file is open.
    pub(crate) fn mapped_records(&self) -> Option<&'a [u8]> {
        match self.bytes {
            FileBytes::Mapped(bytes) => Some(&bytes[..self.record_bytes]),
            FileBytes::Held(_) => None,
        }
    }

    /// The bytes, to be kept beyond the segment's own life.
    pub(super) fn into_bytes(self) -> FileBytes<'a> {
        self.bytes
    }

    /// Cells of each value below the segment's node; empty unless the file counts classes, or if there are too many.
    pub fn classes(&self) -> Vec<(Value, u64)> {
        let entries = self.bytes[self.record_bytes..].chunks_exact(self.width + COUNT_SIZE);
        let entry = |entry: &[u8]| {
            let (value, cells) = entry.split_at(self.width);
            Some((Value::from_bytes(value), u64::from_le_bytes(cells.try_into().ok()?)))
        };
        entries.filter_map(entry).collect()
    }
}
