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
use super::overlay::{self, Question, Region};
use super::report::{Work, print_json, print_text, report_output};
use super::{Global, exact};

/// Make one tree of several: unions, intersections, differences, one over the other, changes.
///
/// Files are traversed together, in place on disk. Where one file decides, the other files'
/// subtrees are not read, and its stored records are copied unchanged. The result has the first
/// file's cells, over the extents of all files (--extent). Other files are converted to the first
/// one's cells: from other cells and coordinate systems (resampled by their rule), types, scales,
/// units and numbers of classes. Conversions are reported. Rule, names and colours are those of the
/// first file, with new classes added. Features are rasterized to the cells of the trees, as by
/// `spinney build`; whatever is outside of these is left out.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    merging: MergingArgs,
    /// File to write; - is standard output
    #[arg(short, long, value_name = "OUT.goblin")]
    output: Option<PathBuf>,
    /// Width of the grid units that vertices of polygons are moved to, in units of the coordinates,
    /// or the next smaller power of two [default: 2^-42 of the largest coordinate]
    #[arg(long, value_name = "WIDTH")]
    snap: Option<f64>,
    /// Print which faces of two exact models the operation keeps, and which of them it reverses
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
    /// Operation; see the list in `spinney combine --help`
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
    /// Region in which an operation fills cells that neither file has, a box in world coordinates:
    /// west, south, east, north; of octrees all minimum and then all maximum coordinates; of
    /// polygons also a polygon file, for all operations [default: a raster's extent, an octree's
    /// root]
    #[arg(long, value_name = "BOX", value_parser = parse_within, conflicts_with = "margin")]
    within: Option<Within>,
    /// Fill cells that neither file has, in the files' extents and this many cells around them
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
                bail!("{}: a file of polygons limits what is made of polygons; give a box", path.display())
            }
            None => None,
        };
        let name = &self.operation;
        let prefer =
            if self.values == "a" || self.values == "first" { Prefer::First } else { Prefer::Second };
        ensure!(!name.is_partition(), "partition is for files of polygons");
        let operation = name.operation(prefer).with_context(|| format!("{}: no such operation", name.0))?;
        let universe = within.or(self.margin.map(Universe::Margin));
        ensure!(
            universe.is_none() || operation.needs_universe(),
            "--within and --margin are for operations that fill what neither file has (those from 8 on)"
        );
        Ok((operation, universe.unwrap_or_default()))
    }

    /// Returns the job of combining trees of cells.
    pub(crate) fn spec(&self, packing: spinney::raw::store::Packing, global: &Global) -> Result<JobSpec> {
        let name = &self.operation.0;
        ensure!(!self.operation.is_table(), "{name} prints a table: `spinney combine {name}`");
        if let Some(file) = self.files.iter().find(|file| is_feature_file(file)) {
            bail!("{}: features are not combined in shards: `spinney combine {name}`", file.display())
        }
        ensure!(
            !exact::any_model(&self.files, global)?,
            "exact models are not combined in shards: `spinney combine {name}`"
        );
        let (operation, universe) = self.on_trees()?;
        let (inputs, fill) = (self.files.clone(), self.fill);
        let options = CombineOptions { fill, universe, reconcile: self.reconcile.options() };
        Ok(JobSpec::Combine { inputs, operation, options, packing })
    }
}

const EXAMPLES: &str = "\
Set operations; a cell is present if it is not VOID. By number (1: both, 2: A only, 4: B only,
8: neither, added up) or by name. With 8, --within and --margin say where:
   0 none     1 and (intersection)   2 a-b (difference)   3 a
   4 b-a      5 b                    6 xor                7 or (union)
   8 nor      9 xnor                10 not-b             11 a|!b
  12 not     13 b|!a                14 nand              15 all     (not: of one file, too; or: of many)
