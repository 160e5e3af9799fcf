//! Strings and values of Autumnal files that imitate structures of such a file are read as strings
//! and values.

use std::path::{Path, PathBuf};

use spinney::edit::{Edit, FillRegion, Note, edit};
use spinney::raw::store::autumnal::{Autumnal, CompactOptions, History, Keep, compact, recover};
use spinney::{
    Bounds, Code, DataKind, Dimension, FileView, OpenOptions, Output, Rule, SampleType, Value, WriteOptions,
    convert,
};
use tempfile::TempDir;

use super::crafted::{encoded, head};
use crate::common::{Cells, assert_same, cells_of, goblin_bytes, made, oct, options, quad, write_cells};
use crate::targets::seal::{HEAD, SLOTS, extents, long};

const MEMORY: u64 = 1 << 20;

fn open(path: &Path) -> Autumnal {
    Autumnal::open(path, &OpenOptions::new()).unwrap()
}

/// Returns the offset of a byte sequence in another.
fn find(bytes: &[u8], wanted: &[u8]) -> usize {
    bytes.windows(wanted.len()).position(|window| window == wanted).unwrap()
}

/// Returns a file with three commits, of which the second has a message.
fn with_message(message: &str) -> (TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    let goblin = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1/classic.goblin");
    convert(&goblin, false, Output::create(&path).unwrap(), WriteOptions::new(MEMORY), &()).unwrap();
    for (value, message) in [(3.0, message), (2.0, "")] {
        let region = FillRegion::Box(Bounds { min: [1, 1, 0], max: [4, 6, 1] });
        let note = Note { message: message.into(), ..Note::default() };
        edit(&path, [Ok(Edit::Fill(region, Some(vec![value.into()])))], note, MEMORY, &()).unwrap().unwrap();
    }
    (directory, path)
}

#[test]
fn messages_that_imitate_heads_are_messages() {
    let (_directory, path) = with_message(&"x".repeat(5000));
    let start = find(&std::fs::read(&path).unwrap(), &[b'x'; 5000]);
    let mut message = vec![b'x'; 5000];
    let mut kinds = (0..3).cycle();
    for position in (start.next_multiple_of(512)..start + 5000 - HEAD).step_by(512) {
        let kind = kinds.next().unwrap();
        // A message is UTF-8, which bytes below 128 always are.
        let forged = (1..).map(|length| head(kind, position as u64, length, 7)).find(|head| head.is_ascii());
        message[position - start..][..HEAD].copy_from_slice(&forged.unwrap());
    }
    let message = String::from_utf8(message).unwrap();
    let (directory, path) = with_message(&message);
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(find(&bytes, message.as_bytes()), start, "the message imitates something");
    let is_whole = |path: &Path, numbers: &[u64]| {
        assert_eq!(open(path).verify(MEMORY, &()).unwrap(), []);
        let history = History::open(path, &OpenOptions::new()).unwrap();
        let listed: Vec<u64> = history.commits().map(|commit| commit.unwrap().number).collect();
        assert_eq!(listed, numbers);
        assert_eq!(history.commit(2).unwrap().note.message, message);
    };
    is_whole(&path, &[3, 2, 1]);
    let small = directory.path().join("small.autumn");
    compact(&path, &CompactOptions::new(&Keep::Last(2), MEMORY), Output::create(&small).unwrap(), &())
        .unwrap();
    is_whole(&small, &[3, 2]);
    // The newest slot is lost: the commit is found after the previous one, and the message is
    // skipped.
    let mut corrupt = bytes.clone();
    corrupt[SLOTS[0]] ^= 1;
    let tree = Autumnal::from_bytes(corrupt.clone()).unwrap();
    assert!(tree.commit().number == 3 && tree.remark().is_some());
    // Both slots are lost, and the commit with the message is corrupt as well.
    corrupt[SLOTS[1]] ^= 1;
    corrupt[start] ^= 1;
    std::fs::write(&path, &corrupt).unwrap();
    assert!(recover(&path, 2, &Default::default(), &()).is_err());
    assert_eq!(recover(&path, 1, &Default::default(), &()).unwrap().number, 1);
    assert_eq!(open(&path).verify(MEMORY, &()).unwrap(), []);
}

/// Cells along each axis, so many that their values span several extents.
const SIDE: u64 = 16;

/// Returns a file whose second commit has these cells.
fn with_cells(cells: &Cells) -> (TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let (path, patch) = (directory.path().join("t.autumn"), directory.path().join("patch.goblin"));
    let one = made(cells.form, cells.size, |cell| (cell == [0; 3]).then_some(Value::ZERO));
    write_cells(&path, &one, &options(Rule::Nearest, DataKind::Continuous, cells.depth()));
    std::fs::write(&patch, goblin_bytes(cells, Rule::Nearest, DataKind::Continuous)).unwrap();
    let paste = Edit::Paste {
        patch: FileView::of(&patch),
        at: Some([0; 3]),
        void: true,
        options: Default::default(),
    };
    edit(&path, [Ok(paste)], Note::default(), MEMORY, &()).unwrap().unwrap();
    (directory, path)
}

