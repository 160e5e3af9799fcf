//! Reads one commit of an Autumnal file.

use std::borrow::Cow;
use std::fs::File;
use std::marker::PhantomData;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use zerocopy::FromBytes;

use super::archive::{Archive, newest};
use super::commit::{Commit, Root};
use super::extents::{ExtentKind, Extents, FIRST, Reach};
use super::form::{FAR, HEAD_MOST, LONGEST, NEAR};
use super::medium::FileId;
use super::zone::{BadZone, Zone, records, zone_height};
use crate::space::Code;
use crate::store::goblin::{Header, INNER, LEAF, Layout, Metadata, OpenOptions, VOID};
use crate::store::{Storage, split_commit};
use crate::tree::{Child, Source};
use crate::value::{Kind, Rule, Tally, Value};
use crate::{Error, Result};

/// An INNER node of an open file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    pub(super) address: u64,
    /// Levels below it.
    pub(super) height: u8,
}

/// A node that an Autumnal file has: what writes to that file need not write it again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kept {
    pub(in crate::store) file: FileId,
    pub(in crate::store) address: u64,
    /// Levels below it.
    pub height: u8,
}

/// One commit of an Autumnal file, open for reading; may be shared by any number of threads.
///
/// It stays as it is whatever a writer adds to the file; [`Autumnal::refresh`] moves on. Every extent is checked before
/// something of it is used: a damaged file gives an error, never a crash.
pub struct Autumnal<D: Layout, V: Value> {
    pub(super) archive: Archive,
    pub(super) commit: Commit,
    metadata: Metadata,
    root: Child<V, Node>,
    /// Where it was opened from, to see whether there is something newer; nothing for other than files.
    opened: Option<(PathBuf, OpenOptions)>,
    types: PhantomData<D>,
}

/// Records that a tree may have to be walked as a whole, those of shared subtrees counted as often as they occur: a small
/// file can say of any number of nodes that they are equal, and take for ever.
const MOST_RECORDS: u64 = 1 << 36;

/// A record as it stands in the file.
pub(super) struct Record<B> {
    pub(super) address: u64,
    pub(super) states: u32,
    /// From the record's first byte on, at least all of its fields.
    pub(super) bytes: B,
}

/// One that was asked for by itself.
type OneRecord<'a> = Record<Cow<'a, [u8]>>;

