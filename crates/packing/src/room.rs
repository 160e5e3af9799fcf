//! How many bytes few bytes may become.

/// Bits of the bytes that packed bytes become at most.
pub const PLAIN_BITS: u32 = 27;
/// Bytes that they become at most, however many they are.
const MAX_PLAIN: u64 = 1 << (PLAIN_BITS - 1);
/// Bytes that they become at most: so many, and for each of them more.
const PLAIN_FREE: u64 = 64 << 10;
/// Bytes that each of them becomes at most.
pub const PLAIN_PER_BYTE: u64 = 4096;

/// Whether so many packed bytes may become so many plain ones: else a small file could ask for a lot of memory, and
/// time. What would become more is written plain.
pub fn may_unpack(packed: u64, plain: u64) -> bool {
    plain <= MAX_PLAIN && plain <= PLAIN_FREE.saturating_add(packed.saturating_mul(PLAIN_PER_BYTE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_bytes_become_no_more_than_they_may() {
        for (packed, plain, may) in [
            (0, 65_536, true),
            (0, 65_537, false),
            (1, 69_632, true),
            (1, 69_633, false),
            (1 << 40, 64 << 20, true),
            (1 << 40, (64 << 20) + 1, false),
            (u64::MAX, u64::MAX, false),
        ] {
            assert_eq!(may_unpack(packed, plain), may, "{packed} {plain}");
        }
    }
}
