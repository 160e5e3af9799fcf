//! Slavík's survey, trees of points.

use crate::structures::points::{HalvingTree, PointQuadtree};

/// Returns random numbers below a bound, with a fixed seed.
fn random(seed: u64) -> impl FnMut(u64) -> u64 {
    let mut state = seed;
    move |below| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) % below
    }
}

fn points(count: usize, below: u64, seed: u64) -> Vec<[f64; 3]> {
    let mut random = random(seed);
    (0..count).map(|_| [0; 3].map(|_: i32| random(below) as f64)).collect()
}

fn flat([x, y, _]: [f64; 3]) -> [f64; 2] {
    [x, y]
}

fn within(point: &[f64], least: &[f64], most: &[f64]) -> bool {
    point.iter().zip(least).zip(most).all(|((at, low), high)| low <= at && at <= high)
}

#[test]
fn item_10_windows_of_the_point_quadtree_are_those_of_all_points() {
    for below in [3, 40, 10_000] {
        let all: Vec<[f64; 2]> = points(600, below, below).into_iter().map(flat).collect();
        let mut tree = PointQuadtree::default();
        all.iter().for_each(|point| tree.insert(*point));
        assert_eq!(tree.len(), 600);
        for window in points(100, below, 9).chunks(2) {
            let (least, most) = (flat(window[0]), [window[0][0] + window[1][0], window[0][1] + window[1][1]]);
            let mut found = tree.window(least, most);
            let mut expected: Vec<[f64; 2]> =
                all.iter().copied().filter(|point| within(point, &least, &most)).collect();
            let order = |a: &[f64; 2], b: &[f64; 2]| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]));
            found.sort_by(order);
            expected.sort_by(order);
            assert_eq!(found, expected);
        }
        for point in all.iter().take(50) {
            assert_eq!(tree.count(*point), all.iter().filter(|other| *other == point).count() as u64);
        }
        assert_eq!(tree.count([-1.0, 0.0]), 0);
    }
}

#[test]
fn item_10_windows_of_halving_trees_are_those_of_all_points() {
    for axes in [2, 3] {
        for below in [3, 40, 4000] {
            let all = points(500, below, below + 1);
            let mut tree = HalvingTree::new([0.0; 3], 4096.0, axes, 20);
            assert!(all.iter().all(|point| tree.insert(*point)));
            for window in points(100, below, 5).chunks(2) {
                let most = [0, 1, 2].map(|axis| window[0][axis] + window[1][axis]);
                let mut found = tree.window(window[0], most);
                let mut expected: Vec<[f64; 3]> =
                    all.iter().copied().filter(|point| within(point, &window[0], &most)).collect();
                let order = |a: &[f64; 3], b: &[f64; 3]| {
                    a.iter()
                        .zip(b)
                        .map(|(a, b)| a.total_cmp(b))
                        .find(|o| o.is_ne())
                        .unwrap_or(std::cmp::Ordering::Equal)
                };
                found.sort_by(order);
                expected.sort_by(order);
                assert_eq!(found, expected, "{axes} {below}");
            }
        }
    }
}

/// The paper says that the point quadtree "has the same properties as an ordinary quadtree". It
/// does find its points, but it depends on their order of insertion, and its depth is not bounded
/// by the size of the space.
#[test]
fn item_10_only_halving_trees_depend_on_their_points_alone() {
    let forwards = points(300, 1000, 4);
    let backwards: Vec<[f64; 3]> = forwards.iter().rev().copied().collect();
    let (mut a, mut b) =
        (HalvingTree::new([0.0; 3], 1024.0, 2, 30), HalvingTree::new([0.0; 3], 1024.0, 2, 30));
    forwards.iter().for_each(|point| assert!(a.insert(*point)));
    backwards.iter().for_each(|point| assert!(b.insert(*point)));
    assert_eq!(a, b);
    // Integers below 1024: ten halvings separate them.
    assert!(a.depth() <= 10);
    // Sorted by both x and y, each point leaves all later ones in one quadrant: a list.
    let mut sorted: Vec<[f64; 2]> = (0..300).map(|step| [f64::from(step), f64::from(step)]).collect();
    let depth = |points: &[[f64; 2]]| {
        let mut tree = PointQuadtree::default();
        points.iter().for_each(|point| tree.insert(*point));
        tree.depth()
    };
    assert_eq!(depth(&sorted), 300);
    let mut random = random(3);
    (1..sorted.len()).rev().for_each(|last| sorted.swap(last, random(last as u64 + 1) as usize));
    assert!(depth(&sorted) < 40, "{}", depth(&sorted));
}

#[test]
fn item_10_equal_points_are_counted() {
    let mut tree = PointQuadtree::default();
    let mut halving = HalvingTree::new([0.0; 3], 1.0, 3, 8);
    for _ in 0..1000 {
        tree.insert([0.5, 0.5]);
        assert!(halving.insert([0.5; 3]));
    }
    assert_eq!((tree.len(), tree.depth(), tree.count([0.5, 0.5])), (1000, 1, 1000));
    assert_eq!((halving.len(), halving.depth(), halving.counts()), (1000, 0, (1, 0)));
    // On dividing lines, and too close to each other for the number of levels.
    assert!(halving.insert([0.5 + 1e-9, 0.5, 0.5]) && !halving.insert([1.0, 0.0, 0.0]));
    assert_eq!((halving.len(), halving.depth()), (1001, 8));
    assert!(
        PointQuadtree::default().is_empty() && PointQuadtree::default().window([0.0; 2], [1.0; 2]).is_empty()
    );
}

#[test]
fn small_trees_of_points() {
    let mut tree = PointQuadtree::default();
    [[5.0, 5.0], [2.0, 7.0], [2.0, 7.0]].into_iter().for_each(|point| tree.insert(point));
    assert_eq!((tree.count([2.0, 7.0]), tree.window([0.0, 6.0], [4.0, 9.0])), (2, vec![[2.0, 7.0]; 2]));
    let mut tree = HalvingTree::new([0.0; 3], 8.0, 2, 20);
    assert!(tree.is_empty());
    assert!(tree.insert([1.0, 1.0, 0.0]) && tree.insert([5.0, 1.0, 0.0]) && !tree.insert([9.0, 1.0, 0.0]));
    assert_eq!((tree.len(), tree.depth()), (2, 1));
}
