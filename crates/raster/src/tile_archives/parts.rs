//! Exports shared between processes: each process draws some of the tiles into an archive of its
//! own, and the archives are merged without drawing a tile.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use super::EncodeResult;
use super::encode::Encoded;
use super::pmtiles::Pmtiles;
use super::provenance::{SpinneyMetadata, TilesetMetadata};
use super::walk::{TileExtent, TileSpan, TileTraversal};
use spinney_base::{Error, Progress, Result};
use spinney_tiles::{TileId, TileSource};

/// One of `of` shares of an export's tiles, in the order of tile numbers, numbered from 0. The
/// shares take about equally long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileShard {
    /// Index, from 0.
    number: u32,
    /// Number of shares.
    of: u32,
}

/// Name of the archive option that stores the share.
const OPTION: &str = "part";

impl TileShard {
    /// The share with an index, from 0, among `of` shares.
    ///
    /// # Errors
    /// If the index is not below `of`.
    pub fn new(number: u32, of: u32) -> Result<TileShard> {
        match number < of {
            true => Ok(TileShard { number, of }),
            false => Err(Error::invalid(
                "part",
                format!("{number}/{of}"),
                "a part number from 0, less than the number of parts",
            )),
        }
    }

    /// Restricts an export to this share.
    pub(super) fn take(
        self,
        source: &dyn TileSource,
        extent: &mut TileExtent,
        about: &mut TilesetMetadata,
        progress: &dyn Progress,
    ) -> Result<()> {
        let (_, runs) = TileTraversal::new(source, extent).count(progress)?;
        let end = |part: u32| (u128::from(runs) * u128::from(part) / u128::from(self.of)) as u64;
        extent.runs = end(self.number)..end(self.number + 1);
        about.provenance.options.insert(OPTION.into(), self.to_string());
        Ok(())
    }
}

impl fmt::Display for TileShard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for TileShard {
    type Err = Error;

    fn from_str(text: &str) -> Result<TileShard> {
        let wrong = || Error::invalid("part", text, "a part number from 0, and the number of parts: 3/64");
        let (number, of) = text.split_once('/').ok_or_else(wrong)?;
        TileShard::new(number.trim().parse().map_err(|_| wrong())?, of.trim().parse().map_err(|_| wrong())?)
    }
}

/// The archives of all shares of an export.
pub(super) struct ShardArchives {
    /// By their first tiles, in ascending order; archives without tiles are omitted.
    archives: Vec<(u64, Pmtiles)>,
}

impl ShardArchives {
    /// Opens the archives of an export's shares, or returns `None` if `paths` is empty.
    ///
    /// # Errors
    /// If an archive cannot be read or belongs to another export, or if one is missing.
    pub(super) fn open(paths: &[PathBuf], about: &TilesetMetadata) -> Result<Option<ShardArchives>> {
        let (mut known, mut archives) = (vec![false; paths.len()], Vec::new());
        for path in paths {
            let archive = Pmtiles::open(path)?;
            let wrong = |found: &str| {
                let advice = "export it again with the same options and file";
                Error::unsupported(path, found, advice)
            };
            let Some(SpinneyMetadata { mut provenance, .. }) = archive.own() else {
                return Err(wrong("a part by another program"));
            };
            let part = provenance.options.remove(OPTION).and_then(|part| part.parse::<TileShard>().ok());
            let Some(TileShard { number, of }) = part else {
                return Err(wrong("a complete archive as a part"));
            };
            if provenance != about.provenance {
                return Err(wrong("a part of another export"));
            }
            match known.get_mut(number as usize) {
                Some(is_known) if of as usize == paths.len() && !*is_known => *is_known = true,
                _ => {
                    let found = format!("part {number} of {of} among {} archives", paths.len());
                    return Err(Error::invalid("parts", found, "every part once"));
                }
            }
            archives.extend(archive.first_tile().map(|first| (first, archive)));
        }
        archives.sort_by_key(|(first, _)| *first);
        Ok((!paths.is_empty()).then_some(ShardArchives { archives }))
    }

    /// Returns the content of a run from the archive of its share.
    pub(super) fn made(&self, run: &TileSpan) -> EncodeResult {
        // Invariant: shares are consecutive in the order of tiles. A tile can only be in the last
        // archive whose first tile is not after it. If it is not there, it was drawn and was empty.
        let after = self.archives.partition_point(|(first, _)| *first <= run.first);
        let Some((_, archive)) = after.checked_sub(1).map(|index| &self.archives[index]) else {
            return Ok(None);
        };
        let tile = TileId::from_number(run.first).expect("spans have valid tile numbers");
        Ok(archive.tile(tile)?.map(|bytes| Arc::new(Encoded::new(bytes))))
    }
}
