//! Cloud-optimized GeoTIFF: all levels of a quadtree in tiles, laid out so that remote readers need
//! few requests for any of them.
//!
//! The overviews are the tree's own levels: they follow the tree's rule, and nothing is resampled.
//! The layout is that of GDAL's COG driver: directories, then tile tables, then tiles, beginning
//! with those of the smallest overview. Each tile is preceded by its length and followed by a copy
//! of its last bytes. Tiles without values are not stored.

mod encode;
mod layout;

use self::encode::{EncodedTile, Encoder};
use self::layout::{LevelTiles, StoredTiles, Tables, lay_out};
use super::image::seekable::Seekable;
use super::image::tiff::BIG_BYTES;
use super::image::tiff_coding::{Coder, Coding};
use super::image::tiff_tags::word;
use super::image::{Format, ImageSpec, write_sidecar};
use super::window::{DEFAULT_MEMORY, Detail, OutputGrid, VoidCells, WindowRequest, image_spec};
use spinney_base::io::Output;
use spinney_base::io::batch;
use spinney_base::value::{DataKind, Number};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Metadata, TagScope};
use spinney_crs::web_mercator_depth;
use spinney_engine::dataset::Dataset;

/// Tile size, compression and nodata number of a cloud-optimized GeoTIFF.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct CogRequest {
    /// Columns and rows of a tile: a multiple of 16, from 64 to 4096.
    pub tile_size: u32,
    /// Compression of tiles.
    pub compression: CogCompression,
    /// The number for VOID cells; an error if it lies within the range of the values.
    /// [`void_number`](super::void_number) chooses the default. If every number is a value, the
    /// file gets a mask instead.
    pub nodata: Option<Number>,
    /// Memory budget in bytes; one tile must fit.
    pub memory: u64,
}

impl CogRequest {
    /// Tiles of 512 x 512 pixels, with a memory budget of 64 MiB.
    pub fn new() -> CogRequest {
        let compression = CogCompression::default();
        CogRequest { tile_size: 512, compression, nodata: None, memory: DEFAULT_MEMORY }
    }
}

impl Default for CogRequest {
    fn default() -> CogRequest {
        CogRequest::new()
    }
}

/// Compression of a cloud-optimized GeoTIFF. All are lossless.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CogCompression {
    /// Deflate, which every TIFF reader supports.
    #[default]
    Deflate,
    /// Zstandard: smaller and faster, for readers with libtiff 4.0.10 or newer.
    Zstd,
    /// Uncompressed samples.
    None,
}

/// Size of a written file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CogSummary {
    /// Number of overviews: levels above the deepest.
    pub overviews: usize,
    /// Number of stored tiles, of all levels.
    pub tiles: u64,
    /// Number of tiles that are not stored, because all of their cells are VOID.
    pub sparse_tiles: u64,
    /// Whether masks encode VOID cells.
    pub has_masks: bool,
}

