//! The header of a tree: value type, extent, and how the tree is cut into segments.

use std::path::Path;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use zerocopy::little_endian::{U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::shape::Shape;
use spinney_base::TreeType;
use spinney_base::space::{Bounds, Code, Dimension, Region};
use spinney_base::value::{DataKind, Mask, Rule, SampleType, ValueType};
use spinney_base::{Error, Result};

/// Compression of records.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Codec {
    /// Uncompressed: mapped records are used in place.
    #[default]
    Plain,
    /// Compressed: a segment is unpacked before use. In a tree with this codec, some segments may
    /// be packed.
    Packed,
    /// References to files of other formats, which have the cells. In a tree with this codec, the
    /// finest segments are references, and the others may be packed.
    Reference,
}

impl Codec {
    /// All codecs, indexed by their numbers in files.
    pub const ALL: [Codec; 3] = [Codec::Plain, Codec::Packed, Codec::Reference];

    /// The codec's name.
    pub fn name(self) -> &'static str {
        match self {
            Codec::Plain => "plain",
            Codec::Packed => "packed",
            Codec::Reference => "reference",
        }
    }

    /// Returns the codec with this number.
    ///
    /// # Errors
    /// If there is none. `what` is appended to the message.
    pub fn of_number(path: &Path, number: u8, what: &str) -> Result<Codec> {
        Codec::ALL.get(usize::from(number)).copied().ok_or_else(|| {
            let advice = "install the version of Spinney that wrote the file, or a newer one";
            Error::unsupported(path, format!("codec number {number}{what}"), advice)
        })
    }
}

impl FromStr for Codec {
    type Err = Error;

    fn from_str(name: &str) -> Result<Codec> {
        let codec = [Codec::Plain, Codec::Packed].into_iter().find(|codec| codec.name() == name);
        codec.ok_or_else(|| Error::invalid("codec", format!("`{name}`"), "plain or packed"))
    }
}

/// The decoded header of one tree of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Quadtree or octree, and the type of the values.
    pub form: TreeType,
    /// Rule that computes representatives.
    pub rule: Rule,
    /// Meaning of the values: categorical or continuous.
    pub kind: DataKind,
    /// Compression of records.
    pub codec: Codec,
    /// Parameters that cut the tree into segments.
    pub shape: Shape,
    /// Raster size: cells along each axis that can be other than VOID.
    pub extent: [u64; 3],
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawHeader {
    sample: u8,
    channels: u8,
    rule: u8,
    kind: u8,
    codec: u8,
    depth: u8,
    reach: u8,
    stride: u8,
    heavy_threshold: U32,
    /// 1 if single samples can be missing, 2 if the last channel is opacity, else 0.
    mask: u8,
    zero: [u8; 3],
    missing: [u8; 8],
    extent: [U64; 3],
}

/// Bytes of a tree's header.
pub(crate) const TREE_HEADER_SIZE: usize = size_of::<RawHeader>();
const _: () = assert!(TREE_HEADER_SIZE == 48);

/// Retired numbers of `f64`, `u64` and `i64`, from when their statistics stored sums of squares in
/// 16 bytes instead of 24.
const OLD_NUMBERS: [u8; 3] = [6, 8, 9];

/// The number of a sample type in headers.
const fn number_of(sample: SampleType) -> u8 {
    match sample {
        SampleType::F64 => 10,
        SampleType::U64 => 11,
        SampleType::I64 => 12,
        other => other as u8,
    }
}

impl Header {
    /// Levels below the root.
    #[inline]
    pub fn depth(&self) -> u8 {
        self.shape.depth
    }

    /// Bounds of the extent: all cells that can be other than VOID.
    #[inline]
    pub fn extent_bounds(&self) -> Bounds {
        Bounds::of_extent(self.extent)
    }

    /// Intersects a box with the extent; returns the whole extent if there is no box.
    #[inline]
    pub fn within_extent(&self, bounds: Option<Bounds>) -> Bounds {
        let extent = self.extent_bounds();
        bounds.map_or(extent, |bounds| bounds.intersect(&extent))
    }

    /// Returns the part of the extent that a node of a quadtree covers.
    pub fn region_of(&self, code: Code) -> Region {
        let shift = self.depth() - code.level();
        let [x, y, _] = code.cell().map(|cell| u64::from(cell) << shift);
        let side = |axis: usize, start: u64| (1 << shift).min(self.extent[axis].saturating_sub(start));
        Region::new(x, y, side(0, x), side(1, y))
    }

    /// Returns whether the segments of nodes at a level are references.
    #[inline]
    pub fn is_referenced(&self, level: u8) -> bool {
        self.codec == Codec::Reference && level == self.shape.block_level()
    }

    /// Returns whether zonal statistics count classes.
    #[inline]
    pub fn counts_classes(&self) -> bool {
        self.kind == DataKind::Categorical || self.rule == Rule::Majority
    }

