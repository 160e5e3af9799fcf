//! Topology of an exact model: the incidences of faces, rings, edges and vertices.
//!
//! The data structure consists of *half-edges*. A half-edge is an edge as a side of one face, in
//! the direction of the face's ring (counterclockwise seen from outside, holes clockwise). A closed
//! surface has every edge once in each direction; the two half-edges are twins. From a half-edge,
//! all incident entities are a few steps away: along its ring, to its twin, or around its vertex.
//!
//! Half-edges are used instead of winged edges for three reasons. A winged edge has two faces and
//! four neighbours, and each step has to determine the side first; a half-edge has one face and one
//! successor. An edge with four or six faces has no two wings, but its half-edges still come in
//! pairs. And faces with holes need rings in any case: a half-edge belongs to a ring, and a ring to
//! a face.
//!
//! # Identity of vertices and edges
//!
//! Face vertices with equal coordinates are one point. Half-edges between the same two points, in
//! opposite directions, are one edge. If there are more than two, faces are sorted around the edge,
//! exactly, and faces that bound the same solid sector are paired: solids that only touch along an
//! edge stay separate. Faces without area are paired like the face beyond them. A point has a
//! vertex for each fan of faces around it, so every vertex has one fan, and the surface is a
//! two-dimensional manifold, whatever touches. The same holds within a face: where a hole touches
//! the outer ring, both are one ring. (A face whose interior is disconnected where its rings touch
//! is still one face, with several rings.)
//!
//! A half-edge without a twin is on the boundary of an open surface: see [`Topology::boundaries`].
//!
//! # Numbers and memory
//!
//! Entities are numbered from 0, and arguments must be below the count of their kind. Faces have
//! the model's numbers. Half-edges of a ring are consecutive, and so are rings of a face. Shells
//! are numbered by their first faces, and vertices by their points, which are sorted by
//! coordinates.
//!
//! A half-edge takes 12 bytes, an edge 8, a vertex and its point 20, a ring 8, a face 12: about 24
//! bytes per half-edge for closed surfaces of triangles. Construction uses up to 60 bytes per
//! half-edge, and about 45 for such surfaces.
//!
//! A topology is computed from complete faces and is immutable. An
//! [`EulerBody`](crate::euler::EulerBody) can be changed incrementally, by Euler operators.
//!
//! # Entities in the literature
//!
//! Tyukachev's model for set operations on closed triangulated surfaces (2010) has four entities,
//! with six many-to-many relations and four one-to-many relations, of which he keeps eleven as
//! one-to-many relations. Here, all of them are traversals; triangles are not required, and nothing
//! is stored twice.
//!
//! | entity and field | here |
//! | --- | --- |
//! | Body: IdFace, IdVertex | a shell (a solid with cavities has several, those of the cavities with [negative volume](Topology::six_volumes)): [`faces_of_shell`](Topology::faces_of_shell), [`vertices_of_shell`](Topology::vertices_of_shell) |
//! | Face: IdVertex, IdEdge | [`vertices_of_face`](Topology::vertices_of_face), [`edges_of_face`](Topology::edges_of_face) |
//! | Face: IdBody | [`shell_of_face`](Topology::shell_of_face) |
//! | Face: TempEdge, Tr (cuts of a running operation, triangles) | not kept: results of an operation, of [`Triangulator`](crate::geometry::Triangulator) |
//! | Edge: Vertex1, Vertex2 | [`vertices_of_edge`](Topology::vertices_of_edge) |
//! | Edge: IdBody | the shell of its [faces](Topology::faces_of_edge) |
//! | Edge: IncidentalFace | [`faces_of_edge`](Topology::faces_of_edge): two, also where more meet, see above |
//! | Edge: Points (of intersection) | not kept: a result of an operation |
//! | Vertex: x, y, z | [`point`](Topology::point) |
//! | Vertex: IdFace, IdBody | [`faces_of_vertex`](Topology::faces_of_vertex), [`shell_of_vertex`](Topology::shell_of_vertex) |
//! | Vertex: Family (families of incident vertices), Visit | [`vertices_at`](Topology::vertices_at) a point, a vertex for each family: [`neighbours_of_vertex`](Topology::neighbours_of_vertex), in order around it, so that nothing has to be marked |
//!
//! IdBody is a list in that model, of faces, edges and vertices alike. Here, each entity belongs to
//! one shell, and bodies that touch are found by the vertices at a point. (Which faces an operation
//! selects is not a matter of topology. The paper's indices need corrections for that: index 3 is
//! the complement, printed as the intersection, and does not distinguish coplanar faces of equal
//! orientation from those of opposite orientation, which are two cases.)
//!
//! The winged-edge record, after Baumgart, of the Ukrainian paper on intersection lines of polygon
//! meshes (2012): an edge `a` from X to Y, the faces 1 and 2 on its left and right, and the edges
//! before and after `a` in these. Faces are clockwise there and counterclockwise here, so "before"
//! and "after" are exchanged. `h` is the half-edge from X to Y, and `t` its twin:
//!
//! | column | there | here |
//! | --- | --- | --- |
//! | name | a | `edge(h)` |
//! | start, end | X, Y | `origin(h)`, `target(h)` |
//! | faces left, right | 1, 2 | `face(h)`, `face(t)` |
//! | left face: before, after | b, d | `edge(next(h))`, `edge(previous(h))` |
//! | right face: before, after | e, c | `edge(next(t))`, `edge(previous(t))` |

