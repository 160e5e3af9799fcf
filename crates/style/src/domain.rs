//! Percentiles of a tree's values, for domains that are given as percentiles.

use std::cell::{OnceCell, RefCell};
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::layer::Bound;
use spinney_base::space::Bounds;
use spinney_base::{Progress, Result, sort};
use spinney_engine::dataset::Dataset;

/// Maximum number of cells to compute percentiles from: the finest level that fits is used.
const MAX_CELLS: u64 = 1 << 22;
/// Number of cells that are read at a time.
const CELLS: u64 = 1 << 20;

/// Values of a tree's percentiles per channel. They are stored as strings that parse to the same
/// number; null if the tree has no values.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PercentileNumbers(BTreeMap<String, Option<String>>);

impl PercentileNumbers {
    fn name(channel: usize, percent: f64) -> String {
        format!("band {}: {percent} %", channel + 1)
    }

    fn get(&self, channel: usize, percent: f64) -> Option<Option<f64>> {
        let number = self.0.get(&PercentileNumbers::name(channel, percent))?;
        // Treat NaN, infinities and invalid strings as missing.
        number.as_ref().map_or(Some(None), |text| text.parse().ok().filter(|n: &f64| n.is_finite()).map(Some))
    }

    fn set(&mut self, channel: usize, percent: f64, number: Option<f64>) {
        let number = number.map(|number| number.to_string());
        self.0.insert(PercentileNumbers::name(channel, percent), number);
    }

    /// Describes the values that differ from those in `other`: "band 1: 98 % is 7 (there: 9)".
    pub fn differences(&self, other: &PercentileNumbers, there: &str) -> Vec<String> {
        let text =
            |number: Option<&Option<String>>| number.cloned().flatten().unwrap_or_else(|| "none".into());
        let differing = self.0.iter().filter(|(name, number)| other.0.get(*name) != Some(number));
        differing
            .map(|(name, number)| {
                format!("{name} is {} ({there}: {})", text(Some(number)), text(other.0.get(name)))
            })
            .collect()
    }
}

/// Percentiles of a tree, computed on first use.
///
/// They are computed from a level with at most 4 Mi cells: all cells of a small tree,
/// representatives of a large one. This bounds the time. Percentiles 0 and 100 are the minimum and
/// maximum of all cells.
pub(super) struct Percentiles<'a> {
    tree: &'a Dataset,
    progress: &'a dyn Progress,
    /// Sorted finite values of each channel.
    channels: OnceCell<Vec<Vec<f64>>>,
    extremes: RefCell<Option<Vec<(f64, f64)>>>,
    /// Known percentiles, which take precedence over the tree.
    given: Option<&'a PercentileNumbers>,
    resolved: RefCell<PercentileNumbers>,
}

impl<'a> Percentiles<'a> {
    /// Creates the percentiles of a tree. `given` are known already, from another version of it.
    pub(super) fn new(
        tree: &'a Dataset,
        given: Option<&'a PercentileNumbers>,
        progress: &'a dyn Progress,
    ) -> Percentiles<'a> {
        let (channels, extremes, resolved) = (OnceCell::new(), RefCell::default(), RefCell::default());
        Percentiles { tree, progress, channels, extremes, given, resolved }
    }

    /// Returns all percentiles that were requested.
    pub(super) fn into_resolved(self) -> PercentileNumbers {
        self.resolved.into_inner()
    }

    /// Resolves a bound of a channel to a number; `None` if it is a percentile and the tree has no
    /// values.
    ///
    /// # Errors
    /// If the tree is corrupt, or on cancellation.
    pub(super) fn number(&self, channel: usize, bound: Bound) -> Result<Option<f64>> {
        let percent = match bound {
            Bound::Number(number) => return Ok(Some(number)),
            Bound::Percent(percent) => percent,
        };
        let number = match self.given.and_then(|given| given.get(channel, percent)) {
            Some(number) => number,
            None => self.percentile(channel, percent)?,
        };
        self.resolved.borrow_mut().set(channel, percent, number);
        Ok(number)
    }

    fn percentile(&self, channel: usize, percent: f64) -> Result<Option<f64>> {
        if let (true, Some((least, most))) = (percent == 0.0 || percent == 100.0, self.extremes(channel)?) {
            return Ok(Some(if percent == 0.0 { least } else { most }));
        }
        let numbers = match self.channels.get() {
            Some(channels) => channels,
            None => {
                let read = self.read()?;
                self.channels.get_or_init(|| read)
            }
        };
        let numbers = &numbers[channel];
        let last = numbers.len().saturating_sub(1);
        Ok(numbers.get((percent / 100.0 * last as f64).round() as usize).copied())
    }

    /// Minimum and maximum of a channel, if both are finite.
    fn extremes(&self, channel: usize) -> Result<Option<(f64, f64)>> {
        let mut extremes = self.extremes.borrow_mut();
        if extremes.is_none() {
            *extremes = Some(self.tree.value_bounds()?);
        }
        let extremes = extremes.as_ref().and_then(|extremes| extremes.get(channel)).copied();
        Ok(extremes.filter(|(least, most)| least.is_finite() && most.is_finite()))
    }

    fn read(&self) -> Result<Vec<Vec<f64>>> {
        let tree = self.tree;
        let value = tree.header().form.value;
        let fits = |level: &u8| tree.extent_at(*level).volume() <= MAX_CELLS;
        let level = (0..=tree.depth()).rev().find(fits).unwrap_or(0);
        let extent = tree.extent_at(level);
        let mut channels = vec![Vec::new(); usize::from(value.channels)];
        let [width, height, layers] = extent.size();
        let rows = (CELLS / width.max(1)).max(1);
        for z in 0..layers {
            for y in (0..height).step_by(rows as usize) {
                self.progress.check()?;
                let band = Bounds { min: [0, y, z], max: [width, height.min(y + rows), z + 1] };
                let cells = band.volume() as usize;
                let (mut bytes, mut valid) = (vec![0; cells * value.size()], vec![true; cells]);
                tree.window(level, &band, 0.0, &mut bytes, Some(&mut valid))?;
                for (channel, numbers) in channels.iter_mut().enumerate() {
                    let mut band = Vec::with_capacity(cells);
                    value.push_numbers(channel, &bytes, &mut band);
                    let there =
                        band.iter().zip(&valid).filter(|(number, valid)| **valid && number.is_finite());
                    numbers.extend(there.map(|(number, _)| *number));
                }
            }
        }
        channels.iter_mut().for_each(|numbers| sort::floats(numbers));
        Ok(channels)
    }
}
