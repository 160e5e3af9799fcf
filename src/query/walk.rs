//! Walks the part of a tree that lies in a box, asking at every zone whether its statistics will do.

use crate::Result;
use crate::space::{Bounds, Code};
use crate::store::build::BadSkip;
use crate::store::goblin::{CUT, Goblin, INNER, LEAF, Layout, Record, Segment, VOID, child_places};
use crate::tree::{Child, Source};
use crate::value::{Tally, Value};

/// What is known of all the cells below a node.
pub(super) trait Zone<V: Value> {
    /// Everything but the class counts.
    fn tally(&self) -> Result<Tally<V>>;
    /// Cells of each value.
    fn classes(&self) -> Result<Vec<(V, u64)>>;
}

/// A segment's.
struct SegmentZone<'a, D: Layout, V: Value> {
    tree: &'a Goblin<D, V>,
    index: usize,
}

impl<D: Layout, V: Value> Zone<V> for SegmentZone<'_, D, V> {
    fn tally(&self) -> Result<Tally<V>> {
        Ok(self.tree.entry(self.index)?.zone)
    }

    fn classes(&self) -> Result<Vec<(V, u64)>> {
        Ok(self.tree.segment(self.index)?.classes())
    }
}

/// What a source knows.
struct Known<V: Value>(Tally<V>);

impl<V: Value> Zone<V> for Known<V> {
    fn tally(&self) -> Result<Tally<V>> {
        Ok(self.0.clone())
    }

    fn classes(&self) -> Result<Vec<(V, u64)>> {
        Ok(self.0.classes.clone())
    }
}

/// What wants to know about a box of cells.
pub(super) trait Visitor<D: Layout, V: Value> {
    /// Whether the statistics of a zone that lies wholly in the box will do; otherwise the walk goes into it.
    fn zone(&mut self, code: Code<D>, zone: &dyn Zone<V>) -> Result<bool>;
    /// A uniform block (`None` is VOID) of which so many cells lie in the box; if not all do, `part` has those that do.
    fn block(&mut self, code: Code<D>, value: Option<V>, cells: u64, part: Option<&Bounds>) -> Result<()>;
    /// The records of a whole subtree that lies in the box, none of it in another segment, and its levels: whether the
    /// visitor has taken all of it at once. Otherwise the walk goes through them.
    fn subtree(&mut self, _: &[D::Record<V>], _: u8) -> Option<Result<(), BadSkip>> {
        None
    }
    /// The walk has gone through all children of a node.
    fn leave(&mut self, _: Code<D>) -> Result<()> {
        Ok(())
    }
    /// A block that lies outside the box.
    fn outside(&mut self) -> Result<()> {
        Ok(())
    }
    /// The walk goes into a segment's records.
    fn enter_segment(&mut self) {}
}

/// Walks all of `bounds` (cells of the deepest level), in FD order.
pub(super) fn walk<D: Layout, V: Value>(
    tree: &Goblin<D, V>,
    bounds: &Bounds,
    visitor: &mut impl Visitor<D, V>,
) -> Result<()> {
    let walk = Walk { tree, bounds };
    let depth = tree.header().shape.depth;
    let whole = node_bounds(Code::<D>::ROOT, depth);
    let space = (!bounds.contains(&whole)).then_some(whole);
    match tree.root_place()? {
        Child::Void => uniform(Code::ROOT, depth, None, (space.as_ref(), bounds), visitor),
        Child::Leaf(value) => uniform(Code::ROOT, depth, Some(value), (space.as_ref(), bounds), visitor),
        Child::Inner { .. } => walk.segment(Code::ROOT, tree.find_segment(Code::ROOT), space, visitor),
    }
}

struct Walk<'a, D: Layout, V: Value> {
    tree: &'a Goblin<D, V>,
    bounds: &'a Bounds,
}

/// The cells of a node.
#[inline]
pub(crate) fn node_bounds<D: Layout>(code: Code<D>, depth: u8) -> Bounds {
    let size = depth - code.level();
    let cell = code.cell().map(u64::from);
    let axis = |axis: usize, cell: u64| if axis < D::AXES { cell << size } else { cell };
    Bounds {
        min: std::array::from_fn(|i| axis(i, cell[i])),
        max: std::array::from_fn(|i| axis(i, cell[i] + 1)),
    }
}

/// A child's part of a node's cells.
#[inline]
pub(in crate::query) fn child_bounds<D: Layout>(node: &Bounds, child: usize) -> Bounds {
    let mut bounds = *node;
    for axis in 0..D::AXES {
        let middle = node.min[axis].midpoint(node.max[axis]);
        if child >> axis & 1 == 0 {
            bounds.max[axis] = middle;
        } else {
            bounds.min[axis] = middle;
        }
    }
    bounds
}

/// Shows a uniform block; `space` has its cells unless all of them lie in the box.
#[inline]
fn uniform<D: Layout, V: Value>(
    code: Code<D>,
    depth: u8,
    value: Option<V>,
    (space, bounds): (Option<&Bounds>, &Bounds),
    visitor: &mut impl Visitor<D, V>,
) -> Result<()> {
    let Some(space) = space else {
        let size = usize::from(depth.saturating_sub(code.level()));
        return visitor.block(code, value, 1 << (D::AXES * size), None);
    };
    let part = space.intersect(bounds);
    if part.is_empty() { visitor.outside() } else { visitor.block(code, value, part.volume(), Some(&part)) }
}

