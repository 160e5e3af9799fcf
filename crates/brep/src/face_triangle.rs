//! Triangles of faces.

use std::collections::HashSet;

use crate::exact::normal::ring_normal;
use crate::geometry::Triangulator;

/// A triangle, with a flag for each edge that is not an edge of the original face.
#[derive(Clone, Copy, Debug)]
pub(super) struct FaceTriangle {
    pub(super) corners: [[i32; 3]; 3],
    pub(super) internal: [bool; 3],
}

impl FaceTriangle {
    /// Wraps a face that is a triangle.
    pub(super) fn of_triangle(corners: [[i32; 3]; 3]) -> FaceTriangle {
        FaceTriangle { corners, internal: [false; 3] }
    }

    /// Returns whether the triangle has an edge in this direction.
    pub(super) fn has_edge(&self, edge: [[i32; 3]; 2]) -> bool {
        let [a, b, c] = self.corners;
        [[a, b], [b, c], [c, a]].contains(&edge)
    }

    /// Returns whether an edge of the original face is an edge of the triangle, in this direction.
    pub(super) fn bounds(&self, edge: [[i32; 3]; 2]) -> bool {
        (0..3).any(|i| !self.internal[i] && edge == [self.corners[i], self.corners[(i + 1) % 3]])
    }

    /// Returns the triangles of a face, without those that have no area.
    pub(super) fn of_face(
        points: &[[i32; 3]],
        ring_ends: &[usize],
        triangulator: &mut Triangulator,
    ) -> Vec<FaceTriangle> {
        let wide: Vec<[i64; 3]> = points.iter().map(|point| point.map(i64::from)).collect();
        let mut cut = Vec::new();
        triangulator.triangulate(&wide, ring_ends, &mut cut);
        // Edges that occur in both directions are diagonals of the triangulation.
        let edges: HashSet<[u32; 2]> = cut.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        let triangle = |&[a, b, c]: &[u32; 3]| FaceTriangle {
            corners: [a, b, c].map(|corner| points[corner as usize]),
            internal: [[b, a], [c, b], [a, c]].map(|turned| edges.contains(&turned)),
        };
        cut.iter().map(triangle).filter(|triangle| ring_normal(&triangle.corners) != [0; 3]).collect()
    }
}
