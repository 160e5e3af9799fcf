//! Conversion of coordinates in any system to cells of a raster or a solid.

use crate::coordinates::Coordinates;
use crate::{Frame, Transformation};
use spinney_base::space::Bounds;
use spinney_base::{Error, Result};

mod clip;

/// The parts of a polygon, each an outer ring and its holes, with vertices x, y.
pub type PolygonParts = Vec<Vec<Vec<[f64; 2]>>>;

/// Converts coordinates in any system to cells of the deepest level.
///
/// Longitudes that differ by 360 degrees are equivalent: boxes across the 180th meridian and
/// longitudes from 0 to 360 are supported.
///
/// ```
/// use spinney::{CellLocator, Coordinates, Crs, Frame};
/// // From five degrees west to five degrees east of the 180th meridian.
/// let frame = Frame { crs: Some(Crs::epsg(4326)), ..Frame::planar([0.5, 0.0, 175.0, 0.0, -0.5, 10.0]) };
/// let locator = CellLocator::new(&Coordinates::LONLAT, &frame, [20, 20, 1])?;
/// assert_eq!(locator.cell([-179.0, 9.0, 0.0]), Some([12.0, 2.0, 0.0]));
/// assert_eq!(locator.boxes([179.0, 8.0, 0.0], [-179.0, 9.0, 0.0])?[0].size(), [4, 2, 1]);
/// # Ok::<(), spinney::Error>(())
/// ```
pub struct CellLocator {
    frame: Frame,
    extent: [u64; 3],
    way: Way,
}

enum Way {
    /// Input positions are cell coordinates.
    Cells,
    /// Input positions are in a coordinate reference system.
    World(Box<World>),
}

/// Conversion from a coordinate reference system, the frame's own or another one.
struct World {
    /// Transformation from the input system to the frame's; `None` for input in the frame's own
    /// system, whatever it is.
    systems: Option<Transformation>,
    /// Period of the input's first coordinate around the world, if it has one.
    turn: Option<f64>,
    /// Period of the tree's columns around the world, if they have one; negative if columns run
    /// westward.
    columns: Option<f64>,
    /// Minimum and maximum input coordinates of positions that can be in the tree, with a margin;
    /// infinite if not known.
    near: [[f64; 2]; 2],
    /// Minimum and maximum coordinates of the tree in the input system, if known.
    tree_bounds: Option<[[f64; 2]; 2]>,
    /// First input coordinate of the tree's centre, if known.
    middle: Option<f64>,
}

/// Tolerance, in cells, within which the sides of a box snap to cell borders.
const ROUNDING: f64 = 1e-6;
/// Number of lattice intervals along each side of the tree that sample its outline in the input
/// system.
const STEPS: usize = 64;

impl CellLocator {
    /// Creates a locator from coordinates to the cells of a tree with a frame and a number of cells
    /// along each axis. A datum whose shift to WGS 84 is not known is treated as WGS 84, with a
    /// remark: see [`CellLocator::remarks`].
    ///
    /// # Errors
    /// If the frame has no inverse, or no coordinate reference system although one is needed; if
    /// one of the two systems is not supported.
    pub fn new(coordinates: &Coordinates, frame: &Frame, extent: [u64; 3]) -> Result<CellLocator> {
        let way = match coordinates {
            Coordinates::Cells => Way::Cells,
            Coordinates::World => Way::in_world(None, frame, extent)?,
            Coordinates::System(crs) => {
                let Some(own) = &frame.crs else {
                    let expected = "a known one; set it with `spinney transform TREE crs=EPSG:NUMBER`";
                    return Err(Error::invalid("coordinate system of the tree", "none", expected));
                };
                Way::in_world(Some(Transformation::new(crs, own, true)?), frame, extent)?
            }
        };
        Ok(CellLocator { frame: frame.clone(), extent, way })
    }

    /// Returns remarks on the accuracy of both systems' datums.
    pub fn remarks(&self) -> Vec<String> {
        match &self.way {
            Way::World(world) => world.systems.as_ref().map_or(Vec::new(), Transformation::remarks),
            Way::Cells => Vec::new(),
        }
    }

    /// Converts a position to cell coordinates, inside or outside of the tree. `None` if the tree's
    /// system cannot represent the position.
    pub fn cell(&self, position: [f64; 3]) -> Option<[f64; 3]> {
        let Way::World(world) = &self.way else { return Some(position) };
        let World { systems, columns, .. } = &**world;
        let [x, y] = match systems {
            None => [position[0], position[1]],
            Some(systems) => systems.forward([position[0], position[1]])?,
        };
        let mut cell = self.frame.to_cells([x, y, position[2]])?;
        if let Some(columns) = columns {
            // (The seam is opposite to the data.)
            let first = (self.extent[0] as f64 - columns.abs()) / 2.0;
            cell[0] = first + (cell[0] - first).rem_euclid(columns.abs());
        }
        cell.iter().all(|number| number.is_finite()).then_some(cell)
    }

