//! Extents: checksummed byte ranges that make up a file after its first three pages.
//!
//! An extent starts at a multiple of 512, and the first extent of a commit at a multiple of 4096.
//! The last extent of a commit is the commit document. All integers are little-endian.
//!
//! ```text
//! file                          extent head (32 bytes)
//! 0: header page                4 bytes: magic "Extt"
//! 4096: first meta slot         1 byte: kind (0 records, 1 commit, 2 metadata, 3 packed records)
//! 8192: second meta slot        3 bytes: padding, 0
//! 12288: extents                8 bytes: offset of this extent in the file
//!                               8 bytes: payload length
//!                               4 bytes: CRC-32C of the payload
//!                               4 bytes: CRC-32C of the 28 bytes before
//!                               followed by the payload
//! ```
//!
//! No index of extents exists. The extent of a record is found by searching the multiples of 512
//! backwards from the record's address for the nearest valid head. Writers guarantee that no value
//! in between looks like a head.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use zerocopy::little_endian::{U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::meta::{Slot, slots};
use super::packed::PackedExtents;
use super::pages::{FIRST_EXTENT, PAGE, SECTOR};
use super::sectors::{MAX_BYTES, Sectors};
use spinney_base::io::{FileBytes, FileStat, ReadBackend};
use spinney_base::{Error, Result};

/// Size of an extent's head in bytes.
pub(super) const HEAD_SIZE: usize = size_of::<RawHead>();
/// Size in bytes after which writers close an extent. A single record can be longer.
pub(super) const FULL_EXTENT: usize = 1 << 16;

/// Maximum payload in bytes of an extent whose content is used. It bounds the memory that an
/// untrusted length can request.
const MAX_WHOLE: u64 = 16 << 20;
/// Bytes to prefetch for an extent that is read as a whole. Most such extents are shorter.
const WHOLE_READ: u64 = 16 << 10;
/// Maximum number of extents to remember in a file that is not mapped or has packed records.
const MAX_READ: usize = 1 << 16;
/// Bytes per read when only their checksum is needed.
const CHECK_BYTES: u64 = 1 << 20;

/// Magic number of an extent.
pub(super) const EXTENT_MAGIC: [u8; 4] = *b"Extt";

/// Content of an extent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ExtentKind {
    Records,
    Commit,
    Metadata,
    Packed,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawHead {
    magic: [u8; 4],
    kind: u8,
    zero: [u8; 3],
    /// Offset of the extent in the file. It keeps copies of extents at other offsets from being
    /// accepted.
    start: U64,
    /// Payload length in bytes.
    length: U64,
    /// Checksum of the payload.
    checksum: U32,
    /// Checksum of the head's bytes before this field.
    head_checksum: U32,
}

/// Returns the head of an extent at offset `start`.
pub(super) fn head(kind: ExtentKind, start: u64, payload: &[u8]) -> [u8; HEAD_SIZE] {
    let mut raw = RawHead {
        magic: EXTENT_MAGIC,
        kind: kind as u8,
        zero: [0; 3],
        start: start.into(),
        length: (payload.len() as u64).into(),
        checksum: crc32c::crc32c(payload).into(),
        head_checksum: 0.into(),
    };
    raw.head_checksum = crc32c::crc32c(&raw.as_bytes()[..HEAD_SIZE - 4]).into();
    raw.as_bytes().try_into().expect("as long as it is")
}

/// Decoded head of an extent that ends within the commit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    pub(super) kind: u8,
    start: u64,
    length: u64,
    checksum: u32,
}

impl Extent {
    /// Returns the offset of the payload.
    fn payload_start(&self) -> u64 {
        self.start + HEAD_SIZE as u64
    }

    pub(super) fn end(&self) -> u64 {
        self.payload_start() + self.length
    }

    /// Returns whether `address` can be a record's in this extent. Packed records are addressed by
    /// number, and all their addresses are in the extent's first sector.
    fn may_have(&self, address: u64) -> bool {
        let end = if self.kind == ExtentKind::Packed as u8 { self.start + SECTOR } else { self.end() };
        (self.payload_start()..end).contains(&address)
    }

    /// Returns the offset of the next extent. A commit's extent is its last one; anything up to the
    /// next page is left over from a cancelled edit.
    pub(super) fn next_start(&self) -> u64 {
        let unit = if self.kind == ExtentKind::Commit as u8 { PAGE } else { SECTOR };
        self.end().next_multiple_of(unit)
    }
}

