//! Makes an older commit the newest one if a file's newest commit is corrupt.

use std::fs::File;
use std::path::Path;

use super::archive::Archive;
use super::commit::Commit;
use super::editor::open_file;
use super::extents::{ExtentKind, Extents};
use super::meta::{Meta, SLOT_OFFSETS, SLOT_SIZE};
use super::newest::{NewestState, is_read_failure};
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
        Ok(archive) if is_newest_corrupt(&archive)? => archive,
        Ok(_) => {
            let advice = "`spinney revert` restores an older commit, and loses nothing";
            return Err(Error::unsupported(path, "recovering a file whose newest commit is valid", advice));
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
    // The other slot gets the preceding commit, as if there had been no later one. Invariant: it is
    // valid, and has that commit's own end. If the slot of the recovered commit is lost later,
    // readers search for the commit from this end on; from a later offset they would miss it, and
    // silently return the preceding commit. If the other slot were invalid, they would search after
    // the recovered commit, and find those that are discarded.
    let other = match (commit.previous, slot.sequence) {
        // (No commit precedes the first one, whatever a corrupt document says.)
        (0, _) | (_, 1) => [0; SLOT_SIZE],
        (previous, sequence) => meta_at(&archive.extents, previous, sequence - 1)?.to_bytes(),
    };
    // (After a crash between the two writes, the file is as corrupt as before.)
    let other_offset = SLOT_OFFSETS[usize::from(slot.offset() == SLOT_OFFSETS[0])];
    for (offset, bytes) in [(slot.offset(), slot.to_bytes()), (other_offset, other)] {
        file.write(offset, &bytes).map_err(Error::io(path, "write the meta slot"))?;
        file.sync().map_err(Error::io(path, "sync"))?;
    }
    file.check_path()?;
    Ok(commit)
}

/// Returns whether the newest commit is corrupt.
///
/// # Errors
/// If the file cannot be read at present. That says nothing about the commit: if it counted as
/// corruption, a transient read error would allow to discard an intact commit.
fn is_newest_corrupt(archive: &Archive) -> Result<bool> {
    if matches!(archive.state, NewestState::Corrupt(_)) {
        return Ok(true);
    }
    match read_layers(archive, &archive.newest()?) {
        Ok(()) => Ok(false),
        Err(error) if is_read_failure(&error) => Err(error),
        Err(_) => Ok(true),
    }
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
    meta_at(extents, start, commit.sequence)
}

/// Returns the slot of the commit with a sequence whose extent starts at `start`. If the extent's
/// head is corrupt, the end is only known to be after `start`.
fn meta_at(extents: &Extents, start: u64, sequence: u64) -> Result<Meta> {
    let end = extents.extent_at(start)?.map_or(start + 1, |extent| extent.end().next_multiple_of(SECTOR));
    if sequence == 0 {
        return Err(extents.corrupt(format!("commit at {start}"), "sequence 0", "at least 1"));
    }
    Ok(Meta { sequence, commit: start, end })
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
            found = Some(meta_at(&extents, start, commit.sequence)?);
        }
        // (Skip the payload even if it is corrupt: it may contain bytes that imitate a commit.)
        start = extent.next_start();
    }
    let expected = "the number of a valid commit";
    found.ok_or_else(|| Error::invalid(format!("{}: commit", path.display()), number.to_string(), expected))
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;
    use std::io;

    use super::*;
    use spinney_base::io::{FileId, ReadBackend};
    use spinney_container::OpenOptions;

    /// Bytes of which some cannot be read at present.
    struct Unreadable {
        bytes: Vec<u8>,
        offset: u64,
    }

    impl ReadBackend for Unreadable {
        fn len(&self) -> u64 {
            self.bytes.len() as u64
        }

        fn bytes(&self) -> Option<&[u8]> {
            None
        }

        fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
            if (offset..offset + length as u64).contains(&self.offset) {
                return Err(Error::io("t.autumn", "read")(io::Error::other("the disk is not available")));
            }
            Ok(Cow::Borrowed(&self.bytes[offset as usize..][..length]))
        }
    }

    /// A commit whose metadata are corrupt can be discarded; one whose metadata cannot be read at
    /// present cannot.
    #[test]
    fn a_read_error_does_not_make_a_commit_corrupt() {
        let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/v1/history.autumn");
        let bytes = std::fs::read(fixture).unwrap();
        let whole = Archive::of_bytes("t.autumn".as_ref(), bytes.clone()).unwrap();
        assert!(!is_newest_corrupt(&whole).unwrap());
        let metadata = whole.newest().unwrap().layers[0].metadata;
        let open = || {
            let bytes: Box<dyn ReadBackend> = Box::new(Unreadable { bytes: bytes.clone(), offset: metadata });
            Ok((bytes, FileId::unique()))
        };
        let unreadable = Archive::open("t.autumn".as_ref(), &open, &OpenOptions::default()).unwrap();
        assert!(matches!(is_newest_corrupt(&unreadable), Err(Error::Io { .. })));
        let mut corrupt = bytes.clone();
        corrupt[metadata as usize] ^= 1;
        let corrupt = Archive::of_bytes("t.autumn".as_ref(), corrupt).unwrap();
        assert!(is_newest_corrupt(&corrupt).unwrap());
    }
}
