//! Corrects the checksums of files with changed fields, as an attacker would.
//!
//! Only checksums are written: offsets, lengths and counts stay unchanged, and ranges outside of
//! the file are ignored.

/// Size of the header that both formats have, in bytes.
pub const HEADER: usize = 24;
/// Size of a Goblin file's end, after the trailer, in bytes.
pub const END: usize = 16;
/// Size of a trailer before its sections, in bytes.
pub const TRAILER: usize = 36;
/// Offset in a trailer of the number of its sections.
pub const SECTIONS: usize = 32;
/// Size of a layer in the table of layers, in bytes.
pub const LAYER: usize = 152;
/// Size of a section in a trailer, in bytes.
pub const SECTION: usize = 24;
/// Offset of the record format in an Autumnal file's header page.
pub const RECORDS: usize = 64;
/// Offsets of the meta slots.
pub const SLOTS: [usize; 2] = [4096, 8192];
/// Size of a slot in bytes.
pub const SLOT: usize = 40;
/// Offset of the first extent.
pub const FIRST_EXTENT: usize = 12288;
/// Size of an extent's head in bytes.
pub const HEAD: usize = 32;
/// First bytes of a head.
pub const HEAD_MAGIC: &[u8; 4] = b"Extt";
const SECTOR: usize = 512;
const PAGE: usize = 4096;

/// Returns the `u32` at an offset; 0 outside of the file.
pub fn short(bytes: &[u8], at: usize) -> u32 {
    let four = at.checked_add(4).and_then(|end| bytes.get(at..end));
    four.map_or(0, |four| u32::from_le_bytes(four.try_into().unwrap()))
}

/// Returns the `u64` at an offset; 0 outside of the file.
pub fn long(bytes: &[u8], at: usize) -> u64 {
    let eight = at.checked_add(8).and_then(|end| bytes.get(at..end));
    eight.map_or(0, |eight| u64::from_le_bytes(eight.try_into().unwrap()))
}

/// Writes a `u32` if it is inside the file.
pub fn set_short(bytes: &mut [u8], at: usize, number: u32) {
    if let Some(four) = at.checked_add(4).and_then(|end| bytes.get_mut(at..end)) {
        four.copy_from_slice(&number.to_le_bytes());
    }
}

/// Writes a `u64` if it is inside the file.
pub fn set_long(bytes: &mut [u8], at: usize, number: u64) {
    if let Some(eight) = at.checked_add(8).and_then(|end| bytes.get_mut(at..end)) {
        eight.copy_from_slice(&number.to_le_bytes());
    }
}

/// Returns `length` bytes at an offset, if the file has them.
fn part(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    bytes.get(usize::try_from(offset).ok()?..usize::try_from(offset.checked_add(length)?).ok()?)
}

/// Writes the checksum of some bytes at an offset.
fn seal(bytes: &mut [u8], from: usize, to: usize, at: usize) {
    if let Some(sealed) = bytes.get(from..to) {
        let checksum = crc32c::crc32c(sealed);
        set_short(bytes, at, checksum);
    }
}

/// Returns the offset of a Goblin file's trailer, from the length in the file's end.
pub fn trailer(file: &[u8]) -> Option<usize> {
    let end = file.len().checked_sub(END)?;
    end.checked_sub(short(file, end) as usize)
}

/// Offset of the content type in the header, and its values for exact models and lines.
const CONTENT: usize = 13;
const MODEL: u8 = 2;
const LINES: u8 = 4;
/// Offset of the codec in a layer, and its value for an index.
const CODEC: usize = 4;
const REFERENCE: u8 = 2;
/// Sizes of an entry in an exact model's lists, and in lists of blocks of lines, in bytes.
const MODEL_ENTRY: usize = 24;
const LINE_ENTRY: usize = 52;

/// Returns the offset of the section with a tag in a trailer's list, and position and length of its
/// bytes.
pub fn section(file: &[u8], tag: &[u8; 4]) -> Option<(usize, usize, usize)> {
    let trailer = trailer(file)?;
    let count = short(file, trailer + SECTIONS) as usize;
    let mut all = (0..count.min(64)).map(|number| trailer + TRAILER + number * SECTION);
    let at = all.find(|at| file.get(*at..).is_some_and(|rest| rest.starts_with(tag)))?;
    let (offset, length) = (long(file, at + 8), long(file, at + 16));
    part(file, offset, length).map(|_| (at, offset as usize, length as usize))
}

/// Returns the offsets of the layers in the table of a Goblin file.
pub fn layers(file: &[u8]) -> Vec<usize> {
    let Some((_, offset, length)) = section(file, b"LAYR") else { return Vec::new() };
    (0..(length / LAYER).min(short(file, 16) as usize)).map(|number| offset + number * LAYER).collect()
}

