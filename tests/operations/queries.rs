//! Windows, points, statistics and searches against an array of cells.

use std::path::Path;

use spinney::query::{Condition, FoundBlock, PointSamples};
use spinney::{Bounds, Code, DataKind, Dimension, Number, Rule, SampleType, TreeType, Value};

use crate::common::{
    self, Cells, OCT, QUAD, Random, cells_below, dataset, goblin, made, oct, options, quad, value_types,
    write_cells,
};

/// Returns a box in, across or outside a space of `side` cells per axis.
fn some_bounds(dimension: Dimension, random: &mut Random, side: u64) -> Bounds {
    let mut bounds = Bounds { min: [0; 3], max: [1; 3] };
    // Larger than a segment's blocks, in either dimension.
    let most = if dimension == Dimension::Quad { 90 } else { 40 };
    for axis in 0..dimension.axes() {
        bounds.min[axis] = random.below(side + side / 4 + 1);
        bounds.max[axis] = bounds.min[axis] + 1 + random.below(side.min(most));
    }
    bounds
}

fn cells_of(bounds: &Bounds) -> impl Iterator<Item = [u64; 3]> {
    let Bounds { min, max } = *bounds;
    (min[2]..max[2])
        .flat_map(move |z| (min[1]..max[1]).flat_map(move |y| (min[0]..max[0]).map(move |x| [x, y, z])))
}

/// Compares the file's stored rows with what a window reads. Returns the number of boxes that are
/// stored.
fn stored(form: TreeType, seed: u64, size: [u64; 3], is_noise: bool) -> usize {
    // Noise without VOID.
    let noise =
        |[x, y, z]: [u64; 3]| Some(common::value(form.value, (x * 31 + y * y * 57 + z * 91 + x * y) % 200));
    let cells = if is_noise { made(form, size, noise) } else { Cells::random(form, seed, size, 9, true) };
    let tree = common::dataset(&cells, Rule::Mean, DataKind::Continuous);
    let (mut random, mut found) = (Random(seed), 0);
    for _ in 0..300 {
        let level = random.below(u64::from(cells.depth()) + 1) as u8;
        let bounds = some_bounds(form.dimension, &mut random, 1 << level);
        let Some(rows) = tree.stored_rows(level, &bounds).unwrap() else { continue };
        found += 1;
        let [width, height, depth] = bounds.size().map(|size| size as usize);
        let (mut values, mut valid) =
            (vec![0; width * height * depth * form.width()], vec![false; width * height * depth]);
        tree.window(level, &bounds, 0.0, &mut values, Some(&mut valid)).unwrap();
        assert!(valid.iter().all(|valid| *valid));
        for (number, row) in values.chunks_exact(width * form.width()).enumerate() {
            let at = number % height * rows.row + number / height * rows.layer;
            assert_eq!(&rows.bytes[at..at + row.len()], row, "{form} {level} {bounds:?}");
        }
        assert_eq!(
            rows.bytes.len(),
            (height - 1) * rows.row + (depth - 1) * rows.layer + width * form.width()
        );
    }
    assert!(tree.stored_rows(cells.depth() + 1, &Bounds { min: [0; 3], max: [1; 3] }).is_err());
    found
}

#[test]
fn windows_without_a_copy() {
    for value in value_types() {
        let found = stored(TreeType::new(Dimension::Quad, value), 1, [256, 256, 1], true);
        assert!(found > 5, "{value}: {found}");
        stored(TreeType::new(Dimension::Quad, value), 2, [200, 90, 1], false);
    }
    assert!(stored(oct(SampleType::I16, 1), 3, [16, 16, 16], true) > 5);
    stored(OCT, 4, [30, 20, 9], false);
}

