//! Views of files as [`Tree`]s: questions are answered through the view, nothing is made beforehand.

use std::path::Path;
use std::sync::Arc;

use zerocopy::FromBytes;

use super::view::View;
use crate::query::cell_blocks::{Carry, CellBlocks, SourceBlocks};
use crate::query::{
    Condition, Field, Filling, FoundBlock, Level, Rays, SolidStatistics, Statistics, Tree, dump, measure,
    node_bounds, octree, source_find, source_histogram, source_statistics,
};
use crate::space::{Bounds, Code, Frame, Oct};
use crate::store::goblin::{Finding, Goblin, Header, Layout, Metadata};
use crate::tree::{Child, MemTree, Source, df};
use crate::value::{Sample, Value};
use crate::{Error, Progress, Result};

/// A file seen through a view. What is told of files (size, segments, checks) is that of the file itself.
pub(crate) struct Viewed<D: Layout, V: Value> {
    view: View<Arc<Goblin<D, V>>>,
    header: Header,
    metadata: Metadata,
}

impl<D: Layout, V: Value> Viewed<D, V> {
    pub(crate) fn new(view: View<Arc<Goblin<D, V>>>, frame: Frame) -> Self {
        let file = view.source();
        let mut header = file.header().clone();
        header.shape.depth = view.depth();
        header.extent = view.extent();
        let metadata = Metadata { frame, ..file.metadata().clone() };
        Viewed { view, header, metadata }
    }

    fn file(&self) -> &Goblin<D, V> {
        self.view.source()
    }

    /// The view with the cells of a level.
    fn at(&self, level: u8) -> Result<View<Arc<Goblin<D, V>>>> {
        match level {
            level if level == self.view.depth() => Ok(self.view.clone()),
            level if level < self.view.depth() => self.view.clone().resolve(level),
            _ => Err(Error::invalid("level", level.to_string(), format!("0 to {}", self.view.depth()))),
        }
    }

    /// The same as an octree.
    fn octree_at(&self, level: u8) -> Result<View<Arc<Goblin<Oct, V>>>> {
        octree(&self.at(level)?).cloned()
    }

    fn in_memory(&self, most: u64) -> Result<MemTree<D, V>> {
        let mut inner = 0;
        let mut pending = vec![self.view.root()?];
        while let Some(place) = pending.pop() {
            if let Child::Inner { node, .. } = place {
                inner += 1;
                if inner > most {
                    let expected = format!("at most {most} to be shown in full");
                    return Err(Error::invalid("tree", format!("more than {most} records"), expected));
                }
                pending.extend(self.view.children(&node)?);
            }
        }
        MemTree::from_source(&self.view, self.header.rule)
    }

    /// The part of a box that is in the picture; all of it if there is no box.
    fn within(&self, bounds: Option<Bounds>) -> Bounds {
        let picture = Bounds { min: [0; 3], max: self.header.extent };
        bounds.map_or(picture, |bounds| bounds.intersect(&picture))
    }
}

/// Draws the cells of a source: see [`Goblin::window`].
fn draw<S: Source>(source: &S, bounds: &Bounds, mut paint: impl FnMut(&Bounds, S::Value)) -> Result<()>
where
    S::Dim: Layout,
{
    let mut pending = vec![(Code::<S::Dim>::ROOT, source.root()?)];
    while let Some((code, place)) = pending.pop() {
        let part = node_bounds(code, source.depth()).intersect(bounds);
        if part.is_empty() {
            continue;
        }
        match place {
            Child::Inner { node, .. } if code.level() < source.depth() => {
                let children = source.children(&node)?.into_iter().enumerate();
                pending.extend(children.map(|(step, child)| (code.child(step), child)));
            }
            _ => place.value().into_iter().for_each(|value| paint(&part, value)),
        }
    }
    Ok(())
}

impl<D: Layout, V: Value> Tree for Viewed<D, V> {
    fn header(&self) -> &Header {
        &self.header
    }

    fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    fn path(&self) -> &Path {
        self.file().path()
    }

    fn file_size(&self) -> u64 {
        self.file().file_size()
    }

    fn segments(&self) -> usize {
        self.file().segments()
    }

    fn stored_records(&self) -> u64 {
        self.file().stored_records()
    }

    fn sections(&self) -> Vec<(&'static str, u64)> {
        self.file().sections()
    }

