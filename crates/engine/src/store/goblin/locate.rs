//! Lookup by FD code: the segment of a node, its record in there, its value.

use super::reader::Goblin;
use super::segment::Segment;
use crate::store::records::{Descent, Runs};
use crate::tree::Child;
use spinney_base::space::Code;
use spinney_base::value::Value;
use spinney_base::{Error, Result};

/// Position of a node's record.
pub(crate) struct Located<'a> {
    /// The deepest segment that has it.
    pub segment: Segment<'a>,
    /// The record's number there, or that of the dense block which has the node.
    pub record: usize,
    /// The level of the record's node.
    pub level: u8,
}

impl Goblin {
    /// The deepest segment among those of a node and its ancestors, in a file whose root is INNER.
    #[inline]
    pub(super) fn segment_above(&self, code: Code) -> Result<Segment<'_>> {
        self.segment(self.find_segment(code)?.ok_or_else(|| self.no_root())?)
    }

    /// The deepest segment with a node's record, or with the dense block that has the node; or the uniform value (VOID or LEAF)
    /// of the block it lies in, if that is no part of a dense block.
    ///
    /// The representative is left out (it is zero): it stands with the parent, which may be in another
    /// segment, and who wants it asks [`Goblin::value_at`].
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
            // The record is in a deeper segment, and this is the deepest one.
            Descent::Cut(level) => Err(self.bad_cut(code.ancestor(level))),
            Descent::BadSkip(record) => Err(self.bad_skip(&segment, record)),
        }
    }

    /// The value of a node (a cell, or a block at coarse detail): its own, or that of the LEAF it lies in;
    /// `None` is VOID. One search in the directory and one descent in one segment.
    ///
    /// # Errors
    /// If the file is damaged there.
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

    /// The error for a directory without the segment that every INNER root owns.
    #[cold]
    pub(super) fn no_root(&self) -> Error {
        self.corrupt("directory".into(), "no root", "one")
    }

    /// The error for a record whose children's extents are not beside each other inside its own.
    #[cold]
    pub(crate) fn bad_skip(&self, segment: &Segment<'_>, record: usize) -> Error {
        let part = format!("segment {}, record {record}", segment.code);
        self.corrupt(part, "a child's skip that leads out of the node", "skips that add up")
    }

    /// The error for a node that is CUT where there is no deeper segment.
    #[cold]
    pub(crate) fn bad_cut(&self, code: Code) -> Error {
        self.corrupt(format!("node {code}"), "CUT, but no deeper segment", "a segment with its record")
    }
}
