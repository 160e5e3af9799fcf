//! Verification of a file's octree: its faces are divided again along the file's nodes, and the
//! result is compared in each cell. Pairs of faces and winding numbers are checked as in a build.

use std::ops::Range;
use std::sync::Mutex;

use super::Defect;
use super::arena::Arena;
use super::cells::{Cell, CellBuilder, Lists, TASK, uniform};
use super::defects::{Defects, MAX_LISTED};
use super::division::Division;
use super::items::Items;
use super::near::NearFaces;
use super::subtree_faces::{FaceWords, SpoolTarget, SubtreeFaces, SubtreeFacesBuilder};
use super::upper::{SpooledDivision, bytes_in_memory};
use crate::arrangement::ExactFace;
use crate::geometry::Stages;
use crate::store::segment::{LeafHead, LeafRule, NodeKind};
use crate::store::summary::NodeCounts;
use crate::{ExactModel, Face, Faces, Grid, ModelNode, ModelNodeState};
use spinney_base::parallel;
use spinney_base::sort;
use spinney_base::{Error, Progress, Result};
use spinney_container::Finding;

/// Result of an octree check.
#[derive(Default)]
pub(crate) struct Checked {
    /// Nodes that do not match the faces: at most 100.
    pub(crate) findings: Vec<Finding>,
    /// Positions where the faces bound no solid: at most 100.
    pub(crate) defects: Vec<Defect>,
    pub(crate) counts: NodeCounts,
    /// Number of nodes with segments of their own, except the root.
    pub(crate) cut: u64,
}

/// Collects the faces of a model for comparison with its octree.
pub(crate) struct OctreeCheck {
    memory: u64,
    run: SubtreeFacesBuilder,
    words: Vec<u32>,
    near: NearFaces,
    /// Whether folded faces are defects: see [`CellBuilder`].
    finds_folds: bool,
}

impl OctreeCheck {
    /// Creates a check that takes about `memory` bytes; what exceeds them goes to temporary files.
    /// Faces are at most `reach` grid units from their proxies.
    pub(crate) fn new(memory: u64, reach: u8) -> OctreeCheck {
        let target = SpoolTarget::Directory(std::env::temp_dir());
        let run = SubtreeFacesBuilder::new((memory / 4 / 4) as usize, target);
        OctreeCheck { memory, run, words: Vec::new(), near: NearFaces::new(reach), finds_folds: true }
    }

    /// Adds a face that is planar and has an area.
    pub(crate) fn push(&mut self, face: &Face<'_>) -> Result<()> {
        self.words.clear();
        // (Files have less than 2^32 faces.)
        FaceWords::write(face.number as u32, face.points, face.ring_ends, &mut self.words);
        self.run.push(FaceWords(&self.words))
    }

    /// Notes that there is a face without area.
    pub(crate) fn note_sliver(&mut self) {
        self.finds_folds = false;
    }

    /// Adds a face with off-grid vertices. Faces are numbered in this order.
    pub(crate) fn push_exact(&mut self, face: &ExactFace) {
        self.near.push(face);
    }

    /// Compares the octree with the faces; `from` of `total` units of work were done before.
    ///
    /// # Errors
    /// If the file cannot be read or is corrupt, if the faces of one leaf do not fit into memory,
    /// or on cancellation.
    pub(crate) fn finish(
        self,
        model: &ExactModel,
        progress: &dyn Progress,
        (from, total): (u64, u64),
    ) -> Result<Checked> {
        let (run, target) = self.run.finish()?;
        let words = run.len() as u64;
        let stages = Mutex::new(Stages::default());
        let mut upper = Upper {
            model,
            near: &self.near,
            finds_folds: self.finds_folds,
            memory: self.memory,
            target,
            stages: &stages,
            progress,
            words,
            done: 0,
            units: total - from,
            total,
        };
        let mut found = Differences::default();
        let root = Cell { level: 0, position: [0; 3], winding: model.far_winding() };
        let near = self.near.of(&self.near.all(), &root, model.grid().bits);
        upper.cell(&root, &model.root()?, run, &near, &mut found)?;
        let grid = model.grid();
        let Differences { findings, arena, counts, cut } = found;
        let defects = arena.defects.list.into_iter().map(|found| found.in_world(grid)).collect();
        Ok(Checked { findings, defects, counts, cut })
    }
}

/// Differences in a subtree.
#[derive(Default)]
struct Differences {
    findings: Vec<Finding>,
    counts: NodeCounts,
    cut: u64,
    /// Collects the defects; leaves are built in it one by one.
    arena: Arena,
}

impl Differences {
    fn append(&mut self, other: Differences) {
        self.findings.extend(other.findings);
        self.findings.truncate(MAX_LISTED);
        self.counts.add(&other.counts);
        self.cut += other.cut;
        let defects: Defects = other.arena.defects;
        self.arena.defects.append(defects);
    }

