//! Writer of tile directories, under a temporary name until they are complete.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use super::{DOCUMENT, TileDirectory};
use crate::tile_archives::encode::Encoded;
use crate::tile_archives::journal::{Checkpoint, Entry, Journal, not_ours};
use crate::tile_archives::provenance::{Digest, TilesetMetadata};
use crate::tile_archives::sink::{TileArchiveSummary, TileSink};
use crate::tile_archives::walk::TileSpan;
use spinney_base::io::{
    ConfinedDirectory, LockFile, NewDirectories, Unfinished, directory_of, partial_of, sync_directory,
};
use spinney_base::{Error, Result};
use spinney_tiles::TileId;

/// The journal of a resumable export, inside the directory.
const JOURNAL: &str = ".journal";

/// Tiles that are being written, below a directory with a temporary name.
pub(in crate::tile_archives) struct DirectorySink {
    directory: TileDirectory,
    /// The directory under its temporary name.
    place: ConfinedDirectory,
    journal: Journal,
    at: Checkpoint,
    /// Whether it is kept if the export is interrupted.
    is_kept: bool,
    unfinished: Option<Unfinished>,
    /// Parent directories that were created. Dropped after their content.
    created: NewDirectories,
    /// The lock of a resumable export. Last, so that it is dropped after everything else.
    _lock: Option<LockFile>,
}

impl DirectorySink {
    /// Starts a directory, or resumes an interrupted one with `provenance`, which describes the
    /// export.
    pub(in crate::tile_archives) fn create(
        target: &TileDirectory,
        provenance: Option<&str>,
    ) -> Result<DirectorySink> {
        let base = target.base();
        check_free(base)?;
        let above = directory_of(base);
        let mut created = NewDirectories::default();
        created.make(above)?;
        let prefix = format!(".{}.", base.file_name().unwrap_or_default().to_string_lossy());
        let mut lock = None;
        let (place, journal, at) = match provenance {
            Some(provenance) => {
                lock = Some(LockFile::take(&above.join(format!("{prefix}lock")), base)?);
                // The previous holder of the lock may have finished it.
                check_free(base)?;
                let place = partial_of(base);
                check_own(&place)?;
                let (journal, at) = Journal::resumable(&place.join(JOURNAL), provenance, false, &mut |_| {})?;
                (place, journal, at)
            }
            None => {
                // First, so that nothing exists yet if this fails.
                let journal = Journal::temporary(above)?;
                let mut names = tempfile::Builder::new();
                let made =
                    names.prefix(&prefix).suffix(".partial").make_in(above, |path| fs::create_dir(path));
                let failed = || Error::io(base, "create a temporary directory next to it");
                let place = made.map_err(failed())?.into_temp_path().keep();
                let place = place.map_err(|error| failed()(error.error))?;
                (place, journal, Checkpoint::default())
            }
        };
        let is_kept = provenance.is_some();
        let unfinished = (!is_kept).then(|| Unfinished::new(&place));
        Ok(DirectorySink {
            directory: target.clone(),
            place: ConfinedDirectory::new(&place),
            journal,
            at,
            is_kept,
            unfinished,
            created,
            _lock: lock,
        })
    }

    /// Makes all files durable.
    fn sync(&self) -> Result<()> {
        spinney_base::io::platform::sync_all_below(self.place.base())
            .map_err(Error::io(self.place.base(), "sync"))
    }
}

impl TileSink for DirectorySink {
    fn done(&self) -> u64 {
        self.at.runs
    }

    fn push(&mut self, run: &TileSpan, tile: Option<&Encoded>) -> Result<()> {
        self.at.runs += 1;
        let Some(tile) = tile else { return Ok(()) };
        for number in run.first..run.first + run.count {
            let place = TileId::from_number(number).expect("spans have valid tile numbers");
            let name = self.directory.name(place);
            self.place.write(&name, &tile.bytes)?;
        }
        let (offset, length) = (self.at.bytes, tile.bytes.len() as u32);
        self.at.bytes += u64::from(length) * run.count;
        self.journal.push(&Entry { first: run.first, count: run.count, offset, length, hash: tile.hash })
    }

    fn checkpoint(&mut self) -> Result<()> {
        if !self.is_kept {
            return Ok(());
        }
        self.sync()?;
        self.journal.checkpoint(self.at)
    }

    fn finish(mut self: Box<Self>, about: &TilesetMetadata) -> Result<TileArchiveSummary> {
        let (mut stored, mut digest) = (TileArchiveSummary::default(), Digest::default());
        self.journal.entries(|entry| {
            stored.tiles += entry.count;
            (entry.first..entry.first + entry.count).for_each(|number| digest.add(number, 1, entry.hash));
            Ok(())
        })?;
        (stored.contents, stored.bytes) = (stored.tiles, self.at.bytes);
        let document = about.tile_json(&self.directory.pattern, stored.tiles, digest);
        self.place.write(DOCUMENT, document.as_bytes())?;
        self.sync()?;
        let base = self.directory.base().to_path_buf();
        if self.is_kept {
            let journal = self.place.base().join(JOURNAL);
            fs::remove_file(&journal).map_err(Error::io(&journal, "remove"))?;
        }
        // The target may exist as an empty directory.
        let _ = fs::remove_dir(&base);
        fs::rename(self.place.base(), &base).map_err(Error::io(&base, "rename to its final name"))?;
        self.unfinished = None;
        std::mem::take(&mut self.created).keep();
        sync_directory(directory_of(&base)).map_err(Error::io(&base, "sync the directory"))?;
        Ok(stored)
    }
}

impl Drop for DirectorySink {
    fn drop(&mut self) {
        if self.unfinished.is_some() {
            let _ = fs::remove_dir_all(self.place.base());
        }
    }
}

/// Fails if the path of a new directory is in use, except for an empty directory.
fn check_free(base: &Path) -> Result<()> {
    let is_taken = fs::read_dir(base).is_ok_and(|mut entries| entries.next().is_some()) || base.is_file();
    if is_taken {
        let advice = "choose another directory, remove this one, or use --update";
        return Err(Error::unsupported(base, "writing tiles to an existing path", advice));
    }
    Ok(())
}

/// Creates a resumable directory, or reuses an existing one if it is empty or has a journal.
fn check_own(place: &Path) -> Result<()> {
    match fs::create_dir(place) {
        Err(cause) if cause.kind() == ErrorKind::AlreadyExists => {}
        other => return other.map_err(Error::io(place, "create the directory")),
    }
    let is_directory = fs::symlink_metadata(place).is_ok_and(|there| there.is_dir());
    let is_empty = || fs::read_dir(place).is_ok_and(|mut entries| entries.next().is_none());
    if is_directory && (place.join(JOURNAL).is_file() || is_empty()) { Ok(()) } else { Err(not_ours(place)) }
}
