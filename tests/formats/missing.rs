//! Samples missing in single channels of cells are excluded from all aggregates.

use std::path::Path;

use spinney::raw::value::Mask;
use spinney::tree::build_slabs;
use spinney::{
    Bounds, BuildOptions, DataKind, Dataset, Dimension, Number, Output, Rule, SampleType, TreeType, Value,
    ValueType, ViewOperation, WriteOptions,
};

use crate::common::{Cells, Random};

const SIZE: [u64; 3] = [700, 300, 1];
const MISSING: f64 = 9.0;

/// Cells of numbers from 0 to 200, of which many are missing, also in whole blocks. Cells with no
/// samples are VOID.
fn cells(value_type: ValueType, seed: u64) -> Cells {
    let mut random = Random(seed);
    let mut cells = Vec::new();
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let alike = x / 64 % 2 == 0;
            let numbers: [f64; 4] = std::array::from_fn(|channel| {
                let number = if alike { x / 16 + y / 16 } else { random.below(200) };
                let is_missing = channel == 0 && x < 300 || (number + channel as u64).is_multiple_of(3);
                if is_missing || number as f64 == MISSING { MISSING } else { number as f64 }
            });
            let is_void = numbers[..usize::from(value_type.channels)].iter().all(|number| *number == MISSING);
            cells.push((!is_void).then(|| value_type.nearest(|channel| numbers[channel])));
        }
    }
    Cells { form: TreeType::new(Dimension::Quad, value_type), size: SIZE, cells }
}

fn write(path: &Path, cells: &Cells, rule: Rule) -> Dataset {
    let nodata = cells.form.value.splat(MISSING).unwrap();
    let options = BuildOptions::new(DataKind::Continuous, cells.depth()).rule(rule);
    let output = Output::create(path).unwrap();
    build_slabs(cells.form, &mut cells.slabs(nodata), Some(nodata), &options, output, &()).unwrap();
    let tree = spinney::open(path).unwrap();
    assert!(tree.verify(64 << 20, &()).unwrap().is_empty());
    tree
}

/// Returns the samples per channel of the cells of a box.
fn samples(cells: &Cells, bounds: &Bounds) -> Vec<Vec<f64>> {
    let mut samples = vec![Vec::new(); usize::from(cells.form.value.channels)];
    for y in bounds.min[1]..bounds.max[1].min(SIZE[1]) {
        for x in bounds.min[0]..bounds.max[0].min(SIZE[0]) {
            let Some(value) = cells.get([x, y, 0]) else { continue };
            for (samples, sample) in samples.iter_mut().zip(cells.form.value.samples(value).iter()) {
                samples.extend(Some(*sample).filter(|sample| *sample != MISSING));
            }
        }
    }
    samples
}

fn representative(rule: Rule, samples: &[f64], is_float: bool) -> f64 {
    if samples.is_empty() {
        return MISSING;
    }
    let mean = samples.iter().sum::<f64>() / samples.len() as f64;
    match rule {
        Rule::Min => samples.iter().copied().fold(f64::MAX, f64::min),
        Rule::Max => samples.iter().copied().fold(f64::MIN, f64::max),
        _ if is_float => f64::from(mean as f32),
        _ => (mean + 0.5).floor(),
    }
}

const TYPES: [ValueType; 3] = [
    ValueType::new(SampleType::U8, 3),
    ValueType::new(SampleType::U16, 2),
    ValueType::new(SampleType::F32, 4),
];