/// Writes a quadtree, or a view of one, as a cloud-optimized GeoTIFF. The file has the deepest
/// level and, as overviews, all levels above it up to the first that fits one tile. Each pixel is
/// the node of its level. Statistics, palette, names and coordinate system are included. Names of
/// values are also written to a sidecar, for programs that do not find them in the file.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::export::{CogRequest, export_cog};
/// use spinney::Output;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("map.tif");
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// let summary = export_cog(&map, &CogRequest::new(), Output::create(&path)?, &())?;
/// assert_eq!(summary.overviews, 0);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// Of a file on the grid of web maps, whose root is the world, only the cells around the data are
/// written.
///
/// # Errors
/// If the tree is an octree, its raster is empty, the tile size is invalid, a tile exceeds the
/// memory budget, the tile tables alone need more space than is available, the tree is corrupt or
/// has changed meanwhile, the output cannot be written, or on cancellation.
pub fn export_cog(
    tree: &Dataset,
    request: &CogRequest,
    output: Output,
    progress: &dyn Progress,
) -> Result<CogSummary> {
    if tree.header().form.axes() != 2 {
        let advice = "export slices of it with `spinney get`, or a mesh";
        return Err(Error::unsupported(output.path(), "an octree as a cloud-optimized GeoTIFF", advice));
    }
    if !request.tile_size.is_multiple_of(16) || !(64..=4096).contains(&request.tile_size) {
        let expected = "a multiple of 16, from 64 to 4096";
        return Err(Error::invalid("tile size", request.tile_size.to_string(), expected));
    }
    let part = part_of_world(tree, request.tile_size)?;
    let tree = part.as_ref().unwrap_or(tree);
    let (spec, void) = deepest_image(tree, request)?;
    let has_masks = spec.needs_mask();
    void.check((output.path(), spec.value.sample), Format::Tiff, progress)?;
    let value = spec.value;
    let side = u64::from(request.tile_size);
    let tile_bytes = side * side * value.size() as u64;
    // Cells, their validity flags, and the compressed copies.
    let needed = 3 * tile_bytes + 2 * side * side;
    if needed > request.memory {
        return Err(Error::TooLarge {
            path: tree.name().to_path_buf(),
            what: format!("a tile of {side} x {side} cells"),
            needed,
            limit: request.memory,
            advice: "request smaller tiles".into(),
        });
    }
    let coder = match request.compression {
        CogCompression::Deflate => Coder::Deflate { level: 6 },
        CogCompression::Zstd => Coder::Zstd { level: 6 },
        CogCompression::None => Coder::Uncompressed,
    };
    let has_labels = spec.metadata.palette.is_some() || tree.header().kind == DataKind::Categorical;
    let coding = Coding::new(value, side as usize * value.size(), has_labels, coder);
    let levels = levels(tree, side);
    let tiles: u64 = levels.iter().map(LevelTiles::count).sum();
    let most = tiles.saturating_mul(tile_bytes + tile_bytes / 64 + side * side / 8 + 4096);
    let file = lay_out(&spec, &coding, &levels, request.tile_size, has_masks, most > BIG_BYTES);
    output.check_space(file.end)?;
    let (path, access) = (output.path().to_path_buf(), output.access().clone());
    let mut writer = Writer {
        output: Seekable::new(output)?,
        big: file.big,
        encoder: Encoder::new(tree, &spec, void.fill.unwrap_or_default(), coding, side, has_masks),
        batch: (request.memory / needed).min(1 << 10),
        cells: levels.iter().map(LevelTiles::cells).sum(),
        progress,
        stored: 0,
    };
    writer.output.append(&file.bytes)?;
    writer.reserve(file.end)?;
    let mut above: Option<StoredTiles<'_>> = None;
    for (level, tables) in levels.iter().zip(&file.tables).rev() {
        above = Some(writer.write_level(level, tables, above.as_ref())?);
    }
    tree.check_unchanged()?;
    let stored = writer.stored;
    writer.output.commit()?;
    write_sidecar((&path, &access), Format::Tiff, &spec.metadata, progress)?;
    let overviews = levels.len() - 1;
    Ok(CogSummary { overviews, tiles: stored, sparse_tiles: tiles - stored, has_masks })
}

/// Of a file on the grid of web maps, returns the cells around its data, aligned to cells of each
/// overview; `None` for other trees.
fn part_of_world(tree: &Dataset, tile_size: u32) -> Result<Option<Dataset>> {
    let (frame, extent) = (&tree.metadata().frame, tree.header().extent);
    let file = tree.as_file().filter(|_| web_mercator_depth(frame, extent).is_some());
    let Some((file, data)) = file.zip(tree.data_box()?) else { return Ok(None) };
    let [width, height, _] = data.size();
    let overviews = (width.max(height) / u64::from(tile_size)).max(1).ilog2();
    let first = data.min.map(|cell| cell >> overviews << overviews);
    let [width, height] = [0, 1].map(|axis| data.max[axis] - first[axis]);
    let window = format!("window={},{},{width},{height}", first[0], first[1]).parse()?;
    Dataset::of(file.into())?.view(&[window]).map(Some)
}

/// The image of a tree's deepest level, with the tree's statistics in its metadata, and the number
/// for VOID.
fn deepest_image(tree: &Dataset, request: &CogRequest) -> Result<(ImageSpec, VoidCells)> {
    let window = WindowRequest::new(tree.header().extent_bounds(), Detail::Level(tree.depth()));
    let grid = OutputGrid::of(tree, &window)?;
    let void = VoidCells::of(std::slice::from_ref(tree), window.bounds, request.nodata)?;
    let mut spec = image_spec(tree, &grid, &void);
    add_statistics(&mut spec.metadata, tree)?;
    Ok((spec, void))
}

/// Adds the tree's exact statistics, by GDAL's names.
fn add_statistics(metadata: &mut Metadata, tree: &Dataset) -> Result<()> {
    let statistics = tree.statistics(None, &())?;
    let cells = statistics.cells + statistics.void_cells;
    for (number, channel) in statistics.channels.iter().enumerate().filter(|(_, channel)| channel.cells > 0) {
        let numbers = [
            ("STATISTICS_MAXIMUM", channel.max),
            ("STATISTICS_MEAN", Number::from(channel.mean)),
            ("STATISTICS_MINIMUM", channel.min),
            ("STATISTICS_STDDEV", channel.standard_deviation.into()),
            ("STATISTICS_VALID_PERCENT", (100.0 * channel.cells as f64 / cells as f64).into()),
        ];
        if numbers.iter().all(|(_, number)| number.is_finite()) {
            let scope = TagScope { channel: Some(number as u16), domain: String::new() };
            let tags = numbers.map(|(name, number)| (name.into(), number.to_string()));
            metadata.scoped_tags.entry(scope).or_default().extend(tags);
        }
    }
    Ok(())
}