/// Returns the size of an entry in a layer's segment index, in bytes.
pub fn entry_size(file: &[u8], layer: usize) -> usize {
    let channels = usize::from(file[layer + 1].clamp(1, 4));
    let sample = [1, 2, 2, 4, 4, 4, 8, 1, 8, 8].get(usize::from(file[layer])).copied().unwrap_or(1);
    let present = if file[layer + 12] == 1 { 8 } else { 0 };
    44 + (32 + 2 * sample + present) * channels
}

/// A page of an index: the offset of the entry that refers to it, and its range in the file.
pub type Indexed = (usize, std::ops::Range<usize>);

/// Maximum number of pages that are read per layer: a malicious index may have very many.
const MAX_PAGES: usize = 1 << 14;

/// Returns the pages of a layer's index by level, top first; the last level is the pages of the
/// segment index.
pub fn index(file: &[u8], layer: usize) -> Vec<Vec<Indexed>> {
    let (top, length) = (long(file, layer + 120), u64::from(short(file, layer + 128)));
    if part(file, top, length).is_none() {
        return Vec::new();
    }
    let run = long(file, layer + 88);
    let below = |at: usize| {
        let start = run.checked_add(long(file, at + 8))?;
        let length = u64::from(short(file, at + 16));
        part(file, start, length).map(|_| (at, start as usize..start as usize + length as usize))
    };
    let mut levels = vec![vec![(layer + 120, top as usize..(top + length) as usize)]];
    let mut entries = long(file, layer + 72).div_ceil(128);
    while entries > 0 && levels.len() < 8 {
        let above = levels.last().into_iter().flatten();
        let entry = above.flat_map(|(_, page)| page.clone().step_by(24).filter(|at| at + 24 <= page.end));
        let level = entry.filter_map(below).take(MAX_PAGES).collect();
        levels.push(level);
        entries = if entries > 256 { entries.div_ceil(256) } else { 0 };
    }
    levels.remove(0);
    levels
}

/// Returns the pages of a layer's segment index.
pub fn pages(file: &[u8], layer: usize) -> Vec<Indexed> {
    index(file, layer).pop().unwrap_or_default()
}

/// Returns the offsets of the entries of a page, including copies.
pub fn entries(file: &[u8], page: &std::ops::Range<usize>, size: usize) -> Vec<usize> {
    let head = short(file, page.start);
    let (copies, own) = (head as u16 as usize, (head >> 16) as usize);
    let first = page.start + 8 + 8 * copies;
    (0..copies + own).map(|number| first + number * size).filter(|at| at + size <= page.end).collect()
}

/// Seals a Goblin file, also of an exact model or of lines: header, segments, segment index,
/// metadata, table of layers, trailer.
pub fn goblin(file: &mut [u8]) {
    seal(file, 0, HEADER - 4, HEADER - 4);
    let (entry, tags): (usize, &[&[u8; 4]]) = match file.get(CONTENT) {
        Some(&MODEL) => (MODEL_ENTRY, &[b"DIRE", b"FACE", b"EXAC", b"OBJE", b"FVAL", b"LEVC", b"LEVF"]),
        Some(&LINES) => (LINE_ENTRY, &[b"LBLK", b"LFEA"]),
        _ => (MODEL_ENTRY, &[]),
    };
    let Some(trailer) = trailer(file) else { return };
    let end = file.len() - END;
    for layer in layers(file) {
        let (size, run) = (entry_size(file, layer), long(file, layer + 88));
        let levels = index(file, layer);
        // (Entries of an index are packed, with their checksums.)
        let segments = if file[layer + CODEC] == REFERENCE { None } else { levels.last() };
        for (_, page) in segments.into_iter().flatten() {
            for entry in entries(file, page, size) {
                let start = run.saturating_add(long(file, entry + 8));
                if let Some(segment) = part(file, start, long(file, entry + 16)) {
                    let checksum = crc32c::crc32c(segment);
                    set_short(file, entry + 32, checksum);
                }
            }
        }
        // (From the pages of the segment index up to the top.)
        for (entry, page) in levels.iter().rev().flatten() {
            seal(file, page.start, page.end, entry + 20);
        }
        for place in [120, 136] {
            let (offset, length) = (long(file, layer + place), short(file, layer + place + 8));
            if part(file, offset, length.into()).is_some() {
                seal(file, offset as usize, offset as usize + length as usize, layer + place + 12);
            }
        }
    }
    let sections =
        (end.saturating_sub(trailer + TRAILER) / SECTION).min(short(file, trailer + SECTIONS) as usize);
    for section in 0..sections {
        let at = trailer + TRAILER + section * SECTION;
        let (offset, length) = (long(file, at + 8), long(file, at + 16));
        if part(file, offset, length).is_none() {
            continue;
        }
        let (offset, length) = (offset as usize, length as usize);
        if tags.iter().any(|tag| file[at..].starts_with(*tag)) {
            blocks(file, (offset, offset + length), entry);
        }
        seal(file, offset, offset + length, at + 4);
    }
    // (The trailer repeats the header.)
    if trailer + HEADER <= end {
        file.copy_within(..HEADER, trailer);
    }
    seal(file, trailer, end, end + 4);
}

