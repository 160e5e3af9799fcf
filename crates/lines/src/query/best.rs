//! Bounded set of the nearest segments so far, one per feature.

use std::collections::{BTreeSet, HashMap};

use crate::codec::LineSegment;

/// Maximum number of features that are stored in a sorted list.
const FEW: usize = 16;

/// Nearest segment of each of the nearest features so far, sorted by squared distance, then by
/// feature.
pub(super) struct Best {
    most: usize,
    limit: f64,
    found: Found,
}

enum Found {
    /// Sorted.
    Few(Vec<(f64, LineSegment)>),
    Many {
        segments: HashMap<u64, (f64, LineSegment)>,
        /// Bits of the squared distances, which sort like the numbers, and features.
        order: BTreeSet<(u64, u64)>,
    },
}

impl Best {
    /// Creates the set for at most `most` features, whose squared distances are at most `limit`.
    pub(super) fn new(most: usize, limit: f64) -> Best {
        let found = match most <= FEW {
            true => Found::Few(Vec::with_capacity(most)),
            false => Found::Many { segments: HashMap::new(), order: BTreeSet::new() },
        };
        Best { most, limit, found }
    }

    /// Maximum squared distance of segments that can still enter the set.
    #[inline]
    pub(super) fn limit(&self) -> f64 {
        self.limit
    }

    /// Adds a segment if it is among the nearest.
    #[inline]
    pub(super) fn offer(&mut self, square: f64, segment: &LineSegment) {
        if square <= self.limit {
            self.add(square, segment);
        }
    }

    /// Adds those of equal segments, sorted by feature and vertex, that are among the nearest.
    #[inline]
    pub(super) fn offer_equal(&mut self, square: f64, equal: &[LineSegment]) {
        let mut features = 0;
        let mut before = None;
        for segment in equal {
            // Only the first segment of each of the first `most` features can enter the set.
            features += usize::from(before != Some(segment.feature));
            if features > self.most {
                break;
            }
            if before != Some(segment.feature) {
                self.offer(square, segment);
            }
            before = Some(segment.feature);
        }
    }

    fn add(&mut self, square: f64, segment: &LineSegment) {
        let is_better = |(before, old): (f64, LineSegment)| (square, segment.vertex) < (before, old.vertex);
        let farthest = match &mut self.found {
            Found::Few(found) => {
                if let Some(known) = found.iter().position(|(_, known)| known.feature == segment.feature) {
                    if !is_better(found[known]) {
                        return;
                    }
                    found.remove(known);
                }
                let index = found
                    .partition_point(|(other, known)| (*other, known.feature) < (square, segment.feature));
                if index < self.most {
                    found.truncate(self.most - 1);
                    found.insert(index, (square, *segment));
                }
                found.get(self.most - 1).map(|(square, _)| *square)
            }
            Found::Many { segments, order } => {
                if let Some(known) = segments.get(&segment.feature).copied() {
                    if !is_better(known) {
                        return;
                    }
                    order.remove(&(known.0.to_bits(), segment.feature));
                }
                segments.insert(segment.feature, (square, *segment));
                order.insert((square.to_bits(), segment.feature));
                if order.len() > self.most
                    && let Some((_, feature)) = order.pop_last()
                {
                    segments.remove(&feature);
                }
                order.last().filter(|_| order.len() == self.most).map(|(bits, _)| f64::from_bits(*bits))
            }
        };
        self.limit = farthest.map_or(self.limit, |farthest| self.limit.min(farthest));
    }

    /// Segments in the set, nearest first.
    pub(super) fn finish(self) -> Vec<(f64, LineSegment)> {
        match self.found {
            Found::Few(found) => found,
            Found::Many { segments, order } => {
                order.into_iter().filter_map(|(_, feature)| segments.get(&feature).copied()).collect()
            }
        }
    }
}
