//! Operations on quadtrees and octrees as the survey describes them, node by node, compared with
//! Spinney's views and sources. `tests/operations/` tests all their cases against cell arrays.

use spinney::raw::ops::View;
use spinney::raw::tree::df;
use spinney::tree::{Child, Children, MemTree, Source};
use spinney::{Bounds, Code, CombineOperation, Dimension, Rule, TreeType};

use crate::common::{
    Cells, OCT, QUAD, Random, as_byte, assert_same, byte, cells_of, combined, made, quad_size, set_operation,
    view_of, view_of_cells,
};

/// Returns a tree of one value as text: grey or MIXED, white or VOID, black or FULL.
fn text(tree: &MemTree) -> String {
    df::to_text(tree, Some(byte(1))).unwrap()
}

fn text_of(view: &View) -> String {
    text(&MemTree::from_source(view, Rule::Nearest).unwrap())
}

/// Keeps cells that have the minimum value, and makes the others VOID.
fn black(cells: &Cells) -> Cells {
    made(cells.form, cells.size, |cell| cells.get(cell).filter(|value| as_byte(*value) == 0).map(|_| byte(1)))
}

/// Returns a node of the translated tree, by the black source nodes that overlap it: black if one
/// contains it, white if none does, otherwise split; equal children are merged.
fn translated(target: Bounds, sources: &[Bounds]) -> String {
    let covers = |source: &&Bounds| {
        (0..2).all(|axis| source.min[axis] < target.max[axis] && target.min[axis] < source.max[axis])
    };
    let sources: Vec<Bounds> = sources.iter().filter(covers).copied().collect();
    let contains = |source: &Bounds| {
        (0..2).all(|axis| source.min[axis] <= target.min[axis] && target.max[axis] <= source.max[axis])
    };
    if sources.is_empty() {
        return "W".into();
    }
    if sources.iter().any(contains) {
        return "B".into();
    }
    let half = (target.max[0] - target.min[0]) / 2;
    let children = (0..4u64).map(|child| {
        let min = [target.min[0] + half * (child & 1), target.min[1] + half * (child >> 1), 0];
        translated(Bounds { min, max: [min[0] + half, min[1] + half, 1] }, &sources)
    });
    merged('G', &children.collect::<Vec<_>>())
}

/// Returns a node of children, or a leaf if all are equal leaves.
fn merged(inner: char, children: &[String]) -> String {
    match children[0].len() == 1 && children.iter().all(|child| *child == children[0]) {
        true => children[0].clone(),
        false => format!("{inner}{}", children.concat()),
    }
}

#[test]
fn item_20_translation_by_lists_of_source_nodes() {
    let mut random = Random(20);
    for seed in 0..40 {
        let size = quad_size(&mut random);
        let tree = black(&Cells::random(QUAD, seed, size, 2, true)).tree(Rule::Mean);
        let by = [random.below(20), random.below(20)];
        let mut sources = Vec::new();
        let mut pending = vec![(Code::root(Dimension::Quad), tree.root().unwrap())];
        while let Some((code, node)) = pending.pop() {
            match node {
                Child::Void => {}
                Child::Leaf(_) => {
                    let mut block = code.bounds(tree.depth());
                    for (axis, by) in by.iter().enumerate() {
                        (block.min[axis], block.max[axis]) = (block.min[axis] + by, block.max[axis] + by);
                    }
                    sources.push(block);
                }
                Child::Inner { node, .. } => {
                    let children = crate::common::children(&tree, &node).into_iter().enumerate();
                    pending.extend(children.map(|(i, child)| (code.child(i), child)));
                }
            }
        }
        let moved = view_of(&tree, size).translate([by[0] as f64, by[1] as f64, 0.0]).unwrap();
        let side = 1 << moved.depth();
        let expected = translated(Bounds { min: [0; 3], max: [side, side, 1] }, &sources);
        assert_eq!(text_of(&moved), expected, "seed {seed}, by {by:?}");
    }
}

