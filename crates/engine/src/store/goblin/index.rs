//! Lookup in the segment index: from a code or a segment's index to the page with its entry.

use std::ops::{Deref, Range};
use std::sync::Arc;

use zerocopy::FromBytes;

use super::directory::entry_size;
use super::entry_columns::unpack_entries;
use super::pages::{
    CheckedPage, HEAD_SIZE, INDEX_ENTRIES, INDEX_SIZE, IndexEntry, MAX_COPIES, PAGE_ENTRIES, PageHead,
    PageSlots, has_packed_entries, index_levels, page_slots,
};
use super::reader::Goblin;
use spinney_base::io::{CachedBytes, FileAccess, FileBytes, Unpacked};
use spinney_base::space::Code;
use spinney_base::{Error, Result};
use spinney_container::Layer;

/// The segment index of a layer: its pages of entries, and the page index over them.
pub(super) struct Directory {
    /// Size of an entry in bytes.
    pub(super) entry_size: usize,
    /// Number of segments, each of which has an entry.
    segments: u64,
    pages: PageSlots,
    /// Levels of the page index, starting with the one directly above the pages. The last is the
    /// top, a single page.
    levels: Vec<IndexLevel>,
    /// The bytes of the top.
    top: Box<[u8]>,
    /// Unpacked pages, if entries are packed.
    unpacked: Option<Unpacked>,
}

/// Pages of entries are `2^PAGE_BITS` bytes apart in the cache: more than a page has.
const PAGE_BITS: u32 = 20;

/// Maximum size in bytes of a page index level that is prefetched at once.
const MAX_PREFETCHED: u64 = 256 << 10;

/// A level of the page index.
struct IndexLevel {
    /// Number of entries.
    entries: u64,
    /// Its pages; empty for the top.
    pages: PageSlots,
}

impl Directory {
    /// Returns the segment index of a layer, whose top has been read. `None` if the layer is too
    /// small for the number of entries that it claims.
    pub(super) fn new(layer: &Layer, top: &[u8], access: &FileAccess) -> Option<Directory> {
        // Invariant: no memory is allocated by the number of segments before this check.
        let (entry_size, available) =
            (entry_size(layer.header.form.value), layer.run.length - layer.directory);
        let is_packed = has_packed_entries(&layer.header);
        // (A page of 128 packed entries has more than 16 bytes.)
        let least = match is_packed {
            true => layer.segments.div_ceil(PAGE_ENTRIES).checked_mul(16)?,
            false => layer.segments.checked_mul(entry_size as u64)?,
        };
        if least > available {
            return None;
        }
        let counts = index_levels(layer.segments);
        let level = |(number, entries): (usize, &u64)| {
            let is_top = number + 1 == counts.len();
            let pages = if is_top { 0 } else { entries.div_ceil(INDEX_ENTRIES) };
            IndexLevel { entries: *entries, pages: page_slots(pages) }
        };
        let levels: Vec<IndexLevel> = counts.iter().enumerate().map(level).collect();
        let entries = counts.last().copied().unwrap_or(0);
        if top.len() as u64 != entries * INDEX_SIZE as u64 {
            return None;
        }
        let pages = page_slots(counts.first().copied().unwrap_or(0));
        let unpacked = is_packed.then(|| Unpacked::new(access, PAGE_BITS));
        Some(Directory { entry_size, segments: layer.segments, pages, levels, top: top.into(), unpacked })
    }

    /// Returns the number of a page's own entries.
    fn page_entries(&self, page: u64) -> u64 {
        (self.segments - page * PAGE_ENTRIES).min(PAGE_ENTRIES)
    }
}

/// A page of the segment index.
struct Page<'a> {
    bytes: FileBytes<'a>,
    copies: usize,
}

impl Page<'_> {
    /// Returns the indices of the copied entries' segments.
    fn numbers(&self) -> &[u8] {
        &self.bytes[HEAD_SIZE..][..self.copies * 8]
    }

    /// Returns the copies, then the page's own entries.
    #[inline]
    fn entries(&self) -> &[u8] {
        &self.bytes[HEAD_SIZE + self.copies * 8..]
    }
}

/// The bytes of an entry of the segment index.
pub(super) struct EntryBytes<'a> {
    page: FileBytes<'a>,
    start: usize,
    size: usize,
}

impl Deref for EntryBytes<'_> {
    type Target = [u8];

    #[inline]
    fn deref(&self) -> &[u8] {
        &self.page[self.start..][..self.size]
    }
}

/// Entries of the ancestors of a page's own nodes: their indices, and their bytes.
pub(super) type Copies = Vec<(u64, Vec<u8>)>;