fn windows(form: TreeType, seed: u64, size: [u64; 3], rule: Rule, kind: DataKind) {
    let (dimension, width) = (form.dimension, form.width());
    let cells = Cells::random(form, seed, size, 20, true);
    let (file, tree) = (goblin(&cells, rule, kind), cells.tree(rule));
    let mut random = Random(seed);
    let fill = common::value(form.value, 77);
    for level in 0..=cells.depth() {
        for _ in 0..6 {
            let bounds = some_bounds(dimension, &mut random, 1 << level);
            let len = bounds.volume() as usize;
            let (mut values, mut valid) = (fill.to_bytes()[..width].repeat(len), vec![true; len]);
            file.window(level, &bounds, fill, &mut values, Some(&mut valid)).unwrap();
            let mut plain = vec![0; len * width];
            file.window(level, &bounds, fill, &mut plain, None).unwrap();
            let found = values.chunks_exact(width).zip(plain.chunks_exact(width));
            for ((i, cell), (value, plain)) in cells_of(&bounds).enumerate().zip(found) {
                let code = Code::from_cell(dimension, level, cell.map(|cell| cell as u32));
                let expected = code.and_then(|code| tree.value_at(code));
                assert_eq!(valid[i], expected.is_some(), "{form} level {level} cell {cell:?}");
                for found in [value, plain].map(Value::from_bytes) {
                    assert_eq!(found, expected.unwrap_or(fill), "{form} level {level} cell {cell:?}");
                }
                if let Some(code) = code.filter(|_| i % 37 == 0) {
                    assert_eq!(file.value_at(code).unwrap(), expected);
                }
            }
        }
    }
}

#[test]
fn any_window_at_any_level() {
    use SampleType::*;
    windows(QUAD, 1, [700, 500, 1], Rule::Majority, DataKind::Categorical);
    windows(QUAD, 3, [1100, 700, 1], Rule::Majority, DataKind::Categorical);
    windows(quad(U8, 3), 2, [300, 900, 1], Rule::Mean, DataKind::Continuous);
    windows(quad(F32, 1), 4, [513, 1, 1], Rule::Mean, DataKind::Continuous);
    windows(OCT, 5, [90, 70, 80], Rule::Mean, DataKind::Continuous);
    windows(oct(U16, 1), 6, [128, 100, 20], Rule::Majority, DataKind::Categorical);
    for (seed, value) in (10..).zip(value_types()) {
        windows(TreeType::new(Dimension::Quad, value), seed, [400, 130, 1], Rule::Mean, DataKind::Continuous);
        windows(
            TreeType::new(Dimension::Oct, value),
            seed,
            [64, 30, 20],
            Rule::Majority,
            DataKind::Categorical,
        );
    }
}

#[test]
fn the_extent_has_a_size_at_every_level() {
    let cells = Cells::random(QUAD, 7, [70, 33, 1], 9, false);
    let file = dataset(&cells, Rule::Mean, DataKind::Continuous);
    let size = |level| file.extent_at(level).max;
    assert_eq!([size(0), size(3), size(6), size(7)], [[1, 1, 1], [5, 3, 1], [35, 17, 1], [70, 33, 1]]);
    assert_eq!([size(8), size(255)], [size(7); 2]);
}

#[test]
fn an_aligned_tile_needs_few_segments() {
    let cells = Cells::random(QUAD, 8, [3000, 2500, 1], 200, false);
    let file = goblin(&cells, Rule::Mean, DataKind::Continuous);
    assert!(file.segments() > 50);
    let mut tile = vec![0u8; 1 << 16];
    for level in 8..=12 {
        for (y, x) in (0..1u64 << (level - 8)).flat_map(|y| (0..1u64 << (level - 8)).map(move |x| (y, x))) {
            let bounds = Bounds { min: [x << 8, y << 8, 0], max: [(x + 1) << 8, (y + 1) << 8, 1] };
            let segments = file.window(level, &bounds, Value::ZERO, &mut tile, None).unwrap();
            assert!(segments <= 5, "level {level} tile {x},{y}: {segments} segments");
        }
    }
}

