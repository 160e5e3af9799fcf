//! Packed entries of segments: each field's values are stored consecutively, as a column of
//! numbers.

use super::directory::entry_size;
use spinney_base::value::{Sums, ValueType};
use spinney_packing::{pack_numbers, unpack_numbers};

/// Maximum number of entries that are packed together.
pub(super) const TOGETHER: usize = 1024;

/// Returns the sizes of an entry's numbers in bytes, in order: none has more than eight.
fn widths(value_type: ValueType) -> Vec<usize> {
    // Code, offset, length, records, classes, codec and table, checksum, cells.
    let mut widths = vec![8, 8, 8, 4, 2, 2, 4, 8];
    let sample = value_type.sample.size();
    for _ in 0..value_type.channels {
        // Extremes, then the sum and the sum of squares in words of eight bytes.
        widths.extend([sample, sample, 8, 8]);
        widths.extend(vec![8; Sums::size_of_squares(value_type.sample) / 8]);
    }
    if value_type.is_masked() {
        widths.extend(vec![8; usize::from(value_type.channels)]);
    }
    debug_assert_eq!(widths.iter().sum::<usize>(), entry_size(value_type));
    widths
}

/// Packs the bytes of consecutive entries. Codes are stored as differences from the previous one.
pub(super) fn pack_entries(value_type: ValueType, entries: &[u8]) -> Vec<u8> {
    let (mut packed, mut at) = (Vec::new(), 0);
    for width in widths(value_type) {
        let mut before = 0;
        let number = |entry: &[u8]| {
            let mut bytes = [0; 8];
            bytes[..width].copy_from_slice(&entry[at..at + width]);
            let number = i64::from_le_bytes(bytes);
            number.wrapping_sub(if at == 0 { std::mem::replace(&mut before, number) } else { 0 })
        };
        let numbers: Vec<i64> = entries.chunks_exact(entry_size(value_type)).map(number).collect();
        pack_numbers(&numbers, &[], &mut packed);
        at += width;
    }
    packed
}

/// Unpacks `count` entries; returns `None` if the bytes are not those of as many.
pub(super) fn unpack_entries(value_type: ValueType, count: usize, mut packed: &[u8]) -> Option<Vec<u8>> {
    let size = entry_size(value_type);
    let (mut entries, mut numbers, mut at) = (vec![0; count * size], vec![0; count], 0);
    for width in widths(value_type) {
        packed = unpack_numbers(packed, &[], &mut numbers)?;
        let mut before = 0i64;
        for (entry, number) in entries.chunks_exact_mut(size).zip(&numbers) {
            let number = number.wrapping_add(before);
            before = if at == 0 { number } else { 0 };
            entry[at..at + width].copy_from_slice(&number.to_le_bytes()[..width]);
        }
        at += width;
    }
    packed.is_empty().then_some(entries)
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_base::value::SampleType;

    #[test]
    fn entries_come_back() {
        for value_type in [
            ValueType::new(SampleType::U8, 1),
            ValueType::new(SampleType::F64, 2),
            ValueType::new(SampleType::U16, 3).with_missing(7u64),
        ] {
            for count in [1, 5, TOGETHER] {
                let byte = |i: usize| if i.is_multiple_of(3) { (i * i % 251) as u8 } else { 0 };
                let entries: Vec<u8> = (0..count * entry_size(value_type)).map(byte).collect();
                let packed = pack_entries(value_type, &entries);
                assert_eq!(unpack_entries(value_type, count, &packed), Some(entries));
                assert_eq!(unpack_entries(value_type, count, &[&packed[..], &[0]].concat()), None);
                assert_eq!(unpack_entries(value_type, count, &packed[..packed.len() - 1]), None);
            }
        }
    }
}
