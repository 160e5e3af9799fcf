//! Segments of a model's octree: nodes, and the faces that cut the leaves.

use spinney_base::io::FileBytes;
use spinney_base::sort;

/// States of a node: the low three bits of its word.
pub(crate) const VOID: u32 = 0;
pub(crate) const FULL: u32 = 1;
/// The word's upper bits are the index of the eight children's words.
pub(crate) const INNER: u32 = 2;
/// In another segment.
pub(crate) const CUT: u32 = 3;
/// The word's upper bits are the leaf's offset in the bytes of leaves.
pub(crate) const LEAF: u32 = 4;
/// VOID and FULL cells near faces with off-grid vertices; the word's upper bits are the offset of
/// the list of these faces in the bytes of leaves.
pub(crate) const NEAR_VOID: u32 = 5;
pub(crate) const NEAR_FULL: u32 = 6;

/// Bytes of a segment's header.
pub(super) const HEAD: usize = 16;

/// Bit of a leaf's first byte: a list of near faces with off-grid vertices follows the list of its
/// faces.
pub(super) const NEAR: u8 = 32;

/// Kind of a cell that faces cut, by what their planes share. The shared line or point may be
/// outside of the cell, or at infinity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum NodeKind {
    /// All faces are in one plane.
    Face,
    /// All planes share a line: two planes, or more around an edge.
    Edge,
    /// All planes share a point: three, or more around a vertex.
    Vertex,
    /// The planes share nothing; the cell has few faces, is at the deepest level, or division would
    /// not separate its faces.
    Boolean,
}

/// Expression of the planes of a cell that defines the inside of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LeafRule {
    /// The inside is the intersection of the half-spaces on the inner side of all planes.
    All,
    /// The inside is the union of the half-spaces on the inner side of any plane.
    Any,
    /// Each face that is crossed on a path from the cell's minimum corner switches between inside
    /// and outside.
    Crossings,
}

/// Head of a leaf.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LeafHead {
    pub kind: NodeKind,
    pub rule: LeafRule,
    /// Whether the cell's minimum corner is inside, perturbed along x, much less along y, and still
    /// less along z.
    pub inside: bool,
}

impl LeafHead {
    pub(crate) fn to_byte(self) -> u8 {
        self.kind as u8 | (self.rule as u8) << 2 | u8::from(self.inside) << 4
    }

    pub(crate) fn from_byte(byte: u8) -> Option<LeafHead> {
        let kind =
            [NodeKind::Face, NodeKind::Edge, NodeKind::Vertex, NodeKind::Boolean][usize::from(byte & 3)];
        let rule = *[LeafRule::All, LeafRule::Any, LeafRule::Crossings].get(usize::from(byte >> 2 & 3))?;
        (byte >> 6 == 0).then_some(LeafHead { kind, rule, inside: byte >> 4 & 1 == 1 })
    }
}

/// Appends a number in groups of seven bits, the low ones first (LEB128).
pub(super) fn push_number(bytes: &mut Vec<u8>, mut number: u32) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

/// Decodes such a number, and advances.
#[inline]
pub(super) fn take_number(bytes: &mut &[u8]) -> Option<u32> {
    let mut number = 0;
    for shift in (0..32).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        number |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return u32::try_from(number).ok();
        }
    }
    None
}

/// Encodes a segment from its faces, its faces with off-grid vertices, its words and its leaves.
pub(crate) fn encode(faces: &[u32], exact: &[u32], words: &[u32], leaves: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEAD + 4 * (faces.len() + exact.len() + words.len()) + leaves.len());
    for count in [faces.len(), exact.len(), words.len(), leaves.len()] {
        bytes.extend_from_slice(&(count as u32).to_le_bytes());
    }
    for word in faces.iter().chain(exact).chain(words) {
        bytes.extend_from_slice(&word.to_le_bytes());
    }
    bytes.extend_from_slice(leaves);
    bytes
}

/// Appends a leaf: its head in the encoding of [`LeafHead::to_byte`], the numbers of its faces
/// within the segment, ascending, and those of near faces with off-grid vertices.
pub(crate) fn push_leaf(leaves: &mut Vec<u8>, head: u8, faces: &[u32], near: &[u32]) {
    leaves.push(if near.is_empty() { head } else { head | NEAR });
    push_list(leaves, faces);
    if !near.is_empty() {
        push_list(leaves, near);
    }
}

