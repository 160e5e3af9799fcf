//! A remote file: opened by fetching its two ends, then read in ranges of the same version.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use futures_util::StreamExt;
use futures_util::stream;
use object_store::{Attribute, GetOptions, GetRange, GetResult, ObjectMeta};
use spinney_base::io::{Fetch, FileAccess, FileStat, RangeFile, ReadBackend};
use spinney_base::{Error, Result};

use super::connections::Connections;
use super::disk_cache::{CachedFile, DiskCache};
use super::store::ObjectLocation;
use super::{Stores, error, stat};

/// Bytes fetched from the start of a file to open it. They contain the header and, if the file may
/// be Autumnal, the meta pages. Opening a small file costs little more.
const HEAD: u64 = (8 << 10) + 64;
const GOBLIN_HEAD: u64 = 512;
/// Bytes fetched from the end of a file: trailer, metadata, the top of the index, and in a file
/// with few segments the whole index.
const TAIL: u64 = 24 << 10;

/// Number of bytes to fetch from the start of a file with this URL.
fn head_of(url: &str) -> u64 {
    let name = url.split(['?', '#']).next().unwrap_or_default();
    if name.ends_with(".goblin") { GOBLIN_HEAD } else { HEAD }
}

/// Maximum number of concurrent requests for a file.
const AT_ONCE: usize = 32;

/// Identifies a version of a file.
fn key(url: &str, state: &FileStat) -> String {
    format!("{url}\n{:?}\n{}", state.version, state.length)
}

/// Connection to one file.
struct RemoteFile {
    /// The store, and the id of the process that owns its connections. A forked process opens its
    /// own.
    location: Mutex<(u32, ObjectLocation)>,
    storage: Vec<(String, String)>,
    connections: Arc<Connections>,
    path: PathBuf,
    state: FileStat,
    kept: Option<CachedFile>,
    /// The version that is read instead of `state`, if that was known from an index only: that of
    /// the first response.
    found: Option<(OnceLock<FileStat>, FileAccess)>,
}

/// Opens a file with one batch of requests, for its two ends.
///
/// # Errors
/// If it is missing, may not be read, or its host does not serve ranges.
pub(super) fn open(
    url: &str,
    storage: &[(String, String)],
    stores: &Stores,
    access: &FileAccess,
) -> Result<RangeFile> {
    let path = Path::new(url);
    let connections = &stores.connections;
    let location = ObjectLocation::of(url, storage, connections)?;
    let first = head_of(url);
    let ends = [GetRange::Bounded(0..first), GetRange::Suffix(TAIL)];
    let request = (connections.as_ref(), path, "open");
    let both = async {
        let [head, tail] = ends.map(|range| get(&location, range, request));
        futures_util::future::join(head, tail).await
    };
    let (head, tail) = connections.wait(path, both)?;
    let head = head?.map_err(|cause| cause.of_file(path, "open"))?;
    let state = stat::state(&head.meta);
    let mut came = vec![head];
    let mut requests = 2;
    match tail? {
        Ok(tail) => came.push(tail),
        // Azure does not support suffix ranges.
        Err(Failed::Store(object_store::Error::NotSupported { .. })) if state.length > first => {
            let range = GetRange::Bounded(state.length.saturating_sub(TAIL).max(first)..state.length);
            let tail = connections.wait(path, get(&location, range, request))??;
            came.push(tail.map_err(|cause| cause.of_file(path, "open"))?);
            requests += 1;
        }
        Err(Failed::Store(object_store::Error::NotSupported { .. })) => {}
        Err(failed) => return Err(failed.of_file(path, "open")),
    }
    access.ranges().count_traffic(requests, came.iter().map(|part| part.bytes.len() as u64).sum());
    let key = key(url, &state);
    let kept = stores.disk_cache.as_ref().map(|cache: &Arc<DiskCache>| cache.file(&key));
    let number = stores.number(&key);
    let length = state.length;
    let remote = RemoteFile {
        location: Mutex::new((std::process::id(), location)),
        storage: storage.to_vec(),
        connections: connections.clone(),
        path: path.to_path_buf(),
        state,
        kept,
        found: None,
    };
    came.iter().try_for_each(|part| remote.check(part))?;
    let (cache, gap) = (access.ranges().clone(), connections.options.gap);
    let file = RangeFile::new(path, length, Box::new(remote), (cache, number), gap);
    for part in came {
        file.supply(part.range.start, part.bytes);
    }
    Ok(file)
}

/// Returns a file of a known version, without a request.
///
/// # Errors
/// If the URL is invalid.
pub(super) fn open_known(
    url: &str,
    known: &FileStat,
    stores: &Stores,
    access: &FileAccess,
) -> Result<RangeFile> {
    let path = Path::new(url);
    let connections = &stores.connections;
    let location = ObjectLocation::of(url, &[], connections)?;
    // (Bytes of a known version are compared with checksums when they are read, so they may be
    // those of another version. Other readers of the file must not get these.)
    let key = format!("indexed\n{}", key(url, known));
    let remote = RemoteFile {
        location: Mutex::new((std::process::id(), location)),
        storage: Vec::new(),
        connections: connections.clone(),
        path: path.to_path_buf(),
        state: known.clone(),
        kept: stores.disk_cache.as_ref().map(|cache| cache.file(&key)),
        found: Some((OnceLock::new(), access.clone())),
    };
    let (cache, gap) = (access.ranges().clone(), connections.options.gap);
    let file = RangeFile::new(path, known.length, Box::new(remote), (cache, stores.number(&key)), gap);
    file.reads_small_ranges();
    Ok(file)
}