mod around;
mod boundary;
mod build;
mod corners;
mod euler;
mod volume;
mod walk;

use std::ops::Range;
use std::path::PathBuf;

use super::Faces;
use spinney_base::{Progress, Result};

pub use euler::{Counts, Euler};

/// Marks a missing half-edge.
const NONE: u32 = u32::MAX;

/// Limits for building a topology.
#[derive(Clone, Debug)]
pub struct TopologyOptions {
    /// Maximum bytes in use, including those during construction.
    pub memory: u64,
    /// The model's file, for messages.
    pub path: PathBuf,
}

impl Default for TopologyOptions {
    /// One gibibyte, which is enough for about five million triangles.
    fn default() -> TopologyOptions {
        TopologyOptions { memory: 1 << 30, path: PathBuf::from("model") }
    }
}

/// Shells, faces, rings, edges and vertices of a model, and their half-edges.
#[derive(Clone, Debug, Default)]
pub struct Topology {
    /// The vertex at which each half-edge starts.
    origin: Vec<u32>,
    edge_of: Vec<u32>,
    ring_of: Vec<u32>,
    /// The half-edges of each edge, the lower number first, then [`NONE`] if there is no twin.
    edges: Vec<[u32; 2]>,
    vertices: Vec<Vertex>,
    /// All distinct points, in order.
    points: Vec<[i32; 3]>,
    /// All rings, and a final entry for the end of the last one.
    rings: Vec<Ring>,
    /// The first ring of each face, and the total number of rings.
    face_rings: Vec<u32>,
    shell_of: Vec<u32>,
    /// The faces of all shells, and the end of each shell's faces.
    shell_faces: Vec<u32>,
    shell_ends: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Vertex {
    /// A half-edge that starts there: in an open fan, the one that has no twin.
    half_edge: u32,
    point: u32,
}

#[derive(Clone, Copy, Debug)]
struct Ring {
    /// The first half-edge.
    start: u32,
    face: u32,
}

impl Topology {
    /// Builds the topology of a model; reads all faces twice.
    ///
    /// ```
    /// use spinney::brep::{Face, Grid};
    /// use spinney::raw::brep::FaceList;
    /// use spinney::raw::brep::topology::{Topology, TopologyOptions};
    ///
    /// // A tetrahedron.
    /// let corners = [[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4]];
    /// let mut faces = FaceList::new(Grid::over([[0.0; 3], [4.0; 3]], Some(1.0))?, vec!["solid".into()]);
    /// for [a, b, c] in [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]] {
    ///     let points = [corners[a], corners[b], corners[c]];
    ///     faces.push(&Face { number: 0, points: &points, ring_ends: &[3], colours: &[], part: 0, source: 0 });
    /// }
    /// let topology = Topology::of(&faces, &TopologyOptions::default(), &())?;
    /// assert_eq!(topology.neighbours_of_face(0).collect::<Vec<_>>(), [3, 2, 1]);
    /// let euler = topology.euler();
    /// assert_eq!((euler.vertices, euler.edges, euler.faces, euler.genus), (4, 6, 4, Some(0)));
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If it needs more memory than allowed, or has 2^32 half-edges; if the faces cannot be read;
    /// or on cancellation.
    pub fn of(faces: &dyn Faces, options: &TopologyOptions, progress: &dyn Progress) -> Result<Topology> {
        build::build(faces, options, progress)
    }

