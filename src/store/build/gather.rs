//! Gathers the nodes of one block from a source: node by node, but for subtrees that a file has stored and small blocks of
//! cells that the source can draw.

use std::ops::Range;

use super::block::{Block, Level};
use super::take::{Splice, Subtree, Taken};
use crate::Result;
use crate::space::Code;
use crate::store::goblin::{INNER, LEAF, Layout, Record, VOID};
use crate::tree::{CellBlock, Child, Overlay, Source, Stored, Verdict};
use crate::value::Value;

/// Cells of a block that is drawn, as a power of two: a quadtree's block of 32 x 32 cells, an octree's of 8 x 8 x 8. Larger
/// ones are drawn in vain where there is little detail.
const DRAWN_BITS: u8 = 10;

/// An INNER node whose children are still to be gathered.
enum Open<N> {
    /// A node of the source.
    Node(N),
    /// Cells that were drawn: the number of their block, and the first of the node's.
    Cells(u32, u32),
}

impl<D: Layout, V: Value> Block<D, V> {
    /// The block under `code`, whose root is the source's inner node `node`. Where `stored` gives a node of a file, its
    /// records are taken over.
    pub(in crate::store) fn from_source<'s, S: Source<Dim = D, Value = V>>(
        source: &'s S,
        code: Code<D>,
        height: u8,
        (representative, node): (V, S::Node),
        stored: impl Fn(&'s S, &S::Node, u8) -> Option<Stored<'s, D, V>>,
    ) -> Result<Self> {
        let mut taken = Taken::new(height);
        let mut drawn: Vec<CellBlock<V>> = Vec::new();
        let take = |taken: &mut Taken<D, V>, place, node: &S::Node, levels| -> Result<Option<Splice>> {
            let Some(stored) = stored(source, node, levels) else { return Ok(None) };
            Ok(taken.take(place, Subtree::of(&stored)?.records(), levels))
        };
        let open = |drawn: &mut Vec<CellBlock<V>>, node: S::Node, levels| -> Result<Open<S::Node>> {
            let is_small = levels == DRAWN_BITS / D::AXES as u8;
            let cells = if is_small { source.cells(&node, levels)? } else { None };
            Ok(match cells {
                Some(cells) => {
                    drawn.push(cells);
                    Open::Cells(drawn.len() as u32 - 1, 0)
                }
                None => Open::Node(node),
            })
        };
        let mut root = Level::root();
        if let Some(splice) = take(&mut taken, 0, &node, height)? {
            root.take(representative, splice);
            root.expanded = Some(Vec::new());
            return Ok(Block { code, height, levels: vec![root], taken });
        }
        let mut levels = vec![root];
        let mut nodes = vec![open(&mut drawn, node, height)?];
        for below in (0..height).rev() {
            let mut level = Level::new(nodes.len() * D::CHILDREN);
            let mut expanded = Vec::new();
            let mut deeper = Vec::new();
            for (group, node) in nodes.iter().enumerate() {
                let first_place = group * D::CHILDREN;
                match node {
                    Open::Node(node) => source.each_child(node, |i, child| {
                        let place = first_place + i;
                        match child {
                            Child::Void => {}
                            Child::Inner { representative, node } if below > 0 => {
                                if let Some(splice) = take(&mut taken, place, &node, below)? {
                                    level.take(representative, splice);
                                } else {
                                    expanded.push(place as u32);
                                    deeper.push(open(&mut drawn, node, below)?);
                                }
                            }
                            Child::Leaf(value) | Child::Inner { representative: value, .. } => {
                                level.put_leaf(place, value);
                            }
                        }
                        Ok(())
                    })?,
                    Open::Cells(block, first) => {
                        let size = 1 << (D::AXES * below as usize);
                        for place in first_place..first_place + D::CHILDREN {
                            let start = *first as usize + (place - first_place) * size;
                            match uniform(&drawn[*block as usize], start..start + size) {
                                Some(value) => {
                                    value.into_iter().for_each(|value| level.put_leaf(place, value))
                                }
                                None => {
                                    expanded.push(place as u32);
                                    deeper.push(Open::Cells(*block, start as u32));
                                }
                            }
                        }
                    }
                }
            }
            nodes = deeper;
            level.expanded = Some(expanded);
            levels.push(level);
            if nodes.is_empty() {
                break;
            }
        }
        Ok(Block { code, height, levels, taken })
    }

