//! Windows of Autumnal files.

use super::source::{Canvas, with_width};
use crate::Result;
use crate::query::check_level;
use crate::space::Bounds;
use crate::store::autumnal::Autumnal;
use crate::value::Value;

impl Autumnal {
    /// Writes the values of a box of cells of `level` to `values`, as they stand on disk: x fastest, then y,
    /// then z. VOID cells, and cells outside the tree's space, become `fill`, and `false` in `valid` if that
    /// is given.
    ///
    /// Takes time proportional to the cells of the box that differ from their neighbours, whatever lies below
    /// them.
    ///
    /// # Errors
    /// If the file is damaged there, `level` is deeper than the tree, or a buffer has not the bytes of one
    /// value, or not one flag, per cell.
    pub fn window(
        &self,
        level: u8,
        bounds: &Bounds,
        fill: Value,
        values: &mut [u8],
        valid: Option<&mut [bool]>,
    ) -> Result<()> {
        check_level(level, self.header().depth())?;
        let form = self.header().form;
        let mut canvas = Canvas::new(form, bounds, fill, values, valid)?;
        with_width!(form.width(), WIDTH => {
            let mut cells = canvas.cells::<WIDTH>();
            self.blocks(level, bounds, |min, size, value| cells.paint(min, size, value))
        })
    }
}