/// Returns a commit with a number in which all cells have one value, as an extent for an offset.
fn forged_commit(number: u64, start: u64, metadata: u64, time: i64) -> Vec<u8> {
    let note = (Some(time), String::new(), String::new());
    let root = (1u8, vec![1u8; 16], 0u64);
    let written = (0u64, 0u64, 0u64, 0u64);
    let commit = (number, note, SIDE.pow(3), 0u64, written, number, root, metadata, 0u64, (0u64, 0u64));
    let payload = encoded((1u32, commit));
    [head(1, start, payload.len() as u64, crc32c::crc32c(&payload)), payload].concat()
}

/// Returns the bytes of a file of 64 x 64 cells.
fn written(cells: &Cells, rule: Rule) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    write_cells(&path, cells, &options(rule, DataKind::Continuous, 6));
    std::fs::read(&path).unwrap()
}

/// Checks that a file has these cells.
fn assert_says(file: Vec<u8>, cells: &Cells, what: &str) {
    let file = Autumnal::from_bytes(file).unwrap();
    assert_same(&cells_of(&file, cells.size), cells, what);
    assert_eq!(file.verify(MEMORY, &()).unwrap(), []);
}

#[test]
fn cells_that_imitate_the_head_of_an_extent_are_cells() {
    let side = 64;
    let mut cells = made(quad(SampleType::F64, 1), [side, side, 1], |[x, y, _]| {
        Some(Value::from([0.5 + (x + side * y) as f64]))
    });
    let plain = written(&cells, Rule::Nearest);
    // The rows of a dense block, of 32 cells, are contiguous; some are at offsets where an extent
    // could start.
    let indices = |(x, y): (u64, u64)| (0..32).map(move |i| (y * side + x + i) as usize);
    let mut forged_at = Vec::new();
    for row in (0..side).flat_map(|y| [(0, y), (32, y)]) {
        let bytes: Vec<u8> =
            indices(row).flat_map(|index| cells.cells[index].unwrap().to_bytes()[..8].to_vec()).collect();
        let start = find(&plain, &bytes);
        let at = start.next_multiple_of(512);
        if at + HEAD > start + bytes.len() {
            continue;
        }
        // Some of these bytes would not be numbers.
        let forged = (64..).find_map(|length| {
            let mut bytes = bytes.clone();
            bytes[at - start..][..HEAD].copy_from_slice(&head(0, at as u64, length, 7));
            let values = bytes.as_chunks::<8>().0;
            values.iter().all(|value| !f64::from_le_bytes(*value).is_nan()).then_some(bytes)
        });
        for (index, bytes) in indices(row).zip(forged.unwrap().chunks(8)) {
            cells.cells[index] = Some(Value::from_bytes(bytes));
        }
        forged_at.push(at);
    }
    let forged = written(&cells, Rule::Nearest);
    let heads = extents(&forged);
    // The bytes after the first record have moved.
    let imitated = forged_at.iter().filter(|at| forged[**at..].starts_with(b"Extt") && !heads.contains(at));
    assert!(imitated.count() > 5, "the test imitates something");
    assert_says(forged, &cells, "imitated heads");
}

#[test]
fn records_that_begin_like_the_head_of_an_extent_are_records() {
    // The north-east has four leaves that form a head after the record's representative. The
    // north-west, whose record comes first, has enough nodes to move that record to an offset where
    // an extent could start.
    let cells = |north_east: [[u8; 8]; 4], (nodes, more): (u64, bool)| {
        made(quad(SampleType::F64, 1), [64, 64, 1], |[x, y, _]| {
            let number = |x: u64, y: u64| {
                (0..3).map(|bit| (x >> bit & 1 | (y >> bit & 1) << 1) << (2 * bit)).sum::<u64>()
            };
            let block = number(x / 4, y / 4);
            let is_other = match (x < 32, y < 32) {
                (_, false) => false,
                (true, true) if block < nodes => x % 4 == 0 && y % 4 == 0,
                (true, true) => more && block == nodes && x % 4 < 2 && y % 4 < 2,
                (false, true) => {
                    return Some(Value::from_bytes(&north_east[(x / 16 % 2 + y / 16 * 2) as usize]));
                }
            };
            Some(Value::from([if is_other { 0.25 } else { 0.5f64 }]))
        })
    };
    // The largest of them is the representative. These are not heads yet.
    let plain = [1, 2, 3, 0x7474_7844u64].map(u64::to_le_bytes);
    let record = [&plain[3..], &plain].concat().concat();
    let sizes = (1..60).flat_map(|nodes| [(nodes, false), (nodes, true)]);
    let mut found = sizes.map(|size| (size, find(&written(&cells(plain, size), Rule::Max), &record)));
    let (size, at) = found.find(|(_, at)| at.is_multiple_of(512)).unwrap();
    let heads = (0..).map(|length| head(0, at as u64, length, 7));
    // The checksums must be less than the representative, that is, negative.
    let mut four = heads.map(|head| {
        let four: [[u8; 8]; 4] = head.as_chunks::<8>().0.try_into().unwrap();
        [four[1], four[2], four[3], four[0]]
    });
    let four = four.find(|four| f64::from_le_bytes(four[2]) < 0.0).unwrap();
    let cells = cells(four, size);
    let forged = written(&cells, Rule::Max);
    assert_eq!(
        find(&forged, &[&four[3..], &four].concat().concat()) % 512,
        HEAD,
        "it has an extent of its own"
    );
    // First query: no earlier one has found the extent.
    let cell = Code::from_cell(Dimension::Quad, 6, [40, 5, 0]).unwrap();
    assert_eq!(Autumnal::from_bytes(forged.clone()).unwrap().value_at(cell).unwrap(), cells.get([40, 5, 0]));
    assert_says(forged, &cells, "an imitated head");
}

