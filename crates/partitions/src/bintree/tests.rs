use proptest::prelude::*;
use spinney_base::space::Dimension;
use spinney_base::value::{Rule, SampleType, ValueType};
use spinney_engine::tree::MemTree;

use super::*;

fn form(axes: u8, value: ValueType) -> TreeType {
    TreeType::new(Dimension::from_axes(axes).unwrap(), value)
}

fn byte_tree(axes: u8, depth: u8, cells: &[Option<u8>]) -> MemTree {
    let side = 1usize << depth;
    let cell = |[x, y, z]: [u32; 3]| {
        cells[(z as usize * side + y as usize) * side + x as usize].map(|number| Value::from([number]))
    };
    MemTree::from_cells(form(axes, ValueType::new(SampleType::U8, 1)), depth, Rule::Nearest, &cell)
}

/// All cells of a bintree, from its leaves.
fn cells_of(tree: &Bintree) -> Vec<Option<Value>> {
    let [width, height, depth] = Bounds::space(tree.form.dimension, tree.depth).max.map(|side| side as usize);
    let (mut cells, mut covered) = (vec![None; width * height * depth], 0);
    tree.each_leaf(&mut |block, value| {
        for z in block.min[2]..block.max[2] {
            for y in block.min[1]..block.max[1] {
                for x in block.min[0]..block.max[0] {
                    cells[(z as usize * height + y as usize) * width + x as usize] = value;
                    covered += 1;
                }
            }
        }
    });
    assert_eq!(covered, cells.len());
    cells
}

/// Minimum node count of a box of cells, by exhaustive search.
fn fewest(tree: &MemTree, block: Bounds) -> usize {
    let cell = |cell: [u64; 3]| {
        let code = Code::from_cell(tree.form().dimension, tree.depth(), cell.map(|at| at as u32)).unwrap();
        tree.value_at(code)
    };
    let first = cell(block.min);
    let all = (block.min[2]..block.max[2]).flat_map(|z| {
        (block.min[1]..block.max[1]).flat_map(move |y| (block.min[0]..block.max[0]).map(move |x| [x, y, z]))
    });
    if all.clone().all(|at| cell(at) == first) {
        return 1;
    }
    let along = (0..tree.form().axes()).filter(|axis| block.size()[*axis] > 1);
    let counts =
        along.map(|axis| halves(block, axis as u8).map(|half| fewest(tree, half)).iter().sum::<usize>());
    1 + counts.min().unwrap()
}

fn cells(axes: u8, depth: u8) -> impl Strategy<Value = (u8, u8, Vec<Option<u8>>)> {
    let count = 1usize << (axes * depth);
    let cell = prop_oneof![Just(None), Just(Some(255u8)), Just(Some(7)), Just(Some(7))];
    (Just(axes), Just(depth), proptest::collection::vec(cell, count))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, rng_seed: proptest::test_runner::RngSeed::Fixed(13), failure_persistence: None, ..ProptestConfig::default() })]

    /// Both kinds keep the cells of their source, also through a text round trip, and are
    /// reproduced from it.
    #[test]
    fn bintrees_keep_all_cells((axes, depth, cells) in prop_oneof![cells(2, 3), cells(3, 2), cells(2, 1), cells(2, 0)]) {
        let tree = byte_tree(axes, depth, &cells);
        let extent = Bounds::space(tree.form().dimension, depth).max;
        let alternating = Bintree::alternating(&tree, extent, usize::MAX).unwrap();
        let adaptive = Bintree::adaptive(&tree, extent).unwrap();
        let expected: Vec<_> = cells.iter().map(|cell| cell.map(|number| Value::from([number]))).collect();
        for made in [&alternating, &adaptive] {
            prop_assert_eq!(&cells_of(made), &expected);
            prop_assert_eq!(&Bintree::from_text(&made.to_text(), made.nodes().len()).unwrap(), made);
            let back = MemTree::from_source(made, Rule::Nearest).unwrap();
            let text = |tree: &MemTree| spinney_engine::tree::df::to_text(tree, None).unwrap();
            prop_assert_eq!(text(&back), text(&tree));
            prop_assert_eq!(Bintree::alternating(made, extent, usize::MAX).unwrap(), alternating.clone());
        }
        prop_assert!(adaptive.nodes().len() <= alternating.nodes().len());
        if cells.len() <= 16 {
            prop_assert_eq!(adaptive.nodes().len(), fewest(&tree, Bounds::space(tree.form().dimension, depth)));
        }
    }

    /// No input causes a panic, and accepted input is written in the same words.
    #[test]
    fn arbitrary_strings_are_parsed_or_rejected(head in "bintree:(alternating|adaptive):xyz?:[0-3]:(u8|[uif][0-9]{1,2}(x[0-9]{1,3})?([+](alpha|missing=-?[0-9]{1,3}))?):[1-8]x[1-8](x[1-8])?", symbols in "[GMXYZWVBF0-9() ]{0,24}|\\PC{0,8}") {
        if let Ok(tree) = Bintree::from_text(&format!("{head} {symbols}"), 20) {
            prop_assert_eq!(Bintree::from_text(&tree.to_text(), 20).unwrap(), tree);
        }
    }
}

