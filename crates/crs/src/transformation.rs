//! Transformations between two coordinate systems.

use crate::{Crs, Projection};
use spinney_base::Result;

/// A transformation of points from one coordinate system to another, by way of longitude and latitude in WGS 84.
pub struct Transformation {
    from: Crs,
    to: Crs,
    /// Projections of the two, where these differ.
    projections: Option<(Projection, Projection)>,
}

/// How far a point may be from where it comes back to, in degrees.
const CLOSE: f64 = 1e-6;

impl Transformation {
    /// The transformation between two systems; where they are the same, points stay as they are, however they are defined.
    ///
    /// # Errors
    /// Those of [`Projection::new`] if they differ.
    pub fn new(from: &Crs, to: &Crs, allow_ballpark: bool) -> Result<Transformation> {
        let open = |crs: &Crs| Projection::new(crs, allow_ballpark);
        let projections = if from.is_same(to) { None } else { Some((open(from)?, open(to)?)) };
        Ok(Transformation { from: from.clone(), to: to.clone(), projections })
    }

    /// The first system.
    pub fn from(&self) -> &Crs {
        &self.from
    }

    /// Whether the two systems are the same, so that points stay as they are.
    pub fn is_identity(&self) -> bool {
        self.projections.is_none()
    }

    /// Whether first coordinates depend on first coordinates alone, and second ones on second ones.
    pub fn is_separable(&self) -> bool {
        let cylindrical = |(a, b): &(Projection, Projection)| a.is_cylindrical() && b.is_cylindrical();
        self.projections.as_ref().is_none_or(cylindrical)
    }

    /// Remarks on how well the systems are known, each with the system's name.
    pub fn remarks(&self) -> Vec<String> {
        let of =
            |projection: &Projection, crs: &Crs| projection.remark().map(|remark| format!("{crs}: {remark}"));
        let Some((from, to)) = &self.projections else { return Vec::new() };
        [of(from, &self.from), of(to, &self.to)].into_iter().flatten().collect()
    }

    /// The point in the second system; `None` where it has none.
    pub fn forward(&self, point: [f64; 2]) -> Option<[f64; 2]> {
        let Some((from, to)) = &self.projections else { return Some(point) };
        let place = from.inverse(point)?;
        let point = to.forward(place)?;
        // Formulas that are asked beyond their domain may give a point of another place.
        let back = to.inverse(point)?;
        let turned = (back[0] - place[0] + 540.0).rem_euclid(360.0) - 180.0;
        let near_pole = place[1].abs() > 89.999_999;
        ((turned.abs() < CLOSE || near_pole) && (back[1] - place[1]).abs() < CLOSE).then_some(point)
    }

    /// The point in the first system; `None` where it has none. Longitudes are -180 to 180.
    pub fn backward(&self, point: [f64; 2]) -> Option<[f64; 2]> {
        let Some((from, to)) = &self.projections else { return Some(point) };
        let [longitude, latitude] = to.inverse(point)?;
        from.forward([(longitude + 180.0).rem_euclid(360.0) - 180.0, latitude])
    }
}
