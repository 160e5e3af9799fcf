//! Test whether triangles form a closed surface, in one pass and constant memory.
//!
//! The boundary of a surface is the sum of its triangles' directed edges, where opposite edges
//! cancel. A surface is closed if its boundary is empty. Instead of storing edges, each edge is
//! hashed to a 64-bit number that depends only on its ends. The number is added for one direction
//! and subtracted for the other. The sum is zero if all edges cancel; otherwise it is zero only
//! with probability 2^-64. Similarly, the exclusive or, which ignores direction, shows whether
//! every edge occurs an even number of times.

/// Boundary of the triangles that were added.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::import) struct Closure {
    directed: u64,
    undirected: u64,
}

impl Closure {
    /// Adds a triangle.
    pub(super) fn add(&mut self, [a, b, c]: [[i32; 3]; 3]) {
        self.add_edge(a, b);
        self.add_edge(b, c);
        self.add_edge(c, a);
    }

    /// Adds an edge of a face.
    #[inline]
    pub(in crate::import) fn add_edge(&mut self, from: [i32; 3], to: [i32; 3]) {
        if from == to {
            return;
        }
        let (number, is_forward) = edge_number(from, to);
        self.directed = self.directed.wrapping_add(if is_forward { number } else { number.wrapping_neg() });
        self.undirected ^= number;
    }

    /// Adds the edges of another surface.
    pub(in crate::import) fn append(&mut self, other: &Closure) {
        self.directed = self.directed.wrapping_add(other.directed);
        self.undirected ^= other.undirected;
    }

    /// Whether every edge has its opposite. Winding numbers are then exact integers.
    pub(in crate::import) fn is_closed(&self) -> bool {
        self.directed == 0
    }

    /// Whether every edge occurs an even number of times, in any direction. Counting crossings by
    /// parity is then exact.
    pub(super) fn is_even(&self) -> bool {
        self.undirected == 0
    }
}

/// Hash of an edge, independent of its direction, and whether the edge runs from the smaller end to
/// the greater one.
pub(in crate::import) fn edge_number(from: [i32; 3], to: [i32; 3]) -> (u64, bool) {
    let is_forward = from < to;
    (if is_forward { number(from, to) } else { number(to, from) }, is_forward)
}

fn number(from: [i32; 3], to: [i32; 3]) -> u64 {
    let pair = |a: i32, b: i32| u64::from(a as u32) << 32 | u64::from(b as u32);
    [pair(from[0], from[1]), pair(from[2], to[0]), pair(to[1], to[2])]
        .into_iter()
        .fold(0, |sum, word| mix(sum ^ word))
}

/// Pseudorandom permutation of 64-bit numbers (finalizer of Stafford, "Better bit mixing", variant
/// 13).
fn mix(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: [i32; 3] = [0, 0, 0];
    const B: [i32; 3] = [8, 0, 0];
    const C: [i32; 3] = [0, 8, 0];
    const D: [i32; 3] = [0, 0, 8];

    fn of(triangles: &[[[i32; 3]; 3]]) -> Closure {
        let mut closure = Closure::default();
        triangles.iter().for_each(|triangle| closure.add(*triangle));
        closure
    }

    #[test]
    fn closed_flipped_and_open_surfaces_are_distinguished() {
        let tetrahedron = [[A, C, B], [A, B, D], [B, C, D], [C, A, D]];
        assert!(of(&tetrahedron).is_closed() && of(&tetrahedron).is_even());
        let mut flipped = tetrahedron;
        flipped[1].swap(0, 1);
        assert!(!of(&flipped).is_closed() && of(&flipped).is_even());
        assert!(!of(&tetrahedron[..3]).is_closed() && !of(&tetrahedron[..3]).is_even());
        let doubled = [&tetrahedron[..], &tetrahedron[..1]].concat();
        assert!(!of(&doubled).is_closed() && !of(&doubled).is_even());
        // Degenerate triangles have no boundary.
        assert!(of(&[[A, A, B], [A, B, B], [C, C, C]]).is_closed());
    }
}
