//! Set operations and operations on values against arrays of cells, and the algebra they obey.

mod common;

use common::{Cells, Random, assert_same, cells_of, made, oct_size, quad_size, same};
use spinney::ops::{Combined, Operation, Prefer};
use spinney::space::{Oct, Quad};
use spinney::store::build::depth_for;
use spinney::store::goblin::Layout;
use spinney::tree::{MemTree, Source};
use spinney::value::{Rule, Sample, Value};

type Byte = [u8; 1];

/// Two trees over one space.
fn pair<D: Layout, V: Value>(seed: u64, size: [u64; 3]) -> (Vec<MemTree<D, V>>, Vec<Cells<V>>) {
    let depth = depth_for(size);
    let cells: Vec<_> = (0..2).map(|i| Cells::<V>::random(seed * 2 + i, size, 4, true)).collect();
    let tree =
        |cells: &Cells<V>| MemTree::from_cells(depth, Rule::Mean, |cell| cells.get(cell.map(u64::from)));
    (cells.iter().map(tree).collect(), cells)
}

fn set_operations<D: Layout, V: Value>(seed: u64, size: [u64; 3]) {
    let (trees, cells) = pair::<D, V>(seed, size);
    let fill: V = common::value(99);
    for number in 0..16u8 {
        for prefer in [Prefer::First, Prefer::Second] {
            let operation = Operation::Set { number, prefer };
            let combined = Combined::new(trees.iter().collect(), operation, size).unwrap().filled_with(fill);
            let expected = made(size, |cell| {
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
                &format!("seed {seed}, operation {number}, {prefer:?}"),
            );
            // Nothing outside the picture.
            let side = 1u64 << combined.depth();
            let all = cells_of(&combined, [side, side, if D::AXES > 2 { side } else { 1 }]);
            assert_eq!(count(&all), count(&expected), "operation {number}");
        }
    }
}

fn count<V>(cells: &Cells<V>) -> usize {
    cells.cells.iter().flatten().count()
}

#[test]
fn sixteen_set_operations() {
    let mut random = Random(21);
    for seed in 0..12 {
        set_operations::<Quad, Byte>(seed, quad_size(&mut random));
        set_operations::<Quad, [f32; 1]>(seed, quad_size(&mut random));
        set_operations::<Oct, Byte>(seed, oct_size(&mut random));
    }
}

#[test]
fn algebra_of_sets() {
    let size = [50, 41, 1];
    let (trees, _) = pair::<Quad, Byte>(3, size);
    let of = |number: u8, trees: Vec<MemTree<Quad, Byte>>| {
        let combined = Combined::new(trees, Operation::Set { number, prefer: Prefer::First }, size).unwrap();
        MemTree::<Quad, Byte>::from_source(&combined, Rule::Mean).unwrap()
    };
    let present = |tree: &MemTree<Quad, Byte>| {
        let cells = cells_of(tree, size);
        cells.cells.iter().map(Option::is_some).collect::<Vec<_>>()
    };
    let [a, b] = [trees[0].clone(), trees[1].clone()];
    // De Morgan.
    let left = of(12, vec![of(7, vec![a.clone(), b.clone()])]);
    let right = of(1, vec![of(12, vec![a.clone()]), of(12, vec![b.clone()])]);
    assert_eq!(present(&left), present(&right));
    // Either white makes an intersection white (the print says both).
    let area = |tree: &MemTree<Quad, Byte>| present(tree).iter().filter(|there| **there).count();
    let (union, both) = (of(7, vec![a.clone(), b.clone()]), of(1, vec![a.clone(), b.clone()]));
    assert_eq!(area(&union) + area(&both), area(&a) + area(&b));
    assert_eq!(area(&of(6, vec![a.clone(), b.clone()])), area(&union) - area(&both));
    let back = of(12, vec![of(12, vec![a.clone()])]);
    assert_eq!(present(&back), present(&a));
    assert_eq!(area(&of(15, vec![a.clone(), b])), 50 * 41);
    assert_eq!(area(&of(0, vec![a.clone(), a])), 0);
}

fn valued<D: Layout, V: Value>(seed: u64, size: [u64; 3]) {
    let (trees, cells) = pair::<D, V>(seed, size);
    let number = |join: fn(f64, f64) -> f64| {
        move |a: Option<V>, b: Option<V>| {
            let (a, b) = (a?, b?);
            Some(V::from_channels(|c| {
                V::Sample::from_f64_lossy(join(a.samples()[c].to_f64(), b.samples()[c].to_f64()))
            }))
        }
    };
    type Expected<V> = Box<dyn Fn(Option<V>, Option<V>) -> Option<V>>;
    let cases: Vec<(Operation, Expected<V>)> = vec![
        (Operation::Over, Box::new(|a, b| a.or(b))),
        (Operation::Min, Box::new(number(f64::min))),
        (Operation::Max, Box::new(number(f64::max))),
        (Operation::Add, Box::new(number(|a, b| a + b))),
        (Operation::Subtract, Box::new(number(|a, b| a - b))),
        (Operation::Equal, Box::new(|a, b| a.filter(|_| same(a, b)))),
        (Operation::Changed, Box::new(|a, b| if same(a, b) { None } else { b.or(a) })),
    ];
    for (operation, expected) in cases {
        let combined = Combined::new(trees.iter().collect(), operation, size).unwrap();
        let expected = made(size, |cell| expected(cells[0].get(cell), cells[1].get(cell)));
        assert_same(&cells_of(&combined, size), &expected, &format!("seed {seed}, {operation:?}"));
    }
}

#[test]
fn operations_on_values() {
    let mut random = Random(22);
    for seed in 0..15 {
        valued::<Quad, Byte>(seed, quad_size(&mut random));
        valued::<Quad, [i16; 1]>(seed, quad_size(&mut random));
        valued::<Oct, [f32; 3]>(seed, oct_size(&mut random));
    }
}

#[test]
fn many_trees_over_each_other() {
    let size = [60, 50, 1];
    let cells: Vec<_> = (0..7).map(|seed| Cells::<Byte>::random(seed, size, 3, true)).collect();
    let tree = |cells: &Cells<Byte>| {
        MemTree::<Quad, Byte>::from_cells(6, Rule::Mean, |cell| cells.get(cell.map(u64::from)))
    };
    let trees: Vec<_> = cells.iter().map(tree).collect();
    let over = Combined::new(trees.iter().collect(), Operation::Over, size).unwrap();
    let expected = made(size, |cell| cells.iter().find_map(|cells| cells.get(cell)));
    assert_same(&cells_of(&over, size), &expected, "over");
    let max = Combined::new(trees.iter().collect(), Operation::Max, size).unwrap();
    let expected =
        made(size, |cell| cells.iter().map(|cells| cells.get(cell)).reduce(|a, b| Some(a?.max(b?)))?);
    assert_same(&cells_of(&max, size), &expected, "max");
}
