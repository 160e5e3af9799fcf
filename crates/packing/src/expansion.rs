//! Limits of the size of unpacked bytes.

/// Bits of the maximum number of unpacked bytes.
pub const PLAIN_BITS: u32 = 27;
/// Maximum number of unpacked bytes.
const MAX_PLAIN: u64 = 1 << (PLAIN_BITS - 1);
/// Unpacked bytes that are allowed in addition to [`PLAIN_PER_BYTE`].
const PLAIN_FREE: u64 = 64 << 10;
/// Unpacked bytes that are allowed per packed byte.
pub const PLAIN_PER_BYTE: u64 = 4096;

/// Returns whether `packed` bytes may unpack to `plain` bytes. Without a limit, a small file could
/// make a reader use much memory and time. Writers store what exceeds the limit unpacked.
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