/// Windows anywhere, including around borders of large nodes: one segment per node that they touch.
#[test]
fn a_window_that_is_not_aligned_needs_few_segments() {
    for (form, size, side, most) in
        [(QUAD, [3000, 2500, 1], 256u64, 9), (oct(SampleType::U8, 1), [200, 180, 150], 64, 27)]
    {
        let cells = Cells::random(form, 9, size, 200, false);
        let file = goblin(&cells, Rule::Mean, DataKind::Continuous);
        assert!(file.segments() > 10);
        let mut random = Random(5);
        let axes = if form.dimension == Dimension::Quad { 2 } else { 3 };
        let mut window = vec![0u8; side.pow(axes as u32) as usize];
        let mut found = 0;
        for round in 0..300u64 {
            let level = (side.ilog2() as u64
                + random.below(u64::from(file.header().depth()) + 1 - u64::from(side.ilog2())))
                as u8;
            let space = 1u64 << level;
            let at = |random: &mut Random| match (space - side, round % 3) {
                (0, _) => 0,
                // Around the middle of the root, and of its children.
                (limit, 0) => (space / 2 - 1 - random.below(side - 1)).min(limit),
                (limit, 1) => {
                    (space / 4 * (1 + random.below(3))).saturating_sub(random.below(side)).min(limit)
                }
                (limit, _) => random.below(limit + 1),
            };
            let min: [u64; 3] = std::array::from_fn(|axis| if axis < axes { at(&mut random) } else { 0 });
            let max = std::array::from_fn(|axis| if axis < axes { min[axis] + side } else { 1 });
            let segments = file.window(level, &Bounds { min, max }, Value::ZERO, &mut window, None).unwrap();
            assert!(segments <= most, "level {level} at {min:?}: {segments} segments");
            found = found.max(segments);
        }
        assert!(found > most / 3, "{found}: windows that meet several segments");
    }
}

fn statistics(form: TreeType, seed: u64, size: [u64; 3], rule: Rule, kind: DataKind) {
    let cells = Cells::random(form, seed, size, 12, seed.is_multiple_of(2));
    let file = goblin(&cells, rule, kind);
    // As differences, which f64 can represent also for 64-bit integers.
    let base = common::value(form.value, 0);
    let number = |value: &Value, channel: usize| form.value.samples_from(base, *value)[channel];
    let mut random = Random(seed);
    for round in 0..20 {
        let bounds = some_bounds(form.dimension, &mut random, size[0].max(size[1]));
        let bounds = (round > 0).then_some(bounds);
        let extent = Bounds::of_extent(size);
        let inside = bounds.map_or(extent, |bounds| bounds.intersect(&extent));
        let found = file.statistics(bounds, &()).unwrap();
        let values: Vec<Value> = cells_of(&inside).filter_map(|cell| cells.get(cell)).collect();
        assert_eq!(found.cells, values.len() as u64);
        assert_eq!(found.void_cells, inside.volume() - found.cells);
        for (channel, stats) in found.channels.iter().enumerate() {
            let numbers = || values.iter().map(|value| number(value, channel));
            let mean = numbers().sum::<f64>() / values.len() as f64;
            let variance = numbers().map(|n| (n - mean) * (n - mean)).sum::<f64>() / values.len() as f64;
            let exact = || values.iter().map(|value| form.value.numbers(*value)[channel]);
            assert_eq!(Some(stats.min), exact().min(), "{form}");
            assert_eq!(Some(stats.max), exact().max(), "{form}");
            let mean = mean + (form.value.samples(base)[channel] - number(&base, channel));
            assert!((stats.mean - mean).abs() < 1e-9 * (1.0 + mean.abs()), "{} {mean}", stats.mean);
            assert!(
                (stats.standard_deviation - variance.sqrt()).abs() < 1e-6 + 1e-15 * mean.abs(),
                "{} {}",
                stats.standard_deviation,
                variance.sqrt()
            );
        }
        if form.value.channels == 1 && kind == DataKind::Categorical {
            let mut counts: Vec<(Number, u64)> = Vec::new();
            let mut numbers: Vec<Number> =
                values.iter().map(|value| form.value.first_number(*value)).collect();
            numbers.sort();
            for number in numbers {
                match counts.last_mut() {
                    Some((last, count)) if *last == number => *count += 1,
                    _ => counts.push((number, 1)),
                }
            }
            assert_eq!(found.classes, counts);
        }
        let (low, high) = (-50.0, 120.0);
        let mut bins = vec![0; 7];
        for value in &values {
            let bin = (form.value.samples(*value)[0] - low) * (7.0 / (high - low));
            bins[(bin.max(0.0) as usize).min(6)] += 1;
        }
        assert_eq!(file.histogram(&inside, low, high, 7, &()).unwrap(), bins);
    }
}

