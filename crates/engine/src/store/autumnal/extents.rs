//! Extents: checksummed runs of bytes, from which everything but the first three pages of a file is made.

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

/// Bytes of an extent's head.
pub(super) const HEAD_SIZE: usize = size_of::<RawHead>();
/// An extent with more bytes than this is closed; one record can be longer.
pub(super) const FULL_EXTENT: usize = 1 << 16;

/// Bytes of the longest extent, behind its head. A hostile length must not ask for more.
const MAX_WHOLE: u64 = 16 << 20;
/// Bytes behind the start of an extent that is read as a whole which have most of those.
const WHOLE_READ: u64 = 16 << 10;
/// Extents of a file that is not mapped whose places are remembered.
const MAX_READ: usize = 1 << 16;
/// Bytes that are read at a time where only their checksum is wanted.
const CHECK_BYTES: u64 = 1 << 20;

/// First bytes of an extent.
pub(super) const EXTENT_MAGIC: [u8; 4] = *b"Extt";

/// The content of an extent.
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
    /// Offset of the extent in the file, so that bytes that were moved are not taken for one.
    start: U64,
    /// Bytes behind the head.
    length: U64,
    /// Checksum of these.
    checksum: U32,
    /// Checksum of the head before this.
    head_checksum: U32,
}

/// The head of an extent that starts at `start`.
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

/// An extent as its head tells; it ends within the commit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    pub(super) kind: u8,
    start: u64,
    length: u64,
    checksum: u32,
}

impl Extent {
    /// Offset of its bytes, behind the head.
    fn payload_start(&self) -> u64 {
        self.start + HEAD_SIZE as u64
    }

    pub(super) fn end(&self) -> u64 {
        self.payload_start() + self.length
    }

    /// Whether a record may have an address: one of packed records is told by its number, all of which are in the first sector.
    fn may_have(&self, address: u64) -> bool {
        let end = if self.kind == ExtentKind::Packed as u8 { self.start + SECTOR } else { self.end() };
        (self.payload_start()..end).contains(&address)
    }

    /// Where the extent behind this one starts. A commit's is its last one: before the next page there can only be what an
    /// edit that was given up has left.
    pub(super) fn next_start(&self) -> u64 {
        let unit = if self.kind == ExtentKind::Commit as u8 { PAGE } else { SECTOR };
        self.end().next_multiple_of(unit)
    }
}

/// The extents of a file up to some commit, read as they are asked for, each checked before its first use.
pub(super) struct Extents {
    pub(super) path: PathBuf,
    backend: Box<dyn ReadBackend>,
    /// Version of the file when it was opened.
    pub(super) version: Option<FileStat>,
    /// End of the commit: what is behind does not belong to it.
    pub(super) end: u64,
    /// Sectors of extents of records that were found to be good.
    verified: Sectors,
    /// Extents among these that were read lately, by their starts, if the file is not mapped.
    read: Mutex<BTreeMap<u64, Extent>>,
    check: bool,
    /// How packed records are read, if there are any.
    packed: Option<Arc<PackedExtents>>,
}

/// One of the two ways to the bytes of extents of records. What is generic over it exists twice.
pub(super) trait ByteAccess<'a>: Copy {
    /// Some bytes.
    type Bytes: Deref<Target = [u8]>;

    /// Bytes of an extent of records from an address on: `most`, or more where that costs nothing, or fewer
    /// at the commit's end.
    fn bytes(self, address: u64, most: usize) -> Result<Self::Bytes>;
}

/// The bytes of a mapped file, or of one in memory: they are used where they stand.
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
        // (What is not within the extents was not found to be good.)
        Ok(self.bytes.get(address as usize..).unwrap_or_default())
    }
}

/// Bytes that are read, each extent as a whole; no more than were asked for.
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
                self.corrupt(format!("extent at {}", extent.start), found, "records that were packed")
            })?;
            let end = most.min(record.len());
            return Ok(FileBytes::Held(record.part(0..end)));
        }
        let start = (address - extent.payload_start()) as usize;
        let end = start.saturating_add(most).min(bytes.len());
        Ok(bytes.part(start..end))
    }
}

