//! Extracts regions of equal cells as polygons, at any level of detail.
//!
//! Rows of cells are read as runs of equal cells (`rows.rs`). Uniform nodes give runs without
//! reading their cells, and a row equal to the one above costs nothing. A sweep (`sweep.rs`) tracks
//! the borders that cross a row, as arcs between junctions that two regions share (`arcs.rs`), and
//! the connectivity of runs (`labels.rs`). A region that does not continue in the next row is
//! complete: its arcs are assembled to rings (`rings.rs`), returned, and removed once the
//! neighbouring regions are complete as well. Points move to a temporary file if there are many
//! (`points.rs`). Arcs are simplified once, when they are finished (`simplify.rs`).

mod arcs;
mod labels;
mod points;
mod rings;
mod rows;
mod simplify;
mod sweep;
#[cfg(test)]
mod tests;

use std::path::PathBuf;

use self::arcs::Arcs;
use self::points::Points;
use self::rings::{RegionRings, RingRules};
use self::rows::{Class, ClassSpan, TILE_LEVELS, read_strip, strip_rows};
use self::simplify::Simplifier;
use self::sweep::Sweep;
use crate::tree::Child;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Number, Value, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_crs::Frame;

/// Options for polygons of classes.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PolygonRequest {
    /// Whether cells of a class that only share a corner are connected, too.
    pub across_corners: bool,
    /// Classes to extract; `None` is all.
    pub classes: Option<Vec<Number>>,
    /// Tolerance of the simplification in units of the tree's coordinates; `None` keeps borders
    /// exact.
    pub simplify: Option<f64>,
    /// Level of the tree whose cells are used; `None` is the deepest.
    pub level: Option<u8>,
    /// Whether points are cell corners of the level, as column and row, instead of world
    /// coordinates. Outer rings are then counterclockwise with rows going down.
    pub in_cells: bool,
    /// Approximate memory limit in bytes.
    pub memory: u64,
    /// Directory of the temporary file that is used if borders exceed the memory limit; `None` is
    /// the system's temporary directory.
    pub directory: Option<PathBuf>,
}

impl PolygonRequest {
    /// Creates a request for exact polygons of all classes at the deepest level. Cells are
    /// connected by edges only, and the memory limit is 64 MiB.
    pub fn new() -> PolygonRequest {
        PolygonRequest {
            across_corners: false,
            classes: None,
            simplify: None,
            level: None,
            in_cells: false,
            memory: 64 << 20,
            directory: None,
        }
    }
}

impl Default for PolygonRequest {
    fn default() -> PolygonRequest {
        PolygonRequest::new()
    }
}

/// Totals of extracted regions and their polygons.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct PolygonSummary {
    /// Number of regions.
    pub count: u64,
    /// Number of polygons. It exceeds the region count only if cells that share a corner are
    /// connected.
    pub polygons: u64,
    /// Number of rings of all polygons.
    pub rings: u64,
    /// Number of points of all rings.
    pub points: u64,
    /// Number of cells of all regions.
    pub cells: u64,
}

/// A region of cells of a class: one polygon, or several that touch at points.
pub struct ClassRegion<'a> {
    value: Value,
    value_type: ValueType,
    cells: u64,
    rings: &'a RegionRings,
    arcs: &'a Arcs,
    rules: RingRules,
    frame: &'a Frame,
}

