//! Chunks of a file (blocks, segments and table chunks) and the lists that locate them. Chunks are
//! checked on first use, and may be read from any backend.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use super::packed::{Corruption, PLAIN, unpack};
use spinney_base::io::{FileBytes, ReadBackend, Unpacked};
use spinney_base::{Error, Result};
use spinney_container::{Codec, HEADER_SIZE, OpenOptions};
use spinney_packing::PLAIN_BITS;

/// The lists of a file, in file order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum List {
    Faces,
    Segments,
    Exact,
    Objects,
    FaceValues,
    Clusters,
    LevelFaces,
}

impl List {
    pub(crate) const ALL: [List; 7] = [
        List::Faces,
        List::Segments,
        List::Exact,
        List::Objects,
        List::FaceValues,
        List::Clusters,
        List::LevelFaces,
    ];

    /// Returns the name of a chunk, for messages.
    pub(crate) fn chunk_name(self) -> &'static str {
        match self {
            List::Faces => "block of faces",
            List::Segments => "segment",
            List::Exact => "block of exact faces",
            List::Objects => "table of parts",
            List::FaceValues => "table of faces",
            List::Clusters => "table of clusters",
            List::LevelFaces => "block of coarse faces",
        }
    }
}

/// A list entry: key and location of a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    /// A segment's FD code, or the number of a block's first face; ascending.
    pub key: u64,
    pub offset: u64,
    pub length: u32,
    pub checksum: u32,
}

/// Bytes of an entry.
pub(crate) const ENTRY: usize = 24;

impl Entry {
    pub(crate) fn to_bytes(self) -> [u8; ENTRY] {
        let mut bytes = [0; ENTRY];
        bytes[..8].copy_from_slice(&self.key.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.offset.to_le_bytes());
        bytes[16..20].copy_from_slice(&self.length.to_le_bytes());
        bytes[20..].copy_from_slice(&self.checksum.to_le_bytes());
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Entry {
        let eight = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"));
        let four = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
        Entry { key: eight(0), offset: eight(8), length: four(16), checksum: four(20) }
    }
}

/// Fails if chunks take more than the bytes before the lists, which end at `end`. They must not
/// overlap in total, so that the time to read all of them is limited by the file's size.
pub(super) fn check_total(path: &Path, bytes: u64, end: u64) -> Result<()> {
    let available = end.saturating_sub(HEADER_SIZE as u64);
    if bytes <= available {
        return Ok(());
    }
    let found = format!("{bytes} bytes of faces and segments");
    Err(Error::corrupt(path, "lists", found, format!("at most the {available} before the lists")))
}

/// Returns the entry of a list with an index.
#[inline]
fn entry_of(list: &[u8], index: usize) -> Entry {
    // (A mapped file that was truncated in the meantime yields zeros.)
    let bytes = list.get(index * ENTRY..(index + 1) * ENTRY);
    bytes.map_or(Entry { key: 0, offset: 0, length: 0, checksum: 0 }, Entry::from_bytes)
}

/// The chunks of one list.
pub(crate) struct ChunkList {
    kind: List,
    list: ListBytes,
    len: usize,
    /// Limit of the chunks' ends.
    end: u64,
    /// One bit per chunk that was checked.
    checked: Vec<AtomicU64>,
    /// Whether checksums are verified.
    check: bool,
    /// Cache of unpacked chunks, if chunks may be packed.
    unpacked: Option<Unpacked>,
}

/// A list's bytes.
enum ListBytes {
    /// In the mapped file, from this offset on.
    Mapped(usize),
    /// In a file that is not mapped: read from this offset on when first needed. (Lists of large
    /// models take more bytes than the coarse levels, which need a short one only.)
    Deferred(u64, OnceLock<Vec<u8>>),
}

impl ChunkList {
    /// Creates the chunks of a list at an offset of a file, which is mapped or not.
    pub(crate) fn new(
        kind: List,
        codec: Codec,
        (offset, length): (u64, u64),
        is_mapped: bool,
        end: u64,
        options: &OpenOptions,
    ) -> ChunkList {
        let len = length as usize / ENTRY;
        let checked = (0..len.div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        let list = match is_mapped {
            true => ListBytes::Mapped(offset as usize),
            false => ListBytes::Deferred(offset, OnceLock::new()),
        };
        let unpacked = (codec == Codec::Packed).then(|| Unpacked::new(&options.access, PLAIN_BITS));
        ChunkList { kind, list, len, end, checked, check: options.check, unpacked }
    }

    /// Returns the name of a chunk, for messages.
    pub(crate) fn name(&self) -> &'static str {
        self.kind.chunk_name()
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Checks that keys ascend; returns the total bytes of the chunks. A list that is read later is
    /// checked then, and counts as 0 here.
    pub(crate) fn check(&self, path: &Path, backend: &dyn ReadBackend) -> Result<u64> {
        match &self.list {
            ListBytes::Mapped(_) => self.check_entries(path, self.list(path, backend)?),
            ListBytes::Deferred(..) => Ok(0),
        }
    }

    fn check_entries(&self, path: &Path, list: &[u8]) -> Result<u64> {
        let (mut before, mut bytes) = (None, 0u64);
        for index in 0..self.len {
            let Entry { key, length, .. } = entry_of(list, index);
            if before.is_some_and(|before| before >= key) {
                let place = format!("{} {index}", self.name());
                return Err(Error::corrupt(path, place, format!("key {key:x}"), "keys that ascend"));
            }
            before = Some(key);
            // (The sum of less than 2^61 entries of less than 2^32 bytes each may exceed 64 bits.)
            bytes = bytes.saturating_add(length.into());
        }
        Ok(bytes)
    }

    #[inline]
    fn list<'f>(&'f self, path: &Path, backend: &'f dyn ReadBackend) -> Result<&'f [u8]> {
        match &self.list {
            ListBytes::Mapped(start) => {
                Ok(backend.bytes().and_then(|all| all.get(*start..)).unwrap_or_default())
            }
            ListBytes::Deferred(offset, bytes) => match bytes.get() {
                Some(bytes) => Ok(bytes),
                None => {
                    let read = backend.read(*offset, self.len * ENTRY)?;
                    check_total(path, self.check_entries(path, &read)?, self.end)?;
                    Ok(bytes.get_or_init(|| read.into_owned()))
                }
            },
        }
    }

    /// Returns the entry with an index, which must exist.
    #[inline]
    pub(crate) fn entry(&self, path: &Path, backend: &dyn ReadBackend, index: usize) -> Result<Entry> {
        Ok(entry_of(self.list(path, backend)?, index))
    }

    /// Returns the index of the last entry whose key is at most `key`.
    #[inline]
    pub(crate) fn find(&self, path: &Path, backend: &dyn ReadBackend, key: u64) -> Result<Option<usize>> {
        let list = self.list(path, backend)?;
        let (mut low, mut high) = (0, self.len);
        while low < high {
            let middle = (low + high) / 2;
            if entry_of(list, middle).key <= key { low = middle + 1 } else { high = middle }
        }
        Ok(low.checked_sub(1))
    }

    #[inline]
    pub(crate) fn is_checked(&self, index: usize) -> bool {
        self.checked[index / 64].load(Ordering::Relaxed) >> (index % 64) & 1 != 0
    }

    pub(crate) fn set_checked(&self, index: usize) {
        self.checked[index / 64].fetch_or(1 << (index % 64), Ordering::Relaxed);
    }

    /// Loads and unpacks a chunk; verifies its checksum on first use.
    #[inline]
    pub(crate) fn load<'f>(
        &self,
        path: &Path,
        backend: &'f dyn ReadBackend,
        index: usize,
    ) -> Result<FileBytes<'f>> {
        match &self.unpacked {
            None => self.stored(path, backend, index),
            Some(unpacked) => self.unpack(unpacked, path, backend, index),
        }
    }

