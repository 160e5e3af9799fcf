//! Statistics of polygons, as the program prints them.

use serde::Deserialize;
use serde_json::{Map, Value, json};
use spinney_base::space::EdgeRule;
use spinney_base::value::{Number, SampleType};
use spinney_base::{Error, Result};
use spinney_crs::{Coordinates, Places};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{ZonalRequest, ZoneChannel, ZoneMeasure, ZoneStatistics};
use spinney_vector::import::feature::Feature;
use spinney_vector::import::zones::{PolygonLayer, parse_polygons};

use crate::answer::{Found, sample};
use crate::files::Opened;
use crate::statistics::class;

/// Polygons, and what is asked of each.
#[derive(Deserialize)]
pub(crate) struct Request {
    /// GeoJSON, as text.
    zones: String,
    /// Coordinates of the corners, where these are not what the text says.
    crs: Option<String>,
    edge: Option<String>,
    #[serde(default)]
    measures: Vec<String>,
    #[serde(default)]
    quantiles: Vec<f64>,
    /// Layers that are asked, by their names; the open one if none are named.
    layers: Option<Vec<String>>,
}

/// Statistics of each polygon, of one layer or of several.
pub(crate) fn zonal(opened: &Opened, request: &Request) -> Result<Found> {
    let layer = parse_polygons(&request.zones)?;
    let own = opened.cells()?;
    let others: Vec<Dataset> = match &request.layers {
        None => Vec::new(),
        Some(names) => names.iter().map(|name| own.layer(name)).collect::<Result<_>>()?,
    };
    let trees: Vec<&Dataset> = if request.layers.is_none() { vec![own] } else { others.iter().collect() };
    let question = ZonalRequest {
        edge: request.edge.as_deref().map_or(Ok(EdgeRule::Area), str::parse)?,
        measures: request.measures.iter().map(|name| name.parse::<ZoneMeasure>()).collect::<Result<_>>()?,
        quantiles: request.quantiles.clone(),
        // (There are no temporary files.)
        memory: 1 << 30,
    };
    let has_system = trees.iter().all(|tree| tree.metadata().frame.crs.is_some());
    let coordinates = match &request.crs {
        Some(given) => given.parse()?,
        None if !has_system => Coordinates::World,
        None => layer.coordinates(),
    };
    let same = Dataset::same_cells(&trees);
    let grids: Vec<usize> = (0..trees.len()).filter(|number| same[*number] == *number).collect();
    let places = grids.iter().map(|grid| {
        let (header, frame) = (trees[*grid].header(), &trees[*grid].metadata().frame);
        Ok((Places::new(&coordinates, frame, header.extent)?, header.extent))
    });
    let places = places.collect::<Result<Vec<_>>>()?;
    let found = layer.in_cells_of(&places)?;
    if let Some(outside) = found.outside {
        return Err(outside);
    }
    let of_grid = |first: &usize| {
        grids.iter().position(|grid| grid == first).map_or(&[][..], |at| &found.trees[at][..])
    };
    let asked: Vec<_> = trees.iter().copied().zip(same.iter().map(of_grid)).collect();
    let mut zones: Vec<Value> = Vec::new();
    Dataset::zonal_layers(&asked, &question, &(), &mut |of_layers| {
        let feature = layer
            .features
            .get(zones.len())
            .ok_or_else(|| Error::invalid("zones", "one more", "as many as asked for"))?;
        let mut json = feature_json(&layer, feature);
        match (&of_layers[..], &request.layers) {
            ([zone], None) => json.extend(zone_json(trees[0], zone, &question.quantiles)),
            (of_layers, _) => {
                let rows = trees.iter().zip(of_layers).map(|(tree, zone)| {
                    let metadata = tree.metadata();
                    let mut row = members([("layer", json!(metadata.name)), ("time", json!(metadata.time))]);
                    row.extend(zone_json(tree, zone, &question.quantiles));
                    Value::from(row)
                });
                json.insert("layers".into(), rows.collect());
            }
        }
        zones.push(json.into());
        Ok(())
    })?;
    Ok(json!({ "zones": zones }).into())
}

fn members<const N: usize>(members: [(&str, Value); N]) -> Map<String, Value> {
    members.into_iter().map(|(name, value)| (name.to_string(), value)).collect()
}

/// Id, name and attributes of a feature.
fn feature_json(layer: &PolygonLayer, feature: &Feature) -> Map<String, Value> {
    let values = layer.attributes.iter().zip(&feature.attributes);
    let properties: Map<_, _> = values.map(|((name, _), value)| (name.clone(), value.to_json())).collect();
    members([
        ("id", json!(feature.id)),
        ("name", json!(layer.name(feature))),
        ("properties", properties.into()),
    ])
}

/// Statistics of a zone's cells.
fn zone_json(tree: &Dataset, zone: &ZoneStatistics, quantiles: &[f64]) -> Map<String, Value> {
    let (metadata, of) = (tree.metadata(), tree.header().form.value.sample);
    let area = metadata.frame.cell_square_metres().ok();
    let one_class = |(value, cells): &(Number, f64)| {
        json!({
            "value": class(*value, of),
            "name": metadata.class_names.get(value),
            "cells": cells,
            "area_m2": area.map(|area| area * cells),
        })
    };
    members([
        ("cells", json!(zone.cells)),
        ("void_cells", json!(zone.void_cells)),
        ("void_share", json!(zone.void_share())),
        ("outside_cells", json!(zone.outside_cells)),
        ("area_m2", json!(area.map(|area| area * zone.cells))),
        ("channels", zone.channels.iter().map(|channel| channel_json(channel, of, quantiles)).collect()),
        ("classes", zone.classes.iter().map(one_class).collect()),
    ])
}

fn channel_json(channel: &ZoneChannel, of: SampleType, quantiles: &[f64]) -> Value {
    let ZoneChannel { cells, min, max, sum, mean, standard_deviation, values } = channel;
    let mut json = json!({
        "cells": cells,
        "min": sample(*min, of),
        "max": sample(*max, of),
        "sum": sum,
        "mean": mean,
        "standard_deviation": standard_deviation,
    });
    if let Some(values) = values {
        json["majority"] = class(values.majority, of);
        json["minority"] = class(values.minority, of);
        json["variety"] = json!(values.variety);
        json["median"] = json!(values.median);
        let quantiles = quantiles.iter().zip(&values.quantiles);
        json["quantiles"] = quantiles.map(|(at, value)| (at.to_string(), json!(value))).collect();
    }
    json
}
