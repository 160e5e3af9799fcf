//! Windows of the source, also beyond its edges and across the antimeridian.

use crate::ops::view_source::ViewSource;
use spinney_base::Result;
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::space::Bounds;
use spinney_base::value::ValueType;

/// Box of source cells, in rows. Coordinates may be negative, or beyond the source: cells there are
/// VOID, unless the source repeats after a whole turn.
pub(super) struct Window {
    /// First column and row.
    pub(super) origin: [i64; 2],
    /// Columns and rows.
    pub(super) size: [usize; 2],
    pub(super) value: ValueType,
    pub(super) bytes: Vec<u8>,
    pub(super) valid: Vec<bool>,
}

/// File that a window is read from.
pub(super) struct WindowSource<'a> {
    pub(super) file: &'a ViewSource,
    /// Level, and its cells along each axis.
    pub(super) level: u8,
    pub(super) extent: [u64; 2],
    /// Period of the source in columns.
    pub(super) turn: Option<i64>,
}

impl Window {
    /// Reads a box of cells.
    ///
    /// # Errors
    /// If the file is corrupt there.
    pub(super) fn read(source: &WindowSource<'_>, origin: [i64; 2], size: [usize; 2]) -> Result<Window> {
        let value = source.file.header().form.value;
        let cells = size[0] * size[1];
        let mut window =
            Window { origin, size, value, bytes: vec![0; cells * value.size()], valid: vec![false; cells] };
        let [width, height] = source.extent.map(|cells| cells as i64);
        let rows = (origin[1].max(0), (origin[1] + size[1] as i64).min(height));
        if rows.0 >= rows.1 {
            return Ok(window);
        }
        let end = origin[0] + size[0] as i64;
        // All repetitions of the source in the window.
        let turns = match source.turn {
            Some(turn) => (origin[0] - width).div_euclid(turn)..=end.div_euclid(turn),
            None => 0..=0,
        };
        let mut is_unread = false;
        for turn in turns {
            let shift = turn * source.turn.unwrap_or(0);
            let columns = ((origin[0] - shift).max(0), (end - shift).min(width));
            if columns.0 < columns.1 {
                let first = (columns.0 + shift - origin[0], rows.0 - origin[1]);
                let painted = window.paint(source, columns, rows, (first.0 as usize, first.1 as usize));
                defer_missing(painted, &mut is_unread)?;
            }
        }
        finish_deferred(is_unread).map(|()| window)
    }

    /// Reads cells of the source into a position of the window.
    fn paint(
        &mut self,
        source: &WindowSource<'_>,
        columns: (i64, i64),
        rows: (i64, i64),
        (x, y): (usize, usize),
    ) -> Result<()> {
        let bounds =
            Bounds { min: [columns.0 as u64, rows.0 as u64, 0], max: [columns.1 as u64, rows.1 as u64, 1] };
        let [width, height] = [bounds.size()[0] as usize, bounds.size()[1] as usize];
        if [width, height] == self.size {
            return source.file.draw_at(source.level, &bounds, &mut self.bytes, &mut self.valid);
        }
        let bytes_each = self.value.size();
        let (mut bytes, mut valid) = (vec![0; width * height * bytes_each], vec![false; width * height]);
        source.file.draw_at(source.level, &bounds, &mut bytes, &mut valid)?;
        for row in 0..height {
            let to = (y + row) * self.size[0] + x;
            let from = row * width..(row + 1) * width;
            self.valid[to..to + width].copy_from_slice(&valid[from.clone()]);
            let from = from.start * bytes_each..from.end * bytes_each;
            self.bytes[to * bytes_each..(to + width) * bytes_each].copy_from_slice(&bytes[from]);
        }
        Ok(())
    }

    /// Index of a cell, if it is in the window.
    #[inline]
    pub(super) fn index(&self, x: i64, y: i64) -> Option<usize> {
        let (x, y) = (x - self.origin[0], y - self.origin[1]);
        // (A negative number is too large as an unsigned one.)
        let is_inside = (x as u64) < self.size[0] as u64 && (y as u64) < self.size[1] as u64;
        is_inside.then(|| y as usize * self.size[0] + x as usize)
    }

    /// Index of a cell, if it is in the window and not VOID.
    #[inline]
    pub(super) fn present(&self, x: i64, y: i64) -> Option<usize> {
        self.index(x, y).filter(|index| self.valid[*index])
    }
}

/// Largest integer not above a number. `f64::floor` is a function call on targets without an
/// instruction for it.
#[inline]
pub(super) fn floor(number: f64) -> i64 {
    let whole = number as i64;
    whole - i64::from(number < whole as f64)
}