#[test]
fn statistics_are_those_of_the_cells() {
    use SampleType::*;
    statistics(QUAD, 2, [900, 500, 1], Rule::Majority, DataKind::Categorical);
    statistics(quad(I16, 1), 3, [300, 600, 1], Rule::Mean, DataKind::Continuous);
    statistics(quad(F32, 3), 4, [400, 300, 1], Rule::Mean, DataKind::Continuous);
    statistics(quad(U16, 1), 5, [600, 300, 1], Rule::Dominant, DataKind::Categorical);
    statistics(OCT, 6, [60, 80, 40], Rule::Mean, DataKind::Continuous);
    for (seed, value) in (10..).zip(value_types()) {
        statistics(
            TreeType::new(Dimension::Quad, value),
            seed,
            [130, 90, 1],
            Rule::Majority,
            DataKind::Categorical,
        );
        statistics(
            TreeType::new(Dimension::Oct, value),
            seed,
            [30, 20, 40],
            Rule::Mean,
            DataKind::Continuous,
        );
    }
}

fn search(form: TreeType, seed: u64, size: [u64; 3], kind: DataKind, condition: Condition) {
    let cells = Cells::random(form, seed, size, 6, true);
    let file = goblin(&cells, kind.default_rule(), kind);
    let meets = |cell: [u64; 3]| {
        let number = cells.get(cell).map(|value| form.value.first_number(value));
        number.is_some_and(|number| match condition {
            Condition::Above(bound) => number > bound,
            Condition::Below(bound) => number < bound,
            Condition::Equal(wanted) => number == wanted,
        })
    };
    let mut random = Random(seed);
    for round in 0..8 {
        let extent = Bounds::of_extent(size);
        let bounds = (round > 0).then(|| some_bounds(form.dimension, &mut random, size[0]));
        let inside = bounds.map_or(extent, |bounds| bounds.intersect(&extent));
        let mut blocks: Vec<FoundBlock> = Vec::new();
        file.find(condition, bounds, &(), &mut |block| {
            blocks.push(block);
            Ok(true)
        })
        .unwrap();
        let mut covered = std::collections::HashSet::new();
        for block in &blocks {
            for cell in cells_of(&block.bounds) {
                assert!(inside.contains(&Bounds { min: cell, max: cell.map(|c| c + 1) }));
                assert!(meets(cell) && covered.insert(cell));
            }
            // A larger block would not qualify.
            let code = Code::parse(form.dimension, &block.code).unwrap();
            if let Some(parent) = code.parent() {
                let depth = file.header().shape.depth;
                let mut around = cells_below(parent, depth).map(|cell| cell.map(u64::from));
                let within = |c: [u64; 3]| inside.contains(&Bounds { min: c, max: c.map(|c| c + 1) });
                assert!(!around.all(|cell| within(cell) && meets(cell)), "{} could be larger", block.code);
            }
        }
        let code = |block: &FoundBlock| Code::parse(form.dimension, &block.code).unwrap();
        assert!(blocks.iter().map(code).is_sorted());
        assert_eq!(covered.len(), cells_of(&inside).filter(|cell| meets(*cell)).count());
    }
}

