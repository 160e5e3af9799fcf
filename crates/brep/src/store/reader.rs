//! An open file of an exact model: its faces, and its nodes from the root down.

use std::path::{Path, PathBuf};

use super::block::{Block, FaceBuffer};
use super::exact::{EXACT, ExactBlock, ExactHead};
use super::formula::FORMULA;
use super::objects::{FACE_VALUES, OBJECTS, SchemaCell};
use super::pieces::Pieces;
use super::segment::{
    CUT, FULL, INNER, LEAF, LeafHead, LeafRule, ModelSegment, NEAR_FULL, NEAR_VOID, NodeKind, VOID,
};
use super::summary::{NodeCounts, Summary};
use crate::arrangement::ExactFace;
use crate::{AttributedFaceVisitor, Face, Faces, Grid};
use spinney_base::io::{FileStat, ReadBackend};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Result};
use spinney_container::{Codec, Metadata};
use spinney_container::{HEADER_SIZE, Section, Tag, Trailer};
use spinney_crs::Crs;

/// A file of an exact model, open for reading; may be shared by any number of threads.
///
/// Everything that is read is checked before it is used: a damaged file gives an error, never a crash.
pub struct ExactModel {
    pub(super) path: PathBuf,
    pub(super) backend: Box<dyn ReadBackend>,
    pub(super) version: Option<FileStat>,
    pub(super) trailer: Trailer,
    pub(super) metadata: Metadata,
    pub(super) summary: Summary,
    pub(super) parts: Vec<String>,
    pub(super) segments: Pieces,
    pub(super) blocks: Pieces,
    pub(super) exact: Pieces,
    pub(super) objects: Pieces,
    pub(super) face_values: Pieces,
    pub(super) schema: SchemaCell,
}

impl ExactModel {
    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Frame, provenance and tags.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Levels of the octree.
    pub fn depth(&self) -> u8 {
        self.summary.grid.depth()
    }

    /// The model with all of its faces on another grid of as many points.
    pub(crate) fn on_grid(mut self, grid: Grid) -> ExactModel {
        self.metadata.frame = grid.frame(self.metadata.frame.crs.take());
        self.summary.grid = grid;
        self
    }

    /// The model under the name of the file that it is a copy of.
    pub(crate) fn named(self, path: &Path) -> ExactModel {
        ExactModel { path: path.to_path_buf(), ..self }
    }

    /// Numbers of nodes by their kinds.
    pub fn nodes(&self) -> &NodeCounts {
        &self.summary.nodes
    }

    /// Packing of what stands in the file: with [`Codec::Packed`] blocks, segments and tables may be packed.
    pub fn codec(&self) -> Codec {
        self.summary.codec
    }

    /// Bytes of the whole file.
    pub fn file_size(&self) -> u64 {
        self.backend.len()
    }

    /// Number of segments.
    pub fn segments(&self) -> usize {
        self.segments.len()
    }

    /// Name and bytes of each part of the file.
    pub fn sections(&self) -> Vec<(&'static str, u64)> {
        let lists = [
            ("list of faces", self.trailer.section(super::summary::FACES)),
            ("directory", self.trailer.section(super::summary::DIRECTORY)),
            ("model", self.trailer.section(super::summary::SUMMARY)),
            ("formula", self.trailer.section(FORMULA)),
            ("metadata", self.trailer.section(super::summary::METADATA)),
            ("list of exact faces", self.trailer.section(EXACT)),
            ("list of parts", self.trailer.section(OBJECTS)),
            ("list of values of faces", self.trailer.section(FACE_VALUES)),
        ];
        let Section { offset, length, .. } = self.trailer.section(super::summary::METADATA);
        let trailer = self.file_size().saturating_sub(offset + length);
        let known: u64 = lists.iter().map(|(_, section)| section.length).sum();
        let pieces = self.file_size().saturating_sub(known + trailer + HEADER_SIZE as u64);
        let mut all = vec![("header", HEADER_SIZE as u64), ("faces and segments", pieces)];
        all.extend(lists.map(|(name, section)| (name, section.length)));
        all.push(("trailer", trailer));
        all
    }

    /// Makes sure that the file is what it was when it was opened.
    ///
    /// # Errors
    /// If it was changed.
    pub fn check_unchanged(&self) -> Result<()> {
        match (&self.version, self.backend.stat()?) {
            (Some(before), Some(now)) if *before != now => {
                Err(Error::Changed { path: self.path.clone(), what: "was overwritten or cut short" })
            }
            _ => Ok(()),
        }
    }

