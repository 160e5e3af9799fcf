//! Makes records of the parts of a tree, and keeps those that the file has already.

use zerocopy::IntoBytes;

use super::append::Appender;
use super::commit::Root;
use super::form::Field;
use super::reader::{Autumnal, Kept, Node};
use super::zone::{Zone, zone_height};
use crate::Result;
use crate::space::Code;
use crate::store::build::{Assembly, BuildOptions, Built, Siblings, state_of};
use crate::store::goblin::{Copied, Finding, INNER, LEAF, Layout, Record as _, Shape, VOID};
use crate::tree::Child;
use crate::value::{Rule, Tally, Value, representative};

/// The shape that makes blocks as large as the smallest nodes with zones, and leaves all their records together.
pub(super) fn shape<D: Layout>(depth: u8) -> Shape {
    Shape { depth, reach: zone_height::<D>(), stride: 1, light: u32::MAX }
}

/// Where records go.
pub(super) enum Sink<'a> {
    Append(&'a mut Appender),
    /// Nowhere: all of them should be there, and those that are not are findings.
    Check(&'a mut Vec<Finding>),
}

/// A node and all that is below it, which is in the file.
pub(super) struct Grown<V: Value> {
    /// INNER nodes have an address.
    pub(super) child: Child<V, u64>,
    pub(super) zone: Zone<V>,
}

/// Merges parts whose siblings are complete, and writes the records that are new.
pub(super) struct Grow<'a, D: Layout, V: Value> {
    rule: Rule,
    depth: u8,
    with_classes: bool,
    sink: Sink<'a>,
    /// What the file has.
    base: Option<&'a Autumnal<D, V>>,
    /// A commit of another file with the same tree as the base: what is known to be in one is in the other, too.
    twin: Option<&'a Autumnal<D, V>>,
    siblings: Siblings<D, Grown<V>>,
    root: Option<Grown<V>>,
}

impl<'a, D: Layout, V: Value> Grow<'a, D, V> {
    /// `covered` is the extent of the parts that will come; what is outside is VOID.
    pub(super) fn new(
        options: &BuildOptions,
        covered: [u64; 3],
        sink: Sink<'a>,
        base: Option<&'a Autumnal<D, V>>,
        twin: Option<&'a Autumnal<D, V>>,
    ) -> Self {
        Grow {
            rule: options.rule,
            depth: options.depth,
            with_classes: options.count_classes(),
            sink,
            base,
            twin,
            siblings: Siblings::new(options.depth, covered),
            root: None,
        }
    }

    /// The root, once everything has come.
    pub(super) fn finish(self) -> (Root, Zone<V>) {
        let Grown { child, zone } = self.root.expect("all blocks were pushed");
        let value = child.value().map(|value| value.to_wire().as_bytes().to_vec());
        let address = if let Child::Inner { node, .. } = child { node } else { 0 };
        (Root { state: state_of(&child), value: value.unwrap_or_default(), address }, zone)
    }

    /// Takes a node, and as many of its ancestors as are complete with it.
    fn join(&mut self, code: Code<D>, part: Grown<V>) -> Result<()> {
        let (mut code, mut part) = (code, part);
        while let Some(parent) = code.parent() {
            let void = |_| Grown { child: Child::Void, zone: Zone { records: 0, tally: Tally::void() } };
            let step = code.step(parent.level());
            let Some(parts) = self.siblings.join(parent, step, part, void) else { return Ok(()) };
            part = self.merge(parent, &parts)?;
            code = parent;
        }
        self.root = Some(part);
        Ok(())
    }

    /// The parent of these parts, which are all its children in order.
    fn merge(&mut self, code: Code<D>, parts: &[Grown<V>]) -> Result<Grown<V>> {
        let tally = Tally::merge(&parts.iter().map(|part| &part.zone.tally).collect::<Vec<_>>());
        let first = parts[0].child;
        let uniform = parts.iter().all(|part| match (first, part.child) {
            (Child::Void, Child::Void) => true,
            (Child::Leaf(a), Child::Leaf(b)) => a.same(b),
            _ => false,
        });
        if uniform {
            return Ok(Grown { child: first, zone: Zone { records: 0, tally } });
        }
        let height = self.depth - code.level();
        let values: Vec<Option<(V, bool)>> =
            parts.iter().map(|part| part.child.value().map(|value| (value, part.child.is_inner()))).collect();
        let cells = 1 << (D::AXES * usize::from(height));
        let representative = representative(self.rule, &values, &tally, cells);
        let records = 1 + parts.iter().map(|part| part.zone.records).sum::<u64>();
        let zone = Zone { records, tally };
        let children: Vec<Child<V, u64>> = parts.iter().map(|part| part.child).collect();
        let old = self.base.map_or(Ok(None), |base| base.inner_at(code))?;
        let bytes = if height >= zone_height::<D>() { zone.to_bytes(self.with_classes) } else { Vec::new() };
        let address = self.write(code, representative, &children, &bytes, old)?;
        Ok(Grown { child: Child::Inner { representative, node: address }, zone })
    }

