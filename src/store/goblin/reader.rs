//! Reads Goblin files, from a mapping, by positioned reads or from memory.

use std::collections::HashMap;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use zerocopy::FromBytes;

use super::directory::{Entry, code_bits, entry_size};
use super::header::{HEADER_SIZE, Header, Section, TAIL, Trailer};
use super::metadata::Metadata;
use super::record::{CUT, INNER, LEAF, Layout, Record, VOID};
use super::segment::{Bytes, Segment, child_place, child_places};
use crate::space::{Bounds, Code, Dimension};
use crate::store::{Mapped, Positioned, Storage, TreeFormat};
use crate::tree::{Child, Source, Stored};
use crate::value::{Sum, Tally, Value};
use crate::{Error, Result};

/// How to read a file.
#[derive(Clone, Debug)]
pub struct OpenOptions {
    /// Read with positioned reads instead of mapping the file: for network folders and files that somebody may
    /// truncate meanwhile.
    pub positioned: bool,
    /// Bytes of segments kept in memory when reading with positioned reads.
    pub cache: u64,
    /// Check each segment's checksum the first time it is used.
    pub check: bool,
}

impl Default for OpenOptions {
    fn default() -> Self {
        OpenOptions { positioned: false, cache: 64 << 20, check: true }
    }
}

impl OpenOptions {
    /// The file's bytes, the way that was asked for.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn storage(&self, path: &Path) -> Result<Box<dyn Storage>> {
        Ok(if self.positioned { Box::new(Positioned::open(path)?) } else { Box::new(Mapped::open(path)?) })
    }
}

/// A Goblin file, open for reading; may be shared by any number of threads.
///
/// Opening reads the header, the trailer and the metadata. Everything that is read later is checked before it
/// is used: a damaged file gives an error, never a wrong answer (unless [`OpenOptions::check`] is off) or a crash.
pub struct Goblin<D: Layout, V: Value> {
    path: PathBuf,
    storage: Box<dyn Storage>,
    header: Header,
    trailer: Trailer,
    metadata: Metadata,
    /// The directory, if the storage cannot show it.
    directory: Option<Vec<u8>>,
    /// One bit per segment that was found to be good.
    checked: Vec<AtomicU64>,
    /// Bytes of those segments.
    claimed: AtomicU64,
    check: bool,
    cache: Mutex<Cache>,
    types: PhantomData<(D, V)>,
}

/// An INNER node of an open file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Handle<D: Dimension> {
    /// The node.
    pub code: Code<D>,
    pub(in crate::store) segment: u32,
    pub(in crate::store) record: u32,
}

impl<D: Dimension> Handle<D> {
    /// The numbers of the segment and of the record in it that the node has.
    pub(crate) fn place(&self) -> (usize, usize) {
        (self.segment as usize, self.record as usize)
    }
}

/// Where a node's record is.
pub(crate) struct Located<'a, D, V> {
    pub(crate) segment: Segment<'a, D, V>,
    pub(crate) record: usize,
}

/// Reads and checks the header of a tree file, whatever the format and the types.
pub(crate) fn read_header(path: &Path, storage: &dyn Storage) -> Result<(TreeFormat, Header)> {
    let length = storage.len().min(HEADER_SIZE as u64) as usize;
    Header::from_bytes(path, &storage.read(0, length)?)
}

impl<D: Layout, V: Value> Goblin<D, V> {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be read, is no Goblin file, is damaged, or holds other dimensions or values than asked for.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Self> {
        Self::from_storage(path, options.storage(path)?, options)
    }

