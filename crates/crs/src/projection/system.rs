//! Coordinate systems by their parts, in whatever form they were defined, as PROJ's words.

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

/// The parts of a system of longitude and latitude, or of a plane.
#[derive(Debug)]
pub(crate) struct System {
    pub(crate) name: Option<String>,
    pub(crate) base: Base,
    /// The projection; systems of longitude and latitude have none.
    pub(crate) conversion: Option<Conversion>,
    /// The axes of the plane in their order; none if the definition leaves them to the reader.
    pub(crate) axes: Vec<Axis>,
    /// Size of a unit of the axes: metres of a plane, radians of angles.
    pub(crate) unit: f64,
    /// Metres of the unit of heights above the ellipsoid, if these are the third axis.
    pub(crate) height: Option<f64>,
    /// The way to WGS 84 that the definition tells.
    pub(crate) shift: Option<Shift>,
}

/// Base of longitudes and latitudes.
#[derive(Debug)]
pub(crate) struct Base {
    /// That of the geographic system.
    pub(crate) name: Option<String>,
    pub(crate) datum: Name,
    /// Half axes in metres.
    pub(crate) ellipsoid: [f64; 2],
    pub(crate) ellipsoid_name: Option<String>,
    /// Degrees east of Greenwich.
    pub(crate) prime_meridian: f64,
    /// Radians of the unit of angles.
    pub(crate) angle: f64,
}

/// Name of a datum.
#[derive(Debug)]
pub(crate) enum Name {
    /// By this name.
    Text(String),
    /// As that of a geographic system of the EPSG registry.
    Epsg(u16),
}

/// A method with its parameters.
#[derive(Debug)]
pub(crate) struct Conversion {
    pub(super) method: String,
    pub(super) parameters: Vec<Parameter>,
}

#[derive(Debug)]
pub(crate) struct Parameter {
    pub(super) name: String,
    pub(super) value: f64,
    /// That of the system where the parameter tells none.
    pub(super) unit: Option<Unit>,
}

/// A unit: radians, metres, or what a number counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Unit {
    Angle(f64),
    Length(f64),
    Scale(f64),
}

/// Half axes that bodies in space have, in metres.
const SIZES: std::ops::RangeInclusive<f64> = 1e3..=1e9;
/// Metres that units have.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-6..=1e7;
/// Difference of ellipsoids, in metres, that is none.
const SAME_SIZE: f64 = 1e-3;
/// Half axes of the ellipsoids of WGS 84 and of GRS 1980.
const GLOBAL: [[f64; 2]; 2] = [[6_378_137.0, 6_356_752.314_245], [6_378_137.0, 6_356_752.314_140]];

/// Half axes of an ellipsoid by the inverse of its flattening; that of a ball is 0.
pub(super) fn half_axes(size: f64, inverse_flattening: f64) -> Result<[f64; 2], String> {
    let ellipsoid = match inverse_flattening == 0.0 {
        true => [size; 2],
        false => [size, size * (1.0 - 1.0 / inverse_flattening)],
    };
    check_ellipsoid(ellipsoid)
}

/// Half axes, if they can be those of a body.
pub(crate) fn check_ellipsoid([a, b]: [f64; 2]) -> Result<[f64; 2], String> {
    let is_body = SIZES.contains(&a) && b <= a && b > 0.8 * a;
    if is_body { Ok([a, b]) } else { Err(format!("an ellipsoid with half axes of {a:?} m and {b:?} m")) }
}

/// Whether two ellipsoids are one.
pub(crate) fn is_same_ellipsoid(one: [f64; 2], other: [f64; 2]) -> bool {
    (0..2).all(|axis| (one[axis] - other[axis]).abs() < SAME_SIZE)
}

/// Whether longitudes and latitudes on an ellipsoid are those on WGS 84's.
pub(super) fn is_global(ellipsoid: [f64; 2]) -> bool {
    GLOBAL.iter().any(|global| is_same_ellipsoid(*global, ellipsoid))
}

/// Degrees of an angle; numbers of degrees and grads stay exact.
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
    /// Base of a geographic system of the EPSG registry.
    pub(crate) fn of_epsg(number: u16) -> Result<Base, String> {
        let missing = || format!("EPSG:{number}, which the list of definitions does not have");
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

    /// The way to WGS 84, where the definition itself tells none.
    fn way(&self) -> Datum {
        let (number, named) = match &self.datum {
            Name::Epsg(number) => {
                (datum_names::is_known(*number).then_some(*number), format!("of EPSG:{number}"))
            }
            Name::Text(name) => (datum_names::system_of(name), name.clone()),
        };
        let Some(number) = number else {
            // As PROJ's words with an ellipsoid alone, which it writes so.
            let is_nameless = methods::key(&named).starts_with("unknownbasedon");
            return if is_nameless && is_global(self.ellipsoid) {
                Datum::Wgs84
            } else {
                Datum::Unlisted(named)
            };
        };
        // One that has the name alone is another.
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

/// A shift by the numbers of a Helmert transformation, to ellipsoids and from them.
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
    /// The definition in PROJ's words.
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

    /// PROJ's words for the method and its parameters, if these are of the axes.
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

    /// The parameters in degrees, metres and ones.
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
