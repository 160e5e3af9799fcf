//! The triangles of a tile in memory, with a normal and the attribute of the cell behind them at each corner.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use glam::DVec3;

use super::super::sink::{Mesh, Sink, Vertex};
use super::super::{faces, nets};
use crate::query::cell_blocks::{Carry, CellBlocks};
use crate::space::Frame;
use crate::{Progress, Result};

/// Steps of quantised coordinates to a cell, and cells from their origin to that of the tile: enough for the smooth surface,
/// which begins up to two cells before. Tiles side by side have the same lattice, and so meet without cracks.
pub(super) const STEPS: f64 = 512.0;
pub(super) const MARGIN: f64 = 2.0;

/// A corner of triangles.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Corner {
    /// Steps from the tile's origin, less the margin.
    pub(super) at: [u16; 3],
    /// In parts of 127.
    pub(super) normal: [i8; 3],
    pub(super) attribute: u32,
}

/// Triangles of a tile, counterclockwise seen from outside.
#[derive(Default)]
pub(super) struct Surface {
    pub(super) corners: Vec<Corner>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// Makes the surface of the cells of a part.
pub(super) fn surface(blocks: &mut dyn CellBlocks, smooth: bool, with_attribute: bool) -> Result<Surface> {
    let made = Rc::new(RefCell::new(Collecting { with_attribute, ..Collecting::default() }));
    let frame = Frame::identity();
    let mut mesh = Mesh::new(Box::new(Collector(Rc::clone(&made))), &frame, true);
    // Nobody waits for a single tile.
    let quiet: &dyn Progress = &();
    match smooth {
        true => {
            let is_coverage = blocks.carry() == Carry::Coverage;
            nets::write(blocks, is_coverage, &mut mesh, quiet)?;
        }
        false => faces::write(blocks, &mut mesh, quiet)?,
    }
    mesh.finish()?;
    Ok(std::mem::take(&mut made.borrow_mut().surface))
}

/// A surface that is being made.
#[derive(Default)]
struct Collecting {
    with_attribute: bool,
    surface: Surface,
    /// Normals of the smooth surface by vertex.
    normals: Vec<DVec3>,
    known: HashMap<Corner, u32>,
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
            let corner = Corner { at, normal, attribute };
            let next = collecting.surface.corners.len() as u32;
            let number = *collecting.known.entry(corner).or_insert(next);
            if number == next {
                collecting.surface.corners.push(corner);
            }
            number
        });
        // Corners of a sliver may be rounded to one place.
        if triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0] {
            collecting.surface.triangles.push(triangle);
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}
