//! Cache of a model's blocks, segments and faces, for many similar queries.

use super::line::{Crossing, Line};
use super::plane::Plane;
use super::ray::Hit;
use crate::store::block::Block;
use crate::store::segment::ModelSegment;
use crate::{ExactModel, Face, FaceBuffer, Faces};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Result};

/// Maximum number of vertices of a cached face; larger faces are read again.
const MAX_CORNERS: usize = 64;
/// Usual number of faces in a block.
const FACES_OF_BLOCK: u64 = 1 << 10;

/// Direct-mapped cache of a model's blocks, segments and faces: each kind has one slot per number
/// modulo the slot count, a power of two.
///
/// Results do not depend on the cache: its entries are those of the file, and were checked on first
/// use.
pub(super) struct ModelCache<'a> {
    model: &'a ExactModel,
    blocks: Vec<Option<Block<'a>>>,
    /// Segments by the codes of their nodes.
    segments: Vec<Option<(u64, ModelSegment<'a>)>>,
    /// Faces that are not triangles.
    faces: Vec<SeenFace>,
    /// A face with too many vertices for the cache.
    large: SeenFace,
}

/// A face that was read.
pub(super) struct SeenFace {
    /// Its number; `None` if the slot is empty.
    number: Option<u64>,
    pub(super) buffer: FaceBuffer,
    pub(super) plane: Plane,
}

impl SeenFace {
    fn none() -> SeenFace {
        SeenFace {
            number: None,
            buffer: FaceBuffer::default(),
            plane: Plane { normal: [0; 3], through: [0; 3] },
        }
    }
}

impl<'a> ModelCache<'a> {
    /// Creates a cache of `most` slots per kind, a power of two.
    pub(super) fn new(model: &'a ExactModel, most: usize) -> ModelCache<'a> {
        ModelCache {
            model,
            blocks: (0..most).map(|_| None).collect(),
            segments: (0..most).map(|_| None).collect(),
            faces: (0..most).map(|_| SeenFace::none()).collect(),
            large: SeenFace::none(),
        }
    }

    pub(super) fn model(&self) -> &'a ExactModel {
        self.model
    }

    /// Returns the segment of a node that has one.
    pub(super) fn segment(&mut self, level: u8, position: [u32; 3]) -> Result<ModelSegment<'a>> {
        let code = Code::from_cell(Dimension::Oct, level, position).ok_or_else(|| {
            let found = format!("a CUT node at level {level}");
            Error::corrupt(self.model.path(), "segment", found, "none there")
        })?;
        // (Path bits are at the top of a code. The product's top bits depend on all of them.)
        let bits = code.bits();
        let spread = bits.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let index = ((u128::from(spread) * self.segments.len() as u128) >> 64) as usize;
        match &self.segments[index] {
            Some((known, segment)) if *known == bits => Ok(segment.clone()),
            _ => {
                let segment = self.model.segment_of(code)?;
                self.segments[index] = Some((bits, segment.clone()));
                Ok(segment)
            }
        }
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

    /// Returns the crossing of a line with a face, if there is one.
    #[inline]
    pub(super) fn crossing(&mut self, line: &Line, number: u64) -> Result<Option<Crossing>> {
        let (block, index) = self.block(number)?;
        let Some(corners) = block.triangle(index) else {
            let seen = self.face(number)?;
            return Ok(line.crossing_of(&seen.buffer.face(), &seen.plane));
        };
        if line.misses(&corners) {
            return Ok(None);
        }
        let face = Face { number, points: &corners, ring_ends: &[3], colours: &[], part: 0, source: 0 };
        Ok(line.crossing(&face))
    }

    /// Returns a face of the model, with its plane.
    pub(super) fn face(&mut self, number: u64) -> Result<&SeenFace> {
        let ModelCache { model, faces, large, .. } = self;
        let slot = number as usize & (faces.len() - 1);
        if faces[slot].number == Some(number) {
            return Ok(&faces[slot]);
        }
        // Invariant: a slot with a number has the complete face and its plane; an error leaves the
        // slot empty, since a later query would otherwise use mixed data.
        large.number = None;
        model.face(number, &mut large.buffer)?;
        large.plane = Plane::of(&large.buffer.face());
        large.number = Some(number);
        if large.buffer.points.len() > MAX_CORNERS {
            return Ok(large);
        }
        std::mem::swap(&mut faces[slot], large);
        Ok(&faces[slot])
    }
}
