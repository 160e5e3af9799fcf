//! Regions of equal cells as polygons, at any level of detail.
//!
//! Rows of cells come as runs of equal ones (`rows.rs`), of nodes of the tree that are alike without a look at their cells; rows like the one above cost
//! nothing. A sweep (`sweep.rs`) keeps the borders that cross a row, in arcs between junctions that two regions share (`arcs.rs`), and tells which runs hang
//! together (`labels.rs`). A region that does not go on below is whole: its arcs are put together to rings (`rings.rs`), handed out, and forgotten when the
//! other regions along them are whole, too. Points wait in a temporary file if there are many (`points.rs`). Arcs are simplified once, when they are
//! finished (`simplify.rs`).

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
use self::rows::{Class, Run, TILE, read_strip, strip_rows};
use self::simplify::Simplifier;
use self::sweep::Sweep;
use crate::tree::Child;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Number, Value, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_crs::Frame;

/// Polygons of classes that are wanted.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PolygonRequest {
    /// Whether cells of a class with no more than a common corner hang together, too.
    pub across_corners: bool,
    /// The classes; all if they are not given.
    pub classes: Option<Vec<Number>>,
    /// Distance that borders may be moved by, in units of the tree's coordinates; none if it is not given.
    pub simplify: Option<f64>,
    /// The level of the tree whose cells count; the deepest if it is not given.
    pub level: Option<u8>,
    /// Whether points are corners of cells of the level, by their column and row, instead of places in the world. Outer rings are then counterclockwise
    /// where rows go down.
    pub in_cells: bool,
    /// Bytes to hold at a time, approximately.
    pub memory: u64,
    /// Where a temporary file is made if borders need more memory than that; the system's folder for such files if it is not given.
    pub folder: Option<PathBuf>,
}

impl PolygonRequest {
    /// Exact polygons of all classes at the deepest level, of cells with a common edge, with 64 MiB of memory.
    pub fn new() -> PolygonRequest {
        PolygonRequest {
            across_corners: false,
            classes: None,
            simplify: None,
            level: None,
            in_cells: false,
            memory: 64 << 20,
            folder: None,
        }
    }
}

impl Default for PolygonRequest {
    fn default() -> PolygonRequest {
        PolygonRequest::new()
    }
}

/// Counts of regions, and of what their polygons are made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct PolygonSummary {
    /// Regions.
    pub count: u64,
    /// Their polygons: more than regions only where cells with a common corner hang together.
    pub polygons: u64,
    /// Rings of all polygons.
    pub rings: u64,
    /// Points of all rings.
    pub points: u64,
    /// Cells of all regions.
    pub cells: u64,
}

/// A region of cells of a class: a polygon, or several that touch in points.
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
    /// The class.
    pub fn class(&self) -> Number {
        self.value_type.first_number(self.value)
    }

    /// Number of its cells, of the level that was asked for.
    pub fn cells(&self) -> u64 {
        self.cells
    }

    /// Number of rings of each of its polygons.
    pub fn polygons(&self) -> &[usize] {
        &self.rings.polygons
    }

    /// Number of all rings: of each polygon first the outer one, then holes.
    pub fn parts(&self) -> usize {
        self.rings.rings.len()
    }

    /// Number of points of a ring, the last of which is its first again; 0 if there is no such ring.
    pub fn count(&self, part: usize) -> u64 {
        self.rings.rings.get(part).map_or(0, |ring| ring.count)
    }

    /// Hands out the points of a ring, many at a time, in world coordinates or [in cells](PolygonRequest::in_cells); the third is 0.
    ///
    /// # Errors
    /// If a temporary file cannot be read, or `each` fails.
    pub fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        let Some(ring) = self.rings.rings.get(part) else { return Ok(()) };
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

/// Takes regions as they come.
pub type RegionVisitor<'a> = dyn FnMut(&ClassRegion<'_>) -> Result<()> + 'a;

/// Cells of a level of a tree.
pub(crate) trait ClassCells: Sync {
    /// A node's state.
    fn node(&self, code: Code) -> Result<Child<()>>;
    /// The values of a box of cells, in rows, and which of them are not VOID.
    fn window(&self, bounds: &Bounds) -> Result<(Vec<u8>, Vec<bool>)>;
}

/// The cells that polygons are made of.
pub(crate) struct ClassGround<'a> {
    pub cells: &'a dyn ClassCells,
    /// The level, and columns and rows of the picture there.
    pub level: u8,
    pub size: [u64; 2],
    /// The frame of the level's cells.
    pub frame: Frame,
    pub value: ValueType,
    /// Bytes of a value: at most 8.
    pub width: usize,
    /// Values of the classes whose cells are looked at, others being VOID, in order; all if they are not given.
    pub classes: Option<Vec<u64>>,
}

