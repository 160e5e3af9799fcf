//! Deduplication: finds equal records among those that a writer has written so far.

use std::fs::File;
use std::path::{Path, PathBuf};

use smallvec::SmallVec;
use spinney_base::io::platform::{read_exact_at, write_all_at};
use spinney_base::{Error, Result};
use zerocopy::IntoBytes;

/// The records that one writer has written, by hash: an open-addressing hash table that moves to a
/// temporary file when it outgrows its memory. Matches are only likely: the caller compares the
/// records.
///
/// Invariant: no entry is evicted, and whether one is inserted depends on the records alone (at
/// most [`ALIKE`] per hash). The set of shared records, and hence the file's bytes, must not depend
/// on the memory limit.
pub(super) struct DedupTable {
    slots: Slots,
    /// Base-2 logarithm of the slot count.
    bits: u32,
    count: u64,
    /// Memory limit in bytes.
    memory: u64,
    /// Directory of the temporary file.
    directory: PathBuf,
}

/// 64 bits of a hash and its value; a value of 0 marks a free slot.
type Slot = [u64; 2];

/// Storage of the slots.
enum Slots {
    Memory(Vec<Slot>),
    Spooled(File),
}

/// Slots per read.
const TOGETHER: usize = 8;

/// Maximum number of records per hash; further ones are never found, so they are written each time.
/// Only deliberate collisions produce even two. The limit bounds the records to compare.
const ALIKE: usize = 4;

/// Initial base-2 logarithm of the slot count.
const FIRST_BITS: u32 = 10;

impl DedupTable {
    /// Creates a table that holds at most `memory` bytes; a larger one moves to a temporary file in
    /// `directory`.
    pub(super) fn new(memory: u64, directory: &Path) -> DedupTable {
        let slots = Slots::Memory(vec![[0; 2]; 1 << FIRST_BITS]);
        DedupTable { slots, bits: FIRST_BITS, count: 0, memory, directory: directory.to_path_buf() }
    }

    /// Returns the candidates for a hash.
    pub(super) fn find(&self, hash: u128) -> Result<SmallVec<[u64; 1]>> {
        self.probe(tag(hash)).map(|(found, _)| found)
    }

    /// Adds a nonzero value for a hash.
    pub(super) fn insert(&mut self, hash: u128, known: u64) -> Result<()> {
        debug_assert!(known != 0);
        if 2 * (self.count + 1) > 1 << self.bits {
            self.grow()?;
        }
        let (found, free) = self.probe(tag(hash))?;
        if found.len() < ALIKE {
            self.put(free, [tag(hash), known])?;
            self.count += 1;
        }
        Ok(())
    }

    /// Returns the values of a tag and the first free slot after them.
    fn probe(&self, tag: u64) -> Result<(SmallVec<[u64; 1]>, u64)> {
        let slots = 1u64 << self.bits;
        let mut found = SmallVec::new();
        let mut at = tag >> (64 - self.bits);
        // (Half of the slots are free, so the loop ends.)
        loop {
            let mut group = [[0; 2]; TOGETHER];
            let group = &mut group[..(slots - at).min(TOGETHER as u64) as usize];
            self.read(at, group)?;
            for (slot, [other, known]) in (at..).zip(group.iter()) {
                match known {
                    0 => return Ok((found, slot)),
                    known if *other == tag => found.push(*known),
                    _ => {}
                }
            }
            at = (at + group.len() as u64) % slots;
        }
    }

    fn read(&self, first: u64, into: &mut [Slot]) -> Result<()> {
        match &self.slots {
            Slots::Memory(slots) => into.copy_from_slice(&slots[first as usize..][..into.len()]),
            Slots::Spooled(file) => {
                read_exact_at(file, into.as_mut_bytes(), first * size_of::<Slot>() as u64)
                    .map_err(Error::io(&*self.directory, "read a temporary file"))?
            }
        }
        Ok(())
    }

    fn put(&mut self, place: u64, slot: Slot) -> Result<()> {
        match &mut self.slots {
            Slots::Memory(slots) => slots[place as usize] = slot,
            Slots::Spooled(file) => write_all_at(file, slot.as_bytes(), place * size_of::<Slot>() as u64)
                .map_err(Error::io(&*self.directory, "write a temporary file"))?,
        }
        Ok(())
    }

    /// Doubles the slot count.
    fn grow(&mut self) -> Result<()> {
        let bits = self.bits + 1;
        let bytes = (size_of::<Slot>() as u64) << bits;
        // (The old slots exist until the new table is filled.)
        let slots = if bytes + bytes / 2 <= self.memory {
            Slots::Memory(vec![[0; 2]; 1 << bits])
        } else {
            let failed = || Error::io(&*self.directory, "make a temporary file");
            let file = tempfile::tempfile_in(&self.directory).map_err(failed())?;
            file.set_len(bytes).map_err(failed())?;
            Slots::Spooled(file)
        };
        let directory = self.directory.clone();
        let mut larger = DedupTable { slots, bits, count: self.count, memory: self.memory, directory };
        let mut group = vec![[0; 2]; 1 << FIRST_BITS];
        for first in (0..1u64 << self.bits).step_by(group.len()) {
            self.read(first, &mut group)?;
            for slot in group.iter().filter(|slot| slot[1] != 0) {
                let (_, free) = larger.probe(slot[0])?;
                larger.put(free, *slot)?;
            }
        }
        *self = larger;
        Ok(())
    }
}

/// Returns the stored bits of a hash. The first of them select the slot.
fn tag(hash: u128) -> u64 {
    (hash >> 64) as u64
}

/// Returns the hash of a record's content.
pub(super) fn hash(content: &[u8]) -> u128 {
    xxhash_rust::xxh3::xxh3_128(content)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All entries are found with little memory and with much, and nothing else is.
    #[test]
    fn nothing_is_forgotten() {
        let directory = tempfile::tempdir().unwrap();
        for memory in [0, 1 << 16, 1 << 30] {
            let mut table = DedupTable::new(memory, directory.path());
            for known in 1..=3000u64 {
                assert!(table.find(hash(&known.to_le_bytes())).unwrap().is_empty());
                table.insert(hash(&known.to_le_bytes()), known).unwrap();
            }
            assert_eq!(matches!(table.slots, Slots::Spooled(_)), memory < 1 << 20);
            for known in 1..=3000u64 {
                assert_eq!(table.find(hash(&known.to_le_bytes())).unwrap()[..], [known]);
            }
            assert!(table.find(hash(b"nothing")).unwrap().is_empty());
        }
    }

    /// Equal hashes, and probe sequences that wrap around the end of the table.
    #[test]
    fn equal_hashes_are_kept_in_consecutive_slots() {
        let mut table = DedupTable::new(0, Path::new("."));
        (1..=10).for_each(|known| table.insert(u128::MAX, known).unwrap());
        table.insert(u128::MAX - (1 << 64), 11).unwrap();
        assert_eq!(table.find(u128::MAX).unwrap()[..], [1, 2, 3, 4]);
        assert_eq!(table.find(u128::MAX - (1 << 64)).unwrap()[..], [11]);
    }
}
