//! Rows of tables, of which those with the same key are summed: in memory, or in sorted runs in a
//! temporary file.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fs::File;
use std::path::{Path, PathBuf};

use spinney_base::io::platform::{read_exact_at, write_all_at};
use spinney_base::{Error, Result, sort};
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Number of rows that are collected before rows with the same key are merged for the first time.
const MIN_MERGED: usize = 1 << 14;

/// Minimum and maximum number of bytes that are read of a run at a time.
const CHUNK_BYTES: [u64; 2] = [1 << 12, 1 << 18];

/// Bytes per row for sorting, in addition to its own.
const SORTING: u64 = 40;

/// Row: numbers without padding, which are written to the file unchanged.
pub(super) trait Row: Copy + FromBytes + IntoBytes + Immutable {
    fn key(&self) -> u128;

    /// Adds a row with the same key. (In any order: sums, extremes.)
    fn add(&mut self, other: &Self);
}

/// Rows in any order.
pub(super) struct Rows<R> {
    directory: PathBuf,
    rows: Vec<R>,
    /// Number of rows at which rows with the same key are merged, and the maximum number in memory.
    limit: usize,
    most: usize,
    memory: u64,
    file: Option<File>,
    /// End of each run in the file, in rows.
    ends: Vec<u64>,
}

impl<R: Row> Rows<R> {
    /// Table that may use about `memory` bytes; the temporary file is created in `directory`.
    pub(super) fn new(directory: &Path, memory: u64) -> Rows<R> {
        let most = (memory / (size_of::<R>() as u64 + SORTING)).clamp(64, 1 << 31) as usize;
        Rows {
            directory: directory.into(),
            rows: Vec::new(),
            limit: MIN_MERGED.min(most),
            most,
            memory,
            file: None,
            ends: Vec::new(),
        }
    }

    /// Adds a row.
    ///
    /// # Errors
    /// If the temporary file cannot be written.
    pub(super) fn push(&mut self, row: R) -> Result<()> {
        if self.rows.len() >= self.limit {
            self.compact();
            if self.rows.len() > self.most / 2 {
                self.spill()?;
            }
            self.limit = (2 * self.rows.len()).clamp(MIN_MERGED.min(self.most), self.most);
        }
        self.rows.push(row);
        Ok(())
    }

    /// Sorts the rows in memory, and merges those with the same key.
    fn compact(&mut self) {
        sort::by_wide_key(&mut self.rows, Row::key);
        self.rows.dedup_by(|row, before| {
            let is_same = row.key() == before.key();
            if is_same {
                before.add(row);
            }
            is_same
        });
    }

    fn spill(&mut self) -> Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(
                tempfile::tempfile_in(&self.directory)
                    .map_err(Error::io(&self.directory, "make a temporary file"))?,
            ),
        };
        let first = self.ends.last().copied().unwrap_or(0);
        write_all_at(file, self.rows.as_bytes(), first * size_of::<R>() as u64)
            .map_err(Error::io(&self.directory, "write a temporary file"))?;
        self.ends.push(first + self.rows.len() as u64);
        self.rows.clear();
        Ok(())
    }

    /// All rows in key order, each key once.
    ///
    /// # Errors
    /// If the temporary file cannot be written or read.
    pub(super) fn sorted(mut self) -> Result<SortedRows<R>> {
        self.compact();
        let Some(file) = self.file.take() else {
            let in_memory = RowCursor { rows: self.rows, next: 0, left: 0..0 };
            return SortedRows::of(None, self.directory, vec![in_memory], 0);
        };
        let (directory, memory) = (self.directory.clone(), self.memory);
        let in_memory = RowCursor { rows: std::mem::take(&mut self.rows), next: 0, left: 0..0 };
        let mut first = 0;
        let in_file = self.ends.iter().map(|end| {
            let left = std::mem::replace(&mut first, *end)..*end;
            RowCursor { rows: Vec::new(), next: 0, left }
        });
        let runs: Vec<RowCursor<R>> = in_file.chain([in_memory]).collect();
        let chunk = (memory / 2 / runs.len() as u64).clamp(CHUNK_BYTES[0], CHUNK_BYTES[1]);
        SortedRows::of(Some(file), directory, runs, chunk / size_of::<R>() as u64 + 1)
    }
}

/// Sorted rows: some that are in memory, and those in the file that follow.
struct RowCursor<R> {
    rows: Vec<R>,
    next: usize,
    left: std::ops::Range<u64>,
}

/// Rows in key order.
pub(super) struct SortedRows<R> {
    file: Option<File>,
    directory: PathBuf,
    runs: Vec<RowCursor<R>>,
    /// Number of rows that are read of a run at a time.
    chunk: u64,
    /// Key of the next row of each run that has one.
    heap: BinaryHeap<Reverse<(u128, usize)>>,
}

impl<R: Row> SortedRows<R> {
    fn of(
        file: Option<File>,
        directory: PathBuf,
        runs: Vec<RowCursor<R>>,
        chunk: u64,
    ) -> Result<SortedRows<R>> {
        let mut sorted = SortedRows { file, directory, runs, chunk, heap: BinaryHeap::new() };
        for number in 0..sorted.runs.len() {
            sorted.queue(number)?;
        }
        Ok(sorted)
    }

    /// Pushes the next row of a run onto the heap, if it has one.
    fn queue(&mut self, number: usize) -> Result<()> {
        let run = &mut self.runs[number];
        if run.next >= run.rows.len() {
            let Some(file) = self.file.as_ref().filter(|_| !run.left.is_empty()) else { return Ok(()) };
            let count = self.chunk.min(run.left.end - run.left.start);
            run.rows.resize(count as usize, R::new_zeroed());
            read_exact_at(file, run.rows.as_mut_bytes(), run.left.start * size_of::<R>() as u64)
                .map_err(Error::io(&self.directory, "read a temporary file"))?;
            run.next = 0;
            run.left.start += count;
        }
        self.heap.push(Reverse((run.rows[run.next].key(), number)));
        Ok(())
    }

    /// Key of the next row.
    pub(super) fn peek(&self) -> Option<u128> {
        self.heap.peek().map(|Reverse((key, _))| *key)
    }

    /// Next row.
    ///
    /// # Errors
    /// If the temporary file cannot be read.
    pub(super) fn next(&mut self) -> Result<Option<R>> {
        let mut found: Option<(u128, R)> = None;
        while let Some(Reverse((key, number))) = self.heap.peek().copied() {
            if found.as_ref().is_some_and(|(own, _)| *own != key) {
                break;
            }
            self.heap.pop();
            let run = &mut self.runs[number];
            let row = run.rows[run.next];
            run.next += 1;
            match &mut found {
                Some((_, all)) => all.add(&row),
                None => found = Some((key, row)),
            }
            self.queue(number)?;
        }
        Ok(found.map(|(_, row)| row))
    }
}
