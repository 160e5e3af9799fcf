//! Traverses subtrees so that each record is read once, however often it occurs.
//!
//! Storing equal subtrees once turns a tree into a directed acyclic graph, which can have any
//! number of nodes per record. Sums over all nodes need only the records and their multiplicities.
//! The graph is traversed level by level from the top, and the nodes of a level in the order of
//! their records in the file. So all occurrences of a record are merged before its children are
//! read. If a box clips nodes, those with the same record and the same clipping are merged: most of
//! them, along each side of the box.

use std::env::temp_dir;
use std::mem;

use super::node::AutumnalNode;
use super::reader::Autumnal;
use crate::tree::{Child, Source, no_children};
use spinney_base::Result;
use spinney_base::io::Sorter;
use spinney_base::space::Bounds;
use spinney_base::value::Value;
use spinney_packing::PLAIN_PER_BYTE;

/// Memory in bytes for the pending nodes of all levels; any excess goes to temporary files.
const MEMORY: u64 = 64 << 20;

/// Visitor of a tree's contents in a box.
pub(crate) trait OccurrenceVisitor {
    /// Receives an INNER node that is entirely in the box and occurs `times` times. Returns whether
    /// to visit its descendants.
    fn inner(&mut self, node: AutumnalNode, times: u64) -> Result<bool>;
    /// Receives a VOID (`None`) or LEAF node with `levels` levels below it that occurs `times`
    /// times. `cells` is the number of cells in the box over all occurrences.
    fn uniform(&mut self, value: Option<Value>, levels: u8, times: u64, cells: u64) -> Result<()>;
}

/// Nodes to visit, with their multiplicities.
struct PendingNodes {
    /// Nodes by height.
    by_height: Vec<Option<Sorter>>,
}

/// Nodes with the same record and the same clipping.
#[derive(Clone, Copy)]
struct EqualNodes {
    /// Offset of their record.
    address: u64,
    /// Cells in the box, relative to the node's first cell; `None` if all are.
    clip: Option<Bounds>,
    /// Number of nodes.
    times: u64,
}

impl EqualNodes {
    fn to_item(self) -> Vec<u8> {
        let Bounds { min, max } = self.clip.unwrap_or(Bounds { min: [0; 3], max: [0; 3] });
        let numbers = [self.address, self.times].into_iter().chain(min).chain(max);
        numbers.flat_map(u64::to_le_bytes).collect()
    }

    fn from_item(item: &[u8]) -> EqualNodes {
        let mut numbers =
            item.chunks_exact(8).map(|bytes| u64::from_le_bytes(bytes.try_into().expect("8 bytes")));
        let mut number = || numbers.next().expect("8 numbers");
        let (address, times) = (number(), number());
        let [min, max] = [(); 2].map(|()| [(); 3].map(|()| number()));
        let clip = Some(Bounds { min, max }).filter(|clip| !clip.is_empty());
        EqualNodes { address, clip, times }
    }
}

/// Adds nodes to the entry of the same record and clipping, or adds an entry.
fn count(found: &mut Vec<(u8, EqualNodes)>, height: u8, more: EqualNodes) {
    match found.iter_mut().find(|(_, alike)| (alike.address, alike.clip) == (more.address, more.clip)) {
        Some((_, alike)) => alike.times += more.times,
        None => found.push((height, more)),
    }
}

impl PendingNodes {
    /// Creates an empty queue for a tree of `depth` levels.
    fn new(depth: u8) -> PendingNodes {
        PendingNodes { by_height: (0..=depth).map(|_| None).collect() }
    }

    fn add(&mut self, height: u8, nodes: EqualNodes) -> Result<()> {
        let memory = MEMORY / self.by_height.len() as u64;
        let level =
            self.by_height[usize::from(height)].get_or_insert_with(|| Sorter::new(&temp_dir(), memory));
        level.push(nodes.address, &nodes.to_item())
    }

