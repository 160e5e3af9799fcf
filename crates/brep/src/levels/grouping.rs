//! Division of clusters into groups, and of triangles into clusters: by planes through medians.

use spinney_base::sort;

/// Directions of the planes' normals, one set per level. Planes of consecutive levels are oblique
/// to each other, so borders between the groups of one level are inside of groups of the next,
/// except where they cross.
const DIRECTIONS: [[[i64; 3]; 3]; 3] = [
    [[2, 2, 1], [-2, 1, 2], [1, -2, 2]],
    [[2, -1, 2], [2, 2, -1], [-1, 2, 2]],
    [[3, 0, 0], [0, 3, 0], [0, 0, 3]],
];

/// Something with a position and a size.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    /// At most 2^30 in magnitude.
    pub(super) centre: [i64; 3],
    pub(super) faces: u32,
    /// Index of the item in the caller's list.
    pub(super) index: u32,
}

/// Divides items into sets of about equal numbers of faces, at most `most` if no item exceeds half
/// of it. Returns the indices of each set's items, in ascending order.
pub(super) fn divide(mut items: Vec<Item>, most: u32, level: usize) -> Vec<Vec<u32>> {
    let total = items.iter().map(|item| u64::from(item.faces)).sum::<u64>();
    // (Sets are up to an item larger or smaller than the mean.)
    let largest = items.iter().map(|item| item.faces).max().unwrap_or(0).min(most / 2);
    let sets = total.div_ceil(u64::from((most - largest).max(1))).max(1);
    let sets = if total <= u64::from(most) { 1 } else { sets };
    let mut found = Vec::new();
    split(&mut items, sets, &DIRECTIONS[level % DIRECTIONS.len()], &mut found);
    found
}

fn split(items: &mut [Item], sets: u64, directions: &[[i64; 3]; 3], found: &mut Vec<Vec<u32>>) {
    if sets <= 1 || items.len() <= 1 {
        let mut indices: Vec<u32> = items.iter().map(|item| item.index).collect();
        sort::numbers32(&mut indices);
        found.extend((!indices.is_empty()).then_some(indices));
        return;
    }
    let along = |item: &Item, direction: &[i64; 3]| -> i64 {
        (0..3).map(|axis| item.centre[axis] * direction[axis]).sum()
    };
    let extent = |direction: &[i64; 3]| {
        let (low, high) = items.iter().fold((i64::MAX, i64::MIN), |(low, high), item| {
            let at = along(item, direction);
            (low.min(at), high.max(at))
        });
        high - low
    };
    let widest = directions.iter().max_by_key(|direction| extent(direction)).expect("three directions");
    // (Signs are flipped so that negative numbers sort before positive ones.)
    sort::by_key(items, |item| (along(item, widest) as u64) ^ 1 << 63);
    let total = items.iter().map(|item| u64::from(item.faces)).sum::<u64>();
    let first_sets = sets / 2;
    let goal = (u128::from(total) * u128::from(first_sets) / u128::from(sets)) as u64;
    let mut sum = 0;
    let middle = items.iter().position(|item| {
        sum += u64::from(item.faces);
        sum > goal
    });
    let middle = middle.unwrap_or(items.len()).clamp(1, items.len() - 1);
    let (low, high) = items.split_at_mut(middle);
    split(low, first_sets, directions, found);
    split(high, sets - first_sets, directions, found);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_in_one_set_of_limited_size() {
        let items: Vec<Item> = (0..5000u32)
            .map(|index| {
                let number = u64::from(index).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                let centre = [10, 30, 50].map(|shift| (number >> shift & 1023) as i64);
                Item { centre, faces: 100 + index % 400, index }
            })
            .collect();
        for level in 0..4 {
            let sets = divide(items.clone(), 16_384, level);
            let mut all: Vec<u32> = sets.concat();
            all.sort_unstable();
            assert_eq!(all, (0..5000).collect::<Vec<_>>());
            for set in sets {
                let faces: u32 = set.iter().map(|index| items[*index as usize].faces).sum();
                assert!((12_000..=16_384).contains(&faces), "{faces}");
            }
        }
        assert_eq!(divide(items[..1].to_vec(), 16, 0), [[0]]);
        assert!(divide(Vec::new(), 16, 0).is_empty());
    }
}
