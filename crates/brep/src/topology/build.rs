//! Construction of a topology: vertices of faces are welded, half-edges paired, and vertices split
//! into fans.

use std::collections::HashMap;
use std::mem::size_of;

use super::around::{Direction, flat, normal, pair_around};
use super::corners::{FaceRings, numbered};
use super::{NONE, Ring, Topology, TopologyOptions, Vertex};
use crate::exact::vector::{main_axis, subtract};
use crate::{Face, Faces};
use spinney_base::{Error, Progress, Result, sort};

/// Maximum bytes in use per half-edge during construction: its own three numbers and that of its
/// point (16), orders of half-edges and points (12), its point (12), edges (12) and vertices (8),
/// none of which are shared in the worst case.
const HALF_EDGE_BYTES: u64 = 60;

/// Bytes per face and ring, likewise.
const FACE_BYTES: u64 = 16;
const RING_BYTES: u64 = size_of::<Ring>() as u64;

/// Number of steps between cancellation checks.
const OFTEN: usize = 1 << 16;

/// Normals of faces with more vertices are cached.
const LARGE: u32 = 32;

pub(super) fn build(
    faces: &dyn Faces,
    options: &TopologyOptions,
    progress: &dyn Progress,
) -> Result<Topology> {
    let counts = count(faces, progress)?;
    check_size(&counts, options)?;
    let mut topology = Topology::default();
    let stage_done = || progress.advance(counts.half_edges, 5 * counts.half_edges);
    let corners = read(faces, &counts, &mut topology, progress)?;
    stage_done();
    let order = weld(corners, &mut topology, progress)?;
    stage_done();
    // Until `split_vertices`, origins are point numbers instead of vertex numbers.
    pair(&mut topology, progress)?;
    stage_done();
    split_vertices(&order, &mut topology, progress)?;
    stage_done();
    find_shells(&mut topology, progress)?;
    stage_done();
    Ok(topology)
}

/// Counts of a model.
#[derive(Default)]
struct Counts {
    faces: u64,
    rings: u64,
    half_edges: u64,
}

fn count(faces: &dyn Faces, progress: &dyn Progress) -> Result<Counts> {
    let mut counts = Counts::default();
    each_face(faces, progress, &mut |face| {
        counts.faces += 1;
        counts.rings += face.ring_ends.len() as u64;
        counts.half_edges += face.points.len() as u64;
        Ok(())
    })?;
    Ok(counts)
}

fn check_size(counts: &Counts, options: &TopologyOptions) -> Result<()> {
    let needed = counts
        .half_edges
        .saturating_mul(HALF_EDGE_BYTES)
        .saturating_add(counts.rings.saturating_mul(RING_BYTES))
        .saturating_add(counts.faces.saturating_mul(FACE_BYTES));
    let numbers = u64::from(NONE);
    if needed <= options.memory && counts.half_edges < numbers && counts.faces < numbers {
        return Ok(());
    }
    Err(Error::TooLarge {
        path: options.path.clone(),
        what: format!(
            "building the topology of {} faces with {} half-edges",
            counts.faces, counts.half_edges
        ),
        needed,
        // (Half-edge numbers have 32 bits.)
        limit: options.memory.min(numbers * HALF_EDGE_BYTES),
        advice: "allow more memory, or take a part of the model".into(),
    })
}

fn each_face(
    faces: &dyn Faces,
    progress: &dyn Progress,
    each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
) -> Result<()> {
    let mut number = 0u64;
    faces.each(&mut |face| {
        if number.is_multiple_of(4096) {
            progress.check()?;
        }
        number += 1;
        each(face)
    })
}

