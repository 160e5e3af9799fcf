//! A tile's triangles in memory, with a normal and the attribute of the cell behind them at each corner.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use glam::DVec3;

use super::super::sink::{Mesh, Sink, Vertex};
use super::super::write_surface;
use crate::Result;
use crate::query::cell_blocks::CellBlocks;
use crate::space::Frame;

/// Steps of quantised coordinates to a cell, and cells from their origin to that of the tile: enough for the smooth surface,
/// which begins up to two cells before. Tiles side by side have the same lattice, and so meet without cracks.
pub(super) const STEPS: f64 = 512.0;
pub(super) const MARGIN: f64 = 2.0;

/// A corner of triangles.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
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
        write_surface(cells, mesh, smooth, &())?;
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
    /// Normals of the smooth surface by vertex.
    normals: Vec<DVec3>,
    known: HashMap<TileCorner, u32>,
}

struct Collector(Rc<RefCell<Collecting>>);

impl Sink for Collector {
    fn vertex(&mut self, _: [f64; 3]) -> Result<()> {
        Ok(())
    }

    fn smooth_vertex(&mut self, _: [f64; 3], normal: [f64; 3]) -> Result<()> {
        self.0.borrow_mut().normals.push(normal.into());
        Ok(())
    }

    fn face(&mut self, corners: &[Vertex], attribute: u32) -> Result<()> {
        let collecting = &mut *self.0.borrow_mut();
        let [a, b, c] = [0, 1, 2].map(|corner| DVec3::from(corners[corner].at));
        let flat = (b - a).cross(c - a).normalize_or_zero();
        let attribute = if collecting.with_attribute { attribute } else { 0 };
        let triangle = [0, 1, 2].map(|corner: usize| {
            let Vertex { index, at } = corners[corner];
            let smooth =
                collecting.normals.get(index as usize).copied().filter(|normal| *normal != DVec3::ZERO);
            let normal = (smooth.unwrap_or(flat) * 127.0).round().to_array().map(|number| number as i8);
            let at = at.map(|cells| ((cells + MARGIN) * STEPS).round() as u16);
            let corner = TileCorner { at, normal, attribute };
            let next = collecting.mesh.corners.len() as u32;
            let number = *collecting.known.entry(corner).or_insert(next);
            if number == next {
                collecting.mesh.corners.push(corner);
            }
            number
        });
        // Corners of a sliver may be rounded to one place.
        if triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0] {
            collecting.mesh.triangles.push(triangle);
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}
