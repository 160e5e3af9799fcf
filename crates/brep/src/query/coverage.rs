//! Volume and first moments of a body's part in a cell: exact except for rounding, from the faces
//! that cut the cell and the state of the cell's minimum corner.
//!
//! Whether a point of the cell is inside follows from the faces that are crossed on the path from
//! the corner along z, then along y, then along x. Integrated over the cell, every face contributes
//! the region beyond it. A crossing with the cell's edge along z contributes the part of the cell
//! beyond it. A section with the wall through that edge along y contributes what is beyond it along
//! y, and the whole width along x. A face's area in the cell contributes what is beyond it along x.
//! Nothing has to be capped or sorted, and every term is a sum over the faces.
//!
//! Polygons are fans of triangles, and holes are fans of opposite orientation, so excess areas
//! cancel. A face's contribution is discontinuous where the face passes the starting edge or
//! corner. For consistency of all faces, the edge and the corner are moved by an infinitesimal
//! vector, by far the most along x and by far the least along z, as lines are (see
//! [`super::Line`]). On which side faces pass is decided in integers. The moved corner is within
//! the cell. Vertices are never on walls, since walls are halfway between grid points, so
//! everything else is continuous.

use crate::Face;
use crate::exact::perturbation::sign_or_first;
use crate::exact::vector::cross;
use crate::geometry::clipped::ClippedPolygon;

/// A cube of the grid, whose walls are halfway between grid points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cube {
    /// The minimum grid point in it.
    pub min: [i32; 3],
    /// Grid points along each axis: 1 to 2^26.
    pub side: u32,
}

/// Volume and moments of the part of a cell that is inside.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Volume, in cubed grid units. The error is below about 2^-50 times the vertex count of the
    /// faces, times the sum of their extent and the cell's, times the area of one of the cell's
    /// walls.
    pub volume: f64,
    /// Integrals of the coordinates relative to the cell's minimum corner, in the fourth power of
    /// grid units. Errors are those of the volume times the side of the cell.
    pub moments: [f64; 3],
}

impl Coverage {
    /// Returns the coverage of a cell that is inside completely.
    pub fn full(cube: &Cube) -> Coverage {
        let side = f64::from(cube.side);
        Coverage { volume: side.powi(3), moments: [side.powi(4) / 2.0; 3] }
    }
}

/// Sums over the faces that cut a cell.
#[derive(Clone, Copy, Debug)]
pub struct CoverageSums {
    cube: Cube,
    /// In half grid units.
    side: f64,
    /// Volume and moments, in powers of half grid units, relative to the state of the corner.
    sums: [f64; 4],
}

/// A point of the wall of y and z, in half grid units.
type WallPoint = [f64; 2];

impl CoverageSums {
    /// Creates the sums of a cell without faces.
    pub fn new(cube: Cube) -> CoverageSums {
        CoverageSums { cube, side: 2.0 * f64::from(cube.side), sums: [0.0; 4] }
    }

    /// Adds a face; one that does not cut the cell has no effect.
    pub fn add_face(&mut self, face: &Face<'_>) {
        let min = self.cube.min;
        let relative =
            |point: &[i32; 3]| [0, 1, 2].map(|axis| 2 * (i64::from(point[axis]) - i64::from(min[axis])) + 1);
        for ring in face.rings() {
            let mut corners = ring.iter().map(relative);
            let (Some(first), Some(mut last)) = (corners.next(), corners.next()) else { continue };
            for corner in corners {
                self.add_triangle(&[first, last, corner]);
                last = corner;
            }
        }
    }

    /// Returns the coverage, given whether the cell's minimum corner is inside.
    ///
    /// A corner on a face has the state next to it in the direction of an infinitesimal vector, by
    /// far the largest along x and by far the smallest along z. [`super::Line::between_corners`]
    /// finds this state.
    pub fn coverage(&self, corner_is_inside: bool) -> Coverage {
        let full = if corner_is_inside { Coverage::full(&self.cube) } else { Coverage::default() };
        let [volume, moments @ ..] = self.sums;
        Coverage {
            volume: full.volume + volume / 8.0,
            moments: [0, 1, 2].map(|axis| full.moments[axis] + moments[axis] / 16.0),
        }
    }

