//! Views against arrays of cells, worked examples of the literature, and files built from views and
//! combinations.

use spinney::raw::ops::{AffineMap, Axis, Combined, Prefer, Sampling, View};
use spinney::raw::store::builder::ReusableSource;
use spinney::tree::{Child, MemTree, Source};
use spinney::{Code, CombineOperation, DataKind, Dimension, Frame, Rule, SampleType, TreeType, Value};

use crate::common::{
    Cells, OCT, QUAD, Random, as_byte, assert_same, byte, children, combined, goblin, goblin_from_combined,
    goblin_from_tree, goblin_from_view, made, oct, oct_size, quad, quad_size, seen, set_operation,
    value_types, view_in, view_of, view_of_cells, view_of_file,
};

/// Returns a varied quadtree or octree and its cells.
fn sample(form: TreeType, seed: u64, size: [u64; 3]) -> (View, Cells) {
    let cells = Cells::random(form, seed, size, 9, true);
    (view_of_cells(&cells), cells)
}

const AXES: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

/// Returns all permutations of three axes.
fn orders() -> Vec<[Axis; 3]> {
    let mut orders = Vec::new();
    for a in AXES {
        for b in AXES {
            for c in AXES {
                if a != b && b != c && a != c {
                    orders.push([a, b, c]);
                }
            }
        }
    }
    orders
}

/// Applies a sequence of operations that map cells to cells, to the view and to the array.
fn exact_chain(form: TreeType, seed: u64, size: [u64; 3]) {
    let (mut view, mut cells) = sample(form, seed, size);
    let mut random = Random(seed ^ 77);
    let mut steps = String::new();
    for _ in 0..1 + random.below(5) {
        let axes = form.axes();
        match random.below(4) {
            0 => {
                let mut min = [0; 3];
                let mut size = [1; 3];
                for axis in 0..axes {
                    min[axis] = random.below(cells.size[axis] + 6) as i64 - 6;
                    size[axis] = random.below(cells.size[axis]) + 7;
                }
                steps += &format!(" window {min:?} {size:?}");
                view = view.window(min, size).unwrap();
                cells = made(form, size, |cell| cells.at(std::array::from_fn(|i| cell[i] as i64 + min[i])));
            }
            1 => {
                let mut by = [0i64; 3];
                for (axis, by) in by.iter_mut().enumerate().take(axes) {
                    *by = random.below(9 + cells.size[axis]) as i64 - cells.size[axis] as i64 + 1;
                }
                steps += &format!(" translate {by:?}");
                view = view.translate(by.map(|by| by as f64)).unwrap();
                let size = std::array::from_fn(|i| (cells.size[i] as i64 + by[i]) as u64);
                cells = made(form, size, |cell| cells.at(std::array::from_fn(|i| cell[i] as i64 - by[i])));
                // Cells moved beyond the first cell are lost in the array; cropping removes them
                // from the view, too.
                view = view.window([0; 3], size).unwrap();
            }
            2 => {
                let orders = orders();
                let mut order = orders[random.below(6) as usize];
                let mut mirror = [0; 3].map(|_| random.below(2) > 0);
                if axes == 2 {
                    order = if random.below(2) > 0 { AXES } else { [Axis::Y, Axis::X, Axis::Z] };
                    mirror[2] = false;
                }
                steps += &format!(" symmetry {order:?} {mirror:?}");
                view = view.transform(&AffineMap::symmetry(order, mirror).unwrap()).unwrap();
                let size = order.map(|axis| cells.size[axis as usize]);
                cells = made(form, size, |cell| {
                    let mut from = [0; 3];
                    for (to, axis) in order.iter().enumerate() {
                        from[*axis as usize] = if mirror[to] { size[to] - 1 - cell[to] } else { cell[to] };
                    }
                    cells.get(from)
                });
            }
            _ => {
                let mut by = [1; 3];
                by[..axes].fill_with(|| 1 + random.below(if axes > 2 { 2 } else { 3 }));
                steps += &format!(" scale {by:?}");
                view = view.scale(by.map(|by| by as f64)).unwrap();
                let size = std::array::from_fn(|i| cells.size[i] * by[i]);
                cells = made(form, size, |cell| cells.get(std::array::from_fn(|i| cell[i] / by[i])));
            }
        }
        let steps = format!("seed {seed}:{steps}");
        assert_same(&seen(&view), &cells, &steps);
    }
}

