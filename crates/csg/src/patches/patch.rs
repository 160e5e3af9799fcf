//! Bezier patches and their boundary curves: points, bounds of derivatives, and the flux through
//! them.

use crate::syntax::At;

/// A point or vector.
pub(crate) type Point = [f64; 3];

/// A boundary curve of a patch: the control points of a Bezier curve.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Curve {
    pub(crate) points: Vec<Point>,
}

impl Curve {
    /// Whether the curve is a single point: the pole of a patch.
    pub(crate) fn is_point(&self) -> bool {
        self.points.iter().all(|point| *point == self.points[0])
    }

    /// Returns the curve in the opposite direction.
    pub(crate) fn reversed(&self) -> Curve {
        Curve { points: self.points.iter().rev().copied().collect() }
    }

    /// Returns the first and last point.
    pub(crate) fn ends(&self) -> [Point; 2] {
        [self.points[0], self.points[self.points.len() - 1]]
    }

    /// Returns the bits of the coordinates, which identify the curve and its direction.
    pub(crate) fn key(&self) -> Vec<[u64; 3]> {
        self.points.iter().map(|point| point.map(f64::to_bits)).collect()
    }

    /// Returns the point at a parameter from 0 to 1.
    pub(crate) fn at(&self, t: f64) -> Point {
        casteljau(self.points.clone(), t)
    }

    /// Returns a bound of the length of the second derivative.
    pub(crate) fn second(&self) -> f64 {
        let degree = self.points.len() - 1;
        let longest = self.points.windows(3).map(|at| length(second_difference(at[0], at[1], at[2])));
        (degree * (degree - 1)) as f64 * longest.fold(0.0, f64::max)
    }
}

/// A tensor product Bezier patch with the same degree in both parameters, u and v, from 0 to 1: 2
/// (biquadratic) or 3 (bicubic).
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    degree: usize,
    /// Control points, u fastest.
    points: Vec<Point>,
    /// Its position in the text.
    pub(crate) at: At,
}

/// Bounds of the lengths of a patch's derivatives, named by their parameters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Derivatives {
    pub(crate) uu: f64,
    pub(crate) uv: f64,
    pub(crate) vv: f64,
    pub(crate) uuv: f64,
    pub(crate) uvv: f64,
}

/// Nodes and weights of the Gauss-Legendre quadrature with 5 nodes, on the interval from 0 to 1. It
/// is exact for polynomials up to degree 9.
pub(super) fn quadrature() -> [(f64, f64); 5] {
    let root = (10.0f64 / 7.0).sqrt();
    let [near, far] = [(5.0 - 2.0 * root).sqrt() / 3.0, (5.0 + 2.0 * root).sqrt() / 3.0];
    let weight = |sign: f64| (322.0 + sign * 13.0 * 70.0f64.sqrt()) / 900.0;
    [
        (-far, weight(-1.0)),
        (-near, weight(1.0)),
        (0.0, 128.0 / 225.0),
        (near, weight(1.0)),
        (far, weight(-1.0)),
    ]
    .map(|(node, weight)| ((node + 1.0) / 2.0, weight / 2.0))
}

impl Patch {
    /// Creates a patch of 9 or 16 control points, row by row; `None` for other numbers of points.
    pub(crate) fn new(points: Vec<Point>, at: At) -> Option<Patch> {
        let degree = match points.len() {
            9 => 2,
            16 => 3,
            _ => return None,
        };
        // (Control points that are compared bit by bit must have one zero.)
        let points = points.into_iter().map(|point| point.map(|at| at + 0.0)).collect();
        Some(Patch { degree, points, at })
    }

    /// Returns the control points.
    pub(crate) fn points(&self) -> &[Point] {
        &self.points
    }

    /// Returns the boundary curve of a side, counterclockwise in the parameters: v = 0, u = 1,
    /// v = 1, u = 0.
    pub(crate) fn boundary(&self, side: usize) -> Curve {
        let (last, row) = (self.degree, self.degree + 1);
        let index = |along: usize| match side {
            0 => along,
            1 => along * row + last,
            2 => last * row + (last - along),
            _ => (last - along) * row,
        };
        Curve { points: (0..=last).map(|along| self.points[index(along)]).collect() }
    }

    /// Returns the point at parameters.
    pub(crate) fn at(&self, u: f64, v: f64) -> Point {
        let rows = self.points.chunks(self.degree + 1).map(|row| casteljau(row.to_vec(), u));
        casteljau(rows.collect(), v)
    }

    /// Returns the two halves of the patch in u.
    fn halves(&self) -> [Patch; 2] {
        let rows: Vec<[Vec<Point>; 2]> = self.points.chunks(self.degree + 1).map(halves).collect();
        [0, 1].map(|half| Patch {
            points: rows.iter().flat_map(|row| row[half].iter().copied()).collect(),
            ..*self
        })
    }

