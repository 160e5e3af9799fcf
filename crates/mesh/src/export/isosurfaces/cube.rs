//! Marching cubes without a table: how a surface goes through the cube between the centres of eight neighbouring cells.
//!
//! On each face of a cube the surface is a line of marching squares, as in contours: an edge between a value below the level and one that is
//! not is crossed once, and a saddle belongs to the side of the level that the mean of its four values is on. The two cubes beside a
//! face so agree on its lines, and those of a cube's six faces close to rings.

/// Number of a cube's edges by which they are named: the axis times eight and the first corner. (Half of them are none.)
pub(in crate::export) const EDGES: usize = 24;

/// Stands for no edge.
const NONE: u8 = u8::MAX;

/// Corners of the faces, counterclockwise seen from outside: of those across the first axis the one before the cube, then the one behind it,
/// and so on. A corner's bits are the axes along which it is the second.
pub(in crate::export) const FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Edges that a piece of surface goes through, one after the other, counterclockwise seen from where values are lower.
#[derive(Clone, Copy)]
pub(in crate::export) struct Ring {
    edges: [u8; 12],
    count: usize,
    /// A face that it passes twice: points of it that are no neighbours lie on that face, where an edge between them could be one of the
    /// next cube, too.
    pub(in crate::export) pinched: Option<usize>,
}

impl Ring {
    /// The axis and the first corner of each edge.
    pub(in crate::export) fn edges(&self) -> impl ExactSizeIterator<Item = (usize, usize)> {
        self.edges[..self.count].iter().map(|edge| (usize::from(edge >> 3), usize::from(edge & 7)))
    }
}

/// Hands out the rings of a level through a cube with these numbers at its corners.
pub(super) fn rings(numbers: &[f64; 8], level: f64, each: impl FnMut(Ring)) {
    let is_high_saddle = |face: usize| mean(FACES[face].map(|corner| numbers[corner])) >= level;
    rings_between(numbers.map(|number| number >= level), is_high_saddle, each);
}

/// Hands out the rings between high corners of a cube and others; of a face with a saddle it is asked whether that is high.
pub(in crate::export) fn rings_between(
    is_high: [bool; 8],
    is_high_saddle: impl Fn(usize) -> bool,
    mut each: impl FnMut(Ring),
) {
    // The edge that comes after each, and the face between them.
    let mut next = [(NONE, 0); EDGES];
    for (face, corners) in FACES.iter().enumerate() {
        let high = |side: usize| is_high[corners[side % 4]];
        for start in (0..4).filter(|side| !high(*side) && high(*side + 1)) {
            // What is high is on the right of the line, which so goes on where high corners come to an end: the next ones, or in a saddle
            // that is high itself the last ones.
            let is_saddle = high(start) == high(start + 2) && high(start + 1) == high(start + 3);
            let step = if is_saddle && is_high_saddle(face) { 3 } else { 1 };
            let ends = (1..4).map(|steps| (start + steps * step) % 4);
            let end = { ends }.find(|side| high(*side) && !high(*side + 1)).unwrap_or(start);
            let edge = |side: usize| edge_between(corners[side], corners[(side + 1) % 4]);
            next[edge(start)] = (edge(end) as u8, face);
        }
    }
    for first in 0..EDGES {
        let mut ring = Ring { edges: [NONE; 12], count: 0, pinched: None };
        let (mut edge, mut passed) = (first, 0u8);
        while next[edge].0 != NONE {
            let (after, face) = std::mem::replace(&mut next[edge], (NONE, 0));
            ring.edges[ring.count] = edge as u8;
            ring.count += 1;
            if passed >> face & 1 > 0 {
                ring.pinched = Some(face);
            }
            passed |= 1 << face;
            edge = usize::from(after);
        }
        if ring.count > 0 {
            each(ring);
        }
    }
}

fn edge_between(a: usize, b: usize) -> usize {
    (a ^ b).trailing_zeros() as usize * 8 + (a & b)
}

/// Mean of a face's corners: the same to the last bit whichever way round they are, as long as the first is the same. (Quarters cannot
/// overflow.)
fn mean(numbers: [f64; 4]) -> f64 {
    let [a, b, c, d] = numbers.map(|number| 0.25 * number);
    (a + c) + (b + d)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn rings_pass_every_crossed_edge_once() {
        for case in 0..256usize {
            for high in [1.0, 4.0] {
                let numbers = std::array::from_fn(|corner| if case >> corner & 1 > 0 { high } else { -2.0 });
                let mut passed = HashSet::new();
                rings(&numbers, 0.0, |ring| {
                    assert!(ring.count >= 3);
                    for (axis, corner) in ring.edges() {
                        assert!(corner >> axis & 1 == 0 && passed.insert((axis, corner)));
                        assert_ne!(numbers[corner] >= 0.0, numbers[corner | 1 << axis] >= 0.0);
                    }
                });
                let edges = (0..3).flat_map(|axis| (0..8).map(move |corner| (axis, corner)));
                let crossed = edges
                    .filter(|(axis, corner)| corner >> axis & 1 == 0)
                    .filter(|(axis, corner)| (case >> corner ^ case >> (corner | 1 << axis)) & 1 > 0);
                assert_eq!(passed.len(), crossed.count(), "{case:08b}");
            }
        }
    }
}
