//! Updates of a tile directory: new tiles are staged next to the old ones until all of them are
//! written.

use std::fs;

use super::pending::{PendingUpdate, StagedChanges, UPDATE};
use super::{LOCK, MAX_TILE, TileDirectory};
use crate::tile_archives::encode::Encoded;
use crate::tile_archives::provenance::{Digest, SpinneyMetadata, TilesetMetadata};
use crate::tile_archives::sink::{TileArchiveSummary, TileEdit};
use spinney_base::io::{ConfinedDirectory, LockFile, Unfinished};
use spinney_base::{Error, Progress, Result};
use spinney_tiles::TileId;

/// An update that replaces tiles in their directory: all of them, or none if this is dropped before
/// it is finished.
pub(in crate::tile_archives) struct DirectoryEdit {
    directory: TileDirectory,
    own: SpinneyMetadata,
    digest: Digest,
    tiles: ConfinedDirectory,
    /// The staged changes, from the first one on.
    changes: Option<StagedChanges>,
    /// The staging directory, removed on drop until the changes are sealed.
    unfinished: Option<Unfinished>,
    /// Last, so that it is dropped after everything else.
    _lock: LockFile,
}

impl DirectoryEdit {
    /// Opens and locks the directory; finishes an interrupted update, or removes its remains.
    pub(in crate::tile_archives) fn open(
        target: &TileDirectory,
        progress: &dyn Progress,
    ) -> Result<DirectoryEdit> {
        let base = target.base();
        // Checked first, so that no lock is created in an unrelated directory.
        TileDirectory::open(base)?;
        let lock = LockFile::take(&base.join(LOCK), base)?;
        PendingUpdate::finish_interrupted(base, progress)?;
        let (directory, own, _) = TileDirectory::open(base)?;
        if directory != *target {
            let expected = format!("the pattern of the directory, {}", directory.pattern);
            return Err(Error::invalid("pattern of tile paths", target.pattern.as_str(), expected));
        }
        let digest = Digest::parse(&own.digest);
        let digest =
            digest.ok_or_else(|| Error::corrupt(base, "document", "no hash", "the hash of all tiles"))?;
        let tiles = ConfinedDirectory::new(base);
        Ok(DirectoryEdit { directory, own, digest, tiles, changes: None, unfinished: None, _lock: lock })
    }

    /// Returns the changes; starts them if necessary.
    fn changes(&mut self) -> Result<&mut StagedChanges> {
        if self.changes.is_none() {
            self.unfinished = Some(Unfinished::new(&self.directory.base.join(UPDATE)));
            self.changes = Some(StagedChanges::start(&self.directory)?);
        }
        Ok(self.changes.as_mut().expect("the changes were started"))
    }
}

impl TileEdit for DirectoryEdit {
    fn own(&self) -> &SpinneyMetadata {
        &self.own
    }

    fn replace(&mut self, tile: TileId, made: Option<&Encoded>) -> Result<()> {
        let old = self.tiles.read(&self.directory.name(tile), MAX_TILE)?;
        let old = old.map(|bytes| xxhash_rust::xxh3::xxh3_128(&bytes));
        if old == made.map(|made| made.hash) {
            return Ok(());
        }
        if let Some(old) = old {
            self.digest.remove(tile.number(), 1, old);
            self.own.tiles = self.own.tiles.saturating_sub(1);
        }
        if let Some(made) = made {
            self.digest.add(tile.number(), 1, made.hash);
            self.own.tiles += 1;
        }
        self.changes()?.push(tile, made.map(|made| made.bytes.as_slice()))
    }

    fn finish(
        mut self: Box<Self>,
        about: &TilesetMetadata,
        progress: &dyn Progress,
    ) -> Result<TileArchiveSummary> {
        let stored = TileArchiveSummary {
            tiles: self.own.tiles,
            contents: self.own.tiles,
            ..TileArchiveSummary::default()
        };
        let document = about.tile_json(&self.directory.pattern, self.own.tiles, self.digest);
        let from = self.own.provenance.source.clone();
        self.changes()?;
        let changes = self.changes.take().expect("the changes were started");
        // From here on the staged tiles stay until they are applied or cleanly rolled back.
        self.unfinished = None;
        changes.seal(&from, &about.provenance.source, &document, progress)?.apply(progress)?;
        Ok(stored)
    }
}

impl Drop for DirectoryEdit {
    fn drop(&mut self) {
        if self.unfinished.is_some() {
            let _ = fs::remove_dir_all(self.directory.base.join(UPDATE));
        }
    }
}
