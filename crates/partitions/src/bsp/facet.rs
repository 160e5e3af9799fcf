//! Convex polygons in planes, known by planes alone, so that no number grows however often they are cut.

use spinney_brep::{ExactPlane, ExactPoint};

/// An edge of a facet, which lies in a plane, its wall, besides that of the facet.
#[derive(Clone, Debug)]
pub(super) struct Edge {
    pub(super) wall: ExactPlane,
    pub(super) start: ExactPoint,
    /// The side of the triangle that it is a part of, if it is of one.
    pub(super) side: Option<u8>,
}

/// A convex polygon in a plane.
///
/// Invariant: walls are planes of what was given, or of the space's walls, and none is laid through a corner that was computed. So corners are
/// points of three planes through points of the grid, and the test on which side of another such plane one lies is exact
/// ([`ExactPlane::side`]), however many cuts came before.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    pub(super) plane: ExactPlane,
    /// In turn around it.
    pub(super) edges: Vec<Edge>,
}

impl Facet {
    /// The polygon of these corners, with the walls of the edges that begin there.
    pub(super) fn of_grid(plane: ExactPlane, edges: &[([i32; 3], ExactPlane)]) -> Facet {
        let edge = |&(start, wall): &([i32; 3], ExactPlane)| Edge {
            wall,
            start: ExactPoint::of_grid(start),
            side: None,
        };
        Facet { plane, edges: edges.iter().map(edge).collect() }
    }

    /// A triangle of the grid, in its plane.
    pub(super) fn of_triangle(plane: ExactPlane, corners: &[[i32; 3]; 3]) -> Facet {
        let axis = plane.main_axis();
        let edge = |i: usize| (corners[i], ExactPlane::along(axis, corners[i], corners[(i + 1) % 3]));
        let mut facet = Facet::of_grid(plane, &[0, 1, 2].map(edge));
        facet.edges.iter_mut().zip(0..).for_each(|(edge, side)| edge.side = Some(side));
        facet
    }

    /// The side of a plane on which each corner lies.
    pub(super) fn signs(&self, by: &ExactPlane) -> Vec<i32> {
        self.edges.iter().map(|edge| by.side(&edge.start)).collect()
    }

    /// The parts behind and in front of a plane; both are there if corners, of which the signs are given, lie on both sides.
    pub(super) fn cut(&self, by: &ExactPlane, signs: &[i32]) -> [Facet; 2] {
        let mut parts = [-1, 1].map(|side| (side, Facet { plane: self.plane, edges: Vec::new() }));
        for (i, edge) in self.edges.iter().enumerate() {
            let (at, next) = (signs[i], signs[(i + 1) % signs.len()]);
            let met = (at * next < 0).then(|| ExactPoint::of_planes([&self.plane, &edge.wall, by]));
            for (side, part) in &mut parts {
                // The edge is in this part from its start, from where it comes in, or not; where a part is left, its edge in the plane begins.
                if at * *side > 0 || (at == 0 && next * *side > 0) {
                    part.edges.push(edge.clone());
                }
                let (leaves, enters) = (next * *side < 0, next * *side > 0);
                match met {
                    Some(start) if leaves => part.edges.push(Edge { wall: *by, start, side: None }),
                    Some(start) if enters => part.edges.push(Edge { start, ..edge.clone() }),
                    None if at == 0 && leaves => {
                        part.edges.push(Edge { wall: *by, start: edge.start, side: None })
                    }
                    _ => {}
                }
            }
        }
        parts.map(|(_, part)| part)
    }

    /// The rest without another facet of the plane.
    pub(super) fn without(self, other: &Facet) -> Vec<Facet> {
        let (mut left, mut within) = (Vec::new(), self.clone());
        for Edge { wall, .. } in &other.edges {
            let signs = within.signs(wall);
            let is_before = sides(&other.signs(wall))[1];
            match sides(&signs) {
                [true, true] => {
                    let [behind, before] = within.cut(wall, &signs);
                    let (other_side, same_side) = if is_before { (behind, before) } else { (before, behind) };
                    left.push(other_side);
                    within = same_side;
                }
                [_, on_before] if on_before != is_before => return vec![self],
                _ => {}
            }
        }
        left
    }
}

/// Whether any of these corners lies behind a plane, and whether any lies in front of it.
pub(super) fn sides(signs: &[i32]) -> [bool; 2] {
    [signs.contains(&-1), signs.contains(&1)]
}
