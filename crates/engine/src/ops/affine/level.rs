//! Boxes of a view's cells at any level: from a level of the source where the cells of both
//! coincide, else by resampling.

use super::view::{Lookup, Sampling, View};
use crate::query::Canvas;
use crate::tree::Source;
use spinney_base::Result;
use spinney_base::space::Bounds;
use spinney_base::value::Value;

/// Position of a view's level in its source.
#[derive(Debug)]
struct LevelMapping {
    /// Level of the source.
    level: u8,
    /// Offset to add to cells of the view's level.
    by: [i64; 3],
    /// Number of cells of the view's level along each axis of a source cell, as a power of two.
    repeat: u8,
    /// Cells of the view's level that may have values.
    shown: Bounds,
}

impl View {
    /// View with the cells of a level, which must exist.
    pub(crate) fn at_level(&self, level: u8) -> Result<View> {
        if level == self.depth() {
            return Ok(self.clone());
        }
        let mut view = self.clone();
        view.is_level = true;
        view.resample(level)
    }

    /// Reads a box of cells of a level inside the tree's space, as [`Source::draw`] does.
    ///
    /// # Errors
    /// If the source is corrupt there, or there is no such level.
    pub(crate) fn draw_at(
        &self,
        level: u8,
        bounds: &Bounds,
        values: &mut [u8],
        valid: &mut [bool],
    ) -> Result<()> {
        if let Some(mapping) = self.level_mapping(level) {
            return self.draw_placed(&mapping, bounds, values, valid);
        }
        let view = self.at_level(level)?;
        let mut canvas = Canvas::new(self.form, bounds, Value::ZERO, values, Some(valid))?;
        canvas.draw(&view, view.root()?, view.depth())
    }

    /// Position of a level in the source, if the level's cells are cells of a level of the source
    /// or subdivide such cells, and windows cut no cell.
    fn level_mapping(&self, level: u8) -> Option<LevelMapping> {
        let lookup = &self.lookup;
        let above = self.depth().checked_sub(level)?;
        let axes = self.form.axes();
        let to = lookup.to_source.apply([0.0; 3]);
        let smaller = -lookup.to_source.power_of_two(axes)?.log2();
        if !lookup.askew.is_empty() || !(0.0..=29.0).contains(&smaller) {
            return None;
        }
        let smaller = smaller as u8;
        // Coarser cells of the source are computed by its rule.
        let rule = self.source.header().rule;
        if above > smaller && self.sampling != Sampling::Area(rule) {
            return None;
        }
        let source_level = self.source.depth().checked_sub(above.saturating_sub(smaller))?;
        let mut mapping = LevelMapping {
            level: source_level,
            by: [0; 3],
            repeat: smaller.saturating_sub(above),
            shown: Bounds { min: [0; 3], max: [1; 3] },
        };
        for (axis, offset) in to.into_iter().enumerate().take(axes) {
            let (by, start, end) = self.axis_place(axis, offset, (above, smaller))?;
            (mapping.by[axis], mapping.shown.min[axis], mapping.shown.max[axis]) = (by, start, end);
        }
        Some(mapping)
    }

    /// Along an axis: the offset to add to cells of a level `above` levels above the view's cells,
    /// and the start and end of those cells that may have values. The view begins `offset` source
    /// cells after the source's first cell. A source cell is `2^smaller` times as large as the
    /// view's.
    fn axis_place(&self, axis: usize, offset: f64, (above, smaller): (u8, u8)) -> Option<(i64, u64, u64)> {
        let Lookup { visible, shown, .. } = &self.lookup;
        let by = offset * (1u64 << smaller) as f64;
        if by != by.round() || by.abs() > 1e12 {
            return None;
        }
        let by = by as i64;
        let to_view = |cell: i64| (cell << smaller) - by;
        let start = to_view(visible.0[axis]).max(shown.0[axis] as i64);
        let content_end = to_view(visible.1[axis]);
        let end = content_end.min(shown.1[axis] as i64).max(start);
        // (Cells after the source's extent are VOID, and do not contribute to a cell's value.)
        let ends_with_source = visible.1[axis] == self.source_extent[axis] as i64 && end == content_end;
        let side = 1i64 << above;
        let is_whole = |cell: i64| cell & (side - 1) == 0;
        if !is_whole(by) || !is_whole(start) || !(is_whole(end) || ends_with_source) {
            return None;
        }
        Some((
            by >> above,
            u64::try_from(start >> above).ok()?,
            u64::try_from((end + side - 1) >> above).ok()?,
        ))
    }

