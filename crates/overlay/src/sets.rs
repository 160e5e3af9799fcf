//! Sets of parts that a place is in, each once, and what crossing an edge makes of them.

use std::collections::HashMap;

use crate::edges::{PartLists, differences};

/// Sets of parts by their numbers; number 0 is the empty set. Most edges are crossed from one of few sets: what comes of that is kept, so that lists are
/// compared once for each pair.
pub(crate) struct PartSets {
    sets: PartLists,
    /// Of a set and a list of parts, the set on the other side of their edge.
    crossed: HashMap<(u32, u32), u32>,
}

impl PartSets {
    pub(crate) fn new() -> PartSets {
        let mut sets = PartLists::default();
        sets.number(&[]);
        PartSets { sets, crossed: HashMap::new() }
    }

    /// The set on the other side of an edge with some parts.
    pub(crate) fn across(&mut self, set: u32, parts: u32, lists: &PartLists) -> u32 {
        if let Some(other) = self.crossed.get(&(set, parts)) {
            return *other;
        }
        let other = self.sets.number(&differences(self.sets.list(set), lists.list(parts)));
        self.crossed.insert((set, parts), other);
        other
    }

    /// A set by its number: parts in ascending order.
    pub(crate) fn set(&self, number: u32) -> &[u32] {
        self.sets.list(number)
    }
}
