//! Interned sets of the parts that cover a region, and the set changes at edges.

use std::collections::HashMap;

use crate::edges::{PartLists, differences};

/// Sets of parts by number; number 0 is the empty set. Most edges border on one of few sets, so
/// the result for each pair of set and edge list is cached and lists are compared once per pair.
pub(crate) struct PartSets {
    sets: PartLists,
    /// Maps a set and an edge's list of parts to the set on the edge's other side.
    crossed: HashMap<(u32, u32), u32>,
}

impl PartSets {
    pub(crate) fn new() -> PartSets {
        let mut sets = PartLists::default();
        sets.number(&[]);
        PartSets { sets, crossed: HashMap::new() }
    }

    /// Returns the set on the other side of an edge that bounds `parts`.
    pub(crate) fn across(&mut self, set: u32, parts: u32, lists: &PartLists) -> u32 {
        if let Some(other) = self.crossed.get(&(set, parts)) {
            return *other;
        }
        let other = self.sets.number(&differences(self.sets.list(set), lists.list(parts)));
        self.crossed.insert((set, parts), other);
        other
    }

    /// Returns the set with a number: parts in ascending order.
    pub(crate) fn set(&self, number: u32) -> &[u32] {
        self.sets.list(number)
    }
}
