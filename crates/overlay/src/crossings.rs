//! Grid cells in which edges cross.

use crate::chords::alternating_pairs;
use crate::edges::Edge;
use crate::exact::{Cell, Point, crossing_cell, do_cross};
use crate::memory_limit::{MemoryLimit, SQUARES_PER_CHECK};
use spinney_base::Result;

/// Up to this number of edges, all pairs are tested.
const FEW: usize = 16;

/// A square of cells: its first cell and its side in cells, a power of two.
#[derive(Clone, Copy)]
pub(crate) struct Square {
    pub(crate) first: Cell,
    pub(crate) side: i64,
}

impl Square {
    /// Returns the smallest such square that starts at `low` and contains `high`.
    pub(crate) fn around(low: Cell, high: Cell) -> Square {
        let span = (high[0] - low[0]).max(high[1] - low[1]) + 1;
        Square { first: low, side: (span as u64).next_power_of_two() as i64 }
    }

    /// Returns the coordinates of the two lines that divide the square into quarters. They run
    /// between cells.
    pub(crate) fn middle(&self) -> Point {
        let half = self.side / 2;
        [(self.first[0] + half) as f64 - 0.5, (self.first[1] + half) as f64 - 0.5]
    }

    pub(crate) fn quarter(&self, index: usize) -> Square {
        let half = self.side / 2;
        let [x, y] = self.first;
        Square { first: [x + half * (index as i64 & 1), y + half * (index as i64 >> 1)], side: half }
    }

    /// Whether an edge has an end in the square or on its border.
    fn has_end(&self, ends: [Point; 2]) -> bool {
        let low = self.first.map(|first| first as f64 - 0.5);
        let is_in =
            |end: Point| (0..2).all(|axis| (0.0..=self.side as f64).contains(&(end[axis] - low[axis])));
        is_in(ends[0]) || is_in(ends[1])
    }

    /// Whether an edge may reach into the square; `false` only if it certainly does not.
    fn may_have(&self, [a, b]: [Point; 2]) -> bool {
        let low = [self.first[0] as f64 - 0.5, self.first[1] as f64 - 0.5];
        let high = [low[0] + self.side as f64, low[1] + self.side as f64];
        if a[0] > high[0] || b[0] < low[0] || a[1].min(b[1]) > high[1] || a[1].max(b[1]) < low[1] {
            return false;
        }
        let along = [b[0] - a[0], b[1] - a[1]];
        let side = |x: f64, y: f64| {
            let (left, right) = (along[0] * (y - a[1]), along[1] * (x - a[0]));
            let difference = left - right;
            let is_sure = difference.abs() > (left.abs() + right.abs()) * 8.0 * f64::EPSILON;
            if !is_sure {
                0
            } else if difference > 0.0 {
                1
            } else {
                -1
            }
        };
        let sides =
            [side(low[0], low[1]), side(high[0], low[1]), side(low[0], high[1]), side(high[0], high[1])];
        !(sides == [1; 4] || sides == [-1; 4])
    }

    /// Returns the quarters that an edge may reach into, one bit each.
    pub(crate) fn quarters_of(&self, ends: [Point; 2]) -> u8 {
        let [x, y] = self.middle();
        let [a, b] = ends;
        let (low, high) = (a[1].min(b[1]), a[1].max(b[1]));
        let columns = u8::from(a[0] <= x) | u8::from(b[0] >= x) << 1;
        let rows = u8::from(low <= y) | u8::from(high >= y) << 1;
        let mut quarters = 0;
        for index in 0..4 {
            if columns >> (index & 1) & 1 == 1 && rows >> (index >> 1) & 1 == 1 {
                quarters |= 1 << index;
            }
        }
        if columns == 3 && rows == 3 {
            for index in 0..4 {
                if !self.quarter(index).may_have(ends) {
                    quarters &= !(1 << index);
                }
            }
        }
        quarters
    }
}

