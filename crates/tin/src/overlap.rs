//! Overlaps of triangles in the plane.

use crate::mesh::{Lines, Mesh, NONE, side};
use spinney_base::{Error, Result};

/// Fails if triangles, which are counterclockwise, overlap. Vertices may be on edges of other
/// triangles.
///
/// A constrained triangulation of all edges decides that: edges that cross are found when they are
/// added. Otherwise each triangle consists of faces of that triangulation, and no face may belong
/// to two. Exact; takes the time of a triangulation.
///
/// # Errors
/// If triangles overlap; if a coordinate is too large, too small or NaN.
pub(crate) fn check_overlaps(points: &[[f64; 2]], triangles: &[[u32; 3]]) -> Result<()> {
    let overlap = |found: String| Error::invalid("surface", found, "one height per position");
    let mut edges: Vec<[u32; 2]> = triangles
        .iter()
        .flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let faces =
        Mesh::new(points, &Lines { breaklines: &edges, outlines: &[] }).map_err(|error| match error {
            Error::Invalid { what, found, .. } if what == "breaklines" => {
                overlap(format!("triangles with edges that cross: {found}"))
            }
            error => error,
        })?;
    let around = FacesOfVertices::of(&faces);
    let mut owners = vec![NONE; faces.triangles.len()];
    let mut open = Vec::new();
    for (number, corners) in (0u32..).zip(triangles) {
        let first = around.of_vertex(corners[0]).iter().copied();
        open.extend(first.filter(|face| is_in_wedge(&faces, *face, *corners)));
        while let Some(face) = open.pop() {
            let owner = &mut owners[face as usize];
            if *owner == number {
                continue;
            }
            if *owner != NONE {
                let [x, y] = points[corners[0] as usize];
                return Err(overlap(format!("triangles that overlap, one of them at {x}, {y}")));
            }
            *owner = number;
            let own = faces.triangles[face as usize];
            for edge in 0..3 {
                let beyond = faces.neighbours[face as usize][edge];
                let is_at_border = is_on_border(points, [own[edge], own[(edge + 1) % 3]], *corners);
                if beyond != NONE && !is_at_border {
                    open.push(beyond);
                }
            }
        }
    }
    Ok(())
}

/// The faces at each vertex.
struct FacesOfVertices {
    /// Index of the first face of each vertex, and the end.
    starts: Vec<usize>,
    faces: Vec<u32>,
}

impl FacesOfVertices {
    fn of(mesh: &Mesh) -> FacesOfVertices {
        let mut starts = vec![0; mesh.points.len() + 1];
        mesh.triangles.iter().flatten().for_each(|corner| starts[*corner as usize + 1] += 1);
        for at in 1..starts.len() {
            starts[at] += starts[at - 1];
        }
        let (mut next, mut faces) = (starts.clone(), vec![NONE; 3 * mesh.triangles.len()]);
        for (face, corners) in (0u32..).zip(&mesh.triangles) {
            for corner in corners {
                faces[next[*corner as usize]] = face;
                next[*corner as usize] += 1;
            }
        }
        FacesOfVertices { starts, faces }
    }

    fn of_vertex(&self, vertex: u32) -> &[u32] {
        &self.faces[self.starts[vertex as usize]..self.starts[vertex as usize + 1]]
    }
}

/// Whether a face at the first vertex of a triangle is between the triangle's edges there.
fn is_in_wedge(mesh: &Mesh, face: u32, [a, b, c]: [u32; 3]) -> bool {
    let own = mesh.triangles[face as usize];
    let first = own.iter().position(|corner| *corner == a).unwrap_or(0);
    let at = |vertex: u32| mesh.points[vertex as usize];
    let [a, b, c] = [a, b, c].map(at);
    let [from, to] = [1, 2].map(|next| at(own[(first + next) % 3]));
    let is_left = side(a, b, from) >= 0.0 && side(a, b, to) > 0.0;
    is_left && side(a, c, from) < 0.0 && side(a, c, to) <= 0.0
}

/// Whether an edge is on an edge of a triangle.
fn is_on_border(points: &[[f64; 2]], ends: [u32; 2], [a, b, c]: [u32; 3]) -> bool {
    let at = |vertex: u32| points[vertex as usize];
    let is_on = |[a, b]: [u32; 2]| ends.iter().all(|end| side(at(a), at(b), at(*end)) == 0.0);
    [[a, b], [b, c], [c, a]].into_iter().any(is_on)
}

