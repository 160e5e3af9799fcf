//! Cells of a polygon by rows: the cells whose centres are inside, and the cells that it touches.

use std::ops::Range;

use super::original_parts::Parity;
use super::shares::Change;
use super::{Edge, Polygon, centre, crosses, is_right_of};
use crate::exact::side;
use spinney_base::sort;
use spinney_base::space::Bounds;

/// Reusable buffers for [`Polygon::spans`] and [`Polygon::shares`].
#[derive(Default)]
pub struct Crossings {
    /// Numbers of the edges that may cross the box.
    pub(super) near: Vec<u32>,
    /// For each row, whether the parity of the number of edges left of the box differs from the
    /// previous row's.
    before: Vec<bool>,
    /// Columns at which edges cross a row: the first column whose centre is not left of the edge.
    at: Vec<u64>,
    /// Whether an odd number of edges crosses the row at each column.
    is_odd: Vec<bool>,
    /// Signed height of the edges right of the box in each row, by which they add to the shares of
    /// all its cells.
    pub(super) beyond: Vec<i64>,
    /// Changes of shares in a row, one or more per edge.
    pub(super) changes: Vec<Change>,
    /// State for polygons whose parts were united: see [`super::parts`].
    pub(super) parity: Parity,
}

/// Number of rows that are buffered at a time.
pub(super) const ROWS: u64 = 256;

impl Polygon {
    /// Yields the columns, row by row, of a box's cells whose centres are inside. `work` provides
    /// reusable buffers.
    ///
    /// Edges to the left or right of the box are tested once per band, not once per row.
    pub fn spans(&self, bounds: &Bounds, work: &mut Crossings, each: &mut dyn FnMut(u64, Range<u64>)) {
        if let Some(parts) = &self.parts {
            return parts.spans(bounds, work, each);
        }
        let columns = bounds.min[0]..bounds.max[0];
        let Range { start: mut row, end: last } = self.rows(bounds);
        while row < last {
            let rows = row..self.end_of_band(row).min(last);
            self.gather(rows.clone(), columns.clone(), work);
            // (If many edges cross the box, scanning its columns is faster than sorting.)
            let is_crowded = columns.end - columns.start <= 4 * work.near.len() as u64;
            work.is_odd
                .resize(if is_crowded { (columns.end - columns.start) as usize + 1 } else { 0 }, false);
            let mut is_inside = false;
            for (row, crosses_before) in rows.clone().zip(&work.before) {
                is_inside ^= crosses_before;
                let y = centre(row);
                let edges = work.near.iter().map(|number| &self.edges[*number as usize]);
                let crossings =
                    edges.filter(|edge| crosses(edge, y)).map(|edge| first_column(edge, y, &columns));
                work.at.clear();
                if is_crowded {
                    // Columns at which an odd number of edges crosses the row. Even numbers cancel
                    // out.
                    work.is_odd.fill(false);
                    crossings.for_each(|column| work.is_odd[(column - columns.start) as usize] ^= true);
                    let odd = columns.clone().zip(&work.is_odd).filter(|(_, is_odd)| **is_odd);
                    work.at.extend(odd.map(|(column, _)| column));
                } else {
                    work.at.extend(crossings);
                    sort::numbers64(&mut work.at);
                }
                let (mut is_inside, mut start) = (is_inside, columns.start);
                for end in work.at.iter().copied().chain([columns.end]) {
                    if is_inside && start < end {
                        each(row, start..end);
                    }
                    (is_inside, start) = (!is_inside, end);
                }
            }
            row = rows.end;
        }
    }

    /// Returns the rows of a box whose centres may be inside.
    pub(super) fn rows(&self, bounds: &Bounds) -> Range<u64> {
        let last = bounds.max[1].min((self.high.max(0.0) as u64).saturating_add(1));
        bounds.min[1].max(self.low.max(0.0) as u64)..last
    }

    /// Returns the first row after the band that contains a row's centre.
    pub(super) fn end_of_band(&self, row: u64) -> u64 {
        let bands = self.ends.len();
        let band = self.bands(centre(row), centre(row)).start;
        let end = self.low + (self.high - self.low) / bands as f64 * (band + 1) as f64;
        if band + 1 == bands { u64::MAX } else { ((end - 0.5).ceil().max(0.0) as u64).max(row + 1) }
    }

    /// Collects the edges that may cross some columns in some rows, and the rows at which edges to
    /// the left of the columns change the parity.
    fn gather(&self, rows: Range<u64>, columns: Range<u64>, work: &mut Crossings) {
        let [low, high] = [centre(rows.start), centre(rows.end - 1)];
        let (left, right) = (columns.start as f64 + 0.5, columns.end as f64);
        work.near.clear();
        work.before.clear();
        work.before.resize((rows.end - rows.start) as usize + 1, false);
        for number in self.numbers_between(low, high) {
            let [a, b] = &self.edges[number as usize];
            let (from, to) = (a[1].min(b[1]), a[1].max(b[1]));
            if to <= low || from > high || a[0].min(b[0]) > right {
                continue;
            }
            if a[0].max(b[0]) > left {
                work.near.push(number);
                continue;
            }
            work.before[first_row(from, &rows)] ^= true;
            work.before[first_row(to, &rows)] ^= true;
        }
    }

    /// Returns the number of a box's cells whose centres are inside.
    pub fn count_centres(&self, bounds: &Bounds, work: &mut Crossings) -> u64 {
        let mut cells = 0;
        self.spans(bounds, work, &mut |_, span| cells += span.end - span.start);
        cells
    }

