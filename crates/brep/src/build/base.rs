//! Incremental build: the octree of a model that shares most of its faces with a base model. Cells
//! without changes are copied from the base's octree.
//!
//! Changes of winding numbers between cell corners are computed from added minus removed faces. So
//! unchanged faces are only read in leaves that changed faces cut. Cells are not merged where faces
//! are removed, unless they become empty: the octree may be deeper than that of a full build, but
//! is equivalent.
//!
//! The base's grid may be a cell of the new model's grid: see [`BaseCell`].

use std::collections::HashSet;

use super::arena::{Arena, Mark};
use super::base_cell::{BaseCell, BaseRoot};
use super::cells::{Cell, uniform};
use super::division::{Division, each_bit};
use super::items::Items;
use super::near::NearFaces;
use super::spread::Spread;
use super::subtree_faces::{FaceWords, SubtreeFaces, SubtreeFacesBuilder};
use super::upper::{SpooledDivision, Upper, bytes_in_memory};
use crate::face_set::Renumbering;
use crate::geometry::Stages;
use crate::store::segment::{CUT, LeafHead};
use crate::{ExactModel, FaceBuffer, ModelNode, ModelNodeState};
use spinney_base::{Error, Result};

/// A base model, and its faces that are kept.
pub(crate) struct BaseModel<'a> {
    pub(crate) model: &'a ExactModel,
    /// The cell of the result that is the root of its octree. It is the result's root if it has
    /// exact faces: those near the walls of its root would be near other cells, too.
    pub(crate) root: BaseRoot,
    /// New numbers of the kept faces of its octree.
    pub(crate) faces: Renumbering,
    /// New numbers of its kept faces with off-grid vertices.
    pub(crate) exact: Renumbering,
    /// New numbers of its parts.
    pub(crate) part_numbers: Vec<u32>,
    /// Its parts of which faces are removed.
    pub(crate) changed_parts: HashSet<u32>,
}

/// Faces of a cell that are only in the base, or only in the new model.
struct Changes<'c> {
    /// Added faces.
    added: &'c [u32],
    /// Removed faces.
    removed: &'c [u32],
    /// Near faces with off-grid vertices: added and removed ones.
    near: [&'c [u32]; 2],
}

impl Changes<'_> {
    /// Returns whether there are no changes.
    fn is_empty(&self) -> bool {
        let Changes { added, removed, near } = self;
        added.is_empty() && removed.is_empty() && near.iter().all(|near| near.is_empty())
    }
}

impl BaseModel<'_> {
    /// Returns the error of an octree that does not match its faces.
    pub(super) fn wrong(&self, node: &ModelNode<'_>) -> Error {
        let place = format!("node {:?} of level {}", node.position(), node.level());
        Error::corrupt(
            self.model.path(),
            place,
            "a face list that does not match the faces",
            "the faces that cut the node",
        )
    }

    /// Returns the new numbers of a node's kept faces.
    fn faces(&self, node: &ModelNode<'_>) -> Vec<u32> {
        node.faces().filter_map(|face| self.faces.number(face)).collect()
    }

    /// Returns the new numbers of kept faces with off-grid vertices near a node.
    fn near(&self, node: &ModelNode<'_>) -> Vec<u32> {
        node.near().into_iter().filter_map(|face| self.exact.number(face.into())).collect()
    }

    /// Returns the same as [`BaseModel::near`], and loads these faces into `all`.
    fn load_near(&self, node: &ModelNode<'_>, all: &mut NearFaces) -> Result<Vec<u32>> {
        for face in node.near() {
            if let Some(number) = self.exact.number(face.into()) {
                all.load(number, || self.model.exact_face(face))?;
            }
        }
        Ok(self.near(node))
    }
}