/// Extents of a file up to some commit. They are read on demand, and each is checked before its
/// first use.
pub(super) struct Extents {
    pub(super) path: PathBuf,
    backend: Box<dyn ReadBackend>,
    /// File version at the time of opening.
    pub(super) version: Option<FileStat>,
    /// End of the commit; later bytes do not belong to it.
    pub(super) end: u64,
    /// Sectors of record extents that passed their check.
    verified: Sectors,
    /// Recently read record extents by offset, if the file is not mapped or has packed records.
    read: Mutex<BTreeMap<u64, Extent>>,
    check: bool,
    /// Reader of packed records, if the file may have any.
    packed: Option<Arc<PackedExtents>>,
}

/// Access to the bytes of record extents, either mapped or read. Functions that are generic over it
/// are compiled twice.
pub(super) trait ByteAccess<'a>: Copy {
    /// Borrowed or shared bytes.
    type Bytes: Deref<Target = [u8]>;

    /// Returns bytes of a record from `address` on, at least `most` unless they end before. The
    /// record's extent is checked.
    ///
    /// In a file that is not mapped, or has packed records, they end with the extent. In a mapped
    /// file they end with the commit, whatever `most` is: so a crafted record that claims to be
    /// longer than its extent is read from bytes that were not checked, although within bounds.
    /// Writers never split records, and verification reports such a record.
    fn bytes(self, address: u64, most: usize) -> Result<Self::Bytes>;
}

/// Bytes of a mapped or in-memory file, used without copying.
#[derive(Clone, Copy)]
pub(super) struct MappedBytes<'a> {
    extents: &'a Extents,
    bytes: &'a [u8],
}

impl<'a> ByteAccess<'a> for MappedBytes<'a> {
    type Bytes = &'a [u8];

    #[inline]
    fn bytes(self, address: u64, _: usize) -> Result<&'a [u8]> {
        self.extents.check_at(address)?;
        // (Whole sectors pass the check, so an address in the last one can be after the commit.)
        Ok(self.bytes.get(address as usize..).unwrap_or_default())
    }
}

/// Reads each extent as a whole, unless the file is mapped, and returns at most `most` bytes.
impl<'a> ByteAccess<'a> for &'a Extents {
    type Bytes = FileBytes<'a>;

    fn bytes(self, address: u64, most: usize) -> Result<FileBytes<'a>> {
        if let Some(mapped) = self.mapped() {
            return mapped
                .bytes(address, most)
                .map(|bytes| FileBytes::Mapped(&bytes[..most.min(bytes.len())]));
        }
        let extent = self.read_extent(address)?;
        let bytes = self.payload(&extent)?;
        if let Some(packed) = self.packed.as_ref().filter(|_| extent.kind == ExtentKind::Packed as u8) {
            let record = packed.record(extent.start, address, &bytes);
            let record = record.map_err(|found| {
                self.corrupt(format!("extent at {}", extent.start), found, "packed records")
            })?;
            let end = most.min(record.len());
            return Ok(FileBytes::Cached(record.part(0..end)));
        }
        let start = (address - extent.payload_start()) as usize;
        let end = start.saturating_add(most).min(bytes.len());
        Ok(bytes.part(start..end))
    }
}

impl Extents {
    /// Creates the extents of `backend` up to `end`, which must not exceed the backend's length.
    ///
    /// # Errors
    /// If `end` exceeds the supported file size.
    pub(super) fn new(path: &Path, backend: Box<dyn ReadBackend>, end: u64, check: bool) -> Result<Extents> {
        if end > MAX_BYTES {
            let found = format!("a commit that ends at byte {end}");
            return Err(Error::unsupported(
                path,
                found,
                format!("the maximum file size is {MAX_BYTES} bytes"),
            ));
        }
        let (verified, version) = (Sectors::new(end), backend.version()?);
        Ok(Extents {
            path: path.to_path_buf(),
            backend,
            version,
            end,
            verified,
            read: Mutex::default(),
            check,
            packed: None,
        })
    }

    /// Adds the reader of packed records, if the file may have any.
    pub(super) fn with_packed(self, packed: Option<Arc<PackedExtents>>) -> Extents {
        Extents { packed, ..self }
    }

    /// Returns the reader of packed records, if the file may have any.
    pub(super) fn packed(&self) -> Option<&Arc<PackedExtents>> {
        self.packed.as_ref()
    }

