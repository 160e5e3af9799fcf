//! Zonal statistics: statistics of the cells in polygons.
//!
//! The tree is walked from the root down as for a box. What lies in a polygon as a whole is counted by the statistics that
//! the tree stores; what a border cuts is gone into, down to uniform blocks, whose part in the polygon is counted in rows,
//! or measured.

use std::collections::{BTreeMap, HashMap};

use super::classes::Classes;
use super::count::{Count, counter_of};
use super::stats::{ChannelStatistics, Statistics, summary};
use super::walk::{Selection, Visitor, Walked, Zone, ended, walk, walk_source};
use crate::store::goblin::Goblin;
use crate::store::records::dense::DenseBlock;
use crate::store::records::subtree::BadSkip;
use crate::tree::Source;
use spinney_base::Form;
use spinney_base::parallel;
use spinney_base::space::{Bounds, Code, Cover, Crossings, EdgeRule, Polygon};
use spinney_base::value::{Number, Value, ValueType};
use spinney_base::{Progress, Result};

/// Statistics of the cells in a polygon.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ZoneStatistics {
    /// Cells that are not VOID. (By [`EdgeRule::Area`] these, and all other numbers of cells, need not be whole.)
    pub cells: f64,
    /// Cells within the picture that are VOID.
    pub void_cells: f64,
    /// Statistics of each channel; nothing if there are no cells.
    pub channels: Vec<ZoneChannel>,
    /// Cells of each value, by ascending value; only for one-channel files that count classes.
    pub classes: Vec<(Number, f64)>,
}

/// Statistics of one channel in a polygon; the standard deviation is that of the population.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[allow(missing_docs)] // the names say it
pub struct ZoneChannel {
    /// Cells that have a sample. All other numbers are not a number if there are none.
    pub cells: f64,
    pub min: Number,
    pub max: Number,
    pub mean: f64,
    pub standard_deviation: f64,
}

/// Statistics of the cells in each of some polygons, whose corners are in cells; time goes with the nodes along their borders.
///
/// # Errors
/// If the file is damaged there, or on interruption.
pub fn zonal(
    tree: &Goblin,
    polygons: &[Polygon],
    rule: EdgeRule,
    progress: &dyn Progress,
) -> Result<Vec<ZoneStatistics>> {
    let header = tree.header();
    let (form, counts_classes) = (header.form, header.counts_classes());
    each_zone(
        (form, header.depth(), counts_classes),
        header.picture(),
        polygons,
        rule,
        progress,
        &|zone, gather| walk(tree, zone, gather),
    )
}

/// [`zonal`] of any source; `picture` are the cells that can be other than VOID.
pub(crate) fn source_zonal<S: Source>(
    source: &S,
    (picture, counts_classes): (Bounds, bool),
    polygons: &[Polygon],
    rule: EdgeRule,
    progress: &dyn Progress,
) -> Result<Vec<ZoneStatistics>> {
    let tree = (source.form(), source.depth(), counts_classes);
    each_zone(tree, picture, polygons, rule, progress, &|zone, gather| walk_source(source, zone, gather))
}

/// A walk over the cells of a zone.
type WalkZone<'a> = dyn Fn(&ZoneCells<'_>, &mut Gather<'_>) -> Walked + Sync + 'a;

/// Polygons that are worked on before somebody is told of it.
const BATCH: usize = 64;

fn each_zone(
    (form, depth, counts_classes): (Form, u8, bool),
    picture: Bounds,
    polygons: &[Polygon],
    rule: EdgeRule,
    progress: &dyn Progress,
    walk_zone: &WalkZone<'_>,
) -> Result<Vec<ZoneStatistics>> {
    let mut all = Vec::with_capacity(polygons.len());
    for batch in polygons.chunks(BATCH) {
        let found = parallel::map(batch, |polygon| {
            let zone = ZoneCells { polygon, rule, picture };
            let mut gather = Gather::new(form, depth, counts_classes, zone, progress);
            ended(walk_zone(&zone, &mut gather))?;
            Ok(gather.finish())
        });
        found.into_iter().try_for_each(|found: Result<ZoneStatistics>| found.map(|found| all.push(found)))?;
        progress.check()?;
        progress.advance(batch.len() as u64, polygons.len() as u64);
    }
    Ok(all)
}