impl ClassGround<'_> {
    /// A class as it is looked at.
    fn class(&self, class: Class) -> Class {
        match &self.classes {
            Some(wanted) if wanted.binary_search(&class.bits).is_err() => Class::VOID,
            _ => class,
        }
    }

    /// The class of a value.
    fn bits(value: Value) -> u64 {
        let mut bytes = [0; 16];
        value.write(&mut bytes);
        bytes.first_chunk::<8>().copied().map_or(0, u64::from_le_bytes)
    }
}

/// Finds all regions, and hands them out in an order that depends on the tree alone.
///
/// # Errors
/// If the tree is damaged, a temporary file fails, `each` does, or on interruption.
pub(crate) fn find_regions(
    ground: &mut ClassGround<'_>,
    request: &PolygonRequest,
    progress: &dyn Progress,
    each: &mut RegionVisitor<'_>,
) -> Result<PolygonSummary> {
    let wanted = match &request.classes {
        None => None,
        Some(classes) => {
            let mut bits = Vec::with_capacity(classes.len());
            for class in classes {
                // (What values cannot be is in no cell.)
                let value = ground.value.exact(&[*class]);
                let value = value.ok_or_else(|| {
                    let found = class.to_string();
                    Error::invalid("class", found, format!("a number that {:?} can be", ground.value.sample))
                })?;
                bits.push(ClassGround::bits(value));
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
    // Where borders are simplified, all classes have a say in where junctions are.
    ground.classes = if tolerance.is_some() { None } else { wanted.clone() };
    let rows_go_down = request.in_cells;
    let points_frame = if rows_go_down { Frame::identity() } else { ground.frame.clone() };
    let ground = &*ground;
    // Pictures are looked at with rows going down: where the world is not, left and right change places.
    let [across, down, _] = ground.frame.linear().to_cols_array_2d();
    let is_reversed = !rows_go_down && across[0] * down[1] - across[1] * down[0] > 0.0;
    let rules = RingRules { is_reversed, keeps_junctions: tolerance.is_some() };
    let folder = request.folder.clone().unwrap_or_else(std::env::temp_dir);
    let [columns, rows] = ground.size.map(|cells| cells as u32);
    let arcs = Arcs::new(Points::new(request.memory / 4, folder));
    let mut tracer = Tracer {
        ground,
        frame: points_frame,
        sweep: Sweep::new(columns, request.across_corners, arcs),
        simplifier: tolerance.map(|tolerance| Simplifier::new(ground, tolerance, request.memory / 8)),
        wanted,
        rules,
        progress,
        each,
        summary: PolygonSummary::default(),
    };
    let height = strip_rows(ground.size[0], request.memory / 4).min(1 << TILE.min(ground.level));
    let cells = ground.size[0].saturating_mul(ground.size[1]);
    let mut first = 0;
    let mut runs = Vec::new();
    while first < rows {
        progress.check()?;
        let height = height.min(rows - first);
        let strip = read_strip(ground, first, height)?;
        for row in 0..strip.rows {
            if strip.is_repeated(row) {
                tracer.sweep.repeat();
            } else {
                strip.row(row, &mut runs);
                tracer.next(&runs)?;
            }
        }
        first += height;
        progress.advance(u64::from(height).saturating_mul(ground.size[0]), cells);
    }
    // Below the last row there is nothing.
    tracer.next(&[Run::new(Class::VOID, columns)])?;
    Ok(tracer.summary)
}

/// Regions on their way to whoever wants them.
struct Tracer<'a, 'e> {
    ground: &'a ClassGround<'a>,
    /// Where points are.
    frame: Frame,
    sweep: Sweep,
    simplifier: Option<Simplifier<'a>>,
    /// Classes that are handed out; all if they are not given.
    wanted: Option<Vec<u64>>,
    rules: RingRules,
    progress: &'a dyn Progress,
    each: &'a mut RegionVisitor<'e>,
    summary: PolygonSummary,
}

impl Tracer<'_, '_> {
    /// Passes a row, and hands out what ends above it.
    fn next(&mut self, runs: &[Run]) -> Result<()> {
        let Tracer { ground, frame, sweep, simplifier, wanted, rules, each, summary, .. } = self;
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
                let value = Value::from_bytes(&class.bits.to_le_bytes()[..ground.width]);
                let arcs = &sweep.arcs;
                let value_type = ground.value;
                each(&ClassRegion { value, value_type, cells, rings: &rings, arcs, rules: *rules, frame })?;
            }
            rings.release(&mut sweep.arcs);
            sweep.labels.remove(root);
        }
        sweep.arcs.spool()
    }
}
