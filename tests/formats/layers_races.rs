//! Concurrent readers and writers of files of several layers: an opened file shows one commit of
//! all layers, whatever other processes do.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use spinney::edit::{Edit, Editor, FillRegion, Note, edit};
use spinney::raw::dataset::open;
use spinney::raw::ops::{add_layer, apply_edits, drop_layer};
use spinney::raw::store::autumnal::{CompactOptions, Keep, compact};
use spinney::raw::store::{FileReference, TreeWriter};
use spinney::{
    Bounds, DataKind, Dataset, Dimension, Error, FileView, Frame, Metadata, Number, OpenOptions, Output,
    Rule, SampleType, TreeType, WriteOptions,
};
use tempfile::TempDir;

use crate::common::command::stdout;
use crate::common::{Cells, QUAD, Random, made, options, quad, value, write_cells};

const MEMORY: u64 = 1 << 22;
const DEPTH: u8 = 7;
const LAYERS: [(&str, TreeType, [u64; 3]); 3] = [
    ("a", QUAD, [90, 100, 1]),
    ("b", quad(SampleType::U16, 1), [45, 50, 1]),
    ("c", quad(SampleType::F32, 1), [90, 70, 1]),
];

/// Returns a file whose layers have the number 1 in all cells.
fn file(name: &str) -> (TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    let output = Output::create(&path).unwrap();
    let mut file = TreeWriter::create(output, (Dimension::Quad, DEPTH), LAYERS.len() as u32).unwrap();
    for (name, form, size) in LAYERS {
        let cells = made(form, size, |_| Some(form.value.nearest(|_| 1.0)));
        let frame = Frame::identity().coarser(DEPTH - cells.depth());
        let metadata = Metadata { name: name.into(), frame, ..Metadata::default() };
        let options = options(Rule::Mean, DataKind::Continuous, cells.depth()).metadata(metadata);
        file.slabs(form, &mut cells.slabs(value(form.value, 250)), None, &options, &()).unwrap();
    }
    file.finish().unwrap();
    (directory, path)
}

/// Returns the number that all cells of a layer have.
fn number_of(tree: &Dataset) -> f64 {
    let statistics = tree.statistics(None, &()).unwrap();
    let [width, height, _] = tree.header().extent;
    assert_eq!((statistics.cells, statistics.void_cells), (width * height, 0));
    let channel = &statistics.channels[0];
    assert_eq!(channel.min, channel.max);
    let mut value = [Number::default(); 4];
    assert!(tree.point([width / 2, height - 1, 0], tree.depth(), &mut value).unwrap());
    assert_eq!(value[0].to_f64(), channel.mean);
    channel.mean
}

/// Sets all cells of all layers to a number, and commits.
fn fill_all(editor: &mut Editor, number: f64) {
    for (name, _, size) in LAYERS {
        editor.select(name).unwrap();
        let fill = Edit::Fill(FillRegion::Box(Bounds::of_extent(size)), Some(vec![number.into()]));
        apply_edits(editor, &mut [Ok(fill)].into_iter(), &()).unwrap();
    }
    editor.commit(Note::default()).unwrap().unwrap();
}

/// Threads and processes read all layers while a writer sets them to the number of the commit.
#[test]
fn readers_open_one_commit_of_all_layers() {
    const COMMITS: u64 = 120;
    let (_directory, path) = file("s.autumn");
    let (stop, reads) = (AtomicBool::new(false), AtomicU64::new(0));
    thread::scope(|scope| {
        for reader in 0..3 {
            let (path, stop, reads) = (&path, &stop, &reads);
            scope.spawn(move || {
                let mut newest = 0;
                let mut held: Option<Dataset> = None;
                while !stop.load(Ordering::Relaxed) {
                    if reader == 2 {
                        // Another process, which opens the file once.
                        let text = stdout(&["point", &path.display().to_string(), "--in", "cells", "44,44"]);
                        let numbers: Vec<&str> = text.trim().split(',').collect();
                        assert!(numbers.len() == 3 && numbers.iter().all(|n| *n == numbers[0]), "{text}");
                        reads.fetch_add(1, Ordering::Relaxed);
                        continue;
                    }
                    // Opened again, or refreshed.
                    let tree = match held.take() {
                        Some(mut tree) if reader == 1 => {
                            tree.refresh().unwrap();
                            tree
                        }
                        _ => open(path, &OpenOptions::new()).unwrap(),
                    };
                    let number = tree.commit().unwrap().number;
                    assert!(number >= newest, "commit {number} after {newest}");
                    newest = number;
                    for (name, ..) in LAYERS {
                        let layer = tree.layer(name).unwrap();
                        assert_eq!(layer.commit().unwrap().number, number);
                        assert_eq!(number_of(&layer), number as f64, "layer {name}");
                    }
                    held = Some(tree);
                    reads.fetch_add(1, Ordering::Relaxed);
                }
            });
        }
        let mut editor = Editor::open(&path, MEMORY).unwrap();
        for commit in 2..=COMMITS {
            fill_all(&mut editor, commit as f64);
            thread::sleep(Duration::from_millis(2));
        }
        // On a busy machine readers start late.
        while reads.load(Ordering::Relaxed) < 30 {
            thread::sleep(Duration::from_millis(5));
        }
        stop.store(true, Ordering::Relaxed);
    });
    let tree = open(&path, &OpenOptions::new()).unwrap();
    assert_eq!(tree.verify(1 << 24, &()).unwrap(), []);
    for number in [1, 2, COMMITS / 2, COMMITS] {
        let old = PathBuf::from(format!("{}@{number}", path.display()));
        for (name, ..) in LAYERS {
            let layer = open(&FileReference::of(&old).of_layer(name), &OpenOptions::new()).unwrap();
            assert_eq!(number_of(&layer), number as f64);
        }
    }
}

