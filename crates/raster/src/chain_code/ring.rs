//! Chains of rings along cell sides.

use super::{ChainDirections, code_of};
use spinney_base::Result;
use spinney_engine::query::ClassRegion;

/// Receives runs of steps: a code and its repeat count.
pub(super) type StepSink<'a> = dyn FnMut(u8, u64) -> Result<()> + 'a;

/// The chain of a ring. It starts at the leftmost corner of the ring's first row, or at the cell to
/// the left of the ring's direction there.
pub(super) struct RingChain<'a> {
    region: &'a ClassRegion<'a>,
    part: usize,
    directions: ChainDirections,
    /// The corner where the chain starts, and its index in the ring.
    corner: [i64; 2],
    first: u64,
    pub(super) start: [i64; 2],
}

impl<'a> RingChain<'a> {
    /// Finds the start of the chain of a region's ring, whose points are corners of cells.
    ///
    /// # Errors
    /// If a temporary file cannot be read.
    pub(super) fn new(
        region: &'a ClassRegion<'a>,
        part: usize,
        is_outer: bool,
        directions: ChainDirections,
    ) -> Result<RingChain<'a>> {
        let (mut number, mut first, mut corner) = (0, 0, [i64::MAX; 2]);
        region.points(part, &mut |points| {
            for [x, y, _] in points {
                let at = [*x as i64, *y as i64];
                if (at[1], at[0]) < (corner[1], corner[0]) {
                    (first, corner) = (number, at);
                }
                number += 1;
            }
            Ok(())
        })?;
        // From its first corner an outer ring goes south, with its cell below; a hole's ring goes
        // east, with the cell above.
        let start = match directions {
            ChainDirections::Eight if !is_outer => [corner[0], corner[1] - 1],
            _ => corner,
        };
        Ok(RingChain { region, part, directions, corner, first, start })
    }

    /// Yields the steps of the chain.
    ///
    /// # Errors
    /// If a temporary file cannot be read, or `take` fails.
    pub(super) fn each(&self, take: &mut StepSink<'_>) -> Result<()> {
        let count = self.region.count(self.part);
        let mut tracer = RingTracer { at: self.corner, cell: self.start, directions: self.directions };
        // From the first corner to the last, then on to the first: the last point of the ring
        // repeats point 0.
        for numbers in [self.first + 1..count, 1..self.first + 1] {
            let mut number = 0;
            self.region.points(self.part, &mut |points| {
                for [x, y, _] in points {
                    if numbers.contains(&number) {
                        tracer.go([*x as i64, *y as i64], take)?;
                    }
                    number += 1;
                }
                Ok(())
            })?;
        }
        tracer.move_to(self.start, take)
    }
}

/// State of the traversal of a ring.
struct RingTracer {
    at: [i64; 2],
    /// The cell on the left.
    cell: [i64; 2],
    directions: ChainDirections,
}

impl RingTracer {
    /// Goes to a corner in the same row or column.
    fn go(&mut self, to: [i64; 2], take: &mut StepSink<'_>) -> Result<()> {
        let [across, down] = [to[0] - self.at[0], to[1] - self.at[1]];
        let steps = (across.abs() + down.abs()) as u64;
        let unit = [across.signum(), down.signum()];
        let at = std::mem::replace(&mut self.at, to);
        if steps == 0 {
            return Ok(());
        }
        let code = code_of(unit);
        if self.directions == ChainDirections::Four {
            return take(code / 2, steps);
        }
        let left_cell = match code {
            0 => [at[0], at[1] - 1],
            2 => [at[0] - 1, at[1] - 1],
            4 => [at[0] - 1, at[1]],
            _ => at,
        };
        self.move_to(left_cell, take)?;
        if steps > 1 {
            take(code, steps - 1)?;
            let more = steps as i64 - 1;
            self.cell = [left_cell[0] + unit[0] * more, left_cell[1] + unit[1] * more];
        }
        Ok(())
    }

    /// Moves from the cell on the left to one of its neighbours.
    fn move_to(&mut self, cell: [i64; 2], take: &mut StepSink<'_>) -> Result<()> {
        let step = [cell[0] - self.cell[0], cell[1] - self.cell[1]];
        if self.directions == ChainDirections::Four || step == [0; 2] {
            return Ok(());
        }
        self.cell = cell;
        take(code_of(step), 1)
    }
}
