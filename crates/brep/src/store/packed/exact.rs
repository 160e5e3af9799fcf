//! Packing of blocks of exact faces in columns: corners by the connectivity of faces, planes by
//! grid points in them, and off-grid vertices as intersections of three planes.

use std::collections::HashMap;

use spinney_packing::Columns;

use super::super::exact::{self, ExactLayout};
use super::corners::Corners;
use super::vertices::{Incidences, Points};
use super::words::{Words, code_ends, code_parts, code_sources, push_numbers, push_words};
use super::{corners, vertices};

/// Contexts of bits and of numbers.
mod contexts {
    use super::{corners, vertices};

    /// Whether a plane is new: that of a face, and of an edge.
    pub(super) const NEW: usize = 0;
    /// Whether an edge's plane is that of its opposite, and whether it is the plane of the
    /// opposite's face.
    pub(super) const OTHER: usize = NEW + 2;
    /// Whether a new vertex is on the grid, by whether the previous one was.
    pub(super) const ON_GRID: usize = OTHER + 2;
    pub(super) const CORNERS: usize = ON_GRID + 2;
    pub(super) const VERTICES: usize = CORNERS + corners::CONTEXTS.0;
    pub(super) const BITS: usize = VERTICES + vertices::CONTEXTS.0;

    pub(super) const PART: usize = 0;
    pub(super) const SOURCE: usize = 1;
    pub(super) const RINGS: usize = 2;
    pub(super) const RING: usize = 3;
    /// Differences of plane numbers: of faces, and of edges.
    pub(super) const PLANE: usize = 4;
    pub(super) const COLOUR: usize = PLANE + 2;
    pub(super) const CORNER: usize = COLOUR + 3;
    pub(super) const VERTEX: usize = CORNER + corners::CONTEXTS.1;
    pub(super) const NUMBERS: usize = VERTEX + vertices::CONTEXTS.1;
}

/// Contexts of bits and of numbers.
pub(super) const CONTEXTS: (usize, usize) = (contexts::BITS, contexts::NUMBERS);

/// The lists of a block.
pub(super) struct Exact {
    layout: ExactLayout,
    points: Points,
    /// The plane of each face.
    face_planes: Vec<u32>,
    parts: Vec<u32>,
    sources: Vec<u64>,
    face_ends: Vec<u32>,
    ring_ends: Vec<u32>,
    /// The vertex of each corner, and the plane of the edge after it.
    corners: Vec<[u32; 2]>,
    colours: Vec<[u8; 3]>,
}

impl Exact {
    /// Codes the lists of a block of `length` bytes; writes those of `plain`. Returns `None` if the
    /// lists are invalid.
    pub(super) fn code(columns: &mut Columns<'_>, length: usize, plain: &[u8]) -> Option<Vec<u8>> {
        let mut words = Words(plain);
        let mut head = Vec::new();
        push_words(&mut head, (0..exact::HEAD / 4).map(|_| columns.number(words.word().into()) as u32));
        let mut exact = Exact::blank(&head, length)?;
        exact.take(words);
        exact.code_lists(columns)?;
        exact.push(&mut head);
        Some(head)
    }

    /// Allocates lists of zeros with the counts of a block's header, which must be that of a block
    /// of `length` bytes.
    fn blank(head: &[u8], length: usize) -> Option<Exact> {
        // Invariant: the lists take exactly the block's bytes, so no list is larger than the block.
        // Otherwise, an untrusted header could request any amount of memory.
        let layout = ExactLayout::of(head).filter(|layout| layout.len() == length)?;
        let [faces, planes, grid, vertices, rings, corners] = layout.counts;
        // (On 32-bit targets, the sum of larger counts might overflow.)
        if layout.counts.iter().any(|count| *count > length) {
            return None;
        }
        Some(Exact {
            points: Points::blank(planes, grid, vertices),
            face_planes: vec![0; faces],
            parts: vec![0; if layout.has(exact::PARTS) { faces } else { 1 }],
            sources: vec![0; faces],
            face_ends: vec![0; faces],
            ring_ends: vec![0; rings],
            corners: vec![[0; 2]; corners],
            colours: vec![[0; 3]; if layout.has(exact::COLOURED) { corners } else { 0 }],
            layout,
        })
    }

    /// Reads the lists from the words after a block's header.
    fn take(&mut self, mut words: Words<'_>) {
        let is_wide = self.layout.has(exact::WIDE);
        self.points.take(&mut words, self.layout.widths);
        self.face_planes.iter_mut().for_each(|plane| *plane = words.number(is_wide));
        self.parts.iter_mut().for_each(|part| *part = words.word());
        self.sources.iter_mut().for_each(|source| *source = words.long());
        let ends = [&mut self.face_ends, &mut self.ring_ends];
        ends.into_iter().flatten().for_each(|end| *end = words.word());
        self.corners.as_flattened_mut().iter_mut().for_each(|number| *number = words.number(is_wide));
        words.bytes(self.colours.as_flattened_mut());
    }

    /// Appends the lists in the format of a plain block.
    fn push(&self, bytes: &mut Vec<u8>) {
        let is_wide = self.layout.has(exact::WIDE);
        self.points.push(bytes, self.layout.widths);
        push_numbers(bytes, &self.face_planes, is_wide);
        push_words(bytes, self.parts.iter().copied());
        self.sources.iter().for_each(|source| bytes.extend_from_slice(&source.to_le_bytes()));
        push_words(bytes, [&self.face_ends, &self.ring_ends].into_iter().flatten().copied());
        push_numbers(bytes, self.corners.as_flattened(), is_wide);
        bytes.extend_from_slice(self.colours.as_flattened());
    }

