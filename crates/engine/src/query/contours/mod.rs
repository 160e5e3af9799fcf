//! Traces contour lines, and the bands between them, at any level of detail.
//!
//! Lines run through the squares between the centres of neighbouring cells (`squares.rs`), in tiles
//! of 256 x 256 squares (`tile.rs`) that are traced on all threads, row by row. Tiles whose
//! extremes exclude all levels are not read (`rows.rs`). Where a line leaves a tile, the edge and
//! the point's number on it identify the continuation (`nodes.rs`, `join.rs`). A line is returned
//! as soon as it is complete. Until then its fragments are held in memory, or in a temporary file
//! if there are many (`fragments.rs`). Rings of bands are held until the rings around them are
//! complete (`polygons.rs`).

mod extremes;
mod fragments;
mod grid;
mod join;
mod levels;
mod nodes;
mod polygons;
mod rows;
mod squares;
mod tile;

use std::path::PathBuf;

pub use self::extremes::Extremes;
pub(crate) use self::extremes::{file_extremes, source_extremes};
use self::fragments::FragmentStore;
use self::grid::ValueGrid;
use self::join::{ContourLine, Joiner};
pub use self::levels::ContourLevels;
pub use self::levels::Levels;
use self::nodes::Tracing;
pub use self::nodes::level_share;
use self::polygons::Polygons;
use self::rows::TileRows;
use self::tile::{LineFragment, trace};
use crate::tree::Child;
use spinney_base::io::batch;
use spinney_base::space::{Bounds, Code};
use spinney_base::{Progress, Result};
use spinney_crs::Frame;

/// Course of contour lines near cells without a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ContourEnds {
    /// Lines end: no line passes between four cells of which one is VOID.
    #[default]
    Open,
    /// Lines continue to the edge of the last cells and end there, as in GDAL.
    Extend,
    /// Lines continue along the edge of the last cells, including the edge of the raster, so that
    /// all of them are rings. VOID counts as lower than any value.
    Close,
}

/// Options for contour lines or bands.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ContourRequest {
    /// Contour levels.
    pub levels: ContourLevels,
    /// Level of the tree whose cells are used; `None` is the deepest.
    pub level: Option<u8>,
    /// Course of lines near VOID cells. Bands always extend to the edge of the last cells.
    pub ends: ContourEnds,
    /// Approximate memory limit in bytes.
    pub memory: u64,
    /// Directory of the temporary file that is used if lines exceed the memory limit; `None` is the
    /// system's temporary directory.
    pub directory: Option<PathBuf>,
}

impl ContourRequest {
    /// Creates a request for contours of the deepest level. Lines end near VOID cells, and the
    /// memory limit is 64 MiB.
    pub fn new(levels: ContourLevels) -> ContourRequest {
        ContourRequest { levels, level: None, ends: ContourEnds::Open, memory: 64 << 20, directory: None }
    }
}

/// Totals of contours, and of the tiles read for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ContourSummary {
    /// Number of lines or polygons.
    pub count: u64,
    /// Number of their points.
    pub points: u64,
    /// Number of tiles of 256 x 256 cells in the raster at the level.
    pub tiles: u64,
    /// Number of tiles that were read. Extremes exclude lines in all others.
    pub tiles_read: u64,
}

/// A contour line, or a polygon of a band with its holes.
pub struct Contour<'a> {
    range: [f64; 2],
    lines: &'a [ContourLine],
    fragments: &'a FragmentStore,
    frame: &'a Frame,
}

impl Contour<'_> {
    /// Returns the line's value, or the minimum value of a band.
    pub fn value(&self) -> f64 {
        self.range[0]
    }

    /// Returns the range of a band: its minimum value, and the value that its values are below.
    /// Both are the line's value for a line.
    pub fn range(&self) -> [f64; 2] {
        self.range
    }

    /// Returns whether all lines end where they begin. Rings of polygons always do.
    pub fn is_closed(&self) -> bool {
        self.lines.iter().all(|line| line.is_ring)
    }

    /// Returns the number of parts: 1 for a line; for a polygon its outer ring, which is the first,
    /// and its holes.
    pub fn parts(&self) -> usize {
        self.lines.len()
    }

    /// Returns the number of points of a part, or 0 if there is no such part. The last point of a
    /// ring repeats the first.
    pub fn count(&self, part: usize) -> u64 {
        self.lines.get(part).map_or(0, |line| line.count)
    }

    /// Passes the points of a part to `each` in chunks, in world coordinates, with
    /// [`Contour::value`] as the third coordinate.
    ///
    /// # Errors
    /// If a temporary file cannot be read, or `each` fails.
    pub fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        let Some(line) = self.lines.get(part) else { return Ok(()) };
        let mut world = Vec::new();
        self.fragments.each(line.first, &mut |points| {
            world.clear();
            world.extend(points.iter().map(|[x, y]| {
                let [x, y, _] = self.frame.to_world([*x, *y, 0.0]);
                [x, y, self.range[0]]
            }));
            each(&world)
        })
    }
}

/// Visitor of contours.
pub type ContourVisitor<'a> = dyn FnMut(&Contour<'_>) -> Result<()> + 'a;

