//! Reads one commit of an Autumnal file.

use std::borrow::Cow;
use std::cell::Cell;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use super::archive::{Archive, OpenFile};
use super::commit::{Commit, Root};
use super::extents::{ByteAccess, ExtentKind, Extents, FIRST_EXTENT};
use super::layout::{ABSOLUTE, MAX_HEAD, MAX_RECORD, PointeredLayout, RELATIVE};
use super::newest::{slots, whole};
use super::zone::{BadZone, Zone, records, zone_height};
use crate::io::FileId;
use crate::space::Code;
use crate::store::builder::{RecordRef, ReusableSource};
use crate::store::container::record::state_of;
use crate::store::container::{Header, INNER, LEAF, Metadata, OpenOptions, VOID, split_commit};
use crate::tree::{Child, Children, Form, Source};
use crate::value::{Tally, Value};
use crate::{Error, Result};

/// An INNER node of an open file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Node {
    /// Offset of its record in the file.
    pub(super) address: u64,
    /// Levels below it.
    pub(super) height: u8,
}

/// One commit of an Autumnal file, open for reading; may be shared by any number of threads.
///
/// It stays as it is whatever a writer adds to the file; [`Autumnal::refresh`] moves on. Every extent is
/// checked before something of it is used: a damaged file gives an error, never a crash.
pub struct Autumnal {
    pub(super) archive: Archive,
    pub(super) commit: Commit,
    metadata: Metadata,
    root: Child<Node>,
    /// Path and options it was opened with, to see whether there is something newer; nothing for other than
    /// files.
    opened: Option<(PathBuf, OpenOptions)>,
}

/// Records that a tree may have to be walked as a whole, those of shared subtrees counted as often as they
/// occur: a small file can say of any number of nodes that they are equal, and take for ever.
const MAX_RECORDS: u64 = 1 << 36;

/// Bytes of the number of records at a zone's start at most (and a few more).
const ZONE_RECORDS: usize = 16;

/// Bytes that are read first of a zone, whose length is not known.
const FIRST_ZONE_READ: usize = 256;

/// A record as it stands in the file.
pub(super) struct PointeredRecord<B> {
    pub(super) address: u64,
    /// Two bits per child.
    pub(super) states: u32,
    /// From the record's first byte on, at least all of its fields.
    pub(super) bytes: B,
}

impl<B> PointeredRecord<B> {
    /// State of one child: VOID, LEAF, RELATIVE or ABSOLUTE.
    #[inline]
    pub(super) fn state(&self, step: usize) -> u8 {
        state_of(self.states, step)
    }
}

/// One that was asked for by itself.
type OneRecord<'a> = PointeredRecord<Cow<'a, [u8]>>;

