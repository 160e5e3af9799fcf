//! Updates of a tile directory: new tiles are staged next to the old ones until all of them are
//! written.

use std::fs;

use super::pending::{Changes, Pending, UPDATE};
use super::{LOCK, MAX_TILE, TileFolder};
use crate::tile_archives::encode::Encoded;
use crate::tile_archives::provenance::{About, Digest, Own};
use crate::tile_archives::sink::{TileArchiveSummary, TileEdit};
use spinney_base::io::{ClosedFolder, LockFile, Unfinished};
use spinney_base::{Error, Progress, Result};
use spinney_tiles::TileId;

/// An update that replaces tiles in their directory: all of them, or none if this is dropped before
/// it is finished.
pub(in crate::tile_archives) struct FolderEdit {
    folder: TileFolder,
    own: Own,
    digest: Digest,
    tiles: ClosedFolder,
    /// The staged changes, from the first one on.
    changes: Option<Changes>,
    /// The staging directory, removed on drop until the changes are sealed.
    unfinished: Option<Unfinished>,
    /// Last, so that it is dropped after everything else.
    _lock: LockFile,
}

impl FolderEdit {
    /// Opens and locks the directory; finishes an interrupted update, or removes its remains.
    pub(in crate::tile_archives) fn open(target: &TileFolder, progress: &dyn Progress) -> Result<FolderEdit> {
        let base = target.base();
        // Checked first, so that no lock is created in an unrelated directory.
        TileFolder::open(base)?;
        let lock = LockFile::take(&base.join(LOCK), base)?;
        Pending::finish_interrupted(base, progress)?;
        let (folder, own, _) = TileFolder::open(base)?;
        if folder != *target {
            let expected = format!("those of the folder, {}", folder.pattern);
            return Err(Error::invalid("names of tiles", target.pattern.as_str(), expected));
        }
        let digest = Digest::parse(&own.digest);
        let digest =
            digest.ok_or_else(|| Error::corrupt(base, "document", "no hash", "that of all tiles"))?;
        let tiles = ClosedFolder::new(base);
        Ok(FolderEdit { folder, own, digest, tiles, changes: None, unfinished: None, _lock: lock })
    }

    /// Returns the changes; starts them if necessary.
    fn changes(&mut self) -> Result<&mut Changes> {
        if self.changes.is_none() {
            self.unfinished = Some(Unfinished::new(&self.folder.base.join(UPDATE)));
            self.changes = Some(Changes::start(&self.folder)?);
        }
        Ok(self.changes.as_mut().expect("they have begun"))
    }
}

impl TileEdit for FolderEdit {
    fn own(&self) -> &Own {
        &self.own
    }

    fn replace(&mut self, tile: TileId, made: Option<&Encoded>) -> Result<()> {
        let old = self.tiles.read(&self.folder.name(tile), MAX_TILE)?;
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

    fn finish(mut self: Box<Self>, about: &About, progress: &dyn Progress) -> Result<TileArchiveSummary> {
        let stored = TileArchiveSummary {
            tiles: self.own.tiles,
            contents: self.own.tiles,
            ..TileArchiveSummary::default()
        };
        let document = about.tile_json(&self.folder.pattern, self.own.tiles, self.digest);
        let from = self.own.provenance.source.clone();
        self.changes()?;
        let changes = self.changes.take().expect("they have begun");
        // From here on the staged tiles stay until they are applied or cleanly rolled back.
        self.unfinished = None;
        changes.seal(&from, &about.provenance.source, &document, progress)?.apply(progress)?;
        Ok(stored)
    }
}

impl Drop for FolderEdit {
    fn drop(&mut self) {
        if self.unfinished.is_some() {
            let _ = fs::remove_dir_all(self.folder.base.join(UPDATE));
        }
    }
}
