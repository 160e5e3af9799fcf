//! Packed extents: compressed records of the commits that are history.
//!
//! A packed record has no bytes of its own in the file. Its address is the offset of the extent's
//! payload plus the record's number in the extent. Pointers and the search for an extent by address
//! therefore work as for plain records. The payload of a packed extent (after the 32-byte head, see
//! [`extents`](super::extents)), with little-endian integers:
//!
//! ```text
//! 4 bytes: size of all records when decoded, at most 2^20
//! 2 bytes: record count, 1 to 480
//! 1 byte: codec, 0 plain or 1 packed
//! 1 byte: padding, 0
//! 48 bytes: header of the tree that all records were written for
//! codec 0:                                   codec 1:
//!   4 bytes per record: its offset, counted    output of `pack_runs` for the runs, and these
//!     from byte 56 of the payload              side bytes per record with pointers:
//!   records, contiguous                          bitmap of the pointers
//!                                                LEB128 per pointer: distance, zigzag, from the
//!                                                  expected address
//!                                                LEB128: zone length, then the zone, if any
//! ```
//!
//! The header determines how the records are decoded. (The decoded bytes may then be shared by a
//! layer with another header.)
//!
//! The expected address of the first pointer is the record's own, and of each further pointer the
//! target of the pointer before plus 1. `formats.md` (section 41) is the specification.

use std::sync::Arc;

use super::append::NewRecord;
use super::extents::{FULL_EXTENT, HEAD_SIZE};
use super::layout::{PointeredLayout, Pointers};
use super::pages::SECTOR;
use super::zone::{get_signed, get_u64, put, put_signed};
use spinney_base::io::{CachedBytes, FileAccess, Unpacked};
use spinney_base::value::Value;
use spinney_container::{FileHeader, Header};
use spinney_packing::{Corruption, RunForm, RunRecords, UnpackedRuns, may_unpack, pack_runs, unpack_runs};

/// Base-2 logarithm of an upper bound of an extent's decoded bytes.
const PLAIN_BITS: u32 = 21;
/// Maximum decoded size of an extent's records in bytes.
const MAX_PLAIN: usize = 1 << (PLAIN_BITS - 1);
/// Maximum record count of an extent. Invariant: all record addresses are in the same sector as the
/// extent's head, so a search by address never takes packed bytes for a head.
const MAX_PACKED_RECORDS: usize = SECTOR as usize - HEAD_SIZE;

/// Bytes before the records: decoded size, record count, codec, and the header of the tree.
const START: usize = 8 + HEADER;
const HEADER: usize = 48;

/// Size in bytes of a record's offset in the table before decoded records.
const PLACE: usize = 4;

/// Reader of a file's packed extents.
pub(super) struct PackedExtents {
    header: FileHeader,
    run_levels: u8,
    unpacked: Unpacked,
}

impl PackedExtents {
    pub(super) fn new(header: &FileHeader, run_levels: u8, access: &FileAccess) -> PackedExtents {
        PackedExtents { header: *header, run_levels, unpacked: Unpacked::new(access, PLAIN_BITS) }
    }

    /// Returns the bytes from the record at `address` to the end of its extent, which starts at
    /// `start` and has this payload. An error is what was found, in words.
    pub(super) fn record(
        &self,
        start: u64,
        address: u64,
        payload: &[u8],
    ) -> Result<CachedBytes, &'static str> {
        let head = PackedHead::read(payload).ok_or("an invalid head")?;
        let index = start / SECTOR;
        // (The length differs only if another process has overwritten the extent since. Then the
        // cached offset table could be too short for the record's number.)
        let held = match self.unpacked.get(index).filter(|held| held.len() == head.all()) {
            Some(held) => held,
            None => self.unpacked.put(index, Arc::new(self.unpack(start, head, payload)?)),
        };
        let number = (address - start) as usize - HEAD_SIZE;
        if number >= head.records {
            return Err("fewer records");
        }
        let (at, end) = (record_offset(&held[number * PLACE..]), held.len());
        Ok(held.part(at.min(end)..end))
    }

    /// Decodes the records of an extent, preceded by their offset table.
    fn unpack(&self, start: u64, head: PackedHead, payload: &[u8]) -> Result<Vec<u8>, &'static str> {
        let packed = &payload[START..];
        let header: &[u8; HEADER] = payload[8..START].first_chunk().expect("as long as it is");
        let header = Header::from_bytes("".as_ref(), "", header, (self.header.dimension, self.header.depth));
        let header = header.map_err(|_| "an invalid tree header")?;
        if !head.is_compressed {
            let offsets = packed[..head.records * PLACE].chunks_exact(PLACE);
            let offsets: Vec<usize> = offsets.map(record_offset).collect();
            let is_good = offsets[0] == head.records * PLACE
                && offsets.windows(2).all(|pair| pair[0] < pair[1])
                && offsets.last().is_some_and(|last| *last < packed.len());
            return if is_good { Ok(packed.to_vec()) } else { Err("invalid record offsets") };
        }
        let layout = PointeredLayout::new(header.form, self.run_levels, header.depth());
        let form = run_form(&header, self.run_levels);
        // (The bytes other than runs take at most twice the size of their decoded form.)
        let unpacked = unpack_runs(&form, head.records, 2 * head.plain, packed);
        let UnpackedRuns { runs, side_bytes } = unpacked.map_err(|Corruption(what)| what)?;
        let mut records = DecodedRecords::default();
        let mut rest = &side_bytes[..];
        for run in &runs {
            let address = start + (HEAD_SIZE + records.starts.len()) as u64;
            if run.height > header.depth() {
                return Err("a node above the root");
            }
            let pointers = take_pointers(&mut rest, &layout, (address, run.height));
            let pointers = pointers.ok_or("invalid pointers")?;
            let zone = take_zone(&mut rest, &layout, run.height).ok_or("an incomplete zone")?;
            let representative = Value::from_bytes(&run.representative);
            records.push(&layout, (address, run.height), representative, &pointers, &run.records, zone);
        }
        if records.bytes.len() != head.plain || !rest.is_empty() {
            return Err("a different unpacked length");
        }
        Ok(records.to_bytes())
    }
}