/// A fetched range of a file.
struct FetchedRange {
    meta: ObjectMeta,
    range: Range<u64>,
    bytes: Vec<u8>,
}

/// Reason why a range was not fetched.
enum Failed {
    Store(object_store::Error),
    /// The host compresses its responses with this encoding.
    Compressed(String),
}

impl From<object_store::Error> for Failed {
    fn from(error: object_store::Error) -> Failed {
        Failed::Store(error)
    }
}

impl Failed {
    fn of_file(self, path: &Path, doing: &'static str) -> Error {
        match self {
            Failed::Store(cause) => error::of_store(path, doing, cause),
            Failed::Compressed(how) => {
                let advice = "configure the host not to compress such files, or download the file";
                Error::unsupported(path, format!("a host that compresses its responses ({how})"), advice)
            }
        }
    }
}

/// Fetches a range of a file within the time limit.
async fn get(
    location: &ObjectLocation,
    range: GetRange,
    (connections, path, doing): (&Connections, &Path, &'static str),
) -> Result<std::result::Result<FetchedRange, Failed>> {
    connections.limited((path, doing), async { Ok(fetch_range(location, range).await) }).await
}

/// Fetches a range of a file.
async fn fetch_range(
    location: &ObjectLocation,
    range: GetRange,
) -> std::result::Result<FetchedRange, Failed> {
    let options = GetOptions { range: Some(range), ..GetOptions::default() };
    let result: GetResult = location.store.get_opts(&location.name, options).await?;
    if let Some(how) = result.attributes.get(&Attribute::ContentEncoding)
        && !how.as_ref().is_empty()
        && how.as_ref() != "identity"
    {
        return Err(Failed::Compressed(how.as_ref().to_string()));
    }
    let (meta, range) = (result.meta.clone(), result.range.clone());
    let bytes = result.bytes().await?;
    Ok(FetchedRange { meta, range, bytes: bytes.into() })
}

impl RemoteFile {
    fn location(&self) -> Result<ObjectLocation> {
        let mut location = self.location.lock().unwrap_or_else(PoisonError::into_inner);
        if location.0 != std::process::id() {
            let url = self.path.to_str().unwrap_or_default();
            *location = (std::process::id(), ObjectLocation::of(url, &self.storage, &self.connections)?);
        }
        Ok(location.1.clone())
    }

    /// Returns the version that all ranges must have.
    fn expected(&self, found: &FileStat) -> FileStat {
        let Some((first, access)) = &self.found else { return self.state.clone() };
        let expected = first.get_or_init(|| {
            if !found.agrees(&self.state) {
                let text = "has another length or entity tag than when it was indexed; \
                            its tiles are compared with the checksums in the index";
                access.warn(&self.path, text);
            }
            found.clone()
        });
        expected.clone()
    }

    /// Checks that a range has its full length and belongs to the version that was opened.
    fn check(&self, part: &FetchedRange) -> Result<()> {
        let found = stat::state(&part.meta);
        if found != self.expected(&found) {
            return Err(Error::Changed { path: self.path.clone(), what: "was overwritten" });
        }
        let length = part.range.end.saturating_sub(part.range.start);
        if part.bytes.len() as u64 != length {
            let location = format!("bytes {} to {}", part.range.start, part.range.end);
            let found = format!("{} bytes", part.bytes.len());
            return Err(Error::corrupt(&self.path, location, found, format!("{length}")));
        }
        Ok(())
    }
}

impl Fetch for RemoteFile {
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        let location = self.location()?;
        let request = (self.connections.as_ref(), self.path.as_path(), "fetch a range");
        let parts = ranges.iter().map(|range| get(&location, GetRange::Bounded(range.clone()), request));
        let all = stream::iter(parts).buffered(AT_ONCE).collect::<Vec<_>>();
        let came = self.connections.wait(&self.path, all)?;
        let one = |(part, range): (Result<std::result::Result<FetchedRange, Failed>>, &Range<u64>)| {
            let part = part?.map_err(|cause| cause.of_file(&self.path, "fetch a range"))?;
            self.check(&part)?;
            if part.range != *range {
                let location = format!("bytes {} to {}", range.start, range.end);
                let found = format!("bytes {} to {}", part.range.start, part.range.end);
                return Err(Error::corrupt(&self.path, location, found, "the requested ones"));
            }
            Ok(part.bytes)
        };
        came.into_iter().zip(ranges).map(one).collect()
    }

    fn version(&self) -> Option<FileStat> {
        Some(self.state.clone())
    }

    fn load_cached(&self, range: &Range<u64>) -> Option<Vec<u8>> {
        self.kept.as_ref()?.get(range)
    }

    fn store_cached(&self, range: &Range<u64>, bytes: &[u8]) {
        let is_other = || {
            self.found
                .as_ref()
                .and_then(|(first, _)| first.get())
                .is_some_and(|found| !found.agrees(&self.state))
        };
        if let Some(kept) = self.kept.as_ref().filter(|_| !is_other()) {
            kept.put(range, bytes);
        }
    }
}
