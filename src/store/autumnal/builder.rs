//! Makes records of the parts of a tree, and keeps those that the file has already.

use std::ops::Range;

use super::append::{Appender, NewRecord};
use super::commit::Root;
use super::copied::Copied;
use super::reader::{Autumnal, Node};
use super::verified::Verified;
use super::zone::{Zone, zone_height};
use crate::Result;
use crate::space::{Code, Dimension};
use crate::store::builder::{
    BuildOptions, BuiltBlock, RecordRef, Siblings, TreeSink, representative_of, uniform_children,
};
use crate::store::container::subtree::RECORDS_ARE_CHECKED;
use crate::store::container::{Finding, INNER, LEAF, RecordLayout, Shape, VOID};
use crate::tree::{Child, Form, no_children};
use crate::value::{Rule, Tally, Value};

/// The shape that makes blocks as large as the smallest nodes with zones, and leaves all their records
/// together.
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
        let size = tree.layout().record_size(tree.record(node)?.states) + zone;
        if self.extent.end - node.address < size as u64 {
            let found = format!("{size} bytes");
            let expected = format!("an end at byte {} or before, where its extent ends", self.extent.end);
            return Err(tree.extents().corrupt(format!("record at {}", node.address), found, &expected));
        }
        Ok(())
    }
}

/// A node and all that is below it, which is in the file.
#[derive(Clone)]
pub(super) struct BuiltNode {
    /// INNER nodes have the address of their record.
    pub(super) child: Child<u64>,
    pub(super) zone: Zone,
}

/// Merges parts whose siblings are complete, and writes the records that are new.
pub(super) struct RecordBuilder<'a> {
    form: Form,
    /// Layout of the records of blocks, which are those of segments.
    block_layout: RecordLayout,
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

/// Records of a block, in preorder, as bytes, and the number of that of a node.
type BlockRecord<'a> = (&'a [u8], usize);

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
            block_layout: RecordLayout::new(form),
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

    /// The root, once everything has come.
    pub(super) fn finish(self) -> (Root, Zone) {
        let BuiltNode { child, zone } = self.root.expect("all blocks were pushed");
        let value = child.value().map(|value| value.to_bytes()[..self.form.width()].to_vec());
        let address = if let Child::Inner { node, .. } = child { node } else { 0 };
        (Root { state: child.state() as u8, value: value.unwrap_or_default(), address }, zone)
    }

    /// Takes a node, and as many of its ancestors as are complete with it.
    fn join(&mut self, code: Code, node: BuiltNode) -> Result<()> {
        let value_type = self.form.value;
        let (mut code, mut node) = (code, node);
        loop {
            if let Some(copied) = &mut self.copied {
                copied.made(code, &node);
            }
            let Some(parent) = code.parent() else { break };
            let zone = || Zone { records: 0, tally: Tally::void(value_type) };
            let void = |_| BuiltNode { child: Child::Void, zone: zone() };
            let step = code.step(parent.level());
            let Some(children) = self.siblings.join(parent, step, node, void) else { return Ok(()) };
            node = self.merge(parent, &children)?;
            code = parent;
        }
        self.root = Some(node);
        Ok(())
    }

    /// The parent of these nodes, which are all its children in order.
    fn merge(&mut self, code: Code, nodes: &[BuiltNode]) -> Result<BuiltNode> {
        let mut tally = Tally::merge(&nodes.iter().map(|node| &node.zone.tally).collect::<Vec<_>>());
        let mut children = no_children();
        let children = &mut children[..nodes.len()];
        for (child, node) in children.iter_mut().zip(nodes) {
            *child = node.child;
        }
        let uniform = uniform_children(children.iter().copied());
        if let Some(child) = uniform.map(|child| Child::uniform(child.value())) {
            return Ok(BuiltNode { child, zone: Zone { records: 0, tally } });
        }
        let height = self.depth - code.level();
        let cells = self.form.dimension.cells(height);
        let representative = representative_of(self.rule, children.iter().copied(), &tally, cells);
        tally.keep_listed_for(self.rule);
        // (Zones that were kept are those of a file, and may lie.)
        let records = nodes.iter().fold(1u64, |sum, node| sum.saturating_add(node.zone.records));
        let zone = Zone { records, tally };
        let bytes = self.zone_bytes(height, &zone);
        let old = self.old_node(code)?;
        let record = NewRecord { representative, children, zone: &bytes };
        let node = self.write(code, record, old)?;
        Ok(BuiltNode { child: Child::Inner { representative, node }, zone })
    }

    /// The bytes of the zone of a node with so many levels below it; none if it is too small to have one.
    fn zone_bytes(&self, height: u8, zone: &Zone) -> Vec<u8> {
        let has_zone = height >= zone_height(self.form.dimension);
        if has_zone { zone.to_bytes(self.with_classes) } else { Vec::new() }
    }

    /// The node that the file has there, if it is INNER.
    fn old_node(&self, code: Code) -> Result<Option<Node>> {
        self.base.map_or(Ok(None), |base| base.inner_at(code))
    }

    /// Writes a record, unless it is the one that was there before.
    fn write(&mut self, code: Code, record: NewRecord<'_>, old: Option<Node>) -> Result<u64> {
        // Copy on write: children come first, so equal addresses below mean equal subtrees, and an unchanged
        // record keeps all that is below it.
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

    /// Writes the records of a node of a block that are new, the node's own after those of its children.
    /// `old` is what the file has at the node.
    fn block(
        &mut self,
        code: Code,
        (records, number): BlockRecord<'_>,
        representative: Value,
        zone: &[u8],
        old: Option<Node>,
    ) -> Result<u64> {
        let layout = self.block_layout;
        let head = layout.head(records, number).expect(RECORDS_ARE_CHECKED);
        // The tree that is there is gone down side by side with the block, so that unchanged records are
        // found without looking for each from the root.
        let before = match (self.base, old) {
            (Some(base), Some(old)) => Some((base, base.record(old)?, old.height)),
            _ => None,
        };
        let mut children = no_children();
        let mut next = number + 1;
        for (step, child) in children[..layout.children()].iter_mut().enumerate() {
            let state = head.state(step);
            if state == VOID {
                continue;
            }
            let value = layout.value(records, number, step);
            if state == LEAF {
                *child = Child::Leaf(value);
                continue;
            }
            debug_assert!(state == INNER, "blocks are not cut");
            let old = match &before {
                Some((base, record, height)) if record.state(step) > LEAF => {
                    Some(base.inner(record, *height, step)?)
                }
                _ => None,
            };
            let skip = layout.head(records, next).expect(RECORDS_ARE_CHECKED).skip as usize;
            let node = self.block(code.child(step), (records, next), value, &[], old)?;
            next += skip;
            *child = Child::Inner { representative: value, node };
        }
        let children = &children[..layout.children()];
        self.write(code, NewRecord { representative, children, zone }, old)
    }
}

