//! Which values of one tree meet which of another: change matrices.

use std::cmp::Ordering;

use smallvec::SmallVec;

use crate::space::Dimension;
use crate::tree::{Child, Source};
use crate::value::Value;
use crate::{Error, Result};

/// Cells in which a value of the first tree (`None` is VOID) meets one of the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair<V> {
    /// The first tree's value.
    pub first: Option<V>,
    /// The second tree's.
    pub second: Option<V>,
    /// In so many cells.
    pub cells: u64,
}

/// Pairs that a table may have: elevations have no sensible table.
const MOST: usize = 1 << 16;

/// Counts all pairs of values but that of VOID with VOID, by ascending first, then second value; VOID comes first. Time is
/// proportional to the nodes of both trees.
///
/// # Errors
/// If depths differ, there are more than 2^16 pairs, or a source fails.
pub fn cross<A, B>(first: &A, second: &B) -> Result<Vec<Pair<A::Value>>>
where
    A: Source,
    B: Source<Dim = A::Dim, Value = A::Value>,
{
    if first.depth() != second.depth() {
        let expected = format!("{}, as the first tree has", first.depth());
        return Err(Error::invalid("depth of a tree", second.depth().to_string(), expected));
    }
    let mut pairs: Vec<Pair<A::Value>> = Vec::new();
    let mut last = 0;
    let mut pending = vec![(first.depth(), first.root()?, second.root()?)];
    while let Some((height, a, b)) = pending.pop() {
        if height == 0 || !(a.is_inner() || b.is_inner()) {
            let (a, b) = (a.value(), b.value());
            if a.is_none() && b.is_none() {
                continue;
            }
            let cells = 1u64 << (<A::Dim as Dimension>::AXES * height as usize);
            let order = |pair: &Pair<A::Value>| by_value(pair.first, a).then(by_value(pair.second, b));
            if !pairs.get(last).is_some_and(|pair| order(pair).is_eq()) {
                last = match pairs.binary_search_by(order) {
                    Ok(place) => place,
                    Err(_) if pairs.len() == MOST => {
                        let found = format!("more than {MOST}");
                        return Err(Error::invalid(
                            "pairs of values",
                            found,
                            "classes, of which there are few",
                        ));
                    }
                    Err(place) => {
                        pairs.insert(place, Pair { first: a, second: b, cells: 0 });
                        place
                    }
                };
            }
            pairs[last].cells += cells;
            continue;
        }
        let below = (below(first, a)?, below(second, b)?);
        pending.extend(below.0.into_iter().zip(below.1).map(|(a, b)| (height - 1, a, b)));
    }
    Ok(pairs)
}

fn by_value<V: Value>(a: Option<V>, b: Option<V>) -> Ordering {
    match (a, b) {
        (Some(a), Some(b)) => a.order(b),
        _ => a.is_some().cmp(&b.is_some()),
    }
}

type Children<S> = SmallVec<[Child<<S as Source>::Value, <S as Source>::Node>; 8]>;

/// The children of a place; those of a uniform one are like it.
fn below<S: Source>(source: &S, place: Child<S::Value, S::Node>) -> Result<Children<S>> {
    Ok(match place {
        Child::Inner { node, .. } => source.children(&node)?.into_iter().collect(),
        uniform => std::iter::repeat_n(uniform, S::Dim::CHILDREN).collect(),
    })
}
