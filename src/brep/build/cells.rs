//! The octree over faces in memory: cells are divided until the planes of their faces have a point in common.

use std::sync::Mutex;

use super::arena::Arena;
use super::defects::{DefectKind, Found};
use super::items::Items;
use super::pairs::{Contact, contact, passes};
use crate::brep::piece::Piece;
use crate::brep::store::segment::{CUT, FULL, INNER, LeafHead, NodeKind, Rule, VOID};
use crate::geometry::crossing::{FinePoint, change_between};
use crate::geometry::rank::{HomogeneousPlane, rank, rank_of_at_most};
use crate::geometry::{Intersection, Stage, Stages};
use crate::parallel;
use crate::space::{Code, Dimension};
use crate::{Progress, Result};

/// A cell of the octree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub(super) level: u8,
    pub(super) position: [u32; 3],
    /// Winding number of the surface around its least corner, moved a little: see [`crate::geometry::crossing`].
    pub(super) winding: i32,
}

impl Cell {
    /// Least coordinates in half units of the grid, and width.
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

/// The ways from the least corner of a cell's first child to those of the others: child from, child to, axis. Each begins
/// where one before it has ended.
pub(super) const WAYS: [(usize, usize, usize); 7] =
    [(0, 4, 2), (0, 2, 1), (4, 6, 1), (0, 1, 0), (2, 3, 0), (4, 5, 0), (6, 7, 0)];

/// Corners of the children, and the middle of a cell: what a cell is divided with.
pub(super) struct Division {
    pub(super) min: [i64; 3],
    pub(super) half: i64,
}

impl Division {
    pub(super) fn of(cell: &Cell, bits: u8) -> Division {
        let (min, width) = cell.bounds(bits);
        Division { min, half: width / 2 }
    }

    /// The least corner of a child.
    pub(super) fn corner(&self, child: usize) -> [i64; 3] {
        std::array::from_fn(|axis| self.min[axis] + if child >> axis & 1 == 1 { self.half } else { 0 })
    }

    /// Whether a box in grid units reaches into the lower and the upper half along each axis.
    #[inline]
    pub(super) fn halves(&self, [low, high]: &[[i32; 3]; 2]) -> [[bool; 2]; 3] {
        std::array::from_fn(|axis| {
            let (low, high) = (2 * i64::from(low[axis]), 2 * i64::from(high[axis]));
            let (min, middle) = (self.min[axis], self.min[axis] + self.half);
            [low < middle && high > min, high > middle && low < middle + self.half]
        })
    }

    /// Which children a face cuts that cuts the cell, as bits; `cuts` tests one child.
    #[inline]
    pub(super) fn children(
        &self,
        bounds: &[[i32; 3]; 2],
        stages: &mut Stages,
        mut cuts: impl FnMut([i64; 3], [i64; 3]) -> Intersection,
    ) -> u8 {
        let halves = self.halves(bounds);
        // In one half along each axis: what cuts the cell cuts that child, untested.
        let alone = halves.iter().all(|[low, high]| !(low & high));
        let mut children = 0;
        for child in 0..8 {
            let found = if (0..3).any(|axis| !halves[axis][child >> axis & 1]) {
                Intersection { cuts: false, stage: Stage::Boxes }
            } else if alone {
                Intersection { cuts: true, stage: Stage::Boxes }
            } else {
                let low = self.corner(child);
                cuts(low, low.map(|low| low + self.half))
            };
            stages.count(found);
            children |= u8::from(found.cuts) << child;
        }
        children
    }