    /// Queries the host of a remote file whether it still is the version that was opened.
    ///
    /// # Errors
    /// If it is not, or the host does not respond.
    pub fn check_remote(&self) -> Result<()> {
        self.backend.check_remote()
    }

    pub(super) fn corrupt(&self, place: String, found: impl Into<String>, expected: &str) -> Error {
        Error::corrupt(&self.path, place, found, expected)
    }

    /// A block of faces.
    #[inline]
    pub(super) fn block(&self, index: usize) -> Result<Block<'_>> {
        let bytes = self.blocks.load(&self.path, &*self.backend, index)?;
        let first = self.blocks.entry(&*self.backend, index).key;
        let wrong = |found: String| {
            self.corrupt(format!("block of faces {index}"), found, "a block as formats.md has it")
        };
        let block = Block::new(bytes, first).ok_or_else(|| wrong("lists that do not fit".into()))?;
        if !self.blocks.is_checked(index) {
            block.check(self.summary.grid.bits, self.parts.len() as u64).map_err(wrong)?;
            self.check_key(&self.blocks, index, block.len(), self.summary.faces).map_err(wrong)?;
            self.blocks.set_checked(index);
        }
        Ok(block)
    }

    /// Reads a face.
    ///
    /// # Errors
    /// If there is none of that number, or the file is damaged or cannot be read.
    #[inline]
    pub fn face(&self, number: u64, buffer: &mut FaceBuffer) -> Result<()> {
        let (block, place) = self.block_of(number)?;
        block.read(place, buffer);
        Ok(())
    }

    /// The block of a face, and the face's place in it.
    pub(crate) fn block_of(&self, number: u64) -> Result<(Block<'_>, usize)> {
        let found = self.blocks.find(&*self.backend, number).filter(|_| number < self.summary.faces);
        let Some(index) = found else {
            return Err(Error::invalid(
                "face",
                number.to_string(),
                format!("less than {}, the model's faces", self.summary.faces),
            ));
        };
        let block = self.block(index)?;
        let place = number - self.blocks.entry(&*self.backend, index).key;
        if place >= block.len() as u64 {
            return Err(self.corrupt("list of faces".into(), format!("no face {number}"), "all faces"));
        }
        Ok((block, place as usize))
    }

    /// Whether corners of faces have colours.
    ///
    /// # Errors
    /// If the file is damaged or cannot be read.
    pub fn is_coloured(&self) -> Result<bool> {
        let mut buffer = FaceBuffer::default();
        if self.is_empty() {
            return Ok(false);
        }
        self.face(0, &mut buffer)?;
        Ok(!buffer.colours.is_empty())
    }

    /// Number of faces with corners beside the grid, of which operations are made, and of those that stand in for them where
    /// the model is asked something.
    pub fn exact_faces(&self) -> (u64, u64) {
        (self.summary.exact_faces, self.summary.stand_ins)
    }

    /// Steps that faces lie at most beside those that they stand in for.
    pub(crate) fn reach(&self) -> u8 {
        self.summary.reach
    }

    /// Whether there are faces with corners beside the grid.
    pub(crate) fn is_beside_grid(&self) -> bool {
        self.summary.exact_faces > 0
    }

    /// A block of faces with corners beside the grid.
    pub(super) fn exact_block(&self, index: usize) -> Result<ExactBlock<'_>> {
        let bytes = self.exact.load(&self.path, &*self.backend, index)?;
        let wrong = |found: String| self.wrong_exact_block(index, found);
        let block = ExactBlock::new(bytes, self.summary.grid.bits);
        let block = block.ok_or_else(|| wrong("lists that do not fit".into()))?;
        if !self.exact.is_checked(index) {
            block.check(self.parts.len() as u64).map_err(wrong)?;
            self.check_key(&self.exact, index, block.len(), self.summary.exact_faces).map_err(wrong)?;
            self.exact.set_checked(index);
        }
        Ok(block)
    }

    pub(super) fn wrong_exact_block(&self, index: usize, found: String) -> Error {
        self.corrupt(format!("block of exact faces {index}"), found, "a block as formats.md has it")
    }

    /// Checks that a block with so many faces begins where the one before ends, and ends where the next begins.
    fn check_key(&self, list: &Pieces, index: usize, faces: usize, total: u64) -> Result<(), String> {
        let first = list.entry(&*self.backend, index).key;
        let next = match index + 1 {
            next if next < list.len() => list.entry(&*self.backend, next).key,
            _ => total,
        };
        match first.checked_add(faces as u64) == Some(next) && (index > 0 || first == 0) {
            true => Ok(()),
            false => Err(format!("{faces} faces from {first} on, before {next}")),
        }
    }

    /// Reads all faces with corners beside the grid, in the order of their numbers, block by block.
    pub(crate) fn each_exact(&self, each: &mut dyn FnMut(ExactFace) -> Result<()>) -> Result<()> {
        for index in 0..self.exact.len() {
            let block = self.exact_block(index)?;
            for place in 0..block.len() {
                each(block.face(place).map_err(|found| self.wrong_exact_block(index, found))?)?;
            }
        }
        Ok(())
    }

    /// Reads the blocks of the faces with corners beside the grid, each with the number of its first face, in order.
    pub(crate) fn each_exact_block(
        &self,
        each: &mut dyn FnMut(u64, &ExactBlock<'_>) -> Result<()>,
    ) -> Result<()> {
        for index in 0..self.exact.len() {
            each(self.exact.entry(&*self.backend, index).key, &self.exact_block(index)?)?;
        }
        Ok(())
    }

    /// Reads what is quickly read of all faces with corners beside the grid, each with its number, in order.
    pub(crate) fn each_exact_head(&self, each: &mut dyn FnMut(u32, ExactHead) -> Result<()>) -> Result<()> {
        let mut number = 0;
        for index in 0..self.exact.len() {
            let block = self.exact_block(index)?;
            for place in 0..block.len() {
                let head = block.head(place).map_err(|found| self.wrong_exact_block(index, found))?;
                each(number, head)?;
                // (Files have fewer than 2^32.)
                number += 1;
            }
        }
        Ok(())
    }

    /// Reads a face with corners beside the grid.
    pub(crate) fn exact_face(&self, number: u32) -> Result<ExactFace> {
        let missing = || self.corrupt("list of exact faces".into(), format!("no face {number}"), "all faces");
        let index = self.exact.find(&*self.backend, number.into()).ok_or_else(missing)?;
        let place = u64::from(number) - self.exact.entry(&*self.backend, index).key;
        let block = self.exact_block(index)?;
        if place >= block.len() as u64 {
            return Err(missing());
        }
        block.face(place as usize).map_err(|found| self.wrong_exact_block(index, found))
    }

    /// Reads all faces of the octree in the order of their numbers, and says of each whether it stands in for others.
    pub(crate) fn each_face(&self, each: &mut dyn FnMut(&Face<'_>, bool) -> Result<()>) -> Result<()> {
        let mut buffer = FaceBuffer::default();
        for index in 0..self.blocks.len() {
            let block = self.block(index)?;
            for face in 0..block.len() {
                block.read(face, &mut buffer);
                each(&buffer.face(), buffer.is_proxy)?;
            }
        }
        Ok(())
    }

    /// Reads the faces that stand in for others.
    pub(crate) fn each_stand_in(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        let mut buffer = FaceBuffer::default();
        for index in 0..self.blocks.len() {
            let block = self.block(index)?;
            for face in 0..if block.has_stand_ins() { block.len() } else { 0 } {
                block.read(face, &mut buffer);
                if buffer.is_proxy {
                    each(&buffer.face())?;
                }
            }
        }
        Ok(())
    }

    /// The winding number of the surface around what is far away: 0 or 1.
    pub(crate) fn far_winding(&self) -> i32 {
        self.summary.is_unbounded.into()
    }

    /// A segment.
    #[inline]
    pub(super) fn segment(&self, index: usize) -> Result<ModelSegment<'_>> {
        let bytes = self.segments.load(&self.path, &*self.backend, index)?;
        let wrong =
            |found: String| self.corrupt(format!("segment {index}"), found, "a segment as formats.md has it");
        let segment = ModelSegment::new(bytes).ok_or_else(|| wrong("lists that do not fit".into()))?;
        if !self.segments.is_checked(index) {
            let key = self.segments.entry(&*self.backend, index).key;
            let code = Code::from_bits(Dimension::Oct, key).filter(|code| code.level() <= self.depth());
            let code = code.ok_or_else(|| wrong(format!("code {key:016x}")))?;
            let mut deepest = 0;
            segment
                .check([self.summary.faces, self.summary.exact_faces], &mut |level, word| {
                    deepest = deepest.max(level + u8::from(matches!(word & 7, INNER | CUT)));
                })
                .map_err(wrong)?;
            if code.level() + deepest > self.depth() || segment.word(0) & 7 == CUT {
                return Err(wrong("nodes below the deepest level".into()));
            }
            self.segments.set_checked(index);
        }
        Ok(segment)
    }

    /// The segment of a node that owns one.
    pub(crate) fn segment_of(&self, code: Code) -> Result<ModelSegment<'_>> {
        let index = self.segments.find(&*self.backend, code.bits());
        let index = index.filter(|index| self.segments.entry(&*self.backend, *index).key == code.bits());
        let missing =
            || self.corrupt("directory".into(), format!("no segment {code}"), "one for each cut node");
        self.segment(index.ok_or_else(missing)?)
    }

    /// The root.
    ///
    /// # Errors
    /// If its segment is damaged or cannot be read.
    pub fn root(&self) -> Result<ModelNode<'_>> {
        let segment = self.segment_of(Code::root(Dimension::Oct))?;
        Ok(ModelNode { level: 0, position: [0; 3], word: segment.word(0), segment, begins_segment: true })
    }

    /// The children of an inner node, in Z order; nothing of other nodes.
    ///
    /// # Errors
    /// If a segment is damaged or cannot be read.
    pub fn children<'a>(&'a self, node: &ModelNode<'a>) -> Result<Option<[ModelNode<'a>; 8]>> {
        if node.word & 7 != INNER {
            return Ok(None);
        }
        let mut failed = None;
        let children = std::array::from_fn(|child| match self.child(node, child) {
            Ok(child) => child,
            Err(error) => {
                failed = Some(error);
                node.clone()
            }
        });
        failed.map_or(Ok(Some(children)), Err)
    }

    /// One child of an inner node.
    ///
    /// # Errors
    /// If a segment is damaged or cannot be read.
    #[inline]
    pub fn child<'a>(&'a self, node: &ModelNode<'a>, child: usize) -> Result<ModelNode<'a>> {
        debug_assert!(node.word & 7 == INNER);
        let level = node.level + 1;
        let position = std::array::from_fn(|axis| 2 * node.position[axis] + (child >> axis & 1) as u32);
        let word = node.segment.child(node.word, child);
        if word & 7 != CUT {
            return Ok(ModelNode {
                level,
                position,
                word,
                segment: node.segment.clone(),
                begins_segment: false,
            });
        }
        let code = Code::from_cell(Dimension::Oct, level, position);
        let missing = || self.corrupt("segment".into(), format!("a cut at level {level}"), "none there");
        let segment = self.segment_of(code.ok_or_else(missing)?)?;
        Ok(ModelNode { level, position, word: segment.word(0), segment, begins_segment: true })
    }

    /// The node without children in which a point of the grid lies, given in units of `2^-bits` of the grid's:
    /// cells own what is on their lower walls. `None` outside of the model's space.
    ///
    /// # Errors
    /// If a segment is damaged or cannot be read.
    #[inline]
    pub(crate) fn leaf_at(&self, at: [i64; 3], bits: u32) -> Result<Option<ModelNode<'_>>> {
        // The space begins half a unit before the first points.
        let half = (1i64 << bits) / 2;
        let side = 1i64 << (u32::from(self.summary.grid.bits) + bits);
        let from_wall = at.map(|at| at + half);
        if from_wall.iter().any(|at| !(0..side).contains(at)) {
            return Ok(None);
        }
        let mut node = self.root()?;
        while node.word & 7 == INNER {
            let shift = u32::from(self.summary.grid.bits) + bits - 1 - u32::from(node.level);
            let child = (0..3).map(|axis| ((from_wall[axis] >> shift & 1) as usize) << axis).sum();
            node = self.child(&node, child)?;
        }
        Ok(Some(node))
    }
}

