//! The rows of cells that a polygon has inside: those whose centres are, all of which some part is, or each with its share.

use std::ops::Range;

use super::parts::Parity;
use super::shares::Change;
use super::{Edge, Polygon, centre, crosses, is_right_of};
use crate::exact::side;
use spinney_base::sort;
use spinney_base::space::Bounds;

/// Room to work in for [`Polygon::spans`] and [`Polygon::shares`].
#[derive(Default)]
pub struct Crossings {
    /// Numbers of edges that may cross the box.
    pub(super) near: Vec<u32>,
    /// Whether, for each row, the number of edges left of the box is odd if it was even in the row before.
    before: Vec<bool>,
    /// Columns at which edges cross a row: the first whose centres are not left of them.
    at: Vec<u64>,
    /// Whether an odd number of edges crosses the row at each column.
    is_odd: Vec<bool>,
    /// The share of each row that edges right of the box have on their left, less those that lead the other way.
    pub(super) beyond: Vec<i64>,
    /// Changes of shares in a row, by the edges that cause them.
    pub(super) changes: Vec<Change>,
    /// Of polygons whose parts were united: see [`super::parts`].
    pub(super) parity: Parity,
}

/// Rows of which something is held at a time.
pub(super) const ROWS: u64 = 256;

impl Polygon {
    /// Yields the columns, row by row, of a box's cells whose centres are inside; `work` is room to work in.
    ///
    /// Edges beside the box are looked at once for all rows of a band, not for each row.
    pub fn spans(&self, bounds: &Bounds, work: &mut Crossings, each: &mut dyn FnMut(u64, Range<u64>)) {
        if let Some(parts) = &self.parts {
            return parts.spans(bounds, work, each);
        }
        let columns = bounds.min[0]..bounds.max[0];
        let Range { start: mut row, end: last } = self.rows(bounds);
        while row < last {
            let rows = row..self.end_of_band(row).min(last);
            self.gather(rows.clone(), columns.clone(), work);
            // (Where very many edges cross the box, it is faster to go through its columns than to sort.)
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
                    // Columns at which an odd number of edges crosses the row; all others cancel each other.
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

    /// The rows of a box whose centres may be inside.
    pub(super) fn rows(&self, bounds: &Bounds) -> Range<u64> {
        let last = bounds.max[1].min((self.high.max(0.0) as u64).saturating_add(1));
        bounds.min[1].max(self.low.max(0.0) as u64)..last
    }

    /// The first row after the band that a row's centre is in.
    pub(super) fn end_of_band(&self, row: u64) -> u64 {
        let bands = self.ends.len();
        let band = self.bands(centre(row), centre(row)).start;
        let end = self.low + (self.high - self.low) / bands as f64 * (band + 1) as f64;
        if band + 1 == bands { u64::MAX } else { ((end - 0.5).ceil().max(0.0) as u64).max(row + 1) }
    }

    /// Collects, for some rows, the edges that may cross them within some columns, and which rows are crossed by an odd number of edges
    /// more than the row before, on the left of these columns.
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

    /// Number of cells of a box whose centres are inside.
    pub fn count_centres(&self, bounds: &Bounds, work: &mut Crossings) -> u64 {
        let mut cells = 0;
        self.spans(bounds, work, &mut |_, span| cells += span.end - span.start);
        cells
    }

    /// Yields the columns, row by row, of a box's cells of which some part is inside: those with edges, and those between them.
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
        // Invariant: a cell of which a part is inside has an edge in it, or is inside as a whole, its centre too: the two kinds of
        // spans are all. They lie on each other, and are merged in the order of their beginnings.
        spans.sort_unstable();
        let mut spans = spans.into_iter().peekable();
        while let Some((row, start, mut end)) = spans.next() {
            while let Some((_, _, other)) = spans.next_if(|(next, from, _)| *next == row && *from <= end) {
                end = end.max(other);
            }
            each(row, start..end);
        }
    }

    /// Number of cells of a box of which some part is inside.
    pub fn count_touched(&self, bounds: &Bounds, work: &mut Crossings) -> u64 {
        let mut cells = 0;
        self.touched_spans(bounds, work, &mut |_, span| cells += span.end - span.start);
        cells
    }
}

/// The first of some rows whose centre is not before a coordinate, counted from the first of them.
#[inline]
pub(super) fn first_row(y: f64, rows: &Range<u64>) -> usize {
    let row = (y - 0.5).ceil().clamp(rows.start as f64, rows.end as f64) as u64;
    (row - rows.start) as usize
}

/// The first of some columns whose centre is not left of an edge in a row that it crosses; the end of the columns if there is none.
#[inline]
pub(super) fn first_column(edge: &Edge, y: f64, columns: &Range<u64>) -> u64 {
    let [a, b] = edge;
    let at = a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
    // (What is negative, or too large, becomes the nearest number.)
    let next = (at + 0.5) as u64;
    let column = next.saturating_sub(u64::from(next as f64 - 0.5 >= at));
    // Where rounding may decide, the exact test does.
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

/// The maximum error of a column that is computed of where an edge crosses a row, in cells: six roundings, each of what is at most the sum of
/// both ends' columns, by half of an epsilon.
#[inline]
pub(super) fn rounding([a, b]: &Edge) -> f64 {
    (a[0].abs() + b[0].abs()) * 4.0 * f64::EPSILON
}

/// The columns that an edge passes through within a row, decided exactly; none if it leads along a column's border.
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
    // (What is negative becomes 0.)
    Some(start as u64..end as u64)
}

/// The borders of the column in which an edge crosses a row, or twice the one through which it does; exact.
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
