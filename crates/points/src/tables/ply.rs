//! Points from the vertices of PLY files.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use super::columns::{Columns, Role};
use super::{RELEASE_EVERY, Table};
use crate::attribute::{PointAttribute, ordered};
use crate::source::WorldPoints;
use spinney_base::io::{Mapped, ReadBackend as _};
use spinney_base::space::Dimension;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};
use spinney_crs::Crs;
use spinney_records::ply::{
    Body, Element, Encoding, Fault, PlyHeader, Property, Read, Scalar, Visit, offset_after, visit,
};

/// Number of vertices read at a time.
const LOT: u64 = 1 << 12;

/// Vertices of a file.
struct PlyPoints {
    path: PathBuf,
    map: Mapped,
    encoding: Encoding,
    vertices: Element,
    /// Role of each property; `None` for lists, which are skipped.
    roles: Vec<Option<Role>>,
    attributes: Vec<PointAttribute>,
    dimension: Dimension,
    /// Offset of the first vertex, and of the next unread one.
    start: usize,
    offset: usize,
    /// Number of vertices read.
    count: u64,
    /// Buffered vertices: their coordinates, and the numbers of all of their attributes.
    positions: VecDeque<[f64; 3]>,
    numbers: VecDeque<i64>,
}

fn sample_of(scalar: Scalar) -> SampleType {
    match scalar {
        Scalar::I8 => SampleType::I8,
        Scalar::U8 => SampleType::U8,
        Scalar::I16 => SampleType::I16,
        Scalar::U16 => SampleType::U16,
        Scalar::I32 => SampleType::I32,
        Scalar::U32 => SampleType::U32,
        Scalar::F32 => SampleType::F32,
        Scalar::F64 => SampleType::F64,
    }
}

fn is_list(property: &Property) -> bool {
    property.length.is_some()
}

fn corrupt(path: &Path, what: &str, fault: Fault) -> Error {
    Error::corrupt(path, format!("{what}, {}", fault.place), fault.found, fault.expected)
}

pub(super) fn open(path: &Path) -> Result<Table> {
    let map = Mapped::open(path)?;
    let bytes = map.bytes().unwrap_or_default();
    let header = PlyHeader::read(bytes, path)?;
    let Some(vertex) = header.element("vertex") else {
        return Err(Error::corrupt(path, "PLY header", "no `element vertex`", "one with the points"));
    };
    let mut start = header.body;
    for element in &header.elements[..vertex] {
        start = offset_after(header.encoding, bytes, start, element)
            .map_err(|fault| corrupt(path, &element.name, *fault))?;
    }
    let vertices = header.elements[vertex].clone();
    let scalars = vertices.properties.iter().filter(|property| !is_list(property));
    let named: Vec<_> =
        scalars.map(|property| (property.name.as_str(), sample_of(property.scalar))).collect();
    let columns = Columns::of(&named, path)?;
    let mut roles = columns.roles.into_iter();
    let roles =
        vertices.properties.iter().map(|property| if is_list(property) { None } else { roles.next() });
    let roles = roles.collect();
    let mut remarks = Vec::new();
    let others: Vec<String> = header
        .elements
        .iter()
        .filter(|element| element.name != "vertex")
        .map(|element| format!("{} {}", element.count, element.name))
        .collect();
    if !others.is_empty() {
        remarks.push(format!("elements other than vertices are ignored: {}", others.join(", ")));
    }
    let lists = vertices.properties.iter().filter(|property| is_list(property));
    let lists: Vec<&str> = lists.map(|property| property.name.as_str()).collect();
    if !lists.is_empty() {
        remarks.push(format!("list properties are ignored: {}", lists.join(", ")));
    }
    let points = PlyPoints {
        path: path.to_path_buf(),
        encoding: header.encoding,
        vertices,
        roles,
        attributes: columns.attributes,
        dimension: columns.dimension,
        start,
        offset: start,
        count: 0,
        positions: VecDeque::new(),
        numbers: VecDeque::new(),
        map,
    };
    Ok(Table { points: Box::new(points), remarks })
}

/// Reads an integer, and checks its range: text may exceed its type.
fn whole(body: &mut impl Body, scalar: Scalar) -> Read<i64> {
    let number = body.whole(scalar)?;
    let bits = 8 * scalar.size() as u32;
    let is_signed = matches!(scalar, Scalar::I8 | Scalar::I16 | Scalar::I32);
    let least = if is_signed { -(1i64 << (bits - 1)) } else { 0 };
    match (least..least + (1 << bits)).contains(&number) {
        true => Ok(number),
        false => Err(body.fault(number.to_string(), "a number in the range of its property's type")),
    }
}

/// Reads some vertices; returns the offset after them.
struct ReadVertices<'a> {
    vertices: &'a Element,
    roles: &'a [Option<Role>],
    attributes: usize,
    count: u64,
    positions: &'a mut VecDeque<[f64; 3]>,
    numbers: &'a mut VecDeque<i64>,
}

impl Visit for ReadVertices<'_> {
    type Output = Read<usize>;

    fn visit(self, mut body: impl Body) -> Read<usize> {
        let mut row = vec![0; self.attributes];
        for _ in 0..self.count {
            let mut position = [0.0; 3];
            for (role, property) in self.roles.iter().zip(&self.vertices.properties) {
                match role {
                    None => body.skip_property(property)?,
                    Some(Role::Coordinate(axis)) => position[*axis] = body.number(property.scalar)?,
                    Some(Role::Attribute(attribute)) => {
                        row[*attribute] = match property.scalar {
                            Scalar::F32 => {
                                ordered(SampleType::F32, &(body.number(Scalar::F32)? as f32).to_le_bytes())
                            }
                            Scalar::F64 => ordered(SampleType::F64, &body.number(Scalar::F64)?.to_le_bytes()),
                            scalar => whole(&mut body, scalar)?,
                        };
                    }
                }
            }
            self.positions.push_back(position);
            self.numbers.extend(&row);
        }
        Ok(body.offset())
    }
}

impl PlyPoints {
    fn read(&mut self) -> Result<()> {
        let rest = self.vertices.count - self.count;
        let lot = ReadVertices {
            vertices: &self.vertices,
            roles: &self.roles,
            attributes: self.attributes.len(),
            count: rest.min(LOT),
            positions: &mut self.positions,
            numbers: &mut self.numbers,
        };
        let bytes = self.map.bytes().unwrap_or_default();
        self.offset = visit(self.encoding, bytes, self.offset, lot)
            .map_err(|fault| corrupt(&self.path, "vertices", *fault))?;
        self.count += rest.min(LOT);
        if self.count.is_multiple_of(RELEASE_EVERY) {
            self.map.release_pages();
        }
        Ok(())
    }
}

impl WorldPoints for PlyPoints {
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
        if self.positions.is_empty() && self.count < self.vertices.count {
            self.read()?;
        }
        let position = self.positions.pop_front();
        if position.is_some() {
            for (number, found) in numbers.iter_mut().zip(self.numbers.drain(..self.attributes.len())) {
                *number = found;
            }
        }
        Ok(position)
    }

    fn rewind(&mut self) -> Result<()> {
        (self.offset, self.count) = (self.start, 0);
        self.positions.clear();
        self.numbers.clear();
        Ok(())
    }
}
