//! Intersection of lines with faces: decided in integers, consistently over all faces.
//!
//! A line's ends are rounded to a grid finer than the model's, and are exact from then on. Lines
//! may pass through edges and vertices, along faces, and end on them. For results that are
//! consistent over all faces, each line is treated as moved by an infinitesimal vector, by far the
//! most along x and by far the least along z (simulation of simplicity, Edelsbrunner and Muecke,
//! 1990). The first derivative that is not zero then decides a tie, and every line meets a closed
//! surface like a line in general position does. It never passes between two neighbouring faces,
//! and never meets both where it crosses from one to the other.
//!
//! Projected along the line, a face is met if it winds around the line's point. Edges count where
//! they cross the half-plane from the line along one axis.

use super::plane::Plane;
use crate::exact::bounds::{LINE_BITS as BITS, SHARE_ROUNDING, TURN_ROUNDING};
use crate::exact::normal::triangle_normal;
use crate::exact::perturbation::sign_or_first;
use crate::exact::vector::{cross, dot, others, subtract};
use crate::{Face, Grid};

/// A straight line segment between two points.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// The ends, in grid units over `2^fraction`.
    from: [i64; 3],
    to: [i64; 3],
    fraction: u8,
    /// Vector from the first end to the second one.
    along: [i64; 3],
    /// First end and vector to the second one in grid units, exactly.
    start: [f64; 3],
    way: [f64; 3],
    /// Reciprocals of the vector's components.
    inverse: [f64; 3],
    /// Maximum rounding error of the turn of an edge between grid points around the line, in
    /// doubles.
    rounding: f64,
    /// The two axes other than the direction of the half-plane.
    across: [usize; 2],
    /// Parameters of the original line at which this one begins and ends.
    shares: [f64; 2],
}

/// Parameters of a line at which it enters and leaves the slab between two walls.
pub(super) type Passage = [f64; 2];

/// Passages of a line parallel to two walls: between them, or not.
const ALWAYS: Passage = [f64::NEG_INFINITY, f64::INFINITY];
const NEVER: Passage = [f64::INFINITY, f64::NEG_INFINITY];

/// Number of triangles that are tested at once.
pub(super) const LANES: usize = 4;

/// Coordinates of triangles: of each vertex, along each axis, of each triangle.
pub(super) type Triangles = [[[i32; LANES]; 3]; 3];

/// Triangles that doubles can decide about: a bit for each triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sides {
    /// The line certainly does not cross the triangle.
    pub(super) missed: u8,
    /// The triangle certainly winds around the infinite line.
    pub(super) around: u8,
}

