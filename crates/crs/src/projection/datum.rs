//! Datums of definitions: how their longitudes and latitudes become those of WGS 84.

use super::words::parameter;

/// The way from a definition's datum to WGS 84.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Datum {
    /// None is needed: WGS 84, or a datum that is the same within a metre or two (ETRS89, NAD83, GDA2020 and others), which PROJ,
    /// too, takes for the same where it has no grids.
    Wgs84,
    /// By a Helmert transformation: its three or seven numbers.
    Shifted(String),
    /// By a grid of shifts: its name.
    Grid(String),
    /// By what the datum of this name asks for.
    Named(String),
    /// By what this one asks for, which is none of those that were compared with PROJ.
    Unlisted(String),
    /// Nobody says.
    Unknown,
}

/// Datums by name, in definitions, that differ from WGS 84 by nothing that a Helmert transformation could tell.
const SAME: [&str; 2] = ["WGS84", "NAD83"];
/// Ellipsoids of datums that are tied to the whole earth, as WGS 84 is.
const GLOBAL_ELLIPSOIDS: [&str; 2] = ["WGS84", "GRS80"];

impl Datum {
    /// The datum of a definition in PROJ's words.
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

    /// PROJ's words for the shift.
    pub(super) fn words(&self) -> Option<String> {
        match self {
            Datum::Shifted(numbers) => Some(format!("+towgs84={numbers}")),
            Datum::Named(name) => Some(format!("+datum={name}")),
            Datum::Wgs84 | Datum::Grid(_) | Datum::Unlisted(_) | Datum::Unknown => None,
        }
    }
}
