//! Conversion of plain segments to nodes, and back.

use spinney_container::{DenseBlock, INNER, LEAF, RecordHead, RecordLayout, dense_child};

use crate::blocks::NumberBlock;
use crate::nodes::{Dense, FIRST_VALUE, MIXED, NOTHING, Nodes, ROOT};

/// Parsed plain segment.
pub(crate) struct Parsed {
    /// All nodes, except those below the roots of dense blocks if these are coded separately.
    /// Symbols are not set yet.
    pub(crate) nodes: Nodes,
    /// Offset of each node's value in the segment.
    pub(crate) values: Vec<u32>,
    /// Dense blocks that are coded separately: the node that each begins at, and the index of its
    /// record.
    pub(crate) blocks: Vec<(u32, Dense, usize)>,
}

/// Position of an INNER node whose children come next: its index, the index of its record or of its
/// dense block's record, and in a block its level and its index in that level.
#[derive(Clone, Copy)]
struct ParsePosition {
    node: u32,
    place: usize,
    level: u8,
    index: usize,
}

/// Parses a segment's records. Returns `None` if they are inconsistent.
pub(crate) fn parse(layout: &RecordLayout, records: &[u8], dense_apart: bool) -> Option<Parsed> {
    let mut parsed = Parsed { nodes: Nodes::new(), values: vec![0; 2], blocks: Vec::new() };
    let mut level = vec![ParsePosition { node: ROOT, place: 0, level: 0, index: 0 }];
    while !level.is_empty() {
        let mut next = Vec::new();
        for pending in level {
            let head = layout.head(records, pending.place)?;
            if head.dense == 0 {
                parsed.record(layout, records, head, pending, &mut next)?;
                continue;
            }
            let block = layout.dense(records, pending.place, head)?;
            if pending.level == 0 {
                let dense = Dense { kind: block.kind, levels: block.levels };
                parsed.nodes.push_dense(pending.node, dense);
                if dense_apart {
                    parsed.blocks.push((pending.node, dense, pending.place));
                    continue;
                }
            }
            parsed.in_block(layout, &block, pending, &mut next);
        }
        // (Records that several nodes share could make many nodes of few bytes.)
        if parsed.values.len() > 2 + records.len() / layout.width {
            return None;
        }
        level = next;
    }
    Some(parsed)
}

impl Parsed {
    fn push(&mut self, state: u8, value: usize) -> u32 {
        let node = self.nodes.len();
        self.nodes.push(state, NOTHING);
        self.values.push(value as u32);
        node
    }

    fn record(
        &mut self,
        layout: &RecordLayout,
        records: &[u8],
        head: RecordHead,
        parent: ParsePosition,
        next: &mut Vec<ParsePosition>,
    ) -> Option<()> {
        self.nodes.set_first(parent.node, self.nodes.len());
        let mut place = parent.place + 1;
        for child in 0..layout.children() {
            let state = head.state(child);
            let node = self.push(state, parent.place * layout.size + child * layout.width);
            if state == INNER {
                next.push(ParsePosition { node, place, level: 0, index: 0 });
                place = place.checked_add(layout.head(records, place)?.skip.max(1) as usize)?;
            }
        }
        Some(())
    }

    fn in_block(
        &mut self,
        layout: &RecordLayout,
        block: &DenseBlock<'_>,
        parent: ParsePosition,
        next: &mut Vec<ParsePosition>,
    ) {
        self.nodes.set_first(parent.node, self.nodes.len());
        let level = parent.level + 1;
        let values = parent.place * layout.size + layout.dense_values_at(level);
        for child in 0..layout.children() {
            let index = block.child(level, parent.index, child);
            let state = block.state(level, index);
            let node = self.push(state, values + index * layout.width);
            if state == INNER {
                next.push(ParsePosition { node, level, index, ..parent });
            }
        }
    }
}

/// Writer of a segment's records.
pub(crate) struct Writer<'w> {
    pub(crate) layout: &'w RecordLayout,
    pub(crate) nodes: &'w Nodes,
    /// Values, by symbol less [`FIRST_VALUE`].
    pub(crate) values: &'w [[u8; 16]],
    pub(crate) rows: Rows,
}

/// Reused buffers for dense blocks: two levels of nodes in rows, and the first children of the
/// upper one.
#[derive(Default)]
pub(crate) struct Rows {
    level: Vec<u32>,
    below: Vec<u32>,
    families: Vec<(u32, u32)>,
}