    /// The ways that may meet a box in grid units, as bits.
    #[inline]
    pub(super) fn ways(&self, [low, high]: &[[i32; 3]; 2]) -> u8 {
        // Where the box spans the coordinate of the lower and of the upper corners.
        let spans: [[bool; 2]; 3] = std::array::from_fn(|axis| {
            let (low, high) = (2 * i64::from(low[axis]), 2 * i64::from(high[axis]));
            [0, 1].map(|upper| {
                let at = self.min[axis] + upper * self.half;
                low <= at && at <= high
            })
        });
        let mut ways = 0;
        for (way, (from, _, along)) in WAYS.into_iter().enumerate() {
            let met = (0..3).all(|axis| axis == along || spans[axis][from >> axis & 1]);
            ways |= u8::from(met) << way;
        }
        ways
    }
}

/// Faces below which cells are not worth a task of their own.
const TASK: usize = 2048;

/// Context of all cells of a model.
pub(super) struct Walk<'a> {
    pub(super) items: &'a Items,
    pub(super) bits: u8,
    pub(super) depth: u8,
    /// Cells with at most so many faces are not divided.
    pub(super) boolean_faces: usize,
    pub(super) stages: &'a Mutex<Stages>,
    pub(super) progress: &'a dyn Progress,
}

impl Walk<'_> {
    /// Builds a cell; returns the word of its node.
    pub(super) fn cell(&self, cell: &Cell, list: &[u32], out: &mut Arena) -> Result<u32> {
        let mut stages = Stages::default();
        let word = self.node(cell, list, out, &mut stages);
        self.stages.lock().expect("nobody panics with this lock").add(&stages);
        word
    }

    fn node(&self, cell: &Cell, list: &[u32], out: &mut Arena, stages: &mut Stages) -> Result<u32> {
        if list.is_empty() {
            return Ok(uniform(cell, self.bits, out));
        }
        if let Some(kind) = self.end(cell, list) {
            return self.leaf(cell, list, kind, out);
        }
        let mark = out.mark();
        let record = out.record();
        let (lists, cells) = self.divide(cell, list, stages);
        if list.len() > TASK {
            self.progress.check()?;
            let children: Vec<usize> = (0..8).collect();
            let built = parallel::map(&children, |child| {
                let mut arena = Arena::default();
                self.cell(&cells[*child], &lists[*child], &mut arena).map(|word| (arena, word))
            });
            for (child, built) in built.into_iter().enumerate() {
                let (arena, word) = built?;
                let word = out.append(arena, word);
                out.set(record, child, word);
            }
        } else {
            for child in 0..8 {
                let word = self.node(&cells[child], &lists[child], out, stages)?;
                out.set(record, child, word);
            }
        }
        Ok(out.complete(cell.code(), mark, record))
    }

    /// The faces of a cell's children, and the children.
    fn divide(&self, cell: &Cell, list: &[u32], stages: &mut Stages) -> ([Vec<u32>; 8], [Cell; 8]) {
        let division = Division::of(cell, self.bits);
        let mut lists: [Vec<u32>; 8] = Default::default();
        let mut changes = [0; 7];
        for &item in list {
            let bounds = self.items.bounds(item);
            let children = division.children(bounds, stages, |min, max| self.items.cuts(item, min, max));
            for (child, list) in lists.iter_mut().enumerate() {
                if children >> child & 1 == 1 {
                    list.push(item);
                }
            }
            let ways = division.ways(bounds);
            if ways != 0 {
                let outline = self.items.outline(item);
                for (way, change) in changes.iter_mut().enumerate() {
                    if ways >> way & 1 == 1 {
                        let (from, to, axis) = WAYS[way];
                        let start = FinePoint { at: division.corner(from), bits: 1 };
                        *change += outline.change_along(axis, &start, division.corner(to)[axis]);
                    }
                }
            }
        }
        (lists, children_of(cell, changes))
    }

    /// The kind of the leaf that a cell is; `None` if it is to be divided.
    fn end(&self, cell: &Cell, list: &[u32]) -> Option<NodeKind> {
        let rank = self.rank(list);
        let kind = match rank {
            0 | 1 => NodeKind::Face,
            2 => NodeKind::Edge,
            3 => NodeKind::Vertex,
            _ => NodeKind::Boolean,
        };
        (rank < 4 || list.len() <= self.boolean_faces || cell.level == self.depth).then_some(kind)
    }

    fn rank(&self, list: &[u32]) -> usize {
        if let [one] = list {
            return usize::from(*one != u32::MAX);
        }
        if let [one, other] = list {
            let (a, b) = (self.items.plane(*one), self.items.plane(*other));
            return if are_one(a, b) { 1 } else { 2 };
        }
        let planes = list.iter().map(|item| self.items.plane(*item));
        // A corner that all have in common says most, and is quickly found.
        let is_common = |corner: &[i32; 3]| list.iter().all(|item| self.items.points(*item).contains(corner));
        let most = if self.items.points(list[0]).iter().take(4).any(is_common) { 3 } else { 4 };
        rank_of_at_most(planes, most)
    }

    fn leaf(&self, cell: &Cell, list: &[u32], kind: NodeKind, out: &mut Arena) -> Result<u32> {
        self.check_pairs(cell, list, out)?;
        self.check_windings(cell, list, out);
        let rule = self.rule(list);
        let inside = cell.winding == 1;
        if rule != Rule::Crossings || !(0..=1).contains(&cell.winding) {
            let (min, _) = cell.bounds(self.bits);
            let corner = FinePoint { at: min, bits: 1 };
            let mut behind = list.iter().map(|item| self.items.outline(*item).side_of_moved(&corner) < 0);
            let expected = match rule {
                Rule::All => behind.all(|behind| behind),
                Rule::Any => behind.any(|behind| behind),
                Rule::Crossings => false,
            };
            if i32::from(expected) != cell.winding {
                // What is behind is one more than what is in front.
                let more = cell.winding - i32::from(expected);
                out.defects.push(Found {
                    kind: DefectKind::Winding(if more > 0 { more + 1 } else { more }),
                    at: min.map(|at| at as f64 / 2.0),
                    faces: list.iter().take(2).map(|item| self.items.face(*item)).collect(),
                });
            }
        }
        let faces = list.iter().map(|item| self.items.face(*item));
        Ok(out.leaf(LeafHead { kind, rule, inside }, faces))
    }

    /// Looks for faces that pass through each other or lie on each other.
    fn check_pairs(&self, cell: &Cell, list: &[u32], out: &mut Arena) -> Result<()> {
        let (min, width) = cell.bounds(self.bits);
        let owns = |point: [i32; 3]| {
            (0..3).all(|axis| (0..width).contains(&(2 * i64::from(point[axis]) - min[axis])))
        };
        for (index, &one) in list.iter().enumerate() {
            if index & 0xff == 0xff {
                self.progress.check()?;
            }
            let [low, high] = *self.items.bounds(one);
            for &other in &list[index + 1..] {
                let [other_low, other_high] = *self.items.bounds(other);
                if (0..3).any(|axis| other_low[axis] > high[axis] || low[axis] > other_high[axis]) {
                    continue;
                }
                if let Some(kind) = self.conflict(one, other, list, owns) {
                    let at = [0, 1, 2].map(|axis| {
                        let (low, high) = (low[axis].max(other_low[axis]), high[axis].min(other_high[axis]));
                        (f64::from(low) + f64::from(high)) / 2.0
                    });
                    let mut faces = vec![self.items.face(one), self.items.face(other)];
                    faces.sort_unstable();
                    out.defects.push(Found { kind, at, faces });
                }
            }
        }
        Ok(())
    }

    /// The defect between two faces of a cell, if there is one.
    fn conflict(
        &self,
        one: u32,
        other: u32,
        list: &[u32],
        owns: impl Fn([i32; 3]) -> bool,
    ) -> Option<DefectKind> {
        for a in self.items.triangles(one) {
            for b in self.items.triangles(other) {
                // What crosses at a common corner does so in the cell that has the corner, too.
                if a.corners.iter().any(|corner| b.corners.contains(corner) && !owns(*corner)) {
                    continue;
                }
                match contact(a, b) {
                    Contact::Fine => {}
                    Contact::Wrong(kind) => return Some(kind),
                    Contact::Edges { through, across } => {
                        let owner = if has_edge(a, across) { a } else { b };
                        // The face at the other side of the edge is in the cell in which they meet.
                        let turned = [across[1], across[0]];
                        let pieces = list.iter().flat_map(|item| self.items.triangles(*item));
                        let mut twins = pieces.filter(|piece| has_edge(piece, turned));
                        if twins.any(|twin| passes(through, &owner.corners, &twin.corners)) {
                            return Some(DefectKind::Crossing);
                        }
                    }
                }
            }
        }
        None
    }

    /// Looks at both sides of each face that has its sample in the cell: outside should be in front, and inside
    /// behind; or, where faces of bodies that touch lie on each other, the one or the other on both sides.
    fn check_windings(&self, cell: &Cell, list: &[u32], out: &mut Arena) {
        let (min, width) = cell.bounds(self.bits);
        for &item in list {
            let Some(sample) = self.items.sample(item) else { continue };
            let shift = sample.bits - 1;
            if (0..3).any(|axis| !(0..width).contains(&((sample.at[axis] >> shift) - min[axis]))) {
                continue;
            }
            let corner = FinePoint { at: min.map(|at| at << shift), bits: sample.bits };
            let mut winding = cell.winding;
            let mut beyond = 0;
            for &other in list {
                let outline = self.items.outline(other);
                winding += change_between(&outline, &corner, &sample);
                if outline.has(&sample) {
                    beyond += outline.side_of_moved(&sample);
                }
            }
            let other_side = winding + beyond;
            if let Some(wrong) = [winding, other_side].into_iter().find(|winding| !(0..=1).contains(winding))
            {
                out.defects.push(Found {
                    kind: DefectKind::Winding(wrong),
                    at: sample.at.map(|at| at as f64 / (1 << sample.bits) as f64),
                    faces: vec![self.items.face(item)],
                });
            }
        }
    }

    /// How the planes of a few faces tell what is inside. Where all faces lie behind or in all planes, the body's
    /// boundary in the cell is that of what is behind all, and the body is; the same of its complement where they
    /// lie in front.
    fn rule(&self, list: &[u32]) -> Rule {
        /// Looking at more faces would take longer than it saves.
        const FEW: usize = 4;
        if list.len() > FEW {
            return Rule::Crossings;
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
                    return Rule::Crossings;
                }
            }
        }
        if all { Rule::All } else { Rule::Any }
    }
}