/// Returns the written levels, the deepest first. The last one is the deepest level that fits into
/// one tile.
fn levels(tree: &Dataset, side: u64) -> Vec<LevelTiles> {
    let mut levels = Vec::new();
    for level in (0..=tree.depth()).rev() {
        let [width, height, _] = tree.extent_at(level).max;
        levels.push(LevelTiles { level, width, height, side });
        if width.max(height) <= side {
            break;
        }
    }
    levels
}

/// Writes tiles consecutively, and their offsets into the tables.
struct Writer<'a> {
    output: Seekable,
    big: bool,
    encoder: Encoder<'a>,
    /// Tiles encoded at a time.
    batch: u64,
    /// Cells of all levels.
    cells: u64,
    progress: &'a dyn Progress,
    stored: u64,
}

impl Writer<'_> {
    /// Fills the file with zeros up to `end`.
    fn reserve(&mut self, end: u64) -> Result<()> {
        let zeros = [0; 1 << 16];
        while self.output.position() < end {
            self.progress.check()?;
            let count = (end - self.output.position()).min(zeros.len() as u64);
            self.output.append(&zeros[..count as usize])?;
        }
        Ok(())
    }

    /// Writes the tiles of a level, given the stored tiles of the level above.
    fn write_level<'l>(
        &mut self,
        level: &'l LevelTiles,
        tables: &Tables,
        above: Option<&StoredTiles<'_>>,
    ) -> Result<StoredTiles<'l>> {
        let mut stored_tiles = StoredTiles::new(level);
        for first in (0..level.count()).step_by(self.batch as usize) {
            let numbers: Vec<u64> = (first..level.count().min(first + self.batch)).collect();
            let tiles: Vec<Option<EncodedTile>> = batch::map(&numbers, |number| {
                self.progress.check()?;
                // Nothing is below a tile that is not stored.
                let may_be = above.is_none_or(|above| above.is_above(level, *number));
                let tile = if may_be { self.encoder.encode(level, *number)? } else { None };
                self.progress.advance(level.cells_of(*number), self.cells);
                Ok(tile)
            })?;
            let (mut locations, mut mask_locations) = (Vec::new(), Vec::new());
            for (number, tile) in numbers.iter().zip(&tiles) {
                let stored = tile.as_ref().map(|tile| &tile.cells);
                locations.push(self.append(stored.map(|cells| cells.as_slice()))?);
                let mask = tile.as_ref().and_then(|tile| tile.mask.as_ref());
                if tables.mask.is_some() {
                    mask_locations.push(self.append(mask.map(|mask| mask.as_slice()))?);
                }
                if tile.is_some() {
                    self.stored += 1;
                    stored_tiles.insert(*number);
                }
            }
            self.enter(&locations, tables.cells, first)?;
            if let Some(table) = tables.mask {
                self.enter(&mask_locations, table, first)?;
            }
        }
        Ok(stored_tiles)
    }

    /// Appends a tile, preceded by its length and followed by a copy of its last four bytes.
    /// Returns its offset and length, which are 0 without a tile.
    fn append(&mut self, tile: Option<&[u8]>) -> Result<(u64, u32)> {
        let Some(tile) = tile else { return Ok((0, 0)) };
        let length = tile.len() as u32;
        self.output.append(&length.to_le_bytes())?;
        let place = self.output.position();
        self.output.append(tile)?;
        let mut trailer = [0; 4];
        let end = &tile[tile.len().saturating_sub(4)..];
        trailer[..end.len()].copy_from_slice(end);
        self.output.append(&trailer)?;
        Ok((place, length))
    }

    /// Writes offsets and lengths of tiles into their table; `first` is the index of the first
    /// tile.
    fn enter(&mut self, tiles: &[(u64, u32)], table: layout::Table, first: u64) -> Result<()> {
        if tiles.iter().all(|(_, length)| *length == 0) {
            return Ok(());
        }
        let offsets: Vec<u8> = tiles.iter().flat_map(|(place, _)| word(*place, self.big)).collect();
        let lengths: Vec<u8> = tiles.iter().flat_map(|(_, length)| length.to_le_bytes()).collect();
        let width = if self.big { 8 } else { 4 };
        self.output.patch(table.offsets + first * width, &offsets)?;
        self.output.patch(table.lengths + first * 4, &lengths)
    }
}
