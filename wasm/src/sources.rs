//! Sources of indexes: files that have the cells of an index.
//!
//! The engine opens a source when it reads cells. No request is made: the index has the length. A
//! query then misses ranges of the source, and JavaScript fetches these, as it does those of the
//! index.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use serde_json::{Value, json};
use spinney_base::io::{
    FileAccess, FileStat, FileVersion, RangeFile, ReadBackend, RemoteFiles, RemoteWriter,
};
use spinney_base::{Error, Result};

use crate::files;

/// Opens the sources of an index.
pub(crate) struct SourceFiles {
    /// Number of the index.
    index: u64,
    /// Open sources by path or URL, so that each has one number.
    opened: Mutex<HashMap<String, RangeFile>>,
}

impl SourceFiles {
    pub(crate) fn of_index(index: u64) -> SourceFiles {
        SourceFiles { index, opened: Mutex::default() }
    }
}

fn refused<T>(path: &str) -> Result<T> {
    let advice = "open it by itself, or use the program";
    Err(Error::unsupported(path, "a file that another one names", advice))
}

impl RemoteFiles for SourceFiles {
    fn open(&self, url: &str, _: &[(String, String)], _: &FileAccess) -> Result<Box<dyn ReadBackend>> {
        refused(url)
    }

    fn open_known(&self, path: &str, known: &FileStat, _: &FileAccess) -> Result<Box<dyn ReadBackend>> {
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        let file = opened.entry(path.into()).or_insert_with(|| files::add_source(self.index, path, known));
        Ok(Box::new(file.clone()))
    }

    fn stat(&self, urls: &[&str]) -> Result<Vec<Result<Option<FileStat>>>> {
        Ok(urls.iter().map(|url| refused(url)).collect())
    }

    fn write(&self, url: &str, _: &FileAccess) -> Result<Box<dyn RemoteWriter>> {
        refused(url)
    }

    fn remove(&self, urls: &[&str]) -> Result<()> {
        refused(urls.first().copied().unwrap_or_default())
    }
}

/// Describes a source by its number: path or URL, and length and version when it was indexed.
/// `null` if the file is not a source.
pub(crate) fn describe(number: u64) -> Value {
    let Some((name, FileStat { length, version })) = files::source(number) else { return Value::Null };
    match version {
        FileVersion::Tag(tag) => json!({ "name": name, "length": length, "tag": tag }),
        // (A string, since doubles have no such integers.)
        FileVersion::Modified(time) => {
            json!({ "name": name, "length": length, "modified": time.to_string() })
        }
    }
}
