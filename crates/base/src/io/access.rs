//! Settings of file access: mapped or positioned reads, caches, and the client for remote files.

use std::collections::HashSet;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use super::batch::Traffic;
use super::cache::{RangeCache, with_cache};
use super::file_id::FileId;
use super::input::{InputFile, is_access_denied};
use super::output::Output;
use super::read::{Mapped, Positioned, ReadBackend, open_input};
use super::remote::RemoteFiles;
use super::stat::{FileStat, remove_local, stat_local};
use crate::url::{local_path, shown, url_of};
use crate::{Error, Result};

/// Default limit of the cache of remote ranges, in bytes.
const RANGES: u64 = 32 << 20;

/// Default limit of the cache of unpacked segments, in bytes.
const UNPACKED: u64 = 64 << 20;

/// Default cache limit of each file that is read at positions, in bytes.
const SEGMENTS: u64 = 64 << 20;

/// How files are opened, created and removed: mapped or positioned reads, cache limits, and the
/// client for remote files.
///
/// Every open file keeps its access, and uses it to open the files that it names: members of
/// manifests, sources of virtual rasters, sidecars. (Models, features, and volumes other than
/// images are local files, whatever the access.) Clones are cheap and share the caches. A change of
/// a clone does not affect the original.
///
/// The default maps files and has no client for remote files. All default accesses share one pair
/// of caches, so that one limit holds for a process that opens thousands of files with default
/// options. An access with a [client](FileAccess::remote) has its own cache of remote ranges, and
/// thus its own [`traffic`](FileAccess::traffic).
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::{FileAccess, OpenOptions};
///
/// let access = FileAccess::new().positioned(1 << 20).unpacked_cache(8 << 20);
/// let map = spinney::open_with("fixtures/v1/classes.goblin", &OpenOptions::new().access(access))?;
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone)]
pub struct FileAccess(Arc<Settings>);

#[derive(Clone)]
struct Settings {
    /// Whether files are read at positions instead of mapped.
    positioned: bool,
    /// Cache limit of each file that is read at positions, in bytes.
    segments: u64,
    ranges: Arc<RangeCache>,
    unpacked: Arc<RangeCache>,
    remote: Option<Arc<dyn RemoteFiles>>,
    /// Whether remote files are refused, even if there is a client.
    is_remote_refused: bool,
    /// Whether files are refused whose data is in other files.
    is_external_refused: bool,
    /// Receives warnings about files that are read.
    warnings: Option<Arc<Warnings>>,
    /// Number of local files that were mapped, and of those that were opened for positioned reads.
    opened: Arc<[AtomicU64; 2]>,
}

impl Default for FileAccess {
    fn default() -> FileAccess {
        // The only process-wide caches. They bound the memory of the process, however many files
        // have default options.
        static DEFAULT: LazyLock<FileAccess> = LazyLock::new(|| {
            let [ranges, unpacked] = [RANGES, UNPACKED].map(|limit| Arc::new(RangeCache::new(limit)));
            FileAccess(Arc::new(Settings {
                positioned: false,
                segments: SEGMENTS,
                ranges,
                unpacked,
                remote: None,
                is_remote_refused: false,
                is_external_refused: false,
                warnings: None,
                opened: Arc::default(),
            }))
        });
        DEFAULT.clone()
    }
}

/// Receiver of warnings about files that are read: the file, and the text.
pub type Warn = dyn Fn(&Path, &str) + Send + Sync;

/// A receiver of warnings, and the files that it has received one of.
struct Warnings {
    receive: Arc<Warn>,
    files: Mutex<HashSet<PathBuf>>,
}

/// Two accesses are equal if one is a clone of the other.
impl PartialEq for FileAccess {
    fn eq(&self, other: &FileAccess) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Eq for FileAccess {}

impl fmt::Debug for FileAccess {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Settings { positioned, segments, ranges, unpacked, remote, .. } = &*self.0;
        f.debug_struct("FileAccess")
            .field("positioned", positioned)
            .field("segments", segments)
            .field("ranges", &ranges.limit())
            .field("unpacked", &unpacked.limit())
            .field("remote", &remote.is_some())
            .field("is_remote_refused", &self.0.is_remote_refused)
            .field("is_external_refused", &self.0.is_external_refused)
            .finish()
    }
}

