//! The faces of several models, as those of one.

use std::path::Path;

use super::overlap::Overlap;
use super::placed::Placed;
use super::table::Fate;
use super::table::OperationTable;
use crate::arrangement::{ExactFace, ExactFaces, Turner};
use crate::exact::normal::ring_normal;
use crate::{ExactModel, Face, FaceList, Faces};
use spinney_base::{Error, Progress, Result};

/// Models whose faces are read one after the other, as those of one.
pub(super) struct Bodies<'a> {
    pub(super) models: &'a [&'a ExactModel],
    pub(super) placed: &'a Placed,
    pub(super) table: OperationTable,
    pub(super) overlaps: Vec<Overlap>,
    /// Whether all faces are taken as near: where corners lie beside the grid, octrees are only those of the faces that stand for
    /// others, which may be some steps off, or nowhere.
    pub(super) are_all_near: bool,
    /// The fate of all faces of each model that is then apart from all others.
    apart: Vec<Option<Fate>>,
    is_coloured: bool,
    /// Numbers of each model's first part and first source.
    first: Vec<(u32, u64)>,
}

/// Takes a face, whether it stands in for others, and what becomes of it.
type TakeFace<'f> = dyn FnMut(&Face<'_>, bool, Option<Fate>) -> Result<()> + 'f;