impl Writer<'_> {
    /// Returns the value of a node; zeros for VOID. Returns `None` if the symbol is unknown.
    #[inline(always)]
    fn value(&self, node: u32) -> Option<[u8; 16]> {
        match self.nodes.symbol(node) {
            NOTHING => Some([0; 16]),
            MIXED => Some([self.nodes.fullness(node); 16]),
            symbol => self.values.get(symbol.wrapping_sub(FIRST_VALUE) as usize).copied(),
        }
    }

    /// Writes the record of an INNER node and all below it, as long as the records take at most
    /// `most` slots. Dense blocks that are coded separately, in the order of the nodes that they
    /// begin at, get their offsets, but no numbers yet. Returns `None` if there are too few slots,
    /// or if nodes do not form the dense block that they should.
    pub(crate) fn write(
        &mut self,
        node: u32,
        records: &mut Vec<u8>,
        most: usize,
        blocks: &mut [NumberBlock],
    ) -> Option<()> {
        let (layout, nodes) = (self.layout, self.nodes);
        let start = records.len();
        if let Some(dense) = nodes.dense(node) {
            let skip = dense.slots(layout);
            if skip > most.checked_sub(start / layout.size)? {
                return None;
            }
            records.resize(start + skip * layout.size, 0);
            match blocks.binary_search_by_key(&node, |block| block.node) {
                Ok(found) => blocks[found].begin(layout, start, &mut records[start..]),
                Err(_) => {
                    self.fill(dense, node, &mut records[start..])?;
                    write_dense_head(layout, dense, &mut records[start..]);
                }
            }
            return Some(());
        }
        if start / layout.size >= most {
            return None;
        }
        let first = nodes.first(node)?;
        records.resize(start + layout.size, 0);
        let mut states = 0;
        for child in 0..layout.children() {
            let node = first + child as u32;
            let state = nodes.state(node);
            states |= u32::from(state) << (2 * child);
            put(&self.value(node)?, layout.width, &mut records[start + child * layout.width..]);
        }
        for node in (first..).take(layout.children()).filter(|node| nodes.state(*node) == INNER) {
            self.write(node, records, most, blocks)?;
        }
        let skip = ((records.len() - start) / layout.size) as u32;
        layout.write_head(&mut records[start..][..layout.size], RecordHead { states, skip, dense: 0 });
        Some(())
    }

    /// Writes the nodes of a dense block below its root: the values of all levels, and the bits of
    /// the bottom nodes. Returns `None` if the nodes do not form such a block.
    fn fill(&mut self, dense: Dense, root: u32, block: &mut [u8]) -> Option<()> {
        let (layout, nodes) = (self.layout, self.nodes);
        let Rows { mut level, mut below, mut families } = std::mem::take(&mut self.rows);
        // (LEAFs above the bottom represent all nodes below them.)
        level.clear();
        level.push(root);
        for depth in 1..=dense.levels {
            families.clear();
            families.extend(level.iter().map(|node| nodes.children(*node)));
            if families.iter().any(|(node, mask)| *mask == 0 && nodes.state(*node) == INNER) {
                return None;
            }
            let side = 1 << (depth - 1);
            below.resize(level.len() * layout.children(), 0);
            for (number, row) in families.chunks_exact(side).enumerate() {
                for child in (0..layout.children() as u32).step_by(2) {
                    let start = dense_child(depth, number * side, child as usize);
                    let pairs = below[start..][..2 * side].as_chunks_mut().0;
                    for (pair, (first, mask)) in pairs.iter_mut().zip(row) {
                        *pair = [first + (child & mask), first + ((child + 1) & mask)];
                    }
                }
            }
            std::mem::swap(&mut level, &mut below);
            let values = &mut block[layout.dense_values_at(depth)..][..level.len() * layout.width];
            for (node, bytes) in level.iter().zip(values.chunks_exact_mut(layout.width)) {
                put(&self.value(*node)?, layout.width, bytes);
            }
        }
        let (set, other) = dense.kind.states();
        let is_state = |node: &u32| Some(nodes.state(*node)) == other || nodes.state(*node) == set;
        if !level.iter().all(is_state) {
            return None;
        }
        if other.is_some() {
            let mask = &mut block[layout.dense_mask_at(dense.levels)..];
            for (bits, nodes_of_byte) in mask.iter_mut().zip(level.chunks(8)) {
                let bit_of = |(bit, node): (usize, &u32)| u8::from(nodes.state(*node) == set) << bit;
                *bits = nodes_of_byte.iter().enumerate().map(bit_of).sum();
            }
        }
        self.rows = Rows { level, below, families };
        Some(())
    }
}

/// Writes a value of `width` bytes. (Copies of a known width are one instruction.)
#[inline(always)]
fn put(value: &[u8; 16], width: usize, bytes: &mut [u8]) {
    match width {
        1 => bytes[0] = value[0],
        2 => bytes[..2].copy_from_slice(&value[..2]),
        4 => bytes[..4].copy_from_slice(&value[..4]),
        width => bytes[..width].copy_from_slice(&value[..width]),
    }
}

/// Writes the head of a dense block, given its values and bits, from which the states of the root's
/// children follow.
pub(crate) fn write_dense_head(layout: &RecordLayout, dense: Dense, bytes: &mut [u8]) {
    let block = DenseBlock::new(*layout, dense.kind, dense.levels, bytes);
    let state = |child: usize| u32::from(block.state(1, child)) << (2 * child);
    let states = (0..layout.children()).map(state).sum();
    let head = RecordHead { states, skip: dense.slots(layout) as u32, dense: dense.kind.number() };
    layout.write_head(&mut bytes[..layout.size], head);
}

/// Returns the number of record slots of an INNER node and all below it. Returns `None` if an INNER
/// node has no children.
pub(crate) fn slots(layout: &RecordLayout, nodes: &Nodes, node: u32) -> Option<usize> {
    if let Some(dense) = nodes.dense(node) {
        return Some(dense.slots(layout));
    }
    let first = nodes.first(node)?;
    let below = (first..).take(layout.children()).filter(|node| nodes.state(*node) == INNER);
    below.map(|node| slots(layout, nodes, node)).sum::<Option<usize>>().map(|below| 1 + below)
}

/// Calls `each` with the symbol and the cell count of every LEAF.
pub(crate) fn each_leaf(nodes: &Nodes, axes: usize, height: u8, mut each: impl FnMut(u32, u64)) {
    // (The nodes of a level are contiguous. Their number is that of the nodes with children in the
    // level above, times the children per node.)
    let (mut level, mut below) = (ROOT..ROOT + 1, height);
    while !level.is_empty() && below > 0 {
        below -= 1;
        let parents = level.clone().filter(|node| nodes.first(*node).is_some()).count();
        level = level.end..level.end + (parents << axes) as u32;
        for node in level.clone().filter(|node| nodes.state(*node) == LEAF) {
            each(nodes.symbol(node), 1 << (axes * usize::from(below)));
        }
    }
}
