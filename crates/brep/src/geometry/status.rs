//! The sweep line's status: its edges in order, in blocks, so that insertion and removal move few
//! entries.

/// Maximum number of edges per block.
const MOST: usize = 512;

/// A position in the list: the index of a block, and an index in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    piece: usize,
    index: usize,
}

/// Edge numbers in sweep-line order; no block is empty.
#[derive(Default)]
pub(super) struct Status {
    pieces: Vec<Vec<u32>>,
}

impl Status {
    // Invariant: no block is empty, since removing its last edge removes the block. So a search can
    // skip a block by its last edge, and the edge before a block's first one is the previous
    // block's last one. Otherwise, `before` would find no edge below a vertex, and the inside would
    // be taken for the outside.
    /// Returns the position of the first edge without a property that all edges before it have.
    pub(super) fn first_not(&self, has: impl Fn(u32) -> bool) -> Place {
        let piece = self.pieces.partition_point(|piece| piece.last().is_some_and(|&edge| has(edge)));
        let index = self.pieces.get(piece).map_or(0, |piece| piece.partition_point(|&edge| has(edge)));
        Place { piece, index }
    }

    pub(super) fn get(&self, place: Place) -> Option<u32> {
        self.pieces.get(place.piece)?.get(place.index).copied()
    }

    /// Returns the edge before a position.
    pub(super) fn before(&self, Place { piece, index }: Place) -> Option<u32> {
        match (piece, index) {
            (0, 0) => None,
            (piece, 0) => self.pieces[piece - 1].last().copied(),
            (piece, index) => Some(self.pieces[piece][index - 1]),
        }
    }

    /// Removes the edge at a position, and returns the position of the next one.
    pub(super) fn remove(&mut self, Place { piece, index }: Place) -> Place {
        self.pieces[piece].remove(index);
        if self.pieces[piece].is_empty() {
            self.pieces.remove(piece);
            Place { piece, index: 0 }
        } else if index == self.pieces[piece].len() {
            Place { piece: piece + 1, index: 0 }
        } else {
            Place { piece, index }
        }
    }

    /// Inserts an edge before the one at a position, and returns its own position.
    pub(super) fn insert(&mut self, mut place: Place, edge: u32) -> Place {
        if place.piece == self.pieces.len() {
            match self.pieces.last() {
                Some(last) => place = Place { piece: place.piece - 1, index: last.len() },
                None => self.pieces.push(Vec::new()),
            }
        }
        let piece = &mut self.pieces[place.piece];
        piece.insert(place.index, edge);
        if piece.len() > MOST {
            let upper = piece.split_off(MOST / 2);
            if place.index >= MOST / 2 {
                place = Place { piece: place.piece + 1, index: place.index - MOST / 2 };
                self.pieces.insert(place.piece, upper);
            } else {
                self.pieces.insert(place.piece + 1, upper);
            }
        }
        place
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_is_kept_over_pieces() {
        let mut status = Status::default();
        // Numbers in a fixed permutation, each inserted in order.
        let count = 5003;
        for i in 0..count {
            let edge = i * 1009 % count;
            let place = status.first_not(|other| other < edge);
            assert!(status.before(place).is_none_or(|before| before < edge));
            let place = status.insert(place, edge);
            assert_eq!(status.get(place), Some(edge));
        }
        assert!(status.pieces.len() > 5);
        assert!(status.pieces.concat().into_iter().eq(0..count));
        // Each position leads to the next one.
        let mut place = status.first_not(|other| other < 7);
        for edge in 7..count {
            assert_eq!(status.get(place), Some(edge));
            place = status.remove(place);
        }
        assert_eq!((status.get(place), status.before(place)), (None, Some(6)));
    }
}