/// Reads rings and faces; returns the start point of each half-edge with its number ([`numbered`]).
fn read(
    faces: &dyn Faces,
    counts: &Counts,
    topology: &mut Topology,
    progress: &dyn Progress,
) -> Result<Vec<u128>> {
    let half_edges = counts.half_edges as usize;
    let mut corners = Vec::with_capacity(half_edges);
    topology.ring_of.reserve_exact(half_edges);
    topology.rings.reserve_exact(counts.rings as usize + 1);
    topology.face_rings.reserve_exact(counts.faces as usize + 1);
    let mut found = FaceRings::default();
    let mut face_number = 0;
    each_face(faces, progress, &mut |face| {
        // (The number of faces must not change between passes.)
        if corners.len() + face.points.len() > half_edges || u64::from(face_number) == counts.faces {
            return Err(Error::invalid(
                "faces",
                "more faces than in the first pass",
                "the same faces in each pass",
            ));
        }
        found.find(face);
        topology.face_rings.push(topology.rings.len() as u32);
        let mut start = 0;
        for &end in &found.ends {
            let ring = topology.rings.len() as u32;
            topology.rings.push(Ring { start: corners.len() as u32, face: face_number });
            for point in &found.points[start..end] {
                corners.push(numbered(*point, corners.len() as u32));
                topology.ring_of.push(ring);
            }
            start = end;
        }
        face_number += 1;
        Ok(())
    })?;
    topology.face_rings.push(topology.rings.len() as u32);
    topology.rings.push(Ring { start: corners.len() as u32, face: NONE });
    Ok(corners)
}

/// Numbers the distinct points in order; returns the half-edges sorted by their start points.
fn weld(mut corners: Vec<u128>, topology: &mut Topology, progress: &dyn Progress) -> Result<Vec<u32>> {
    sort_numbers(&mut corners, progress)?;
    topology.origin = vec![0; corners.len()];
    for &corner in &corners {
        let (point, half_edge) = (sort::key_point(corner >> 32), corner as u32);
        if topology.points.last() != Some(&point) {
            topology.points.push(point);
        }
        topology.origin[half_edge as usize] = topology.points.len() as u32 - 1;
    }
    topology.points.shrink_to_fit();
    Ok(corners.into_iter().map(|corner| corner as u32).collect())
}

/// Sorts in blocks, with cancellation checks in between.
fn sort_numbers(corners: &mut [u128], progress: &dyn Progress) -> Result<()> {
    progress.check()?;
    if corners.len() <= 1 << 20 {
        sort::numbers128(corners);
        return Ok(());
    }
    let (below, _, above) = corners.select_nth_unstable(corners.len() / 2);
    sort_numbers(below, progress)?;
    sort_numbers(above, progress)
}

/// Creates edges: pairs of half-edges between the same two points, in opposite directions.
fn pair(topology: &mut Topology, progress: &dyn Progress) -> Result<()> {
    let half_edges = topology.origin.len();
    let mut by_first = by_first_point(topology);
    topology.edge_of = vec![NONE; half_edges];
    topology.edges.reserve_exact(half_edges / 2);
    // For each group of more than two half-edges: index in the list, length, and number of forward
    // half-edges.
    let mut crowded = Vec::new();
    let mut start = 0;
    let mut checked = 0;
    while start < half_edges {
        if start >= checked {
            progress.check()?;
            checked = start + OFTEN;
        }
        let first = ends(topology, by_first[start]).0;
        let len = by_first[start..].iter().take_while(|&&other| ends(topology, other).0 == first).count();
        let from_first = &mut by_first[start..start + len];
        // (Numbers ascend within equal keys.)
        sort::by_key(from_first, |&half_edge| {
            let (_, second, is_back) = ends(topology, half_edge);
            u64::from(second) << 1 | u64::from(is_back)
        });
        let mut at = start;
        start += len;
        while at < start {
            let second = ends(topology, by_first[at]).1;
            let rest = &by_first[at..start];
            let len = rest.iter().take_while(|&&other| ends(topology, other).1 == second).count();
            let same = &rest[..len];
            let forward = same.iter().take_while(|&&half_edge| !ends(topology, half_edge).2).count();
            match same {
                &[a, b] if forward == 1 => topology.push_edge(a, b),
                [_, _, _, ..] if 0 < forward && forward < len => crowded.push((at, len, forward)),
                _ => same.iter().for_each(|&alone| topology.push_edge(alone, NONE)),
            }
            at += len;
        }
    }
    let mut normals = HashMap::new();
    for (number, (at, len, forward)) in crowded.into_iter().enumerate() {
        if number.is_multiple_of(4096) {
            progress.check()?;
        }
        pair_radially(topology, &by_first[at..at + len], forward, &mut normals);
    }
    topology.edges.shrink_to_fit();
    Ok(())
}

