//! Exact statistics of any box, from zone statistics where a zone lies inside and from the tree where it is cut.

use zerocopy::{FromBytes, IntoBytes};

use crate::Result;
use crate::space::{Bounds, Code};
use crate::store::build::{BadSkip, each_leaf};
use crate::store::goblin::{Goblin, Layout};
use crate::tree::Source;
use crate::value::{Sample, Sum, Tally, Value, channelwise_max, channelwise_min};

use super::walk::{Visitor, Zone, walk, walk_source};

/// Statistics of the cells of a box that are not VOID.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Cells that are not VOID.
    pub cells: u64,
    /// Cells of the box within the picture that are VOID.
    pub void_cells: u64,
    /// Statistics of each channel; nothing if there are no cells.
    pub channels: Vec<ChannelStatistics>,
    /// Cells of each value, by ascending value; only for one-channel files that count classes.
    pub classes: Vec<(f64, u64)>,
    /// Segments whose records had to be read.
    pub segments_read: u64,
}

/// Statistics of one channel; the deviation is that of the population.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[allow(missing_docs)] // the names say it
pub struct ChannelStatistics {
    pub min: f64,
    pub max: f64,
    pub mean: f64,
    pub deviation: f64,
}

impl<D: Layout, V: Value> Goblin<D, V> {
    /// Exact statistics of a box of cells of the deepest level; of the whole picture if there is none. Time is
    /// proportional to the records on the box's border, not to its cells.
    ///
    /// # Errors
    /// If the file is damaged there.
    pub fn statistics(&self, bounds: Option<Bounds>) -> Result<Statistics> {
        let header = self.header();
        let picture = Bounds { min: [0; 3], max: header.extent };
        let bounds = bounds.map_or(picture, |bounds| bounds.intersect(&picture));
        // A box that has the whole picture has the whole tree: the rest is VOID.
        let side = 1u64 << header.shape.depth;
        let space = Bounds { min: [0; 3], max: [side, side, if D::AXES > 2 { side } else { 1 }] };
        let mut gather = Gather::new(self.counts_classes());
        walk(self, if bounds == picture { &space } else { &bounds }, &mut gather)?;
        Ok(gather.finish(bounds.volume()))
    }

    /// Cells of a box whose first channel lies in each of `bins` equal parts of `low ..= high`.
    ///
    /// # Errors
    /// If the file is damaged there.
    pub fn histogram(&self, bounds: &Bounds, low: f64, high: f64, bins: usize) -> Result<Vec<u64>> {
        let mut histogram = Histogram::new(low, high, bins);
        walk(self, bounds, &mut histogram)?;
        Ok(histogram.bins)
    }
}

/// [`Goblin::statistics`] of any source, going through all of its nodes in the box.
pub(crate) fn source_statistics<S>(source: &S, bounds: &Bounds, count_classes: bool) -> Result<Statistics>
where
    S: Source,
    S::Dim: Layout,
{
    let mut gather = Gather::<S::Value>::new(count_classes);
    walk_source(source, bounds, &mut gather)?;
    Ok(gather.finish(bounds.volume()))
}

/// Statistics of all cells of a tally, of a box of so many cells.
pub(super) fn tally_statistics<V: Value>(tally: Tally<V>, volume: u64, count_classes: bool) -> Statistics {
    let mut gather = Gather::new(count_classes);
    match &mut gather.classes {
        Some(classes) => tally.classes.iter().for_each(|(value, cells)| classes.add(*value, *cells)),
        None => gather.tally = tally,
    }
    gather.finish(volume)
}

/// [`Goblin::histogram`] of any source.
pub(crate) fn source_histogram<S>(
    source: &S,
    bounds: &Bounds,
    (low, high): (f64, f64),
    bins: usize,
) -> Result<Vec<u64>>
where
    S: Source,
    S::Dim: Layout,
{
    let mut histogram = Histogram::new(low, high, bins);
    walk_source(source, bounds, &mut histogram)?;
    Ok(histogram.bins)
}

fn summary<V: Value>(tally: &Tally<V>, volume: u64, segments_read: u64) -> Statistics {
    let number = |value: &V, channel: usize| value.samples()[channel].to_f64();
    let channel = |channel: usize| ChannelStatistics {
        min: number(&tally.min, channel),
        max: number(&tally.max, channel),
        mean: tally.sum.as_ref()[channel].to_f64() / tally.cells as f64,
        deviation: Sum::variance(tally.sum.as_ref()[channel], tally.squares.as_ref()[channel], tally.cells)
            .sqrt(),
    };
    let classes = if V::CHANNELS == 1 { &tally.classes[..] } else { &[] };
    Statistics {
        cells: tally.cells,
        void_cells: volume.saturating_sub(tally.cells),
        channels: if tally.cells > 0 { (0..V::CHANNELS).map(channel).collect() } else { Vec::new() },
        classes: classes.iter().map(|(value, cells)| (number(value, 0), *cells)).collect(),
        segments_read,
    }
}

