//! Every worked example of the literature on these quadtrees and octrees, with corrected values
//! where the print has errors.
//!
//! "The survey" is P. Slavik's survey of hierarchical data structures (in Czech); "the 1991 papers"
//! are those of Trstenjak, Zalik and Guid on octrees from boundary models (in Slovene).

use spinney::Dimension::{Oct, Quad};
use spinney::raw::store::goblin::Goblin;
use spinney::raw::store::records::INNER;
use spinney::raw::store::{build_tree, depth_for};
use spinney::raw::tree::df;
use spinney::tree::{Child, MemTree, Source};
use spinney::{BuildOptions, Code, DataKind, Output, Rule, Value};

use crate::common::{CLASSIC, Cells, OCT, QUAD, as_byte, byte, children, goblin};

const PREORDER: &str = "GG1G13331G3312GG31331G3222G11221G221G1211";

fn classic_tree() -> MemTree {
    let cell = |[x, y, _]: [u32; 3]| Some(byte(CLASSIC[y as usize][x as usize]));
    MemTree::from_cells(QUAD, 3, Rule::Dominant, &cell)
}

fn classic_file() -> Goblin {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("classic.goblin");
    let options = BuildOptions::new(DataKind::Categorical, 3).rule(Rule::Dominant).memory(1 << 20);
    build_tree(&classic_tree(), [8, 8, 1], &options, Output::create(&path).unwrap(), &()).unwrap();
    Goblin::from_bytes(std::fs::read(&path).unwrap()).unwrap()
}

/// Returns all nodes in preorder, with their codes.
fn nodes(tree: &MemTree) -> Vec<(Code, Child<usize>)> {
    let mut pending = vec![(Code::root(tree.form().dimension), tree.root().unwrap())];
    let mut nodes = Vec::new();
    while let Some((code, subtree)) = pending.pop() {
        nodes.push((code, subtree));
        if let Child::Inner { node, .. } = subtree {
            let children = children(tree, &node).into_iter().enumerate().rev();
            pending.extend(children.map(|(i, child)| (code.child(i), child)));
        }
    }
    nodes
}

fn leaves(tree: &MemTree) -> usize {
    nodes(tree).iter().filter(|(_, subtree)| !subtree.is_inner()).count()
}

/// Nodes have four children or none; uniform nodes and single cells are not subdivided, all others
/// are.
#[test]
fn item_1_nodes_have_four_children_or_none() {
    for seed in 0..20 {
        let cells = Cells::random(QUAD, seed, [1 + 13 * seed, 200 - 9 * seed, 1], 4, true);
        let tree = cells.tree(Rule::Mean);
        for (code, subtree) in nodes(&tree) {
            let bounds = code.bounds(tree.depth());
            let [columns, mut rows] = [0, 1].map(|axis| bounds.min[axis]..bounds.max[axis]);
            let first = cells.get(bounds.min);
            let is_uniform = rows.all(|y| columns.clone().all(|x| cells.get([x, y, 0]) == first));
            match subtree {
                Child::Inner { node, .. } => {
                    assert!(!is_uniform && code.level() < tree.depth());
                    assert_eq!(children(&tree, &node).len(), 4);
                }
                leaf => assert!(is_uniform && leaf.value() == first),
            }
        }
    }
}

#[test]
fn item_2_children_in_z_order() {
    let [nw, ne, sw, se] = [0, 1, 2, 3].map(|child| Code::root(Quad).child(child).cell());
    assert_eq!([nw, ne, sw, se], [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]);
}

/// The weighted sum of the digits, numbered from the right from 0.
#[test]
fn item_6_codes_are_sums_of_digits() {
    for (digits, expected) in [(vec![1, 0, 2, 3], 75), (vec![3, 3, 3], 63), (vec![0; 5], 0), (vec![2, 1], 9)]
    {
        let code = Code::from_digits(Quad, digits.clone()).unwrap();
        let sum: u64 = (0..).zip(digits.iter().rev()).map(|(i, digit)| *digit as u64 * 4u64.pow(i)).sum();
        assert_eq!((code.path(), sum), (expected, expected));
        assert!(code.path() < 4u64.pow(digits.len() as u32));
    }
}