impl Goblin {
    /// Returns the error for an invalid page of the segment index or the page index.
    #[cold]
    fn bad_page(&self, level: usize, page: u64, found: impl Into<String>, expected: &str) -> Error {
        let part = match level {
            0 => format!("page {page} of the directory"),
            level => format!("page {page} of level {level} of the index"),
        };
        self.corrupt(part, found, expected)
    }

    /// Returns the bytes of a page; level 0 has the pages of entries.
    #[inline]
    fn page_bytes(&self, level: usize, page: u64) -> Result<(FileBytes<'_>, usize)> {
        let directory = &self.directory;
        let slots = if level == 0 { &directory.pages } else { &directory.levels[level - 1].pages };
        let slot = &slots[page as usize];
        let checked = match slot.get() {
            Some(checked) => checked,
            None => {
                let checked = self.check_page(level, page)?;
                slot.get_or_init(|| checked)
            }
        };
        if level == 0
            && let Some(unpacked) = &directory.unpacked
        {
            let bytes = match unpacked.get(page) {
                Some(bytes) => bytes,
                None => {
                    self.unpacked_page(page, self.file.backend.share(checked.start as u64, checked.length)?)?
                }
            };
            return Ok((FileBytes::Cached(bytes), checked.copies));
        }
        let bytes = match self.file.backend.bytes() {
            // (A mapped file can be truncated after its bytes were checked.)
            Some(all) => all
                .get(checked.start..)
                .and_then(|rest| rest.get(..checked.length))
                .map(FileBytes::Mapped)
                .ok_or_else(|| {
                    self.bad_page(
                        level,
                        page,
                        "fewer bytes than before",
                        "an unchanged file (was it truncated?)",
                    )
                })?,
            None => self.file.backend.share(checked.start as u64, checked.length)?,
        };
        Ok((bytes, checked.copies))
    }

    /// Reads a page for the first time, and does all checks that do not depend on the query.
    #[cold]
    fn check_page(&self, level: usize, page: u64) -> Result<CheckedPage> {
        let entry = self.index_entry(level, page)?;
        self.prefetch_index(level)?;
        let layer = self.layer();
        let (offset, length) = (entry.offset.get(), u64::from(entry.length.get()));
        let corrupt = |found: String, expected: &str| self.bad_page(level, page, found, expected);
        let end = offset.checked_add(length);
        if offset < layer.directory || end.is_none_or(|end| end > layer.run.length) {
            return Err(corrupt(format!("{length} bytes at {offset}"), "bytes inside the directory"));
        }
        let start = layer.run.offset + offset;
        let bytes = self.file.backend.share(start, length as usize)?;
        let checksum = crc32c::crc32c(&bytes);
        if checksum != entry.checksum.get() {
            return Err(corrupt(format!("checksum {checksum:08x}"), &format!("{:08x}", entry.checksum)));
        }
        let bytes = match level {
            0 if self.directory.unpacked.is_some() => FileBytes::Cached(self.unpacked_page(page, bytes)?),
            _ => bytes,
        };
        let (copies, first) = match level {
            0 => {
                let Ok((head, rest)) = PageHead::ref_from_prefix(&bytes) else {
                    return Err(corrupt(format!("{length} bytes"), "a complete page"));
                };
                let (copies, own) = (usize::from(head.copies.get()), u64::from(head.entries.get()));
                let size = self.directory.entry_size;
                let fits = copies <= MAX_COPIES
                    && own == self.directory.page_entries(page)
                    && rest.len() == copies * (8 + size) + own as usize * size;
                if !fits {
                    let found = format!("{copies} copies, {own} entries in {length} bytes");
                    return Err(corrupt(found, &format!("{} entries", self.directory.page_entries(page))));
                }
                (copies, first_code(&rest[copies * (8 + size)..]))
            }
            level => {
                let entries = self.directory.levels[level - 1].entries;
                let own = (entries - page * INDEX_ENTRIES).min(INDEX_ENTRIES);
                if length != own * INDEX_SIZE as u64 {
                    return Err(corrupt(format!("{length} bytes"), &format!("{own} entries of 24 bytes")));
                }
                (0, first_code(&bytes))
            }
        };
        // This makes sure that the right page is found if the pages' own codes ascend.
        if first != entry.first.get() {
            let expected = format!("{:016x}, the code in the index", entry.first);
            return Err(corrupt(format!("first code {first:016x}"), &expected));
        }
        Ok(CheckedPage { start: start as usize, length: length as usize, copies })
    }

