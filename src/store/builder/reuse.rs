//! Subtrees that a source has stored already and that need not be built anew: nodes of files, whose records
//! are taken over.

use std::any::Any;
use std::ops::Range;

use crate::Result;
use crate::io::{FileBytes, FileId};
use crate::space::Code;
use crate::store::container::Header;
use crate::tree::{Child, MemTree, NodeState, Source};
use crate::value::{Native, Value, ValueType, erase, native, with_native_type};

/// A source that may tell which of its nodes are stored in files.
pub trait ReusableSource: Source {
    /// The node of a file with segments that an INNER node is, with all that is below it, if it is one: the
    /// records that are stored may then be copied.
    fn stored(&self, _: &Self::Node) -> Option<SegmentNode<'_>> {
        None
    }

    /// The node of an Autumnal file that an INNER node is, with all that is below it, if it is one: the file
    /// need not be written that again.
    fn kept(&self, _: &Self::Node) -> Option<RecordRef> {
        None
    }

    /// The nodes of two files that an INNER node is made of, if it is no more than these, merged: the builder
    /// may then merge them itself, record by record.
    fn overlay(&self, _: &Self::Node) -> Option<Overlay<'_>> {
        None
    }
}

impl ReusableSource for MemTree {}

/// A file whose tree is stored in segments of records.
pub trait SegmentFile: Any + Send + Sync {
    /// The file's header.
    fn file_header(&self) -> &Header;

    /// The records of a node and of all that is below it in its segment, given the numbers of the segment and
    /// of the node's record.
    ///
    /// # Errors
    /// If the file is damaged there.
    fn subtree(&self, segment: u32, record: u32) -> Result<Subtree<'_>>;
}

/// A node of an open file with segments.
#[derive(Clone, Copy)]
pub struct SegmentNode<'a> {
    /// The file.
    pub file: &'a dyn SegmentFile,
    /// The node.
    pub code: Code,
    /// The number of the segment that its record is in.
    pub segment: u32,
    /// The number of the record there.
    pub record: u32,
}

impl<'a> SegmentNode<'a> {
    /// The node's records: see [`SegmentFile::subtree`].
    pub(in crate::store) fn subtree(&self) -> Result<Subtree<'a>> {
        self.file.subtree(self.segment, self.record)
    }
}

/// Records of a node and of all that is below it in its segment.
pub struct Subtree<'a> {
    bytes: FileBytes<'a>,
    range: Range<usize>,
}

impl<'a> Subtree<'a> {
    /// A part of a segment's bytes; no records at all if the range lies.
    pub(in crate::store) fn new(bytes: FileBytes<'a>, range: Range<usize>) -> Subtree<'a> {
        let range = if bytes.get(range.clone()).is_some() { range } else { 0..0 };
        Subtree { bytes, range }
    }

    /// The records' bytes.
    pub(in crate::store) fn records(&self) -> &[u8] {
        &self.bytes[self.range.clone()]
    }
}

/// A record of an Autumnal file: whoever writes to that file need not write it again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordRef {
    /// The file.
    pub(in crate::store) file: FileId,
    /// Offset of the record in the file.
    pub(in crate::store) address: u64,
    /// Levels below the node.
    pub height: u8,
}

/// Action at a pair of nodes when two trees are merged into one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MergeAction {
    /// Nothing.
    Void,
    /// The node of this tree, with all that is below it.
    Take(usize),
    /// Something that neither tree has.
    Fill,
    /// A LEAF with the joined values of two LEAFs: see [`Join`].
    Join,
    /// An INNER node, whose children are merged in turn.
    Split,
}

/// Operation that joins the values of two LEAFs to one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Join {
    /// The smaller sample of each channel.
    Min,
    /// The larger sample of each channel.
    Max,
    /// The sum per channel, kept within what the type can hold.
    Add,
    /// The difference per channel, kept within what the type can hold.
    Subtract,
    /// The value, if both are the same; else VOID.
    Equal,
    /// The second value, if it is not the same as the first; else VOID.
    Changed,
}

impl Join {
    /// Joins two values; `None` is VOID. What is computed with samples is missing where one of them is.
    pub(crate) fn values(self, value_type: ValueType, a: Value, b: Value) -> Option<Value> {
        let joined = with_native_type!(value_type, V => self.native::<V>(native(a), native(b)).map(erase))?;
        let missing = value_type.all_missing().filter(|_| self.computes_samples());
        let Some(missing) = missing else { return Some(joined) };
        let (in_a, in_b) = (value_type.present(a), value_type.present(b));
        let is_there = |channel: usize| in_a[channel] && in_b[channel];
        let any = (0..usize::from(value_type.channels)).any(is_there);
        any.then(|| value_type.by_channel(|channel| if is_there(channel) { joined } else { missing }))
    }

    /// Whether values are made sample by sample, instead of taken as they are.
    pub(crate) fn computes_samples(self) -> bool {
        matches!(self, Join::Min | Join::Max | Join::Add | Join::Subtract)
    }

    /// Joins two values of known type; `None` is VOID.
    #[inline]
    pub(super) fn native<V: Native>(self, a: V, b: V) -> Option<V> {
        match self {
            Join::Min => Some(a.min(b)),
            Join::Max => Some(a.max(b)),
            Join::Add => Some(a.by_channel(b, |a, b| a + b)),
            Join::Subtract => Some(a.by_channel(b, |a, b| a - b)),
            Join::Equal => a.same(b).then_some(a),
            Join::Changed => (!a.same(b)).then_some(b),
        }
    }
}

/// Merge actions by what each of two trees has at a node.
#[derive(Clone, Copy, Debug)]
pub struct MergeTable([[MergeAction; 3]; 3]);

impl MergeTable {
    /// Asks once for each pair of states.
    pub fn new(action: impl Fn([NodeState; 2]) -> MergeAction) -> MergeTable {
        const STATES: [NodeState; 3] = [NodeState::Void, NodeState::Leaf, NodeState::Inner];
        MergeTable(STATES.map(|first| STATES.map(|second| action([first, second]))))
    }

    /// The action for a pair of states.
    #[inline]
    pub fn get(&self, [first, second]: [NodeState; 2]) -> MergeAction {
        self.0[first as usize][second as usize]
    }
}

/// A node of two stored trees that are merged into one, cell by cell, with all that is below it.
#[derive(Clone, Copy)]
pub struct Overlay<'a> {
    /// The node of each of the two trees.
    pub nodes: [Child<SegmentNode<'a>>; 2],
    /// Actions by which they are merged.
    pub actions: MergeTable,
    /// Operation on values where the actions say so.
    pub join: Join,
}
