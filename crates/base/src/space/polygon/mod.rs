//! Polygons on a plane of cells: which cells' centres they have inside, and how much of cells.

mod rows;

use std::ops::Range;

pub use rows::Crossings;

use super::bounds::Bounds;
use crate::{Error, Result};

/// A polygon of rings: what an odd number of them is around is inside.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygon {
    edges: Vec<Edge>,
    /// Numbers of the edges that pass through each of some bands of rows, of the same height: those of a band together.
    passing: Vec<u32>,
    /// End of each band's numbers.
    ends: Vec<usize>,
    low: f64,
    high: f64,
    /// Least and greatest column of the corners.
    sides: [f64; 2],
}

/// From one corner to the next; what is inside lies on the same side of all of them, unless rings cross each other.
type Edge = [[f64; 2]; 2];

/// Most bands of rows: only the edges in the bands of a node are tested against it.
const BANDS: usize = 1024;
/// Bands in which an edge stands, at most, on average. Where edges are long there are fewer bands; so each row meets at most about
/// so many times as many edges as cross it, and memory goes with the edges alone.
const BANDS_EACH: usize = 4;

/// How a polygon has a box of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cover {
    /// All of it.
    Whole,
    /// Nothing of it.
    Nothing,
    /// A part of it, or that is not known.
    Part,
}

impl Polygon {
    /// The polygon with these rings, in cells; rings close by themselves.
    ///
    /// # Errors
    /// If a ring has less than three corners, or one that is not finite.
    pub fn new(rings: &[Vec<[f64; 2]>]) -> Result<Polygon> {
        Polygon::of_rings(&rings.iter().map(|ring| (ring, false)).collect::<Vec<_>>())
    }

