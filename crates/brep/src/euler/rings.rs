//! Operators that make or remove rings, and change shells and handles.

use std::collections::BTreeSet;

use super::body::{EulerBody, EulerCorner, EulerFace, Start, refused};
use super::undo::Inverse;
use spinney_base::Result;

/// The two operators that make a face a ring of another one, which depend on their shells.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum FaceToRing {
    /// *kfmrh*: in one shell, which gets a handle.
    Handle,
    /// *ksfmr*: of two shells, which become one.
    Shell,
}

impl EulerBody {
    /// *kemr*: removes an edge that has the same ring on both sides. The half of the ring beyond
    /// the half-edge's end becomes a separate ring, whose number is returned.
    ///
    /// # Errors
    /// If there is no such half-edge, or its sides belong to different rings.
    pub fn kill_edge_make_ring(&mut self, half_edge: u32) -> Result<u32> {
        let half = self.check("kemr", half_edge)?;
        let (one, other) = (self.half(half), self.half(half ^ 1));
        if one.ring != other.ring {
            return Err(refused(
                "kemr",
                format!("half-edge {half}"),
                "an edge with the same ring on both sides",
            ));
        }
        let face = self.face_of(one.ring);
        let is_alone = [other.next == half, one.next == half ^ 1];
        let mut corners = [EulerCorner::Lone(one.ring), EulerCorner::Lone(0)];
        if is_alone[0] {
            self.start(one.ring, Start::Vertex(one.origin));
        } else {
            self.link(one.previous, other.next);
            self.start(one.ring, Start::HalfEdge(other.next));
            corners[0] = EulerCorner::Of(other.next);
        }
        let ring = if is_alone[1] {
            self.add_ring(face, Start::Vertex(other.origin))
        } else {
            self.link(other.previous, one.next);
            let ring = self.add_ring(face, Start::HalfEdge(one.next));
            self.give(one.next, ring);
            ring
        };
        corners[1] = if is_alone[1] { EulerCorner::Lone(ring) } else { EulerCorner::Of(one.next) };
        self.half_edges.remove(half / 2);
        self.note(Inverse::MakeEdgeKillRing(corners, half));
        Ok(ring)
    }

    /// *mekr*: makes an edge from a corner of a face to a corner of another of its rings, which is
    /// merged with the first corner's ring. Returns the half-edge to the second corner.
    ///
    /// # Errors
    /// If there are no such corners, they belong to one ring, one vertex or different faces, or the
    /// second one belongs to the outer ring.
    pub fn make_edge_kill_ring(&mut self, from: EulerCorner, to: EulerCorner) -> Result<u32> {
        let ((a, ring), (b, gone)) = (self.corner("mekr", from)?, self.corner("mekr", to)?);
        let face = self.face_of(ring);
        if ring == gone || a == b || !self.is_inner(face, gone) {
            let found = format!("rings {ring} and {gone}");
            let expected = "corners of two rings of one face, of which the second is not the outer one, at different vertices";
            return Err(refused("mekr", found, expected));
        }
        let half = self.add_edge([a, b], [ring; 2])?;
        self.drop_ring(face, gone);
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
        self.set_corner(half ^ 1);
        self.give(half, ring);
        self.rings.remove(gone);
        self.note(Inverse::KillEdgeMakeRing(half));
        Ok(half)
    }

    /// Returns whether a ring is one of a face, and not its outer one.
    fn is_inner(&self, face: u32, ring: u32) -> bool {
        self.face_of(ring) == face
            && self.faces.get(face).is_some_and(|face| face.rings.first() != Some(&ring))
    }

    /// Removes a ring from a face's list.
    fn drop_ring(&mut self, face: u32, ring: u32) {
        if let Some(face) = self.faces.get_mut(face) {
            face.rings.retain(|known| *known != ring);
        }
    }

