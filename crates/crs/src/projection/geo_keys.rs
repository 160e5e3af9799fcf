//! Reads the components of a system from GeoTIFF keys (OGC 19-008r4).

use super::definition::Definition;
use super::shift::Shift;
use super::system::{Base, Conversion, Name, Parameter, System, Unit, check_ellipsoid, degrees, half_axes};
use super::wkt;
use crate::definition::geo_keys::{GEOGRAPHIC, GeoKeys, PROJECTED, USER_DEFINED, key};
use crate::methods;
use crate::registry::{Ellipsoid, Geographic, meridian_numbered};

/// Code of the prime meridian of Greenwich.
const GREENWICH: u16 = 8901;

/// Keys of parameters, and the parameters' names in definitions.
const PARAMETERS: [(u16, &str); 19] = [
    (3078, "standard_parallel_1"),
    (3079, "standard_parallel_2"),
    (3080, "central_meridian"),
    (3081, "latitude_of_origin"),
    (3082, "false_easting"),
    (3083, "false_northing"),
    (3084, "central_meridian"),
    (3085, "latitude_of_origin"),
    (3086, "false_easting"),
    (3087, "false_northing"),
    (3088, "central_meridian"),
    (3089, "latitude_of_origin"),
    (3090, "false_easting"),
    (3091, "false_northing"),
    (3092, "scale_factor"),
    (3093, "scale_factor"),
    (3094, "azimuth"),
    (3095, "central_meridian"),
    (3096, "rectified_grid_angle"),
];

/// Reads the definition of keys. The error describes what was found.
pub(super) fn read(keys: &GeoKeys) -> Result<Definition, String> {
    match cited(keys) {
        Some(text) => wkt::read(&text),
        None => system(keys)?.definition(),
    }
}

/// Returns the citation in Esri's WKT that defines systems which keys cannot represent.
pub(crate) fn cited(keys: &GeoKeys) -> Option<String> {
    let citations = [key::CITATION, key::PROJECTED_CITATION, key::GEODETIC_CITATION];
    citations.into_iter().find_map(|key| Some(keys.text(key)?.strip_prefix("ESRI PE String = ")?.to_owned()))
}

/// Returns the components of a system that is not defined by a code alone.
pub(crate) fn system(keys: &GeoKeys) -> Result<System, String> {
    let base = base(keys)?;
    let shift = match keys.doubles_of(key::TO_WGS84) {
        Some(numbers) => Some(Shift::Helmert(check_finite(numbers)?.to_vec())),
        None => None,
    };
    let (name, unit, conversion) = match keys.number(key::MODEL_TYPE).unwrap_or_default() {
        GEOGRAPHIC => (None, base.angle, None),
        PROJECTED => {
            if let Some(number) = keys.registered(key::PROJECTED_CRS) {
                return Err(format!("EPSG:{number} in units that are not its own"));
            }
            let name =
                [key::PROJECTED_CITATION, key::CITATION].into_iter().find_map(|place| keys.text(place));
            let name = name.map(|name| part_of(&name, "PCS Name").map_or(name.clone(), String::from));
            (name, linear_unit(keys)?, Some(conversion(keys)?))
        }
        model => return Err(format!("a model of the kind {model}")),
    };
    Ok(System { name, base, conversion, axes: Vec::new(), unit, height: None, shift })
}

/// Returns an element of a citation such as `GCS Name = a|Datum = b|Ellipsoid = c|Primem = d`.
fn part_of<'a>(citation: &'a str, name: &str) -> Option<&'a str> {
    citation
        .split('|')
        .find_map(|part| part.trim().strip_prefix(name)?.trim_start().strip_prefix('='))
        .map(str::trim)
}

pub(crate) fn check_finite(numbers: &[f64]) -> Result<&[f64], String> {
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(number) => Err(format!("the number {number}")),
        None => Ok(numbers),
    }
}

/// Returns the finite double of a key.
pub(crate) fn double(keys: &GeoKeys, place: u16) -> Result<Option<f64>, String> {
    match keys.double(place) {
        Some(number) if !number.is_finite() => Err(format!("{number} as the value of the key {place}")),
        number => Ok(number),
    }
}

