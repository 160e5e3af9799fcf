//! Samples of i8, u64 and i64: sums, means, extremes and squares against models in wider integers.

use std::collections::BTreeMap;

use spinney::raw::value::{SquareSum, Sums};
use spinney::tree::{Child, MemTree, Source};
use spinney::{
    Bounds, Code, DataKind, Dimension, Number, Output, Rule, SampleType, TreeType, Value, ValueType,
    WriteOptions, convert,
};

use crate::common::{Cells, Random, children, dataset, goblin, goblin_bytes};

const TYPES: [SampleType; 3] = [SampleType::I8, SampleType::U64, SampleType::I64];

/// Returns a sample as a wider integer.
fn wide(sample: SampleType, value: Value) -> i128 {
    let bytes: [u8; 8] = value.to_bytes()[..8].try_into().unwrap();
    match sample {
        SampleType::I8 => (bytes[0] as i8).into(),
        SampleType::U64 => u64::from_le_bytes(bytes).into(),
        _ => i64::from_le_bytes(bytes).into(),
    }
}

/// Samples of all magnitudes: patches, noise, and the limits of the type.
fn cells(form: TreeType, seed: u64, size: [u64; 3], void: bool) -> Cells {
    let mut random = Random(seed);
    // Builders take VOID as a nodata value, which no cell may have.
    let (width, nodata) = (form.width(), crate::common::value(form.value, 250));
    let cells = (0..size.iter().product::<u64>()).map(|index| {
        let (x, y) = (index % size[0], index / size[0]);
        let patch = Random(seed ^ (x / 20 + 1000 * (y / 20))).next();
        let number = match patch % 4 {
            0 => patch,
            1 => random.next(),
            2 => patch.wrapping_add(random.below(3)),
            _ => [0, u64::MAX, 1 << 63, u64::MAX >> 1, 1][(patch >> 8) as usize % 5],
        };
        let is_void = void && patch.is_multiple_of(5) && random.below(3) == 0;
        let value = Value::from_bytes(&number.to_le_bytes()[..width]);
        (!is_void).then_some(if value == nodata { Value::ZERO } else { value })
    });
    Cells { form, size, cells: cells.collect() }
}

/// Statistics of the cells below a node.
#[derive(Clone, Copy, Default)]
struct Known {
    cells: i128,
    sum: i128,
    min: Option<i128>,
    max: Option<i128>,
    /// Digits to the base 2^64, the lowest first.
    squares: [u64; 3],
}

fn plus(a: [u64; 3], b: [u64; 3]) -> [u64; 3] {
    let mut carry = false;
    std::array::from_fn(|digit| {
        let (sum, first) = a[digit].overflowing_add(b[digit]);
        let (sum, second) = sum.overflowing_add(carry.into());
        carry = first || second;
        sum
    })
}

fn square(x: i128) -> [u64; 3] {
    let square = x.unsigned_abs().pow(2);
    [square as u64, (square >> 64) as u64, 0]
}

impl Known {
    fn with(self, other: Known) -> Known {
        let join = |a: Option<i128>, b: Option<i128>, of: fn(i128, i128) -> i128| match (a, b) {
            (Some(a), Some(b)) => Some(of(a, b)),
            (a, b) => a.or(b),
        };
        Known {
            cells: self.cells + other.cells,
            sum: self.sum + other.sum,
            min: join(self.min, other.min, i128::min),
            max: join(self.max, other.max, i128::max),
            squares: plus(self.squares, other.squares),
        }
    }

    /// Combines the children, down to single cells.
    fn of(cells: &Cells, code: Code, depth: u8, all: &mut BTreeMap<u64, Known>) -> Known {
        let sample = cells.form.value.sample;
        // Nodes outside of the cells have no statistics and are not stored.
        let first = code.cell().map(|at| u64::from(at) << (depth - code.level()));
        if (0..cells.form.axes()).any(|axis| first[axis] >= cells.size[axis]) {
            return Known::default();
        }
        let known = if code.level() == depth {
            let number = cells.get(code.cell().map(u64::from)).map(|value| wide(sample, value));
            number.map_or(Known::default(), |number| Known {
                cells: 1,
                sum: number,
                min: Some(number),
                max: Some(number),
                squares: square(number),
            })
        } else {
            let below: Vec<Known> = (0..cells.form.children())
                .map(|child| Known::of(cells, code.child(child), depth, all))
                .collect();
            let mut level = below;
            while level.len() > 1 {
                level = level.chunks(2).map(|two| two[0].with(two[1])).collect();
            }
            level[0]
        };
        all.insert(code.bits(), known);
        known
    }
}

