//! Undoing operators.

use super::body::{EulerBody, EulerCorner};
use spinney_base::Result;

/// Inverse of an applied operator. The last number is that of the half-edge that it removed.
#[derive(Clone, Copy, Debug)]
pub(super) enum Inverse {
    KillSolid(u32),
    MakeSolid([f64; 3], Option<u32>),
    MakeEdgeVertex(EulerCorner, [f64; 3], u32),
    SplitVertex([u32; 2], [f64; 3], u32),
    KillEdgeVertex(u32),
    MakeEdgeFace([u32; 2], Option<u32>, u32),
    KillEdgeFace(u32),
    SplitEdge(u32, [f64; 3], u32),
    JoinEdges(u32),
    MakeEdgeKillRing([EulerCorner; 2], u32),
    KillEdgeMakeRing(u32),
    RingToFace { ring: u32, source: Option<u32>, is_parted: bool },
    KillFaceMakeRing { face: u32, gone: u32 },
    MoveRing { ring: u32, to: u32 },
}

impl EulerBody {
    /// Undoes the last operator that was not undone; returns whether there was one.
    ///
    /// # Errors
    /// Only if this module has a defect: an inverse is always possible.
    pub fn undo(&mut self) -> Result<bool> {
        let Some(inverse) = self.done.pop() else { return Ok(false) };
        let known = self.done.len();
        // Invariant: an inverse refers to the state after its operator, which is restored here,
        // with equal numbers of all entities; it would fail in any other state.
        match inverse {
            Inverse::KillSolid(face) => self.kill_solid(face)?,
            Inverse::MakeSolid(point, source) => drop(self.add_solid(point, source)),
            Inverse::MakeEdgeVertex(at, point, half) => {
                self.is_next_odd = half % 2 == 1;
                self.make_edge_vertex(at, point)?;
            }
            Inverse::SplitVertex([first, second], point, half) => {
                self.is_next_odd = half % 2 == 1;
                self.split_vertex(first, second, point)?;
            }
            Inverse::KillEdgeVertex(half) => self.kill_edge_vertex(half)?,
            Inverse::MakeEdgeFace([from, to], source, half) => {
                self.is_next_odd = half % 2 == 1;
                let half = self.make_edge_face(from, to)?;
                let face = self.face_of(self.half(half ^ 1).ring);
                if let Some(face) = self.faces.get_mut(face) {
                    face.source = source;
                }
            }
            Inverse::KillEdgeFace(half) => self.kill_edge_face(half)?,
            Inverse::SplitEdge(kept, point, half) => {
                self.is_next_odd = half % 2 == 1;
                self.split_edge(kept, point)?;
            }
            Inverse::JoinEdges(half) => self.join_edges(half)?,
            Inverse::MakeEdgeKillRing([from, to], half) => {
                self.is_next_odd = half % 2 == 1;
                self.make_edge_kill_ring(from, to)?;
            }
            Inverse::KillEdgeMakeRing(half) => drop(self.kill_edge_make_ring(half)?),
            Inverse::RingToFace { ring, source, is_parted } => drop(self.part_face(ring, source, is_parted)),
            Inverse::KillFaceMakeRing { face, gone } => self.face_to_ring("undo", face, gone, None)?,
            Inverse::MoveRing { ring, to } => self.move_ring(ring, to)?,
        }
        debug_assert!(self.is_lawful());
        self.done.truncate(known);
        Ok(true)
    }
}