impl Autumnal {
    /// Opens a commit of a file: `map.autumn@12` is the twelfth, `map.autumn` the newest.
    ///
    /// # Errors
    /// If it cannot be read, is no Autumnal file, is damaged, or has no such commit.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Autumnal> {
        let (file_path, _) = split_commit(path);
        Autumnal::of_opened(path, options.open_with_id(&file_path)?, options)
    }

    /// Opens a commit of a file whose bytes are open already.
    ///
    /// # Errors
    /// Those of [`Autumnal::open`].
    pub(crate) fn of_opened(path: &Path, opened: OpenFile, options: &OpenOptions) -> Result<Autumnal> {
        let (file_path, number) = split_commit(path);
        // If a writer was too fast, the file is opened again by its name.
        let first = Cell::new(Some(opened));
        let open = || first.take().map_or_else(|| options.open_with_id(&file_path), Ok);
        let archive = Archive::open(&file_path, &open, options.check)?;
        let commit = number.map_or_else(|| archive.newest(), |number| archive.commit(number))?;
        let mut tree = Autumnal::new(archive, commit)?;
        tree.opened = number.is_none().then(|| (file_path.into_owned(), options.clone()));
        Ok(tree)
    }

    /// Opens the newest commit of a file that is in memory.
    ///
    /// # Errors
    /// As [`Autumnal::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Autumnal> {
        let archive = Archive::of_bytes(Path::new("(memory)"), bytes)?;
        let commit = archive.newest()?;
        Autumnal::new(archive, commit)
    }

    /// A commit of an open file.
    pub(super) fn new(archive: Archive, commit: Commit) -> Result<Autumnal> {
        let extents = &archive.extents;
        let bytes = extents.whole(ExtentKind::Metadata, commit.metadata)?;
        let metadata = Metadata::from_bytes(&extents.path, &bytes)?;
        Autumnal::with_metadata(archive, commit, metadata)
    }

    /// A commit of an open file whose metadata are known.
    pub(super) fn with_metadata(archive: Archive, commit: Commit, metadata: Metadata) -> Result<Autumnal> {
        let corrupt = |found: String, expected| archive.extents.corrupt("commit", found, expected);
        let Root { state, value, address } = &commit.root;
        let header = &archive.header;
        let value = || match value.len() == header.form.width() {
            true => Ok(Value::from_bytes(value)),
            false => Err(corrupt("a root value of another size".into(), "one value")),
        };
        let root = match *state {
            VOID => Child::Void,
            LEAF => Child::Leaf(value()?),
            // (Children of a cell would lie outside of everything.)
            INNER if header.depth() == 0 => {
                return Err(corrupt("an INNER root of a tree that is one cell".into(), "VOID or LEAF"));
            }
            INNER => {
                let node = Node { address: *address, height: header.depth() };
                Child::Inner { representative: value()?, node }
            }
            other => return Err(corrupt(format!("root state {other}"), "0, 1 or 2")),
        };
        Ok(Autumnal { archive, commit, metadata, root, opened: None })
    }

    /// Moves on to the newest commit, if there is a newer one; tells whether. Trees opened at a certain
    /// commit stay there.
    ///
    /// # Errors
    /// If the file cannot be read; the tree stays as it was then.
    pub fn refresh(&mut self) -> Result<bool> {
        let Some((path, options)) = &self.opened else { return Ok(false) };
        // (Where the system does not tell files apart, there is only the commit to go by.)
        let Archive { meta, file, .. } = self.archive;
        let is_same = |other_meta, other: FileId| other_meta == meta && (other == file || other.is_unique());
        let (bytes, current) = options.open_with_id(path)?;
        if whole(&slots(&*bytes)?).first().is_some_and(|newest| is_same(*newest, current)) {
            return Ok(false);
        }
        let new = Autumnal::open(path, options)?;
        let is_newer = !is_same(new.archive.meta, new.archive.file);
        if is_newer {
            *self = new;
        }
        Ok(is_newer)
    }

    /// The file, for messages.
    pub fn path(&self) -> &Path {
        &self.archive.extents.path
    }

    /// The file's header; the shape is that of the Goblin file that would be published.
    pub fn header(&self) -> &Header {
        &self.archive.header
    }

    /// Georeference, meaning and provenance of the data.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The commit.
    pub fn commit(&self) -> &Commit {
        &self.commit
    }

    /// A remark on the file that whoever reads it should know: that its newest commit was not found where it
    /// should be.
    pub fn remark(&self) -> Option<&'static str> {
        self.archive.remark()
    }

    /// Whether equal subtrees are stored once.
    pub fn is_shared(&self) -> bool {
        self.archive.share
    }

    /// Makes sure that the file still has the commit, and those before it: that it reaches to the commit's end,
    /// and its newest commit is no older.
    ///
    /// # Errors
    /// If that is not so: somebody has overwritten the file, or cut it short.
    pub fn check_unchanged(&self) -> Result<()> {
        self.archive.check_unchanged()
    }

    /// Bytes of the whole file.
    pub fn file_size(&self) -> u64 {
        self.archive.extents.file_size()
    }

    /// Name and bytes of each part of the file, in order.
    pub fn sections(&self) -> Vec<(&'static str, u64)> {
        let end = self.archive.extents.end;
        vec![("header", FIRST_EXTENT), ("commits", end - FIRST_EXTENT), ("unused", self.file_size() - end)]
    }

    #[inline]
    pub(super) fn extents(&self) -> &Extents {
        &self.archive.extents
    }

    #[inline]
    pub(super) fn layout(&self) -> &PointeredLayout {
        &self.archive.layout
    }

    /// Levels below the smallest nodes with zones.
    #[inline]
    fn zone_height(&self) -> u8 {
        zone_height(self.layout().form.dimension)
    }

    #[cold]
    fn bad_record(&self, address: u64, found: &str, expected: &str) -> Error {
        self.extents().corrupt(format!("record at {address}"), found, expected)
    }

    #[cold]
    fn cut_short(&self, address: u64) -> Error {
        self.bad_record(address, "the end of the file", "a whole record")
    }

    #[cold]
    fn bad_zone(&self, node: Node) -> Error {
        self.bad_record(node.address, "an impossible zone", "one of its cells")
    }

    /// A node's record.
    pub(super) fn record(&self, node: Node) -> Result<OneRecord<'_>> {
        self.record_in(self.extents(), node)
    }

    #[inline(always)] // the heart of every descent
    pub(super) fn record_in<'a, A: ByteAccess<'a>>(
        &self,
        access: A,
        node: Node,
    ) -> Result<PointeredRecord<A::Bytes>> {
        let Node { address, .. } = node;
        let bytes = access.bytes(address, MAX_RECORD)?;
        let layout = self.layout();
        match layout.states(&bytes) {
            Some(states) if layout.record_size(states) <= bytes.len() => {
                Ok(PointeredRecord { address, states, bytes })
            }
            _ => Err(self.cut_short(address)),
        }
    }

    /// The representative of the node whose record is at an address.
    pub(super) fn representative(&self, address: u64) -> Result<Value> {
        self.representative_in(self.extents(), address)
    }

    #[inline]
    pub(super) fn representative_in<'a, A: ByteAccess<'a>>(&self, access: A, address: u64) -> Result<Value> {
        let bytes = access.bytes(address, MAX_HEAD)?;
        self.layout().representative(&bytes).ok_or_else(|| self.cut_short(address))
    }

    /// The value in a record's field that starts at an offset.
    #[inline]
    pub(super) fn value_in(&self, record: &[u8], at: usize) -> Value {
        // All of the record is there.
        self.layout().value(record, at).unwrap_or_default()
    }

    /// The value of a child that is a LEAF.
    #[inline]
    pub(super) fn leaf<B: Deref<Target = [u8]>>(&self, record: &PointeredRecord<B>, step: usize) -> Value {
        self.value_in(&record.bytes, self.layout().field(record.states, step))
    }

    /// A child that is INNER, of a node with so many levels below it.
    #[inline]
    pub(super) fn inner<B>(&self, record: &PointeredRecord<B>, height: u8, step: usize) -> Result<Node>
    where
        B: Deref<Target = [u8]>,
    {
        let at = self.layout().field(record.states, step);
        self.follow(record, at, record.state(step), height)
    }

    /// The node that the pointer in a field leads to, of a node with so many levels below it.
    #[inline]
    pub(super) fn follow<B>(
        &self,
        record: &PointeredRecord<B>,
        at: usize,
        state: u8,
        height: u8,
    ) -> Result<Node>
    where
        B: Deref<Target = [u8]>,
    {
        debug_assert!(state == RELATIVE || state == ABSOLUTE);
        match self.layout().follow(&record.bytes, at, state, record.address) {
            // Whatever the pointers are, a descent ends where there are no levels left.
            Some(address) if height > 1 => Ok(Node { address, height: height - 1 }),
            target => Err(self.bad_pointer(record.address, target.is_some())),
        }
    }

    #[cold]
    fn bad_pointer(&self, address: u64, leads_back: bool) -> Error {
        if leads_back {
            self.bad_record(address, "INNER", "no deeper node than a cell")
        } else {
            self.bad_record(address, "a pointer that does not lead back", "one to an earlier record")
        }
    }

    /// The root: its state, its value or representative, and its record.
    pub fn root_child(&self) -> Child<Node> {
        self.root
    }

    /// The value of a node (a cell, or a block at coarse detail): its own, or that of the LEAF it lies in;
    /// `None` is VOID. One record for each level.
    ///
    /// # Errors
    /// If the file is damaged there.
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
        for level in 0..code.level() {
            let record = self.record_in(access, node)?;
            let step = code.step(level);
            match record.state(step) {
                VOID => return Ok(None),
                LEAF => return Ok(Some(self.leaf(&record, step))),
                _ => node = self.inner(&record, node.height, step)?,
            }
        }
        self.representative_in(access, node.address).map(Some)
    }

    /// The INNER node with a code, if it is one.
    pub(super) fn inner_at(&self, code: Code) -> Result<Option<Node>> {
        let Child::Inner { mut node, .. } = self.root else { return Ok(None) };
        for level in 0..code.level() {
            let record = self.record(node)?;
            let step = code.step(level);
            match record.state(step) {
                VOID | LEAF => return Ok(None),
                _ => node = self.inner(&record, node.height, step)?,
            }
        }
        Ok(Some(node))
    }

    /// Bytes behind a record's fields, where a zone starts, up to `most`.
    fn behind(&self, node: Node, most: usize) -> Result<Cow<'_, [u8]>> {
        let record = self.record(node)?;
        let length = self.layout().record_size(record.states);
        self.extents().bytes(node.address, length + most).map(|bytes| match bytes {
            Cow::Borrowed(bytes) => Cow::Borrowed(&bytes[length.min(bytes.len())..]),
            Cow::Owned(mut bytes) => Cow::Owned(bytes.split_off(length.min(bytes.len()))),
        })
    }

    /// The zone of a node, if it has one.
    pub(super) fn zone(&self, node: Node) -> Result<Option<Zone>> {
        if node.height < self.zone_height() {
            return Ok(None);
        }
        let header = self.header();
        // A zone does not tell its length. Those without classes are short; of the others ever more is read.
        let mut most = FIRST_ZONE_READ;
        loop {
            let bytes = self.behind(node, most)?;
            match Zone::from_bytes(&bytes, header.form, node.height, header.counts_classes()) {
                Ok(zone) => return Ok(Some(zone)),
                Err(BadZone::Short) if bytes.len() >= most => most *= 4,
                Err(_) => return Err(self.bad_zone(node)),
            }
        }
    }

    /// Whether a node's zone has these bytes.
    pub(super) fn has_zone(&self, node: Node, zone: &[u8]) -> Result<bool> {
        Ok(self.behind(node, zone.len())?[..] == *zone)
    }

    /// INNER nodes of a subtree, as its zone says; what has none is too small to matter.
    fn records_below<'a, A: ByteAccess<'a>>(&self, access: A, node: Node) -> Result<u64> {
        if node.height < self.zone_height() {
            return Ok(1);
        }
        let bytes = access.bytes(node.address, MAX_RECORD + ZONE_RECORDS)?;
        let layout = self.layout();
        let zone = layout.states(&bytes).and_then(|states| bytes.get(layout.record_size(states)..));
        let claimed = zone.and_then(|mut zone| records(&mut zone).ok());
        claimed.ok_or_else(|| self.bad_zone(node))
    }

    /// INNER nodes of the tree, those of shared subtrees as often as they occur, as its root's zone says. (Whoever walks
    /// it finds out if that is not true.)
    ///
    /// # Errors
    /// If the file is damaged.
    pub(crate) fn claimed_records(&self) -> Result<u64> {
        match self.root {
            Child::Inner { node, .. } => self.records_below(self.extents(), node),
            Child::Void | Child::Leaf(_) => Ok(0),
        }
    }

    /// Checks that the zone of a node, which has this record, adds up with those of its children: else a
    /// small file could claim few records and have any number.
    #[inline(never)]
    fn check_zone<'a, A: ByteAccess<'a>>(
        &self,
        access: A,
        node: Node,
        record: &PointeredRecord<A::Bytes>,
    ) -> Result<()> {
        let claimed = self.records_below(access, node)?;
        let dimension = self.layout().form.dimension;
        let expected = if node.height == self.zone_height() {
            // Nothing below has a zone: as many as there can be, which is 1 + c + c^2 ... for c children down
            // to the level above the cells.
            1..=(dimension.cells(node.height) - 1) / (dimension.children() as u64 - 1)
        } else {
            let mut sum = 1u64;
            for step in 0..dimension.children() {
                if !matches!(record.state(step), VOID | LEAF) {
                    let child = self.inner(record, node.height, step)?;
                    sum = sum.saturating_add(self.records_below(access, child)?);
                }
            }
            sum..=sum
        };
        if expected.contains(&claimed) {
            return Ok(());
        }
        let expected = format!("{}, those of its children and its own", expected.end());
        Err(self.bad_record(node.address, &format!("a zone of {claimed} records"), &expected))
    }

    /// Writes the children of an inner node as nodes of something that stands on this file: what
    /// [`Source::children`] does, without a second array for those who have nodes of their own.
    pub(crate) fn children_with<N>(
        &self,
        node: &Node,
        children: &mut Children<N>,
        node_of: impl Fn(Node) -> N,
    ) -> Result<()> {
        match self.extents().mapped() {
            Some(mapped) => self.children_in(mapped, *node, children, node_of),
            None => self.children_in(self.extents(), *node, children, node_of),
        }
    }

    /// Writes the children of a node to the room's beginning: what walks spend their time on.
    #[inline(never)]
    fn children_in<'a, A: ByteAccess<'a>, N>(
        &self,
        access: A,
        node: Node,
        children: &mut Children<N>,
        node_of: impl Fn(Node) -> N,
    ) -> Result<()> {
        let record = self.record_in(access, node)?;
        let layout = self.layout();
        // The fields stand one behind the other: no need to ask the layout where each of them starts.
        let mut at = layout.head_size();
        for (step, child) in children[..layout.children()].iter_mut().enumerate() {
            *child = match record.state(step) {
                VOID => Child::Void,
                LEAF => {
                    let value = self.value_in(&record.bytes, at);
                    at += layout.width();
                    Child::Leaf(value)
                }
                state => {
                    let node = self.follow(&record, at, state, node.height)?;
                    at += layout.pointer_size(state);
                    let representative = self.representative_in(access, node.address)?;
                    Child::Inner { representative, node: node_of(node) }
                }
            };
        }
        if node.height >= self.zone_height() { self.check_zone(access, node, &record) } else { Ok(()) }
    }

    /// INNER nodes of the tree, those of shared subtrees as often as they occur.
    ///
    /// # Errors
    /// If there are so many that the tree cannot be walked as a whole, or the file is damaged.
    pub fn walkable_records(&self) -> Result<u64> {
        self.root()?;
        Ok(self.commit.records)
    }
}

