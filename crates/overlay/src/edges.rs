//! Edges, each once, with the parts that it is an edge of.
//!
//! A point is in a part if a ray from it crosses an odd number of the part's edges. So an edge that a part has twice is none of it, and what an edge
//! means is which parts one enters or leaves by crossing it, in either direction.

use std::collections::HashMap;

use crate::exact::Point;

/// Ends of an edge, the left one first (the lower one of those above each other).
pub(crate) type Ends<P> = [P; 2];

/// Lists of parts, each once, in ascending order.
#[derive(Default)]
pub(crate) struct PartLists {
    lists: Vec<Box<[u32]>>,
    numbers: HashMap<Box<[u32]>, u32>,
}

impl PartLists {
    /// The number of a list.
    pub(crate) fn number(&mut self, list: &[u32]) -> u32 {
        if let Some(number) = self.numbers.get(list) {
            return *number;
        }
        let number = self.lists.len() as u32;
        self.lists.push(list.into());
        self.numbers.insert(list.into(), number);
        number
    }

    /// A list by its number.
    pub(crate) fn list(&self, number: u32) -> &[u32] {
        &self.lists[number as usize]
    }

    /// The number of what is in one of two lists, but not in both.
    pub(crate) fn in_one(&mut self, first: u32, second: u32) -> u32 {
        let joined = differences(self.list(first), self.list(second));
        self.number(&joined)
    }
}

/// Numbers that are in one of two ascending lists, but not in both.
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

/// An edge, and the number of the list of its parts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge<P> {
    pub(crate) ends: Ends<P>,
    pub(crate) parts: u32,
}

/// Joins edges between the same ends, which are sorted; those that are of no part in the end go.
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

/// Edges between any points, each once, in the order of their ends.
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

/// Edges between middles of cells, each once, in the order of their ends.
pub(crate) fn unite_cells(
    mut edges: Vec<Edge<crate::exact::Cell>>,
    lists: &mut PartLists,
) -> Vec<Edge<crate::exact::Cell>> {
    edges.sort_unstable_by_key(|edge| (edge.ends, edge.parts));
    joined(edges, lists)
}
