//! Sums of samples, and of their squares.
//!
//! Those of integers are exact. Those of floating samples have two and three times the digits of an
//! f64.

use super::double::DoubleDouble;
use super::square_sum::SquareSum;
use super::triple::TripleDouble;
use super::value_type::SampleType;

/// Sums of up to four channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sums {
    /// Sums of integers, and of squares of integers of at most 32 bits.
    Exact([i128; 4]),
    /// Sums of squares of 64-bit integers.
    Squares([SquareSum; 4]),
    /// Sums of floating samples, and of squares of `f32`.
    Double([DoubleDouble; 4]),
    /// Sums of squares of `f64`.
    Triple([TripleDouble; 4]),
}

impl Sums {
    /// Returns the sums of no samples.
    #[inline]
    pub fn zero(sample: SampleType) -> Sums {
        if sample.is_float() { Sums::Double(Default::default()) } else { Sums::Exact([0; 4]) }
    }

    /// Returns the sums of squares of no samples.
    #[inline]
    pub(super) fn zero_squares(sample: SampleType) -> Sums {
        match sample {
            SampleType::U64 | SampleType::I64 => Sums::Squares(Default::default()),
            SampleType::F32 => Sums::Double(Default::default()),
            SampleType::F64 => Sums::Triple(Default::default()),
            _ => Sums::Exact([0; 4]),
        }
    }

    /// Returns the size on disk of one channel's sum of squares, in bytes. (A sum of samples has
    /// 16.)
    pub const fn size_of_squares(sample: SampleType) -> usize {
        match sample {
            SampleType::U64 | SampleType::I64 | SampleType::F64 => SquareSum::SIZE,
            _ => 16,
        }
    }

    /// Returns the size of one channel on disk, in bytes.
    pub fn size(&self) -> usize {
        match self {
            Sums::Exact(_) | Sums::Double(_) => 16,
            Sums::Squares(_) | Sums::Triple(_) => SquareSum::SIZE,
        }
    }

    /// Adds channel by channel. Both sums must be of the same sample type.
    #[must_use]
    #[inline]
    pub fn add(&self, other: &Sums) -> Sums {
        match (self, other) {
            (Sums::Exact(a), Sums::Exact(b)) => {
                Sums::Exact(std::array::from_fn(|channel| a[channel].wrapping_add(b[channel])))
            }
            (Sums::Squares(a), Sums::Squares(b)) => {
                Sums::Squares(std::array::from_fn(|channel| a[channel] + b[channel]))
            }
            (Sums::Double(a), Sums::Double(b)) => {
                Sums::Double(std::array::from_fn(|channel| a[channel] + b[channel]))
            }
            (Sums::Triple(a), Sums::Triple(b)) => {
                Sums::Triple(std::array::from_fn(|channel| a[channel] + b[channel]))
            }
            _ => unreachable!("sums of one tree are of one type"),
        }
    }

    /// Returns the sum of one channel, rounded once.
    pub fn number(&self, channel: usize) -> f64 {
        match self {
            Sums::Exact(sums) => sums[channel] as f64,
            Sums::Double(sums) => sums[channel].high,
            _ => self.triple(channel).high,
        }
    }

    /// Returns the sum of one channel, with 159 bits.
    pub fn triple(&self, channel: usize) -> TripleDouble {
        match self {
            Sums::Exact(sums) => TripleDouble::from(sums[channel]),
            Sums::Squares(sums) => TripleDouble::from(sums[channel]),
            Sums::Double(sums) => TripleDouble::from(sums[channel]),
            Sums::Triple(sums) => sums[channel],
        }
    }

    /// Appends one channel's sum as on disk: an integer of 16 or 24 bytes, or two or three f64.
    pub fn write(&self, channel: usize, bytes: &mut Vec<u8>) {
        match self {
            Sums::Exact(sums) => bytes.extend(sums[channel].to_le_bytes()),
            Sums::Squares(sums) => bytes.extend(sums[channel].to_bytes()),
            Sums::Double(sums) => {
                let DoubleDouble { high, low } = sums[channel];
                write_parts([high, low], bytes);
            }
            Sums::Triple(sums) => {
                let TripleDouble { high, middle, low } = sums[channel];
                write_parts([high, middle, low], bytes);
            }
        }
    }

    /// Sets one channel from the bytes of [`Sums::write`], and returns the bytes after it; `None`
    /// if there are too few.
    pub fn read<'a>(&mut self, channel: usize, bytes: &'a [u8]) -> Option<&'a [u8]> {
        match self {
            Sums::Exact(sums) => {
                let (sum, rest) = bytes.split_first_chunk()?;
                sums[channel] = i128::from_le_bytes(*sum);
                Some(rest)
            }
            Sums::Squares(sums) => {
                let (sum, rest) = bytes.split_first_chunk()?;
                sums[channel] = SquareSum::from_bytes(*sum);
                Some(rest)
            }
            Sums::Double(sums) => {
                let ([high, low], rest) = read_parts(bytes)?;
                sums[channel] = DoubleDouble { high, low };
                Some(rest)
            }
            Sums::Triple(sums) => {
                let ([high, middle, low], rest) = read_parts(bytes)?;
                sums[channel] = TripleDouble { high, middle, low };
                Some(rest)
            }
        }
    }

    /// Whether the sums can be those of at most `cells` samples, or of their squares.
    ///
    /// No integer sample, and no square of an integer of at most 32 bits, exceeds 2^64. Sums of
    /// floating samples are not checked.
    pub fn are_possible(&self, cells: u64) -> bool {
        let most = cells as f64 * 2f64.powi(64);
        match self {
            Sums::Exact(sums) => sums.iter().all(|sum| (*sum as f64).abs() <= most),
            Sums::Squares(sums) => sums.iter().all(|sum| sum.is_possible(cells)),
            Sums::Double(_) | Sums::Triple(_) => true,
        }
    }

    /// Returns the population variance of the `cells` samples of a channel, from their sums and
    /// sums of squares: see [`TripleDouble::variance`].
    pub fn variance(sums: &Sums, squares: &Sums, channel: usize, cells: u64) -> f64 {
        let cells = DoubleDouble::from(i128::from(cells));
        TripleDouble::variance(sums.triple(channel), squares.triple(channel), cells)
    }
}

/// Appends the terms of a number. NaN has one canonical form.
fn write_parts<const PARTS: usize>(mut parts: [f64; PARTS], bytes: &mut Vec<u8>) {
    if parts[0].is_nan() {
        parts = [0.0; PARTS];
        parts[0] = f64::NAN;
    }
    bytes.extend(parts.iter().flat_map(|part| part.to_le_bytes()));
}

/// Reads the terms of a number, and returns them with the bytes after them.
fn read_parts<const PARTS: usize>(mut bytes: &[u8]) -> Option<([f64; PARTS], &[u8])> {
    let mut parts = [0.0; PARTS];
    for part in &mut parts {
        let (number, rest) = bytes.split_first_chunk()?;
        (*part, bytes) = (f64::from_le_bytes(*number), rest);
    }
    Some((parts, bytes))
}
