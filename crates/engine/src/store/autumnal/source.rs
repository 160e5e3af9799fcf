//! A commit's nodes as a source, and as nodes that a writer can keep or reuse.

use super::extents::ByteAccess;
use super::node::AutumnalNode;
use super::reader::{Autumnal, MAX_TRAVERSED, PointeredRecord};
use crate::store::builder::{RecordFile, RecordRef, ReusableSource, StoredNode, Subtree};
use crate::store::records::dense::DenseRows;
use crate::store::records::{RunChildren, Runs};
use crate::tree::{CellBlock, Child, Children, Source};
use spinney_base::TreeType;
use spinney_base::value::ZoneStats;
use spinney_base::{Error, Result};
use spinney_container::{Header, INNER, LEAF, VOID};

impl Autumnal {
    /// Writes the children of an INNER node as nodes of a source that wraps this file. Equals
    /// [`Source::children`], but needs no second array for sources with their own node type.
    pub(crate) fn children_with<N>(
        &self,
        node: &AutumnalNode,
        children: &mut Children<N>,
        node_of: impl Fn(AutumnalNode) -> N,
    ) -> Result<()> {
        match self.extents().mapped() {
            Some(mapped) => self.children_in(mapped, *node, children, node_of),
            None => self.children_in(self.extents(), *node, children, node_of),
        }
    }

    /// Writes the children of a node to the start of `children`. Traversals spend most of their
    /// time here.
    #[inline(never)]
    fn children_in<'a, A: ByteAccess<'a>, N>(
        &self,
        access: A,
        node: AutumnalNode,
        children: &mut Children<N>,
        node_of: impl Fn(AutumnalNode) -> N,
    ) -> Result<()> {
        let record = self.record_in(access, node)?;
        let layout = &self.layout().run;
        let mut here = RunChildren::default();
        let read = layout.run_children(record.run(), node.place, &mut here);
        read.ok_or_else(|| self.bad_run(node.address))?;
        let target_height = self.heights().target_height(record.height);
        for (step, (child, here)) in children.iter_mut().zip(&here[..layout.children()]).enumerate() {
            *child = match here.state {
                VOID => Child::Void,
                LEAF => Child::Leaf(here.value),
                _ if node.height <= 1 => {
                    return Err(self.bad_record(
                        node.address,
                        "an INNER node at the deepest level",
                        "VOID or LEAF",
                    ));
                }
                state => {
                    let path = node.path as usize * layout.children() + step;
                    let node = if target_height == Some(node.height - 1) {
                        self.follow(&record, path)?.ok_or_else(|| self.no_pointer(node.address))?
                    } else if state == INNER {
                        AutumnalNode { height: node.height - 1, path: path as u8, place: here.node, ..node }
                    } else {
                        return Err(self.bad_run(node.address));
                    };
                    Child::Inner { representative: here.value, node: node_of(node) }
                }
            };
        }
        if self.has_zone(node) { self.check_zone(access, node, &record) } else { Ok(()) }
    }
}

impl Source for Autumnal {
    type Node = AutumnalNode;

    #[inline]
    fn form(&self) -> TreeType {
        self.layout().form
    }

    fn depth(&self) -> u8 {
        self.header().depth()
    }

    /// # Errors
    /// If the tree has too many INNER nodes to be traversed as a whole, which is only possible if
    /// subtrees are shared.
    fn root(&self) -> Result<Child<AutumnalNode>> {
        if let Child::Inner { node, .. } = self.root_child() {
            let nodes = self.claimed_below(self.extents(), node)?;
            if nodes > MAX_TRAVERSED {
                let found = format!("a traversal of {nodes} nodes, most of which share records");
                let advice = "read a window, or a coarser level";
                return Err(Error::unsupported(self.path(), found, advice));
            }
        }
        Ok(self.root_child())
    }

    fn children(&self, node: &AutumnalNode, children: &mut Children<AutumnalNode>) -> Result<()> {
        self.children_with(node, children, |node| node)
    }

    fn cells(&self, node: &AutumnalNode, levels: u8) -> Result<Option<CellBlock>> {
        if node.height != levels || levels > self.heights().run {
            return Ok(None);
        }
        let record = self.record(*node)?;
        let block = self.layout().run.dense_at(record.run(), node.place);
        Ok(block.filter(|block| block.levels == levels).and_then(|block| block.cells()))
    }

    fn check_unchanged(&self) -> Result<()> {
        Autumnal::check_unchanged(self)
    }

    fn tally(&self, node: &AutumnalNode) -> Result<Option<ZoneStats>> {
        Ok(self.zone(*node)?.map(|zone| zone.tally))
    }
}

impl ReusableSource for Autumnal {
    fn stored(&self, node: &AutumnalNode) -> Option<StoredNode<'_>> {
        let AutumnalNode { address, height, place, .. } = *node;
        (height <= self.heights().run && place.below == 0).then_some(StoredNode {
            file: self,
            height,
            run: address,
            record: place.record,
        })
    }

    fn kept(&self, node: &AutumnalNode) -> Option<RecordRef> {
        let AutumnalNode { address, height, .. } = *node;
        let (file, header) = (self.archive.file, self.header());
        let (rule, counts_classes) = (header.rule, header.counts_classes());
        self.has_zone(*node).then_some(RecordRef { file, address, height, rule, counts_classes })
    }
}

/// Serves only records that are one run down to the cells: see [`ReusableSource::stored`]. The
/// number of a run is the address of its record.
impl RecordFile for Autumnal {
    fn file_header(&self) -> &Header {
        self.header()
    }

    fn subtree(&self, run: u64, record: u32) -> Result<Subtree<'_>> {
        // (Not the height of the node, which need not be known: all nodes of at most this height
        // are in records of one height, and that alone determines how the record is read.)
        let height = self.heights().run_of(self.header().depth());
        let PointeredRecord { bytes, fields, .. } = self.record(AutumnalNode::new(run, height))?;
        let (layout, at) = (&self.layout().run, record as usize);
        let records = fields.run(&bytes);
        let skip = layout.head(records, at).map_or(0, |head| head.skip);
        let length = layout.subtree(records, at, skip).map_or(0, <[u8]>::len);
        let start = fields.run_start() + at * layout.size;
        Ok(Subtree::new(bytes, start..start + length))
    }
}
