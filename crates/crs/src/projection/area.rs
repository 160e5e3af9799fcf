//! Areas of use of projections, where they are suitable for maps.

use super::Projection;
use super::formula::Formula;
use super::{ProjectionKind, RADIUS};
use crate::WEB_MERCATOR_LATITUDE;

/// The area in which a projection is suitable for maps. Outside of it, cells are many times as
/// large as in its middle, or unbounded.
///
/// Stereographic and conformal conic projections are used within 90 degrees of latitude from their
/// middle, and oblique stereographic ones also within 90 degrees of longitude. Gnomonic projections
/// and the Swiss oblique Mercator are used within 60 degrees. Transverse Mercator, Cassini and
/// polyconic projections are used within 60 degrees of longitude. Mercator is used up to 85.05
/// degrees of latitude, where its world is a square. All others cover the whole world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaOfUse {
    /// Minimum and maximum latitude in degrees.
    latitudes: [f64; 2],
    /// Longitude of the middle, and extent in degrees to both sides of it.
    longitudes: [f64; 2],
}

/// Tolerance for rounding errors beyond the poles in degrees, the same as in
/// [`Projection::inverse`].
const ROUNDING: f64 = 1e-9;
/// Latitudes of the world.
const WORLD: [f64; 2] = [-90.0 - ROUNDING, 90.0 + ROUNDING];

impl AreaOfUse {
    /// Returns the area of use of a formula.
    pub(super) fn of(formula: &Formula) -> AreaOfUse {
        let number = |name: &str| formula.number(name);
        let around = |middle: f64, by: f64| [(middle - by).max(WORLD[0]), (middle + by).min(WORLD[1])];
        let first = number("lat_1");
        let [origin, meridian] = [number("lat_0"), number("lon_0") + formula.meridian()];
        // (The whole circle of longitudes.)
        let all = 180.0;
        let (latitudes, width) = match formula.method() {
            "merc" | "webmerc" => ([-WEB_MERCATOR_LATITUDE, WEB_MERCATOR_LATITUDE], all),
            "stere" if origin.abs() == 90.0 => (around(origin, 90.0), all),
            "stere" | "sterea" => (around(origin, 90.0), 90.0),
            "lcc" => {
                let second = if formula.has("lat_2") { number("lat_2") } else { first };
                (around((first + second) / 2.0, 90.0), all)
            }
            "gnom" if origin.abs() == 90.0 => (around(origin, 60.0), all),
            "gnom" | "somerc" => (around(origin, 60.0), 60.0),
            "tmerc" | "cass" | "poly" => (WORLD, 60.0),
            _ => (WORLD, all),
        };
        AreaOfUse { latitudes, longitudes: [meridian, width] }
    }

    /// Whether a position (longitude and latitude in degrees) is in the area.
    pub fn contains(&self, place: [f64; 2]) -> bool {
        self.nearest(place) == place
    }

    /// Returns the position in the area whose longitude and latitude are nearest to those of a
    /// position.
    pub fn nearest(&self, [longitude, latitude]: [f64; 2]) -> [f64; 2] {
        let [middle, width] = self.longitudes;
        let offset = (longitude - middle + 180.0).rem_euclid(360.0) - 180.0;
        let longitude = longitude + (offset.clamp(-width, width) - offset);
        [longitude, latitude.clamp(self.latitudes[0], self.latitudes[1])]
    }

    /// Returns positions along the border of the area, including the meridian opposite to its
    /// middle.
    pub fn edge(&self) -> Vec<[f64; 2]> {
        const STEPS: u32 = 128;
        let [middle, width] = self.longitudes;
        let [south, north] = self.latitudes.map(|latitude| latitude.clamp(-90.0, 90.0));
        let mut positions = Vec::new();
        for step in 0..=STEPS {
            let part = f64::from(step) / f64::from(STEPS);
            let [longitude, latitude] = [middle + width * (2.0 * part - 1.0), south + (north - south) * part];
            let [west, east] = [middle - width, middle + width];
            positions.extend([[longitude, south], [longitude, north], [west, latitude], [east, latitude]]);
        }
        positions
    }
}

impl Projection {
    /// Returns the area in which the projection is suitable for maps.
    pub fn area_of_use(&self) -> AreaOfUse {
        match &self.form {
            ProjectionKind::Degrees => AreaOfUse { latitudes: WORLD, longitudes: [0.0, 180.0] },
            ProjectionKind::WebMercator => AreaOfUse {
                latitudes: [-WEB_MERCATOR_LATITUDE, WEB_MERCATOR_LATITUDE],
                longitudes: [0.0, 180.0],
            },
            ProjectionKind::Other(.., formula) => AreaOfUse::of(formula),
        }
    }

    /// Returns the first coordinate of the middle of the world, and its period around the world, if
    /// these are the same at all latitudes: for degrees and cylindrical projections.
    pub fn turn(&self) -> Option<[f64; 2]> {
        match &self.form {
            ProjectionKind::Degrees => Some([0.0, 360.0]),
            ProjectionKind::WebMercator => Some([0.0, RADIUS * std::f64::consts::TAU]),
            ProjectionKind::Other(proj, ..) if proj.is_latlong() => Some([0.0, 360.0]),
            ProjectionKind::Other(.., formula) => {
                if !matches!(formula.method(), "merc" | "webmerc" | "cea" | "eqc" | "mill") {
                    return None;
                }
                let middle = formula.number("lon_0") + formula.meridian();
                let [west, here, east] = [-90.0, 0.0, 90.0].map(|by| self.forward([middle + by, 0.0]));
                Some([here?[0], 2.0 * (east?[0] - west?[0])])
            }
        }
    }
}
