//! After a crash at any time, a disk failure or a killed program, a file of several layers has all
//! layers as in the last commit, or all as in the one before.

use std::collections::HashMap;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::Instant;

use spinney::edit::{Edit, Editor, Note};
use spinney::raw::ops::apply_edits;
use spinney::raw::store::TreeWriter;
use spinney::raw::store::autumnal::Autumnal;
use spinney::{
    DataKind, Dataset, Dimension, Error, Frame, Header, Metadata, Output, Result, Rule, SampleType, TreeType,
    WriteOptions,
};

use crate::common::{Cells, QUAD, Random, assert_same, cells_of, goblin, options, quad, value, write_cells};
use crate::targets::disk::{Disk, Event, put};

const SECTOR: usize = 512;
/// Depth of the file's space.
const DEPTH: u8 = 6;

/// All layers of a file, in their order.
#[derive(Clone)]
struct Stack(Vec<(String, Cells)>);

/// Types of the layers: bytes and floats on the file's cells, and colours on larger ones.
const KINDS: [(TreeType, [u64; 3]); 3] =
    [(QUAD, [40, 33, 1]), (quad(SampleType::U16, 2), [20, 17, 1]), (quad(SampleType::F32, 1), [37, 40, 1])];

fn metadata(name: &str, cells: &Cells) -> Metadata {
    let frame = Frame::identity().coarser(DEPTH - cells.depth());
    Metadata { name: name.into(), frame, ..Metadata::default() }
}

impl Stack {
    fn new() -> Stack {
        let layer = |(number, (form, size)): (usize, (TreeType, [u64; 3]))| {
            (format!("layer {number}"), Cells::random(form, number as u64, size, 5, true))
        };
        Stack(KINDS.into_iter().enumerate().map(layer).collect())
    }

    fn write(&self, path: &Path) {
        let output = Output::create(path).unwrap();
        let count = self.0.len() as u32;
        let mut file = TreeWriter::create(output, (Dimension::Quad, DEPTH), count).unwrap();
        for (name, cells) in &self.0 {
            let options =
                options(Rule::Mean, DataKind::Continuous, cells.depth()).metadata(metadata(name, cells));
            let nodata = value(cells.form.value, 250);
            file.slabs(cells.form, &mut cells.slabs(nodata), Some(nodata), &options, &()).unwrap();
        }
        file.finish().unwrap();
    }

    /// The bytes of an Autumnal file.
    fn bytes(&self) -> Vec<u8> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("t.autumn");
        self.write(&path);
        std::fs::read(&path).unwrap()
    }

    /// Changes some cells of a layer.
    fn set(&mut self, editor: &mut Editor, number: usize, random: &mut Random) -> Result<()> {
        let (name, cells) = &mut self.0[number];
        editor.select(name)?;
        let mut edits = Vec::new();
        for _ in 0..1 + random.below(25) {
            let cell = cells.size.map(|end| random.below(end));
            let new = (random.below(5) > 0).then(|| value(cells.form.value, random.below(200)));
            cells.cells[(cell[1] * cells.size[0] + cell[0]) as usize] = new;
            edits.push((cell, new.map(|value| cells.form.value.numbers(value).to_vec())));
        }
        apply_edits(editor, &mut [Ok(Edit::Set(edits))].into_iter(), &()).map(drop)
    }

    /// Adds a layer with a few cells.
    fn add(&mut self, editor: &mut Editor, name: String, random: &mut Random) -> Result<()> {
        let (form, size) = KINDS[random.below(3) as usize];
        let cells = Cells { form, size, cells: vec![None; (size[0] * size[1]) as usize] };
        editor.add_layer(&header(&cells), metadata(&name, &cells))?;
        self.0.push((name, cells));
        self.set(editor, self.0.len() - 1, random)
    }

    fn drop(&mut self, editor: &mut Editor, random: &mut Random) -> Result<()> {
        let number = random.below(self.0.len() as u64) as usize;
        editor.drop_layer(&self.0.remove(number).0)
    }
}

/// Returns the header of a layer with these cells.
fn header(cells: &Cells) -> Header {
    goblin(cells, Rule::Mean, DataKind::Continuous).header().clone()
}

/// Changes several layers, adds and drops some, or reverts to an older commit; then commits.
fn change(editor: &mut Editor, random: &mut Random, commits: &mut Vec<Stack>) -> Result<()> {
    let mut stack = commits.last().unwrap().clone();
    // A change that was not reported as done may have been done.
    let changed = (|| {
        match random.below(5) {
            0 => {
                let number = 1 + random.below(commits.len() as u64);
                stack = commits[number as usize - 1].clone();
                editor.revert(number)?;
            }
            1 => stack.add(editor, format!("added {}", commits.len()), random)?,
            2 if stack.0.len() > 1 => {
                stack.drop(editor, random)?;
                let number = random.below(stack.0.len() as u64) as usize;
                stack.set(editor, number, random)?;
            }
            3 => {
                stack.add(editor, format!("added {}", commits.len()), random)?;
                stack.drop(editor, random)?;
            }
            _ => {
                for number in 0..stack.0.len() {
                    stack.set(editor, number, random)?;
                }
            }
        }
        editor.commit(Note::default())
    })();
    if !matches!(changed, Ok(None)) {
        commits.push(stack);
    }
    changed.map(drop)
}

