//! PLY, binary little-endian.

use std::io::Write;

use super::sink::{Sink, Spill, Vertex, failed};
use spinney_base::io::Output;
use spinney_base::{Error, Result};

/// Face property: an attribute of the cell that the face belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaceAttribute {
    /// No property.
    None,
    /// Colour: properties `red`, `green`, `blue`.
    Colour,
    /// Value of one byte: property `value`.
    Byte,
    /// Value of two bytes: property `value`.
    Short,
    /// Value of the face's isosurface, as the bits of an f32: property `level`.
    Level,
}

/// Numeric type of a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum PropertyType {
    /// `int`: 32 bits.
    Int,
    /// `double`.
    Double,
}

/// Named property of faces: a number.
#[derive(Clone, Debug)]
pub(super) struct FaceProperty {
    pub(super) name: String,
    pub(super) number: PropertyType,
}

/// PLY output. The header has the numbers of vertices and faces, so both are buffered in temporary
/// files.
pub(super) struct Ply {
    output: Output,
    attribute: FaceAttribute,
    double: bool,
    has_vertex_colours: bool,
    vertices: u64,
    faces: u64,
    vertex_spill: Spill,
    face_spill: Spill,
    bytes: Vec<u8>,
    properties: Vec<FaceProperty>,
    /// Numbers of the next face, one for each of the properties.
    numbers: Vec<f64>,
}

impl Ply {
    /// Starts a file with coordinates in double or in single precision.
    pub(super) fn new(output: Output, attribute: FaceAttribute, double: bool) -> Result<Ply> {
        let (vertex_spill, face_spill) = (Spill::new(&output)?, Spill::new(&output)?);
        Ok(Ply {
            output,
            attribute,
            double,
            has_vertex_colours: false,
            vertices: 0,
            faces: 0,
            vertex_spill,
            face_spill,
            bytes: Vec::new(),
            properties: Vec::new(),
            numbers: Vec::new(),
        })
    }

    /// Adds properties of faces, whose numbers are given before each face.
    pub(super) fn with_properties(self, properties: Vec<FaceProperty>) -> Ply {
        Ply { numbers: vec![0.0; properties.len()], properties, ..self }
    }

    /// Starts a file with coordinates in double precision, which may have colours of vertices.
    pub(super) fn of_model(
        output: Output,
        attribute: FaceAttribute,
        has_vertex_colours: bool,
    ) -> Result<Ply> {
        Ok(Ply { has_vertex_colours, ..Ply::new(output, attribute, true)? })
    }

    fn header(&self) -> String {
        let number = if self.double { "double" } else { "float" };
        // Some readers support only signed indices, so they are declared as such while they fit.
        let index = if self.vertices > i32::MAX as u64 { "uint" } else { "int" };
        let colour = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
        let of_vertices = if self.has_vertex_colours { colour } else { "" };
        let attribute = match self.attribute {
            FaceAttribute::None => "",
            FaceAttribute::Colour => colour,
            FaceAttribute::Byte => "property uchar value\n",
            FaceAttribute::Short => "property ushort value\n",
            FaceAttribute::Level => "property float level\n",
        };
        let line = |property: &FaceProperty| {
            let number = if property.number == PropertyType::Int { "int" } else { "double" };
            format!("property {number} {}\n", property.name)
        };
        let properties: String = self.properties.iter().map(line).collect();
        format!(
            "ply\nformat binary_little_endian 1.0\ncomment made by spinney\nelement vertex {}\n\
             property {number} x\nproperty {number} y\nproperty {number} z\n{of_vertices}element face {}\n\
             property list uchar {index} vertex_indices\n{attribute}{properties}end_header\n",
            self.vertices, self.faces
        )
    }
}

impl Sink for Ply {
    fn vertex(&mut self, at: [f64; 3]) -> Result<()> {
        if self.vertices > u64::from(u32::MAX) {
            let advice = "write a coarser level, or parts of the tree (--view window=...)";
            return Err(Error::unsupported(
                self.output.path(),
                "a PLY file of more than 2^32 vertices",
                advice,
            ));
        }
        self.vertices += 1;
        self.bytes.clear();
        for number in at {
            if self.double {
                self.bytes.extend(number.to_le_bytes());
            } else {
                self.bytes.extend((number as f32).to_le_bytes());
            }
        }
        self.vertex_spill.write(&self.bytes)
    }

    fn coloured_vertex(&mut self, at: [f64; 3], colour: [u8; 3]) -> Result<()> {
        self.vertex(at)?;
        self.vertex_spill.write(&colour)
    }

    fn numbers(&mut self, numbers: &[f64]) {
        self.numbers.copy_from_slice(numbers);
    }

    fn face(&mut self, corners: &[Vertex], attribute: u32) -> Result<()> {
        self.faces += 1;
        self.bytes.clear();
        self.bytes.push(corners.len() as u8); // a ring around 32 x 32 cells has at most 128 points
        for corner in corners {
            self.bytes.extend((corner.index as u32).to_le_bytes());
        }
        match self.attribute {
            FaceAttribute::None => {}
            FaceAttribute::Colour => self.bytes.extend(&attribute.to_be_bytes()[1..]),
            FaceAttribute::Byte => self.bytes.push(attribute as u8),
            FaceAttribute::Short => self.bytes.extend((attribute as u16).to_le_bytes()),
            FaceAttribute::Level => self.bytes.extend(attribute.to_le_bytes()),
        }
        for (property, number) in self.properties.iter().zip(&self.numbers) {
            match property.number {
                PropertyType::Int => self.bytes.extend((*number as i32).to_le_bytes()),
                PropertyType::Double => self.bytes.extend(number.to_le_bytes()),
            }
        }
        self.face_spill.write(&self.bytes)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let header = self.header();
        let Ply { mut output, vertex_spill, face_spill, .. } = *self;
        let path = output.path().to_path_buf();
        output.write_all(header.as_bytes()).map_err(failed(&path))?;
        vertex_spill.copy_to(&mut output)?;
        face_spill.copy_to(&mut output)?;
        output.commit()
    }
}
