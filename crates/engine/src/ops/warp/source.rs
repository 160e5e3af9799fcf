//! Tree of a file on another grid.

use std::sync::Arc;

use super::lattice::{Lattice, Patch};
use super::mapping::CellMap;
use super::options::{Resampling, WarpOptions};
use super::uniform::uniform;
use super::window::{Window, WindowSource, floor};
use super::{area, interpolate, nearest};
use crate::ops::view_source::ViewSource;
use crate::store::depth_for;
use crate::tree::{CellBlock, Child, Children, Source};
use spinney_base::TreeType;
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::value::{Rule, Value};
use spinney_base::{Error, Result};
use spinney_container::{Codec, Header, Metadata, Shape};
use spinney_crs::{Crs, Frame};

/// Grid of cells in the world: the target of a warp.
#[derive(Clone, Debug, PartialEq)]
pub struct WarpGrid {
    /// Position of the cells in the world, in a known coordinate system if the raster's is known.
    pub frame: Frame,
    /// Cells along each axis, 1 along the third.
    pub extent: [u64; 3],
}

/// Raster tree over another grid than its file's, in another coordinate system if need be. Nothing
/// is computed before it is requested.
///
/// A block of 256 x 256 cells is mapped to the source by polynomials that are checked against the
/// projection itself. Where the source is uniform over the block's image, so is the block. Memory:
/// for each block in progress, a window of at most a million source samples, and these as f64.
pub struct Warped {
    source: Arc<ViewSource>,
    header: Header,
    metadata: Metadata,
    map: CellMap,
    resampling: Resampling,
    /// Minimum number of level cells along a side of a target cell; `None` if only the source's
    /// cells are read.
    level_cells: Option<f32>,
    /// Maximum number of levels above the source's cells that blocks are read from: 0 if only cells
    /// are read.
    coarsest: u8,
    /// Cells of the source along each axis.
    extent: [u64; 2],
    /// Box of cells that may have values.
    content: Bounds,
}

/// Levels below the blocks that are drawn at once: 256 x 256 cells.
const BLOCK_LEVELS: u8 = 8;
/// Maximum number of source samples that are read at a time; for a single target cell, source
/// cells.
const MAX_READ: u64 = 1 << 20;
/// Maximum error of polynomials that only locate a block's image, as a fraction of the image's
/// size.
const COARSE: f64 = 0.02;

impl Warped {
    /// Tree of a raster file on a grid. `frame` is the position of the file's cells in the world:
    /// its own frame, or the user's.
    ///
    /// # Errors
    /// If the file is no quadtree, one of the two has no coordinate system that can be computed, or
    /// classes would be interpolated.
    pub fn new(
        source: Arc<ViewSource>,
        frame: &Frame,
        grid: &WarpGrid,
        options: &WarpOptions,
    ) -> Result<Warped> {
        let header = source.header();
        if header.form.dimension != Dimension::Quad {
            let found = format!("{}: {}", source.name().display(), header.form);
            return Err(Error::invalid("tree to warp", found, "a quadtree"));
        }
        let (kind, extent) = (header.kind, header.extent);
        let map = CellMap::new(&grid.frame, frame, extent[0], options.allow_ballpark)?;
        let ratios = ratios(&map, extent);
        let middle = ratios.first().copied().unwrap_or(1.0);
        let resampling = options.resampling.unwrap_or(Resampling::usual(kind, middle));
        resampling.check(kind)?;
        // Coarser cells are at most this many times as large, rounded down to a power of two.
        let most = ratios.iter().copied().fold(1.0, f64::max);
        let level_cells =
            options.level_cells.map(|cells| if resampling.is_of_area() { cells } else { cells.min(1.0) });
        let coarsest = level_cells.map_or(0, |cells| coarser(most, cells).min(header.depth()));
        let depth = depth_for(grid.extent);
        let most = Dimension::Quad.max_depth();
        if depth > most || grid.extent.contains(&0) || grid.extent[2] != 1 {
            let [width, height, _] = grid.extent;
            let found = format!("{width} x {height} cells");
            return Err(Error::invalid(
                "size of the result",
                found,
                format!("1 to 2^{most} cells along each axis"),
            ));
        }
        let crs = grid.frame.crs.as_ref().map_or("other cells".into(), Crs::to_string);
        let provenance = format!("warped to {crs}, {resampling}");
        let own = source.metadata();
        let metadata = Metadata {
            frame: grid.frame.clone(),
            control_points: None,
            provenance: own.provenance.iter().cloned().chain([provenance]).collect(),
            ..own.clone()
        };
        let header = Header {
            codec: Codec::Plain,
            shape: Shape { depth, ..header.shape },
            extent: grid.extent,
            ..header.clone()
        };
        let whole = ([0.0; 2], [extent[0] as f64, extent[1] as f64]);
        let content = reached(&map, whole, 64, grid.extent);
        Ok(Warped {
            source,
            header,
            metadata,
            map,
            resampling,
            level_cells,
            coarsest,
            extent: [extent[0], extent[1]],
            content,
        })
    }

