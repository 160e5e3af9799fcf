//! Sorted lists in a file. Entries have a fixed size and begin with a code, the sort key.

use std::borrow::Cow;
use std::path::Path;

use crate::Section;
use spinney_base::io::ReadBackend;
use spinney_base::{Error, Result};

/// A list in a file, used from the mapped file or held in memory.
pub struct List {
    place: (usize, usize),
    entry: usize,
    held: Option<Vec<u8>>,
}

impl List {
    /// Reads the list of a section and verifies its checksum. The list is held in memory if the
    /// file is not mapped.
    ///
    /// # Errors
    /// If it cannot be read, is corrupt, or its length is not a multiple of the entry size.
    pub fn open(
        path: &Path,
        backend: &dyn ReadBackend,
        (section, name): (Section, &str),
        entry: usize,
    ) -> Result<List> {
        if !section.length.is_multiple_of(entry as u64) {
            let found = format!("{} bytes", section.length);
            return Err(Error::corrupt(path, name, found, format!("a multiple of {entry} bytes")));
        }
        let bytes = section.read(path, backend, name)?;
        let held = match bytes {
            Cow::Borrowed(_) => None,
            Cow::Owned(bytes) => Some(bytes),
        };
        Ok(List { place: (section.offset as usize, section.length as usize), entry, held })
    }

    /// Returns whether the list has no entries.
    pub fn is_empty(&self) -> bool {
        self.place.1 == 0
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.place.1 / self.entry
    }

    /// Returns an entry. `None` also if a mapped file was truncated since it was opened.
    #[inline]
    pub fn get<'f>(&'f self, backend: &'f dyn ReadBackend, index: usize) -> Option<&'f [u8]> {
        let bytes = match &self.held {
            Some(held) => &held[..],
            None => backend.bytes()?.get(self.place.0..self.place.0 + self.place.1)?,
        };
        bytes.get(index * self.entry..(index + 1) * self.entry)
    }

    /// The code of an entry; `u64::MAX` if there is no such entry.
    #[inline]
    pub fn code(&self, backend: &dyn ReadBackend, index: usize) -> u64 {
        let code = self.get(backend, index).and_then(|entry| entry.first_chunk());
        code.map_or(u64::MAX, |code| u64::from_le_bytes(*code))
    }

    /// Returns the index of the first entry from `from` on whose code is at least `code`, by binary
    /// search.
    pub fn find(&self, backend: &dyn ReadBackend, from: usize, code: u64) -> usize {
        let (mut low, mut high) = (from, self.len());
        while low < high {
            let middle = (low + high) / 2;
            if self.code(backend, middle) < code { low = middle + 1 } else { high = middle }
        }
        low
    }
}
