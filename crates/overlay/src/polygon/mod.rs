//! Polygons in a plane of cells: the cells whose centres are inside, the cells that are touched,
//! and the share of each cell's area that is inside.
//!
//! This is the only polygon rasterizer of the project. Rings of one part are combined by the
//! even-odd rule, parts by union. If rings cross or touch, or parts overlap, the boundary of their
//! union replaces them: `simple.rs` detects them and [`PolygonOverlay`] unites them. All other
//! polygons keep their vertices. Predicates are exact on these.

mod original_parts;
mod rows;
mod shares;
mod simple;

use std::ops::Range;
use std::path::Path;

pub use rows::Crossings;
pub use shares::FULL_SHARE;

use crate::exact::side;
use crate::grid::OverlayGrid;
use crate::overlay::PolygonOverlay;
use original_parts::OriginalParts;
use rows::rounding;
use spinney_base::space::{Bounds, Cover};
use spinney_base::{Error, Result};

/// A polygon of one or more parts, in units of cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygon {
    /// Edges with the interior on their left. They share no points except vertices.
    edges: Vec<Edge>,
    /// Indices of the edges in horizontal bands of equal height, grouped by band.
    in_bands: Vec<u32>,
    /// End of each band in `in_bands`.
    ends: Vec<usize>,
    low: f64,
    high: f64,
    /// Minimum and maximum column of the vertices.
    sides: [f64; 2],
    /// The original parts if they were united; point queries use them.
    parts: Option<Box<OriginalParts>>,
    /// Maximum distance of the edges from those of the parts, along each axis; 0 if they are the
    /// same.
    displacement: f64,
    /// The area, in cells, of the whole polygon if this is only its fragment near the cells.
    whole_area: Option<f64>,
}

/// An edge from one vertex to the next.
type Edge = [[f64; 2]; 2];

/// A ring's vertices, without the first one repeated at the end.
type Ring = Vec<[f64; 2]>;

/// Maximum number of bands. Only the edges in a node's bands are tested against it.
const BANDS: usize = 1024;
/// Maximum mean number of bands per edge. Polygons with long edges have fewer bands. So a row tests
/// at most about this many times the edges that cross it, and memory is proportional to the number
/// of edges.
const BANDS_EACH: usize = 4;

/// Grid cells of a union across its largest coordinate, as a power of two. (Finer grids need exact
/// arithmetic for nearly all crossings.)
const UNION_BITS: i32 = 44;

/// Memory limit for uniting the parts of one polygon, in bytes.
const UNION_MEMORY: u64 = 1 << 30;

impl Polygon {
    /// Creates a polygon from rings, combined by the even-odd rule. Each may repeat its first
    /// vertex at the end.
    pub fn new(rings: &[Vec<[f64; 2]>]) -> Result<Polygon> {
        Polygon::of_parts(std::slice::from_ref(&rings.to_vec()))
    }

    /// Creates the union of several parts, each the even-odd combination of its rings. Rings may
    /// have any direction and order.
    ///
    /// Cost: O(n log n) for n vertices of valid rings. Invalid rings are overlaid, which takes
    /// about ten times as long.
    ///
    /// # Errors
    /// If there is no ring; if a ring has fewer than three vertices or a vertex that is not finite;
    /// if the rings cross each other so often that their union takes more than 1 GiB of memory.
    pub fn of_parts(parts: &[Vec<Vec<[f64; 2]>>]) -> Result<Polygon> {
        Polygon::check_parts(parts)?;
        let OrientedRings { rings, displacement } = oriented_rings(parts)?;
        let polygon = Polygon::of_rings(&rings)?;
        let Some(displacement) = displacement else { return Ok(polygon) };
        Ok(Polygon { parts: Some(Box::new(OriginalParts::new(parts)?)), displacement, ..polygon })
    }

    /// Whether rings crossed or touched each other, or parts overlapped, so that their union
    /// replaced them.
    pub fn was_invalid(&self) -> bool {
        self.parts.is_some()
    }

