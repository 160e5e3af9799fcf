//! Bodies that Euler operators build.

use super::numbered::Numbered;
use super::undo::Inverse;
use crate::topology::{Counts, Topology};
use spinney_base::{Error, Result};

/// A corner of a ring, at which an edge may begin or end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EulerCorner {
    /// The start of a half-edge.
    Of(u32),
    /// The vertex of a ring without edges.
    Lone(u32),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct HalfEdge {
    pub(super) origin: u32,
    pub(super) next: u32,
    pub(super) previous: u32,
    pub(super) ring: u32,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct EulerVertex {
    pub(super) point: [f64; 3],
    /// One of its corners.
    pub(super) corner: EulerCorner,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Start {
    HalfEdge(u32),
    Vertex(u32),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct EulerRing {
    pub(super) face: u32,
    pub(super) start: Start,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct EulerFace {
    /// The outer ring first.
    pub(super) rings: Vec<u32>,
    pub(super) shell: u32,
    /// The face of a model that it comes from.
    pub(super) source: Option<u32>,
}

/// Bodies that are built by Euler operators: shells, faces, rings, edges and vertices, with a
/// half-edge for each side of an edge; the twin of `h` is `h ^ 1`.
///
/// After every operator, `V - E + F - R = 2 (S - G)` holds. Numbers of removed entities are reused.
///
/// ```
/// use spinney::raw::brep::euler::{EulerBody, EulerCorner};
///
/// // A triangle, from a point: two consecutive edges, and one that closes them.
/// let mut body = EulerBody::default();
/// let (_, ring) = body.make_solid([0.0, 0.0, 0.0])?;
/// let first = body.make_edge_vertex(EulerCorner::Lone(ring), [4.0, 0.0, 0.0])?;
/// let second = body.make_edge_vertex(EulerCorner::Of(first ^ 1), [0.0, 4.0, 0.0])?;
/// body.make_edge_face(second ^ 1, first)?;
/// let counts = body.counts();
/// assert_eq!((counts.vertices, counts.edges, counts.faces, counts.genus()), (3, 3, 2, Some(0)));
/// while body.undo()? {}
/// assert_eq!(body.counts().vertices, 0);
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct EulerBody {
    /// Two for each edge.
    pub(super) half_edges: Numbered<[HalfEdge; 2]>,
    pub(super) vertices: Numbered<EulerVertex>,
    pub(super) rings: Numbered<EulerRing>,
    pub(super) faces: Numbered<EulerFace>,
    pub(super) shells: Numbered<()>,
    pub(super) handles: u64,
    pub(super) done: Vec<Inverse>,
    /// Whether operators are not recorded, so that memory does not grow with their number.
    pub(super) forgets: bool,
    /// Whether the next edge's first half-edge has an odd number, as it had before it was removed.
    pub(super) is_next_odd: bool,
}

/// Creates the error of an operator that is refused.
pub(super) fn refused(operator: &'static str, found: impl Into<String>, expected: &'static str) -> Error {
    Error::invalid(operator, found, expected)
}

impl EulerBody {
    /// Bytes of memory per edge of a body, with its share of vertices, faces and rings.
    pub(super) const EDGE_BYTES: u64 = 160;

    /// Returns the body of a closed surface, whose points are those of `point`. Vertices, edges,
    /// rings, faces and shells have the same numbers.
    ///
    /// # Errors
    /// If the surface is open, or has a face whose interior is not connected.
    pub(super) fn of(topology: &Topology, point: &dyn Fn([i32; 3]) -> [f64; 3]) -> Result<EulerBody> {
        let euler = topology.euler();
        let Some(handles) = euler.genus.filter(|_| topology.is_closed()) else {
            let found = "a surface that is open, or a face whose rings divide it";
            return Err(Error::invalid("model", found, "a closed surface of faces that are connected"));
        };
        let mut half_edge_of = vec![0; topology.half_edges() as usize];
        let twins = |edge: u32| {
            let (first, second) = topology.half_edges_of_edge(edge);
            [first, second.unwrap_or(first)]
        };
        for edge in 0..topology.edges() {
            for (half, side) in (2 * edge..).zip(twins(edge)) {
                half_edge_of[side as usize] = half;
            }
        }
        let of = |half: u32| half_edge_of[half as usize];
        let half_edge = |half: u32| HalfEdge {
            origin: topology.origin(half),
            next: of(topology.next(half)),
            previous: of(topology.previous(half)),
            ring: topology.ring(half),
        };
        let vertex = |vertex: u32| EulerVertex {
            point: point(topology.point(vertex)),
            corner: EulerCorner::Of(topology.half_edges_of_vertex(vertex).next().map_or(0, of)),
        };
        let ring = |ring: u32| EulerRing {
            face: topology.face_of_ring(ring),
            start: Start::HalfEdge(of(topology.half_edges_of_ring(ring).start)),
        };
        let face = |face: u32| EulerFace {
            rings: topology.rings_of_face(face).collect(),
            shell: topology.shell_of_face(face),
            source: Some(face),
        };
        Ok(EulerBody {
            half_edges: (0..topology.edges()).map(|edge| twins(edge).map(half_edge)).collect(),
            vertices: (0..topology.vertices()).map(vertex).collect(),
            rings: (0..topology.rings()).map(ring).collect(),
            faces: (0..topology.faces()).map(face).collect(),
            shells: (0..topology.shells()).map(|_| ()).collect(),
            handles,
            ..EulerBody::default()
        })
    }

    /// Returns the counts of all entities.
    pub fn counts(&self) -> Counts {
        Counts {
            vertices: self.vertices.len(),
            edges: self.half_edges.len(),
            faces: self.faces.len(),
            rings: self.rings.len() - self.faces.len(),
            boundaries: 0,
        }
    }

    /// Returns the number of shells.
    pub fn shells(&self) -> u64 {
        self.shells.len()
    }

    /// Returns the number of handles of all shells.
    pub fn handles(&self) -> u64 {
        self.handles
    }

    /// Returns whether the counts satisfy the Euler-Poincaré formula.
    pub fn is_lawful(&self) -> bool {
        let Counts { vertices, edges, faces, rings, .. } = self.counts();
        vertices + faces + 2 * self.handles == edges + rings + 2 * self.shells.len()
    }

    /// Returns the rings of points of all faces, the outer ring first; a ring without edges has one
    /// point.
    pub fn faces(&self) -> Vec<Vec<Vec<[f64; 3]>>> {
        let rings = |face: &EulerFace| face.rings.iter().map(|ring| self.points_of(*ring)).collect();
        self.faces.numbers().filter_map(|face| self.faces.get(face)).map(rings).collect()
    }

    /// Returns the points of a ring.
    pub(super) fn points_of(&self, ring: u32) -> Vec<[f64; 3]> {
        let point = |vertex: u32| self.vertices.get(vertex).map_or([0.0; 3], |vertex| vertex.point);
        match self.rings.get(ring).map(|ring| ring.start) {
            Some(Start::Vertex(vertex)) => vec![point(vertex)],
            Some(Start::HalfEdge(first)) => {
                self.around(first).map(|half| point(self.half(half).origin)).collect()
            }
            None => Vec::new(),
        }
    }

    /// Returns the half-edges of a ring, starting at one of them.
    pub(super) fn around(&self, first: u32) -> impl Iterator<Item = u32> {
        let next = move |half: &u32| Some(self.half(*half).next).filter(|next| *next != first);
        std::iter::successors(Some(first), next)
    }

    /// Returns the half-edges that start at a vertex; none if it has no edges.
    pub(super) fn half_edges_of(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let first = match self.vertices.get(vertex).map(|vertex| vertex.corner) {
            Some(EulerCorner::Of(half)) => Some(half),
            _ => None,
        };
        let next = move |half: &u32| Some(self.half(half ^ 1).next).filter(|next| Some(*next) != first);
        std::iter::successors(first, next)
    }

    /// Returns the vertices at both ends of a half-edge.
    pub(super) fn ends(&self, half: u32) -> [u32; 2] {
        [half, half ^ 1].map(|half| self.half(half).origin)
    }

    /// Returns the half-edge after another one in its ring.
    ///
    /// # Errors
    /// If there is no half-edge of that number.
    pub fn next(&self, half_edge: u32) -> Result<u32> {
        Ok(self.half(self.check("next", half_edge)?).next)
    }

    /// Returns the point at which a half-edge begins.
    ///
    /// # Errors
    /// If there is no half-edge of that number.
    pub fn point(&self, half_edge: u32) -> Result<[f64; 3]> {
        let HalfEdge { origin, .. } = self.half(self.check("point", half_edge)?);
        Ok(self.vertices.get(origin).map_or([0.0; 3], |vertex| vertex.point))
    }

    /// Returns the face of a half-edge.
    ///
    /// # Errors
    /// If there is no half-edge of that number.
    pub fn face(&self, half_edge: u32) -> Result<u32> {
        Ok(self.face_of(self.half(self.check("face", half_edge)?).ring))
    }

    /// Returns the ring of a half-edge.
    ///
    /// # Errors
    /// If there is no half-edge of that number.
    pub fn ring(&self, half_edge: u32) -> Result<u32> {
        Ok(self.half(self.check("ring", half_edge)?).ring)
    }

    /// Moves a vertex. The topology stays.
    pub(super) fn place(&mut self, vertex: u32, point: [f64; 3]) {
        if let Some(vertex) = self.vertices.get_mut(vertex) {
            vertex.point = point;
        }
    }

    /// Records an operator's inverse, and checks the counts.
    pub(super) fn note(&mut self, inverse: Inverse) {
        // Invariant: each operator changes both sides of the formula equally. Only a defect of this
        // module could break it.
        debug_assert!(self.is_lawful());
        if !self.forgets {
            self.done.push(inverse);
        }
    }

    /// Checks that there is a half-edge of that number.
    pub(super) fn check(&self, operator: &'static str, half: u32) -> Result<u32> {
        match self.half_edges.get(half / 2) {
            Some(_) => Ok(half),
            None => Err(refused(operator, format!("half-edge {half}"), "one of the body")),
        }
    }

    /// Returns the vertex and the ring of a corner.
    pub(super) fn corner(&self, operator: &'static str, at: EulerCorner) -> Result<(u32, u32)> {
        match at {
            EulerCorner::Of(half) => {
                let HalfEdge { origin, ring, .. } = self.half(self.check(operator, half)?);
                Ok((origin, ring))
            }
            EulerCorner::Lone(ring) => match self.rings.get(ring) {
                Some(EulerRing { start: Start::Vertex(vertex), .. }) => Ok((*vertex, ring)),
                _ => Err(refused(operator, format!("ring {ring}"), "a ring without edges")),
            },
        }
    }

    pub(super) fn half(&self, half: u32) -> HalfEdge {
        let edge = self.half_edges.get(half / 2);
        edge.unwrap_or_else(|| unreachable!("half-edges are checked"))[half as usize % 2]
    }

    pub(super) fn change(&mut self, half: u32, change: impl FnOnce(&mut HalfEdge)) {
        if let Some(edge) = self.half_edges.get_mut(half / 2) {
            change(&mut edge[half as usize % 2]);
        }
    }

    /// Adds an edge that is not linked yet.
    pub(super) fn add_edge(&mut self, [from, to]: [u32; 2], [one, other]: [u32; 2]) -> Result<u32> {
        if self.half_edges.slots() >= 1 << 30 {
            return Err(refused("edge", "2^30 edges", "fewer edges"));
        }
        let half = |origin, ring| HalfEdge { origin, next: 0, previous: 0, ring };
        let sides = [half(from, one), half(to, other)];
        Ok(match std::mem::take(&mut self.is_next_odd) {
            false => 2 * self.half_edges.add(sides),
            true => 2 * self.half_edges.add([sides[1], sides[0]]) + 1,
        })
    }

    pub(super) fn link(&mut self, from: u32, to: u32) {
        self.change(from, |half| half.next = to);
        self.change(to, |half| half.previous = from);
    }

    /// Assigns the half-edges around one to a ring.
    pub(super) fn give(&mut self, first: u32, ring: u32) {
        let mut at = first;
        loop {
            self.change(at, |half| half.ring = ring);
            at = self.half(at).next;
            if at == first {
                break;
            }
        }
    }

    /// Sets the first half-edge of a ring, and the corner of the vertex there.
    pub(super) fn start(&mut self, ring: u32, start: Start) {
        if let Some(ring) = self.rings.get_mut(ring) {
            ring.start = start;
        }
        match start {
            Start::HalfEdge(half) => self.set_corner(half),
            Start::Vertex(vertex) => {
                if let Some(vertex) = self.vertices.get_mut(vertex) {
                    vertex.corner = EulerCorner::Lone(ring);
                }
            }
        }
    }

    /// Makes a half-edge the corner of its vertex.
    pub(super) fn set_corner(&mut self, half: u32) {
        let origin = self.half(half).origin;
        if let Some(vertex) = self.vertices.get_mut(origin) {
            vertex.corner = EulerCorner::Of(half);
        }
    }

    pub(super) fn face_of(&self, ring: u32) -> u32 {
        self.rings.get(ring).map_or(u32::MAX, |ring| ring.face)
    }

    pub(super) fn shell_of(&self, face: u32) -> u32 {
        self.faces.get(face).map_or(u32::MAX, |face| face.shell)
    }

    pub(super) fn source_of(&self, face: u32) -> Option<u32> {
        self.faces.get(face)?.source
    }
}