    /// Returns the number of half-edges.
    pub fn half_edges(&self) -> u32 {
        self.origin.len() as u32
    }

    /// Returns the number of edges.
    pub fn edges(&self) -> u32 {
        self.edges.len() as u32
    }

    /// Returns the number of vertices: at least the number of distinct points.
    pub fn vertices(&self) -> u32 {
        self.vertices.len() as u32
    }

    /// Returns the number of rings of all faces.
    pub fn rings(&self) -> u32 {
        self.rings.len() as u32 - 1
    }

    /// Returns the number of faces.
    pub fn faces(&self) -> u32 {
        self.face_rings.len() as u32 - 1
    }

    /// Returns the number of shells: connected surfaces.
    pub fn shells(&self) -> u32 {
        self.shell_ends.len() as u32
    }

    /// Returns the vertex at which a half-edge starts.
    #[inline]
    pub fn origin(&self, half_edge: u32) -> u32 {
        self.origin[half_edge as usize]
    }

    /// Returns the vertex at which a half-edge ends.
    #[inline]
    pub fn target(&self, half_edge: u32) -> u32 {
        self.origin(self.next(half_edge))
    }

    /// Returns the half-edge of the same edge in the other direction; `None` on the boundary of an
    /// open surface.
    #[inline]
    pub fn twin(&self, half_edge: u32) -> Option<u32> {
        let edge = self.edge_of[half_edge as usize];
        if edge == NONE {
            // (Only during construction.)
            return None;
        }
        let [a, b] = self.edges[edge as usize];
        let twin = if a == half_edge { b } else { a };
        (twin != NONE).then_some(twin)
    }

    /// Returns the half-edge after another one in its ring.
    #[inline]
    pub fn next(&self, half_edge: u32) -> u32 {
        let Range { start, end } = self.half_edges_of_ring(self.ring(half_edge));
        if half_edge + 1 == end { start } else { half_edge + 1 }
    }

    /// Returns the half-edge before another one in its ring.
    #[inline]
    pub fn previous(&self, half_edge: u32) -> u32 {
        let Range { start, end } = self.half_edges_of_ring(self.ring(half_edge));
        if half_edge == start { end - 1 } else { half_edge - 1 }
    }

    /// Returns the edge of a half-edge.
    #[inline]
    pub fn edge(&self, half_edge: u32) -> u32 {
        self.edge_of[half_edge as usize]
    }

    /// Returns the ring of a half-edge.
    #[inline]
    pub fn ring(&self, half_edge: u32) -> u32 {
        self.ring_of[half_edge as usize]
    }

    /// Returns the face of a half-edge.
    #[inline]
    pub fn face(&self, half_edge: u32) -> u32 {
        self.face_of_ring(self.ring(half_edge))
    }

    /// Returns the face of a ring.
    #[inline]
    pub fn face_of_ring(&self, ring: u32) -> u32 {
        self.rings[ring as usize].face
    }

    /// Returns the shell of a face.
    #[inline]
    pub fn shell_of_face(&self, face: u32) -> u32 {
        self.shell_of[face as usize]
    }

    /// Returns the grid coordinates of a vertex.
    #[inline]
    pub fn point(&self, vertex: u32) -> [i32; 3] {
        self.points[self.vertices[vertex as usize].point as usize]
    }

    /// Returns the vertices at a point: several where surfaces only touch, none if no face has a
    /// vertex there.
    pub fn vertices_at(&self, point: [i32; 3]) -> Range<u32> {
        let Ok(number) = self.points.binary_search(&point) else { return 0..0 };
        let first = self.vertices.partition_point(|vertex| (vertex.point as usize) < number);
        let end = self.vertices.partition_point(|vertex| (vertex.point as usize) <= number);
        first as u32..end as u32
    }
}