/// Whether a record of the file is already what it should be.
fn is_same(base: &Autumnal, old: Node, new: NewRecord<'_>) -> Result<bool> {
    let record = base.record(old)?;
    for (step, child) in new.children.iter().enumerate() {
        let is_same = match (record.state(step), child) {
            (VOID, Child::Void) => true,
            (LEAF, Child::Leaf(value)) => base.leaf(&record, step) == *value,
            // The representative is in the child's own record, which is the same one or another.
            (VOID | LEAF, _) | (_, Child::Void | Child::Leaf(_)) => false,
            (_, Child::Inner { node, .. }) => base.inner(&record, old.height, step)?.address == *node,
        };
        if !is_same {
            return Ok(false);
        }
    }
    Ok(base.representative(old.address)? == new.representative
        && (new.zone.is_empty() || base.has_zone(old, new.zone)?))
}

impl TreeSink for RecordBuilder<'_> {
    fn push(&mut self, (part, sealed, _): BuiltBlock) -> Result<()> {
        let mut tally = part.tally;
        tally.keep_listed_for(self.rule);
        let zone = Zone { records: part.total, tally };
        let child = match part.child {
            Child::Void => Child::Void,
            Child::Leaf(value) => Child::Leaf(value),
            Child::Inner { representative, .. } => {
                // A small tree is one block, whose records were taken for the root's segment.
                let records = sealed.map_or(part.records, |sealed| sealed.records);
                let bytes = self.zone_bytes(self.depth - part.code.level(), &zone);
                let old = self.old_node(part.code)?;
                let node = self.block(part.code, (&records, 0), representative, &bytes, old)?;
                Child::Inner { representative, node }
            }
        };
        self.join(part.code, BuiltNode { child, zone })
    }

    fn keep(&mut self, code: Code, kept: RecordRef) -> Result<bool> {
        if self.keep_own(code, kept)? {
            return Ok(true);
        }
        let is_own = self.base.is_some_and(|base| base.archive.file == kept.file);
        let copied = self.copied.as_mut().filter(|_| self.shares || is_own);
        let Some(copy) = copied.and_then(|copied| copied.find(code, kept)) else { return Ok(false) };
        self.join(code, copy)?;
        Ok(true)
    }
}

impl RecordBuilder<'_> {
    /// Keeps a node of the file itself, or one of which it is known where it is in the file.
    fn keep_own(&mut self, code: Code, kept: RecordRef) -> Result<bool> {
        let Some(base) = self.base else { return Ok(false) };
        let node = Node { address: kept.address, height: kept.height };
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
        let Some(zone) = base.zone(node)? else { return Ok(false) };
        if self.rule == Rule::Majority && zone.tally.lacks_classes() {
            return Ok(false);
        }
        let child = Child::Inner { representative: base.representative(node.address)?, node: node.address };
        self.join(code, BuiltNode { child, zone })?;
        Ok(true)
    }
}
