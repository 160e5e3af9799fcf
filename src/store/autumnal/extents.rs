//! Extents: checksummed runs of bytes, from which everything but the first three pages of a file is made.

use std::borrow::Cow;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use zerocopy::little_endian::{U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use crate::store::Storage;
use crate::{Error, Result};

/// Extents start at multiples of this: a sector, which disks write whole or not at all.
pub(super) const GRAIN: u64 = 512;
/// Commits start at multiples of this, so that no page with older bytes is written again.
pub(super) const PAGE: u64 = 4096;
/// Where the first extent can start: behind the header's page and those of the two meta slots.
pub(super) const FIRST: u64 = 3 * PAGE;
/// Bytes of an extent's head.
pub(super) const HEAD: usize = size_of::<RawHead>();
/// An extent with more bytes than this is closed; one record can be longer.
pub(super) const LONG: usize = 1 << 16;

const MAGIC: [u8; 4] = *b"Extt";

/// What is in an extent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ExtentKind {
    Records,
    Commit,
    Metadata,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawHead {
    magic: [u8; 4],
    kind: u8,
    zero: [u8; 3],
    /// Where the extent starts, so that bytes that were moved are not taken for one.
    start: U64,
    /// Bytes behind the head.
    length: U64,
    /// Of these.
    checksum: U32,
    /// Of the head before this.
    head_checksum: U32,
}

/// The head of an extent that starts at `start`.
pub(super) fn head(kind: ExtentKind, start: u64, payload: &[u8]) -> [u8; HEAD] {
    let mut raw = RawHead {
        magic: MAGIC,
        kind: kind as u8,
        zero: [0; 3],
        start: start.into(),
        length: (payload.len() as u64).into(),
        checksum: crc32c::crc32c(payload).into(),
        head_checksum: 0.into(),
    };
    raw.head_checksum = crc32c::crc32c(&raw.as_bytes()[..HEAD - 4]).into();
    raw.as_bytes().try_into().expect("as long as it is")
}

/// The extents of a file up to some commit, read as they are asked for, each checked before its first use.
pub(super) struct Extents {
    pub(super) path: PathBuf,
    storage: Box<dyn Storage>,
    /// Where the commit ends: what is behind does not belong to it.
    pub(super) end: u64,
    /// One bit per grain of extents of records that were found to be good.
    good: Vec<AtomicU64>,
    check: bool,
}

/// Bytes of extents, the one way or the other.
pub(super) trait Reach<'a>: Copy {
    /// Some bytes.
    type Bytes: Deref<Target = [u8]>;

    /// As [`Extents::bytes`]; there may be more than `most`.
    fn bytes(self, address: u64, most: usize) -> Result<Self::Bytes>;
}

/// The bytes of a mapped file.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    extents: &'a Extents,
    bytes: &'a [u8],
}

impl<'a> Reach<'a> for Seen<'a> {
    type Bytes = &'a [u8];

    #[inline]
    fn bytes(self, address: u64, _: usize) -> Result<&'a [u8]> {
        self.extents.check_at(address)?;
        // (What is not within the extents was not found good.)
        Ok(self.bytes.get(address as usize..).unwrap_or_default())
    }
}

impl<'a> Reach<'a> for &'a Extents {
    type Bytes = Cow<'a, [u8]>;

    fn bytes(self, address: u64, most: usize) -> Result<Cow<'a, [u8]>> {
        Extents::bytes(self, address, most)
    }
}

/// An extent's place, as its head tells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) kind: u8,
    start: u64,
    length: u64,
    checksum: u32,
}

impl Place {
    /// Where its bytes start, behind the head.
    pub(super) fn first(&self) -> u64 {
        self.start + HEAD as u64
    }

    pub(super) fn end(&self) -> u64 {
        self.first() + self.length
    }
}

impl Extents {
    /// What a storage holds up to `end`, which must not lie behind its own.
    pub(super) fn new(path: &Path, storage: Box<dyn Storage>, end: u64, check: bool) -> Extents {
        let words = end.div_ceil(GRAIN).div_ceil(64);
        let good = (0..words).map(|_| AtomicU64::new(0)).collect();
        Extents { path: path.to_path_buf(), storage, end, good, check }
    }

