//! Edges that a sweep's line cuts, in order: a list in pieces, so that putting in and taking out move little.

/// Most edges of a piece.
const MOST: usize = 512;

/// A place in the list: the number of a piece, and a place in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    piece: usize,
    index: usize,
}

/// Numbers of edges in the order in which they are put in; there is no empty piece.
#[derive(Default)]
pub(super) struct Status {
    pieces: Vec<Vec<u32>>,
}

impl Status {
    // Invariant: no piece is empty, since the last edge of one takes it away. So the last edge of a piece
    // tells whether a search has to go on, and the edge before the first of a piece is the last of the piece
    // before. Else `before` would find no edge below a corner, and what is inside would seem to be
    // outside.
    /// The place of the first edge without a property that those before it have.
    pub(super) fn first_not(&self, has: impl Fn(u32) -> bool) -> Place {
        let piece = self.pieces.partition_point(|piece| piece.last().is_some_and(|&edge| has(edge)));
        let index = self.pieces.get(piece).map_or(0, |piece| piece.partition_point(|&edge| has(edge)));
        Place { piece, index }
    }

    pub(super) fn get(&self, place: Place) -> Option<u32> {
        self.pieces.get(place.piece)?.get(place.index).copied()
    }

    /// The edge before a place.
    pub(super) fn before(&self, Place { piece, index }: Place) -> Option<u32> {
        match (piece, index) {
            (0, 0) => None,
            (piece, 0) => self.pieces[piece - 1].last().copied(),
            (piece, index) => Some(self.pieces[piece][index - 1]),
        }
    }

    /// Takes out the edge at a place, and gives that of the next one.
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

    /// Puts an edge before the one at a place, and gives its own place.
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
        // Numbers by a fixed permutation, each to its place.
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
        // Every place leads to the next one.
        let mut place = status.first_not(|other| other < 7);
        for edge in 7..count {
            assert_eq!(status.get(place), Some(edge));
            place = status.remove(place);
        }
        assert_eq!((status.get(place), status.before(place)), (None, Some(6)));
    }
}
