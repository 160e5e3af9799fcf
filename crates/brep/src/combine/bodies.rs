//! The faces of several operands as one list, by what an operation does with each: see the stages
//! and the table in [`combine`](super).
//!
//! - Classify: [`Bodies::new`] takes the operands and the operation table. It fills a set of fates
//!   per operand ([`Overlap`]), and finds the proxies to replace ([`Replaced`]).
//! - Input of the arrangement: [`Bodies::near`] returns the near faces on the common grid
//!   ([`Near`]), with the edges at which they meet settled faces. It also removes the base's
//!   changed faces from the result.
//! - Input of the output file: [`Bodies::keep_faces`], [`Bodies::settled`], [`Bodies::keep_exact`]
//!   and [`Bodies::settled_exact`] yield the settled faces, kept or reversed.
//!
//! | face of the octree                                | [`FaceUse`]        |
//! | ------------------------------------------------- | -------------- |
//! | proxy: near, zero area, or its source is replaced | `Replaced`     |
//! | any other face with a fate and an area            | `Settled`      |
//! | any other face (near, or zero area)               | `Arranged`     |

use std::collections::HashSet;
use std::path::Path;

use super::common_grid::CommonGrid;
use super::node_table::PairCounts;
use super::overlap::Overlap;
use super::owners::Owners;
use super::table::Fate;
use super::table::OperationTable;
use super::values::FaceValues;
use crate::arrangement::{ExactFace, ExactFaces, Seams, Turner};
use crate::build::{BaseModel, BaseRoot};
use crate::closure::SurfaceClosure;
use crate::exact::normal::ring_normal;
use crate::face_set::{FaceSet, Renumbering};
use crate::store::block::Block;
use crate::{ExactModel, Face, FaceBuffer, FaceList, Faces, ModelBuilder};
use spinney_base::{Error, Progress, Result};
use spinney_container::Tag;

/// Operands whose faces are read in sequence, as one list.
///
/// The order of calls matters: first [`Bodies::new`], then [`Bodies::settle_components`] or
/// [`Bodies::drop_untouched`], then [`Bodies::near`] once, then all others. `near` completes
/// `first` and `replaced`. Before it, [`Bodies::use_of`] would return `Settled` for proxies that
/// are replaced, and faces would have the sources of their own models. (Stages before `near` read
/// faces by number, without part, source and use.)
pub(super) struct Bodies<'a> {
    pub(super) models: &'a [&'a ExactModel],
    pub(super) common_grid: &'a CommonGrid,
    pub(super) table: OperationTable,
    pub(super) overlaps: Vec<Overlap>,
    /// Per model: the proxies that are replaced. Complete after [`Bodies::near`].
    replaced: Vec<Replaced>,
    pub(super) is_coloured: bool,
    /// Number that is added to a model's parts, and number that is added to its sources.
    ///
    /// Source numbers are 0 until [`Bodies::near`] sets them: a model's number depends on the
    /// sources of the models before it.
    pub(super) first: Vec<(u32, u64)>,
    /// The model whose octree is copied where no face changes, if any: one whose grid is a cell of
    /// the common grid. And this cell.
    pub(super) base: Option<(usize, BaseRoot)>,
    /// The rule to which parts faces of the result belong; `None` if they keep their parts.
    pub(super) owners: Option<Owners<'a>>,
}

/// The proxies of a model that are replaced, since an exact face that they represent may be
/// divided.
///
/// Files do not store the exact face of a proxy, but both have the same part and source.
///
/// Invariant: if one exact face of a part and source is near other bodies, all proxies of that part
/// and source are dropped, and new ones are made for all its exact faces. If some proxies stayed,
/// the octree's surface would overlap itself or have a hole there.
struct Replaced {
    /// Whether all proxies are replaced.
    is_all: bool,
    /// Parts and sources whose proxies are replaced.
    sources: HashSet<(u32, u64)>,
}

impl Replaced {
    fn has(&self, part: u32, source: u64) -> bool {
        self.is_all || self.sources.contains(&(part, source))
    }
}

/// Treatment of a face of an octree in an operation.
#[derive(Clone, Copy)]
pub(super) enum FaceUse {
    /// The face is far from other bodies, and its fate is known.
    Settled(Fate),
    /// The face is arranged: it is near other bodies, or it has no area and only joins edges.
    Arranged,
    /// The face is a proxy, for which new ones are made.
    Replaced,
}

