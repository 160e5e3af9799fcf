//! Corrupt and crafted Goblin files: an error or the right result, never a panic, a hang, or
//! unbounded memory.

use std::io::Write;
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use spinney::query::Condition;
use spinney::raw::store::goblin::Goblin;
use spinney::tree::{Child, Source};
use spinney::{Bounds, DataKind, Dataset, Error, Number, OpenOptions, Result, Rule, SampleType};

use crate::common::command::{is_alone, own_peak_memory};
use crate::common::reference::{self, Cut};
use crate::common::{Cells, OCT, QUAD, Random, goblin_bytes, quad, try_children};
use crate::targets::seal;

/// A file's results for all queries, in a comparable form.
type Results = Vec<Result<String>>;

fn digest(bytes: &[u8]) -> String {
    format!("{:08x}", crc32c::crc32c(bytes))
}

fn walk(file: &Goblin) -> Result<String> {
    let mut text = Vec::new();
    let mut pending = vec![file.root()?];
    while let Some(place) = pending.pop() {
        writeln!(text, "{:?}", place.value()).unwrap();
        if let Child::Inner { node, .. } = place {
            pending.extend(try_children(file, &node)?);
        }
    }
    Ok(digest(&text))
}

fn window(tree: &Dataset, level: u8) -> Result<String> {
    let mut bounds = tree.extent_at(level);
    bounds.max = bounds.max.map(|end| end.min(1024));
    let mut bytes = vec![0; bounds.volume() as usize * tree.header().form.width()];
    let mut valid = vec![false; bounds.volume() as usize];
    tree.window(level, &bounds, 250.0, &mut bytes, Some(&mut valid))?;
    bytes.extend(valid.into_iter().map(u8::from));
    Ok(digest(&bytes))
}

fn points(tree: &Dataset) -> Result<String> {
    let mut random = Random(9);
    let mut text = String::new();
    for _ in 0..20 {
        let cell = tree.header().extent.map(|end| random.below(end));
        let mut value = [Number::default(); 4];
        let found = tree.point(cell, tree.depth(), &mut value)?;
        text += &format!("{found} {value:?} ");
    }
    Ok(text)
}

fn statistics(tree: &Dataset, bounds: Option<Bounds>) -> Result<String> {
    let stats = tree.statistics(bounds, &())?;
    Ok(format!("{} {} {:?} {:?}", stats.cells, stats.void_cells, stats.channels, stats.classes))
}

fn search(tree: &Dataset) -> Result<String> {
    let mut text = Vec::new();
    tree.find(Condition::Above(4.0.into()), None, &(), &mut |block| {
        writeln!(text, "{block:?}").unwrap();
        Ok(text.len() < 1 << 22)
    })?;
    Ok(digest(&text))
}

/// Runs all queries. The last result is that of `verify`.
fn query(file: Result<Goblin>) -> Results {
    let file = match file {
        Ok(file) => file,
        Err(error) => return vec![Err(error)],
    };
    let walked = walk(&file);
    let tree = &Dataset::of(file.into()).unwrap();
    let [width, height, deep] = tree.header().extent;
    let bounds = Bounds {
        min: [width / 5, height / 7, deep / 9],
        max: [width - width / 3, height - height / 4, deep - deep / 5],
    };
    let mut results = vec![walked, points(tree), statistics(tree, None), statistics(tree, Some(bounds))];
    let depth = tree.depth();
    results.extend([0, depth / 2, depth.saturating_sub(1), depth].map(|level| window(tree, level)));
    results.push(tree.histogram(&bounds, 0.0, 50.0, 7, &()).map(|bins| format!("{bins:?}")));
    results.push(search(tree));
    results.push(tree.df_text(1 << 20).map(|text| digest(text.as_bytes())));
    let _ = tree.metadata().counts.records();
    let _ = tree.sections();
    results.push(tree.verify(1 << 24, &()).map(|findings| format!("{findings:?}")));
    results
}

/// Runs all queries on the bytes in memory, mapped, and with positioned reads.
fn query_all(bytes: &[u8]) -> [Results; 3] {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    let open = |options: OpenOptions| query(Goblin::open(file.path(), &options));
    let positioned = OpenOptions::new().positioned(64 << 20);
    [query(Goblin::from_bytes(bytes.to_vec())), open(OpenOptions::new()), open(positioned)]
}