    /// Opens a file that is in memory.
    ///
    /// # Errors
    /// As [`Goblin::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self> {
        Self::from_storage(Path::new("(memory)"), Box::new(bytes), &OpenOptions::default())
    }

    /// Opens whatever a storage holds; `path` is for messages.
    ///
    /// # Errors
    /// As [`Goblin::open`].
    pub fn from_storage(path: &Path, storage: Box<dyn Storage>, options: &OpenOptions) -> Result<Self> {
        let (format, header) = read_header(path, &*storage)?;
        if format != TreeFormat::Goblin {
            return Err(Error::corrupt(path, "header", "an Autumnal file", "a Goblin file"));
        }
        if header.axes as usize != D::AXES || header.value != V::TYPE {
            let found = format!("{} axes, values {}", header.axes, header.value);
            return Err(Error::corrupt(
                path,
                "header",
                found,
                format!("{} axes, values {}", D::AXES, V::TYPE),
            ));
        }
        let length = storage.len();
        let tail = length.min(TAIL as u64);
        let trailer = Trailer::from_bytes(path, &storage.read(length - tail, tail as usize)?, length)?;
        let size = entry_size(V::CHANNELS) as u64;
        let Section { offset, length, .. } = trailer.directory;
        if trailer.segments.checked_mul(size) != Some(length) || offset < HEADER_SIZE as u64 {
            let found = format!("{length} bytes for {} segments", trailer.segments);
            return Err(Error::corrupt(path, "directory", found, format!("{size} bytes per segment")));
        }
        let section = |section: Section, name: &str| {
            let bytes = storage.read(section.offset, section.length as usize)?;
            let checksum = crc32c::crc32c(&bytes);
            let found = format!("checksum {checksum:08x}");
            let good = checksum == section.checksum;
            good.then_some(bytes)
                .ok_or_else(|| Error::corrupt(path, name, found, format!("{:08x}", section.checksum)))
        };
        let metadata = Metadata::from_bytes(path, &section(trailer.metadata, "metadata")?)?;
        let directory = match storage.bytes() {
            Some(_) => None,
            None => Some(section(trailer.directory, "directory")?.into_owned()),
        };
        let checked = (0..trailer.segments.div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        let cache = Mutex::new(Cache { most: options.cache, ..Cache::default() });
        Ok(Goblin {
            path: path.to_path_buf(),
            storage,
            header,
            trailer,
            metadata,
            directory,
            checked,
            claimed: AtomicU64::new(0),
            check: options.check,
            cache,
            types: PhantomData,
        })
    }

    /// Whether the file's bytes can be seen where they are, so that holding on to them costs nothing.
    pub(crate) fn is_mapped(&self) -> bool {
        self.storage.bytes().is_some()
    }

    /// The file, for messages.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the header says.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// What is told about the data.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Bytes of the whole file.
    pub fn file_size(&self) -> u64 {
        self.storage.len()
    }

    /// Number of segments.
    pub fn segments(&self) -> usize {
        self.trailer.segments as usize
    }

    /// Records in all segments, those stored more than once included.
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
    pub(in crate::store) fn section_checksums(&self) -> Result<Vec<(&'static str, u32, u32)>> {
        let list = [("directory", self.trailer.directory), ("metadata", self.trailer.metadata)];
        list.into_iter()
            .map(|(name, section)| {
                let bytes = self.storage.read(section.offset, section.length as usize)?;
                Ok((name, section.checksum, crc32c::crc32c(&bytes)))
            })
            .collect()
    }

    pub(in crate::store) fn corrupt(&self, place: String, found: impl Into<String>, expected: &str) -> Error {
        Error::corrupt(&self.path, place, found, expected)
    }

    fn directory(&self) -> &[u8] {
        let Section { offset, length, .. } = self.trailer.directory;
        match (&self.directory, self.storage.bytes()) {
            (Some(directory), _) => directory,
            (None, Some(bytes)) => &bytes[offset as usize..][..length as usize],
            (None, None) => &[],
        }
    }

    /// One entry of the directory.
    ///
    /// # Errors
    /// If the entry is damaged.
    ///
    /// # Panics
    /// If there is no such entry.
    pub fn entry(&self, index: usize) -> Result<Entry<D, V>> {
        let size = entry_size(V::CHANNELS);
        let entry = Entry::<D, V>::from_bytes(&self.path, index, &self.directory()[index * size..][..size])?;
        let height = self.header.shape.depth.checked_sub(entry.code.level());
        let cells = height.map_or(0, |height| 1 << (D::AXES * height as usize));
        let zone = &entry.zone;
        // No square of an integer sample is larger than 2^64: sums of any zones cannot overflow.
        let most = zone.cells as f64 * 2f64.powi(64);
        let mut sums = zone.sum.as_ref().iter().chain(zone.squares.as_ref());
        if zone.cells > cells || !(V::TYPE.sample.is_float() || sums.all(|sum| sum.to_f64().abs() <= most)) {
            let found = format!("statistics of {} cells with sums {:?}", zone.cells, zone.sum);
            let expected = format!("those of at most {cells} cells");
            return Err(self.corrupt(format!("directory entry {index}"), found, &expected));
        }
        Ok(entry)
    }

    /// The number of the deepest segment among those of `code` and its ancestors; two searches, O(log segments).
    pub fn find_segment(&self, code: Code<D>) -> Option<usize> {
        let directory = self.directory();
        let size = entry_size(V::CHANNELS);
        let mut code = code;
        let mut high = self.segments();
        loop {
            // The last entry that is not after the code. Codes sort in preorder, so if it is no ancestor, then
            // every ancestor with a segment is an ancestor of that entry too.
            let mut low = 0;
            while low < high {
                let middle = low + (high - low) / 2;
                if code_bits(directory, middle, size) <= code.bits() {
                    low = middle + 1
                } else {
                    high = middle
                }
            }
            let index = low.checked_sub(1)?;
            let before = Code::from_bits(code_bits(directory, index, size))?;
            if before.contains(code) {
                return Some(index);
            }
            let level = before.common_ancestor(code).level();
            code = code.ancestor(self.header.shape.segment_level(level));
            high = index;
        }
    }

    /// One segment.
    ///
    /// # Errors
    /// If it is damaged or cannot be read.
    ///
    /// # Panics
    /// If there is no such segment.
    pub fn segment(&self, index: usize) -> Result<Segment<'_, D, V>> {
        let bit = 1u64 << (index % 64);
        let is_checked = || self.checked[index / 64].load(Ordering::Relaxed) & bit != 0;
        if is_checked() {
            return self.load(index);
        }
        // The entry's own checksum is looked at before any of its numbers is used.
        let entry = self.entry(index)?;
        let place = || format!("segment {} (entry {index})", entry.code);
        let classes = entry.classes as u64 * (size_of::<V::Wire>() as u64 + 8);
        let records = entry.records as u64 * size_of::<D::Record<V>>() as u64;
        if entry.records == 0 || entry.length != records + classes {
            let found = format!("{} bytes, {} records", entry.length, entry.records);
            return Err(self.corrupt(place(), found, "as many bytes as the records and class counts need"));
        }
        let end = entry.offset.checked_add(entry.length);
        if entry.offset < HEADER_SIZE as u64 || end.is_none_or(|end| end > self.trailer.directory.offset) {
            let found = format!("bytes {} + {}", entry.offset, entry.length);
            return Err(self.corrupt(place(), found, "bytes between header and directory"));
        }
        let shape = &self.header.shape;
        if shape.segment_level(entry.code.level()) != entry.code.level() {
            return Err(self.corrupt(place(), format!("level {}", entry.code.level()), "a segment's level"));
        }
        // Segments lie beside each other. Else a small file could claim many large ones, and take hours to walk.
        let room = self.trailer.directory.offset - HEADER_SIZE as u64;
        // (Another thread may have claimed this one meanwhile.)
        if self.claimed.load(Ordering::Acquire) + entry.length > room && !is_checked() {
            return Err(self.corrupt(place(), "bytes of another segment", "segments that do not overlap"));
        }
        let segment = self.load(index)?;
        if self.check {
            let checksum = crc32c::crc32c(segment.all_bytes());
            if checksum != entry.checksum {
                let expected = format!("{:08x}", entry.checksum);
                return Err(self.corrupt(place(), format!("checksum {checksum:08x}"), &expected));
            }
        }
        let skip = segment.records()[0].skip();
        if skip != entry.records {
            let expected = format!("{}, all records", entry.records);
            return Err(self.corrupt(place(), format!("a first skip of {skip}"), &expected));
        }
        let counted = segment.classes().iter().try_fold(0u64, |sum, (_, cells)| sum.checked_add(*cells));
        if entry.classes > 0 && counted != Some(entry.zone.cells) {
            let expected = format!("{}, as the directory has it", entry.zone.cells);
            return Err(self.corrupt(place(), format!("class counts of {counted:?} cells"), &expected));
        }
        if self.checked[index / 64].fetch_or(bit, Ordering::Relaxed) & bit == 0 {
            self.claimed.fetch_add(entry.length, Ordering::Release);
        }
        Ok(segment)
    }

    /// A segment whose entry is known to be good.
    fn load(&self, index: usize) -> Result<Segment<'_, D, V>> {
        let size = entry_size(V::CHANNELS);
        let raw = &self.directory()[index * size..][..size];
        let number = |at: usize| u64::from_le_bytes(raw[at..at + 8].try_into().expect("8 bytes"));
        let code = Code::from_bits(number(0));
        let code =
            code.ok_or_else(|| self.corrupt(format!("directory entry {index}"), "a code", "an FD code"))?;
        let (offset, length) = (number(8), number(16) as usize);
        let records = u32::from_le_bytes(raw[24..28].try_into().expect("4 bytes"));
        let bytes = if self.storage.bytes().is_some() {
            self.storage.read(offset, length)?.into()
        } else {
            self.cached(index, offset, length)?
        };
        let record_bytes = records as usize * size_of::<D::Record<V>>();
        Ok(Segment { code, index, bytes, record_bytes, value: PhantomData })
    }

    fn cached(&self, index: usize, offset: u64, length: usize) -> Result<Bytes<'_>> {
        let held = self.cache.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).get(index);
        if let Some(bytes) = held {
            return Ok(Bytes::Held(bytes));
        }
        let bytes = Arc::new(self.storage.read(offset, length)?.into_owned());
        self.cache.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).put(index, bytes.clone());
        Ok(Bytes::Held(bytes))
    }

    /// The whole tree seen from far away.
    pub fn root_place(&self) -> Result<Child<V, ()>> {
        let value = || {
            let wire = &self.trailer.root_value[..size_of::<V::Wire>()];
            V::from_wire(V::Wire::read_from_bytes(wire).expect("32 bytes hold any value"))
        };
        Ok(match self.trailer.root_state {
            VOID => Child::Void,
            LEAF => Child::Leaf(value()),
            _ => Child::Inner { representative: value(), node: () },
        })
    }

    /// The deepest segment with a node's record, or the uniform value (`None` is VOID) of the block it lies in.
    pub(crate) fn locate(&self, code: Code<D>) -> Result<Child<V, Located<'_, D, V>>> {
        let representative = match self.root_place()? {
            Child::Inner { representative, .. } => representative,
            Child::Leaf(value) => return Ok(Child::Leaf(value)),
            Child::Void => return Ok(Child::Void),
        };
        let segment =
            self.find_segment(code).ok_or_else(|| self.corrupt("directory".into(), "no root", "one"))?;
        let segment = self.segment(segment)?;
        let records = segment.records();
        let mut record = 0;
        let mut value = representative;
        for level in segment.code.level()..code.level() {
            let step = code.step(level);
            let state = records[record].state(step);
            value = records[record].value(step);
            match state {
                VOID => return Ok(Child::Void),
                LEAF => return Ok(Child::Leaf(value)),
                INNER => {
                    let place = child_place::<D, V>(records, record, step);
                    record = place.ok_or_else(|| self.bad_skip(&segment, record))?;
                }
                _ => return Err(self.bad_cut(code.ancestor(level + 1))),
            }
        }
        Ok(Child::Inner { representative: value, node: Located { segment, record } })
    }

    pub(crate) fn bad_skip(&self, segment: &Segment<'_, D, V>, record: usize) -> Error {
        let place = format!("segment {}, record {record}", segment.code);
        self.corrupt(place, "a child's skip that leads out of the node", "skips that add up")
    }

    pub(crate) fn bad_cut(&self, code: Code<D>) -> Error {
        self.corrupt(format!("node {code}"), "CUT, but no deeper segment", "a segment with its record")
    }

    /// The value of a node (a cell, or a block at coarse detail): its own, or that of the LEAF it lies in;
    /// `None` is VOID. At most two searches in the directory and one descent in one segment.
    ///
    /// # Errors
    /// If the file is damaged there.
    pub fn value_at(&self, code: Code<D>) -> Result<Option<V>> {
        let Some(parent) = code.parent() else {
            return Ok(self.root_place()?.value());
        };
        Ok(match self.locate(parent)? {
            Child::Void => None,
            Child::Leaf(value) => Some(value),
            Child::Inner { node: Located { segment, record }, .. } => {
                let record = &segment.records()[record];
                let step = code.step(parent.level());
                (record.state(step) != VOID).then(|| record.value(step))
            }
        })
    }

    /// Zone statistics of a segment's node, class counts included.
    ///
    /// # Errors
    /// If the segment or its entry is damaged.
    pub fn zone(&self, index: usize) -> Result<Tally<V>> {
        let mut zone = self.entry(index)?.zone;
        zone.classes = self.segment(index)?.classes();
        Ok(zone)
    }

    /// Whether classes are counted per zone.
    pub fn counts_classes(&self) -> bool {
        self.header.kind == crate::value::Kind::Categorical
            || self.header.rule == crate::value::Rule::Majority
    }
}

