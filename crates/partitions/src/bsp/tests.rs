use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use spinney_base::SetOperation;
use spinney_base::space::Code;
use spinney_engine::tree::{Child, Source};

use super::*;

/// Sixteen directions around a point, counterclockwise.
const AROUND: [[i32; 2]; 16] = [
    [2, 0],
    [2, 1],
    [2, 2],
    [1, 2],
    [0, 2],
    [-1, 2],
    [-2, 2],
    [-2, 1],
    [-2, 0],
    [-2, -1],
    [-2, -2],
    [-1, -2],
    [0, -2],
    [1, -2],
    [2, -2],
    [2, -1],
];

type Polygon = Vec<Vec<[i32; 2]>>;

/// Star-shaped polygon with or without a hole, within 64 x 64.
fn star() -> impl Strategy<Value = Polygon> {
    let radii = proptest::collection::vec(2i32..8, 16);
    ((20i32..44, 20i32..44), radii, any::<bool>(), any::<bool>()).prop_map(
        |((x, y), radii, has_hole, is_turned)| {
            let at = |[dx, dy]: [i32; 2], radius: i32| [x + radius * dx, y + radius * dy];
            let mut rings = vec![
                AROUND.into_iter().zip(&radii).map(|(way, radius)| at(way, *radius)).collect::<Vec<_>>(),
            ];
            if has_hole {
                rings.push(AROUND.into_iter().map(|way| at(way, 1)).collect());
            }
            if is_turned {
                rings.iter_mut().for_each(|ring| ring.reverse());
            }
            rings
        },
    )
}

/// Whether a point is inside of rings, by the even-odd rule; `None` for points on a ring.
fn is_inside(rings: &[Vec<[f64; 2]>], [px, py]: [f64; 2]) -> Option<bool> {
    let mut inside = false;
    for ring in rings {
        for ([ax, ay], [bx, by]) in ring.iter().copied().zip(ring.iter().copied().cycle().skip(1)) {
            let turn = (bx - ax) * (py - ay) - (by - ay) * (px - ax);
            let length = (bx - ax).hypot(by - ay);
            let is_within_extent =
                px.clamp(ax.min(bx), ax.max(bx)) == px && py.clamp(ay.min(by), ay.max(by)) == py;
            if turn.abs() < 1e-6 * length && is_within_extent {
                return None;
            }
            if (ay > py) != (by > py) && (turn > 0.0) == (by > ay) {
                inside = !inside;
            }
        }
    }
    Some(inside)
}

fn rings_of(polygon: &Polygon) -> Vec<Vec<[f64; 2]>> {
    polygon.iter().map(|ring| ring.iter().map(|corner| corner.map(f64::from)).collect()).collect()
}

fn area(rings: &[Vec<[f64; 2]>]) -> f64 {
    let edges = rings.iter().flat_map(|ring| ring.iter().zip(ring.iter().cycle().skip(1)));
    edges.map(|([ax, ay], [bx, by])| (ax * by - ay * bx) / 2.0).sum()
}

/// Centres of grid cells, few of which lie on lines.
fn sample_points() -> impl Iterator<Item = [f64; 2]> {
    (0..64 * 64).map(|i| [f64::from(i % 64) + 0.5, f64::from(i / 64) + 0.5])
}

