//! External sort of items that need not fit into memory.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// Collects items of one size, each with a key, and returns them in the order of their keys. The
/// sort is stable.
///
/// Items beyond the memory limit go to temporary files in sorted runs, which are merged at the end.
pub struct Sorter {
    directory: PathBuf,
    item_size: usize,
    /// Maximum number of items in memory.
    most: usize,
    items: Vec<(u64, Vec<u8>)>,
    runs: Vec<SortedFile>,
    len: u64,
}

struct SortedFile {
    file: tempfile::SpooledTempFile,
    items: u64,
}

impl Sorter {
    /// Sorts items of `item_size` bytes with about `memory` bytes of memory, and temporary files in
    /// `directory`.
    pub fn new(directory: &Path, item_size: usize, memory: u64) -> Sorter {
        let most = (memory / (item_size as u64 + 48)).max(64) as usize;
        Sorter {
            directory: directory.to_path_buf(),
            item_size,
            most,
            items: Vec::new(),
            runs: Vec::new(),
            len: 0,
        }
    }

    /// Adds an item.
    ///
    /// # Errors
    /// If the temporary file cannot be written.
    pub fn push(&mut self, key: u64, item: Vec<u8>) -> Result<()> {
        debug_assert_eq!(item.len(), self.item_size);
        self.items.push((key, item));
        self.len += 1;
        if self.items.len() < self.most {
            return Ok(());
        }
        self.spill().map_err(Error::io(&self.directory, "use a temporary file"))
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
        self.items.sort_by_key(|(key, _)| *key);
        let mut out = BufWriter::new(tempfile::spooled_tempfile_in(0, &self.directory));
        for (key, item) in &self.items {
            out.write_all(&key.to_le_bytes())?;
            out.write_all(item)?;
        }
        let mut file = out.into_inner().map_err(|error| error.into_error())?;
        file.seek(SeekFrom::Start(0))?;
        self.runs.push(SortedFile { file, items: self.items.len() as u64 });
        self.items.clear();
        Ok(())
    }

    /// Passes all items to a function, in order.
    ///
    /// # Errors
    /// Those of the function; also if a temporary file cannot be read.
    pub fn finish(mut self, item: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let spill_error = || Error::io(&self.directory, "use a temporary file");
        self.items.sort_by_key(|(key, _)| *key);
        let mut last = self.items.into_iter().peekable();
        let mut runs: Vec<_> =
            self.runs.into_iter().map(|run| (BufReader::new(run.file), run.items)).collect();
        let read = |(file, left): &mut (BufReader<_>, u64)| -> io::Result<Option<(u64, Vec<u8>)>> {
            if *left == 0 {
                return Ok(None);
            }
            *left -= 1;
            let (mut key, mut item) = ([0; 8], vec![0; self.item_size]);
            Read::read_exact(file, &mut key)?;
            Read::read_exact(file, &mut item)?;
            Ok(Some((u64::from_le_bytes(key), item)))
        };
        // Merges all runs: the heap has the next item of each run on disk, and the items in memory
        // are the last run.
        let mut heap = BinaryHeap::new();
        for (number, run) in runs.iter_mut().enumerate() {
            heap.extend(read(run).map_err(spill_error())?.map(|(key, bytes)| Reverse((key, number, bytes))));
        }
        while let Some(Reverse((key, number, bytes))) = heap.pop() {
            while let Some((_, bytes)) = last.next_if(|(other, _)| *other < key) {
                item(&bytes)?;
            }
            item(&bytes)?;
            let next = read(&mut runs[number]).map_err(spill_error())?;
            heap.extend(next.map(|(key, bytes)| Reverse((key, number, bytes))));
        }
        last.try_for_each(|(_, bytes)| item(&bytes))
    }
}
