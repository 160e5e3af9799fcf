//! Autumnal edits against brute-force edits of a cell array; history; concurrent openers.

use std::path::Path;

use spinney::edit::{Edit, Editor, FillRegion, Note, edit};
use spinney::query::Polygon;
use spinney::raw::dataset;
use spinney::raw::ops::{TreeFile, apply_edits, diff_files};
use spinney::raw::store::autumnal::{Autumnal, CompactOptions, History, Keep, compact};
use spinney::{
    Bounds, CombineOperation, CombineOptions, DataKind, Dimension, Error, FileView, OpenOptions, Output,
    Rule, SampleType, TreeType, Value, WriteOptions, convert,
};

use crate::common::{
    self, Cells, OCT, QUAD, Random, assert_same, cells_of, goblin_bytes, made, oct, quad, same_trees,
    set_operation,
};

const MEMORY: u64 = 16 << 20;

fn open(path: &Path) -> Autumnal {
    Autumnal::open(path, &OpenOptions::new()).unwrap()
}

/// Writes cells to a file.
pub(super) fn write(path: &Path, cells: &Cells, (rule, kind): (Rule, DataKind), share: bool) {
    let goblin = path.with_extension("first.goblin");
    std::fs::write(&goblin, goblin_bytes(cells, rule, kind)).unwrap();
    convert(&goblin, share, Output::create(path).unwrap(), WriteOptions::new(MEMORY), &()).unwrap();
    std::fs::remove_file(goblin).unwrap();
}

fn assert_good(path: &Path) {
    let tree = dataset::open(path, &OpenOptions::new()).unwrap();
    assert_eq!(tree.verify(MEMORY, &()).unwrap(), []);
}

fn note(message: impl Into<String>) -> Note {
    Note { time: Some(1), author: "test".into(), message: message.into() }
}

/// Returns a random edit, after applying it to the cells. Files of other trees go to `directory`.
pub(super) fn random_edit(random: &mut Random, directory: &Path, cells: &mut Cells) -> Edit {
    let (form, extent) = (cells.form, cells.size);
    let value = |random: &mut Random| {
        let number = random.below(6);
        (number > 0).then(|| common::value(form.value, number))
    };
    let samples = |value: Option<Value>| value.map(|value| form.value.numbers(value).to_vec());
    let bounds = |random: &mut Random| {
        let min: [u64; 3] = std::array::from_fn(|axis| random.below(extent[axis]));
        let max = std::array::from_fn(|axis| min[axis] + 1 + random.below(extent[axis] + 3 - min[axis]));
        Bounds { min, max: if form.dimension == Dimension::Oct { max } else { [max[0], max[1], 1] } }
    };
    let inside = |bounds: &Bounds, cell: [u64; 3]| {
        (0..3).all(|axis| bounds.min[axis] <= cell[axis] && cell[axis] < bounds.max[axis])
    };
    let other = |random: &mut Random, size: [u64; 3]| {
        let cells = Cells::random(form, random.below(1000), size, 5, random.below(2) == 0);
        let path = directory.join(format!("{}.goblin", random.below(u64::MAX)));
        std::fs::write(&path, goblin_bytes(&cells, Rule::Nearest, DataKind::Continuous)).unwrap();
        (cells, path)
    };
    match random.below(5) {
        0 => {
            let count = 1 + random.below(200);
            let list: Vec<_> = (0..count)
                .map(|_| (std::array::from_fn(|axis| random.below(extent[axis])), value(random)))
                .collect();
            for (cell, value) in &list {
                let at = (cell[2] * extent[1] + cell[1]) * extent[0] + cell[0];
                cells.cells[at as usize] = *value;
            }
            Edit::Set(list.into_iter().map(|(cell, value)| (cell, samples(value))).collect())
        }
        1 => {
            let (region, value) = (bounds(random), value(random));
            *cells = made(form, extent, |cell| if inside(&region, cell) { value } else { cells.get(cell) });
            Edit::Fill(FillRegion::Box(region), samples(value))
        }
        2 => {
            let corner = |random: &mut Random| {
                [0, 1].map(|axis| random.below(extent[axis] * 8 + 16) as f64 / 8.0 - 1.0 + 0.03)
            };
            let ring: Vec<[f64; 2]> = (0..3 + random.below(5)).map(|_| corner(random)).collect();
            let value = value(random);
            *cells = made(form, extent, |cell| if is_in(&ring, cell) { value } else { cells.get(cell) });
            Edit::Fill(FillRegion::Polygon(Polygon::new(&[ring]).unwrap()), samples(value))
        }
        3 => {
            let size = std::array::from_fn(|axis| 1 + random.below(extent[axis]));
            let (patch, path) = other(random, size);
            let at: [u64; 3] = std::array::from_fn(|axis| random.below(extent[axis]));
            let max = std::array::from_fn(|axis| (at[axis] + patch.size[axis]).min(extent[axis]));
            let (bounds, where_valid) = (Bounds { min: at, max }, random.below(2) == 0);
            *cells = made(form, extent, |cell| {
                let below = || patch.get(std::array::from_fn(|axis| cell[axis] - at[axis]));
                match inside(&bounds, cell) {
                    true if where_valid => below().or(cells.get(cell)),
                    true => below(),
                    false => cells.get(cell),
                }
            });
            Edit::Paste {
                patch: FileView::of(&path),
                at: Some(at.map(|cell| cell as i64)),
                void: !where_valid,
                options: Default::default(),
            }
        }
        _ => {
            let (other, path) = other(random, extent);
            let number = [1, 2, 6, 7][random.below(4) as usize];
            *cells = made(form, extent, |cell| {
                let (a, b) = (cells.get(cell), other.get(cell));
                let bit = match (a, b) {
                    (Some(_), Some(_)) => 0,
                    (Some(_), None) => 1,
                    (None, Some(_)) => 2,
                    (None, None) => return None,
                };
                if number >> bit & 1 == 1 { a.or(b) } else { None }
            });
            Edit::Apply(CombineOperation::set(set_operation(number)), path, Default::default())
        }
    }
}

