//! Reader of block files: header, trailer, metadata, lists and block bytes.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::{BlockLocation, METADATA};
use crate::{Content, FileHeader, HEADER_SIZE, List, Metadata, OpenOptions, TAIL, Trailer};
use spinney_base::io::{FileAccess, FileBytes, ReadBackend};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Result};

/// An open block file.
pub struct BlockFile {
    path: PathBuf,
    backend: Box<dyn ReadBackend>,
    header: FileHeader,
    trailer: Trailer,
    metadata: Metadata,
    check: bool,
    bytes: u64,
}

impl BlockFile {
    /// Returns whether the file has this content. The file name does not matter.
    ///
    /// # Errors
    /// If the file system or the host of the file fails: see [`FileHeader::find`].
    pub fn has_content(path: &Path, content: Content, access: &FileAccess) -> Result<bool> {
        Ok(FileHeader::find(path, access)?.is_some_and(|header| header.content == content))
    }

    /// Opens the block file that a backend reads and checks its content. `path` and `noun` are for
    /// messages only.
    ///
    /// # Errors
    /// If it cannot be read, has other content, or is corrupt.
    pub fn open(
        path: &Path,
        backend: Box<dyn ReadBackend>,
        (content, noun): (Content, &str),
        options: &OpenOptions,
    ) -> Result<BlockFile> {
        let backend = options.access.cached(backend);
        let header = FileHeader::read(path, &*backend)?;
        if header.content != content {
            return Err(Error::corrupt(
                path,
                "header",
                format!("content {}", header.content as u8),
                format!("{} ({noun})", content as u8),
            ));
        }
        let bytes = backend.len();
        let tail = bytes.min(TAIL as u64);
        let trailer = Trailer::from_bytes(path, &backend.read(bytes - tail, tail as usize)?, bytes)?;
        if trailer.header != header {
            return Err(Error::corrupt(path, "trailer", "a different header", "a copy of the file's header"));
        }
        Metadata::check_length(path, trailer.section(METADATA).length)?;
        let metadata =
            Metadata::from_bytes(path, &trailer.section(METADATA).read(path, &*backend, "metadata")?)?;
        let (path, check) = (path.to_path_buf(), options.check);
        Ok(BlockFile { path, backend, header, trailer, metadata, check, bytes })
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The backend that reads the file's bytes.
    pub fn backend(&self) -> &dyn ReadBackend {
        &*self.backend
    }

    /// The header.
    pub fn header(&self) -> &FileHeader {
        &self.header
    }

    /// Coordinate reference system, provenance and tags.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// File size in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Creates an error about a location in this file.
    pub fn corrupt(
        &self,
        place: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Error {
        Error::corrupt(&self.path, place, found, expected)
    }

    /// Reads a section of at most 16 MiB, the limit of the metadata.
    ///
    /// # Errors
    /// If it is longer, corrupt or cannot be read.
    pub fn section(&self, tag: [u8; 4], name: &str) -> Result<Vec<u8>> {
        let section = self.trailer.section(tag);
        Metadata::check_length(&self.path, section.length)?;
        Ok(section.read(&self.path, self.backend(), name)?.into_owned())
    }

    /// Opens a list with entries of `entry` bytes.
    ///
    /// # Errors
    /// Those of [`List::open`].
    pub fn list(&self, tag: [u8; 4], name: &str, entry: usize) -> Result<List> {
        List::open(&self.path, self.backend(), (self.trailer.section(tag), name), entry)
    }

    /// Offset of the end of the blocks, where the list with this tag begins.
    pub fn end(&self, tag: [u8; 4]) -> u64 {
        self.trailer.section(tag).offset
    }

    /// Checks that the node codes are valid in the tree and strictly ascending.
    ///
    /// # Errors
    /// If they are not.
    pub fn check_nodes(&self, nodes: &List, (dimension, deepest): (Dimension, u8)) -> Result<()> {
        let mut before = None;
        for index in 0..nodes.len() {
            let code = nodes.code(self.backend(), index);
            let fits = Code::from_bits(dimension, code).is_some_and(|code| code.level() <= deepest);
            if before.is_some_and(|before| before >= code) || !fits {
                let expected = "ascending codes of nodes of the tree";
                return Err(self.corrupt(format!("node {index}"), format!("code {code:x}"), expected));
            }
            before = Some(code);
        }
        Ok(())
    }

    /// Checks that every block of a list belongs to a node.
    ///
    /// # Errors
    /// If a block does not.
    pub fn check_keys(&self, blocks: &List, nodes: &List) -> Result<()> {
        let mut node = 0;
        for index in 0..blocks.len() {
            let key = blocks.code(self.backend(), index);
            node = nodes.find(self.backend(), node, key);
            if nodes.code(self.backend(), node) != key {
                return Err(self.corrupt(
                    format!("block {index}"),
                    format!("code {key:x}"),
                    "the code of a node, in ascending order",
                ));
            }
        }
        Ok(())
    }

    /// Checks the blocks of some lists, given as name, list and maximum item count of a block.
    ///
    /// All blocks must lie between the header and `end` and have 1 to that many items. Their total
    /// size must not exceed `end`. Every block is stored once, so this bounds the work of a scan
    /// over all blocks by the file size.
    ///
    /// # Errors
    /// If a block violates this, or their total size does.
    pub fn check_blocks(&self, lists: &[(&str, &List, usize)], end: u64) -> Result<()> {
        let mut sum = 0u64;
        for (name, list, most) in lists {
            for index in 0..list.len() {
                let entry = BlockLocation::from_bytes(self.entry(list, index));
                let last = entry.offset.checked_add(entry.length.into());
                let is_inside = last.is_some_and(|last| entry.offset >= HEADER_SIZE as u64 && last <= end);
                if !is_inside || !(1..=*most as u32).contains(&entry.count) {
                    let found =
                        format!("{} items in {} bytes at {}", entry.count, entry.length, entry.offset);
                    return Err(self.corrupt(
                        format!("{name} {index}"),
                        found,
                        format!("1 to {most} items in bytes before the lists"),
                    ));
                }
                // A list has fewer than 2^32 entries of less than 2^32 bytes each: the sum cannot
                // overflow.
                sum += u64::from(entry.length);
            }
        }
        if sum > end {
            let found = format!("{sum} bytes of blocks");
            return Err(self.corrupt("lists of blocks", found, format!("at most {end}")));
        }
        Ok(())
    }

    /// The bytes of a list entry; empty if a mapped file was truncated since it was opened.
    pub fn entry<'f>(&'f self, list: &'f List, index: usize) -> &'f [u8] {
        list.get(self.backend(), index).unwrap_or_default()
    }

    /// Index range of a node's blocks.
    pub fn blocks_of(&self, blocks: &List, code: Code) -> Range<usize> {
        let first = blocks.find(self.backend(), 0, code.bits());
        first..blocks.find(self.backend(), first, code.bits() + 1)
    }

    /// Indices in the node list of a node's children, in order.
    pub fn children(&self, nodes: &List, (index, code): (usize, Code), deepest: u8) -> Vec<usize> {
        let mut children = Vec::new();
        if code.level() >= deepest {
            return children;
        }
        let mut from = index + 1;
        for child in 0..code.dimension().children() {
            let code = code.child(child).bits();
            from = nodes.find(self.backend(), from, code);
            if nodes.code(self.backend(), from) == code {
                children.push(from);
            }
        }
        children
    }

    /// Reads a block and, unless checks are off, verifies its checksum.
    ///
    /// # Errors
    /// If it cannot be read, or the checksum differs.
    pub fn block(&self, place: &str, entry: &BlockLocation) -> Result<FileBytes<'_>> {
        if entry.offset + u64::from(entry.length) > self.backend.len() {
            return Err(self.corrupt(place, "the end of the file", "the block (was the file cut short?)"));
        }
        let bytes = self.backend.share(entry.offset, entry.length as usize)?;
        if self.check {
            let found = crc32c::crc32c(&bytes);
            if found != entry.checksum {
                let expected = format!("{:08x}", entry.checksum);
                return Err(self.corrupt(place, format!("checksum {found:08x}"), expected));
            }
        }
        Ok(bytes)
    }
}