/// Checks that every result equals the valid file's or is an error, and that `verify` (or opening)
/// reports corruption.
fn check_corrupt(bytes: &[u8], good: &Results, what: &str) {
    for results in query_all(bytes) {
        if results.len() == 1 {
            assert!(results[0].is_err(), "{what}");
            continue;
        }
        let verified = results.len() - 1;
        for (i, (result, expected)) in results.iter().zip(good).enumerate().take(verified) {
            let expected = expected.as_ref().unwrap();
            assert!(
                result.as_ref().is_err() || result.as_ref().is_ok_and(|a| a == expected),
                "{what}, query {i}"
            );
        }
        assert!(
            results[verified].as_ref().map_or(true, |findings| findings != "[]"),
            "{what}: not found by verify"
        );
    }
}

pub(super) fn truncate_and_flip(bytes: &[u8], cuts: usize, flips: u64) {
    let good = query(Goblin::from_bytes(bytes.to_vec()));
    assert!(good.iter().all(Result::is_ok));
    for results in query_all(bytes) {
        assert!(results.iter().zip(&good).all(|(a, b)| a.as_ref().unwrap() == b.as_ref().unwrap()));
    }
    let (start, end) = (100, bytes.len() - bytes.len().min(600));
    for length in (0..bytes.len()).filter(|cut| *cut < start || *cut > end || cut % cuts == 0) {
        check_corrupt(&bytes[..length], &good, &format!("{length} of {} bytes", bytes.len()));
    }
    let bits = bytes.len() as u64 * 8;
    let mut random = Random(flips);
    for i in 0..flips.min(bits) {
        let bit = if flips < bits { random.below(bits) } else { i };
        let mut bytes = bytes.to_vec();
        bytes[bit as usize / 8] ^= 1 << (bit % 8);
        check_corrupt(&bytes, &good, &format!("bit {bit}"));
    }
}

/// Returns a small file of several segments.
pub(crate) fn map() -> &'static [u8] {
    static MAP: LazyLock<Vec<u8>> = LazyLock::new(|| {
        let cells = Cells::random(QUAD, 8, [400, 380, 1], 60, true);
        goblin_bytes(&cells, Rule::Majority, DataKind::Categorical)
    });
    &MAP
}

#[test]
fn any_corruption_of_a_tiny_file_is_detected() {
    let cells = Cells::random(QUAD, 3, [5, 7, 1], 9, true);
    let bytes = goblin_bytes(&cells, Rule::Majority, DataKind::Categorical);
    truncate_and_flip(&bytes, 1, u64::MAX);
}

#[test]
fn corruption_of_a_file_with_segments_is_detected() {
    truncate_and_flip(map(), 997, 25);
}

#[test]
fn corruption_of_other_types_is_detected() {
    let cells = Cells::random(OCT, 5, [30, 20, 25], 9, true);
    let bytes = goblin_bytes(&cells, Rule::Mean, DataKind::Continuous);
    truncate_and_flip(&bytes, 997, 40);
    let cells = Cells::random(quad(SampleType::F32, 1), 4, [90, 70, 1], 60, true);
    let bytes = goblin_bytes(&cells, Rule::Mean, DataKind::Continuous);
    truncate_and_flip(&bytes, 997, 40);
}

#[test]
fn corruption_of_files_with_cuts_everywhere_is_detected() {
    for (form, size) in [(QUAD, [30, 17, 1]), (OCT, [9, 12, 7])] {
        let cells = Cells::random(form, 6, size, 9, true);
        let tree = cells.tree(Rule::Majority);
        let kind = (Rule::Majority, DataKind::Categorical);
        truncate_and_flip(&reference::goblin(&tree, size, kind, Cut::EVERYWHERE), 97, 400);
    }
}

pub(crate) const HEADER: usize = 24;

/// A file split into components, to be reassembled with valid checksums and invalid contents.
#[derive(Clone)]
struct Craft {
    header: Vec<u8>,
    segments: Vec<u8>,
    entries: Vec<Vec<u8>>,
    metadata: Vec<u8>,
    /// The layer's table entry, whose offsets and checksums are recomputed.
    layer: Vec<u8>,
    unknown_section: bool,
}

