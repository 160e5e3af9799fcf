//! Ranks of planes: whether a set of planes shares a point, a line or everything. Doubles decide
//! most cases; close cases are decided by modular integer arithmetic.

use std::ops::{Add, Mul, Sub};

use super::bounds::{DETERMINANT_BITS, RANK_ROUNDING};
use super::vector::{cross, dot};

/// A plane by its homogeneous coordinates: normal and offset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct HomogeneousPlane {
    normal: [i64; 3],
    offset: i128,
}

impl HomogeneousPlane {
    /// Returns the plane through a point.
    fn through(normal: [i64; 3], point: [i32; 3]) -> HomogeneousPlane {
        HomogeneousPlane { normal, offset: dot(normal.map(i128::from), point.map(i128::from)) }
    }
}

/// A plane by its normal and one of its points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlaneAt {
    pub normal: [i64; 3],
    pub point: [i32; 3],
}

/// An approximate number, and the sum of its terms' magnitudes, to which its rounding error is
/// proportional.
#[derive(Clone, Copy)]
struct BoundedValue {
    value: f64,
    size: f64,
}

impl BoundedValue {
    fn new(value: f64) -> BoundedValue {
        BoundedValue { value, size: value.abs() }
    }

    /// Returns whether the exact number is certainly not zero.
    fn is_clear(self) -> bool {
        self.value.abs() > self.size * RANK_ROUNDING
    }
}

impl Add for BoundedValue {
    type Output = BoundedValue;

    #[inline]
    fn add(self, other: BoundedValue) -> BoundedValue {
        BoundedValue { value: self.value + other.value, size: self.size + other.size }
    }
}

impl Sub for BoundedValue {
    type Output = BoundedValue;

    #[inline]
    fn sub(self, other: BoundedValue) -> BoundedValue {
        BoundedValue { value: self.value - other.value, size: self.size + other.size }
    }
}

impl Mul for BoundedValue {
    type Output = BoundedValue;

    #[inline]
    fn mul(self, other: BoundedValue) -> BoundedValue {
        BoundedValue { value: self.value * other.value, size: self.size * other.size }
    }
}

/// Returns the rank of planes, which is known to be at most `most`, if doubles are sufficient to
/// decide it.
fn clear_rank(planes: impl Iterator<Item = PlaneAt> + Clone, most: usize) -> Option<usize> {
    let normal = |plane: &PlaneAt| plane.normal.map(|n| BoundedValue::new(n as f64));
    let mut rest = planes.clone();
    let first = rest.next()?;
    let n0 = normal(&first);
    // Offsets are relative to a point of the first plane.
    let offset = |plane: &PlaneAt| {
        let from = [0, 1, 2].map(|axis| BoundedValue::new(f64::from(plane.point[axis] - first.point[axis])));
        dot(normal(plane), from)
    };
    let (second, line) = rest.find_map(|plane| {
        let line = cross(n0, normal(&plane));
        line.iter().any(|along| along.is_clear()).then_some((plane, line))
    })?;
    if most == 2 {
        return Some(2);
    }
    let (third, det) = rest.find_map(|plane| {
        let det = dot(line, normal(&plane));
        det.is_clear().then_some((plane, det))
    })?;
    if most == 3 {
        return Some(3);
    }
    // The intersection of the three planes, times the determinant. The rank is 4 if a plane misses
    // this point.
    let (by_second, by_third) = (offset(&second), offset(&third));
    let across = cross(normal(&third), n0);
    let point = [0, 1, 2].map(|axis| by_second * across[axis] + by_third * line[axis]);
    let misses = |plane: PlaneAt| (dot(normal(&plane), point) - offset(&plane) * det).is_clear();
    planes.into_iter().any(misses).then_some(4)
}

/// Differences between 2^61 and primes whose product exceeds any determinant of four planes: a
/// determinant that is zero modulo all of them is zero. Remainders of such primes are cheap.
const BELOW: [u64; 5] = [1, 31, 45, 229, 259];
// (Each prime is larger than 2^60.)
const _: () = assert!(60 * BELOW.len() as u32 > DETERMINANT_BITS);
const MASK: u128 = (1 << 61) - 1;

