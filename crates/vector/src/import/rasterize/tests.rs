//! Compares trees of random shapes with direct tests of every cell.

use spinney_base::space::{Bounds, Code, Dimension, EdgeRule};
use spinney_base::value::{Number, SampleType, Value, ValueType};
use spinney_engine::ops::BlockSource;
use spinney_engine::tree::Child;
use spinney_overlay::{Crossings, FULL_SHARE, Polygon};

use super::edge::{Edge, PARTS};
use super::node_cache::NodeCache;
use super::shapes::{ShapeKind, Shapes};
use super::source::{Paint, ShapeTree};

/// Reproducible pseudo-random numbers.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) * end) >> 31
    }
}

/// Ring of vertices in grid units.
type Ring = Vec<[i64; 2]>;

fn edges(rings: &[Ring]) -> Vec<Edge> {
    let of_ring = |ring: &Ring| {
        let next = ring.iter().cycle().skip(1);
        ring.iter().zip(next).map(|(a, b)| Edge { a: *a, b: *b }).collect::<Vec<_>>()
    };
    rings.iter().flat_map(of_ring).collect()
}

/// Returns a star-shaped, counterclockwise ring around a point, with vertices on a grid of `grid`
/// units.
fn star(random: &mut Random, middle: [f64; 2], radius: f64, grid: i64) -> Ring {
    let count = 3 + random.below(20);
    let corner = |number: u64| {
        let angle = number as f64 / count as f64 * std::f64::consts::TAU;
        let away = radius * (0.5 + random.below(500) as f64 / 1000.0);
        let at = [middle[0] + away * angle.cos(), middle[1] + away * angle.sin()];
        at.map(|at| (at * PARTS as f64 / grid as f64).round() as i64 * grid)
    };
    (0..count).map(corner).collect()
}

/// Returns the area of a cell inside a polygon.
fn area_of_cell(polygon: &Polygon, [x, y]: [u64; 2]) -> f64 {
    let cell = Bounds { min: [x, y, 0], max: [x + 1, y + 1, 1] };
    let (whole, shares) = polygon.sum_shares(&cell, &mut Crossings::default());
    whole as f64 + shares as f64 / FULL_SHARE as f64
}

/// Returns a tree of one star, and the star as a floating-point polygon, from which the areas of
/// cells are computed.
fn star_tree(random: &mut Random, grid: i64, how: (Paint, EdgeRule)) -> (ShapeTree, Polygon) {
    let middle = [random.below(40) as f64 - 4.0, random.below(40) as f64 - 4.0];
    let radius = 2.0 + random.below(30) as f64;
    let ring = star(random, middle, radius, grid);
    let floats = ring.iter().map(|at| at.map(|at| at as f64 / PARTS as f64)).collect::<Vec<_>>();
    let polygon = Polygon::of_parts(&[vec![floats]]).unwrap();
    let mut shapes = Shapes::default();
    shapes.add(ShapeKind::Polygon, 0, edges(&[ring]).into_iter());
    (tree(shapes, &[7], how, [32, 32], 5), polygon)
}

fn tree(
    mut shapes: Shapes,
    values: &[u64],
    (paint, edge): (Paint, EdgeRule),
    extent: [u64; 2],
    depth: u8,
) -> ShapeTree {
    let sample = if paint == Paint::Share { SampleType::F32 } else { SampleType::U32 };
    shapes.centres_alone = paint.needs_centres_alone(edge);
    ShapeTree {
        shapes,
        values: values.iter().map(|value| Number::from(*value)).collect(),
        value_type: ValueType::new(sample, 1),
        fixed: None,
        paint,
        edge,
        dimension: Dimension::Quad,
        extent: [extent[0], extent[1], 1],
        depth,
        node_cache: NodeCache::new(1 << 14),
    }
}

