//! Set operations and operations on values against arrays of cells, and the laws of their algebra.

use spinney::raw::ops::Prefer;
use spinney::tree::{MemTree, Source};
use spinney::{CombineOperation, Dimension, Number, Rule, SampleType, TreeType, Value, ValueType};

use crate::common::{
    self, Cells, OCT, QUAD, Random, as_byte, assert_same, byte, cells_of, combined, made, oct, oct_size,
    quad, quad_size, set_operation, value_types, view_of, view_of_cells,
};

/// Returns the cells of two trees over one space.
fn pair(form: TreeType, seed: u64, size: [u64; 3]) -> [Cells; 2] {
    [0, 1].map(|i| Cells::random(form, seed * 2 + i, size, 4, true))
}

fn set_operations(form: TreeType, seed: u64, size: [u64; 3]) {
    let cells = pair(form, seed, size);
    let views = cells.each_ref().map(view_of_cells);
    let fill = common::value(form.value, 99);
    for number in 0..16u8 {
        for prefer in [Prefer::First, Prefer::Second] {
            let operation = CombineOperation::Set { operation: set_operation(number), prefer };
            let combined = combined(views.to_vec(), operation, size).filled_with(fill).unwrap();
            let expected = made(form, size, |cell| {
                let (a, b) = (cells[0].get(cell), cells[1].get(cell));
                let bit = match (a.is_some(), b.is_some()) {
                    (true, true) => 0,
                    (true, false) => 1,
                    (false, true) => 2,
                    (false, false) => 3,
                };
                let value = if prefer == Prefer::First { a.or(b) } else { b.or(a) };
                (number >> bit & 1 > 0).then(|| value.unwrap_or(fill))
            });
            assert_same(
                &cells_of(&combined, size),
                &expected,
                &format!("{form}, seed {seed}, operation {number}, {prefer:?}"),
            );
            // No cells outside of the extent.
            let side = 1u64 << combined.depth();
            let all =
                cells_of(&combined, [side, side, if form.dimension == Dimension::Oct { side } else { 1 }]);
            assert_eq!(all.count(), expected.count(), "{form}, operation {number}");
        }
    }
}

#[test]
fn sixteen_set_operations() {
    let mut random = Random(21);
    for seed in 0..12 {
        set_operations(QUAD, seed, quad_size(&mut random));
        set_operations(quad(SampleType::F32, 1), seed, quad_size(&mut random));
        set_operations(OCT, seed, oct_size(&mut random));
    }
    for (seed, value) in (100..).zip(value_types()) {
        set_operations(TreeType::new(Dimension::Quad, value), seed, quad_size(&mut random));
        set_operations(TreeType::new(Dimension::Oct, value), seed, oct_size(&mut random));
    }
}

#[test]
fn algebra_of_sets() {
    let size = [50, 41, 1];
    let of = |number: u8, trees: Vec<MemTree>| {
        let views = trees.iter().map(|tree| view_of(tree, size)).collect();
        let combined = combined(views, CombineOperation::set(set_operation(number)), size);
        MemTree::from_source(&combined, Rule::Mean).unwrap()
    };
    let present = |tree: &MemTree| {
        let cells = cells_of(tree, size);
        cells.cells.iter().map(Option::is_some).collect::<Vec<_>>()
    };
    let [a, b] = pair(QUAD, 3, size).map(|cells| cells.tree(Rule::Mean));
    // De Morgan.
    let left = of(12, vec![of(7, vec![a.clone(), b.clone()])]);
    let right = of(1, vec![of(12, vec![a.clone()]), of(12, vec![b.clone()])]);
    assert_eq!(present(&left), present(&right));
    // An intersection is white if either operand is (the print says both).
    let area = |tree: &MemTree| present(tree).iter().filter(|there| **there).count();
    let (union, both) = (of(7, vec![a.clone(), b.clone()]), of(1, vec![a.clone(), b.clone()]));
    assert_eq!(area(&union) + area(&both), area(&a) + area(&b));
    assert_eq!(area(&of(6, vec![a.clone(), b.clone()])), area(&union) - area(&both));
    let back = of(12, vec![of(12, vec![a.clone()])]);
    assert_eq!(present(&back), present(&a));
    assert_eq!(area(&of(15, vec![a.clone(), b])), 50 * 41);
    assert_eq!(area(&of(0, vec![a.clone(), a])), 0);
}

