//! External sort of items that need not fit into memory.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::{Error, Result, sort};

/// Collects items of any size, each with a key, and returns them in the order of their keys. The
/// sort is stable.
///
/// Items beyond the memory limit go to temporary files in sorted runs, which are merged at the end.
pub struct Sorter {
    directory: PathBuf,
    memory: usize,
    /// Bytes of the items in memory.
    bytes: Vec<u8>,
    /// For each item in memory: key, start and length in `bytes`, from the highest bits on. In this
    /// order, items with equal keys stay in the order in which they were added.
    items: Vec<u128>,
    runs: Vec<SortedFile>,
    len: u64,
}

/// Length of an item's key and length in a temporary file.
const HEAD: usize = 12;
/// Memory of an item besides its bytes.
const ITEM: usize = size_of::<u128>();
/// Minimum memory: some items of common sizes.
const MIN_MEMORY: u64 = 4096;

struct SortedFile {
    file: tempfile::SpooledTempFile,
    items: u64,
}

impl Sorter {
    /// Sorts items with about `memory` bytes of memory, and temporary files in `directory`.
    pub fn new(directory: &Path, memory: u64) -> Sorter {
        // (Starts and lengths of items have 32 bits.)
        let memory = memory.clamp(MIN_MEMORY, u32::MAX.into()) as usize;
        let directory = directory.to_path_buf();
        Sorter { directory, memory, bytes: Vec::new(), items: Vec::new(), runs: Vec::new(), len: 0 }
    }

    /// Adds an item.
    ///
    /// # Errors
    /// If the temporary file cannot be written.
    pub fn push(&mut self, key: u64, item: &[u8]) -> Result<()> {
        let is_full = self.bytes.len() + item.len() + (self.items.len() + 1) * ITEM > self.memory;
        if is_full && !self.items.is_empty() {
            self.spill().map_err(Error::io(&self.directory, "use a temporary file"))?;
        }
        let (start, length) = (self.bytes.len() as u128, item.len() as u128);
        self.items.push(u128::from(key) << 64 | start << 32 | length);
        self.bytes.extend_from_slice(item);
        self.len += 1;
        Ok(())
    }

    /// Returns the number of items.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Whether there are no items.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    fn spill(&mut self) -> io::Result<()> {
        sort::numbers128(&mut self.items);
        let mut out = BufWriter::new(tempfile::spooled_tempfile_in(0, &self.directory));
        for &item in &self.items {
            let bytes = bytes_of(item, &self.bytes);
            out.write_all(&key_of(item).to_le_bytes())?;
            out.write_all(&(bytes.len() as u32).to_le_bytes())?;
            out.write_all(bytes)?;
        }
        let mut file = out.into_inner().map_err(|error| error.into_error())?;
        file.seek(SeekFrom::Start(0))?;
        self.runs.push(SortedFile { file, items: self.items.len() as u64 });
        self.items.clear();
        self.bytes.clear();
        Ok(())
    }

    /// Passes all items to a function, in order.
    ///
    /// # Errors
    /// Those of the function; also if a temporary file cannot be read.
    pub fn finish(mut self, each: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let spill_error = || Error::io(&self.directory, "use a temporary file");
        sort::numbers128(&mut self.items);
        let mut last = self.items.into_iter().peekable();
        let mut runs: Vec<SortedFileReader> = self.runs.into_iter().map(SortedFileReader::new).collect();
        // Merges all runs: the heap has the next key of each run on disk, and the items in memory
        // are the last run.
        let mut heap = BinaryHeap::new();
        for (number, run) in runs.iter_mut().enumerate() {
            heap.extend(run.next().map_err(spill_error())?.map(|key| Reverse((key, number))));
        }
        while let Some(Reverse((key, number))) = heap.pop() {
            while let Some(item) = last.next_if(|item| key_of(*item) < key) {
                each(bytes_of(item, &self.bytes))?;
            }
            each(&runs[number].item)?;
            let next = runs[number].next().map_err(spill_error())?;
            heap.extend(next.map(|key| Reverse((key, number))));
        }
        last.try_for_each(|item| each(bytes_of(item, &self.bytes)))
    }
}

fn key_of(item: u128) -> u64 {
    (item >> 64) as u64
}

/// Returns the bytes of an item in memory.
fn bytes_of(item: u128, bytes: &[u8]) -> &[u8] {
    let (start, length) = ((item >> 32) as u32 as usize, item as u32 as usize);
    &bytes[start..start + length]
}

/// A sorted run that is read, and its current item.
struct SortedFileReader {
    file: BufReader<tempfile::SpooledTempFile>,
    left: u64,
    item: Vec<u8>,
}

impl SortedFileReader {
    fn new(SortedFile { file, items }: SortedFile) -> SortedFileReader {
        SortedFileReader { file: BufReader::new(file), left: items, item: Vec::new() }
    }

    /// Reads the next item; returns its key, or `None` at the end.
    fn next(&mut self) -> io::Result<Option<u64>> {
        if self.left == 0 {
            return Ok(None);
        }
        self.left -= 1;
        let mut head = [0; HEAD];
        self.file.read_exact(&mut head)?;
        let (key, length) = head.split_at(8);
        let length = u32::from_le_bytes(length.try_into().expect("four bytes"));
        self.item.resize(length as usize, 0);
        self.file.read_exact(&mut self.item)?;
        Ok(Some(u64::from_le_bytes(key.try_into().expect("eight bytes"))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_sorted_stably_for_any_memory() {
        let directory = tempfile::tempdir().unwrap();
        for memory in [0, 6000, 1 << 20] {
            let mut sorter = Sorter::new(directory.path(), memory);
            let key = |number: u64| number.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56;
            let item = |number: u64| [number.to_le_bytes().to_vec(), vec![7; number as usize % 300]].concat();
            (0..2000).try_for_each(|number| sorter.push(key(number), &item(number))).unwrap();
            assert_eq!(sorter.len(), 2000);
            let mut wanted: Vec<u64> = (0..2000).collect();
            wanted.sort_by_key(|number| key(*number));
            let mut found = Vec::new();
            let each = &mut |item: &[u8]| {
                found.push(item.to_vec());
                Ok(())
            };
            sorter.finish(each).unwrap();
            assert!(found == wanted.into_iter().map(item).collect::<Vec<_>>());
        }
    }
}