    /// Source of the tree.
    pub fn source(&self) -> &ViewSource {
        &self.source
    }

    /// Header that a file of the tree would have.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Metadata that a file of the tree would have: the source's, on the grid.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// How cells get their values.
    pub fn resampling(&self) -> Resampling {
        self.resampling
    }

    /// Warnings about the accuracy of the two coordinate systems.
    pub fn remarks(&self) -> Vec<String> {
        self.map.remarks()
    }

    /// Box of cells that may have values; all others are VOID.
    pub fn content(&self) -> Bounds {
        self.content
    }

    /// Box that contains all cells affected by a box of source cells (at its deepest level); all
    /// cells if that is unknown.
    pub fn reached_from(&self, bounds: &Bounds) -> Bounds {
        let margin = self.margin();
        let low = [0, 1].map(|axis| bounds.min[axis] as f64 - margin);
        let high = [0, 1].map(|axis| bounds.max[axis] as f64 + margin);
        reached(&self.map, (low, high), 8, self.header.extent).intersect(&self.content)
    }

    /// Node: VOID or a LEAF if its image is uniform.
    ///
    /// # Errors
    /// If the source is corrupt there.
    pub fn node(&self, code: Code) -> Result<Child<Code>> {
        if let Some(value) = self.uniform(code)? {
            return Ok(Child::uniform(value));
        }
        let cells = code.bounds(self.header.depth()).intersect(&self.content);
        let place = |part| self.place(&cells, part);
        let side = self.image(&place).map_or(1.0, |(low, high)| (high[0] - low[0]).max(high[1] - low[1]));
        Ok(Child::Inner { representative: self.in_the_middle(&place, side)?, node: code })
    }

    /// Value of all cells of a node (`None` is VOID); `None` if its image is not uniform, or that
    /// is unknown without reading cells.
    ///
    /// # Errors
    /// If the source is corrupt there.
    pub fn uniform(&self, code: Code) -> Result<Option<Option<Value>>> {
        let cells = code.bounds(self.header.depth()).intersect(&self.content);
        if cells.is_empty() {
            return Ok(Some(None));
        }
        if code.level() == self.header.depth() {
            let mut block = CellBlock::void(1, self.header.form.width());
            self.draw_block(&cells, &mut block)?;
            return Ok(Some(block.present[0].then(|| Value::from_bytes(&block.values))));
        }
        let Some((low, high)) = self.image(&|part| self.place(&cells, part)) else { return Ok(None) };
        let box_of = |low: f64, high: f64, end: u64| {
            let start = floor(low.clamp(-1.0, end as f64 + 1.0));
            (start, floor(high.clamp(-1.0, end as f64 + 1.0)) + 1)
        };
        let (columns, rows) =
            (box_of(low[0], high[0], self.extent[0]), box_of(low[1], high[1], self.extent[1]));
        let beyond = |(start, last): (i64, i64), end: u64| last <= 0 || start >= end as i64;
        if beyond(rows, self.extent[1]) || beyond(columns, self.extent[0]) && self.map.whole_turn().is_none()
        {
            return Ok(Some(None));
        }
        let is_inside = |(start, last): (i64, i64), end: u64| start >= 0 && last <= end as i64;
        if is_inside(columns, self.extent[0])
            && is_inside(rows, self.extent[1])
            && cells == code.bounds(self.header.depth())
        {
            let bounds = Bounds {
                min: [columns.0 as u64, rows.0 as u64, 0],
                max: [columns.1 as u64, rows.1 as u64, 1],
            };
            return uniform(&self.source, &bounds);
        }
        Ok(None)
    }

    /// Source position of a point in a box of cells, given by fractions from 0 to 1 along each
    /// axis.
    fn place(&self, cells: &Bounds, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
        let [width, height, _] = cells.size().map(|cells| cells as f64);
        self.map.to_source([cells.min[0] as f64 + u * width, cells.min[1] as f64 + v * height])
    }

