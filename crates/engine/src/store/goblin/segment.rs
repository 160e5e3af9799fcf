//! A segment that is being read.

use spinney_base::io::FileBytes;
use spinney_base::space::Code;
use spinney_base::value::Value;

/// Size in bytes of the number of cells that follows each value in class counts.
pub(super) const COUNT_SIZE: usize = size_of::<u64>();

/// A segment: the records of a subtree of bounded size, in preorder.
#[derive(Clone)]
pub struct Segment<'a> {
    pub(super) code: Code,
    /// Its index in the file.
    pub(super) index: usize,
    pub(super) bytes: FileBytes<'a>,
    /// Size of the records in bytes; class counts follow them.
    pub(super) record_bytes: usize,
    /// Size of a value in bytes.
    pub(super) width: usize,
}

impl<'a> Segment<'a> {
    /// Returns the node that owns the segment.
    #[inline]
    pub fn code(&self) -> Code {
        self.code
    }

    /// Returns its index in the file.
    #[inline]
    pub fn index(&self) -> usize {
        self.index
    }

    /// Returns records and class counts, unpacked.
    pub(crate) fn all_bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Returns the records, consecutively; the file's
    /// [`RecordLayout`](crate::store::records::RecordLayout) describes them.
    #[inline]
    pub fn records(&self) -> &[u8] {
        &self.bytes[..self.record_bytes]
    }

    /// Returns the records, if they are mapped, for as long as the file is open.
    pub(crate) fn mapped_records(&self) -> Option<&'a [u8]> {
        match self.bytes {
            FileBytes::Mapped(bytes) => Some(&bytes[..self.record_bytes]),
            FileBytes::Cached(_) => None,
        }
    }

    /// Returns the bytes, which may outlive the segment.
    pub(super) fn into_bytes(self) -> FileBytes<'a> {
        self.bytes
    }

    /// Returns the number of cells per value below the segment's node; empty unless the file counts
    /// classes, or if there are too many.
    pub fn classes(&self) -> Vec<(Value, u64)> {
        let entries = self.bytes[self.record_bytes..].chunks_exact(self.width + COUNT_SIZE);
        let entry = |entry: &[u8]| {
            let (value, cells) = entry.split_at(self.width);
            Some((Value::from_bytes(value), u64::from_le_bytes(cells.try_into().ok()?)))
        };
        entries.filter_map(entry).collect()
    }
}
