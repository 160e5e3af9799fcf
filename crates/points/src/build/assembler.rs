//! Nodes of points that come in the order of their codes.
//!
//! In that order, all points of a node come one after the other, and so do those of each of the squares or cubes of which a node may have one
//! point. So a point is the first in its own if the point before is not in it: how deep the two are together tells the coarsest node that
//! has room for the point.

use super::encoder::Encoder;
use crate::grid::spacing_levels;
use crate::statistics::Statistics;
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
    /// Whether there are too many points for it to be a leaf.
    is_divided: bool,
    /// Statistics of its blocks, and of nodes below: apart, so that they add up in the same order however the points were divided.
    own: Statistics,
    below: Statistics,
}

/// Makes nodes of points in the order of their codes.
pub(crate) struct Assembler<'a> {
    encoder: &'a Encoder,
    /// Points of a block at most, and of a node that has no other below.
    leaf_size: usize,
    open: Vec<Open>,
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
        let mut assembler = Assembler { encoder, leaf_size, open: Vec::new(), pieces: Vec::new() };
        assembler.push(top);
        assembler
    }

    fn push(&mut self, code: Code) {
        let none = || Statistics::none(self.encoder.block.columns);
        let (own, below) = (none(), none());
        self.open.push(Open {
            code,
            rows: Vec::new(),
            pending: Vec::new(),
            pending_rows: 0,
            is_divided: false,
            own,
            below,
        });
    }

    /// Goes on to a point or node with this code, which must be in the top node: nodes that do not have it are complete.
    #[inline]
    pub(crate) fn advance(&mut self, code: Code) {
        while self.open.len() > 1 && !self.open[self.open.len() - 1].code.contains(code) {
            let closed = self.close();
            self.take(closed);
        }
    }

    /// Adds rows of points of a node at a level, on the way to the code that was gone on to.
    #[inline]
    pub(crate) fn add(&mut self, code: Code, level: u8, rows: &[u8]) {
        let top = self.open[0].code.level();
        while usize::from(level - top) >= self.open.len() {
            let deeper = code.ancestor(top + self.open.len() as u8);
            self.push(deeper);
        }
        let index = usize::from(level - top);
        self.open[index].rows.extend_from_slice(rows);
        if self.open[index].rows.len() > self.leaf_size * self.encoder.stride() {
            self.flush(index);
        }
    }

    /// Takes in a node that was assembled elsewhere, which lies in the one that was gone on to.
    pub(crate) fn add_node(&mut self, code: Code, closed: Closed) {
        let top = self.open[0].code.level();
        while usize::from(code.level() - top) > self.open.len() {
            let deeper = code.ancestor(top + self.open.len() as u8);
            self.push(deeper);
        }
        self.take(closed);
    }

    /// Makes blocks of the rows of a node beyond those of a leaf: whole ones.
    fn flush(&mut self, index: usize) {
        self.divide(index);
        let most = self.leaf_size * self.encoder.stride();
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
        self.open[index].own.add(&block.statistics);
        self.pieces.push(BuiltPiece::Block(self.open[index].code, block.bytes, block.statistics));
    }

    /// Says that a node has nodes below: those that were handed up to it are among them.
    fn divide(&mut self, index: usize) {
        let open = &mut self.open[index];
        open.is_divided = true;
        open.pending_rows = 0;
        for pending in std::mem::take(&mut open.pending) {
            let statistics = leaf(self.encoder, pending, &mut self.pieces);
            self.open[index].below.add(&statistics);
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
        let most = self.leaf_size * self.encoder.stride();
        if self.open[index].rows.len() + self.open[index].pending_rows > most {
            self.divide(index);
        }
        if self.open[index].is_divided {
            let rows = std::mem::take(&mut self.open[index].rows);
            if !rows.is_empty() {
                self.block(index, &rows);
            }
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
    pub(crate) fn finish(mut self) -> (Closed, Vec<BuiltPiece>) {
        while self.open.len() > 1 {
            let closed = self.close();
            self.take(closed);
        }
        (self.close(), self.pieces)
    }
}

/// Makes a node with one block of a node that was handed up; returns what is known of its points.
pub(crate) fn leaf(encoder: &Encoder, pending: Pending, pieces: &mut Vec<BuiltPiece>) -> Statistics {
    let block = encoder.encode(&pending.rows);
    pieces.push(BuiltPiece::Block(pending.code, block.bytes, block.statistics.clone()));
    pieces.push(BuiltPiece::Node(pending.code, block.statistics.clone()));
    block.statistics
}