    /// Source value in the middle of a region whose image has `side` cells along a side, at the
    /// level with nodes of that size. (A builder that stores the tree computes averages.)
    fn in_the_middle(&self, place: &dyn Fn([f64; 2]) -> Option<[f64; 2]>, side: f64) -> Result<Value> {
        let shift = (side.max(1.0).log2() as u8).min(self.source.header().depth());
        let middles = [[0.5, 0.5], [0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]];
        for [x, y] in middles.into_iter().filter_map(place) {
            let cell = [floor(x) >> shift, floor(y) >> shift];
            let extent = self.extent.map(|cells| cells.div_ceil(1 << shift));
            let source = WindowSource { file: &self.source, level: self.level(shift), extent, turn: None };
            let window = Window::read(&source, cell, [1, 1])?;
            if window.valid[0] {
                return Ok(Value::from_bytes(&window.bytes));
            }
        }
        Ok(Value::ZERO)
    }

    /// Box around the image of a region, with all source cells that contribute to it; `None` if
    /// that is unknown.
    fn image(&self, place: &dyn Fn([f64; 2]) -> Option<[f64; 2]>) -> Option<([f64; 2], [f64; 2])> {
        let size = {
            let (a, b) = (place([0.0, 0.0])?, place([1.0, 1.0])?);
            (a[0] - b[0]).abs().max((a[1] - b[1]).abs())
        };
        let close = COARSE * size + 0.01;
        let (low, high) = Patch::new(place, close)?.bounds();
        let margin = 4.0 * close + self.margin();
        Some((low.map(|number| number - margin), high.map(|number| number + margin)))
    }

    /// Number of source cells around an image that contribute to it.
    fn margin(&self) -> f64 {
        (self.resampling.reach() + 1.0) * (1u64 << self.coarsest) as f64
    }

    /// Level of the source that is `shift` levels above its cells.
    fn level(&self, shift: u8) -> u8 {
        self.source.header().depth() - shift
    }

    /// Number of levels above the source's cells from which a target block is read.
    fn coarser_for(&self, cells: &Bounds) -> u8 {
        let Some(level_cells) = self.level_cells.filter(|_| self.coarsest > 0) else { return 0 };
        let at = |axis: usize, part: f64| {
            cells.min[axis] as f64 + part * (cells.max[axis] - cells.min[axis]) as f64
        };
        // (The smallest target cells decide: those towards the poles, in web mercator.)
        let ratios = [0.125, 0.5, 0.875].map(|part| self.map.ratio_at([at(0, 0.5), at(1, part)]));
        let ratio = ratios.into_iter().flatten().fold(f64::INFINITY, f64::min);
        if ratio.is_finite() { coarser(ratio, level_cells).min(self.coarsest) } else { 0 }
    }

