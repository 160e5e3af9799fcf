//! External sort of the crossings of chains with rows: in memory while they fit, otherwise in a
//! temporary file.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fs::File;
use std::path::{Path, PathBuf};

use zerocopy::IntoBytes;

use spinney_base::io::platform::{read_exact_at, write_all_at};
use spinney_base::{Error, Result, sort};

/// A change at a cell of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// A chain is crossed: inside and outside are swapped.
    Cross,
    /// Cells of a chain begin here.
    Begin,
    /// Cells of a chain end before this cell.
    End,
}

/// A change in a row, which belongs to a region or line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Crossing {
    pub(super) row: u32,
    pub(super) column: u32,
    /// Index of the region or line in the file.
    pub(super) owner: u64,
    pub(super) change: Change,
    /// Value of its cells, as bits.
    pub(super) class: u64,
}

/// A crossing as sort key: row, column and owner.
type Item = [u64; 3];

impl From<Crossing> for Item {
    fn from(crossing: Crossing) -> Item {
        let change = match crossing.change {
            Change::Cross => 0,
            Change::Begin => 1,
            Change::End => 2,
        };
        let place = u64::from(crossing.row) << 32 | u64::from(crossing.column);
        [place, crossing.owner << 2 | change, crossing.class]
    }
}

impl From<Item> for Crossing {
    fn from([place, owner, class]: Item) -> Crossing {
        let change = [Change::Cross, Change::Begin, Change::End, Change::End][(owner & 3) as usize];
        Crossing { row: (place >> 32) as u32, column: place as u32, owner: owner >> 2, change, class }
    }
}

/// Collects crossings.
pub(super) struct Crossings {
    items: Vec<Item>,
    most: usize,
    /// Sorted runs in the temporary file: offset and number of items.
    runs: Vec<(u64, u64)>,
    end: u64,
    file: Option<File>,
    directory: PathBuf,
}

impl Crossings {
    /// An empty collection that uses `memory` bytes.
    pub(super) fn new(directory: &Path, memory: u64) -> Crossings {
        let most = (memory / size_of::<Item>() as u64).clamp(64, 1 << 40) as usize;
        Crossings {
            items: Vec::new(),
            most,
            runs: Vec::new(),
            end: 0,
            file: None,
            directory: directory.into(),
        }
    }

    /// Adds a crossing.
    ///
    /// # Errors
    /// If the temporary file cannot be written.
    pub(super) fn push(&mut self, crossing: Crossing) -> Result<()> {
        self.items.push(crossing.into());
        if self.items.len() < self.most {
            return Ok(());
        }
        let failed = || Error::io(&self.directory, "write a temporary file in it");
        sort::by(&mut self.items, &mut Ord::cmp);
        if self.file.is_none() {
            self.file = Some(tempfile::tempfile_in(&self.directory).map_err(failed())?);
        }
        if let Some(file) = &self.file {
            write_all_at(file, self.items.as_bytes(), self.end).map_err(failed())?;
        }
        self.runs.push((self.end, self.items.len() as u64));
        self.end += size_of_val(&*self.items) as u64;
        self.items.clear();
        Ok(())
    }

    /// Returns all crossings in order.
    ///
    /// # Errors
    /// If the temporary file cannot be read.
    pub(super) fn sorted(mut self) -> Result<SortedCrossings> {
        sort::by(&mut self.items, &mut Ord::cmp);
        // The last run stays in memory; the read buffers of the others together take as much again.
        let part = (self.most / (self.runs.len() + 1)).clamp(16, 1 << 14);
        let mut runs = vec![RunReader { items: self.items, at: 0, left: (0, 0) }];
        runs.extend(self.runs.into_iter().map(|left| RunReader { items: Vec::new(), at: 0, left }));
        let mut sorted = SortedCrossings {
            runs,
            part,
            heap: BinaryHeap::new(),
            file: self.file,
            directory: self.directory,
        };
        for number in 0..sorted.runs.len() {
            sorted.take_from(number)?;
        }
        Ok(sorted)
    }
}

/// A sorted run, with a prefix of its remaining items in memory.
struct RunReader {
    items: Vec<Item>,
    at: usize,
    /// Offset and number of the items that are still in the file.
    left: (u64, u64),
}

/// Crossings in order, row by row.
pub(super) struct SortedCrossings {
    runs: Vec<RunReader>,
    /// Items of a run that are read at a time.
    part: usize,
    heap: BinaryHeap<Reverse<(Item, usize)>>,
    file: Option<File>,
    directory: PathBuf,
}

impl SortedCrossings {
    /// Returns the next crossing if it is in the given row.
    ///
    /// # Errors
    /// If the temporary file cannot be read.
    pub(super) fn next_in(&mut self, row: u32) -> Result<Option<Crossing>> {
        let Some(Reverse((item, number))) = self.heap.peek().copied() else { return Ok(None) };
        let crossing = Crossing::from(item);
        if crossing.row != row {
            return Ok(None);
        }
        self.heap.pop();
        self.take_from(number)?;
        Ok(Some(crossing))
    }

    /// Pushes the next item of a run onto the heap.
    fn take_from(&mut self, number: usize) -> Result<()> {
        let SortedCrossings { runs, part, heap, file, directory } = self;
        let run = &mut runs[number];
        if run.at == run.items.len()
            && let (Some(file), (offset, left @ 1..)) = (file, run.left)
        {
            let count = left.min(*part as u64);
            run.items.resize(count as usize, Item::default());
            let read = read_exact_at(file, run.items.as_mut_slice().as_mut_bytes(), offset);
            read.map_err(Error::io(&*directory, "read a temporary file in it"))?;
            run.left = (offset + count * size_of::<Item>() as u64, left - count);
            run.at = 0;
        }
        if let Some(item) = run.items.get(run.at) {
            heap.push(Reverse((*item, number)));
            run.at += 1;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crossings_are_sorted_with_any_memory_limit() {
        let mut state = 1u64;
        let mut next = |bound: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % bound
        };
        let mut all: Vec<Crossing> = (0..5000)
            .map(|_| Crossing {
                row: next(40) as u32,
                column: next(1 << 29) as u32,
                owner: next(1 << 40),
                change: [Change::Cross, Change::Begin, Change::End][next(3) as usize],
                class: next(300),
            })
            .collect();
        let directory = tempfile::tempdir().unwrap();
        let sorted = |memory: u64| {
            let mut crossings = Crossings::new(directory.path(), memory);
            all.iter().for_each(|crossing| crossings.push(*crossing).unwrap());
            assert_eq!(crossings.runs.is_empty(), memory > 1 << 20);
            let mut sorted = crossings.sorted().unwrap();
            let mut found = Vec::new();
            for row in 0..40 {
                found.extend(std::iter::from_fn(|| sorted.next_in(row).unwrap()));
            }
            found
        };
        let found = [sorted(0), sorted(1 << 30)];
        all.sort_by_key(|crossing| Item::from(*crossing));
        assert!(found.iter().all(|found| *found == all));
    }
}
