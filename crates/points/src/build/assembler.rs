//! Nodes of points that come in the order of their codes.
//!
//! In that order, all points of a node come one after the other, and so do those of each of the squares or cubes of which a node may have one
//! point. So a point is the first in its own if the point before is not in it: how deep the two are together tells the coarsest node that
//! has room for the point.
//!
//! Parts come out in one order, however many assemblers share the work: nodes as they end, each behind all nodes below it, and a node's blocks right before
//! the node. So a node's own blocks wait until it ends, and what was handed up comes out before anything that is behind it.

use super::PieceSink;
use super::encoder::{EncodedBlock, Encoder};
use crate::grid::spacing_levels;
use crate::statistics::Statistics;
use spinney_base::Result;
use spinney_base::space::Code;

/// A part of a tree that comes out: a block or a node.
pub(crate) enum BuiltPiece {
    /// A block of a node. Those of one node come in order.
    Block(Code, Vec<u8>, Statistics),
    /// A node, with all points in it and below.
    Node(Code, Statistics),
}

/// A node that may be handed up: it has few points, and none below.
pub(crate) struct Pending {
    pub code: Code,
    pub rows: Vec<u8>,
}

/// The outcome of a node.
pub(crate) enum Closed {
    /// So few points that a node above may take them.
    Few(Pending),
    /// A node of its own, with what is known of all points in it.
    Node(Statistics),
}

/// A node whose points are still coming.
struct Open {
    code: Code,
    /// Rows of its own that are in no block yet.
    rows: Vec<u8>,
    /// Nodes below that were handed up.
    pending: Vec<Pending>,
    /// Rows of those.
    pending_rows: usize,
    /// Blocks of its own, which come out behind all that is below.
    blocks: Vec<EncodedBlock>,
    /// Whether there are too many points for it to be a leaf.
    // Invariant: where a node is divided, all above it are.
    is_divided: bool,
    /// Statistics of its blocks, and of nodes below: apart, so that they add up in the same order however the points were divided.
    own: Statistics,
    below: Statistics,
}

/// A node that was assembled elsewhere.
pub(crate) struct Assembled {
    pub closed: Closed,
    /// Rows of nodes above it: the level of each, and the rows, in the order of their codes.
    pub levels: Vec<u8>,
    pub above: Vec<u8>,
}

/// Makes nodes of points in the order of their codes.
pub(crate) struct Assembler<'a> {
    encoder: &'a Encoder,
    /// Points of a block at most, and of a node that has no other below.
    leaf_size: usize,
    open: Vec<Open>,
    /// Outcome of the top node, if that was assembled elsewhere.
    whole: Option<Closed>,
    /// Rows of nodes above the top one, with their levels.
    levels: Vec<u8>,
    above: Vec<u8>,
    /// The parts that came out.
    pub(crate) pieces: Vec<BuiltPiece>,
}

/// Level of the node of a point whose code is the same as the point's before down to a level; `None` of the first point.
pub(crate) fn node_level(encoder: &Encoder, same: Option<u8>) -> u8 {
    let grid = &encoder.grid;
    let first = same.map_or(0, |same| (same + 1).saturating_sub(spacing_levels(grid.dimension)));
    first.min(grid.deepest())
}

