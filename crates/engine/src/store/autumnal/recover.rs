//! Makes an older commit the newest one if a file's newest commit is corrupt.

use std::fs::File;
use std::path::Path;

use super::archive::Archive;
use super::commit::Commit;
use super::editor::open_file;
use super::extents::{ExtentKind, Extents};
use super::meta::{Meta, SLOT_OFFSETS, SLOT_SIZE};
use super::newest::Newest;
use super::pages::{FIRST_EXTENT, SECTOR};
use super::reader::Autumnal;
use spinney_base::io::{FileAccess, FileBackend, LockedFile, WriteBackend};
use spinney_base::{Error, Progress, Result};
use spinney_container::FileHeader;

/// Makes the commit with a number the newest one, in a file whose newest commit is corrupt.
/// Everything after it is discarded: the next edit overwrites it. Returns the commit.
///
/// If neither meta slot is valid, the whole file is searched for the commit.
///
/// # Errors
/// If the file's newest commit can be read (then [`Editor::revert`](super::Editor::revert) goes
/// back without losing anything), there is no such commit, it is corrupt itself, or as
/// [`Editor::open`](super::Editor::open).
pub fn recover(path: &Path, number: u64, access: &FileAccess, progress: &dyn Progress) -> Result<Commit> {
    let file = File::options().read(true).write(true).open(path).map_err(Error::io(path, "open"))?;
    let file = FileBackend::new(file, path, access);
    // Check first: never write to a file that is not an Autumnal file.
    FileHeader::read_cells(path, &*file.reader()?)?;
    let mut file = LockedFile::new(file)?;
    file.check_path()?;
    let archive = match Archive::open(path, &|| open_file(&file), &access.into()) {
        Ok(archive) if matches!(archive.newest, Newest::Damaged(_)) => archive,
        Ok(archive) if read_layers(&archive, &archive.newest()?).is_err() => archive,
        Ok(_) => {
            let advice = "`spinney revert` goes back to an older commit, and loses nothing";
            return Err(Error::unsupported(
                path,
                "giving up commits of a file whose newest one is whole",
                advice,
            ));
        }
        Err(Error::Corrupt { .. }) => {
            let meta = scan(path, &file, number, progress)?;
            Archive::at(path, open_file(&file)?, meta, access)?
        }
        Err(error) => return Err(error),
    };
    let commit = archive.commit(number)?;
    let slot = slot_of(&archive, &commit)?;
    // The new newest commit must be readable.
    read_layers(&archive, &commit)?;
    // The other slot gets the commit before, as if there had been no later one. If this is
    // interrupted, the file is as corrupt as before.
    let other = match commit.previous {
        0 => [0; SLOT_SIZE],
        previous => Meta { sequence: slot.sequence - 1, commit: previous, end: slot.commit }.to_bytes(),
    };
    let other_offset = SLOT_OFFSETS[usize::from(slot.offset() == SLOT_OFFSETS[0])];
    for (offset, bytes) in [(slot.offset(), slot.to_bytes()), (other_offset, other)] {
        file.write(offset, &bytes).map_err(Error::io(path, "write the meta slot"))?;
        file.sync().map_err(Error::io(path, "sync"))?;
    }
    file.check_path()?;
    Ok(commit)
}

/// Fails if a layer of a commit cannot be read.
fn read_layers(archive: &Archive, commit: &Commit) -> Result<()> {
    (0..commit.layers.len())
        .try_for_each(|number| Autumnal::new(archive.clone(), commit.clone(), number).map(|_| ()))
}

/// Returns the meta slot of a commit.
fn slot_of(archive: &Archive, commit: &Commit) -> Result<Meta> {
    let extents = &archive.extents;
    let mut start = archive.meta.commit;
    // Only later commits store the commit's offset.
    loop {
        let here = Commit::read(extents, start)?;
        if here.number == commit.number || here.previous == 0 {
            break;
        }
        start = here.previous;
    }
    meta_at(extents, start, commit)
}

/// Returns the slot of the commit whose extent starts at `start`.
fn meta_at(extents: &Extents, start: u64, commit: &Commit) -> Result<Meta> {
    let end = extents.extent_at(start)?.map_or(start + 1, |extent| extent.end().next_multiple_of(SECTOR));
    if commit.sequence == 0 {
        return Err(extents.corrupt(format!("commit at {start}"), "sequence 0", "at least 1"));
    }
    Ok(Meta { sequence: commit.sequence, commit: start, end })
}

/// Searches the whole file for a commit: by following extent heads while they are contiguous, else
/// sector by sector.
fn scan(path: &Path, file: &dyn WriteBackend, number: u64, progress: &dyn Progress) -> Result<Meta> {
    let bytes = file.reader()?;
    let length = bytes.len();
    let extents = Extents::new(path, bytes, length, true)?;
    let mut found = None;
    let mut start = FIRST_EXTENT;
    while start < length {
        progress.check()?;
        let Some(extent) = extents.extent_at(start)? else {
            start += SECTOR;
            continue;
        };
        if extent.kind == ExtentKind::Commit as u8
            && let Ok(commit) = Commit::read(&extents, start)
            && commit.number == number
        {
            found = Some(meta_at(&extents, start, &commit)?);
        }
        // (Skip the payload even if it is corrupt: it may contain bytes that imitate a commit.)
        start = extent.next_start();
    }
    let expected = "one that is whole";
    found.ok_or_else(|| Error::invalid(format!("{}: commit", path.display()), number.to_string(), expected))
}
