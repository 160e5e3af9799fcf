//! Sort functions that are compiled once.
//!
//! The standard library compiles its sorts again for each item type and each comparison, ten
//! kilobytes each time. The functions of this module compile the sort for plain numbers only. They
//! sort keys, and then permute the items.
//!
//! | items | function | stable | extra memory |
//! |---|---|---|---|
//! | numbers | [`numbers32`], [`numbers64`], [`numbers128`], [`floats`] | irrelevant | none |
//! | pairs of points | [`point_pairs`] | irrelevant | none |
//! | items with a key of 64 bits | [`by_key`] | yes | 16 bytes per item |
//! | items with a key of 128 bits | [`by_wide_key`] | yes | 48 bytes per item |
//! | items with a comparison only | [`by`] | yes | 12 bytes per item |
//! | very many items, by their `Ord` | [`watched`] | no | none |
//!
//! All take O(n log n) time. Lists of at most twenty items are sorted by insertion, without extra
//! memory; most lists of geometry code are that short.

use std::cmp::Ordering;
use std::mem;

use crate::{Progress, Result, parallel};

/// Maximum length of lists that are sorted by insertion (as in the standard library).
const SHORT: usize = 20;

/// Sorts numbers in place.
///
/// ```
/// let mut numbers = [3, 1, 2];
/// spinney_base::sort::numbers32(&mut numbers);
/// assert_eq!(numbers, [1, 2, 3]);
/// ```
#[inline]
pub fn numbers32(numbers: &mut [u32]) {
    if numbers.len() > 1 {
        sort32(numbers);
    }
}

#[inline(never)]
fn sort32(numbers: &mut [u32]) {
    numbers.sort_unstable();
}

/// Sorts numbers in place.
#[inline]
pub fn numbers64(numbers: &mut [u64]) {
    if numbers.len() > 1 {
        sort64(numbers);
    }
}

#[inline(never)]
fn sort64(numbers: &mut [u64]) {
    numbers.sort_unstable();
}

/// Sorts numbers in place. For tuples, pack the first components into the upper bits.
#[inline]
pub fn numbers128(numbers: &mut [u128]) {
    if numbers.len() > 1 {
        sort128(numbers);
    }
}

#[inline(never)]
fn sort128(numbers: &mut [u128]) {
    numbers.sort_unstable();
}

/// Sorts numbers in place, in the order of [`f64::total_cmp`].
///
/// ```
/// let mut numbers = [2.5, f64::NAN, 0.0, -0.0, -1.0];
/// spinney_base::sort::floats(&mut numbers);
/// assert_eq!(format!("{numbers:?}"), "[-1.0, -0.0, 0.0, 2.5, NaN]");
/// ```
#[inline]
pub fn floats(numbers: &mut [f64]) {
    if numbers.len() > 1 {
        sort_floats(numbers);
    }
}

#[inline(never)]
fn sort_floats(numbers: &mut [f64]) {
    numbers.sort_unstable_by(f64::total_cmp);
}

/// Sorts pairs of points in place.
#[inline]
pub fn point_pairs(pairs: &mut [[[i32; 3]; 2]]) {
    if pairs.len() > 1 {
        sort_point_pairs(pairs);
    }
}

#[inline(never)]
fn sort_point_pairs(pairs: &mut [[[i32; 3]; 2]]) {
    pairs.sort_unstable();
}

/// Sorts items by a key, stably. Calls `key` several times per item of a short list, otherwise
/// once.
///
/// ```
/// use spinney_base::sort;
/// let mut words = ["to", "be", "or", "not", "to", "be"];
/// sort::by_key(&mut words, |word| word.len() as u64);
/// assert_eq!(words, ["to", "be", "or", "to", "be", "not"]);
/// ```
#[inline]
pub fn by_key<T>(items: &mut [T], mut key: impl FnMut(&T) -> u64) {
    if items.len() > SHORT {
        let number = |(item, index)| u128::from(key(item)) << 64 | index;
        let numbers = items.iter().zip(0u128..).map(number).collect();
        arrange(numbers, &mut |a, b| items.swap(a, b));
        return;
    }
    for end in 1..items.len() {
        let own = key(&items[end]);
        let mut at = end;
        while at > 0 && key(&items[at - 1]) > own {
            items.swap(at - 1, at);
            at -= 1;
        }
    }
}

