//! Affine maps of cell coordinates: windows, scalings, rotations and their chains.

use glam::{DAffine3, DMat3, DVec3};

use super::view::TINY;
use spinney_base::{Error, Result};

/// Affine map of the space of cells. Cell (0, 0, 0) spans 0..1 on every axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AffineMap(pub(super) DAffine3);

/// Axis of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // names are self-explanatory
pub enum Axis {
    X,
    Y,
    Z,
}

impl AffineMap {
    /// Identity map.
    pub const IDENTITY: AffineMap = AffineMap(DAffine3::IDENTITY);

    /// Translation by a number of cells along each axis.
    pub fn translation(by: [f64; 3]) -> AffineMap {
        AffineMap(DAffine3::from_translation(DVec3::from(by)))
    }

    /// Scaling by a factor per axis about the origin; a negative factor mirrors.
    pub fn scaling(by: [f64; 3]) -> AffineMap {
        AffineMap(DAffine3::from_scale(DVec3::from(by)))
    }

    /// Rotation about an axis through `centre`. Positive angles turn x to y, y to z or z to x: in
    /// rasters, whose rows go down, clockwise about [`Axis::Z`]. Multiples of 90 degrees are exact.
    pub fn rotation(axis: Axis, degrees: f64, centre: [f64; 3]) -> AffineMap {
        let (sin, cos) = exact_sin_cos(degrees);
        // The rotated axes, the first towards the second.
        let (from, to) = match axis {
            Axis::X => (1, 2),
            Axis::Y => (2, 0),
            Axis::Z => (0, 1),
        };
        let mut columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        (columns[from][from], columns[from][to]) = (cos, sin);
        (columns[to][from], columns[to][to]) = (-sin, cos);
        let turn = AffineMap(DAffine3::from_mat3(DMat3::from_cols_array_2d(&columns)));
        AffineMap::translation(centre.map(|number| -number)).then(&turn).then(&AffineMap::translation(centre))
    }

    /// Rotation about a line through `centre` in the direction `axis`, by the right-hand rule.
    /// Rotations that take axes to axes are exact.
    ///
    /// # Errors
    /// If the direction has no length.
    pub fn rotation_about(axis: [f64; 3], degrees: f64, centre: [f64; 3]) -> Result<AffineMap> {
        let direction = DVec3::from(axis).try_normalize();
        let direction = direction.ok_or_else(|| {
            Error::invalid(
                "axis of rotation",
                format!("{axis:?}"),
                "a direction that is not 0, such as 0,0,1",
            )
        })?;
        let turn = DAffine3::from_axis_angle(direction, degrees.rem_euclid(360.0).to_radians());
        let columns = turn.matrix3.to_cols_array_2d().map(|column| column.map(without_noise));
        let turn = AffineMap(DAffine3::from_mat3(DMat3::from_cols_array_2d(&columns)));
        Ok(AffineMap::translation(centre.map(|number| -number))
            .then(&turn)
            .then(&AffineMap::translation(centre)))
    }

    /// Symmetry that takes axis `from[0]` of the input to x, `from[1]` to y and `from[2]` to z,
    /// mirrored where `mirror` is true. All orders and mirrorings of the axes give the 48
    /// symmetries of the cube, of which 8 leave z unchanged.
    ///
    /// # Errors
    /// If an axis is missing.
    pub fn symmetry(from: [Axis; 3], mirror: [bool; 3]) -> Result<AffineMap> {
        let mut columns = [[0.0; 3]; 3];
        for (to, axis) in from.into_iter().enumerate() {
            columns[axis as usize][to] = if mirror[to] { -1.0 } else { 1.0 };
        }
        if columns.iter().any(|column| column.iter().all(|number| *number == 0.0)) {
            return Err(Error::invalid("axes", format!("{from:?}"), "each of X, Y and Z once"));
        }
        Ok(AffineMap(DAffine3::from_mat3(DMat3::from_cols_array_2d(&columns))))
    }

    /// Map with these rows of a 3x4 matrix: new x, y, z from old x, y, z, 1.
    pub fn from_rows(rows: [[f64; 4]; 3]) -> AffineMap {
        let column = |column: usize| DVec3::from(rows.map(|row| row[column]));
        let matrix = DMat3::from_cols(column(0), column(1), column(2));
        AffineMap(DAffine3::from_mat3_translation(matrix, column(3)))
    }

    /// Rows of the 3x4 matrix.
    pub fn to_rows(&self) -> [[f64; 4]; 3] {
        let columns = self.0.to_cols_array_2d();
        std::array::from_fn(|row| columns.map(|column| column[row]))
    }

    /// Composition: this map, then `next`.
    pub fn then(&self, next: &AffineMap) -> AffineMap {
        AffineMap(next.0 * self.0)
    }

    /// Inverse map.
    ///
    /// # Errors
    /// If the map is singular or not finite.
    pub fn inverse(&self) -> Result<AffineMap> {
        let inverse = self.0.inverse();
        let det = self.0.matrix3.determinant();
        if det == 0.0 || !det.is_finite() || !inverse.is_finite() {
            let found = format!("{:?}", self.to_rows());
            return Err(Error::invalid("affine map", found, "an invertible map"));
        }
        let mut inverse = AffineMap(inverse);
        if self.is_planar() {
            // (A general inverse divides by the determinant of all three axes, which may not leave
            // z exactly unchanged.)
            inverse.0.matrix3.z_axis = DVec3::Z;
            (inverse.0.matrix3.x_axis.z, inverse.0.matrix3.y_axis.z, inverse.0.translation.z) =
                (0.0, 0.0, 0.0);
        }
        Ok(inverse)
    }

