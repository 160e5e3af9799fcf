//! `spinney export` to tiles: archives, and directories of files.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use spinney::export::{TileEncoding, TileFormat, TileRequest};
use spinney::raw::export::tiles::{
    TileShard, TileTarget, UpdateOptions, degrees_of, draw_tiles, tile_source,
};
use spinney::style::Style;
use spinney::{Dataset, Resampling, WarpOptions};

use super::super::Global;
use super::super::args::{check_output, expand_lists, parse_style};
use super::super::report::{Work, report_output};
use super::Args;

/// Options of tiles only.
#[derive(clap::Args)]
pub(super) struct ArchiveOptions {
    /// Zooms, the first and the last: 0..6 [default: up to that with about the file's own cells]
    #[arg(long, value_parser = parse_zooms, value_name = "A..B")]
    zoom: Option<RangeInclusive<u8>>,
    /// Colours: a style's name (viridis, hillshade ...), its JSON, or a file with it [default: the
    /// file's own]
    #[arg(long, value_name = "STYLE", value_parser = parse_style)]
    style: Option<Style>,
    /// Kind of tiles in an archive: png, webp, jpg, npy or tif (the last two have the unchanged
    /// samples)
    #[arg(long, value_name = "FORMAT")]
    tile_format: Option<TileFormat>,
    /// Effort of PNG, from 1 (fast) to 9 (small)
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=9))]
    png_effort: Option<u8>,
    /// Quality of JPEG, from 1 to 100 [default: 85]; also of WebP in programs built with libwebp,
    /// which is lossless otherwise
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=100))]
    quality: Option<u8>,
    /// Resampling, from files on other grids: nearest, bilinear, cubic, area or majority [default:
    /// nearest for classes, bilinear for continuous values; majority or area where pixels are more
    /// than 1.5 times as large as cells]
    #[arg(long, value_name = "WAY")]
    resampling: Option<Resampling>,
    /// Treat datums as WGS 84 if their shift is unknown or needs a grid
    #[arg(long)]
    allow_ballpark: bool,
    /// Name of the map [default: the file's]
    #[arg(long)]
    name: Option<String>,
    /// Attribution of the map's data, as text or HTML
    #[arg(long)]
    attribution: Option<String>,
    /// Keep the state of an incomplete export as X.partial, and continue from it
    #[arg(long)]
    resume: bool,
    /// Update an export of an older commit of the file: draw only tiles that edits have changed.
    /// OLD is an archive to copy the other tiles from, for .pmtiles [default: the output itself]
    #[arg(long, value_name = "OLD", num_args = 0..=1, conflicts_with = "resume")]
    update: Option<Option<PathBuf>>,
    /// File that the archive was made from, if it is not a commit of the same file
    #[arg(long, value_name = "FILE", requires = "update")]
    since: Option<PathBuf>,
    /// Draw all tiles of an update again, with the current style and percentiles; otherwise,
    /// colours keep the percentiles of the archive
    #[arg(long, requires = "update")]
    restyle: bool,
    /// Write only one of N shards of the tiles, with index K from 0, to an archive (.pmtiles);
    /// other processes write the others
    #[arg(long, value_name = "K/N", conflicts_with_all = ["update", "parts"])]
    part: Option<TileShard>,
    /// Archives of all shards, in any order, whose tiles are merged; none is drawn
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with_all = ["update"])]
    parts: Vec<PathBuf>,
}

fn parse_zooms(text: &str) -> Result<RangeInclusive<u8>, String> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    let number = |text: &str| text.trim().trim_start_matches('=').parse::<u8>();
    match (number(first), number(last)) {
        (Ok(first), Ok(last)) if first <= last => Ok(first..=last),
        _ => Err("expected two zooms, such as 0..6, or one".into()),
    }
}

impl ArchiveOptions {
    /// Returns the style, if one was given.
    pub(super) fn style(&self) -> Option<&Style> {
        self.style.as_ref()
    }

