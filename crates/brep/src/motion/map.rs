//! Affine maps of the world, and what of them grids can do exactly.

use spinney_base::{Error, Result};

/// An affine map of the world that can be undone.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    rows: [[f64; 4]; 3],
}

/// A change of size that is the same in all directions, with axes that stay axes.
pub(super) struct Symmetry {
    /// The factor of all lengths.
    pub(super) scale: f64,
    /// The axis that each of the new ones was.
    pub(super) from: [usize; 3],
    /// Whether it is turned round.
    pub(super) mirrored: [bool; 3],
}

/// Share of a number that turns make of nothing: sines and cosines of a chain of turns, each of which is rounded to 2^-53, about a hundred times that.
const NOISE: f64 = 1e-14;

impl Motion {
    /// The map with these rows of a 3x4 matrix: new x, y, z from old x, y, z, 1.
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
    /// If it flattens space, or has numbers that are not finite.
    pub fn from_rows(rows: [[f64; 4]; 3]) -> Result<Motion> {
        // (No zero has a sign.)
        let motion = Motion { rows: rows.map(|row| row.map(|number| number + 0.0)) };
        let determinant = motion.determinant();
        match rows.as_flattened().iter().all(|number| number.is_finite()) && determinant.is_normal() {
            true => Ok(motion),
            false => Err(Error::invalid(
                "affine map",
                format!("{rows:?}"),
                "finite numbers, and one that can be undone",
            )),
        }
    }

    /// The rows of the 3x4 matrix.
    pub fn to_rows(&self) -> [[f64; 4]; 3] {
        self.rows
    }

    /// The image of a point.
    pub fn apply(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        self.rows.map(|[a, b, c, d]| a * x + b * y + c * z + d)
    }

    /// The shift, which is added in the end.
    pub(super) fn shift(&self) -> [f64; 3] {
        self.rows.map(|row| row[3])
    }

    /// Whether it makes left hands of right ones.
    pub(super) fn is_mirrored(&self) -> bool {
        self.determinant() < 0.0
    }

    /// The most that lengths grow by, or somewhat more.
    pub(super) fn growth(&self) -> f64 {
        let sizes = self.rows.map(|[a, b, c, _]| [a.abs(), b.abs(), c.abs()]);
        let of_rows = sizes.map(|row| row.iter().sum::<f64>()).into_iter().fold(0.0, f64::max);
        let of_columns = [0, 1, 2].map(|axis| sizes.iter().map(|row| row[axis]).sum::<f64>());
        of_rows.sqrt() * of_columns.into_iter().fold(0.0, f64::max).sqrt()
    }

    /// The factor of volumes, by the cube of the greatest number.
    fn determinant(&self) -> f64 {
        let sizes = self.rows.iter().flat_map(|row| row[..3].iter().map(|number| number.abs()));
        let most = sizes.fold(0.0, f64::max);
        let [a, b, c] = self.rows.map(|[x, y, z, _]| [x / most, y / most, z / most]);
        crate::exact::vector::dot(a, crate::exact::vector::cross(b, c))
    }

    /// The symmetry that the map is but for a shift; `None` if it is none.
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
            assert!(error.to_string().contains("can be undone"), "{error}");
        }
        let tiny = [x, y, z].map(|row| row.map(|number: f64| number * 1e-200));
        assert!(!Motion::from_rows(tiny).unwrap().is_mirrored());
        assert!(Motion::from_rows([y, x, z]).unwrap().is_mirrored());
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
