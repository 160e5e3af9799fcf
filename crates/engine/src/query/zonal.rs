//! Zonal statistics: statistics of the cells in polygons.
//!
//! The tree is walked from the root down as for a box. What lies in a polygon as a whole is counted by the statistics that
//! the tree stores; what a border cuts is gone into, down to uniform blocks, whose part in the polygon is counted in rows,
//! or measured.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

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
use spinney_container::Header;

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

/// A tree that is asked for the cells in polygons.
pub(crate) struct ZonalTree<'a> {
    form: Form,
    depth: u8,
    counts_classes: bool,
    /// Cells that can be other than VOID.
    picture: Bounds,
    walk: Box<WalkZone<'a>>,
}

/// A walk over the cells of a zone.
type WalkZone<'a> = dyn Fn(&ZoneCells<'_>, &mut Gather<'_>) -> Walked + Sync + 'a;

impl<'a> ZonalTree<'a> {
    /// A file in segments.
    pub(crate) fn of_file(tree: &'a Goblin) -> ZonalTree<'a> {
        ZonalTree::new(tree.header(), Box::new(|zone, gather| walk(tree, zone, gather)))
    }

    /// Any other source, and the header that a file of it has.
    pub(crate) fn of_source<S: Source>(source: &'a S, header: &Header) -> ZonalTree<'a> {
        ZonalTree::new(header, Box::new(|zone, gather| walk_source(source, zone, gather)))
    }

    fn new(header: &Header, walk: Box<WalkZone<'a>>) -> ZonalTree<'a> {
        let (depth, counts_classes) = (header.depth(), header.counts_classes());
        ZonalTree { form: header.form, depth, counts_classes, picture: header.picture(), walk }
    }
}

/// Trees of the same grid, by their numbers among all, with polygons in its cells; of those that lie outside there is none.
pub(crate) struct ZonalGroup<'a> {
    pub(crate) trees: Vec<(usize, ZonalTree<'a>)>,
    pub(crate) polygons: &'a [Option<Polygon>],
}

/// Statistics of all trees in a polygon, in their order.
type TakeZone<'a> = dyn FnMut(Vec<ZoneStatistics>) -> Result<()> + 'a;

/// Polygons that are worked on before somebody is told of it, and answers that are held at most, unless there are more trees.
const BATCH: usize = 64;
const MOST_HELD: usize = 1 << 16;

/// Hands out the statistics of the cells in each of some polygons, of all trees; time goes with the nodes along their borders. Which
/// cells are in a polygon is found once for all trees of a grid.
///
/// # Errors
/// If a file is damaged there, `take` fails, or on interruption.
pub(crate) fn zonal(
    groups: &[ZonalGroup<'_>],
    rule: EdgeRule,
    progress: &dyn Progress,
    take: &mut TakeZone<'_>,
) -> Result<()> {
    let trees: usize = groups.iter().map(|group| group.trees.len()).sum();
    let polygons = groups.iter().map(|group| group.polygons.len()).max().unwrap_or(0);
    let numbers: Vec<usize> = (0..polygons).collect();
    for batch in numbers.chunks((MOST_HELD / trees.max(1)).clamp(1, BATCH)) {
        let zone_of = |number: &usize| {
            let mut all = vec![ZoneStatistics::default(); trees];
            groups.iter().try_for_each(|group| group.zone(*number, rule, progress, &mut all))?;
            Ok(all)
        };
        let found: Vec<Result<Vec<ZoneStatistics>>> = parallel::map(batch, zone_of);
        found.into_iter().try_for_each(|found| take(found?))?;
        progress.check()?;
        progress.advance((batch.len() * trees) as u64, (polygons * trees) as u64);
    }
    Ok(())
}

impl ZonalGroup<'_> {
    /// Statistics in a polygon, at the places of the group's trees.
    fn zone(
        &self,
        number: usize,
        rule: EdgeRule,
        progress: &dyn Progress,
        all: &mut [ZoneStatistics],
    ) -> Result<()> {
        let Some(Some(polygon)) = self.polygons.get(number) else { return Ok(()) };
        let mut found = (self.trees.len() > 1).then(RefCell::<FoundCells>::default);
        for (place, tree) in &self.trees {
            let zone = ZoneCells { polygon, rule, picture: tree.picture, found: found.take() };
            let mut gather = Gather::new(tree, &zone, progress);
            ended((tree.walk)(&zone, &mut gather))?;
            all[*place] = gather.finish();
            found = zone.found;
        }
        Ok(())
    }
}

/// The cells of a picture in a polygon.
struct ZoneCells<'a> {
    polygon: &'a Polygon,
    rule: EdgeRule,
    picture: Bounds,
    /// Findings for other trees of the grid, if there are any.
    found: Option<RefCell<FoundCells>>,
}

/// Findings about the cells in a polygon, by first column and row, columns and rows of nodes.
#[derive(Default)]
struct FoundCells {
    covers: HashMap<[u64; 4], Cover>,
    measures: HashMap<[u64; 4], f64>,
    spans: HashMap<[u64; 4], Vec<Span>>,
    /// Spans of all of them.
    count: usize,
}

/// Cells of a row, and the share of each that counts.
type Span = (u64, Range<u64>, f64);

/// Entries of each kind that are remembered.
const MOST_FOUND: usize = 1 << 16;

/// A node's place among what was found.
fn area_of(bounds: &Bounds) -> [u64; 4] {
    let ([x, y, _], [columns, rows, _]) = (bounds.min, bounds.size());
    [x, y, columns, rows]
}

impl ZoneCells<'_> {
    /// A finding of before; else it is found now.
    fn find<T: Copy>(
        &self,
        bounds: &Bounds,
        kind: fn(&mut FoundCells) -> &mut HashMap<[u64; 4], T>,
        find: impl FnOnce() -> T,
    ) -> T {
        let Some(known) = &self.found else { return find() };
        let area = area_of(bounds);
        if let Some(found) = kind(&mut known.borrow_mut()).get(&area) {
            return *found;
        }
        let found = find();
        let (mut known, room) = (known.borrow_mut(), MOST_FOUND);
        let of_kind = kind(&mut known);
        if of_kind.len() < room {
            of_kind.insert(area, found);
        }
        found
    }

    /// Cells of a box that are inside.
    fn measure(&self, bounds: &Bounds, crossings: &mut Crossings) -> f64 {
        // (A polygon goes through all of an octree along z.)
        let layers = (bounds.max[2] - bounds.min[2]) as f64;
        let measure = || match self.rule {
            EdgeRule::Centre => self.polygon.count_centres(bounds, crossings) as f64,
            EdgeRule::Touch => self.polygon.count_touched(bounds, crossings) as f64,
            EdgeRule::Area => self.polygon.area(bounds),
        };
        layers * self.find(bounds, |found| &mut found.measures, measure)
    }

    /// Hands out the columns, row by row, of a box's cells that count, and the share of each that does.
    fn spans(&self, bounds: &Bounds, crossings: &mut Crossings, each: &mut dyn FnMut(u64, Range<u64>, f64)) {
        let mut spans = |each: &mut dyn FnMut(u64, Range<u64>, f64)| match self.rule {
            EdgeRule::Centre => self.polygon.spans(bounds, crossings, &mut |row, span| each(row, span, 1.0)),
            EdgeRule::Touch => {
                self.polygon.touched_spans(bounds, crossings, &mut |row, span| each(row, span, 1.0));
            }
            EdgeRule::Area => self.polygon.shares(bounds, crossings, each),
        };
        let Some(found) = &self.found else { return spans(each) };
        let area = area_of(bounds);
        let mut found = found.borrow_mut();
        if let Some(known) = found.spans.get(&area) {
            return known.iter().for_each(|(row, span, share)| each(*row, span.clone(), *share));
        }
        if found.count >= MOST_FOUND {
            return spans(each);
        }
        let mut list = Vec::new();
        spans(&mut |row, span, share| {
            each(row, span.clone(), share);
            list.push((row, span, share));
        });
        found.count += list.len();
        found.spans.insert(area, list);
    }

    fn cover_of(&self, space: &Bounds) -> Cover {
        match self.rule {
            EdgeRule::Centre => self.polygon.cover_centres(space),
            EdgeRule::Touch | EdgeRule::Area => self.polygon.cover_area(space),
        }
    }
}

impl Selection for ZoneCells<'_> {
    fn cover(&self, space: &Bounds) -> Cover {
        // What lies outside the picture is VOID, and does not count.
        if self.picture.intersect(space).is_empty() {
            return Cover::Nothing;
        }
        self.find(space, |found| &mut found.covers, || self.cover_of(space))
    }

