//! Plane sweep over all edges from left to right: computes the sets of parts on both sides of each
//! edge, and the face that each side borders.
//!
//! Edges share no points except their ends, so the edges that cross the sweep line have one
//! vertical order.

use std::cmp::Ordering;
use std::collections::BTreeSet;

use crate::edges::{Edge, PartLists};
use crate::exact::{Cell, turn};
use crate::sets::PartSets;
use spinney_base::{Progress, Result};

/// An edge that crosses the sweep line.
#[derive(Clone, Copy)]
struct Active {
    ends: [Cell; 2],
    number: u32,
}

impl Ord for Active {
    /// Vertical order: decided by the side on which the later edge begins, or ends if both begin
    /// together.
    fn cmp(&self, other: &Active) -> Ordering {
        let ([a, b], [c, d]) = (self.ends, other.ends);
        if self.ends == other.ends {
            return Ordering::Equal;
        }
        let side = if a <= c {
            // The other edge begins later, on one side of this one.
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

/// Sets of parts below and above an edge (right and left of its direction from the left end).
pub(crate) type Sides = [u32; 2];

/// Number of points between two checks for cancellation.
const POINTS_PER_CHECK: u64 = 1 << 16;

/// Sets and faces at the sides of all edges.
pub(crate) struct Swept {
    /// Sets at both sides of each edge.
    pub(crate) sides: Vec<Sides>,
    /// Faces at the lower and upper side of each edge, at indices `2 * edge` and `2 * edge + 1`.
    /// Sides with equal numbers border the same face.
    pub(crate) faces: Vec<u32>,
}

/// Sweeps over edges, which are ordered by their ends.
///
/// `is_border` returns whether an edge between two sets separates regions. Faces extend across all
/// other edges.
///
/// # Errors
/// On cancellation.
pub(crate) fn sweep(
    edges: &[Edge<Cell>],
    lists: &PartLists,
    sets: &mut PartSets,
    progress: &dyn Progress,
    is_border: &mut dyn FnMut(&PartSets, Sides) -> bool,
) -> Result<Swept> {
    let mut sides: Vec<Sides> = vec![[0; 2]; edges.len()];
    // Two sides per edge; the last element is the exterior.
    let mut faces = Faces { above: (0..2 * edges.len() as u32 + 1).collect() };
    let outside = 2 * edges.len() as u32;
    let mut active: BTreeSet<Active> = BTreeSet::new();
    // Edges ordered by their right ends.
    let mut ending: Vec<u32> = (0..edges.len() as u32).collect();
    ending.sort_unstable_by_key(|number| (edges[*number as usize].ends[1], *number));
    let key = |number: u32| Active { ends: edges[number as usize].ends, number };
    let (mut next_start, mut next_end) = (0, 0);
    let (mut starts, mut ends) = (Vec::new(), Vec::new());
    let mut points = 0u64;
    while next_end < ending.len() {
        points += 1;
        if points.is_multiple_of(POINTS_PER_CHECK) {
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
        // Order both from bottom to top.
        ends.sort_unstable();
        starts.sort_unstable();
        // Invariant: each sector between neighbouring edges around the point lies in one face,
        // which borders both edges. The sectors open to the left and to the right are the same two:
        // one below all edges and one above. So uniting these pairs of sides at every point unites
        // exactly the sides of each face's borders, including holes with the region around them.
        for pair in ends.windows(2).chain(starts.windows(2)) {
            faces.unite(2 * pair[0].number + 1, 2 * pair[1].number);
        }
        let below = |edge: &Active| 2 * edge.number;
        let above = |edge: &Active| 2 * edge.number + 1;
        // The set below all edges that begin at the point.
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
            "the set above the edges that begin at a point is the set below the next edge"
        );
    }
    let faces = (0..2 * edges.len() as u32).map(|side| faces.root(side)).collect();
    Ok(Swept { sides, faces })
}

/// Disjoint sets of edge sides that border the same face (R. Tarjan's disjoint-set forest, with
/// path halving).
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
        // (The smaller number becomes the root, so that face numbers do not depend on the order of
        // unions.)
        self.above[one.max(other) as usize] = one.min(other);
    }
}
