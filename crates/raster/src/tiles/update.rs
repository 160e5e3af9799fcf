//! Updates: only tiles that an edit touches are drawn anew, up to the parents; all others are copied, or stay where they are.

use std::collections::HashSet;
use std::path::Path;

use super::encode::{Encoded, TileEncoder};
use super::folder::FolderEdit;
use super::making::{Own, SourceState};
#[cfg(feature = "mbtiles")]
use super::mbtiles::MbtilesEdit;
use super::place::{TileId, TileRange};
use super::pmtiles::Pmtiles;
use super::sink::{Stored, TileEdit};
use super::source::{TileContent, TileSource};
use super::target::TileTarget;
use super::walk::{TileExtent, TileRun, TileWalk};
use super::{Made, TilePainter, TileRequest, plan, write};
use spinney_base::parallel;
use spinney_base::sort;
use spinney_base::space::Code;
use spinney_base::{Error, Progress, Result};
use spinney_container::OpenOptions;
use spinney_engine::dataset::Dataset;
use spinney_engine::ops::{TreeFile, diff};

/// Tiles of all zooms that differences touch.
#[derive(Default)]
struct Touched {
    tiles: HashSet<TileId>,
    /// Large rectangles, of which there are few.
    wide: Vec<(u8, TileRange)>,
}

/// Tiles of the largest rectangle whose tiles are listed one by one.
const WIDE: u64 = 1 << 10;

impl Touched {
    /// Adds a rectangle, and the tiles around it whose pictures depend on those in it.
    fn add(&mut self, zoom: u8, range: TileRange, margin: usize, within: &TileRange) {
        let side = 1u32 << zoom;
        let more = u32::from(margin > 0);
        let min = range.min.map(|at| at.saturating_sub(more));
        let max = range.max.map(|at| (at + more).min(side));
        let mut ranges = vec![TileRange { min, max }];
        // Beyond the antimeridian the other side's columns are neighbours.
        if more > 0 && range.min[0] == 0 {
            ranges.push(TileRange { min: [side - 1, min[1]], max: [side, max[1]] });
        }
        if more > 0 && range.max[0] == side {
            ranges.push(TileRange { min: [0, min[1]], max: [1, max[1]] });
        }
        for range in ranges {
            let range = range.intersect(within);
            if range.is_empty() {
                continue;
            }
            let [columns, rows] = [0, 1].map(|axis| u64::from(range.max[axis] - range.min[axis]));
            if columns * rows > WIDE {
                if !self.wide.contains(&(zoom, range)) {
                    self.wide.push((zoom, range));
                }
                continue;
            }
            self.tiles.extend(tiles_of(zoom, range));
        }
    }

    fn contains(&self, tile: TileId) -> bool {
        let own = TileRange { min: [tile.column, tile.row], max: [tile.column + 1, tile.row + 1] };
        self.tiles.contains(&tile)
            || self.wide.iter().any(|(zoom, range)| *zoom == tile.zoom && range.contains(&own))
    }

    /// All of them, in order.
    fn all(&self) -> Vec<TileId> {
        let wide = self.wide.iter().flat_map(|(zoom, range)| tiles_of(*zoom, *range));
        let mut all: Vec<TileId> = self.tiles.iter().copied().chain(wide).collect();
        sort::by_key(&mut all, |tile| tile.number());
        all.dedup();
        all
    }
}

fn tiles_of(zoom: u8, range: TileRange) -> impl Iterator<Item = TileId> {
    let columns = move |row| (range.min[0]..range.max[0]).map(move |column| TileId { zoom, column, row });
    (range.min[1]..range.max[1]).flat_map(columns)
}

/// Hands out the blocks in which a tree differs from the state that an archive was made of: that is an older commit of the same
/// file, or the file `since`.
fn changes(
    tree: &Dataset,
    state: &SourceState,
    since: Option<&Path>,
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
            let advice = "give the file that it was made of with --since, or make it anew";
            return Err(Error::unsupported(
                path,
                "an update of an archive of another file, or of one without commits",
                advice,
            ));
        }
    };
    let options = OpenOptions::default();
    let before = TreeFile::open(&name, &options)?;
    let old = spinney_engine::dataset::open(&name, &options)?;
    if SourceState::of(&old)?.state != state.state {
        let advice = "give the file that it was made of with --since, or make it anew";
        return Err(Error::unsupported(
            &name,
            "an update of an archive that was made of something else",
            advice,
        ));
    }
    let mut now = path.as_os_str().to_owned();
    if let Some(commit) = tree.commit() {
        now.push(format!("@{}", commit.number));
    }
    let after = TreeFile::open(now.as_ref(), &options)?;
    diff(&before, &after, &mut |found| {
        block(found.code);
        Ok(())
    })
}