    /// Checks that parts make a valid input of [`Polygon::of_parts`].
    ///
    /// # Errors
    /// If there is no ring; if a ring has fewer than three vertices or a vertex that is not finite.
    pub fn check_parts(parts: &[Vec<Vec<[f64; 2]>>]) -> Result<()> {
        let mut count = 0;
        for ring in parts.iter().flatten() {
            if ring.len() < 3 {
                return Err(Error::invalid("polygon", "a ring with fewer than 3 vertices", "at least 3"));
            }
            if ring.iter().flatten().any(|number| !number.is_finite()) {
                return Err(Error::invalid("polygon", "a vertex that is not finite", "finite coordinates"));
            }
            count += 1;
        }
        if count == 0 { Err(Error::invalid("polygon", "no rings", "at least 1")) } else { Ok(()) }
    }

    /// Creates a polygon from rings that do not repeat their first vertices at the end.
    fn of_rings(rings: &[Ring]) -> Result<Polygon> {
        let (mut min, mut max) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut edges: Vec<Edge> = Vec::with_capacity(rings.iter().map(Vec::len).sum());
        for ring in rings {
            let Some(mut before) = ring.last() else { continue };
            for vertex in ring {
                for axis in 0..2 {
                    min[axis] = min[axis].min(vertex[axis]);
                    max[axis] = max[axis].max(vertex[axis]);
                }
                edges.push([*before, *vertex]);
                before = vertex;
            }
        }
        if edges.is_empty() {
            // (Rings without an interior leave no edges.)
            (min, max) = ([0.0; 2], [0.0; 2]);
        }
        let ([left, low], [right, high]) = (min, max);
        if u32::try_from(edges.len()).is_err() {
            return Err(Error::invalid("polygon", format!("{} vertices", edges.len()), "fewer than 2^32"));
        }
        let (in_bands, ends, sides) = (Vec::new(), Vec::new(), [left, right]);
        let mut polygon = Polygon {
            edges,
            in_bands,
            ends,
            low,
            high,
            sides,
            parts: None,
            displacement: 0.0,
            whole_area: None,
        };
        // (No more bands than rows or edges.)
        let count = BANDS.min(polygon.edges.len()).max(1);
        let mut bands = (high - low).ceil().clamp(1.0, count as f64) as usize;
        loop {
            polygon.ends = vec![0; bands];
            let entries: usize = polygon.edges.iter().map(|edge| polygon.bands_of(edge).len()).sum();
            if bands == 1 || entries <= BANDS_EACH * polygon.edges.len() {
                break;
            }
            bands /= 2;
        }
        polygon.fill_bands();
        Ok(polygon)
    }

    /// Enters the edges into their bands.
    fn fill_bands(&mut self) {
        let mut starts = vec![0; self.ends.len() + 1];
        for edge in &self.edges {
            self.bands_of(edge).for_each(|band| starts[band + 1] += 1);
        }
        for band in 1..starts.len() {
            starts[band] += starts[band - 1];
        }
        self.in_bands = vec![0; starts[self.ends.len()]];
        for (number, edge) in self.edges.iter().enumerate() {
            for band in self.bands_of(edge) {
                self.in_bands[starts[band]] = number as u32;
                starts[band] += 1;
            }
        }
        // (Each start has advanced to the band's end.)
        starts.pop();
        self.ends = starts;
    }

    /// Returns the bands that an edge passes through.
    fn bands_of(&self, [a, b]: &Edge) -> Range<usize> {
        self.bands(a[1].min(b[1]), a[1].max(b[1]))
    }

    /// Iterates over the edges in a range of bands, band by band.
    fn edges_in(&self, bands: Range<usize>) -> impl Iterator<Item = &Edge> {
        self.numbers_in(bands).iter().map(|number| &self.edges[*number as usize])
    }

