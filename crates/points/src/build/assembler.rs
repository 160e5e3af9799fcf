//! Forms nodes from points in code order.
//!
//! In code order, the points of a node are contiguous, and so are those of each of its sampling
//! cells, of which every one contributes at most one point. A point is thus the first of its
//! sampling cell exactly if the previous point is outside it. The level of the common ancestor of
//! the two points yields the coarsest node that can take the point.
//!
//! The output order does not depend on how many assemblers share the work. Nodes come out in
//! postorder, and a node's blocks directly precede the node. A node's own blocks therefore wait
//! until the node ends, and pending leaves come out before anything that follows them.

use super::NodeSink;
use super::encoder::{EncodedBlock, Encoder};
use crate::grid::spacing_levels;
use crate::statistics::Statistics;
use spinney_base::Result;
use spinney_base::space::Code;

/// Output of an assembler: a block or a node.
pub(crate) enum BuiltItem {
    /// A block of a node. The blocks of one node come in order.
    Block(Code, Vec<u8>, Statistics),
    /// A node, with statistics of all points in it and below.
    Node(Code, Statistics),
}

/// A small node without children, which an ancestor may absorb.
pub(crate) struct Pending {
    pub code: Code,
    pub rows: Vec<u8>,
}

/// Result of closing a node.
pub(crate) enum Closed {
    /// So few points that an ancestor may absorb them.
    Few(Pending),
    /// A separate node, with statistics of all points in it and below.
    Node(Statistics),
}

/// A node that still receives points.
struct Open {
    code: Code,
    /// Own rows that are in no block yet.
    rows: Vec<u8>,
    /// Small nodes below that may be absorbed.
    pending: Vec<Pending>,
    /// Total row bytes of `pending`.
    pending_rows: usize,
    /// Own blocks, which come out after everything below.
    blocks: Vec<EncodedBlock>,
    /// Whether it has too many points for a leaf.
    // Invariant: all ancestors of a divided node are divided.
    is_divided: bool,
    /// Statistics of own blocks and of nodes below. They are separate so that the order of
    /// summation does not depend on how the points were divided.
    own: Statistics,
    below: Statistics,
}

/// A subtree that another assembler has assembled.
pub(crate) struct Assembled {
    pub closed: Closed,
    /// Rows that belong to nodes above it, in code order, with the level of each.
    pub levels: Vec<u8>,
    pub above: Vec<u8>,
}

/// Forms nodes from points in code order.
pub(crate) struct Assembler<'a> {
    encoder: &'a Encoder,
    /// Maximum number of points in a block, and in a node without children.
    leaf_size: usize,
    open: Vec<Open>,
    /// Result of the top node, if another assembler made it.
    whole: Option<Closed>,
    /// Rows of nodes above the top one, with their levels.
    levels: Vec<u8>,
    above: Vec<u8>,
    /// Finished blocks and nodes.
    pub(crate) items: Vec<BuiltItem>,
}

/// Returns the level of a point's node. `same` is the level of the common ancestor with the
/// previous point; `None` for the first point.
pub(crate) fn node_level(encoder: &Encoder, same: Option<u8>) -> u8 {
    let grid = &encoder.grid;
    let first = same.map_or(0, |same| (same + 1).saturating_sub(spacing_levels(grid.dimension)));
    first.min(grid.deepest())
}

