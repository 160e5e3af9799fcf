//! Polygons: which cells' centres they have inside.

use crate::space::Bounds;
use crate::{Error, Result};

/// A polygon of rings: what an odd number of them is around is inside.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygon {
    /// Edges that pass through each of [`BANDS`] bands of rows.
    bands: Vec<Vec<[[f64; 2]; 2]>>,
    low: f64,
    high: f64,
    /// Least and greatest column of the corners.
    sides: [f64; 2],
}

/// Number of bands of rows: only the edges in the bands of a node are tested against it.
const BANDS: usize = 1024;

impl Polygon {
    /// The polygon with these rings, in cells; rings close by themselves.
    ///
    /// # Errors
    /// If a ring has less than three corners, or one that is not finite.
    pub fn new(rings: &[Vec<[f64; 2]>]) -> Result<Polygon> {
        let corners = || rings.iter().flatten();
        if rings.is_empty() || rings.iter().any(|ring| ring.len() < 3) {
            return Err(Error::invalid("polygon", "a ring of less than three corners", "three or more"));
        }
        if corners().flatten().any(|number| !number.is_finite()) {
            return Err(Error::invalid("polygon", "a corner that is not finite", "numbers"));
        }
        let low = corners().map(|corner| corner[1]).fold(f64::INFINITY, f64::min);
        let high = corners().map(|corner| corner[1]).fold(f64::NEG_INFINITY, f64::max);
        let left = corners().map(|corner| corner[0]).fold(f64::INFINITY, f64::min);
        let right = corners().map(|corner| corner[0]).fold(f64::NEG_INFINITY, f64::max);
        let mut polygon = Polygon { bands: vec![Vec::new(); BANDS], low, high, sides: [left, right] };
        for ring in rings {
            for (i, corner) in ring.iter().enumerate() {
                let next = ring[(i + 1) % ring.len()];
                let bands = polygon.bands(corner[1].min(next[1]), corner[1].max(next[1]));
                polygon.bands[bands].iter_mut().for_each(|band| band.push([*corner, next]));
            }
        }
        Ok(polygon)
    }

    /// Least and greatest coordinates of the corners.
    pub(super) fn corners(&self) -> [[f64; 2]; 2] {
        [[self.sides[0], self.low], [self.sides[1], self.high]]
    }

    /// The bands of the rows from one coordinate to another.
    fn bands(&self, from: f64, to: f64) -> std::ops::Range<usize> {
        let height = (self.high - self.low).max(f64::MIN_POSITIVE);
        let band = |y: f64| ((y - self.low) / height * BANDS as f64).clamp(0.0, BANDS as f64 - 1.0) as usize;
        band(from)..band(to) + 1
    }

    /// Whether cells' centres are inside: all of them, none, or (`None`) that is not known. It is always
    /// known of one cell.
    pub(super) fn contains(&self, bounds: &Bounds) -> Option<bool> {
        let centre = |cell: u64| cell as f64 + 0.5;
        let low = [centre(bounds.min[0]), centre(bounds.min[1])];
        let high = [centre(bounds.max[0] - 1), centre(bounds.max[1] - 1)];
        if high[1] < self.low || low[1] > self.high {
            return Some(false);
        }
        let is_cell = low == high;
        let near = |edge: &[[f64; 2]; 2]| !is_cell && passes(edge, low, high);
        if self.bands[self.bands(low[1], high[1])].iter().flatten().any(near) {
            return None;
        }
        // No edge passes between the centres, so that the first one's parity is that of all. Ends on the row
        // count as below it: a ray through a corner then crosses both of its edges, or none, or the one that
        // goes on, and parity is right.
        let [x, y] = low;
        let crosses = |[a, b]: &&[[f64; 2]; 2]| {
            (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        };
        let band = self.bands(y, y).start;
        Some(self.bands[band].iter().filter(crosses).count() % 2 == 1)
    }
}

/// Whether an edge may touch a box: never wrongly no.
fn passes([a, b]: &[[f64; 2]; 2], low: [f64; 2], high: [f64; 2]) -> bool {
    for axis in 0..2 {
        if a[axis].max(b[axis]) < low[axis] || a[axis].min(b[axis]) > high[axis] {
            return false;
        }
    }
    // The corners' sides of the edge's line; a small part of a cell is left for rounding.
    let normal = [a[1] - b[1], b[0] - a[0]];
    let side = |x: f64, y: f64| normal[0] * (x - a[0]) + normal[1] * (y - a[1]);
    let sides = [side(low[0], low[1]), side(high[0], low[1]), side(low[0], high[1]), side(high[0], high[1])];
    let slack = (normal[0].abs() + normal[1].abs()) * 1e-6;
    !(sides.iter().all(|side| *side > slack) || sides.iter().all(|side| *side < -slack))
}
