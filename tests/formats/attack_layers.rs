//! Malicious changes, with valid checksums, to files of several layers: an error or a harmless
//! result is required, and everything that the format forbids is detected.

use std::path::Path;
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use spinney::edit::{Edit, FillRegion, Note, edit};
use spinney::raw::ops::add_layer;
use spinney::raw::store::FileReference;
use spinney::raw::store::goblin::Goblin;
use spinney::{
    Bounds, Code, DataKind, Dimension, FileView, Frame, Metadata, Output, Rule, SampleType, TreeType,
    ValueType, WriteOptions, convert,
};

use super::attack_goblin::{Field, HEADER_FIELDS, LAYER_FIELDS, TREE_FIELDS, changed, fields};
use crate::common::command::{is_alone, own_peak_memory};
use crate::common::reference::{self, Cut};
use crate::common::{Cells, QUAD, Random, byte, made, options, write_cells};
use crate::targets::layers::{query_autumnal_layers, query_goblin_layers};
use crate::targets::seal::{self, END, HEAD, LAYER, RECORDS, SLOTS, TRAILER};

const CONTINUOUS: (Rule, DataKind) = (Rule::Mean, DataKind::Continuous);

/// Returns a file of three layers: one with so many segments that its index has pages with copies,
/// one of classes, and one of sample pairs of which some are missing.
fn goblin(size: [u64; 3]) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let [path, other] = ["cut.goblin", "other.goblin"].map(|name| directory.path().join(name));
    let cells = Cells::noise(QUAD, 3, size, 9);
    let file = reference::goblin(&cells.tree(Rule::Mean), size, CONTINUOUS, Cut::EVERYWHERE);
    std::fs::write(&path, file).unwrap();
    let pairs = ValueType::new(SampleType::U16, 2).with_missing(15);
    for (name, form, size, coarser, (rule, kind)) in [
        ("classes", QUAD, [13, 10, 1], 1, (Rule::Majority, DataKind::Categorical)),
        ("pairs", TreeType::new(Dimension::Quad, pairs), [17, 19, 1], 0, CONTINUOUS),
    ] {
        let cells = Cells::random(form, 5, size, 9, true);
        let metadata = Metadata { frame: Frame::identity().coarser(coarser), ..Metadata::default() };
        let options = options(rule, kind, cells.depth()).metadata(metadata);
        write_cells(&other, &cells, &options);
        add_layer(&path, name, &FileView::of(&other), Note::default(), WriteOptions::new(1 << 20), &())
            .unwrap();
    }
    std::fs::read(path).unwrap()
}

/// The same with a second commit.
fn autumnal(goblin: &[u8]) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let [from, path] = ["s.goblin", "s.autumn"].map(|name| directory.path().join(name));
    std::fs::write(&from, goblin).unwrap();
    convert(&from, false, Output::create(&path).unwrap(), WriteOptions::new(1 << 20), &()).unwrap();
    let region = FillRegion::Box(Bounds { min: [1, 1, 0], max: [3, 4, 1] });
    let place = FileReference::of(&path).of_layer("classes");
    edit(&place, [Ok(Edit::Fill(region, Some(vec![77.into()])))], Note::default(), 1 << 20, &()).unwrap();
    std::fs::read(&path).unwrap()
}