#[test]
fn values_that_imitate_commits_are_values() {
    let form = oct(SampleType::F32, 4);
    let number = |[x, y, z]: [u64; 3], channel: u64| 0.5 + (((z * SIDE + y) * SIDE + x) * 4 + channel) as f32;
    let value = |cell| Value::from([0, 1, 2, 3].map(|channel| number(cell, channel)));
    let cells = made(form, [SIDE; 3], |cell| Some(value(cell)));
    let (_directory, path) = with_cells(&cells);
    let bytes = std::fs::read(&path).unwrap();
    let metadata = extents(&bytes).into_iter().find(|head| bytes[head + 4] == 2).unwrap() as u64;
    // All cells of a layer of a dense block, 8 x 8 cells, are contiguous. In some layers an extent
    // could start that fits.
    let index = |[x, y, z]: [u64; 3]| ((z * SIDE + y) * SIDE + x) as usize;
    let layers = (0..4 * SIDE).map(|i| [i % 2 * 8, i / 2 % 2 * 8, i / 4]);
    let layer = |[x, y, z]: [u64; 3]| -> Vec<[u64; 3]> {
        (0..64).map(|cell| [x + cell % 8, y + cell / 8, z]).collect()
    };
    let positions = layers.map(|first| {
        let run: Vec<u8> =
            layer(first).into_iter().flat_map(|cell| value(cell).to_bytes()[..16].to_vec()).collect();
        let start = find(&bytes, &run);
        (start.next_multiple_of(512), start, first, run)
    });
    // After the first imitation all bytes would move.
    let (position, start, first, run) = positions.min().unwrap();
    assert!(position + 90 <= start + run.len());
    for number in [2, 3] {
        let forged = (0..).find_map(|time| {
            let commit = forged_commit(number, position as u64, metadata, time);
            let mut run = run.clone();
            run[position - start..][..commit.len()].copy_from_slice(&commit);
            // NaN bytes would be VOID.
            run.chunks(4).all(|four| !f32::from_le_bytes(four.try_into().unwrap()).is_nan()).then_some(run)
        });
        let forged = forged.unwrap();
        let mut cells = cells.clone();
        for (cell, bytes) in layer(first).into_iter().zip(forged.chunks(16)) {
            cells.cells[index(cell)] = Some(Value::from_bytes(bytes));
        }
        let (_directory, path) = with_cells(&cells);
        let mut bytes = std::fs::read(&path).unwrap();
        assert_eq!(find(&bytes, &forged), start, "the values imitate something");
        let tree = open(&path);
        assert_eq!(tree.verify(MEMORY, &()).unwrap(), []);
        assert_same(&cells_of(&tree, cells.size), &cells, "imitated commits");
        drop(tree);
        // Without the newest slot, and without both.
        bytes[SLOTS[1]] ^= 1;
        let tree = Autumnal::from_bytes(bytes.clone()).unwrap();
        assert_eq!(tree.commit().number, 2);
        assert_same(&cells_of(&tree, cells.size), &cells, "imitated commits, a slot lost");
        bytes[SLOTS[0]] ^= 1;
        // Also if the values are corrupt, so that a recovery might search among them.
        let records =
            extents(&bytes).into_iter().rfind(|head| *head < position && bytes[head + 4] == 0).unwrap();
        assert!(records + HEAD + (long(&bytes, records + 16) as usize) > position);
        for is_corrupt in [false, true] {
            if is_corrupt {
                bytes[records + HEAD] ^= 1;
            }
            std::fs::write(&path, &bytes).unwrap();
            if number == 3 {
                assert!(recover(&path, 3, &Default::default(), &()).is_err(), "there is no such commit");
            }
            assert_eq!(recover(&path, 2, &Default::default(), &()).unwrap().inner_nodes, 585);
            if !is_corrupt {
                assert_same(&cells_of(&open(&path), cells.size), &cells, "recovered");
            }
        }
    }
}
