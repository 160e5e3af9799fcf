//! Datums of definitions, and their shifts to WGS 84.

use super::words::parameter;

/// The shift from a definition's datum to WGS 84.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Datum {
    /// No shift: WGS 84, or a datum that differs from it by at most a metre or two (ETRS89, NAD83,
    /// GDA2020 and others). PROJ treats these as equal, too, if it has no grids.
    Wgs84,
    /// A Helmert transformation with three or seven parameters.
    Shifted(String),
    /// A grid of shifts, by its name.
    Grid(String),
    /// The shift of a named datum.
    Named(String),
    /// The shift of a named datum that was not compared with PROJ.
    Unlisted(String),
    /// The shift is not defined.
    Unknown,
}

/// Names of datums whose difference from WGS 84 is below what a Helmert transformation could
/// describe.
const SAME: [&str; 2] = ["WGS84", "NAD83"];
/// Ellipsoids of datums that are fitted to the whole earth, like WGS 84.
const GLOBAL_ELLIPSOIDS: [&str; 2] = ["WGS84", "GRS80"];

impl Datum {
    /// Returns the datum of a PROJ string.
    pub(super) fn of(definition: &str) -> Datum {
        let get = |name| parameter(definition, name);
        match (get("nadgrids"), get("towgs84"), get("datum"), get("ellps")) {
            (Some("@null"), ..) => Datum::Wgs84,
            (Some(grid), ..) => Datum::Grid(grid.into()),
            (_, Some(numbers), ..) => {
                let is_zero = |number: &str| number.trim().parse::<f64>() == Ok(0.0);
                if numbers.split(',').all(is_zero) { Datum::Wgs84 } else { Datum::Shifted(numbers.into()) }
            }
            (_, _, Some(name), _) if SAME.contains(&name) => Datum::Wgs84,
            (_, _, Some(name), _) => Datum::Named(name.into()),
            (_, _, None, Some(name)) if GLOBAL_ELLIPSOIDS.contains(&name) => Datum::Wgs84,
            _ => Datum::Unknown,
        }
    }

    /// Returns PROJ's words for the shift.
    pub(super) fn words(&self) -> Option<String> {
        match self {
            Datum::Shifted(numbers) => Some(format!("+towgs84={numbers}")),
            Datum::Named(name) => Some(format!("+datum={name}")),
            Datum::Wgs84 | Datum::Grid(_) | Datum::Unlisted(_) | Datum::Unknown => None,
        }
    }
}
