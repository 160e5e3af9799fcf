//! The file header of both formats: content type, dimension and depth.

use std::path::Path;

use zerocopy::little_endian::{U16, U32};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use crate::other_formats::FIRST_BYTES;
use crate::{OtherFormat, TreeFormat};
use spinney_base::io::{FileAccess, ReadBackend};
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};

/// Readers reject files of another major version.
pub(crate) const MAJOR: u16 = 1;
pub(crate) const MINOR: u16 = 0;

/// Content type of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// One or more trees of cells.
    Cells = 0,
    /// An exact model.
    Model = 2,
    /// A tree of points.
    Points = 3,
    /// A tree of lines.
    Lines = 4,
    /// A shard summary: input for merging the shards of a tree.
    Shard = 6,
}

/// The first 24 bytes of a file. The trailer of a Goblin file repeats them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileHeader {
    /// The file format.
    pub format: TreeFormat,
    /// The content type.
    pub content: Content,
    /// Dimension: quadtree or octree.
    pub dimension: Dimension,
    /// Depth of the file's space: levels below the root. Trees may have fewer.
    pub depth: u8,
    /// Number of trees in a Goblin file with cells. 0 in Autumnal files, whose commits record it,
    /// and in files with other content.
    pub layers: u32,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawFileHeader {
    magic: [u8; 8],
    major: U16,
    minor: U16,
    axes: u8,
    content: u8,
    depth: u8,
    zero: u8,
    layers: U32,
    checksum: U32,
}

/// Bytes of the file header.
pub const HEADER_SIZE: usize = size_of::<RawFileHeader>();
const _: () = assert!(HEADER_SIZE == 24);

/// Maximum number of layers in a file.
pub const MAX_LAYERS: u32 = 1 << 16;

impl FileHeader {
    /// Reads and checks the header of a tree file of either format and any content.
    ///
    /// # Errors
    /// If it cannot be read, or is not a known header.
    pub fn read(path: &Path, file: &dyn ReadBackend) -> Result<FileHeader> {
        // Read more than the header: the error names other formats by their first bytes.
        let length = file.len().min(FIRST_BYTES as u64) as usize;
        FileHeader::from_bytes(path, &file.read(0, length)?)
    }

    /// Returns the header of a file; `None` if the file is missing or has no known header.
    ///
    /// # Errors
    /// If the file system or the remote host fails, which says nothing about the file type.
    pub fn find(path: &Path, access: &FileAccess) -> Result<Option<FileHeader>> {
        let Some(file) = access.probe(path)? else { return Ok(None) };
        match FileHeader::read(path, &*file) {
            Err(Error::Corrupt { .. } | Error::Unsupported { .. } | Error::NotATree { .. }) => Ok(None),
            found => found.map(Some),
        }
    }

    /// Reads and checks the header of a file with cells.
    ///
    /// # Errors
    /// If it cannot be read, or the content is not cells.
    pub fn read_cells(path: &Path, file: &dyn ReadBackend) -> Result<FileHeader> {
        let header = FileHeader::read(path, file)?;
        header.check_cells(path)?;
        Ok(header)
    }

    /// Checks that the content is cells.
    ///
    /// # Errors
    /// If it is not.
    pub(crate) fn check_cells(&self, path: &Path) -> Result<()> {
        match self.content {
            Content::Cells => Ok(()),
            Content::Model => {
                let advice =
                    "build a tree of cells from it: `spinney build MODEL.goblin --cells N -o CELLS.goblin`";
                Err(Error::unsupported(path, "an exact model instead of a tree of cells", advice))
            }
            Content::Points => {
                let advice = "make a raster from it: `spinney transform POINTS.goblin -o OUT.goblin raster=mean,cell=1`";
                Err(Error::unsupported(path, "a tree of points instead of a tree of cells", advice))
            }
            Content::Shard => {
                let advice = "merge the shards of its job first: `spinney shard merge`";
                Err(Error::unsupported(path, "a shard summary instead of a tree of cells", advice))
            }
            Content::Lines => {
                let advice = "write its features (`spinney get LINES.goblin LINES.geojson`), and build a tree of cells from them";
                Err(Error::unsupported(path, "a tree of lines instead of a tree of cells", advice))
            }
        }
    }

    /// Encodes the header.
    pub fn to_bytes(&self) -> [u8; HEADER_SIZE] {
        let mut raw = RawFileHeader {
            magic: self.format.magic(),
            major: MAJOR.into(),
            minor: MINOR.into(),
            axes: self.dimension.axes() as u8,
            content: self.content as u8,
            depth: self.depth,
            zero: 0,
            layers: self.layers.into(),
            checksum: 0.into(),
        };
        raw.checksum = crc32c::crc32c(&raw.as_bytes()[..HEADER_SIZE - 4]).into();
        raw.as_bytes().try_into().expect("as long as it is")
    }

    /// Checks and decodes the first bytes of a file.
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<FileHeader> {
        let corrupt = |found: String, expected: &str| Error::corrupt(path, "header", found, expected);
        let formats = [TreeFormat::Goblin, TreeFormat::Autumnal];
        let format = formats.into_iter().find(|format| bytes.starts_with(&format.magic()));
        if format.is_none()
            && let Some(error) = OtherFormat::refuse_tree(path, bytes)
        {
            return Err(error);
        }
        let Ok((raw, _)) = RawFileHeader::ref_from_prefix(bytes) else {
            return Err(corrupt(format!("{} bytes", bytes.len()), "a tree file of at least 24 bytes"));
        };
        let Some(format) = format else {
            let found = format!("`{}`", raw.magic.escape_ascii());
            return Err(corrupt(found, "the signature of a tree file, `\\x93Goblin\\n` or `\\x93Autumn\\n`"));
        };
        if raw.major.get() != MAJOR {
            let advice = format!(
                "this program reads version {MAJOR}; install the version of Spinney that wrote the file, or a newer one"
            );
            return Err(Error::unsupported(path, format!("{} version {}", format.name(), raw.major), advice));
        }
        let checksum = crc32c::crc32c(&bytes[..HEADER_SIZE - 4]);
        if raw.checksum.get() != checksum {
            let found = format!("checksum {checksum:08x}");
            return Err(corrupt(found, &format!("{:08x}", raw.checksum)));
        }
        let number = |name: &str, number: u32, expected: &str| corrupt(format!("{name} {number}"), expected);
        let axes = raw.axes;
        let dimension = Dimension::from_axes(axes).ok_or_else(|| number("axes", axes.into(), "2 or 3"))?;
        let most = dimension.max_depth();
        if raw.depth > most {
            return Err(number("depth", raw.depth.into(), &format!("at most {most}")));
        }
        let content = match (raw.content, format) {
            (0, _) => Content::Cells,
            (2, TreeFormat::Goblin) => Content::Model,
            (3, TreeFormat::Goblin) => Content::Points,
            (4, TreeFormat::Goblin) => Content::Lines,
            (6, TreeFormat::Goblin) => Content::Shard,
            (other, _) => {
                let advice = "install the version of Spinney that wrote the file, or a newer one";
                return Err(Error::unsupported(path, format!("content number {other}"), advice));
            }
        };
        let layers = raw.layers.get();
        let fits = match (content, format) {
            (Content::Cells, TreeFormat::Goblin) => (1..=MAX_LAYERS).contains(&layers),
            _ => layers == 0,
        };
        if !fits {
            return Err(number(
                "layers",
                layers,
                &format!("1 to {MAX_LAYERS}, or 0 for files without layers"),
            ));
        }
        Ok(FileHeader { format, content, dimension, depth: raw.depth, layers })
    }
}
