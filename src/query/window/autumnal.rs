//! Windows of Autumnal files.

use super::source::Canvas;
use crate::space::Bounds;
use crate::store::autumnal::Autumnal;
use crate::store::goblin::Layout;
use crate::value::Value;
use crate::{Error, Result};

impl<D: Layout, V: Value> Autumnal<D, V> {
    /// Writes the values of a box of cells of `level` to `values`, as they stand on disk: x fastest, then y, then z. VOID
    /// cells, and cells outside the tree's space, become `fill`, and `false` in `valid` if that is given.
    ///
    /// Takes time proportional to the cells of the box that differ from their neighbours, whatever lies below them.
    ///
    /// # Errors
    /// If the file is damaged there, `level` is deeper than the tree, or a buffer has not one item per cell.
    pub fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: V,
        values: &mut [V::Wire],
        valid: Option<&mut [bool]>,
    ) -> Result<()> {
        let depth = self.header().shape.depth;
        if level > depth {
            return Err(Error::invalid("level", level.to_string(), format!("0 to {depth}")));
        }
        let mut canvas = Canvas::new(bounds, fill, values, valid)?;
        self.blocks(level, bounds, |min, size, value| canvas.paint(min, size, value))
    }
}