    /// Returns the numbers of the edges in a range of bands.
    fn numbers_in(&self, bands: Range<usize>) -> &[u32] {
        let start = if bands.start == 0 { 0 } else { self.ends[bands.start - 1] };
        &self.in_bands[start..self.ends[bands.end - 1]]
    }

    /// Iterates over the numbers of the edges in the bands between two rows, each once.
    fn numbers_between(&self, from: f64, to: f64) -> impl Iterator<Item = u32> {
        let bands = self.bands(from, to);
        bands.clone().flat_map(move |band| {
            // (An edge in several bands counts in the first of them.)
            let first = bands.start;
            let is_first = move |number: &u32| {
                band == first || self.bands_of(&self.edges[*number as usize]).start == band
            };
            self.numbers_in(band..band + 1).iter().copied().filter(is_first)
        })
    }

    /// Returns the minimum and maximum coordinates of the vertices.
    pub fn corners(&self) -> [[f64; 2]; 2] {
        [[self.sides[0], self.low], [self.sides[1], self.high]]
    }

    /// Returns the bands of the rows from one coordinate to another.
    fn bands(&self, from: f64, to: f64) -> Range<usize> {
        let height = (self.high - self.low).max(f64::MIN_POSITIVE);
        let count = self.ends.len() as f64;
        let band = |y: f64| ((y - self.low) / height * count).clamp(0.0, count - 1.0) as usize;
        band(from)..band(to) + 1
    }

    /// Whether the cells' centres are inside. The result for a single cell is never
    /// [`Cover::Partial`].
    pub fn cover_centres(&self, bounds: &Bounds) -> Cover {
        let low = [centre(bounds.min[0]), centre(bounds.min[1])];
        let high = [centre(bounds.max[0] - 1), centre(bounds.max[1] - 1)];
        if high[1] < self.low - self.displacement || low[1] > self.high + self.displacement {
            return Cover::Nothing;
        }
        let is_cell = low == high;
        let near = |edge: &Edge| !is_cell && self.may_pass(edge, low, high);
        if self.edges_in(self.bands(low[1], high[1])).any(near) {
            return Cover::Partial;
        }
        // No edge passes between the centres, so the parity of the first one holds for all.
        if self.contains(low) { Cover::Whole } else { Cover::Nothing }
    }

    /// Whether the whole area of the cells is inside. May return [`Cover::Partial`] if an edge is
    /// close to the box.
    pub fn cover_area(&self, bounds: &Bounds) -> Cover {
        let low = [bounds.min[0] as f64, bounds.min[1] as f64];
        let high = [bounds.max[0] as f64, bounds.max[1] as f64];
        if high[1] <= self.low || low[1] >= self.high || high[0] <= self.sides[0] || low[0] >= self.sides[1] {
            return Cover::Nothing;
        }
        let near = |edge: &Edge| self.may_pass(edge, low, high);
        if self.edges_in(self.bands(low[1], high[1])).any(near) {
            return Cover::Partial;
        }
        if self.contains([centre(bounds.min[0]), centre(bounds.min[1])]) {
            Cover::Whole
        } else {
            Cover::Nothing
        }
    }

    /// Whether a point is inside; exact. A point on the boundary is inside if the region to its
    /// right is inside, or, along a horizontal edge, the region in the rows after it. So it is
    /// inside exactly one of two polygons that share the boundary.
    pub fn contains(&self, [x, y]: [f64; 2]) -> bool {
        if let Some(parts) = &self.parts {
            return parts.contain([x, y]);
        }
        if y < self.low || y > self.high {
            return false;
        }
        // (Ends in the row count as before it. So a ray through a vertex crosses one of its two
        // edges, or both, or none.)
        let edges = self.edges_in(self.bands(y, y));
        edges.filter(|edge| crosses(edge, y) && is_right_of(edge, [x, y])).count() % 2 == 1
    }

