//! Cell counts per value, for values that are added sequentially.

use super::averaging::sum_by_value;
use spinney_base::value::{Value, ValueType};

/// Bits of the hash that indexes recent values.
const RECENT_BITS: u32 = 5;

/// Counts of values; most values have a single entry until the end.
#[derive(Default)]
pub(super) struct ValueCounts {
    counts: Vec<(Value, u64)>,
    /// Indices of recent values' entries, by a hash of the value's bytes.
    recent: [u32; 1 << RECENT_BITS],
}

impl ValueCounts {
    /// Adds cells of a value, given by its bytes.
    pub(super) fn add(&mut self, bytes: &[u8], cells: u64) {
        if cells == 0 {
            return;
        }
        let value = Value::from_bytes(bytes);
        let mix = |hash: u32, byte: &u8| (hash.rotate_left(5) ^ u32::from(*byte)).wrapping_mul(0x9e37_79b1);
        let hash = bytes.iter().fold(0, mix) >> (u32::BITS - RECENT_BITS);
        let place = &mut self.recent[hash as usize];
        match self.counts.get_mut(*place as usize) {
            Some(count) if count.0 == value => count.1 += cells,
            _ => {
                *place = self.counts.len() as u32;
                self.counts.push((value, cells));
            }
        }
    }

    /// Returns the number of cells per value, sorted by value.
    pub(super) fn finish(mut self, value_type: ValueType) -> Vec<(Value, u64)> {
        sum_by_value(value_type, &mut self.counts);
        self.counts
    }
}
