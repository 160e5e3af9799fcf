//! The sweep: over all edges from left to right, which tells what is on both sides of each, and which sides are of the same face.
//!
//! Edges have no point in common but ends, so that at any place of the sweep they stand above each other in one order.

use std::cmp::Ordering;
use std::collections::BTreeSet;

use crate::edges::{Edge, PartLists};
use crate::exact::{Cell, turn};
use crate::sets::PartSets;
use spinney_base::{Progress, Result};

/// An edge that the sweep is at.
#[derive(Clone, Copy)]
struct Active {
    ends: [Cell; 2],
    number: u32,
}

impl Ord for Active {
    /// Below or above: by the side on which one begins, or ends if they begin together.
    fn cmp(&self, other: &Active) -> Ordering {
        let ([a, b], [c, d]) = (self.ends, other.ends);
        if self.ends == other.ends {
            return Ordering::Equal;
        }
        let side = if a <= c {
            // The other begins later, on one side of this.
            match turn(a, b, c) {
                0 => turn(a, b, d),
                side => side,
            }
        } else {
            match turn(c, d, a) {
                0 => -turn(c, d, b),
                side => -side,
            }
        };
        0.cmp(&side).then_with(|| self.ends.cmp(&other.ends))
    }
}

impl PartialOrd for Active {
    fn partial_cmp(&self, other: &Active) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Active {
    fn eq(&self, other: &Active) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Active {}

/// The sets of parts below and above an edge (on the right and on the left of its way from the left end to the other).
pub(crate) type Sides = [u32; 2];

/// Points from one look at whether the work is to go on to the next.
const POINTS_BETWEEN_LOOKS: u64 = 1 << 16;

/// Sides and faces of all edges.
pub(crate) struct Swept {
    /// Sides of each edge.
    pub(crate) sides: Vec<Sides>,
    /// Of both sides of each edge, one after the other, the face: sides with the same number lie in one.
    pub(crate) faces: Vec<u32>,
}

/// Goes over edges in the order of their ends.
///
/// `is_border` says whether an edge between two sets divides anything: faces go on across all others.
///
/// # Errors
/// On interruption.
pub(crate) fn sweep(
    edges: &[Edge<Cell>],
    lists: &PartLists,
    sets: &mut PartSets,
    progress: &dyn Progress,
    is_border: &mut dyn FnMut(&PartSets, Sides) -> bool,
) -> Result<Swept> {
    let mut sides: Vec<Sides> = vec![[0; 2]; edges.len()];
    // The two sides of each edge; the last one is the outside of all.
    let mut faces = Faces { above: (0..2 * edges.len() as u32 + 1).collect() };
    let outside = 2 * edges.len() as u32;
    let mut active: BTreeSet<Active> = BTreeSet::new();
    // Edges by their right ends.
    let mut ending: Vec<u32> = (0..edges.len() as u32).collect();
    ending.sort_unstable_by_key(|number| (edges[*number as usize].ends[1], *number));
    let key = |number: u32| Active { ends: edges[number as usize].ends, number };
    let (mut next_start, mut next_end) = (0, 0);
    let (mut starts, mut ends) = (Vec::new(), Vec::new());
    let mut points = 0u64;
    while next_end < ending.len() {
        points += 1;
        if points.is_multiple_of(POINTS_BETWEEN_LOOKS) {
            progress.check()?;
        }
        let end_point = edges[ending[next_end] as usize].ends[1];
        let point = match edges.get(next_start) {
            Some(edge) => edge.ends[0].min(end_point),
            None => end_point,
        };
        ends.clear();
        while next_end < ending.len() && edges[ending[next_end] as usize].ends[1] == point {
            ends.push(key(ending[next_end]));
            next_end += 1;
        }
        starts.clear();
        while next_start < edges.len() && edges[next_start].ends[0] == point {
            starts.push(key(next_start as u32));
            next_start += 1;
        }
        // Both from below upwards.
        ends.sort_unstable();
        starts.sort_unstable();
        // Invariant: each sector between neighbouring edges around the point lies in one face, and both edges see it; sectors open to the left and to the right are one below all
        // edges, and one above. So uniting these pairs of sides at every point unites exactly the sides of each face's borders, and those of holes with what is around them.
        for pair in ends.windows(2).chain(starts.windows(2)) {
            faces.unite(2 * pair[0].number + 1, 2 * pair[1].number);
        }
        let below = |edge: &Active| 2 * edge.number;
        let above = |edge: &Active| 2 * edge.number + 1;
        // The set below all that begins here.
        let mut set = match (ends.first(), ends.last()) {
            (Some(first), Some(last)) => {
                if let (Some(lowest), Some(highest)) = (starts.first(), starts.last()) {
                    faces.unite(below(first), below(lowest));
                    faces.unite(above(last), above(highest));
                } else {
                    faces.unite(below(first), above(last));
                }
                sides[first.number as usize][0]
            }
            _ => {
                let lower = starts.first().and_then(|lowest| active.range(..*lowest).next_back());
                let (set, side) =
                    lower.map_or((0, outside), |edge| (sides[edge.number as usize][1], above(edge)));
                for edge in starts.first().map(below).into_iter().chain(starts.last().map(above)) {
                    faces.unite(side, edge);
                }
                set
            }
        };
        for edge in &ends {
            active.remove(edge);
        }
        for edge in &starts {
            let own = &edges[edge.number as usize];
            let next = sets.across(set, own.parts, lists);
            sides[edge.number as usize] = [set, next];
            if !is_border(sets, [set, next]) {
                faces.unite(below(edge), above(edge));
            }
            set = next;
            active.insert(*edge);
        }
        debug_assert!(
            starts.last().is_none_or(|last| {
                let upper =
                    active.range((std::ops::Bound::Excluded(*last), std::ops::Bound::Unbounded)).next();
                set == upper.map_or(0, |upper| sides[upper.number as usize][0])
            }),
            "what is above the edges that begin in a point is what is below the next edge"
        );
    }
    let faces = (0..2 * edges.len() as u32).map(|side| faces.root(side)).collect();
    Ok(Swept { sides, faces })
}

/// Sides of edges that lie in the same face (R. Tarjan's forest of disjoint sets, with path halving).
struct Faces {
    above: Vec<u32>,
}

impl Faces {
    fn root(&mut self, mut side: u32) -> u32 {
        while self.above[side as usize] != side {
            let next = self.above[self.above[side as usize] as usize];
            self.above[side as usize] = next;
            side = next;
        }
        side
    }

    fn unite(&mut self, one: u32, other: u32) {
        let (one, other) = (self.root(one), self.root(other));
        // (The smaller number, so that faces have the same numbers whatever the order.)
        self.above[one.max(other) as usize] = one.min(other);
    }
}