/// Visitor of faces: the face, whether it is a proxy, and its use.
type FaceVisitor<'f> = dyn FnMut(&Face<'_>, bool, FaceUse) -> Result<()> + 'f;

/// Whether a face is left out, by its number, its block and its index there; the buffer may be
/// used.
type FaceFilter<'f> = dyn FnMut(u64, &Block<'_>, usize, &mut FaceBuffer) -> bool + 'f;

/// Input of the arrangement: the faces near other bodies, and what their replacement affects.
pub(super) struct Near<'a> {
    pub(super) faces: ExactFaces,
    /// End index of each model's faces.
    pub(super) ends: Vec<u32>,
    /// Edges at which faces that are arranged or replaced meet settled ones.
    pub(super) seams: Seams,
    /// Settled exact faces whose proxies are replaced, kept or reversed as in the result.
    pub(super) settled_faces: Vec<ExactFace>,
    /// The base, and which of its faces stay unchanged.
    pub(super) base: Option<BaseModel<'a>>,
}

impl<'a> Bodies<'a> {
    /// Classifies the faces of all operands: traverses all octrees.
    pub(super) fn new(
        models: &'a [&'a ExactModel],
        common_grid: &'a CommonGrid,
        (table, mut counts): (OperationTable, Option<&mut PairCounts>),
        owners: Option<Owners<'a>>,
        progress: &dyn Progress,
    ) -> Result<Bodies<'a>> {
        let (mut overlaps, mut replaced, mut is_coloured) = (Vec::new(), Vec::new(), false);
        let mut first = Vec::new();
        let mut parts = 0;
        for (number, model) in models.iter().enumerate() {
            overlaps.push(Overlap::of(
                number,
                models,
                common_grid,
                (table, counts.as_deref_mut()),
                progress,
            )?);
            // (On a finer grid, proxies would lie many grid units from their exact faces.)
            let is_all = model.has_exact_faces() && common_grid.times(number) > 1;
            replaced.push(Replaced { is_all, sources: HashSet::new() });
            is_coloured |= model.is_coloured()?;
            first.push((parts, 0));
            parts += model.parts().len() as u32;
        }
        // A model with intersecting proxies (where its surface is thinner than a grid unit) cannot
        // be the base. There, winding numbers of proxies may be other than 0 and 1, but leaves and
        // nodes near exact faces store one bit. The builder would start from that bit in changed
        // cells, and would not report the defects of copied cells again. All other uses of an
        // octree's winding numbers are safe: `ModelNode::winding` has none in such cells, since
        // each exact face is near all cells between it and its proxies. (That fails only if mending
        // lost the proxies of a component: see `on_grid`.)
        // (A base with exact faces must be on the common grid: see `BaseModel`.)
        let base_root = |number: usize| {
            let model = models[number];
            let is_reached = !model.has_exact_faces() || model.reach() == reach(models);
            let is_thin = model.metadata().tag(Tag::ModelIntersections).is_some();
            // (Faces that are copied keep their parts.)
            let keeps_parts = owners.as_ref().is_none_or(|owners| owners.keeps_parts(number, Fate::Keep));
            let root = common_grid.base_root(number)?;
            let fits = root == BaseRoot::default() || !model.has_exact_faces();
            (is_reached && !is_thin && fits && keeps_parts).then_some((number, root))
        };
        let base = (0..models.len()).filter_map(base_root).max_by_key(|(number, _)| models[*number].len());
        let mut bodies =
            Bodies { models, common_grid, table, overlaps, replaced, is_coloured, first, base, owners };
        for number in (0..models.len()).filter(|number| models[*number].has_exact_faces()) {
            bodies.settle_exact_faces(number, progress)?;
            bodies.replace_proxies(number, progress)?;
        }
        Ok(bodies)
    }

    /// Returns whether a model is the base.
    fn is_base(&self, number: usize) -> bool {
        self.base.is_some_and(|(base, _)| base == number)
    }

    /// Returns the maximum distance of any model's proxies from their exact faces, in grid units.
    pub(super) fn reach(&self) -> u8 {
        reach(self.models)
    }

    /// Records the fates of the exact faces that are far from other bodies.
    fn settle_exact_faces(&mut self, number: usize, progress: &dyn Progress) -> Result<()> {
        let mut overlap = std::mem::replace(&mut self.overlaps[number], Overlap::none());
        self.models[number].each_exact_head(&mut |index, _| {
            if index.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            if overlap.exact.of(index.into()).is_none() {
                return Ok(());
            }
            // Invariant: the other bodies' winding numbers at the common grid's point nearest to a
            // vertex are those at the vertex. The model's cell that contains the vertex lists the
            // face, and no other surface is within a common grid unit of that cell (see `Overlap`).
            // The point is at most half such a unit away from the vertex along each axis. (It may
            // be in the model's next cell: walls lie between points of the model's own grid, but
            // may contain points of a finer common grid. Any point of a cell that the face is only
            // near would not do: the face may not reach it, and another body may lie between.)
            let corner = self.models[number].exact_corner(index)?;
            let at = self.common_grid.exact_point(number, corner).rounded().map(|at| 2 * i64::from(at));
            let mut windings = Vec::with_capacity(self.models.len());
            for other in 0..self.models.len() {
                let winding = if other == number {
                    Some(0)
                } else {
                    self.common_grid.winding_at(self.models, other, at)?
                };
                windings.extend(winding);
            }
            match windings.len() == self.models.len() {
                true => overlap.exact.note(index.into(), self.table.fate(number, &windings)),
                // (In corrupt files only.)
                false => overlap.exact.set_near(index.into()),
            }
            Ok(())
        })?;
        self.overlaps[number] = overlap;
        Ok(())
    }

    /// Takes proxies off the near faces, and marks their sources as replaced.
    fn replace_proxies(&mut self, number: usize, progress: &dyn Progress) -> Result<()> {
        let near: Vec<u32> = self.overlaps[number].faces.near().collect();
        let mut buffer = FaceBuffer::default();
        for (index, face) in near.into_iter().enumerate() {
            if index.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            self.models[number].face(face.into(), &mut buffer)?;
            if buffer.is_proxy {
                self.overlaps[number].faces.unset_near(face.into());
                self.replaced[number].sources.insert((buffer.part, buffer.source));
            }
        }
        Ok(())
    }

    /// Collects the faces near other bodies. Removes the base's faces that do not stay from the
    /// builder and from the surface of the result. Records the values of all faces that may be
    /// divided. Must be called once, before faces are read with their parts, sources and uses.
    pub(super) fn near(
        &mut self,
        mut result: Option<(&mut ModelBuilder, &mut SurfaceClosure, &mut FaceValues<'_>)>,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Near<'a>> {
        let parts = self.models.iter().flat_map(|model| model.parts().iter().cloned()).collect();
        let faces = ExactFaces::of_grid(FaceList::new(self.common_grid.grid.clone(), parts));
        let mut found =
            Near { faces, ends: Vec::new(), seams: Seams::default(), settled_faces: Vec::new(), base: None };
        let (mut first_source, mut exact_bytes) = (0u64, 0u64);
        for (number, model) in self.models.iter().enumerate() {
            self.first[number].1 = first_source;
            for face in self.overlaps[number].exact.near() {
                let ExactFace { part, source, .. } = model.exact_face(face)?;
                self.replaced[number].sources.insert((part, source));
            }
            let (mut sources, mut open) = (first_source, Seams::default());
            let is_base = self.is_base(number);
            let first_part = self.first[number].0;
            let mut changed_parts = HashSet::new();
            let mut stays = [model.len(), model.exact_faces().0]
                .map(|count| FaceSet::new(if is_base { count } else { 0 }));
            let list = &mut found.faces.list;
            let [faces_stay, _] = &mut stays;
            let (mut highest, mut visited) = (None, 0);
            let notes_kept = self.owners.as_ref().is_some_and(|owners| !owners.is_plain(Fate::Keep));
            let mut is_kept = |face: u64, block: &Block<'_>, place: usize, buffer: &mut FaceBuffer| {
                let is_kept = self.is_kept(number, face, block, place, buffer);
                if is_kept {
                    highest = highest.max(Some(block.source(place)));
                    faces_stay.set(face, true);
                }
                is_kept && !notes_kept
            };
            self.each(number, &mut is_kept, progress, &mut |face, is_proxy, face_use| {
                sources = sources.max(face.source.saturating_add(1));
                if let (FaceUse::Settled(fate), Some(owners)) = (face_use, &self.owners) {
                    // (Dropped faces are on the model's own grid.)
                    let (at, part) = match fate {
                        Fate::Drop => {
                            (self.common_grid.point(number, face.points[0]), face.part + first_part)
                        }
                        _ => (face.points[0], face.part),
                    };
                    owners.note_settled(number, part, fate, at)?;
                }
                if matches!(face_use, FaceUse::Settled(Fate::Keep)) {
                    return Ok(());
                }
                // (Dropped faces have their own part and source here, which both calls ignore.
                // `sources` may stay below theirs, which no face of the result has. Their vertices
                // are on the common grid, as the base's always are.)
                if is_base {
                    let is_dropped = matches!(face_use, FaceUse::Settled(Fate::Drop));
                    changed_parts.insert(if is_dropped { face.part } else { face.part - first_part });
                }
                if let Some((builder, surface, _)) = result.as_mut().filter(|_| is_base) {
                    surface.remove(face, is_proxy);
                    builder.remove(face)?;
                }
                match face_use {
                    FaceUse::Settled(_) => return Ok(()),
                    FaceUse::Arranged => list.push(face),
                    FaceUse::Replaced => {}
                }
                open.add(face);
                if let Some((.., values)) = &mut result {
                    values.note(number, face)?;
                }
                visited += 1;
                if u64::is_multiple_of(visited, 1 << 12) {
                    let values = result.as_ref().map_or(0, |(.., values)| values.bytes());
                    self.check_memory(number, list.bytes() + open.bytes() + values + exact_bytes, memory)?;
                }
                Ok(())
            })?;
            if let Some(highest) = highest {
                sources = sources.max(first_source.saturating_add(highest).saturating_add(1));
            }
            let open_bytes = open.bytes() + result.as_ref().map_or(0, |(.., values)| values.bytes());
            found.seams.watch(open);
            let (overlap, replaced) = (&self.overlaps[number].exact, &self.replaced[number]);
            model.each_exact_head(&mut |index, head| {
                if index.is_multiple_of(1 << 8) {
                    progress.check()?;
                    let bytes = found.faces.list.bytes().saturating_add(exact_bytes) + open_bytes;
                    self.check_memory(number, bytes, memory)?;
                }
                sources = sources.max(first_source.saturating_add(head.source).saturating_add(1));
                let fate = overlap.of(index.into());
                let is_settled = fate.is_some() && !replaced.has(head.part, head.source);
                if is_settled && (!is_base || fate == Some(Fate::Keep)) {
                    stays[1].set(index.into(), true);
                    return Ok(());
                }
                changed_parts.insert(head.part);
                let face = self.exact(number, model.exact_face(index)?);
                if let Some((builder, surface, _)) = result.as_mut().filter(|_| is_base) {
                    builder.remove_exact(&face);
                    surface.remove_exact(&face);
                }
                if is_settled {
                    return Ok(());
                }
                exact_bytes += face.bytes();
                match fate {
                    None => found.faces.push(face),
                    Some(fate) => found.settled_faces.extend(self.settled_face(number, face, fate)?),
                }
                Ok(())
            })?;
            if let Some((_, root)) = self.base.filter(|_| is_base) {
                let [faces, exact] = stays.map(Renumbering::of);
                let part_numbers = Vec::new();
                found.base = Some(BaseModel { model, root, faces, exact, part_numbers, changed_parts });
            }
            self.check_memory(number, found.faces.list.bytes().saturating_add(exact_bytes), memory)?;
            first_source = sources;
            found.ends.push(found.faces.list.len() as u32);
        }
        Ok(found)
    }

    /// Yields the settled faces of the octrees that are kept or reversed: the model's number, the
    /// face, and whether it is a proxy. Leaves out the base's unchanged ones if `keeps_base`.
    pub(super) fn settled(
        &self,
        keeps_base: bool,
        progress: &dyn Progress,
        each: &mut dyn FnMut(usize, &Face<'_>, bool) -> Result<()>,
    ) -> Result<()> {
        let mut turner = Turner::default();
        for number in 0..self.models.len() {
            let is_kept = keeps_base && self.is_base(number);
            if is_kept && !self.overlaps[number].faces.are_some_turned() {
                continue;
            }
            let mut all = |_: u64, _: &Block<'_>, _: usize, _: &mut FaceBuffer| false;
            self.each(number, &mut all, progress, &mut |face, is_proxy, face_use| match face_use {
                FaceUse::Settled(Fate::Keep) if !is_kept => {
                    each(number, &self.with_part(number, face, Fate::Keep)?, is_proxy)
                }
                FaceUse::Settled(Fate::Reverse) => {
                    let face = self.with_part(number, face, Fate::Reverse)?;
                    each(number, &turner.turn(&face), is_proxy)
                }
                _ => Ok(()),
            })?;
        }
        Ok(())
    }

    /// Yields the settled exact faces, kept or reversed, whose proxies are not replaced. Leaves out
    /// the base's unchanged ones if `keeps_base`.
    pub(super) fn settled_exact(
        &self,
        keeps_base: bool,
        progress: &dyn Progress,
        each: &mut dyn FnMut(ExactFace) -> Result<()>,
    ) -> Result<()> {
        for number in 0..self.models.len() {
            let (model, is_kept) = (self.models[number], keeps_base && self.is_base(number));
            let (overlap, replaced) = (&self.overlaps[number].exact, &self.replaced[number]);
            model.each_exact_head(&mut |index, head| {
                if index.is_multiple_of(1 << 10) {
                    progress.check()?;
                }
                let fate = overlap.of(index.into()).filter(|_| !replaced.has(head.part, head.source));
                match fate {
                    None | Some(Fate::Drop) => Ok(()),
                    Some(Fate::Keep) if is_kept => Ok(()),
                    Some(fate) => {
                        let face = self.exact(number, model.exact_face(index)?);
                        self.settled_face(number, face, fate)?.map_or(Ok(()), &mut *each)
                    }
                }
            })?;
        }
        Ok(())
    }

    /// Moves an exact face of a model to the common grid, with the result's part and source
    /// numbers: see the order of calls in [`Bodies`].
    pub(super) fn exact(&self, number: usize, mut face: ExactFace) -> ExactFace {
        let (first_part, first_source) = self.first[number];
        if self.is_coloured && face.colours.is_empty() {
            face.colours = vec![[255; 3]; face.corners.len()];
        }
        let part = face.part.saturating_add(first_part);
        let source = face.source.saturating_add(first_source);
        ExactFace { part, source, ..self.common_grid.exact(number, face) }
    }

    /// Returns the part of a settled face in the result, from its own part; `at` is a point of it.
    fn part_of(&self, number: usize, part: u32, fate: Fate, at: [i32; 3]) -> Result<u32> {
        self.owners.as_ref().map_or(Ok(part), |owners| owners.of_settled(number, part, fate, at))
    }

    /// Returns a settled face on the common grid with its part in the result.
    fn with_part<'f>(&self, number: usize, face: &Face<'f>, fate: Fate) -> Result<Face<'f>> {
        Ok(Face { part: self.part_of(number, face.part, fate, face.points[0])?, ..*face })
    }

    /// Applies a fate to an exact face on the common grid; `None` if it is dropped.
    fn settled_face(&self, number: usize, face: ExactFace, fate: Fate) -> Result<Option<ExactFace>> {
        if fate == Fate::Drop {
            return Ok(None);
        }
        let part = self.part_of(number, face.part, fate, first_vertex(&face))?;
        let face = ExactFace { part, ..face };
        Ok(Some(if fate == Fate::Reverse { face.turned() } else { face }))
    }

    /// Returns the use of a face of a model's octree: see the order of calls in [`Bodies`].
    pub(super) fn use_of(&self, number: usize, face: &Face<'_>, is_proxy: bool) -> FaceUse {
        let (fate, replaced) = (self.overlaps[number].faces.of(face.number), &self.replaced[number]);
        // (A face without area is in no cell, so that its recorded fate is meaningless.)
        match (is_proxy, fate) {
            (true, None) => FaceUse::Replaced,
            (true, _) if replaced.has(face.part, face.source) || !has_area(face) => FaceUse::Replaced,
            (_, Some(fate)) if has_area(face) => FaceUse::Settled(fate),
            _ => FaceUse::Arranged,
        }
    }

    /// Returns whether a face of a model's octree is settled and kept: the same as
    /// [`Bodies::use_of`], from its block.
    fn is_kept(
        &self,
        number: usize,
        face: u64,
        block: &Block<'_>,
        place: usize,
        buffer: &mut FaceBuffer,
    ) -> bool {
        if self.overlaps[number].faces.of(face) != Some(Fate::Keep)
            || (block.is_proxy(place) && self.replaced[number].has(block.part(place), block.source(place)))
        {
            return false;
        }
        if let Some(triangle) = block.triangle(place) {
            return ring_normal(&triangle) != [0; 3];
        }
        block.read(place, buffer);
        has_area(&buffer.face())
    }

    /// Yields the faces of a model's octree, but those for which `is_left_out`, on the common grid,
    /// with the result's part and source numbers, `is_proxy` and the use of each. Dropped faces are
    /// yielded with the model's own numbers and colours, and on its own grid unless it is the base.
    fn each(
        &self,
        number: usize,
        is_left_out: &mut FaceFilter<'_>,
        progress: &dyn Progress,
        each: &mut FaceVisitor<'_>,
    ) -> Result<()> {
        let model = self.models[number];
        let (first_part, first_source) = self.first[number];
        let (mut points, mut white) = (Vec::new(), Vec::new());
        let mut buffer = FaceBuffer::default();
        model.each_block(&mut |first, block| {
            progress.check()?;
            for place in 0..block.len() {
                if is_left_out(first + place as u64, block, place, &mut buffer) {
                    continue;
                }
                block.read(place, &mut buffer);
                let (face, is_proxy) = (buffer.face(), buffer.is_proxy);
                let face_use = self.use_of(number, &face, is_proxy);
                let is_dropped = matches!(face_use, FaceUse::Settled(Fate::Drop));
                if is_dropped && !self.is_base(number) {
                    each(&face, is_proxy, face_use)?;
                    continue;
                }
                self.put(number, face.number, face.points, &mut points)?;
                if is_dropped {
                    each(&Face { points: &points, ..face }, is_proxy, face_use)?;
                    continue;
                }
                white.resize(if self.is_coloured { points.len() } else { 0 }, [255; 3]);
                let colours = if face.colours.is_empty() { &white[..] } else { face.colours };
                let (part, source) =
                    (face.part.saturating_add(first_part), face.source.saturating_add(first_source));
                each(&Face { points: &points, colours, part, source, ..face }, is_proxy, face_use)?;
            }
            Ok(())
        })
    }

    /// Moves a face's vertices to the common grid.
    pub(super) fn put(
        &self,
        number: usize,
        face: u64,
        corners: &[[i32; 3]],
        points: &mut Vec<[i32; 3]>,
    ) -> Result<()> {
        points.clear();
        points.extend(corners.iter().map(|point| self.common_grid.point(number, *point)));
        match points.iter().flatten().any(|at| (*at as u32) >> self.common_grid.grid.bits != 0) {
            true => Err(not_in_the_octree(self.models[number].path(), face)),
            false => Ok(()),
        }
    }

    /// Fails if `needed` bytes, for the faces of this model and those before it, exceed `memory`.
    pub(super) fn check_memory(&self, number: usize, needed: u64, memory: u64) -> Result<()> {
        if needed <= memory {
            return Ok(());
        }
        Err(Error::TooLarge {
            path: self.models[number].path().to_path_buf(),
            what: "holding the faces near other models".into(),
            needed,
            limit: memory,
            advice: "allow more with --memory".into(),
        })
    }
}

/// Maximum distance of the models' proxies from their exact faces, in grid units; at least 1.
fn reach(models: &[&ExactModel]) -> u8 {
    models.iter().map(|model| model.reach()).fold(1, u8::max)
}

/// Whether a face has an area.
fn has_area(face: &Face<'_>) -> bool {
    ring_normal(face.rings().next().unwrap_or_default()) != [0; 3]
}

/// Returns the grid point nearest to the first vertex of a face.
fn first_vertex(face: &ExactFace) -> [i32; 3] {
    face.corners[0].point.rounded()
}

/// Returns the error for a face with vertices outside of the octree.
fn not_in_the_octree(path: &Path, face: u64) -> Error {
    let found = format!("face {face}, which extends beyond the octree");
    Error::corrupt(path, "faces", found, "faces within the octree")
}