fn has(tree: &Bsp, point: [f64; 2]) -> bool {
    matches!(
        tree.nodes[tree.leaf_at([point[0], point[1], 0.0].map(|at| (2.0 * at) as i128))],
        BinaryNode::Leaf(true)
    )
}

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(14),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(config(24))]

    /// Trees have the inside of their polygons, and all sixteen operations match their definition
    /// at every point.
    #[test]
    fn operations_match_their_definition_at_points(a in star(), b in star()) {
        let trees = [&a, &b].map(|polygon| Bsp::of_polygons(std::slice::from_ref(polygon)).unwrap());
        let rings = [&a, &b].map(rings_of);
        let known: Vec<_> = sample_points().filter_map(|point| {
            Some((point, is_inside(&rings[0], point)?, is_inside(&rings[1], point)?))
        }).collect();
        prop_assert!(known.len() > 3000);
        for (point, in_a, in_b) in &known {
            prop_assert_eq!([has(&trees[0], *point), has(&trees[1], *point)], [*in_a, *in_b], "{:?}", point);
        }
        for operation in SetOperation::ALL {
            let made = trees[0].combine(&trees[1], operation, &()).unwrap();
            for (point, in_a, in_b) in &known {
                prop_assert_eq!(has(&made, *point), operation.contains(*in_a, *in_b), "{} {:?}", operation, point);
            }
            prop_assert_eq!(has(&made.complement(), known[0].0), !has(&made, known[0].0));
        }
    }

    /// Outlines have the area and the points of the inside, and trees built from them have the same
    /// outlines.
    #[test]
    fn outlines_bound_the_inside(a in star(), b in star()) {
        let trees = [&a, &b].map(|polygon| Bsp::of_polygons(std::slice::from_ref(polygon)).unwrap());
        let outlines = trees.each_ref().map(|tree| tree.outlines().unwrap());
        for (polygon, outlines) in [&a, &b].into_iter().zip(&outlines) {
            prop_assert_eq!(outlines.len(), polygon.len());
            let twice: f64 = rings_of(polygon).iter().enumerate().map(|(i, ring)| {
                let area = area(std::slice::from_ref(ring)).abs();
                if i == 0 { area } else { -area }
            }).sum();
            prop_assert_eq!(area(outlines), twice);
        }
        let operations = [SetOperation::Union, SetOperation::Intersection, SetOperation::Difference, SetOperation::ReverseDifference];
        let joined = operations.map(|operation| trees[0].combine(&trees[1], operation, &()).unwrap().outlines().unwrap());
        for ring in joined.iter().flatten() {
            let points: std::collections::HashSet<_> = ring.iter().map(|corner| corner.map(f64::to_bits)).collect();
            prop_assert_eq!(points.len(), ring.len(), "a ring that touches itself");
        }
        let [union, both, one, other] = joined.each_ref().map(|rings| area(rings));
        prop_assert!((union - both - one - other).abs() < 1e-6);
        prop_assert!((both + one - area(&outlines[0])).abs() < 1e-6);
        prop_assert!((both + other - area(&outlines[1])).abs() < 1e-6);
        let rings = [&a, &b].map(rings_of);
        for point in sample_points() {
            let (Some(in_a), Some(in_b)) = (is_inside(&rings[0], point), is_inside(&rings[1], point)) else { continue };
            prop_assert_eq!(is_inside(&joined[1], point), Some(in_a && in_b), "{:?}", point);
            prop_assert_eq!(is_inside(&joined[2], point), Some(in_a && !in_b), "{:?}", point);
        }
    }

    /// Quadtree cells are those whose centres are inside, and blocks match their cells.
    #[test]
    fn blocks_match_their_cells(a in star()) {
        let tree = Bsp::of_polygons(std::slice::from_ref(&a)).unwrap();
        let blocks = tree.blocks(6).unwrap();
        let mut pending = vec![(Code::root(Dimension::Quad), blocks.root().unwrap())];
        while let Some((code, child)) = pending.pop() {
            if let Child::Inner { node, .. } = child {
                let mut children = spinney_engine::tree::no_children();
                blocks.children(&node, &mut children).unwrap();
                pending.extend((0..4).map(|step| (code.child(step), children[step])));
                continue;
            }
            let bounds = code.bounds(6);
            for (x, y) in (bounds.min[0]..bounds.max[0]).flat_map(|x| (bounds.min[1]..bounds.max[1]).map(move |y| (x, y))) {
                let point = [x as f64 + 0.5, y as f64 + 0.5];
                let expected = is_inside(&rings_of(&a), point);
                prop_assert!(expected.is_none_or(|expected| child.value().is_some() == expected), "{:?}", point);
            }
        }
    }

    /// Fragments along any line of sight come from the farthest to the nearest.
    #[test]
    fn fragments_are_ordered_from_back_to_front(ends in proptest::collection::vec([0i32..40, 0..40, 0..40, 0..40], 1..25), eye in [0i32..40, 0..40]) {
        let segments: Vec<_> = ends.iter().map(|[a, b, c, d]| [[*a, *b], [*c, *d]]).filter(|[p, q]| p != q).collect();
        let tree = Bsp::of_segments(&segments).unwrap();
        let mut seen: Vec<[[f64; 2]; 2]> = Vec::new();
        let mut lengths = vec![0.0; segments.len()];
        let mut cells = 0;
        tree.back_to_front([eye[0], eye[1], 0], &mut |what| match what {
            BspItem::Cell(node, is_inside) => {
                assert!(!is_inside && matches!(tree.nodes()[node], BinaryNode::Leaf(false)));
                cells += 1;
            }
            BspItem::Fragment(fragment) => {
                let corners = tree.corners(fragment);
                let [from, to] = [0, 1].map(|end: usize| [corners[end][0], corners[end][1]]);
                lengths[fragment.source] += (to[0] - from[0]).hypot(to[1] - from[1]);
                seen.push([from, to]);
            }
        });
        prop_assert_eq!(cells, tree.nodes().len() / 2 + 1);
        for ([p, q], length) in segments.iter().zip(&lengths) {
            prop_assert!((f64::from(q[0] - p[0]).hypot(f64::from(q[1] - p[1])) - length).abs() < 1e-5);
        }
        let eye = eye.map(f64::from);
        for step in 0..180 {
            let way = [f64::from(step).to_radians().cos(), f64::from(step).to_radians().sin()];
            for sign in [-1.0, 1.0] {
                let way = way.map(|part| part * sign);
                let mut before = f64::INFINITY;
                for [[ax, ay], [bx, by]] in &seen {
                    let along = [bx - ax, by - ay];
                    let across = way[0] * along[1] - way[1] * along[0];
                    let (from_x, from_y) = (ax - eye[0], ay - eye[1]);
                    let distance = (from_x * along[1] - from_y * along[0]) / across;
                    let share = (from_x * way[1] - from_y * way[0]) / across;
                    if across.abs() > 1e-9 && distance > 1e-6 && (0.0..=1.0).contains(&share) {
                        prop_assert!(distance <= before + 1e-5, "{distance} after {before}");
                        before = distance;
                    }
                }
            }
        }
    }
}

