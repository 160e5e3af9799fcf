//! Texts and values of Autumnal files that look like parts of such a file: they are texts and values.

use std::path::{Path, PathBuf};

use spinney::io::Output;
use spinney::ops::{Chain, Edit, FillRegion, convert, edit};
use spinney::space::Bounds;
use spinney::store::OpenOptions;
use spinney::store::autumnal::{Autumnal, History, Keep, Note, compact, recover};
use spinney::value::{Kind, Rule, SampleType, Value};
use tempfile::TempDir;

use super::autumnal_hostile::{encoded, head};
use crate::common::{Cells, assert_same, cells_of, goblin_bytes, made, oct, options, write_cells};
use crate::targets::seal::{HEAD, SLOTS, extents, long};

const MEMORY: u64 = 1 << 20;

fn open(path: &Path) -> Autumnal {
    Autumnal::open(path, &OpenOptions::new()).unwrap()
}

/// Offset of some bytes in others.
fn find(bytes: &[u8], wanted: &[u8]) -> usize {
    bytes.windows(wanted.len()).position(|window| window == wanted).unwrap()
}

/// A file whose second commit, of three, has a message.
fn with_message(message: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.autumn");
    let goblin = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1/classic.goblin");
    convert(&goblin, false, Output::create(&path).unwrap(), MEMORY, &()).unwrap();
    for (value, message) in [(3.0, message), (2.0, "")] {
        let region = FillRegion::Box(Bounds { min: [1, 1, 0], max: [4, 6, 1] });
        let note = Note { message: message.into(), ..Note::default() };
        edit(&path, [Ok(Edit::Fill(region, Some(vec![value])))], note, MEMORY, &()).unwrap().unwrap();
    }
    (folder, path)
}

#[test]
fn messages_that_imitate_heads_are_messages() {
    let (_folder, path) = with_message(&"x".repeat(5000));
    let start = find(&std::fs::read(&path).unwrap(), &[b'x'; 5000]);
    let mut message = vec![b'x'; 5000];
    let mut kinds = (0..3).cycle();
    for place in (start.next_multiple_of(512)..start + 5000 - HEAD).step_by(512) {
        let kind = kinds.next().unwrap();
        // (A message is a text: of bytes below 128 any are.)
        let forged = (1..).map(|length| head(kind, place as u64, length, 7)).find(|head| head.is_ascii());
        message[place - start..][..HEAD].copy_from_slice(&forged.unwrap());
    }
    let message = String::from_utf8(message).unwrap();
    let (folder, path) = with_message(&message);
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(find(&bytes, message.as_bytes()), start, "the message imitates something");
    let is_whole = |path: &Path, numbers: &[u64]| {
        assert_eq!(open(path).verify(MEMORY, &()).unwrap(), []);
        let history = History::open(path, &OpenOptions::new()).unwrap();
        let told: Vec<u64> = history.commits().map(|commit| commit.unwrap().number).collect();
        assert_eq!(told, numbers);
        assert_eq!(history.commit(2).unwrap().note.message, message);
    };
    is_whole(&path, &[3, 2, 1]);
    let small = folder.path().join("small.autumn");
    compact(&path, &Keep::Last(2), false, Output::create(&small).unwrap(), MEMORY, &()).unwrap();
    is_whole(&small, &[3, 2]);
    // The newest slot is lost: the commit is found behind the one before, whose message is passed over.
    let mut damaged = bytes.clone();
    damaged[SLOTS[0]] ^= 1;
    let tree = Autumnal::from_bytes(damaged.clone()).unwrap();
    assert!(tree.commit().number == 3 && tree.remark().is_some());
    // Both are, and the commit with the message is damaged as well.
    damaged[SLOTS[1]] ^= 1;
    damaged[start] ^= 1;
    std::fs::write(&path, &damaged).unwrap();
    assert!(recover(&path, 2, &()).is_err());
    assert_eq!(recover(&path, 1, &()).unwrap().number, 1);
    assert_eq!(open(&path).verify(MEMORY, &()).unwrap(), []);
}

/// Cells along each axis: as many as have values over more than one extent.
const SIDE: u64 = 16;

/// A file whose second commit has these cells.
fn with_cells(cells: &Cells) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let (path, patch) = (folder.path().join("t.autumn"), folder.path().join("patch.goblin"));
    let one = made(cells.form, cells.size, |cell| (cell == [0; 3]).then_some(Value::ZERO));
    write_cells(&path, &one, &options(Rule::Nearest, Kind::Continuous, cells.depth()));
    std::fs::write(&patch, goblin_bytes(cells, Rule::Nearest, Kind::Continuous)).unwrap();
    let paste = Edit::Paste { patch: Chain::of(&patch), at: Some([0; 3]), where_valid: false };
    edit(&path, [Ok(paste)], Note::default(), MEMORY, &()).unwrap().unwrap();
    (folder, path)
}

