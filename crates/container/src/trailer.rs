//! The trailer at the end of a Goblin file: a copy of the file header, and the locations of the
//! sections.

use std::borrow::Cow;
use std::io::{self, Write};
use std::ops::Range;
use std::path::Path;

use zerocopy::little_endian::{U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::file_header::{FileHeader, HEADER_SIZE};
use spinney_base::io::{Output, ReadBackend};
use spinney_base::{Error, Result};

/// Last bytes of every Goblin file.
const END_MAGIC: [u8; 8] = *b"\nnilboG\x93";

/// Location of a section in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Section {
    /// Offset of the first byte in the file.
    pub offset: u64,
    /// Number of bytes.
    pub length: u64,
    /// CRC-32C of the bytes.
    pub checksum: u32,
}

impl Section {
    /// Byte range in the file.
    pub fn range(&self) -> Range<u64> {
        self.offset..self.offset + self.length
    }

    /// Reads the section and verifies its checksum. The section must lie inside the file, which
    /// decoding the trailer has checked.
    pub fn read<'f>(&self, path: &Path, backend: &'f dyn ReadBackend, name: &str) -> Result<Cow<'f, [u8]>> {
        let bytes = backend.read(self.offset, self.length as usize)?;
        let checksum = crc32c::crc32c(&bytes);
        if checksum != self.checksum {
            let found = format!("checksum {checksum:08x}");
            return Err(Error::corrupt(path, name, found, format!("{:08x}", self.checksum)));
        }
        Ok(bytes)
    }
}

/// The decoded trailer.
#[derive(Clone, Debug, PartialEq)]
pub struct Trailer {
    /// Copy of the file header: a reader that has the end of a file needs no other bytes to start.
    pub header: FileHeader,
    /// Sections by tag.
    pub sections: Vec<([u8; 4], Section)>,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned, Clone, Copy)]
#[repr(C)]
struct RawSection {
    tag: [u8; 4],
    checksum: U32,
    offset: U64,
    length: U64,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawTrailer {
    header: [u8; HEADER_SIZE],
    file_length: U64,
    sections: U32,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawEnd {
    length: U32,
    checksum: U32,
    magic: [u8; 8],
}

/// Maximum bytes of a trailer. Readers reject longer ones.
const MAX_TRAILER: usize = 4096;
/// Number of bytes at the end of a file that always contain the trailer.
pub const TAIL: usize = MAX_TRAILER + size_of::<RawEnd>();

impl Trailer {
    /// Returns the section with this tag, or an empty one if there is none.
    pub fn section(&self, tag: [u8; 4]) -> Section {
        let found = self.sections.iter().find(|(name, _)| *name == tag);
        found.map_or(Section::default(), |(_, section)| *section)
    }

    /// Encodes the trailer of a file that has `before` bytes so far.
    pub fn to_bytes(&self, before: u64) -> Vec<u8> {
        let length = size_of::<RawTrailer>() + self.sections.len() * size_of::<RawSection>();
        let raw = RawTrailer {
            header: self.header.to_bytes(),
            file_length: (before + (length + size_of::<RawEnd>()) as u64).into(),
            sections: (self.sections.len() as u32).into(),
        };
        let mut bytes = raw.as_bytes().to_vec();
        for (tag, section) in &self.sections {
            let raw = RawSection {
                tag: *tag,
                checksum: section.checksum.into(),
                offset: section.offset.into(),
                length: section.length.into(),
            };
            bytes.extend_from_slice(raw.as_bytes());
        }
        let checksum = crc32c::crc32c(&bytes);
        let end = RawEnd { length: (length as u32).into(), checksum: checksum.into(), magic: END_MAGIC };
        bytes.extend_from_slice(end.as_bytes());
        bytes
    }

    /// Checks and decodes the trailer from the last bytes of a file of `file_length` bytes.
    pub fn from_bytes(path: &Path, tail: &[u8], file_length: u64) -> Result<Trailer> {
        let corrupt = |found: String, expected: &str| Error::corrupt(path, "trailer", found, expected);
        let Ok((rest, end)) = RawEnd::ref_from_suffix(tail) else {
            return Err(corrupt(format!("{} bytes", tail.len()), "at least 16 bytes"));
        };
        if end.magic != END_MAGIC {
            let found = format!("`{}` at the end", end.magic.escape_ascii());
            return Err(corrupt(found, "the end mark of a Goblin file (is the file cut short?)"));
        }
        let length = end.length.get() as usize;
        let Some(body) = rest.len().checked_sub(length).map(|start| &rest[start..]) else {
            return Err(corrupt(format!("a trailer length of {length}"), "a length within the file"));
        };
        let checksum = crc32c::crc32c(body);
        if checksum != end.checksum.get() {
            return Err(corrupt(format!("checksum {checksum:08x}"), &format!("{:08x}", end.checksum)));
        }
        let Ok((raw, sections)) = RawTrailer::ref_from_prefix(body) else {
            return Err(corrupt(format!("a trailer length of {length}"), "the length of a complete trailer"));
        };
        if raw.file_length.get() != file_length {
            let expected = format!("{} bytes", raw.file_length);
            return Err(corrupt(format!("a file of {file_length} bytes"), &expected));
        }
        let header = FileHeader::from_bytes(path, &raw.header)?;
        let mut trailer = Trailer { header, sections: Vec::new() };
        let count = raw.sections.get() as usize;
        let Ok(list) = <[RawSection]>::ref_from_bytes_with_elems(sections, count) else {
            return Err(corrupt(format!("{count} sections"), "the number that the trailer's length allows"));
        };
        for raw in list {
            let section =
                Section { offset: raw.offset.get(), length: raw.length.get(), checksum: raw.checksum.get() };
            let end = section.offset.checked_add(section.length);
            if end.is_none_or(|end| end > file_length) {
                return Err(corrupt(
                    format!("section {} of {} bytes at {}", raw.tag.escape_ascii(), raw.length, raw.offset),
                    "sections inside the file",
                ));
            }
            // Keeps unknown sections, too, which later minor versions may add.
            trailer.sections.push((raw.tag, section));
        }
        Ok(trailer)
    }
}

/// Forwards the bytes of a section to the output, and computes their count and checksum.
pub struct SectionWriter<'a> {
    out: &'a mut Output,
    /// Location and checksum of the bytes written so far.
    pub written: Section,
}

impl SectionWriter<'_> {
    /// Creates a writer of a section that starts at this offset in the file.
    pub fn new(out: &mut Output, offset: u64) -> SectionWriter<'_> {
        SectionWriter { out, written: Section { offset, length: 0, checksum: 0 } }
    }
}

impl Write for SectionWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.out.write(bytes)?;
        self.written.length += count as u64;
        self.written.checksum = crc32c::crc32c_append(self.written.checksum, &bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
