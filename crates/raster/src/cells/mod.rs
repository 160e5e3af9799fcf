//! Lists of single cells with their values: text, or NumPy arrays.

mod npy;
mod text;

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_container::Header;
use spinney_engine::ops::CellValue;
use spinney_records::npy::MAGIC;

/// A list of cells, read some at a time.
pub struct CellList {
    rows: Box<dyn Iterator<Item = Result<CellValue>>>,
}

/// Cells that are handed out at a time: about 100 MiB of them.
const BATCH: usize = 1 << 20;

impl CellList {
    /// Opens a list for a tree: text with a line `X,Y,VALUE` (octrees: `X,Y,Z,VALUE`; several channels:
    /// several values; `void` instead of values) per cell, or a NumPy array whose rows have these numbers.
    /// `-` is text from standard input.
    ///
    /// # Errors
    /// If it cannot be read, or an array has another shape.
    pub fn open(path: &Path, header: &Header) -> Result<CellList> {
        let (axes, channels) = (header.form.axes(), usize::from(header.form.value.channels));
        if path == Path::new("-") {
            return Ok(CellList { rows: Box::new(text::rows(io::stdin().lock(), path, axes, channels)) });
        }
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        let mut file = BufReader::with_capacity(1 << 20, file);
        let start = file.fill_buf().map_err(Error::io(path, "read"))?;
        let is_array = start.starts_with(MAGIC);
        let rows: Box<dyn Iterator<Item = Result<CellValue>>> = if is_array {
            Box::new(npy::rows(file, path, axes, channels)?)
        } else {
            Box::new(text::rows(file, path, axes, channels))
        };
        Ok(CellList { rows })
    }
}

/// Batches of cells.
impl Iterator for CellList {
    type Item = Result<Vec<CellValue>>;

    fn next(&mut self) -> Option<Self::Item> {
        let batch: Result<Vec<CellValue>> = self.rows.by_ref().take(BATCH).collect();
        match batch {
            Ok(batch) if batch.is_empty() => None,
            batch => Some(batch),
        }
    }
}

/// A cell's coordinate, if it is one: below the end of the largest trees.
fn coordinate(number: f64) -> Option<u64> {
    let most = 1u64 << Dimension::Quad.max_depth();
    (number.fract() == 0.0 && (0.0..most as f64).contains(&number)).then_some(number as u64)
}
