//! Lists of entries of one size in a file, sorted by a code that each begins with.

use std::borrow::Cow;
use std::path::Path;

use crate::Section;
use spinney_base::io::ReadBackend;
use spinney_base::{Error, Result};

/// A list of a file: where it is mapped, or held.
pub struct List {
    place: (usize, usize),
    entry: usize,
    held: Option<Vec<u8>>,
}

impl List {
    /// The list of a section, with the right checksum; it is held where the file is not mapped.
    ///
    /// # Errors
    /// If it cannot be read, is damaged, or has other bytes than whole entries.
    pub fn open(
        path: &Path,
        backend: &dyn ReadBackend,
        (section, name): (Section, &str),
        entry: usize,
    ) -> Result<List> {
        if !section.length.is_multiple_of(entry as u64) {
            let found = format!("{} bytes", section.length);
            return Err(Error::corrupt(path, name, found, format!("entries of {entry} bytes")));
        }
        let bytes = section.read(path, backend, name)?;
        let held = match bytes {
            Cow::Borrowed(_) => None,
            Cow::Owned(bytes) => Some(bytes),
        };
        Ok(List { place: (section.offset as usize, section.length as usize), entry, held })
    }

    /// Whether it has no entry.
    pub fn is_empty(&self) -> bool {
        self.place.1 == 0
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.place.1 / self.entry
    }

    /// An entry. (A mapped file that was cut short since gives none.)
    #[inline]
    pub fn get<'f>(&'f self, backend: &'f dyn ReadBackend, index: usize) -> Option<&'f [u8]> {
        let bytes = match &self.held {
            Some(held) => &held[..],
            None => backend.bytes()?.get(self.place.0..self.place.0 + self.place.1)?,
        };
        bytes.get(index * self.entry..(index + 1) * self.entry)
    }

    /// The code of an entry; the greatest number if there is none.
    #[inline]
    pub fn code(&self, backend: &dyn ReadBackend, index: usize) -> u64 {
        let code = self.get(backend, index).and_then(|entry| entry.first_chunk());
        code.map_or(u64::MAX, |code| u64::from_le_bytes(*code))
    }

    /// The first entry from one on whose code is not below a number.
    pub fn find(&self, backend: &dyn ReadBackend, from: usize, code: u64) -> usize {
        let (mut low, mut high) = (from, self.len());
        while low < high {
            let middle = (low + high) / 2;
            if self.code(backend, middle) < code { low = middle + 1 } else { high = middle }
        }
        low
    }
}
