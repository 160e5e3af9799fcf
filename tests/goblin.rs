//! Goblin files against the tree in memory: build, read, verify, for both dimensions and all types.

mod common;

use common::{Cells, cells_below, goblin, goblin_bytes, goblin_from_source, same_trees};
use spinney::space::{Code, Dimension, Oct, Quad};
use spinney::store::build::depth_for;
use spinney::store::goblin::{Goblin, Layout};
use spinney::tree::{Child, MemTree, Source};
use spinney::value::{Kind, Rule, Value};

fn round_trip<D: Layout, V: Value>(seed: u64, size: [u64; 3], rule: Rule, kind: Kind) {
    let cells = Cells::<V>::random(seed, size, 4 + seed % 60, !seed.is_multiple_of(3));
    let depth = depth_for(size);
    let tree = MemTree::<D, V>::from_cells(depth, rule, |cell| cells.get(cell.map(u64::from)));
    let bytes = goblin_bytes::<D, V>(&cells, rule, kind);
    let file = Goblin::<D, V>::from_bytes(bytes.clone()).unwrap();
    same_trees(&file, &tree);
    assert_eq!(file.metadata().counts.records(), tree.inner_nodes() as u64);
    assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
    // From a source: the same tree, the same bytes when written again.
    let again = goblin_from_source(&tree, size, rule, kind);
    same_trees(&Goblin::<D, V>::from_bytes(again.clone()).unwrap(), &tree);
    assert_eq!(goblin_from_source(&file, size, rule, kind), again);
}

#[test]
fn quadtrees_of_every_type_and_rule_come_back() {
    use Kind::{Categorical, Continuous};
    for seed in 0..6 {
        let size = [1 + 137 * seed, 300 - 40 * seed, 1];
        round_trip::<Quad, [u8; 1]>(seed, size, Rule::Majority, Categorical);
        round_trip::<Quad, [u8; 3]>(seed, size, Rule::Mean, Continuous);
        round_trip::<Quad, [f32; 1]>(seed, size, Rule::Mean, Continuous);
        round_trip::<Quad, [i16; 1]>(seed, size, Rule::ALL[seed as usize], Continuous);
    }
    round_trip::<Quad, [u8; 1]>(7, [513, 700, 1], Rule::Mean, Categorical);
    round_trip::<Quad, [u16; 4]>(7, [513, 300, 1], Rule::Mean, Continuous);
    round_trip::<Quad, [u16; 1]>(8, [300, 300, 1], Rule::Dominant, Categorical);
    round_trip::<Quad, [u32; 1]>(9, [300, 513, 1], Rule::Max, Continuous);
    round_trip::<Quad, [i32; 1]>(10, [256, 256, 1], Rule::Mean, Continuous);
    round_trip::<Quad, [f64; 1]>(11, [257, 256, 1], Rule::Mean, Continuous);
    round_trip::<Quad, [f32; 3]>(12, [300, 257, 1], Rule::Min, Continuous);
    round_trip::<Quad, [u8; 2]>(13, [1, 1, 1], Rule::Mean, Continuous);
    round_trip::<Quad, [u8; 4]>(14, [2, 1, 1], Rule::Nearest, Continuous);
}

#[test]
fn octrees_come_back() {
    for seed in 0..6 {
        let size = [1 + 13 * seed, 70 - 9 * seed, 1 + 17 * seed];
        round_trip::<Oct, [u8; 1]>(seed, size, Rule::Mean, Kind::Continuous);
        round_trip::<Oct, [u8; 1]>(seed, size, Rule::ALL[seed as usize], Kind::Categorical);
    }
    round_trip::<Oct, [f32; 3]>(3, [65, 20, 70], Rule::Mean, Kind::Continuous);
    round_trip::<Oct, [u16; 1]>(4, [130, 90, 30], Rule::Majority, Kind::Categorical);
}

/// Means and majorities by going through all cells, for every node of a tree with several segments.
#[test]
fn averages_are_exact_at_every_level() {
    let cells = Cells::<[u8; 1]>::random(5, [700, 600, 1], 9, true);
    let mean = goblin::<Quad, [u8; 1]>(&cells, Rule::Mean, Kind::Continuous);
    let majority = goblin::<Quad, [u8; 1]>(&cells, Rule::Majority, Kind::Categorical);
    assert!(mean.segments() > 3);
    let depth = mean.depth();
    for level in 0..=depth {
        for y in (0..1u32 << level).step_by(1 << level.saturating_sub(5)) {
            for x in (0..1u32 << level).step_by(1 << level.saturating_sub(5)) {
                let code = Code::<Quad>::from_cell(level, [x, y, 0]).unwrap();
                let mut counts = [0u64; 256];
                let below = cells_below(code, depth).filter_map(|cell| cells.get(cell.map(u64::from)));
                below.for_each(|[value]| counts[value as usize] += 1);
                let valid: u64 = counts.iter().sum();
                let sum: u64 = counts.iter().enumerate().map(|(value, count)| value as u64 * count).sum();
                let expected_mean = (valid > 0).then(|| [((2 * sum + valid) / (2 * valid)) as u8]);
                assert_eq!(mean.value_at(code).unwrap(), expected_mean, "{code}");
                let most = counts.iter().max().unwrap();
                let class = counts.iter().position(|count| count == most).unwrap() as u8;
                assert_eq!(majority.value_at(code).unwrap(), (valid > 0).then_some([class]), "{code}");
            }
        }
    }
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let cells = Cells::<[u8; 1]>::random(5, [1500, 900, 1], 9, true);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| goblin_bytes::<Quad, [u8; 1]>(&cells, Rule::Majority, Kind::Categorical))
    };
    let one = build(1);
    assert!(one == build(2) && one == build(5));
}

#[test]
fn codes_come_in_preorder() {
    let cells = Cells::<[u8; 1]>::random(2, [50, 50, 50], 9, true);
    let tree = MemTree::<Oct, [u8; 1]>::from_cells(6, Rule::Mean, |cell| cells.get(cell.map(u64::from)));
    let mut pending = vec![(Code::<Oct>::ROOT, tree.root().unwrap())];
    let mut before = None;
    while let Some((code, place)) = pending.pop() {
        assert!(before < Some(code.bits()));
        before = Some(code.bits());
        if let Child::Inner { node, .. } = place {
            let children = tree.children(&node).unwrap();
            pending.extend((0..Oct::CHILDREN).rev().map(|i| (code.child(i), children[i])));
        }
    }
}
