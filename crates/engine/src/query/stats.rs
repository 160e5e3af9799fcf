//! Exact statistics of any box, from zone statistics for zones within the box and from the tree for
//! zones that the box cuts.

use std::collections::BTreeMap;

use crate::store::autumnal::Autumnal;
use crate::store::goblin::Goblin;
use crate::store::records::dense::DenseBlock;
use crate::store::records::subtree::BadSkip;
use crate::tree::{Child, Source};
use spinney_base::TreeType;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Number, Sums, Value, ZoneStats};
use spinney_base::{Progress, Result};

use super::classes::{Classes, tally_of_classes};
use super::count::{Count, counter_of};
use super::folded::walk_folded;
use super::walk::{Visitor, Walked, Zone, ended, walk, walk_source};

/// Statistics of the cells of a box that are not VOID.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Number of cells that are not VOID.
    pub cells: u64,
    /// Number of VOID cells of the box within the raster.
    pub void_cells: u64,
    /// Statistics of each channel; empty if there are no cells.
    pub channels: Vec<ChannelStatistics>,
    /// Number of cells of each value, by ascending value; only for one-channel files that count
    /// classes.
    pub classes: Vec<(Number, u64)>,
    /// Number of segments whose records were read.
    pub segments_read: u64,
}

/// Statistics of one channel. The standard deviation is that of the population, with the precision
/// of an `f64` even if samples are much larger than their differences.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[allow(missing_docs)] // names are self-explanatory
pub struct ChannelStatistics {
    /// Number of cells that have a sample: all that are not VOID, unless single samples can be
    /// missing. All other numbers are of these cells, and NaN if there are none.
    pub cells: u64,
    pub min: Number,
    pub max: Number,
    pub mean: f64,
    pub standard_deviation: f64,
}

impl Statistics {
    /// Combines the statistics of disjoint sets of cells.
    pub fn of_parts(parts: &[Statistics]) -> Statistics {
        if let [part] = parts {
            return part.clone();
        }
        let mut all = Statistics::default();
        let mut classes = BTreeMap::new();
        for part in parts {
            all.cells += part.cells;
            all.void_cells += part.void_cells;
            all.segments_read += part.segments_read;
            for (value, cells) in &part.classes {
                *classes.entry(*value).or_insert(0) += cells;
            }
            if all.channels.is_empty() {
                all.channels.clone_from(&part.channels);
            } else {
                all.channels.iter_mut().zip(&part.channels).for_each(|(all, part)| all.join(part));
            }
        }
        all.classes = classes.into_iter().collect();
        all
    }
}

impl ChannelStatistics {
    /// Adds the statistics of other cells (Chan, Golub and LeVeque 1979).
    fn join(&mut self, other: &ChannelStatistics) {
        if other.cells == 0 || self.cells == 0 {
            if self.cells == 0 {
                *self = *other;
            }
            return;
        }
        let (a, b) = (self.cells as f64, other.cells as f64);
        let (all, away) = (a + b, other.mean - self.mean);
        let squares = |channel: &ChannelStatistics, cells: f64| channel.standard_deviation.powi(2) * cells;
        let squares = squares(self, a) + squares(other, b) + away * away * a * b / all;
        *self = ChannelStatistics {
            cells: self.cells + other.cells,
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            mean: self.mean + away * b / all,
            standard_deviation: (squares / all).sqrt(),
        };
    }
}

impl Goblin {
    /// Returns exact statistics of a box of cells of the deepest level, or of the whole raster. The
    /// time is proportional to the records on the box's border, not to its cells.
    ///
    /// # Errors
    /// If the file is corrupt there, or on cancellation.
    pub fn statistics(&self, bounds: Option<Bounds>, progress: &dyn Progress) -> Result<Statistics> {
        self.statistics_with(bounds, self.header().counts_classes(), progress)
    }

    /// [`Goblin::statistics`] with or without classes. Counting very many classes reads more of the
    /// file.
    pub(crate) fn statistics_with(
        &self,
        bounds: Option<Bounds>,
        count_classes: bool,
        progress: &dyn Progress,
    ) -> Result<Statistics> {
        let header = self.header();
        let extent = header.extent_bounds();
        let bounds = header.within_extent(bounds);
        // A box with the whole raster has the whole tree: the rest is VOID.
        let space = Bounds::space(header.form.dimension, header.depth());
        let mut gather = Gather::new(header.form, count_classes, progress);
        ended(walk(self, if bounds == extent { &space } else { &bounds }, &mut gather))?;
        Ok(gather.finish(bounds.volume()))
    }
}

/// [`Goblin::statistics`] of any source; visits all of its nodes in the box.
pub(crate) fn source_statistics<S: Source>(
    source: &S,
    bounds: &Bounds,
    count_classes: bool,
    progress: &dyn Progress,
) -> Result<Statistics> {
    let mut gather = Gather::new(source.form(), count_classes, progress);
    ended(walk_source(source, bounds, &mut gather))?;
    Ok(gather.finish(bounds.volume()))
}

