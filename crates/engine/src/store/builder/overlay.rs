//! Gathers the nodes of one block from two stored subtrees that are merged. Set operations spend
//! most of their time here.

use zerocopy::{FromBytes, IntoBytes};

use super::averaging::{decode, encode, from_value};
use super::block::Block;
use super::gather::{DrawnCells, cell_children};
use super::level::Level;
use super::merge::{Join, MergeAction, MergeState, Overlay, join_coverages};
use super::reused::ReusedRecords;
use super::stored_node::{StoredNode, Subtree};
use crate::store::records::dense::{DenseBlock, DenseRows, dense_block, from_z_order};
use crate::store::records::{Record, RecordLayout, with_form_type};
use crate::tree::{Child, NodeState};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::array;
use spinney_base::space::Code;
use spinney_base::value::{Native, Value};
use spinney_container::{INNER, LEAF, VOID};

impl Block {
    /// Returns the block under `code` of two stored subtrees, merged. `None` if records are
    /// inconsistent; the slower node-by-node path then reports the error.
    pub(super) fn from_overlay(
        form: TreeType,
        overlay: &Overlay<'_>,
        code: Code,
        height: u8,
    ) -> Result<Option<Self>> {
        // (In variables, because the records are borrowed from them.)
        let (first, second) = (subtree(&overlay.nodes[0])?, subtree(&overlay.nodes[1])?);
        let records = [&first, &second].map(|subtree| subtree.as_ref().map_or(&[][..], Subtree::records));
        let layout = RecordLayout::new(form);
        let reused = ReusedRecords::new(layout, height);
        Ok(with_form_type!(form, V, R => {
            // (A function pointer, so that merging is compiled per width and not per type.)
            Merger::<R>::new(form, overlay, records, join_values::<V, R>).block(code, height, reused)
        }))
    }
}

/// Returns the states of cells.
fn states_of(present: &[bool]) -> Vec<u8> {
    present.iter().map(|present| if *present { LEAF } else { VOID }).collect()
}

/// Returns the records of an INNER node's subtree.
fn subtree<'a>(node: &Child<StoredNode<'a>>) -> Result<Option<Subtree<'a>>> {
    match node {
        Child::Inner { node, .. } => node.subtree().map(Some),
        _ => Ok(None),
    }
}

/// A node of one of two merged trees: its state, its value, and the index of its record if it is
/// INNER.
#[derive(Clone, Copy)]
struct MergeNode<B> {
    state: NodeState,
    value: B,
    record: u32,
}

/// A node whose children have not been gathered yet.
enum Open<B> {
    /// Two nodes whose children are to be merged.
    Pair([MergeNode<B>; 2]),
    /// Merged cells: index of their block, and index of the node's first cell.
    Cells(u32, u32),
}

/// Returns the state that merge actions distinguish; `full` is the value of full LEAFs, where that
/// matters.
#[inline]
fn merge_state<B: PartialEq + Copy>(node: MergeNode<B>, full: Option<B>) -> MergeState {
    match full {
        Some(full) if node.state == NodeState::Leaf && node.value != full => MergeState::Partial,
        _ => node.state.into(),
    }
}

/// Returns a node's value for joining, 0 for a VOID node. (The bytes that a record stores for a
/// VOID child are ignored.)
#[inline]
fn value_or_zero<R: Record>(node: &MergeNode<R::Bytes>) -> R::Bytes {
    if node.state == NodeState::Void { R::ZERO } else { node.value }
}

/// A function that joins the values of two LEAFs; `None` is VOID.
type JoinValues<B> = fn(Join, B, B) -> Option<B>;

/// [`Join::native`] for the bytes of values; NaN is VOID.
fn join_values<V: Native, R: Record>(join: Join, a: R::Bytes, b: R::Bytes) -> Option<R::Bytes> {
    if let Join::Coverage(operation) = join {
        let mut coverages = a;
        return join_coverages(operation, coverages.as_mut_bytes(), b.as_bytes()).then_some(coverages);
    }
    let value = join.native::<V>(decode::<R, V>(a), decode::<R, V>(b))?;
    (!value.is_nan()).then(|| encode::<R, V>(value))
}

/// Two subtrees of records, and how to merge them.
struct Merger<'a, R: Record> {
    form: TreeType,
    overlay: &'a Overlay<'a>,
    records: [&'a [R]; 2],
    join_values: JoinValues<R::Bytes>,
    /// The value of full LEAFs, where that matters.
    full: Option<R::Bytes>,
}

impl<'a, R: Record> Merger<'a, R> {
    fn new(
        form: TreeType,
        overlay: &'a Overlay<'a>,
        records: [&'a [u8]; 2],
        join_values: JoinValues<R::Bytes>,
    ) -> Self {
        let full = overlay.merging.full.map(from_value::<R>);
        Merger { form, overlay, records: records.map(R::of), join_values, full }
    }

    fn root(&self) -> [MergeNode<R::Bytes>; 2] {
        let root = |node: &Child<StoredNode<'_>>| {
            let value = from_value::<R>(node.value().unwrap_or_default());
            MergeNode { state: node.state(), value, record: 0 }
        };
        [root(&self.overlay.nodes[0]), root(&self.overlay.nodes[1])]
    }