#[test]
fn searches_find_all_and_the_largest() {
    use SampleType::*;
    search(QUAD, 1, [500, 600, 1], DataKind::Categorical, Condition::Equal(3.0.into()));
    search(QUAD, 2, [600, 500, 1], DataKind::Categorical, Condition::Above(1.0.into()));
    search(quad(F32, 1), 3, [300, 300, 1], DataKind::Continuous, Condition::Below((-11.0).into()));
    search(OCT, 4, [40, 70, 66], DataKind::Continuous, Condition::Above(2.0.into()));
    for (seed, value) in (10..).zip(value_types()) {
        // The lowest numbers of signed types are negative.
        let bound = value.first_number(common::value(value, 2));
        search(
            TreeType::new(Dimension::Quad, value),
            seed,
            [130, 90, 1],
            DataKind::Continuous,
            Condition::Above(bound),
        );
        search(
            TreeType::new(Dimension::Oct, value),
            seed,
            [20, 30, 17],
            DataKind::Categorical,
            Condition::Below(bound),
        );
    }
}

/// Checks that statistics of windows are right to nine digits, in both formats and in views.
fn exact_to_nine_digits(form: TreeType, number: impl Fn(u64) -> f64) {
    let size = [300, 170, 1];
    let cells = made(form, size, |[x, y, _]| {
        let index = y * size[0] + x;
        (index % 11 != 3).then(|| form.value.nearest(|_| number(index)))
    });
    let directory = tempfile::tempdir().unwrap();
    let (goblin, autumnal) = (directory.path().join("t.goblin"), directory.path().join("t.autumn"));
    for path in [&goblin, &autumnal] {
        write_cells(path, &cells, &options(Rule::Mean, DataKind::Continuous, cells.depth()));
    }
    let open = |path: &Path| spinney::raw::dataset::open(path, &Default::default()).unwrap();
    let step = format!("window=0,0,{},{}", size[0], size[1]);
    let view = open(&goblin).view(&[step.parse().unwrap()]).unwrap();
    for file in [open(&goblin), open(&autumnal), view] {
        let mut random = Random(5);
        for round in 0..12 {
            let part = some_bounds(Dimension::Quad, &mut random, 300);
            let inside =
                if round == 0 { Bounds::of_extent(size) } else { part.intersect(&Bounds::of_extent(size)) };
            let values: Vec<f64> = cells_of(&inside)
                .filter_map(|cell| cells.get(cell))
                .map(|it| form.value.samples(it)[0])
                .collect();
            if values.is_empty() {
                continue;
            }
            // Relative to a nearby number, where f64 has enough digits.
            let (near, count) = (values[0], values.len() as f64);
            let mean = values.iter().map(|value| value - near).sum::<f64>() / count;
            let squares = values.iter().map(|value| (value - near - mean).powi(2)).sum::<f64>();
            let expected = (squares / count).sqrt();
            let found = file.statistics(Some(inside), &()).unwrap().channels[0];
            let off = (found.standard_deviation - expected).abs();
            assert!(off <= 1e-9 * expected, "{found:?}, {expected}");
            // The mean has f64 precision.
            assert!((found.mean - (near + mean)).abs() <= 1e-15 * near.abs(), "{found:?}, {mean}");
        }
    }
}

#[test]
fn standard_deviations_of_large_numbers_keep_their_digits() {
    exact_to_nine_digits(quad(SampleType::F64, 1), |index| 1.7e9 + (index * 7 % 60) as f64);
    exact_to_nine_digits(quad(SampleType::F64, 1), |index| 4.2e10 + (index * 7 % 61) as f64 / 8.0);
    exact_to_nine_digits(quad(SampleType::F32, 1), |index| 1e6 + (index * 7 % 97) as f64 / 16.0);
    exact_to_nine_digits(quad(SampleType::F32, 1), |index| (index * 7919 % 10007) as f64 / 1e3);
    exact_to_nine_digits(quad(SampleType::I32, 1), |index| 2.1e9 + (index * 7 % 60) as f64);
    // Equal cells have no deviation, whatever their number.
    let cells = made(quad(SampleType::F64, 1), [5, 3, 1], |_| Some(Value::from(0.1f64.to_le_bytes())));
    let file = dataset(&cells, Rule::Mean, DataKind::Continuous);
    assert_eq!(file.statistics(None, &()).unwrap().channels[0].standard_deviation, 0.0);
}

