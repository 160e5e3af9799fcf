//! `spinney index`: trees whose cells stay in TIFF files.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail};
use spinney::import::raster::{ImportOptions, RasterImport, Stack, StackOptions, plan, plan_stack};
use spinney::raw::import::raster::{
    Band, IndexUpdate, UpdateReport, expand_sources, needs_layers, update_index, write_stack,
};
use spinney::raw::store::check_tree_name;
use spinney::{Crs, DataKind, Number, Rule};

use super::Global;
use super::args::{Memory, OutputLimit, check_output, expand_lists, parse_crs, same_file};
use super::build::Pages;
use super::report::{Work, report_built};

/// Make an index of GeoTIFF files: a tree whose cells stay in these
///
/// An index has the coarser levels and exact statistics of all nodes, and every command takes it as
/// a tree file. Cells are read from the files' own tiles where a result needs them, locally or by
/// ranges over HTTP, S3, Google Cloud or Azure. Each file is read once. Several files have one grid
/// of pixels, one coordinate system and pixels of one type; where two overlap, the later one is on
/// top. Keep the files where they are, relative to the index. `spinney transform x.goblin -o
/// whole.goblin` makes a file that needs no others.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// GeoTIFF files or virtual rasters (.vrt), or URLs of them; `*` in a name matches any
    /// characters, also in S3, Google Cloud and Azure; files of STAC items (JSON, or one a line);
    /// @FILE reads paths from a file, one a line. With --update: all files that the index has
    /// afterwards [default: those that it has]
    #[arg(required_unless_present = "update", value_name = "SOURCE")]
    sources: Vec<PathBuf>,
    /// File to write [default with --update: the index]
    #[arg(short, long, value_name = "OUT.goblin", required_unless_present = "update")]
    output: Option<PathBuf>,
    /// Asset of STAC items that is indexed [default: the only GeoTIFF with the role "data"]
    #[arg(long, value_name = "NAME")]
    asset: Option<String>,
    /// Update this index: only files that were changed, added or removed are read
    #[arg(long, value_name = "INDEX.goblin", conflicts_with_all = OF_NEW)]
    update: Option<PathBuf>,
    /// Replace the beginning of the sources' names in the index, after the sources or the index
    /// have moved; with --update
    #[arg(long, value_name = "OLD=NEW", requires = "update", value_parser = parse_prefix)]
    source_prefix: Vec<(String, String)>,
    /// Levels between the cells and the finest stored level: 1, 2 or 4. With 1 the index is about
    /// four times as large, with 4 a sixteenth, and coarse views read more of the sources
    #[arg(long, value_name = "LEVELS", default_value = "2", value_parser = parse_levels)]
    stored_level: u8,
    /// Meaning of the values: categorical (classes, counted) or continuous (averaged) [default:
    /// from the file]
    #[arg(long)]
    kind: Option<DataKind>,
    /// Rule for representative values at coarse detail: mean, majority, dominant, min, max or
    /// nearest [default: mean of continuous values, majority of classes]
    #[arg(long)]
    rule: Option<Rule>,
    /// Channels to use, by number from 1 or by name (in full, or up to a comma), in this order
    /// [default: all]
    #[arg(long, value_name = "N|NAME,...", value_delimiter = ',')]
    band: Option<Vec<Band>>,
    /// Nodata number: pixels equal to it become VOID [default: from the file]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    nodata: Option<Number>,
    /// Coordinate system of the input: EPSG:NUMBER, EPSG:NUMBER+NUMBER with heights, WKT, PROJJSON,
    /// or '+proj=...'; or @FILE that has one of these [default: from the file]
    #[arg(long, value_name = "DEF", value_parser = parse_crs)]
    crs: Option<Crs>,
    /// Keep the inputs, and each of their bands, as layers of one file; colour images are one
    /// layer. All have one grid of pixels
    #[arg(long)]
    stack: bool,
    /// Names of the layers of a stack [default: those of the files; of files with several bands
    /// those of the bands]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    names: Option<Vec<String>>,
    /// Acquisition times of the layers of a stack, as in 2024-05-31 or 2024-05-31T10:30:00Z: of
    /// each layer, or of each file
    #[arg(long, value_name = "TIME,...", value_delimiter = ',')]
    times: Option<Vec<String>>,
    /// Pages of a TIFF file that has several: one by its number from 0, or all of them, as layers
    /// of a stack
    #[arg(long, value_name = "layers|N", value_parser = parse_pages)]
    pages: Option<Pages>,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    limit: OutputLimit,
}

/// Options of a new index, which --update keeps.
const OF_NEW: [&str; 10] =
    ["stored_level", "kind", "rule", "band", "nodata", "crs", "stack", "names", "times", "pages"];

fn parse_pages(text: &str) -> Result<Pages, &'static str> {
    // (Indexes have no volumes.)
    let pages = text.parse().ok().filter(|pages| *pages != Pages::Volume);
    pages.ok_or("expected layers, or a number from 0")
}

