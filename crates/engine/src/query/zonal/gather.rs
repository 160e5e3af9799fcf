//! Accumulates the statistics of a zone.

use super::super::classes::Classes;
use super::super::count::{Count, counter_of};
use super::super::walk::{Visitor, Walked, Zone};
use super::ZonalTree;
use super::cells::{CellCount, ZoneCells, in_shares};
use super::parts::PartialCellSums;
use super::request::{ZonalRequest, ZoneStatistics};
use super::values::{Values, of_classes};
use crate::store::records::dense::DenseBlock;
use crate::store::records::subtree::BadSkip;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::Value;
use spinney_base::{Progress, Result};
use spinney_overlay::{Crossings, FULL_SHARE};

/// Statistics of a zone in progress.
pub(super) struct Gather<'a> {
    zone: &'a ZoneCells<'a>,
    request: &'a ZonalRequest,
    depth: u8,
    /// Statistics of full cells.
    count: Box<dyn Count>,
    /// Statistics of partial cells.
    parts: PartialCellSums,
    /// All cells of the zone within the raster, including VOID ones, in shares.
    all: u128,
    /// Cell counts per sample, if they are requested and not counted as classes.
    values: Option<Values>,
    counts_classes: bool,
    /// Scratch buffer.
    crossings: Crossings,
    progress: &'a dyn Progress,
}

impl<'a> Gather<'a> {
    /// Creates an empty accumulator. `memory` is the limit in bytes for single values.
    pub(super) fn new(
        tree: &ZonalTree<'_>,
        zone: &'a ZoneCells<'a>,
        (request, memory): (&'a ZonalRequest, u64),
        progress: &'a dyn Progress,
    ) -> Gather<'a> {
        let (form, counts_classes) = (tree.form, tree.counts_classes);
        let is_counted = counts_classes && form.value.channels == 1;
        Gather {
            zone,
            request,
            depth: tree.depth,
            count: if counts_classes { Box::new(Classes::new(form)) } else { counter_of(form) },
            parts: PartialCellSums::new(form, counts_classes),
            all: 0,
            values: (request.needs_values() && !is_counted).then(|| Values::new(form, memory)),
            counts_classes: is_counted,
            crossings: Crossings::default(),
            progress,
        }
    }

    /// Returns the statistics.
    ///
    /// # Errors
    /// If temporary files cannot be used.
    pub(super) fn finish(self) -> Result<ZoneStatistics> {
        let mut statistics = self.parts.with(&self.count.finish(), self.all);
        statistics.outside_cells = self.zone.outside();
        if let Some(values) = self.values {
            let cells: Vec<f64> = statistics.channels.iter().map(|channel| channel.cells).collect();
            let found = values.finish(&cells, self.request)?;
            statistics.channels.iter_mut().zip(found).for_each(|(channel, values)| channel.values = values);
        } else if self.counts_classes
            && self.request.needs_values()
            && let Some(channel) = statistics.channels.first_mut()
        {
            channel.values = of_classes(&statistics.classes, self.request);
        }
        Ok(statistics)
    }

    /// Counts all cells of a node within the raster.
    fn count_all(&mut self, code: Code) {
        let bounds = code.bounds(self.depth).intersect(&self.zone.extent);
        self.all += in_shares((bounds.volume(), 0));
    }
}

impl Visitor for Gather<'_> {
    fn zone(&mut self, code: Code, zone: &dyn Zone) -> Walked<bool> {
        if let Some(values) = &mut self.values
            && !values.zone(&zone.tally()?)
        {
            return Ok(false);
        }
        let is_counted = self.count.zone(zone)?;
        if is_counted {
            self.count_all(code);
        }
        Ok(is_counted)
    }

    fn block(&mut self, code: Code, value: Option<Value>, cells: u64, part: Option<&Bounds>) -> Walked {
        let count: CellCount = match part {
            None if value.is_none() => {
                self.count_all(code);
                return Ok(());
            }
            None => (cells, 0),
            Some(part) => self.zone.count(&part.intersect(&self.zone.extent), &mut self.crossings),
        };
        let shares = in_shares(count);
        self.all += shares;
        let Some(value) = value.filter(|_| shares > 0) else { return Ok(()) };
        if count.0 > 0 {
            self.count.block(value, count.0);
        }
        if count.1 > 0 {
            self.parts.block(value, count.1);
        }
        if let Some(values) = &mut self.values {
            values.block(value, shares);
        }
        Ok(())
    }

    fn subtree(&mut self, code: Code, records: &[u8], levels: u8) -> Option<Result<(), BadSkip>> {
        self.count_all(code);
        let counted = self.count.subtree(records, levels);
        let values = self.values.as_mut().map_or(Ok(()), |values| values.subtree(records, levels));
        Some(counted.and(values))
    }

    fn dense(&mut self, code: Code, block: &DenseBlock<'_>, (first, size): ([usize; 3], [usize; 3])) -> bool {
        let (count, parts, values, all) = (&mut self.count, &mut self.parts, &mut self.values, &mut self.all);
        let origin = code.bounds(self.depth).min;
        // (Cells outside of the raster are VOID.)
        let extent = &self.zone.extent;
        let [columns, rows, layers] =
            [0, 1, 2].map(|axis| (size[axis] as u64).min(extent.max[axis].saturating_sub(origin[axis])));
        let part = Bounds { min: [origin[0], origin[1], 0], max: [origin[0] + columns, origin[1] + rows, 1] };
        self.zone.spans(&part, &mut self.crossings, &mut |row, span, share| {
            *all += u128::from(share) * u128::from((span.end - span.start) * layers);
            let from = [(span.start - origin[0]) as usize, (row - origin[1]) as usize];
            let at = [first[0] + from[0], first[1] + from[1], first[2]];
            let part = (at, [(span.end - span.start) as usize, 1, size[2]]);
            match share {
                FULL_SHARE => count.dense(block, part),
                share => parts.dense(block, part, share),
            }
            if let Some(values) = values {
                values.dense(block, part, share);
            }
        });
        true
    }

    fn reads_zones(&self) -> bool {
        self.count.reads_zones()
    }

    fn leave(&mut self, _: Code) -> Walked {
        Ok(self.progress.check()?)
    }
}
