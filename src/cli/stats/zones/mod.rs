//! `spinney stats --zones`: statistics of the cells in polygons.

mod print;

use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use spinney::dataset::Dataset;
use spinney::export::vector::ZoneWriter;
use spinney::import::feature::{
    AttributeCondition, FeatureFilter, FeatureOptions, PolygonLayer, PolygonReader,
};
use spinney::io::Output;
use spinney::query::{ZonalRequest, ZoneMeasure, ZoneStatistics};
use spinney::space::{Coordinates, EdgeRule, Places};

use super::super::Global;
use super::super::args::{Memory, check_output, places, vector_format};
use super::super::report::{Work, report_output, warn};
pub(super) use print::Format;
use print::Report;

/// Options for statistics of polygons.
#[derive(clap::Args)]
pub(super) struct ZoneOptions {
    /// Cells at the edge of a polygon: centre (those whose centre is inside), touch (all of them) or area (each by the part that is
    /// inside, exactly)
    #[arg(long, value_name = "RULE", default_value_t, requires = "zones")]
    edge: EdgeRule,
    /// Measures of each polygon: count, void (cells), void_share, outside (of the tree, in cells), sum, min, max, mean, std, majority,
    /// minority, variety, median, classes [default: all but majority, minority, variety and median, for which all cells are read unless
    /// the file counts classes]
    #[arg(long = "measure", value_name = "NAME,...", value_delimiter = ',', requires = "zones")]
    measures: Vec<ZoneMeasure>,
    /// Quantiles of each polygon, from 0 to 1, as in 0.1,0.5,0.9: interpolated linearly, with parts of cells as weights
    #[arg(long, value_name = "Q,...", value_delimiter = ',', requires = "zones")]
    quantiles: Vec<f64>,
    /// Features alone for which all of this holds, as in 'type=Building,lod>=2': =, !=, <, <=, > or >= between an attribute and a value
    #[arg(long = "where", value_name = "CONDITION,...", value_delimiter = ',', requires = "zones")]
    conditions: Vec<AttributeCondition>,
    /// Attributes of features that --json, --csv and --output tell, as in name,code [default: all; with --csv none]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', requires = "zones")]
    attribute: Option<Vec<String>>,
    #[command(flatten)]
    pub(in crate::cli::stats) memory: Memory,
}

impl ZoneOptions {
    /// The question, and the bytes that are left for features.
    fn request(&self) -> (ZonalRequest, u64) {
        let (measures, quantiles) = (self.measures.clone(), self.quantiles.clone());
        let memory = self.memory.bytes / 2;
        let request = ZonalRequest { edge: self.edge, measures, quantiles, memory };
        let left = if request.needs_values() { self.memory.bytes - memory } else { self.memory.bytes };
        (request, left)
    }

