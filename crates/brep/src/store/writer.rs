//! Writer of exact model files: header, blocks of faces in input order, segments, lists, metadata,
//! trailer.

use std::borrow::Cow;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::block::{Block, BlockBuilder};
use super::chunks::Entry;
pub(crate) use super::chunks::List;
use super::exact::{EXACT, ExactBlockBuilder};
use super::exact_lists::ExactLists;
use super::formula::FORMULA;
use super::levels::{CLUSTERS, DetailLevel, LEVEL_FACES, LEVELS};
use super::objects::{FACE_VALUES, OBJECTS};
use super::packed::pack;
use super::summary::{DIRECTORY, FACES, METADATA, SUMMARY, Summary};
use super::sums::SUMS;
use crate::arrangement::ExactFace;
use crate::{Face, Grid};
use spinney_base::io::{Output, Sorter, directory_of};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Result};
use spinney_container::Metadata;
use spinney_container::{
    Codec, Content, FileHeader, HEADER_SIZE, Section, SectionWriter, Trailer, TreeFormat, check_goblin_name,
};

/// A file that is being written, append-only.
pub(crate) struct ModelWriter {
    out: Output,
    path: PathBuf,
    position: u64,
    codec: Codec,
    block: BlockBuilder,
    exact: ExactBlockBuilder,
    /// Entries of the lists.
    lists: [Sorter; List::ALL.len()],
}

