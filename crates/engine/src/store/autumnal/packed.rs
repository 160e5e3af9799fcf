//! Packed extents: the records of commits that are history, in fewer bytes.
//!
//! The records of such an extent are told by their numbers: the address of the first is that of the extent's first byte behind its head, that of the next
//! one byte more, and so on. So pointers, and what finds an extent by an address, are those of records that are not packed.

use std::sync::Arc;

use super::append::NewRecord;
use super::extents::{FULL_EXTENT, HEAD_SIZE};
use super::layout::{PointeredLayout, Pointers};
use super::pages::SECTOR;
use super::zone::{get_signed, get_u64, put, put_signed};
use spinney_base::io::{CachedBytes, FileAccess, Unpacked};
use spinney_base::value::Value;
use spinney_container::{FileHeader, Header};
use spinney_packing::{Damage, Run, RunForm, UnpackedRuns, may_unpack, pack_runs, unpack_runs};

/// Bits of the bytes of a packed extent's records, when they are unpacked.
const PLAIN_BITS: u32 = 21;
/// Bytes of these at most.
const MAX_PLAIN: usize = 1 << (PLAIN_BITS - 1);
/// Records of an extent at most. Invariant: all their addresses lie in the sector that the extent's head is in, so that nothing among
/// packed bytes is ever taken for a head.
const MAX_RECORDS: usize = SECTOR as usize - HEAD_SIZE;

/// Bytes before the records: how many they are when they are unpacked, how many records, whether they are packed, and the header of
/// their tree.
const START: usize = 8 + HEADER;
const HEADER: usize = 48;

/// Bytes before unpacked records, of each record: where it starts.
const PLACE: usize = 4;

/// Anything by which the packed extents of a file are read.
pub(super) struct PackedExtents {
    header: FileHeader,
    run_levels: u8,
    unpacked: Unpacked,
}

impl PackedExtents {
    pub(super) fn new(header: &FileHeader, run_levels: u8, access: &FileAccess) -> PackedExtents {
        PackedExtents { header: *header, run_levels, unpacked: Unpacked::new(access, PLAIN_BITS) }
    }

    /// The bytes from a record on, up to the end of its extent, which starts at `start` and has these bytes behind its head. What is wrong is
    /// told in words.
    pub(super) fn record(
        &self,
        start: u64,
        address: u64,
        payload: &[u8],
    ) -> Result<CachedBytes, &'static str> {
        let head = PackedHead::read(payload).ok_or("the head of packed records")?;
        let index = start / SECTOR;
        let held = match self.unpacked.get(index).filter(|held| held.len() == head.all()) {
            Some(held) => held,
            None => self.unpacked.put(index, Arc::new(self.unpack(start, head, payload)?)),
        };
        let number = (address - start) as usize - HEAD_SIZE;
        if number >= head.records {
            return Err("the number of a record");
        }
        let (at, end) = (place(&held[number * PLACE..]), held.len());
        Ok(held.part(at.min(end)..end))
    }

    /// The records of an extent, behind the places where they start.
    fn unpack(&self, start: u64, head: PackedHead, payload: &[u8]) -> Result<Vec<u8>, &'static str> {
        let packed = &payload[START..];
        let header: &[u8; HEADER] = payload[8..START].first_chunk().expect("as long as it is");
        let header = Header::from_bytes("".as_ref(), "", header, (self.header.dimension, self.header.depth));
        let header = header.map_err(|_| "the header of a tree")?;
        if !head.is_packed {
            let places = packed[..head.records * PLACE].chunks_exact(PLACE);
            let places: Vec<usize> = places.map(place).collect();
            let is_good = places[0] == head.records * PLACE
                && places.windows(2).all(|pair| pair[0] < pair[1])
                && places.last().is_some_and(|last| *last < packed.len());
            return if is_good { Ok(packed.to_vec()) } else { Err("places that records cannot have") };
        }
        let layout = PointeredLayout::new(header.form, self.run_levels, header.depth());
        let form = run_form(&header, self.run_levels);
        // (What is beside runs takes no more than twice what it becomes.)
        let unpacked = unpack_runs(&form, head.records, 2 * head.plain, packed);
        let UnpackedRuns { runs, beside } = unpacked.map_err(|Damage(what)| what)?;
        let mut records = Records::default();
        let mut rest = &beside[..];
        for run in &runs {
            let address = start + (HEAD_SIZE + records.starts.len()) as u64;
            if run.height > header.depth() {
                return Err("a node above the root");
            }
            let pointers = take_pointers(&mut rest, &layout, (address, run.height));
            let pointers = pointers.ok_or("pointers that cannot be")?;
            let zone = take_zone(&mut rest, &layout, run.height).ok_or("a zone that breaks off")?;
            let representative = Value::from_bytes(&run.representative);
            records.push(&layout, (address, run.height), representative, &pointers, &run.records, zone);
        }
        if records.bytes.len() != head.plain || !rest.is_empty() {
            return Err("other bytes than were packed");
        }
        Ok(records.to_bytes())
    }
}

