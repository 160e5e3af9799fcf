//! Samples that tiles are made of, from whatever grid they come.

use super::place::{TileId, TileRange};
use spinney_base::Result;
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Value, ValueType};
use spinney_crs::{Frame, web_mercator};
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

/// Draws a box of cells: their values, and whether each has one.
pub(super) type DrawBox<'a> = dyn Fn(&Bounds, &mut [u8], &mut [bool]) -> Result<()> + 'a;

impl TileSamples {
    /// Makes room for so many cells along each side, of values of so many bytes, all VOID.
    pub fn start(&mut self, side: usize, width: usize) {
        self.side = side;
        self.values.resize(side * side * width, 0);
        self.values.fill(0);
        self.valid.resize(side * side, false);
        self.valid.fill(false);
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

    /// Draws a tile of `side` cells a side, with `margin` cells around it, by boxes of the square's cells at the tile's zoom. Rows end where the
    /// square ends; so do columns, unless they go around the globe and go on behind the antimeridian. `draw` gives each cell of a box its
    /// value of `width` bytes.
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
    /// West, south, east and north in degrees: -180 to 180 if data cross the 180th meridian.
    pub bounds: [f64; 4],
    /// Longitude and latitude of the centre, also if data cross the 180th meridian.
    pub centre: [f64; 2],
}

impl GeographicExtent {
    /// The extent of a box, with its own centre.
    pub fn of_bounds(bounds: [f64; 4]) -> GeographicExtent {
        let [west, south, east, north] = bounds;
        GeographicExtent { bounds, centre: [(west + east) / 2.0, (south + north) / 2.0] }
    }
}

/// Samples of the tiles of a square.
pub trait TileSource: Sync {
    /// Type of the values.
    fn value_type(&self) -> ValueType;

    /// The place in the world of the square's cells where it has `2^level` of them a side: the world's square in web mercator, unless the
    /// source has another one.
    fn frame(&self, level: u8) -> Frame {
        web_mercator(level)
    }

    /// How the samples are made, in words, where they are not those of a tree as they are: another text wherever tiles may differ.
    fn signature(&self) -> String {
        String::new()
    }

    /// Whether samples may leave the bounds of the tree's values, as those of a cubic convolution do.
    fn overshoots(&self) -> bool {
        false
    }

    /// The deepest zoom that is worth drawing: that with about the source's own cells, for tiles of so many cells a side.
    fn max_zoom(&self, side: usize) -> u8;

    /// West, south, east and north of the source in degrees.
    fn degrees(&self) -> [f64; 4];

    /// The place of the source's data: for whoever shows the tiles, and not of what is drawn.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn data_place(&self) -> Result<GeographicExtent>;

    /// Tells what is known of a tile without drawing it. Takes microseconds; `Detail` is always right.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn content(&self, tile: TileId) -> Result<TileContent>;

    /// The samples of a tile of `side` cells a side, with `margin` cells around it. What is beyond the square is VOID.
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
