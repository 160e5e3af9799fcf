//! The option for the coordinate system of arguments.

use anyhow::Result;
use clap::Args;
use spinney::{CellLocator, Coordinates, Dataset};

use super::super::report::warn;
use super::parse_crs;

/// Coordinate system in which positions are given.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct CoordinatesOption {
    /// Coordinates in which positions are given: cells (of the deepest level), world (the tree's
    /// system), lonlat (WGS 84, degrees), EPSG:NUMBER, WKT, PROJJSON, '+proj=...' or @FILE
    /// [default: cells for windows, world for points and polygons]
    #[arg(long = "in", value_name = "COORDINATES", value_parser = parse_coordinates)]
    given: Option<Coordinates>,
}

fn parse_coordinates(text: &str) -> Result<Coordinates, String> {
    match text {
        "cells" | "world" | "lonlat" => text.parse().map_err(|error: spinney::Error| error.to_string()),
        _ => parse_crs(text)
            .map(Coordinates::System)
            .map_err(|error| format!("expected cells, world, lonlat or a coordinate system; {error}")),
    }
}

impl CoordinatesOption {
    /// Returns the coordinates of the command line.
    pub(crate) fn given(&self) -> Option<&Coordinates> {
        self.given.as_ref()
    }

    /// Whether positions are cells, in a command whose default is cells.
    pub(crate) fn are_cells(&self) -> bool {
        matches!(self.given, None | Some(Coordinates::Cells))
    }

    /// Returns the conversion from these coordinates (`usual` if none were given) to cells. Prints
    /// remarks on its accuracy as warnings.
    pub(crate) fn locator(&self, tree: &Dataset, usual: Coordinates) -> Result<CellLocator> {
        let coordinates = self.given.as_ref().unwrap_or(&usual);
        let locator = CellLocator::new(coordinates, &tree.metadata().frame, tree.header().extent)?;
        for remark in locator.remarks() {
            warn(&remark);
        }
        Ok(locator)
    }
}