    /// Options for reading the features: attributes only where they are told.
    fn reading(&self, format: Format, memory: u64) -> FeatureOptions {
        let attributes = match (&self.attribute, format) {
            (None, Format::Json) => None,
            (chosen, _) => Some(chosen.clone().unwrap_or_default()),
        };
        let filter = FeatureFilter { conditions: self.conditions.clone() };
        FeatureOptions { memory, filter, attributes, ..FeatureOptions::default() }
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
    let format = vector_format(None, output)?;
    check_output(trees.iter().map(Dataset::name).chain([file]), output)?;
    let trees: Vec<&Dataset> = trees.iter().collect();
    let (request, memory) = options.request();
    // (Of attributes all that are not left out.)
    let reading = options.reading(Format::Json, memory);
    let mut reader = PolygonReader::open(file, &reading).map_err(|error| named(error, file))?.with_others();
    let mut zones = Zones::of(&trees, coordinates, reader.schema().crs.clone(), request)?;
    let work = Work::start(global, "polygons")?;
    let (mut writer, mut count) = (None, 0u64);
    while let Some(layer) = reader.next_layer().map_err(|error| named(error, file))? {
        let writer = match &mut writer {
            Some(writer) => writer,
            None => {
                let told = (reader.schema(), &layer);
                let made =
                    ZoneWriter::create(Output::create(output)?, format, told, &trees, &zones.request, &work)?;
                writer.insert(made)
            }
        };
        zones.each(&layer, file, &work, &mut |number, zone| {
            count += 1;
            Ok(writer.write(&layer.features[number], zone)?)
        })?;
    }
    zones.finish(file)?;
    let writer = writer.with_context(|| format!("{}: has no features", file.display()))?;
    writer.finish(&work).with_context(|| format!("cannot write {}", output.display()))?;
    drop(work);
    global.report("zones", format_args!("{count} features"));
    report_output(global, output, start);
    Ok(())
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
    let trees: Vec<&Dataset> = trees.iter().collect();
    let (request, memory) = options.request();
    let mut reader =
        PolygonReader::open(file, &options.reading(format, memory)).map_err(|error| named(error, file))?;
    let mut zones = Zones::of(&trees, coordinates, reader.schema().crs.clone(), request)?;
    let mut report = Report::begin(&trees, options, format);
    let work = Work::start(global, "polygons")?;
    while let Some(layer) = reader.next_layer().map_err(|error| named(error, file))? {
        zones.each(&layer, file, &work, &mut |number, zone| report.add(&layer, number, zone))?;
    }
    zones.finish(file)?;
    drop(work);
    report.finish()
}

/// An error with the name of the file. (All others name it.)
fn named(error: spinney::Error, file: &Path) -> anyhow::Error {
    match error {
        error @ spinney::Error::Invalid { .. } => {
            anyhow::Error::from(error).context(file.display().to_string())
        }
        error => error.into(),
    }
}

/// Layers that are asked for zones.
struct Zones<'a> {
    trees: &'a [&'a Dataset],
    request: ZonalRequest,
    /// For each layer the number of the first with the same grid.
    same: Vec<usize>,
    /// The numbers of these, ascending, and places in their cells, to which polygons are brought once.
    grids: Vec<usize>,
    places: Vec<(Places, [u64; 3])>,
    /// Whether some polygons reach into a tree; or why those of the first batch do not.
    is_met: bool,
    outside: Option<spinney::Error>,
}

impl<'a> Zones<'a> {
    /// Layers, and the coordinates of features: those that were asked for, or in whose system they are.
    fn of(
        trees: &'a [&'a Dataset],
        coordinates: Option<&Coordinates>,
        crs: Option<spinney::space::Crs>,
        request: ZonalRequest,
    ) -> Result<Zones<'a>> {
        let mut own = crs.map_or(Coordinates::World, Coordinates::System);
        let has_system = trees.iter().all(|tree| tree.metadata().frame.crs.is_some());
        if !has_system && coordinates.is_none() && own != Coordinates::World {
            warn("the tree has no coordinate system: corners are taken to be in its own coordinates");
            own = Coordinates::World;
        }
        let same = Dataset::same_cells(trees);
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
        let places = places.collect::<Result<Vec<_>>>()?;
        Ok(Zones { trees, request, same, grids, places, is_met: false, outside: None })
    }

    /// Hands out the statistics of each feature of a layer, by its number in it, of all layers of the tree.
    fn each(
        &mut self,
        layer: &PolygonLayer,
        file: &Path,
        work: &Work,
        take: &mut dyn FnMut(usize, &[ZoneStatistics]) -> Result<()>,
    ) -> Result<()> {
        let found = layer.in_cells_of(&self.places).with_context(|| file.display().to_string())?;
        match found.outside {
            None => self.is_met = true,
            Some(error) => self.outside = self.outside.take().or(Some(error)),
        }
        let of_grid =
            |first: &usize| &found.trees[self.grids.binary_search(first).expect("one of the list")][..];
        let asked: Vec<_> = self.trees.iter().copied().zip(self.same.iter().map(of_grid)).collect();
        let (mut failure, mut number) = (None, 0);
        let walked = Dataset::zonal_layers(&asked, &self.request, work, &mut |zone| {
            number += 1;
            take(number - 1, &zone).map_err(|error| {
                failure = Some(error);
                spinney::Error::Interrupted
            })
        });
        failure.map_or(Ok(()), Err)?;
        Ok(walked?)
    }

    /// Fails if there were polygons, and all of them lie outside.
    fn finish(self, file: &Path) -> Result<()> {
        match self.outside {
            Some(error) if !self.is_met => Err(error).with_context(|| file.display().to_string()),
            _ => Ok(()),
        }
    }
}
