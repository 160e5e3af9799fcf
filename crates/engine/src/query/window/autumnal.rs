//! Windows of Autumnal files.

use super::check_buffers;
use super::painter::{Painter, bytes_of};
use crate::query::check_level;
use crate::store::autumnal::{Autumnal, BoxContent};
use crate::store::records::{Record, RecordLayout, with_record_type};
use spinney_base::Result;
use spinney_base::space::Bounds;
use spinney_base::value::Value;

impl Autumnal {
    /// Writes the values of a box of cells of `level` to `values` in their stored form: x fastest,
    /// then y, then z. VOID cells, and cells outside of the tree's space, become `fill`, and
    /// `false` in `valid` if that is given.
    ///
    /// The time is proportional to the cells of the box that differ from their neighbours, whatever
    /// is below them.
    ///
    /// # Errors
    /// If the file is corrupt there, if `level` is deeper than the tree, or if a buffer does not
    /// have one value, or one flag, per cell.
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
        check_buffers(form.value, bounds, values, valid.as_deref())?;
        with_record_type!(RecordLayout::new(form), R => {
            self.paint(level, &mut Painter::<R>::new(*bounds, fill, values, valid))
        })
    }

    /// Draws a whole window, for a record type of known value width.
    fn paint<R: Record>(&self, level: u8, painter: &mut Painter<'_, R>) -> Result<()> {
        painter.clear();
        let bounds = painter.bounds;
        self.visit_contents(level, &bounds, &mut |space, content| match content {
            BoxContent::Uniform(value) => {
                let part = space.intersect(&bounds);
                if !part.is_empty() {
                    painter.paint(&part, Some(bytes_of::<R>(value)));
                }
                Ok(())
            }
            BoxContent::Records(records, levels, bad_run) => {
                painter.run(R::of(records), 0, levels - 1, space.min).map_err(|_| bad_run())
            }
        })
    }
}
