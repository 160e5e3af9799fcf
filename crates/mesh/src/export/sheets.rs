//! Sheets: components of a smooth surface in the cube between eight neighbouring cell centres. Each
//! sheet has its own vertex, so that the surface has no edge or vertex where it touches itself
//! (Schaefer, Ju and Warren, "Manifold dual contouring", 2007).
//!
//! On a face with a saddle, the two solid cells are connected by default. A sheet may then cross a
//! face twice. If a sheet of the adjacent cube also crosses that face twice, the edge between their
//! vertices would have four faces. In this case the solid cells on that face are separated, which
//! makes two sheets of each. (A cube whose sheet crosses a face twice has no other saddle, so no
//! other face changes.)

use super::isosurfaces::cube::{EDGES, rings_between};

/// Sheets of a cube.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sheets {
    pub(super) count: u8,
    /// Sheet that crosses each edge, indexed by the axis times eight plus the edge's first corner.
    pub(super) of_edge: [u8; EDGES],
    /// Face that a sheet crosses twice.
    pub(super) pinched: Option<usize>,
}

impl Sheets {
    /// Sheets of a cube, where `solid` has a bit per solid corner. `separated_face` is a face whose
    /// solid cells are not connected.
    pub(super) fn of(solid: u8, separated_face: Option<usize>) -> Sheets {
        let mut sheets = Sheets { count: 0, of_edge: [0; EDGES], pinched: None };
        let is_solid = std::array::from_fn(|corner| solid >> corner & 1 > 0);
        rings_between(
            is_solid,
            |face| Some(face) != separated_face,
            |ring| {
                for (axis, corner) in ring.edges() {
                    sheets.of_edge[axis * 8 + corner] = sheets.count;
                }
                sheets.count += 1;
                sheets.pinched = sheets.pinched.or(ring.pinched);
            },
        );
        sheets
    }

    /// Sheets of all cubes, by their solid corners.
    pub(super) fn all() -> Box<[Sheets]> {
        (0..=u8::MAX).map(|solid| Sheets::of(solid, None)).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::super::isosurfaces::cube::FACES;
    use super::*;

    /// Edges of a face, each with its index in the cube on the other side of the face.
    fn edges(face: usize) -> Vec<(usize, usize)> {
        let (across, beyond) = (face / 2, 1 << (face / 2));
        let of = |(a, b): (usize, usize)| {
            let (axis, first) = ((a ^ b).trailing_zeros() as usize, a & b);
            assert_ne!(axis, across);
            (axis * 8 + first, axis * 8 + (first ^ beyond))
        };
        let corners = FACES[face];
        (0..4).map(|side| of((corners[side], corners[(side + 1) % 4]))).collect()
    }

    #[test]
    fn no_two_sheets_meet_more_than_once_on_a_face() {
        let all = Sheets::all();
        // All pairs of cubes that share a face.
        for face in 0..6 {
            for cells in 0..1usize << 12 {
                let bit = |layer: usize, corner: usize| {
                    let [b, c] = [(face / 2 + 1) % 3, (face / 2 + 2) % 3];
                    cells >> (4 * layer + (corner >> b & 1) + 2 * (corner >> c & 1)) & 1
                };
                // Layers 0 to 2 along the axis; the face between the two cubes is in layer 1.
                let cube = |offset: usize| {
                    (0..8)
                        .map(|corner| bit(offset + (corner >> (face / 2) & 1), corner) << corner)
                        .sum::<usize>()
                };
                let (own, other) = if face & 1 > 0 { (cube(0), cube(1)) } else { (cube(1), cube(0)) };
                let is_split = all[own].pinched == Some(face) && all[other].pinched == Some(face ^ 1);
                let [mine, its] = match is_split {
                    true => [Sheets::of(own as u8, Some(face)), Sheets::of(other as u8, Some(face ^ 1))],
                    false => [all[own], all[other]],
                };
                if is_split {
                    assert!(mine.pinched.is_none() && its.pinched.is_none());
                }
                // Every crossed edge of the face has a quadrangle, which joins two sheets across
                // the face.
                let mut passed: HashMap<(u8, u8), usize> = HashMap::new();
                for (edge, opposite) in edges(face) {
                    let (axis, first) = (edge / 8, edge % 8);
                    if (own >> first ^ own >> (first | 1 << axis)) & 1 > 0 {
                        *passed.entry((mine.of_edge[edge], its.of_edge[opposite])).or_default() += 1;
                    }
                }
                assert!(
                    passed.values().all(|count| *count == 2),
                    "face {face}, cells {cells:012b}: {passed:?}"
                );
            }
        }
    }
}