/// Leaf codes without the background's reproduce the image.
#[test]
fn item_5_codes_of_leaves_without_the_background() {
    let tree = df::from_text(QUAD, DF, 3, byte(1), Rule::Dominant).unwrap();
    let black: Vec<Code> = nodes(&tree)
        .into_iter()
        .filter(|(_, subtree)| *subtree == Child::Leaf(byte(1)))
        .map(|(code, _)| code)
        .collect();
    assert_eq!(black.len(), DF.matches('B').count());
    let is_black = |cell| {
        let code = Code::from_cell(Quad, 3, cell).unwrap();
        black.iter().any(|leaf| leaf.contains(code)).then(|| byte(1))
    };
    let again = MemTree::from_cells(QUAD, 3, Rule::Dominant, &is_black);
    assert_eq!(df::to_text(&again, Some(byte(1))).unwrap(), DF);
}

/// Four equal siblings are merged, level by level: as many nodes remain as in the builder's file.
#[test]
fn item_15_equal_neighbours_are_merged() {
    for seed in 0..12 {
        let cells = Cells::random(QUAD, seed, [256, 256, 1], 3, true);
        let mut blocks: Vec<Option<Option<Value>>> = cells.cells.iter().copied().map(Some).collect();
        let (mut side, mut inner) = (256, 0);
        while side > 1 {
            side /= 2;
            blocks = (0..side * side)
                .map(|at| {
                    let first = at / side * 4 * side + at % side * 2;
                    let four = [0, 1, 2 * side, 2 * side + 1].map(|offset| blocks[first + offset]);
                    four[0].filter(|_| four.iter().all(|block| *block == four[0]))
                })
                .collect();
            inner += blocks.iter().filter(|block| block.is_none()).count();
        }
        let file = goblin(&cells, Rule::Majority, DataKind::Categorical);
        assert_eq!(
            file.metadata().counts.levels().iter().map(|[_, _, inner]| *inner).sum::<u64>(),
            inner as u64
        );
    }
}

#[test]
fn item_7_base_4_codes() {
    let code = Code::from_digits(Quad, [1, 0, 2, 3]).unwrap();
    assert_eq!(code.path(), 75);
    assert_eq!(Code::from_path(Quad, 4, 75), Some(code));
    // The number alone does not determine the level.
    let deeper = Code::from_digits(Quad, [0, 0, 0, 1, 0, 2, 3]).unwrap();
    assert_eq!(deeper.path(), 75);
    assert_ne!(deeper, code);
    assert_eq!(Code::from_path(Quad, 7, 75), Some(deeper));
    assert_eq!(Code::from_path(Quad, 3, 75), None);
}

#[test]
fn item_8_base_5_codes() {
    // Digits are one more than in base 4: <2,1,3,4> is the node <1,0,2,3>.
    let code = Code::from_digits(Quad, [1, 0, 2, 3]).unwrap();
    assert_eq!(code.self_delimiting(), 294);
    assert_eq!(Code::from_self_delimiting(Quad, 294), Some(code));
    let deeper = Code::from_digits(Quad, [0, 0, 0, 1, 0, 2, 3]).unwrap();
    assert_eq!(deeper.self_delimiting(), 19669);
    assert_eq!(Code::from_self_delimiting(Quad, 19669), Some(deeper));
    assert_eq!((code.level(), deeper.level()), (4, 7));
    // The print says 5^(k-1) <= C < 5^k; the tight bounds for k digits are (5^k - 1) / 4 and 5^k -
    // 1.
    for k in 0..=29u8 {
        let all = |digit| Code::from_digits(Quad, vec![digit; k as usize]).unwrap().self_delimiting();
        assert_eq!(all(0), (5u128.pow(k as u32) - 1) / 4);
        assert_eq!(all(3), 5u128.pow(k as u32) - 1);
    }
}

/// The standard example. The print lacks three of its letters; the remaining 22 symbols are no tree
/// of depth 3. All codes of the next figure are leaves of this one.
const DF: &str = "GWGWWBBGWGWBBBWBGBBGBBBWW";

#[test]
fn item_4_df_expression() {
    let tree = df::from_text(QUAD, DF, 3, byte(1), Rule::Dominant).unwrap();
    assert_eq!(df::to_text(&tree, Some(byte(1))).unwrap(), DF);
    assert_eq!(DF.len(), 25);
    assert_eq!(DF.matches('G').count(), 6);
    assert_eq!(tree.inner_nodes(), 6);
    assert_eq!(leaves(&tree), 19);
    let packed = df::to_packed(&tree).unwrap();
    assert_eq!((packed.symbols, packed.bits.len()), (25, 7));
    // Two bits a symbol, the first in the lowest bits: the number of its state.
    let symbols = (0..25).map(|i| ['W', 'B', 'G'][usize::from(packed.bits[i / 4] >> (i % 4 * 2) & 3)]);
    assert_eq!(symbols.collect::<String>(), DF);
    assert_eq!(packed.values, [byte(1); 11]);
}

