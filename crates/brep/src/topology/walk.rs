//! Traversals between all kinds of entities.

use std::iter::successors;
use std::ops::Range;

use super::{NONE, Topology};

impl Topology {
    /// Returns the half-edges of a ring, in its order.
    #[inline]
    pub fn half_edges_of_ring(&self, ring: u32) -> Range<u32> {
        self.rings[ring as usize].start..self.rings[ring as usize + 1].start
    }

    /// Returns the rings of a face, the outer one first.
    #[inline]
    pub fn rings_of_face(&self, face: u32) -> Range<u32> {
        self.face_rings[face as usize]..self.face_rings[face as usize + 1]
    }

    /// Returns the half-edges of all rings of a face.
    pub fn half_edges_of_face(&self, face: u32) -> Range<u32> {
        let rings = self.rings_of_face(face);
        self.rings[rings.start as usize].start..self.rings[rings.end as usize].start
    }

    /// Returns the edges of all rings of a face; an edge that occurs in both directions is returned
    /// twice.
    pub fn edges_of_face(&self, face: u32) -> impl Iterator<Item = u32> {
        self.half_edges_of_face(face).map(|half_edge| self.edge(half_edge))
    }

    /// Returns the vertices of all rings of a face, with repetitions.
    pub fn vertices_of_face(&self, face: u32) -> impl Iterator<Item = u32> {
        self.half_edges_of_face(face).map(|half_edge| self.origin(half_edge))
    }

    /// Returns the faces across the edges of a face, edge by edge; edges on a boundary are skipped.
    pub fn neighbours_of_face(&self, face: u32) -> impl Iterator<Item = u32> {
        self.half_edges_of_face(face).filter_map(|half_edge| self.twin(half_edge)).map(|twin| self.face(twin))
    }

    /// Returns the half-edges of an edge: only one on the boundary of an open surface.
    pub fn half_edges_of_edge(&self, edge: u32) -> (u32, Option<u32>) {
        let [a, b] = self.edges[edge as usize];
        (a, (b != NONE).then_some(b))
    }

    /// Returns the two ends of an edge, in the direction of its first half-edge.
    pub fn vertices_of_edge(&self, edge: u32) -> [u32; 2] {
        let (first, _) = self.half_edges_of_edge(edge);
        [self.origin(first), self.target(first)]
    }

    /// Returns the faces on both sides of an edge, which may be the same.
    pub fn faces_of_edge(&self, edge: u32) -> (u32, Option<u32>) {
        let (first, second) = self.half_edges_of_edge(edge);
        (self.face(first), second.map(|half_edge| self.face(half_edge)))
    }

    /// Returns the half-edges that start at a vertex, counterclockwise seen from outside.
    pub fn half_edges_of_vertex(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let first = self.vertices[vertex as usize].half_edge;
        successors(Some(first), move |&at| self.twin(self.previous(at)).filter(|next| *next != first))
    }

    /// Returns the faces around a vertex, counterclockwise; a face that touches itself there is
    /// returned repeatedly.
    pub fn faces_of_vertex(&self, vertex: u32) -> impl Iterator<Item = u32> {
        self.half_edges_of_vertex(vertex).map(|half_edge| self.face(half_edge))
    }

    /// Returns the edges around a vertex, counterclockwise.
    pub fn edges_of_vertex(&self, vertex: u32) -> impl Iterator<Item = u32> {
        self.around(vertex).map(|half_edge| self.edge(half_edge))
    }

    /// Returns the vertices at the other ends of a vertex' edges, counterclockwise.
    pub fn neighbours_of_vertex(&self, vertex: u32) -> impl Iterator<Item = u32> {
        self.around(vertex).map(move |half_edge| {
            let origin = self.origin(half_edge);
            if origin == vertex { self.target(half_edge) } else { origin }
        })
    }

    /// Returns a half-edge of each edge of a vertex: those that start there, and at the end of an
    /// open fan one that ends there.
    fn around(&self, vertex: u32) -> impl Iterator<Item = u32> {
        self.half_edges_of_vertex(vertex).flat_map(|half_edge| {
            let last = Some(self.previous(half_edge)).filter(|before| self.twin(*before).is_none());
            [Some(half_edge), last].into_iter().flatten()
        })
    }

    /// Returns the faces of a shell, in the order of their numbers.
    pub fn faces_of_shell(&self, shell: u32) -> &[u32] {
        let start = if shell == 0 { 0 } else { self.shell_ends[shell as usize - 1] };
        &self.shell_faces[start as usize..self.shell_ends[shell as usize] as usize]
    }

    /// Returns the edges of a shell, each once.
    pub fn edges_of_shell(&self, shell: u32) -> impl Iterator<Item = u32> {
        self.half_edges_of_shell(shell)
            .filter(|half_edge| self.edges[self.edge(*half_edge) as usize][0] == *half_edge)
            .map(|half_edge| self.edge(half_edge))
    }

    /// Returns the vertices of a shell, each once.
    pub fn vertices_of_shell(&self, shell: u32) -> impl Iterator<Item = u32> {
        self.half_edges_of_shell(shell)
            .filter(|half_edge| self.vertices[self.origin(*half_edge) as usize].half_edge == *half_edge)
            .map(|half_edge| self.origin(half_edge))
    }

    /// Returns the half-edges of a shell, face by face.
    pub fn half_edges_of_shell(&self, shell: u32) -> impl Iterator<Item = u32> {
        self.faces_of_shell(shell).iter().flat_map(|&face| self.half_edges_of_face(face))
    }

    /// Returns the shell of a vertex.
    pub fn shell_of_vertex(&self, vertex: u32) -> u32 {
        self.shell_of_face(self.face(self.vertices[vertex as usize].half_edge))
    }
}
