//! Slavík's survey, trees of lines.

use std::collections::BTreeSet;

use spinney::Dimension;
use spinney::raw::partitions::{EdgeLeaf, EdgeTree, PmRule};

type Edge = [[i64; 3]; 2];

/// Returns random edges with vertices below 2^depth, with a fixed seed.
fn edges(dimension: Dimension, count: usize, depth: u8, seed: u64) -> Vec<Edge> {
    let mut state = seed;
    let mut random = |axis: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        if axis < dimension.axes() { ((state >> 33) % (1 << depth)) as i64 } else { 0 }
    };
    (0..count).map(|_| [0; 2].map(|_| [0, 1, 2].map(&mut random))).collect()
}

fn flat(edge: [[i64; 2]; 2]) -> Edge {
    edge.map(|[x, y]| [x, y, 0])
}

fn tree(rule: PmRule, dimension: Dimension, depth: u8, edges: &[Edge]) -> EdgeTree {
    EdgeTree::of(rule, (dimension, depth), edges.iter().copied(), usize::MAX).unwrap()
}

/// Returns the edge vertices in a leaf.
fn vertices_in(leaf: &EdgeLeaf) -> Vec<[i64; 3]> {
    let has =
        |vertex: &[i64; 3]| (0..3).all(|axis| (0..leaf.side).contains(&(vertex[axis] - leaf.corner[axis])));
    let mut inside: Vec<[i64; 3]> = leaf.edges.iter().flatten().copied().filter(has).collect();
    inside.sort_unstable();
    inside.dedup();
    inside
}

#[test]
fn item_11_leaves_have_one_line_or_one_vertex_with_its_lines() {
    let all = edges(Dimension::Quad, 60, 12, 3);
    for leaf in tree(PmRule::Pm1, Dimension::Quad, 12, &all).leaves().iter().filter(|leaf| leaf.side > 1) {
        let vertices = vertices_in(leaf);
        match &vertices[..] {
            [] => assert_eq!(leaf.edges.len(), 1, "{leaf:?}"),
            [vertex] => assert!(leaf.edges.iter().all(|edge| edge.contains(vertex)), "{leaf:?}"),
            _ => panic!("{leaf:?}"),
        }
    }
    // Several lines that end in one vertex share its leaf, however close they are.
    let star: Vec<Edge> = (0..16).map(|end| flat([[8, 8], [end, 15]])).collect();
    let tree = tree(PmRule::Pm1, Dimension::Quad, 4, &star);
    let leaf = tree.leaves().into_iter().find(|leaf| vertices_in(leaf) == [[8, 8, 0]]).unwrap();
    assert_eq!(leaf.edges.len(), 16);
}

#[test]
fn item_11_each_rule_of_pm_quadtrees_allows_what_the_one_before_does() {
    let all = edges(Dimension::Quad, 40, 10, 8);
    let counts = [PmRule::Pm1, PmRule::Pm2, PmRule::Pm3]
        .map(|rule| tree(rule, Dimension::Quad, 10, &all).counts().full);
    assert!(counts[0] >= counts[1] && counts[1] >= counts[2] && counts[0] > counts[2], "{counts:?}");
    // Lines that cross without a vertex: the first two rules subdivide to the maximum depth, the
    // third not at all.
    let cross = [[[0, 0], [15, 15]], [[0, 15], [15, 0]]].map(flat);
    let depth = |rule| tree(rule, Dimension::Quad, 4, &cross).leaves().iter().map(|leaf| leaf.side).min();
    assert_eq!([PmRule::Pm1, PmRule::Pm2].map(depth), [Some(1), Some(1)]);
    assert_eq!(depth(PmRule::Pm3), Some(8));
}

#[test]
fn item_11_buckets_have_at_most_so_many_lines() {
    let all = edges(Dimension::Quad, 300, 12, 5);
    for most in [1, 5, 20] {
        let tree = tree(PmRule::Bucket(most), Dimension::Quad, 12, &all);
        for leaf in tree.leaves().iter().filter(|leaf| leaf.side > 1 && leaf.edges.len() > most) {
            let vertices = vertices_in(leaf);
            assert!(
                vertices.len() == 1 && leaf.edges.iter().all(|edge| edge.contains(&vertices[0])),
                "{leaf:?}"
            );
        }
        let found: BTreeSet<Edge> = tree.leaves().into_iter().flat_map(|leaf| leaf.edges).collect();
        assert_eq!(found.len(), all.len());
    }
}

#[test]
fn item_12_octants_have_a_part_of_one_edge() {
    // The edges of a cube: leaves have a segment of one edge, or a corner at which three meet.
    let corner =
        |number: usize| -> [i64; 3] { std::array::from_fn(|axis| 3 + 24 * (number >> axis & 1) as i64) };
    let cube = (0..8usize).flat_map(|number| {
        (0..3)
            .filter(move |axis| number >> axis & 1 == 0)
            .map(move |axis| [corner(number), corner(number | 1 << axis)])
    });
    let cube: Vec<Edge> = cube.collect();
    assert_eq!(cube.len(), 12);
    let leaves = tree(PmRule::Pm1, Dimension::Oct, 5, &cube).leaves();
    assert_eq!(leaves.iter().filter(|leaf| vertices_in(leaf).len() == 1 && leaf.edges.len() == 3).count(), 8);
    assert!(leaves.iter().all(|leaf| leaf.edges.len() == 1 || vertices_in(leaf).len() == 1));
    // Random edges, which hardly ever meet.
    let all = edges(Dimension::Oct, 40, 9, 6);
    for leaf in tree(PmRule::Pm1, Dimension::Oct, 9, &all).leaves().iter().filter(|leaf| leaf.side > 1) {
        let vertices = vertices_in(leaf);
        assert!(vertices.len() <= 1, "{leaf:?}");
        assert!(
            leaf.edges.len() == 1 || leaf.edges.iter().all(|edge| edge.contains(&vertices[0])),
            "{leaf:?}"
        );
    }
}

#[test]
fn item_17_blocks_without_lines_are_white_pixels_with_lines_black_others_are_divided() {
    // Two lines in 4 x 4 pixels: along the first row, and from the middle down.
    let lines = [[[0, 0], [3, 0]], [[2, 2], [2, 3]]].map(flat);
    let pixels = tree(PmRule::Pixels, Dimension::Quad, 2, &lines);
    assert_eq!(pixels.to_df_expression(), "GGBBWWGBBWWWGBWBW");
    assert!(pixels.leaves().iter().all(|leaf| leaf.side == 1));
    // The same with line descriptors in the leaves: blocks with one line need no subdivision.
    let buckets = tree(PmRule::Bucket(1), Dimension::Quad, 2, &lines);
    assert_eq!(buckets.to_df_expression(), "GBBWB");
    assert_eq!(buckets.leaves()[2].edges, [lines[1]]);
    // The order of lines does not matter.
    let mut all = edges(Dimension::Quad, 30, 7, 2);
    let expected = tree(PmRule::Pixels, Dimension::Quad, 7, &all).to_df_expression();
    all.reverse();
    assert_eq!(tree(PmRule::Pixels, Dimension::Quad, 7, &all).to_df_expression(), expected);
}
