//! The keys of GeoTIFF files (OGC 19-008r4) as the parts of a system.

use super::definition::Definition;
use super::system::{
    Base, Conversion, Name, Parameter, System, Unit, check_ellipsoid, degrees, half_axes, helmert,
};
use super::wkt;
use crate::definition::geo_keys::{GEOGRAPHIC, GeoKeys, PROJECTED, USER_DEFINED, key};

/// The prime meridian of Greenwich.
const GREENWICH: u16 = 8901;

/// Methods by their numbers, and by a name that definitions have.
const METHODS: [(u16, &str); 21] = [
    (1, "Transverse_Mercator"),
    (3, "Hotine_Oblique_Mercator"),
    (7, "Mercator"),
    (8, "Lambert_Conformal_Conic_2SP"),
    (9, "Lambert_Conformal_Conic_1SP"),
    (10, "Lambert_Azimuthal_Equal_Area"),
    (11, "Albers_Conic_Equal_Area"),
    (12, "Azimuthal_Equidistant"),
    (13, "Equidistant_Conic"),
    (14, "Stereographic"),
    (15, "Polar_Stereographic"),
    (16, "Oblique_Stereographic"),
    (17, "Equirectangular"),
    (18, "Cassini_Soldner"),
    (19, "Gnomonic"),
    (21, "Orthographic"),
    (22, "Polyconic"),
    (23, "Robinson"),
    (24, "Sinusoidal"),
    (28, "Cylindrical_Equal_Area"),
    (9815, "Hotine_Oblique_Mercator_Azimuth_Center"),
];

/// Keys of parameters, and the names that the parameters have in definitions.
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

/// The definition that keys have. An error says what was found.
pub(super) fn read(keys: &GeoKeys) -> Result<Definition, String> {
    // Systems that keys cannot say are cited in Esri's WKT.
    for place in [key::CITATION, key::PROJECTED_CITATION, key::GEODETIC_CITATION] {
        if let Some(text) = keys.text(place)
            && let Some(definition) = text.strip_prefix("ESRI PE String = ")
        {
            return wkt::read(definition);
        }
    }
    let model = keys.number(key::MODEL_TYPE).unwrap_or_default();
    let base = base(keys)?;
    let shift = match keys.doubles_of(key::TO_WGS84) {
        Some(numbers) => Some(helmert(check_finite(numbers)?, base.ellipsoid)?),
        None => None,
    };
    match model {
        GEOGRAPHIC => {
            let unit = base.angle;
            Ok(System { base, conversion: None, axes: Vec::new(), unit, shift }.definition()?)
        }
        PROJECTED => {
            if let Some(number) = keys.registered(key::PROJECTED_CRS) {
                return Err(format!("EPSG:{number} in units that are not its own"));
            }
            let unit = linear_unit(keys)?;
            let conversion = Some(conversion(keys)?);
            System { base, conversion, axes: Vec::new(), unit, shift }.definition()
        }
        _ => Err(format!("a model of the kind {model}")),
    }
}

fn check_finite(numbers: &[f64]) -> Result<&[f64], String> {
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(number) => Err(format!("the number {number}")),
        None => Ok(numbers),
    }
}

/// The finite number of a key.
fn double(keys: &GeoKeys, place: u16) -> Result<Option<f64>, String> {
    match keys.double(place) {
        Some(number) if !number.is_finite() => Err(format!("{number} as the value of the key {place}")),
        number => Ok(number),
    }
}

/// Datum, ellipsoid, prime meridian and unit of angles.
fn base(keys: &GeoKeys) -> Result<Base, String> {
    let angle = angular_unit(keys)?;
    if let Some(number) = keys.registered(key::GEODETIC_CRS) {
        return Ok(Base { angle, ..Base::of_epsg(number)? });
    }
    if let Some(datum) = keys.registered(key::GEODETIC_DATUM) {
        // The registry has most old systems under the number of their datum, less 2000.
        let known = datum.checked_sub(2000).filter(|number| (4120..4905).contains(number));
        let base = known.and_then(|number| Base::of_epsg(number).ok());
        return Ok(Base { angle, ..base.ok_or_else(|| format!("the datum with the number {datum}"))? });
    }
    // `GCS Name = a|Datum = b|Ellipsoid = c|Primem = d`
    let citation = keys.text(key::GEODETIC_CITATION).unwrap_or_default();
    let datum =
        citation.split('|').find_map(|part| part.trim().strip_prefix("Datum = ")).unwrap_or("without a name");
    let sizes = (
        double(keys, key::SEMI_MAJOR_AXIS)?,
        double(keys, key::SEMI_MINOR_AXIS)?,
        double(keys, key::INVERSE_FLATTENING)?,
    );
    let ellipsoid = match sizes {
        (Some(a), _, Some(inverse)) => half_axes(a, inverse)?,
        (Some(a), Some(b), None) => check_ellipsoid([a, b])?,
        _ => return Err(format!("the datum {datum} without the size of its ellipsoid")),
    };
    let prime_meridian =
        match (double(keys, key::PRIME_MERIDIAN_LONGITUDE)?, keys.registered(key::PRIME_MERIDIAN)) {
            (Some(longitude), _) => degrees(longitude, angle),
            (None, None | Some(GREENWICH)) => 0.0,
            (None, Some(number)) => return Err(format!("the prime meridian with the number {number}")),
        };
    Ok(Base { datum: Name::Text(datum.into()), ellipsoid, prime_meridian, angle })
}

/// Radians of the unit of angles.
fn angular_unit(keys: &GeoKeys) -> Result<f64, String> {
    match (keys.number(key::ANGULAR_UNITS), double(keys, key::ANGULAR_UNIT_SIZE)?) {
        (None | Some(9102 | 9122), _) => Ok(1f64.to_radians()),
        (Some(9101), _) => Ok(1.0),
        (Some(9105 | 9106), _) => Ok(0.9f64.to_radians()),
        (Some(USER_DEFINED), Some(radians)) if radians > 0.0 => Ok(radians),
        (Some(number), _) => Err(format!("the unit of angles with the number {number}")),
    }
}

/// Metres of the unit of the plane.
fn linear_unit(keys: &GeoKeys) -> Result<f64, String> {
    match (keys.number(key::LINEAR_UNITS), double(keys, key::LINEAR_UNIT_SIZE)?) {
        (None | Some(9001), _) => Ok(1.0),
        (Some(9002), _) => Ok(0.3048),
        (Some(9003), _) => Ok(1200.0 / 3937.0),
        (Some(9036), _) => Ok(1000.0),
        (Some(USER_DEFINED), Some(metres)) if metres > 0.0 => Ok(metres),
        (Some(number), _) => Err(format!("the unit of lengths with the number {number}")),
    }
}

/// The method and its parameters.
fn conversion(keys: &GeoKeys) -> Result<Conversion, String> {
    if let Some(number) = keys.registered(key::PROJECTION) {
        return zone(number).ok_or_else(|| format!("the projection with the number {number}"));
    }
    let number = keys.number(key::PROJECTION_METHOD).ok_or("a plane without a method")?;
    let method = METHODS.iter().find(|(own, _)| *own == number).map(|(_, name)| *name);
    let method = method.ok_or_else(|| format!("the method with the number {number}"))?;
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
    let method = if number == 7 && !has("standard_parallel_1") { "Mercator_1SP" } else { method };
    Ok(Conversion { method: method.into(), parameters })
}

/// The zone of UTM that a number of the registry means.
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