fn number(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

fn set(bytes: &mut [u8], at: usize, number: u64) {
    bytes[at..at + 8].copy_from_slice(&number.to_le_bytes());
}

fn set_short(bytes: &mut [u8], at: usize, number: u32) {
    bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
}

impl Craft {
    fn new(bytes: &[u8]) -> Craft {
        let at = seal::layers(bytes)[0];
        let layer = bytes[at..at + seal::LAYER].to_vec();
        let size = seal::entry_size(bytes, at);
        let pages = seal::pages(bytes, at);
        let own = |page: &(usize, std::ops::Range<usize>)| {
            let copies = usize::from(u16::from_le_bytes([bytes[page.1.start], bytes[page.1.start + 1]]));
            seal::entries(bytes, &page.1, size).into_iter().skip(copies).collect::<Vec<_>>()
        };
        let entry = |entry: usize| bytes[entry..entry + size].to_vec();
        let metadata = number(&layer, 136) as usize;
        let length = u32::from_le_bytes(layer[144..148].try_into().unwrap()) as usize;
        Craft {
            header: bytes[..HEADER].to_vec(),
            segments: bytes[HEADER..HEADER + number(&layer, 112) as usize].to_vec(),
            entries: pages.iter().flat_map(own).map(entry).collect(),
            metadata: bytes[metadata..metadata + length].to_vec(),
            layer,
            unknown_section: false,
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut file = self.header.clone();
        let checksum = crc32c::crc32c(&file[..HEADER - 4]);
        set_short(&mut file, HEADER - 4, checksum);
        file.extend(&self.segments);
        let mut entries = self.entries.clone();
        for entry in &mut entries {
            let (offset, length) = (number(entry, 8), number(entry, 16));
            let place =
                offset.checked_add(HEADER as u64).and_then(|start| Some((start, start.checked_add(length)?)));
            if let Some(segment) = place.and_then(|(start, end)| file.get(start as usize..end as usize)) {
                set_short(entry, 32, crc32c::crc32c(segment));
            }
        }
        let (pages, top) = reference::directory(&entries, 2, self.segments.len() as u64);
        file.extend(&pages);
        let mut layer = self.layer.clone();
        set(&mut layer, 72, entries.len() as u64);
        set(&mut layer, 96, (file.len() - HEADER) as u64);
        for (at, bytes) in [(136, &self.metadata), (120, &top)] {
            set(&mut layer, at, file.len() as u64);
            set_short(&mut layer, at + 8, bytes.len() as u32);
            set_short(&mut layer, at + 12, crc32c::crc32c(bytes));
            file.extend(bytes);
        }
        let table = file.len();
        file.extend(&layer);
        let mut sections = vec![(*b"LAYR", table..file.len())];
        if self.unknown_section {
            file.extend(b"is this?");
            sections.push((*b"WHAT", file.len() - 8..file.len()));
        }
        reference::trailer(&mut file, &sections);
        file
    }

    /// Returns record `record` of entry `entry`'s segment: four values, states, skip.
    fn record(&mut self, entry: usize, record: usize) -> &mut [u8] {
        let start = number(&self.entries[entry], 8) as usize + 8 * record;
        &mut self.segments[start..start + 8]
    }

    fn set_skip(&mut self, entry: usize, record: usize, skip: u32) {
        self.record(entry, record)[5..].copy_from_slice(&skip.to_le_bytes()[..3]);
    }

    /// Returns the first record in the root's segment with a child in this state, and the child.
    fn child_in_state(&mut self, state: u8) -> (usize, usize) {
        let records = u32::from_le_bytes(self.entries[0][24..28].try_into().unwrap()) as usize;
        let positions = (0..records).flat_map(|record| (0..4).map(move |child| (record, child)));
        positions
            .into_iter()
            .find(|(record, child)| self.record(0, *record)[4] >> (2 * child) & 3 == state)
            .unwrap()
    }

    fn set_state(&mut self, (record, child): (usize, usize), state: u8) {
        let states = &mut self.record(0, record)[4];
        *states = *states & !(3 << (2 * child)) | state << (2 * child);
    }
}

/// Runs all queries on a crafted file within a time limit, whatever the results.
fn survives(bytes: &[u8], what: &str) -> [Results; 3] {
    let start = Instant::now();
    let results = query_all(bytes);
    assert!(start.elapsed() < Duration::from_secs(20), "{what} took {:?}", start.elapsed());
    results
}

/// Checks that a crafted file makes some query fail.
fn refused(craft: &Craft, what: &str) {
    for results in survives(&craft.bytes(), what) {
        let is_reported =
            |result: &Result<String>| result.as_ref().map_or(true, |text| text.starts_with("[Finding"));
        assert!(results.iter().any(is_reported), "{what} was not detected");
    }
}

fn good() -> Craft {
    let craft = Craft::new(map());
    assert!(craft.entries.len() > 2);
    assert!(craft.bytes() == map());
    craft
}

fn crafted(what: &str, change: impl Fn(&mut Craft)) {
    let mut craft = good();
    change(&mut craft);
    refused(&craft, what);
}

#[test]
fn invalid_skips_are_rejected() {
    for (record, skip) in
        [(0, 0), (0, 1), (0, 0xff_ffff), (1, 0), (1, 1), (1, 0xff_ffff), (2, 0), (5, 77_777)]
    {
        crafted(&format!("record {record} skips {skip}"), |craft| craft.set_skip(0, record, skip));
    }
    crafted("all skips are 1", |craft| {
        let records = number(&craft.entries[0], 24) as u32 as usize;
        (1..records).for_each(|record| craft.set_skip(0, record, 1));
    });
}

#[test]
fn invalid_states_are_rejected() {
    crafted("LEAF that becomes INNER", |craft| {
        let place = craft.child_in_state(1);
        craft.set_state(place, 2);
    });
    crafted("LEAF that becomes CUT", |craft| {
        let place = craft.child_in_state(1);
        craft.set_state(place, 3);
    });
    crafted("INNER that becomes CUT", |craft| {
        let place = craft.child_in_state(2);
        craft.set_state(place, 3);
    });
    crafted("all children INNER", |craft| {
        let records = number(&craft.entries[1], 24) as u32 as usize;
        (0..records).for_each(|record| craft.record(1, record)[4] = 0b1010_1010);
    });
    crafted("all children CUT", |craft| {
        let records = number(&craft.entries[0], 24) as u32 as usize;
        (0..records).for_each(|record| craft.record(0, record)[4] = 0xff);
    });
    // A chain of records, each the only child of the previous one, deeper than the tree.
    crafted("records nested without end", |craft| {
        let records = number(&craft.entries[0], 24) as u32;
        for record in 0..records {
            craft.record(0, record as usize)[4] = 2;
            craft.set_skip(0, record as usize, records - record);
        }
    });
}

#[test]
fn invalid_segment_indices_are_rejected() {
    if !is_alone("malicious::invalid_segment_indices_are_rejected") {
        return;
    }
    for at in [8, 16] {
        for wrong in [0, 1, 1 << 20, 1 << 63, u64::MAX, u64::MAX - 60] {
            let mut craft = good();
            // The first segment is at 0.
            if number(&craft.entries[1], at) != wrong {
                set(&mut craft.entries[1], at, wrong);
                refused(&craft, &format!("number {wrong} at {at} of an entry"));
            }
        }
    }
    for (at, wrong) in [(24, 0), (24, 1), (24, u32::MAX), (28, 1), (28, 0xffff), (28, 0x1_0003)] {
        crafted(&format!("count {wrong} at {at} of an entry"), |craft| {
            set_short(&mut craft.entries[1], at, wrong)
        });
    }
    for wrong in [0, 2, 30, 31, 1 << 63, u64::MAX, 1 << 62 | 5, 29] {
        crafted(&format!("code {wrong:x}"), |craft| {
            assert_ne!(number(&craft.entries[1], 0), wrong, "that is the right one");
            set(&mut craft.entries[1], 0, wrong)
        });
    }
    crafted("statistics of more cells than there are", |craft| {
        craft.entries.iter_mut().for_each(|entry| set(entry, 36, u64::MAX));
    });
    crafted("sums of everything", |craft| {
        craft.entries.iter_mut().for_each(|entry| entry[46..78].fill(0x7f));
    });
    crafted("class counts of everything", |craft| {
        craft.segments.iter_mut().rev().take(64).for_each(|byte| *byte = 0xff)
    });
    crafted("entries the wrong way round", |craft| craft.entries.reverse());
    crafted("entries twice", |craft| {
        craft.entries = craft.entries.iter().flat_map(|entry| [entry.clone(), entry.clone()]).collect();
    });
    crafted("no entries but the root's", |craft| craft.entries.truncate(1));
    crafted("no entries", |craft| craft.entries.clear());
    crafted("all segments have the root's bytes", |craft| {
        let root = craft.entries[0].clone();
        craft.entries.iter_mut().for_each(|entry| entry[8..32].copy_from_slice(&root[8..32]));
    });
    memory_stays_bounded();
}

/// Thousands of entries with the same bytes: the work must be proportional to the file's size.
#[test]
fn many_segments_of_the_same_bytes_cost_little() {
    if !is_alone("malicious::many_segments_of_the_same_bytes_cost_little") {
        return;
    }
    let mut craft = good();
    craft.header[14] = 20;
    craft.layer[5] = 20;
    for axis in 0..2 {
        set(&mut craft.layer, 24 + 8 * axis, 1 << 20);
    }
    let root = craft.entries[0].clone();
    let shift = |level: u32| 63 - 2 * level;
    for node in 0..20_000u64 {
        let mut entry = root.clone();
        set(&mut entry, 0, node << shift(12) | 12);
        craft.entries.push(entry);
    }
    craft.entries.sort_by_key(|entry| number(entry, 0));
    refused(&craft, "20000 segments of the same bytes");
    memory_stays_bounded();
}

#[test]
fn sample_types_of_an_earlier_form_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.goblin");
    for number in [6, 8, 9] {
        let mut craft = good();
        craft.layer[0] = number;
        std::fs::write(&path, craft.bytes()).unwrap();
        let message = spinney::open(&path).unwrap_err().to_string();
        assert!(message.contains(&format!("obsolete sample type {number}")), "{message}");
    }
}

#[test]
fn invalid_headers_are_rejected() {
    if !is_alone("malicious::invalid_headers_are_rejected") {
        return;
    }
    // Axes, content, depth, layers.
    for at in 12..20 {
        for wrong in [0, 3, 30, 255] {
            let mut craft = good();
            craft.header[at] = wrong;
            survives(&craft.bytes(), &format!("{wrong} at {at} of the header"));
        }
    }
    // Sample type, channels, rule, kind, codec, depth, reach, stride; the length of the name.
    for at in (0..8).chain([54, 55]) {
        for wrong in [0, 3, 30, 255] {
            let mut craft = good();
            craft.layer[at] = wrong;
            survives(&craft.bytes(), &format!("{wrong} at {at} of the tree's header"));
        }
    }
    // Offsets of the run, the top levels and the segment index.
    for at in [88, 104, 112] {
        for wrong in [0, 1, 1025, 1 << 63, u64::MAX] {
            let mut craft = good();
            set(&mut craft.layer, at, wrong);
            survives(&craft.bytes(), &format!("{wrong} at {at} of the layer"));
        }
    }
    for axis in 0..3 {
        for wrong in [0, 1, 1025, 1 << 63, u64::MAX] {
            let mut craft = good();
            set(&mut craft.layer, 24 + 8 * axis, wrong);
            survives(&craft.bytes(), &format!("extent {wrong}"));
        }
    }
    for state in [0, 1, 3, 255] {
        crafted(&format!("root state {state}"), |craft| craft.layer[48] = state);
    }
    memory_stays_bounded();
}

#[test]
fn metadata_with_excessive_sizes_are_rejected() {
    if !is_alone("malicious::metadata_with_excessive_sizes_are_rejected") {
        return;
    }
    // bincode's 64-bit lengths start with 253.
    let huge: Vec<u8> = [253].into_iter().chain((1u64 << 60).to_le_bytes()).collect();
    let length = good().metadata.len();
    // Only opening reads them.
    let opens_or_not = |craft: &Craft| drop(Goblin::from_bytes(craft.bytes()));
    for at in (0..length).step_by(7) {
        let mut craft = good();
        craft.metadata.splice(at..at + 1, huge.iter().copied());
        opens_or_not(&craft);
        craft.metadata.truncate(at);
        refused(&craft, "metadata cut short");
    }
    for count in [17 << 20, 60 << 20] {
        let mut craft = good();
        craft.metadata = vec![0; count];
        opens_or_not(&craft);
    }
    for at in (0..length).step_by(7) {
        for wrong in [0, 1, 127, 250, 255] {
            let mut craft = good();
            craft.metadata[at] = wrong;
            opens_or_not(&craft);
        }
    }
    memory_stays_bounded();
}

#[test]
fn versions() {
    let all_right = |craft: &Craft| {
        let expected = query(Goblin::from_bytes(map().to_vec()));
        for results in query_all(&craft.bytes()) {
            let pairs = results.iter().zip(&expected);
            pairs.for_each(|(a, b)| assert_eq!(a.as_ref().unwrap(), b.as_ref().unwrap()));
        }
    };
    let mut craft = good();
    craft.unknown_section = true;
    all_right(&craft);
    craft.header[10] = 9;
    all_right(&craft);
    craft.header[8] = 2;
    let error = Goblin::from_bytes(craft.bytes()).err().unwrap();
    assert!(matches!(error, Error::Unsupported { .. }), "{error}");
    assert!(
        error.to_string().contains("version 2") && error.to_string().contains("or a newer one"),
        "{error}"
    );
}

fn memory_stays_bounded() {
    assert!(own_peak_memory() < 1 << 30, "{} bytes", own_peak_memory());
}