/// Sorts items like [`by_key`], with a key of 128 bits: for keys with several components or
/// channels.
///
/// ```
/// use spinney_base::sort::{by_wide_key, point_key};
/// let mut corners = [([0, 2, 0], 'a'), ([-1, 0, 0], 'b'), ([0, 1, 5], 'c'), ([-1, 0, 0], 'd')];
/// by_wide_key(&mut corners, |(point, _)| point_key(*point));
/// assert_eq!(corners.map(|(_, name)| name), ['b', 'd', 'c', 'a']);
/// ```
#[inline]
pub fn by_wide_key<T>(items: &mut [T], mut key: impl FnMut(&T) -> u128) {
    if items.len() > SHORT {
        let numbers = items.iter().zip(0..).map(|(item, index)| (key(item), index)).collect();
        arrange_wide(numbers, &mut |a, b| items.swap(a, b));
        return;
    }
    for end in 1..items.len() {
        let own = key(&items[end]);
        let mut at = end;
        while at > 0 && key(&items[at - 1]) > own {
            items.swap(at - 1, at);
            at -= 1;
        }
    }
}

/// Sorts items that have no integer key by comparison, stably.
///
/// Each comparison is a dynamic call, so [`by_key`] is faster.
///
/// ```
/// let mut names = vec![String::from("b"), "a".into()];
/// spinney_base::sort::by(&mut names, &mut Ord::cmp);
/// assert_eq!(names, ["a", "b"]);
/// ```
///
/// # Panics
/// If `compare` is found not to be a total order; only for more than twenty items, as in
/// `slice::sort_by`.
pub fn by<T>(items: &mut [T], compare: &mut dyn FnMut(&T, &T) -> Ordering) {
    if items.len() > SHORT {
        let mut order = order_by(items.len(), &mut |a, b| compare(&items[a], &items[b]));
        arrange_as(&mut order, &mut |a, b| items.swap(a, b));
        return;
    }
    for end in 1..items.len() {
        let mut at = end;
        while at > 0 && compare(&items[at - 1], &items[at]).is_gt() {
            items.swap(at - 1, at);
            at -= 1;
        }
    }
}

/// Sorts items in place, on all threads of the current rayon pool. Returns within a fraction of a
/// second after cancellation.
///
/// ```
/// let mut numbers = vec![3, 1, 2];
/// spinney_base::sort::watched(&mut numbers, &())?;
/// assert_eq!(numbers, [1, 2, 3]);
/// # Ok::<(), spinney_base::Error>(())
/// ```
///
/// # Errors
/// On cancellation; the items are then in unspecified order.
pub fn watched<T: Ord + Send>(items: &mut [T], progress: &dyn Progress) -> Result<()> {
    /// Maximum number of items that are sorted without a check for cancellation.
    const AT_ONCE: usize = 1 << 17;
    if items.len() <= AT_ONCE {
        items.sort_unstable();
        return Ok(());
    }
    progress.check()?;
    let (low, _, _) = items.select_nth_unstable(items.len() / 2);
    let middle = low.len();
    let (low, high) = items.split_at_mut(middle);
    let (first, second) = parallel::join(|| watched(low, progress), || watched(high, progress));
    first.and(second)
}

/// Arranges items by keys. The lower half of each number is the item's index.
#[inline(never)]
fn arrange(mut numbers: Vec<u128>, swap: &mut dyn FnMut(usize, usize)) {
    sort128(&mut numbers);
    permute(&mut numbers, swap, |number, index| mem::replace(number, index as u128) as usize);
}