/// Tiles that are updated: an archive that is written anew, or what is changed in place.
enum Old {
    Pmtiles(Box<Pmtiles>),
    InPlace(Box<dyn TileEdit>),
}

/// Brings tiles that were exported from an older state of a tree up to date: draws those that the differences touch, and copies
/// the others from `old`, an archive of `PMTiles` that may be the target itself; `MBTiles` and folders are changed in place, the former
/// all at once. A `PMTiles` archive has the bytes that a new export would have.
///
/// `since` is the tree that the archive was made of, where that is no commit of the same file.
///
/// # Errors
/// Those of [`export_tiles`](super::export_tiles); if the archive was made with other options, by another program, or of another file.
#[allow(clippy::too_many_arguments)] // those of an export, and the old archive
pub fn update_tiles(
    tree: &Dataset,
    source: &dyn TileSource,
    painter: &TilePainter,
    request: &TileRequest,
    target: &TileTarget,
    old: Option<&Path>,
    since: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Stored> {
    let (extent, about, encoder) = plan(source, painter, request)?;
    let place = old.unwrap_or(target.path());
    let in_place = || {
        let advice = "copy it first, and update the copy";
        Error::unsupported(place, "an update of one of these from another", advice)
    };
    let opened = match target {
        TileTarget::Pmtiles(_) => Old::Pmtiles(Box::new(Pmtiles::open(place)?)),
        _ if old.is_some_and(|old| old != target.path()) => return Err(in_place()),
        #[cfg(feature = "mbtiles")]
        TileTarget::Mbtiles(path) => Old::InPlace(Box::new(MbtilesEdit::open(path)?)),
        TileTarget::Folder(folder) => Old::InPlace(Box::new(FolderEdit::open(folder.base())?)),
    };
    let own = match &opened {
        Old::Pmtiles(archive) => archive.own(),
        Old::InPlace(edit) => Some(edit.own().clone()),
    };
    let own: Own = own.ok_or_else(|| {
        let advice = "only what `spinney export` wrote says how it was made; make it anew";
        Error::unsupported(place, "an update of an archive of another program", advice)
    })?;
    if own.making.options != about.making.options {
        let expected = format!("those that it was made with: {}", own.making.options);
        return Err(Error::invalid("options of the update", about.making.options, expected));
    }
    let mut touched = Touched::default();
    let mut last = None;
    changes(tree, &own.making.source, since, &mut |code| {
        // (Differences come in FD order: most lie in the same tile as the one before.)
        let deepest = source.tiles_of(code, *extent.zooms.end());
        if last != Some(deepest) {
            last = Some(deepest);
            for zoom in extent.zooms.clone() {
                let within = TileRange::of_degrees(zoom, extent.degrees);
                touched.add(zoom, source.tiles_of(code, zoom), extent.margin, &within);
            }
        }
    })?;
    progress.check()?;
    match opened {
        Old::Pmtiles(archive) => {
            let total = TileWalk::new(source, &extent).count(progress)?;
            let sink = target.sink(&about, request.resume)?;
            let copied = |run: &TileRun| -> Result<Option<Made>> {
                let tile = TileId::from_number(run.first).expect("a run of tiles");
                if run.uniform.is_some() || touched.contains(tile) {
                    return Ok(None);
                }
                Ok(Some(Ok(archive.tile(tile)?.map(|bytes| std::sync::Arc::new(Encoded::new(bytes))))))
            };
            write(source, &extent, &encoder, Some(&copied), sink, &about, total, progress)
        }
        Old::InPlace(mut edit) => {
            redraw(source, &extent, &encoder, &touched, edit.as_mut(), progress)?;
            edit.finish(&about)
        }
    }
}

/// Draws the tiles that are touched, and replaces them in order.
fn redraw(
    source: &dyn TileSource,
    extent: &TileExtent,
    encoder: &TileEncoder<'_>,
    touched: &Touched,
    edit: &mut dyn TileEdit,
    progress: &dyn Progress,
) -> Result<()> {
    let all = touched.all();
    for tiles in all.chunks(256) {
        let made: Vec<Made> = parallel::map(tiles, |tile| {
            progress.check()?;
            let uniform = match source.content(*tile)? {
                TileContent::Empty => return Ok(None),
                TileContent::Uniform(value) if extent.margin == 0 => Some(value),
                _ => None,
            };
            encoder.encode(&TileRun { first: tile.number(), count: 1, uniform })
        });
        for (tile, made) in tiles.iter().zip(made) {
            edit.replace(*tile, made?.as_deref())?;
            progress.advance(1, all.len() as u64);
        }
    }
    source.check_unchanged()
}