/// Returns the fields of a Goblin file, grouped by kind. Records and metadata are single bytes.
fn parts(file: &[u8], random: &mut Random) -> Vec<Vec<Field>> {
    let trailer = seal::trailer(file).unwrap();
    let mut parts = vec![
        fields("the header", 0, &HEADER_FIELDS),
        fields("the trailer", trailer, &[&HEADER_FIELDS[..], &[4, 8, 4]].concat()),
        fields("a section", trailer + TRAILER, &[4, 4, 8, 8]),
        fields("the end", file.len() - END, &[4, 4, 8]),
    ];
    let layers = seal::layers(file);
    for layer in &layers {
        parts.push(fields("the tree's header", *layer, &TREE_FIELDS));
        parts.push(fields("the layer", layer + 48, &LAYER_FIELDS));
        let levels = seal::index(file, *layer);
        for level in &levels {
            let entry = |(at, _): &seal::Indexed| fields("an entry of the index", *at, &[8, 8, 4, 4]);
            parts.push(level.iter().flat_map(entry).collect());
        }
        let size = seal::entry_size(file, *layer);
        let (mut heads, mut entries) = (Vec::new(), [Vec::new(), Vec::new()]);
        for (_, page) in levels.last().into_iter().flatten() {
            let copies = usize::from(u16::from_le_bytes([file[page.start], file[page.start + 1]]));
            heads.extend(fields("a page", page.start, &[&[2, 2, 4][..], &vec![8; copies]].concat()));
            for (number, entry) in seal::entries(file, page, size).into_iter().enumerate() {
                let fields = fields("an entry", entry, &[8, 8, 8, 4, 2, 1, 1, 4, 8, 8, 8, 8]);
                entries[usize::from(number >= copies)].extend(fields);
            }
        }
        parts.push(heads);
        parts.extend(entries);
        let (run, length) = (seal::long(file, layer + 88), seal::long(file, layer + 112));
        let byte = |_| fields("a record", (run + random.below(length)) as usize, &[1]);
        parts.push((0..300).flat_map(byte).collect());
        let (metadata, length) = (seal::long(file, layer + 136) as usize, seal::short(file, layer + 144));
        parts.push(fields("the metadata", metadata, &vec![1; length as usize]));
    }
    let names = layers.last().unwrap() + LAYER;
    let (_, table, length) = seal::section(file, b"LAYR").unwrap();
    parts.push(fields("a name", names, &vec![1; table + length - names]));
    parts
}

/// Changes some fields: flips a bit, adds or subtracts one, sets an extreme, random or other
/// field's value.
fn mutate(file: &mut [u8], parts: &[Vec<Field>], random: &mut Random) {
    for _ in 0..1 + random.below(3) {
        let part = &parts[random.below(parts.len() as u64) as usize];
        if part.is_empty() {
            continue;
        }
        let Field { at, size, .. } = part[random.below(part.len() as u64) as usize];
        let most = u64::MAX >> (64 - 8 * size);
        let mut eight = [0; 8];
        eight[..size].copy_from_slice(&file[at..at + size]);
        let number = u64::from_le_bytes(eight);
        let other = &part[random.below(part.len() as u64) as usize];
        let new = match random.below(6) {
            0 => number ^ 1 << random.below(8 * size as u64),
            1 => number.wrapping_add(1).wrapping_sub(2 * random.below(2)),
            2 => [0, 1, most, most / 2, most - 1, file.len() as u64][random.below(6) as usize],
            3 => random.next(),
            4 if other.size == size => {
                eight[..size].copy_from_slice(&file[other.at..other.at + size]);
                u64::from_le_bytes(eight)
            }
            _ => {
                // Swap two ranges.
                let length = [16, 24, 48, 152][random.below(4) as usize];
                let (a, b) = (at.min(other.at), at.max(other.at));
                if b - a >= length && b + length <= file.len() {
                    let (before, after) = file.split_at_mut(b);
                    before[a..a + length].swap_with_slice(&mut after[..length]);
                }
                continue;
            }
        };
        file[at..at + size].copy_from_slice(&new.to_le_bytes()[..size]);
    }
}

/// Returns the range of cases to test: `usual` cases, or the count and start set in the
/// environment.
fn cases(usual: u64) -> std::ops::Range<u64> {
    let number = |name| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let first = number("SPINNEY_ATTACK_FROM").unwrap_or(0);
    first..first + number("SPINNEY_ATTACK_CASES").unwrap_or(usual)
}

