//! A block: columns, each with its predictor.

use super::prediction::{Clock, Prediction, errors_of, numbers_of};
use crate::attribute::{RowLayout, position_of};
use spinney_base::value::SampleType;
use spinney_packing::{LOG_BITS, MAX_CONTEXTS, log2, pack_numbers, unpack_numbers};

/// Maximum number of points in a block.
pub(crate) const MAX_POINTS: usize = 1 << 20;

/// Columns of a block.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct BlockLayout {
    /// Number of columns: x, y, z, then the attributes.
    pub columns: usize,
    /// Column of the time stamps, if there is one.
    pub clock: Option<usize>,
    /// Columns in coding order: the clock, those that may serve as labels of points, then the
    /// others.
    pub order: Vec<usize>,
    /// Number of columns that may be labels.
    labels: usize,
}

impl BlockLayout {
    /// Returns the columns of rows. An attribute `gps_time` is the clock; attributes of type `u8`
    /// may be labels.
    pub(crate) fn of(layout: &RowLayout) -> BlockLayout {
        let columns = 3 + layout.attributes.len();
        let clock = layout.position("gps_time").map(|index| index + 3);
        let is_label = |column: &usize| {
            *column >= 3 && Some(*column) != clock && layout.attributes[column - 3].sample == SampleType::U8
        };
        let labels: Vec<usize> = (0..columns).filter(is_label).collect();
        let others = (0..columns).filter(|column| !is_label(column) && Some(*column) != clock);
        let order = clock.into_iter().chain(labels.iter().copied()).chain(others).collect();
        BlockLayout { columns, clock, order, labels: labels.len() }
    }

    /// Range of the label columns in coding order.
    fn labels(&self) -> std::ops::Range<usize> {
        let first = usize::from(self.clock.is_some());
        first..first + self.labels
    }
}

/// Coding contexts: the lowest two bits of a label, and whether the time equals that of the
/// previous point.
fn contexts_of(labels: &[i64], clock: &Clock) -> Vec<u8> {
    let same = clock.contexts.iter().copied().chain(std::iter::repeat(0));
    labels.iter().zip(same).map(|(label, same)| (label & 3) as u8 | same << 2).collect()
}

/// Flag next to the prediction: the column is coded as multiples of a stride.
const HAS_STEPS: u8 = 0x80;
/// Value instead of a prediction: all numbers of the column are equal.
const IS_CONSTANT: u8 = 0x40;

/// Numbers whose differences to the first are multiples of a stride: times of a slow clock, or
/// 8-bit colours scaled to 16 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Steps {
    first: i64,
    step: i64,
}

impl Steps {
    /// Returns the stride of numbers; `None` if it is 1.
    fn of(numbers: &[i64]) -> Option<Steps> {
        let first = *numbers.first()?;
        let mut step = 0u64;
        for number in numbers {
            let (mut a, mut b) = (number.checked_sub(first)?.unsigned_abs(), step);
            while b != 0 {
                (a, b) = (b, a % b);
            }
            step = a;
            if step == 1 {
                return None;
            }
        }
        let step = i64::try_from(step).ok().filter(|step| *step > 1)?;
        Some(Steps { first, step })
    }

    fn counted(self, numbers: &[i64]) -> Vec<i64> {
        // `of` has checked that the differences do not overflow.
        numbers.iter().map(|number| (number - self.first) / self.step).collect()
    }

    fn uncount(self, numbers: &mut [i64]) {
        numbers
            .iter_mut()
            .for_each(|number| *number = self.first.wrapping_add(number.wrapping_mul(self.step)));
    }
}

/// Number of points on which predictions and labels are tried.
const TRIED: usize = 1024;

