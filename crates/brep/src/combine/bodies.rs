//! The faces of several models, as those of one.

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

/// Models whose faces are read one after the other, as those of one.
pub(super) struct Bodies<'a> {
    pub(super) models: &'a [&'a ExactModel],
    pub(super) placed: &'a Placed,
    pub(super) table: OperationTable,
    pub(super) overlaps: Vec<Overlap>,
    /// Of each model, the faces that stand in for others and are made anew.
    replaced: Vec<Replaced>,
    is_coloured: bool,
    /// Numbers of each model's first part and first source.
    first: Vec<(u32, u64)>,
    /// The model whose octree is taken over where no face changes, if there is one that has the common grid.
    base: Option<usize>,
}

/// The faces of a model that stand in for others and are made anew, since some of those that they stand in for may be divided.
///
/// Files do not tell which faces stand in for which; but they are of the same part and source.
///
/// Invariant: where one exact face of a part and source is near other bodies, all faces that stand in for any of these go, and new ones
/// are made for all of these. If some stayed, places would be covered twice in the octree, or not at all, and it would be open there.
struct Replaced {
    /// Whether all are.
    is_all: bool,
    /// Parts and sources of those that are.
    sources: HashSet<(u32, u64)>,
}

impl Replaced {
    fn has(&self, part: u32, source: u64) -> bool {
        self.is_all || self.sources.contains(&(part, source))
    }
}

/// Uses that an operation makes of a face.
#[derive(Clone, Copy)]
pub(super) enum Use {
    /// It is far from other bodies.
    Settled(Fate),
    /// It is near other bodies, or has no area and joins edges: it goes into the arrangement.
    Arranged,
    /// It stands in for others, for which new faces will.
    Replaced,
}

/// Takes a face, whether it stands in for others, and what becomes of it.
type FaceVisitor<'f> = dyn FnMut(&Face<'_>, bool, Use) -> Result<()> + 'f;

/// Faces that are near other bodies, and what belongs to them.
pub(super) struct Near<'a> {
    pub(super) faces: ExactFaces,
    /// Where those of each model end.
    pub(super) ends: Vec<u32>,
    /// The edges at which the faces that are divided or made anew meet those that are not.
    pub(super) seams: Seams,
    /// Faces with corners beside the grid that are not near, as they are in the result, but for which new faces will stand in.
    pub(super) beside: Vec<ExactFace>,
    /// The base, and those of its faces that stay as they are.
    pub(super) base: Option<BaseModel<'a>>,
}

