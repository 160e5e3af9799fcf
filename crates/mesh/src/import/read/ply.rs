//! PLY: polygons over indexed vertices, as text or binary, with arbitrary other properties.

use std::ops::Range;

use super::corners::{Corners, MAX_CORNERS};
use super::face_values::{FaceNumbers, number_columns};
use super::model_file::ModelFile;
use super::vertices::{Coordinates, Table, VertexBounds, VertexLayout, Vertices, VerticesBuilder};
use super::{MeshFace, Model, ModelInfo};
use spinney_base::{Error, Result};
use spinney_brep::Attributes;
use spinney_records::ply::{
    Body, Element, Encoding, Fault, PlyHeader, Read, Scalar, Visit, offset_after, visit,
};

struct Ply {
    source: ModelFile,
    info: ModelInfo,
    encoding: Encoding,
    vertices: Lookup,
    faces: Element,
    /// Offset of the first face.
    start: usize,
    degenerate: u64,
    lost_values: u64,
}

/// Storage of the vertices while faces are read.
enum Lookup {
    /// In the file itself.
    File(Range<usize>, VertexLayout),
    Store(Vertices),
}

impl Lookup {
    fn table<'a>(&'a self, source: &'a ModelFile) -> Table<'a> {
        match self {
            Lookup::File(range, layout) => Table::new(&source.bytes()[range.clone()], *layout),
            Lookup::Store(vertices) => vertices.table(),
        }
    }
}

pub(super) fn open(source: ModelFile, memory: u64) -> Result<Box<dyn Model>> {
    let header = PlyHeader::read(source.bytes(), source.path())?;
    let Some(vertex) = header.element("vertex") else {
        return Err(source.corrupt("PLY header", "no `element vertex`", "a mesh"));
    };
    let Some(face) = header.element("face") else {
        let (found, advice) = if header.element("tristrips").is_some() {
            ("PLY with triangle strips", "convert them to faces")
        } else {
            ("PLY without faces", "build a tree of its points with `--index points`")
        };
        return Err(Error::unsupported(source.path(), found, advice));
    };
    let faces = header.elements[face].clone();
    Roles::of(&source, &faces)?;

    // Everything up to the later of the two elements is scanned once, to find their offsets.
    let mut at = header.body;
    let mut start = at;
    let mut lookup = None;
    let mut bounds = VertexBounds::new();
    for (number, element) in header.elements.iter().enumerate().take(vertex.max(face) + 1) {
        if number == face {
            start = at;
        }
        if number == vertex {
            let (found, end) = vertices(&source, header.encoding, element, at, memory, &mut bounds)?;
            lookup = Some(found);
            at = end;
        } else if number < vertex.max(face) {
            at = offset_after(header.encoding, source.bytes(), at, element)
                .map_err(|fault| corrupt(&source, &element.name, *fault))?;
        }
    }
    let (Some(vertices), Some(bounds)) = (lookup, bounds.get()) else { return Err(source.no_vertices()) };

    let encoding = match header.encoding {
        Encoding::Ascii => "text",
        Encoding::Little => "binary little-endian",
        Encoding::Big => "binary big-endian",
    };
    let info = ModelInfo {
        path: source.path().to_path_buf(),
        format: format!("PLY, {encoding}"),
        faces: Some(faces.count),
        bounds,
        crs: None,
        unit: None,
        step: None,
        parts: vec!["mesh".into()],
        is_grouped: false,
        is_z_up: false,
        attributes: Attributes::default(),
        is_coloured: vertices.table(&source).is_coloured() || faces.colour().is_some(),
        bytes: source.bytes().len() as u64,
    };
    Ok(Box::new(Ply {
        source,
        info,
        encoding: header.encoding,
        vertices,
        faces,
        start,
        degenerate: 0,
        lost_values: 0,
    }))
}

/// Error in an element.
fn corrupt(source: &ModelFile, what: &str, fault: Fault) -> Error {
    source.corrupt(format!("{what}, {}", fault.place), fault.found, fault.expected)
}

