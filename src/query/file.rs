//! Files of either format as [`Tree`]s.

use std::any::Any;
use std::path::Path;

use super::any::Tree;
use super::cell_blocks::{Carry, CellBlocks, SourceBlocks};
use super::dump;
use super::field::Field;
use super::find::{Condition, FoundBlock, source_find};
use super::occupancy::{Filling, Level};
use super::points::PointSamples;
use super::ray::Rays;
use super::solid::{SolidStatistics, measure};
use super::stats::{Statistics, source_histogram, source_statistics, tally_statistics};
use super::window::{fill_value, wires_of};
use crate::space::{Bounds, Cell, Code, Dimension as _, Oct};
use crate::store::autumnal::{Autumnal, Commit};
use crate::store::goblin::{Finding, Goblin, Header, Layout, Metadata, OpenOptions};
use crate::store::{File, TreeFormat, Typed, file_format, split_commit, typed};
use crate::tree::{Child, MemTree, Source, df};
use crate::value::{Kind, Sample, Value};
use crate::{Error, Progress, Result};

/// What is generic over the dimension as the same of octrees, for questions about solids: they are then compiled for octrees
/// only.
///
/// # Errors
/// If it is a quadtree.
pub(crate) fn octree<T: Any, O: Any>(tree: &T) -> Result<&O> {
    let expected = "an octree: this is a question about solids";
    (tree as &dyn Any).downcast_ref().ok_or_else(|| Error::invalid("tree", "a quadtree", expected))
}

/// Opens a file of any type.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Tree>> {
    typed(path, Opening { path, options })
}

struct Opening<'a> {
    path: &'a Path,
    options: &'a OpenOptions,
}

impl Typed for Opening<'_> {
    type Out = Box<dyn Tree>;

    fn of<D: Layout, V: Value>(self) -> Result<Box<dyn Tree>> {
        let (file, _) = split_commit(self.path);
        Ok(match file_format(&file)? {
            TreeFormat::Goblin => Box::new(Goblin::<D, V>::open(self.path, self.options)?),
            TreeFormat::Autumnal => Box::new(Autumnal::<D, V>::open(self.path, self.options)?),
        })
    }
}

/// The tree that a file is.
pub(crate) fn as_tree<D: Layout, V: Value>(file: &File<D, V>) -> &dyn Tree {
    match file {
        File::Goblin(file) => &**file,
        File::Autumnal(file) => &**file,
        File::Patched(file) => &**file.source(),
    }
}

/// What files of each format tell and answer in their own way.
trait TreeFile: Source<Dim: Layout> + Send + Sync + Sized + 'static {
    /// The same format's octrees.
    type Octree: Source<Dim = Oct, Value = Self::Value> + Send + Sync;

    const FORMAT: TreeFormat;

    fn header(&self) -> &Header;
    fn metadata(&self) -> &Metadata;
    fn path(&self) -> &Path;
    fn file_size(&self) -> u64;
    fn segments(&self) -> usize;
    fn stored_records(&self) -> u64;
    fn sections(&self) -> Vec<(&'static str, u64)>;
    fn commit(&self) -> Option<&Commit>;
    fn refresh(&mut self) -> Result<bool>;
    /// Records that going through the whole tree would meet.
    fn records(&self) -> Result<u64>;
    fn value_at(&self, code: Code<Self::Dim>) -> Result<Option<Self::Value>>;
    fn values_at(&self, level: u8, cells: &[Cell], values: &mut [Option<Self::Value>]) -> Result<()>;
    fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: Self::Value,
        values: &mut [<Self::Value as Value>::Wire],
        valid: Option<&mut [bool]>,
    ) -> Result<()>;
    fn statistics(&self, bounds: Option<Bounds>) -> Result<Statistics>;
    fn histogram(&self, bounds: &Bounds, low: f64, high: f64, bins: usize) -> Result<Vec<u64>>;
    fn find(
        &self,
        condition: Condition,
        bounds: Option<Bounds>,
        found: &mut dyn FnMut(FoundBlock) -> Result<bool>,
    ) -> Result<()>;
    fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>>;

    /// The file as an octree, for questions about solids.
    fn octree(&self) -> Result<&Self::Octree> {
        octree(self)
    }

    fn in_memory(&self, most: u64) -> Result<MemTree<Self::Dim, Self::Value>> {
        let records = self.records()?;
        if records > most {
            let expected = format!("at most {most} to be shown in full");
            return Err(Error::invalid("tree", format!("{records} records"), expected));
        }
        MemTree::from_source(self, TreeFile::header(self).rule)
    }
}