/// Returns the remainder of a number of at most 122 bits modulo the prime `2^61 - below`.
#[inline]
fn reduce(number: u128, below: u64) -> u64 {
    // 2^61 is congruent to `below`.
    let once = (number & MASK) + (number >> 61) * u128::from(below);
    let twice = (once & MASK) as u64 + (once >> 61) as u64 * below;
    let prime = (1 << 61) - below;
    if twice >= prime { twice - prime } else { twice }
}

#[inline]
fn multiply(a: u64, b: u64, below: u64) -> u64 {
    reduce(u128::from(a) * u128::from(b), below)
}

#[inline]
fn remainder(number: i128, below: u64) -> u64 {
    let rest = reduce(number.unsigned_abs(), below);
    if number < 0 && rest != 0 { (1 << 61) - below - rest } else { rest }
}

/// Rows of a matrix in echelon form, modulo a prime.
struct Rows {
    below: u64,
    rows: [([u64; 4], usize); 4],
    count: usize,
}

impl Rows {
    fn new(below: u64) -> Rows {
        Rows { below, rows: [([0; 4], 0); 4], count: 0 }
    }

    /// Adds a row, and returns the rank.
    #[inline]
    fn add(&mut self, plane: &HomogeneousPlane) -> usize {
        let below = self.below;
        let [x, y, z] = plane.normal.map(|n| remainder(i128::from(n), below));
        let mut row = [x, y, z, remainder(plane.offset, below)];
        for (known, pivot) in &self.rows[..self.count] {
            let (by, from) = (known[*pivot], row[*pivot]);
            if from == 0 {
                continue;
            }
            for column in 0..4 {
                let kept = multiply(row[column], by, below);
                let taken = multiply(known[column], from, below);
                row[column] = if kept >= taken { kept - taken } else { kept + (1 << 61) - below - taken };
            }
        }
        if let Some(pivot) = (0..4).find(|column| row[*column] != 0) {
            self.rows[self.count] = (row, pivot);
            self.count += 1;
        }
        self.count
    }
}

/// Returns the exact rank of planes' homogeneous coordinates, which must be known to be at most
/// `most`: 1 if all planes are equal, 2 if they share a line, 3 if they share a point, 4 otherwise.
/// Shared lines and points may be at infinity.
///
/// Coordinates are those of rings on the grid ([`MAX_BITS`](super::bounds::MAX_BITS)), and normals
/// those of [`ring_normal`](super::normal::ring_normal).
pub(crate) fn rank_of_at_most(planes: impl Iterator<Item = PlaneAt> + Clone, most: usize) -> usize {
    clear_rank(planes.clone(), most).unwrap_or_else(|| {
        rank_by_remainders(planes.map(|plane| HomogeneousPlane::through(plane.normal, plane.point)), most)
    })
}

