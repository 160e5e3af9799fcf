//! Makes records of the parts of a tree, and keeps those that the file has already.

use std::mem;
use std::ops::Range;

use super::append::{Appender, NewRecord};
use super::commit::Root;
use super::copied::Copied;
use super::layout::{Heights, zone_height};
use super::reader::{Autumnal, Node};
use super::verified::Verified;
use super::zone::Zone;
use crate::Result;
use crate::space::{Code, Dimension};
use crate::store::builder::{BuildOptions, BuiltBlock, Part, RecordRef, Siblings, TreeSink, upper_levels};
use crate::store::container::subtree::RECORDS_ARE_CHECKED;
use crate::store::container::{Finding, INNER, LevelCounts, RecordLayout, RunChildren, RunNode, Shape};
use crate::tree::{Child, Form};
use crate::value::{Rule, Value};

/// The shape that makes blocks as large as the smallest nodes with zones, whose children are runs, and leaves all their
/// records together.
pub(super) fn shape(dimension: Dimension, depth: u8) -> Shape {
    Shape { depth, reach: zone_height(dimension), stride: 1, heavy_threshold: u32::MAX }
}

/// The fate of the records that are made.
pub(super) enum Mode<'a> {
    /// They are written, unless the file has them.
    Write(&'a mut Appender),
    /// All of them should be in the file, and those that are not are findings.
    Check(Check<'a>),
}

/// A check of the records of a file.
pub(super) struct Check<'a> {
    pub(super) findings: &'a mut Vec<Finding>,
    pub(super) verified: &'a Verified,
    /// Bytes of the extent that the record before was in.
    extent: Range<u64>,
}

impl<'a> Check<'a> {
    pub(super) fn new(findings: &'a mut Vec<Finding>, verified: &'a Verified) -> Check<'a> {
        Check { findings, verified, extent: 0..0 }
    }

    /// Fails if a record with so many bytes of zone is not all in an extent.
    fn check_place(&mut self, tree: &Autumnal, node: Node, zone: usize) -> Result<()> {
        if !self.extent.contains(&node.address) {
            self.extent = tree.extents().records_at(node.address)?;
        }
        let size = tree.record(node)?.parts.end + zone;
        if self.extent.end - node.address < size as u64 {
            let found = format!("{size} bytes");
            let expected = format!("an end at byte {} or before, where its extent ends", self.extent.end);
            return Err(tree.extents().corrupt(format!("record at {}", node.address), found, &expected));
        }
        Ok(())
    }
}

/// A node, what records above it need of what is below, and the records in the file that its own, or that above, points to.
#[derive(Clone)]
pub(super) struct BuiltNode {
    pub(super) part: Part,
    /// A bit for each of the nodes with records that come next below, in Z order, or for the node itself: those that have one.
    bitmap: u64,
    /// The addresses of these.
    targets: Vec<u64>,
}

impl BuiltNode {
    /// A node without pointers.
    fn new(part: Part) -> BuiltNode {
        BuiltNode { part, bitmap: 0, targets: Vec::new() }
    }
}

/// Merges parts whose siblings are complete, and writes the records that are new.
pub(super) struct RecordBuilder<'a> {
    form: Form,
    heights: Heights,
    rule: Rule,
    depth: u8,
    with_classes: bool,
    mode: Mode<'a>,
    /// The tree that the file has.
    base: Option<&'a Autumnal>,
    /// A commit of another file with the same tree as the base: what is known to be in one is in the other,
    /// too.
    twin: Option<&'a Autumnal>,
    /// Whether equal subtrees are stored once.
    shares: bool,
    /// Nodes that were made of others already: of those of other files where equal subtrees are stored once, and of the
    /// file's own that had to be made anew.
    copied: Option<Copied>,
    siblings: Siblings<BuiltNode>,
    root: Option<BuiltNode>,
}

