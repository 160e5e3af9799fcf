//! Contour lines, and the areas between them, at any level of detail.
//!
//! Lines go through the squares between the centres of neighbouring cells (`squares.rs`), in tiles of 256 x 256 of them (`tile.rs`) that are
//! traced on all threads, row after row. Tiles whose extremes exclude all levels are not looked at (`rows.rs`). Where a line leaves
//! a tile, the edge and the point's number on it say where it goes on (`nodes.rs`, `join.rs`); a line is handed out as soon as it is whole.
//! Until then its pieces wait, in a temporary file if there are many (`pieces.rs`). Rings of bands wait for the rings around them
//! (`polygons.rs`).

mod extremes;
mod grid;
mod join;
mod levels;
mod nodes;
mod pieces;
mod polygons;
mod rows;
mod squares;
mod tile;

use std::path::PathBuf;

pub use self::extremes::Extremes;
pub(crate) use self::extremes::{file_extremes, source_extremes};
use self::grid::ValueGrid;
use self::join::{ContourLine, Joiner};
pub use self::levels::ContourLevels;
pub use self::levels::Levels;
use self::nodes::Tracing;
pub use self::nodes::level_share;
use self::pieces::LinePieces;
use self::polygons::Polygons;
use self::rows::TileRows;
use self::tile::{LinePiece, trace};
use crate::tree::Child;
use spinney_base::io::batch;
use spinney_base::space::{Bounds, Code};
use spinney_base::{Progress, Result};
use spinney_crs::Frame;

/// Course of contour lines where cells without a value are near.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ContourEnds {
    /// Lines end: no line goes between four cells of which one is VOID.
    #[default]
    Open,
    /// Lines go on to the edge of the last cells, and end there, as GDAL's do.
    Extend,
    /// Lines go on along the edge of the last cells, also those at the edge of the picture, so that all of them are rings: what is VOID counts as
    /// lower than everything.
    Close,
}

/// Contour lines or bands that are wanted.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ContourRequest {
    /// The values.
    pub levels: ContourLevels,
    /// The level of the tree whose cells count; the deepest if it is not given.
    pub level: Option<u8>,
    /// Course of lines near VOID cells. Bands always go on to the edge of the last cells.
    pub ends: ContourEnds,
    /// Bytes to hold at a time, approximately.
    pub memory: u64,
    /// Where a temporary file is made if lines need more memory than that; the system's folder for such files if it is not given.
    pub folder: Option<PathBuf>,
}

impl ContourRequest {
    /// Contours of the deepest level, which end where VOID cells are near, with 64 MiB of memory.
    pub fn new(levels: ContourLevels) -> ContourRequest {
        ContourRequest { levels, level: None, ends: ContourEnds::Open, memory: 64 << 20, folder: None }
    }
}

/// Counts of contours, and of what was read for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ContourSummary {
    /// Lines, or polygons.
    pub count: u64,
    /// Their points.
    pub points: u64,
    /// Tiles of 256 x 256 cells that the picture has at the level.
    pub tiles: u64,
    /// Tiles that may have lines, all others being excluded by extremes, and were read.
    pub tiles_read: u64,
}

/// A contour line, or a polygon of a band with its holes.
pub struct Contour<'a> {
    range: [f64; 2],
    lines: &'a [ContourLine],
    pieces: &'a LinePieces,
    frame: &'a Frame,
}

impl Contour<'_> {
    /// The line's value; of a band the least value.
    pub fn value(&self) -> f64 {
        self.range[0]
    }

    /// The band's least value, and the value that its values are below; of a line twice its value.
    pub fn range(&self) -> [f64; 2] {
        self.range
    }

    /// Whether lines end where they begin. Rings of polygons always do.
    pub fn is_closed(&self) -> bool {
        self.lines.iter().all(|line| line.is_ring)
    }

    /// Number of parts: 1 of a line; of a polygon the outer ring, which is the first, and its holes.
    pub fn parts(&self) -> usize {
        self.lines.len()
    }

    /// Number of points of a part, the last of a ring, which is its first again, included; 0 if there is no such part.
    pub fn count(&self, part: usize) -> u64 {
        self.lines.get(part).map_or(0, |line| line.count)
    }

    /// Hands out the points of a part in world coordinates, many at a time, with [`Contour::value`] as the third.
    ///
    /// # Errors
    /// If a temporary file cannot be read, or `each` fails.
    pub fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        let Some(line) = self.lines.get(part) else { return Ok(()) };
        let mut world = Vec::new();
        self.pieces.each(line.first, &mut |points| {
            world.clear();
            world.extend(points.iter().map(|[x, y]| {
                let [x, y, _] = self.frame.to_world([*x, *y, 0.0]);
                [x, y, self.range[0]]
            }));
            each(&world)
        })
    }
}

