//! Updates of tile archives: only tiles that an edit touches, and their parents, are drawn again.
//! All others are copied or stay in place.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::directory::DirectoryEdit;
use super::encode::{Encoded, TileEncoder};
#[cfg(feature = "mbtiles")]
use super::mbtiles::MbtilesEdit;
use super::pmtiles::Pmtiles;
use super::provenance::{SourceState, SpinneyMetadata, TileProvenance};
use super::sink::{TileArchiveSummary, TileEdit};
use super::target::TileTarget;
use super::touched::{TouchedBlocks, TouchedTiles};
use super::walk::{TileExtent, TileSpan, TileTraversal, settled};
use super::{EncodeResult, TileRequest, export_tiles, plan, write};
use crate::window::decide;
use spinney_base::parallel;
use spinney_base::space::Code;
use spinney_base::{Error, Progress, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::ops::{TreeFile, diff_nodes};
use spinney_style::Style;
use spinney_tiles::TileId;
use spinney_tiles::TilePainter;
use spinney_tiles::{TileContent, TileSource};

/// Yields the nodes of a level, or larger blocks, in which a tree differs from the state that an
/// archive was made from. That state is an older commit of the same file, or the file `since`.
fn changes(
    tree: &Dataset,
    state: &SourceState,
    since: Option<&Path>,
    level: u8,
    progress: &dyn Progress,
    block: &mut dyn FnMut(Code),
) -> Result<()> {
    if SourceState::of(tree)?.state == state.state {
        return Ok(());
    }
    let path = tree.name();
    let name = match (since, tree.commit(), state.commit) {
        (Some(since), _, _) => since.to_path_buf(),
        (None, Some(_), Some(number)) => {
            let mut name = path.as_os_str().to_owned();
            name.push(format!("@{number}"));
            name.into()
        }
        _ => {
            let advice = "give the file that it was exported from with --since, or export it again";
            return Err(Error::unsupported(
                path,
                "updating an archive of another file, or of one without commits,",
                advice,
            ));
        }
    };
    let options = tree.access().into();
    let before = TreeFile::open(&name, &options)?;
    let old = spinney_engine::dataset::open(&name, &options)?;
    if SourceState::of(&old)?.state != state.state {
        let advice = "give the file that it was exported from with --since, or export it again";
        return Err(Error::unsupported(
            &name,
            "updating an archive from a file that it was not exported from",
            advice,
        ));
    }
    let mut now = path.as_os_str().to_owned();
    if let Some(commit) = tree.commit() {
        now.push(format!("@{}", commit.number));
    }
    let after = TreeFile::open(now.as_ref(), &options)?;
    let mut nodes = 0u64;
    diff_nodes(&before, &after, level, &mut |found| {
        block(found);
        nodes += 1;
        if nodes.is_multiple_of(1 << 8) { progress.check() } else { Ok(()) }
    })
}

/// The tiles to be updated: an archive that is rewritten, or tiles that are changed in place.
enum OldTiles {
    Pmtiles(Box<Pmtiles>),
    Editable(Box<dyn TileEdit>),
}

/// Options of an update.
#[derive(Clone, Debug, Default)]
pub struct UpdateOptions {
    /// The `PMTiles` archive to start from, if that is not the target itself.
    pub old: Option<PathBuf>,
    /// The tree that the tiles were made from, if that is not a commit of the same file.
    pub since: Option<PathBuf>,
    /// Whether all tiles are drawn, in any style.
    pub restyle: bool,
}

/// An update of tiles that were exported from an older state of a tree. Tiles touched by the
/// differences are drawn. In a `PMTiles` archive the others are copied from an old archive, which
/// may be the target itself; `MBTiles` and directories are changed in place. A `PMTiles` archive or
/// a directory gets the same bytes as a new export with the same percentiles.
///
/// `MBTiles` are changed in one transaction. A directory is changed once all new tiles are staged
/// next to it. An update that is interrupted before that leaves it unchanged. An update that is
/// interrupted later is finished by the next one, whatever that does itself; until then
/// [`verify_tiles`](super::verify_tiles) reports it.
pub struct TileUpdate {
    /// Path of the old tiles.
    place: PathBuf,
    target: TileTarget,
    old: OldTiles,
    own: SpinneyMetadata,
}

impl TileUpdate {
    /// Opens the tiles of a target or, for a `PMTiles` target, another archive to start from. Tiles
    /// that are changed in place are locked until this is dropped. An interrupted update of a
    /// directory is finished first, with a warning.
    ///
    /// # Errors
    /// If the tiles cannot be read, were made by another program, or are being updated by another
    /// process; on cancellation.
    pub fn open(target: &TileTarget, old: Option<&Path>, progress: &dyn Progress) -> Result<TileUpdate> {
        let place = old.unwrap_or(target.path());
        let opened = match target {
            TileTarget::Pmtiles(_) => OldTiles::Pmtiles(Box::new(Pmtiles::open(place)?)),
            _ if place != target.path() => {
                let advice = "copy it first, and update the copy";
                return Err(Error::unsupported(
                    place,
                    "updating MBTiles or a directory from another archive",
                    advice,
                ));
            }
            #[cfg(feature = "mbtiles")]
            TileTarget::Mbtiles(path) => OldTiles::Editable(Box::new(MbtilesEdit::open(path)?)),
            TileTarget::Directory(directory) => {
                OldTiles::Editable(Box::new(DirectoryEdit::open(directory, progress)?))
            }
        };
        let own = match &opened {
            OldTiles::Pmtiles(archive) => archive.own(),
            OldTiles::Editable(edit) => Some(edit.own().clone()),
        };
        let own: SpinneyMetadata = own.ok_or_else(|| {
            let advice = "only archives by this version of `spinney export` can be updated; export it again";
            Error::unsupported(place, "updating an archive by another program or version", advice)
        })?;
        Ok(TileUpdate { place: place.to_path_buf(), target: target.clone(), old: opened, own })
    }

    /// Returns a painter for a style with the percentiles that the tiles were made with. Warns if
    /// the tree's percentiles have changed.
    ///
    /// # Errors
    /// Those of [`TilePainter::new`]; if the tiles were made with another style, or the tree's
    /// palette or units have changed.
    pub fn painter(&self, style: &Style, tree: &Dataset, progress: &dyn Progress) -> Result<TilePainter> {
        let now = TilePainter::new(style, tree, progress)?;
        let Some(old) = &self.own.provenance.colours else { return Ok(now) };
        let redraw = "or --restyle, which draws all tiles again";
        if old.style != style.json() {
            let expected = format!("the style of the tiles, {}, {redraw}", old.style);
            return Err(Error::invalid("style", style.json(), expected));
        }
        let differing = old.percentiles.differences(&now.colours().percentiles, "now");
        if differing.is_empty() {
            return Ok(now);
        }
        let kept = TilePainter::with_numbers(style, tree, Some(&old.percentiles), progress)?;
        let text = format!(
            "colours keep the percentiles that the tiles were made with, {}; --restyle draws all tiles with the present ones",
            differing.join(", ")
        );
        progress.warn(&self.place, &text);
        Ok(kept)
    }

    /// Draws and writes the touched tiles with a painter of [`TileUpdate::painter`]; with
    /// [`UpdateOptions::restyle`] all tiles, with any painter.
    ///
    /// # Errors
    /// Those of [`export_tiles`](super::export_tiles); if the tiles were made with other options or
    /// colours, or from another file.
    pub fn run(
        self,
        tree: &Dataset,
        source: &dyn TileSource,
        painter: &TilePainter,
        request: &TileRequest,
        options: &UpdateOptions,
        progress: &dyn Progress,
    ) -> Result<TileArchiveSummary> {
        let (extent, about, encoder) = plan(source, painter, request)?;
        let provenance = &self.own.provenance;
        provenance.check_options(&about.provenance)?;
        let mut touched = TouchedBlocks::new(source, extent.zooms.clone(), extent.degrees, extent.margin);
        let since = options.since.as_deref();
        let level = extent.zooms.clone().map(|zoom| source.block_level(zoom)).max().unwrap_or(0);
        let level = level.min(tree.depth());
        if !options.restyle {
            self.check_colours(&about.provenance)?;
            changes(tree, &provenance.source, since, level, progress, &mut |code| touched.add(code))?;
        } else if let OldTiles::Pmtiles(_) = self.old {
            touched.add_all();
        } else {
            // Tiles that have become empty must be removed. If the differences are unknown, every
            // tile is checked.
            match changes(tree, &provenance.source, since, level, progress, &mut |code| touched.add(code)) {
                Err(Error::Unsupported { .. }) => touched.add_all(),
                other => other?,
            }
        }
        let touched = touched.tiles;
        progress.check()?;
        match self.old {
            OldTiles::Pmtiles(archive) => {
                let (total, _) = TileTraversal::new(source, &extent).count(progress)?;
                let sink = self.target.sink(&about, request)?;
                let copied = |run: &TileSpan| -> Result<Option<EncodeResult>> {
                    let tile = TileId::from_number(run.first).expect("spans have valid tile numbers");
                    if run.uniform.is_some() || touched.contains(tile) {
                        return Ok(None);
                    }
                    Ok(Some(Ok(archive.tile(tile)?.map(|bytes| Arc::new(Encoded::new(bytes))))))
                };
                write(source, &extent, &encoder, Some(&copied), sink, &about, total, progress)
            }
            OldTiles::Editable(mut edit) => {
                let drawer = TileRedrawer { source, encoder: &encoder, extent: &extent, progress };
                if options.restyle {
                    drawer.redraw_all(&touched, edit.as_mut())?;
                }
                drawer.redraw(&touched, edit.as_mut())?;
                source.check_unchanged()?;
                edit.finish(&about, progress)
            }
        }
    }

    /// Fails if the colours of the tiles have changed.
    fn check_colours(&self, now: &TileProvenance) -> Result<()> {
        let (Some(old), Some(new)) = (&self.own.provenance.colours, &now.colours) else { return Ok(()) };
        if old == new {
            return Ok(());
        }
        let what = if old.style != new.style {
            format!("updating tiles to the style {} from the style {}", new.style, old.style)
        } else if old.percentiles != new.percentiles {
            let differing = old.percentiles.differences(&new.percentiles, "now");
            format!("updating tiles to other percentiles: {}", differing.join(", "))
        } else {
            "updating tiles after a change of the tree's palette, units or meaning of channels".into()
        };
        let advice = "use --restyle to draw all tiles again";
        Err(Error::unsupported(&self.place, what, advice))
    }
}

/// Draws tiles of a tree in a style and writes them to a target, or updates those of the target.
/// Painted tiles get the style's legend.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::export::TileRequest;
/// use spinney::raw::export::tiles::{TileTarget, UpdateOptions, draw_tiles, tile_source};
/// use spinney::style::Style;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("map.pmtiles");
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// let Some(target) = TileTarget::of(&path)? else { unreachable!("it is named so") };
/// let mut request = TileRequest::new(&map)?;
/// let tiles = tile_source(&map, request.side, None, &Default::default(), &())?;
/// let style = Style::default_for(&map);
/// let made = draw_tiles(&map, &*tiles, &style, &mut request, &target, None, &())?;
/// // The tree has not changed, so all of them are copied.
/// let update = UpdateOptions::default();
/// let again = draw_tiles(&map, &*tiles, &style, &mut request, &target, Some(&update), &())?;
/// assert_eq!((again.tiles, again.copied > 0), (made.tiles, true));
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// Those of [`TilePainter::new`] and of [`export_tiles`](super::export_tiles), or of
/// [`TileUpdate::open`], [`TileUpdate::painter`] and [`TileUpdate::run`].
pub fn draw_tiles(
    tree: &Dataset,
    tiles: &dyn TileSource,
    style: &Style,
    request: &mut TileRequest,
    target: &TileTarget,
    update: Option<&UpdateOptions>,
    progress: &dyn Progress,
) -> Result<TileArchiveSummary> {
    let opened = match update {
        None => None,
        Some(how) => Some((TileUpdate::open(target, how.old.as_deref(), progress)?, how)),
    };
    let painter = match &opened {
        Some((opened, how)) if !how.restyle => opened.painter(style, tree, progress)?,
        _ => TilePainter::new(style, tree, progress)?,
    };
    if request.encoding.format.is_array() {
        request.void = decide(std::slice::from_ref(tree), None, tiles.overshoots())?;
        if let (Some(void), Some(own)) = (request.void, tree.metadata().nodata)
            && void != own
        {
            let text =
                format!("has {void} as nodata number, since {own}, that of the layer, is within its values");
            progress.warn(target.path(), &text);
        }
    } else {
        request.legend = painter.painter().legend(tree)?.svg();
    }
    match opened {
        None => export_tiles(tiles, &painter, request, target, progress),
        Some((opened, how)) => opened.run(tree, tiles, &painter, request, how, progress),
    }
}

/// Draws tiles, and replaces old ones.
struct TileRedrawer<'a> {
    source: &'a dyn TileSource,
    encoder: &'a TileEncoder<'a>,
    extent: &'a TileExtent,
    progress: &'a dyn Progress,
}

