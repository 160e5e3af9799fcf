//! Sequential writer of block files.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::{BlockLocation, METADATA};
use crate::{FileHeader, Metadata, SectionWriter, Trailer, check_goblin_name};
use spinney_base::io::{Output, Sorter};
use spinney_base::{Error, Result};

/// A block file that is being written.
pub struct BlockWriter {
    out: Output,
    path: PathBuf,
    header: FileHeader,
    position: u64,
}

impl BlockWriter {
    /// Starts a file and writes its header. `noun` names the content in messages.
    ///
    /// # Errors
    /// If the output has the name of another format, or cannot be written.
    pub fn new(out: Output, header: FileHeader, noun: &str) -> Result<BlockWriter> {
        let path = out.path().to_path_buf();
        check_goblin_name(&path, noun)?;
        let mut writer = BlockWriter { out, path, header, position: 0 };
        writer.write(&header.to_bytes(), "write the header")?;
        Ok(writer)
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, bytes: &[u8], doing: &'static str) -> Result<()> {
        self.out.write_all(bytes).map_err(Error::io(&self.path, doing))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    /// Writes a block of `count` items and returns its location for a list.
    ///
    /// # Errors
    /// If it has 4 GiB or more, or cannot be written.
    pub fn block(&mut self, key: u64, bytes: &[u8], count: u32) -> Result<BlockLocation> {
        let offset = self.position;
        let length = u32::try_from(bytes.len()).map_err(|_| Error::TooLarge {
            path: self.path.clone(),
            what: "a block".into(),
            needed: bytes.len() as u64,
            limit: u32::MAX.into(),
            advice: "leave out the largest items with --where".into(),
        })?;
        self.write(bytes, "write a block")?;
        Ok(BlockLocation { key, offset, length, checksum: crc32c::crc32c(bytes), count })
    }

    /// Writes the lists, a summary section, the metadata and the trailer, then commits the output
    /// file.
    ///
    /// # Errors
    /// If that fails.
    pub fn finish(
        self,
        lists: Vec<([u8; 4], Sorter)>,
        (tag, summary): ([u8; 4], Vec<u8>),
        metadata: &Metadata,
    ) -> Result<()> {
        let BlockWriter { mut out, path, header, mut position } = self;
        let metadata = metadata.to_bytes(&path)?;
        let mut sections = Vec::new();
        for (tag, list) in lists {
            let mut section = SectionWriter::new(&mut out, position);
            list.finish(&mut |entry| section.write_all(entry).map_err(Error::io(&path, "write a list")))?;
            position += section.written.length;
            sections.push((tag, section.written));
        }
        for (tag, bytes) in [(tag, summary), (METADATA, metadata)] {
            let mut section = SectionWriter::new(&mut out, position);
            section.write_all(&bytes).map_err(Error::io(&path, "write a section"))?;
            position += section.written.length;
            sections.push((tag, section.written));
        }
        let trailer = Trailer { header, sections };
        out.write_all(&trailer.to_bytes(position)).map_err(Error::io(&path, "write the trailer"))?;
        out.commit()
    }
}
