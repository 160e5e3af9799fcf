//! Shapefile (ESRI, 1998): shapes, their index, and a dBASE table of attributes.

use std::io::Write;

use serde_json::Value;

use super::geometry::Shape;
use super::layer::TEXT_BYTES;
use super::names::cut;
use super::{AttributeType, AttributeValue, FormatWriter, GeometryKind, VectorLayer};
use spinney_base::io::{Output, commit_all};
use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Header size of the shape and index files, in bytes.
const HEADER: u64 = 100;

/// Type, width in bytes and decimals of a table column.
fn field(kind: AttributeType) -> (u8, usize, u8) {
    match kind {
        AttributeType::Number => (b'N', 24, 15),
        AttributeType::Integer => (b'N', 20, 0),
        AttributeType::Boolean => (b'L', 1, 0),
        _ => (b'C', TEXT_BYTES, 0),
    }
}

/// Maximum file size in bytes: the header stores a 31-bit number of 16-bit words.
const MOST: u64 = 2 * i32::MAX as u64;

pub(super) struct Shapefile {
    shapes: Output,
    index_file: Output,
    table: Output,
    /// Small sidecar files.
    others: Vec<Output>,
    layer: VectorLayer,
    /// Bytes of shapes so far, and number of features.
    length: u64,
    count: u32,
    /// Minimum and maximum coordinates.
    low: [f64; 3],
    high: [f64; 3],
}

/// Returns the coordinate system for a `.prj` file: WKT 1 as Esri writes it, or else its own
/// definition.
pub(super) fn definition(crs: &Crs) -> Option<String> {
    crs.to_esri_wkt().ok().or_else(|| match crs {
        Crs::Wkt(text) => Some(text.clone()),
        other => other.to_wkt2().ok(),
    })
}

