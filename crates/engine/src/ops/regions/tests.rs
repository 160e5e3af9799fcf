//! Labels and sieves against a naive model: flood fills, cell by cell.

mod table;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::source::{Regions, ScanContext};
use super::sweep::Cells;
use super::words::Words;
use crate::ops::affine::View;
use crate::ops::{FileView, transform};
use crate::store::{BuildOptions, WriteOptions, build_tree};
use crate::tree::{MemTree, Source};
use spinney_base::io::Output;
use spinney_base::space::{Code, Dimension};
use spinney_base::value::{DataKind, Rule, SampleType, Value, ValueType};
use spinney_base::{Error, Progress, TreeType};

struct Random(u64);

impl Random {
    fn below(&mut self, most: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % most
    }
}

/// Tree and its cells in Z order.
struct Model {
    form: TreeType,
    depth: u8,
    cells: Vec<Option<Value>>,
}

impl Model {
    fn new(form: TreeType, depth: u8, cell: &mut dyn FnMut([u32; 3]) -> Option<Value>) -> Model {
        let count = form.dimension.cells(depth);
        let code = |path| Code::from_path(form.dimension, depth, path).unwrap();
        Model { form, depth, cells: (0..count).map(|path| cell(code(path).cell())).collect() }
    }

    /// Patches, single cells and VOID.
    fn random(form: TreeType, depth: u8, random: &mut Random) -> Model {
        let (patch, noise, classes) = (random.below(3), random.below(6), 1 + random.below(4));
        let seed = random.below(1 << 20);
        Model::new(form, depth, &mut |cell| {
            let place = cell.map(|cell| u64::from(cell >> patch));
            let key = seed + place[0] + (place[1] << 10) + (place[2] << 20);
            let mut number = Random(key.wrapping_mul(0x9e37_79b9_7f4a_7c15)).below(classes + 1);
            if random.below(10) < noise {
                number = random.below(classes + 1);
            }
            (number > 0).then(|| form.value.splat(number).unwrap())
        })
    }

    fn tree(&self) -> MemTree {
        let cell = |cell| {
            self.cells[Code::from_cell(self.form.dimension, self.depth, cell).unwrap().path() as usize]
        };
        MemTree::from_cells(self.form, self.depth, Rule::Nearest, &cell)
    }

    fn view(&self) -> View {
        View::whole(self.tree().into()).unwrap()
    }

    /// Neighbours of a cell.
    fn around(&self, path: usize, reach: u32) -> Vec<usize> {
        let cell =
            Code::from_path(self.form.dimension, self.depth, path as u64).unwrap().cell().map(i64::from);
        let layers = if self.form.axes() > 2 { -1..=1 } else { 0..=0 };
        let mut found = Vec::new();
        for dz in layers {
            for (dy, dx) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dy, dx))) {
                let steps = [dx, dy, dz].iter().filter(|step| **step != 0).count();
                let there = [cell[0] + dx, cell[1] + dy, cell[2] + dz].map(u32::try_from);
                if let ([Ok(x), Ok(y), Ok(z)], true) = (there, steps == 1 || steps > 1 && reach > 0) {
                    found.extend(
                        Code::from_cell(self.form.dimension, self.depth, [x, y, z])
                            .map(|code| code.path() as usize),
                    );
                }
            }
        }
        found
    }

    fn labels(&self, reach: u32) -> Vec<u64> {
        let mut labels = vec![0; self.cells.len()];
        let mut count = 0;
        for first in 0..self.cells.len() {
            if self.cells[first].is_none() || labels[first] > 0 {
                continue;
            }
            count += 1;
            labels[first] = count;
            let mut pending = vec![first];
            while let Some(cell) = pending.pop() {
                for other in self.around(cell, reach) {
                    if labels[other] == 0 && self.cells[other] == self.cells[first] {
                        labels[other] = count;
                        pending.push(other);
                    }
                }
            }
        }
        labels
    }

    fn sieved(&self, least: u64, reach: u32) -> Vec<Option<Value>> {
        let mut labels = self.labels(reach);
        let mut cells = self.cells.clone();
        loop {
            let mut sizes: BTreeMap<u64, u64> = BTreeMap::new();
            let mut adjacent: BTreeMap<u64, BTreeSet<u64>> = BTreeMap::new();
            for (cell, label) in labels.iter().enumerate().filter(|(_, label)| **label > 0) {
                *sizes.entry(*label).or_default() += 1;
                let others = self.around(cell, reach).into_iter().map(|other| labels[other]);
                adjacent
                    .entry(*label)
                    .or_default()
                    .extend(others.filter(|other| *other > 0 && other != label));
            }
            let small = adjacent.iter().filter(|(label, others)| sizes[label] < least && !others.is_empty());
            let Some((small, others)) = small.min_by_key(|(label, _)| (sizes[label], **label)) else {
                return cells;
            };
            let largest = *others.iter().max_by_key(|other| (sizes[other], u64::MAX - **other)).unwrap();
            let value_of = |label: u64| cells[labels.iter().position(|other| *other == label).unwrap()];
            let value = value_of(largest);
            let joined: Vec<u64> =
                others.iter().copied().filter(|other| value_of(*other) == value).chain([*small]).collect();
            for (label, cell) in labels.iter_mut().zip(&mut cells) {
                if joined.contains(label) {
                    (*label, *cell) = (largest, value);
                }
            }
        }
    }
}

