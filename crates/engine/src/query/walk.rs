//! Traverses the cells of a tree that a box or another selection covers, and offers each zone's
//! statistics to a visitor before descending into it.

use crate::store::goblin::{Goblin, Segment};
use crate::store::records::dense::{DenseBlock, DenseRows, DenseStates};
use crate::store::records::subtree::BadSkip;
use crate::store::records::{RunChild, RunChildren, RunNode, Runs, with_record_type};
use crate::tree::{CellBlock, Child, Source, no_children};
use spinney_base::TreeType;
use spinney_base::io::batch::finish_deferred;
use spinney_base::space::{Bounds, Code, Cover};
use spinney_base::value::{Value, ZoneStats};
use spinney_base::{Error, Result};
use spinney_container::{CUT, INNER, LEAF, Shape, VOID};

/// Statistics of all cells below a node, read on demand.
pub(super) trait Zone {
    /// Returns everything except for the class counts.
    fn tally(&self) -> Result<ZoneStats>;
    /// Returns the number of cells of each value.
    fn classes(&self) -> Result<Vec<(Value, u64)>>;
}

/// The zone of a segment.
struct SegmentZone<'a> {
    tree: &'a Goblin,
    index: usize,
}

impl Zone for SegmentZone<'_> {
    fn tally(&self) -> Result<ZoneStats> {
        Ok(self.tree.entry(self.index)?.zone)
    }

    fn classes(&self) -> Result<Vec<(Value, u64)>> {
        self.tree.classes(self.index)
    }
}

/// A tally that a source provides.
struct KnownTally(ZoneStats);

impl Zone for KnownTally {
    fn tally(&self) -> Result<ZoneStats> {
        Ok(self.0.clone())
    }

    fn classes(&self) -> Result<Vec<(Value, u64)>> {
        Ok(self.0.classes.clone())
    }
}

/// Reason why a traversal ended early.
pub(super) enum Halt {
    /// The visitor needs no more.
    Stopped,
    /// The tree cannot be read, or the visitor failed.
    Failed(Error),
}

impl From<Error> for Halt {
    fn from(error: Error) -> Halt {
        Halt::Failed(error)
    }
}

/// Result of a traversal and of a visitor's methods.
pub(super) type Walked<T = ()> = std::result::Result<T, Halt>;

/// Returns the result of a whole traversal. Stopping early is not a failure.
pub(super) fn ended(walked: Walked) -> Result<()> {
    match walked {
        Ok(()) | Err(Halt::Stopped) => Ok(()),
        Err(Halt::Failed(error)) => Err(error),
    }
}

/// A selection of cells of the deepest level.
pub(super) trait Selection {
    /// Returns how the selection covers the cells of a node.
    fn cover(&self, space: &Bounds) -> Cover;
    /// Returns a box that encloses the selected cells of a partially covered node.
    fn part(&self, space: &Bounds) -> Bounds;
}

impl Selection for Bounds {
    #[inline]
    fn cover(&self, space: &Bounds) -> Cover {
        if self.contains(space) {
            Cover::Whole
        } else if self.intersect(space).is_empty() {
            Cover::Nothing
        } else {
            Cover::Partial
        }
    }

    #[inline]
    fn part(&self, space: &Bounds) -> Bounds {
        space.intersect(self)
    }
}

