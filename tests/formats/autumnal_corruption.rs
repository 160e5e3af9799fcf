//! Corruption of an Autumnal file's newest commit, and files that are moved or appear during a
//! write: nothing is rolled back or lost without a report.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use spinney::edit::{Edit, Editor, FillRegion, Note, edit};
use spinney::raw::store::autumnal::{Autumnal, CompactOptions, History, Keep, compact, recover};
use spinney::{Bounds, Error, OpenOptions, Output, Progress, WriteOptions, convert};
use tempfile::TempDir;

use super::crafted::head;

/// Offset of the meta slots, and their size in bytes.
const SLOTS: [usize; 2] = [4096, 8192];
const SLOT: usize = 40;

/// Returns an edit that fills a corner of the classic image with a value.
fn fill(value: f64) -> Edit {
    Edit::Fill(FillRegion::Box(Bounds { min: [1, 1, 0], max: [4, 6, 1] }), Some(vec![value.into()]))
}

/// Returns a file with `commits` commits.
fn file(commits: u64) -> (TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    publish(&path);
    for number in 1..commits {
        edit(&path, [Ok(fill(number as f64 + 2.0))], Note::default(), 1 << 20, &()).unwrap();
    }
    (directory, path)
}

fn publish(path: &Path) {
    let goblin = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1/classic.goblin");
    convert(&goblin, false, Output::create(path).unwrap(), WriteOptions::new(1 << 20), &()).unwrap();
}

fn open(path: &Path) -> spinney::Result<Autumnal> {
    Autumnal::open(path, &OpenOptions::new())
}

fn numbers(path: &Path) -> Vec<Option<u64>> {
    let history = History::open(path, &OpenOptions::new()).unwrap();
    history.commits().map(|commit| commit.ok().map(|commit| commit.number)).collect()
}

/// Returns the start and end of the newest commit's extent.
fn newest(bytes: &[u8]) -> (usize, usize) {
    let number = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let slot = SLOTS.into_iter().max_by_key(|slot| number(slot + 8)).unwrap();
    (number(slot + 16) as usize, number(slot + 24) as usize)
}

#[test]
fn flipped_bits_of_meta_slots_are_reported_or_harmless() {
    for commits in 1..4 {
        let (_directory, path) = file(commits);
        let bytes = std::fs::read(&path).unwrap();
        let mut mended = 0;
        for slot in SLOTS {
            for bit in 0..8 * SLOT {
                let mut bytes = bytes.clone();
                bytes[slot + bit / 8] ^= 1 << (bit % 8);
                let Ok(tree) = Autumnal::from_bytes(bytes) else {
                    assert_eq!(commits, 1, "bit {bit} of the slot at {slot}");
                    continue;
                };
                assert_eq!(tree.commit().number, commits, "bit {bit} of the slot at {slot}");
                mended += u32::from(tree.remark().is_some());
                let findings = tree.verify(1 << 20, &()).unwrap();
                assert_eq!(findings.len(), 1, "{findings:?}");
                assert!(findings[0].place.contains("meta slot"), "{findings:?}");
            }
        }
        // Only changes to the newest slot.
        assert_eq!(mended, if commits == 1 { 0 } else { 8 * SLOT as u32 });
    }
}

#[test]
fn every_truncation_is_reported() {
    let (_directory, path) = file(3);
    let bytes = std::fs::read(&path).unwrap();
    let (_, end) = newest(&bytes);
    for length in 0..bytes.len() {
        match Autumnal::from_bytes(bytes[..length].to_vec()) {
            Ok(tree) => assert!(length >= end && tree.commit().number == 3, "{length} bytes"),
            Err(error) => assert!(length < end, "{length} bytes: {error}"),
        }
    }
    std::fs::write(&path, &bytes[..end - 1]).unwrap();
    let error = open(&path).err().unwrap().to_string();
    assert!(error.contains("cut short") && error.contains("spinney recover"), "{error}");
    // Older commits are readable, and no editor overwrites anything.
    assert_eq!(numbers(&path), [Some(2), Some(1), None]);
    assert!(History::open(&path, &OpenOptions::new()).unwrap().check_newest().is_err());
    let older = PathBuf::from(format!("{}@2", path.display()));
    assert_eq!(open(&older).unwrap().commit().number, 2);
    assert!(edit(&path, [Ok(fill(9.0))], Note::default(), 1 << 20, &()).is_err());
    assert_eq!(std::fs::read(&path).unwrap(), &bytes[..end - 1]);
}

/// The files that warnings were issued for.
#[derive(Default)]
struct WarnedFiles(Mutex<Vec<PathBuf>>);

