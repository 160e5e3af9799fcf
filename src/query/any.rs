//! Files of any type behind one interface, for the command line and for bindings.

use std::path::Path;

use crate::space::Bounds;
use crate::store::TreeFormat;
use crate::store::autumnal::Commit;
use crate::store::goblin::{Finding, Header, Metadata, OpenOptions};
use crate::{Progress, Result};

use super::cell_blocks::{Carry, CellBlocks};
use super::find::{Condition, FoundBlock};
use super::points::PointSamples;
use super::ray::Rays;
use super::solid::SolidStatistics;
use super::stats::Statistics;

/// A tree file of any dimension and type, open for questions.
///
/// Values come as f64 (which holds every sample type exactly) or as little-endian bytes; levels count from the root
/// (0) to the cells ([`Tree::depth`]); coordinates are cells of the level that is asked for, x, y, z, the last 0 in
/// quadtrees.
pub trait Tree: Send + Sync {
    /// The file's format.
    fn format(&self) -> TreeFormat;
    /// The commit that is looked at; only Autumnal files have commits.
    fn commit(&self) -> Option<&Commit> {
        None
    }
    /// Moves on to the newest commit, if the file has got a newer one; tells whether. What was opened at a certain commit,
    /// or through a view, stays as it is.
    ///
    /// # Errors
    /// If the file cannot be read any more; the tree stays as it was then.
    fn refresh(&mut self) -> Result<bool> {
        Ok(false)
    }
    /// What the header says: dimension, types, rule, depth, extent.
    fn header(&self) -> &Header;
    /// What is told about the data.
    fn metadata(&self) -> &Metadata;
    /// The file.
    fn path(&self) -> &Path;
    /// Bytes of the whole file.
    fn file_size(&self) -> u64;
    /// Number of segments; 0 in Autumnal files, which have none.
    fn segments(&self) -> usize;
    /// Records in all segments, those stored more than once included; in Autumnal files those of the commit's tree, the
    /// shared ones as often as they occur.
    fn stored_records(&self) -> u64;
    /// Name and bytes of each part of the file.
    fn sections(&self) -> Vec<(&'static str, u64)>;

    /// Levels below the root.
    fn depth(&self) -> u8 {
        self.header().shape.depth
    }

    /// The picture's size at a level, in that level's cells (rounded up); all cells outside are VOID. Below the
    /// cells there is nothing finer: such a level counts as [`Tree::depth`].
    fn extent_at(&self, level: u8) -> Bounds {
        let shift = self.depth().saturating_sub(level);
        Bounds { min: [0; 3], max: self.header().extent.map(|cells| cells.div_ceil(1 << shift)) }
    }

    /// The value of one cell of a level, its samples written to `value`; `false` is VOID (also outside the tree).
    ///
    /// # Errors
    /// If the file is damaged there.
    fn point(&self, cell: [u64; 3], level: u8, value: &mut [f64; 4]) -> Result<bool>;

    /// The values of many cells of a level, in the order of the cells, to `samples`, whose former contents go. Much faster
    /// than asking for them one by one where there are very many.
    ///
    /// # Errors
    /// If the file is damaged there.
    fn points(&self, cells: &[[u64; 3]], level: u8, samples: &mut PointSamples) -> Result<()> {
        samples.start(self.header().value.channels.into());
        let mut value = [0.0; 4];
        for cell in cells {
            let found = self.point(*cell, level, &mut value)?;
            samples.push(found.then_some(&value));
        }
        Ok(())
    }

    /// The values of a box of cells of a level: x fastest, then y, then z; a cell's samples together, little-endian;
    /// VOID cells have the sample `fill` in every channel, and `false` in `valid` if that is given.
    ///
    /// `bytes` must have `bounds.volume() * header().value.size()` bytes, `valid` one flag per cell.
    ///
    /// # Errors
    /// If the file is damaged there, the level is too deep, or a buffer has the wrong size.
    fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: f64,
        bytes: &mut [u8],
        valid: Option<&mut [bool]>,
    ) -> Result<()>;

