//! Walks the part of a tree that lies in a box, or in anything else that selects cells, asking at every zone whether its
//! statistics will do.

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

/// Statistics of all the cells below a node, read when somebody asks.
pub(super) trait Zone {
    /// Everything but the class counts.
    fn tally(&self) -> Result<ZoneStats>;
    /// Cells of each value.
    fn classes(&self) -> Result<Vec<(Value, u64)>>;
}

/// A segment's zone.
struct SegmentZone<'a> {
    tree: &'a Goblin,
    index: usize,
}

impl Zone for SegmentZone<'_> {
    fn tally(&self) -> Result<ZoneStats> {
        Ok(self.tree.entry(self.index)?.zone)
    }

    fn classes(&self) -> Result<Vec<(Value, u64)>> {
        Ok(self.tree.segment(self.index)?.classes())
    }
}

/// A tally that a source knows.
struct KnownTally(ZoneStats);

impl Zone for KnownTally {
    fn tally(&self) -> Result<ZoneStats> {
        Ok(self.0.clone())
    }

    fn classes(&self) -> Result<Vec<(Value, u64)>> {
        Ok(self.0.classes.clone())
    }
}

/// Reason why a walk has not come to its end.
pub(super) enum Halt {
    /// The visitor needs no more.
    Stopped,
    /// The tree cannot be read, or the visitor has failed.
    Failed(Error),
}

impl From<Error> for Halt {
    fn from(error: Error) -> Halt {
        Halt::Failed(error)
    }
}

/// Result of a walk, and of what a visitor does on it.
pub(super) type Walked<T = ()> = std::result::Result<T, Halt>;

/// The result of a whole walk: stopping early is no failure.
pub(super) fn ended(walked: Walked) -> Result<()> {
    match walked {
        Ok(()) | Err(Halt::Stopped) => Ok(()),
        Err(Halt::Failed(error)) => Err(error),
    }
}

/// A selection of cells of the deepest level: what a question is about.
pub(super) trait Selection {
    /// How it has the cells of a node.
    fn cover(&self, space: &Bounds) -> Cover;
    /// The cells of a node, of which it has a part, that it may have.
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
            Cover::Part
        }
    }

    #[inline]
    fn part(&self, space: &Bounds) -> Bounds {
        space.intersect(self)
    }
}

/// A question about a selection of cells.
pub(super) trait Visitor {
    /// Whether the statistics of a zone that is selected as a whole will do; otherwise the walk goes into it.
    fn zone(&mut self, code: Code, zone: &dyn Zone) -> Walked<bool>;
    /// A uniform block (`None` is VOID) of which so many cells may be selected; if not all are, `part` has
    /// these.
    fn block(&mut self, code: Code, value: Option<Value>, cells: u64, part: Option<&Bounds>) -> Walked;
    /// The records of the subtree of a node that is selected as a whole, none of it in another segment, and its levels:
    /// whether the visitor has taken all of it at once. Otherwise the walk goes through them.
    fn subtree(&mut self, _: Code, _: &[u8], _: u8) -> Option<Result<(), BadSkip>> {
        None
    }
    /// The part of a dense block of cells, the node with a code, that may be selected, by its first place and places along each axis: whether the
    /// visitor has taken all of it at once. Otherwise the walk goes through it.
    fn dense(&mut self, _: Code, _: &DenseBlock<'_>, _: ([usize; 3], [usize; 3])) -> bool {
        false
    }
    /// The walk has gone through all children of a node.
    fn leave(&mut self, _: Code) -> Walked {
        Ok(())
    }
    /// A block of which nothing is selected.
    fn outside(&mut self) -> Walked {
        Ok(())
    }
    /// The walk goes into a segment's records.
    fn enter_segment(&mut self) {}
    /// Whether zones that are selected as a whole are read in their segments, as counts of classes are.
    fn reads_zones(&self) -> bool {
        false
    }
    /// The walk goes on behind a part whose bytes have not been fetched: what it has found is not all, and it fails in the end.
    fn miss_part(&mut self) {}
}

/// Lets a walk go on where a part lacks bytes.
///
/// Invariant: a node below which a part was missed fails in the end (`finish_deferred`) and is not left, so that no visitor takes what it has seen of
/// it for the whole, and the walk as such fails, too.
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

/// The cells of a node that are selected.
#[derive(Clone, Copy)]
enum Selected {
    Whole,
    Nothing,
    /// A part of these cells.
    Part(Bounds),
}

impl Selected {
    /// The selected ones of a node's cells; `None` if all are.
    #[inline]
    fn of(space: Option<Bounds>, selection: &impl Selection) -> Selected {
        let Some(space) = space else { return Selected::Whole };
        match selection.cover(&space) {
            Cover::Whole => Selected::Whole,
            Cover::Nothing => Selected::Nothing,
            Cover::Part => Selected::Part(space),
        }
    }

    /// The node's cells, unless all of them are selected.
    #[inline]
    fn space(self) -> Option<Bounds> {
        match self {
            Selected::Part(space) => Some(space),
            Selected::Whole | Selected::Nothing => None,
        }
    }
}