    /// Vertices are in half grid units relative to the cell's minimum corner: odd numbers below
    /// 2^29.
    fn add_triangle(&mut self, corners: &[[i64; 3]; 3]) {
        let side = 2 * i64::from(self.cube.side);
        let is_outside = |axis: usize| {
            corners.iter().all(|corner| corner[axis] < 0) || corners.iter().all(|corner| corner[axis] > side)
        };
        if (0..3).any(is_outside) {
            return;
        }
        self.add_section(corners);
        let mut polygon = ClippedPolygon::of_points(&corners.map(|corner| corner.map(|at| at as f64)));
        for axis in 0..3 {
            polygon = polygon.split(axis, 0.0).1.split(axis, self.side).0;
        }
        self.add_polygon(&polygon);
    }

    /// Adds the region beyond a polygon in the cell along x.
    fn add_polygon(&mut self, polygon: &ClippedPolygon) {
        let Some((first, others)) = polygon.points().split_first() else { return };
        for pair in others.windows(2) {
            let [u, v]: [[f64; 2]; 2] = [0, 1].map(|i| [pair[i][1] - first[1], pair[i][2] - first[2]]);
            // An ascending path along x leaves the body at a face whose normal points towards
            // larger x. The rule with the edges' midpoints is exact for quadratic functions.
            let weight = -(u[0] * v[1] - u[1] * v[0]) / 6.0;
            for [a, b] in [[first, &pair[0]], [&pair[0], &pair[1]], [&pair[1], first]] {
                let [x, y, z] = [0, 1, 2].map(|axis| (a[axis] + b[axis]) / 2.0);
                let beyond = self.side - x;
                self.add(weight * beyond, [(self.side + x) / 2.0, y, z]);
            }
        }
    }

    /// Adds a volume with a centre.
    #[inline]
    fn add(&mut self, volume: f64, centre: [f64; 3]) {
        let [sum, moments @ ..] = &mut self.sums;
        *sum += volume;
        for (moment, centre) in moments.iter_mut().zip(centre) {
            *moment += volume * centre;
        }
    }

    /// Adds the region beyond a triangle's section with the wall of minimum x.
    fn add_section(&mut self, corners: &[[i64; 3]; 3]) {
        // Vertices are not in the wall: one edge passes it upwards and one downwards, or none does.
        let mut ends = [None; 2];
        for i in 0..3 {
            let (a, b) = (&corners[i], &corners[(i + 1) % 3]);
            if a[0] < 0 && b[0] > 0 {
                ends[0] = Some(Passage::of(a, b));
            } else if a[0] > 0 && b[0] < 0 {
                ends[1] = Some(Passage::of(b, a));
            }
        }
        let [Some(up), Some(down)] = ends else { return };
        match (up.is_above, down.is_above) {
            (false, false) => {}
            (true, true) => self.add_segment(up.at, down.at),
            (false, true) => {
                let crossing = [0.0, crossing(up.at, down.at)];
                self.add_segment(crossing, down.at);
                self.add_crossing(corners, crossing[1], false);
            }
            (true, false) => {
                let crossing = [0.0, crossing(up.at, down.at)];
                self.add_segment(up.at, crossing);
                self.add_crossing(corners, crossing[1], true);
            }
        }
    }