fn passes(memory: u64) -> ScanContext<'static> {
    ScanContext { memory, directory: Path::new("/tmp"), progress: &() }
}

fn cells_of(tree: &Regions) -> Vec<Option<Value>> {
    let found = MemTree::from_source(tree, Rule::Nearest).unwrap();
    let (form, depth) = (tree.form(), tree.depth());
    let code = |path| Code::from_path(form.dimension, depth, path).unwrap();
    (0..form.dimension.cells(depth)).map(|path| found.value_at(code(path))).collect()
}

fn check_labels(model: &Model, reach: u32, block_levels: u8, most_narrow: u64) {
    let cells = Cells { block_levels, ..Cells::values(model.view(), reach) };
    let tree = Regions::labelled(cells, most_narrow, &passes(1 << 20)).unwrap();
    let labels = model.labels(reach);
    let count = labels.iter().max().copied().unwrap_or(0);
    let is_wide = tree.form().value.sample == SampleType::U64;
    assert_eq!(is_wide, count > most_narrow);
    let value = |label: u64| match label {
        0 => None,
        label if is_wide => Some(Value::from([label])),
        label => Some(Value::from([label as u32])),
    };
    let expected: Vec<Option<Value>> = labels.into_iter().map(value).collect();
    assert!(cells_of(&tree) == expected, "{} reach {reach} blocks of {block_levels} levels", model.form);
}

const QUAD: Dimension = Dimension::Quad;

fn form(dimension: Dimension, sample: SampleType) -> TreeType {
    TreeType::new(dimension, ValueType::new(sample, 1))
}

#[test]
fn labels_are_those_of_a_flood() {
    let mut random = Random(36);
    for round in 0..240 {
        let sample = SampleType::ALL[round % 10];
        let (dimension, depth) = if round % 3 == 0 { (Dimension::Oct, 3) } else { (QUAD, 4) };
        let model = Model::random(form(dimension, sample), depth, &mut random);
        let most_narrow = [u64::MAX, 3][round % 2];
        check_labels(&model, round as u32 / 3 % 2, random.below(5) as u8, most_narrow);
    }
    let colours = TreeType::new(QUAD, ValueType::new(SampleType::U16, 3));
    check_labels(&Model::random(colours, 5, &mut random), 1, 3, 9);
}

#[test]
fn labels_go_on_across_blocks() {
    let byte = form(QUAD, SampleType::U8);
    let value = |class: u32| Some(Value::from([class as u8]));
    // Nested rings that cross all borders of blocks, joined to a spiral where they pass the
    // diagonal.
    let spiral = |[x, y, _]: [u32; 3]| {
        let ring = x.min(y).min(255 - x).min(255 - y);
        let ring = if x + 1 == y && x < 128 { ring + 1 } else { ring };
        value(ring % 2)
    };
    let board = |[x, y, _]: [u32; 3]| value((x ^ y) & 1);
    let holes = |[x, y, _]: [u32; 3]| (x % 7 > 0 || y % 5 > 0).then(|| Value::from([0u8]));
    check_labels(&Model::new(byte, 8, &mut { spiral }), 1, 7, u64::MAX);
    check_labels(&Model::new(byte, 7, &mut { board }), 0, 6, u64::MAX);
    // (The maximum number of components in a block, whose numbers take four bytes.)
    check_labels(&Model::new(byte, 8, &mut { board }), 0, 8, u64::MAX);
    check_labels(&Model::new(byte, 8, &mut { holes }), 1, 6, u64::MAX);
    let mut random = Random(7);
    let bits = Model::random(form(Dimension::Oct, SampleType::U16), 5, &mut random);
    check_labels(&bits, 1, 4, u64::MAX);
    check_labels(&bits, 0, 3, u64::MAX);
}

