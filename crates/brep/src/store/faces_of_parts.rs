//! The faces of some parts of a model.

use super::block::{Block, FaceBuffer};
use super::reader::ExactModel;
use crate::Face;
use crate::arrangement::ExactFace;
use spinney_base::{Progress, Result};

impl ExactModel {
    /// Visits the blocks of faces of the octree in order, each with the number of its first face.
    pub(crate) fn each_block(&self, each: &mut dyn FnMut(u64, &Block<'_>) -> Result<()>) -> Result<()> {
        let mut first = 0;
        for index in 0..self.blocks.len() {
            let block = self.block(index)?;
            each(first, &block)?;
            first += block.len() as u64;
        }
        Ok(())
    }

    /// Visits the faces of the octree of some parts in order, each with whether it is a proxy.
    /// Other faces are not decoded.
    pub(crate) fn each_face_of_parts(
        &self,
        has_part: &dyn Fn(u32) -> bool,
        progress: &dyn Progress,
        each: &mut dyn FnMut(&Face<'_>, bool) -> Result<()>,
    ) -> Result<()> {
        let mut buffer = FaceBuffer::default();
        for index in 0..self.blocks.len() {
            progress.check()?;
            let block = self.block(index)?;
            for place in (0..block.len()).filter(|place| has_part(block.part(*place))) {
                block.read(place, &mut buffer);
                each(&buffer.face(), buffer.is_proxy)?;
            }
        }
        Ok(())
    }

    /// Visits the faces with off-grid vertices of some parts in order, each with its number. Other
    /// faces are not decoded.
    pub(crate) fn each_exact_of_parts(
        &self,
        has_part: &dyn Fn(u32) -> bool,
        progress: &dyn Progress,
        each: &mut dyn FnMut(u64, ExactFace) -> Result<()>,
    ) -> Result<()> {
        let mut first = 0;
        for index in 0..self.exact.len() {
            progress.check()?;
            let block = self.exact_block(index)?;
            for place in (0..block.len()).filter(|place| has_part(block.part(*place))) {
                let face = block.face(place).map_err(|found| self.wrong_exact_block(index, found))?;
                each(first + place as u64, face)?;
            }
            first += block.len() as u64;
        }
        Ok(())
    }
}
