//! A fast hash for points. It does not resist collisions from untrusted input, so it is used for
//! small tables only.

use std::hash::BuildHasherDefault;

/// Builds [`PointHasher`]s.
pub(crate) type Hasher = BuildHasherDefault<PointHasher>;

/// Multiplies and folds each number that is written (after wyhash, W. Yi).
#[derive(Clone, Copy, Default)]
pub(crate) struct PointHasher(u64);

impl PointHasher {
    #[inline]
    fn mix(&mut self, number: u64) {
        let product =
            u128::from(self.0 ^ number ^ 0x9e37_79b9_7f4a_7c15) * u128::from(0xe703_7ed1_a0b4_28db_u64);
        self.0 = (product >> 64) as u64 ^ product as u64;
    }
}

impl std::hash::Hasher for PointHasher {
    #[inline]
    fn write(&mut self, bytes: &[u8]) {
        for part in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..part.len()].copy_from_slice(part);
            self.mix(u64::from_le_bytes(word));
        }
    }

    #[inline]
    fn write_u32(&mut self, number: u32) {
        self.mix(number.into());
    }

    #[inline]
    fn write_usize(&mut self, number: usize) {
        self.mix(number as u64);
    }

    #[inline]
    fn finish(&self) -> u64 {
        self.0
    }
}
