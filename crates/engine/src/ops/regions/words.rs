//! Lists of numbers that are paged to a temporary file if they exceed a memory limit.

use std::fs::File;
use std::path::{Path, PathBuf};

use spinney_base::io::platform::{read_exact_at, write_all_at};
use spinney_base::{Error, Result};
use zerocopy::IntoBytes;

/// Numbers per page.
const PAGE: u64 = 8192;

/// List of numbers in pages, of which a limited number is in memory and all others in an unnamed
/// temporary file.
pub(super) struct Words {
    directory: PathBuf,
    file: Option<File>,
    pages: Vec<Page>,
    /// Number of pages in memory, and their maximum.
    held: usize,
    most: usize,
    /// Clock hand: where the search for the next page to evict starts.
    hand: usize,
    len: u64,
}

#[derive(Default)]
struct Page {
    words: Option<Box<[u64]>>,
    is_changed: bool,
    is_used: bool,
}

impl Words {
    /// Empty list that may use about `memory` bytes; the temporary file is created in `directory`.
    pub(super) fn new(directory: &Path, memory: u64) -> Words {
        let most = (memory / (8 * PAGE)).max(4) as usize;
        Words { directory: directory.into(), file: None, pages: Vec::new(), held: 0, most, hand: 0, len: 0 }
    }

    pub(super) fn len(&self) -> u64 {
        self.len
    }

    /// Appends a number.
    ///
    /// # Errors
    /// If the temporary file cannot be written.
    pub(super) fn push(&mut self, word: u64) -> Result<()> {
        if self.len.is_multiple_of(PAGE) {
            self.evict_pages()?;
            let words = Some(vec![0; PAGE as usize].into());
            self.pages.push(Page { words, is_changed: true, is_used: true });
            self.held += 1;
        }
        self.len += 1;
        self.set(self.len - 1, word)
    }

    /// Number at an index, which must exist.
    ///
    /// # Errors
    /// If the temporary file cannot be read or written.
    #[inline]
    pub(super) fn get(&mut self, at: u64) -> Result<u64> {
        Ok(self.page(at, false)?[(at % PAGE) as usize])
    }

    /// Changes the number at an index, which must exist.
    ///
    /// # Errors
    /// If the temporary file cannot be read or written.
    #[inline]
    pub(super) fn set(&mut self, at: u64, word: u64) -> Result<()> {
        self.page(at, true)?[(at % PAGE) as usize] = word;
        Ok(())
    }

    #[inline]
    fn page(&mut self, at: u64, changes: bool) -> Result<&mut [u64]> {
        let number = (at / PAGE) as usize;
        if self.pages[number].words.is_none() {
            self.load(number)?;
        }
        let page = &mut self.pages[number];
        page.is_used = true;
        page.is_changed |= changes;
        Ok(page.words.as_mut().expect("it is loaded"))
    }

    fn load(&mut self, number: usize) -> Result<()> {
        self.evict_pages()?;
        let mut words: Box<[u64]> = vec![0; PAGE as usize].into();
        let file = self.file.as_ref().expect("what is not in memory is in the file");
        read_exact_at(file, words.as_mut_bytes(), number as u64 * 8 * PAGE)
            .map_err(Error::io(&self.directory, "read a temporary file"))?;
        self.pages[number] = Page { words: Some(words), is_changed: false, is_used: true };
        self.held += 1;
        Ok(())
    }

    /// Evicts a page that has not been used since the last check (clock algorithm), if the maximum
    /// is reached.
    fn evict_pages(&mut self) -> Result<()> {
        while self.held >= self.most {
            self.hand = (self.hand + 1) % self.pages.len();
            let page = &mut self.pages[self.hand];
            if std::mem::take(&mut page.is_used) {
                continue;
            }
            let Some(words) = page.words.take() else { continue };
            self.held -= 1;
            if !page.is_changed {
                continue;
            }
            let file = match &mut self.file {
                Some(file) => file,
                none => none.insert(
                    tempfile::tempfile_in(&self.directory)
                        .map_err(Error::io(&self.directory, "make a temporary file"))?,
                ),
            };
            write_all_at(file, words.as_bytes(), self.hand as u64 * 8 * PAGE)
                .map_err(Error::io(&self.directory, "write a temporary file"))?;
        }
        Ok(())
    }
}
