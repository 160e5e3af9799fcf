//! Coordinate systems of input positions.

use std::fmt;
use std::str::FromStr;

use crate::Crs;
use spinney_base::{Error, Result};

/// The coordinate system in which positions in a tree are given.
#[derive(Clone, Debug, PartialEq)]
pub enum Coordinates {
    /// Columns, rows and layers of the cells at the deepest level.
    Cells,
    /// The tree's own coordinate reference system.
    World,
    /// Another coordinate reference system. `lonlat` is longitude and latitude in degrees (WGS 84),
    /// in this order.
    System(Crs),
}

/// EPSG code of longitude and latitude in WGS 84.
const WGS_84: u32 = 4326;

impl Coordinates {
    /// Longitude and latitude in degrees (WGS 84), in this order.
    pub const LONLAT: Coordinates = Coordinates::System(Crs::epsg(WGS_84));
}

/// Parses `cells`, `world`, `lonlat`, or any definition that [`Crs::parse`] reads.
impl FromStr for Coordinates {
    type Err = Error;

    fn from_str(text: &str) -> Result<Coordinates> {
        match text {
            "cells" => Ok(Coordinates::Cells),
            "world" => Ok(Coordinates::World),
            "lonlat" => Ok(Coordinates::LONLAT),
            _ => {
                let crs = Crs::parse(text).map_err(|error| match error {
                    Error::Invalid { found, expected, .. } => {
                        Error::invalid("coordinates", found, format!("cells, world, lonlat, {expected}"))
                    }
                    other => other,
                })?;
                crs.check_registered().map(|()| Coordinates::System(crs))
            }
        }
    }
}

impl fmt::Display for Coordinates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Coordinates::Cells => f.write_str("cells"),
            Coordinates::World => f.write_str("world"),
            Coordinates::System(crs) if *self == Coordinates::LONLAT => write!(f, "lonlat ({crs})"),
            Coordinates::System(crs) => crs.fmt(f),
        }
    }
}
