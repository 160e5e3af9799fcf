//! Projections: conversion between coordinates of a system and longitude and latitude in WGS 84.

mod area;
pub(crate) mod axis;
mod datum;
pub(crate) mod datum_names;
mod definition;
mod formula;
pub(crate) mod geo_keys;
pub(crate) mod proj_string;
pub(crate) mod projjson;
mod read;
pub(crate) mod shift;
pub(crate) mod system;
#[cfg(test)]
mod tests;
mod verified;
pub(crate) mod wkt;
pub(crate) mod words;

use proj4rs::Proj;
use proj4rs::transform::transform;

pub use self::area::AreaOfUse;
use self::datum::Datum;
use self::definition::Definition;
use self::formula::Formula;
use self::verified::is_verified;
use super::{Crs, WEB_MERCATOR};
use spinney_base::{Error, Result};

/// A coordinate reference system whose coordinates can be computed.
///
/// The formulas are those of PROJ, in Rust (proj4rs): see [`PROJECTION_METHODS`]. Systems whose
/// shift to WGS 84 is not known or needs a grid are rejected, unless the caller allows to assume no
/// shift.
pub struct Projection {
    form: ProjectionKind,
    /// A remark on the accuracy of the system's datum.
    remark: Option<String>,
}

/// Method of computation.
enum ProjectionKind {
    /// Degrees of longitude and latitude in WGS 84, or in a datum that is treated as equal.
    Degrees,
    /// Web Mercator: spherical formulas on WGS 84 coordinates.
    WebMercator,
    /// Any other projection: its definition, the definition of degrees in WGS 84, and the
    /// normalized formula.
    Other(Box<Proj>, Box<Proj>, Formula),
}

/// Radius of the sphere of Web Mercator in metres.
const RADIUS: f64 = 6_378_137.0;

/// Supported projection methods, by PROJ's names.
pub const PROJECTION_METHODS: [&str; 27] = [
    "longlat", "merc", "webmerc", "utm", "tmerc", "etmerc", "lcc", "aea", "laea", "stere", "sterea",
    "somerc", "omerc", "cass", "cea", "eqc", "eqdc", "eqearth", "krovak", "mill", "moll", "poly", "robin",
    "sinu", "aeqd", "ortho", "gnom",
];

impl Projection {
    /// Creates the projection of a definition, in any form. Coordinates are within a millimetre of
    /// PROJ's, or within a centimetre for systems by EPSG code with a shifted datum. For a
    /// definition without an EPSG code, the datum is found by its name, if it is one of those that
    /// were compared with PROJ, or by the shift in the definition.
    ///
    /// `allow_ballpark` also accepts other datums. A datum whose shift to WGS 84 is unknown or
    /// needs a grid is treated as WGS 84, which may be off by some hundred metres.
    ///
    /// ```
    /// use spinney::Crs;
    /// use spinney::raw::space::Projection;
    /// let lambert = Projection::new(&Crs::epsg(3034), false)?;
    /// let [x, y] = lambert.forward([10.0, 52.0]).unwrap();
    /// assert!((x - 4_000_000.0).abs() < 1e-6 && (y - 2_800_000.0).abs() < 1e-6);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the definition is not supported, or needs a method that is not in [`PROJECTION_METHODS`]
    /// or a shift that is not available. The message names it.
    pub fn new(crs: &Crs, allow_ballpark: bool) -> Result<Projection> {
        if crs.numbers().is_some_and(|epsg| epsg.in_parts().horizontal == WEB_MERCATOR) {
            return Ok(Projection { form: ProjectionKind::WebMercator, remark: None });
        }
        let invalid = |found: String, expected: String| {
            Error::invalid(format!("coordinate system {crs}"), found, expected)
        };
        let Definition { words, datum } = read::read(crs).map_err(|found| {
            invalid(
                found,
                "a supported definition; if the system is in the EPSG registry, set its number with `spinney build --crs EPSG:NUMBER` \
                 or `spinney transform TREE crs=EPSG:NUMBER`, otherwise reproject the raster"
                    .into(),
            )
        })?;
        let method = words::parameter(&words, "proj").unwrap_or("none");
        if !PROJECTION_METHODS.contains(&method) {
            let methods = PROJECTION_METHODS.join(", ");
            return Err(invalid(format!("the method {method}"), format!("one of {methods}")));
        }
        let number = crs.numbers().map(|epsg| epsg.plane());
        let unsure = match &datum {
            Datum::Unknown => Some("a datum whose shift to WGS 84 is not known".into()),
            _ if number.is_some_and(is_verified) => None,
            Datum::Unlisted(name) => Some(format!("the datum {name}, whose shift to WGS 84 is not known")),
            Datum::Grid(name) => Some(format!("a datum whose shift to WGS 84 is the grid {name}")),
            Datum::Named(name) => Some(format!("the datum {name}, whose shift to WGS 84 needs a grid")),
            Datum::Wgs84 | Datum::Shifted(_) if number.is_some() => {
                Some("a datum for which PROJ has a newer shift to WGS 84 than its definition".into())
            }
            Datum::Wgs84 | Datum::Shifted(_) => None,
        };
        let remark = match unsure {
            Some(found) if !allow_ballpark => {
                let expected = "a datum with a known shift (the EPSG number of the system may define it), or --allow-ballpark, whose \
                                error is up to some hundred metres";
                return Err(invalid(found, expected.into()));
            }
            Some(found) => Some(format!("{found}; positions may be off by some hundred metres")),
            None => None,
        };
        let shifted = datum.words().map(|shift| format!("{words} {shift}"));
        // (Some named datums have shift parameters, others need grids.)
        let shifted = match &datum {
            Datum::Named(_) => shifted.filter(|text| Proj::from_proj_string(text).is_ok()),
            _ => shifted,
        };
        let open = |text: &str| {
            Proj::from_proj_string(text)
                .map_err(|error| invalid(format!("`{text}`: {error}"), "a valid definition".into()))
        };
        let (definition, shifts) = (shifted.as_ref().unwrap_or(&words), shifted.is_some());
        let proj = open(definition)?;
        let form = match proj.is_latlong() && !shifts && proj.from_greenwich() == 0.0 {
            true => ProjectionKind::Degrees,
            false => {
                let formula = Formula::of(&words, &proj, &datum);
                if formula.is_web_mercator(RADIUS) {
                    return Ok(Projection { form: ProjectionKind::WebMercator, remark });
                }
                let degrees = open("+proj=longlat +datum=WGS84 +no_defs")?;
                ProjectionKind::Other(Box::new(proj), Box::new(degrees), formula)
            }
        };
        Ok(Projection { form, remark })
    }

