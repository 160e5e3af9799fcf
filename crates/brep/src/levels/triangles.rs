//! Triangles of surfaces while levels are made, in a temporary file.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use spinney_base::io::platform::read_exact_at;
use spinney_base::{Error, Result};

/// A triangle in grid coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Triangle {
    pub(crate) points: [[i32; 3]; 3],
    pub(crate) colours: [[u8; 3]; 3],
    pub(crate) part: u32,
}

/// Bytes of a triangle.
pub(super) const TRIANGLE: usize = 36 + 9 + 4;

impl Triangle {
    /// Returns the sum of its vertices: three times its centroid.
    pub(super) fn centre(&self) -> [i64; 3] {
        [0, 1, 2].map(|axis| self.points.iter().map(|point| i64::from(point[axis])).sum())
    }

    pub(super) fn write(&self, bytes: &mut Vec<u8>) {
        self.points.as_flattened().iter().for_each(|at| bytes.extend_from_slice(&at.to_le_bytes()));
        bytes.extend_from_slice(self.colours.as_flattened());
        bytes.extend_from_slice(&self.part.to_le_bytes());
    }

    pub(super) fn read(bytes: &[u8]) -> Triangle {
        let four = |at: usize| <[u8; 4]>::try_from(&bytes[at..at + 4]).expect("four bytes");
        let point = |at: usize| [0, 4, 8].map(|axis| i32::from_le_bytes(four(at + axis)));
        Triangle {
            points: [0, 12, 24].map(point),
            colours: [36, 39, 42].map(|at| [bytes[at], bytes[at + 1], bytes[at + 2]]),
            part: u32::from_le_bytes(four(45)),
        }
    }
}

/// An append-only temporary file of triangles.
pub(super) struct TriangleFile {
    out: BufWriter<File>,
    directory: PathBuf,
    len: u64,
}

impl TriangleFile {
    pub(super) fn create(directory: &Path) -> Result<TriangleFile> {
        let file =
            tempfile::tempfile_in(directory).map_err(Error::io(directory, "create a temporary file"))?;
        let out = BufWriter::with_capacity(1 << 18, file);
        Ok(TriangleFile { out, directory: directory.to_path_buf(), len: 0 })
    }

    /// Appends triangles; returns the number of the first one.
    pub(super) fn push(&mut self, triangles: &[Triangle]) -> Result<u64> {
        let mut bytes = Vec::with_capacity(TRIANGLE * triangles.len());
        triangles.iter().for_each(|triangle| triangle.write(&mut bytes));
        self.out.write_all(&bytes).map_err(Error::io(&self.directory, "write a temporary file"))?;
        let first = self.len;
        self.len += triangles.len() as u64;
        Ok(first)
    }

    /// Makes all appended triangles readable.
    pub(super) fn flush(&mut self) -> Result<()> {
        self.out.flush().map_err(Error::io(&self.directory, "write a temporary file"))
    }

    /// Reads triangles that were flushed.
    pub(super) fn read(&self, first: u64, count: u32, into: &mut Vec<Triangle>) -> Result<()> {
        let mut bytes = vec![0; TRIANGLE * count as usize];
        read_exact_at(self.out.get_ref(), &mut bytes, first * TRIANGLE as u64)
            .map_err(Error::io(&self.directory, "read a temporary file"))?;
        into.extend(bytes.chunks_exact(TRIANGLE).map(Triangle::read));
        Ok(())
    }
}
