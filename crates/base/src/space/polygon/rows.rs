//! The rows of cells that a polygon has inside: those whose centres are, all of which some part is, or each with its share.

use std::ops::Range;

use super::super::bounds::Bounds;
use super::{Edge, Polygon, centre, crossing, integral};
use crate::sort;

/// Room to work in for [`Polygon::spans`] and [`Polygon::shares`].
#[derive(Default)]
pub struct Crossings {
    /// Numbers of edges that may cross the box.
    near: Vec<u32>,
    /// Whether, for each row, the number of edges left of the box is odd if it was even in the row before.
    before: Vec<bool>,
    /// Columns at which edges cross a row: the first whose centres are not left of them.
    at: Vec<u64>,
    /// Whether an odd number of edges crosses the row at each column.
    is_odd: Vec<bool>,
    /// The share of each row that edges right of the box have on their left, less those that lead the other way.
    beyond: Vec<f64>,
    /// Changes of shares in a row, by the edges that cause them.
    changes: Vec<Change>,
}

/// A change of the shares of cells in a row, from a column on, by an edge.
#[derive(Clone, Copy)]
struct Change {
    column: u64,
    /// Added to the shares of this cell and all behind it.
    step: f64,
    /// Added to the share of this cell alone, if the edge passes through it.
    own: Option<f64>,
}

/// Rows of which something is held at a time.
const ROWS: u64 = 256;

/// Share of a cell that rounding alone may leave, or take away: ends of edges thousands of cells away are off by 2^-40 of a cell.
const ROUNDING: f64 = 1e-12;

