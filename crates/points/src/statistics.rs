//! Counts, extremes and sums of point columns.

use crate::attribute::{PointAttribute, to_f64};
use spinney_base::value::SampleType;

/// Count, extremes and sum of a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ColumnStatistics {
    /// Number of values that are numbers.
    pub count: u64,
    /// Minimum and maximum, in the order of [`crate::attribute::ordered`]; inverted if there are
    /// none.
    pub least: i64,
    pub most: i64,
    /// Sum of all numbers.
    pub sum: f64,
}

impl ColumnStatistics {
    const NONE: ColumnStatistics = ColumnStatistics { count: 0, least: i64::MAX, most: i64::MIN, sum: 0.0 };

    fn of(numbers: &[i64], sample: SampleType) -> ColumnStatistics {
        match sample {
            SampleType::F32 | SampleType::F64 | SampleType::U64 => {
                let mut found = ColumnStatistics::NONE;
                for number in numbers {
                    let value = to_f64(sample, *number);
                    if !value.is_nan() {
                        found.count += 1;
                        found.least = found.least.min(*number);
                        found.most = found.most.max(*number);
                        found.sum += value;
                    }
                }
                found
            }
            _ => {
                let (least, most) = extremes(numbers, sample);
                let sum = whole_sum(numbers, sample) as f64;
                ColumnStatistics { count: numbers.len() as u64, least, most, sum }
            }
        }
    }

    fn add(&mut self, other: &ColumnStatistics) {
        self.count += other.count;
        self.least = self.least.min(other.least);
        self.most = self.most.max(other.most);
        self.sum += other.sum;
    }
}

/// Returns the minimum and maximum of integers; inverted if there are none.
fn extremes(numbers: &[i64], sample: SampleType) -> (i64, i64) {
    let fits_i32 = sample.size() < 4 || sample == SampleType::I32;
    if numbers.is_empty() || !fits_i32 {
        let least = numbers.iter().copied().min().unwrap_or(i64::MAX);
        return (least, numbers.iter().copied().max().unwrap_or(i64::MIN));
    }
    // 32-bit comparisons vectorize.
    let ends =
        |(least, most): (i32, i32), number: &i64| (least.min(*number as i32), most.max(*number as i32));
    let (least, most) = numbers.iter().fold((i32::MAX, i32::MIN), ends);
    (least.into(), most.into())
}

/// Returns the sum of integers.
fn whole_sum(numbers: &[i64], sample: SampleType) -> i128 {
    if sample.size() > 4 {
        return numbers.iter().map(|number| i128::from(*number)).sum();
    }
    // A sum of 2^20 32-bit numbers fits into 64 bits.
    numbers.chunks(1 << 20).map(|some| i128::from(some.iter().sum::<i64>())).sum()
}

/// Point count, and statistics of all columns.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Statistics {
    /// Number of points.
    pub points: u64,
    /// The columns: x, y, z on the grid, then the attributes.
    pub columns: Vec<ColumnStatistics>,
}

/// Size of a column's statistics in bytes.
const COLUMN_BYTES: usize = 32;

/// Returns the size in bytes of the statistics of so many columns.
pub(crate) fn statistics_bytes(columns: usize) -> usize {
    8 + COLUMN_BYTES * columns
}

impl Statistics {
    /// Returns the statistics of no points.
    pub(crate) fn none(columns: usize) -> Statistics {
        Statistics { points: 0, columns: vec![ColumnStatistics::NONE; columns] }
    }

    /// Computes the statistics of columns of equal length. Numbers that encode "no value" are not
    /// counted.
    pub(crate) fn of(columns: &[Vec<i64>], attributes: &[PointAttribute]) -> Statistics {
        let samples = [(SampleType::I32, None); 3]
            .into_iter()
            .chain(attributes.iter().map(|attribute| (attribute.sample, attribute.no_data)));
        Statistics {
            points: columns[0].len() as u64,
            columns: columns
                .iter()
                .zip(samples)
                .map(|(column, (sample, no_data))| match no_data {
                    Some(no_data) if column.contains(&no_data) => {
                        let values: Vec<i64> =
                            column.iter().copied().filter(|number| *number != no_data).collect();
                        ColumnStatistics::of(&values, sample)
                    }
                    _ => ColumnStatistics::of(column, sample),
                })
                .collect(),
        }
    }

    /// Adds the statistics of other points.
    pub(crate) fn add(&mut self, other: &Statistics) {
        self.points += other.points;
        for (own, other) in self.columns.iter_mut().zip(&other.columns) {
            own.add(other);
        }
    }

    /// Returns the minimum and maximum position of the points on the grid.
    pub(crate) fn bounds(&self) -> [[i32; 3]; 2] {
        // Positions are `i32`; without points the bounds stay inverted.
        let number = |number: i64| number.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
        [
            std::array::from_fn(|axis| number(self.columns[axis].least)),
            std::array::from_fn(|axis| number(self.columns[axis].most)),
        ]
    }

    pub(crate) fn write(&self, bytes: &mut Vec<u8>) {
        bytes.extend_from_slice(&self.points.to_le_bytes());
        for column in &self.columns {
            bytes.extend_from_slice(&column.count.to_le_bytes());
            bytes.extend_from_slice(&column.least.to_le_bytes());
            bytes.extend_from_slice(&column.most.to_le_bytes());
            bytes.extend_from_slice(&column.sum.to_le_bytes());
        }
    }

    /// Reads what `write` wrote; the length of the bytes determines the number of columns.
    pub(crate) fn read(bytes: &[u8]) -> Statistics {
        let eight = |at: usize| -> [u8; 8] { bytes[at..at + 8].try_into().expect("eight bytes") };
        let columns = (8..bytes.len()).step_by(COLUMN_BYTES).map(|at| ColumnStatistics {
            count: u64::from_le_bytes(eight(at)),
            least: i64::from_le_bytes(eight(at + 8)),
            most: i64::from_le_bytes(eight(at + 16)),
            sum: f64::from_le_bytes(eight(at + 24)),
        });
        Statistics { points: u64::from_le_bytes(eight(0)), columns: columns.collect() }
    }
}
