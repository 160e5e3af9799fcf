//! Walking a view: which source nodes a node of it shows.

use glam::DVec3;

use super::area::Area;
use super::view::{Sampling, TINY, View};
use crate::Result;
use crate::space::{Code, Dimension};
use crate::store::autumnal::Kept;
use crate::store::goblin::Layout;
use crate::tree::{CellBlock, Child, Source, Stored};
use crate::value::{Tally, Value};

type Place<S> = Child<<S as Source>::Value, <S as Source>::Node>;

/// An INNER node of a view.
#[derive(Clone, Debug)]
pub enum ViewNode<D: Dimension, V: Value, N: Clone + std::fmt::Debug + Send + Sync> {
    /// A node of the source as it is.
    Same(N),
    /// Anything else: the source nodes around the node's image.
    Around(Box<Around<D, V, N>>),
}

/// Source nodes of one size around the image of a node of a view.
#[derive(Clone, Debug)]
pub struct Around<D: Dimension, V: Value, N: Clone + std::fmt::Debug + Send + Sync> {
    /// The node.
    code: Code<D>,
    /// Source nodes have `2^size` cells along each axis.
    size: u8,
    /// Place of the first source node, in nodes of this size.
    corner: [i64; 3],
    places: D::Array<Child<V, N>>,
}

/// The children of the places around a node, as far as they were asked for.
struct Below<'a, S: Source> {
    source: &'a S,
    around: &'a Around<S::Dim, S::Value, S::Node>,
    children: [Option<<S::Dim as Dimension>::Array<Place<S>>>; 8],
}

impl<S: Source> Below<'_, S> {
    /// The source node of `2^size` cells along each axis, no more than those around have, at a place.
    fn get(&mut self, at: [i64; 3], size: u8) -> Result<Place<S>> {
        let mut up = self.around.size - size;
        let step = |up: u8, corner: [i64; 3]| {
            (0..S::Dim::AXES)
                .map(|axis| (((at[axis] >> up) - corner[axis]) as usize & 1) << axis)
                .sum::<usize>()
        };
        let first = step(up, self.around.corner);
        let node = match &self.around.places.as_ref()[first] {
            Child::Inner { node, .. } if up > 0 => node,
            place => return Ok(place.clone()),
        };
        up -= 1;
        let children = match &mut self.children[first] {
            Some(children) => children,
            none => none.insert(self.source.children(node)?),
        };
        let mut place = children.as_ref()[step(up, [0; 3])].clone();
        while let (Child::Inner { node, .. }, true) = (&place, up > 0) {
            up -= 1;
            place = self.source.children(node)?.as_ref()[step(up, [0; 3])].clone();
        }
        Ok(place)
    }
}

impl<D: Dimension, V: Value, N: Clone + std::fmt::Debug + Send + Sync> Around<D, V, N> {
    pub(super) fn code(&self) -> Code<D> {
        self.code
    }
}

