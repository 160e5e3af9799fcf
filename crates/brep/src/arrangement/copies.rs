//! Equal faces of one surface, which are arranged as one face that counts several times.

use super::exact_face::ExactFaces;
use crate::Faces;
use crate::boxes::bounds_of;
use crate::equal_faces::first_equal_faces;
use spinney_base::sort;
use std::hash::BuildHasher;

/// Faces that equal an earlier one, with the same orientation.
///
/// Invariant: only the first of equal faces is in trees, pairs and edges, and it changes winding
/// numbers as often as it is there. All of them lie in the same place, so they have the same
/// contacts, and of those that stay, the first would be chosen. If copies were in pairs, `n` equal
/// bodies would have `n * n` of them. If they did not count, rules that distinguish 1 from 2 or
/// more would decide wrongly, and volumes would be too small.
#[derive(Default)]
pub(super) struct Copies {
    /// For each face, the first equal one; empty if there are no copies.
    first: Vec<u32>,
    /// For each face, how often it is there: 0 for a copy. Empty if there are no copies.
    counts: Vec<u32>,
    /// Number of copies.
    len: u64,
}

impl Copies {
    /// Finds the copies among faces whose vertices are all on the grid.
    pub(super) fn of(faces: &ExactFaces) -> Copies {
        // (Most surfaces have none: equal faces have equal boxes, which take less time to compare.)
        let count = faces.list.len() as usize;
        let mut keys: Vec<(u64, u32)> = (0..count)
            .filter(|face| !faces.exact.contains_key(&(*face as u32)))
            .map(|face| (key(faces.list.get(face).points), face as u32))
            .collect();
        sort::by_key(&mut keys, |(key, _)| *key);
        let mut candidates: Vec<u32> = keys
            .chunk_by(|one, other| one.0 == other.0)
            .filter(|same| same.len() > 1)
            .flat_map(|same| same.iter().map(|(_, face)| *face))
            .collect();
        drop(keys);
        sort::numbers32(&mut candidates);
        let firsts = first_equal_faces(candidates.len(), &|index| {
            let face = faces.list.get(candidates[index] as usize);
            (face.points, face.ring_ends)
        });
        if firsts.is_empty() {
            return Copies::default();
        }
        let mut copies = Copies { first: (0..count as u32).collect(), counts: vec![1; count], len: 0 };
        for (face, first) in candidates.iter().zip(firsts) {
            let first = candidates[first as usize];
            if first != *face {
                copies.first[*face as usize] = first;
                copies.counts[*face as usize] = 0;
                copies.counts[first as usize] += 1;
                copies.len += 1;
            }
        }
        copies
    }

    pub(super) fn len(&self) -> u64 {
        self.len
    }

    /// Returns how often a face is there: 0 for a copy.
    pub(super) fn count(&self, face: u32) -> u32 {
        self.counts.get(face as usize).copied().unwrap_or(1)
    }

    /// Returns the first face that is equal to this one.
    pub(super) fn first(&self, face: u32) -> u32 {
        self.first.get(face as usize).copied().unwrap_or(face)
    }

    pub(super) fn is_copy(&self, face: u32) -> bool {
        self.count(face) == 0
    }

    /// Yields the copies, each after the first face that is equal.
    pub(super) fn pairs(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        (0..).zip(&self.first).filter(|(face, first)| *face != **first).map(|(face, first)| [*first, face])
    }
}

/// Returns a number that is the same for equal faces, from the box and the number of vertices.
fn key(points: &[[i32; 3]]) -> u64 {
    crate::hash::Hasher::default().hash_one((bounds_of(points, 0), points.len()))
}
