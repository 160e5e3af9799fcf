//! Reader of LAS and LAZ files.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use laz::LasZipDecompressor;

use super::chunks::{check_chunks, corrupt, unpacking};
use super::header::LasHeader;
use crate::source::{PointSchema, PointSource, both_bounds, bounds_of};
use spinney_base::guard::guard;
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};

/// Reader of the points of a LAS or LAZ file, in file order.
pub struct LasReader {
    path: PathBuf,
    schema: PointSchema,
    points: Points,
    /// Number of points not yet read.
    left: u64,
}

enum Points {
    Plain(BufReader<File>),
    Packed(Box<LasZipDecompressor<'static, BufReader<File>>>),
}

impl LasReader {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be read, is no LAS or LAZ file, or is corrupt.
    pub fn open(path: &Path) -> Result<LasReader> {
        let (header, mut file) = LasHeader::read(path)?;
        let failed = || Error::io(path, "read");
        let start = u64::from(header.header.offset_to_point_data);
        file.seek(SeekFrom::Start(start)).map_err(failed())?;
        let points = match &header.laszip {
            None => Points::Plain(file),
            Some(record) => {
                let (record, is_chunked) = unpacking(path, header.layout.size, record)?;
                if is_chunked {
                    check_chunks(path, &mut file, (start, header.points), &record)?;
                }
                let reader = guard(path, "compressed points", || {
                    LasZipDecompressor::new(file, record).map_err(|error| corrupt(path, &error.to_string()))
                })?;
                Points::Packed(Box::new(reader))
            }
        };
        let (scale, offset) = header.scale_offset();
        let schema = PointSchema {
            bounds: header.bounds(),
            layout: header.layout,
            dimension: Dimension::Oct,
            scale,
            offset,
            count: Some(header.points),
            crs: header.crs,
            tags: header.tags,
            losses: header.losses,
        };
        Ok(LasReader { path: path.to_path_buf(), schema, points, left: header.points })
    }
}

impl PointSource for LasReader {
    fn schema(&self) -> &PointSchema {
        &self.schema
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn read(&mut self, rows: &mut Vec<u8>, most: usize) -> Result<usize> {
        let count = self.left.min(most as u64) as usize;
        let before = rows.len();
        rows.resize(before + count * self.schema.layout.size, 0);
        let path = &self.path;
        match &mut self.points {
            Points::Plain(file) => {
                file.read_exact(&mut rows[before..]).map_err(Error::io(path, "read points of"))?
            }
            Points::Packed(reader) => guard(path, "compressed points", || {
                reader.decompress_many(&mut rows[before..]).map_err(|error| corrupt(path, &error.to_string()))
            })?,
        }
        self.left -= count as u64;
        Ok(count)
    }

    fn survey(&mut self) -> Result<bool> {
        let mut all = LasReader::open(&self.path)?;
        let (mut bounds, mut rows) = (None, Vec::new());
        while all.read(&mut rows, 1 << 16)? > 0 {
            bounds = both_bounds(bounds, bounds_of(&rows, self.schema.layout.size));
            rows.clear();
        }
        *self = LasReader::open(&self.path)?;
        // An empty file has bounds of one position, so that there is a grid.
        self.schema.bounds = bounds.unwrap_or([[0; 3]; 2]);
        Ok(true)
    }
}
