//! Common grid of an operation's operands: the first one's cells, over the requested extent.

use std::fmt;
use std::str::FromStr;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::ops::affine::{AffineMap, Sampling, View};
use crate::ops::warp::{Resampling, WarpGrid, landing_in_cells};
use crate::tree::Source;
use spinney_base::space::{Bounds, Dimension};
use spinney_base::value::Rule;
use spinney_base::{Error, Result};
use spinney_container::{Tag, Unit};
use spinney_crs::{Crs, Frame};

/// Region of the world that a result covers, on the first operand's cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OutputExtent {
    /// Extent of the first operand.
    A,
    /// Extent of the others.
    B,
    /// Extents of all.
    #[default]
    Union,
    /// Intersection of all extents.
    Intersection,
}

impl OutputExtent {
    /// All choices.
    pub const ALL: [OutputExtent; 4] = {
        use OutputExtent::*;
        [A, B, Union, Intersection]
    };

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        ["a", "b", "union", "intersection"][self as usize]
    }
}

impl fmt::Display for OutputExtent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for OutputExtent {
    type Err = Error;

    fn from_str(name: &str) -> Result<OutputExtent> {
        let found = OutputExtent::ALL.into_iter().find(|extent| extent.name() == name);
        let names = OutputExtent::ALL.map(OutputExtent::name).join(", ");
        found.ok_or_else(|| Error::invalid("extent", format!("`{name}`"), names))
    }
}

/// Tolerance of positions, in cells: frames of one grid differ by rounding (degrees with six
/// decimals, origins in centimetres), which must not be visible in a result's cells.
const CLOSE: f64 = 1e-3;

/// Box of cells: start and end.
type CellBox = (DVec3, DVec3);

/// How an operand is mapped to the grid.
#[derive(Clone, Debug)]
enum CellMapping {
    /// By an affine map from its cells to those of the first operand. If `is_nested`, it maps cells
    /// to whole blocks of cells, or whole blocks to cells.
    Affine { map: AffineMap, is_nested: bool },
    /// By the warper: from another coordinate system, or around the world. If `copies`, cells
    /// coincide and are copied.
    Warp { copies: bool },
}

/// The first operand's cells over a region of the world, and the positions of all operands in it.
#[derive(Clone, Debug)]
pub(in crate::ops) struct CommonGrid {
    pub(in crate::ops) frame: Frame,
    pub(in crate::ops) extent: [u64; 3],
    /// Cell of the first operand that is the grid's first.
    origin: DVec3,
    mappings: Vec<CellMapping>,
    /// Boxes of all operands, in cells of the first one.
    boxes: Vec<CellBox>,
}

/// Grid that aligns a raster with another one: the other's cells, over the extents of both.
///
/// # Errors
/// If only one of them has a coordinate system, or they are too far apart for one tree.
pub fn grid_like(
    (name, other): (&str, &WarpGrid),
    (own_name, own): (&str, &WarpGrid),
    allow_ballpark: bool,
) -> Result<WarpGrid> {
    let operands = [(name, other), (own_name, own)];
    let operands = operands.map(|(name, grid)| Located {
        allow_ballpark,
        ..Located::new(name, grid.frame.clone(), None, grid.extent)
    });
    let grid = CommonGrid::of(&operands, Dimension::Quad, OutputExtent::Union, Position::World)?;
    Ok(grid.warp_grid())
}

/// Position of the second of two operands.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::ops) enum Position {
    /// Given by its frame.
    #[default]
    World,
    /// Its first cell is at this cell of the first operand.
    Cell([i64; 3]),
}

/// Cells of an operand in the world.
pub(in crate::ops) struct Located<'a> {
    /// Name, for messages.
    pub(in crate::ops) name: &'a str,
    pub(in crate::ops) frame: Frame,
    pub(in crate::ops) extent: [u64; 3],
    /// Cells that the grid has to cover.
    pub(in crate::ops) data: Bounds,
    /// Metres per unit of length, if known without a coordinate system.
    pub(in crate::ops) metres: Option<f64>,
    /// Whether cells store coverage, so that any fraction of a cell counts.
    pub(in crate::ops) is_coverage: bool,
    /// Whether datums may be treated as WGS 84.
    pub(in crate::ops) allow_ballpark: bool,
}

