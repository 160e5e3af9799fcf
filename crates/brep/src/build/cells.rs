//! The octree over faces in memory: cells are divided until the planes of their faces share a
//! point.

use std::ops::Range;
use std::sync::Mutex;

use super::arena::Arena;
use super::defects::{DefectKind, GridDefect};
use super::division::{Division, each_bit};
use super::equal_faces::EqualFaces;
use super::items::{Items, bounds_of};
use super::near::NearFaces;
use super::pairs::{Contact, Shared, contact, folded_edges, passes, twin};
use super::spread::Spread;
use super::thin::Conflict;
use crate::boxes::{Bounds, BoxTree, touch};
use crate::exact::crossing::FinePoint;
use crate::exact::rank::rank_of_at_most;
use crate::face_triangle::FaceTriangle;
use crate::geometry::Stages;
use crate::store::segment::{CUT, FULL, INNER, LeafHead, LeafRule, NodeKind, VOID};
use spinney_base::parallel;
use spinney_base::sort;
use spinney_base::space::{Code, Dimension};
use spinney_base::{Progress, Result};

/// A cell of the octree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub(super) level: u8,
    pub(super) position: [u32; 3],
    /// Winding number of the surface around its minimum corner, perturbed: see
    /// [`crate::exact::crossing`].
    pub(super) winding: i32,
}

impl Cell {
    /// Returns the minimum coordinates in half units of the grid, and the width.
    pub(super) fn bounds(&self, bits: u8) -> ([i64; 3], i64) {
        let width = 2i64 << (bits - self.level);
        (self.position.map(|at| i64::from(at) * width - 1), width)
    }

    pub(super) fn child(&self, child: usize, winding: i32) -> Cell {
        let position = std::array::from_fn(|axis| 2 * self.position[axis] + (child >> axis & 1) as u32);
        Cell { level: self.level + 1, position, winding }
    }

    pub(super) fn code(&self) -> Code {
        Code::from_cell(Dimension::Oct, self.level, self.position).expect("a cell of the tree")
    }
}

/// Lists of the faces of cells that are being divided, each after that of the parent cell, and work
/// buffers.
pub(super) struct Lists {
    pub(super) items: Vec<u32>,
    /// Children that each face of a cell cuts, as bits.
    pub(super) children: Vec<u8>,
    pub(super) boxes: Vec<Bounds>,
}

/// Bounds of a leaf's faces, clipped to its cell or a slightly larger box.
struct Near<'a> {
    boxes: &'a [Bounds],
    /// Present for many faces: any number of faces may be in one plane.
    tree: Option<BoxTree>,
    equal: EqualFaces,
    /// Whether off-grid faces are near, whose proxies some of the faces may be.
    has_proxies: bool,
}

impl Near<'_> {
    fn tree(boxes: &[Bounds]) -> Option<BoxTree> {
        /// For fewer boxes, a tree takes longer.
        const MIN_TREE_BOXES: usize = 64;
        let numbered = || (0..).zip(boxes.iter().copied()).collect();
        (boxes.len() > MIN_TREE_BOXES).then(|| BoxTree::of(numbered()))
    }

    /// Visits the indices, from `first` on, of all boxes that pass a test. A box that contains a
    /// passing box must pass, too.
    #[inline]
    fn each(&self, first: usize, meets: &impl Fn(&Bounds) -> bool, mut each: impl FnMut(usize)) {
        match &self.tree {
            None => {
                for (index, bounds) in self.boxes.iter().enumerate().skip(first) {
                    if meets(bounds) {
                        each(index);
                    }
                }
            }
            Some(tree) => tree.each(meets, |index| {
                if index as usize >= first {
                    each(index as usize);
                }
            }),
        }
    }
}

/// Maximum number of faces of a cell that does not get its own task.
pub(super) const TASK: usize = 2048;

/// Number of faces above which dividing a cell checks for cancellation: a bundle of long thin faces
/// is in very many cells almost completely.
const WATCHED: usize = 64;