    /// Loads a chunk that may be packed.
    #[inline(never)]
    fn unpack<'f>(
        &self,
        unpacked: &Unpacked,
        path: &Path,
        backend: &'f dyn ReadBackend,
        index: usize,
    ) -> Result<FileBytes<'f>> {
        if let Some(loaded) = unpacked.get(index as u64) {
            return Ok(FileBytes::Cached(loaded));
        }
        let stored = self.stored(path, backend, index)?;
        if stored.first() == Some(&PLAIN) {
            let length = stored.len();
            return Ok(stored.part(1..length));
        }
        let plain = unpack(self.kind, &stored)
            .map_err(|Corruption(what)| self.corrupt(path, index, what, "a packed chunk"))?;
        Ok(FileBytes::Cached(unpacked.put(index as u64, Arc::new(plain))))
    }

    fn corrupt(&self, path: &Path, index: usize, found: impl Into<String>, expected: &str) -> Error {
        Error::corrupt(path, format!("{} {index}", self.name()), found, expected)
    }

    /// Loads the stored bytes of a chunk; verifies their checksum on first use.
    #[inline]
    pub(crate) fn stored<'f>(
        &self,
        path: &Path,
        backend: &'f dyn ReadBackend,
        index: usize,
    ) -> Result<FileBytes<'f>> {
        let Entry { offset, length, checksum, .. } = self.entry(path, backend, index)?;
        let corrupt = |found: String, expected: &str| self.corrupt(path, index, found, expected);
        if offset.checked_add(u64::from(length)).is_none_or(|end| end > self.end) {
            return Err(corrupt(format!("bytes {offset} + {length}"), "bytes before the lists"));
        }
        let bytes = match backend.bytes() {
            Some(all) => {
                let bytes = all.get(offset as usize..).and_then(|rest| rest.get(..length as usize));
                let bytes = bytes.ok_or_else(|| {
                    corrupt("no bytes".into(), "a file that is not truncated while it is open")
                })?;
                FileBytes::Mapped(bytes)
            }
            None => backend.share(offset, length as usize)?,
        };
        if self.check && !self.is_checked(index) {
            let found = crc32c::crc32c(&bytes);
            if found != checksum {
                return Err(corrupt(format!("checksum {found:08x}"), &format!("{checksum:08x}")));
            }
        }
        Ok(bytes)
    }
}