/// Walks all that is selected, in FD order.
pub(super) fn walk(tree: &Goblin, selection: &impl Selection, visitor: &mut impl Visitor) -> Walked {
    let (shape, root) = (tree.header().shape, Code::root(tree.header().form.dimension));
    let whole = root.bounds(shape.depth);
    // Below a node that is selected as a whole nothing is tested.
    let selected = Selected::of(Some(whole), selection);
    let walk = Walk { tree, shape, selection };
    match tree.root_child() {
        Child::Inner { .. } if matches!(selected, Selected::Nothing) => visitor.outside(),
        Child::Inner { .. } => walk.segment(root, tree.find_segment(root)?, selected.space(), visitor),
        uniform => uniform_block(root, shape.depth, uniform.value(), (selected, selection), visitor),
    }
}

/// Hands a uniform block to the visitor.
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
        Selected::Part(space) => {
            let part = selection.part(&space);
            visitor.block(code, value, part.volume(), Some(&part))
        }
    }
}

/// Walks all that is selected of any source, in FD order. Zones are where the source knows tallies.
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

/// Walks a node of a source.
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
    // (Of a block of which little is selected most would be for nothing.)
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

/// Cells of the largest blocks that are taken at once, as a power of two: 256 x 256, or 32 x 32 x 32.
const BLOCK_BITS: u8 = 16;

/// The cells below a node that has so many levels.
struct Cells<'a> {
    block: &'a CellBlock,
    form: TreeType,
    levels: u8,
}

impl Cells<'_> {
    /// The place of a cell.
    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        ((z << self.levels | y) << self.levels) | x
    }

    /// Whether all cells of a node are alike.
    fn is_uniform(&self, [x, y, z]: [usize; 3], side: usize) -> bool {
        let width = self.form.width();
        let at = |index: usize| {
            (self.block.present[index], &self.block.values[index * width..(index + 1) * width])
        };
        let (present, value) = at(self.index([x, y, z]));
        let deep = if self.form.axes() > 2 { side } else { 1 };
        // (Most that are not alike differ in the first few.)
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

    /// Walks a node of the block, given by its first cell and the levels below it.
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

struct Walk<'a, S> {
    tree: &'a Goblin,
    shape: Shape,
    selection: &'a S,
}

/// A node with a record.
struct Node {
    /// Its place in the segment.
    at: RunNode,
    code: Code,
    /// Its cells, unless all of them are selected.
    space: Option<Bounds>,
    /// Whether all that is below it is in the segment.
    inline: bool,
}

impl<S: Selection> Walk<'_, S> {
    /// A node that owns a segment.
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
        // Below the level of the blocks no node owns a segment.
        let inline = code.level() >= self.shape.block_level();
        self.node(&segment, segment.records(), Node { at: RunNode::default(), code, space, inline }, visitor)
    }

    /// Asks for the segments below a node whose own one has not been fetched, as far as the directory tells that the walk needs them: what is cut by the
    /// selection and owns a segment is gone into. So all of them are fetched at the same time, and not level by level.
    #[cold]
    fn miss_below(&self, code: Code, space: &Bounds, visitor: &impl Visitor) {
        let dimension = code.dimension();
        for step in 0..dimension.children() {
            let (child, space) = (code.child(step), space.child(dimension, step));
            let cover = self.selection.cover(&space);
            let is_wanted = cover == Cover::Part || cover == Cover::Whole && visitor.reads_zones();
            if !is_wanted || child.level() > self.shape.block_level() {
                continue;
            }
            if self.shape.is_candidate(child.level()) {
                let own = self.tree.find_segment(child).ok().flatten();
                let own =
                    own.filter(|own| matches!(self.tree.segment_code(*own), Ok(Some(code)) if code == child));
                let Some(own) = own else { continue };
                // (What it lacks is noted; nothing else of it is needed now.)
                let _ = self.tree.segment(own);
            }
            // (Of what is selected as a whole the uppermost zone is enough.)
            if cover == Cover::Part || !self.shape.is_candidate(child.level()) {
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

    /// A node of a state below one of a segment, which owns a segment perhaps.
    fn child(
        &self,
        segment: &Segment<'_>,
        records: &[u8],
        (node, state, is_candidate): (Node, u8, bool),
        visitor: &mut impl Visitor,
    ) -> Walked {
        // One that owns a segment has a zone there, and records that reach deeper than those here.
        let deepest = if is_candidate { self.tree.find_segment(node.code)? } else { None };
        match deepest {
            Some(own) if own != segment.index() && self.tree.segment_code(own)? == Some(node.code) => {
                self.segment(node.code, Some(own), node.space, visitor)
            }
            deepest if state == INNER => {
                // A node that might own a segment and does not is too small to be cut: all below
                // it has its records here.
                let inline = node.inline || deepest == Some(segment.index());
                self.node(segment, records, Node { inline, ..node }, visitor)
            }
            _ => Err(self.tree.bad_cut(node.code).into()),
        }
    }

    /// Walks a node of a dense block of cells: its code, and its index in its level.
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