#[cfg(test)]
mod tests {
    use crate::tests::random;
    use crate::tin::Tin;

    /// Moves triangles by a distance.
    fn moved(triangles: &[[[f64; 3]; 3]], by: [f64; 3]) -> Vec<[[f64; 3]; 3]> {
        let point = |at: [f64; 3]| [0, 1, 2].map(|axis| at[axis] + by[axis]);
        triangles.iter().map(|corners| corners.map(point)).collect()
    }

    #[test]
    fn triangles_that_overlap_are_refused() {
        let corner = |x: f64, y: f64| [x, y, 0.0];
        let square = [
            [corner(0.0, 0.0), corner(8.0, 0.0), corner(8.0, 8.0)],
            [corner(0.0, 0.0), corner(8.0, 8.0), corner(0.0, 8.0)],
        ];
        let small: Vec<_> = square.iter().map(|corners| corners.map(|at| at.map(|at| at / 8.0))).collect();
        let has = |other: &[[[f64; 3]; 3]]| Tin::from_triangles(&[&square[..], other].concat());
        // Next to each other, with a gap, with an edge in common, and with a vertex on an edge.
        assert!(has(&moved(&square, [9.0, 0.0, 5.0])).is_ok());
        assert!(has(&moved(&square, [8.0, 0.0, 0.0])).is_ok());
        assert!(has(&moved(&small, [8.0, 3.0, 0.0])).is_ok());
        assert!(has(&[[corner(8.0, 4.0), corner(12.0, 0.0), corner(12.0, 8.0)]]).is_ok());
        // Edges that cross, within a triangle, on its edge, across the diagonal, the same.
        for (other, by) in [
            (&square[..], [4.0, 4.0, 5.0]),
            (&small, [5.0, 1.0, 5.0]),
            (&small, [7.0, 3.0, 0.0]),
            (&small, [3.5, 4.0, 5.0]),
            (&square, [0.0; 3]),
        ] {
            let error = has(&moved(other, by)).unwrap_err().to_string();
            assert!(error.contains("one height per position"), "{by:?} {error}");
        }
        // A triangle whose vertices are all on the edges of another one.
        let inner = [corner(8.0, 4.0), corner(4.0, 4.0), corner(4.0, 0.0)];
        assert!(has(&[inner]).is_err());
        // A triangle that is divided on both sides of its edges.
        let fan = [
            [corner(8.0, 0.0), corner(12.0, 0.0), corner(8.0, 4.0)],
            [corner(12.0, 0.0), corner(12.0, 4.0), corner(8.0, 4.0)],
            [corner(8.0, 4.0), corner(12.0, 4.0), corner(8.0, 8.0)],
        ];
        assert!(has(&fan).is_ok());
    }

    #[test]
    fn overlaps_are_those_of_areas() {
        // Triangles with small integer coordinates overlap where a point of a fine grid, away from
        // all edges, is in two of them.
        let mut random = random(11);
        for _ in 0..300 {
            let triangles: Vec<[[f64; 3]; 3]> = (0..2)
                .map(|_| [0; 3].map(|_: i32| [random(6) as f64, random(6) as f64, 0.0]))
                .filter(|[a, b, c]| (b[0] - a[0]) * (c[1] - a[1]) != (b[1] - a[1]) * (c[0] - a[0]))
                .collect();
            let is_in = |[a, b, c]: &[[f64; 3]; 3], x: f64, y: f64| {
                let side =
                    |a: &[f64; 3], b: &[f64; 3]| (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]);
                let sides = [side(a, b), side(b, c), side(c, a)];
                sides.iter().all(|side| *side > 1e-9) || sides.iter().all(|side| *side < -1e-9)
            };
            let near = |at: usize| (at as f64 + 0.37) / 40.0;
            let mut cells = (0..200).flat_map(|row| (0..200).map(move |column| [column, row]));
            let is_overlap = cells.any(|[column, row]| {
                triangles.iter().filter(|corners| is_in(corners, near(column), near(row))).count() > 1
            });
            assert_eq!(Tin::from_triangles(&triangles).is_err(), is_overlap, "{triangles:?}");
        }
    }
}
