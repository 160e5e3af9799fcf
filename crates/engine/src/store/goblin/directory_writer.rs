//! Writes the segment index: pages of entries, then the levels of the page index.

use zerocopy::IntoBytes;

use super::directory::entry_size;
use super::entry_columns::pack_entries;
use super::pages::{INDEX_ENTRIES, INDEX_SIZE, IndexEntry, PAGE_ENTRIES, PageHead, has_packed_entries};
use spinney_base::Result;
use spinney_base::space::{Code, Dimension};
use spinney_base::value::ValueType;
use spinney_container::Header;

/// Writes pages of entries, which are pushed in the order of their codes.
pub(super) struct DirectoryWriter<'a> {
    dimension: Dimension,
    entry_size: usize,
    /// Offset of the next page in the layer's run.
    position: u64,
    /// Entries of the next entry's ancestors, with their indices.
    above: Vec<(Code, u64, Vec<u8>)>,
    /// Number of entries so far.
    entries: u64,
    /// The current page: indices of its copies, the copies, its own entries.
    page: Vec<u8>,
    copies: usize,
    first: u64,
    /// The lowest level of the page index.
    index: Vec<u8>,
    /// Type of the values of entries that are packed.
    packed: Option<ValueType>,
    write: &'a mut dyn FnMut(&[u8]) -> Result<()>,
}

impl<'a> DirectoryWriter<'a> {
    /// Returns a writer for entries of a tree with this header; the first page is at offset
    /// `position` of the layer's run.
    pub(super) fn new(
        header: &Header,
        position: u64,
        write: &'a mut dyn FnMut(&[u8]) -> Result<()>,
    ) -> DirectoryWriter<'a> {
        let (above, page, index) = (Vec::new(), Vec::new(), Vec::new());
        let value_type = header.form.value;
        DirectoryWriter {
            dimension: header.form.dimension,
            entry_size: entry_size(value_type),
            packed: has_packed_entries(header).then_some(value_type),
            position,
            above,
            entries: 0,
            page,
            copies: 0,
            first: 0,
            index,
            write,
        }
    }

    /// Adds the next entry, which begins with its code.
    pub(super) fn push(&mut self, entry: &[u8]) -> Result<()> {
        let bits = u64::from_le_bytes(entry[..8].try_into().expect("8 bytes"));
        let code = Code::from_bits(self.dimension, bits).expect("entries are made from codes");
        while self.above.pop_if(|(above, ..)| !above.contains(code)).is_some() {}
        if self.page.is_empty() {
            self.first = bits;
            self.copies = self.above.len();
            self.above.iter().for_each(|(_, number, _)| self.page.extend_from_slice(&number.to_le_bytes()));
            self.above.iter().for_each(|(_, _, entry)| self.page.extend_from_slice(entry));
        }
        self.page.extend_from_slice(entry);
        self.above.push((code, self.entries, entry.to_vec()));
        self.entries += 1;
        if self.entries.is_multiple_of(PAGE_ENTRIES) { self.finish_page() } else { Ok(()) }
    }

    fn finish_page(&mut self) -> Result<()> {
        let own = (self.page.len() - self.copies * (self.entry_size + 8)) / self.entry_size;
        let head = PageHead::new(self.copies, own);
        if let Some(value_type) = self.packed {
            let packed = pack_entries(value_type, &self.page[self.copies * 8..]);
            self.page.truncate(self.copies * 8);
            self.page.extend_from_slice(&packed);
        }
        self.page.splice(..0, head.as_bytes().iter().copied());
        let entry = self.put(self.first, None)?;
        self.index.extend_from_slice(entry.as_bytes());
        self.page.clear();
        Ok(())
    }

    /// Writes a page, by default the current one of entries, and returns its entry in the page
    /// index.
    fn put(&mut self, first: u64, page: Option<&[u8]>) -> Result<IndexEntry> {
        let bytes = page.unwrap_or(&self.page);
        (self.write)(bytes)?;
        let (offset, length) = (self.position.into(), (bytes.len() as u32).into());
        self.position += bytes.len() as u64;
        Ok(IndexEntry { first: first.into(), offset, length, checksum: crc32c::crc32c(bytes).into() })
    }

    /// Writes the last page and the levels of the page index except for the top, which is returned.
    pub(super) fn finish(mut self) -> Result<Vec<u8>> {
        if !self.page.is_empty() {
            self.finish_page()?;
        }
        let most = INDEX_ENTRIES as usize * INDEX_SIZE;
        let mut level = std::mem::take(&mut self.index);
        while level.len() > most {
            let mut above = Vec::new();
            for page in level.chunks(most) {
                let first = u64::from_le_bytes(page[..8].try_into().expect("8 bytes"));
                above.extend_from_slice(self.put(first, Some(page))?.as_bytes());
            }
            level = above;
        }
        Ok(level)
    }
}
