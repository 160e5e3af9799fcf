//! Slavík's survey, trees of lines.

use crate::structures::lines::{EdgeLeaf, EdgeTree, PmRule};

type Edge<const N: usize> = [[i32; N]; 2];

/// Returns random edges with vertices below 2^depth, with a fixed seed.
fn edges<const N: usize>(count: usize, depth: u8, seed: u64) -> Vec<Edge<N>> {
    let mut state = seed;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 33) % (1 << depth)) as i32
    };
    (0..count).map(|_| [0; 2].map(|_| std::array::from_fn(|_| random()))).collect()
}

/// Returns the edge vertices in a leaf.
fn vertices_in<const N: usize>(leaf: &EdgeLeaf<N>) -> Vec<[i32; N]> {
    let has =
        |vertex: &[i32; N]| (0..N).all(|axis| (0..leaf.side).contains(&(vertex[axis] - leaf.corner[axis])));
    let mut inside: Vec<[i32; N]> = leaf.edges.iter().flatten().copied().filter(has).collect();
    inside.sort_unstable();
    inside.dedup();
    inside
}

#[test]
fn item_11_leaves_have_one_line_or_one_vertex_with_its_lines() {
    let all = edges::<2>(60, 12, 3);
    let tree = EdgeTree::of(PmRule::Pm1, 12, all.iter().copied());
    for leaf in tree.leaves().iter().filter(|leaf| leaf.side > 1) {
        let vertices = vertices_in(leaf);
        match &vertices[..] {
            [] => assert_eq!(leaf.edges.len(), 1, "{leaf:?}"),
            [vertex] => assert!(leaf.edges.iter().all(|edge| edge.contains(vertex)), "{leaf:?}"),
            _ => panic!("{leaf:?}"),
        }
    }
    // Several lines that end in one vertex share its leaf, however close they are.
    let star: Vec<Edge<2>> = (0..16).map(|end| [[8, 8], [end, 15]]).collect();
    let tree = EdgeTree::of(PmRule::Pm1, 4, star.iter().copied());
    let leaf = tree.leaves().into_iter().find(|leaf| vertices_in(leaf) == [[8, 8]]).unwrap();
    assert_eq!(leaf.edges.len(), 16);
}

#[test]
fn item_11_each_rule_of_pm_quadtrees_allows_what_the_one_before_does() {
    let all = edges::<2>(40, 10, 8);
    let counts = [PmRule::Pm1, PmRule::Pm2, PmRule::Pm3]
        .map(|rule| EdgeTree::of(rule, 10, all.iter().copied()).counts().0);
    assert!(counts[0] >= counts[1] && counts[1] >= counts[2] && counts[0] > counts[2], "{counts:?}");
    // Lines that cross without a vertex: the first two rules subdivide to the maximum depth, the
    // third not at all.
    let cross: [Edge<2>; 2] = [[[0, 0], [15, 15]], [[0, 15], [15, 0]]];
    let depth = |rule| EdgeTree::of(rule, 4, cross).leaves().iter().map(|leaf| leaf.side).min();
    assert_eq!([PmRule::Pm1, PmRule::Pm2].map(depth), [Some(1), Some(1)]);
    assert_eq!(depth(PmRule::Pm3), Some(8));
}

#[test]
fn item_11_buckets_have_at_most_so_many_lines() {
    let all = edges::<2>(300, 12, 5);
    for most in [1, 5, 20] {
        let tree = EdgeTree::of(PmRule::Bucket(most), 12, all.iter().copied());
        for leaf in tree.leaves().iter().filter(|leaf| leaf.side > 1 && leaf.edges.len() > most) {
            let vertices = vertices_in(leaf);
            assert!(
                vertices.len() == 1 && leaf.edges.iter().all(|edge| edge.contains(&vertices[0])),
                "{leaf:?}"
            );
        }
        assert_eq!(tree.window([0; 2], [4095; 2]).len(), tree.len());
    }
}

#[test]
fn item_12_octants_have_a_part_of_one_edge() {
    // The edges of a cube: leaves have a segment of one edge, or a corner at which three meet.
    let corner =
        |number: usize| -> [i32; 3] { std::array::from_fn(|axis| 3 + 24 * (number >> axis & 1) as i32) };
    let cube = (0..8usize).flat_map(|number| {
        (0..3)
            .filter(move |axis| number >> axis & 1 == 0)
            .map(move |axis| [corner(number), corner(number | 1 << axis)])
    });
    let tree = EdgeTree::of(PmRule::Pm1, 5, cube);
    assert_eq!(tree.len(), 12);
    let leaves = tree.leaves();
    assert_eq!(leaves.iter().filter(|leaf| vertices_in(leaf).len() == 1 && leaf.edges.len() == 3).count(), 8);
    assert!(leaves.iter().all(|leaf| leaf.edges.len() == 1 || vertices_in(leaf).len() == 1));
    // Random edges, which hardly ever meet.
    for leaf in
        EdgeTree::of(PmRule::Pm1, 9, edges::<3>(40, 9, 6)).leaves().iter().filter(|leaf| leaf.side > 1)
    {
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
    let lines: [Edge<2>; 2] = [[[0, 0], [3, 0]], [[2, 2], [2, 3]]];
    let tree = EdgeTree::of(PmRule::Pixels, 2, lines);
    assert_eq!(tree.to_df_expression(), "GGBBWWGBBWWWGBWBW");
    assert!(tree.leaves().iter().all(|leaf| leaf.side == 1));
    // The same with line descriptors in the leaves: blocks with one line need no subdivision.
    let tree = EdgeTree::of(PmRule::Bucket(1), 2, lines);
    assert_eq!(tree.to_df_expression(), "GBBWB");
    assert_eq!(tree.leaves()[2].edges, [lines[1]]);
    // Inserting line by line gives the same tree as all lines at once.
    let all = edges::<2>(30, 7, 2);
    let mut tree = EdgeTree::new(PmRule::Pixels, 7);
    assert!(all.iter().all(|edge| tree.insert(*edge)));
    assert_eq!(tree.to_df_expression(), EdgeTree::of(PmRule::Pixels, 7, all).to_df_expression());
}
