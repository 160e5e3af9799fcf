//! Trees of edges, compared with brute force over all edges.

use std::collections::BTreeSet;

use spinney_base::space::Dimension;

use super::clip::passes;
use super::edge_tree::Edge;
use super::{EdgeLeaf, EdgeTree, PmRule};

/// Returns random numbers below a limit, with a fixed seed.
fn random(seed: u64) -> impl FnMut(u64) -> i64 {
    let mut state = seed;
    move |below| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let mixed = state ^ state >> 29;
        ((mixed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 16) % below) as i64
    }
}

const RULES: [PmRule; 6] =
    [PmRule::Pm1, PmRule::Pm2, PmRule::Pm3, PmRule::Bucket(1), PmRule::Bucket(4), PmRule::Pixels];

/// Returns edges of all kinds: long, short, single vertices, along dividing lines, overlapping,
/// many at one vertex.
fn edges(dimension: Dimension, count: usize, depth: u8, seed: u64) -> Vec<Edge> {
    let mut random = random(seed);
    let (side, axes) = (1i64 << depth, dimension.axes());
    (0..count)
        .map(|number| {
            let mut vertex = || [0, 1, 2].map(|axis| if axis < axes { random(side as u64) } else { 0 });
            let (mut a, mut b) = (vertex(), vertex());
            for axis in 0..axes {
                match number % 7 {
                    0 | 1 => b[axis] = (a[axis] + b[axis] % 5 - 2).clamp(0, side - 1),
                    2 => b[axis] = a[axis],
                    3 if axis == 0 => (a[0], b[0]) = (side / 2, side / 2),
                    4 if axis > 0 => (a[axis], b[axis]) = (3.min(side - 1), 3.min(side - 1)),
                    5 => b[axis] = 1.min(side - 1),
                    _ => {}
                }
            }
            [a, b]
        })
        .collect()
}

/// Returns whether an edge has a point in a half-open or closed box, by testing all positions where
/// it can enter or leave, and those in between.
fn passes_slowly([a, b]: Edge, [low, high]: [[i64; 3]; 2], includes_max: bool) -> bool {
    let along = [0, 1, 2].map(|axis| b[axis] - a[axis]);
    let shares: i64 = 2 * along.iter().map(|along| along.abs().max(1)).product::<i64>();
    (0..=shares).any(|share| {
        (0..3).all(|axis| {
            let at = a[axis] * shares + along[axis] * share;
            let (low, high) = (low[axis] * shares, high[axis] * shares);
            low <= at && (at < high || includes_max && at == high)
        })
    })
}

#[test]
fn edges_pass_through_blocks_that_have_a_point_of_theirs() {
    let mut random = random(1);
    for query in 0..12_000 {
        let mut position = || [random(7), random(7), (query % 2) * random(6)];
        let (edge, corner, other) = ([position(), position()], position(), position());
        let high = [0, 1, 2].map(|axis| corner[axis] + other[axis] % 3 + 1);
        for includes_max in [false, true] {
            let expected = passes_slowly(edge, [corner, high], includes_max);
            assert_eq!(passes(edge, [corner, high], includes_max), expected, "{edge:?} {corner:?} {high:?}");
        }
    }
    // At the limits of the numbers.
    let most = (1 << 32) - 1;
    assert!(passes([[0; 3], [most; 3]], [[most; 3], [most + 1; 3]], false));
    assert!(!passes([[0, 1, 0], [most, most, 0]], [[0; 3], [1; 3]], false));
}

