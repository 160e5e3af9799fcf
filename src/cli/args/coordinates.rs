//! The option for the coordinates in which places are given.

use anyhow::Result;
use clap::Args;
use spinney::{CellLocator, Coordinates, Dataset};

use super::super::report::warn;
use super::parse_crs;

/// Coordinates in which places are given.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct CoordinatesOption {
    /// Coordinates in which places are given: cells (of the deepest level), world (the tree's own system), lonlat (longitude and
    /// latitude in degrees, WGS 84), EPSG:NUMBER or another system as WKT, PROJJSON, '+proj=...' or @FILE
    #[arg(long = "in", value_name = "COORDINATES", value_parser = parse_coordinates)]
    given: Option<Coordinates>,
}

fn parse_coordinates(text: &str) -> Result<Coordinates, String> {
    match text {
        "cells" | "world" | "lonlat" => text.parse().map_err(|error: spinney::Error| error.to_string()),
        _ => parse_crs(text)
            .map(Coordinates::System)
            .map_err(|error| format!("cells, world, lonlat or a coordinate system; {error}")),
    }
}

impl CoordinatesOption {
    /// The coordinates that were given.
    pub(crate) fn given(&self) -> Option<&Coordinates> {
        self.given.as_ref()
    }

    /// Whether places are cells, where these are what is usual.
    pub(crate) fn are_cells(&self) -> bool {
        matches!(self.given, None | Some(Coordinates::Cells))
    }

    /// The way from these coordinates to cells, from others if none were given; remarks on how well it is known are printed.
    pub(crate) fn places(&self, tree: &Dataset, usual: Coordinates) -> Result<CellLocator> {
        let coordinates = self.given.as_ref().unwrap_or(&usual);
        let places = CellLocator::new(coordinates, &tree.metadata().frame, tree.header().extent)?;
        for remark in places.remarks() {
            warn(&remark);
        }
        Ok(places)
    }
}
