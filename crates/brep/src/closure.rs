//! Test whether a surface is closed, in one pass and constant memory.
//!
//! The boundary of a surface is the sum of its faces' directed edges, where opposite edges cancel; a surface is closed if
//! nothing is left. Instead of keeping the edges, each is turned into a random number of 64 bits that depends on its ends
//! alone, added for one direction and taken off for the other: the sum is zero if all edges cancel, and is not but by a
//! chance of 2^-64. Which numbers these are is drawn anew for each test, so that nobody makes a file whose edges
//! cancel by design.

use std::hash::{BuildHasher, Hasher, RandomState};

use crate::Face;
use crate::arrangement::{ExactFace, VertexKey, Vertices, cross};
use crate::store::exact::ExactBlock;
use spinney_base::{Progress, Result};

/// What the numbers of edges are drawn by: those of one test have one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seed(u64);

impl Seed {
    pub(crate) fn new() -> Seed {
        Seed(RandomState::new().build_hasher().finish())
    }

    fn number(self, words: &[u64]) -> u64 {
        words.iter().fold(self.0, |sum, word| mix(sum ^ word))
    }

    /// The number of an edge, whatever its direction, and whether it goes from the lesser end to the greater.
    fn edge(self, from: [i32; 3], to: [i32; 3]) -> (u64, bool) {
        let is_forward = from < to;
        let [a, b] = if is_forward { [from, to] } else { [to, from] };
        let pair = |a: i32, b: i32| u64::from(a as u32) << 32 | u64::from(b as u32);
        (self.number(&[pair(a[0], a[1]), pair(a[2], b[0]), pair(b[1], b[2])]), is_forward)
    }
}

/// A permutation of 64-bit numbers that looks random (the finaliser of Stafford, "Better bit mixing", variant 13).
#[inline]
fn mix(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// The edges of some faces, by which nothing is left where each is there as often in one direction as in the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Closure {
    seed: Seed,
    sum: u64,
}

impl Closure {
    /// None so far.
    pub(crate) fn new(seed: Seed) -> Closure {
        Closure { seed, sum: 0 }
    }

    /// Adds the edges of a face.
    pub(crate) fn add(&mut self, face: &Face<'_>) {
        for [from, to] in edges(face) {
            let (number, is_forward) = self.seed.edge(from, to);
            self.sum = self.sum.wrapping_add(if is_forward { number } else { number.wrapping_neg() });
        }
    }

    /// Takes off the edges of a face.
    fn remove(&mut self, face: &Face<'_>) {
        let sum = std::mem::replace(&mut self.sum, 0);
        self.add(face);
        self.sum = sum.wrapping_sub(self.sum);
    }

    /// Adds the edges of other faces, drawn by the same seed.
    pub(crate) fn append(&mut self, other: Closure) {
        self.sum = self.sum.wrapping_add(other.sum);
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.sum == 0
    }
}

/// The edges of a surface of which some faces have corners beside the grid, and vertices may lie on edges of others.
///
/// Along a line, edges cancel if each point of it is as often the end of one as the beginning: so it is the ends that have
/// numbers, each with the direction of its edge.
pub(crate) struct ExactClosure {
    seed: Seed,
    sum: u64,
    vertices: Vertices,
}

impl ExactClosure {
    /// None so far.
    pub(crate) fn new(seed: Seed) -> ExactClosure {
        ExactClosure { seed, sum: 0, vertices: Vertices::default() }
    }

    /// Adds the edges of a face with corners on the grid.
    pub(crate) fn add(&mut self, face: &Face<'_>) {
        for [from, to] in edges(face) {
            let along = [0, 1, 2].map(|axis| i128::from(to[axis]) - i128::from(from[axis]));
            self.add_edge(along, (from, 0), (to, 0));
        }
    }

    /// Adds the edges of a face with corners beside it.
    pub(crate) fn add_exact(&mut self, face: &ExactFace) {
        for (corner, next) in face.edges() {
            let [from, to] = [&corner.point, next].map(|point| self.vertices.key(point));
            self.add_edge(cross(face.plane.normal, corner.line.normal), from, to);
        }
    }

    /// Adds the edges of a block of faces with corners beside the grid. What is wrong with it is told in words.
    pub(crate) fn add_block(&mut self, block: &ExactBlock<'_>) -> Result<(), String> {
        let keys: Vec<VertexKey> = block.points()?.iter().map(|point| self.vertices.key(point)).collect();
        let mut missing = None;
        block.each_edge(&mut |plane, line, ends| match ends.map(|end| keys.get(end).copied()) {
            [Some(from), Some(to)] => self.add_edge(cross(plane.normal, line.normal), from, to),
            _ => missing = Some(ends),
        })?;
        missing.map_or(Ok(()), |ends| Err(format!("an edge between the vertices {ends:?} of {}", keys.len())))
    }

    /// Takes off what an addition adds.
    fn remove(&mut self, add: impl FnOnce(&mut ExactClosure)) {
        let sum = std::mem::replace(&mut self.sum, 0);
        add(self);
        self.sum = sum.wrapping_sub(self.sum);
    }