/// Appends a count, and ascending numbers.
pub(crate) fn push_list(leaves: &mut Vec<u8>, numbers: &[u32]) {
    push_number(leaves, numbers.len() as u32);
    let mut next = 0;
    for &number in numbers {
        push_number(leaves, number - next);
        next = number + 1;
    }
}

/// Decodes such a list, and advances; returns `None` if it is truncated.
pub(crate) fn take_list(bytes: &mut &[u8]) -> Option<Vec<u32>> {
    let count = take_number(bytes)? as usize;
    // (Each number takes at least one byte.)
    let mut numbers = Vec::with_capacity(count.min(bytes.len()));
    let mut next = 0u32;
    for _ in 0..count {
        let number = next.checked_add(take_number(bytes)?)?;
        numbers.push(number);
        next = number.checked_add(1)?;
    }
    Some(numbers)
}

/// Checks such a list and advances: it must not be empty, and numbers must be below `bound`. Errors
/// describe the flaw.
fn check_list(bytes: &mut &[u8], bound: usize) -> Result<(), String> {
    let breaks_off = || "a truncated list of faces".to_string();
    let count = take_number(bytes).ok_or_else(breaks_off)?;
    if count == 0 {
        return Err("a leaf without faces".into());
    }
    let mut next = 0u64;
    for _ in 0..count {
        let number = next + u64::from(take_number(bytes).ok_or_else(breaks_off)?);
        if number >= bound as u64 {
            return Err(format!("face {number} of the segment's {bound}"));
        }
        next = number + 1;
    }
    Ok(())
}

/// A segment of a file.
#[derive(Clone)]
pub(crate) struct ModelSegment<'a> {
    bytes: FileBytes<'a>,
    faces: usize,
    exact: usize,
    words: usize,
}

