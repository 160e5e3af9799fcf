//! Validity of rings: whether edges share no points except the vertices of consecutive edges, and
//! which rings are holes.
//!
//! A plane sweep over the vertices from left to right keeps the edges that cross the sweep line in
//! their vertical order and tests only neighbours (M. Shamos, D. Hoey, *Geometric intersection
//! problems*, 1976). It stops at the first contact. All tests are exact.
//!
//! Invariant: while no two edges have touched, the edges that cross the sweep line have one
//! vertical order, which changes only at vertices. The next two edges to touch are neighbours just
//! before. They were tested when they became neighbours: when one started, or when the edge between
//! them ended. If a vertex is not at the expected position in the order of its edges, the sweep has
//! passed an earlier contact, and stops, too.

use super::Ring;
use crate::exact::{Point, side};
use spinney_base::sort;

/// An edge from its left end to its right end.
#[derive(Clone, Copy)]
struct SweepEdge {
    left: Point,
    right: Point,
    ring: u32,
    /// Whether the ring's direction is from the left end to the right one.
    is_forward: bool,
}

/// A ring that the sweep has reached.
#[derive(Clone, Copy, Default)]
struct SweptRing {
    is_counterclockwise: bool,
    /// The part that covers the region on either side of the ring. Invariant: there is at most one,
    /// because the sweep stops where a second one would cover a region, too.
    outside: Option<u32>,
    inside: Option<u32>,
}

/// Returns for each ring whether it must be reversed to have its polygon's interior on the left of
/// all edges. `None` if rings cross or touch each other or themselves, or if parts overlap, because
/// the rings then are not the boundary of their union. Rings must have at least three vertices and
/// no consecutive duplicates. Cost: O(n log n) for n vertices.
pub(super) fn reversed_rings(parts: &[Vec<Ring>]) -> Option<Vec<bool>> {
    let sweep = Sweep::new(parts);
    let rings = sweep.run()?;
    Some(rings.iter().map(|ring| ring.is_counterclockwise != ring.inside.is_some()).collect())
}

struct Sweep {
    /// For each vertex, the edge to the next vertex of its ring.
    edges: Vec<SweepEdge>,
    /// For each vertex, the edge from the previous vertex.
    before: Vec<u32>,
    /// The part that each ring belongs to.
    part_of: Vec<u32>,
    rings: Vec<Option<SweptRing>>,
    active: ActiveEdges,
}

impl Sweep {
    fn new(parts: &[Vec<Ring>]) -> Sweep {
        let count = parts.iter().flatten().map(Vec::len).sum();
        let (mut edges, mut before) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let mut part_of = Vec::new();
        for (part, rings) in (0u32..).zip(parts) {
            for ring in rings {
                let (first, number) = (edges.len() as u32, part_of.len() as u32);
                let last = first + ring.len() as u32 - 1;
                before.push(last);
                before.extend(first..last);
                for (vertex, next) in ring.iter().zip(ring.iter().cycle().skip(1)) {
                    let is_forward = vertex < next;
                    let (left, right) = if is_forward { (*vertex, *next) } else { (*next, *vertex) };
                    edges.push(SweepEdge { left, right, ring: number, is_forward });
                }
                part_of.push(part);
            }
        }
        let (rings, active) = (vec![None; part_of.len()], ActiveEdges::new(count));
        Sweep { edges, before, part_of, rings, active }
    }

    fn vertex(&self, number: u32) -> Point {
        let edge = &self.edges[number as usize];
        if edge.is_forward { edge.left } else { edge.right }
    }

