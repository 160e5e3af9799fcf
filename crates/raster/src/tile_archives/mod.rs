//! Archives and directories of map tiles: images or arrays of squares of the world at each zoom, as
//! web maps request them.
//!
//! [`export_tiles`] traverses the tiles from the root down (`walk.rs`). Empty regions are skipped,
//! and a uniform region is drawn as a single tile, regardless of the number of tiles in it. All
//! other tiles are read from a [`TileSource`], painted by a [`TilePainter`] and encoded, on all
//! threads. The archive receives them in the order of their numbers, so its bytes do not depend on
//! threads.
//!
//! ```
//! # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
//! use spinney::export::{TileRequest, export_tiles};
//! use spinney::raw::export::tiles::{Pmtiles, TileId, TilePainter, TileTarget, WarpedTiles};
//! use spinney::import::raster::{ImportOptions, plan};
//! use spinney::Output;
//! use spinney::style::Style;
//!
//! # let directory = tempfile::tempdir().unwrap();
//! # let path = directory.path().join("island.goblin");
//! plan(&["fixtures/island_classes.tif".into()], &ImportOptions::default())?
//!     .build(Output::create(&path)?, &())?;
//! let map = spinney::open(&path)?;
//! let source = map.whole_source().expect("it is no view");
//! let tiles = WarpedTiles::new(source, &map.metadata().frame, 256, Some(9), &Default::default())?;
//! let painter = TilePainter::new(&Style::default_for(&map), &map, &())?;
//! let archive = directory.path().join("island.pmtiles");
//! export_tiles(
//!     &tiles, &painter, &TileRequest::new(&map)?, &TileTarget::Pmtiles(archive.clone()), &())?;
//! assert!(Pmtiles::open(&archive)?.tile(TileId { zoom: 0, column: 0, row: 0 })?.is_some());
//! # Ok::<(), spinney::Error>(())
//! ```

mod directory;
mod encode;
mod journal;
#[cfg(feature = "mbtiles")]
mod mbtiles;
mod parts;
mod pmtiles;
mod png;
mod provenance;
mod sink;
mod target;
mod tiff;
mod touched;
mod update;
mod walk;

use std::collections::BTreeMap;
use std::fs::File;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

pub use directory::{TileDirectory, is_tile_directory};
pub use encode::{TileEncoding, TileFormat, encode_tile};
pub use parts::TileShard;
pub use pmtiles::Pmtiles;
pub use provenance::{SourceState, TileProvenance};
pub use sink::TileArchiveSummary;
pub use target::TileTarget;
pub use update::{TileUpdate, UpdateOptions, draw_tiles};

use self::encode::{Encoded, TileEncoder};
use self::parts::ShardArchives;
use self::pmtiles::PmtilesSink;
use self::provenance::TilesetMetadata;
use self::sink::TileSink;
use self::walk::{TileExtent, TileSpan, TileTraversal};
use crate::window::void_number;
use spinney_base::io::{FileAccess, Output, without_query};
use spinney_base::parallel;
use spinney_base::value::Number;
use spinney_base::{Error, Progress, Result};
use spinney_container::Finding;
use spinney_engine::dataset::Dataset;
use spinney_tiles::{GeographicExtent, MAX_ZOOM, TilePainter, TileSource, check_degrees};

