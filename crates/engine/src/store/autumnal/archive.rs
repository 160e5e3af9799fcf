//! An Autumnal file independent of any tree: its header, newest commit, and access to older
//! commits.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use zerocopy::little_endian::U32;
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::commit::{Commit, CommitLayer};
use super::extents::Extents;
use super::layout::run_levels;
use super::meta::Meta;
use super::newest::{NewestSearch, NewestState, find_newest, whole};
use super::packed::PackedExtents;
use super::pages::{FIRST_EXTENT, PAGE};
use spinney_base::io::platform::pause;
use spinney_base::io::{FileAccess, FileId, ReadBackend};
use spinney_base::{Error, Result};
use spinney_container::{Codec, FileHeader, Header, OpenOptions, TreeFormat};

/// Fields of the first page that describe the records. They follow the header that both formats
/// share.
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

/// Offset of these fields.
const RECORDS_OFFSET: u64 = 64;

/// Returns the first page of a file.
pub(super) fn first_page(header: &FileHeader, form: RecordsForm) -> Vec<u8> {
    let mut page = header.to_bytes().to_vec();
    page.resize(RECORDS_OFFSET as usize, 0);
    let RecordsForm { run_levels, share, may_pack } = form;
    let (share, packed) = (share.into(), may_pack.into());
    let mut raw = RawRecords { share, run_levels, packed, zero: 0, checksum: 0.into() };
    raw.checksum = crc32c::crc32c(&raw.as_bytes()[..4]).into();
    page.extend_from_slice(raw.as_bytes());
    page.resize(PAGE as usize, 0);
    page
}

/// Format of a file's records.
#[derive(Clone, Copy)]
pub(super) struct RecordsForm {
    /// Levels of a full run.
    pub(super) run_levels: u8,
    /// Whether equal subtrees are stored once.
    pub(super) share: bool,
    /// Whether extents of records may be packed.
    pub(super) may_pack: bool,
}

/// Content of the header page.
struct Pages {
    header: FileHeader,
    form: RecordsForm,
}

impl Pages {
    /// Reads and checks the page.
    fn read(path: &Path, bytes: &dyn ReadBackend) -> Result<Pages> {
        let header = FileHeader::read_cells(path, bytes)?;
        if header.format != TreeFormat::Autumnal {
            let found = "a Goblin file, which is read-only and has no commits, instead of an Autumnal file";
            let advice = "convert it to an Autumnal file, which can be edited: `spinney convert`";
            return Err(Error::unsupported(path, found, advice));
        }
        let corrupt = |place, found: &str, expected| Error::corrupt(path, place, found, expected);
        if bytes.len() < FIRST_EXTENT {
            let found = format!("{} bytes", bytes.len());
            return Err(corrupt("file", &found, "at least 3 pages and a commit (is the file cut short?)"));
        }
        let raw = bytes.read(RECORDS_OFFSET, size_of::<RawRecords>())?.into_owned();
        let good = crc32c::crc32c(&raw[..4]);
        let raw =
            RawRecords::ref_from_bytes(&raw).map_err(|_| corrupt("header", "too few bytes", "a page"))?;
        if raw.checksum.get() != good || raw.share > 1 {
            let found = format!("sharing of equal subtrees {}", raw.share);
            return Err(corrupt("header", &found, "0 or 1, and the right checksum"));
        }
        let levels = run_levels(header.dimension);
        if !levels.contains(&raw.run_levels) {
            let found = format!("runs of {} levels", raw.run_levels);
            let expected = format!("{} to {}", levels.start(), levels.end());
            return Err(corrupt("header", &found, &expected));
        }
        if raw.packed > 1 {
            let found = format!("record codec {}", raw.packed);
            return Err(Error::unsupported(
                path,
                found,
                "install the version of Spinney that wrote the file, or a newer one",
            ));
        }
        let form =
            RecordsForm { run_levels: raw.run_levels, share: raw.share != 0, may_pack: raw.packed != 0 };
        Ok(Pages { header, form })
    }

    fn archive(
        self,
        extents: Extents,
        (meta, state): (Meta, NewestState),
        file: FileId,
        access: &FileAccess,
    ) -> Archive {
        let Pages { header, form } = self;
        let packed = form.may_pack.then(|| Arc::new(PackedExtents::new(&header, form.run_levels, access)));
        let extents = Arc::new(extents.with_packed(packed));
        Archive { header, form, extents, meta, state, file, access: access.clone() }
    }
}

/// A file at the time of opening, with all commits up to the newest.
#[derive(Clone)]
pub(super) struct Archive {
    pub(super) header: FileHeader,
    pub(super) form: RecordsForm,
    pub(super) extents: Arc<Extents>,
    /// Slot of the newest readable commit.
    pub(super) meta: Meta,
    /// State of the newest commit, which callers should report.
    pub(super) state: NewestState,
    pub(super) file: FileId,
    /// Options that the file was opened with.
    pub(super) access: FileAccess,
}

/// Bytes of a file and its identity.
pub(crate) type OpenFile = (Box<dyn ReadBackend>, FileId);

/// Maximum number of times to read the slots while none is valid. A writer may have been writing
/// both in turn.
const MAX_ATTEMPTS: u32 = 100;

/// Number of reads after which a corrupt slot, or one that refers to missing bytes, is final. A
/// slot is written after the bytes that it refers to, so reading again succeeds if a writer was
/// active.
const ENOUGH_ATTEMPTS: u32 = 3;

