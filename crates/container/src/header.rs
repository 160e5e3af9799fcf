//! The fixed header at the start of tree files of both formats.

use std::path::Path;

use zerocopy::little_endian::{U16, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::shape::Shape;
use crate::other_formats::FIRST_BYTES;
use crate::{HEAVY_THRESHOLD, STRIDE, reach};
use crate::{OtherFormat, TreeFormat};
use spinney_base::Form;
use spinney_base::io::ReadBackend;
use spinney_base::space::{Bounds, Dimension};
use spinney_base::value::{Kind, Rule, SampleType, ValueType};
use spinney_base::{Error, Result};

/// Readers refuse files of a newer major version.
pub(crate) const MAJOR: u16 = 1;
pub(crate) const MINOR: u16 = 0;

/// Kind of a file that has an exact model instead of cells.
const MODEL: u8 = 2;

/// Packing of records.
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

/// The decoded header, the first 60 bytes of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Quadtree or octree, and the type of the values.
    pub form: Form,
    /// Rule of the representatives.
    pub rule: Rule,
    /// The meaning of the values.
    pub kind: Kind,
    /// Packing of records.
    pub codec: Codec,
    /// Numbers by which the tree is cut into segments.
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
    /// 1 if samples can be missing.
    has_missing: u8,
    zero: [u8; 2],
    heavy_threshold: U32,
    missing: [u8; 4],
    extent: [U64; 3],
    checksum: U32,
}

/// The sample that means that there is none, or zeros. (Only samples of at most four bytes come with several channels.)
fn missing_bytes(value: &ValueType) -> [u8; 4] {
    let [a, b, c, d, ..] = value.missing.unwrap_or_default();
    [a, b, c, d]
}

/// Bytes of the header.
pub const HEADER_SIZE: usize = size_of::<RawHeader>();
const _: () = assert!(HEADER_SIZE == 60);

impl Header {
    /// Levels below the root.
    #[inline]
    pub fn depth(&self) -> u8 {
        self.shape.depth
    }

    /// The picture: all cells that can be other than VOID.
    #[inline]
    pub fn picture(&self) -> Bounds {
        Bounds::picture(self.extent)
    }

    /// The part of a box that is in the picture; all of the picture if there is no box.
    #[inline]
    pub fn within_picture(&self, bounds: Option<Bounds>) -> Bounds {
        let picture = self.picture();
        bounds.map_or(picture, |bounds| bounds.intersect(&picture))
    }

    /// Whether classes are counted per zone.
    #[inline]
    pub fn counts_classes(&self) -> bool {
        self.kind == Kind::Categorical || self.rule == Rule::Majority
    }

    /// Reads and checks the header of a tree file of either format.
    ///
    /// # Errors
    /// If it cannot be read, or is that of no tree file that this program knows.
    pub fn read(path: &Path, file: &dyn ReadBackend) -> Result<(TreeFormat, Header)> {
        // (More than the header: what is no tree may be told by it.)
        let length = file.len().min(FIRST_BYTES as u64) as usize;
        Header::from_bytes(path, &file.read(0, length)?)
    }

    /// The header of an exact model, whose octree has this many levels.
    pub fn model_to_bytes(depth: u8) -> Vec<u8> {
        let form = Form::new(Dimension::Oct, ValueType::new(SampleType::U8, 1));
        // (These have nothing to say about where such files are cut.)
        let (reach, stride) = (reach(Dimension::Oct), STRIDE);
        let shape = Shape { depth, reach, stride, heavy_threshold: HEAVY_THRESHOLD };
        let (rule, kind, codec) = (Rule::Occupancy, Kind::Continuous, Codec::Plain);
        let header = Header { form, rule, kind, codec, shape, extent: [1 << depth; 3] };
        header.with_content(TreeFormat::Goblin, MODEL)
    }

    /// Reads and checks the header of an exact model; returns the levels of its octree.
    ///
    /// # Errors
    /// If it cannot be read, or is no such header.
    pub fn read_model(path: &Path, file: &dyn ReadBackend) -> Result<u8> {
        let length = file.len().min(HEADER_SIZE as u64) as usize;
        let (format, content, header) = Header::with_content_from(path, &file.read(0, length)?)?;
        if (format, content) != (TreeFormat::Goblin, MODEL) || header.form.dimension != Dimension::Oct {
            return Err(Error::corrupt(path, "header", "a tree of cells", "an exact model"));
        }
        Ok(header.depth())
    }

    /// The header's bytes, as they stand in a file of a format.
    pub fn to_bytes(&self, format: TreeFormat) -> Vec<u8> {
        self.with_content(format, self.kind as u8)
    }