impl<D: Layout, V: Value> Autumnal<D, V> {
    /// Opens a commit of a file: `map.autumn@12` is the twelfth, `map.autumn` the newest.
    ///
    /// # Errors
    /// If it cannot be read, is no Autumnal file, is damaged, has no such commit, or holds other dimensions or values than
    /// asked for.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Self> {
        let (file_path, number) = split_commit(path);
        let file = File::open(&file_path).map_err(Error::io(&*file_path, "open"))?;
        let id = FileId::of(&file).map_err(Error::io(&*file_path, "open"))?;
        let archive = Archive::open(&file_path, || options.storage(&file_path), id, options.check)?;
        let commit = number.map_or_else(|| archive.newest(), |number| archive.commit(number))?;
        let mut tree = Self::new(archive, commit)?;
        tree.opened = number.is_none().then(|| (file_path.into_owned(), options.clone()));
        Ok(tree)
    }

    /// Opens the newest commit of a file that is in memory.
    ///
    /// # Errors
    /// As [`Autumnal::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self> {
        let storage = || Ok(Box::new(bytes.clone()) as Box<dyn Storage>);
        let archive = Archive::open(Path::new("(memory)"), storage, FileId::unique(), true)?;
        let commit = archive.newest()?;
        Self::new(archive, commit)
    }

    /// A commit of an open file.
    pub(super) fn new(archive: Archive, commit: Commit) -> Result<Self> {
        let extents = &archive.extents;
        let bytes = extents.whole(ExtentKind::Metadata, commit.metadata)?;
        let metadata = Metadata::from_bytes(&extents.path, &bytes)?;
        Self::with_metadata(archive, commit, metadata)
    }

    /// The same, where the metadata are known.
    pub(super) fn with_metadata(archive: Archive, commit: Commit, metadata: Metadata) -> Result<Self> {
        let header = &archive.header;
        if usize::from(header.axes) != D::AXES || header.value != V::TYPE {
            let found = format!("{} axes, values {}", header.axes, header.value);
            let expected = format!("{} axes, values {}", D::AXES, V::TYPE);
            return Err(archive.extents.corrupt("header", found, &expected));
        }
        let Root { state, value, address } = &commit.root;
        let value = || {
            let wire = V::Wire::read_from_bytes(value).ok().map(V::from_wire);
            wire.ok_or_else(|| archive.extents.corrupt("commit", "a root value of another size", "one value"))
        };
        let root = match *state {
            VOID => Child::Void,
            LEAF => Child::Leaf(value()?),
            INNER => {
                let node = Node { address: *address, height: header.shape.depth };
                Child::Inner { representative: value()?, node }
            }
            other => {
                return Err(archive.extents.corrupt("commit", format!("root state {other}"), "0, 1 or 2"));
            }
        };
        Ok(Autumnal { archive, commit, metadata, root, opened: None, types: PhantomData })
    }

    /// Moves on to the newest commit, if there is a newer one; tells whether. Trees opened at a certain commit stay there.
    ///
    /// # Errors
    /// If the file cannot be read; the tree stays as it was then.
    pub fn refresh(&mut self) -> Result<bool> {
        let Some((path, options)) = &self.opened else { return Ok(false) };
        let storage = options.storage(path)?;
        let current = newest(&*storage)?;
        if current.is_some_and(|meta| meta == self.archive.meta) {
            return Ok(false);
        }
        let new = Self::open(path, options)?;
        let is_newer = new.archive.meta != self.archive.meta || new.archive.file != self.archive.file;
        if is_newer {
            *self = new;
        }
        Ok(is_newer)
    }

    /// The file, for messages.
    pub fn path(&self) -> &Path {
        &self.archive.extents.path
    }

    /// What the header says; the shape is that of the Goblin file that would be published.
    pub fn header(&self) -> &Header {
        &self.archive.header
    }

    /// What is told about the data.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The commit.
    pub fn commit(&self) -> &Commit {
        &self.commit
    }

    /// Whether equal subtrees are stored once.
    pub fn is_shared(&self) -> bool {
        self.archive.share
    }

    /// Bytes of the whole file.
    pub fn file_size(&self) -> u64 {
        self.archive.extents.file_size()
    }

    /// Name and bytes of each part of the file, in order.
    pub fn sections(&self) -> Vec<(&'static str, u64)> {
        let end = self.archive.extents.end;
        vec![("header", FIRST), ("commits", end - FIRST), ("unused", self.file_size() - end)]
    }

    /// Whether classes are counted per zone.
    pub fn counts_classes(&self) -> bool {
        let header = self.header();
        header.kind == Kind::Categorical || header.rule == Rule::Majority
    }

    pub(super) fn extents(&self) -> &Extents {
        &self.archive.extents
    }

    #[cold]
    fn bad_record(&self, address: u64, found: &str, expected: &str) -> Error {
        self.extents().corrupt(format!("record at {address}"), found, expected)
    }

    /// A node's record.
    pub(super) fn record(&self, node: Node) -> Result<OneRecord<'_>> {
        self.record_in(self.extents(), node)
    }

    #[inline(always)] // the heart of every descent
    pub(super) fn record_in<'a, R: Reach<'a>>(&self, reach: R, node: Node) -> Result<Record<R::Bytes>> {
        let Node { address, .. } = node;
        let bytes = reach.bytes(address, LONGEST)?;
        let form = &self.archive.form;
        match form.states_of(&bytes) {
            Some(states) if form.length(states) <= bytes.len() => Ok(Record { address, states, bytes }),
            _ => Err(self.bad_record(address, "the end of the file", "a whole record")),
        }
    }

    /// The representative of a record.
    pub(super) fn representative(&self, address: u64) -> Result<V> {
        self.representative_in(self.extents(), address)
    }

    #[inline]
    pub(super) fn representative_in<'a, R: Reach<'a>>(&self, reach: R, address: u64) -> Result<V> {
        let bytes = reach.bytes(address, HEAD_MOST)?;
        let wire =
            bytes.get(self.archive.form.states..).and_then(|rest| V::Wire::read_from_prefix(rest).ok());
        let wire = wire.ok_or_else(|| self.bad_record(address, "the end of the file", "a whole record"))?;
        Ok(V::from_wire(wire.0))
    }

    /// What a record has for a child; the representative of an INNER one stands in its own record.
    #[inline]
    pub(super) fn child<B>(&self, record: &Record<B>, height: u8, step: usize) -> Result<Child<(), Node>>
    where
        B: Deref<Target = [u8]>,
    {
        let state = record.states >> (2 * step) & 3;
        match state {
            0 => Ok(Child::Void),
            1 => Ok(Child::Leaf(())),
            _ => {
                let at = self.archive.form.field(record.states, step);
                self.follow(record, at, state, height).map(|node| Child::Inner { representative: (), node })
            }
        }
    }

    /// The node that a pointer leads to.
    #[inline]
    pub(super) fn follow<B>(&self, record: &Record<B>, at: usize, state: u32, height: u8) -> Result<Node>
    where
        B: Deref<Target = [u8]>,
    {
        debug_assert!(state == NEAR || state == FAR);
        let target = self.archive.form.pointer(&record.bytes, at, state, record.address);
        match target {
            Some(address) if height > 1 => Ok(Node { address, height: height - 1 }),
            None => Err(self.bad_record(
                record.address,
                "a pointer that does not lead back",
                "one to an earlier record",
            )),
            _ => Err(self.bad_record(record.address, "INNER", "no deeper node than a cell")),
        }
    }

    /// The value of a child that is a LEAF.
    #[inline]
    pub(super) fn leaf<B: Deref<Target = [u8]>>(&self, record: &Record<B>, step: usize) -> V {
        Self::value_in(&record.bytes, self.archive.form.field(record.states, step))
    }

    /// The value in a field of a record, all of which is there.
    #[inline]
    pub(super) fn value_in(bytes: &[u8], at: usize) -> V {
        let wire = bytes.get(at..).and_then(|rest| V::Wire::read_from_prefix(rest).ok());
        wire.map_or_else(V::default, |(wire, _)| V::from_wire(wire))
    }

    /// The whole tree seen from far away.
    pub fn root_place(&self) -> Child<V, Node> {
        self.root
    }

    /// The value of a node (a cell, or a block at coarse detail): its own, or that of the LEAF it lies in; `None` is VOID.
    /// One record for each level.
    ///
    /// # Errors
    /// If the file is damaged there.
    pub fn value_at(&self, code: Code<D>) -> Result<Option<V>> {
        match self.extents().seen() {
            Some(seen) => self.value_in_reach(seen, code),
            None => self.value_in_reach(self.extents(), code),
        }
    }

    #[inline]
    fn value_in_reach<'a, R: Reach<'a>>(&self, reach: R, code: Code<D>) -> Result<Option<V>> {
        let mut node = match self.root {
            Child::Inner { node, .. } if code.level() > 0 => node,
            place => return Ok(place.value()),
        };
        for level in 0..code.level() {
            let record = self.record_in(reach, node)?;
            let step = code.step(level);
            match self.child(&record, node.height, step)? {
                Child::Void => return Ok(None),
                Child::Leaf(()) => return Ok(Some(self.leaf(&record, step))),
                Child::Inner { node: below, .. } => node = below,
            }
        }
        self.representative_in(reach, node.address).map(Some)
    }

    /// The record of an INNER node, if it is one.
    pub(super) fn inner_at(&self, code: Code<D>) -> Result<Option<Node>> {
        let Child::Inner { mut node, .. } = self.root else { return Ok(None) };
        for level in 0..code.level() {
            let record = self.record(node)?;
            match self.child(&record, node.height, code.step(level))? {
                Child::Inner { node: below, .. } => node = below,
                _ => return Ok(None),
            }
        }
        Ok(Some(node))
    }

    /// Bytes behind a record's fields, where a zone starts, up to `most`.
    fn behind(&self, node: Node, most: usize) -> Result<Cow<'_, [u8]>> {
        let record = self.record(node)?;
        let length = self.archive.form.length(record.states);
        self.archive.extents.bytes(node.address, length + most).map(|bytes| match bytes {
            Cow::Borrowed(bytes) => Cow::Borrowed(&bytes[length.min(bytes.len())..]),
            Cow::Owned(mut bytes) => Cow::Owned(bytes.split_off(length.min(bytes.len()))),
        })
    }

    /// What is known of all that is below a node, if it has a zone.
    pub(super) fn zone(&self, node: Node) -> Result<Option<Zone<V>>> {
        if node.height < zone_height::<D>() {
            return Ok(None);
        }
        let mut most = 256;
        loop {
            let bytes = self.behind(node, most)?;
            match Zone::from_bytes(&bytes, D::AXES, node.height, self.counts_classes()) {
                Ok(zone) => return Ok(Some(zone)),
                Err(BadZone::Short) if bytes.len() >= most => most *= 4,
                Err(_) => {
                    return Err(self.bad_record(node.address, "an impossible zone", "one of its cells"));
                }
            }
        }
    }

    /// The zone's bytes are those.
    pub(super) fn has_zone(&self, node: Node, zone: &[u8]) -> Result<bool> {
        Ok(self.behind(node, zone.len())?[..] == *zone)
    }

    /// INNER nodes of a subtree, as its zone says; what has none is too small to matter.
    fn records_below<'a, R: Reach<'a>>(&self, reach: R, node: Node) -> Result<u64> {
        if node.height < zone_height::<D>() {
            return Ok(1);
        }
        let bytes = reach.bytes(node.address, LONGEST + 16)?;
        let form = &self.archive.form;
        let zone = form.states_of(&bytes).and_then(|states| bytes.get(form.length(states)..));
        let claimed = zone.and_then(|mut zone| records(&mut zone).ok());
        claimed.ok_or_else(|| self.bad_record(node.address, "an impossible zone", "one of its cells"))
    }

    /// Zones must add up: else a small file could claim few records and have any number.
    fn check_zone<'a, R: Reach<'a>>(&self, reach: R, node: Node, record: &Record<R::Bytes>) -> Result<()> {
        let claimed = self.records_below(reach, node)?;
        let expected = if node.height == zone_height::<D>() {
            let most = ((1u64 << (D::AXES * usize::from(node.height))) - 1) / (D::CHILDREN as u64 - 1);
            1..=most
        } else {
            let mut sum = 1u64;
            for step in 0..D::CHILDREN {
                if let Child::Inner { node, .. } = self.child(record, node.height, step)? {
                    sum = sum.saturating_add(self.records_below(reach, node)?);
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

    /// As [`Source::each_child`].
    #[inline]
    fn each_child_in<'a, R: Reach<'a>>(
        &self,
        reach: R,
        node: Node,
        mut each: impl FnMut(usize, Child<V, Node>) -> Result<()>,
    ) -> Result<()> {
        let record = self.record_in(reach, node)?;
        if node.height >= zone_height::<D>() {
            self.check_zone(reach, node, &record)?;
        }
        let form = &self.archive.form;
        let mut at = form.head();
        for step in 0..D::CHILDREN {
            let state = record.states >> (2 * step) & 3;
            let child = match state {
                0 => Child::Void,
                1 => {
                    let value = Self::value_in(&record.bytes, at);
                    at += size_of::<V::Wire>();
                    Child::Leaf(value)
                }
                _ => {
                    let node = self.follow(&record, at, state, node.height)?;
                    at += form.pointer_size(state);
                    Child::Inner { representative: self.representative_in(reach, node.address)?, node }
                }
            };
            each(step, child)?;
        }
        Ok(())
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

impl<D: Layout, V: Value> Source for Autumnal<D, V> {
    type Dim = D;
    type Value = V;
    type Node = Node;

    fn depth(&self) -> u8 {
        self.header().shape.depth
    }

    /// # Errors
    /// If the tree has too many records to be walked as a whole, which can only be when they are shared.
    fn root(&self) -> Result<Child<V, Node>> {
        if let Child::Inner { node, .. } = self.root {
            let records = self.records_below(self.extents(), node)?;
            if records > MOST_RECORDS {
                let found = format!("walking {records} nodes, most of which are stored once for many");
                return Err(Error::unsupported(
                    self.path(),
                    found,
                    "look at a window, or at a coarser level",
                ));
            }
        }
        Ok(self.root)
    }

    fn each_child(&self, node: &Node, each: impl FnMut(usize, Child<V, Node>) -> Result<()>) -> Result<()> {
        match self.extents().seen() {
            Some(seen) => self.each_child_in(seen, *node, each),
            None => self.each_child_in(self.extents(), *node, each),
        }
    }

    fn kept(&self, node: &Node) -> Option<Kept> {
        Some(Kept { file: self.archive.file, address: node.address, height: node.height })
    }

    fn tally(&self, node: &Node) -> Result<Option<Tally<V>>> {
        Ok(self.zone(*node)?.map(|zone| zone.tally))
    }
}