#[test]
fn item_4_df_expression_as_printed_is_no_tree() {
    let printed = "GWGWBBGWGWBBBWBGBBBBWW";
    assert_eq!((printed.len(), printed.matches('G').count()), (22, 5));
    for depth in 3..=29 {
        let error = df::from_text(QUAD, printed, depth, byte(1), Rule::Dominant).unwrap_err();
        assert!(error.to_string().contains("DF-expression"), "{error}");
    }
    // The printed string is the right one without a W, a G and a B.
    let mut left_out = String::new();
    let mut rest = printed.chars().peekable();
    for symbol in DF.chars() {
        if rest.next_if_eq(&symbol).is_none() {
            left_out.push(symbol);
        }
    }
    assert_eq!((rest.next(), left_out.len()), (None, 3));
}

#[test]
fn item_9_fd_codes() {
    let printed = "000 100 110 120 130 200 210 211 212 213 220 230 310 320 330";
    let missing = ["300", "321", "322", "323"];
    let tree = df::from_text(QUAD, DF, 3, byte(1), Rule::Dominant).unwrap();
    let leaves: Vec<_> = nodes(&tree).into_iter().filter(|(_, subtree)| !subtree.is_inner()).collect();
    assert!(leaves.iter().map(|(code, _)| code.bits()).is_sorted());
    let keys: Vec<String> = leaves.iter().map(|(code, _)| format!("{:0<3}", code.quadkey())).collect();
    assert!(keys.is_sorted());
    let shown: Vec<&str> = keys.iter().map(String::as_str).filter(|text| !missing.contains(text)).collect();
    assert_eq!(shown.join(" "), printed);
    assert_eq!(keys.len(), 19);
}

#[test]
fn item_30_representative() {
    // Leaves A and B, inner nodes with representatives B and C: A has 3, B has 3 + 2, C has 2.
    let [a, b, c] = [10, 20, 30].map(Some);
    let (found, children) =
        representative("G [10] [20] G([20] [20] [10] [20]) G([30] W W W)", Rule::Dominant);
    assert_eq!((found, children), (20, vec![(a, false), (b, false), (b, true), (c, true)]));
    // Values on a linear scale are averaged: true means of the cells, 16 of which are the root's.
    assert_eq!(representative("G [10] [20] G([20] [20] [10] [20]) [40]", Rule::Mean).0, 22);
}

/// The paper does not define ties: record 8 of the table needs the first (or lowest) of 1, 1, 2, 2.
#[test]
fn item_31_ties() {
    assert_eq!(representative("G 1122", Rule::Dominant).0, 1);
    assert_eq!(representative("G 2211", Rule::Dominant).0, 2);
}

/// Returns the representative of the root of an expression, and its children.
fn representative(text: &str, rule: Rule) -> (u8, Vec<(Option<u8>, bool)>) {
    let tree = df::from_text(QUAD, text, 2, byte(1), rule).unwrap();
    let Child::Inner { representative, node } = tree.root().unwrap() else { panic!("{text} is one leaf") };
    let children = children(&tree, &node);
    let kinds = children.iter().map(|child| (child.value().map(as_byte), child.is_inner()));
    (as_byte(representative), kinds.collect())
}

#[test]
fn item_3_raster_of_the_tables() {
    let tree = classic_tree();
    assert_eq!(df::to_text(&tree, None).unwrap(), PREORDER);
    assert_eq!((tree.inner_nodes(), leaves(&tree)), (10, 31));
    assert_eq!(tree.root().unwrap().value(), Some(byte(1)));
    let again = df::from_text(QUAD, PREORDER, 3, byte(1), Rule::Dominant).unwrap();
    for y in 0..8 {
        for x in 0..8 {
            let code = Code::from_cell(Quad, 3, [x, y, 0]).unwrap();
            assert_eq!(again.value_at(code), Some(byte(CLASSIC[y as usize][x as usize])));
        }
    }
}

/// Fields NW NE SW SE (an inner node's representative is negative) and the link. The print has 7 as
/// the link of record 3; the other nine are right.
const GOBLIN: [[i32; 5]; 10] = [
    [-1, -1, 1, -2, 11],
    [1, -3, 1, -3, 5],
    [1, 3, 3, 3, 4],
    [3, 3, 1, 2, 5],
    [-3, 1, -2, -1, 9],
    [3, 1, 3, 3, 7],
    [3, 2, 2, 2, 8],
    [1, 1, 2, 2, 9],
    [2, 2, 1, -1, 11],
    [1, 2, 1, 1, 11],
];

