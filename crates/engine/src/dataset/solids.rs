//! Queries of octrees as solids.

use super::{Dataset, Tree};
use crate::query::cell_blocks::{BlockAttribute, CellBlocks, SourceBlocks};
use crate::query::{
    Field, Filling, OccupancyLevel, Rays, SolidStatistics, SolidSurface, measure, measure_surface,
};
use spinney_base::{Progress, Result};

impl Dataset {
    /// Returns how values determine the occupancy of cells.
    fn filling(&self) -> Filling {
        Filling::of(self.header().rule, self.header().form.value)
    }

    /// Returns volume, centre of gravity and bounds of an octree's solid at a level. Time is in
    /// proportion to the INNER nodes above the level, memory to the depth.
    ///
    /// # Errors
    /// If the tree is a quadtree or has no such level, the file is corrupt, or on cancellation.
    pub fn solid(&self, level: u8, progress: &dyn Progress) -> Result<SolidStatistics> {
        let (filling, frame) = (self.filling(), &self.metadata().frame);
        match &self.tree {
            Tree::Goblin(file) => measure(&**file, level, filling, frame, progress),
            Tree::Autumnal(file) => measure(&**file, level, filling, frame, progress),
            Tree::View(viewed) => {
                // The cells of `level` are the deepest of `view`.
                let view = viewed.at(level)?;
                measure(&view, level, filling, &frame.coarser(self.depth() - level), progress)
            }
        }
    }

    /// Returns the surface area of an octree's solid at a level. Time is in proportion to the
    /// surface, memory to the depth.
    ///
    /// # Errors
    /// Those of [`Dataset::solid`].
    pub fn solid_surface(&self, level: u8, progress: &dyn Progress) -> Result<SolidSurface> {
        let (filling, frame) = (self.filling(), &self.metadata().frame);
        match &self.tree {
            Tree::Goblin(file) => measure_surface(&**file, level, filling, frame, progress),
            Tree::Autumnal(file) => measure_surface(&**file, level, filling, frame, progress),
            Tree::View(viewed) => {
                let view = viewed.at(level)?;
                measure_surface(&view, level, filling, &frame.coarser(self.depth() - level), progress)
            }
        }
    }

    /// Returns a ray caster for one level of an octree; each thread needs its own.
    ///
    /// # Errors
    /// If the tree is a quadtree or has no such level, or the file is corrupt.
    pub fn rays(&self, level: u8) -> Result<Box<dyn Rays + '_>> {
        let (filling, is_finest) = (self.filling(), level == self.depth());
        let field = match &self.tree {
            Tree::Goblin(file) => Field::new(OccupancyLevel::new(&**file, level, filling, is_finest)?),
            Tree::Autumnal(file) => Field::new(OccupancyLevel::new(&**file, level, filling, is_finest)?),
            Tree::View(viewed) => {
                Field::new(OccupancyLevel::new(Box::new(viewed.at(level)?), level, filling, is_finest)?)
            }
        };
        Ok(Box::new(field))
    }

    /// Returns the cells of an octree's level in blocks, classified as solid or not: see
    /// [`SourceBlocks`].
    ///
    /// # Errors
    /// If the tree is a quadtree or has no such level, or its values cannot be blocks' attributes.
    pub fn cell_blocks(&self, level: u8, carry: BlockAttribute) -> Result<Box<dyn CellBlocks + Send + '_>> {
        let rule = self.header().rule;
        Ok(match &self.tree {
            Tree::Goblin(file) => Box::new(SourceBlocks::new(&**file, level, rule, carry)?),
            Tree::Autumnal(file) => Box::new(SourceBlocks::new(&**file, level, rule, carry)?),
            Tree::View(viewed) => {
                Box::new(SourceBlocks::new(Box::new(viewed.at(level)?), level, rule, carry)?)
            }
        })
    }
}