impl Progress for WarnedFiles {
    fn warn(&self, file: &Path, _: &str) {
        self.0.lock().unwrap().push(file.to_path_buf());
    }
}

#[test]
fn an_editor_repairs_a_slot_and_continues_from_the_newest_commit() {
    let (_directory, path) = file(3);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[SLOTS[0] + 8] ^= 64;
    std::fs::write(&path, &bytes).unwrap();
    assert!(open(&path).unwrap().remark().is_some());
    let warnings = WarnedFiles::default();
    edit(&path, [Ok(fill(9.0))], Note::default(), 1 << 20, &warnings).unwrap();
    assert_eq!(*warnings.0.lock().unwrap(), [path.as_path()]);
    let tree = open(&path).unwrap();
    assert_eq!((tree.commit().number, tree.remark()), (4, None));
    assert_eq!(tree.verify(1 << 20, &()).unwrap(), []);
    assert_eq!(numbers(&path), [Some(4), Some(3), Some(2), Some(1)]);
}

#[test]
fn a_corrupt_commit_blocks_edits_until_a_commit_is_recovered() {
    for slots_are_lost in [false, true] {
        let (_directory, path) = file(4);
        assert!(
            matches!(recover(&path, 2, &Default::default(), &()), Err(Error::Unsupported { .. })),
            "nothing is corrupt"
        );
        let mut bytes = std::fs::read(&path).unwrap();
        let (commit, _) = newest(&bytes);
        bytes[commit + 40] ^= 1;
        if slots_are_lost {
            SLOTS.into_iter().for_each(|slot| bytes[slot] ^= 1);
        }
        std::fs::write(&path, &bytes).unwrap();
        assert!(open(&path).is_err());
        assert!(edit(&path, [Ok(fill(9.0))], Note::default(), 1 << 20, &()).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), bytes, "an edit that is refused writes nothing");
        assert!(matches!(
            recover(&path, 4, &Default::default(), &()),
            Err(Error::Corrupt { .. } | Error::Invalid { .. })
        ));
        assert_eq!(recover(&path, 2, &Default::default(), &()).unwrap().number, 2);
        let tree = open(&path).unwrap();
        assert_eq!((tree.commit().number, tree.verify(1 << 20, &()).unwrap()), (2, vec![]));
        edit(&path, [Ok(fill(9.0))], Note::default(), 1 << 20, &()).unwrap();
        assert_eq!(numbers(&path), [Some(3), Some(2), Some(1)]);
        assert_eq!(open(&path).unwrap().verify(1 << 20, &()).unwrap(), []);
    }
}

/// The commit that `recover` made the newest is found even if its own slot is lost later: the other
/// slot has the true end of the preceding commit.
#[test]
fn a_recovered_commit_is_found_without_its_slot() {
    let (_directory, path) = file(4);
    let mut bytes = std::fs::read(&path).unwrap();
    let (commit, _) = newest(&bytes);
    bytes[commit + 40] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(recover(&path, 3, &Default::default(), &()).unwrap().number, 3);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[SLOTS[0] + 8] ^= 64;
    let tree = Autumnal::from_bytes(bytes).unwrap();
    assert_eq!((tree.commit().number, tree.remark().is_some()), (3, true));
}

#[test]
fn a_torn_slot_does_not_revive_an_incomplete_commit() {
    let (_directory, path) = file(3);
    let mut bytes = std::fs::read(&path).unwrap();
    let (commit, _) = newest(&bytes);
    // Two corruptions: the slot and the commit.
    bytes[SLOTS[0] + 8] ^= 64;
    bytes[commit - 512 + 33] ^= 1;
    assert!(Autumnal::from_bytes(bytes.clone()).is_err());
}

#[test]
fn remains_of_an_aborted_edit_are_ignored() {
    let (_directory, path) = file(2);
    let mut bytes = std::fs::read(&path).unwrap();
    // The space between the first commit's end and the next page contains the head of an extent
    // whose bytes the second commit overwrote.
    let number = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let (start, end) = (number(SLOTS[0] + 24), bytes.len());
    assert!(!start.is_multiple_of(4096) && start.next_multiple_of(4096) < number(SLOTS[1] + 16));
    let left = head(0, start as u64, (end - start - 32) as u64, 7);
    bytes[start..start + 32].copy_from_slice(&left);
    let tree = Autumnal::from_bytes(bytes.clone()).unwrap();
    assert_eq!((tree.commit().number, tree.verify(1 << 20, &()).unwrap()), (2, vec![]));
    SLOTS.into_iter().for_each(|slot| bytes[slot] ^= 1);
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(recover(&path, 2, &Default::default(), &()).unwrap().number, 2);
    assert_eq!(open(&path).unwrap().verify(1 << 20, &()).unwrap(), []);
}

