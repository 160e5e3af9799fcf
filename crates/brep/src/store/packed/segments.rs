//! Packing of octree segments in columns: states in preorder, in the context of earlier siblings'
//! states, and the contents of leaves.

use spinney_packing::Columns;

use super::super::segment::{
    CUT, FULL, HEAD, INNER, LEAF, NEAR, NEAR_FULL, NEAR_VOID, VOID, encode, push_list, take_list,
};
use super::lists::{Cell, FaceLists};
use super::{lists, words::Words};

/// Number of sibling states, including a missing sibling.
const NEIGHBOURS: usize = 6;
const NONE: usize = 5;
/// Maximum number of levels below the segment's root, more than octrees have.
const MAX_LEVELS: u32 = 20;

/// Contexts of bits and of numbers.
mod contexts {
    use super::{NEIGHBOURS, lists};

    /// By the states of the earlier siblings across the walls along x, y and z.
    pub(super) const STATE: usize = 0;
    /// By the number of the leaf's faces.
    pub(super) const KIND: usize = STATE + NEIGHBOURS.pow(3) * 8;
    /// By kind, and number of faces.
    pub(super) const RULE: usize = KIND + 8 * 4;
    /// By whether these siblings are VOID or FULL, and the flag of the previous leaf.
    pub(super) const INSIDE: usize = RULE + 4 * 4 * 4;
    pub(super) const NEAR: usize = INSIDE + 3 * 3 * 3 * 2;
    /// For both kinds of faces.
    pub(super) const LISTS: usize = NEAR + 1;
    pub(super) const BITS: usize = LISTS + 2 * lists::CONTEXTS.0;
    pub(super) const NUMBERS: usize = 2 * lists::CONTEXTS.1;
}

/// Contexts of bits and of numbers.
pub(super) const CONTEXTS: (usize, usize) = (contexts::BITS, contexts::NUMBERS);

/// State of the coding of a segment.
pub(super) struct Segment<'p> {
    /// On-grid faces, and faces with off-grid vertices.
    faces: [FaceLists; 2],
    words: Vec<u32>,
    leaves: Vec<u8>,
    /// Total bytes of the leaves.
    leaf_bytes: usize,
    /// Index of the next record.
    next: usize,
    /// Whether the minimum corner of the previous leaf is inside.
    was_inside: bool,
    /// Remaining leaves of the writer's input.
    given: &'p [u8],
}