/// What files of both formats tell by methods of the same names.
macro_rules! own_answers {
    () => {
        fn header(&self) -> &Header {
            self.header()
        }

        fn metadata(&self) -> &Metadata {
            self.metadata()
        }

        fn path(&self) -> &Path {
            self.path()
        }

        fn file_size(&self) -> u64 {
            self.file_size()
        }

        fn sections(&self) -> Vec<(&'static str, u64)> {
            self.sections()
        }

        fn value_at(&self, code: Code<D>) -> Result<Option<V>> {
            self.value_at(code)
        }

        fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
            self.verify(memory, progress)
        }
    };
}

impl<D: Layout, V: Value> TreeFile for Goblin<D, V> {
    type Octree = Goblin<Oct, V>;

    const FORMAT: TreeFormat = TreeFormat::Goblin;

    own_answers!();

    fn segments(&self) -> usize {
        self.segments()
    }

    fn stored_records(&self) -> u64 {
        self.stored_records()
    }

    fn commit(&self) -> Option<&Commit> {
        None
    }

    fn refresh(&mut self) -> Result<bool> {
        Ok(false)
    }

    fn records(&self) -> Result<u64> {
        // The total in the trailer may be wrong.
        (0..self.segments()).map(|index| Ok(u64::from(self.entry(index)?.records))).sum()
    }

    fn values_at(&self, level: u8, cells: &[Cell], values: &mut [Option<V>]) -> Result<()> {
        self.values_at(level, cells, values)
    }

    fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: V,
        values: &mut [V::Wire],
        valid: Option<&mut [bool]>,
    ) -> Result<()> {
        self.window(level, bounds, fill, values, valid).map(|_| ())
    }

    fn statistics(&self, bounds: Option<Bounds>) -> Result<Statistics> {
        self.statistics(bounds)
    }

    fn histogram(&self, bounds: &Bounds, low: f64, high: f64, bins: usize) -> Result<Vec<u64>> {
        self.histogram(bounds, low, high, bins)
    }

    fn find(
        &self,
        condition: Condition,
        bounds: Option<Bounds>,
        found: &mut dyn FnMut(FoundBlock) -> Result<bool>,
    ) -> Result<()> {
        self.find(condition, bounds, found)
    }
}

impl<D: Layout, V: Value> TreeFile for Autumnal<D, V> {
    type Octree = Autumnal<Oct, V>;

    const FORMAT: TreeFormat = TreeFormat::Autumnal;

    own_answers!();

    fn segments(&self) -> usize {
        0
    }

    fn stored_records(&self) -> u64 {
        self.commit().records
    }

    fn commit(&self) -> Option<&Commit> {
        Some(self.commit())
    }

    fn refresh(&mut self) -> Result<bool> {
        self.refresh()
    }

    fn records(&self) -> Result<u64> {
        self.walkable_records()
    }

    fn values_at(&self, level: u8, cells: &[Cell], values: &mut [Option<V>]) -> Result<()> {
        for (cell, value) in cells.iter().zip(values) {
            *value = Code::from_cell(level, *cell).map_or(Ok(None), |code| self.value_at(code))?;
        }
        Ok(())
    }

    fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: V,
        values: &mut [V::Wire],
        valid: Option<&mut [bool]>,
    ) -> Result<()> {
        self.window(level, bounds, fill, values, valid)
    }

    fn statistics(&self, bounds: Option<Bounds>) -> Result<Statistics> {
        let picture = Bounds { min: [0; 3], max: self.header().extent };
        let bounds = bounds.map_or(picture, |bounds| bounds.intersect(&picture));
        // All of the picture is all of the tree, however many nodes that has.
        if bounds == picture
            && let Child::Inner { node, .. } = self.root_place()
            && let Some(tally) = self.tally(&node)?
        {
            return Ok(tally_statistics(tally, bounds.volume(), self.counts_classes()));
        }
        source_statistics(self, &bounds, self.counts_classes())
    }

    fn histogram(&self, bounds: &Bounds, low: f64, high: f64, bins: usize) -> Result<Vec<u64>> {
        source_histogram(self, bounds, (low, high), bins)
    }

    fn find(
        &self,
        condition: Condition,
        bounds: Option<Bounds>,
        found: &mut dyn FnMut(FoundBlock) -> Result<bool>,
    ) -> Result<()> {
        let picture = Bounds { min: [0; 3], max: self.header().extent };
        source_find(self, condition, &bounds.map_or(picture, |bounds| bounds.intersect(&picture)), found)
    }
}

