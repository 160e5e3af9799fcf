//! Segments that are references: their cells are in files of other formats.
//!
//! The nodes of a block of cells and the bytes of its segment are a function of the cells alone. So
//! a reference stores only what is needed without the cells, class counts and node counts, and the
//! checksum of the segment that building yields. A crate that knows the other formats reads the
//! cells: see [`register_references`].

use std::path::Path;
use std::sync::{Arc, OnceLock};

use super::directory::{Entry, listed};
use super::packed::class_counts;
use super::reader::Goblin;
use super::segment::Segment;
use super::source::GoblinNode;
use crate::store::builder::{Slab, build_block};
use crate::store::records::subtree::{RECORDS_ARE_CHECKED, count_nodes};
use crate::store::records::{Descent, RecordLayout};
use crate::tree::{Child, Source, no_children};
use spinney_base::io::{FileAccess, FileBytes, FileStat, ReadBackend};
use spinney_base::space::{Code, Region};
use spinney_base::value::{Value, ZoneStats};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Codec, Finding, Header, Layer, LevelCounts, Section, Trailer};

/// A file whose cells are in other files.
pub struct ReferringFile<'f> {
    /// The file.
    pub path: &'f Path,
    /// Its bytes.
    pub bytes: &'f dyn ReadBackend,
    /// How it was opened, and how other files are opened.
    pub access: &'f FileAccess,
    /// Section that lists the other files, and where their pixels are in each layer.
    pub sources: Section,
    /// Section of pages that describe the other files.
    pub pages: Section,
    /// Headers of its layers.
    pub headers: &'f [Header],
}