/// Arranges items by keys, each with the item's index.
#[inline(never)]
fn arrange_wide(mut keys: Vec<(u128, usize)>, swap: &mut dyn FnMut(usize, usize)) {
    // A stable sort exploits presorted runs.
    keys.sort();
    permute(&mut keys, swap, |(_, known), index| mem::replace(known, index));
}

/// Returns the indices of items in sorted order.
#[inline(never)]
fn order_by(count: usize, compare: &mut dyn FnMut(usize, usize) -> Ordering) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| compare(*a, *b));
    order
}

/// Arranges items in the order of these indices.
#[inline(never)]
fn arrange_as(order: &mut [usize], swap: &mut dyn FnMut(usize, usize)) {
    permute(order, swap, mem::replace);
}

/// Moves to each index the item at the index that `order` has there, one cycle at a time.
///
/// `replace` stores an index in an entry of the order and returns the previous index of that entry.
fn permute<K>(order: &mut [K], swap: &mut dyn FnMut(usize, usize), replace: impl Fn(&mut K, usize) -> usize) {
    for start in 0..order.len() {
        let mut at = start;
        loop {
            let from = replace(&mut order[at], at);
            if from == start {
                break;
            }
            swap(at, from);
            at = from;
        }
    }
}

/// Returns a key whose order is that of [`f64::total_cmp`].
///
/// ```
/// use spinney_base::sort::float_key;
/// assert!(float_key(-0.0) < float_key(0.0) && float_key(1.0) < float_key(f64::NAN));
/// ```
#[inline]
pub fn float_key(number: f64) -> u64 {
    let bits = number.to_bits();
    bits ^ if bits >> 63 == 1 { u64::MAX } else { 1 << 63 }
}

/// Returns a key whose order is that of pairs.
#[inline]
pub fn pair_key([first, second]: [u32; 2]) -> u64 {
    u64::from(first) << 32 | u64::from(second)
}

/// Returns a key whose order is that of points in a plane.
#[inline]
pub fn flat_key(point: [i64; 2]) -> u128 {
    let [x, y] = point.map(|at| u128::from(at as u64 ^ 1 << 63));
    x << 64 | y
}

/// Returns a key below 2^96 whose order is that of points.
#[inline]
pub fn point_key(point: [i32; 3]) -> u128 {
    let [x, y, z] = point.map(|at| u128::from(at as u32 ^ 1 << 31));
    x << 64 | y << 32 | z
}

