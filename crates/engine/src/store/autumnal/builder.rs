//! Encodes the nodes of a tree as records, and keeps records that the file already has.

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
use crate::store::builder::{
    BuildOptions, BuiltBlock, EncodedSubtree, RecordRef, Siblings, TreeSink, upper_levels,
};
use crate::store::records::subtree::RECORDS_ARE_CHECKED;
use crate::store::records::{RecordLayout, RunChildren, RunNode, Runs};
use crate::tree::{Child, Source};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::space::Code;
use spinney_base::value::{Rule, Value};
use spinney_container::{Finding, INNER, LevelCounts};

/// Use of the built records.
pub(super) enum Mode<'a> {
    /// Write them unless the file has them.
    Write(&'a mut Appender),
    /// Report those that the file does not have.
    Check(Check<'a>),
}

/// A check of a file's records.
pub(super) struct Check<'a> {
    pub(super) findings: &'a mut Vec<Finding>,
    pub(super) verified: &'a Verified,
    /// Address range of the previous record's extent.
    extent: Range<u64>,
}

impl<'a> Check<'a> {
    pub(super) fn new(findings: &'a mut Vec<Finding>, verified: &'a Verified) -> Check<'a> {
        Check { findings, verified, extent: 0..0 }
    }

    /// Fails if a record with `zone` bytes of zone exceeds its extent.
    fn check_place(&mut self, tree: &Autumnal, node: AutumnalNode, zone: usize) -> Result<()> {
        // (Each packed record is looked up individually.)
        if !self.extent.contains(&node.address) || tree.extents().packed().is_some() {
            self.extent = tree.extents().records_at(node.address)?;
        }
        let size = tree.record(node)?.fields.end + zone;
        if self.extent.end - node.address < size as u64 {
            let found = format!("{size} bytes");
            let expected = format!("an end at or before byte {}, the end of its extent", self.extent.end);
            return Err(tree.extents().corrupt(format!("record at {}", node.address), found, &expected));
        }
        Ok(())
    }
}

/// Memory in bytes for nodes of other files that were copied already, if equal subtrees are stored
/// once.
const COPIED: u64 = 8 << 20;

/// Merges blocks whose siblings are complete, and writes new records.
pub(super) struct RecordBuilder<'a> {
    form: TreeType,
    heights: Heights,
    rule: Rule,
    depth: u8,
    with_classes: bool,
    mode: Mode<'a>,
    /// The file's current tree.
    base: &'a Autumnal,
    /// A commit of another file with the same tree as `base`: a node that is known to be in one is
    /// in both.
    twin: Option<&'a Autumnal>,
    /// Whether equal subtrees are stored once.
    shares: bool,
    /// Results for nodes that were built already: nodes of other files if equal subtrees are stored
    /// once, and the file's own nodes that had to be rebuilt.
    copied: Option<Copied>,
    siblings: Siblings<BuiltNode>,
    root: Option<BuiltNode>,
}

impl<'a> RecordBuilder<'a> {
    /// Creates a builder. `covered` is the extent of the blocks to come; everything outside is
    /// VOID.
    pub(super) fn new(
        base: &'a Autumnal,
        options: &BuildOptions,
        covered: [u64; 3],
        mode: Mode<'a>,
        twin: Option<&'a Autumnal>,
    ) -> RecordBuilder<'a> {
        let form = base.form();
        let shares = matches!(&mode, Mode::Write(appender) if appender.shares());
        // A majority needs the counts of all classes, which zones of large kept nodes may lack.
        let must_count = options.rule == Rule::Majority;
        // If equal subtrees are stored once, a commit's summary counts shared records. The count
        // must not depend on the memory limit.
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

    /// Returns the root and its zone after all blocks were pushed.
    pub(super) fn finish(self) -> (Root, Zone) {
        let BuiltNode { subtree, pointers } = self.root.expect("all blocks were pushed");
        let value = subtree.child.value().map(|value| value.to_bytes()[..self.form.width()].to_vec());
        let address = if subtree.child.is_inner() { pointers.targets[0] } else { 0 };
        let root = Root { state: subtree.child.state() as u8, value: value.unwrap_or_default(), address };
        (root, Zone { inner_nodes: subtree.total, tally: subtree.tally })
    }

