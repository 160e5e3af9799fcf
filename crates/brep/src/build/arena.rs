//! Nodes of a subtree that is being built, and the segments that are cut off from it.

use std::collections::HashMap;

use crate::hash::Hasher;
use crate::store::segment::{
    CUT, FULL, INNER, LEAF, LeafHead, NEAR_FULL, NEAR_VOID, VOID, encode, push_leaf, push_list,
};
use crate::store::summary::NodeCounts;
use spinney_base::sort;
use spinney_base::space::Code;

use super::defects::Defects;

/// Number of words of nodes and leaves below a node above which the subtree becomes a segment. It
/// depends on the tree alone, so files do not depend on how the work was divided.
const SEGMENT: usize = 4096;

/// Marks an entry that is not a leaf: a cell that no face cuts, with a list of near off-grid faces.
const NO_LEAF: u32 = 256;

/// Nodes of subtrees, in preorder. A leaf's word is an index into `leaves`, where an entry has a
/// head, the count and numbers of its faces, and the count and numbers of near faces with off-grid
/// vertices.
#[derive(Default)]
pub(super) struct Arena {
    words: Vec<u32>,
    leaves: Vec<u32>,
    /// Segments that were cut off, the deepest first.
    pub(super) segments: Vec<(Code, Vec<u8>)>,
    pub(super) counts: NodeCounts,
    pub(super) defects: Defects,
}

/// A position in an arena: where a subtree begins.
#[derive(Clone, Copy)]
pub(super) struct Mark {
    words: usize,
    leaves: usize,
}

impl Arena {
    pub(super) fn mark(&self) -> Mark {
        Mark { words: self.words.len(), leaves: self.leaves.len() }
    }

    /// Adds a leaf with the numbers of its faces, and of near faces with off-grid vertices; returns
    /// its word.
    pub(super) fn leaf(&mut self, head: LeafHead, faces: impl Iterator<Item = u32>, near: &[u32]) -> u32 {
        self.counts.count(head.kind);
        self.entry(head.to_byte().into(), faces, near) << 3 | LEAF
    }

    /// Returns the word of a VOID or FULL cell that no face cuts; it refers to a list if off-grid
    /// faces are near.
    pub(super) fn near(&mut self, word: u32, near: &[u32]) -> u32 {
        if near.is_empty() {
            return word;
        }
        let state = if word == VOID { NEAR_VOID } else { NEAR_FULL };
        self.entry(NO_LEAF, std::iter::empty(), near) << 3 | state
    }

    /// Adds an entry to the list of leaves; returns its index.
    fn entry(&mut self, head: u32, faces: impl Iterator<Item = u32>, near: &[u32]) -> u32 {
        let at = self.leaves.len();
        self.leaves.extend([head, 0]);
        self.leaves.extend(faces);
        self.leaves[at + 1] = (self.leaves.len() - at - 2) as u32;
        self.leaves.push(near.len() as u32);
        self.leaves.extend_from_slice(near);
        at as u32
    }

    /// Removes the only leaf, and returns its head.
    pub(super) fn take_leaf(&mut self) -> Option<LeafHead> {
        let head = self.leaves.first().and_then(|head| LeafHead::from_byte(*head as u8));
        self.leaves.clear();
        head
    }

    /// Reserves the words of a node's children; returns their index.
    pub(super) fn record(&mut self) -> usize {
        self.counts.inner += 1;
        self.words.extend([0; 8]);
        self.words.len() - 8
    }

    /// Sets the word of a child.
    pub(super) fn set(&mut self, record: usize, child: usize, word: u32) {
        self.words[record + child] = word;
    }

    /// Merges a node's children if all are VOID, or all FULL, without near off-grid faces. Returns
    /// the node's word in this case.
    pub(super) fn merged(&mut self, record: usize) -> Option<u32> {
        let (_, words) = self.words.split_at(record);
        let state = words[0];
        if words.len() != 8 || !matches!(state, VOID | FULL) || words.iter().any(|word| *word != state) {
            return None;
        }
        self.words.truncate(record);
        self.counts.inner -= 1;
        *if state == FULL { &mut self.counts.full } else { &mut self.counts.void } -= 7;
        Some(state)
    }

