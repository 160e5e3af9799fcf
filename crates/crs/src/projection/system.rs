//! Components of coordinate reference systems, independent of the form of their definitions, and
//! their conversion to PROJ's words.

use std::fmt::Write as _;

use proj4rs::Proj;

use super::axis::Axis;
use super::datum::Datum;
use super::datum_names;
use super::definition::Definition;
use super::shift::Shift;
use super::words;
use crate::methods::{self, Values};
use crate::registry::definition_of;

/// The components of a geographic or projected system.
#[derive(Debug)]
pub(crate) struct System {
    pub(crate) name: Option<String>,
    pub(crate) base: Base,
    /// The projection; `None` for geographic systems.
    pub(crate) conversion: Option<Conversion>,
    /// The horizontal axes in their order; empty if the definition leaves them to the reader.
    pub(crate) axes: Vec<Axis>,
    /// Size of the unit of the axes: metres of a projected system, radians of a geographic one.
    pub(crate) unit: f64,
    /// Size in metres of the unit of ellipsoidal heights, if these are the third axis.
    pub(crate) height: Option<f64>,
    /// The shift to WGS 84 in the definition.
    pub(crate) shift: Option<Shift>,
}

/// The geographic base of a system.
#[derive(Debug)]
pub(crate) struct Base {
    /// Name of the geographic system.
    pub(crate) name: Option<String>,
    pub(crate) datum: Name,
    /// Half axes in metres.
    pub(crate) ellipsoid: [f64; 2],
    pub(crate) ellipsoid_name: Option<String>,
    /// Degrees east of Greenwich.
    pub(crate) prime_meridian: f64,
    /// Unit of angle in radians.
    pub(crate) angle: f64,
}

/// Identification of a datum.
#[derive(Debug)]
pub(crate) enum Name {
    /// By its name.
    Text(String),
    /// As the datum of a geographic system of the EPSG registry.
    Epsg(u16),
}

/// A projection method with its parameters.
#[derive(Debug)]
pub(crate) struct Conversion {
    pub(super) method: String,
    pub(super) parameters: Vec<Parameter>,
}

#[derive(Debug)]
pub(crate) struct Parameter {
    pub(super) name: String,
    pub(super) value: f64,
    /// `None` for the system's unit.
    pub(super) unit: Option<Unit>,
}

/// A unit: its size in radians, in metres, or as a factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Unit {
    Angle(f64),
    Length(f64),
    Scale(f64),
}

/// Valid half axes of celestial bodies, in metres.
const SIZES: std::ops::RangeInclusive<f64> = 1e3..=1e9;
/// Valid sizes of units of length, in metres.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-6..=1e7;
/// Tolerance of half axes of equal ellipsoids, in metres.
const SAME_SIZE: f64 = 1e-3;
/// Half axes of the ellipsoids of WGS 84 and of GRS 1980.
const GLOBAL: [[f64; 2]; 2] = [[6_378_137.0, 6_356_752.314_245], [6_378_137.0, 6_356_752.314_140]];

/// Returns the half axes of an ellipsoid with an inverse flattening; 0 means a sphere.
pub(super) fn half_axes(size: f64, inverse_flattening: f64) -> Result<[f64; 2], String> {
    let ellipsoid = match inverse_flattening == 0.0 {
        true => [size; 2],
        false => [size, size * (1.0 - 1.0 / inverse_flattening)],
    };
    check_ellipsoid(ellipsoid)
}

/// Returns the half axes if they are valid.
pub(crate) fn check_ellipsoid([a, b]: [f64; 2]) -> Result<[f64; 2], String> {
    let is_body = SIZES.contains(&a) && b <= a && b > 0.8 * a;
    if is_body { Ok([a, b]) } else { Err(format!("an ellipsoid with half axes of {a:?} m and {b:?} m")) }
}

/// Whether two ellipsoids are the same.
pub(crate) fn is_same_ellipsoid(one: [f64; 2], other: [f64; 2]) -> bool {
    (0..2).all(|axis| (one[axis] - other[axis]).abs() < SAME_SIZE)
}

/// Whether longitudes and latitudes on an ellipsoid are the same as on that of WGS 84.
pub(super) fn is_global(ellipsoid: [f64; 2]) -> bool {
    GLOBAL.iter().any(|global| is_same_ellipsoid(*global, ellipsoid))
}

/// Converts an angle to degrees. Degrees and grads are converted without going via radians.
pub(super) fn degrees(value: f64, radians: f64) -> f64 {
    let is = |degrees: f64| (radians / degrees.to_radians() - 1.0).abs() < 1e-9;
    if is(1.0) {
        value
    } else if is(0.9) {
        value * 0.9
    } else {
        (value * radians).to_degrees()
    }
}

impl Base {
    /// Returns the base of a geographic system of the EPSG registry.
    pub(crate) fn of_epsg(number: u16) -> Result<Base, String> {
        let missing = || format!("EPSG:{number}, whose definition is not built in");
        let definition = definition_of(number).ok_or_else(missing)?;
        let proj = Proj::from_proj_string(&words::without_shift(&definition));
        let proj = proj.ok().filter(Proj::is_latlong).ok_or_else(missing)?;
        let (a, b) = proj.ellipse_parameters();
        let prime_meridian = proj.from_greenwich().to_degrees();
        Ok(Base {
            name: None,
            datum: Name::Epsg(number),
            ellipsoid: [a, b],
            ellipsoid_name: None,
            prime_meridian,
            angle: 1f64.to_radians(),
        })
    }

