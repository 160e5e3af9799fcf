//! The grid that operands of one operation are brought to: the first's cells, over the requested part of the world.

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

/// The part of the world that a result covers, on the first operand's cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OutputExtent {
    /// The first operand's extent.
    A,
    /// The extent of the others.
    B,
    /// The extents of all.
    #[default]
    Union,
    /// The part that all extents share.
    Intersection,
}

impl OutputExtent {
    /// All of them.
    pub const ALL: [OutputExtent; 4] = {
        use OutputExtent::*;
        [A, B, Union, Intersection]
    };

    /// The name on the command line.
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

/// Positions agree if they differ by less than this, in cells: frames of one grid differ by rounding (degrees with six decimals, origins
/// with centimetres), which no cell of a result should show.
const CLOSE: f64 = 1e-3;

/// A box of cells: where it begins, and where it ends.
type CellBox = (DVec3, DVec3);

/// The way of an operand to the grid.
#[derive(Clone, Debug)]
enum CellMapping {
    /// By a map from its cells to those of the first operand, which takes cells to whole blocks of cells, or whole blocks to cells, or
    /// neither.
    Affine { map: AffineMap, is_nested: bool },
    /// By the warper: from another coordinate system, or round the world. Cells are copied where they lie on cells.
    Warp { copies: bool },
}

/// The first operand's cells over a part of the world, and where the operands lie in it.
#[derive(Clone, Debug)]
pub(in crate::ops) struct CommonGrid {
    pub(in crate::ops) frame: Frame,
    pub(in crate::ops) extent: [u64; 3],
    /// The first operand's cell that is the grid's first.
    origin: DVec3,
    mappings: Vec<CellMapping>,
    /// The boxes of cells of the first operand in which all of them lie.
    boxes: Vec<CellBox>,
}

/// The grid on which a raster is like another one: the other's cells, over the extents of both.
///
/// # Errors
/// If one has no coordinate system and the other has, or the two lie too far apart for one tree.
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

/// Where the second of two operands lies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::ops) enum Position {
    /// Where its frame says.
    #[default]
    World,
    /// With its first cell at this one of the first operand.
    Cell([i64; 3]),
}

/// An operand's cells in the world.
pub(in crate::ops) struct Located<'a> {
    /// Its name, for messages.
    pub(in crate::ops) name: &'a str,
    pub(in crate::ops) frame: Frame,
    pub(in crate::ops) extent: [u64; 3],
    /// Those of its cells that the grid is to cover.
    pub(in crate::ops) data: Bounds,
    /// Metres of the world's unit of length, where it is known without a coordinate system.
    pub(in crate::ops) metres: Option<f64>,
    /// Whether cells are coverage, so that the least part of a cell counts.
    pub(in crate::ops) is_coverage: bool,
    /// Whether datums may be taken for WGS 84.
    pub(in crate::ops) allow_ballpark: bool,
}