/// Estimates the coded size of numbers in units of 2^-[`LOG_BITS`] bits: the entropy of each
/// number's magnitude class within its context, plus the remaining bits.
fn cost(numbers: &[i64], contexts: &[u8]) -> u64 {
    let mut counts = [[0u64; 65]; MAX_CONTEXTS];
    let mut bits = 0;
    let mut count = |number: i64, context: u8| {
        let folded = (number << 1 ^ number >> 63) as u64;
        let size = u64::BITS - folded.leading_zeros();
        counts[usize::from(context)][size as usize] += 1;
        bits += u64::from(size.saturating_sub(1));
    };
    match contexts.is_empty() {
        true => numbers.iter().for_each(|number| count(*number, 0)),
        false => numbers.iter().zip(contexts).for_each(|(number, context)| count(*number, *context)),
    }
    let mut entropy = 0;
    for counts in counts {
        let all: u64 = counts.iter().sum();
        entropy += counts
            .iter()
            .filter(|count| **count > 0)
            .map(|count| count * (log2(all) - log2(*count)))
            .sum::<u64>();
    }
    (bits << LOG_BITS) + entropy
}

/// Converts rows, in a given order, to contiguous columns.
pub(crate) fn columns_of<'r>(
    rows: impl Iterator<Item = &'r [u8]> + Clone,
    layout: &RowLayout,
) -> Vec<Vec<i64>> {
    let axis = |axis: usize| rows.clone().map(|row| position_of(row)[axis].into()).collect();
    let attribute = |attribute| layout.numbers(attribute, rows.clone());
    (0..3).map(axis).chain((0..layout.attributes.len()).map(attribute)).collect()
}

/// Encodes columns of equal length. For each column in coding order, its size in bytes (`u32`) is
/// written first; the columns follow.
pub(crate) fn encode(columns: &[Vec<i64>], layout: &BlockLayout) -> Vec<u8> {
    let mut lengths = Vec::with_capacity(4 * layout.columns);
    let mut bytes = Vec::new();
    let (mut errors, mut other) = (Vec::new(), Vec::new());
    let mut clock = Clock::new(None);
    // Non-constant labels, by position in coding order.
    let mut labels: Vec<(usize, Vec<u8>)> = Vec::new();
    for (index, column) in layout.order.iter().enumerate() {
        let numbers = &columns[*column];
        if numbers.iter().all(|number| *number == numbers[0]) {
            let before = bytes.len();
            bytes.extend([IS_CONSTANT, 0]);
            bytes.extend_from_slice(&numbers.first().copied().unwrap_or(0).to_le_bytes());
            lengths.extend_from_slice(&((bytes.len() - before) as u32).to_le_bytes());
            if Some(*column) == layout.clock {
                clock = Clock::new(Some(numbers));
            }
            continue;
        }
        let steps = Steps::of(numbers);
        let counted = steps.map(|steps| steps.counted(numbers));
        let numbers = counted.as_deref().unwrap_or(numbers);
        let tried = &numbers[..numbers.len().min(TRIED)];
        let costs = Prediction::ALL.map(|prediction| {
            errors_of(tried, &mut clock, prediction, &mut other);
            cost(&other, clock.contexts.get(..tried.len()).unwrap_or_default())
        });
        // Lines and means decode more slowly, so they must save at least 1/8 bit per number.
        let gain = ((tried.len() as u64) << LOG_BITS) / 8;
        let worth = |prediction: Prediction| {
            costs[prediction as usize] + if prediction > Prediction::Last { gain } else { 0 }
        };
        let prediction =
            Prediction::ALL.into_iter().min_by_key(|prediction| worth(*prediction)).expect("there are some");
        errors_of(numbers, &mut clock, prediction, &mut errors);
        let gain = |cost: u64| cost + ((tried.len() as u64) << LOG_BITS) / 16;
        let tried = &errors[..tried.len()];
        let mut least = cost(tried, clock.contexts.get(..tried.len()).unwrap_or_default());
        let mut label = None;
        for (index, contexts) in &labels {
            let cost = gain(cost(tried, &contexts[..tried.len()]));
            if cost < least {
                (least, label) = (cost, Some((index, contexts)));
            }
        }
        let before = bytes.len();
        let has_steps = if steps.is_some() { HAS_STEPS } else { 0 };
        bytes.extend([prediction as u8 | has_steps, label.map_or(0, |(index, _)| *index as u8 + 1)]);
        if let Some(Steps { first, step }) = steps {
            bytes.extend_from_slice(&first.to_le_bytes());
            bytes.extend_from_slice(&step.to_le_bytes());
        }
        pack_numbers(&errors, label.map_or(&clock.contexts, |(_, contexts)| contexts), &mut bytes);
        lengths.extend_from_slice(&((bytes.len() - before) as u32).to_le_bytes());
        let numbers = &columns[*column];
        if Some(*column) == layout.clock {
            clock = Clock::new(Some(numbers));
        }
        let is_label = layout.labels().contains(&index) && index < MAX_LABEL;
        if is_label {
            labels.push((index, contexts_of(numbers, &clock)));
        }
    }
    lengths.extend_from_slice(&bytes);
    lengths
}

