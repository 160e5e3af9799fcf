//! Targets of tile exports, by name.

use std::path::{Path, PathBuf};

use super::TileRequest;
use super::directory::{DirectorySink, TileDirectory};
use super::encode::TileFormat;
#[cfg(feature = "mbtiles")]
use super::mbtiles::MbtilesSink;
use super::pmtiles::PmtilesSink;
use super::provenance::TilesetMetadata;
use super::sink::TileSink;
use spinney_base::{Error, Result};

/// A tile archive or directory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TileTarget {
    /// A `PMTiles` archive, version 3.
    Pmtiles(PathBuf),
    /// An `MBTiles` archive, version 1.3.
    #[cfg(feature = "mbtiles")]
    Mbtiles(PathBuf),
    /// A directory with a file per tile.
    Directory(TileDirectory),
}

impl TileTarget {
    /// Returns the target for a path if it names tiles: `x.pmtiles`, `x/{z}/{x}/{y}.png`.
    ///
    /// # Errors
    /// If a pattern does not have each field exactly once.
    pub fn of(path: &Path) -> Result<Option<TileTarget>> {
        let text = path.to_str().unwrap_or_default();
        if ["{z}", "{x}", "{y}"].iter().any(|field| text.contains(field)) {
            return TileDirectory::parse(text).map(|directory| Some(TileTarget::Directory(directory)));
        }
        let extension = path.extension().and_then(|end| end.to_str()).unwrap_or_default();
        Ok(match extension.to_ascii_lowercase().as_str() {
            "pmtiles" => Some(TileTarget::Pmtiles(path.to_path_buf())),
            #[cfg(feature = "mbtiles")]
            "mbtiles" => Some(TileTarget::Mbtiles(path.to_path_buf())),
            _ => None,
        })
    }

    /// The file, or the directory.
    pub fn path(&self) -> &Path {
        match self {
            TileTarget::Pmtiles(path) => path,
            #[cfg(feature = "mbtiles")]
            TileTarget::Mbtiles(path) => path,
            TileTarget::Directory(directory) => directory.base(),
        }
    }

    /// The tile format that the name implies.
    pub fn format(&self) -> Option<TileFormat> {
        match self {
            TileTarget::Directory(directory) => directory.extension()?.parse().ok(),
            _ => None,
        }
    }

    pub(super) fn sink(&self, about: &TilesetMetadata, request: &TileRequest) -> Result<Box<dyn TileSink>> {
        let TileRequest { resume, access, .. } = request;
        let provenance = serde_json::to_string(&about.provenance).map_err(|error| {
            Error::invalid("options", error.to_string(), "options that JSON can represent")
        })?;
        Ok(match self {
            TileTarget::Pmtiles(path) => {
                Box::new(PmtilesSink::create(access.create(path)?, resume.then_some(provenance.as_str()))?)
            }
            #[cfg(feature = "mbtiles")]
            TileTarget::Mbtiles(path) => Box::new(MbtilesSink::create(path, &provenance, (*resume, access))?),
            TileTarget::Directory(directory) => {
                Box::new(DirectorySink::create(directory, resume.then_some(provenance.as_str()))?)
            }
        })
    }
}