/// Opens the cells that a file refers to, but none of the other files. Fails if the sections are
/// corrupt, or cannot be read.
type OpenReferences = fn(&ReferringFile<'_>) -> Result<Box<dyn ReferencedCells>>;

/// The cells that a file refers to. `bytes` are always those of this file.
pub trait ReferencedCells: Send + Sync {
    /// Reads the cells of a region within a layer's extent.
    ///
    /// # Errors
    /// If another file cannot be read, or has changed since the file was written.
    fn read(&self, bytes: &dyn ReadBackend, layer: usize, region: Region) -> Result<Slab>;

    /// Returns the value that means VOID in a layer's cells.
    fn nodata(&self, layer: usize) -> Option<Value>;

    /// Announces that cells of a region will be read, so that what describes them in this file is
    /// fetched in the present batch.
    fn announce(&self, bytes: &dyn ReadBackend, layer: usize, region: Region);

    /// Checks the sections; with `with_files` also lengths and versions of the other files, instead
    /// of their cells, which are checked with the tree.
    ///
    /// # Errors
    /// If this file cannot be read, or on cancellation.
    fn verify(
        &self,
        bytes: &dyn ReadBackend,
        with_files: bool,
        progress: &dyn Progress,
    ) -> Result<Vec<Finding>>;

    /// Returns the number of other files.
    fn sources(&self) -> usize;

    /// Passes the name of each other file to a function, with the length and version that it had
    /// when it was indexed, until the function returns false.
    ///
    /// # Errors
    /// If a description is corrupt, and those of the function.
    fn visit_sources(
        &self,
        bytes: &dyn ReadBackend,
        visit: &mut dyn FnMut(&str, FileStat) -> Result<bool>,
    ) -> Result<()>;
}

/// Tag of the section that lists the other files.
pub(in crate::store) const SOURCES_TAG: [u8; 4] = *b"SRCS";
/// Tag of the section with pages that describe them.
pub(in crate::store) const PAGES_TAG: [u8; 4] = *b"SRCP";

/// Opens cells in other files. (Formats of rasters are not known here.)
static OPEN: OnceLock<OpenReferences> = OnceLock::new();

/// Sets how cells in other files are opened in this process. Only the first call has an effect.
pub fn register_references(open: OpenReferences) {
    // (All callers register the same function.)
    let _ = OPEN.set(open);
}

/// Opens the cells that a file refers to.
pub(super) fn open_references(
    path: &Path,
    bytes: &dyn ReadBackend,
    (trailer, layers): (&Trailer, &[Layer]),
    access: &FileAccess,
) -> Result<Option<Box<dyn ReferencedCells>>> {
    let headers: Vec<Header> = layers.iter().map(|layer| layer.header.clone()).collect();
    let [sources, pages] = trailer_sections(trailer);
    // (The head of a sharded build is opened before its sections exist. It has no segments, so it
    // needs no cells.)
    let is_head = sources.length == 0 && layers.iter().all(|layer| layer.segments == 0);
    if is_head || headers.iter().all(|header| header.codec != Codec::Reference) {
        return Ok(None);
    }
    let open = OPEN.get().ok_or_else(|| {
        let advice = "use a build of Spinney that reads rasters";
        Error::unsupported(path, "an index of rasters, whose cells are in other files", advice)
    })?;
    open(&ReferringFile { path, bytes, access, sources, pages, headers: &headers }).map(Some)
}

/// Returns the sections that describe other files.
pub(super) fn trailer_sections(trailer: &Trailer) -> [Section; 2] {
    [SOURCES_TAG, PAGES_TAG].map(|tag| trailer.section(tag))
}

/// A segment that is a reference.
#[derive(Debug, PartialEq)]
pub(super) struct Reference {
    /// CRC-32C of the plain segment: records, then class counts.
    pub(super) checksum: u32,
    /// Class counts.
    pub(super) classes: Vec<(Value, u64)>,
    /// Numbers of INNER and of VOID nodes of each level below the finest stored one; for the cells
    /// the number of VOID ones alone. (The level counts of an updated index are sums of these.)
    pub(super) nodes: Vec<u64>,
}

/// Returns how many numbers of nodes a reference has.
fn node_numbers(header: &Header) -> usize {
    2 * usize::from(header.shape.stride) - 1
}

impl Reference {
    /// Returns the reference for a segment.
    pub(super) fn of(header: &Header, level: u8, records: &[u8], tally: &ZoneStats) -> Reference {
        let (_, counts) = class_counts(header, tally);
        let checksum = crc32c::crc32c_append(crc32c::crc32c(records), &counts);
        let classes = if counts.is_empty() { &[] } else { tally.listed_classes().unwrap_or_default() };
        let (levels, mut below) = (header.depth() - level, LevelCounts::default());
        count_nodes(RecordLayout::new(header.form), records, levels, 0, &mut below)
            .expect(RECORDS_ARE_CHECKED);
        let stored = levels.saturating_sub(header.shape.stride);
        let of_level = |level: usize| below.levels().get(level).copied().unwrap_or_default();
        let deeper = (usize::from(stored) + 1..usize::from(levels)).map(of_level);
        let mut nodes: Vec<u64> = deeper.flat_map(|[void, _, inner]| [inner, void]).collect();
        nodes.push(of_level(levels.into())[0]);
        nodes.resize(node_numbers(header), 0);
        Reference { checksum, classes: classes.to_vec(), nodes }
    }

    /// Encodes it: the checksum; value and number of cells of each class, where the number of the
    /// last class is that of the other cells; the numbers of nodes. Numbers have 7 bits in each
    /// byte, from the lowest, and the highest bit is set if more follow.
    pub(super) fn to_bytes(&self, width: usize) -> Vec<u8> {
        let mut bytes = self.checksum.to_le_bytes().to_vec();
        for (number, (value, cells)) in (1..).zip(&self.classes) {
            bytes.extend_from_slice(&value.to_bytes()[..width]);
            if number < self.classes.len() {
                push_number(&mut bytes, *cells);
            }
        }
        self.nodes.iter().for_each(|number| push_number(&mut bytes, *number));
        bytes
    }

    /// Decodes a reference with `classes` class counts of `all` cells, and `nodes` numbers of
    /// nodes.
    fn from_bytes(bytes: &[u8], width: usize, (classes, all): (u16, u64), nodes: usize) -> Option<Reference> {
        let (checksum, mut rest) = bytes.split_first_chunk()?;
        let mut counts = Vec::with_capacity(classes.into());
        let mut left = all;
        for number in 1..=classes {
            let value = Value::from_bytes(rest.get(..width)?);
            rest = &rest[width..];
            let cells = if number < classes { take_number(&mut rest)? } else { left };
            left = left.checked_sub(cells)?;
            counts.push((value, cells));
        }
        let nodes = (0..nodes).map(|_| take_number(&mut rest)).collect::<Option<_>>()?;
        let checksum = u32::from_le_bytes(*checksum);
        rest.is_empty().then_some(Reference { checksum, classes: counts, nodes })
    }
}

fn push_number(bytes: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

fn take_number(bytes: &mut &[u8]) -> Option<u64> {
    let mut number = 0;
    for shift in (0..63).step_by(7) {
        let (byte, rest) = bytes.split_first()?;
        (number, *bytes) = (number | u64::from(byte & 0x7f) << shift, rest);
        if *byte < 0x80 {
            return Some(number);
        }
    }
    None
}

impl Goblin {
    /// Announces a node whose entry could not be read yet: what describes its cells is then fetched
    /// in the same batch.
    pub(super) fn announce(&self, code: Code) {
        let block = self.header.shape.block_level();
        if let Some(cells) = &self.file.references
            && self.header.is_referenced(block)
            && code.level() >= block
        {
            cells.announce(&*self.file.backend, self.number, self.header.region_of(code.ancestor(block)));
        }
    }

    /// Passes the file, as the file that refers to others, to a function; `None` if its cells are
    /// its own.
    pub fn referring<T>(&self, each: impl FnOnce(&ReferringFile<'_>) -> T) -> Option<T> {
        let file = &self.file;
        let [sources, pages] = file.reference_sections?;
        let headers: Vec<Header> = file.layers.iter().map(|layer| layer.header.clone()).collect();
        let bytes = &*file.backend;
        Some(each(&ReferringFile {
            path: &file.path,
            bytes,
            access: &file.access,
            sources,
            pages,
            headers: &headers,
        }))
    }

    /// Returns the cells that the file refers to, if there are any.
    pub fn references(&self) -> Option<(&dyn ReferencedCells, &dyn ReadBackend)> {
        self.file.references.as_deref().map(|cells| (cells, &*self.file.backend))
    }

    /// Returns the segment with the stored levels of a block, whose own segment is a reference, and
    /// the record of its node there.
    pub(super) fn stored_above(&self, code: Code) -> Result<(Segment<'_>, usize)> {
        let parent = code.parent().ok_or_else(|| self.bad_cut(code))?;
        let segment = self.segment_above(parent)?;
        match (self.descend)(segment.records(), 0, segment.code().level(), code) {
            Descent::Inner(record) => Ok((segment, record)),
            _ => Err(self.corrupt(
                format!("node {code}"),
                "no record",
                "the record of a node with a reference",
            )),
        }
    }

    /// Returns a node and its state, by code.
    ///
    /// # Errors
    /// If the file is corrupt on the way.
    pub(crate) fn child_at(&self, code: Code) -> Result<Child<GoblinNode>> {
        let (mut child, mut children) = (self.root()?, no_children());
        for level in 0..code.level() {
            let Child::Inner { node, .. } = child else { break };
            self.children(&node, &mut children)?;
            child = children[code.step(level)];
        }
        Ok(child)
    }

    /// Returns the name of the first source for which `is_wanted` holds, if the cells are in other
    /// files.
    ///
    /// # Errors
    /// If the description of a source is corrupt.
    pub fn find_source(&self, is_wanted: &dyn Fn(&str) -> bool) -> Result<Option<String>> {
        let Some((cells, bytes)) = self.references() else { return Ok(None) };
        let mut found = None;
        cells.visit_sources(bytes, &mut |name, _| {
            found = is_wanted(name).then(|| name.to_string());
            Ok(found.is_none())
        })?;
        Ok(found)
    }

    /// Reads the reference of an entry.
    pub(super) fn reference(&self, index: usize, entry: &Entry) -> Result<Reference> {
        let part = || format!("segment {} (entry {index})", entry.code);
        // (The classes of a block of cells fit.)
        let nodes = node_numbers(&self.header);
        let most = 4 + usize::from(listed(entry.classes)) * (self.layout.width + 9) + 9 * nodes;
        if entry.length > most as u64 {
            let found = format!("a reference of {} bytes", entry.length);
            return Err(self.corrupt(part(), found, &format!("at most {most}")));
        }
        let stored = self.stored_bytes(entry.offset, entry.length as usize)?;
        let stored = stored.ok_or_else(|| self.changed(index))?;
        self.check_checksum(index, entry, &stored)?;
        let counts = (listed(entry.classes), entry.zone.cells);
        Reference::from_bytes(&stored, self.layout.width, counts, nodes).ok_or_else(|| {
            self.corrupt(part(), "an invalid reference", "a checksum, class counts, node counts")
        })
    }

    /// Returns the plain bytes of a segment that is a reference: builds it from its cells.
    pub(super) fn referenced(&self, index: usize, entry: &Entry) -> Result<FileBytes<'_>> {
        let Entry { code: node, records, classes, .. } = *entry;
        let cells = self.file.references.as_deref().ok_or_else(|| self.changed(index))?;
        let region = self.header.region_of(node);
        if region.is_empty() {
            return Err(self.corrupt(format!("segment {node}"), "no cells", "cells of the extent"));
        }
        // (The reference's error is returned only after the cells were requested, so that one batch
        // fetches both.)
        let slab = cells.read(&*self.file.backend, self.number, region);
        let (reference, slab) = (self.reference(index, entry)?, slab?);
        let (_, sealed, _) = build_block(&self.header, node, &slab, cells.nodata(self.number));
        let bytes = sealed.map_or(Vec::new(), |sealed| {
            let mut bytes = sealed.records;
            bytes.extend_from_slice(&class_counts(&self.header, &sealed.tally).1);
            bytes
        });
        let plain = self.plain_length(records, listed(classes));
        if bytes.len() as u64 != plain || crc32c::crc32c(&bytes) != reference.checksum {
            let part = format!("cells {}..{}, {}..{}", region.x, region.right(), region.y, region.bottom());
            let expected = "the values that were indexed, from the same decoder (`spinney index --update` writes new ones)";
            return Err(self.corrupt(part, "other values", expected));
        }
        Ok(FileBytes::Cached(self.unpacked.put(index as u64, Arc::new(bytes))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_come_back() {
        let class = |class: u8, cells| (Value::from_bytes(&[class]), cells);
        for classes in [vec![], vec![class(7, 65536)], vec![class(0, 3), class(1, 60000), class(255, 5533)]] {
            let reference = Reference { checksum: 0x1234_5678, classes, nodes: vec![16384, 0, 300] };
            let counts = (reference.classes.len() as u16, 65536);
            let bytes = reference.to_bytes(1);
            assert_eq!(Reference::from_bytes(&bytes, 1, counts, 3).as_ref(), Some(&reference));
            assert!(Reference::from_bytes(&bytes, 1, counts, 4).is_none());
            assert!(Reference::from_bytes(&bytes[..bytes.len() - 1], 1, counts, 3).is_none());
            assert!(Reference::from_bytes(&[&bytes[..], &[0]].concat(), 1, counts, 3).is_none());
        }
        let endless = [&[0; 4][..], &[0xff; 30]].concat();
        assert!(Reference::from_bytes(&endless, 1, (0, 0), 1).is_none());
    }
}
