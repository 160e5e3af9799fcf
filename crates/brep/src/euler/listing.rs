//! A body as a text of the operators that build it from nothing.
//!
//! The body is taken apart by operators, down to nothing. Their inverses, in the opposite order,
//! build it.

use std::collections::{BTreeMap, HashSet, VecDeque};
use std::fmt::Write as _;

use super::body::{EulerBody, EulerCorner, Start};
use super::model::ModelBody;
use crate::Faces as _;
use spinney_base::{Error, Progress, Result};

/// Returns a text of the operators that build a model, with its unit, its grid and the names of its
/// parts; a warning names what the text lacks. Its names are those of
/// [`edit_model`](super::edit_model): vertices, edges, faces and rings have their numbers in the
/// model's topology, and entities that the text removes again have higher ones.
///
/// # Errors
/// If the text would have more than `limit` lines, if the model does not fit in the memory, or
/// cannot be represented ([`ModelBody::of`]), or on cancellation.
pub fn euler_text(model: &ModelBody<'_>, limit: u64, progress: &dyn Progress) -> Result<String> {
    let mut body = model.body().clone();
    body.forgets = true;
    let grid = model.model().grid();
    let number = [body.half_edges.slots(), body.faces.slots(), body.rings.slots()].map(|count| count as u32);
    let mut taking = Taking {
        body,
        names: BTreeMap::new(),
        next: number,
        text: String::new(),
        starts: Vec::new(),
        limit,
        progress,
    };
    taking.join_rings()?;
    let mut shells = BTreeMap::new();
    for face in taking.body.faces.numbers() {
        shells.entry(taking.body.shell_of(face)).or_insert(face);
    }
    for face in shells.into_values().rev() {
        taking.take_shell(face, &|point| grid.to_world_between(point))?;
    }
    model.warn_losses(progress)?;
    let mut text = String::new();
    if let Some(unit) = model.model().unit() {
        let _ = writeln!(text, "unit {unit}");
    }
    let _ = writeln!(text, "step {}", grid.width());
    let ends = taking.starts.iter().skip(1).copied().chain([taking.text.len()]);
    let lines: Vec<&str> =
        taking.starts.iter().zip(ends).map(|(start, end)| &taking.text[*start..end]).collect();
    lines.into_iter().rev().for_each(|line| text.push_str(line));
    let parts = model.model().parts();
    let is_named = parts.len() > 1 || parts.first().is_some_and(|name| name != "mesh");
    if is_named {
        model.each_part(&mut |face, part| {
            // (A part without a name, or with line breaks in it, would not be read again.)
            let name = parts.get(part as usize).map_or("", |name| name);
            let name: String =
                name.chars().map(|c| if c.is_control() || "#;".contains(c) { ' ' } else { c }).collect();
            if !name.trim().is_empty() {
                let _ = writeln!(text, "part f{face} {}", name.trim());
            }
        });
    }
    Ok(text)
}

/// A body that is taken apart.
struct Taking<'a> {
    body: EulerBody,
    /// Names of entities that were made meanwhile: kind (edge, face, ring) and number.
    names: BTreeMap<(usize, u32), u32>,
    /// The next names of edges, faces and rings.
    next: [u32; 3],
    /// Lines in the order in which the body is taken apart.
    text: String,
    starts: Vec<usize>,
    limit: u64,
    progress: &'a dyn Progress,
}

const EDGE: usize = 0;
const FACE: usize = 1;
const RING: usize = 2;