/// Finds all cells in which edges cross, each once, in order.
///
/// # Errors
/// If they exceed the memory limit; on cancellation.
pub(crate) fn crossings(
    edges: &[Edge<Point>],
    square: Square,
    memory_limit: &MemoryLimit<'_>,
) -> Result<Vec<Cell>> {
    let mut stack: Vec<u32> = (0..edges.len() as u32).collect();
    let mut search =
        CrossingSearch { edges, found: Vec::new(), max_found: 1 << 16, squares: 0, memory_limit };
    search.square(square, &mut stack, 0)?;
    search.unite();
    memory_limit.check(search.found.len())?;
    Ok(search.found)
}

struct CrossingSearch<'a> {
    edges: &'a [Edge<Point>],
    /// Cells, possibly with duplicates.
    found: Vec<Cell>,
    /// Cell count above which duplicates are removed.
    max_found: usize,
    squares: u64,
    memory_limit: &'a MemoryLimit<'a>,
}

impl CrossingSearch<'_> {
    /// Searches a square for crossings of the edges in `stack[from..]`, which it removes from the
    /// stack.
    fn square(&mut self, square: Square, stack: &mut Vec<u32>, from: usize) -> Result<()> {
        self.squares += 1;
        if self.squares.is_multiple_of(SQUARES_PER_CHECK) {
            self.memory_limit.check(0)?;
        }
        let count = stack.len() - from;
        if count <= FEW {
            self.pairs(&stack[from..])?;
        } else if square.side == 1 {
            // With many edges in one cell, the cell snaps them all, wherever in it they cross.
            self.found.push(square.first);
        } else {
            let ends = |position: usize| self.edges[stack[position] as usize].ends;
            if !(from..stack.len()).any(|position| square.has_end(ends(position))) {
                self.chords(&square, &stack[from..])?;
            } else {
                let quarters: Vec<u8> =
                    (from..stack.len()).map(|position| square.quarters_of(ends(position))).collect();
                for index in 0..4 {
                    let until = stack.len();
                    for (position, own) in (from..).zip(&quarters) {
                        if own >> index & 1 == 1 {
                            stack.push(stack[position]);
                        }
                    }
                    self.square(square.quarter(index), stack, until)?;
                }
            }
        }
        stack.truncate(from);
        Ok(())
    }

    /// Removes duplicate cells.
    fn unite(&mut self) {
        self.found.sort_unstable();
        self.found.dedup();
    }

    fn pairs(&mut self, numbers: &[u32]) -> Result<()> {
        for (index, one) in numbers.iter().enumerate() {
            numbers[index + 1..].iter().try_for_each(|other| self.pair(*one, *other))?;
        }
        Ok(())
    }

    /// Tests the pairs of edges that may cross in the square, for edges without an end in it.
    /// (Dividing the square would hardly separate such edges, and would never separate overlapping
    /// ones.)
    fn chords(&mut self, square: &Square, numbers: &[u32]) -> Result<()> {
        let edges = numbers.iter().map(|number| (*number, self.edges[*number as usize].ends));
        let edges: Vec<_> = edges.filter(|(_, ends)| square.may_have(*ends)).collect();
        alternating_pairs(square, &edges, &mut |one, other| self.pair(one, other))
    }

    fn pair(&mut self, one: u32, other: u32) -> Result<()> {
        let [one, other] = [one, other].map(|number| self.edges[number as usize].ends);
        let is_apart = other[0][0] > one[1][0]
            || other[1][0] < one[0][0]
            || other[0][1].min(other[1][1]) > one[0][1].max(one[1][1])
            || other[0][1].max(other[1][1]) < one[0][1].min(one[1][1]);
        if !is_apart && do_cross(one, other) {
            self.found.push(crossing_cell(one, other));
            if self.found.len() > self.max_found {
                self.unite();
                self.memory_limit.check(self.found.len())?;
                // (The limit doubles, so that duplicates are removed rarely.)
                self.max_found = self.max_found.max(2 * self.found.len());
            }
        }
        Ok(())
    }
}
