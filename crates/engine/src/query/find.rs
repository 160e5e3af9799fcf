//! Searches for blocks by value. Zone statistics exclude or accept whole zones.

use crate::store::goblin::Goblin;
use crate::tree::Source;
use spinney_base::TreeType;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Number, Value, ZoneStats};
use spinney_base::{Progress, Result};

use super::count::exact_number_of;
use super::walk::{Halt, Visitor, Walked, Zone, ended, walk, walk_source};

/// Condition on the first channel of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Condition {
    /// Values greater than this.
    Above(Number),
    /// Values less than this.
    Below(Number),
    /// Values equal to this.
    Equal(Number),
}

impl Condition {
    /// Returns the condition for numbers with an unsigned zero, since both zeros are equal here. A
    /// NaN bound is never met.
    fn plain(self) -> Condition {
        match self {
            Condition::Above(bound) | Condition::Below(bound) if bound.is_nan() => Condition::Equal(bound),
            Condition::Above(bound) => Condition::Above(bound.with_plain_zero()),
            Condition::Below(bound) => Condition::Below(bound.with_plain_zero()),
            Condition::Equal(wanted) => Condition::Equal(wanted.with_plain_zero()),
        }
    }

    #[inline]
    fn met_by(self, number: Number) -> bool {
        match self {
            Condition::Above(bound) => number > bound,
            Condition::Below(bound) => number < bound,
            Condition::Equal(wanted) => number == wanted,
        }
    }

    /// Returns whether all (`true`) or none (`false`) of a zone's values meet the condition, or
    /// `None` if the extremes do not determine it.
    fn of_zone(self, min: Number, max: Number) -> Option<bool> {
        match self {
            Condition::Above(_) | Condition::Below(_) if self.met_by(min) == self.met_by(max) => {
                Some(self.met_by(min))
            }
            Condition::Equal(wanted) if wanted < min || wanted > max => Some(false),
            Condition::Equal(_) if min == max => Some(true),
            _ => None,
        }
    }
}

/// A block whose cells all meet a condition.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundBlock {
    /// The node's FD code as a string: `/` and one digit per level.
    pub code: String,
    /// Level of the node.
    pub level: u8,
    /// Its cells, of the deepest level.
    pub bounds: Bounds,
    /// The value, if it is the same throughout.
    pub value: Option<Number>,
}

impl Goblin {
    /// Passes the largest blocks in a box all of whose cells meet a condition to `found`, in FD
    /// order, until it returns `false`. VOID never meets a condition.
    ///
    /// # Errors
    /// If the file is corrupt there, if `found` fails, or on cancellation.
    pub fn find(
        &self,
        condition: Condition,
        bounds: Option<Bounds>,
        progress: &dyn Progress,
        found: &mut dyn FnMut(FoundBlock) -> Result<bool>,
    ) -> Result<()> {
        let header = self.header();
        let bounds = header.within_extent(bounds);
        let mut search = Search::new(header.form, header.depth(), condition, progress, found);
        let walked = walk(self, &bounds, &mut search);
        search.finish(walked)
    }
}

/// [`Goblin::find`] in any source; visits all of its nodes in the box.
pub(crate) fn source_find<S: Source>(
    source: &S,
    condition: Condition,
    bounds: &Bounds,
    progress: &dyn Progress,
    found: &mut dyn FnMut(FoundBlock) -> Result<bool>,
) -> Result<()> {
    let mut search = Search::new(source.form(), source.depth(), condition, progress, found);
    let walked = walk_source(source, bounds, &mut search);
    search.finish(walked)
}

struct Search<'a> {
    form: TreeType,
    depth: u8,
    condition: Condition,
    /// Returns the first sample of a value.
    number: fn(Value) -> Number,
    progress: &'a dyn Progress,
    found: &'a mut dyn FnMut(FoundBlock) -> Result<bool>,
    /// Blocks found since the last cell that does not meet the condition. They may belong to a
    /// larger block. Complete siblings are replaced by their parent, so the list stays short.
    pending: Vec<(Code, Option<Number>)>,
    /// Whether a subtree was missed. Later blocks are returned by the next pass.
    has_missed: bool,
}

