//! Marching cubes without a table: how a surface crosses the cube between the centres of eight
//! neighbouring cells.
//!
//! On each face of a cube the surface is a line of marching squares, as in contours. An edge is
//! crossed once if one of its values is below the level and the other is not. A saddle is above or
//! below the level as the mean of its four values is. The two cubes that share a face therefore
//! agree on its lines, and the lines of a cube's six faces close to rings.

/// Size of tables indexed by cube edge: the axis times eight plus the first corner. (Half of the
/// indices are unused.)
pub(in crate::export) const EDGES: usize = 24;

/// Marker for no edge.
const NONE: u8 = u8::MAX;

/// Corners of the faces, counterclockwise seen from outside. Per axis, first the face on the lower
/// side, then the face on the upper side. A corner's bits are the axes along which it is the
/// second.
pub(in crate::export) const FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Cycle of edges that a connected component of the surface crosses, counterclockwise seen from the
/// lower values.
#[derive(Clone, Copy)]
pub(in crate::export) struct Ring {
    edges: [u8; 12],
    count: usize,
    /// Face that the ring crosses twice. Non-adjacent points of the ring lie on that face, and an
    /// edge between them might also be an edge of the cube on the other side.
    pub(in crate::export) pinched: Option<usize>,
}

impl Ring {
    /// Axis and first corner of each edge.
    pub(in crate::export) fn edges(&self) -> impl ExactSizeIterator<Item = (usize, usize)> {
        self.edges[..self.count].iter().map(|edge| (usize::from(edge >> 3), usize::from(edge & 7)))
    }
}

/// Passes the rings of a level through a cube with these corner values to `each`.
pub(super) fn rings(numbers: &[f64; 8], level: f64, each: impl FnMut(Ring)) {
    let is_high_saddle = |face: usize| mean(FACES[face].map(|corner| numbers[corner])) >= level;
    rings_between(numbers.map(|number| number >= level), is_high_saddle, each);
}

/// Passes the rings between high and low corners of a cube to `each`. `is_high_saddle` decides
/// whether a face with a saddle is high.
pub(in crate::export) fn rings_between(
    is_high: [bool; 8],
    is_high_saddle: impl Fn(usize) -> bool,
    mut each: impl FnMut(Ring),
) {
    // Next edge of each edge, and the face between them.
    let mut next = [(NONE, 0); EDGES];
    for (face, corners) in FACES.iter().enumerate() {
        let high = |side: usize| is_high[corners[side % 4]];
        for start in (0..4).filter(|side| !high(*side) && high(*side + 1)) {
            // High values are on the right of the line. It leaves the face where the run of high
            // corners ends: the adjacent run, or in a high saddle the opposite one.
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

/// Mean of a face's corners, bitwise equal for both orientations if the first corner is the same.
/// (Quarters cannot overflow.)
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
