//! State bits of the bottom nodes of dense blocks.

use crate::adaptive::Adaptive;
use crate::bits::BitCoder;

/// Probabilities of bits, by the six bits before them.
pub(crate) type MaskContexts = [Adaptive; 64];

/// Codes a bit for each bottom node of a block, row by row, in the context of six earlier bits: the
/// two before it in its row, the three around its position in the row before, and in octrees the
/// one at the same position of the layer before.
pub(crate) fn code_mask<K: BitCoder>(
    coder: &mut K,
    contexts: &mut MaskContexts,
    (axes, levels): (usize, u8),
    bits: &mut [u8],
) {
    let side = 1usize << levels;
    let rows = if axes == 3 { side * side } else { side };
    let is_set = |bits: &[u8], at: usize| usize::from(bits[at / 8] >> (at % 8) & 1);
    for row in 0..rows {
        let start = row * side;
        let before = (row % side > 0).then(|| start - side);
        let below = start.checked_sub(side * side);
        // The last two bits of this row, and three bits of the row before, up to the next position.
        let mut own = 0;
        let mut above = before.map_or(0, |before| is_set(bits, before));
        for x in 0..side {
            let next = before.filter(|_| x + 1 < side).map_or(0, |before| is_set(bits, before + x + 1));
            above = (above << 1 | next) & 7;
            let layer = below.map_or(0, |below| is_set(bits, below + x));
            let bit = coder.bit(&mut contexts[own << 4 | above << 1 | layer], is_set(bits, start + x) == 1);
            if K::READS && bit {
                let at = start + x;
                bits[at / 8] |= 1 << (at % 8);
            }
            own = (own << 1 | usize::from(bit)) & 3;
        }
    }
}