/// Walks all of `bounds` (cells of the deepest level) of any source, in FD order. Zones are where the source knows tallies.
pub(super) fn walk_source<S>(
    source: &S,
    bounds: &Bounds,
    visitor: &mut impl Visitor<S::Dim, S::Value>,
) -> Result<()>
where
    S: Source,
    S::Dim: Layout,
{
    let whole = node_bounds(Code::<S::Dim>::ROOT, source.depth());
    let space = (!bounds.contains(&whole)).then_some(whole);
    source_node(source, Code::ROOT, source.root()?, space, bounds, visitor)
}

fn source_node<S>(
    source: &S,
    code: Code<S::Dim>,
    place: Child<S::Value, S::Node>,
    space: Option<Bounds>,
    bounds: &Bounds,
    visitor: &mut impl Visitor<S::Dim, S::Value>,
) -> Result<()>
where
    S: Source,
    S::Dim: Layout,
{
    let node = match place {
        Child::Inner { node, .. } if code.level() < source.depth() => node,
        _ => return uniform(code, source.depth(), place.value(), (space.as_ref(), bounds), visitor),
    };
    if space.is_some_and(|space| space.intersect(bounds).is_empty()) {
        return visitor.outside();
    }
    if space.is_none()
        && let Some(tally) = source.tally(&node)?
        && visitor.zone(code, &Known(tally))?
    {
        return Ok(());
    }
    for (step, child) in source.children(&node)?.into_iter().enumerate() {
        let space = space.map(|space| child_bounds::<S::Dim>(&space, step));
        let space = space.filter(|space| !bounds.contains(space));
        source_node(source, code.child(step), child, space, bounds, visitor)?;
    }
    visitor.leave(code)
}

/// A node with a record.
struct Node<D> {
    /// Its record's number in the segment.
    at: usize,
    code: Code<D>,
    /// Its cells, unless all of them lie in the box.
    space: Option<Bounds>,
    /// Whether all that is below it is in the segment.
    light: bool,
}

impl<D: Layout, V: Value> Walk<'_, D, V> {
    /// A node that owns a segment.
    fn segment(
        &self,
        code: Code<D>,
        index: Option<usize>,
        space: Option<Bounds>,
        visitor: &mut impl Visitor<D, V>,
    ) -> Result<()> {
        let index = index.ok_or_else(|| self.tree.bad_cut(code))?;
        if space.is_none() && visitor.zone(code, &SegmentZone { tree: self.tree, index })? {
            return Ok(());
        }
        visitor.enter_segment();
        let segment = self.tree.segment(index)?;
        let light = code.level() >= self.tree.header().shape.block_level();
        self.node(&segment, segment.records(), Node { at: 0, code, space, light }, visitor)
    }

    fn node(
        &self,
        segment: &Segment<'_, D, V>,
        records: &[D::Record<V>],
        node: Node<D>,
        visitor: &mut impl Visitor<D, V>,
    ) -> Result<()> {
        let Node { at, code, space, light } = node;
        let shape = &self.tree.header().shape;
        if light && space.is_none() {
            let subtree = records.get(at..at + records[at].skip() as usize).unwrap_or(&[]);
            let levels = shape.depth.saturating_sub(code.level());
            if let Some(taken) = visitor.subtree(subtree, levels) {
                return taken.map_err(|_| self.tree.bad_skip(segment, at));
            }
        }
        let record = &records[at];
        let places = child_places::<D, V>(records, at).ok_or_else(|| self.tree.bad_skip(segment, at))?;
        if code.level() >= shape.depth {
            return Err(self.tree.bad_skip(segment, at));
        }
        let candidates = !light && shape.is_candidate(code.level() + 1);
        for (step, place) in places.as_ref().iter().enumerate() {
            let child = code.child(step);
            let space = space.map(|space| child_bounds::<D>(&space, step));
            let space = space.filter(|space| !self.bounds.contains(space));
            match record.state(step) {
                VOID => uniform(child, shape.depth, None, (space.as_ref(), self.bounds), visitor)?,
                LEAF => {
                    let value = Some(record.value(step));
                    uniform(child, shape.depth, value, (space.as_ref(), self.bounds), visitor)?;
                }
                state => {
                    debug_assert!(state == INNER || state == CUT);
                    if space.is_some_and(|space| space.intersect(self.bounds).is_empty()) {
                        visitor.outside()?;
                        continue;
                    }
                    let deepest = candidates.then(|| self.tree.find_segment(child)).flatten();
                    match (deepest, place) {
                        (Some(own), _)
                            if own != segment.index() && self.tree.segment(own)?.code() == child =>
                        {
                            self.segment(child, Some(own), space, visitor)?;
                        }
                        (deepest, Some(place)) => {
                            // A node that might own a segment and does not is light.
                            let light = light || deepest == Some(segment.index());
                            let node = Node { at: *place as usize, code: child, space, light };
                            self.node(segment, records, node, visitor)?;
                        }
                        _ => return Err(self.tree.bad_cut(child)),
                    }
                }
            }
        }
        visitor.leave(code)
    }
}