/// Returns all cells of a tree, which is traversed down to a level and read in blocks below.
fn cells(tree: &ShapeTree, block_levels: u8) -> Vec<Option<Value>> {
    let side = 1usize << tree.depth;
    let mut cells = vec![None; side * side];
    let mut pending = vec![Code::root(Dimension::Quad)];
    let width = tree.value_type.size();
    while let Some(code) = pending.pop() {
        let bounds = code.bounds(tree.depth);
        let size = bounds.size()[0] as usize;
        let mut put = |x: usize, y: usize, value: Option<Value>| {
            cells[(bounds.min[1] as usize + y) * side + bounds.min[0] as usize + x] = value;
        };
        match tree.node(code).unwrap() {
            Child::Inner { .. } if code.level() + block_levels == tree.depth => {
                let block = tree.block(code).unwrap();
                for at in 0..size * size {
                    let value = Value::from_bytes(&block.values[at * width..(at + 1) * width]);
                    put(at % size, at / size, block.present[at].then_some(value));
                }
            }
            Child::Inner { .. } => pending.extend((0..4).map(|step| code.child(step))),
            child => {
                let value = child.value();
                (0..size * size).for_each(|at| put(at % size, at / size, value));
            }
        }
    }
    cells
}

/// Returns whether a cell's centre is inside rings; `None` if it is too close to an edge.
fn has_centre(rings: &[Ring], [x, y]: [usize; 2]) -> Option<bool> {
    let [x, y] = [x, y].map(|at| at as f64 + 0.5);
    let mut is_inside = false;
    for Edge { a, b } in edges(rings) {
        let [[ax, ay], [bx, by]] = [a, b].map(|at| at.map(|at| at as f64 / PARTS as f64));
        if (y - ay).abs() < 1e-6 || (y - by).abs() < 1e-6 {
            return None;
        }
        if (ay > y) != (by > y) {
            let at = ax + (y - ay) / (by - ay) * (bx - ax);
            if (at - x).abs() < 1e-6 {
                return None;
            }
            is_inside ^= at > x;
        }
    }
    Some(is_inside)
}

#[test]
fn the_last_shape_has_the_cells_whose_centres_are_inside() {
    let mut random = Random(1);
    for round in 0..60 {
        let (mut shapes, mut all) = (Shapes::default(), Vec::new());
        let count = 1 + random.below(6);
        for number in 0..count {
            let middle = [random.below(70) as f64 - 3.0, random.below(70) as f64 - 3.0];
            let radius = 2.0 + random.below(40) as f64;
            let rings =
                vec![star(&mut random, middle, radius, 1), star(&mut random, middle, radius / 4.0, 1)];
            shapes.add(ShapeKind::Polygon, number as u32, edges(&rings).into_iter());
            all.push(rings);
        }
        let values: Vec<u64> = (0..count).map(|number| number + 10).collect();
        let tree = tree(shapes, &values, (Paint::Top, EdgeRule::Centre), [61, 57], 6);
        let found = cells(&tree, [0, 2, 5, 6][round % 4]);
        for y in 0..64 {
            for x in 0..64 {
                let inside: Option<Vec<bool>> = all.iter().map(|rings| has_centre(rings, [x, y])).collect();
                let Some(inside) = inside else { continue };
                let top = inside.iter().rposition(|is_inside| *is_inside).filter(|_| x < 61 && y < 57);
                let expected = top.map(|top| Value::from([10 + top as u32]));
                assert_eq!(found[y * 64 + x], expected, "{x}, {y} of round {round}");
            }
        }
    }
}

/// Returns triangles that divide a square, so that every border point belongs to two of them.
fn triangles(random: &mut Random, side: i64, count: usize, grid: i64) -> Vec<[[i64; 2]; 3]> {
    let end = side * PARTS;
    let mut triangles = vec![[[0, 0], [end, 0], [end, end]], [[0, 0], [end, end], [0, end]]];
    for _ in 0..count {
        let number = random.below(triangles.len() as u64) as usize;
        let [a, b, c] = triangles[number];
        // Insert a grid vertex in the middle of a triangle, if one is strictly inside.
        let mean = |axis: usize| ((a[axis] + b[axis] + c[axis]) / 3 + grid / 2).div_euclid(grid) * grid;
        let middle = [mean(0), mean(1)];
        let turn = |a: [i64; 2], b: [i64; 2]| {
            i128::from(b[0] - a[0]) * i128::from(middle[1] - a[1])
                - i128::from(b[1] - a[1]) * i128::from(middle[0] - a[0])
        };
        let turns = [turn(a, b), turn(b, c), turn(c, a)];
        if turns.iter().all(|turn| *turn > 0) || turns.iter().all(|turn| *turn < 0) {
            triangles[number] = [a, b, middle];
            triangles.extend([[b, c, middle], [c, a, middle]]);
        }
    }
    triangles
}