/// Includes spaces where the best axis is not the first; compared with an exhaustive search.
#[test]
fn adaptive_bintrees_have_the_minimum_node_count() {
    let mut state = 45u64;
    for (axes, depth) in [(2, 2), (3, 1), (2, 2), (2, 2), (3, 1)].into_iter().cycle().take(50) {
        let cells: Vec<_> = (0..1 << (axes * depth))
            .map(|_| {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 62 > 0).then_some((state >> 40) as u8 & 1)
            })
            .collect();
        let tree = byte_tree(axes, depth, &cells);
        let space = Bounds::space(tree.form().dimension, depth);
        assert_eq!(Bintree::adaptive(&tree, space.max).unwrap().nodes().len(), fewest(&tree, space));
    }
}

/// A few nodes can be a line of any length, which takes a huge number of squares.
#[test]
fn long_thin_blocks_are_rejected_before_they_are_built() {
    let line = |axes: &str, depth: usize, sides: &str| {
        format!("bintree:adaptive:{axes}:{depth}:u8:{sides} {}1{}", "Y".repeat(depth), "W".repeat(depth))
    };
    let error = Bintree::from_text(&line("xy", 29, "536870912x1"), 1000).unwrap_err().to_string();
    assert!(error.contains("59 nodes with long thin blocks, which are 1610612734 squares"), "{error}");
    assert!(error.contains("at most 1048576"), "{error}");
    let error = Bintree::from_text(&line("xyz", 19, "524288x1x524288"), 1000).unwrap_err().to_string();
    assert!(error.contains("cubes of an octree"), "{error}");
    // Accepted: as few squares as the smallest permitted limit allows.
    let short = Bintree::from_text(&line("xy", 18, "262144x1"), 1000).unwrap();
    assert_eq!(short.nodes().len(), 37);
    // With alternating axes, blocks are one square or two.
    let deep =
        format!("bintree:alternating:xy:29:u8:536870912x536870912 {}1{}", "G".repeat(58), "W".repeat(58));
    assert_eq!(Bintree::from_text(&deep, 1000).unwrap().nodes().len(), 117);
}

#[test]
fn values_of_all_types_survive_formatting() {
    let u8s = ValueType::new(SampleType::U8, 4);
    let f32s = ValueType::new(SampleType::F32, 2);
    let single = |sample| ValueType::new(sample, 1);
    let cases = [
        (u8s, Value::from([1u8, 2, 3, 0])),
        (u8s.with_alpha(), Value::from([255u8, 255, 255, 255])),
        (f32s, Value::from([0.1f32, f32::NAN])),
        (f32s.with_missing(-9999), Value::from([-9999f32, f32::INFINITY])),
        (single(SampleType::F64), Value::from([-0.0f64])),
        (single(SampleType::I64), Value::from([i64::MIN])),
        (single(SampleType::U64), Value::from([u64::MAX])),
        (single(SampleType::I8), Value::from([-1i8])),
    ];
    for (value, number) in cases {
        let cell = |[x, y, _]: [u32; 3]| (x == 0 && y < 2).then_some(number);
        let tree = MemTree::from_cells(form(2, value), 2, Rule::Nearest, &cell);
        let made = Bintree::adaptive(&tree, [1, 2, 1]).unwrap();
        let text = made.to_text();
        let read = Bintree::from_text(&text, 100).unwrap();
        assert_eq!((read.form(), read.nodes()), (made.form(), made.nodes()), "{text}");
    }
}

#[test]
fn parse_errors_have_position_and_expectation() {
    let head = "bintree:adaptive:xy:2:u8:3x4 ";
    let cases = [
        ("", "byte 0: got its end, expected `bintree:alternating"),
        ("bintree:adaptive:xz:2:u8:3x4 W", "byte 17: got `xz:2:u8:3x4 W`"),
        ("bintree:adaptive:xy:30:u8:3x4 W", "byte 20: got `30:u8:3x4 W`"),
        ("bintree:adaptive:xy:2:u7:3x4 W", "byte 22"),
        ("bintree:adaptive:xy:2:u8+alpha:3x4 W", "byte 22"),
        ("bintree:adaptive:xy:2:f32x255+missing=-1:3x4 W", "byte 22"),
        ("bintree:adaptive:xy:2:u8:3x5 W", "byte 25"),
        ("bintree:adaptive:xy:2:u8:3x4x1 W", "byte 25"),
        ("XB", "byte 31: got its end, expected both halves"),
        ("G11", "byte 29: got `G11`, expected one of X Y Z"),
        ("Z11", "byte 29: got `Z11`, expected a leaf, or another axis"),
        ("XXXWWWW", "byte 31: got `XWWWW`, expected a leaf, or another axis"),
        ("W W", "byte 31: got `W`, expected the end of the line"),
        ("1", "byte 29: got `1`, expected W or V: the block reaches beyond"),
        ("XX[256]WW", "byte 31: got `[256]WW`, expected a value of type u8"),
        ("XX[1", "byte 31: got `[1`, expected a closing bracket"),
        ("XXéWW", "byte 31: got `éWW`, expected one of"),
    ];
    for (text, expected) in cases {
        let text = if text.starts_with("bintree") || text.is_empty() {
            text.to_string()
        } else {
            format!("{head}{text}")
        };
        let error = Bintree::from_text(&text, 100).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
    let error = Bintree::from_text(&format!("{head}XWXWW"), 4).unwrap_err().to_string();
    assert!(error.contains("more than 4 nodes"), "{error}");
    let large = MemTree::from_cells(form(2, ValueType::new(SampleType::U8, 1)), 0, Rule::Nearest, &|_| None);
    assert!(Bintree::alternating(&large, [1; 3], 0).is_err());
}
