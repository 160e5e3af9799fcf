//! Blocks of faces with off-grid vertices, which have proxies in the octree: see `formats.md`.

use std::collections::HashMap;
use std::ops::Range;

use bnum::cast::As;
use bnum::types::I256;

use super::exact_lists::ExactLists;
use crate::arrangement::{Corner, ExactFace, ExactPlane, ExactPoint, Vertices, wide};
use crate::exact::bounds::{NORMAL_BITS, OFFSET_BITS, WEIGHT_BITS};
use spinney_base::io::FileBytes;

/// Tag of the section with the list of blocks.
pub(crate) const EXACT: [u8; 4] = *b"EXAC";

/// Maximum number of faces of a block.
const MAX_FACES: usize = 512;
/// A block with this many corners (vertex references of its faces) takes no more faces.
const MANY_CORNERS: usize = 2048;

/// Bytes of a block's header.
pub(super) const HEAD: usize = 32;
pub(super) const COLOURED: u32 = 1;
pub(super) const WIDE: u32 = 2;
pub(super) const PARTS: u32 = 4;
/// Bytes of a vertex that is a grid point.
pub(super) const GRID_VERTEX: usize = 12;

/// Maximum bytes of a normal component, an offset, a coordinate and a weight.
const MAX_WIDTHS: [usize; 4] = [8, 16, 25, 22];

/// Collects faces into blocks.
#[derive(Default)]
pub(crate) struct ExactBlockBuilder {
    /// Faces of other blocks, which come first.
    copied: Option<ExactLists>,
    faces: Vec<ExactFace>,
    corners: usize,
    /// Number of faces of the finished blocks.
    before: u64,
}

impl ExactBlockBuilder {
    pub(crate) fn push(&mut self, face: ExactFace) {
        self.corners += face.corners.len();
        self.faces.push(face);
    }

    /// Returns whether the block takes no more faces.
    pub(crate) fn is_full(&self) -> bool {
        self.count() >= MAX_FACES || self.corners >= MANY_CORNERS
    }

    /// Returns whether the block has no face yet.
    pub(crate) fn is_empty(&self) -> bool {
        self.count() == 0
    }

    /// Returns the number of faces of the block.
    fn count(&self) -> usize {
        self.copied.as_ref().map_or(0, ExactLists::len) + self.faces.len()
    }

    /// Returns whether faces of another block can be appended.
    pub(crate) fn takes(&self, lists: &ExactLists) -> bool {
        self.is_empty()
            || (self.faces.is_empty()
                && self.count() + lists.len() <= MAX_FACES
                && self.corners + lists.corners.len() <= MANY_CORNERS)
    }

    /// Appends faces of another block: see [`ExactBlockBuilder::takes`].
    pub(crate) fn append(&mut self, lists: ExactLists) {
        self.corners += lists.corners.len();
        match &mut self.copied {
            Some(copied) => copied.append(lists),
            None => self.copied = Some(lists),
        }
    }

    /// Counts the faces of a block that is copied unchanged; returns the number of its first face.
    /// The current block must be empty.
    pub(crate) fn skip(&mut self, faces: usize) -> u64 {
        self.before += faces as u64;
        self.before - faces as u64
    }

    /// Returns the number of faces of all blocks so far.
    pub(crate) fn len(&self) -> u64 {
        self.before + self.count() as u64
    }

    /// Returns the number of the block's first face, and its bytes; begins the next block.
    pub(crate) fn finish(&mut self) -> (u64, Vec<u8>) {
        let first = self.before;
        self.before = self.len();
        let bytes = match self.copied.take() {
            None => encode(&self.faces),
            Some(mut copied) => {
                if !self.faces.is_empty() {
                    copied.append(lists_of(&self.faces));
                }
                copied.to_bytes()
            }
        };
        self.faces.clear();
        self.corners = 0;
        (first, bytes)
    }
}

/// Encodes a block.
pub(crate) fn encode(faces: &[ExactFace]) -> Vec<u8> {
    lists_of(faces).to_bytes()
}

