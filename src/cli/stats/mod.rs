//! `spinney stats`: exact statistics of any region.

mod labels;
mod zones;

use std::path::PathBuf;

use anyhow::{Result, ensure};
use serde_json::json;
use spinney::import::feature::FeatureFilter;
use spinney::query::Statistics;
use spinney::raw::report::{
    CellMeasure, JsonNumbers, bins_with, class_name, filled, integral, measure_name, statistics_as_json,
    statistics_of, void_share,
};
use spinney::{Dataset, Rule};

use super::args::{PartOptions, ViewedTree, level_of};
use super::lines;
use super::points::{self, PointSelection};
use super::report::{Work, csv_field, print_json, print_text, solid};
use super::{Global, exact};

const EXAMPLES: &str = "Examples:
  spinney stats relief.goblin --in world --window 5,44,17,48
  spinney stats landcover.goblin --window 0,0,4096,4096 --json
  spinney stats landcover.goblin --zones districts.gpkg --csv
  spinney stats house.goblin --surface";

/// Print exact statistics of a region, of zones, labels, objects or a solid
///
/// Areas are in square metres, for projected coordinate systems in metres except Web Mercator.
/// Volumes are in the cube of the tree's unit, unless its axes have different units.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    #[command(flatten)]
    part: PartOptions,
    /// Bins of the histogram of the first channel: at most 65536; 0 for none. Files that count
    /// classes have no histogram
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(..=65536))]
    bins: u32,
    /// Print volume, centre and bounds of an octree: also if its values are not occupancy
    #[arg(long)]
    solid: bool,
    /// Print the surface of a solid, too; implies --solid
    #[arg(long)]
    surface: bool,
    /// Level of detail at which a solid is measured [default: the deepest]
    #[arg(long, value_name = "LEVEL")]
    level: Option<u8>,
    /// Polygons in a feature file, as GeoJSON, GeoPackage (x.gpkg:NAME is one layer of several),
    /// FlatGeobuf, shapefile or CSV: statistics of the cells in each
    #[arg(long, value_name = "FILE", group = "table", conflicts_with_all = ["window", "solid", "surface", "level"])]
    zones: Option<PathBuf>,
    /// Each object of an exact model has a row: name, type, whether it is closed, volume, area,
    /// heights, centre and attributes; as a table, or as features with their bounding rectangles
    #[arg(long, group = "table", conflicts_with_all = ["window", "solid", "surface", "level", "zones", "labels"])]
    each: bool,
    /// Count vertices, edges, shells and handles of an exact model, too; this reads all faces
    #[arg(long, conflicts_with = "table")]
    topology: bool,
    /// Find the nearest line to each point of a feature file (trees of lines); -o writes the points
    /// with the number of its feature (`line`, from 0), the `distance`, and its attributes
    #[arg(long, value_name = "POINTS", group = "table", conflicts_with_all = ["window", "solid", "surface", "level", "zones", "labels", "each"])]
    nearest: Option<PathBuf>,
    /// Lines of a feature file: count their crossings with a tree of lines, including touches; -o
    /// writes a point for each crossing, with the attributes of the file's feature, the number of
    /// the tree's (`line`, from 0), and its attributes
    #[arg(long, value_name = "LINES", group = "table", conflicts_with_all = ["window", "solid", "surface", "level", "zones", "labels", "each", "nearest"])]
    crossing: Option<PathBuf>,
    /// Maximum distance of the nearest line [default: any], or of the lines of --crossing [default:
    /// 0, those that cross or touch]
    #[arg(long, value_name = "DISTANCE")]
    radius: Option<f64>,
    #[command(flatten)]
    zone_options: zones::ZoneOptions,
    #[command(flatten)]
    label_options: labels::LabelOptions,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Print a table as CSV: a row for each zone, layer, and channel or class, or for each label
    #[arg(long, requires = "table", conflicts_with = "json")]
    csv: bool,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    if let Some(view) = args.tree.open_model(global)? {
        let fitting: &[&str] = match args.each {
            true => &["--each", "--where", "--output", "--csv", "--view"],
            false => &["--topology", "--json", "--view"],
        };
        global.check_options(&args.tree.file, exact::KIND, fitting)?;
        if args.each {
            let zones::ZoneOptions { conditions, memory, .. } = &args.zone_options;
            let filter = FeatureFilter { conditions: conditions.clone() };
            exact::each(&view, filter, args.label_options.output.as_deref(), memory.bytes, global)?;
            return Ok(view.file().check_unchanged()?);
        }
        let memory = args.topology.then_some(args.zone_options.memory.bytes);
        exact::stats(&view, memory, args.json, global)?;
        return Ok(view.file().check_unchanged()?);
    }
    if let Some(tree) = lines::open(&args.tree.file, global)? {
        let fitting: &[&str] = match (&args.nearest, &args.crossing) {
            (Some(_), _) => &["--nearest", "--radius", "--attribute", "--output", "--json"],
            (None, Some(_)) => &["--crossing", "--radius", "--attribute", "--output", "--json"],
            (None, None) => &["--window", "--in", "--json"],
        };
        global.check_options(&args.tree.file, lines::KIND, fitting)?;
        let request = match (&args.nearest, &args.crossing) {
            (Some(points), _) => lines::Join::Nearest(points, args.radius.unwrap_or(f64::INFINITY)),
            (None, Some(lines)) => lines::Join::Crossing(lines, args.radius.unwrap_or(0.0)),
            (None, None) => return lines::stats(&tree, lines::window(&tree, &args.part)?, args.json, global),
        };
        let names = args.zone_options.attribute.as_deref();
        let output = args.label_options.output.as_deref();
        return lines::join(&tree, request, names, output, (args.json, global));
    }
    ensure!(
        args.nearest.is_none() && args.crossing.is_none() && args.radius.is_none(),
        "--nearest, --crossing and --radius: work only with trees of lines"
    );
    if let Some(tree) = points::open(&args.tree.file, global)? {
        global.check_options(&args.tree.file, points::KIND, &["--window", "--in", "--level", "--json"])?;
        let selection = PointSelection::default().selection(&tree, &args.part, args.level, global)?;
        return points::stats(&tree, &selection, args.json, global);
    }
    ensure!(!args.topology, "--topology: works only with exact models");
    ensure!(!args.each, "--each: works only with exact models; for trees, use --labels or --zones");
    check_modes(args, global)?;
    if args.label_options.labels {
        return labels::run(args, global);
    }
    let trees = args.tree.open_all(global)?;
    if args.zones.is_some() {
        return zones_of(args, &trees, global);
    }
    let several = trees.len() > 1;
    let mut all = Vec::new();
    for tree in &trees {
        if several && !args.json {
            print_text(&format!("layer      {}\n", tree.metadata().name))?;
        }
        all.extend(of_layer(args, tree, global)?);
    }
    match &all[..] {
        [] => {}
        [one] if !several => print_json(one)?,
        all => print_json(&json!({ "layers": all }))?,
    }
    Ok(())
}