impl<'a> Bodies<'a> {
    /// Goes through all octrees.
    pub(super) fn new(
        models: &'a [&'a ExactModel],
        placed: &'a Placed,
        table: OperationTable,
        progress: &dyn Progress,
    ) -> Result<Bodies<'a>> {
        let (mut overlaps, mut is_coloured) = (Vec::new(), false);
        let mut first = Vec::new();
        let mut parts = 0;
        let are_all_near = models.iter().any(|model| model.is_beside_grid());
        for (number, model) in models.iter().enumerate() {
            if !are_all_near {
                overlaps.push(Overlap::of(number, models, placed, table, progress)?);
            }
            is_coloured |= model.is_coloured()?;
            first.push((parts, 0));
            parts += model.parts().len() as u32;
        }
        // Invariant: what is apart by the boxes of all its faces, exact ones too, lies where all others are what they are far
        // away, and no vertex that is moved reaches it. So one fate is that of all its faces, those without an area that join
        // edges included, and both of its surfaces stay closed for themselves.
        let far: Vec<i32> = models.iter().map(|model| model.far_winding()).collect();
        let fate = |model: usize| (are_all_near && placed.is_apart(model)).then(|| table.fate(model, &far));
        let apart = (0..models.len()).map(fate).collect();
        Ok(Bodies { models, placed, table, overlaps, are_all_near, apart, is_coloured, first })
    }

    /// The faces that are near other bodies; and where those of each model end.
    pub(super) fn near(&mut self, memory: u64, progress: &dyn Progress) -> Result<(ExactFaces, Vec<u32>)> {
        let parts = self.models.iter().flat_map(|model| model.parts().iter().cloned()).collect();
        let mut found = ExactFaces::of_grid(FaceList::new(self.placed.grid.clone(), parts));
        let (mut ends, mut first_source, mut exact_bytes) = (Vec::new(), 0u64, 0u64);
        for (number, model) in self.models.iter().enumerate() {
            self.first[number].1 = first_source;
            let mut sources = first_source;
            self.each(number, progress, &mut |face, stands_in, fate| {
                sources = sources.max(face.source.saturating_add(1));
                if !stands_in && fate.is_none() {
                    found.list.push(face);
                    if found.list.len().is_multiple_of(1 << 12) {
                        self.check_room(number, found.list.bytes().saturating_add(exact_bytes), memory)?;
                    }
                }
                Ok(())
            })?;
            self.each_exact(number, &mut |face| {
                // (New corners are at most half a step beside the others.)
                let most = (1u64 << self.placed.grid.bits) as f64;
                if face
                    .corners
                    .iter()
                    .flat_map(|corner| corner.point.near)
                    .any(|at| !(-1.0..=most).contains(&at))
                {
                    return Err(not_in_the_octree(model.path(), face.source));
                }
                sources = sources.max(face.source.saturating_add(1));
                if self.apart[number].is_some() {
                    return Ok(());
                }
                exact_bytes += face.bytes();
                found.push(face);
                if found.list.len().is_multiple_of(1 << 8) {
                    progress.check()?;
                    self.check_room(number, found.list.bytes().saturating_add(exact_bytes), memory)?;
                }
                Ok(())
            })?;
            self.check_room(number, found.list.bytes().saturating_add(exact_bytes), memory)?;
            first_source = sources;
            ends.push(found.list.len() as u32);
        }
        Ok((found, ends))
    }

    /// Hands out what becomes of the faces that are not near other bodies, and whether they stand in for others.
    pub(super) fn settled(
        &self,
        progress: &dyn Progress,
        each: &mut dyn FnMut(&Face<'_>, bool) -> Result<()>,
    ) -> Result<()> {
        let mut turner = Turner::default();
        for number in 0..self.models.len() {
            self.each(number, progress, &mut |face, stands_in, fate| match fate {
                Some(Fate::Kept) => each(face, stands_in),
                Some(Fate::Turned) => each(&turner.turn(face), stands_in),
                _ => Ok(()),
            })?;
        }
        Ok(())
    }

    /// Appends what becomes of the faces with corners beside the grid of models that are apart from all others.
    pub(super) fn settle_exact(&self, exact: &mut Vec<ExactFace>, memory: u64) -> Result<()> {
        let mut bytes: u64 = exact.iter().map(ExactFace::bytes).sum();
        for (number, fate) in self.apart.iter().enumerate() {
            let is_turned = match fate {
                Some(Fate::Kept) => false,
                Some(Fate::Turned) => true,
                _ => continue,
            };
            self.each_exact(number, &mut |face| {
                bytes += face.bytes();
                self.check_room(number, bytes, memory)?;
                exact.push(if is_turned { face.turned() } else { face });
                Ok(())
            })?;
        }
        Ok(())
    }

    /// Hands out the faces of a model with corners beside the grid, on the common one.
    fn each_exact(&self, number: usize, each: &mut dyn FnMut(ExactFace) -> Result<()>) -> Result<()> {
        let (first_part, first_source) = self.first[number];
        self.models[number].each_exact(&mut |mut face| {
            if self.is_coloured && face.colours.is_empty() {
                face.colours = vec![[255; 3]; face.corners.len()];
            }
            let face = self.placed.exact(number, face);
            let part = face.part.saturating_add(first_part);
            let source = face.source.saturating_add(first_source);
            each(ExactFace { part, source, ..face })
        })
    }

    /// The faces of the result that come from faces not near other bodies, in a list; `None` if that would be larger than `memory`.
    pub(super) fn all_settled(&self, memory: u64, progress: &dyn Progress) -> Result<Option<FaceList>> {
        // (A triangle takes about as much.)
        const TRIANGLE: u64 = 80;
        if self.models.iter().map(|model| model.len()).sum::<u64>() * TRIANGLE > memory {
            return Ok(None);
        }
        let mut list = FaceList::new(self.placed.grid.clone(), Vec::new());
        self.settled(progress, &mut |face, _| {
            list.push(face);
            Ok(())
        })?;
        Ok(Some(list))
    }

    /// Hands out the faces of a model on the common grid, with whether they stand in for others, and what becomes of those that
    /// are not near other bodies.
    fn each(&self, number: usize, progress: &dyn Progress, each: &mut TakeFace<'_>) -> Result<()> {
        let model = self.models[number];
        let overlap = self.overlaps.get(number);
        let (first_part, first_source) = self.first[number];
        let (mut points, mut white) = (Vec::new(), Vec::new());
        model.each_face(&mut |face, stands_in| {
            if face.number.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            // (What has no area is in no cell.)
            let has_area = || ring_normal(face.rings().next().unwrap_or_default()) != [0; 3];
            let fate = match overlap {
                None => self.apart[number],
                Some(overlap) if !overlap.near.has(face.number) && has_area() => {
                    Some(overlap.fate(face.number))
                }
                _ => None,
            };
            if fate == Some(Fate::Dropped) {
                return each(face, stands_in, fate);
            }
            self.put(number, face.number, face.points, &mut points)?;
            white.resize(if self.is_coloured { points.len() } else { 0 }, [255; 3]);
            let colours = if face.colours.is_empty() { &white[..] } else { face.colours };
            let (part, source) =
                (face.part.saturating_add(first_part), face.source.saturating_add(first_source));
            each(&Face { points: &points, colours, part, source, ..*face }, stands_in, fate)
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
        let placed = Placed::of(&models)?;
        // (Which operation does not matter for faces that are near.)
        let mut bodies = Bodies::new(&models, &placed, OperationTable::new(1, 2)?, progress)?;
        let near: usize = bodies.overlaps.iter().map(|overlap| overlap.near.numbers().count()).sum();
        if near as u64 * FACE > memory {
            bodies.drop_apart(memory, progress)?;
        }
        let (faces, ends) = bodies.near(memory, progress)?;
        Ok(NearFaces { faces, ends, first_sources: [0, bodies.first[1].1] })
    }
}

/// The error of a face that lies where no cell has one.
fn not_in_the_octree(path: &Path, face: u64) -> Error {
    let found = format!("face {face} with corners beyond those of all cells");
    Error::corrupt(path, "faces", found, "faces that are in the octree")
}