    /// Whether an edge, before its displacement, may touch a box. Rounding may cause false
    /// positives, but never false negatives.
    fn may_pass(&self, edge: &Edge, low: [f64; 2], high: [f64; 2]) -> bool {
        let ([a, b], moved) = (edge, self.displacement);
        for axis in 0..2 {
            if a[axis].max(b[axis]) < low[axis] - moved || a[axis].min(b[axis]) > high[axis] + moved {
                return false;
            }
        }
        // Sides of the edge's line on which the corners of the box lie.
        let normal = [a[1] - b[1], b[0] - a[0]];
        let side = |x: f64, y: f64| normal[0] * (x - a[0]) + normal[1] * (y - a[1]);
        let sides =
            [side(low[0], low[1]), side(high[0], low[1]), side(low[0], high[1]), side(high[0], high[1])];
        // Rounding error of these sums. The slack below also covers the rounding of the columns
        // that `spans` and `shares` compute.
        let reach = |axis: usize| (low[axis] - a[axis]).abs().max((high[axis] - a[axis]).abs());
        let error = (normal[0].abs() * reach(0) + normal[1].abs() * reach(1)) * 8.0 * f64::EPSILON;
        let slack = normal[0].abs() * (moved + rounding(edge)) + normal[1].abs() * moved + error;
        !(sides.iter().all(|side| *side > slack) || sides.iter().all(|side| *side < -slack))
    }

    /// Marks the polygon as the fragment near the cells of a larger one with this area, in cells.
    #[must_use]
    pub fn part_of(self, area: f64) -> Polygon {
        Polygon { whole_area: Some(area), ..self }
    }

    /// Returns the area, in cells.
    pub fn area(&self) -> f64 {
        self.edges.iter().map(|edge| area_left(edge, [self.low, self.high], self.sides)).sum::<f64>().abs()
    }

    /// Returns the area outside of a box, in cells; for a [fragment](Polygon::part_of), that of the
    /// whole polygon.
    pub fn area_outside(&self, bounds: &Bounds) -> f64 {
        let outside = self.own_area_outside(bounds);
        self.whole_area.map_or(outside, |whole| (whole - (self.area() - outside)).max(0.0))
    }

    fn own_area_outside(&self, bounds: &Bounds) -> f64 {
        let [left, right] = [bounds.min[0] as f64, bounds.max[0] as f64];
        let [top, bottom] = [bounds.min[1] as f64, bounds.max[1] as f64];
        let ([from, to], [low, high]) = (self.sides, [self.low, self.high]);
        // Each region outside of the box is measured separately: differences of large areas would
        // leave rounding errors where the area is 0.
        let regions = [
            ([from, to.min(left)], [low, high]),
            ([from.max(right), to], [low, high]),
            ([from.max(left), to.min(right)], [low, high.min(top)]),
            ([from.max(left), to.min(right)], [low.max(bottom), high]),
        ];
        let area = |(columns, rows): &([f64; 2], [f64; 2])| match columns[0] < columns[1] && rows[0] < rows[1]
        {
            true => self.edges.iter().map(|edge| area_left(edge, *rows, *columns)).sum::<f64>().abs(),
            false => 0.0,
        };
        regions.iter().map(area).sum()
    }
}

/// Rings with the interior on their left that share no points except vertices.
pub struct OrientedRings {
    /// The rings, without their first vertices repeated at the end.
    pub rings: Vec<Vec<[f64; 2]>>,
    /// Maximum distance along each axis of the union's edges from the original ones, if the rings
    /// are those of a union because rings crossed or touched each other or parts overlapped. `None`
    /// if the original rings are kept.
    pub displacement: Option<f64>,
}

