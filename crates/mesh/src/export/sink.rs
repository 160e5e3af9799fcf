//! Output of vertices and faces.

pub(super) use spinney_base::io::spill::{Spill, failed};

use super::MeshSummary;
use spinney_base::Result;
use spinney_crs::Frame;

/// Vertex that has been written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Vertex {
    /// Index, from 0.
    pub(super) index: u64,
    /// World coordinates.
    pub(super) at: [f64; 3],
}

/// Mesh file being written.
pub(super) trait Sink {
    /// Writes the next vertex.
    fn vertex(&mut self, at: [f64; 3]) -> Result<()>;
    /// Writes the next vertex with a colour, if the format supports vertex colours.
    fn coloured_vertex(&mut self, at: [f64; 3], _colour: [u8; 3]) -> Result<()> {
        self.vertex(at)
    }
    /// Whether vertices of smooth surfaces should have normals.
    fn wants_normals(&self) -> bool {
        false
    }
    /// Sets the normal of the next vertex, in cell coordinates.
    fn normal(&mut self, _normal: [f64; 3]) -> Result<()> {
        Ok(())
    }
    /// Starts a named part to which the following faces belong, if the format supports parts.
    fn part(&mut self, _name: &str) -> Result<()> {
        Ok(())
    }
    /// Sets the material of the following faces, if the format supports materials; without a name,
    /// they have none.
    fn material(&mut self, _name: &str) -> Result<()> {
        Ok(())
    }
    /// Sets the numbers of the next face, if the format supports them.
    fn numbers(&mut self, _numbers: &[f64]) {}
    /// Writes a face, counterclockwise seen from outside, with the attribute of its cell.
    fn face(&mut self, corners: &[Vertex], attribute: u32) -> Result<()>;
    /// Completes the file and publishes it under its name: see [`Output::commit`].
    fn finish(self: Box<Self>) -> Result<()>;
}

/// Converts a mesh from cell coordinates to world coordinates and writes it to a sink.
pub(super) struct Mesh<'a> {
    sink: Box<dyn Sink>,
    frame: &'a Frame,
    /// Whether the frame is a reflection, which inverts the orientation of faces.
    mirrored: bool,
    /// Whether faces must be triangles.
    pub(super) triangles: bool,
    summary: MeshSummary,
    ring: Vec<Vertex>,
}

impl<'a> Mesh<'a> {
    pub(super) fn new(sink: Box<dyn Sink>, frame: &'a Frame, triangles: bool) -> Mesh<'a> {
        let mirrored = frame.linear().determinant() < 0.0;
        Mesh { sink, frame, mirrored, triangles, summary: MeshSummary::default(), ring: Vec::new() }
    }

    /// Starts a named part to which the following faces belong.
    pub(super) fn part(&mut self, name: &str) -> Result<()> {
        self.sink.part(name)
    }

    /// Writes a vertex at a point in cell coordinates.
    pub(super) fn vertex(&mut self, cells: [f64; 3]) -> Result<Vertex> {
        let vertex = Vertex { index: self.summary.vertices, at: self.frame.to_world(cells) };
        self.sink.vertex(vertex.at)?;
        self.summary.vertices += 1;
        Ok(vertex)
    }

    /// Whether vertices of smooth surfaces should have normals.
    pub(super) fn wants_normals(&self) -> bool {
        self.sink.wants_normals()
    }

    /// Writes the normal of the next vertex, in cell coordinates.
    pub(super) fn normal(&mut self, normal: [f64; 3]) -> Result<()> {
        self.sink.normal(normal)
    }

    /// Writes a face, counterclockwise in cell coordinates, without triangulating it.
    pub(super) fn face(&mut self, corners: impl Iterator<Item = Vertex>, attribute: u32) -> Result<()> {
        self.ring.clear();
        self.ring.extend(corners);
        if self.mirrored {
            self.ring.reverse();
        }
        self.summary.faces += 1;
        self.sink.face(&self.ring, attribute)
    }

    pub(super) fn finish(self) -> Result<MeshSummary> {
        self.sink.finish()?;
        Ok(self.summary)
    }
}