/// Runs an action while an operation is in progress.
struct Meanwhile<F: FnOnce() + Send>(Mutex<Cell<Option<F>>>);

impl<F: FnOnce() + Send> Meanwhile<F> {
    fn new(action: F) -> Self {
        Meanwhile(Mutex::new(Cell::new(Some(action))))
    }
}

impl<F: FnOnce() + Send> Progress for Meanwhile<F> {
    fn advance(&self, _: u64, _: u64) {
        if let Some(action) = self.0.lock().unwrap().take() {
            action();
        }
    }
}

#[test]
fn a_file_that_appears_meanwhile_is_not_replaced() {
    let (directory, path) = file(2);
    let target = directory.path().join("new.autumn");
    let goblin = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1/classic.goblin");
    let appear = || {
        publish(&target);
        edit(&target, [Ok(fill(9.0))], Note::default(), 1 << 20, &()).unwrap();
    };
    let meanwhile = Meanwhile::new(appear);
    let refused =
        convert(&goblin, false, Output::create(&target).unwrap(), WriteOptions::new(1 << 20), &meanwhile)
            .unwrap_err();
    assert!(refused.to_string().contains("another process has created"), "{refused}");
    assert_eq!(open(&target).unwrap().commit().number, 2);

    std::fs::remove_file(&target).unwrap();
    let meanwhile = Meanwhile::new(appear);
    let output = Output::create(&target).unwrap();
    compact(&path, &CompactOptions::new(&Keep::Last(1), 1 << 20), output, &meanwhile).unwrap_err();
    assert_eq!(open(&target).unwrap().commit().number, 2);
    let names: Vec<_> =
        std::fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 2, "temporary files remain: {names:?}");
}

#[cfg(unix)]
#[test]
fn a_commit_to_a_moved_file_fails_and_names_its_new_path() {
    let (directory, path) = file(2);
    let moved = directory.path().join("moved.autumn");
    let begun = |path: &Path| {
        let mut editor = Editor::open(path, 1 << 20).unwrap();
        spinney::raw::ops::apply_edits(&mut editor, &mut [Ok(fill(9.0))].into_iter(), &()).unwrap();
        editor
    };
    // Replaced: the edited file has no name any more.
    let mut editor = begun(&path);
    publish(&moved);
    std::fs::rename(&moved, &path).unwrap();
    match editor.commit(Note::default()) {
        Err(Error::Moved { file: None, what, .. }) => assert!(what.contains("replaced"), "{what}"),
        other => panic!("{other:?}"),
    }
    assert!(editor.commit(Note::default()).is_err());
    assert_eq!(numbers(&path), [Some(1)]);
    // Moved: the file has another name.
    let mut editor = begun(&path);
    std::fs::rename(&path, &moved).unwrap();
    let error = editor.commit(Note::default()).unwrap_err();
    assert!(cfg!(not(target_os = "linux")) || error.to_string().contains("moved.autumn"), "{error}");
    assert_eq!(numbers(&moved), [Some(1)]);
}

/// Changes a byte of the extent at an offset and recomputes its checksums.
fn reseal(bytes: &mut [u8], start: usize, at: usize) {
    let length = u64::from_le_bytes(bytes[start + 16..start + 24].try_into().unwrap()) as usize;
    bytes[start + 32 + at] ^= 1;
    let checksum = crc32c::crc32c(&bytes[start + 32..start + 32 + length]);
    bytes[start + 24..start + 28].copy_from_slice(&checksum.to_le_bytes());
    let checksum = crc32c::crc32c(&bytes[start..start + 28]);
    bytes[start + 28..start + 32].copy_from_slice(&checksum.to_le_bytes());
}

#[test]
fn verification_reads_the_trees_of_all_commits() {
    let (_directory, path) = file(3);
    let bytes = std::fs::read(&path).unwrap();
    let mut only_older = 0;
    // The records of the first commit, some of which the newest commit shares.
    for at in 0..81 {
        let mut bytes = bytes.clone();
        reseal(&mut bytes, 3 * 4096, at);
        let Ok(tree) = Autumnal::from_bytes(bytes) else { continue };
        let quick = tree.verify_quickly(1 << 20, &()).unwrap();
        let all = tree.verify(1 << 20, &()).unwrap();
        // Some leaves may have any value.
        if quick.is_empty() && !all.is_empty() {
            assert!(all[0].place.contains("commit 1") || all[0].place.contains("commit 2"), "{all:?}");
            only_older += 1;
        }
    }
    assert!(only_older > 10, "{only_older}");
}