/// Request for an export: its extent, encoding and metadata.
#[derive(Clone, Debug)]
pub struct TileRequest {
    /// Zooms; the default is from 0 to the zoom at about the source's resolution.
    pub zooms: Option<RangeInclusive<u8>>,
    /// West, south, east, north in degrees: tiles that do not intersect this box are omitted. The
    /// default is the whole source.
    pub degrees: Option<[f64; 4]>,
    /// Pixels per side of a tile: 256 or 512.
    pub side: usize,
    /// Encoding of the tiles.
    pub encoding: TileEncoding,
    /// Name of the map.
    pub name: String,
    /// Description of the map.
    pub description: String,
    /// Attribution of the data.
    pub attribution: String,
    /// Meaning of the colours.
    pub legend: String,
    /// Further options that determine the tiles, such as views. They must be the same to resume the
    /// export.
    pub options: String,
    /// State of the tree.
    pub source: SourceState,
    /// Whether the export resumes an interrupted one, and can be resumed itself.
    pub resume: bool,
    /// The number for VOID cells of arrays; by default [`draw_tiles`] chooses one.
    pub void: Option<Number>,
    /// Restricts the export to this share of the tiles, so that other processes write the others.
    pub part: Option<TileShard>,
    /// Archives of all shares of this export, in any order. They are merged into the same bytes as
    /// an export by a single process.
    pub parts: Vec<PathBuf>,
    /// File access for the target: that of the tree.
    pub access: FileAccess,
}

impl TileRequest {
    /// PNG tiles of 256 pixels, of the whole tree.
    ///
    /// # Errors
    /// If the tree's file cannot be read.
    pub fn new(tree: &Dataset) -> Result<TileRequest> {
        // The bounds of views can take long to compute, and painted tiles do not need them.
        let void = if tree.as_file().is_some() { void_number(tree)? } else { None };
        Ok(TileRequest {
            zooms: None,
            degrees: None,
            side: 256,
            encoding: TileEncoding::default(),
            name: without_query(tree.name()).file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            description: String::new(),
            attribution: String::new(),
            legend: String::new(),
            options: String::new(),
            source: SourceState::of(tree)?,
            resume: false,
            void,
            part: None,
            parts: Vec::new(),
            access: tree.access(),
        })
    }
}

/// Whether a path is an archive of tiles, by its first bytes, or a directory of tiles.
pub fn is_tile_archive(path: &Path) -> bool {
    let mut start = [0; 16];
    let read = |file: File| spinney_base::io::platform::read_exact_at(&file, &mut start, 0);
    let is_archive = path.is_file()
        && File::open(path).and_then(read).is_ok()
        && (start.starts_with(b"PMTiles") || start == *b"SQLite format 3\0");
    is_archive || is_tile_directory(path)
}

/// Verifies an exported archive or directory of tiles: all tiles exist, in order, with the bytes
/// that were written.
///
/// # Errors
/// If it cannot be read or is not such an export, or on cancellation.
pub fn verify_tiles(path: &Path, progress: &dyn Progress) -> Result<Vec<Finding>> {
    if is_tile_directory(path) {
        return directory::verify(path, progress);
    }
    let extension = path.extension().and_then(|end| end.to_str()).unwrap_or_default();
    #[cfg(feature = "mbtiles")]
    if extension.eq_ignore_ascii_case("mbtiles") {
        return mbtiles::verify(path, progress);
    }
    let _ = extension;
    Pmtiles::open(path)?.verify(progress)
}

/// Runs between two checkpoints.
const CHECKPOINT: u64 = 1 << 12;
/// Bytes of samples drawn per batch.
const BATCH: usize = 32 << 20;

/// Writes tiles of a source to an archive or a directory.
///
/// Memory does not grow with the number of tiles. An interrupted export leaves nothing. With
/// [`TileRequest::resume`] it leaves its progress, and the next export of the same source with the
/// same options resumes it. The result has the same bytes as an uninterrupted export.
///
/// # Errors
/// If the request is invalid, the source cannot be read or has changed meanwhile, the target cannot
/// be written or has the beginning of another export, or on cancellation.
pub fn export_tiles(
    source: &dyn TileSource,
    painter: &TilePainter,
    request: &TileRequest,
    target: &TileTarget,
    progress: &dyn Progress,
) -> Result<TileArchiveSummary> {
    let (mut extent, mut about, encoder) = plan(source, painter, request)?;
    let parts = ShardArchives::open(&request.parts, &about)?;
    if let Some(part) = request.part {
        if !matches!(target, TileTarget::Pmtiles(_)) || parts.is_some() {
            let advice = "write a .pmtiles archive, and merge all parts into the target later";
            return Err(Error::unsupported(target.path(), "a part of the tiles in this format", advice));
        }
        part.take(source, &mut extent, &mut about, progress)?;
    }
    let (total, _) = TileTraversal::new(source, &extent).count(progress)?;
    let sink = target.sink(&about, request)?;
    let copied = |run: &TileSpan| Ok(parts.as_ref().map(|parts| parts.made(run)));
    write(source, &extent, &encoder, Some(&copied), sink, &about, total, progress)
}

