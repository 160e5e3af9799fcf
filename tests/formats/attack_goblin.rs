//! Sets every field of Goblin files, and a sample of record fields, to malicious values with valid
//! checksums: an error or a harmless result is required. Also tests files that are cut into the
//! maximum number of segments.

use std::time::{Duration, Instant};

use spinney::raw::store::goblin::Goblin;
use spinney::{Bounds, DataKind, Dataset, Rule, TreeType};

use crate::common::command::{is_alone, own_peak_memory};
use crate::common::reference::{self, Cut};
use crate::common::{Cells, OCT, QUAD, goblin, oct, quad, quad_size};
use crate::common::{Random, oct_size};
use crate::targets::seal::{self, END, TRAILER};
use crate::targets::trees::query_goblin;

/// A number in a file.
pub(super) struct Field {
    pub(super) name: String,
    pub(super) at: usize,
    /// Size in bytes, 1 to 8.
    pub(super) size: usize,
}

/// Returns consecutive fields of some sizes.
pub(super) fn fields(name: &str, start: usize, sizes: &[usize]) -> Vec<Field> {
    let mut at = start;
    let mut next = |(number, size): (usize, &usize)| {
        at += size;
        Field { name: format!("field {number} of {name}"), at: at - size, size: *size }
    };
    sizes.iter().enumerate().map(&mut next).collect()
}

/// Calls `each` with files in which a field has each of its test values: 0, 1, all bits set, one
/// more, one less, and each single bit flipped.
pub(super) fn changed(file: &[u8], field: &Field, each: &mut dyn FnMut(Vec<u8>, String)) {
    let Field { name, at, size } = field;
    let mut eight = [0; 8];
    eight[..*size].copy_from_slice(&file[*at..at + size]);
    let number = u64::from_le_bytes(eight);
    let most = u64::MAX >> (64 - 8 * size);
    // (Of 4 and 8 bytes, every second and fourth bit: others in fields at other offsets.)
    let every = size.div_ceil(2);
    let bits = (at / size % every..8 * size).step_by(every).map(|bit| number ^ 1 << bit);
    let mut numbers: Vec<u64> =
        [0, 1, most, most / 2, number.wrapping_add(1) & most, number.wrapping_sub(1) & most]
            .into_iter()
            .chain(bits)
            .collect();
    numbers.sort_unstable();
    numbers.dedup();
    for wrong in numbers.into_iter().filter(|wrong| *wrong != number) {
        let mut file = file.to_vec();
        file[*at..at + size].copy_from_slice(&wrong.to_le_bytes()[..*size]);
        each(file, format!("{name} at byte {at} is {wrong:#x} instead of {number:#x}"));
    }
}

/// Sizes of the fields of the file's header.
pub(super) const HEADER_FIELDS: [usize; 8] = [8, 2, 2, 1, 1, 1, 1, 4];
/// Sizes of the fields of a tree's header.
pub(super) const TREE_FIELDS: [usize; 15] = [1, 1, 1, 1, 1, 1, 1, 1, 4, 1, 3, 8, 8, 8, 8];
/// Sizes of the fields that follow it in the layer table.
pub(super) const LAYER_FIELDS: [usize; 17] = [1, 5, 2, 8, 8, 8, 8, 8, 8, 8, 8, 8, 4, 4, 8, 4, 4];

/// Returns all fields of a Goblin file, and single bytes of its metadata. One in `every` is used of
/// records, classes and metadata.
fn all_fields(file: &[u8], form: TreeType, every: usize) -> Vec<Field> {
    let mut all = fields("the header", 0, &HEADER_FIELDS);
    let trailer = seal::trailer(file).unwrap();
    all.extend(fields("the trailer", trailer, &[&HEADER_FIELDS[..], &[4, 8, 4]].concat()));
    all.extend(fields("a section", trailer + TRAILER, &[4, 4, 8, 8]));
    all.extend(fields("the end", file.len() - END, &[4, 4, 8]));
    let layer = seal::layers(file)[0];
    all.extend(fields("the tree's header", layer, &TREE_FIELDS));
    all.extend(fields("the layer", layer + 48, &LAYER_FIELDS));
    let (size, run) = (seal::entry_size(file, layer), seal::long(file, layer + 88) as usize);
    let (channels, sample) = (usize::from(form.value.channels), form.value.sample.size());
    let mut entries = Vec::new();
    for (index, page) in seal::pages(file, layer) {
        all.extend(fields("an entry of the index", index, &[8, 8, 4, 4]));
        let copies = usize::from(u16::from_le_bytes([file[page.start], file[page.start + 1]]));
        all.extend(fields("a page", page.start, &[&[2, 2, 4][..], &vec![8; copies]].concat()));
        entries.extend(seal::entries(file, &page, size));
    }
    let mut details = Vec::new();
    for entry in entries {
        all.extend(fields("an entry", entry, &[8, 8, 8, 4, 2, 1, 1, 4, 8]));
        all.extend(fields("statistics", entry + 44, &[sample, sample, 8, 8, 8, 8].repeat(channels)));
        let (records, classes) =
            (seal::short(file, entry + 24) as usize, seal::short(file, entry + 28) as u16 as usize);
        let layout = Goblin::from_bytes(file.to_vec()).unwrap().layout().size;
        let width = form.width();
        let values = vec![width.min(8); form.children() * width.div_ceil(8)];
        let rest: &[usize] = if form.children() == 4 { &[1, 3] } else { &[2, 2, 4] };
        let start = run + seal::long(file, entry + 8) as usize;
        for record in 0..records {
            details.extend(fields("a record", start + record * layout, &[&values, rest].concat()));
        }
        for class in 0..classes {
            details.extend(fields("a class", start + records * layout + class * (width + 8), &[width, 8]));
        }
    }
    let (metadata, length) =
        (seal::long(file, layer + 136) as usize, seal::short(file, layer + 144) as usize);
    details.extend(fields("the metadata", metadata, &vec![1; length]));
    all.extend(details.into_iter().step_by(every));
    all
}

