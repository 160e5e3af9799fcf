//! Blocks of faces: consecutive faces of a model, with a common vertex list.

use std::collections::HashMap;

use crate::Face;
use spinney_base::io::FileBytes;

/// Maximum number of faces of a block.
pub(crate) const MAX_FACES: usize = 1024;
/// A block with this many corners (vertex indices of its faces) takes no more faces.
const MANY_CORNERS: usize = 4096;

/// Returns whether a block of so many faces and corners takes no more faces.
pub(crate) fn is_full(faces: usize, corners: usize) -> bool {
    faces >= MAX_FACES || corners >= MANY_CORNERS
}

/// Bytes of a block's header.
pub(super) const HEAD: usize = 20;
pub(super) const COLOURED: u32 = 1;
pub(super) const WIDE: u32 = 2;
pub(super) const TRIANGLES: u32 = 4;
pub(super) const PARTS: u32 = 8;
pub(super) const SOURCES: u32 = 16;
pub(super) const PROXIES: u32 = 32;

/// Collects the faces of a block.
#[derive(Default)]
pub(crate) struct BlockBuilder {
    pub(super) first: u64,
    /// Numbers of the vertices in this block.
    known: HashMap<([i32; 3], [u8; 3]), u32, crate::hash::Hasher>,
    pub(super) vertices: Vec<[i32; 3]>,
    pub(super) colours: Vec<[u8; 3]>,
    pub(super) corners: Vec<u32>,
    pub(super) ring_ends: Vec<u32>,
    pub(super) face_ends: Vec<u32>,
    pub(super) parts: Vec<u32>,
    pub(super) sources: Vec<u64>,
    /// Whether each face is a proxy for faces with off-grid vertices.
    pub(super) proxies: Vec<bool>,
    pub(super) is_coloured: bool,
}

impl BlockBuilder {
    /// Returns whether the block takes no more faces.
    pub(crate) fn is_full(&self) -> bool {
        is_full(self.parts.len(), self.corners.len())
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.parts.is_empty()
    }

    /// Returns whether so many more faces of another block can be appended.
    pub(crate) fn takes(&self, faces: usize) -> bool {
        self.is_empty() || self.parts.len() + faces <= MAX_FACES
    }

    /// Adds a face, which may be a proxy for faces with off-grid vertices.
    pub(crate) fn push(&mut self, face: &Face<'_>, is_proxy: bool) {
        if self.parts.is_empty() {
            self.first = face.number;
        }
        self.is_coloured |= !face.colours.is_empty();
        let start = self.corners.len();
        for (index, &point) in face.points.iter().enumerate() {
            let colour = face.colours.get(index).copied().unwrap_or_default();
            // Most faces share an edge with the previous one.
            let is_it = |number: &u32| {
                let number = *number as usize;
                self.vertices[number] == point && self.colours[number] == colour
            };
            let recent = &self.corners[start.saturating_sub(3)..start];
            let number = recent.iter().copied().find(is_it).unwrap_or_else(|| {
                let next = self.vertices.len() as u32;
                let number = *self.known.entry((point, colour)).or_insert(next);
                if number == next {
                    self.vertices.push(point);
                    self.colours.push(colour);
                }
                number
            });
            self.corners.push(number);
        }
        let start = start as u32;
        self.ring_ends.extend(face.ring_ends.iter().map(|end| start + *end as u32));
        self.face_ends.push(self.ring_ends.len() as u32);
        self.parts.push(face.part);
        self.sources.push(face.source);
        self.proxies.push(is_proxy);
    }