/// A commit with a number in which all cells have one value, as an extent that would start at an offset.
fn forged_commit(number: u64, start: u64, metadata: u64, time: i64) -> Vec<u8> {
    let note = (Some(time), String::new(), String::new());
    let root = (1u8, vec![1u8; 16], 0u64);
    let written = (0u64, 0u64, 0u64, 0u64);
    let commit = (number, note, SIDE.pow(3), 0u64, written, number, root, metadata, 0u64, (0u64, 0u64));
    let payload = encoded((1u32, commit));
    [head(1, start, payload.len() as u64, crc32c::crc32c(&payload)), payload].concat()
}

#[test]
fn values_that_imitate_commits_are_values() {
    let form = oct(SampleType::F32, 4);
    let number = |[x, y, z]: [u64; 3], channel: u64| 0.5 + (((z * SIDE + y) * SIDE + x) * 4 + channel) as f32;
    let value = |cell| Value::from([0, 1, 2, 3].map(|channel| number(cell, channel)));
    let cells = made(form, [SIDE; 3], |cell| Some(value(cell)));
    let (_folder, path) = with_cells(&cells);
    let bytes = std::fs::read(&path).unwrap();
    let metadata = extents(&bytes).into_iter().find(|head| bytes[head + 4] == 2).unwrap() as u64;
    // The values of eight siblings are 128 bytes; in some of these runs an extent could start that has room in it.
    let index = |[x, y, z]: [u64; 3]| ((z * SIDE + y) * SIDE + x) as usize;
    let corners = (0..SIDE.pow(3) / 8).map(|i| [i % 8, i / 8 % 8, i / 64].map(|half| 2 * half));
    let siblings = |corner: [u64; 3]| -> Vec<[u64; 3]> {
        (0..8).map(|step| [0, 1, 2].map(|axis| corner[axis] + (step >> axis & 1))).collect()
    };
    let places = corners.filter_map(|corner| {
        let run: Vec<u8> =
            siblings(corner).into_iter().flat_map(|cell| value(cell).to_bytes()[..16].to_vec()).collect();
        let start = find(&bytes, &run);
        let place = start.next_multiple_of(512);
        (place + 90 <= start + run.len()).then_some((place, start, corner, run))
    });
    // (Behind the first imitation everything would stand elsewhere.)
    let (place, start, corner, run) = places.min().unwrap();
    for number in [2, 3] {
        let forged = (0..).find_map(|time| {
            let commit = forged_commit(number, place as u64, metadata, time);
            let mut run = run.clone();
            run[place - start..][..commit.len()].copy_from_slice(&commit);
            // (Bytes that are no numbers would be VOID.)
            run.chunks(4).all(|four| !f32::from_le_bytes(four.try_into().unwrap()).is_nan()).then_some(run)
        });
        let forged = forged.unwrap();
        let mut cells = cells.clone();
        for (cell, bytes) in siblings(corner).into_iter().zip(forged.chunks(16)) {
            cells.cells[index(cell)] = Some(Value::from_bytes(bytes));
        }
        let (_folder, path) = with_cells(&cells);
        let mut bytes = std::fs::read(&path).unwrap();
        assert_eq!(find(&bytes, &forged), start, "the values imitate something");
        let tree = open(&path);
        assert_eq!(tree.verify(MEMORY, &()).unwrap(), []);
        assert_same(&cells_of(&tree, cells.size), &cells, "imitated commits");
        drop(tree);
        // Without the newest slot, and without any.
        bytes[SLOTS[1]] ^= 1;
        let tree = Autumnal::from_bytes(bytes.clone()).unwrap();
        assert_eq!(tree.commit().number, 2);
        assert_same(&cells_of(&tree, cells.size), &cells, "imitated commits, a slot lost");
        bytes[SLOTS[0]] ^= 1;
        // Also if the values are damaged, so that somebody might look for what is left among them.
        let records =
            extents(&bytes).into_iter().rfind(|head| *head < place && bytes[head + 4] == 0).unwrap();
        assert!(records + HEAD + (long(&bytes, records + 16) as usize) > place);
        for is_damaged in [false, true] {
            if is_damaged {
                bytes[records + HEAD] ^= 1;
            }
            std::fs::write(&path, &bytes).unwrap();
            if number == 3 {
                assert!(recover(&path, 3, &()).is_err(), "there is no such commit");
            }
            assert_eq!(recover(&path, 2, &()).unwrap().records, 585);
            if !is_damaged {
                assert_same(&cells_of(&open(&path), cells.size), &cells, "recovered");
            }
        }
    }
}
