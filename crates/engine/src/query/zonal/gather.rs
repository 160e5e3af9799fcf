//! Statistics of a zone in the making.

use super::super::classes::Classes;
use super::super::count::{Count, counter_of};
use super::super::walk::{Visitor, Walked, Zone};
use super::ZonalTree;
use super::cells::ZoneCells;
use super::parts::Parts;
use super::request::{ZonalRequest, ZoneStatistics};
use super::values::{Values, of_classes};
use crate::store::records::dense::DenseBlock;
use crate::store::records::subtree::BadSkip;
use spinney_base::space::{Bounds, Code, Crossings, EdgeRule};
use spinney_base::value::Value;
use spinney_base::{Progress, Result};

/// Statistics of a zone in the making.
pub(super) struct Gather<'a> {
    zone: &'a ZoneCells<'a>,
    request: &'a ZonalRequest,
    depth: u8,
    /// Whole cells.
    count: Box<dyn Count>,
    /// Parts of cells.
    parts: Parts,
    /// Cells of each sample, if they are asked for and not counted as classes.
    values: Option<Values>,
    counts_classes: bool,
    /// Room to work in.
    crossings: Crossings,
    progress: &'a dyn Progress,
}

/// The share of a block below which its part in a zone is nothing but rounding.
const ROUNDING: f64 = 1e-12;

impl<'a> Gather<'a> {
    /// Nothing yet; `memory` is for single values.
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
            parts: Parts::new(form, counts_classes),
            values: (request.needs_values() && !is_counted).then(|| Values::new(form, memory)),
            counts_classes: is_counted,
            crossings: Crossings::default(),
            progress,
        }
    }

    /// The statistics.
    ///
    /// # Errors
    /// If temporary files cannot be used.
    pub(super) fn finish(mut self) -> Result<ZoneStatistics> {
        let all = self.zone.measure(&self.zone.picture, &mut self.crossings);
        let mut told = self.parts.with(&self.count.finish(), all);
        told.outside_cells = self.zone.outside();
        if let Some(values) = self.values {
            let cells: Vec<f64> = told.channels.iter().map(|channel| channel.cells).collect();
            let found = values.finish(&cells, self.request)?;
            told.channels.iter_mut().zip(found).for_each(|(channel, values)| channel.values = values);
        } else if self.counts_classes
            && self.request.needs_values()
            && let Some(channel) = told.channels.first_mut()
        {
            channel.values = of_classes(&told.classes, self.request);
        }
        Ok(told)
    }
}

impl Visitor for Gather<'_> {
    fn zone(&mut self, _: Code, zone: &dyn Zone) -> Walked<bool> {
        if let Some(values) = &mut self.values
            && !values.zone(&zone.tally()?)
        {
            return Ok(false);
        }
        Ok(self.count.zone(zone)?)
    }

    fn block(&mut self, _: Code, value: Option<Value>, cells: u64, part: Option<&Bounds>) -> Walked {
        let Some(value) = value else { return Ok(()) };
        let inside = part.map_or(cells as f64, |part| self.zone.measure(part, &mut self.crossings));
        if inside <= ROUNDING * cells as f64 {
            return Ok(());
        }
        match (part, self.zone.rule) {
            (Some(_), EdgeRule::Area) => self.parts.block(value, inside),
            _ => self.count.block(value, inside as u64),
        }
        if let Some(values) = &mut self.values {
            values.block(value, inside);
        }
        Ok(())
    }

    fn subtree(&mut self, records: &[u8], levels: u8) -> Option<Result<(), BadSkip>> {
        let counted = self.count.subtree(records, levels);
        let values = self.values.as_mut().map_or(Ok(()), |values| values.subtree(records, levels));
        Some(counted.and(values))
    }

    fn dense(&mut self, code: Code, block: &DenseBlock<'_>, (first, size): ([usize; 3], [usize; 3])) -> bool {
        let (count, parts, values) = (&mut self.count, &mut self.parts, &mut self.values);
        let origin = code.bounds(self.depth).min;
        let part = Bounds {
            min: [origin[0], origin[1], 0],
            max: [origin[0] + size[0] as u64, origin[1] + size[1] as u64, 1],
        };
        self.zone.spans(&part, &mut self.crossings, &mut |row, span, share| {
            let from = [(span.start - origin[0]) as usize, (row - origin[1]) as usize];
            let at = [first[0] + from[0], first[1] + from[1], first[2]];
            let part = (at, [(span.end - span.start) as usize, 1, size[2]]);
            match share {
                1.0 => count.dense(block, part),
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
