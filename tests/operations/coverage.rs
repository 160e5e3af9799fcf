//! Set operations on trees whose cells store coverage, against arrays of cells and volumes.

use spinney::raw::ops::{Combined, View};
use spinney::raw::store::goblin::Goblin;
use spinney::tree::Source;
use spinney::{Bounds, CombineOperation, DataKind, Dimension, Rule, SampleType, TreeType, Value, ValueType};

use crate::common::{
    Cells, OCT, QUAD, Random, as_byte, assert_same, byte, cells_of, combined, goblin, goblin_from_combined,
    made, oct_size, quad, quad_size, set_operation, value, view_of, view_of_file,
};

fn set(number: u8) -> CombineOperation {
    CombineOperation::set(set_operation(number))
}

/// Cells that are full, VOID, or neither; every fifth partially covered cell is zero.
fn bodies(form: TreeType, seed: u64, size: [u64; 3]) -> Cells {
    let cells = Cells::random(form, seed, size, 8, true);
    let coverage = [255, 255, 255, 100, 31, 254, 1, 0];
    made(form, size, |cell| {
        let number = form.value.samples(cells.get(cell)?)[0] as usize % 8;
        Some(match form.value.channels {
            1 => byte(coverage[number]),
            _ => form.value.nearest(|channel| coverage[(number + 3 * channel) % 8].into()),
        })
    })
}

/// Returns the sum of the minterms of a set operation's number.
fn minterms(number: u8, a: f64, b: f64) -> f64 {
    let both = a.min(b);
    let minterms = [both, a - both, b - both, 255.0 - a.max(b)];
    (0..4).filter(|bit| number >> bit & 1 > 0).map(|bit| minterms[bit]).sum()
}

/// Returns an operation's result, cell by cell; cells beyond the universe are not filled.
fn expected(number: u8, [a, b]: [&Cells; 2], universe: Bounds) -> Cells {
    let form = a.form;
    made(form, a.size, |cell| {
        let samples = |cells: &Cells, channel: usize| {
            cells.get(cell).map_or(0.0, |value| form.value.samples(value)[channel])
        };
        let inside = (0..form.axes()).all(|i| cell[i] >= universe.min[i] && cell[i] < universe.max[i]);
        let number = if inside { number } else { number & 7 };
        let result: Vec<f64> = (0..usize::from(form.value.channels))
            .map(|channel| minterms(number, samples(a, channel), samples(b, channel)))
            .collect();
        result.iter().any(|sample| *sample > 0.0).then(|| form.value.nearest(|channel| result[channel]))
    })
}

/// Returns a coverage file as a view. Trees in memory do not store their rule.
fn view(cells: &Cells) -> View {
    view_of_file(goblin(cells, Rule::Occupancy, DataKind::Continuous), cells.size)
}

/// Removes cells with zero coverage, which are equivalent to VOID.
fn covered(cells: Cells) -> Cells {
    let something = |value: &Value| value.to_bytes().iter().any(|byte| *byte > 0);
    let cells_covered = cells.cells.into_iter().map(|value| value.filter(something)).collect();
    Cells { cells: cells_covered, ..cells }
}

/// Returns the cells of a file written from combined trees.
fn built(source: &Combined, size: [u64; 3]) -> Cells {
    cells_of(
        &Goblin::from_bytes(goblin_from_combined(source, Rule::Occupancy, DataKind::Continuous)).unwrap(),
        size,
    )
}

fn sixteen(form: TreeType, seed: u64, size: [u64; 3]) {
    let cells = [0, 1].map(|i| bodies(form, seed * 2 + i, size));
    let universes = [
        Bounds::of_extent(size),
        Bounds { min: [size[0] / 3, 1, 0], max: [size[0] - size[0] / 4, size[1] - 1, size[2]] },
    ];
    for number in 0..16u8 {
        for universe in universes {
            let views = cells.each_ref().map(view);
            let combined = combined(views.to_vec(), set(number), size).within(universe);
            let expected = expected(number, cells.each_ref(), universe);
            let text = format!("{form}, seed {seed}, operation {number}, {universe:?}");
            assert_same(&covered(cells_of(&combined, size)), &expected, &text);
            assert_same(&covered(built(&combined, size)), &expected, &text);
        }
    }
}

#[test]
fn sixteen_set_operations_on_coverage() {
    let mut random = Random(31);
    for seed in 0..6 {
        sixteen(QUAD, seed, quad_size(&mut random));
        sixteen(OCT, seed, oct_size(&mut random));
        sixteen(quad(SampleType::U8, 3), seed, quad_size(&mut random));
    }
}

#[test]
fn volumes_add_up_and_a_body_without_itself_is_empty() {
    let size = [40, 50, 60];
    let [a, b] = [1, 2].map(|seed| bodies(OCT, seed, size));
    let volume =
        |cells: &Cells| cells.cells.iter().flatten().map(|value| u64::from(as_byte(*value))).sum::<u64>();
    let of =
        |number: u8, other: &Cells| built(&combined(vec![view(&a), view(other)], set(number), size), size);
    // The trees are separate files: only their cells show that they are equal.
    assert_eq!(of(2, &a).count(), 0);
    assert_eq!(of(6, &a).count(), 0);
    assert_eq!(volume(&of(1, &a)), volume(&a));
    let (both, first, second) = (of(1, &b), of(2, &b), of(4, &b));
    assert_eq!(volume(&both) + volume(&first), volume(&a));
    assert_eq!(volume(&both) + volume(&second), volume(&b));
    assert_eq!(volume(&of(7, &b)), volume(&both) + volume(&first) + volume(&second));
    assert_eq!(volume(&of(6, &b)), volume(&first) + volume(&second));
}

