//! The faces of several operands as one list, by what an operation does with each: see the stages
//! and the table in [`combine`](super).
//!
//! - Classify: [`Bodies::new`] takes the operands and the operation table. It fills a set of fates
//!   per operand ([`Overlap`]), and finds the proxies to replace ([`Replaced`]).
//! - Input of the arrangement: [`Bodies::near`] returns the near faces on the common grid
//!   ([`Near`]), with the edges at which they meet settled faces. It also removes the base's
//!   changed faces from the result.
//! - Input of the output file: [`Bodies::settled`], [`Bodies::keep_exact`] and
//!   [`Bodies::settled_exact`] yield the settled faces, kept or reversed.
//!
//! | face of the octree                                | [`Use`]        |
//! | ------------------------------------------------- | -------------- |
//! | proxy: near, zero area, or its source is replaced | `Replaced`     |
//! | any other face with a fate and an area            | `Settled`      |
//! | any other face (near, or zero area)               | `Arranged`     |

use std::collections::HashSet;
use std::path::Path;

use super::overlap::Overlap;
use super::placed::{Placed, unlike_grids};
use super::table::Fate;
use super::table::OperationTable;
use super::values::FaceValues;
use crate::arrangement::{ExactFace, ExactFaces, Seams, Turner};
use crate::build::BaseModel;
use crate::closure::SurfaceClosure;
use crate::exact::normal::ring_normal;
use crate::face_set::{FaceSet, Renumbering};
use crate::{ExactModel, Face, FaceList, Faces, ModelBuilder};
use spinney_base::{Error, Progress, Result, SetOperation};
use spinney_container::Tag;

/// Operands whose faces are read in sequence, as one list.
pub(super) struct Bodies<'a> {
    pub(super) models: &'a [&'a ExactModel],
    pub(super) placed: &'a Placed,
    pub(super) table: OperationTable,
    pub(super) overlaps: Vec<Overlap>,
    /// Per model: the proxies that are replaced.
    replaced: Vec<Replaced>,
    is_coloured: bool,
    /// First part number and first source number of each model.
    first: Vec<(u32, u64)>,
    /// The model whose octree is copied where no face changes: one with the common grid, if any.
    base: Option<usize>,
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
pub(super) enum Use {
    /// The face is far from other bodies, and its fate is known.
    Settled(Fate),
    /// The face is arranged: it is near other bodies, or it has no area and only joins edges.
    Arranged,
    /// The face is a proxy, for which new ones are made.
    Replaced,
}

/// Visitor of faces: the face, whether it is a proxy, and its use.
type FaceVisitor<'f> = dyn FnMut(&Face<'_>, bool, Use) -> Result<()> + 'f;

/// Input of the arrangement: the faces near other bodies, and what their replacement affects.
pub(super) struct Near<'a> {
    pub(super) faces: ExactFaces,
    /// End index of each model's faces.
    pub(super) ends: Vec<u32>,
    /// Edges at which faces that are arranged or replaced meet settled ones.
    pub(super) seams: Seams,
    /// Settled exact faces whose proxies are replaced, kept or reversed as in the result.
    pub(super) beside: Vec<ExactFace>,
    /// The base, and which of its faces stay unchanged.
    pub(super) base: Option<BaseModel<'a>>,
}