impl ClassRegion<'_> {
    /// Returns the class.
    pub fn class(&self) -> Number {
        self.value_type.first_number(self.value)
    }

    /// Returns the number of cells at the requested level.
    pub fn cells(&self) -> u64 {
        self.cells
    }

    /// Returns the number of rings of each polygon.
    pub fn polygons(&self) -> &[usize] {
        &self.rings.polygons
    }

    /// Returns the number of all rings. Each polygon has its outer ring first, then its holes.
    pub fn parts(&self) -> usize {
        self.rings.rings.len()
    }

    /// Returns the number of points of a ring, or 0 if there is no such ring. The last point
    /// repeats the first.
    pub fn count(&self, ring: usize) -> u64 {
        self.rings.rings.get(ring).map_or(0, |ring| ring.count)
    }

    /// Passes the points of a ring to `each` in chunks, in world coordinates or [in
    /// cells](PolygonRequest::in_cells). The third coordinate is 0.
    ///
    /// # Errors
    /// If a temporary file cannot be read, or `each` fails.
    pub fn points(&self, ring: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        let Some(ring) = self.rings.rings.get(ring) else { return Ok(()) };
        let mut world = Vec::new();
        ring.points(self.arcs, self.rules, &mut |points| {
            world.clear();
            world.extend(points.iter().map(|[x, y]| {
                let [x, y, _] = self.frame.to_world([f64::from(*x), f64::from(*y), 0.0]);
                [x, y, 0.0]
            }));
            each(&world)
        })
    }
}

/// Visitor of regions.
pub type RegionVisitor<'a> = dyn FnMut(&ClassRegion<'_>) -> Result<()> + 'a;

/// Cells of a tree's level.
pub(crate) trait ClassCells: Sync {
    /// Returns a node's state.
    fn node(&self, code: Code) -> Result<Child<()>>;
    /// Returns the values of a box of cells in row order, and which of them are not VOID.
    fn window(&self, bounds: &Bounds) -> Result<(Vec<u8>, Vec<bool>)>;
}

/// The grid of cells of a tree's level, to extract polygons from.
pub(crate) struct ClassGrid<'a> {
    pub cells: &'a dyn ClassCells,
    /// Level, and its columns and rows.
    pub level: u8,
    pub size: [u64; 2],
    /// Frame of the level's cells.
    pub frame: Frame,
    pub value: ValueType,
    /// Size of a value in bytes, at most 8.
    pub width: usize,
    /// Classes to distinguish, in ascending order; cells of others count as VOID. `None` is all.
    pub classes: Option<Vec<u64>>,
}

impl ClassGrid<'_> {
    /// Maps classes that are not distinguished to VOID.
    fn class(&self, class: Class) -> Class {
        match &self.classes {
            Some(wanted) if wanted.binary_search(&class.bits).is_err() => Class::VOID,
            _ => class,
        }
    }

    /// Returns the bytes of a value as a number.
    fn bits(value: Value) -> u64 {
        let mut bytes = [0; 16];
        value.write(&mut bytes);
        bytes.first_chunk::<8>().copied().map_or(0, u64::from_le_bytes)
    }
}

