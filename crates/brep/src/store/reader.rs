//! An open file of an exact model: its faces, and its nodes from the root down.

use std::path::{Path, PathBuf};

use super::block::{Block, FaceBuffer};
use super::chunks::ChunkList;
use super::exact::{EXACT, ExactBlock, ExactHead};
use super::formula::FORMULA;
use super::levels::{CLUSTERS, DetailLevel, LEVEL_FACES, LEVELS};
use super::node::ModelNode;
use super::objects::{FACE_VALUES, OBJECTS, SchemaCell};
use super::segment::{CUT, INNER, ModelSegment};
use super::summary::{NodeCounts, Summary};
use super::sums::SUMS;
use crate::arrangement::{ExactFace, ExactPoint};
use crate::query::MassSums;
use crate::{AttributedFaceVisitor, Face, Faces, Grid};
use spinney_base::io::{FileStat, ReadBackend};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Codec, Metadata};
use spinney_container::{HEADER_SIZE, Section, Tag, Trailer};
use spinney_crs::Crs;

/// A file of an exact model, open for reading; any number of threads may share it.
///
/// Everything that is read is checked before it is used: a corrupt file causes an error, never a
/// crash.
pub struct ExactModel {
    pub(super) path: PathBuf,
    pub(super) backend: Box<dyn ReadBackend>,
    pub(super) version: Option<FileStat>,
    pub(super) trailer: Trailer,
    pub(super) metadata: Metadata,
    pub(super) summary: Summary,
    pub(super) parts: Vec<String>,
    pub(super) segments: ChunkList,
    pub(super) blocks: ChunkList,
    pub(super) exact: ChunkList,
    pub(super) objects: ChunkList,
    pub(super) face_values: ChunkList,
    pub(super) levels: Vec<DetailLevel>,
    pub(super) clusters: ChunkList,
    pub(super) level_faces: ChunkList,
    pub(super) schema: SchemaCell,
}

impl ExactModel {
    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns frame, provenance and tags.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Returns the depth of the octree.
    pub fn depth(&self) -> u8 {
        self.summary.grid.depth()
    }

    /// Replaces the grid by another one with the same number of points; face coordinates are
    /// unchanged.
    pub(crate) fn on_grid(mut self, grid: Grid) -> ExactModel {
        self.metadata.frame = grid.frame(self.metadata.frame.crs.take());
        self.summary.grid = grid;
        self
    }

    /// Replaces the path by that of the file that this one is a copy of.
    pub(crate) fn named(self, path: &Path) -> ExactModel {
        ExactModel { path: path.to_path_buf(), ..self }
    }

    /// Returns the number of nodes of each kind.
    pub fn nodes(&self) -> &NodeCounts {
        &self.summary.nodes
    }

    /// Returns the file's codec: with [`Codec::Packed`], blocks, segments and tables may be packed.
    pub fn codec(&self) -> Codec {
        self.summary.codec
    }

    /// Returns the length of the file in bytes.
    pub fn file_size(&self) -> u64 {
        self.backend.len()
    }

    /// Returns the number of segments.
    pub fn segments(&self) -> usize {
        self.segments.len()
    }

    /// Returns the name and length of each section of the file.
    pub fn sections(&self) -> Vec<(&'static str, u64)> {
        let lists = [
            ("list of faces", self.trailer.section(super::summary::FACES)),
            ("directory", self.trailer.section(super::summary::DIRECTORY)),
            ("model", self.trailer.section(super::summary::SUMMARY)),
            ("sums", self.trailer.section(SUMS)),
            ("formula", self.trailer.section(FORMULA)),
            ("metadata", self.trailer.section(super::summary::METADATA)),
            ("list of exact faces", self.trailer.section(EXACT)),
            ("list of parts", self.trailer.section(OBJECTS)),
            ("list of values of faces", self.trailer.section(FACE_VALUES)),
            ("levels", self.trailer.section(LEVELS)),
            ("list of clusters", self.trailer.section(CLUSTERS)),
            ("list of coarse faces", self.trailer.section(LEVEL_FACES)),
        ];
        let Section { offset, length, .. } = self.trailer.section(super::summary::METADATA);
        let trailer = self.file_size().saturating_sub(offset + length);
        let known: u64 = lists.iter().map(|(_, section)| section.length).sum();
        let chunk_bytes = self.file_size().saturating_sub(known + trailer + HEADER_SIZE as u64);
        let mut all = vec![("header", HEADER_SIZE as u64), ("faces and segments", chunk_bytes)];
        all.extend(lists.map(|(name, section)| (name, section.length)));
        all.push(("trailer", trailer));
        all
    }

