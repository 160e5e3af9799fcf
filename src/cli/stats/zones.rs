//! `spinney stats --zones`: statistics of the cells in polygons.

use std::fmt::Write;
use std::path::Path;
use std::slice;

use anyhow::{Context, Result};
use serde_json::json;
use spinney::dataset::Dataset;
use spinney::import::geojson::{PolygonFeature, PolygonLayer, read_polygons};
use spinney::query::{ZoneChannel, ZoneStatistics};
use spinney::space::{Coordinates, EdgeRule, Polygon};
use spinney::value::Number;

use super::super::Global;
use super::super::args::{Memory, places};
use super::super::report::statistics::class_as_json;
use super::super::report::{Work, print_json, print_text, warn};
use super::{cell_area, class_name};

/// Options for statistics of polygons.
#[derive(clap::Args)]
pub(super) struct ZoneOptions {
    /// Cells at the edge of a polygon: centre (those whose centre is inside), touch (all of them) or area (each by the part that is
    /// inside, exactly)
    #[arg(long, value_name = "RULE", default_value_t, requires = "zones")]
    edge: EdgeRule,
    /// Features with these values of attributes alone, as in 'type=Building,lod=2.2'
    #[arg(long = "where", value_name = "NAME=VALUE,...", value_delimiter = ',', value_parser = parse_equality)]
    #[arg(requires = "zones")]
    equalities: Vec<(String, String)>,
    /// Attributes of features that --json tells, as in name,code [default: all]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', requires = "zones")]
    attribute: Option<Vec<String>>,
    #[command(flatten)]
    memory: Memory,
}

/// Reads an attribute's name and its value.
fn parse_equality(text: &str) -> Result<(String, String), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE, as in type=Building")?;
    Ok((name.trim().into(), value.trim().into()))
}

/// Keeps the features that are asked for; fails if attributes are asked for that there are not.
fn select(layer: &mut PolygonLayer, options: &ZoneOptions) -> spinney::Result<()> {
    let names: Vec<&str> = options.attribute.iter().flatten().map(String::as_str).collect();
    PolygonLayer::check_attributes(slice::from_ref(layer), &names)?;
    PolygonLayer::select(slice::from_mut(layer), &options.equalities)
}

/// Prints the statistics of each polygon of a GeoJSON file.
pub(super) fn run(
    tree: &Dataset,
    file: &Path,
    options: &ZoneOptions,
    coordinates: Option<&Coordinates>,
    as_json: bool,
    global: &Global,
) -> Result<()> {
    let mut layer = read_polygons(file, options.memory.bytes)?;
    select(&mut layer, options).with_context(|| file.display().to_string())?;
    let frame = &tree.metadata().frame;
    let mut own = layer.coordinates();
    if frame.crs.is_none() && coordinates.is_none() && own != Coordinates::World {
        warn("the tree has no coordinate system: corners are taken to be in its own coordinates");
        own = Coordinates::World;
    }
    let places = places(tree, coordinates.unwrap_or(&own))?;
    let polygons =
        layer.in_cells(&places, tree.header().extent).with_context(|| file.display().to_string())?;
    let features = &layer.features;
    // (Features that lie outside of the tree have no cells.)
    let met: Vec<Polygon> = polygons.iter().flatten().cloned().collect();
    let mut found = tree.zonal(&met, options.edge, &Work::start(global, "polygons")?)?.into_iter();
    let zone_of = |polygon: &Option<Polygon>| polygon.as_ref().and_then(|_| found.next()).unwrap_or_default();
    let zones: Vec<ZoneStatistics> = polygons.iter().map(zone_of).collect();
    if as_json {
        let zones: Vec<_> = features
            .iter()
            .zip(&zones)
            .map(|(feature, zone)| json_of(tree, feature, zone, options))
            .collect();
        return print_json(&json!({ "zones": zones }));
    }
    let mut text = String::new();
    for (number, (feature, zone)) in features.iter().zip(&zones).enumerate() {
        let number = format!("#{}", number + 1);
        write_zone(&mut text, tree, &feature.name().unwrap_or(number), zone)?;
    }
    print_text(&text)
}

fn json_of(
    tree: &Dataset,
    feature: &PolygonFeature,
    zone: &ZoneStatistics,
    options: &ZoneOptions,
) -> serde_json::Value {
    let is_wanted = |name: &String| options.attribute.as_ref().is_none_or(|wanted| wanted.contains(name));
    let properties = feature.properties.iter().filter(|(name, _)| is_wanted(name));
    let properties: serde_json::Map<_, _> =
        properties.map(|(name, value)| (name.clone(), value.clone())).collect();
    let area = cell_area(tree).ok();
    let channel = |channel: &ZoneChannel| {
        let ZoneChannel { cells, min, max, mean, standard_deviation } = channel;
        json!({ "cells": cells, "min": min, "max": max, "mean": mean, "standard_deviation": standard_deviation })
    };
    let class = |(value, cells): &(Number, f64)| {
        json!({
            "value": class_as_json(*value),
            "name": class_name(tree, *value),
            "cells": cells,
            "area_m2": area.map(|area| area * cells),
        })
    };
    json!({
        "id": feature.id,
        "name": feature.name(),
        "properties": properties,
        "cells": zone.cells,
        "void_cells": zone.void_cells,
        "area_m2": area.map(|area| area * zone.cells),
        "channels": zone.channels.iter().map(channel).collect::<Vec<_>>(),
        "classes": zone.classes.iter().map(class).collect::<Vec<_>>(),
    })
}

fn write_zone(text: &mut String, tree: &Dataset, name: &str, zone: &ZoneStatistics) -> Result<()> {
    let area = cell_area(tree);
    write!(text, "{name}  {} cells, and {} VOID", rounded(zone.cells), rounded(zone.void_cells))?;
    match area {
        Ok(area) => writeln!(text, "  {:.0} m2", area * zone.cells)?,
        Err(_) => writeln!(text)?,
    }
    for (value, cells) in &zone.classes {
        let share = 100.0 * cells / zone.cells;
        write!(text, "{value:>8} {:>14} cells {share:>8.4} %", rounded(*cells))?;
        if let Ok(area) = area {
            write!(text, " {:>16.0} m2", area * cells)?;
        }
        writeln!(text, "  {}", class_name(tree, *value).unwrap_or_default())?;
    }
    if zone.classes.is_empty() {
        for (index, channel) in zone.channels.iter().enumerate() {
            let ZoneChannel { min, max, mean, standard_deviation, .. } = channel;
            writeln!(
                text,
                "  channel {}  min {min}  max {max}  mean {mean:.6}  standard deviation {standard_deviation:.6}",
                index + 1
            )?;
        }
    }
    Ok(())
}

/// A number of cells, which may not be whole.
fn rounded(cells: f64) -> String {
    if cells.fract() == 0.0 { format!("{cells:.0}") } else { format!("{cells:.3}") }
}
