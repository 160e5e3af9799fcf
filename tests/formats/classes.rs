//! Very many classes and very many commits: files, edits and results remain proportional to the
//! change, and exact.

use std::path::Path;

use spinney::edit::{Edit, Note};
use spinney::raw::dataset;
use spinney::raw::ops::apply_edits;
use spinney::raw::store::autumnal::Autumnal;
use spinney::raw::store::goblin::Goblin;
use spinney::{
    Bounds, DataKind, Dataset, Number, OpenOptions, Output, Rule, SampleType, TreeType, Value, WriteOptions,
    convert,
};

use super::counted::CountedFile;
use crate::common::{Cells, assert_same, cells_of, made, options, quad, same_trees, write_cells};

const FORM: TreeType = quad(SampleType::U32, 1);

/// Maximum number of classes that a zone lists.
const MOST: u64 = 1024;

/// The first class. Cell writers use a smaller number for VOID.
const FIRST: u32 = 1000;

/// Returns an image of `classes` classes: patches of some cells, and single cells between them.
fn class_raster(side: u64, classes: u64) -> Cells {
    let mix = |number: u64| number.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 20;
    made(FORM, [side, side, 1], |[x, y, _]| {
        let index = if (x / 8 + y / 8) % 2 == 0 { x / 4 + side * (y / 4) } else { x + side * y };
        Some(Value::from([FIRST + (mix(index + 1) % classes) as u32]))
    })
}

/// Image sides and class counts that are tested.
const SCALES: [(u64, u64); 3] = [(256, 1000), (256, 10_000), (512, 262_144)];

fn file_bytes(cells: &Cells, name: &str, (rule, kind): (Rule, DataKind)) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    write_cells(&path, cells, &options(rule, kind, cells.depth()));
    std::fs::read(path).unwrap()
}

/// Returns the cell count of each class in a box.
fn counted(cells: &Cells, bounds: &Bounds) -> Vec<(Number, u64)> {
    let mut classes = Vec::new();
    for y in bounds.min[1]..bounds.max[1] {
        for x in bounds.min[0]..bounds.max[0] {
            let bytes = cells.get([x, y, 0]).unwrap().to_bytes();
            classes.push(u32::from_le_bytes(bytes[..4].try_into().unwrap()));
        }
    }
    classes.sort_unstable();
    classes.chunk_by(|a, b| a == b).map(|run| (run[0].into(), run.len() as u64)).collect()
}

fn goblin(bytes: &[u8]) -> Dataset {
    Dataset::of(Goblin::from_bytes(bytes.to_vec()).unwrap().into()).unwrap()
}

fn autumnal(bytes: &[u8]) -> Dataset {
    Dataset::of(Autumnal::from_bytes(bytes.to_vec()).unwrap().into()).unwrap()
}

#[test]
fn class_lists_are_bounded_and_results_exact() {
    for (side, classes) in SCALES {
        let cells = class_raster(side, classes);
        let whole = Bounds::of_extent([side, side, 1]);
        let part = Bounds { min: [side / 4 + 3, 5, 0], max: [side - 7, side / 2 + 9, 1] };
        let kinds = [(Rule::Majority, DataKind::Categorical), (Rule::Nearest, DataKind::Categorical)];
        // One run suffices for the largest image.
        for (rule, kind) in kinds.into_iter().take(if side > 256 { 1 } else { 2 }) {
            let without = (Rule::Nearest, DataKind::Continuous);
            // Lists have a value and a count for each class.
            let bytes = file_bytes(&cells, "t.goblin", (rule, kind));
            let tree = goblin(&bytes);
            let lists = bytes.len() as u64 - file_bytes(&cells, "t.goblin", without).len() as u64;
            assert!(lists <= tree.segments() as u64 * MOST * 12, "{classes}: {lists}");
            let edited = file_bytes(&cells, "t.autumn", (rule, kind));
            let zones = (side / 64).pow(2) * 4 / 3 + 1;
            let lists = edited.len() as u64 - file_bytes(&cells, "t.autumn", without).len() as u64;
            assert!(lists <= zones * (MOST * 7 + 8) + 4096, "{classes}: {lists}");
            for tree in [&tree, &autumnal(&edited)] {
                for bounds in [whole, part] {
                    let found = tree.statistics(Some(bounds), &()).unwrap();
                    assert!(found.classes == counted(&cells, &bounds), "{classes}, {bounds:?}");
                    assert_eq!(found.cells, bounds.volume());
                }
                assert_eq!(tree.verify(1 << 24, &()).unwrap(), [], "{classes}");
            }
            // Convert to the other format and back.
            let directory = tempfile::tempdir().unwrap();
            let file = |name: &str| directory.path().join(name);
            std::fs::write(file("a.goblin"), &bytes).unwrap();
            let to = |from: &str, to: &str| {
                let output = Output::create(&file(to)).unwrap();
                convert(&file(from), false, output, WriteOptions::new(1 << 24), &()).unwrap();
            };
            to("a.goblin", "b.autumn");
            to("b.autumn", "c.goblin");
            to("c.goblin", "d.goblin");
            let [back, copied] = ["c.goblin", "d.goblin"].map(|name| std::fs::read(file(name)).unwrap());
            assert!(back == bytes, "{rule}, {classes}");
            assert!(copied == back, "{rule}, {classes}");
        }
    }
}

