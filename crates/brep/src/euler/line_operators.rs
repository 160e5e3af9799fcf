//! Operators of the text format: their words, and the entities that they make and remove.

use super::body::EulerCorner;
use super::names::Kind;
use super::text::{EulerText, Line};
use spinney_base::{Error, Result};

impl EulerText {
    /// Applies the operator of a line.
    pub(super) fn operator(&mut self, line: &Line<'_>) -> Result<()> {
        let refusal = |error: Error| line.refusal(error);
        let word = |at: usize| line.words[at];
        let killed = line.number;
        match line.words[0] {
            "mvfs" => {
                line.check("mvfs VERTEX FACE X Y Z")?;
                let (vertex, face) =
                    (self.new_name(line, Kind::Vertex, word(1))?, self.new_name(line, Kind::Face, word(2))?);
                let point = self.point(line)?;
                let (made, ring) = self.body.make_solid(point).map_err(refusal)?;
                let (at, _) = self.body.corner("mvfs", EulerCorner::Lone(ring))?;
                self.names.add(Kind::Vertex, vertex, at);
                self.names.add(Kind::Face, face, made);
            }
            "kvfs" => {
                line.check("kvfs VERTEX FACE")?;
                let (vertex, at) = self.entity(line, Kind::Vertex, word(1))?;
                let (face, gone) = self.entity(line, Kind::Face, word(2))?;
                let corner = self.body.vertices.get(at).map(|vertex| vertex.corner);
                let is_own =
                    matches!(corner, Some(EulerCorner::Lone(ring)) if self.body.face_of(ring) == gone);
                if !is_own {
                    return Err(line.wrong(Line::shown(line.text), "a vertex without edges, and its face"));
                }
                self.body.kill_solid(gone).map_err(refusal)?;
                self.names.kill(Kind::Vertex, vertex, killed);
                self.names.kill(Kind::Face, face, killed);
            }
            "mev" => {
                let is_split = line.words.len() == 8;
                line.check(match is_split {
                    true => "mev CORNER CORNER VERTEX EDGE X Y Z",
                    false => "mev CORNER VERTEX EDGE X Y Z",
                })?;
                let first = self.corner(line, word(1))?;
                let at = if is_split { 3 } else { 2 };
                let second = if is_split { self.corner(line, word(2))? } else { first };
                let vertex = self.new_name(line, Kind::Vertex, word(at))?;
                let edge = self.new_name(line, Kind::Edge, word(at + 1))?;
                let point = self.point(line)?;
                let half = match (first, second) {
                    (EulerCorner::Of(first), EulerCorner::Of(second)) => {
                        self.body.split_vertex(first, second, point)
                    }
                    _ => self.body.make_edge_vertex(first, point),
                };
                let half = half.map_err(refusal)?;
                self.names.add(Kind::Vertex, vertex, self.body.ends(half)[1]);
                self.names.add(Kind::Edge, edge, half / 2);
            }
            "kev" => {
                line.check("kev EDGE VERTEX")?;
                let (edge, at) = self.entity(line, Kind::Edge, word(1))?;
                let (vertex, gone) = self.entity(line, Kind::Vertex, word(2))?;
                let half = self.half_at(at, gone, true);
                let half =
                    half.ok_or_else(|| line.wrong(Line::shown(line.text), "an edge, and one of its ends"))?;
                self.body.kill_edge_vertex(half).map_err(refusal)?;
                self.names.kill(Kind::Edge, edge, killed);
                self.names.kill(Kind::Vertex, vertex, killed);
            }
            "mef" => {
                line.check("mef CORNER CORNER EDGE FACE")?;
                let edge = self.new_name(line, Kind::Edge, word(3))?;
                let face = self.new_name(line, Kind::Face, word(4))?;
                let [from, to] = self.pair_in_ring(line, [word(1), word(2)])?;
                let half = self.body.make_edge_face(from, to).map_err(refusal)?;
                self.names.add(Kind::Edge, edge, half / 2);
                self.names.add(Kind::Face, face, self.body.face(half ^ 1)?);
            }
            "kef" => {
                line.check("kef EDGE FACE")?;
                let (edge, at) = self.entity(line, Kind::Edge, word(1))?;
                let (face, gone) = self.entity(line, Kind::Face, word(2))?;
                let is_beyond = |half: &u32| self.body.face(half ^ 1).is_ok_and(|face| face == gone);
                let half = [2 * at, 2 * at + 1].into_iter().find(is_beyond);
                let half = half.ok_or_else(|| {
                    line.wrong(Line::shown(line.text), "an edge, and a face on one of its sides")
                })?;
                self.body.kill_edge_face(half).map_err(refusal)?;
                self.names.kill(Kind::Edge, edge, killed);
                self.names.kill(Kind::Face, face, killed);
            }
            "semv" => {
                line.check("semv EDGE VERTEX VERTEX EDGE X Y Z")?;
                let (_, at) = self.entity(line, Kind::Edge, word(1))?;
                let (_, end) = self.entity(line, Kind::Vertex, word(2))?;
                let vertex = self.new_name(line, Kind::Vertex, word(3))?;
                let edge = self.new_name(line, Kind::Edge, word(4))?;
                let half = self.half_at(at, end, true);
                let half =
                    half.ok_or_else(|| line.wrong(Line::shown(line.text), "an edge, and one of its ends"))?;
                let point = self.point(line)?;
                let half = self.body.split_edge(half, point).map_err(refusal)?;
                self.names.add(Kind::Vertex, vertex, self.body.ends(half)[0]);
                self.names.add(Kind::Edge, edge, half / 2);
            }
            "jekv" => {
                line.check("jekv VERTEX EDGE")?;
                let (vertex, gone) = self.entity(line, Kind::Vertex, word(1))?;
                let (edge, at) = self.entity(line, Kind::Edge, word(2))?;
                let half = self.half_at(at, gone, false);
                let half =
                    half.ok_or_else(|| line.wrong(Line::shown(line.text), "a vertex, and one of its edges"))?;
                self.body.join_edges(half).map_err(refusal)?;
                self.names.kill(Kind::Vertex, vertex, killed);
                self.names.kill(Kind::Edge, edge, killed);
            }
            _ => return self.ring_operator(line),
        }
        Ok(())
    }

