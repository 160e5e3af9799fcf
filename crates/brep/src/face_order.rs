//! Order of a model's faces in its file. Faces that are close in space are close in the file, so
//! that queries read few blocks, and blocks have few vertices.
//!
//! Faces are sorted along a space-filling curve, in bounded memory. Within a block, a face follows
//! one that shares an edge with it where possible, which packs well.

use std::collections::HashMap;
use std::path::Path;

use crate::hash::Hasher;
use crate::store::block::is_full;
use crate::{ColumnValues, Face, FaceList, Faces, Grid, curve};
use spinney_base::io::Sorter;
use spinney_base::{Result, sort};

/// Collects the faces of a model with their values, and returns them in the order of the file.
pub struct FaceSorter {
    grid: Grid,
    sorter: Sorter,
    /// Source of the last face, and its position on the curve.
    last: Option<(u64, u64)>,
    item: Vec<u8>,
}

/// Receives a face with its values: column names, and JSON strings.
type SortedFaceVisitor<'a> = dyn FnMut(&Face<'_>, &[(&str, &str)]) -> Result<()> + 'a;

impl FaceSorter {
    /// Sorts faces with about `memory` bytes of memory, and temporary files in `directory`.
    pub fn new(grid: &Grid, directory: &Path, memory: u64) -> FaceSorter {
        let sorter = Sorter::new(directory, memory);
        FaceSorter { grid: grid.clone(), sorter, last: None, item: Vec::new() }
    }

    /// Adds a face. Faces with the same source are consecutive.
    ///
    /// # Errors
    /// If a temporary file cannot be written.
    pub fn push(&mut self, face: &Face<'_>, values: &[(&str, &str)]) -> Result<()> {
        // Invariant: faces with the same source are consecutive after the sort, too. They have the
        // same key, and the sort is stable. So a block must remember one source of the last block.
        let key = match self.last {
            Some((source, key)) if source == face.source => key,
            _ => curve::position(face, self.grid.bits),
        };
        self.last = Some((face.source, key));
        self.item.clear();
        write_face(face, values, &mut self.item);
        self.sorter.push(key, &self.item)
    }

    /// Passes all faces to a function, in the order of the file. Numbers ascend from 0, and the
    /// source of a face becomes the number of the first face with the same source. Rings may begin
    /// at another vertex.
    ///
    /// The faces of a model with a single block are not changed: their order has no advantage.
    ///
    /// # Errors
    /// If a temporary file cannot be read, or what the function returns.
    pub fn finish(self, each: &mut SortedFaceVisitor<'_>) -> Result<()> {
        let mut block = BlockFaces::new(self.grid);
        self.sorter.finish(&mut |item| {
            if is_full(block.numbers.len(), block.corners) {
                block.flush(false, each)?;
            }
            block.push(item);
            Ok(())
        })?;
        block.flush(true, each)
    }
}

/// Faces of a block.
struct BlockFaces {
    faces: FaceList,
    /// For each face, its number in the order in which faces were added.
    numbers: Vec<u64>,
    values: Vec<ColumnValues>,
    corners: usize,
    scratch: StoredFace,
    /// Number of the first face of the block.
    first: u64,
    /// Source and new source of the last face of the previous block.
    last: Option<(u64, u64)>,
}

impl BlockFaces {
    fn new(grid: Grid) -> BlockFaces {
        let faces = FaceList::new(grid, Vec::new());
        BlockFaces {
            faces,
            numbers: Vec::new(),
            values: Vec::new(),
            corners: 0,
            scratch: StoredFace::default(),
            first: 0,
            last: None,
        }
    }

    fn push(&mut self, item: &[u8]) {
        self.scratch.read(item);
        self.faces.push(&self.scratch.face());
        self.numbers.push(self.scratch.number);
        self.values.push(std::mem::take(&mut self.scratch.values));
        self.corners += self.scratch.points.len();
    }

