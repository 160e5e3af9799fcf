//! Probabilistic test whether a surface is closed, in one pass and constant memory.
//!
//! The boundary of a surface is the sum of its faces' directed edges, where opposite edges cancel.
//! A surface is closed if that sum is empty. The test does not keep the edges: it hashes each
//! edge's ends to a 64-bit number, which is added for one direction and subtracted for the other.
//! The sum is zero if all edges cancel; otherwise, it is zero with a probability of 2^-64. Every
//! test draws a new random seed, so that an untrusted file cannot contain edges whose hashes cancel
//! by design.

use std::hash::{BuildHasher, Hasher, RandomState};

use crate::Face;
use crate::arrangement::{ExactFace, ExactPoint, MODULUS, VertexKey, Vertices, cross};
use crate::store::exact::ExactBlock;
use spinney_base::{Progress, Result};

/// Seed of a test's edge hashes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seed(u64);

impl Seed {
    pub(crate) fn new() -> Seed {
        Seed(RandomState::new().build_hasher().finish())
    }

    fn number(self, words: &[u64]) -> u64 {
        words.iter().fold(self.0, |sum, word| mix(sum ^ word))
    }

    /// Returns the hash of an undirected edge, and whether the edge is directed from its lesser end
    /// to the greater.
    pub(crate) fn edge(self, from: [i32; 3], to: [i32; 3]) -> (u64, bool) {
        let is_forward = from < to;
        let [a, b] = if is_forward { [from, to] } else { [to, from] };
        let pair = |a: i32, b: i32| u64::from(a as u32) << 32 | u64::from(b as u32);
        (self.number(&[pair(a[0], a[1]), pair(a[2], b[0]), pair(b[1], b[2])]), is_forward)
    }
}

/// A bijective hash of 64-bit integers (Stafford, "Better bit mixing", variant 13).
#[inline]
fn mix(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// The sum of directed edges; it is zero if every edge occurs as often in one direction as in the
/// other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Closure {
    seed: Seed,
    sum: u64,
}

impl Closure {
    /// Creates an empty sum.
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

    /// Subtracts the edges of a face.
    fn remove(&mut self, face: &Face<'_>) {
        let sum = std::mem::replace(&mut self.sum, 0);
        self.add(face);
        self.sum = sum.wrapping_sub(self.sum);
    }

    /// Adds another sum with the same seed.
    pub(crate) fn append(&mut self, other: Closure) {
        self.sum = self.sum.wrapping_add(other.sum);
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.sum == 0
    }
}

/// The sum of the edges of a surface with off-grid vertices, where vertices may be inside of other
/// faces' edges.
///
/// The edges on a line cancel if each point of the line is the end of as many edges as it is the
/// start of. So the ends are hashed instead of the edges, each with the direction of its edge.
pub(crate) struct ExactClosure {
    seed: Seed,
    sum: u64,
    vertices: Vertices,
}

impl ExactClosure {
    /// Creates an empty sum.
    pub(crate) fn new(seed: Seed) -> ExactClosure {
        ExactClosure { seed, sum: 0, vertices: Vertices::default() }
    }

    /// Adds the edges of a face with all vertices on the grid.
    pub(crate) fn add(&mut self, face: &Face<'_>) {
        for [from, to] in edges(face) {
            let along = [0, 1, 2].map(|axis| i128::from(to[axis]) - i128::from(from[axis]));
            self.add_edge(along, (from, 0), (to, 0));
        }
    }

    /// Adds the edges of a face with off-grid vertices.
    pub(crate) fn add_exact(&mut self, face: &ExactFace) {
        for (corner, next) in face.edges() {
            let [from, to] = [&corner.point, next].map(|point| self.vertices.key(point));
            self.add_edge(cross(face.plane.normal, corner.line.normal), from, to);
        }
    }

    /// Adds the edges of a block of faces with off-grid vertices. Errors describe the flaw of an
    /// invalid block.
    pub(crate) fn add_block(&mut self, block: &ExactBlock<'_>) -> Result<(), String> {
        let keys: Vec<VertexKey> = block.points()?.iter().map(|point| self.vertices.key(point)).collect();
        let mut missing = None;
        block.each_edge(&mut |plane, line, ends| match ends.map(|end| keys.get(end).copied()) {
            [Some(from), Some(to)] => self.add_edge(cross(plane.normal, line.normal), from, to),
            _ => missing = Some(ends),
        })?;
        missing.map_or(Ok(()), |ends| Err(format!("an edge between the vertices {ends:?} of {}", keys.len())))
    }

    /// Subtracts what `add` adds.
    fn remove(&mut self, add: impl FnOnce(&mut ExactClosure)) {
        let sum = std::mem::replace(&mut self.sum, 0);
        add(self);
        self.sum = sum.wrapping_sub(self.sum);
    }