/// Writes tiles as [`export_tiles`] does, to a `PMTiles` archive at an output.
///
/// # Errors
/// Those of [`export_tiles`]; [`TileRequest::resume`] requires a target.
pub fn export_pmtiles(
    source: &dyn TileSource,
    painter: &TilePainter,
    request: &TileRequest,
    output: Output,
    progress: &dyn Progress,
) -> Result<TileArchiveSummary> {
    if request.resume || request.part.is_some() || !request.parts.is_empty() {
        return Err(Error::invalid("resume, or parts", "an output without a path", "a target with a path"));
    }
    let (extent, about, encoder) = plan(source, painter, request)?;
    let (total, _) = TileTraversal::new(source, &extent).count(progress)?;
    let sink = Box::new(PmtilesSink::create(output, None)?);
    write(source, &extent, &encoder, None, sink, &about, total, progress)
}

/// Computes the extent of an export, its metadata, and its encoder.
fn plan<'a>(
    source: &'a dyn TileSource,
    painter: &'a TilePainter,
    request: &TileRequest,
) -> Result<(TileExtent, TilesetMetadata, TileEncoder<'a>)> {
    let side = request.side;
    if !matches!(side, 256 | 512) {
        return Err(Error::invalid("tile size", side.to_string(), "256 or 512"));
    }
    let zooms = request.zooms.clone().unwrap_or(0..=source.max_zoom(side));
    if zooms.is_empty() || *zooms.end() > MAX_ZOOM {
        let found = format!("{} to {}", zooms.start(), zooms.end());
        return Err(Error::invalid(
            "zooms",
            found,
            format!("the minimum and maximum zoom, at most {MAX_ZOOM}"),
        ));
    }
    let own = source.degrees();
    let degrees = match request.degrees {
        None => own,
        Some(requested) => {
            check_degrees(requested)?;
            // The intersection: the larger west and south, the smaller east and north.
            std::array::from_fn(
                |at| if at < 2 { requested[at].max(own[at]) } else { requested[at].min(own[at]) },
            )
        }
    };
    if degrees[0] >= degrees[2] || degrees[1] >= degrees[3] {
        let found = format!("{:?}", request.degrees.unwrap_or(own));
        return Err(Error::invalid(
            "box of tiles",
            found,
            format!("a box that intersects {own:?} (west, south, east, north in degrees)"),
        ));
    }
    let data = source.data_place()?;
    let place = match request.degrees {
        None => data,
        Some(_) => {
            let [w, s, e, n] = data.bounds;
            let [west, south, east, north] = degrees;
            let common = [west.max(w), south.max(s), east.min(e), north.min(n)];
            let is_some = common[0] < common[2] && common[1] < common[3];
            GeographicExtent::of_bounds(if is_some { common } else { degrees })
        }
    };
    if request.encoding.format.is_array() && request.void.is_none() {
        // Fail before the first byte: some tile of the square has cells outside of the data, at
        // least at its edge.
        return Err(encode::no_number(source.value_type()));
    }
    let encoder = TileEncoder::new(source, painter, request.encoding, side, request.void)?;
    let TileEncoding { format, png_effort, quality } = request.encoding;
    let void = request.void.filter(|_| format.is_array());
    let number = |number: Option<u8>| number.map_or("none".into(), |number| number.to_string());
    let mut options = BTreeMap::from([
        ("zooms".into(), format!("{}-{}", zooms.start(), zooms.end())),
        ("degrees".into(), degrees.map(|degrees| degrees.to_string()).join(",")),
        ("side".into(), side.to_string()),
        ("format".into(), format.extension().into()),
        ("png-effort".into(), number(png_effort)),
        ("quality".into(), number(quality)),
        ("void".into(), void.map_or("none".into(), |void| void.to_string())),
    ]);
    let grid = request.options.clone() + &source.signature();
    if !grid.is_empty() {
        options.insert("grid".into(), grid);
    }
    let colours = (!format.is_array()).then(|| painter.colours().clone());
    let about = TilesetMetadata {
        format,
        zooms: [*zooms.start(), *zooms.end()],
        place,
        side,
        name: request.name.clone(),
        description: request.description.clone(),
        attribution: request.attribution.clone(),
        legend: request.legend.clone(),
        provenance: TileProvenance { source: request.source.clone(), options, colours },
    };
    let is_georeferenced = format == TileFormat::Tiff;
    Ok((
        TileExtent { zooms, degrees, margin: encoder.margin(), is_georeferenced, runs: 0..u64::MAX },
        about,
        encoder,
    ))
}

