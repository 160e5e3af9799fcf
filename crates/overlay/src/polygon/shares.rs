//! The share of each cell's area that a polygon covers.
//!
//! An edge adds the area on its left, with the sign of its direction: the whole area of the cells
//! before it, and a fraction of the cells that it passes through. Font rasterizers accumulate
//! coverage in the same way. Each addend depends on the edge and the cell alone and is a multiple
//! of 2^-52 of a cell, so integer sums are the same in any order. So a cell's share does not depend
//! on the query box, and is exactly 0 or 1 where no edge passes.

use std::ops::Range;

use super::rows::{Crossings, ROWS};
use super::{Edge, Polygon, integral};
use spinney_base::sort;
use spinney_base::space::Bounds;

/// The share of a cell that is entirely inside. Shares are multiples of 2^-40.
pub const FULL_SHARE: u64 = 1 << 40;

/// Addends are multiples of `1 / UNIT`.
const UNIT: i64 = 1 << 52;

/// Number of bits by which addends are finer than shares.
const FINER: u32 = 12;

/// A change of the shares in a row at a column, caused by an edge.
#[derive(Clone, Copy)]
pub(super) struct Change {
    column: u64,
    /// Added to the shares of this cell and all after it.
    step: i64,
    /// Added to the share of this cell only, if the edge passes through it.
    own: Option<i64>,
}

impl Polygon {
    /// Yields the columns, row by row, of a box's cells that are at least partly inside, with each
    /// cell's share in units of 1 / [`FULL_SHARE`]. Neighbouring cells without edges are yielded as
    /// one range.
    pub fn shares(&self, bounds: &Bounds, work: &mut Crossings, each: &mut dyn FnMut(u64, Range<u64>, u64)) {
        let last = bounds.max[1].min(self.high.max(0.0).ceil() as u64);
        let mut first = bounds.min[1].max(self.low.max(0.0) as u64);
        while first < last {
            let end = last.min(first + ROWS);
            self.shares_of_rows(first..end, bounds.min[0]..bounds.max[0], work, each);
            first = end;
        }
    }

    /// Sums the shares of a box's cells: returns the number of cells that are entirely inside, and
    /// the sum of the shares of all others.
    pub fn sum_shares(&self, bounds: &Bounds, work: &mut Crossings) -> (u64, u128) {
        let (mut cells, mut shares) = (0, 0u128);
        self.shares(bounds, work, &mut |_, columns, share| match share {
            FULL_SHARE => cells += columns.end - columns.start,
            share => shares += u128::from(share) * u128::from(columns.end - columns.start),
        });
        (cells, shares)
    }

    fn shares_of_rows(
        &self,
        rows: Range<u64>,
        columns: Range<u64>,
        work: &mut Crossings,
        each: &mut dyn FnMut(u64, Range<u64>, u64),
    ) {
        self.gather_beyond(rows.clone(), columns.clone(), work);
        // Edges in the order of their first rows. `active` holds those that have begun,
        // `near[next..]` those that have not.
        let start = |edge: &Edge| edge[0][1].min(edge[1][1]);
        sort::by(&mut work.near, &mut |a, b| {
            let [a, b] = [*a, *b].map(|number| start(&self.edges[number as usize]));
            a.total_cmp(&b)
        });
        let (mut active, mut next): (Vec<u32>, usize) = (Vec::new(), 0);
        for row in rows.clone() {
            let (low, high) = (row as f64, row as f64 + 1.0);
            active.retain(|number| {
                let [a, b] = &self.edges[*number as usize];
                a[1].max(b[1]) > low
            });
            while let Some(number) =
                work.near.get(next).filter(|near| start(&self.edges[**near as usize]) < high)
            {
                active.push(*number);
                next += 1;
            }
            let mut share = work.beyond[(row - rows.start) as usize];
            work.changes.clear();
            for number in &active {
                share += change(&self.edges[*number as usize], row, &columns, &mut work.changes);
            }
            work.changes.sort_by_key(|change| change.column);
            let mut hand_out = |columns: Range<u64>, sum: i64| {
                let share = (sum.clamp(0, UNIT) as u64 + (1 << (FINER - 1))) >> FINER;
                if share > 0 && !columns.is_empty() {
                    each(row, columns, share);
                }
            };
            let mut start = columns.start;
            for changes in work.changes.chunk_by(|a, b| a.column == b.column) {
                let column = changes[0].column;
                hand_out(start..column, share);
                share += changes.iter().map(|change| change.step).sum::<i64>();
                start = column;
                if changes.iter().any(|change| change.own.is_some()) {
                    let own: i64 = changes.iter().filter_map(|change| change.own).sum();
                    hand_out(column..column + 1, share + own);
                    start += 1;
                }
            }
            hand_out(start..columns.end, share);
        }
    }

