//! Deduplication: finds records that are in the file already.

use std::fs::File;
use std::path::{Path, PathBuf};

use smallvec::SmallVec;
use spinney_base::io::platform::{read_exact_at, write_all_at};
use spinney_base::{Error, Result};
use zerocopy::IntoBytes;

/// All records that were written, by 128-bit hashes: an open hash table, which moves to a temporary file where it outgrows its
/// memory. What it finds is only likely to be the same: the caller compares.
///
/// Invariant: nothing is forgotten, so that which records are shared, and with them the file's bytes, do not depend on the
/// memory.
pub(super) struct DedupTable {
    slots: Slots,
    /// Logarithm of the number of slots.
    bits: u32,
    count: u64,
    /// Bytes that may be held in memory.
    memory: u64,
    /// Of the temporary file.
    folder: PathBuf,
}

/// 64 bits of a hash, and what is known by it; 0 is nothing.
type Slot = [u64; 2];

/// Where the slots are.
enum Slots {
    Memory(Vec<Slot>),
    Spooled(File),
}

/// Slots that are looked at together.
const TOGETHER: usize = 8;

/// Records of one hash that are known at most: there are no two unless somebody made them so.
const ALIKE: usize = 4;

/// Logarithm of the number of slots at the beginning.
const FIRST_BITS: u32 = 10;

impl DedupTable {
    /// A table that holds at most so many bytes in memory; what is more goes to a temporary file in a folder.
    pub(super) fn new(memory: u64, folder: &Path) -> DedupTable {
        let slots = Slots::Memory(vec![[0; 2]; 1 << FIRST_BITS]);
        DedupTable { slots, bits: FIRST_BITS, count: 0, memory, folder: folder.to_path_buf() }
    }

    /// Finds what may be known by a hash.
    pub(super) fn find(&self, hash: u128) -> Result<SmallVec<[u64; 1]>> {
        self.look_up(tag(hash)).map(|(found, _)| found)
    }

    /// Remembers something that is not 0 by a hash.
    pub(super) fn insert(&mut self, hash: u128, known: u64) -> Result<()> {
        debug_assert!(known != 0);
        if 2 * (self.count + 1) > 1 << self.bits {
            self.grow()?;
        }
        let (found, free) = self.look_up(tag(hash))?;
        if found.len() < ALIKE {
            self.put(free, [tag(hash), known])?;
            self.count += 1;
        }
        Ok(())
    }

    /// What is known by a tag, and the first free slot behind it.
    fn look_up(&self, tag: u64) -> Result<(SmallVec<[u64; 1]>, u64)> {
        let slots = 1u64 << self.bits;
        let mut found = SmallVec::new();
        let mut at = tag >> (64 - self.bits);
        // (Half of the slots are free.)
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
                    .map_err(Error::io(&*self.folder, "read a temporary file"))?
            }
        }
        Ok(())
    }

    fn put(&mut self, place: u64, slot: Slot) -> Result<()> {
        match &mut self.slots {
            Slots::Memory(slots) => slots[place as usize] = slot,
            Slots::Spooled(file) => write_all_at(file, slot.as_bytes(), place * size_of::<Slot>() as u64)
                .map_err(Error::io(&*self.folder, "write a temporary file"))?,
        }
        Ok(())
    }

    /// Goes over to twice as many slots.
    fn grow(&mut self) -> Result<()> {
        let bits = self.bits + 1;
        let bytes = (size_of::<Slot>() as u64) << bits;
        // (While it grows there are the old slots, too.)
        let slots = if bytes + bytes / 2 <= self.memory {
            Slots::Memory(vec![[0; 2]; 1 << bits])
        } else {
            let failed = || Error::io(&*self.folder, "make a temporary file");
            let file = tempfile::tempfile_in(&self.folder).map_err(failed())?;
            file.set_len(bytes).map_err(failed())?;
            Slots::Spooled(file)
        };
        let folder = self.folder.clone();
        let mut larger = DedupTable { slots, bits, count: self.count, memory: self.memory, folder };
        let mut group = vec![[0; 2]; 1 << FIRST_BITS];
        for first in (0..1u64 << self.bits).step_by(group.len()) {
            self.read(first, &mut group)?;
            for slot in group.iter().filter(|slot| slot[1] != 0) {
                let (_, free) = larger.look_up(slot[0])?;
                larger.put(free, *slot)?;
            }
        }
        *self = larger;
        Ok(())
    }
}

/// The bits of a hash that are kept; the first of them tell the slot.
fn tag(hash: u128) -> u64 {
    (hash >> 64) as u64
}

/// The hash of a record's content.
pub(super) fn hash(content: &[u8]) -> u128 {
    xxhash_rust::xxh3::xxh3_128(content)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With little memory as with much, all that was remembered is found, and nothing else.
    #[test]
    fn nothing_is_forgotten() {
        let folder = tempfile::tempdir().unwrap();
        for memory in [0, 1 << 16, 1 << 30] {
            let mut table = DedupTable::new(memory, folder.path());
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

    /// Hashes that are equal, and slots that begin at the end of the table.
    #[test]
    fn equal_hashes_are_kept_beside_each_other() {
        let mut table = DedupTable::new(0, Path::new("."));
        (1..=10).for_each(|known| table.insert(u128::MAX, known).unwrap());
        table.insert(u128::MAX - (1 << 64), 11).unwrap();
        assert_eq!(table.find(u128::MAX).unwrap()[..], [1, 2, 3, 4]);
        assert_eq!(table.find(u128::MAX - (1 << 64)).unwrap()[..], [11]);
    }
}