    /// Returns the number of the first face, and the block's bytes; resets the builder.
    pub(crate) fn finish(&mut self) -> (u64, Vec<u8>) {
        let is_wide = self.vertices.len() > 1 << 16;
        let are_triangles = self.face_ends.len() == self.ring_ends.len()
            && (3..).step_by(3).zip(&self.ring_ends).all(|(end, ring)| end == *ring);
        let one_part = self.parts.iter().all(|part| *part == self.parts[0]);
        let own_numbers = (self.first..).zip(&self.sources).all(|(number, source)| number == *source);
        let has_proxies = self.proxies.contains(&true);
        let flag = |is_set: bool, flag: u32| if is_set { flag } else { 0 };
        let flags = flag(self.is_coloured, COLOURED)
            | flag(is_wide, WIDE)
            | flag(are_triangles, TRIANGLES)
            | flag(!one_part, PARTS)
            | flag(!own_numbers, SOURCES)
            | flag(has_proxies, PROXIES);
        let counts = [self.parts.len(), self.vertices.len(), self.ring_ends.len(), self.corners.len()];
        let mut bytes = Vec::with_capacity(HEAD + 12 * self.vertices.len() + 4 * self.corners.len());
        let mut word = |word: u32| bytes.extend_from_slice(&word.to_le_bytes());
        counts.into_iter().for_each(|count| word(count as u32));
        word(flags);
        self.vertices.as_flattened().iter().for_each(|at| word(*at as u32));
        if !are_triangles {
            self.face_ends.iter().chain(&self.ring_ends).for_each(|end| word(*end));
        }
        self.parts[..if one_part { 1 } else { self.parts.len() }].iter().for_each(|part| word(*part));
        if !own_numbers {
            self.sources.iter().for_each(|source| bytes.extend_from_slice(&source.to_le_bytes()));
        }
        if has_proxies {
            let bits =
                |faces: &[bool]| (0..).zip(faces).fold(0, |bits, (bit, is)| bits | u8::from(*is) << bit);
            bytes.extend(self.proxies.chunks(8).map(bits));
        }
        if self.is_coloured {
            bytes.extend_from_slice(self.colours.as_flattened());
        }
        for corner in &self.corners {
            match is_wide {
                true => bytes.extend_from_slice(&corner.to_le_bytes()),
                false => bytes.extend_from_slice(&(*corner as u16).to_le_bytes()),
            }
        }
        let first = self.first;
        let BlockBuilder { known, vertices, colours, corners, ring_ends, face_ends, .. } = self;
        known.clear();
        vertices.clear();
        colours.clear();
        corners.clear();
        ring_ends.clear();
        face_ends.clear();
        self.parts.clear();
        self.sources.clear();
        self.proxies.clear();
        self.is_coloured = false;
        (first, bytes)
    }
}

/// A block of a file.
pub(crate) struct Block<'a> {
    pub(super) bytes: FileBytes<'a>,
    pub(super) first: u64,
    pub(super) layout: BlockLayout,
}

/// Counts and offsets of a block's lists.
#[derive(Clone, Copy)]
pub(super) struct BlockLayout {
    pub(super) faces: usize,
    pub(super) vertices: usize,
    pub(super) rings: usize,
    pub(super) corners: usize,
    pub(super) flags: u32,
    face_ends: usize,
    ring_ends: usize,
    parts: usize,
    sources: usize,
    proxies: usize,
    pub(super) colours: usize,
    corner_list: usize,
    pub(super) end: usize,
}

#[inline]
fn word(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..at + 4).map_or(0, |four| u32::from_le_bytes(four.try_into().expect("four bytes")))
}

impl BlockLayout {
    pub(super) fn of(bytes: &[u8]) -> Option<BlockLayout> {
        if bytes.len() < HEAD {
            return None;
        }
        // (Each is below 2^32, so no sum overflows.)
        let [faces, vertices, rings, corners] = [0, 4, 8, 12].map(|at| word(bytes, at) as usize);
        let flags = word(bytes, 16);
        let has = |flag: u32| flags & flag != 0;
        let face_ends = HEAD + 12 * vertices;
        let ring_ends = face_ends + if has(TRIANGLES) { 0 } else { 4 * faces };
        let parts = ring_ends + if has(TRIANGLES) { 0 } else { 4 * rings };
        let sources = parts + if has(PARTS) { 4 * faces } else { 4 };
        let proxies = sources + if has(SOURCES) { 8 * faces } else { 0 };
        let colours = proxies + if has(PROXIES) { faces.div_ceil(8) } else { 0 };
        let corner_list = colours + if has(COLOURED) { 3 * vertices } else { 0 };
        let end = corner_list + corners * if has(WIDE) { 4 } else { 2 };
        let layout = BlockLayout {
            faces,
            vertices,
            rings,
            corners,
            flags,
            face_ends,
            ring_ends,
            parts,
            sources,
            proxies,
            colours,
            corner_list,
            end,
        };
        Some(layout)
    }

    pub(super) fn has(&self, flag: u32) -> bool {
        self.flags & flag != 0
    }
}

/// Vertices and rings of a face that was read; the memory is reused for the next face.
#[derive(Clone, Debug, Default)]
pub struct FaceBuffer {
    /// Vertices of all rings, the outer ring's first.
    pub points: Vec<[i32; 3]>,
    /// End of each ring in `points`.
    pub ring_ends: Vec<usize>,
    /// A colour per vertex, or none.
    pub colours: Vec<[u8; 3]>,
    /// Number of the face in its model.
    pub number: u64,
    /// Number of its part.
    pub part: u32,
    /// Number of the face in the file that the model was built from.
    pub source: u64,
    /// Whether the face is a proxy for faces with off-grid vertices.
    pub(crate) is_proxy: bool,
}