// (The operands are not NaN, so that each of these is a single instruction.)
#[inline]
fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[inline]
fn less(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Rounds a number below 2^51 to the nearest integer, and ties to even ones. (Not all processors
/// have an instruction for it, and the function of the C library takes longer.)
#[inline]
fn round(number: f64) -> i64 {
    // Consecutive doubles between 2^52 and 2^53 are consecutive integers, and so are their bits.
    const SHIFT: f64 = (3u64 << 51) as f64;
    (number + SHIFT).to_bits() as i64 - SHIFT.to_bits() as i64
}

/// A crossing of a line and a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Parameter of the crossing: 0 at the line's first end and 1 at its last one, or in lengths of
    /// a ray's direction. Rounded, with a relative error of less than 2^-50.
    pub share: f64,
    /// Whether the line enters the body.
    pub is_entry: bool,
}

impl Line {
    /// Creates the line between two points, in grid units from the grid's point 0, 0, 0. Returns
    /// `None` if no part of it is near the grid, or if it has no length.
    ///
    /// Only the part within one grid unit around the grid counts. Its ends are moved by at most
    /// `2^(bits - 41)` grid units along each axis, which is 1 / 32768 of a grid unit for the grid
    /// with the maximum bits. Rounding of doubles adds to this if the first end is far from the
    /// grid.
    pub fn between(grid: &Grid, from: [f64; 3], to: [f64; 3]) -> Option<Line> {
        let along = subtract(to, from);
        Line::part(grid, from, along, [0.0, 1.0])
    }

    /// Creates a ray from a point; as [`Line::between`].
    pub fn ray(grid: &Grid, from: [f64; 3], direction: [f64; 3]) -> Option<Line> {
        Line::part(grid, from, direction, [0.0, f64::INFINITY])
    }

    /// Creates the line between the minimum corners of two cells, each given by its minimum grid
    /// point: half a grid unit below it, exactly. Returns `None` if the corners are equal.
    pub fn between_corners(grid: &Grid, from: [i32; 3], to: [i32; 3]) -> Option<Line> {
        let [from, to] = [from, to].map(|point| point.map(|at| 2 * i64::from(at) - 1));
        Line::between_fine(grid, 1, from, to)
    }

    /// Creates the line between two points in `2^-bits` grid units, exactly.
    pub(super) fn between_fine(grid: &Grid, bits: u8, from: [i64; 3], to: [i64; 3]) -> Option<Line> {
        let fraction = BITS - grid.bits;
        let [from, to] = [from, to].map(|point| point.map(|at| at << (fraction - bits)));
        Line::new(from, to, fraction, [0.0, 1.0])
    }

    fn part(grid: &Grid, from: [f64; 3], along: [f64; 3], [mut first, mut last]: [f64; 2]) -> Option<Line> {
        let (low, high) = (-1.0, (1u64 << grid.bits) as f64);
        if from.iter().chain(&along).any(|number| !number.is_finite()) {
            return None;
        }
        for axis in 0..3 {
            if along[axis] == 0.0 {
                if from[axis] < low || from[axis] > high {
                    return None;
                }
                continue;
            }
            let [a, b] = [low, high].map(|wall| (wall - from[axis]) / along[axis]);
            first = first.max(a.min(b));
            last = last.min(a.max(b));
        }
        if first > last || !last.is_finite() {
            return None;
        }
        let fraction = BITS - grid.bits;
        let scale = (1u64 << fraction) as f64;
        let [start, end] = [first, last].map(|share| {
            [0, 1, 2].map(|axis| {
                let at = (from[axis] + along[axis] * share).clamp(low, high);
                round(at * scale)
            })
        });
        Line::new(start, end, fraction, [first, last])
    }

    fn new(from: [i64; 3], to: [i64; 3], fraction: u8, shares: [f64; 2]) -> Option<Line> {
        let along = subtract(to, from);
        // The half-plane is along the line's shortest axis, so that it is not degenerate.
        let axis = (0..3).min_by_key(|&axis| along[axis].abs())?;
        let across = others(axis);
        let scale = 1.0 / (1u64 << fraction) as f64;
        let [start, way] = [from, along].map(|at| at.map(|at| at as f64 * scale));
        // Invariant: lines begin within one grid unit of the grid. So coordinates relative to their
        // start are at most the grid's width, and the magnitudes of a turn's terms sum to at most
        // `terms`. Triangles would be missed by a line that begins farther away.
        debug_assert!(from.iter().all(|at| (-1..=1 << (BITS - fraction)).contains(&(at >> fraction))));
        let reach = (1u64 << (BITS - fraction)) as f64;
        let terms = 2.0 * way.iter().map(|at| at.abs()).sum::<f64>() * reach * reach;
        let rounding = TURN_ROUNDING * terms;
        let inverse = way.map(|along| 1.0 / along);
        (along != [0; 3]).then_some(Line {
            from,
            to,
            fraction,
            along,
            start,
            way,
            inverse,
            rounding,
            across,
            shares,
        })
    }

    /// Returns the crossing with a face, if there is one.
    pub fn crossing(&self, face: &Face<'_>) -> Option<Crossing> {
        self.crossing_of(face, &Plane::of(face))
    }

    /// Returns the crossing with a triangle, if there is one. Cheaper if the triangle is known to
    /// wind around the line: see [`Line::sides`].
    pub(super) fn crossing_of_triangle(&self, ring: &[[i32; 3]; 3], is_around: bool) -> Option<Crossing> {
        let plane = Plane { normal: triangle_normal(ring), through: ring[0] };
        self.plane_crossing(&plane).filter(|_| is_around || self.winding(ring) != 0)
    }

    /// Returns the crossing with a face whose plane is known.
    pub(super) fn crossing_of(&self, face: &Face<'_>, plane: &Plane) -> Option<Crossing> {
        let crossing = self.plane_crossing(plane)?;
        let winding: i32 = face.rings().map(|ring| self.winding(ring)).sum();
        (winding != 0).then_some(crossing)
    }

    /// Returns the crossing with a face's plane, if its ends are on both sides of it.
    fn plane_crossing(&self, plane: &Plane) -> Option<Crossing> {
        let normal = plane.normal.map(i128::from);
        // (A displacement of the line against the normal raises the plane.)
        let raised = normal.map(|n| -n);
        let height =
            |end: &[i64; 3]| -> i128 { dot(normal, self.relative(&plane.through, end).map(i128::from)) };
        let (before, after) = (height(&self.from), height(&self.to));
        let is_entry = sign_or_first(before, raised) < 0;
        if is_entry == (sign_or_first(after, raised) < 0) {
            return None;
        }
        let share = before as f64 / (before - after) as f64;
        let [first, last] = self.shares;
        Some(Crossing { share: first + (last - first) * share, is_entry })
    }

    /// Returns on which sides of triangles' edges the line is, in doubles.
    ///
    /// If the line is on opposite sides of two edges, both beyond the rounding error, the triangle
    /// cannot wind around it, whether it is perturbed or not. If it is on the same side of all
    /// edges, beyond the rounding error of each, the triangle certainly winds around it.
    #[inline]
    pub(super) fn sides(&self, triangles: &Triangles) -> Sides {
        let (s, d) = (self.start, self.way);
        let (mut least, mut most) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            // (Exact: integers with fewer bits than doubles have, over a power of two.)
            let seen = |corner: &[[i32; LANES]; 3]| {
                let at = |axis: usize| f64::from(corner[axis][lane]) - s[axis];
                [at(0), at(1), at(2)]
            };
            let [a, b, c] = [seen(&triangles[0]), seen(&triangles[1]), seen(&triangles[2])];
            let [u, v, w] = [dot(d, cross(a, b)), dot(d, cross(b, c)), dot(d, cross(c, a))];
            (least[lane], most[lane]) = (less(less(u, v), w), greater(greater(u, v), w));
        }
        let mut sides = Sides { missed: 0, around: 0 };
        for lane in 0..LANES {
            let left = [most[lane] > self.rounding, least[lane] > self.rounding];
            let right = [least[lane] < -self.rounding, most[lane] < -self.rounding];
            sides.missed |= u8::from(left[0] & right[0]) << lane;
            sides.around |= u8::from(left[1] | right[1]) << lane;
        }
        sides
    }

    /// Returns a grid point relative to an end.
    #[inline]
    fn relative(&self, point: &[i32; 3], end: &[i64; 3]) -> [i64; 3] {
        [0, 1, 2].map(|axis| (i64::from(point[axis]) << self.fraction) - end[axis])
    }

    /// Returns the winding number of a ring around the line.
    fn winding(&self, ring: &[[i32; 3]]) -> i32 {
        let Some(last) = ring.last() else { return 0 };
        let mut winding = 0;
        let mut a = self.relative(last, &self.from);
        let mut a_is_beyond = self.is_beyond(&a);
        for point in ring {
            let b = self.relative(point, &self.from);
            let b_is_beyond = self.is_beyond(&b);
            if a_is_beyond != b_is_beyond {
                let turn = self.turn(&a, &b);
                if b_is_beyond && turn > 0 {
                    winding += 1;
                } else if a_is_beyond && turn < 0 {
                    winding -= 1;
                }
            }
            (a, a_is_beyond) = (b, b_is_beyond);
        }
        winding
    }

    /// Returns whether a point is on the positive side of the half-plane's plane.
    #[inline]
    fn is_beyond(&self, point: &[i64; 3]) -> bool {
        let [i, j] = self.across;
        let (d, p) = (self.along.map(i128::from), point.map(i128::from));
        let mut step = [0; 3];
        (step[i], step[j]) = (-d[j], d[i]);
        sign_or_first(p[i] * d[j] - p[j] * d[i], step) > 0
    }

    /// Returns on which side the edge between two points passes the line: positive if
    /// counterclockwise as seen from the line's far end.
    fn turn(&self, a: &[i64; 3], b: &[i64; 3]) -> i32 {
        let (a, b, d) = (a.map(i128::from), b.map(i128::from), self.along.map(i128::from));
        let turn = dot(d, cross(a, b));
        if turn != 0 {
            return turn.signum() as i32;
        }
        sign_or_first(0, cross(subtract(a, b), d))
    }

    /// Returns the parameter range of the line within a closed box of grid coordinates, slightly
    /// enlarged; `None` if it misses the box. Parameters are those of a [`Crossing`].
    pub fn within(&self, min: [f64; 3], max: [f64; 3]) -> Option<[f64; 2]> {
        self.within_all(&[0, 1, 2].map(|axis| self.passage(axis, min[axis], max[axis])))
    }

    /// Returns this segment's parameters at which it enters and leaves the slab between two walls
    /// across an axis; the first is larger if it never does.
    #[inline]
    pub(super) fn passage(&self, axis: usize, min: f64, max: f64) -> Passage {
        let from = self.start[axis];
        if self.way[axis] == 0.0 {
            return if min <= from && from <= max { ALWAYS } else { NEVER };
        }
        let [a, b] = [min, max].map(|wall| (wall - from) * self.inverse[axis]);
        [a.min(b), a.max(b)]
    }

    /// Returns the passages through both halves of a slab that the line passes, split by a wall:
    /// first the half in which it begins.
    #[inline]
    pub(super) fn halves(&self, axis: usize, [first, last]: Passage, middle: f64) -> [Passage; 2] {
        let from = self.start[axis];
        if self.way[axis] == 0.0 {
            return [from <= middle, from >= middle].map(|is_there| if is_there { ALWAYS } else { NEVER });
        }
        let middle = (middle - from) * self.inverse[axis];
        [[first, middle], [middle, last]]
    }

    /// Returns the same as [`Line::within`] of a box, given the passages along each axis.
    #[inline]
    pub(super) fn within_all(&self, passages: &[Passage; 3]) -> Option<[f64; 2]> {
        let [first, last] = Line::part_within(passages)?;
        Some([self.share_of(first), self.share_of(last)])
    }

    /// Returns the parameter range of this segment, from 0 to 1, within a box, given the passages
    /// along each axis; `None` if it misses the box.
    #[inline]
    pub(super) fn part_within(passages: &[Passage; 3]) -> Option<[f64; 2]> {
        let [[x, u], [y, v], [z, w]] = *passages;
        let first = greater(greater(greater(x, y), z) - SHARE_ROUNDING, 0.0);
        let last = less(less(less(u, v), w) + SHARE_ROUNDING, 1.0);
        (first <= last).then_some([first, last])
    }

    /// Converts a parameter of this segment to one of the original line.
    #[inline]
    pub(super) fn share_of(&self, part: f64) -> f64 {
        let [start, end] = self.shares;
        start + (end - start) * part
    }

    /// Returns which halves along an axis the line passes within a parameter range, slightly
    /// enlarged: a bit for each.
    #[inline]
    pub(super) fn halves_within(halves: &[Passage; 2], [first, last]: [f64; 2]) -> u8 {
        let is_within = |[enters, leaves]: [f64; 2]| {
            let (enters, leaves) = (enters - SHARE_ROUNDING, leaves + SHARE_ROUNDING);
            (enters <= last) & (first <= leaves) & (enters <= leaves)
        };
        u8::from(is_within(halves[0])) | u8::from(is_within(halves[1])) << 1
    }

    /// Returns the child of a cell in which a line through all of its children would begin: a bit
    /// per axis, set if the line descends along it.
    pub(super) fn turned(&self) -> usize {
        (0..3).map(|axis| usize::from(self.along[axis] < 0) << axis).sum()
    }

    /// Returns the point at a parameter, in grid units.
    pub fn at(&self, share: f64) -> [f64; 3] {
        let [first, last] = self.shares;
        let part = if last > first { (share - first) / (last - first) } else { 0.0 };
        [0, 1, 2].map(|axis| self.start[axis] + self.way[axis] * part)
    }
}