#[test]
fn small_components_go_to_their_largest_neighbours() {
    let mut random = Random(5);
    for round in 0..160u64 {
        let (dimension, depth) =
            if round % 4 == 0 { (Dimension::Oct, 2) } else { (QUAD, 3 + (round % 8 == 1) as u8) };
        let sample = SampleType::ALL[round as usize % 10];
        let model = Model::random(form(dimension, sample), depth, &mut random);
        let (least, reach) = (1 + random.below(30), (round / 4 % 2) as u32);
        let cells = Cells { block_levels: random.below(4) as u8, ..Cells::values(model.view(), reach) };
        let tree = Regions::sieved_cells(cells, least, &passes(1 << 20)).unwrap();
        assert!(cells_of(&tree) == model.sieved(least, reach), "{} least {least} reach {reach}", model.form);
    }
}

/// File of noise in some classes, 600 x 600 of 1024 x 1024 cells.
fn noisy_file(directory: &Path, name: &str) -> std::path::PathBuf {
    let byte = form(QUAD, SampleType::U8);
    let noise = |[x, y, _]: [u32; 3]| {
        let mixed = Random(u64::from(x / 3) << 20 | u64::from(y / 2)).below(1 << 20);
        let class = Random(mixed).below(4);
        (x < 600 && y < 600 && class > 0).then(|| Value::from([class as u8]))
    };
    let tree = MemTree::from_cells(byte, 10, Rule::Majority, &noise);
    let path = directory.join(name);
    let options = BuildOptions::new(DataKind::Categorical, 10);
    build_tree(&tree, [600, 600, 1], &options, Output::create(&path).unwrap(), &()).unwrap();
    path
}

fn made(path: &Path, steps: &[&str], memory: u64) -> Vec<u8> {
    let mut chain = FileView::of(path);
    chain.steps = steps.iter().map(|step| step.parse().unwrap()).collect();
    let out = path.with_file_name("made.goblin");
    transform(&chain, Output::create(&out).unwrap(), WriteOptions::new(memory), &()).unwrap();
    std::fs::read(&out).unwrap()
}

#[test]
fn bytes_do_not_depend_on_memory_nor_labels_on_the_format() {
    let directory = tempfile::tempdir().unwrap();
    let goblin = noisy_file(directory.path(), "noise.goblin");
    for steps in [
        &["components=4"][..],
        &["components=8"],
        &["rotate=90", "components=4"],
        &["sieve=20"],
        &["sieve=9,connect=8", "components=8"],
    ] {
        // (Sieves hold their components in memory.)
        let little = if steps[0].starts_with("sieve") { 4 << 20 } else { 1 << 16 };
        let expected = made(&goblin, steps, 256 << 20);
        assert!(made(&goblin, steps, little) == expected, "{steps:?}");
    }
    // (The provenance contains the files' names, which have the same length.)
    let autumnal = noisy_file(directory.path(), "noise.autumn");
    let labels = |path: &Path| {
        made(path, &["components=4"], 1 << 20);
        let file =
            crate::ops::TreeFile::open(&path.with_file_name("made.goblin"), &Default::default()).unwrap();
        MemTree::from_source(&View::whole(file.into()).unwrap(), Rule::Nearest).unwrap()
    };
    let (a, b) = (labels(&goblin), labels(&autumnal));
    // (Reading cell by cell is slow: every seventh.)
    assert!((0..1 << 20).step_by(7).all(|path| {
        let code = Code::from_path(QUAD, 10, path).unwrap();
        a.value_at(code) == b.value_at(code)
    }));
}

#[test]
fn labels_come_from_rotated_views_as_from_files_of_them() {
    let directory = tempfile::tempdir().unwrap();
    let path = noisy_file(directory.path(), "noise.goblin");
    let at_once = made(&path, &["rotate=30", "components=8", "window=100,50,300,300"], 64 << 20);
    made(&path, &["rotate=30"], 64 << 20);
    let turned = directory.path().join("turned.goblin");
    std::fs::rename(directory.path().join("made.goblin"), &turned).unwrap();
    made(&turned, &["components=8"], 64 << 20);
    let labels = directory.path().join("labels.goblin");
    std::fs::rename(directory.path().join("made.goblin"), &labels).unwrap();
    let step_by_step = made(&labels, &["window=100,50,300,300"], 64 << 20);
    // (Except for the provenance, at the end.)
    let same = at_once.iter().zip(&step_by_step).take_while(|(a, b)| a == b).count();
    assert!(same > at_once.len() / 2, "{same} of {}", at_once.len());
}

/// Requests cancellation after a number of checks.
struct Stops(std::sync::atomic::AtomicU64, u64);

impl Progress for Stops {
    fn interrupted(&self) -> bool {
        self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed) >= self.1
    }
}

