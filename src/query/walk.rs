//! Walks the part of a tree that lies in a box, asking at every zone whether its statistics will do.

use crate::Result;
use crate::space::{Bounds, Code};
use crate::store::goblin::{CUT, Goblin, INNER, LEAF, Layout, Record, Segment, VOID, child_places};
use crate::tree::Child;
use crate::value::Value;

/// What wants to know about a box of cells.
pub(super) trait Visitor<D: Layout, V: Value> {
    /// Whether the statistics of a zone that lies wholly in the box will do; otherwise the walk goes into it.
    fn zone(&mut self, code: Code<D>, segment: usize) -> Result<bool>;
    /// A uniform block (`None` is VOID) of which so many cells lie in the box, or all if `inside`.
    fn block(&mut self, code: Code<D>, value: Option<V>, part: &Bounds, inside: bool) -> Result<()>;
    /// The walk has gone through all children of a node.
    fn leave(&mut self, code: Code<D>) -> Result<()>;
    /// A block that lies outside the box.
    fn outside(&mut self) -> Result<()>;
    /// The walk goes into a segment's records.
    fn enter_segment(&mut self);
}

/// Walks all of `bounds` (cells of the deepest level), in FD order.
pub(super) fn walk<D: Layout, V: Value>(
    tree: &Goblin<D, V>,
    bounds: &Bounds,
    visitor: &mut impl Visitor<D, V>,
) -> Result<()> {
    let walk = Walk { tree, bounds };
    match tree.root_place()? {
        Child::Void => walk.uniform(Code::ROOT, None, visitor),
        Child::Leaf(value) => walk.uniform(Code::ROOT, Some(value), visitor),
        Child::Inner { .. } => walk.segment(Code::ROOT, tree.find_segment(Code::ROOT), visitor),
    }
}

struct Walk<'a, D: Layout, V: Value> {
    tree: &'a Goblin<D, V>,
    bounds: &'a Bounds,
}

/// The cells of a node.
#[inline]
pub(super) fn node_bounds<D: Layout>(code: Code<D>, depth: u8) -> Bounds {
    let size = depth - code.level();
    let cell = code.cell().map(u64::from);
    let axis = |axis: usize, cell: u64| if axis < D::AXES { cell << size } else { cell };
    Bounds {
        min: std::array::from_fn(|i| axis(i, cell[i])),
        max: std::array::from_fn(|i| axis(i, cell[i] + 1)),
    }
}

impl<D: Layout, V: Value> Walk<'_, D, V> {
    fn uniform(&self, code: Code<D>, value: Option<V>, visitor: &mut impl Visitor<D, V>) -> Result<()> {
        let whole = node_bounds(code, self.tree.header().shape.depth);
        let part = whole.intersect(self.bounds);
        if part.is_empty() { visitor.outside() } else { visitor.block(code, value, &part, part == whole) }
    }

    /// A node that owns a segment.
    fn segment(&self, code: Code<D>, index: Option<usize>, visitor: &mut impl Visitor<D, V>) -> Result<()> {
        let index = index.ok_or_else(|| self.tree.bad_cut(code))?;
        let whole = node_bounds(code, self.tree.header().shape.depth);
        if self.bounds.contains(&whole) && visitor.zone(code, index)? {
            return Ok(());
        }
        visitor.enter_segment();
        let segment = self.tree.segment(index)?;
        self.node(&segment, segment.records(), 0, code, visitor)
    }

    fn node(
        &self,
        segment: &Segment<'_, D, V>,
        records: &[D::Record<V>],
        at: usize,
        code: Code<D>,
        visitor: &mut impl Visitor<D, V>,
    ) -> Result<()> {
        let shape = &self.tree.header().shape;
        let record = records[at];
        let places = child_places::<D, V>(records, at).ok_or_else(|| self.tree.bad_skip(segment, at))?;
        if code.level() >= shape.depth {
            return Err(self.tree.bad_skip(segment, at));
        }
        for (step, place) in places.as_ref().iter().enumerate() {
            let child = code.child(step);
            match record.state(step) {
                VOID => self.uniform(child, None, visitor)?,
                LEAF => self.uniform(child, Some(record.value(step)), visitor)?,
                state => {
                    debug_assert!(state == INNER || state == CUT);
                    if node_bounds(child, shape.depth).intersect(self.bounds).is_empty() {
                        visitor.outside()?;
                        continue;
                    }
                    let own =
                        shape.is_candidate(child.level()).then(|| self.tree.find_segment(child)).flatten();
                    match (own, place) {
                        (Some(own), _)
                            if own != segment.index() && self.tree.segment(own)?.code() == child =>
                        {
                            self.segment(child, Some(own), visitor)?;
                        }
                        (_, Some(place)) => self.node(segment, records, *place as usize, child, visitor)?,
                        _ => return Err(self.tree.bad_cut(child)),
                    }
                }
            }
        }
        visitor.leave(code)
    }
}