    fn code_lists(&mut self, columns: &mut Columns<'_>) -> Option<()> {
        code_ends(columns, contexts::RINGS, 1, &mut self.face_ends);
        code_ends(columns, contexts::RING, 3, &mut self.ring_ends);
        code_parts(columns, contexts::PART, &mut self.parts);
        code_sources(columns, contexts::SOURCE, &mut self.sources);
        let [faces, planes, grid, vertices, ..] = self.layout.counts;
        let mut numbers = Numbers::new([grid, vertices], planes);
        let mut incidences = Incidences::new(planes, vertices);
        let (mut first_ring, mut start) = (0, 0);
        for face in 0..faces {
            let plane = numbers.plane(columns, 0, self.face_planes[face])?;
            self.face_planes[face] = plane;
            let rings = self.ring_ends.get(first_ring..self.face_ends[face] as usize)?;
            first_ring += rings.len();
            for end in rings {
                let ring = self.corners.get_mut(start..*end as usize)?;
                numbers.ring(columns, plane, ring)?;
                incidences.note(plane, ring, grid as u32);
                start = *end as usize;
            }
        }
        let mut last = [0; 3];
        for colour in &mut self.colours {
            for (channel, (value, last)) in colour.iter_mut().zip(&mut last).enumerate() {
                let more = columns.near(contexts::COLOUR + channel, (value.wrapping_sub(*last) as i8).into());
                *last = last.wrapping_add(more as u8);
                *value = *last;
            }
        }
        self.points.code(columns, (contexts::VERTICES, contexts::VERTEX), &incidences, self.layout.widths)
    }
}

/// Numbers of coded vertices and planes.
struct Numbers {
    corners: Corners,
    /// Vertex number in the block by first occurrence, and the inverse.
    vertices: Vec<u32>,
    order: HashMap<u32, u32>,
    /// Number of vertices so far, on the grid and others, and their total.
    next: [usize; 2],
    counts: [usize; 2],
    was_on_grid: bool,
    /// Number of planes so far, their total, and the last explicitly coded plane of each kind.
    next_plane: u32,
    planes: u32,
    last: [u32; 2],
    /// Planes of half-edges, and of their faces.
    edges: HashMap<(u32, u32), (u32, u32)>,
}

impl Numbers {
    fn new(counts: [usize; 2], planes: usize) -> Numbers {
        Numbers {
            corners: Corners::new(contexts::CORNERS, contexts::CORNER, counts[0] + counts[1]),
            vertices: Vec::new(),
            order: HashMap::new(),
            next: [0; 2],
            counts,
            was_on_grid: true,
            next_plane: 0,
            planes: planes as u32,
            last: [0; 2],
            edges: HashMap::new(),
        }
    }

    /// Codes the number of a plane, of a face or of an edge.
    fn plane(&mut self, columns: &mut Columns<'_>, kind: usize, plane: u32) -> Option<u32> {
        if columns.bit(contexts::NEW + kind, plane == self.next_plane) {
            self.next_plane += 1;
            return Some(self.next_plane - 1).filter(|new| *new < self.planes);
        }
        let more = i64::from(plane.wrapping_sub(self.last[kind]) as i32);
        let more = columns.near(contexts::PLANE + kind, more);
        self.last[kind] = self.last[kind].wrapping_add(more as u32);
        Some(self.last[kind]).filter(|number| *number < self.next_plane)
    }

    /// Codes the corners of a ring of a face.
    fn ring(&mut self, columns: &mut Columns<'_>, plane: u32, ring: &mut [[u32; 2]]) -> Option<()> {
        let mut next = self.vertices.len() as u32;
        let mut order = |vertex: u32| {
            *self.order.entry(vertex).or_insert_with(|| {
                next += 1;
                next - 1
            })
        };
        let mut numbers: Vec<u32> = ring.iter().map(|[vertex, _]| order(*vertex)).collect();
        self.corners.code(columns, &mut numbers)?;
        for (number, [vertex, _]) in numbers.iter().zip(&mut *ring) {
            if *number as usize == self.vertices.len() {
                let is_on_grid = (*vertex as usize) < self.counts[0];
                let is_on_grid = columns.bit(contexts::ON_GRID + usize::from(self.was_on_grid), is_on_grid);
                self.was_on_grid = is_on_grid;
                let kind = usize::from(!is_on_grid);
                let new = self.next[kind] + if is_on_grid { 0 } else { self.counts[0] };
                self.next[kind] += 1;
                if self.next[kind] > self.counts[kind] {
                    return None;
                }
                self.vertices.push(new as u32);
            }
            *vertex = *self.vertices.get(*number as usize)?;
        }
        self.corners.join(&numbers);
        for index in 0..numbers.len() {
            let (from, to) = (numbers[index], numbers[(index + 1) % numbers.len()]);
            let other = self.edges.get(&(to, from)).copied();
            let line = self.line(columns, other, ring[index][1])?;
            ring[index][1] = line;
            self.edges.insert((from, to), (line, plane));
        }
        Some(())
    }

    /// Codes the number of an edge's plane, predicted by the plane of its opposite and that of the
    /// opposite's face.
    fn line(&mut self, columns: &mut Columns<'_>, other: Option<(u32, u32)>, line: u32) -> Option<u32> {
        if let Some((other, face)) = other {
            for (context, plane) in [other, face].into_iter().enumerate() {
                if columns.bit(contexts::OTHER + context, plane == line) {
                    return Some(plane);
                }
            }
        }
        self.plane(columns, 1, line)
    }
}