#[cfg(test)]
mod tests {
    use bnum::cast::As;
    use bnum::types::I256;

    use super::super::testing::{Body, Random, cuboid, tetrahedron};
    use super::*;
    use crate::{FaceList, Faces, MAX_BITS};

    fn crossings(list: &FaceList, line: &Line) -> Vec<Crossing> {
        let mut all: Vec<Crossing> =
            (0..list.len() as usize).filter_map(|number| line.crossing(&list.get(number))).collect();
        all.sort_by(|a, b| a.share.total_cmp(&b.share));
        all
    }

    /// Lines through vertices, along edges and in faces of convex bodies: lines that begin and end
    /// outside cross the surface twice or not at all.
    #[test]
    fn lines_through_edges_and_corners_enter_and_leave_once() {
        let mut random = Random(1);
        let mut counts = [0; 3];
        for round in 0..6000 {
            let (low, high) = (4, 12);
            let faces = if round % 2 == 0 {
                Some(cuboid([low; 3], [high; 3], false))
            } else {
                tetrahedron([0; 4].map(|_| random.point(9).map(|at| at + low)))
            };
            let Some(faces) = faces else { continue };
            let corners: Vec<[i32; 3]> = faces.concat().concat();
            let list = Body::new(4).with(faces).list();
            for _ in 0..10 {
                // Through two points that are vertices, or midpoints of vertices.
                let mut at = || {
                    let [a, b] = [0; 2].map(|_| corners[random.below(corners.len() as u64) as usize]);
                    [0, 1, 2].map(|i| f64::from(a[i] + b[i]) / 2.0)
                };
                let (a, b) = (at(), at());
                let from = [0, 1, 2].map(|i| a[i] - 16.0 * (b[i] - a[i]));
                let to = [0, 1, 2].map(|i| b[i] + 16.0 * (b[i] - a[i]));
                let Some(line) = Line::between(list.grid(), from, to) else { continue };
                let found = crossings(&list, &line);
                counts[found.len()] += 1;
                if let [first, second] = found[..] {
                    assert!(first.share == second.share || (first.is_entry && !second.is_entry));
                    assert!(first.is_entry != second.is_entry);
                }
            }
        }
        assert!(counts[1] == 0 && counts[0] > 1000 && counts[2] > 10_000, "{counts:?}");
    }