/// Returns the number of the commit found in some bytes, after checking that all its layers are as
/// committed; with `verify`, also that all commits are valid.
fn found(bytes: Vec<u8>, commits: &[Stack], verify: bool) -> usize {
    let file = Autumnal::from_bytes(bytes).unwrap();
    let number = file.commit().number as usize;
    let Stack(layers) = &commits[number - 1];
    let names: Vec<&str> = file.commit().layers().iter().map(|layer| &*layer.name).collect();
    assert!(names.iter().eq(layers.iter().map(|(name, _)| name)), "commit {number}: {names:?}");
    for (layer, (name, cells)) in layers.iter().enumerate() {
        let tree = file.open_layer(layer).unwrap();
        assert_same(&cells_of(&tree, cells.size), cells, &format!("{name} of commit {number} after a crash"));
    }
    if verify {
        let mut findings = Dataset::of(Arc::new(file).into()).unwrap().verify(1 << 24, &()).unwrap();
        findings.retain(|finding| !finding.place.contains("meta slot"));
        assert_eq!(findings, []);
    }
    number
}

/// Returns the disk's contents after a power failure with pending writes: none or all of them, a
/// prefix ending at any byte, some of their sectors, or some bytes of small writes.
fn image(durable: &[u8], pending: &[(u64, Vec<u8>)], variant: u64, random: &mut Random) -> Vec<u8> {
    let mut image = durable.to_vec();
    let total: usize = pending.iter().map(|(_, bytes)| bytes.len()).sum();
    let mut left = match variant {
        0 => 0,
        1 => total,
        _ => random.below(total as u64 + 1) as usize,
    };
    if variant < 12 {
        for (offset, bytes) in pending {
            let length = bytes.len().min(left);
            left -= length;
            if length > 0 {
                put(&mut image, *offset, &bytes[..length]);
            }
        }
        return image;
    }
    let mut writes: Vec<(u64, &[u8])> = Vec::new();
    for (offset, bytes) in pending {
        let size = if bytes.len() < SECTOR && variant.is_multiple_of(2) { 1 } else { SECTOR };
        let write = |(number, bytes)| (*offset + (number * size) as u64, bytes);
        writes.extend(bytes.chunks(size).enumerate().map(write));
    }
    for n in (1..writes.len()).rev() {
        writes.swap(n, random.below(n as u64 + 1) as usize);
    }
    for (offset, bytes) in writes {
        if random.below(4) > variant % 4 {
            put(&mut image, offset, bytes);
        }
    }
    image
}

#[test]
fn every_crash_leaves_all_layers_of_one_commit() {
    let mut images = 0;
    for seed in 0..2 {
        let mut random = Random(seed);
        let mut commits = vec![Stack::new()];
        let begin = commits[0].bytes();
        let disk = Disk::new(begin.clone());
        let mut editor = disk.editor().unwrap();
        // Number of events after each commit.
        let mut ends = Vec::new();
        for _ in 0..14 {
            change(&mut editor, &mut random, &mut commits).unwrap();
            ends.push((disk.state().events.len(), commits.len()));
        }
        assert!(commits.len() > 8);
        let events = disk.state().events.clone();
        let (mut durable, mut pending) = (begin, Vec::new());
        let mut known: HashMap<Vec<u8>, usize> = HashMap::new();
        for (i, event) in events.iter().enumerate() {
            match event {
                Event::Write(offset, bytes) => pending.push((*offset, bytes.clone())),
                Event::Sync => {
                    pending.drain(..).for_each(|(offset, bytes)| put(&mut durable, offset, &bytes));
                }
            }
            let done = ends.iter().rfind(|(end, _)| *end <= i + 1).map_or(1, |(_, commits)| *commits);
            for variant in 0..36 {
                let image = image(&durable, &pending, variant, &mut random);
                images += 1;
                let new = known.len();
                let number = *known
                    .entry(image)
                    .or_insert_with_key(|image| found(image.clone(), &commits, new.is_multiple_of(8)));
                assert!(
                    number == done || number == done + 1,
                    "event {i}: commit {number}, {done} are durable"
                );
            }
        }
    }
    assert!(images > 1500, "{images}");
}