/// A node of a model's octree.
#[derive(Clone)]
pub struct ModelNode<'a> {
    level: u8,
    position: [u32; 3],
    word: u32,
    segment: ModelSegment<'a>,
    /// Whether it is the node that its segment belongs to.
    begins_segment: bool,
}

/// State of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelNodeState {
    /// Outside of the body.
    Void,
    /// Inside.
    Full,
    /// Divided: see [`ExactModel::children`].
    Inner,
    /// Cut by faces: see [`ModelNode::faces`].
    Leaf {
        /// Kind of the cell: how much their planes have in common.
        kind: NodeKind,
        /// How they tell what is inside.
        rule: LeafRule,
        /// Whether the cell's least corner is inside: moved a little along x, much less along y and still less
        /// along z, where it lies on a face.
        inside: bool,
    },
}

impl ModelNode<'_> {
    /// Levels between the root and the node.
    pub fn level(&self) -> u8 {
        self.level
    }

    /// The node's coordinates among the nodes of its level.
    pub fn position(&self) -> [u32; 3] {
        self.position
    }

    /// The node's cell from its least to its greatest coordinates, in half units of the grid: walls lie at odd
    /// multiples of half a unit, and so no point of the grid lies on one.
    pub fn bounds(&self, grid: &Grid) -> [[i64; 3]; 2] {
        let width = 2i64 << (grid.bits - self.level);
        let low = self.position.map(|at| i64::from(at) * width - 1);
        [low, low.map(|low| low + width)]
    }

    /// Least and greatest coordinates of the node's cell in the world.
    pub fn world_box(&self, grid: &Grid) -> [[f64; 3]; 2] {
        self.bounds(grid).map(|corner| grid.to_world_between(corner.map(|at| at as f64 / 2.0)))
    }

    pub(crate) fn begins_segment(&self) -> bool {
        self.begins_segment
    }

    /// The state of the node.
    #[inline]
    pub fn state(&self) -> ModelNodeState {
        match self.word & 7 {
            VOID | NEAR_VOID => ModelNodeState::Void,
            FULL | NEAR_FULL => ModelNodeState::Full,
            LEAF => {
                let (LeafHead { kind, rule, inside }, _) = self.segment.leaf(self.word);
                ModelNodeState::Leaf { kind, rule, inside }
            }
            _ => ModelNodeState::Inner,
        }
    }

    /// The winding number of the whole surface all over the cell, if no face cuts it, and none with corners beside the grid is
    /// near it.
    pub(crate) fn winding(&self) -> Option<i32> {
        match self.word & 7 {
            VOID => Some(0),
            FULL => Some(1),
            _ => None,
        }
    }

    /// Numbers of the faces that cut a leaf's cell, ascending in no order that means anything; nothing of other
    /// nodes.
    #[inline]
    pub fn faces(&self) -> impl Iterator<Item = u64> {
        let list = (self.word & 7 == LEAF).then(|| self.segment.leaf(self.word).1);
        list.into_iter().flatten()
    }

    /// Numbers of the faces with corners beside the grid that are near the cell of a node without children.
    pub(crate) fn near(&self) -> Vec<u32> {
        self.segment.near(self.word)
    }
}

