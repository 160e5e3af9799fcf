//! Models whose grids begin at different corners: results are those on one grid, and the octree of
//! the largest model can be copied.

use super::tests::{assert_same, block, combined, model_on, result_in, tetrahedron};
use super::*;
use crate::LEAF_SIZE;
use crate::build::BaseRoot;

type Triangles = Vec<[[i32; 3]; 3]>;

/// Builds a model on the smallest grid around its triangles.
fn on_own_grid(triangles: &Triangles, leaf_size: usize) -> ExactModel {
    let points = || triangles.iter().flatten();
    let low = [0, 1, 2].map(|axis| points().map(|point| point[axis]).min().unwrap());
    let width = points().flat_map(|point| (0..3).map(move |axis| point[axis] - low[axis])).max().unwrap();
    let moved =
        |triangle: &[[i32; 3]; 3]| triangle.map(|point| [0, 1, 2].map(|axis| point[axis] - low[axis]));
    let bits = (32 - width.leading_zeros()) as u8;
    let grid = Grid { bits, origin: low.map(i64::from), step: 1.0, divisor: 1.0 };
    model_on(grid, &triangles.iter().map(moved).collect::<Vec<_>>(), leaf_size)
}

/// Builds a model on the largest grid.
fn on_large_grid(triangles: &Triangles) -> ExactModel {
    model_on(Grid { bits: 26, origin: [0; 3], step: 1.0, divisor: 1.0 }, triangles, LEAF_SIZE)
}

/// A tetrahedron from a corner along the axes.
fn corner_of(low: [i32; 3], size: [i32; 3]) -> Triangles {
    let at = |axis: usize| [0, 1, 2].map(|other| low[other] + if other == axis { size[axis] } else { 0 });
    tetrahedron([low, at(0), at(1), at(2)]).unwrap()
}

/// All faces in the world that are not proxies, from their minimum vertices on.
fn faces(model: &ExactModel) -> Vec<Vec<[i64; 3]>> {
    let (origin, mut found) = (model.grid().origin, Vec::new());
    let mut take = |face: &crate::Face<'_>, is_proxy: bool| {
        let point = |at: &[i32; 3]| [0, 1, 2].map(|axis| origin[axis] + i64::from(at[axis]));
        let mut points: Vec<[i64; 3]> = face.points.iter().map(point).collect();
        let first = (0..points.len()).min_by_key(|index| points[*index]).unwrap();
        points.rotate_left(first);
        if !is_proxy {
            found.push(points);
        }
        Ok(())
    };
    model.each_face(&mut take).unwrap();
    found.sort();
    found
}

/// Checks operations on two bodies, with the first larger, against those on one grid.
fn check(large: &Triangles, small: &Triangles, operations: &[u8], what: &str) {
    let own = [large, small].map(|triangles| on_own_grid(triangles, LEAF_SIZE));
    let one = [large, small].map(on_large_grid);
    for &operation in operations {
        let expected = combined(operation, &[&one[0], &one[1]]);
        let found = combined(operation, &[&own[0], &own[1]]);
        assert_eq!(faces(&found), faces(&expected), "{what}, {operation}");
        assert_eq!(found.exact_faces().0, expected.exact_faces().0, "{what}, {operation}");
        if operation == 2 {
            assert_same(&found, &expected, what);
            let exchanged = combined(set(operation).exchanged().index(), &[&own[1], &own[0]]);
            assert_eq!(faces(&exchanged), faces(&expected), "{what}, {operation} exchanged");
        }
    }
}

fn set(index: u8) -> SetOperation {
    SetOperation::from_index(index).unwrap()
}

#[test]
fn results_do_not_depend_on_where_grids_begin() {
    let large = block(1, [5000, 6000, 7000], None);
    let all = [1, 2, 6, 7, 8];
    check(&large, &corner_of([4900, 5900, 6900], [300, 400, 500]), &all, "below");
    check(&large, &corner_of([5700, 6700, 7700], [1400, 300, 300]), &[2, 7], "above");
    check(&large, &corner_of([4000, 6300, 7300], [4000, 250, 150]), &[2, 6], "on both sides");
    check(&large, &corner_of([100, 90_000, 3], [40, 50, 60]), &[2, 7], "disjoint");
    check(&large, &block(2, [5400, 6500, 6600], None), &[2, 7], "as many faces");
}