impl<'a> RecordBuilder<'a> {
    /// `covered` is the extent of the parts that will come; what is outside is VOID.
    pub(super) fn new(
        form: Form,
        options: &BuildOptions,
        covered: [u64; 3],
        mode: Mode<'a>,
        base: Option<&'a Autumnal>,
        twin: Option<&'a Autumnal>,
    ) -> RecordBuilder<'a> {
        let shares = matches!(&mode, Mode::Write(appender) if appender.shares());
        // Majorities are made of the counts of all classes, which large nodes that are kept may not list.
        let must_count = options.rule == Rule::Majority && base.is_some();
        RecordBuilder {
            form,
            heights: Heights::new(form.dimension, options.depth),
            rule: options.rule,
            depth: options.depth,
            with_classes: options.count_classes(),
            mode,
            base,
            twin,
            shares,
            copied: (shares || must_count).then(|| Copied::new(options.memory / 8)),
            siblings: Siblings::new(form.dimension, options.depth, covered),
            root: None,
        }
    }

    /// The root and its zone, once everything has come.
    pub(super) fn finish(self) -> (Root, Zone) {
        let BuiltNode { part, targets, .. } = self.root.expect("all blocks were pushed");
        let value = part.child.value().map(|value| value.to_bytes()[..self.form.width()].to_vec());
        let address = if part.child.is_inner() { targets[0] } else { 0 };
        let root = Root { state: part.child.state() as u8, value: value.unwrap_or_default(), address };
        (root, Zone { records: part.total, tally: part.tally })
    }

    /// Takes a node, and as many of its ancestors as are complete with it.
    fn join(&mut self, mut node: BuiltNode) -> Result<()> {
        let (depth, value_type) = (self.depth, self.form.value);
        loop {
            let code = node.part.code;
            if let Some(copied) = &mut self.copied {
                copied.made(code, &node);
            }
            let Some(parent) = code.parent() else {
                self.root = Some(node);
                return Ok(());
            };
            let void = |code| BuiltNode::new(Part::uniform(code, depth, value_type, None, false));
            let step = code.step(parent.level());
            let Some(children) = self.siblings.join(parent, step, node, void) else { return Ok(()) };
            node = self.merge(parent, children)?;
        }
    }

    /// The parent of these nodes, which are all its children in order.
    fn merge(&mut self, code: Code, nodes: Vec<BuiltNode>) -> Result<BuiltNode> {
        let height = self.depth - code.level();
        // Nodes with records below each child, which may itself be one.
        let below = self.heights.below(height).map_or(0, |below| height - 1 - below);
        let bits = self.form.dimension.cells(below);
        let (mut bitmap, mut targets) = (0, Vec::new());
        let mut parts = Vec::with_capacity(nodes.len());
        for (step, node) in (0..).zip(nodes) {
            bitmap |= node.bitmap << (bits * step);
            targets.extend(node.targets);
            parts.push(node.part);
        }
        let part = Part::merge(code, &parts, self.depth, self.rule, &mut LevelCounts::default());
        let mut node = BuiltNode { part, bitmap, targets };
        self.seal(&mut node)?;
        Ok(node)
    }

    /// Writes the record of a node, if it is to have one; what is left is what those above need.
    fn seal(&mut self, node: &mut BuiltNode) -> Result<()> {
        let code = node.part.code;
        let height = self.depth - code.level();
        let Child::Inner { representative, .. } = node.part.child else { return Ok(()) };
        if self.heights.record_of(height) != height {
            return Ok(());
        }
        let run = upper_levels(self.form, &node.part.records, self.heights.run_of(height));
        let run = run.expect(RECORDS_ARE_CHECKED);
        let pointers = self.heights.below(height).map(|_| (node.bitmap, &node.targets[..]));
        let zone = match pointers {
            Some(_) => {
                Zone { records: node.part.total, tally: node.part.tally.clone() }.to_bytes(self.with_classes)
            }
            None => Vec::new(),
        };
        let old = self.old_node(code)?;
        let address =
            self.write(code, NewRecord { representative, pointers, run: &run, zone: &zone }, old)?;
        node.part.records = self.above_of(code, &run).expect(RECORDS_ARE_CHECKED);
        (node.bitmap, node.targets) = (1, vec![address]);
        Ok(())
    }

    /// The upper levels of the run of a node with a record that the run of the next one above has; `None` if the run contradicts
    /// itself.
    fn above_of(&self, code: Code, run: &[u8]) -> Option<Vec<u8>> {
        let height = self.depth - code.level();
        if height == self.depth {
            return Some(Vec::new());
        }
        let levels = self.heights.run - (self.heights.record_of(height + 1) - height);
        upper_levels(self.form, run, levels).ok()
    }

    /// The node that the file has there, if it is INNER.
    fn old_node(&self, code: Code) -> Result<Option<Node>> {
        self.base.map_or(Ok(None), |base| base.inner_at(code))
    }

    /// Writes a record, unless it is the one that was there before.
    fn write(&mut self, code: Code, record: NewRecord<'_>, old: Option<Node>) -> Result<u64> {
        // Copy on write: what is below comes first, so equal addresses mean equal subtrees, and an unchanged record keeps all
        // that is below it.
        if let (Some(base), Some(old)) = (self.base, old)
            && is_same(base, old, record)?
        {
            if let Mode::Check(check) = &mut self.mode {
                check.check_place(base, old, record.zone.len())?;
                if !record.zone.is_empty() {
                    check.verified.insert(old);
                }
            }
            return Ok(old.address);
        }
        match &mut self.mode {
            Mode::Write(appender) => appender.record(record, self.depth - code.level()),
            Mode::Check(check) => {
                let place = format!("node {code}");
                let problem = "its record, or its zone, is not what the leaves below make it";
                check.findings.push(Finding { place, problem: problem.into() });
                // (Once for all nodes that it stands for.)
                if let Some(old) = old.filter(|_| !record.zone.is_empty()) {
                    check.verified.insert(old);
                }
                // So that the nodes above are not found to be wrong for no other reason than this one.
                Ok(old.map_or(0, |old| old.address))
            }
        }
    }

    /// Writes the records of the nodes of a block that are one run each, and are so many levels below a node of the block
    /// whose records are given.
    fn runs(
        &mut self,
        (code, records, representative): (Code, &[u8], Value),
        levels: u8,
        number: usize,
        node: &mut BuiltNode,
    ) -> Result<()> {
        if levels == 0 {
            let record = NewRecord { representative, pointers: None, run: records, zone: &[] };
            let old = self.old_node(code)?;
            node.targets.push(self.write(code, record, old)?);
            node.bitmap |= 1 << number;
            return Ok(());
        }
        let layout = RecordLayout::new(self.form);
        let mut children = RunChildren::default();
        let read = layout.run_children(records, RunNode::default(), &mut children);
        read.expect(RECORDS_ARE_CHECKED);
        for (step, child) in children[..layout.children()].iter().enumerate() {
            if child.state == INNER {
                let at = child.node.record as usize;
                let skip = layout.head(records, at).expect(RECORDS_ARE_CHECKED).skip;
                let below = layout.subtree(records, at, skip).expect(RECORDS_ARE_CHECKED);
                let number = number * layout.children() + step;
                self.runs((code.child(step), below, child.value), levels - 1, number, node)?;
            }
        }
        Ok(())
    }
}

