//! Precondition of set operations, checked in one pass: a model's faces are planar polygons that
//! form a closed surface.

use super::block::FaceBuffer;
use super::reader::ExactModel;
use crate::closure::{Closure, ExactClosure, Seed};
use crate::face_check::{FaceCheck, FaceFlaw};
use spinney_base::parallel;
use spinney_base::{Error, Progress, Result};

impl ExactModel {
    /// Checks that each face is a planar polygon, and that the surface is closed. If there are
    /// off-grid vertices, the exact surface is checked, too.
    ///
    /// # Errors
    /// If a face is invalid, if the surface is not closed, if the file is corrupt or cannot be
    /// read, or on cancellation.
    pub(crate) fn check_surface(&self, progress: &dyn Progress) -> Result<()> {
        /// Number of blocks between cancellation checks.
        const BATCH: usize = 64;
        let seed = Seed::new();
        let mut closure = Closure::new(seed);
        let blocks: Vec<usize> = (0..self.blocks.len()).collect();
        for blocks in blocks.chunks(BATCH) {
            progress.check()?;
            for found in parallel::map(blocks, |index| self.closure_of_block(*index, seed)) {
                closure.append(found?);
            }
        }
        if closure.is_closed() && (!self.has_exact_faces() || self.is_exactly_closed(seed, progress)?) {
            return Ok(());
        }
        Err(Error::NotASolid {
            path: self.path.clone(),
            what: "the faces do not bound a solid: some edges have a face on one side only".into(),
            locations: Vec::new(),
            count: 0,
            advice: "find them with `spinney verify`, and build the model again".into(),
        })
    }

    /// Returns the sum of a block's edges.
    fn closure_of_block(&self, index: usize, seed: Seed) -> Result<Closure> {
        let block = self.block(index)?;
        let mut closure = Closure::new(seed);
        let mut check = FaceCheck::new(self.summary.grid.bits);
        let mut buffer = FaceBuffer::default();
        for place in 0..block.len() {
            block.read(place, &mut buffer);
            let face = buffer.face();
            // (Three vertices are always planar.)
            if face.points.len() != 3
                && let Err(FaceFlaw { found, expected }) = check.has_area(&face)
            {
                return Err(self.corrupt(format!("face {}", face.number), found, expected));
            }
            closure.add(&face);
        }
        Ok(closure)
    }

    /// Returns whether the exact surface is closed: faces with off-grid vertices, and those that
    /// are not proxies.
    pub(super) fn is_exactly_closed(&self, seed: Seed, progress: &dyn Progress) -> Result<bool> {
        let mut closure = ExactClosure::new(seed);
        self.each_face(&mut |face, is_proxy| {
            if face.number.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            if !is_proxy {
                closure.add(face);
            }
            Ok(())
        })?;
        for index in 0..self.exact.len() {
            progress.check()?;
            let block = self.exact_block(index)?;
            closure.add_block(&block).map_err(|found| self.wrong_exact_block(index, found))?;
        }
        Ok(closure.is_closed())
    }
}