/// The place of a record, which is a number at the beginning of some bytes.
fn place(bytes: &[u8]) -> usize {
    bytes.first_chunk().map_or(0, |four| u32::from_le_bytes(*four) as usize)
}

/// The meaning of runs of a tree.
fn run_form(header: &Header, run_levels: u8) -> RunForm {
    RunForm { form: header.form, rule: header.rule, kind: header.kind, reach: run_levels }
}

/// The start of a packed extent's bytes.
#[derive(Clone, Copy)]
struct PackedHead {
    /// Bytes of the records when they are unpacked.
    plain: usize,
    records: usize,
    is_packed: bool,
}

impl PackedHead {
    /// `None` if the numbers cannot be.
    fn read(payload: &[u8]) -> Option<PackedHead> {
        let (start, rest) = payload.split_at_checked(START)?;
        let plain = u32::from_le_bytes(start[..4].try_into().ok()?) as usize;
        let records = usize::from(u16::from_le_bytes(start[4..6].try_into().ok()?));
        let head = PackedHead { plain, records, is_packed: start[6] == 1 };
        let fits = if head.is_packed {
            may_unpack(rest.len() as u64, plain as u64)
        } else {
            rest.len() == head.all()
        };
        let is_good = start[6] < 2 && plain <= MAX_PLAIN && (1..=MAX_RECORDS).contains(&records) && fits;
        is_good.then_some(head)
    }

    /// Bytes of the records when they are unpacked, and of the places where they start.
    fn all(self) -> usize {
        self.plain + self.records * PLACE
    }
}

/// Records as they are when they are unpacked.
#[derive(Default)]
struct Records {
    /// Where each starts.
    starts: Vec<u32>,
    bytes: Vec<u8>,
}

impl Records {
    fn push(
        &mut self,
        layout: &PointeredLayout,
        place: (u64, u8),
        representative: Value,
        pointers: &Pointers,
        run: &[u8],
        zone: &[u8],
    ) {
        self.starts.push(self.bytes.len() as u32);
        layout.encode(place, representative, pointers, run, &mut self.bytes);
        self.bytes.extend_from_slice(zone);
    }

    fn of(&self, number: usize) -> &[u8] {
        let end = self.starts.get(number + 1).map_or(self.bytes.len(), |start| *start as usize);
        &self.bytes[self.starts[number] as usize..end]
    }

    /// The places where records start, counted from the first of these bytes on, and the records.
    fn to_bytes(&self) -> Vec<u8> {
        let before = self.starts.len() * PLACE;
        let places = self.starts.iter().flat_map(|start| (before as u32 + start).to_le_bytes());
        places.chain(self.bytes.iter().copied()).collect()
    }
}

/// An extent of packed records that is being made.
pub(super) struct PackedWriter {
    header: Header,
    run_levels: u8,
    layout: PointeredLayout,
    /// Where the extent starts in the file.
    start: u64,
    heights: Vec<u8>,
    records: Records,
    /// Pointers and zones, as they are packed.
    beside: Vec<u8>,
}