/// Visitor of a selection of cells.
pub(super) trait Visitor {
    /// Receives the zone of a node that is entirely selected. Returns whether its statistics
    /// suffice; otherwise the traversal descends into it.
    fn zone(&mut self, code: Code, zone: &dyn Zone) -> Walked<bool>;
    /// Receives a uniform block (`None` is VOID), of which `cells` cells may be selected. `part`
    /// encloses them if the block is not entirely selected.
    fn block(&mut self, code: Code, value: Option<Value>, cells: u64, part: Option<&Bounds>) -> Walked;
    /// Receives the records and the levels of an entirely selected subtree that is in one segment.
    /// Returns a result if the visitor has processed all of it; otherwise the traversal visits the
    /// records.
    fn subtree(&mut self, _: Code, _: &[u8], _: u8) -> Option<Result<(), BadSkip>> {
        None
    }
    /// Receives the part of a dense block that may be selected: its first cell in the block, and
    /// its size along each axis. Returns whether the visitor has processed all of it; otherwise the
    /// traversal visits the cells.
    fn dense(&mut self, _: Code, _: &DenseBlock<'_>, _: ([usize; 3], [usize; 3])) -> bool {
        false
    }
    /// Called after all children of a node were visited.
    fn leave(&mut self, _: Code) -> Walked {
        Ok(())
    }
    /// Called for a block of which nothing is selected.
    fn outside(&mut self) -> Walked {
        Ok(())
    }
    /// Called before the records of a segment are visited.
    fn enter_segment(&mut self) {}
    /// Returns whether zones of entirely selected nodes are read from their segments, as class
    /// counts are.
    fn reads_zones(&self) -> bool {
        false
    }
    /// Called when the traversal continues after a subtree whose bytes have not been fetched. The
    /// results are incomplete, and the traversal fails in the end.
    fn miss_part(&mut self) {}
}

/// Records a subtree that lacks bytes, so that the traversal can continue.
///
/// Invariant: a node with a missed subtree fails in the end (`finish_deferred`), without a call of
/// `leave`. So no visitor takes what it has seen of the node for the whole, and the traversal fails
/// as well.
#[inline]
fn defer_missing(walked: Walked, visitor: &mut impl Visitor, is_unread: &mut bool) -> Walked {
    match walked {
        Err(Halt::Failed(Error::NotFetched)) => {
            visitor.miss_part();
            *is_unread = true;
            Ok(())
        }
        walked => walked,
    }
}

/// Selected cells of a node.
#[derive(Clone, Copy)]
enum Selected {
    Whole,
    Nothing,
    /// Some of these cells.
    Within(Bounds),
}

impl Selected {
    /// Returns which of a node's cells are selected. `space` is `None` if all are.
    #[inline]
    fn of(space: Option<Bounds>, selection: &impl Selection) -> Selected {
        let Some(space) = space else { return Selected::Whole };
        match selection.cover(&space) {
            Cover::Whole => Selected::Whole,
            Cover::Nothing => Selected::Nothing,
            Cover::Partial => Selected::Within(space),
        }
    }

    /// Returns the node's cells, unless all of them are selected.
    #[inline]
    fn space(self) -> Option<Bounds> {
        match self {
            Selected::Within(space) => Some(space),
            Selected::Whole | Selected::Nothing => None,
        }
    }
}

/// Visits all selected cells in FD order.
pub(super) fn walk(tree: &Goblin, selection: &impl Selection, visitor: &mut impl Visitor) -> Walked {
    let (shape, root) = (tree.header().shape, Code::root(tree.header().form.dimension));
    let whole = root.bounds(shape.depth);
    // Below an entirely selected node nothing is tested.
    let selected = Selected::of(Some(whole), selection);
    let traversal = SegmentTraversal { tree, shape, selection };
    match tree.root_child() {
        Child::Inner { .. } if matches!(selected, Selected::Nothing) => visitor.outside(),
        Child::Inner { .. } => traversal.segment(root, tree.find_segment(root)?, selected.space(), visitor),
        uniform => uniform_block(root, shape.depth, uniform.value(), (selected, selection), visitor),
    }
}

/// Passes a uniform block to the visitor.
#[inline]
fn uniform_block(
    code: Code,
    depth: u8,
    value: Option<Value>,
    (selected, selection): (Selected, &impl Selection),
    visitor: &mut impl Visitor,
) -> Walked {
    match selected {
        Selected::Whole => {
            let cells = code.dimension().cells(depth.saturating_sub(code.level()));
            visitor.block(code, value, cells, None)
        }
        Selected::Nothing => visitor.outside(),
        Selected::Within(space) => {
            let part = selection.part(&space);
            visitor.block(code, value, part.volume(), Some(&part))
        }
    }
}