impl FileAccess {
    /// Returns the default: files are mapped, none are remote.
    pub fn new() -> FileAccess {
        FileAccess::default()
    }

    fn with(mut self, change: impl FnOnce(&mut Settings)) -> FileAccess {
        change(Arc::make_mut(&mut self.0));
        self
    }

    /// Reads files at positions instead of mapping them: for network file systems, and for files
    /// that other processes may truncate. Each open file caches up to `cache` bytes, by default 64
    /// MiB.
    #[must_use]
    pub fn positioned(self, cache: impl Into<Option<u64>>) -> FileAccess {
        let segments = cache.into().unwrap_or(self.0.segments);
        self.with(|settings| (settings.positioned, settings.segments) = (true, segments))
    }

    /// Returns the access for many files of which up to `count` (at least 1) are open at a time.
    /// Each file gets an equal share of the cache limit, so that together they have the limit of
    /// one.
    #[must_use]
    pub fn divided(&self, count: u64) -> FileAccess {
        self.clone().with(|settings| settings.segments /= count.max(1))
    }

    /// Replaces the cache of unpacked segments by an empty one of at most `limit` bytes. Only this
    /// access and its clones use it.
    #[must_use]
    pub fn unpacked_cache(self, limit: u64) -> FileAccess {
        self.with(|settings| settings.unpacked = Arc::new(RangeCache::new(limit)))
    }

    /// Replaces the cache of remote ranges by an empty one of at most `limit` bytes. Only this
    /// access and its clones use it. [`traffic`](FileAccess::traffic) restarts from 0.
    #[must_use]
    pub fn range_cache(self, limit: u64) -> FileAccess {
        self.with(|settings| settings.ranges = Arc::new(RangeCache::new(limit)))
    }

    /// Opens remote files through a client. This access and its clones get their own cache of
    /// remote ranges, with the previous limit.
    #[must_use]
    pub fn remote(self, client: Arc<dyn RemoteFiles>) -> FileAccess {
        let limit = self.ranges().limit();
        self.range_cache(limit).with(|settings| settings.remote = Some(client))
    }

    /// Refuses remote files, whether the caller or another file names them: for untrusted input,
    /// which must not make this machine send requests.
    #[must_use]
    pub fn no_remote(self) -> FileAccess {
        self.with(|settings| settings.is_remote_refused = true)
    }

    /// Refuses files whose data is in other files, such as virtual rasters and manifests: for
    /// untrusted input, which must not select files of this machine. See
    /// [`FileAccess::check_external`].
    #[must_use]
    pub fn no_external(self) -> FileAccess {
        self.with(|settings| settings.is_external_refused = true)
    }

    /// Checks that `file` may name `other`, which contains data of it. Callers check this before
    /// they open a file that another file names.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if external files are [refused](FileAccess::no_external).
    pub fn check_external(&self, file: &Path, other: &Path) -> Result<()> {
        if !self.0.is_external_refused {
            return Ok(());
        }
        let found = format!("data in another file ({}) with --no-external", shown(other));
        let advice =
            "omit --no-external if you trust the file, or convert it to a format that contains its data";
        Err(Error::unsupported(file, found, advice))
    }

    /// Whether files are read at positions instead of mapped.
    pub fn is_positioned(&self) -> bool {
        self.0.positioned
    }

    /// Returns the cache of remote ranges.
    pub fn ranges(&self) -> &Arc<RangeCache> {
        &self.0.ranges
    }

    /// Returns the cache of unpacked segments.
    pub fn unpacked(&self) -> &Arc<RangeCache> {
        &self.0.unpacked
    }

    /// Counts a local file that was opened in this access's mode: mapped or positioned.
    pub fn count_opened(&self) {
        self.0.opened[usize::from(self.is_positioned())].fetch_add(1, Ordering::Relaxed);
    }

