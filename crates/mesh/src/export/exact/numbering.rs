//! Numbering of vertices: corners of faces with equal coordinates share one vertex.
//!
//! A first sort orders the corners by their points and assigns the numbers. A second sort orders
//! the numbers by corner index. Both sorts spill to disk if they exceed memory.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::Job;
use spinney_base::io::Sorter;
use spinney_base::{Error, Result, sort};

/// Bytes of memory for each of the two sorts.
const MEMORY: u64 = 64 << 20;

/// Bytes of a corner in the sort: point, colour and corner index.
const CORNER: usize = 12 + 3 + 8;

/// Bits of the sort key per axis. Points with equal keys are close together and are sorted in
/// memory.
const KEY_BITS: u8 = 21;

/// Vertex: a grid point, and its colour if vertices have colours.
pub(super) type Vertex = ([i32; 3], [u8; 3]);

/// Vertex numbers of all corners, in the order of faces.
pub(super) struct CornerNumbers {
    path: PathBuf,
    file: BufReader<File>,
    /// Number of vertices.
    pub(super) vertices: u64,
}

impl CornerNumbers {
    /// Numbers the vertices and passes them to `each` in the order of their numbers. With colours,
    /// vertices of different colours are distinct.
    pub(super) fn of(
        job: &Job<'_>,
        with_colours: bool,
        directory: &Path,
        each: &mut dyn FnMut(Vertex) -> Result<()>,
    ) -> Result<CornerNumbers> {
        let shift = job.faces.grid().bits.saturating_sub(KEY_BITS);
        let mut corners = Sorter::new(directory, MEMORY);
        let mut place = 0u64;
        job.each(&mut |face| {
            for (index, point) in face.points.iter().enumerate() {
                let colour = if with_colours { face.colours.get(index) } else { None };
                let corner = Corner { vertex: (*point, colour.copied().unwrap_or_default()), place };
                corners.push(corner.key(shift), &corner.to_bytes())?;
                place += 1;
            }
            Ok(())
        })?;
        let mut numbers = Sorter::new(directory, MEMORY);
        let mut vertices = 0u64;
        let mut near: Vec<Corner> = Vec::new();
        let mut flush = |near: &mut Vec<Corner>| -> Result<()> {
            sort::by(near, &mut |a, b| (a.vertex, a.place).cmp(&(b.vertex, b.place)));
            for same in near.chunk_by(|a, b| a.vertex == b.vertex) {
                each(same[0].vertex)?;
                for corner in same {
                    numbers.push(corner.place, &vertices.to_le_bytes())?;
                }
                vertices += 1;
            }
            near.clear();
            Ok(())
        };
        let mut count = 0u64;
        corners.finish(&mut |bytes| {
            count += 1;
            if count.is_multiple_of(1 << 14) {
                job.progress.check()?;
            }
            let corner = Corner::of_bytes(bytes);
            if near.last().is_some_and(|last| last.key(shift) != corner.key(shift)) {
                flush(&mut near)?;
            }
            near.push(corner);
            Ok(())
        })?;
        flush(&mut near)?;
        let file = write_numbers(numbers, directory, job)?;
        Ok(CornerNumbers { path: directory.to_path_buf(), file, vertices })
    }

    /// Reads the vertex numbers of the next `count` corners.
    pub(super) fn next(&mut self, count: usize, out: &mut Vec<u64>) -> Result<()> {
        out.clear();
        for _ in 0..count {
            let mut bytes = [0; 8];
            let failed = Error::io(&self.path, "read a temporary file");
            self.file.read_exact(&mut bytes).map_err(failed)?;
            out.push(u64::from_le_bytes(bytes));
        }
        Ok(())
    }
}

/// Writes the numbers in the order of corners to a temporary file.
fn write_numbers(numbers: Sorter, directory: &Path, job: &Job<'_>) -> Result<BufReader<File>> {
    let failed = || Error::io(directory, "use a temporary file");
    let mut out = BufWriter::with_capacity(1 << 16, tempfile::tempfile_in(directory).map_err(failed())?);
    let mut count = 0u64;
    numbers.finish(&mut |bytes| {
        count += 1;
        if count.is_multiple_of(1 << 14) {
            job.progress.check()?;
        }
        out.write_all(bytes).map_err(failed())
    })?;
    let mut file = out.into_inner().map_err(io::IntoInnerError::into_error).map_err(failed())?;
    file.seek(SeekFrom::Start(0)).map_err(failed())?;
    Ok(BufReader::with_capacity(1 << 16, file))
}

/// Corner of a face, as a sort item.
struct Corner {
    vertex: Vertex,
    /// Index of the corner among the corners of all faces.
    place: u64,
}

impl Corner {
    fn key(&self, shift: u8) -> u64 {
        let bits = |coordinate: i32| u64::from((coordinate >> shift) as u32) & ((1 << KEY_BITS) - 1);
        self.vertex.0.iter().fold(0, |key, coordinate| key << KEY_BITS | bits(*coordinate))
    }

    fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(CORNER);
        self.vertex.0.iter().for_each(|coordinate| bytes.extend(coordinate.to_le_bytes()));
        bytes.extend(self.vertex.1);
        bytes.extend(self.place.to_le_bytes());
        bytes
    }

    fn of_bytes(bytes: &[u8]) -> Corner {
        let four = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap_or_default());
        let place = u64::from_le_bytes(bytes[15..23].try_into().unwrap_or_default());
        Corner { vertex: ([four(0), four(4), four(8)], [bytes[12], bytes[13], bytes[14]]), place }
    }
}
