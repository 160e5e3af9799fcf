//! Ranks of planes: whether many of them have a point, a line or everything in common. Doubles tell most; what is too
//! close to call is decided by remainders of whole numbers.

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
    /// The plane through a point.
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

/// A number that is known roughly, and the sum of the magnitudes of what it was added up from: rounding changes it by
/// a small share of these.
#[derive(Clone, Copy)]
struct Rough {
    value: f64,
    size: f64,
}

impl Rough {
    fn new(value: f64) -> Rough {
        Rough { value, size: value.abs() }
    }

    /// Whether the exact number is not zero for certain.
    fn is_clear(self) -> bool {
        self.value.abs() > self.size * RANK_ROUNDING
    }
}

impl Add for Rough {
    type Output = Rough;

    #[inline]
    fn add(self, other: Rough) -> Rough {
        Rough { value: self.value + other.value, size: self.size + other.size }
    }
}

impl Sub for Rough {
    type Output = Rough;

    #[inline]
    fn sub(self, other: Rough) -> Rough {
        Rough { value: self.value - other.value, size: self.size + other.size }
    }
}

impl Mul for Rough {
    type Output = Rough;

    #[inline]
    fn mul(self, other: Rough) -> Rough {
        Rough { value: self.value * other.value, size: self.size * other.size }
    }
}

/// The rank of planes that are known to have no higher one than `most`, where doubles are enough to tell it.
fn clear_rank(planes: impl Iterator<Item = PlaneAt> + Clone, most: usize) -> Option<usize> {
    let normal = |plane: &PlaneAt| plane.normal.map(|n| Rough::new(n as f64));
    let mut rest = planes.clone();
    let first = rest.next()?;
    let n0 = normal(&first);
    // Offsets are those from a point of the first plane.
    let offset = |plane: &PlaneAt| {
        let from = [0, 1, 2].map(|axis| Rough::new(f64::from(plane.point[axis] - first.point[axis])));
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
    // Where the three meet, times the determinant: what misses this point makes the rank 4.
    let (by_second, by_third) = (offset(&second), offset(&third));
    let across = cross(normal(&third), n0);
    let point = [0, 1, 2].map(|axis| by_second * across[axis] + by_third * line[axis]);
    let misses = |plane: PlaneAt| (dot(normal(&plane), point) - offset(&plane) * det).is_clear();
    planes.into_iter().any(misses).then_some(4)
}

/// Differences from 2^61 of primes whose product is more than any determinant of four planes: one that is zero by all of
/// them is zero. Remainders of such primes are cheap.
const BELOW: [u64; 5] = [1, 31, 45, 229, 259];
// (Each of them is more than 2^60.)
const _: () = assert!(60 * BELOW.len() as u32 > DETERMINANT_BITS);
const MASK: u128 = (1 << 61) - 1;

/// The remainder of a number of at most 122 bits by the prime that is so much below 2^61.
#[inline]
fn reduce(number: u128, below: u64) -> u64 {
    // 2^61 leaves the remainder `below`.
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

/// Rows of a matrix in echelon form, by the remainders of a prime.
struct Rows {
    below: u64,
    rows: [([u64; 4], usize); 4],
    count: usize,
}

impl Rows {
    fn new(below: u64) -> Rows {
        Rows { below, rows: [([0; 4], 0); 4], count: 0 }
    }

    /// Adds a row; returns the rank.
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

/// The rank of some planes' homogeneous coordinates, exactly, if it is known to be at most `most`: 1 if all are one
/// plane, 2 if they have a line in common, 3 if they have a point in common, 4 if they have none. Common lines and
/// points may be infinitely far away.
///
/// Coordinates are those of rings on the grid ([`MAX_BITS`](super::bounds::MAX_BITS)), and normals those of
/// [`ring_normal`](super::normal::ring_normal).
pub(crate) fn rank_of_at_most(planes: impl Iterator<Item = PlaneAt> + Clone, most: usize) -> usize {
    clear_rank(planes.clone(), most).unwrap_or_else(|| {
        rank_by_remainders(planes.map(|plane| HomogeneousPlane::through(plane.normal, plane.point)), most)
    })
}

/// The rank of planes that are known to have no higher one than `known`, in whole numbers.
fn rank_by_remainders(planes: impl Iterator<Item = HomogeneousPlane> + Clone, known: usize) -> usize {
    let by = |below: u64| {
        let mut rows = Rows::new(below);
        // (Almost always the first five have the rank 4.)
        planes.clone().map(|plane| rows.add(&plane)).find(|rank| *rank == 4).unwrap_or(rows.count)
    };
    // Invariant: a determinant is zero if it is by all primes, since their product is more than any that four
    // planes have (see `BELOW`). One prime alone may make it zero: so the highest
    // of the ranks is right, and none is too high. A rank that is too low would make a cell a leaf whose
    // planes have nothing in common.
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
            // Miller and Rabin, with bases that are enough for 64 bits.
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

    /// Planes through one point have at most the rank 3, and with one that misses it by a unit the rank 4, also
    /// with the largest coordinates.
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

    /// Doubles and remainders agree, wherever doubles say anything, and they mostly do.
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
            // Small numbers often have a point or a line in common, large ones are the general case.
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