    /// Returns how many local files this access and its clones have mapped, and how many they have
    /// opened for positioned reads.
    pub fn opened(&self) -> [u64; 2] {
        self.0.opened.each_ref().map(|count| count.load(Ordering::Relaxed))
    }

    /// Returns the requests for remote files with this access and its clones so far.
    pub fn traffic(&self) -> Traffic {
        self.ranges().traffic()
    }

    /// Returns the client for a remote file.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if there is no client, or remote files are refused.
    pub(super) fn client(&self, path: &Path) -> Result<&dyn RemoteFiles> {
        if self.0.is_remote_refused {
            let advice = "omit --no-remote if you trust the source of this name, or download the file";
            return Err(Error::unsupported(path, "a remote file with --no-remote", advice));
        }
        self.0.remote.as_deref().ok_or_else(|| {
            let advice = "use a build with support for remote files, or download the file";
            Error::unsupported(path, "a remote file", advice)
        })
    }

    /// Opens a file for reading, and returns its identity: the same path may lead to two files if
    /// it is opened twice. `storage` has the options of a remote file's store, such as credentials.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(&self, path: &Path, storage: &[(String, String)]) -> Result<(Box<dyn ReadBackend>, FileId)> {
        if let Some(url) = url_of(path) {
            return Ok((self.client(path)?.open(url, storage, self)?, FileId::unique()));
        }
        let path = &*local_path(path);
        let file = open_input(path)?;
        let id = FileId::of(&file).map_err(Error::io(path, "open"))?;
        let backend: Box<dyn ReadBackend> = match self.is_positioned() {
            true => Box::new(Positioned::of(file, path)?),
            false => Box::new(Mapped::of(&file, path)?),
        };
        self.count_opened();
        Ok((self.cached(backend), id))
    }

    /// Returns a remote file whose length and version are known, without a request: see
    /// [`RemoteFiles::open_known`].
    ///
    /// # Errors
    /// If there is no client, or the URL is invalid.
    pub fn open_known(&self, path: &Path, known: &FileStat) -> Result<Box<dyn ReadBackend>> {
        self.client(path)?.open_known(path.to_str().unwrap_or_default(), known, self)
    }

    /// Sets a function that receives warnings about files that are read: the file, and the text. It
    /// receives one of each file, also if that is opened again.
    #[must_use]
    pub fn on_warning(self, receive: Arc<Warn>) -> FileAccess {
        self.with(|settings| {
            settings.warnings = Some(Arc::new(Warnings { receive, files: Mutex::default() }))
        })
    }

    /// Gives a warning about a file that is read.
    pub fn warn(&self, path: &Path, text: &str) {
        let Some(Warnings { receive, files }) = self.0.warnings.as_deref() else { return };
        // (The lock is not held while the receiver runs.)
        let is_new = files.lock().unwrap_or_else(PoisonError::into_inner).insert(path.to_path_buf());
        if is_new {
            receive(path, text);
        }
    }

    /// Opens a file of which only few bytes are read, such as its header. It is never mapped.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn peek(&self, path: &Path) -> Result<Box<dyn ReadBackend>> {
        match url_of(path) {
            Some(url) => self.client(path)?.open(url, &[], self),
            None => Ok(Box::new(Positioned::open(&local_path(path))?)),
        }
    }

    /// Opens a file like [`FileAccess::peek`], to detect its type; `None` if it is missing or
    /// cannot be read at offsets.
    ///
    /// Errors of the disk or the host are returned. If they were taken for another file type, each
    /// further guess would repeat them.
    ///
    /// # Errors
    /// If the file system or the host fails.
    pub fn probe(&self, path: &Path) -> Result<Option<Box<dyn ReadBackend>>> {
        if url_of(path).is_none() && local_path(path).is_dir() {
            return Ok(None);
        }
        match self.peek(path) {
            Err(Error::Unsupported { .. }) => Ok(None),
            Err(error) if is_absent(path, &error) => Ok(None),
            found => found.map(Some),
        }
    }

    /// Adds a cache to a backend, unless its bytes are mapped or it has a cache.
    pub fn cached(&self, backend: Box<dyn ReadBackend>) -> Box<dyn ReadBackend> {
        with_cache(backend, self.0.segments)
    }

    /// Opens a file that is read sequentially or at offsets.
    ///
    /// # Errors
    /// If the file is missing, cannot be read, or is a pipe or a device.
    pub fn input(&self, path: &Path) -> Result<InputFile> {
        match url_of(path) {
            Some(url) => Ok(InputFile::remote(self.client(path)?.open(url, &[], self)?)),
            None => InputFile::local(&local_path(path)),
        }
    }

    /// Opens a file; `None` if it is missing.
    ///
    /// # Errors
    /// Those of [`FileAccess::input`].
    pub fn find(&self, path: &Path) -> Result<Option<InputFile>> {
        match self.input(path) {
            Err(Error::Io { cause, .. }) if cause.kind() == io::ErrorKind::NotFound => Ok(None),
            found => found.map(Some),
        }
    }

    /// Opens an optional file that accompanies a readable one; `None` if it is missing. For remote
    /// files, permission denied counts as missing: S3 returns 403 for a missing key if the caller
    /// lacks ListBucket.
    ///
    /// # Errors
    /// Those of [`FileAccess::input`].
    pub fn find_companion(&self, path: &Path) -> Result<Option<InputFile>> {
        match self.find(path) {
            Err(error) if is_access_denied(path, &error) => Ok(None),
            found => found,
        }
    }

    /// Reads a file of at most `limit` bytes; `None` if it is missing.
    ///
    /// # Errors
    /// Those of [`FileAccess::input`]; also if the file is larger.
    pub fn read_whole(&self, path: &Path, limit: u64) -> Result<Option<Vec<u8>>> {
        self.find(path)?.map(|file| file.into_bytes(path, limit)).transpose()
    }

    /// Stats files, in their order; `None` for missing ones. Remote files are queried all at once.
    ///
    /// # Errors
    /// If there is no client for remote files, or on cancellation. Per file, if its host or the
    /// file system refuses.
    pub fn stat(&self, paths: &[&Path]) -> Result<Vec<Result<Option<FileStat>>>> {
        let urls: Vec<&str> = paths.iter().filter_map(|path| url_of(path)).collect();
        let mut remote = match urls.first() {
            Some(first) => {
                let found = self.client(Path::new(first))?.stat(&urls)?;
                self.ranges().count_traffic(urls.len() as u64, 0);
                found.into_iter()
            }
            None => Vec::new().into_iter(),
        };
        let stat = |path: &&Path| match url_of(path) {
            Some(_) => remote.next().expect("one result per URL"),
            None => stat_local(&local_path(path)),
        };
        Ok(paths.iter().map(stat).collect())
    }

    /// Stats optional files that accompany readable ones: see [`FileAccess::find_companion`].
    ///
    /// # Errors
    /// If a file cannot be statted.
    pub fn stat_companions(&self, paths: &[&Path]) -> Result<Vec<Option<FileStat>>> {
        let found = paths.iter().zip(self.stat(paths)?);
        let found = found.map(|(path, found)| match found {
            Err(error) if is_access_denied(path, &error) => Ok(None),
            found => found,
        });
        found.collect()
    }

    /// Starts an output: see [`Output::create`]. A remote file is first written to the system's
    /// temporary directory, and uploaded when it is complete.
    ///
    /// # Errors
    /// Those of [`Output::create`]; also if there is no client for a remote file.
    pub fn create(&self, path: &Path) -> Result<Output> {
        Output::open(path, self)
    }

    /// Starts an output that is written sequentially: a remote file is uploaded while it is
    /// written, and takes no space on this machine.
    ///
    /// # Errors
    /// Those of [`FileAccess::create`].
    pub fn append_only(&self, path: &Path) -> Result<Output> {
        match url_of(path) {
            Some(url) => Ok(Output::remote(path, self.client(path)?.write(url, self)?, self)),
            None => self.create(path),
        }
    }

    /// Removes files. A missing one counts as removed.
    ///
    /// # Errors
    /// If a file cannot be removed, or on cancellation; others may have been removed then.
    pub fn remove(&self, paths: &[&Path]) -> Result<()> {
        let urls: Vec<&str> = paths.iter().filter_map(|path| url_of(path)).collect();
        if let Some(first) = urls.first() {
            self.client(Path::new(first))?.remove(&urls)?;
            self.ranges().count_traffic(urls.len() as u64, 0);
        }
        paths
            .iter()
            .filter(|path| url_of(path).is_none())
            .try_for_each(|path| remove_local(&local_path(path)))
    }
}

