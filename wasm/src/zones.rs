//! Statistics of polygons, as printed by the program.

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::space::EdgeRule;
use spinney_base::{Error, Result};
use spinney_crs::{CellLocator, Coordinates};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{ZonalRequest, ZoneMeasure};
use spinney_report::{JsonNumbers, ZoneForm};
use spinney_vector::import::feature::FeatureOptions;
use spinney_vector::import::zones::parse_polygons;

use crate::files::Opened;
use crate::result::Found;

/// Polygons, and the requested statistics.
#[derive(Deserialize)]
pub(crate) struct Request {
    /// GeoJSON, as a string.
    zones: String,
    /// Coordinate system of the vertices, if it is not that of the GeoJSON.
    crs: Option<String>,
    edge: Option<String>,
    #[serde(default)]
    measures: Vec<String>,
    #[serde(default)]
    quantiles: Vec<f64>,
    /// Requested layers by name, by default the open one.
    layers: Option<Vec<String>>,
}

/// Returns the statistics of each polygon, of one layer or of several.
pub(crate) fn zonal(opened: &Opened, request: &Request) -> Result<Found> {
    let own = opened.cells()?;
    let others: Vec<Dataset> = match &request.layers {
        None => Vec::new(),
        Some(names) => names.iter().map(|name| own.layer(name)).collect::<Result<_>>()?,
    };
    let trees: Vec<&Dataset> = if request.layers.is_none() { vec![own] } else { others.iter().collect() };
    let zonal_request = ZonalRequest {
        edge: request.edge.as_deref().map_or(Ok(EdgeRule::Area), str::parse)?,
        measures: request.measures.iter().map(|name| name.parse::<ZoneMeasure>()).collect::<Result<_>>()?,
        quantiles: request.quantiles.clone(),
        // (There are no temporary files.)
        memory: 1 << 30,
    };
    let has_system = trees.iter().all(|tree| tree.metadata().frame.crs.is_some());
    let check_degrees = request.crs.is_none() && has_system;
    let layer =
        parse_polygons(&request.zones, &FeatureOptions { check_degrees, ..FeatureOptions::default() })?;
    let coordinates = match &request.crs {
        Some(crs) => crs.parse()?,
        None if !has_system => Coordinates::World,
        None => layer.coordinates(),
    };
    let same = Dataset::same_cells(&trees);
    let grids: Vec<usize> = (0..trees.len()).filter(|number| same[*number] == *number).collect();
    let locators = grids.iter().map(|grid| {
        let (header, frame) = (trees[*grid].header(), &trees[*grid].metadata().frame);
        Ok((CellLocator::new(&coordinates, frame, header.extent)?, header.extent))
    });
    let locators = locators.collect::<Result<Vec<_>>>()?;
    let found = layer.in_cells_of(&coordinates, &locators)?;
    if let Some(outside) = found.outside {
        return Err(outside);
    }
    let of_grid = |first: &usize| {
        grids.iter().position(|grid| grid == first).map_or(&[][..], |at| &found.trees[at][..])
    };
    let tree_zones: Vec<_> = trees.iter().copied().zip(same.iter().map(of_grid)).collect();
    let form = ZoneForm {
        trees: &trees,
        quantiles: &zonal_request.quantiles,
        attributes: None,
        has_layers: request.layers.is_some(),
        numbers: JsonNumbers::Marked,
    };
    let mut zones: Vec<Value> = Vec::new();
    Dataset::zonal_layers(&tree_zones, &zonal_request, &(), &mut |of_layers| {
        if zones.len() == layer.features.len() {
            return Err(Error::invalid("zones", "more results", "one per polygon"));
        }
        zones.push(form.as_json(&layer, zones.len(), &of_layers));
        Ok(())
    })?;
    Ok(json!({ "zones": zones }).into())
}
