//! Edges, each stored once, with the parts that it bounds.
//!
//! A point is in a part if a ray from it crosses an odd number of the part's edges. So an edge that
//! occurs twice in a part cancels out. An edge is defined by the parts that are entered or left
//! where it is crossed, in either direction.

use std::collections::HashMap;

use crate::exact::Point;

/// Ends of an edge, the left one first; of a vertical edge, the lower one first.
pub(crate) type Ends<P> = [P; 2];

/// Interned lists of part numbers in ascending order.
#[derive(Default)]
pub(crate) struct PartLists {
    lists: Vec<Box<[u32]>>,
    numbers: HashMap<Box<[u32]>, u32>,
}

impl PartLists {
    /// Returns the number of a list and interns it if it is new.
    pub(crate) fn number(&mut self, list: &[u32]) -> u32 {
        if let Some(number) = self.numbers.get(list) {
            return *number;
        }
        let number = self.lists.len() as u32;
        self.lists.push(list.into());
        self.numbers.insert(list.into(), number);
        number
    }

    /// Returns the list with a number.
    pub(crate) fn list(&self, number: u32) -> &[u32] {
        &self.lists[number as usize]
    }

    /// Returns the number of the symmetric difference of two lists.
    pub(crate) fn in_one(&mut self, first: u32, second: u32) -> u32 {
        let joined = differences(self.list(first), self.list(second));
        self.number(&joined)
    }
}

/// Returns the symmetric difference of two ascending lists.
pub(crate) fn differences(mut first: &[u32], mut second: &[u32]) -> Vec<u32> {
    let mut joined = Vec::with_capacity(first.len() + second.len());
    while let ([one, first_rest @ ..], [other, second_rest @ ..]) = (first, second) {
        if one <= other {
            first = first_rest;
        }
        if other <= one {
            second = second_rest;
        }
        if one != other {
            joined.push(*one.min(other));
        }
    }
    joined.extend_from_slice(first);
    joined.extend_from_slice(second);
    joined
}

/// An edge, and the number of the list of parts that it bounds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge<P> {
    pub(crate) ends: Ends<P>,
    pub(crate) parts: u32,
}

/// Merges sorted edges that have the same ends. Drops edges that bound no part after merging.
fn joined<P: Copy + PartialEq>(sorted: Vec<Edge<P>>, lists: &mut PartLists) -> Vec<Edge<P>> {
    let mut edges: Vec<Edge<P>> = Vec::with_capacity(sorted.len());
    for edge in sorted {
        match edges.last_mut() {
            Some(last) if last.ends == edge.ends => last.parts = lists.in_one(last.parts, edge.parts),
            _ => {
                if edges.last().is_some_and(|last| lists.list(last.parts).is_empty()) {
                    edges.pop();
                }
                edges.push(edge);
            }
        }
    }
    if edges.last().is_some_and(|last| lists.list(last.parts).is_empty()) {
        edges.pop();
    }
    edges
}

/// Merges edges between arbitrary points. Returns each once, ordered by its ends.
pub(crate) fn unite(mut edges: Vec<Edge<Point>>, lists: &mut PartLists) -> Vec<Edge<Point>> {
    edges.sort_unstable_by(|one, other| {
        let numbers =
            |edge: &Edge<Point>| [edge.ends[0][0], edge.ends[0][1], edge.ends[1][0], edge.ends[1][1]];
        let pairs = numbers(one).into_iter().zip(numbers(other));
        let by_ends = pairs.map(|(one, other)| one.total_cmp(&other)).find(|order| order.is_ne());
        by_ends.unwrap_or_else(|| one.parts.cmp(&other.parts))
    });
    joined(edges, lists)
}

/// Merges edges between cell centres. Returns each once, ordered by its ends.
pub(crate) fn unite_cells(
    mut edges: Vec<Edge<crate::exact::Cell>>,
    lists: &mut PartLists,
) -> Vec<Edge<crate::exact::Cell>> {
    edges.sort_unstable_by_key(|edge| (edge.ends, edge.parts));
    joined(edges, lists)
}