#[test]
fn statistics_of_numbers_without_bounds() {
    for numbers in [
        [f64::INFINITY, 1.0, 2.0, 3.0],
        [f64::INFINITY, f64::NEG_INFINITY, 0.0, 1.0],
        [f64::MAX, f64::MAX, f64::MIN, 1.0],
        [5e-324, -5e-324, 1e-200, 0.0],
    ] {
        let cells = made(quad(SampleType::F64, 1), [2, 2, 1], |[x, y, _]| {
            Some(Value::from(numbers[(2 * y + x) as usize].to_le_bytes()))
        });
        let file = dataset(&cells, Rule::Mean, DataKind::Continuous);
        let found = file.statistics(None, &()).unwrap();
        assert!(file.verify(1 << 20, &()).unwrap().is_empty());
        assert_eq!(found.cells, 4);
        let finite = numbers.iter().all(|number| number.abs() < 1.0);
        assert_eq!(found.channels[0].standard_deviation.is_finite(), finite, "{found:?}");
    }
}

#[test]
fn very_many_classes_are_counted_exactly() {
    // More than are pending at a time, in random order.
    let form = quad(SampleType::U32, 1);
    let cells = made(form, [150, 120, 1], |[x, y, _]| {
        let number = Random(x + 150 * y).below(14_000) as u32;
        (!number.is_multiple_of(7)).then(|| Value::from(((number ^ 0x2a5) + 1000).to_le_bytes()))
    });
    let tree = dataset(&cells, Rule::Majority, DataKind::Categorical);
    for bounds in [tree.header().extent_bounds(), Bounds { min: [3, 5, 0], max: [149, 117, 1] }] {
        let mut expected = std::collections::BTreeMap::new();
        for y in bounds.min[1]..bounds.max[1] {
            for x in bounds.min[0]..bounds.max[0] {
                if let Some(value) = cells.get([x, y, 0]) {
                    *expected.entry(form.value.samples(value)[0] as u64).or_insert(0u64) += 1;
                }
            }
        }
        let found = tree.statistics(Some(bounds), &()).unwrap().classes;
        let found: Vec<(u64, u64)> =
            found.into_iter().map(|(value, cells)| (value.to_f64() as u64, cells)).collect();
        let expected: Vec<_> = expected.into_iter().collect();
        let first = found.iter().zip(&expected).find(|(found, expected)| found != expected);
        assert_eq!((found.len(), first), (expected.len(), None));
    }
}

#[test]
fn points_below_dense_blocks_that_end_with_their_segments() {
    for (form, size) in [(QUAD, [1024, 700, 1]), (OCT, [130, 128, 70])] {
        let cells = Cells::noise(form, 3, size, 50);
        let tree = dataset(&cells, Rule::Mean, DataKind::Continuous);
        let mut random = Random(4);
        let (mut samples, mut value) = (PointSamples::default(), [Number::default(); 4]);
        // The more points there are, the deeper the table that the search starts from.
        for count in [1, 20, 100, 1000, 20_000] {
            for level in [tree.depth(), tree.depth() - 1, tree.depth() - 4] {
                let shift = tree.depth() - level;
                let positions: Vec<_> = (0..count)
                    .map(|_| size.map(|length| random.below(length + length / 9) >> shift))
                    .collect();
                tree.points(&positions, level, &mut samples).unwrap();
                for (index, cell) in positions.iter().enumerate() {
                    let expected = tree.point(*cell, level, &mut value).unwrap().then_some(&value[..1]);
                    assert_eq!(
                        samples.get(index).as_deref(),
                        expected,
                        "{form}, {cell:?} of level {level}, one of {count}"
                    );
                    if shift == 0 {
                        let sample = cells.get(*cell).map(|value| form.value.first_number(value));
                        assert_eq!(expected.map(|samples| samples[0]), sample);
                    }
                }
            }
        }
    }
}
