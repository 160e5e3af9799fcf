//! Zone statistics: exact counts, extremes and sums of all cells below a node.

use std::cmp::Ordering;

use super::dispatch::with_native_type;
use super::erased::Value;
use super::majority::break_tie;
use super::native::Native;
use super::rule::Rule;
use super::sums::Sums;
use super::value_type::ValueType;

/// Counts, extremes and sums of cells that are not VOID. Those of a node are its zone statistics.
///
/// Sums of integers are exact. Sums of floating samples and of their squares depend on the order of
/// the additions, so that order is specified: pairwise in Z order ([`ZoneStats::merge`]). A uniform
/// block then has exactly the sum of its cells, and the bits of a tree do not depend on how it was
/// built.
#[derive(Clone, Debug, PartialEq)]
pub struct ZoneStats {
    /// Type of the values.
    pub value_type: ValueType,
    /// Number of cells that are not VOID.
    pub cells: u64,
    /// Number of cells that have a sample, per channel: all cells, unless the type has missing
    /// samples.
    pub present: [u64; 4],
    /// Smallest sample of each channel (zero without samples).
    pub min: Value,
    /// Largest sample of each channel (zero without samples).
    pub max: Value,
    /// Sum of each channel.
    pub sum: Sums,
    /// Sum of squares of each channel.
    pub squares: Sums,
    /// Number of cells of each value, by ascending value; empty if classes are not counted or too
    /// many.
    pub classes: Vec<(Value, u64)>,
}

/// Maximum number of classes that files store for a zone.
///
/// A list then takes at most a third of the records of the smallest segment that has one. An edit
/// writes at most some kilobytes of lists per level.
const MAX_CLASSES: usize = 1024;

impl ZoneStats {
    /// Whether there are cells, but their classes are unknown.
    pub fn lacks_classes(&self) -> bool {
        self.classes.is_empty() && self.cells > 0
    }

    /// Returns the classes as files store them; `None` if there are too many, or they were not
    /// counted.
    pub fn listed_classes(&self) -> Option<&[(Value, u64)]> {
        (self.classes.len() <= MAX_CLASSES && !self.lacks_classes()).then_some(&self.classes)
    }

    /// Drops classes that no file stores, unless the rule needs their counts.
    pub fn keep_listed_for(&mut self, rule: Rule) {
        if rule != Rule::Majority && self.listed_classes().is_none() {
            self.classes = Vec::new();
        }
    }

    /// Returns the statistics of no cells.
    #[inline]
    pub fn void(value_type: ValueType) -> ZoneStats {
        let (sum, squares) = (Sums::zero(value_type.sample), Sums::zero_squares(value_type.sample));
        let (min, max) = (Value::ZERO, Value::ZERO);
        let present = [0; 4];
        ZoneStats { value_type, cells: 0, present, min, max, sum, squares, classes: Vec::new() }
    }

    /// Returns the statistics of `cells` cells of one value.
    pub fn leaf(value_type: ValueType, value: Value, cells: u64, count_classes: bool) -> ZoneStats {
        let present = value_type.present(value).map(|is_there| if is_there { cells } else { 0 });
        let classes = if count_classes { vec![(value, cells)] } else { Vec::new() };
        let value = value_type.with_zeros(value);
        let (sum, squares) = with_native_type!(value_type, V => leaf_sums::<V>(value, cells));
        ZoneStats { value_type, cells, present, min: value, max: value, sum, squares, classes }
    }

    /// Returns the statistics of the cells of all `parts`.
    ///
    /// The number of parts must be a power of two, otherwise floating sums deviate from the
    /// specified order.
    ///
    /// # Panics
    /// If `parts` is empty.
    pub fn merge(parts: &[&ZoneStats]) -> ZoneStats {
        match parts {
            [] => unreachable!("a node has children"),
            [one] => (*one).clone(),
            [a, b] => ZoneStats::add(a, b),
            _ => {
                // By halves: floating sums are specified as pairwise in Z order.
                let (a, b) = parts.split_at(parts.len() / 2);
                ZoneStats::add(&ZoneStats::merge(a), &ZoneStats::merge(b))
            }
        }
    }

    fn add(a: &ZoneStats, b: &ZoneStats) -> ZoneStats {
        let value_type = a.value_type;
        let mut zone_stats = ZoneStats {
            sum: a.sum.add(&b.sum),
            squares: a.squares.add(&b.squares),
            // Classes that are unknown for one operand are unknown for the result.
            classes: match a.lacks_classes() || b.lacks_classes() {
                true => Vec::new(),
                false => merge_counts(value_type, &a.classes, &b.classes),
            },
            ..*a
        };
        zone_stats.count_cells(b.min, b.max, b.cells, b.present);
        zone_stats
    }

    /// Adds cells with samples between two values to counts and extremes. `present` is how many of
    /// them have a sample, per channel.
    ///
    /// Sums and classes stay unchanged.
    pub(crate) fn count_cells(&mut self, min: Value, max: Value, cells: u64, present: [u64; 4]) {
        let value_type = self.value_type;
        (self.min, self.max) = match (self.cells, cells) {
            (_, 0) => (self.min, self.max),
            (0, _) if !value_type.is_masked() => (min, max),
            _ => {
                let before = self.present;
                let join = |old: Value, new: Value, both: Value| match value_type.is_masked() {
                    false => both,
                    true => value_type.by_channel(|channel| match (before[channel], present[channel]) {
                        (_, 0) => old,
                        (0, _) => new,
                        _ => both,
                    }),
                };
                (
                    join(self.min, min, value_type.min(self.min, min)),
                    join(self.max, max, value_type.max(self.max, max)),
                )
            }
        };
        self.cells += cells;
        self.present = std::array::from_fn(|channel| self.present[channel] + present[channel]);
    }