/// Visits all selected cells of any source in FD order. Nodes with a tally are zones.
pub(super) fn walk_source<S: Source>(
    source: &S,
    selection: &impl Selection,
    visitor: &mut impl Visitor,
) -> Walked {
    let root = Code::root(source.form().dimension);
    let whole = root.bounds(source.depth());
    let selected = Selected::of(Some(whole), selection);
    source_node(source, root, &source.root()?, (selected, selection), visitor)
}

/// Visits a node of a source.
fn source_node<S: Source>(
    source: &S,
    code: Code,
    node: &Child<S::Node>,
    (selected, selection): (Selected, &impl Selection),
    visitor: &mut impl Visitor,
) -> Walked {
    let inner = match node {
        Child::Inner { node, .. } if code.level() < source.depth() => node,
        uniform => {
            return uniform_block(code, source.depth(), uniform.value(), (selected, selection), visitor);
        }
    };
    if matches!(selected, Selected::Nothing) {
        return visitor.outside();
    }
    let space = selected.space();
    if space.is_none()
        && let Some(tally) = source.tally(inner)?
        && visitor.zone(code, &KnownTally(tally))?
    {
        return Ok(());
    }
    let dimension = code.dimension();
    let levels = source.depth() - code.level();
    // (If little of a block is selected, reading all of it is not worth it.)
    let is_most = space.is_none_or(|space| selection.part(&space).volume() >= space.volume() / 4);
    if is_most
        && levels * source.form().axes() as u8 <= BLOCK_BITS
        && let Some(block) = source.cells(inner, levels)?
    {
        let cells = Cells { block: &block, form: source.form(), levels };
        return cells.walk(code, [0; 3], levels, (selected, selection), visitor);
    }
    let (mut children, mut is_unread) = (no_children(), false);
    source.children(inner, &mut children)?;
    for (step, child) in children[..dimension.children()].iter().enumerate() {
        let space = space.map(|space| space.child(dimension, step));
        let selected = Selected::of(space, selection);
        let walked = source_node(source, code.child(step), child, (selected, selection), visitor);
        defer_missing(walked, visitor, &mut is_unread)?;
    }
    finish_deferred(is_unread)?;
    visitor.leave(code)
}

/// Base-2 logarithm of the cells of the largest blocks that are read at once: 256 x 256, or 32 x 32
/// x 32.
const BLOCK_BITS: u8 = 16;

/// The cells below a node with `levels` levels.
struct Cells<'a> {
    block: &'a CellBlock,
    form: TreeType,
    levels: u8,
}

impl Cells<'_> {
    /// Returns the index of a cell.
    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        ((z << self.levels | y) << self.levels) | x
    }

    /// Returns whether all cells of a node are equal.
    fn is_uniform(&self, [x, y, z]: [usize; 3], side: usize) -> bool {
        let width = self.form.width();
        let at = |index: usize| {
            (self.block.present[index], &self.block.values[index * width..(index + 1) * width])
        };
        let (present, value) = at(self.index([x, y, z]));
        let deep = if self.form.axes() > 2 { side } else { 1 };
        // (Most nodes that are not uniform differ in the first few cells.)
        (0..deep).all(|layer| {
            (0..side).all(|row| {
                let first = self.index([x, y + row, z + layer]);
                (first..first + side).all(|index| {
                    let (other, number) = at(index);
                    other == present && (!present || number == value)
                })
            })
        })
    }

    /// Visits a node of the block, given its first cell and the number of levels below it.
    fn walk(
        &self,
        code: Code,
        [x, y, z]: [usize; 3],
        below: u8,
        (selected, selection): (Selected, &impl Selection),
        visitor: &mut impl Visitor,
    ) -> Walked {
        if self.is_uniform([x, y, z], 1 << below) {
            let (index, width) = (self.index([x, y, z]), self.form.width());
            let value = || Value::from_bytes(&self.block.values[index * width..(index + 1) * width]);
            let value = self.block.present[index].then(value);
            return uniform_block(code, code.level() + below, value, (selected, selection), visitor);
        }
        if matches!(selected, Selected::Nothing) {
            return visitor.outside();
        }
        let (dimension, half) = (self.form.dimension, 1 << (below - 1));
        let space = selected.space();
        for step in 0..dimension.children() {
            let first = [x + (step & 1) * half, y + (step >> 1 & 1) * half, z + (step >> 2 & 1) * half];
            let space = space.map(|space| space.child(dimension, step));
            let selected = Selected::of(space, selection);
            self.walk(code.child(step), first, below - 1, (selected, selection), visitor)?;
        }
        visitor.leave(code)
    }
}