/// Returns the leaves by the definition of the rules: a block is divided if one of them is broken.
fn leaves_slowly(
    edges: &[Edge],
    (rule, dimension): (PmRule, Dimension),
    (corner, levels): ([i64; 3], u8),
    leaves: &mut Vec<EdgeLeaf>,
) {
    let side = 1i64 << levels;
    let sides = [corner, corner.map(|at| at + side)];
    let own: Vec<Edge> = edges.iter().copied().filter(|edge| passes(*edge, sides, false)).collect();
    if own.is_empty() {
        return;
    }
    let is_inside =
        |vertex: &[i64; 3]| (0..3).all(|axis| (corner[axis]..corner[axis] + side).contains(&vertex[axis]));
    let vertices: BTreeSet<[i64; 3]> = own.iter().flatten().copied().filter(is_inside).collect();
    let degree = |vertex: &[i64; 3]| own.iter().filter(|edge| edge.contains(vertex)).count();
    let is_star = vertices.len() == 1 && vertices.iter().all(|vertex| degree(vertex) == own.len());
    let is_leaf = levels == 0
        || match rule {
            PmRule::Pm1 => is_star || vertices.is_empty() && own.len() == 1,
            PmRule::Pm2 => {
                let outside = own.iter().flatten().any(|vertex| degree(vertex) == own.len());
                is_star || vertices.is_empty() && outside
            }
            PmRule::Pm3 => vertices.len() <= 1,
            PmRule::Bucket(most) => own.len() <= most || is_star,
            PmRule::Pixels => false,
        };
    if is_leaf {
        return leaves.push(EdgeLeaf { corner, side, edges: own });
    }
    for child in 0..1 << dimension.axes() {
        let mut corner = corner;
        (0..dimension.axes()).for_each(|axis| corner[axis] += (child >> axis & 1) * side / 2);
        leaves_slowly(&own, (rule, dimension), (corner, levels - 1), leaves);
    }
}

#[test]
fn trees_follow_from_their_edges() {
    let cases = [
        (Dimension::Quad, 6, [0, 1, 2, 3, 10, 60]),
        (Dimension::Oct, 4, [0, 1, 2, 5, 10, 40]),
        (Dimension::Quad, 0, [3; 6]),
    ];
    for ((dimension, depth, counts), rule) in
        cases.into_iter().flat_map(|case| RULES.map(|rule| (case, rule)))
    {
        for (seed, count) in counts.into_iter().enumerate() {
            let all = edges(dimension, count, depth, seed as u64 + 40);
            let set: BTreeSet<Edge> =
                all.iter().map(|[a, b]| if a <= b { [*a, *b] } else { [*b, *a] }).collect();
            let set: Vec<Edge> = set.into_iter().collect();
            let mut expected = Vec::new();
            leaves_slowly(&set, (rule, dimension), ([0; 3], depth), &mut expected);
            let tree = EdgeTree::of(rule, (dimension, depth), all.iter().copied(), usize::MAX).unwrap();
            assert!(tree.leaves() == expected, "{rule:?} {count}");
            let counts = tree.counts();
            let leaves = counts.empty + counts.full;
            assert_eq!(
                (counts.full, leaves),
                (expected.len(), counts.divided * ((1 << dimension.axes()) - 1) + 1)
            );
            assert_eq!(counts.stored, expected.iter().map(|leaf| leaf.edges.len()).sum::<usize>());
            assert_eq!(tree.to_df_expression().len(), leaves + counts.divided);
            let backwards = all.iter().rev().map(|[a, b]| [*b, *a]);
            let other = EdgeTree::of(rule, (dimension, depth), backwards, counts.stored).unwrap();
            assert_eq!(other.to_df_expression(), tree.to_df_expression());
            assert!(other.leaves() == expected);
            if counts.stored > 0 {
                assert!(EdgeTree::of(rule, (dimension, depth), all, counts.stored - 1).is_none());
            }
        }
    }
}

#[test]
fn edges_beyond_the_space_are_left_out() {
    let outside = [[[0, 0, 0], [16, 0, 0]], [[-1, 0, 0], [3, 0, 0]]];
    let tree = EdgeTree::of(PmRule::Pm3, (Dimension::Quad, 4), outside, 9).unwrap();
    assert_eq!((tree.to_df_expression(), tree.leaves()), ("W".into(), vec![]));
}