/// Seals the blocks or segments that the entries of a list refer to.
fn blocks(file: &mut [u8], (start, end): (usize, usize), size: usize) {
    for entry in (start..end).step_by(size).filter(|entry| entry + size <= end) {
        if let Some(block) = part(file, long(file, entry + 8), short(file, entry + 16).into()) {
            let checksum = crc32c::crc32c(block);
            set_short(file, entry + 20, checksum);
        }
    }
}

/// Corrects the last bytes of a Goblin file: the trailer's position, and the length.
pub fn goblin_end(file: &mut [u8]) {
    if file.len() < HEADER + TRAILER + END {
        return;
    }
    let end = file.len() - END;
    file[end + 8..].copy_from_slice(b"\nnilboG\x93");
    if let Some(trailer) = trailer(file) {
        let length = file.len() as u64;
        set_long(file, trailer + 24, length);
    }
}

/// Returns the offsets of the heads of an Autumnal file's extents, in order; if one leads nowhere,
/// the following ones are searched for.
pub fn extents(file: &[u8]) -> Vec<usize> {
    let mut found = Vec::new();
    let mut at = FIRST_EXTENT;
    while at + HEAD <= file.len() {
        let length = long(file, at + 16);
        if file[at..].starts_with(HEAD_MAGIC) {
            found.push(at);
            if part(file, (at + HEAD) as u64, length).is_some() {
                at = (at + HEAD + length as usize).next_multiple_of(SECTOR);
                continue;
            }
        }
        at += SECTOR;
    }
    found
}

/// Seals an Autumnal file: header page, meta slots, extents.
pub fn autumnal(file: &mut [u8]) {
    seal(file, 0, HEADER - 4, HEADER - 4);
    seal(file, RECORDS, RECORDS + 4, RECORDS + 4);
    for slot in SLOTS {
        // (An empty slot has no checksum.)
        if file.get(slot..slot + SLOT).is_some_and(|slot| slot.iter().any(|byte| *byte != 0)) {
            seal(file, slot, slot + SLOT - 4, slot + SLOT - 4);
        }
    }
    for head in extents(file) {
        let length = long(file, head + 16);
        if part(file, (head + HEAD) as u64, length).is_some() {
            seal(file, head + HEAD, head + HEAD + length as usize, head + 24);
        }
        seal(file, head, head + HEAD - 4, head + HEAD - 4);
    }
}

/// Size of a packed file before its extents, in bytes.
const PACKED: usize = 72 + 2 * SLOT;
/// Bit of a packed extent's kind: it starts at a page.
const AT_PAGE: u8 = 128;

/// Packs an Autumnal file by removing constant bytes, so that most changes by a fuzzer have an
/// effect: 72 bytes of the header page, the slots, and for each extent its kind, the number of its
/// bytes (`u16`), and these bytes.
pub fn packed(file: &[u8]) -> Vec<u8> {
    let mut packed = file[..72].to_vec();
    SLOTS.iter().for_each(|slot| packed.extend(&file[*slot..*slot + SLOT]));
    for head in extents(file) {
        let length = long(file, head + 16) as u16;
        packed.push(file[head + 4] | if head.is_multiple_of(PAGE) { AT_PAGE } else { 0 });
        packed.extend(length.to_le_bytes());
        packed.extend(&file[head + HEAD..][..usize::from(length)]);
    }
    packed
}

/// Returns the file of packed bytes, sealed; `None` if there are too few.
pub fn unpacked(packed: &[u8]) -> Option<Vec<u8>> {
    let (start, mut rest) = packed.split_at_checked(PACKED)?;
    let mut file = start[..72].to_vec();
    for (slot, bytes) in SLOTS.into_iter().zip(start[72..].chunks(SLOT)) {
        file.resize(slot, 0);
        file.extend(bytes);
    }
    file.resize(FIRST_EXTENT, 0);
    while let [kind, low, high, bytes @ ..] = rest {
        let length = usize::from(u16::from_le_bytes([*low, *high])).min(bytes.len());
        let unit = if kind & AT_PAGE != 0 { PAGE } else { SECTOR };
        file.resize(file.len().next_multiple_of(unit), 0);
        let start = file.len() as u64;
        file.extend(HEAD_MAGIC);
        file.extend([kind & !AT_PAGE, 0, 0, 0]);
        file.extend(start.to_le_bytes());
        file.extend((length as u64).to_le_bytes());
        file.extend([0; 8]);
        file.extend(&bytes[..length]);
        rest = &bytes[length..];
    }
    file.resize(file.len().next_multiple_of(SECTOR), 0);
    autumnal(&mut file);
    Some(file)
}