/// Context shared by all cells of a model.
pub(super) struct CellBuilder<'a> {
    pub(super) items: &'a Items,
    /// Faces with off-grid vertices.
    pub(super) near: &'a NearFaces,
    pub(super) bits: u8,
    pub(super) depth: u8,
    /// Maximum number of faces of a cell that is not divided.
    pub(super) leaf_size: usize,
    /// Whether faces that are folded onto each other are defects. They are none if the model has
    /// faces without area: these may join their common edge to other faces, such as where walls
    /// between bodies touch.
    pub(super) finds_folds: bool,
    pub(super) stages: &'a Mutex<Stages>,
    pub(super) progress: &'a dyn Progress,
}

impl CellBuilder<'_> {
    /// Builds a cell from its faces, and near off-grid faces; returns the word of its node.
    pub(super) fn cell(
        &self,
        cell: &Cell,
        items: Vec<u32>,
        (near, spread): (&[u32], Spread),
        out: &mut Arena,
    ) -> Result<u32> {
        let mut stages = Stages::default();
        let all = 0..items.len();
        let mut lists = Lists { items, children: Vec::new(), boxes: Vec::new() };
        let word = self.node(cell, all, (near, spread), &mut lists, out, &mut stages);
        self.stages.lock().expect("no thread panics while it holds this lock").add(&stages);
        word
    }

    /// Builds a cell whose faces are a range of the last list.
    fn node(
        &self,
        cell: &Cell,
        list: Range<usize>,
        (near, spread): (&[u32], Spread),
        lists: &mut Lists,
        out: &mut Arena,
        stages: &mut Stages,
    ) -> Result<u32> {
        if list.is_empty() {
            let word = uniform(cell, self.bits, out);
            return Ok(out.near(word, near));
        }
        if let Some(kind) = self.end(cell, &lists.items[list.clone()]) {
            return self.leaf(cell, &lists.items[list], (kind, near), &mut lists.boxes, out);
        }
        let end = lists.items.len();
        let is_large = list.len() > TASK;
        if list.len() > WATCHED {
            self.progress.check()?;
        }
        let (starts, cells) = self.divide(cell, list.clone(), lists, stages);
        let of = |child: usize| starts[child]..starts[child + 1];
        let counts = std::array::from_fn(|child| of(child).len() as u64);
        let Some(spread) = spread.divided(list.len() as u64, counts) else {
            lists.items.truncate(end);
            return self.leaf(cell, &lists.items[list], (NodeKind::Boolean, near), &mut lists.boxes, out);
        };
        let mark = out.mark();
        let record = out.record();
        if is_large {
            let children: Vec<usize> = (0..8).collect();
            let built = parallel::map(&children, |child| {
                let mut arena = Arena::default();
                let list = lists.items[of(*child)].to_vec();
                let near = self.near.of(near, &cells[*child], self.bits);
                let spread = spread.of_child(counts[*child]);
                self.cell(&cells[*child], list, (&near, spread), &mut arena).map(|word| (arena, word))
            });
            for (child, built) in built.into_iter().enumerate() {
                let (arena, word) = built?;
                let word = out.append(arena, word);
                out.set(record, child, word);
            }
        } else {
            for (child, cell) in cells.iter().enumerate() {
                let near = self.near.of(near, cell, self.bits);
                let spread = spread.of_child(counts[child]);
                let word = self.node(cell, of(child), (&near, spread), lists, out, stages)?;
                out.set(record, child, word);
            }
        }
        // Invariant: the lists after that of a cell that is being divided are those of its
        // descendants: each cell removes its own. So a list does not move while its subtree is
        // built.
        lists.items.truncate(end);
        Ok(out.complete(cell.code(), mark, record))
    }

    /// Appends the lists of a cell's children. Returns their bounds in `lists.items`, and the
    /// children.
    pub(super) fn divide(
        &self,
        cell: &Cell,
        list: Range<usize>,
        lists: &mut Lists,
        stages: &mut Stages,
    ) -> ([usize; 9], [Cell; 8]) {
        let Lists { items, children, .. } = lists;
        let division = Division::of(cell, self.bits);
        let mut changes = [0; 7];
        let mut counts = [0; 8];
        children.clear();
        for &item in &items[list.clone()] {
            let reach = division.reach(self.items.bounds(item));
            let of_item = self.items.children(item, reach, &division, stages);
            children.push(of_item);
            each_bit(of_item, |child| counts[child] += 1);
            division.count_changes(reach, || self.items.outline(item), &mut changes);
        }
        let mut starts = [items.len(); 9];
        for child in 0..8 {
            starts[child + 1] = starts[child] + counts[child];
        }
        items.resize(starts[8], 0);
        let mut next = starts;
        for (index, of_item) in list.zip(children) {
            let item = items[index];
            each_bit(*of_item, |child| {
                items[next[child]] = item;
                next[child] += 1;
            });
        }
        (starts, Division::cells(cell, changes))
    }

    /// Returns the kind of a cell that is a leaf, or `None` if the cell is to be divided.
    fn end(&self, cell: &Cell, list: &[u32]) -> Option<NodeKind> {
        let kind = self.kind(list);
        (kind != NodeKind::Boolean || list.len() <= self.leaf_size || cell.level == self.depth)
            .then_some(kind)
    }

    /// Classifies what the planes of some faces share.
    pub(super) fn kind(&self, list: &[u32]) -> NodeKind {
        match self.rank(list) {
            0 | 1 => NodeKind::Face,
            2 => NodeKind::Edge,
            3 => NodeKind::Vertex,
            _ => NodeKind::Boolean,
        }
    }

    fn rank(&self, list: &[u32]) -> usize {
        if list.len() < 2 {
            return list.len();
        }
        // A vertex that all faces share decides most cases, and is found quickly.
        let is_common = |corner: &[i32; 3]| list.iter().all(|item| self.items.points(*item).contains(corner));
        let most = match list.len() {
            few @ ..4 => few,
            _ if self.items.points(list[0]).iter().take(4).any(is_common) => 3,
            _ => 4,
        };
        rank_of_at_most(list.iter().map(|item| self.items.plane(*item)), most)
    }

    pub(super) fn leaf(
        &self,
        cell: &Cell,
        list: &[u32],
        (kind, near_faces): (NodeKind, &[u32]),
        boxes: &mut Vec<Bounds>,
        out: &mut Arena,
    ) -> Result<u32> {
        // Bounds of the faces, clipped to the cell or a slightly larger box.
        let (min, width) = cell.bounds(self.bits);
        let (least, most) =
            (min.map(|at| at.div_euclid(2) as i32), min.map(|at| ((at + width + 1) / 2) as i32));
        boxes.clear();
        boxes.extend(list.iter().map(|item| {
            let [low, high] = *self.items.bounds(*item);
            [
                [0, 1, 2].map(|axis| low[axis].max(least[axis])),
                [0, 1, 2].map(|axis| high[axis].min(most[axis])),
            ]
        }));
        let near = Near {
            boxes,
            tree: Near::tree(boxes),
            equal: EqualFaces::of(self.items, list),
            has_proxies: !near_faces.is_empty(),
        };
        self.check_pairs(cell, list, &near, out)?;
        self.check_windings(cell, list, &near, out)?;
        let mut rule = self.rule(list);
        let inside = cell.winding == 1;
        if rule != LeafRule::Crossings || !(0..=1).contains(&cell.winding) {
            let corner = FinePoint { at: min, bits: 1 };
            let mut is_inner = list.iter().map(|item| self.items.outline(*item).side_of_moved(&corner) < 0);
            let expected = match rule {
                LeafRule::All => is_inner.all(|is_inner| is_inner),
                LeafRule::Any => is_inner.any(|is_inner| is_inner),
                LeafRule::Crossings => false,
            };
            if i32::from(expected) != cell.winding {
                // Inside of the faces, the winding number is one more than outside.
                let more = cell.winding - i32::from(expected);
                rule = LeafRule::Crossings;
                let number = if more > 0 { more + 1 } else { more };
                let faces = list.iter().take(2).map(|item| self.items.face(*item)).collect();
                out.defects.push(GridDefect::winding(number, min.map(|at| at as f64 / 2.0), faces));
            }
        }
        let faces = list.iter().map(|item| self.items.face(*item));
        Ok(out.leaf(LeafHead { kind, rule, inside }, faces, near_faces))
    }

    /// Finds faces that intersect or overlap each other.
    fn check_pairs(&self, cell: &Cell, list: &[u32], near: &Near<'_>, out: &mut Arena) -> Result<()> {
        let (min, width) = cell.bounds(self.bits);
        let owns = |point: [i32; 3]| {
            (0..3).all(|axis| (0..width).contains(&(2 * i64::from(point[axis]) - min[axis])))
        };
        let mut others = Vec::new();
        for (index, &one) in list.iter().enumerate() {
            if out.defects.are_enough() {
                break;
            }
            if index & 0x1f == 0x1f {
                self.progress.check()?;
            }
            if let Some(first) = near.equal.before(index) {
                // Invariant: a face that equals an earlier one has the same contacts, which the
                // earlier one's pairs report; its own defect is the overlap with that face. Exactly
                // one cell contains its sample, so it is counted once.
                if self.sample_in(cell, one).is_some() {
                    let conflict = Conflict { kind: DefectKind::Overlap, is_thin: false };
                    out.defects.push(self.defect(conflict, [list[first], one]));
                }
                continue;
            }
            let [low, high] = near.boxes[index];
            others.clear();
            // (Without a branch per axis.)
            let is_disjoint = |axis: usize, [other_low, other_high]: &Bounds| {
                (other_low[axis] > high[axis]) | (low[axis] > other_high[axis])
            };
            let touches =
                |other: &Bounds| !(is_disjoint(0, other) | is_disjoint(1, other) | is_disjoint(2, other));
            near.each(index + 1, &touches, |other| others.push(other));
            for &other_index in &others {
                if near.equal.before(other_index).is_some() {
                    continue;
                }
                let other = list[other_index];
                let within = [near.boxes[index], near.boxes[other_index]];
                let found = self.conflict([one, other], within, list, owns);
                // (Off-grid faces that are thinner than a grid unit have folded proxies.)
                if let Some(conflict) = found
                    .filter(|found| found.kind != DefectKind::Fold || (self.finds_folds && !near.has_proxies))
                {
                    out.defects.push(self.defect(conflict, [one, other]));
                }
            }
        }
        Ok(())
    }

    /// Returns a defect of two faces, at the centre of their bounds' intersection.
    fn defect(&self, Conflict { kind, is_thin }: Conflict, pair: [u32; 2]) -> GridDefect {
        let [[low, high], [other_low, other_high]] = pair.map(|item| *self.items.bounds(item));
        let at = [0, 1, 2].map(|axis| {
            let (low, high) = (low[axis].max(other_low[axis]), high[axis].min(other_high[axis]));
            (f64::from(low) + f64::from(high)) / 2.0
        });
        let mut faces = pair.map(|item| self.items.face(item)).to_vec();
        sort::numbers32(&mut faces);
        GridDefect { kind, at, faces, is_thin: Some(is_thin) }
    }

    /// Returns the sample of a face if it is in a cell.
    // Invariant: a sample is not on a wall, so exactly one cell contains it, and a face is checked
    // once.
    fn sample_in(&self, cell: &Cell, item: u32) -> Option<FinePoint> {
        let (min, width) = cell.bounds(self.bits);
        let sample = self.items.sample(item);
        let shift = sample.bits - 1;
        (0..3).all(|axis| (0..width).contains(&((sample.at[axis] >> shift) - min[axis]))).then_some(sample)
    }

    /// Returns the defect between two faces of a cell, if any; `within` are the bounds of each face
    /// in the cell.
    fn conflict(
        &self,
        [one, other]: [u32; 2],
        within: [Bounds; 2],
        list: &[u32],
        owns: impl Fn([i32; 3]) -> bool,
    ) -> Option<Conflict> {
        let [firsts, seconds] = [one, other].map(|item| self.items.triangles(item));
        if firsts.len() == 1 && seconds.len() == 1 {
            return self.conflict_of_triangles(firsts, seconds, list, owns);
        }
        // For many triangles: those that reach the bounds of both faces.
        // Invariant: the criterion of a pair is in the cell and in both faces' bounds there: a
        // common vertex or a point where they meet. So no pair is skipped that no other cell tests.
        let near = |triangles: &[FaceTriangle]| -> Vec<FaceTriangle> {
            let is_near = |triangle: &&FaceTriangle| {
                let bounds = bounds_of(&triangle.corners);
                within.iter().all(|within| touch(&bounds, within))
            };
            triangles.iter().filter(is_near).copied().collect()
        };
        self.conflict_of_triangles(&near(firsts), &near(seconds), list, owns)
    }

    /// Returns the defect between triangles of two faces of a cell.
    fn conflict_of_triangles(
        &self,
        firsts: &[FaceTriangle],
        seconds: &[FaceTriangle],
        list: &[u32],
        owns: impl Fn([i32; 3]) -> bool,
    ) -> Option<Conflict> {
        let mut fold = None;
        for a in firsts {
            for b in seconds {
                // Invariant: every pair of triangles that may intersect is tested in some cell that
                // has everything to decide it. A pair with a common vertex is tested only in the
                // cell of that vertex, which also has the faces around it. A pair without one is
                // tested in each cell that both triangles cut. (Triangles with two common vertices
                // in different cells can only overlap, which winding numbers detect.) If a pair was
                // missed, an invalid body would be written to a file.
                let conflict = |kind| Conflict::of(kind, [a, b]);
                let shared = Shared::of(&a.corners, &b.corners);
                if shared.are_several() && fold.is_none() {
                    fold = self.is_folded([a, b], list, &owns).then(|| conflict(DefectKind::Fold));
                }
                if !shared.all(&b.corners, &owns) {
                    continue;
                }
                match contact(a, b, shared) {
                    Contact::Fine => {}
                    Contact::Wrong(kind) => return Some(conflict(kind)),
                    Contact::Edges { through, across } => {
                        let owner = if a.has_edge(across) { a } else { b };
                        // The face on the other side of the edge is in the cell in which they meet.
                        let turned = [across[1], across[0]];
                        let triangles = list.iter().flat_map(|item| self.items.triangles(*item));
                        let twins = triangles
                            .filter(|triangle| triangle.has_edge(turned))
                            .map(|triangle| &triangle.corners);
                        let twin = twin(&owner.corners, across, twins);
                        if twin.is_some_and(|twin| passes(through, &owner.corners, twin)) {
                            return Some(conflict(DefectKind::Crossing));
                        }
                    }
                }
            }
        }
        fold
    }

    /// Returns whether two triangles are folded flat at a common edge without other faces. One cell
    /// decides: that of the edge's smaller end, which has all faces of the edge.
    fn is_folded(&self, [a, b]: [&FaceTriangle; 2], list: &[u32], owns: impl Fn([i32; 3]) -> bool) -> bool {
        folded_edges(a, b).filter(|[from, to]| owns(*from.min(to))).any(|[from, to]| {
            let triangles = list.iter().flat_map(|item| self.items.triangles(*item));
            let meets = |triangle: &&FaceTriangle| triangle.bounds([from, to]) || triangle.bounds([to, from]);
            triangles.filter(meets).take(3).count() == 2
        })
    }

    /// Checks both sides of each face whose sample is in the cell: the front should be outside and
    /// the back inside. Where faces of touching bodies coincide, both sides may be outside, or both
    /// inside.
    fn check_windings(&self, cell: &Cell, list: &[u32], near: &Near<'_>, out: &mut Arena) -> Result<()> {
        let (min, _) = cell.bounds(self.bits);
        for (index, &item) in list.iter().enumerate() {
            if out.defects.are_enough() {
                break;
            }
            if index & 0x1f == 0x1f {
                self.progress.check()?;
            }
            let Some(sample) = self.sample_in(cell, item).filter(|_| near.equal.before(index).is_none())
            else {
                continue;
            };
            let shift = sample.bits - 1;
            let corner = FinePoint { at: min.map(|at| at << shift), bits: sample.bits };
            // The grid points around each coordinate.
            let around = |at: i64| [(at >> sample.bits) as i32, -(-at >> sample.bits) as i32];
            let (start, end) = (corner.at.map(around), sample.at.map(around));
            let normal = self.items.plane(item).normal.map(i128::from);
            let mut winding = cell.winding;
            let mut beyond = 0;
            let mut is_alone = true;
            // The path leads along x, then y, then z, and reaches few faces.
            let reached = |[low, high]: &Bounds| {
                let spans = |axis: usize, at: &[[i32; 2]; 3]| {
                    (low[axis] <= at[axis][0]) & (at[axis][1] <= high[axis])
                };
                let (from_z, to_x, to_y) = (spans(2, &start), spans(0, &end), spans(1, &end));
                [from_z & spans(1, &start), from_z & to_x, to_x & to_y, to_x & to_y & spans(2, &end)]
            };
            near.each(0, &|bounds| reached(bounds) != [false; 4], |other| {
                let is_reached = reached(&near.boxes[other]);
                let outline = self.items.outline(list[other]);
                let mut at = corner;
                for (axis, is_reached) in is_reached.into_iter().take(3).enumerate() {
                    if is_reached {
                        winding += outline.change_along(axis, &at, sample.at[axis]);
                    }
                    at.at[axis] = sample.at[axis];
                }
                if !is_reached[3] || outline.side(&sample) != 0 {
                    return;
                }
                let n = outline.normal.map(i128::from);
                let is_in_plane =
                    (0..3).all(|axis| n[axis] * normal[(axis + 1) % 3] == n[(axis + 1) % 3] * normal[axis]);
                if !is_in_plane {
                    is_alone &= !outline.has(&sample);
                } else if outline.has_moved(&sample) {
                    beyond += outline.side_of_moved(&sample);
                }
            });
            // Where another body's edge touches the face, the sides depend on the distance from the
            // face.
            if !is_alone {
                continue;
            }
            let other_side = winding + beyond;
            if let Some(wrong) = [winding, other_side].into_iter().find(|winding| !(0..=1).contains(winding))
            {
                let at = sample.at.map(|at| at as f64 / (1 << sample.bits) as f64);
                out.defects.push(GridDefect::winding(wrong, at, vec![self.items.face(item)]));
            }
        }
        Ok(())
    }

    /// Returns how the planes of a few faces define the inside. If every face is in or on the inner
    /// side of every other face's plane, the body in the cell is the intersection of the inner
    /// half-spaces. If every face is on the outer side, the same holds for its complement.
    fn rule(&self, list: &[u32]) -> LeafRule {
        /// For more faces, the analysis would take longer than it saves.
        const FEW: usize = 4;
        if list.len() > FEW {
            return LeafRule::Crossings;
        }
        let (mut all, mut any) = (true, true);
        for &plane in list {
            let outline = self.items.outline(plane);
            for &other in list.iter().filter(|other| **other != plane) {
                let mut in_plane = true;
                for point in self.items.points(other) {
                    let side = outline.side(&FinePoint { at: point.map(i64::from), bits: 0 });
                    all &= side <= 0;
                    any &= side >= 0;
                    in_plane &= side == 0;
                }
                let turned = || {
                    let (a, b) = (self.items.plane(plane).normal, self.items.plane(other).normal);
                    (0..3).any(|axis| a[axis].signum() * b[axis].signum() < 0)
                };
                if !(all || any) || (in_plane && turned()) {
                    return LeafRule::Crossings;
                }
            }
        }
        if all { LeafRule::All } else { LeafRule::Any }
    }
}

/// Returns the word of a cell that no face cuts.
pub(super) fn uniform(cell: &Cell, bits: u8, out: &mut Arena) -> u32 {
    if !(0..=1).contains(&cell.winding) {
        let (min, width) = cell.bounds(bits);
        let at = min.map(|min| (min + width / 2) as f64 / 2.0);
        out.defects.push(GridDefect::winding(cell.winding, at, Vec::new()));
    }
    if cell.winding > 0 {
        out.counts.full += 1;
        return FULL;
    }
    out.counts.void += 1;
    VOID
}

const _: () = assert!(VOID == 0 && FULL == 1 && INNER == 2 && CUT == 3);