/// Returns the lists of a block.
fn lists_of(faces: &[ExactFace]) -> ExactLists {
    let mut planes = Planes::default();
    let mut grid_points: HashMap<[i32; 3], u32, crate::hash::Hasher> = HashMap::default();
    let mut grid_list = Vec::new();
    let mut vertices = Vertices::default();
    let (mut face_planes, mut parts, mut sources) = (Vec::new(), Vec::new(), Vec::new());
    let (mut face_ends, mut ring_ends) = (Vec::<u32>::new(), Vec::<u32>::new());
    let mut corners = Vec::new();
    let mut colours = Vec::new();
    for face in faces {
        face_planes.push(planes.number(&face.plane));
        parts.push(face.part);
        sources.push(face.source);
        ring_ends.extend(face.ring_ends.iter().map(|end| (corners.len() + end) as u32));
        face_ends.push(ring_ends.len() as u32);
        for corner in &face.corners {
            let line = planes.number(&corner.line);
            let (is_on_grid, vertex) = match corner.point.on_grid().filter(|at| at.iter().all(|at| *at >= 0))
            {
                Some(at) => {
                    let next = grid_list.len() as u32;
                    let number = *grid_points.entry(at).or_insert(next);
                    if number == next {
                        grid_list.push(at);
                    }
                    (true, number)
                }
                None => (false, vertices.number(corner.point)),
            };
            corners.push((is_on_grid, vertex, line));
        }
        colours.extend_from_slice(face.colours.as_flattened());
    }
    let (planes, vertices) = (planes.list, vertices.list());
    let widest = |numbers: &mut dyn Iterator<Item = I256>| numbers.map(width_of).max().unwrap_or(1);
    let widths = [
        widest(&mut planes.iter().flat_map(|plane| plane.normal).map(|part| wide(part.into()))),
        widest(&mut planes.iter().map(|plane| wide(plane.offset))),
        widest(&mut vertices.iter().flat_map(|point| point.at)),
        widest(&mut vertices.iter().map(|point| point.weight)),
    ];
    let mut plane_bytes = Vec::new();
    for plane in &planes {
        plane.normal.iter().for_each(|part| plane_bytes.extend_from_slice(&part.to_le_bytes()[..widths[0]]));
        plane_bytes.extend_from_slice(&plane.offset.to_le_bytes()[..widths[1]]);
    }
    let grid_points = grid_list.as_flattened().iter().flat_map(|at| at.to_le_bytes()).collect();
    let mut vertex_bytes = Vec::new();
    for point in vertices {
        point.at.iter().for_each(|at| push(&mut vertex_bytes, at, widths[2]));
        push(&mut vertex_bytes, &point.weight, widths[3]);
    }
    ExactLists {
        widths,
        planes: plane_bytes,
        grid_points,
        vertices: vertex_bytes,
        face_planes,
        parts,
        sources,
        face_ends,
        ring_ends,
        corners,
        colours,
    }
}

/// Distinct planes of a block.
#[derive(Default)]
struct Planes {
    numbers: HashMap<([i64; 3], i128), u32, crate::hash::Hasher>,
    list: Vec<ExactPlane>,
}

impl Planes {
    fn number(&mut self, plane: &ExactPlane) -> u32 {
        *self.numbers.entry((plane.normal, plane.offset)).or_insert_with(|| {
            self.list.push(*plane);
            self.list.len() as u32 - 1
        })
    }
}

/// Returns the minimum number of bytes of a signed number.
fn width_of(number: I256) -> usize {
    let fits = |bytes: &usize| {
        let rest = number >> (8 * *bytes as u32 - 1);
        rest.is_zero() || (rest + wide(1)).is_zero()
    };
    (1..32).find(fits).unwrap_or(32)
}

/// Appends the low bytes of a number.
pub(super) fn push(bytes: &mut Vec<u8>, number: &I256, count: usize) {
    bytes.extend((0..count).map(|byte| -> u8 { (*number >> (8 * byte as u32)).as_() }));
}

/// Decodes a signed number from its low bytes.
pub(super) fn number(bytes: &[u8]) -> I256 {
    let mut found: I256 = (*bytes.last().unwrap_or(&0) as i8).as_();
    for byte in bytes.iter().rev().skip(1) {
        let low: I256 = (*byte).as_();
        found = (found << 8u32) + low;
    }
    found
}

/// Decodes a signed number of at most 16 bytes.
pub(super) fn short_number(bytes: &[u8]) -> i128 {
    let is_negative = bytes.last().is_some_and(|last| *last >= 0x80);
    let mut all = [if is_negative { 0xff } else { 0 }; 16];
    all[..bytes.len()].copy_from_slice(bytes);
    i128::from_le_bytes(all)
}