impl FaceBuffer {
    /// Returns the face.
    pub fn face(&self) -> Face<'_> {
        let FaceBuffer { points, ring_ends, colours, number, part, source, .. } = self;
        Face { number: *number, points, ring_ends, colours, part: *part, source: *source }
    }
}

impl<'a> Block<'a> {
    /// Wraps a block that was checked before; returns `None` if its bytes have changed since, and
    /// its lists do not fit.
    pub(crate) fn new(bytes: FileBytes<'a>, first: u64) -> Option<Block<'a>> {
        let layout = BlockLayout::of(&bytes)?;
        (layout.end <= bytes.len()).then_some(Block { bytes, first, layout })
    }

    /// Checks a block of an untrusted file: counts match its length, vertex numbers and parts
    /// exist, rings have at least three vertices, and coordinates have at most `bits` bits. Errors
    /// describe the flaw.
    pub(crate) fn check(&self, bits: u8, parts: u64) -> Result<(), String> {
        let BlockLayout { faces, vertices, rings, corners, end, .. } = self.layout;
        if faces == 0 || end != self.bytes.len() {
            return Err(format!("{faces} faces in {} bytes", self.bytes.len()));
        }
        let is_ascending = |at: usize, count: usize, least: usize, most: usize| {
            let ends = (0..count).map(|index| word(&self.bytes, at + 4 * index) as usize);
            let last = ends.clone().next_back();
            let steps = std::iter::once(0).chain(ends.clone()).zip(ends);
            last == Some(most) && steps.into_iter().all(|(from, to)| from + least <= to)
        };
        let has_rings = if self.layout.has(TRIANGLES) {
            rings == faces && corners == 3 * faces
        } else {
            is_ascending(self.layout.face_ends, faces, 1, rings)
                && is_ascending(self.layout.ring_ends, rings, 3, corners)
        };
        if !has_rings {
            return Err("ends of faces and rings that do not ascend".into());
        }
        if let Some(corner) = (0..corners).map(|index| self.corner(index)).find(|corner| *corner >= vertices)
        {
            return Err(format!("vertex {corner} of {vertices}"));
        }
        let outside = |at: &[i32; 3]| at.iter().any(|at| (*at as u32) >> bits != 0);
        if let Some(at) = (0..vertices).map(|vertex| self.vertex(vertex)).find(outside) {
            return Err(format!("a vertex at {at:?} on a grid of {bits} bits"));
        }
        if self.layout.flags >= 2 * PROXIES {
            return Err(format!("flags {:x}", self.layout.flags));
        }
        let wrong = (0..faces).map(|face| self.part(face)).find(|part| u64::from(*part) >= parts);
        wrong.map_or(Ok(()), |part| Err(format!("part {part} of {parts}")))
    }

    /// Returns the number of faces.
    pub(crate) fn len(&self) -> usize {
        self.layout.faces
    }

    #[inline]
    pub(super) fn corner(&self, index: usize) -> usize {
        let bytes: &[u8] = &self.bytes;
        if self.layout.has(WIDE) {
            word(bytes, self.layout.corner_list + 4 * index) as usize
        } else {
            let at = self.layout.corner_list + 2 * index;
            bytes.get(at..at + 2).map_or(0, |two| u16::from_le_bytes([two[0], two[1]])) as usize
        }
    }

    #[inline]
    pub(super) fn vertex(&self, number: usize) -> [i32; 3] {
        let at = HEAD + 12 * number;
        let bytes = self.bytes.get(at..at + 12).unwrap_or(&[0; 12]);
        [word(bytes, 0) as i32, word(bytes, 4) as i32, word(bytes, 8) as i32]
    }

    /// Returns the index of a face in the block, if the block has it.
    #[inline]
    pub(crate) fn index(&self, number: u64) -> Option<usize> {
        let index = number.wrapping_sub(self.first);
        (index < self.layout.faces as u64).then_some(index as usize)
    }

    /// Returns the vertices of a face of a block of triangles, by its index; `None` for other
    /// blocks.
    #[inline]
    pub(crate) fn triangle(&self, face: usize) -> Option<[[i32; 3]; 3]> {
        let corner = |index: usize| self.vertex(self.corner(3 * face + index));
        self.layout.has(TRIANGLES).then(|| [corner(0), corner(1), corner(2)])
    }

    /// Returns whether any face may be a proxy.
    pub(crate) fn has_proxies(&self) -> bool {
        self.layout.has(PROXIES)
    }

    /// Returns whether a face is a proxy, by its index.
    pub(crate) fn is_proxy(&self, face: usize) -> bool {
        let byte = self.bytes.get(self.layout.proxies + face / 8).filter(|_| self.has_proxies());
        byte.is_some_and(|byte| byte >> (face % 8) & 1 == 1)
    }

    /// Returns the number of a face's part, by the face's index in the block.
    pub(crate) fn part(&self, face: usize) -> u32 {
        word(&self.bytes, self.layout.parts + if self.layout.has(PARTS) { 4 * face } else { 0 })
    }

    /// Visits the end of each ring of a face, from the face's first corner on; returns that corner.
    #[inline]
    pub(super) fn rings(&self, face: usize, visit: &mut impl FnMut(usize)) -> usize {
        let layout = &self.layout;
        if layout.has(TRIANGLES) {
            visit(3);
            return 3 * face;
        }
        let end = |list: usize, index: usize| match index {
            0 => 0,
            _ => word(&self.bytes, list + 4 * (index - 1)) as usize,
        };
        let rings = end(layout.face_ends, face)..end(layout.face_ends, face + 1).min(layout.rings);
        let start = end(layout.ring_ends, rings.start);
        rings.for_each(|ring| {
            visit(end(layout.ring_ends, ring + 1).min(layout.corners).saturating_sub(start))
        });
        start
    }

    /// Reads a face by its index in the block, which must be below the length.
    #[inline]
    pub(crate) fn read(&self, face: usize, buffer: &mut FaceBuffer) {
        let layout = &self.layout;
        buffer.points.clear();
        buffer.ring_ends.clear();
        buffer.colours.clear();
        let start = self.rings(face, &mut |end| buffer.ring_ends.push(end));
        let end = start + buffer.ring_ends.last().copied().unwrap_or(0);
        for corner in start..end {
            let vertex = self.corner(corner);
            buffer.points.push(self.vertex(vertex));
            if layout.has(COLOURED) {
                let at = layout.colours + 3 * vertex;
                let colour = self.bytes.get(at..at + 3).map_or([0; 3], |c| [c[0], c[1], c[2]]);
                buffer.colours.push(colour);
            }
        }
        buffer.number = self.first + face as u64;
        buffer.part = self.part(face);
        buffer.is_proxy = self.is_proxy(face);
        buffer.source = self.source(face);
    }

    /// Returns a face's number in the file that the model was built from, by the face's index.
    #[inline]
    pub(crate) fn source(&self, face: usize) -> u64 {
        if !self.layout.has(SOURCES) {
            return self.first + face as u64;
        }
        let at = self.layout.sources + 8 * face;
        u64::from(word(&self.bytes, at)) | u64::from(word(&self.bytes, at + 4)) << 32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_come_back() {
        let square = [[0, 0, 7], [9, 0, 7], [9, 9, 7], [0, 9, 7], [3, 3, 7], [3, 6, 7], [6, 6, 7]];
        let colours: Vec<[u8; 3]> = (0..7).map(|i| [i, 2, 3]).collect();
        let face = |number, points, ring_ends, colours, part, source| Face {
            number,
            points,
            ring_ends,
            colours,
            part,
            source,
        };
        let cases: [Vec<Face<'_>>; 3] = [
            vec![face(5, &square[..3], &[3], &[], 0, 5), face(6, &square[1..4], &[3], &[], 0, 6)],
            vec![
                face(0, &square, &[4, 7], &colours, 2, 0),
                face(1, &square[..4], &[4], &colours[1..5], 1, 0),
            ],
            vec![face(9, &square[..3], &[3], &colours[..3], 3, 11)],
        ];
        for faces in cases {
            let mut builder = BlockBuilder::default();
            (0..).zip(&faces).for_each(|(i, face)| builder.push(face, i == 1 && face.part == 1));
            let (first, bytes) = builder.finish();
            assert!(builder.is_empty() && first == faces[0].number);
            let block = Block::new(FileBytes::Mapped(&bytes), first).unwrap();
            block.check(4, 4).unwrap();
            assert!(block.check(3, 4).is_err() && block.check(4, 0).is_err());
            let mut buffer = FaceBuffer::default();
            for (index, face) in faces.iter().enumerate() {
                block.read(index, &mut buffer);
                assert_eq!(&buffer.face(), face);
                assert_eq!(buffer.is_proxy, index == 1 && face.part == 1);
            }
            // A changed byte is either detected, or yields other valid faces.
            for at in 0..bytes.len() {
                for to in [0, 1, 0x7f, 0xff] {
                    let mut bytes = bytes.clone();
                    bytes[at] = to;
                    let Some(block) = Block::new(FileBytes::Mapped(&bytes), first) else { continue };
                    let checked = block.check(4, 4);
                    for index in 0..block.len().min(10) {
                        block.read(index, &mut buffer);
                        let face = buffer.face();
                        assert!(checked.is_err() || face.points.iter().flatten().all(|at| *at < 16));
                    }
                }
            }
        }
    }
}
