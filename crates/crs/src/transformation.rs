//! Transformations between two coordinate reference systems.

use crate::{Crs, Projection};
use spinney_base::Result;

/// A transformation of points from one coordinate reference system to another, via longitude and
/// latitude in WGS 84.
pub struct Transformation {
    from: Crs,
    /// Projections of both systems; `None` if the systems are the same.
    projections: Option<(Projection, Projection)>,
    remarks: Vec<String>,
}

/// Projections of two systems, or `None` if they are the same, and remarks.
type Way = (Option<(Projection, Projection)>, Vec<String>);

/// Returns the projections and remarks for two systems.
fn between(from: &Crs, to: &Crs, allow_ballpark: bool) -> Result<Way> {
    // (The shift from a datum to WGS 84 is irrelevant if both systems have the same datum.)
    if from.is_same(to) || from.is_same_plane(to) {
        return Ok((None, Vec::new()));
    }
    let open = |crs: &Crs| Projection::new(crs, allow_ballpark);
    let (own, other) = (open(from)?, open(to)?);
    let of =
        |(projection, crs): (&Projection, &Crs)| projection.remark().map(|remark| format!("{crs}: {remark}"));
    let remarks = [(&own, from), (&other, to)].into_iter().filter_map(of).collect();
    Ok(((!own.is_same(&other)).then_some((own, other)), remarks))
}

/// Maximum round-trip error of a point, in degrees.
const CLOSE: f64 = 1e-6;

impl Transformation {
    /// Creates the transformation between two systems. If the systems are the same, it returns
    /// points unchanged. They are the same if their definitions are equivalent ([`Crs::is_same`]),
    /// or if they have the same formula, such as an EPSG code and its well-known text.
    ///
    /// # Errors
    /// Those of [`Projection::new`] if the systems differ.
    pub fn new(from: &Crs, to: &Crs, allow_ballpark: bool) -> Result<Transformation> {
        let (projections, remarks) = between(from, to, allow_ballpark)?;
        Ok(Transformation { from: from.clone(), projections, remarks })
    }

    /// Returns the source system.
    pub fn from(&self) -> &Crs {
        &self.from
    }

    /// Returns the projections of the source and the target system, or `None` if the systems are
    /// the same.
    pub fn projections(&self) -> Option<(&Projection, &Projection)> {
        self.projections.as_ref().map(|(from, to)| (from, to))
    }

    /// Whether the two systems are the same, so that points are returned unchanged.
    pub fn is_identity(&self) -> bool {
        self.projections.is_none()
    }

    /// Whether the first target coordinate depends on the first source coordinate only, and the
    /// second on the second.
    pub fn is_separable(&self) -> bool {
        let cylindrical = |(a, b): &(Projection, Projection)| a.is_cylindrical() && b.is_cylindrical();
        self.projections.as_ref().is_none_or(cylindrical)
    }

    /// Returns remarks on the accuracy of the systems' datums, each with the system's name.
    pub fn remarks(&self) -> Vec<String> {
        self.remarks.clone()
    }

    /// Transforms a point to the target system. `None` if it cannot be represented there.
    pub fn forward(&self, point: [f64; 2]) -> Option<[f64; 2]> {
        let Some((from, to)) = &self.projections else { return Some(point) };
        let place = from.inverse(point)?;
        let point = to.forward(place)?;
        // Outside of their domains, formulas may return the coordinates of another position.
        let back = to.inverse(point)?;
        let turned = (back[0] - place[0] + 540.0).rem_euclid(360.0) - 180.0;
        let near_pole = place[1].abs() > 89.999_999;
        ((turned.abs() < CLOSE || near_pole) && (back[1] - place[1]).abs() < CLOSE).then_some(point)
    }

    /// Transforms a point back to the source system. `None` if it cannot be represented there.
    /// Longitudes are from -180 to 180.
    pub fn backward(&self, point: [f64; 2]) -> Option<[f64; 2]> {
        let Some((from, to)) = &self.projections else { return Some(point) };
        let [longitude, latitude] = to.inverse(point)?;
        from.forward([(longitude + 180.0).rem_euclid(360.0) - 180.0, latitude])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn between(from: &Crs, to: &Crs) -> Transformation {
        Transformation::new(from, to, false).unwrap()
    }

    /// Equivalent definitions of different forms are the same system, whatever their datum is.
    #[test]
    fn equal_definitions_are_the_identity() {
        let numbers = [
            25832, 32633, 32733, 3035, 3034, 3857, 2056, 2154, 3031, 27700, 31467, 4326, 4258, 28992, 2193,
            26917, 3395, 6933, 2263,
        ];
        for number in numbers {
            let crs = Crs::epsg(number);
            // (As in a `.prj` file, without an EPSG code.)
            let written = Crs::Wkt(crs.to_esri_wkt().unwrap());
            assert_eq!(written.numbers(), None);
            for (from, to) in [(&written, &crs), (&crs, &written)] {
                let made = between(from, to);
                assert!(made.is_identity() && made.remarks().is_empty(), "{number}");
                assert_eq!(made.forward([0.1, 5e6 + 0.3]), Some([0.1, 5e6 + 0.3]));
            }
        }
        let zone = "+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs";
        let plane =
            "+proj=tmerc +lat_0=0 +lon_0=9 +k=0.9996 +x_0=500000 +y_0=0 +ellps=GRS80 +units=m +type=crs";
        let [zone, plane] = [zone, plane].map(|text| Crs::parse(text).unwrap());
        for crs in [&zone, &plane] {
            assert!(between(crs, &Crs::epsg(25832)).is_identity());
        }
        assert!(between(&zone, &plane).is_identity());
    }

    /// Any difference makes another system.
    #[test]
    fn definitions_that_differ_are_not_the_identity() {
        let plane = |parts: &str| Crs::parse(&format!("+proj=tmerc +lon_0=9 {parts} +no_defs")).unwrap();
        let own = plane("+k=0.9996 +x_0=500000 +ellps=GRS80");
        for other in [
            plane("+k=0.9996 +x_0=500000.001 +ellps=GRS80"),
            plane("+k=0.99960001 +x_0=500000 +ellps=GRS80"),
            plane("+k=0.9996 +x_0=500000 +ellps=WGS84"),
            plane("+k=0.9996 +x_0=500000 +lat_0=0.00000001 +ellps=GRS80"),
            plane("+k=0.9996 +x_0=500000 +ellps=GRS80 +units=us-ft"),
            plane("+k=0.9996 +x_0=500000 +ellps=GRS80 +towgs84=0,0,1"),
            plane("+k=0.9996 +x_0=500000 +ellps=GRS80 +pm=0.0001"),
            plane("+k=0.9996 +x_0=500000 +ellps=GRS80 +axis=wsu"),
            Crs::epsg(25833),
            Crs::epsg(4258),
            Crs::epsg(3857),
        ] {
            assert!(!between(&own, &other).is_identity(), "{other:?}");
        }
        let shifted =
            plane("+k=0.9996 +x_0=500000 +ellps=bessel +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7");
        let less =
            plane("+k=0.9996 +x_0=500000 +ellps=bessel +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.6");
        assert!(between(&shifted, &shifted.clone()).is_identity());
        assert!(!between(&shifted, &less).is_identity());
        // Feet are not metres, and Web Mercator is not Mercator.
        assert!(!between(&Crs::epsg(2263), &Crs::epsg(32118)).is_identity());
        assert!(!between(&Crs::epsg(3857), &Crs::epsg(3395)).is_identity());
        assert!(!between(&Crs::epsg(2056), &Crs::epsg(21781)).is_identity());
    }
}