    /// From any point to infinity: the sum of crossings is the winding number of the point.
    #[test]
    fn lines_from_inside_leave_once_more() {
        let mut random = Random(2);
        let list = Body::new(6)
            .with(cuboid([8; 3], [50, 40, 30], false))
            .with(cuboid([20; 3], [24; 3], true))
            .list();
        let within = |p: [f64; 3], min: f64, max: [f64; 3]| (0..3).all(|i| min < p[i] && p[i] < max[i]);
        for _ in 0..20_000 {
            let from = random.point(64).map(|at| f64::from(at) + 0.25);
            let target = random.point(64).map(f64::from);
            let direction = [0, 1, 2].map(|i| target[i] - from[i]);
            let Some(line) = Line::ray(list.grid(), from, direction) else { panic!("{from:?}") };
            let winding: i32 =
                crossings(&list, &line).iter().map(|crossing| if crossing.is_entry { -1 } else { 1 }).sum();
            let expected = within(from, 8.0, [50.0, 40.0, 30.0]) && !within(from, 20.0, [24.0; 3]);
            assert_eq!(winding, i32::from(expected), "{from:?} {target:?}");
        }
    }

    /// The point of a crossing is where the line meets the plane, also for lines from distant
    /// points.
    #[test]
    fn crossings_are_on_the_line_and_the_plane() {
        let mut random = Random(3);
        let mut met = 0;
        for _ in 0..3000 {
            let corners = [0; 4].map(|_| random.point(1 << 20));
            let Some(faces) = tetrahedron(corners) else { continue };
            let list = Body::new(20).with(faces).list();
            let from = random.point(1 << 22).map(|at| f64::from(at) * 3.0 - 5e6);
            let middle = [0, 1, 2].map(|i| corners.iter().map(|p| f64::from(p[i])).sum::<f64>() / 4.0);
            let direction = [0, 1, 2].map(|i| (middle[i] - from[i]) / 1000.0);
            let Some(line) = Line::ray(list.grid(), from, direction) else { panic!() };
            let found: Vec<(usize, Crossing)> = (0..4)
                .filter_map(|number| line.crossing(&list.get(number)).map(|crossing| (number, crossing)))
                .collect();
            // The line passes through the centre, which may be less than a grid unit from two
            // faces.
            for (number, crossing) in found {
                let plane = Plane::of(&list.get(number));
                let normal = plane.normal.map(|n| n as f64);
                let height = |p: [f64; 3]| {
                    (0..3).map(|i| normal[i] * (p[i] - f64::from(plane.through[i]))).sum::<f64>()
                };
                let share = height(from) / -(0..3).map(|i| normal[i] * direction[i]).sum::<f64>();
                let steepness = (0..3).map(|i| normal[i] * direction[i]).sum::<f64>().abs()
                    / (normal.iter().map(|n| n * n).sum::<f64>()
                        * direction.iter().map(|d| d * d).sum::<f64>())
                    .sqrt();
                let distance =
                    (share - crossing.share).abs() * direction.iter().map(|d| d * d).sum::<f64>().sqrt();
                assert!(distance * steepness < 1e-5, "{distance} {steepness}");
                let at = line.at(crossing.share);
                assert!((height(at) / normal.iter().map(|n| n * n).sum::<f64>().sqrt()).abs() < 1e-5);
                met += 1;
            }
        }
        assert!(met > 5000, "{met}");
    }

