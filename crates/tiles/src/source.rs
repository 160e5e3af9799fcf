//! Samples of tiles, independent of the grid that they come from.

use super::tile_id::{TileId, TileRange};
use spinney_base::Result;
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Value, ValueType};
use spinney_crs::{Frame, web_mercator};
use spinney_engine::tree::Child;

/// Contents of a tile that are known without drawing it, and so those of all tiles below it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TileContent {
    /// No cell has a value.
    Empty,
    /// All cells have this value.
    Uniform(Value),
    /// The tile must be drawn, and may turn out to be uniform.
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

/// Samples of a tile with a margin of cells around it: `side` rows of `side` cells, north first.
#[derive(Clone, Debug, Default)]
pub struct TileSamples {
    /// Cells along each side, including the margin.
    pub side: usize,
    /// Values, little-endian, with the samples of a cell contiguous.
    pub values: Vec<u8>,
    /// Whether each cell has a value; `false` is VOID.
    pub valid: Vec<bool>,
}

/// Function that draws a box of cells: their values, and whether each has one.
pub(super) type DrawBox<'a> = dyn Fn(&Bounds, &mut [u8], &mut [bool]) -> Result<()> + 'a;

impl TileSamples {
    /// Resizes the buffers to `side` cells a side with values of `width` bytes, all VOID.
    pub fn start(&mut self, side: usize, width: usize) {
        self.side = side;
        self.values.resize(side * side * width, 0);
        self.values.fill(0);
        self.valid.resize(side * side, false);
        self.valid.fill(false);
    }

    /// Sets all cells to one value, or to VOID.
    pub fn fill(&mut self, side: usize, width: usize, value: Option<Value>) {
        self.start(side, width);
        if let Some(value) = value {
            self.values
                .chunks_exact_mut(width)
                .for_each(|cell| cell.copy_from_slice(&value.to_bytes()[..width]));
            self.valid.fill(true);
        }
    }

    /// Draws a tile of `side` cells a side, with `margin` cells around it, by boxes of the square's
    /// cells at the tile's zoom. Rows outside the square stay VOID. So do columns, unless
    /// `is_around` is set: then they continue beyond the antimeridian. `draw` writes a value of
    /// `width` bytes for each cell of a box.
    ///
    /// # Errors
    /// Those of `draw`.
    pub(super) fn draw(
        &mut self,
        tile: TileId,
        (side, margin): (usize, usize),
        width: usize,
        is_around: bool,
        draw: &DrawBox<'_>,
    ) -> Result<()> {
        let all = side + 2 * margin;
        self.start(all, width);
        let square = (side as i64) << tile.zoom;
        let first = [tile.column, tile.row].map(|at| i64::from(at) * side as i64 - margin as i64);
        let rows = first[1].max(0)..(first[1] + all as i64).min(square);
        let mut is_unread = false;
        let (mut column, end) = if is_around {
            (0, all)
        } else {
            ((-first[0]).max(0) as usize, (square - first[0]).min(all as i64) as usize)
        };
        while column < end {
            let west = (first[0] + column as i64).rem_euclid(square);
            let columns = (end - column).min((square - west) as usize);
            let bounds = Bounds {
                min: [west as u64, rows.start as u64, 0],
                max: [west as u64 + columns as u64, rows.end as u64, 1],
            };
            if bounds.size() == [all as u64, all as u64, 1] {
                return draw(&bounds, &mut self.values, &mut self.valid);
            }
            let cells = bounds.volume() as usize;
            let (mut values, mut valid) = (vec![0; cells * width], vec![false; cells]);
            defer_missing(draw(&bounds, &mut values, &mut valid), &mut is_unread)?;
            for (row, y) in rows.clone().enumerate() {
                let to = (y - first[1]) as usize * all + column;
                let from = row * columns..(row + 1) * columns;
                self.valid[to..to + columns].copy_from_slice(&valid[from.clone()]);
                let bytes = &values[from.start * width..from.end * width];
                self.values[to * width..(to + columns) * width].copy_from_slice(bytes);
            }
            column += columns;
        }
        finish_deferred(is_unread)
    }
}

/// Geographic extent of data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeographicExtent {
    /// West, south, east and north in degrees; west and east are -180 and 180 if the data cross the
    /// 180th meridian.
    pub bounds: [f64; 4],
    /// Longitude and latitude of the centre, which is meaningful even if the data cross the 180th
    /// meridian.
    pub centre: [f64; 2],
}

impl GeographicExtent {
    /// Returns the extent of a box, with the centre of the box.
    pub fn of_bounds(bounds: [f64; 4]) -> GeographicExtent {
        let [west, south, east, north] = bounds;
        GeographicExtent { bounds, centre: [(west + east) / 2.0, (south + north) / 2.0] }
    }
}

/// Source of the samples of a square's tiles.
pub trait TileSource: Sync {
    /// Returns the type of the values.
    fn value_type(&self) -> ValueType;

    /// Returns the georeferencing of the square's cells where it has `2^level` of them a side. The
    /// default is the world square in web mercator.
    fn frame(&self, level: u8) -> Frame {
        web_mercator(level)
    }

    /// Returns a description of how samples are derived, if they are not those of a tree unchanged.
    /// Sources whose tiles may differ return different strings.
    fn signature(&self) -> String {
        String::new()
    }

    /// Returns whether samples may exceed the range of the tree's values, as with cubic
    /// convolution.
    fn overshoots(&self) -> bool {
        false
    }

    /// Returns the maximum zoom worth drawing, for tiles of `side` cells a side: the one whose
    /// cells are about as large as the source's own.
    fn max_zoom(&self, side: usize) -> u8;

    /// Returns west, south, east and north of the source in degrees.
    fn degrees(&self) -> [f64; 4];

    /// Returns the geographic extent of the source's data. It serves viewers of the tiles, and does
    /// not affect what is drawn.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn data_place(&self) -> Result<GeographicExtent>;

    /// Returns what is known about a tile without drawing it. Takes microseconds.
    /// [`TileContent::Detail`] is always a valid result.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn content(&self, tile: TileId) -> Result<TileContent>;

    /// Reads the samples of a tile of `side` cells a side, with `margin` cells around it. Cells
    /// outside the square are VOID.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn tile(&self, tile: TileId, side: usize, margin: usize, samples: &mut TileSamples) -> Result<()>;

    /// Returns the tiles of a zoom that depend on a block of the tree.
    fn tiles_of(&self, block: Code, zoom: u8) -> TileRange;

    /// Returns the level of the tree's nodes that are about as large as a tile of a zoom, or half
    /// as large along each side. A caller that needs the tiles of many smaller blocks may query
    /// those of the nodes that contain the blocks instead.
    fn block_level(&self, zoom: u8) -> u8;

    /// Checks that the source has not changed since it was read. Called once at the end.
    ///
    /// # Errors
    /// If it has changed.
    fn check_unchanged(&self) -> Result<()>;
}