/// Counts and offsets of a block's lists.
#[derive(Clone, Copy)]
pub(super) struct ExactLayout {
    /// Faces, planes, grid points, vertices, rings, corners.
    pub(super) counts: [usize; 6],
    flags: u32,
    /// Bytes of a normal component, an offset, a coordinate, and a weight.
    pub(super) widths: [usize; 4],
    /// Offsets of the lists: planes, grid points, vertices, planes of faces, parts, sources, ends
    /// of faces, ends of rings, corners, colours, and the end.
    pub(super) lists: [usize; 11],
}

impl ExactLayout {
    /// Decodes the layout from a block's header; returns `None` if it is invalid.
    pub(super) fn of(bytes: &[u8]) -> Option<ExactLayout> {
        let head = bytes.get(..HEAD)?;
        let word =
            |index: usize| u32::from_le_bytes(head[4 * index..4 * index + 4].try_into().expect("four bytes"));
        // (Each is below 2^32, so no sum overflows.)
        let counts = [0, 1, 2, 3, 4, 5].map(|index| word(index) as usize);
        let [faces, planes, grid_points, vertices, rings, corners] = counts;
        let flags = word(6);
        let widths = [28, 29, 30, 31].map(|at| usize::from(head[at]));
        let fits = widths.iter().zip(MAX_WIDTHS).all(|(width, most)| (1..=most).contains(width));
        if !fits || flags > (COLOURED | WIDE | PARTS) {
            return None;
        }
        let has = |flag: u32| flags & flag != 0;
        let wide = if has(WIDE) { 4 } else { 2 };
        let sizes = [
            (3 * widths[0] + widths[1]) * planes,
            GRID_VERTEX * grid_points,
            (3 * widths[2] + widths[3]) * vertices,
            wide * faces,
            if has(PARTS) { 4 * faces } else { 4 },
            8 * faces,
            4 * faces,
            4 * rings,
            2 * wide * corners,
            if has(COLOURED) { 3 * corners } else { 0 },
        ];
        let mut lists = [HEAD; 11];
        for (index, size) in sizes.into_iter().enumerate() {
            lists[index + 1] = lists[index] + size;
        }
        Some(ExactLayout { counts, flags, widths, lists })
    }

    /// Returns the block's length in bytes.
    pub(super) fn len(&self) -> usize {
        self.lists[10]
    }

    pub(super) fn has(&self, flag: u32) -> bool {
        self.flags & flag != 0
    }
}

/// Part and source of a face.
pub(crate) struct ExactHead {
    pub(crate) part: u32,
    pub(crate) source: u64,
}

/// A block of a file. Faces are decoded one by one, so the memory does not depend on counts of an
/// untrusted file.
pub(crate) struct ExactBlock<'a> {
    pub(super) bytes: FileBytes<'a>,
    bits: u8,
    pub(super) layout: ExactLayout,
}

