//! After a crash at any time, an Autumnal file holds the last commit or the one before.

use spinney::edit::{Edit, Editor, Note};
use spinney::raw::ops::apply_edits;
use spinney::raw::store::autumnal::Autumnal;
use spinney::raw::store::build_tree;
use spinney::{DataKind, Output, Rule};

use crate::common::{Cells, QUAD, Random, assert_same, byte, cells_of, options};
use crate::targets::disk::{Disk, Event, put};

const SIZE: [u64; 3] = [70, 90, 1];
const SECTOR: usize = 512;

/// Returns the bytes of a new file of cells.
fn start(cells: &Cells) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    let options = options(Rule::Mean, DataKind::Continuous, cells.depth());
    build_tree(&cells.tree(Rule::Mean), cells.size, &options, Output::create(&path).unwrap(), &()).unwrap();
    std::fs::read(&path).unwrap()
}

/// Changes some cells and commits.
fn change(editor: &mut Editor, random: &mut Random, cells: &mut Cells) -> spinney::Result<()> {
    let list: Vec<_> = (0..1 + random.below(40))
        .map(|_| ([random.below(SIZE[0]), random.below(SIZE[1]), 0], random.below(200) as u8 + 1))
        .collect();
    for (cell, value) in &list {
        cells.cells[(cell[1] * SIZE[0] + cell[0]) as usize] = Some(byte(*value));
    }
    let set = list.into_iter().map(|(cell, value)| (cell, Some(vec![value.into()])));
    apply_edits(editor, &mut [Ok(Edit::Set(set.collect()))].into_iter(), &())?;
    editor.commit(Note::default()).map(|_| ())
}

/// Returns the number of the commit found in some bytes, after checking that all its cells are as
/// committed.
fn found(bytes: Vec<u8>, commits: &[Cells]) -> usize {
    let file = Autumnal::from_bytes(bytes).unwrap();
    let number = file.commit().number as usize;
    assert_same(&cells_of(&file, SIZE), &commits[number - 1], "a commit after a crash");
    number
}

#[test]
fn every_crash_leaves_the_last_commit_or_the_one_before() {
    let mut random = Random(1);
    let mut cells = Cells::random(QUAD, 1, SIZE, 5, true);
    let begin = start(&cells);
    let disk = Disk::new(begin.clone());
    let mut commits = vec![cells.clone()];
    let mut editor = disk.editor().unwrap();
    // Number of events after each commit.
    let mut ends = Vec::new();
    for _ in 0..6 {
        change(&mut editor, &mut random, &mut cells).unwrap();
        commits.push(cells.clone());
        ends.push(disk.state().events.len());
    }
    let events = disk.state().events.clone();
    // Durable bytes, and pending writes that may or may not be durable.
    let mut durable = begin;
    let mut pending: Vec<(u64, Vec<u8>)> = Vec::new();
    let mut images = 0;
    for (i, event) in events.iter().enumerate() {
        match event {
            Event::Write(offset, bytes) => pending.push((*offset, bytes.clone())),
            Event::Sync => {
                pending.drain(..).for_each(|(offset, bytes)| put(&mut durable, offset, &bytes));
            }
        }
        // Commits reported as durable, and commits begun.
        let done = 1 + ends.iter().filter(|end| **end <= i + 1).count();
        for variant in 0..40 {
            let mut image = durable.clone();
            // Any subset of the pending sectors has arrived: none, all, or a random one.
            let mut sectors: Vec<(u64, &[u8])> = pending
                .iter()
                .flat_map(|(offset, bytes)| {
                    bytes.chunks(SECTOR).enumerate().map(|(n, bytes)| (*offset + (n * SECTOR) as u64, bytes))
                })
                .collect();
            for n in (1..sectors.len()).rev() {
                sectors.swap(n, random.below(n as u64 + 1) as usize);
            }
            for (offset, bytes) in sectors {
                let arrives = match variant {
                    0 => false,
                    1 => true,
                    _ => random.below(4) > variant % 4,
                };
                if arrives {
                    put(&mut image, offset, bytes);
                }
            }
            let number = found(image, &commits);
            assert!(number == done || number == done + 1, "event {i}: commit {number}, {done} were durable");
            images += 1;
        }
    }
    assert!(images > 1000);
}

#[test]
fn no_writes_follow_a_failure() {
    let mut random = Random(2);
    for good in 0..30 {
        let mut cells = Cells::random(QUAD, 1, SIZE, 5, true);
        let disk = Disk::new(start(&cells));
        let mut commits = vec![cells.clone()];
        disk.state().good = good;
        let failed = (|| {
            let mut editor = disk.editor()?;
            for _ in 0..20 {
                let changed = change(&mut editor, &mut random, &mut cells);
                commits.push(cells.clone());
                if let Err(error) = changed {
                    // The disk works again, but its contents are unknown.
                    disk.state().good = usize::MAX;
                    let events = disk.state().events.len();
                    assert!(change(&mut editor, &mut random, &mut cells).is_err());
                    assert_eq!(disk.state().events.len(), events);
                    return Err(error);
                }
            }
            Ok(())
        })();
        let error = failed.unwrap_err();
        assert!(matches!(error, spinney::Error::Io { .. }), "{error}");
        disk.state().good = usize::MAX;
        let bytes = disk.state().bytes.clone();
        let number = found(bytes, &commits);
        assert!(number + 1 >= commits.len(), "commit {number} of {}", commits.len());
        // The next editor continues from that state.
        let mut next = disk.editor().unwrap();
        let mut cells = commits[number - 1].clone();
        change(&mut next, &mut random, &mut cells).unwrap();
        commits.truncate(number);
        commits.push(cells);
        let bytes = disk.state().bytes.clone();
        assert_eq!(found(bytes, &commits), number + 1);
    }
}