/// A walk goes through every node's own segment, so it never meets a cut.
impl<D: Layout, V: Value> Source for Goblin<D, V> {
    type Dim = D;
    type Value = V;
    type Node = Handle<D>;

    fn depth(&self) -> u8 {
        self.header.shape.depth
    }

    fn root(&self) -> Result<Child<V, Handle<D>>> {
        Ok(match self.root_place()? {
            Child::Void => Child::Void,
            Child::Leaf(value) => Child::Leaf(value),
            Child::Inner { representative, .. } => {
                let segment = self.find_segment(Code::ROOT);
                let segment =
                    segment.ok_or_else(|| self.corrupt("directory".into(), "no root", "one"))? as u32;
                let node = Handle { code: Code::ROOT, segment, record: 0 };
                self.segment(segment as usize)?;
                Child::Inner { representative, node }
            }
        })
    }

    fn each_child(
        &self,
        node: &Handle<D>,
        mut each: impl FnMut(usize, Child<V, Handle<D>>) -> Result<()>,
    ) -> Result<()> {
        let segment = self.segment(node.segment as usize)?;
        let records = segment.records();
        let at = node.record as usize;
        let record = &records[at];
        let places = child_places::<D, V>(records, at).ok_or_else(|| self.bad_skip(&segment, at))?;
        let shape = &self.header.shape;
        let level = node.code.level() + 1;
        if level > shape.depth {
            return Err(self.corrupt(format!("node {}", node.code), "INNER", "no deeper node than a cell"));
        }
        let candidates = shape.is_candidate(level);
        for (step, place) in places.into_iter().enumerate() {
            let state = record.state(step);
            let child = match state {
                VOID => Child::Void,
                LEAF => Child::Leaf(record.value(step)),
                _ => {
                    let code = node.code.child(step);
                    if level == shape.depth {
                        return Err(self.corrupt(format!("node {code}"), "INNER", "a cell, VOID or LEAF"));
                    }
                    let own = candidates.then(|| self.find_segment(code)).flatten();
                    let node = match own {
                        Some(own) if own != segment.index && self.segment(own)?.code == code => {
                            Handle { code, segment: own as u32, record: 0 }
                        }
                        _ if state == CUT => return Err(self.bad_cut(code)),
                        _ => Handle { code, segment: node.segment, record: place.unwrap_or(0) },
                    };
                    Child::Inner { representative: record.value(step), node }
                }
            };
            each(step, child)?;
        }
        Ok(())
    }

