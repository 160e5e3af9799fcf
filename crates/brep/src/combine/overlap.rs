//! Where bodies come near each other: all octrees are traversed together, and faces far from all
//! other surfaces are settled per cell, without reading them.

use super::common_grid::CommonGrid;
use super::fates::Fates;
use super::table::{Fate, OperationTable};
use crate::query::half_of;
use crate::{ExactModel, Faces, ModelNode, ModelNodeState};
use spinney_base::{Progress, Result};

/// Fates of the faces of one body among others.
///
/// A cell decides for the faces in it. The table is for a cell of this body and a cell of another
/// body, one of which contains the other, with a margin of one grid unit.
///
/// | own cell                    | other VOID or FULL | other FACE to BOOLEAN | other INNER       |
/// | --------------------------- | ------------------ | --------------------- | ----------------- |
/// | VOID, FULL                  | nothing to do      | nothing to do (*)     | nothing to do (*) |
/// | FACE, EDGE, VERTEX, BOOLEAN | settled            | near                  | near if a leaf is |
/// | INNER                       | subtree settled    | children decide       | children decide   |
///
/// (*) The traversal of the other body decides for its faces.
pub(super) struct Overlap {
    /// Faces of its octree. Later, no proxy is near: proxies follow their exact faces.
    pub(super) faces: Fates,
    /// Exact faces.
    pub(super) exact: Fates,
}

impl Overlap {
    /// Creates the fates of a body without faces.
    pub(super) fn none() -> Overlap {
        Overlap { faces: Fates::new(0), exact: Fates::new(0) }
    }

    /// Classifies the faces of model `own`.
    pub(super) fn of(
        own: usize,
        models: &[&ExactModel],
        common_grid: &CommonGrid,
        table: OperationTable,
        progress: &dyn Progress,
    ) -> Result<Overlap> {
        let model = models[own];
        let found = Overlap { faces: Fates::new(model.len()), exact: Fates::new(model.exact_faces().0) };
        let mut classifier = FaceClassifier { own, models, common_grid, table, progress, found, visited: 0 };
        let windings: Vec<i32> = models.iter().map(|model| model.far_winding()).collect();
        let mut others = Vec::new();
        for body in (0..models.len()).filter(|body| *body != own) {
            let node = models[body].root()?;
            others.push(OtherNode { body, cell: common_grid.half_units(body, &node), node });
        }
        classifier.node(&models[own].root()?, &others, &windings)?;
        Ok(classifier.found)
    }
}

/// Node of another body, with its cell in half units of the common grid.
#[derive(Clone)]
struct OtherNode<'a> {
    body: usize,
    node: ModelNode<'a>,
    cell: [[i64; 3]; 2],
}

/// Whether two boxes have a common point.
fn meet([low, high]: &[[i64; 3]; 2], [other_low, other_high]: &[[i64; 3]; 2]) -> bool {
    (0..3).all(|axis| low[axis] <= other_high[axis] && other_low[axis] <= high[axis])
}

struct FaceClassifier<'a> {
    own: usize,
    models: &'a [&'a ExactModel],
    common_grid: &'a CommonGrid,
    table: OperationTable,
    progress: &'a dyn Progress,
    found: Overlap,
    visited: u64,
}

impl<'a> FaceClassifier<'a> {
    /// Traverses a node. `others` are nodes of other bodies that may be near it. `windings` has the
    /// winding number of each body without such nodes.
    fn node(&mut self, node: &ModelNode<'a>, others: &[OtherNode<'a>], windings: &[i32]) -> Result<()> {
        self.visited += 1;
        if self.visited.is_multiple_of(1 << 12) {
            self.progress.check()?;
        }
        if node.winding().is_some() {
            return Ok(());
        }
        // Invariant: no face of another body is within a grid unit of a face that is settled here:
        // the cell is enlarged by a grid unit of the common grid on each side. New vertices lie on
        // other bodies' faces, too, and rounding moves them by at most half a unit per axis.
        // Otherwise, an undivided face could intersect one whose vertices were rounded. (Mending
        // may move proxies farther: see `on_grid` in `combine`.)
        let [low, high] = self.common_grid.half_units(self.own, node);
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
        let mut windings = windings.to_vec();
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
            // Invariant: if none of a body's faces is near, its entry in `windings` is constant in
            // the cell, since winding numbers change at faces only. So any of its nodes there has
            // the value, and without nodes the cell is outside of its octree. The children of the
            // cell inherit the value, and do not query that body again.
            let found = near[first..].first().and_then(|other| other.node.winding());
            windings[other] = found.unwrap_or_else(|| self.models[other].far_winding());
            near.truncate(first);
        }
        if is_far {
            return self.settle(node, &windings);
        }
        for child in 0..8 {
            let child = self.models[self.own].child(node, child)?;
            self.node(&child, &near, &windings)?;
        }
        Ok(())
    }

    /// Whether a leaf at or below a node meets a box, and has faces in it or near it.
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

    /// Appends the nodes that meet a box. Splits INNER nodes that are larger than the box, or all
    /// of them if `to_leaves`.
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

    /// Records the fate of the faces in a cell that no other surface is near.
    fn settle(&mut self, node: &ModelNode<'a>, windings: &[i32]) -> Result<()> {
        match self.table.fate(self.own, windings) {
            Fate::Keep => Ok(()),
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
