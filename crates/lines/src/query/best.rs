//! The nearest pieces so far, one of each feature.

use std::collections::{BTreeSet, HashMap};

use crate::codec::Piece;

/// So many features are kept in one list.
const FEW: usize = 16;

/// The nearest piece of each of the best features so far: by the square of its distance, of those that are equally far by feature.
pub(super) struct Best {
    most: usize,
    limit: f64,
    found: Found,
}

enum Found {
    /// In order.
    Few(Vec<(f64, Piece)>),
    Many {
        pieces: HashMap<u64, (f64, Piece)>,
        /// Squares, as bits, which are in the same order, and features.
        order: BTreeSet<(u64, u64)>,
    },
}

impl Best {
    /// The pieces of at most so many features, the squares of whose distances are no more than the limit.
    pub(super) fn new(most: usize, limit: f64) -> Best {
        let found = match most <= FEW {
            true => Found::Few(Vec::with_capacity(most)),
            false => Found::Many { pieces: HashMap::new(), order: BTreeSet::new() },
        };
        Best { most, limit, found }
    }

    /// The square of the distance that better pieces have at most.
    #[inline]
    pub(super) fn limit(&self) -> f64 {
        self.limit
    }

    /// Keeps a piece if it is one of the best.
    #[inline]
    pub(super) fn look(&mut self, square: f64, piece: &Piece) {
        if square <= self.limit {
            self.add(square, piece);
        }
    }

    /// Keeps those of equal pieces, which are by feature and place, that are among the best.
    #[inline]
    pub(super) fn look_at_equal(&mut self, square: f64, equal: &[Piece]) {
        let mut features = 0;
        let mut before = None;
        for piece in equal {
            // (Those of features behind these are no better, nor are later ones of the same feature.)
            features += usize::from(before != Some(piece.feature));
            if features > self.most {
                break;
            }
            if before != Some(piece.feature) {
                self.look(square, piece);
            }
            before = Some(piece.feature);
        }
    }

    fn add(&mut self, square: f64, piece: &Piece) {
        let is_better = |(before, old): (f64, Piece)| (square, piece.place) < (before, old.place);
        let farthest = match &mut self.found {
            Found::Few(found) => {
                if let Some(known) = found.iter().position(|(_, known)| known.feature == piece.feature) {
                    if !is_better(found[known]) {
                        return;
                    }
                    found.remove(known);
                }
                let place =
                    found.partition_point(|(other, known)| (*other, known.feature) < (square, piece.feature));
                if place < self.most {
                    found.truncate(self.most - 1);
                    found.insert(place, (square, *piece));
                }
                found.get(self.most - 1).map(|(square, _)| *square)
            }
            Found::Many { pieces, order } => {
                if let Some(known) = pieces.get(&piece.feature).copied() {
                    if !is_better(known) {
                        return;
                    }
                    order.remove(&(known.0.to_bits(), piece.feature));
                }
                pieces.insert(piece.feature, (square, *piece));
                order.insert((square.to_bits(), piece.feature));
                if order.len() > self.most
                    && let Some((_, feature)) = order.pop_last()
                {
                    pieces.remove(&feature);
                }
                order.last().filter(|_| order.len() == self.most).map(|(bits, _)| f64::from_bits(*bits))
            }
        };
        self.limit = farthest.map_or(self.limit, |farthest| self.limit.min(farthest));
    }

    /// The pieces, the nearest first.
    pub(super) fn finish(self) -> Vec<(f64, Piece)> {
        match self.found {
            Found::Few(found) => found,
            Found::Many { pieces, order } => {
                order.into_iter().filter_map(|(_, feature)| pieces.get(&feature).copied()).collect()
            }
        }
    }
}
