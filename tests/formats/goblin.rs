//! Goblin files against the tree in memory: build, read, verify, for both dimensions and all types.

use spinney::raw::store::goblin::Goblin;
use spinney::raw::value::Sums;
use spinney::tree::{Child, Source};
use spinney::{Code, DataKind, Dimension, Rule, SampleType, TreeType, Value};

use crate::common::{
    Cells, OCT, QUAD, as_byte, byte, cells_below, children, goblin, goblin_bytes, goblin_from_tree,
    goblin_from_view, made, oct, quad, same_trees, value_types, view_of_file,
};

fn round_trip(form: TreeType, seed: u64, size: [u64; 3], rule: Rule, kind: DataKind) {
    let cells = Cells::random(form, seed, size, 4 + seed % 60, !seed.is_multiple_of(3));
    let tree = cells.tree(rule);
    let bytes = goblin_bytes(&cells, rule, kind);
    let file = Goblin::from_bytes(bytes).unwrap();
    same_trees(&file, &tree);
    assert_eq!(file.metadata().counts.records(), tree.inner_nodes() as u64);
    assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
    // From a source: the same tree, and the same bytes when written again.
    let again = goblin_from_tree(&tree, size, rule, kind);
    same_trees(&Goblin::from_bytes(again.clone()).unwrap(), &tree);
    let file = view_of_file(file, size);
    assert!(goblin_from_view(&file, rule, kind) == again, "{form} {rule} {kind} {size:?}");
}

#[test]
fn quadtrees_of_every_type_and_rule_round_trip() {
    use DataKind::{Categorical, Continuous};
    use SampleType::*;
    for seed in 0..6 {
        let size = [1 + 137 * seed, 300 - 40 * seed, 1];
        round_trip(QUAD, seed, size, Rule::Majority, Categorical);
        round_trip(quad(U8, 3), seed, size, Rule::Mean, Continuous);
        round_trip(quad(F32, 1), seed, size, Rule::Mean, Continuous);
        round_trip(quad(I16, 1), seed, size, Rule::ALL[seed as usize], Continuous);
    }
    round_trip(QUAD, 7, [513, 700, 1], Rule::Mean, Categorical);
    round_trip(quad(U16, 4), 7, [513, 300, 1], Rule::Mean, Continuous);
    round_trip(quad(U16, 1), 8, [300, 300, 1], Rule::Dominant, Categorical);
    round_trip(quad(U32, 1), 9, [300, 513, 1], Rule::Max, Continuous);
    round_trip(quad(I32, 1), 10, [256, 256, 1], Rule::Mean, Continuous);
    round_trip(quad(F64, 1), 11, [257, 256, 1], Rule::Mean, Continuous);
    round_trip(quad(F32, 3), 12, [300, 257, 1], Rule::Min, Continuous);
    round_trip(quad(U8, 2), 13, [1, 1, 1], Rule::Mean, Continuous);
    round_trip(quad(U8, 4), 14, [2, 1, 1], Rule::Nearest, Continuous);
}

#[test]
fn octrees_round_trip() {
    use SampleType::*;
    for seed in 0..6 {
        let size = [1 + 13 * seed, 70 - 9 * seed, 1 + 17 * seed];
        round_trip(OCT, seed, size, Rule::Mean, DataKind::Continuous);
        round_trip(OCT, seed, size, Rule::ALL[seed as usize], DataKind::Categorical);
    }
    round_trip(oct(F32, 3), 3, [65, 20, 70], Rule::Mean, DataKind::Continuous);
    round_trip(oct(U16, 1), 4, [128, 90, 30], Rule::Majority, DataKind::Categorical);
}

/// Each file selects its records, kernels and rules at run time: every combination must be covered.
#[test]
fn every_type_round_trips_by_every_rule_in_both_dimensions() {
    for (i, value) in value_types().into_iter().enumerate() {
        for (j, rule) in Rule::ALL.into_iter().enumerate() {
            let seed = (7 * i + j) as u64;
            let kind = if seed.is_multiple_of(2) { DataKind::Continuous } else { DataKind::Categorical };
            round_trip(TreeType::new(Dimension::Quad, value), seed, [70, 41, 1], rule, kind);
            round_trip(TreeType::new(Dimension::Oct, value), seed, [13, 18, 9], rule, kind);
        }
    }
}