    /// Returns the block at a node; `None` if records are inconsistent.
    fn block(&self, code: Code, height: u8, mut reused: ReusedRecords) -> Option<Block> {
        let root = self.root();
        if let Some(DrawnCells { present, values }) = self.cells(&root, height) {
            return Some(Block::from_cells(self.form, code, height, states_of(&present), values));
        }
        let levels = self.levels(root, height, &mut reused)?;
        Some(Block::new(self.form, code, height, levels, reused))
    }

    #[inline]
    fn action(&self, pair: [MergeNode<R::Bytes>; 2]) -> MergeAction {
        let [first, second] = pair;
        self.overlay.merging.actions.get([merge_state(first, self.full), merge_state(second, self.full)])
    }

    /// Returns the levels of the two subtrees, merged; `None` if records are inconsistent.
    fn levels(
        &self,
        root: [MergeNode<R::Bytes>; 2],
        height: u8,
        reused: &mut ReusedRecords,
    ) -> Option<Vec<Level>> {
        let form = self.form;
        let width = size_of::<R::Bytes>();
        let is_float = form.value.sample.is_float();
        let mut levels = vec![Level::root(form)];
        let mut merged: Vec<DrawnCells> = Vec::new();
        let mut open = vec![Open::Pair(root)];
        for below in (0..height).rev() {
            let mut level = Level::new(form, open.len() * R::CHILDREN);
            let mut expanded = Vec::new();
            let mut deeper = Vec::new();
            for (group, open) in open.iter().enumerate() {
                let first = group * R::CHILDREN;
                let nodes = match open {
                    Open::Pair(nodes) => nodes,
                    Open::Cells(block, start) => {
                        let open = |start| Open::Cells(*block, start);
                        let more = (&mut expanded, &mut deeper, open);
                        cell_children(form, &merged[*block as usize], *start, below, first, &mut level, more);
                        continue;
                    }
                };
                let children = [
                    merge_children(self.records[0], &nodes[0])?,
                    merge_children(self.records[1], &nodes[1])?,
                ];
                for (i, index) in (0..R::CHILDREN).zip(first..) {
                    let pair = [children[0][i], children[1][i]];
                    match self.action(pair) {
                        MergeAction::Void => {}
                        MergeAction::Keep(tree) => {
                            let MergeNode { state, value, record } = pair[tree];
                            match state {
                                NodeState::Void => {}
                                NodeState::Leaf if is_float => {
                                    level.put_leaf(form, index, Value::from_bytes(value.as_bytes()));
                                }
                                NodeState::Leaf => {
                                    level.states[index] = LEAF;
                                    level.values[index * width..][..width].copy_from_slice(value.as_bytes());
                                }
                                NodeState::Inner => {
                                    // Invariant: the record's extent lies in its parent's, as
                                    // `merge_children` has checked. So this slice exists, and
                                    // `take` checks and counts its records.
                                    let subtree = &self.records[tree][record as usize..];
                                    let subtree = &subtree[..subtree[0].skip() as usize];
                                    let node = reused.take(index, subtree.as_bytes(), below)?;
                                    level.put_reused(form, Value::from_bytes(value.as_bytes()), node);
                                }
                            }
                        }
                        MergeAction::Join => {
                            let (first, second) =
                                (value_or_zero::<R>(&pair[0]), value_or_zero::<R>(&pair[1]));
                            if let Some(value) = (self.join_values)(self.overlay.merging.join, first, second)
                            {
                                level.states[index] = LEAF;
                                level.values[index * width..][..width].copy_from_slice(value.as_bytes());
                            }
                        }
                        MergeAction::Split if below > 0 => {
                            expanded.push(index as u32);
                            deeper.push(match self.cells(&pair, below) {
                                Some(cells) => {
                                    merged.push(cells);
                                    Open::Cells(merged.len() as u32 - 1, 0)
                                }
                                None => Open::Pair(pair),
                            });
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

    /// Merges two nodes with `levels` levels below them cell by cell, if at least one of them is a
    /// dense block; `None` if none is, or if records are inconsistent.
    fn cells(&self, pair: &[MergeNode<R::Bytes>; 2], levels: u8) -> Option<DrawnCells> {
        let is_dense = |tree: usize| {
            let record = self.records[tree].get(pair[tree].record as usize);
            pair[tree].state == NodeState::Inner && record.is_some_and(Record::is_dense)
        };
        if !is_dense(0) && !is_dense(1) {
            return None;
        }
        let sides = [self.side(0, &pair[0], levels)?, self.side(1, &pair[1], levels)?];
        let cells = 1usize << (R::AXES * usize::from(levels));
        let mut merged =
            DrawnCells { present: vec![false; cells], values: vec![0; cells * size_of::<R::Bytes>()] };
        let values = <[R::Bytes]>::mut_from_bytes(&mut merged.values).expect("whole values");
        let mut is_good = true;
        from_z_order::<R, _>(usize::from(levels), |z, row| {
            let pair = [sides[0].cell(row), sides[1].cell(row)];
            let value = match self.action(pair) {
                MergeAction::Keep(tree) => {
                    Some(pair[tree].value).filter(|_| pair[tree].state == NodeState::Leaf)
                }
                MergeAction::Join => {
                    let (first, second) = (value_or_zero::<R>(&pair[0]), value_or_zero::<R>(&pair[1]));
                    (self.join_values)(self.overlay.merging.join, first, second)
                }
                MergeAction::Void => None,
                MergeAction::Split | MergeAction::Fill => {
                    is_good = false;
                    None
                }
            };
            if let Some(value) = value {
                merged.present[z] = true;
                values[z] = value;
            }
        });
        is_good.then_some(merged)
    }

    /// Returns a node with `levels` levels below it as cells; `None` if its records are
    /// inconsistent.
    fn side(&self, tree: usize, node: &MergeNode<R::Bytes>, levels: u8) -> Option<Side<'a, R>> {
        if node.state != NodeState::Inner {
            return Some(Side::Uniform(*node));
        }
        let records = self.records[tree];
        if records.get(node.record as usize)?.is_dense() {
            let block = dense_block(records, node.record as usize)?;
            // Invariant: both sides are cells of the same number of levels, in rows, and none is
            // CUT. So cells with the same index have the same position. The values of a block that
            // ends above the cells would be merged with those of other cells.
            let is_whole = block.levels == levels && block.kind.is_leaves();
            return is_whole.then(|| Side::Dense(block, block.values_of::<R>(levels)));
        }
        let void = MergeNode { state: NodeState::Void, value: R::ZERO, record: 0 };
        let mut cells = vec![void; 1 << (R::AXES * usize::from(levels))];
        paint(records, node, levels, ([0; 3], levels), &mut cells)?;
        Some(Side::Drawn(cells))
    }
}

/// One of two nodes that are merged cell by cell: cells in rows, unless the node is uniform.
enum Side<'a, R: Record> {
    Uniform(MergeNode<R::Bytes>),
    Dense(DenseBlock<'a>, &'a [R::Bytes]),
    Drawn(Vec<MergeNode<R::Bytes>>),
}

impl<R: Record> Side<'_, R> {
    #[inline]
    fn cell(&self, row: usize) -> MergeNode<R::Bytes> {
        match self {
            Side::Uniform(node) => *node,
            Side::Dense(block, values) => {
                let state = if block.bottom_state(row) == LEAF { NodeState::Leaf } else { NodeState::Void };
                MergeNode { state, value: values[row], record: 0 }
            }
            Side::Drawn(cells) => cells[row],
        }
    }
}

/// Paints a node with `levels` levels below it into a block of cells of `whole` levels, at the
/// position `at`; returns `None` if records are inconsistent.
fn paint<R: Record>(
    records: &[R],
    node: &MergeNode<R::Bytes>,
    levels: u8,
    (at, whole): ([usize; 3], u8),
    cells: &mut [MergeNode<R::Bytes>],
) -> Option<()> {
    let side = 1usize << levels;
    if node.state != NodeState::Inner {
        let depth = if R::AXES > 2 { side } else { 1 };
        for z in at[2]..at[2] + depth {
            for y in at[1]..at[1] + side {
                let row = ((z << whole | y) << whole) + at[0];
                cells[row..row + side].fill(*node);
            }
        }
        return Some(());
    }
    if levels == 0 {
        return None;
    }
    if records.get(node.record as usize)?.is_dense() {
        let block = dense_block(records, node.record as usize)?;
        if block.levels != levels || !block.kind.is_leaves() {
            return None;
        }
        for (index, value) in block.values_of::<R>(levels).iter().enumerate() {
            let place = block.place(levels, index);
            let [x, y, z] = array::from_fn(|axis| at[axis] + place[axis]);
            let state = if block.bottom_state(index) == LEAF { NodeState::Leaf } else { NodeState::Void };
            cells[((z << whole | y) << whole) + x] = MergeNode { state, value: *value, record: 0 };
        }
        return Some(());
    }
    for (step, child) in merge_children(records, node)?[..R::CHILDREN].iter().enumerate() {
        let at = array::from_fn(|axis| at[axis] + (step >> axis & 1) * side / 2);
        paint(records, child, levels - 1, (at, whole), cells)?;
    }
    Some(())
}

/// Returns the children of a node; those of a uniform node equal the node. `None` if its record is
/// inconsistent.
#[inline]
fn merge_children<R: Record>(records: &[R], node: &MergeNode<R::Bytes>) -> Option<[MergeNode<R::Bytes>; 8]> {
    let mut children = [*node; 8];
    if node.state != NodeState::Inner {
        return Some(children);
    }
    let record = records.get(node.record as usize).filter(|record| !record.is_dense())?;
    let end = node.record + record.skip();
    let mut next = node.record + 1;
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
                child.record = next;
                next += skip;
            }
        }
    }
    Some(children)
}
