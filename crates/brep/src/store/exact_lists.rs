//! The lists of a block of faces with off-grid vertices, with planes and vertices as they are
//! stored.

use std::collections::HashMap;

use super::exact::{COLOURED, GRID_VERTEX, PARTS, WIDE};

/// The lists of a block.
pub(crate) struct ExactLists {
    /// Bytes of a normal component, an offset, a coordinate and a weight.
    pub(super) widths: [usize; 4],
    /// Planes, as they are stored.
    pub(super) planes: Vec<u8>,
    /// Vertices that are grid points, as they are stored.
    pub(super) grid_points: Vec<u8>,
    /// The other vertices, as they are stored.
    pub(super) vertices: Vec<u8>,
    /// Number of each face's plane.
    pub(super) face_planes: Vec<u32>,
    pub(super) parts: Vec<u32>,
    pub(super) sources: Vec<u64>,
    /// End of each face's rings.
    pub(super) face_ends: Vec<u32>,
    /// End of each ring's corners.
    pub(super) ring_ends: Vec<u32>,
    /// Vertex kind (on the grid or not), vertex number within its kind, and number of the edge's
    /// plane.
    pub(super) corners: Vec<(bool, u32, u32)>,
    pub(super) colours: Vec<u8>,
}

impl ExactLists {
    /// Returns the number of faces.
    pub(super) fn len(&self) -> usize {
        self.parts.len()
    }

    /// Returns the numbers of planes, of grid points, and of other vertices.
    fn counts(&self) -> [usize; 3] {
        let [normal, offset, coordinate, weight] = self.widths;
        let (planes, vertices) = (3 * normal + offset, 3 * coordinate + weight);
        [self.planes.len() / planes, self.grid_points.len() / GRID_VERTEX, self.vertices.len() / vertices]
    }

    /// Stores numbers with at least the given widths.
    fn widen(&mut self, widths: [usize; 4]) {
        let [normal, offset, coordinate, weight] = self.widths;
        let new = [0, 1, 2, 3].map(|index| self.widths[index].max(widths[index]));
        self.planes = widened(&self.planes, [normal, offset], [new[0], new[1]]);
        self.vertices = widened(&self.vertices, [coordinate, weight], [new[2], new[3]]);
        self.widths = new;
    }

    /// Appends the faces of another block. Planes and vertices with the same numbers are stored
    /// once.
    pub(super) fn append(&mut self, mut other: ExactLists) {
        self.widen(other.widths);
        other.widen(self.widths);
        let [normal, offset, coordinate, weight] = self.widths;
        let planes = joined(&mut self.planes, &other.planes, 3 * normal + offset);
        let grid_points = joined(&mut self.grid_points, &other.grid_points, GRID_VERTEX);
        let vertices = joined(&mut self.vertices, &other.vertices, 3 * coordinate + weight);
        let (rings, corners) = (self.ring_ends.len() as u32, self.corners.len() as u32);
        self.face_planes.extend(other.face_planes.iter().map(|plane| planes[*plane as usize]));
        self.face_ends.extend(other.face_ends.iter().map(|end| rings + end));
        self.ring_ends.extend(other.ring_ends.iter().map(|end| corners + end));
        self.corners.extend(other.corners.iter().map(|(is_on_grid, vertex, line)| {
            let new = if *is_on_grid { &grid_points } else { &vertices };
            (*is_on_grid, new[*vertex as usize], planes[*line as usize])
        }));
        self.parts.append(&mut other.parts);
        self.sources.append(&mut other.sources);
        self.colours.append(&mut other.colours);
    }

    /// Returns the bytes of the block. There must be a face.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let ExactLists { widths, planes, grid_points, vertices, parts, ring_ends, corners, .. } = self;
        let [planes_count, grid_count, vertices_count] = self.counts();
        let one_part = parts.iter().all(|part| *part == parts[0]);
        let is_wide = planes_count.max(grid_count + vertices_count) > 1 << 16;
        let flag = |is_set: bool, flag: u32| if is_set { flag } else { 0 };
        let flags = flag(!self.colours.is_empty(), COLOURED) | flag(is_wide, WIDE) | flag(!one_part, PARTS);
        let counts = [parts.len(), planes_count, grid_count, vertices_count, ring_ends.len(), corners.len()];
        let mut bytes = Vec::new();
        counts.into_iter().for_each(|count| bytes.extend_from_slice(&(count as u32).to_le_bytes()));
        bytes.extend_from_slice(&flags.to_le_bytes());
        bytes.extend(widths.map(|width| width as u8));
        [planes, grid_points, vertices].into_iter().for_each(|list| bytes.extend_from_slice(list));
        let number = |bytes: &mut Vec<u8>, number: u32| match is_wide {
            true => bytes.extend_from_slice(&number.to_le_bytes()),
            false => bytes.extend_from_slice(&(number as u16).to_le_bytes()),
        };
        self.face_planes.iter().for_each(|plane| number(&mut bytes, *plane));
        let parts = &parts[..if one_part { 1 } else { parts.len() }];
        parts.iter().for_each(|part| bytes.extend_from_slice(&part.to_le_bytes()));
        self.sources.iter().for_each(|source| bytes.extend_from_slice(&source.to_le_bytes()));
        let ends = self.face_ends.iter().chain(ring_ends);
        ends.for_each(|end| bytes.extend_from_slice(&end.to_le_bytes()));
        for (is_on_grid, vertex, line) in corners {
            number(&mut bytes, if *is_on_grid { *vertex } else { grid_count as u32 + vertex });
            number(&mut bytes, *line);
        }
        bytes.extend_from_slice(&self.colours);
        bytes
    }
}

/// Returns entries of three numbers of one width and one of another, with other widths that are not
/// less.
fn widened(bytes: &[u8], [three, one]: [usize; 2], new: [usize; 2]) -> Vec<u8> {
    if [three, one] == new {
        return bytes.to_vec();
    }
    let mut out = Vec::with_capacity(bytes.len() / (3 * three + one) * (3 * new[0] + new[1]));
    for entry in bytes.chunks_exact(3 * three + one) {
        let mut rest = entry;
        for (width, new) in [(three, new[0]), (three, new[0]), (three, new[0]), (one, new[1])] {
            let (number, others) = rest.split_at(width);
            rest = others;
            out.extend_from_slice(number);
            let sign = if number.last().is_some_and(|last| *last >= 0x80) { 0xff } else { 0 };
            out.resize(out.len() + new - width, sign);
        }
    }
    out
}

/// Appends the entries of another list that a list lacks; returns the numbers of all its entries in
/// the list.
fn joined(list: &mut Vec<u8>, other: &[u8], size: usize) -> Vec<u32> {
    let mut added = Vec::new();
    let mut known: HashMap<&[u8], u32> =
        (0..).zip(list.chunks_exact(size)).map(|(n, own)| (own, n)).collect();
    let mut next = (list.len() / size) as u32;
    let number = |entry| {
        *known.entry(entry).or_insert_with(|| {
            added.extend_from_slice(entry);
            next += 1;
            next - 1
        })
    };
    let numbers = other.chunks_exact(size).map(number).collect();
    list.append(&mut added);
    numbers
}
