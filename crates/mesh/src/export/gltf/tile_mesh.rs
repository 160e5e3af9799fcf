//! A tile's triangles in memory, with a normal and the attribute of the cell at each corner.

use std::cell::RefCell;
use std::rc::Rc;

use glam::DVec3;

use super::super::sink::{Mesh, Sink, Vertex};
use super::super::{Surface, write_surface};
use spinney_base::Result;
use spinney_crs::Frame;
use spinney_engine::query::cell_blocks::CellBlocks;

/// Quantization units per cell, and cells from the quantization origin to the tile's origin. The
/// margin suffices for the smooth surface, which starts up to two cells before the tile. Adjacent
/// tiles share a lattice and so meet without cracks.
pub(super) const STEPS: f64 = 512.0;
pub(super) const MARGIN: f64 = 2.0;

/// Corner of triangles.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct TileCorner {
    /// Quantization units from the quantization origin, which is the tile's origin minus the
    /// margin.
    pub(super) at: [u16; 3],
    /// In units of 1/127.
    pub(super) normal: [i8; 3],
    pub(super) attribute: u32,
}

/// Triangles of a tile, counterclockwise seen from outside.
#[derive(Default)]
pub(super) struct TileMesh {
    pub(super) corners: Vec<TileCorner>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl TileMesh {
    /// Surface of a tile's cells.
    pub(super) fn of(cells: &mut dyn CellBlocks, smooth: bool, with_attribute: bool) -> Result<TileMesh> {
        let made = Rc::new(RefCell::new(Collecting { with_attribute, ..Collecting::default() }));
        let frame = Frame::identity();
        let mesh = Mesh::new(Box::new(Collector(Rc::clone(&made))), &frame, true);
        // A single tile needs no progress and no cancellation.
        let surface = if smooth { Surface::Smooth { margin: 1.0 / STEPS } } else { Surface::Faces };
        write_surface(cells, mesh, surface, &())?;
        Ok(std::mem::take(&mut made.borrow_mut().mesh))
    }

    /// Attributes of the corners.
    pub(super) fn attributes(&self) -> impl Iterator<Item = u32> {
        self.corners.iter().map(|corner| corner.attribute)
    }

    /// Approximate size in a file, in bytes.
    pub(super) fn bytes(&self) -> usize {
        24 * self.corners.len() + 12 * self.triangles.len()
    }
}

/// Surface under construction.
#[derive(Default)]
struct Collecting {
    with_attribute: bool,
    mesh: TileMesh,
    /// Vertices of the surface, each with the last of its corners. A vertex has a corner for each
    /// combination of normal and attribute.
    vertices: Vec<TileVertex>,
    /// Previous corner of the same vertex, by corner.
    before: Vec<Option<u32>>,
    /// Normal of the next vertex.
    normal: Option<[i8; 3]>,
}

struct TileVertex {
    at: [u16; 3],
    /// Normal of the vertex; `None` if the normals of the faces apply.
    normal: Option<[i8; 3]>,
    last: Option<u32>,
}

impl Collecting {
    /// Corner of a vertex in a face. `flat` computes the face normal if the vertex has no normal.
    fn corner(&mut self, vertex: usize, flat: impl FnOnce() -> [i8; 3], attribute: u32) -> u32 {
        let TileVertex { at, normal, last } = &mut self.vertices[vertex];
        let corner = TileCorner { at: *at, normal: normal.unwrap_or_else(flat), attribute };
        let mut known = *last;
        while let Some(number) = known {
            if self.mesh.corners[number as usize] == corner {
                return number;
            }
            known = self.before[number as usize];
        }
        let number = self.mesh.corners.len() as u32;
        self.mesh.corners.push(corner);
        self.before.push(last.replace(number));
        number
    }
}

struct Collector(Rc<RefCell<Collecting>>);

impl Sink for Collector {
    fn vertex(&mut self, at: [f64; 3]) -> Result<()> {
        let collecting = &mut *self.0.borrow_mut();
        // (Rounds to nearest: values are not negative.)
        let at = at.map(|cells| ((cells + MARGIN) * STEPS + 0.5) as u16);
        let normal = collecting.normal.take();
        collecting.vertices.push(TileVertex { at, normal, last: None });
        Ok(())
    }

    fn wants_normals(&self) -> bool {
        true
    }

    fn normal(&mut self, normal: [f64; 3]) -> Result<()> {
        let normal = DVec3::from(normal);
        self.0.borrow_mut().normal = (normal != DVec3::ZERO).then(|| quantised(normal));
        Ok(())
    }

    fn face(&mut self, corners: &[Vertex], attribute: u32) -> Result<()> {
        let collecting = &mut *self.0.borrow_mut();
        // Corners of slivers may be rounded to the same point.
        let [a, b, c] = [0, 1, 2].map(|corner: usize| collecting.vertices[corners[corner].index as usize].at);
        if a == b || b == c || c == a {
            return Ok(());
        }
        let attribute = if collecting.with_attribute { attribute } else { 0 };
        let flat = || {
            let [a, b, c] = [0, 1, 2].map(|corner: usize| DVec3::from(corners[corner].at));
            quantised((b - a).cross(c - a).normalize_or_zero())
        };
        let triangle =
            [0, 1, 2].map(|corner: usize| collecting.corner(corners[corner].index as usize, flat, attribute));
        collecting.mesh.triangles.push(triangle);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}

/// Normal in units of 1/127.
fn quantised(normal: DVec3) -> [i8; 3] {
    // (Rounds to nearest; the offset avoids negative values.)
    normal.to_array().map(|number| ((number * 127.0 + 128.5) as i16 - 128) as i8)
}
