//! Autumnal files with packed history: every commit is unchanged, and edits continue.

use std::path::Path;

use spinney::edit::{Edit, FillRegion, Note, edit};
use spinney::raw::dataset;
use spinney::raw::ops::add_layer;
use spinney::raw::store::autumnal::{Autumnal, CompactOptions, History, Keep, compact};
use spinney::{
    Bounds, DataKind, FileView, OpenOptions, Output, Rule, SampleType, TreeType, WriteOptions, convert,
};

use super::autumnal_edits::{random_edit, write};
use crate::common::{Cells, OCT, QUAD, Random, assert_same, cells_of, goblin_bytes, oct, quad, same_trees};

const MEMORY: u64 = 16 << 20;

fn open(path: &Path) -> Autumnal {
    Autumnal::open(path, &OpenOptions::new()).unwrap()
}

fn at(path: &Path, number: usize) -> Autumnal {
    open(format!("{}@{number}", path.display()).as_ref())
}

/// Compacts a file, keeping all its commits.
fn compacted(path: &Path, to: &Path, share: bool, pack: bool, memory: u64) -> u64 {
    let keep = Keep::Last(u64::MAX);
    let options = CompactOptions::new(&keep, memory).share(share).pack(pack);
    compact(path, &options, Output::create(to).unwrap(), &()).unwrap();
    assert_eq!(dataset::open(to, &OpenOptions::new()).unwrap().verify(MEMORY, &()).unwrap(), []);
    std::fs::metadata(to).unwrap().len()
}

/// Applies random edits, then writes all commits to files with packed history.
fn history_stays(form: TreeType, size: [u64; 3], (rule, kind): (Rule, DataKind), share: bool, seed: u64) {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str| directory.path().join(name);
    let path = file("t.autumn");
    let mut random = Random(seed);
    let mut cells = Cells::random(form, seed, size, 4, true);
    write(&path, &cells, (rule, kind), share);
    let mut before = vec![cells.clone()];
    for _ in 0..5 {
        let edits = [Ok(random_edit(&mut random, directory.path(), &mut cells))];
        if edit(&path, edits, Note::default(), MEMORY, &()).unwrap().is_some() {
            before.push(cells.clone());
        }
    }
    let plain = compacted(&path, &file("plain.autumn"), share, false, MEMORY);
    let packed = compacted(&path, &file("packed.autumn"), share, true, MEMORY);
    assert!(packed <= plain + 4096, "{form:?} {packed} {plain}");
    // The same bytes with little memory.
    compacted(&path, &file("again.autumn"), share, true, 1 << 20);
    assert!(std::fs::read(file("packed.autumn")).unwrap() == std::fs::read(file("again.autumn")).unwrap());
    let check = |path: &Path, before: &[Cells]| {
        for (i, cells) in before.iter().enumerate() {
            let tree = at(path, i + 1);
            same_trees(&tree, &cells.tree(rule));
            assert_same(&cells_of(&tree, size), cells, "a commit");
        }
    };
    check(&file("packed.autumn"), &before);
    // Commit notes are unchanged.
    let notes = |path: &Path| -> Vec<_> {
        let history = History::open(path, &OpenOptions::new()).unwrap();
        history
            .commits()
            .map(|commit| commit.unwrap())
            .map(|commit| (commit.number, commit.note, commit.cells))
            .collect()
    };
    assert_eq!(notes(&path), notes(&file("packed.autumn")));
    // Edits continue.
    for _ in 0..3 {
        let edits = [Ok(random_edit(&mut random, directory.path(), &mut cells))];
        if edit(&file("packed.autumn"), edits, Note::default(), MEMORY, &()).unwrap().is_some() {
            before.push(cells.clone());
        }
    }
    check(&file("packed.autumn"), &before);
    // Packs again the old history and the commits added since.
    compacted(&file("packed.autumn"), &file("twice.autumn"), share, true, MEMORY);
    check(&file("twice.autumn"), &before);
    // Unpacking gives the same file as if it had never been packed.
    let published = [file("twice.autumn"), file("packed.autumn")].map(|from| {
        let to = from.with_extension("goblin");
        convert(&from, false, Output::create(&to).unwrap(), WriteOptions::new(MEMORY), &()).unwrap();
        std::fs::read(to).unwrap()
    });
    let expected = goblin_bytes(&cells, rule, kind);
    assert!(published.iter().all(|bytes| *bytes == expected));
}

