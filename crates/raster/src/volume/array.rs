//! Three-dimensional arrays in files, read in cubes.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use crate::import::SampleFormat;
use spinney_base::io::platform::read_exact_at;
use spinney_base::space::{Bounds, Dimension};
use spinney_base::value::ValueType;
use spinney_base::{Error, Result};
use spinney_engine::store::{Slab, SlabBoxes, Slabs, WantedCells};

/// Cells per side of the largest cubes that are read at once: enough work for all threads.
const MOST: u64 = 256;

/// Layout of the samples of an array in a file: the samples of a cell together, x fastest, then y,
/// then z.
#[derive(Clone, Copy, Debug)]
pub(super) struct ArrayLayout {
    /// Cells along x, y and z.
    pub(super) size: [u64; 3],
    pub(super) format: SampleFormat,
    pub(super) channels: u8,
    pub(super) is_big_endian: bool,
}

impl ArrayLayout {
    /// Type of the tree's values.
    pub(super) fn value(&self) -> ValueType {
        ValueType::new(self.format.sample(), self.channels)
    }

    /// Bytes of all samples; `None` if they exceed the maximum file size.
    pub(super) fn bytes(&self) -> Option<u64> {
        self.size
            .into_iter()
            .try_fold(self.cell() as u64, u64::checked_mul)
            .filter(|bytes| *bytes <= i64::MAX as u64)
    }

    /// Bytes of a cell in the file.
    pub(super) fn cell(&self) -> usize {
        self.format.bits() / 8 * usize::from(self.channels)
    }

    /// Fails if trees do not support such cells, or the array is empty.
    pub(super) fn check(&self, path: &Path) -> Result<()> {
        if !self.value().is_supported() {
            let found = format!("an array of {} channels of {}", self.channels, self.format.name());
            let advice =
                "several channels must be unsigned integers of 1 or 2 bytes, or floats of 2 or 4 bytes";
            return Err(Error::unsupported(path, found, advice));
        }
        let [x, y, z] = self.size;
        if self.size.contains(&0) {
            let found = format!("an empty array of {x} x {y} x {z}");
            return Err(Error::unsupported(path, found, "volumes have at least one cell"));
        }
        Ok(())
    }
}

/// An array in a file that has all samples, or those of a box.
pub(super) struct Array {
    path: PathBuf,
    file: File,
    layout: ArrayLayout,
    /// Bytes before the samples.
    start: u64,
    /// The box of cells that the file has.
    cells: Bounds,
}

impl Array {
    /// An array whose samples begin at byte `start` of a file.
    pub(super) fn new(path: &Path, file: File, layout: ArrayLayout, start: u64) -> Array {
        let cells = Bounds::of_extent(layout.size);
        Array { path: path.to_path_buf(), file, layout, start, cells }
    }

    /// An array of which a file has only the samples of a box.
    pub(super) fn of_box(path: &Path, file: File, layout: ArrayLayout, cells: Bounds) -> Array {
        Array { path: path.to_path_buf(), file, layout, start: 0, cells }
    }

    /// Yields the wanted cells in cubes, so small that two of them fit `memory` bytes if possible.
    pub(super) fn slabs(self, wanted: WantedCells, memory: u64) -> ArraySlabs {
        let mut side = MOST;
        while side > SlabBoxes::least_side(Dimension::Oct)
            && 2 * side.pow(3) * self.layout.value().size() as u64 > memory
        {
            side /= 2;
        }
        let cubes = SlabBoxes::new(self.layout.size, wanted, side);
        ArraySlabs { array: self, cubes, stored: Vec::new() }
    }

    /// Reads the samples of a box into `bytes`; `stored` is a buffer for the file's representation.
    fn read(&self, first: [u64; 3], size: [u64; 3], stored: &mut Vec<u8>, bytes: &mut Vec<u8>) -> Result<()> {
        let ArrayLayout { format, is_big_endian, .. } = self.layout;
        let [width, height, _] = self.cells.size();
        let first: [u64; 3] = std::array::from_fn(|axis| first[axis] - self.cells.min[axis]);
        let (value, cell) = (self.layout.value().size(), self.layout.cell());
        let sample = format.bits() / 8;
        // Rows that are contiguous in the file are read at once.
        let rows = if size[0] == width { size[1] } else { 1 };
        let run = (rows * size[0]) as usize;
        stored.resize(run * cell, 0);
        bytes.resize(size.iter().product::<u64>() as usize * value, 0);
        let parts = bytes.chunks_exact_mut(run * value);
        for (row, part) in (0..).step_by(rows as usize).zip(parts) {
            let (y, z) = (first[1] + row % size[1], first[2] + row / size[1]);
            let at = self.start + ((z * height + y) * width + first[0]) * cell as u64;
            read_exact_at(&self.file, stored, at).map_err(|error| match error.kind() {
                io::ErrorKind::UnexpectedEof => {
                    let expected = format!("samples to byte {}", at + stored.len() as u64);
                    Error::corrupt(&self.path, "the samples", "the end of the file", expected)
                }
                _ => Error::io(&self.path, "read")(error),
            })?;
            if is_big_endian {
                stored.chunks_exact_mut(sample).for_each(<[u8]>::reverse);
            }
            format.widen(stored, 0, part);
        }
        Ok(())
    }
}

/// An array in cubes, in FD order, so that subtrees are completed early.
pub(super) struct ArraySlabs {
    array: Array,
    cubes: SlabBoxes,
    /// Buffer for the file's representation of contiguous rows.
    stored: Vec<u8>,
}

impl Slabs for ArraySlabs {
    fn extent(&self) -> [u64; 3] {
        self.array.layout.size
    }

    fn are_in_order(&self) -> bool {
        true
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        let Some((origin, size)) = self.cubes.next() else { return Ok(false) };
        (slab.origin, slab.size) = (origin, size);
        self.array.read(origin, size, &mut self.stored, &mut slab.bytes)?;
        Ok(true)
    }
}
