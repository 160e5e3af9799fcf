//! Tiles that are nodes of a tree.

use super::source::{GeographicExtent, TileContent, TileSamples, TileSource};
use super::tile_id::{MAX_ZOOM, TileId, TileRange};
use super::warped::degrees_of;
use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::value::ValueType;
use spinney_base::{Error, Result};
use spinney_crs::{Frame, web_mercator, web_mercator_depth};
use spinney_engine::dataset::Dataset;

/// Level of the world square at which the columns with data are determined.
const COLUMN_LEVEL: u8 = 8;

/// Returns the start and the length of the longest run of unset flags.
fn widest_gap(flags: &[bool]) -> (usize, usize) {
    let (mut widest, mut start) = ((0, 0), 0);
    for (index, flag) in flags.iter().chain([&true]).enumerate() {
        if *flag {
            if index - start > widest.1 {
                widest = (start, index - start);
            }
            start = index + 1;
        }
    }
    widest
}

/// Tiles of a tree's own square: each is a node of the tree.
pub struct TreeTiles<'a> {
    tree: &'a Dataset,
    depth: u8,
    /// Whether the square is the world in web mercator.
    is_world: bool,
}

impl<'a> TreeTiles<'a> {
    /// Returns the tiles of a tree, if its root is the world square in web mercator; see
    /// [`web_mercator_depth`].
    pub fn world(tree: &'a Dataset) -> Option<TreeTiles<'a>> {
        let header = tree.header();
        let depth = web_mercator_depth(&tree.metadata().frame, header.extent)?;
        let is_tree = header.form.dimension == Dimension::Quad && depth == tree.depth();
        is_tree.then_some(TreeTiles { tree, depth, is_world: true })
    }

    /// Returns the tiles of a quadtree's own square, wherever it is. Zoom 0 has all of it, with the
    /// first cell in its north-western corner.
    pub fn native(tree: &'a Dataset) -> TreeTiles<'a> {
        TreeTiles { tree, depth: tree.depth(), is_world: false }
    }
}

impl TileSource for TreeTiles<'_> {
    fn value_type(&self) -> ValueType {
        self.tree.header().form.value
    }

    fn frame(&self, level: u8) -> Frame {
        if self.is_world {
            return web_mercator(level);
        }
        let frame = &self.tree.metadata().frame;
        match self.depth.checked_sub(level) {
            Some(shift) => frame.coarser(shift),
            None => frame.finer(level - self.depth),
        }
    }

    fn max_zoom(&self, side: usize) -> u8 {
        self.depth.saturating_sub(side.trailing_zeros() as u8).min(MAX_ZOOM)
    }

    fn degrees(&self) -> [f64; 4] {
        let world = TileRange::world(0).degrees(0);
        if self.is_world {
            return world;
        }
        degrees_of(&self.tree.metadata().frame, self.tree.header().extent, true).unwrap_or(world)
    }

    fn data_place(&self) -> Result<GeographicExtent> {
        let data = if self.is_world { self.tree.data_box()? } else { None };
        let Some(data) = data else { return Ok(GeographicExtent::of_bounds(self.degrees())) };
        let cells = |corner: [u64; 3]| [corner[0] as u32, corner[1] as u32];
        let range = TileRange { min: cells(data.min), max: cells(data.max) };
        let mut place = GeographicExtent::of_bounds(range.degrees(self.depth));
        // If a wide gap separates data in the west from data in the east, they are neighbours
        // across the antimeridian.
        let level = self.depth.min(COLUMN_LEVEL);
        let side = 1usize << level;
        let all = Bounds::space(Dimension::Quad, level);
        let width = self.value_type().size();
        let (mut values, mut valid) = (vec![0; side * side * width], vec![false; side * side]);
        self.tree.window(level, &all, 0.0, &mut values, Some(&mut valid))?;
        let has_data: Vec<bool> =
            (0..side).map(|column| valid.iter().skip(column).step_by(side).any(|is| *is)).collect();
        let (start, length) = widest_gap(&has_data);
        // (A gap at the edge of the map does not separate data.)
        if start > 0 && start + length < side && length > side / 4 {
            let middle = (start + length) as f64 + (side - length) as f64 / 2.0;
            place.centre[0] = (middle / side as f64 * 360.0).rem_euclid(360.0) - 180.0;
        }
        Ok(place)
    }

    fn content(&self, tile: TileId) -> Result<TileContent> {
        let TileId { zoom, column, row } = tile;
        let level = zoom.min(self.depth);
        let cell = [column, row, 0].map(|at| at >> (zoom - level));
        let code = Code::from_cell(Dimension::Quad, level, cell);
        let code =
            code.ok_or_else(|| Error::invalid("tile", format!("{zoom}/{column}/{row}"), "one of the world"))?;
        Ok(self.tree.node(code)?.into())
    }

    fn tile(&self, tile: TileId, side: usize, margin: usize, samples: &mut TileSamples) -> Result<()> {
        let width = self.value_type().size();
        // The level with the tile's cells, or the deepest one if the tree has no such level.
        let wanted = tile.zoom + side.trailing_zeros() as u8;
        let level = wanted.min(self.depth);
        let shift = wanted - level;
        samples.draw(tile, (side, margin), width, self.is_world, &|cells, values, valid| {
            if shift == 0 {
                return self.tree.window(level, cells, 0.0, values, Some(valid));
            }
            let coarse = Bounds {
                min: cells.min.map(|at| at >> shift),
                max: cells.max.map(|at| ((at - 1) >> shift) + 1),
            };
            let across = coarse.size()[0] as usize;
            let count = coarse.volume() as usize;
            let (mut from, mut is_there) = (vec![0; count * width], vec![false; count]);
            self.tree.window(level, &coarse, 0.0, &mut from, Some(&mut is_there))?;
            let columns = cells.size()[0] as usize;
            for (number, y) in (cells.min[1]..cells.max[1]).enumerate() {
                let first = number * columns;
                if number > 0 && y >> shift == (y - 1) >> shift {
                    // The row above has the same cells.
                    values.copy_within((first - columns) * width..first * width, first * width);
                    valid.copy_within(first - columns..first, first);
                    continue;
                }
                let row = ((y >> shift) - coarse.min[1]) as usize * across;
                let to = values[first * width..].chunks_exact_mut(width).zip(&mut valid[first..]);
                for (x, (value, valid)) in (cells.min[0]..cells.max[0]).zip(to) {
                    let cell = row + ((x >> shift) - coarse.min[0]) as usize;
                    *valid = is_there[cell];
                    value.copy_from_slice(&from[cell * width..][..width]);
                }
            }
            Ok(())
        })
    }

    fn tiles_of(&self, block: Code, zoom: u8) -> TileRange {
        let (level, column, row) = block.zxy();
        if level <= zoom {
            return TileRange::below(TileId { zoom: level, column, row }, zoom);
        }
        let min = [column, row].map(|at| at >> (level - zoom));
        TileRange { min, max: min.map(|at| at + 1) }
    }

    fn block_level(&self, zoom: u8) -> u8 {
        zoom
    }

    fn check_unchanged(&self) -> Result<()> {
        self.tree.check_unchanged()
    }
}