#[test]
fn history_of_quadtrees() {
    let classes = (Rule::Majority, DataKind::Categorical);
    history_stays(QUAD, [160, 90, 1], classes, false, 2);
    history_stays(QUAD, [60, 70, 1], classes, true, 3);
    history_stays(quad(SampleType::I16, 1), [140, 70, 1], (Rule::Mean, DataKind::Continuous), false, 4);
    history_stays(quad(SampleType::F32, 2), [40, 37, 1], (Rule::Mean, DataKind::Continuous), true, 5);
    history_stays(quad(SampleType::U8, 3), [130, 30, 1], (Rule::Max, DataKind::Continuous), false, 6);
}

#[test]
fn history_of_octrees() {
    history_stays(OCT, [33, 18, 20], (Rule::Occupancy, DataKind::Continuous), false, 7);
    history_stays(oct(SampleType::U16, 1), [16, 12, 20], (Rule::Majority, DataKind::Categorical), true, 8);
    history_stays(oct(SampleType::F64, 1), [12, 14, 9], (Rule::Mean, DataKind::Continuous), false, 9);
}

/// Packed history takes few bytes, though each commit changes a large share of the tree.
#[test]
fn history_becomes_smaller() {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str| directory.path().join(name);
    let path = file("t.autumn");
    let size = [700, 600, 1];
    let cells = Cells::random(QUAD, 11, size, 4, false);
    write(&path, &cells, (Rule::Majority, DataKind::Categorical), false);
    for number in 0..6u64 {
        let (from, value) = (100 * number, 1.0 + number as f64);
        let region = FillRegion::Box(Bounds { min: [from, 0, 0], max: [from + 37, 600, 1] });
        edit(&path, [Ok(Edit::Fill(region, Some(vec![value.into()])))], Note::default(), MEMORY, &())
            .unwrap();
    }
    let plain = compacted(&path, &file("plain.autumn"), false, false, MEMORY);
    let newest = {
        let options = CompactOptions::new(&Keep::Last(1), MEMORY);
        compact(&path, &options, Output::create(&file("newest.autumn")).unwrap(), &()).unwrap();
        std::fs::metadata(file("newest.autumn")).unwrap().len()
    };
    let packed = compacted(&path, &file("packed.autumn"), false, true, MEMORY);
    assert!(packed - newest < (plain - newest) / 2, "{packed} {plain}, the newest alone {newest}");
}

/// Layers of several types, some of which are added and dropped.
#[test]
fn history_of_layers() {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str| directory.path().join(name);
    let path = file("t.autumn");
    let size = [100, 90, 1];
    let classes = Cells::random(QUAD, 1, size, 4, true);
    write(&path, &classes, (Rule::Majority, DataKind::Categorical), false);
    let heights = Cells::random(quad(SampleType::I16, 1), 2, size, 5, true);
    std::fs::write(file("h.goblin"), goblin_bytes(&heights, Rule::Mean, DataKind::Continuous)).unwrap();
    let chain = FileView::of(&file("h.goblin"));
    add_layer(&path, "heights", &chain, Note::default(), WriteOptions::new(MEMORY), &()).unwrap();
    let region = FillRegion::Box(Bounds { min: [3, 5, 0], max: [60, 40, 1] });
    edit(&path, [Ok(Edit::Fill(region, Some(vec![9.0.into()])))], Note::default(), MEMORY, &()).unwrap();
    compacted(&path, &file("packed.autumn"), false, true, MEMORY);
    for number in 1..=3 {
        let [one, other] = [&path, &file("packed.autumn")].map(|path| at(path, number));
        for layer in 0..one.commit().layers().len() {
            let [one, other] = [&one, &other].map(|tree| tree.open_layer(layer).unwrap());
            assert_eq!(one.metadata().name, other.metadata().name);
            assert_same(&cells_of(&other, size), &cells_of(&one, size), "a layer");
        }
    }
}
