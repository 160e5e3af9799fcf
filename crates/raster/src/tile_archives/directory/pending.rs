//! Pending changes of a tile directory: new tiles in a staging directory, the list of changes, and
//! a journal that names the states before and after. The journal is written once everything else is
//! durable. From then on the changes are applied, if necessary by later processes, repeatedly until
//! they are complete.

use std::fs::{self, File};
use std::io::{BufReader, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{DOCUMENT, TileDirectory};
use crate::tile_archives::provenance::SourceState;
use spinney_base::io::{ConfinedDirectory, open_regular, platform, sync_directory};
use spinney_base::{Error, Progress, Result};
use spinney_tiles::TileId;

/// The staging directory, below that of the tiles. It has the new tiles in `tiles/`, the new
/// `tiles.json`, `changes`, and finally `journal`.
pub(super) const UPDATE: &str = ".update";
const TILES: &str = "tiles";
const CHANGES: &str = "changes";
const JOURNAL: &str = "journal";
/// The journal while it is being written.
const NEW_JOURNAL: &str = "journal.new";
/// Maximum size of the journal in bytes.
const MAX_JOURNAL: u64 = 1 << 20;

/// Flag in the number of a tile that is removed.
const REMOVED: u64 = 1 << 63;

/// Content of the journal.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Journal {
    from: SourceState,
    to: SourceState,
    /// Pattern of the tile names.
    pattern: String,
    /// Number of changed tiles, and the hash of their list.
    changes: u64,
    hash: String,
}

/// Changes that are being staged.
pub(super) struct StagedChanges {
    directory: TileDirectory,
    /// The staging directory.
    waiting: ConfinedDirectory,
    list: BufWriter<File>,
    hash: xxhash_rust::xxh3::Xxh3,
    count: u64,
}

impl StagedChanges {
    /// Starts changes; fails if others are pending.
    pub(super) fn start(directory: &TileDirectory) -> Result<StagedChanges> {
        let path = directory.base.join(UPDATE);
        fs::create_dir(&path).map_err(Error::io(&path, "create the directory"))?;
        let list = path.join(CHANGES);
        let file = open_regular(File::options().write(true).create_new(true), &list)?;
        Ok(StagedChanges {
            directory: directory.clone(),
            waiting: ConfinedDirectory::new(&path),
            list: BufWriter::new(file),
            hash: xxhash_rust::xxh3::Xxh3::new(),
            count: 0,
        })
    }

    /// Adds a tile that is replaced, or removed if there are no bytes.
    pub(super) fn push(&mut self, tile: TileId, bytes: Option<&[u8]>) -> Result<()> {
        let mut number = tile.number();
        match bytes {
            Some(bytes) => self.waiting.write(&format!("{TILES}/{}", self.directory.name(tile)), bytes)?,
            None => number |= REMOVED,
        }
        self.hash.update(&number.to_le_bytes());
        self.count += 1;
        self.list
            .write_all(&number.to_le_bytes())
            .map_err(Error::io(self.waiting.base(), "write the changes"))
    }

    /// Makes everything durable, then the journal: after that the changes will be applied. On
    /// failure nothing is left.
    pub(super) fn seal(
        self,
        from: &SourceState,
        to: &SourceState,
        document: &str,
        progress: &dyn Progress,
    ) -> Result<PendingUpdate> {
        let waiting = self.waiting.base().to_path_buf();
        self.sealed(from, to, document, progress).inspect_err(|_| {
            // Remove the journal first: it must not be found without its tiles.
            let journal = fs::remove_file(waiting.join(JOURNAL));
            if journal.is_ok() || journal.is_err_and(|cause| cause.kind() == ErrorKind::NotFound) {
                let _ = sync_directory(&waiting).and_then(|()| fs::remove_dir_all(&waiting));
            }
        })
    }

    fn sealed(
        mut self,
        from: &SourceState,
        to: &SourceState,
        document: &str,
        progress: &dyn Progress,
    ) -> Result<PendingUpdate> {
        let waiting = self.waiting.base().to_path_buf();
        let failed = || Error::io(&waiting, "write the journal");
        self.list.flush().and_then(|()| self.list.get_ref().sync_all()).map_err(failed())?;
        self.waiting.write(DOCUMENT, document.as_bytes())?;
        progress.check()?;
        platform::sync_all_below(&waiting).map_err(Error::io(&waiting, "sync"))?;
        sync_directory(&self.directory.base).map_err(Error::io(&self.directory.base, "sync"))?;
        progress.check()?;
        let journal = Journal {
            from: from.clone(),
            to: to.clone(),
            pattern: self.directory.pattern.clone(),
            changes: self.count,
            hash: format!("{:032x}", self.hash.digest128()),
        };
        let text = serde_json::to_vec_pretty(&journal).map_err(|error| failed()(error.into()))?;
        self.waiting.write(NEW_JOURNAL, &text)?;
        let new = waiting.join(NEW_JOURNAL);
        File::options().write(true).open(&new).and_then(|file| file.sync_all()).map_err(failed())?;
        progress.check()?;
        fs::rename(&new, waiting.join(JOURNAL)).map_err(failed())?;
        sync_directory(&waiting).map_err(failed())?;
        Ok(PendingUpdate { directory: self.directory, journal })
    }
}