/// Returns the lower and the higher point of a half-edge, and whether it starts at the higher one.
fn ends(topology: &Topology, half_edge: u32) -> (u32, u32, bool) {
    let (a, b) = (topology.origin(half_edge), topology.target(half_edge));
    (a.min(b), a.max(b), a > b)
}

/// Returns all half-edges, sorted by their lower point.
fn by_first_point(topology: &Topology) -> Vec<u32> {
    let half_edges = 0..topology.origin.len() as u32;
    let mut starts = vec![0u32; topology.points.len() + 1];
    half_edges.clone().for_each(|half_edge| starts[ends(topology, half_edge).0 as usize + 1] += 1);
    for point in 1..starts.len() {
        starts[point] += starts[point - 1];
    }
    let mut sorted = vec![0; half_edges.len()];
    for half_edge in half_edges {
        let place = &mut starts[ends(topology, half_edge).0 as usize];
        sorted[*place as usize] = half_edge;
        *place += 1;
    }
    sorted
}

/// Pairs more than two half-edges between the same two points; the first `forward` of them lead
/// from the first point to the second.
fn pair_radially(
    topology: &mut Topology,
    same: &[u32],
    forward: usize,
    normals: &mut HashMap<u32, [i128; 3]>,
) {
    let [from, to] =
        [topology.origin(same[0]), topology.target(same[0])].map(|p| topology.points[p as usize]);
    let along = subtract(to.map(i128::from), from.map(i128::from));
    let axis = main_axis(along);
    let mut directions = Vec::with_capacity(same.len());
    for (index, &half_edge) in same.iter().enumerate() {
        let is_forward = index < forward;
        // A face leaves the edge perpendicular to its normal, on the left of the half-edge as seen
        // from outside. Angles between such directions equal angles between normals, if the normals
        // of backward half-edges are negated. The projection along the edge's main axis changes
        // angles, but not their order.
        let normal = topology.leading_normal(half_edge, normals);
        let normal = if is_forward { normal } else { normal.map(|part| -part) };
        let at = flat(normal, axis, along[axis] < 0);
        // The solid is on the inner side of faces: around the edge, it ends at forward half-edges.
        if at != [0; 2] {
            directions.push(Direction { at, closes: is_forward, number: half_edge });
        }
    }
    for [begins, ends] in pair_around(&mut directions) {
        topology.push_edge(ends, begins);
    }
    // The remaining half-edges belong to faces without area, which have no direction.
    let is_left = |half_edge: &&u32| topology.edge_of[**half_edge as usize] == NONE;
    let ahead: Vec<u32> = same[..forward].iter().filter(is_left).copied().collect();
    let back: Vec<u32> = same[forward..].iter().filter(is_left).copied().collect();
    for index in 0..ahead.len().max(back.len()) {
        match (ahead.get(index), back.get(index)) {
            (Some(&a), Some(&b)) => topology.push_edge(a, b),
            (Some(&alone), None) | (None, Some(&alone)) => topology.push_edge(alone, NONE),
            (None, None) => {}
        }
    }
}

/// Maximum number of consecutive slivers that are traversed.
const MAX_SLIVERS: usize = 64;

impl Topology {
    /// Adds an edge of two half-edges, or of one that has no twin.
    fn push_edge(&mut self, a: u32, b: u32) {
        let edge = self.edges.len() as u32;
        self.edge_of[a as usize] = edge;
        if b != NONE {
            self.edge_of[b as usize] = edge;
        }
        self.edges.push([a.min(b), a.max(b)]);
    }

    /// Returns the normal of a half-edge's face. For a face without area, returns that of the face
    /// beyond it, across edges in the direction of the half-edge that are already paired.
    fn leading_normal(&self, half_edge: u32, normals: &mut HashMap<u32, [i128; 3]>) -> [i128; 3] {
        let mut at = half_edge;
        for _ in 0..MAX_SLIVERS {
            let normal = self.face_normal(self.face(at), normals);
            if normal != [0; 3] {
                return normal;
            }
            let Some(next) = self.led_on(half_edge, at) else { break };
            at = next;
        }
        [0; 3]
    }