#[test]
fn unbounded_models_share_octrees() {
    let large = on_own_grid(&block(3, [5000; 3], None), LEAF_SIZE);
    let small = on_own_grid(&corner_of([4900, 4950, 4800], [500, 600, 900]), LEAF_SIZE);
    let around = combined(12, &[&large]);
    for operation in [1, 2, 7] {
        // (The bits of an operation with a complement as its first operand.)
        let of_body =
            (operation & 1) << 2 | (operation & 4) >> 2 | (operation & 2) << 2 | (operation & 8) >> 2;
        let (found, expected) =
            (combined(operation, &[&around, &small]), combined(of_body, &[&large, &small]));
        assert_eq!(faces(&found), faces(&expected), "{operation}");
        assert_eq!(found.is_unbounded(), expected.is_unbounded(), "{operation}");
    }
}

/// Nodes of the base below the result's maximum depth are joined.
#[test]
fn deep_cells_are_joined() {
    let mut triangles = corner_of([0; 3], [(1 << 22) - 1; 3]);
    // Tetrahedra in one cell of the maximum depth, which has 8 units; outside of the first body.
    let at = (1 << 22) - 8;
    for place in 0..8 {
        let low = [0, 1, 2].map(|axis| at + 4 * (place >> axis & 1));
        triangles.extend(corner_of(low, [2; 3]));
    }
    let (base, other) = (on_own_grid(&triangles, 1), corner_of([-50, 5, 5], [60, 40, 30]));
    let deepest = |model: &ExactModel| {
        let mut deepest = 0;
        let mut nodes = vec![model.root().unwrap()];
        while let Some(node) = nodes.pop() {
            deepest = deepest.max(node.level());
            if node.state() == crate::ModelNodeState::Inner {
                nodes.extend((0..8).map(|child| model.child(&node, child).unwrap()));
            }
        }
        deepest
    };
    assert_eq!((base.grid().bits, deepest(&base)), (22, 19));
    let other = on_own_grid(&other, LEAF_SIZE);
    let result = combined(7, &[&base, &other]);
    assert_eq!((result.grid().bits, deepest(&result)), (23, 19));
    assert!(faces(&result).len() >= 8 * 4);
}

/// The grid of the larger model is a cell of the common grid.
#[test]
fn common_grids_contain_the_grid_of_the_largest_model() {
    let large = on_own_grid(&block(4, [5000; 3], None), LEAF_SIZE);
    assert_eq!(large.grid().bits, 10);
    let root_for = |low: [i32; 3], size: [i32; 3]| {
        let small = on_own_grid(&corner_of(low, size), LEAF_SIZE);
        let common_grid = CommonGrid::of(&[&small, &large], 1).unwrap().unwrap();
        assert_eq!(common_grid.base_root(0), None);
        common_grid.base_root(1)
    };
    let root = |level, position| Some(BaseRoot { level, position });
    assert_eq!(root_for([5100; 3], [9; 3]), root(0, [0; 3]));
    assert_eq!(root_for([4900, 5100, 5100], [9; 3]), root(1, [1, 0, 0]));
    assert_eq!(root_for([5100, 5900, 5100], [9, 999, 9]), root(1, [0, 0, 0]));
    assert_eq!(root_for([5100, 4900, 3100], [9, 1900, 1900]), root(2, [0, 1, 2]));
    assert_eq!(root_for([5100, 5100, 5900 + (1 << 26) - 1024], [9; 3]), root(16, [0; 3]));
    // The smallest common grid has 2^26 units, and one around cells of 2^10 would have more.
    assert_eq!(root_for([5100, 5100, 5900 - (1 << 26)], [9; 3]), None);
}

/// The result has the same bytes, whether changed faces fit the memory or not.
#[test]
fn memory_does_not_change_the_bytes() {
    let large = on_own_grid(&block(5, [5000; 3], None), LEAF_SIZE);
    let small = on_own_grid(&block(6, [4700, 4600, 5500], None), LEAF_SIZE);
    let bytes = [2 << 20, 64 << 20].map(|memory| result_in(7, &[&large, &small], memory));
    assert!(bytes[0] == bytes[1], "bytes depend on the memory");
}