impl<'a> Bodies<'a> {
    /// Classifies the faces of all operands: traverses all octrees.
    pub(super) fn new(
        models: &'a [&'a ExactModel],
        placed: &'a Placed,
        table: OperationTable,
        progress: &dyn Progress,
    ) -> Result<Bodies<'a>> {
        let (mut overlaps, mut replaced, mut is_coloured) = (Vec::new(), Vec::new(), false);
        let mut first = Vec::new();
        let mut parts = 0;
        for (number, model) in models.iter().enumerate() {
            overlaps.push(Overlap::of(number, models, placed, table, progress)?);
            // (On a finer grid, proxies would lie many grid units from their exact faces.)
            let is_all = model.is_beside_grid() && placed.times(number) > 1;
            replaced.push(Replaced { is_all, sources: HashSet::new() });
            is_coloured |= model.is_coloured()?;
            first.push((parts, 0));
            parts += model.parts().len() as u32;
        }
        // Where a surface is thinner than a grid unit, its octree's winding numbers are unreliable.
        let is_base = |number: &usize| {
            let model = models[*number];
            let is_reached = !model.is_beside_grid() || model.reach() == reach(models);
            let is_thin = model.metadata().tag(Tag::ModelThinPlaces).is_some();
            *model.grid() == placed.grid && is_reached && !is_thin
        };
        let base = (0..models.len()).filter(is_base).max_by_key(|number| models[*number].len());
        let mut bodies = Bodies { models, placed, table, overlaps, replaced, is_coloured, first, base };
        for number in (0..models.len()).filter(|number| models[*number].is_beside_grid()) {
            bodies.settle_exact_faces(number, progress)?;
            bodies.replace_stand_ins(number, progress)?;
        }
        Ok(bodies)
    }

    /// Returns the maximum distance of any model's proxies from their exact faces, in grid units.
    pub(super) fn reach(&self) -> u8 {
        reach(self.models)
    }

    /// Records the fates of the exact faces that are far from other bodies.
    fn settle_exact_faces(&mut self, number: usize, progress: &dyn Progress) -> Result<()> {
        let mut overlap = std::mem::replace(&mut self.overlaps[number], Overlap::none());
        self.models[number].each_exact_head(&mut |index, head| {
            if index.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            if overlap.exact.of(index.into()).is_none() {
                return Ok(());
            }
            // Invariant: the grid point nearest to a vertex is in the same cell as the vertex,
            // since cell walls lie between grid points. So this cell is one of the face's cells,
            // which are all far from the others' surfaces. (A cell that the face is only near would
            // not do: the face may not reach it, and another body may lie between.)
            let at = self.placed.exact_point(number, head.corner).rounded().map(|at| 2 * i64::from(at));
            let mut places = Vec::with_capacity(self.models.len());
            for other in 0..self.models.len() {
                let place =
                    if other == number { Some(0) } else { self.placed.winding_at(self.models, other, at)? };
                places.extend(place);
            }
            match places.len() == self.models.len() {
                true => overlap.exact.note(index.into(), self.table.fate(number, &places)),
                // (In corrupt files only.)
                false => overlap.exact.set_near(index.into()),
            }
            Ok(())
        })?;
        self.overlaps[number] = overlap;
        Ok(())
    }

    /// Takes proxies off the near faces, and marks their sources as replaced.
    fn replace_stand_ins(&mut self, number: usize, progress: &dyn Progress) -> Result<()> {
        let near: Vec<u32> = self.overlaps[number].faces.near().collect();
        let mut buffer = crate::FaceBuffer::default();
        for (index, face) in near.into_iter().enumerate() {
            if index.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            self.models[number].face(face.into(), &mut buffer)?;
            if buffer.is_proxy {
                self.overlaps[number].faces.settle(face.into(), Fate::Kept);
                self.replaced[number].sources.insert((buffer.part, buffer.source));
            }
        }
        Ok(())
    }

    /// Collects the faces near other bodies. Removes the base's faces that do not stay from the
    /// builder and from the surface of the result. Records the values of all faces that may be
    /// divided.
    pub(super) fn near(
        &mut self,
        mut result: Option<(&mut ModelBuilder, &mut SurfaceClosure, &mut FaceValues<'_>)>,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Near<'a>> {
        let parts = self.models.iter().flat_map(|model| model.parts().iter().cloned()).collect();
        let faces = ExactFaces::of_grid(FaceList::new(self.placed.grid.clone(), parts));
        let mut found =
            Near { faces, ends: Vec::new(), seams: Seams::default(), beside: Vec::new(), base: None };
        let (mut first_source, mut exact_bytes) = (0u64, 0u64);
        for (number, model) in self.models.iter().enumerate() {
            self.first[number].1 = first_source;
            for face in self.overlaps[number].exact.near() {
                let ExactFace { part, source, .. } = model.exact_face(face)?;
                self.replaced[number].sources.insert((part, source));
            }
            let (mut sources, mut open) = (first_source, Seams::default());
            let is_base = self.base == Some(number);
            let mut stays = [model.len(), model.exact_faces().0]
                .map(|count| FaceSet::new(if is_base { count } else { 0 }));
            let list = &mut found.faces.list;
            self.each(number, progress, &mut |face, is_proxy, becomes| {
                sources = sources.max(face.source.saturating_add(1));
                if matches!(becomes, Use::Settled(Fate::Kept)) {
                    stays[0].set(face.number, true);
                    return Ok(());
                }
                if let Some((builder, surface, _)) = result.as_mut().filter(|_| is_base) {
                    surface.remove(face, is_proxy);
                    builder.remove(face)?;
                }
                match becomes {
                    Use::Settled(_) => return Ok(()),
                    Use::Arranged => list.push(face),
                    Use::Replaced => {}
                }
                open.add(face);
                if let Some((.., values)) = &mut result {
                    values.note(number, face)?;
                }
                if face.number.is_multiple_of(1 << 12) {
                    let values = result.as_ref().map_or(0, |(.., values)| values.bytes());
                    self.check_room(number, list.bytes() + open.bytes() + values + exact_bytes, memory)?;
                }
                Ok(())
            })?;
            let open_bytes = open.bytes() + result.as_ref().map_or(0, |(.., values)| values.bytes());
            found.seams.watch(open);
            let (overlap, replaced) = (&self.overlaps[number].exact, &self.replaced[number]);
            model.each_exact_head(&mut |index, head| {
                if index.is_multiple_of(1 << 8) {
                    progress.check()?;
                    let bytes = found.faces.list.bytes().saturating_add(exact_bytes) + open_bytes;
                    self.check_room(number, bytes, memory)?;
                }
                sources = sources.max(first_source.saturating_add(head.source).saturating_add(1));
                let fate = overlap.of(index.into());
                let is_settled = fate.is_some() && !replaced.has(head.part, head.source);
                if is_settled && (!is_base || fate == Some(Fate::Kept)) {
                    stays[1].set(index.into(), true);
                    return Ok(());
                }
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
                    Some(fate) => found.beside.extend(settled(face, fate)),
                }
                Ok(())
            })?;
            if is_base {
                let [faces, exact] = stays.map(Renumbering::of);
                found.base = Some(BaseModel { model, faces, exact });
            }
            self.check_room(number, found.faces.list.bytes().saturating_add(exact_bytes), memory)?;
            first_source = sources;
            found.ends.push(found.faces.list.len() as u32);
        }
        Ok(found)
    }

    /// Yields the settled faces of the octrees that are kept or reversed: the model's number, the
    /// face, whether it is a proxy, and whether it is a face of the base that stays unchanged.
    ///
    /// Invariant: the base's unchanged faces come first, in the order of their numbers, so that
    /// they get the numbers of [`Renumbering`]. Otherwise copied leaves would list other faces.
    pub(super) fn settled(
        &self,
        progress: &dyn Progress,
        each: &mut dyn FnMut(usize, &Face<'_>, bool, bool) -> Result<()>,
    ) -> Result<()> {
        if let Some(base) = self.base {
            self.each(base, progress, &mut |face, is_proxy, becomes| match becomes {
                Use::Settled(Fate::Kept) => each(base, face, is_proxy, true),
                _ => Ok(()),
            })?;
        }
        let mut turner = Turner::default();
        for number in 0..self.models.len() {
            let is_base = self.base == Some(number);
            if is_base && !self.overlaps[number].faces.are_some_turned() {
                continue;
            }
            self.each(number, progress, &mut |face, is_proxy, becomes| match becomes {
                Use::Settled(Fate::Kept) if !is_base => each(number, face, is_proxy, false),
                Use::Settled(Fate::Turned) => each(number, &turner.turn(face), is_proxy, false),
                _ => Ok(()),
            })?;
        }
        Ok(())
    }

    /// Adds the base's unchanged exact faces. Copies a block as a whole if all its faces stay.
    pub(super) fn keep_exact(
        &self,
        base: &BaseModel<'_>,
        builder: &mut ModelBuilder,
        progress: &dyn Progress,
    ) -> Result<()> {
        let Some(number) = self.base else { return Ok(()) };
        let last_part = base.model.parts().len().saturating_sub(1) as u32;
        base.model.each_exact_block(&mut |first, block| {
            progress.check()?;
            let stays = |place: &usize| base.exact.number(first + *place as u64).is_some();
            if self.first[number] == (0, 0)
                && block.is_coloured() == self.is_coloured
                && (0..block.len()).all(|place| stays(&place))
            {
                return builder.push_kept_exact(block, last_part);
            }
            (0..block.len()).filter(stays).try_for_each(|place| {
                let face = base.model.exact_face((first + place as u64) as u32)?;
                builder.push_exact(self.exact(number, face))
            })
        })
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
            let (model, is_kept) = (self.models[number], keeps_base && self.base == Some(number));
            let (overlap, replaced) = (&self.overlaps[number].exact, &self.replaced[number]);
            model.each_exact_head(&mut |index, head| {
                if index.is_multiple_of(1 << 10) {
                    progress.check()?;
                }
                let fate = overlap.of(index.into()).filter(|_| !replaced.has(head.part, head.source));
                match fate {
                    None | Some(Fate::Dropped) => Ok(()),
                    Some(Fate::Kept) if is_kept => Ok(()),
                    Some(fate) => {
                        let face = self.exact(number, model.exact_face(index)?);
                        settled(face, fate).map_or(Ok(()), &mut *each)
                    }
                }
            })?;
        }
        Ok(())
    }

    /// Moves an exact face of a model to the common grid, with the result's part and source
    /// numbers.
    fn exact(&self, number: usize, mut face: ExactFace) -> ExactFace {
        let (first_part, first_source) = self.first[number];
        if self.is_coloured && face.colours.is_empty() {
            face.colours = vec![[255; 3]; face.corners.len()];
        }
        let part = face.part.saturating_add(first_part);
        let source = face.source.saturating_add(first_source);
        ExactFace { part, source, ..self.placed.exact(number, face) }
    }

    /// Returns the use of a face of a model's octree.
    pub(super) fn becomes(&self, number: usize, face: &Face<'_>, is_proxy: bool) -> Use {
        let (fate, replaced) = (self.overlaps[number].faces.of(face.number), &self.replaced[number]);
        // (A face without area is in no cell, so that its recorded fate is meaningless.)
        match (is_proxy, fate) {
            (true, None) => Use::Replaced,
            (true, _) if replaced.has(face.part, face.source) || !has_area(face) => Use::Replaced,
            (_, Some(fate)) if has_area(face) => Use::Settled(fate),
            _ => Use::Arranged,
        }
    }

    /// Yields the faces of a model's octree on the common grid, with `is_proxy` and the use of
    /// each. Dropped faces are yielded on the model's own grid.
    fn each(&self, number: usize, progress: &dyn Progress, each: &mut FaceVisitor<'_>) -> Result<()> {
        let model = self.models[number];
        let (first_part, first_source) = self.first[number];
        let (mut points, mut white) = (Vec::new(), Vec::new());
        model.each_face(&mut |face, is_proxy| {
            if face.number.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            let becomes = self.becomes(number, face, is_proxy);
            if matches!(becomes, Use::Settled(Fate::Dropped)) {
                return each(face, is_proxy, becomes);
            }
            self.put(number, face.number, face.points, &mut points)?;
            white.resize(if self.is_coloured { points.len() } else { 0 }, [255; 3]);
            let colours = if face.colours.is_empty() { &white[..] } else { face.colours };
            let (part, source) =
                (face.part.saturating_add(first_part), face.source.saturating_add(first_source));
            each(&Face { points: &points, colours, part, source, ..*face }, is_proxy, becomes)
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
        points.extend(corners.iter().map(|point| self.placed.point(number, *point)));
        match points.iter().flatten().any(|at| (*at as u32) >> self.placed.grid.bits != 0) {
            true => Err(not_in_the_octree(self.models[number].path(), face)),
            false => Ok(()),
        }
    }

    /// Fails if `needed` bytes, for the faces of this model and those before it, exceed `memory`.
    pub(super) fn check_room(&self, number: usize, needed: u64, memory: u64) -> Result<()> {
        if needed <= memory {
            return Ok(());
        }
        Err(Error::TooLarge {
            path: self.models[number].path().to_path_buf(),
            what: "the faces of the models where these come near each other".into(),
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

/// Applies a fate to an exact face; `None` if it is dropped.
fn settled(face: ExactFace, fate: Fate) -> Option<ExactFace> {
    match fate {
        Fate::Kept => Some(face),
        Fate::Turned => Some(face.turned()),
        Fate::Dropped => None,
    }
}

/// Bytes of a face with its plane and box.
const FACE: u64 = 400;

/// Faces of two models near each other's surfaces, on one grid. If they are too many for the
/// memory, only those whose boxes touch a face of the other model.
pub(crate) struct NearFaces {
    pub faces: ExactFaces,
    /// End index of each model's faces.
    pub ends: Vec<u32>,
    /// Offset that was added to the sources of each model's faces.
    pub(crate) first_sources: [u64; 2],
}

impl NearFaces {
    /// Traverses both octrees together, and reads the faces.
    ///
    /// # Errors
    /// If grids, coordinate systems or units are incompatible, if `memory` bytes are insufficient,
    /// if files are corrupt or cannot be read, or on cancellation.
    pub(crate) fn of(models: [&ExactModel; 2], memory: u64, progress: &dyn Progress) -> Result<NearFaces> {
        let placed = Placed::of(&models)?.ok_or_else(|| unlike_grids(&models))?;
        // (Any operation would do: being near does not depend on it.)
        let mut bodies =
            Bodies::new(&models, &placed, OperationTable::new(SetOperation::Intersection, 2)?, progress)?;
        let near: usize = (0..2).map(|body| bodies.near_of(body).len()).sum();
        if near as u64 * FACE > memory {
            bodies.drop_apart(memory, progress)?;
        }
        let Near { faces, ends, .. } = bodies.near(None, memory, progress)?;
        Ok(NearFaces { faces, ends, first_sources: [0, bodies.first[1].1] })
    }
}

/// Returns the error for a face with vertices outside of the octree.
fn not_in_the_octree(path: &Path, face: u64) -> Error {
    let found = format!("face {face} with corners beyond those of all cells");
    Error::corrupt(path, "faces", found, "faces that are in the octree")
}
