//! Faces of a base model that an incremental build keeps: they are copied, and the sums of
//! unchanged parts are taken from the base.

use super::base::BaseModel;
use super::{ModelBuilder, NearFaces};
use crate::Face;
use crate::arrangement::ExactFace;
use crate::face_set::FaceSet;
use crate::part_sums::SumsOfParts;
use crate::store::block::Block;
use crate::store::exact::ExactBlock;
use crate::{ExactModel, Faces};
use spinney_base::{Progress, Result};

/// Blocks with at least so many faces are copied as bytes; smaller ones are joined to neighbours,
/// so that blocks do not become smaller with each operation. (Models of unit tests are small.)
const LARGE: usize = if cfg!(test) { 16 } else { 256 };

impl ModelBuilder {
    /// Prepares for faces of a base that are kept. Must be called before any face is added.
    pub(crate) fn keeping(mut self) -> ModelBuilder {
        self.sums.record_touched();
        self
    }

    /// Adds a face of the base that is unchanged. These faces must be added first, in the base's
    /// order.
    pub(crate) fn push_kept(&mut self, face: &Face<'_>, is_proxy: bool) -> Result<()> {
        self.write_face(face, is_proxy).map(|_| ())
    }

    /// Adds such faces of a block, `kept` by their indices; no part number is above `last_part`. A
    /// large block that is kept as a whole is copied as bytes. Returns `None` if the block is
    /// invalid.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(crate) fn push_kept_faces(
        &mut self,
        block: &Block<'_>,
        kept: &[usize],
        last_part: u32,
    ) -> Result<Option<()>> {
        let first = self.faces;
        let bytes = block.bytes_from(first).filter(|_| kept.len() == block.len() && kept.len() >= LARGE);
        let written = match bytes {
            Some(bytes) => self.writer.face_block(first, bytes).map(Some)?,
            None => self.writer.faces_of(block, kept, first)?,
        };
        self.faces += kept.len() as u64;
        self.proxies += kept.iter().filter(|place| block.is_proxy(**place)).count() as u64;
        self.last_part = self.last_part.max(last_part);
        Ok(written)
    }

    /// Adds a face of the base with off-grid vertices that is unchanged, in the base's order,
    /// before all others.
    ///
    /// # Errors
    /// The errors of [`ModelBuilder::push_exact`].
    pub(crate) fn push_kept_exact(&mut self, face: ExactFace) -> Result<()> {
        self.keep_exact(1, face.part)?;
        self.writer.exact_face(face)
    }

    /// Adds such faces of a block, `kept` by their indices; no part number is above `last_part`. A
    /// large block that is kept as a whole is copied as bytes. Returns the description of the flaw
    /// if the block is invalid.
    ///
    /// # Errors
    /// The errors of [`ModelBuilder::push_exact`].
    pub(crate) fn push_kept_block(
        &mut self,
        block: &ExactBlock<'_>,
        kept: &[usize],
        last_part: u32,
    ) -> Result<std::result::Result<(), String>> {
        self.keep_exact(kept.len(), last_part)?;
        if kept.len() == block.len() && kept.len() >= LARGE {
            return self.writer.exact_block(kept.len(), block.bytes()).map(Ok);
        }
        match block.subset(kept) {
            Ok(lists) => self.writer.exact_lists(lists).map(Ok),
            Err(found) => Ok(Err(found)),
        }
    }

    fn keep_exact(&mut self, faces: usize, last_part: u32) -> Result<()> {
        self.check_exact_memory(faces as u64)?;
        self.last_part = self.last_part.max(last_part);
        // (Boxes and planes are loaded when a changed cell needs them.)
        NearFaces::skip(&mut self.near, faces);
        Ok(())
    }
}

impl BaseModel<'_> {
    /// Returns the number of a part of the base in the new model.
    pub(crate) fn part_number(&self, part: u32) -> u32 {
        self.part_numbers.get(part as usize).copied().unwrap_or(part)
    }

    /// Whether all parts of the base keep their numbers.
    pub(crate) fn keeps_part_numbers(&self) -> bool {
        (0..).zip(&self.part_numbers).all(|(part, number)| part == *number)
    }

    /// Adds the sums over the kept faces. Those of parts without added or removed faces are the
    /// base's; those of other parts are computed from their faces.
    // Invariant: sums cannot be updated by subtraction. Bounds are not sums, and whether an open
    // part becomes closed depends on the hashes of all its edges, which are not stored: with a
    // stored seed, an untrusted file could contain edges whose hashes cancel by design.
    pub(super) fn add_sums(&self, sums: &mut SumsOfParts, progress: &dyn Progress) -> Result<()> {
        let model: &ExactModel = self.model;
        let mut carried = FaceSet::new(model.parts().len() as u64);
        model.each_part_sums(&mut |part, stored| {
            let new = self.part_number(part);
            // (Stored sums count from the beginning of the base's grid.)
            if self.root.is_moved() || self.changed_parts.contains(&part) || sums.is_touched(new) {
                return Ok(());
            }
            carried.set(part.into(), true);
            sums.carry(new, stored)
        })?;
        let is_summed = |part: u32| !carried.has(part.into());
        let mut points = Vec::new();
        model.each_face_of_parts(&is_summed, progress, &mut |face, is_proxy| {
            if self.faces.number(face.number).is_none() {
                return Ok(());
            }
            points.clear();
            points.extend(face.points.iter().map(|point| self.point(*point)));
            sums.add(&Face { points: &points, part: self.part_number(face.part), ..*face }, is_proxy)
        })?;
        // (A base with exact faces is on the new model's grid.)
        model.each_exact_of_parts(&is_summed, progress, &mut |number, face| match self.exact.number(number) {
            Some(_) => sums.add_exact(&ExactFace { part: self.part_number(face.part), ..face }),
            None => Ok(()),
        })
    }
}
