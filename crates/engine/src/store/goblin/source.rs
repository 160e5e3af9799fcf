//! A file's nodes as a source, and as nodes whose segments can be copied.

use super::reader::Goblin;
use crate::store::builder::{RecordFile, ReusableSource, StoredNode, Subtree};
use crate::store::records::dense::DenseRows;
use crate::store::records::{RunChild, RunChildren, RunNode, Runs};
use crate::tree::{CellBlock, Child, Children, Source};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::space::Code;
use spinney_container::{CUT, Header, LEAF, VOID};

/// An INNER node of an open file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GoblinNode {
    /// The node.
    pub code: Code,
    /// Index of the segment with its record.
    pub segment: u32,
    /// Its record in the segment, or its position in a dense block.
    pub(crate) place: RunNode,
}

/// A traversal switches to each node's own segment, so it never reaches a CUT.
impl Source for Goblin {
    type Node = GoblinNode;

    fn form(&self) -> TreeType {
        self.header.form
    }

    fn depth(&self) -> u8 {
        self.header.depth()
    }

    fn root(&self) -> Result<Child<GoblinNode>> {
        Ok(match self.root_child() {
            Child::Void => Child::Void,
            Child::Leaf(value) => Child::Leaf(value),
            Child::Inner { representative, .. } => {
                let code = Code::root(self.layout.dimension);
                let segment = self.find_segment(code)?.ok_or_else(|| self.no_root())? as u32;
                Child::Inner { representative, node: GoblinNode { code, segment, place: RunNode::default() } }
            }
        })
    }

    fn check_unchanged(&self) -> Result<()> {
        Goblin::check_unchanged(self)
    }

    fn children(&self, node: &GoblinNode, children: &mut Children<GoblinNode>) -> Result<()> {
        self.children_with(node, children, |node| node)
    }

    fn cells(&self, node: &GoblinNode, levels: u8) -> Result<Option<CellBlock>> {
        self.dense_cells(node, levels)
    }
}

impl Goblin {
    /// Writes the children of an INNER node as nodes of another type, which `node_of` makes. Does
    /// the same as [`Source::children`], without a second array for sources that wrap this file.
    pub(crate) fn children_with<N>(
        &self,
        node: &GoblinNode,
        children: &mut Children<N>,
        node_of: impl Fn(GoblinNode) -> N,
    ) -> Result<()> {
        let segment = self.segment(node.segment as usize)?;
        let (layout, shape) = (&self.layout, &self.header.shape);
        let level = node.code.level() + 1;
        if level > shape.depth {
            return Err(self.corrupt(
                format!("node {}", node.code),
                "an INNER node at the deepest level",
                "VOID or LEAF",
            ));
        }
        let mut here = RunChildren::default();
        let read = layout.run_children(segment.records(), node.place, &mut here);
        read.ok_or_else(|| self.bad_skip(&segment, node.place.record as usize))?;
        let candidates = shape.is_candidate(level);
        let mut is_unread = false;
        for (step, (child, here)) in children.iter_mut().zip(&here[..layout.children()]).enumerate() {
            let RunChild { state, value, node: place } = *here;
            *child = match state {
                VOID => Child::Void,
                LEAF => Child::Leaf(value),
                _ => {
                    let code = node.code.child(step);
                    if level == shape.depth {
                        return Err(self.corrupt(
                            format!("node {code}"),
                            "an INNER node at the deepest level",
                            "VOID or LEAF",
                        ));
                    }
                    let own = if candidates { self.find_segment(code) } else { Ok(None) };
                    let Some(own) = defer_missing(own, &mut is_unread)? else { continue };
                    let node = match own {
                        // The segment found may be that of an ancestor.
                        Some(own) if own != segment.index() && self.segment_code(own)? == Some(code) => {
                            GoblinNode { code, segment: own as u32, place: RunNode::default() }
                        }
                        _ if state == CUT => return Err(self.bad_cut(code)),
                        _ => GoblinNode { code, segment: node.segment, place },
                    };
                    Child::Inner { representative: value, node: node_of(node) }
                }
            };
        }
        finish_deferred(is_unread)
    }

    /// Returns the cells below a node that is a dense block down to the cells, which are `levels`
    /// levels below it.
    fn dense_cells(&self, node: &GoblinNode, levels: u8) -> Result<Option<CellBlock>> {
        if node.code.level() + levels != self.header.depth() {
            return Ok(None);
        }
        let segment = self.segment(node.segment as usize)?;
        let block = self.layout.dense_at(segment.records(), node.place);
        Ok(block.filter(|block| block.levels == levels).and_then(|block| block.cells()))
    }
}

impl ReusableSource for Goblin {
    fn stored(&self, node: &GoblinNode) -> Option<StoredNode<'_>> {
        let GoblinNode { code, segment, place } = *node;
        let height = self.header.depth() - code.level();
        // (A node inside a dense block is not a run of its own.)
        (place.below == 0).then_some(StoredNode {
            file: self,
            height,
            run: segment.into(),
            record: place.record,
        })
    }
}

impl RecordFile for Goblin {
    fn file_header(&self) -> &Header {
        &self.header
    }

    fn subtree(&self, run: u64, record: u32) -> Result<Subtree<'_>> {
        let segment = self.segment(run as usize)?;
        let (records, at) = (segment.records(), record as usize);
        // Empty if the node's own record is inconsistent. Code that copies records then falls back
        // to a node-by-node traversal, which reports the error. Class counts follow the records and
        // must not be taken for records.
        let skip = self.layout.head(records, at).map_or(0, |head| head.skip);
        let length = self.layout.subtree(records, at, skip).map_or(0, <[u8]>::len);
        let start = at * self.layout.size;
        Ok(Subtree::new(segment.into_bytes(), start..start + length))
    }
}
