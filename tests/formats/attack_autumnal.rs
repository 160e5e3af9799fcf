//! Sets every field of Autumnal files, and every byte or a sample of the bytes, to malicious values
//! with valid checksums. Readers and editors must return an error or a harmless result.

use std::path::Path;
use std::time::{Duration, Instant};

use spinney::edit::{Edit, FillRegion, Note, edit};
use spinney::raw::store::autumnal::{CompactOptions, Keep, compact};
use spinney::raw::store::build_tree;
use spinney::tree::{MemTree, Source};
use spinney::{Bounds, DataKind, Output, Rule, SampleType, TreeType};

use super::attack_goblin::{Field, HEADER_FIELDS, changed, fields};
use crate::common::command::{is_alone, own_peak_memory};
use crate::common::{Cells, OCT, QUAD, byte, options, quad};
use crate::targets::edits::edit_as;
use crate::targets::seal::{self, HEAD, RECORDS, SLOTS};
use crate::targets::trees::query_autumnal;

/// A file with two commits.
fn file(tree: &MemTree, size: [u64; 3], (rule, kind): (Rule, DataKind), share: bool) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    let options = options(rule, kind, tree.depth()).share(share);
    build_tree(tree, size, &options, Output::create(&path).unwrap(), &()).unwrap();
    let region = FillRegion::Box(Bounds { min: [1, 1, 0], max: [3, 4, 1] });
    let note = Note { time: Some(5), author: "A".into(), message: "B".into() };
    edit(&path, [Ok(Edit::Fill(region, Some(vec![77.0.into()])))], note, 1 << 20, &()).unwrap();
    std::fs::read(path).unwrap()
}

fn random(form: TreeType, size: [u64; 3], rule: (Rule, DataKind)) -> Vec<u8> {
    file(&Cells::random(form, 3, size, 5, true).tree(rule.0), size, rule, false)
}

/// Returns all fields of an Autumnal file. Records, zones, commits and metadata are split into
/// bytes, of which one in `every` is used.
fn all_fields(bytes: &[u8], every: usize) -> Vec<Field> {
    let mut all = fields("the header", 0, &HEADER_FIELDS);
    all.extend(fields("records", RECORDS, &[1, 1, 1, 1]));
    SLOTS.iter().for_each(|slot| all.extend(fields("a slot", *slot, &[8, 8, 8, 8, 4])));
    for head in seal::extents(bytes) {
        all.extend(fields("a head", head, &[4, 1, 3, 8, 8]));
        let length = seal::long(bytes, head + 16) as usize;
        let kind = ["records", "a commit", "metadata", "packed records"][usize::from(bytes[head + 4])];
        all.extend(fields(kind, head + HEAD, &vec![1; length]).into_iter().step_by(every));
    }
    all
}

/// Changes the fields of a file, and one in `every` of its bytes; then runs all queries and edits
/// the file.
fn attack(name: &str, file: &[u8], every: usize) {
    let (mut cases, start) = (0u64, Instant::now());
    for field in all_fields(file, every) {
        changed(file, &field, &mut |mut file, what| {
            let case = Instant::now();
            println!("{what}");
            seal::autumnal(&mut file);
            query_autumnal(file.clone());
            // Edits the newest commit, or reverts to an older one.
            edit_as(if cases.is_multiple_of(3) { b"\x83\0\0\x01" } else { b"\x02\x01\x02\x09" }, file);
            assert!(case.elapsed() < Duration::from_secs(10), "{what} took {:?}", case.elapsed());
            cases += 1;
        });
    }
    println!("{name}: {cases} cases in {:?}", start.elapsed());
    assert!(own_peak_memory() < 256 << 20, "{} bytes", own_peak_memory());
}

#[test]
fn fields_of_quadtrees() {
    if is_alone("attack_autumnal::fields_of_quadtrees") {
        attack("bytes", &random(QUAD, [6, 5, 1], (Rule::Mean, DataKind::Continuous)), 1);
        attack("classes", &random(QUAD, [6, 5, 1], (Rule::Majority, DataKind::Categorical)), 7);
        attack("floats", &random(quad(SampleType::F32, 2), [4, 4, 1], (Rule::Mean, DataKind::Continuous)), 7);
    }
}

#[test]
fn fields_of_octrees() {
    if is_alone("attack_autumnal::fields_of_octrees") {
        attack("octree", &random(OCT, [4, 3, 4], (Rule::Occupancy, DataKind::Continuous)), 1);
    }
}

#[test]
fn fields_of_zones_and_shared_subtrees() {
    if is_alone("attack_autumnal::fields_of_zones_and_shared_subtrees") {
        let stripes =
            MemTree::from_cells(QUAD, 7, Rule::Majority, &|[x, _, _]| Some(byte((x / 8 % 2) as u8)));
        attack("zones", &file(&stripes, [128, 100, 1], (Rule::Majority, DataKind::Categorical), true), 13);
    }
}

/// Returns the commits of a file, with the older one of two packed.
fn with_packed_history(bytes: &[u8]) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let [path, to] = ["t.autumn", "p.autumn"].map(|name| directory.path().join(name));
    std::fs::write(&path, bytes).unwrap();
    let options = CompactOptions::new(&Keep::Last(2), 1 << 20).pack(true);
    compact(&path, &options, Output::create(&to).unwrap(), &()).unwrap();
    let packed = std::fs::read(to).unwrap();
    assert!(seal::extents(&packed).iter().any(|head| packed[head + 4] == 3));
    packed
}

#[test]
fn fields_of_packed_history() {
    if is_alone("attack_autumnal::fields_of_packed_history") {
        attack(
            "bytes",
            &with_packed_history(&random(QUAD, [6, 5, 1], (Rule::Mean, DataKind::Continuous))),
            7,
        );
        let classes = random(QUAD, [13, 11, 1], (Rule::Majority, DataKind::Categorical));
        attack("classes", &with_packed_history(&classes), 29);
        let octree = random(OCT, [4, 3, 5], (Rule::Occupancy, DataKind::Continuous));
        attack("octree", &with_packed_history(&octree), 17);
    }
}

#[test]
fn a_frozen_file_with_four_commits() {
    if is_alone("attack_autumnal::a_frozen_file_with_four_commits") {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1/history.autumn");
        attack("history", &std::fs::read(path).unwrap(), 7);
    }
}