    /// Exact statistics of a box of cells (of the deepest level); the whole picture if there is none.
    ///
    /// # Errors
    /// If the file is damaged there.
    fn statistics(&self, bounds: Option<Bounds>) -> Result<Statistics>;

    /// Whether some cells of a box may be VOID; `false` is sure. Cheaper than statistics where these are not.
    ///
    /// # Errors
    /// If the file is damaged there.
    fn may_have_void(&self, bounds: Bounds) -> Result<bool> {
        Ok(self.statistics(Some(bounds))?.cells < bounds.volume())
    }

    /// Bounds of all values, per channel: the least and the largest; nothing if there are none.
    ///
    /// # Errors
    /// If the file is damaged there.
    fn value_bounds(&self) -> Result<Vec<(f64, f64)>> {
        Ok(self.statistics(None)?.channels.iter().map(|channel| (channel.min, channel.max)).collect())
    }

    /// Cells of a box (of the deepest level) whose first channel lies in each of `bins` equal parts of `low ..= high`.
    ///
    /// # Errors
    /// If the file is damaged there.
    fn histogram(&self, bounds: &Bounds, low: f64, high: f64, bins: usize) -> Result<Vec<u64>>;

    /// Volume, surface, centre of gravity and bounds of an octree's solid at a level. Time is proportional to the nodes
    /// around its surface, memory to depth.
    ///
    /// # Errors
    /// If the tree is a quadtree or has no such level, the file is damaged, or on interruption.
    fn solid(&self, level: u8, progress: &dyn Progress) -> Result<SolidStatistics>;

    /// Something to cast rays with through one level of an octree; each thread needs its own.
    ///
    /// # Errors
    /// If the tree is a quadtree or has no such level, or the file is damaged.
    fn rays(&self, level: u8) -> Result<Box<dyn Rays + '_>>;

    /// Hands out the largest blocks all of whose cells meet a condition, in FD order, until `found` says `false`.
    ///
    /// # Errors
    /// If the file is damaged there, or `found` fails.
    fn find(
        &self,
        condition: Condition,
        bounds: Option<Bounds>,
        found: &mut dyn FnMut(FoundBlock) -> Result<bool>,
    ) -> Result<()>;

    /// The cells of an octree's level in blocks, as solid ones and others: see
    /// [`SourceBlocks`](super::cell_blocks::SourceBlocks).
    ///
    /// # Errors
    /// If the tree is a quadtree or has no such level, or its values cannot be carried.
    fn cell_blocks(&self, level: u8, carry: Carry) -> Result<Box<dyn CellBlocks + '_>>;

    /// Checks everything: see [`Goblin::verify`](crate::store::goblin::Goblin::verify) and
    /// [`Autumnal::verify`](crate::store::autumnal::Autumnal::verify).
    ///
    /// # Errors
    /// If the file cannot be read, or on interruption.
    fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>>;

    /// The tree as a DF-expression ([`crate::tree::df`]).
    ///
    /// # Errors
    /// If the file is damaged, or the tree has more than `most` nodes.
    fn df_text(&self, most: u64) -> Result<String>;

    /// The classic table: a line per record with its number, the children's values (an INNER child's
    /// representative with a minus sign, or in parentheses where values may be 0 or negative; `.` is VOID) and the
    /// number of the record to go on with when the node's detail is skipped. Of Autumnal files: the children's values with
    /// a minus sign (or in parentheses), or the numbers of their records, and the node's representative.
    ///
    /// # Errors
    /// As [`Tree::df_text`].
    fn classic_table(&self, most: u64) -> Result<String>;

    /// FD code and value of every leaf, a line each.
    ///
    /// # Errors
    /// As [`Tree::df_text`].
    fn leaf_codes(&self, most: u64) -> Result<String>;
}

/// Opens a tree file of either format and any type; `map.autumn@12` is commit 12 of `map.autumn`.
///
/// # Errors
/// If it cannot be read, is no tree file, is damaged, or of a newer version.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Tree>> {
    super::file::open(path, options)
}
