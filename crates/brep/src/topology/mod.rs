//! Topology of an exact model: which faces, rings, edges and vertices belong to one another.
//!
//! Kept are *half-edges*: an edge as a side of one face, in the direction in which the face's ring passes it
//! (counterclockwise seen from outside, holes the other way round). A closed surface passes every edge once in each
//! direction; the two half-edges are twins. From a half-edge, everything around is some steps away: along its ring, over
//! to its twin, around its vertex.
//!
//! Half-edges and not winged edges, for three reasons. A winged edge has two faces and four neighbours, and each step
//! has to ask first on which of its sides one is; a half-edge has one face and one next one. Where an edge has four or six
//! faces, it has no two wings, but half-edges still come in pairs. And faces with holes need rings of their own either
//! way: a half-edge belongs to a ring, and a ring to a face.
//!
//! # What is one vertex, one edge
//!
//! Corners with equal coordinates are one point. Half-edges between the same two points, in opposite directions, are
//! one edge. Where there are more than two, faces are sorted around the edge, exactly, and those between which lies
//! something solid belong together: solids that only touch along an edge stay apart. Faces without area go with the
//! face that they lead to. A point has a vertex for each fan of faces around it, so that every vertex has one, and the
//! whole is a two-dimensional manifold, whatever touches. The same goes within a face: where a hole touches the outer
//! ring, both are one ring. (A face whose inside falls apart where its rings touch is still one face, with several
//! rings.)
//!
//! A half-edge without a twin is on the boundary of an open surface: see [`Topology::boundaries`].
//!
//! # Numbers and memory
//!
//! Everything is known by a number from 0, and numbers that are passed in must be below the count of their kind. Faces
//! have those of the model; half-edges of a ring follow one another, and so do rings of a face; shells are numbered by
//! their first faces, and vertices by their points, which are in the order of their coordinates.
//!
//! A half-edge takes 12 bytes, an edge 8, a vertex and its point 20, a ring 8, a face 12: for closed surfaces of
//! triangles about 24 bytes per half-edge. Up to 60 are in use while it is made,
//! and about 45 for such surfaces.
//!
//! Topology is made of finished faces and does not change; [`EulerBody`] is changed step by step, by Euler operators.
//!
//! # The entities of the literature
//!
//! Tyukachev's model for set operations on closed triangulated surfaces (2010) has four entities, with six relations
//! from many to many and four from one to many, of which he leaves eleven from one to many. All of them are walks here; triangles are not required, and
//! nothing is kept twice.
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
//! IdBody is a list there, of faces, edges and vertices alike; here each belongs to one shell, and bodies that touch are
//! found by the vertices at a point. (Which faces an operation chooses for its result is no matter of topology; the
//! paper's indices need corrections for that: index 3 is the complement, printed as the intersection, and does not
//! tell coplanar faces of equal orientation from those of opposite orientation, which are two cases.)
//!
//! The winged-edge row, after Baumgart, of the Ukrainian paper on intersection lines of polygon meshes (2012): an edge
//! `a` from X to Y, the faces 1 and 2 on its left and right, and the edges before and after `a` in these. Faces are
//! passed clockwise there and counterclockwise here, so that what is before is after; with `h` the half-edge from X to
//! Y, and `t` its twin:
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
mod numbered;
mod operators;
mod volume;
mod walk;

use std::ops::Range;
use std::path::PathBuf;

use super::Faces;
use spinney_base::{Progress, Result};

pub use euler::{Counts, Euler};
pub use operators::{EulerBody, EulerCorner};

/// In place of a half-edge that there is not.
const NONE: u32 = u32::MAX;

/// Limits of a topology that is to be made.
#[derive(Clone, Debug)]
pub struct TopologyOptions {
    /// Most bytes that may be in use for it, while it is made too.
    pub memory: u64,
    /// The model's file, for messages.
    pub path: PathBuf,
}