#[test]
fn chains_of_exact_steps() {
    let mut random = Random(5);
    for seed in 0..60 {
        let size = quad_size(&mut random);
        exact_chain(QUAD, seed, size);
        exact_chain(quad(SampleType::F32, 1), seed + 1000, size);
        let size = oct_size(&mut random);
        exact_chain(OCT, seed + 2000, size);
        exact_chain(oct(SampleType::U16, 3), seed + 3000, size);
    }
    for (seed, value) in (4000..).zip(value_types()) {
        exact_chain(TreeType::new(Dimension::Quad, value), seed, quad_size(&mut random));
        exact_chain(TreeType::new(Dimension::Oct, value), seed + 1000, oct_size(&mut random));
    }
}

#[test]
fn any_affine_map_gives_the_value_at_the_centre() {
    let mut random = Random(11);
    let mut number = move || random.below(4001) as f64 / 1000.0 - 2.0;
    for seed in 0..80 {
        let mut random = Random(seed);
        if seed % 2 == 0 {
            affine(quad(SampleType::U8, 3), seed, quad_size(&mut random), &mut number);
        } else {
            affine(OCT, seed, oct_size(&mut random), &mut number);
        }
    }
}

fn affine(form: TreeType, seed: u64, size: [u64; 3], number: &mut impl FnMut() -> f64) {
    let (view, cells) = sample(form, seed, size);
    let axes = form.axes();
    let mut rows = [[0.0; 4]; 3];
    rows[2][2] = 1.0;
    rows[..axes].iter_mut().for_each(|row| {
        row[..axes].fill_with(&mut *number);
        row[3] = 10.0 * number();
    });
    if axes == 2 {
        (rows[0][2], rows[1][2]) = (0.0, 0.0);
    }
    let map = AffineMap::from_rows(rows);
    let Ok(view) = view.transform(&map) else { return };
    if view.extent().iter().product::<u64>() > 200_000 {
        return;
    }
    let to_source = view.to_source();
    let expected = made(form, view.extent(), |cell| {
        let centre = [0, 1, 2].map(|i| cell[i] as f64 + 0.5);
        cells.at(to_source.apply(centre).map(|coordinate| coordinate.floor() as i64))
    });
    assert_same(&seen(&view), &expected, &format!("seed {seed}: {rows:?}"));
    // The view contains all of the source, so the inverse map keeps every cell centre inside.
    let forth = to_source.inverse().unwrap();
    for corner in 0..8 {
        let end = std::array::from_fn(|i| if corner >> i & 1 > 0 { size[i] as f64 } else { 0.0 });
        let at = forth.apply(end);
        let inside = (0..3).all(|i| at[i] > -1e-5 && at[i] < view.extent()[i] as f64 + 1e-5);
        assert!(inside, "{at:?} of {:?}", view.extent());
    }
    // A window of it, rotated again.
    let size = view.extent();
    let part = std::array::from_fn(|i| size[i].div_ceil(2));
    let min = std::array::from_fn(|i| (size[i] / 4) as i64);
    let window = view.clone().window(min, part).unwrap();
    let turn = AffineMap::rotation(Axis::Z, 25.0, [3.0, 5.0, 0.0]);
    let turned = window.clone().transform(&turn).unwrap();
    if turned.extent().iter().product::<u64>() > 200_000 {
        return;
    }
    let to_source = turned.to_source();
    // Cells outside of the window are not visible.
    let to_window = to_source.then(&window.to_source().inverse().unwrap());
    let expected = made(form, turned.extent(), |cell| {
        let centre = [0, 1, 2].map(|i| cell[i] as f64 + 0.5);
        let there = to_window.apply(centre);
        let inside = (0..axes).all(|i| there[i] >= 0.0 && there[i] < part[i] as f64);
        if inside {
            cells.at(to_source.apply(centre).map(|coordinate| coordinate.floor() as i64))
        } else {
            None
        }
    });
    assert_same(&seen(&turned), &expected, &format!("seed {seed}: window of {rows:?}, turned"));
}

