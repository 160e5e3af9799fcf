//! Cache of a model's octree, blocks and faces, decoded for many lines.
//!
//! Nodes of all segments that were visited form a single octree in memory, in which a line needs
//! no lookup. Leaves are decoded when a line first visits them: their triangles are copied to
//! groups of [`LANES`], which are tested at once.

use super::line::{Crossing, LANES, Line, Triangles};
use super::plane::Plane;
use super::ray::Hit;
use crate::store::block::Block;
use crate::store::segment::{CUT, INNER, LEAF, ModelSegment};
use crate::{ExactModel, Face, FaceBuffer, Faces};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Result};
use std::collections::BTreeSet;
use std::ops::Range;

/// Maximum number of vertices of a cached face; larger faces are read again.
const MAX_CORNERS: usize = 64;
/// Usual number of faces in a block.
const FACES_OF_BLOCK: u64 = 1 << 10;
/// Maximum bytes of decoded nodes and leaves when a line begins.
const MAX_BYTES: usize = 64 << 20;
/// Bits of the offset of a leaf in the bytes of its segment's leaves.
const OFFSET_BITS: u32 = 29;

/// Node of the decoded octree.
#[derive(Clone, Copy, Debug)]
pub(super) enum Node {
    /// No faces cut it.
    Empty,
    /// Index of the first of its eight children, and a bit for each child that is not empty.
    Inner(usize, u8),
    /// Index of its leaf.
    Leaf(usize),
}

/// Faces of a decoded leaf, as ranges in lists of the cache.
struct Leaf {
    groups: Range<usize>,
    others: Range<usize>,
}

/// Up to [`LANES`] triangles.
struct Group {
    corners: Triangles,
    numbers: [u32; LANES],
    /// A bit for each triangle.
    present: u8,
}

/// Cache of a model's octree, blocks and faces. The caches of blocks and faces are direct-mapped:
/// each has one slot per number modulo the slot count, a power of two.
///
/// Results do not depend on the cache: its entries are those of the file, and were checked on first
/// use.
pub(super) struct ModelCache<'a> {
    model: &'a ExactModel,
    /// The parts whose faces leaves have; `None` for all.
    parts: Option<&'a BTreeSet<u32>>,
    blocks: Vec<Option<Block<'a>>>,
    /// Faces that are not triangles.
    faces: Vec<SeenFace>,
    /// A face with too many vertices for the cache.
    large: SeenFace,
    /// Number of the current line.
    line: u64,
    /// Nodes: states of [`segment`](crate::store::segment) in the low three bits, then the index of
    /// the children or of the decoded leaf, then eight bits for the children that are not empty. A
    /// leaf that is not decoded has the state [`UNREAD`].
    words: Vec<u64>,
    segments: Vec<ModelSegment<'a>>,
    leaves: Vec<Leaf>,
    groups: Vec<Group>,
    /// Numbers of faces that are not in blocks of triangles.
    others: Vec<u32>,
    /// Bytes of the segments.
    bytes: usize,
}

/// State of a leaf that is not decoded. The upper bits are the index of its segment and its offset.
const UNREAD: u64 = 7;

/// A face that was read.
pub(super) struct SeenFace {
    /// Its number; `None` if the slot is empty.
    number: Option<u64>,
    /// Number of the last line that was tested against it.
    line: u64,
    pub(super) buffer: FaceBuffer,
    pub(super) plane: Plane,
}

impl SeenFace {
    fn none() -> SeenFace {
        SeenFace {
            number: None,
            line: 0,
            buffer: FaceBuffer::default(),
            plane: Plane { normal: [0; 3], through: [0; 3] },
        }
    }
}

impl<'a> ModelCache<'a> {
    /// Creates a cache of `most` blocks and faces, each, a power of two.
    pub(super) fn new(model: &'a ExactModel, most: usize) -> ModelCache<'a> {
        ModelCache {
            model,
            parts: None,
            blocks: (0..most).map(|_| None).collect(),
            faces: (0..most).map(|_| SeenFace::none()).collect(),
            large: SeenFace::none(),
            line: 0,
            words: Vec::new(),
            segments: Vec::new(),
            leaves: Vec::new(),
            groups: Vec::new(),
            others: Vec::new(),
            bytes: 0,
        }
    }

    /// Creates a cache of some parts of a model.
    pub(super) fn of_parts(model: &'a ExactModel, most: usize, parts: &'a BTreeSet<u32>) -> ModelCache<'a> {
        ModelCache { parts: Some(parts), ..ModelCache::new(model, most) }
    }