/// Applies random changes to a file and runs all queries.
fn attack(name: &str, file: &[u8], parts: &[Vec<Field>], usual: u64, query: &dyn Fn(Vec<u8>)) {
    let start = Instant::now();
    query(file.to_vec());
    for case in cases(usual) {
        let mut file = file.to_vec();
        let mut random = Random(case);
        let (from, start) = (file.clone(), Instant::now());
        mutate(&mut file, parts, &mut random);
        let differs = file.iter().zip(&from).position(|(a, b)| a != b);
        println!("{name}, case {case}, from byte {differs:?}");
        query(file);
        assert!(start.elapsed() < Duration::from_secs(10), "case {case} took {:?}", start.elapsed());
    }
    println!("{name}: {:?} in {:?}", cases(usual), start.elapsed());
    assert!(own_peak_memory() < 512 << 20, "{} bytes", own_peak_memory());
}

#[test]
fn goblin_files_changed_at_random() {
    if !is_alone("attack_layers::goblin_files_changed_at_random") {
        return;
    }
    let file = goblin([60, 52, 1]);
    let pages = seal::pages(&file, seal::layers(&file)[0]);
    assert!(pages.len() > 1 && file[pages[1].1.start] > 2, "a page with copies");
    let parts = parts(&file, &mut Random(1));
    attack("goblin", &file, &parts, 150, &|mut file| {
        seal::goblin(&mut file);
        query_goblin_layers(&file);
    });
}

#[test]
fn autumnal_files_changed_at_random() {
    if !is_alone("attack_layers::autumnal_files_changed_at_random") {
        return;
    }
    let file = autumnal(&goblin([21, 22, 1]));
    let mut parts = vec![
        fields("the header", 0, &HEADER_FIELDS),
        fields("records", RECORDS, &[1, 1, 1, 1]),
        SLOTS.iter().flat_map(|slot| fields("a slot", *slot, &[8, 8, 8, 8, 4])).collect(),
    ];
    for head in seal::extents(&file) {
        parts.push(fields("a head", head, &[4, 1, 3, 8, 8]));
        let length = seal::long(&file, head + 16) as usize;
        // Commits have the most structure, so they are attacked more often.
        for _ in 0..if file[head + 4] == 1 { 4 } else { 1 } {
            parts.push(fields("an extent", head + HEAD, &vec![1; length]));
        }
    }
    attack("autumnal", &file, &parts, 150, &|mut file| {
        seal::autumnal(&mut file);
        query_autumnal_layers(&file);
    });
}

/// Changes the newest commit byte by byte.
#[test]
fn commits_of_several_layers() {
    if !is_alone("attack_layers::commits_of_several_layers") {
        return;
    }
    let file = autumnal(&goblin([17, 9, 1]));
    let head = *seal::extents(&file).last().unwrap();
    assert_eq!(file[head + 4], 1);
    let length = seal::long(&file, head + 16) as usize;
    let mut random = Random(8);
    for field in fields("a commit", head + HEAD, &vec![1; length]) {
        changed(&file, &field, &mut |mut file, what| {
            // All of them would take minutes.
            if random.below(12) == 0 {
                println!("{what}");
                let case = Instant::now();
                seal::autumnal(&mut file);
                query_autumnal_layers(&file);
                assert!(case.elapsed() < Duration::from_secs(10), "{what} took {:?}", case.elapsed());
            }
        });
    }
    assert!(own_peak_memory() < 512 << 20, "{} bytes", own_peak_memory());
}

/// Returns whether a change is detected: opening fails, or verification reports a finding.
fn is_noticed(file: Vec<u8>) -> bool {
    Goblin::from_bytes(file)
        .and_then(|file| file.verify(1 << 20, &()))
        .map_or(true, |found| !found.is_empty())
}

