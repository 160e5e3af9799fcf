//! Reads files of blocks: header, trailer and metadata, lists, and the bytes of blocks.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::{BlockLocation, METADATA};
use crate::{Content, FileHeader, HEADER_SIZE, List, Metadata, OpenOptions, TAIL, Trailer};
use spinney_base::io::{FileAccess, FileBytes, ReadBackend};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Result};

/// A file of blocks that is open.
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
    /// Whether a file has some content, whatever its name.
    ///
    /// # Errors
    /// If the file system or the host of the file fails: see [`FileHeader::find`].
    pub fn has_content(path: &Path, content: Content, access: &FileAccess) -> Result<bool> {
        Ok(FileHeader::find(path, access)?.is_some_and(|header| header.content == content))
    }

    /// Opens whatever a backend reads, which has some content, in a noun; `path` is for messages.
    ///
    /// # Errors
    /// If it cannot be read, has other content, or is damaged.
    pub fn open(
        path: &Path,
        backend: Box<dyn ReadBackend>,
        (content, noun): (Content, &str),
        options: &OpenOptions,
    ) -> Result<BlockFile> {
        let backend = options.access.cached(backend);
        let header = FileHeader::read(path, &*backend)?;
        if header.content != content {
            return Err(Error::corrupt(path, "header", "a file of other content", noun));
        }
        let bytes = backend.len();
        let tail = bytes.min(TAIL as u64);
        let trailer = Trailer::from_bytes(path, &backend.read(bytes - tail, tail as usize)?, bytes)?;
        if trailer.header != header {
            return Err(Error::corrupt(path, "trailer", "another header", "the file's own"));
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

    /// How its bytes are read.
    pub fn backend(&self) -> &dyn ReadBackend {
        &*self.backend
    }

    /// The header.
    pub fn header(&self) -> &FileHeader {
        &self.header
    }

    /// Coordinate system, provenance and tags.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Bytes of the file.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// An error at a place of the file.
    pub fn corrupt(
        &self,
        place: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Error {
        Error::corrupt(&self.path, place, found, expected)
    }

    /// The bytes of a section, of which no more are read than of metadata.
    ///
    /// # Errors
    /// If it is longer, damaged or cannot be read.
    pub fn section(&self, tag: [u8; 4], name: &str) -> Result<Vec<u8>> {
        let section = self.trailer.section(tag);
        Metadata::check_length(&self.path, section.length)?;
        Ok(section.read(&self.path, self.backend(), name)?.into_owned())
    }

    /// A list with entries of so many bytes.
    ///
    /// # Errors
    /// Those of [`List::open`].
    pub fn list(&self, tag: [u8; 4], name: &str, entry: usize) -> Result<List> {
        List::open(&self.path, self.backend(), (self.trailer.section(tag), name), entry)
    }

    /// The first byte behind the blocks: that of the list with a tag.
    pub fn end(&self, tag: [u8; 4]) -> u64 {
        self.trailer.section(tag).offset
    }

    /// Checks that the codes of nodes are some of a tree, and ascend.
    ///
    /// # Errors
    /// If they do not.
    pub fn check_nodes(&self, nodes: &List, (dimension, deepest): (Dimension, u8)) -> Result<()> {
        let mut before = None;
        for index in 0..nodes.len() {
            let code = nodes.code(self.backend(), index);
            let fits = Code::from_bits(dimension, code).is_some_and(|code| code.level() <= deepest);
            if before.is_some_and(|before| before >= code) || !fits {
                let expected = "codes of the tree that ascend";
                return Err(self.corrupt(format!("node {index}"), format!("code {code:x}"), expected));
            }
            before = Some(code);
        }
        Ok(())
    }

    /// Checks that each block of a list is one of a node.
    ///
    /// # Errors
    /// If one is not.
    pub fn check_keys(&self, blocks: &List, nodes: &List) -> Result<()> {
        let mut node = 0;
        for index in 0..blocks.len() {
            let key = blocks.code(self.backend(), index);
            node = nodes.find(self.backend(), node, key);
            if nodes.code(self.backend(), node) != key {
                return Err(self.corrupt(
                    format!("block {index}"),
                    format!("code {key:x}"),
                    "codes of nodes, in order",
                ));
            }
        }
        Ok(())
    }

    /// Checks that the blocks of lists, which have things up to a number each, lie before a byte, and that there are no more bytes of blocks than those before it: blocks
    /// are stored once each, so that the work of going through all of them goes with the file's size.
    ///
    /// # Errors
    /// If one does not, or there are more.
    pub fn check_blocks(&self, lists: &[(&str, &List, usize)], end: u64) -> Result<()> {
        let mut sum = 0u64;
        for (name, list, most) in lists {
            for index in 0..list.len() {
                let entry = BlockLocation::from_bytes(self.entry(list, index));
                let last = entry.offset.checked_add(entry.length.into());
                let is_inside = last.is_some_and(|last| entry.offset >= HEADER_SIZE as u64 && last <= end);
                if !is_inside || !(1..=*most as u32).contains(&entry.count) {
                    let found = format!("{} in bytes {} + {}", entry.count, entry.offset, entry.length);
                    return Err(self.corrupt(
                        format!("{name} {index}"),
                        found,
                        "some in bytes before the lists",
                    ));
                }
                // (Lists have fewer than 2^32 entries of less than 2^32 bytes each.)
                sum += u64::from(entry.length);
            }
        }
        if sum > end {
            let found = format!("{sum} bytes of blocks");
            return Err(self.corrupt("lists of blocks", found, format!("at most {end}")));
        }
        Ok(())
    }

    /// The bytes of an entry of a list; none if a mapped file was cut short since.
    pub fn entry<'f>(&'f self, list: &'f List, index: usize) -> &'f [u8] {
        list.get(self.backend(), index).unwrap_or_default()
    }

    /// The blocks of a node.
    pub fn blocks_of(&self, blocks: &List, code: Code) -> Range<usize> {
        let first = blocks.find(self.backend(), 0, code.bits());
        first..blocks.find(self.backend(), first, code.bits() + 1)
    }

    /// Places in the list of the children that a node has, in order.
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

    /// The bytes of a block, with the right checksum.
    ///
    /// # Errors
    /// If they cannot be read, or have another one.
    pub fn block(&self, place: &str, entry: &BlockLocation) -> Result<FileBytes<'_>> {
        if entry.offset + u64::from(entry.length) > self.backend.len() {
            return Err(self.corrupt(place, "no bytes", "a file that nobody cuts short"));
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