impl Upper<'_> {
    /// Copies a cell without changes; returns the word of its node.
    pub(super) fn copy(
        &mut self,
        base: &BaseModel<'_>,
        node: &ModelNode<'_>,
        out: &mut Arena,
    ) -> Result<u32> {
        if node.begins_segment() && node.level() > 0 && self.copy_segment(base, node, out)? {
            return Ok(CUT);
        }
        let near = base.near(node);
        let cell = base.cell_of(node, 0);
        match node.state() {
            ModelNodeState::Inner if cell.level == self.depth => {
                let node = BaseCell::Node(node.clone());
                let (cell, near, words) = self.undivided(base, (&cell, &node), &[])?;
                self.leaves(&cell, SubtreeFaces::InMemory(words), &near, out)
            }
            ModelNodeState::Inner => {
                self.visited += 1;
                if self.visited.is_multiple_of(1 << 10) {
                    self.progress.check()?;
                }
                let (mark, record) = (out.mark(), out.record());
                for child in 0..8 {
                    let word = self.copy(base, &base.model.child(node, child)?, out)?;
                    out.set(record, child, word);
                }
                self.complete(&cell, mark, record, out)
            }
            ModelNodeState::Leaf { kind, rule, inside } => {
                let faces = base.faces(node);
                if faces.len() != node.faces().count() {
                    return Err(base.wrong(node));
                }
                Ok(out.leaf(LeafHead { kind, rule, inside }, faces.into_iter(), &near))
            }
            state => {
                let winding = i32::from(state == ModelNodeState::Full);
                let cell = Cell { winding, ..cell };
                let word = uniform(&cell, self.bits, out);
                Ok(out.near(word, &near))
            }
        }
    }

    /// Builds a cell of the base in which faces are added or removed. The cell's winding number is
    /// relative to that in the base. Returns the word of its node.
    pub(super) fn change_faces<'b>(
        &mut self,
        base: &BaseModel<'b>,
        (cell, base_cell): (&Cell, &BaseCell<'b>),
        [added, removed]: [SubtreeFaces; 2],
        near: [&[u32]; 2],
        out: &mut Arena,
    ) -> Result<u32> {
        let length = (added.len() + removed.len()) as u64;
        if bytes_in_memory(&added) + bytes_in_memory(&removed) <= self.memory / 2 {
            let items = [Items::of(added)?, Items::of(removed)?];
            let numbers = [&items[0], &items[1]].map(|items| (0..items.len() as u32).collect::<Vec<_>>());
            let changes = Changes { added: &numbers[0], removed: &numbers[1], near };
            let word = self.change(base, (cell, base_cell), [&items[0], &items[1]], &changes, out)?;
            self.advance(length);
            return Ok(word);
        }
        if !base.is_divided(cell, base_cell, self.depth) {
            let (cell, near, words) = self.undivided(base, (cell, base_cell), near[0])?;
            let mut run = SubtreeFacesBuilder::new((self.memory / 4 / 4) as usize, self.target.clone());
            let mut count = 0;
            let mut push = |face: FaceWords<'_>| {
                count += 1;
                run.push(face)
            };
            FaceWords::all(&words).try_for_each(&mut push)?;
            added.each(push)?;
            let run = run.finish()?.0;
            return self.cell(&cell, run, (&near, Spread::new(count, self.leaf_size)), out);
        }
        let Upper { bits, memory, stages, progress, .. } = *self;
        let division = SpooledDivision { bits, memory, stages, progress };
        let (added, cells, _) = division.of(cell, added, &mut self.target)?;
        let (removed, others, _) = division.of(cell, removed, &mut self.target)?;
        let (mark, record) = (out.mark(), out.record());
        for (child, runs) in added.into_iter().zip(removed).enumerate() {
            // Removed faces subtract what they had added.
            let winding = cells[child].winding - (others[child].winding - cell.winding);
            let cell = Cell { winding, ..cells[child] };
            let near =
                [self.near.of(near[0], &cell, self.bits), self.near_removed.of(near[1], &cell, self.bits)];
            let node = base.child_cell(base_cell, child, &cell)?;
            let near = [&near[0][..], &near[1]];
            let word = self.change_faces(base, (&cell, &node), [runs.0, runs.1], near, out)?;
            out.set(record, child, word);
        }
        self.complete(cell, mark, record, out)
    }

    /// Builds the same as [`Upper::change_faces`], with all changed faces in memory.
    fn change<'b>(
        &mut self,
        base: &BaseModel<'b>,
        (cell, base_cell): (&Cell, &BaseCell<'b>),
        items: [&Items; 2],
        changes: &Changes<'_>,
        out: &mut Arena,
    ) -> Result<u32> {
        // Invariant: in a cell without changed faces, the difference of the winding numbers is
        // constant. If no off-grid faces are added or removed near it, their lists are unchanged.
        // So the whole subtree is unchanged except for face numbers; a difference that is not zero
        // must not be copied, or the inside would be wrong.
        if let BaseCell::Node(node) = base_cell
            && changes.is_empty()
            && cell.winding == 0
        {
            return self.copy(base, node, out);
        }
        self.visited += 1;
        if self.visited.is_multiple_of(1 << 10) {
            self.progress.check()?;
        }
        if !base.is_divided(cell, base_cell, self.depth) {
            let (cell, near, mut words) = self.undivided(base, (cell, base_cell), changes.near[0])?;
            for item in changes.added {
                let outline = items[0].outline(*item);
                FaceWords::write(items[0].face(*item), outline.points, outline.ring_ends, &mut words);
            }
            return self.leaves(&cell, SubtreeFaces::InMemory(words), &near, out);
        }
        let division = Division::of(cell, self.bits);
        let mut windings = [0; 7];
        let mut parts: [[Vec<u32>; 8]; 2] = Default::default();
        let mut stages = Stages::default();
        for (way, list) in [changes.added, changes.removed].into_iter().enumerate() {
            let mut changed = [0; 7];
            for &item in list {
                let reach = division.reach(items[way].bounds(item));
                let children = items[way].children(item, reach, &division, &mut stages);
                each_bit(children, |child| parts[way][child].push(item));
                division.count_changes(reach, || items[way].outline(item), &mut changed);
            }
            let sign = if way == 0 { 1 } else { -1 };
            windings.iter_mut().zip(changed).for_each(|(sum, change)| *sum += sign * change);
        }
        self.stages.lock().expect("no thread panics while it holds this lock").add(&stages);
        let (mark, record) = (out.mark(), out.record());
        for (child, cell) in Division::cells(cell, windings).iter().enumerate() {
            let near = [
                self.near.of(changes.near[0], cell, self.bits),
                self.near_removed.of(changes.near[1], cell, self.bits),
            ];
            let changes =
                Changes { added: &parts[0][child], removed: &parts[1][child], near: [&near[0], &near[1]] };
            let node = base.child_cell(base_cell, child, cell)?;
            let word = self.change(base, (cell, &node), items, &changes, out)?;
            out.set(record, child, word);
        }
        self.complete(cell, mark, record, out)
    }

    /// Returns a cell that is not divided like the base, with its winding number, the exact faces
    /// near it including the added ones, and the words of its kept faces.
    fn undivided(
        &mut self,
        base: &BaseModel<'_>,
        (cell, base_cell): (&Cell, &BaseCell<'_>),
        added_near: &[u32],
    ) -> Result<(Cell, Vec<u32>, Vec<u32>)> {
        let added_near = self.near.of(added_near, cell, self.bits);
        let before = base.is_inside(base_cell)?;
        let (mut near, mut words, mut faces) = (Vec::new(), Vec::new(), Vec::new());
        if let BaseCell::Node(node) = base_cell {
            // (Only bases without exact faces have nodes that are joined here.)
            near = base.load_near(node, self.near)?;
            base.collect_faces(node, &mut faces)?;
            faces.sort_unstable();
            faces.dedup();
        }
        near.extend(added_near);
        let mut buffer = FaceBuffer::default();
        for face in faces {
            if let Some(number) = base.faces.number(face) {
                base.model.face(face, &mut buffer)?;
                buffer.points.iter_mut().for_each(|point| *point = base.point(*point));
                FaceWords::write(number, &buffer.points, &buffer.ring_ends, &mut words);
            }
        }
        Ok((Cell { winding: cell.winding + i32::from(before), ..*cell }, near, words))
    }

    /// Returns the word of a node whose children are complete.
    fn complete(&mut self, cell: &Cell, mark: Mark, record: usize, out: &mut Arena) -> Result<u32> {
        // (A cell may be near an off-grid face that none of its children is near: boxes and planes
        // are tested separately. So nothing is merged in models with off-grid faces.)
        let merged = if self.near.is_empty() { out.merged(record) } else { None };
        let word = merged.unwrap_or_else(|| out.complete(cell.code(), mark, record));
        self.store(out)?;
        Ok(word)
    }

    /// Builds a cell with its faces in memory.
    fn leaves(&mut self, cell: &Cell, run: SubtreeFaces, near: &[u32], out: &mut Arena) -> Result<u32> {
        if run.len() == 0 {
            let word = uniform(cell, self.bits, out);
            return Ok(out.near(word, near));
        }
        let items = Items::with(run, &mut self.large)?;
        let count = items.len();
        let spread = Spread::new(count as u64, self.leaf_size);
        let word = self.cell_builder(&items).cell(cell, (0..count as u32).collect(), (near, spread), out)?;
        self.store(out)?;
        Ok(word)
    }
}
