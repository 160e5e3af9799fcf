//! Sorting of many keys.

use spinney_base::sort;

/// Returns the indices of keys in sorted order; equal keys keep their order.
pub(super) fn order_of(keys: &[u64]) -> Vec<u32> {
    let least = keys.iter().copied().min().unwrap_or_default();
    let most = keys.iter().copied().max().unwrap_or_default() - least;
    let index_bits = usize::BITS - keys.len().leading_zeros();
    // Usually the key relative to the minimum and the index fit into 64 bits, which sort twice as
    // fast as 128 bits.
    if most.leading_zeros() >= index_bits {
        let both = |(index, key): (usize, &u64)| (key - least) << index_bits | index as u64;
        let mut order: Vec<u64> = keys.iter().enumerate().map(both).collect();
        sort::numbers64(&mut order);
        let index = |both: u64| (both & ((1 << index_bits) - 1)) as u32;
        return order.into_iter().map(index).collect();
    }
    let both = |(index, key): (usize, &u64)| u128::from(*key) << 32 | index as u128;
    let mut order: Vec<u128> = keys.iter().enumerate().map(both).collect();
    sort::numbers128(&mut order);
    order.into_iter().map(|both| both as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_keys_stay_as_they_are() {
        for high in [0, 1 << 50, u64::MAX - 3] {
            let keys: Vec<u64> =
                (0..1000u64).map(|number| if number % 7 == 0 { high } else { number % 3 }).collect();
            let mut expected: Vec<u32> = (0..1000).collect();
            expected.sort_by_key(|index| keys[*index as usize]);
            assert_eq!(order_of(&keys), expected);
        }
        assert!(order_of(&[]).is_empty());
    }
}
