//! Remote outputs: uploaded in parts while they are written, and published atomically.

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
use super::store::ObjectLocation;

/// Minimum bytes of a part. Stores require at least 5 MiB.
const PART: usize = 8 << 20;
/// Target for the number of parts of a file. Stores allow 10,000.
const MAX_PARTS: usize = 9_500;
/// Number of parts after which the part size doubles, if the file size is unknown.
const DOUBLED: usize = 1_000;
/// Maximum number of doublings.
const MAX_DOUBLED: usize = 10;

/// Maximum number of parts in flight, and of their bytes unless one part has more.
const AT_ONCE: usize = 4;
const MAX_IN_FLIGHT: usize = 64 << 20;

/// A file being uploaded. One that fits one part is sent with a single request on commit, a larger
/// one as multipart upload.
pub(super) struct Upload {
    path: PathBuf,
    location: ObjectLocation,
    connections: Arc<Connections>,
    /// Cache of the access that the file is written with. It counts requests.
    ranges: Arc<RangeCache>,
    /// Initial part size in bytes, and the number of parts after which it doubles.
    part: usize,
    doubled: usize,
    /// The part that is being filled.
    bytes: Vec<u8>,
    sent: usize,
    /// The multipart upload at the store, until it is completed or aborted.
    parts: Option<Box<dyn MultipartUpload>>,
    /// Parts in flight, the oldest first.
    under_way: VecDeque<JoinHandle<object_store::Result<()>>>,
}

impl Upload {
    /// Starts a file. Sends no request yet.
    ///
    /// # Errors
    /// If the URL is invalid.
    pub(super) fn new(url: &str, connections: &Arc<Connections>, access: &FileAccess) -> Result<Upload> {
        Ok(Upload {
            path: url.into(),
            location: ObjectLocation::of(url, &[], connections)?,
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

    /// Size of the next part in bytes.
    fn size(&self) -> usize {
        self.part << (self.sent / self.doubled).min(MAX_DOUBLED)
    }

    fn failed(&self, cause: StoreError) -> Error {
        error::of_store(&self.path, "upload", cause)
    }

    /// Sends the buffer as the next part, and waits while too many parts are in flight.
    fn send(&mut self) -> Result<()> {
        let mut parts = match self.parts.take() {
            Some(parts) => parts,
            None => {
                let begin = self.location.store.put_multipart(&self.location.name);
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

    /// Waits for the oldest part in flight, if there is one.
    fn wait_for_one(&mut self) -> Result<()> {
        let Some(mut part) = self.under_way.pop_front() else { return Ok(()) };
        match self.connections.wait(&self.path, &mut part) {
            Ok(Ok(done)) => done.map_err(|cause| self.failed(cause)),
            Ok(Err(cause)) => Err(Error::io(&self.path, "upload")(io::Error::other(cause))),
            Err(stopped) => {
                // Dropping the upload aborts it with the others.
                self.under_way.push_front(part);
                Err(stopped)
            }
        }
    }

    /// Uploads a file that fits one part.
    fn put(&mut self, create_new: bool) -> Result<()> {
        let bytes = PutPayload::from(std::mem::take(&mut self.bytes));
        let put = |mode: PutMode| {
            let put = self.location.store.put_opts(&self.location.name, bytes.clone(), mode.into());
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

    /// Checks that no file of this name exists, if the store cannot do so atomically: another one
    /// may appear before this file is published.
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
        // A full part is sent when the next byte arrives. The last part is sent on commit, and is
        // the only one of a small file.
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
        // Leaves spare parts, since the announced size may be approximate.
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
        // Not cancellable: until the store responds, it is unknown whether the file was published.
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
            // Wait: a part that arrives after the upload was aborted might be stored forever.
            let _ = self.connections.finish(&self.path, part);
        }
        // Stored parts of an unfinished upload would be billed. If the abort fails, nothing more
        // can be done.
        let _ = self.connections.finish(&self.path, parts.abort());
    }
}