    /// Whether z is unchanged, and does not affect the other axes.
    pub(super) fn is_planar(&self) -> bool {
        let rows = self.to_rows();
        rows[2] == [0.0, 0.0, 1.0, 0.0] && rows[0][2] == 0.0 && rows[1][2] == 0.0
    }

    /// Adds a translation by less than a cell, so that a box of `extent` cells at the origin is
    /// mapped to whole cells. Returns the map unchanged if axes do not map to axes. A map and its
    /// inverse get opposite translations.
    pub(in crate::ops) fn on_whole_cells(&self, extent: [u64; 3]) -> AffineMap {
        if !self.keeps_axes() {
            return *self;
        }
        let (min, _) = self.bounding_box(DVec3::ZERO, DVec3::from(extent.map(|cells| cells as f64)));
        self.then(&AffineMap::translation((min.round() - min).to_array()))
    }

    /// Image of a point.
    pub fn apply(&self, point: [f64; 3]) -> [f64; 3] {
        self.0.transform_point3(DVec3::from(point)).to_array()
    }

    /// Bounding box of the image of a box.
    #[inline]
    pub(in crate::ops) fn bounding_box(&self, min: DVec3, max: DVec3) -> (DVec3, DVec3) {
        // Maps the centre, and half the size by absolute values of the matrix. This takes far less
        // time than mapping all corners.
        let centre = self.0.transform_point3((min + max) * 0.5);
        let half = (max - min) * 0.5;
        let matrix = &self.0.matrix3;
        let half = matrix.x_axis.abs() * half.x + matrix.y_axis.abs() * half.y + matrix.z_axis.abs() * half.z;
        (centre - half, centre + half)
    }

    /// Determinant: factor of volumes (or areas), negative if the map mirrors.
    pub(in crate::ops) fn determinant(&self) -> f64 {
        self.0.matrix3.determinant()
    }

    /// Whether the map is a translation.
    pub(in crate::ops) fn is_translation(&self) -> bool {
        self.0.matrix3 == DMat3::IDENTITY
    }

    /// Whether a translation differs from one by whole cells by rounding errors only.
    pub(super) fn is_near_cells(&self) -> bool {
        let by = self.0.translation;
        (by - by.round()).abs().max_element() < TINY
    }

    /// Whether axis-aligned boxes are mapped to axis-aligned boxes.
    pub(in crate::ops) fn keeps_axes(&self) -> bool {
        let columns = self.0.matrix3.to_cols_array_2d();
        let single = |numbers: [f64; 3]| numbers.iter().filter(|number| **number != 0.0).count() == 1;
        columns.into_iter().all(single) && (0..3).all(|row| single(columns.map(|column| column[row])))
    }

    /// Whether each cell is mapped into one cell, of which it is a power-of-two fraction along each
    /// axis.
    pub(super) fn divides_cells(&self) -> bool {
        let columns = self.0.matrix3.to_cols_array_2d();
        (0..3).all(|axis| {
            let factor = columns[axis][axis];
            let is_part = factor > 0.0 && factor <= 1.0 && factor.log2().fract() == 0.0;
            let is_alone = (0..3).all(|other| other == axis || columns[axis][other] == 0.0);
            is_part && is_alone && (self.0.translation[axis] / factor).fract() == 0.0
        })
    }

    /// Factor of a map that scales the first `axes` axes equally and keeps the others, if it is a
    /// power of two; `None` for all other maps.
    pub(super) fn power_of_two(&self, axes: usize) -> Option<f64> {
        let columns = self.0.matrix3.to_cols_array_2d();
        let factor = columns[0][0];
        let is_power = factor > 0.0 && factor.is_finite() && factor.log2().fract() == 0.0;
        let is_uniform = (0..3).all(|row| {
            let diagonal = if row < axes { factor } else { 1.0 };
            (0..3).all(|column| columns[column][row] == if row == column { diagonal } else { 0.0 })
        });
        (is_power && is_uniform).then_some(factor)
    }

    /// Whether cells are mapped to cells: a symmetry and a translation by integers.
    pub(in crate::ops) fn keeps_cells(&self) -> bool {
        let columns = self.0.matrix3.to_cols_array_2d();
        self.keeps_axes()
            && columns.iter().flatten().all(|number| number.abs() == 1.0 || *number == 0.0)
            && self.0.translation == self.0.translation.round()
    }
}

/// Rounds a number that differs from an integer by rounding errors only, too little to affect even
/// the farthest cell.
fn without_noise(number: f64) -> f64 {
    if (number - number.round()).abs() < 1e-14 { number.round() } else { number }
}

/// Sine and cosine, exact for multiples of 90 degrees.
fn exact_sin_cos(degrees: f64) -> (f64, f64) {
    match degrees.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        other => other.to_radians().sin_cos(),
    }
}
