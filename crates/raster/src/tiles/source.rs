//! Samples that tiles are made of, on the grid of web mercator.

use super::place::{MAX_ZOOM, TileId, TileRange};
use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::value::{Value, ValueType};
use spinney_base::{Error, Result};
use spinney_crs::web_mercator_depth;
use spinney_engine::dataset::Dataset;
use spinney_engine::tree::Child;

/// Knowledge of a tile without drawing it, and so of all tiles below it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TileContent {
    /// Nothing is there.
    Empty,
    /// All of its cells have this value.
    Uniform(Value),
    /// It must be drawn. It may turn out to be uniform.
    Detail,
}

impl<N> From<Child<N>> for TileContent {
    fn from(node: Child<N>) -> TileContent {
        match node {
            Child::Void => TileContent::Empty,
            Child::Leaf(value) => TileContent::Uniform(value),
            Child::Inner { .. } => TileContent::Detail,
        }
    }
}

/// The samples of a tile with some cells around it: `side` rows of `side` cells, north first.
#[derive(Clone, Debug, Default)]
pub struct TileSamples {
    /// Cells along each side, those around the tile included.
    pub side: usize,
    /// Values, little-endian, a cell's samples together.
    pub values: Vec<u8>,
    /// Whether each cell has a value; `false` is VOID.
    pub valid: Vec<bool>,
}

impl TileSamples {
    /// Makes room for so many cells along each side, of values of so many bytes, all VOID.
    pub fn start(&mut self, side: usize, width: usize) {
        self.side = side;
        self.values.clear();
        self.values.resize(side * side * width, 0);
        self.valid.clear();
        self.valid.resize(side * side, false);
    }

    /// Gives all cells one value, or makes them VOID.
    pub fn fill(&mut self, side: usize, width: usize, value: Option<Value>) {
        self.start(side, width);
        if let Some(value) = value {
            self.values
                .chunks_exact_mut(width)
                .for_each(|cell| cell.copy_from_slice(&value.to_bytes()[..width]));
            self.valid.fill(true);
        }
    }

    /// Draws a tile of `side` cells a side, with `margin` cells around it, by boxes of the world's cells at the tile's zoom: its columns
    /// go on behind the antimeridian, its rows end at the poles. `draw` gives each cell of a box its value of `width` bytes.
    ///
    /// # Errors
    /// Those of `draw`.
    pub(super) fn draw(
        &mut self,
        tile: TileId,
        (side, margin): (usize, usize),
        width: usize,
        draw: impl Fn(&Bounds, &mut [u8], &mut [bool]) -> Result<()>,
    ) -> Result<()> {
        let all = side + 2 * margin;
        self.start(all, width);
        let world = (side as i64) << tile.zoom;
        let first = [tile.column, tile.row].map(|at| i64::from(at) * side as i64 - margin as i64);
        let rows = first[1].max(0)..(first[1] + all as i64).min(world);
        let mut column = 0;
        while column < all {
            let west = (first[0] + column as i64).rem_euclid(world);
            let columns = (all - column).min((world - west) as usize);
            let bounds = Bounds {
                min: [west as u64, rows.start as u64, 0],
                max: [west as u64 + columns as u64, rows.end as u64, 1],
            };
            if bounds.size() == [all as u64, all as u64, 1] {
                return draw(&bounds, &mut self.values, &mut self.valid);
            }
            let cells = bounds.volume() as usize;
            let (mut values, mut valid) = (vec![0; cells * width], vec![false; cells]);
            draw(&bounds, &mut values, &mut valid)?;
            for (row, y) in rows.clone().enumerate() {
                let to = (y - first[1]) as usize * all + column;
                let from = row * columns..(row + 1) * columns;
                self.valid[to..to + columns].copy_from_slice(&valid[from.clone()]);
                let bytes = &values[from.start * width..from.end * width];
                self.values[to * width..(to + columns) * width].copy_from_slice(bytes);
            }
            column += columns;
        }
        Ok(())
    }
}

/// The place of data in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DataPlace {
    /// West, south, east and north in degrees: -180 to 180 if data lie across the 180th meridian.
    pub bounds: [f64; 4],
    /// Longitude and latitude of their middle, also if they lie across the 180th meridian.
    pub centre: [f64; 2],
}

impl DataPlace {
    /// The place of a box, with its own middle.
    pub(super) fn of_bounds(bounds: [f64; 4]) -> DataPlace {
        let [west, south, east, north] = bounds;
        DataPlace { bounds, centre: [(west + east) / 2.0, (south + north) / 2.0] }
    }
}

