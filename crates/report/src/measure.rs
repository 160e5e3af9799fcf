//! Areas and volumes of cells.

use spinney_base::value::Rule;
use spinney_container::Tag;
use spinney_engine::dataset::Dataset;

/// Returns the unit of a tree's world coordinates: that of the model, or of the coordinate
/// reference system, or cells if the frame is the identity. Returns `None` if the unit is unknown.
pub fn world_unit(tree: &Dataset) -> Option<&str> {
    let (metadata, frame) = (tree.metadata(), &tree.metadata().frame);
    metadata.tag(Tag::Unit).or_else(|| match &frame.crs {
        Some(crs) => crs.unit(),
        None => frame.is_identity().then_some("cells"),
    })
}

/// Size of a tree's cells in the world: area in quadtrees, volume in octrees.
#[derive(Clone, Debug, PartialEq)]
pub struct CellMeasure {
    /// Area or volume of a cell.
    pub of_cell: f64,
    /// Unit: `m2` for areas. For volumes, the cube of the world unit, such as `m3`; `unit3` if that
    /// is unknown, or `cells`.
    pub unit: String,
    has_volume: bool,
    /// Whether values are fullness.
    is_solid: bool,
}

impl CellMeasure {
    /// Returns the size of a tree's cells.
    ///
    /// # Errors
    /// If cells differ in size, or the units of the axes differ or are unknown: the reason.
    pub fn of(tree: &Dataset) -> Result<CellMeasure, &'static str> {
        let frame = &tree.metadata().frame;
        if !has_volume(tree) {
            let of_cell = frame.cell_square_metres()?;
            return Ok(CellMeasure { of_cell, unit: "m2".into(), has_volume: false, is_solid: false });
        }
        let of_cell = frame.cell_volume()?;
        let unit = match world_unit(tree) {
            Some("cells") => "cells".into(),
            unit => format!("{}3", unit.unwrap_or("unit")),
        };
        let header = tree.header();
        let is_solid = header.rule == Rule::Occupancy && header.form.value.channels == 1;
        Ok(CellMeasure { of_cell, unit, has_volume: true, is_solid })
    }

    /// Returns the number of full cells with the volume of `cells` cells whose mean value is
    /// `mean`: fewer in octrees of occupancy, where a cell may be full in part. In all other trees,
    /// `cells`.
    pub fn filled(&self, cells: f64, mean: Option<f64>) -> f64 {
        match mean {
            Some(mean) if self.is_solid && cells > 0.0 => cells * mean / 255.0,
            _ => cells,
        }
    }

    /// Formats the area or volume of `cells` cells with its unit: areas as integers, volumes with
    /// up to six decimals.
    pub fn text(&self, cells: f64) -> String {
        let measure = self.of_cell * cells;
        match self.has_volume {
            true => format!("{} {}", (measure * 1e6).round() / 1e6, self.unit),
            false => format!("{measure:.0} {}", self.unit),
        }
    }
}

fn has_volume(tree: &Dataset) -> bool {
    tree.header().form.axes() == 3
}

/// Returns the name of what is measured: `area` or `volume`.
pub fn measure_name(tree: &Dataset) -> &'static str {
    if has_volume(tree) { "volume" } else { "area" }
}

/// Returns the JSON member and table column for the measure: `area_m2`, or `volume` in the cube of
/// the world unit.
pub fn measure_key(tree: &Dataset) -> &'static str {
    if has_volume(tree) { "volume" } else { "area_m2" }
}
