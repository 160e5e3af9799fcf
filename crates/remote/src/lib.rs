//! Remote files on web servers and in buckets: ranged reads, and writes by multipart upload.
//!
//! [`object_store`] implements requests, retries, credentials and proxies. Fetched ranges are
//! cached by the [`FileAccess`] that a file is opened with, and on disk if a directory is set.

mod connections;
mod connector;
mod disk_cache;
mod error;
mod file;
mod list;
mod profile;
mod secrets;
mod stat;
mod store;
mod upload;

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use connections::Connections;
use disk_cache::DiskCache;
use spinney_base::Result;
use spinney_base::io::{
    DEFAULT_GAP, FileAccess, FileStat, RangeCache, RangeFile, ReadBackend, RemoteFiles, RemoteWriter,
};
use upload::Upload;

/// Options of a client for remote files. The memory limit of its cache is an option of the
/// [`FileAccess`] that uses the client: see [`FileAccess::range_cache`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RemoteOptions {
    /// Directory of the cache that is kept between runs; `None` for no such cache.
    pub cache_directory: Option<PathBuf>,
    /// Maximum size of the cache directory in bytes, enforced when a client is created.
    pub cache_directory_bytes: u64,
    /// Ranges that are at most this many bytes apart are fetched with one request.
    pub gap: u64,
    /// Time limit of a single request.
    pub timeout: Duration,
    /// Time limit of a request including all retries. After it, the request fails: the host
    /// probably hangs.
    pub limit: Duration,
    /// Maximum number of retries if the host is busy or the connection breaks. Delays increase.
    pub retries: usize,
    /// Complete URLs of files that manifests and job plans name without query and password.
    pub signed_urls: Vec<String>,
    /// Called several times per second during waits; cancels the operation if it returns true.
    pub is_stopped: fn() -> bool,
}

impl Default for RemoteOptions {
    fn default() -> RemoteOptions {
        RemoteOptions {
            cache_directory: None,
            cache_directory_bytes: 10 << 30,
            gap: DEFAULT_GAP,
            timeout: Duration::from_secs(30),
            limit: Duration::from_secs(60),
            signed_urls: Vec::new(),
            retries: 5,
            is_stopped: || false,
        }
    }
}

/// Creates a client for files on web servers (`https://`), in S3 (`s3://`), Google Cloud Storage
/// (`gs://`) and Azure (`az://`).
///
/// With a [`FileAccess`] that [uses the client](FileAccess::remote), input and output paths may be
/// such URLs.
///
/// ```no_run
/// # use spinney_base::io::FileAccess;
/// use spinney_remote::{RemoteOptions, client};
///
/// let access = FileAccess::new().remote(client(RemoteOptions::default())?);
/// let file = access.input("https://example.org/map.tif".as_ref())?;
/// # Ok::<(), spinney_base::Error>(())
/// ```
///
/// # Errors
/// If the cache directory cannot be used.
pub fn client(options: RemoteOptions) -> Result<Arc<dyn RemoteFiles>> {
    // A program that embeds the library may have installed a provider, which is used then.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let disk_cache = options
        .cache_directory
        .as_deref()
        .map(|directory| DiskCache::new(directory, options.cache_directory_bytes));
    Ok(Arc::new(Stores {
        disk_cache: disk_cache.transpose()?.map(Arc::new),
        connections: Arc::new(Connections::new(options)),
        opened: Mutex::default(),
        numbers: Mutex::default(),
    }))
}

/// Time for which opening a file again returns the same open file: detecting a file's format and
/// reading it are one operation to users.
const SAME_FOR: Duration = Duration::from_secs(1);

/// The URL of a file and the options of its store.
type StoredAt = (String, Vec<(String, String)>);

/// The client.
struct Stores {
    connections: Arc<Connections>,
    disk_cache: Option<Arc<DiskCache>>,
    /// Recently opened files, and when they were opened.
    opened: Mutex<HashMap<StoredAt, (Instant, RangeFile)>>,
    /// Cache numbers by URL and version of the file.
    numbers: Mutex<HashMap<String, u64>>,
}

impl RemoteFiles for Stores {
    fn open(
        &self,
        url: &str,
        storage: &[(String, String)],
        access: &FileAccess,
    ) -> Result<Box<dyn ReadBackend>> {
        let at = (url.to_string(), storage.to_vec());
        let lately = |opened: &HashMap<StoredAt, (Instant, RangeFile)>| {
            let known = opened.get(&at).filter(|(when, _)| when.elapsed() < SAME_FOR);
            known.filter(|(_, file)| file.uses(access.ranges())).map(|(_, file)| file.clone())
        };
        if let Some(opened) = lately(&self.opened.lock().unwrap_or_else(PoisonError::into_inner)) {
            return Ok(Box::new(opened));
        }
        let opened = file::open(url, storage, self, access)?;
        let mut all = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|_, (when, _)| when.elapsed() < SAME_FOR);
        all.insert(at, (Instant::now(), opened.clone()));
        Ok(Box::new(opened))
    }

    fn open_known(&self, url: &str, known: &FileStat, access: &FileAccess) -> Result<Box<dyn ReadBackend>> {
        Ok(Box::new(file::open_known(url, known, self, access)?))
    }

    fn stat(&self, urls: &[&str]) -> Result<Vec<Result<Option<FileStat>>>> {
        stat::stat(urls, &self.connections)
    }

    fn list(&self, prefix: &str, is_deep: bool) -> Result<Vec<String>> {
        list::list(prefix, is_deep, &self.connections)
    }

    fn write(&self, url: &str, access: &FileAccess) -> Result<Box<dyn RemoteWriter>> {
        self.forget(&[url]);
        Ok(Box::new(Upload::new(url, &self.connections, access)?))
    }

    fn remove(&self, urls: &[&str]) -> Result<()> {
        self.forget(urls);
        stat::remove(urls, &self.connections)
    }
}

impl Stores {
    /// Forgets recently opened files, because they are about to change.
    fn forget(&self, urls: &[&str]) {
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        opened.retain(|(url, _), _| !urls.contains(&url.as_str()));
    }

    /// The cache number of a file version.
    fn number(&self, state: &str) -> u64 {
        let mut numbers = self.numbers.lock().unwrap_or_else(PoisonError::into_inner);
        *numbers.entry(state.to_string()).or_insert_with(RangeCache::file_number)
    }
}
