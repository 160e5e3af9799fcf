//! Autumnal files constructed as `formats.md` specifies: quadtrees of bytes (rule dominant,
//! categorical) that are invalid only where a test requires it.

use std::path::Path;

use serde::Serialize;
use spinney::{Output, WriteOptions, convert};

use crate::targets::seal::{FIRST_EXTENT, HEAD, HEAD_MAGIC};

/// Offset of the first record.
pub(super) const FIRST: u64 = (FIRST_EXTENT + HEAD) as u64;

pub(super) const LEAF: u8 = 1;
pub(super) const INNER: u8 = 2;
pub(super) const CUT: u8 = 3;

/// A record of a run, as in a segment.
pub(super) type Record = [u8; 8];

/// Returns the record of a node whose children have these states and values.
pub(super) fn record(children: [(u8, u8); 4], skip: u32) -> Record {
    let mut record = [0; 8];
    for (i, (state, value)) in children.into_iter().enumerate() {
        record[i] = value;
        record[4] |= state << (2 * i);
    }
    record[5..].copy_from_slice(&skip.to_le_bytes()[..3]);
    record
}

/// Returns the record of a node with four leaves.
pub(super) fn leaves(values: [u8; 4]) -> Record {
    record(values.map(|value| (LEAF, value)), 1)
}

/// Returns the record of a dense block of a kind, with four INNER children that share one
/// representative.
pub(super) fn dense(kind: u32, value: u8, skip: u32) -> Record {
    record([(INNER, value); 4], skip | kind << 21)
}

/// Returns a record that consists of one run.
pub(super) fn small(representative: u8, run: &[Record]) -> Vec<u8> {
    [&[representative][..], run.as_flattened()].concat()
}

/// A record with pointers.
#[derive(Clone, Debug)]
pub(super) struct Pointered {
    pub(super) representative: u8,
    /// Size of a pointer in bytes.
    pub(super) size: u8,
    pub(super) bitmap: Vec<u8>,
    /// Distances in bytes from this record's start back to those of the records below.
    pub(super) back: Vec<u64>,
    pub(super) run: Vec<Record>,
    pub(super) zone: Vec<u8>,
}

impl Pointered {
    pub(super) fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![self.representative, self.size];
        bytes.extend(&self.bitmap);
        for back in &self.back {
            bytes.extend(back.to_le_bytes().iter().take(usize::from(self.size)));
        }
        [&bytes[..], self.run.as_flattened(), &self.zone].concat()
    }
}

/// Encodes a number as LEB128, as in zones.
pub(super) fn leb128(mut number: u128) -> Vec<u8> {
    let mut bytes = Vec::new();
    while number > 127 {
        bytes.push(number as u8 | 128);
        number >>= 7;
    }
    bytes.push(number as u8);
    bytes
}

/// Returns the zone of a number of INNER nodes and of cells per class.
pub(super) fn zone(records: u128, classes: &[(u8, u128)]) -> Vec<u8> {
    let sum =
        |power: u32| classes.iter().map(|(value, cells)| u128::from(*value).pow(power) * cells).sum::<u128>();
    let mut zone = [leb128(records), leb128(sum(0))].concat();
    zone.extend([classes[0].0, classes[classes.len() - 1].0]);
    // Zigzag numbers; these are not negative.
    zone.extend([leb128(2 * sum(1)), leb128(2 * sum(2)), leb128(classes.len() as u128)].concat());
    for (value, cells) in classes {
        zone.push(*value);
        zone.extend(leb128(*cells));
    }
    zone
}

/// Returns the head of an extent.
pub(super) fn head(kind: u8, start: u64, length: u64, checksum: u32) -> Vec<u8> {
    let mut head = HEAD_MAGIC.to_vec();
    head.extend([kind, 0, 0, 0]);
    head.extend(start.to_le_bytes());
    head.extend(length.to_le_bytes());
    head.extend(checksum.to_le_bytes());
    head.extend(crc32c::crc32c(&head).to_le_bytes());
    head
}

