//! The FD directory: where each segment is, and what is known of all the cells below its node.

use std::path::Path;

use zerocopy::little_endian::{U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use crate::space::{Code, Dimension};
use crate::value::{Sample, Sum, Tally, Value};
use crate::{Error, Result};

/// One entry of the directory, understood.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry<D: Dimension, V: Value> {
    /// The node that owns the segment.
    pub code: Code<D>,
    /// Where the segment's bytes start in the file.
    pub offset: u64,
    /// How many bytes they are: records, then class counts.
    pub length: u64,
    /// Records of the segment.
    pub records: u32,
    /// Class counts that follow the records.
    pub classes: u32,
    /// CRC-32C of the segment's bytes.
    pub checksum: u32,
    /// Zone statistics, but for the class counts, which stand in the segment.
    pub zone: Tally<V>,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawEntry {
    code: U64,
    offset: U64,
    length: U64,
    records: U32,
    classes: U32,
    checksum: U32,
    entry_checksum: U32,
    cells: U64,
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawChannel {
    min: U64,
    max: U64,
    sum: [u8; 16],
    squares: [u8; 16],
}

const ENTRY_CHECKSUM_AT: usize = 36;

/// Bytes of one entry for values of so many channels.
pub(in crate::store) fn entry_size(channels: usize) -> usize {
    size_of::<RawEntry>() + channels * size_of::<RawChannel>()
}

/// The code that an entry starts with, checked by nothing yet.
pub(in crate::store) fn code_bits(directory: &[u8], index: usize, size: usize) -> u64 {
    let start = index * size;
    u64::from_le_bytes(directory[start..start + 8].try_into().expect("8 bytes"))
}

impl<D: Dimension, V: Value> Entry<D, V> {
    pub(in crate::store) fn to_bytes(&self) -> Vec<u8> {
        let raw = RawEntry {
            code: self.code.bits().into(),
            offset: self.offset.into(),
            length: self.length.into(),
            records: self.records.into(),
            classes: self.classes.into(),
            checksum: self.checksum.into(),
            entry_checksum: 0.into(),
            cells: self.zone.cells.into(),
        };
        let mut bytes = raw.as_bytes().to_vec();
        for channel in 0..V::CHANNELS {
            let f64_bits = |value: &V| U64::new(value.samples()[channel].to_f64().to_bits());
            let raw = RawChannel {
                min: f64_bits(&self.zone.min),
                max: f64_bits(&self.zone.max),
                sum: self.zone.sum.as_ref()[channel].to_bytes(),
                squares: self.zone.squares.as_ref()[channel].to_bytes(),
            };
            bytes.extend_from_slice(raw.as_bytes());
        }
        let checksum = crc32c::crc32c(&bytes);
        bytes[ENTRY_CHECKSUM_AT..ENTRY_CHECKSUM_AT + 4].copy_from_slice(&checksum.to_le_bytes());
        bytes
    }

    /// Checks and understands the `index`-th entry; `bytes` are this entry's.
    pub(in crate::store) fn from_bytes(path: &Path, index: usize, bytes: &[u8]) -> Result<Self> {
        let corrupt = |found: String, expected: String| {
            Error::corrupt(path, format!("directory entry {index}"), found, expected)
        };
        let (raw, channels) = RawEntry::ref_from_prefix(bytes)
            .map_err(|_| corrupt(format!("{} bytes", bytes.len()), "a whole entry".into()))?;
        let checksum = {
            let (before, after) = (&bytes[..ENTRY_CHECKSUM_AT], &bytes[ENTRY_CHECKSUM_AT + 4..]);
            crc32c::crc32c_append(crc32c::crc32c_append(crc32c::crc32c(before), &[0; 4]), after)
        };
        if checksum != raw.entry_checksum.get() {
            return Err(corrupt(format!("checksum {checksum:08x}"), format!("{:08x}", raw.entry_checksum)));
        }
        let code = Code::from_bits(raw.code.get())
            .ok_or_else(|| corrupt(format!("code {:016x}", raw.code), "an FD code".into()))?;
        let channels = <[RawChannel]>::ref_from_bytes_with_elems(channels, V::CHANNELS)
            .map_err(|_| corrupt(format!("{} bytes", bytes.len()), "statistics per channel".into()))?;
        let mut zone = Tally { cells: raw.cells.get(), ..Tally::void() };
        let sample = |bits: U64| V::Sample::from_f64_lossy(f64::from_bits(bits.get()));
        zone.min = V::from_channels(|channel| sample(channels[channel].min));
        zone.max = V::from_channels(|channel| sample(channels[channel].max));
        for (channel, raw) in channels.iter().enumerate() {
            zone.sum.as_mut()[channel] = Sum::from_bytes(raw.sum);
            zone.squares.as_mut()[channel] = Sum::from_bytes(raw.squares);
        }
        Ok(Entry {
            code,
            offset: raw.offset.get(),
            length: raw.length.get(),
            records: raw.records.get(),
            classes: raw.classes.get(),
            checksum: raw.checksum.get(),
            zone,
        })
    }
}