/// Returns the record offset at the start of `bytes`.
fn record_offset(bytes: &[u8]) -> usize {
    bytes.first_chunk().map_or(0, |four| u32::from_le_bytes(*four) as usize)
}

/// Returns how to interpret the runs of a tree.
fn run_form(header: &Header, run_levels: u8) -> RunForm {
    RunForm { form: header.form, rule: header.rule, kind: header.kind, reach: run_levels }
}

/// Fields at the start of a packed extent's payload.
#[derive(Clone, Copy)]
struct PackedHead {
    /// Decoded size of the records in bytes.
    plain: usize,
    records: usize,
    /// Whether the codec is 1.
    is_compressed: bool,
}

impl PackedHead {
    /// Reads the fields, or returns `None` if one is out of range.
    fn read(payload: &[u8]) -> Option<PackedHead> {
        let (start, rest) = payload.split_at_checked(START)?;
        let plain = u32::from_le_bytes(start[..4].try_into().ok()?) as usize;
        let records = usize::from(u16::from_le_bytes(start[4..6].try_into().ok()?));
        let head = PackedHead { plain, records, is_compressed: start[6] == 1 };
        let fits = if head.is_compressed {
            may_unpack(rest.len() as u64, plain as u64)
        } else {
            rest.len() == head.all()
        };
        let is_good =
            start[6] < 2 && plain <= MAX_PLAIN && (1..=MAX_PACKED_RECORDS).contains(&records) && fits;
        is_good.then_some(head)
    }

    /// Returns the decoded size of the records and of their offset table in bytes.
    fn all(self) -> usize {
        self.plain + self.records * PLACE
    }
}

/// Decoded records.
#[derive(Default)]
struct DecodedRecords {
    /// Offset of each record in `bytes`.
    starts: Vec<u32>,
    bytes: Vec<u8>,
}

impl DecodedRecords {
    fn push(
        &mut self,
        layout: &PointeredLayout,
        position: (u64, u8),
        representative: Value,
        pointers: &Pointers,
        run: &[u8],
        zone: &[u8],
    ) {
        self.starts.push(self.bytes.len() as u32);
        layout.encode(position, representative, pointers, run, &mut self.bytes);
        self.bytes.extend_from_slice(zone);
    }

    fn of(&self, number: usize) -> &[u8] {
        let end = self.starts.get(number + 1).map_or(self.bytes.len(), |start| *start as usize);
        &self.bytes[self.starts[number] as usize..end]
    }

    /// Returns the offset table, whose offsets count from the table's start, followed by the
    /// records.
    fn to_bytes(&self) -> Vec<u8> {
        let before = self.starts.len() * PLACE;
        let offsets = self.starts.iter().flat_map(|start| (before as u32 + start).to_le_bytes());
        offsets.chain(self.bytes.iter().copied()).collect()
    }
}

/// Packed extent in progress.
pub(super) struct PackedWriter {
    header: Header,
    run_levels: u8,
    layout: PointeredLayout,
    /// Offset of the extent in the file.
    start: u64,
    heights: Vec<u8>,
    records: DecodedRecords,
    /// Encoded pointers and zones: the bytes that are not in runs.
    side_bytes: Vec<u8>,
}

impl PackedWriter {
    /// Creates a writer for records of a tree.
    pub(super) fn new(header: &Header, run_levels: u8) -> PackedWriter {
        let layout = PointeredLayout::new(header.form, run_levels, header.depth());
        let (heights, records, side_bytes) = (Vec::new(), DecodedRecords::default(), Vec::new());
        PackedWriter { header: header.clone(), run_levels, layout, start: 0, heights, records, side_bytes }
    }

    /// Switches to records of another tree. No record of the tree before may be pending.
    pub(super) fn set_tree(&mut self, header: &Header) {
        debug_assert!(self.is_empty());
        self.layout = PointeredLayout::new(header.form, self.run_levels, header.depth());
        self.header = header.clone();
    }

