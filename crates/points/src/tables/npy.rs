//! Points from `NumPy` arrays: records with fields x, y and z, or rows of numbers.

use std::fs::File;
use std::io::Seek;
use std::path::{Path, PathBuf};

use super::columns::{Columns, Role};
use super::{RELEASE_EVERY, Table};
use crate::attribute::{PointAttribute, ordered, to_f64};
use crate::source::WorldPoints;
use spinney_base::io::{Mapped, ReadBackend as _};
use spinney_base::space::Dimension;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};
use spinney_crs::Crs;
use spinney_records::npy::{Items, NpyField, NpyHeader};

/// Offset, type and role of a number in a record.
struct Number {
    offset: usize,
    sample: SampleType,
    is_big_endian: bool,
    role: Role,
}

impl Number {
    #[inline]
    fn of(&self, record: &[u8]) -> i64 {
        let size = self.sample.size();
        let mut bytes = [0; 8];
        bytes[..size].copy_from_slice(&record[self.offset..self.offset + size]);
        if self.is_big_endian {
            bytes[..size].reverse();
        }
        ordered(self.sample, &bytes)
    }
}

/// Points of an array.
struct NpyPoints {
    path: PathBuf,
    map: Mapped,
    /// Offset of the first record, and bytes per record.
    start: usize,
    stride: usize,
    count: u64,
    numbers: Vec<Number>,
    attributes: Vec<PointAttribute>,
    dimension: Dimension,
    at: u64,
}

/// Returns the type of a dtype string, and whether it is big-endian.
fn sample_of(descr: &str) -> Option<(SampleType, bool)> {
    let (order, name) = descr.split_at_checked(1)?;
    let sample = match name {
        "b1" | "u1" => SampleType::U8,
        "i1" => SampleType::I8,
        "u2" => SampleType::U16,
        "i2" => SampleType::I16,
        "u4" => SampleType::U32,
        "i4" => SampleType::I32,
        "u8" => SampleType::U64,
        "i8" => SampleType::I64,
        "f4" => SampleType::F32,
        "f8" => SampleType::F64,
        _ => return None,
    };
    let is_known = matches!(order, "<" | ">") || order == "|" && sample.size() == 1;
    is_known.then_some((sample, order == ">"))
}

/// Returns the size of a padding field, which has no name and type; `None` for other fields.
fn padding(field: &NpyField) -> Option<usize> {
    field.descr.strip_prefix("|V").filter(|_| field.name.is_empty())?.parse().ok()
}

/// Returns the fields of records. Columns of rows are named x, y and z, then by their indices.
fn fields(header: &NpyHeader, path: &Path) -> Result<Vec<NpyField>> {
    let unsupported = |found: String| {
        let advice = "save records with fields x, y and optionally z, or rows of 2 to 1024 numbers";
        Err(Error::unsupported(path, found, advice))
    };
    if header.fortran_order && header.shape.len() > 1 {
        let advice = "save it in C order: numpy.save(path, numpy.ascontiguousarray(array))";
        return Err(Error::unsupported(path, "an array in Fortran order", advice));
    }
    match (&header.items, &header.shape[..]) {
        (Items::Records(fields), [_]) => Ok(fields.clone()),
        // Matches the maximum number of attributes.
        (Items::Samples(descr), [_, columns @ 2..=1024]) => {
            let name = |column: u64| match column {
                0 => "x".into(),
                1 => "y".into(),
                2 => "z".into(),
                _ => format!("column_{column}"),
            };
            Ok((0..*columns).map(|column| NpyField { name: name(column), descr: descr.clone() }).collect())
        }
        _ => unsupported(format!("an array of shape {}", header.shape_text())),
    }
}

pub(super) fn open(path: &Path) -> Result<Table> {
    let mut file = File::open(path).map_err(Error::io(path, "open"))?;
    let header = NpyHeader::read(&mut file, path)?;
    let start = file.stream_position().map_err(Error::io(path, "read"))?;
    let (mut stride, mut found) = (0usize, Vec::new());
    let fields = fields(&header, path)?;
    for field in &fields {
        let size = match (padding(field), sample_of(&field.descr)) {
            (Some(size), _) => size,
            (None, Some((sample, is_big_endian))) => {
                found.push((field.name.as_str(), sample, stride, is_big_endian));
                sample.size()
            }
            (None, None) => {
                let found = format!("field `{}` of type `{}`", field.name, field.descr.escape_debug());
                let advice =
                    "convert it with array.astype, to bool, or to integers or floats of 4 or 8 bytes";
                return Err(Error::unsupported(path, found, advice));
            }
        };
        stride = stride.saturating_add(size);
    }
    let named: Vec<(&str, SampleType)> = found.iter().map(|(name, sample, ..)| (*name, *sample)).collect();
    let columns = Columns::of(&named, path)?;
    let length = file.metadata().map_err(Error::io(path, "read the size of"))?.len();
    let count = header.shape[0];
    let end = count.checked_mul(stride as u64).and_then(|bytes| bytes.checked_add(start));
    if end != Some(length) {
        let expected = format!("{count} records of {stride} bytes after byte {start}");
        return Err(Error::corrupt(path, "file size", format!("{length} bytes"), expected));
    }
    let numbers = found.iter().zip(&columns.roles).map(|((_, sample, offset, is_big_endian), role)| Number {
        offset: *offset,
        sample: *sample,
        is_big_endian: *is_big_endian,
        role: *role,
    });
    let points = NpyPoints {
        path: path.to_path_buf(),
        map: Mapped::of(&file, path)?,
        start: start as usize,
        stride,
        count,
        numbers: numbers.collect(),
        attributes: columns.attributes,
        dimension: columns.dimension,
        at: 0,
    };
    Ok(Table { points: Box::new(points), remarks: Vec::new() })
}

impl WorldPoints for NpyPoints {
    fn attributes(&self) -> &[PointAttribute] {
        &self.attributes
    }

    fn dimension(&self) -> Dimension {
        self.dimension
    }

    fn crs(&self) -> Option<&Crs> {
        None
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn next(&mut self, numbers: &mut [i64]) -> Result<Option<[f64; 3]>> {
        if self.at == self.count {
            return Ok(None);
        }
        if self.at.is_multiple_of(RELEASE_EVERY) {
            self.map.release_pages();
        }
        let from = self.start + self.at as usize * self.stride;
        let record = self.map.bytes().and_then(|bytes| bytes.get(from..from + self.stride));
        let record = record.unwrap_or_default();
        let mut position = [0.0; 3];
        for number in &self.numbers {
            let found = number.of(record);
            match number.role {
                Role::Coordinate(axis) => position[axis] = to_f64(number.sample, found),
                Role::Attribute(attribute) => numbers[attribute] = found,
            }
        }
        self.at += 1;
        Ok(Some(position))
    }

    fn rewind(&mut self) -> Result<()> {
        self.at = 0;
        Ok(())
    }
}
