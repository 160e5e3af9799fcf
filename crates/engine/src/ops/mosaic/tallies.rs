//! Counts and sums of nodes that intersect several files.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::Mosaic;
use super::level::positions;
use crate::query::tally_of;
use spinney_base::Result;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::ZoneStats;

/// Maximum number of cells of a node that are counted one by one where files overlap.
const COUNTED: u64 = 1 << 12;
/// Maximum number of cells of a node whose tally is exact where files overlap.
const EXACT: u64 = 1 << 16;
/// Maximum number of files whose boxes are compared with each other.
const COMPARED: usize = 64;
/// Maximum number of boxes that represent the region of a node that is not hidden so far.
const MAX_BOXES: usize = 32;
/// Number of cached tallies.
const MAX_CACHED: usize = 1 << 10;

/// Recently computed tallies.
#[derive(Default)]
pub(super) struct Tallies(Mutex<HashMap<Code, Arc<ZoneStats>>>);

impl Mosaic {
    /// Tally of a node. Where files overlap in a large node, hidden cells may count.
    ///
    /// # Errors
    /// If a file is corrupt there.
    pub(super) fn tally_of(&self, code: Code) -> Result<Arc<ZoneStats>> {
        let kept = self.tallies.0.lock().unwrap_or_else(PoisonError::into_inner).get(&code).cloned();
        if let Some(tally) = kept {
            return Ok(tally);
        }
        let tally = match self.exact_tally(code)? {
            Some(tally) => tally,
            None => self.stacked_tally(code)?,
        };
        let tally = Arc::new(tally);
        let mut kept = self.tallies.0.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() >= MAX_CACHED {
            kept.clear();
        }
        kept.insert(code, tally.clone());
        Ok(tally)
    }

    /// Tally of a node, if it follows from those of the files, or from a few cells.
    ///
    /// # Errors
    /// If a file is corrupt there.
    pub(super) fn exact_tally(&self, code: Code) -> Result<Option<ZoneStats>> {
        let cells = code.bounds(self.header.depth());
        let numbers = self.meeting(&cells);
        let is_stack = numbers.len() > COMPARED || self.overlap(&numbers, &cells);
        if !is_stack {
            let tallies = numbers.iter().map(|number| self.part_tally(*number, &cells));
            let tallies = tallies.collect::<Result<Vec<ZoneStats>>>()?;
            return Ok(Some(self.sum(&tallies)));
        }
        if cells.volume() <= COUNTED {
            let (drawn, width) = (self.draw_cells(cells)?, self.header.form.width());
            let values: Vec<_> = positions(cells).filter_map(|at| drawn.value(at, width)).collect();
            return Ok(Some(self.count(&values)));
        }
        if cells.volume() > EXACT {
            return Ok(None);
        }
        let mut parts = Vec::new();
        for step in 0..self.header.form.children() {
            match self.exact_tally(code.child(step))? {
                Some(tally) => parts.push(tally),
                None => return Ok(None),
            }
        }
        Ok(Some(self.sum(&parts)))
    }

    /// Tally of a large node in which files overlap. A box in which a file has all cells hides the
    /// files below it; otherwise both count.
    fn stacked_tally(&self, code: Code) -> Result<ZoneStats> {
        let cells = code.bounds(self.header.depth());
        let numbers = self.meeting(&cells);
        let largest = numbers.iter().map(|number| self.entry(*number).depth).max().unwrap_or(0);
        if code.level() < self.header.depth().saturating_sub(largest) && cells.volume() > EXACT {
            let parts = (0..self.header.form.children()).map(|step| self.tally_of(code.child(step)));
            let parts = parts.collect::<Result<Vec<_>>>()?;
            return Ok(self.sum(&parts.iter().map(|tally| (**tally).clone()).collect::<Vec<_>>()));
        }
        // Invariant: boxes of `rest` do not overlap, and contain all cells that no file above
        // certainly hides. No cell is lost, but some hidden ones count where a box is kept whole.
        let (mut rest, mut tallies) = (vec![cells], Vec::new());
        for number in numbers.into_iter().rev() {
            let mut open = Vec::with_capacity(rest.len());
            for part in rest {
                let own = part.intersect(&self.entry(number).bounds);
                if own.is_empty() {
                    open.push(part);
                    continue;
                }
                let tally = self.part_tally(number, &own)?;
                match tally.cells == own.volume() && open.len() < MAX_BOXES {
                    true => open.extend(without(part, &own)),
                    false => open.push(part),
                }
                tallies.push(tally);
            }
            rest = open;
        }
        Ok(self.sum(&tallies))
    }

    /// Tally of a file's cells in a box.
    fn part_tally(&self, number: u32, cells: &Bounds) -> Result<ZoneStats> {
        let bounds = self.entry(number).bounds;
        let own = cells.intersect(&bounds).within(&bounds);
        tally_of(&*self.file(number)?, &own, self.header.counts_classes())
    }

    fn sum(&self, tallies: &[ZoneStats]) -> ZoneStats {
        if tallies.is_empty() {
            return ZoneStats::void(self.header.form.value);
        }
        ZoneStats::merge(&tallies.iter().collect::<Vec<_>>())
    }

    /// Whether the boxes of some files intersect each other within a box.
    fn overlap(&self, numbers: &[u32], cells: &Bounds) -> bool {
        let part = |number: &u32| self.entry(*number).bounds.intersect(cells);
        numbers.iter().enumerate().any(|(at, number)| {
            let own = part(number);
            numbers[at + 1..].iter().any(|other| !part(other).intersect(&own).is_empty())
        })
    }
}

/// A box minus a box inside of it: up to six boxes.
fn without(mut rest: Bounds, hole: &Bounds) -> Vec<Bounds> {
    let mut parts = Vec::new();
    for axis in 0..3 {
        let (mut before, mut after) = (rest, rest);
        before.max[axis] = hole.min[axis];
        after.min[axis] = hole.max[axis];
        parts.extend([before, after].into_iter().filter(|part| !part.is_empty()));
        (rest.min[axis], rest.max[axis]) = (hole.min[axis], hole.max[axis]);
    }
    parts
}
