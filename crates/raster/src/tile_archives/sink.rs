//! Takers of tiles: archives, and folders.

use super::encode::Encoded;
use super::provenance::{About, Own};
use super::walk::TileRun;
use spinney_base::{Progress, Result};
use spinney_tiles::TileId;

/// Takes tiles in the order of their numbers.
pub(super) trait TileSink: Send {
    /// Runs that were taken before an interruption.
    fn done(&self) -> u64;

    /// Takes a run; `None` if nothing is in it.
    fn push(&mut self, run: &TileRun, tile: Option<&Encoded>) -> Result<()>;

    /// Makes what was taken durable, so that an export can go on from here.
    fn checkpoint(&mut self) -> Result<()>;

    /// Completes the archive and puts it in its place.
    fn finish(self: Box<Self>, about: &About) -> Result<TileArchiveSummary>;
}

/// Archive or folder whose tiles are replaced in place.
pub(super) trait TileEdit {
    /// Description of how it was made.
    fn own(&self) -> &Own;

    /// Replaces a tile; `None` removes it.
    fn replace(&mut self, tile: TileId, made: Option<&Encoded>) -> Result<()>;

    /// Completes the change.
    fn finish(self: Box<Self>, about: &About, progress: &dyn Progress) -> Result<TileArchiveSummary>;
}

/// Totals of a tile archive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TileArchiveSummary {
    /// Tiles that are not empty.
    pub tiles: u64,
    /// Contents of tiles that are stored.
    pub contents: u64,
    /// Bytes of the archive.
    pub bytes: u64,
    /// Tiles that were copied from an older archive without being drawn.
    pub copied: u64,
}