/// Fails for options that do not fit the requested table or statistics.
fn check_modes(args: &Args, global: &Global) -> Result<()> {
    let (mode, fitting): (_, &[&str]) = if args.label_options.labels {
        ("--labels", &["--labels", "--connect", "--classes", "--output", "--json", "--csv"])
    } else if args.zones.is_some() {
        let of_zones = &[
            "--zones",
            "--in",
            "--edge",
            "--measure",
            "--quantiles",
            "--where",
            "--attribute",
            "--output",
            "--json",
            "--csv",
        ];
        ("--zones", of_zones)
    } else {
        ("statistics of a tree", &["--window", "--in", "--bins", "--solid", "--surface", "--level", "--json"])
    };
    global.given().check(mode, &[fitting, &["--view", "--layer"]].concat())?;
    let has_columns = args.zones.is_none() || args.json || args.csv || args.label_options.output.is_some();
    let has_attributes = args.zone_options.attribute.is_some();
    ensure!(has_columns || !has_attributes, "--attribute: works only with --json, --csv or --output");
    let has_place = args.part.is_given() || args.zones.is_some();
    ensure!(
        has_place || args.part.coordinates().given().is_none(),
        "--in: works only with --window or --zones"
    );
    Ok(())
}

/// Prints or writes statistics of zones.
fn zones_of(args: &Args, trees: &[Dataset], global: &Global) -> Result<()> {
    if let Some(file) = &args.zones {
        if let Some(output) = &args.label_options.output {
            ensure!(
                !args.json && !args.csv,
                "--json and --csv: work only without --output, whose name determines the format"
            );
            let coordinates = args.part.coordinates().given();
            zones::write(trees, file, &args.zone_options, coordinates, output, global)?;
            return Ok(trees.iter().try_for_each(Dataset::check_unchanged)?);
        }
        let format = match (args.json, args.csv) {
            (true, _) => zones::Format::Json,
            (_, true) => zones::Format::Csv,
            _ => zones::Format::Text,
        };
        zones::run(trees, file, &args.zone_options, args.part.coordinates().given(), format, global)?;
        trees.iter().try_for_each(Dataset::check_unchanged)?;
    }
    Ok(())
}

