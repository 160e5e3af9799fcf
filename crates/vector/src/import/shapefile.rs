//! Shapefiles (ESRI, 1998): shapes, their index, and a table of their attributes.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::dbf::Table;
use super::feature::{
    Feature, FeatureGeometry, FeatureOptions, FeatureReader, FeatureSchema, RequestedAttributes,
};
use super::heights::Heights;
use super::rings;
use super::sidecar;
use crate::export::GeometryKind;
use spinney_base::{Error, Result};

/// Size of a file header in bytes.
const HEADER: u64 = 100;

pub(super) struct Shapefile {
    shapes: BufReader<File>,
    path: PathBuf,
    length: u64,
    /// Index of the shapes; without it, they are contiguous.
    index_file: Option<(BufReader<File>, PathBuf)>,
    table: Option<Table>,
    schema: FeatureSchema,
    /// Number of features in the file, if known.
    count: Option<u64>,
    memory: u64,
    number: u64,
    /// Offset of the next shape.
    at: u64,
}

/// Memory per byte of a shape: as read, as points, as rings and polygons.
const BYTES_FOR_BYTE: u64 = 5;

/// Returns whether a file starts like a shapefile.
pub(super) fn is_one(first: &[u8]) -> bool {
    first.len() >= 36 && first.starts_with(&9994u32.to_be_bytes()) && first[28..32] == 1000u32.to_le_bytes()
}

impl Shapefile {
    pub(super) fn open(
        file: File,
        path: &Path,
        options: &FeatureOptions,
        wanted: &mut RequestedAttributes,
    ) -> Result<Shapefile> {
        let length = file.metadata().map_err(Error::io(path, "read"))?.len();
        let mut shapes = BufReader::with_capacity(1 << 16, file);
        let mut head = [0; HEADER as usize];
        shapes.read_exact(&mut head).map_err(Error::io(path, "read the header"))?;
        let kind = match u32::from_le_bytes([head[32], head[33], head[34], head[35]]) {
            1 | 11 | 21 | 8 | 18 | 28 => Some(GeometryKind::Point),
            3 | 13 | 23 => Some(GeometryKind::Line),
            5 | 15 | 25 => Some(GeometryKind::Polygon),
            _ => None,
        };
        let mut count = None;
        let mut index_file = None;
        if let Some((file, path)) = sidecar::open(path, "shx")? {
            let length = file.metadata().map_err(Error::io(&path, "read"))?.len();
            let mut input = BufReader::with_capacity(1 << 16, file);
            input.seek(SeekFrom::Start(HEADER)).map_err(Error::io(&path, "read"))?;
            count = Some(length.saturating_sub(HEADER) / 8);
            index_file = Some((input, path));
        }
        let table = Table::open_sidecar(path, wanted)?;
        if let (Some(count), Some(table)) = (count, &table)
            && table.rows != count
        {
            let found = format!("{count} shapes, and {} rows in the table", table.rows);
            return Err(Error::corrupt(path, "sidecar files", found, "equal counts"));
        }
        let count = count.or(table.as_ref().map(|table| table.rows));
        let schema = FeatureSchema {
            name: path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default(),
            crs: sidecar::definition(path)?,
            attributes: table.as_ref().map(Table::attributes).unwrap_or_default(),
            kind,
            count,
        };
        let memory = options.memory;
        Ok(Shapefile {
            shapes,
            path: path.into(),
            length,
            index_file,
            table,
            schema,
            count,
            memory,
            number: 1,
            at: HEADER,
        })
    }

    fn wrong(&self, found: impl Into<String>, expected: &str) -> Error {
        Error::corrupt(&self.path, format!("feature {}", self.number), found, expected)
    }