/// The cells of a picture in a polygon.
#[derive(Clone, Copy)]
struct ZoneCells<'a> {
    polygon: &'a Polygon,
    rule: EdgeRule,
    picture: Bounds,
}

impl ZoneCells<'_> {
    /// Cells of a box that are inside.
    fn measure(&self, bounds: &Bounds, crossings: &mut Crossings) -> f64 {
        // (A polygon goes through all of an octree along z.)
        let layers = (bounds.max[2] - bounds.min[2]) as f64;
        layers
            * match self.rule {
                EdgeRule::Centre => self.polygon.count_centres(bounds, crossings) as f64,
                EdgeRule::Touch => self.polygon.count_touched(bounds, crossings) as f64,
                EdgeRule::Area => self.polygon.area(bounds),
            }
    }
}

impl Selection for ZoneCells<'_> {
    fn cover(&self, space: &Bounds) -> Cover {
        // What lies outside the picture is VOID, and does not count.
        if self.picture.intersect(space).is_empty() {
            return Cover::Nothing;
        }
        match self.rule {
            EdgeRule::Centre => self.polygon.cover_centres(space),
            EdgeRule::Touch | EdgeRule::Area => self.polygon.cover_area(space),
        }
    }

    fn part(&self, space: &Bounds) -> Bounds {
        *space
    }
}

/// Statistics of a zone in the making.
struct Gather<'a> {
    zone: ZoneCells<'a>,
    depth: u8,
    value_type: ValueType,
    /// Whole cells.
    count: Box<dyn Count>,
    /// Parts of cells.
    parts: Parts,
    /// Room to work in.
    crossings: Crossings,
    progress: &'a dyn Progress,
}

impl<'a> Gather<'a> {
    fn new(
        form: Form,
        depth: u8,
        counts_classes: bool,
        zone: ZoneCells<'a>,
        progress: &'a dyn Progress,
    ) -> Gather<'a> {
        let count = if counts_classes { Box::new(Classes::new(form)) } else { counter_of(form) };
        let parts =
            Parts { channels: [Moments::default(); 4], cells: 0.0, classes: HashMap::new(), counts_classes };
        Gather {
            zone,
            depth,
            value_type: form.value,
            count,
            parts,
            crossings: Crossings::default(),
            progress,
        }
    }

    fn finish(mut self) -> ZoneStatistics {
        let all = self.zone.measure(&self.zone.picture, &mut self.crossings);
        let whole = summary(&self.count.finish(), 0, 0);
        self.parts.with(whole, all, self.value_type)
    }
}

impl Visitor for Gather<'_> {
    fn zone(&mut self, _: Code, zone: &dyn Zone) -> Walked<bool> {
        Ok(self.count.zone(zone)?)
    }

    fn block(&mut self, _: Code, value: Option<Value>, cells: u64, part: Option<&Bounds>) -> Walked {
        let Some(value) = value else { return Ok(()) };
        let Some(part) = part else {
            self.count.block(value, cells);
            return Ok(());
        };
        let inside = self.zone.measure(part, &mut self.crossings);
        match self.zone.rule {
            EdgeRule::Centre | EdgeRule::Touch if inside > 0.0 => self.count.block(value, inside as u64),
            EdgeRule::Area if inside > 0.0 => self.parts.add(self.value_type, value, inside),
            _ => {}
        }
        Ok(())
    }

    fn subtree(&mut self, records: &[u8], levels: u8) -> Option<Result<(), BadSkip>> {
        Some(self.count.subtree(records, levels))
    }

    fn dense(&mut self, code: Code, block: &DenseBlock<'_>, (first, size): ([usize; 3], [usize; 3])) -> bool {
        if self.zone.rule == EdgeRule::Area {
            return false;
        }
        let (polygon, count) = (self.zone.polygon, &mut self.count);
        let origin = code.bounds(self.depth).min;
        let part = Bounds {
            min: [origin[0], origin[1], 0],
            max: [origin[0] + size[0] as u64, origin[1] + size[1] as u64, 1],
        };
        let each = &mut |row: u64, span: std::ops::Range<u64>| {
            let from = [(span.start - origin[0]) as usize, (row - origin[1]) as usize];
            let at = [first[0] + from[0], first[1] + from[1], first[2]];
            count.dense(block, (at, [(span.end - span.start) as usize, 1, size[2]]));
        };
        match self.zone.rule {
            EdgeRule::Touch => polygon.touched_spans(&part, &mut self.crossings, each),
            _ => polygon.spans(&part, &mut self.crossings, each),
        }
        true
    }

    fn leave(&mut self, _: Code) -> Walked {
        Ok(self.progress.check()?)
    }
}