    /// Applies an operator that makes or removes a ring, or moves one.
    fn ring_operator(&mut self, line: &Line<'_>) -> Result<()> {
        let refusal = |error: Error| line.refusal(error);
        let word = |at: usize| line.words[at];
        let killed = line.number;
        match line.words[0] {
            "kemr" => {
                line.check("kemr EDGE VERTEX RING")?;
                let (edge, at) = self.entity(line, Kind::Edge, word(1))?;
                let (_, end) = self.entity(line, Kind::Vertex, word(2))?;
                let ring = self.new_name(line, Kind::Ring, word(3))?;
                let half = self.half_at(at, end, true);
                let half =
                    half.ok_or_else(|| line.wrong(Line::shown(line.text), "an edge, and one of its ends"))?;
                let made = self.body.kill_edge_make_ring(half).map_err(refusal)?;
                self.names.kill(Kind::Edge, edge, killed);
                self.names.add(Kind::Ring, ring, made);
            }
            "mekr" => {
                line.check("mekr CORNER CORNER EDGE RING")?;
                let edge = self.new_name(line, Kind::Edge, word(3))?;
                let (ring, gone) = self.entity(line, Kind::Ring, word(4))?;
                let face = self.body.face_of(gone);
                let in_ring = |corner: &EulerCorner| self.ring(*corner) == gone;
                let is_other = |corner: &EulerCorner| {
                    let ring = self.ring(*corner);
                    ring != gone && self.body.face_of(ring) == face
                };
                let mut from = self.corners(line, word(1))?;
                from.retain(is_other);
                let mut to = self.corners(line, word(2))?;
                to.retain(in_ring);
                let (from, to) = match (&from[..], &to[..]) {
                    ([from], [to]) => (*from, *to),
                    ([], _) | (_, []) => {
                        let expected = "a corner of another ring of the ring's face, and one of the ring";
                        return Err(line.wrong(Line::shown(line.text), expected));
                    }
                    ([_], several) => return Err(self.ambiguous(line, word(2), several)),
                    (several, _) => return Err(self.ambiguous(line, word(1), several)),
                };
                let half = self.body.make_edge_kill_ring(from, to).map_err(refusal)?;
                self.names.add(Kind::Edge, edge, half / 2);
                self.names.kill(Kind::Ring, ring, killed);
            }
            operator @ ("kfmrh" | "ksfmr") => {
                line.check(if operator == "kfmrh" {
                    "kfmrh FACE FACE RING"
                } else {
                    "ksfmr FACE FACE RING"
                })?;
                let (_, kept) = self.entity(line, Kind::Face, word(1))?;
                let (face, gone) = self.entity(line, Kind::Face, word(2))?;
                let name = self.new_name(line, Kind::Ring, word(3))?;
                let ring = self.body.faces.get(gone).and_then(|face| face.rings.first().copied());
                let joined = match operator {
                    "kfmrh" => self.body.kill_face_make_ring(kept, gone),
                    _ => self.body.kill_shell_face_make_ring(kept, gone),
                };
                joined.map_err(refusal)?;
                self.names.kill(Kind::Face, face, killed);
                self.names.add(Kind::Ring, name, ring.unwrap_or(u32::MAX));
            }
            operator @ ("mfkrh" | "msfkr") => {
                line.check(if operator == "mfkrh" { "mfkrh RING FACE" } else { "msfkr RING FACE" })?;
                let (ring, gone) = self.entity(line, Kind::Ring, word(1))?;
                let face = self.new_name(line, Kind::Face, word(2))?;
                let made = match operator {
                    "mfkrh" => self.body.make_face_kill_ring(gone),
                    _ => self.body.make_shell_face_kill_ring(gone),
                };
                let made = made.map_err(refusal)?;
                self.names.kill(Kind::Ring, ring, killed);
                self.names.add(Kind::Face, face, made);
            }
            "ringmv" => {
                line.check("ringmv RING FACE")?;
                let (_, ring) = self.entity(line, Kind::Ring, word(1))?;
                let (_, face) = self.entity(line, Kind::Face, word(2))?;
                self.body.move_ring(ring, face).map_err(refusal)?;
            }
            other => {
                let expected = "mvfs, kvfs, mev, kev, mef, kef, kemr, mekr, kfmrh, mfkrh, ksfmr, msfkr, semv, jekv, ringmv, unit, step or part";
                return Err(line.wrong(Line::shown(other), expected));
            }
        }
        Ok(())
    }
}
