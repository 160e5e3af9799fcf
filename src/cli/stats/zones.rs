//! `spinney stats --zones`: statistics of the cells in polygons.

use std::fmt::Write;
use std::path::Path;

use anyhow::{Context, Result};
use serde_json::json;
use spinney::dataset::Dataset;
use spinney::import::feature::{
    AttributeCondition, FeatureFilter, FeatureOptions, PolygonFeature, PolygonLayer, read_polygons,
};
use spinney::query::{ZoneChannel, ZoneStatistics};
use spinney::space::{Coordinates, EdgeRule, Places};
use spinney::store::Metadata;
use spinney::value::Number;

use super::super::Global;
use super::super::args::{Memory, places};
use super::super::report::statistics::class_as_json;
use super::super::report::{Work, print_text, printable_json, warn};
use super::{cell_area, class_name, row_of};

/// Options for statistics of polygons.
#[derive(clap::Args)]
pub(super) struct ZoneOptions {
    /// Cells at the edge of a polygon: centre (those whose centre is inside), touch (all of them) or area (each by the part that is
    /// inside, exactly)
    #[arg(long, value_name = "RULE", default_value_t, requires = "zones")]
    edge: EdgeRule,
    /// Features alone for which all of this holds, as in 'type=Building,lod>=2': =, !=, <, <=, > or >= between an attribute and a value
    #[arg(long = "where", value_name = "CONDITION,...", value_delimiter = ',', requires = "zones")]
    conditions: Vec<AttributeCondition>,
    /// Attributes of features that --json and --csv tell, as in name,code [default: all; with --csv none]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', requires = "zones")]
    attribute: Option<Vec<String>>,
    #[command(flatten)]
    pub(super) memory: Memory,
}

/// Options for reading the features: attributes only where they are told.
fn reading(options: &ZoneOptions, format: Format) -> FeatureOptions {
    let attributes = match (&options.attribute, format) {
        (None, Format::Json) => None,
        (chosen, _) => Some(chosen.clone().unwrap_or_default()),
    };
    FeatureOptions {
        memory: options.memory.bytes,
        filter: FeatureFilter { conditions: options.conditions.clone() },
        attributes,
        ..FeatureOptions::default()
    }
}

/// Prints the statistics of each polygon of a file, of each of some layers.
pub(super) fn run(
    trees: &[Dataset],
    file: &Path,
    options: &ZoneOptions,
    coordinates: Option<&Coordinates>,
    format: Format,
    global: &Global,
) -> Result<()> {
    let layer = read_polygons(file, &reading(options, format)).map_err(|error| match error {
        // (All others name the file.)
        error @ spinney::Error::Invalid { .. } => {
            anyhow::Error::from(error).context(file.display().to_string())
        }
        error => error.into(),
    })?;
    let mut own = layer.coordinates();
    let has_system = trees.iter().all(|tree| tree.metadata().frame.crs.is_some());
    if !has_system && coordinates.is_none() && own != Coordinates::World {
        warn("the tree has no coordinate system: corners are taken to be in its own coordinates");
        own = Coordinates::World;
    }
    let trees: Vec<&Dataset> = trees.iter().collect();
    // The polygons are brought to each grid once, of which layers may share one.
    let same = Dataset::same_cells(&trees);
    let grids: Vec<usize> = (0..trees.len()).filter(|number| same[*number] == *number).collect();
    let places = grids.iter().map(|grid| {
        let (header, frame) = (trees[*grid].header(), &trees[*grid].metadata().frame);
        let coordinates = coordinates.unwrap_or(&own);
        // (What is to be said of a system is said once.)
        let places = match grid {
            0 => places(trees[0], coordinates)?,
            _ => Places::new(coordinates, frame, header.extent)?,
        };
        Ok((places, header.extent))
    });
    let polygons = layer
        .in_cells_of(&places.collect::<Result<Vec<_>>>()?)
        .with_context(|| file.display().to_string())?;
    let of_grid = |first: &usize| &polygons[grids.binary_search(first).expect("a grid of the list")][..];
    let asked: Vec<_> = trees.iter().copied().zip(same.iter().map(of_grid)).collect();
    let mut report = Report { trees: &trees, options, format, layer: &layer, next: 0, text: String::new() };
    report.begin();
    let mut failure = None;
    let work = Work::start(global, "polygons")?;
    let walked = Dataset::zonal_layers(&asked, options.edge, &work, &mut |zone| {
        report.add(&zone).map_err(|error| {
            failure = Some(error);
            spinney::Error::Interrupted
        })
    });
    failure.map_or(Ok(()), Err)?;
    walked?;
    drop(work);
    report.finish()
}

