//! Exports shared between processes: each process draws some of the tiles into an archive of its
//! own, and the archives are merged without drawing a tile.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use super::Made;
use super::encode::Encoded;
use super::pmtiles::Pmtiles;
use super::provenance::{About, Own};
use super::walk::{TileExtent, TileRun, TileWalk};
use spinney_base::{Error, Progress, Result};
use spinney_tiles::{TileId, TileSource};

/// One of `of` shares of an export's tiles, in the order of tile numbers, numbered from 0. The
/// shares take about equally long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TilePart {
    /// Index, from 0.
    number: u32,
    /// Number of shares.
    of: u32,
}

/// Name of the archive option that stores the share.
const OPTION: &str = "part";

impl TilePart {
    /// The share with an index, from 0, among `of` shares.
    ///
    /// # Errors
    /// If the index is not below `of`.
    pub fn new(number: u32, of: u32) -> Result<TilePart> {
        match number < of {
            true => Ok(TilePart { number, of }),
            false => {
                Err(Error::invalid("part", format!("{number}/{of}"), "a number from 0 on, and a greater one"))
            }
        }
    }

    /// Restricts an export to this share.
    pub(super) fn take(
        self,
        source: &dyn TileSource,
        extent: &mut TileExtent,
        about: &mut About,
        progress: &dyn Progress,
    ) -> Result<()> {
        let (_, runs) = TileWalk::new(source, extent).count(progress)?;
        let end = |part: u32| (u128::from(runs) * u128::from(part) / u128::from(self.of)) as u64;
        extent.runs = end(self.number)..end(self.number + 1);
        about.provenance.options.insert(OPTION.into(), self.to_string());
        Ok(())
    }
}

impl fmt::Display for TilePart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for TilePart {
    type Err = Error;

    fn from_str(text: &str) -> Result<TilePart> {
        let wrong = || Error::invalid("part", text, "a number from 0 on, and how many there are: 3/64");
        let (number, of) = text.split_once('/').ok_or_else(wrong)?;
        TilePart::new(number.trim().parse().map_err(|_| wrong())?, of.trim().parse().map_err(|_| wrong())?)
    }
}

/// The archives of all shares of an export.
pub(super) struct Parts {
    /// By their first tiles, in ascending order; archives without tiles are omitted.
    archives: Vec<(u64, Pmtiles)>,
}

impl Parts {
    /// Opens the archives of an export's shares, or returns `None` if `paths` is empty.
    ///
    /// # Errors
    /// If an archive cannot be read or belongs to another export, or if one is missing.
    pub(super) fn open(paths: &[PathBuf], about: &About) -> Result<Option<Parts>> {
        let (mut known, mut archives) = (vec![false; paths.len()], Vec::new());
        for path in paths {
            let archive = Pmtiles::open(path)?;
            let wrong = |found: &str| {
                let advice = "make it again, with the same options and of the same file";
                Error::unsupported(path, found, advice)
            };
            let Some(Own { mut provenance, .. }) = archive.own() else {
                return Err(wrong("a part of an export by another program"));
            };
            let part = provenance.options.remove(OPTION).and_then(|part| part.parse::<TilePart>().ok());
            let Some(TilePart { number, of }) = part else { return Err(wrong("a whole archive as a part")) };
            if provenance != about.provenance {
                return Err(wrong("a part of another export"));
            }
            match known.get_mut(number as usize) {
                Some(is_known) if of as usize == paths.len() && !*is_known => *is_known = true,
                _ => {
                    let found = format!("part {number} of {of} among {} archives", paths.len());
                    return Err(Error::invalid("parts", found, "each part once, and all of them"));
                }
            }
            archives.extend(archive.first_tile().map(|first| (first, archive)));
        }
        archives.sort_by_key(|(first, _)| *first);
        Ok((!paths.is_empty()).then_some(Parts { archives }))
    }

    /// Returns the content of a run from the archive of its share.
    pub(super) fn made(&self, run: &TileRun) -> Made {
        // Invariant: shares are consecutive in the order of tiles. A tile can only be in the last
        // archive whose first tile is not after it. If it is not there, it was drawn and was empty.
        let behind = self.archives.partition_point(|(first, _)| *first <= run.first);
        let Some((_, archive)) = behind.checked_sub(1).map(|index| &self.archives[index]) else {
            return Ok(None);
        };
        let tile = TileId::from_number(run.first).expect("a run of tiles");
        Ok(archive.tile(tile)?.map(|bytes| Arc::new(Encoded::new(bytes))))
    }
}