    /// Unpacks a page of entries, whose bytes have their checksum.
    fn unpacked_page(&self, page: u64, bytes: FileBytes<'_>) -> Result<CachedBytes> {
        let unpacked = self.directory.unpacked.as_ref().expect("entries are packed");
        let plain = PageHead::ref_from_prefix(&bytes).ok().and_then(|(head, rest)| {
            let (copies, own) = (usize::from(head.copies.get()), usize::from(head.entries.get()));
            if copies > MAX_COPIES || own as u64 > PAGE_ENTRIES {
                return None;
            }
            let (numbers, packed) = rest.split_at_checked(copies * 8)?;
            let entries = unpack_entries(self.header.form.value, copies + own, packed)?;
            // (A page that is unpacked again may be another one, if the file was overwritten.)
            let slot = self.directory.pages[page as usize].get();
            slot.is_none_or(|checked| {
                (checked.copies, self.directory.page_entries(page)) == (copies, own as u64)
            })
            .then(|| [&bytes[..HEAD_SIZE], numbers, &entries].concat())
        });
        let plain =
            plain.ok_or_else(|| self.bad_page(0, page, "invalid packed entries", "packed entries"))?;
        Ok(unpacked.put(page, Arc::new(plain)))
    }

    /// Prefetches all pages of a page index level, unless they are too large. They are consecutive
    /// and lead to all pages of entries.
    fn prefetch_index(&self, level: usize) -> Result<()> {
        let pages = if level == 0 { 0 } else { self.directory.levels[level - 1].pages.len() as u64 };
        // (Only the level below the top, whose entries are in memory.)
        if pages < 2 || level + 1 != self.directory.levels.len() {
            return Ok(());
        }
        let (first, last) = (self.index_entry(level, 0)?, self.index_entry(level, pages - 1)?);
        let layer = self.layer();
        let (start, end) =
            (first.offset.get(), last.offset.get().saturating_add(u64::from(last.length.get())));
        if start >= layer.directory
            && end <= layer.run.length
            && (start..end).contains(&start)
            && end - start <= MAX_PREFETCHED
        {
            let range = layer.run.offset + start..layer.run.offset + end;
            self.file.backend.prefetch(std::slice::from_ref(&range))?;
        }
        Ok(())
    }

    /// Returns the page index's entry for a page of the level below.
    fn index_entry(&self, below: usize, page: u64) -> Result<IndexEntry> {
        let level = below + 1;
        let read = |bytes: &[u8], number: u64| {
            let entry = IndexEntry::read_from_prefix(&bytes[number as usize * INDEX_SIZE..]);
            entry.expect("pages of the index are whole").0
        };
        if level == self.directory.levels.len() {
            return Ok(read(&self.directory.top, page));
        }
        let (bytes, _) = self.page_bytes(level, page / INDEX_ENTRIES)?;
        Ok(read(&bytes, page % INDEX_ENTRIES))
    }