/// A tile of a run, or `None` if it is empty.
type EncodeResult = Result<Option<Arc<Encoded>>>;

/// Copies a run from another archive; returns `None` if it must be drawn.
type CopySpan<'a> = dyn Fn(&TileSpan) -> Result<Option<EncodeResult>> + Sync + 'a;

/// Draws all runs that the sink does not have yet. Each batch is written while the next one is
/// drawn.
#[allow(clippy::too_many_arguments)] // inputs of a single task
fn write(
    source: &dyn TileSource,
    extent: &TileExtent,
    encoder: &TileEncoder<'_>,
    copied: Option<&CopySpan<'_>>,
    mut sink: Box<dyn TileSink>,
    about: &TilesetMetadata,
    total: u64,
    progress: &dyn Progress,
) -> Result<TileArchiveSummary> {
    let mut walk = TileTraversal::new(source, extent);
    let mut runs = sink.done();
    for _ in 0..runs {
        progress.advance(walk.next_run()?.map_or(0, |run| run.count), total);
    }
    let bytes = (about.side + 2 * extent.margin).pow(2) * (source.value_type().size() + 4);
    let batch = (BATCH / bytes).clamp(8, 256);
    let copies = AtomicU64::new(0);
    let draw_one = |run: &TileSpan| -> EncodeResult {
        progress.check()?;
        if let Some(copied) = copied
            && let Some(made) = copied(run)?
        {
            copies.fetch_add(1, Ordering::Relaxed);
            return made;
        }
        encoder.encode(run)
    };
    let draw = |runs: &[TileSpan]| -> Vec<EncodeResult> { parallel::map(runs, draw_one) };
    let mut drawn: (Vec<TileSpan>, Vec<EncodeResult>) = (Vec::new(), Vec::new());
    loop {
        let next = walk.next_runs(batch)?;
        if next.is_empty() && drawn.0.is_empty() {
            break;
        }
        let sink = &mut sink;
        let take = || -> Result<()> {
            for (run, made) in drawn.0.iter().zip(drawn.1) {
                sink.push(run, made?.as_deref())?;
                progress.advance(run.count, total);
                runs += 1;
                if runs.is_multiple_of(CHECKPOINT) {
                    sink.checkpoint()?;
                }
            }
            Ok(())
        };
        let (made, taken) = parallel::join(|| draw(&next), take);
        taken?;
        drawn = (next, made);
    }
    source.check_unchanged()?;
    progress.check()?;
    let stored = sink.finish(about)?;
    Ok(TileArchiveSummary { copied: copies.into_inner(), ..stored })
}