    /// Returns the tree's bounds in the input system, for messages: west, south, east and north, or
    /// columns and rows.
    pub fn bounds_text(&self) -> String {
        let [low, high] = match &self.way {
            Way::Cells => [[0.0; 2], [self.extent[0] as f64, self.extent[1] as f64]],
            Way::World(world) => match world.tree_bounds {
                Some(tree_bounds) => tree_bounds,
                None => return "at no position of this coordinate system".into(),
            },
        };
        corners_text(low, high)
    }

    /// Whether cell coordinates are in the tree's extent.
    pub fn is_inside(&self, cell: [f64; 3]) -> bool {
        (0..3).all(|axis| (0.0..self.extent[axis] as f64).contains(&cell[axis]))
    }

    /// Returns the cells of the tree that a box, given by its minimum and maximum coordinates,
    /// covers at least in part. For another coordinate system it is the bounding box of these
    /// cells. Returns two boxes, the western one first, if the box crosses the tree's seam, and
    /// none if it is outside of the tree. The third coordinates may be infinite: all layers. West
    /// of a box of longitudes may be greater than east: the box then crosses the 180th meridian.
    ///
    /// # Errors
    /// If the minimum coordinates are not below the maximum coordinates.
    pub fn boxes(&self, low: [f64; 3], mut high: [f64; 3]) -> Result<Vec<Bounds>> {
        let axes = if self.extent[2] > 1 { 3 } else { 2 };
        if let Way::World(world) = &self.way
            && high[0] < low[0]
        {
            high[0] += world.turn.unwrap_or(0.0);
        }
        if (0..axes).any(|axis| low[axis] >= high[axis] || !low[axis].is_finite() || !high[axis].is_finite())
        {
            let text =
                |point: [f64; 3]| point[..axes].iter().map(f64::to_string).collect::<Vec<_>>().join(",");
            let found = format!("{} to {}", text(low), text(high));
            return Err(Error::invalid(
                "box",
                found,
                "minimum coordinates (west, south) below the maximum (east, north)",
            ));
        }
        let found = match &self.way {
            Way::World(world) if world.systems.is_some() || world.columns.is_some() => {
                let ring = vec![[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]];
                let parts = self.parts(&[vec![ring]]);
                let boxes = parts.iter().map(|part| self.around(&part[0], [low[2], high[2]]));
                let boxes = boxes.filter(|bounds| !bounds.is_empty());
                // (If the tree has no seam, the input system's seam may run through its middle.)
                if world.columns.is_some() {
                    boxes.collect()
                } else {
                    boxes.reduce(|a, b| a.hull(&b)).into_iter().collect()
                }
            }
            Way::World(_) => {
                let bounds = if axes == 3 && (high[2] - low[2]).is_finite() {
                    self.frame.cells_in_box(low, high, self.extent)
                } else {
                    self.frame.cells_in_rectangle([low[0], low[1], high[0], high[1]], self.extent)
                };
                bounds.into_iter().filter(|bounds| !bounds.is_empty()).collect()
            }
            Way::Cells => {
                let inside = |axis: usize, cell: f64| cell.clamp(0.0, self.extent[axis] as f64) as u64;
                let mut bounds = Bounds::of_extent(self.extent);
                for axis in 0..axes {
                    bounds.min[axis] = inside(axis, (low[axis] + ROUNDING).floor());
                    bounds.max[axis] = inside(axis, (high[axis] - ROUNDING).ceil());
                }
                if bounds.is_empty() { Vec::new() } else { vec![bounds] }
            }
        };
        Ok(found)
    }

    /// Returns the cells around a ring, given in cell coordinates, with layers from one world
    /// coordinate to another.
    fn around(&self, ring: &[[f64; 2]], [floor, ceiling]: [f64; 2]) -> Bounds {
        let mut bounds = Bounds::of_extent(self.extent);
        let inside = |axis: usize, cell: f64| cell.clamp(0.0, self.extent[axis] as f64) as u64;
        for axis in 0..2 {
            let least = ring.iter().map(|corner| corner[axis]).fold(f64::INFINITY, f64::min);
            let most = ring.iter().map(|corner| corner[axis]).fold(f64::NEG_INFINITY, f64::max);
            bounds.min[axis] = inside(axis, (least + ROUNDING).floor());
            bounds.max[axis] = inside(axis, (most - ROUNDING).ceil());
        }
        if self.extent[2] > 1 {
            let row = self.frame.matrix[2];
            let [a, b] = [floor, ceiling].map(|z| (z - row[3]) / row[2]);
            bounds.min[2] = inside(2, (a.min(b) + ROUNDING).floor());
            bounds.max[2] = inside(2, (a.max(b) - ROUNDING).ceil());
        }
        bounds
    }