Solids whose cells tell coverage are combined by how far they fill cells, taken to overlap as far as they
can: A-A is empty, volumes add up, and only cells with both surfaces can be off, by half a cell at most.
Exact models (build --brep) are combined as surfaces, exactly. Those whose grids have no unit in common are moved to a
common grid first, by less than a unit, with a warning (build all with one --snap to choose the unit). New
corners are kept as fractions, and rounded to the grid only for questions and export. Operations with 8 have all
that is far away. (0, 1, 2, 6, 7 and their complements are for any number of models.)
Polygons of feature files (GeoJSON, GeoPackage, FlatGeobuf, shapefiles, CSV) are combined exactly, and written to such a file:
a feature for each pair of features with something in common, with the attributes of both, or of the one that is there.
Corners come to lie on a grid (--snap), on which no edges cross that did not. Operations with 8 need --within. And:
  partition  all parts into which the borders of any number of files divide them, each with all that it came from
Operations on values:
  over       the first of any number of files that has something
  mask       A where B has something
  min max    of all files, where all have something
  add        as min and max; sums are kept within what the type can hold
  subtract   A minus the others, where all have something
  equal      where A and B are the same
  changed    where they differ: the value of B, or of A where B has none
  cross      no tree but a table: which values of A meet which of B, in how many cells

Examples:
  spinney combine union land.goblin lakes.goblin -o surface.goblin
  spinney combine a-b model.goblin drill.goblin -o part.goblin
  spinney combine and landcover.goblin parks.gpkg --where 'kind=national' -o parks.goblin
  spinney combine over patch3.goblin patch2.goblin base.goblin -o map.goblin
  spinney combine changed 2020.goblin 2025.goblin -o changes.goblin
  spinney combine cross 2020.goblin 2025.goblin
  spinney combine and soils.gpkg parcels.fgb -o soils_of_parcels.gpkg
  spinney combine not part.goblin --margin 4 -o mould.goblin";

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
    six.ok_or_else(|| "expected 4 or 6 numbers with commas between them, or a file of polygons".into())
}

pub(crate) fn run(args: Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let Args { merging, output, snap, explain, json, memory, packing, limit, features } = args;
    let MergingArgs { operation: name, files, values, fill, within, margin, reconcile } = &merging;
    let fill = *fill;
    ensure!(!explain || exact::any_model(files, global)?, "--explain is for exact models (`build --brep`)");
    if name.is_table() {
        ensure!(output.is_none(), "cross prints a table: leave out --output");
        return table(files, reconcile, json, global);
    }
    ensure!(!json, "--json is for the table of cross");
    if files.iter().all(|file| is_feature_file(file)) {
        let given =
            [("--values", *values != "a"), ("--fill", fill.is_some()), ("--margin", margin.is_some())];
        let given = given.into_iter().chain(packing.given()).chain(reconcile.given());
        let given = given.into_iter().find(|(_, is_given)| *is_given);
        ensure!(given.is_none(), "{} is not for polygons", given.map_or("", |(name, _)| name));
        let path = output.context("--output is missing: where should the result go?")?;
        let is_solid = matches!(within, Some(Within::Box(low, high)) if low[2] != high[2]);
        ensure!(!is_solid, "--within: polygons are within a box of four numbers, or a file of polygons");
        let within = within.as_ref().map(|within| match within {
            Within::Box(low, high) => Region::Box([low[0], low[1]], [high[0], high[1]]),
            Within::Polygons(path) => Region::Polygons(path.clone()),
        });
        let filter = features.filter_alone()?;
        return overlay::run(&Question { name: &name.0, files, filter, within, snap, memory }, &path, global);
    }
    ensure!(snap.is_none(), "--snap is for polygons (exact models have the grid that they were built on)");
    let (operation, universe) = merging.on_trees()?;
    let path = output.context("--output is missing: where should the result go?")?;
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
        global.report("universe", format_args!("{width} x {height} x {depth} cells from {x},{y},{z}"));
    }
    global.report("result", format_args!("{} cells, depth {}", outcome.after, outcome.depth));
    report_output(global, &path, start);
    Ok(())
}

/// Prints the table of pairs of values.
fn table(files: &[PathBuf], reconcile: &ReconcileArgs, json: bool, global: &Global) -> Result<()> {
    let [first, second] = files else { bail!("cross takes two files, not {}", files.len()) };
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
