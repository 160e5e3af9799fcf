//! Entries of the segment index: location of each segment, and statistics of all cells below its
//! node.

use std::path::Path;

use zerocopy::little_endian::{U16, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use spinney_base::TreeType;
use spinney_base::space::Code;
use spinney_base::value::{MAX_VALUE_SIZE, Sums, Value, ValueType, ZoneStats};
use spinney_base::{Error, Result};
use spinney_container::Codec;

/// A decoded entry of the segment index.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The node that owns the segment.
    pub code: Code,
    /// Offset of the segment's bytes in the layer's run.
    pub offset: u64,
    /// Number of its bytes in the file: records, then class counts, unless these are packed.
    pub length: u64,
    /// Number of record slots in the segment.
    pub records: u32,
    /// Number of class counts that follow the records; `u16::MAX` if there would be too many.
    pub classes: u16,
    /// Packing of its bytes.
    pub codec: Codec,
    /// CRC-32C of its bytes in the file.
    pub checksum: u32,
    /// Zone statistics, except for the class counts, which are stored in the segment.
    pub zone: ZoneStats,
}

/// Stored number of class counts of a segment that has none because there would be too many.
pub(super) const NOT_COUNTED: u16 = u16::MAX;

/// Returns the number of class counts that follow a segment's records, from the number in its
/// entry.
#[inline]
pub(super) fn listed(classes: u16) -> u16 {
    if classes == NOT_COUNTED { 0 } else { classes }
}

#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawEntry {
    code: U64,
    offset: U64,
    length: U64,
    records: U32,
    classes: U16,
    /// Packing of the records.
    codec: u8,
    /// Number of the codec's table.
    table: u8,
    checksum: U32,
    cells: U64,
}

const _: () = assert!(size_of::<RawEntry>() == 44);

/// Returns the size of one channel's zone statistics in bytes: two extremes, the sum, and the sum
/// of squares.
const fn channel_size(value_type: ValueType) -> usize {
    2 * value_type.sample.size() + 16 + Sums::size_of_squares(value_type.sample)
}

/// Returns the size of an entry in bytes, by value type. If samples can be missing, a count per
/// channel follows at the end.
pub(super) const fn entry_size(value_type: ValueType) -> usize {
    let present = if value_type.is_masked() { size_of::<U64>() } else { 0 };
    size_of::<RawEntry>() + value_type.channels as usize * (channel_size(value_type) + present)
}

/// Location of a segment, as stored in its entry.
pub(super) struct SegmentLocation {
    /// Bits of the code of the segment's node.
    pub(super) code: u64,
    pub(super) offset: u64,
    pub(super) length: u64,
    pub(super) records: u32,
    /// Number of class counts that follow the records.
    pub(super) classes: u16,
    pub(super) codec: Codec,
}

impl SegmentLocation {
    /// Reads the location without any checks, from an entry that [`Entry::from_bytes`] has decoded
    /// before. Returns `None` if the entry is incomplete or has an unknown codec.
    #[inline]
    pub(super) fn read(entry: &[u8]) -> Option<SegmentLocation> {
        let (raw, _) = RawEntry::ref_from_prefix(entry).ok()?;
        Some(SegmentLocation {
            code: raw.code.get(),
            offset: raw.offset.get(),
            length: raw.length.get(),
            records: raw.records.get(),
            classes: listed(raw.classes.get()),
            codec: *Codec::ALL.get(usize::from(raw.codec))?,
        })
    }
}

/// Sets the segment's offset in an entry's bytes.
pub(super) fn set_offset(entry: &mut [u8], offset: u64) {
    entry[8..16].copy_from_slice(&offset.to_le_bytes());
}

impl Entry {
    /// Encodes the entry as stored in the file.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let raw = RawEntry {
            code: self.code.bits().into(),
            offset: self.offset.into(),
            length: self.length.into(),
            records: self.records.into(),
            classes: self.classes.into(),
            codec: self.codec as u8,
            table: 0,
            checksum: self.checksum.into(),
            cells: self.zone.cells.into(),
        };
        let mut bytes = raw.as_bytes().to_vec();
        let ZoneStats { value_type, min, max, sum, squares, .. } = &self.zone;
        let (width, extremes) = (value_type.sample.size(), [min.to_bytes(), max.to_bytes()]);
        for channel in 0..usize::from(value_type.channels) {
            extremes.iter().for_each(|samples| bytes.extend_from_slice(&samples[channel * width..][..width]));
            sum.write(channel, &mut bytes);
            squares.write(channel, &mut bytes);
        }
        if value_type.is_masked() {
            let present = self.zone.present.iter().take(usize::from(value_type.channels));
            present.for_each(|cells| bytes.extend_from_slice(&cells.to_le_bytes()));
        }
        bytes
    }

    /// Decodes and checks entry `index` of a file with the tree type `form`; `bytes` are this
    /// entry's.
    pub(super) fn from_bytes(path: &Path, index: usize, bytes: &[u8], form: TreeType) -> Result<Entry> {
        let corrupt = |found: String, expected: String| {
            Error::corrupt(path, format!("directory entry {index}"), found, expected)
        };
        let (raw, rest) = RawEntry::ref_from_prefix(bytes)
            .map_err(|_| corrupt(format!("{} bytes", bytes.len()), "a complete entry".into()))?;
        let codec = Codec::of_number(path, raw.codec, " of a segment")?;
        let code = Code::from_bits(form.dimension, raw.code.get())
            .ok_or_else(|| corrupt(format!("code {:016x}", raw.code), "an FD code".into()))?;
        let count = usize::from(form.value.channels);
        let short = || corrupt(format!("{} bytes", bytes.len()), "statistics per channel".into());
        let (channels, rest) = rest.split_at_checked(count * channel_size(form.value)).ok_or_else(short)?;
        let cells = raw.cells.get();
        let mut zone = ZoneStats { cells, present: [cells; 4], ..ZoneStats::void(form.value) };
        if form.value.is_masked() {
            let present = <[U64]>::ref_from_bytes_with_elems(rest, count).map_err(|_| short())?;
            zone.present.iter_mut().zip(present).for_each(|(cells, raw)| *cells = raw.get());
            zone.present[count..].fill(cells);
        }
        let width = form.value.sample.size();
        let (mut min, mut max) = ([0; MAX_VALUE_SIZE], [0; MAX_VALUE_SIZE]);
        for (channel, raw) in channels.chunks_exact(channel_size(form.value)).enumerate() {
            let (extremes, sums) = raw.split_at(2 * width);
            min[channel * width..][..width].copy_from_slice(&extremes[..width]);
            max[channel * width..][..width].copy_from_slice(&extremes[width..]);
            let rest = zone.sum.read(channel, sums).ok_or_else(short)?;
            zone.squares.read(channel, rest).ok_or_else(short)?;
        }
        (zone.min, zone.max) = (Value::from_bytes(&min), Value::from_bytes(&max));
        Ok(Entry {
            code,
            offset: raw.offset.get(),
            length: raw.length.get(),
            records: raw.records.get(),
            classes: raw.classes.get(),
            codec,
            checksum: raw.checksum.get(),
            zone,
        })
    }
}

/// Formats the sums of `channels` channels for messages.
pub(super) fn show_sums(sums: &Sums, channels: u8) -> String {
    let channels = usize::from(channels);
    match sums {
        Sums::Exact(sums) => format!("{:?}", &sums[..channels]),
        Sums::Squares(sums) => format!("{:?}", &sums[..channels]),
        Sums::Double(sums) => format!("{:?}", &sums[..channels]),
        Sums::Triple(sums) => format!("{:?}", &sums[..channels]),
    }
}
