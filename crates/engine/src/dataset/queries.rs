//! Queries of a dataset: cells, windows, statistics, searches.

use std::sync::Arc;

use super::{Dataset, Tree};
use crate::ops::{CombineOperation, Combined, TreeFile, View, ViewSource, void_advice};
use crate::query::{
    Condition, FoundBlock, PointSamples, Statistics, StoredRows, autumnal_histogram, autumnal_statistics,
    check_level, source_find, source_histogram, source_statistics, values_one_by_one,
};
use crate::query::{PixelGrid, PixelSums};
use crate::store::goblin::LevelBytes;
use crate::tree::{Child, Source, no_children};
use spinney_base::io::batch::run_batched;
use spinney_base::space::{Bounds, Cell, Code};
use spinney_base::value::{Number, Value};
use spinney_base::{Progress, Result, SetOperation};
use spinney_container::LevelCounts;

impl Dataset {
    /// Reads the value of one cell of a level into `value`, a number per channel. Returns `false`
    /// for VOID, also outside of the tree.
    ///
    /// # Errors
    /// If the file is corrupt there; for a view also if the level does not exist.
    pub fn point(&self, cell: [u64; 3], level: u8, value: &mut [Number; 4]) -> Result<bool> {
        let found = run_batched(|| match &self.tree {
            Tree::View(viewed) => {
                let mut found = [None];
                viewed.values_at(level, &[cell], &mut found)?;
                Ok(found[0])
            }
            _ if level > self.depth() => Ok(None),
            Tree::Goblin(file) => self.code(level, saturated(cell)).map_or(Ok(None), |at| file.value_at(at)),
            Tree::Autumnal(file) => {
                self.code(level, saturated(cell)).map_or(Ok(None), |at| file.value_at(at))
            }
        })?;
        if let Some(found) = found {
            let numbers = self.header().form.value.numbers(found);
            value[..numbers.len()].copy_from_slice(&numbers);
        }
        Ok(found.is_some())
    }

    /// Reads the values of many cells of a level into `samples`, in the order of the cells, and
    /// discards the former contents of `samples`. For large numbers of cells this is much faster
    /// than single queries.
    ///
    /// # Errors
    /// If the file is corrupt there, or the level is too deep.
    pub fn points(&self, cells: &[[u64; 3]], level: u8, samples: &mut PointSamples) -> Result<()> {
        let value_type = self.header().form.value;
        let values = samples.start(value_type, cells.len());
        let plain = || cells.iter().map(|cell| saturated(*cell)).collect::<Vec<Cell>>();
        match &self.tree {
            Tree::Goblin(file) => file.values_at(level, &plain(), values),
            Tree::Autumnal(file) => {
                let dimension = self.header().form.dimension;
                values_one_by_one((dimension, level, false), &plain(), values, &|code| file.value_at(code))
            }
            Tree::View(viewed) => run_batched(|| viewed.values_at(level, cells, values)),
        }
    }

    /// Returns the state of a node: VOID or LEAF, with the value, if all of its cells are; else
    /// INNER, with a representative that may be zero instead. Costs one look-up, whatever is below
    /// the node. INNER is not guaranteed to have different cells below: such a node may be uniform
    /// in a view, and within dense blocks.
    ///
    /// ```
    /// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
    /// use spinney::{Code, Dimension};
    /// use spinney::tree::NodeState;
    ///
    /// let map = spinney::open("fixtures/v1/classes.goblin")?;
    /// assert_eq!(map.node(Code::root(Dimension::Quad))?.state(), NodeState::Inner);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the file is corrupt there, or the node is deeper than the tree.
    pub fn node(&self, code: Code) -> Result<Child<()>> {
        check_level(code.level(), self.depth())?;
        run_batched(|| match &self.tree {
            Tree::Goblin(file) => Ok(file.locate(code)?.map_node(drop)),
            Tree::Autumnal(file) => source_node(&**file, code),
            Tree::View(viewed) => source_node(viewed.view(), code),
        })
    }

