//! Views of files as [`Tree`]s: questions are answered through the view, nothing is made beforehand.

use std::path::Path;
use std::sync::Arc;

use super::view::View;
use crate::query::cell_blocks::{Carry, CellBlocks, SourceBlocks};
use crate::query::{
    Canvas, Condition, Field, Filling, FoundBlock, Level, Rays, SolidStatistics, Statistics, Tree, as_tree,
    dump, fill_value, measure, node_bounds, octree, source_find, source_histogram, source_statistics,
    wires_of,
};
use crate::space::{Bounds, Code, Frame, Oct};
use crate::store::autumnal::Commit;
use crate::store::goblin::{Finding, Header, Layout, Metadata};
use crate::store::{File, TreeFormat};
use crate::tree::{Child, MemTree, Source, df};
use crate::value::{Sample, Value};
use crate::{Error, Progress, Result};

/// A file seen through a view. What is told of files (size, segments, checks) is that of the file itself.
pub(crate) struct Viewed<D: Layout, V: Value> {
    view: View<Arc<File<D, V>>>,
    header: Header,
    metadata: Metadata,
}

impl<D: Layout, V: Value> Viewed<D, V> {
    pub(crate) fn new(view: View<Arc<File<D, V>>>, frame: Frame) -> Self {
        let file = view.source();
        let mut header = file.header().clone();
        header.shape.depth = view.depth();
        header.extent = view.extent();
        let metadata = Metadata { frame, ..file.metadata().clone() };
        Viewed { view, header, metadata }
    }

    fn file(&self) -> &File<D, V> {
        self.view.source()
    }

    /// The view with the cells of a level.
    fn at(&self, level: u8) -> Result<View<Arc<File<D, V>>>> {
        match level {
            level if level == self.view.depth() => Ok(self.view.clone()),
            level if level < self.view.depth() => self.view.clone().resolve(level),
            _ => Err(Error::invalid("level", level.to_string(), format!("0 to {}", self.view.depth()))),
        }
    }

    /// The same as an octree.
    fn octree_at(&self, level: u8) -> Result<View<Arc<File<Oct, V>>>> {
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

impl<D: Layout, V: Value> Tree for Viewed<D, V> {
    fn format(&self) -> TreeFormat {
        as_tree(self.file()).format()
    }

    fn commit(&self) -> Option<&Commit> {
        as_tree(self.file()).commit()
    }

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
        as_tree(self.file()).file_size()
    }

    fn segments(&self) -> usize {
        as_tree(self.file()).segments()
    }

    fn stored_records(&self) -> u64 {
        as_tree(self.file()).stored_records()
    }

    fn sections(&self) -> Vec<(&'static str, u64)> {
        as_tree(self.file()).sections()
    }

    fn point(&self, cell: [u64; 3], level: u8, value: &mut [f64; 4]) -> Result<bool> {
        let view = self.at(level)?;
        let bounds = Bounds { min: cell, max: cell.map(|cell| cell.saturating_add(1)) };
        let (mut found, mut valid) = ([V::default().to_wire()], [false]);
        let mut canvas = Canvas::<V>::new(&bounds, V::default(), &mut found, Some(&mut valid))?;
        canvas.draw(&view, view.root()?, view.depth())?;
        for (number, sample) in value.iter_mut().zip(V::from_wire(found[0]).samples()) {
            *number = sample.to_f64();
        }
        Ok(valid[0])
    }

    fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: f64,
        bytes: &mut [u8],
        valid: Option<&mut [bool]>,
    ) -> Result<()> {
        let view = self.at(level)?;
        let values = wires_of::<V>(bytes, bounds.volume())?;
        Canvas::new(bounds, fill_value(fill), values, valid)?.draw(&view, view.root()?, view.depth())
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
        as_tree(self.file()).value_bounds()
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
        as_tree(self.file()).verify(memory, progress)
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