/// Whether `is_one` is true for any of the files.
///
/// # Errors
/// Those of `is_one`.
pub fn any_file(files: &[PathBuf], is_one: &dyn Fn(&Path) -> Result<bool>) -> Result<bool> {
    for file in files {
        if is_one(file)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Whether an error means that a file is missing, or may not be read remotely. Names that no file
/// can have count as missing, since `stack.goblin:B08` names a layer.
fn is_absent(path: &Path, error: &Error) -> bool {
    let Error::Io { cause, .. } = error else { return false };
    let is_missing = matches!(
        cause.kind(),
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory | io::ErrorKind::InvalidFilename
    );
    is_missing || is_access_denied(path, error)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A host that is down, and counts requests.
    #[derive(Default)]
    struct Outage(std::sync::atomic::AtomicUsize);

    impl RemoteFiles for Outage {
        fn open(&self, url: &str, _: &[(String, String)], _: &FileAccess) -> Result<Box<dyn ReadBackend>> {
            self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            let kind = if url.contains("none") { io::ErrorKind::NotFound } else { io::ErrorKind::Other };
            Err(Error::io(url, "open")(kind.into()))
        }

        fn stat(&self, _: &[&str]) -> Result<Vec<Result<Option<FileStat>>>> {
            Ok(Vec::new())
        }

        fn write(&self, url: &str, _: &FileAccess) -> Result<Box<dyn super::super::RemoteWriter>> {
            Err(Error::io(url, "open")(io::ErrorKind::Other.into()))
        }

        fn remove(&self, _: &[&str]) -> Result<()> {
            Ok(())
        }
    }

    #[test]
    fn missing_files_are_none_and_outages_are_errors() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("file");
        std::fs::write(&file, "1").unwrap();
        let access = FileAccess::new().remote(Arc::new(Outage::default()));
        assert!(access.probe(&file).unwrap().is_some());
        for path in [directory.path(), &file.join("below"), Path::new("http://h/none")] {
            assert!(access.probe(path).unwrap().is_none(), "{}", path.display());
        }
        assert!(access.probe(Path::new("http://h/x")).is_err());
        let is_one = |path: &Path| Ok(access.probe(path)?.is_some());
        assert!(any_file(&["/none".into(), file.clone()], &is_one).unwrap());
        assert!(any_file(&["http://h/x".into(), file], &is_one).is_err());
    }

    #[test]
    fn remote_and_external_files_are_refused_by_option() {
        let host = Arc::new(Outage::default());
        let access = FileAccess::new().remote(host.clone());
        let [url, other] = ["http://h/x?SECRET", "other.raw"].map(Path::new);
        access.check_external(Path::new("x.nhdr"), other).unwrap();
        let strict = access.no_remote().no_external();
        let refused = [
            strict.peek(url).err().unwrap(),
            strict.stat(&[url]).err().unwrap(),
            strict.create(url).err().unwrap(),
            strict.append_only(url).err().unwrap(),
            strict.remove(&[url]).err().unwrap(),
        ];
        for error in refused {
            assert!(error.to_string().contains("--no-remote"), "{error}");
        }
        let error = strict.check_external(Path::new("x.nhdr"), other).unwrap_err().to_string();
        assert!(error.contains("x.nhdr") && error.contains("other.raw") && error.contains("--no-external"));
        assert_eq!(host.0.load(std::sync::atomic::Ordering::Relaxed), 0);
    }
}
