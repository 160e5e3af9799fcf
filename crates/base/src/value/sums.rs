//! Sums of samples: exact for integers, double-double for floating samples and for squares of integers of 64 bits.

use super::double::DoubleDouble;
use super::value_type::SampleType;

/// Sums of up to four channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sums {
    /// Sums of integers, and of the squares of those of at most 32 bits.
    Exact([i128; 4]),
    /// Sums of floating samples, and of the squares of these and of integers of 64 bits.
    Float([DoubleDouble; 4]),
}

impl Sums {
    /// Sums of no samples.
    #[inline]
    pub fn zero(sample: SampleType) -> Sums {
        if sample.is_float() { Sums::Float(Default::default()) } else { Sums::Exact([0; 4]) }
    }

    /// Sums of the squares of no samples.
    #[inline]
    pub(super) fn zero_squares(sample: SampleType) -> Sums {
        if sample.has_exact_squares() { Sums::Exact([0; 4]) } else { Sums::Float(Default::default()) }
    }

    /// Adds channel by channel; both must be of one type of samples.
    #[must_use]
    #[inline]
    pub fn add(&self, other: &Sums) -> Sums {
        match (self, other) {
            (Sums::Exact(a), Sums::Exact(b)) => {
                Sums::Exact(std::array::from_fn(|channel| a[channel].wrapping_add(b[channel])))
            }
            (Sums::Float(a), Sums::Float(b)) => {
                Sums::Float(std::array::from_fn(|channel| a[channel] + b[channel]))
            }
            _ => unreachable!("sums of one tree are of one type"),
        }
    }

    /// The sum of one channel, rounded once.
    pub fn number(&self, channel: usize) -> f64 {
        match self {
            Sums::Exact(sums) => sums[channel] as f64,
            Sums::Float(sums) => sums[channel].high,
        }
    }

    /// The sum of one channel, with 106 bits.
    pub fn double(&self, channel: usize) -> DoubleDouble {
        match self {
            Sums::Exact(sums) => DoubleDouble::from(sums[channel]),
            Sums::Float(sums) => sums[channel],
        }
    }

    /// 16 bytes for the disk: i128, or the two f64 of a double-double number.
    pub fn to_bytes(self, channel: usize) -> [u8; 16] {
        match self {
            Sums::Exact(sums) => sums[channel].to_le_bytes(),
            Sums::Float(sums) => {
                let DoubleDouble { high, low } = sums[channel];
                let (high, low) = if high.is_nan() { (f64::NAN, 0.0) } else { (high, low) };
                let mut bytes = [0; 16];
                bytes[..8].copy_from_slice(&high.to_le_bytes());
                bytes[8..].copy_from_slice(&low.to_le_bytes());
                bytes
            }
        }
    }

    /// Sets one channel to what [`Sums::to_bytes`] has made.
    pub fn set_bytes(&mut self, channel: usize, bytes: [u8; 16]) {
        match self {
            Sums::Exact(sums) => sums[channel] = i128::from_le_bytes(bytes),
            Sums::Float(sums) => {
                let [high, low] =
                    [0, 8].map(|at| f64::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte])));
                sums[channel] = DoubleDouble { high, low };
            }
        }
    }

    /// Whether all sums are those of at most so many samples, or of their squares. (No integer sample
    /// and no square that is added up exactly is larger than 2^64; of others everything is possible.)
    pub fn are_possible(&self, cells: u64) -> bool {
        let most = cells as f64 * 2f64.powi(64);
        match self {
            Sums::Exact(sums) => sums.iter().all(|sum| (*sum as f64).abs() <= most),
            Sums::Float(_) => true,
        }
    }

    /// Variance of the population of `cells` samples of a channel, from their sums and sums of squares; not a number where
    /// these are not finite.
    pub fn variance(sums: &Sums, squares: &Sums, channel: usize, cells: u64) -> f64 {
        // The mean square without the square of the mean: nearly all digits cancel each other where samples differ little,
        // which is what the many of a double-double number are for.
        let mean = sums.double(channel).over(cells);
        let variance = (squares.double(channel).over(cells) - mean * mean).high;
        if variance < 0.0 { 0.0 } else { variance }
    }
}