impl<'a> ExactBlock<'a> {
    /// Wraps a block on a grid of `bits` bits; returns `None` if its lists do not fit its bytes.
    pub(crate) fn new(bytes: FileBytes<'a>, bits: u8) -> Option<ExactBlock<'a>> {
        let layout = ExactLayout::of(&bytes).filter(|layout| layout.len() == bytes.len())?;
        Some(ExactBlock { bytes, bits, layout })
    }

    /// Checks everything except single faces, for a model with `parts` parts. Errors describe the
    /// flaw.
    pub(crate) fn check(&self, parts: u64) -> Result<(), String> {
        let [faces, _, _, _, rings, corners] = self.layout.counts;
        let ascend = |list: usize, count: usize, least: u32, last: usize| {
            let mut before = 0u32;
            let are_in_order = (0..count).all(|index| {
                let end = self.word(self.layout.lists[list] + 4 * index);
                let is_beyond = end.checked_sub(before).is_some_and(|length| length >= least);
                before = end;
                is_beyond
            });
            are_in_order && before as usize == last
        };
        if faces == 0 {
            return Err("no faces".into());
        }
        if !ascend(6, faces, 1, rings) || !ascend(7, rings, 3, corners) {
            return Err("ends of faces and rings that do not ascend".into());
        }
        let wrong = (0..faces).map(|face| self.part(face)).find(|part| u64::from(*part) >= parts);
        wrong.map_or(Ok(()), |part| Err(format!("part {part} of {parts}")))
    }

    /// Returns the number of faces.
    pub(crate) fn len(&self) -> usize {
        self.layout.counts[0]
    }

    /// Returns the bytes of the block.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Returns whether vertices have colours.
    pub(crate) fn is_coloured(&self) -> bool {
        self.layout.has(COLOURED)
    }

    pub(super) fn word(&self, at: usize) -> u32 {
        let four = self.bytes.get(at..at + 4);
        four.map_or(0, |four| u32::from_le_bytes(four.try_into().expect("four bytes")))
    }

    /// Returns an entry of a list of plane or vertex numbers.
    pub(super) fn number(&self, list: usize, index: usize) -> usize {
        if self.layout.has(WIDE) {
            return self.word(self.layout.lists[list] + 4 * index) as usize;
        }
        let at = self.layout.lists[list] + 2 * index;
        self.bytes.get(at..at + 2).map_or(0, |two| u16::from_le_bytes([two[0], two[1]])) as usize
    }

    pub(super) fn part(&self, face: usize) -> u32 {
        self.word(self.layout.lists[4] + if self.layout.has(PARTS) { 4 * face } else { 0 })
    }

    /// Returns the range of a face's rings, or of a ring's corners.
    pub(super) fn between(&self, list: usize, index: usize) -> Range<usize> {
        let end = |index: usize| self.word(self.layout.lists[list] + 4 * index) as usize;
        (if index == 0 { 0 } else { end(index - 1) })..end(index)
    }

    fn plane(&self, index: usize) -> Result<ExactPlane, String> {
        let [part, offset, ..] = self.layout.widths;
        let size = 3 * part + offset;
        let start = self.layout.lists[0] + size * index;
        let bytes = self.bytes.get(start..start + size).filter(|_| index < self.layout.counts[1]);
        let bytes = bytes.ok_or_else(|| format!("plane {index} of {}", self.layout.counts[1]))?;
        let normal = [0, 1, 2].map(|axis| short_number(&bytes[part * axis..part * (axis + 1)]) as i64);
        let plane = ExactPlane { normal, offset: short_number(&bytes[3 * part..]) };
        // Widths of the exact predicates' numbers depend on these limits.
        let is_plane = normal != [0; 3]
            && normal.iter().all(|part| part.unsigned_abs() < 1 << NORMAL_BITS)
            && plane.offset.unsigned_abs() < 1 << OFFSET_BITS;
        if is_plane { Ok(plane) } else { Err(format!("{plane:?}")) }
    }

    fn vertex(&self, index: usize) -> Result<ExactPoint, String> {
        let [_, _, grid_points, vertices, ..] = self.layout.counts;
        if index < grid_points {
            let at = self.layout.lists[1] + GRID_VERTEX * index;
            let point = [0, 4, 8].map(|axis| self.word(at + axis));
            let is_there = point.iter().all(|at| at >> self.bits == 0);
            return match is_there {
                true => Ok(ExactPoint::of_grid(point.map(|at| at as i32))),
                false => Err(format!("a vertex at {point:?} on a grid of {} bits", self.bits)),
            };
        }
        let [_, _, coordinate, weight] = self.layout.widths;
        let size = 3 * coordinate + weight;
        let start = self.layout.lists[2] + size * (index - grid_points);
        let bytes = self.bytes.get(start..start + size).filter(|_| index - grid_points < vertices);
        let bytes = bytes.ok_or_else(|| format!("vertex {index} of {}", grid_points + vertices))?;
        let at = [0, 1, 2].map(|axis| number(&bytes[coordinate * axis..coordinate * (axis + 1)]));
        let weight = number(&bytes[3 * coordinate..]);
        // (Larger weights would overflow in products.)
        if weight.is_negative() || weight.is_zero() || !(weight >> WEIGHT_BITS).is_zero() {
            return Err(format!("a vertex of the weight {weight}"));
        }
        let point = ExactPoint::of(at, weight);
        // (Points may be up to half a grid unit outside of the outermost grid points.)
        let side = (1u64 << self.bits) as f64;
        let is_there = point.near.iter().all(|at| (-1.0..side).contains(at));
        is_there.then_some(point).ok_or_else(|| "a vertex outside of the grid's cells".into())
    }

    /// Decodes all points of a checked block, in the order of their numbers. Errors describe an
    /// invalid point.
    pub(crate) fn points(&self) -> Result<Vec<ExactPoint>, String> {
        let [_, _, grid_points, vertices, ..] = self.layout.counts;
        (0..grid_points + vertices).map(|index| self.vertex(index)).collect()
    }

    /// Visits the edges of all faces: the face's plane, the edge's plane, and the numbers of the
    /// edge's ends. Errors describe an invalid edge.
    pub(crate) fn each_edge(
        &self,
        each: &mut dyn FnMut(&ExactPlane, &ExactPlane, [usize; 2]),
    ) -> Result<(), String> {
        // (Most planes are those of several edges.)
        let mut planes: Vec<Option<ExactPlane>> = vec![None; self.layout.counts[1]];
        let mut plane_of = |index: usize| match planes.get_mut(index) {
            Some(Some(plane)) => Ok(*plane),
            Some(known) => Ok(*known.insert(self.plane(index)?)),
            None => self.plane(index),
        };
        for face in 0..self.len() {
            let plane = plane_of(self.number(3, face))?;
            for ring in self.between(6, face) {
                let range = self.between(7, ring);
                let corners = range.clone().zip(range.clone().cycle().skip(1));
                for (corner, next) in corners {
                    let line = plane_of(self.number(8, 2 * corner + 1))?;
                    each(&plane, &line, [corner, next].map(|corner| self.number(8, 2 * corner)));
                }
            }
        }
        Ok(())
    }

    /// Returns part and source of a face, by its index in a checked block.
    pub(crate) fn head(&self, face: usize) -> ExactHead {
        ExactHead { part: self.part(face), source: self.source(face) }
    }

    /// Returns the first vertex of a face, by its index in a checked block. Errors describe an
    /// invalid face.
    pub(crate) fn first_corner(&self, face: usize) -> Result<ExactPoint, String> {
        let first = self.between(7, self.between(6, face).start).start;
        self.vertex(self.number(8, 2 * first))
    }

    pub(super) fn source(&self, face: usize) -> u64 {
        let word = |half: usize| u64::from(self.word(self.layout.lists[5] + 8 * face + 4 * half));
        word(0) | word(1) << 32
    }

    /// Decodes a face of a checked block, by its index. Errors describe an invalid face.
    pub(crate) fn face(&self, face: usize) -> Result<ExactFace, String> {
        let plane = self.plane(self.number(3, face))?;
        let rings = self.between(6, face);
        let mut found = ExactFace {
            plane,
            corners: Vec::new(),
            ring_ends: Vec::with_capacity(rings.len()),
            colours: Vec::new(),
            part: self.part(face),
            source: self.source(face),
        };
        for ring in rings {
            let range = self.between(7, ring);
            let (first, start) = (range.start, found.corners.len());
            for corner in range.clone() {
                let point = self.vertex(self.number(8, 2 * corner))?;
                let line = self.plane(self.number(8, 2 * corner + 1))?;
                found.corners.push(Corner { point, line });
            }
            let own = &found.corners[start..];
            for (corner, next) in own.iter().zip(own.iter().cycle().skip(1)) {
                let Corner { point, line } = corner;
                let is_on = plane.side(point) == 0 && line.side(point) == 0 && line.side(&next.point) == 0;
                if !is_on || plane.is(line) || point.is(&next.point) {
                    return Err(format!("a corner at {:?} that is not on its edge", point.near));
                }
            }
            found.ring_ends.push(found.corners.len());
            if self.layout.has(COLOURED) {
                let at = self.layout.lists[9] + 3 * first;
                let colours = self.bytes.get(at..at + 3 * range.len()).unwrap_or_default();
                let colour = |colour: &[u8]| [colour[0], colour[1], colour[2]];
                found.colours.extend(colours.chunks_exact(3).map(colour));
            }
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back_in_as_few_bytes_as_they_need() {
        for (value, bytes) in
            [(0i128, 1), (127, 1), (128, 2), (-128, 1), (-129, 2), (1 << 100, 13), (-(1 << 55), 7)]
        {
            assert_eq!(width_of(wide(value)), bytes, "{value}");
            let mut pushed = Vec::new();
            push(&mut pushed, &wide(value), bytes);
            assert_eq!((number(&pushed), short_number(&pushed)), (wide(value), value));
        }
    }
}
