//! Where bodies come near each other: all octrees are traversed together, and faces far from all
//! other surfaces are settled per cell, without reading them.

use super::common_grid::CommonGrid;
use super::fates::Fates;
use super::node_table::{OperandKind, PairCounts, TableEntry};
use super::table::{Fate, OperationTable};
use crate::query::half_of;
use crate::{ExactModel, Faces, ModelNode, ModelNodeState};
use spinney_base::{Progress, Result};

/// Fates of the faces of one body among others.
///
/// A cell decides for the faces in it, by the operation's table: see [`OperationTable::entry`]. Its
/// pairs are a cell of this body and a cell of another body, one of which contains the other, with
/// a margin of one grid unit.
///
/// | entry                      | faces of this body in the cell                        |
/// | -------------------------- | ----------------------------------------------------- |
/// | VOID, FULL                 | dropped, with the whole subtree                       |
/// | a copy or complement       | kept or reversed if it is of this body, dropped if not |
/// | divide                     | the children of the larger cell, or of both, decide   |
/// | face by face               | near                                                  |
///
/// VOID and FULL cells of this body have no faces: the traversal of the other body decides.
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
        (table, counts): (OperationTable, Option<&mut PairCounts>),
        progress: &dyn Progress,
    ) -> Result<Overlap> {
        let model = models[own];
        let found = Overlap { faces: Fates::new(model.len()), exact: Fates::new(model.exact_faces().0) };
        let mut classifier =
            FaceClassifier { own, models, common_grid, table, counts, progress, found, visited: 0 };
        let kinds: Vec<OperandKind> =
            models.iter().map(|model| OperandKind::uniform(model.far_winding() > 0)).collect();
        let mut others = Vec::new();
        for body in (0..models.len()).filter(|body| *body != own) {
            let node = models[body].root()?;
            others.push(OtherNode { body, cell: common_grid.half_units(body, &node), node });
        }
        classifier.node(&models[own].root()?, &others, &kinds)?;
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
    /// Counts of the pairs of two bodies, if they are wanted.
    counts: Option<&'a mut PairCounts>,
    progress: &'a dyn Progress,
    found: Overlap,
    visited: u64,
}

impl<'a> FaceClassifier<'a> {
    /// Traverses a node. `others` are nodes of other bodies that may be near it. `kinds` has the
    /// uniform kind of each body without such nodes.
    fn node(&mut self, node: &ModelNode<'a>, others: &[OtherNode<'a>], kinds: &[OperandKind]) -> Result<()> {
        self.visited += 1;
        if self.visited.is_multiple_of(1 << 12) {
            self.progress.check()?;
        }
        let own_kind = OperandKind::of(node);
        if own_kind.is_uniform() && self.counts.is_none() {
            return Ok(());
        }
        let mut kinds = kinds.to_vec();
        kinds[self.own] = own_kind;
        // Invariant: no face of another body is within a grid unit of a face that is settled here:
        // the cell is enlarged by a grid unit of the common grid on each side. New vertices lie on
        // other bodies' faces, too, and rounding moves them by at most half a unit per axis.
        // Otherwise, an undivided face could intersect one whose vertices were rounded. (Mending
        // may move proxies farther: see `on_grid` in `combine`.)
        let [low, high] = self.common_grid.half_units(self.own, node);
        let around = [low.map(|at| at - 2), high.map(|at| at + 2)];
        let is_leaf = !own_kind.is_uniform() && own_kind != OperandKind::Mixed;
        if is_leaf {
            // (The leaf is compared with one other body at a time, as if all others were VOID.)
            let mut pair = vec![OperandKind::Void; kinds.len()];
            pair[self.own] = own_kind;
            for other in others {
                let is_near = self.has_surface_at(other, &around, &mut pair)?;
                pair[other.body] = OperandKind::Void;
                if is_near {
                    node.faces().for_each(|face| self.found.faces.set_near(face));
                    node.near().into_iter().for_each(|face| self.found.exact.set_near(face.into()));
                    return Ok(());
                }
            }
        }
        let mut near: Vec<OtherNode<'a>> = Vec::new();
        for nodes in others.chunk_by(|a, b| a.body == b.body) {
            let first = near.len();
            for node in nodes {
                self.refine(node, &around, is_leaf, &mut near)?;
            }
            // Invariant: if none of a body's faces is near, its kind is the same in the whole cell,
            // since winding numbers change at faces only. So any of its nodes there has the kind,
            // and without nodes the cell is outside of its octree. The children of the cell inherit
            // the kind, and do not query that body again.
            let other = nodes[0].body;
            let mut found = near[first..].iter().map(|other| OperandKind::of(&other.node));
            kinds[other] = match (found.next(), found.find(|kind| !kind.is_uniform())) {
                (None, _) => OperandKind::uniform(self.models[other].far_winding() > 0),
                (Some(kind), None) if kind.is_uniform() || near.len() == first + 1 => kind,
                _ => OperandKind::Mixed,
            };
            if kinds[other].is_uniform() {
                near.truncate(first);
            }
        }
        let entry = self.entry(&kinds);
        match entry.fate(self.own) {
            // (It has no faces.)
            _ if own_kind.is_uniform() => return Ok(()),
            Some(Fate::Keep) => return Ok(()),
            Some(fate) => return self.note(node, fate),
            None => {}
        }
        for child in 0..8 {
            let child = self.models[self.own].child(node, child)?;
            self.node(&child, &near, &kinds)?;
        }
        Ok(())
    }

    /// Returns the table's entry for one node of each body, and counts it.
    fn entry(&mut self, kinds: &[OperandKind]) -> TableEntry {
        if let (Some(counts), [first, second]) = (&mut self.counts, kinds) {
            counts.add(self.own, [*first, *second]);
        }
        self.table.entry(kinds)
    }

    /// Whether a leaf must be computed face by face with a leaf at or below another body's node,
    /// which meets a box. `pair` has the leaf's kind; that of the other body is overwritten.
    fn has_surface_at(
        &mut self,
        other: &OtherNode<'a>,
        around: &[[i64; 3]; 2],
        pair: &mut [OperandKind],
    ) -> Result<bool> {
        let kind = OperandKind::of(&other.node);
        // (The caller counts uniform nodes.)
        if kind.is_uniform() || !meet(&other.cell, around) {
            return Ok(false);
        }
        pair[other.body] = kind;
        if self.entry(pair) != TableEntry::Divide {
            return Ok(true);
        }
        for child in 0..8 {
            let cell = half_of(&other.cell, child);
            if meet(&cell, around) {
                let node = self.models[other.body].child(&other.node, child)?;
                if self.has_surface_at(&OtherNode { node, cell, ..*other }, around, pair)? {
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

    /// Records the fate of the faces in and below a node.
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
