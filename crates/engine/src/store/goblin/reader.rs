//! An open Goblin file, and what it says of itself.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

use super::directory::{Entry, show_sums};
use crate::store::records::{Descend, RecordLayout};
use crate::tree::Child;
use spinney_base::io::{ReadBackend, Stamp};
use spinney_base::value::Tally;
use spinney_base::{Error, Result};
use spinney_container::{HEADER_SIZE, Header, Metadata, Section, SegmentCache, Trailer};

/// A Goblin file, open for reading; may be shared by any number of threads.
///
/// Opening reads the header, the trailer and the metadata. Everything that is read later is checked before it
/// is used: a damaged file gives an error, never a wrong answer (unless
/// [`OpenOptions::check`](method@spinney_container::OpenOptions::check) is off) or a crash.
pub struct Goblin {
    pub(super) path: PathBuf,
    pub(super) backend: Box<dyn ReadBackend>,
    /// Length and time of the file when it was opened.
    pub(super) stamp: Option<Stamp>,
    pub(super) header: Header,
    /// Layout of its records.
    pub(super) layout: RecordLayout,
    /// The way down through them.
    pub(super) descend: Descend,
    pub(super) trailer: Trailer,
    /// The root's state, and its value or representative.
    pub(super) root: Child<()>,
    pub(super) metadata: Metadata,
    /// The directory, if the backend cannot show it.
    pub(super) directory: Option<Vec<u8>>,
    /// Bytes of an entry of the directory.
    pub(super) entry_size: usize,
    /// One bit per segment that was found to be good.
    pub(super) checked: Vec<AtomicU64>,
    /// Bytes of those segments.
    pub(super) checked_bytes: AtomicU64,
    /// Whether each segment's checksum is checked when it is used first.
    pub(super) check: bool,
    pub(super) cache: Mutex<SegmentCache>,
}

impl Goblin {
    /// Whether the file's bytes can be seen where they are, so that holding on to them costs nothing.
    pub(crate) fn is_mapped(&self) -> bool {
        self.backend.bytes().is_some()
    }

    /// The file, for messages.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file's header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Layout of the records of segments.
    #[inline]
    pub fn layout(&self) -> &RecordLayout {
        &self.layout
    }

    /// Georeference, meaning and provenance of the data.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Makes sure that the file is what it was when it was opened, so that all answers since are of one state.
    /// (That another file has got its name does not matter.)
    ///
    /// # Errors
    /// If it was changed.
    pub fn check_unchanged(&self) -> Result<()> {
        let changed = |what| Err(Error::Changed { path: self.path.clone(), what });
        match (self.stamp, self.backend.stamp()?) {
            (Some(before), Some(now)) if now.length < before.length => changed("was cut short"),
            (before, now) if before != now => changed("was overwritten"),
            _ => Ok(()),
        }
    }

    /// Bytes of the whole file.
    pub fn file_size(&self) -> u64 {
        self.backend.len()
    }

    /// Number of segments.
    #[inline]
    pub fn segments(&self) -> usize {
        self.trailer.segments as usize
    }

    /// Places of records in all segments: those stored more than once take several, those in dense blocks less than one each.
    pub fn stored_records(&self) -> u64 {
        self.trailer.stored_records
    }

    /// Name and bytes of each part of the file, in order.
    pub fn sections(&self) -> Vec<(&'static str, u64)> {
        let Trailer { directory, metadata, .. } = &self.trailer;
        let known = HEADER_SIZE as u64 + directory.length + metadata.length;
        let trailer = self.file_size().saturating_sub(metadata.offset + metadata.length);
        vec![
            ("header", HEADER_SIZE as u64),
            ("segments", self.file_size().saturating_sub(known + trailer)),
            ("directory", directory.length),
            ("metadata", metadata.length),
            ("trailer", trailer),
        ]
    }

    /// The directory's and the metadata's checksums as stored and as found.
    pub(super) fn section_checksums(&self) -> Result<Vec<(&'static str, u32, u32)>> {
        let list = [("directory", self.trailer.directory), ("metadata", self.trailer.metadata)];
        list.into_iter()
            .map(|(name, section)| {
                let bytes = self.backend.read(section.offset, section.length as usize)?;
                Ok((name, section.checksum, crc32c::crc32c(&bytes)))
            })
            .collect()
    }

    /// The error for a part of the file that breaks the format's rules.
    #[cold]
    pub(super) fn corrupt(&self, part: String, found: impl Into<String>, expected: &str) -> Error {
        Error::corrupt(&self.path, part, found, expected)
    }

    /// The root: its state, and its value or representative.
    #[inline]
    pub fn root_child(&self) -> Child<()> {
        self.root
    }

    /// The bytes of the directory: an entry for each segment, as opening has checked.
    #[inline]
    pub(super) fn directory(&self) -> &[u8] {
        let Section { offset, length, .. } = self.trailer.directory;
        match (&self.directory, self.backend.bytes()) {
            (Some(directory), _) => directory,
            (None, Some(bytes)) => &bytes[offset as usize..][..length as usize],
            (None, None) => &[],
        }
    }

    /// The bytes of one entry of the directory.
    ///
    /// # Panics
    /// If there is no such entry.
    #[inline]
    pub(super) fn entry_bytes(&self, index: usize) -> &[u8] {
        &self.directory()[index * self.entry_size..][..self.entry_size]
    }

    /// One entry of the directory.
    ///
    /// # Errors
    /// If the entry is damaged.
    ///
    /// # Panics
    /// If there is no such entry.
    pub fn entry(&self, index: usize) -> Result<Entry> {
        let form = self.header.form;
        let entry = Entry::from_bytes(&self.path, index, self.entry_bytes(index), form)?;
        let height = self.header.depth().checked_sub(entry.code.level());
        let cells = height.map_or(0, |height| form.dimension.cells(height));
        let Tally { cells: counted, present, sum, squares, .. } = &entry.zone;
        let has_more = present.iter().any(|present| present > counted);
        // Sums of zones that are possible can be added up without overflow.
        if *counted > cells || has_more || !sum.are_possible(*counted) || !squares.are_possible(*counted) {
            let sums = show_sums(sum, form.value.channels);
            let found = format!("statistics of {counted} cells with sums {sums}");
            let expected = format!("those of at most {cells} cells");
            return Err(self.corrupt(format!("directory entry {index}"), found, &expected));
        }
        Ok(entry)
    }

    /// Zone statistics of a segment's node, class counts included.
    ///
    /// # Errors
    /// If the segment or its entry is damaged.
    ///
    /// # Panics
    /// If there is no such segment.
    pub fn zone(&self, index: usize) -> Result<Tally> {
        let mut zone = self.entry(index)?.zone;
        zone.classes = self.segment(index)?.classes();
        Ok(zone)
    }
}