    #[test]
    fn lines_that_are_none_or_miss_the_grid() {
        let grid = Body::new(4).list().grid().clone();
        assert!(Line::ray(&grid, [1.0; 3], [0.0; 3]).is_none());
        assert!(Line::ray(&grid, [f64::NAN; 3], [1.0; 3]).is_none());
        assert!(Line::ray(&grid, [-5.0, 0.0, 0.0], [-1.0, 0.0, 0.0]).is_none());
        assert!(Line::ray(&grid, [-5.0, 0.0, 99.0], [1.0, 0.0, 0.0]).is_none());
        assert!(Line::between(&grid, [-5.0, 0.0, 0.0], [-2.0, 0.0, 0.0]).is_none());
        let line = Line::between(&grid, [-5.0, 2.0, 2.0], [5.0, 2.0, 2.0]).unwrap();
        let [first, last] = line.within([0.0; 3], [4.0; 3]).unwrap();
        assert!((first - 0.5).abs() < 1e-9 && (last - 0.9).abs() < 1e-9);
        assert!(line.within([0.0, 3.0, 0.0], [4.0; 3]).is_none());
    }

    /// Triangles that doubles classify as missed are not crossed, and those around the line are
    /// crossed where the line passes their plane: also where lines pass through vertices and along
    /// edges. Doubles detect nearly all triangles that are not crossed.
    #[test]
    fn triangles_that_are_missed_have_no_crossing() {
        for (bits, size) in [(4, 12), (20, 1 << 20), (MAX_BITS, (1 << MAX_BITS) - 1)] {
            let grid = Grid { bits, origin: [0; 3], step: 1.0, divisor: 1.0 };
            let mut random = Random(6);
            let mut counts = [0; 4];
            for round in 0..20_000 {
                let ring = [random.point(size), random.point(size), random.point(size)];
                let mut end = |round: u32| {
                    let [a, b] = [ring[random.below(3) as usize], random.point(size)];
                    match round % 3 {
                        0 => a.map(f64::from),
                        1 => [0, 1, 2].map(|i| f64::from(ring[0][i] + ring[1][i]) / 2.0),
                        _ => b.map(|at| f64::from(at) + 0.3),
                    }
                };
                let (from, to) = (end(round / 3), end(round));
                let Some(line) = Line::ray(&grid, from, subtract(to, from)) else { continue };
                let face =
                    Face { number: 0, points: &ring, ring_ends: &[3], colours: &[], part: 0, source: 0 };
                // The triangle in one lane, and others in the other lanes.
                let mut others = [0; LANES].map(|_| [0; 3].map(|_| random.point(size)));
                let lane = random.below(LANES as u64) as usize;
                others[lane] = ring;
                let sides = line.sides(
                    &[0, 1, 2]
                        .map(|corner| [0, 1, 2].map(|axis| others.map(|triangle| triangle[corner][axis]))),
                );
                let [is_missed, is_around] = [sides.missed, sides.around].map(|bits| bits >> lane & 1 == 1);
                let found = line.crossing(&face);
                assert!(!(is_missed && is_around));
                assert_eq!(line.crossing_of_triangle(&ring, is_around), found, "{line:?} {ring:?}");
                counts[3] += u32::from(is_around && line.winding(&ring) != 0);
                assert!(!is_around || line.winding(&ring) != 0, "{line:?} {ring:?}");
                match (is_missed, found) {
                    (true, found) => {
                        assert_eq!(found, None, "{line:?} {ring:?}");
                        counts[0] += 1;
                    }
                    (false, None) => counts[1] += 1,
                    (false, Some(_)) => counts[2] += 1,
                }
            }
            assert!(counts[..3].iter().all(|count| *count > 500) && counts[3] > 100, "{counts:?}");
        }
    }

