//! Conversion of coordinates in any system to those of a tree of points or lines.

use crate::cell_locator::PolygonParts;
use crate::{CellLocator, Coordinates, Crs, Frame, Transformation};
use spinney_base::{Error, Result};

/// Converts positions, lines and polygons in any system to the coordinate reference system of a
/// tree without cells.
///
/// Longitudes that differ by 360 degrees are equivalent: a position in another system gets the
/// longitude that is nearest to the middle of the tree.
///
/// ```
/// use spinney::{Coordinates, Crs, WorldLocator};
/// let zone = Crs::epsg(32632);
/// let bounds = [[400_000.0, 5_200_000.0], [600_000.0, 5_400_000.0]];
/// let locator = WorldLocator::new(&Coordinates::LONLAT, Some(&zone), bounds, 0.01)?;
/// // The central meridian is at 500,000 metres.
/// let [x, y] = locator.position([9.0, 48.0]).unwrap();
/// assert!((x - 500_000.0).abs() < 1e-6 && (y - 5_316_300.0).abs() < 1e3);
/// # Ok::<(), spinney::Error>(())
/// ```
pub struct WorldLocator {
    /// Transformation from the input system to the tree's; `None` if they are the same.
    systems: Option<Transformation>,
    /// Maximum distance of curves from the edges that approximate them.
    tolerance: f64,
    /// The middle of the tree and the length of one turn around the world, both along the first
    /// axis; `None` if coordinates are not periodic.
    seam: Option<[f64; 2]>,
    /// A raster over the tree to which polygons are converted, and the frame of its cells.
    cells: Option<(CellLocator, Frame)>,
}

/// Maximum number of cells along the longer side of the raster over a tree. Polygons are accurate
/// to a hundredth of a cell.
const CELLS: f64 = (1 << 20) as f64;
/// Maximum distance of a curve from its approximation, in cells, as in [`CellLocator::parts`].
const CLOSE: f64 = 0.01;
/// Maximum number of times that an edge is halved.
const MAX_HALVINGS: u32 = 14;

impl WorldLocator {
    /// Creates a locator to a tree's system, if that is known, and its minimum and maximum
    /// coordinates. Lengths below `step` are not significant. A datum whose shift to WGS 84 is not
    /// known is treated as WGS 84, with a remark: see [`WorldLocator::remarks`].
    ///
    /// # Errors
    /// If the input coordinates are cells; if the tree has no system although one is needed; if one
    /// of the two systems is not supported.
    pub fn new(
        coordinates: &Coordinates,
        own: Option<&Crs>,
        [low, high]: [[f64; 2]; 2],
        step: f64,
    ) -> Result<WorldLocator> {
        let size = [high[0] - low[0], high[1] - low[1]];
        let width = (size[0].max(size[1]) / CELLS).max(step);
        let mut locator = WorldLocator { systems: None, tolerance: width * CLOSE, seam: None, cells: None };
        let crs = match coordinates {
            Coordinates::World => return Ok(locator),
            Coordinates::Cells => {
                let expected = "world, lonlat or a coordinate system; there are no cells";
                return Err(Error::invalid("coordinates", "cells", expected));
            }
            Coordinates::System(crs) => crs,
        };
        let Some(own) = own else {
            let expected = "a known one; set it with `spinney build --crs EPSG:NUMBER`";
            return Err(Error::invalid("coordinate system of the tree", "none", expected));
        };
        let systems = Transformation::new(crs, own, true)?;
        if !systems.is_identity() {
            let frame =
                Frame { crs: Some(own.clone()), ..Frame::planar([width, 0.0, low[0], 0.0, -width, high[1]]) };
            let count = |axis: usize| ((size[axis] / width).ceil() as u64).max(1);
            let cells = CellLocator::new(coordinates, &frame, [count(0), count(1), 1])?;
            locator.seam = own.turn().map(|turn| [(low[0] + high[0]) / 2.0, turn]);
            locator.cells = Some((cells, frame));
            locator.systems = Some(systems);
        }
        Ok(locator)
    }

    /// Whether coordinates are returned unchanged.
    pub fn is_identity(&self) -> bool {
        self.systems.is_none()
    }

