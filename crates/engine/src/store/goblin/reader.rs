//! An open Goblin file, its header and its metadata.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use super::directory::{Entry, show_sums};
use super::index::Directory;
use super::reference::ReferencedCells;
use crate::store::records::{Descend, RecordLayout};
use crate::tree::Child;
use spinney_base::io::{FileAccess, FileStat, ReadBackend, Unpacked};
use spinney_base::value::{Value, ZoneStats};
use spinney_base::{Error, Result};
use spinney_container::{Codec, HEADER_SIZE, Header, Layer, Metadata, Section};

/// A layer of a Goblin file, open for reading. Can be shared by any number of threads.
///
/// Opening reads the header, the trailer, the table of layers, and this layer's metadata.
/// Everything that is read later is checked before it is used: a corrupt file causes an error,
/// never an incorrect result (unless
/// [`OpenOptions::check`](method@spinney_container::OpenOptions::check) is off) or a crash.
pub struct Goblin {
    /// The file, which its layers share.
    pub(super) file: Arc<OpenFile>,
    /// Index of the layer.
    pub(super) number: usize,
    pub(super) header: Header,
    /// Layout of its records.
    pub(super) layout: RecordLayout,
    /// Descent through its records.
    pub(super) descend: Descend,
    /// The root's state, and its value or representative.
    pub(super) root: Child<()>,
    pub(super) metadata: Metadata,
    pub(super) directory: Directory,
    /// One bit per segment that was checked and found valid.
    pub(super) checked: Vec<AtomicU64>,
    /// Size of those segments in the file, in bytes.
    pub(super) checked_bytes: AtomicU64,
    /// Cache of unpacked segments.
    pub(super) unpacked: Unpacked,
}

/// An open file with its table of layers.
pub(super) struct OpenFile {
    pub(super) path: PathBuf,
    pub(super) backend: Box<dyn ReadBackend>,
    /// Version of the file when it was opened.
    pub(super) version: Option<FileStat>,
    pub(super) layers: Vec<Layer>,
    /// Location of the table of layers.
    pub(super) table: Section,
    /// Whether each segment's checksum is checked on first use.
    pub(super) check: bool,
    pub(super) access: FileAccess,
    /// The cells in other files, if the file refers to some.
    pub(super) references: Option<Box<dyn ReferencedCells>>,
    /// The sections that describe the other files.
    pub(super) reference_sections: Option<[Section; 2]>,
}

impl Goblin {
    /// Returns whether all records are mapped, so that keeping references to them costs nothing.
    pub(crate) fn is_mapped(&self) -> bool {
        self.header.codec == Codec::Plain && self.file.backend.bytes().is_some()
    }

    /// Returns the file, for messages.
    pub fn path(&self) -> &Path {
        &self.file.path
    }

    /// Returns how the file was opened.
    pub fn access(&self) -> &FileAccess {
        &self.file.access
    }

    /// Returns the layer's header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Returns the layout of records in segments.
    #[inline]
    pub fn layout(&self) -> &RecordLayout {
        &self.layout
    }

    /// Returns georeference, meaning and provenance of the data.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Checks that the file has not changed since it was opened, so that all results since then are
    /// of one state. (It does not matter if the path now belongs to another file.)
    ///
    /// # Errors
    /// If it was changed.
    pub fn check_unchanged(&self) -> Result<()> {
        let changed = |what| Err(Error::Changed { path: self.file.path.clone(), what });
        match (&self.file.version, self.file.backend.stat()?) {
            (Some(before), Some(now)) if now.length < before.length => changed("was cut short"),
            (Some(before), Some(now)) if *before != now => changed("was overwritten"),
            _ => Ok(()),
        }
    }

    /// Checks with a request to the host that a remote file still has the version that was opened.
    ///
    /// # Errors
    /// If it has not, or the host does not respond.
    pub fn check_remote(&self) -> Result<()> {
        self.file.backend.check_remote()
    }

    /// Returns the file's version when it was opened; `None` for a file in memory.
    pub fn version(&self) -> Option<&FileStat> {
        self.file.version.as_ref()
    }

    /// Returns the size of the whole file in bytes.
    pub fn file_size(&self) -> u64 {
        self.file.backend.len()
    }