impl<'a> ModelSegment<'a> {
    /// Wraps a segment; returns `None` if its lists do not fit its bytes.
    pub(crate) fn new(bytes: FileBytes<'a>) -> Option<ModelSegment<'a>> {
        let count = |at: usize| {
            bytes
                .get(at..at + 4)
                .map(|four| u32::from_le_bytes(four.try_into().expect("four bytes")) as usize)
        };
        let (faces, exact, words, leaves) = (count(0)?, count(4)?, count(8)?, count(12)?);
        let fits = HEAD + 4 * (faces + exact + words) + leaves == bytes.len();
        fits.then_some(ModelSegment { bytes, faces, exact, words })
    }

    #[inline]
    fn number(&self, at: usize) -> u32 {
        self.bytes.get(at..at + 4).map_or(0, |four| u32::from_le_bytes(four.try_into().expect("four bytes")))
    }

    /// Returns the number in the model of the segment's face `local`.
    #[inline]
    pub(crate) fn face(&self, local: u32) -> u32 {
        self.number(HEAD + 4 * local as usize)
    }

    /// Returns the number in the model of the segment's face `local` with off-grid vertices.
    fn exact_face(&self, local: u32) -> u32 {
        self.number(HEAD + 4 * (self.faces + local as usize))
    }

    /// Returns the segment's bytes with other numbers of its faces and of its faces with off-grid
    /// vertices; `None` if one of them has none. The order of the numbers must be the same.
    pub(crate) fn renumbered(
        &self,
        face: &dyn Fn(u32) -> Option<u32>,
        exact: &dyn Fn(u32) -> Option<u32>,
    ) -> Option<Vec<u8>> {
        let mut bytes = self.bytes.to_vec();
        let numbers = bytes.get_mut(HEAD..HEAD + 4 * (self.faces + self.exact))?;
        for (index, four) in numbers.chunks_exact_mut(4).enumerate() {
            let number = u32::from_le_bytes(four.try_into().expect("four bytes"));
            let number = if index < self.faces { face(number)? } else { exact(number)? };
            four.copy_from_slice(&number.to_le_bytes());
        }
        Some(bytes)
    }

    /// Returns the word of a node.
    #[inline]
    pub(crate) fn word(&self, at: u32) -> u32 {
        self.number(HEAD + 4 * (self.faces + self.exact + at as usize))
    }

    /// Returns the number of words, and that of bytes.
    pub(crate) fn size(&self) -> (u32, usize) {
        (self.words as u32, self.bytes.len())
    }

    /// Returns the word of a child of an INNER node.
    #[inline]
    pub(crate) fn child(&self, word: u32, child: usize) -> u32 {
        self.word((word >> 3) + child as u32)
    }

    fn leaves(&self) -> &[u8] {
        self.bytes.get(HEAD + 4 * (self.faces + self.exact + self.words)..).unwrap_or_default()
    }

    /// Returns the head of a LEAF, and the numbers of its faces in the model. The leaf exists if
    /// the segment was checked.
    #[inline]
    pub(crate) fn leaf(&self, word: u32) -> (LeafHead, LeafFaces<'_>) {
        let none = (LeafHead { kind: NodeKind::Boolean, rule: LeafRule::Crossings, inside: false }, 0);
        let mut bytes = self.leaves().get((word >> 3) as usize..).unwrap_or_default();
        let head = bytes.split_first().and_then(|(first, rest)| {
            bytes = rest;
            Some((LeafHead::from_byte(*first)?, take_number(&mut bytes)?))
        });
        let (head, left) = head.unwrap_or(none);
        (head, LeafFaces { segment: self, bytes, left, next: 0 })
    }

    /// Returns the numbers in the model of faces with off-grid vertices near the cell of a node
    /// without children.
    pub(crate) fn near(&self, word: u32) -> Vec<u32> {
        let mut bytes = self.leaves().get((word >> 3) as usize..).unwrap_or_default();
        let has_list = match word & 7 {
            NEAR_VOID | NEAR_FULL => true,
            LEAF => {
                let head = bytes.split_off_first().copied().unwrap_or(0);
                let faces = take_number(&mut bytes).unwrap_or(0);
                head & NEAR != 0 && (0..faces).all(|_| take_number(&mut bytes).is_some())
            }
            _ => false,
        };
        let count = if has_list { take_number(&mut bytes).unwrap_or(0) } else { 0 };
        let mut next = 0u32;
        let numbers = (0..count).map_while(|_| {
            let local = next.checked_add(take_number(&mut bytes)?)?;
            next = local.wrapping_add(1);
            Some(self.exact_face(local))
        });
        numbers.collect()
    }

    /// Checks a segment of an untrusted file, for a model with these counts of faces and of faces
    /// with off-grid vertices. Calls `visit` for each node with its level below the segment's root
    /// and its word. Errors describe the flaw.
    pub(crate) fn check(
        &self,
        [faces, exact]: [u64; 2],
        visit: &mut dyn FnMut(u8, u32),
    ) -> Result<(), String> {
        if self.words == 0 {
            return Err("no nodes".into());
        }
        // Each face at most once, which limits the work per leaf by the face count.
        let on_grid = (0..self.faces as u32).map(|local| self.face(local)).collect();
        let exact_faces = (0..self.exact as u32).map(|local| self.exact_face(local)).collect();
        let check = |mut numbers: Vec<u32>, name: &str, count: u64| {
            sort::numbers32(&mut numbers);
            if let Some(pair) = numbers.windows(2).find(|pair| pair[0] == pair[1]) {
                return Err(format!("{name} {} twice", pair[0]));
            }
            match numbers.last().filter(|face| u64::from(**face) >= count) {
                Some(face) => Err(format!("{name} {face} of {count}")),
                None => Ok(()),
            }
        };
        check(on_grid, "face", faces)?;
        check(exact_faces, "exact face", exact)?;
        // Records are in preorder without gaps: each is visited once, and the traversal terminates.
        let mut next_record = 1;
        let mut next_leaf = 0;
        let mut path = vec![(self.word(0), 8u32, 0u32)];
        self.check_node(self.word(0), &mut next_record, &mut next_leaf)?;
        visit(0, self.word(0));
        if self.word(0) & 7 != INNER {
            path.clear();
        } else {
            path[0] = (self.word(0) >> 3, 0, 0);
        }
        while let Some((record, child, _)) = path.last_mut() {
            if *child == 8 {
                path.pop();
                continue;
            }
            let word = self.word(*record + *child);
            *child += 1;
            self.check_node(word, &mut next_record, &mut next_leaf)?;
            visit(path.len() as u8, word);
            if word & 7 == INNER {
                if path.len() > 32 {
                    return Err("nodes below the deepest level".into());
                }
                path.push((word >> 3, 0, 0));
            }
        }
        let (words, leaves) = (self.words as u32, self.leaves().len());
        if (next_record, next_leaf) != (words, leaves) {
            return Err(format!(
                "nodes of {next_record} words and {next_leaf} bytes in {words} and {leaves}"
            ));
        }
        Ok(())
    }

    fn check_node(&self, word: u32, next_record: &mut u32, next_leaf: &mut usize) -> Result<(), String> {
        let at = word >> 3;
        match word & 7 {
            VOID | FULL | CUT if at == 0 => Ok(()),
            INNER if at == *next_record && (at as usize) + 8 <= self.words => {
                *next_record += 8;
                Ok(())
            }
            LEAF if at as usize == *next_leaf => {
                let leaves = self.leaves();
                let mut bytes = leaves.get(at as usize..).unwrap_or_default();
                let wrong = || format!("a truncated leaf at {at}");
                let head = bytes.split_off_first().copied().ok_or_else(wrong)?;
                LeafHead::from_byte(head).ok_or_else(wrong)?;
                check_list(&mut bytes, self.faces)?;
                if head & NEAR != 0 {
                    check_list(&mut bytes, self.exact)?;
                }
                *next_leaf = leaves.len() - bytes.len();
                Ok(())
            }
            NEAR_VOID | NEAR_FULL if at as usize == *next_leaf => {
                let leaves = self.leaves();
                let mut bytes = leaves.get(at as usize..).unwrap_or_default();
                check_list(&mut bytes, self.exact)?;
                *next_leaf = leaves.len() - bytes.len();
                Ok(())
            }
            _ => Err(format!("a node {word:08x}")),
        }
    }
}

/// Numbers of a leaf's faces in the model.
#[derive(Clone)]
pub(crate) struct LeafFaces<'s> {
    segment: &'s ModelSegment<'s>,
    bytes: &'s [u8],
    left: u32,
    next: u32,
}

