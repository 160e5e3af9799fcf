//! Goblin files as [`Tree`]s.

use std::any::Any;
use std::path::Path;

use zerocopy::FromBytes;

use super::any::Tree;
use super::cell_blocks::{Carry, CellBlocks, SourceBlocks};
use super::dump;
use super::field::Field;
use super::find::{Condition, FoundBlock};
use super::occupancy::{Filling, Level};
use super::points::PointSamples;
use super::ray::Rays;
use super::solid::{SolidStatistics, measure};
use super::stats::Statistics;
use crate::space::{Bounds, Code, Oct, Quad};
use crate::store::goblin::{Finding, Goblin, Header, Layout, Metadata, OpenOptions, read_header};
use crate::tree::{MemTree, df};
use crate::value::{Sample, Value};
use crate::{Error, Progress, Result, with_value_type};

/// What is generic over the dimension as the same of octrees, for questions about solids: they are then compiled for octrees
/// only.
///
/// # Errors
/// If it is a quadtree.
pub(crate) fn octree<T: Any, O: Any>(tree: &T) -> Result<&O> {
    let expected = "an octree: this is a question about solids";
    (tree as &dyn Any).downcast_ref().ok_or_else(|| Error::invalid("tree", "a quadtree", expected))
}

/// Opens a Goblin file of any type.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Tree>> {
    let storage = options.storage(path)?;
    let header = read_header(path, &*storage)?;
    let unknown = || {
        let expected = "1 to 4 channels of u8, u16 or f32, or 1 channel";
        Error::corrupt(path, "header", format!("values {}", header.value), expected)
    };
    if header.axes == 2 {
        with_value_type!(header.value, V => Ok(Box::new(Goblin::<Quad, V>::from_storage(path, storage, options)?)),
            else Err(unknown()))
    } else {
        with_value_type!(header.value, V => Ok(Box::new(Goblin::<Oct, V>::from_storage(path, storage, options)?)),
            else Err(unknown()))
    }
}

impl<D: Layout, V: Value> Goblin<D, V> {
    /// The file as an octree, for questions about solids, which then are compiled for octrees only.
    fn octree(&self) -> Result<&Goblin<Oct, V>> {
        octree(self)
    }

    fn in_memory(&self, most: u64) -> Result<MemTree<D, V>> {
        // The total in the trailer may be wrong.
        let records = (0..self.segments())
            .map(|index| Ok(u64::from(self.entry(index)?.records)))
            .sum::<Result<u64>>()?;
        if records > most {
            let expected = format!("at most {most} to be shown in full");
            return Err(Error::invalid("tree", format!("{records} records"), expected));
        }
        MemTree::from_source(self, self.header().rule)
    }
}

impl<D: Layout, V: Value> Tree for Goblin<D, V> {
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

    fn segments(&self) -> usize {
        self.segments()
    }

    fn stored_records(&self) -> u64 {
        self.stored_records()
    }

    fn sections(&self) -> Vec<(&'static str, u64)> {
        self.sections()
    }

    fn point(&self, cell: [u64; 3], level: u8, value: &mut [f64; 4]) -> Result<bool> {
        let cell = cell.map(|cell| u32::try_from(cell).unwrap_or(u32::MAX));
        let found = if level > self.depth() { None } else { Code::from_cell(level, cell) };
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
        let wires = bounds.volume() as usize;
        let length = bytes.len();
        let values = <[V::Wire]>::mut_from_bytes_with_elems(bytes, wires).map_err(|_| {
            Error::invalid(
                "window buffer",
                format!("{length} bytes"),
                format!("{wires} values of {}", V::TYPE),
            )
        })?;
        let fill = V::from_channels(|_| V::Sample::from_f64_lossy(fill));
        Goblin::window(self, level, bounds, fill, values, valid).map(|_| ())
    }

    fn statistics(&self, bounds: Option<Bounds>) -> Result<Statistics> {
        Goblin::statistics(self, bounds)
    }

    fn histogram(&self, bounds: &Bounds, low: f64, high: f64, bins: usize) -> Result<Vec<u64>> {
        Goblin::histogram(self, bounds, low, high, bins)
    }

    fn points(&self, cells: &[[u64; 3]], level: u8, samples: &mut PointSamples) -> Result<()> {
        samples.start(V::CHANNELS);
        let cells: Vec<_> =
            cells.iter().map(|cell| cell.map(|cell| u32::try_from(cell).unwrap_or(u32::MAX))).collect();
        let mut values = vec![None; cells.len()];
        self.values_at(level, &cells, &mut values)?;
        for value in values {
            samples.push_value::<V>(value);
        }
        Ok(())
    }

    fn solid(&self, level: u8, progress: &dyn Progress) -> Result<SolidStatistics> {
        let filling = Filling::of::<V>(self.header().rule);
        measure(self.octree()?, level, filling, &self.metadata().frame, progress)
    }

    fn rays(&self, level: u8) -> Result<Box<dyn Rays + '_>> {
        let filling = Filling::of::<V>(self.header().rule);
        Ok(Box::new(Field::new(Level::new(self.octree()?, level, filling, level == self.depth())?)))
    }

    fn find(
        &self,
        condition: Condition,
        bounds: Option<Bounds>,
        found: &mut dyn FnMut(FoundBlock) -> Result<bool>,
    ) -> Result<()> {
        Goblin::find(self, condition, bounds, found)
    }

    fn cell_blocks(&self, level: u8, carry: Carry) -> Result<Box<dyn CellBlocks + '_>> {
        Ok(Box::new(SourceBlocks::new(self.octree()?, level, self.header().rule, carry)?))
    }

    fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        Goblin::verify(self, memory, progress)
    }

    fn df_text(&self, most: u64) -> Result<String> {
        let solid = self.header().kind == crate::value::Kind::Continuous && D::AXES == 3;
        df::to_text(&self.in_memory(most)?, if solid { V::splat_f64(255.0) } else { None })
    }

    fn classic_table(&self, most: u64) -> Result<String> {
        dump::classic_table(&self.in_memory(most)?)
    }

    fn leaf_codes(&self, most: u64) -> Result<String> {
        dump::leaf_codes(&self.in_memory(most)?)
    }
}