/// Takes contours as they come.
pub type ContourVisitor<'a> = dyn FnMut(&Contour<'_>) -> Result<()> + 'a;

/// Cells that contours and isosurfaces are traced on: those of a level of a tree.
pub trait Relief: Sync {
    /// A node's state.
    fn node(&self, code: Code) -> Result<Child<()>>;
    /// The extremes of the cells of a node.
    fn extremes(&self, code: Code) -> Result<Extremes>;
    /// The numbers of a box of cells, in rows; not a number where there is none.
    fn numbers(&self, bounds: &Bounds) -> Result<Vec<f64>>;
}

/// The cells that contours are traced on.
pub(crate) struct ContourGround<'a> {
    pub relief: &'a dyn Relief,
    /// The level, and columns and rows of the picture there.
    pub level: u8,
    pub size: [u64; 2],
    /// The frame of the level's cells.
    pub frame: Frame,
    /// Bounds of all values.
    pub values: (f64, f64),
}

/// Columns and rows of a tile as a power of two.
const TILE: u8 = 8;

/// Bytes that a tile takes while it is traced, unless it has very many lines.
const TILE_BYTES: u64 = 4 << 20;

/// Traces lines, or the polygons of bands, and hands them out in an order that depends on the tree alone.
///
/// # Errors
/// If the levels are none, or too close, the tree is damaged, a temporary file fails, `each` does, or on interruption.
pub(crate) fn trace_contours(
    ground: &ContourGround<'_>,
    request: &ContourRequest,
    is_bands: bool,
    progress: &dyn Progress,
    each: &mut ContourVisitor<'_>,
) -> Result<ContourSummary> {
    let levels = Levels::new(&request.levels)?;
    let tracing = match request.ends {
        _ if is_bands => Tracing::Bands,
        ContourEnds::Open => Tracing::Open { to_edges: false },
        ContourEnds::Extend => Tracing::Open { to_edges: true },
        ContourEnds::Close => Tracing::Closed { low: levels.rank(ground.values.0) },
    };
    // Pictures are looked at with rows going down: where the world is not, left and right change places. Outer rings of polygons are
    // counterclockwise.
    let [across, down, _] = ground.frame.linear().to_cols_array_2d();
    let is_reversed = (across[0] * down[1] - across[1] * down[0] > 0.0) != is_bands;
    let tile_level = ground.level.saturating_sub(TILE);
    let tiles = ground.size.map(|cells| cells.div_ceil(1 << TILE));
    let folder = request.folder.clone().unwrap_or_else(std::env::temp_dir);
    let mut tracer = Tracer {
        ground,
        levels: &levels,
        pieces: LinePieces::new(usize::try_from(request.memory / 8).unwrap_or(usize::MAX), folder),
        joiner: Joiner::default(),
        polygons: Polygons::new(is_reversed),
        is_bands,
        each,
        summary: ContourSummary { tiles: tiles[0].saturating_mul(tiles[1]), ..ContourSummary::default() },
    };
    let mut rows = TileRows::new(ground.relief, &levels, tracing, tile_level, tiles);
    let batch = (request.memory / 8 / TILE_BYTES).clamp(1, 1 << 10) as usize;
    let cells = ground.size[0].saturating_mul(ground.size[1]);
    for row in 0..tiles[1] {
        progress.check()?;
        let wanted = rows.next(row)?;
        tracer.summary.tiles_read += wanted.len() as u64;
        for columns in wanted.chunks(batch) {
            let traced = batch::map(columns, |column| {
                progress.check()?;
                trace(&read_tile(ground, &levels, tiles, [*column, row])?, &levels, tracing, is_reversed)
            })?;
            for pieces in traced {
                progress.check()?;
                tracer.take(pieces)?;
            }
        }
        tracer.settle(((row as i64 + 1) << TILE) - 1)?;
        let end = (row + 1).saturating_mul(1 << TILE).min(ground.size[1]);
        progress.advance((end - (row << TILE)).saturating_mul(ground.size[0]), cells);
    }
    tracer.settle(i64::MAX)?;
    Ok(tracer.summary)
}