    /// The block under `code` of two stored subtrees, settled: what set operations spend most of their time on. `None` if
    /// records contradict each other; going through them the usual way tells what is wrong.
    pub(in crate::store) fn from_overlay(
        overlay: &Overlay<'_, D, V>,
        code: Code<D>,
        height: u8,
    ) -> Result<Option<Self>> {
        let subtrees = [Subtree::at(&overlay.places[0])?, Subtree::at(&overlay.places[1])?];
        let records = subtrees.each_ref().map(|subtree| subtree.as_ref().map_or(&[][..], Subtree::records));
        let mut taken = Taken::new(height);
        let mut levels = vec![Level::root()];
        let mut open = vec![overlay.places.map(|place| place.map_node(|_| 0))];
        for below in (0..height).rev() {
            let mut level = Level::new(open.len() * D::CHILDREN);
            let mut expanded = Vec::new();
            let mut deeper = Vec::new();
            for (group, [first, second]) in open.iter().enumerate() {
                let (first, second) =
                    (children::<D, V>(records[0], first), children::<D, V>(records[1], second));
                let (Some(first), Some(second)) = (first, second) else { return Ok(None) };
                for (i, pair) in first.into_iter().zip(second).map(|(a, b)| [a, b]).enumerate() {
                    let place = group * D::CHILDREN + i;
                    match overlay.verdicts.get(pair.map(|child| child.kind())) {
                        Verdict::Void => {}
                        Verdict::Take(tree) => match pair[tree] {
                            Child::Void => {}
                            Child::Leaf(value) => level.put_leaf(place, value),
                            Child::Inner { representative, node } => {
                                let records = &records[tree][node as usize..];
                                let records = &records[..records[0].skip() as usize];
                                let Some(splice) = taken.take(place, records, below) else { return Ok(None) };
                                level.take(representative, splice);
                            }
                        },
                        Verdict::Split if below > 0 => {
                            expanded.push(place as u32);
                            deeper.push(pair);
                        }
                        Verdict::Split | Verdict::Fill => return Ok(None),
                    }
                }
            }
            open = deeper;
            level.expanded = Some(expanded);
            levels.push(level);
            if open.is_empty() {
                break;
            }
        }
        Ok(Some(Block { code, height, levels, taken }))
    }
}

/// The value that all these cells have (`None` is VOID), if they are alike.
fn uniform<V: Value>(cells: &CellBlock<V>, range: Range<usize>) -> Option<Option<V>> {
    let (present, values) = (&cells.present[range.clone()], &cells.values[range]);
    let (there, value) = (present[0], values[0]);
    // Without a way out in the middle, so that many are compared at a time.
    let alike = present.iter().fold(true, |alike, other| alike & (*other == there))
        && (there == 0 || values.iter().fold(true, |alike, other| alike & other.same(value)));
    alike.then_some((there != 0).then_some(value))
}

/// The children of a record, with the places of theirs; those of a uniform place are like it. `None` if the record lies.
#[inline]
fn children<D: Layout, V: Value>(
    records: &[D::Record<V>],
    place: &Child<V, u32>,
) -> Option<D::Array<Child<V, u32>>> {
    let Child::Inner { node, .. } = place else { return Some(D::array(|_| *place)) };
    let record = records.get(*node as usize)?;
    let end = node + record.skip();
    let mut next = node + 1;
    let mut good = true;
    let children = D::array(|child| {
        let value = record.value(child);
        match record.state(child) {
            VOID => Child::Void,
            LEAF => Child::Leaf(value),
            state => {
                let node = next;
                let skip = if node < end { records[node as usize].skip() } else { 0 };
                good &= state == INNER && skip > 0 && skip <= end.saturating_sub(node);
                next = next.saturating_add(skip);
                Child::Inner { representative: value, node }
            }
        }
    });
    good.then_some(children)
}