impl Extents {
    /// The extents in a backend up to `end`, which must not lie behind the backend's own.
    ///
    /// # Errors
    /// If that is further than any file reaches.
    pub(super) fn new(path: &Path, backend: Box<dyn ReadBackend>, end: u64, check: bool) -> Result<Extents> {
        if end > MAX_BYTES {
            let found = format!("a commit that ends at byte {end}");
            return Err(Error::unsupported(path, found, format!("files may have {MAX_BYTES} bytes")));
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

    /// Extents of which some may be packed.
    pub(super) fn with_packed(self, packed: Option<Arc<PackedExtents>>) -> Extents {
        Extents { packed, ..self }
    }

    /// How packed records are read, if there are any.
    pub(super) fn packed(&self) -> Option<&Arc<PackedExtents>> {
        self.packed.as_ref()
    }

    /// Both meta slots as they are now.
    pub(super) fn slots(&self) -> Result<[Slot; 2]> {
        slots(&*self.backend)
    }

    /// Version of the file as it is now.
    pub(super) fn stat(&self) -> Result<Option<FileStat>> {
        self.backend.stat()
    }

    /// Queries the host of a remote file whether it still is the version that was opened.
    pub(super) fn check_remote(&self) -> Result<()> {
        self.backend.check_remote()
    }

    /// Gives the backend back.
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

    /// All bytes up to the commit's end where they are, if they can be seen and no record is packed: many records are then read
    /// without asking the backend for each.
    #[inline]
    pub(super) fn mapped(&self) -> Option<MappedBytes<'_>> {
        if self.packed.is_some() {
            return None;
        }
        let bytes = self.backend.bytes()?.get(..self.end as usize)?;
        Some(MappedBytes { extents: self, bytes })
    }

    /// Makes sure that the extent of records that an address is in is good.
    #[inline]
    fn check_at(&self, address: u64) -> Result<()> {
        if self.verified.contains(address / SECTOR) { Ok(()) } else { self.verify_extent(address) }
    }

    /// The bytes of an extent behind its head.
    fn payload(&self, extent: &Extent) -> Result<FileBytes<'_>> {
        let (start, length) = (extent.payload_start(), extent.length as usize);
        let Some(all) = self.backend.bytes() else { return self.backend.share(start, length) };
        // (A file that was cut short since has fewer.)
        let bytes = all.get(start as usize..).and_then(|rest| rest.get(..length));
        Ok(FileBytes::Mapped(bytes.unwrap_or_default()))
    }

    /// The extent of records that an address is in, which is good, of a file that is not mapped, or has packed records.
    fn read_extent(&self, address: u64) -> Result<Extent> {
        let read = || self.read.lock().unwrap_or_else(PoisonError::into_inner);
        let known = read().range(..=address).next_back().map(|(_, extent)| *extent);
        if let Some(extent) = known.filter(|extent| extent.may_have(address)) {
            return Ok(extent);
        }
        self.check_at(address)?;
        let extent = self.extent_of(address)?;
        let mut read = read();
        // (Which of them are forgotten does not matter: finding one again costs a look.)
        if read.len() >= MAX_READ {
            read.clear();
        }
        read.insert(extent.start, extent);
        Ok(extent)
    }

    /// Finds the extent of records that an address is in, checks it, and remembers that it is good.
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

    /// The addresses of bytes, behind the head, of the extent of records that an address is in; of one that is packed, of those of that record and what is
    /// behind it. (To readers any byte is in it that is in
    /// one of its sectors.)
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
            self.corrupt("record", found, "one to a record of this commit")
        };
        if address < FIRST_EXTENT || address >= self.end {
            return Err(outside());
        }
        // Back to the nearest head, but no further than an extent can be long: a file may be nearly all holes.
        let mut start = address / SECTOR * SECTOR;
        let first = address.saturating_sub(MAX_WHOLE + HEAD_SIZE as u64).max(FIRST_EXTENT);
        let mut fetched = start + 1;
        let extent = loop {
            if start < fetched {
                // (Nearly all extents are that long: this has the head and all that is behind it.)
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

    /// The extent that starts at an offset of the file, if there is one.
    pub(super) fn extent_at(&self, start: u64) -> Result<Option<Extent>> {
        Ok(self.head_at(start)?.filter(|extent| extent.length <= self.end - extent.payload_start()))
    }

    /// Whether an extent starts at an offset of the file that is longer than what there is.
    pub(super) fn reaches_beyond(&self, start: u64) -> Result<bool> {
        Ok(self.head_at(start)?.is_some_and(|extent| extent.length > self.end - extent.payload_start()))
    }

    /// The extent that starts at an offset of the file, if there is one, however long it says that it is.
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

    /// Checks the bytes of an extent, piece by piece: extents of records may be as long as the file.
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

    /// All bytes of the extent of a kind that starts at an offset of the file, checked.
    pub(super) fn whole(&self, kind: ExtentKind, start: u64) -> Result<Cow<'_, [u8]>> {
        let near = (start + WHOLE_READ).min(self.end);
        self.backend.prefetch(std::slice::from_ref(&(start.min(near)..near)))?;
        let extent = self.extent_at(start)?.filter(|extent| extent.kind == kind as u8);
        let extent = extent.ok_or_else(|| {
            self.corrupt(format!("byte {start}"), "something else", &format!("an extent of kind {kind:?}"))
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