/// Reads the cells around the squares of a tile.
fn read_tile(
    ground: &ContourGround<'_>,
    levels: &Levels,
    tiles: [u64; 2],
    tile: [u64; 2],
) -> Result<ValueGrid> {
    let picture = ground.size.map(|cells| cells as i64);
    let first: [i64; 2] = std::array::from_fn(|axis| ((tile[axis] << TILE) as i64) - 1);
    // The last tile has the squares at the edge of the picture, too.
    let end: [i64; 2] = std::array::from_fn(|axis| {
        if tile[axis] + 1 == tiles[axis] { picture[axis] + 1 } else { ((tile[axis] + 1) << TILE) as i64 }
    });
    let size: [usize; 2] = std::array::from_fn(|axis| (end[axis] - first[axis]) as usize);
    let low: [i64; 2] = first.map(|cell| cell.max(0));
    let high: [i64; 2] = std::array::from_fn(|axis| end[axis].min(picture[axis]));
    let bounds = Bounds { min: [low[0] as u64, low[1] as u64, 0], max: [high[0] as u64, high[1] as u64, 1] };
    let inner = ground.relief.numbers(&bounds)?;
    let width = bounds.size()[0] as usize;
    let mut numbers = vec![f64::NAN; size[0] * size[1]];
    let offset = [(low[0] - first[0]) as usize, (low[1] - first[1]) as usize];
    for (row, cells) in inner.chunks_exact(width).enumerate() {
        numbers[(offset[1] + row) * size[0] + offset[0]..][..width].copy_from_slice(cells);
    }
    Ok(ValueGrid::new(first, size, picture, numbers, levels))
}

/// Lines on their way to whoever wants them.
struct Tracer<'a, 'e> {
    ground: &'a ContourGround<'a>,
    levels: &'a Levels,
    pieces: LinePieces,
    joiner: Joiner,
    polygons: Polygons,
    is_bands: bool,
    each: &'a mut ContourVisitor<'e>,
    summary: ContourSummary,
}

impl Tracer<'_, '_> {
    /// Takes the pieces of a tile.
    fn take(&mut self, pieces: Vec<LinePiece>) -> Result<()> {
        for piece in pieces {
            if let Some(line) = self.joiner.push(piece, &mut self.pieces)? {
                self.finish(line)?;
            }
        }
        Ok(())
    }

    /// Ends what cannot go on when all above a row has been seen.
    fn settle(&mut self, row: i64) -> Result<()> {
        for line in self.joiner.settle(row) {
            self.finish(line)?;
        }
        let Tracer { ground, levels, pieces, polygons, each, summary, .. } = self;
        polygons.settle(pieces, &mut |lines, pieces| {
            let range = levels.band(lines.first().map_or(0, |line| line.class), ground.values);
            count(summary, lines);
            each(&Contour { range, lines, pieces, frame: &ground.frame })
        })
    }

    /// Hands out a whole line, or keeps a ring for its polygon.
    fn finish(&mut self, line: ContourLine) -> Result<()> {
        if self.is_bands {
            return self.polygons.push(line, &self.pieces);
        }
        let value = self.levels.value(line.class);
        let (range, frame) = ([value; 2], &self.ground.frame);
        count(&mut self.summary, &[line]);
        (self.each)(&Contour { range, lines: &[line], pieces: &self.pieces, frame })?;
        self.pieces.remove(line.first);
        Ok(())
    }
}

/// Counts a contour.
fn count(summary: &mut ContourSummary, lines: &[ContourLine]) {
    summary.count += 1;
    summary.points += lines.iter().map(|line| line.count).sum::<u64>();
}
