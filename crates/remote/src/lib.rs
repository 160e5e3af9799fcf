//! Files on web servers and in buckets: reading in ranges, writing by upload.
//!
//! Requests, retries, credentials and proxies are [`object_store`]'s. What is read stays in the cache of the
//! [`FileAccess`] that a file is opened with, and on disk if a directory is named.

mod connections;
mod connector;
mod disk_cache;
mod error;
mod file;
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

/// Options of a client for remote files. The limit of what is held in memory is that of the [`FileAccess`] that uses the client: see
/// [`FileAccess::range_cache`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RemoteOptions {
    /// Folder in which bytes are kept from one run to the next.
    pub folder: Option<PathBuf>,
    /// Bytes that the folder may have.
    pub folder_bytes: u64,
    /// Bytes between two ranges up to which these are fetched with one request.
    pub gap: u64,
    /// Time that a request may take.
    pub timeout: Duration,
    /// Time that a request for a file may take with all of its repetitions, until it is an error: a host that hangs is known by then.
    pub limit: Duration,
    /// Times that a request is repeated if the host is busy or the connection breaks, each after a longer pause.
    pub retries: usize,
    /// Whole URLs for those that manifests and plans of jobs name without query and password.
    pub signed_urls: Vec<String>,
    /// Asked several times a second while something is waited for: whether to give up.
    pub is_stopped: fn() -> bool,
}

impl Default for RemoteOptions {
    fn default() -> RemoteOptions {
        RemoteOptions {
            folder: None,
            folder_bytes: 10 << 30,
            gap: DEFAULT_GAP,
            timeout: Duration::from_secs(30),
            limit: Duration::from_secs(60),
            signed_urls: Vec::new(),
            retries: 5,
            is_stopped: || false,
        }
    }
}

/// Makes a client for files on web servers (`https://`), in S3 (`s3://`), Google Cloud Storage (`gs://`) and Azure (`az://`). Files that are
/// opened, and outputs that are created, with a [`FileAccess`] that [has it](FileAccess::remote) may be any of these.
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
/// If the directory for what is kept cannot be used.
pub fn client(options: RemoteOptions) -> Result<Arc<dyn RemoteFiles>> {
    // (A program that embeds the library may have installed a provider: that one is used.)
    let _ = rustls::crypto::ring::default_provider().install_default();
    let folder = options.folder.as_deref().map(|folder| DiskCache::new(folder, options.folder_bytes));
    Ok(Arc::new(Stores {
        folder: folder.transpose()?.map(Arc::new),
        connections: Arc::new(Connections::new(options)),
        opened: Mutex::default(),
        numbers: Mutex::default(),
    }))
}

/// Time for which a file that was opened is the same for whoever opens it again: finding out what a file is and reading it are one thing to
/// users.
const SAME_FOR: Duration = Duration::from_secs(1);

/// The options of a store, and the URL of a file in it.
type StoredAt = (String, Vec<(String, String)>);

/// The client.
struct Stores {
    connections: Arc<Connections>,
    folder: Option<Arc<DiskCache>>,
    /// Files that were opened lately, and when.
    opened: Mutex<HashMap<StoredAt, (Instant, RangeFile)>>,
    /// Numbers in the cache, by URL and state of the file.
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

    fn stat(&self, urls: &[&str]) -> Result<Vec<Result<Option<FileStat>>>> {
        stat::stat(urls, &self.connections)
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
    /// Forgets that files were opened lately, which become others.
    fn forget(&self, urls: &[&str]) {
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        opened.retain(|(url, _), _| !urls.contains(&url.as_str()));
    }

    /// The number in the cache of a state of a file.
    fn number(&self, state: &str) -> u64 {
        let mut numbers = self.numbers.lock().unwrap_or_else(PoisonError::into_inner);
        *numbers.entry(state.to_string()).or_insert_with(RangeCache::file_number)
    }
}