    fn part(&self, space: &Bounds) -> Bounds {
        *space
    }
}

/// Statistics of a zone in the making.
struct Gather<'a> {
    zone: &'a ZoneCells<'a>,
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
    fn new(tree: &ZonalTree<'_>, zone: &'a ZoneCells<'a>, progress: &'a dyn Progress) -> Gather<'a> {
        let (form, counts_classes) = (tree.form, tree.counts_classes);
        let count = if counts_classes { Box::new(Classes::new(form)) } else { counter_of(form) };
        let parts =
            Parts { channels: [Moments::default(); 4], cells: 0.0, classes: HashMap::new(), counts_classes };
        let (depth, value_type) = (tree.depth, form.value);
        Gather { zone, depth, value_type, count, parts, crossings: Crossings::default(), progress }
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
        let (count, parts, value_type) = (&mut self.count, &mut self.parts, self.value_type);
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
                share => block.each_leaf(part, &mut |value| parts.add(value_type, value, share)),
            }
        });
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
    /// Adds a number to the mean and the spread.
    #[inline]
    fn add_number(&mut self, number: f64, weight: f64) {
        self.weight += weight;
        let away = number - self.mean;
        let step = away * (weight / self.weight);
        self.squares += weight * away * (away - step);
        self.mean += step;
    }

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
        let (samples, present) = (value_type.samples(value), value_type.present(value));
        for (index, number) in samples.iter().enumerate().filter(|(index, _)| present[*index]) {
            let channel = &mut self.channels[index];
            channel.add_number(*number, weight);
            // (Extremes are exact, which few cells need to be compared for.)
            if *number <= channel.min.to_f64() || *number >= channel.max.to_f64() {
                let number = value_type.numbers(value)[index];
                (channel.min, channel.max) = (channel.min.min(number), channel.max.max(number));
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
            // (Sums of as many shares as a zone has cells at its border are off by less than that.)
            void_cells: if all - cells > 1e-9 * all { all - cells } else { 0.0 },
            channels: self.channels[..channels].iter().map(channel).collect(),
            classes: classes.into_iter().collect(),
        }
    }
}