/// Returns whether a cell's centre is in a ring, by brute force.
fn is_in(ring: &[[f64; 2]], cell: [u64; 3]) -> bool {
    let [x, y] = [cell[0] as f64 + 0.5, cell[1] as f64 + 0.5];
    let mut inside = false;
    for i in 0..ring.len() {
        let (a, b) = (ring[i], ring[(i + 1) % ring.len()]);
        if (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) {
            inside = !inside;
        }
    }
    inside
}

fn script(form: TreeType, seed: u64, size: [u64; 3], rule: Rule, kind: DataKind, share: bool) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    let mut random = Random(seed);
    let mut cells = Cells::random(form, seed, size, 4, true);
    write(&path, &cells, (rule, kind), share);
    let mut before = vec![cells.clone()];
    let mut reader = open(&path);
    for _ in 0..12 {
        // Each commit is made by a new editor, with one or several edits.
        let edits: Vec<_> = (0..1 + random.below(3))
            .map(|_| Ok(random_edit(&mut random, directory.path(), &mut cells)))
            .collect();
        let commit = edit(&path, edits, note("edited"), MEMORY, &()).unwrap();
        let tree = cells.tree(rule);
        let file = open(&path);
        same_trees(&file, &tree);
        assert_eq!(file.commit().inner_nodes, tree.inner_nodes() as u64);
        assert_good(&path);
        match commit {
            Some(commit) => {
                assert_eq!(commit.number, before.len() as u64 + 1);
                before.push(cells.clone());
                // The reader stays at its commit until it is refreshed.
                assert_eq!(reader.commit().number + 1, commit.number);
                assert!(reader.refresh().unwrap());
            }
            None => assert_same(&cells, before.last().unwrap(), "nothing changed"),
        }
        assert!(!reader.refresh().unwrap());
        // The same bytes as a tree built from the cells.
        let published = directory.path().join("t.goblin");
        convert(&path, false, Output::create(&published).unwrap(), WriteOptions::new(MEMORY), &()).unwrap();
        let built = directory.path().join("b.goblin");
        std::fs::write(&built, goblin_bytes(&cells, rule, kind)).unwrap();
        assert!(std::fs::read(&published).unwrap() == std::fs::read(&built).unwrap());
    }
    // Every commit is unchanged.
    for (i, cells) in before.iter().enumerate() {
        let file = open(format!("{}@{}", path.display(), i + 1).as_ref());
        assert_same(&cells_of(&file, size), cells, "an old commit");
        assert_good(format!("{}@{}", path.display(), i + 1).as_ref());
    }
    // Compacting some commits into a new file makes it smaller.
    let last = before.len() as u64;
    let kept: Vec<u64> = (1..=last).filter(|_| random.below(2) == 0).chain([last]).collect();
    let small = directory.path().join("small.autumn");
    let keep = Keep::Numbers(kept.clone());
    let options = CompactOptions::new(&keep, MEMORY).share(share);
    compact(&path, &options, Output::create(&small).unwrap(), &()).unwrap();
    assert!(std::fs::metadata(&small).unwrap().len() <= std::fs::metadata(&path).unwrap().len());
    let history = History::open(&small, &OpenOptions::new()).unwrap();
    let mut numbers: Vec<u64> = history.commits().map(|commit| commit.unwrap().number).collect();
    numbers.reverse();
    assert_eq!(
        numbers,
        kept.iter().copied().collect::<std::collections::BTreeSet<_>>().into_iter().collect::<Vec<_>>()
    );
    for number in numbers {
        let file = open(format!("{}@{number}", small.display()).as_ref());
        assert_same(&cells_of(&file, size), &before[number as usize - 1], "a commit after compaction");
        assert_good(format!("{}@{number}", small.display()).as_ref());
    }
    // Differences between two commits.
    let (a, b) = (random.below(last) as usize, random.below(last) as usize);
    let name = |i: usize| format!("{}@{}", path.display(), i + 1);
    let mut cells_in_runs = 0;
    let found = diff_files(
        name(a).as_ref(),
        name(b).as_ref(),
        &Default::default(),
        &Default::default(),
        &(),
        &mut |range| {
            cells_in_runs += range.last - range.first + 1;
            Ok(())
        },
    )
    .unwrap();
    let (mut added, mut removed, mut changed) = (0, 0, 0);
    for (a, b) in before[a].cells.iter().zip(&before[b].cells) {
        match (a, b) {
            (None, Some(_)) => added += 1,
            (Some(_), None) => removed += 1,
            (Some(a), Some(b)) if a != b => changed += 1,
            _ => {}
        }
    }
    let found = found.differences;
    assert_eq!((found.added, found.removed, found.changed), (added, removed, changed));
    assert_eq!(cells_in_runs, added + removed + changed);
    // Revert.
    edit(&path, [Ok(Edit::Revert(1))], note("back"), MEMORY, &()).unwrap();
    assert_same(&cells_of(&open(&path), size), &before[0], "reverted");
}