/// Scaled by two, a quadrant (or octant) becomes the tree. In a space twice as large, the tree
/// becomes its first child, and the others are VOID; translated by half of that space, it becomes
/// another child.
fn scaled_by_two(form: TreeType, size: u64) {
    let flat = |at: u64, beyond: u64| [at, at, if form.axes() == 3 { at } else { beyond }];
    let (grey, white) = if form.axes() == 3 { ('M', "V") } else { ('G', "W") };
    let cells = black(&Cells::noise(form, 21, flat(size, 1), 2));
    let whole = view_of_cells(&cells);
    let [tree, half] =
        [text_of(&whole), text(&made(form, flat(size / 2, 1), |cell| cells.get(cell)).tree(Rule::Mean))];
    assert!(tree.starts_with(&format!("{grey}{half}")) && half.len() > 9, "{tree}");
    let enlarged = whole.clone().window([0; 3], flat(size / 2, 1)).unwrap();
    let enlarged = enlarged.scale(flat(2, 1).map(|by| by as f64)).unwrap();
    assert_eq!((text_of(&enlarged), enlarged.depth()), (half, whole.depth()));
    let others = white.repeat(form.children() - 1);
    let shrunk = whole.clone().window([0; 3], flat(2 * size, 1)).unwrap();
    assert_eq!(text_of(&shrunk), format!("{grey}{tree}{others}"));
    let moved = whole.translate([size as f64, 0.0, 0.0]).unwrap();
    assert_eq!(text_of(&moved), format!("{grey}{white}{tree}{}", &others[1..]));
}

#[test]
fn item_21_scaling_by_two_takes_trees_for_subtrees() {
    scaled_by_two(QUAD, 64);
}

#[test]
fn item_40_scaling_by_two_takes_octrees_for_subtrees() {
    scaled_by_two(OCT, 16);
}

/// Trees with aligned cells but unaligned nodes: the paper has no algorithm for them.
#[test]
fn item_25_trees_that_are_not_aligned() {
    let size = [53, 47, 1];
    let cells = [1, 2].map(|seed| black(&Cells::random(QUAD, seed, size, 2, true)));
    for number in 0..16 {
        let aligned = view_of_cells(&cells[0]);
        let moved =
            view_of_cells(&cells[1]).translate([5.0, 3.0, 0.0]).unwrap().window([0; 3], size).unwrap();
        let operation = CombineOperation::set(set_operation(number));
        let found = combined(vec![aligned, moved], operation, size).filled_with(byte(1)).unwrap();
        let expected = made(QUAD, size, |cell| {
            let other = cells[1].at([cell[0] as i64 - 5, cell[1] as i64 - 3, 0]);
            let set = match (cells[0].get(cell), other) {
                (Some(_), Some(_)) => 0,
                (Some(_), None) => 1,
                (None, Some(_)) => 2,
                (None, None) => 3,
            };
            (number >> set & 1 == 1).then(|| byte(1))
        });
        assert_same(&cells_of(&found, size), &expected, &format!("operation {number}"));
    }
}

/// Classifies a block as inside a ball, outside, or neither, in units of half a cell.
struct Ball {
    middle: [i64; 3],
    radius: i64,
}

impl Ball {
    fn classify(&self, min: [i64; 3], side: i64) -> Child<()> {
        let [mut near, mut far] = [0; 2];
        for (middle, min) in self.middle.into_iter().zip(min) {
            let (before, after) = (min - middle, min + side - middle);
            near += before.max(-after).max(0).pow(2);
            far += before.abs().max(after.abs()).pow(2);
        }
        match self.radius.pow(2) {
            square if far <= square => Child::Leaf(byte(1)),
            square if near >= square => Child::Void,
            _ => Child::Inner { representative: byte(1), node: () },
        }
    }