    /// Draws some cells of a block from a level of the source, in rows of `stride` cells, from a
    /// cell of the block on.
    fn draw_part(
        &self,
        (whole, cells): (&Bounds, &Bounds),
        shift: u8,
        at: [usize; 2],
        stride: usize,
        block: &mut CellBlock,
    ) -> Result<()> {
        let [width, height, _] = cells.size().map(|cells| cells as usize);
        // Corners of cells, or their centres.
        let (more, centre) = if self.resampling.is_of_area() { (1, 0.0) } else { (0, 0.5) };
        let first = [0, 1].map(|axis| whole.min[axis] as f64 + centre);
        let points = [0, 1].map(|axis| (whole.max[axis] - whole.min[axis]) as usize + more);
        let start = [0, 1].map(|axis| (cells.min[axis] - whole.min[axis]) as usize);
        let mut lattice = Lattice::new(&self.map, first, points, (start, [width + more, height + more]));
        lattice.scale(1.0 / (1u64 << shift) as f64);
        let Some((low, high)) = lattice.bounds() else { return Ok(()) };
        let reach = self.resampling.reach();
        let extent = self.extent.map(|cells| cells.div_ceil(1 << shift));
        // (If a turn is not an integer number of coarser cells, these are VOID after the seam.)
        let turn = self.map.whole_turn().filter(|turn| turn % (1 << shift) == 0).map(|turn| turn >> shift);
        let range = |axis: usize| {
            let most = 1e15;
            let (low, high) = (low[axis].clamp(-most, most), high[axis].clamp(-most, most));
            (floor(low - reach), floor(high + reach) + 1)
        };
        let (columns, rows) = (range(0), range(1));
        let beyond = |(start, end): (i64, i64), axis: usize| end <= 0 || start >= extent[axis] as i64;
        if beyond(rows, 1) || turn.is_none() && beyond(columns, 0) {
            return Ok(());
        }
        let size = [columns.1 - columns.0, rows.1 - rows.0].map(|cells| cells as u64);
        let is_cell = width * height == 1;
        let samples_each = if is_cell { 1 } else { u64::from(self.header.form.value.channels) };
        if size[0].saturating_mul(size[1]) > MAX_READ / samples_each {
            if is_cell {
                return self.draw_large((low, high), shift, at[1] * stride + at[0], block);
            }
            let mut is_unread = false;
            for child in 0..4 {
                let part = cells.child(Dimension::Quad, child);
                if !part.is_empty() {
                    let from = [0, 1].map(|axis| at[axis] + (part.min[axis] - cells.min[axis]) as usize);
                    defer_missing(
                        self.draw_part((whole, &part), shift, from, stride, block),
                        &mut is_unread,
                    )?;
                }
            }
            return finish_deferred(is_unread);
        }
        let source = WindowSource { file: &self.source, level: self.level(shift), extent, turn };
        let window = Window::read(&source, [columns.0, rows.0], size.map(|cells| cells as usize))?;
        if width == stride && at == [0, 0] && block.present.len() == width * height {
            self.resample(&window, &lattice, [width, height], block);
            return Ok(());
        }
        let bytes_each = self.header.form.width();
        let mut part = CellBlock::void(width * height, bytes_each);
        self.resample(&window, &lattice, [width, height], &mut part);
        for row in 0..height {
            let (from, to) = (row * width, (at[1] + row) * stride + at[0]);
            block.present[to..to + width].copy_from_slice(&part.present[from..from + width]);
            let (from, to) = (from * bytes_each, to * bytes_each);
            let bytes = width * bytes_each;
            block.values[to..to + bytes].copy_from_slice(&part.values[from..from + bytes]);
        }
        Ok(())
    }

    /// Sets a cell whose image exceeds the read limit to the value in the middle of the image.
    fn draw_large(
        &self,
        (low, high): ([f64; 2], [f64; 2]),
        shift: u8,
        index: usize,
        block: &mut CellBlock,
    ) -> Result<()> {
        let place = [0, 1].map(|axis| floor(low[axis].midpoint(high[axis])));
        let extent = self.extent.map(|cells| cells.div_ceil(1 << shift));
        let turn = self.map.whole_turn().filter(|_| shift == 0);
        let source = WindowSource { file: &self.source, level: self.level(shift), extent, turn };
        let window = Window::read(&source, place, [1, 1])?;
        let bytes_each = self.header.form.width();
        block.present[index] = window.valid[0];
        block.values[index * bytes_each..(index + 1) * bytes_each].copy_from_slice(&window.bytes);
        Ok(())
    }

    fn resample(&self, window: &Window, lattice: &Lattice, size: [usize; 2], block: &mut CellBlock) {
        match self.resampling {
            Resampling::Nearest => nearest::pick(self.header.form, window, lattice, size, block),
            Resampling::Bilinear => interpolate::interpolate(window, lattice, size, false, block),
            Resampling::Cubic => interpolate::interpolate(window, lattice, size, true, block),
            Resampling::Area => {
                let is_occupancy = self.header.rule == Rule::Occupancy;
                let rule = if is_occupancy { Rule::Occupancy } else { Rule::Mean };
                area::cover(window, lattice, size, rule, block);
            }
            Resampling::Majority => area::cover(window, lattice, size, Rule::Majority, block),
        }
    }
}

/// Number of source cells along a side of a target cell (the square root of the area ratio) at
/// several positions, the middle of the source first.
fn ratios(map: &CellMap, extent: [u64; 3]) -> Vec<f64> {
    let steps = [0.5, 0.1, 0.3, 0.7, 0.9];
    let positions = steps.into_iter().flat_map(|v| steps.into_iter().map(move |u| [u, v]));
    let ratio = |[u, v]: [f64; 2]| map.ratio_at(map.to_target([extent[0] as f64 * u, extent[1] as f64 * v])?);
    positions.filter_map(ratio).collect()
}

/// Number of levels up to the coarsest one with at least `level_cells` cells along a side of target
/// cells with `ratio` source cells.
fn coarser(ratio: f64, level_cells: f32) -> u8 {
    (ratio / f64::from(level_cells)).log2().floor().clamp(0.0, 63.0) as u8
}

