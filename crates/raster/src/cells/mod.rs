//! Lists of single cells with their values, as text or NumPy arrays.

mod npy;
mod text;

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_container::{FIRST_BYTES, Header, OtherFormat};
use spinney_engine::ops::CellValue;
use spinney_records::npy::MAGIC;

/// A list of cells, read in batches.
pub struct CellList {
    rows: Box<dyn Iterator<Item = Result<CellValue>>>,
}

/// Cells per batch: about 100 MiB.
const BATCH: usize = 1 << 20;

impl CellList {
    /// Opens a list of cells for a tree. A list is text or a NumPy array. Text has one line per
    /// cell, `X,Y,VALUE`: `X,Y,Z,VALUE` for octrees, several values for several channels, `void`
    /// instead of the values of a VOID cell. Rows of an array have the same numbers. `-` is text
    /// from standard input.
    ///
    /// # Errors
    /// If the file cannot be read, or an array has another shape.
    pub fn open(path: &Path, header: &Header) -> Result<CellList> {
        let (axes, channels) = (header.form.axes(), usize::from(header.form.value.channels));
        if path == Path::new("-") {
            return Ok(CellList { rows: Box::new(text::rows(io::stdin().lock(), path, axes, channels)) });
        }
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        let mut file = BufReader::with_capacity(1 << 20, file);
        let start = file.fill_buf().map_err(Error::io(path, "read"))?;
        let is_array = start.starts_with(MAGIC);
        let first = &start[..start.len().min(FIRST_BYTES)];
        if !is_array
            && first.contains(&0)
            && let Some(error) = OtherFormat::refuse_content(path, first, "lines of text, or an NPY array")
        {
            return Err(error);
        }
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

/// Converts a number to a cell's coordinate, if it is an integer within the largest trees.
fn coordinate(number: f64) -> Option<u64> {
    let most = 1u64 << Dimension::Quad.max_depth();
    (number.fract() == 0.0 && (0.0..most as f64).contains(&number)).then_some(number as u64)
}
