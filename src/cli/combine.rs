//! `spinney combine`: merges several trees into one.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, bail, ensure};
use serde_json::json;
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::ops::{self, Prefer};
use spinney::raw::report::class_as_json;
use spinney::raw::shards::JobSpec;
use spinney::{CombineOperation, CombineOptions, Number, Universe};

use super::args::{
    Memory, OperationName, OutputLimit, Packing, ReconcileArgs, check_output, numbers, parse_operation,
};
use super::features::{FeatureOperands, are_mixed};
use super::overlay::{self, PairQuery, Region};
use super::report::{Work, print_json, print_text, report_output};
use super::{Global, exact};

/// Combine trees: union, intersection, difference, overlay, changes
///
/// Files are traversed together, in place on disk. Where one file decides, the other files'
/// subtrees are not read, and its stored records are copied unchanged. The result has the first
/// file's cells, over the extents of all files (--extent). Other files are converted to the first:
/// cells and coordinate system (resampled by their rule), type, scale, unit and numbers of classes.
/// Conversions are reported. Rule, names and colours are those of the first file, with new classes
/// added. Features are rasterized to the cells of the trees, as by `spinney build`; those outside
/// are ignored.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    merging: MergingArgs,
    /// File to write; - is standard output
    #[arg(short, long, value_name = "OUT.goblin")]
    output: Option<PathBuf>,
    /// Width of the grid units for vertices of polygons: in units of the coordinates, rounded down
    /// to a power of two [default: 2^-42 of the largest coordinate]
    #[arg(long, value_name = "WIDTH")]
    snap: Option<f64>,
    /// Print which faces of two exact models are kept or reversed, and the table of node kinds that
    /// decides, with counts
    #[arg(long)]
    explain: bool,
    /// Print JSON: the table of `cross`
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    packing: Packing,
    #[command(flatten)]
    limit: OutputLimit,
    #[command(flatten)]
    features: FeatureOperands,
}

/// Files, and the operation that merges them.
#[derive(clap::Args)]
pub(crate) struct MergingArgs {
    /// Operation; `spinney help combine` lists them
    #[arg(value_parser = parse_operation)]
    operation: OperationName,
    /// Tree files of one kind, and feature files to be rasterized to their cells; exact models; or
    /// only polygon files
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Which file's value wins where a set operation finds both: a or b
    #[arg(long, value_name = "WHOSE", default_value = "a", value_parser = ["a", "b", "first", "second"])]
    values: String,
    /// Value of cells that a set operation makes of VOID cells [default: 255 for bytes, else 1]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    fill: Option<Number>,
    /// Region in which an operation fills cells that neither file has: a box in world coordinates
    /// (west, south, east, north; for octrees all minimum and then all maximum coordinates); for
    /// polygons also a polygon file, for all operations [default: a raster's extent, an octree's
    /// root]
    #[arg(long, value_name = "BOX", value_parser = parse_within, conflicts_with = "margin")]
    within: Option<Within>,
    /// Fill cells that neither file has, in the files' extents (and this many cells around them)
    #[arg(long, value_name = "CELLS")]
    margin: Option<u32>,
    #[command(flatten)]
    reconcile: ReconcileArgs,
}

impl MergingArgs {
    /// Returns the operation on trees, and the region in which it fills cells that no tree has.
    fn on_trees(&self) -> Result<(CombineOperation, Universe)> {
        let within = match &self.within {
            Some(Within::Box(low, high)) => Some(Universe::Within(*low, *high)),
            Some(Within::Polygons(path)) => {
                bail!(
                    "--within: {} is a polygon file, which works only with polygons; give a box",
                    path.display()
                )
            }
            None => None,
        };
        let name = &self.operation;
        let prefer =
            if self.values == "a" || self.values == "first" { Prefer::First } else { Prefer::Second };
        ensure!(!name.is_partition(), "partition: works only with polygon files");
        let operation = name.operation(prefer).with_context(|| format!("{}: unknown operation", name.0))?;
        let universe = within.or(self.margin.map(Universe::Margin));
        ensure!(
            universe.is_none() || operation.needs_universe(),
            "--within and --margin: work only with operations from 8 on, which fill cells that neither file has"
        );
        Ok((operation, universe.unwrap_or_default()))
    }