    /// Returns the code of a cell of a level; `None` outside of the space.
    fn code(&self, level: u8, cell: Cell) -> Option<Code> {
        Code::from_cell(self.header().form.dimension, level, cell)
    }

    /// Reads a box of cells of a level: x fastest, then y, then z; the samples of a cell are
    /// consecutive and little-endian. VOID cells get the sample nearest to `fill` in every channel,
    /// and `false` in `valid` if that is given.
    ///
    /// `bytes` must have `bounds.volume() * header().form.width()` bytes, `valid` one flag per
    /// cell.
    ///
    /// # Errors
    /// If the file is corrupt there, the level is too deep, or a buffer has the wrong size.
    pub fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: impl Into<Number>,
        bytes: &mut [u8],
        valid: Option<&mut [bool]>,
    ) -> Result<()> {
        self.draw(level, bounds, fill.into(), bytes, valid)
    }

    fn draw(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: Number,
        bytes: &mut [u8],
        mut valid: Option<&mut [bool]>,
    ) -> Result<()> {
        let fill: Value = self.header().form.value.nearest_numbers(|_| fill);
        run_batched(|| {
            let valid = valid.as_deref_mut();
            match &self.tree {
                Tree::Goblin(file) => file.window(level, bounds, fill, bytes, valid).map(|_| ()),
                Tree::Autumnal(file) => file.window(level, bounds, fill, bytes, valid),
                Tree::View(viewed) => viewed.window(level, bounds, fill, bytes, valid),
            }
        })
    }

    /// Returns a box of cells of a level without a copy, as it is stored in the file; `None` if the
    /// box is not stored as rows, so that [`Dataset::window`] must read it. See [`StoredRows`] and
    /// [`Goblin::stored_rows`](crate::store::goblin::Goblin::stored_rows).
    ///
    /// # Errors
    /// If the file is corrupt there, or the level is too deep.
    pub fn stored_rows(&self, level: u8, bounds: &Bounds) -> Result<Option<StoredRows<'_>>> {
        match &self.tree {
            Tree::Goblin(file) => file.stored_rows(level, bounds),
            Tree::Autumnal(_) | Tree::View(_) => Ok(None),
        }
    }

    /// Returns the exact statistics of a box of cells (of the deepest level); without a box, of the
    /// whole extent.
    ///
    /// # Errors
    /// If the file is corrupt there, or on cancellation.
    pub fn statistics(&self, bounds: Option<Bounds>, progress: &dyn Progress) -> Result<Statistics> {
        run_batched(|| match &self.tree {
            Tree::View(viewed) => {
                let counts_classes = self.header().counts_classes();
                let within = self.header().within_extent(bounds);
                source_statistics(viewed.view(), &within, counts_classes, progress)
            }
            Tree::Goblin(file) => file.statistics(bounds, progress),
            Tree::Autumnal(file) => {
                let counts_classes = self.header().counts_classes();
                let within = self.header().within_extent(bounds);
                autumnal_statistics(file, &within, counts_classes, progress)
            }
        })
    }

    /// Returns statistics without class counts; for a view, those of its source.
    fn totals(&self, bounds: Option<Bounds>) -> Result<Statistics> {
        let within = self.header().within_extent(bounds);
        run_batched(|| match &self.tree {
            Tree::Goblin(file) => file.statistics_with(Some(within), false, &()),
            Tree::Autumnal(file) => autumnal_statistics(file, &within, false, &()),
            Tree::View(viewed) => viewed.source().totals(bounds),
        })
    }

    /// Sums up the cells that each pixel covers: see [`PixelSums`].
    ///
    /// # Errors
    /// If the file is corrupt there, or on cancellation.
    pub fn pixel_sums<'a>(
        &self,
        bounds: &Bounds,
        grid: PixelGrid,
        base: Value,
        progress: &'a dyn Progress,
    ) -> Result<PixelSums<'a>> {
        run_batched(|| match &self.tree {
            Tree::Goblin(file) => PixelSums::of_file(file, bounds, grid, base, progress),
            Tree::Autumnal(file) => PixelSums::of_source(&**file, bounds, grid, base, progress),
            Tree::View(viewed) => PixelSums::of_source(viewed.view(), bounds, grid, base, progress),
        })
    }

    /// Returns the number of nodes in the file's tree by level and state. Goblin files store it.
    /// For Autumnal files the nodes are counted; `None` if they have more than `most` records.
    ///
    /// # Errors
    /// If the file is corrupt, or on cancellation.
    pub fn level_counts(&self, most: u64, progress: &dyn Progress) -> Result<Option<LevelCounts>> {
        match self.file() {
            Some(TreeFile::Autumnal(file)) => file.level_counts(most, progress),
            Some(TreeFile::Goblin(file)) => Ok(Some(file.metadata().counts.clone())),
            Some(TreeFile::Mosaic(_)) | None => Ok(None),
        }
    }

    /// Returns the bytes of a Goblin file's segments by the level of their nodes, from the segment
    /// index; `None` if the file has more than `most` segments, or is not a Goblin file.
    ///
    /// # Errors
    /// If the segment index is corrupt.
    pub fn level_bytes(&self, most: usize) -> Result<Option<Vec<LevelBytes>>> {
        match self.file() {
            Some(TreeFile::Goblin(file)) if file.segments() <= most => {
                run_batched(|| file.level_bytes()).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// Returns whether some cells of a box may be VOID; `false` is certain. For views it is cheaper
    /// than statistics.
    ///
    /// # Errors
    /// If the file is corrupt there.
    pub fn may_have_void(&self, bounds: Bounds) -> Result<bool> {
        match &self.tree {
            Tree::View(viewed) => run_batched(|| viewed.may_have_void(&bounds)),
            _ => {
                // (A box that reaches out of the raster contains VOID cells, and a box in a raster
                // without VOID contains none. Neither case needs the statistics of the box, whose
                // border can be long.)
                let extent = self.header().extent_bounds();
                if !extent.contains(&bounds) {
                    return Ok(!bounds.is_empty());
                }
                let is_whole = self.totals(None)?.cells >= extent.volume();
                Ok(!is_whole && self.totals(Some(bounds))?.cells < bounds.volume())
            }
        }
    }

    /// Returns the command that makes 0 VOID, for a tree without VOID in which 0 may mean
    /// "nothing". Without VOID, the only surface of the cells is that of the whole tree. `None` if
    /// some cells are VOID, no cell is 0, or cells are computed.
    ///
    /// # Errors
    /// If the file is corrupt.
    pub fn void_advice(&self) -> Result<Option<String>> {
        let name = self.name().display().to_string();
        match &self.tree {
            Tree::View(viewed) => void_advice(&name, viewed.source()),
            _ => self.as_file().map_or(Ok(None), |file| void_advice(&name, &file.into())),
        }
    }

    /// Returns minimum and maximum of all values, per channel, as f64; empty if there are no
    /// values.
    ///
    /// # Errors
    /// If the file is corrupt there.
    pub fn value_bounds(&self) -> Result<Vec<(f64, f64)>> {
        Ok(self.exact_bounds()?.into_iter().map(|(min, max)| (min.to_f64(), max.to_f64())).collect())
    }

    /// Returns the exact minimum and maximum of all values, per channel; empty if there are no
    /// values.
    ///
    /// # Errors
    /// If the file is corrupt there.
    pub fn exact_bounds(&self) -> Result<Vec<(Number, Number)>> {
        // (For a tree on another grid they are those of its source: see `Dataset::outer_bounds`.)
        let statistics = self.totals(None)?;
        Ok(statistics.channels.iter().map(|channel| (channel.min, channel.max)).collect())
    }

    /// Returns the number of a box's cells (of the deepest level) whose first channel lies in each
    /// of `bins` equal intervals of `low ..= high`.
    ///
    /// # Errors
    /// If the file is corrupt there, or on cancellation.
    pub fn histogram(
        &self,
        bounds: &Bounds,
        low: f64,
        high: f64,
        bins: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<u64>> {
        run_batched(|| match &self.tree {
            Tree::Goblin(file) => file.histogram(bounds, low, high, bins, progress),
            Tree::Autumnal(file) => autumnal_histogram(file, bounds, (low, high), bins, progress),
            Tree::View(viewed) => source_histogram(viewed.view(), bounds, (low, high), bins, progress),
        })
    }

    /// Finds the largest blocks in a box all of whose cells meet a condition, and passes them to
    /// `found` in FD order until that returns `false`. The box is in cells of the deepest level;
    /// without one, the whole extent is searched. VOID meets no condition.
    ///
    /// # Errors
    /// If the file is corrupt there, `found` fails, or on cancellation.
    pub fn find(
        &self,
        condition: Condition,
        bounds: Option<Bounds>,
        progress: &dyn Progress,
        found: &mut dyn FnMut(FoundBlock) -> Result<bool>,
    ) -> Result<()> {
        let within = self.header().within_extent(bounds);
        find_in_rounds(found, &mut |found| match &self.tree {
            Tree::Goblin(file) => file.find(condition, bounds, progress, found),
            Tree::Autumnal(file) => source_find(&**file, condition, &within, progress, found),
            Tree::View(viewed) => source_find(viewed.view(), condition, &within, progress, found),
        })
    }

    /// [`Dataset::find`] restricted to the cells that are not VOID in another tree on the same
    /// grid, such as a tree of zones.
    ///
    /// # Errors
    /// Those of [`Dataset::find`], and of computing the other tree's cells; if that has another
    /// tree type or depth.
    pub fn find_within(
        &self,
        condition: Condition,
        zones: &Arc<ViewSource>,
        bounds: Option<Bounds>,
        progress: &dyn Progress,
        found: &mut dyn FnMut(FoundBlock) -> Result<bool>,
    ) -> Result<()> {
        let view = match &self.tree {
            Tree::Goblin(file) => View::whole(TreeFile::Goblin(file.clone()).into())?,
            Tree::Autumnal(file) => View::whole(TreeFile::Autumnal(file.clone()).into())?,
            Tree::View(viewed) => viewed.view().clone(),
        };
        let both = CombineOperation::set(SetOperation::Intersection);
        let extent = view.extent();
        let views = vec![view, View::new(zones.clone(), extent)?];
        let inside = Combined::new(views, both, extent)?;
        let within = self.header().within_extent(bounds);
        find_in_rounds(found, &mut |found| source_find(&inside, condition, &within, progress, found))
    }
}

/// Receives found blocks; returns whether to continue.
type BlockVisitor<'a> = dyn FnMut(FoundBlock) -> Result<bool> + 'a;

/// Searches in batches. A restarted search finds the same blocks in the same order, and each block
/// is passed on once.
fn find_in_rounds(
    found: &mut BlockVisitor<'_>,
    search: &mut dyn FnMut(&mut BlockVisitor<'_>) -> Result<()>,
) -> Result<()> {
    let mut handed_out = 0u64;
    run_batched(|| {
        let mut number = 0;
        search(&mut |block| {
            number += 1;
            if number <= handed_out {
                return Ok(true);
            }
            handed_out = number;
            found(block)
        })
    })
}

/// Returns the state of a source's node, by descending from the root.
fn source_node<S: Source>(source: &S, code: Code) -> Result<Child<()>> {
    let (mut child, mut children) = (source.root()?, no_children());
    for level in 0..code.level() {
        let Child::Inner { node, .. } = &child else { break };
        source.children(node, &mut children)?;
        child = std::mem::take(&mut children[code.step(level)]);
    }
    Ok(child.map_node(drop))
}

/// Converts coordinates, saturating those that are too large for any tree.
fn saturated(cell: [u64; 3]) -> Cell {
    cell.map(|cell| u32::try_from(cell).unwrap_or(u32::MAX))
}
