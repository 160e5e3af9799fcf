//! Bintrees of the survey: blocks that are halved, along x and y in turn or along the axis that
//! gives the fewest nodes. Also component labelling through bintrees, which the 1991 papers on
//! octrees mention as an alternative to their own method, as a reference for the engine's.

use std::path::Path;

use spinney::raw::partitions::{BinaryNode, Bintree, BintreeNode};
use spinney::raw::query::LabelRequest;
use spinney::raw::tree::df;
use spinney::tree::{MemTree, Source};
use spinney::{Bounds, Code, DataKind, Dataset, Dimension, Rule, Value};

use crate::common::{CLASSIC, Cells, OCT, QUAD, as_byte, byte, dataset};

const ANY: usize = usize::MAX;

/// The image of the two ten-record tables as both kinds of bintrees.
#[test]
fn item_13_raster_of_the_tables() {
    let cell = |[x, y, _]: [u32; 3]| Some(byte(CLASSIC[y as usize][x as usize]));
    let tree = MemTree::from_cells(QUAD, 3, Rule::Dominant, &cell);
    let alternating = Bintree::alternating(&tree, [8, 8, 1], ANY).unwrap();
    assert_eq!(
        alternating.to_text(),
        "bintree:alternating:xy:3:u8:8x8 GGG1GGG133GG31G321GGGG3G13GG322G1GG12G12GG21G2G1G21"
    );
    let adaptive = Bintree::adaptive(&tree, [8, 8, 1]).unwrap();
    // The quadtree has 41 nodes, of which 31 are leaves; these have 26 and 21.
    assert_eq!([&alternating, &adaptive].map(|bintree| bintree.nodes().len()), [51, 41]);
    for bintree in [&alternating, &adaptive] {
        let read = Bintree::from_text(&bintree.to_text(), ANY).unwrap();
        let back = MemTree::from_source(&read, Rule::Dominant).unwrap();
        assert_eq!(df::to_text(&back, None).unwrap(), "GG1G13331G3312GG31331G3222G11221G221G1211");
    }
}

/// Each node is one of two equal halves, the first along x, then of a half of it along y.
#[test]
fn item_13_axes_alternate() {
    for (dimension, form) in [(Dimension::Quad, QUAD), (Dimension::Oct, OCT)] {
        let size = if dimension == Dimension::Quad { [16, 16, 1] } else { [8, 8, 8] };
        let cells = Cells::noise(form, 13, size, 3);
        let bintree = Bintree::alternating(&cells.tree(Rule::Nearest), size, ANY).unwrap();
        let axes = form.axes();
        let mut pending = vec![(0, 0)];
        while let Some((at, level)) = pending.pop() {
            if let BinaryNode::Divided { by, second } = bintree.nodes()[at] {
                assert_eq!(usize::from(by), level % axes);
                pending.extend([(at + 1, level + 1), (second, level + 1)]);
            }
        }
        let mut leaves = 0;
        bintree.each_leaf(&mut |block, value| {
            leaves += 1;
            let [width, height, depth] = block.size();
            assert!(
                width <= height
                    && height <= 2 * width
                    && (axes == 2 || (width <= depth && depth <= 2 * width))
            );
            for x in block.min[0]..block.max[0] {
                assert_eq!(cells.get([x, block.min[1], block.min[2]]), value);
            }
        });
        assert_eq!(bintree.nodes().len(), 2 * leaves - 1);
    }
}

/// The table of docs/literature.md.
#[test]
fn item_13_table_of_nodes() {
    let directory = tempfile::tempdir().unwrap();
    let fixture = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name);
    let page = std::fs::read_to_string(fixture("../docs/literature.md")).unwrap();
    let mut missing = Vec::new();
    for name in [
        "classic.png",
        "island_classes.tif",
        "island_elevation.tif",
        "island_rgb.png",
        "v1/rgba.goblin",
        "v1/ball.goblin",
    ] {
        let mut path = fixture(name);
        if !name.ends_with("goblin") {
            path = directory.path().join(name.replace('.', "_") + ".goblin");
            spinney::build(fixture(name), &path).unwrap();
        }
        let file = spinney::open(&path).unwrap();
        let (tree, extent) = (file.in_memory(1 << 20).unwrap(), file.header().extent);
        let bintrees = [Bintree::alternating(&tree, extent, ANY), Bintree::adaptive(&tree, extent)];
        let [alternating, adaptive] = bintrees.map(|bintree| bintree.unwrap().nodes().len());
        let (children, inner) = (tree.form().children(), tree.inner_nodes());
        // With two children per inner node, half of the nodes plus one half are leaves.
        let counts = [(1 + children * inner, 1 + (children - 1) * inner)].into_iter();
        let counts: Vec<_> =
            counts.chain([alternating, adaptive].map(|nodes| (nodes, nodes / 2 + 1))).collect();
        assert!(counts.is_sorted_by(|(_, more), (_, fewer)| more >= fewer));
        let sizes: Vec<_> = extent[..tree.form().axes()].iter().map(u64::to_string).collect();
        let mut row = format!("| `{name}` | {}, {} |", sizes.join(" x "), tree.form().value);
        row.extend(counts.iter().map(|(nodes, leaves)| format!(" {nodes}, {leaves} |")));
        println!("{row}");
        if !page.contains(&row) {
            missing.push(row);
        }
    }
    assert!(missing.is_empty(), "not in docs/literature.md:\n{}", missing.join("\n"));
}