/// How statistics are printed.
#[derive(Clone, Copy)]
pub(super) enum Format {
    Text,
    Json,
    Csv,
}

/// Answers, feature by feature, as they are printed.
struct Report<'a> {
    trees: &'a [&'a Dataset],
    options: &'a ZoneOptions,
    format: Format,
    layer: &'a PolygonLayer,
    /// Number of the next feature.
    next: usize,
    /// Text that is not printed yet. (Of JSON, too, as text, which takes a tenth of what values would.)
    text: String,
}

/// Bytes of text that are held: more is printed before the end, so that memory does not grow with polygons times layers.
const MOST_TEXT: usize = 32 << 20;

impl Report<'_> {
    /// Begins the text before all features.
    fn begin(&mut self) {
        match self.format {
            Format::Json => self.text.push_str("{\n  \"zones\": ["),
            Format::Csv => self.text = self.csv_heading(),
            Format::Text => {}
        }
    }

    /// Prints the rest.
    fn finish(&mut self) -> Result<()> {
        if matches!(self.format, Format::Json) {
            self.text.push_str(if self.next > 0 { "\n  ]\n}\n" } else { "]\n}\n" });
        }
        self.print()
    }

    fn print(&mut self) -> Result<()> {
        match self.format {
            Format::Json => print_text(&printable_json(&self.text))?,
            Format::Text | Format::Csv => print_text(&self.text)?,
        }
        self.text.clear();
        Ok(())
    }

    /// Adds the statistics of the next feature, of all layers.
    fn add(&mut self, zones: &[ZoneStatistics]) -> Result<()> {
        let feature = &self.layer.features[self.next];
        self.next += 1;
        let name = self.layer.name(feature).unwrap_or_else(|| format!("#{}", self.next));
        let layers = || self.trees.iter().copied().zip(zones);
        match self.format {
            Format::Json => {
                let mut json = feature_json(self.layer, feature, self.options);
                match zones {
                    [zone] => json.extend(zone_json(self.trees[0], zone)),
                    _ => {
                        let rows = layers().map(|(tree, zone)| {
                            let mut row = serde_json::Map::new();
                            row.insert("layer".into(), json!(tree.metadata().name));
                            row.insert("time".into(), json!(tree.metadata().time));
                            row.extend(zone_json(tree, zone));
                            serde_json::Value::from(row)
                        });
                        json.insert("layers".into(), rows.collect());
                    }
                }
                let separator = if self.next > 1 { ",\n" } else { "\n" };
                let json = format!("{:#}", serde_json::Value::from(json));
                // (Strings in JSON have no ends of lines.)
                let lines: Vec<String> = json.lines().map(|line| format!("    {line}")).collect();
                self.text.extend([separator, &lines.join("\n")]);
            }
            Format::Text => {
                for (tree, zone) in layers() {
                    let Metadata { name: layer, time, .. } = tree.metadata();
                    let time = time.as_ref().map(|time| format!("  {time}")).unwrap_or_default();
                    let heading =
                        if zones.len() == 1 { name.clone() } else { format!("{name}  {layer}{time}") };
                    write_zone(&mut self.text, tree, &heading, zone)?;
                }
            }
            Format::Csv => {
                let attribute = |name: &String| self.layer.value(feature, name).to_text();
                let attributes = self.options.attribute.iter().flatten().map(attribute);
                let id = feature.id.as_ref().map(text_of).unwrap_or_default();
                let first: Vec<String> = [name, id].into_iter().chain(attributes).collect();
                for (tree, zone) in layers() {
                    write_rows(&mut self.text, &first, tree, zone);
                }
            }
        }
        if self.text.len() > MOST_TEXT { self.print() } else { Ok(()) }
    }

    /// The first line of a table.
    fn csv_heading(&self) -> String {
        let attributes = self.options.attribute.iter().flatten().map(String::as_str);
        let before = ["zone", "id"].into_iter().chain(attributes);
        let columns: Vec<&str> = before.chain(COLUMNS).collect();
        row_of(&columns)
    }
}

