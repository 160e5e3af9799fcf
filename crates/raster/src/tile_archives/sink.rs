//! Sinks of tiles: archives and directories.

use super::encode::Encoded;
use super::provenance::{SpinneyMetadata, TilesetMetadata};
use super::walk::TileSpan;
use spinney_base::{Progress, Result};
use spinney_tiles::TileId;

/// Receives tiles in the order of their numbers.
pub(super) trait TileSink: Send {
    /// Number of runs received before the export was interrupted.
    fn done(&self) -> u64;

    /// Appends a run; `tile` is `None` if it is empty.
    fn push(&mut self, run: &TileSpan, tile: Option<&Encoded>) -> Result<()>;

    /// Makes everything received durable, so that the export can be resumed from here.
    fn checkpoint(&mut self) -> Result<()>;

    /// Completes the archive and publishes it under its name.
    fn finish(self: Box<Self>, about: &TilesetMetadata) -> Result<TileArchiveSummary>;
}

/// Archive or directory whose tiles are replaced in place.
pub(super) trait TileEdit {
    /// Spinney's metadata of the existing tiles.
    fn own(&self) -> &SpinneyMetadata;

    /// Replaces a tile; `None` removes it.
    fn replace(&mut self, tile: TileId, made: Option<&Encoded>) -> Result<()>;

    /// Completes the change.
    fn finish(
        self: Box<Self>,
        about: &TilesetMetadata,
        progress: &dyn Progress,
    ) -> Result<TileArchiveSummary>;
}

/// Totals of a tile archive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TileArchiveSummary {
    /// Number of non-empty tiles.
    pub tiles: u64,
    /// Number of distinct stored contents.
    pub contents: u64,
    /// Size of the archive in bytes.
    pub bytes: u64,
    /// Number of tiles copied from an older archive without being drawn.
    pub copied: u64,
}
