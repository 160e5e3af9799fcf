//! Faces of an OBJ file as a compact list of integers.

use std::path::Path;

use super::super::spill::{SpillBuffer, SpilledBytes};
use spinney_base::Result;

/// Part and material of a face; its vertices follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FaceHead {
    pub(super) part: u32,
    pub(super) material: u32,
}

/// Collects a [`FaceList`]. Integers are LEB128. Vertices are zigzag-coded differences to the
/// previous vertex: most take one or two bytes, and their number is unlimited.
pub(super) struct FaceListBuilder {
    bytes: SpillBuffer,
    count: u64,
    without_parts: u64,
}

impl FaceListBuilder {
    pub(super) fn new(path: &Path, memory: u64) -> FaceListBuilder {
        FaceListBuilder { bytes: SpillBuffer::new(path, memory), count: 0, without_parts: 0 }
    }

    fn number(&mut self, mut number: u64) -> Result<()> {
        while number > 127 {
            self.bytes.push(&[number as u8 | 128])?;
            number >>= 7;
        }
        self.bytes.push(&[number as u8])
    }

    pub(super) fn push(&mut self, head: FaceHead, vertices: &[u64]) -> Result<()> {
        [head.part.into(), head.material.into(), vertices.len() as u64]
            .into_iter()
            .try_for_each(|number| self.number(number))?;
        let mut before = 0;
        for vertex in vertices {
            let difference = vertex.wrapping_sub(before) as i64;
            self.number((difference << 1 ^ difference >> 63) as u64)?;
            before = *vertex;
        }
        self.count += 1;
        Ok(())
    }

    pub(super) fn count(&self) -> u64 {
        self.count
    }

    /// Moves all faces so far to part 0.
    pub(super) fn drop_parts(&mut self) {
        self.without_parts = self.count;
    }

    pub(super) fn finish(self) -> Result<FaceList> {
        Ok(FaceList { bytes: self.bytes.finish()?, without_parts: self.without_parts })
    }
}

/// Faces in file order.
pub(super) struct FaceList {
    bytes: SpilledBytes,
    without_parts: u64,
}

impl FaceList {
    pub(super) fn reader(&self) -> FaceReader<'_> {
        FaceReader { bytes: self.bytes.bytes(), without_parts: self.without_parts }
    }
}

/// Reads a list from its start.
pub(super) struct FaceReader<'f> {
    bytes: &'f [u8],
    without_parts: u64,
}

impl FaceReader<'_> {
    fn number(&mut self) -> u64 {
        let (mut number, mut shift) = (0, 0);
        while let Some((byte, rest)) = self.bytes.split_first() {
            self.bytes = rest;
            number |= u64::from(byte & 127) << shift;
            shift += 7;
            if *byte < 128 {
                break;
            }
        }
        number
    }

    /// Reads the next face and replaces the content of `vertices`; returns `None` at the end.
    pub(super) fn next(&mut self, vertices: &mut Vec<u64>) -> Option<FaceHead> {
        if self.bytes.is_empty() {
            return None;
        }
        let mut head = FaceHead { part: self.number() as u32, material: self.number() as u32 };
        if self.without_parts > 0 {
            (self.without_parts, head.part) = (self.without_parts - 1, 0);
        }
        vertices.clear();
        let mut vertex = 0u64;
        for _ in 0..self.number() {
            let coded = self.number();
            vertex = vertex.wrapping_add(coded >> 1 ^ (coded & 1).wrapping_neg());
            vertices.push(vertex);
        }
        Some(head)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_of_any_numbers_come_back() {
        let faces: [(FaceHead, &[u64]); 4] = [
            (FaceHead { part: 0, material: 0 }, &[]),
            (FaceHead { part: 127, material: 128 }, &[0, 1, 2, 1 << 40]),
            (FaceHead { part: u32::MAX, material: 7 }, &[u64::MAX >> 1, 0, u64::MAX - 1, 64]),
            (FaceHead { part: 1, material: u32::MAX }, &[5]),
        ];
        let mut list = FaceListBuilder::new(Path::new("a.obj"), 0);
        for (number, (head, vertices)) in faces.into_iter().enumerate() {
            if number == 2 {
                list.drop_parts();
            }
            list.push(head, vertices).unwrap();
        }
        let (list, mut vertices) = (list.finish().unwrap(), Vec::new());
        let mut reader = list.reader();
        for (number, (head, expected)) in faces.into_iter().enumerate() {
            let head = FaceHead { part: if number < 2 { 0 } else { head.part }, ..head };
            assert_eq!(reader.next(&mut vertices), Some(head));
            assert_eq!(vertices, expected);
        }
        assert_eq!(reader.next(&mut vertices), None);
    }
}
