//! The upper cells of an octree, whose faces exceed memory: they are divided face by face.

use std::sync::Mutex;

use super::arena::Arena;
use super::cells::{Cell, CellBuilder, uniform};
use super::division::Division;
use super::items::{ITEM, Items, LargePolygons, bounds_of};
use super::near::NearFaces;
use super::spread::Spread;
use super::subtree_faces::{SpoolTarget, SubtreeFaces, SubtreeFacesBuilder, TRIANGLE_WORDS};
use crate::exact::crossing::Outline;
use crate::exact::normal::ring_normal;
use crate::geometry::{GridPolygon, Stages, Triangulator};
use crate::store::writer::ModelWriter;
use spinney_base::{Error, Progress, Result};

/// Context of the upper cells.
pub(super) struct Upper<'a> {
    pub(super) bits: u8,
    pub(super) depth: u8,
    pub(super) leaf_size: usize,
    /// As in [`CellBuilder`].
    pub(super) finds_folds: bool,
    pub(super) near: &'a mut NearFaces,
    /// Removed off-grid faces of the base.
    pub(super) near_removed: &'a NearFaces,
    pub(super) memory: u64,
    pub(super) target: SpoolTarget,
    pub(super) stages: &'a Mutex<Stages>,
    pub(super) progress: &'a dyn Progress,
    pub(super) writer: &'a mut ModelWriter,
    pub(super) done: u64,
    pub(super) total: u64,
    /// Polygons of leaves of the base that are rebuilt.
    pub(super) large: LargePolygons,
    /// Visited nodes of the base.
    pub(super) visited: u64,
}

impl Upper<'_> {
    /// Writes the complete segments.
    pub(super) fn store(&mut self, arena: &mut Arena) -> Result<()> {
        arena.segments.drain(..).try_for_each(|(code, bytes)| self.writer.segment(code, &bytes))
    }

    /// Returns the context for faces in memory.
    pub(super) fn cell_builder<'w>(&'w self, items: &'w Items) -> CellBuilder<'w> {
        let Upper { bits, depth, leaf_size, finds_folds, stages, progress, .. } = *self;
        CellBuilder { items, near: self.near, bits, depth, leaf_size, finds_folds, stages, progress }
    }

    /// Reports the words of faces that are done.
    pub(super) fn advance(&mut self, length: u64) {
        // (Faces in several cells count once.)
        let more = length.min(self.total - self.done);
        self.done += more;
        self.progress.advance(more, self.total);
    }

    /// Builds a cell from its faces, and near off-grid faces; returns the word of its node.
    pub(super) fn cell(
        &mut self,
        cell: &Cell,
        run: SubtreeFaces,
        (near, spread): (&[u32], Spread),
        out: &mut Arena,
    ) -> Result<u32> {
        if run.len() == 0 {
            let word = uniform(cell, self.bits, out);
            return Ok(out.near(word, near));
        }
        let needed = bytes_in_memory(&run);
        let fits = needed <= self.memory / 2;
        let too_large = || Error::TooLarge {
            path: self.writer.path().to_path_buf(),
            what: "building a cell that cannot be divided further".into(),
            needed,
            limit: self.memory / 2,
            advice: "allow more with --memory".into(),
        };
        if !fits && cell.level == self.depth {
            return Err(too_large());
        }
        if fits {
            let length = run.len() as u64;
            let items = Items::of(run)?;
            let cell_builder = self.cell_builder(&items);
            let word = cell_builder.cell(cell, (0..items.len() as u32).collect(), (near, spread), out)?;
            self.store(out)?;
            self.advance(length);
            return Ok(word);
        }
        let Upper { bits, memory, stages, progress, .. } = *self;
        let division = SpooledDivision { bits, memory, stages, progress };
        let (runs, cells, counts) = division.of(cell, run, &mut self.target)?;
        let Some(spread) = spread.divided(counts.0, counts.1) else { return Err(too_large()) };
        let mark = out.mark();
        let record = out.record();
        for (child, run) in runs.into_iter().enumerate() {
            let near = self.near.of(near, &cells[child], bits);
            let spread = spread.of_child(counts.1[child]);
            let word = self.cell(&cells[child], run, (&near, spread), out)?;
            out.set(record, child, word);
        }
        let word = out.complete(cell.code(), mark, record);
        self.store(out)?;
        Ok(word)
    }
}