    /// Collects the edges that may pass through some columns in some rows, and sums the heights of
    /// those to the right of the columns.
    fn gather_beyond(&self, rows: Range<u64>, columns: Range<u64>, work: &mut Crossings) {
        let [low, high] = [rows.start as f64, rows.end as f64];
        let (left, right) = (columns.start as f64, columns.end as f64);
        work.near.clear();
        work.beyond.clear();
        work.beyond.resize((rows.end - rows.start) as usize, 0);
        for number in self.numbers_between(low, high) {
            let edge = &self.edges[number as usize];
            let [a, b] = edge;
            let (from, to) = (a[1].min(b[1]), a[1].max(b[1]));
            if from == to || to <= low || from >= high || a[0].max(b[0]) <= left {
                continue;
            }
            if a[0].min(b[0]) < right {
                work.near.push(number);
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

/// Signed height of an edge within a row, in units of `1 / UNIT`; negative if it leads to lower
/// rows. Vertices are rounded to units, so the sum over consecutive edges is the difference of the
/// ends.
fn rise([a, b]: &Edge, row: u64) -> i64 {
    let (low, high) = (row as f64, row as f64 + 1.0);
    let height = |y: f64| ((y.clamp(low, high) - low) * UNIT as f64) as i64;
    height(b[1]) - height(a[1])
}

/// Minimum and maximum column of an edge within a row that it passes through.
fn within_row([a, b]: &Edge, low: f64, high: f64) -> [f64; 2] {
    let (least, most) = (a[0].min(b[0]), a[0].max(b[0]));
    let at = |y: f64| (a[0] + (b[0] - a[0]) * ((y - a[1]) / (b[1] - a[1]))).clamp(least, most);
    let end = |vertex: &[f64; 2]| match vertex[1] {
        y if y < low => at(low),
        y if y > high => at(high),
        _ => vertex[0],
    };
    let (one, other) = (end(a), end(b));
    [one.min(other), one.max(other)]
}

/// Appends an edge's changes to the cells of a row within some columns. Returns the amount that it
/// adds to all cells from the first column on.
fn change(edge: &Edge, row: u64, columns: &Range<u64>, changes: &mut Vec<Change>) -> i64 {
    let rise = rise(edge, row);
    if rise == 0 {
        return 0;
    }
    let [min, max] = within_row(edge, row as f64, row as f64 + 1.0);
    let (left, right) = (columns.start as f64, columns.end as f64);
    if max <= left {
        return 0;
    }
    if min >= right {
        return rise;
    }
    let first = min.max(left).floor() as u64;
    let end = max.min(right).ceil() as u64;
    if first == end {
        // (The edge runs along the cells' sides.)
        changes.push(Change { column: first, step: -rise, own: None });
    }
    for column in first..end {
        let own = (rise as f64 * integral(min, max, column as f64, column as f64 + 1.0)) as i64;
        let step = if column == first { -rise } else { 0 };
        changes.push(Change { column, step, own: Some(own) });
    }
    rise
}
