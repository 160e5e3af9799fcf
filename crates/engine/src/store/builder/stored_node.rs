//! Nodes of files whose records can be copied.

use std::any::Any;
use std::ops::Range;

use spinney_base::Result;
use spinney_base::io::{FileBytes, FileId};
use spinney_base::value::Rule;
use spinney_container::Header;

/// A file whose tree, or whose small nodes, are stored as runs of records.
pub trait RecordFile: Any + Send + Sync {
    /// Returns the file's header.
    fn file_header(&self) -> &Header;

    /// Returns the records of a node and of its descendants in its run, given the number of the run
    /// and the index of the node's record.
    ///
    /// # Errors
    /// If the file is corrupt there.
    fn subtree(&self, run: u64, record: u32) -> Result<Subtree<'_>>;
}

/// A node of an open file with a record in a run.
#[derive(Clone, Copy)]
pub struct StoredNode<'a> {
    /// The file.
    pub file: &'a dyn RecordFile,
    /// Levels below the node.
    pub height: u8,
    /// The run of its record: the segment's index, or the run's offset in the file.
    pub run: u64,
    /// Index of the record in the run.
    pub record: u32,
}

impl<'a> StoredNode<'a> {
    /// Returns the node's records: see [`RecordFile::subtree`].
    pub(in crate::store) fn subtree(&self) -> Result<Subtree<'a>> {
        self.file.subtree(self.run, self.record)
    }
}

/// Records of a node and of its descendants in its run.
pub struct Subtree<'a> {
    bytes: FileBytes<'a>,
    range: Range<usize>,
}

impl<'a> Subtree<'a> {
    /// Returns the records in a range of a run's bytes; none if the range exceeds the run.
    pub(in crate::store) fn new(bytes: FileBytes<'a>, range: Range<usize>) -> Subtree<'a> {
        let range = if bytes.get(range.clone()).is_some() { range } else { 0..0 };
        Subtree { bytes, range }
    }

    /// Returns the records' bytes.
    pub(in crate::store) fn records(&self) -> &[u8] {
        &self.bytes[self.range.clone()]
    }
}

/// A record of an Autumnal file, which need not be written to that file again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordRef {
    /// The file.
    pub(in crate::store) file: FileId,
    /// Offset of the record in the file.
    pub(in crate::store) address: u64,
    /// Levels below the node.
    pub height: u8,
    /// Rule of its layer, which the representatives depend on.
    pub(in crate::store) rule: Rule,
    /// Whether the zones of its layer have class counts.
    pub(in crate::store) counts_classes: bool,
}