    /// Returns the half-edge beyond a face without area that has the direction of the first one.
    fn led_on(&self, first: u32, at: u32) -> Option<u32> {
        let vector = |half_edge: u32| {
            let [from, to] =
                [self.origin(half_edge), self.target(half_edge)].map(|p| self.points[p as usize]);
            [0, 1, 2].map(|axis| i64::from(to[axis]) - i64::from(from[axis]))
        };
        let along = vector(first);
        self.half_edges_of_ring(self.ring(at)).filter(|&other| other != at).find_map(|other| {
            if self.edge_of[other as usize] == NONE {
                return None;
            }
            let twin = self.twin(other)?;
            let product: i64 = vector(twin).iter().zip(along).map(|(a, b)| a * b).sum();
            (product > 0).then_some(twin)
        })
    }

    fn face_normal(&self, face: u32, normals: &mut HashMap<u32, [i128; 3]>) -> [i128; 3] {
        if let Some(known) = normals.get(&face) {
            return *known;
        }
        let rings = self.rings_of_face(face);
        let mut corners = 0;
        let rings: Vec<Vec<[i32; 3]>> = rings
            .map(|ring| {
                let half_edges = self.half_edges_of_ring(ring);
                corners += half_edges.len() as u32;
                half_edges.map(|half_edge| self.points[self.origin(half_edge) as usize]).collect()
            })
            .collect();
        let normal = normal(rings.iter().map(Vec::as_slice));
        if corners > LARGE {
            normals.insert(face, normal);
        }
        normal
    }
}

/// Creates a vertex for each fan of faces around a point, in the order of the points.
fn split_vertices(order: &[u32], topology: &mut Topology, progress: &dyn Progress) -> Result<()> {
    let mut vertex_of = vec![NONE; topology.origin.len()];
    for (number, &half_edge) in order.iter().enumerate() {
        if number.is_multiple_of(OFTEN) {
            progress.check()?;
        }
        if vertex_of[half_edge as usize] != NONE {
            continue;
        }
        // An open fan begins at its boundary.
        let mut first = half_edge;
        while let Some(before) = topology.twin(first).map(|twin| topology.next(twin)) {
            first = before;
            if first == half_edge {
                break;
            }
        }
        let vertex = topology.vertices.len() as u32;
        let mut at = Some(first);
        while let Some(half_edge) = at.filter(|at| vertex_of[*at as usize] == NONE) {
            vertex_of[half_edge as usize] = vertex;
            at = topology.twin(topology.previous(half_edge));
        }
        topology.vertices.push(Vertex { half_edge: first, point: topology.origin(half_edge) });
    }
    topology.vertices.shrink_to_fit();
    topology.origin = vertex_of;
    Ok(())
}

/// Finds shells, numbered by their first faces.
fn find_shells(topology: &mut Topology, progress: &dyn Progress) -> Result<()> {
    let faces = topology.faces();
    topology.shell_of = vec![NONE; faces as usize];
    let mut pending = Vec::new();
    for first in 0..faces {
        if topology.shell_of[first as usize] != NONE {
            continue;
        }
        let shell = topology.shell_ends.len() as u32;
        topology.shell_of[first as usize] = shell;
        pending.push(first);
        let start = topology.shell_faces.len();
        while let Some(face) = pending.pop() {
            if topology.shell_faces.len().is_multiple_of(OFTEN) {
                progress.check()?;
            }
            topology.shell_faces.push(face);
            for half_edge in topology.half_edges_of_face(face) {
                let Some(twin) = topology.twin(half_edge) else { continue };
                let adjacent = topology.face(twin);
                if topology.shell_of[adjacent as usize] == NONE {
                    topology.shell_of[adjacent as usize] = shell;
                    pending.push(adjacent);
                }
            }
        }
        sort::numbers32(&mut topology.shell_faces[start..]);
        topology.shell_ends.push(topology.shell_faces.len() as u32);
    }
    Ok(())
}