/// An operation on two cells.
type Join<'a> = Box<dyn Fn(Option<Value>, Option<Value>) -> Option<Value> + 'a>;

/// Returns an operation on each channel's numbers, rounded to the nearest value, where both cells
/// have one.
fn on_numbers(value: ValueType, join: fn(Number, Number) -> Number) -> Join<'static> {
    Box::new(move |a, b| {
        let (a, b) = (value.numbers(a?), value.numbers(b?));
        Some(value.nearest_numbers(|channel| join(a[channel], b[channel])))
    })
}

/// Computes with two numbers: integers exactly, clamped to 64 bits.
fn computed(a: Number, b: Number, whole: fn(i128, i128) -> i128, float: fn(f64, f64) -> f64) -> Number {
    if matches!(a, Number::Float(_)) {
        return float(a.to_f64(), b.to_f64()).into();
    }
    let number = whole(a.to_integer().unwrap(), b.to_integer().unwrap());
    match u64::try_from(number) {
        Ok(number) => number.into(),
        Err(_) if number > 0 => u64::MAX.into(),
        Err(_) => i64::try_from(number).unwrap_or(i64::MIN).into(),
    }
}

fn valued(form: TreeType, seed: u64, size: [u64; 3]) {
    let cells = pair(form, seed, size);
    let views = cells.each_ref().map(view_of_cells);
    let number = |join: fn(Number, Number) -> Number| on_numbers(form.value, join);
    let cases: [(CombineOperation, Join<'_>); 7] = [
        (CombineOperation::Over, Box::new(|a, b| a.or(b))),
        (CombineOperation::Min, number(Number::min)),
        (CombineOperation::Max, number(Number::max)),
        (CombineOperation::Add, number(|a, b| computed(a, b, |a, b| a + b, |a, b| a + b))),
        (CombineOperation::Subtract, number(|a, b| computed(a, b, |a, b| a - b, |a, b| a - b))),
        (CombineOperation::Equal, Box::new(|a, b| a.filter(|_| a == b))),
        (CombineOperation::Changed, Box::new(|a, b| if a == b { None } else { b.or(a) })),
    ];
    for (operation, expected) in cases {
        let combined = combined(views.to_vec(), operation, size);
        let expected = made(form, size, |cell| expected(cells[0].get(cell), cells[1].get(cell)));
        assert_same(&cells_of(&combined, size), &expected, &format!("{form}, seed {seed}, {operation:?}"));
    }
}

#[test]
fn operations_on_values() {
    let mut random = Random(22);
    for seed in 0..15 {
        valued(QUAD, seed, quad_size(&mut random));
        valued(quad(SampleType::I16, 1), seed, quad_size(&mut random));
        valued(oct(SampleType::F32, 3), seed, oct_size(&mut random));
    }
    for (seed, value) in (100..).zip(value_types()) {
        valued(TreeType::new(Dimension::Quad, value), seed, quad_size(&mut random));
        valued(TreeType::new(Dimension::Oct, value), seed, oct_size(&mut random));
    }
}

#[test]
fn many_trees_over_each_other() {
    let size = [60, 50, 1];
    let cells: Vec<_> = (0..7).map(|seed| Cells::random(QUAD, seed, size, 3, true)).collect();
    let views: Vec<_> = cells.iter().map(view_of_cells).collect();
    let over = combined(views.clone(), CombineOperation::Over, size);
    let expected = made(QUAD, size, |cell| cells.iter().find_map(|cells| cells.get(cell)));
    assert_same(&cells_of(&over, size), &expected, "over");
    let max = combined(views, CombineOperation::Max, size);
    let expected = made(QUAD, size, |cell| {
        let numbers = cells.iter().map(|cells| cells.get(cell).map(as_byte));
        numbers.reduce(|a, b| Some(a?.max(b?)))?.map(byte)
    });
    assert_same(&cells_of(&max, size), &expected, "max");
}
