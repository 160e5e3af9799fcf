//! Lists of words that may exceed memory: many lists in one temporary file, whose space is reused.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use zerocopy::IntoBytes;

use super::platform::{read_exact_at, write_all_at};
use crate::{Error, Result};

/// Maximum number of words per write.
const MAX_WORDS: usize = 16_896;

/// An unnamed temporary file of chunks. Those of a dropped list are reused.
#[derive(Debug)]
pub struct Spool {
    file: File,
    /// Words per chunk: a multiple of the record size.
    chunk: usize,
    /// Directory of the file, for messages.
    directory: PathBuf,
    chunks: Mutex<Chunks>,
}

#[derive(Debug, Default)]
struct Chunks {
    free: Vec<u64>,
    used: u64,
}

impl Spool {
    /// Creates a file in a directory for lists of records of `record` words, at most 16,896.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(directory: &Path, record: usize) -> Result<Arc<Spool>> {
        let file =
            tempfile::tempfile_in(directory).map_err(Error::io(directory, "create a temporary file"))?;
        let chunk = MAX_WORDS / record * record;
        Ok(Arc::new(Spool { file, chunk, directory: directory.to_path_buf(), chunks: Mutex::default() }))
    }

    /// Returns the offset of a chunk in the file, in bytes.
    fn offset(&self, chunk: u64) -> u64 {
        chunk * 4 * self.chunk as u64
    }

    fn take(&self) -> u64 {
        let mut chunks = self.chunks.lock().unwrap_or_else(PoisonError::into_inner);
        chunks.free.pop().unwrap_or_else(|| {
            chunks.used += 1;
            chunks.used - 1
        })
    }
}

/// A list in a spool.
#[derive(Debug)]
pub struct SpooledWords {
    spool: Arc<Spool>,
    chunks: Vec<u64>,
    len: usize,
}

impl SpooledWords {
    /// Returns the number of words.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no words.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Passes the words to a function, some complete records at a time.
    ///
    /// # Errors
    /// If the file cannot be read, and those of the function.
    pub fn each(&self, each: &mut dyn FnMut(&[u32]) -> Result<()>) -> Result<()> {
        let size = self.spool.chunk;
        let mut words = vec![0; size];
        for (index, chunk) in self.chunks.iter().enumerate() {
            let here = &mut words[..(self.len - index * size).min(size)];
            let read = read_exact_at(&self.spool.file, here.as_mut_bytes(), self.spool.offset(*chunk));
            read.map_err(Error::io(&self.spool.directory, "read a temporary file"))?;
            each(here)?;
        }
        Ok(())
    }
}

impl Drop for SpooledWords {
    fn drop(&mut self) {
        let mut chunks = self.spool.chunks.lock().unwrap_or_else(PoisonError::into_inner);
        chunks.free.append(&mut self.chunks);
    }
}

/// Writes one list to a spool.
pub struct WordSpooler {
    list: SpooledWords,
    buffer: Vec<u32>,
}

impl WordSpooler {
    /// Creates a list without words.
    pub fn new(spool: &Arc<Spool>) -> WordSpooler {
        let list = SpooledWords { spool: spool.clone(), chunks: Vec::new(), len: 0 };
        WordSpooler { list, buffer: Vec::new() }
    }

    /// Appends words.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn push(&mut self, mut words: &[u32]) -> Result<()> {
        let size = self.list.spool.chunk;
        self.list.len += words.len();
        while self.buffer.len() + words.len() >= size {
            let (here, rest) = words.split_at(size - self.buffer.len());
            self.buffer.extend_from_slice(here);
            self.flush()?;
            words = rest;
        }
        self.buffer.extend_from_slice(words);
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        let spool = &self.list.spool;
        let chunk = spool.take();
        self.list.chunks.push(chunk);
        let written = write_all_at(&spool.file, self.buffer.as_bytes(), spool.offset(chunk));
        written.map_err(Error::io(&spool.directory, "write a temporary file"))?;
        self.buffer.clear();
        Ok(())
    }

    /// Returns the complete list.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self) -> Result<SpooledWords> {
        if !self.buffer.is_empty() {
            self.flush()?;
        }
        Ok(self.list)
    }
}
