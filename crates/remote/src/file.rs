//! A file elsewhere: opened by its two ends, read in ranges, all of one state.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use futures_util::StreamExt;
use futures_util::stream;
use object_store::{Attribute, GetOptions, GetRange, GetResult, ObjectMeta};
use spinney_base::io::{Fetch, FileAccess, FileStat, RangeFile};
use spinney_base::{Error, Result};

use super::connections::Connections;
use super::disk_cache::{DiskCache, KeptFile};
use super::store::Place;
use super::{Stores, error, stat};

/// Bytes at a file's beginning that are fetched to open it: the header, and of files that may be Autumnal the meta pages. Small files are
/// opened for little more than these.
const HEAD: u64 = (8 << 10) + 64;
const GOBLIN_HEAD: u64 = 512;
/// Bytes at its end: trailer, metadata, the top of the index, and of files with few segments all of it.
const TAIL: u64 = 24 << 10;

/// Bytes to fetch at the beginning of a file with a name.
fn head_of(url: &str) -> u64 {
    let name = url.split(['?', '#']).next().unwrap_or_default();
    if name.ends_with(".goblin") { GOBLIN_HEAD } else { HEAD }
}

/// Requests of a file at the same time.
const AT_ONCE: usize = 32;

/// A state of a file as text.
fn key(url: &str, state: &FileStat) -> String {
    format!("{url}\n{:?}\n{}", state.version, state.length)
}

/// The way to one file.
struct RemoteFile {
    /// The place, and the process whose connections it has: a forked one makes its own.
    place: Mutex<(u32, Place)>,
    storage: Vec<(String, String)>,
    connections: Arc<Connections>,
    path: PathBuf,
    state: FileStat,
    kept: Option<KeptFile>,
}

/// Opens a file: one round for its two ends.
///
/// # Errors
/// If it is not there, may not be read, or does not come in ranges.
pub(super) fn open(
    url: &str,
    storage: &[(String, String)],
    stores: &Stores,
    access: &FileAccess,
) -> Result<RangeFile> {
    let path = Path::new(url);
    let connections = &stores.connections;
    let place = Place::of(url, storage, connections)?;
    let first = head_of(url);
    let ends = [GetRange::Bounded(0..first), GetRange::Suffix(TAIL)];
    let request = (connections.as_ref(), path, "open");
    let both = async {
        let [head, tail] = ends.map(|range| get(&place, range, request));
        futures_util::future::join(head, tail).await
    };
    let (head, tail) = connections.wait(path, both)?;
    let head = head?.map_err(|cause| cause.of_file(path, "open"))?;
    let state = stat::state(&head.meta);
    let mut came = vec![head];
    let mut requests = 2;
    match tail? {
        Ok(tail) => came.push(tail),
        // Azure knows no ranges from the end.
        Err(Failed::Store(object_store::Error::NotSupported { .. })) if state.length > first => {
            let range = GetRange::Bounded(state.length.saturating_sub(TAIL).max(first)..state.length);
            let tail = connections.wait(path, get(&place, range, request))??;
            came.push(tail.map_err(|cause| cause.of_file(path, "open"))?);
            requests += 1;
        }
        Err(Failed::Store(object_store::Error::NotSupported { .. })) => {}
        Err(failed) => return Err(failed.of_file(path, "open")),
    }
    access.ranges().count_traffic(requests, came.iter().map(|part| part.bytes.len() as u64).sum());
    let key = key(url, &state);
    let kept = stores.folder.as_ref().map(|folder: &Arc<DiskCache>| folder.file(&key));
    let number = stores.number(&key);
    let length = state.length;
    let remote = RemoteFile {
        place: Mutex::new((std::process::id(), place)),
        storage: storage.to_vec(),
        connections: connections.clone(),
        path: path.to_path_buf(),
        state,
        kept,
    };
    came.iter().try_for_each(|part| remote.check(part))?;
    let (cache, gap) = (access.ranges().clone(), connections.options.gap);
    let file = RangeFile::new(path, length, Box::new(remote), (cache, number), gap);
    for part in came {
        file.supply(part.range.start, part.bytes);
    }
    Ok(file)
}