/// Returns the point of a [`point_key`].
#[inline]
pub fn key_point(key: u128) -> [i32; 3] {
    [64, 32, 0].map(|shift| ((key >> shift) as u32 ^ 1 << 31) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reproducible random numbers (splitmix64).
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> u64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = self.0;
            z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ z >> 31
        }
    }

    /// Returns lists of many lengths, with few and many distinct keys, shuffled, sorted and
    /// reversed.
    fn lists() -> Vec<Vec<(u64, usize)>> {
        let mut random = Random(7);
        let mut lists = Vec::new();
        for len in (0..50).chain([100, 1000, 5000]) {
            for kinds in [1, 3, 40, u64::MAX] {
                let mut list: Vec<_> = (0..len).map(|index| (random.next() % kinds, index)).collect();
                lists.push(list.clone());
                list.sort();
                lists.push(list.clone());
                list.reverse();
                lists.push(list);
            }
        }
        lists
    }

    #[test]
    fn items_come_as_from_a_stable_sort() {
        for list in lists() {
            // Strings check that items with a destructor are moved correctly.
            let list: Vec<(u64, String)> =
                list.iter().map(|(key, index)| (*key, index.to_string())).collect();
            let mut expected = list.clone();
            expected.sort_by_key(|(key, _)| *key);
            let mut sorted = list.clone();
            by_key(&mut sorted, |(key, _)| *key);
            assert_eq!(sorted, expected);
            let mut sorted = list.clone();
            by_wide_key(&mut sorted, |(key, _)| u128::from(*key) << 64);
            assert_eq!(sorted, expected);
            let mut sorted = list;
            by(&mut sorted, &mut |a, b| a.0.cmp(&b.0));
            assert_eq!(sorted, expected);
        }
    }

    #[test]
    fn very_many_items_come_in_order_unless_it_is_to_stop() {
        struct Stopped(bool);
        impl Progress for Stopped {
            fn interrupted(&self) -> bool {
                self.0
            }
        }
        let mut random = Random(9);
        let list: Vec<(u64, usize)> = (0..300_000).map(|index| (random.next() % 1000, index)).collect();
        let mut sorted = list.clone();
        watched(&mut sorted, &Stopped(false)).unwrap();
        let mut expected = list;
        expected.sort_unstable();
        assert!(sorted == expected);
        assert!(matches!(watched(&mut sorted, &Stopped(true)), Err(crate::Error::Interrupted)));
    }

    #[test]
    fn numbers_come_in_order() {
        for list in lists() {
            let numbers: Vec<u64> = list.iter().map(|(key, _)| *key).collect();
            let mut expected = numbers.clone();
            expected.sort_unstable();
            let mut sorted = numbers.clone();
            numbers64(&mut sorted);
            assert_eq!(sorted, expected);
            let mut wide: Vec<u128> = numbers.iter().map(|number| u128::from(*number) << 60).collect();
            numbers128(&mut wide);
            assert!(wide.is_sorted());
            let mut narrow: Vec<u32> = numbers.iter().map(|number| *number as u32).collect();
            numbers32(&mut narrow);
            assert!(narrow.is_sorted());
            let mut real: Vec<f64> = numbers.iter().map(|number| f64::from_bits(*number)).collect();
            floats(&mut real);
            assert!(real.is_sorted_by(|a, b| a.total_cmp(b).is_le()));
            let mut pairs: Vec<_> =
                numbers.windows(6).map(|six| [0, 3].map(|i| [0, 1, 2].map(|j| six[i + j] as i32))).collect();
            point_pairs(&mut pairs);
            assert!(pairs.is_sorted());
        }
    }

    #[test]
    fn keys_have_the_order_of_what_they_are_of() {
        let mut random = Random(3);
        let (nan, infinite) = (f64::NAN, f64::INFINITY);
        let mut floats = vec![0.0, -0.0, nan, -nan, infinite, -infinite, 1.5, -1.5, f64::MIN_POSITIVE];
        floats.extend((0..50).map(|_| f64::from_bits(random.next())));
        let mut coordinates = vec![i32::MIN, i32::MAX, 0, -1, 1];
        coordinates.extend((0..20).map(|_| random.next() as i32));
        for a in &floats {
            for b in &floats {
                assert_eq!(float_key(*a).cmp(&float_key(*b)), a.total_cmp(b), "{a} {b}");
            }
        }
        let mut points = Vec::new();
        for (i, x) in coordinates.iter().enumerate() {
            points.extend(
                coordinates[i / 2..].iter().map(|y| [*x, *y, coordinates[random.next() as usize % 25]]),
            );
        }
        for a in &points {
            assert_eq!(key_point(point_key(*a)), *a);
            for b in &points {
                assert_eq!(point_key(*a).cmp(&point_key(*b)), a.cmp(b), "{a:?} {b:?}");
                let flat = |[x, y, _]: [i32; 3]| [i64::from(x) << 31, i64::from(y)];
                assert_eq!(flat_key(flat(*a)).cmp(&flat_key(flat(*b))), flat(*a).cmp(&flat(*b)));
                let pair = |[x, y, _]: [i32; 3]| [x as u32, y as u32];
                assert_eq!(pair_key(pair(*a)).cmp(&pair_key(pair(*b))), pair(*a).cmp(&pair(*b)));
            }
        }
    }
}