/// Only columns before this position in coding order can be labels.
const MAX_LABEL: usize = 255;

/// Decodes the requested columns of a block; the others are empty. `None` if the block is corrupt.
pub(crate) fn decode(
    bytes: &[u8],
    points: usize,
    layout: &BlockLayout,
    wanted: &[bool],
) -> Option<Vec<Vec<i64>>> {
    let (lengths, mut rest) = bytes.split_at_checked(4 * layout.columns)?;
    let mut parts = Vec::with_capacity(layout.columns);
    for length in lengths.as_chunks::<4>().0 {
        let (own, remaining) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        parts.push(own.split_first_chunk::<2>()?);
        rest = remaining;
    }
    if !rest.is_empty() {
        return None;
    }
    let mut needed: Vec<bool> = layout.order.iter().map(|column| wanted[*column]).collect();
    if layout.clock.is_some() {
        needed[0] = true;
    }
    // Invariant: a label precedes the columns that use it, so one backward scan finds all that are
    // needed.
    for index in (0..parts.len()).rev() {
        let label = usize::from(parts[index].0[1]);
        if needed[index] && label > 0 {
            let label = label - 1;
            if label >= index || !layout.labels().contains(&label) {
                return None;
            }
            needed[label] = true;
        }
    }
    let mut columns = vec![Vec::new(); layout.columns];
    let mut clock = Clock::new(None);
    for (index, ([prediction, label], packed)) in
        parts.into_iter().enumerate().filter(|(index, _)| needed[*index])
    {
        if *prediction == IS_CONSTANT {
            columns[layout.order[index]] = vec![i64::from_le_bytes(packed.try_into().ok()?); points];
            if Some(layout.order[index]) == layout.clock {
                clock = Clock::new(Some(&columns[layout.order[index]]));
            }
            continue;
        }
        let (steps, packed) = match prediction & HAS_STEPS != 0 {
            true => {
                let (first, packed) = packed.split_first_chunk()?;
                let (step, packed) = packed.split_first_chunk()?;
                (Some(Steps { first: i64::from_le_bytes(*first), step: i64::from_le_bytes(*step) }), packed)
            }
            false => (None, packed),
        };
        let prediction = *Prediction::ALL.get(usize::from(*prediction & !HAS_STEPS))?;
        let mut numbers = vec![0; points];
        let labels = label.checked_sub(1).map(|label| &columns[layout.order[usize::from(label)]][..]);
        let contexts = labels.map(|labels| contexts_of(labels, &clock));
        if !unpack_numbers(packed, contexts.as_deref().unwrap_or(&clock.contexts), &mut numbers)?.is_empty() {
            return None;
        }
        numbers_of(&mut numbers, &mut clock, prediction);
        if let Some(steps) = steps {
            steps.uncount(&mut numbers);
        }
        if Some(layout.order[index]) == layout.clock {
            clock = Clock::new(Some(&numbers));
        }
        columns[layout.order[index]] = numbers;
    }
    Some(columns)
}
