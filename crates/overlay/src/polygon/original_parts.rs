//! The original parts of a polygon that had to be united.
//!
//! They decide which points are inside. (Crossings in the union are rounded, so a point on an
//! original edge could end up on either side.)

use std::ops::Range;

use super::rows::{Crossings, first_column, first_row};
use super::{Polygon, Ring, centre, crosses, is_right_of, without_repeats};
use spinney_base::Result;
use spinney_base::space::Bounds;

/// Parts, each the even-odd combination of its rings.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct OriginalParts {
    /// The edges of all parts, in bands.
    edges: Polygon,
    /// The part of each edge.
    part_of: Vec<u32>,
    count: usize,
}

/// The parts that a ray is inside of, in reusable buffers.
#[derive(Default)]
pub(super) struct Parity {
    /// Whether the ray is inside each part. All are `false` between queries.
    inside: Vec<bool>,
    /// Number of parts that the ray is inside of.
    count: usize,
    /// For edges left of a box: the row, relative to the first row of the band, from which on they
    /// toggle a part.
    left: Vec<(usize, u32)>,
    /// Columns at which edges toggle parts in a row.
    crossings: Vec<(u64, u32)>,
}

impl Parity {
    fn toggle(&mut self, part: u32) {
        let inside = &mut self.inside[part as usize];
        *inside = !*inside;
        self.count = if *inside { self.count + 1 } else { self.count - 1 };
    }
}

impl OriginalParts {
    pub(super) fn new(parts: &[Vec<Ring>]) -> Result<OriginalParts> {
        let rings: Vec<Ring> = parts.iter().flatten().map(without_repeats).collect();
        let edges = Polygon::of_rings(&rings)?;
        let part_of_ring = (0u32..).zip(parts).flat_map(|(part, rings)| rings.iter().map(move |_| part));
        let each = part_of_ring.zip(&rings);
        let part_of = each.flat_map(|(part, ring)| std::iter::repeat_n(part, ring.len())).collect();
        Ok(OriginalParts { edges, part_of, count: parts.len() })
    }

    /// Whether a point is in any part: see [`Polygon::contains`].
    pub(super) fn contain(&self, [x, y]: [f64; 2]) -> bool {
        let numbers = self.edges.numbers_in(self.edges.bands(y, y)).iter();
        let crossed = numbers.filter(|number| {
            let edge = &self.edges.edges[**number as usize];
            crosses(edge, y) && is_right_of(edge, [x, y])
        });
        let mut parts: Vec<u32> = crossed.map(|number| self.part_of[*number as usize]).collect();
        parts.sort_unstable();
        parts.chunk_by(|a, b| a == b).any(|same| same.len() % 2 == 1)
    }

    /// Yields the columns, row by row, of a box's cells whose centres are in any part. The time
    /// does not depend on the number of parts, but on the edges in the box's rows.
    pub(super) fn spans(&self, bounds: &Bounds, work: &mut Crossings, each: &mut dyn FnMut(u64, Range<u64>)) {
        let columns = bounds.min[0]..bounds.max[0];
        let Range { start: mut row, end: last } = self.edges.rows(bounds);
        let Crossings { near, parity, .. } = work;
        if parity.inside.len() < self.count {
            parity.inside.resize(self.count, false);
        }
        while row < last {
            let rows = row..self.edges.end_of_band(row).min(last);
            self.gather(rows.clone(), columns.clone(), near, parity);
            let left = std::mem::take(&mut parity.left);
            let mut crossings = std::mem::take(&mut parity.crossings);
            let mut toggles = left.iter().copied().peekable();
            for row in rows.clone() {
                while let Some((_, part)) = toggles.next_if(|(from, _)| *from <= (row - rows.start) as usize)
                {
                    parity.toggle(part);
                }
                let y = centre(row);
                crossings.clear();
                for number in &*near {
                    let edge = &self.edges.edges[*number as usize];
                    if crosses(edge, y) {
                        crossings.push((first_column(edge, y, &columns), self.part_of[*number as usize]));
                    }
                }
                crossings.sort_unstable();
                let mut start = (parity.count > 0).then_some(columns.start);
                for same in crossings.chunk_by(|a, b| a.0 == b.0) {
                    same.iter().for_each(|(_, part)| parity.toggle(*part));
                    let column = same[0].0;
                    match start {
                        Some(from) if parity.count == 0 => {
                            if from < column {
                                each(row, from..column);
                            }
                            start = None;
                        }
                        None if parity.count > 0 => start = Some(column),
                        _ => {}
                    }
                }
                if let Some(from) = start.filter(|from| *from < columns.end) {
                    each(row, from..columns.end);
                }
                // Invariant: toggling again restores the state left of the box, where the next row
                // starts.
                crossings.iter().for_each(|(_, part)| parity.toggle(*part));
            }
            // (Toggles after the last row were not applied.)
            let done = left.len() - toggles.len();
            left[..done].iter().for_each(|(_, part)| parity.toggle(*part));
            (parity.left, parity.crossings) = (left, crossings);
            row = rows.end;
        }
    }

    /// Collects the edges that may cross some columns in a band's rows, and the rows from which on
    /// edges to the left of the columns toggle their parts.
    fn gather(&self, rows: Range<u64>, columns: Range<u64>, near: &mut Vec<u32>, parity: &mut Parity) {
        let [low, high] = [centre(rows.start), centre(rows.end - 1)];
        let (left, right) = (columns.start as f64 + 0.5, columns.end as f64);
        near.clear();
        parity.left.clear();
        for number in self.edges.numbers_between(low, high) {
            let [a, b] = &self.edges.edges[number as usize];
            let (from, to) = (a[1].min(b[1]), a[1].max(b[1]));
            if to <= low || from > high || a[0].min(b[0]) > right {
                continue;
            }
            if a[0].max(b[0]) > left {
                near.push(number);
                continue;
            }
            for end in [from, to] {
                parity.left.push((first_row(end, &rows), self.part_of[number as usize]));
            }
        }
        parity.left.sort_unstable();
    }
}