#[test]
fn majorities_among_very_many_classes_are_exact() {
    let cells = class_raster(256, 10_000);
    let bytes = file_bytes(&cells, "t.goblin", (Rule::Majority, DataKind::Categorical));
    let tree = cells.tree(Rule::Majority);
    same_trees(&Goblin::from_bytes(bytes).unwrap(), &tree);
    let bytes = file_bytes(&cells, "t.autumn", (Rule::Majority, DataKind::Categorical));
    same_trees(&Autumnal::from_bytes(bytes).unwrap(), &tree);
}

/// Sets a cell's value in a commit and returns the bytes written.
fn set(file: &mut CountedFile, [x, y]: [u64; 2], class: u32) -> u64 {
    let before = file.work.written();
    let edit = Edit::Set(vec![([x, y, 0], Some(vec![class.into()]))]);
    apply_edits(&mut file.editor, &mut [Ok(edit)].into_iter(), &()).unwrap();
    file.editor.commit(Note::default()).unwrap().unwrap();
    file.work.written() - before
}

#[test]
fn an_edit_among_very_many_classes_writes_little() {
    for (side, classes) in [(256, 1000), (256, 10_000), (512, 262_144)] {
        let mut cells = match classes {
            262_144 => {
                made(FORM, [side, side, 1], |[x, y, _]| Some(Value::from([FIRST + (x + side * y) as u32])))
            }
            _ => class_raster(side, classes),
        };
        let bytes = file_bytes(&cells, "t.autumn", (Rule::Majority, DataKind::Categorical));
        let mut file = CountedFile::new(bytes);
        for (at, class) in [([17, 33], 5), ([side - 1, 0], 5), ([17, 33], 4_000_000)] {
            let written = set(&mut file, at, class);
            assert!(written < 64 << 10, "{classes} classes: {written} bytes");
            cells.cells[(at[0] + side * at[1]) as usize] = Some(Value::from([class]));
        }
        let tree = autumnal(&file.bytes());
        let whole = Bounds::of_extent([side, side, 1]);
        assert!(tree.statistics(None, &()).unwrap().classes == counted(&cells, &whole), "{classes}");
        assert_eq!(tree.verify(1 << 26, &()).unwrap(), [], "{classes}");
        // The result equals a new build.
        if side == 256 {
            same_trees(&*file.editor.tree(), &cells.tree(Rule::Majority));
        }
        assert_same(&cells_of(&*file.editor.tree(), cells.size), &cells, "edited");
    }
}

#[test]
fn the_work_of_a_commit_does_not_grow_with_their_number() {
    let cells = class_raster(16, 50);
    let mut file = CountedFile::new(file_bytes(&cells, "t.autumn", (Rule::Majority, DataKind::Categorical)));
    let mut most = [0; 2];
    for number in 2..=10_000u64 {
        let before = file.work.reads();
        let written = set(&mut file, [number % 16, number / 16 % 16], 2000 + number as u32 % 40);
        let work = [file.work.reads() - before, written];
        if number < 100 {
            most = [0, 1].map(|kind| work[kind].max(most[kind]));
        } else {
            // An edit moves the records that it reads to extents of their own.
            assert!(work[0] <= 4 * most[0] && work[1] <= 2 * most[1], "{number}: {work:?}, {most:?}");
        }
        if number == 100 || number == 10_000 {
            let work = file.work.clone();
            let ((), reads) = work.of(|| file.reopen());
            assert!(reads < 100, "opening after {number} commits: {reads}");
        }
    }
    let bytes = file.bytes();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    std::fs::write(&path, bytes).unwrap();
    assert_eq!(
        dataset::open(&named(&path, 7777), &OpenOptions::new()).unwrap().commit().unwrap().number,
        7777
    );
}

/// Returns the path of a commit of a file.
fn named(path: &Path, number: u64) -> std::path::PathBuf {
    format!("{}@{number}", path.display()).into()
}
