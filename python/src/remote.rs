//! Remote files: options of stores, and files that Python itself reads.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyTuple};
use spinney::raw::io::{DEFAULT_GAP, Fetch, FileStat, FileVersion, RangeCache, RangeFile};
use spinney::raw::store::ByteSource;
use spinney::{Error, OpenOptions, Result};

use crate::jobs::Refused;

/// Returns a file's name for Python: a path, or the string of a URL (a path would lose one of two
/// slashes).
pub(crate) fn path_object<'py>(py: Python<'py>, path: &Path) -> PyResult<Bound<'py, PyAny>> {
    match path.to_str().filter(|text| text.contains("://") || text.contains("::")) {
        Some(text) => Ok(text.into_pyobject(py)?.into_any()),
        None => Ok(path.into_pyobject(py)?.into_any()),
    }
}

/// Returns a path or URL for display: a URL without its user info and query.
#[pyfunction]
pub(crate) fn shown(path: &str) -> String {
    spinney::raw::io::shown(Path::new(path)).into_owned()
}

/// How a remote file is opened.
pub(crate) struct RemoteAccess {
    /// Options of the store.
    storage: Vec<(String, String)>,
    /// File that Python reads, and the Python object that reads it.
    file: Option<(Arc<PythonFile>, Py<PyAny>)>,
    refused: Refused,
}

impl Default for RemoteAccess {
    fn default() -> RemoteAccess {
        RemoteAccess { storage: Vec::new(), file: None, refused: Refused::NOTHING.or_thread() }
    }
}

/// File that a Python function reads.
struct PythonFile {
    /// Function from start and end offsets of ranges to the bytes of each.
    fetch: Py<PyAny>,
    length: u64,
    number: u64,
    /// Version of the file when it was opened, and a function that returns its current version.
    version: Option<(String, Py<PyAny>)>,
}

/// Length of a file, the function that reads it, the object that copies are made from, and its
/// version with a function that returns the current one.
type FileTuple = (u64, Py<PyAny>, Py<PyAny>, Option<(String, Py<PyAny>)>);

/// Storage options; then nothing, or a file that Python reads; then whether remote and external
/// files are refused.
impl<'py> FromPyObject<'_, 'py> for RemoteAccess {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<RemoteAccess> {
        type AccessTuple = (Vec<(String, String)>, Option<FileTuple>, (bool, bool));
        let (storage, file, (remote, external)): AccessTuple = given.extract()?;
        let file = file.map(|(length, fetch, whole, version)| {
            (Arc::new(PythonFile { fetch, length, number: RangeCache::file_number(), version }), whole)
        });
        Ok(RemoteAccess { storage, file, refused: Refused { remote, external }.or_thread() })
    }
}

impl<'py> IntoPyObject<'py> for &RemoteAccess {
    type Target = PyTuple;
    type Output = Bound<'py, PyTuple>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let file = self.file.as_ref();
        let file = file.map(|(file, whole)| {
            let version = file.version.as_ref().map(|(version, query)| (version, query.clone_ref(py)));
            (file.length, file.fetch.clone_ref(py), whole.clone_ref(py), version)
        });
        (self.storage.clone(), file, (self.refused.remote, self.refused.external)).into_pyobject(py)
    }
}

impl RemoteAccess {
    pub(crate) fn clone_ref(&self, py: Python<'_>) -> RemoteAccess {
        let file = self.file.as_ref().map(|(file, whole)| (file.clone(), whole.clone_ref(py)));
        RemoteAccess { storage: self.storage.clone(), file, refused: self.refused }
    }

    /// Returns the options to open the file with.
    pub(crate) fn options(&self) -> OpenOptions {
        let access = self.refused.access();
        let options = OpenOptions::from(access).storage(self.storage.iter().cloned());
        let Some((file, _)) = &self.file else { return options };
        let file = file.clone();
        options.source(ByteSource::new(move |path| {
            let cache = (access.ranges().clone(), file.number);
            let fetch = Box::new(Reader { file: file.clone(), path: path.to_path_buf() });
            Ok(Box::new(RangeFile::new(path, file.length, fetch, cache, DEFAULT_GAP)))
        }))
    }
}

/// Reader of a Python file's bytes.
struct Reader {
    file: Arc<PythonFile>,
    path: std::path::PathBuf,
}

impl Fetch for Reader {
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        let starts: Vec<u64> = ranges.iter().map(|range| range.start).collect();
        let ends: Vec<u64> = ranges.iter().map(|range| range.end).collect();
        let fetched = Python::attach(|py| {
            let parts = self.file.fetch.call1(py, (starts, ends))?;
            let parts: Vec<Bound<'_, PyBytes>> = parts.extract(py)?;
            PyResult::Ok(parts.iter().map(|part| part.as_bytes().to_vec()).collect::<Vec<_>>())
        });
        let parts = fetched.map_err(|error| failed(&self.path, error))?;
        if parts.len() == ranges.len() {
            return Ok(parts);
        }
        let found = format!("{} parts", parts.len());
        Err(Error::corrupt(&self.path, "response of the file system", found, format!("{}", ranges.len())))
    }

    fn version(&self) -> Option<FileStat> {
        let (version, _) = self.file.version.as_ref()?;
        Some(FileStat { length: self.file.length, version: FileVersion::Tag(version.clone()) })
    }

    fn check_current(&self) -> Result<()> {
        let Some((version, query)) = &self.file.version else { return Ok(()) };
        let now = Python::attach(|py| query.call0(py)?.extract::<String>(py));
        match now.map_err(|error| failed(&self.path, error))? == *version {
            true => Ok(()),
            false => Err(Error::Changed { path: self.path.clone(), what: "was overwritten" }),
        }
    }
}

fn failed(path: &Path, error: PyErr) -> Error {
    Error::Io { path: path.to_path_buf(), doing: "fetch a range", cause: std::io::Error::other(error) }
}