impl<'p> Segment<'p> {
    /// Codes a segment of `length` bytes; writes that of `plain`. Returns `None` if the segment is
    /// invalid.
    pub(super) fn code(columns: &mut Columns<'_>, length: usize, plain: &'p [u8]) -> Option<Vec<u8>> {
        let mut words = Words(plain);
        let counts = [0; 4].map(|_| columns.number(words.word().into()) as u32 as usize);
        let [faces, exact, nodes, leaf_bytes] = counts;
        let bytes = HEAD as u64
            + 4 * [faces, exact, nodes].map(|count| count as u64).iter().sum::<u64>()
            + leaf_bytes as u64;
        // Invariant: the lists take exactly the segment's bytes, so no list is larger than the
        // segment. Otherwise, an untrusted header could request any amount of memory.
        if bytes != length as u64 || nodes == 0 {
            return None;
        }
        let of_kind = |kind, count, words: &mut Words<'_>| {
            let (bits, numbers) = lists::CONTEXTS;
            let numbers_of_faces = (0..count).map(|_| words.word()).collect();
            FaceLists::new(contexts::LISTS + kind * bits, kind * numbers, numbers_of_faces)
        };
        let mut segment = Segment {
            faces: [of_kind(0, faces, &mut words), of_kind(1, exact, &mut words)],
            words: (0..nodes).map(|_| words.word()).collect(),
            leaves: Vec::new(),
            leaf_bytes,
            next: 1,
            was_inside: false,
            given: words.0,
        };
        segment.nodes(columns)?;
        let [faces, exact] = &segment.faces;
        Some(encode(&faces.numbers, &exact.numbers, &segment.words, &segment.leaves))
    }

    /// Codes all nodes, in preorder.
    fn nodes(&mut self, columns: &mut Columns<'_>) -> Option<()> {
        let cell = Cell { at: [0; 3], width: 1 << MAX_LEVELS };
        self.node(columns, 0, &cell, [NONE; 3])?;
        let mut path = Vec::new();
        let record = |word: u32, cell: Cell| (word & 7 == INNER).then_some(((word >> 3) as usize, 0, cell));
        path.extend(record(self.words[0], cell));
        while let Some((first, child, cell)) = path.last_mut() {
            if *child == 8 {
                path.pop();
                continue;
            }
            let (word, place) = (*first + *child, *child);
            *child += 1;
            let width = cell.width / 2;
            if width == 0 {
                return None;
            }
            let at = [0, 1, 2].map(|axis| cell.at[axis] + (place >> axis & 1) as u32 * width);
            let cell = Cell { at, width };
            let siblings = [1, 2, 4].map(|axis| match place & axis {
                0 => NONE,
                _ => match self.words[word - axis] & 7 {
                    NEAR_VOID => VOID as usize,
                    NEAR_FULL => FULL as usize,
                    state => state as usize,
                },
            });
            self.node(columns, word, &cell, siblings)?;
            path.extend(record(self.words[word], cell));
        }
        (self.next == self.words.len() && self.leaves.len() == self.leaf_bytes).then_some(())
    }

    /// Codes a node, and its lists.
    fn node(
        &mut self,
        columns: &mut Columns<'_>,
        word: usize,
        cell: &Cell,
        siblings: [usize; 3],
    ) -> Option<()> {
        let context = siblings.iter().fold(0, |context, state| NEIGHBOURS * context + state);
        let state = (self.words[word] & 7) as usize;
        let state = columns.bits(contexts::STATE + 8 * context, 3, state) as u32;
        let at = match state {
            VOID | FULL | CUT => 0,
            INNER => self.next,
            LEAF | NEAR_VOID | NEAR_FULL => self.leaves.len(),
            _ => return None,
        };
        self.words[word] = (at as u32) << 3 | state;
        match state {
            INNER => {
                self.next += 8;
                (self.next <= self.words.len()).then_some(())
            }
            LEAF => self.leaf(columns, cell, siblings),
            NEAR_VOID | NEAR_FULL => self.list(columns, 1, cell).map(drop),
            _ => Some(()),
        }
    }

    fn leaf(&mut self, columns: &mut Columns<'_>, cell: &Cell, siblings: [usize; 3]) -> Option<()> {
        let given = usize::from(self.given.split_off_first().copied().unwrap_or(0));
        let place = self.leaves.len();
        self.leaves.push(0);
        let count = self.list(columns, 0, cell)?;
        let kind = columns.bits(contexts::KIND + 4 * count.min(7), 2, given & 3);
        let rule = columns.bits(contexts::RULE + 4 * (4 * kind + count.min(3)), 2, given >> 2 & 3);
        let of_sibling = |state: &usize| match *state as u32 {
            VOID => 0,
            FULL => 1,
            _ => 2,
        };
        let context = siblings.iter().map(of_sibling).fold(0, |context, state| 3 * context + state);
        let context = contexts::INSIDE + 2 * context + usize::from(self.was_inside);
        self.was_inside = columns.bit(context, given >> 4 & 1 == 1);
        let mut head = (kind | rule << 2) as u8 | u8::from(self.was_inside) << 4;
        if !self.faces[1].numbers.is_empty() && columns.bit(contexts::NEAR, given as u8 & NEAR != 0) {
            head |= NEAR;
            self.list(columns, 1, cell)?;
        }
        self.leaves[place] = head;
        Some(())
    }

    /// Codes a list of faces of one kind; returns its length.
    fn list(&mut self, columns: &mut Columns<'_>, kind: usize, cell: &Cell) -> Option<usize> {
        // (A reader has no input; the decoded list is the result.)
        let given = if self.given.is_empty() { Vec::new() } else { take_list(&mut self.given)? };
        let leaf_bytes = self.leaf_bytes.checked_sub(self.leaves.len())?;
        let list = self.faces[kind].code(columns, cell, &given, leaf_bytes)?;
        push_list(&mut self.leaves, &list);
        (self.leaves.len() <= self.leaf_bytes).then_some(list.len())
    }
}
