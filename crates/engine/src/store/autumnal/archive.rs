//! An Autumnal file as a whole, whatever its tree: header, newest commit, and the way to older ones.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use zerocopy::little_endian::U32;
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::commit::{Commit, CommitLayer};
use super::extents::Extents;
use super::layout::run_levels;
use super::meta::Meta;
use super::newest::{Look, Newest, find_newest, whole};
use super::packed::PackedExtents;
use super::pages::{FIRST_EXTENT, PAGE};
use spinney_base::io::platform::pause;
use spinney_base::io::{FileAccess, FileId, ReadBackend};
use spinney_base::{Error, Result};
use spinney_container::{Codec, FileHeader, Header, OpenOptions, TreeFormat};

/// The part of the first page that tells how records are made, behind the header that both formats have.
#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawRecords {
    share: u8,
    run_levels: u8,
    /// Whether extents of records may be packed.
    packed: u8,
    zero: u8,
    checksum: U32,
}

/// Offset of that part.
const RECORDS: u64 = 64;

/// The first page of a file.
pub(super) fn first_page(header: &FileHeader, form: RecordsForm) -> Vec<u8> {
    let mut page = header.to_bytes().to_vec();
    page.resize(RECORDS as usize, 0);
    let RecordsForm { run_levels, share, is_packed } = form;
    let (share, packed) = (share.into(), is_packed.into());
    let mut raw = RawRecords { share, run_levels, packed, zero: 0, checksum: 0.into() };
    raw.checksum = crc32c::crc32c(&raw.as_bytes()[..4]).into();
    page.extend_from_slice(raw.as_bytes());
    page.resize(PAGE as usize, 0);
    page
}

/// How the records of a file are made.
#[derive(Clone, Copy)]
pub(super) struct RecordsForm {
    /// Levels of the longest runs.
    pub(super) run_levels: u8,
    /// Whether equal subtrees are stored once.
    pub(super) share: bool,
    /// Whether extents of records may be packed.
    pub(super) is_packed: bool,
}

/// The content of the header page.
struct Pages {
    header: FileHeader,
    form: RecordsForm,
}

impl Pages {
    /// Reads and checks the page.
    fn read(path: &Path, bytes: &dyn ReadBackend) -> Result<Pages> {
        let header = FileHeader::read_cells(path, bytes)?;
        if header.format != TreeFormat::Autumnal {
            let advice =
                "`spinney convert` makes an Autumnal file of it, which can be edited and has a history";
            return Err(Error::unsupported(path, "editing a Goblin file", advice));
        }
        let corrupt = |place, found: &str, expected| Error::corrupt(path, place, found, expected);
        if bytes.len() < FIRST_EXTENT {
            let found = format!("{} bytes", bytes.len());
            return Err(corrupt("file", &found, "three pages and a commit (is the file cut short?)"));
        }
        let raw = bytes.read(RECORDS, size_of::<RawRecords>())?.into_owned();
        let good = crc32c::crc32c(&raw[..4]);
        let raw = RawRecords::ref_from_bytes(&raw).map_err(|_| corrupt("header", "too few bytes", "more"))?;
        if raw.checksum.get() != good || raw.share > 1 {
            let found = format!("{} for equal subtrees stored once", raw.share);
            return Err(corrupt("header", &found, "0 or 1, with its checksum"));
        }
        let levels = run_levels(header.dimension);
        if !levels.contains(&raw.run_levels) {
            let found = format!("runs of {} levels", raw.run_levels);
            let expected = format!("{} to {}", levels.start(), levels.end());
            return Err(corrupt("header", &found, &expected));
        }
        if raw.packed > 1 {
            let found = format!("records packed by the codec {}", raw.packed);
            return Err(Error::unsupported(path, found, "read it with a program as new as the file"));
        }
        let form =
            RecordsForm { run_levels: raw.run_levels, share: raw.share != 0, is_packed: raw.packed != 0 };
        Ok(Pages { header, form })
    }

    fn archive(
        self,
        extents: Extents,
        (meta, newest): (Meta, Newest),
        file: FileId,
        access: &FileAccess,
    ) -> Archive {
        let Pages { header, form } = self;
        let packed = form.is_packed.then(|| Arc::new(PackedExtents::new(&header, form.run_levels, access)));
        let extents = Arc::new(extents.with_packed(packed));
        Archive { header, form, extents, meta, newest, file, access: access.clone() }
    }
}

/// A file as it was when it was opened, with all commits up to the newest.
#[derive(Clone)]
pub(super) struct Archive {
    pub(super) header: FileHeader,
    pub(super) form: RecordsForm,
    pub(super) extents: Arc<Extents>,
    /// The slot of the newest commit that can be read.
    pub(super) meta: Meta,
    /// Anything about the newest commit that whoever uses the file should know.
    pub(super) newest: Newest,
    pub(super) file: FileId,
    /// How the file was opened.
    pub(super) access: FileAccess,
}

/// Bytes of a file, and which file it is.
pub(crate) type OpenFile = (Box<dyn ReadBackend>, FileId);

/// Times that slots are read when none is whole: a writer may have been at both, one after the other.
const MAX_ATTEMPTS: u32 = 100;

