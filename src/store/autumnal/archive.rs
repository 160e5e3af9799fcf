//! What all readers of a file need, whatever its tree is made of: header, newest commit, and the way to older ones.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use zerocopy::little_endian::U32;
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::commit::Commit;
use super::extents::Extents;
use super::form::Form;
use super::medium::FileId;
use super::meta::{self, Meta};
use crate::store::goblin::{Header, read_header};
use crate::store::{Storage, TreeFormat};
use crate::{Error, Result};

/// What the first page says of pointers, behind the header that both formats have.
#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub(super) struct RawPointers {
    near: u8,
    far: u8,
    share: u8,
    zero: u8,
    checksum: U32,
}

/// Where that is.
const POINTERS: u64 = 64;

/// Bytes of pointers where files are written: near ones reach 64 KiB back, or 16 MiB where equal subtrees are stored once
/// and pointers go far; far ones reach 256 TiB.
pub(super) const fn pointer_bytes(share: bool) -> (u8, u8) {
    if share { (3, 6) } else { (2, 6) }
}

/// The first page of a file.
pub(super) fn first_page(header: &Header, form: &Form, share: bool) -> Vec<u8> {
    let mut page = header.to_bytes(TreeFormat::Autumnal);
    page.resize(POINTERS as usize, 0);
    let mut raw =
        RawPointers { near: form.near, far: form.far, share: share.into(), zero: 0, checksum: 0.into() };
    raw.checksum = crc32c::crc32c(&raw.as_bytes()[..4]).into();
    page.extend_from_slice(raw.as_bytes());
    page.resize(super::extents::PAGE as usize, 0);
    page
}

/// A file as it was when it was opened, with all commits up to the newest.
#[derive(Clone)]
pub(super) struct Archive {
    pub(super) header: Header,
    pub(super) form: Form,
    /// Whether equal subtrees are stored once.
    pub(super) share: bool,
    pub(super) extents: Arc<Extents>,
    pub(super) meta: Meta,
    pub(super) file: FileId,
}

/// How often slots are read again when none is whole: a writer may have been at both, one after the other.
const PATIENCE: u32 = 100;

impl Archive {
    /// Opens what a storage holds; `storage` is called again if a writer was too fast.
    pub(super) fn open(
        path: &Path,
        storage: impl Fn() -> Result<Box<dyn Storage>>,
        file: FileId,
        check: bool,
    ) -> Result<Archive> {
        let mut bytes = storage()?;
        let (format, header) = read_header(path, &*bytes)?;
        if format != TreeFormat::Autumnal {
            let advice =
                "`spinney publish` makes an Autumnal file of it, which can be edited and has a history";
            return Err(Error::unsupported(path, "editing a Goblin file", advice));
        }
        let corrupt = |place, found: &str, expected| Error::corrupt(path, place, found, expected);
        if bytes.len() < super::extents::FIRST {
            let found = format!("{} bytes", bytes.len());
            return Err(corrupt("file", &found, "three pages and a commit (is the file cut short?)"));
        }
        let raw = bytes.read(POINTERS, size_of::<RawPointers>())?.into_owned();
        let good = crc32c::crc32c(&raw[..4]);
        let raw =
            RawPointers::ref_from_bytes(&raw).map_err(|_| corrupt("header", "too few bytes", "more"))?;
        let fits = (1..=4).contains(&raw.near) && (raw.near..=8).contains(&raw.far) && raw.share < 2;
        if raw.checksum.get() != good || !fits {
            let found = format!("pointers of {} and {} bytes", raw.near, raw.far);
            return Err(corrupt("header", &found, "1 to 4 and at most 8 bytes, with their checksum"));
        }
        for attempt in 0..PATIENCE {
            if let Some(meta) = newest(&*bytes)? {
                let form = Form::new(&header, raw.near, raw.far);
                let extents = Arc::new(Extents::new(path, bytes, meta.end, check));
                return Ok(Archive { header, form, share: raw.share != 0, extents, meta, file });
            }
            std::thread::sleep(Duration::from_micros(u64::from(attempt) * 10));
            bytes = storage()?;
        }
        Err(corrupt("meta slots", "none that is whole and fits the file", "one (is the file cut short?)"))
    }

    /// The newest commit.
    pub(super) fn newest(&self) -> Result<Commit> {
        Commit::read(&self.extents, self.meta.commit)
    }

    /// The commit with a number.
    pub(super) fn commit(&self, number: u64) -> Result<Commit> {
        let mut commit = self.newest()?;
        while commit.number > number && commit.previous != 0 {
            let jumped = match commit.jump.1 {
                0 => None,
                place => Some(Commit::read(&self.extents, place)?).filter(|jumped| jumped.number >= number),
            };
            commit = match jumped {
                Some(jumped) => jumped,
                None => Commit::read(&self.extents, commit.previous)?,
            };
        }
        if commit.number == number {
            return Ok(commit);
        }
        let expected = "one of those that `spinney log` shows";
        Err(Error::invalid(format!("{}: commit", self.extents.path.display()), number.to_string(), expected))
    }
}

/// The newer of the slots that are whole.
pub(super) fn newest(storage: &dyn Storage) -> Result<Option<Meta>> {
    let mut newest: Option<Meta> = None;
    for place in meta::PLACES {
        if let Some(meta) = Meta::from_bytes(&storage.read(place, meta::SIZE)?, storage.len())
            && newest.is_none_or(|newest| newest.sequence < meta.sequence)
        {
            newest = Some(meta);
        }
    }
    Ok(newest)
}
