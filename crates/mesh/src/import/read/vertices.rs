//! Storage of vertices while faces are read: in memory, in a mapped temporary file, or in the model's own
//! file.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use spinney_base::io::{Mapped, ReadBackend};
use spinney_base::{Error, Result};

/// Encoding of coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coordinates {
    F32,
    F64,
    F32Big,
    F64Big,
}

/// Layout of vertices in bytes.
#[derive(Clone, Copy, Debug)]
pub(super) struct VertexLayout {
    /// Bytes from one vertex to the next.
    pub(super) stride: usize,
    pub(super) coordinates: Coordinates,
    /// Offsets of x, y and z in a vertex.
    pub(super) position: [usize; 3],
    /// Offsets of red, green and blue in a vertex, a byte each.
    pub(super) colour: Option<[usize; 3]>,
}

impl VertexLayout {
    /// Layout without gaps, as [`Vertices`] keeps them.
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

/// Vertices that can be looked up by number.
#[derive(Clone, Copy)]
pub(super) struct Table<'a> {
    bytes: &'a [u8],
    layout: VertexLayout,
    count: u64,
}

impl<'a> Table<'a> {
    /// The vertices in some bytes, as many as there are whole ones.
    pub(super) fn new(bytes: &'a [u8], layout: VertexLayout) -> Table<'a> {
        Table { bytes, layout, count: (bytes.len() / layout.stride) as u64 }
    }

    pub(super) fn len(&self) -> u64 {
        self.count
    }

    pub(super) fn is_coloured(&self) -> bool {
        self.layout.colour.is_some()
    }

    /// Coordinates of a vertex; the number must be less than the length.
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

    /// A vertex's colour, if vertices have any; the number must be less than the length.
    #[inline]
    pub(super) fn colour(&self, number: u64) -> Option<[u8; 3]> {
        let vertex = &self.bytes[number as usize * self.layout.stride..][..self.layout.stride];
        self.layout.colour.map(|at| at.map(|at| vertex[at]))
    }
}

/// The box around points.
#[derive(Clone, Copy, Debug)]
pub(super) struct VertexBounds([[f64; 3]; 2]);

impl VertexBounds {
    pub(super) fn new() -> VertexBounds {
        VertexBounds([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]])
    }

    /// Makes the box hold a point, too.
    #[inline]
    pub(super) fn add(&mut self, point: [f64; 3]) {
        let [least, most] = self.0;
        self.0 = [
            [0, 1, 2].map(|axis| least[axis].min(point[axis])),
            [0, 1, 2].map(|axis| most[axis].max(point[axis])),
        ];
    }

    /// Least and greatest coordinates, if there was any point.
    pub(super) fn get(&self) -> Option<[[f64; 3]; 2]> {
        (self.0[0][0] <= self.0[1][0]).then_some(self.0)
    }
}

/// Vertices in the order in which a file has them.
pub(super) struct Vertices {
    storage: Storage,
    layout: VertexLayout,
}

enum Storage {
    Memory(Vec<u8>),
    Disk(Mapped),
}

impl Vertices {
    pub(super) fn table(&self) -> Table<'_> {
        let bytes = match &self.storage {
            Storage::Memory(bytes) => bytes,
            Storage::Disk(map) => map.bytes().unwrap_or_default(),
        };
        Table::new(bytes, self.layout)
    }
}

/// Collects [`Vertices`].
pub(super) struct VerticesBuilder {
    layout: VertexLayout,
    /// Vertices that are not on disk yet.
    bytes: Vec<u8>,
    /// Bytes to keep in memory.
    budget: usize,
    file: Option<File>,
    /// The model's file, for messages.
    path: PathBuf,
}

/// Bytes written to disk at once.
const CHUNK: usize = 1 << 20;

impl VerticesBuilder {
    /// A builder for vertices that are kept in about `memory` bytes, or else on disk.
    ///
    /// Coordinates must be one of the little-endian kinds.
    pub(super) fn new(path: &Path, coordinates: Coordinates, is_coloured: bool, memory: u64) -> Self {
        let layout = VertexLayout::packed(coordinates, is_coloured);
        let budget = usize::try_from(memory).unwrap_or(usize::MAX).max(CHUNK);
        VerticesBuilder { layout, bytes: Vec::new(), budget, file: None, path: path.to_path_buf() }
    }

    /// Adds a vertex. The colour counts only if the vertices are coloured.
    #[inline]
    pub(super) fn push(&mut self, point: [f64; 3], colour: [u8; 3]) -> Result<()> {
        if self.bytes.capacity() - self.bytes.len() < self.layout.stride {
            self.make_room().map_err(Error::io(&self.path, "use a temporary file for the vertices"))?;
        }
        for coordinate in point {
            match self.layout.coordinates {
                Coordinates::F32 => self.bytes.extend_from_slice(&(coordinate as f32).to_le_bytes()),
                Coordinates::F64 => self.bytes.extend_from_slice(&coordinate.to_le_bytes()),
                Coordinates::F32Big | Coordinates::F64Big => unreachable!("kept little-endian"),
            }
        }
        if self.layout.colour.is_some() {
            self.bytes.extend_from_slice(&colour);
        }
        Ok(())
    }

    /// Room grows with what really comes, twofold until the budget is used up.
    fn make_room(&mut self) -> io::Result<()> {
        let held = self.bytes.len();
        if self.file.is_none() && held + self.layout.stride < self.budget {
            self.bytes.reserve_exact(held.max(4096).min(self.budget - held));
            return Ok(());
        }
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(tempfile::tempfile()?),
        };
        file.write_all(&self.bytes)?;
        self.bytes.clear();
        if self.bytes.capacity() > 2 * CHUNK {
            self.bytes = Vec::with_capacity(CHUNK);
        }
        Ok(())
    }

    pub(super) fn finish(mut self) -> Result<Vertices> {
        let Some(mut file) = self.file.take() else {
            return Ok(Vertices { storage: Storage::Memory(self.bytes), layout: self.layout });
        };
        let failed = Error::io(&self.path, "use a temporary file for the vertices");
        file.write_all(&self.bytes).map_err(failed)?;
        // Nobody else can reach the file: it has no name.
        Ok(Vertices { storage: Storage::Disk(Mapped::of(&file, &self.path)?), layout: self.layout })
    }
}