impl<'a> Located<'a> {
    /// All cells of an extent, which are not coverage; `unit` is the tree's unit of length, if it
    /// has one.
    pub(in crate::ops) fn new(
        name: &'a str,
        frame: Frame,
        unit: Option<&str>,
        extent: [u64; 3],
    ) -> Located<'a> {
        let metres = unit.filter(|_| frame.crs.is_none()).and_then(Unit::parse).and_then(Unit::metres);
        let data = Bounds::of_extent(extent);
        Located { name, frame, extent, data, metres, is_coverage: false, allow_ballpark: false }
    }

    /// Cells of a view.
    pub(in crate::ops) fn of(name: &'a str, view: &View) -> Located<'a> {
        let unit = view.source().metadata().tag(Tag::Unit);
        Located {
            is_coverage: view.source().header().rule == Rule::Occupancy,
            allow_ballpark: view.allows_ballpark(),
            ..Located::new(name, view.frame(false), unit, view.extent())
        }
    }
}

impl CommonGrid {
    /// Grid for the cells of at least one operand.
    ///
    /// # Errors
    /// If a required coordinate system is unknown, a map is not invertible, or the result exceeds
    /// the maximum size of trees.
    pub(in crate::ops) fn of(
        operands: &[Located<'_>],
        dimension: Dimension,
        choice: OutputExtent,
        position: Position,
    ) -> Result<CommonGrid> {
        let first = &operands[0];
        let axes = dimension.axes();
        let frame = planar(first.frame.clone(), axes);
        let own = (DVec3::ZERO, cells(first.extent));
        let mut mappings = vec![CellMapping::Affine { map: AffineMap::IDENTITY, is_nested: true }];
        let mut boxes = vec![own];
        for other in &operands[1..] {
            if let Position::Cell(at) = position {
                let map = AffineMap::translation(at.map(|cell| cell as f64));
                boxes.push(map.bounding_box(cells(other.data.min), cells(other.data.max)));
                mappings.push(CellMapping::Affine { map, is_nested: true });
                continue;
            }
            let there = planar(other.frame.clone(), axes);
            let has_other_crs =
                matches!((&frame.crs, &there.crs), (Some(a), Some(b)) if !a.is_same(b)) && axes == 2;
            if has_other_crs {
                let (low, high) =
                    landing_in_cells(&frame, (&there, other.extent[0]), &other.data, other.allow_ballpark)?;
                mappings.push(CellMapping::Warp { copies: false });
                boxes.push((DVec3::new(low[0], low[1], 0.0), DVec3::new(high[0], high[1], 1.0)));
                continue;
            }
            check_systems((first.name, frame.crs.as_ref()), (other.name, there.crs.as_ref()))?;
            let to_world = AffineMap::from_rows(there.matrix).then(&length_map(first, other));
            let map = to_world.then(&AffineMap::from_rows(frame.matrix).inverse()?);
            let (map, is_nested) = cleaned(&map, other.extent);
            let (low, high) = map.bounding_box(cells(other.data.min), cells(other.data.max));
            let turn = frame.crs.as_ref().and_then(Crs::turn).filter(|_| axes == 2 && is_upright(&frame));
            let turned =
                turn.map(|turn| around_the_world(&own, &(low, high), turn / frame.matrix[0][0].abs()));
            match turned {
                Some(Turned::Whole(range)) => {
                    let is_whole = |number: f64| (number - number.round()).abs() < CLOSE;
                    let copies = is_nested && map.determinant().abs() == 1.0 && is_whole(range.1 - range.0);
                    mappings.push(CellMapping::Warp { copies });
                    boxes.push((DVec3::new(range.0, low.y, low.z), DVec3::new(range.1, high.y, high.z)));
                }
                moved => {
                    let by = if let Some(Turned::Moved(by)) = moved { by } else { 0.0 };
                    let by = if is_nested { by.round() } else { by };
                    let by = DVec3::new(by, 0.0, 0.0);
                    let map = map.then(&AffineMap::translation(by.to_array()));
                    mappings.push(CellMapping::Affine { map, is_nested });
                    boxes.push((low + by, high + by));
                }
            }
        }
        let boxes =
            boxes.into_iter().zip(operands).map(|(found, operand)| whole_cells(found, operand.is_coverage));
        let boxes: Vec<CellBox> = boxes.collect();
        let (low, high) = covered(&boxes, choice)?;
        let origin = if axes == 2 { low.with_z(0.0) } else { low };
        let size = if axes == 2 { (high - low).with_z(1.0) } else { high - low };
        let most = (1u64 << dimension.max_depth()) as f64;
        if size.max_element() > most {
            let found = format!("{} x {} x {} cells", size.x, size.y, size.z);
            let expected = format!(
                "at most {most} along each axis, the limit of trees; if the operands are far apart, --extent a keeps the extent of the first"
            );
            return Err(Error::invalid("size of the result", found, expected));
        }
        let extent = size.to_array().map(|cells| cells as u64);
        Ok(CommonGrid { frame: frame.shifted(origin.to_array()), extent, origin, mappings, boxes })
    }

    /// Whether the grid is that of the first operand, which has this extent.
    pub(in crate::ops) fn is_own(&self, extent: [u64; 3]) -> bool {
        self.origin == DVec3::ZERO && self.extent == extent
    }

    /// Grid position of an operand's first cell, if its cells coincide with the grid's, in the same
    /// directions.
    pub(in crate::ops) fn shift(&self, number: usize) -> Option<[i64; 3]> {
        let CellMapping::Affine { map, is_nested: true } = &self.mappings[number] else { return None };
        let first = map.to_rows().map(|row| row[3]);
        map.is_translation().then(|| std::array::from_fn(|axis| (first[axis] - self.origin[axis]) as i64))
    }

    /// Box of grid cells that an operand covers, clipped to the grid.
    pub(in crate::ops) fn box_of(&self, number: usize) -> Bounds {
        let (low, high) = self.boxes[number];
        let end = cells(self.extent);
        let cell =
            |corner: DVec3| (corner - self.origin).clamp(DVec3::ZERO, end).to_array().map(|cell| cell as u64);
        Bounds { min: cell(low), max: cell(high) }
    }

    /// Message about an operand that is resampled; `None` if its cells are cells of the grid, or
    /// whole blocks of these.
    pub(in crate::ops) fn resampled(&self, number: usize, view: &View) -> Option<String> {
        let frame = view.frame(false);
        let crs = |frame: &Frame| frame.crs.as_ref().map_or("no coordinate system".into(), Crs::to_string);
        let rule = view.source().header().rule;
        match &self.mappings[number] {
            CellMapping::Affine { map, is_nested: true } if map.determinant().abs() >= 1.0 => None,
            CellMapping::Affine { map, .. } => {
                let [x, y, z] = map.to_rows();
                let length =
                    |axis: usize| [x[axis], y[axis], z[axis]].iter().fold(0.0, |sum: f64, n| sum.hypot(*n));
                let is_area =
                    map.keeps_axes() || view.form().dimension == Dimension::Quad || rule == Rule::Occupancy;
                let way = if is_area { rule.name() } else { Rule::Nearest.name() };
                Some(format!(
                    "is resampled by {way} to the cells of the first file: one of its cells is {:.6} x {:.6} of those, and its first cell starts at column {:.6}, row {:.6}",
                    length(0),
                    length(1),
                    x[3],
                    y[3],
                ))
            }
            CellMapping::Warp { copies: true } => None,
            CellMapping::Warp { .. } => {
                Some(format!("is resampled from {} to {}", crs(&frame), crs(&self.frame)))
            }
        }
    }

    /// The grid as a target of the warper.
    fn warp_grid(&self) -> WarpGrid {
        WarpGrid { frame: self.frame.clone(), extent: self.extent }
    }

    /// View of an operand on the grid.
    ///
    /// # Errors
    /// Those of [`View::onto`] and [`View::warped`].
    pub(in crate::ops) fn bring(&self, number: usize, view: View) -> Result<View> {
        match &self.mappings[number] {
            CellMapping::Affine { map, .. } if *map == AffineMap::IDENTITY && self.is_own(view.extent()) => {
                Ok(view)
            }
            CellMapping::Affine { map, is_nested } => {
                let to_grid = map.then(&AffineMap::translation((-self.origin).to_array()));
                // (Whole blocks are copied, regardless of the resampling.)
                if *is_nested && map.determinant().abs() >= 1.0 {
                    return view.onto(&to_grid, self.extent);
                }
                let rule = view.source().header().rule;
                let is_nearest = view.warp().resampling == Some(Resampling::Nearest);
                let way = match rule {
                    _ if is_nearest => Some(Resampling::Nearest),
                    Rule::Mean => Some(Resampling::Area),
                    Rule::Majority => Some(Resampling::Majority),
                    Rule::Nearest => Some(Resampling::Nearest),
                    Rule::Min | Rule::Max | Rule::Dominant | Rule::Occupancy => None,
                };
                // The warper does the same block by block, much faster, and also averages areas of
                // cells that are not axis-aligned.
                let is_planar = view.form().dimension == Dimension::Quad;
                let is_possible = is_planar && !is_nested && view.has_its_cells();
                if let Some(way) = way.filter(|way| is_possible && way.fits(view.source().header().kind)) {
                    return view.resampling(Some(way)).warped(&self.warp_grid());
                }
                let view = if is_nearest { view } else { view.sampled(Sampling::Area(rule))? };
                view.onto(&to_grid, self.extent)
            }
            CellMapping::Warp { copies } => {
                let view = if *copies { view.resampling(Some(Resampling::Nearest)) } else { view };
                view.warped(&self.warp_grid())
            }
        }
    }
}

/// Fails if the systems of two trees differ, or only one of them is known.
fn check_systems((first, own): (&str, Option<&Crs>), (second, other): (&str, Option<&Crs>)) -> Result<()> {
    let (known, known_name, unknown) = match (own, other) {
        (None, None) => return Ok(()),
        (Some(own), Some(other)) if own.is_same(other) => return Ok(()),
        (Some(own), Some(other)) => {
            let expected = format!(
                "{own}, like {first}; octrees cannot be reprojected: build both from data in one coordinate system"
            );
            return Err(Error::invalid(
                format!("coordinate system of {second}"),
                other.to_string(),
                expected,
            ));
        }
        (Some(own), None) => (own, first, second),
        (None, Some(other)) => (other, second, first),
    };
    let expected = format!(
        "{known}, like {known_name}; if it is in that system: `spinney transform {unknown} 'crs={}' -o KNOWN.goblin`",
        known.short_definition()
    );
    Err(Error::invalid(format!("coordinate system of {unknown}"), "none", expected))
}

/// How a box is placed next to another one, around the world or not.
enum Turned {
    /// It is moved by a number of cells.
    Moved(f64),
    /// Both together span the whole world, over these columns.
    Whole((f64, f64)),
}

/// Moves a box with periodic columns next to the first one.
fn around_the_world(own: &CellBox, other: &CellBox, turn: f64) -> Turned {
    let middle = |(low, high): &CellBox| (low.x + high.x) / 2.0;
    let by = ((middle(own) - middle(other)) / turn).round() * turn;
    let start = own.0.x.min(other.0.x + by);
    let end = own.1.x.max(other.1.x + by);
    if end - start <= turn + CLOSE || own.1.x - own.0.x > turn + CLOSE {
        return Turned::Moved(by);
    }
    Turned::Whole((own.0.x, own.0.x + turn))
}

/// Cells of which a box covers at least half along each axis, or any fraction if `any_part`; at
/// least one.
///
/// Resampling gives a cell a value if half of it is covered, so a border cell that the box hardly
/// touches is not added as VOID. Coverage is a fraction of a cell: even a small part of a solid is
/// kept.
fn whole_cells((low, high): CellBox, any_part: bool) -> CellBox {
    let outer = ((low + CLOSE).floor(), (high - CLOSE).ceil());
    if any_part {
        return outer;
    }
    let inner = ((low + CLOSE).round(), (high - CLOSE).round());
    let has_cells = inner.0.cmplt(inner.1);
    (DVec3::select(has_cells, inner.0, outer.0), DVec3::select(has_cells, inner.1, outer.1))
}

fn covered(boxes: &[CellBox], choice: OutputExtent) -> Result<CellBox> {
    let all = |boxes: &[CellBox]| {
        boxes.iter().copied().reduce(|(low, high), (start, end)| (low.min(start), high.max(end)))
    };
    let shared = || boxes.iter().copied().reduce(|(low, high), (start, end)| (low.max(start), high.min(end)));
    let found = match choice {
        OutputExtent::A => Some(boxes[0]),
        OutputExtent::B => all(&boxes[1..]).or(Some(boxes[0])),
        OutputExtent::Union => all(boxes),
        OutputExtent::Intersection => shared(),
    };
    found.filter(|(low, high)| low.cmplt(*high).all()).ok_or_else(|| {
        let expected =
            "an area that all files share; extent=union (combine: --extent union) covers all files";
        Error::invalid("extent of the result", "none", expected)
    })
}

fn cells(extent: [u64; 3]) -> DVec3 {
    DVec3::from(extent.map(|cells| cells as f64))
}

fn is_upright(frame: &Frame) -> bool {
    frame.matrix[0][1] == 0.0 && frame.matrix[1][0] == 0.0
}

/// The frame without heights, which have no meaning in quadtrees.
fn planar(frame: Frame, axes: usize) -> Frame {
    if axes > 2 { frame } else { Frame { matrix: Frame::planar(frame.affine()).matrix, ..frame } }
}

/// Map from lengths in the unit of the second operand to those of the first, if both are known.
fn length_map(first: &Located<'_>, second: &Located<'_>) -> AffineMap {
    match (first.metres, second.metres) {
        (Some(here), Some(there)) if here != there => AffineMap::scaling([there / here; 3]),
        _ => AffineMap::IDENTITY,
    }
}

/// Removes rounding errors from a map. Also returns whether it maps whole cells to whole blocks of
/// cells, or whole blocks to cells.
///
/// Invariant of nested maps: every factor is exactly 0 or a signed power of two, one in each row
/// and column, all of magnitude at least 1 or all at most 1. The first cell is exactly at a whole
/// cell; if cells are smaller, at a multiple of their size. So `bring` copies nodes without
/// arithmetic on their values, and `shift` returns exact integers.
fn cleaned(map: &AffineMap, extent: [u64; 3]) -> (AffineMap, bool) {
    let mut rows = map.to_rows();
    let most = extent.into_iter().max().unwrap_or(1) as f64;
    let mut is_nested = true;
    for row in &mut rows {
        let mut factor = 1.0;
        for number in &mut row[..3] {
            let power = 2f64.powi(number.abs().log2().round().clamp(-60.0, 60.0) as i32).copysign(*number);
            // (The error of a factor adds up over all cells.)
            if number.abs() * most < CLOSE {
                *number = 0.0;
            } else if (*number - power).abs() * most < CLOSE {
                *number = power;
                factor = power.abs().min(1.0);
            } else {
                is_nested = false;
            }
        }
        // (Smaller cells are aligned with multiples of their size.)
        let whole = (row[3] / factor).round() * factor;
        if (row[3] - whole).abs() > CLOSE * factor {
            is_nested = false;
        } else {
            row[3] = whole;
        }
    }
    let cleaned = AffineMap::from_rows(rows);
    let is_nested = is_nested && cleaned.keeps_axes() && cleaned.inverse().is_ok();
    // (Blocks along one axis and fractions of cells along another are resampled.)
    let sizes = rows.map(|row| row[..3].iter().fold(0.0, |size: f64, number| size.max(number.abs())));
    let is_nested =
        is_nested && (sizes.iter().all(|size| *size >= 1.0) || sizes.iter().all(|size| *size <= 1.0));
    (cleaned, is_nested)
}
