//! Temporary file for samples that can only be read sequentially. It holds the samples of a box,
//! for random access.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::array::{Array, ArrayLayout};
use spinney_base::space::Bounds;
use spinney_base::{Error, Result};

/// Writes the samples of a box of an array to an unnamed temporary file.
pub(super) struct BoxSpill {
    out: BufWriter<File>,
    directory: PathBuf,
    layout: ArrayLayout,
    cells: Bounds,
    /// Bytes of a plane, or of a row if the box has no whole rows, and the wanted range of these.
    part: u64,
    inside: Range<u64>,
}

impl BoxSpill {
    /// Starts a file in a directory, for a box of an array whose size in bytes is known to fit a
    /// file.
    pub(super) fn new(layout: ArrayLayout, cells: Bounds, directory: &Path) -> Result<BoxSpill> {
        let out = BufWriter::new(tempfile::tempfile_in(directory).map_err(failed(directory))?);
        let row = layout.size[0] * layout.cell() as u64;
        let (part, axis, step) = match cells.size()[0] == layout.size[0] {
            true => (row * layout.size[1], 1, row),
            false => (row, 0, layout.cell() as u64),
        };
        let inside = cells.min[axis] * step..cells.max[axis] * step;
        Ok(BoxSpill { out, directory: directory.to_path_buf(), layout, cells, part, inside })
    }

    /// Consumes the next bytes of the array; `at` is the index of the first one.
    pub(super) fn write(&mut self, mut at: u64, mut bytes: &[u8]) -> Result<()> {
        while !bytes.is_empty() {
            let (number, from) = (at / self.part, at % self.part);
            let count = (self.part - from).min(bytes.len() as u64);
            let [start, end] =
                [self.inside.start, self.inside.end].map(|end| end.clamp(from, from + count) - from);
            if start < end && self.has_part(number) {
                let wanted = &bytes[start as usize..end as usize];
                self.out.write_all(wanted).map_err(failed(&self.directory))?;
            }
            (at, bytes) = (at + count, &bytes[count as usize..]);
        }
        Ok(())
    }

    /// Whether the box intersects a plane or row.
    fn has_part(&self, number: u64) -> bool {
        let [_, height, _] = self.layout.size;
        let is_in = |axis: usize, at: u64| (self.cells.min[axis]..self.cells.max[axis]).contains(&at);
        match self.cells.size()[0] == self.layout.size[0] {
            true => is_in(2, number),
            false => is_in(1, number % height) && is_in(2, number / height),
        }
    }

    /// The end of the box: no byte of the array after it is needed.
    pub(super) fn end(&self) -> u64 {
        let [width, height, _] = self.layout.size;
        match self.cells.is_empty() {
            true => 0,
            false => {
                let [x, y, z] = self.cells.max.map(|end| end - 1);
                (((z * height + y) * width + x) + 1) * self.layout.cell() as u64
            }
        }
    }

    /// Returns the box as an array; `path` names the original file in messages.
    pub(super) fn finish(self, path: &Path) -> Result<Array> {
        let file = self.out.into_inner().map_err(|error| failed(&self.directory)(error.into_error()))?;
        Ok(Array::of_box(path, file, self.layout, self.cells))
    }
}

fn failed(directory: &Path) -> impl FnOnce(std::io::Error) -> Error {
    Error::io(directory, "use a temporary file for the volume")
}
