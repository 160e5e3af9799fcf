//! A tile's triangles in memory, with a normal and the attribute of the cell behind them at each corner.

use std::cell::RefCell;
use std::rc::Rc;

use glam::DVec3;

use super::super::sink::{Mesh, Sink, Vertex};
use super::super::{Surface, write_surface};
use spinney_base::Result;
use spinney_crs::Frame;
use spinney_engine::query::cell_blocks::CellBlocks;

/// Steps of quantised coordinates to a cell, and cells from their origin to that of the tile: enough for the smooth surface,
/// which begins up to two cells before. Tiles side by side have the same lattice, and so meet without cracks.
pub(super) const STEPS: f64 = 512.0;
pub(super) const MARGIN: f64 = 2.0;

/// A corner of triangles.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct TileCorner {
    /// Steps from the tile's origin, less the margin.
    pub(super) at: [u16; 3],
    /// In parts of 127.
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
    /// The surface of a tile's cells.
    pub(super) fn of(cells: &mut dyn CellBlocks, smooth: bool, with_attribute: bool) -> Result<TileMesh> {
        let made = Rc::new(RefCell::new(Collecting { with_attribute, ..Collecting::default() }));
        let frame = Frame::identity();
        let mesh = Mesh::new(Box::new(Collector(Rc::clone(&made))), &frame, true);
        // Nobody waits for a single tile.
        let surface = if smooth { Surface::Smooth { margin: 1.0 / STEPS } } else { Surface::Faces };
        write_surface(cells, mesh, surface, &())?;
        Ok(std::mem::take(&mut made.borrow_mut().mesh))
    }

    /// The attributes of the corners.
    pub(super) fn attributes(&self) -> impl Iterator<Item = u32> {
        self.corners.iter().map(|corner| corner.attribute)
    }

    /// About as many bytes as it has in a file.
    pub(super) fn bytes(&self) -> usize {
        24 * self.corners.len() + 12 * self.triangles.len()
    }
}

/// A surface that is being made.
#[derive(Default)]
struct Collecting {
    with_attribute: bool,
    mesh: TileMesh,
    /// Vertices of the surface, and the last corner that each has become: a vertex has a corner for each of its normals and
    /// attributes.
    vertices: Vec<TileVertex>,
    /// Corners before those of the mesh, of the same vertex each.
    before: Vec<Option<u32>>,
    /// The normal of the next vertex.
    normal: Option<[i8; 3]>,
}

struct TileVertex {
    at: [u16; 3],
    /// If it is not that of its faces.
    normal: Option<[i8; 3]>,
    last: Option<u32>,
}

impl Collecting {
    /// The corner of a vertex in a face, whose normal is asked for if it has none of its own.
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
        // (To the nearest: there are none below zero.)
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
        // Corners of a sliver may be rounded to one place.
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

/// A normal in parts of 127.
fn quantised(normal: DVec3) -> [i8; 3] {
    // (To the nearest, by way of numbers above zero.)
    normal.to_array().map(|number| ((number * 127.0 + 128.5) as i16 - 128) as i8)
}