    /// Number of levels between the view's cells and the source's, if each cell of the view is a
    /// fully visible source node that is larger than a cell.
    pub(in crate::ops) fn levels_above(&self) -> Option<u8> {
        let Lookup { to_source, visible, askew, .. } = &self.lookup;
        let (axes, to) = (self.form.axes(), to_source.apply([0.0; 3]));
        let factor = to_source.power_of_two(axes)?;
        let above = factor.log2();
        if !(1.0..=f64::from(self.source.depth())).contains(&above) || !askew.is_empty() {
            return None;
        }
        let is_whole = |cell: i64| cell & (factor as i64 - 1) == 0;
        // (A node at the end of the source has all of its cells.)
        let is_node = |axis: usize| {
            let (start, end) = (visible.0[axis], visible.1[axis]);
            let ends_with_source = end == self.source_extent[axis] as i64;
            to[axis] % factor == 0.0 && is_whole(start) && (is_whole(end) || ends_with_source)
        };
        (0..axes).all(is_node).then_some(above as u8)
    }

    fn draw_placed(
        &self,
        mapping: &LevelMapping,
        bounds: &Bounds,
        values: &mut [u8],
        valid: &mut [bool],
    ) -> Result<()> {
        let inside = bounds.intersect(&mapping.shown);
        let axes = self.form.axes();
        let there =
            |cell: [u64; 3], axis: usize| (cell[axis] as i64 + mapping.by[axis]) as u64 >> mapping.repeat;
        let mut from = Bounds { min: [0; 3], max: [1; 3] };
        for axis in 0..axes {
            if inside.min[axis] >= inside.max[axis] {
                valid.fill(false);
                return Ok(());
            }
            from.min[axis] = there(inside.min, axis);
            from.max[axis] = there(inside.max.map(|cell| cell - 1), axis) + 1;
        }
        if inside == *bounds && mapping.repeat == 0 {
            return self.source.draw_at(mapping.level, &from, values, valid);
        }
        let width = self.form.width();
        let cells = from.volume() as usize;
        let (mut source_values, mut source_valid) = (vec![0; cells * width], vec![false; cells]);
        self.source.draw_at(mapping.level, &from, &mut source_values, &mut source_valid)?;
        valid.fill(false);
        let ([columns, rows, _], [source_columns, source_rows, _]) = (bounds.size(), from.size());
        for z in inside.min[2]..inside.max[2] {
            for y in inside.min[1]..inside.max[1] {
                let first = [inside.min[0], y, z];
                let step = |axis: usize| {
                    let there = if axis < axes { there(first, axis) } else { 0 };
                    there - from.min[axis]
                };
                let source = ((step(2) * source_rows + step(1)) * source_columns) as usize;
                let [x, y, z] = [0, 1, 2].map(|axis| first[axis] - bounds.min[axis]);
                let to = ((z * rows + y) * columns + x) as usize;
                let length = (inside.max[0] - inside.min[0]) as usize;
                if mapping.repeat == 0 {
                    valid[to..to + length].copy_from_slice(&source_valid[source..source + length]);
                    values[to * width..(to + length) * width]
                        .copy_from_slice(&source_values[source * width..(source + length) * width]);
                    continue;
                }
                // Number of level cells by which the first source cell begins before the first
                // drawn cell.
                let phase = (first[0] as i64 + mapping.by[0]) as usize & ((1 << mapping.repeat) - 1);
                for (step, (valid, value)) in valid[to..]
                    .iter_mut()
                    .zip(values[to * width..].chunks_exact_mut(width))
                    .take(length)
                    .enumerate()
                {
                    let source = source + ((phase + step) >> mapping.repeat);
                    *valid = source_valid[source];
                    value.copy_from_slice(&source_values[source * width..(source + 1) * width]);
                }
            }
        }
        Ok(())
    }
}
