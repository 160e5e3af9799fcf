//! Reads points of LAS and LAZ files.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use laz::{LasZipDecompressor, LazVlr};

use super::header::LasHeader;
use crate::source::{PointSchema, PointSource, both_bounds, bounds_of};
use spinney_base::guard::guard;
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};

/// The points of a LAS or LAZ file, in the order in which they stand there.
pub struct LasReader {
    path: PathBuf,
    schema: PointSchema,
    points: Points,
    /// Number of points that are left.
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
    /// If it cannot be read, is none, or is damaged.
    pub fn open(path: &Path) -> Result<LasReader> {
        let (header, mut file) = LasHeader::read(path)?;
        let failed = || Error::io(path, "read");
        let start = u64::from(header.header.offset_to_point_data);
        file.seek(SeekFrom::Start(start)).map_err(failed())?;
        let points = match &header.laszip {
            None => Points::Plain(file),
            Some(record) => {
                let record = unpacking(path, header.layout.size, record)?;
                check_chunks(path, &mut file, start)?;
                let reader = guard(path, "packed points", || {
                    LasZipDecompressor::new(file, record).map_err(|error| damaged(path, &error.to_string()))
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

/// How points are packed, by a record that must fit points of so many bytes.
fn unpacking(path: &Path, size: usize, record: &[u8]) -> Result<LazVlr> {
    let record = guard(path, "laszip record", || {
        LazVlr::from_buffer(record).map_err(|error| damaged(path, &error.to_string()))
    })?;
    if record.items_size() != size as u64 {
        return Err(damaged(path, &format!("items of {} bytes for points of {size}", record.items_size())));
    }
    if record.chunk_size() == 0 {
        return Err(damaged(path, "chunks of no points"));
    }
    Ok(record)
}

fn damaged(path: &Path, found: &str) -> Error {
    Error::corrupt(path, "packed points", found, "points that were packed by LASzip")
}

/// Checks the number of chunks, for which the decoder makes room before it has read them.
fn check_chunks(path: &Path, file: &mut BufReader<File>, start: u64) -> Result<()> {
    let length = file.get_ref().metadata().map_err(Error::io(path, "read"))?.len();
    let mut table = |at: u64| -> io::Result<u64> {
        file.seek(SeekFrom::Start(at))?;
        let mut bytes = [0; 8];
        file.read_exact(&mut bytes)?;
        Ok(u64::from_le_bytes(bytes))
    };
    let found = table(start).and_then(|first| {
        // (Those who write into a pipe put it at the end.)
        let place = if first as i64 <= start as i64 { table(length.saturating_sub(8))? } else { first };
        let count = if place < length { table(place)? >> 32 } else { 0 };
        Ok((place, count))
    });
    let (place, count) = found.map_err(|error| damaged(path, &error.to_string()))?;
    // (A chunk has a point as it is, of 20 bytes or more.)
    if place <= start || place >= length || count > length / 20 + 1 {
        return Err(damaged(path, &format!("a table of {count} chunks at byte {place} of {length}")));
    }
    file.seek(SeekFrom::Start(start)).map_err(Error::io(path, "read"))?;
    Ok(())
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
            Points::Packed(reader) => guard(path, "packed points", || {
                reader.decompress_many(&mut rows[before..]).map_err(|error| damaged(path, &error.to_string()))
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
        // (Of no points: one place, so that there is a grid.)
        self.schema.bounds = bounds.unwrap_or([[0; 3]; 2]);
        Ok(true)
    }
}
