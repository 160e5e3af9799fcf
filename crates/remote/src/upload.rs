//! Outputs elsewhere: put there in parts while they are written, whole or not at all.

use std::collections::VecDeque;
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::Arc;

use object_store::{Error as StoreError, MultipartUpload, ObjectStore, ObjectStoreExt, PutMode, PutPayload};
use spinney_base::io::{FileAccess, RangeCache, RemoteWriter, already_exists_error};
use spinney_base::{Error, Result};
use tokio::task::JoinHandle;

use super::connections::Connections;
use super::error;
use super::stat::stat;
use super::store::Place;

/// Bytes of a part, at least; stores want 5 MiB.
const PART: usize = 8 << 20;
/// Parts that a file may have but for a few: stores allow 10,000.
const MAX_PARTS: usize = 9_500;
/// Parts after which they get twice as large, where nobody knows how many bytes there will be.
const DOUBLED: usize = 1_000;
/// Times that they do.
const MAX_DOUBLED: usize = 10;

/// Parts that are on their way at the same time, and bytes of them, unless one has more.
const AT_ONCE: usize = 4;
const MAX_IN_FLIGHT: usize = 64 << 20;

/// A file being uploaded: of no more than a part with one request in the end, of more part by part.
pub(super) struct Upload {
    path: PathBuf,
    place: Place,
    connections: Arc<Connections>,
    /// Cache of the access that the file is written with, which counts requests.
    ranges: Arc<RangeCache>,
    /// Bytes of a part at first, and the number of parts after which they are twice as many.
    part: usize,
    doubled: usize,
    /// The part that is not full yet.
    bytes: Vec<u8>,
    sent: usize,
    /// The parts that the store knows of, until it has put them in their place or given them up.
    parts: Option<Box<dyn MultipartUpload>>,
    /// Parts that are on their way, the oldest first.
    under_way: VecDeque<JoinHandle<object_store::Result<()>>>,
}

impl Upload {
    /// Starts a file. Nothing is asked for yet.
    ///
    /// # Errors
    /// If the URL leads nowhere.
    pub(super) fn new(url: &str, connections: &Arc<Connections>, access: &FileAccess) -> Result<Upload> {
        Ok(Upload {
            path: url.into(),
            place: Place::of(url, &[], connections)?,
            connections: connections.clone(),
            ranges: access.ranges().clone(),
            part: PART,
            doubled: DOUBLED,
            bytes: Vec::new(),
            sent: 0,
            parts: None,
            under_way: VecDeque::new(),
        })
    }

    /// Bytes of the next part.
    fn size(&self) -> usize {
        self.part << (self.sent / self.doubled).min(MAX_DOUBLED)
    }

    fn failed(&self, cause: StoreError) -> Error {
        error::of_store(&self.path, "upload", cause)
    }

    /// Sends what there is as the next part, when there is room on the way.
    fn send(&mut self) -> Result<()> {
        let mut parts = match self.parts.take() {
            Some(parts) => parts,
            None => {
                let begin = self.place.store.put_multipart(&self.place.name);
                let begun = self.connections.wait(&self.path, begin)?;
                begun.map_err(|cause| self.failed(cause))?
            }
        };
        let size = self.bytes.len();
        let part = parts.put_part(PutPayload::from(std::mem::take(&mut self.bytes)));
        self.parts = Some(parts);
        self.under_way.push_back(self.connections.spawn(&self.path, part)?);
        self.sent += 1;
        self.ranges.count_traffic(1, 0);
        let most = (MAX_IN_FLIGHT / size.max(1)).clamp(1, AT_ONCE);
        while self.under_way.len() >= most {
            self.wait_for_one()?;
        }
        Ok(())
    }

    /// Waits for the oldest part on its way, if there is one.
    fn wait_for_one(&mut self) -> Result<()> {
        let Some(mut part) = self.under_way.pop_front() else { return Ok(()) };
        match self.connections.wait(&self.path, &mut part) {
            Ok(Ok(done)) => done.map_err(|cause| self.failed(cause)),
            Ok(Err(cause)) => Err(Error::io(&self.path, "upload")(io::Error::other(cause))),
            Err(stopped) => {
                // (It is given up with the others.)
                self.under_way.push_front(part);
                Err(stopped)
            }
        }
    }

    /// Puts a file that is no more than a part.
    fn put(&mut self, create_new: bool) -> Result<()> {
        let bytes = PutPayload::from(std::mem::take(&mut self.bytes));
        let put = |mode: PutMode| {
            let put = self.place.store.put_opts(&self.place.name, bytes.clone(), mode.into());
            self.ranges.count_traffic(1, 0);
            self.connections.wait(&self.path, put)
        };
        let done = match create_new {
            false => put(PutMode::Overwrite)?,
            true => match put(PutMode::Create)? {
                Err(StoreError::AlreadyExists { .. }) => return Err(already_exists_error(&self.path)),
                Err(StoreError::NotImplemented { .. }) => {
                    self.check_new()?;
                    put(PutMode::Overwrite)?
                }
                done => done,
            },
        };
        done.map(drop).map_err(|cause| self.failed(cause))
    }

    /// Makes sure that there is no file of this name, where the store does not do that by itself: before it is put there, another one may appear.
    fn check_new(&self) -> Result<()> {
        let url = self.path.to_str().unwrap_or_default();
        self.ranges.count_traffic(1, 0);
        match stat(&[url], &self.connections)?.pop() {
            Some(Ok(None)) | None => Ok(()),
            Some(Ok(Some(_))) => Err(already_exists_error(&self.path)),
            Some(Err(error)) => Err(error),
        }
    }
}

impl Write for Upload {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // (A full part waits for the next byte: the last one is sent in the end, and is the only one of a small file.)
        if self.bytes.len() == self.size() && !bytes.is_empty() {
            self.send().map_err(Error::into_io)?;
        }
        let count = bytes.len().min(self.size() - self.bytes.len());
        self.bytes.extend_from_slice(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl RemoteWriter for Upload {
    fn expect(&mut self, bytes: u64) {
        // (What is only about right has some parts to spare.)
        let size = usize::try_from(bytes / (MAX_PARTS as u64 - 500)).unwrap_or(usize::MAX >> MAX_DOUBLED);
        (self.part, self.doubled) = (size.clamp(PART, usize::MAX >> MAX_DOUBLED), MAX_PARTS);
    }

    fn commit(mut self: Box<Self>, create_new: bool) -> Result<()> {
        if self.parts.is_none() {
            return self.put(create_new);
        }
        if !self.bytes.is_empty() {
            self.send()?;
        }
        while !self.under_way.is_empty() {
            self.wait_for_one()?;
        }
        if create_new {
            self.check_new()?;
        }
        let Some(mut parts) = self.parts.take() else { return Ok(()) };
        // (While the store puts them together nobody can tell whether it has.)
        let done = self.connections.finish(&self.path, parts.complete())?;
        done.map(drop).map_err(|cause| {
            self.parts = Some(parts);
            self.failed(cause)
        })
    }
}

impl Drop for Upload {
    fn drop(&mut self) {
        let Some(mut parts) = self.parts.take() else { return };
        for part in std::mem::take(&mut self.under_way) {
            part.abort();
            // (What arrives after all others were given up might stay.)
            let _ = self.connections.finish(&self.path, part);
        }
        // What has arrived would cost its room for good. (If the host cannot be told, there is nobody else to tell.)
        let _ = self.connections.finish(&self.path, parts.abort());
    }
}
