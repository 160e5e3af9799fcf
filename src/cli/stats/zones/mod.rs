//! `spinney stats --zones`: statistics of the cells in polygons.

mod print;

use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use spinney::import::feature::{FeatureFilter, FeatureOptions};
use spinney::query::{EdgeRule, ZonalRequest, ZoneMeasure};
use spinney::raw::export::vector::export_zones;
use spinney::raw::import::feature::{AttributeCondition, FeatureZones, PolygonReader};
use spinney::{Coordinates, Dataset};

use super::super::Global;
use super::super::args::{Memory, check_output, vector_format_of};
use super::super::report::{Work, report_output};
pub(super) use print::Format;
use print::Report;

/// Options for statistics of polygons.
#[derive(clap::Args)]
pub(super) struct ZoneOptions {
    /// Cells at the edge of a polygon: centre (those whose centre is inside), touch (all of them)
    /// or area (each weighted exactly by its fraction inside)
    #[arg(long, value_name = "RULE", default_value_t, requires = "zones")]
    edge: EdgeRule,
    /// Measures of each polygon: count, void (cells), void_share, outside (of the tree, in cells),
    /// sum, min, max, mean, std, majority, minority, variety, median, classes [default: all but
    /// majority, minority, variety and median, which read all cells unless the file counts classes;
    /// --json always has the others]
    #[arg(long = "measure", value_name = "NAME,...", value_delimiter = ',', requires = "zones")]
    measures: Vec<ZoneMeasure>,
    /// Quantiles of each polygon, from 0 to 1, as in 0.1,0.5,0.9: interpolated linearly, with
    /// fractions of cells as weights
    #[arg(long, value_name = "Q,...", value_delimiter = ',', requires = "zones")]
    quantiles: Vec<f64>,
    /// Only features for which all conditions hold, as in 'type=Building,height>=10': an
    /// attribute, one of =, !=, <, <=, > and >=, and a value; with --each objects of the model
    #[arg(
        long = "where",
        value_name = "CONDITION,...",
        value_delimiter = ',',
        requires = "table",
        conflicts_with = "labels"
    )]
    pub(super) conditions: Vec<AttributeCondition>,
    /// Attributes of features in --json, --csv and --output, or of the lines that points get with
    /// --nearest, as in name,code [default: all; with --csv none]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', requires = "table", conflicts_with_all = ["each", "labels"])]
    pub(super) attribute: Option<Vec<String>>,
    #[command(flatten)]
    pub(in crate::cli::stats) memory: Memory,
}

impl ZoneOptions {
    /// Returns the request, and the memory in bytes that is left for features.
    fn request(&self) -> (ZonalRequest, u64) {
        let (measures, quantiles) = (self.measures.clone(), self.quantiles.clone());
        let memory = self.memory.bytes / 2;
        let request = ZonalRequest { edge: self.edge, measures, quantiles, memory };
        let left = if request.needs_values() { self.memory.bytes - memory } else { self.memory.bytes };
        (request, left)
    }

    /// Returns options for reading the features. Attributes are read only if they are printed.
    fn reading(
        &self,
        format: Format,
        memory: u64,
        (trees, coordinates): (&[&Dataset], Option<&Coordinates>),
    ) -> FeatureOptions {
        let attributes = match (&self.attribute, format) {
            (None, Format::Json) => None,
            (chosen, _) => Some(chosen.clone().unwrap_or_default()),
        };
        let filter = FeatureFilter { conditions: self.conditions.clone() };
        // (In trees without a coordinate system, that of the file is not used.)
        let has_system = trees.iter().all(|tree| tree.metadata().frame.crs.is_some());
        let check_degrees = coordinates.is_none() && has_system;
        FeatureOptions { memory, filter, attributes, check_degrees, ..FeatureOptions::default() }
    }
}

/// Writes the features of a file, joined with the statistics of the cells in them.
pub(super) fn write(
    trees: &[Dataset],
    file: &Path,
    options: &ZoneOptions,
    coordinates: Option<&Coordinates>,
    output: &Path,
    global: &Global,
) -> Result<()> {
    let start = Instant::now();
    let format = vector_format_of(output)?;
    check_output(trees.iter().map(Dataset::name).chain([file]), output)?;
    let trees: Vec<&Dataset> = trees.iter().collect();
    let (request, memory) = options.request();
    // (The default is all attributes.)
    let reading = options.reading(Format::Json, memory, (&trees, coordinates));
    let reader = PolygonReader::open(file, &reading).map_err(|error| named(error, file))?;
    let work = Work::start(global, "polygons")?;
    let made = global.access().create(output)?;
    let count = export_zones(reader, coordinates, &trees, &request, made, format, &work)?;
    drop(work);
    global.report("zones", format_args!("{count} features"));
    report_output(global, output, start);
    Ok(())
}

/// Prints the statistics of each polygon of a file, for each layer.
pub(super) fn run(
    trees: &[Dataset],
    file: &Path,
    options: &ZoneOptions,
    coordinates: Option<&Coordinates>,
    format: Format,
    global: &Global,
) -> Result<()> {
    let trees: Vec<&Dataset> = trees.iter().collect();
    let (request, memory) = options.request();
    let reading = options.reading(format, memory, (&trees, coordinates));
    let mut reader = PolygonReader::open(file, &reading).map_err(|error| named(error, file))?;
    let work = Work::start(global, "polygons")?;
    let mut zones = FeatureZones::new(&reader, coordinates, &trees, &request, &work)?;
    let mut report = Report::begin(&trees, options, format);
    while let Some(layer) = reader.next_layer().map_err(|error| named(error, file))? {
        let mut failure = None;
        let walked = zones.each(&layer, &work, &mut |number, zone| {
            report.add(&layer, number, zone).map_err(|error| {
                failure = Some(error);
                spinney::Error::Interrupted
            })
        });
        failure.map_or(Ok(()), Err)?;
        walked?;
    }
    zones.finish(&work)?;
    drop(work);
    report.finish()
}

/// Adds the file's name to an error. (Other kinds of errors have it.)
fn named(error: spinney::Error, file: &Path) -> anyhow::Error {
    let name = file.display().to_string();
    let is_unnamed = matches!(&error, spinney::Error::Invalid { what, .. } if !what.starts_with(&name));
    let error = anyhow::Error::from(error);
    if is_unnamed { error.context(name) } else { error }
}