/// Extracts all regions, in an order that depends only on the tree.
///
/// Must not run in a [batch](spinney_base::io::batch): a restart would pass regions to `each` and
/// report progress again. The reads of a strip are batched instead.
///
/// # Errors
/// If the tree is corrupt, if a temporary file or `each` fails, or on cancellation.
pub(crate) fn find_regions(
    grid: &mut ClassGrid<'_>,
    request: &PolygonRequest,
    progress: &dyn Progress,
    each: &mut RegionVisitor<'_>,
) -> Result<PolygonSummary> {
    let wanted = match &request.classes {
        None => None,
        Some(classes) => {
            let mut bits = Vec::with_capacity(classes.len());
            for class in classes {
                // No cell has a class that the type cannot store, so requesting it is a mistake.
                let value = grid.value.exact(&[*class]);
                let value = value.ok_or_else(|| {
                    let found = class.to_string();
                    Error::invalid(
                        "class",
                        found,
                        format!("a number that {} can store", grid.value.sample.name()),
                    )
                })?;
                bits.push(ClassGrid::bits(value));
            }
            spinney_base::sort::by(&mut bits, &mut Ord::cmp);
            Some(bits)
        }
    };
    let tolerance = match request.simplify {
        Some(distance) if !(distance > 0.0 && distance.is_finite()) => {
            return Err(Error::invalid("simplify", distance.to_string(), "a distance greater than 0"));
        }
        tolerance => tolerance,
    };
    // Borders are simplified from junction to junction. If other classes counted as VOID, some
    // junctions would vanish, and the border of a class would depend on the classes that are
    // extracted with it. Exact borders do not keep junctions, and may ignore other classes.
    grid.classes = if tolerance.is_some() { None } else { wanted.clone() };
    let rows_go_down = request.in_cells;
    let points_frame = if rows_go_down { Frame::identity() } else { grid.frame.clone() };
    let grid = &*grid;
    // Rasters are traced with rows going down. If the world's rows go up, left and right are
    // swapped.
    let [across, down, _] = grid.frame.linear().to_cols_array_2d();
    let is_reversed = !rows_go_down && across[0] * down[1] - across[1] * down[0] > 0.0;
    let rules = RingRules { is_reversed, keeps_junctions: tolerance.is_some() };
    let directory = request.directory.clone().unwrap_or_else(std::env::temp_dir);
    let [columns, rows] = grid.size.map(|cells| cells as u32);
    let arcs = Arcs::new(Points::new(request.memory / 4, directory));
    let mut tracer = Tracer {
        grid,
        frame: points_frame,
        sweep: Sweep::new(columns, request.across_corners, arcs),
        simplifier: tolerance.map(|tolerance| Simplifier::new(grid, tolerance, request.memory / 8)),
        wanted,
        rules,
        progress,
        each,
        summary: PolygonSummary::default(),
    };
    let height = strip_rows(grid.size[0], request.memory / 4).min(1 << TILE_LEVELS.min(grid.level));
    let cells = grid.size[0].saturating_mul(grid.size[1]);
    let mut first = 0;
    let mut runs = Vec::new();
    while first < rows {
        progress.check()?;
        let height = height.min(rows - first);
        let strip = read_strip(grid, first, height)?;
        for row in 0..strip.rows {
            if strip.is_repeated(row) {
                tracer.sweep.repeat();
            } else {
                strip.row(row, &mut runs);
                tracer.next(&runs)?;
            }
        }
        first += height;
        progress.advance(u64::from(height).saturating_mul(grid.size[0]), cells);
    }
    // Below the last row everything is VOID.
    tracer.next(&[ClassSpan::new(Class::VOID, columns)])?;
    Ok(tracer.summary)
}

/// State of the extraction.
struct Tracer<'a, 'e> {
    grid: &'a ClassGrid<'a>,
    /// Frame of the output points.
    frame: Frame,
    sweep: Sweep,
    simplifier: Option<Simplifier<'a>>,
    /// Classes to return; `None` is all.
    wanted: Option<Vec<u64>>,
    rules: RingRules,
    progress: &'a dyn Progress,
    each: &'a mut RegionVisitor<'e>,
    summary: PolygonSummary,
}

impl Tracer<'_, '_> {
    /// Processes a row, and passes the regions that end above it to `each`.
    fn next(&mut self, runs: &[ClassSpan]) -> Result<()> {
        let Tracer { grid, frame, sweep, simplifier, wanted, rules, each, summary, .. } = self;
        for (root, class) in sweep.next(runs, simplifier)? {
            self.progress.check()?;
            let (cells, first) = sweep.labels.set(root);
            let rings = RegionRings::new(first, &mut sweep.arcs, &mut sweep.labels, *rules);
            if wanted.as_ref().is_none_or(|wanted| wanted.binary_search(&class.bits).is_ok()) {
                summary.count += 1;
                summary.polygons += rings.polygons.len() as u64;
                summary.rings += rings.rings.len() as u64;
                summary.points += rings.rings.iter().map(|ring| ring.count).sum::<u64>();
                summary.cells += cells;
                let value = Value::from_bytes(&class.bits.to_le_bytes()[..grid.width]);
                let arcs = &sweep.arcs;
                let value_type = grid.value;
                each(&ClassRegion { value, value_type, cells, rings: &rings, arcs, rules: *rules, frame })?;
            }
            rings.release(&mut sweep.arcs);
            sweep.labels.remove(root);
        }
        sweep.arcs.spool()
    }
}
