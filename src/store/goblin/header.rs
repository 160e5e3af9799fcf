//! The fixed header at the start of a Goblin file, and the trailer at its end.

use std::path::Path;

use zerocopy::little_endian::{U16, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::shape::Shape;
use crate::store::TreeFormat;
use crate::value::{Kind, Rule, SampleType, ValueType};
use crate::{Error, Result};

/// Last bytes of every Goblin file.
pub(in crate::store) const END_MAGIC: [u8; 8] = *b"\nnilboG\x93";
/// Readers refuse files of a newer major version.
pub(in crate::store) const MAJOR: u16 = 1;
pub(in crate::store) const MINOR: u16 = 0;

/// How records are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Codec {
    /// Not at all: mapped records are used where they stand.
    Plain,
}

impl Codec {
    /// The codec's name.
    pub fn name(self) -> &'static str {
        "plain"
    }
}

/// What the first 60 bytes of a file say.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// 2 for a quadtree, 3 for an octree.
    pub axes: u8,
    /// Type of the values.
    pub value: ValueType,
    /// How representatives were made.
    pub rule: Rule,
    /// What the values mean.
    pub kind: Kind,
    /// How records are packed.
    pub codec: Codec,
    /// How the tree is cut into segments.
    pub shape: Shape,
    /// Cells along each axis that can be other than VOID: the picture's size.
    pub extent: [u64; 3],
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawHeader {
    magic: [u8; 8],
    major: U16,
    minor: U16,
    axes: u8,
    sample: u8,
    channels: u8,
    rule: u8,
    kind: u8,
    codec: u8,
    depth: u8,
    reach: u8,
    stride: u8,
    zero: [u8; 3],
    light: U32,
    zero2: U32,
    extent: [U64; 3],
    checksum: U32,
}

/// Bytes of the header.
pub(in crate::store) const HEADER_SIZE: usize = size_of::<RawHeader>();
const _: () = assert!(HEADER_SIZE == 60);

impl Header {
    pub(in crate::store) fn to_bytes(&self, format: TreeFormat) -> Vec<u8> {
        let mut raw = RawHeader {
            magic: format.magic(),
            major: MAJOR.into(),
            minor: MINOR.into(),
            axes: self.axes,
            sample: self.value.sample as u8,
            channels: self.value.channels,
            rule: self.rule as u8,
            kind: self.kind as u8,
            codec: self.codec as u8,
            depth: self.shape.depth,
            reach: self.shape.reach,
            stride: self.shape.stride,
            zero: [0; 3],
            light: self.shape.light.into(),
            zero2: 0.into(),
            extent: self.extent.map(U64::new),
            checksum: 0.into(),
        };
        raw.checksum = crc32c::crc32c(&raw.as_bytes()[..HEADER_SIZE - 4]).into();
        raw.as_bytes().to_vec()
    }

    /// Checks and understands the first bytes of a file of either format.
    pub(in crate::store) fn from_bytes(path: &Path, bytes: &[u8]) -> Result<(TreeFormat, Header)> {
        let corrupt = |found: String, expected: &str| Error::corrupt(path, "header", found, expected);
        let Ok((raw, _)) = RawHeader::ref_from_prefix(bytes) else {
            return Err(corrupt(format!("{} bytes", bytes.len()), "a tree file of at least 60 bytes"));
        };
        let format =
            [TreeFormat::Goblin, TreeFormat::Autumnal].into_iter().find(|format| format.magic() == raw.magic);
        let Some(format) = format else {
            let found = format!("`{}`", raw.magic.escape_ascii());
            return Err(corrupt(
                found,
                "the first bytes of a tree file, `\\x93Goblin\\n` or `\\x93Autumn\\n`",
            ));
        };
        if raw.major.get() != MAJOR {
            let advice = format!("this program reads version {MAJOR}; use one that is as new as the file");
            return Err(Error::unsupported(path, format!("{} version {}", format.name(), raw.major), advice));
        }
        let checksum = crc32c::crc32c(&bytes[..HEADER_SIZE - 4]);
        if raw.checksum.get() != checksum {
            let found = format!("checksum {checksum:08x}");
            return Err(corrupt(found, &format!("{:08x}", raw.checksum)));
        }
        let number = |name: &str, number: u8, expected: &str| corrupt(format!("{name} {number}"), expected);
        let sample = SampleType::ALL.get(raw.sample as usize);
        let rule = Rule::ALL.get(raw.rule as usize);
        let most = match raw.axes {
            2 => 29,
            3 => 19,
            _ => return Err(number("axes", raw.axes, "2 or 3")),
        };
        let shape = Shape { depth: raw.depth, reach: raw.reach, stride: raw.stride, light: raw.light.get() };
        if shape.depth > most {
            return Err(number("depth", raw.depth, &format!("at most {most}")));
        }
        // So that a block of 2^reach cells along each axis has at most 2^24 cells.
        let most = 24 / raw.axes;
        let fits = (1..shape.reach).contains(&shape.stride)
            && shape.reach <= most
            && shape.reach.is_multiple_of(shape.stride)
            && (1..=1 << 20).contains(&shape.light);
        if !fits {
            return Err(corrupt(
                format!("segments {shape:?}"),
                &format!("stride < reach <= {most}, light <= 2^20"),
            ));
        }
        let extent = raw.extent.map(|cells| cells.get());
        let side = 1u64 << shape.depth;
        let axes = raw.axes as usize;
        let good = |(axis, cells): (usize, &u64)| *cells > 0 && *cells <= if axis < axes { side } else { 1 };
        if !extent.iter().enumerate().all(good) {
            return Err(corrupt(format!("extent {extent:?}"), "1 to 2^depth cells along every axis"));
        }
        let header = Header {
            axes: raw.axes,
            value: ValueType {
                sample: *sample.ok_or_else(|| number("sample type", raw.sample, "0 to 6"))?,
                channels: raw.channels,
            },
            rule: *rule.ok_or_else(|| number("rule", raw.rule, "0 to 5"))?,
            kind: match raw.kind {
                0 => Kind::Categorical,
                1 => Kind::Continuous,
                other => return Err(number("kind", other, "0 or 1")),
            },
            codec: match raw.codec {
                0 => Codec::Plain,
                other => {
                    let advice = "read it with a program that has this codec";
                    return Err(Error::unsupported(path, format!("codec number {other}"), advice));
                }
            },
            shape,
            extent,
        };
        Ok((format, header))
    }
}