    /// Returns the vertices from left to right, and those in a column from bottom to top.
    fn order(&self) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.edges.len() as u32).collect();
        let x = |number: u32| self.vertex(number)[0];
        sort::by_key(&mut order, |number| ascending(x(*number)));
        for column in order.chunk_by_mut(|a, b| x(*a) == x(*b)) {
            sort::by_key(column, |number| ascending(self.vertex(*number)[1]));
        }
        order
    }

    fn run(mut self) -> Option<Vec<SweptRing>> {
        let mut last = None;
        for number in self.order() {
            let vertex = self.vertex(number);
            if last == Some(vertex) {
                return None;
            }
            last = Some(vertex);
            let [one, other] = [self.before[number as usize], number];
            match [one, other].map(|edge| self.edges[edge as usize].left == vertex) {
                [true, true] => self.start(vertex, [one, other])?,
                [false, true] => self.continue_at(vertex, one, other)?,
                [true, false] => self.continue_at(vertex, other, one)?,
                [false, false] => self.end(vertex, [one, other])?,
            }
        }
        self.rings.into_iter().collect()
    }

    /// Handles a vertex where two edges start.
    fn start(&mut self, vertex: Point, pair: [u32; 2]) -> Option<()> {
        let [one, other] = pair.map(|edge| self.edges[edge as usize]);
        // (The lower one first.)
        let [lower, upper] = match side(one.left, one.right, other.right) {
            0 => return None,
            1 => pair,
            _ => [pair[1], pair[0]],
        };
        let at = self.active.lower_bound(&self.edges, vertex);
        let next = self.active.at(at);
        if next.is_some_and(|edge| side_of(&self.edges, edge, vertex) == 0) {
            return None;
        }
        let below = self.active.before(at);
        let ring = self.edges[lower as usize].ring as usize;
        if self.rings[ring].is_none() {
            // This is the ring's leftmost vertex: the region around it is the one above the edge
            // below.
            let outside = match below {
                None => None,
                Some(edge) => self.part_above(edge)?,
            };
            let part = self.part_of[ring];
            let inside = match outside {
                None => Some(part),
                Some(around) if around == part => None,
                // Parts overlap.
                Some(_) => return None,
            };
            let is_counterclockwise = self.edges[lower as usize].is_forward;
            self.rings[ring] = Some(SweptRing { is_counterclockwise, outside, inside });
        }
        if let Some(below) = below {
            self.check(below, lower)?;
        }
        if let Some(above) = next {
            self.check(upper, above)?;
        }
        self.active.insert(at, [lower, upper]);
        Some(())
    }

    /// Handles a vertex where one edge ends and another one starts.
    fn continue_at(&mut self, vertex: Point, ending: u32, starting: u32) -> Option<()> {
        let at = self.active.find(&self.edges, vertex, ending)?;
        if let Some(below) = self.active.before(at) {
            self.check(below, starting)?;
        }
        if let Some(above) = self.active.after(at) {
            self.check(starting, above)?;
        }
        self.active.replace(at, starting);
        Some(())
    }

    /// Handles a vertex where two edges end.
    fn end(&mut self, vertex: Point, [one, other]: [u32; 2]) -> Option<()> {
        let first = self.active.find(&self.edges, vertex, one);
        let lower = match first.filter(|first| self.active.after(*first) == Some(other)) {
            Some(first) => first,
            None => self.active.find(&self.edges, vertex, other)?,
        };
        let upper = self.active.next(lower);
        if !self.active.at(upper).is_some_and(|edge| edge == one || edge == other) {
            return None;
        }
        let (below, above) = (self.active.before(lower), self.active.after(upper));
        self.active.remove(upper);
        self.active.remove(lower);
        match (below, above) {
            (Some(below), Some(above)) => self.check(below, above),
            _ => Some(()),
        }
    }

    /// Returns the part that covers the region above an edge.
    fn part_above(&self, edge: u32) -> Option<Option<u32>> {
        let edge = &self.edges[edge as usize];
        let ring = self.rings[edge.ring as usize]?;
        Some(if edge.is_forward == ring.is_counterclockwise { ring.inside } else { ring.outside })
    }

    /// Fails if two edges touch in any point except a common vertex of consecutive edges.
    fn check(&self, one: u32, other: u32) -> Option<()> {
        let (a, b) = (&self.edges[one as usize], &self.edges[other as usize]);
        // (No two rings share a vertex, so these edges are consecutive.)
        if a.right == b.left || a.left == b.right {
            return Some(());
        }
        if a.left == b.left || a.right == b.right {
            let other = if a.left == b.left { b.right } else { b.left };
            return (side(a.left, a.right, other) != 0).then_some(());
        }
        let ends = |edge: &SweepEdge| {
            let (low, high) = (edge.left[1].min(edge.right[1]), edge.left[1].max(edge.right[1]));
            [low, high]
        };
        let ([low, high], [other_low, other_high]) = (ends(a), ends(b));
        if high < other_low || other_high < low || a.right[0] < b.left[0] || b.right[0] < a.left[0] {
            return Some(());
        }
        let [c, d] = [side(a.left, a.right, b.left), side(a.left, a.right, b.right)];
        if c * d > 0 {
            return Some(());
        }
        let [c, d] = [side(b.left, b.right, a.left), side(b.left, b.right, a.right)];
        // (Bounding boxes of collinear edges overlap here, so the edges overlap, too.)
        if c * d > 0 { Some(()) } else { None }
    }
}

