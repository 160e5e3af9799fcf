//! Gathers the nodes of one block from a source: node by node, but for subtrees that a file has stored and
//! small blocks of cells that the source can draw.

use std::ops::Range;

use zerocopy::IntoBytes;

use super::averaging::{decode, encode, from_value};
use super::block::{Block, Level};
use super::merge::{Join, MergeAction, MergeState, Overlay, join_coverages};
use super::reuse::{ReusableSource, StoredNode, Subtree};
use super::reused::ReusedRecords;
use crate::Result;
use crate::space::Code;
use crate::store::container::{
    INNER, LEAF, Record, RecordLayout, RunChildren, RunNode, VOID, with_form_type,
};
use crate::tree::{CellBlock, Child, Form, NodeState, no_children};
use crate::value::{Native, Value};

/// Cells of a block that is drawn, as a power of two: a quadtree's block of 32 x 32 cells, an octree's of 8 x
/// 8 x 8. Larger ones are drawn in vain where there is little detail.
const DRAWN_BITS: u8 = 10;

/// An INNER node whose children are still to be gathered.
enum Open<N> {
    /// A node of the source.
    Node(N),
    /// Cells that were drawn: the number of their block, and the first of the node's.
    Cells(u32, u32),
}

/// Records taken over and cells drawn so far, to which nodes of the levels refer by number.
struct Gathered {
    reused: ReusedRecords,
    drawn: Vec<CellBlock>,
}