impl Archive {
    /// Opens a file. Calls `open` again if a writer was active.
    pub(super) fn open(
        path: &Path,
        open: &dyn Fn() -> Result<OpenFile>,
        options: &OpenOptions,
    ) -> Result<Archive> {
        for retry in 0..MAX_ATTEMPTS {
            // Start over with the header: another file may have that name by now.
            if let Some(archive) = Archive::read(path, open()?, options, retry)? {
                return Ok(archive);
            }
            pause(Duration::from_micros(u64::from(retry) * 10));
        }
        Err(no_meta(path))
    }

    /// Opens a file in memory, which has no concurrent writer.
    pub(super) fn of_bytes(path: &Path, bytes: Vec<u8>) -> Result<Archive> {
        Archive::read(path, (Box::new(bytes), FileId::unique()), &OpenOptions::default(), MAX_ATTEMPTS)?
            .ok_or_else(|| no_meta(path))
    }

    /// Opens the file, or returns `None` if it must be read again because a writer may have been
    /// active.
    fn read(
        path: &Path,
        (bytes, file): OpenFile,
        options: &OpenOptions,
        retry: u32,
    ) -> Result<Option<Archive>> {
        let pages = Pages::read(path, &*bytes)?;
        // A slot whose commit ends after these bytes may have been written since they were opened.
        let (bytes, meta, state) = match find_newest(path, bytes)? {
            NewestSearch::Nothing(Some(error)) if retry >= ENOUGH_ATTEMPTS => return Err(error),
            NewestSearch::Nothing(_) => return Ok(None),
            NewestSearch::Found(bytes, meta, state)
                if state == NewestState::Good || retry >= ENOUGH_ATTEMPTS =>
            {
                (bytes, meta, state)
            }
            NewestSearch::Found(..) => return Ok(None),
        };
        let extents = Extents::new(path, bytes, meta.end, options.check)?;
        Ok(Some(pages.archive(extents, (meta, state), file, &options.access)))
    }

    /// Opens a file up to a commit whose slot is missing.
    pub(super) fn at(
        path: &Path,
        (bytes, file): OpenFile,
        meta: Meta,
        access: &FileAccess,
    ) -> Result<Archive> {
        let pages = Pages::read(path, &*bytes)?;
        let extents = Extents::new(path, bytes, meta.end, true)?;
        Ok(pages.archive(extents, (meta, NewestState::Good), file, access))
    }

    /// Checks that the file still has everything that it had when it was opened.
    pub(super) fn check_unchanged(&self) -> Result<()> {
        let changed = |what| Err(Error::Changed { path: self.extents.path.clone(), what });
        if self.extents.stat()?.is_some_and(|now| now.length < self.extents.end) {
            return changed("was cut short");
        }
        // (If the newest commit's slot is corrupt, the valid one is a commit older.)
        let known = self.meta.sequence - u64::from(self.state == NewestState::CorruptSlot);
        let now = whole(&self.extents.slots()?).first().map_or(0, |newest| newest.sequence);
        if now < known { changed("was overwritten") } else { Ok(()) }
    }

    /// Returns a remark on the file for its users.
    pub(super) fn remark(&self) -> Option<&'static str> {
        let remark = "the meta slot of its newest commit is corrupt; the commit was found after the previous one, and \
                      the next edit repairs the slot";
        (self.state == NewestState::CorruptSlot).then_some(remark)
    }

    /// Returns the header of a layer.
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
            // (Autumnal files have no segments to pack.)
            Codec::Packed | Codec::Reference => {
                let found = format!("{} segments", header.codec.name());
                Err(self.extents.corrupt(place, found, "codec 0"))
            }
        }
    }

    /// Reads the newest commit.
    pub(super) fn newest(&self) -> Result<Commit> {
        self.state.check(&self.extents)?;
        Commit::read(&self.extents, self.meta.commit)
    }

    /// Reads the commit with a number. It may be older than a corrupt one.
    pub(super) fn commit(&self, number: u64) -> Result<Commit> {
        let mut commit = Commit::read(&self.extents, self.meta.commit)?;
        if commit.number < number {
            // It may be the unreadable one.
            self.state.check(&self.extents)?;
        }
        // Take jumps as long as they do not lead too far, else single steps. (Both lead back in the
        // file, so the loop ends for any input.)
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
        let newest = Commit::read(&self.extents, self.meta.commit)?;
        let expected = match (self.oldest(&newest)?, newest.number) {
            (only, newest) if only == newest => format!("{only}, the only commit"),
            (oldest, newest) => format!("a commit that `spinney log` lists, from {oldest} to {newest}"),
        };
        Err(Error::invalid(format!("{}: commit", self.extents.path.display()), number.to_string(), expected))
    }

    /// Returns the number of the oldest commit, given the newest.
    fn oldest(&self, newest: &Commit) -> Result<u64> {
        let before = |commit: &Commit| match (commit.jump.1, commit.previous) {
            (0, previous) => previous,
            (jump, _) => jump,
        };
        let (mut number, mut next) = (newest.number, before(newest));
        while next != 0 {
            let commit = Commit::read(&self.extents, next)?;
            (number, next) = (commit.number, before(&commit));
        }
        Ok(number)
    }
}

fn no_meta(path: &Path) -> Error {
    let found = "no valid slot whose commit is in the file";
    Error::corrupt(path, "meta slots", found, "a valid slot (is the file cut short?)")
}