#[test]
fn representatives_are_of_the_cells_that_have_a_sample() {
    let directory = tempfile::tempdir().unwrap();
    for (value_type, name) in TYPES.into_iter().zip(["a.goblin", "b.autumn", "c.goblin"]) {
        let cells = cells(value_type.with_missing(MISSING), 7);
        let trees = [Rule::Mean, Rule::Min, Rule::Max]
            .map(|rule| (rule, write(&directory.path().join(format!("{rule}.{name}")), &cells, rule)));
        let depth = trees[0].1.depth();
        for level in 0..=depth {
            let side = 1 << (depth - level);
            let bounds = Bounds { min: [0; 3], max: [SIZE[0].div_ceil(side), SIZE[1].div_ceil(side), 1] };
            let pixels = trees.each_ref().map(|(_, tree)| {
                let mut bytes = vec![0; bounds.volume() as usize * value_type.size()];
                tree.window(level, &bounds, MISSING, &mut bytes, None).unwrap();
                bytes
            });
            // A sample of the many cells of the finest levels.
            let step = if side < 4 { 11 } else { 1 };
            for i in (0..bounds.volume() as usize).step_by(step) {
                let (x, y) = (i as u64 % bounds.max[0] * side, i as u64 / bounds.max[0] * side);
                let samples = samples(&cells, &Bounds { min: [x, y, 0], max: [x + side, y + side, 1] });
                for ((rule, _), pixels) in trees.iter().zip(&pixels) {
                    let pixel = &pixels[i * value_type.size()..][..value_type.size()];
                    let found = value_type.samples(Value::from_bytes(pixel));
                    for (channel, samples) in samples.iter().enumerate() {
                        let expected = representative(*rule, samples, value_type.sample.is_float());
                        assert_eq!(
                            found[channel], expected,
                            "{name} {rule} level {level}, {x},{y}, {channel}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn statistics_are_of_the_cells_that_have_a_sample() {
    let directory = tempfile::tempdir().unwrap();
    let boxes = [([0, 0], [700, 300]), ([13, 7], [680, 290]), ([0, 0], [256, 256]), ([5, 5], [6, 6])];
    for (value_type, name) in TYPES.into_iter().zip(["a.goblin", "b.autumn", "c.goblin"]) {
        let cells = cells(value_type.with_missing(MISSING), 8);
        let tree = write(&directory.path().join(name), &cells, Rule::Mean);
        let view =
            spinney::open(directory.path().join(name)).unwrap().view(&["mirror=x".parse().unwrap()]).unwrap();
        for ([left, top], [right, bottom]) in boxes {
            let bounds = Bounds { min: [left, top, 0], max: [right, bottom, 1] };
            let mirrored = Bounds { min: [700 - right, top, 0], max: [700 - left, bottom, 1] };
            let samples = samples(&cells, &bounds);
            for found in
                [tree.statistics(Some(bounds), &()).unwrap(), view.statistics(Some(mirrored), &()).unwrap()]
            {
                for (channel, found) in found.channels.iter().enumerate() {
                    let samples = &samples[channel];
                    assert_eq!(found.cells, samples.len() as u64, "{name} {bounds:?} {channel}");
                    if samples.is_empty() {
                        assert!(found.min.is_nan() && found.mean.is_nan());
                        continue;
                    }
                    let count = samples.len() as f64;
                    let mean = samples.iter().sum::<f64>() / count;
                    let variance = samples.iter().map(|sample| (sample - mean).powi(2)).sum::<f64>() / count;
                    assert_eq!(found.min, samples.iter().copied().fold(f64::MAX, f64::min));
                    assert_eq!(found.max, samples.iter().copied().fold(f64::MIN, f64::max));
                    assert!((found.mean - mean).abs() < 1e-9, "{found:?} {mean}");
                    assert!((found.standard_deviation - variance.sqrt()).abs() < 1e-6, "{found:?}");
                }
            }
            let histogram = tree.histogram(&bounds, 0.0, 200.0, 10, &()).unwrap();
            for (bin, found) in histogram.into_iter().enumerate() {
                let is_in = |sample: &&f64| ((**sample / 20.0) as usize).min(9) == bin;
                assert_eq!(found, samples[0].iter().filter(is_in).count() as u64, "{name} {bounds:?} {bin}");
            }
        }
    }
}

#[test]
fn operations_preserve_missing_samples() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let cells = cells(TYPES[0].with_missing(MISSING), 9);
    let tree = write(&path("a.goblin"), &cells, Rule::Mean);
    assert_eq!(tree.header().form.value.mask, Mask::Missing([9, 0, 0, 0, 0, 0, 0, 0]));
    // Convert to the other format and back.
    spinney::convert(
        &path("a.goblin"),
        false,
        Output::create(&path("b.autumn")).unwrap(),
        WriteOptions::new(64 << 20),
        &(),
    )
    .unwrap();
    spinney::convert(
        &path("b.autumn"),
        false,
        Output::create(&path("c.goblin")).unwrap(),
        WriteOptions::new(64 << 20),
        &(),
    )
    .unwrap();
    let bytes = |name| std::fs::read(path(name)).unwrap();
    assert!(bytes("a.goblin") == bytes("c.goblin"));
    // Cells of a coarser tree are computed from the same samples as the level of that size.
    let steps: [ViewOperation; 1] = ["depth=7".parse().unwrap()];
    let view = spinney::open(path("a.goblin")).unwrap().view(&steps).unwrap();
    let bounds = Bounds { min: [0; 3], max: [88, 38, 1] };
    let read = |tree: &Dataset| {
        let mut bytes = vec![0; bounds.volume() as usize * 3];
        tree.window(7, &bounds, MISSING, &mut bytes, None).unwrap();
        bytes
    };
    assert!(read(&view) == read(&tree));
}

#[test]
fn computed_samples_are_missing_where_an_operand_is() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let models = [11, 12].map(|seed| cells(TYPES[0].with_missing(MISSING), seed));
    let trees = ["a.goblin", "b.goblin"].map(path);
    for (model, tree) in models.iter().zip(&trees) {
        write(tree, model, Rule::Mean);
    }
    let output = Output::create(&path("c.goblin")).unwrap();
    spinney::combine(
        spinney::CombineOperation::Max,
        spinney::CombineOptions::default(),
        &trees,
        output,
        WriteOptions::new(64 << 20),
        &(),
    )
    .unwrap();
    let tree = spinney::open(path("c.goblin")).unwrap();
    assert!(tree.verify(64 << 20, &()).unwrap().is_empty());
    let value_type = models[0].form.value;
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let values = [0, 1].map(|tree: usize| models[tree].get([x, y, 0]));
            let samples = values.map(|value| value.map(|value| value_type.samples(value)));
            let expected: Vec<f64> = match samples {
                [Some(a), Some(b)] => (0..3)
                    .map(|c| if a[c] == MISSING || b[c] == MISSING { MISSING } else { a[c].max(b[c]) })
                    .collect(),
                _ => vec![MISSING; 3],
            };
            let mut found = [Number::from(MISSING); 4];
            tree.point([x, y, 0], tree.depth(), &mut found).unwrap();
            assert_eq!(found.map(Number::to_f64)[..3], expected[..], "{x},{y}");
        }
    }
}