/// Target cells that a box of the source can affect: the bounding box of the images of a lattice of
/// `steps` intervals, with a margin of the distance between neighbours. All cells if that is
/// inconclusive.
fn reached(map: &CellMap, (from, to): ([f64; 2], [f64; 2]), steps: usize, target: [u64; 3]) -> Bounds {
    let all = Bounds::of_extent(target);
    if map.target_turns() {
        return all;
    }
    let point = |x: usize, y: usize| {
        let at = |axis: usize, step: usize| from[axis] + (to[axis] - from[axis]) * step as f64 / steps as f64;
        map.to_target([at(0, x), at(1, y)])
    };
    let (mut low, mut high, mut spacing) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2], [0f64; 2]);
    let mut above: Vec<[f64; 2]> = Vec::new();
    for y in 0..=steps {
        let row: Option<Vec<[f64; 2]>> = (0..=steps).map(|x| point(x, y)).collect();
        let Some(row) = row else { return all };
        for axis in 0..2 {
            for place in &row {
                (low[axis], high[axis]) = (low[axis].min(place[axis]), high[axis].max(place[axis]));
            }
            let along_row = row.windows(2).map(|pair| (pair[0], pair[1]));
            let below = above.iter().copied().zip(row.iter().copied());
            for (a, b) in along_row.chain(below) {
                spacing[axis] = spacing[axis].max((a[axis] - b[axis]).abs());
            }
        }
        above = row;
    }
    // Neighbours that are far apart are on two sides of a seam, or around a pole.
    if (0..2).any(|axis| spacing[axis] > target[axis] as f64 / 4.0) {
        return all;
    }
    let mut bounds = all;
    for axis in 0..2 {
        let margin = spacing[axis] + 4.0;
        bounds.min[axis] = (low[axis] - margin).clamp(0.0, target[axis] as f64) as u64;
        bounds.max[axis] = (high[axis] + margin).ceil().clamp(0.0, target[axis] as f64) as u64;
    }
    bounds
}

impl Source for Warped {
    type Node = Code;

    fn form(&self) -> TreeType {
        self.header.form
    }

    fn depth(&self) -> u8 {
        self.header.depth()
    }

    fn root(&self) -> Result<Child<Code>> {
        self.node(Code::root(Dimension::Quad))
    }

    fn children(&self, node: &Code, children: &mut Children<Code>) -> Result<()> {
        for (step, child) in children[..4].iter_mut().enumerate() {
            *child = self.node(node.child(step))?;
        }
        Ok(())
    }

    fn cells(&self, node: &Code, levels: u8) -> Result<Option<CellBlock>> {
        if levels > BLOCK_LEVELS {
            return Ok(None);
        }
        let bounds = node.bounds(self.header.depth());
        let mut block = CellBlock::void(bounds.volume() as usize, self.header.form.width());
        self.draw_block(&bounds, &mut block)?;
        Ok(Some(block))
    }

    fn draw(&self, bounds: &Bounds, values: &mut [u8], valid: &mut [bool]) -> Result<bool> {
        let mut block = CellBlock::void(valid.len(), self.header.form.width());
        self.draw_block(bounds, &mut block)?;
        values.copy_from_slice(&block.values);
        valid.copy_from_slice(&block.present);
        Ok(true)
    }

    fn check_unchanged(&self) -> Result<()> {
        self.source.check_unchanged()
    }
}

impl Warped {
    /// Draws a box of cells, in sub-boxes that lie within one block of the tree each: a cell's
    /// value does not depend on the box.
    fn draw_block(&self, bounds: &Bounds, block: &mut CellBlock) -> Result<()> {
        let side = 1u64 << BLOCK_LEVELS;
        let stride = bounds.size()[0] as usize;
        let inside = bounds.intersect(&self.content);
        if inside.is_empty() {
            return Ok(());
        }
        let mut is_unread = false;
        for y in inside.min[1] / side..inside.max[1].div_ceil(side) {
            for x in inside.min[0] / side..inside.max[0].div_ceil(side) {
                let whole = Bounds { min: [x * side, y * side, 0], max: [(x + 1) * side, (y + 1) * side, 1] };
                let part = whole.intersect(&inside);
                let at = [0, 1].map(|axis| (part.min[axis] - bounds.min[axis]) as usize);
                let drawn = self.draw_part((&whole, &part), self.coarser_for(&whole), at, stride, block);
                defer_missing(drawn, &mut is_unread)?;
            }
        }
        finish_deferred(is_unread)
    }
}
