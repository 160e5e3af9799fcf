//! Storage of vertices while faces are read: in memory, in a mapped temporary file, or in the
//! model's own file.

use std::path::Path;

use super::spill::{SpillBuffer, SpilledBytes};
use spinney_base::Result;

/// Encoding of coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coordinates {
    F32,
    F64,
    F32Big,
    F64Big,
}

/// Byte layout of vertices.
#[derive(Clone, Copy, Debug)]
pub(super) struct VertexLayout {
    /// Bytes from one vertex to the next.
    pub(super) stride: usize,
    pub(super) coordinates: Coordinates,
    /// Offsets of x, y and z in a vertex.
    pub(super) position: [usize; 3],
    /// Offsets of red, green and blue in a vertex, one byte each.
    pub(super) colour: Option<[usize; 3]>,
}

impl VertexLayout {
    /// Layout without gaps, as in [`Vertices`].
    pub(super) fn packed(coordinates: Coordinates, is_coloured: bool) -> VertexLayout {
        let size = match coordinates {
            Coordinates::F32 | Coordinates::F32Big => 4,
            Coordinates::F64 | Coordinates::F64Big => 8,
        };
        let position = [0, size, 2 * size];
        let end = 3 * size;
        let colour = is_coloured.then_some([end, end + 1, end + 2]);
        VertexLayout { stride: end + if is_coloured { 3 } else { 0 }, coordinates, position, colour }
    }
}

/// Vertices with random access by index.
#[derive(Clone, Copy)]
pub(super) struct Table<'a> {
    bytes: &'a [u8],
    layout: VertexLayout,
    count: u64,
}

impl<'a> Table<'a> {
    /// Complete vertices in a byte slice.
    pub(super) fn new(bytes: &'a [u8], layout: VertexLayout) -> Table<'a> {
        Table { bytes, layout, count: (bytes.len() / layout.stride) as u64 }
    }

    pub(super) fn len(&self) -> u64 {
        self.count
    }

    pub(super) fn is_coloured(&self) -> bool {
        self.layout.colour.is_some()
    }

    /// Coordinates of a vertex. Panics unless `number` is less than the length.
    #[inline]
    pub(super) fn position(&self, number: u64) -> [f64; 3] {
        let vertex = &self.bytes[number as usize * self.layout.stride..][..self.layout.stride];
        let four = |at: usize| [vertex[at], vertex[at + 1], vertex[at + 2], vertex[at + 3]];
        let eight = |at: usize| {
            let mut bytes = [0; 8];
            bytes.copy_from_slice(&vertex[at..at + 8]);
            bytes
        };
        let at = self.layout.position;
        match self.layout.coordinates {
            Coordinates::F32 => at.map(|at| f32::from_le_bytes(four(at)).into()),
            Coordinates::F64 => at.map(|at| f64::from_le_bytes(eight(at))),
            Coordinates::F32Big => at.map(|at| f32::from_be_bytes(four(at)).into()),
            Coordinates::F64Big => at.map(|at| f64::from_be_bytes(eight(at))),
        }
    }

    /// Colour of a vertex, if vertices have colours. Panics unless `number` is less than the
    /// length.
    #[inline]
    pub(super) fn colour(&self, number: u64) -> Option<[u8; 3]> {
        let vertex = &self.bytes[number as usize * self.layout.stride..][..self.layout.stride];
        self.layout.colour.map(|at| at.map(|at| vertex[at]))
    }
}

/// Bounding box of points.
#[derive(Clone, Copy, Debug)]
pub(super) struct VertexBounds([[f64; 3]; 2]);

impl VertexBounds {
    pub(super) fn new() -> VertexBounds {
        VertexBounds([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]])
    }

    /// Extends the box by a point.
    #[inline]
    pub(super) fn add(&mut self, point: [f64; 3]) {
        let [least, most] = self.0;
        self.0 = [
            [0, 1, 2].map(|axis| least[axis].min(point[axis])),
            [0, 1, 2].map(|axis| most[axis].max(point[axis])),
        ];
    }

    /// Minimum and maximum coordinates, if there was any point.
    pub(super) fn get(&self) -> Option<[[f64; 3]; 2]> {
        (self.0[0][0] <= self.0[1][0]).then_some(self.0)
    }
}

/// Vertices in file order.
pub(super) struct Vertices {
    bytes: SpilledBytes,
    layout: VertexLayout,
}

impl Vertices {
    pub(super) fn table(&self) -> Table<'_> {
        Table::new(self.bytes.bytes(), self.layout)
    }

    /// Returns these vertices without their colours.
    pub(super) fn without_colours(mut self) -> Vertices {
        self.layout.colour = None;
        self
    }
}

/// Collects [`Vertices`].
pub(super) struct VerticesBuilder {
    layout: VertexLayout,
    bytes: SpillBuffer,
}

impl VerticesBuilder {
    /// Creates a builder for vertices that use about `memory` bytes in memory and spill to disk
    /// beyond.
    ///
    /// `coordinates` must be little-endian.
    pub(super) fn new(path: &Path, coordinates: Coordinates, is_coloured: bool, memory: u64) -> Self {
        let layout = VertexLayout::packed(coordinates, is_coloured);
        VerticesBuilder { layout, bytes: SpillBuffer::new(path, memory) }
    }

    /// Adds a vertex. The colour is ignored unless vertices are coloured.
    #[inline]
    pub(super) fn push(&mut self, point: [f64; 3], colour: [u8; 3]) -> Result<()> {
        let mut vertex = [0; MAX_STRIDE];
        for (coordinate, at) in point.into_iter().zip(self.layout.position) {
            match self.layout.coordinates {
                Coordinates::F32 => vertex[at..][..4].copy_from_slice(&(coordinate as f32).to_le_bytes()),
                Coordinates::F64 => vertex[at..][..8].copy_from_slice(&coordinate.to_le_bytes()),
                Coordinates::F32Big | Coordinates::F64Big => unreachable!("kept little-endian"),
            }
        }
        for (channel, at) in colour.into_iter().zip(self.layout.colour.into_iter().flatten()) {
            vertex[at] = channel;
        }
        self.bytes.push(&vertex[..self.layout.stride])
    }

    pub(super) fn finish(self) -> Result<Vertices> {
        Ok(Vertices { bytes: self.bytes.finish()?, layout: self.layout })
    }
}

/// Bytes of a packed vertex with double-precision coordinates and a colour.
const MAX_STRIDE: usize = 27;