    /// Reads the bytes of the next shape; `None` if there is none.
    fn shape(&mut self) -> Result<Option<Vec<u8>>> {
        if self.count.is_some_and(|count| self.number > count) {
            return Ok(None);
        }
        match &mut self.index_file {
            None if self.at >= self.length => {
                return match self.count {
                    Some(count) => Err(self.wrong("the end of the file", &format!("{count} shapes"))),
                    None => Ok(None),
                };
            }
            None => {}
            Some((input, path)) => {
                let mut entry = [0; 8];
                input.read_exact(&mut entry).map_err(Error::io(&*path, "read"))?;
                self.at = 2 * u64::from(u32::from_be_bytes([entry[0], entry[1], entry[2], entry[3]]));
            }
        }
        if self.at < HEADER || self.length.saturating_sub(self.at) < 8 {
            return Err(self.wrong(
                format!("a shape at byte {} of {}", self.at, self.length),
                "an offset inside the file",
            ));
        }
        // A seek within the buffer reads nothing.
        let before = self.shapes.stream_position().map_err(Error::io(&self.path, "read"))?;
        let step = self.at as i64 - before as i64;
        self.shapes.seek_relative(step).map_err(Error::io(&self.path, "read"))?;
        let mut head = [0; 8];
        self.shapes.read_exact(&mut head).map_err(Error::io(&self.path, "read"))?;
        let bytes = 2 * u64::from(u32::from_be_bytes([head[4], head[5], head[6], head[7]]));
        if bytes > self.length - self.at - 8 {
            let found = format!("a shape of {bytes} bytes at byte {} of {}", self.at, self.length);
            return Err(self.wrong(found, "a shape inside the file"));
        }
        if bytes.saturating_mul(BYTES_FOR_BYTE) > self.memory {
            return Err(Error::TooLarge {
                path: self.path.clone(),
                what: format!("feature {}", self.number),
                needed: bytes.saturating_mul(BYTES_FOR_BYTE),
                limit: self.memory,
                advice: "allow more memory, or divide the feature".into(),
            });
        }
        let mut shape = vec![0; bytes as usize];
        self.shapes.read_exact(&mut shape).map_err(Error::io(&self.path, "read"))?;
        self.at += 8 + bytes;
        Ok(Some(shape))
    }
}

impl FeatureReader for Shapefile {
    fn schema(&self) -> &FeatureSchema {
        &self.schema
    }

    fn next(&mut self) -> Result<Option<Feature>> {
        while let Some(shape) = self.shape()? {
            let attributes = match &mut self.table {
                Some(table) => table.step(self.number)?,
                None => Some(Vec::new()),
            };
            // Deleted features stay in the files until these are packed.
            if let Some(attributes) = attributes {
                let geometry =
                    geometry(&shape).and_then(|geometry| geometry.map(FeatureGeometry::checked).transpose());
                let read = geometry.and_then(|geometry| Ok((heights(&shape, geometry.as_ref())?, geometry)));
                let (heights, geometry) =
                    read.map_err(|found| self.wrong(found, "a shape of points, lines or polygons"))?;
                self.number += 1;
                return Ok(Some(Feature { id: None, attributes, geometry, heights }));
            }
            self.number += 1;
        }
        Ok(None)
    }
}

/// Returns the heights of a shape's geometry. Shape types 11 to 18 have heights and possibly
/// measures, types 21 to 28 only measures. Heights of several points follow the points and the
/// height range. Whether types 11 to 18 have measures is not recorded: files without measures omit
/// them.
fn heights(shape: &[u8], geometry: Option<&FeatureGeometry>) -> std::result::Result<Heights, String> {
    let kind = shape.first().copied().unwrap_or_default();
    let mut heights = Heights { are_there: (10..20).contains(&kind), ..Heights::default() };
    heights.have_measures = kind > 20;
    let Some(geometry) = geometry else { return Ok(Heights::default()) };
    if !heights.are_there {
        return Ok(heights);
    }
    let numbers = |bytes: &[u8]| -> Vec<f64> {
        bytes.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect()
    };
    // Offset and number of the heights, and offset of the points.
    let word =
        |at: usize| shape.get(at..).and_then(|rest| rest.first_chunk().copied()).map(u32::from_le_bytes);
    let (at, count, begin) = match geometry {
        FeatureGeometry::Points(_) if kind == 11 => (20, 1, 4),
        FeatureGeometry::Points(points) => (40 + 16 * points.len() + 16, points.len(), 40),
        _ => {
            let (parts, count) =
                (word(36).unwrap_or_default() as usize, word(40).unwrap_or_default() as usize);
            (44 + 4 * parts + 16 * count + 16, count, 44 + 4 * parts)
        }
    };
    let bytes = shape.get(at..).and_then(|rest| rest.get(..8 * count));
    let bytes = bytes.ok_or_else(|| format!("{count} heights in {} bytes", shape.len()))?;
    // Rings may have been reordered, which makes the order of heights invalid.
    let points = shape.get(begin..begin + 16 * count).map(numbers).unwrap_or_default();
    if geometry
        .points()
        .flatten()
        .map(|number| number.to_bits())
        .eq(points.iter().map(|number| number.to_bits()))
    {
        heights.of_points = numbers(bytes);
    }
    Ok(heights)
}