/// Returns the value of an area in an array of cells.
fn covered(cells: &Cells, rule: Rule, from: [f64; 3], to: [f64; 3]) -> Option<Value> {
    let value_type = cells.form.value;
    let mut shares: Vec<(Value, f64)> = Vec::new();
    let axis = |i: usize| {
        (from[i].floor() as i64..to[i].ceil() as i64)
            .map(move |cell| (cell, to[i].min(cell as f64 + 1.0) - from[i].max(cell as f64)))
    };
    for (z, c) in axis(2) {
        for (y, b) in axis(1) {
            for (x, a) in axis(0) {
                if let Some(value) = cells.at([x, y, z]).filter(|_| a.min(b).min(c) > 1e-7) {
                    match shares.iter_mut().find(|(other, _)| *other == value) {
                        Some((_, share)) => *share += a * b * c,
                        None => shares.push((value, a * b * c)),
                    }
                }
            }
        }
    }
    let all: f64 = shares.iter().map(|(_, share)| share).sum();
    let most = shares.iter().map(|(_, share)| *share).fold(0.0, f64::max);
    match rule {
        Rule::Majority => {
            // The first of tied values, row by row.
            shares.iter().find(|(_, share)| *share > most - 1e-6).map(|(value, _)| *value)
        }
        _ if shares.is_empty() => None,
        _ => Some(value_type.nearest(|channel| {
            let sum: f64 =
                shares.iter().map(|(value, share)| value_type.samples(*value)[channel] * share).sum();
            (sum / all + 0.5).floor()
        })),
    }
}

#[test]
fn scaling_by_area() {
    let mut random = Random(3);
    for seed in 0..40u64 {
        let rule = if seed % 2 == 0 { Rule::Mean } else { Rule::Majority };
        let size = quad_size(&mut random);
        let by = [0.2 + random.below(300) as f64 / 100.0, 0.2 + random.below(300) as f64 / 100.0, 1.0];
        let (view, cells) = sample(QUAD, seed, size);
        // A window first: cells outside of it must not contribute.
        let min = [size[0] as i64 / 3, size[1] as i64 / 4, 0];
        let part = [size[0].div_ceil(2), size[1].div_ceil(2), 1];
        let view = view.window(min, part).unwrap();
        let cells = made(QUAD, part, |cell| cells.at(std::array::from_fn(|i| cell[i] as i64 + min[i])));
        let view = view.scale(by).unwrap().sampled(Sampling::Area(rule)).unwrap();
        let found = seen(&view);
        let expected = made(QUAD, view.extent(), |cell| {
            let edge = |up: u64, i: usize| ((cell[i] + up) as f64 / by[i]).min(part[i] as f64);
            covered(&cells, rule, [0, 1, 2].map(|i| edge(0, i)), [0, 1, 2].map(|i| edge(1, i)))
        });
        assert_eq!(found.size, expected.size);
        for (i, (a, b)) in found.cells.iter().zip(&expected.cells).enumerate() {
            let close = match (a, b) {
                // A difference of one: the reference adds in another order.
                (Some(a), Some(b)) if rule == Rule::Mean => as_byte(*a).abs_diff(as_byte(*b)) <= 1,
                _ => a == b,
            };
            assert!(close, "seed {seed}, scale {by:?}, cell {i}: {a:?}, expected {b:?}");
        }
    }
}

#[test]
fn halving_gives_the_representatives() {
    for (seed, rule) in [(1, Rule::Mean), (2, Rule::Majority), (3, Rule::Min), (4, Rule::Max)] {
        let cells = Cells::random(QUAD, seed, [64, 64, 1], 9, true);
        let tree = cells.tree(rule);
        for levels in 1..6 {
            let view = view_of(&tree, [64, 64, 1]).sampled(Sampling::Area(rule)).unwrap();
            let view = view.resample(6 - levels).unwrap();
            assert_eq!(view.depth(), 6 - levels);
            let side = 64 >> levels;
            let expected = made(QUAD, [side, side, 1], |cell| {
                let cell = cell.map(|cell| cell as u32);
                tree.value_at(Code::from_cell(Dimension::Quad, 6 - levels, cell).unwrap())
            });
            assert_same(&seen(&view), &expected, &format!("{rule:?}, {levels} levels up"));
        }
    }
}

