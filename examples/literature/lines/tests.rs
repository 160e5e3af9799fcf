//! Trees of edges, compared with brute force over all edges.

use std::collections::BTreeSet;

use super::clip::passes;
use super::edge_tree::Edge;
use super::{EdgeLeaf, EdgeTree, PmRule};

/// Returns random numbers below a limit, with a fixed seed.
fn random(seed: u64) -> impl FnMut(u64) -> u64 {
    let mut state = seed;
    move |below| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let mixed = state ^ state >> 29;
        (mixed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 16) % below
    }
}

const RULES: [PmRule; 6] =
    [PmRule::Pm1, PmRule::Pm2, PmRule::Pm3, PmRule::Bucket(1), PmRule::Bucket(4), PmRule::Pixels];

/// Returns edges of all kinds: long, short, single vertices, along dividing lines, overlapping,
/// many at one vertex.
fn edges<const N: usize>(count: usize, depth: u8, seed: u64) -> Vec<Edge<N>> {
    let mut random = random(seed);
    let side = 1u64 << depth;
    (0..count)
        .map(|number| {
            let mut at = || random(side) as i32;
            let mut vertex = || std::array::from_fn(|_| at());
            let (a, mut b): ([i32; N], [i32; N]) = (vertex(), vertex());
            match number % 7 {
                0 | 1 => {
                    b = std::array::from_fn(|axis| (a[axis] + b[axis] % 5 - 2).clamp(0, side as i32 - 1))
                }
                2 => b = a,
                3 => {
                    return [a, b].map(|mut end| {
                        end[0] = side as i32 / 2;
                        end
                    });
                }
                4 => {
                    return [a, b].map(|mut end| {
                        end[1..].fill(3);
                        end
                    });
                }
                5 => b = [1; N],
                _ => {}
            }
            [a, b]
        })
        .collect()
}

/// Returns whether an edge has a point in a half-open or closed box, by testing all positions where
/// it can enter or leave, and those in between.
fn passes_slowly<const N: usize>(
    [a, b]: Edge<N>,
    (low, high): ([i64; N], [i64; N]),
    includes_max: bool,
) -> bool {
    let along: [i64; N] = std::array::from_fn(|axis| i64::from(b[axis]) - i64::from(a[axis]));
    let shares: i64 = 2 * along.iter().map(|along| along.abs().max(1)).product::<i64>();
    (0..=shares).any(|share| {
        (0..N).all(|axis| {
            let at = i64::from(a[axis]) * shares + along[axis] * share;
            let (low, high) = (low[axis] * shares, high[axis] * shares);
            low <= at && (at < high || includes_max && at == high)
        })
    })
}

fn check_passes<const N: usize>(size: u64, seed: u64) {
    let mut random = random(seed);
    for _ in 0..8000 {
        let mut place = || -> [i32; N] { std::array::from_fn(|_| random(size) as i32) };
        let (edge, corner, other) = ([place(), place()], place().map(i64::from), place());
        let high = std::array::from_fn(|axis| corner[axis] + i64::from(other[axis] % 3) + 1);
        for includes_max in [false, true] {
            let expected = passes_slowly(edge, (corner, high), includes_max);
            assert_eq!(passes(edge, (corner, high), includes_max), expected, "{edge:?} {corner:?} {high:?}");
        }
    }
}

#[test]
fn edges_pass_through_blocks_that_have_a_place_of_theirs() {
    check_passes::<2>(9, 1);
    check_passes::<3>(6, 2);
    // At the limits of the numbers.
    let most = (1 << 29) - 1;
    assert!(passes([[0, 0], [most, most]], ([most.into(); 2], [i64::from(most) + 1; 2]), false));
    assert!(!passes([[0, 1], [most, most]], ([0, 0], [1, 1]), false));
}

/// Returns the leaves by the definition of the rules: a block is divided if one of them is broken.
fn leaves_slowly<const N: usize>(
    edges: &[Edge<N>],
    rule: PmRule,
    corner: [i32; N],
    levels: u8,
    leaves: &mut Vec<EdgeLeaf<N>>,
) {
    let side = 1 << levels;
    let low = corner.map(i64::from);
    let own: Vec<Edge<N>> = edges
        .iter()
        .copied()
        .filter(|edge| passes(*edge, (low, low.map(|at| at + i64::from(side))), false))
        .collect();
    if own.is_empty() {
        return;
    }
    let is_inside =
        |vertex: &[i32; N]| (0..N).all(|axis| (corner[axis]..corner[axis] + side).contains(&vertex[axis]));
    let vertices: BTreeSet<[i32; N]> = own.iter().flatten().copied().filter(is_inside).collect();
    let degree = |vertex: &[i32; N]| own.iter().filter(|edge| edge.contains(vertex)).count();
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
        let mut edges = own;
        edges.sort_unstable();
        return leaves.push(EdgeLeaf { corner, side, edges });
    }
    for child in 0..1 << N {
        let corner = std::array::from_fn(|axis| corner[axis] + (child >> axis & 1) * side / 2);
        leaves_slowly(&own, rule, corner, levels - 1, leaves);
    }
}