/// Components of cells of one class, computed on the leaves of a bintree.
struct Components<'a> {
    nodes: &'a [BintreeNode],
    class: fn(Value) -> Option<u8>,
    /// A lower-numbered node of the same component, or the node itself.
    parents: Vec<usize>,
}

impl Components<'_> {
    fn root(&self, mut at: usize) -> usize {
        while self.parents[at] != at {
            at = self.parents[at];
        }
        at
    }

    fn class(&self, at: usize) -> Option<u8> {
        match self.nodes[at] {
            BinaryNode::Leaf(value) => value.and_then(self.class),
            BinaryNode::Divided { .. } => None,
        }
    }

    fn halves(&self, at: usize, block: Bounds) -> Option<(usize, [(usize, Bounds); 2])> {
        let BinaryNode::Divided { by, second } = self.nodes[at] else { return None };
        let (by, mut halves) = (usize::from(by), [(at + 1, block), (second, block)]);
        let middle = block.min[by].midpoint(block.max[by]);
        (halves[0].1.max[by], halves[1].1.min[by]) = (middle, middle);
        Some((by, halves))
    }

    /// Joins adjacent leaves within a block.
    fn within(&mut self, at: usize, block: Bounds) {
        if let Some((by, halves)) = self.halves(at, block) {
            halves.iter().for_each(|(at, block)| self.within(*at, *block));
            self.across(by, halves);
        }
    }

    /// Joins adjacent leaves across the wall between two blocks, the first of which is the lower
    /// one along the axis.
    fn across(&mut self, axis: usize, sides: [(usize, Bounds); 2]) {
        let [(a, a_block), (b, b_block)] = sides;
        let have_common = |other: usize| {
            other == axis
                || a_block.min[other].max(b_block.min[other]) < a_block.max[other].min(b_block.max[other])
        };
        if !(0..3).all(have_common) {
            return;
        }
        for side in 0..2 {
            if let Some((by, halves)) = self.halves(sides[side].0, sides[side].1) {
                // Of halves along the axis, the one at the wall.
                for (i, half) in halves.into_iter().enumerate().filter(|(i, _)| by != axis || *i != side) {
                    let _ = i;
                    let mut parts = sides;
                    parts[side] = half;
                    self.across(axis, parts);
                }
                return;
            }
        }
        if self.class(a).is_some() && self.class(a) == self.class(b) {
            let (a, b) = (self.root(a), self.root(b));
            self.parents[a.max(b)] = a.min(b);
        }
    }
}

/// Returns classes and cell counts of all face-connected components, sorted.
fn by_bintree(tree: &Bintree, space: Bounds, class: fn(Value) -> Option<u8>) -> Vec<(u8, u64)> {
    let nodes = tree.nodes();
    let mut found = Components { nodes, class, parents: (0..nodes.len()).collect() };
    found.within(0, space);
    let mut leaves = nodes.iter().enumerate().filter(|(_, node)| matches!(node, BinaryNode::Leaf(_)));
    let mut sizes = vec![0; nodes.len()];
    tree.each_leaf(&mut |block, _| sizes[found.root(leaves.next().unwrap().0)] += block.volume());
    let mut components: Vec<_> = (0..nodes.len())
        .filter_map(|at| Some((found.class(at)?, sizes[at])).filter(|(_, size)| *size > 0))
        .collect();
    components.sort_unstable();
    components
}

fn by_engine(tree: &Dataset) -> Vec<(u8, u64)> {
    let mut request = LabelRequest::new();
    request.neighbours = false;
    request.connect = Some(if tree.header().form.axes() == 3 { "6" } else { "4" }.parse().unwrap());
    let mut components = Vec::new();
    tree.labels(&request, &(), &mut |label| {
        let class = label.class().map_or(1, |class| class[0].to_f64() as u8);
        components.push((class, label.cells()));
        Ok(())
    })
    .unwrap();
    components.sort_unstable();
    components
}

#[test]
fn item_45_components_of_random_trees() {
    let mut count = 0;
    for seed in 0..24 {
        let (form, size) = [(OCT, [13, 20, 9]), (OCT, [32, 32, 32]), (QUAD, [90, 70, 1])][seed as usize % 3];
        let cells = match seed % 2 {
            0 => Cells::random(form, seed, size, 1 + seed % 3, true),
            _ => Cells::noise(form, seed, size, 2),
        };
        let file = dataset(&cells, Rule::Majority, DataKind::Categorical);
        let tree = file.in_memory(ANY as u64).unwrap();
        let space = Bounds::space(form.dimension, tree.depth());
        let expected = by_engine(&file);
        count += expected.len();
        for bintree in [Bintree::alternating(&tree, size, ANY), Bintree::adaptive(&tree, size)] {
            assert_eq!(
                by_bintree(&bintree.unwrap(), space, |value| Some(as_byte(value))),
                expected,
                "{seed}"
            );
        }
    }
    assert!(count > 1000, "{count}");
}

/// A solid, whose cells are connected if they are at least half full.
#[test]
fn item_45_components_of_a_solid() {
    let ball = spinney::open(Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1/ball.goblin")).unwrap();
    let tree = ball.in_memory(1 << 20).unwrap();
    let bintree = Bintree::alternating(&tree, ball.header().extent, ANY).unwrap();
    let space = Code::root(Dimension::Oct).bounds(tree.depth());
    assert_eq!(by_bintree(&bintree, space, |value| (as_byte(value) >= 128).then_some(255)), by_engine(&ball));
}
