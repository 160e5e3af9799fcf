//! In-memory sink: vertices and triangles as arrays.

use std::cell::RefCell;
use std::mem;
use std::rc::Rc;

use super::sink::{Sink, Vertex};
use spinney_base::{Error, Result};

/// Triangle surface, counterclockwise seen from outside or from above.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceMesh {
    /// World coordinates of the vertices.
    pub vertices: Vec<[f64; 3]>,
    /// Vertex indices of the triangles, from 0.
    pub triangles: Vec<[u32; 3]>,
}

/// Sink that collects the surface in memory.
pub(super) struct Arrays(Rc<RefCell<SurfaceMesh>>);

impl Arrays {
    /// Returns an empty sink and a handle to the surface that it collects.
    pub(super) fn new() -> (Arrays, Rc<RefCell<SurfaceMesh>>) {
        let made = Rc::default();
        (Arrays(Rc::clone(&made)), made)
    }

    pub(super) fn take(made: Rc<RefCell<SurfaceMesh>>) -> SurfaceMesh {
        mem::take(&mut made.borrow_mut())
    }
}

impl Sink for Arrays {
    fn vertex(&mut self, at: [f64; 3]) -> Result<()> {
        self.0.borrow_mut().vertices.push(at);
        Ok(())
    }

    fn face(&mut self, corners: &[Vertex], _: u32) -> Result<()> {
        let number = |corner: &Vertex| {
            let too_many =
                |_| Error::invalid("mesh", "more than 2^32 vertices", "at most 2^32; choose a coarser level");
            u32::try_from(corner.index).map_err(too_many)
        };
        let numbers = corners.iter().map(number).collect::<Result<Vec<u32>>>()?;
        // (Sinks that request triangles receive only triangles.)
        let triangles = numbers.chunks_exact(3).map(|triangle| [triangle[0], triangle[1], triangle[2]]);
        self.0.borrow_mut().triangles.extend(triangles);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}