    /// Returns the job of combining trees of cells.
    pub(crate) fn spec(&self, packing: spinney::raw::store::Packing, global: &Global) -> Result<JobSpec> {
        let name = &self.operation.0;
        ensure!(
            !self.operation.is_table(),
            "{name}: prints a table, which shards do not support; use `spinney combine {name}`"
        );
        if let Some(file) = self.files.iter().find(|file| is_feature_file(file)) {
            bail!(
                "{}: is a feature file, which shards do not support; use `spinney combine {name}`",
                file.display()
            )
        }
        ensure!(
            !exact::any_model(&self.files, global)?,
            "shards do not support exact models; use `spinney combine {name}`"
        );
        let (operation, universe) = self.on_trees()?;
        let (inputs, fill) = (self.files.clone(), self.fill);
        let options = CombineOptions { fill, universe, reconcile: self.reconcile.options() };
        Ok(JobSpec::Combine { inputs, operation, options, packing })
    }
}

const EXAMPLES: &str = "\
Examples:
  spinney combine union land.goblin lakes.goblin -o surface.goblin
  spinney combine a-b model.goblin drill.goblin -o part.goblin
  spinney combine and landcover.goblin parks.gpkg --where 'kind=national' -o parks.goblin
  spinney combine over patch3.goblin patch2.goblin base.goblin -o map.goblin
  spinney combine changed 2020.goblin 2025.goblin -o changes.goblin
  spinney combine cross 2020.goblin 2025.goblin
  spinney combine and soils.gpkg parcels.fgb -o soils_of_parcels.gpkg
  spinney combine a-b block.goblin part.goblin -o mould.goblin

Set operations, by name or number, the sum of 1 (both), 2 (A only), 4 (B only) and 8 (neither):
   0  none                  nothing
   1  and, intersection     in A and B
   2  a-b, difference       in A, but not in B
   3  a                     A
   4  b-a                   in B, but not in A
   5  b                     B
   6  xor                   in A or B, but not in both
   7  or, union             in A or B
   8  nor                   neither in A nor in B
   9  xnor                  in both or neither
  10  not-b                 not in B
  11  a|!b                  in A, or not in B
  12  not                   not in A; also of one file
  13  b|!a                  in B, or not in A
  14  nand                  not in both
  15  all                   everything

Operations on values of cells:
  over                      the first value that is not VOID, of any number of files
  mask                      A where B has a value
  min, max                  minimum or maximum of all files, where all have a value
  add                       sum of all files, where all have a value; limited to the type's range
  subtract                  A minus the others, where all have a value
  equal                     A where both are equal
  changed                   B where both differ, or A where B is VOID
  cross                     print a table: which values of A meet which of B, in how many cells

Operations on polygon files:
  partition                 all areas into which the borders of any number of files divide them

Operations 0, 1, 2, 6, 7 and their complements take any number of trees and of exact models: they
are applied to the first two, then to the result and the next one.

Trees: a cell is in a file if it is not VOID. --within or --margin says where operations from 8 on
fill cells. With the rule occupancy, cells are combined by fullness, assuming the largest possible
overlap: A-A is empty, volumes add up, and only cells with both surfaces can be wrong, by half a
cell at most.

Exact models (`build --brep`): surfaces are combined exactly. Models whose grids have no common unit
are moved to a common grid first, by less than a unit, with a warning (build all with one --snap to
choose the unit). New vertices are kept as fractions, and rounded to the grid only for queries and
export. Results of operations from 8 on extend to infinity.

Polygon files (GeoJSON, FlatGeobuf, GeoPackage, shapefile, CSV): polygons are combined exactly, and
written to such a file. A feature is the common area of a pair of features, or an area of one
feature, with their attributes. Vertices are moved to a grid (--snap) so that no new crossings
arise. Operations from 8 on need --within.";

/// The region in which an operation fills cells that neither file has.
#[derive(Clone, Debug)]
enum Within {
    /// Minimum and maximum coordinates.
    Box([f64; 3], [f64; 3]),
    Polygons(PathBuf),
}

/// Parses a world box, or the name of a polygon file.
fn parse_within(text: &str) -> Result<Within, String> {
    if is_feature_file(Path::new(text)) {
        return Ok(Within::Polygons(text.into()));
    }
    parse_box(text).map(|(low, high)| Within::Box(low, high))
}

fn parse_box(text: &str) -> Result<([f64; 3], [f64; 3]), String> {
    if let Some([west, south, east, north]) = numbers(text) {
        // (Empty along z: octrees reject it.)
        return Ok(([west, south, 0.0], [east, north, 0.0]));
    }
    let six = numbers(text).map(|[a, b, c, d, e, f]: [f64; 6]| ([a, b, c], [d, e, f]));
    six.ok_or_else(|| "expected 4 or 6 numbers, separated by commas, or a polygon file".into())
}