impl<'a> Located<'a> {
    /// All cells of an extent, which are not coverage; `unit` is the tree's unit of length, if it has one.
    pub(in crate::ops) fn new(
        name: &'a str,
        frame: Frame,
        unit: Option<&str>,
        extent: [u64; 3],
    ) -> Located<'a> {
        let metres = unit.filter(|_| frame.crs.is_none()).and_then(Unit::parse).and_then(Unit::metres);
        let data = Bounds::picture(extent);
        Located { name, frame, extent, data, metres, is_coverage: false, allow_ballpark: false }
    }

    /// The cells of a view.
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
    /// The grid for the cells of some operands, of which there must be one at least.
    ///
    /// # Errors
    /// If a coordinate system is unknown that has to be known, a motion has no inverse, or the result is larger than a tree.
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
                "at most {most} along each axis, as trees have; the operands lie far apart, and --extent a keeps the first's extent"
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

    /// The first cell of an operand in the grid, if its cells are cells of the grid, in its directions.
    pub(in crate::ops) fn shift(&self, number: usize) -> Option<[i64; 3]> {
        let CellMapping::Affine { map, is_nested: true } = &self.mappings[number] else { return None };
        let first = map.to_rows().map(|row| row[3]);
        map.is_translation().then(|| std::array::from_fn(|axis| (first[axis] - self.origin[axis]) as i64))
    }

    /// The cells of the grid in which an operand's cells lie, as far as they are in it.
    pub(in crate::ops) fn box_of(&self, number: usize) -> Bounds {
        let (low, high) = self.boxes[number];
        let end = cells(self.extent);
        let cell =
            |corner: DVec3| (corner - self.origin).clamp(DVec3::ZERO, end).to_array().map(|cell| cell as u64);
        Bounds { min: cell(low), max: cell(high) }
    }

    /// A line about an operand that is resampled; nothing if its cells are cells of the grid, or whole blocks of these.
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
                let is_area = map.keeps_axes() || view.form().dimension == Dimension::Quad;
                let way = if is_area { rule.name() } else { Rule::Nearest.name() };
                Some(format!(
                    "is resampled by {way} to the first file's cells: its own are {:.6} x {:.6} of these, and begin at column {:.6}, row {:.6}",
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

    /// A view of an operand on the grid.
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
                // (Whole blocks are copied whatever the way.)
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
                // The warper does the same block by block, much faster, and with areas of cells that lie askew, too.
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

/// Fails if the systems of two trees differ, or one of them alone is known.
fn check_systems((first, own): (&str, Option<&Crs>), (second, other): (&str, Option<&Crs>)) -> Result<()> {
    let (known, known_name, unknown) = match (own, other) {
        (None, None) => return Ok(()),
        (Some(own), Some(other)) if own.is_same(other) => return Ok(()),
        (Some(own), Some(other)) => {
            let expected = format!(
                "{own}, as {first} has; trees of three axes are not reprojected: build both of data in one coordinate system"
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
        "{known}, as {known_name} has; if it is in that system: `spinney transform {unknown} 'crs={}' -o KNOWN.goblin`",
        known.short_definition()
    );
    Err(Error::invalid(format!("coordinate system of {unknown}"), "none", expected))
}

/// How a box comes to lie next to another one, once round the world or not.
enum Turned {
    /// It is moved by so many cells.
    Moved(f64),
    /// The two go all round the world, over these columns.
    Whole((f64, f64)),
}

/// Brings a box, whose columns come again after so many, to where it is next to the first's.
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

/// The cells of which a box covers half along each axis, or any part: one at least.
///
/// Half a cell is what resampling gives a value to, so that a border cell that the box hardly touches is not added as VOID. Coverage is a
/// share of a cell: the least part of a body is kept.
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
        let expected = "a part of the world that all files share; extent=union (an option of combine: --extent union) covers all of them";
        Error::invalid("extent of the result", "none", expected)
    })
}

fn cells(extent: [u64; 3]) -> DVec3 {
    DVec3::from(extent.map(|cells| cells as f64))
}

fn is_upright(frame: &Frame) -> bool {
    frame.matrix[0][1] == 0.0 && frame.matrix[1][0] == 0.0
}

/// The frame without what it says of heights, which mean nothing to quadtrees.
fn planar(frame: Frame, axes: usize) -> Frame {
    if axes > 2 { frame } else { Frame { matrix: Frame::planar(frame.affine()).matrix, ..frame } }
}

/// The map that makes lengths in the unit of the first operand's world of those in the second's, where both are known.
fn length_map(first: &Located<'_>, second: &Located<'_>) -> AffineMap {
    match (first.metres, second.metres) {
        (Some(here), Some(there)) if here != there => AffineMap::scaling([there / here; 3]),
        _ => AffineMap::IDENTITY,
    }
}

/// The map without rounding errors, and whether it takes whole cells to whole blocks of cells, or whole blocks of cells to cells.
///
/// Invariant of nested maps: every factor is exactly 0 or a power of two with its sign, one in each row and column, all of them at least 1
/// or all at most 1; the first cell is exactly at a whole cell, or of smaller cells at a whole one of theirs. So `bring` copies nodes without
/// arithmetic on their values, and `shift` has exact integers.
fn cleaned(map: &AffineMap, extent: [u64; 3]) -> (AffineMap, bool) {
    let mut rows = map.to_rows();
    let most = extent.into_iter().max().unwrap_or(1) as f64;
    let mut is_nested = true;
    for row in &mut rows {
        let mut factor = 1.0;
        for number in &mut row[..3] {
            let power = 2f64.powi(number.abs().log2().round().clamp(-60.0, 60.0) as i32).copysign(*number);
            // (What a factor is off adds up over all cells.)
            if number.abs() * most < CLOSE {
                *number = 0.0;
            } else if (*number - power).abs() * most < CLOSE {
                *number = power;
                factor = power.abs().min(1.0);
            } else {
                is_nested = false;
            }
        }
        // (Smaller cells begin where one of the larger does.)
        let whole = (row[3] / factor).round() * factor;
        if (row[3] - whole).abs() > CLOSE * factor {
            is_nested = false;
        } else {
            row[3] = whole;
        }
    }
    let cleaned = AffineMap::from_rows(rows);
    let is_nested = is_nested && cleaned.keeps_axes() && cleaned.inverse().is_ok();
    // (Blocks along one axis and parts of cells along another are resampled.)
    let sizes = rows.map(|row| row[..3].iter().fold(0.0, |size: f64, number| size.max(number.abs())));
    let is_nested =
        is_nested && (sizes.iter().all(|size| *size >= 1.0) || sizes.iter().all(|size| *size <= 1.0));
    (cleaned, is_nested)
}