impl Iterator for LeafFaces<'_> {
    type Item = u64;

    #[inline]
    fn next(&mut self) -> Option<u64> {
        self.left = self.left.checked_sub(1)?;
        let local = self.next.checked_add(take_number(&mut self.bytes)?)?;
        self.next = local.wrapping_add(1);
        Some(self.segment.face(local).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaves_come_back() {
        let head = LeafHead { kind: NodeKind::Vertex, rule: LeafRule::Any, inside: true };
        let mut leaves = Vec::new();
        push_leaf(&mut leaves, head.to_byte(), &[0, 1, 200], &[]);
        let second = leaves.len() as u32;
        push_leaf(&mut leaves, LeafHead { rule: LeafRule::Crossings, ..head }.to_byte(), &[7], &[0, 2]);
        let third = leaves.len() as u32;
        push_list(&mut leaves, &[1]);
        let faces: Vec<u32> = (1000..1201).collect();
        let mut words = vec![
            1 << 3 | INNER,
            LEAF,
            second << 3 | LEAF,
            FULL,
            third << 3 | NEAR_VOID,
            CUT,
            VOID,
            VOID,
            VOID,
        ];
        let exact = [77, 5, 30];
        let bytes = encode(&faces, &exact, &words, &leaves);
        let segment = ModelSegment::new(FileBytes::Mapped(&bytes)).unwrap();
        let mut seen = Vec::new();
        segment.check([1201, 78], &mut |level, word| seen.push((level, word & 7))).unwrap();
        assert_eq!(seen[..4], [(0, INNER), (1, LEAF), (1, LEAF), (1, FULL)]);
        let (found, list) = segment.leaf(segment.child(segment.word(0), 0));
        assert_eq!((found, list.collect::<Vec<_>>()), (head, vec![1000, 1001, 1200]));
        let near = |child| segment.near(segment.child(segment.word(0), child));
        assert_eq!([0, 1, 2, 3].map(near), [vec![], vec![77, 30], vec![], vec![5]]);
        assert!(segment.check([1200, 78], &mut |_, _| ()).is_err(), "a face that does not exist");
        assert!(segment.check([1201, 77], &mut |_, _| ()).is_err(), "an exact face that does not exist");
        words[3] = 1 << 3 | INNER;
        let bytes = encode(&faces, &exact, &words, &leaves);
        let segment = ModelSegment::new(FileBytes::Mapped(&bytes)).unwrap();
        assert!(segment.check([1201, 78], &mut |_, _| ()).is_err(), "a node below itself");
    }
}