/// Statistics of parts of cells.
struct Parts {
    channels: [Moments; 4],
    cells: f64,
    /// Cells of each class.
    classes: HashMap<Value, f64>,
    counts_classes: bool,
}

/// Mean and spread of weighted numbers, as they come (West, 1979).
#[derive(Clone, Copy)]
struct Moments {
    weight: f64,
    mean: f64,
    squares: f64,
    min: Number,
    max: Number,
}

impl Default for Moments {
    fn default() -> Self {
        let (min, max) = (f64::INFINITY.into(), f64::NEG_INFINITY.into());
        Moments { weight: 0.0, mean: 0.0, squares: 0.0, min, max }
    }
}

impl Moments {
    fn add(&mut self, other: Moments) {
        let weight = self.weight + other.weight;
        if weight <= 0.0 {
            return;
        }
        let away = other.mean - self.mean;
        self.squares += other.squares + away * away * self.weight * other.weight / weight;
        self.mean += away * other.weight / weight;
        self.weight = weight;
        (self.min, self.max) = (self.min.min(other.min), self.max.max(other.max));
    }
}

impl From<&ChannelStatistics> for Moments {
    fn from(channel: &ChannelStatistics) -> Moments {
        let ChannelStatistics { cells, min, max, mean, standard_deviation } = *channel;
        let weight = cells as f64;
        if cells == 0 {
            return Moments::default();
        }
        Moments { weight, mean, squares: standard_deviation * standard_deviation * weight, min, max }
    }
}

impl Parts {
    fn add(&mut self, value_type: ValueType, value: Value, weight: f64) {
        self.cells += weight;
        if self.counts_classes {
            *self.classes.entry(value).or_default() += weight;
        }
        let (numbers, present) = (value_type.numbers(value), value_type.present(value));
        for ((channel, number), is_present) in self.channels.iter_mut().zip(numbers.iter()).zip(present) {
            if is_present {
                channel.add(Moments {
                    weight,
                    mean: number.to_f64(),
                    squares: 0.0,
                    min: *number,
                    max: *number,
                });
            }
        }
    }

    /// These parts and whole cells together, of a zone of so many cells.
    fn with(mut self, whole: Statistics, all: f64, value_type: ValueType) -> ZoneStatistics {
        for (channel, whole) in self.channels.iter_mut().zip(&whole.channels) {
            channel.add(whole.into());
        }
        let counted = whole.classes.iter().map(|(class, cells)| (*class, *cells as f64));
        let measured = self.classes.into_iter().filter(|_| value_type.channels == 1);
        let measured = measured.map(|(value, cells)| (value_type.first_number(value), cells));
        let mut classes = BTreeMap::new();
        counted.chain(measured).for_each(|(class, cells)| *classes.entry(class).or_insert(0.0) += cells);
        let cells = self.cells + whole.cells as f64;
        let channel = |moments: &Moments| {
            let Moments { weight, mean, squares, min, max } = *moments;
            if weight <= 0.0 {
                let none = f64::NAN;
                return ZoneChannel {
                    cells: 0.0,
                    min: Number::NAN,
                    max: Number::NAN,
                    mean: none,
                    standard_deviation: none,
                };
            }
            ZoneChannel {
                cells: weight,
                min,
                max,
                mean,
                standard_deviation: (squares / weight).max(0.0).sqrt(),
            }
        };
        let channels = if cells > 0.0 { usize::from(value_type.channels) } else { 0 };
        ZoneStatistics {
            cells,
            // (What rounding leaves of nothing is nothing.)
            void_cells: if all - cells > 1e-9 * all { all - cells } else { 0.0 },
            channels: self.channels[..channels].iter().map(channel).collect(),
            classes: classes.into_iter().collect(),
        }
    }
}