/// Whether a triangle has an edge in this direction.
fn has_edge(piece: &Piece, edge: [[i32; 3]; 2]) -> bool {
    let [a, b, c] = piece.corners;
    [[a, b], [b, c], [c, a]].contains(&edge)
}

/// Whether two planes are the same.
fn are_one(a: &HomogeneousPlane, b: &HomogeneousPlane) -> bool {
    rank([a, b].into_iter()) == 1
}

/// The children of a cell whose corners differ in their winding numbers by these changes on the ways between them.
pub(super) fn children_of(cell: &Cell, changes: [i32; 7]) -> [Cell; 8] {
    let mut windings = [cell.winding; 8];
    for (way, (from, to, _)) in WAYS.into_iter().enumerate() {
        windings[to] = windings[from] + changes[way];
    }
    std::array::from_fn(|child| cell.child(child, windings[child]))
}

/// The word of a cell that no face cuts.
pub(super) fn uniform(cell: &Cell, bits: u8, out: &mut Arena) -> u32 {
    match cell.winding {
        0 => {
            out.counts.void += 1;
            VOID
        }
        winding => {
            if winding != 1 {
                let (min, width) = cell.bounds(bits);
                let at = min.map(|min| (min + width / 2) as f64 / 2.0);
                out.defects.push(Found { kind: DefectKind::Winding(winding), at, faces: Vec::new() });
            }
            out.counts.full += 1;
            FULL
        }
    }
}

const _: () = assert!(VOID == 0 && FULL == 1 && INNER == 2 && CUT == 3);