    /// Converts a polygon to cell coordinates. The result has one part per fragment in the tree,
    /// and none if the polygon is outside of it. Edges are straight in the input system. Where they
    /// are curves in the tree's system, they are approximated to a hundredth of a cell. Fragments
    /// far outside of the tree are dropped.
    pub fn parts(&self, parts: &[Vec<Vec<[f64; 2]>>]) -> PolygonParts {
        let Way::World(world) = &self.way else { return parts.to_vec() };
        let World { systems, turn, near, .. } = &**world;
        let is_same = systems.as_ref().is_none_or(Transformation::is_identity);
        if is_same && turn.is_none() {
            return parts.iter().map(|part| part.iter().map(|ring| self.straight(ring)).collect()).collect();
        }
        let mut found = Vec::new();
        for part in parts {
            let Some(outer) = part.first() else { continue };
            for shift in shifts(outer, *turn, near) {
                let clipped = part.iter().map(|ring| clip::clipped(moved(ring, shift), near));
                let rings: Vec<_> = clipped.filter(|ring| ring.len() >= 3).collect();
                let in_cells = rings.iter().map(|ring| match is_same {
                    true => self.straight(ring),
                    false => self.curved(ring, CLOSE),
                });
                let in_cells: Vec<_> = in_cells.filter(|ring| ring.len() >= 3).collect();
                if !in_cells.is_empty() {
                    found.push(in_cells);
                }
            }
        }
        found
    }

    /// Converts all of a polygon to cell coordinates, once, however far it extends beyond the tree;
    /// [`parts`](CellLocator::parts) returns only fragments near the tree. `None` if these are the
    /// whole polygon, or if the tree's system cannot represent a vertex. Curves are approximated to
    /// a [fraction](MEASURING) of the polygon's size.
    pub fn whole_parts(&self, parts: &[Vec<Vec<[f64; 2]>>]) -> Option<PolygonParts> {
        let Way::World(world) = &self.way else { return None };
        let World { systems, turn, near, .. } = &**world;
        let is_same = systems.as_ref().is_none_or(Transformation::is_identity);
        if is_same && turn.is_none() {
            return None;
        }
        let is_near = |ring: &[[f64; 2]], shift: f64| {
            let is_in = |[x, y]: &[f64; 2]| {
                let position = [x + shift, *y];
                (0..2).all(|axis| near[0][axis] <= position[axis] && position[axis] <= near[1][axis])
            };
            ring.iter().all(is_in)
        };
        // The number of turns that brings the polygon nearest to the tree.
        let middle = |low: f64, high: f64| (low + high) / 2.0;
        let all = || parts.iter().flatten().flatten();
        let (west, east) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(west, east), corner| {
            (west.min(corner[0]), east.max(corner[0]))
        });
        let there = middle(near[0][0], near[1][0]);
        let shift = turn.filter(|_| there.is_finite() && west <= east);
        let shift = shift.map_or(0.0, |turn| ((there - middle(west, east)) / turn).round() * turn);
        if parts.iter().flatten().all(|ring| is_near(ring, shift)) {
            return None;
        }
        let in_cells = |ring: &Vec<[f64; 2]>| {
            let ring = moved(ring, shift);
            if is_same {
                return Some(self.straight(&ring));
            }
            let corners = self.curved(&ring, f64::INFINITY);
            if corners.len() < ring.len() {
                return None;
            }
            let size = |axis: usize| {
                let ends = corners.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), corner| {
                    (low.min(corner[axis]), high.max(corner[axis]))
                });
                ends.1 - ends.0
            };
            Some(self.curved(&ring, (size(0).max(size(1)) * MEASURING).max(CLOSE)))
        };
        parts.iter().map(|part| part.iter().map(in_cells).collect()).collect()
    }

    /// Converts a ring to cell coordinates whose edges remain straight.
    fn straight(&self, ring: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let cell = |[x, y]: &[f64; 2]| self.frame.to_cells([*x, *y, 0.0]).map(|[x, y, _]| [x, y]);
        ring.iter().filter_map(cell).collect()
    }

    /// Converts a ring to cell coordinates. Inserts vertices where edges are curves.
    fn curved(&self, ring: &[[f64; 2]], close: f64) -> Vec<[f64; 2]> {
        /// Maximum number of times that an edge is halved.
        const MAX_DEPTH: u32 = 14;
        let Way::World(world) = &self.way else { return ring.to_vec() };
        let World { systems: Some(systems), turn, columns, middle, .. } = &**world else {
            return ring.to_vec();
        };
        let half = self.extent[0] as f64 / 2.0;
        let cell = |position: [f64; 2]| {
            let [x, y] = systems.forward(position)?;
            let [column, row, _] = self.frame.to_cells([x, y, 0.0])?;
            // If columns are periodic, choose those whose distance from the middle corresponds to
            // the position's.
            let column = columns.map_or(column, |columns| {
                let away =
                    turn.zip(*middle).map_or(0.0, |(turn, middle)| (position[0] - middle) / turn * columns);
                let (expected, columns) = (half + away, columns.abs());
                expected + (column - expected + columns / 2.0).rem_euclid(columns) - columns / 2.0
            });
            Some([column, row])
        };
        let between =
            |a: [f64; 2], b: [f64; 2], part: f64| [0, 1].map(|axis| a[axis] + (b[axis] - a[axis]) * part);
        let mut corners = Vec::with_capacity(ring.len());
        for (index, from) in ring.iter().enumerate() {
            let to = ring[(index + 1) % ring.len()];
            // Pending fragments of the edge, the next one last: ends, and number of halvings.
            let mut pending = vec![(*from, to, 0)];
            while let Some((a, b, depth)) = pending.pop() {
                let (start, end) = (cell(a), cell(b));
                let is_close = |part: f64| match (start, end, cell(between(a, b, part))) {
                    (Some(start), Some(end), Some(found)) => {
                        let line = between(start, end, part);
                        (line[0] - found[0]).abs().max((line[1] - found[1]).abs()) <= close
                    }
                    (None, None, None) => true,
                    _ => false,
                };
                if depth < MAX_DEPTH && ![0.25, 0.5, 0.75].into_iter().all(is_close) {
                    let middle = between(a, b, 0.5);
                    pending.push((middle, b, depth + 1));
                    pending.push((a, middle, depth + 1));
                } else {
                    corners.extend(start);
                }
            }
        }
        corners
    }
}

