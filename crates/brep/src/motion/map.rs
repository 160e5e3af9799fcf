//! Affine maps of the world, and their decomposition into the exact part and the rest.

use crate::exact::vector::{cross, dot};
use spinney_base::{Error, Result};

/// An invertible affine map of the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    rows: [[f64; 4]; 3],
}

/// A uniform scaling combined with a signed permutation of the axes.
pub(super) struct Symmetry {
    /// The factor of all lengths.
    pub(super) scale: f64,
    /// The old axis of each new axis.
    pub(super) from: [usize; 3],
    /// Whether the axis is mirrored.
    pub(super) mirrored: [bool; 3],
}

/// Relative size of rounding noise: the sines and cosines of a chain of rotations, each rounded to
/// 2^-53, have about a hundred times that error.
const NOISE: f64 = 1e-14;

impl Motion {
    /// Returns the identity map.
    pub(super) fn identity() -> Motion {
        Motion { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] }
    }

    /// Creates the map with these rows of a 3x4 matrix: new x, y, z from old x, y, z, 1.
    ///
    /// ```
    /// use spinney::brep::Motion;
    ///
    /// let turn = Motion::from_rows([[0.0, -1.0, 0.0, 5.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])?;
    /// assert_eq!(turn.apply([2.0, 3.0, 4.0]), [2.0, 2.0, 4.0]);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the map is singular, or has numbers that are not finite.
    pub fn from_rows(rows: [[f64; 4]; 3]) -> Result<Motion> {
        // (Replaces negative zeros.)
        let motion = Motion { rows: rows.map(|row| row.map(|number| number + 0.0)) };
        let determinant = motion.determinant();
        match rows.as_flattened().iter().all(|number| number.is_finite()) && determinant.is_normal() {
            true => Ok(motion),
            false => Err(Error::invalid(
                "affine map",
                format!("{rows:?}"),
                "finite numbers, and an invertible map",
            )),
        }
    }

    /// Returns the rows of the 3x4 matrix.
    pub fn to_rows(&self) -> [[f64; 4]; 3] {
        self.rows
    }

    /// Maps a point.
    pub fn apply(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        self.rows.map(|[a, b, c, d]| a * x + b * y + c * z + d)
    }

    /// Maps a vector, without the shift.
    pub(super) fn turn(&self, way: [f64; 3]) -> [f64; 3] {
        self.rows.map(|[a, b, c, _]| a * way[0] + b * way[1] + c * way[2] + 0.0)
    }

    /// Maps a vector by the transposed matrix.
    pub(super) fn turn_transposed(&self, way: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.rows;
        [0, 1, 2].map(|axis| x[axis] * way[0] + y[axis] * way[1] + z[axis] * way[2] + 0.0)
    }

    /// Maps the second moments about a centre; the volume factor is not included.
    pub(super) fn tensor(&self, own: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
        let ways = [0, 1, 2].map(|column| self.turn([own[0][column], own[1][column], own[2][column]]));
        [0, 1, 2].map(|row| self.turn([ways[0][row], ways[1][row], ways[2][row]]))
    }

    /// Returns the inverse map.
    ///
    /// # Errors
    /// If its numbers are outside of the doubles' range.
    pub(super) fn inverse(&self) -> Result<Motion> {
        let most = self.max_coefficient();
        let [a, b, c] = self.rows.map(|[x, y, z, _]| [x / most, y / most, z / most]);
        let determinant = dot(a, cross(b, c));
        let columns = [cross(b, c), cross(c, a), cross(a, b)];
        let rows = [0, 1, 2].map(|row| {
            let [x, y, z] = columns.map(|column| column[row] / determinant / most);
            [x, y, z, -dot([x, y, z], self.shift())]
        });
        Motion::from_rows(rows)
    }

    /// Returns the factor of volumes.
    pub(super) fn volume_factor(&self) -> f64 {
        self.determinant().abs() * self.max_coefficient().powi(3)
    }

    /// Returns the factor of all lengths, or `None` if it depends on the direction.
    pub(super) fn factor(&self) -> Option<f64> {
        let most = self.max_coefficient();
        let columns = [0, 1, 2].map(|column| self.rows.map(|row| row[column] / most));
        let square = dot(columns[0], columns[0]);
        let is_near = |a: usize, b: usize| {
            let expected = if a == b { square } else { 0.0 };
            (dot(columns[a], columns[b]) - expected).abs() <= 4.0 * NOISE * square
        };
        (0..3).all(|a| (0..=a).all(|b| is_near(a, b))).then(|| most * square.sqrt())
    }

    /// Returns whether it is the identity.
    pub(super) fn is_identity(&self) -> bool {
        (0..3).all(|row| (0..4).all(|column| self.rows[row][column] == f64::from(u8::from(row == column))))
    }

    /// Splits the map into a scaling with a shift, followed by a signed permutation of the axes.
    /// Returns `None` if there is no such decomposition.
    pub(super) fn split(&self) -> Option<(Motion, Motion)> {
        let Symmetry { scale, from, mirrored } = self.symmetry()?;
        let (mut sized, mut turned) = ([[0.0; 4]; 3], [[0.0; 4]; 3]);
        for (to, axis) in from.into_iter().enumerate() {
            let sign = if mirrored[to] { -1.0 } else { 1.0 };
            turned[to][axis] = sign;
            sized[axis][axis] = scale;
            sized[axis][3] = sign * self.rows[to][3] + 0.0;
        }
        Some((Motion { rows: sized }, Motion { rows: turned }))
    }

    /// Returns the map without rounding noise of quarter turns.
    pub(super) fn without_noise(&self) -> Motion {
        let Some((sized, turned)) = self.split() else { return self.clone() };
        let rows = [0, 1, 2].map(|row| {
            let [x, y, z, _] = turned.rows[row];
            [x * sized.rows[0][0], y * sized.rows[1][1], z * sized.rows[2][2], self.rows[row][3]]
        });
        Motion { rows: rows.map(|row| row.map(|number| number + 0.0)) }
    }

    /// Returns the shift, which is added last.
    pub(super) fn shift(&self) -> [f64; 3] {
        self.rows.map(|row| row[3])
    }

    /// Returns whether it changes the handedness.
    pub(super) fn is_mirrored(&self) -> bool {
        self.determinant() < 0.0
    }

    /// Returns an upper bound of the growth of lengths.
    pub(super) fn growth(&self) -> f64 {
        let sizes = self.rows.map(|[a, b, c, _]| [a.abs(), b.abs(), c.abs()]);
        let of_rows = sizes.map(|row| row.iter().sum::<f64>()).into_iter().fold(0.0, f64::max);
        let of_columns = [0, 1, 2].map(|axis| sizes.iter().map(|row| row[axis]).sum::<f64>());
        of_rows.sqrt() * of_columns.into_iter().fold(0.0, f64::max).sqrt()
    }

    /// Returns the volume factor, divided by the cube of the largest coefficient.
    fn determinant(&self) -> f64 {
        let most = self.max_coefficient();
        let [a, b, c] = self.rows.map(|[x, y, z, _]| [x / most, y / most, z / most]);
        dot(a, cross(b, c))
    }

    /// Returns the magnitude of the largest coefficient, without the shift.
    fn max_coefficient(&self) -> f64 {
        let sizes = self.rows.iter().flat_map(|row| row[..3].iter().map(|number| number.abs()));
        sizes.fold(0.0, f64::max)
    }

    /// Returns the map, without its shift, as a symmetry; `None` if it is not one.
    pub(super) fn symmetry(&self) -> Option<Symmetry> {
        let mut found = Symmetry { scale: 0.0, from: [0; 3], mirrored: [false; 3] };
        for (to, row) in self.rows.iter().enumerate() {
            let from = (0..3).max_by(|a, b| row[*a].abs().total_cmp(&row[*b].abs()))?;
            let size = row[from].abs();
            let is_alone = (0..3).all(|axis| axis == from || row[axis].abs() <= size * NOISE);
            let is_as_long = to == 0 || (size - found.scale).abs() <= size * NOISE;
            if !is_alone || !is_as_long || found.from[..to].contains(&from) {
                return None;
            }
            found.scale = if to == 0 { size } else { found.scale };
            (found.from[to], found.mirrored[to]) = (from, row[from] < 0.0);
        }
        if (found.scale - 1.0).abs() <= NOISE {
            found.scale = 1.0;
        }
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_undone_is_refused() {
        let [x, y, z] = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        for rows in
            [[x, y, [0.0; 4]], [x, x, z], [x, y, [f64::NAN; 4]], [x, y, [0.0, 0.0, 1.0, f64::INFINITY]]]
        {
            let error = Motion::from_rows(rows).unwrap_err();
            assert!(error.to_string().contains("an invertible map"), "{error}");
        }
        let tiny = [x, y, z].map(|row| row.map(|number: f64| number * 1e-200));
        assert!(!Motion::from_rows(tiny).unwrap().is_mirrored());
        assert!(Motion::from_rows([y, x, z]).unwrap().is_mirrored());
    }

    #[test]
    fn maps_are_undone_and_split() {
        let rows = [[0.0, -2.5, 0.0, 5.0], [0.0, 0.0, 2.5, -1.0], [-2.5, 0.0, 0.0, 3.0]];
        let map = Motion::from_rows(rows).unwrap();
        let (sized, turned) = map.split().unwrap();
        let point = [1.0, -2.0, 0.25];
        assert_eq!(turned.apply(sized.apply(point)), map.apply(point));
        assert_eq!(
            (sized.shift(), map.factor(), map.volume_factor()),
            ([-3.0, -5.0, -1.0], Some(2.5), 15.625)
        );
        assert_eq!(turned.inverse().unwrap().apply(turned.apply(point)), point);
        assert!(!turned.is_identity() && turned.inverse().unwrap().inverse().unwrap() == turned);
        let sheared =
            Motion::from_rows([[2.0, 1.0, 0.0, 7.0], [0.0, 0.5, 0.0, 0.0], [1.0, 0.0, 1.0, 0.0]]).unwrap();
        assert!(sheared.factor().is_none() && sheared.split().is_none());
        let [there, back] = [sheared.apply(point), sheared.inverse().unwrap().apply(sheared.apply(point))];
        assert!((0..3).all(|axis| (back[axis] - point[axis]).abs() < 1e-14), "{there:?} {back:?}");
        // A tensor of a vector's products is mapped like the vector.
        let (a, b) = ([1.0, 2.0, 3.0], sheared.turn([1.0, 2.0, 3.0]));
        let product = |way: [f64; 3]| way.map(|row| way.map(|column| row * column));
        assert_eq!(sheared.tensor(&product(a)), product(b));
        let [x, y] = [[0.3, -0.7, 0.1], [2.0, 0.0, -1.0]];
        assert!((dot(sheared.turn(x), y) - dot(x, sheared.turn_transposed(y))).abs() < 1e-15);
    }

    #[test]
    fn symmetries_are_known_but_for_noise() {
        let (sin, cos) = 45f64.to_radians().sin_cos();
        let [x, y] = [[cos * cos - sin * sin, -2.0 * sin * cos], [2.0 * sin * cos, cos * cos - sin * sin]];
        let rows = [[x[0], x[1], 0.0, 7.0], [y[0], y[1], 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let found = Motion::from_rows(rows).unwrap().symmetry().unwrap();
        assert_eq!((found.scale, found.from, found.mirrored), (1.0, [1, 0, 2], [true, false, false]));
        let uneven = [[2.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, 2.000001, 0.0]];
        assert!(Motion::from_rows(uneven).unwrap().symmetry().is_none());
        let turn = [[cos, -sin, 0.0, 0.0], [sin, cos, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let turn = Motion::from_rows(turn).unwrap();
        assert!(turn.symmetry().is_none() && (1.0..1.5).contains(&turn.growth()));
    }
}