/// Returns the rings around the union of several parts, each the even-odd combination of its rings:
/// see [`Polygon::of_parts`]. Vertices must be finite.
pub fn oriented_rings(parts: &[Vec<Vec<[f64; 2]>>]) -> Result<OrientedRings> {
    let own: Vec<Vec<Ring>> = parts.iter().map(|part| part.iter().map(without_repeats).collect()).collect();
    // (Rings of fewer than three distinct vertices bound no area: the union drops them.)
    let reversed = match own.iter().flatten().all(|ring| ring.len() > 2) {
        true => simple::reversed_rings(&own),
        false => None,
    };
    let Some(reversed) = reversed else {
        return united(&own);
    };
    let oriented = |(mut ring, is_reversed): (Ring, bool)| {
        if is_reversed {
            ring.reverse();
        }
        ring
    };
    let rings = own.into_iter().flatten().zip(reversed).map(oriented).collect();
    Ok(OrientedRings { rings, displacement: None })
}

/// Returns a ring without consecutive duplicate vertices.
fn without_repeats(ring: &Ring) -> Ring {
    let mut ring = ring.clone();
    ring.dedup();
    while ring.len() > 1 && ring.first() == ring.last() {
        ring.pop();
    }
    ring
}

/// Returns the rings around the union of some parts, with the interior on their left, on a grid
/// whose cells are about 2^-44 of the largest coordinate.
fn united(parts: &[Vec<Ring>]) -> Result<OrientedRings> {
    let largest = parts.iter().flatten().flatten().flatten().fold(0.0f64, |most, at| most.max(at.abs()));
    let grid = OverlayGrid::with_bits(largest, UNION_BITS);
    let mut overlay = PolygonOverlay::new(grid, UNION_MEMORY);
    for rings in parts {
        overlay.add(Path::new("polygon"), 0, rings)?;
    }
    let mut rings = Vec::new();
    overlay.regions(&mut |_| Some(Vec::new()), &(), &mut |region| {
        rings.extend(region.polygons.into_iter().flatten().map(|ring| without_repeats(&ring)));
        Ok(())
    })?;
    // (Snap rounding moves no point by more than half a cell.)
    Ok(OrientedRings { rings, displacement: Some(grid.width() / 2.0) })
}

/// Coordinate of a cell's centre along an axis.
fn centre(cell: u64) -> f64 {
    cell as f64 + 0.5
}

/// Whether an edge crosses a row. An end in the row counts as before it.
#[inline]
fn crosses([a, b]: &Edge, y: f64) -> bool {
    (a[1] > y) != (b[1] > y)
}

/// Whether an edge that crosses a point's row does so to the right of the point; exact.
#[inline]
fn is_right_of([a, b]: &Edge, point: [f64; 2]) -> bool {
    let (from, to) = if a[1] <= b[1] { (a, b) } else { (b, a) };
    // (To the left of an edge towards higher rows are lower columns.)
    side(*from, *to, point) > 0
}

/// Area left of an edge within a box between two rows: positive for edges that lead to higher rows.
fn area_left([a, b]: &Edge, rows: [f64; 2], [left, right]: [f64; 2]) -> f64 {
    let (is_up, [from, to]) = if a[1] <= b[1] { (true, [a, b]) } else { (false, [b, a]) };
    let [low, high] = [rows[0].max(from[1]), rows[1].min(to[1])];
    if low >= high {
        return 0.0;
    }
    let at = |y: f64| from[0] + (y - from[1]) / (to[1] - from[1]) * (to[0] - from[0]);
    let [start, end] = [at(low), at(high)];
    let area = integral(start, end, left, right) * (high - low);
    if is_up { area } else { -area }
}

/// Mean width, along a line from column `start` to column `end`, of the range from `left` to
/// `right` that lies to its left.
fn integral(start: f64, end: f64, left: f64, right: f64) -> f64 {
    let (least, most) = (start.min(end), start.max(end));
    if most <= left {
        return 0.0;
    }
    if least >= right {
        return right - left;
    }
    if least >= left && most <= right {
        return (least + most) / 2.0 - left;
    }
    // The line may have a section left of the range, one inside and one to its right.
    let (first, last) = (least.max(left), most.min(right));
    let inside = (last - first) * ((first + last) / 2.0 - left);
    let beyond = (most - right).max(0.0) * (right - left);
    (inside + beyond) / (most - least)
}

#[cfg(test)]
mod tests;