/// Changes the fields of a file, and one in `every` fields of its records, and runs all queries.
fn attack(file: &[u8], form: TreeType, every: usize) {
    let (mut cases, start) = (0u64, Instant::now());
    for field in all_fields(file, form, every) {
        changed(file, &field, &mut |mut file, what| {
            let case = Instant::now();
            seal::goblin(&mut file);
            query_goblin(file);
            assert!(case.elapsed() < Duration::from_secs(10), "{what} took {:?}", case.elapsed());
            cases += 1;
        });
    }
    println!("{form}: {cases} cases in {:?}", start.elapsed());
    assert!(own_peak_memory() < 256 << 20, "{} bytes", own_peak_memory());
}

/// Returns a file that is cut into the maximum number of segments.
fn cut_everywhere(form: TreeType, seed: u64, size: [u64; 3], rule: (Rule, DataKind)) -> Vec<u8> {
    let cells = Cells::random(form, seed, size, 5, true);
    reference::goblin(&cells.tree(rule.0), size, rule, Cut::EVERYWHERE)
}

#[test]
fn fields_of_quadtrees() {
    if is_alone("attack_goblin::fields_of_quadtrees") {
        attack(&cut_everywhere(QUAD, 3, [13, 15, 1], (Rule::Mean, DataKind::Continuous)), QUAD, 5);
        attack(&cut_everywhere(QUAD, 3, [13, 15, 1], (Rule::Majority, DataKind::Categorical)), QUAD, 11);
    }
}

#[test]
fn fields_of_octrees_and_floats() {
    use spinney::SampleType::F32;
    if is_alone("attack_goblin::fields_of_octrees_and_floats") {
        attack(&cut_everywhere(OCT, 4, [7, 5, 6], (Rule::Max, DataKind::Continuous)), OCT, 5);
        let form = quad(F32, 2);
        let cells = Cells::random(form, 5, [7, 8, 1], 9, true);
        attack(&crate::common::goblin_bytes(&cells, Rule::Mean, DataKind::Continuous), form, 11);
    }
}

/// Checks that two files return the same results to all queries.
fn assert_same_results(found: &Dataset, expected: &Dataset) {
    let size = expected.header().extent;
    let width = expected.header().form.width();
    for level in 0..=expected.depth() {
        let bounds = expected.extent_at(level);
        let window = |tree: &Dataset| {
            let (mut bytes, mut valid) =
                (vec![0; bounds.volume() as usize * width], vec![false; bounds.volume() as usize]);
            tree.window(level, &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
            (bytes, valid)
        };
        assert!(window(found) == window(expected), "level {level}");
    }
    let part = Bounds { min: size.map(|cells| cells / 3), max: size.map(|cells| cells - cells / 4) };
    for bounds in [None, Some(part)] {
        let [mut found, mut expected] = [found, expected].map(|tree| tree.statistics(bounds, &()).unwrap());
        (found.segments_read, expected.segments_read) = (0, 0);
        assert_eq!(found, expected);
    }
    assert_eq!(found.df_text(1 << 20).unwrap(), expected.df_text(1 << 20).unwrap());
}

#[test]
fn files_cut_anywhere_say_the_same() {
    use spinney::SampleType::{I32, U16};
    let cuts =
        [(2, 1, 1), (2, 1, 3), (3, 1, 2), (4, 2, 1), (4, 1, 7), (6, 3, 4), (6, 2, 1 << 16), (8, 2, 4096)];
    let mut random = Random(7);
    for (form, rule) in [
        (QUAD, (Rule::Mean, DataKind::Continuous)),
        (QUAD, (Rule::Majority, DataKind::Categorical)),
        (quad(U16, 3), (Rule::Min, DataKind::Continuous)),
        (OCT, (Rule::Dominant, DataKind::Categorical)),
        (oct(I32, 1), (Rule::Nearest, DataKind::Continuous)),
    ] {
        for (reach, stride, threshold) in cuts {
            let is_quad = form.children() == 4;
            let size = if is_quad { quad_size(&mut random) } else { oct_size(&mut random) };
            let cells = Cells::random(form, random.next(), size, 5, true);
            let cut = Cut { reach, stride, threshold };
            let file = reference::goblin(&cells.tree(rule.0), size, rule, cut);
            let file = Goblin::from_bytes(file).unwrap_or_else(|error| panic!("{cut:?}: {error}"));
            // Verification rebuilds the tree with the parameters in the header and compares all
            // bytes.
            assert_eq!(file.verify(1 << 20, &()).unwrap(), [], "{form} {cut:?}");
            let expected = goblin(&cells, rule.0, rule.1);
            assert_eq!(file.metadata().counts, expected.metadata().counts);
            assert_same_results(&Dataset::of(file.into()).unwrap(), &Dataset::of(expected.into()).unwrap());
        }
    }
}
