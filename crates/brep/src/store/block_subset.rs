//! Some faces of a block, as a block, and what is known of faces without reading them.

use std::collections::HashSet;

use super::block::{Block, BlockBuilder, COLOURED, SOURCES};
use super::used_entries::UsedEntries;

impl BlockBuilder {
    /// Appends some faces of a checked block by their indices; the first of them gets the number
    /// `first`. Vertices of both are not compared. Returns `None` if the block is invalid.
    pub(crate) fn append(&mut self, block: &Block<'_>, faces: &[usize], first: u64) -> Option<()> {
        if self.parts.is_empty() {
            self.first = first;
        }
        self.is_coloured |= block.is_coloured();
        let before = self.vertices.len() as u32;
        let mut used = UsedEntries::new(block.layout.vertices);
        for &face in faces {
            let (own, mut length) = (self.corners.len(), 0);
            let start = block.rings(face, &mut |end| {
                length = end;
                self.ring_ends.push((own + end) as u32);
            });
            for corner in start..start + length {
                self.corners.push(before + used.number(block.corner(corner))?);
            }
            self.face_ends.push(self.ring_ends.len() as u32);
            self.parts.push(block.part(face));
            self.sources.push(block.source(face));
            self.proxies.push(block.is_proxy(face));
        }
        self.vertices.extend(used.used().iter().map(|vertex| block.vertex(*vertex)));
        match block.is_coloured() {
            true => {
                let bytes = used.bytes(&block.bytes, block.layout.colours, 3)?;
                self.colours.extend(bytes.chunks_exact(3).map(|colour| [colour[0], colour[1], colour[2]]));
            }
            false => self.colours.resize(self.vertices.len(), [0; 3]),
        }
        Some(())
    }
}

impl Block<'_> {
    /// Returns whether vertices have colours.
    pub(crate) fn is_coloured(&self) -> bool {
        self.layout.has(COLOURED)
    }

    /// Returns the bytes of the block, if they are right for a block whose first face has another
    /// number: faces without sources have their numbers instead.
    pub(crate) fn bytes_from(&self, first: u64) -> Option<&[u8]> {
        (self.layout.has(SOURCES) || first == self.first).then_some(&*self.bytes)
    }

    /// Returns for each face whether two of its corners are among some points, as they are if one
    /// of its edges joins two of them.
    pub(crate) fn faces_between(&self, points: &HashSet<[i32; 3]>) -> Vec<bool> {
        let is_there: Vec<bool> =
            (0..self.layout.vertices).map(|vertex| points.contains(&self.vertex(vertex))).collect();
        let is_on = |corner: usize| is_there.get(self.corner(corner)).copied().unwrap_or(false);
        let has_two = |face: usize| {
            let mut length = 0;
            let start = self.rings(face, &mut |end| length = end);
            (start..start + length).filter(|corner| is_on(*corner)).nth(1).is_some()
        };
        (0..self.len()).map(has_two).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Face, FaceBuffer};
    use spinney_base::io::FileBytes;

    /// Faces of a subset are those of the block; a subset of all faces has the bytes of the block.
    #[test]
    fn subsets_have_the_faces_of_the_block() {
        let points: Vec<[i32; 3]> = (0..40).map(|n| [n * 7 % 16, n * 5 % 16, n * 3 % 16]).collect();
        for (are_triangles, has_colours, parts) in [(true, false, 1), (false, true, 3), (false, false, 1)] {
            let mut builder = BlockBuilder::default();
            for number in 0..12u64 {
                let (at, long) = (2 * number as usize, if are_triangles { 0 } else { number as usize % 4 });
                let points = &points[at..at + 3 + long];
                let ends = if long == 3 { vec![3, 6] } else { vec![points.len()] };
                let colours: Vec<[u8; 3]> = (0..if has_colours { points.len() } else { 0 })
                    .map(|n| [n as u8, number as u8, 0])
                    .collect();
                let (part, source) = (number as u32 % parts, number * 3);
                let face =
                    Face { number: 50 + number, points, ring_ends: &ends, colours: &colours, part, source };
                builder.push(&face, number % 3 == 1);
            }
            let (first, bytes) = builder.finish();
            let block = Block::new(FileBytes::Mapped(&bytes), first).unwrap();
            let subset = |faces: &[usize], first: u64| {
                let mut builder = BlockBuilder::default();
                builder.append(&block, faces, first).unwrap();
                builder.finish().1
            };
            assert_eq!(subset(&(0..12).collect::<Vec<_>>(), 50), bytes);
            assert_eq!(block.bytes_from(7), Some(&bytes[..]));
            for chosen in [vec![0], vec![11], vec![1, 4, 5, 6], vec![0, 2, 3, 7, 8, 9, 10]] {
                // (Two faces more, from another call.)
                let mut builder = BlockBuilder::default();
                builder.append(&block, &chosen, 90).unwrap();
                builder.append(&block, &[10, 3], 90 + chosen.len() as u64).unwrap();
                let chosen = [&chosen[..], &[10, 3]].concat();
                let (first, joined) = builder.finish();
                let found = Block::new(FileBytes::Mapped(&joined), first).unwrap();
                found.check(4, 3).unwrap();
                assert_eq!((first, found.len()), (90, chosen.len()));
                let (mut own, mut other) = (FaceBuffer::default(), FaceBuffer::default());
                for (place, index) in chosen.iter().enumerate() {
                    found.read(place, &mut own);
                    block.read(*index, &mut other);
                    assert_eq!((own.number, own.is_proxy), (90 + place as u64, other.is_proxy));
                    assert_eq!(own.face(), Face { number: own.number, ..other.face() });
                }
            }
            let ends: HashSet<[i32; 3]> = [points[4], points[5]].into();
            let mut buffer = FaceBuffer::default();
            for (place, is_between) in block.faces_between(&ends).into_iter().enumerate() {
                block.read(place, &mut buffer);
                let count = buffer.points.iter().filter(|at| ends.contains(*at)).count();
                assert_eq!(is_between, count >= 2);
            }
        }
    }
}
