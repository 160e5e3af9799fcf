//! Walking a file: its nodes as a source, and as something whose segments can be copied.

use super::reader::Goblin;
use crate::Result;
use crate::space::Code;
use crate::store::builder::{ReusableSource, SegmentFile, SegmentNode, Subtree};
use crate::store::container::{CUT, Header, INNER, LEAF, VOID};
use crate::tree::{Child, Children, Form, Source};

/// An INNER node of an open file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// The node.
    pub code: Code,
    /// The number of the segment with its record.
    pub(crate) segment: u32,
    /// The number of its record there.
    pub(crate) record: u32,
}

/// A walk goes through every node's own segment, so it never meets a cut.
impl Source for Goblin {
    type Node = Node;

    fn form(&self) -> Form {
        self.header.form
    }

    fn depth(&self) -> u8 {
        self.header.depth()
    }

    fn root(&self) -> Result<Child<Node>> {
        Ok(match self.root_child() {
            Child::Void => Child::Void,
            Child::Leaf(value) => Child::Leaf(value),
            Child::Inner { representative, .. } => {
                let code = Code::root(self.layout.dimension);
                let segment = self.segment_above(code)?.index() as u32;
                Child::Inner { representative, node: Node { code, segment, record: 0 } }
            }
        })
    }

    fn check_unchanged(&self) -> Result<()> {
        Goblin::check_unchanged(self)
    }

    fn children(&self, node: &Node, children: &mut Children<Node>) -> Result<()> {
        self.children_with(node, children, |node| node)
    }
}

impl Goblin {
    /// Writes the children of an inner node as nodes of something that stands on this file: what
    /// [`Source::children`] does, without a second array for those who have nodes of their own.
    pub(crate) fn children_with<N>(
        &self,
        node: &Node,
        children: &mut Children<N>,
        node_of: impl Fn(Node) -> N,
    ) -> Result<()> {
        let segment = self.segment(node.segment as usize)?;
        let (layout, shape) = (&self.layout, &self.header.shape);
        let records = segment.records();
        let at = node.record as usize;
        let bad_skip = || self.bad_skip(&segment, at);
        let level = node.code.level() + 1;
        if level > shape.depth {
            return Err(self.corrupt(format!("node {}", node.code), "INNER", "no deeper node than a cell"));
        }
        let head = layout.head(records, at).ok_or_else(bad_skip)?;
        let candidates = shape.is_candidate(level);
        // The children's records follow each other up to the end of the node's own extent, which the step to
        // this node has checked; so no walk can leave the segment, or come to a record twice.
        let end = at + head.skip as usize;
        let mut next = at + 1;
        for (step, child) in children[..layout.children()].iter_mut().enumerate() {
            let state = head.state(step);
            *child = match state {
                VOID => Child::Void,
                LEAF => Child::Leaf(layout.value(records, at, step)),
                _ => {
                    let code = node.code.child(step);
                    if level == shape.depth {
                        return Err(self.corrupt(format!("node {code}"), "INNER", "a cell, VOID or LEAF"));
                    }
                    let mut here = Node { code, segment: node.segment, record: 0 };
                    if state == INNER {
                        let skip = if next < end { layout.head(records, next) } else { None };
                        let skip = skip.map_or(0, |head| head.skip as usize);
                        if skip == 0 || next + skip > end {
                            return Err(bad_skip());
                        }
                        here.record = next as u32;
                        next += skip;
                    }
                    let own = if candidates { self.find_segment(code) } else { None };
                    let node = match own {
                        // What is found may be the segment of an ancestor.
                        Some(own) if own != segment.index() && self.segment(own)?.code() == code => {
                            Node { code, segment: own as u32, record: 0 }
                        }
                        _ if state == CUT => return Err(self.bad_cut(code)),
                        _ => here,
                    };
                    Child::Inner { representative: layout.value(records, at, step), node: node_of(node) }
                }
            };
        }
        Ok(())
    }
}

impl ReusableSource for Goblin {
    fn stored(&self, node: &Node) -> Option<SegmentNode<'_>> {
        let Node { code, segment, record } = *node;
        Some(SegmentNode { file: self, code, segment, record })
    }
}

impl SegmentFile for Goblin {
    fn file_header(&self) -> &Header {
        &self.header
    }

    fn subtree(&self, segment: u32, record: u32) -> Result<Subtree<'_>> {
        let segment = self.segment(segment as usize)?;
        let (records, at) = (segment.records(), record as usize);
        // None at all if the node's own record lies: who takes the records over then goes the usual way,
        // which tells what is wrong. Class counts stand behind the records and must not pass for some.
        let skip = self.layout.head(records, at).map_or(0, |head| head.skip);
        let length = self.layout.subtree(records, at, skip).map_or(0, <[u8]>::len);
        let start = at * self.layout.size;
        Ok(Subtree::new(segment.into_bytes(), start..start + length))
    }
}