impl Source for Autumnal {
    type Node = Node;

    #[inline]
    fn form(&self) -> Form {
        self.layout().form
    }

    fn depth(&self) -> u8 {
        self.header().depth()
    }

    /// # Errors
    /// If the tree has too many records to be walked as a whole, which can only be when they are shared.
    fn root(&self) -> Result<Child<Node>> {
        if let Child::Inner { node, .. } = self.root {
            let records = self.records_below(self.extents(), node)?;
            if records > MAX_RECORDS {
                let found = format!("walking {records} nodes, most of which are stored once for many");
                let advice = "look at a window, or at a coarser level";
                return Err(Error::unsupported(self.path(), found, advice));
            }
        }
        Ok(self.root)
    }

    fn children(&self, node: &Node, children: &mut Children<Node>) -> Result<()> {
        self.children_with(node, children, |node| node)
    }

    fn check_unchanged(&self) -> Result<()> {
        Autumnal::check_unchanged(self)
    }

    fn tally(&self, node: &Node) -> Result<Option<Tally>> {
        Ok(self.zone(*node)?.map(|zone| zone.tally))
    }
}

impl ReusableSource for Autumnal {
    fn kept(&self, node: &Node) -> Option<RecordRef> {
        Some(RecordRef { file: self.archive.file, address: node.address, height: node.height })
    }
}