#[test]
fn quarter_turns_of_the_literature() {
    // Counter-clockwise: NW goes to SW, NE to NW, SE to NE, SW to SE.
    let cells = made(QUAD, [2, 2, 1], |[x, y, _]| Some(byte((2 * y + x) as u8)));
    let turn = AffineMap::rotation(Axis::Z, -90.0, [1.0, 1.0, 0.0]);
    let turned = seen(&view_of_cells(&cells).transform(&turn).unwrap());
    let goes = [2, 0, 3, 1];
    for (from, to) in goes.into_iter().enumerate() {
        assert_eq!(turned.cells[to], Some(byte(from as u8)));
    }
    // Octants: about each axis, in the numbering 4x + 2y + z and in 4x + 2z + y, as solved in the
    // exercise.
    let tables: [(Axis, [usize; 8], bool); 6] = [
        (Axis::X, [1, 3, 0, 2, 5, 7, 4, 6], false),
        (Axis::Y, [4, 0, 6, 2, 5, 1, 7, 3], false),
        (Axis::Z, [2, 3, 6, 7, 0, 1, 4, 5], false),
        (Axis::X, [1, 3, 0, 2, 5, 7, 4, 6], true),
        (Axis::Y, [2, 3, 6, 7, 0, 1, 4, 5], true),
        (Axis::Z, [4, 0, 6, 2, 5, 1, 7, 3], true),
    ];
    for (axis, goes, z_before_y) in tables {
        let number = |[x, y, z]: [u64; 3]| if z_before_y { 4 * x + 2 * z + y } else { 4 * x + 2 * y + z };
        let view = view_of_cells(&made(OCT, [2; 3], |cell| Some(byte(number(cell) as u8))));
        // In the first numbering, the printed rotation about x maps (y, z) to (z, 1 - y): minus 90
        // degrees; so do the solutions about the other axes. In the second all rotate by plus 90.
        let degrees = if z_before_y { 90.0 } else { -90.0 };
        let turned = seen(&view.transform(&AffineMap::rotation(axis, degrees, [1.0; 3])).unwrap());
        for z in 0..2 {
            for y in 0..2 {
                for x in 0..2 {
                    let from = as_byte(turned.get([x, y, z]).unwrap()) as usize;
                    let to = number([x, y, z]) as usize;
                    assert_eq!(goes[from], to, "about {axis:?}, z before y: {z_before_y}");
                }
            }
        }
    }
}

#[test]
fn window_of_the_literature() {
    // 8 x 8 cells in 10 leaves, so 3 inner nodes. Of the 4 x 4 window at (1, 1), the NW quadrant is
    // split to cells; the SE quadrant lies in four VOID leaves, which the literature splits and
    // merges again, while the view merges them directly.
    let cells = made(QUAD, [8, 8, 1], |[x, y, _]| ((x < 2 && y < 2) || (x >= 6 && y >= 6)).then(|| byte(1)));
    let tree = cells.tree(Rule::Mean);
    assert_eq!(tree.inner_nodes(), 3);
    let view = view_of(&tree, [8, 8, 1]).window([1, 1, 0], [4, 4, 1]).unwrap();
    let expected = made(QUAD, [4, 4, 1], |[x, y, _]| cells.get([x + 1, y + 1, 0]));
    assert_same(&seen(&view), &expected, "window");
    let Child::Inner { node, .. } = view.root().unwrap() else { panic!("the window is not uniform") };
    let quarters = children(&view, &node);
    assert!(quarters[0].is_inner() && matches!(quarters[3], Child::Void));
    let built = MemTree::from_source(&view, Rule::Mean).unwrap();
    let Child::Inner { node, .. } = built.root().unwrap() else { panic!("nor is its tree") };
    let quarters = children(&built, &node);
    assert!(quarters[0].is_inner() && quarters[1..].iter().all(|quarter| *quarter == Child::Void));
}

#[test]
fn turning_and_moving_there_and_back() {
    let (view, cells) = sample(QUAD, 8, [45, 31, 1]);
    let quarter = AffineMap::rotation(Axis::Z, 90.0, [7.0, 9.0, 0.0]);
    let mut turned = view.clone();
    for _ in 0..4 {
        turned = turned.transform(&quarter).unwrap();
    }
    assert_same(&seen(&turned), &cells, "four quarter turns");
    assert_eq!(turned.to_source(), AffineMap::IDENTITY);
    let moved = view.clone().translate([13.0, 5.0, 0.0]).unwrap().translate([-13.0, -5.0, 0.0]).unwrap();
    assert_same(&seen(&moved), &cells, "there and back");
    let once = view.clone().window([5, 6, 0], [20, 15, 1]).unwrap();
    let twice = view.clone().window([2, 3, 0], [30, 22, 1]).unwrap().window([3, 3, 0], [20, 15, 1]).unwrap();
    assert_same(&seen(&once), &seen(&twice), "window of a window");
    let whole = view.scale([3.0, 3.0, 1.0]).unwrap().scale([1.0 / 3.0, 1.0 / 3.0, 1.0]).unwrap();
    assert_same(&seen(&whole), &cells, "three times and a third");
}

