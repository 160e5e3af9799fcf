//! Files, and the trees and models that are open.

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

use spinney_base::io::{Fetch, FileAccess, FileStat, RangeCache, RangeFile, ReadBackend};
use spinney_base::{Error, Result};
use spinney_brep::ModelView;
use spinney_container::{ByteSource, OpenOptions};
use spinney_engine::dataset::Dataset;

use crate::images::Prepared;
use crate::sources::SourceFiles;

/// Default size of the range cache in bytes.
const CACHE: u64 = 64 << 20;

/// A file: its name in messages, and its bytes.
#[derive(Clone)]
pub(crate) struct File {
    pub(crate) name: PathBuf,
    number: u64,
    bytes: Bytes,
    /// The index that has cells in it, and its state when it was indexed, if it is a source.
    source: Option<(u64, FileStat)>,
}

#[derive(Clone)]
enum Bytes {
    Ranges(RangeFile),
    Whole(WholeFile),
}

/// A file whose bytes are complete.
#[derive(Clone)]
struct WholeFile(Arc<Vec<u8>>);

impl ReadBackend for WholeFile {
    fn len(&self) -> u64 {
        self.0.len() as u64
    }

    fn bytes(&self) -> Option<&[u8]> {
        Some(&self.0)
    }

    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
        Ok(Cow::Borrowed(&self.0[offset as usize..][..length]))
    }
}

/// A backend for bytes that JavaScript must fetch.
struct DeferredFetch;

impl Fetch for DeferredFetch {
    fn fetch(&self, _: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        Err(Error::NotFetched)
    }
}

/// An open tree or model, with its file.
pub(crate) struct Opened {
    pub(crate) file: File,
    pub(crate) content: Content,
    /// Styles and grids, prepared once for many images.
    pub(crate) prepared: Prepared,
}

/// A tree of cells, or an exact model.
pub(crate) enum Content {
    Cells(Box<Dataset>),
    Model(Box<ModelView>),
}

struct State {
    cache: Arc<RangeCache>,
    files: BTreeMap<u64, File>,
    opened: BTreeMap<u32, Rc<Opened>>,
    next: u32,
}

thread_local! {
    static STATE: RefCell<State> = RefCell::new(State {
        cache: Arc::new(RangeCache::new(CACHE)),
        files: BTreeMap::new(),
        opened: BTreeMap::new(),
        next: 0,
    });
}

impl File {
    /// Returns the options that open the file's bytes, whatever the name.
    pub(crate) fn options(&self) -> OpenOptions {
        let bytes = self.bytes.clone();
        let access = FileAccess::new().remote(Arc::new(SourceFiles::of_index(self.number)));
        OpenOptions::new().access(access).source(ByteSource::new(move |_: &Path| {
            Ok(match &bytes {
                Bytes::Ranges(file) => Box::new(file.clone()) as Box<dyn ReadBackend>,
                Bytes::Whole(file) => Box::new(file.clone()),
            })
        }))
    }
}

fn add(number: u64, name: &str, bytes: Bytes, source: Option<(u64, FileStat)>) -> u64 {
    let file = File { name: name.into(), number, bytes, source };
    STATE.with_borrow_mut(|state| state.files.insert(number, file));
    number
}

fn range_file(name: &str, length: u64) -> RangeFile {
    let number = RangeCache::file_number();
    let cache = STATE.with_borrow(|state| state.cache.clone());
    // (JavaScript joins ranges.)
    RangeFile::new(Path::new(name), length, Box::new(DeferredFetch), (cache, number), 0)
}

pub(crate) fn add_ranges(name: &str, length: u64) -> u64 {
    let file = range_file(name, length);
    add(file.number(), name, Bytes::Ranges(file), None)
}

pub(crate) fn add_bytes(name: &str, bytes: Vec<u8>) -> u64 {
    add(RangeCache::file_number(), name, Bytes::Whole(WholeFile(Arc::new(bytes))), None)
}

/// Adds a source of an index.
pub(crate) fn add_source(index: u64, name: &str, known: &FileStat) -> RangeFile {
    let file = range_file(name, known.length);
    add(file.number(), name, Bytes::Ranges(file.clone()), Some((index, known.clone())));
    file
}

/// Returns name and state of a source of an index, by its number.
pub(crate) fn source(number: u64) -> Option<(String, FileStat)> {
    STATE.with_borrow(|state| {
        let File { name, source, .. } = state.files.get(&number)?;
        Some((name.to_str()?.to_owned(), source.clone()?.1))
    })
}

/// Removes a file, and the sources if it is an index.
pub(crate) fn remove(number: u64) {
    let is_left =
        |file: &File| file.number != number && file.source.as_ref().is_none_or(|(index, _)| *index != number);
    STATE.with_borrow_mut(|state| state.files.retain(|_, file| is_left(file)));
}

pub(crate) fn supply(number: u64, offset: u64, bytes: Vec<u8>) {
    let file = STATE.with_borrow(|state| state.files.get(&number).map(|file| file.bytes.clone()));
    // (A file that was removed meanwhile needs no bytes.)
    if let Some(Bytes::Ranges(file)) = file {
        file.supply(offset, bytes);
    }
}

pub(crate) fn set_cache(bytes: u64) {
    STATE.with_borrow(|state| state.cache.set_limit(bytes));
}

pub(crate) fn close(opened: u32) {
    let closed = STATE.with_borrow_mut(|state| state.opened.remove(&opened));
    drop(closed);
}

/// Returns the file with a number.
///
/// # Errors
/// If there is none.
pub(crate) fn file(number: u64) -> Result<File> {
    let found = STATE.with_borrow(|state| state.files.get(&number).cloned());
    found.ok_or_else(|| Error::invalid("file", number.to_string(), "the number of a file that was added"))
}

/// Stores an open object; returns its number.
pub(crate) fn keep(opened: Opened) -> u32 {
    STATE.with_borrow_mut(|state| {
        state.next += 1;
        state.opened.insert(state.next, Rc::new(opened));
        state.next
    })
}

/// Returns the open tree or model with a number.
///
/// # Errors
/// If there is none.
pub(crate) fn opened(number: u32) -> Result<Rc<Opened>> {
    let found = STATE.with_borrow(|state| state.opened.get(&number).cloned());
    found.ok_or_else(|| Error::invalid("dataset", "a closed one", "an open one"))
}

impl Opened {
    pub(crate) fn new(file: File, content: Content) -> Opened {
        Opened { file, content, prepared: Prepared::default() }
    }

    /// Returns the tree of cells.
    ///
    /// # Errors
    /// If it is an exact model.
    pub(crate) fn cells(&self) -> Result<&Dataset> {
        match &self.content {
            Content::Cells(tree) => Ok(tree),
            Content::Model(_) => Err(Error::unsupported(
                &self.file.name,
                "this query of an exact model",
                "exact models have measures, sections and triangles",
            )),
        }
    }

    /// Returns the exact model.
    ///
    /// # Errors
    /// If it is a tree of cells.
    pub(crate) fn model(&self) -> Result<&ModelView> {
        match &self.content {
            Content::Model(model) => Ok(model),
            Content::Cells(_) => Err(Error::unsupported(
                &self.file.name,
                "this query of a tree of cells",
                "trees have windows, points and statistics",
            )),
        }
    }
}
