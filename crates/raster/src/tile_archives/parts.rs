//! Tiles that several processes draw: each makes an archive of a part of them, of which all are put together without drawing any.

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

/// A part of the tiles of an export, in the order of their numbers: the one with a number, from 0, of so many that take about as long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TilePart {
    /// Its number, from 0.
    number: u32,
    /// How many there are.
    of: u32,
}

/// The name of an archive's option that tells its part.
const OPTION: &str = "part";

impl TilePart {
    /// The part with a number, from 0, of so many.
    ///
    /// # Errors
    /// If there is none.
    pub fn new(number: u32, of: u32) -> Result<TilePart> {
        match number < of {
            true => Ok(TilePart { number, of }),
            false => {
                Err(Error::invalid("part", format!("{number}/{of}"), "a number from 0 on, and a greater one"))
            }
        }
    }

    /// Leaves only this part of an export.
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

/// Archives of all parts of an export.
pub(super) struct Parts {
    /// By their first tiles, which ascend; those without any are left out.
    archives: Vec<(u64, Pmtiles)>,
}

impl Parts {
    /// Opens the archives of an export's parts; nothing if it has none.
    ///
    /// # Errors
    /// If one cannot be read or is of another export, or if one is missing.
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

    /// The content of a run that one of the parts has drawn.
    pub(super) fn made(&self, run: &TileRun) -> Made {
        // Invariant: parts follow each other in the order of tiles, so that what is not in the last one that does not begin behind a tile is in none: it was
        // drawn, and nothing was in it.
        let behind = self.archives.partition_point(|(first, _)| *first <= run.first);
        let Some((_, archive)) = behind.checked_sub(1).map(|index| &self.archives[index]) else {
            return Ok(None);
        };
        let tile = TileId::from_number(run.first).expect("a run of tiles");
        Ok(archive.tile(tile)?.map(|bytes| Arc::new(Encoded::new(bytes))))
    }
}
