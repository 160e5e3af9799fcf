//! Bits of the bottom nodes of dense blocks.

use crate::bits::{Adaptive, BitCoder};

/// Neighbours that come before a bit: steps along x, y and z.
const BEFORE: [[usize; 3]; 6] = [[1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 0, 0], [0, 0, 1], [0, 1, 1]];

/// Codes a bit for each bottom node, in the context of those before it.
pub(crate) fn code_mask<K: BitCoder>(coder: &mut K, axes: usize, levels: u8, bits: &mut [u8]) {
    let mut contexts = [Adaptive::default(); 1 << BEFORE.len()];
    let side = 1usize << levels;
    let is_set = |bits: &[u8], at: usize| bits[at / 8] >> (at % 8) & 1 == 1;
    for z in 0..if axes == 3 { side } else { 1 } {
        for y in 0..side {
            for x in 0..side {
                let at = (z * side + y) * side + x;
                let mut context = 0;
                for [dx, dy, dz] in BEFORE {
                    let is_there = dx <= x && dy <= y && dz <= z;
                    let before = is_there && is_set(bits, at - (dz * side + dy) * side - dx);
                    context = context << 1 | usize::from(before);
                }
                let bit = coder.bit(&mut contexts[context], is_set(bits, at));
                if K::READS && bit {
                    bits[at / 8] |= 1 << (at % 8);
                }
            }
        }
    }
}