impl Block {
    /// The block under `code`, whose root is the source's inner node `node`. Where `stored` allows it for a
    /// node of a file at so many levels above the cells, its records are taken over.
    pub(super) fn from_source<S: ReusableSource>(
        source: &S,
        code: Code,
        height: u8,
        (representative, node): (Value, &S::Node),
        may_reuse: &dyn Fn(&StoredNode<'_>, u8) -> bool,
    ) -> Result<Self> {
        let form = source.form();
        let fan_out = form.children();
        let mut gathered =
            Gathered { reused: ReusedRecords::new(RecordLayout::new(form), height), drawn: Vec::new() };
        let mut root = Level::root(form);
        if let Some(stored) = source.stored(node).filter(|stored| may_reuse(stored, height))
            && let Some(node) = gathered.reused.take(0, stored.subtree()?.records(), height)
        {
            root.put_reused(form, representative, node);
            root.expanded = Some(Vec::new());
            return Ok(Block::new(form, code, height, vec![root], gathered.reused));
        }
        // Breadth first, since a block is made of levels in Z order: children are visited in the order of
        // their parents, so that each level comes out sorted.
        let mut levels = vec![root];
        let mut nodes = vec![open(source, &mut gathered.drawn, node.clone(), height)?];
        let mut children = no_children();
        for below in (0..height).rev() {
            let mut level = Level::new(form, nodes.len() * fan_out);
            let mut expanded = Vec::new();
            let mut deeper = Vec::new();
            for (group, node) in nodes.iter().enumerate() {
                let first = group * fan_out;
                let node = match node {
                    Open::Node(node) => node,
                    Open::Cells(block, start) => {
                        let cells = (*block, &gathered.drawn[*block as usize]);
                        cell_children(
                            form,
                            cells,
                            *start,
                            below,
                            first,
                            &mut level,
                            (&mut expanded, &mut deeper),
                        );
                        continue;
                    }
                };
                source.children(node, &mut children)?;
                for (index, child) in (first..).zip(&mut children[..fan_out]) {
                    match std::mem::take(child) {
                        Child::Void => {}
                        Child::Inner { representative, node } if below > 0 => {
                            let stored = source.stored(&node).filter(|stored| may_reuse(stored, below));
                            let reused = match stored {
                                Some(stored) => {
                                    gathered.reused.take(index, stored.subtree()?.records(), below)
                                }
                                None => None,
                            };
                            if let Some(reused) = reused {
                                level.put_reused(form, representative, reused);
                            } else {
                                expanded.push(index as u32);
                                deeper.push(open(source, &mut gathered.drawn, node, below)?);
                            }
                        }
                        Child::Leaf(value) | Child::Inner { representative: value, .. } => {
                            level.put_leaf(form, index, value);
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
        Ok(Block::new(form, code, height, levels, gathered.reused))
    }

    /// The block under `code` of two stored subtrees, merged: what set operations spend most of their time
    /// on. `None` if records contradict each other; going through them the usual way tells what is wrong.
    pub(super) fn from_overlay(
        form: Form,
        overlay: &Overlay<'_>,
        code: Code,
        height: u8,
    ) -> Result<Option<Self>> {
        // (In variables of their own: the records are borrowed from them.)
        let (first, second) = (subtree(&overlay.nodes[0])?, subtree(&overlay.nodes[1])?);
        let records = [&first, &second].map(|subtree| subtree.as_ref().map_or(&[][..], Subtree::records));
        let layout = RecordLayout::new(form);
        let mut reused = ReusedRecords::new(layout, height);
        let levels = with_form_type!(form, V, R => {
            // (A pointer, so that merging is compiled for widths and not for types.)
            merge::<R>(form, overlay, records, height, (&mut reused, join_values::<V, R>))
        });
        Ok(levels.map(|levels| Block::new(form, code, height, levels, reused)))
    }
}

/// The records of an INNER node and of all below it.
fn subtree<'a>(node: &Child<StoredNode<'a>>) -> Result<Option<Subtree<'a>>> {
    match node {
        Child::Inner { node, .. } => node.subtree().map(Some),
        _ => Ok(None),
    }
}

/// A node of the source, or its cells where these are few and the source can draw them.
fn open<S: ReusableSource>(
    source: &S,
    drawn: &mut Vec<CellBlock>,
    node: S::Node,
    levels: u8,
) -> Result<Open<S::Node>> {
    let is_small = levels == DRAWN_BITS / source.form().axes() as u8;
    let cells = if is_small { source.cells(&node, levels)? } else { None };
    Ok(match cells {
        Some(cells) => {
            drawn.push(cells);
            Open::Cells(drawn.len() as u32 - 1, 0)
        }
        None => Open::Node(node),
    })
}

/// The children of a node of drawn cells, whose first cell is `start`: uniform ones become leaves of the
/// level, the first at index `first`, all others are opened.
fn cell_children<N>(
    form: Form,
    (block, cells): (u32, &CellBlock),
    start: u32,
    below: u8,
    first: usize,
    level: &mut Level,
    (expanded, deeper): (&mut Vec<u32>, &mut Vec<Open<N>>),
) {
    if below == 0 {
        // Most children are single cells, which are uniform whatever they are.
        let width = form.width();
        for (index, cell) in (first..).zip(start as usize..).take(form.children()) {
            if cells.present[cell] != 0 {
                let value = Value::read(&cells.values[cell * width..], width).expect("a value per cell");
                level.put_leaf(form, index, value);
            }
        }
        return;
    }
    let size = form.dimension.cells(below) as usize;
    for child in 0..form.children() {
        let start = start as usize + child * size;
        match uniform(cells, start..start + size, form.width()) {
            Some(value) => {
                value.into_iter().for_each(|value| level.put_leaf(form, first + child, value));
            }
            None => {
                expanded.push((first + child) as u32);
                deeper.push(Open::Cells(block, start as u32));
            }
        }
    }
}

/// The value that all these cells have (`None` is VOID), if they are alike.
fn uniform(cells: &CellBlock, range: Range<usize>, width: usize) -> Option<Option<Value>> {
    let present = &cells.present[range.clone()];
    let values = &cells.values[range.start * width..range.end * width];
    let is_there = present[0];
    // Without a way out in the middle, so that many are compared at a time.
    let alike = present.iter().fold(true, |alike, other| alike & (*other == is_there));
    // Cells that are alike are the same when moved by one.
    let same = alike && (is_there == 0 || values[width..] == values[..values.len() - width]);
    same.then(|| (is_there != 0).then(|| Value::from_bytes(&values[..width])))
}

/// A node of one of two trees that are merged: its state, its value, and where it is if it is INNER.
#[derive(Clone, Copy)]
struct MergeNode<B> {
    state: NodeState,
    value: B,
    node: RunNode,
}

/// Two nodes whose children are to be merged; or the one of them that is taken, without the other.
struct OpenPair<B> {
    nodes: [MergeNode<B>; 2],
    taken: Option<usize>,
}

/// The node as merge actions tell it apart; `full` is the value of LEAFs that are full, where that matters.
#[inline]
fn merge_state<B: PartialEq + Copy>(node: MergeNode<B>, full: Option<B>) -> MergeState {
    match full {
        Some(full) if node.state == NodeState::Leaf && node.value != full => MergeState::Partial,
        _ => node.state.into(),
    }
}

/// The value that a VOID node is joined with, or a LEAF. (What is in a record where a child is VOID does not matter.)
#[inline]
fn value_or_zero<R: Record>(node: &MergeNode<R::Bytes>) -> R::Bytes {
    if node.state == NodeState::Void { R::ZERO } else { node.value }
}

/// A function that joins the values of two LEAFs; `None` is VOID.
type JoinValues<B> = fn(Join, B, B) -> Option<B>;

/// [`Join::native`] of values' bytes; what is not a number is VOID.
fn join_values<V: Native, R: Record>(join: Join, a: R::Bytes, b: R::Bytes) -> Option<R::Bytes> {
    if let Join::Coverage(number) = join {
        let mut coverages = a;
        return join_coverages(number, coverages.as_mut_bytes(), b.as_bytes()).then_some(coverages);
    }
    let value = join.native::<V>(decode::<R, V>(a), decode::<R, V>(b))?;
    (!value.is_nan()).then(|| encode::<R, V>(value))
}

/// The levels of two subtrees of records, merged; `None` if records contradict each other.
fn merge<R: Record>(
    form: Form,
    overlay: &Overlay<'_>,
    records: [&[u8]; 2],
    height: u8,
    (reused, join_values): (&mut ReusedRecords, JoinValues<R::Bytes>),
) -> Option<Vec<Level>> {
    let records = records.map(R::of);
    let width = size_of::<R::Bytes>();
    let full = overlay.merging.full.map(from_value::<R>);
    let is_float = form.value.sample.is_float();
    let root = |node: &Child<StoredNode<'_>>| {
        let value = from_value::<R>(node.value().unwrap_or_default());
        MergeNode { state: node.state(), value, node: RunNode::default() }
    };
    let mut levels = vec![Level::root(form)];
    let mut open = vec![OpenPair { nodes: [root(&overlay.nodes[0]), root(&overlay.nodes[1])], taken: None }];
    for below in (0..height).rev() {
        let mut level = Level::new(form, open.len() * R::CHILDREN);
        let mut expanded = Vec::new();
        let mut deeper = Vec::new();
        for (group, OpenPair { nodes: [first, second], taken }) in open.iter().enumerate() {
            let (first, second) = (merge_children(records[0], first)?, merge_children(records[1], second)?);
            for i in 0..R::CHILDREN {
                let pair = [first[i], second[i]];
                let index = group * R::CHILDREN + i;
                let action = match taken {
                    Some(tree) => MergeAction::Take(*tree),
                    None => overlay.merging.actions.get(pair.map(|node| merge_state(node, full))),
                };
                match action {
                    MergeAction::Void => {}
                    MergeAction::Take(tree) => {
                        let MergeNode { state, value, node } = pair[tree];
                        match state {
                            NodeState::Void => {}
                            NodeState::Leaf if is_float => {
                                level.put_leaf(form, index, Value::from_bytes(value.as_bytes()));
                            }
                            NodeState::Leaf => {
                                level.states[index] = LEAF;
                                level.values[index * width..][..width].copy_from_slice(value.as_bytes());
                            }
                            // Part of a dense block, which is no run of its own.
                            NodeState::Inner if node.below > 0 && below > 0 => {
                                expanded.push(index as u32);
                                let uniform = MergeNode { state: NodeState::Void, ..pair[tree] };
                                let mut nodes = [uniform; 2];
                                nodes[tree] = pair[tree];
                                deeper.push(OpenPair { nodes, taken: Some(tree) });
                            }
                            NodeState::Inner if node.below > 0 => return None,
                            NodeState::Inner => {
                                let subtree = &records[tree][node.record as usize..];
                                let subtree = &subtree[..subtree[0].skip() as usize];
                                let node = reused.take(index, subtree.as_bytes(), below)?;
                                level.put_reused(form, Value::from_bytes(value.as_bytes()), node);
                            }
                        }
                    }
                    MergeAction::Join => {
                        let [first, second] = pair.map(|node| value_or_zero::<R>(&node));
                        if let Some(value) = join_values(overlay.merging.join, first, second) {
                            level.states[index] = LEAF;
                            level.values[index * width..][..width].copy_from_slice(value.as_bytes());
                        }
                    }
                    MergeAction::Split if below > 0 => {
                        expanded.push(index as u32);
                        deeper.push(OpenPair { nodes: pair, taken: None });
                    }
                    MergeAction::Split | MergeAction::Fill => return None,
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
    Some(levels)
}

/// The children of a node, those of a uniform one like it. `None` if its record lies.
#[inline]
fn merge_children<R: Record>(records: &[R], node: &MergeNode<R::Bytes>) -> Option<[MergeNode<R::Bytes>; 8]> {
    let mut children = [*node; 8];
    if node.state != NodeState::Inner {
        return Some(children);
    }
    let record = records.get(node.node.record as usize)?;
    if record.is_dense() {
        let mut below = RunChildren::default();
        R::RECORD_LAYOUT.run_children(records.as_bytes(), node.node, &mut below)?;
        for (child, below) in children.iter_mut().zip(below) {
            let state = match below.state {
                VOID => NodeState::Void,
                LEAF => NodeState::Leaf,
                INNER => NodeState::Inner,
                _ => return None,
            };
            *child = MergeNode { state, value: from_value::<R>(below.value), node: below.node };
        }
        return Some(children);
    }
    let end = node.node.record + record.skip();
    let mut next = node.node.record + 1;
    for (i, child) in children[..R::CHILDREN].iter_mut().enumerate() {
        child.value = record.values()[i];
        match record.state(i) {
            VOID => child.state = NodeState::Void,
            LEAF => child.state = NodeState::Leaf,
            state => {
                let skip = if next < end { records.get(next as usize)?.skip() } else { 0 };
                if state != INNER || skip == 0 || skip > end.saturating_sub(next) {
                    return None;
                }
                child.state = NodeState::Inner;
                child.node = RunNode::of_record(next as usize);
                next += skip;
            }
        }
    }
    Some(children)
}
