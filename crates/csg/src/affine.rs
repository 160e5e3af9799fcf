//! Affine transforms of 3D space.

/// An affine transform: three matrix rows, each with its translation in the last column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Affine {
    pub(crate) rows: [[f64; 4]; 3],
}

/// Maximum magnitude of numbers in CSG text and in transforms. Squares of products of such numbers
/// do not overflow.
pub(crate) const MAX_NUMBER: f64 = 1e30;

impl Affine {
    /// The identity transform.
    pub(crate) const IDENTITY: Affine =
        Affine { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] };

    /// Returns a translation.
    pub(crate) fn translation(by: [f64; 3]) -> Affine {
        let mut map = Affine::IDENTITY;
        (0..3).for_each(|axis| map.rows[axis][3] = by[axis]);
        map
    }

    /// Returns a scaling along the axes.
    pub(crate) fn scale(by: [f64; 3]) -> Affine {
        let mut map = Affine::IDENTITY;
        (0..3).for_each(|axis| map.rows[axis][axis] = by[axis]);
        map
    }

    /// Returns a rotation about an axis through the origin, counterclockwise as seen from the
    /// axis's tip.
    pub(crate) fn rotation(axis: [f64; 3], degrees: f64) -> Affine {
        let [x, y, z] = unit(axis);
        // (Quarter turns are exact.)
        let (sin, cos) = match degrees.rem_euclid(360.0) {
            0.0 => (0.0, 1.0),
            90.0 => (1.0, 0.0),
            180.0 => (0.0, -1.0),
            270.0 => (-1.0, 0.0),
            degrees => degrees.to_radians().sin_cos(),
        };
        let rest = 1.0 - cos;
        Affine {
            rows: [
                [cos + x * x * rest, x * y * rest - z * sin, x * z * rest + y * sin, 0.0],
                [y * x * rest + z * sin, cos + y * y * rest, y * z * rest - x * sin, 0.0],
                [z * x * rest - y * sin, z * y * rest + x * sin, cos + z * z * rest, 0.0],
            ],
        }
    }

    /// Returns a reflection in the plane through the origin with a normal.
    pub(crate) fn mirror(normal: [f64; 3]) -> Affine {
        let normal = unit(normal);
        let mut map = Affine::IDENTITY;
        for row in 0..3 {
            for column in 0..3 {
                map.rows[row][column] -= 2.0 * normal[row] * normal[column];
            }
        }
        map
    }

    /// Returns an isometry that takes the origin to a point and the z axis to a direction.
    pub(crate) fn frame(origin: [f64; 3], direction: [f64; 3]) -> Affine {
        let w = unit(direction);
        // The coordinate axis that is farthest from the direction. For a direction along an axis,
        // the result is exact.
        let least = (0..3).min_by(|a, b| w[*a].abs().total_cmp(&w[*b].abs())).unwrap_or(0);
        let mut other = [0.0; 3];
        other[least] = 1.0;
        let u = unit(cross(other, w));
        let v = cross(w, u);
        Affine { rows: std::array::from_fn(|row| [u[row], v[row], w[row], origin[row]]) }
    }

    /// Returns the image of a point. (Rows of samples compute it in the same order: see
    /// [`Affine::at`].)
    pub(crate) fn apply(&self, point: [f64; 3]) -> [f64; 3] {
        let base = self.at(point[1], point[2]);
        [0, 1, 2].map(|row| self.rows[row][0] * point[0] + base[row])
    }

    /// Returns the image of the point `(0, y, z)`: the terms that do not depend on x.
    pub(crate) fn at(&self, y: f64, z: f64) -> [f64; 3] {
        self.rows.map(|[_, b, c, d]| b * y + c * z + d)
    }

    /// Returns the transform that applies `first`, then this one.
    pub(crate) fn after(&self, first: &Affine) -> Affine {
        let entry = |row: usize, column: usize| {
            let sum: f64 = (0..3).map(|k| self.rows[row][k] * first.rows[k][column]).sum();
            if column == 3 { sum + self.rows[row][3] } else { sum }
        };
        Affine { rows: std::array::from_fn(|row| std::array::from_fn(|column| entry(row, column))) }
    }

    /// Returns the determinant of the linear part.
    pub(crate) fn determinant(&self) -> f64 {
        let [a, b, c] = self.rows.map(|[x, y, z, _]| [x, y, z]);
        dot(a, cross(b, c))
    }

    /// Returns the inverse, or `None` if there is none with numbers within bounds.
    pub(crate) fn inverse(&self) -> Option<Affine> {
        let [a, b, c] = self.rows.map(|[x, y, z, _]| [x, y, z]);
        let determinant = self.determinant();
        if !determinant.is_normal() {
            return None;
        }
        let columns = [cross(b, c), cross(c, a), cross(a, b)];
        let rows: [[f64; 3]; 3] = std::array::from_fn(|row| columns.map(|column| column[row] / determinant));
        let shift = self.rows.map(|row| row[3]);
        let inverse = Affine { rows: rows.map(|row @ [x, y, z]| [x, y, z, 0.0 - dot(row, shift)]) };
        inverse.is_bounded().then_some(inverse)
    }

    /// Whether all numbers are finite and within the allowed magnitude.
    pub(crate) fn is_bounded(&self) -> bool {
        self.rows.iter().flatten().all(|number| number.abs() <= MAX_NUMBER)
    }

    /// Returns the maximum factor by which the transform stretches a length.
    pub(crate) fn stretch(&self) -> f64 {
        // Square root of the largest eigenvalue of the symmetric matrix MᵀM, computed from its
        // characteristic polynomial.
        let column = |column: usize| self.rows.map(|row| row[column]);
        let entry = |i: usize, j: usize| dot(column(i), column(j));
        let mean = (entry(0, 0) + entry(1, 1) + entry(2, 2)) / 3.0;
        let off = entry(0, 1).powi(2) + entry(0, 2).powi(2) + entry(1, 2).powi(2);
        let spread = (0..3).map(|i| (entry(i, i) - mean).powi(2)).sum::<f64>() + 2.0 * off;
        let p = (spread / 6.0).sqrt();
        if p <= mean * 1e-12 {
            return mean.sqrt();
        }
        let part = |i: usize, j: usize| (entry(i, j) - if i == j { mean } else { 0.0 }) / p;
        let rows: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| part(i, j)));
        let half = (dot(rows[0], cross(rows[1], rows[2])) / 2.0).clamp(-1.0, 1.0);
        (mean + 2.0 * p * (half.acos() / 3.0).cos()).sqrt()
    }
}