#[test]
fn shared_borders_have_no_gap_and_nothing_twice() {
    let mut random = Random(2);
    // Vertices anywhere, on centres and corners of cells, and on corners of cells only.
    for (round, grid) in [1, PARTS / 2, PARTS, 3 * PARTS / 2].into_iter().cycle().take(24).enumerate() {
        let triangles = triangles(&mut random, 64, 80, grid);
        let mut shapes = Shapes::default();
        for (number, corners) in triangles.iter().enumerate() {
            let mut ring = corners.to_vec();
            if random.below(2) == 0 {
                ring.reverse();
            }
            shapes.add(ShapeKind::Polygon, number as u32, edges(&[ring]).into_iter());
        }
        let values: Vec<u64> = (0..triangles.len() as u64).collect();
        let tree = tree(shapes, &values, (Paint::Count, EdgeRule::Centre), [64, 64], 6);
        let found = cells(&tree, [0, 3, 6][round % 3]);
        assert!(found.iter().all(|value| *value == Some(Value::from([1u32]))), "round {round}");
    }
}

#[test]
fn shares_are_areas() {
    let mut random = Random(3);
    for (round, grid) in [1, PARTS / 2, PARTS].into_iter().cycle().take(60).enumerate() {
        let (tree, polygon) = star_tree(&mut random, grid, (Paint::Share, EdgeRule::Area));
        let found = cells(&tree, [0, 2, 4, 5][round % 4]);
        for (at, value) in found.iter().enumerate() {
            let (x, y) = (at as u64 % 32, at as u64 / 32);
            let area = area_of_cell(&polygon, [x, y]);
            let share = f64::from(f32::from_le_bytes(value.unwrap().to_bytes()[..4].try_into().unwrap()));
            assert!((area - share).abs() < 1e-6, "{share}, not {area}, at {x}, {y} of round {round}");
        }
    }
}

/// Returns overlapping stars with their value numbers, sorted by these.
fn heap(random: &mut Random, count: u64, values: u64, radius: u64, grid: i64) -> Vec<(u32, Ring)> {
    let mut stars: Vec<(u32, Ring)> = (0..count)
        .map(|_| {
            let middle = [random.below(2000) as f64 / 250.0 + 4.0, random.below(2000) as f64 / 250.0 + 4.0];
            let radius = (1 + random.below(radius)) as f64 / 2.0;
            (random.below(values) as u32, star(random, middle, radius, grid))
        })
        .collect();
    stars.sort_by_key(|(value, _)| *value);
    stars
}

/// Returns the union of the selected stars.
fn union_of(stars: &[(u32, Ring)], is_wanted: impl Fn(u32) -> bool) -> Option<Polygon> {
    let floats =
        |ring: &Ring| ring.iter().map(|at| at.map(|at| at as f64 / PARTS as f64)).collect::<Vec<_>>();
    let wanted = stars.iter().filter(|(value, _)| is_wanted(*value));
    let parts: Vec<_> = wanted.map(|(_, ring)| vec![floats(ring)]).collect();
    (!parts.is_empty()).then(|| Polygon::of_parts(&parts).unwrap())
}

fn heap_tree(stars: &[(u32, Ring)], values: &[u64], paint: Paint) -> ShapeTree {
    let mut shapes = Shapes::default();
    for (value, ring) in stars {
        shapes.add(ShapeKind::Polygon, *value, edges(std::slice::from_ref(ring)).into_iter());
    }
    tree(shapes, values, (paint, EdgeRule::Area), [16, 16], 4)
}