const EXAMPLES: &str = "\
Examples:
  spinney index landcover.tif -o landcover.goblin
  spinney index 's3://bucket/dem/*.tif' -o dem.goblin
  spinney index items.json --asset B04 -o red.goblin
  spinney index --update dem.goblin
  spinney stats landcover.goblin --zones countries.gpkg";

/// Parses two beginnings of names.
fn parse_prefix(text: &str) -> Result<(String, String), &'static str> {
    let (old, new) = text.split_once('=').ok_or("expected OLD=NEW, two beginnings of names")?;
    Ok((old.into(), new.into()))
}

/// Parses the number of levels that are not stored.
pub(super) fn parse_levels(text: &str) -> Result<u8, &'static str> {
    match text.parse() {
        Ok(levels @ (1 | 2 | 4)) => Ok(levels),
        _ => Err("expected 1, 2 or 4 levels"),
    }
}

/// An index that is ready to be made.
enum Plan {
    One(Box<RasterImport>),
    Stack(Box<Stack>),
}

impl Args {
    fn plan(&self, global: &Global) -> Result<Plan> {
        let mut options = ImportOptions::new();
        (options.kind, options.rule, options.bands, options.nodata) =
            (self.kind, self.rule, self.band.clone(), self.nodata);
        (options.crs, options.memory) = (self.crs.clone(), Some(self.memory.bytes));
        (options.referenced, options.access) = (Some(self.stored_level), global.access().clone());
        options.page =
            self.pages.and_then(|pages| if let Pages::One(page) = pages { Some(page) } else { None });
        let every_page = self.pages == Some(Pages::Layers);
        if self.stack || every_page || needs_layers(&self.sources, &options)? {
            let mut stack = StackOptions::new();
            (stack.import, stack.every_page) = (options, every_page);
            (stack.names, stack.times) = (self.names.clone(), self.times.clone());
            return Ok(Plan::Stack(Box::new(plan_stack(&self.sources, &stack)?)));
        }
        if self.names.is_some() || self.times.is_some() {
            bail!("--names and --times: work only with --stack")
        }
        Ok(Plan::One(Box::new(plan(&self.sources, &options)?)))
    }

    /// Updates an index.
    fn update(&self, index: &Path, global: &Global) -> Result<()> {
        let start = Instant::now();
        let output = self.output.as_deref().unwrap_or(index);
        if !same_file(output, index) {
            check_output([index].into_iter().chain(self.sources.iter().map(PathBuf::as_path)), output)?;
        }
        check_tree_name(output)?;
        let mut update = IndexUpdate::default();
        update.sources = (!self.sources.is_empty()).then(|| self.sources.clone());
        (update.prefixes, update.memory) = (self.source_prefix.clone(), self.memory.bytes);
        let work = Work::start(global, "cells")?;
        let report = update_index(index, &update, self.limit.create_tree(output, global)?, &work)?;
        work.finish();
        let UpdateReport { unchanged, changed, added, removed, .. } = report;
        global.report(
            "sources",
            format_args!("{changed} changed, {added} added, {removed} removed, {unchanged} not read"),
        );
        report_built(global, output, start, None);
        Ok(())
    }
}

pub(crate) fn run(mut args: Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    args.sources = expand_lists(std::mem::take(&mut args.sources))?;
    let files = expand_sources(&args.sources, args.asset.as_deref(), global.access())?;
    // STAC items have times of layers.
    if args.stack && args.times.is_none() {
        args.times = files.iter().map(|file| file.time.clone()).collect();
    }
    args.sources = files.into_iter().map(|file| file.path).collect();
    if args.output.as_deref() == Some(Path::new("-")) {
        bail!("--output: an index names its sources relative to itself; expected a file name")
    }
    if let Some(index) = &args.update {
        return args.update(index, global);
    }
    let Some(output) = &args.output else { bail!("--output: expected the file to write") };
    check_output(args.sources.iter().map(PathBuf::as_path), output)?;
    check_tree_name(output)?;
    let plan = args.plan(global)?;
    let description = match &plan {
        Plan::One(import) => import.description(),
        Plan::Stack(stack) => stack.description(),
    };
    for (heading, text) in description {
        global.report(heading, text);
    }
    let sizes =
        args.sources.iter().map(|source| std::fs::metadata(source).map_or(Some(0), |file| Some(file.len())));
    let input = sizes.sum();
    let work = Work::start(global, "cells")?;
    let file = args.limit.create_tree(output, global)?;
    match plan {
        Plan::One(import) => import.build(file, &work)?,
        Plan::Stack(stack) => write_stack(&stack, file, &work)?,
    }
    work.finish();
    report_built(global, output, start, input);
    global.report("next", format_args!("spinney info {}", output.display()));
    Ok(())
}