#[test]
fn scripts_of_edits_of_quadtrees() {
    use SampleType::*;
    script(QUAD, 1, [300, 200, 1], Rule::Majority, DataKind::Categorical, false);
    script(QUAD, 2, [257, 64, 1], Rule::Mean, DataKind::Continuous, true);
    script(quad(F32, 1), 3, [130, 300, 1], Rule::Mean, DataKind::Continuous, false);
    script(quad(U8, 3), 4, [40, 33, 1], Rule::Max, DataKind::Continuous, true);
    script(quad(I16, 1), 5, [65, 65, 1], Rule::Dominant, DataKind::Categorical, false);
}

#[test]
fn scripts_of_edits_of_octrees() {
    script(OCT, 6, [40, 33, 20], Rule::Occupancy, DataKind::Continuous, true);
    script(oct(SampleType::U16, 1), 7, [17, 60, 33], Rule::Majority, DataKind::Categorical, false);
}

#[test]
fn an_edit_writes_changed_nodes_and_their_ancestors() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    let cells = Cells::random(QUAD, 1, [1024, 1024, 1], 5, true);
    write(&path, &cells, (Rule::Mean, DataKind::Continuous), false);
    let before = std::fs::metadata(&path).unwrap().len();
    let set = Edit::Set(vec![([500, 700, 0], Some(vec![77.0.into()]))]);
    let commit = edit(&path, [Ok(set)], note("one cell"), MEMORY, &()).unwrap().unwrap();
    // At most one record for each level of 1024 cells.
    assert!((1..=10).contains(&commit.written.records), "{:?}", commit.written);
    assert!(std::fs::metadata(&path).unwrap().len() <= before + 2 * 4096 + 2048);
    // Repeating the edit changes nothing and makes no commit.
    let set = Edit::Set(vec![([500, 700, 0], Some(vec![77.0.into()]))]);
    assert!(edit(&path, [Ok(set)], note("again"), MEMORY, &()).unwrap().is_none());
}

