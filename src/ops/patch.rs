//! Changes to parts of a tree: boxes, polygons, nodes, single cells.

use crate::space::{Bounds, Code};
use crate::store::goblin::Layout;
use crate::tree::{Change, Patch};
use crate::value::Value;
use crate::{Error, Result};

/// Single cells with new values.
#[derive(Clone, Debug)]
pub struct CellPatch<D: Layout, V> {
    depth: u8,
    /// In FD order, each once.
    cells: Vec<(Code<D>, Option<V>)>,
}

impl<D: Layout, V: Value> CellPatch<D, V> {
    /// Cells of a tree of some depth and extent and their new values (`None` is VOID), in any order; of several values for
    /// one cell the last counts.
    ///
    /// # Errors
    /// If a cell is outside the extent.
    pub fn new(
        depth: u8,
        extent: [u64; 3],
        cells: impl IntoIterator<Item = ([u64; 3], Option<V>)>,
    ) -> Result<Self> {
        let code = |cell: [u64; 3]| {
            let inside = (0..3).all(|axis| cell[axis] < extent[axis]);
            let code = inside.then(|| Code::from_cell(depth, cell.map(|cell| cell as u32))).flatten();
            code.ok_or_else(|| {
                let (cell, extent) = (&cell[..D::AXES], &extent[..D::AXES]);
                Error::invalid(
                    "cell",
                    format!("{cell:?}"),
                    format!("one of {extent:?} cells, counted from 0"),
                )
            })
        };
        let cells =
            cells.into_iter().map(|(cell, value)| Ok((code(cell)?, value.filter(|value| !value.is_nan()))));
        let mut cells = cells.collect::<Result<Vec<_>>>()?;
        // (The sort is stable: the last of several stays behind the others.)
        cells.sort_by_key(|(code, _)| *code);
        let mut last = 0;
        for next in 0..cells.len() {
            if cells[next].0 != cells[last].0 {
                last += 1;
            }
            cells[last] = cells[next];
        }
        cells.truncate(last + 1);
        Ok(CellPatch { depth, cells })
    }
}

impl<D: Layout, V: Value> Patch<D, V> for CellPatch<D, V> {
    fn change(&self, code: Code<D>, _: &Bounds) -> Change<V> {
        let first = self.cells.partition_point(|(cell, _)| cell.bits() < code.bits());
        match self.cells.get(first) {
            Some((cell, value)) if code.contains(*cell) => {
                if code.level() == self.depth {
                    Change::Uniform(*value)
                } else {
                    Change::Split
                }
            }
            _ => Change::Keep,
        }
    }
}

/// A region that becomes one value, or VOID.
pub struct FillPatch<V> {
    region: FillRegion,
    /// Nothing changes outside.
    within: Bounds,
    value: Option<V>,
}

/// What is filled.
#[derive(Clone, Debug, PartialEq)]
pub enum FillRegion {
    /// A box of cells.
    Box(Bounds),
    /// All cells whose centre, seen along z, is inside a polygon.
    Polygon(Polygon),
}

impl<V: Value> FillPatch<V> {
    /// Fills what of a region lies in a tree's extent.
    pub fn new(region: FillRegion, extent: [u64; 3], value: Option<V>) -> Self {
        FillPatch { region, within: Bounds { min: [0; 3], max: extent }, value }
    }
}

impl<D: Layout, V: Value> Patch<D, V> for FillPatch<V> {
    fn change(&self, _: Code<D>, bounds: &Bounds) -> Change<V> {
        if bounds.intersect(&self.within).is_empty() {
            return Change::Keep;
        }
        let inside = match &self.region {
            FillRegion::Box(region) if region.contains(bounds) => Some(true),
            FillRegion::Box(region) if region.intersect(bounds).is_empty() => Some(false),
            FillRegion::Box(_) => None,
            FillRegion::Polygon(polygon) => polygon.contains(bounds),
        };
        match inside {
            Some(false) => Change::Keep,
            Some(true) if self.within.contains(bounds) => Change::Uniform(self.value),
            _ => Change::Split,
        }
    }
}

/// A polygon of rings: what an odd number of them is around is inside.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygon {
    /// Edges that pass through each of [`BANDS`] bands of rows.
    bands: Vec<Vec<[[f64; 2]; 2]>>,
    low: f64,
    high: f64,
}

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
        let mut polygon = Polygon { bands: vec![Vec::new(); BANDS], low, high };
        for ring in rings {
            for (i, corner) in ring.iter().enumerate() {
                let next = ring[(i + 1) % ring.len()];
                let bands = polygon.bands(corner[1].min(next[1]), corner[1].max(next[1]));
                polygon.bands[bands].iter_mut().for_each(|band| band.push([*corner, next]));
            }
        }
        Ok(polygon)
    }

    /// The bands of rows from one place to another.
    fn bands(&self, from: f64, to: f64) -> std::ops::Range<usize> {
        let height = (self.high - self.low).max(f64::MIN_POSITIVE);
        let band = |y: f64| ((y - self.low) / height * BANDS as f64).clamp(0.0, BANDS as f64 - 1.0) as usize;
        band(from)..band(to) + 1
    }

    /// Whether cells' centres are inside: all of them, none, or (`None`) that is not known. It is always known of one cell.
    fn contains(&self, bounds: &Bounds) -> Option<bool> {
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
        // No edge passes between the centres: one speaks for all.
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