fn cuboid([x, y, z]: [i32; 3], [dx, dy, dz]: [i32; 3]) -> Vec<Vec<Vec<[i32; 3]>>> {
    let corner = |bits: usize| {
        [x + (bits as i32 & 1) * dx, y + (bits as i32 >> 1 & 1) * dy, z + (bits as i32 >> 2) * dz]
    };
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    sides.map(|side| vec![side.map(corner).to_vec()]).to_vec()
}

/// Cuboid with a shaft through it, so that two of its faces have holes.
fn frame() -> Vec<Vec<Vec<[i32; 3]>>> {
    let mut faces = cuboid([1, 1, 1], [12, 12, 6]);
    let shaft = cuboid([4, 5, 1], [5, 3, 6]);
    // The shaft's ends are holes in the cuboid's faces; its sides are reversed.
    for (side, mut ring) in shaft.into_iter().map(|mut rings| rings.remove(0)).enumerate() {
        ring.reverse();
        match side {
            4 | 5 => faces[side].push(ring),
            _ => faces.push(vec![ring]),
        }
    }
    faces
}

/// Solid with slanted faces.
fn octahedron([x, y, z]: [i32; 3], radius: i32) -> Vec<Vec<Vec<[i32; 3]>>> {
    let mut faces = Vec::new();
    for bits in 0..8 {
        let signs = [0, 1, 2].map(|axis| if bits >> axis & 1 == 1 { -radius } else { radius });
        let mut ring = vec![[x + signs[0], y, z], [x, y + signs[1], z], [x, y, z + signs[2]]];
        if signs.iter().product::<i32>() < 0 {
            ring.reverse();
        }
        faces.push(vec![ring]);
    }
    faces
}

/// Solids, their set operations and their octrees, checked pointwise.
#[test]
fn trees_of_faces_have_the_inside_of_the_bodies() {
    let frame = Bsp::of_faces(&frame()).unwrap();
    let octahedron = Bsp::of_faces(&octahedron([8, 8, 8], 6)).unwrap();
    let between = |at: i32, from: i32, to: i32| 2 * from < at && at < 2 * to;
    let in_frame = |[x, y, z]: [i32; 3]| {
        let in_shaft = between(x, 4, 9) && between(y, 5, 8);
        between(x, 1, 13) && between(y, 1, 13) && between(z, 1, 7) && !in_shaft
    };
    // Cell centres lie on no face, since the sum of three odd numbers is odd.
    let in_octahedron = |at: [i32; 3]| at.iter().map(|at| (at - 16).abs()).sum::<i32>() < 12;
    for operation in SetOperation::ALL {
        let made = frame.combine(&octahedron, operation, &()).unwrap();
        let blocks = made.blocks(4).unwrap();
        let whole =
            spinney_engine::tree::MemTree::from_source(&blocks, spinney_base::value::Rule::Nearest).unwrap();
        for cell in 0..4096u32 {
            let cell = [cell & 15, cell >> 4 & 15, cell >> 8];
            let centre = cell.map(|at| 2 * at as i32 + 1);
            let (a, b) = (in_frame(centre), in_octahedron(centre));
            let expected = operation.contains(a, b);
            let code = Code::from_cell(Dimension::Oct, 4, cell).unwrap();
            assert_eq!(whole.value_at(code).is_some(), expected, "{operation} {cell:?}");
        }
    }
    assert!(frame.is_inside([2, 2, 2]) && !frame.is_inside([5, 6, 4]) && !frame.is_inside([0, 0, 0]));
}

