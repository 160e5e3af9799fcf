//! Edges that pass through cells with vertices or crossings.

use crate::crossings::Square;
use crate::edges::Edge;
use crate::exact::{Cell, Point, passes};
use crate::grid::cell_of;
use crate::memory_limit::{MemoryLimit, SQUARES_PER_CHECK};
use spinney_base::Result;

/// Up to this number of cells, all are tested against all edges of their square.
const FEW: usize = 4;

/// An edge that passes through a cell which contains neither of its ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Passage {
    pub(crate) edge: u32,
    /// Position of the cell along the edge, as a sort key.
    place: i64,
    pub(crate) cell: Cell,
}

/// Finds all passages, ordered along each edge. Reorders `cells`.
///
/// # Errors
/// If they exceed the memory limit; on cancellation.
pub(crate) fn passages(
    edges: &[Edge<Point>],
    cells: &mut [Cell],
    square: Square,
    memory_limit: &MemoryLimit<'_>,
) -> Result<Vec<Passage>> {
    let mut stack: Vec<u32> = (0..edges.len() as u32).collect();
    let mut search = PassageSearch { edges, found: Vec::new(), squares: 0, memory_limit };
    search.square(square, &mut stack, 0, cells)?;
    search.found.sort_unstable();
    Ok(search.found)
}

struct PassageSearch<'a> {
    edges: &'a [Edge<Point>],
    found: Vec<Passage>,
    squares: u64,
    memory_limit: &'a MemoryLimit<'a>,
}

impl PassageSearch<'_> {
    /// Searches a square for passages through its cells by the edges in `stack[from..]`, which it
    /// removes from the stack. Each cell is in exactly one square.
    fn square(
        &mut self,
        square: Square,
        stack: &mut Vec<u32>,
        from: usize,
        cells: &mut [Cell],
    ) -> Result<()> {
        self.squares += 1;
        if self.squares.is_multiple_of(SQUARES_PER_CHECK) {
            self.memory_limit.check(self.found.len())?;
        }
        if stack.len() == from || cells.is_empty() {
            // There are no passages.
        } else if cells.len() <= FEW {
            for edge in &stack[from..] {
                cells.iter().for_each(|cell| self.pair(*edge, *cell));
            }
        } else {
            let [x, y] = [0, 1].map(|axis| square.first[axis] + square.side / 2);
            let middle = divide(cells, |cell| cell[1] < y);
            let (lower, upper) = cells.split_at_mut(middle);
            let (first, second) = (divide(lower, |cell| cell[0] < x), divide(upper, |cell| cell[0] < x));
            let ((first, second), (third, fourth)) = (lower.split_at_mut(first), upper.split_at_mut(second));
            let ends = |place: usize| self.edges[stack[place] as usize].ends;
            let quarters: Vec<u8> =
                (from..stack.len()).map(|place| square.quarters_of(ends(place))).collect();
            for (index, cells) in [first, second, third, fourth].into_iter().enumerate() {
                if cells.is_empty() {
                    continue;
                }
                let until = stack.len();
                for (place, own) in (from..).zip(&quarters) {
                    if own >> index & 1 == 1 {
                        stack.push(stack[place]);
                    }
                }
                self.square(square.quarter(index), stack, until, cells)?;
            }
        }
        stack.truncate(from);
        Ok(())
    }

    fn pair(&mut self, edge: u32, cell: Cell) {
        let ends = self.edges[edge as usize].ends;
        let [first, last] = ends.map(|end| end.map(cell_of));
        if cell != first && cell != last && passes(ends, cell) {
            // The cells along an edge are monotonic in both axes, so this sum increases from the
            // first end.
            let rises = if ends[1][1] >= ends[0][1] { 1 } else { -1 };
            self.found.push(Passage { edge, place: cell[0] + rises * cell[1], cell });
        }
    }
}

/// Moves the cells that match before all others and returns their number.
fn divide(cells: &mut [Cell], is_so: impl Fn(&Cell) -> bool) -> usize {
    let mut end = 0;
    for index in 0..cells.len() {
        if is_so(&cells[index]) {
            cells.swap(end, index);
            end += 1;
        }
    }
    end
}
