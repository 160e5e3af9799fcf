//! All cells of a block of a view at once: where a block is full of detail, drawing the source around it and picking cells
//! is faster than deciding node by node.

use glam::DVec3;

use super::look::{Around, ViewNode};
use super::view::{TINY, View};
use crate::Result;
use crate::space::{Bounds, Dimension, spread};
use crate::tree::{CellBlock, Source};
use crate::value::Value;

/// Source cells that are drawn for each cell of a block, at most; where a view shows much more of the source, deciding node
/// by node skips what does not count.
const MOST_DRAWN: u64 = 6;

impl<S: Source> View<S> {
    /// The cells below an INNER node, in Z order, if drawing them is worth it and the source can.
    pub(super) fn draw_block(
        &self,
        node: &ViewNode<S::Dim, S::Value, S::Node>,
        levels: u8,
    ) -> Result<Option<CellBlock<S::Value>>> {
        let ViewNode::Around(around) = node else { return Ok(None) };
        if self.lookup.by_area || !self.lookup.askew.is_empty() {
            return Ok(None);
        }
        let axes = S::Dim::AXES;
        let side = 1i64 << levels;
        let first = self.first_cell(around, levels);
        // The cells of the block that are shown.
        let start: [i64; 3] = std::array::from_fn(|axis| first[axis].max(self.lookup.shown.0[axis] as i64));
        let end: [i64; 3] = std::array::from_fn(|axis| {
            let end = if axis < axes { first[axis] + side } else { 1 };
            end.min(self.lookup.shown.1[axis] as i64)
        });
        let half = DVec3::splat(0.5);
        let centre = |cell: [i64; 3]| DVec3::from(cell.map(|cell| cell as f64)) + half;
        let (low, high) = self.lookup.to_source.bounding_box(centre(start), centre(end.map(|cell| cell - 1)));
        let (low, high) = ((low - TINY).floor().to_array(), (high + TINY).floor().to_array());
        let (seen_start, seen_end) = self.lookup.seen;
        let mut bounds = Bounds { min: [0; 3], max: [1; 3] };
        for axis in 0..axes {
            bounds.min[axis] = (low[axis] as i64).max(seen_start[axis]) as u64;
            bounds.max[axis] =
                ((high[axis] as i64 + 1).min(seen_end[axis]).max(0) as u64).max(bounds.min[axis]);
        }
        let cells = 1u64 << (axes * levels as usize);
        let drawn = bounds.volume();
        if drawn == 0 || drawn > MOST_DRAWN * cells {
            return Ok(None);
        }
        let fill = S::Value::default().to_wire();
        let (mut values, mut valid) = (vec![fill; drawn as usize], vec![false; drawn as usize]);
        if !self.source.draw(&bounds, &mut values, &mut valid)? {
            return Ok(None);
        }
        let mut block = CellBlock::void(cells as usize);
        let size = bounds.size().map(|size| size as i64);
        let origin = bounds.min.map(|cell| cell as i64);
        // Z order: the bits of each coordinate with gaps for the others'.
        let spread: Vec<usize> = (0..side as u32).map(|cell| spread::<S::Dim>(cell) as usize).collect();
        let matrix = &self.lookup.to_source.0;
        let strides = [1, size[0], size[0] * size[1]];
        // Between whole cells it is a matter of counting.
        let step = matrix.matrix3.x_axis.to_array();
        let step = self
            .lookup
            .to_source
            .keeps_cells()
            .then(|| (0..3).map(|axis| step[axis] as i64 * strides[axis]).sum::<i64>());
        for z in start[2]..end[2] {
            for y in start[1]..end[1] {
                let row = spread[(y - first[1]) as usize] << 1
                    | if axes > 2 { spread[(z - first[2]) as usize] << 2 } else { 0 };
                let from = matrix.transform_point3(centre([start[0], y, z]));
                let place = |point: DVec3| -> Option<i64> {
                    let mut there = 0;
                    for (axis, number) in point.to_array().into_iter().enumerate().take(axes) {
                        let cell = floor(number) - origin[axis];
                        if cell as u64 >= size[axis] as u64 {
                            return None;
                        }
                        there += cell * strides[axis];
                    }
                    Some(there)
                };
                let columns = &spread[(start[0] - first[0]) as usize..(end[0] - first[0]) as usize];
                let mut put = |column: usize, there: i64| {
                    let (here, there) = (row | column, there as usize);
                    block.present[here] = u8::from(valid[there]);
                    block.values[here] = S::Value::from_wire(values[there]);
                };
                if let (Some(step), Some(there)) = (step, place(from))
                    && place(from + matrix.matrix3.x_axis * (end[0] - 1 - start[0]) as f64).is_some()
                {
                    (0..).zip(columns).for_each(|(i, column)| put(*column, there + step * i));
                    continue;
                }
                for (i, column) in columns.iter().enumerate() {
                    if let Some(there) = place(from + matrix.matrix3.x_axis * i as f64) {
                        put(*column, there);
                    }
                }
            }
        }
        Ok(Some(block))
    }

    fn first_cell(&self, around: &Around<S::Dim, S::Value, S::Node>, levels: u8) -> [i64; 3] {
        let cell = around.code().cell().map(|cell| i64::from(cell) << levels);
        std::array::from_fn(|axis| if axis < S::Dim::AXES { cell[axis] } else { 0 })
    }
}

/// The library's function is a call.
#[inline]
fn floor(number: f64) -> i64 {
    let whole = number as i64;
    whole - i64::from(number < whole as f64)
}