    /// Returns remarks on the accuracy of both systems' datums.
    pub fn remarks(&self) -> Vec<String> {
        self.systems.as_ref().map_or(Vec::new(), Transformation::remarks)
    }

    /// Converts a position to the tree's system. `None` if it cannot be represented there.
    pub fn position(&self, position: [f64; 2]) -> Option<[f64; 2]> {
        let Some(systems) = &self.systems else { return Some(position) };
        let [mut x, y] = systems.forward(position)?;
        if let Some([middle, turn]) = self.seam
            && (x - middle).abs() > turn / 2.0
        {
            x = middle + (x - middle + turn / 2.0).rem_euclid(turn) - turn / 2.0;
        }
        (x.is_finite() && y.is_finite()).then_some([x, y])
    }

    /// Converts a position like [`WorldLocator::position`].
    ///
    /// # Errors
    /// If the position cannot be represented in the tree's system.
    pub fn locate(&self, position: [f64; 2]) -> Result<[f64; 2]> {
        self.position(position).ok_or_else(|| {
            let found = format!("{},{}", position[0], position[1]);
            Error::invalid("position", found, "one that the coordinate system of the tree can represent")
        })
    }

    /// Converts a line to the tree's system. Edges are straight in the input system, and are
    /// approximated where they are curves in the tree's. Heights are kept. Returns several lines if
    /// some of the line cannot be represented there, or if it crosses the seam of longitudes.
    pub fn lines(&self, line: Vec<[f64; 3]>) -> Vec<Vec<[f64; 3]>> {
        if self.is_identity() {
            return vec![line];
        }
        let between = |a: [f64; 3], b: [f64; 3], share: f64| {
            [0, 1, 2].map(|axis| a[axis] + (b[axis] - a[axis]) * share)
        };
        let located = |[x, y, z]: [f64; 3]| self.position([x, y]).map(|[x, y]| [x, y, z]);
        let mut found = vec![Vec::new()];
        let is_one =
            |a: [f64; 3], b: [f64; 3]| self.seam.is_none_or(|[_, turn]| (a[0] - b[0]).abs() <= turn / 2.0);
        for ends in line.windows(2) {
            // Pending fragments of the edge, the next one last: ends, and number of halvings.
            let mut pending = vec![(ends[0], ends[1], 0)];
            while let Some((a, b, halvings)) = pending.pop() {
                let (start, end) = (located(a), located(b));
                let is_close = |share: f64| match (start, end, located(between(a, b, share))) {
                    (Some(start), Some(end), Some(found)) => {
                        let straight = between(start, end, share);
                        let away = (straight[0] - found[0]).abs().max((straight[1] - found[1]).abs());
                        is_one(start, end) && away <= self.tolerance
                    }
                    (None, None, None) => true,
                    _ => false,
                };
                if halvings < MAX_HALVINGS && ![0.25, 0.5, 0.75].into_iter().all(is_close) {
                    let middle = between(a, b, 0.5);
                    pending.push((middle, b, halvings + 1));
                    pending.push((a, middle, halvings + 1));
                    continue;
                }
                match (start, end) {
                    (Some(start), Some(end)) if is_one(start, end) => {
                        let last = found.last_mut().expect("there is a line");
                        if last.is_empty() {
                            last.push(start);
                        }
                        last.push(end);
                    }
                    _ => found.push(Vec::new()),
                }
            }
        }
        found.retain(|line| line.len() > 1);
        found
    }

