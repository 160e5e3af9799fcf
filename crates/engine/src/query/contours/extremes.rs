//! Extremes of the first channel of a node's cells.

use crate::query::count::counter_of;
use crate::query::stats::tally_of;
use crate::store::goblin::Goblin;
use crate::tree::{Child, Source, no_children};
use spinney_base::Result;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::ZoneStats;

/// Bounds of the values of some cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extremes {
    /// Minimum value.
    pub min: f64,
    /// Maximum value.
    pub max: f64,
    /// Whether there may be values.
    pub has_values: bool,
    /// Whether there may be cells without a value.
    pub has_void: bool,
}

impl Extremes {
    /// No cells.
    pub const NONE: Extremes =
        Extremes { min: f64::INFINITY, max: f64::NEG_INFINITY, has_values: false, has_void: false };

    /// Cells of which nothing is known.
    pub const UNKNOWN: Extremes =
        Extremes { min: f64::NEG_INFINITY, max: f64::INFINITY, has_values: true, has_void: true };

    /// Returns the extremes of `cells` cells from the tally of their values.
    fn of(tally: &ZoneStats, cells: u64) -> Extremes {
        let number = |value| tally.value_type.first_sample(value);
        let count = tally.present[0];
        if count == 0 {
            return Extremes { has_void: true, ..Extremes::NONE };
        }
        let (min, max) = (number(tally.min), number(tally.max));
        // (Lines do not pass through values that are not finite, and only some of the values may be
        // such.)
        if !min.is_finite() || !max.is_finite() {
            return Extremes::UNKNOWN;
        }
        Extremes { min, max, has_values: true, has_void: count < cells }
    }

    /// Returns the extremes of both sets of cells.
    pub fn with(self, other: Extremes) -> Extremes {
        Extremes {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            has_values: self.has_values || other.has_values,
            has_void: self.has_void || other.has_void,
        }
    }

    /// Returns the extremes of the same cells if VOID ones count as zero.
    pub fn with_zeros(self) -> Extremes {
        if !self.has_void {
            return self;
        }
        Extremes {
            min: self.min.min(0.0),
            max: self.max.max(0.0),
            has_values: true,
            has_void: self == Extremes::UNKNOWN,
        }
    }
}

/// Returns the extremes of a node of a Goblin file from its stored statistics.
///
/// # Errors
/// If the file is corrupt there.
pub(crate) fn file_extremes(file: &Goblin, code: Code) -> Result<Extremes> {
    let bounds = code.bounds(file.header().depth());
    let cells = bounds.intersect(&file.header().extent_bounds()).volume();
    // The segment index has those of nodes with segments, without opening the segments.
    if let Some(index) = file.find_segment(code)? {
        let entry = file.entry(index)?;
        if entry.code == code {
            return Ok(Extremes::of(&entry.zone, cells));
        }
    }
    Ok(Extremes::of(&tally_of(file, &bounds, false)?, cells))
}

/// Returns the extremes of a node of any source. `extent` is the box of the cells that may be
/// other than VOID. The extremes of nodes without a stored tally are unknown.
///
/// # Errors
/// If the source fails.
pub(crate) fn source_extremes<S: Source>(source: &S, extent: &Bounds, code: Code) -> Result<Extremes> {
    let cells = code.bounds(source.depth()).intersect(extent).volume();
    let (mut child, mut children) = (source.root()?, no_children());
    for level in 0..code.level() {
        let Child::Inner { node, .. } = &child else { break };
        source.children(node, &mut children)?;
        child = std::mem::take(&mut children[code.step(level)]);
    }
    let mut count = counter_of(source.form());
    match &child {
        Child::Void => {}
        Child::Leaf(value) => count.block(*value, cells),
        Child::Inner { node, .. } => {
            let tally = source.tally(node)?;
            return Ok(tally.map_or(Extremes::UNKNOWN, |tally| Extremes::of(&tally, cells)));
        }
    }
    Ok(Extremes::of(&count.finish(), cells))
}