    /// Yields the columns, row by row, of a box's cells that the polygon's interior touches: cells
    /// that edges pass through, and cells between them.
    pub fn touched_spans(
        &self,
        bounds: &Bounds,
        work: &mut Crossings,
        each: &mut dyn FnMut(u64, Range<u64>),
    ) {
        let last = bounds.max[1].min(self.high.max(0.0).ceil() as u64);
        let mut first = bounds.min[1].max(self.low.max(0.0) as u64);
        while first < last {
            let end = last.min(first + ROWS);
            let (mut part, columns) = (*bounds, bounds.min[0]..bounds.max[0]);
            (part.min[1], part.max[1]) = (first, end);
            self.touched_rows(&part, columns, work, each);
            first = end;
        }
    }

    fn touched_rows(
        &self,
        part: &Bounds,
        columns: Range<u64>,
        work: &mut Crossings,
        each: &mut dyn FnMut(u64, Range<u64>),
    ) {
        let mut spans = Vec::new();
        self.spans(part, work, &mut |row, span| spans.push((row, span.start, span.end)));
        for row in part.min[1]..part.max[1] {
            let (low, high) = (row as f64, row as f64 + 1.0);
            for edge in self.edges_in(self.bands(low, high)) {
                if let Some(own) = columns_in_row(edge, low, high) {
                    let (start, end) = (own.start.max(columns.start), own.end.min(columns.end));
                    if start < end {
                        spans.push((row, start, end));
                    }
                }
            }
        }
        // Invariant: a cell that is partly inside has an edge in it, or is inside entirely, with
        // its centre. So the two kinds of spans are complete. They may overlap, and are merged in
        // the order of their starts.
        spans.sort_unstable();
        let mut spans = spans.into_iter().peekable();
        while let Some((row, start, mut end)) = spans.next() {
            while let Some((_, _, other)) = spans.next_if(|(next, from, _)| *next == row && *from <= end) {
                end = end.max(other);
            }
            each(row, start..end);
        }
    }

    /// Returns the number of a box's cells that the polygon's interior touches.
    pub fn count_touched(&self, bounds: &Bounds, work: &mut Crossings) -> u64 {
        let mut cells = 0;
        self.touched_spans(bounds, work, &mut |_, span| cells += span.end - span.start);
        cells
    }
}

/// Index, relative to the first of `rows`, of the first row whose centre is at or after a
/// coordinate.
#[inline]
pub(super) fn first_row(y: f64, rows: &Range<u64>) -> usize {
    let row = (y - 0.5).ceil().clamp(rows.start as f64, rows.end as f64) as u64;
    (row - rows.start) as usize
}

/// Returns the first of `columns` whose centre is not left of an edge in a row that it crosses, or
/// the end of `columns` if there is none.
#[inline]
pub(super) fn first_column(edge: &Edge, y: f64, columns: &Range<u64>) -> u64 {
    let [a, b] = edge;
    let at = a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
    // (The cast saturates negative and excessive values.)
    let next = (at + 0.5) as u64;
    let column = next.saturating_sub(u64::from(next as f64 - 0.5 >= at));
    // The exact test decides where rounding might.
    let is_certain = (at - at.floor() - 0.5).abs() > rounding(edge);
    let mut column = column.clamp(columns.start, columns.end);
    if !is_certain {
        let is_left = |column: u64| is_right_of(edge, [centre(column), y]);
        while column > columns.start && !is_left(column - 1) {
            column -= 1;
        }
        while column < columns.end && is_left(column) {
            column += 1;
        }
    }
    column
}

/// Maximum error, in cells, of the column at which an edge is computed to cross a row: six
/// roundings of half an epsilon each, relative to at most the sum of both ends' columns.
#[inline]
pub(super) fn rounding([a, b]: &Edge) -> f64 {
    (a[0].abs() + b[0].abs()) * 4.0 * f64::EPSILON
}

/// Returns the columns that an edge passes through within a row; exact. Empty if it runs along a
/// column's border.
fn columns_in_row(edge: &Edge, low: f64, high: f64) -> Option<Range<u64>> {
    let [a, b] = edge;
    let (from, to) = (a[1].min(b[1]), a[1].max(b[1]));
    if from >= high || to <= low {
        return None;
    }
    let (mut start, mut end) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut widen = |[left, right]: [f64; 2]| (start, end) = (start.min(left), end.max(right));
    for [x, y] in [*a, *b] {
        if (low..=high).contains(&y) {
            widen([x.floor(), x.ceil()]);
        }
    }
    for y in [low, high] {
        if from < y && y < to {
            widen(borders_at(edge, y));
        }
    }
    // (The cast turns negative values into 0.)
    Some(start as u64..end as u64)
}

/// Returns the borders of the column in which an edge crosses a row, or the same border twice if it
/// crosses there; exact.
fn borders_at(edge: &Edge, y: f64) -> [f64; 2] {
    let [a, b] = edge;
    let at = a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
    let border = at.round();
    if (at - border).abs() > rounding(edge) {
        return [at.floor(), at.ceil()];
    }
    let (from, to) = if a[1] <= b[1] { (a, b) } else { (b, a) };
    match side(*from, *to, [border, y]) {
        0 => [border, border],
        1 => [border, border + 1.0],
        _ => [border - 1.0, border],
    }
}