    /// Returns the patch with its parameters exchanged.
    fn transposed(&self) -> Patch {
        let row = self.degree + 1;
        let points = (0..row * row).map(|at| self.points[at % row * row + at / row]).collect();
        Patch { points, ..*self }
    }

    /// Returns points around the patch: the control points of its parts after a number of divisions
    /// into quarters. With each division, the distance of their hull falls to about a quarter.
    pub(crate) fn hull(&self, divisions: u32) -> Vec<Point> {
        let mut parts = vec![self.clone()];
        for _ in 0..2 * divisions {
            parts = parts.iter().flat_map(|part| part.transposed().halves()).collect();
        }
        parts.into_iter().flat_map(|part| part.points).collect()
    }

    /// Returns the control points of the derivative in a parameter, without the degree's factor:
    /// the differences of neighbours. `size` has the numbers of points in u and v, and is updated.
    fn differences(points: &[Point], size: &mut [usize; 2], axis: usize) -> Vec<Point> {
        let [columns, _] = *size;
        let step = if axis == 0 { 1 } else { columns };
        size[axis] -= 1;
        let [width, height] = *size;
        let index = (0..height).flat_map(|v| (0..width).map(move |u| v * columns + u));
        index.map(|at| minus(points[at + step], points[at])).collect()
    }

    /// Returns a bound of the length of the derivative in a sequence of parameters (0 for u, 1 for
    /// v). It is the largest control point of the derivative, which is a Bezier patch, too.
    fn bound(&self, axes: &[usize]) -> f64 {
        let (mut points, mut size, mut factor) = (self.points.clone(), [self.degree + 1; 2], 1);
        for axis in axes {
            factor *= size[*axis] - 1;
            points = Patch::differences(&points, &mut size, *axis);
        }
        factor as f64 * points.into_iter().map(length).fold(0.0, f64::max)
    }

    /// Returns bounds of the derivatives that bound the distance of facets.
    pub(crate) fn derivatives(&self) -> Derivatives {
        Derivatives {
            uu: self.bound(&[0, 0]),
            uv: self.bound(&[0, 1]),
            vv: self.bound(&[1, 1]),
            uuv: self.bound(&[0, 0, 1]),
            uvv: self.bound(&[0, 1, 1]),
        }
    }

    /// Returns the flux of the field (x - `origin`) / 3 through the patch, which is exact except
    /// for rounding: the field times the normal has degree 3 n - 1 <= 8 in each parameter. The sum
    /// over a closed surface is the volume that it encloses.
    pub(crate) fn flux(&self, origin: Point) -> f64 {
        let side = self.degree + 1;
        let along = |axis| {
            let mut size = [side; 2];
            (Patch::differences(&self.points, &mut size, axis), size[0])
        };
        let ([(in_u, width_u), (in_v, width_v)], degree) = ([along(0), along(1)], self.degree as f64);
        let value = |points: &[Point], width: usize, u: f64, v: f64| {
            casteljau(points.chunks(width).map(|row| casteljau(row.to_vec(), u)).collect(), v)
        };
        let nodes = quadrature();
        let mut sum = 0.0;
        for (u, weight_u) in nodes {
            for (v, weight_v) in nodes {
                let [x, y, z] = minus(self.at(u, v), origin);
                let [a, b, c] = value(&in_u, width_u, u, v);
                let [d, e, f] = value(&in_v, width_v, u, v);
                let product = x * (b * f - c * e) + y * (c * d - a * f) + z * (a * e - b * d);
                sum += weight_u * weight_v * product;
            }
        }
        sum * degree * degree / 3.0
    }
}

fn minus(a: Point, b: Point) -> Point {
    [0, 1, 2].map(|axis| a[axis] - b[axis])
}

fn second_difference(a: Point, b: Point, c: Point) -> Point {
    [0, 1, 2].map(|axis| a[axis] - 2.0 * b[axis] + c[axis])
}

fn length([x, y, z]: Point) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// Divides a Bezier curve at the parameter 1/2 by de Casteljau's algorithm.
fn halves(points: &[Point]) -> [Vec<Point>; 2] {
    let mut points = points.to_vec();
    let (mut left, mut right) = (vec![points[0]], vec![points[points.len() - 1]]);
    for last in (1..points.len()).rev() {
        for index in 0..last {
            let (from, to) = (points[index], points[index + 1]);
            points[index] = [0, 1, 2].map(|axis| from[axis] / 2.0 + to[axis] / 2.0);
        }
        left.push(points[0]);
        right.push(points[last - 1]);
    }
    right.reverse();
    [left, right]
}

/// Evaluates a Bezier curve by de Casteljau's algorithm.
fn casteljau(mut points: Vec<Point>, t: f64) -> Point {
    for last in (1..points.len()).rev() {
        for index in 0..last {
            let (from, to) = (points[index], points[index + 1]);
            points[index] = [0, 1, 2].map(|axis| (1.0 - t) * from[axis] + t * to[axis]);
        }
    }
    points[0]
}