/// Checks all vertices and prepares random access to them. Also returns the offset after them.
fn vertices(
    source: &ModelFile,
    encoding: Encoding,
    element: &Element,
    start: usize,
    memory: u64,
    bounds: &mut VertexBounds,
) -> Result<(Lookup, usize)> {
    let [x, y, z] = ["x", "y", "z"].map(|name| element.number(&[name]));
    let (Some(x), Some(y), Some(z)) = (x, y, z) else {
        return Err(source.corrupt(
            "PLY header",
            "vertices without x, y and z",
            "the vertex properties x, y and z",
        ));
    };
    let (position, colour) = ([x, y, z], element.colour());
    if let Some(layout) = layout(encoding, element, position, colour) {
        // The header check has verified the file length only if no element of variable length comes
        // before.
        let length = element.count as usize * layout.stride;
        let bytes = source.bytes();
        let Some(end) = start.checked_add(length).filter(|end| *end <= bytes.len()) else {
            let found = format!("{} bytes", bytes.len() - start);
            return Err(source.corrupt(format!("vertices, byte {start}"), found, format!("{length}")));
        };
        let table = Table::new(&bytes[start..end], layout);
        for number in 0..table.len() {
            source.passed(number);
            let point = table.position(number);
            if !point.iter().all(|coordinate| coordinate.is_finite()) {
                return Err(not_finite(source, number, point));
            }
            bounds.add(point);
        }
        return Ok((Lookup::File(start..end, layout), end));
    }
    let all = CopyVertices { source, element, position, colour, memory, bounds };
    let (vertices, end) = visit(encoding, source.bytes(), start, all)?;
    Ok((Lookup::Store(vertices), end))
}

fn not_finite(source: &ModelFile, number: u64, point: [f64; 3]) -> Error {
    source.corrupt(format!("vertex {number}"), format!("{point:?}"), "finite coordinates")
}

/// Layout of the vertices in the file, if it allows random access.
fn layout(
    encoding: Encoding,
    element: &Element,
    position: [usize; 3],
    colour: Option<[usize; 3]>,
) -> Option<VertexLayout> {
    let stride = element.fixed_size()?;
    let offset = |index: usize| element.properties[..index].iter().map(|p| p.scalar.size()).sum();
    let scalar = |index: usize| element.properties[index].scalar;
    let coordinates = match (scalar(position[0]), encoding) {
        (_, Encoding::Ascii) => return None,
        (Scalar::F32, Encoding::Little) => Coordinates::F32,
        (Scalar::F64, Encoding::Little) => Coordinates::F64,
        (Scalar::F32, Encoding::Big) => Coordinates::F32Big,
        (Scalar::F64, Encoding::Big) => Coordinates::F64Big,
        _ => return None,
    };
    let is_same = position.iter().all(|index| scalar(*index) == scalar(position[0]));
    let has_bytes = colour.iter().flatten().all(|index| scalar(*index) == Scalar::U8);
    (is_same && has_bytes).then(|| VertexLayout {
        stride,
        coordinates,
        position: position.map(offset),
        colour: colour.map(|colour| colour.map(offset)),
    })
}

/// Converts a colour channel to the range 0 to 255. The scalar type determines the file's range.
fn channel(number: f64, scalar: Scalar) -> u8 {
    let range = match scalar {
        Scalar::U8 | Scalar::I8 | Scalar::I32 | Scalar::U32 => 255.0,
        Scalar::I16 | Scalar::U16 => 65535.0,
        Scalar::F32 | Scalar::F64 => 1.0,
    };
    (number / range * 255.0).round() as u8
}

/// Reads vertices into a store; returns it and the offset after the vertices.
struct CopyVertices<'a> {
    source: &'a ModelFile,
    element: &'a Element,
    position: [usize; 3],
    colour: Option<[usize; 3]>,
    memory: u64,
    bounds: &'a mut VertexBounds,
}

impl Visit for CopyVertices<'_> {
    type Output = Result<(Vertices, usize)>;

    fn visit(self, mut body: impl Body) -> Result<(Vertices, usize)> {
        let properties = &self.element.properties;
        let is_single = self.position.iter().all(|index| properties[*index].scalar == Scalar::F32);
        let coordinates = if is_single { Coordinates::F32 } else { Coordinates::F64 };
        let is_coloured = self.colour.is_some();
        let mut vertices = VerticesBuilder::new(self.source.path(), coordinates, is_coloured, self.memory);
        for number in 0..self.element.count {
            self.source.passed(number);
            let (mut point, mut colour) = ([0.0; 3], [0; 3]);
            for (index, property) in properties.iter().enumerate() {
                let corrupt = |fault: Box<Fault>| corrupt(self.source, &format!("vertex {number}"), *fault);
                if property.length.is_some() {
                    body.skip_property(property).map_err(corrupt)?;
                    continue;
                }
                let value = body.number(property.scalar).map_err(corrupt)?;
                if let Some(axis) = self.position.iter().position(|axis| *axis == index) {
                    point[axis] = value;
                } else if let Some(at) = self.colour.iter().flatten().position(|at| *at == index) {
                    colour[at] = channel(value, property.scalar);
                }
            }
            if !point.iter().all(|coordinate| coordinate.is_finite()) {
                return Err(not_finite(self.source, number, point));
            }
            self.bounds.add(point);
            vertices.push(point, colour)?;
        }
        Ok((vertices.finish()?, body.offset()))
    }
}