impl Taking<'_> {
    /// Adds a line.
    fn line(&mut self, line: &str) -> Result<()> {
        let count = self.starts.len() as u64;
        if count >= self.limit {
            let found = format!("more than {} operators", self.limit);
            return Err(Error::invalid("dump", found, "at most these; raise --limit"));
        }
        if count.is_multiple_of(1 << 12) {
            self.progress.check()?;
        }
        self.starts.push(self.text.len());
        self.text.push_str(line);
        self.text.push('\n');
        Ok(())
    }

    /// Gives a new name to an entity that was made.
    fn name(&mut self, kind: usize, number: u32) {
        self.names.insert((kind, number), self.next[kind]);
        self.next[kind] += 1;
    }

    fn shown(&self, kind: usize, number: u32) -> String {
        let name = self.names.get(&(kind, number)).copied().unwrap_or(number);
        format!("{}{name}", ['e', 'f', 'r'][kind])
    }

    fn edge(&self, half: u32) -> String {
        self.shown(EDGE, half / 2)
    }

    /// Returns the corner at which a half-edge begins.
    fn corner(&self, half: u32) -> String {
        let [vertex, _] = self.body.ends(half);
        match self.body.half_edges_of(vertex).take(2).count() {
            1 => format!("v{vertex}"),
            _ => format!("v{vertex}:{}", self.edge(half)),
        }
    }

    fn first(&self, ring: u32) -> Option<u32> {
        match self.body.rings.get(ring)?.start {
            Start::HalfEdge(half) => Some(half),
            Start::Vertex(_) => None,
        }
    }

    /// Joins the rings of each face.
    fn join_rings(&mut self) -> Result<()> {
        let faces: Vec<u32> = self.body.faces.numbers().collect();
        for face in faces {
            while let Some((outer, inner)) = self.rings_of(face) {
                let (Some(first), Some(to)) = (self.first(outer), self.first(inner)) else { break };
                let [end, _] = self.body.ends(to);
                // (Surfaces that touch have two rings with one vertex.)
                let from = self.body.around(first).find(|half| self.body.ends(*half)[0] != end);
                let Some(from) = from else { break };
                let half = self.body.make_edge_kill_ring(EulerCorner::Of(from), EulerCorner::Of(to))?;
                self.name(EDGE, half / 2);
                let line = format!("kemr {} v{end} {}", self.edge(half), self.shown(RING, inner));
                self.line(&line)?;
            }
        }
        Ok(())
    }

    /// Returns the first and the last ring of a face that has several.
    fn rings_of(&self, face: u32) -> Option<(u32, u32)> {
        match &self.body.faces.get(face)?.rings[..] {
            [outer, .., inner] => Some((*outer, *inner)),
            _ => None,
        }
    }

    /// Takes a shell apart, whose faces have one ring each, starting at a face.
    fn take_shell(&mut self, face: u32, world: &dyn Fn([f64; 3]) -> [f64; 3]) -> Result<()> {
        let Some(first) = self.rings_first(face) else { return Ok(()) };
        let mut sides: VecDeque<u32> = self.body.around(first).collect();
        while let Some(half) = sides.pop_front() {
            if self.body.half_edges.get(half / 2).is_none() {
                continue;
            }
            if self.body.face(half)? == face && self.body.face(half ^ 1)? != face {
                sides.extend(self.body.around(half ^ 1).skip(1));
                self.take_face(half)?;
            }
        }
        let Some(first) = self.rings_first(face) else { return Ok(()) };
        let others = self.tree(first);
        self.take_handles(face, others)?;
        self.take_tree(face, world)
    }

    fn rings_first(&self, face: u32) -> Option<u32> {
        self.first(*self.body.faces.get(face)?.rings.first()?)
    }

    /// Removes an edge and the face beyond it.
    fn take_face(&mut self, half: u32) -> Result<()> {
        let (one, other) = (self.body.half(half), self.body.half(half ^ 1));
        let gone = self.shown(FACE, self.body.face(half ^ 1)?);
        let edge = self.edge(half);
        self.body.kill_edge_face(half)?;
        let line = format!("mef {} {} {edge} {gone}", self.corner(other.next), self.corner(one.next));
        self.line(&line)
    }

    /// Returns the edges that are not in a tree of edges over all vertices of a face.
    fn tree(&self, first: u32) -> Vec<u32> {
        let [root, _] = self.body.ends(first);
        let (mut reached, mut used) = (HashSet::from([root]), HashSet::new());
        let mut open = VecDeque::from([root]);
        let mut others = Vec::new();
        while let Some(vertex) = open.pop_front() {
            for half in self.body.half_edges_of(vertex) {
                let [_, end] = self.body.ends(half);
                if !used.insert(half / 2) {
                    continue;
                }
                match reached.insert(end) {
                    true => open.push_back(end),
                    false => others.push(half / 2),
                }
            }
        }
        others
    }

    /// Removes the handles of a shell of one face. `others` are the edges not in a tree over its
    /// vertices.
    fn take_handles(&mut self, face: u32, mut others: Vec<u32>) -> Result<()> {
        while let Some(edge) = others.pop() {
            let half = 2 * edge;
            let (one, other) = (self.body.half(half), self.body.half(half ^ 1));
            let name = self.edge(half);
            let ring = self.body.kill_edge_make_ring(half)?;
            self.name(RING, ring);
            // (The tree's edges keep the shell together, so both ends have other edges.)
            let corners = [self.corner(other.next), self.corner(one.next)];
            let line = format!("mekr {} {} {name} {}", corners[0], corners[1], self.shown(RING, ring));
            self.line(&line)?;
            let made = self.body.make_face_kill_ring(ring)?;
            self.name(FACE, made);
            let line = format!(
                "kfmrh {} {} {}",
                self.shown(FACE, face),
                self.shown(FACE, made),
                self.shown(RING, ring)
            );
            self.line(&line)?;
            // Invariant: the surface without the tree is connected, so another edge has both faces.
            let between = others.iter().position(|edge| {
                let faces = [2 * edge, 2 * edge + 1].map(|half| self.body.face_of(self.body.half(half).ring));
                faces[0] != faces[1]
            });
            let Some(at) = between else {
                return Err(Error::invalid("model", "a surface that is not connected", "one that is"));
            };
            let edge = others.swap_remove(at);
            let half = if self.body.face(2 * edge)? == face { 2 * edge } else { 2 * edge + 1 };
            self.take_face(half)?;
        }
        Ok(())
    }

    /// Removes a tree of edges in a face, and then the face.
    fn take_tree(&mut self, face: u32, world: &dyn Fn([f64; 3]) -> [f64; 3]) -> Result<()> {
        let is_end = |body: &EulerBody, vertex: u32| body.half_edges_of(vertex).take(2).count() == 1;
        let Some(first) = self.rings_first(face) else { return Ok(()) };
        let mut ends: VecDeque<u32> =
            Vec::from_iter(self.body.around(first).map(|half| self.body.ends(half)[0]))
                .into_iter()
                .filter(|vertex| is_end(&self.body, *vertex))
                .collect();
        let point = |body: &EulerBody, vertex: u32| {
            let [x, y, z] = world(body.vertices.get(vertex).map_or([0.0; 3], |vertex| vertex.point));
            format!("{x} {y} {z}")
        };
        while let Some(vertex) = ends.pop_front() {
            let Some(back) = self.body.half_edges_of(vertex).next() else { break };
            let half = back ^ 1;
            let [from, _] = self.body.ends(half);
            let (next, edge, at) = (self.body.half(back).next, self.edge(half), point(&self.body, vertex));
            self.body.kill_edge_vertex(half)?;
            let corner = if next == half { format!("v{from}") } else { self.corner(next) };
            self.line(&format!("mev {corner} v{vertex} {edge} {at}"))?;
            if next == half {
                break;
            }
            if is_end(&self.body, from) {
                ends.push_back(from);
            }
        }
        let ring = self.body.faces.get(face).and_then(|face| face.rings.first().copied());
        let (vertex, _) = self.body.corner("kvfs", EulerCorner::Lone(ring.unwrap_or(u32::MAX)))?;
        let line = format!("mvfs v{vertex} {} {}", self.shown(FACE, face), point(&self.body, vertex));
        self.body.kill_solid(face)?;
        self.line(&line)
    }
}