/// Prints statistics of one layer, or returns them as JSON.
fn of_layer(args: &Args, tree: &Dataset, global: &Global) -> Result<Option<serde_json::Value>> {
    let boxes = args.part.boxes(tree)?;
    let is_octree = tree.header().form.axes() == 3;
    let is_solid_query = args.solid || args.surface || args.level.is_some();
    ensure!(
        !is_solid_query || is_octree,
        "{}: is a quadtree; --solid, --surface and --level work only with octrees",
        args.tree.file.display()
    );
    ensure!(
        !is_solid_query || boxes.is_none(),
        "--solid, --surface and --level: measure the whole octree; for a region, add --view window=..."
    );
    let is_solid = is_octree && tree.header().rule == Rule::Occupancy && boxes.is_none();
    let stats = statistics_of(tree, boxes.as_deref())?;
    let default_region = tree.header().extent_bounds();
    let boxes = boxes.unwrap_or(vec![default_region]);
    let histogram = bins_with(tree, &boxes, &stats, args.bins)?;
    // Last, since a signal ends the program at once before `Work::start`.
    let measured = if is_solid_query || is_solid {
        let work = Work::start(global, "cells")?;
        let level = level_of(tree, args.level)?;
        let solid = tree.solid(level, &work)?;
        Some((solid, args.surface.then(|| tree.solid_surface(level, &work)).transpose()?))
    } else {
        None
    };
    if args.json {
        let mut json = statistics_as_json(tree, &stats, &histogram, JsonNumbers::Plain);
        if let Some((measured, surface)) = &measured {
            json["solid"] = solid::as_json(tree, measured, surface.as_ref());
        }
        tree.check_unchanged()?;
        return Ok(Some(json));
    }
    {
        print(tree, &stats, &histogram)?;
        if let Some((measured, surface)) = measured {
            print_text(&solid::as_text(tree, &measured, surface.as_ref())?)?;
        }
    }
    tree.check_unchanged()?;
    Ok(None)
}

/// Formats a row of a CSV table, with plain line feeds.
fn row_of(fields: &[&str]) -> String {
    fields.iter().map(|field| csv_field(field)).collect::<Vec<_>>().join(",") + "\n"
}

/// Prints statistics as text.
fn print(tree: &Dataset, stats: &Statistics, histogram: &[(f64, u64)]) -> Result<()> {
    use std::fmt::Write;
    let mut text = String::new();
    let measure = CellMeasure::of(tree);
    write!(text, "cells      {}, and {} VOID", stats.cells, stats.void_cells)?;
    match void_share(stats) {
        Some(share) if share > 0.0 => writeln!(text, " ({:.4} %)", 100.0 * share)?,
        _ => writeln!(text)?,
    }
    match &measure {
        Ok(measure) => {
            writeln!(text, "{:<10} {}", measure_name(tree), measure.text(filled(measure, stats)))?;
        }
        Err(reason) => writeln!(text, "{:<10} unknown: {reason}", measure_name(tree))?,
    }
    if stats.classes.is_empty() {
        for (index, channel) in stats.channels.iter().enumerate() {
            let name = tree.metadata().band_names.get(index).filter(|name| !name.is_empty());
            writeln!(
                text,
                "channel {}  min {}  max {}  mean {:.6}  standard deviation {:.6}{}{}",
                index + 1,
                channel.min,
                channel.max,
                channel.mean,
                channel.standard_deviation,
                if channel.cells < stats.cells {
                    format!("  of {} cells", channel.cells)
                } else {
                    String::new()
                },
                name.map(|name| format!("  ({name})")).unwrap_or_default()
            )?;
        }
        if let (Some(integral), Ok(measure)) = (integral(tree, stats), &measure) {
            let unit = &measure.unit;
            writeln!(text, "integral   {integral} (sum of the values times the volume of a cell in {unit})")?;
        }
        let most = histogram.iter().map(|(_, cells)| *cells).max().unwrap_or(0).max(1);
        for (from, cells) in histogram {
            let bar = "#".repeat((*cells * 40 / most) as usize);
            writeln!(text, "{from:>14.4} {cells:>14} {bar}")?;
        }
    } else {
        for (value, cells) in &stats.classes {
            let share = 100.0 * *cells as f64 / stats.cells as f64;
            write!(text, "{value:>8} {cells:>14} cells {share:>8.4} %")?;
            if let Ok(measure) = &measure {
                write!(text, " {:>19}", measure.text(*cells as f64))?;
            }
            writeln!(text, "  {}", class_name(tree, *value).unwrap_or_default())?;
        }
    }
    print_text(&text)
}