    /// Adds the region beyond a segment of a section along y. It is entered if the segment goes up
    /// along z, and left if it goes down.
    fn add_segment(&mut self, mut from: WallPoint, mut to: WallPoint) {
        const Y: usize = 0;
        const Z: usize = 1;
        for (axis, at, is_kept_below) in [(Y, self.side, true), (Z, self.side, true), (Z, 0.0, false)] {
            let is_out = |point: &WallPoint| (point[axis] > at) == is_kept_below && point[axis] != at;
            let cut = || {
                let share = (at - from[axis]) / (to[axis] - from[axis]);
                let mut point = [0, 1].map(|i| from[i] + (to[i] - from[i]) * share);
                point[axis] = at;
                point
            };
            match (is_out(&from), is_out(&to)) {
                (true, true) => return,
                (true, false) => from = cut(),
                (false, true) => to = cut(),
                (false, false) => {}
            }
        }
        // (Rounding errors.)
        from[Y] = from[Y].max(0.0);
        to[Y] = to[Y].max(0.0);
        // Simpson's rule is exact for cubic functions.
        let middle = [0, 1].map(|i| (from[i] + to[i]) / 2.0);
        for ([y, z], share) in [(from, 1.0), (middle, 4.0), (to, 1.0)] {
            let volume = (to[Z] - from[Z]) * share / 6.0 * (self.side - y) * self.side;
            self.add(volume, [self.side / 2.0, (self.side + y) / 2.0, z]);
        }
    }

    /// Adds the region beyond a crossing with the edge along z, if it is above the corner.
    fn add_crossing(&mut self, corners: &[[i64; 3]; 3], at: f64, is_entry: bool) {
        let [a, b, c] = corners;
        let normal = cross([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i])).map(i128::from);
        let height = (0..3).map(|axis| normal[axis] * i128::from(a[axis])).sum::<i128>();
        // Upwards, a face is entered against its normal.
        let is_above = (sign_or_first(height, normal.map(|n| -n)) < 0) == is_entry;
        if is_above {
            let at = at.clamp(0.0, self.side);
            let volume = (self.side - at) * self.side * self.side;
            let half = self.side / 2.0;
            self.add(if is_entry { volume } else { -volume }, [half, half, (self.side + at) / 2.0]);
        }
    }
}

/// The point at which an edge passes the wall of minimum x.
#[derive(Clone, Copy)]
struct Passage {
    at: WallPoint,
    /// Whether y is larger there than at the edge of the cell: exact, and without ties.
    is_above: bool,
}

impl Passage {
    /// Returns the passage of the edge from a vertex below to one above.
    fn of(below: &[i64; 3], above: &[i64; 3]) -> Passage {
        let width = above[0] - below[0];
        // Numbers have 29 bits, so this is exact up to the division.
        let [y, z] = [1, 2].map(|axis| below[axis] * above[0] - above[axis] * below[0]);
        let is_above = sign_or_first(y, [above[1] - below[1], -width, 0]) > 0;
        Passage { at: [y, z].map(|at| at as f64 / width as f64), is_above }
    }
}