impl<S: Source> View<S> {
    /// What the view has at a node that lies inside the one that `below` is of.
    fn look(
        &self,
        code: Code<S::Dim>,
        below: &mut Below<'_, S>,
    ) -> Result<Child<S::Value, <Self as Source>::Node>> {
        let axes = S::Dim::AXES;
        let lookup = &self.lookup;
        let height = self.depth() - code.level();
        let side = 1i64 << height;
        let first = code.cell().map(|cell| i64::from(cell) << height);
        let first = std::array::from_fn::<_, 3, _>(|axis| if axis < axes { first[axis] } else { 0 });
        let start = DVec3::from(first.map(|cell| cell as f64));
        let end = start
            + DVec3::from_array(std::array::from_fn(|axis| if axis < axes { side as f64 } else { 1.0 }));
        // Where there is something to see.
        let (low, high) = (start.max(lookup.content.0), end.min(lookup.content.1));
        let (from, to) = (low.max(lookup.shown.0), high.min(lookup.shown.1));
        if from.cmpge(to).any() {
            return Ok(Child::Void);
        }
        let mut cut = from != low || to != high;
        for (map, size) in &lookup.askew {
            let half = DVec3::splat(0.5);
            let (low, high) = map.bounding_box(from + half, to - half);
            if high.cmplt(DVec3::ZERO).any() || low.cmpge(*size).any() {
                return Ok(Child::Void);
            }
            cut |= low.cmplt(DVec3::ZERO).any() || high.cmpge(*size).any();
        }
        if let Some(moved) = lookup.moved.filter(|_| lookup.askew.is_empty()) {
            let image: [i64; 3] = std::array::from_fn(|axis| first[axis] + moved.by[axis]);
            let aligned = image[..axes].iter().all(|cell| *cell >= 0 && cell & (side - 1) == 0);
            if aligned && height <= below.around.size && moved.shows_all(image, side, axes) {
                let same = below.get(image.map(|cell| cell >> height), height)?;
                return Ok(same.map_node(ViewNode::Same));
            }
        }
        // The box of source cells that count, its ends included.
        let (low, high) = if lookup.by_area {
            let (low, high) = lookup.to_source.bounding_box(from, to);
            (low + TINY, high - TINY)
        } else {
            let half = DVec3::splat(0.5);
            let (low, high) = lookup.to_source.bounding_box(from + half, to - half);
            // A single cell's centre is decided as it is.
            let tiny = if height == 0 { 0.0 } else { TINY };
            (low - tiny, high + tiny)
        };
        let (low, high) = (low.floor().to_array(), high.floor().to_array());
        let (seen_start, seen_end) = lookup.seen;
        let (low, high) = (low.map(|cell| cell as i64), high.map(|cell| cell as i64));
        let clamp = |cells: [i64; 3], pick: fn(i64, i64) -> i64, bound: [i64; 3]| -> [i64; 3] {
            std::array::from_fn(|axis| if axis < axes { pick(cells[axis], bound[axis]) } else { 0 })
        };
        let low_cell = clamp(low, i64::max, seen_start);
        let high_cell = clamp(high, i64::min, seen_end.map(|end| end - 1));
        let mut outside = false;
        let mut widest = 1;
        for axis in 0..axes {
            if low_cell[axis] > high_cell[axis] {
                return Ok(Child::Void);
            }
            outside |= low[axis] < low_cell[axis] || high[axis] > high_cell[axis];
            widest = widest.max(high_cell[axis] - low_cell[axis] + 1);
        }
        let size = (widest as u64).next_power_of_two().trailing_zeros() as u8;
        let size = size.min(below.around.size);
        let corner: [i64; 3] = low_cell.map(|cell| cell >> size);
        let last: [i64; 3] =
            std::array::from_fn(|axis| if axis < axes { high_cell[axis] >> size } else { 0 });
        let mut places = S::Dim::array(|_| Child::Void);
        let mut uniform = None;
        let (mut same, mut void) = (true, true);
        for (child, place) in places.as_mut().iter_mut().enumerate() {
            let at: [i64; 3] = std::array::from_fn(|axis| corner[axis] + (child as i64 >> axis & 1));
            if (0..axes).any(|axis| at[axis] > last[axis]) {
                continue;
            }
            *place = below.get(at, size)?;
            void &= matches!(place, Child::Void);
            match (&*place, uniform) {
                (Child::Leaf(value), None) => uniform = Some(*value),
                (Child::Leaf(value), Some(first)) if value.same(first) => {}
                _ => same = false,
            }
        }
        if void {
            return Ok(Child::Void);
        }
        let whole = !cut && !outside && from == start && to == end;
        if let (true, true, Some(value)) = (same, whole, uniform) {
            return Ok(Child::Leaf(value));
        }
        let centre = lookup.to_source.0.transform_point3((from + to) * 0.5).floor().to_array();
        let in_middle = (0..axes)
            .map(|axis| {
                let cell = (centre[axis].max(0.0) as i64).clamp(low_cell[axis], high_cell[axis]);
                (((cell >> size) - corner[axis]) as usize & 1) << axis
            })
            .sum::<usize>();
        let in_middle = places.as_ref()[in_middle].value();
        if height == 0 {
            let value = match self.sampling {
                Sampling::Area(rule) if lookup.by_area => {
                    let (low, high) = lookup.to_source.bounding_box(from, to);
                    let seen = [seen_start, seen_end].map(|cell| DVec3::from(cell.map(|cell| cell as f64)));
                    let image = (low.max(seen[0]), high.min(seen[1]));
                    let mut area = Area::new(&self.source, rule, image);
                    for (child, place) in places.as_ref().iter().enumerate() {
                        let at = std::array::from_fn(|axis| corner[axis] + (child as i64 >> axis & 1));
                        area.add(place, at.map(|at: i64| at << size), size)?;
                    }
                    area.value()
                }
                _ => in_middle,
            };
            return Ok(value.map_or(Child::Void, Child::Leaf));
        }
        let representative = in_middle.or_else(|| places.as_ref().iter().find_map(Child::value));
        let representative = representative.unwrap_or_default();
        let around = Around { code, size, corner, places };
        Ok(Child::Inner { representative, node: ViewNode::Around(Box::new(around)) })
    }
}

impl<S: Source> Source for View<S> {
    type Dim = S::Dim;
    type Value = S::Value;
    type Node = ViewNode<S::Dim, S::Value, S::Node>;

    fn depth(&self) -> u8 {
        View::depth(self)
    }

    fn root(&self) -> Result<Child<S::Value, Self::Node>> {
        let mut places = S::Dim::array(|_| Child::Void);
        places.as_mut()[0] = self.source.root()?;
        let around = Around { code: Code::ROOT, size: self.source.depth(), corner: [0; 3], places };
        let mut below = Below { source: &self.source, around: &around, children: Default::default() };
        self.look(Code::ROOT, &mut below)
    }

    fn each_child(
        &self,
        node: &Self::Node,
        mut each: impl FnMut(usize, Child<S::Value, Self::Node>) -> Result<()>,
    ) -> Result<()> {
        match node {
            ViewNode::Same(node) => {
                self.source.each_child(node, |step, child| each(step, child.map_node(ViewNode::Same)))
            }
            ViewNode::Around(around) => {
                let mut below = Below { source: &self.source, around, children: Default::default() };
                (0..S::Dim::CHILDREN)
                    .try_for_each(|step| each(step, self.look(around.code.child(step), &mut below)?))
            }
        }
    }

    fn cells(&self, node: &Self::Node, levels: u8) -> Result<Option<CellBlock<S::Value>>> {
        match node {
            ViewNode::Same(node) => self.source.cells(node, levels),
            ViewNode::Around(_) => self.draw_block(node, levels),
        }
    }

    fn kept(&self, node: &Self::Node) -> Option<Kept> {
        match node {
            ViewNode::Same(node) => self.source.kept(node),
            ViewNode::Around(_) => None,
        }
    }

    fn tally(&self, node: &Self::Node) -> Result<Option<Tally<S::Value>>> {
        match node {
            ViewNode::Same(node) => self.source.tally(node),
            ViewNode::Around(_) => Ok(None),
        }
    }

    fn stored(&self, node: &Self::Node) -> Option<Stored<'_, S::Dim, S::Value>>
    where
        S::Dim: Layout,
    {
        match node {
            ViewNode::Same(node) => self.source.stored(node),
            ViewNode::Around(_) => None,
        }
    }
}