impl ModelWriter {
    /// Starts a file; about `memory` bytes hold entries of each list, and the others go to a
    /// temporary file.
    pub(crate) fn new(out: Output, grid: &Grid, memory: u64) -> Result<ModelWriter> {
        let path = out.path().to_path_buf();
        check_goblin_name(&path, "exact models")?;
        let lists = List::ALL.map(|_| Sorter::new(directory_of(&path), memory));
        let (codec, block) = (Codec::Plain, BlockBuilder::default());
        let exact = ExactBlockBuilder::default();
        let mut writer = ModelWriter { out, path, position: 0, codec, block, exact, lists };
        writer.write(&model_header(grid).to_bytes(), "write the header")?;
        Ok(writer)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Sets the codec of chunks, before any is written.
    pub(crate) fn set_codec(&mut self, codec: Codec) {
        self.codec = codec;
    }

    pub(crate) fn codec(&self) -> Codec {
        self.codec
    }

    /// Returns whether no face was added yet, and only the header was written.
    pub(crate) fn is_empty(&self) -> bool {
        self.block.is_empty() && self.exact.is_empty() && self.position == HEADER_SIZE as u64
    }

    fn write(&mut self, bytes: &[u8], doing: &'static str) -> Result<()> {
        self.out.write_all(bytes).map_err(Error::io(&self.path, doing))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    /// Writes a chunk, and adds it to a list under a key.
    pub(crate) fn chunk(&mut self, list: List, key: u64, plain: &[u8]) -> Result<()> {
        self.stored_chunk(list, key, &encoded(self.codec, list, plain))
    }

    /// Writes the stored bytes of a chunk, and adds it to a list under a key.
    pub(crate) fn stored_chunk(&mut self, list: List, key: u64, bytes: &[u8]) -> Result<()> {
        let entry = self.append(list, bytes)?;
        self.entry(list, Entry { key, ..entry })
    }

    /// Writes the stored bytes of a chunk; returns its entry, without a key.
    pub(crate) fn append(&mut self, list: List, bytes: &[u8]) -> Result<Entry> {
        let offset = self.position;
        let Ok(length) = u32::try_from(bytes.len()) else {
            let advice = "divide the model, or choose a larger --snap";
            return Err(Error::unsupported(&self.path, format!("a chunk of {} bytes", bytes.len()), advice));
        };
        self.write(bytes, doing(list))?;
        Ok(Entry { key: 0, offset, length, checksum: crc32c::crc32c(bytes) })
    }

    /// Adds the entry of a chunk to a list.
    pub(crate) fn entry(&mut self, list: List, entry: Entry) -> Result<()> {
        self.lists[list as usize].push(entry.key, &entry.to_bytes())
    }

    /// Adds a face, which may be a proxy for faces with off-grid vertices.
    pub(crate) fn face(&mut self, face: &Face<'_>, is_proxy: bool) -> Result<()> {
        self.block.push(face, is_proxy);
        if self.block.is_full() { self.finish_block() } else { Ok(()) }
    }

    /// Adds some faces of another block, whose numbers start with `first`; returns `None` if that
    /// block is invalid.
    pub(crate) fn faces_of(&mut self, block: &Block<'_>, faces: &[usize], first: u64) -> Result<Option<()>> {
        if !self.block.takes(faces.len()) {
            self.finish_block()?;
        }
        let added = self.block.append(block, faces, first);
        if self.block.is_full() {
            self.finish_block()?;
        }
        Ok(added)
    }

    /// Adds a block of faces, the first of which has the number `first`.
    pub(crate) fn face_block(&mut self, first: u64, block: &[u8]) -> Result<()> {
        if !self.block.is_empty() {
            self.finish_block()?;
        }
        self.chunk(List::Faces, first, block)
    }

    fn finish_block(&mut self) -> Result<()> {
        let (first, bytes) = self.block.finish();
        self.chunk(List::Faces, first, &bytes)
    }

    pub(crate) fn segment(&mut self, code: Code, bytes: &[u8]) -> Result<()> {
        if !self.block.is_empty() {
            self.finish_block()?;
        }
        if !self.exact.is_empty() {
            self.finish_exact_block()?;
        }
        self.chunk(List::Segments, code.bits(), bytes)
    }

    /// Adds a face with off-grid vertices.
    pub(crate) fn exact_face(&mut self, face: ExactFace) -> Result<()> {
        self.exact.push(face);
        if self.exact.is_full() { self.finish_exact_block() } else { Ok(()) }
    }

    /// Adds faces with off-grid vertices of another block.
    pub(crate) fn exact_lists(&mut self, lists: ExactLists) -> Result<()> {
        if !self.exact.takes(&lists) {
            self.finish_exact_block()?;
        }
        self.exact.append(lists);
        if self.exact.is_full() { self.finish_exact_block() } else { Ok(()) }
    }

    /// Adds a block of `faces` faces with off-grid vertices.
    pub(crate) fn exact_block(&mut self, faces: usize, block: &[u8]) -> Result<()> {
        if !self.exact.is_empty() {
            self.finish_exact_block()?;
        }
        let first = self.exact.skip(faces);
        self.chunk(List::Exact, first, block)
    }

    /// Returns the number of added faces with off-grid vertices.
    pub(crate) fn exact_faces(&self) -> u64 {
        self.exact.len()
    }

    fn finish_exact_block(&mut self) -> Result<()> {
        let (first, bytes) = self.exact.finish();
        self.chunk(List::Exact, first, &bytes)
    }

    /// Writes the sections after the segments, and commits the file.
    pub(crate) fn finish(
        self,
        summary: &Summary,
        sums: &[u8],
        levels: &[DetailLevel],
        formula: &str,
        metadata: &Metadata,
    ) -> Result<()> {
        let ModelWriter { mut out, path, mut position, lists, .. } = self;
        let metadata = metadata.to_bytes(&path)?;
        let mut sections = Vec::new();
        for list in lists {
            let mut section = SectionWriter::new(&mut out, position);
            list.finish(&mut |entry| {
                section.write_all(entry).map_err(Error::io(&path, "write a list of chunks"))
            })?;
            position += section.written.length;
            sections.push(section.written);
        }
        let mut bytes = |bytes: &[u8], doing: &'static str| -> Result<Section> {
            let mut section = SectionWriter::new(&mut out, position);
            section.write_all(bytes).map_err(Error::io(&path, doing))?;
            position += section.written.length;
            Ok(section.written)
        };
        let of = |list: List| sections[list as usize];
        let mut all = vec![(DIRECTORY, of(List::Segments)), (FACES, of(List::Faces))];
        all.push((SUMMARY, bytes(&summary.to_bytes(), "write the model's section")?));
        let others = [
            (EXACT, of(List::Exact)),
            (OBJECTS, of(List::Objects)),
            (FACE_VALUES, of(List::FaceValues)),
            (SUMS, bytes(sums, "write the sums")?),
            (FORMULA, bytes(formula.as_bytes(), "write the formula")?),
            (LEVELS, bytes(&DetailLevel::to_bytes(levels), "write the levels")?),
            (CLUSTERS, of(List::Clusters)),
            (LEVEL_FACES, of(List::LevelFaces)),
        ];
        all.extend(others.into_iter().filter(|(_, section)| section.length > 0));
        all.push((METADATA, bytes(&metadata, "write the metadata")?));
        let trailer = Trailer { header: model_header(&summary.grid), sections: all };
        out.write_all(&trailer.to_bytes(position)).map_err(Error::io(&path, "write the trailer"))?;
        out.commit()
    }
}

/// Returns the stored bytes of a chunk.
pub(crate) fn encoded(codec: Codec, list: List, plain: &[u8]) -> Cow<'_, [u8]> {
    match codec {
        Codec::Plain => Cow::Borrowed(plain),
        Codec::Packed | Codec::Reference => Cow::Owned(pack(list, plain)),
    }
}

/// Returns the phrase for writing a chunk, in error messages.
fn doing(list: List) -> &'static str {
    match list {
        List::Faces => "write faces",
        List::Segments => "write a segment",
        List::Exact => "write exact faces",
        List::Objects => "write attributes of parts",
        List::FaceValues => "write values of faces",
        List::Clusters => "write clusters of faces",
        List::LevelFaces => "write coarse faces",
    }
}

/// Returns the header of a model's file.
fn model_header(grid: &Grid) -> FileHeader {
    let (format, content) = (TreeFormat::Goblin, Content::Model);
    FileHeader { format, content, dimension: Dimension::Oct, depth: grid.depth(), layers: 0 }
}