impl<'a> Assembler<'a> {
    /// Creates an assembler for a node's subtree.
    pub(crate) fn new(encoder: &'a Encoder, leaf_size: usize, top: Code) -> Assembler<'a> {
        let mut assembler = Assembler {
            encoder,
            leaf_size,
            open: Vec::new(),
            whole: None,
            levels: Vec::new(),
            above: Vec::new(),
            items: Vec::new(),
        };
        assembler.push(top);
        assembler
    }

    /// Returns the top node.
    pub(crate) fn top(&self) -> Code {
        self.open[0].code
    }

    fn push(&mut self, code: Code) {
        let none = || Statistics::none(self.encoder.block.columns);
        let (own, below) = (none(), none());
        self.open.push(Open {
            code,
            rows: Vec::new(),
            pending: Vec::new(),
            pending_rows: 0,
            blocks: Vec::new(),
            is_divided: false,
            own,
            below,
        });
    }

    /// Returns the maximum row bytes of a leaf.
    fn most(&self) -> usize {
        self.leaf_size * self.encoder.stride()
    }

    /// Advances to a point or node with this code, which must be inside the top node. Closes all
    /// nodes that do not contain it.
    #[inline]
    pub(crate) fn advance(&mut self, code: Code) {
        while self.open.len() > 1 && !self.open[self.open.len() - 1].code.contains(code) {
            let closed = self.close();
            self.take(closed);
        }
    }

    /// Opens the nodes on the path to the current code, from the top one down to a level.
    #[inline]
    fn open_to(&mut self, code: Code, level: u8) -> usize {
        let top = self.top().level();
        while usize::from(level - top) >= self.open.len() {
            let deeper = code.ancestor(top + self.open.len() as u8);
            self.push(deeper);
        }
        usize::from(level - top)
    }

    /// Adds a point's row to the node at a level on the path to the current code.
    #[inline]
    pub(crate) fn add(&mut self, code: Code, level: u8, row: &[u8]) {
        if level < self.top().level() {
            self.levels.push(level);
            self.above.extend_from_slice(row);
            return;
        }
        let index = self.open_to(code, level);
        self.open[index].rows.extend_from_slice(row);
        if self.open[index].rows.len() > self.most() {
            self.flush(index);
        }
    }

    /// Advances to a node that another assembler has made. The caller writes that node's output
    /// after the output collected here so far.
    pub(crate) fn reach(&mut self, code: Code, closed: &Closed) {
        self.advance(code);
        if code == self.top() {
            return;
        }
        let parent = self.open_to(code, code.level() - 1);
        if let Closed::Node(_) = closed {
            self.divide(parent);
        }
    }

    /// Adds the result of the node that was reached.
    pub(crate) fn join(&mut self, code: Code, assembled: Assembled) {
        let Assembled { closed, levels, above } = assembled;
        for (level, row) in levels.iter().zip(above.chunks_exact(self.encoder.stride())) {
            self.add(code, *level, row);
        }
        match code == self.top() {
            true => self.whole = Some(closed),
            false => self.take(closed),
        }
    }

    /// Encodes full blocks of a node that has more rows than a leaf.
    fn flush(&mut self, index: usize) {
        self.divide(index);
        let most = self.most();
        let mut rows = std::mem::take(&mut self.open[index].rows);
        let whole = rows.len() / most * most;
        for block in rows[..whole].chunks(most) {
            self.block(index, block);
        }
        rows.drain(..whole);
        self.open[index].rows = rows;
    }

    fn block(&mut self, index: usize, rows: &[u8]) {
        let block = self.encoder.encode(rows);
        let open = &mut self.open[index];
        open.own.add(&block.statistics);
        open.blocks.push(block);
        // A node of the deepest level may have any number of points but has no children, so its
        // blocks can come out at once. Other nodes have at most one point per sampling cell.
        if open.code.level() == self.encoder.grid.deepest() {
            self.hand_out(index);
        }
    }

    /// Outputs the blocks of a node.
    fn hand_out(&mut self, index: usize) {
        let Open { code, blocks, .. } = &mut self.open[index];
        let blocks = std::mem::take(blocks).into_iter();
        self.items.extend(blocks.map(|block| BuiltItem::Block(*code, block.bytes, block.statistics)));
    }

    /// Marks a node and its ancestors as divided. Their pending nodes become leaves.
    fn divide(&mut self, index: usize) {
        let undivided = self.open[..=index].iter().position(|open| !open.is_divided);
        for index in undivided.unwrap_or(index + 1)..=index {
            let open = &mut self.open[index];
            open.is_divided = true;
            open.pending_rows = 0;
            for pending in std::mem::take(&mut open.pending) {
                let statistics = leaf(self.encoder, pending, &mut self.items);
                self.open[index].below.add(&statistics);
            }
        }
    }

    /// Takes the result of a child of the deepest open node.
    fn take(&mut self, closed: Closed) {
        let index = self.open.len() - 1;
        let open = &mut self.open[index];
        match closed {
            Closed::Node(statistics) => {
                self.divide(index);
                self.open[index].below.add(&statistics);
            }
            Closed::Few(pending) if pending.rows.is_empty() => {}
            Closed::Few(pending) if open.is_divided => {
                let statistics = leaf(self.encoder, pending, &mut self.items);
                open.below.add(&statistics);
            }
            Closed::Few(pending) => {
                open.pending_rows += pending.rows.len();
                open.pending.push(pending);
                if open.pending_rows > self.leaf_size * self.encoder.stride() {
                    self.divide(index);
                }
            }
        }
    }

    /// Closes the deepest open node.
    fn close(&mut self) -> Closed {
        let index = self.open.len() - 1;
        if self.open[index].rows.len() + self.open[index].pending_rows > self.most() {
            self.divide(index);
        }
        if self.open[index].is_divided {
            let rows = std::mem::take(&mut self.open[index].rows);
            if !rows.is_empty() {
                self.block(index, &rows);
            }
            self.hand_out(index);
        }
        let mut open = self.open.pop().expect("it is there");
        if open.is_divided {
            open.own.add(&open.below);
            self.items.push(BuiltItem::Node(open.code, open.own.clone()));
            return Closed::Node(open.own);
        }
        for pending in open.pending {
            open.rows.extend_from_slice(&pending.rows);
        }
        Closed::Few(Pending { code: open.code, rows: open.rows })
    }

    /// Closes all nodes; returns the result of the top one, and the output.
    pub(crate) fn finish(mut self) -> (Assembled, Vec<BuiltItem>) {
        while self.open.len() > 1 {
            let closed = self.close();
            self.take(closed);
        }
        let closed = self.close();
        let closed = self.whole.unwrap_or(closed);
        (Assembled { closed, levels: self.levels, above: self.above }, self.items)
    }
}

/// Outputs a pending node as a leaf with one block; returns its statistics.
fn leaf(encoder: &Encoder, pending: Pending, items: &mut Vec<BuiltItem>) -> Statistics {
    let block = encoder.encode(&pending.rows);
    items.push(BuiltItem::Block(pending.code, block.bytes, block.statistics.clone()));
    items.push(BuiltItem::Node(pending.code, block.statistics.clone()));
    block.statistics
}

/// Writes the output to a sink.
pub(crate) fn write_items(items: Vec<BuiltItem>, sink: &mut dyn NodeSink) -> Result<()> {
    items.into_iter().try_for_each(|item| match item {
        BuiltItem::Block(code, bytes, statistics) => sink.block(code, &bytes, &statistics),
        BuiltItem::Node(code, statistics) => sink.node(code, &statistics),
    })
}

/// Writes the root unless it is already written: a leaf, or nothing if there are no points.
pub(crate) fn write_root(encoder: &Encoder, closed: Closed, sink: &mut dyn NodeSink) -> Result<()> {
    let mut items = Vec::new();
    if let Closed::Few(pending) = closed
        && !pending.rows.is_empty()
    {
        leaf(encoder, pending, &mut items);
    }
    write_items(items, sink)
}