    fn add_edge(&mut self, along: [i128; 3], from: ([i32; 3], u32), to: ([i32; 3], u32)) {
        let divisor = along.into_iter().fold(0, |divisor, part| divide_out(divisor, part.unsigned_abs()));
        let Some(first) = along.into_iter().find(|part| *part != 0) else { return };
        let along = along.map(|part| part / divisor as i128 * first.signum());
        let words = along.map(|part| [part as u64, (part >> 64) as u64]);
        let line = self.seed.number(words.as_flattened());
        let end = |(at, number): ([i32; 3], u32)| {
            let [x, y, z] = at.map(|at| u64::from(at as u32));
            Seed(line).number(&[x << 32 | y, z << 32 | u64::from(number)])
        };
        self.sum = self.sum.wrapping_add(end(to)).wrapping_sub(end(from));
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.sum == 0
    }
}

/// The greatest common divisor.
fn divide_out(mut a: u128, mut b: u128) -> u128 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// The edges of a face that have a length.
pub(crate) fn edges<'a>(face: &Face<'a>) -> impl Iterator<Item = [[i32; 3]; 2]> + use<'a> {
    let of_ring = |ring: &'a [[i32; 3]]| (0..ring.len()).map(|i| [ring[i], ring[(i + 1) % ring.len()]]);
    face.rings().flat_map(of_ring).filter(|[from, to]| from != to)
}

/// The edges of a whole surface, of which some faces may have corners beside the grid and others stand in for these.
pub(crate) struct SurfaceClosure {
    /// Of the faces in the octree.
    closure: Closure,
    /// Of the exact surface, where it is another one.
    exact: Option<ExactClosure>,
    /// The first flaw of a face with corners beside the grid.
    flaw: Option<&'static str>,
}

impl SurfaceClosure {
    /// None so far.
    pub(crate) fn new(is_exact: bool) -> SurfaceClosure {
        let seed = Seed::new();
        let exact = is_exact.then(|| ExactClosure::new(seed));
        SurfaceClosure { closure: Closure::new(seed), exact, flaw: None }
    }

    /// Adds a face of the octree, which may stand in for exact ones.
    pub(crate) fn add(&mut self, face: &Face<'_>, is_proxy: bool) {
        self.closure.add(face);
        if let Some(exact) = self.exact.as_mut().filter(|_| !is_proxy) {
            exact.add(face);
        }
    }

    /// Takes a face of the octree off another surface that is closed, whose other faces are not added.
    pub(crate) fn remove(&mut self, face: &Face<'_>, is_proxy: bool) {
        self.closure.remove(face);
        if let Some(exact) = self.exact.as_mut().filter(|_| !is_proxy) {
            exact.remove(|exact| exact.add(face));
        }
    }

    /// Takes a face with corners beside the grid off such a surface.
    pub(crate) fn remove_exact(&mut self, face: &ExactFace) {
        if let Some(exact) = &mut self.exact {
            exact.remove(|exact| exact.add_exact(face));
        }
    }

    /// Adds a face with corners beside the grid.
    ///
    /// # Errors
    /// On interruption.
    pub(crate) fn add_exact(&mut self, face: &ExactFace, progress: &dyn Progress) -> Result<()> {
        self.flaw = self.flaw.or(face.flaw(progress)?);
        if let Some(exact) = &mut self.exact {
            exact.add_exact(face);
        }
        Ok(())
    }

    /// The flaw of the surface, in words, if it is not closed, or some of its exact faces are none.
    pub(crate) fn flaw(self) -> Option<&'static str> {
        let is_closed = self.closure.is_closed() && self.exact.is_none_or(|exact| exact.is_closed());
        self.flaw.or((!is_closed).then_some("edges that have a face on one side only"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn face(points: &[[i32; 3]]) -> Face<'_> {
        Face { number: 0, points, ring_ends: &[3], colours: &[], part: 0, source: 0 }
    }

    fn are_closed(triangles: &[[[i32; 3]; 3]]) -> [bool; 2] {
        let seed = Seed::new();
        let (mut edges, mut lines) = (Closure::new(seed), ExactClosure::new(seed));
        for points in triangles {
            edges.add(&face(points));
            lines.add(&face(points));
        }
        [edges.is_closed(), lines.is_closed()]
    }

    #[test]
    fn tells_closed_from_turned_from_open() {
        let [a, b, c, d, on] = [[0, 0, 0], [8, 0, 0], [0, 8, 0], [0, 0, 8], [3, 0, 0]];
        let tetrahedron = [[a, c, b], [a, b, d], [b, c, d], [c, a, d]];
        assert_eq!(are_closed(&tetrahedron), [true; 2]);
        let mut turned = tetrahedron;
        turned[1].swap(0, 1);
        assert_eq!(are_closed(&turned), [false; 2]);
        assert_eq!(are_closed(&tetrahedron[..3]), [false; 2]);
        assert_eq!(are_closed(&[&tetrahedron[..], &tetrahedron[..1]].concat()), [false; 2]);
        // A vertex on an edge leaves no part of it open.
        let cut = [[a, c, b], [a, on, d], [on, b, d], [b, c, d], [c, a, d]];
        assert_eq!(are_closed(&cut), [false, true]);
        assert_eq!(are_closed(&[&cut[..], &[[a, b, on]]].concat()), [true; 2]);
        let moved = [[a, c, b], [a, [3, 1, 0], d], [[3, 1, 0], b, d], [b, c, d], [c, a, d]];
        assert_eq!(are_closed(&moved), [false; 2]);
    }
}