/// Maximum distance of a curve from the edges that approximate it, in cells.
const CLOSE: f64 = 0.01;

/// Maximum distance, as a fraction of the polygon's size, if only the area is needed. Areas are off
/// by at most 0.3 %.
const MEASURING: f64 = 1e-3;

/// Translates a ring along the first axis.
fn moved(ring: &[[f64; 2]], shift: f64) -> Vec<[f64; 2]> {
    ring.iter().map(|[x, y]| [x + shift, *y]).collect()
}

/// Returns the shifts, as multiples of a turn, that bring a ring near the tree, in first
/// coordinates, the western fragment first.
fn shifts(ring: &[[f64; 2]], turn: Option<f64>, near: &[[f64; 2]; 2]) -> Vec<f64> {
    let Some(turn) = turn else { return vec![0.0] };
    let least = ring.iter().map(|corner| corner[0]).fold(f64::INFINITY, f64::min);
    let most = ring.iter().map(|corner| corner[0]).fold(f64::NEG_INFINITY, f64::max);
    if !(least.is_finite() && most.is_finite()) {
        return vec![0.0];
    }
    // (More turns than these are not valid longitudes.)
    let turns = |number: f64| (number / turn).clamp(-4.0, 4.0) as i32;
    let (first, last) = (
        turns(((near[0][0] - most) / turn).ceil() * turn),
        turns(((near[1][0] - least) / turn).floor() * turn),
    );
    (first..=last).rev().map(|count| f64::from(count) * turn).collect()
}