/// Tiles or runs drawn per batch.
const BATCH: usize = 256;

impl TileRedrawer<'_> {
    /// Replaces the touched tiles, and removes those that have become empty.
    fn redraw(&self, touched: &TouchedTiles, edit: &mut dyn TileEdit) -> Result<()> {
        let total = touched.count();
        let mut all = touched.iter();
        loop {
            let tiles: Vec<TileId> = all.by_ref().take(BATCH).collect();
            if tiles.is_empty() {
                return Ok(());
            }
            let made: Vec<EncodeResult> = parallel::map(&tiles, |tile| {
                self.progress.check()?;
                let content = self.source.content(*tile)?;
                if content == TileContent::Empty {
                    return Ok(None);
                }
                let uniform = settled(self.source, self.extent, *tile, content)?;
                self.encoder.encode(&TileSpan { first: tile.number(), count: 1, uniform })
            });
            for (tile, made) in tiles.iter().zip(made) {
                edit.replace(*tile, made?.as_deref())?;
                self.progress.advance(1, total);
            }
        }
    }

    /// Replaces all non-empty tiles that are not touched.
    fn redraw_all(&self, touched: &TouchedTiles, edit: &mut dyn TileEdit) -> Result<()> {
        let (total, _) = TileTraversal::new(self.source, self.extent).count(self.progress)?;
        let mut walk = TileTraversal::new(self.source, self.extent);
        loop {
            let runs = walk.next_runs(BATCH)?;
            if runs.is_empty() {
                return Ok(());
            }
            let made: Vec<EncodeResult> = parallel::map(&runs, |run| {
                self.progress.check()?;
                self.encoder.encode(run)
            });
            for (run, made) in runs.iter().zip(made) {
                let made = made?;
                for number in run.first..run.first + run.count {
                    let tile = TileId::from_number(number).expect("spans have valid tile numbers");
                    if !touched.contains(tile) {
                        edit.replace(tile, made.as_deref())?;
                    }
                }
                self.progress.advance(run.count, total);
            }
        }
    }
}
