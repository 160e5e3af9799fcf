//! Columns of numbers: tokens for long columns, variable-length bytes for short ones.

use spinney_packing::{pack_numbers, unpack_numbers};

/// Encodings of columns.
const BY_TOKENS: u8 = 0;
const BY_BYTES: u8 = 1;
/// Flag of a column whose numbers are differences from the previous number.
const DIFFERENCES: u8 = 2;

/// Columns of at least this length always use tokens.
const MANY: usize = 256;

fn fold(number: i64) -> u64 {
    (number << 1 ^ number >> 63) as u64
}

fn unfold(number: u64) -> i64 {
    (number >> 1) as i64 ^ -((number & 1) as i64)
}

/// Writes numbers in the shorter encoding. Each number has a context; if `contexts` is empty, all
/// share one.
pub(super) fn write(numbers: &[i64], contexts: &[u8], bytes: &mut Vec<u8>) {
    write_as(numbers, contexts, 0, bytes);
}

/// Writes numbers, or their differences if these are smaller.
pub(super) fn write_near(numbers: &[i64], bytes: &mut Vec<u8>) {
    let bits = |number: i64| u64::from(u64::BITS - fold(number).leading_zeros());
    let differences: Vec<i64> = std::iter::once(0)
        .chain(numbers.iter().copied())
        .zip(numbers)
        .map(|(before, number)| number.wrapping_sub(before))
        .collect();
    let all = |numbers: &[i64]| numbers.iter().map(|number| bits(*number)).sum::<u64>();
    match all(&differences) < all(numbers) {
        true => write_as(&differences, &[], DIFFERENCES, bytes),
        false => write_as(numbers, &[], 0, bytes),
    }
}

fn write_as(numbers: &[i64], contexts: &[u8], mark: u8, bytes: &mut Vec<u8>) {
    if numbers.is_empty() {
        return;
    }
    let start = bytes.len();
    bytes.push(BY_TOKENS | mark);
    pack_numbers(numbers, contexts, bytes);
    if numbers.len() >= MANY {
        return;
    }
    let mut few = vec![BY_BYTES | mark];
    for number in numbers {
        let mut rest = fold(*number);
        while rest >= 0x80 {
            few.push(rest as u8 | 0x80);
            rest >>= 7;
        }
        few.push(rest as u8);
    }
    if few.len() < bytes.len() - start {
        bytes.truncate(start);
        bytes.extend_from_slice(&few);
    }
}

/// Reads consecutive columns.
pub(super) struct Reader<'b> {
    rest: &'b [u8],
}

impl<'b> Reader<'b> {
    pub(super) fn new(bytes: &'b [u8]) -> Reader<'b> {
        Reader { rest: bytes }
    }

    /// Reads `count` numbers with the contexts they were written with; `None` if the bytes are
    /// invalid. The caller must bound `count`.
    pub(super) fn numbers(&mut self, count: usize, contexts: &[u8]) -> Option<Vec<i64>> {
        if count == 0 {
            return Some(Vec::new());
        }
        let (mark, rest) = self.rest.split_first()?;
        let mut numbers = vec![0; count];
        match mark & !DIFFERENCES {
            BY_TOKENS => self.rest = unpack_numbers(rest, contexts, &mut numbers)?,
            BY_BYTES => {
                self.rest = rest;
                for number in &mut numbers {
                    *number = unfold(self.number()?);
                }
            }
            _ => return None,
        }
        if mark & DIFFERENCES != 0 {
            let mut before = 0i64;
            for number in &mut numbers {
                before = before.wrapping_add(*number);
                *number = before;
            }
        }
        Some(numbers)
    }

    fn number(&mut self) -> Option<u64> {
        let mut number = 0u64;
        for shift in (0..64).step_by(7) {
            let (byte, rest) = self.rest.split_first()?;
            self.rest = rest;
            number |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Some(number);
            }
        }
        None
    }

    /// Whether all bytes were read.
    pub(super) fn is_whole(&self) -> bool {
        self.rest.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back() {
        for count in [0, 1, 3, 255, 256, 3000] {
            let all: [Vec<i64>; 3] = [
                (0..count).map(|number| number * 1000).collect(),
                vec![7; count as usize],
                (0..count).map(|number| if number % 3 == 0 { i64::MIN } else { i64::MAX - number }).collect(),
            ];
            for numbers in all {
                let mut bytes = Vec::new();
                write_near(&numbers, &mut bytes);
                write(&numbers, &[], &mut bytes);
                let mut reader = Reader::new(&bytes);
                for _ in 0..2 {
                    assert_eq!(reader.numbers(numbers.len(), &[]).unwrap(), numbers);
                }
                assert!(reader.is_whole());
                if count > 0 {
                    let mut reader = Reader::new(&bytes[..bytes.len() - 1]);
                    reader.numbers(numbers.len(), &[]).unwrap();
                    assert!(reader.numbers(numbers.len(), &[]).is_none());
                }
            }
        }
    }
}
