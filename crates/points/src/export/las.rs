//! Export of points as LAS and LAZ files.

use std::io::{self, Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use laz::laszip::LazItemRecordBuilder;
use laz::{LasZipCompressor, LazVlr};

use super::PointSink;
use crate::las::{Fields, LasFile};
use crate::query::PointColumns;
use crate::store::PointTree;
use spinney_base::io::Output;
use spinney_base::{Error, Result};

/// Seekable output, so that the header can be rewritten. The mutex is never contended; laz-rs
/// requires a destination that can be shared between threads.
struct SeekableOutput {
    out: Mutex<Output>,
    position: u64,
    end: u64,
}

impl SeekableOutput {
    fn out(&mut self) -> &mut Output {
        self.out.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for SeekableOutput {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let before = (self.end - self.position).min(bytes.len() as u64) as usize;
        let position = self.position;
        let count = match before {
            0 => self.out().write(bytes)?,
            before => {
                self.out().overwrite(position, &bytes[..before])?;
                before
            }
        };
        self.position += count as u64;
        self.end = self.end.max(self.position);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out().flush()
    }
}

impl Seek for SeekableOutput {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::Current(more) => self.position.checked_add_signed(more),
            SeekFrom::End(more) => self.end.checked_add_signed(more),
        };
        self.position =
            position.filter(|position| *position <= self.end).ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.position)
    }
}

/// Output of records.
#[allow(clippy::large_enum_variant)] // there is only one
enum Records {
    Plain(SeekableOutput),
    Packed(Box<LasZipCompressor<'static, SeekableOutput>>),
}

/// Writes records, then rewrites the header with their counts and bounds.
struct LasSink {
    path: PathBuf,
    file: LasFile,
    fields: Fields,
    records: Records,
    rows: Vec<u8>,
}

/// Creates a file for a tree's points with some of its attributes.
pub(super) fn sink(
    tree: &PointTree,
    chosen: &[usize],
    out: Output,
    is_packed: bool,
) -> Result<Box<dyn PointSink>> {
    let path = out.path().to_path_buf();
    if !out.is_file() {
        let advice = "write it to a file: its header depends on all points";
        return Err(Error::unsupported(path, "a LAS file on standard output", advice));
    }
    let (mut file, fields) = LasFile::of(tree, chosen)?;
    let mut out = SeekableOutput { out: Mutex::new(out), position: 0, end: 0 };
    let failed = || Error::io(&path, "write");
    let laszip = match is_packed {
        false => None,
        true => {
            let items = LazItemRecordBuilder::default_for_point_format_id(file.format(), file.extra_bytes());
            let record =
                items.map(LazVlr::from_laz_items).map_err(|error| unpackable(&path, &error.to_string()))?;
            let mut bytes = Vec::new();
            record.write_to(&mut bytes).map_err(failed())?;
            file.pack(bytes);
            Some(record)
        }
    };
    out.write_all(&file.to_bytes(&path)?).map_err(failed())?;
    let records = match laszip {
        None => Records::Plain(out),
        Some(record) => {
            let writer =
                LasZipCompressor::new(out, record).map_err(|error| unpackable(&path, &error.to_string()))?;
            Records::Packed(Box::new(writer))
        }
    };
    Ok(Box::new(LasSink { path, file, fields, records, rows: Vec::new() }))
}

fn unpackable(path: &std::path::Path, what: &str) -> Error {
    Error::unsupported(path, format!("compression of these points ({what})"), "write .las instead")
}

impl PointSink for LasSink {
    fn put(&mut self, points: &PointColumns) -> Result<()> {
        self.fields.rows(&points.columns, &mut self.rows);
        self.file.count(&self.rows);
        let written = match &mut self.records {
            Records::Plain(out) => out.write_all(&self.rows),
            Records::Packed(writer) => writer.compress_many(&self.rows),
        };
        written.map_err(Error::io(&self.path, "write"))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let failed = || Error::io(&self.path, "write");
        let mut out = match self.records {
            Records::Plain(out) => out,
            Records::Packed(mut writer) => {
                writer.done().map_err(failed())?;
                writer.into_inner()
            }
        };
        out.out().overwrite(0, &self.file.to_bytes(&self.path)?).map_err(failed())?;
        out.out.into_inner().unwrap_or_else(PoisonError::into_inner).commit()
    }
}
