//! Goes through what is below some nodes, each record once, however often it occurs.
//!
//! Equal subtrees that are stored once make a tree a directed graph, which can have any number of nodes for each of its
//! records. Sums over all nodes need the records alone, and how often each of them occurs. The graph is gone through
//! level by level from the top, the nodes of a level in the order of their records in the file: then all occurrences
//! of one come together, and have come before its children are looked at. Where a box cuts nodes, those of one record
//! that it cuts alike come together: most along each of its sides.

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

/// Bytes for the nodes of all levels that wait; what needs more goes to temporary files.
const MEMORY: u64 = 64 << 20;

/// Bytes of a node that waits: its record's place, its occurrences, and the cells that count.
const ITEM: usize = 8 * 8;

/// Is told of what a tree has in a box.
pub(crate) trait Occurring {
    /// An INNER node all of which is in the box, and which occurs so many times: whether to go on below it.
    fn inner(&mut self, node: AutumnalNode, times: u64) -> Result<bool>;
    /// A VOID (`None`) or LEAF node with so many levels below it, which occurs so many times; so many cells of all of these
    /// are in the box.
    fn uniform(&mut self, value: Option<Value>, levels: u8, times: u64, cells: u64) -> Result<()>;
}

/// Nodes to go through, each with the number of its occurrences.
struct Waiting {
    /// By the levels below them.
    by_height: Vec<Option<Sorter>>,
}

/// Nodes that are alike.
#[derive(Clone, Copy)]
struct Alike {
    /// Offset of their record.
    address: u64,
    /// The cells that count, counted from the node's first; `None` is all of them.
    part: Option<Bounds>,
    /// Their number.
    times: u64,
}

impl Alike {
    fn to_item(self) -> Vec<u8> {
        let Bounds { min, max } = self.part.unwrap_or(Bounds { min: [0; 3], max: [0; 3] });
        let numbers = [self.address, self.times].into_iter().chain(min).chain(max);
        numbers.flat_map(u64::to_le_bytes).collect()
    }

    fn from_item(item: &[u8]) -> Alike {
        let mut numbers =
            item.chunks_exact(8).map(|bytes| u64::from_le_bytes(bytes.try_into().expect("8 bytes")));
        let mut number = || numbers.next().expect("eight numbers");
        let (address, times) = (number(), number());
        let [min, max] = [(); 2].map(|()| [(); 3].map(|()| number()));
        let part = Some(Bounds { min, max }).filter(|part| !part.is_empty());
        Alike { address, part, times }
    }
}

/// Adds nodes of a height to those of the same record.
fn count(found: &mut Vec<(u8, Alike)>, height: u8, more: Alike) {
    match found.iter_mut().find(|(_, alike)| (alike.address, alike.part) == (more.address, more.part)) {
        Some((_, alike)) => alike.times += more.times,
        None => found.push((height, more)),
    }
}

impl Waiting {
    /// None yet, of a tree of so many levels.
    fn new(depth: u8) -> Waiting {
        Waiting { by_height: (0..=depth).map(|_| None).collect() }
    }

    fn add(&mut self, height: u8, nodes: Alike) -> Result<()> {
        let memory = MEMORY / self.by_height.len() as u64;
        let level =
            self.by_height[usize::from(height)].get_or_insert_with(|| Sorter::new(&temp_dir(), ITEM, memory));
        level.push(nodes.address, nodes.to_item())
    }

    /// Hands out all nodes of a height, those that are alike together.
    fn take(&mut self, height: u8, mut each: impl FnMut(&mut Self, Alike) -> Result<()>) -> Result<()> {
        let Some(sorter) = mem::take(&mut self.by_height[usize::from(height)]) else { return Ok(()) };
        // Those of one record. (A box cuts the nodes of a level in no more than four ways along each axis.)
        let mut same: Vec<(u8, Alike)> = Vec::new();
        sorter.finish(&mut |item| {
            let alike = Alike::from_item(item);
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
    /// Whether the tree has more INNER nodes than the file has room for, so that some records stand for several of them.
    /// All other trees are walked in a time that the file's bytes bound.
    ///
    /// # Errors
    /// If the file is damaged.
    pub(crate) fn is_folded(&self) -> Result<bool> {
        let least = self.layout().run.least_node();
        // (Packed records may be many more than their bytes.)
        let packed = if self.extents().packed().is_some() { PLAIN_PER_BYTE } else { 1 };
        Ok(self.claimed_records()? > self.extents().end.saturating_mul(packed) / least)
    }

    /// Goes through all that the tree has in a box of cells of the deepest level, each record at most once for each level
    /// that it occurs at and each way in which the box cuts it.
    ///
    /// # Errors
    /// If the file is damaged, temporary files cannot be used, or whoever is told fails.
    pub(crate) fn each_distinct(&self, bounds: &Bounds, told: &mut dyn Occurring) -> Result<()> {
        let (dimension, depth) = (self.form().dimension, self.depth());
        let space = Bounds::space(dimension, depth);
        let part = bounds.intersect(&space);
        let node = match self.root_child() {
            _ if part.is_empty() => return Ok(()),
            Child::Inner { node, .. } => node,
            uniform => return told.uniform(uniform.value(), depth, 1, part.volume()),
        };
        let mut waiting = Waiting::new(depth);
        let part = Some(part).filter(|part| *part != space);
        waiting.add(depth, Alike { address: node.address, part, times: 1 })?;
        for height in (1..=depth).rev() {
            waiting.take(height, |waiting, Alike { address, part, times }| {
                let mut below: Vec<(u8, Alike)> = Vec::new();
                self.below(&AutumnalNode::new(address, height), (part, times), &mut below, told)?;
                below.into_iter().try_for_each(|(height, alike)| waiting.add(height, alike))
            })?;
        }
        Ok(())
    }

    /// Goes through what a record has of a node and below it. Nodes that have records of their own are added to others, with
    /// their heights.
    fn below(
        &self,
        node: &AutumnalNode,
        (part, times): (Option<Bounds>, u64),
        below: &mut Vec<(u8, Alike)>,
        told: &mut dyn Occurring,
    ) -> Result<()> {
        if part.is_none() && !told.inner(*node, times)? {
            return Ok(());
        }
        let dimension = self.form().dimension;
        let whole = Bounds::space(dimension, node.height);
        let mut children = no_children();
        self.children(node, &mut children)?;
        for (step, child) in children[..dimension.children()].iter().enumerate() {
            let space = whole.child(dimension, step);
            let part = part.unwrap_or(whole).intersect(&space);
            match child {
                _ if part.is_empty() => {}
                Child::Inner { node, .. } => {
                    let part = (part != space).then(|| part.within(&space));
                    if node.has_record() {
                        // (Siblings are often alike.)
                        count(below, node.height, Alike { address: node.address, part, times });
                    } else {
                        self.below(node, (part, times), below, told)?;
                    }
                }
                // (All occurrences are in the tree's space: there are no more cells than that has.)
                uniform => {
                    told.uniform(uniform.value(), node.height - 1, times, part.volume() * times)?;
                }
            }
        }
        Ok(())
    }
}
