//! Transparent cells keep their colours, have weight 0, and are VOID to set operations.

use std::path::Path;

use spinney::edit::{Edit, Note};
use spinney::raw::value::Mask;
use spinney::tree::build_slabs;
use spinney::{
    Bounds, BuildOptions, CombineOperation, CombineOptions, DataKind, Dataset, Dimension, FileView, Output,
    Rule, SampleType, TreeType, Value, ValueType, WriteOptions,
};

use crate::common::{Cells, Random, set_operation};

const SIZE: [u64; 3] = [300, 200, 1];

const TYPES: [ValueType; 3] = [
    ValueType::new(SampleType::U8, 4).with_alpha(),
    ValueType::new(SampleType::U16, 2).with_alpha(),
    ValueType::new(SampleType::F32, 4).with_alpha(),
];

/// Cells of which a third is transparent, in blocks and singly, and some are VOID.
fn cells(value_type: ValueType, seed: u64) -> Cells {
    let mut random = Random(seed);
    let last = usize::from(value_type.channels) - 1;
    let kinds: Vec<u64> = (0..20 * 13).map(|_| random.below(5)).collect();
    let mut cells = Vec::new();
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            // In this region all cells are opaque.
            let is_opaque = (128..256).contains(&x) && y < 128;
            let kind = if is_opaque { 3 } else { kinds[(y / 16 * 20 + x / 16) as usize] };
            let colours: [f64; 4] = std::array::from_fn(|_| 1.0 + random.below(200) as f64);
            let alpha = match (kind, random.below(3)) {
                (0, _) | (1, 0) => 0.0,
                _ => colours[last],
            };
            let value = value_type.nearest(|channel| match channel {
                channel if channel == last => alpha,
                // Some blocks are uniform, including transparent ones.
                _ if kind == 0 && (x / 16).is_multiple_of(2) => 7.0,
                channel => colours[channel],
            });
            cells.push((kind != 2 || random.below(2) > 0).then_some(value));
        }
    }
    Cells { form: TreeType::new(Dimension::Quad, value_type), size: SIZE, cells }
}

fn write(path: &Path, cells: &Cells, rule: Rule) -> Dataset {
    let nodata = cells.form.value.splat(255.0).unwrap();
    let options = BuildOptions::new(DataKind::Continuous, cells.depth()).rule(rule);
    let output = Output::create(path).unwrap();
    build_slabs(cells.form, &mut cells.slabs(nodata), Some(nodata), &options, output, &()).unwrap();
    let tree = spinney::open(path).unwrap();
    assert_eq!(tree.header().form.value.mask, Mask::Alpha);
    assert!(tree.verify(64 << 20, &()).unwrap().is_empty());
    tree
}

fn is_opaque(value_type: ValueType, value: Value) -> bool {
    value_type.samples(value)[usize::from(value_type.channels) - 1] != 0.0
}

/// Returns the samples per channel of the opaque cells of a box.
fn samples(cells: &Cells, bounds: &Bounds) -> Vec<Vec<f64>> {
    let value_type = cells.form.value;
    let mut samples = vec![Vec::new(); usize::from(value_type.channels)];
    for y in bounds.min[1]..bounds.max[1].min(SIZE[1]) {
        for x in bounds.min[0]..bounds.max[0].min(SIZE[0]) {
            let Some(value) = cells.get([x, y, 0]) else { continue };
            let value = value_type.samples(value);
            if value[samples.len() - 1] != 0.0 {
                samples.iter_mut().zip(value.iter()).for_each(|(samples, sample)| samples.push(*sample));
            }
        }
    }
    samples
}