    /// Visits all nodes of a height, merged by record and clipping.
    fn take(&mut self, height: u8, mut each: impl FnMut(&mut Self, EqualNodes) -> Result<()>) -> Result<()> {
        let Some(sorter) = mem::take(&mut self.by_height[usize::from(height)]) else { return Ok(()) };
        // Entries of one record. (A box clips the nodes of a level in at most four ways along each
        // axis.)
        let mut same: Vec<(u8, EqualNodes)> = Vec::new();
        sorter.finish(&mut |item| {
            let alike = EqualNodes::from_item(item);
            if same.first().is_some_and(|(_, first)| first.address != alike.address) {
                same.drain(..).try_for_each(|(_, alike)| each(self, alike))?;
            }
            count(&mut same, height, alike);
            Ok(())
        })?;
        same.into_iter().try_for_each(|(_, alike)| each(self, alike))
    }
}

impl Autumnal {
    /// Returns whether the tree has more INNER nodes than the file has space for, so that some
    /// records represent several nodes. The file size bounds the time to traverse any other tree.
    ///
    /// # Errors
    /// If the file is corrupt.
    pub(crate) fn is_folded(&self) -> Result<bool> {
        let least = self.layout().run.least_node();
        // (Packed records can be far larger than their encoded bytes.)
        let packed = if self.extents().packed().is_some() { PLAIN_PER_BYTE } else { 1 };
        Ok(self.claimed_inner_nodes()? > self.extents().end.saturating_mul(packed) / least)
    }

    /// Visits everything that the tree has in a box of cells of the deepest level. Each record is
    /// read at most once for each level that it occurs at and each way in which the box clips it.
    ///
    /// # Errors
    /// If the file is corrupt, temporary files cannot be used, or the visitor fails.
    pub(crate) fn each_distinct(&self, bounds: &Bounds, visitor: &mut dyn OccurrenceVisitor) -> Result<()> {
        let (dimension, depth) = (self.form().dimension, self.depth());
        let space = Bounds::space(dimension, depth);
        let clip = bounds.intersect(&space);
        let node = match self.root_child() {
            _ if clip.is_empty() => return Ok(()),
            Child::Inner { node, .. } => node,
            uniform => return visitor.uniform(uniform.value(), depth, 1, clip.volume()),
        };
        let mut waiting = PendingNodes::new(depth);
        let clip = Some(clip).filter(|clip| *clip != space);
        waiting.add(depth, EqualNodes { address: node.address, clip, times: 1 })?;
        for height in (1..=depth).rev() {
            waiting.take(height, |waiting, EqualNodes { address, clip, times }| {
                let mut targets: Vec<(u8, EqualNodes)> = Vec::new();
                self.visit_below(&AutumnalNode::new(address, height), (clip, times), &mut targets, visitor)?;
                targets.into_iter().try_for_each(|(height, alike)| waiting.add(height, alike))
            })?;
        }
        Ok(())
    }

    /// Visits the nodes that a record contains at and below a node. Nodes with records of their own
    /// are added to `targets` with their heights.
    fn visit_below(
        &self,
        node: &AutumnalNode,
        (clip, times): (Option<Bounds>, u64),
        targets: &mut Vec<(u8, EqualNodes)>,
        visitor: &mut dyn OccurrenceVisitor,
    ) -> Result<()> {
        if clip.is_none() && !visitor.inner(*node, times)? {
            return Ok(());
        }
        let dimension = self.form().dimension;
        let whole = Bounds::space(dimension, node.height);
        let mut children = no_children();
        self.children(node, &mut children)?;
        for (step, child) in children[..dimension.children()].iter().enumerate() {
            let space = whole.child(dimension, step);
            let clip = clip.unwrap_or(whole).intersect(&space);
            match child {
                _ if clip.is_empty() => {}
                Child::Inner { node, .. } => {
                    let clip = (clip != space).then(|| clip.within(&space));
                    if node.has_record() {
                        // (Siblings are often alike.)
                        count(targets, node.height, EqualNodes { address: node.address, clip, times });
                    } else {
                        self.visit_below(node, (clip, times), targets, visitor)?;
                    }
                }
                // (All occurrences are disjoint in the tree's space, so the product does not exceed
                // its cell count.)
                uniform => {
                    visitor.uniform(uniform.value(), node.height - 1, times, clip.volume() * times)?;
                }
            }
        }
        Ok(())
    }
}