    fn page(&self, number: u64) -> Result<Page<'_>> {
        let (bytes, copies) = self.page_bytes(0, number)?;
        Ok(Page { bytes, copies })
    }

    /// Returns the bytes of a segment's entry.
    ///
    /// # Errors
    /// If the page with the entry is corrupt.
    ///
    /// # Panics
    /// If there is no such segment.
    #[inline]
    pub(super) fn entry_bytes(&self, index: usize) -> Result<EntryBytes<'_>> {
        let size = self.directory.entry_size;
        let Page { bytes, copies } = self.page(index as u64 / PAGE_ENTRIES)?;
        let start = HEAD_SIZE + copies * 8 + (copies + index % PAGE_ENTRIES as usize) * size;
        Ok(EntryBytes { page: bytes, start, size })
    }

    /// Returns the code of a segment's node, as stored in its entry.
    pub(super) fn code_bits(&self, index: usize) -> Result<u64> {
        Ok(first_code(&self.entry_bytes(index)?))
    }

    /// Returns the level of a segment's node, according to its entry; 0 if the code is invalid,
    /// which loading the segment reports.
    ///
    /// # Errors
    /// If the page with its entry is corrupt.
    pub(crate) fn segment_level(&self, index: usize) -> Result<u8> {
        Ok(self.segment_code(index)?.map_or(0, Code::level))
    }

    /// Returns a segment's node, according to its entry; `None` if the code is invalid, which
    /// loading the segment reports.
    ///
    /// # Errors
    /// If the page with its entry is corrupt.
    #[inline]
    pub(crate) fn segment_code(&self, index: usize) -> Result<Option<Code>> {
        Ok(Code::from_bits(self.layout.dimension, self.code_bits(index)?))
    }

    /// Returns the copied entries at the start of a page, with their indices, if a segment's entry
    /// is the first of the page's own.
    ///
    /// # Errors
    /// If the page is corrupt.
    pub(super) fn page_copies(&self, index: usize) -> Result<Option<Copies>> {
        if !(index as u64).is_multiple_of(PAGE_ENTRIES) {
            return Ok(None);
        }
        let page = self.page(index as u64 / PAGE_ENTRIES)?;
        let size = self.directory.entry_size;
        let numbers = page.numbers().chunks_exact(8).map(first_code);
        Ok(Some(numbers.zip(page.entries().chunks_exact(size).map(<[u8]>::to_vec)).collect()))
    }

    /// Returns the last page whose first code is not after a code; `None` if there is none.
    fn page_of(&self, bits: u64) -> Result<Option<u64>> {
        let search = |bytes: &[u8]| last_not_after(bytes, INDEX_SIZE, 0..bytes.len() / INDEX_SIZE, bits);
        let Some(first) = search(&self.directory.top) else { return Ok(None) };
        let mut page = first as u64;
        for level in (1..self.directory.levels.len()).rev() {
            let (bytes, _) = self.page_bytes(level, page)?;
            let Some(found) = search(&bytes) else { return Ok(None) };
            page = page * INDEX_ENTRIES + found as u64;
        }
        Ok(Some(page))
    }

    /// Returns the index of the deepest segment among those of `code`, a node of a tree of the
    /// file's dimension, and its ancestors. One search in the page index and one in a page, O(log
    /// segments).
    ///
    /// # Errors
    /// If a page on the way is corrupt.
    pub fn find_segment(&self, code: Code) -> Result<Option<usize>> {
        let found = self.search_segment(code);
        if matches!(found, Err(Error::NotFetched)) {
            self.announce(code);
        }
        found
    }

    fn search_segment(&self, code: Code) -> Result<Option<usize>> {
        let Some(number) = self.page_of(code.bits())? else { return Ok(None) };
        let (page, size) = (self.page(number)?, self.directory.entry_size);
        let entries = page.entries();
        let own = self.directory.page_entries(number) as usize;
        let dimension = self.layout.dimension;
        let mut searched = code;
        let mut high = page.copies + own;
        // The last entry that is not after the code. Codes sort in preorder, so if it is no
        // ancestor, then every ancestor with a segment is an ancestor of that entry too.
        while let Some(index) = last_not_after(entries, size, page.copies..high, searched.bits()) {
            let Some(before) = Code::from_bits(dimension, first_code(&entries[index * size..])) else {
                return Ok(None);
            };
            if before.contains(searched) {
                return Ok(Some(number as usize * PAGE_ENTRIES as usize + index - page.copies));
            }
            let level = before.common_ancestor(searched).level();
            // Invariant: the deepest candidate from the common ancestor up owns a segment, since
            // every candidate above a heavy one is heavy. No node between that ancestor and `code`
            // owns one, since its entry would be between this entry and `code`. Even if a corrupt
            // segment index violates this, the loop ends, because each search has fewer entries
            // than the one before.
            searched = searched.ancestor(self.header.shape.segment_level(level));
            high = index;
        }
        // Entries of the page's ancestors are in earlier pages, and copied to this one.
        for index in (0..page.copies).rev() {
            let bits = first_code(&entries[index * size..]);
            let copied = Code::from_bits(dimension, bits).is_some_and(|above| above.contains(code));
            if copied {
                let index = first_code(&page.numbers()[index * 8..]) as usize;
                if index >= number as usize * PAGE_ENTRIES as usize || self.code_bits(index)? != bits {
                    let found = format!("a copy of entry {index} with a different code");
                    return Err(self.bad_page(0, number, found, "a copy with the entry's code"));
                }
                return Ok(Some(index));
            }
        }
        Ok(None)
    }
}

/// Returns the code that an entry starts with, or the number.
#[inline]
fn first_code(bytes: &[u8]) -> u64 {
    u64::from_le_bytes(bytes[..8].try_into().expect("8 bytes"))
}

/// Returns the last of some ascending entries whose code is not after `bits`.
#[inline]
fn last_not_after(entries: &[u8], size: usize, range: Range<usize>, bits: u64) -> Option<usize> {
    let Range { start, end } = range;
    let (mut low, mut high) = (start, end);
    while low < high {
        let middle = low + (high - low) / 2;
        if first_code(&entries[middle * size..]) <= bits { low = middle + 1 } else { high = middle }
    }
    (low > start).then(|| low - 1)
}