    /// Converts polygons to the tree's system, as far as they are near the tree. Edges are straight
    /// in the input system, and are approximated where they are curves in the tree's.
    pub fn parts(&self, parts: PolygonParts) -> PolygonParts {
        let Some((cells, frame)) = &self.cells else { return parts };
        let world = |[x, y]: &[f64; 2]| {
            let [x, y, _] = frame.to_world([*x, *y, 0.0]);
            [x, y]
        };
        let ring = |ring: &Vec<[f64; 2]>| ring.iter().map(world).collect();
        cells.parts(&parts).iter().map(|part| part.iter().map(ring).collect()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn locator(from: u32, own: u32, bounds: [[f64; 2]; 2]) -> WorldLocator {
        let own = Crs::epsg(own);
        WorldLocator::new(&Coordinates::System(Crs::epsg(from)), Some(&own), bounds, 1e-7).unwrap()
    }

    /// Web Mercator has a simple formula: x is proportional to longitude, y = R ln tan(45 degrees +
    /// latitude / 2).
    #[test]
    fn positions_and_lines_are_those_of_the_formula() {
        let radius = 6_378_137.0;
        let formula = |[x, y]: [f64; 2]| [radius * x.to_radians(), radius * y.to_radians().sin().atanh()];
        let locator = locator(4326, 3857, [[0.0, 0.0], [1e6, 1e6]]);
        for place in [[8.5, 47.25], [-3.0, 10.0], [170.0, -60.0]] {
            let (found, expected) = (locator.locate(place).unwrap(), formula(place));
            let turn = 2.0 * std::f64::consts::PI * radius;
            let away = ((found[0] - expected[0]) / turn).round() * turn + expected[0] - found[0];
            assert!(away.abs() < 1e-6 && (found[1] - expected[1]).abs() < 1e-6, "{found:?}");
        }
        assert!(locator.position([8.0, 95.0]).is_none() && locator.locate([8.0, 95.0]).is_err());
        // A line to the north-east is a curve: each vertex is on it, and the middle of each edge is
        // within the tolerance.
        let [line] = &locator.lines(vec![[0.0, 0.0, 3.0], [8.0, 8.0, 7.0]])[..] else { panic!("one line") };
        assert!(line.len() > 10, "{}", line.len());
        let on_curve = |[x, y, _]: [f64; 3]| y - formula([0.0, (x / radius).to_degrees()])[1];
        assert_eq!([line[0][2], line[line.len() - 1][2]], [3.0, 7.0]);
        for edge in line.windows(2) {
            assert!(edge[0][2] < edge[1][2]);
            assert!(on_curve(edge[0]).abs() < 1e-6);
            let middle = [0, 1, 2].map(|axis| (edge[0][axis] + edge[1][axis]) / 2.0);
            assert!(on_curve(middle).abs() < 2.0 * locator.tolerance, "{middle:?}");
        }
        let ring = vec![[1.0, 1.0], [3.0, 1.0], [3.0, 2.0], [1.0, 2.0]];
        let parts = locator.parts(vec![vec![ring.clone()]]);
        let [[found]] = &parts.iter().map(Vec::as_slice).collect::<Vec<_>>()[..] else { panic!("one ring") };
        for corner in ring.into_iter().map(formula) {
            assert!(found.iter().any(|own| (own[0] - corner[0]).hypot(own[1] - corner[1]) < 1e-3));
        }
    }

    /// Trees around the 180th meridian have positions on both sides of it, in either range of
    /// longitudes.
    #[test]
    fn longitudes_are_next_to_the_tree() {
        let east = locator(3857, 4326, [[170.0, -10.0], [190.0, 10.0]]);
        let [x, _] = east.position([-19_900_000.0, 0.0]).unwrap();
        assert!((x - (360.0 - (19_900_000.0 / 6_378_137.0f64).to_degrees())).abs() < 1e-6, "{x}");
        let whole = locator(3857, 4326, [[-180.0, -10.0], [180.0, 10.0]]);
        let [x, _] = whole.position([-19_900_000.0, 0.0]).unwrap();
        assert!((x + (19_900_000.0 / 6_378_137.0f64).to_degrees()).abs() < 1e-6, "{x}");
    }

    #[test]
    fn what_has_no_way_is_refused() {
        let bounds = [[0.0; 2], [1.0; 2]];
        let message = |coordinates: &Coordinates| match WorldLocator::new(coordinates, None, bounds, 0.1) {
            Ok(_) => panic!("{coordinates}"),
            Err(error) => error.to_string(),
        };
        assert!(message(&Coordinates::Cells).contains("no cells"));
        assert!(message(&Coordinates::LONLAT).contains("--crs"));
        assert!(WorldLocator::new(&Coordinates::World, None, bounds, 0.1).unwrap().is_identity());
    }
}