/// A part of a file that came.
struct Part {
    meta: ObjectMeta,
    range: Range<u64>,
    bytes: Vec<u8>,
}

/// Reason why a part has not come.
enum Failed {
    Store(object_store::Error),
    /// The host packs what it sends, in this way.
    Packed(String),
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
            Failed::Packed(how) => {
                let advice = "tell the host to send such files as they are, or copy the file to this machine";
                Error::unsupported(path, format!("a host that compresses what it sends ({how})"), advice)
            }
        }
    }
}

/// Gets a part of a file, in the time that there is for it.
async fn get(
    place: &Place,
    range: GetRange,
    (connections, path, doing): (&Connections, &Path, &'static str),
) -> Result<std::result::Result<Part, Failed>> {
    connections.limited((path, doing), async { Ok(get_part(place, range).await) }).await
}

/// Gets a part of a file.
async fn get_part(place: &Place, range: GetRange) -> std::result::Result<Part, Failed> {
    let options = GetOptions { range: Some(range), ..GetOptions::default() };
    let result: GetResult = place.store.get_opts(&place.name, options).await?;
    if let Some(how) = result.attributes.get(&Attribute::ContentEncoding)
        && !how.as_ref().is_empty()
        && how.as_ref() != "identity"
    {
        return Err(Failed::Packed(how.as_ref().to_string()));
    }
    let (meta, range) = (result.meta.clone(), result.range.clone());
    let bytes = result.bytes().await?;
    Ok(Part { meta, range, bytes: bytes.into() })
}

impl RemoteFile {
    fn place(&self) -> Result<Place> {
        let mut place = self.place.lock().unwrap_or_else(PoisonError::into_inner);
        if place.0 != std::process::id() {
            let url = self.path.to_str().unwrap_or_default();
            *place = (std::process::id(), Place::of(url, &self.storage, &self.connections)?);
        }
        Ok(place.1.clone())
    }

    /// Makes sure that a part is of the state in which the file was opened.
    fn check(&self, part: &Part) -> Result<()> {
        if stat::state(&part.meta) != self.state {
            return Err(Error::Changed { path: self.path.clone(), what: "was overwritten" });
        }
        let length = part.range.end.saturating_sub(part.range.start);
        if part.bytes.len() as u64 != length {
            let place = format!("bytes {} to {}", part.range.start, part.range.end);
            let found = format!("{} bytes", part.bytes.len());
            return Err(Error::corrupt(&self.path, place, found, format!("{length}")));
        }
        Ok(())
    }
}

impl Fetch for RemoteFile {
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        let place = self.place()?;
        let request = (self.connections.as_ref(), self.path.as_path(), "fetch a part");
        let parts = ranges.iter().map(|range| get(&place, GetRange::Bounded(range.clone()), request));
        let all = stream::iter(parts).buffered(AT_ONCE).collect::<Vec<_>>();
        let came = self.connections.wait(&self.path, all)?;
        let one = |(part, range): (Result<std::result::Result<Part, Failed>>, &Range<u64>)| {
            let part = part?.map_err(|cause| cause.of_file(&self.path, "fetch a part"))?;
            self.check(&part)?;
            if part.range != *range {
                let place = format!("bytes {} to {}", range.start, range.end);
                let found = format!("bytes {} to {}", part.range.start, part.range.end);
                return Err(Error::corrupt(&self.path, place, found, "those that were asked for"));
            }
            Ok(part.bytes)
        };
        came.into_iter().zip(ranges).map(one).collect()
    }

    fn version(&self) -> Option<FileStat> {
        Some(self.state.clone())
    }

    fn kept(&self, range: &Range<u64>) -> Option<Vec<u8>> {
        self.kept.as_ref()?.get(range)
    }

    fn keep(&self, range: &Range<u64>, bytes: &[u8]) {
        if let Some(kept) = &self.kept {
            kept.put(range, bytes);
        }
    }
}