impl PackedWriter {
    /// Starts extents of records of a tree.
    pub(super) fn new(header: &Header, run_levels: u8) -> PackedWriter {
        let layout = PointeredLayout::new(header.form, run_levels, header.depth());
        let (heights, records, beside) = (Vec::new(), Records::default(), Vec::new());
        PackedWriter { header: header.clone(), run_levels, layout, start: 0, heights, records, beside }
    }

    /// Turns to records of another tree; there must be none of the one before.
    pub(super) fn set_tree(&mut self, header: &Header) {
        debug_assert!(self.is_empty());
        self.layout = PointeredLayout::new(header.form, self.run_levels, header.depth());
        self.header = header.clone();
    }

    /// Whether there is no record yet.
    pub(super) fn is_empty(&self) -> bool {
        self.heights.is_empty()
    }

    /// Whether the next record is to be in another extent.
    pub(super) fn is_full(&self) -> bool {
        self.records.bytes.len() > FULL_EXTENT || self.heights.len() == MAX_RECORDS
    }

    /// Adds a record to the extent, which starts at `start`, and tells its address.
    pub(super) fn push(&mut self, start: u64, record: NewRecord<'_>) -> u64 {
        let NewRecord { height, representative, pointers, run, zone } = record;
        let address = start + (HEAD_SIZE + self.heights.len()) as u64;
        self.start = start;
        self.records.push(&self.layout, (address, height), representative, pointers, run, zone);
        self.heights.push(height);
        put_pointers(&mut self.beside, &self.layout, (address, height), pointers);
        if self.layout.heights.has_zone(height) {
            put(&mut self.beside, zone.len() as u128);
            self.beside.extend_from_slice(zone);
        }
        address
    }

    /// The bytes from a record on that is in the extent.
    pub(super) fn record(&self, address: u64) -> Option<&[u8]> {
        let number = address.checked_sub(self.start + HEAD_SIZE as u64)? as usize;
        (number < self.heights.len()).then(|| self.records.of(number))
    }

    /// The bytes behind the head of the extent, which has its records; the next one has none yet.
    pub(super) fn finish(&mut self) -> Vec<u8> {
        let records = std::mem::take(&mut self.records);
        let run = |(number, height): (usize, &u8)| {
            let record = records.of(number);
            let parts = self.layout.parts(record, *height).ok()?;
            Some(Run {
                height: *height,
                representative: &record[..self.layout.width()],
                records: parts.run(record),
            })
        };
        let runs: Option<Vec<Run<&[u8]>>> = self.heights.iter().enumerate().map(run).collect();
        let form = run_form(&self.header, self.run_levels);
        let packed = runs.and_then(|runs| pack_runs(&form, &runs, &self.beside));
        let head = |is_packed: bool| {
            let mut bytes = (records.bytes.len() as u32).to_le_bytes().to_vec();
            bytes.extend_from_slice(&(self.heights.len() as u16).to_le_bytes());
            bytes.extend_from_slice(&[u8::from(is_packed), 0]);
            bytes.extend_from_slice(&self.header.to_bytes());
            bytes
        };
        // (Nobody has to pack what nobody may unpack.)
        let packed = packed.map(|packed| [head(true), packed].concat());
        let packed = packed.filter(|packed| PackedHead::read(packed).is_some());
        let bytes = packed.unwrap_or_else(|| [head(false), records.to_bytes()].concat());
        self.heights.clear();
        self.beside.clear();
        bytes
    }
}

/// Appends the pointers of a record: which nodes have one, then how far the first target is back, and how far each other one is from behind the one before.
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

/// Takes such pointers from the beginning of some bytes. `None` if they do not lead back.
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

/// Takes the zone of a record of some height, if it has one, from the beginning of some bytes. `None` if it breaks off.
fn take_zone<'b>(bytes: &mut &'b [u8], layout: &PointeredLayout, height: u8) -> Option<&'b [u8]> {
    if !layout.heights.has_zone(height) {
        return Some(&[]);
    }
    let length = usize::try_from(get_u64(bytes).ok()?).ok()?;
    let (zone, rest) = bytes.split_at_checked(length)?;
    *bytes = rest;
    Some(zone)
}