    /// Returns a remark on the accuracy of the system's datum, if it is limited.
    pub fn remark(&self) -> Option<&str> {
        self.remark.as_deref()
    }

    /// Whether coordinates are the same as those of another projection, so that no conversion is
    /// needed.
    pub(crate) fn is_same(&self, other: &Projection) -> bool {
        match (&self.form, &other.form) {
            (ProjectionKind::Degrees, ProjectionKind::Degrees)
            | (ProjectionKind::WebMercator, ProjectionKind::WebMercator) => true,
            (ProjectionKind::Other(.., own), ProjectionKind::Other(.., other)) => own.is_same(other),
            _ => false,
        }
    }

    /// Whether coordinates are longitude and latitude, with a period of 360 degrees.
    pub fn is_geographic(&self) -> bool {
        match &self.form {
            ProjectionKind::Degrees => true,
            ProjectionKind::WebMercator => false,
            ProjectionKind::Other(proj, ..) => proj.is_latlong(),
        }
    }

    /// Whether the first coordinate depends on the longitude only, and the second on the latitude
    /// only.
    pub fn is_cylindrical(&self) -> bool {
        match &self.form {
            ProjectionKind::Degrees | ProjectionKind::WebMercator => true,
            // (Datum shifts mix both.)
            ProjectionKind::Other(..) => false,
        }
    }

    /// Converts a point to longitude and latitude in degrees (WGS 84). `None` if the point is
    /// outside of the projection's domain.
    pub fn inverse(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let point = match &self.form {
            ProjectionKind::Degrees => [x, y],
            ProjectionKind::WebMercator => {
                [(x / RADIUS).to_degrees(), (y / RADIUS).sinh().atan().to_degrees()]
            }
            ProjectionKind::Other(proj, degrees, _) => {
                let mut point = match proj.is_latlong() {
                    true => (x.to_radians(), y.to_radians(), 0.0),
                    false => (x, y, 0.0),
                };
                transform(proj, degrees, &mut point).ok()?;
                [point.0.to_degrees(), point.1.to_degrees()]
            }
        };
        (point[0].is_finite() && point[1].abs() <= 90.0 + 1e-9).then_some(point)
    }

    /// Converts longitude and latitude in degrees (WGS 84) to a point. `None` if the position is
    /// outside of the projection's domain.
    pub fn forward(&self, [longitude, latitude]: [f64; 2]) -> Option<[f64; 2]> {
        if latitude.abs() > 90.0 + 1e-9 {
            return None;
        }
        let point = match &self.form {
            ProjectionKind::Degrees => [longitude, latitude],
            ProjectionKind::WebMercator => {
                [RADIUS * longitude.to_radians(), RADIUS * latitude.to_radians().tan().asinh()]
            }
            ProjectionKind::Other(proj, degrees, _) => {
                let mut point = (longitude.to_radians(), latitude.to_radians(), 0.0);
                transform(degrees, proj, &mut point).ok()?;
                match proj.is_latlong() {
                    true => [point.0.to_degrees(), point.1.to_degrees()],
                    false => [point.0, point.1],
                }
            }
        };
        point.iter().all(|number| number.is_finite()).then_some(point)
    }
}
