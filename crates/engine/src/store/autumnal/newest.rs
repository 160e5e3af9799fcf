//! Finds the newest commit of a file: by the meta slots, or after the remaining commit if one of
//! them is corrupt.

use std::path::Path;

use super::commit::Commit;
use super::extents::{ExtentKind, Extents};
use super::meta::{Meta, Slot, slots};
use super::pages::{PAGE, SECTOR};
use spinney_base::io::ReadBackend;
use spinney_base::{Error, Result, sort};

/// State of the newest commit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum NewestState {
    /// It is the one that the slots refer to.
    Good,
    /// Its slot is corrupt; it was found after the commit of the other slot.
    CorruptSlot,
    /// It cannot be read, and an older commit is used instead. The strings are the position in the
    /// file, what was found, and what was expected.
    Corrupt([String; 3]),
}

impl NewestState {
    /// Fails if the newest commit cannot be read.
    pub(super) fn check(&self, extents: &Extents) -> Result<()> {
        match self {
            NewestState::Good | NewestState::CorruptSlot => Ok(()),
            NewestState::Corrupt([place, found, expected]) => {
                let advice = "`spinney log` lists the readable commits, `spinney recover` makes one of them the newest";
                Err(extents.corrupt(place, found, &format!("{expected}; {advice}")))
            }
        }
    }
}

/// Result of the search for the newest commit: the bytes that were searched, the slot of the newest
/// readable commit, and the state of the newest commit.
pub(super) enum NewestSearch {
    Found(Box<dyn ReadBackend>, Meta, NewestState),
    /// No slot leads to a readable commit. The error gives the reason if a slot is valid.
    Nothing(Option<Error>),
}

/// Returns the valid slots, the newer one first.
pub(super) fn whole(slots: &[Slot; 2]) -> Vec<Meta> {
    let metas = slots.iter().filter_map(|slot| if let Slot::Whole(meta) = slot { Some(*meta) } else { None });
    let mut whole: Vec<Meta> = metas.collect();
    sort::by_key(&mut whole, |meta| !meta.sequence);
    whole
}

/// Finds the newest commit.
///
/// Invariant: a crash leaves both slots valid, or leaves one of them partially written. In that
/// case everything that its commit wrote is durable, because it was synced before, and the commit
/// is found by continuing after the other slot's commit. Any other invalid slot, and any valid slot
/// whose commit is missing, is corruption and is reported. Silently falling back to an older commit
/// would lose acknowledged edits.
pub(super) fn find_newest(path: &Path, bytes: Box<dyn ReadBackend>) -> Result<NewestSearch> {
    let length = bytes.len();
    let slots = slots(&*bytes)?;
    let mut extents = Extents::new(path, bytes, 0, true)?;
    let mut corruption = None;
    let mut found = None;
    for meta in whole(&slots) {
        match read(&mut extents, &meta, length) {
            Ok(()) => {
                found = Some(meta);
                break;
            }
            Err(error) if is_read_failure(&error) => return Err(error),
            Err(error) => corruption = corruption.or(Some(strings_of(error))),
        }
    }
    let Some(meta) = found else {
        let error = corruption.map(|[place, found, expected]| Error::corrupt(path, place, found, expected));
        return Ok(NewestSearch::Nothing(error));
    };
    if let Some(corruption) = corruption {
        return Ok(NewestSearch::Found(extents.into_backend(), meta, NewestState::Corrupt(corruption)));
    }
    // After the first commit, the other slot is empty.
    let other = slots[usize::from(!meta.sequence.is_multiple_of(2))];
    let is_lost = match other {
        Slot::Whole(_) => false,
        Slot::Empty => meta.sequence > 1,
        Slot::Corrupt => true,
    };
    if !is_lost {
        return Ok(NewestSearch::Found(extents.into_backend(), meta, NewestState::Good));
    }
    extents.end = length;
    let next = find_next(&extents, &meta);
    let backend = extents.into_backend();
    Ok(match next {
        Ok(Some(next)) => NewestSearch::Found(backend, next, NewestState::CorruptSlot),
        // The older slot was lost.
        Ok(None) => NewestSearch::Found(backend, meta, NewestState::Good),
        Err(error) if is_read_failure(&error) => return Err(error),
        Err(error) => NewestSearch::Found(backend, meta, NewestState::Corrupt(strings_of(error))),
    })
}

/// Returns whether an error says nothing about the file's bytes, because they could not be read.
pub(super) fn is_read_failure(error: &Error) -> bool {
    matches!(error, Error::Io { .. } | Error::NotFetched)
}

/// Checks that the commit of a slot exists.
fn read(extents: &mut Extents, meta: &Meta, length: u64) -> Result<()> {
    if meta.end > length {
        let found = format!("{length} bytes");
        let expected =
            format!("at least {}, the end of the newest commit (was the file cut short?)", meta.end);
        return Err(extents.corrupt("file", found, &expected));
    }
    extents.end = meta.end;
    let commit = Commit::read(extents, meta.commit)?;
    if commit.sequence != meta.sequence {
        let found = format!("sequence {}", commit.sequence);
        let expected = format!("{}, the sequence of its slot", meta.sequence);
        return Err(extents.corrupt(format!("commit at {}", meta.commit), found, &expected));
    }
    Ok(())
}

/// Finds the commit that was written after another one. All its extents must be intact.
fn find_next(extents: &Extents, last: &Meta) -> Result<Option<Meta>> {
    let mut start = last.end.next_multiple_of(PAGE);
    let mut first_error = None;
    while let Some(extent) = extents.extent_at(start)? {
        let end = extent.end().next_multiple_of(SECTOR);
        if let Err(error) = extents.check_payload(&extent) {
            first_error = first_error.or(Some(error));
        } else if extent.kind == ExtentKind::Commit as u8 {
            let commit = Commit::read(extents, start)?;
            // Invariant: a commit refers to the one before it and is the next in sequence. What a
            // cancelled edit left after the last commit does not have these links, even if it is
            // intact, and is never restored.
            let follows =
                commit.previous == last.commit && commit.sequence == last.sequence.saturating_add(1);
            return match first_error {
                _ if !follows => Ok(None),
                Some(error) => Err(error),
                None => Ok(Some(Meta { sequence: commit.sequence, commit: start, end })),
            };
        }
        start = end;
    }
    Ok(None)
}

/// Returns the strings of an error about corruption.
fn strings_of(error: Error) -> [String; 3] {
    match error {
        Error::Corrupt { location: place, found, expected, .. } => [place, found, expected],
        other => ["newest commit".into(), other.to_string(), "a readable commit".into()],
    }
}