    /// Returns the shift to WGS 84, for a definition that does not contain one.
    fn way(&self) -> Datum {
        let (number, named) = match &self.datum {
            Name::Epsg(number) => {
                (datum_names::is_known(*number).then_some(*number), format!("of EPSG:{number}"))
            }
            Name::Text(name) => (datum_names::system_of(name), name.clone()),
        };
        let Some(number) = number else {
            // PROJ writes such names for PROJ strings that define only an ellipsoid.
            let is_nameless = methods::key(&named).starts_with("unknownbasedon");
            return if is_nameless && is_global(self.ellipsoid) {
                Datum::Wgs84
            } else {
                Datum::Unlisted(named)
            };
        };
        // A datum that only shares the name is another one.
        let is_same = Base::of_epsg(number).is_ok_and(|known| {
            is_same_ellipsoid(known.ellipsoid, self.ellipsoid)
                && (known.prime_meridian - self.prime_meridian).abs() < 1e-7
        });
        match definition_of(number) {
            Some(known) if is_same => Datum::of(&known),
            _ => Datum::Unlisted(format!("{named}, on another ellipsoid or from another prime meridian")),
        }
    }
}

/// Creates the shift of a Helmert transformation, for ellipsoids and spheres of about the earth's
/// size.
pub(super) fn helmert(numbers: &[f64], ellipsoid: [f64; 2]) -> Result<Datum, String> {
    if ![3, 7].contains(&numbers.len()) || numbers.iter().any(|number| number.abs() > 1e6) {
        return Err(format!("a shift of the datum by {numbers:?}"));
    }
    if (ellipsoid[0] - GLOBAL[0][0]).abs() > 1e5 || ellipsoid[1] < 0.99 * ellipsoid[0] {
        return Err("a shift to WGS 84 from a body that is not the earth".into());
    }
    if numbers.iter().all(|number| *number == 0.0) && is_global(ellipsoid) {
        return Ok(Datum::Wgs84);
    }
    let numbers: Vec<_> = numbers.iter().map(|number| format!("{number:?}")).collect();
    Ok(Datum::Shifted(numbers.join(",")))
}

impl System {
    /// Returns the definition in PROJ's words.
    pub(super) fn definition(self) -> Result<Definition, String> {
        let [a, b] = self.base.ellipsoid;
        let datum = match &self.shift {
            Some(shift) => shift.way(self.base.ellipsoid)?,
            None => self.base.way(),
        };
        let ellipsoid = format!("+a={a:?} +b={b:?}");
        let directions: Vec<_> = self.axes.iter().map(|axis| axis.direction.as_str()).collect();
        let mut words = match &self.conversion {
            None => {
                if degrees(1.0, self.unit) != 1.0 {
                    return Err(format!("longitude and latitude in units of {:?} radians", self.unit));
                }
                if !matches!(directions[..], [] | ["east", "north", ..] | ["north", "east", ..]) {
                    return Err(format!("axes that go {}", directions.join(", ")));
                }
                format!("+proj=longlat {ellipsoid}")
            }
            Some(conversion) => {
                if !LENGTHS.contains(&self.unit) {
                    return Err(format!("a unit of {:?} m", self.unit));
                }
                let (words, values) = self.projection(conversion)?;
                let mut text = format!("{words} {ellipsoid}");
                for (word, value) in values {
                    let _ = write!(text, " +{word}={value:?}");
                }
                if self.unit != 1.0 {
                    let _ = write!(text, " +to_meter={:?}", self.unit);
                }
                text
            }
        };
        if self.base.prime_meridian.abs() > 360.0 {
            return Err(format!("a prime meridian at {:?} degrees", self.base.prime_meridian));
        }
        if self.base.prime_meridian != 0.0 {
            let _ = write!(words, " +pm={:?}", self.base.prime_meridian);
        }
        Ok(Definition { words, datum })
    }

    /// Returns PROJ's words for the method and its parameters. Fails if they do not match the axes.
    pub(crate) fn projection(&self, conversion: &Conversion) -> Result<(&'static str, Values), String> {
        let name = &conversion.method;
        let method = methods::find(name).ok_or_else(|| format!("the method {name}"))?;
        let (words, values) = method.read_words(name, self.values(conversion)?, &self.axes)?;
        if !method.takes(&self.axes, &values) {
            let directions: Vec<_> = self.axes.iter().map(|axis| axis.direction.as_str()).collect();
            return Err(format!("axes that go {} in the method {name}", directions.join(", ")));
        }
        Ok((words, values))
    }

    /// Returns the parameters in degrees, metres and ones.
    fn values(&self, conversion: &Conversion) -> Result<Values, String> {
        let method = methods::find(&conversion.method).ok_or("no method")?;
        let mut values = Values::new();
        for Parameter { name, value, unit } in &conversion.parameters {
            let unknown = || format!("the parameter {name} of the method {}", conversion.method);
            let role = method.role(name).ok_or_else(unknown)?;
            let unit = unit.unwrap_or(match role.measure {
                methods::Measure::Angle => Unit::Angle(self.base.angle),
                methods::Measure::Length => Unit::Length(self.unit),
                methods::Measure::Scale => Unit::Scale(1.0),
            });
            let (value, most) = match (role.measure, unit) {
                (methods::Measure::Angle, Unit::Angle(radians)) => (degrees(*value, radians), 360.0),
                (methods::Measure::Length, Unit::Length(metres)) if LENGTHS.contains(&metres) => {
                    (value * metres, 1e10)
                }
                (methods::Measure::Scale, Unit::Scale(factor)) => (value * factor, 1e3),
                _ => return Err(format!("{} in another kind of unit", unknown())),
            };
            if !(-most..=most).contains(&value) {
                return Err(format!("{} with the value {value:?}", unknown()));
            }
            if values.iter().any(|(word, _)| *word == role.word) {
                return Err(format!("{} twice", unknown()));
            }
            values.push((role.word, value));
        }
        Ok(values)
    }
}
