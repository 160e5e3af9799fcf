//! Directories of `PMTiles` archives: sorted entries as columns of varints, gzipped.

use std::io::{Read, Write};

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;

/// An entry of a directory: a run of tiles, or another directory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct DirectoryEntry {
    /// Number of the first tile.
    pub(super) first: u64,
    /// Offset from the first byte of all tiles, or of all leaf directories.
    pub(super) offset: u64,
    pub(super) length: u32,
    /// Number of consecutive tiles; 0 marks a leaf directory.
    pub(super) run: u32,
}

/// Maximum size of a decoded directory in bytes, which also bounds its entries: archives are
/// untrusted.
const MAX_BYTES: u64 = 64 << 20;

/// Encodes a directory, gzipped.
pub(super) fn to_bytes(entries: &[DirectoryEntry]) -> Vec<u8> {
    let mut bytes = Vec::new();
    push(&mut bytes, entries.len() as u64);
    let mut last = 0;
    for entry in entries {
        push(&mut bytes, entry.first - last);
        last = entry.first;
    }
    entries.iter().for_each(|entry| push(&mut bytes, entry.run.into()));
    entries.iter().for_each(|entry| push(&mut bytes, entry.length.into()));
    let mut next = None;
    for entry in entries {
        // 0 means the end of the previous entry.
        push(&mut bytes, if next == Some(entry.offset) { 0 } else { entry.offset + 1 });
        next = Some(entry.offset + u64::from(entry.length));
    }
    gzip(&bytes)
}

/// Decodes a directory, or returns what is wrong with it.
pub(super) fn from_bytes(bytes: &[u8]) -> Result<Vec<DirectoryEntry>, &'static str> {
    let bytes =
        gunzip(bytes, MAX_BYTES).ok_or("a directory that cannot be decompressed, or exceeds 64 MiB")?;
    let mut rest = bytes.as_slice();
    let mut number = || pull(&mut rest).ok_or("a directory that ends too early");
    let count = number()?;
    // Each entry has four numbers of at least one byte.
    if count > bytes.len() as u64 / 4 {
        return Err("a directory with more entries than bytes");
    }
    let mut entries = vec![DirectoryEntry::default(); count as usize];
    let mut first = 0u64;
    for (index, entry) in entries.iter_mut().enumerate() {
        let step = number()?;
        if index > 0 && step == 0 {
            return Err("entries out of order");
        }
        first = first.checked_add(step).ok_or("a tile number that is too large")?;
        entry.first = first;
    }
    for entry in &mut entries {
        entry.run = number()?.try_into().map_err(|_| "a run that is too long")?;
    }
    for entry in &mut entries {
        entry.length = number()?.try_into().map_err(|_| "a tile that is too long")?;
    }
    let mut next: Option<u64> = None;
    for entry in &mut entries {
        entry.offset = match (number()?, next) {
            (0, Some(next)) => next,
            (0, None) => return Err("a first entry without an offset"),
            (offset, _) => offset - 1,
        };
        next = Some(entry.offset.checked_add(entry.length.into()).ok_or("an offset that is too large")?);
    }
    Ok(entries)
}

/// Compresses bytes deterministically.
pub(super) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::new(6));
    let written = encoder.write_all(bytes).and_then(|()| encoder.finish());
    written.expect("writing to memory cannot fail")
}

/// Decompresses bytes, or returns `None` if the result exceeds `most` bytes.
pub(super) fn gunzip(bytes: &[u8], most: u64) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    GzDecoder::new(bytes).take(most + 1).read_to_end(&mut out).ok()?;
    (out.len() as u64 <= most).then_some(out)
}

/// Appends a varint: seven bits per byte, the lowest first.
fn push(bytes: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

fn pull(rest: &mut &[u8]) -> Option<u64> {
    let mut number = 0;
    for shift in (0..64).step_by(7) {
        let (byte, after) = rest.split_first()?;
        *rest = after;
        let bits = u64::from(byte & 0x7f);
        if shift == 63 && bits > 1 {
            return None;
        }
        number |= bits << shift;
        if byte & 0x80 == 0 {
            return Some(number);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directories_survive_a_round_trip() {
        let entries: Vec<_> = (0..1000u64)
            .map(|at| DirectoryEntry {
                first: at * at * 1_000_003,
                offset: if at % 3 == 0 { 0 } else { at * 77 },
                length: (at * 77 % 500) as u32 + 1,
                run: 1 + (at % 5) as u32,
            })
            .collect();
        assert_eq!(from_bytes(&to_bytes(&entries)).as_deref(), Ok(&entries[..]));
        assert_eq!(from_bytes(&to_bytes(&[])).as_deref(), Ok(&[][..]));
    }

    #[test]
    fn malicious_directories_are_rejected() {
        let refused = |numbers: &[u64]| {
            let mut bytes = Vec::new();
            numbers.iter().for_each(|number| push(&mut bytes, *number));
            from_bytes(&gzip(&bytes)).is_err()
        };
        assert!(refused(&[]));
        assert!(refused(&[u64::MAX, 1, 1, 1, 1]));
        // A duplicate tile, a number out of range, a run that is too long, no offset, an offset out
        // of range.
        assert!(refused(&[2, 5, 0, 1, 1, 9, 9, 1, 10]));
        assert!(refused(&[2, u64::MAX, 1, 1, 1, 9, 9, 1, 10]));
        assert!(refused(&[1, 5, 1 << 40, 9, 1]));
        assert!(refused(&[1, 5, 1, 9, 0]));
        assert!(refused(&[1, 5, 1, 9, u64::MAX]));
        assert!(from_bytes(b"no gzip").is_err());
        assert!(from_bytes(&gzip(&vec![0; 80 << 20])).is_err(), "a bomb");
    }
}
