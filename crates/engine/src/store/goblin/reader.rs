//! An open Goblin file, and what it says of itself.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use super::directory::{Entry, show_sums};
use super::index::Directory;
use crate::store::records::{Descend, RecordLayout};
use crate::tree::Child;
use spinney_base::io::{FileAccess, FileStat, ReadBackend, Unpacked};
use spinney_base::value::ZoneStats;
use spinney_base::{Error, Result};
use spinney_container::{Codec, HEADER_SIZE, Header, Layer, Metadata, Section};

/// A layer of a Goblin file, open for reading; may be shared by any number of threads.
///
/// Opening reads the header, the trailer, the table of layers, and the metadata of this one. Everything that is read later is checked before it
/// is used: a damaged file gives an error, never a wrong answer (unless
/// [`OpenOptions::check`](method@spinney_container::OpenOptions::check) is off) or a crash.
pub struct Goblin {
    /// The file, which its layers have in common.
    pub(super) file: Arc<OpenFile>,
    /// Number of the layer.
    pub(super) number: usize,
    pub(super) header: Header,
    /// Layout of its records.
    pub(super) layout: RecordLayout,
    /// The way down through them.
    pub(super) descend: Descend,
    /// The root's state, and its value or representative.
    pub(super) root: Child<()>,
    pub(super) metadata: Metadata,
    pub(super) directory: Directory,
    /// One bit per segment that was found to be good.
    pub(super) checked: Vec<AtomicU64>,
    /// Bytes of those segments in the file.
    pub(super) checked_bytes: AtomicU64,
    /// Segments that were packed.
    pub(super) unpacked: Unpacked,
}

/// An open file with its table of layers.
pub(super) struct OpenFile {
    pub(super) path: PathBuf,
    pub(super) backend: Box<dyn ReadBackend>,
    /// Version of the file when it was opened.
    pub(super) version: Option<FileStat>,
    pub(super) layers: Vec<Layer>,
    /// Where the table of layers is.
    pub(super) table: Section,
    /// Whether each segment's checksum is checked when it is used first.
    pub(super) check: bool,
    pub(super) access: FileAccess,
}

impl Goblin {
    /// Whether all records can be seen where they are, so that holding on to them costs nothing.
    pub(crate) fn is_mapped(&self) -> bool {
        self.header.codec == Codec::Plain && self.file.backend.bytes().is_some()
    }

    /// The file, for messages.
    pub fn path(&self) -> &Path {
        &self.file.path
    }

    /// How the file was opened.
    pub fn access(&self) -> &FileAccess {
        &self.file.access
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
        let changed = |what| Err(Error::Changed { path: self.file.path.clone(), what });
        match (&self.file.version, self.file.backend.stat()?) {
            (Some(before), Some(now)) if now.length < before.length => changed("was cut short"),
            (Some(before), Some(now)) if *before != now => changed("was overwritten"),
            _ => Ok(()),
        }
    }

    /// Queries the host of a remote file whether it still is the version that was opened.
    ///
    /// # Errors
    /// If it is not, or the host does not respond.
    pub fn check_remote(&self) -> Result<()> {
        self.file.backend.check_remote()
    }

    /// Version of the file when it was opened; `None` of one in memory.
    pub fn version(&self) -> Option<&FileStat> {
        self.file.version.as_ref()
    }

    /// Bytes of the whole file.
    pub fn file_size(&self) -> u64 {
        self.file.backend.len()
    }

    /// The layers of the file, of which this is one.
    pub fn layers(&self) -> &[Layer] {
        &self.file.layers
    }

    /// The number of this layer.
    pub fn layer_number(&self) -> usize {
        self.number
    }

    /// This layer, as the file's table has it.
    #[inline]
    pub(super) fn layer(&self) -> &Layer {
        &self.file.layers[self.number]
    }

    /// Number of segments.
    #[inline]
    pub fn segments(&self) -> usize {
        self.layer().segments as usize
    }

    /// Places of records in all segments: those stored more than once take several, those in dense blocks less than one each.
    pub fn stored_records(&self) -> u64 {
        self.layer().stored_records
    }

    /// Name and bytes of each part of the file; of several layers those of all.
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

    /// The error for a part of the file that breaks the format's rules.
    #[cold]
    pub(super) fn corrupt(&self, part: String, found: impl Into<String>, expected: &str) -> Error {
        Error::corrupt(&self.file.path, part, found, expected)
    }

    /// The root: its state, and its value or representative.
    #[inline]
    pub fn root_child(&self) -> Child<()> {
        self.root
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
        let entry = Entry::from_bytes(&self.file.path, index, &self.entry_bytes(index)?, form)?;
        let height = self.header.depth().checked_sub(entry.code.level());
        let cells = height.map_or(0, |height| form.dimension.cells(height));
        let ZoneStats { cells: counted, present, sum, squares, .. } = &entry.zone;
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
    pub fn zone(&self, index: usize) -> Result<ZoneStats> {
        let mut zone = self.entry(index)?.zone;
        zone.classes = self.segment(index)?.classes();
        Ok(zone)
    }
}