/// Returns all cells of a level, and which of them are not VOID.
fn level(tree: &Dataset, level: u8) -> (Vec<Value>, Vec<bool>, u64) {
    let side = 1 << (tree.depth() - level);
    let bounds = Bounds { min: [0; 3], max: [SIZE[0].div_ceil(side), SIZE[1].div_ceil(side), 1] };
    let size = tree.header().form.value.size();
    let mut valid = vec![false; bounds.volume() as usize];
    let mut bytes = vec![0; valid.len() * size];
    tree.window(level, &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
    (bytes.chunks_exact(size).map(Value::from_bytes).collect(), valid, bounds.max[0])
}

#[test]
fn transparent_cells_keep_their_colours_and_have_no_weight() {
    let directory = tempfile::tempdir().unwrap();
    for (value_type, name) in TYPES.into_iter().zip(["a.goblin", "b.autumn", "c.goblin"]) {
        let cells = cells(value_type, 3);
        for rule in [Rule::Mean, Rule::Min, Rule::Max] {
            let tree = write(&directory.path().join(format!("{rule}.{name}")), &cells, rule);
            let (values, valid, _) = level(&tree, tree.depth());
            for (index, (value, valid)) in values.into_iter().zip(valid).enumerate() {
                assert_eq!(valid.then_some(value), cells.cells[index], "{name} {rule} cell {index}");
            }
            for up in 1..=tree.depth() {
                let side = 1 << up;
                let (values, _, columns) = level(&tree, tree.depth() - up);
                for (index, value) in values.into_iter().enumerate() {
                    let (x, y) = (index as u64 % columns * side, index as u64 / columns * side);
                    let below = Bounds { min: [x, y, 0], max: [x + side, y + side, 1] };
                    let samples = samples(&cells, &below);
                    if samples[0].is_empty() {
                        // Transparent as well, if there are cells: with one colour, or none.
                        assert!(!is_opaque(value_type, value), "{name} {rule} {below:?}");
                        continue;
                    }
                    for (channel, found) in value_type.samples(value).iter().enumerate() {
                        let samples = &samples[channel];
                        let mean = samples.iter().sum::<f64>() / samples.len() as f64;
                        let expected = match rule {
                            Rule::Min => samples.iter().copied().fold(f64::MAX, f64::min),
                            Rule::Max => samples.iter().copied().fold(f64::MIN, f64::max),
                            _ if value_type.sample.is_float() => f64::from(mean as f32),
                            _ => (mean + 0.5).floor(),
                        };
                        assert_eq!(*found, expected, "{name} {rule} {below:?} {channel}");
                    }
                }
            }
        }
    }
}

#[test]
fn statistics_leave_transparent_cells_out() {
    let directory = tempfile::tempdir().unwrap();
    let cells = cells(TYPES[0], 4);
    for name in ["a.goblin", "b.autumn"] {
        let tree = write(&directory.path().join(name), &cells, Rule::Mean);
        for (min, max) in [([0, 0, 0], SIZE), ([13, 7, 0], [251, 190, 1]), ([5, 5, 0], [6, 6, 1])] {
            let bounds = Bounds { min, max };
            let found = tree.statistics(Some(bounds), &()).unwrap();
            let samples = samples(&cells, &bounds);
            for (channel, found) in found.channels.iter().enumerate() {
                let samples = &samples[channel];
                assert_eq!(found.cells, samples.len() as u64, "{name} {bounds:?}");
                if !samples.is_empty() {
                    let mean = samples.iter().sum::<f64>() / samples.len() as f64;
                    assert!((found.mean - mean).abs() < 1e-9);
                    assert_eq!(found.min, samples.iter().copied().fold(f64::MAX, f64::min));
                    assert_eq!(found.max, samples.iter().copied().fold(f64::MIN, f64::max));
                }
            }
            let histogram = tree.histogram(&bounds, 0.0, 210.0, 7, &()).unwrap();
            for (bin, found) in histogram.into_iter().enumerate() {
                let expected = samples[0].iter().filter(|sample| (**sample / 30.0) as usize == bin).count();
                assert_eq!(found, expected as u64, "{name} {bounds:?} {bin}");
            }
        }
    }
}

#[test]
fn set_operations_see_through_transparent_cells() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let models = [5, 6].map(|seed| cells(TYPES[0], seed));
    let trees = ["a.goblin", "b.autumn"].map(path);
    for (model, tree) in models.iter().zip(&trees) {
        write(tree, model, Rule::Mean);
    }
    let opaque =
        |tree: usize, index: usize| models[tree].cells[index].filter(|value| is_opaque(TYPES[0], *value));
    type Expected = fn(Option<Value>, Option<Value>) -> Option<Value>;
    let set = |number| CombineOperation::set(set_operation(number));
    let operations: [(CombineOperation, Expected); 4] = [
        (set(7), |a, b| a.or(b)),
        (set(1), |a, b| a.filter(|_| b.is_some())),
        (set(2), |a, b| a.filter(|_| b.is_none())),
        (CombineOperation::Over, |a, b| a.or(b)),
    ];
    for (operation, expected) in operations {
        let output = Output::create(&path("c.goblin")).unwrap();
        spinney::combine(
            operation,
            CombineOptions::default(),
            &trees,
            output,
            WriteOptions::new(64 << 20),
            &(),
        )
        .unwrap();
        let tree = spinney::open(path("c.goblin")).unwrap();
        assert!(tree.verify(64 << 20, &()).unwrap().is_empty());
        let (values, valid, _) = level(&tree, tree.depth());
        for (index, (value, valid)) in values.into_iter().zip(valid).enumerate() {
            let expected = expected(opaque(0, index), opaque(1, index));
            assert_eq!(valid.then_some(value), expected, "{operation}, cell {index}");
        }
        drop(tree);
        std::fs::remove_file(path("c.goblin")).unwrap();
    }
    // Pasting only over existing cells leaves the tree unchanged where it is transparent.
    let edit =
        Edit::Paste { patch: FileView::of(&trees[0]), at: None, void: false, options: Default::default() };
    spinney::edit::edit(&trees[1], [Ok(edit)], Note::default(), 64 << 20, &()).unwrap();
    let tree = spinney::open(&trees[1]).unwrap();
    let (values, valid, _) = level(&tree, tree.depth());
    for (index, (value, valid)) in values.into_iter().zip(valid).enumerate() {
        assert_eq!(valid.then_some(value), opaque(0, index).or(models[1].cells[index]), "cell {index}");
    }
}

#[test]
fn views_without_transparent_cells() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let cells = cells(TYPES[2], 7);
    let tree = write(&path("a.goblin"), &cells, Rule::Mean);
    let view = tree.view(&["opaque".parse().unwrap()]).unwrap();
    let (values, valid, _) = level(&view, view.depth());
    for (index, (value, valid)) in values.into_iter().zip(valid).enumerate() {
        let expected = cells.cells[index].filter(|value| is_opaque(TYPES[2], *value));
        assert_eq!(valid.then_some(value), expected, "cell {index}");
    }
    // Convert to the other format and back.
    let bytes = |name: &str| std::fs::read(path(name)).unwrap();
    for (from, to) in [("a.goblin", "b.autumn"), ("b.autumn", "c.goblin")] {
        spinney::convert(
            &path(from),
            false,
            Output::create(&path(to)).unwrap(),
            WriteOptions::new(64 << 20),
            &(),
        )
        .unwrap();
    }
    assert!(bytes("a.goblin") == bytes("c.goblin"));
}