    /// Adds a node and all ancestors that it completes.
    fn join(&mut self, mut node: BuiltNode) -> Result<()> {
        let (depth, value_type) = (self.depth, self.form.value);
        loop {
            let code = node.subtree.code;
            if let Some(copied) = &mut self.copied {
                copied.made(code, &node);
            }
            let Some(parent) = code.parent() else {
                self.root = Some(node);
                return Ok(());
            };
            let void = |code| BuiltNode::new(EncodedSubtree::uniform(code, depth, value_type, None, false));
            let step = code.step(parent.level());
            let Some(children) = self.siblings.join(parent, step, node, void) else { return Ok(()) };
            node = self.merge(parent, children)?;
        }
    }

    /// Merges all children of a node, in order.
    fn merge(&mut self, code: Code, nodes: Vec<BuiltNode>) -> Result<BuiltNode> {
        let height = self.depth - code.level();
        // Levels from a child down to the next nodes with records; 0 if the child itself has one.
        let levels = self.heights.target_height(height).map_or(0, |target_height| height - 1 - target_height);
        let bits = self.form.dimension.cells(levels);
        let mut pointers = Pointers::default();
        let mut subtrees = Vec::with_capacity(nodes.len());
        for (step, node) in (0..).zip(nodes) {
            // Invariant: 64 bits suffice, since nodes with records are at most two levels apart (8
            // x 8 nodes in an octree). The children's bits are contiguous in child order, as are
            // their targets. One extra bit would assign a node the record of another.
            debug_assert!(bits * step < 64);
            pointers.bitmap |= node.pointers.bitmap << (bits * step);
            pointers.targets.extend(node.pointers.targets);
            subtrees.push(node.subtree);
        }
        let subtree =
            EncodedSubtree::merge(code, &subtrees, self.depth, self.rule, &mut LevelCounts::default());
        let mut node = BuiltNode { subtree, pointers };
        self.write_own_record(&mut node)?;
        Ok(node)
    }

    /// Writes the record of a node if it should have one, and reduces the node to what its
    /// ancestors need.
    fn write_own_record(&mut self, node: &mut BuiltNode) -> Result<()> {
        let code = node.subtree.code;
        let height = self.depth - code.level();
        let Child::Inner { representative, .. } = node.subtree.child else { return Ok(()) };
        if self.heights.record_of(height) != height {
            return Ok(());
        }
        let run = upper_levels(self.form, &node.subtree.records, self.heights.run_of(height));
        let run = run.expect(RECORDS_ARE_CHECKED);
        let zone = match self.heights.has_zone(height) {
            true => Zone { inner_nodes: node.subtree.total, tally: node.subtree.tally.clone() }
                .to_bytes(self.with_classes),
            false => Vec::new(),
        };
        let pointers = &node.pointers;
        let address =
            self.write(code, NewRecord { height, representative, pointers, run: &run, zone: &zone })?;
        node.subtree.records = self.above_of(code, &run).expect(RECORDS_ARE_CHECKED);
        node.pointers = Pointers { bitmap: 1, targets: vec![address] };
        Ok(())
    }

    /// Returns the upper levels of a node's run that its ancestor's run contains, or `None` if the
    /// run contradicts itself.
    fn above_of(&self, code: Code, run: &[u8]) -> Option<Vec<u8>> {
        let height = self.depth - code.level();
        if height == self.depth {
            return Some(Vec::new());
        }
        let levels = self.heights.run - (self.heights.record_of(height + 1) - height);
        upper_levels(self.form, run, levels).ok()
    }

    /// Writes the record of a node, unless it equals the one at that node before.
    fn write(&mut self, code: Code, record: NewRecord<'_>) -> Result<u64> {
        let old = self.base.inner_at(code)?;
        // Invariant: a record is written after all records that it points to, and existing records
        // are never changed. So the addresses in its pointers are known, all pointers lead back,
        // which ends every descent, and equal addresses mean equal subtrees: a record with the same
        // pointers as before is the same tree, and its subtree is kept without being read. (Crashes
        // do not matter here: no commit refers to any of these records before all are durable.)
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
                let problem = "its record or zone differs from the one computed from the leaves below";
                check.findings.push(Finding { place, problem: problem.into() });
                // (Once for all nodes that the record represents.)
                if let Some(old) = old.filter(|_| !record.zone.is_empty()) {
                    check.verified.insert(old);
                }
                // Return the old address, so that this finding does not make the nodes above fail
                // as well.
                Ok(old.map_or(0, |old| old.address))
            }
        }
    }

    /// Writes the records of all nodes of a block below its node `top`. Returns the pointers of
    /// `top`.
    fn write_below(&mut self, top: (Code, &[u8], Value)) -> Result<Pointers> {
        let height = self.depth - top.0.level();
        let mut pointers = Pointers::default();
        if let Some(target_height) = self.heights.target_height(height) {
            self.write_levels_below(top, height - target_height, 0, &mut pointers)?;
        }
        Ok(pointers)
    }

    /// Writes the records of the nodes `levels` levels below a node of a block, and of their
    /// descendants. Adds pointers to the former. `number` is the path from the top node to this
    /// node.
    fn write_levels_below(
        &mut self,
        (code, records, representative): (Code, &[u8], Value),
        levels: u8,
        number: usize,
        pointers: &mut Pointers,
    ) -> Result<()> {
        if levels == 0 {
            let own = self.write_below((code, records, representative))?;
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
                let subtree = layout.subtree(records, at, skip).expect(RECORDS_ARE_CHECKED);
                let number = number * layout.children() + step;
                self.write_levels_below(
                    (code.child(step), subtree, child.value),
                    levels - 1,
                    number,
                    pointers,
                )?;
            }
        }
        Ok(())
    }
}