/// Samples of the world's tiles, from whatever grid they come.
pub trait TileSource: Sync {
    /// Type of the values.
    fn value_type(&self) -> ValueType;

    /// The deepest zoom that is worth drawing: that with about the source's own cells, for tiles of so many cells a side.
    fn max_zoom(&self, side: usize) -> u8;

    /// West, south, east and north of the source in degrees.
    fn degrees(&self) -> [f64; 4];

    /// The place of the source's data: for whoever shows the tiles, and not of what is drawn.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn data_place(&self) -> Result<DataPlace>;

    /// Tells what is known of a tile without drawing it. Takes microseconds; `Detail` is always right.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn content(&self, tile: TileId) -> Result<TileContent>;

    /// The samples of a tile of `side` cells a side, with `margin` cells around it. What is beyond the poles is VOID.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn tile(&self, tile: TileId, side: usize, margin: usize, samples: &mut TileSamples) -> Result<()>;

    /// The tiles of a zoom that depend on a block of the tree.
    fn tiles_of(&self, block: Code, zoom: u8) -> TileRange;

    /// The level of the tree's nodes that are about as large as a tile of a zoom, or its half: whoever asks for the tiles of many
    /// smaller blocks may ask for those of the nodes that these lie in instead.
    fn block_level(&self, zoom: u8) -> u8;

    /// Makes sure that what was read is still there: asked once at the end.
    ///
    /// # Errors
    /// If it was changed meanwhile.
    fn check_unchanged(&self) -> Result<()>;
}

/// The level of the world's square whose columns tell on which side of the globe data lie.
const COLUMN_LEVEL: u8 = 8;

/// First and number of the longest run of flags that are not set.
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

/// Tiles of a tree whose root is the world's square: each is a node of it.
pub struct XyzTiles<'a> {
    tree: &'a Dataset,
    depth: u8,
}

impl<'a> XyzTiles<'a> {
    /// The tiles of a tree, if its root is the world's square in web mercator; see [`web_mercator_depth`].
    pub fn new(tree: &'a Dataset) -> Option<XyzTiles<'a>> {
        let header = tree.header();
        let depth = web_mercator_depth(&tree.metadata().frame, header.extent)?;
        let is_tree = header.form.dimension == Dimension::Quad && depth == tree.depth();
        is_tree.then_some(XyzTiles { tree, depth })
    }
}

impl TileSource for XyzTiles<'_> {
    fn value_type(&self) -> ValueType {
        self.tree.header().form.value
    }

    fn max_zoom(&self, side: usize) -> u8 {
        self.depth.saturating_sub(side.trailing_zeros() as u8).min(MAX_ZOOM)
    }

    fn degrees(&self) -> [f64; 4] {
        TileRange::world(0).degrees(0)
    }

    fn data_place(&self) -> Result<DataPlace> {
        let Some(data) = self.tree.data_box()? else { return Ok(DataPlace::of_bounds(self.degrees())) };
        let cells = |corner: [u64; 3]| [corner[0] as u32, corner[1] as u32];
        let range = TileRange { min: cells(data.min), max: cells(data.max) };
        let mut place = DataPlace::of_bounds(range.degrees(self.depth));
        // Where a wide gap lies between data in the east and in the west, these are beside each other.
        let level = self.depth.min(COLUMN_LEVEL);
        let side = 1usize << level;
        let all = Bounds::space(Dimension::Quad, level);
        let width = self.value_type().size();
        let (mut values, mut valid) = (vec![0; side * side * width], vec![false; side * side]);
        self.tree.window(level, &all, 0.0, &mut values, Some(&mut valid))?;
        let has_data: Vec<bool> =
            (0..side).map(|column| valid.iter().skip(column).step_by(side).any(|is| *is)).collect();
        let (start, length) = widest_gap(&has_data);
        // (One that ends at the map's edges is no gap between data.)
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
        // The level with the tile's cells, or, where the tree ends above it, the deepest.
        let wanted = tile.zoom + side.trailing_zeros() as u8;
        let level = wanted.min(self.depth);
        let shift = wanted - level;
        samples.draw(tile, (side, margin), width, |cells, values, valid| {
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
            let mut to = values.chunks_exact_mut(width).zip(valid);
            for y in cells.min[1]..cells.max[1] {
                let row = ((y >> shift) - coarse.min[1]) as usize * across;
                for (x, (value, valid)) in (cells.min[0]..cells.max[0]).zip(&mut to) {
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