/// Regions stay closed polyhedra after any number of cuts, and the fragments fill the region's
/// volume.
#[test]
fn cut_regions_are_polyhedra_that_fill_the_region() {
    let volume = |region: &region::Region| region.volume();
    let mut state = 7u64;
    let mut next = |below: u64| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 33) % below) as i32
    };
    for _ in 0..40 {
        let whole = region::Region::of_box([0, 0, 0], [16, 16, 16]);
        let mut parts = vec![whole];
        for _ in 0..6 {
            let normal = [0; 3].map(|_: i64| i64::from(next(7) - 3));
            let plane = ExactPlane::through([0; 3].map(|_: i32| 4 + next(9)), normal);
            parts = parts
                .into_iter()
                .flat_map(|part| match part.sides(&plane) {
                    [true, true] => part.cut(&plane).0.to_vec(),
                    _ => vec![part],
                })
                .collect();
        }
        let sum: f64 = parts.iter().map(volume).sum();
        assert!((sum - 4096.0).abs() < 1e-6, "{sum}");
        assert!(parts.iter().all(|part| part.euler() == 2 && part.volume() > 0.0));
    }
}

#[test]
fn shapes_that_bound_no_body_are_rejected() {
    let error = |result: spinney_base::Result<Bsp>| result.unwrap_err().to_string();
    assert!(error(Bsp::of_segments(&[[[1, 2], [1, 2]]])).contains("segment 0: got the point 1, 2"));
    assert!(error(Bsp::of_segments(&[[[1, 2], [1, -2]]])).contains("a vertex at [1, -2, 0]"));
    assert!(
        error(Bsp::of_polygons(&[vec![vec![[0, 0], [1 << 26, 0], [5, 5]]]]))
            .contains("coordinates from 0 to 67108863")
    );
    let polygon =
        |rings: &[&[[i32; 2]]]| Bsp::of_polygons(&[rings.iter().map(|ring| ring.to_vec()).collect()]);
    // Bow tie, squares that cross, a hole outside, a hole along the rim.
    let square = |x: i32, y: i32| [[x, y], [x + 4, y], [x + 4, y + 4], [x, y + 4]];
    let two = |other: [[i32; 2]; 4]| Bsp::of_polygons(&[vec![square(1, 1).to_vec()], vec![other.to_vec()]]);
    for bad in [
        polygon(&[&[[0, 0], [8, 8], [8, 0], [0, 8]]]),
        two(square(3, 3)),
        two(square(2, 2)),
        polygon(&[&square(1, 1), &square(7, 7)]),
        polygon(&[&square(1, 1), &[[1, 2], [2, 2], [2, 4], [1, 4]]]),
    ] {
        assert!(error(bad).contains("a gap, crossing or overlap near"));
    }
    let line = polygon(&[&[[0, 0], [8, 8]]]);
    assert!(error(line).contains("an inside that extends beyond the grid"));
    // Polygons may touch: of the common edge, nothing stays. Duplicates count once.
    assert_eq!(
        two(square(5, 1)).unwrap().outlines().unwrap(),
        [[[1.0, 1.0], [9.0, 1.0], [9.0, 5.0], [1.0, 5.0]]]
    );
    assert_eq!(two(square(5, 2)).unwrap().outlines().unwrap()[0].len(), 8);
    assert_eq!(two(square(1, 1)).unwrap().outlines().unwrap().len(), 1);
    assert_eq!(two(square(5, 5)).unwrap().outlines().unwrap().len(), 2);
    assert_eq!(polygon(&[&square(0, 0), &[[0, 0], [2, 1], [1, 2]]]).unwrap().outlines().unwrap().len(), 2);
    assert_eq!(polygon(&[]).unwrap().nodes().len(), 1);
    let mut open = cuboid([1; 3], [5; 3]);
    open.pop();
    assert!(error(Bsp::of_faces(&open)).contains("a gap, crossing or overlap near"));
    let flat = vec![vec![[0, 0, 0], [1, 1, 1], [2, 2, 2], [3, 3, 3]]];
    assert!(error(Bsp::of_faces(&[flat])).contains("face 0"));
    let (plane, space) = (Bsp::of_segments(&[]).unwrap(), Bsp::of_faces(&[]).unwrap());
    assert!(plane.combine(&space, SetOperation::Union, &()).is_err());
    assert!(space.outlines().is_err() && plane.complement().outlines().unwrap().is_empty());
    assert!(plane.blocks(27).is_err() && space.blocks(20).is_err());
}