impl<'a> Search<'a> {
    fn new(
        form: TreeType,
        depth: u8,
        condition: Condition,
        progress: &'a dyn Progress,
        found: &'a mut dyn FnMut(FoundBlock) -> Result<bool>,
    ) -> Search<'a> {
        let (number, condition) = (exact_number_of(form.value), condition.plain());
        Search { form, depth, condition, number, progress, found, pending: Vec::new(), has_missed: false }
    }

    fn finish(mut self, walked: Walked) -> Result<()> {
        ended(walked.and_then(|()| self.miss()))
    }

    /// Called when something does not meet the condition: pending blocks cannot grow any more.
    #[inline]
    fn miss(&mut self) -> Walked {
        if self.pending.is_empty() { Ok(()) } else { self.hand_out() }
    }

    /// Passes all pending blocks to `found`.
    #[inline(never)]
    fn hand_out(&mut self) -> Walked {
        // Invariant: all passes find the same blocks in the same order, up to the first subtree
        // that one of them missed. So the blocks returned by a pass are the first ones of the next
        // pass, which skips as many.
        if self.has_missed {
            self.pending.clear();
            return Ok(());
        }
        let depth = self.depth;
        for (code, value) in self.pending.drain(..) {
            let bounds = code.bounds(depth);
            if !(self.found)(FoundBlock { code: code.to_string(), level: code.level(), bounds, value })? {
                return Err(Halt::Stopped);
            }
        }
        Ok(())
    }

    /// Adds the largest blocks within the box, of a uniform block that meets the condition but
    /// extends beyond the box.
    fn split(&mut self, code: Code, value: Number, part: &Bounds) -> Walked {
        let whole = code.bounds(self.depth);
        if part.contains(&whole) {
            self.pending.push((code, Some(value)));
            return Ok(());
        }
        if part.intersect(&whole).is_empty() {
            return self.miss();
        }
        (0..self.form.children()).try_for_each(|child| self.split(code.child(child), value, part))
    }
}

impl Visitor for Search<'_> {
    fn zone(&mut self, code: Code, zone: &dyn Zone) -> Walked<bool> {
        let ZoneStats { present: [cells, ..], min, max, .. } = zone.tally()?;
        let full = cells == self.form.dimension.cells(self.depth - code.level());
        if cells == 0 {
            self.miss()?;
            return Ok(true);
        }
        let [min, max] = [min, max].map(|value| (self.number)(value).with_plain_zero());
        match self.condition.of_zone(min, max) {
            Some(true) if full => self.pending.push((code, None)),
            Some(false) => self.miss()?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn block(&mut self, code: Code, value: Option<Value>, _: u64, part: Option<&Bounds>) -> Walked {
        let value = value.filter(|value| self.form.value.present(*value)[0]);
        let number = value.map(self.number).filter(|number| self.condition.met_by(number.with_plain_zero()));
        match (number, part) {
            (None, _) => self.miss(),
            (Some(number), None) => {
                self.pending.push((code, Some(number)));
                Ok(())
            }
            (Some(number), Some(part)) => self.split(code, number, part),
        }
    }

    fn leave(&mut self, code: Code) -> Walked {
        self.progress.check()?;
        // If all children are pending and nothing came in between, the parent replaces them.
        // (Mostly the last child is missing.)
        let count = self.form.children();
        if self.pending.last().is_none_or(|(last, _)| *last != code.child(count - 1)) {
            return Ok(());
        }
        if let Some(first) = self.pending.len().checked_sub(count) {
            let children = &self.pending[first..];
            if children.iter().enumerate().all(|(i, (child, _))| *child == code.child(i)) {
                let value = children[0].1;
                let same = children.iter().all(|(_, other)| *other == value);
                self.pending.truncate(first);
                self.pending.push((code, value.filter(|_| same)));
            }
        }
        Ok(())
    }

    fn outside(&mut self) -> Walked {
        self.miss()
    }

    fn miss_part(&mut self) {
        self.has_missed = true;
    }
}
