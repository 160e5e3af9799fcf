//! All cells of a view's block at once. In blocks full of detail, reading the source around the
//! block and picking cells is faster than classifying node by node.

use glam::DVec3;
use zerocopy::FromBytes;

use super::map::AffineMap;
use super::view::{TINY, View};
use crate::store::records::{Record, RecordLayout, with_record_type};
use crate::tree::{CellBlock, Source};
use spinney_base::Result;
use spinney_base::array;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::DataKind;

/// Maximum number of source cells that are read per cell of a block. If a view covers more of the
/// source, classifying node by node skips irrelevant cells.
const MAX_DRAWN: u64 = 6;

/// Cells of a small block, as a power of two: 32 x 32, or 8 x 8 x 8.
const SMALL_BITS: u8 = 10;

/// Box of cells: first cell, and end (exclusive).
type Cells = ([i64; 3], [i64; 3]);

/// Raster of the source region that a block covers.
struct DrawnBox {
    bounds: Bounds,
    values: Vec<u8>,
    valid: Vec<bool>,
}

impl View {
    /// Cells below an INNER node, in rows, if reading them is worth it and the source supports it.
    pub(super) fn draw_block(&self, code: Code, levels: u8) -> Result<Option<CellBlock>> {
        let size = levels * self.form.axes() as u8;
        // (Large blocks only if cells are copied and hardly two are equal: other data have uniform
        // regions that need no check of each cell.)
        let is_continuous = self.source.header().kind == DataKind::Continuous;
        let is_worth_it = size == SMALL_BITS - SMALL_BITS % self.form.axes() as u8
            || size > SMALL_BITS && is_continuous && self.lookup.to_source.keeps_cells();
        if !is_worth_it || self.lookup.by_area || !self.lookup.askew.is_empty() {
            return Ok(None);
        }
        let (first, shown) = self.shown_cells(code, levels);
        let bounds = self.source_box(&shown);
        let cells = self.form.dimension.cells(levels);
        let drawn = bounds.volume();
        if drawn == 0 || drawn > MAX_DRAWN * cells {
            return Ok(None);
        }
        let width = self.form.width();
        let (mut values, mut valid) = (vec![0; drawn as usize * width], vec![false; drawn as usize]);
        if !self.source.draw(&bounds, &mut values, &mut valid)? {
            return Ok(None);
        }
        let drawn = DrawnBox { bounds, values, valid };
        let mut block = CellBlock::void(cells as usize, width);
        let to_source = &self.lookup.to_source;
        with_record_type!(RecordLayout::new(self.form), R => {
            pick_cells::<R>(to_source, (first, &shown), levels, &drawn, &mut block);
        });
        Ok(Some(block))
    }

    /// First cell of a node, and the box of its shown cells.
    fn shown_cells(&self, code: Code, levels: u8) -> ([i64; 3], Cells) {
        let axes = self.form.axes();
        let side = 1i64 << levels;
        let cell = code.cell().map(|cell| i64::from(cell) << levels);
        let first: [i64; 3] = array::from_fn(|axis| if axis < axes { cell[axis] } else { 0 });
        let start = array::from_fn(|axis| first[axis].max(self.lookup.shown.0[axis] as i64));
        let end = array::from_fn(|axis| {
            let end = if axis < axes { first[axis] + side } else { 1 };
            end.min(self.lookup.shown.1[axis] as i64)
        });
        (first, (start, end))
    }

    /// Visible source cells that the centres of some cells can fall into.
    fn source_box(&self, (start, end): &Cells) -> Bounds {
        let (low, high) =
            self.lookup.to_source.bounding_box(centre(*start), centre(end.map(|cell| cell - 1)));
        let (low, high) = ((low - TINY).floor().to_array(), (high + TINY).floor().to_array());
        let (visible_start, visible_end) = self.lookup.visible;
        let mut bounds = Bounds { min: [0; 3], max: [1; 3] };
        for axis in 0..self.form.axes() {
            bounds.min[axis] = (low[axis] as i64).max(visible_start[axis]) as u64;
            bounds.max[axis] =
                ((high[axis] as i64 + 1).min(visible_end[axis]).max(0) as u64).max(bounds.min[axis]);
        }
        bounds
    }
}

/// Centre of a cell.
fn centre(cell: [i64; 3]) -> DVec3 {
    DVec3::from(array::map(cell, |cell| cell as f64)) + DVec3::splat(0.5)
}

/// Copies the source cells at the centres of the shown cells. Cells outside of the drawn raster
/// stay VOID.
fn pick_cells<R: Record>(
    to_source: &AffineMap,
    (first, (start, end)): ([i64; 3], &Cells),
    levels: u8,
    drawn: &DrawnBox,
    block: &mut CellBlock,
) {
    let from = <[R::Bytes]>::ref_from_bytes(&drawn.values).expect("a value for each cell");
    let to = <[R::Bytes]>::mut_from_bytes(&mut block.values).expect("a value for each cell");
    let valid = &drawn.valid[..from.len()];
    let present = &mut block.present[..to.len()];
    let size = array::map(drawn.bounds.size(), |size| size as i64);
    let origin = array::map(drawn.bounds.min, |cell| cell as i64);
    let strides = [1, size[0], size[0] * size[1]];
    let matrix = &to_source.0;
    let along_x = matrix.matrix3.x_axis;
    // A map that takes cells to cells moves by a fixed integer number of drawn cells per cell along
    // x.
    let step = along_x.to_array();
    let step =
        to_source.keeps_cells().then(|| (0..3).map(|axis| step[axis] as i64 * strides[axis]).sum::<i64>());
    // Index of the drawn cell that contains a point.
    let index_of = |point: DVec3| -> Option<i64> {
        let mut index = 0;
        for axis in 0..R::AXES {
            let cell = floor(point[axis]) - origin[axis];
            // (A negative number is too large as an unsigned one.)
            if cell as u64 >= size[axis] as u64 {
                return None;
            }
            index += cell * strides[axis];
        }
        Some(index)
    };
    let width = (end[0] - start[0]) as usize;
    for z in start[2]..end[2] {
        for y in start[1]..end[1] {
            let row = (((z - first[2]) << levels | (y - first[1])) << levels) + start[0] - first[0];
            let row = row as usize..row as usize + width;
            let (to, present) = (&mut to[row.clone()], &mut present[row]);
            let row_start = matrix.transform_point3(centre([start[0], y, z]));
            // A box is convex: it contains a whole row if it contains both ends. The cells between
            // need no test.
            if let (Some(step), Some(there)) = (step, index_of(row_start))
                && index_of(row_start + along_x * (width as i64 - 1) as f64).is_some()
            {
                if step == 1 {
                    let there = there as usize..there as usize + width;
                    to.copy_from_slice(&from[there.clone()]);
                    present.copy_from_slice(&valid[there]);
                    continue;
                }
                for (i, (to, present)) in (0..).zip(to.iter_mut().zip(present)) {
                    let there = (there + step * i) as usize;
                    (*to, *present) = (from[there], valid[there]);
                }
                continue;
            }
            for (i, (to, present)) in to.iter_mut().zip(present).enumerate() {
                if let Some(there) = index_of(row_start + along_x * i as f64) {
                    (*to, *present) = (from[there as usize], valid[there as usize]);
                }
            }
        }
    }
}

/// Largest integer not above `number`. `f64::floor` is a function call on targets without an
/// instruction for it.
#[inline]
fn floor(number: f64) -> i64 {
    let whole = number as i64;
    whole - i64::from(number < whole as f64)
}