/// Cells that contours and isosurfaces are traced on: those of a level of a tree.
pub trait Relief: Sync {
    /// Returns a node's state.
    fn node(&self, code: Code) -> Result<Child<()>>;
    /// Returns the extremes of a node's cells.
    fn extremes(&self, code: Code) -> Result<Extremes>;
    /// Returns the numbers of a box of cells in row order; NaN for cells without a value.
    fn numbers(&self, bounds: &Bounds) -> Result<Vec<f64>>;
}

/// Raster that contours are traced on.
pub(crate) struct ContourGround<'a> {
    pub relief: &'a dyn Relief,
    /// Level, and its columns and rows.
    pub level: u8,
    pub size: [u64; 2],
    /// Frame of the level's cells.
    pub frame: Frame,
    /// Bounds of all values.
    pub values: (f64, f64),
}

/// Base-2 logarithm of a tile's columns and rows.
const TILE: u8 = 8;

/// Memory in bytes for tracing a tile, unless it has very many lines.
const TILE_BYTES: u64 = 4 << 20;

/// Traces lines or the polygons of bands, and passes them to `each` in an order that depends only
/// on the tree.
///
/// # Errors
/// If the levels are invalid or too close, if the tree is corrupt, if a temporary file or `each`
/// fails, or on cancellation.
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
    // Rasters are traced with rows going down. If the world's rows go up, left and right are
    // swapped. Outer rings of polygons are counterclockwise.
    let [across, down, _] = ground.frame.linear().to_cols_array_2d();
    let is_reversed = (across[0] * down[1] - across[1] * down[0] > 0.0) != is_bands;
    let tile_level = ground.level.saturating_sub(TILE);
    let tiles = ground.size.map(|cells| cells.div_ceil(1 << TILE));
    let directory = request.directory.clone().unwrap_or_else(std::env::temp_dir);
    let mut tracer = Tracer {
        ground,
        levels: &levels,
        fragments: FragmentStore::new(usize::try_from(request.memory / 8).unwrap_or(usize::MAX), directory),
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
            for fragments in traced {
                progress.check()?;
                tracer.take(fragments)?;
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
    let extent = ground.size.map(|cells| cells as i64);
    let first: [i64; 2] = std::array::from_fn(|axis| ((tile[axis] << TILE) as i64) - 1);
    // The last tile also has the squares at the edge of the raster.
    let end: [i64; 2] = std::array::from_fn(|axis| {
        if tile[axis] + 1 == tiles[axis] { extent[axis] + 1 } else { ((tile[axis] + 1) << TILE) as i64 }
    });
    let size: [usize; 2] = std::array::from_fn(|axis| (end[axis] - first[axis]) as usize);
    let low: [i64; 2] = first.map(|cell| cell.max(0));
    let high: [i64; 2] = std::array::from_fn(|axis| end[axis].min(extent[axis]));
    let bounds = Bounds { min: [low[0] as u64, low[1] as u64, 0], max: [high[0] as u64, high[1] as u64, 1] };
    let inner = ground.relief.numbers(&bounds)?;
    let width = bounds.size()[0] as usize;
    let mut numbers = vec![f64::NAN; size[0] * size[1]];
    let offset = [(low[0] - first[0]) as usize, (low[1] - first[1]) as usize];
    for (row, cells) in inner.chunks_exact(width).enumerate() {
        numbers[(offset[1] + row) * size[0] + offset[0]..][..width].copy_from_slice(cells);
    }
    Ok(ValueGrid::new(first, size, extent, numbers, levels))
}

/// State of the tracing.
struct Tracer<'a, 'e> {
    ground: &'a ContourGround<'a>,
    levels: &'a Levels,
    fragments: FragmentStore,
    joiner: Joiner,
    polygons: Polygons,
    is_bands: bool,
    each: &'a mut ContourVisitor<'e>,
    summary: ContourSummary,
}

impl Tracer<'_, '_> {
    /// Adds the fragments of a tile.
    fn take(&mut self, fragments: Vec<LineFragment>) -> Result<()> {
        for fragment in fragments {
            if let Some(line) = self.joiner.push(fragment, &mut self.fragments)? {
                self.finish(line)?;
            }
        }
        Ok(())
    }

    /// Ends everything that cannot continue once all rows above `row` were traced.
    fn settle(&mut self, row: i64) -> Result<()> {
        for line in self.joiner.settle(row) {
            self.finish(line)?;
        }
        let Tracer { ground, levels, fragments, polygons, each, summary, .. } = self;
        polygons.settle(fragments, &mut |lines, fragments| {
            let range = levels.band(lines.first().map_or(0, |line| line.class), ground.values);
            count(summary, lines);
            each(&Contour { range, lines, fragments, frame: &ground.frame })
        })
    }

    /// Passes a complete line to `each`, or stores a ring for its polygon.
    fn finish(&mut self, line: ContourLine) -> Result<()> {
        if self.is_bands {
            return self.polygons.push(line, &self.fragments);
        }
        let value = self.levels.value(line.class);
        let (range, frame) = ([value; 2], &self.ground.frame);
        count(&mut self.summary, &[line]);
        (self.each)(&Contour { range, lines: &[line], fragments: &self.fragments, frame })?;
        self.fragments.remove(line.first);
        Ok(())
    }
}

/// Adds a contour to the totals.
fn count(summary: &mut ContourSummary, lines: &[ContourLine]) {
    summary.count += 1;
    summary.points += lines.iter().map(|line| line.count).sum::<u64>();
}