    /// Returns the sum of a channel's samples relative to a value: see [`ValueType::samples_from`].
    pub fn sum_from(&self, base: Value, channel: usize) -> f64 {
        match (&self.sum, self.value_type.numbers(base)[channel].to_integer()) {
            (Sums::Exact(sums), Some(base)) if self.value_type.sample.is_wide_integer() => {
                (sums[channel] - base * i128::from(self.present[channel])) as f64
            }
            (sums, _) => sums.number(channel),
        }
    }

    /// Returns each channel's mean over the cells that have a sample in it; missing if none has.
    fn mean(&self) -> Value {
        let Some(missing) = self.value_type.mean_of_none() else { return self.mean_over(self.cells) };
        self.value_type.by_channel(|channel| match self.present[channel] {
            0 => missing,
            cells => self.mean_over(cells),
        })
    }

    /// Returns each channel's mean over `cells` cells (at least 1), rounded to the type. Cells that
    /// were not counted are zeros.
    fn mean_over(&self, cells: u64) -> Value {
        with_native_type!(self.value_type, V => erase(V::mean(&self.sum, cells)))
    }

    /// Returns the cell count of the most frequent classes, and how many classes have it.
    fn most_frequent(&self) -> (u64, usize) {
        self.classes.iter().fold((0, 0), |(most, ties), (_, cells)| match cells.cmp(&most) {
            Ordering::Less => (most, ties),
            Ordering::Equal => (most, ties + 1),
            Ordering::Greater => (*cells, 1),
        })
    }

    /// Whether several classes are the most frequent, so that the children decide on the majority.
    pub fn is_tied(&self) -> bool {
        self.most_frequent().1 > 1
    }

    /// Whether no class has more cells than this one.
    pub fn is_most_frequent(&self, class: Value) -> bool {
        let (most, _) = self.most_frequent();
        self.classes.iter().any(|(value, cells)| *value == class && *cells == most)
    }

    /// Returns the class with most cells; for ties, see [`break_tie`].
    fn majority(&self, children: impl Iterator<Item = Value> + Clone) -> Option<Value> {
        let (most, ties) = self.most_frequent();
        let mut best = self.classes.iter().filter(|(_, cells)| *cells == most).map(|(value, _)| *value);
        match ties {
            0 | 1 => best.next(),
            _ => Some(break_tie(children, &best.collect::<Vec<_>>(), most)),
        }
    }
}

fn leaf_sums<V: Native>(value: Value, cells: u64) -> (Sums, Sums) {
    let value = native::<V>(value);
    (V::erase(value.total_sums(cells)), V::erase_squares(value.total_squares(cells)))
}

/// Converts a value to its compile-time type.
#[inline]
pub fn native<V: Native>(value: Value) -> V {
    let bytes = value.to_bytes();
    let (wire, _) =
        <V::Wire as zerocopy::FromBytes>::read_from_prefix(&bytes).expect("16 bytes hold any value");
    V::from_wire(wire)
}

/// Converts a value to the run-time type.
#[inline]
pub fn erase<V: Native>(value: V) -> Value {
    Value::from_bytes(zerocopy::IntoBytes::as_bytes(&value.to_wire()))
}

/// Returns the representative of an INNER node that covers `cells` cells, from its children and its
/// zone statistics.
///
/// `None` is a VOID child. The flag is true for INNER children.
pub fn representative(
    rule: Rule,
    children: &[Option<(Value, bool)>],
    zone_stats: &ZoneStats,
    cells: u64,
) -> Value {
    let value_type = zone_stats.value_type;
    let values = || children.iter().flatten().map(|(value, _)| *value);
    let value = match rule {
        Rule::Mean => Some(zone_stats.mean()),
        Rule::Occupancy => Some(zone_stats.mean_over(cells)),
        Rule::Majority => zone_stats.majority(values()),
        Rule::Dominant => Some(dominant(&children.iter().flatten().copied().collect::<Vec<_>>())),
        Rule::Min => value_type.join_all(values(), ValueType::min),
        Rule::Max => value_type.join_all(values(), ValueType::max),
        Rule::Nearest => values().next(),
    };
    value.unwrap_or_default()
}

/// Returns the value of [`Rule::Dominant`]; zero without children.
///
/// LEAF children weigh 3, INNER ones (flag `true`) 2. The first of the heaviest values wins.
pub fn dominant(children: &[(Value, bool)]) -> Value {
    let mut best = (Value::ZERO, 0);
    for (value, _) in children {
        let mut weight = 0;
        for (other, is_inner) in children {
            if other == value {
                weight += if *is_inner { 2 } else { 3 };
            }
        }
        if weight > best.1 {
            best = (*value, weight);
        }
    }
    best.0
}

/// Adds two lists of counts, both in ascending order of values.
fn merge_counts(value_type: ValueType, a: &[(Value, u64)], b: &[(Value, u64)]) -> Vec<(Value, u64)> {
    if a.is_empty() || b.is_empty() {
        return [a, b].concat();
    }
    let mut merged = Vec::with_capacity(a.len().max(b.len()));
    let (mut a, mut b) = (a.iter().copied().peekable(), b.iter().copied().peekable());
    while let (Some((first, _)), Some((second, _))) = (a.peek(), b.peek()) {
        match value_type.order(*first, *second) {
            Ordering::Less => merged.extend(a.next()),
            Ordering::Greater => merged.extend(b.next()),
            Ordering::Equal => merged.extend(a.next().zip(b.next()).map(|(a, b)| (a.0, a.1 + b.1))),
        }
    }
    merged.extend(a);
    merged.extend(b);
    merged
}