/// Columns of a table behind those of the feature.
const COLUMNS: [&str; 12] = [
    "layer",
    "time",
    "channel",
    "class",
    "cells",
    "void_cells",
    "area_m2",
    "min",
    "max",
    "mean",
    "standard_deviation",
    "class_name",
];

/// Rows of a table: one for each channel, or each class where classes are counted; one without numbers where there are no cells.
fn write_rows(text: &mut String, first: &[String], tree: &Dataset, zone: &ZoneStatistics) {
    let Metadata { name, time, .. } = tree.metadata();
    let area = cell_area(tree).ok();
    let area_of = |cells: f64| area.map(|area| (area * cells).to_string()).unwrap_or_default();
    let number = |number: f64| if number.is_nan() { String::new() } else { number.to_string() };
    let mut write = |own: [String; 10]| {
        let layer = [name.clone(), time.clone().unwrap_or_default()];
        let fields: Vec<&str> = first.iter().chain(&layer).chain(&own).map(String::as_str).collect();
        text.push_str(&row_of(&fields));
    };
    let none = String::new;
    let void = number(zone.void_cells);
    for (value, cells) in &zone.classes {
        let class = class_name(tree, *value).unwrap_or_default().to_string();
        let (value, cells, area) = (value.to_string(), number(*cells), area_of(*cells));
        write([none(), value, cells, void.clone(), area, none(), none(), none(), none(), class]);
    }
    if !zone.classes.is_empty() {
        return;
    }
    for (index, channel) in zone.channels.iter().enumerate() {
        let ZoneChannel { cells, min, max, mean, standard_deviation } = channel;
        let extreme = |extreme: &Number| if extreme.to_f64().is_nan() { none() } else { extreme.to_string() };
        let numbers = [extreme(min), extreme(max), number(*mean), number(*standard_deviation)];
        let [min, max, mean, deviation] = numbers;
        let (channel, area) = ((index + 1).to_string(), area_of(*cells));
        write([channel, none(), number(*cells), void.clone(), area, min, max, mean, deviation, none()]);
    }
    if zone.channels.is_empty() {
        let (cells, area) = (number(zone.cells), area_of(zone.cells));
        write([none(), none(), cells, void, area, none(), none(), none(), none(), none()]);
    }
}

/// An id as text.
fn text_of(value: &serde_json::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Members of a JSON object.
type Members = serde_json::Map<String, serde_json::Value>;

/// Id, name and attributes of a feature.
fn feature_json(layer: &PolygonLayer, feature: &PolygonFeature, options: &ZoneOptions) -> Members {
    let is_wanted = |name: &String| options.attribute.as_ref().is_none_or(|wanted| wanted.contains(name));
    let values = layer.attributes.iter().zip(&feature.attributes).filter(|((name, _), _)| is_wanted(name));
    let properties: Members = values.map(|((name, _), value)| (name.clone(), value.to_json())).collect();
    let members =
        [("id", json!(feature.id)), ("name", json!(layer.name(feature))), ("properties", properties.into())];
    members.into_iter().map(|(name, value)| (name.to_string(), value)).collect()
}

/// Statistics of a zone's cells.
fn zone_json(tree: &Dataset, zone: &ZoneStatistics) -> Members {
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
    let members = [
        ("cells", json!(zone.cells)),
        ("void_cells", json!(zone.void_cells)),
        ("area_m2", json!(area.map(|area| area * zone.cells))),
        ("channels", zone.channels.iter().map(channel).collect()),
        ("classes", zone.classes.iter().map(class).collect()),
    ];
    members.into_iter().map(|(name, value)| (name.to_string(), value)).collect()
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
