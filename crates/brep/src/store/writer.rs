//! Writes a file of an exact model: header, blocks of faces as they come, segments, lists, metadata, trailer.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::block::BlockBuilder;
use super::exact::{EXACT, ExactPart};
use super::pieces::{ENTRY, Entry};
use super::summary::{DIRECTORY, FACES, METADATA, SUMMARY, Summary};
use crate::{Face, Grid};
use spinney_base::io::{Output, Sorter, folder};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Result};
use spinney_container::Metadata;
use spinney_container::{Content, FileHeader, Section, SectionWriter, Trailer, TreeFormat, check_tree_name};

/// A file being written, append-only.
pub(crate) struct ModelWriter {
    out: Output,
    path: PathBuf,
    position: u64,
    block: BlockBuilder,
    blocks: Sorter,
    segments: Sorter,
}

impl ModelWriter {
    /// Starts a file; about `memory` bytes hold entries of each list before they go to a temporary file.
    pub(crate) fn new(out: Output, grid: &Grid, memory: u64) -> Result<ModelWriter> {
        let path = out.path().to_path_buf();
        check_tree_name(&path)?;
        let list = || Sorter::new(folder(&path), ENTRY, memory);
        let (blocks, segments) = (list(), list());
        let block = BlockBuilder::default();
        let mut writer = ModelWriter { out, path, position: 0, block, blocks, segments };
        writer.write(&model_header(grid).to_bytes(), "write the header")?;
        Ok(writer)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, bytes: &[u8], doing: &'static str) -> Result<()> {
        self.out.write_all(bytes).map_err(Error::io(&self.path, doing))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    /// Writes a piece, and returns its entry.
    fn piece(&mut self, key: u64, bytes: &[u8], doing: &'static str) -> Result<Entry> {
        let offset = self.position;
        let Ok(length) = u32::try_from(bytes.len()) else {
            return Err(Error::TooLarge {
                path: self.path.clone(),
                what: "a cell of very many faces".into(),
                needed: bytes.len() as u64,
                limit: u32::MAX.into(),
                advice: "divide the model, or choose a coarser --snap".into(),
            });
        };
        self.write(bytes, doing)?;
        Ok(Entry { key, offset, length, checksum: crc32c::crc32c(bytes) })
    }

    pub(crate) fn face(&mut self, face: &Face<'_>) -> Result<()> {
        self.block.push(face);
        if self.block.is_full() { self.finish_block() } else { Ok(()) }
    }

    fn finish_block(&mut self) -> Result<()> {
        let (first, bytes) = self.block.finish();
        let entry = self.piece(first, &bytes, "write faces")?;
        self.blocks.push(first, entry.to_bytes().to_vec())
    }

    pub(crate) fn segment(&mut self, code: Code, bytes: &[u8]) -> Result<()> {
        if !self.block.is_empty() {
            self.finish_block()?;
        }
        let entry = self.piece(code.bits(), bytes, "write a segment")?;
        self.segments.push(code.bits(), entry.to_bytes().to_vec())
    }

    /// Writes what stands after the segments and puts the file in its place.
    pub(crate) fn finish(self, summary: &Summary, exact: &ExactPart, metadata: &Metadata) -> Result<()> {
        let ModelWriter { mut out, path, mut position, blocks, segments, .. } = self;
        let metadata = metadata.to_bytes(&path)?;
        let mut list = |sorter: Sorter, out: &mut Output, doing: &'static str| -> Result<Section> {
            let mut section = SectionWriter::new(out, position);
            sorter.finish(&mut |entry| section.write_all(entry).map_err(Error::io(&path, doing)))?;
            position += section.written.length;
            Ok(section.written)
        };
        let blocks = list(blocks, &mut out, "write the list of faces")?;
        let directory = list(segments, &mut out, "write the directory")?;
        let mut bytes = |bytes: &[u8], out: &mut Output, doing: &'static str| -> Result<Section> {
            let mut section = SectionWriter::new(out, position);
            section.write_all(bytes).map_err(Error::io(&path, doing))?;
            position += section.written.length;
            Ok(section.written)
        };
        let summary_section = bytes(&summary.to_bytes(), &mut out, "write the model's section")?;
        let mut sections = vec![(DIRECTORY, directory), (FACES, blocks), (SUMMARY, summary_section)];
        if !exact.faces.is_empty() {
            sections.push((EXACT, bytes(&exact.to_bytes(), &mut out, "write the exact faces")?));
        }
        sections.push((METADATA, bytes(&metadata, &mut out, "write the metadata")?));
        let trailer = Trailer { header: model_header(&summary.grid), sections };
        out.write_all(&trailer.to_bytes(position)).map_err(Error::io(&path, "write the trailer"))?;
        out.commit()
    }
}

/// The header of a model's file.
fn model_header(grid: &Grid) -> FileHeader {
    let (format, content) = (TreeFormat::Goblin, Content::Model);
    FileHeader { format, content, dimension: Dimension::Oct, depth: grid.depth(), layers: 0 }
}
