//! Operators that make or remove an edge with a vertex or a face.

use super::body::{EulerBody, EulerCorner, EulerFace, EulerRing, EulerVertex, Start, refused};
use super::undo::Inverse;
use spinney_base::Result;

impl EulerBody {
    /// *mvfs*: makes a vertex, a face with a ring without edges, and a shell; returns the face and
    /// the ring.
    ///
    /// # Errors
    /// If a coordinate is not finite.
    pub fn make_solid(&mut self, point: [f64; 3]) -> Result<(u32, u32)> {
        finite("mvfs", point)?;
        Ok(self.add_solid(point, None))
    }

    pub(super) fn add_solid(&mut self, point: [f64; 3], source: Option<u32>) -> (u32, u32) {
        let shell = self.shells.add(());
        let face = self.faces.add(EulerFace { rings: Vec::new(), shell, source });
        let vertex = self.vertices.add(EulerVertex { point, corner: EulerCorner::Lone(0) });
        let ring = self.add_ring(face, Start::Vertex(vertex));
        self.note(Inverse::KillSolid(face));
        (face, ring)
    }

    /// *kvfs*: removes a face whose only ring has no edges, its vertex and its shell.
    ///
    /// # Errors
    /// If there is no such face.
    pub fn kill_solid(&mut self, face: u32) -> Result<()> {
        let found = self.faces.get(face).cloned().filter(|face| face.rings.len() == 1);
        let ring = found.as_ref().and_then(|face| self.rings.get(face.rings[0]).copied());
        let (Some(own), Some(EulerRing { start: Start::Vertex(vertex), .. })) = (found, ring) else {
            return Err(refused("kvfs", format!("face {face}"), "a face of one vertex without edges"));
        };
        let point = self.vertices.get(vertex).map_or([0.0; 3], |vertex| vertex.point);
        self.rings.remove(own.rings[0]);
        self.faces.remove(face);
        self.shells.remove(own.shell);
        self.vertices.remove(vertex);
        self.note(Inverse::MakeSolid(point, own.source));
        Ok(())
    }

    /// Adds a ring to a face, after its others.
    pub(super) fn add_ring(&mut self, face: u32, start: Start) -> u32 {
        let ring = self.rings.add(EulerRing { face, start });
        if let Some(face) = self.faces.get_mut(face) {
            face.rings.push(ring);
        }
        self.start(ring, start);
        ring
    }

    /// *mev*: makes an edge from a corner to a new vertex; returns the half-edge to the vertex.
    ///
    /// # Errors
    /// If there is no such corner, or a coordinate is not finite.
    pub fn make_edge_vertex(&mut self, at: EulerCorner, point: [f64; 3]) -> Result<u32> {
        finite("mev", point)?;
        let (from, ring) = self.corner("mev", at)?;
        let to = self.vertices.add(EulerVertex { point, corner: at });
        let half = self.add_edge([from, to], [ring; 2])?;
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
        self.set_corner(half ^ 1);
        self.note(Inverse::KillEdgeVertex(half));
        Ok(half)
    }

    /// *mev* between two corners of a vertex, given by half-edges: the edges from the first one,
    /// clockwise, up to before the second one move to a new vertex. Returns the half-edge to the
    /// vertex. With equal corners, it is [`EulerBody::make_edge_vertex`].
    ///
    /// # Errors
    /// If there are no such half-edges, or they begin at different vertices, or a coordinate is not
    /// finite.
    pub fn split_vertex(&mut self, first: u32, second: u32, point: [f64; 3]) -> Result<u32> {
        if first == second {
            return self.make_edge_vertex(EulerCorner::Of(first), point);
        }
        finite("mev", point)?;
        let (one, other) = (self.half(self.check("mev", first)?), self.half(self.check("mev", second)?));
        if one.origin != other.origin {
            let found = format!("half-edges {first} and {second}");
            return Err(refused("mev", found, "two corners of one vertex"));
        }
        let from = one.origin;
        let to = self.vertices.add(EulerVertex { point, corner: EulerCorner::Of(first) });
        let half = self.add_edge([from, to], [one.ring, other.ring])?;
        let mut at = first;
        while at != second {
            self.change(at, |half| half.origin = to);
            at = self.half(at ^ 1).next;
        }
        self.link(one.previous, half);
        self.link(half, first);
        self.link(other.previous, half ^ 1);
        self.link(half ^ 1, second);
        self.set_corner(second);
        self.note(Inverse::KillEdgeVertex(half));
        Ok(half)
    }

