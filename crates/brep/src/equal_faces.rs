//! Detection of equal faces by their vertices, without testing pairs.

use std::collections::HashMap;

/// Returns the vertices and the ring ends of a face.
type Outlines<'a> = dyn Fn(usize) -> (&'a [[i32; 3]], &'a [usize]) + 'a;

/// Returns for each face the first face that is equal: the same vertices in the same cyclic order.
/// Empty if no two are equal.
///
/// If a part is repeated very often in one position, as in files of identical objects, all pairs of
/// its faces touch, so work on pairs would be quadratic.
pub(crate) fn first_equal_faces<'a>(count: usize, outline: &Outlines<'a>) -> Vec<u32> {
    let mut known: HashMap<(Vec<[i32; 3]>, &[usize]), u32> = HashMap::new();
    let first = (0..count).map(|index| {
        let (points, ring_ends) = outline(index);
        let mut points = points.to_vec();
        let outer = &mut points[..ring_ends.first().copied().unwrap_or(0)];
        let least = (0..outer.len()).min_by_key(|at| outer[*at]).unwrap_or(0);
        outer.rotate_left(least);
        *known.entry((points, ring_ends)).or_insert(index as u32)
    });
    let first: Vec<u32> = first.collect();
    if known.len() == first.len() { Vec::new() } else { first }
}