fn check(form: TreeType, seed: u64, size: [u64; 3], void: bool) {
    let sample = form.value.sample;
    let cells = cells(form, seed, size, void);
    let depth = cells.depth();
    let mut all = BTreeMap::new();
    Known::of(&cells, Code::root(form.dimension), depth, &mut all);
    let file = goblin(&cells, Rule::Mean, DataKind::Continuous);
    // Means, rounded half up once.
    let mut pending = vec![(Code::root(form.dimension), file.root().unwrap())];
    while let Some((code, child)) = pending.pop() {
        let Known { cells: count, sum, .. } = all.get(&code.bits()).copied().unwrap_or_default();
        assert_eq!(child.value().is_some(), count > 0, "{code}");
        if let Some(value) = child.value() {
            assert_eq!(wide(sample, value), (2 * sum + count).div_euclid(2 * count), "{form} {code}");
        }
        if let Child::Inner { node, .. } = child {
            pending.extend(children(&file, &node).into_iter().enumerate().map(|(i, it)| (code.child(i), it)));
        }
    }
    // Statistics of segments.
    let zero = SquareSum::from_bytes([0; 24]);
    for index in 0..file.segments() {
        let entry = file.entry(index).unwrap();
        let known = all[&entry.code.bits()];
        let extremes = [entry.zone.min, entry.zone.max].map(|value| Some(wide(sample, value)));
        assert_eq!(extremes, [known.min, known.max], "{form} {}", entry.code);
        assert_eq!(
            (i128::from(entry.zone.cells), entry.zone.sum),
            (known.cells, Sums::Exact([known.sum, 0, 0, 0]))
        );
        let bytes = std::array::from_fn(|byte| known.squares[byte / 8].to_le_bytes()[byte % 8]);
        let expected = match sample {
            SampleType::I8 => Sums::Exact([known.squares[0].into(), 0, 0, 0]),
            _ => Sums::Squares([SquareSum::from_bytes(bytes), zero, zero, zero]),
        };
        assert_eq!(entry.zone.squares, expected, "{form} {}", entry.code);
    }
    // Other ways to build and store the same tree give the same results.
    assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
    let tree = dataset(&cells, Rule::Mean, DataKind::Continuous);
    let directory = tempfile::tempdir().unwrap();
    let [one, two] = ["a.goblin", "b.autumn"].map(|name| directory.path().join(name));
    std::fs::write(&one, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
    convert(&one, false, Output::create(&two).unwrap(), WriteOptions::new(1 << 24), &()).unwrap();
    let edited = spinney::open(&two).unwrap();
    assert_eq!(edited.verify(1 << 24, &()).unwrap(), []);
    let part = Bounds { min: [3, 5, 0], max: size.map(|cells| cells - cells / 3) };
    for bounds in [None, Some(part)] {
        let [found, again] = [&tree, &edited].map(|tree| tree.statistics(bounds, &()).unwrap());
        let inside = bounds.unwrap_or(Bounds::of_extent(size));
        let mut known = Known::default();
        for z in inside.min[2]..inside.max[2] {
            for (y, x) in (inside.min[1]..inside.max[1])
                .flat_map(|y| (inside.min[0]..inside.max[0]).map(move |x| (y, x)))
            {
                let number = cells.get([x, y, z]).map(|value| wide(sample, value));
                known = known.with(number.map_or(Known::default(), |number| Known {
                    cells: 1,
                    sum: number,
                    min: Some(number),
                    max: Some(number),
                    ..Known::default()
                }));
            }
        }
        for found in [found, again] {
            let channel = found.channels[0];
            assert_eq!([channel.min, channel.max].map(Number::to_integer), [known.min, known.max]);
            assert_eq!(channel.mean, known.sum as f64 / known.cells as f64);
        }
    }
}

#[test]
fn statistics_are_those_of_wider_numbers() {
    for (seed, sample) in (1..).zip(TYPES) {
        let value = ValueType::new(sample, 1);
        check(TreeType::new(Dimension::Quad, value), seed, [300, 270, 1], true);
        check(TreeType::new(Dimension::Quad, value), seed + 10, [512, 256, 1], false);
        check(TreeType::new(Dimension::Oct, value), seed + 20, [70, 33, 65], seed % 2 == 0);
    }
}

#[test]
fn majorities_do_not_go_by_the_numbers() {
    for sample in TYPES {
        let form = TreeType::new(Dimension::Quad, ValueType::new(sample, 1));
        let cells = cells(form, 5, [256, 256, 1], false);
        // One builder has blocks in rows, the other single cells.
        let tree = MemTree::from_cells(form, 8, Rule::Majority, &|cell| cells.get(cell.map(u64::from)));
        let file = goblin(&cells, Rule::Majority, DataKind::Categorical);
        crate::common::same_trees(&file, &tree);
        let min = cells.cells.iter().flatten().map(|value| wide(sample, *value)).min().unwrap();
        let found = dataset(&cells, Rule::Majority, DataKind::Categorical).statistics(None, &()).unwrap();
        assert_eq!(found.classes[0].0.to_integer(), Some(min));
        assert!(found.classes.is_sorted_by(|a, b| a.0 < b.0));
    }
    // A tie of two cells each: the first one wins.
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::I8, 1));
    for numbers in [[5i8, -7, 5, -7], [-7, 5, 5, -7]] {
        let cells = Cells { form, size: [2, 2, 1], cells: numbers.map(|n| Some(Value::from([n]))).into() };
        let file = goblin(&cells, Rule::Majority, DataKind::Categorical);
        assert_eq!(file.root().unwrap().value(), Some(Value::from([numbers[0]])));
    }
}