/// Normalizes a direction to length 1.
fn unit(direction: [f64; 3]) -> [f64; 3] {
    // (Scaled by its largest component first, because squares of tiny numbers underflow.)
    let most = direction.iter().fold(0.0, |most: f64, part| most.max(part.abs()));
    let direction = direction.map(|part| part / most);
    let length = dot(direction, direction).sqrt();
    direction.map(|part| part / length)
}

/// Returns the scalar product.
pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the vector product.
fn cross([a, b, c]: [f64; 3], [x, y, z]: [f64; 3]) -> [f64; 3] {
    [b * z - c * y, c * x - a * z, a * y - b * x]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_have_inverses() {
        let map = Affine::rotation([1.0, 2.0, 3.0], 40.0).after(&Affine::scale([2.0, 1.0, -0.5]));
        let map = Affine::translation([5.0, -7.0, 1.0]).after(&map);
        let back = map.inverse().unwrap();
        for point in [[0.0; 3], [1.0, 2.0, 3.0], [-4.0, 0.5, 9.0]] {
            let there = back.apply(map.apply(point));
            assert!((0..3).all(|axis| (there[axis] - point[axis]).abs() < 1e-12));
        }
        assert!((map.stretch() - 2.0).abs() < 1e-12);
        assert!(Affine::scale([1.0, 0.0, 1.0]).inverse().is_none());
        assert!(Affine::scale([1e-29; 3]).inverse().is_some());
        assert!(Affine::scale([1e-31; 3]).inverse().is_none());
    }

    #[test]
    fn quarters_and_axes_are_exact() {
        let turned = Affine::rotation([0.0, 0.0, 5.0], 450.0).apply([1.0, 2.0, 3.0]);
        assert_eq!(turned, [-2.0, 1.0, 3.0]);
        assert_eq!(Affine::mirror([0.0, 2.0, 0.0]).apply([1.0, 2.0, 3.0]), [1.0, -2.0, 3.0]);
        for axis in 0..3 {
            let mut direction = [0.0; 3];
            direction[axis] = 7.0;
            let frame = Affine::frame([1.0; 3], direction);
            assert_eq!(frame.determinant(), 1.0);
            assert!(frame.rows.iter().flatten().all(|entry| [0.0, 1.0, -1.0].contains(entry)));
        }
    }
}