    pub(super) fn model(&self) -> &'a ExactModel {
        self.model
    }

    /// Begins a line: returns the index of the root. Drops the decoded nodes if they are too many;
    /// indices of nodes are valid until the next line begins.
    pub(super) fn begin(&mut self) -> usize {
        self.line += 1;
        let bytes = self.bytes
            + size_of_val(&*self.words)
            + size_of_val(&*self.leaves)
            + size_of_val(&*self.groups)
            + size_of_val(&*self.others);
        if bytes > MAX_BYTES {
            self.words.clear();
            self.segments.clear();
            self.leaves.clear();
            self.groups.clear();
            self.others.clear();
            self.bytes = 0;
        }
        if self.words.is_empty() {
            self.words.push(CUT.into());
        }
        0
    }

    /// Returns a node, given its level and its position among the cells of its level.
    #[inline]
    pub(super) fn node(&mut self, node: usize, level: u8, position: impl Fn() -> [u32; 3]) -> Result<Node> {
        let mut word = self.words.get(node).copied().unwrap_or(0);
        if word == u64::from(CUT) {
            word = self.load(node, level, position())?;
        }
        if word & 7 == UNREAD {
            word = self.decode(node, word)?;
        }
        let index = (word << 8 >> 11) as usize;
        Ok(match word as u32 & 7 {
            INNER => Node::Inner(index, (word >> 56) as u8),
            LEAF => Node::Leaf(index),
            _ => Node::Empty,
        })
    }

    /// Appends the nodes of a node's segment, and returns the node's word.
    #[cold]
    fn load(&mut self, node: usize, level: u8, position: [u32; 3]) -> Result<u64> {
        let code = Code::from_cell(Dimension::Oct, level, position).ok_or_else(|| {
            let found = format!("a CUT node at level {level}");
            Error::corrupt(self.model.path(), "segment", found, "none there")
        })?;
        let segment = self.model.segment_of(code)?;
        let (first, number) = (self.words.len() as u64, self.segments.len() as u64);
        let (count, bytes) = segment.size();
        self.words.extend((0..count).map(|at| {
            let word = segment.word(at);
            let index = u64::from(word >> 3);
            match word & 7 {
                INNER => {
                    let is_empty = |child| !matches!(segment.child(word, child) & 7, INNER | LEAF | CUT);
                    let present = (0..8).map(|child| u64::from(!is_empty(child)) << child).sum::<u64>();
                    present << 56 | (first + index) << 3 | u64::from(INNER)
                }
                LEAF => (number << OFFSET_BITS | index) << 3 | UNREAD,
                CUT => CUT.into(),
                _ => 0,
            }
        }));
        self.segments.push(segment);
        self.bytes += bytes;
        // (The root of a segment is not CUT: that was checked.)
        self.words[node] = self.words.get(first as usize).copied().unwrap_or(0);
        Ok(self.words[node])
    }

    /// Decodes a leaf, and returns its new word.
    #[cold]
    fn decode(&mut self, node: usize, word: u64) -> Result<u64> {
        let (segment, offset) = (word >> 3 >> OFFSET_BITS, word >> 3 & ((1 << OFFSET_BITS) - 1));
        let segment = self.segments[segment as usize].clone();
        let (groups, others) = (self.groups.len(), self.others.len());
        let (mut lane, parts) = (LANES, self.parts);
        for number in segment.leaf((offset as u32) << 3 | LEAF).1 {
            // (Invariant: an error leaves the leaf undecoded. What was appended is not used.)
            let (block, index) = self.block(number)?;
            if parts.is_some_and(|parts| !parts.contains(&block.part(index))) {
                continue;
            }
            let Some(triangle) = block.triangle(index) else {
                self.others.push(number as u32);
                continue;
            };
            if lane == LANES {
                lane = 0;
                self.groups.push(Group { corners: Default::default(), numbers: [0; LANES], present: 0 });
            }
            let group = self.groups.last_mut().expect("just pushed");
            for (corner, axis) in (0..9).map(|at| (at / 3, at % 3)) {
                group.corners[corner][axis][lane] = triangle[corner][axis];
            }
            group.numbers[lane] = number as u32;
            group.present |= 1 << lane;
            lane += 1;
        }
        let leaf = Leaf { groups: groups..self.groups.len(), others: others..self.others.len() };
        self.words[node] = (self.leaves.len() as u64) << 3 | u64::from(LEAF);
        self.leaves.push(leaf);
        Ok(self.words[node])
    }

    /// Passes the crossings of a line with the faces of a leaf to `take`, each with the number of
    /// its face. Returns the number of faces that were tested; faces that are not triangles are
    /// usually tested once per line.
    #[inline]
    pub(super) fn crossings(
        &mut self,
        line: &Line,
        leaf: usize,
        take: &mut impl FnMut(u64, Crossing),
    ) -> Result<u64> {
        let Leaf { groups, others } = &self.leaves[leaf];
        let (others, mut tested) = (others.clone(), 0);
        for group in &self.groups[groups.clone()] {
            tested += u64::from(group.present.count_ones());
            let sides = line.sides(&group.corners);
            let mut left = group.present & !sides.missed;
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                let triangle = group.corners.map(|corner| corner.map(|along| along[lane]));
                if let Some(crossing) = line.crossing_of_triangle(&triangle, sides.around >> lane & 1 == 1) {
                    take(group.numbers[lane].into(), crossing);
                }
            }
        }
        for at in others {
            let (number, current) = (self.others[at].into(), self.line);
            let seen = self.seen(number)?;
            if std::mem::replace(&mut seen.line, current) == current {
                continue;
            }
            tested += 1;
            if let Some(crossing) = line.crossing_of(&seen.buffer.face(), &seen.plane) {
                take(number, crossing);
            }
        }
        Ok(tested)
    }

    /// Returns the block of a face, and the face's index in it.
    #[inline]
    fn block(&mut self, number: u64) -> Result<(&Block<'a>, usize)> {
        let slot = (number / FACES_OF_BLOCK) as usize & (self.blocks.len() - 1);
        let index = self.blocks[slot].as_ref().and_then(|block| block.index(number));
        match (index, &mut self.blocks[slot]) {
            (Some(index), Some(block)) => Ok((block, index)),
            (_, slot) => {
                let (block, index) = self.model.block_of(number)?;
                Ok((slot.insert(block), index))
            }
        }
    }

    /// Returns the hit of a crossing of a face.
    pub(super) fn hit(&mut self, line: &Line, face: u64, crossing: Crossing) -> Result<Hit> {
        let Crossing { share, is_entry } = crossing;
        let point = self.model.grid().to_world_between(line.at(share));
        let (block, index) = self.block(face)?;
        Ok(Hit { share, point, is_entry, face, part: block.part(index) })
    }

    /// Returns a face of the model, and its outward normal on the grid.
    pub(super) fn face(&mut self, number: u64) -> Result<(Face<'_>, [i64; 3])> {
        let seen = self.seen(number)?;
        Ok((seen.buffer.face(), seen.plane.normal))
    }

    /// Returns a face of the model, with its plane.
    fn seen(&mut self, number: u64) -> Result<&mut SeenFace> {
        let ModelCache { model, faces, large, .. } = self;
        let slot = number as usize & (faces.len() - 1);
        if faces[slot].number == Some(number) {
            return Ok(&mut faces[slot]);
        }
        if large.number == Some(number) {
            return Ok(large);
        }
        // Invariant: a slot with a number has the complete face and its plane; an error leaves the
        // slot empty, since a later query would otherwise use mixed data.
        large.number = None;
        model.face(number, &mut large.buffer)?;
        large.plane = Plane::of(&large.buffer.face());
        (large.number, large.line) = (Some(number), 0);
        if large.buffer.points.len() > MAX_CORNERS {
            return Ok(large);
        }
        std::mem::swap(&mut faces[slot], large);
        Ok(&mut faces[slot])
    }
}