#[test]
fn shares_of_polygons_that_overlap_are_areas_of_their_union() {
    let mut random = Random(6);
    // The last heaps have so many small stars that cells are divided, once and up to the limit.
    let heaps = [(2, 16), (3, 8), (5, 12), (12, 16), (300, 3), (1500, 1)];
    for (round, (count, radius)) in heaps.into_iter().cycle().take(42).enumerate() {
        if count > 1000 && round > 6 {
            continue;
        }
        let grid = [1, PARTS / 2, PARTS / 8][round % 3];
        let stars = heap(&mut random, count, 1, radius, grid);
        let union = union_of(&stars, |_| true).unwrap();
        let found = cells(&heap_tree(&stars, &[1], Paint::Share), [0, 2, 4][round % 3]);
        for (at, value) in found.iter().enumerate() {
            let (x, y) = (at as u64 % 16, at as u64 / 16);
            let area = area_of_cell(&union, [x, y]);
            let share = f64::from(f32::from_le_bytes(value.unwrap().to_bytes()[..4].try_into().unwrap()));
            // Shares are f32, with a rounding error of at most 2^-25. Shares of very many edges are
            // approximated by the middle of slabs.
            let slack = if count > 1000 { 1e-4 } else { 1e-6 };
            assert!((area - share).abs() < slack, "{share}, not {area}, at {x}, {y} of round {round}");
        }
    }
}

#[test]
fn the_largest_share_is_that_of_unions() {
    let mut random = Random(7);
    let mut ties = 0;
    for round in 0..40 {
        let stars = heap(&mut random, 4 + round % 9, 3, 10, [1, PARTS / 8][round as usize % 2]);
        let each: Vec<_> = (0..3).map(|value| union_of(&stars, |of| of == value)).collect();
        let all = union_of(&stars, |_| true).unwrap();
        let found =
            cells(&heap_tree(&stars, &[10, 20, 30], Paint::LargestShare), [0, 2, 4][round as usize % 3]);
        for (at, found) in found.iter().enumerate() {
            let cell = [at as u64 % 16, at as u64 / 16];
            let shares =
                each.iter().map(|union| union.as_ref().map_or(0.0, |union| area_of_cell(union, cell)));
            let shares: Vec<f64> = std::iter::once(1.0 - area_of_cell(&all, cell)).chain(shares).collect();
            let best = (0..4).max_by(|a, b| shares[*a].total_cmp(&shares[*b])).unwrap();
            // Rounding may decide which of two shares is larger.
            if shares.iter().filter(|share| **share > shares[best] - 1e-6).count() > 1 {
                ties += 1;
                continue;
            }
            let expected = (best > 0).then(|| Value::from([10 * best as u32]));
            assert_eq!(*found, expected, "{shares:?} at {cell:?} of round {round}");
        }
    }
    assert!(ties < 500, "{ties}");
}

#[test]
fn what_is_touched_has_some_of_the_shape() {
    let mut random = Random(4);
    for (round, grid) in [1, PARTS / 4, PARTS].into_iter().cycle().take(60).enumerate() {
        let (tree, polygon) = star_tree(&mut random, grid, (Paint::Top, EdgeRule::Touch));
        let found = cells(&tree, [0, 2, 4, 5][round % 4]);
        for (at, value) in found.iter().enumerate() {
            let (x, y) = (at as u64 % 32, at as u64 / 32);
            let area = area_of_cell(&polygon, [x, y]);
            // Below the resolution of grid units, both results are correct.
            if !(1e-15..1e-7).contains(&area) {
                assert_eq!(value.is_some(), area > 0.0, "{area} at {x}, {y} of round {round}");
            }
        }
    }
}