    /// Returns the layers of the file, including this one.
    pub fn layers(&self) -> &[Layer] {
        &self.file.layers
    }

    /// Returns the index of this layer.
    pub fn layer_number(&self) -> usize {
        self.number
    }

    /// Returns this layer's entry in the table of layers.
    #[inline]
    pub(super) fn layer(&self) -> &Layer {
        &self.file.layers[self.number]
    }

    /// Returns the number of segments.
    #[inline]
    pub fn segments(&self) -> usize {
        self.layer().segments as usize
    }

    /// Returns the number of record slots in all segments. Records that are stored more than once
    /// count several times; those in dense blocks use less than one slot each.
    pub fn stored_records(&self) -> u64 {
        self.layer().stored_records
    }

    /// Returns name and size in bytes of each section of the file; sections of several layers are
    /// added up.
    pub fn sections(&self) -> Vec<(&'static str, u64)> {
        let layers = &self.file.layers;
        let sum = |bytes: &dyn Fn(&Layer) -> u64| layers.iter().map(bytes).fold(0, u64::saturating_add);
        let header = HEADER_SIZE as u64;
        let segments = sum(&|layer| layer.directory);
        let directory = sum(&|layer| layer.run.length - layer.directory + layer.top.length);
        let (metadata, table) = (sum(&|layer| layer.metadata.length), self.file.table.length);
        let known = [header, segments, directory, metadata, table].into_iter().fold(0, u64::saturating_add);
        vec![
            ("header", header),
            ("segments", segments),
            ("directory", directory),
            ("metadata", metadata),
            ("table of layers", table),
            ("trailer", self.file_size().saturating_sub(known)),
        ]
    }

    /// Returns the error for a violation of the format's rules.
    #[cold]
    pub(super) fn corrupt(&self, part: String, found: impl Into<String>, expected: &str) -> Error {
        Error::corrupt(&self.file.path, part, found, expected)
    }

    /// Returns the root: its state, and its value or representative.
    #[inline]
    pub fn root_child(&self) -> Child<()> {
        self.root
    }

    /// Returns one entry of the segment index.
    ///
    /// # Errors
    /// If the entry is corrupt.
    ///
    /// # Panics
    /// If there is no such entry.
    pub fn entry(&self, index: usize) -> Result<Entry> {
        let form = self.header.form;
        let entry = Entry::from_bytes(&self.file.path, index, &self.entry_bytes(index)?, form)?;
        let height = self.header.depth().checked_sub(entry.code.level());
        let cells = height.map_or(0, |height| form.dimension.cells(height));
        let ZoneStats { cells: counted, present, sum, squares, .. } = &entry.zone;
        let has_more = present.iter().any(|present| present > counted);
        // Sums that pass this check can be added up without overflow.
        if *counted > cells || has_more || !sum.are_possible(*counted) || !squares.are_possible(*counted) {
            let sums = show_sums(sum, form.value.channels);
            let found = format!("statistics of {counted} cells with sums {sums}");
            let expected = format!("statistics of at most {cells} cells");
            return Err(self.corrupt(format!("directory entry {index}"), found, &expected));
        }
        Ok(entry)
    }

    /// Returns the zone statistics of a segment's node, including class counts.
    ///
    /// # Errors
    /// If the segment or its entry is corrupt.
    ///
    /// # Panics
    /// If there is no such segment.
    pub fn zone(&self, index: usize) -> Result<ZoneStats> {
        let mut zone = self.entry(index)?.zone;
        zone.classes = self.classes(index)?;
        Ok(zone)
    }

    /// Returns the number of cells per value below a segment's node: see
    /// [`Segment::classes`](super::Segment::classes). Reads no other file for a reference.
    ///
    /// # Errors
    /// If the segment or its entry is corrupt.
    ///
    /// # Panics
    /// If there is no such segment.
    pub(crate) fn classes(&self, index: usize) -> Result<Vec<(Value, u64)>> {
        if self.header.codec == Codec::Reference {
            let entry = self.entry(index)?;
            if entry.codec == Codec::Reference {
                return Ok(self.reference(index, &entry)?.classes);
            }
        }
        Ok(self.segment(index)?.classes())
    }
}