    /// Checks that the file was not changed since it was opened.
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

    /// Loads a block of faces.
    #[inline]
    pub(super) fn block(&self, index: usize) -> Result<Block<'_>> {
        let bytes = self.blocks.load(&self.path, &*self.backend, index)?;
        let first = self.blocks.entry(&self.path, &*self.backend, index)?.key;
        let wrong = |found: String| {
            self.corrupt(format!("block of faces {index}"), found, "a block as in formats.md")
        };
        let block = Block::new(bytes, first).ok_or_else(|| wrong("lists that do not fit".into()))?;
        if !self.blocks.is_checked(index) {
            block.check(self.summary.grid.bits, self.parts.len() as u64).map_err(wrong)?;
            self.check_key(&self.blocks, index, block.len(), self.summary.faces)?.map_err(wrong)?;
            self.blocks.set_checked(index);
        }
        Ok(block)
    }

    /// Reads a face.
    ///
    /// # Errors
    /// If there is no such face, or the file is corrupt or cannot be read.
    #[inline]
    pub fn face(&self, number: u64, buffer: &mut FaceBuffer) -> Result<()> {
        let (block, place) = self.block_of(number)?;
        block.read(place, buffer);
        Ok(())
    }

    /// Returns the block of a face, and the face's index in it.
    pub(crate) fn block_of(&self, number: u64) -> Result<(Block<'_>, usize)> {
        let found =
            self.blocks.find(&self.path, &*self.backend, number)?.filter(|_| number < self.summary.faces);
        let Some(index) = found else {
            return Err(Error::invalid(
                "face",
                number.to_string(),
                format!("less than {}, the model's faces", self.summary.faces),
            ));
        };
        let block = self.block(index)?;
        let place = number - self.blocks.entry(&self.path, &*self.backend, index)?.key;
        if place >= block.len() as u64 {
            return Err(self.corrupt("list of faces".into(), format!("no face {number}"), "all faces"));
        }
        Ok((block, place as usize))
    }

    /// Returns whether vertices of faces have colours.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read.
    pub fn is_coloured(&self) -> Result<bool> {
        let mut buffer = FaceBuffer::default();
        if self.is_empty() {
            return Ok(false);
        }
        self.face(0, &mut buffer)?;
        Ok(!buffer.colours.is_empty())
    }

    /// Returns the number of faces with off-grid vertices, which set operations use, and the number
    /// of their proxies, which queries use.
    pub fn exact_faces(&self) -> (u64, u64) {
        (self.summary.exact_faces, self.summary.proxies)
    }

    /// Returns the maximum distance between faces and their proxies, in grid units.
    pub(crate) fn reach(&self) -> u8 {
        self.summary.reach
    }

    /// Returns whether there are faces with off-grid vertices.
    pub(crate) fn has_exact_faces(&self) -> bool {
        self.summary.exact_faces > 0
    }

    /// Loads a block of faces with off-grid vertices.
    pub(super) fn exact_block(&self, index: usize) -> Result<ExactBlock<'_>> {
        let bytes = self.exact.load(&self.path, &*self.backend, index)?;
        let wrong = |found: String| self.wrong_exact_block(index, found);
        let block = ExactBlock::new(bytes, self.summary.grid.bits);
        let block = block.ok_or_else(|| wrong("lists that do not fit".into()))?;
        if !self.exact.is_checked(index) {
            block.check(self.parts.len() as u64).map_err(wrong)?;
            self.check_key(&self.exact, index, block.len(), self.summary.exact_faces)?.map_err(wrong)?;
            self.exact.set_checked(index);
        }
        Ok(block)
    }

    pub(super) fn wrong_exact_block(&self, index: usize, found: String) -> Error {
        self.corrupt(format!("block of exact faces {index}"), found, "a block as in formats.md")
    }

    /// Returns the error of an invalid block that begins with a face.
    pub(crate) fn wrong_face(&self, first: u64, found: String) -> Error {
        self.corrupt(format!("block of faces from {first} on"), found, "a block as in formats.md")
    }

    /// Returns the error of an invalid block that begins with a face with off-grid vertices.
    pub(crate) fn wrong_exact_face(&self, first: u64, found: String) -> Error {
        self.corrupt(format!("block of exact faces from {first} on"), found, "a block as in formats.md")
    }

    /// Checks that a block of `faces` faces begins at the end of the previous one, and ends where
    /// the next one begins.
    fn check_key(
        &self,
        list: &ChunkList,
        index: usize,
        faces: usize,
        total: u64,
    ) -> Result<Result<(), String>> {
        let first = list.entry(&self.path, &*self.backend, index)?.key;
        let next = match index + 1 {
            next if next < list.len() => list.entry(&self.path, &*self.backend, next)?.key,
            _ => total,
        };
        Ok(match first.checked_add(faces as u64) == Some(next) && (index > 0 || first == 0) {
            true => Ok(()),
            false => Err(format!("{faces} faces from {first} on, before {next}")),
        })
    }

    /// Visits all faces with off-grid vertices, in the order of their numbers, block by block.
    pub(crate) fn each_exact(&self, each: &mut dyn FnMut(ExactFace) -> Result<()>) -> Result<()> {
        for index in 0..self.exact.len() {
            let block = self.exact_block(index)?;
            for place in 0..block.len() {
                each(block.face(place).map_err(|found| self.wrong_exact_block(index, found))?)?;
            }
        }
        Ok(())
    }

    /// Visits the blocks of faces with off-grid vertices in order, each with the number of its
    /// first face.
    pub(crate) fn each_exact_block(
        &self,
        each: &mut dyn FnMut(u64, &ExactBlock<'_>) -> Result<()>,
    ) -> Result<()> {
        for index in 0..self.exact.len() {
            each(self.exact.entry(&self.path, &*self.backend, index)?.key, &self.exact_block(index)?)?;
        }
        Ok(())
    }

    /// Visits part and source of all faces with off-grid vertices in order, each with
    /// its number. Faster than reading the faces.
    pub(crate) fn each_exact_head(&self, each: &mut dyn FnMut(u32, ExactHead) -> Result<()>) -> Result<()> {
        let mut number = 0;
        for index in 0..self.exact.len() {
            let block = self.exact_block(index)?;
            for place in 0..block.len() {
                each(number, block.head(place))?;
                // (Files have less than 2^32 faces.)
                number += 1;
            }
        }
        Ok(())
    }

    /// Reads a face with off-grid vertices.
    pub(crate) fn exact_face(&self, number: u32) -> Result<ExactFace> {
        let (index, block, place) = self.exact_block_of(number)?;
        block.face(place).map_err(|found| self.wrong_exact_block(index, found))
    }

    /// Reads the first vertex of a face with off-grid vertices.
    pub(crate) fn exact_corner(&self, number: u32) -> Result<ExactPoint> {
        let (index, block, place) = self.exact_block_of(number)?;
        block.first_corner(place).map_err(|found| self.wrong_exact_block(index, found))
    }

    /// Returns the index of the block of a face with off-grid vertices, the block, and the index of
    /// the face in it.
    fn exact_block_of(&self, number: u32) -> Result<(usize, ExactBlock<'_>, usize)> {
        let missing = || self.corrupt("list of exact faces".into(), format!("no face {number}"), "all faces");
        let index = self.exact.find(&self.path, &*self.backend, number.into())?.ok_or_else(missing)?;
        let place = u64::from(number) - self.exact.entry(&self.path, &*self.backend, index)?.key;
        let block = self.exact_block(index)?;
        match place < block.len() as u64 {
            true => Ok((index, block, place as usize)),
            false => Err(missing()),
        }
    }

    /// Visits all faces of the octree in the order of their numbers, each with whether it is a
    /// proxy.
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

    /// Visits the proxies.
    pub(crate) fn each_proxy(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        let mut buffer = FaceBuffer::default();
        for index in 0..self.blocks.len() {
            let block = self.block(index)?;
            for face in 0..if block.has_proxies() { block.len() } else { 0 } {
                block.read(face, &mut buffer);
                if buffer.is_proxy {
                    each(&buffer.face())?;
                }
            }
        }
        Ok(())
    }

    /// Returns the winding number of the surface at infinity: 0 or 1.
    pub(crate) fn far_winding(&self) -> i32 {
        self.summary.is_unbounded.into()
    }

    /// Loads a segment.
    #[inline]
    pub(super) fn segment(&self, index: usize) -> Result<ModelSegment<'_>> {
        let bytes = self.segments.load(&self.path, &*self.backend, index)?;
        let wrong =
            |found: String| self.corrupt(format!("segment {index}"), found, "a segment as in formats.md");
        let segment = ModelSegment::new(bytes).ok_or_else(|| wrong("lists that do not fit".into()))?;
        if !self.segments.is_checked(index) {
            let key = self.segments.entry(&self.path, &*self.backend, index)?.key;
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

    /// Loads the segment of a node that has one.
    pub(crate) fn segment_of(&self, code: Code) -> Result<ModelSegment<'_>> {
        match self.segments.find(&self.path, &*self.backend, code.bits())? {
            Some(index) if self.segments.entry(&self.path, &*self.backend, index)?.key == code.bits() => {
                self.segment(index)
            }
            _ => Err(self.corrupt("directory".into(), format!("no segment {code}"), "one for each CUT node")),
        }
    }

    /// Returns the root.
    ///
    /// # Errors
    /// If its segment is corrupt or cannot be read.
    pub fn root(&self) -> Result<ModelNode<'_>> {
        let segment = self.segment_of(Code::root(Dimension::Oct))?;
        Ok(ModelNode { level: 0, position: [0; 3], word: segment.word(0), segment, begins_segment: true })
    }

    /// Returns the children of an inner node, in Z-order, or `None` for other nodes.
    ///
    /// # Errors
    /// If a segment is corrupt or cannot be read.
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

    /// Returns one child of an inner node.
    ///
    /// # Errors
    /// If a segment is corrupt or cannot be read.
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
        let missing = || self.corrupt("segment".into(), format!("a CUT node at level {level}"), "none there");
        let segment = self.segment_of(code.ok_or_else(missing)?)?;
        Ok(ModelNode { level, position, word: segment.word(0), segment, begins_segment: true })
    }

    /// Returns the node without children that contains a point, in units of `2^-bits` of the
    /// grid's. Cells include their lower walls. Returns `None` outside of the model's space.
    ///
    /// # Errors
    /// If a segment is corrupt or cannot be read.
    #[inline]
    pub(crate) fn leaf_at(&self, at: [i64; 3], bits: u32) -> Result<Option<ModelNode<'_>>> {
        // The space begins half a grid unit before the first points.
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
        // (These have one name each.)
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

    fn volume_correction(&self) -> Result<f64> {
        if !self.has_exact_faces() {
            return Ok(0.0);
        }
        let sums = self.stored_sums()?.map_or_else(|| self.off_grid_sums(), |stored| Ok(stored.mass))?;
        Ok(sums.volume_correction(self.summary.grid.bits))
    }

    fn mass_sums(&self, progress: &dyn Progress) -> Result<Option<MassSums>> {
        match self.stored_sums()? {
            Some(stored) => Ok(Some(stored.mass)),
            None => self.sums_of_faces(progress).map(Some),
        }
    }

    fn len(&self) -> u64 {
        self.summary.faces
    }

    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        self.each_face(&mut |face, _| each(face))
    }

    fn each_with_values(&self, columns: &[&str], each: &mut AttributedFaceVisitor<'_>) -> Result<()> {
        let mut values = self.values_of(columns)?;
        self.each(&mut |face| each(face, values.of(face.number)?))
    }
}
