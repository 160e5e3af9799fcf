//! Where bodies come near each other: both octrees are gone through side by side, and what is far from all other surfaces is
//! settled cell by cell, without a look at its faces.

use super::placed::Placed;
use super::table::{Fate, OperationTable};
use crate::query::half_of;
use crate::{ExactModel, Faces, ModelNode, ModelNodeState};
use spinney_base::{Progress, Result};

/// A set of faces, a bit for each of a model.
pub(super) struct FaceSet(Vec<u64>);

impl FaceSet {
    fn new(count: u64) -> FaceSet {
        FaceSet(vec![0; count.div_ceil(64) as usize])
    }

    fn add(&mut self, number: u64) {
        if let Some(word) = self.0.get_mut((number / 64) as usize) {
            *word |= 1 << (number % 64);
        }
    }

    fn remove(&mut self, number: u64) {
        if let Some(word) = self.0.get_mut((number / 64) as usize) {
            *word &= !(1 << (number % 64));
        }
    }

    /// The numbers in the set, ascending.
    pub(super) fn numbers(&self) -> impl Iterator<Item = u32> {
        let of_word = |(index, word): (u32, &u64)| {
            let word = *word;
            (0..64).filter(move |bit| word >> bit & 1 == 1).map(move |bit| 64 * index + bit)
        };
        (0..).zip(&self.0).flat_map(of_word)
    }

    pub(super) fn has(&self, number: u64) -> bool {
        self.0.get((number / 64) as usize).is_some_and(|word| word >> (number % 64) & 1 == 1)
    }
}

/// The faces of one body among others.
pub(super) struct Overlap {
    /// Those in cells that faces of other bodies are in or near, too, but for those that are settled otherwise.
    pub(super) near: FaceSet,
    /// Of the others, those to be turned, and those to be dropped.
    turned: FaceSet,
    dropped: FaceSet,
}

impl Overlap {
    /// The fate of a face that is not near.
    pub(super) fn fate(&self, number: u64) -> Fate {
        // Invariant: all cells of a face that are far from other bodies have noted the same fate, since the
        // face leads from one to the other without meeting any; and a face with a cell that is near is in
        // `near`, which is looked at before this. So the order in which cells are gone through does not
        // matter.
        match (self.turned.has(number), self.dropped.has(number)) {
            (_, true) => Fate::Dropped,
            (true, _) => Fate::Turned,
            _ => Fate::Kept,
        }
    }

    /// Notes the fate of a face that is not near after all.
    pub(super) fn settle(&mut self, number: u64, fate: Fate) {
        self.near.remove(number);
        match fate {
            Fate::Kept => {}
            Fate::Turned => self.turned.add(number),
            Fate::Dropped => self.dropped.add(number),
        }
    }

    /// Finds out about one of several models.
    pub(super) fn of(
        own: usize,
        models: &[&ExactModel],
        placed: &Placed,
        table: OperationTable,
        progress: &dyn Progress,
    ) -> Result<Overlap> {
        let count = models[own].len();
        let found =
            Overlap { near: FaceSet::new(count), turned: FaceSet::new(count), dropped: FaceSet::new(count) };
        let mut walk = Walk { own, models, placed, table, progress, found, visited: 0 };
        let places: Vec<i32> = models.iter().map(|model| model.far_winding()).collect();
        let mut others = Vec::new();
        for body in (0..models.len()).filter(|body| *body != own) {
            let node = models[body].root()?;
            others.push(OtherNode { body, cell: placed.half_units(body, &node), node });
        }
        walk.node(&models[own].root()?, &others, &places)?;
        Ok(walk.found)
    }
}

/// A node of another body, with its cell in half steps of the common grid.
#[derive(Clone)]
struct OtherNode<'a> {
    body: usize,
    node: ModelNode<'a>,
    cell: [[i64; 3]; 2],
}

/// Whether two boxes have a point in common.
fn meet([low, high]: &[[i64; 3]; 2], [other_low, other_high]: &[[i64; 3]; 2]) -> bool {
    (0..3).all(|axis| low[axis] <= other_high[axis] && other_low[axis] <= high[axis])
}

struct Walk<'a> {
    own: usize,
    models: &'a [&'a ExactModel],
    placed: &'a Placed,
    table: OperationTable,
    progress: &'a dyn Progress,
    found: Overlap,
    visited: u64,
}

