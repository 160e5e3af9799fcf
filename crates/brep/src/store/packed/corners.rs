//! Packing of corners (the vertex indices of rings) by the connectivity of faces. Most edges occur
//! twice, in opposite directions, so an edge's first face predicts corners of the second.

use spinney_packing::Columns;

/// Number of half-edges that a vertex remembers in each direction.
const REMEMBERED: usize = 4;
/// Marks a missing vertex.
const NONE: u32 = u32::MAX;

/// Bit contexts of candidates: by whether the corner is the ring's last one, the candidate's
/// origin, and its rank.
const CANDIDATE: usize = 0;
/// Contexts of corners of the previous ring, by their index there.
const AGAIN: usize = CANDIDATE + 2 * 3 * 4;
/// Contexts of new vertices: by whether the corner is its ring's first, last or another one, and
/// how the previous corner was coded.
const NEW: usize = AGAIN + 3;
/// Contexts of bits, and of numbers: those of first corners, and of others.
pub(super) const CONTEXTS: (usize, usize) = (NEW + 3 * 3, 2);

/// How a corner was coded; a context of the next one.
#[derive(Clone, Copy)]
enum CornerCoding {
    New,
    Candidate,
    Delta,
}

/// Coded vertices, and their half-edges that have no opposite yet.
pub(super) struct Corners {
    bits: usize,
    numbers: usize,
    /// For each vertex the incoming half-edges, the newest first: start vertex, and the corner
    /// after the edge.
    into: Vec<[(u32, u32); REMEMBERED]>,
    /// For each vertex the outgoing half-edges: end vertex.
    out: Vec<[u32; REMEMBERED]>,
    /// Number of the next new vertex.
    next: u32,
    /// The last corner that was not new.
    last: u32,
    /// The first corners of the previous ring.
    ring: [u32; 3],
    found: CornerCoding,
}

impl Corners {
    /// Creates the state for a block with this number of vertices.
    pub(super) fn new(bits: usize, numbers: usize, vertices: usize) -> Corners {
        Corners {
            bits,
            numbers,
            into: vec![[(NONE, NONE); REMEMBERED]; vertices],
            out: vec![[NONE; REMEMBERED]; vertices],
            next: 0,
            last: 0,
            ring: [NONE; 3],
            found: CornerCoding::New,
        }
    }

    /// Codes the corners of a ring. Returns `None` if they are not vertices, or not numbered by
    /// first occurrence.
    pub(super) fn code(&mut self, columns: &mut Columns<'_>, ring: &mut [u32]) -> Option<()> {
        for index in 0..ring.len() {
            ring[index] = self.corner(columns, ring, index)?;
        }
        Some(())
    }

    fn corner(&mut self, columns: &mut Columns<'_>, ring: &[u32], index: usize) -> Option<u32> {
        let (corner, is_last) = (ring[index], index + 1 == ring.len());
        let candidate = match index {
            0 => self.of_ring_before(columns, corner),
            _ => self.of_edges(columns, &ring[..index], corner, is_last),
        };
        if let Some(candidate) = candidate {
            (self.found, self.last) = (CornerCoding::Candidate, candidate);
            return Some(candidate);
        }
        let ring_position = if index == 0 { 0 } else { 1 + usize::from(is_last) };
        if columns.bit(self.bits + NEW + 3 * ring_position + self.found as usize, corner == self.next) {
            self.found = CornerCoding::New;
            self.next += 1;
            return Some(self.next - 1).filter(|new| (*new as usize) < self.into.len());
        }
        let more = i64::from(corner.wrapping_sub(self.last) as i32);
        let more = columns.near(self.numbers + usize::from(index > 0), more);
        (self.found, self.last) = (CornerCoding::Delta, self.last.wrapping_add(more as u32));
        Some(self.last).filter(|number| *number < self.next)
    }

    /// Codes a first corner, if it is one of the previous ring's first corners.
    fn of_ring_before(&self, columns: &mut Columns<'_>, corner: u32) -> Option<u32> {
        let candidates = self.ring.into_iter().enumerate().filter(|(_, candidate)| *candidate != NONE);
        candidates
            .map(|(rank, candidate)| (candidate, self.bits + AGAIN + rank))
            .find(|(candidate, context)| columns.bit(*context, *candidate == corner))
            .map(|(candidate, _)| candidate)
    }

    /// Codes another corner, if an earlier half-edge leads from it to the previous corner, or to it
    /// from the first one.
    fn of_edges(&self, columns: &mut Columns<'_>, before: &[u32], corner: u32, is_last: bool) -> Option<u32> {
        let (first, last) = (before[0], before[before.len() - 1]);
        let into = self.into[last as usize].map(|(from, _)| from);
        let out = if is_last { self.out[first as usize] } else { [NONE; REMEMBERED] };
        let of_into = into.iter().map(|it| (*it, if out.contains(it) { 2 } else { 0 }));
        let of_out = out.iter().filter(|it| !into.contains(it)).map(|it| (*it, 1));
        let is_before =
            |it: u32| it == first || before.len().checked_sub(2).is_some_and(|at| before[at] == it);
        let candidates = of_into.chain(of_out).filter(|(it, _)| *it != NONE && !is_before(*it));
        for (rank, (candidate, kind)) in candidates.enumerate() {
            let context = self.bits + CANDIDATE + 12 * usize::from(is_last) + 4 * kind + rank.min(3);
            if columns.bit(context, candidate == corner) {
                return Some(candidate);
            }
        }
        None
    }

    /// Returns the corner after the half-edge between two vertices, if it has no opposite yet.
    pub(super) fn corner_after(&self, from: u32, to: u32) -> Option<u32> {
        let found = self.into[to as usize].iter().find(|(before, _)| *before == from);
        found.map(|(_, after)| *after)
    }

    /// Records the half-edges of a ring.
    pub(super) fn join(&mut self, ring: &[u32]) {
        let at = |index: usize| ring[index % ring.len()];
        for index in 0..ring.len() {
            let [from, to, after] = [0, 1, 2].map(|more| at(index + more));
            let other = self.into[from as usize].iter().position(|(before, _)| *before == to);
            if let Some(slot) = other {
                forget(&mut self.into[from as usize], slot, (NONE, NONE));
                if let Some(slot) = self.out[to as usize].iter().position(|after| *after == from) {
                    forget(&mut self.out[to as usize], slot, NONE);
                }
            } else {
                remember(&mut self.into[to as usize], (from, after));
                remember(&mut self.out[from as usize], to);
            }
        }
        self.ring = std::array::from_fn(|index| ring.get(index).copied().unwrap_or(NONE));
    }
}

fn forget<T>(list: &mut [T; REMEMBERED], slot: usize, nothing: T) {
    list[slot..].rotate_left(1);
    list[REMEMBERED - 1] = nothing;
}

fn remember<T>(list: &mut [T; REMEMBERED], item: T) {
    list.rotate_right(1);
    list[0] = item;
}
