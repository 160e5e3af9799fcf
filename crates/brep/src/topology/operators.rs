//! Euler operators: they change a body's topology one entity at a time, and preserve the
//! Euler-Poincaré formula (M. Mäntylä, *An introduction to solid modeling*, 1988). Each has an
//! inverse, so that all can be undone.

use super::Counts;
use super::numbered::Numbered;
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
struct HalfEdge {
    origin: u32,
    next: u32,
    previous: u32,
    ring: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Start {
    HalfEdge(u32),
    Vertex(u32),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct EulerRing {
    face: u32,
    start: Start,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct EulerFace {
    /// The outer ring first.
    rings: Vec<u32>,
    shell: u32,
}

/// Inverse of an applied operator.
#[derive(Clone, Copy, Debug)]
enum Inverse {
    KillSolid(u32),
    MakeEdgeVertex(EulerCorner, [i32; 3]),
    KillEdgeVertex(u32),
    MakeEdgeFace(u32, u32),
    KillEdgeFace(u32),
    MakeEdgeKillRing(EulerCorner, EulerCorner),
    KillEdgeMakeRing(u32),
    MakeFaceKillRing { ring: u32, shell: Option<u32> },
    KillFaceMakeRing { face: u32, gone: u32 },
}

/// Bodies that are built by Euler operators: shells, faces, rings, edges and vertices, with a
/// half-edge for each side of an edge; the twin of `h` is `h ^ 1`.
///
/// After every operator, `V - E + F - R = 2 (S - G)` holds.
///
/// ```
/// use spinney::raw::brep::topology::{EulerBody, EulerCorner};
///
/// // A triangle, from a point: two consecutive edges, and one that closes them.
/// let mut body = EulerBody::default();
/// let (_, ring) = body.make_solid([0, 0, 0]);
/// let first = body.make_edge_vertex(EulerCorner::Lone(ring), [4, 0, 0])?;
/// let second = body.make_edge_vertex(EulerCorner::Of(first ^ 1), [0, 4, 0])?;
/// body.make_edge_face(second ^ 1, first)?;
/// let counts = body.counts();
/// assert_eq!((counts.vertices, counts.edges, counts.faces, counts.genus()), (3, 3, 2, Some(0)));
/// while body.undo() {}
/// assert_eq!(body.counts().vertices, 0);
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct EulerBody {
    /// Two for each edge.
    half_edges: Numbered<[HalfEdge; 2]>,
    points: Numbered<[i32; 3]>,
    rings: Numbered<EulerRing>,
    faces: Numbered<EulerFace>,
    shells: Numbered<()>,
    handles: u64,
    done: Vec<Inverse>,
}

fn refused(operator: &'static str, found: impl Into<String>, expected: &'static str) -> Error {
    Error::invalid(operator, found, expected)
}

impl EulerBody {
    /// Returns the counts of all entities.
    pub fn counts(&self) -> Counts {
        Counts {
            vertices: self.points.len(),
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
    pub fn faces(&self) -> Vec<Vec<Vec<[i32; 3]>>> {
        let rings = |face: &EulerFace| face.rings.iter().map(|ring| self.points_of(*ring)).collect();
        self.faces.numbers().filter_map(|face| self.faces.get(face)).map(rings).collect()
    }

    fn points_of(&self, ring: u32) -> Vec<[i32; 3]> {
        let point = |vertex: u32| self.points.get(vertex).copied().unwrap_or_default();
        match self.rings.get(ring).map(|ring| ring.start) {
            Some(Start::Vertex(vertex)) => vec![point(vertex)],
            Some(Start::HalfEdge(first)) => {
                self.around(first).into_iter().map(|half| point(self.half(half).origin)).collect()
            }
            None => Vec::new(),
        }
    }

    /// Returns the half-edges of a ring, starting at one of them.
    fn around(&self, first: u32) -> Vec<u32> {
        let (mut found, mut at) = (vec![first], self.half(first).next);
        while at != first {
            found.push(at);
            at = self.half(at).next;
        }
        found
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
    pub fn point(&self, half_edge: u32) -> Result<[i32; 3]> {
        let HalfEdge { origin, .. } = self.half(self.check("point", half_edge)?);
        Ok(self.points.get(origin).copied().unwrap_or_default())
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

    /// Undoes the last operator that was not undone; returns whether there was one.
    pub fn undo(&mut self) -> bool {
        let Some(inverse) = self.done.pop() else { return false };
        let known = self.done.len();
        let undone = match inverse {
            Inverse::KillSolid(face) => self.kill_solid(face),
            Inverse::MakeEdgeVertex(at, point) => self.make_edge_vertex(at, point).map(drop),
            Inverse::KillEdgeVertex(half) => self.kill_edge_vertex(half),
            Inverse::MakeEdgeFace(from, to) => self.make_edge_face(from, to).map(drop),
            Inverse::KillEdgeFace(half) => self.kill_edge_face(half),
            Inverse::MakeEdgeKillRing(from, to) => self.make_edge_kill_ring(from, to).map(drop),
            Inverse::KillEdgeMakeRing(half) => self.kill_edge_make_ring(half).map(drop),
            Inverse::MakeFaceKillRing { ring, shell } => {
                self.part_face(ring, shell);
                Ok(())
            }
            Inverse::KillFaceMakeRing { face, gone } => self.kill_face_make_ring(face, gone),
        };
        // Invariant: an inverse refers to the state after its operator, which is restored here; it
        // would fail in any other state.
        debug_assert!(undone.is_ok() && self.is_lawful());
        self.done.truncate(known);
        true
    }

    /// *mvfs*: makes a vertex, a face with a ring without edges, and a shell; returns the face and
    /// the ring.
    pub fn make_solid(&mut self, point: [i32; 3]) -> (u32, u32) {
        let vertex = self.points.add(point);
        let shell = self.shells.add(());
        let face = self.faces.add(EulerFace { rings: Vec::new(), shell });
        let ring = self.rings.add(EulerRing { face, start: Start::Vertex(vertex) });
        self.set_rings(face, vec![ring]);
        self.note(Inverse::KillSolid(face));
        (face, ring)
    }

    /// The inverse of *mvfs*. It is used by `undo` only, since its own inverse would need the
    /// point.
    fn kill_solid(&mut self, face: u32) -> Result<()> {
        let found = self.faces.get(face).cloned().filter(|face| face.rings.len() == 1);
        let ring = found.as_ref().and_then(|face| self.rings.get(face.rings[0]).copied());
        match (found, ring) {
            (Some(EulerFace { rings, shell }), Some(EulerRing { start: Start::Vertex(vertex), .. })) => {
                self.rings.remove(rings[0]);
                self.faces.remove(face);
                self.shells.remove(shell);
                self.points.remove(vertex);
                Ok(())
            }
            _ => Err(refused("kvfs", format!("face {face}"), "a face of one vertex")),
        }
    }

    /// *mev*: makes an edge from a corner to a new vertex; returns the half-edge to the vertex.
    ///
    /// # Errors
    /// If there is no such corner.
    pub fn make_edge_vertex(&mut self, at: EulerCorner, point: [i32; 3]) -> Result<u32> {
        let (from, ring) = self.corner("mev", at)?;
        let to = self.points.add(point);
        let half = self.add_edge([from, to], [ring; 2]);
        match at {
            EulerCorner::Of(next) => {
                let before = self.half(next).previous;
                self.link(before, half);
                self.link(half ^ 1, next);
            }
            EulerCorner::Lone(_) => {
                self.link(half ^ 1, half);
                self.start(ring, Start::HalfEdge(half));
            }
        }
        self.link(half, half ^ 1);
        self.note(Inverse::KillEdgeVertex(half));
        Ok(half)
    }

    /// *kev*: removes an edge and the vertex at a half-edge's end, which must have no other edge.
    ///
    /// # Errors
    /// If there is no such half-edge, or the vertex has other edges.
    pub fn kill_edge_vertex(&mut self, half_edge: u32) -> Result<()> {
        let half = self.check("kev", half_edge)?;
        let back = half ^ 1;
        if self.half(half).next != back {
            return Err(refused(
                "kev",
                format!("half-edge {half}"),
                "one that leads to a vertex without other edges",
            ));
        }
        let HalfEdge { origin, previous, ring, .. } = self.half(half);
        let (next, to) = (self.half(back).next, self.half(back).origin);
        let point = self.points.get(to).copied().unwrap_or_default();
        let at = if next == half {
            self.start(ring, Start::Vertex(origin));
            EulerCorner::Lone(ring)
        } else {
            self.link(previous, next);
            self.start(ring, Start::HalfEdge(next));
            EulerCorner::Of(next)
        };
        self.half_edges.remove(half / 2);
        self.points.remove(to);
        self.note(Inverse::MakeEdgeVertex(at, point));
        Ok(())
    }

    /// *mef*: makes an edge between two corners of a ring, which divides its face. Returns the
    /// half-edge from the first to the second corner, which stays in the face. The new face is on
    /// the other side.
    ///
    /// # Errors
    /// If the half-edges that begin at the corners are in different rings, or begin at the same
    /// vertex.
    pub fn make_edge_face(&mut self, from: u32, to: u32) -> Result<u32> {
        let (from, to) = (self.check("mef", from)?, self.check("mef", to)?);
        let (a, b) = (self.half(from), self.half(to));
        if a.ring != b.ring || a.origin == b.origin {
            let found = format!("half-edges {from} and {to}");
            return Err(refused("mef", found, "two of one ring that begin at different vertices"));
        }
        let shell = self.shell_of(self.face_of(a.ring));
        let face = self.faces.add(EulerFace { rings: Vec::new(), shell });
        let half = self.add_edge([a.origin, b.origin], [a.ring; 2]);
        let ring = self.rings.add(EulerRing { face, start: Start::HalfEdge(half ^ 1) });
        self.set_rings(face, vec![ring]);
        self.link(a.previous, half);
        self.link(half, to);
        self.link(b.previous, half ^ 1);
        self.link(half ^ 1, from);
        self.start(a.ring, Start::HalfEdge(half));
        self.give(half ^ 1, ring);
        self.note(Inverse::KillEdgeFace(half));
        Ok(half)
    }

    /// *kef*: removes an edge, and the face on the other side of a half-edge, which must have no
    /// other ring.
    ///
    /// # Errors
    /// If there is no such half-edge, both sides belong to one face, or the other face has more
    /// rings.
    pub fn kill_edge_face(&mut self, half_edge: u32) -> Result<()> {
        let half = self.check("kef", half_edge)?;
        let (one, other) = (self.half(half), self.half(half ^ 1));
        let (own, gone) = (self.face_of(one.ring), self.face_of(other.ring));
        if own == gone || self.faces.get(gone).is_none_or(|face| face.rings.len() > 1) {
            return Err(refused(
                "kef",
                format!("half-edge {half}"),
                "one with another face of one ring on its other side",
            ));
        }
        self.give(half ^ 1, one.ring);
        self.link(one.previous, other.next);
        self.link(other.previous, one.next);
        self.start(one.ring, Start::HalfEdge(one.next));
        self.rings.remove(other.ring);
        self.half_edges.remove(half / 2);
        self.faces.remove(gone);
        self.note(Inverse::MakeEdgeFace(other.next, one.next));
        Ok(())
    }

    /// *kemr*: removes an edge that has the same ring on both sides. The half of the ring beyond
    /// the half-edge's end becomes a separate ring, whose number is returned.
    ///
    /// # Errors
    /// If there is no such half-edge, or its sides belong to different rings.
    pub fn kill_edge_make_ring(&mut self, half_edge: u32) -> Result<u32> {
        let half = self.check("kemr", half_edge)?;
        let (one, other) = (self.half(half), self.half(half ^ 1));
        if one.ring != other.ring {
            return Err(refused("kemr", format!("half-edge {half}"), "one with the same ring on both sides"));
        }
        let face = self.face_of(one.ring);
        let is_alone = [other.next == half, one.next == half ^ 1];
        let ring = self.rings.add(EulerRing { face, start: Start::Vertex(other.origin) });
        let mut rings = self.faces.get(face).map(|face| face.rings.clone()).unwrap_or_default();
        rings.push(ring);
        self.set_rings(face, rings);
        let mut corners = [EulerCorner::Lone(one.ring), EulerCorner::Lone(ring)];
        if is_alone[0] {
            self.start(one.ring, Start::Vertex(one.origin));
        } else {
            self.link(one.previous, other.next);
            self.start(one.ring, Start::HalfEdge(other.next));
            corners[0] = EulerCorner::Of(other.next);
        }
        if !is_alone[1] {
            self.link(other.previous, one.next);
            self.start(ring, Start::HalfEdge(one.next));
            self.give(one.next, ring);
            corners[1] = EulerCorner::Of(one.next);
        }
        self.half_edges.remove(half / 2);
        self.note(Inverse::MakeEdgeKillRing(corners[0], corners[1]));
        Ok(ring)
    }

    /// *mekr*: makes an edge from a corner of a face to a corner of another of its rings, which is
    /// merged with the first corner's ring. Returns the half-edge to the second corner.
    ///
    /// # Errors
    /// If there are no such corners, they belong to one ring or to different faces, or the second
    /// one belongs to the outer ring.
    pub fn make_edge_kill_ring(&mut self, from: EulerCorner, to: EulerCorner) -> Result<u32> {
        let ((a, ring), (b, gone)) = (self.corner("mekr", from)?, self.corner("mekr", to)?);
        let face = self.face_of(ring);
        let mut rings = self.faces.get(face).map(|face| face.rings.clone()).unwrap_or_default();
        let place = rings.iter().position(|known| *known == gone).filter(|place| *place > 0);
        let Some(place) = place.filter(|_| ring != gone) else {
            let found = format!("rings {ring} and {gone}");
            return Err(refused("mekr", found, "two of one face, of which the second is not the outer one"));
        };
        rings.remove(place);
        self.set_rings(face, rings);
        let half = self.add_edge([a, b], [ring; 2]);
        match from {
            EulerCorner::Of(next) => {
                let before = self.half(next).previous;
                self.link(before, half);
                self.link(half ^ 1, next);
            }
            EulerCorner::Lone(_) => self.link(half ^ 1, half),
        }
        match to {
            EulerCorner::Of(next) => {
                let before = self.half(next).previous;
                self.link(before, half ^ 1);
                self.link(half, next);
            }
            EulerCorner::Lone(_) => self.link(half, half ^ 1),
        }
        self.start(ring, Start::HalfEdge(half));
        self.give(half, ring);
        self.rings.remove(gone);
        self.note(Inverse::KillEdgeMakeRing(half));
        Ok(half)
    }

    /// *kfmrh*: removes a face of one ring, which becomes a ring of another face. This adds a
    /// handle to their shell or, if they belong to different shells, merges the shells.
    ///
    /// # Errors
    /// If there are no such faces, or the second one has more rings.
    pub fn kill_face_make_ring(&mut self, face: u32, gone: u32) -> Result<()> {
        let found = (self.faces.get(face).cloned(), self.faces.get(gone).cloned());
        let (Some(mut own), Some(other), true) = (found.0, found.1, face != gone) else {
            return Err(refused("kfmrh", format!("faces {face} and {gone}"), "two faces"));
        };
        let &[ring] = &other.rings[..] else {
            return Err(refused("kfmrh", format!("face {gone}"), "a face of one ring"));
        };
        self.faces.remove(gone);
        own.rings.push(ring);
        self.set_rings(face, own.rings);
        self.set_face(ring, face);
        let shell = if own.shell == other.shell {
            self.handles += 1;
            None
        } else {
            let others: Vec<u32> =
                self.faces.numbers().filter(|face| self.shell_of(*face) == other.shell).collect();
            others.into_iter().for_each(|face| self.set_shell(face, own.shell));
            self.shells.remove(other.shell);
            Some(own.shell)
        };
        self.note(Inverse::MakeFaceKillRing { ring, shell });
        Ok(())
    }

    /// The inverse of *kfmrh*. It is used by `undo` only, which knows whether it removes a handle
    /// or splits a shell.
    fn part_face(&mut self, ring: u32, parted: Option<u32>) {
        let face = self.face_of(ring);
        let mut rings = self.faces.get(face).map(|face| face.rings.clone()).unwrap_or_default();
        rings.retain(|known| *known != ring);
        self.set_rings(face, rings);
        let shell = self.shell_of(face);
        let own = if parted.is_some() { self.shells.add(()) } else { shell };
        let made = self.faces.add(EulerFace { rings: vec![ring], shell: own });
        self.set_face(ring, made);
        if parted.is_none() {
            self.handles -= 1;
        } else {
            self.faces_with(made).into_iter().for_each(|face| self.set_shell(face, own));
        }
        self.note(Inverse::KillFaceMakeRing { face, gone: made });
    }

    /// Returns all faces that are connected to a face by edges.
    fn faces_with(&self, face: u32) -> Vec<u32> {
        let mut found = vec![face];
        let mut next = 0;
        while next < found.len() {
            let rings = self.faces.get(found[next]).map(|face| face.rings.clone()).unwrap_or_default();
            for ring in rings {
                let Some(Start::HalfEdge(first)) = self.rings.get(ring).map(|ring| ring.start) else {
                    continue;
                };
                for half in self.around(first) {
                    let adjacent = self.face_of(self.half(half ^ 1).ring);
                    if !found.contains(&adjacent) {
                        found.push(adjacent);
                    }
                }
            }
            next += 1;
        }
        found
    }

    fn note(&mut self, inverse: Inverse) {
        debug_assert!(self.is_lawful());
        self.done.push(inverse);
    }

    fn check(&self, operator: &'static str, half_edge: u32) -> Result<u32> {
        match self.half_edges.get(half_edge / 2) {
            Some(_) => Ok(half_edge),
            None => Err(refused(operator, format!("half-edge {half_edge}"), "one that exists")),
        }
    }

    /// Returns the vertex and the ring of a corner.
    fn corner(&self, operator: &'static str, at: EulerCorner) -> Result<(u32, u32)> {
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

    fn half(&self, half: u32) -> HalfEdge {
        let edge = self.half_edges.list[half as usize / 2].as_ref();
        edge.unwrap_or_else(|| unreachable!("half-edges are checked"))[half as usize % 2]
    }

    fn change(&mut self, half: u32, change: impl FnOnce(&mut HalfEdge)) {
        if let Some(edge) = self.half_edges.list[half as usize / 2].as_mut() {
            change(&mut edge[half as usize % 2]);
        }
    }

    /// Adds an edge that is not linked yet.
    fn add_edge(&mut self, [from, to]: [u32; 2], [one, other]: [u32; 2]) -> u32 {
        let half = |origin, ring| HalfEdge { origin, next: 0, previous: 0, ring };
        2 * self.half_edges.add([half(from, one), half(to, other)])
    }

    fn link(&mut self, from: u32, to: u32) {
        self.change(from, |half| half.next = to);
        self.change(to, |half| half.previous = from);
    }

    /// Assigns the half-edges around one to a ring.
    fn give(&mut self, first: u32, ring: u32) {
        self.around(first).into_iter().for_each(|half| self.change(half, |half| half.ring = ring));
    }

    fn start(&mut self, ring: u32, start: Start) {
        if let Some(ring) = self.rings.list[ring as usize].as_mut() {
            ring.start = start;
        }
    }

    fn set_face(&mut self, ring: u32, face: u32) {
        if let Some(ring) = self.rings.list[ring as usize].as_mut() {
            ring.face = face;
        }
    }

    fn set_rings(&mut self, face: u32, rings: Vec<u32>) {
        if let Some(face) = self.faces.list[face as usize].as_mut() {
            face.rings = rings;
        }
    }

    fn set_shell(&mut self, face: u32, shell: u32) {
        if let Some(face) = self.faces.list[face as usize].as_mut() {
            face.shell = shell;
        }
    }

    fn face_of(&self, ring: u32) -> u32 {
        self.rings.get(ring).map_or(u32::MAX, |ring| ring.face)
    }

    fn shell_of(&self, face: u32) -> u32 {
        self.faces.get(face).map_or(u32::MAX, |face| face.shell)
    }
}