#[test]
fn what_is_interrupted_leaves_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let path = noisy_file(directory.path(), "noise.goblin");
    for step in ["components=4", "sieve=50"] {
        for after in [0, 1, 2, 3, 5, 8] {
            let mut chain = FileView::of(&path);
            chain.steps = vec![step.parse().unwrap()];
            let out = directory.path().join("out.goblin");
            let stops = Stops(Default::default(), after);
            let result = transform(&chain, Output::create(&out).unwrap(), WriteOptions::new(1 << 20), &stops);
            assert!(matches!(result, Err(Error::Interrupted)), "{step} {after}");
            let left: Vec<_> = std::fs::read_dir(directory.path())
                .unwrap()
                .map(|entry| entry.unwrap().file_name())
                .collect();
            assert_eq!(left, ["noise.goblin"]);
        }
    }
}

#[test]
fn what_cannot_be_done_is_said() {
    let mut random = Random(1);
    let view = || Model::random(form(QUAD, SampleType::U8), 3, &mut Random(3)).view();
    let error = |step: &str| view().through(&[step.parse().unwrap()]).unwrap_err().to_string();
    assert!(error("components=4").contains("spinney transform"));
    assert!(error("sieve=4").contains("spinney transform"));
    let whole = |step: &str| {
        let step: crate::ops::ViewOperation = step.parse().unwrap();
        step.apply_whole(view(), &passes(1 << 20)).map(|_| ()).unwrap_err().to_string()
    };
    assert!(whole("components=6").contains("4 or 8"));
    assert!(whole("sieve=5,connect=26").contains("4 or 8"));
    assert!(whole("sieve=5m2").contains("a number of cells"));
    for wrong in [
        "components=5",
        "components=",
        "sieve=0",
        "sieve=-1",
        "sieve=1,connect=5",
        "sieve=nan m2",
        "sieve=4,x",
    ] {
        assert!(wrong.parse::<crate::ops::ViewOperation>().is_err(), "{wrong}");
    }
    // More components than memory can hold.
    let model = Model::random(form(QUAD, SampleType::U8), 8, &mut random);
    let board = Model::new(model.form, 8, &mut |[x, y, _]| Some(Value::from([((x ^ y) & 1) as u8])));
    let error =
        Regions::sieved_cells(Cells::values(board.view(), 0), 5, &passes(1 << 16)).map(|_| ()).unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
}

#[test]
fn solids_are_labelled_by_what_is_half_full() {
    let model = Model::new(form(Dimension::Oct, SampleType::U8), 3, &mut |[x, y, z]| {
        let number = Random(u64::from(x + 8 * y + 64 * z)).below(4);
        (number > 0).then(|| Value::from([[0u8, 100, 130, 255][number as usize]]))
    });
    let seen = |value: Value| (value.to_bytes()[0] >= 128).then(|| Value::from([255u8]));
    let full = Model {
        cells: model.cells.iter().map(|value| value.and_then(seen)).collect(),
        form: model.form,
        depth: model.depth,
    };
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("solid.goblin");
    let tree = model.tree();
    let options = BuildOptions::new(DataKind::Continuous, 3).rule(Rule::Occupancy);
    build_tree(&tree, [8, 8, 8], &options, Output::create(&path).unwrap(), &()).unwrap();
    let view = FileView::of(&path).open().unwrap();
    let tree = Regions::components(&view, "26".parse().unwrap(), &passes(1 << 20)).unwrap();
    let value = |label: u64| (label > 0).then(|| Value::from([label as u32]));
    let expected: Vec<Option<Value>> = full.labels(1).into_iter().map(value).collect();
    assert!(cells_of(&tree) == expected);
}

#[test]
fn numbers_beyond_memory_come_back_from_the_file() {
    let directory = tempfile::tempdir().unwrap();
    let mut words = Words::new(directory.path(), 0);
    let mut expected = Vec::new();
    let mut random = Random(11);
    for round in 0..200_000u64 {
        words.push(round).unwrap();
        expected.push(round);
        let at = random.below(words.len());
        if round % 3 == 0 {
            words.set(at, round << 32).unwrap();
            expected[at as usize] = round << 32;
        }
        if round % 64 == 0 {
            assert_eq!(words.get(at).unwrap(), expected[at as usize]);
        }
    }
    assert!((0..words.len()).all(|at| words.get(at).unwrap() == expected[at as usize]));
    // (The file has no name.)
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
}

#[test]
fn columns_are_joined_far_below() {
    // Columns two cells wide, all of them joined by the last row.
    let model = Model::new(form(QUAD, SampleType::U8), 8, &mut |[x, y, _]| {
        (x / 2 % 2 == 0 || y == 255).then(|| Value::from([1u8]))
    });
    check_labels(&model, 0, 3, u64::MAX);
}
