//! Columns of integers. The caller knows their structure, and codes them number by number, each in
//! a context of its choice.
//!
//! One function defines both writing and reading. Its control flow and contexts may depend only on
//! numbers coded before. ([`Columns`] returns the coded number, and ignores the argument when it
//! reads.)

use crate::adaptive::{Adaptive, AdaptiveSymbols};
use crate::bits::{BitCoder, BitReader, BitWriter, fold, unfold};
use crate::residuals::{SIZES, code_residual, initial_symbols, size_context};

/// Coder of columns of numbers that either writes or reads.
pub struct Columns<'b> {
    way: Way<'b>,
    bits: Vec<Adaptive>,
    numbers: Vec<Near>,
}

enum Way<'b> {
    Writes(BitWriter),
    Reads(BitReader<'b>),
}

/// Context of numbers near 0.
struct Near {
    /// Expected size: about 32 times the recent magnitude of the numbers.
    size: u64,
    /// Probabilities by magnitude.
    symbols: Vec<AdaptiveSymbols>,
}

/// Limit of a number's contribution to the recent magnitude.
const MAX_MAGNITUDE: u64 = 1 << 40;

impl Columns<'_> {
    /// Creates a writer with numbers of contexts for bits and for numbers.
    pub fn writer(bits: usize, numbers: usize) -> Columns<'static> {
        Columns::new(Way::Writes(BitWriter::default()), bits, numbers)
    }

    /// Creates a reader of what was written with as many contexts. Returns `None` if there are too
    /// few bytes, or invalid states.
    pub fn reader(bytes: &[u8], bits: usize, numbers: usize) -> Option<Columns<'_>> {
        let reader = BitReader::new(bytes).filter(|_| bytes.len().is_multiple_of(4))?;
        Some(Columns::new(Way::Reads(reader), bits, numbers))
    }

    fn new(way: Way<'_>, bits: usize, numbers: usize) -> Columns<'_> {
        let near = || Near { size: 0, symbols: (0..SIZES).map(initial_symbols).collect() };
        Columns {
            way,
            bits: vec![Adaptive::default(); bits],
            numbers: std::iter::repeat_with(near).take(numbers).collect(),
        }
    }

    /// Writes or reads a bit.
    pub fn bit(&mut self, context: usize, bit: bool) -> bool {
        let probability = &mut self.bits[context];
        match &mut self.way {
            Way::Writes(writer) => writer.bit(probability, bit),
            Way::Reads(reader) => reader.bit(probability, bit),
        }
    }

    /// Writes or reads a number of `count` bits, from the highest on, each in the context of those
    /// before it. Uses 2^`count` contexts from `context` on.
    pub fn bits(&mut self, context: usize, count: u32, number: usize) -> usize {
        let mut found = 1;
        for bit in (0..count).rev() {
            found = found << 1 | usize::from(self.bit(context + found, number >> bit & 1 == 1));
        }
        found - (1 << count)
    }

    /// Writes or reads a number near 0 whose magnitude is similar to those before it in its
    /// context.
    pub fn near(&mut self, context: usize, number: i64) -> i64 {
        let Near { size, symbols } = &mut self.numbers[context];
        let of_size = size_context(*size);
        let number = match &mut self.way {
            Way::Writes(writer) => code_residual(writer, symbols, of_size, number),
            Way::Reads(reader) => code_residual(reader, symbols, of_size, number),
        };
        *size = *size - *size / 8 + 4 * number.unsigned_abs().min(MAX_MAGNITUDE);
        number
    }

    /// Writes or reads an unsigned number that is mostly small.
    pub fn count(&mut self, context: usize, number: u64) -> u64 {
        fold(self.near(context, unfold(number)))
    }

    /// Writes or reads a number of any size, without a context.
    pub fn number(&mut self, number: u64) -> u64 {
        match &mut self.way {
            Way::Writes(writer) => writer.number(number),
            Way::Reads(reader) => reader.number(number),
        }
    }

    /// Returns the bytes that were written; nothing for a reader.
    pub fn finish(self) -> Vec<u8> {
        let mut bytes = Vec::new();
        if let Way::Writes(writer) = self.way {
            writer.finish(&mut bytes);
        }
        bytes
    }

    /// Returns whether all bytes were read, and they are those of a writer.
    pub fn is_whole(&self) -> bool {
        match &self.way {
            Way::Writes(_) => true,
            Way::Reads(reader) => reader.is_whole(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Codes numbers by every method.
    fn code(columns: &mut Columns<'_>, numbers: &mut [i64]) {
        for (at, number) in numbers.iter_mut().enumerate() {
            *number = match at % 4 {
                0 => columns.near(0, *number),
                1 => columns.count(1, *number as u64) as i64,
                2 => columns.number(*number as u64) as i64,
                _ => {
                    let low = columns.bits(0, 3, (*number & 7) as usize) as i64;
                    let sign = columns.bit(8, *number < 0);
                    let rest = columns.near(2, (*number >> 3).wrapping_abs());
                    (if sign { rest.wrapping_neg() } else { rest }) << 3 | low
                }
            };
        }
    }

    #[test]
    fn numbers_of_any_size_come_back() {
        let mut state = 5u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as i64
        };
        let mut numbers: Vec<i64> = (0..4000).map(|at| (next() - (1 << 30)) >> (at / 128)).collect();
        numbers.extend([i64::MAX, -1, i64::MIN, 0, i64::MIN + 1, i64::MAX, -1, 0]);
        let mut columns = Columns::writer(9, 3);
        let mut coded = numbers.clone();
        code(&mut columns, &mut coded);
        assert_eq!(coded, numbers);
        let bytes = columns.finish();
        let mut columns = Columns::reader(&bytes, 9, 3).unwrap();
        let mut read = vec![0; numbers.len()];
        code(&mut columns, &mut read);
        assert!(columns.is_whole() && read == numbers);
        // Missing or trailing bytes are reported, and have no other effect.
        for corrupt in [&bytes[..bytes.len() - 4], &[&bytes[..], &[0; 4]].concat()] {
            let mut columns = Columns::reader(corrupt, 9, 3).unwrap();
            code(&mut columns, &mut read);
            assert!(!columns.is_whole());
        }
        assert!(Columns::reader(&bytes[..bytes.len() - 1], 9, 3).is_none());
        assert!(Columns::reader(&bytes[..12], 9, 3).is_none());
    }
}