impl<F: TreeFile> Tree for F {
    fn format(&self) -> TreeFormat {
        F::FORMAT
    }

    fn header(&self) -> &Header {
        TreeFile::header(self)
    }

    fn metadata(&self) -> &Metadata {
        TreeFile::metadata(self)
    }

    fn path(&self) -> &Path {
        TreeFile::path(self)
    }

    fn file_size(&self) -> u64 {
        TreeFile::file_size(self)
    }

    fn segments(&self) -> usize {
        TreeFile::segments(self)
    }

    fn stored_records(&self) -> u64 {
        TreeFile::stored_records(self)
    }

    fn sections(&self) -> Vec<(&'static str, u64)> {
        TreeFile::sections(self)
    }

    fn commit(&self) -> Option<&Commit> {
        TreeFile::commit(self)
    }

    fn refresh(&mut self) -> Result<bool> {
        TreeFile::refresh(self)
    }

    fn point(&self, cell: [u64; 3], level: u8, value: &mut [f64; 4]) -> Result<bool> {
        let cell = cell.map(|cell| u32::try_from(cell).unwrap_or(u32::MAX));
        let found =
            if level > TreeFile::header(self).shape.depth { None } else { Code::from_cell(level, cell) };
        let Some(found) = found.map(|code| self.value_at(code)).transpose()?.flatten() else {
            return Ok(false);
        };
        for (number, sample) in value.iter_mut().zip(found.samples()) {
            *number = sample.to_f64();
        }
        Ok(true)
    }

    fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: f64,
        bytes: &mut [u8],
        valid: Option<&mut [bool]>,
    ) -> Result<()> {
        let values = wires_of::<F::Value>(bytes, bounds.volume())?;
        TreeFile::window(self, level, bounds, fill_value(fill), values, valid)
    }

    fn statistics(&self, bounds: Option<Bounds>) -> Result<Statistics> {
        TreeFile::statistics(self, bounds)
    }

    fn histogram(&self, bounds: &Bounds, low: f64, high: f64, bins: usize) -> Result<Vec<u64>> {
        TreeFile::histogram(self, bounds, low, high, bins)
    }

    fn points(&self, cells: &[[u64; 3]], level: u8, samples: &mut PointSamples) -> Result<()> {
        samples.start(F::Value::CHANNELS);
        let cells: Vec<_> =
            cells.iter().map(|cell| cell.map(|cell| u32::try_from(cell).unwrap_or(u32::MAX))).collect();
        let mut values = vec![None; cells.len()];
        self.values_at(level, &cells, &mut values)?;
        for value in values {
            samples.push_value::<F::Value>(value);
        }
        Ok(())
    }

    fn solid(&self, level: u8, progress: &dyn Progress) -> Result<SolidStatistics> {
        let filling = Filling::of::<F::Value>(TreeFile::header(self).rule);
        measure(self.octree()?, level, filling, &TreeFile::metadata(self).frame, progress)
    }

    fn rays(&self, level: u8) -> Result<Box<dyn Rays + '_>> {
        let header = TreeFile::header(self);
        let filling = Filling::of::<F::Value>(header.rule);
        Ok(Box::new(Field::new(Level::new(self.octree()?, level, filling, level == header.shape.depth)?)))
    }

    fn find(
        &self,
        condition: Condition,
        bounds: Option<Bounds>,
        found: &mut dyn FnMut(FoundBlock) -> Result<bool>,
    ) -> Result<()> {
        TreeFile::find(self, condition, bounds, found)
    }

    fn cell_blocks(&self, level: u8, carry: Carry) -> Result<Box<dyn CellBlocks + '_>> {
        Ok(Box::new(SourceBlocks::new(self.octree()?, level, TreeFile::header(self).rule, carry)?))
    }

    fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        TreeFile::verify(self, memory, progress)
    }

    fn df_text(&self, most: u64) -> Result<String> {
        let solid = TreeFile::header(self).kind == Kind::Continuous && F::Dim::AXES == 3;
        df::to_text(&self.in_memory(most)?, if solid { F::Value::splat_f64(255.0) } else { None })
    }

    fn classic_table(&self, most: u64) -> Result<String> {
        match F::FORMAT {
            TreeFormat::Goblin => dump::classic_table(&self.in_memory(most)?),
            TreeFormat::Autumnal => dump::classic_pointer_table(&self.in_memory(most)?),
        }
    }

    fn leaf_codes(&self, most: u64) -> Result<String> {
        dump::leaf_codes(&self.in_memory(most)?)
    }
}