    fn add(&mut self, cell: &Cell, problem: impl FnOnce() -> String) {
        if self.findings.len() < MAX_LISTED {
            let [x, y, z] = cell.position;
            let place = format!("node {x}, {y}, {z} of level {}", cell.level);
            self.findings.push(Finding { place, problem: problem() });
        }
    }
}

/// The upper cells, whose faces exceed memory.
struct Upper<'a> {
    model: &'a ExactModel,
    near: &'a NearFaces,
    finds_folds: bool,
    memory: u64,
    target: SpoolTarget,
    stages: &'a Mutex<Stages>,
    progress: &'a dyn Progress,
    /// Words of all faces, and of those that are done.
    words: u64,
    done: u64,
    /// Units of work of the faces, and in total.
    units: u64,
    total: u64,
}

impl Upper<'_> {
    fn cell(
        &mut self,
        cell: &Cell,
        node: &ModelNode<'_>,
        run: SubtreeFaces,
        near: &[u32],
        found: &mut Differences,
    ) -> Result<()> {
        let Grid { bits, .. } = *self.model.grid();
        let Upper { model, near: all_near, finds_folds, memory, stages, progress, .. } = *self;
        let needed = bytes_in_memory(&run);
        if needed <= memory / 2 {
            let length = run.len() as u64;
            let items = Items::of(run)?;
            let cell_builder = CellBuilder {
                items: &items,
                near: all_near,
                bits,
                depth: 0,
                leaf_size: 0,
                finds_folds,
                stages,
                progress,
            };
            let check = CellCheck { cell_builder, model };
            check.cell(cell, node, (0..items.len() as u32).collect(), near, found)?;
            // (Faces in several cells count once.)
            let share = |words: u64| {
                (u128::from(self.units) * u128::from(words) / u128::from(self.words.max(1))) as u64
            };
            let before = share(self.done);
            self.done = (self.done + length).min(self.words);
            progress.advance(share(self.done) - before, self.total);
            return Ok(());
        }
        if node.state() != ModelNodeState::Inner {
            return Err(Error::TooLarge {
                path: model.path().to_path_buf(),
                what: format!("checking a leaf at level {}", cell.level),
                needed,
                limit: memory / 2,
                advice: "allow more memory".into(),
            });
        }
        found.counts.inner += 1;
        let division = SpooledDivision { bits, memory, stages, progress };
        let (runs, cells, _) = division.of(cell, run, &mut self.target)?;
        for (child, (run, cell)) in runs.into_iter().zip(&cells).enumerate() {
            let child = model.child(node, child)?;
            found.cut += u64::from(child.begins_segment());
            let near = all_near.of(near, cell, bits);
            self.cell(cell, &child, run, &near, found)?;
        }
        Ok(())
    }
}

/// Cells whose faces are in memory.
struct CellCheck<'a> {
    cell_builder: CellBuilder<'a>,
    model: &'a ExactModel,
}

