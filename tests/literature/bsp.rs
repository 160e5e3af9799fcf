//! BSP trees of the survey: lines `a x + b y + c = 0` divide the plane into non-negative (right)
//! and negative (left) sides; cells are convex polygons. Planes do the same in space, for
//! visibility order.

use spinney::raw::partitions::{BinaryNode, Bsp, BspItem};
use spinney::raw::tree::df;
use spinney::tree::{MemTree, build_source};
use spinney::{BuildOptions, DataKind, Output, Rule};

use crate::common::{Random, byte};

/// Descriptors have the sign of the side, and points on the line are on the right.
#[test]
fn item_14_descriptors_and_sides() {
    let mut random = Random(14);
    let mut point = || [random.below(60) as i32, random.below(60) as i32];
    for _ in 0..50 {
        let segments: Vec<_> = (0..8).map(|_| [point(), point()]).filter(|[p, q]| p != q).collect();
        let tree = Bsp::of_segments(&segments).unwrap();
        for position in (0..200).map(|_| point()).chain(segments.iter().flatten().copied()) {
            let [x, y] = position.map(i128::from);
            let mut at = 0;
            while let BinaryNode::Divided { by, second } = &tree.nodes()[at] {
                let ([a, b, c], d) = by.descriptor();
                assert_eq!(c, 0);
                at = if i128::from(a) * x + i128::from(b) * y + d >= 0 { *second } else { at + 1 };
            }
            assert_eq!(tree.locate([position[0], position[1], 0]), at);
        }
    }
    // The right side of a segment, for a direction in which y increases, is the non-negative side.
    let tree = Bsp::of_segments(&[[[2, 0], [2, 9]]]).unwrap();
    let [left, on, right] = [1, 2, 3].map(|x| tree.locate([x, 5, 0]));
    assert_eq!((left, on, right), (1, 2, 2));
}

/// Each cell is convex: the midpoint of two of its points is in it.
#[test]
fn item_14_cells_are_convex() {
    let mut random = Random(1414);
    let mut point = || [random.below(200) as i32, random.below(200) as i32];
    let segments: Vec<_> = (0..12).map(|_| [point(), point()]).filter(|[p, q]| p != q).collect();
    let tree = Bsp::of_segments(&segments).unwrap();
    for _ in 0..20_000 {
        // End points whose midpoint is on the grid.
        let ([ax, ay], [bx, by]) = (point(), point());
        let (bx, by) = (bx + (ax + bx) % 2, by + (ay + by) % 2);
        let cell = tree.locate([ax, ay, 0]);
        if cell == tree.locate([bx, by, 0]) {
            assert_eq!(cell, tree.locate([(ax + bx) / 2, (ay + by) / 2, 0]));
        }
    }
}

/// The drawing order of cubes in a row, from either end.
#[test]
fn item_14_what_hides_what() {
    let cube = |x: i32| {
        let corner = |bits: i32| [x + 2 * (bits & 1), (bits & 2) + 4, (bits & 4) / 2 + 4];
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        sides.map(|side| vec![side.map(corner).to_vec()])
    };
    let faces: Vec<_> = [10, 0, 20, 5, 15].into_iter().flat_map(cube).collect();
    let tree = Bsp::of_faces(&faces).unwrap();
    // The faces towards the eye, perpendicular to the viewing direction.
    let seen_from = |x: i32, side: usize| {
        let mut cubes = Vec::new();
        tree.back_to_front([x, 5, 5], &mut |what| {
            if let BspItem::Fragment(fragment) = what
                && fragment.source % 6 == side
                && cubes.last() != Some(&(fragment.source / 6))
            {
                cubes.push(fragment.source / 6);
            }
        });
        cubes
    };
    assert_eq!(seen_from(1000, 1), [1, 3, 0, 4, 2]);
    assert_eq!(seen_from(0, 0)[..4], [2, 4, 0, 3]);
    // The same from infinity, also for triangles that form no closed surface.
    let triangles: Vec<_> = [10, 0, 20, 5, 15].map(|x| [[x, 4, 4], [x, 8, 4], [x, 4, 8]]).to_vec();
    let tree = Bsp::of_triangles(&triangles).unwrap();
    for (direction, order) in [([1, 0, 0], [1, 3, 0, 4, 2]), ([-5, 1, 2], [2, 4, 0, 3, 1])] {
        let mut seen = Vec::new();
        tree.back_to_front_from_afar(direction, &mut |what| {
            if let BspItem::Fragment(fragment) = what {
                assert_eq!(fragment.sides().collect::<Vec<_>>(), [Some(0), Some(1), Some(2)]);
                seen.push(fragment.source);
            }
        });
        assert_eq!(seen, order);
    }
}

/// A polygon with slanted edges becomes a quadtree: blocks in, out or both.
#[test]
fn item_14_a_polygon_as_a_quadtree() {
    let kite = vec![vec![[0, 4], [4, 0], [8, 4], [4, 8]]];
    let tree = Bsp::of_polygons(&[kite]).unwrap();
    let blocks = tree.blocks(3).unwrap();
    let quadtree = MemTree::from_source(&blocks, Rule::Mean).unwrap();
    let quadrants = ["GWGWWWBGWWWBB", "GGWWBWWBGWWBW", "GGWBWWBWGWBWW", "GBGBWWWGBWWWW"];
    assert_eq!(df::to_text(&quadtree, Some(byte(255))).unwrap(), format!("G{}", quadrants.concat()));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("kite.goblin");
    let options = BuildOptions::new(DataKind::Categorical, 3);
    let tally = build_source(&blocks, [8, 8, 1], &options, Output::create(&path).unwrap(), &()).unwrap();
    // Sixteen cells have their centres on an edge, which is outside.
    assert_eq!(tally.cells, 24);
}
