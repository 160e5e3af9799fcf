//! Conversion of faces with holes to single rings, for formats without holes, and back. Bridges
//! connect the holes to the outer ring; each bridge is passed in both directions.

use std::cell::Cell;
use std::collections::HashSet;

use super::ears::Ears;
use super::plane::Plane;
use crate::exact::vector::{main_axis, others};
use spinney_base::sort;

/// Maximum number of candidate bridges per face, in addition to the nearest few of each hole.
const MAX_TRIES: usize = 1 << 16;

/// Number of vertices that are tried first for a bridge.
const NEAREST: usize = 16;

/// Joins the rings of a face, the outer one first, to one ring of vertex indices. A vertex at the
/// end of a bridge occurs once more.
///
/// A bridge connects two vertices across the face's interior, meets nothing in between, and is not
/// an edge of any ring. So [`split_bridges`] restores the rings, if the face has no edge that
/// occurs in both directions. There may be no such bridge if rings cross, and none may be found in
/// time if there are very many candidates. A bridge may then cross edges, but can still be removed.
/// Takes time proportional to the product of hole and vertex counts.
///
/// Coordinates are at most 2^31 in magnitude.
///
/// # Panics
/// If `ring_ends` does not ascend to the number of points, or there are at least 2^32 points.
pub fn join_rings(points: &[[i64; 3]], ring_ends: &[usize]) -> Vec<u32> {
    assert!(u32::try_from(points.len()).is_ok(), "faces have fewer than 2^32 vertices");
    let mut start = 0;
    let mut rings = ring_ends.iter().map(|&end| {
        let ring: Vec<u32> = (start as u32..end as u32).collect();
        start = end;
        ring
    });
    let ring = rings.next().unwrap_or_default();
    let holes: Vec<Vec<u32>> = rings.filter(|hole| !hole.is_empty()).collect();
    if holes.is_empty() || ring.is_empty() {
        return ring;
    }
    let plane = Plane::of_ring(&points[..ring.len()]);
    let normal = plane.map_or([0, 0, 1], |plane| plane.normal);
    let flat = flatten(points, normal);
    Bridges::new(&flat, ring, holes).join()
}

/// Projects vertices along the axis in which the face's projection is largest. The result is
/// counterclockwise if the outer ring is.
fn flatten(points: &[[i64; 3]], normal: [i128; 3]) -> Vec<[i64; 2]> {
    let axis = main_axis(normal);
    let [j, k] = others(axis);
    let (j, k) = if normal[axis] < 0 { (k, j) } else { (j, k) };
    points.iter().map(|point| [point[j], point[k]]).collect()
}

struct Bridges<'a> {
    flat: &'a [[i64; 2]],
    ears: Ears<'a>,
    ring: Vec<u32>,
    /// Holes that are not joined yet, the one that reaches farthest last.
    holes: Vec<Vec<u32>>,
    /// Edges of all rings and bridges, the smaller end first.
    edges: HashSet<[[i64; 2]; 2]>,
    /// Points that several vertices share.
    shared: HashSet<[i64; 2]>,
    /// Number of candidates that may still be tried.
    tries: Cell<usize>,
}

/// A bridge between a ring index and an index in a hole.
struct Bridge {
    on_ring: usize,
    hole: usize,
    on_hole: usize,
}