    /// Passes the faces to `each`, and removes them.
    fn flush(&mut self, is_last: bool, each: &mut SortedFaceVisitor<'_>) -> Result<()> {
        let order = match self.first == 0 && is_last {
            true => {
                let mut order: Vec<(usize, usize)> = (0..self.numbers.len()).map(|face| (face, 0)).collect();
                sort::by_key(&mut order, |(face, _)| self.numbers[*face]);
                order
            }
            false => connected_order(&self.faces),
        };
        // New sources, by source.
        let mut sources: HashMap<u64, u64, Hasher> = self.last.into_iter().collect();
        let (mut points, mut colours) = (Vec::new(), Vec::new());
        for (number, (index, start)) in (self.first..).zip(order) {
            let face = self.faces.get(index);
            let source = *sources.entry(face.source).or_insert(number);
            let outer = face.ring_ends[0];
            points.clear();
            points.extend_from_slice(face.points);
            points[..outer].rotate_left(start);
            colours.clear();
            colours.extend_from_slice(face.colours);
            if !colours.is_empty() {
                colours[..outer].rotate_left(start);
            }
            let values: Vec<(&str, &str)> =
                self.values[index].iter().map(|(column, json)| (&column[..], &json[..])).collect();
            each(&Face { number, source, points: &points, colours: &colours, ..face }, &values)?;
        }
        let last = self.numbers.len().checked_sub(1).map(|last| self.faces.get(last).source);
        self.last = last.map(|source| (source, sources[&source]));
        self.first += self.numbers.len() as u64;
        self.faces = FaceList::new(self.faces.grid().clone(), Vec::new());
        self.numbers.clear();
        self.values.clear();
        self.corners = 0;
        Ok(())
    }
}

/// Returns faces in an order in which each follows, where possible, a face that shares an edge with
/// it. Also returns the vertex at which its outer ring begins: the first one of that edge.
///
/// Faces around a vertex follow each other, as in the traversals of mesh compression (Edgebreaker,
/// J. Rossignac 1999).
fn connected_order(faces: &FaceList) -> Vec<(usize, usize)> {
    let mut vertices: HashMap<[i32; 3], u32, Hasher> = HashMap::default();
    // For each edge, a face and the index of the edge's first vertex in its outer ring.
    let mut edges: HashMap<[u32; 2], (usize, usize), Hasher> = HashMap::default();
    // Vertices of all outer rings, and where each ring starts.
    let (mut corners, mut starts): (Vec<u32>, Vec<usize>) = (Vec::new(), vec![0]);
    for number in 0..faces.len() as usize {
        let (face, first) = (faces.get(number), corners.len());
        for point in &face.points[..face.ring_ends[0]] {
            let next = vertices.len() as u32;
            corners.push(*vertices.entry(*point).or_insert(next));
        }
        let ring = &corners[first..];
        let next = ring.iter().cycle().skip(1);
        edges.extend(ring.iter().zip(next).enumerate().map(|(at, (from, to))| ([*from, *to], (number, at))));
        starts.push(corners.len());
    }
    let count = starts.len() - 1;
    let mut is_done = vec![false; count];
    let mut order = Vec::with_capacity(count);
    // Edges whose other face may follow, the next one last.
    let mut gates: Vec<[u32; 2]> = Vec::new();
    for first in 0..count {
        let mut next = Some((first, 0)).filter(|_| !is_done[first]);
        while let Some((face, start)) = next {
            is_done[face] = true;
            order.push((face, start));
            let ring = &corners[starts[face]..starts[face + 1]];
            let at = |index: usize| ring[(start + index) % ring.len()];
            // (The first edge is the one between this face and the one before.)
            gates.extend((1..ring.len()).map(|index| [at(index + 1), at(index)]));
            next = None;
            while next.is_none()
                && let Some(gate) = gates.pop()
            {
                next = edges.get(&gate).copied().filter(|(face, _)| !is_done[*face]);
            }
        }
    }
    order
}

/// Appends a face with its values.
pub(crate) fn write_face(face: &Face<'_>, values: &[(&str, &str)], item: &mut Vec<u8>) {
    item.extend_from_slice(&face.number.to_le_bytes());
    item.extend_from_slice(&face.source.to_le_bytes());
    let mut word = |word: u32| item.extend_from_slice(&word.to_le_bytes());
    word(face.part);
    [face.ring_ends.len(), face.points.len(), face.colours.len(), values.len()]
        .iter()
        .for_each(|count| word(*count as u32));
    face.ring_ends.iter().for_each(|end| word(*end as u32));
    face.points.as_flattened().iter().for_each(|at| word(*at as u32));
    item.extend_from_slice(face.colours.as_flattened());
    for text in values.iter().flat_map(|(column, json)| [column, json]) {
        item.extend_from_slice(&(text.len() as u32).to_le_bytes());
        item.extend_from_slice(text.as_bytes());
    }
}

/// A face that is read, with its values.
#[derive(Default)]
pub(crate) struct StoredFace {
    number: u64,
    source: u64,
    part: u32,
    ring_ends: Vec<usize>,
    points: Vec<[i32; 3]>,
    colours: Vec<[u8; 3]>,
    pub(crate) values: ColumnValues,
}