    /// Returns the name of the map, if one was given.
    pub(super) fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// Returns the first given option.
    pub(super) fn given(&self) -> Option<&'static str> {
        let all = [
            ("--zoom", self.zoom.is_some()),
            ("--style", self.style.is_some()),
            ("--tile-format", self.tile_format.is_some()),
            ("--png-effort", self.png_effort.is_some()),
            ("--quality", self.quality.is_some()),
            ("--resampling", self.resampling.is_some()),
            ("--allow-ballpark", self.allow_ballpark),
            ("--name", self.name.is_some()),
            ("--attribution", self.attribution.is_some()),
            ("--resume", self.resume),
            ("--update", self.update.is_some()),
            ("--since", self.since.is_some()),
            ("--restyle", self.restyle),
            ("--part", self.part.is_some()),
            ("--parts", !self.parts.is_empty()),
        ];
        all.into_iter().find(|(_, is_given)| *is_given).map(|(option, _)| option)
    }
}

/// Returns the region to export, in degrees: west, south, east, north.
fn degrees(args: &Args, tree: &Dataset) -> Result<Option<[f64; 4]>> {
    if let Some(degrees) = args.part.degrees() {
        return Ok(Some(degrees));
    }
    let Some(bounds) = args.part.bounds(tree, "write an archive of each")? else { return Ok(None) };
    let frame = tree.metadata().frame.shifted(bounds.min.map(|cell| cell as f64));
    Ok(Some(degrees_of(&frame, bounds.size(), args.archive.allow_ballpark)?))
}

pub(super) fn run(args: &Args, target: &TileTarget, global: &Global) -> Result<()> {
    let start = Instant::now();
    let options = &args.archive;
    let tree = args.tree.open_drawn(global)?;
    global.report_overviews(&tree);
    check_output([args.tree.file.as_path()], target.path())?;
    let mut request = TileRequest::new(&tree)?;
    let format = match (options.tile_format, target.format()) {
        (Some(format_option), Some(named)) if format_option != named => {
            bail!("--tile-format: the names of tiles end in .{}; leave it out", named.extension())
        }
        (format_option, named) => format_option.or(named).unwrap_or_default(),
    };
    request.encoding = TileEncoding { format, png_effort: options.png_effort, quality: options.quality };
    request.zooms = options.zoom.clone();
    request.degrees = degrees(args, &tree)?;
    request.side = args.tiles.tile_size.unwrap_or(256) as usize;
    request.resume = options.resume;
    (request.part, request.parts) = (options.part, expand_lists(options.parts.clone())?);
    request.options = args.tree.steps_text();
    request.name = options.name.clone().unwrap_or(request.name);
    request.attribution = options.attribution.clone().unwrap_or_default();
    let style = options.style.clone().unwrap_or_else(|| Style::default_for(&tree));
    let work = Work::start(global, "tiles")?;
    let mut warp = WarpOptions::default();
    (warp.resampling, warp.allow_ballpark) = (options.resampling, options.allow_ballpark);
    let last = request.zooms.as_ref().map(|zooms| *zooms.end());
    let tiles = tile_source(&tree, request.side, last, &warp, &work)?;
    let update = match &options.update {
        None => None,
        Some(_) if args.tree.is_viewed() => bail!("--update: does not work with --view; write a new archive"),
        Some(_) if args.tree.is_composite(global)? => {
            bail!("--update: does not work with several layers; write a new archive")
        }
        Some(old) => {
            let mut how = UpdateOptions::default();
            (how.old, how.since, how.restyle) = (old.clone(), options.since.clone(), options.restyle);
            Some(how)
        }
    };
    let stored = draw_tiles(&tree, &*tiles, &style, &mut request, target, update.as_ref(), &work)
        .with_context(|| format!("{}: cannot write", args.output.path().display()))?;
    work.finish();
    global.report("tiles", format_args!("{}, {} of them different", stored.tiles, stored.contents));
    if options.update.is_some() && stored.copied > 0 {
        global.report("copied", format_args!("{}", stored.copied));
    }
    report_output(global, target.path(), start);
    Ok(())
}