    /// Encodes the header, the same way in both formats.
    pub fn to_bytes(&self) -> [u8; 48] {
        let (mask, missing) = match self.form.value.mask {
            Mask::None => (0, [0; 8]),
            Mask::Missing(sample) => (1, sample),
            Mask::Alpha => (2, [0; 8]),
        };
        let raw = RawHeader {
            sample: number_of(self.form.value.sample),
            channels: self.form.value.channels,
            rule: self.rule as u8,
            kind: self.kind as u8,
            codec: self.codec as u8,
            depth: self.shape.depth,
            reach: self.shape.reach,
            stride: self.shape.stride,
            heavy_threshold: self.shape.heavy_threshold.into(),
            mask,
            zero: [0; 3],
            missing,
            extent: self.extent.map(U64::new),
        };
        raw.as_bytes().try_into().expect("as long as it is")
    }

    /// Checks and decodes the header of one tree of a file. The file header provides the dimension
    /// and the maximum depth. `place` names the header in messages.
    ///
    /// # Errors
    /// If a number is unknown or contradicts another.
    pub fn from_bytes(
        path: &Path,
        place: &str,
        bytes: &[u8; 48],
        (dimension, most_depth): (Dimension, u8),
    ) -> Result<Header> {
        let corrupt = |found: String, expected: &str| Error::corrupt(path, place, found, expected);
        let raw = RawHeader::ref_from_bytes(bytes).expect("as long as it is");
        let number = |name: &str, number: u8, expected: &str| corrupt(format!("{name} {number}"), expected);
        let rule = Rule::ALL.get(raw.rule as usize);
        let heavy_threshold = raw.heavy_threshold.get();
        let codec = Codec::of_number(path, raw.codec, "")?;
        if codec == Codec::Reference && dimension != Dimension::Quad {
            return Err(number("codec", raw.codec, "0 or 1 in an octree"));
        }
        let shape = Shape { depth: raw.depth, reach: raw.reach, stride: raw.stride, heavy_threshold };
        if shape.depth > most_depth {
            return Err(number(
                "depth",
                raw.depth,
                &format!("at most {most_depth}, the depth in the file header"),
            ));
        }
        // These limits keep the record count of a segment within `skip`. A segment holds the
        // records of 2^reach cells along each axis, and those of up to children^stride candidates
        // that are not heavy.
        let (most, most_records) = if dimension == Dimension::Quad { (10, 1 << 20) } else { (8, 1 << 28) };
        let fits = (1..shape.reach).contains(&shape.stride)
            && shape.reach <= most
            && shape.reach.is_multiple_of(shape.stride)
            && (shape.heavy_threshold == 0) == (codec == Codec::Reference)
            && shape.heavy_threshold <= 1 << 20
            && u64::from(shape.heavy_threshold) << (usize::from(shape.stride) * dimension.axes())
                <= most_records;
        if !fits {
            return Err(corrupt(
                format!("segments {shape:?}"),
                &format!(
                    "stride < reach <= {most}, reach a multiple of stride, heavy threshold 1 to 2^20 (0 if cells are references), and heavy threshold * {}^stride <= {most_records}",
                    dimension.children()
                ),
            ));
        }
        let extent = raw.extent.map(|cells| cells.get());
        let side = 1u64 << shape.depth;
        let good = |(axis, cells): (usize, &u64)| {
            *cells > 0 && *cells <= if axis < dimension.axes() { side } else { 1 }
        };
        if !extent.iter().enumerate().all(good) {
            return Err(corrupt(format!("extent {extent:?}"), "1 to 2^depth cells along every axis"));
        }
        let sample = SampleType::ALL.into_iter().find(|sample| number_of(*sample) == raw.sample);
        let sample = match sample {
            Some(sample) => sample,
            None if OLD_NUMBERS.contains(&raw.sample) => {
                return Err(Error::unsupported(
                    path,
                    format!("{place}: the obsolete sample type {}", raw.sample),
                    "build the file again from its input, or export it with the version of Spinney that wrote it",
                ));
            }
            None => return Err(number("sample type", raw.sample, "0 to 5, 7, or 10 to 12")),
        };
        let mask = match raw.mask {
            0 => Mask::None,
            1 if raw.channels > 1 => Mask::Missing(raw.missing),
            2 if raw.channels > 1 => Mask::Alpha,
            other => return Err(number("mask", other, "0; 1 or 2 only with several channels")),
        };
        let value = ValueType { mask, ..ValueType::new(sample, raw.channels) };
        if !value.is_supported() {
            return Err(corrupt(
                format!("values {value}"),
                "1 to 4 channels of u8, u16 or f32, or 1 channel",
            ));
        }
        Ok(Header {
            form: TreeType::new(dimension, value),
            rule: *rule.ok_or_else(|| number("rule", raw.rule, "0 to 6"))?,
            kind: match raw.kind {
                0 => DataKind::Categorical,
                1 => DataKind::Continuous,
                other => return Err(number("kind", other, "0 or 1")),
            },
            codec,
            shape,
            extent,
        })
    }
}