/// Reads datum, ellipsoid, prime meridian and unit of angle.
fn base(keys: &GeoKeys) -> Result<Base, String> {
    let angle = angular_unit(keys)?;
    if let Some(number) = keys.registered(key::GEODETIC_CRS) {
        return Ok(Base { angle, ..Base::of_epsg(number)? });
    }
    if let Some(datum) = keys.registered(key::GEODETIC_DATUM) {
        let base = Geographic::of_datum(datum).and_then(|known| Base::of_epsg(known.number).ok());
        return Ok(Base { angle, ..base.ok_or_else(|| format!("the datum with the number {datum}"))? });
    }
    let citation = keys.text(key::GEODETIC_CITATION).unwrap_or_default();
    let datum = part_of(&citation, "Datum").unwrap_or("without a name");
    let known = keys.registered(key::ELLIPSOID).and_then(Ellipsoid::find);
    let sizes = (
        double(keys, key::SEMI_MAJOR_AXIS)?.or(known.map(|known| known.size)),
        double(keys, key::SEMI_MINOR_AXIS)?,
        double(keys, key::INVERSE_FLATTENING)?,
    );
    let sizes = match sizes {
        (size, None, None) => (size, None, known.map(|known| known.inverse_flattening)),
        sizes => sizes,
    };
    let ellipsoid = match sizes {
        (Some(a), _, Some(inverse)) => half_axes(a, inverse)?,
        (Some(a), Some(b), None) => check_ellipsoid([a, b])?,
        _ => return Err(format!("the datum {datum} without the size of its ellipsoid")),
    };
    let prime_meridian =
        match (double(keys, key::PRIME_MERIDIAN_LONGITUDE)?, keys.registered(key::PRIME_MERIDIAN)) {
            (Some(longitude), _) => degrees(longitude, angle),
            (None, None | Some(GREENWICH)) => 0.0,
            (None, Some(number)) => match meridian_numbered(number) {
                Some((_, degrees)) => degrees,
                None => return Err(format!("the prime meridian with the number {number}")),
            },
        };
    let name = part_of(&citation, "GCS Name").or(Some(citation.as_str())).filter(|name| !name.is_empty());
    Ok(Base {
        name: name.map(String::from),
        datum: Name::Text(datum.into()),
        ellipsoid,
        ellipsoid_name: part_of(&citation, "Ellipsoid").map(String::from),
        prime_meridian,
        angle,
    })
}

/// Returns the unit of angle in radians.
fn angular_unit(keys: &GeoKeys) -> Result<f64, String> {
    match (keys.number(key::ANGULAR_UNITS), double(keys, key::ANGULAR_UNIT_SIZE)?) {
        (None | Some(9102 | 9122), _) => Ok(1f64.to_radians()),
        (Some(9101), _) => Ok(1.0),
        (Some(9105 | 9106), _) => Ok(0.9f64.to_radians()),
        (Some(USER_DEFINED), Some(radians)) if radians > 0.0 => Ok(radians),
        (Some(number), _) => Err(format!("the unit of angles with the number {number}")),
    }
}

/// Returns the horizontal unit of length in metres.
pub(crate) fn linear_unit(keys: &GeoKeys) -> Result<f64, String> {
    match (keys.number(key::LINEAR_UNITS), double(keys, key::LINEAR_UNIT_SIZE)?) {
        (None, _) => Ok(1.0),
        (Some(USER_DEFINED), Some(metres)) if metres > 0.0 => Ok(metres),
        (Some(number), _) => {
            metres_numbered(number).ok_or_else(|| format!("the unit of lengths with the number {number}"))
        }
    }
}

/// Returns the size in metres of a unit with an EPSG code.
pub(crate) fn metres_numbered(number: u16) -> Option<f64> {
    match number {
        9001 => Some(1.0),
        9002 => Some(0.3048),
        9003 => Some(1200.0 / 3937.0),
        9036 => Some(1000.0),
        _ => None,
    }
}

/// Reads the method and its parameters.
fn conversion(keys: &GeoKeys) -> Result<Conversion, String> {
    if let Some(number) = keys.registered(key::PROJECTION) {
        return zone(number).ok_or_else(|| format!("the projection with the number {number}"));
    }
    let number = keys.number(key::PROJECTION_METHOD).ok_or("a plane without a method")?;
    let method = methods::coded(number).ok_or_else(|| format!("the method with the number {number}"))?;
    let mut parameters: Vec<Parameter> = Vec::new();
    for (place, name) in PARAMETERS {
        let Some(value) = double(keys, place)? else { continue };
        match parameters.iter().find(|own| own.name == name) {
            Some(own) if own.value == value => {}
            Some(_) => return Err(format!("two values of the parameter {name}")),
            None => parameters.push(Parameter { name: name.into(), value, unit: None }),
        }
    }
    let has = |name: &str| parameters.iter().any(|own| own.name == name);
    // (Both variants of Mercator share a number.)
    let has_parallel = method.name == "Mercator (variant A)" && has("standard_parallel_1");
    let method = if has_parallel { "Mercator (variant B)" } else { method.name };
    Ok(Conversion { method: method.into(), parameters })
}

/// Returns the UTM zone of an EPSG code.
fn zone(number: u16) -> Option<Conversion> {
    let (first, northing) = if number < 16100 { (16000, 0.0) } else { (16100, 1e7) };
    let zone = number.checked_sub(first).filter(|zone| (1..=60).contains(zone))?;
    let one = Some(Unit::Length(1.0));
    let degree = Some(Unit::Angle(1f64.to_radians()));
    let parameter = |name: &str, value, unit| Parameter { name: name.into(), value, unit };
    let parameters = vec![
        parameter("latitude_of_origin", 0.0, degree),
        parameter("central_meridian", 6.0 * f64::from(zone) - 183.0, degree),
        parameter("scale_factor", 0.9996, None),
        parameter("false_easting", 500_000.0, one),
        parameter("false_northing", northing, one),
    ];
    Some(Conversion { method: "Transverse_Mercator".into(), parameters })
}