/// Means and majorities for every node of a tree with several segments, against brute force over
/// all cells.
#[test]
fn averages_are_exact_at_every_level() {
    let cells = Cells::random(QUAD, 5, [700, 600, 1], 9, true);
    let mean = goblin(&cells, Rule::Mean, DataKind::Continuous);
    let majority = goblin(&cells, Rule::Majority, DataKind::Categorical);
    assert!(mean.segments() > 3);
    let depth = mean.depth();
    for level in 0..=depth {
        for y in (0..1u32 << level).step_by(1 << level.saturating_sub(5)) {
            for x in (0..1u32 << level).step_by(1 << level.saturating_sub(5)) {
                let code = Code::from_cell(Dimension::Quad, level, [x, y, 0]).unwrap();
                let mut counts = [0u64; 256];
                let below = cells_below(code, depth).filter_map(|cell| cells.get(cell.map(u64::from)));
                below.for_each(|value| counts[as_byte(value) as usize] += 1);
                let valid: u64 = counts.iter().sum();
                let sum: u64 = counts.iter().enumerate().map(|(value, count)| value as u64 * count).sum();
                let expected_mean = (valid > 0).then(|| byte(((2 * sum + valid) / (2 * valid)) as u8));
                assert_eq!(mean.value_at(code).unwrap(), expected_mean, "{code}");
                let most = counts.iter().max().unwrap();
                // The tests of ties check which class it is.
                let found = majority.value_at(code).unwrap();
                assert_eq!(found.is_some(), valid > 0, "{code}");
                assert!(found.is_none_or(|class| counts[as_byte(class) as usize] == *most), "{code}");
            }
        }
    }
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let cells = Cells::random(QUAD, 5, [1500, 900, 1], 9, true);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| goblin_bytes(&cells, Rule::Majority, DataKind::Categorical))
    };
    let one = build(1);
    assert!(one == build(2) && one == build(5));
}

#[test]
fn codes_come_in_preorder() {
    let tree = Cells::random(OCT, 2, [50, 50, 50], 9, true).tree(Rule::Mean);
    let mut pending = vec![(Code::root(Dimension::Oct), tree.root().unwrap())];
    let mut before = None;
    while let Some((code, subtree)) = pending.pop() {
        assert!(before < Some(code.bits()));
        before = Some(code.bits());
        if let Child::Inner { node, .. } = subtree {
            let children = children(&tree, &node).into_iter().enumerate().rev();
            pending.extend(children.map(|(i, child)| (code.child(i), child)));
        }
    }
}

#[test]
fn sums_of_floating_samples_keep_their_digits() {
    // Multiples of 2^-60, so that the sum can be computed exactly.
    let numbers = [0.1f64, 0.7, -3.3, 1.9];
    let exact = |number: f64| (number * 2f64.powi(60)) as i128;
    let cells = made(quad(SampleType::F64, 1), [2, 2, 1], |[x, y, _]| {
        Some(Value::from(numbers[(2 * y + x) as usize].to_le_bytes()))
    });
    let file = goblin(&cells, Rule::Mean, DataKind::Continuous);
    let zone = file.zone(0).unwrap();
    let (Sums::Double([sum, ..]), Sums::Triple([square, ..])) = (zone.sum, zone.squares) else {
        panic!("{zone:?}")
    };
    assert_eq!(exact(sum.high) + exact(sum.low), numbers.iter().map(|number| exact(*number)).sum::<i128>());
    assert!(sum.low != 0.0);
    // The sum of squares.
    let high = |number: f64| exact(number) >> 20;
    let low = |number: f64| exact(number) & 0xf_ffff;
    let product = |number: f64| {
        // In units of 2^-120.
        let (high, low) = (high(number), low(number));
        ((high * high) << 40) + ((2 * high * low) << 20) + low * low
    };
    let expected: i128 = numbers.iter().map(|number| product(*number)).sum();
    let found = (square.high * 2f64.powi(60)) as i128;
    let rest = [square.middle, square.low].map(|part| (part * 2f64.powi(120)) as i128);
    assert_eq!((found << 60) + rest[0] + rest[1], expected);
}