#[test]
fn violations_of_the_format_are_detected() {
    let file = goblin([60, 52, 1]);
    assert!(!is_noticed(file.clone()));
    let layers = seal::layers(&file);
    let notice = |what: &str, change: &dyn Fn(&mut Vec<u8>)| {
        let mut file = file.clone();
        change(&mut file);
        seal::goblin(&mut file);
        assert!(is_noticed(file), "{what} was not detected");
    };
    // All layer fields in the table, except types, rules, extents (independent per layer) and
    // fields that readers ignore.
    for layer in &layers {
        let width = [1, 1, 4][layers.iter().position(|other| other == layer).unwrap()];
        for at in (4..12).chain(48..49).chain(54..56 + width).chain(72..LAYER) {
            // Checksums are recomputed. The threshold may have no effect on few nodes.
            if !(132..136).contains(&at) && !(148..152).contains(&at) && !(8..12).contains(&at) {
                let flip = |file: &mut Vec<u8>| file[layer + at] ^= 1 << (at % 3);
                notice(&format!("byte {at} of a layer"), &flip);
            }
        }
    }
    // Pages of the segment index: heads, copies, own entries.
    let size = seal::entry_size(&file, layers[0]);
    let pages = seal::pages(&file, layers[0]);
    let page = pages[1].1.clone();
    let copies = usize::from(file[page.start]);
    for at in (0..4).chain(8..8 + 8 * copies) {
        notice(&format!("byte {at} of a page"), &|file| file[page.start + at] ^= 1);
    }
    for entry in [0, copies - 1, copies, copies + 7] {
        let start = page.start + 8 + 8 * copies + entry * size;
        for at in (0..size).filter(|at| !(31..36).contains(at)) {
            notice(&format!("byte {at} of entry {entry} of a page"), &|file| file[start + at] ^= 1);
        }
    }
    for at in 0..20 {
        notice(&format!("byte {at} of the index"), &|file| file[pages[1].0 + at] ^= 1);
    }
    // Copies in another order, or of other entries.
    notice("copies in another order", &|file| {
        let (numbers, entries) = (page.start + 8, page.start + 8 + 8 * copies);
        file[numbers..numbers + 16].rotate_left(8);
        file[entries..entries + 2 * size].rotate_left(size);
    });
    // Runs, tops and metadata that belong to other layers, including layers that have not been
    // read.
    for [a, b] in [[0, 1], [1, 2], [2, 0]] {
        let [a, b] = [layers[a], layers[b]];
        for (what, part) in [("runs", 88..120), ("tops", 120..136), ("metadata", 136..152)] {
            notice(&format!("two {what} on top of each other"), &|file| {
                file.copy_within(a + part.start..a + part.end, b + part.start);
            });
        }
        notice("swapped runs", &|file| {
            let run: Vec<u8> = file[a + 88..a + 104].to_vec();
            file.copy_within(b + 88..b + 104, a + 88);
            file[b + 88..b + 104].copy_from_slice(&run);
        });
    }
    // Names: empty, duplicate, or not UTF-8.
    let names = layers[2] + LAYER;
    notice("a name twice", &|file| {
        file[layers[1] + 54] = 5;
        file[layers[0] + 54] = 5;
        file[names..names + 10].copy_from_slice(b"twicetwice");
    });
    notice("no name", &|file| file[layers[1] + 54] = 0);
    notice("a name that is no text", &|file| file[names] = 0xff);
    notice("a layer deeper than the file", &|file| file[14] -= 1);
}