/// [`Goblin::statistics`] of an Autumnal file, with or without classes.
pub(crate) fn autumnal_statistics(
    file: &Autumnal,
    bounds: &Bounds,
    counts_classes: bool,
    progress: &dyn Progress,
) -> Result<Statistics> {
    let (header, volume) = (file.header(), bounds.volume());
    // The whole raster is the whole tree, whatever its node count.
    if *bounds == header.extent_bounds()
        && let Child::Inner { node, .. } = file.root_child()
        && let Some(tally) = file.tally(&node)?
        && !(counts_classes && tally.lacks_classes())
    {
        return Ok(tally_statistics(tally, volume, counts_classes));
    }
    if !file.is_folded()? {
        return source_statistics(file, bounds, counts_classes, progress);
    }
    let mut gather = Gather::new(header.form, counts_classes, progress);
    walk_folded(file, bounds, &mut gather)?;
    Ok(gather.finish(volume))
}

/// Returns the tally of all cells of a box, which may extend beyond the raster: entirely covered
/// nodes are not clipped. Includes classes if `count_classes` is set.
///
/// # Errors
/// If the file is corrupt there.
pub(crate) fn tally_of(file: &Goblin, bounds: &Bounds, count_classes: bool) -> Result<ZoneStats> {
    let mut gather = Gather::new(file.header().form, count_classes, &());
    ended(walk(file, bounds, &mut gather))?;
    Ok(gather.count.finish())
}

/// Returns the statistics of all cells of a tally, for a box of `volume` cells.
fn tally_statistics(tally: ZoneStats, volume: u64, count_classes: bool) -> Statistics {
    let tally = if count_classes { tally_of_classes(tally.value_type, tally.classes) } else { tally };
    summary(&tally, volume, 0)
}

pub(super) fn summary(tally: &ZoneStats, volume: u64, segments_read: u64) -> Statistics {
    let value_type = tally.value_type;
    let (min, max) = (value_type.numbers(tally.min), value_type.numbers(tally.max));
    let channel = |channel: usize| {
        let cells = tally.present[channel];
        if cells == 0 {
            let none = f64::NAN;
            let (min, max) = (Number::NAN, Number::NAN);
            return ChannelStatistics { cells, min, max, mean: none, standard_deviation: none };
        }
        let (min, max) = (min[channel], max[channel]);
        // (Rounding must not cause a deviation of equal samples.)
        let variance = if min == max && min.is_finite() {
            0.0
        } else {
            Sums::variance(&tally.sum, &tally.squares, channel, cells)
        };
        let mean = tally.sum.number(channel) / cells as f64;
        ChannelStatistics { cells, min, max, mean, standard_deviation: variance.sqrt() }
    };
    let classes = if value_type.channels == 1 { &tally.classes[..] } else { &[] };
    let channels = if tally.cells > 0 { usize::from(value_type.channels) } else { 0 };
    Statistics {
        cells: tally.cells,
        void_cells: volume.saturating_sub(tally.cells),
        channels: (0..channels).map(channel).collect(),
        classes: classes.iter().map(|(value, cells)| (value_type.first_number(*value), *cells)).collect(),
        segments_read,
    }
}

/// Accumulates the statistics of a box.
struct Gather<'a> {
    count: Box<dyn Count>,
    segments: u64,
    progress: &'a dyn Progress,
}

impl Gather<'_> {
    fn new(form: TreeType, count_classes: bool, progress: &dyn Progress) -> Gather<'_> {
        // If classes are counted, everything else follows from the counts.
        let count = if count_classes { Box::new(Classes::new(form)) } else { counter_of(form) };
        Gather { count, segments: 0, progress }
    }

    fn finish(self, volume: u64) -> Statistics {
        summary(&self.count.finish(), volume, self.segments)
    }
}

impl Visitor for Gather<'_> {
    fn zone(&mut self, _: Code, zone: &dyn Zone) -> Walked<bool> {
        Ok(self.count.zone(zone)?)
    }

    #[inline]
    fn block(&mut self, _: Code, value: Option<Value>, cells: u64, _: Option<&Bounds>) -> Walked {
        if let Some(value) = value {
            self.count.block(value, cells);
        }
        Ok(())
    }

    fn subtree(&mut self, _: Code, records: &[u8], levels: u8) -> Option<Result<(), BadSkip>> {
        Some(self.count.subtree(records, levels))
    }

    fn dense(&mut self, _: Code, block: &DenseBlock<'_>, part: ([usize; 3], [usize; 3])) -> bool {
        self.count.dense(block, part);
        true
    }

    fn reads_zones(&self) -> bool {
        self.count.reads_zones()
    }

    fn leave(&mut self, _: Code) -> Walked {
        Ok(self.progress.check()?)
    }

    fn enter_segment(&mut self) {
        self.segments += 1;
    }
}
