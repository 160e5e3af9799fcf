//! What is known of all the cells below a node: exact counts, extremes and sums.

use std::cmp::Ordering;

use super::rule::Rule;
use super::sample::{Sample, Sum, Value};

/// Counts, extremes and sums over cells that are not VOID; those of a node are its zone statistics.
///
/// For floating samples the sums are f64 and depend on the order of adding, which is therefore part of the
/// definition: pairwise in Z order ([`Tally::merge`]), so that a uniform block has exactly the sum of its
/// cells and trees built in any way agree in every bit.
#[derive(Clone, Debug, PartialEq)]
pub struct Tally<V: Value> {
    /// Cells that are not VOID.
    pub cells: u64,
    /// Smallest sample of each channel (meaningless without cells).
    pub min: V,
    /// Largest sample of each channel (meaningless without cells).
    pub max: V,
    /// Sum of each channel.
    pub sum: V::TotalSums,
    /// Sum of squares of each channel.
    pub squares: V::TotalSums,
    /// Cells of each value, by ascending value; empty unless classes are counted.
    pub classes: Vec<(V, u64)>,
}

impl<V: Value> Tally<V> {
    /// Of no cells.
    pub fn void() -> Tally<V> {
        Tally {
            cells: 0,
            min: V::default(),
            max: V::default(),
            sum: V::TotalSums::default(),
            squares: V::TotalSums::default(),
            classes: Vec::new(),
        }
    }

    /// Of `cells` cells of one value.
    pub fn leaf(value: V, cells: u64, count_classes: bool) -> Tally<V> {
        Tally {
            cells,
            min: value,
            max: value,
            sum: Self::leaf_sums(value, cells),
            squares: Self::leaf_squares(value, cells),
            classes: if count_classes { vec![(value, cells)] } else { Vec::new() },
        }
    }

    /// Sums of `cells` cells of one value.
    pub(crate) fn leaf_sums(value: V, cells: u64) -> V::TotalSums {
        let mut sums = V::TotalSums::default();
        for (sum, sample) in sums.as_mut().iter_mut().zip(value.samples()) {
            *sum = sample.total_sum().times(cells);
        }
        sums
    }

    /// Sums of their squares.
    pub(crate) fn leaf_squares(value: V, cells: u64) -> V::TotalSums {
        let mut sums = V::TotalSums::default();
        for (sum, sample) in sums.as_mut().iter_mut().zip(value.samples()) {
            *sum = sample.square().times(cells);
        }
        sums
    }

    /// Of the cells of all the parts; their number must be a power of two for the sums of floating samples to be
    /// those that are defined.
    pub fn merge(parts: &[&Tally<V>]) -> Tally<V> {
        match parts {
            [] => Tally::void(),
            [one] => (*one).clone(),
            _ => {
                let (a, b) = parts.split_at(parts.len() / 2);
                Tally::add(&Tally::merge(a), &Tally::merge(b))
            }
        }
    }

    fn add(a: &Tally<V>, b: &Tally<V>) -> Tally<V> {
        let (min, max) = match (a.cells, b.cells) {
            (_, 0) => (a.min, a.max),
            (0, _) => (b.min, b.max),
            _ => (channelwise_min(a.min, b.min), channelwise_max(a.max, b.max)),
        };
        Tally {
            cells: a.cells + b.cells,
            min,
            max,
            sum: V::add_sums(a.sum, b.sum),
            squares: V::add_sums(a.squares, b.squares),
            classes: merge_counts(&a.classes, &b.classes),
        }
    }

    /// Mean of each channel, rounded to the type. Not to be called without cells.
    pub fn mean(&self) -> V {
        self.mean_over(self.cells)
    }

    /// The same over so many cells, those beyond the tally's own counting as zero.
    fn mean_over(&self, cells: u64) -> V {
        V::from_channels(|channel| <V::Sample as Sample>::mean(self.sum.as_ref()[channel], cells))
    }

    /// The class with most cells, the lowest if there are several.
    pub fn majority(&self) -> Option<V> {
        most_frequent(self.classes.iter().copied())
    }
}

/// The representative of an inner node of so many cells from its children (`None` is VOID; the flag says INNER) and
/// from the tally of what is below it.
pub fn representative<V: Value>(
    rule: Rule,
    children: &[Option<(V, bool)>],
    tally: &Tally<V>,
    cells: u64,
) -> V {
    let values = || children.iter().flatten();
    match rule {
        Rule::Mean => tally.mean(),
        Rule::Occupancy => tally.mean_over(cells),
        Rule::Majority => tally.majority().unwrap_or_default(),
        Rule::Dominant => dominant(values().copied()),
        Rule::Min => values().map(|(value, _)| *value).reduce(channelwise_min).unwrap_or_default(),
        Rule::Max => values().map(|(value, _)| *value).reduce(channelwise_max).unwrap_or_default(),
        Rule::Nearest => values().map(|(value, _)| *value).next().unwrap_or_default(),
    }
}

/// The survey's rule: leaves weigh 3, inner nodes 2, the first of the heaviest wins.
pub(crate) fn dominant<V: Value>(children: impl Iterator<Item = (V, bool)> + Clone) -> V {
    let mut best = (V::default(), 0);
    for (value, _) in children.clone() {
        let same = children.clone().filter(|(other, _)| other.same(value));
        let weight: u32 = same.map(|(_, inner)| if inner { 2 } else { 3 }).sum();
        if weight > best.1 {
            best = (value, weight);
        }
    }
    best.0
}

/// Smaller sample of each channel.
#[inline]
pub(crate) fn channelwise_min<V: Value>(a: V, b: V) -> V {
    V::from_channels(|c| {
        let (a, b) = (a.samples()[c], b.samples()[c]);
        if b.order(a) == Ordering::Less { b } else { a }
    })
}

/// Larger sample of each channel.
#[inline]
pub(crate) fn channelwise_max<V: Value>(a: V, b: V) -> V {
    V::from_channels(|c| {
        let (a, b) = (a.samples()[c], b.samples()[c]);
        if b.order(a) == Ordering::Greater { b } else { a }
    })
}

/// The value with the highest count, the least of several.
pub(crate) fn most_frequent<V: Value>(counts: impl Iterator<Item = (V, u64)>) -> Option<V> {
    let rank = |a: &(V, u64), b: &(V, u64)| a.1.cmp(&b.1).then_with(|| b.0.order(a.0));
    counts.max_by(rank).map(|(value, _)| value)
}

/// Adds two lists of counts that are in ascending order of values.
pub(crate) fn merge_counts<V: Value>(a: &[(V, u64)], b: &[(V, u64)]) -> Vec<(V, u64)> {
    let mut merged = Vec::with_capacity(a.len().max(b.len()));
    let (mut a, mut b) = (a.iter().copied().peekable(), b.iter().copied().peekable());
    loop {
        let order = match (a.peek(), b.peek()) {
            (Some(a), Some(b)) => a.0.order(b.0),
            (Some(_), None) => Ordering::Less,
            (None, Some(_)) => Ordering::Greater,
            (None, None) => return merged,
        };
        match order {
            Ordering::Less => merged.extend(a.next()),
            Ordering::Greater => merged.extend(b.next()),
            Ordering::Equal => merged.extend(a.next().zip(b.next()).map(|(a, b)| (a.0, a.1 + b.1))),
        }
    }
}
