//! Where bodies come near each other: both octrees are gone through side by side, and what is far from all other surfaces is
//! settled cell by cell, without a look at its faces.

use super::fates::Fates;
use super::placed::Placed;
use super::table::{Fate, OperationTable};
use crate::query::half_of;
use crate::{ExactModel, Faces, ModelNode, ModelNodeState};
use spinney_base::{Progress, Result};

/// Fates of the faces of one body among others.
///
/// A cell decides of what is in it alone: of two cells, each of some body, of which one lies in the other with a step more on all
/// sides, these are the entries of the table of an operation, by the states of both.
///
/// | own cell | VOID or FULL | FACE, EDGE, VERTEX or BOOLEAN | INNER |
/// | --- | --- | --- | --- |
/// | VOID, FULL | nothing to do | the other body's walk tells | the other body's walk tells |
/// | FACE to BOOLEAN | kept, turned or dropped | near: arranged anew | near if a leaf below is |
/// | INNER | kept, turned or dropped, with its subtree | children | children |
pub(super) struct Overlap {
    /// The faces of its octree. Those that stand in for others are never near: they go with these.
    pub(super) faces: Fates,
    /// Those with corners beside the grid.
    pub(super) exact: Fates,
}

impl Overlap {
    /// That of a body without faces.
    pub(super) fn none() -> Overlap {
        Overlap { faces: Fates::new(0), exact: Fates::new(0) }
    }

    /// Finds out about one of several models.
    pub(super) fn of(
        own: usize,
        models: &[&ExactModel],
        placed: &Placed,
        table: OperationTable,
        progress: &dyn Progress,
    ) -> Result<Overlap> {
        let model = models[own];
        let found = Overlap { faces: Fates::new(model.len()), exact: Fates::new(model.exact_faces().0) };
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
        if node.winding().is_some() {
            return Ok(());
        }
        // Invariant: a face of a cell that is settled here has no other body's face within a step. The cell
        // is taken to be a step larger on each side; and new vertices are moved by half a step at most. Else
        // a face that nobody divided could pass through one whose corners were rounded.
        let [low, high] = self.placed.half_units(self.own, node);
        let around = [low.map(|at| at - 2), high.map(|at| at + 2)];
        let is_leaf = node.state() != ModelNodeState::Inner;
        if is_leaf {
            for other in others {
                if self.has_surface_at(other, &around)? {
                    node.faces().for_each(|face| self.found.faces.set_near(face));
                    node.near().into_iter().for_each(|face| self.found.exact.set_near(face.into()));
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
            if near[first..].iter().any(|other| other.node.winding().is_none()) {
                is_far = false;
                continue;
            }
            // Invariant: `places` of a body none of whose faces is near is the same all over the cell, since
            // a winding number changes at faces only. So any of its nodes there says what it is, and far away
            // is what has no node. The children of the cell go on with it, and never ask that body again.
            let found = near[first..].first().and_then(|other| other.node.winding());
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

    /// Whether a cell without children at or below a node meets a box, and has faces in it or near it.
    fn has_surface_at(&self, other: &OtherNode<'a>, around: &[[i64; 3]; 2]) -> Result<bool> {
        if other.node.state() != ModelNodeState::Inner {
            return Ok(other.node.winding().is_none() && meet(&other.cell, around));
        }
        for child in 0..8 {
            let cell = half_of(&other.cell, child);
            if meet(&cell, around) {
                let node = self.models[other.body].child(&other.node, child)?;
                if self.has_surface_at(&OtherNode { node, cell, ..*other }, around)? {
                    return Ok(true);
                }
            }
        }
        Ok(false)
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
        node.faces().for_each(|face| self.found.faces.note(face, fate));
        if node.state() == ModelNodeState::Inner {
            for child in 0..8 {
                let child = self.models[self.own].child(node, child)?;
                self.note(&child, fate)?;
            }
        }
        Ok(())
    }
}