    /// The survey's `maketree`, and condensation. Corrects a misprint: `code` must be MIXED for a
    /// subdivided node.
    fn maketree(&self, min: [i64; 3], side: i64, depth: u8) -> String {
        match self.classify(min, side) {
            Child::Void => "V".into(),
            Child::Inner { .. } if depth > 0 => {
                let octant = |octant: i64| {
                    let min = [0, 1, 2].map(|axis| min[axis] + (octant >> axis & 1) * side / 2);
                    self.maketree(min, side / 2, depth - 1)
                };
                merged('M', &(0..8).map(octant).collect::<Vec<_>>())
            }
            _ => "F".into(),
        }
    }
}

/// A ball as a source that is traversed from the root.
struct BallSource(Ball, u8);

impl BallSource {
    fn node(&self, min: [i64; 3], side: i64) -> Child<([i64; 3], i64)> {
        match self.0.classify(min, side) {
            Child::Inner { representative, .. } if side > 2 => {
                Child::Inner { representative, node: (min, side) }
            }
            Child::Void => Child::Void,
            _ => Child::Leaf(byte(1)),
        }
    }
}

impl Source for BallSource {
    type Node = ([i64; 3], i64);

    fn form(&self) -> TreeType {
        OCT
    }

    fn depth(&self) -> u8 {
        self.1
    }

    fn root(&self) -> spinney::Result<Child<Self::Node>> {
        Ok(self.node([0; 3], 2 << self.1))
    }

    fn children(&self, (min, side): &Self::Node, children: &mut Children<Self::Node>) -> spinney::Result<()> {
        for (octant, child) in (0..).zip(children) {
            *child = self.node([0, 1, 2].map(|axis| min[axis] + (octant >> axis & 1) * side / 2), side / 2);
        }
        Ok(())
    }
}

#[test]
fn item_36_37_maketree_classifies_and_subdivides() {
    for (depth, middle, radius) in
        [(3, [8, 8, 8], 7), (4, [13, 17, 11], 9), (4, [16, 16, 16], 40), (2, [1, 2, 3], 4)]
    {
        let ball = Ball { middle, radius };
        let expected = ball.maketree([0; 3], 2 << depth, depth);
        let tree = MemTree::from_source(&BallSource(ball, depth), Rule::Mean).unwrap();
        assert_eq!(text(&tree), expected, "{middle:?}, {radius}");
        // Each node is FULL, VOID, or MIXED with eight children.
        let count = |symbol| expected.matches(symbol).count();
        assert_eq!(count('F') + count('V'), 1 + 7 * count('M'));
    }
}

/// Union, intersection and complement, followed by condensation, on blocks of which eight together
/// are FULL.
#[test]
fn item_38_results_are_condensed() {
    let octants = |mask: u8| {
        let full = move |[x, y, z]: [u64; 3]| mask >> (x / 2 + 2 * (y / 2) + 4 * (z / 2)) & 1 == 1;
        view_of_cells(&made(OCT, [4; 3], |cell| full(cell).then(|| byte(1))))
    };
    for (number, a, b, expected) in [
        (7, 0b1010_0101, 0b0101_1010, "F"),
        (7, 0b0000_0011, 0b0000_0101, "MFFFVVVVV"),
        (1, 0b0000_0011, 0b0000_0101, "MFVVVVVVV"),
        (1, 0b0000_0011, 0b0000_1100, "V"),
        (12, 0b0000_0011, 0b0000_0000, "MVVFFFFFF"),
        (12, 0b1111_1111, 0b0000_0000, "V"),
    ] {
        let operation = CombineOperation::set(set_operation(number));
        let found = combined(vec![octants(a), octants(b)], operation, [4; 3]).filled_with(byte(1)).unwrap();
        assert_eq!(
            text(&MemTree::from_source(&found, Rule::Mean).unwrap()),
            expected,
            "{number}: {a:b}, {b:b}"
        );
    }
}
