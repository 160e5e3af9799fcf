//! Reads a commit of an Autumnal file.

use std::cell::Cell;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use super::archive::{Archive, OpenFile};
use super::commit::{Commit, CommitLayer, Root};
use super::extents::{ByteAccess, ExtentKind, Extents};
use super::layout::{BadRecord, Heights, PointeredLayout, RecordFields};
use super::meta::{Slot, slots};
use super::newest::whole;
use super::node::AutumnalNode;
use super::pages::FIRST_EXTENT;
use super::zone::{BadZone, Zone, inner_nodes};
use crate::store::records::{Descent, Runs};
use crate::tree::{Child, Source};
use spinney_base::io::{FileAccess, FileBytes, FileId, FileStat};
use spinney_base::space::Code;
use spinney_base::value::Value;
use spinney_base::{Error, Result};
use spinney_container::{FileReference, Header, INNER, LEAF, Metadata, OpenOptions, VOID};

/// A layer in a commit of an Autumnal file, open for reading. Any number of threads may share it.
///
/// It does not change when a writer appends to the file; [`Autumnal::refresh`] moves to the newest
/// commit. The extent of each record is checked before the record is used, so a corrupt file gives
/// an error and never a crash. (A file that was crafted with the right checksums may give wrong
/// values; [`Autumnal::verify`] finds them.)
pub struct Autumnal {
    pub(super) archive: Archive,
    pub(super) commit: Commit,
    /// Number of the layer.
    pub(super) number: usize,
    header: Header,
    layout: PointeredLayout,
    metadata: Metadata,
    root: Child<AutumnalNode>,
    /// Path and options to check for a newer commit; `None` if the tree stays at its commit or is
    /// not from a file.
    opened: Option<(PathBuf, OpenOptions)>,
}

/// Maximum number of INNER nodes for traversing a whole tree. Nodes of shared subtrees count once
/// per occurrence: a small file can declare any number of nodes equal, and a traversal would never
/// end.
pub(super) const MAX_TRAVERSED: u64 = 1 << 36;

/// Bytes to read for the number of INNER nodes at a zone's start (it takes a few bytes less).
const CLAIM_READ: usize = 16;

/// First read of a record in bytes; its length is unknown.
const FIRST_RECORD_READ: usize = 1024;

/// First read of a zone in bytes; its length is unknown.
const FIRST_ZONE_READ: usize = 256;

/// A record in its stored form.
pub(super) struct PointeredRecord<B> {
    pub(super) address: u64,
    /// Height of the record's own node.
    pub(super) height: u8,
    /// Bytes from the start of the record, at least up to its zone.
    pub(super) bytes: B,
    pub(super) fields: RecordFields,
}

impl<B: Deref<Target = [u8]>> PointeredRecord<B> {
    /// Returns the levels below the record's node.
    #[inline]
    pub(super) fn run(&self) -> &[u8] {
        self.fields.run(&self.bytes)
    }
}

/// A record that was read individually.
type OneRecord<'a> = PointeredRecord<FileBytes<'a>>;