/// Cells of each value, sorted; remembers the last place because neighbours are alike.
struct Classes<V> {
    counts: Vec<(V, u64)>,
    last: usize,
    /// Cells of each value that is one byte, still to be added.
    bytes: Vec<u64>,
}

impl<V> Default for Classes<V> {
    fn default() -> Self {
        Classes { counts: Vec::new(), last: 0, bytes: vec![0; 256] }
    }
}

impl<V: Value> Classes<V> {
    #[inline]
    fn add(&mut self, value: V, cells: u64) {
        if let [byte] = value.to_wire().as_bytes() {
            self.bytes[*byte as usize] += cells;
        } else {
            self.add_sorted(value, cells);
        }
    }

    fn finish(mut self) -> Vec<(V, u64)> {
        for (byte, cells) in std::mem::take(&mut self.bytes).into_iter().enumerate() {
            if cells > 0
                && let Ok(wire) = V::Wire::read_from_bytes(&[byte as u8])
            {
                self.add_sorted(V::from_wire(wire), cells);
            }
        }
        self.counts
    }

    fn add_sorted(&mut self, value: V, cells: u64) {
        if !self.counts.get(self.last).is_some_and(|(last, _)| last.same(value)) {
            self.last = match self.counts.binary_search_by(|(other, _)| other.order(value)) {
                Ok(place) => place,
                Err(place) => {
                    self.counts.insert(place, (value, 0));
                    place
                }
            };
        }
        self.counts[self.last].1 += cells;
    }
}

struct Gather<V: Value> {
    /// If classes are counted, everything else follows from the counts.
    classes: Option<Classes<V>>,
    tally: Tally<V>,
    segments: u64,
}

impl<D: Layout, V: Value> Visitor<D, V> for Gather<V> {
    fn zone(&mut self, _: Code<D>, zone: &dyn Zone<V>) -> Result<bool> {
        match &mut self.classes {
            Some(classes) => zone.classes()?.into_iter().for_each(|(value, cells)| classes.add(value, cells)),
            None => self.tally = Tally::merge(&[&self.tally, &zone.tally()?]),
        }
        Ok(true)
    }

    fn block(&mut self, _: Code<D>, value: Option<V>, cells: u64, _: Option<&Bounds>) -> Result<()> {
        if let Some(value) = value {
            self.count(value, cells);
        }
        Ok(())
    }

    fn subtree(&mut self, records: &[D::Record<V>], levels: u8) -> Option<Result<(), BadSkip>> {
        Some(each_leaf::<D, V>(records, levels, |value, cells| self.count(value, cells)))
    }

    fn enter_segment(&mut self) {
        self.segments += 1;
    }
}

impl<V: Value> Gather<V> {
    fn new(count_classes: bool) -> Self {
        let classes = count_classes.then(Classes::default);
        Gather { classes, tally: Tally::void(), segments: 0 }
    }

    fn finish(self, volume: u64) -> Statistics {
        let Gather { classes, mut tally, segments, .. } = self;
        if let Some(classes) = classes {
            for (value, cells) in classes.finish() {
                tally = Tally::merge(&[&tally, &Tally::leaf(value, cells, true)]);
            }
        }
        summary(&tally, volume, segments)
    }

    #[inline]
    fn count(&mut self, value: V, cells: u64) {
        if let Some(classes) = &mut self.classes {
            classes.add(value, cells);
            return;
        }
        let tally = &mut self.tally;
        if tally.cells == 0 {
            (tally.min, tally.max) = (value, value);
        }
        tally.cells += cells;
        tally.min = channelwise_min(tally.min, value);
        tally.max = channelwise_max(tally.max, value);
        for (channel, sample) in value.samples().iter().enumerate() {
            let (sum, square) = (sample.total_sum().times(cells), sample.square().times(cells));
            tally.sum.as_mut()[channel] = tally.sum.as_ref()[channel] + sum;
            tally.squares.as_mut()[channel] = tally.squares.as_ref()[channel] + square;
        }
    }
}

struct Histogram {
    low: f64,
    /// Bins per unit.
    scale: f64,
    bins: Vec<u64>,
}

impl Histogram {
    fn new(low: f64, high: f64, bins: usize) -> Self {
        let bins = vec![0; bins.max(1)];
        Histogram { low, scale: bins.len() as f64 / (high - low), bins }
    }

    fn bin<V: Value>(&self, value: V) -> usize {
        let place = (value.samples()[0].to_f64() - self.low) * self.scale;
        (place.max(0.0) as usize).min(self.bins.len() - 1)
    }
}

impl<D: Layout, V: Value> Visitor<D, V> for Histogram {
    fn zone(&mut self, _: Code<D>, zone: &dyn Zone<V>) -> Result<bool> {
        let zone = zone.tally()?;
        let (first, last) = (self.bin(zone.min), self.bin(zone.max));
        if first == last {
            self.bins[first] += zone.cells;
        }
        Ok(first == last)
    }

    fn block(&mut self, _: Code<D>, value: Option<V>, cells: u64, _: Option<&Bounds>) -> Result<()> {
        if let Some(value) = value {
            let bin = self.bin(value);
            self.bins[bin] += cells;
        }
        Ok(())
    }
}