impl<'a> Bodies<'a> {
    /// Goes through all octrees.
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
            // (On a finer grid they would lie many steps beside what they stand in for.)
            let is_all = model.is_beside_grid() && placed.times(number) > 1;
            replaced.push(Replaced { is_all, sources: HashSet::new() });
            is_coloured |= model.is_coloured()?;
            first.push((parts, 0));
            parts += model.parts().len() as u32;
        }
        // Where its surface is thinner than a step, cells do not tell what winding numbers are.
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

    /// Steps that faces of any model lie at most beside those that they stand in for.
    pub(super) fn reach(&self) -> u8 {
        reach(self.models)
    }

    /// Notes the fates of the faces with corners beside the grid that are far from other bodies.
    fn settle_exact_faces(&mut self, number: usize, progress: &dyn Progress) -> Result<()> {
        let mut overlap = std::mem::replace(&mut self.overlaps[number], Overlap::none());
        self.models[number].each_exact_head(&mut |index, head| {
            if index.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            if overlap.exact.of(index.into()).is_none() {
                return Ok(());
            }
            // Invariant: the cell that has the grid's point nearest to a corner has the corner, too, since walls lie between
            // the points; and so it is one of the face's cells, which are all far from the others' surfaces. (That a
            // face is near a cell says less: it need not get there, and other bodies may be between.)
            let at = self.placed.exact_point(number, head.corner).rounded().map(|at| 2 * i64::from(at));
            let mut places = Vec::with_capacity(self.models.len());
            for other in 0..self.models.len() {
                let place =
                    if other == number { Some(0) } else { self.placed.winding_at(self.models, other, at)? };
                places.extend(place);
            }
            match places.len() == self.models.len() {
                true => overlap.exact.note(index.into(), self.table.fate(number, &places)),
                // (Of damaged files only.)
                false => overlap.exact.set_near(index.into()),
            }
            Ok(())
        })?;
        self.overlaps[number] = overlap;
        Ok(())
    }

    /// Takes those that stand in for others from the faces near other bodies: they are made anew.
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

    /// The faces that are near other bodies, with what belongs to them. The builder and the surface of the result are told which faces of
    /// the base go, and what is known of values which faces may be divided.
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

    /// Hands out what becomes of the faces that are not near other bodies, with the number of the model of each, whether they stand in for
    /// others, and whether they are of the base and stay as they are.
    ///
    /// Invariant: faces of the base that stay come before all others, in the order of their numbers there, and so get the numbers that
    /// [`Renumbering`] tells; leaves that are taken over would list other faces.
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

    /// Adds those faces of the base with corners beside the grid that stay as they are, whole blocks where these can stay, too.
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

    /// Hands out what becomes of the faces with corners beside the grid that are not near other bodies, and for which the faces stand in
    /// that did before; but those of the base where `keeps_base`.
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

    /// A face of a model with corners beside the grid, on the common one.
    fn exact(&self, number: usize, mut face: ExactFace) -> ExactFace {
        let (first_part, first_source) = self.first[number];
        if self.is_coloured && face.colours.is_empty() {
            face.colours = vec![[255; 3]; face.corners.len()];
        }
        let part = face.part.saturating_add(first_part);
        let source = face.source.saturating_add(first_source);
        ExactFace { part, source, ..self.placed.exact(number, face) }
    }

    /// The use of a face of a model's octree, which may stand in for others.
    pub(super) fn becomes(&self, number: usize, face: &Face<'_>, is_proxy: bool) -> Use {
        let (fate, replaced) = (self.overlaps[number].faces.of(face.number), &self.replaced[number]);
        // (What has no area is in no cell.)
        match (is_proxy, fate) {
            (true, None) => Use::Replaced,
            (true, _) if replaced.has(face.part, face.source) || !has_area(face) => Use::Replaced,
            (_, Some(fate)) if has_area(face) => Use::Settled(fate),
            _ => Use::Arranged,
        }
    }

    /// Hands out the faces of a model's octree on the common grid, with whether they stand in for others, and what becomes of them.
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

    /// Puts a face's corners on the common grid.
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

    /// Fails if so many bytes for the faces of a model and those before it are too much.
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

/// Steps that faces of some models lie at most beside those that they stand in for.
fn reach(models: &[&ExactModel]) -> u8 {
    models.iter().map(|model| model.reach()).fold(1, u8::max)
}

/// Whether a face has an area.
fn has_area(face: &Face<'_>) -> bool {
    ring_normal(face.rings().next().unwrap_or_default()) != [0; 3]
}

/// A face with corners beside the grid as its fate leaves it; `None` of one that is dropped.
fn settled(face: ExactFace, fate: Fate) -> Option<ExactFace> {
    match fate {
        Fate::Kept => Some(face),
        Fate::Turned => Some(face.turned()),
        Fate::Dropped => None,
    }
}

/// Bytes of a face with its plane and box.
const FACE: u64 = 400;

/// Faces of two models in cells that faces of the other are in or near, too, on one grid; where these are many, only those whose boxes touch.
pub(crate) struct NearFaces {
    pub faces: ExactFaces,
    /// Where those of each model end.
    pub ends: Vec<u32>,
    /// Numbers that were added to the sources of each model's faces.
    pub(crate) first_sources: [u64; 2],
}

impl NearFaces {
    /// Goes through both octrees side by side, and reads the faces.
    ///
    /// # Errors
    /// If grids, coordinate systems or units do not fit together, if `memory` bytes are not enough, if files are damaged or cannot be
    /// read, or on interruption.
    pub(crate) fn of(models: [&ExactModel; 2], memory: u64, progress: &dyn Progress) -> Result<NearFaces> {
        let placed = Placed::of(&models)?.ok_or_else(|| unlike_grids(&models))?;
        // (Which operation does not matter for faces that are near.)
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

/// The error of a face that lies where no cell has one.
fn not_in_the_octree(path: &Path, face: u64) -> Error {
    let found = format!("face {face} with corners beyond those of all cells");
    Error::corrupt(path, "faces", found, "faces that are in the octree")
}
