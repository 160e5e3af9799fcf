//! Trees with far more nodes than their files have bytes, because many nodes share records: the
//! cost of queries is that of the records, and the size of outputs is predicted before they are
//! written.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use spinney::raw::ops::{Differences, diff_files, differences};
use spinney::raw::store::autumnal::{Autumnal, CompactOptions, Keep, compact};
use spinney::{
    Bounds, CombineOperation, CombineOptions, Dataset, Error, FileView, OpenOptions, Output, WriteOptions,
    combine, convert, transform,
};

use super::autumnal_malicious::{folded, folded_of, full};
use super::counted::CountedFile;
use crate::common::{QUAD, Random, byte, made};

/// Maximum reads of a query of the whole tree: some for each record on the path, one per level.
const FEW: u64 = 3000;

fn write(directory: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = directory.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn dataset(bytes: Vec<u8>) -> Dataset {
    Dataset::of(Arc::new(Autumnal::from_bytes(bytes).unwrap()).into()).unwrap()
}

#[test]
fn queries_cost_as_much_as_the_stored_records() {
    for depth in [12, 18, 29] {
        let CountedFile { editor, work, .. } = &CountedFile::new(folded(depth, full));
        let tree = Dataset::of(editor.tree().into()).unwrap();
        let side = 1u64 << depth;
        let cells = side * side;
        let (levels, reads) = work.of(|| tree.level_counts(1000, &()).unwrap().unwrap());
        assert!(reads < FEW, "levels: {reads}");
        let expected: Vec<[u64; 3]> = (0..=depth)
            .map(|level| if level == depth { [0, cells, 0] } else { [0, 0, 1 << (2 * level)] })
            .collect();
        assert_eq!(levels.levels(), expected);
        let whole = Bounds { min: [0; 3], max: [side, side, 1] };
        let (bins, reads) = work.of(|| tree.histogram(&whole, 1.0, 3.0, 4, &()).unwrap());
        assert!(reads < FEW, "histogram: {reads}");
        assert_eq!(bins, [cells / 4, 0, cells / 2, cells / 4]);
        let (statistics, reads) = work.of(|| tree.statistics(None, &()).unwrap());
        assert!(reads < FEW, "statistics: {reads}");
        assert_eq!((statistics.cells, statistics.channels[0].mean), (cells, 2.0));
        // A box of which only the left border cuts nodes.
        let half = Bounds { min: [side / 2 + 64, 0, 0], max: [side / 2 + 1024, 1024, 1] };
        let (statistics, reads) = work.of(|| tree.statistics(Some(half), &()).unwrap());
        assert!(reads < 20 * FEW, "statistics of a box: {reads}");
        assert_eq!(statistics.cells, 960 * 1024);
        let (bins, reads) = work.of(|| tree.histogram(&half, 1.0, 3.0, 2, &()).unwrap());
        assert!(reads < 20 * FEW, "histogram of a box: {reads}");
        assert_eq!(bins, [960 * 256, 960 * 768]);
        let (findings, reads) = work.of(|| tree.verify(1 << 20, &()).unwrap());
        assert!(reads < 2_000_000, "verify: {reads}");
        assert_eq!(findings, []);
    }
}

#[test]
fn each_defect_of_a_record_is_reported_once() {
    // Zones that describe other cells.
    for depth in [12, 29] {
        let tree = dataset(folded_of(depth, [1, 2, 2, 2], full));
        let findings = tree.verify(1 << 20, &()).unwrap();
        assert!((1..=40).contains(&findings.len()), "{findings:?}");
    }
}

#[test]
fn boxes_are_counted_as_cell_by_cell() {
    let tree = dataset(folded(9, full));
    let cells =
        made(QUAD, [512, 512, 1], |[x, y, _]| Some(byte([1, 2, 2, 3][((x & 1) + 2 * (y & 1)) as usize])));
    let mut random = Random(31);
    for _ in 0..40 {
        let min: [u64; 2] = std::array::from_fn(|_| random.below(500));
        let max: [u64; 2] = std::array::from_fn(|axis| min[axis] + 1 + random.below(512 - min[axis]));
        let bounds = Bounds { min: [min[0], min[1], 0], max: [max[0], max[1], 1] };
        let mut expected = [0; 3];
        for y in min[1]..max[1] {
            for x in min[0]..max[0] {
                expected[usize::from(cells.get([x, y, 0]).unwrap().to_bytes()[0]) - 1] += 1;
            }
        }
        assert_eq!(tree.histogram(&bounds, 1.0, 3.0, 3, &()).unwrap(), expected, "{bounds:?}");
        let classes = tree.statistics(Some(bounds), &()).unwrap().classes;
        let found: Vec<u64> = classes.iter().map(|(_, cells)| *cells).collect();
        assert_eq!(found, expected.into_iter().filter(|cells| *cells > 0).collect::<Vec<_>>(), "{bounds:?}");
    }
}

#[test]
fn differences_are_counted_once_for_many_nodes() {
    let directory = tempfile::tempdir().unwrap();
    let pair = |depth: u8| {
        let first = write(directory.path(), "first.autumn", &folded(depth, full));
        let second = write(directory.path(), "second.autumn", &folded_of(depth, [1, 2, 3, 2], full));
        [first, second]
    };
    let [first, second] = pair(29);
    let found =
        differences(&first, &second, &Default::default(), &Default::default(), &()).unwrap().differences;
    // Cells 2 and 3 of each four; cell 3 and cell 2 of the next four are not adjacent in FD code
    // order.
    let (changed, runs) = (1 << 57, 1 << 56);
    assert_eq!(found, Differences { changed, blocks: changed, runs, ..Differences::default() });
    assert_eq!(
        differences(&first, &first, &Default::default(), &Default::default(), &()).unwrap().differences,
        Differences::default()
    );
    // The same as cell by cell.
    let [first, second] = pair(8);
    let mut runs = 0;
    let one_by_one = diff_files(&first, &second, &Default::default(), &Default::default(), &(), &mut |_| {
        runs += 1;
        Ok(())
    });
    let found =
        differences(&first, &second, &Default::default(), &Default::default(), &()).unwrap().differences;
    assert_eq!((one_by_one.unwrap().differences, found.runs), (found, runs));
}

#[test]
fn copies_that_share_take_the_work_of_the_records() {
    let directory = tempfile::tempdir().unwrap();
    let from = write(directory.path(), "from.autumn", &folded(18, full));
    let to = directory.path().join("to.autumn");
    convert(&from, true, Output::create(&to).unwrap(), WriteOptions::new(1 << 24), &()).unwrap();
    let tree = Autumnal::open(&to, &OpenOptions::new()).unwrap();
    assert_eq!((tree.commit().inner_nodes, tree.commit().cells), (full(18) as u64, 1 << 36));
    // One for each height of nodes with records.
    assert_eq!(tree.commit().written.records, 9);
    assert!(tree.file_size() < 1 << 15);
    let tree = Dataset::of(tree.into()).unwrap();
    assert_eq!(tree.verify(1 << 20, &()).unwrap(), []);
    assert_eq!(
        differences(&from, &to, &Default::default(), &Default::default(), &()).unwrap().differences,
        Differences::default()
    );
    let again = directory.path().join("again.autumn");
    let output = Output::create(&again).unwrap();
    let commits =
        compact(&from, &CompactOptions::new(&Keep::Last(1), 1 << 24).share(true), output, &()).unwrap();
    assert_eq!((commits[0].inner_nodes, commits[0].written.records), (full(18) as u64, 9));
}

/// Maximum size of outputs in bytes.
const MOST: u64 = 1 << 20;

/// Returns the file names in a directory.
fn names(directory: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(directory).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn outputs_larger_than_the_free_space_are_rejected_before_writing() {
    let directory = tempfile::tempdir().unwrap();
    let from = write(directory.path(), "from.autumn", &folded(18, full));
    let records = full(18) as u64;
    for (name, needed) in [("to.goblin", 4 * records), ("to.autumn", 4 * records)] {
        let output = || Output::create(&directory.path().join(name)).unwrap().with_limit(MOST);
        let converted = convert(&from, false, output(), WriteOptions::new(1 << 24), &());
        let whole = FileView::of(&from);
        let transformed = transform(&whole, output(), WriteOptions::new(1 << 24), &()).map(drop);
        let files = [from.clone(), from.clone()];
        let combined = combine(
            CombineOperation::Over,
            CombineOptions::default(),
            &files,
            output(),
            WriteOptions::new(1 << 24),
            &(),
        )
        .map(drop);
        for refused in [converted, transformed, combined] {
            match refused.unwrap_err() {
                Error::InsufficientSpace { needed: found, limit: MOST, whose: "are allowed", .. } => {
                    assert_eq!(found, needed)
                }
                other => panic!("{name}: {other}"),
            }
        }
    }
    let output = Output::create(&directory.path().join("to.autumn")).unwrap().with_limit(MOST);
    let compacted = compact(&from, &CompactOptions::new(&Keep::Last(1), 1 << 24), output, &());
    assert!(matches!(compacted, Err(Error::InsufficientSpace { .. })));
    // More than any disk holds.
    let from = write(directory.path(), "from.autumn", &folded(29, full));
    let output = Output::create(&directory.path().join("to.goblin")).unwrap();
    let error = convert(&from, false, output, WriteOptions::new(1 << 24), &()).unwrap_err().to_string();
    assert!(
        error.contains(&(4 * full(29)).to_string()) && error.contains("free in its directory"),
        "{error}"
    );
    assert_eq!(names(directory.path()), ["from.autumn"]);
}

#[test]
fn limits_hold_while_writing() {
    let directory = tempfile::tempdir().unwrap();
    // The node count of a window of a file is unknown.
    let from = write(directory.path(), "from.autumn", &folded(18, full));
    let part = FileView { steps: vec!["window=1,1,1100,1100".parse().unwrap()], ..FileView::of(&from) };
    for name in ["to.goblin", "to.autumn"] {
        let path = directory.path().join(name);
        let output = Output::create(&path).unwrap().with_limit(MOST);
        let error = transform(&part, output, WriteOptions::new(1 << 24), &()).unwrap_err();
        let Error::Io { cause, .. } = &error else { panic!("{error}") };
        assert!(cause.to_string().contains(&MOST.to_string()), "{cause}");
        assert_eq!(names(directory.path()), ["from.autumn"]);
        // The maximum length that is allowed.
        transform(&part, Output::create(&path).unwrap(), WriteOptions::new(1 << 24), &()).unwrap();
        let length = std::fs::metadata(&path).unwrap().len();
        std::fs::remove_file(&path).unwrap();
        transform(&part, Output::create(&path).unwrap().with_limit(length), WriteOptions::new(1 << 24), &())
            .unwrap();
        std::fs::remove_file(&path).unwrap();
        let less = Output::create(&path).unwrap().with_limit(length - 1);
        assert!(transform(&part, less, WriteOptions::new(1 << 24), &()).is_err());
        assert_eq!(names(directory.path()), ["from.autumn"]);
    }
}