/// A section at the end of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::store) struct Section {
    pub(in crate::store) offset: u64,
    pub(in crate::store) length: u64,
    pub(in crate::store) checksum: u32,
}

/// What the end of a file says: the root, totals, and where the sections are.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::store) struct Trailer {
    /// State of the root: VOID, LEAF or INNER.
    pub(in crate::store) root_state: u8,
    /// Value or representative of the root, as on disk, padded with zeros.
    pub(in crate::store) root_value: [u8; 32],
    /// Segments, which is the number of directory entries.
    pub(in crate::store) segments: u64,
    /// Records in all segments, those stored more than once included.
    pub(in crate::store) stored_records: u64,
    pub(in crate::store) directory: Section,
    pub(in crate::store) metadata: Section,
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
    root_state: u8,
    zero: [u8; 7],
    root_value: [u8; 32],
    segments: U64,
    stored_records: U64,
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

const DIRECTORY: [u8; 4] = *b"DIRE";
const METADATA: [u8; 4] = *b"META";
/// A trailer with more bytes than this is not believed.
const TRAILER_MOST: usize = 4096;
/// Bytes from the end of a file that are sure to hold the trailer.
pub(in crate::store) const TAIL: usize = TRAILER_MOST + size_of::<RawEnd>();

impl Trailer {
    /// The trailer of a file that has `before` bytes so far.
    pub(in crate::store) fn to_bytes(&self, before: u64) -> Vec<u8> {
        let sections = [(DIRECTORY, self.directory), (METADATA, self.metadata)];
        let length = size_of::<RawTrailer>() + sections.len() * size_of::<RawSection>();
        let raw = RawTrailer {
            root_state: self.root_state,
            zero: [0; 7],
            root_value: self.root_value,
            segments: self.segments.into(),
            stored_records: self.stored_records.into(),
            file_length: (before + (length + size_of::<RawEnd>()) as u64).into(),
            sections: (sections.len() as u32).into(),
        };
        let mut bytes = raw.as_bytes().to_vec();
        for (tag, section) in sections {
            let raw = RawSection {
                tag,
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

    /// Checks and understands the last bytes of a file of `file_length` bytes.
    pub(in crate::store) fn from_bytes(path: &Path, tail: &[u8], file_length: u64) -> Result<Trailer> {
        let corrupt = |found: String, expected: &str| Error::corrupt(path, "trailer", found, expected);
        let Ok((rest, end)) = RawEnd::ref_from_suffix(tail) else {
            return Err(corrupt(format!("{} bytes", tail.len()), "at least 16 bytes"));
        };
        if end.magic != END_MAGIC {
            let found = format!("`{}` at the end", end.magic.escape_ascii());
            return Err(corrupt(found, "the last bytes of a Goblin file (is the file cut short?)"));
        }
        let length = end.length.get() as usize;
        let Some(body) = rest.len().checked_sub(length).map(|start| &rest[start..]) else {
            return Err(corrupt(format!("a length of {length}"), "one that fits the file"));
        };
        let checksum = crc32c::crc32c(body);
        if checksum != end.checksum.get() {
            return Err(corrupt(format!("checksum {checksum:08x}"), &format!("{:08x}", end.checksum)));
        }
        let Ok((raw, sections)) = RawTrailer::ref_from_prefix(body) else {
            return Err(corrupt(format!("a length of {length}"), "a whole trailer"));
        };
        if raw.file_length.get() != file_length {
            let expected = format!("{} bytes", raw.file_length);
            return Err(corrupt(format!("a file of {file_length} bytes"), &expected));
        }
        if raw.root_state > super::record::INNER {
            return Err(corrupt(format!("root state {}", raw.root_state), "0, 1 or 2"));
        }
        let mut trailer = Trailer {
            root_state: raw.root_state,
            root_value: raw.root_value,
            segments: raw.segments.get(),
            stored_records: raw.stored_records.get(),
            directory: Section::default(),
            metadata: Section::default(),
        };
        let count = raw.sections.get() as usize;
        let Ok(list) = <[RawSection]>::ref_from_bytes_with_elems(sections, count) else {
            return Err(corrupt(format!("{count} sections"), "as many as fit the trailer"));
        };
        for raw in list {
            let section =
                Section { offset: raw.offset.get(), length: raw.length.get(), checksum: raw.checksum.get() };
            let end = section.offset.checked_add(section.length);
            if end.is_none_or(|end| end > file_length) {
                return Err(corrupt(
                    format!("section {} at {}, {} bytes", raw.tag.escape_ascii(), raw.offset, raw.length),
                    "sections inside the file",
                ));
            }
            match raw.tag {
                DIRECTORY => trailer.directory = section,
                METADATA => trailer.metadata = section,
                // Sections of later minor versions.
                _ => {}
            }
        }
        Ok(trailer)
    }
}