    pub(super) fn file_size(&self) -> u64 {
        self.storage.len()
    }

    pub(super) fn corrupt(
        &self,
        place: impl Into<String>,
        found: impl Into<String>,
        expected: &str,
    ) -> Error {
        Error::corrupt(&self.path, place, found, expected)
    }

    /// Makes sure that the extent of records that an address is in is good.
    #[inline]
    fn check_at(&self, address: u64) -> Result<()> {
        let grain = address / GRAIN;
        let word = self.good.get((grain / 64) as usize).map_or(0, |word| word.load(Ordering::Relaxed));
        if word >> (grain % 64) & 1 == 0 { self.admit(address) } else { Ok(()) }
    }

    /// Bytes of an extent of records from an address on, up to `most`; fewer at the end of the file.
    pub(super) fn bytes(&self, address: u64, most: usize) -> Result<Cow<'_, [u8]>> {
        self.check_at(address)?;
        let rest = self.end.saturating_sub(address);
        self.storage.read(address, rest.min(most as u64) as usize)
    }

    /// All bytes where they are, if they can be seen: many records are then read without asking for each.
    #[inline]
    pub(super) fn seen(&self) -> Option<Seen<'_>> {
        let bytes = self.storage.bytes()?.get(..self.end as usize)?;
        Some(Seen { extents: self, bytes })
    }

    /// Checks the extent of records that an address is in.
    #[cold]
    fn admit(&self, address: u64) -> Result<()> {
        let outside = || {
            let found = format!("a pointer to byte {address}");
            self.corrupt("record", found, "one to a record of this commit")
        };
        if address < FIRST || address >= self.end {
            return Err(outside());
        }
        // Extents are short, but for one with a very long record.
        let mut start = address / GRAIN * GRAIN;
        let place = loop {
            if let Some(place) = self.head_at(start)? {
                break place;
            }
            if start <= FIRST {
                return Err(outside());
            }
            start -= GRAIN;
        };
        if place.kind != ExtentKind::Records as u8 || !(place.first()..place.end()).contains(&address) {
            return Err(outside());
        }
        if self.check {
            self.payload(&place)?;
        }
        for grain in place.start / GRAIN..place.end().div_ceil(GRAIN) {
            self.good[(grain / 64) as usize].fetch_or(1 << (grain % 64), Ordering::Relaxed);
        }
        Ok(())
    }

    /// The extent that starts at a place, if there is one.
    pub(super) fn head_at(&self, start: u64) -> Result<Option<Place>> {
        if start < FIRST || self.end.saturating_sub(start) < HEAD as u64 {
            return Ok(None);
        }
        let bytes = self.storage.read(start, HEAD)?;
        let Ok(raw) = RawHead::ref_from_bytes(&bytes) else { return Ok(None) };
        let fits = raw.length.get() <= self.end - start - HEAD as u64;
        let is_head = raw.magic == MAGIC
            && raw.start.get() == start
            && fits
            && raw.head_checksum.get() == crc32c::crc32c(&bytes[..HEAD - 4]);
        let (length, checksum) = (raw.length.get(), raw.checksum.get());
        Ok(is_head.then_some(Place { kind: raw.kind, start, length, checksum }))
    }

    /// All bytes of an extent, checked.
    pub(super) fn payload(&self, place: &Place) -> Result<Cow<'_, [u8]>> {
        let bytes = self.storage.read(place.first(), place.length as usize)?;
        let checksum = crc32c::crc32c(&bytes);
        if checksum != place.checksum {
            let found = format!("checksum {checksum:08x}");
            return Err(self.corrupt(
                format!("extent at {}", place.start),
                found,
                &format!("{:08x}", place.checksum),
            ));
        }
        Ok(bytes)
    }

    /// All bytes of the extent of a kind that starts at a place.
    pub(super) fn whole(&self, kind: ExtentKind, start: u64) -> Result<Cow<'_, [u8]>> {
        let place = self.head_at(start)?.filter(|place| place.kind == kind as u8);
        let place = place.ok_or_else(|| {
            self.corrupt(format!("byte {start}"), "something else", &format!("an extent of kind {kind:?}"))
        })?;
        self.payload(&place)
    }
}