/// Returns the rank of planes, which is known to be at most `known`, in integers.
fn rank_by_remainders(planes: impl Iterator<Item = HomogeneousPlane> + Clone, known: usize) -> usize {
    let by = |below: u64| {
        let mut rows = Rows::new(below);
        // (Almost always, the first five planes have the rank 4.)
        planes.clone().map(|plane| rows.add(&plane)).find(|rank| *rank == 4).unwrap_or(rows.count)
    };
    // Invariant: a determinant is zero if it is zero modulo all primes, since their product exceeds
    // any determinant of four planes (see `BELOW`). A single prime may divide a determinant that is
    // not zero. So the highest of the ranks is right, and none is too high. A rank that is too low
    // would make a cell a leaf although its planes share nothing.
    let mut most = 0;
    for below in BELOW {
        most = most.max(by(below));
        if most == known {
            break;
        }
    }
    most
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planes(list: &[([i64; 3], i128)]) -> Vec<HomogeneousPlane> {
        list.iter().map(|&(normal, offset)| HomogeneousPlane { normal, offset }).collect()
    }

    fn rank(planes: &[HomogeneousPlane]) -> usize {
        rank_by_remainders(planes.iter().copied(), 4)
    }

    fn rank_of(list: &[([i64; 3], i128)]) -> usize {
        rank(&planes(list))
    }

    #[test]
    fn the_modules_are_primes_whose_product_is_large_enough() {
        let mut bits = 0.0;
        for below in BELOW {
            let prime = (1u64 << 61) - below;
            bits += (prime as f64).log2();
            // Miller-Rabin test, with bases that are sufficient for 64 bits.
            let power = |mut base: u64, mut exponent: u64| {
                let mut result = 1;
                while exponent > 0 {
                    if exponent & 1 == 1 {
                        result = multiply(result, base, below);
                    }
                    base = multiply(base, base, below);
                    exponent >>= 1;
                }
                result
            };
            let twos = (prime - 1).trailing_zeros();
            for base in [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37] {
                let mut x = power(base, (prime - 1) >> twos);
                let mut good = x == 1 || x == prime - 1;
                for _ in 1..twos {
                    x = multiply(x, x, below);
                    good |= x == prime - 1;
                }
                assert!(good, "{prime} {base}");
            }
        }
        assert!(bits > 255.0);
    }

    #[test]
    fn what_planes_have_in_common() {
        assert_eq!(rank_of(&[([1, 2, 3], 4), ([2, 4, 6], 8), ([-1, -2, -3], -4)]), 1);
        assert_eq!(rank_of(&[([1, 2, 3], 4), ([1, 2, 3], 5)]), 2, "parallel");
        assert_eq!(rank_of(&[([1, 0, 0], 7), ([0, 1, 0], 8), ([1, 1, 0], 15), ([3, -1, 0], 13)]), 2);
        assert_eq!(
            rank_of(&[([1, 0, 0], 7), ([0, 1, 0], 8), ([1, 1, 0], 16), ([3, -1, 0], 13)]),
            3,
            "a prism"
        );
        assert_eq!(rank_of(&[([1, 0, 0], 1), ([0, 1, 0], 2), ([0, 0, 1], 3), ([1, 1, 1], 6)]), 3);
        assert_eq!(rank_of(&[([1, 0, 0], 1), ([0, 1, 0], 2), ([0, 0, 1], 3), ([1, 1, 1], 7)]), 4);
        assert_eq!(rank_of(&[]), 0);
    }

    /// Planes through one point have at most the rank 3, and the rank 4 with one that misses it by
    /// a unit, also for the largest coordinates.
    #[test]
    fn one_unit_decides_at_any_size() {
        let mut state = 7u64;
        let mut random = |bits: u32| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> (64 - bits)) as i64
        };
        for _ in 0..500 {
            let point = [0; 3].map(|_: i32| random(26) as i32);
            let mut planes: Vec<HomogeneousPlane> = (0..6)
                .map(|_| HomogeneousPlane::through([0; 3].map(|_: i64| random(55) - (1 << 54)), point))
                .collect();
            assert_eq!(rank(&planes), 3);
            planes[4].offset += 1;
            assert_eq!(rank(&planes), 4);
        }
    }

    /// Doubles and remainders agree wherever doubles decide, and doubles decide most cases.
    #[test]
    fn doubles_are_right() {
        let mut state = 5u64;
        let mut random = |below: i64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 20) as i64 % below
        };
        let mut clear = [0; 5];
        for round in 0..40_000 {
            let count = 2 + round % 5;
            // Small numbers often share a point or a line, large ones are the general case.
            let size = [3, 5, 1000, 1 << 26][round / 5 % 4];
            let planes: Vec<PlaneAt> = (0..count)
                .map(|_| {
                    let normal = [0; 3].map(|_: i64| random(size * 2) - size);
                    PlaneAt { normal, point: [0; 3].map(|_: i32| random(size) as i32) }
                })
                .filter(|plane| plane.normal != [0; 3])
                .collect();
            let exact = planes.iter().map(|plane| HomogeneousPlane::through(plane.normal, plane.point));
            let exact = rank_by_remainders(exact, 4);
            let most = exact.max(planes.len().min(4));
            assert_eq!(rank_of_at_most(planes.iter().copied(), most), exact, "{planes:?}");
            clear[exact] += usize::from(clear_rank(planes.iter().copied(), most).is_some());
        }
        assert!(clear[2] > 1_000 && clear[3] > 1_000 && clear[4] > 10_000, "{clear:?}");
    }
}
