//! Volume, centre, bounds and surface of solids.

use super::unit::{suffix, unit};
use anyhow::Result;
use serde_json::json;
use spinney::Dataset;
use spinney::raw::query::{SolidStatistics, SolidSurface};

/// Description of an unknown unit.
const UNKNOWN: &str = "the model's unit, which is unknown (`build --unit` sets it)";

/// Formats coordinates, separated by commas.
fn list(numbers: &[f64; 3]) -> String {
    // Six decimals: fewer than rounding errors affect.
    numbers.map(|number| ((number * 1e6).round() / 1e6).to_string()).join(", ")
}

/// Returns the volume of a cell, or why it is unknown.
fn cell_volume(tree: &Dataset) -> Result<f64, &'static str> {
    tree.metadata().frame.cell_volume()
}

/// Returns a solid's measures as JSON, with its surface if that was measured.
pub(crate) fn as_json(
    tree: &Dataset,
    solid: &SolidStatistics,
    surface: Option<&SolidSurface>,
) -> serde_json::Value {
    let mut json = json!({
        "level": solid.level,
        "unit": unit(tree),
        "volume": cell_volume(tree).ok().map(|_| solid.world_volume()),
        "volume_cells": solid.volume,
        "occupied_cells": solid.cells,
        "centre": solid.world_centre(),
        "centre_cells": solid.centre,
        "bounds": solid.world_bounds(),
        "bounds_cells": solid.bounds.map(|bounds| [bounds.min, bounds.max]),
    });
    if let Some(surface) = surface {
        let is_known = cell_volume(tree).is_ok();
        json["surface"] = is_known.then(|| surface.smooth_area()).into();
        json["surface_of_blocks"] = is_known.then(|| surface.block_area()).into();
        json["faces"] = json!(surface.faces);
    }
    json
}

/// Returns a solid's measures as text, with its surface if that was measured.
pub(crate) fn as_text(
    tree: &Dataset,
    solid: &SolidStatistics,
    surface: Option<&SolidSurface>,
) -> Result<String> {
    use std::fmt::Write;
    let mut text = String::new();
    writeln!(
        text,
        "solid      at level {} of {}; lengths in {}",
        solid.level,
        tree.depth(),
        unit(tree).unwrap_or(UNKNOWN)
    )?;
    let volume = match cell_volume(tree) {
        Ok(_) => format!("{}{}", solid.world_volume(), suffix(tree, "3")),
        Err(reason) => format!("unknown: {reason}"),
    };
    writeln!(text, "  volume   {volume} ({:.3} cells, {} occupied)", solid.volume, solid.cells)?;
    if let (Some(_), Err(reason)) = (surface, cell_volume(tree)) {
        writeln!(text, "  surface  unknown: {reason}")?;
    } else if let Some(surface) = surface {
        let (smooth, blocks) = (surface.smooth_area(), surface.block_area());
        let square = suffix(tree, "2");
        let faces: u64 = surface.faces.iter().sum();
        writeln!(
            text,
            "  surface  {smooth:.6}{square}, estimated from normals; {blocks}{square} of blocks ({faces} faces of cells)"
        )?;
    }
    if let (Some(world), Some(cells)) = (solid.world_centre(), solid.centre) {
        writeln!(text, "  centre   {} (cell {})", list(&world), list(&cells))?;
    }
    if let (Some([low, high]), Some(cells)) = (solid.world_bounds(), solid.bounds) {
        let (first, size) =
            (cells.min.map(|cell| cell.to_string()), cells.size().map(|size| size.to_string()));
        let (first, size) = (first.join(","), size.join(" x "));
        writeln!(text, "  bounds   {} to {} ({size} cells from {first})", list(&low), list(&high))?;
    }
    Ok(text)
}