    /// Returns whether there is no record yet.
    pub(super) fn is_empty(&self) -> bool {
        self.heights.is_empty()
    }

    /// Returns whether the next record must go to another extent.
    pub(super) fn is_full(&self) -> bool {
        self.records.bytes.len() > FULL_EXTENT || self.heights.len() == MAX_PACKED_RECORDS
    }

    /// Adds a record to the extent, which starts at `start`, and returns the record's address.
    pub(super) fn push(&mut self, start: u64, record: NewRecord<'_>) -> u64 {
        let NewRecord { height, representative, pointers, run, zone } = record;
        let address = start + (HEAD_SIZE + self.heights.len()) as u64;
        self.start = start;
        self.records.push(&self.layout, (address, height), representative, pointers, run, zone);
        self.heights.push(height);
        put_pointers(&mut self.side_bytes, &self.layout, (address, height), pointers);
        if self.layout.heights.has_zone(height) {
            put(&mut self.side_bytes, zone.len() as u128);
            self.side_bytes.extend_from_slice(zone);
        }
        address
    }

    /// Returns the bytes of the pending record at `address`.
    pub(super) fn record(&self, address: u64) -> Option<&[u8]> {
        let number = address.checked_sub(self.start + HEAD_SIZE as u64)? as usize;
        (number < self.heights.len()).then(|| self.records.of(number))
    }

    /// Returns the payload of the extent with its records, and resets the writer.
    pub(super) fn finish(&mut self) -> Vec<u8> {
        let records = std::mem::take(&mut self.records);
        let run = |(number, height): (usize, &u8)| {
            let record = records.of(number);
            let fields = self.layout.fields(record, *height).ok()?;
            Some(RunRecords {
                height: *height,
                representative: &record[..self.layout.width()],
                records: fields.run(record),
            })
        };
        let runs: Option<Vec<RunRecords<&[u8]>>> = self.heights.iter().enumerate().map(run).collect();
        let form = run_form(&self.header, self.run_levels);
        let packed = runs.and_then(|runs| pack_runs(&form, &runs, &self.side_bytes));
        let head = |is_compressed: bool| {
            let mut bytes = (records.bytes.len() as u32).to_le_bytes().to_vec();
            bytes.extend_from_slice(&(self.heights.len() as u16).to_le_bytes());
            bytes.extend_from_slice(&[u8::from(is_compressed), 0]);
            bytes.extend_from_slice(&self.header.to_bytes());
            bytes
        };
        // (Fall back to codec 0 where a reader would reject the packed form.)
        let packed = packed.map(|packed| [head(true), packed].concat());
        let packed = packed.filter(|packed| PackedHead::read(packed).is_some());
        let bytes = packed.unwrap_or_else(|| [head(false), records.to_bytes()].concat());
        self.heights.clear();
        self.side_bytes.clear();
        bytes
    }
}

/// Appends a record's pointers: the bitmap, then for each target its signed distance from the
/// expected address. That is the record's own for the first target, and else the target before
/// plus 1.
fn put_pointers(
    bytes: &mut Vec<u8>,
    layout: &PointeredLayout,
    (address, height): (u64, u8),
    pointers: &Pointers,
) {
    let Some(size) = layout.bitmap_bytes(height) else { return };
    bytes.extend_from_slice(&pointers.bitmap.to_le_bytes()[..size]);
    let mut expected = address;
    for target in &pointers.targets {
        put_signed(bytes, i128::from(*target) - i128::from(expected));
        expected = target + 1;
    }
}

/// Decodes such pointers and advances `bytes`. Returns `None` if they do not lead back.
fn take_pointers(
    bytes: &mut &[u8],
    layout: &PointeredLayout,
    (address, height): (u64, u8),
) -> Option<Pointers> {
    let Some(size) = layout.bitmap_bytes(height) else { return Some(Pointers::default()) };
    let (map, rest) = bytes.split_at_checked(size)?;
    *bytes = rest;
    let mut bitmap = [0; size_of::<u64>()];
    bitmap[..size].copy_from_slice(map);
    let bitmap = u64::from_le_bytes(bitmap);
    let mut expected = address;
    let targets = (0..bitmap.count_ones()).map(|_| {
        let distance = i64::try_from(get_signed(bytes).ok()?).ok()?;
        let target = expected.checked_add_signed(distance).filter(|target| *target < address)?;
        expected = target + 1;
        Some(target)
    });
    Some(Pointers { bitmap, targets: targets.collect::<Option<_>>()? })
}

/// Decodes the zone of a record of `height`, if it has one, and advances `bytes`. Returns `None` if
/// the bytes end early.
fn take_zone<'b>(bytes: &mut &'b [u8], layout: &PointeredLayout, height: u8) -> Option<&'b [u8]> {
    if !layout.heights.has_zone(height) {
        return Some(&[]);
    }
    let length = usize::try_from(get_u64(bytes).ok()?).ok()?;
    let (zone, rest) = bytes.split_at_checked(length)?;
    *bytes = rest;
    Some(zone)
}
