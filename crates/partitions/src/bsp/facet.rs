//! Convex polygons in planes. They are represented by input planes only, so that numbers do not
//! grow with the number of cuts.

use spinney_brep::{ExactPlane, ExactPoint};

/// Edge of a facet: the intersection of the facet's plane with another plane, the wall.
#[derive(Clone, Debug)]
pub(super) struct Edge {
    pub(super) wall: ExactPlane,
    pub(super) start: ExactPoint,
    /// Side of the input triangle that the edge lies on, if any.
    pub(super) side: Option<u8>,
}

/// Convex polygon in a plane.
///
/// Invariant: walls are planes of the input or of the domain's box; none is constructed from a
/// computed vertex. So vertices are intersections of three planes through grid points, and the test
/// for the side of another such plane is exact ([`ExactPlane::side`]), after any number of cuts.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    pub(super) plane: ExactPlane,
    /// Edges in order around the facet.
    pub(super) edges: Vec<Edge>,
}

impl Facet {
    /// Polygon of grid points, each with the wall of the edge that starts there.
    pub(super) fn of_grid(plane: ExactPlane, edges: &[([i32; 3], ExactPlane)]) -> Facet {
        let edge = |&(start, wall): &([i32; 3], ExactPlane)| Edge {
            wall,
            start: ExactPoint::of_grid(start),
            side: None,
        };
        Facet { plane, edges: edges.iter().map(edge).collect() }
    }

    /// Triangle of grid points, in its plane.
    pub(super) fn of_triangle(plane: ExactPlane, corners: &[[i32; 3]; 3]) -> Facet {
        let axis = plane.main_axis();
        let edge = |i: usize| (corners[i], ExactPlane::along(axis, corners[i], corners[(i + 1) % 3]));
        let mut facet = Facet::of_grid(plane, &[0, 1, 2].map(edge));
        facet.edges.iter_mut().zip(0..).for_each(|(edge, side)| edge.side = Some(side));
        facet
    }

    /// Side of a plane on which each vertex lies: -1, 0 or 1.
    pub(super) fn signs(&self, by: &ExactPlane) -> Vec<i32> {
        self.edges.iter().map(|edge| by.side(&edge.start)).collect()
    }

    /// Fragments at the back and in front of a plane, given the signs of the vertices. Both are
    /// non-empty if vertices lie on both sides.
    pub(super) fn cut(&self, by: &ExactPlane, signs: &[i32]) -> [Facet; 2] {
        let mut parts = [-1, 1].map(|side| (side, Facet { plane: self.plane, edges: Vec::new() }));
        for (i, edge) in self.edges.iter().enumerate() {
            let (at, next) = (signs[i], signs[(i + 1) % signs.len()]);
            let met = (at * next < 0).then(|| ExactPoint::of_planes([&self.plane, &edge.wall, by]));
            for (side, part) in &mut parts {
                // A fragment contains the edge from its start, or from where it enters. Where an
                // edge leaves the fragment, the fragment's edge in the plane starts.
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

    /// Subtracts another facet of the same plane.
    pub(super) fn without(self, other: &Facet) -> Vec<Facet> {
        let (mut left, mut within) = (Vec::new(), self.clone());
        for Edge { wall, .. } in &other.edges {
            let signs = within.signs(wall);
            let is_front = sides(&other.signs(wall))[1];
            match sides(&signs) {
                [true, true] => {
                    let [back, front] = within.cut(wall, &signs);
                    let (other_side, same_side) = if is_front { (back, front) } else { (front, back) };
                    left.push(other_side);
                    within = same_side;
                }
                [_, on_front] if on_front != is_front => return vec![self],
                _ => {}
            }
        }
        left
    }
}

/// Whether any vertex is at the back of a plane, and whether any is in front of it.
pub(super) fn sides(signs: &[i32]) -> [bool; 2] {
    [signs.contains(&-1), signs.contains(&1)]
}