fn check_trees<const N: usize>(depth: u8, counts: &[usize]) {
    for rule in RULES {
        for (seed, count) in counts.iter().enumerate() {
            let all = edges::<N>(*count, depth, seed as u64 + 40);
            let mut tree = EdgeTree::new(rule, depth);
            let inserted = all.iter().filter(|edge| tree.insert(**edge)).count();
            let set: BTreeSet<Edge<N>> =
                all.iter().map(|[a, b]| if a <= b { [*a, *b] } else { [*b, *a] }).collect();
            assert_eq!((tree.len(), inserted), (set.len(), set.len()));
            let set: Vec<Edge<N>> = set.into_iter().collect();
            let mut expected = Vec::new();
            leaves_slowly(&set, rule, [0; N], depth, &mut expected);
            assert!(tree.leaves() == expected, "{rule:?} {count}");
            let other = EdgeTree::of(rule, depth, all.iter().rev().copied());
            assert_eq!(other.to_df_expression(), tree.to_df_expression());
            assert!(other.leaves() == expected);
            let (leaves, inner) = tree.counts();
            assert_eq!(leaves, inner * ((1 << N) - 1) + 1);
            check_queries(&tree, &set, depth);
            // Removing some edges leaves the tree of the others.
            let (gone, stay) = set.split_at(set.len() / 2);
            assert!(gone.iter().all(|[a, b]| tree.remove([*b, *a]) && !tree.remove([*a, *b])));
            let rest = EdgeTree::of(rule, depth, stay.iter().copied());
            assert!(tree.leaves() == rest.leaves(), "{rule:?} {count}");
            assert_eq!(tree.to_df_expression(), rest.to_df_expression());
        }
    }
}

fn check_queries<const N: usize>(tree: &EdgeTree<N>, all: &[Edge<N>], depth: u8) {
    let mut random = random(7);
    for _ in 0..40 {
        let mut place = || -> [i32; N] { std::array::from_fn(|_| random(1 << depth) as i32) };
        let (a, b, from) = (place(), place(), place());
        let low = std::array::from_fn(|axis| a[axis].min(b[axis]));
        let high = std::array::from_fn(|axis| a[axis].max(b[axis]));
        let window = (low.map(i64::from), high.map(i64::from));
        let expected: Vec<Edge<N>> = all.iter().copied().filter(|edge| passes(*edge, window, true)).collect();
        assert_eq!(tree.window(low, high), expected);
        let nearest = all.iter().map(|edge| (super::distance::of_edge(*edge, from), *edge)).min();
        assert_eq!(tree.nearest(from), nearest.map(|(square, edge)| (edge, square.to_f64().sqrt())));
    }
}

#[test]
fn quadtrees_follow_from_their_edges() {
    check_trees::<2>(6, &[0, 1, 2, 3, 10, 60]);
    check_trees::<2>(0, &[3]);
}

#[test]
fn octrees_follow_from_their_edges() {
    check_trees::<3>(4, &[0, 1, 2, 10, 40]);
}

#[test]
fn edges_beyond_the_space_are_refused() {
    let mut tree = EdgeTree::new(PmRule::Pm1, 4);
    assert!(!tree.insert([[0, 0], [16, 0]]) && !tree.insert([[-1, 0], [3, 0]]));
    assert!(tree.is_empty() && !tree.remove([[0, 0], [1, 1]]));
    assert_eq!((tree.nearest([3, 3]), tree.window([0, 0], [15, 15])), (None, vec![]));
    assert_eq!(EdgeTree::of(PmRule::Pm3, 4, [[[0, 0], [16, 0]]]).len(), 0);
}

#[test]
fn distances_are_compared_exactly() {
    // Two edges whose distances from a point differ in the 20th digit.
    let far = (1 << 29) - 1;
    let mut tree = EdgeTree::new(PmRule::Bucket(8), 29);
    assert!(tree.insert([[0, 1], [far, far]]) && tree.insert([[0, 0], [far, far - 1]]));
    let (edge, distance) = tree.nearest([far - 1, far - 1]).unwrap();
    assert_eq!(edge, [[0, 1], [far, far]]);
    assert!(distance < 1.0);
}

#[test]
fn windows_and_the_nearest_edge_of_a_small_tree() {
    let mut tree = EdgeTree::new(PmRule::Pm1, 3);
    assert!(tree.insert([[1, 1], [6, 1]]) && tree.insert([[6, 1], [6, 6]]));
    assert!(!tree.insert([[6, 1], [1, 1]]), "it is there");
    assert_eq!(tree.window([5, 3], [7, 7]), [[[6, 1], [6, 6]]]);
    assert_eq!(tree.nearest([1, 7]).unwrap().0, [[6, 1], [6, 6]]);
}