#[test]
fn the_editor_after_a_failure_has_all_layers() {
    let mut random = Random(5);
    let start = Stack::new();
    let bytes = start.bytes();
    let mut failures = 0;
    for good in 0..40 {
        let disk = Disk::new(bytes.clone());
        let mut commits = vec![start.clone()];
        disk.state().good = good;
        let failed = (|| {
            let mut editor = disk.editor()?;
            for _ in 0..30 {
                if let Err(error) = change(&mut editor, &mut random, &mut commits) {
                    // The disk works again, but its contents are unknown.
                    disk.state().good = usize::MAX;
                    let events = disk.state().events.len();
                    let mut stack = commits[0].clone();
                    let again = stack.add(&mut editor, "more".into(), &mut random);
                    assert!(again.is_err() || editor.commit(Note::default()).is_err());
                    assert_eq!(disk.state().events.len(), events);
                    return Err(error);
                }
            }
            Ok(())
        })();
        let error = failed.unwrap_err();
        assert!(matches!(error, Error::Io { .. }), "{error}");
        failures += 1;
        disk.state().good = usize::MAX;
        let left = disk.state().bytes.clone();
        let number = found(left, &commits, true);
        assert!(number + 1 >= commits.len(), "commit {number} of {}", commits.len());
        // The next editor continues from that state.
        commits.truncate(number);
        let mut next = disk.editor().unwrap();
        for _ in 0..3 {
            change(&mut next, &mut random, &mut commits).unwrap();
        }
        drop(next);
        let left = disk.state().bytes.clone();
        assert_eq!(found(left, &commits, true), commits.len());
    }
    assert_eq!(failures, 40);
}

/// Verifies a file and returns the names and all cells of all layers.
fn whole(path: &Path) -> Vec<(String, Cells)> {
    let file = spinney::open(path).unwrap();
    let mut findings = file.verify(1 << 24, &()).unwrap();
    findings.retain(|finding| !finding.place.contains("meta slot"));
    assert_eq!(findings, [], "{}", path.display());
    let layer = |layer: spinney::raw::ops::LayerInfo| {
        let tree = file.layer(&layer.name).unwrap();
        let cells = cells_of(&tree.as_file().unwrap(), layer.header.extent);
        (layer.name, cells)
    };
    file.layers().unwrap().into_iter().map(layer).collect()
}

/// Programs that are killed while they add, drop, edit or revert layers.
#[test]
fn killed_programs_leave_all_layers_or_none_of_a_change() {
    let directory = tempfile::tempdir().unwrap();
    let other = directory.path().join("other.goblin");
    let cells = Cells::random(QUAD, 9, [50, 60, 1], 5, true);
    write_cells(&other, &cells, &options(Rule::Mean, DataKind::Continuous, DEPTH));
    let mut random = Random(11);
    let stack = Stack::new();
    for name in ["s.goblin", "s.autumn"] {
        let path = directory.path().join(name);
        stack.write(&path);
        let (text, added) = (path.display().to_string(), other.display().to_string());
        let is_autumnal = name.ends_with("autumn");
        let mut before = whole(&path);
        let (mut killed, mut changes) = (0, 0);
        for round in 0..24 {
            let has_other = before.iter().any(|(name, _)| name == "other");
            let mut arguments = vec!["edit", "-q", &text];
            let of_layer = format!("{text}:layer 1");
            match round % 4 {
                1 if is_autumnal => arguments = vec!["revert", "-q", &text, "1"],
                3 if is_autumnal => {
                    arguments[2] = &of_layer;
                    arguments.extend(["fill", "--window", "1,1,9,9", "--value", "7"]);
                }
                _ if has_other => arguments.extend(["drop-layer", "other"]),
                _ => arguments.extend(["add-layer", &added]),
            }
            // The result of an undisturbed run.
            let copy = directory.path().join(format!("copy.{name}"));
            std::fs::copy(&path, &copy).unwrap();
            let run = |path: &str| {
                let mut command = Command::new(env!("CARGO_BIN_EXE_spinney"));
                command.args(arguments.iter().map(|argument| argument.replace(&text, path)));
                command
            };
            let start = Instant::now();
            assert!(run(&copy.display().to_string()).status().unwrap().success(), "{arguments:?}");
            let time = start.elapsed();
            let after = whole(&copy);
            let mut child = run(&text).spawn().unwrap();
            std::thread::sleep(time.mul_f64(random.below(1100) as f64 / 1000.0));
            let _ = child.kill();
            killed += usize::from(!child.wait().unwrap().success());
            let now = whole(&path);
            assert!(same(&now, &before) || same(&now, &after), "{arguments:?}");
            changes += usize::from(!same(&now, &before));
            before = now;
        }
        // How many are killed in time depends on the machine.
        println!("{name}: {killed} of 24 were killed, {changes} changed something");
        // Remains of a killed program do not block the next one.
        let added = spinney::FileView::of(&other);
        spinney::raw::ops::add_layer(
            &path,
            "at last",
            &added,
            Note::default(),
            WriteOptions::new(1 << 24),
            &(),
        )
        .unwrap();
        assert!(whole(&path).iter().any(|(name, _)| name == "at last"));
    }
}

fn same(a: &[(String, Cells)], b: &[(String, Cells)]) -> bool {
    let pairs = a.iter().zip(b).all(|((m, a), (n, b))| m == n && a.size == b.size && a.cells == b.cells);
    a.len() == b.len() && pairs
}
