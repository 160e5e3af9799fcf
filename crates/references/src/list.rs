//! The list of sources: what is read when an index is opened.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::pages::{MAX_PAGE, PageEntry};
use super::pixels::PixelRule;
use super::placements::{self, MAX_PLACEMENTS, MappedWindow};
use spinney_base::io::{FileStat, FileVersion};
use spinney_base::{Error, Result};
use spinney_chunks::ChunkFormat;
use spinney_container::VersionedSection;
use spinney_engine::store::goblin::ReferringFile;

/// The section's name and version, and its maximum size.
const SECTION: VersionedSection<{ 256 << 20 }> = VersionedSection { name: "list of sources", version: 1 };

/// Maximum size in bytes of a decoded chunk.
pub(crate) const MAX_CHUNK: u64 = 1 << 28;

/// Advice for a source whose chunks an index cannot refer to.
pub const SOURCE_ADVICE: &str = "rewrite the source with small tiles (`gdal_translate -of COG -co COMPRESS=ZSTD SOURCE.tif \
                                 OUT.tif`), or build a tree of it (`spinney build`)";

/// Checks how the chunks of a source are stored. `path` is the index that is read, or the source
/// that will be indexed.
///
/// # Errors
/// If readers cannot decode such chunks, or these may take too much memory.
pub fn check_format(path: &Path, format: &ChunkFormat) -> Result<()> {
    format
        .check()
        .map_err(|found| Error::corrupt(path, "format of chunks", found, "a valid format of chunks"))?;
    let ChunkFormat { chunk_width, chunk_height, .. } = *format;
    // Each widened sample has up to 8 bytes.
    let bytes = format.chunk_bytes().max((chunk_width * chunk_height).saturating_mul(8));
    if bytes > MAX_CHUNK {
        let found = format!(
            "an index of tiles or strips of {chunk_width} x {chunk_height} pixels, which may need {bytes} bytes of \
             memory each, more than {MAX_CHUNK},"
        );
        return Err(Error::unsupported(path, found, SOURCE_ADVICE));
    }
    Ok(())
}

/// The list of sources.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SourceList {
    /// How chunks are stored; sources refer to these by number.
    pub formats: Vec<ChunkFormat>,
    /// Rules for VOID pixels; placements refer to these by number.
    pub rules: Vec<PixelRule>,
    /// Lists of channels, from 0; placements refer to these by number.
    pub channels: Vec<Vec<u16>>,
    /// Cells of each layer of the file.
    pub layers: Vec<LayerCells>,
    /// Virtual rasters that arrange sources: an update compares them.
    pub virtual_rasters: Vec<IndexedFile>,
    /// Number of sources.
    pub sources: u32,
    /// The pages that describe them.
    pub(crate) pages: Vec<PageEntry>,
}

/// A file that an index names, without cells.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct IndexedFile {
    /// Path relative to the index's directory, absolute path, or URL without query.
    pub name: String,
    /// Length in bytes.
    pub length: u64,
    /// Version when the index was made.
    pub version: FileVersion,
}

/// Where the cells of a layer are.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LayerCells {
    /// Bytes of the value that means VOID, in addition to the rules of placements.
    pub nodata: Option<Vec<u8>>,
    /// Number of placements.
    count: u64,
    placements: Vec<u8>,
}

impl LayerCells {
    /// Cells of placements, from the bottom to the top.
    pub fn new(nodata: Option<Vec<u8>>, placements: &[MappedWindow]) -> LayerCells {
        LayerCells { nodata, count: placements.len() as u64, placements: placements::encode(placements) }
    }
}

impl IndexedFile {
    /// Returns length and version when the index was made.
    pub fn stat(&self) -> FileStat {
        FileStat { length: self.length, version: self.version.clone() }
    }
}

impl SourceList {
    /// Reads the list of a file.
    pub(crate) fn read(file: &ReferringFile<'_>) -> Result<SourceList> {
        let stored = file.sources.read(file.path, file.bytes, SECTION.name)?;
        SourceList::from_bytes(file.path, &stored, (file.headers.len(), file.pages.length))
    }

    /// Encodes the list.
    ///
    /// # Errors
    /// If it is too large.
    pub(crate) fn to_bytes(&self, path: &Path) -> Result<Vec<u8>> {
        let refused = |limit: String| {
            let found = format!("an index of {} sources, whose list exceeds {limit}", self.sources);
            Error::unsupported(path, found, "index parts of them, and combine these with `spinney manifest`")
        };
        if self.placement_count() > MAX_PLACEMENTS {
            return Err(refused(format!("{MAX_PLACEMENTS} placements")));
        }
        SECTION.encode(self).ok_or_else(|| refused("256 MiB".into()))
    }

    /// Number of placements of all layers.
    fn placement_count(&self) -> u64 {
        self.layers.iter().fold(0, |sum, layer| sum.saturating_add(layer.count))
    }

    /// Checks and decodes the list of a file with a number of layers, and a number of bytes in
    /// pages.
    fn from_bytes(path: &Path, bytes: &[u8], (layers, page_bytes): (usize, u64)) -> Result<SourceList> {
        let corrupt = |found: String, expected: &str| Error::corrupt(path, SECTION.name, found, expected);
        let (list, used): (SourceList, usize) = SECTION.decode(path, bytes)?;
        if used != bytes.len() || list.layers.len() != layers {
            let found = format!("{} layers, {} bytes left", list.layers.len(), bytes.len() - used);
            return Err(corrupt(found, "as many layers as the file has, and no other bytes"));
        }
        for format in &list.formats {
            check_format(path, format)?;
        }
        if list.placement_count() > MAX_PLACEMENTS {
            let found = format!("{} placements", list.placement_count());
            return Err(corrupt(found, &MAX_PLACEMENTS.to_string()));
        }
        if list.pages.iter().any(|page| page.location.within(page_bytes, MAX_PAGE).is_none()) {
            let found = format!("pages of sources that are not among {page_bytes} bytes");
            return Err(corrupt(found, "pages within their section"));
        }
        let described: u64 = list.pages.iter().map(|page| u64::from(page.sources)).sum();
        if described != u64::from(list.sources) || list.pages.iter().any(|page| page.sources == 0) {
            let found = format!("pages of {described} sources");
            return Err(corrupt(found, &format!("{} sources", list.sources)));
        }
        Ok(list)
    }

    /// Decodes the placements of a layer.
    pub(crate) fn placements(&self, path: &Path, layer: usize) -> Result<Vec<MappedWindow>> {
        let LayerCells { count, placements, .. } = &self.layers[layer];
        let decoded = placements::decode(placements, *count, self.sources).filter(|placements| {
            let has = |placement: &MappedWindow| {
                (placement.rule as usize) < self.rules.len()
                    && (placement.channels as usize) < self.channels.len()
            };
            placements.iter().all(has)
        });
        decoded.ok_or_else(|| {
            Error::corrupt(path, SECTION.name, format!("{count} placements"), "valid placements of sources")
        })
    }
}
