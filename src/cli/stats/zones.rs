//! `spinney stats --zones`: statistics of the cells in polygons.

use std::fmt::Write;
use std::path::Path;

use anyhow::{Context, Result};
use serde_json::json;
use spinney::dataset::Dataset;
use spinney::import::geojson::{PolygonFeature, read_polygons};
use spinney::query::{ZoneChannel, ZoneRule, ZoneStatistics};

use super::super::Global;
use super::super::report::statistics::class_as_json;
use super::super::report::{Work, print_json, print_text};
use super::{cell_area, class_name};

/// Ways in which cells on a polygon's border count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum BorderCells {
    /// Whole if their centre is inside
    #[default]
    Centre,
    /// By the part of their area that is inside, exactly
    Area,
}

/// Prints the statistics of each polygon of a GeoJSON file.
pub(super) fn run(
    tree: &Dataset,
    file: &Path,
    border: BorderCells,
    as_json: bool,
    global: &Global,
) -> Result<()> {
    let features = read_polygons(file)?;
    let frame = &tree.metadata().frame;
    let polygons = features.iter().enumerate().map(|(number, feature)| {
        feature.in_cells(frame).with_context(|| format!("{}: feature {}", file.display(), number + 1))
    });
    let polygons = polygons.collect::<Result<Vec<_>>>()?;
    let rule = match border {
        BorderCells::Centre => ZoneRule::Centre,
        BorderCells::Area => ZoneRule::Area,
    };
    let zones = tree.zonal(&polygons, rule, &Work::start(global, "polygons")?)?;
    if as_json {
        let zones: Vec<_> =
            features.iter().zip(&zones).map(|(feature, zone)| json_of(tree, feature, zone)).collect();
        return print_json(&json!({ "zones": zones }));
    }
    let mut text = String::new();
    for (number, (feature, zone)) in features.iter().zip(&zones).enumerate() {
        let number = format!("#{}", number + 1);
        write_zone(&mut text, tree, feature.name.as_deref().unwrap_or(&number), zone)?;
    }
    print_text(&text)
}

fn json_of(tree: &Dataset, feature: &PolygonFeature, zone: &ZoneStatistics) -> serde_json::Value {
    let area = cell_area(tree).ok();
    let channel = |channel: &ZoneChannel| {
        let ZoneChannel { cells, min, max, mean, standard_deviation } = channel;
        json!({ "cells": cells, "min": min, "max": max, "mean": mean, "standard_deviation": standard_deviation })
    };
    let class = |(value, cells): &(f64, f64)| {
        json!({
            "value": class_as_json(*value),
            "name": class_name(tree, *value),
            "cells": cells,
            "area_m2": area.map(|area| area * cells),
        })
    };
    json!({
        "name": feature.name,
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