struct SegmentTraversal<'a, S> {
    tree: &'a Goblin,
    shape: Shape,
    selection: &'a S,
}

/// A node with a record.
struct Node {
    /// Its location in the segment.
    at: RunNode,
    code: Code,
    /// Its cells, unless all of them are selected.
    space: Option<Bounds>,
    /// Whether all its descendants are in the segment.
    inline: bool,
}

impl<S: Selection> SegmentTraversal<'_, S> {
    /// Visits a node that owns a segment.
    fn segment(
        &self,
        code: Code,
        index: Option<usize>,
        space: Option<Bounds>,
        visitor: &mut impl Visitor,
    ) -> Walked {
        let index = index.ok_or_else(|| self.tree.bad_cut(code))?;
        if space.is_none() && visitor.zone(code, &SegmentZone { tree: self.tree, index })? {
            return Ok(());
        }
        visitor.enter_segment();
        let segment = self.tree.segment(index);
        if let (Err(Error::NotFetched), Some(space)) = (&segment, &space) {
            self.miss_below(code, space, visitor);
        }
        let segment = segment?;
        // Below the level of the blocks, no node owns a segment.
        let inline = code.level() >= self.shape.block_level();
        self.node(&segment, segment.records(), Node { at: RunNode::default(), code, space, inline }, visitor)
    }

    /// Requests the segments below a node whose own segment has not been fetched. It requests those
    /// that the traversal will need according to the segment index: segments of nodes that the
    /// selection cuts. All of them are then fetched together instead of level by level.
    #[cold]
    fn miss_below(&self, code: Code, space: &Bounds, visitor: &impl Visitor) {
        let dimension = code.dimension();
        for step in 0..dimension.children() {
            let (child, space) = (code.child(step), space.child(dimension, step));
            let cover = self.selection.cover(&space);
            let is_wanted = cover == Cover::Partial || cover == Cover::Whole && visitor.reads_zones();
            if !is_wanted || child.level() > self.shape.block_level() {
                continue;
            }
            if self.shape.is_candidate(child.level()) {
                let own = self.tree.find_segment(child).ok().flatten();
                let own =
                    own.filter(|own| matches!(self.tree.segment_code(*own), Ok(Some(code)) if code == child));
                let Some(own) = own else { continue };
                // (The request is recorded; its result is not needed now.)
                let _ = self.tree.segment(own);
            }
            // (For an entirely selected node, the uppermost zone suffices.)
            if cover == Cover::Partial || !self.shape.is_candidate(child.level()) {
                self.miss_below(child, &space, visitor);
            }
        }
    }

    fn node(&self, segment: &Segment<'_>, records: &[u8], node: Node, visitor: &mut impl Visitor) -> Walked {
        let Node { at, code, space, inline } = node;
        let (layout, shape) = (self.tree.layout(), &self.shape);
        let bad_skip = || self.tree.bad_skip(segment, at.record as usize);
        if inline && space.is_none() && at.below == 0 {
            let record = at.record as usize;
            let head = layout.head(records, record).ok_or_else(bad_skip)?;
            let subtree = layout.subtree(records, record, head.skip).unwrap_or(&[]);
            let levels = shape.depth.saturating_sub(code.level());
            if let Some(taken) = visitor.subtree(code, subtree, levels) {
                return taken.map_err(|_| bad_skip().into());
            }
        }
        if code.level() >= shape.depth {
            return Err(bad_skip().into());
        }
        if let Some(block) = layout.dense_at(records, at)
            && code.level() + block.levels == shape.depth
            && block.kind.is_leaves()
        {
            let part = space.map(|space| {
                let part = self.selection.part(&space);
                let first = std::array::from_fn(|axis| (part.min[axis] - space.min[axis]) as usize);
                (first, part.size().map(|size| size as usize))
            });
            if let Some(part) = part
                && visitor.dense(code, &block, part)
            {
                return Ok(());
            }
            let states = with_record_type!(*layout, R => block.states::<R>());
            return self.dense(&(block, states), (code, 0), space, visitor);
        }
        let mut children = RunChildren::default();
        layout.run_children(records, at, &mut children).ok_or_else(bad_skip)?;
        let dimension = code.dimension();
        let candidates = !inline && shape.is_candidate(code.level() + 1);
        let mut is_unread = false;
        for (step, RunChild { state, value, node: at }) in children[..dimension.children()].iter().enumerate()
        {
            let child = code.child(step);
            let selected = Selected::of(space.map(|space| space.child(dimension, step)), self.selection);
            match *state {
                VOID => uniform_block(child, shape.depth, None, (selected, self.selection), visitor)?,
                LEAF => {
                    uniform_block(child, shape.depth, Some(*value), (selected, self.selection), visitor)?;
                }
                state => {
                    debug_assert!(state == INNER || state == CUT);
                    if matches!(selected, Selected::Nothing) {
                        visitor.outside()?;
                        continue;
                    }
                    let node = Node { at: *at, code: child, space: selected.space(), inline };
                    let walked = self.child(segment, records, (node, state, candidates), visitor);
                    defer_missing(walked, visitor, &mut is_unread)?;
                }
            }
        }
        finish_deferred(is_unread)?;
        visitor.leave(code)
    }

    /// Visits a child that has a state and may own a segment.
    fn child(
        &self,
        segment: &Segment<'_>,
        records: &[u8],
        (node, state, is_candidate): (Node, u8, bool),
        visitor: &mut impl Visitor,
    ) -> Walked {
        // A node that owns a segment has a zone there, and records that reach deeper than those
        // here.
        let deepest = if is_candidate { self.tree.find_segment(node.code)? } else { None };
        match deepest {
            Some(own) if own != segment.index() && self.tree.segment_code(own)? == Some(node.code) => {
                self.segment(node.code, Some(own), node.space, visitor)
            }
            deepest if state == INNER => {
                // A candidate that does not own a segment is too small to be cut, so all its
                // descendants have their records here.
                let inline = node.inline || deepest == Some(segment.index());
                self.node(segment, records, Node { inline, ..node }, visitor)
            }
            _ => Err(self.tree.bad_cut(node.code).into()),
        }
    }

    /// Visits a node of a dense block, given its code and its index in its level.
    fn dense(
        &self,
        dense: &(DenseBlock<'_>, DenseStates),
        (code, index): (Code, usize),
        space: Option<Bounds>,
        visitor: &mut impl Visitor,
    ) -> Walked {
        let (block, states) = dense;
        let (depth, dimension) = (self.shape.depth, code.dimension());
        let level = block.levels - (depth - code.level()) + 1;
        for step in 0..dimension.children() {
            let (child, index) = (code.child(step), block.child(level, index, step));
            let selected = Selected::of(space.map(|space| space.child(dimension, step)), self.selection);
            match states.level(level)[index] {
                INNER if matches!(selected, Selected::Nothing) => visitor.outside()?,
                INNER => self.dense(dense, (child, index), selected.space(), visitor)?,
                state => {
                    let value = (state != VOID).then(|| block.value(level, index));
                    uniform_block(child, depth, value, (selected, self.selection), visitor)?;
                }
            }
        }
        visitor.leave(code)
    }
}
