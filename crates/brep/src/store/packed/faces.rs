//! Packing of blocks of faces in columns.

use spinney_packing::Columns;

use super::super::block::{self, BlockLayout};
use super::corners::Corners;
use super::positions::VertexPositions;
use super::words::{Words, code_ends, code_parts, code_sources, push_numbers, push_words};
use super::{corners, positions};

/// Contexts of bits and of numbers.
mod contexts {
    use super::{corners, positions};

    pub(super) const PROXY: usize = 0;
    pub(super) const CORNERS: usize = PROXY + 2;
    pub(super) const POSITIONS: usize = CORNERS + corners::CONTEXTS.0;
    pub(super) const BITS: usize = POSITIONS + positions::CONTEXTS.0;

    pub(super) const PART: usize = 0;
    pub(super) const SOURCE: usize = 1;
    pub(super) const RINGS: usize = 2;
    pub(super) const RING: usize = 3;
    pub(super) const CORNER: usize = 4;
    pub(super) const POSITION: usize = CORNER + corners::CONTEXTS.1;
    pub(super) const NUMBERS: usize = POSITION + positions::CONTEXTS.1;
}

/// Contexts of bits and of numbers.
pub(super) const CONTEXTS: (usize, usize) = (contexts::BITS, contexts::NUMBERS);

/// The lists of a block.
pub(super) struct Faces {
    layout: BlockLayout,
    vertices: Vec<[i32; 3]>,
    face_ends: Vec<u32>,
    ring_ends: Vec<u32>,
    parts: Vec<u32>,
    sources: Vec<u64>,
    proxies: Vec<u8>,
    colours: Vec<[u8; 3]>,
    corners: Vec<u32>,
}

impl Faces {
    /// Codes the lists of a block of `length` bytes; writes those of `plain`. Returns `None` if the
    /// lists are invalid.
    pub(super) fn code(columns: &mut Columns<'_>, length: usize, plain: &[u8]) -> Option<Vec<u8>> {
        let mut words = Words(plain);
        let mut head = Vec::new();
        push_words(&mut head, (0..5).map(|_| columns.number(words.word().into()) as u32));
        let mut faces = Faces::blank(&head, length)?;
        faces.take(words);
        faces.code_lists(columns)?;
        faces.push(&mut head);
        Some(head)
    }

    /// Allocates lists of zeros with the counts of a block's header, which must be that of a block
    /// of `length` bytes.
    fn blank(head: &[u8], length: usize) -> Option<Faces> {
        // Invariant: the lists take exactly the block's bytes, so no list is larger than the block.
        // Otherwise, an untrusted header could request any amount of memory.
        let layout = BlockLayout::of(head).filter(|layout| layout.end == length)?;
        let BlockLayout { faces, vertices, rings, corners, .. } = layout;
        // (On 32-bit targets, the sum of larger counts might overflow.)
        if [faces, vertices, rings, corners].iter().any(|count| *count > length) {
            return None;
        }
        let count = |flag, count| if layout.has(flag) { count } else { 0 };
        let are_triangles = layout.has(block::TRIANGLES);
        if are_triangles && (rings != faces || corners != 3 * faces) {
            return None;
        }
        Some(Faces {
            layout,
            vertices: vec![[0; 3]; vertices],
            face_ends: vec![0; if are_triangles { 0 } else { faces }],
            ring_ends: vec![0; if are_triangles { 0 } else { rings }],
            parts: vec![0; count(block::PARTS, faces).max(1)],
            sources: vec![0; count(block::SOURCES, faces)],
            proxies: vec![0; count(block::PROXIES, faces.div_ceil(8))],
            colours: vec![[0; 3]; count(block::COLOURED, vertices)],
            corners: vec![0; corners],
        })
    }

    /// Reads the lists from the words after a block's header.
    fn take(&mut self, mut words: Words<'_>) {
        self.vertices.as_flattened_mut().iter_mut().for_each(|at| *at = words.word() as i32);
        let lists = [&mut self.face_ends, &mut self.ring_ends, &mut self.parts];
        lists.into_iter().flatten().for_each(|word| *word = words.word());
        self.sources.iter_mut().for_each(|source| *source = words.long());
        words.bytes(&mut self.proxies);
        words.bytes(self.colours.as_flattened_mut());
        let is_wide = self.layout.has(block::WIDE);
        self.corners.iter_mut().for_each(|corner| *corner = words.number(is_wide));
    }

    /// Appends the lists in the format of a plain block.
    fn push(&self, bytes: &mut Vec<u8>) {
        push_words(bytes, self.vertices.as_flattened().iter().map(|at| *at as u32));
        let lists = [&self.face_ends, &self.ring_ends, &self.parts];
        push_words(bytes, lists.into_iter().flatten().copied());
        self.sources.iter().for_each(|source| bytes.extend_from_slice(&source.to_le_bytes()));
        bytes.extend_from_slice(&self.proxies);
        bytes.extend_from_slice(self.colours.as_flattened());
        push_numbers(bytes, &self.corners, self.layout.has(block::WIDE));
    }

    fn code_lists(&mut self, columns: &mut Columns<'_>) -> Option<()> {
        code_ends(columns, contexts::RINGS, 1, &mut self.face_ends);
        code_ends(columns, contexts::RING, 3, &mut self.ring_ends);
        code_parts(columns, contexts::PART, &mut self.parts);
        code_sources(columns, contexts::SOURCE, &mut self.sources);
        let mut is_set = false;
        for face in 0..8 * self.proxies.len() {
            let (byte, bit) = (&mut self.proxies[face / 8], face % 8);
            is_set = columns.bit(contexts::PROXY + usize::from(is_set), *byte >> bit & 1 == 1);
            *byte = *byte & !(1 << bit) | u8::from(is_set) << bit;
        }
        let mut positions =
            VertexPositions::new(columns, contexts::POSITIONS, contexts::POSITION, &self.vertices)?;
        let mut corners = Corners::new(contexts::CORNERS, contexts::CORNER, self.vertices.len());
        let mut start = 0;
        for ring in 0..self.layout.rings {
            let end = self.ring_ends.get(ring).map_or(start + 3, |end| *end as usize);
            let ring = self.corners.get_mut(start..end)?;
            corners.code(columns, ring)?;
            for index in 0..ring.len() {
                positions.code(columns, &corners, (ring, index), &mut self.vertices, &mut self.colours);
            }
            corners.join(ring);
            start = end;
        }
        Some(())
    }
}