/// Formats minimum and maximum coordinates with about nine digits.
pub fn corners_text(low: [f64; 2], high: [f64; 2]) -> String {
    let numbers = [low[0], low[1], high[0], high[1]];
    let most = numbers.iter().fold(0f64, |most, number| most.max(number.abs()));
    let digits = (8.0 - most.max(1.0).log10()).clamp(0.0, 8.0) as usize;
    let text = numbers.map(|number| {
        let text = format!("{number:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    });
    text.join(",")
}

impl Way {
    fn in_world(systems: Option<Transformation>, frame: &Frame, extent: [u64; 3]) -> Result<Way> {
        if frame.to_cells([0.0; 3]).is_none() {
            return Err(Error::invalid("frame", format!("{:?}", frame.matrix), "an invertible matrix"));
        }
        let [[across, b, ..], [d, ..], _] = frame.matrix;
        let own = frame.crs.as_ref().and_then(|crs| crs.turn());
        let turn = match &systems {
            Some(systems) => systems.from().turn(),
            None => own,
        };
        let columns = own.filter(|_| b == 0.0 && d == 0.0).map(|own| own / across);
        let everywhere = [[f64::NEG_INFINITY; 2], [f64::INFINITY; 2]];
        let lattice = Lattice::new(systems.as_ref(), turn, frame, extent);
        let (near, tree_bounds, middle) = match lattice {
            Some(lattice) => (lattice.near(turn), Some(lattice.tree_bounds), Some(lattice.middle)),
            None => (everywhere, None, None),
        };
        Ok(Way::World(Box::new(World { systems, turn, columns, near, tree_bounds, middle })))
    }
}

/// A lattice of positions in a tree's extent.
struct Lattice {
    /// Minimum and maximum coordinates.
    tree_bounds: [[f64; 2]; 2],
    /// Maximum distance between neighbouring positions, along each axis.
    max_spacing: [f64; 2],
    /// First coordinate of the centre.
    middle: f64,
    /// Whether first coordinates were wrapped to be within half a turn of the centre.
    is_wrapped: bool,
}

impl Lattice {
    /// Creates the lattice in the input system. `None` if no position of the tree can be
    /// represented there.
    fn new(
        systems: Option<&Transformation>,
        turn: Option<f64>,
        frame: &Frame,
        extent: [u64; 3],
    ) -> Option<Lattice> {
        let position = |column: usize, row: usize| {
            let at = |axis: usize, step: usize| extent[axis] as f64 * step as f64 / STEPS as f64;
            let [x, y, _] = frame.to_world([at(0, column), at(1, row), 0.0]);
            match systems {
                None => Some([x, y]),
                Some(systems) => systems.backward([x, y]),
            }
        };
        let middle = position(STEPS / 2, STEPS / 2).or_else(|| position(STEPS / 4, STEPS / 4))?[0];
        let is_wrapped = systems.is_some_and(|systems| !systems.is_identity());
        let wrap = |x: f64| match turn {
            Some(turn) if is_wrapped => middle + (x - middle + turn / 2.0).rem_euclid(turn) - turn / 2.0,
            _ => x,
        };
        let row = |row: usize| -> Vec<Option<[f64; 2]>> {
            let positions = (0..=STEPS).map(|column| position(column, row));
            positions.map(|position| position.map(|[x, y]| [wrap(x), y])).collect()
        };
        let rows: Vec<_> = (0..=STEPS).map(row).collect();
        let (mut low, mut high, mut max_spacing) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2], [0f64; 2]);
        for (row, positions) in rows.iter().enumerate() {
            for (column, position) in positions.iter().enumerate() {
                let Some(position) = position else { continue };
                let right = positions.get(column + 1).copied().flatten();
                let below = rows.get(row + 1).and_then(|positions| positions[column]);
                for axis in 0..2 {
                    (low[axis], high[axis]) = (low[axis].min(position[axis]), high[axis].max(position[axis]));
                    for other in [right, below].into_iter().flatten() {
                        max_spacing[axis] = max_spacing[axis].max((position[axis] - other[axis]).abs());
                    }
                }
            }
        }
        let is_somewhere = (0..2).all(|axis| low[axis] <= high[axis]);
        is_somewhere.then_some(Lattice { tree_bounds: [low, high], max_spacing, middle, is_wrapped })
    }

    /// Returns the minimum and maximum coordinates of positions that can be in the tree: the
    /// lattice's bounds, extended by the distance between neighbours.
    fn near(&self, turn: Option<f64>) -> [[f64; 2]; 2] {
        let [low, high] = self.tree_bounds;
        let [mut low, mut high] = [
            [0, 1].map(|axis| low[axis] - self.max_spacing[axis]),
            [0, 1].map(|axis| high[axis] + self.max_spacing[axis]),
        ];
        if let Some(turn) = turn
            && high[0] - low[0] > turn
        {
            // Limited to one turn around the world, so that no position is included twice.
            let centre = if self.is_wrapped { self.middle } else { (low[0] + high[0]) / 2.0 };
            (low[0], high[0]) = (centre - turn / 2.0, centre + turn / 2.0);
        }
        [low, high]
    }
}

#[cfg(test)]
mod tests;