/// Maps a number to bits in ascending order.
fn ascending(number: f64) -> u64 {
    // (Both zeros are equal.)
    let bits = (number + 0.0).to_bits();
    if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
}

/// Edges that cross the sweep line, from bottom to top, in chunks of bounded length, so that an
/// insertion does not move all of them.
struct ActiveEdges {
    /// The chunks; none is empty.
    chunks: Vec<Vec<u32>>,
    /// The slot into which each edge was inserted. The edge is still near it unless many edges were
    /// inserted or removed since.
    put: Vec<[u32; 2]>,
}

/// A chunk, and an index in it.
type Slot = [usize; 2];

/// Maximum length of a chunk; longer ones are split.
const MAX_CHUNK: usize = 512;

/// Number of slots on either side of an edge's insertion slot that are checked before a binary
/// search.
const NEAR: usize = 8;

impl ActiveEdges {
    fn new(edges: usize) -> ActiveEdges {
        ActiveEdges { chunks: Vec::new(), put: vec![[0; 2]; edges] }
    }

    /// Returns the slot of an edge that ends at a point.
    fn find(&self, edges: &[SweepEdge], point: Point, edge: u32) -> Option<Slot> {
        let [chunk, index] = self.put[edge as usize].map(|at| at as usize);
        if let Some(own) = self.chunks.get(chunk) {
            let near = index.saturating_sub(NEAR).min(own.len())..(index + NEAR).min(own.len());
            if let Some(at) = own[near.clone()].iter().position(|other| *other == edge) {
                return Some([chunk, near.start + at]);
            }
        }
        let slot = self.lower_bound(edges, point);
        // (If two edges end there, it may be the upper one.)
        [slot, self.next(slot)].into_iter().find(|slot| self.at(*slot) == Some(edge))
    }

    /// Returns the first slot whose edge is not below a point.
    fn lower_bound(&self, edges: &[SweepEdge], point: Point) -> Slot {
        let is_below = |edge: &u32| side_of(edges, *edge, point) > 0;
        let chunk = self.chunks.partition_point(|chunk| is_below(&chunk[chunk.len() - 1]));
        match self.chunks.get(chunk) {
            Some(own) => [chunk, own.partition_point(is_below)],
            None => [chunk, 0],
        }
    }

    fn at(&self, [chunk, index]: Slot) -> Option<u32> {
        self.chunks.get(chunk)?.get(index).copied()
    }

    fn next(&self, [chunk, index]: Slot) -> Slot {
        match self.chunks.get(chunk) {
            Some(own) if index + 1 < own.len() => [chunk, index + 1],
            _ => [chunk + 1, 0],
        }
    }

    fn after(&self, slot: Slot) -> Option<u32> {
        self.at(self.next(slot))
    }

    fn before(&self, [chunk, index]: Slot) -> Option<u32> {
        match index {
            0 => self.chunks.get(chunk.checked_sub(1)?)?.last().copied(),
            index => self.at([chunk, index - 1]),
        }
    }

    fn replace(&mut self, [chunk, index]: Slot, edge: u32) {
        self.chunks[chunk][index] = edge;
        self.put[edge as usize] = [chunk as u32, index as u32];
    }

    fn insert(&mut self, [chunk, index]: Slot, pair: [u32; 2]) {
        // (A slot above all edges is the end of the last chunk.)
        let (chunk, index) = match self.chunks.get(chunk) {
            Some(_) => (chunk, index),
            None if chunk == 0 => {
                self.chunks.push(Vec::new());
                (0, 0)
            }
            None => (chunk - 1, self.chunks[chunk - 1].len()),
        };
        let own = &mut self.chunks[chunk];
        own.splice(index..index, pair);
        for (edge, index) in pair.into_iter().zip(index as u32..) {
            self.put[edge as usize] = [chunk as u32, index];
        }
        if own.len() > MAX_CHUNK {
            let upper = own.split_off(MAX_CHUNK / 2);
            self.chunks.insert(chunk + 1, upper);
        }
    }

    fn remove(&mut self, [chunk, index]: Slot) {
        self.chunks[chunk].remove(index);
        if self.chunks[chunk].is_empty() {
            self.chunks.remove(chunk);
        }
    }
}

/// Position of a point relative to an edge: 1 above, -1 below, 0 on it. (Above is left of the
/// direction from left to right.)
fn side_of(edges: &[SweepEdge], edge: u32, point: Point) -> i32 {
    let SweepEdge { left, right, .. } = &edges[edge as usize];
    side(*left, *right, point)
}