pub(crate) fn run(args: Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let Args { merging, output, snap, explain, json, memory, packing, limit, features } = args;
    let MergingArgs { operation: name, files, values, fill, within, margin, reconcile } = &merging;
    let fill = *fill;
    ensure!(
        !explain || exact::any_model(files, global)?,
        "--explain: works only with exact models (`build --brep`)"
    );
    if name.is_table() {
        ensure!(output.is_none(), "--output: has no effect on cross, which prints a table");
        return table(files, reconcile, json, global);
    }
    ensure!(!json, "--json: works only with cross");
    if files.iter().all(|file| is_feature_file(file)) {
        let given =
            [("--values", *values != "a"), ("--fill", fill.is_some()), ("--margin", margin.is_some())];
        let given = given.into_iter().chain(packing.given()).chain(reconcile.given());
        let given = given.into_iter().find(|(_, is_given)| *is_given);
        ensure!(given.is_none(), "{}: has no effect on polygons", given.map_or("", |(name, _)| name));
        let path = output.context("--output: expected a file to write")?;
        let is_solid = matches!(within, Some(Within::Box(low, high)) if low[2] != high[2]);
        ensure!(!is_solid, "--within: got 6 numbers, expected 4 or a polygon file: the inputs are polygons");
        let within = within.as_ref().map(|within| match within {
            Within::Box(low, high) => Region::Box([low[0], low[1]], [high[0], high[1]]),
            Within::Polygons(path) => Region::Polygons(path.clone()),
        });
        let filter = features.filter_alone()?;
        return overlay::run(
            &PairQuery { name: &name.0, files, filter, within, snap, memory },
            &path,
            global,
        );
    }
    ensure!(snap.is_none(), "--snap: works only with polygons; exact models keep their grid");
    let (operation, universe) = merging.on_trees()?;
    let path = output.context("--output: expected a file to write")?;
    check_output(files.iter().map(PathBuf::as_path), &path)?;
    if exact::any_model(files, global)? {
        let given = [
            ("--values", *values != "a"),
            ("--fill", fill.is_some()),
            ("--within or --margin", within.is_some() || margin.is_some()),
        ];
        let given: Vec<(&str, bool)> = given.into_iter().chain(reconcile.given()).collect();
        exact::refuse(&files[0], &given)?;
        let codec = packing.of_model(&files[0])?;
        return exact::combine(operation, files, (&path, &limit), codec, (memory.bytes, explain), global);
    }
    let how = packing.with(memory);
    let options = CombineOptions { fill, universe, reconcile: reconcile.options() };
    let work = Work::start(global, "cells")?;
    let output = limit.create_tree(&path, global)?;
    let (outcome, counts) = if are_mixed(files) {
        features.combine(operation, options, files, output, how, &work)?
    } else {
        features.refuse()?;
        (spinney::combine(operation, options, files, output, how, &work)?, vec![None; files.len()])
    };
    work.finish();
    for ((file, cells), features) in files.iter().zip(&outcome.before).zip(counts) {
        match features {
            Some(features) => global.report("input", format_args!("{}: {features} features", file.display())),
            None => global.report("input", format_args!("{}: {cells} cells", file.display())),
        }
    }
    global.report_conversions(&outcome.conversions);
    if let Some(universe) = outcome.universe {
        let ([x, y, z], [width, height, depth]) = (universe.min, universe.size());
        let what = "the region in which cells that no file has may be filled (--within, --margin)";
        global.report("region", format_args!("{width} x {height} x {depth} cells from {x},{y},{z}: {what}"));
    }
    global.report("result", format_args!("{} cells, depth {}", outcome.after, outcome.depth));
    report_output(global, &path, start);
    Ok(())
}

/// Prints the table of pairs of values.
fn table(files: &[PathBuf], reconcile: &ReconcileArgs, json: bool, global: &Global) -> Result<()> {
    let [first, second] = files else { bail!("cross: got {} files, expected 2", files.len()) };
    let work = Work::start(global, "cells")?;
    let (pairs, conversions) =
        ops::crosstab_files(first, second, &reconcile.options(), global.access(), &work)?;
    work.finish();
    global.report_conversions(&conversions);
    if json {
        let samples = |value: &Option<Vec<Number>>| {
            let value = value.as_ref();
            value.map(|samples| samples.iter().map(|sample| class_as_json(*sample)).collect::<Vec<_>>())
        };
        let rows: Vec<_> = pairs
            .iter()
            .map(|(a, b, cells)| json!({ "first": samples(a), "second": samples(b), "cells": cells }))
            .collect();
        return print_json(&json!(rows));
    }
    let show = |value: &Option<Vec<Number>>| match value {
        None => "-".to_string(),
        Some(samples) => samples.iter().map(Number::to_string).collect::<Vec<_>>().join(","),
    };
    let rows = pairs.iter().map(|(a, b, cells)| format!("{:>12} {:>12} {cells:>16}\n", show(a), show(b)));
    print_text(&format!("{:>12} {:>12} {:>16}\n{}", "first", "second", "cells", rows.collect::<String>()))
}