/// Returns the height at which a section passes the edge of minimum y.
fn crossing(a: WallPoint, b: WallPoint) -> f64 {
    let share = a[0] / (a[0] - b[0]);
    a[1] + (b[1] - a[1]) * share
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Body, Random, cuboid, tetrahedron};
    use super::*;
    use crate::exact::vector::dot;
    use crate::query::{Line, MassProperties};
    use crate::{FaceList, Faces};

    type Tetrahedron = [[f64; 3]; 4];

    /// Clips tetrahedra to one side of a plane across an axis.
    fn clip(tetrahedra: &[Tetrahedron], axis: usize, at: f64, side: f64) -> Vec<Tetrahedron> {
        let mut kept = Vec::new();
        for tetrahedron in tetrahedra {
            let height = |p: &[f64; 3]| side * (p[axis] - at);
            let (inside, outside): (Vec<[f64; 3]>, Vec<[f64; 3]>) =
                tetrahedron.iter().partition(|p| height(p) > 0.0);
            let cut = |a: &[f64; 3], b: &[f64; 3]| {
                let share = height(a) / (height(a) - height(b));
                [0, 1, 2].map(|i| a[i] + (b[i] - a[i]) * share)
            };
            // The remainder is a tetrahedron, or a prism of three.
            let prism = |[a, b, c]: [[f64; 3]; 3], [d, e, f]: [[f64; 3]; 3]| {
                [[a, b, c, d], [b, c, d, e], [c, d, e, f]]
            };
            match (&inside[..], &outside[..]) {
                ([_, _, _, _], []) => kept.push(*tetrahedron),
                ([a], [p, q, r]) => kept.push([*a, cut(a, p), cut(a, q), cut(a, r)]),
                ([a, b], [p, q]) => {
                    kept.extend(prism([*a, cut(a, p), cut(a, q)], [*b, cut(b, p), cut(b, q)]))
                }
                ([a, b, c], [p]) => kept.extend(prism([*a, *b, *c], [cut(a, p), cut(b, p), cut(c, p)])),
                _ => {}
            }
        }
        kept
    }

    /// Volume and moments by clipping tetrahedra.
    fn expected(tetrahedra: &[[[i32; 3]; 4]], cube: &Cube) -> Coverage {
        let corner = cube.min.map(|at| f64::from(at) - 0.5);
        let relative = |p: [i32; 3]| [0, 1, 2].map(|axis| f64::from(p[axis]) - corner[axis]);
        let mut parts: Vec<Tetrahedron> = tetrahedra.iter().map(|it| it.map(relative)).collect();
        for axis in 0..3 {
            parts = clip(&parts, axis, 0.0, 1.0);
            parts = clip(&parts, axis, f64::from(cube.side), -1.0);
        }
        let mut sum = Coverage::default();
        for [a, b, c, d] in parts {
            let [u, v, w] = [b, c, d].map(|p| [0, 1, 2].map(|i| p[i] - a[i]));
            let volume = dot(u, cross(v, w)).abs() / 6.0;
            sum.volume += volume;
            for axis in 0..3 {
                sum.moments[axis] += volume * (a[axis] + b[axis] + c[axis] + d[axis]) / 4.0;
            }
        }
        sum
    }

    fn found(list: &FaceList, cube: &Cube) -> Coverage {
        let mut sums = CoverageSums::new(*cube);
        list.each(&mut |face| {
            sums.add_face(face);
            Ok(())
        })
        .unwrap();
        sums.coverage(is_inside(list, cube.min))
    }

    /// Whether a cell's minimum corner is inside, computed from outside.
    fn is_inside(list: &FaceList, corner: [i32; 3]) -> bool {
        // (The root's minimum corner is on no face, and the perturbation crosses none.)
        let Some(line) = Line::between_corners(list.grid(), [0; 3], corner) else { return false };
        let mut winding = 0;
        for number in 0..list.len() as usize {
            let crossing = line.crossing(&list.get(number));
            winding += crossing.map_or(0, |crossing| if crossing.is_entry { 1 } else { -1 });
        }
        assert!((0..=1).contains(&winding), "{winding}");
        winding == 1
    }

    fn assert_near(found: &Coverage, expected: &Coverage, cube: &Cube, tolerance: f64) {
        let side = f64::from(cube.side);
        let errors = [0, 1, 2].map(|i| (found.moments[i] - expected.moments[i]) / side.powi(4));
        let error = (found.volume - expected.volume) / side.powi(3);
        let most = errors.iter().fold(error.abs(), |most, error| most.max(error.abs()));
        assert!(most < tolerance, "{cube:?}: {found:?}, not {expected:?}");
    }

    #[test]
    fn boxes_cover_cells_as_boxes_do() {
        let list = Body::new(5).with(cuboid([3, 4, 5], [20, 9, 31], false)).list();
        let mut random = Random(1);
        for _ in 0..3000 {
            let cube = Cube { min: random.point(32), side: 1 << random.below(5) };
            let overlap = [0, 1, 2].map(|axis| {
                let (low, high) = ([3, 4, 5][axis], [20, 9, 31][axis]);
                let from = f64::from(low).max(f64::from(cube.min[axis]) - 0.5);
                let to = f64::from(high).min(f64::from(cube.min[axis]) - 0.5 + f64::from(cube.side));
                (to - from).max(0.0)
            });
            let volume = overlap.iter().product::<f64>();
            let found = found(&list, &cube).volume;
            assert!(
                (found - volume).abs() < 1e-12 * f64::from(cube.side).powi(3),
                "{cube:?}: {found}, not {volume}"
            );
        }
    }

    /// Vertices on small grids: walls and edges of cells pass exactly through faces and edges, and
    /// along them.
    #[test]
    fn tetrahedra_cover_cells_as_their_parts_do() {
        let mut random = Random(2);
        for round in 0..4000 {
            let bits = [2, 3, 4, 6][round % 4];
            let corners = [0; 4].map(|_| random.point(1 << bits));
            let Some(faces) = tetrahedron(corners) else { continue };
            let list = Body::new(bits).with(faces).list();
            for _ in 0..10 {
                let cube = Cube { min: random.point(1 << bits), side: 1 << random.below(u64::from(bits)) };
                assert_near(&found(&list, &cube), &expected(&[corners], &cube), &cube, 1e-12);
            }
        }
    }

    /// In much larger bodies, cells of one grid unit are as exact as doubles allow.
    #[test]
    fn small_cells_in_large_bodies() {
        let mut random = Random(3);
        let (mut cut, side) = (0, 1 << 26);
        for _ in 0..300 {
            // A face passes near the middle of the grid's first quarter.
            let near = random.point(1 << 20).map(|at| at + (1 << 24));
            let corners = [near, [side - 1, 5, 9], [7, side - 2, 11], [3, 2, side - 3]];
            let Some(faces) = tetrahedron(corners) else { continue };
            let list = Body::new(26).with(faces).list();
            for _ in 0..10 {
                let cube = Cube {
                    min: near.map(|at| at - 1 + random.below(3) as i32),
                    side: 1 + random.below(3) as u32,
                };
                let (found, expected) = (found(&list, &cube), expected(&[corners], &cube));
                assert_near(&found, &expected, &cube, 1e-6);
                cut += usize::from(found.volume > 0.0);
            }
        }
        assert!(cut > 300, "{cut}");
    }

    #[test]
    fn eight_children_are_their_parent() {
        let mut random = Random(4);
        let mut body = Body::new(10).with(cuboid([10; 3], [700, 300, 900], false));
        body = body.with(cuboid([20; 3], [50, 90, 444], true));
        for i in 0..5 {
            // Cavities in layers, so that they are disjoint.
            let corners = [0; 4]
                .map(|_| random.point(200))
                .map(|p| [p[0] + 150, p[1] % 190 + 100, p[2] / 8 + 40 * i + 460]);
            if let Some(mut faces) = tetrahedron(corners) {
                faces.iter_mut().flatten().for_each(|ring| ring.reverse());
                body = body.with(faces);
            }
        }
        let list = body.list();
        let mut cells = vec![Cube { min: [0; 3], side: 1024 }];
        for _ in 0..4 {
            let mut next = Vec::new();
            for cube in &cells {
                let half = cube.side / 2;
                let children = (0..8).map(|child| Cube {
                    min: [0, 1, 2].map(|axis| cube.min[axis] + half as i32 * (child >> axis & 1)),
                    side: half,
                });
                let children: Vec<Cube> = children.collect();
                let mut sum = Coverage::default();
                for child in &children {
                    let part = found(&list, child);
                    let side = f64::from(half);
                    assert!(part.volume > -1e-6 && part.volume < side.powi(3) + 1e-6, "{child:?} {part:?}");
                    sum.volume += part.volume;
                    for axis in 0..3 {
                        let shift = f64::from(child.min[axis] - cube.min[axis]);
                        sum.moments[axis] += part.moments[axis] + shift * part.volume;
                    }
                }
                assert_near(&sum, &found(&list, cube), cube, 1e-12);
                next.extend(children);
            }
            cells = next.into_iter().filter(|_| random.below(3) == 0).collect();
        }
        let whole = found(&list, &Cube { min: [0; 3], side: 1024 });
        let mass = MassProperties::of(&list, &()).unwrap();
        assert!((whole.volume / mass.volume - 1.0).abs() < 1e-13);
        let centre = mass.centre.unwrap();
        for (moment, centre) in whole.moments.iter().zip(centre) {
            assert!((moment / whole.volume - 0.5 - centre).abs() < 1e-9);
        }
    }
}