    /// Writes a record, unless it is the one that was there before.
    fn write(
        &mut self,
        code: Code<D>,
        representative: V,
        children: &[Child<V, u64>],
        zone: &[u8],
        old: Option<Node>,
    ) -> Result<u64> {
        if let (Some(base), Some(old)) = (self.base, old)
            && same(base, old, representative, children, zone)?
        {
            return Ok(old.address);
        }
        match &mut self.sink {
            Sink::Append(appender) => {
                let wire = representative.to_wire();
                let wires = D::array(|child| children[child].value().unwrap_or_default().to_wire());
                let mut fields = [Field::Void; 8];
                for ((field, child), wire) in fields.iter_mut().zip(children).zip(wires.as_ref()) {
                    *field = match child {
                        Child::Void => Field::Void,
                        Child::Leaf(_) => Field::Leaf(wire.as_bytes()),
                        Child::Inner { node, .. } => Field::Inner(*node),
                    };
                }
                appender.record(wire.as_bytes(), &fields[..D::CHILDREN], zone)
            }
            Sink::Check(findings) => {
                let place = format!("node {code}");
                let problem = "its record, or its zone, is not what the leaves below make it";
                findings.push(Finding { place, problem: problem.into() });
                Ok(old.map_or(0, |old| old.address))
            }
        }
    }

    /// Writes the records of a block that are new, a node's after those of its children.
    fn block(
        &mut self,
        code: Code<D>,
        (records, at): (&[D::Record<V>], usize),
        representative: V,
        zone: &[u8],
        old: Option<Node>,
    ) -> Result<u64> {
        let record = &records[at];
        let before = match (self.base, old) {
            (Some(base), Some(old)) => Some((base, base.record(old)?, old.height)),
            _ => None,
        };
        let mut children = [Child::Void; 8];
        let mut next = at + 1;
        for (step, child) in children[..D::CHILDREN].iter_mut().enumerate() {
            *child = match record.state(step) {
                LEAF => Child::Leaf(record.value(step)),
                INNER => {
                    let old = match &before {
                        Some((base, before, height)) => match base.child(before, *height, step)? {
                            Child::Inner { node, .. } => Some(node),
                            _ => None,
                        },
                        None => None,
                    };
                    let representative = record.value(step);
                    let below = (records, next);
                    next += records[next].skip() as usize;
                    let node = self.block(code.child(step), below, representative, &[], old)?;
                    Child::Inner { representative, node }
                }
                state => {
                    debug_assert!(state == VOID);
                    Child::Void
                }
            };
        }
        self.write(code, representative, &children[..D::CHILDREN], zone, old)
    }
}

/// Whether a record is already what it should be.
fn same<D: Layout, V: Value>(
    base: &Autumnal<D, V>,
    old: Node,
    representative: V,
    children: &[Child<V, u64>],
    zone: &[u8],
) -> Result<bool> {
    let record = base.record(old)?;
    for (step, child) in children.iter().enumerate() {
        let same = match (base.child(&record, old.height, step)?, child) {
            (Child::Void, Child::Void) => true,
            (Child::Leaf(()), Child::Leaf(value)) => base.leaf(&record, step).same(*value),
            (Child::Inner { node, .. }, Child::Inner { node: address, .. }) => node.address == *address,
            _ => false,
        };
        if !same {
            return Ok(false);
        }
    }
    Ok(base.representative(old.address)?.same(representative)
        && (zone.is_empty() || base.has_zone(old, zone)?))
}

impl<D: Layout, V: Value> Assembly<D, V> for Grow<'_, D, V> {
    fn push(&mut self, (part, sealed, _): Built<D, V>) -> Result<()> {
        let zone = Zone { records: part.total, tally: part.tally };
        let child = match part.child {
            Child::Void => Child::Void,
            Child::Leaf(value) => Child::Leaf(value),
            Child::Inner { representative, .. } => {
                // A small tree is one block, whose records were taken for the root's segment.
                let records = sealed.map_or(part.records, |sealed| sealed.records);
                let is_large = self.depth - part.code.level() >= zone_height::<D>();
                let bytes = if is_large { zone.to_bytes(self.with_classes) } else { Vec::new() };
                let old = self.base.map_or(Ok(None), |base| base.inner_at(part.code))?;
                let node = self.block(part.code, (&records, 0), representative, &bytes, old)?;
                Child::Inner { representative, node }
            }
        };
        self.join(part.code, Grown { child, zone })
    }

    fn keep(&mut self, code: Code<D>, kept: Kept) -> Result<bool> {
        let Some(base) = self.base else { return Ok(false) };
        let node = Node { address: kept.address, height: kept.height };
        let node = if kept.file == base.archive.file {
            Some(node)
        } else if let Some(other) = self.twin
            && other.archive.file == kept.file
            && other.inner_at(code)? == Some(node)
        {
            base.inner_at(code)?
        } else {
            None
        };
        let Some(node) = node else { return Ok(false) };
        let Some(zone) = base.zone(node)? else { return Ok(false) };
        let child = Child::Inner { representative: base.representative(node.address)?, node: node.address };
        self.join(code, Grown { child, zone })?;
        Ok(true)
    }

    fn copy(&mut self, _: Copied<'_, D, V>) -> Result<()> {
        unreachable!("nothing is offered")
    }
}