    fn draw(&self, bounds: &Bounds, values: &mut [V::Wire], valid: &mut [bool]) -> Result<bool> {
        self.window(self.header.shape.depth, bounds, V::default(), values, Some(valid))?;
        Ok(true)
    }

    fn stored(&self, node: &Handle<D>) -> Option<Stored<'_, D, V>> {
        Some(Stored { file: self, node: *node })
    }
}

/// Segments read lately.
#[derive(Default)]
struct Cache {
    most: u64,
    held: u64,
    time: u64,
    segments: HashMap<usize, (u64, Arc<Vec<u8>>)>,
}

impl Cache {
    fn get(&mut self, index: usize) -> Option<Arc<Vec<u8>>> {
        self.time += 1;
        let (used, bytes) = self.segments.get_mut(&index)?;
        *used = self.time;
        Some(bytes.clone())
    }

    /// Keeps a segment; those not used for longest give way.
    fn put(&mut self, index: usize, bytes: Arc<Vec<u8>>) {
        self.held += bytes.len() as u64;
        if let Some((_, old)) = self.segments.insert(index, (self.time, bytes)) {
            self.held -= old.len() as u64;
        }
        while self.held > self.most && self.segments.len() > 1 {
            let oldest =
                self.segments.iter().filter(|(i, _)| **i != index).min_by_key(|(_, (used, _))| *used);
            let Some(oldest) = oldest.map(|(index, _)| *index) else { return };
            if let Some((_, bytes)) = self.segments.remove(&oldest) {
                self.held -= bytes.len() as u64;
            }
        }
    }
}