impl CellCheck<'_> {
    fn cell(
        &self,
        cell: &Cell,
        node: &ModelNode<'_>,
        items: Vec<u32>,
        near: &[u32],
        found: &mut Differences,
    ) -> Result<()> {
        let all = 0..items.len();
        let mut lists = Lists { items, children: Vec::new(), boxes: Vec::new() };
        self.node(cell, node, (all, near), &mut lists, found, &mut Stages::default())
    }

    fn node(
        &self,
        cell: &Cell,
        node: &ModelNode<'_>,
        (list, near): (Range<usize>, &[u32]),
        lists: &mut Lists,
        found: &mut Differences,
        stages: &mut Stages,
    ) -> Result<()> {
        let CellBuilder { items, bits, progress, .. } = self.cell_builder;
        if node.state() != ModelNodeState::Inner {
            let there = node.near();
            compare(cell, &there, near, ["exact face", "which is near it", "which is not near it"], found);
        }
        match node.state() {
            ModelNodeState::Void | ModelNodeState::Full => {
                let is_full = node.state() == ModelNodeState::Full;
                if let Some(item) = lists.items[list].first() {
                    *if is_full { &mut found.counts.full } else { &mut found.counts.void } += 1;
                    let face = items.face(*item);
                    found.add(cell, || format!("is {}, but face {face} cuts it", named(is_full)));
                    return Ok(());
                }
                let before = found.arena.counts;
                uniform(cell, bits, &mut found.arena);
                let is_inside = found.arena.counts.full > before.full;
                *if is_full { &mut found.counts.full } else { &mut found.counts.void } += 1;
                if is_full != is_inside {
                    let (is, was) = (named(is_full), named(is_inside));
                    found.add(cell, || format!("is {is}, expected {was} from the faces around it"));
                }
                Ok(())
            }
            ModelNodeState::Leaf { kind, rule, inside } => {
                found.counts.count(kind);
                let head = LeafHead { kind, rule, inside };
                self.leaf(cell, node, head, (&lists.items[list], near), &mut lists.boxes, found)
            }
            ModelNodeState::Inner => {
                found.counts.inner += 1;
                if found.counts.inner.is_multiple_of(1 << 10) {
                    progress.check()?;
                }
                if list.is_empty() {
                    return self.children(cell, node, found, &mut |cell, node, found| {
                        let near = self.cell_builder.near.of(near, cell, bits);
                        self.node(cell, node, (0..0, &near), lists, found, stages)
                    });
                }
                let end = lists.items.len();
                let is_large = list.len() > TASK;
                let (starts, cells) = self.cell_builder.divide(cell, list, lists, stages);
                let of = |child: usize| starts[child]..starts[child + 1];
                if is_large {
                    progress.check()?;
                    let children: Vec<usize> = (0..8).collect();
                    let checked = parallel::map(&children, |&child| {
                        let mut part = Differences::default();
                        let node = self.model.child(node, child)?;
                        part.cut += u64::from(node.begins_segment());
                        let list = lists.items[of(child)].to_vec();
                        let near = self.cell_builder.near.of(near, &cells[child], bits);
                        self.cell(&cells[child], &node, list, &near, &mut part).map(|()| part)
                    });
                    for part in checked {
                        found.append(part?);
                    }
                } else {
                    for (child, cell) in cells.iter().enumerate() {
                        let node = self.model.child(node, child)?;
                        found.cut += u64::from(node.begins_segment());
                        let near = self.cell_builder.near.of(near, cell, bits);
                        self.node(cell, &node, (of(child), &near), lists, found, stages)?;
                    }
                }
                lists.items.truncate(end);
                Ok(())
            }
        }
    }

    /// Visits the children of a cell that no face cuts.
    fn children(
        &self,
        cell: &Cell,
        node: &ModelNode<'_>,
        found: &mut Differences,
        each: &mut dyn FnMut(&Cell, &ModelNode<'_>, &mut Differences) -> Result<()>,
    ) -> Result<()> {
        for (child, cell) in Division::cells(cell, [0; 7]).iter().enumerate() {
            let node = self.model.child(node, child)?;
            found.cut += u64::from(node.begins_segment());
            each(cell, &node, found)?;
        }
        Ok(())
    }

    fn leaf(
        &self,
        cell: &Cell,
        node: &ModelNode<'_>,
        head: LeafHead,
        (list, near): (&[u32], &[u32]),
        boxes: &mut Vec<crate::boxes::Bounds>,
        found: &mut Differences,
    ) -> Result<()> {
        let items = self.cell_builder.items;
        let there: Vec<u32> = node.faces().map(|face| face as u32).collect();
        let expected: Vec<u32> = list.iter().map(|item| items.face(*item)).collect();
        compare(cell, &there, &expected, ["face", "which cuts it", "which does not cut it"], found);
        if list.is_empty() {
            return Ok(());
        }
        let kind = self.cell_builder.kind(list);
        self.cell_builder.leaf(cell, list, (kind, near), boxes, &mut found.arena)?;
        let Some(made) = found.arena.take_leaf() else { return Ok(()) };
        if head.kind != kind {
            found.add(cell, || format!("a leaf of kind {:?}, expected {kind:?} from its faces", head.kind));
        }
        // (In a single plane, the rules `All` and `Any` are equivalent.)
        let is_either = kind == NodeKind::Face && made.rule == LeafRule::All && head.rule == LeafRule::Any;
        if head.rule != LeafRule::Crossings && head.rule != made.rule && !is_either {
            let (is, was) = (head.rule, made.rule);
            found.add(cell, || format!("a leaf with the rule {is:?}, expected {was:?} from its faces"));
        }
        if head.inside != made.inside {
            let place = |inside: bool| if inside { "inside" } else { "outside" };
            let (is, was) = (place(head.inside), place(made.inside));
            found.add(cell, || {
                format!("a leaf whose minimum corner is {is}, expected {was} from the faces around it")
            });
        }
        Ok(())
    }
}

/// Compares the face list of a cell with the expected one; the strings describe the faces and the
/// differences.
fn compare(
    cell: &Cell,
    there: &[u32],
    expected: &[u32],
    [name, lacking, needless]: [&str; 3],
    found: &mut Differences,
) {
    let sorted = |list: &[u32]| {
        let mut list = list.to_vec();
        sort::numbers32(&mut list);
        list
    };
    let (there, expected) = (sorted(there), sorted(expected));
    if there == expected {
        return;
    }
    let lacks = |list: &[u32], face: &&u32| list.binary_search(face).is_err();
    if let Some(face) = expected.iter().find(|face| lacks(&there, face)) {
        found.add(cell, || format!("a leaf without {name} {face}, {lacking}"));
    }
    if let Some(face) = there.iter().find(|face| lacks(&expected, face)) {
        found.add(cell, || format!("a leaf with {name} {face}, {needless}"));
    }
}

fn named(is_full: bool) -> &'static str {
    if is_full { "FULL" } else { "VOID" }
}