    fn with_content(&self, format: TreeFormat, content: u8) -> Vec<u8> {
        let mut raw = RawHeader {
            magic: format.magic(),
            major: MAJOR.into(),
            minor: MINOR.into(),
            axes: self.form.axes() as u8,
            sample: self.form.value.sample as u8,
            channels: self.form.value.channels,
            rule: self.rule as u8,
            kind: content,
            codec: self.codec as u8,
            depth: self.shape.depth,
            reach: self.shape.reach,
            stride: self.shape.stride,
            has_missing: self.form.value.missing.is_some().into(),
            zero: [0; 2],
            heavy_threshold: self.shape.heavy_threshold.into(),
            missing: missing_bytes(&self.form.value),
            extent: self.extent.map(U64::new),
            checksum: 0.into(),
        };
        raw.checksum = crc32c::crc32c(&raw.as_bytes()[..HEADER_SIZE - 4]).into();
        raw.as_bytes().to_vec()
    }

    /// Checks and understands the first bytes of a tree file of either format.
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<(TreeFormat, Header)> {
        let (format, content, header) = Header::with_content_from(path, bytes)?;
        if content == MODEL {
            let advice = "make cells of it first (`spinney build MODEL.goblin --cells N -o CELLS.goblin`)";
            return Err(Error::unsupported(path, "an exact model, where cells are expected,", advice));
        }
        Ok((format, header))
    }

    /// Checks and understands the first bytes of a file: its format, what it contains (the number of a kind of
    /// values, or [`MODEL`]), and the rest.
    fn with_content_from(path: &Path, bytes: &[u8]) -> Result<(TreeFormat, u8, Header)> {
        let corrupt = |found: String, expected: &str| Error::corrupt(path, "header", found, expected);
        let formats = [TreeFormat::Goblin, TreeFormat::Autumnal];
        let format = formats.into_iter().find(|format| bytes.starts_with(&format.magic()));
        if format.is_none()
            && let Some(error) = OtherFormat::refuse_tree(path, bytes)
        {
            return Err(error);
        }
        let Ok((raw, _)) = RawHeader::ref_from_prefix(bytes) else {
            return Err(corrupt(format!("{} bytes", bytes.len()), "a tree file of at least 60 bytes"));
        };
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
        let dimension = Dimension::from_axes(raw.axes).ok_or_else(|| number("axes", raw.axes, "2 or 3"))?;
        let most = dimension.max_depth();
        let heavy_threshold = raw.heavy_threshold.get();
        let shape = Shape { depth: raw.depth, reach: raw.reach, stride: raw.stride, heavy_threshold };
        if shape.depth > most {
            return Err(number("depth", raw.depth, &format!("at most {most}")));
        }
        // So that skips can count the records of a segment: those of 2^reach cells along each axis, and of one candidate that
        // is not heavy in each of 2^stride parts.
        let (most, most_records) = if dimension == Dimension::Quad { (10, 1 << 20) } else { (8, 1 << 28) };
        let fits = (1..shape.reach).contains(&shape.stride)
            && shape.reach <= most
            && shape.reach.is_multiple_of(shape.stride)
            && (1..=1 << 20).contains(&shape.heavy_threshold)
            && u64::from(shape.heavy_threshold) << (shape.stride * raw.axes) <= most_records;
        if !fits {
            return Err(corrupt(
                format!("segments {shape:?}"),
                &format!(
                    "stride < reach <= {most}, heavy threshold <= 2^20, and times {}^stride <= {most_records}",
                    dimension.children()
                ),
            ));
        }
        let extent = raw.extent.map(|cells| cells.get());
        let side = 1u64 << shape.depth;
        let axes = raw.axes as usize;
        let good = |(axis, cells): (usize, &u64)| *cells > 0 && *cells <= if axis < axes { side } else { 1 };
        if !extent.iter().enumerate().all(good) {
            return Err(corrupt(format!("extent {extent:?}"), "1 to 2^depth cells along every axis"));
        }
        let sample = *sample.ok_or_else(|| {
            number("sample type", raw.sample, &format!("0 to {}", SampleType::ALL.len() - 1))
        })?;
        let missing = match raw.has_missing {
            0 => None,
            1 if raw.channels > 1 => {
                Some(std::array::from_fn(|byte| raw.missing.get(byte).copied().unwrap_or(0)))
            }
            other => {
                return Err(number("missing samples", other, "0, or 1 where there are several channels"));
            }
        };
        let value = ValueType { missing, ..ValueType::new(sample, raw.channels) };
        if !value.is_supported() {
            return Err(corrupt(
                format!("values {value}"),
                "1 to 4 channels of u8, u16 or f32, or 1 channel",
            ));
        }
        let header = Header {
            form: Form::new(dimension, value),
            rule: *rule.ok_or_else(|| number("rule", raw.rule, "0 to 6"))?,
            kind: match raw.kind {
                0 => Kind::Categorical,
                1 => Kind::Continuous,
                MODEL if format == TreeFormat::Goblin => Kind::Continuous,
                other => return Err(number("kind", other, "0, 1, or 2 for an exact model")),
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
        Ok((format, raw.kind, header))
    }
}
