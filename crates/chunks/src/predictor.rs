//! Inverse of the predictors, which store differences between neighbours in a row.

use serde::{Deserialize, Serialize};

use crate::spec::predictor as scheme;

/// Filter that was applied to rows before compression.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Predictor {
    /// No filter.
    None,
    /// Each sample is the difference from the same channel of the previous pixel.
    Horizontal,
    /// Bytes of equal significance are grouped, each the difference from the previous one.
    Float,
}

impl Predictor {
    /// The filter for a value of the tag Predictor.
    ///
    /// # Errors
    /// Names an unknown filter.
    pub fn new(predictor: u64) -> Result<Predictor, String> {
        match predictor {
            scheme::NONE => Ok(Predictor::None),
            scheme::HORIZONTAL => Ok(Predictor::Horizontal),
            scheme::FLOATING_POINT => Ok(Predictor::Float),
            other => Err(format!("predictor {other} (unknown)")),
        }
    }

    /// Value of the tag Predictor.
    pub fn number(self) -> u64 {
        match self {
            Predictor::None => scheme::NONE,
            Predictor::Horizontal => scheme::HORIZONTAL,
            Predictor::Float => scheme::FLOATING_POINT,
        }
    }
}

/// Restores `rows` (each of `row_bytes`, with samples of `size` bytes) to plain little-endian
/// samples.
pub(crate) fn restore(
    predictor: Predictor,
    rows: &mut [u8],
    row_bytes: usize,
    size: usize,
    channels: usize,
    big_endian: bool,
) {
    // Horizontal differences are between samples as numbers, so byte order is fixed first. The
    // floating-point predictor stores the most significant bytes first in any file.
    if big_endian && size > 1 && predictor != Predictor::Float {
        match size {
            2 => rows.as_chunks_mut::<2>().0.iter_mut().for_each(|sample| sample.reverse()),
            4 => rows.as_chunks_mut::<4>().0.iter_mut().for_each(|sample| sample.reverse()),
            _ => rows.chunks_exact_mut(size).for_each(<[u8]>::reverse),
        }
    }
    match predictor {
        Predictor::None => {}
        Predictor::Horizontal => {
            for row in rows.chunks_exact_mut(row_bytes) {
                accumulate(row, size, channels);
            }
        }
        Predictor::Float => {
            let mut planes = vec![0; row_bytes];
            for row in rows.chunks_exact_mut(row_bytes) {
                accumulate(row, 1, channels);
                planes.copy_from_slice(row);
                let samples = row_bytes / size;
                for (i, sample) in row.chunks_exact_mut(size).enumerate() {
                    for (rank, byte) in sample.iter_mut().rev().enumerate() {
                        *byte = planes[rank * samples + i];
                    }
                }
            }
        }
    }
}

/// Adds to each sample the sample `channels` before it.
fn accumulate(row: &mut [u8], size: usize, channels: usize) {
    macro_rules! sums {
        ($type:ty) => {{
            const SIZE: usize = size_of::<$type>();
            let load = |row: &[u8], i: usize| <$type>::from_le_bytes(row[i..i + SIZE].try_into().unwrap());
            for i in (channels * SIZE..row.len()).step_by(SIZE) {
                let sum = load(row, i).wrapping_add(load(row, i - channels * SIZE));
                row[i..i + SIZE].copy_from_slice(&sum.to_le_bytes());
            }
        }};
    }
    match size {
        1 => {
            for i in channels..row.len() {
                row[i] = row[i].wrapping_add(row[i - channels]);
            }
        }
        2 => sums!(u16),
        4 => sums!(u32),
        _ => sums!(u64),
    }
}