impl Polygon {
    /// Hands out the columns, row by row, of a box's cells whose centres are inside; `work` is room to work in.
    ///
    /// Edges beside the box are looked at once for all rows of a band, not for each row.
    pub fn spans(&self, bounds: &Bounds, work: &mut Crossings, each: &mut dyn FnMut(u64, Range<u64>)) {
        let columns = bounds.min[0]..bounds.max[0];
        let last = bounds.max[1].min((self.high.max(0.0) as u64).saturating_add(1));
        let mut row = bounds.min[1].max(self.low.max(0.0) as u64);
        // The first column whose centre is not left of a crossing. (What is negative, or too large, becomes the nearest number.)
        let column = |at: f64| {
            let next = (at + 0.5) as u64;
            let is_on = next as f64 - 0.5 >= at;
            next.saturating_sub(u64::from(is_on)).clamp(columns.start, columns.end)
        };
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
                let crossings = edges.filter_map(|edge| crossing(edge, y)).map(column);
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

    /// The first row behind the band that a row's centre is in.
    fn end_of_band(&self, row: u64) -> u64 {
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
        let bands = self.bands(low, high);
        for band in bands.clone() {
            for number in self.numbers_in(band..band + 1) {
                let [a, b] = &self.edges[*number as usize];
                let (from, to) = (a[1].min(b[1]), a[1].max(b[1]));
                // (One that stands in several bands counts in the first of them.)
                let is_again = band > bands.start && self.bands(from, from).start < band;
                if is_again || to <= low || from > high || a[0].min(b[0]) > right {
                    continue;
                }
                if a[0].max(b[0]) > left {
                    work.near.push(*number);
                    continue;
                }
                // Rows whose centres are not below the one end, and below the other.
                let step = |y: f64| {
                    let row = (y - 0.5).ceil().clamp(rows.start as f64, rows.end as f64) as u64;
                    (row - rows.start) as usize
                };
                work.before[step(from)] ^= true;
                work.before[step(to)] ^= true;
            }
        }
    }

    /// Number of cells of a box whose centres are inside.
    pub fn count_centres(&self, bounds: &Bounds, work: &mut Crossings) -> u64 {
        let mut cells = 0;
        self.spans(bounds, work, &mut |_, span| cells += span.end - span.start);
        cells
    }

    /// Hands out the columns, row by row, of a box's cells of which some part is inside: those with edges, and those between them.
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
                if let Some([left, right]) = within_row(edge, low, high) {
                    // (What is negative becomes 0.)
                    let span =
                        (left.floor() as u64).max(columns.start)..(right.ceil() as u64).min(columns.end);
                    if span.start < span.end {
                        spans.push((row, span.start, span.end));
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

    /// Hands out the columns, row by row, of a box's cells of which some part is inside, and the share of each that is;
    /// neighbours through which no edge passes come together. Exact but for rounding, if rings do not cross each other.
    ///
    /// An edge adds the area on its left, with the sign of its direction: all of the cells before it, and a part of those that it
    /// passes through, as coverage is accumulated where fonts are drawn.
    pub fn shares(&self, bounds: &Bounds, work: &mut Crossings, each: &mut dyn FnMut(u64, Range<u64>, f64)) {
        let last = bounds.max[1].min(self.high.max(0.0).ceil() as u64);
        let mut first = bounds.min[1].max(self.low.max(0.0) as u64);
        while first < last {
            let end = last.min(first + ROWS);
            self.shares_of_rows(first..end, bounds.min[0]..bounds.max[0], work, each);
            first = end;
        }
    }

    fn shares_of_rows(
        &self,
        rows: Range<u64>,
        columns: Range<u64>,
        work: &mut Crossings,
        each: &mut dyn FnMut(u64, Range<u64>, f64),
    ) {
        self.gather_beyond(rows.clone(), columns.clone(), work);
        for row in rows.clone() {
            let mut share = work.beyond[(row - rows.start) as usize];
            work.changes.clear();
            for number in &work.near {
                share += change(&self.edges[*number as usize], row, &columns, &mut work.changes);
            }
            work.changes.sort_by_key(|change| change.column);
            let mut hand_out = |columns: Range<u64>, share: f64| {
                let share = share.abs();
                let share = if share > 1.0 - ROUNDING { 1.0 } else { share };
                if share > ROUNDING && !columns.is_empty() {
                    each(row, columns, share);
                }
            };
            let mut start = columns.start;
            for changes in work.changes.chunk_by(|a, b| a.column == b.column) {
                let column = changes[0].column;
                hand_out(start..column, share);
                share += changes.iter().map(|change| change.step).sum::<f64>();
                start = column;
                if changes.iter().any(|change| change.own.is_some()) {
                    let own: f64 = changes.iter().filter_map(|change| change.own).sum();
                    hand_out(column..column + 1, share + own);
                    start += 1;
                }
            }
            hand_out(start..columns.end, share);
        }
    }

    /// Collects, for some rows, the edges that may pass through them within some columns, and what those right of these do.
    fn gather_beyond(&self, rows: Range<u64>, columns: Range<u64>, work: &mut Crossings) {
        let [low, high] = [rows.start as f64, rows.end as f64];
        let (left, right) = (columns.start as f64, columns.end as f64);
        work.near.clear();
        work.beyond.clear();
        work.beyond.resize((rows.end - rows.start) as usize, 0.0);
        let bands = self.bands(low, high);
        for band in bands.clone() {
            for number in self.numbers_in(band..band + 1) {
                let edge = &self.edges[*number as usize];
                let [a, b] = edge;
                let (from, to) = (a[1].min(b[1]), a[1].max(b[1]));
                // (One that stands in several bands counts in the first of them.)
                let is_again = band > bands.start && self.bands_of(edge).start < band;
                if is_again || from == to || to <= low || from >= high || a[0].max(b[0]) <= left {
                    continue;
                }
                if a[0].min(b[0]) < right {
                    work.near.push(*number);
                    continue;
                }
                let first = (from.max(low) - low) as usize;
                for (beyond, row) in work.beyond[first..].iter_mut().zip(rows.start + first as u64..) {
                    if row as f64 >= to {
                        break;
                    }
                    *beyond += rise(edge, row);
                }
            }
        }
    }
}

/// The columns from which and to which an edge goes within a row; `None` if it is not in it, or along its border.
fn within_row([a, b]: &Edge, low: f64, high: f64) -> Option<[f64; 2]> {
    let (from, to) = (a[1].min(b[1]), a[1].max(b[1]));
    if from >= high || to <= low {
        return None;
    }
    let at = |y: f64| a[0] + (b[0] - a[0]) * ((y - a[1]) / (b[1] - a[1]));
    let end = |corner: &[f64; 2]| match corner[1] {
        y if y < low => at(low),
        y if y > high => at(high),
        _ => corner[0],
    };
    let (one, other) = (end(a), end(b));
    Some([one.min(other), one.max(other)])
}

/// How far an edge rises within a row; less than nothing if it leads to lower rows.
fn rise([a, b]: &Edge, row: u64) -> f64 {
    let (low, high) = (row as f64, row as f64 + 1.0);
    b[1].clamp(low, high) - a[1].clamp(low, high)
}

/// Adds what an edge does to the cells of a row within some columns; gives what it does to all from the first column on.
fn change(edge: &Edge, row: u64, columns: &Range<u64>, changes: &mut Vec<Change>) -> f64 {
    let rise = rise(edge, row);
    let Some([least, most]) = within_row(edge, row as f64, row as f64 + 1.0) else { return 0.0 };
    let (left, right) = (columns.start as f64, columns.end as f64);
    if most <= left || rise == 0.0 {
        return 0.0;
    }
    if least >= right {
        return rise;
    }
    let first = least.max(left).floor() as u64;
    let end = most.min(right).ceil() as u64;
    if first == end {
        // (It leads along the cells' sides.)
        changes.push(Change { column: first, step: -rise, own: None });
    }
    for column in first..end {
        let own = rise * integral(least, most, column as f64, column as f64 + 1.0);
        let step = if column == first { -rise } else { 0.0 };
        changes.push(Change { column, step, own: Some(own) });
    }
    rise
}