#[test]
fn a_second_editor_is_rejected_and_the_first_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    write(&path, &Cells::random(QUAD, 1, [9, 9, 1], 5, true), (Rule::Mean, DataKind::Continuous), false);
    let editor = Editor::open(&path, MEMORY).unwrap();
    let refused = Editor::open(&path, MEMORY).err().unwrap();
    assert!(matches!(refused, Error::Locked { .. }), "{refused}");
    assert!(refused.to_string().contains(&format!("process {}", std::process::id())), "{refused}");
    // The uncommitted edit does not affect readers.
    assert_eq!(open(&path).commit().number, 1);
    drop(editor);
    Editor::open(&path, MEMORY).unwrap();
}

/// Gives a cell a value, without a commit.
fn set(editor: &mut Editor, cell: [u64; 3], value: u8) {
    let set = Edit::Set(vec![(cell, Some(vec![value.into()]))]);
    apply_edits(editor, &mut [Ok(set)].into_iter(), &()).unwrap();
}

#[test]
fn uncommitted_edits_are_discarded() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    let before = Cells::random(QUAD, 1, [100, 90, 1], 5, true);
    write(&path, &before, (Rule::Mean, DataKind::Continuous), false);
    let mut editor = Editor::open(&path, MEMORY).unwrap();
    for i in 0..90 {
        set(&mut editor, [i, 89 - i, 0], i as u8);
    }
    drop(editor);
    let file = open(&path);
    assert_eq!(file.commit().number, 1);
    assert_same(&cells_of(&file, before.size), &before, "nothing was committed");
    assert_good(&path);
    // The next edit overwrites it.
    let fill = Edit::Fill(FillRegion::Box(Bounds { min: [0; 3], max: [3, 3, 1] }), Some(vec![9.0.into()]));
    edit(&path, [Ok(fill)], note("filled"), MEMORY, &()).unwrap().unwrap();
    assert_good(&path);
}

#[test]
fn commits_are_found_among_many() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    write(&path, &Cells::random(QUAD, 1, [9, 9, 1], 5, false), (Rule::Mean, DataKind::Continuous), false);
    let mut editor = Editor::open(&path, MEMORY).unwrap();
    // A reader opened before stays at its commit while thousands of commits are added.
    let mut reader = open(&path);
    for i in 2..=1500u64 {
        set(&mut editor, [i % 9, i / 9 % 9, 0], (i % 250) as u8 + 1);
        let commit = editor.commit(note(format!("number {i}"))).unwrap().unwrap();
        assert_eq!(commit.number, i);
    }
    assert_eq!(reader.commit().number, 1);
    assert_same(
        &cells_of(&reader, [9, 9, 1]),
        &Cells::random(QUAD, 1, [9, 9, 1], 5, false),
        "the reader's commit",
    );
    assert!(reader.refresh().unwrap());
    assert_eq!(reader.commit().number, 1500);
    let history = History::open(&path, &OpenOptions::new()).unwrap();
    for number in [1, 2, 3, 700, 1023, 1024, 1025, 1499, 1500] {
        assert_eq!(history.commit(number).unwrap().number, number);
        let message = history.commit(number).unwrap().note.message;
        assert!(number == 1 || message == format!("number {number}"), "{message}");
    }
    for number in [0, 1501, u64::MAX] {
        assert!(history.commit(number).is_err());
    }
    assert_eq!(history.commits().count(), 1500);
}