    fn add_edge(&mut self, along: [i128; 3], from: ([i32; 3], u32), to: ([i32; 3], u32)) {
        let Some(along) = direction(along) else { return };
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

/// Fraction bits of hashed coordinates.
const FRACTION_BITS: u32 = 32;

/// Edge hashes for the same test as [`ExactClosure`], without memory for vertices. Off-grid
/// vertices are hashed by their coordinates, rounded to fractions of a grid unit, and by residues
/// of the exact ones. A surface is closed if the sum of its faces' hashes is zero.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EdgeHashes(Seed);

impl EdgeHashes {
    pub(crate) fn new() -> EdgeHashes {
        EdgeHashes(Seed::new())
    }

    /// Returns the hash of the edges of a face with all vertices on the grid.
    pub(crate) fn of_face(self, face: &Face<'_>) -> u64 {
        let mut sum = 0u64;
        for ends in edges(face) {
            let [from, to] = ends.map(|end| end.map(i64::from));
            let Some(along) = short_direction([0, 1, 2].map(|axis| to[axis] - from[axis])) else { continue };
            let line = Seed(self.0.number(&along.map(|part| part as u64)));
            let [from, to] = [from, to].map(|end| line.number(&end.map(|at| at as u64)));
            sum = sum.wrapping_add(to).wrapping_sub(from);
        }
        sum
    }

    /// Returns the hash of the edges of a face with off-grid vertices.
    pub(crate) fn of_exact(self, face: &ExactFace) -> u64 {
        let mut sum = 0u64;
        let mut ends: Vec<HashedPoint> = Vec::new();
        for ring in face.rings() {
            ends.clear();
            ends.extend(ring.iter().map(|corner| HashedPoint::of(&corner.point)));
            for (index, corner) in ring.iter().enumerate() {
                let Some(along) = direction(cross(face.plane.normal, corner.line.normal)) else { continue };
                // Invariant: a direction or a point has one hash, whether it is that of a face on
                // the grid or not. Otherwise edges of both would not cancel.
                let line = match along.map(i64::try_from) {
                    [Ok(x), Ok(y), Ok(z)] => self.0.number(&[x, y, z].map(|part| part as u64)),
                    _ => self.0.number(along.map(|part| [part as u64, (part >> 64) as u64]).as_flattened()),
                };
                let line = Seed(line);
                let [from, to] = [index, (index + 1) % ends.len()].map(|end| ends[end].number(line));
                sum = sum.wrapping_add(to).wrapping_sub(from);
            }
        }
        sum
    }
}

/// Words of a point that are hashed.
enum HashedPoint {
    OnGrid([u64; 3]),
    OffGrid([u64; 6]),
}

impl HashedPoint {
    fn of(point: &ExactPoint) -> HashedPoint {
        if let Some(at) = point.on_grid() {
            return HashedPoint::OnGrid(at.map(|at| i64::from(at) as u64));
        }
        let (fixed, residues) = (point.fixed(FRACTION_BITS), point.residues());
        let at = fixed.map(|at| at >> FRACTION_BITS);
        let is_on_grid = at.map(|at| at << FRACTION_BITS) == fixed
            && at.iter().zip(&residues).all(|(at, residue)| at.rem_euclid(MODULUS) == *residue);
        if is_on_grid {
            return HashedPoint::OnGrid(at.map(|at| at as u64));
        }
        let [[x, y, z], [u, v, w]] = [fixed, residues].map(|at| at.map(|at| at as u64));
        HashedPoint::OffGrid([x, y, z, u, v, w])
    }

    /// Returns the hash of the point as the end of an edge along a line.
    fn number(&self, line: Seed) -> u64 {
        match self {
            HashedPoint::OnGrid(words) => line.number(words),
            HashedPoint::OffGrid(words) => line.number(words),
        }
    }
}

/// Returns the shortest integer vector along a line; `None` for a vector without length. Opposite
/// vectors have the same one.
fn direction(along: [i128; 3]) -> Option<[i128; 3]> {
    if let [Ok(x), Ok(y), Ok(z)] = along.map(i64::try_from)
        && [x, y, z].iter().all(|part| *part != i64::MIN)
    {
        return short_direction([x, y, z]).map(|along| along.map(i128::from));
    }
    let divisor = along.into_iter().fold(0, |divisor, part| divide_out(divisor, part.unsigned_abs()));
    let first = along.into_iter().find(|part| *part != 0)?;
    Some(along.map(|part| part / divisor as i128 * first.signum()))
}

/// Does the same as [`direction`] for numbers of one word, none of which is the smallest.
fn short_direction(along: [i64; 3]) -> Option<[i64; 3]> {
    let divisor = along.into_iter().fold(0, |divisor, part| short_divisor(divisor, part.unsigned_abs()));
    let first = along.into_iter().find(|part| *part != 0)?;
    Some(along.map(|part| part / divisor as i64 * first.signum()))
}

/// Returns the GCD of two numbers of one word.
fn short_divisor(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// Returns the GCD of two numbers.
fn divide_out(mut a: u128, mut b: u128) -> u128 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// Returns the edges of a face that have a length.
pub(crate) fn edges<'a>(face: &Face<'a>) -> impl Iterator<Item = [[i32; 3]; 2]> + use<'a> {
    let of_ring = |ring: &'a [[i32; 3]]| (0..ring.len()).map(|i| [ring[i], ring[(i + 1) % ring.len()]]);
    face.rings().flat_map(of_ring).filter(|[from, to]| from != to)
}

/// The closure test of a whole surface, in which some faces may be proxies for faces with off-grid
/// vertices.
pub(crate) struct SurfaceClosure {
    /// Sum over the faces in the octree.
    closure: Closure,
    /// Sum over the exact surface, if it differs from the faces in the octree.
    exact: Option<ExactClosure>,
    /// The first flaw of a face with off-grid vertices.
    flaw: Option<&'static str>,
}

impl SurfaceClosure {
    /// Creates an empty test.
    pub(crate) fn new(is_exact: bool) -> SurfaceClosure {
        let seed = Seed::new();
        let exact = is_exact.then(|| ExactClosure::new(seed));
        SurfaceClosure { closure: Closure::new(seed), exact, flaw: None }
    }