impl<'a> Bridges<'a> {
    fn new(flat: &'a [[i64; 2]], ring: Vec<u32>, mut holes: Vec<Vec<u32>>) -> Bridges<'a> {
        let at = |corner: &u32| flat[*corner as usize];
        sort::by_wide_key(&mut holes, |hole| hole.iter().map(|c| sort::flat_key(at(c))).max().unwrap_or(0));
        let all = std::iter::once(&ring).chain(&holes);
        let edges =
            all.flat_map(|ring| (0..ring.len()).map(|i| edge(at(&ring[i]), at(&ring[(i + 1) % ring.len()]))));
        let edges = edges.collect();
        let (mut taken, mut shared) = (HashSet::new(), HashSet::new());
        shared.extend(flat.iter().copied().filter(|point| !taken.insert(*point)));
        Bridges { flat, ears: Ears::new(flat), ring, holes, edges, shared, tries: Cell::new(MAX_TRIES) }
    }

    fn join(mut self) -> Vec<u32> {
        while !self.holes.is_empty() {
            // Where rings touch, bridges to both may cross in the shared point: such vertices are
            // tried last.
            let bridge = self.to_farthest().or_else(|| self.to_any(false)).or_else(|| self.to_any(true));
            let Bridge { on_ring, hole, on_hole } = bridge.unwrap_or_else(|| self.across());
            let hole = self.holes.remove(hole);
            self.edges.insert(edge(self.at(self.ring[on_ring]), self.at(hole[on_hole])));
            let mut joined = self.ring[..=on_ring].to_vec();
            joined.extend(&hole[on_hole..]);
            joined.extend(&hole[..=on_hole]);
            joined.extend(&self.ring[on_ring..]);
            self.ring = joined;
        }
        self.ring
    }

    fn at(&self, corner: u32) -> [i64; 2] {
        self.flat[corner as usize]
    }

    fn distance(&self, a: u32, b: u32) -> i128 {
        (0..2).map(|i| i128::from(self.at(a)[i] - self.at(b)[i]).pow(2)).sum()
    }

    /// Returns the shortest bridge from the last hole's farthest vertex to a vertex that is farther
    /// yet. No other hole is in between, so there is one, unless the hole touches something exactly
    /// there.
    fn to_farthest(&self) -> Option<Bridge> {
        let hole = self.holes.len() - 1;
        let corners = &self.holes[hole];
        let on_hole = (0..corners.len()).max_by_key(|&i| self.at(corners[i]))?;
        let from = corners[on_hole];
        // Distances, with ring indices in the lower 32 bits.
        let mut ahead: Vec<u128> = (0u32..)
            .zip(&self.ring)
            .filter(|(_, corner)| self.at(**corner) > self.at(from))
            .map(|(place, corner)| (self.distance(*corner, from) as u128) << 32 | u128::from(place))
            .collect();
        let is_good = |bridge: &Bridge| self.is_alone(bridge) && self.is_free(bridge);
        // The bridge is nearly always one of the nearest few, so the others are sorted only if it
        // is not.
        let nearest = NEAREST.min(ahead.len());
        if nearest < ahead.len() {
            ahead.select_nth_unstable(nearest);
        }
        let bridge = |ahead: &u128| Bridge { on_ring: *ahead as u32 as usize, hole, on_hole };
        sort::numbers128(&mut ahead[..nearest]);
        if let Some(found) = ahead[..nearest].iter().map(bridge).find(is_good) {
            return Some(found);
        }
        sort::numbers128(&mut ahead[nearest..]);
        ahead[nearest..].iter().map(bridge).take_while(|_| self.may_try()).find(is_good)
    }

    fn may_try(&self) -> bool {
        let left = self.tries.get();
        self.tries.set(left.saturating_sub(1));
        left > 0
    }

    /// Returns any bridge to any hole. If the rings do not cross and `may_share` allows shared
    /// points, there is one: an edge of the face's triangulation.
    fn to_any(&self, may_share: bool) -> Option<Bridge> {
        let holes = (0..self.holes.len()).rev();
        let ends = holes.flat_map(|hole| (0..self.holes[hole].len()).map(move |on_hole| (hole, on_hole)));
        let bridges = ends.flat_map(|(hole, on_hole)| {
            (0..self.ring.len()).map(move |on_ring| Bridge { on_ring, hole, on_hole })
        });
        bridges
            .take_while(|_| self.may_try())
            .find(|bridge| (may_share || self.is_alone(bridge)) && self.is_free(bridge))
    }

    /// Returns a bridge to the last hole that may cross anything, but avoids existing edges if
    /// possible.
    fn across(&self) -> Bridge {
        let hole = self.holes.len() - 1;
        let corners = &self.holes[hole];
        let bridges = (0..corners.len())
            .flat_map(|on_hole| (0..self.ring.len()).map(move |on_ring| Bridge { on_ring, hole, on_hole }));
        let is_new = |bridge: &Bridge| self.is_new(self.ring[bridge.on_ring], corners[bridge.on_hole]);
        bridges.take(NEAREST).find(is_new).unwrap_or(Bridge { on_ring: 0, hole, on_hole: 0 })
    }

    // Invariant: a bridge is not an edge of any ring or other bridge. So exactly the bridges occur
    // once in each direction, and `split_bridges` removes nothing else. It would also remove an
    // edge under a bridge, and so join the faces on both sides.
    fn is_new(&self, a: u32, b: u32) -> bool {
        self.at(a) != self.at(b) && !self.edges.contains(&edge(self.at(a), self.at(b)))
    }

    /// Returns whether no other vertices are at the ends of a bridge.
    fn is_alone(&self, bridge: &Bridge) -> bool {
        let ends = [self.ring[bridge.on_ring], self.holes[bridge.hole][bridge.on_hole]];
        ends.iter().all(|&end| !self.shared.contains(&self.at(end)))
    }

    /// Returns whether a bridge is inside the face and crosses nothing.
    fn is_free(&self, bridge: &Bridge) -> bool {
        let hole = &self.holes[bridge.hole];
        let (to, from) = (self.ring[bridge.on_ring], hole[bridge.on_hole]);
        self.is_new(to, from)
            && self.ears.opens_to(&self.ring, bridge.on_ring, from)
            && self.ears.opens_to(hole, bridge.on_hole, to)
            && std::iter::once(&self.ring)
                .chain(&self.holes)
                .all(|other| !self.ears.is_blocked(from, to, other))
    }
}

fn edge(a: [i64; 2], b: [i64; 2]) -> [[i64; 2]; 2] {
    [a.min(b), a.max(b)]
}

/// Removes edges that a ring passes in both directions, and returns the remaining rings of the face
/// as vertex indices. They enclose the same points as before.
///
/// The first ring is the one that encloses the most area. The others keep their order. They are
/// holes if their orientation is opposite, and otherwise separate faces that a bridge joined. A
/// ring without such edges is returned unchanged. The result is empty if the ring has no other
/// edges. A ring that begins within the given one begins with the first of its vertices there.
///
/// # Panics
/// If there are at least 2^32 vertices.
pub fn split_bridges(ring: &[[i64; 3]]) -> Vec<Vec<u32>> {
    let count = u32::try_from(ring.len()).unwrap_or_else(|_| panic!("faces have fewer than 2^32 vertices"));
    let end = |corner: u32| ring[(corner as usize + 1) % ring.len()];
    // Sorts edges by their ends, then by the index of their start vertex.
    let key = |corner: u32| {
        let (a, b) = (ring[corner as usize], end(corner));
        (a.min(b), a.max(b), corner)
    };
    let mut sorted: Vec<u32> = (0..count).collect();
    sort::by(&mut sorted, &mut |a, b| key(*a).cmp(&key(*b)));
    let mut next: Vec<u32> = (0..count).map(|corner| (corner + 1) % count).collect();
    let mut before: Vec<u32> = (0..count).map(|corner| (corner + count - 1) % count).collect();
    let mut is_out = vec![false; ring.len()];
    let mut open: Vec<u32> = Vec::new();
    for same in sorted.chunk_by(|&a, &b| (key(a).0, key(a).1) == (key(b).0, key(b).1)) {
        open.clear();
        for &corner in same {
            let back = open.last().copied().filter(|&last| ring[last as usize] != ring[corner as usize]);
            let Some(there) = back else {
                open.push(corner);
                continue;
            };
            open.pop();
            let (a, b) = (there as usize, corner as usize);
            (is_out[a], is_out[b]) = (true, true);
            let [(before_a, next_a), (before_b, next_b)] = [a, b].map(|i| (before[i], next[i]));
            for (from, to) in [(before_a, next_b), (before_b, next_a)] {
                next[from as usize] = to;
                before[to as usize] = from;
            }
        }
    }
    let mut rings = trace(&next, &mut is_out);
    // The outer ring has the orientation of the whole and encloses the most area.
    if rings.len() > 1 {
        let corners =
            |ring_: &Vec<u32>| -> Vec<[i64; 3]> { ring_.iter().map(|&i| ring[i as usize]).collect() };
        let normal = Plane::of_ring(ring).map_or([0; 3], |plane| plane.normal);
        let axis = main_axis(normal);
        let area = |of: &Vec<u32>| {
            let area = Plane::of_ring(&corners(of)).map_or(0, |plane| plane.normal[axis]);
            if normal[axis] < 0 { -area } else { area }
        };
        let areas: Vec<i128> = rings.iter().map(area).collect();
        let outer = (0..rings.len()).rev().max_by_key(|&i| areas[i]).unwrap_or(0);
        rings[..=outer].rotate_right(1);
    }
    rings
}

/// Traces the remaining rings along `next`, without removed edges.
fn trace(next: &[u32], is_done: &mut [bool]) -> Vec<Vec<u32>> {
    let mut rings = Vec::new();
    for first in 0..next.len() {
        let mut ring = Vec::new();
        let mut corner = first;
        while !is_done[corner] {
            is_done[corner] = true;
            ring.push(corner as u32);
            corner = next[corner] as usize;
        }
        if !ring.is_empty() {
            rings.push(ring);
        }
    }
    rings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Triangulator;

    type Ring = Vec<[i64; 3]>;

    /// Rotates each ring to begin with its smallest vertex, and sorts the holes.
    fn canonical(mut rings: Vec<Ring>) -> Vec<Ring> {
        for ring in &mut rings {
            let least = (0..ring.len()).min_by_key(|&i| ring[i]).unwrap();
            ring.rotate_left(least);
        }
        rings[1..].sort();
        rings
    }

    /// Joins, splits and compares; the joined ring encloses the same points as the rings.
    fn round_trip(rings: &[Ring]) -> Ring {
        let mut ring_ends = Vec::new();
        rings.iter().for_each(|ring| ring_ends.push(ring_ends.last().unwrap_or(&0) + ring.len()));
        let points = rings.concat();
        let joined: Ring = join_rings(&points, &ring_ends).iter().map(|&i| points[i as usize]).collect();
        assert_eq!(joined.len(), points.len() + 2 * (rings.len() - 1));
        for shift in 0..joined.len() {
            let mut given = joined.clone();
            given.rotate_left(shift);
            let split = split_bridges(&given);
            let split = split.iter().map(|ring| ring.iter().map(|&i| given[i as usize]).collect()).collect();
            assert_eq!(canonical(split), canonical(rings.to_vec()));
        }
        // Nothing crosses: triangles cover the joined ring exactly.
        let mut triangles = Vec::new();
        assert!(Triangulator::new().triangulate(&joined, &[joined.len()], &mut triangles), "{joined:?}");
        joined
    }

    fn square(x: i64, y: i64, side: i64) -> Ring {
        vec![[x, y, x], [x + side, y, x + side], [x + side, y + side, x + side], [x, y + side, x]]
    }

    fn hole(x: i64, y: i64, side: i64) -> Ring {
        let mut ring = square(x, y, side);
        ring.reverse();
        ring
    }

    #[test]
    fn holes_come_back() {
        let mut holes = [hole(2, 2, 1), hole(5, 2, 3), hole(2, 6, 2), hole(5, 6, 1), hole(7, 7, 2)];
        for _ in 0..holes.len() {
            let mut rings = vec![square(0, 0, 10)];
            rings.extend(holes.iter().cloned());
            round_trip(&rings);
            rings.iter_mut().for_each(|ring| ring.reverse());
            round_trip(&rings);
            holes.rotate_left(1);
            holes.swap(0, 3);
        }
        round_trip(&[square(0, 0, 10), hole(3, 3, 4)]);
    }

    #[test]
    fn concave_outlines() {
        // A comb with holes in its teeth.
        let outer: Ring = [
            [0, 0],
            [30, 0],
            [30, 20],
            [24, 20],
            [24, 4],
            [18, 4],
            [18, 20],
            [12, 20],
            [12, 4],
            [6, 4],
            [6, 20],
            [0, 20],
        ]
        .map(|[x, y]| [x, y, 3])
        .to_vec();
        let hole = |x: i64, y: i64| -> Ring { vec![[x, y, 3], [x, y + 2, 3], [x + 2, y, 3]] };
        round_trip(&[outer.clone(), hole(2, 15), hole(14, 10), hole(26, 7), hole(14, 15), hole(8, 1)]);
        round_trip(&[outer, hole(8, 1), hole(26, 17)]);
    }

    #[test]
    fn holes_that_touch() {
        let outer = square(0, 0, 12);
        // A hole that touches the outline in a vertex, two holes that touch, and all three.
        let at_corner: Ring = vec![[12, 12, 12], [10, 4, 10], [4, 10, 4]];
        round_trip(&[outer.clone(), at_corner.clone()]);
        round_trip(&[outer.clone(), at_corner.clone(), vec![[10, 4, 10], [2, 2, 2], [2, 4, 2]]]);
        round_trip(&[outer.clone(), hole(2, 2, 3), hole(5, 5, 2)]);
        round_trip(&[outer, hole(2, 2, 3), hole(5, 5, 2), at_corner]);
    }

    #[test]
    fn many_holes_in_any_order() {
        let mut state = 1u64;
        let mut random = |below: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) % below
        };
        for _ in 0..40 {
            let mut rings = vec![square(0, 0, 64)];
            let mut cells: Vec<u64> = (0..36).collect();
            for _ in 0..random(20) + 1 {
                let cell = cells.swap_remove(random(cells.len() as u64) as usize) as i64;
                let (x, y) = (2 + cell % 6 * 10 + random(3) as i64, 2 + cell / 6 * 10 + random(3) as i64);
                let mut ring = hole(x, y, 1 + random(7) as i64);
                let start = random(4) as usize;
                ring.rotate_left(start);
                rings.push(ring);
            }
            round_trip(&rings);
        }
    }

    /// A sieve: bridges are found without trying all candidates.
    #[test]
    fn very_many_holes() {
        let side = 36;
        let mut rings = vec![square(0, 0, 4 * side + 4)];
        rings.extend((0..side * side).map(|i| hole(4 + i % side * 4, 4 + i / side * 4, 1 + i % 2)));
        let points = rings.concat();
        let ring_ends: Vec<usize> = (1..=rings.len()).map(|ring| 4 * ring).collect();
        let joined: Ring = join_rings(&points, &ring_ends).iter().map(|&i| points[i as usize]).collect();
        let split = split_bridges(&joined);
        let split = split.iter().map(|ring| ring.iter().map(|&i| joined[i as usize]).collect()).collect();
        assert_eq!(canonical(split), canonical(rings));
    }

    #[test]
    fn rings_without_bridges_stay() {
        for ring in [square(0, 0, 4), vec![], vec![[1, 1, 1]], square(0, 0, 4)[..3].to_vec()] {
            let all: Vec<u32> = (0..ring.len() as u32).collect();
            let expected = if ring.is_empty() { vec![] } else { vec![all] };
            assert_eq!(split_bridges(&ring), expected);
        }
        // A spike is removed, and so is a ring that consists of one.
        let [a, b, c, d] = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [9, 9, 0]];
        assert_eq!(split_bridges(&[a, b, c, d, c]), [[0, 1, 4]]);
        assert_eq!(split_bridges(&[a, b, c, b]), Vec::<Vec<u32>>::new());
    }

    #[test]
    fn rings_that_cross_are_joined_all_the_same() {
        let rings = [square(0, 0, 4), hole(2, 2, 8), hole(20, 20, 2)];
        let points = rings.concat();
        let joined: Ring = join_rings(&points, &[4, 8, 12]).iter().map(|&i| points[i as usize]).collect();
        assert_eq!(split_bridges(&joined).len(), 3);
    }
}