    /// *kfmrh*: removes a face of one ring, which becomes a ring of another face of the same shell.
    /// This adds a handle.
    ///
    /// # Errors
    /// If there are no such faces, they have different shells, or the second one has more rings.
    pub fn kill_face_make_ring(&mut self, face: u32, gone: u32) -> Result<()> {
        self.face_to_ring("kfmrh", face, gone, Some(FaceToRing::Handle))
    }

    /// *ksfmr*: removes a face of one ring, which becomes a ring of a face of another shell. The
    /// shells become one.
    ///
    /// # Errors
    /// If there are no such faces, they have one shell, or the second one has more rings.
    pub fn kill_shell_face_make_ring(&mut self, face: u32, gone: u32) -> Result<()> {
        self.face_to_ring("ksfmr", face, gone, Some(FaceToRing::Shell))
    }

    pub(super) fn face_to_ring(
        &mut self,
        operator: &'static str,
        face: u32,
        gone: u32,
        expected: Option<FaceToRing>,
    ) -> Result<()> {
        let (Some(own), Some(other), true) = (self.faces.get(face), self.faces.get(gone), face != gone)
        else {
            return Err(refused(operator, format!("faces {face} and {gone}"), "two faces"));
        };
        let &[ring] = &other.rings[..] else {
            return Err(refused(operator, format!("face {gone}"), "a face of one ring"));
        };
        let (kept, merged, source) = (own.shell, other.shell, other.source);
        let found = if kept == merged { FaceToRing::Handle } else { FaceToRing::Shell };
        if expected.is_some_and(|expected| expected != found) {
            let (shells, expected) = match found {
                FaceToRing::Handle => ("faces of one shell", "faces of two shells; kfmrh joins those of one"),
                FaceToRing::Shell => ("faces of two shells", "faces of one shell; ksfmr joins those of two"),
            };
            return Err(refused(operator, shells, expected));
        }
        self.faces.remove(gone);
        self.put_ring(ring, face);
        if found == FaceToRing::Handle {
            self.handles += 1;
        } else {
            let merged_faces: Vec<u32> =
                self.faces.numbers().filter(|face| self.shell_of(*face) == merged).collect();
            merged_faces.into_iter().for_each(|face| self.set_shell(face, kept));
            self.shells.remove(merged);
        }
        self.note(Inverse::RingToFace { ring, source, is_parted: found == FaceToRing::Shell });
        Ok(())
    }

    /// *mfkrh*: makes a ring that is not a face's outer one a face of its own, which removes a
    /// handle. Returns the face.
    ///
    /// # Errors
    /// If there is no such ring, or the shell would fall apart.
    pub fn make_face_kill_ring(&mut self, ring: u32) -> Result<u32> {
        self.ring_to_face("mfkrh", ring, Some(FaceToRing::Handle))
    }

    /// *msfkr*: makes a ring that is not a face's outer one a face of its own, which divides the
    /// shell. Returns the face.
    ///
    /// # Errors
    /// If there is no such ring, or the shell would not fall apart.
    pub fn make_shell_face_kill_ring(&mut self, ring: u32) -> Result<u32> {
        self.ring_to_face("msfkr", ring, Some(FaceToRing::Shell))
    }

    fn ring_to_face(
        &mut self,
        operator: &'static str,
        ring: u32,
        expected: Option<FaceToRing>,
    ) -> Result<u32> {
        let face = self.face_of(ring);
        if !self.is_inner(face, ring) {
            let expected = "a ring of a face that is not its outer one";
            return Err(refused(operator, format!("ring {ring}"), expected));
        }
        let source = self.source_of(face);
        let rings = self.faces.get(face).map_or_else(Vec::new, |face| face.rings.clone());
        let (made, reached) = self.take_ring(ring, source);
        let found = if reached.contains(&face) { FaceToRing::Handle } else { FaceToRing::Shell };
        if expected.is_some_and(|expected| expected != found) {
            self.faces.remove(made);
            self.put_ring(ring, face);
            if let Some(face) = self.faces.get_mut(face) {
                face.rings = rings;
            }
            let (found, expected) = match found {
                FaceToRing::Handle => {
                    ("a ring that is connected with its face", "one that is not; mfkrh removes a handle")
                }
                FaceToRing::Shell => (
                    "a ring that is connected with its face by nothing else",
                    "one that is; msfkr divides a shell",
                ),
            };
            return Err(refused(operator, found, expected));
        }
        self.part(made, found, reached);
        self.note(Inverse::KillFaceMakeRing { face, gone: made });
        Ok(made)
    }