/// Whether a record of the file is already what it should be.
fn is_same(base: &Autumnal, old: Node, new: NewRecord<'_>) -> Result<bool> {
    let record = base.record(old)?;
    if record.run() != new.run || base.representative(old)? != new.representative {
        return Ok(false);
    }
    let Some((bitmap, targets)) = new.pointers else { return Ok(true) };
    let is_same = record.parts.bitmap == bitmap
        && record.parts.pointers(&record.bytes, record.address).as_deref() == Some(targets);
    Ok(is_same && base.has_zone(old, new.zone)?)
}

impl TreeSink for RecordBuilder<'_> {
    /// Those of a run: what is one run alone is never inside of a larger dense block.
    fn dense_levels(&self) -> u8 {
        self.heights.run
    }

    fn push(&mut self, (mut part, sealed, _): BuiltBlock) -> Result<()> {
        // A small tree is one block, whose records were taken for the root's segment.
        if let Some(sealed) = sealed {
            part.records = sealed.records;
        }
        part.tally.keep_listed_for(self.rule);
        let mut node = BuiltNode::new(part);
        let code = node.part.code;
        let height = self.depth - code.level();
        if let (Child::Inner { representative, .. }, Some(below)) =
            (node.part.child, self.heights.below(height))
        {
            let records = mem::take(&mut node.part.records);
            self.runs((code, &records, representative), height - below, 0, &mut node)?;
            node.part.records = records;
        }
        self.seal(&mut node)?;
        self.join(node)
    }

    fn keep(&mut self, code: Code, kept: RecordRef) -> Result<bool> {
        if self.keep_own(code, kept)? {
            return Ok(true);
        }
        let is_own = self.base.is_some_and(|base| base.archive.file == kept.file);
        let copied = self.copied.as_mut().filter(|_| self.shares || is_own);
        let Some(copy) = copied.and_then(|copied| copied.find(code, kept)) else { return Ok(false) };
        self.join(copy)?;
        Ok(true)
    }
}

impl RecordBuilder<'_> {
    /// Keeps a node of the file itself, or one of which it is known where it is in the file.
    fn keep_own(&mut self, code: Code, kept: RecordRef) -> Result<bool> {
        let Some(base) = self.base else { return Ok(false) };
        let node = Node::new(kept.address, kept.height);
        let node = if kept.file == base.archive.file {
            Some(node)
        } else if let Some(twin) = self.twin
            && twin.archive.file == kept.file
            && twin.inner_at(code)? == Some(node)
        {
            // The other file has this node at this code; so has this file, somewhere else.
            base.inner_at(code)?
        } else {
            None
        };
        // What has no zone is smaller than a block: it is built anew, and found to be there.
        let Some(node) = node else { return Ok(false) };
        if let Mode::Check(check) = &self.mode
            && !check.verified.contains(node)
        {
            return Ok(false);
        }
        let Some(Zone { records: total, tally }) = base.zone(node)? else { return Ok(false) };
        if self.rule == Rule::Majority && tally.lacks_classes() {
            return Ok(false);
        }
        let child = Child::Inner { representative: base.representative(node)?, node: () };
        let above = self.above_of(code, base.record(node)?.run());
        let records = above.ok_or_else(|| base.bad_run(node.address))?;
        let part = Part { code, child, total, records, tally };
        self.join(BuiltNode { part, bitmap: 1, targets: vec![node.address] })?;
        Ok(true)
    }
}