    /// Turns around the longest lines, past the farthest vertices, equal those of wider integers;
    /// and parameters of crossings are within those of the face's box.
    #[test]
    fn the_widest_numbers_fit() {
        let far = (1i32 << MAX_BITS) - 1;
        let grid = Grid { bits: MAX_BITS, origin: [0; 3], step: 1.0, divisor: 1.0 };
        let mut random = Random(5);
        let wide = |point: &[i64; 3]| point.map(|at| -> I256 { at.as_() });
        let (mut turns, mut met) = ([0; 3], 0);
        for _ in 0..20_000 {
            let mut corner = || {
                [0; 3].map(|_: i32| [0, far, far / 2, random.next() as i32 & far][random.next() as usize % 4])
            };
            let ring = [corner(), corner(), corner()];
            let outside = |at: i32| {
                if at > far / 2 { f64::from(far) + 1.0 } else { f64::from(at) - f64::from(u8::from(at == 0)) }
            };
            let (from, to) = (corner().map(outside), corner().map(outside));
            let Some(line) = Line::between(&grid, from, to) else { continue };
            let [a, b, _] = ring.map(|point| line.relative(&point, &line.from));
            let turn = dot(wide(&line.along), cross(wide(&a), wide(&b)));
            let found = line.turn(&a, &b);
            if !turn.is_zero() {
                assert_eq!(found, if turn.is_positive() { 1 } else { -1 }, "{line:?} {ring:?}");
            }
            turns[if turn.is_zero() {
                0
            } else if turn.is_positive() {
                1
            } else {
                2
            }] += 1;
            let face = Face { number: 0, points: &ring, ring_ends: &[3], colours: &[], part: 0, source: 0 };
            if let Some(crossing) = line.crossing(&face) {
                let least = [0, 1, 2]
                    .map(|axis| ring.iter().map(|p| f64::from(p[axis])).fold(f64::INFINITY, f64::min));
                let most = [0, 1, 2].map(|axis| ring.iter().map(|p| f64::from(p[axis])).fold(0.0, f64::max));
                let [first, last] = line.within(least, most).expect("the box has what the face has");
                assert!(first <= crossing.share && crossing.share <= last, "{line:?} {ring:?}");
                met += 1;
            }
        }
        assert!(turns.iter().all(|count| *count > 500) && met > 500, "{turns:?} {met}");
    }
}
