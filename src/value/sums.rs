//! Sums of samples: exact for integers, f64 for floating samples.

use super::value_type::SampleType;

/// Sums of up to four channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sums {
    /// Sums of integers.
    Exact([i128; 4]),
    /// Sums of floating samples.
    Float([f64; 4]),
}

impl Sums {
    /// Sums of no samples.
    pub fn zero(sample: SampleType) -> Sums {
        if sample.is_float() { Sums::Float([0.0; 4]) } else { Sums::Exact([0; 4]) }
    }

    /// Adds channel by channel; both must be of one type of samples.
    #[must_use]
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
            Sums::Float(sums) => sums[channel],
        }
    }

    /// 16 bytes for the disk: i128, or f64 and eight zeros.
    pub(crate) fn to_bytes(self, channel: usize) -> [u8; 16] {
        match self {
            Sums::Exact(sums) => sums[channel].to_le_bytes(),
            Sums::Float(sums) => {
                let mut bytes = [0; 16];
                let sum = if sums[channel].is_nan() { f64::NAN } else { sums[channel] };
                bytes[..8].copy_from_slice(&sum.to_le_bytes());
                bytes
            }
        }
    }

    /// Sets one channel to what [`Sums::to_bytes`] has made.
    pub(crate) fn set_bytes(&mut self, channel: usize, bytes: [u8; 16]) {
        match self {
            Sums::Exact(sums) => sums[channel] = i128::from_le_bytes(bytes),
            Sums::Float(sums) => {
                sums[channel] = f64::from_le_bytes(bytes[..8].try_into().expect("eight bytes"))
            }
        }
    }

    /// Whether all sums are those of at most so many samples, or of their squares. (No square of an integer
    /// sample is larger than 2^64; of floating samples everything is possible.)
    pub(crate) fn are_possible(&self, cells: u64) -> bool {
        let most = cells as f64 * 2f64.powi(64);
        match self {
            Sums::Exact(sums) => sums.iter().all(|sum| (*sum as f64).abs() <= most),
            Sums::Float(_) => true,
        }
    }

    /// Variance of the population of `cells` samples of a channel, from their sums and sums of squares.
    pub fn variance(sums: &Sums, squares: &Sums, channel: usize, cells: u64) -> f64 {
        if let (Sums::Exact(sum), Sums::Exact(square)) = (sums, squares) {
            let (sum, square) = (sum[channel], square[channel]);
            // Exact until the last division, where the numbers are not beyond all bounds.
            let products = square.checked_mul(cells as i128).zip(sum.checked_mul(sum));
            if let Some(exact) = products.and_then(|(a, b)| a.checked_sub(b)) {
                let n = cells as f64;
                return exact as f64 / (n * n);
            }
        }
        let (n, sum, square) = (cells as f64, sums.number(channel), squares.number(channel));
        ((square - sum / n * sum) / n).max(0.0)
    }
}