#[test]
fn item_29_goblin_table_from_the_tree() {
    let tree = classic_tree();
    let nodes = nodes(&tree);
    let inner: Vec<_> = nodes.iter().filter(|(_, subtree)| subtree.is_inner()).collect();
    for (number, (code, subtree)) in inner.iter().enumerate() {
        let Child::Inner { node, .. } = subtree else { unreachable!() };
        let mut fields: Vec<i32> = Vec::new();
        for child in children(&tree, node) {
            let value = as_byte(child.value().unwrap());
            fields.push(if child.is_inner() { -(value as i32) } else { value as i32 });
        }
        // The record to continue with is the next one that is not below this node.
        let skip = inner[number..].iter().take_while(|(other, _)| code.contains(*other)).count();
        fields.push((number + 1 + skip) as i32);
        assert_eq!(fields, GOBLIN[number], "record {}", number + 1);
    }
    assert_eq!(inner.len(), 10);
}

#[test]
fn item_28_goblin_table_from_the_file() {
    let file = classic_file();
    assert_eq!((file.segments(), file.stored_records()), (1, 10));
    assert_eq!(file.root_child().value(), Some(byte(1))); // minus the identification value -1
    let (segment, layout) = (file.segment(0).unwrap(), file.layout());
    assert_eq!(layout.count(segment.records()), GOBLIN.len());
    for (i, expected) in GOBLIN.iter().enumerate() {
        let head = layout.head(segment.records(), i).unwrap();
        let value = |child| as_byte(layout.value(segment.records(), i, child)) as i32;
        let inner = |child| head.state(child) == INNER;
        let mut fields: Vec<i32> = (0..4).map(|c| if inner(c) { -value(c) } else { value(c) }).collect();
        // The classic link is the record's own number plus its subtree's record count.
        fields.push((i + 1) as i32 + head.skip as i32);
        assert_eq!(fields, expected, "record {}", i + 1);
    }
}

/// Fields NW NE SW SE (a leaf's value is negative, an inner node's record number positive) and the
/// node's own representative.
const AUTUMNAL: [[i32; 5]; 10] = [
    [2, 5, -1, 9, 1],
    [-1, 3, -1, 4, 1],
    [-1, -3, -3, -3, 3],
    [-3, -3, -1, -2, 3],
    [6, -1, 7, 8, 1],
    [-3, -1, -3, -3, 3],
    [-3, -2, -2, -2, 2],
    [-1, -1, -2, -2, 1],
    [-2, -2, -1, 10, 2],
    [-1, -2, -1, -1, 1],
];

#[test]
fn item_32_autumnal_table_from_the_tree() {
    let tree = classic_tree();
    let nodes = nodes(&tree);
    let inner: Vec<_> = nodes.iter().filter(|(_, subtree)| subtree.is_inner()).collect();
    let number = |code: Code| inner.iter().position(|(other, _)| *other == code).unwrap() as i32 + 1;
    for (i, (code, subtree)) in inner.iter().enumerate() {
        let Child::Inner { representative, node } = subtree else { unreachable!() };
        let mut fields: Vec<i32> = Vec::new();
        for (c, child) in children(&tree, node).iter().enumerate() {
            let leaf = as_byte(child.value().unwrap()) as i32;
            fields.push(if child.is_inner() { number(code.child(c)) } else { -leaf });
        }
        fields.push(as_byte(*representative) as i32);
        assert_eq!(fields, AUTUMNAL[i], "record {}", i + 1);
    }
}

/// The survey's claim: a Goblin record holds its children's values, so showing the image at a level
/// needs only the records above that level, while Autumnal records hold their own.
#[test]
fn item_33_reads_to_show_a_level() {
    let file = classic_file();
    let inner: Vec<u64> = file.metadata().counts.levels().iter().map(|[_, _, inner]| *inner).collect();
    assert_eq!(inner, [1, 3, 6, 0]);
    let goblin = |level: usize| inner[..level].iter().sum::<u64>();
    let autumnal = |level: usize| inner[..=level].iter().sum::<u64>();
    assert_eq!([1, 2, 3].map(goblin), [1, 4, 10]);
    assert_eq!([1, 2, 3].map(autumnal), [4, 10, 10]);
}

