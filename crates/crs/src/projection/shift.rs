//! Datum shifts that definitions contain as transformations.

use super::datum::Datum;
use super::system::{Conversion, Unit, helmert};
use crate::methods::key;

/// A shift of the datum to WGS 84 in a definition.
#[derive(Clone, Debug)]
pub(crate) enum Shift {
    /// A Helmert transformation (position vector convention) with three or seven parameters.
    Helmert(Vec<f64>),
    /// A grid of shifts, by its name.
    Grid(String),
}

impl Shift {
    /// Returns the shift as a datum on an ellipsoid with the given half axes.
    pub(super) fn way(&self, ellipsoid: [f64; 2]) -> Result<Datum, String> {
        match self {
            Shift::Helmert(numbers) => helmert(numbers, ellipsoid),
            Shift::Grid(name) => Ok(Datum::Grid(name.clone())),
        }
    }
}

/// Methods, and their sign of rotations.
const METHODS: [(&str, f64); 3] = [
    ("geocentrictranslations", 1.0),
    ("positionvectortransformation", 1.0),
    ("coordinateframerotation", -1.0),
];
/// Suffixes of method names that specify the domain.
const DOMAINS: [&str; 4] = ["", "geog2ddomain", "geog3ddomain", "geocentricdomain"];

const PARAMETERS: [&str; 7] = [
    "xaxistranslation",
    "yaxistranslation",
    "zaxistranslation",
    "xaxisrotation",
    "yaxisrotation",
    "zaxisrotation",
    "scaledifference",
];

/// Fails if the target of a transformation is not WGS 84.
pub(super) fn check_target(is_geographic: bool, datum: &str) -> Result<(), String> {
    match is_geographic && super::datum_names::system_of(datum) == Some(4326) {
        true => Ok(()),
        false => Err(format!("a transformation to the datum {datum}, which is not WGS 84")),
    }
}

/// Converts a method and its parameters to a shift.
pub(super) fn read(transformation: &Conversion) -> Result<Shift, String> {
    let name = key(&transformation.method);
    let known = METHODS
        .iter()
        .find(|(method, _)| name.strip_prefix(method).is_some_and(|domain| DOMAINS.contains(&domain)));
    let (_, sign) = known.ok_or_else(|| format!("a shift of the datum by {}", transformation.method))?;
    let mut numbers = [0.0; 7];
    for parameter in &transformation.parameters {
        let refused = || format!("the parameter {} of {}", parameter.name, transformation.method);
        let place = PARAMETERS.iter().position(|own| *own == key(&parameter.name)).ok_or_else(refused)?;
        let arc_second = (1.0f64 / 3600.0).to_radians();
        numbers[place] = match (place, parameter.unit) {
            (0..3, None) => parameter.value,
            (0..3, Some(Unit::Length(metres))) => parameter.value * metres,
            (3..6, None) => parameter.value * sign,
            (3..6, Some(Unit::Angle(radians))) => {
                let is_second = (radians / arc_second - 1.0).abs() < 1e-9;
                sign * parameter.value * if is_second { 1.0 } else { radians / arc_second }
            }
            (6, Some(Unit::Scale(factor))) => parameter.value * factor * 1e6,
            _ => return Err(refused()),
        };
    }
    if numbers[3..].iter().all(|number| *number == 0.0) {
        return Ok(Shift::Helmert(numbers[..3].to_vec()));
    }
    Ok(Shift::Helmert(numbers.to_vec()))
}