impl StoredFace {
    pub(crate) fn face(&self) -> Face<'_> {
        let StoredFace { number, source, part, ring_ends, points, colours, .. } = self;
        Face { number: *number, points, ring_ends, colours, part: *part, source: *source }
    }

    /// Reads a face that [`write_face`] wrote.
    pub(crate) fn read(&mut self, mut item: &[u8]) {
        let StoredFace { number, source, part, ring_ends, points, colours, values } = self;
        let mut take = |count: usize| item.split_off(..count).expect("the item that was written");
        let long = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().expect("eight bytes"));
        let word = |bytes: &[u8]| u32::from_le_bytes(bytes.try_into().expect("four bytes"));
        (*number, *source, *part) = (long(take(8)), long(take(8)), word(take(4)));
        let [ring_count, point_count, colour_count, count] = [0; 4].map(|_| word(take(4)) as usize);
        ring_ends.clear();
        ring_ends.extend((0..ring_count).map(|_| word(take(4)) as usize));
        points.clear();
        points.extend((0..point_count).map(|_| [0; 3].map(|_| word(take(4)) as i32)));
        colours.clear();
        colours.extend((0..colour_count).map(|_| <[u8; 3]>::try_from(take(3)).expect("three bytes")));
        let mut text = || {
            let length = word(take(4)) as usize;
            String::from_utf8_lossy(take(length)).into_owned()
        };
        values.clear();
        values.extend((0..count).map(|_| (text(), text())));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number, source, vertices and values of a face.
    type Found = (u64, u64, Vec<[i32; 3]>, Vec<String>);

    fn sorted(count: i32, memory: u64) -> Vec<Found> {
        let grid = Grid::over([[0.0; 3], [4096.0; 3]], Some(1.0)).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let mut sorter = FaceSorter::new(&grid, directory.path(), memory);
        // A terrain of squares in a scattered order, each of two triangles with one source.
        let mut number = 0;
        for square in 0..count {
            let square = square * 37 % count;
            let [x, y] = [square % 64, square / 64];
            for corners in [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]] {
                let points = corners.map(|[right, up]| [x + right, y + up, (x + right) * (y + up) % 5]);
                let face = Face {
                    number,
                    points: &points,
                    ring_ends: &[3],
                    colours: &[[x as u8, y as u8, 0]; 3],
                    part: 0,
                    source: square as u64 + 7,
                };
                number += 1;
                sorter.push(&face, &[("square", &square.to_string())]).unwrap();
            }
        }
        let mut found = Vec::new();
        let each = &mut |face: &Face<'_>, values: &[(&str, &str)]| {
            assert_eq!(
                face.colours,
                &[[
                    (face.points.iter().map(|at| at[0]).min().unwrap()) as u8,
                    (face.points.iter().map(|at| at[1]).min().unwrap()) as u8,
                    0
                ]; 3]
            );
            let values = values.iter().map(|(column, json)| format!("{column} {json}")).collect();
            found.push((face.number, face.source, face.points.to_vec(), values));
            Ok(())
        };
        sorter.finish(each).unwrap();
        found
    }

    #[test]
    fn close_faces_are_close_in_the_file() {
        let found = sorted(64 * 64, 1 << 20);
        assert_eq!(found, sorted(64 * 64, 0), "the order depends on the memory");
        assert_eq!(found.len(), 2 * 64 * 64);
        for (index, (number, source, points, values)) in found.iter().enumerate() {
            assert_eq!(*number, index as u64);
            // Both triangles of a square have the number of the first as their source.
            let other = &found[*source as usize];
            assert!(other.1 == *source && *source <= *number && other.3 == *values);
            // Most faces share an edge with the one before, which is the first edge of the ring.
            assert_eq!(points.len(), 3);
        }
        let follows = |pair: &[Found]| pair[1].2[..2].iter().all(|point| pair[0].2.contains(point));
        let count = found.windows(2).filter(|pair| follows(pair)).count();
        assert!(count > 6000, "{count} of 8191 faces follow a neighbour");
        let vertices = |block: &[Found]| {
            let mut points: Vec<[i32; 3]> = block.iter().flat_map(|face| face.2.clone()).collect();
            points.sort_unstable();
            points.dedup();
            points.len()
        };
        assert!(found.chunks(1024).all(|block| vertices(block) < 700));
    }

    #[test]
    fn a_single_block_is_not_changed() {
        let found = sorted(500, 0);
        assert!(found.iter().enumerate().all(|(index, face)| face.0 == index as u64));
        assert_eq!(found[2].3, ["square 37"]);
        assert_eq!(found[3].1, 2);
        assert_eq!(found[3].2[0], [37, 0, 0]);
    }
}
