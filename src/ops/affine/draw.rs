//! All cells of a block of a view at once: where a block is full of detail, drawing the source around it and
//! picking cells is faster than deciding node by node.

use glam::DVec3;
use zerocopy::FromBytes;

use super::map::Map;
use super::view::{TINY, View};
use crate::Result;
use crate::space::{Bounds, Code, morton_encode};
use crate::store::container::{Record, RecordLayout, with_record_type};
use crate::tree::{CellBlock, Source};

/// Source cells that are drawn for each cell of a block, at most; where a view shows much more of the source,
/// deciding node by node skips what does not count.
const MOST_DRAWN: u64 = 6;

/// Cells along each axis, from a first one up to, not including, a last.
type Cells = ([i64; 3], [i64; 3]);

/// A picture of the part of the source that a block shows.
struct Drawn {
    bounds: Bounds,
    values: Vec<u8>,
    valid: Vec<bool>,
}

impl View {
    /// The cells below an INNER node, in Z order, if drawing them is worth it and the source can.
    pub(super) fn draw_block(&self, code: Code, levels: u8) -> Result<Option<CellBlock>> {
        if self.lookup.by_area || !self.lookup.askew.is_empty() {
            return Ok(None);
        }
        let (first, shown) = self.shown_cells(code, levels);
        let bounds = self.source_box(&shown);
        let cells = self.form.dimension.cells(levels);
        let drawn = bounds.volume();
        if drawn == 0 || drawn > MOST_DRAWN * cells {
            return Ok(None);
        }
        let width = self.form.width();
        let (mut values, mut valid) = (vec![0; drawn as usize * width], vec![false; drawn as usize]);
        if !self.source.draw(&bounds, &mut values, &mut valid)? {
            return Ok(None);
        }
        let drawn = Drawn { bounds, values, valid };
        let mut block = CellBlock::void(cells as usize, width);
        // Z order: the bits of each coordinate with gaps for the others'.
        let spread: Vec<usize> =
            (0..1u32 << levels).map(|cell| morton_encode(self.form.dimension, cell) as usize).collect();
        let to_source = &self.lookup.to_source;
        with_record_type!(RecordLayout::new(self.form), R => {
            pick_cells::<R>(to_source, (first, &shown), &spread, &drawn, &mut block);
        });
        Ok(Some(block))
    }

    /// A node's first cell, and the cells of it that are shown.
    fn shown_cells(&self, code: Code, levels: u8) -> ([i64; 3], Cells) {
        let axes = self.form.axes();
        let side = 1i64 << levels;
        let cell = code.cell().map(|cell| i64::from(cell) << levels);
        let first: [i64; 3] = std::array::from_fn(|axis| if axis < axes { cell[axis] } else { 0 });
        let start = std::array::from_fn(|axis| first[axis].max(self.lookup.shown.0[axis] as i64));
        let end = std::array::from_fn(|axis| {
            let end = if axis < axes { first[axis] + side } else { 1 };
            end.min(self.lookup.shown.1[axis] as i64)
        });
        (first, (start, end))
    }

    /// The box of source cells that the centres of some cells can fall into, as far as it is visible.
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

/// The centre of a cell.
fn centre(cell: [i64; 3]) -> DVec3 {
    DVec3::from(cell.map(|cell| cell as f64)) + DVec3::splat(0.5)
}

/// Copies the source cells at the centres of the cells that are shown; what falls outside of the drawn ones
/// stays VOID.
fn pick_cells<R: Record>(
    to_source: &Map,
    (first, (start, end)): ([i64; 3], &Cells),
    spread: &[usize],
    drawn: &Drawn,
    block: &mut CellBlock,
) {
    let from = <[R::Bytes]>::ref_from_bytes(&drawn.values).expect("a value for each cell");
    let to = <[R::Bytes]>::mut_from_bytes(&mut block.values).expect("a value for each cell");
    let valid = &drawn.valid[..from.len()];
    let present = &mut block.present[..to.len()];
    let size = drawn.bounds.size().map(|size| size as i64);
    let origin = drawn.bounds.min.map(|cell| cell as i64);
    let strides = [1, size[0], size[0] * size[1]];
    let matrix = &to_source.0;
    let along_x = matrix.matrix3.x_axis;
    // A map that takes whole cells to whole cells moves by a whole number of drawn cells for each step along
    // x.
    let step = along_x.to_array();
    let step =
        to_source.keeps_cells().then(|| (0..3).map(|axis| step[axis] as i64 * strides[axis]).sum::<i64>());
    // The index of the drawn cell that a point lies in.
    let index_of = |point: DVec3| -> Option<i64> {
        let mut index = 0;
        for (axis, number) in point.to_array().into_iter().enumerate().take(R::AXES) {
            let cell = floor(number) - origin[axis];
            // (What is negative is too large, too.)
            if cell as u64 >= size[axis] as u64 {
                return None;
            }
            index += cell * strides[axis];
        }
        Some(index)
    };
    let mut copy = |here: usize, there: i64| {
        present[here] = u8::from(valid[there as usize]);
        to[here] = from[there as usize];
    };
    let columns = &spread[(start[0] - first[0]) as usize..(end[0] - first[0]) as usize];
    for z in start[2]..end[2] {
        for y in start[1]..end[1] {
            let row = spread[(y - first[1]) as usize] << 1
                | if R::AXES > 2 { spread[(z - first[2]) as usize] << 2 } else { 0 };
            let row_start = matrix.transform_point3(centre([start[0], y, z]));
            // A box is convex: it has all of a row whose ends it has, so that the cells between need no test.
            if let (Some(step), Some(there)) = (step, index_of(row_start))
                && index_of(row_start + along_x * (end[0] - 1 - start[0]) as f64).is_some()
            {
                (0..).zip(columns).for_each(|(i, column)| copy(row | column, there + step * i));
                continue;
            }
            for (i, column) in columns.iter().enumerate() {
                if let Some(there) = index_of(row_start + along_x * i as f64) {
                    copy(row | column, there);
                }
            }
        }
    }
}

/// The largest whole number not above `number`; `f64::floor` is a function call where the target has no
/// instruction for it.
#[inline]
fn floor(number: f64) -> i64 {
    let whole = number as i64;
    whole - i64::from(number < whole as f64)
}