#[test]
fn subtrees_of_other_commits_are_reused_not_copied() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    let cells = Cells::random(QUAD, 1, [512, 512, 1], 5, true);
    write(&path, &cells, (Rule::Mean, DataKind::Continuous), false);
    let all = || FillRegion::Box(Bounds::of_extent([512, 512, 1]));
    edit(&path, [Ok(Edit::Fill(all(), None))], note("nothing left"), MEMORY, &()).unwrap().unwrap();
    // Pasting back an aligned quarter of the first commit writes at most three new records.
    let first = FileView {
        steps: vec!["window=256,0,256,256".parse().unwrap()],
        ..FileView::of(format!("{}@1", path.display()).as_ref())
    };
    let paste = Edit::Paste { patch: first, at: Some([256, 0, 0]), void: true, options: Default::default() };
    let commit = edit(&path, [Ok(paste)], note("a quarter is back"), MEMORY, &()).unwrap().unwrap();
    assert!(commit.written.records <= 3, "{:?}", commit.written);
    let expected =
        made(QUAD, [512, 512, 1], |[x, y, _]| if x >= 256 && y < 256 { cells.get([x, y, 0]) } else { None });
    assert_same(&cells_of(&open(&path), [512, 512, 1]), &expected, "pasted");
    let changes = directory.path().join("changes.goblin");
    let files = [format!("{}@1", path.display()).into(), path.clone()];
    let output = Output::create(&changes).unwrap();
    spinney::combine(
        CombineOperation::Changed,
        CombineOptions::default(),
        &files,
        output,
        WriteOptions::new(MEMORY),
        &(),
    )
    .unwrap();
    let file = TreeFile::open(&changes, &OpenOptions::new()).unwrap();
    let expected =
        made(QUAD, [512, 512, 1], |[x, y, _]| if x >= 256 && y < 256 { None } else { cells.get([x, y, 0]) });
    assert_same(&cells_of(&file, [512, 512, 1]), &expected, "what has changed");
}

#[test]
fn compaction_keeps_equal_commits() {
    let directory = tempfile::tempdir().unwrap();
    let [path, small] = ["t.autumn", "small.autumn"].map(|name| directory.path().join(name));
    let cells = Cells::random(QUAD, 1, [9, 9, 1], 5, true);
    write(&path, &cells, (Rule::Mean, DataKind::Continuous), false);
    let region = FillRegion::Box(Bounds { min: [1, 2, 0], max: [5, 6, 1] });
    edit(&path, [Ok(Edit::Fill(region, None))], note("a hole"), MEMORY, &()).unwrap().unwrap();
    edit(&path, [Ok(Edit::Revert(1))], note("back"), MEMORY, &()).unwrap().unwrap();
    // Without the commit between them, the first and the last have the same tree.
    let made = {
        let keep = Keep::Numbers(vec![1, 3]);
        compact(&path, &CompactOptions::new(&keep, MEMORY), Output::create(&small).unwrap(), &()).unwrap()
    };
    let messages: Vec<_> = made.iter().map(|commit| (commit.number, commit.note.message.as_str())).collect();
    assert_eq!(messages, [(1, ""), (3, "back")]);
    assert_eq!(open(&small).commit().number, 3);
    assert_good(&small);
}

#[test]
fn an_autumnal_file_is_not_replaced() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    let cells = Cells::random(QUAD, 1, [9, 9, 1], 5, false);
    write(&path, &cells, (Rule::Mean, DataKind::Continuous), false);
    let before = std::fs::read(&path).unwrap();
    let goblin = directory.path().join("t.goblin");
    convert(&path, false, Output::create(&goblin).unwrap(), WriteOptions::new(MEMORY), &()).unwrap();
    let refused =
        convert(&goblin, false, Output::create(&path).unwrap(), WriteOptions::new(MEMORY), &()).unwrap_err();
    assert!(matches!(refused, Error::Unsupported { .. }), "{refused}");
    assert_eq!(std::fs::read(&path).unwrap(), before);
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 2);
    // Only existing Autumnal files can be edited.
    assert!(Editor::open(&goblin, MEMORY).is_err());
    // Patches must have the file's value type and dimension.
    for (name, form) in [("pairs.goblin", quad(SampleType::U8, 2)), ("octree.goblin", OCT)] {
        let other = directory.path().join(name);
        let cells = Cells::random(form, 1, [9, 9, 1], 5, false);
        std::fs::write(&other, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
        let paste = Edit::Paste {
            patch: FileView::of(&other),
            at: Some([0; 3]),
            void: false,
            options: Default::default(),
        };
        for wrong in [paste, Edit::Apply(CombineOperation::Over, other, Default::default())] {
            let refused = edit(&path, [Ok(wrong)], note("wrong"), MEMORY, &()).unwrap_err();
            assert!(matches!(refused, Error::Invalid { .. }), "{refused}");
        }
    }
    assert_eq!(open(&path).commit().number, 1);
}
