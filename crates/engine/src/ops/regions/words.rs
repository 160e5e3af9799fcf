//! Lists of numbers that go to a temporary file where they are longer than memory.

use std::fs::File;
use std::path::{Path, PathBuf};

use spinney_base::io::platform::{read_exact_at, write_all_at};
use spinney_base::{Error, Result};
use zerocopy::IntoBytes;

/// Numbers of a page.
const PAGE: u64 = 8192;

/// A list of numbers in pages, of which so many are in memory and all others in a temporary file without a name.
pub(super) struct Words {
    folder: PathBuf,
    file: Option<File>,
    pages: Vec<Page>,
    /// Pages in memory, and as many as there may be.
    held: usize,
    most: usize,
    /// Where to look for the next page to put away.
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
    /// An empty list that may take about so many bytes of memory; the temporary file will be in this folder.
    pub(super) fn new(folder: &Path, memory: u64) -> Words {
        let most = (memory / (8 * PAGE)).max(4) as usize;
        Words { folder: folder.into(), file: None, pages: Vec::new(), held: 0, most, hand: 0, len: 0 }
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
            self.make_room()?;
            let words = Some(vec![0; PAGE as usize].into());
            self.pages.push(Page { words, is_changed: true, is_used: true });
            self.held += 1;
        }
        self.len += 1;
        self.set(self.len - 1, word)
    }

    /// The number at a place, which there must be.
    ///
    /// # Errors
    /// If the temporary file cannot be read or written.
    #[inline]
    pub(super) fn get(&mut self, at: u64) -> Result<u64> {
        Ok(self.page(at, false)?[(at % PAGE) as usize])
    }

    /// Changes the number at a place, which there must be.
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
        self.make_room()?;
        let mut words: Box<[u64]> = vec![0; PAGE as usize].into();
        let file = self.file.as_ref().expect("what is not in memory is in the file");
        read_exact_at(file, words.as_mut_bytes(), number as u64 * 8 * PAGE)
            .map_err(Error::io(&self.folder, "read a temporary file"))?;
        self.pages[number] = Page { words: Some(words), is_changed: false, is_used: true };
        self.held += 1;
        Ok(())
    }

    /// Puts a page away that has not been used since the last time it was looked at, if there are as many as there may be.
    fn make_room(&mut self) -> Result<()> {
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
                    tempfile::tempfile_in(&self.folder)
                        .map_err(Error::io(&self.folder, "make a temporary file"))?,
                ),
            };
            write_all_at(file, words.as_bytes(), self.hand as u64 * 8 * PAGE)
                .map_err(Error::io(&self.folder, "write a temporary file"))?;
        }
        Ok(())
    }
}