#[test]
fn frames_follow_or_move() {
    let frame = Frame::planar([0.5, 0.0, 100.0, 0.0, -0.5, 50.0]);
    let view = view_in(&Cells::random(QUAD, 4, [40, 30, 1], 9, true), &frame);
    let shown = view.clone().window([10, 4, 0], [8, 8, 1]).unwrap();
    assert_eq!(shown.frame(false), shown.frame(true));
    assert_eq!(shown.frame(false).to_world([0.0; 3]), [105.0, 48.0, 0.0]);
    let turned = view.clone().transform(&AffineMap::rotation(Axis::Z, 90.0, [0.0; 3])).unwrap();
    // Cell (0, 0) was at the west end of the top row; after a clockwise rotation it is at the right
    // end of the top row.
    let corner = turned.frame(false).to_world([29.5, 0.5, 0.0]);
    assert_eq!(corner, frame.to_world([0.5, 0.5, 0.0]));
    // Transformed, it is below and to the left of the centre of rotation.
    assert_eq!(turned.frame(true).to_world([30.0, 0.0, 0.0]), frame.to_world([0.0; 3]));
    let large = view.scale([2.0, 2.0, 1.0]).unwrap();
    assert_eq!(large.frame(false).to_world([80.0, 60.0, 0.0]), frame.to_world([40.0, 30.0, 0.0]));
    assert_eq!(large.frame(true).to_world([80.0, 60.0, 0.0]), frame.to_world([80.0, 60.0, 0.0]));
}

#[test]
fn files_of_views_and_combinations() {
    // The file built from a view equals the file built from its cells, whatever segments were
    // copied. (Nine blocks of 256 by 256 cells.)
    let size = [540, 530, 1];
    let [a, b] = [1, 2].map(|seed| Cells::random(QUAD, seed, size, 9, true));
    let (rule, kind) = (Rule::Majority, DataKind::Categorical);
    let views = [&a, &b].map(|cells| view_of_file(goblin(cells, rule, kind), size));
    let from_cells = |cells: &Cells| goblin_from_tree(&cells.tree(rule), cells.size, rule, kind);
    let check = |view: View, cells: Cells, what: &str| {
        assert!(goblin_from_view(&view, rule, kind) == from_cells(&cells), "{what}");
    };
    let view = || views[0].clone();
    check(view(), a.clone(), "as it is");
    let (min, part) = ([256, 128, 0], [280, 256, 1]);
    let shifted = |cell: [u64; 3]| a.get([cell[0] + 256, cell[1] + 128, 0]);
    check(view().window(min, part).unwrap(), made(QUAD, part, shifted), "aligned window");
    let part = [450, 300, 1];
    let shifted = |cell: [u64; 3]| a.get([cell[0] + 77, cell[1] + 130, 0]);
    check(view().window([77, 130, 0], part).unwrap(), made(QUAD, part, shifted), "window");
    let turned = made(QUAD, [530, 540, 1], |[x, y, _]| a.get([y, 529 - x, 0]));
    check(view().transform(&AffineMap::rotation(Axis::Z, 90.0, [0.0; 3])).unwrap(), turned, "quarter turn");
    let moved = made(QUAD, [1052, 1042, 1], |[x, y, _]| a.at([x as i64 - 512, y as i64 - 512, 0]));
    check(view().translate([512.0, 512.0, 0.0]).unwrap(), moved, "moved by a power of two");
    for number in 0..16 {
        let expected = |prefer: Prefer| {
            from_cells(&made(QUAD, size, |cell| match (a.get(cell), b.get(cell)) {
                (Some(a), Some(b)) => (number & 1 > 0).then_some(if prefer == Prefer::First { a } else { b }),
                (Some(a), None) => (number & 2 > 0).then_some(a),
                (None, Some(b)) => (number & 4 > 0).then_some(b),
                (None, None) => (number & 8 > 0).then(|| byte(255)),
            }))
        };
        let mut bytes = expected(Prefer::First);
        for prefer in [Prefer::First, Prefer::Second] {
            if prefer == Prefer::Second && number & 1 > 0 {
                bytes = expected(prefer);
            }
            let operation = CombineOperation::Set { operation: set_operation(number), prefer };
            let found = goblin_from_combined(&combined(views.to_vec(), operation, size), rule, kind);
            assert!(found == bytes, "operation {number}, {prefer:?}");
        }
    }
    let over = combined(views.to_vec(), CombineOperation::Over, size);
    let expected = made(QUAD, size, |cell| a.get(cell).or(b.get(cell)));
    assert!(goblin_from_combined(&over, rule, kind) == from_cells(&expected), "over");
}