#[test]
fn a_union_of_many_is_the_fullest() {
    for (form, size) in [(QUAD, [70, 90, 1]), (OCT, [20, 40, 30])] {
        for many in [1, 3, 4] {
            let cells: Vec<Cells> = (0..many).map(|seed| bodies(form, 50 + seed, size)).collect();
            let views = cells.iter().map(view).collect();
            let expected = made(form, size, |cell| {
                let coverage = cells.iter().filter_map(|cells| cells.get(cell)).map(as_byte).max();
                coverage.filter(|coverage| *coverage > 0).map(byte)
            });
            let union = combined(views, set(7), size);
            assert_same(&covered(cells_of(&union, size)), &expected, "node by node");
            assert_same(&covered(built(&union, size)), &expected, "as a file");
        }
    }
}

/// Returns the coverage of a box with arbitrary edges.
fn covered_by_box(size: [u64; 3], low: [f64; 3], high: [f64; 3]) -> Cells {
    made(OCT, size, |cell| {
        let share = |i: usize| (high[i].min(cell[i] as f64 + 1.0) - low[i].max(cell[i] as f64)).max(0.0);
        let coverage = (255.0 * share(0) * share(1) * share(2)).round() as u8;
        (coverage > 0).then(|| byte(coverage))
    })
}

#[test]
fn intersections_are_too_large_only_where_both_surfaces_are() {
    let size = [32; 3];
    let mut random = Random(9);
    let mut number = |from: f64| from + random.below(1000) as f64 / 100.0;
    for _ in 0..12 {
        let boxes = [0, 1].map(|_| ([0; 3].map(|_| number(1.0)), [0; 3].map(|_| number(15.0))));
        let cells = boxes.map(|(low, high)| covered_by_box(size, low, high));
        let views = cells.each_ref().map(view);
        let result = built(&combined(views.to_vec(), set(1), size), size);
        let overlap = |i: usize| boxes[0].1[i].min(boxes[1].1[i]) - boxes[0].0[i].max(boxes[1].0[i]);
        let exact = 255.0 * overlap(0) * overlap(1) * overlap(2);
        let volume: f64 = result.cells.iter().flatten().map(|value| f64::from(as_byte(*value))).sum();
        let (mut most, mut rounding) = (0.0, 0.0);
        for (a, b) in cells[0].cells.iter().zip(&cells[1].cells) {
            let [a, b] = [a, b].map(|value| value.map_or(0.0, |value| f64::from(as_byte(value))));
            // The minimum overlap is the excess of the sum over a full cell.
            most += a.min(b) - (a + b - 255.0).max(0.0);
            rounding += if a > 0.0 && b > 0.0 { 0.5 } else { 0.0 };
            assert!(a.min(b) - (a + b - 255.0).max(0.0) <= 127.5);
        }
        assert!(
            volume - exact > -rounding && volume - exact < most + rounding,
            "{volume} of {exact}, {boxes:?}"
        );
    }
}

#[test]
fn trees_of_other_rules_and_types_are_combined_by_presence() {
    let size = [30, 20, 1];
    let cells = [0, 1].map(|seed| Cells::random(QUAD, seed, size, 9, true));
    let mean = view_of(&cells[0].tree(Rule::Mean), size);
    let both = combined(vec![mean, view(&cells[1])], set(1), size);
    let expected = made(QUAD, size, |cell| cells[0].get(cell).filter(|_| cells[1].get(cell).is_some()));
    assert_same(&cells_of(&both, size), &expected, "a mean and a coverage");
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U16, 1));
    let cells = Cells::random(form, 3, size, 9, true);
    let views = vec![view(&cells); 2];
    let same = combined(views, set(1), size);
    assert_same(&cells_of(&same, size), &cells, "u16");
    assert!(same.filled_with(value(form.value, 7)).is_ok());
    let coverage = combined(vec![view(&bodies(QUAD, 1, size))], set(12), size);
    assert!(coverage.clone().filled_with(byte(255)).is_ok());
    let error = coverage.filled_with(byte(7)).unwrap_err().to_string();
    assert!(error.contains("coverage") && error.contains("255"), "{error}");
    assert_eq!(both.form(), QUAD);
}

#[test]
fn more_than_two_trees() {
    let size = [6, 5, 7];
    for (form, seed) in [(OCT, 71), (QUAD, 72)] {
        let size = if form == QUAD { [13, 11, 1] } else { size };
        let cells: Vec<Cells> = (0..4).map(|i| bodies(form, seed * 10 + i, size)).collect();
        for count in [3, 4] {
            for number in [0, 1, 2, 6, 7, 8, 9, 13, 14, 15] {
                // The operation of the first ones, and its complement at the end.
                let bounded = if number > 7 { number ^ 15 } else { number };
                let (last, others) = cells[1..count].split_last().unwrap();
                let universe = Bounds::of_extent(size);
                let folded = others
                    .iter()
                    .fold(cells[0].clone(), |first, next| expected(bounded, [&first, next], universe));
                let folded = expected(number, [&folded, last], universe);
                let views: Vec<View> = cells[..count].iter().map(view).collect();
                let found = combined(views, set(number), size);
                let what = format!("operation {number} of {count} trees");
                assert_same(&covered(cells_of(&found, size)), &covered(folded.clone()), &what);
                assert_same(&covered(built(&found, size)), &covered(folded), &what);
            }
        }
    }
}
