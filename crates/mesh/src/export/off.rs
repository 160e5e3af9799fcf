//! OFF, text format.

use std::io::Write;

use super::FaceAttribute;
use super::sink::{Sink, Spill, Vertex, failed};
use spinney_base::Result;
use spinney_base::io::Output;

/// OFF output. The header has the numbers of vertices and faces, so both are buffered in temporary
/// files.
pub(super) struct Off {
    output: Output,
    has_face_colours: bool,
    has_vertex_colours: bool,
    vertices: u64,
    faces: u64,
    vertex_spill: Spill,
    face_spill: Spill,
}

impl Off {
    /// Starts a file. Of attributes, OFF stores only colours, of either faces or vertices.
    pub(super) fn new(output: Output, attribute: FaceAttribute, has_vertex_colours: bool) -> Result<Off> {
        let (vertex_spill, face_spill) = (Spill::new(&output)?, Spill::new(&output)?);
        let has_face_colours = attribute == FaceAttribute::Colour;
        let (vertices, faces) = (0, 0);
        Ok(Off { output, has_face_colours, has_vertex_colours, vertices, faces, vertex_spill, face_spill })
    }
}

impl Sink for Off {
    fn vertex(&mut self, [x, y, z]: [f64; 3]) -> Result<()> {
        self.vertices += 1;
        self.vertex_spill.write(format!("{x} {y} {z}\n").as_bytes())
    }

    fn coloured_vertex(&mut self, [x, y, z]: [f64; 3], [red, green, blue]: [u8; 3]) -> Result<()> {
        self.vertices += 1;
        self.vertex_spill.write(format!("{x} {y} {z} {red} {green} {blue} 255\n").as_bytes())
    }

    fn face(&mut self, corners: &[Vertex], attribute: u32) -> Result<()> {
        self.faces += 1;
        let mut line = corners.len().to_string();
        for corner in corners {
            line.push(' ');
            line.push_str(&corner.index.to_string());
        }
        if self.has_face_colours {
            let [_, red, green, blue] = attribute.to_be_bytes();
            line.push_str(&format!(" {red} {green} {blue}"));
        }
        line.push('\n');
        self.face_spill.write(line.as_bytes())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let Off { mut output, has_vertex_colours, vertices, faces, vertex_spill, face_spill, .. } = *self;
        let keyword = if has_vertex_colours { "COFF" } else { "OFF" };
        // The third number is the edge count, which readers ignore.
        let header = format!("{keyword}\n# made by spinney\n{vertices} {faces} 0\n");
        let path = output.path().to_path_buf();
        output.write_all(header.as_bytes()).map_err(failed(&path))?;
        vertex_spill.copy_to(&mut output)?;
        face_spill.copy_to(&mut output)?;
        output.commit()
    }
}
