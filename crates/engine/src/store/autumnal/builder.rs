//! Makes records of the parts of a tree, and keeps those that the file has already.

use std::borrow::Cow;
use std::ops::Range;

use super::append::{Appender, NewRecord};
use super::built_node::BuiltNode;
use super::commit::Root;
use super::copied::Copied;
use super::layout::{Heights, Pointers};
use super::node::AutumnalNode;
use super::reader::Autumnal;
use super::verified::Verified;
use super::zone::Zone;
use crate::store::builder::{BuildOptions, BuiltBlock, Part, RecordRef, Siblings, TreeSink, upper_levels};
use crate::store::records::subtree::RECORDS_ARE_CHECKED;
use crate::store::records::{RecordLayout, RunChildren, RunNode, Runs};
use crate::tree::{Child, Source};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::space::Code;
use spinney_base::value::{Rule, Value};
use spinney_container::{Finding, INNER, LevelCounts};

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
    fn check_place(&mut self, tree: &Autumnal, node: AutumnalNode, zone: usize) -> Result<()> {
        // (Of packed records each is looked up by itself.)
        if !self.extent.contains(&node.address) || tree.extents().packed().is_some() {
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

/// Bytes for nodes of other files that were copied already, where equal subtrees are stored once.
const COPIED: u64 = 8 << 20;

/// Merges parts whose siblings are complete, and writes the records that are new.
pub(super) struct RecordBuilder<'a> {
    form: TreeType,
    heights: Heights,
    rule: Rule,
    depth: u8,
    with_classes: bool,
    mode: Mode<'a>,
    /// The tree that the file has.
    base: &'a Autumnal,
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
        base: &'a Autumnal,
        options: &BuildOptions,
        covered: [u64; 3],
        mode: Mode<'a>,
        twin: Option<&'a Autumnal>,
    ) -> RecordBuilder<'a> {
        let form = base.form();
        let shares = matches!(&mode, Mode::Write(appender) if appender.shares());
        // Majorities are made of the counts of all classes, which large nodes that are kept may not list.
        let must_count = options.rule == Rule::Majority;
        // Where equal subtrees are stored once, the account of a commit counts how often one was found: that must not depend
        // on the memory.
        let memory = if shares { COPIED } else { options.memory / 8 };
        RecordBuilder {
            form,
            heights: base.heights(),
            rule: options.rule,
            depth: options.depth,
            with_classes: options.count_classes(),
            mode,
            base,
            twin,
            shares,
            copied: (shares || must_count).then(|| Copied::new(memory)),
            siblings: Siblings::new(form.dimension, options.depth, covered),
            root: None,
        }
    }

    /// The root and its zone, once everything has come.
    pub(super) fn finish(self) -> (Root, Zone) {
        let BuiltNode { part, pointers } = self.root.expect("all blocks were pushed");
        let value = part.child.value().map(|value| value.to_bytes()[..self.form.width()].to_vec());
        let address = if part.child.is_inner() { pointers.targets[0] } else { 0 };
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
        let mut pointers = Pointers::default();
        let mut parts = Vec::with_capacity(nodes.len());
        for (step, node) in (0..).zip(nodes) {
            // Invariant: 64 bits are enough, since nodes with records are two levels apart at most: 8 x 8 of
            // an octree. The children's bits stand one behind the other in child order, as their targets do.
            // A bit too many would give a node the record of another.
            debug_assert!(bits * step < 64);
            pointers.bitmap |= node.pointers.bitmap << (bits * step);
            pointers.targets.extend(node.pointers.targets);
            parts.push(node.part);
        }
        let part = Part::merge(code, &parts, self.depth, self.rule, &mut LevelCounts::default());
        let mut node = BuiltNode { part, pointers };
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
        let zone = match self.heights.has_zone(height) {
            true => {
                Zone { records: node.part.total, tally: node.part.tally.clone() }.to_bytes(self.with_classes)
            }
            false => Vec::new(),
        };
        let pointers = &node.pointers;
        let address =
            self.write(code, NewRecord { height, representative, pointers, run: &run, zone: &zone })?;
        node.part.records = self.above_of(code, &run).expect(RECORDS_ARE_CHECKED);
        node.pointers = Pointers { bitmap: 1, targets: vec![address] };
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

    /// Writes the record of a node, unless it is the one that was there before.
    fn write(&mut self, code: Code, record: NewRecord<'_>) -> Result<u64> {
        let old = self.base.inner_at(code)?;
        // Invariant: records below are written before those above, and one that is there already is not
        // written again. So equal addresses mean equal subtrees: a record that points to the same ones as
        // before is the same tree, and keeps all that is below it without a look. Were a record written
        // before what it points to, a crash could leave pointers to nothing.
        if let Some(old) = old
            && is_same(self.base, old, record)?
        {
            if let Mode::Check(check) = &mut self.mode {
                check.check_place(self.base, old, record.zone.len())?;
                if !record.zone.is_empty() {
                    check.verified.insert(old);
                }
            }
            return Ok(old.address);
        }
        match &mut self.mode {
            Mode::Write(appender) => appender.record(record),
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

    /// Writes the records of all nodes of a block that have one and are below a node whose part of the block is given. Tells
    /// the pointers to those that come next below it.
    fn below(&mut self, top: (Code, &[u8], Value)) -> Result<Pointers> {
        let height = self.depth - top.0.level();
        let mut pointers = Pointers::default();
        if let Some(below) = self.heights.below(height) {
            self.levels_below(top, height - below, 0, &mut pointers)?;
        }
        Ok(pointers)
    }

    /// Writes the records of the nodes that are so many levels below one of a block, and of those below them. Adds pointers to
    /// the former, which are numbered from that of the one of the block on.
    fn levels_below(
        &mut self,
        (code, records, representative): (Code, &[u8], Value),
        levels: u8,
        number: usize,
        pointers: &mut Pointers,
    ) -> Result<()> {
        if levels == 0 {
            let own = self.below((code, records, representative))?;
            let height = self.depth - code.level();
            let run = match height > self.heights.run {
                true => {
                    let above = upper_levels(self.form, records, self.heights.run);
                    Cow::Owned(above.expect(RECORDS_ARE_CHECKED))
                }
                false => Cow::Borrowed(records),
            };
            let record = NewRecord { height, representative, pointers: &own, run: &run, zone: &[] };
            pointers.targets.push(self.write(code, record)?);
            pointers.bitmap |= 1 << number;
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
                self.levels_below((code.child(step), below, child.value), levels - 1, number, pointers)?;
            }
        }
        Ok(())
    }
}

/// Whether a record of the file is already what it should be.
fn is_same(base: &Autumnal, old: AutumnalNode, new: NewRecord<'_>) -> Result<bool> {
    let record = base.record(old)?;
    if record.run() != new.run || base.representative(old)? != new.representative {
        return Ok(false);
    }
    let pointers = record.parts.pointers(&record.bytes, record.address);
    Ok(pointers.as_ref() == Some(new.pointers) && base.has_zone(old, new.zone)?)
}

impl TreeSink for RecordBuilder<'_> {
    /// Those of a run. Invariant: what is one run alone is never inside of a larger dense block, so that its
    /// bytes are the same wherever it stands, and it is found to be in the file already. Otherwise an edit
    /// would write anew what it did not touch.
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
        if let Child::Inner { representative, .. } = node.part.child {
            node.pointers = self.below((node.part.code, &node.part.records, representative))?;
        }
        self.seal(&mut node)?;
        self.join(node)
    }

    fn keep(&mut self, code: Code, kept: RecordRef) -> Result<bool> {
        if self.keep_own(code, kept)? {
            return Ok(true);
        }
        let is_own = self.base.archive.file == kept.file;
        let copied = self.copied.as_mut().filter(|_| self.shares || is_own);
        let Some(copy) = copied.and_then(|copied| copied.find(code, kept)) else { return Ok(false) };
        self.join(copy)?;
        Ok(true)
    }
}

impl RecordBuilder<'_> {
    /// Keeps a node of the file itself, or one of which it is known where it is in the file.
    fn keep_own(&mut self, code: Code, kept: RecordRef) -> Result<bool> {
        let base = self.base;
        let node = AutumnalNode::new(kept.address, kept.height);
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
        // Invariant: what is kept tells all that the nodes above are made of: its representative, its zone
        // with the counts that the rule needs, and its upper levels. What has no zone is smaller than a
        // block: it is built anew, and found to be there. Otherwise representatives above an edit would be
        // those of a part of their cells.
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
        self.join(BuiltNode { part, pointers: Pointers { bitmap: 1, targets: vec![node.address] } })?;
        Ok(true)
    }
}