/// Contrary to the survey's conclusion, the classic Goblin needs more reads for single cells,
/// because the links of a node's earlier children have to be followed to find a later one's record.
#[test]
fn item_35_reads_to_find_a_cell() {
    let (mut goblin, mut autumnal) = (Vec::new(), Vec::new());
    for y in 0..8 {
        for x in 0..8 {
            let code = Code::from_cell(Quad, 3, [x, y, 0]).unwrap();
            let (mut record, mut reads, mut depth) = (1, 1, 1);
            for step in code.digits() {
                let fields = GOBLIN[record - 1];
                if fields[step] > 0 {
                    assert_eq!(fields[step], CLASSIC[y as usize][x as usize] as i32);
                    break;
                }
                record += 1;
                reads += 1;
                depth += 1;
                for _ in fields[..step].iter().filter(|field| **field < 0) {
                    record = GOBLIN[record - 1][4] as usize;
                    reads += 1;
                }
            }
            goblin.push(reads);
            autumnal.push(depth);
        }
    }
    let sum_and_most = |reads: &[i32]| (reads.iter().sum::<i32>(), reads.iter().copied().max().unwrap());
    assert_eq!(sum_and_most(&goblin), (200, 6)); // mean of 64: 3.125
    assert_eq!(sum_and_most(&autumnal), (136, 3)); // mean: 2.125
}

#[test]
fn item_41_octree_df_expression() {
    let text = "MVVVVFMVVVVVVVFFF";
    let tree = df::from_text(OCT, text, 2, byte(255), Rule::Mean).unwrap();
    assert_eq!(df::to_text(&tree, Some(byte(255))).unwrap(), text);
    // With correct brackets; the print closes the root too early.
    let brackets = "M(VVVVFM(VVVVVVVF)FF)";
    let same = df::from_text(OCT, brackets, 2, byte(255), Rule::Mean).unwrap();
    assert_eq!(df::to_text(&same, Some(byte(255))).unwrap(), text);
    let packed = df::to_packed(&tree).unwrap();
    assert_eq!((packed.symbols, 2 * packed.symbols), (17, 34));
    // Full volume: 25 of the 64 cells.
    let full: u64 = nodes(&tree)
        .iter()
        .filter(|(_, subtree)| *subtree == Child::Leaf(byte(255)))
        .map(|(code, _)| 1 << (3 * (2 - code.level())))
        .sum();
    assert_eq!(full, 25);
    assert_eq!(packed.bits.len(), 5);
}

/// The survey rotates quadtrees by 90 degrees counter-clockwise with NW->SW, NE->NW, SE->NE,
/// SW->SE.
#[test]
fn item_22_rotation_of_quadtrees() {
    let [nw, ne, sw, se] = [0, 1, 2, 3];
    for (from, to) in [(nw, sw), (ne, nw), (se, ne), (sw, se)] {
        let [x, y, _] = Code::root(Quad).child(from).cell();
        assert_eq!(Code::from_cell(Quad, 1, [y, 1 - x, 0]), Some(Code::root(Quad).child(to)));
    }
}

/// The 1991 numbering has x in the highest bit: its numbers are those of Spinney with the bits
/// reversed.
#[test]
fn item_39_rotation_of_octrees() {
    let reversed = |octant: usize| (octant & 1) << 2 | octant & 2 | octant >> 2;
    let pi = [1, 3, 0, 2, 5, 7, 4, 6];
    for octant in 0..8 {
        let [x, y, z] = Code::root(Oct).child(octant).cell();
        assert_eq!(reversed(octant), (4 * x + 2 * y + z) as usize);
        // About an axis parallel to x: (y, z) becomes (z, 1 - y).
        let turned = Code::from_cell(Oct, 1, [x, z, 1 - y]).unwrap();
        assert_eq!(turned.step(0), reversed(pi[reversed(octant)]));
        // The exercises: about y and about z.
        let about_y = [4, 0, 6, 2, 5, 1, 7, 3];
        let turned = Code::from_cell(Oct, 1, [1 - z, y, x]).unwrap();
        assert_eq!(turned.step(0), reversed(about_y[reversed(octant)]));
        let about_z = [2, 3, 6, 7, 0, 1, 4, 5];
        let turned = Code::from_cell(Oct, 1, [y, 1 - x, z]).unwrap();
        assert_eq!(turned.step(0), reversed(about_z[reversed(octant)]));
    }
    // Slice z = 0 of an octree is a quadtree.
    for child in 0..4 {
        assert_eq!(Code::root(Oct).child(child).cell(), Code::root(Quad).child(child).cell());
    }
}

#[test]
fn item_26_display_needs_no_deeper_tree_than_its_pixels() {
    // A display of 512 x 512 never needs more than nine levels.
    assert_eq!(depth_for([512, 512, 1]), 9);
}