/// Appends an extent with valid checksums and returns its offset.
fn extent(file: &mut Vec<u8>, kind: u8, payload: &[u8]) -> u64 {
    file.resize(file.len().next_multiple_of(512), 0);
    let start = file.len() as u64;
    file.extend(head(kind, start, payload.len() as u64, crc32c::crc32c(payload)));
    file.extend(payload);
    start
}

pub(super) fn encoded(document: impl Serialize) -> Vec<u8> {
    bincode::serde::encode_to_vec(document, bincode::config::standard()).unwrap()
}

/// Claims of a crafted file about its tree, except for the records.
#[derive(Clone, Copy, Debug)]
pub(super) struct Claims {
    pub(super) depth: u8,
    /// Offset of the root's record, and its representative.
    pub(super) root: (u64, u8),
    /// Cells that are not VOID, and INNER nodes.
    pub(super) totals: (u64, u64),
    /// Offset of the previous commit.
    pub(super) previous: u64,
}

/// Returns a file with these records, valid in everything else.
pub(super) fn crafted(records: &[u8], claims: Claims) -> Vec<u8> {
    crafted_after(0, records, claims)
}

/// Returns a file with these records after a hole of `hole` bytes (a multiple of 512).
pub(super) fn crafted_after(hole: usize, records: &[u8], claims: Claims) -> Vec<u8> {
    let Claims { depth, root, totals, previous } = claims;
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    let goblin = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1/classic.goblin");
    convert(&goblin, false, Output::create(&path).unwrap(), WriteOptions::new(1 << 20), &()).unwrap();
    let original = std::fs::read(&path).unwrap();
    // The header page, for a tree of this depth.
    let mut file = original[..FIRST_EXTENT].to_vec();
    file[4096..].fill(0);
    file[14] = depth;
    let checksum = crc32c::crc32c(&file[..20]);
    file[20..24].copy_from_slice(&checksum.to_le_bytes());
    // No sharing, runs of five levels.
    file[64..68].copy_from_slice(&[0, 5, 0, 0]);
    let checksum = crc32c::crc32c(&file[64..68]);
    file[68..72].copy_from_slice(&checksum.to_le_bytes());
    file.resize(file.len() + hole, 0);
    extent(&mut file, 0, records);
    // The metadata's extent is the one with kind 2.
    let is_metadata = |at: &usize| original[*at..].starts_with(b"Extt\x02");
    let at = (FIRST_EXTENT..original.len()).step_by(512).find(is_metadata).unwrap();
    let length = u64::from_le_bytes(original[at + 16..at + 24].try_into().unwrap()) as usize;
    let metadata = extent(&mut file, 2, &original[at + HEAD..][..length]);
    let note = (None::<i64>, String::new(), String::new());
    let written = (0u64, 0u64, 0u64, 0u64);
    let root = (INNER, vec![root.1], root.0);
    // Bytes of one channel, rule dominant, categorical; h = 8, s = 2, T = 4096.
    let mut header = vec![0, 1, 2, 0, 0, depth, 8, 2, 0, 16, 0, 0];
    header.extend([0; 12]);
    [1 << depth, 1 << depth, 1u64].iter().for_each(|cells| header.extend(cells.to_le_bytes()));
    let layers = vec![(String::new(), totals.0, totals.1, header, root, metadata)];
    let commit = (1u64, note, totals.0, totals.1, written, 1u64, layers, previous, (0u64, 0u64));
    let commit = extent(&mut file, 1, &encoded((1u32, commit)));
    let end = file.len() as u64;
    let mut slot = b"AutuMeta".to_vec();
    for number in [1, commit, end] {
        slot.extend(number.to_le_bytes());
    }
    slot.extend([0; 4]);
    slot.extend(crc32c::crc32c(&slot).to_le_bytes());
    file[4096..4136].copy_from_slice(&slot);
    file
}