impl Faces for ExactModel {
    fn grid(&self) -> &Grid {
        &self.summary.grid
    }

    fn parts(&self) -> &[String] {
        &self.parts
    }

    fn part_attributes(&self, part: u32) -> Result<Option<String>> {
        self.read_part_attributes(part)
    }

    fn parts_with_attributes(&self) -> Result<u64> {
        self.count_parts_with_attributes()
    }

    fn file_attributes(&self) -> Result<Vec<String>> {
        self.read_file_attributes()
    }

    fn value_columns(&self) -> Result<Vec<String>> {
        // (Lists of one name.)
        Ok(self.face_columns()?.into_iter().filter_map(|names| names.into_iter().next()).collect())
    }

    fn crs(&self) -> Option<&Crs> {
        self.metadata.frame.crs.as_ref()
    }

    fn unit(&self) -> Option<&str> {
        self.metadata.tag(Tag::Unit)
    }

    fn is_unbounded(&self) -> bool {
        self.summary.is_unbounded
    }

    fn volume_beside(&self) -> Result<f64> {
        if self.is_beside_grid() { self.volume_beside_grid() } else { Ok(0.0) }
    }

    fn len(&self) -> u64 {
        self.summary.faces
    }

    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        self.each_face(&mut |face, _| each(face))
    }

    fn each_with_values(&self, columns: &[&str], each: &mut AttributedFaceVisitor<'_>) -> Result<()> {
        let names = self.value_columns()?;
        let numbers: Vec<Option<usize>> =
            columns.iter().map(|column| names.iter().position(|name| name == column)).collect();
        let mut values = vec![None; columns.len()];
        self.each(&mut |face| {
            for (value, number) in values.iter_mut().zip(&numbers) {
                // (Models have fewer than 2^32 faces, and columns.)
                *value = match number {
                    Some(number) => self.face_value(*number as u32, face.number as u32)?,
                    None => None,
                };
            }
            each(face, &values)
        })
    }
}