    /// Makes a ring a face, whose inverse is known: `is_parted` says whether the shell falls apart.
    pub(super) fn part_face(&mut self, ring: u32, source: Option<u32>, is_parted: bool) -> u32 {
        let face = self.face_of(ring);
        let (made, reached) = self.take_ring(ring, source);
        debug_assert_eq!(reached.contains(&face), !is_parted);
        self.part(made, if is_parted { FaceToRing::Shell } else { FaceToRing::Handle }, reached);
        self.note(Inverse::KillFaceMakeRing { face, gone: made });
        made
    }

    /// Makes a ring a face of the same shell. Returns it, and all faces that are connected with it.
    fn take_ring(&mut self, ring: u32, source: Option<u32>) -> (u32, BTreeSet<u32>) {
        let face = self.face_of(ring);
        self.drop_ring(face, ring);
        let shell = self.shell_of(face);
        let made = self.faces.add(EulerFace { rings: Vec::new(), shell, source });
        self.put_ring(ring, made);
        (made, self.faces_with(made))
    }

    /// Removes a handle, or makes a shell of some faces.
    fn part(&mut self, made: u32, what: FaceToRing, faces: BTreeSet<u32>) {
        debug_assert!(faces.contains(&made));
        match what {
            FaceToRing::Handle => self.handles -= 1,
            FaceToRing::Shell => {
                let shell = self.shells.add(());
                faces.into_iter().for_each(|face| self.set_shell(face, shell));
            }
        }
    }

    /// *ringmv*: moves a ring that is not a face's outer one to another face. This can join shells,
    /// divide one, or change its handles.
    ///
    /// # Errors
    /// If there is no such ring or face.
    pub fn move_ring(&mut self, ring: u32, to: u32) -> Result<()> {
        let from = self.face_of(ring);
        if self.faces.get(to).is_none() || from == to || !self.is_inner(from, ring) {
            let found = format!("ring {ring} and face {to}");
            return Err(refused("ringmv", found, "a ring that is not an outer one, and another face"));
        }
        let noted = self.done.len();
        let made = self.ring_to_face("ringmv", ring, None)?;
        self.face_to_ring("ringmv", to, made, None)?;
        self.done.truncate(noted);
        self.note(Inverse::MoveRing { ring, to: from });
        Ok(())
    }

    /// Returns a face, and all faces that are connected with it.
    fn faces_with(&self, face: u32) -> BTreeSet<u32> {
        let mut found = BTreeSet::from([face]);
        let mut open = vec![face];
        while let Some(face) = open.pop() {
            for ring in self.faces.get(face).into_iter().flat_map(|face| &face.rings) {
                let Some(Start::HalfEdge(first)) = self.rings.get(*ring).map(|ring| ring.start) else {
                    continue;
                };
                for half in self.around(first) {
                    let adjacent = self.face_of(self.half(half ^ 1).ring);
                    if found.insert(adjacent) {
                        open.push(adjacent);
                    }
                }
            }
        }
        found
    }

    /// Assigns a ring to a face, after its others.
    fn put_ring(&mut self, ring: u32, face: u32) {
        if let Some(ring) = self.rings.get_mut(ring) {
            ring.face = face;
        }
        if let Some(face) = self.faces.get_mut(face) {
            face.rings.push(ring);
        }
    }

    fn set_shell(&mut self, face: u32, shell: u32) {
        if let Some(face) = self.faces.get_mut(face) {
            face.shell = shell;
        }
    }
}