/// Returns the bytes of a run in memory, including data derived from its faces. (That of a polygon
/// is several times as large as its words.)
pub(super) fn bytes_in_memory(run: &SubtreeFaces) -> u64 {
    run.len() as u64 * (ITEM / TRIANGLE_WORDS + 1) as u64
}

/// Face counts of a cell, and of each of its children.
pub(super) type FaceCounts = (u64, [u64; 8]);

/// Division of runs that exceed memory.
pub(super) struct SpooledDivision<'a> {
    pub(super) bits: u8,
    pub(super) memory: u64,
    pub(super) stages: &'a Mutex<Stages>,
    pub(super) progress: &'a dyn Progress,
}

impl SpooledDivision<'_> {
    /// Returns the children's faces, the children, and the face counts of the cell and the
    /// children.
    pub(super) fn of(
        &self,
        cell: &Cell,
        run: SubtreeFaces,
        at: &mut SpoolTarget,
    ) -> Result<(Vec<SubtreeFaces>, [Cell; 8], FaceCounts)> {
        let division = Division::of(cell, self.bits);
        let limit = (self.memory / 4 / 4 / 16) as usize;
        let mut builders: Vec<SubtreeFacesBuilder> =
            (0..8).map(|_| SubtreeFacesBuilder::new(limit, at.clone())).collect();
        let mut stages = Stages::default();
        let mut triangulator = Triangulator::new();
        let mut changes = [0; 7];
        let (mut count, mut counts) = (0u64, [0u64; 8]);
        run.each(|face| {
            count += 1;
            if count.is_multiple_of(1 << 12) {
                self.progress.check()?;
            }
            let (points, ring_ends);
            let corners;
            let (outline, reach, children);
            match face.triangle() {
                Some(triangle) => {
                    corners = triangle;
                    reach = division.reach(&bounds_of(&corners));
                    let normal = ring_normal(&corners);
                    children = reach.only_child(&mut stages).unwrap_or_else(|| {
                        division.children_of_triangle(reach, &corners, normal, &mut stages)
                    });
                    outline = Outline { points: &corners, ring_ends: &[3], normal };
                }
                None => {
                    (points, ring_ends) = face.rings();
                    reach = division.reach(&bounds_of(&points));
                    let wide: Vec<[i64; 3]> =
                        points.iter().map(|point| point.map(|at| 2 * i64::from(at))).collect();
                    let Ok(polygon) = GridPolygon::new(&wide, &ring_ends, &mut triangulator) else {
                        unreachable!("faces that are not polygons were rejected before: {points:?}")
                    };
                    children = reach
                        .only_child(&mut stages)
                        .unwrap_or_else(|| division.children_of_polygon(reach, &polygon, &mut stages));
                    let normal = ring_normal(&points[..ring_ends[0]]);
                    outline = Outline { points: &points, ring_ends: &ring_ends, normal };
                }
            }
            for (child, builder) in builders.iter_mut().enumerate() {
                if children >> child & 1 == 1 {
                    counts[child] += 1;
                    builder.push(face)?;
                }
            }
            division.count_changes(reach, || outline, &mut changes);
            Ok(())
        })?;
        self.stages.lock().expect("no thread panics while it holds this lock").add(&stages);
        let mut runs = Vec::with_capacity(8);
        for builder in builders {
            let (run, target) = builder.finish()?;
            // All runs share one temporary file.
            if matches!(target, SpoolTarget::Spool(_)) {
                *at = target;
            }
            runs.push(run);
        }
        Ok((runs, Division::cells(cell, changes), (count, counts)))
    }
}