impl<'a> Walk<'a> {
    /// Goes through a node; `others` are nodes of other bodies that may be near it, and `places` tells of each body without such
    /// nodes whether the cell is inside of it.
    fn node(&mut self, node: &ModelNode<'a>, others: &[OtherNode<'a>], places: &[i32]) -> Result<()> {
        self.visited += 1;
        if self.visited.is_multiple_of(1 << 12) {
            self.progress.check()?;
        }
        if matches!(node.state(), ModelNodeState::Void | ModelNodeState::Full) {
            return Ok(());
        }
        // Invariant: a face of a cell that is settled here has no other body's face within a step. The cell
        // is taken to be a step larger on each side; and new vertices are moved by half a step at most. Else
        // a face that nobody divided could pass through one whose corners were rounded.
        let [low, high] = self.placed.half_units(self.own, node);
        let around = [low.map(|at| at - 2), high.map(|at| at + 2)];
        let is_leaf = matches!(node.state(), ModelNodeState::Leaf { .. });
        if is_leaf {
            for other in others {
                if self.has_leaf_at(other, &around)? {
                    node.faces().for_each(|face| self.found.near.add(face));
                    return Ok(());
                }
            }
        }
        let mut places = places.to_vec();
        let mut near: Vec<OtherNode<'a>> = Vec::new();
        let mut is_far = true;
        for nodes in others.chunk_by(|a, b| a.body == b.body) {
            let first = near.len();
            for node in nodes {
                self.refine(node, &around, is_leaf, &mut near)?;
            }
            let other = nodes[0].body;
            let side = |other: &OtherNode<'_>| match other.node.state() {
                ModelNodeState::Void => Some(0),
                ModelNodeState::Full => Some(1),
                _ => None,
            };
            if near[first..].iter().any(|node| side(node).is_none()) {
                is_far = false;
                continue;
            }
            // Invariant: `places` of a body none of whose faces is near is the same all over the cell, since
            // a winding number changes at faces only. So any of its nodes there says what it is, and far away
            // is what has no node. The children of the cell go on with it, and never ask that body again.
            let found = near[first..].first().and_then(side);
            places[other] = found.unwrap_or_else(|| self.models[other].far_winding());
            near.truncate(first);
        }
        if is_far {
            return self.settle(node, &places);
        }
        for child in 0..8 {
            let child = self.models[self.own].child(node, child)?;
            self.node(&child, &near, &places)?;
        }
        Ok(())
    }

    /// Whether a leaf at or below a node meets a box.
    fn has_leaf_at(&self, other: &OtherNode<'a>, around: &[[i64; 3]; 2]) -> Result<bool> {
        match other.node.state() {
            ModelNodeState::Void | ModelNodeState::Full => Ok(false),
            ModelNodeState::Leaf { .. } => Ok(meet(&other.cell, around)),
            ModelNodeState::Inner => {
                for child in 0..8 {
                    let cell = half_of(&other.cell, child);
                    if meet(&cell, around) {
                        let node = self.models[other.body].child(&other.node, child)?;
                        if self.has_leaf_at(&OtherNode { node, cell, ..*other }, around)? {
                            return Ok(true);
                        }
                    }
                }
                Ok(false)
            }
        }
    }

    /// Appends the nodes that meet a box, those with faces as small as it or as they are.
    fn refine(
        &self,
        other: &OtherNode<'a>,
        around: &[[i64; 3]; 2],
        to_leaves: bool,
        near: &mut Vec<OtherNode<'a>>,
    ) -> Result<()> {
        if !meet(&other.cell, around) {
            return Ok(());
        }
        let [low, high] = other.cell;
        match other.node.state() {
            ModelNodeState::Inner if to_leaves || high[0] - low[0] > around[1][0] - around[0][0] => {
                for child in 0..8 {
                    let cell = half_of(&other.cell, child);
                    if meet(&cell, around) {
                        let node = self.models[other.body].child(&other.node, child)?;
                        self.refine(&OtherNode { node, cell, ..*other }, around, to_leaves, near)?;
                    }
                }
            }
            _ => near.push(other.clone()),
        }
        Ok(())
    }

    /// Notes what becomes of the faces of a cell that no other surface is near.
    fn settle(&mut self, node: &ModelNode<'a>, places: &[i32]) -> Result<()> {
        match self.table.fate(self.own, places) {
            Fate::Kept => Ok(()),
            fate => self.note(node, fate),
        }
    }

    fn note(&mut self, node: &ModelNode<'a>, fate: Fate) -> Result<()> {
        let faces = if fate == Fate::Turned { &mut self.found.turned } else { &mut self.found.dropped };
        node.faces().for_each(|face| faces.add(face));
        if node.state() == ModelNodeState::Inner {
            for child in 0..8 {
                let child = self.models[self.own].child(node, child)?;
                self.note(&child, fate)?;
            }
        }
        Ok(())
    }
}