/// Counts the nodes of a tree that are divided, down to blocks of `levels` levels, including those
/// of the blocks.
fn divided(tree: &ShapeTree, code: Code, levels: u8) -> u64 {
    let Child::Inner { node, .. } = tree.node(code).unwrap() else { return 0 };
    if node.level() + levels == tree.depth {
        return 1;
    }
    1 + (0..4).map(|step| divided(tree, node.child(step), levels)).sum::<u64>()
}

/// For polygons thinner than a cell that are 2^29 cells long, only nodes with both covered and
/// other cells are divided, not all nodes that edges cross.
#[test]
fn slivers_are_visited_as_far_as_they_have_cells() {
    let side = (1i64 << 29) * PARTS;
    let of = |rings: &[Ring]| {
        let mut shapes = Shapes::default();
        shapes.add(ShapeKind::Polygon, 0, edges(rings).into_iter());
        tree(shapes, &[7], (Paint::Top, EdgeRule::Centre), [1 << 29; 2], 29)
    };
    let root = Code::root(Dimension::Quad);
    // 2^-16 of a cell wide: flat, steep, along the diagonal and in other directions, between
    // centres.
    let slivers = [
        vec![[0, 3], [side, 4], [side, 5]],
        vec![[3, 0], [5, side], [4, side]],
        vec![[0, 1], [side - 1, side], [side - 2, side]],
        vec![[0, 1], [side, side / 2 + 1], [side, side / 2 + 2]],
        vec![[4, side], [side, 6], [side, 7]],
    ];
    for sliver in &slivers {
        let count = divided(&of(std::slice::from_ref(sliver)), root, 8);
        assert!(count < 500, "{count} nodes of {sliver:?}");
    }
    // One across 2^20 rows that contains the centres of about 8 cells.
    let (top, right) = (side >> 9, (side >> 9) / 1000 * 618);
    let count = divided(&of(&[vec![[7, 11], [right, top], [right - 1, top]]]), root, 8);
    assert!(count < 1000, "{count} nodes");
    // A gap of the same width between two halves of the space, whose sides coincide with those of
    // the space.
    let halves = [
        vec![[0, 0], [side, 0], [side, side / 2 + 1], [0, 1]],
        vec![[0, 1], [side, side / 2 + 2], [side, side], [0, side]],
    ];
    let count = divided(&of(&halves), root, 8);
    assert!(count < 500, "{count} nodes around a gap");
}

#[test]
fn lines_and_points_are_in_the_cells_that_they_meet() {
    let mut shapes = Shapes::default();
    let at = |x: f64, y: f64| [(x * PARTS as f64) as i64, (y * PARTS as f64) as i64];
    let line = |a: [i64; 2], b: [i64; 2]| std::iter::once(Edge { a, b });
    shapes.add(ShapeKind::Line, 0, line(at(0.5, 0.5), at(3.5, 0.5)));
    shapes.add(ShapeKind::Line, 1, line(at(1.0, 2.0), at(1.0, 4.5)));
    shapes.add(ShapeKind::Line, 2, line(at(4.5, 4.5), at(7.5, 7.5)));
    let points = [at(6.2, 0.1), at(6.9, 0.9), at(9.0, 3.0), at(7.0, 1.0)];
    shapes.add(ShapeKind::Points, 3, points.into_iter().map(|point| Edge { a: point, b: point }));
    for levels in 0..=3 {
        let counted = tree(
            Shapes { edges: shapes.edges.clone(), shapes: shapes.shapes.clone(), ..Shapes::default() },
            &[1, 2, 3, 4],
            (Paint::Count, EdgeRule::Centre),
            [8, 8],
            3,
        );
        let found = cells(&counted, levels);
        let counts: Vec<u128> = found
            .iter()
            .map(|value| {
                value.map_or(0, |value| u32::from_le_bytes(value.to_bytes()[..4].try_into().unwrap()).into())
            })
            .collect();
        let rows: Vec<String> =
            counts.chunks(8).map(|row| row.iter().map(u128::to_string).collect()).collect();
        let expected =
            ["11110020", "00000001", "01000000", "01000000", "01001000", "00000100", "00000010", "00000001"];
        assert_eq!(rows, expected, "{levels} levels");
    }
}