    fn point(&self, cell: [u64; 3], level: u8, value: &mut [f64; 4]) -> Result<bool> {
        let view = self.at(level)?;
        let mut found = None;
        let bounds = Bounds { min: cell, max: cell.map(|cell| cell.saturating_add(1)) };
        draw(&view, &bounds, |_, value| found = Some(value))?;
        let Some(found) = found else { return Ok(false) };
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
        mut valid: Option<&mut [bool]>,
    ) -> Result<()> {
        let view = self.at(level)?;
        let cells = bounds.volume() as usize;
        let found = format!("{} bytes", bytes.len());
        let wires = <[V::Wire]>::mut_from_bytes_with_elems(bytes, cells);
        let flags = valid.as_ref().map_or(cells, |valid| valid.len());
        let (Ok(wires), true) = (wires, flags == cells) else {
            let expected = format!("{cells} values of {} and as many flags", V::TYPE);
            return Err(Error::invalid("window buffer", found, expected));
        };
        wires.fill(V::from_channels(|_| V::Sample::from_f64_lossy(fill)).to_wire());
        if let Some(valid) = &mut valid {
            valid.fill(false);
        }
        let [width, height, _] = bounds.size().map(|size| size as usize);
        draw(&view, bounds, |part, value| {
            for z in part.min[2]..part.max[2] {
                for y in part.min[1]..part.max[1] {
                    let row = (z - bounds.min[2]) as usize * height + (y - bounds.min[1]) as usize;
                    let start = row * width + (part.min[0] - bounds.min[0]) as usize;
                    let end = start + (part.max[0] - part.min[0]) as usize;
                    wires[start..end].fill(value.to_wire());
                    if let Some(valid) = &mut valid {
                        valid[start..end].fill(true);
                    }
                }
            }
        })
    }

    fn statistics(&self, bounds: Option<Bounds>) -> Result<Statistics> {
        source_statistics(&self.view, &self.within(bounds), self.file().counts_classes())
    }

    fn may_have_void(&self, bounds: Bounds) -> Result<bool> {
        // Looking for VOID everywhere can take as long as drawing everything: a look that is not long enough says yes.
        const PATIENCE: usize = 100_000;
        let picture = Bounds { min: [0; 3], max: self.header.extent };
        if !picture.contains(&bounds) {
            return Ok(true);
        }
        let mut pending = vec![(Code::<D>::ROOT, self.view.root()?)];
        for _ in 0..PATIENCE {
            let Some((code, place)) = pending.pop() else { return Ok(false) };
            if node_bounds(code, self.view.depth()).intersect(&bounds).is_empty() {
                continue;
            }
            match place {
                Child::Void => return Ok(true),
                Child::Leaf(_) => {}
                Child::Inner { node, .. } => {
                    let children = self.view.children(&node)?.into_iter().enumerate();
                    pending.extend(children.map(|(step, child)| (code.child(step), child)));
                }
            }
        }
        Ok(true)
    }

    fn value_bounds(&self) -> Result<Vec<(f64, f64)>> {
        // No view has values beyond its file's.
        self.file().value_bounds()
    }

    fn histogram(&self, bounds: &Bounds, low: f64, high: f64, bins: usize) -> Result<Vec<u64>> {
        source_histogram(&self.view, bounds, (low, high), bins)
    }

    fn solid(&self, level: u8, progress: &dyn Progress) -> Result<SolidStatistics> {
        let view = self.octree_at(level)?;
        let frame = self.metadata.frame.coarser(self.view.depth() - level);
        measure(&view, level, Filling::of::<V>(self.header.rule), &frame, progress)
    }

    fn rays(&self, level: u8) -> Result<Box<dyn Rays + '_>> {
        let filling = Filling::of::<V>(self.header.rule);
        let is_finest = level == self.view.depth();
        Ok(Box::new(Field::new(Level::new(self.octree_at(level)?, level, filling, is_finest)?)))
    }

    fn find(
        &self,
        condition: Condition,
        bounds: Option<Bounds>,
        found: &mut dyn FnMut(FoundBlock) -> Result<bool>,
    ) -> Result<()> {
        source_find(&self.view, condition, &self.within(bounds), found)
    }

    fn cell_blocks(&self, level: u8, carry: Carry) -> Result<Box<dyn CellBlocks + '_>> {
        Ok(Box::new(SourceBlocks::new(self.octree_at(level)?, level, self.header.rule, carry)?))
    }

    fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        self.file().verify(memory, progress)
    }

    fn df_text(&self, most: u64) -> Result<String> {
        let solid = self.header.kind == crate::value::Kind::Continuous && D::AXES == 3;
        df::to_text(&self.in_memory(most)?, if solid { V::splat_f64(255.0) } else { None })
    }

    fn classic_table(&self, most: u64) -> Result<String> {
        dump::classic_table(&self.in_memory(most)?)
    }

    fn leaf_codes(&self, most: u64) -> Result<String> {
        dump::leaf_codes(&self.in_memory(most)?)
    }
}