#[test]
fn what_is_stored_is_offered_through_all_layers() {
    // Only the speed would differ.
    let size = [300, 200, 1];
    let file = goblin(&Cells::random(QUAD, 1, size, 9, true), Rule::Majority, DataKind::Categorical);
    let view = view_of_file(file, size);
    let over = combined(vec![view], CombineOperation::Over, size);
    let Child::Inner { node, .. } = over.root().unwrap() else { panic!("it is not uniform") };
    assert!(over.stored(&node).is_some());
}

#[test]
fn what_cannot_be_done_is_refused() {
    let (view, _) = sample(QUAD, 1, [40, 30, 1]);
    let says = |result: spinney::Result<View>, words: &[&str]| {
        let error = result.expect_err("an error").to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    };
    says(view.clone().window([40, 0, 0], [5, 5, 1]), &["window", "40 x 30"]);
    says(view.clone().window([-5, 0, 0], [5, 5, 1]), &["window"]);
    says(view.clone().window([0, 0, 0], [0, 5, 1]), &["window"]);
    says(view.clone().window([0, 0, 0], [1 << 40, 5, 1]), &["size"]);
    says(view.clone().window([i64::MIN, i64::MIN, 0], [u64::MAX, u64::MAX, 1]), &["size"]);
    says(view.clone().translate([-40.0, 0.0, 0.0]), &["translation"]);
    says(view.clone().translate([f64::NAN, 0.0, 0.0]), &["finite"]);
    says(view.clone().translate([1e300, 0.0, 0.0]), &["size"]);
    says(view.clone().translate([0.0, 0.0, 1.0]), &["z"]);
    says(view.clone().scale([0.0, 1.0, 1.0]), &["scale"]);
    says(view.clone().scale([1e12, 1.0, 1.0]), &["size"]);
    says(view.clone().transform(&AffineMap::scaling([1.0, 0.0, 1.0])), &["invertible"]);
    says(view.clone().transform(&AffineMap::rotation(Axis::X, 30.0, [0.0; 3])), &["z unchanged"]);
    says(view.clone().resample(200), &["size"]);
    says(view.clone().deepened(3), &["depth"]);
    says(view.clone().deepened(200), &["depth"]);
    assert!(AffineMap::rotation_about([0.0; 3], 30.0, [0.0; 3]).is_err());
    assert!(AffineMap::symmetry([Axis::X, Axis::X, Axis::Z], [false; 3]).is_err());
    let trees = |count: usize| (0..count).map(|_| view.clone()).collect::<Vec<_>>();
    let set = |number| CombineOperation::set(set_operation(number));
    assert_eq!(spinney::SetOperation::from_index(16), None);
    assert!(Combined::new(trees(3), set(5), [40, 30, 1]).is_err());
    assert!(Combined::new(trees(1), CombineOperation::Changed, [40, 30, 1]).is_err());
    assert!(Combined::new(trees(0), CombineOperation::Over, [40, 30, 1]).is_err());
    let other = vec![view.clone(), view.clone().deepened(9).unwrap()];
    let error = Combined::new(other, CombineOperation::Over, [40, 30, 1]).err().unwrap().to_string();
    assert!(error.contains("depth") && error.contains("deepen"), "{error}");
    for (form, name) in [(quad(SampleType::U8, 2), "quadtree of u8x2"), (OCT, "octree of u8")] {
        let size = [40, 30, form.axes() as u64 - 1];
        let other = view_of_cells(&made(form, size, |_| None)).deepened(view.depth()).unwrap();
        let error = Combined::new(vec![view.clone(), other], CombineOperation::Over, [40, 30, 1])
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains(name) && error.contains("quadtree of u8"), "{error}");
    }
}