    /// Reads both meta slots in their current state.
    pub(super) fn slots(&self) -> Result<[Slot; 2]> {
        slots(&*self.backend)
    }

    /// Returns the current version of the file.
    pub(super) fn stat(&self) -> Result<Option<FileStat>> {
        self.backend.stat()
    }

    /// Queries the host of a remote file whether the file is still the version that was opened.
    pub(super) fn check_remote(&self) -> Result<()> {
        self.backend.check_remote()
    }

    /// Returns the backend.
    pub(super) fn into_backend(self) -> Box<dyn ReadBackend> {
        self.backend
    }

    pub(super) fn file_size(&self) -> u64 {
        self.backend.len()
    }

    pub(super) fn corrupt(
        &self,
        place: impl Into<String>,
        found: impl Into<String>,
        expected: &str,
    ) -> Error {
        Error::corrupt(&self.path, place, found, expected)
    }

    /// Returns all bytes up to the end of the commit if the file is mapped or in memory and has no
    /// packed records. Reading many records then takes no backend call per record.
    #[inline]
    pub(super) fn mapped(&self) -> Option<MappedBytes<'_>> {
        if self.packed.is_some() {
            return None;
        }
        let bytes = self.backend.bytes()?.get(..self.end as usize)?;
        Some(MappedBytes { extents: self, bytes })
    }

    /// Checks the record extent that contains `address`, unless that has been done.
    #[inline]
    fn check_at(&self, address: u64) -> Result<()> {
        if self.verified.contains(address / SECTOR) { Ok(()) } else { self.verify_extent(address) }
    }

    /// Returns the payload of an extent.
    fn payload(&self, extent: &Extent) -> Result<FileBytes<'_>> {
        let (start, length) = (extent.payload_start(), extent.length as usize);
        let Some(all) = self.backend.bytes() else { return self.backend.share(start, length) };
        // (A file that was truncated since has fewer bytes.)
        let bytes = all.get(start as usize..).and_then(|rest| rest.get(..length));
        Ok(FileBytes::Mapped(bytes.unwrap_or_default()))
    }

    /// Returns the checked record extent that contains `address`, for files that are not mapped or
    /// have packed records.
    fn read_extent(&self, address: u64) -> Result<Extent> {
        let read = || self.read.lock().unwrap_or_else(PoisonError::into_inner);
        let known = read().range(..=address).next_back().map(|(_, extent)| *extent);
        if let Some(extent) = known.filter(|extent| extent.may_have(address)) {
            return Ok(extent);
        }
        self.check_at(address)?;
        let extent = self.extent_of(address)?;
        let mut read = read();
        // (It does not matter which ones are forgotten: finding one again takes one search.)
        if read.len() >= MAX_READ {
            read.clear();
        }
        read.insert(extent.start, extent);
        Ok(extent)
    }

    /// Finds the record extent that contains `address`, checks it, and marks its sectors as
    /// verified.
    #[cold]
    fn verify_extent(&self, address: u64) -> Result<()> {
        let extent = self.extent_of(address)?;
        if self.check {
            self.check_payload(&extent)?;
        }
        (extent.start / SECTOR..extent.end().div_ceil(SECTOR))
            .for_each(|sector| self.verified.insert(sector));
        Ok(())
    }

    /// Returns the address range of the record extent that contains `address`; in a packed extent,
    /// the range from that record to the end of the extent.
    ///
    /// (This is stricter than reading. Readers remember which sectors were checked, so they accept
    /// an address in the head or the padding of an extent if its sectors were checked before.)
    pub(super) fn records_at(&self, address: u64) -> Result<Range<u64>> {
        let extent = self.extent_of(address)?;
        if extent.kind == ExtentKind::Packed as u8 {
            return Ok(address..address + ByteAccess::bytes(self, address, usize::MAX)?.len() as u64);
        }
        Ok(extent.payload_start()..extent.end())
    }

    fn extent_of(&self, address: u64) -> Result<Extent> {
        let outside = || {
            let found = format!("a pointer to byte {address}");
            self.corrupt("record", found, "a pointer to a record of this commit")
        };
        if address < FIRST_EXTENT || address >= self.end {
            return Err(outside());
        }
        // Search back to the nearest head, but no further than the longest extent: a file may be
        // nearly all holes.
        let mut start = address / SECTOR * SECTOR;
        let first = address.saturating_sub(MAX_WHOLE + HEAD_SIZE as u64).max(FIRST_EXTENT);
        let mut fetched = start + 1;
        let extent = loop {
            if start < fetched {
                // (Nearly all extents are at most that long, so this has the head and the rest of
                // the extent.)
                let around = start.saturating_sub(FULL_EXTENT as u64).max(FIRST_EXTENT);
                let end = (address + FULL_EXTENT as u64).min(self.end);
                self.backend.prefetch(std::slice::from_ref(&(around..end.max(around))))?;
                fetched = around;
            }
            if let Some(extent) = self.extent_at(start)? {
                break extent;
            }
            if start <= first {
                return Err(outside());
            }
            start -= SECTOR;
        };
        let is_kind = extent.kind == ExtentKind::Records as u8
            || extent.kind == ExtentKind::Packed as u8 && self.packed.is_some();
        let is_good = is_kind && extent.may_have(address) && extent.length <= MAX_WHOLE;
        if is_good { Ok(extent) } else { Err(outside()) }
    }

    /// Returns the extent that starts at offset `start`, if there is one.
    pub(super) fn extent_at(&self, start: u64) -> Result<Option<Extent>> {
        Ok(self.head_at(start)?.filter(|extent| extent.length <= self.end - extent.payload_start()))
    }

    /// Returns whether an extent starts at `start` whose payload exceeds the end of the commit.
    pub(super) fn reaches_beyond(&self, start: u64) -> Result<bool> {
        Ok(self.head_at(start)?.is_some_and(|extent| extent.length > self.end - extent.payload_start()))
    }

    /// Returns the extent that starts at `start`, if there is one, whatever its length.
    fn head_at(&self, start: u64) -> Result<Option<Extent>> {
        if start < FIRST_EXTENT || self.end.saturating_sub(start) < HEAD_SIZE as u64 {
            return Ok(None);
        }
        let bytes = self.backend.read(start, HEAD_SIZE)?;
        let Ok(raw) = RawHead::ref_from_bytes(&bytes) else { return Ok(None) };
        let is_head = raw.magic == EXTENT_MAGIC
            && raw.start.get() == start
            && raw.head_checksum.get() == crc32c::crc32c(&bytes[..HEAD_SIZE - 4]);
        let (length, checksum) = (raw.length.get(), raw.checksum.get());
        Ok(is_head.then_some(Extent { kind: raw.kind, start, length, checksum }))
    }

    /// Checks an extent's checksum in chunks: heads in untrusted files may claim any length up to
    /// the end, and callers that go from extent to extent do not limit it to [`MAX_WHOLE`].
    pub(super) fn check_payload(&self, extent: &Extent) -> Result<()> {
        let (mut at, mut checksum) = (extent.payload_start(), 0);
        while at < extent.end() {
            let length = (extent.end() - at).min(CHECK_BYTES);
            checksum = crc32c::crc32c_append(checksum, &self.backend.read(at, length as usize)?);
            at += length;
        }
        self.compare(extent, checksum)
    }

    fn compare(&self, extent: &Extent, checksum: u32) -> Result<()> {
        if checksum == extent.checksum {
            return Ok(());
        }
        let place = format!("extent at {}", extent.start);
        Err(self.corrupt(place, format!("checksum {checksum:08x}"), &format!("{:08x}", extent.checksum)))
    }

    /// Returns the checked payload of the extent of `kind` at offset `start`.
    pub(super) fn whole(&self, kind: ExtentKind, start: u64) -> Result<Cow<'_, [u8]>> {
        let near = (start + WHOLE_READ).min(self.end);
        self.backend.prefetch(std::slice::from_ref(&(start.min(near)..near)))?;
        let extent = self.extent_at(start)?.filter(|extent| extent.kind == kind as u8);
        let extent = extent.ok_or_else(|| {
            self.corrupt(format!("byte {start}"), "no such extent", &format!("an extent of kind {kind:?}"))
        })?;
        if extent.length > MAX_WHOLE {
            let found = format!("{} bytes", extent.length);
            return Err(self.corrupt(format!("extent at {start}"), found, "at most 16 MiB"));
        }
        let bytes = self.backend.read(extent.payload_start(), extent.length as usize)?;
        self.compare(&extent, crc32c::crc32c(&bytes))?;
        Ok(bytes)
    }
}