#[test]
fn sums_and_differences_stay_within_the_type() {
    use spinney::raw::store::builder::Join;
    let value = |sample| ValueType::new(sample, 1);
    for (sample, a, b, sum, difference) in [
        (
            SampleType::U64,
            Value::from([u64::MAX - 1]),
            Value::from([5u64]),
            Value::from([u64::MAX]),
            Value::from([u64::MAX - 6]),
        ),
        (
            SampleType::U64,
            Value::from([(1u64 << 63) + 3]),
            Value::from([1u64]),
            Value::from([(1u64 << 63) + 4]),
            Value::from([(1u64 << 63) + 2]),
        ),
        (
            SampleType::I64,
            Value::from([i64::MIN + 1]),
            Value::from([2i64]),
            Value::from([i64::MIN + 3]),
            Value::from([i64::MIN]),
        ),
        (
            SampleType::I8,
            Value::from([100i8]),
            Value::from([100i8]),
            Value::from([127i8]),
            Value::from([0i8]),
        ),
    ] {
        assert_eq!(Join::Add.values(value(sample), a, b), Some(sum), "{sample:?}");
        assert_eq!(Join::Subtract.values(value(sample), a, b), Some(difference), "{sample:?}");
    }
}

/// The tree in memory keeps values of any type.
#[test]
fn expressions_have_all_digits() {
    use spinney::raw::tree::df;
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U64, 1));
    let text = "G[9223372036854775811][9223372036854775812]W[18446744073709551615]";
    let tree = df::from_text(form, text, 3, Value::ZERO, Rule::Mean).unwrap();
    assert_eq!(df::to_text(&tree, None).unwrap(), text);
    assert!(df::from_text(form, "[18446744073709551616]", 3, Value::ZERO, Rule::Mean).is_err());
    assert!(df::from_text(form, "[-1]", 3, Value::ZERO, Rule::Mean).is_err());
}