    /// Returns the word of a node whose children are complete. A subtree that has become too large
    /// is cut off into a segment.
    pub(super) fn complete(&mut self, code: Code, mark: Mark, record: usize) -> u32 {
        // Invariant: the words after a node's mark are its complete descendants, except those that
        // were cut off. Nodes are created in preorder, and completed after their children. This
        // includes the children that other threads have built, which are appended in order. So the
        // tree alone determines which subtrees are cut off, and indices of a subtree only need to
        // be shifted by its mark. Otherwise, files would depend on the threads, and indices would
        // be wrong.
        let size = self.words.len() - mark.words + self.leaves.len() - mark.leaves;
        let word = (record as u32) << 3 | INNER;
        if size <= SEGMENT {
            return word;
        }
        self.cut(code, mark, word);
        CUT
    }

    /// Cuts off the subtree that begins at a mark into a segment.
    pub(super) fn cut(&mut self, code: Code, mark: Mark, word: u32) {
        let (mut faces, mut exact) = (OwnNumbers::default(), OwnNumbers::default());
        let mut leaves = Vec::new();
        let mut offsets = vec![0; self.leaves.len() - mark.leaves];
        let mut at = mark.leaves;
        let (mut own, mut near) = (Vec::new(), Vec::new());
        while at < self.leaves.len() {
            let head = self.leaves[at];
            offsets[at - mark.leaves] = leaves.len() as u32;
            let mut list = |numbers: &mut OwnNumbers, out: &mut Vec<u32>| {
                let count = self.leaves[at + 1] as usize;
                numbers.of(&self.leaves[at + 2..at + 2 + count], out);
                at += 1 + count;
            };
            list(&mut faces, &mut own);
            list(&mut exact, &mut near);
            at += 1;
            match head {
                NO_LEAF => push_list(&mut leaves, &near),
                _ => push_leaf(&mut leaves, head as u8, &own, &near),
            }
        }
        let moved = |word: u32| match word & 7 {
            INNER => ((word >> 3) - mark.words as u32 + 1) << 3 | INNER,
            state @ (LEAF | NEAR_VOID | NEAR_FULL) => {
                offsets[(word >> 3) as usize - mark.leaves] << 3 | state
            }
            _ => word,
        };
        let mut words = vec![moved(word)];
        words.extend(self.words[mark.words..].iter().map(|word| moved(*word)));
        self.segments.push((code, encode(&faces.list, &exact.list, &words, &leaves)));
        self.words.truncate(mark.words);
        self.leaves.truncate(mark.leaves);
    }

    /// Appends another arena, which has a single root; returns the root's word in this arena.
    pub(super) fn append(&mut self, other: Arena, word: u32) -> u32 {
        let (words, leaves) = (self.words.len() as u32, self.leaves.len() as u32);
        let moved = |word: u32| match word & 7 {
            INNER => word + (words << 3),
            LEAF | NEAR_VOID | NEAR_FULL => word + (leaves << 3),
            _ => word,
        };
        self.words.extend(other.words.iter().map(|word| moved(*word)));
        self.leaves.extend_from_slice(&other.leaves);
        self.segments.extend(other.segments);
        self.counts.add(&other.counts);
        self.defects.append(other.defects);
        moved(word)
    }
}

/// Face numbers within a segment, by first occurrence.
#[derive(Default)]
struct OwnNumbers {
    numbers: HashMap<u32, u32, Hasher>,
    list: Vec<u32>,
}

impl OwnNumbers {
    /// Maps faces to their numbers in the segment, ascending.
    fn of(&mut self, faces: &[u32], out: &mut Vec<u32>) {
        out.clear();
        for &face in faces {
            let next = self.list.len() as u32;
            let number = *self.numbers.entry(face).or_insert(next);
            if number == next {
                self.list.push(face);
            }
            out.push(number);
        }
        sort::numbers32(out);
    }
}