/// Changes that must be applied.
pub(super) struct PendingUpdate {
    directory: TileDirectory,
    journal: Journal,
}

impl PendingUpdate {
    /// Returns the pending changes of an unfinished update of a directory.
    pub(super) fn of(base: &Path) -> Result<Option<PendingUpdate>> {
        let name = format!("{UPDATE}/{JOURNAL}");
        let Some(text) = ConfinedDirectory::new(base).read(&name, MAX_JOURNAL)? else { return Ok(None) };
        let wrong = || Error::corrupt(base.join(&name), "journal", "other text", "the journal of an update");
        let journal: Journal = serde_json::from_slice(&text).map_err(|_| wrong())?;
        let directory = TileDirectory::below(base, &journal.pattern).ok_or_else(wrong)?;
        Ok(Some(PendingUpdate { directory, journal }))
    }

    /// Describes the states before and after.
    pub(super) fn states(&self) -> String {
        format!("from {} to {}", self.journal.from, self.journal.to)
    }

    /// Applies the pending changes of a directory, with a warning; removes the remains of an update
    /// that was not sealed.
    pub(super) fn finish_interrupted(base: &Path, progress: &dyn Progress) -> Result<()> {
        if let Some(pending) = PendingUpdate::of(base)? {
            let states = pending.states();
            progress.warn(base, &format!("an update {states} was interrupted; it is now completed"));
            return pending.apply(progress);
        }
        remove_all(&base.join(UPDATE))
    }

    /// Moves all files to their final paths; files that are already there stay.
    ///
    /// # Errors
    /// If that fails, or on cancellation, with a warning: the changes stay pending.
    pub(super) fn apply(self, progress: &dyn Progress) -> Result<()> {
        let base = self.directory.base.clone();
        self.apply_all(progress).inspect_err(|_| {
            let text =
                "the update has begun to change tiles; the next `spinney export --update` completes it";
            progress.warn(&base, text);
        })
    }

    fn apply_all(self, progress: &dyn Progress) -> Result<()> {
        let base = self.directory.base.as_path();
        let waiting = base.join(UPDATE);
        let list = waiting.join(CHANGES);
        let mut hash = xxhash_rust::xxh3::Xxh3::new();
        let count = each_number(&list, |number| {
            hash.update(&number.to_le_bytes());
            Ok(())
        })?;
        if (count, format!("{:032x}", hash.digest128())) != (self.journal.changes, self.journal.hash) {
            return Err(Error::corrupt(
                list,
                "changes",
                "another list",
                "the list that the journal describes",
            ));
        }
        let mut target = ConfinedDirectory::new(base);
        let mut new_tiles = ConfinedDirectory::new(&waiting);
        each_number(&list, |number| {
            progress.check()?;
            let tile = TileId::from_number(number & !REMOVED);
            let tile = tile.ok_or_else(|| {
                Error::corrupt(&list, "changes", "an invalid number", "the number of a tile")
            })?;
            let name = self.directory.name(tile);
            if number & REMOVED != 0 {
                target.remove(&name)?;
            } else {
                let new = new_tiles.checked_path(&format!("{TILES}/{name}"))?;
                put(&new, &target.path_to_create(&name)?)?;
            }
            progress.advance(1, count);
            Ok(())
        })?;
        progress.check()?;
        platform::sync_all_below(base).map_err(Error::io(base, "sync"))?;
        put(&waiting.join(DOCUMENT), &base.join(DOCUMENT))?;
        sync_directory(base).map_err(Error::io(base, "sync"))?;
        progress.check()?;
        let journal = waiting.join(JOURNAL);
        fs::remove_file(&journal).map_err(Error::io(&journal, "remove"))?;
        sync_directory(&waiting).map_err(Error::io(&waiting, "sync"))?;
        // Everything is applied: the rest is only waste.
        progress.advance(0, count);
        remove_all(&waiting)
    }
}

/// Yields the numbers in a list; returns their count.
fn each_number(list: &Path, mut each: impl FnMut(u64) -> Result<()>) -> Result<u64> {
    let file = open_regular(File::options().read(true), list)?;
    let length = file.metadata().map_err(Error::io(list, "read"))?.len();
    let mut input = BufReader::new(file);
    for _ in 0..length / 8 {
        let mut number = [0; 8];
        input.read_exact(&mut number).map_err(Error::io(list, "read"))?;
        each(u64::from_le_bytes(number))?;
    }
    Ok(length / 8)
}

/// Renames a file, unless that was done before.
fn put(from: &Path, to: &PathBuf) -> Result<()> {
    match fs::rename(from, to) {
        Err(cause) if cause.kind() == ErrorKind::NotFound => {
            let is_there = fs::symlink_metadata(to).is_ok_and(|there| there.is_file());
            if is_there { Ok(()) } else { Err(Error::io(from, "rename to its final name")(cause)) }
        }
        other => other.map_err(Error::io(to, "rename to its final name")),
    }
}

/// Removes a directory with its content, if it exists; of a symbolic link only the link.
fn remove_all(path: &Path) -> Result<()> {
    match fs::remove_dir_all(path) {
        Err(cause) if cause.kind() != ErrorKind::NotFound => Err(Error::io(path, "remove")(cause)),
        _ => Ok(()),
    }
}