#[test]
fn editing_one_layer_locks_the_file() {
    let (directory, path) = file("s.autumn");
    let text = path.display().to_string();
    let other = other(directory.path());
    let editor = Editor::open(&FileReference::of(&path).of_layer("a"), MEMORY).unwrap();
    let second = Editor::open(&FileReference::of(&path).of_layer("b"), MEMORY);
    assert!(matches!(second, Err(Error::Locked { .. })));
    let chain = FileView::of(&other);
    assert!(matches!(
        add_layer(&path, "d", &chain, Note::default(), WriteOptions::new(MEMORY), &()),
        Err(Error::Locked { .. })
    ));
    assert!(matches!(
        drop_layer(&path, "b", Note::default(), &Default::default(), &()),
        Err(Error::Locked { .. })
    ));
    let (of_layer, other) = (format!("{text}:b"), other.display().to_string());
    for arguments in [
        &["edit", &of_layer, "fill", "--window", "0,0,9,9", "--value", "1"][..],
        &["edit", &text, "add-layer", &other],
        &["edit", &text, "drop-layer", "c"],
        &["revert", &text, "1"],
    ] {
        let run = Command::new(env!("CARGO_BIN_EXE_spinney")).args(arguments).output().unwrap();
        let text = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(1), "{arguments:?}: {text}");
        assert!(text.contains(&format!("is being edited by process {}", std::process::id())), "{text}");
    }
    drop(editor);
    let tree = open(&path, &OpenOptions::new()).unwrap();
    assert_eq!((tree.commit().unwrap().number, tree.layers().unwrap().len()), (1, 3));
}

/// Returns a file of one layer in the frame of the others.
fn other(directory: &Path) -> PathBuf {
    let path = directory.join("other.goblin");
    let cells = Cells::random(QUAD, 4, [80, 70, 1], 7, true);
    write_cells(&path, &cells, &options(Rule::Mean, DataKind::Continuous, DEPTH));
    path
}

/// Several writers add layers to one file concurrently, and drop them: each operation without an
/// error has taken effect.
#[test]
fn layers_added_by_concurrent_editors_are_all_kept() {
    for name in ["s.goblin", "s.autumn"] {
        let (directory, path) = file(name);
        let other = other(directory.path());
        let refused = AtomicU64::new(0);
        let until_done = |change: &dyn Fn() -> spinney::Result<()>| {
            for _ in 0..2000 {
                match change() {
                    Ok(()) => return,
                    Err(Error::Locked { .. } | Error::Moved { .. }) => {
                        refused.fetch_add(1, Ordering::Relaxed);
                        thread::sleep(Duration::from_millis(3));
                    }
                    Err(error) => panic!("{error}"),
                }
            }
            panic!("always refused");
        };
        thread::scope(|scope| {
            for thread in 0..4 {
                let (path, chain, until_done) = (&path, FileView::of(&other), &until_done);
                scope.spawn(move || {
                    for round in 0..5 {
                        let name = format!("layer {thread} {round}");
                        until_done(&|| {
                            add_layer(path, &name, &chain, Note::default(), WriteOptions::new(MEMORY), &())
                                .map(drop)
                        });
                        let file = open(path, &OpenOptions::new()).unwrap();
                        assert!(file.layer(&name).is_ok(), "{name} is lost");
                        if round % 2 == 0 {
                            until_done(&|| {
                                drop_layer(path, &name, Note::default(), &Default::default(), &()).map(drop)
                            });
                        }
                    }
                });
            }
        });
        let file = open(&path, &OpenOptions::new()).unwrap();
        let mut names: Vec<String> = file.layers().unwrap().into_iter().map(|layer| layer.name).collect();
        names.sort();
        let mut expected: Vec<String> = LAYERS.iter().map(|(name, ..)| (*name).into()).collect();
        expected.extend((0..4).flat_map(|thread| [1, 3].map(|round| format!("layer {thread} {round}"))));
        assert_eq!(names, expected, "{name}");
        assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
        println!("{name}: {} edits were rejected while the file was locked", refused.into_inner());
        // No temporary file remains.
        assert_eq!(std::fs::read_dir(&directory).unwrap().count(), 2);
    }
}

