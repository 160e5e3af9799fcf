//! Packing of arbitrary bytes. A byte is predicted from the last occurrence of the preceding bytes,
//! or coded in the context of the previous byte.

use spinney_packing::Columns;

/// Contexts of bits: whether a byte is as predicted, by the number of correct predictions before
/// it; and its bits, by the previous byte.
const EXPECTED: usize = 0;
const BYTE: usize = EXPECTED + MAX_LENGTH + 1;
pub(super) const CONTEXTS: (usize, usize) = (BYTE + 256 * 256, 0);

/// Maximum number of consecutive correct predictions that contexts distinguish.
const MAX_LENGTH: usize = 31;
/// Number of preceding bytes whose last occurrence predicts the next byte.
const KEY: usize = 4;
/// Bits of the hash of these bytes.
const KEY_BITS: u32 = 16;

/// Codes `length` bytes; writes those of `plain`.
pub(super) fn code(columns: &mut Columns<'_>, length: usize, plain: &[u8]) -> Vec<u8> {
    let mut bytes: Vec<u8> = Vec::with_capacity(length.min(1 << 16));
    // Position after the last occurrence of each key, and position of the currently predicted byte
    // (0: none).
    let mut last_offsets = vec![0u32; 1 << KEY_BITS];
    let (mut offset, mut alike) = (0, 0);
    for at in 0..length {
        if let Some(key) = at.checked_sub(KEY).and_then(|from| bytes[from..].first_chunk()) {
            let key = u32::from_le_bytes(*key).wrapping_mul(0x9E37_79B1) >> (u32::BITS - KEY_BITS);
            if offset == 0 {
                offset = last_offsets[key as usize] as usize;
            }
            last_offsets[key as usize] = at as u32;
        }
        let byte = plain.get(at).copied().unwrap_or(0);
        if offset > 0 {
            let is_expected = columns.bit(EXPECTED + alike, byte == bytes[offset]);
            if is_expected {
                alike = (alike + 1).min(MAX_LENGTH);
                bytes.push(bytes[offset]);
                offset += 1;
                continue;
            }
            (offset, alike) = (0, 0);
        }
        let before = bytes.last().map_or(0, |before| usize::from(*before));
        bytes.push(columns.bits(BYTE + 256 * before, 8, byte.into()) as u8);
    }
    bytes
}