    /// *kev*: removes an edge and the vertex at a half-edge's end, whose other edges move to the
    /// half-edge's start.
    ///
    /// # Errors
    /// If there is no such half-edge, if another edge has the same vertices, or if only the vertex
    /// that is removed has other edges.
    pub fn kill_edge_vertex(&mut self, half_edge: u32) -> Result<()> {
        let half = self.check("kev", half_edge)?;
        let back = half ^ 1;
        let (one, other) = (self.half(half), self.half(back));
        let (from, to) = (one.origin, other.origin);
        let point = self.vertices.get(to).map_or([0.0; 3], |vertex| vertex.point);
        let inverse = if one.next == back {
            let at = if other.next == half {
                self.start(one.ring, Start::Vertex(from));
                EulerCorner::Lone(one.ring)
            } else {
                self.link(one.previous, other.next);
                self.start(one.ring, Start::HalfEdge(other.next));
                EulerCorner::Of(other.next)
            };
            Inverse::MakeEdgeVertex(at, point, half)
        } else {
            let moved: Vec<u32> = self.half_edges_of(to).filter(|moved| *moved != back).collect();
            let is_double = moved.iter().any(|moved| self.half(moved ^ 1).origin == from);
            if is_double || other.next == half {
                return Err(refused(
                    "kev",
                    format!("half-edge {half}"),
                    "an edge whose vertices have no other common edge, with other edges at the vertex that stays",
                ));
            }
            moved.into_iter().for_each(|moved| self.change(moved, |half| half.origin = from));
            self.link(one.previous, one.next);
            self.link(other.previous, other.next);
            self.start(one.ring, Start::HalfEdge(one.next));
            self.start(other.ring, Start::HalfEdge(other.next));
            Inverse::SplitVertex([one.next, other.next], point, half)
        };
        self.half_edges.remove(half / 2);
        self.vertices.remove(to);
        self.note(inverse);
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
        let (a, b) = (self.half(self.check("mef", from)?), self.half(self.check("mef", to)?));
        if a.ring != b.ring || a.origin == b.origin {
            let found = format!("half-edges {from} and {to}");
            return Err(refused("mef", found, "two corners of one ring, at different vertices"));
        }
        let old = self.face_of(a.ring);
        let (shell, source) = (self.shell_of(old), self.source_of(old));
        let half = self.add_edge([a.origin, b.origin], [a.ring; 2])?;
        let face = self.faces.add(EulerFace { rings: Vec::new(), shell, source });
        self.link(a.previous, half);
        self.link(half, to);
        self.link(b.previous, half ^ 1);
        self.link(half ^ 1, from);
        self.start(a.ring, Start::HalfEdge(half));
        let ring = self.add_ring(face, Start::HalfEdge(half ^ 1));
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
        let source = self.source_of(gone);
        if own == gone || self.faces.get(gone).is_none_or(|face| face.rings.len() > 1) {
            return Err(refused(
                "kef",
                format!("half-edge {half}"),
                "an edge with another face of one ring on its other side",
            ));
        }
        self.give(half ^ 1, one.ring);
        self.link(one.previous, other.next);
        self.link(other.previous, one.next);
        self.set_corner(other.next);
        self.start(one.ring, Start::HalfEdge(one.next));
        self.rings.remove(other.ring);
        self.half_edges.remove(half / 2);
        self.faces.remove(gone);
        self.note(Inverse::MakeEdgeFace([other.next, one.next], source, half));
        Ok(())
    }

    /// *semv*: divides the edge of a half-edge at a new vertex. Returns the half-edge from there to
    /// the end, whose edge is new.
    ///
    /// # Errors
    /// If there is no such half-edge, or a coordinate is not finite.
    pub fn split_edge(&mut self, half_edge: u32, point: [f64; 3]) -> Result<u32> {
        finite("semv", point)?;
        let half = self.check("semv", half_edge)?;
        let (one, other) = (self.half(half), self.half(half ^ 1));
        let (vertex, end) = (self.vertices.slots() as u32, other.origin);
        let new = self.add_edge([vertex, end], [one.ring, other.ring])?;
        let vertex = self.vertices.add(EulerVertex { point, corner: EulerCorner::Of(new) });
        self.change(new, |half| half.origin = vertex);
        self.change(half ^ 1, |half| half.origin = vertex);
        if one.next == half ^ 1 {
            self.link(new, new ^ 1);
        } else {
            self.link(new, one.next);
            self.link(other.previous, new ^ 1);
        }
        self.link(half, new);
        self.link(new ^ 1, half ^ 1);
        self.set_corner(new ^ 1);
        self.note(Inverse::JoinEdges(new));
        Ok(new)
    }

    /// *jekv*: removes the edge of a half-edge and the vertex at which that begins, which must have
    /// one other edge. This edge then leads to the half-edge's end.
    ///
    /// # Errors
    /// If there is no such half-edge, the vertex does not have two edges, or these have the same
    /// vertices.
    pub fn join_edges(&mut self, half_edge: u32) -> Result<()> {
        let half = self.check("jekv", half_edge)?;
        let (one, other) = (self.half(half), self.half(half ^ 1));
        let (vertex, end, kept) = (one.origin, other.origin, one.previous);
        let has_two = self.half_edges_of(vertex).take(3).count() == 2;
        if !has_two || self.half(kept).origin == end {
            return Err(refused(
                "jekv",
                format!("half-edge {half}"),
                "a vertex of two edges, with different vertices at their other ends",
            ));
        }
        let point = self.vertices.get(vertex).map_or([0.0; 3], |vertex| vertex.point);
        self.change(kept ^ 1, |half| half.origin = end);
        if one.next == half ^ 1 {
            self.link(kept, kept ^ 1);
        } else {
            self.link(kept, one.next);
            self.link(other.previous, kept ^ 1);
        }
        self.half_edges.remove(half / 2);
        self.vertices.remove(vertex);
        self.start(one.ring, Start::HalfEdge(kept));
        self.start(other.ring, Start::HalfEdge(kept ^ 1));
        self.note(Inverse::SplitEdge(kept, point, half));
        Ok(())
    }
}

/// Checks that a point's coordinates are finite.
pub(super) fn finite(operator: &'static str, point: [f64; 3]) -> Result<()> {
    match point.iter().all(|at| at.is_finite()) {
        true => Ok(()),
        false => Err(refused(operator, format!("the point {point:?}"), "finite coordinates")),
    }
}