impl Default for TopologyOptions {
    /// A gibibyte, which is enough for about five million triangles.
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
    /// The half-edges of each edge, the lower number first, then [`NONE`] if there is no other.
    edges: Vec<[u32; 2]>,
    vertices: Vec<Vertex>,
    /// All different points, in order.
    points: Vec<[i32; 3]>,
    /// One more than there are, where the last one ends.
    rings: Vec<Ring>,
    /// The first ring of each face, and the number of rings.
    face_rings: Vec<u32>,
    shell_of: Vec<u32>,
    /// The faces of all shells, and where those of each one end.
    shell_faces: Vec<u32>,
    shell_ends: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Vertex {
    /// A half-edge that starts there: if the fan is open, the one that has no twin.
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
    /// The topology of a model, of which all faces are read twice.
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
    /// If it needs more memory than is allowed, or has 2^32 half-edges; if the faces cannot be read; or on
    /// interruption.
    pub fn of(faces: &dyn Faces, options: &TopologyOptions, progress: &dyn Progress) -> Result<Topology> {
        build::build(faces, options, progress)
    }

    /// Number of half-edges.
    pub fn half_edges(&self) -> u32 {
        self.origin.len() as u32
    }

    /// Number of edges.
    pub fn edges(&self) -> u32 {
        self.edges.len() as u32
    }

    /// Number of vertices: no less than that of different points.
    pub fn vertices(&self) -> u32 {
        self.vertices.len() as u32
    }

    /// Number of rings of all faces.
    pub fn rings(&self) -> u32 {
        self.rings.len() as u32 - 1
    }

    /// Number of faces.
    pub fn faces(&self) -> u32 {
        self.face_rings.len() as u32 - 1
    }

    /// Number of shells: surfaces that hang together.
    pub fn shells(&self) -> u32 {
        self.shell_ends.len() as u32
    }

    /// The vertex at which a half-edge starts.
    #[inline]
    pub fn origin(&self, half_edge: u32) -> u32 {
        self.origin[half_edge as usize]
    }

    /// The vertex at which a half-edge ends.
    #[inline]
    pub fn target(&self, half_edge: u32) -> u32 {
        self.origin(self.next(half_edge))
    }

    /// The half-edge of the same edge in the other direction; `None` on the boundary of an open surface.
    #[inline]
    pub fn twin(&self, half_edge: u32) -> Option<u32> {
        let edge = self.edge_of[half_edge as usize];
        if edge == NONE {
            // (Only while the topology is made.)
            return None;
        }
        let [a, b] = self.edges[edge as usize];
        let twin = if a == half_edge { b } else { a };
        (twin != NONE).then_some(twin)
    }

    /// The half-edge after another one in its ring.
    #[inline]
    pub fn next(&self, half_edge: u32) -> u32 {
        let Range { start, end } = self.half_edges_of_ring(self.ring(half_edge));
        if half_edge + 1 == end { start } else { half_edge + 1 }
    }

    /// The half-edge before another one in its ring.
    #[inline]
    pub fn previous(&self, half_edge: u32) -> u32 {
        let Range { start, end } = self.half_edges_of_ring(self.ring(half_edge));
        if half_edge == start { end - 1 } else { half_edge - 1 }
    }

    /// The edge of a half-edge.
    #[inline]
    pub fn edge(&self, half_edge: u32) -> u32 {
        self.edge_of[half_edge as usize]
    }

    /// The ring of a half-edge.
    #[inline]
    pub fn ring(&self, half_edge: u32) -> u32 {
        self.ring_of[half_edge as usize]
    }

    /// The face of a half-edge.
    #[inline]
    pub fn face(&self, half_edge: u32) -> u32 {
        self.face_of_ring(self.ring(half_edge))
    }

    /// The face of a ring.
    #[inline]
    pub fn face_of_ring(&self, ring: u32) -> u32 {
        self.rings[ring as usize].face
    }

    /// The shell of a face.
    #[inline]
    pub fn shell_of_face(&self, face: u32) -> u32 {
        self.shell_of[face as usize]
    }

    /// Grid coordinates of a vertex.
    #[inline]
    pub fn point(&self, vertex: u32) -> [i32; 3] {
        self.points[self.vertices[vertex as usize].point as usize]
    }

    /// The vertices at a point: several where surfaces only touch, none where there is no corner.
    pub fn vertices_at(&self, point: [i32; 3]) -> Range<u32> {
        let Ok(number) = self.points.binary_search(&point) else { return 0..0 };
        let first = self.vertices.partition_point(|vertex| (vertex.point as usize) < number);
        let end = self.vertices.partition_point(|vertex| (vertex.point as usize) <= number);
        first as u32..end as u32
    }
}