impl Shapefile {
    pub(super) fn new(shapes: Output, layer: VectorLayer) -> Result<Shapefile> {
        if !shapes.is_file() {
            let advice = "write to a named file: a shapefile consists of several files";
            return Err(Error::unsupported(shapes.path(), "writing a shapefile to a stream", advice));
        }
        // Strings in the table are too short for one number per segment.
        let has_lists = layer.attributes.iter().any(|(_, kind)| *kind == AttributeType::PerSegment);
        if matches!(layer.kind, None | Some(GeometryKind::Point)) || has_lists {
            let found = "a shapefile of points, of several geometry types, or with numbers per segment";
            return Err(Error::unsupported(shapes.path(), found, "choose another format"));
        }
        let sidecar = |ending: &str| shapes.access().create(&shapes.path().with_extension(ending));
        let (index_file, table) = (sidecar("shx")?, sidecar("dbf")?);
        let mut others = Vec::new();
        let definition = layer.crs.as_ref().and_then(definition);
        for (ending, text) in [("cpg", Some("UTF-8")), ("prj", definition.as_deref())] {
            if let Some(text) = text {
                let mut other = sidecar(ending)?;
                write(&mut other, text.as_bytes())?;
                others.push(other);
            }
        }
        let (low, high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let mut file =
            Shapefile { shapes, index_file, table, others, layer, length: HEADER, count: 0, low, high };
        let header = file.header(0);
        write(&mut file.shapes, &header)?;
        write(&mut file.index_file, &header)?;
        let header = file.table_header()?;
        write(&mut file.table, &header)?;
        Ok(file)
    }

    /// Returns the shape type.
    fn kind(&self) -> u32 {
        let flat = if self.layer.kind == Some(GeometryKind::Line) { 3 } else { 5 };
        if self.layer.has_z { flat + 10 } else { flat }
    }

    /// Returns the header of a file of `length` bytes.
    fn header(&self, length: u64) -> Vec<u8> {
        let mut header = 9994u32.to_be_bytes().to_vec();
        header.extend_from_slice(&[0; 20]);
        header.extend_from_slice(&((length / 2) as u32).to_be_bytes());
        header.extend_from_slice(&1000u32.to_le_bytes());
        header.extend_from_slice(&self.kind().to_le_bytes());
        let numbers = [self.low[0], self.low[1], self.high[0], self.high[1]];
        let heights = if self.layer.has_z { [self.low[2], self.high[2]] } else { [0.0; 2] };
        for number in numbers.into_iter().chain(heights).chain([0.0; 2]) {
            let number = if number.is_finite() { number } else { 0.0 };
            header.extend_from_slice(&number.to_le_bytes());
        }
        header
    }

    /// Returns the table header.
    fn table_header(&self) -> Result<Vec<u8>> {
        let width = 1 + self.layer.attributes.iter().map(|(_, kind)| field(*kind).1).sum::<usize>();
        let length = 32 + 32 * self.layer.attributes.len() + 1;
        let (Ok(length), Ok(width)) = (u16::try_from(length), u16::try_from(width)) else {
            let found = format!("{} attributes", self.layer.attributes.len());
            return Err(Error::unsupported(self.shapes.path(), found, "choose another format"));
        };
        // The date is constant, so that output is reproducible.
        let mut header = vec![3, 100, 1, 1];
        header.extend_from_slice(&self.count.to_le_bytes());
        header.extend_from_slice(&length.to_le_bytes());
        header.extend_from_slice(&width.to_le_bytes());
        header.extend_from_slice(&[0; 20]);
        for (name, kind) in &self.layer.attributes {
            let mut bytes = [0; 32];
            bytes[..name.len()].copy_from_slice(name.as_bytes());
            let (letter, width, decimals) = field(*kind);
            (bytes[11], bytes[16], bytes[17]) = (letter, width as u8, decimals);
            header.extend_from_slice(&bytes);
        }
        header.push(b'\r');
        Ok(header)
    }

    /// Writes a feature without a geometry.
    fn write_null(&mut self, attributes: &[AttributeValue<'_>]) -> Result<()> {
        let offset = self.length;
        if offset + 12 > MOST {
            return Err(self.too_large());
        }
        self.length += 12;
        self.count += 1;
        let mut bytes = self.count.to_be_bytes().to_vec();
        bytes.extend_from_slice(&2u32.to_be_bytes());
        bytes.extend_from_slice(&0u32.to_le_bytes());
        write(&mut self.shapes, &bytes)?;
        write(&mut self.index_file, [(offset / 2) as u32, 2].map(u32::to_be_bytes).as_flattened())?;
        self.write_attributes(attributes)
    }

    fn too_large(&self) -> Error {
        Error::unsupported(self.shapes.path(), "a shapefile of more than 4 GB", "choose another format")
    }

    fn write_attributes(&mut self, attributes: &[AttributeValue<'_>]) -> Result<()> {
        let mut row = vec![b' '];
        for (value, (_, kind)) in attributes.iter().zip(&self.layer.attributes) {
            let (_, width, _) = field(*kind);
            let field = match value.finite_or_none() {
                AttributeValue::Number(number) => {
                    let short = number.to_string();
                    // The shortest form with an exponent always fits, and is exact.
                    let text = if short.len() <= width { short } else { format!("{number:e}") };
                    format!("{text:>width$}")
                }
                AttributeValue::Integer(number) => format!("{number:>width$}"),
                AttributeValue::Boolean(is) if *kind == AttributeType::Boolean => {
                    if is { "T" } else { "F" }.into()
                }
                AttributeValue::PerSegment(_) => String::new(),
                text => cut(&text.to_text(), width).to_string(),
            };
            row.extend_from_slice(field.as_bytes());
            row.resize(row.len() + width.saturating_sub(field.len()), b' ');
        }
        write(&mut self.table, &row)
    }
}

/// Incremental area of a ring.
#[derive(Default)]
struct Area {
    first: Option<[f64; 3]>,
    last: [f64; 3],
    /// Twice the signed area, relative to the first point; positive for counterclockwise rings.
    twice: f64,
}

impl Area {
    fn add(&mut self, point: [f64; 3]) {
        let first = *self.first.get_or_insert(point);
        let from = |point: [f64; 3]| [point[0] - first[0], point[1] - first[1]];
        let ([x, y], [next_x, next_y]) = (from(self.last), from(point));
        if first != point {
            self.twice += x * next_y - next_x * y;
        }
        self.last = point;
    }

    fn is_clockwise(&self) -> bool {
        self.twice < 0.0
    }
}

fn write(output: &mut Output, bytes: &[u8]) -> Result<()> {
    let written = output.write_all(bytes);
    written.map_err(|cause| Error::io(output.path(), "write")(cause))
}

impl FormatWriter for Shapefile {
    fn write(
        &mut self,
        _id: Option<&Value>,
        shape: Option<&Shape<'_>>,
        attributes: &[AttributeValue<'_>],
    ) -> Result<()> {
        // The format has no empty shapes, so they are written as null shapes.
        let Some(shape) = shape.filter(|shape| !shape.members.is_empty()) else {
            return self.write_null(attributes);
        };
        let geometry = shape.geometry;
        let is_polygon = shape.kind == Some(GeometryKind::Polygon);
        let parts = geometry.parts();
        let (mut low, mut high, mut count) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], 0u64);
        let mut is_turned = Vec::with_capacity(parts);
        for part in 0..parts {
            count = count.saturating_add(geometry.count(part));
            let mut area = Area::default();
            geometry.points(part, &mut |points| {
                for point in points {
                    low = std::array::from_fn(|axis| low[axis].min(point[axis]));
                    high = std::array::from_fn(|axis| high[axis].max(point[axis]));
                    area.add(*point);
                }
                Ok(())
            })?;
            // Outer rings are clockwise in this format, holes counterclockwise.
            is_turned.push(is_polygon && area.is_clockwise() != geometry.is_outer(part));
        }
        let heights = if self.layer.has_z { 16 + 8 * count as u128 } else { 0 };
        let bytes = 44 + 4 * parts as u128 + 16 * count as u128 + heights;
        let offset = self.length;
        if u128::from(offset) + 8 + bytes > u128::from(MOST) {
            return Err(self.too_large());
        }
        let bytes = bytes as u64;
        self.length += 8 + bytes;
        self.count += 1;
        let mut head = self.count.to_be_bytes().to_vec();
        head.extend_from_slice(&((bytes / 2) as u32).to_be_bytes());
        head.extend_from_slice(&self.kind().to_le_bytes());
        for number in [low[0], low[1], high[0], high[1]] {
            head.extend_from_slice(&number.to_le_bytes());
        }
        head.extend_from_slice(&(parts as u32).to_le_bytes());
        head.extend_from_slice(&(count as u32).to_le_bytes());
        let mut first = 0u64;
        for part in 0..parts {
            head.extend_from_slice(&(first as u32).to_le_bytes());
            first += geometry.count(part);
        }
        write(&mut self.shapes, &head)?;
        let passes = if self.layer.has_z { 2 } else { 1 };
        for pass in 0..passes {
            if pass == 1 {
                write(&mut self.shapes, &[low[2], high[2]].map(f64::to_le_bytes).concat())?;
            }
            let axes = if pass == 0 { 0..2 } else { 2..3 };
            for part in 0..parts {
                let (mut bytes, is_turned) = (Vec::new(), is_turned[part]);
                geometry.points(part, &mut |points| {
                    for point in points {
                        // The whole buffer is reversed later, so each point's coordinates are
                        // reversed here.
                        let numbers = point[axes.clone()].iter();
                        let put = |number: &f64| bytes.push(number.to_le_bytes());
                        if is_turned { numbers.rev().for_each(put) } else { numbers.for_each(put) }
                    }
                    Ok(())
                })?;
                if is_turned {
                    bytes.reverse();
                }
                write(&mut self.shapes, bytes.as_flattened())?;
            }
        }
        let index = [(offset / 2) as u32, (bytes / 2) as u32].map(u32::to_be_bytes);
        write(&mut self.index_file, index.as_flattened())?;
        self.low = std::array::from_fn(|axis| self.low[axis].min(low[axis]));
        self.high = std::array::from_fn(|axis| self.high[axis].max(high[axis]));
        self.write_attributes(attributes)
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        write(&mut self.table, b"\x1a")?;
        let headers =
            [self.header(self.length), self.header(HEADER + 8 * u64::from(self.count)), self.table_header()?];
        let Shapefile { shapes, index_file, table, others, .. } = *self;
        let mut files = [shapes, index_file, table];
        for (file, header) in files.iter_mut().zip(&headers) {
            let written = file.overwrite(0, header);
            written.map_err(|cause| Error::io(file.path(), "write")(cause))?;
        }
        let [shapes, index_file, table] = files;
        commit_all(others.into_iter().chain([index_file, table, shapes]).collect())
    }
}