/// Looks at a slot that is damaged, or leads to what is not there, after which it is believed: what it leads to
/// is written before it, so that a second look at a file that is being written finds it.
const ENOUGH_ATTEMPTS: u32 = 3;

impl Archive {
    /// Opens a file; `open` is called again if a writer was too fast.
    pub(super) fn open(
        path: &Path,
        open: &dyn Fn() -> Result<OpenFile>,
        options: &OpenOptions,
    ) -> Result<Archive> {
        for attempt in 0..MAX_ATTEMPTS {
            // From the header on: by now there may be another file of that name.
            if let Some(archive) = Archive::read(path, open()?, options, attempt)? {
                return Ok(archive);
            }
            pause(Duration::from_micros(u64::from(attempt) * 10));
        }
        Err(no_meta(path))
    }

    /// Opens a file that is in memory, where nobody writes.
    pub(super) fn of_bytes(path: &Path, bytes: Vec<u8>) -> Result<Archive> {
        Archive::read(path, (Box::new(bytes), FileId::unique()), &OpenOptions::default(), MAX_ATTEMPTS)?
            .ok_or_else(|| no_meta(path))
    }

    /// Opens what a file holds; `None` if it should be looked at again, since a writer may have been at it.
    fn read(
        path: &Path,
        (bytes, file): OpenFile,
        options: &OpenOptions,
        attempt: u32,
    ) -> Result<Option<Archive>> {
        let pages = Pages::read(path, &*bytes)?;
        // A slot whose commit ends behind these bytes may have been written after they were opened.
        let (bytes, meta, newest) = match find_newest(path, bytes)? {
            Look::Nothing(Some(error)) if attempt >= ENOUGH_ATTEMPTS => return Err(error),
            Look::Nothing(_) => return Ok(None),
            Look::Found(bytes, meta, newest) if newest == Newest::Good || attempt >= ENOUGH_ATTEMPTS => {
                (bytes, meta, newest)
            }
            Look::Found(..) => return Ok(None),
        };
        let extents = Extents::new(path, bytes, meta.end, options.check)?;
        Ok(Some(pages.archive(extents, (meta, newest), file, &options.access)))
    }

    /// Opens a file up to a commit whose slot is not there.
    pub(super) fn at(
        path: &Path,
        (bytes, file): OpenFile,
        meta: Meta,
        access: &FileAccess,
    ) -> Result<Archive> {
        let pages = Pages::read(path, &*bytes)?;
        let extents = Extents::new(path, bytes, meta.end, true)?;
        Ok(pages.archive(extents, (meta, Newest::Good), file, access))
    }

    /// Makes sure that the file still has all that was there when it was opened.
    pub(super) fn check_unchanged(&self) -> Result<()> {
        let changed = |what| Err(Error::Changed { path: self.extents.path.clone(), what });
        if self.extents.stat()?.is_some_and(|now| now.length < self.extents.end) {
            return changed("was cut short");
        }
        // (A damaged slot is one behind.)
        let known = self.meta.sequence - u64::from(self.newest == Newest::BehindSlot);
        let now = whole(&self.extents.slots()?).first().map_or(0, |newest| newest.sequence);
        if now < known { changed("was overwritten") } else { Ok(()) }
    }

    /// A remark on the file that whoever reads it should know.
    pub(super) fn remark(&self) -> Option<&'static str> {
        let remark = "the meta slot of its newest commit is damaged; the commit was found behind the one before, and \
                      the next edit mends the slot";
        (self.newest == Newest::BehindSlot).then_some(remark)
    }

    /// The header of a layer.
    pub(super) fn layer_header(&self, layer: &CommitLayer) -> Result<Header> {
        let place = format!("layer `{}`", layer.name);
        let Ok(bytes) = layer.header[..].try_into() else {
            let found = format!("a header of {} bytes", layer.header.len());
            return Err(self.extents.corrupt(place, found, "48 bytes"));
        };
        let shape = (self.header.dimension, self.header.depth);
        let header = Header::from_bytes(&self.extents.path, &place, bytes, shape)?;
        match header.codec {
            Codec::Plain => Ok(header),
            // (There are no segments that could be.)
            Codec::Packed => Err(self.extents.corrupt(place, "packed segments", "codec 0")),
        }
    }

    /// The newest commit.
    pub(super) fn newest(&self) -> Result<Commit> {
        self.newest.check(&self.extents)?;
        Commit::read(&self.extents, self.meta.commit)
    }

    /// The commit with a number, which may be older than one that is damaged.
    pub(super) fn commit(&self, number: u64) -> Result<Commit> {
        let mut commit = Commit::read(&self.extents, self.meta.commit)?;
        if commit.number < number {
            // It may be the one that cannot be read.
            self.newest.check(&self.extents)?;
        }
        // By jumps as long as they do not lead too far, else step by step. (Both lead back in the file, so
        // that there is an end whatever the commits say.)
        while commit.number > number && commit.previous != 0 {
            let jumped = match commit.jump.1 {
                0 => None,
                offset => Some(Commit::read(&self.extents, offset)?).filter(|jumped| jumped.number >= number),
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

fn no_meta(path: &Path) -> Error {
    let found = "none that is whole and fits the file";
    Error::corrupt(path, "meta slots", found, "one (is the file cut short?)")
}