/// Role of a face property.
#[derive(Clone, Copy)]
enum Role {
    Corners,
    /// Red, green or blue, by index.
    Colour(usize),
    /// Value of the face in a column.
    Value(usize),
    Other,
}

/// Roles of the face properties, in order.
struct Roles(Vec<Role>);

impl Roles {
    fn of(source: &ModelFile, faces: &Element) -> Result<Roles> {
        let names = ["vertex_indices", "vertex_index"];
        let corners = faces
            .properties
            .iter()
            .position(|p| p.length.is_some() && p.scalar.is_whole() && names.contains(&p.name.as_str()));
        let Some(corners) = corners else {
            let expected = "a list of integers named `vertex_indices` or `vertex_index`";
            return Err(source.corrupt("PLY header", "faces without corners", expected));
        };
        let mut roles = vec![Role::Other; faces.properties.len()];
        roles[corners] = Role::Corners;
        for (channel, index) in faces.colour().iter().flatten().enumerate() {
            roles[*index] = Role::Colour(channel);
        }
        for (column, index) in number_columns(faces).into_iter().enumerate() {
            roles[index] = Role::Value(column);
        }
        Ok(Roles(roles))
    }
}

/// Reads faces and passes them on; returns the numbers of degenerate faces and of values that were
/// left out.
struct ReadFaces<'a, 'b> {
    source: &'a ModelFile,
    element: &'a Element,
    vertices: Table<'a>,
    each: &'b mut dyn FnMut(&MeshFace<'_>) -> Result<()>,
}

impl Visit for ReadFaces<'_, '_> {
    type Output = Result<(u64, u64)>;

    fn visit(self, mut body: impl Body) -> Result<(u64, u64)> {
        let roles = Roles::of(self.source, self.element)?.0;
        let columns = number_columns(self.element);
        let name = |index: &usize| self.element.properties[*index].name.as_str();
        let mut numbers = FaceNumbers::of_columns(columns.len());
        let has_face_colours = !self.vertices.is_coloured() && self.element.colour().is_some();
        let mut corners = Corners::default();
        for number in 0..self.element.count {
            self.source.passed(number);
            corners.clear();
            let mut colour = [0; 3];
            let corrupt = |fault: Box<Fault>| corrupt(self.source, &format!("face {number}"), *fault);
            for (role, property) in roles.iter().zip(&self.element.properties) {
                match (role, property.length) {
                    (Role::Corners, Some(length)) => {
                        read_corners(&mut body, length, property.scalar, self.vertices, &mut corners)
                            .map_err(corrupt)?;
                    }
                    (Role::Colour(at), None) => {
                        let value = body.number(property.scalar).map_err(corrupt)?;
                        colour[*at] = channel(value, property.scalar);
                    }
                    (Role::Value(column), None) => {
                        let value = body.number(property.scalar).map_err(corrupt)?;
                        numbers.set(*column, value, property.scalar);
                    }
                    _ => body.skip_property(property).map_err(corrupt)?,
                }
            }
            if has_face_colours {
                corners.paint(colour);
            }
            let values = numbers.values(columns.iter().map(name));
            let each = &mut *self.each;
            corners.hand_out(0, &mut |face| each(&MeshFace { values: &values, ..*face }))?;
        }
        Ok((corners.degenerate, numbers.lost))
    }
}

/// Reads the list of a face's corners.
#[inline]
fn read_corners<B: Body>(
    body: &mut B,
    length: Scalar,
    scalar: Scalar,
    vertices: Table<'_>,
    corners: &mut Corners,
) -> Read<()> {
    let length = body.length(length)?;
    if length > MAX_CORNERS as u64 {
        return Err(body.fault(format!("a face of {length} corners"), "at most 2^20"));
    }
    for _ in 0..length {
        let index = body.whole(scalar)?;
        match u64::try_from(index) {
            Ok(index) if index < vertices.len() => {
                corners.push(vertices.position(index));
                if let Some(colour) = vertices.colour(index) {
                    corners.push_colour(colour);
                }
            }
            _ => {
                let found = format!("vertex {index} of {}", vertices.len());
                return Err(body.fault(found, "the index of a vertex in the file"));
            }
        }
    }
    Ok(())
}

impl Model for Ply {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let (source, element) = (&self.source, &self.faces);
        let vertices = self.vertices.table(source);
        let faces = ReadFaces { source, element, vertices, each };
        (self.degenerate, self.lost_values) = visit(self.encoding, source.bytes(), self.start, faces)?;
        Ok(())
    }

    fn degenerate(&self) -> u64 {
        self.degenerate
    }

    fn lost_values(&self) -> u64 {
        self.lost_values
    }
}