/// Readers of an old commit see all its layers, whatever happens to the file.
#[test]
fn readers_of_an_old_commit_are_not_disturbed() {
    let (directory, path) = file("s.autumn");
    let other = other(directory.path());
    let mut editor = Editor::open(&path, MEMORY).unwrap();
    fill_all(&mut editor, 2.0);
    drop(editor);
    let mut old: Vec<Dataset> = LAYERS
        .iter()
        .map(|(name, ..)| open(&FileReference::of(&path).of_layer(name), &OpenOptions::new()).unwrap())
        .collect();
    let first = open(&PathBuf::from(format!("{}@1", path.display())), &OpenOptions::new()).unwrap();
    let check = |old: &[Dataset]| {
        old.iter().for_each(|layer| assert_eq!(number_of(layer), 2.0));
        let names: Vec<String> = old[0].layers().unwrap().into_iter().map(|layer| layer.name).collect();
        assert_eq!(names, ["a", "b", "c"]);
        for (name, ..) in LAYERS {
            assert_eq!(number_of(&old[1].layer(name).unwrap()), 2.0);
            assert_eq!(number_of(&first.layer(name).unwrap()), 1.0);
        }
    };
    let mut random = Random(8);
    for round in 0..12 {
        match random.below(4) {
            0 => {
                let name = format!("other {round}");
                add_layer(
                    &path,
                    &name,
                    &FileView::of(&other),
                    Note::default(),
                    WriteOptions::new(MEMORY),
                    &(),
                )
                .unwrap();
            }
            1 => {
                let layers = open(&path, &OpenOptions::new()).unwrap().layers().unwrap();
                if let Some(layer) = layers.iter().find(|layer| layer.name.starts_with("other")) {
                    drop_layer(&path, &layer.name, Note::default(), &Default::default(), &()).unwrap();
                }
            }
            2 => {
                let small = directory.path().join("small.autumn");
                let output = Output::create(&small).unwrap();
                compact(&path, &CompactOptions::new(&Keep::Last(2), MEMORY), output, &()).unwrap();
                std::fs::rename(&small, &path).unwrap();
            }
            _ => {
                let fill = |(name, _, size): (&str, TreeType, [u64; 3])| {
                    let region = FillRegion::Box(Bounds::of_extent(size));
                    let number = 10 + round;
                    let fill = Edit::Fill(region, Some(vec![Number::from(number)]));
                    edit(&FileReference::of(&path).of_layer(name), [Ok(fill)], Note::default(), MEMORY, &())
                };
                LAYERS.into_iter().for_each(|layer| assert!(fill(layer).unwrap().is_some()));
            }
        }
        check(&old);
        assert_eq!(open(&path, &OpenOptions::new()).unwrap().verify(1 << 24, &()).unwrap(), []);
    }
    // A refreshed reader shows the same layer of the current file; if that is gone, it stays and
    // reports it.
    add_layer(&path, "before", &FileView::of(&other), Note::default(), WriteOptions::new(MEMORY), &())
        .unwrap();
    drop_layer(&path, "b", Note::default(), &Default::default(), &()).unwrap();
    let newest = open(&path, &OpenOptions::new()).unwrap();
    for (layer, (name, ..)) in old.iter_mut().zip(LAYERS) {
        if name == "b" {
            assert!(layer.refresh().is_err());
            assert_eq!(number_of(layer), 2.0);
        } else {
            assert!(layer.refresh().unwrap());
            assert_eq!(number_of(layer), number_of(&newest.layer(name).unwrap()));
        }
    }
}

/// A reader of a layer whose name is a number does not move to the layer with that index.
#[test]
fn moving_on_is_by_name() {
    let (directory, path) = file("s.autumn");
    let other = other(directory.path());
    add_layer(&path, "1", &FileView::of(&other), Note::default(), WriteOptions::new(MEMORY), &()).unwrap();
    let mut layer = open(&FileReference::of(&path).of_layer("1"), &OpenOptions::new()).unwrap();
    assert_eq!(layer.layer_number(), 3);
    drop_layer(&path, "1", Note::default(), &Default::default(), &()).unwrap();
    assert!(layer.refresh().is_err());
    assert_eq!((layer.layer_number(), layer.metadata().name.as_str()), (3, "1"));
}
