//! Frames on the globe: maps a tree's world coordinates to geocentric WGS 84 coordinates
//! (EPSG:4978), in which viewers show 3D Tiles together with other tilesets.

use glam::{DMat4, DVec3};

use spinney_container::Unit;
use spinney_crs::{Crs, Frame, Projection};

/// Semi-major axis in metres, and squared eccentricity, of the WGS 84 ellipsoid.
const SEMI_MAJOR: f64 = 6_378_137.0;
const ECCENTRICITY: f64 = 0.006_694_379_990_141_316;

/// EPSG code of geocentric WGS 84 coordinates.
const GEOCENTRIC: u32 = 4978;

/// Positions of world coordinates on the globe.
pub(in crate::export) struct GlobePosition {
    /// `None` for geocentric coordinates.
    projection: Option<Projection>,
    /// Length of the unit of heights.
    metres: f64,
    /// Maximum length of the unit of a coordinate.
    metres_per_unit: f64,
}

impl GlobePosition {
    /// Returns `None` for coordinate systems without a known projection. Heights are taken as
    /// ellipsoidal heights, in the unit of the projection, or in metres if that is degrees.
    pub(in crate::export) fn of(crs: &Crs) -> Option<GlobePosition> {
        let is_geocentric = crs.numbers().is_some_and(|numbers| numbers.horizontal == GEOCENTRIC);
        let projection = match is_geocentric {
            true => None,
            false => Some(Projection::new(crs, false).ok()?),
        };
        let length = Unit::parse(crs.unit()?).and_then(Unit::metres);
        let metres_per_unit = length.unwrap_or(SEMI_MAJOR.to_radians());
        Some(GlobePosition { projection, metres: length.unwrap_or(1.0), metres_per_unit })
    }

    /// Returns the maximum length in metres of a unit of a coordinate, such as that of a degree at
    /// the equator, apart from the projection's scale.
    pub(in crate::export) fn metres_per_unit(&self) -> f64 {
        self.metres_per_unit
    }

    /// Returns the geocentric position of a point, in metres; `None` outside of the projection's
    /// area.
    pub(in crate::export) fn of_world(&self, [x, y, z]: [f64; 3]) -> Option<DVec3> {
        let found = match &self.projection {
            Some(projection) => geocentric(projection.inverse([x, y])?, z * self.metres),
            None => DVec3::new(x, y, z) * self.metres,
        };
        found.is_finite().then_some(found)
    }

    /// Returns the directions to the east, to the north and up at a point; `None` for geocentric
    /// coordinates, and outside of the projection's area.
    pub(in crate::export) fn directions(&self, [x, y, _]: [f64; 3]) -> Option<[DVec3; 3]> {
        let [longitude, latitude] = self.projection.as_ref()?.inverse([x, y])?;
        let ((sin_lon, cos_lon), (sin_lat, cos_lat)) =
            (longitude.to_radians().sin_cos(), latitude.to_radians().sin_cos());
        Some([
            DVec3::new(-sin_lon, cos_lon, 0.0),
            DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat),
            DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat),
        ])
    }
}

/// Affine map onto the globe.
#[derive(Clone, Copy, Debug)]
pub(super) struct OnGlobe {
    /// From cells to metres.
    pub(super) matrix: DMat4,
    /// Maximum distance in metres between the map and the curved globe, over the corners of the
    /// box.
    pub(super) deviation: f64,
}

impl OnGlobe {
    /// Map that touches the globe in the middle of a box of cells. Returns `None` if the coordinate
    /// system cannot be projected there.
    pub(super) fn touching(frame: &Frame, [least, most]: [[f64; 3]; 2]) -> Option<OnGlobe> {
        let crs = frame.crs.as_ref()?;
        let position = GlobePosition::of(crs)?;
        let place = |cells: DVec3| position.of_world(frame.to_world(cells.to_array()));
        let (least, most) = (DVec3::from(least), DVec3::from(most));
        let middle = least.midpoint(most);
        let centre = place(middle)?;
        // Stride of a hundredth of the box: far above rounding, and the error of central
        // differences is quadratic in it.
        let axis = |axis: usize| {
            let step = (most - least)[axis].max(1.0) / 100.0;
            let by = DVec3::AXES[axis] * step;
            Some((place(middle + by)? - place(middle - by)?) / (2.0 * step))
        };
        let [x, y, z] = [axis(0)?, axis(1)?, axis(2)?];
        let origin = centre - x * middle.x - y * middle.y - z * middle.z;
        let matrix = DMat4::from_cols(x.extend(0.0), y.extend(0.0), z.extend(0.0), origin.extend(1.0));
        let mut deviation = 0.0f64;
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { least[axis] } else { most[axis] };
            let corner = DVec3::new(pick(0), pick(1), pick(2));
            deviation = deviation.max(place(corner)?.distance(matrix.transform_point3(corner)));
        }
        (matrix.is_finite() && deviation.is_finite()).then_some(OnGlobe { matrix, deviation })
    }
}

/// Point at a longitude and latitude in degrees and a height in metres.
fn geocentric([longitude, latitude]: [f64; 2], height: f64) -> DVec3 {
    let ((sin_lon, cos_lon), (sin_lat, cos_lat)) =
        (longitude.to_radians().sin_cos(), latitude.to_radians().sin_cos());
    let normal = SEMI_MAJOR / (1.0 - ECCENTRICITY * sin_lat * sin_lat).sqrt();
    let across = (normal + height) * cos_lat;
    DVec3::new(across * cos_lon, across * sin_lon, (normal * (1.0 - ECCENTRICITY) + height) * sin_lat)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of EPSG:4979 in EPSG:4978, from PROJ 9.
    #[test]
    fn geocentric_coordinates_equal_those_of_proj() {
        for (place, height, expected) in [
            ([0.0, 0.0], 0.0, [6_378_137.0, 0.0, 0.0]),
            ([0.0, 90.0], 10.0, [0.0, 0.0, 6_356_762.314_245]),
            ([7.0, 46.5], 1200.0, [4_366_209.170_2, 536_103.075_8, 4_604_550.847_9]),
        ] {
            let found = geocentric(place, height);
            assert!(found.distance(expected.into()) < 1e-3, "{place:?}: {found}");
        }
    }

    #[test]
    fn frames_touch_the_globe_in_their_middle() {
        let mut frame = Frame::planar([0.5, 0.0, 500_000.0, 0.0, 0.5, 5_150_000.0]);
        frame.matrix[2][2] = 0.5;
        frame.crs = Some(Crs::epsg(32632));
        let found = OnGlobe::touching(&frame, [[0.0; 3], [2000.0; 3]]).unwrap();
        // 1 km: the earth's surface drops by 6 cm at 700 m.
        assert!(found.deviation > 0.01 && found.deviation < 0.2, "{}", found.deviation);
        let scale = found.matrix.transform_vector3(DVec3::X).length() / 0.5;
        assert!((scale - 1.0004).abs() < 1e-4, "{scale}: UTM shrinks by 0.9996 at its meridian");
        frame.crs = None;
        assert!(OnGlobe::touching(&frame, [[0.0; 3], [2000.0; 3]]).is_none());
    }
}