impl Autumnal {
    /// Opens a commit of a file. `map.autumn@12` is the commit with number 12, `map.autumn` the
    /// newest one. `map.autumn:NAME` is a layer; the first layer is the default.
    ///
    /// # Errors
    /// If it cannot be read, is not an Autumnal file, is corrupt, or has no such commit.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Autumnal> {
        let place = FileReference::of(path);
        Autumnal::of_opened(&place, options.open_with_id(&place.file)?, options)
    }

    /// Opens a commit of a file whose bytes are open already.
    ///
    /// # Errors
    /// Those of [`Autumnal::open`].
    pub(crate) fn of_opened(
        place: &FileReference<'_>,
        opened: OpenFile,
        options: &OpenOptions,
    ) -> Result<Autumnal> {
        let FileReference { file: path, commit: number, .. } = place;
        // If a writer was active, the file is opened again by its name.
        let first = Cell::new(Some(opened));
        let open = || first.take().map_or_else(|| options.open_with_id(path), Ok);
        let archive = Archive::open(path, &open, options)?;
        let commit = number.map_or_else(|| archive.newest(), |number| archive.commit(number))?;
        let names = commit.layers.iter().map(|layer| &*layer.name);
        let layer = place.layer_number(names)?;
        let mut tree = Autumnal::new(archive, commit, layer)?;
        tree.opened = number.is_none().then(|| (path.to_path_buf(), options.clone()));
        Ok(tree)
    }

    /// Returns the options that the file was opened with.
    pub fn access(&self) -> &FileAccess {
        &self.archive.access
    }

    /// Opens the newest commit of a file in memory.
    ///
    /// # Errors
    /// As [`Autumnal::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Autumnal> {
        let archive = Archive::of_bytes(Path::new("(memory)"), bytes)?;
        let commit = archive.newest()?;
        Autumnal::new(archive, commit, 0)
    }

    /// Opens a layer in a commit of an open file.
    ///
    /// # Panics
    /// If there is no layer of that number.
    pub(super) fn new(archive: Archive, commit: Commit, number: usize) -> Result<Autumnal> {
        let extents = &archive.extents;
        let layer = &commit.layers[number];
        let bytes = extents.whole(ExtentKind::Metadata, layer.metadata)?;
        let metadata = Metadata { name: layer.name.clone(), ..Metadata::from_bytes(&extents.path, &bytes)? };
        Autumnal::with_metadata(archive, commit, number, metadata)
    }

    /// Opens another layer of the same commit.
    ///
    /// # Errors
    /// If it is corrupt.
    ///
    /// # Panics
    /// If there is no layer of that number.
    pub fn open_layer(&self, number: usize) -> Result<Autumnal> {
        let mut tree = Autumnal::new(self.archive.clone(), self.commit.clone(), number)?;
        tree.opened = self.opened.clone();
        Ok(tree)
    }

    /// Returns the header of each layer of the commit.
    ///
    /// # Errors
    /// If one is corrupt.
    pub(crate) fn layer_headers(&self) -> Result<Vec<Header>> {
        self.commit.layers.iter().map(|layer| self.archive.layer_header(layer)).collect()
    }

    /// Returns the number of this layer in its commit.
    pub fn layer_number(&self) -> usize {
        self.number
    }

    /// Returns this layer's entry in the commit.
    pub(super) fn layer(&self) -> &CommitLayer {
        &self.commit.layers[self.number]
    }

    /// Opens a layer in a commit of an open file, with known metadata.
    pub(super) fn with_metadata(
        archive: Archive,
        commit: Commit,
        number: usize,
        metadata: Metadata,
    ) -> Result<Autumnal> {
        let corrupt = |found: String, expected| archive.extents.corrupt("commit", found, expected);
        let header = archive.layer_header(&commit.layers[number])?;
        let layout = PointeredLayout::new(header.form, archive.form.run_levels, header.depth());
        let Root { state, value, address } = &commit.layers[number].root;
        let value = || match value.len() == header.form.width() {
            true => Ok(Value::from_bytes(value)),
            false => Err(corrupt("a root value of a different size".into(), "one value")),
        };
        let root = match *state {
            VOID => Child::Void,
            LEAF => Child::Leaf(value()?),
            // (Children of a cell would lie outside of the space.)
            INNER if header.depth() == 0 => {
                return Err(corrupt("an INNER root of a tree that is one cell".into(), "VOID or LEAF"));
            }
            INNER => {
                let node = AutumnalNode::new(*address, header.depth());
                Child::Inner { representative: value()?, node }
            }
            other => return Err(corrupt(format!("root state {other}"), "0, 1 or 2")),
        };
        Ok(Autumnal { archive, commit, number, header, layout, metadata, root, opened: None })
    }

    /// Moves to the newest commit if there is a newer one, and returns whether it did. Trees that
    /// were opened at a certain commit stay there.
    ///
    /// # Errors
    /// If the file cannot be read. The tree is unchanged then.
    pub fn refresh(&mut self) -> Result<bool> {
        let Some((path, options)) = &self.opened else { return Ok(false) };
        // (The identity is unique if the system has none for files. Then the slot alone decides.)
        let Archive { meta, file, .. } = self.archive;
        let is_same = |other_meta, other: FileId| other_meta == meta && (other == file || other.is_unique());
        let (bytes, current) = options.open_with_id(path)?;
        let slots = slots(&*bytes)?;
        // (The newest commit may be one whose slot is corrupt.)
        let is_whole = !slots.contains(&Slot::Corrupt);
        if is_whole && whole(&slots).first().is_some_and(|newest| is_same(*newest, current)) {
            return Ok(false);
        }
        let place = FileReference { file: path.into(), commit: None, layer: None };
        let mut new = Autumnal::of_opened(&place, options.open_with_id(path)?, options)?;
        let name = &self.layer().name;
        // (By its name alone: a name may look like the number of another layer.)
        if !name.is_empty() {
            let number = new.commit.layer_named(name).ok_or_else(|| {
                let found = format!("no layer `{name}`");
                Error::invalid(
                    format!("{}: newest commit", path.display()),
                    found,
                    "that layer, which the previous commit has",
                )
            })?;
            new = new.open_layer(number)?;
        }
        let is_newer = !is_same(new.archive.meta, new.archive.file);
        if is_newer {
            *self = new;
        }
        Ok(is_newer)
    }

    /// Returns the file's path, for messages.
    pub fn path(&self) -> &Path {
        &self.archive.extents.path
    }

    /// Returns the layer's header. Its shape is that of the Goblin file that publishing would
    /// write.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Returns georeference, meaning and provenance of the data.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Returns the commit.
    pub fn commit(&self) -> &Commit {
        &self.commit
    }

    /// Returns the number of INNER nodes of the layer's tree. Nodes of shared subtrees count once
    /// per occurrence, so it can exceed the number of records.
    pub fn inner_nodes(&self) -> u64 {
        self.layer().inner_nodes
    }

    /// Returns a remark on the file for its users, if its newest commit was not found through its
    /// own slot.
    pub fn remark(&self) -> Option<&'static str> {
        self.archive.remark()
    }

    /// Returns whether equal subtrees are stored once.
    pub fn is_shared(&self) -> bool {
        self.archive.form.share
    }

    /// Checks that the file still has the commit and those before it: that it extends to the
    /// commit's end, and that its newest commit is not older.
    ///
    /// # Errors
    /// If the file was overwritten or truncated.
    pub fn check_unchanged(&self) -> Result<()> {
        self.archive.check_unchanged()
    }

    /// Queries the host of a remote file whether the file is still the version that was opened. A
    /// file with more commits is another version, of which nothing is read.
    ///
    /// # Errors
    /// If it is not, or the host does not respond.
    pub fn check_remote(&self) -> Result<()> {
        self.archive.extents.check_remote()
    }

    /// Returns the file version at the time of opening, or `None` for a file in memory.
    pub fn version(&self) -> Option<&FileStat> {
        self.archive.extents.version.as_ref()
    }

    /// Returns the size of the file in bytes.
    pub fn file_size(&self) -> u64 {
        self.archive.extents.file_size()
    }

    /// Returns name and size in bytes of each section of the file, in order.
    pub fn sections(&self) -> Vec<(&'static str, u64)> {
        let end = self.archive.extents.end;
        let commits = if self.archive.form.may_pack { "commits, packed history" } else { "commits" };
        vec![("header", FIRST_EXTENT), (commits, end - FIRST_EXTENT), ("unused", self.file_size() - end)]
    }

    #[inline]
    pub(super) fn extents(&self) -> &Extents {
        &self.archive.extents
    }

    #[inline]
    pub(super) fn layout(&self) -> &PointeredLayout {
        &self.layout
    }

    #[inline]
    pub(super) fn heights(&self) -> Heights {
        self.layout().heights
    }

    #[cold]
    pub(super) fn bad_record(&self, address: u64, found: &str, expected: &str) -> Error {
        self.extents().corrupt(format!("record at {address}"), found, expected)
    }

    #[cold]
    fn cut_short(&self, address: u64) -> Error {
        self.bad_record(address, "the end of the file", "a complete record")
    }

    #[cold]
    fn bad_zone(&self, address: u64) -> Error {
        self.bad_record(address, "an invalid zone", "statistics of the cells below")
    }

    #[cold]
    pub(super) fn bad_run(&self, address: u64) -> Error {
        self.bad_record(address, "an inconsistent run", "consistent records")
    }

    /// Reads the record that contains a node.
    pub(super) fn record(&self, node: AutumnalNode) -> Result<OneRecord<'_>> {
        Ok(match self.extents().mapped() {
            Some(mapped) => {
                let PointeredRecord { address, height, bytes, fields } = self.record_in(mapped, node)?;
                PointeredRecord { address, height, bytes: FileBytes::Mapped(bytes), fields }
            }
            None => self.record_in(self.extents(), node)?,
        })
    }

    #[inline(always)] // hot path of every descent
    pub(super) fn record_in<'a, A: ByteAccess<'a>>(
        &self,
        access: A,
        node: AutumnalNode,
    ) -> Result<PointeredRecord<A::Bytes>> {
        let AutumnalNode { address, height, .. } = node;
        let height = self.heights().record_of(height);
        let mut most = FIRST_RECORD_READ;
        loop {
            let bytes = access.bytes(address, most)?;
            match self.layout().fields(&bytes, height) {
                Ok(fields) => return Ok(PointeredRecord { address, height, bytes, fields }),
                // (Repeated reads do not get shorter, and no record is longer than its fields say.)
                Err(BadRecord::Short(needed)) if needed > most && bytes.len() >= most => most = needed,
                Err(BadRecord::Short(_)) => return Err(self.cut_short(address)),
                Err(BadRecord::Wrong) => {
                    return Err(self.bad_record(address, "invalid fields", "the fields of a record"));
                }
            }
        }
    }

    /// Returns the representative of a node with a record of its own.
    pub(super) fn representative(&self, node: AutumnalNode) -> Result<Value> {
        let bytes = self.extents().bytes(node.address, self.layout().width())?;
        self.layout().representative(&bytes).ok_or_else(|| self.cut_short(node.address))
    }

    /// Returns the node that pointer `number` leads to, if there is one.
    #[inline]
    pub(super) fn follow<B>(&self, record: &PointeredRecord<B>, number: usize) -> Result<Option<AutumnalNode>>
    where
        B: Deref<Target = [u8]>,
    {
        let Some(height) = self.heights().target_height(record.height) else { return Ok(None) };
        let target = record.fields.pointer(&record.bytes, record.address, number);
        let target = target.ok_or_else(|| self.bad_pointer(record.address))?;
        Ok(target.map(|address| AutumnalNode::new(address, height)))
    }

    #[cold]
    fn bad_pointer(&self, address: u64) -> Error {
        self.bad_record(address, "a pointer that does not point backwards", "a pointer to an earlier record")
    }

    #[cold]
    pub(super) fn no_pointer(&self, address: u64) -> Error {
        self.bad_record(address, "an INNER node without a pointer", "a pointer to its record")
    }

    /// Returns the root: its state, value or representative, and node.
    pub fn root_child(&self) -> Child<AutumnalNode> {
        self.root
    }

    /// Returns the value of a node (a cell, or a block at coarse detail): its own, or that of the
    /// LEAF that contains it. `None` is VOID. Reads one record for every two levels on the way to
    /// it.
    ///
    /// # Errors
    /// If the file is corrupt there.
    pub fn value_at(&self, code: Code) -> Result<Option<Value>> {
        match self.extents().mapped() {
            Some(mapped) => self.value_in_access(mapped, code),
            None => self.value_in_access(self.extents(), code),
        }
    }

    #[inline]
    fn value_in_access<'a, A: ByteAccess<'a>>(&self, access: A, code: Code) -> Result<Option<Value>> {
        let mut node = match self.root {
            Child::Inner { node, .. } if code.level() > 0 => node,
            root => return Ok(root.value()),
        };
        let depth = self.header().depth();
        loop {
            let record = self.record_in(access, node)?;
            let level = depth - record.height;
            if code.level() - level > self.heights().run_of(record.height)
                && let Some(target_height) = self.heights().target_height(record.height)
            {
                let to = depth - target_height;
                let number = (level..to)
                    .fold(0, |number, level| number * self.layout().form.children() + code.step(level));
                if let Some(next) = self.follow(&record, number)? {
                    node = next;
                    continue;
                }
                // The node is uniform or within a uniform one, and the run has its value. The upper
                // levels of the run may be a dense block, down to CUT nodes. It has no states above
                // its bottom, but a value for each position, also inside uniform nodes: that of the
                // node itself is the result.
                return match self.descend(&record, code.ancestor(to)) {
                    Descent::Void => Ok(None),
                    Descent::Leaf(value) => Ok(Some(value)),
                    Descent::Dense(at, top) => {
                        let value = self.layout().run.value_below(record.run(), at, top, code.ancestor(to));
                        value.ok_or_else(|| self.bad_run(record.address))
                    }
                    _ => Err(self.no_pointer(record.address)),
                };
            }
            let parent = code.ancestor(code.level() - 1);
            let run = record.run();
            let value = match self.descend(&record, parent) {
                Descent::Void => Some(None),
                Descent::Leaf(value) => Some(Some(value)),
                Descent::Inner(at) => self.layout().run.value_below(run, at, parent.level(), code),
                Descent::Dense(at, top) => self.layout().run.value_below(run, at, top, code),
                Descent::Cut(_) | Descent::BadSkip(_) => None,
            };
            return value.ok_or_else(|| self.bad_run(record.address));
        }
    }

    /// Descends to a node in the run of a record.
    #[inline]
    fn descend<B: Deref<Target = [u8]>>(&self, record: &PointeredRecord<B>, code: Code) -> Descent {
        (self.layout().descend)(record.run(), 0, self.header().depth() - record.height, code)
    }

    /// Returns the INNER node with a code, if it has a record of its own.
    pub(super) fn inner_at(&self, code: Code) -> Result<Option<AutumnalNode>> {
        let Child::Inner { mut node, .. } = self.root else { return Ok(None) };
        let depth = self.header().depth();
        while depth - node.height < code.level() {
            let record = self.record(node)?;
            let level = depth - record.height;
            let Some(target_height) = self.heights().target_height(record.height) else { return Ok(None) };
            let to = depth - target_height;
            if to > code.level() {
                return Ok(None);
            }
            let number = (level..to)
                .fold(0, |number, level| number * self.layout().form.children() + code.step(level));
            match self.follow(&record, number)? {
                Some(next) => node = next,
                None => return Ok(None),
            }
        }
        Ok(Some(node))
    }

    /// Returns the bytes after a node's record, at most `most`: its zone, and what follows.
    fn bytes_after(&self, node: AutumnalNode, most: usize) -> Result<FileBytes<'_>> {
        let length = self.record(node)?.fields.end;
        let bytes = self.extents().bytes(node.address, length + most)?;
        let end = bytes.len();
        Ok(bytes.part(length.min(end)..end))
    }

    /// Returns whether a node has a zone.
    #[inline]
    pub(super) fn has_zone(&self, node: AutumnalNode) -> bool {
        node.has_record() && self.heights().has_zone(node.height)
    }

    /// Reads the zone of a node, if it has one.
    pub(super) fn zone(&self, node: AutumnalNode) -> Result<Option<Zone>> {
        if !self.has_zone(node) {
            return Ok(None);
        }
        let header = self.header();
        // A zone does not store its length. Zones without classes are short; for the others, each
        // read is longer than the last.
        let mut most = FIRST_ZONE_READ;
        loop {
            let bytes = self.bytes_after(node, most)?;
            match Zone::from_bytes(&bytes, header.form, node.height, header.counts_classes()) {
                Ok(zone) => return Ok(Some(zone)),
                Err(BadZone::Short) if bytes.len() >= most => most *= 4,
                Err(_) => return Err(self.bad_zone(node.address)),
            }
        }
    }

    /// Returns whether a node's zone equals these bytes.
    pub(super) fn zone_equals(&self, node: AutumnalNode, zone: &[u8]) -> Result<bool> {
        Ok(self.bytes_after(node, zone.len())?[..] == *zone)
    }

    /// Returns the number of INNER nodes of a subtree according to its zone. A subtree without a
    /// zone counts as one node: it is too small to matter.
    pub(super) fn claimed_below<'a, A: ByteAccess<'a>>(&self, access: A, node: AutumnalNode) -> Result<u64> {
        if !self.has_zone(node) {
            return Ok(1);
        }
        let end = self.record_in(access, node)?.fields.end;
        let bytes = access.bytes(node.address, end + CLAIM_READ)?;
        let claimed = bytes.get(end..).and_then(|mut zone| inner_nodes(&mut zone).ok());
        claimed.ok_or_else(|| self.bad_zone(node.address))
    }

    /// Returns the number of INNER nodes of the tree according to its root's zone. Nodes of shared
    /// subtrees count once per occurrence. (A traversal detects a wrong number.)
    ///
    /// # Errors
    /// If the file is corrupt.
    pub(crate) fn claimed_inner_nodes(&self) -> Result<u64> {
        match self.root {
            Child::Inner { node, .. } => self.claimed_below(self.extents(), node),
            Child::Void | Child::Leaf(_) => Ok(0),
        }
    }

    /// Checks that the zone of a node, whose record is given, is consistent with the zones of the
    /// nodes that it points to. Otherwise a small file could claim few nodes and have any number.
    #[inline(never)]
    pub(super) fn check_zone<'a, A: ByteAccess<'a>>(
        &self,
        access: A,
        node: AutumnalNode,
        record: &PointeredRecord<A::Bytes>,
    ) -> Result<()> {
        let claimed = self.claimed_below(access, node)?;
        let dimension = self.layout().form.dimension;
        let children = dimension.children() as u64;
        let Some(target_height) = self.heights().target_height(node.height) else { return Ok(()) };
        let targets = record.fields.pointers(&record.bytes, record.address);
        let mut sum = 0u64;
        for target in targets.ok_or_else(|| self.bad_pointer(record.address))?.targets {
            sum = sum.saturating_add(self.claimed_below(access, AutumnalNode::new(target, target_height))?);
        }
        // A full tree has 1 + c + c^2 + ... nodes for c children.
        let full = |levels| (dimension.cells(levels) - 1) / (children - 1);
        let most = if !self.heights().has_zone(target_height) {
            // Nodes below have no zones: the maximum is a full tree down to the level above the
            // cells.
            full(node.height)
        } else {
            sum.saturating_add(full(node.height - target_height))
        };
        let range = sum.saturating_add(1)..=most;
        if range.contains(&claimed) {
            return Ok(());
        }
        let expected = format!("{} to {}: the records below it and its own", range.start(), range.end());
        Err(self.bad_record(node.address, &format!("a zone of {claimed} records"), &expected))
    }

    /// Returns the number of INNER nodes of the tree. Nodes of shared subtrees count once per
    /// occurrence.
    ///
    /// # Errors
    /// If there are too many to traverse the tree as a whole, or the file is corrupt.
    pub(crate) fn traversable_inner_nodes(&self) -> Result<u64> {
        self.root()?;
        Ok(self.inner_nodes())
    }
}