    /// The polygon of several parts that have nothing in common, each an outer ring and its holes. (Rings may run in either
    /// direction.)
    ///
    /// # Errors
    /// Those of [`Polygon::new`].
    pub fn of_parts<'a>(parts: &'a [Vec<Vec<[f64; 2]>>]) -> Result<Polygon> {
        let of_part = |part: &'a Vec<Vec<[f64; 2]>>| {
            part.iter().enumerate().map(|(index, ring)| (ring, (signed_area(ring) < 0.0) != (index > 0)))
        };
        Polygon::of_rings(&parts.iter().flat_map(of_part).collect::<Vec<_>>())
    }

    /// Fails if parts are none of a polygon, as [`Polygon::of_parts`].
    ///
    /// # Errors
    /// Those of [`Polygon::new`].
    pub fn check_parts(parts: &[Vec<Vec<[f64; 2]>>]) -> Result<()> {
        Polygon::check_rings(&mut parts.iter().flatten())
    }

    fn check_rings(rings: &mut dyn Iterator<Item = &Vec<[f64; 2]>>) -> Result<()> {
        let mut count = 0;
        for ring in rings {
            if ring.len() < 3 {
                return Err(Error::invalid("polygon", "a ring of less than three corners", "three or more"));
            }
            if ring.iter().flatten().any(|number| !number.is_finite()) {
                return Err(Error::invalid("polygon", "a corner that is not finite", "numbers"));
            }
            count += 1;
        }
        if count == 0 { Err(Error::invalid("polygon", "no ring", "one or more")) } else { Ok(()) }
    }

    /// The polygon of rings, each of which may have to be gone round in the other direction.
    fn of_rings(rings: &[(&Vec<[f64; 2]>, bool)]) -> Result<Polygon> {
        Polygon::check_rings(&mut rings.iter().map(|(ring, _)| *ring))?;
        let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut edges: Vec<Edge> = Vec::with_capacity(rings.iter().map(|(ring, _)| ring.len()).sum());
        for (ring, is_turned) in rings {
            let mut before = ring[ring.len() - 1];
            for corner in ring.iter() {
                for axis in 0..2 {
                    least[axis] = least[axis].min(corner[axis]);
                    most[axis] = most[axis].max(corner[axis]);
                }
                edges.push(if *is_turned { [*corner, before] } else { [before, *corner] });
                before = *corner;
            }
        }
        let ([left, low], [right, high]) = (least, most);
        if u32::try_from(edges.len()).is_err() {
            return Err(Error::invalid("polygon", format!("{} corners", edges.len()), "less than 2^32"));
        }
        let mut polygon =
            Polygon { edges, passing: Vec::new(), ends: Vec::new(), low, high, sides: [left, right] };
        // (No more than rows, and than edges.)
        let mut bands = (high - low).ceil().clamp(1.0, BANDS.min(polygon.edges.len()) as f64) as usize;
        loop {
            polygon.ends = vec![0; bands];
            let entries: usize = polygon.edges.iter().map(|edge| polygon.bands_of(edge).len()).sum();
            if entries <= BANDS_EACH * polygon.edges.len() {
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
        self.passing = vec![0; starts[self.ends.len()]];
        for (number, edge) in self.edges.iter().enumerate() {
            for band in self.bands_of(edge) {
                self.passing[starts[band]] = number as u32;
                starts[band] += 1;
            }
        }
        // (Where each band begins has moved to where it ends.)
        starts.pop();
        self.ends = starts;
    }

    /// The bands that an edge passes through.
    fn bands_of(&self, [a, b]: &Edge) -> Range<usize> {
        self.bands(a[1].min(b[1]), a[1].max(b[1]))
    }

    /// The edges in some bands, those of each band after each other.
    fn edges_in(&self, bands: Range<usize>) -> impl Iterator<Item = &Edge> {
        self.numbers_in(bands).iter().map(|number| &self.edges[*number as usize])
    }

    /// Numbers of the edges in some bands.
    fn numbers_in(&self, bands: Range<usize>) -> &[u32] {
        let start = if bands.start == 0 { 0 } else { self.ends[bands.start - 1] };
        &self.passing[start..self.ends[bands.end - 1]]
    }

    /// Least and greatest coordinates of the corners.
    pub fn corners(&self) -> [[f64; 2]; 2] {
        [[self.sides[0], self.low], [self.sides[1], self.high]]
    }

    /// The bands of the rows from one coordinate to another.
    fn bands(&self, from: f64, to: f64) -> Range<usize> {
        let height = (self.high - self.low).max(f64::MIN_POSITIVE);
        let count = self.ends.len() as f64;
        let band = |y: f64| ((y - self.low) / height * count).clamp(0.0, count - 1.0) as usize;
        band(from)..band(to) + 1
    }

    /// Whether cells' centres are inside. It is always known of one cell.
    pub fn cover_centres(&self, bounds: &Bounds) -> Cover {
        let low = [centre(bounds.min[0]), centre(bounds.min[1])];
        let high = [centre(bounds.max[0] - 1), centre(bounds.max[1] - 1)];
        if high[1] < self.low || low[1] > self.high {
            return Cover::Nothing;
        }
        let is_cell = low == high;
        let near = |edge: &Edge| !is_cell && passes(edge, low, high);
        if self.edges_in(self.bands(low[1], high[1])).any(near) {
            return Cover::Part;
        }
        // No edge passes between the centres, so that the first one's parity is that of all.
        if self.contains(low) { Cover::Whole } else { Cover::Nothing }
    }

    /// Whether cells lie inside, with all of their area.
    pub fn cover_area(&self, bounds: &Bounds) -> Cover {
        let low = [bounds.min[0] as f64, bounds.min[1] as f64];
        let high = [bounds.max[0] as f64, bounds.max[1] as f64];
        if high[1] <= self.low || low[1] >= self.high || high[0] <= self.sides[0] || low[0] >= self.sides[1] {
            return Cover::Nothing;
        }
        let near = |edge: &Edge| passes(edge, low, high);
        if self.edges_in(self.bands(low[1], high[1])).any(near) {
            return Cover::Part;
        }
        if self.contains([centre(bounds.min[0]), centre(bounds.min[1])]) {
            Cover::Whole
        } else {
            Cover::Nothing
        }
    }

    /// Whether a point is inside, not too near an edge. Ends on the row count as below it: a ray through a corner then crosses
    /// both of its edges, or none, or the one that goes on, and parity is right.
    pub fn contains(&self, [x, y]: [f64; 2]) -> bool {
        let edges = self.edges_in(self.bands(y, y));
        edges.filter_map(|edge| crossing(edge, y)).filter(|at| x < *at).count() % 2 == 1
    }

    /// All of its area, in cells. Exact but for rounding, if rings do not cross each other.
    pub fn whole_area(&self) -> f64 {
        let Some([[x, y], _]) = self.edges.first() else { return 0.0 };
        // (From a corner, so that less is lost of what is small and far away.)
        let twice = |[a, b]: &Edge| (a[0] - x) * (b[1] - y) - (b[0] - x) * (a[1] - y);
        self.edges.iter().map(twice).sum::<f64>().abs() / 2.0
    }

    /// Area of a box of cells that is inside, in cells. Exact but for rounding, if rings do not cross each other.
    pub fn area(&self, bounds: &Bounds) -> f64 {
        let [left, right] = [bounds.min[0] as f64, bounds.max[0] as f64];
        let [low, high] = [(bounds.min[1] as f64).max(self.low), (bounds.max[1] as f64).min(self.high)];
        if low >= high {
            return 0.0;
        }
        let bands = self.bands(low, high);
        let mut sum = 0.0;
        for band in bands.clone() {
            for edge in self.edges_in(band..band + 1) {
                // (One that stands in several bands counts in the first of them.)
                let is_again = band > bands.start && self.bands_of(edge).start < band;
                if !is_again {
                    sum += area_left(edge, [low, high], [left, right]);
                }
            }
        }
        sum.abs().min((right - left) * (high - low))
    }
}

/// The centre of a cell along an axis.
fn centre(cell: u64) -> f64 {
    cell as f64 + 0.5
}

/// The column at which an edge crosses a row.
#[inline]
fn crossing([a, b]: &Edge, y: f64) -> Option<f64> {
    ((a[1] > y) != (b[1] > y)).then(|| a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
}

/// Area of a box that lies left of an edge, between two rows: positive for edges that lead to higher rows.
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

/// The mean, along a line from `start` to `end`, of how far the box from `left` to `right` lies on its left.
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
    // A part of the line is left of the box, a part in it, a part right of it.
    let (first, last) = (least.max(left), most.min(right));
    let inside = (last - first) * ((first + last) / 2.0 - left);
    let beyond = (most - right).max(0.0) * (right - left);
    (inside + beyond) / (most - least)
}

/// Twice the area of a ring, positive if its edges lead round it from the first axis to the second.
fn signed_area(ring: &[[f64; 2]]) -> f64 {
    let ends = ring.iter().zip(ring.iter().cycle().skip(1));
    ends.map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum()
}

/// Whether an edge may touch a box: never wrongly no.
fn passes([a, b]: &Edge, low: [f64; 2], high: [f64; 2]) -> bool {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from 0 to `most`.
    fn random(state: &mut u64, most: f64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 33) as f64 / (1u64 << 31) as f64 * most
    }

    /// A star around a point, with a hole: no ring crosses another.
    fn star(state: &mut u64, middle: [f64; 2], radius: f64) -> Vec<Vec<[f64; 2]>> {
        let ring = |state: &mut u64, least: f64, most: f64, is_turned: bool| -> Vec<[f64; 2]> {
            let count = 3 + random(state, 20.0) as usize;
            let corner = |i: usize| {
                let i = if is_turned { count - i } else { i };
                let angle = i as f64 / count as f64 * std::f64::consts::TAU;
                let away = least + random(state, most - least);
                [middle[0] + away * angle.cos(), middle[1] + away * angle.sin()]
            };
            (0..count).map(corner).collect()
        };
        let (a, b) = (random(state, 2.0) > 1.0, random(state, 2.0) > 1.0);
        // (A hole of three corners reaches further towards the middle than its corners do.)
        vec![ring(state, radius * 0.9, radius, a), ring(state, radius * 0.1, radius * 0.3, b)]
    }

    /// Whether a point is inside, by the definition.
    fn is_inside(rings: &[Vec<[f64; 2]>], [x, y]: [f64; 2]) -> bool {
        let edges = rings.iter().flat_map(|ring| ring.iter().zip(ring.iter().cycle().skip(1)));
        let crosses = edges.filter(|(a, b)| {
            (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        });
        crosses.count() % 2 == 1
    }

    #[test]
    fn memory_goes_with_the_edges_however_long_they_are() {
        // Every edge passes through all rows, or through half of them, or hardly any.
        for height in [4096.0, 2048.0, 1.0] {
            let zigzag: Vec<[f64; 2]> = (0..20_000)
                .map(|i| [f64::from(i) / 5.0, if i % 2 == 0 { 0.0 } else { height }])
                .chain([[4000.0, 4096.0], [0.0, 4096.0]])
                .collect();
            let polygon = Polygon::new(&[zigzag]).unwrap();
            assert!(polygon.passing.len() <= BANDS_EACH * polygon.edges.len());
            assert_eq!(polygon.edges.len(), 20_002);
        }
    }

    #[test]
    fn centres_are_counted_as_one_by_one() {
        let mut state = 1;
        let mut crossings = Crossings::default();
        for _ in 0..60 {
            let middle = [random(&mut state, 40.0), random(&mut state, 40.0)];
            let radius = 1.0 + random(&mut state, 30.0);
            let rings = star(&mut state, middle, radius);
            let polygon = Polygon::of_parts(std::slice::from_ref(&rings)).unwrap();
            for _ in 0..20 {
                let min = [random(&mut state, 40.0) as u64, random(&mut state, 40.0) as u64, 0];
                let size = [1 + random(&mut state, 16.0) as u64, 1 + random(&mut state, 16.0) as u64];
                let bounds = Bounds { min, max: [min[0] + size[0], min[1] + size[1], 1] };
                let cells =
                    (min[1]..bounds.max[1]).flat_map(|y| (min[0]..bounds.max[0]).map(move |x| (x, y)));
                let expected =
                    cells.filter(|(x, y)| is_inside(&rings, [centre(*x), centre(*y)])).count() as u64;
                assert_eq!(polygon.count_centres(&bounds, &mut crossings), expected, "{bounds:?}");
                /// Area that rounding alone may leave of a cell which only a corner touches; random edges cut off far more.
                const ROUNDING: f64 = 1e-12;
                let cells =
                    (min[1]..bounds.max[1]).flat_map(|y| (min[0]..bounds.max[0]).map(move |x| (x, y)));
                let cell = |(x, y): (u64, u64)| Bounds { min: [x, y, 0], max: [x + 1, y + 1, 1] };
                let touched = cells.filter(|at| polygon.area(&cell(*at)) > ROUNDING).count() as u64;
                assert_eq!(polygon.count_touched(&bounds, &mut crossings), touched, "{bounds:?}");
                match polygon.cover_centres(&bounds) {
                    Cover::Whole => assert_eq!(expected, size[0] * size[1]),
                    Cover::Nothing => assert_eq!(expected, 0),
                    Cover::Part => assert!(size[0] * size[1] > 1),
                }
            }
        }
    }

    #[test]
    fn areas_are_those_of_many_points() {
        let mut state = 2;
        for _ in 0..40 {
            let middle = [random(&mut state, 20.0), random(&mut state, 20.0)];
            let radius = 1.0 + random(&mut state, 12.0);
            let rings = star(&mut state, middle, radius);
            let polygon = Polygon::of_parts(std::slice::from_ref(&rings)).unwrap();
            let whole = Bounds { min: [0; 3], max: [40, 40, 1] };
            let mut sum = 0.0;
            for x in 0..40 {
                for y in 0..40 {
                    let cell = Bounds { min: [x, y, 0], max: [x + 1, y + 1, 1] };
                    let area = polygon.area(&cell);
                    sum += area;
                    let points = (0..400).map(|i| {
                        [x as f64 + (i % 20) as f64 / 20.0 + 0.025, y as f64 + (i / 20) as f64 / 20.0 + 0.025]
                    });
                    let expected = points.filter(|point| is_inside(&rings, *point)).count() as f64 / 400.0;
                    assert!((area - expected).abs() < 0.06, "{area}, not {expected}");
                    match polygon.cover_area(&cell) {
                        Cover::Whole => assert!((area - 1.0).abs() < 1e-9, "{area}"),
                        Cover::Nothing => assert!(area < 1e-9, "{area}"),
                        Cover::Part => {}
                    }
                }
            }
            assert!((sum - polygon.area(&whole)).abs() < 1e-9 * sum.max(1.0));
            if middle.iter().all(|at| *at > radius) {
                let exact = (signed_area(&rings[0]).abs() - signed_area(&rings[1]).abs()) / 2.0;
                assert!((sum - exact).abs() < 1e-9 * exact, "{sum}, not {exact}");
            }
        }
    }

    #[test]
    fn shares_of_rows_are_the_areas_of_their_cells() {
        let mut state = 3;
        let mut crossings = Crossings::default();
        // (Corners in the middle of cells, on their corners, and anywhere.)
        for step in [0.5, 1.0, 1e-9] {
            for _ in 0..60 {
                let middle = [random(&mut state, 40.0), random(&mut state, 40.0)];
                let radius = 1.0 + random(&mut state, 30.0);
                let mut rings = star(&mut state, middle, radius);
                for at in rings.iter_mut().flatten().flatten() {
                    *at = (*at / step).round() * step;
                }
                let polygon = Polygon::of_parts(std::slice::from_ref(&rings)).unwrap();
                let min = [random(&mut state, 40.0) as u64, random(&mut state, 40.0) as u64, 0];
                let size = [1 + random(&mut state, 30.0) as u64, 1 + random(&mut state, 30.0) as u64];
                let bounds = Bounds { min, max: [min[0] + size[0], min[1] + size[1], 1] };
                let mut shares = std::collections::BTreeMap::new();
                polygon.shares(&bounds, &mut crossings, &mut |row, columns, share| {
                    for column in columns {
                        assert!(shares.insert([column, row], share).is_none());
                    }
                });
                for y in min[1]..bounds.max[1] {
                    for x in min[0]..bounds.max[0] {
                        let area = polygon.area(&Bounds { min: [x, y, 0], max: [x + 1, y + 1, 1] });
                        let share = shares.remove(&[x, y]).unwrap_or(0.0);
                        assert!((share - area).abs() < 1e-9, "{share}, not {area}, at {x}, {y}");
                    }
                }
                assert!(shares.is_empty());
            }
        }
    }

    #[test]
    fn cells_with_corners_and_edges_on_rings_count_once() {
        // Two squares that share a side, along rows and columns of centres.
        let square = |x: f64| vec![vec![[x, 2.5], [x + 4.0, 2.5], [x + 4.0, 8.5], [x, 8.5]]];
        let all = Bounds { min: [0; 3], max: [20, 20, 1] };
        let mut crossings = Crossings::default();
        let [a, b] = [3.5, 7.5].map(|x| Polygon::of_parts(&[square(x)]).unwrap());
        let both = Polygon::of_parts(&[square(3.5), square(7.5)]).unwrap();
        let counts = [&a, &b, &both].map(|polygon| polygon.count_centres(&all, &mut crossings));
        assert_eq!(counts, [24, 24, 48]);
        assert_eq!([a.area(&all), b.area(&all), both.area(&all)], [24.0, 24.0, 48.0]);
        assert!(Polygon::new(&[vec![[0.0, 0.0], [1.0, f64::NAN], [1.0, 1.0]]]).is_err());
        assert!(Polygon::new(&[]).is_err() && Polygon::of_parts(&[vec![vec![[0.0; 2]; 2]]]).is_err());
    }
}