/// Parses a shape's geometry; `None` for an empty shape.
fn geometry(shape: &[u8]) -> std::result::Result<Option<FeatureGeometry>, String> {
    let number = |at: usize| -> std::result::Result<usize, String> {
        let bytes = shape.get(at..).and_then(|rest| rest.first_chunk());
        bytes.map(|bytes| u32::from_le_bytes(*bytes) as usize).ok_or_else(|| "a truncated shape".into())
    };
    let points = |at: usize, count: usize| -> std::result::Result<Vec<[f64; 2]>, String> {
        let bytes = shape.get(at..).and_then(|rest| rest.get(..count.checked_mul(16)?));
        let bytes = bytes.ok_or_else(|| format!("{count} points in {} bytes", shape.len()))?;
        let point = |[x, y]: &[[u8; 8]; 2]| [f64::from_le_bytes(*x), f64::from_le_bytes(*y)];
        Ok(bytes.as_chunks::<8>().0.as_chunks::<2>().0.iter().map(point).collect())
    };
    match number(0)? {
        0 => Ok(None),
        1 | 11 | 21 => Ok(Some(FeatureGeometry::Points(points(4, 1)?))),
        8 | 18 | 28 => Ok(Some(FeatureGeometry::Points(points(40, number(36)?)?))),
        kind @ (3 | 13 | 23 | 5 | 15 | 25) => {
            let (parts, count) = (number(36)?, number(40)?);
            let begin = parts.checked_mul(4).and_then(|bytes| bytes.checked_add(44));
            let begin = begin.filter(|begin| *begin <= shape.len());
            let begin = begin.ok_or_else(|| format!("{parts} parts in {} bytes", shape.len()))?;
            let all = points(begin, count)?;
            let mut lines = Vec::with_capacity(parts);
            for part in 0..parts {
                let first = number(44 + 4 * part)?;
                let next = if part + 1 < parts { number(48 + 4 * part)? } else { count };
                let line = all
                    .get(first..next)
                    .ok_or_else(|| format!("a part of points {first} to {next} of {count}"))?;
                lines.push(line.to_vec());
            }
            match kind {
                3 | 13 | 23 => Ok(Some(FeatureGeometry::Lines(lines))),
                _ => {
                    if let Some(ring) =
                        lines.iter().find(|ring| ring.iter().flatten().any(|number| !number.is_finite()))
                    {
                        return Err(format!(
                            "a ring of {} vertices, some of which are not numbers",
                            ring.len()
                        ));
                    }
                    Ok(Some(FeatureGeometry::Polygons(rings::parts_of(lines)?)))
                }
            }
        }
        31 => Err("a 3D surface (type 31, multipatch)".into()),
        other => Err(format!("a shape of type {other}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(kind: u32, parts: &[&[f64]]) -> Vec<u8> {
        let numbers = parts.concat().into_iter().flat_map(f64::to_le_bytes);
        kind.to_le_bytes().into_iter().chain(numbers).collect()
    }

    #[test]
    fn points_have_their_heights() {
        for (shape, are_there, have_measures, expected) in [
            (shape(1, &[&[1.0, 2.0]]), false, false, vec![]),
            (shape(11, &[&[1.0, 2.0, 3.0, 4.0]]), true, false, vec![3.0]),
            (shape(21, &[&[1.0, 2.0, 4.0]]), false, true, vec![]),
        ] {
            let geometry = geometry(&shape).unwrap();
            let found = heights(&shape, geometry.as_ref()).unwrap();
            assert_eq!(found, Heights { are_there, have_measures, of_points: expected });
        }
        // Several points: box, count, positions, height range, heights.
        let mut several = shape(18, &[&[0.0; 4]]);
        several.extend(2u32.to_le_bytes());
        several.extend([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 5.0, 6.0].into_iter().flat_map(f64::to_le_bytes));
        let geometry = geometry(&several).unwrap();
        assert_eq!(geometry, Some(FeatureGeometry::Points(vec![[1.0, 2.0], [3.0, 4.0]])));
        assert_eq!(heights(&several, geometry.as_ref()).unwrap().of_points, [5.0, 6.0]);
        let error = heights(&several[..several.len() - 1], geometry.as_ref()).unwrap_err();
        assert!(error.contains("2 heights in 103 bytes"), "{error}");
    }
}
