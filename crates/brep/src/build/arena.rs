//! The nodes of a part of the octree that is being built, and the segments that are cut from it.

use std::collections::HashMap;

use crate::hash::Hasher;
use crate::store::segment::{
    CUT, FULL, INNER, LEAF, LeafHead, NEAR_FULL, NEAR_VOID, VOID, encode, push_leaf, push_list,
};
use crate::store::summary::NodeCounts;
use spinney_base::sort;
use spinney_base::space::Code;

use super::defects::Defects;

/// Words of nodes and leaves below a node that make it own a segment. A function of the tree alone decides, so that
/// files do not depend on how the work was divided.
const SEGMENT: usize = 4096;

/// Instead of the head of a leaf: a cell that no face cuts, with a list of faces beside the grid that are near it.
const NO_LEAF: u32 = 256;

/// Nodes of subtrees, in preorder. The words of leaves are places in a list of heads, counts and numbers of faces, and counts and
/// numbers of faces with corners beside the grid.
#[derive(Default)]
pub(super) struct Arena {
    words: Vec<u32>,
    leaves: Vec<u32>,
    /// Segments that were cut, the deepest first.
    pub(super) segments: Vec<(Code, Vec<u8>)>,
    pub(super) counts: NodeCounts,
    pub(super) defects: Defects,
}

/// A place in an arena: where a subtree begins.
#[derive(Clone, Copy)]
pub(super) struct Mark {
    words: usize,
    leaves: usize,
}

impl Arena {
    pub(super) fn mark(&self) -> Mark {
        Mark { words: self.words.len(), leaves: self.leaves.len() }
    }

    /// Adds a leaf with the numbers of its faces, and of those with corners beside the grid that are near it; returns its word.
    pub(super) fn leaf(&mut self, head: LeafHead, faces: impl Iterator<Item = u32>, near: &[u32]) -> u32 {
        self.counts.count(head.kind);
        self.entry(head.to_byte().into(), faces, near) << 3 | LEAF
    }

    /// The word of a cell that no face cuts, and that is VOID or FULL; with a list where faces beside the grid are near it.
    pub(super) fn near(&mut self, word: u32, near: &[u32]) -> u32 {
        if near.is_empty() {
            return word;
        }
        let state = if word == VOID { NEAR_VOID } else { NEAR_FULL };
        self.entry(NO_LEAF, std::iter::empty(), near) << 3 | state
    }

    /// Adds an entry of the list of leaves; returns its place.
    fn entry(&mut self, head: u32, faces: impl Iterator<Item = u32>, near: &[u32]) -> u32 {
        let at = self.leaves.len();
        self.leaves.extend([head, 0]);
        self.leaves.extend(faces);
        self.leaves[at + 1] = (self.leaves.len() - at - 2) as u32;
        self.leaves.push(near.len() as u32);
        self.leaves.extend_from_slice(near);
        at as u32
    }

    /// The head of the only leaf, which is taken away.
    pub(super) fn take_leaf(&mut self) -> Option<LeafHead> {
        let head = self.leaves.first().and_then(|head| LeafHead::from_byte(*head as u8));
        self.leaves.clear();
        head
    }

    /// Makes room for the words of a node's children; returns where.
    pub(super) fn record(&mut self) -> usize {
        self.counts.inner += 1;
        self.words.extend([0; 8]);
        self.words.len() - 8
    }

    /// Tells the word of a child.
    pub(super) fn set(&mut self, record: usize, child: usize, word: u32) {
        self.words[record + child] = word;
    }

    /// The word of a node of which all children are VOID, or all FULL, and no exact face is near: it has none then.
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

    /// The word of a node whose children are complete; it is cut off into a segment if it has become large.
    pub(super) fn complete(&mut self, code: Code, mark: Mark, record: usize) -> u32 {
        // Invariant: what stands behind a node's mark is below that node, complete, and without what was cut
        // off. Nodes are made in preorder and completed after their children, also those that another thread
        // has made, which are appended in order. So which subtrees are cut off follows from the tree alone,
        // and places move by the mark alone when they are.
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
        let mut places = vec![0; self.leaves.len() - mark.leaves];
        let mut at = mark.leaves;
        let (mut own, mut near) = (Vec::new(), Vec::new());
        while at < self.leaves.len() {
            let head = self.leaves[at];
            places[at - mark.leaves] = leaves.len() as u32;
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
            state @ (LEAF | NEAR_VOID | NEAR_FULL) => places[(word >> 3) as usize - mark.leaves] << 3 | state,
            _ => word,
        };
        let mut words = vec![moved(word)];
        words.extend(self.words[mark.words..].iter().map(|word| moved(*word)));
        self.segments.push((code, encode(&faces.list, &exact.list, &words, &leaves)));
        self.words.truncate(mark.words);
        self.leaves.truncate(mark.leaves);
    }

    /// Takes over what another arena has, which has one node; returns its word here.
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

/// Numbers of faces in a segment, in the order in which they come first.
#[derive(Default)]
struct OwnNumbers {
    numbers: HashMap<u32, u32, Hasher>,
    list: Vec<u32>,
}

impl OwnNumbers {
    /// The own numbers of some faces, ascending.
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
