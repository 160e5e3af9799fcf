//! Lookup by FD code: the segment of a node, its record in the segment, its value.

use super::reader::Goblin;
use super::segment::Segment;
use crate::store::records::{Descent, Runs};
use crate::tree::Child;
use spinney_base::space::Code;
use spinney_base::value::Value;
use spinney_base::{Error, Result};

/// Position of a node's record.
pub(crate) struct Located<'a> {
    /// The deepest segment that has the record.
    pub segment: Segment<'a>,
    /// The record's index in the segment, or that of the dense block that contains the node.
    pub record: usize,
    /// The level of the record's node.
    pub level: u8,
}

impl Goblin {
    /// Returns the deepest segment among those of a node and its ancestors, in a file whose root is
    /// INNER.
    #[inline]
    pub(super) fn segment_above(&self, code: Code) -> Result<Segment<'_>> {
        self.segment(self.find_segment(code)?.ok_or_else(|| self.no_root())?)
    }

    /// Returns the deepest segment with a node's record, or with the dense block that contains the
    /// node. If the node lies in a uniform block (VOID or LEAF) outside of dense blocks, returns
    /// its value instead.
    ///
    /// The representative is zero: the parent's record has it, which may be in another segment.
    /// [`Goblin::value_at`] returns it.
    #[inline]
    pub(crate) fn locate(&self, code: Code) -> Result<Child<Located<'_>>> {
        match self.root_child() {
            Child::Void => return Ok(Child::Void),
            Child::Leaf(value) => return Ok(Child::Leaf(value)),
            Child::Inner { .. } => {}
        }
        let segment = self.segment_above(code)?;
        match (self.descend)(segment.records(), 0, segment.code.level(), code) {
            Descent::Void => Ok(Child::Void),
            Descent::Leaf(value) => Ok(Child::Leaf(value)),
            Descent::Inner(record) => {
                let node = Located { segment, record, level: code.level() };
                Ok(Child::Inner { representative: Value::ZERO, node })
            }
            Descent::Dense(record, level) => {
                Ok(Child::Inner { representative: Value::ZERO, node: Located { segment, record, level } })
            }
            // The record should be in a deeper segment, but this is the deepest one.
            Descent::Cut(level) => Err(self.bad_cut(code.ancestor(level))),
            Descent::BadSkip(record) => Err(self.bad_skip(&segment, record)),
        }
    }

    /// Returns the value of a node (a cell, or a block at coarse detail): its own, or that of the
    /// LEAF it lies in; `None` is VOID. One search in the segment index and one descent in one
    /// segment.
    ///
    /// # Errors
    /// If the file is corrupt there.
    pub fn value_at(&self, code: Code) -> Result<Option<Value>> {
        let Some(parent) = code.parent() else {
            return Ok(self.root_child().value());
        };
        Ok(match self.locate(parent)? {
            Child::Void => None,
            Child::Leaf(value) => Some(value),
            Child::Inner { node: Located { segment, record, level }, .. } => {
                let value = self.layout.value_below(segment.records(), record, level, code);
                value.ok_or_else(|| self.bad_skip(&segment, record))?
            }
        })
    }

    /// Returns the error for a segment index without the segment that every INNER root owns.
    #[cold]
    pub(super) fn no_root(&self) -> Error {
        self.corrupt("directory".into(), "no root segment", "the segment of the root")
    }

    /// Returns the error for a record whose children's extents are not disjoint or not inside its
    /// own.
    #[cold]
    pub(crate) fn bad_skip(&self, segment: &Segment<'_>, record: usize) -> Error {
        let part = format!("segment {}, record {record}", segment.code);
        self.corrupt(
            part,
            "a child's skip beyond the end of the node",
            "skips that sum up to that of the node",
        )
    }

    /// Returns the error for a node that is CUT although there is no deeper segment.
    #[cold]
    pub(crate) fn bad_cut(&self, code: Code) -> Error {
        self.corrupt(format!("node {code}"), "a CUT node without a segment", "a segment with its record")
    }
}