/// An extent that is smaller than its cells.
#[test]
fn cells_outside_of_the_extent_are_detected() {
    let good = goblin([60, 52, 1]);
    let directory = tempfile::tempdir().unwrap();
    let findings = |name: &str, bytes: &[u8]| {
        let path = directory.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        spinney::open(&path).and_then(|file| file.verify(1 << 20, &())).unwrap()
    };
    assert_eq!(findings("t.goblin", &good), []);
    for (layer, name) in seal::layers(&good).into_iter().zip(["cut", "classes", "pairs"]) {
        for axis in 0..2 {
            let mut file = good.clone();
            file[layer + 24 + 8 * axis] -= 1;
            seal::goblin(&mut file);
            let found = findings("t.goblin", &file);
            assert!(found.len() == 1 && found[0].place.contains(name), "{found:?}");
        }
    }
    let good = autumnal(&goblin([17, 9, 1]));
    assert_eq!(findings("t.autumn", &good), []);
    // The first layer's header in the newest commit contains the layer's size.
    let head = *seal::extents(&good).last().unwrap();
    let size = [17u64, 9, 1].map(u64::to_le_bytes).concat();
    let at = head + good[head..].windows(24).position(|bytes| bytes == size).unwrap();
    for axis in 0..2 {
        let mut file = good.clone();
        file[at + 8 * axis] -= 1;
        seal::autumnal(&mut file);
        let found = findings("t.autumn", &file);
        assert!(found.len() == 1 && found[0].place.contains("cut"), "{found:?}");
    }
}

/// A file whose segment index has two levels.
static DEEP: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let size = [700, 690, 1];
    let cells = made(QUAD, size, |[x, y, _]| Some(byte(((x * 7 + y * 31 + x * y % 11) % 249) as u8)));
    reference::goblin(&cells.tree(Rule::Mean), size, CONTINUOUS, Cut::EVERYWHERE)
});

/// Two-level indexes with false entries: an error or the right result.
#[test]
fn indexes_of_several_levels() {
    if !is_alone("attack_layers::indexes_of_several_levels") {
        return;
    }
    let layer = seal::layers(&DEEP)[0];
    let levels = seal::index(&DEEP, layer);
    assert_eq!(levels.len(), 2);
    let good = Goblin::from_bytes(DEEP.clone()).unwrap();
    let mut random = Random(3);
    let codes: Vec<Code> = (0..40)
        .map(|_| {
            let cell = [random.below(700) as u32, random.below(690) as u32, 0];
            Code::from_cell(Dimension::Quad, 10, cell).unwrap()
        })
        .collect();
    let expected: Vec<_> = codes.iter().map(|code| good.value_at(*code).unwrap()).collect();
    let mut refused = 0;
    let range = cases(60);
    for case in range.clone() {
        let mut random = Random(case);
        let mut file = DEEP.clone();
        let level = &levels[random.below(2) as usize];
        let [a, b] = [0, 1].map(|_| level[random.below(level.len() as u64) as usize].0);
        match random.below(3) {
            // Copy an entry from another page, swap two entries, or change a byte.
            0 => file.copy_within(a..a + 24, b),
            1 => {
                let entry: Vec<u8> = file[a..a + 24].to_vec();
                file.copy_within(b..b + 24, a);
                file[b..b + 24].copy_from_slice(&entry);
            }
            _ => file[a + random.below(20) as usize] ^= 1 << random.below(8),
        }
        let is_changed = file != *DEEP;
        seal::goblin(&mut file);
        let Ok(file) = Goblin::from_bytes(file) else { continue };
        for (code, expected) in codes.iter().zip(&expected) {
            match file.value_at(*code) {
                Ok(found) => assert_eq!(found, *expected, "case {case}, {code}"),
                Err(_) => refused += 1,
            }
        }
        // Verification takes seconds.
        if is_changed && case % 30 == 0 {
            assert_ne!(file.verify(1 << 24, &()).unwrap(), [], "case {case}");
        }
    }
    assert!(refused > 0 || range.is_empty());
    assert!(own_peak_memory() < 1 << 30, "{} bytes", own_peak_memory());
}

/// The stacks in the fuzzing corpus are made from these files, and are valid.
#[test]
fn stacks_of_the_fixtures() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1");
    query_goblin_layers(&std::fs::read(fixtures.join("stack.goblin")).unwrap());
    query_autumnal_layers(&std::fs::read(fixtures.join("stack.autumn")).unwrap());
    let small = goblin([21, 18, 1]);
    let packed = seal::packed(&autumnal(&small));
    assert!(seal::unpacked(&packed).is_some());
}