/// Returns whether an existing record equals the new one.
fn is_same(base: &Autumnal, old: AutumnalNode, new: NewRecord<'_>) -> Result<bool> {
    let record = base.record(old)?;
    if record.run() != new.run || base.representative(old)? != new.representative {
        return Ok(false);
    }
    let pointers = record.fields.pointers(&record.bytes, record.address);
    Ok(pointers.as_ref() == Some(new.pointers) && base.zone_equals(old, new.zone)?)
}

impl TreeSink for RecordBuilder<'_> {
    /// Returns the levels of a run. Invariant: a record that is one run is never inside a larger
    /// dense block. Its bytes are therefore the same in every context and match the existing
    /// record. Otherwise an edit would rewrite records that it did not change.
    fn dense_levels(&self) -> u8 {
        self.heights.run
    }

    fn push(&mut self, (mut subtree, sealed, _): BuiltBlock) -> Result<()> {
        // If the tree is a single block, the block is the root, which owns a segment in a Goblin
        // file: building has moved its records there (`EncodedSubtree::seal`). Here they are the
        // root's run. (Other blocks own none: the shape makes no node heavy.)
        if let Some(sealed) = sealed {
            subtree.records = sealed.records;
        }
        subtree.tally.keep_listed_for(self.rule);
        let mut node = BuiltNode::new(subtree);
        if let Child::Inner { representative, .. } = node.subtree.child {
            node.pointers = self.write_below((node.subtree.code, &node.subtree.records, representative))?;
        }
        self.write_own_record(&mut node)?;
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
    /// Keeps a node of the file itself, or one whose location in this file is known.
    fn keep_own(&mut self, code: Code, kept: RecordRef) -> Result<bool> {
        let base = self.base;
        // Invariant: a kept record is the one that building its cells would yield. The source of an
        // edit may be another layer of this file, or an older commit of one. Such a layer has the
        // same tree type and run levels, but may have another rule, zones without class counts, or
        // a root at a height where this layer has no records.
        let is_alike = kept.rule == self.rule
            && kept.counts_classes == self.with_classes
            && self.heights.record_of(kept.height) == kept.height;
        if !is_alike {
            return Ok(false);
        }
        let node = AutumnalNode::new(kept.address, kept.height);
        let node = if kept.file == base.archive.file {
            Some(node)
        } else if let Some(twin) = self.twin
            && twin.archive.file == kept.file
            && twin.inner_at(code)? == Some(node)
        {
            // The other file has this node at this code, so this file has it, too, at another
            // address.
            base.inner_at(code)?
        } else {
            None
        };
        // Invariant: a kept node provides everything that its ancestors are computed from: its
        // representative, its zone with the counts that the rule needs, and its upper levels. A
        // node without a zone is smaller than a block: it is rebuilt, and then matches the existing
        // record. Otherwise representatives above an edit would cover only some of their cells.
        let Some(node) = node else { return Ok(false) };
        if let Mode::Check(check) = &self.mode
            && !check.verified.contains(node)
        {
            return Ok(false);
        }
        let Some(Zone { inner_nodes: total, tally }) = base.zone(node)? else { return Ok(false) };
        if self.rule == Rule::Majority && tally.lacks_classes() {
            return Ok(false);
        }
        let child = Child::Inner { representative: base.representative(node)?, node: () };
        let above = self.above_of(code, base.record(node)?.run());
        let records = above.ok_or_else(|| base.bad_run(node.address))?;
        let subtree = EncodedSubtree { code, child, total, records, tally };
        self.join(BuiltNode { subtree, pointers: Pointers { bitmap: 1, targets: vec![node.address] } })?;
        Ok(true)
    }
}