impl<'a> Assembler<'a> {
    /// An assembler of the subtree of a node.
    pub(crate) fn new(encoder: &'a Encoder, leaf_size: usize, top: Code) -> Assembler<'a> {
        let mut assembler = Assembler {
            encoder,
            leaf_size,
            open: Vec::new(),
            whole: None,
            levels: Vec::new(),
            above: Vec::new(),
            pieces: Vec::new(),
        };
        assembler.push(top);
        assembler
    }

    /// The top node.
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

    /// Bytes of the rows of a leaf.
    fn most(&self) -> usize {
        self.leaf_size * self.encoder.stride()
    }

    /// Goes on to a point or node with this code, which must be in the top node: nodes that do not have it are complete.
    #[inline]
    pub(crate) fn advance(&mut self, code: Code) {
        while self.open.len() > 1 && !self.open[self.open.len() - 1].code.contains(code) {
            let closed = self.close();
            self.take(closed);
        }
    }

    /// Opens the nodes on the way to a code that was gone on to, from the top one down to a level.
    #[inline]
    fn open_to(&mut self, code: Code, level: u8) -> usize {
        let top = self.top().level();
        while usize::from(level - top) >= self.open.len() {
            let deeper = code.ancestor(top + self.open.len() as u8);
            self.push(deeper);
        }
        usize::from(level - top)
    }

    /// Adds the row of a point of a node at a level, on the way to the code that was gone on to.
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

    /// Goes on to a node that was assembled elsewhere. What came out of it comes behind what has come out here when this returns.
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

    /// Takes in the node that was reached.
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

    /// Makes blocks of the rows of a node beyond those of a leaf: whole ones.
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
        // (Nodes of the deepest level may have any number of points, and none below; others have one for each part of their space at most.)
        if open.code.level() == self.encoder.grid.deepest() {
            self.hand_out(index);
        }
    }

    /// Lets the blocks of a node come out.
    fn hand_out(&mut self, index: usize) {
        let Open { code, blocks, .. } = &mut self.open[index];
        let blocks = std::mem::take(blocks).into_iter();
        self.pieces.extend(blocks.map(|block| BuiltPiece::Block(*code, block.bytes, block.statistics)));
    }

    /// Says that a node has nodes below, or more points than a leaf: nodes below that were handed up to it, or to one above, are among them.
    fn divide(&mut self, index: usize) {
        let undivided = self.open[..=index].iter().position(|open| !open.is_divided);
        for index in undivided.unwrap_or(index + 1)..=index {
            let open = &mut self.open[index];
            open.is_divided = true;
            open.pending_rows = 0;
            for pending in std::mem::take(&mut open.pending) {
                let statistics = leaf(self.encoder, pending, &mut self.pieces);
                self.open[index].below.add(&statistics);
            }
        }
    }

    /// Takes what became of a child of the deepest open node.
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
                let statistics = leaf(self.encoder, pending, &mut self.pieces);
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
            self.pieces.push(BuiltPiece::Node(open.code, open.own.clone()));
            return Closed::Node(open.own);
        }
        for pending in open.pending {
            open.rows.extend_from_slice(&pending.rows);
        }
        Closed::Few(Pending { code: open.code, rows: open.rows })
    }

    /// Closes all nodes; hands out what became of the top one, and what came out.
    pub(crate) fn finish(mut self) -> (Assembled, Vec<BuiltPiece>) {
        while self.open.len() > 1 {
            let closed = self.close();
            self.take(closed);
        }
        let closed = self.close();
        let closed = self.whole.unwrap_or(closed);
        (Assembled { closed, levels: self.levels, above: self.above }, self.pieces)
    }
}

/// Makes a node with one block of a node that was handed up; returns what is known of its points.
fn leaf(encoder: &Encoder, pending: Pending, pieces: &mut Vec<BuiltPiece>) -> Statistics {
    let block = encoder.encode(&pending.rows);
    pieces.push(BuiltPiece::Block(pending.code, block.bytes, block.statistics.clone()));
    pieces.push(BuiltPiece::Node(pending.code, block.statistics.clone()));
    block.statistics
}

/// Writes what came out.
pub(crate) fn write_pieces(pieces: Vec<BuiltPiece>, sink: &mut dyn PieceSink) -> Result<()> {
    pieces.into_iter().try_for_each(|piece| match piece {
        BuiltPiece::Block(code, bytes, statistics) => sink.block(code, &bytes, &statistics),
        BuiltPiece::Node(code, statistics) => sink.node(code, &statistics),
    })
}

/// Writes what became of the root, unless it has come out by itself: a leaf, or nothing if there are no points.
pub(crate) fn write_root(encoder: &Encoder, closed: Closed, sink: &mut dyn PieceSink) -> Result<()> {
    let mut pieces = Vec::new();
    if let Closed::Few(pending) = closed
        && !pending.rows.is_empty()
    {
        leaf(encoder, pending, &mut pieces);
    }
    write_pieces(pieces, sink)
}