    /// Adds a face of the octree, which may be a proxy.
    pub(crate) fn add(&mut self, face: &Face<'_>, is_proxy: bool) {
        self.closure.add(face);
        if let Some(exact) = self.exact.as_mut().filter(|_| !is_proxy) {
            exact.add(face);
        }
    }

    /// Subtracts a face of the octree. Used to test the change of a closed surface, whose unchanged
    /// faces are not added.
    pub(crate) fn remove(&mut self, face: &Face<'_>, is_proxy: bool) {
        self.closure.remove(face);
        if let Some(exact) = self.exact.as_mut().filter(|_| !is_proxy) {
            exact.remove(|exact| exact.add(face));
        }
    }

    /// Subtracts a face with off-grid vertices.
    pub(crate) fn remove_exact(&mut self, face: &ExactFace) {
        if let Some(exact) = &mut self.exact {
            exact.remove(|exact| exact.add_exact(face));
        }
    }

    /// Adds a face with off-grid vertices.
    ///
    /// # Errors
    /// On cancellation.
    pub(crate) fn add_exact(&mut self, face: &ExactFace, progress: &dyn Progress) -> Result<()> {
        self.flaw = self.flaw.or(face.flaw(progress)?);
        if let Some(exact) = &mut self.exact {
            exact.add_exact(face);
        }
        Ok(())
    }

    /// Returns a description of the flaw if the surface is not closed, or an exact face is invalid.
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
        let (hashes, mut sum) = (EdgeHashes::new(), 0u64);
        for points in triangles {
            edges.add(&face(points));
            lines.add(&face(points));
            sum = sum.wrapping_add(hashes.of_face(&face(points)));
        }
        assert_eq!(sum == 0, lines.is_closed());
        [edges.is_closed(), lines.is_closed()]
    }

    #[test]
    fn closed_reversed_and_open_surfaces_are_distinguished() {
        let [a, b, c, d, on] = [[0, 0, 0], [8, 0, 0], [0, 8, 0], [0, 0, 8], [3, 0, 0]];
        let tetrahedron = [[a, c, b], [a, b, d], [b, c, d], [c, a, d]];
        assert_eq!(are_closed(&tetrahedron), [true; 2]);
        let mut turned = tetrahedron;
        turned[1].swap(0, 1);
        assert_eq!(are_closed(&turned), [false; 2]);
        assert_eq!(are_closed(&tetrahedron[..3]), [false; 2]);
        assert_eq!(are_closed(&[&tetrahedron[..], &tetrahedron[..1]].concat()), [false; 2]);
        // A vertex on an edge leaves no gap.
        let cut = [[a, c, b], [a, on, d], [on, b, d], [b, c, d], [c, a, d]];
        assert_eq!(are_closed(&cut), [false, true]);
        assert_eq!(are_closed(&[&cut[..], &[[a, b, on]]].concat()), [true; 2]);
        let moved = [[a, c, b], [a, [3, 1, 0], d], [[3, 1, 0], b, d], [b, c, d], [c, a, d]];
        assert_eq!(are_closed(&moved), [false; 2]);
    }
}
