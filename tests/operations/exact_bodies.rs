//! Set operations on exact models in any position: intersections, volumes, and containment of
//! points.

use spinney::brep::Faces;

use crate::common::Random;
use crate::common::exact::{cuboid, prism, turned};
use crate::common::sets::{
    Body, Solid, combined, cut_at_edges, exchanged, holds, tetrahedron, triangulated, try_combined,
};
use crate::common::solid::{Triangle, winding};

/// Operations whose results are checked against each other.
const ALL: std::ops::Range<u8> = 0..16;

fn scaled(faces: &Solid, times: i32) -> Solid {
    mapped(faces, |point| point.map(|at| at * times))
}

fn mapped(faces: &Solid, map: impl Fn([i32; 3]) -> [i32; 3]) -> Solid {
    let ring = |ring: &Vec<[i32; 3]>| ring.iter().copied().map(&map).collect();
    faces.iter().map(|rings| rings.iter().map(ring).collect()).collect()
}

/// Returns the triangles of faces without holes.
fn triangles(faces: &Solid) -> Vec<Triangle> {
    let fan = |ring: &Vec<[i32; 3]>| -> Vec<Triangle> {
        (2..ring.len()).map(|i| [0, i - 1, i].map(|corner| ring[corner].map(f64::from))).collect()
    };
    faces.iter().flat_map(|rings| fan(&rings[0])).collect()
}

/// Results of some operations, which have to be closed.
struct Results<'a> {
    bodies: [&'a Body; 2],
    results: Vec<(u8, Body)>,
}

impl<'a> Results<'a> {
    fn of(bodies: [&'a Body; 2], operations: impl IntoIterator<Item = u8>, name: &str) -> Results<'a> {
        let result = |operation: u8| {
            let (body, report) = try_combined(operation, &bodies)
                .unwrap_or_else(|error| panic!("{name}, operation {operation}: {error}"));
            assert_eq!(body.model.is_unbounded(), operation >= 8, "{name}, operation {operation}");
            assert_eq!(body.model.verify(64 << 20, &()).unwrap(), [], "{name}, operation {operation}");
            assert!(body.edges_cancel(), "{name}, operation {operation}");
            // Features thinner than a grid unit cannot be surfaces on the grid.
            assert!(report.built.defect_count > 0 || body.is_closed(), "{name}, operation {operation}");
            (operation, body)
        };
        Results { bodies, results: operations.into_iter().map(result).collect() }
    }

    fn volume(&self, operation: u8) -> f64 {
        self.results.iter().find(|(known, _)| *known == operation).unwrap().1.volume()
    }

    /// Checks that volumes are sums of those of the three regions (minus the region outside, for
    /// complements), and that the regions add up to both solids.
    fn assert_add_up(&self, name: &str) {
        let [a, b] = self.bodies.map(Body::volume);
        let side = f64::from(1u32 << self.bodies[0].model.grid().bits);
        let least = 1e-9 * (a.abs() + b.abs()) + 1e-15 * side.powi(3);
        let [common, first, second] = [1, 2, 4].map(|operation| self.volume(operation));
        let assert_near = |found: f64, expected: f64, what: &str| {
            assert!((found - expected).abs() <= least, "{name}, {what}: {found} {expected}");
        };
        assert_near(common + first, a, "first");
        assert_near(common + second, b, "second");
        for (operation, body) in &self.results {
            let sum = |table: u8| {
                let parts = [(1, common), (2, first), (4, second)].into_iter();
                parts.filter(|(bit, _)| table & bit > 0).map(|(_, volume)| volume).sum::<f64>()
            };
            let expected = if *operation < 8 { sum(*operation) } else { -sum(15 - operation) };
            assert_near(body.volume(), expected, &format!("operation {operation}"));
        }
    }
}

#[test]
fn bodies_that_touch() {
    let tetrahedron = |corners| tetrahedron(corners).unwrap();
    let [o, p, q, r] = [[10, 20, 30], [70, 10, 50], [30, 90, 20], [40, 40, 100]];
    let first = tetrahedron([o, p, q, r]);
    let middle = |a: [i32; 3], b: [i32; 3]| [0, 1, 2].map(|axis| (a[axis] + b[axis]) / 2);
    // A point on the other side of the face o, p, q.
    let below = [50, 45, -40];
    let cases = [
        ("a face", tetrahedron([o, p, q, below]), 0.0),
        ("half of a face", tetrahedron([o, p, middle(p, q), below]), 0.0),
        ("a face and more", tetrahedron([o, [130, 0, 70], q, below]), 0.0),
        ("a part of a face", tetrahedron([o, middle(o, p), middle(o, q), below]), 0.0),
        ("an edge", tetrahedron([o, p, [0, -60, 0], below]), 0.0),
        ("a part of an edge", tetrahedron([o, middle(o, p), [0, -60, 0], below]), 0.0),
        ("a vertex", tetrahedron([o, [-20, 0, 0], [0, -30, 0], [0, 0, -40]]), 0.0),
        ("a vertex on an edge", tetrahedron([middle(o, p), [50, -60, 0], [60, -50, 10], below]), 0.0),
        ("the same", first.clone(), 1.0),
        ("half of it", tetrahedron([o, p, q, middle(o, r)]), 0.5),
        ("a face from inside", tetrahedron([o, p, q, [40, 45, 40]]), 2.0),
    ];
    for (name, second, share) in cases {
        let shift = |faces: &Solid| scaled(&mapped(faces, |p| p.map(|at| at + 100)), 1 << 6);
        let (a, b) = (Body::of(&shift(&first), 16), Body::of(&shift(&second), 16));
        let results = Results::of([&a, &b], ALL, name);
        results.assert_add_up(name);
        let common = results.volume(1);
        let expected = if share <= 1.0 { share * a.volume() } else { b.volume() };
        assert!((common - expected).abs() < 1e-9 * a.volume(), "{name}: {common} {expected}");
        Results::of([&b, &a], ALL, name).assert_add_up(name);
    }
}

/// Very thin wedges that cross: planes meet far outside of the space, and vertices are close to
/// each other.
#[test]
fn slivers() {
    let far = 1 << 20;
    let wedge = |thick: i32| {
        prism(&[vec![[1000, 1000], [far - 1000, 70_000], [far - 1000, 70_000 + thick]]], 5000, far - 5000)
    };
    let turn = |faces: &Solid| turned(mapped(faces, |[x, y, z]| [y + 300_000, x, z]));
    let lean =
        |faces: &Solid| mapped(&triangulated(faces), |[x, y, z]| [x, y + x / 7 + z / 3, z - x / 5 + 300_000]);
    for thick in [1, 1000] {
        let bodies = [wedge(thick), turn(&wedge(thick)), turn(&wedge(1))].map(|faces| {
            // Between lattice points there is space for thinner features.
            [&faces, &lean(&faces)].map(|faces| Body::of(&scaled(faces, 16), 25))
        });
        for [one, other] in [[0, 1], [1, 2], [0, 2]] {
            for kind in [[0, 0], [1, 1], [0, 1]] {
                let (a, b) = (&bodies[one][kind[0]], &bodies[other][kind[1]]);
                let name = format!("{thick}, {one} and {other}, {kind:?}");
                // Their symmetric differences make an octree of millions of nodes.
                let operations = ALL.filter(|operation| kind == [0, 0] || operation % 15 % 3 != 0);
                Results::of([a, b], operations, &name).assert_add_up(&name);
            }
        }
    }
}

/// Returns the boxes from recursive cuts of a box, in units.
fn parts(random: &mut Random, [low, high]: [[i32; 3]; 2], cuts: u32, found: &mut Vec<[[i32; 3]; 2]>) {
    let axis = random.below(3) as usize;
    let width = high[axis] - low[axis];
    if cuts == 0 || width < 2 {
        found.push([low, high]);
        return;
    }
    let at = low[axis] + 1 + random.below(width as u64 - 1) as i32;
    let put = |point: [i32; 3]| [0, 1, 2].map(|k| if k == axis { at } else { point[k] });
    parts(random, [low, put(high)], cuts - 1, found);
    parts(random, [put(low), high], cuts - 1, found);
}

/// Boxes that fill space without gaps, of which some are selected: walls partially coincide, and
/// edges lie on walls.
#[test]
fn boxes_side_by_side() {
    const SIDE: i32 = 8;
    let mut random = Random(5);
    for case in 0..12 {
        let [a, b] = [0; 2].map(|_: i32| {
            let mut boxes = Vec::new();
            parts(&mut random, [[0; 3], [SIDE; 3]], 1 + case % 5, &mut boxes);
            boxes.retain(|_| random.below(3) > 0);
            let mut faces = Solid::new();
            let mut cells = vec![false; (SIDE * SIDE * SIDE) as usize];
            for [low, high] in boxes {
                for ring in cuboid(low, high).iter_mut().map(|rings| &mut rings[0]) {
                    ring.rotate_left(random.below(4) as usize);
                    let [p, q, r, s] = [0, 1, 2, 3].map(|corner| ring[corner]);
                    match random.below(4) {
                        0 => faces.push(vec![vec![p, q, r, s]]),
                        _ => faces.extend([vec![vec![p, q, r]], vec![vec![p, r, s]]]),
                    }
                }
                for (number, cell) in (0..).zip(&mut cells) {
                    let at = [number % SIDE, number / SIDE % SIDE, number / SIDE / SIDE];
                    *cell |= (0..3).all(|axis| (low[axis]..high[axis]).contains(&at[axis]));
                }
            }
            (Body::of(&scaled(&faces, 64), 10), cells)
        });
        let results = Results::of([&a.0, &b.0], ALL, &format!("round {case}"));
        for operation in 0..8 {
            let both = a.1.iter().zip(&b.1);
            let count = both.filter(|(a, b)| holds(operation, [**a, **b])).count();
            let expected = count as f64 * f64::from(1 << 18);
            let found = results.volume(operation);
            assert!((found - expected).abs() < 1e-3, "{case}, operation {operation}: {found} {expected}");
        }
        results.assert_add_up(&format!("round {case}"));
    }
}

/// Vertices on edges, with faces without area there, near the other solid, far from it and inside
/// it; and coincident faces.
#[test]
fn vertices_on_edges() {
    let mut random = Random(77);
    for case in 0..12 {
        let cut =
            cut_at_edges(&triangulated(&scaled(&cuboid([40, 50, 60], [90, 80, 100]), 60)), 60, &mut random);
        let first = Body::of(&cut, 13);
        let corner = |random: &mut Random| [0; 3].map(|_: i32| 500 + random.below(5000) as i32);
        let low = corner(&mut random);
        let second = match case % 3 {
            0 => random_tetrahedron(&mut random, 1000, 8),
            1 => cuboid(low, low.map(|at| at + 1 + random.below(2000) as i32)),
            _ => cut.clone(),
        };
        let second = Body::of(&second, 13);
        assert!(first.edges_cancel() && second.edges_cancel());
        for (a, b) in [(&first, &second), (&second, &first)] {
            Results::of([a, b], ALL, &format!("round {case}")).assert_add_up(&format!("round {case}"));
        }
    }
}

/// Returns a tetrahedron with vertices on a lattice of `points` points per side, `step` units
/// apart.
fn random_tetrahedron(random: &mut Random, points: u64, step: i32) -> Solid {
    loop {
        let corners = [0; 4].map(|_| [0; 3].map(|_| random.below(points) as i32 * step));
        if let Some(faces) = tetrahedron(corners) {
            return faces;
        }
    }
}

/// Returns tetrahedra, and their union.
fn random_heap(random: &mut Random, points: u64, step: i32, bits: u8) -> (Vec<Vec<Triangle>>, Body) {
    let count = 1 + random.below(4);
    let solids: Vec<Solid> = (0..count).map(|_| random_tetrahedron(random, points, step)).collect();
    let bodies: Vec<Body> = solids.iter().map(|faces| Body::of(faces, bits)).collect();
    let body = match &bodies[..] {
        [_] => bodies.into_iter().next().unwrap(),
        _ => combined(7, &bodies.iter().collect::<Vec<_>>()),
    };
    (solids.iter().map(triangles).collect(), body)
}

/// Checks heaps of tetrahedra on lattices of `points` points per side, in a fine grid.
fn heaps(seed: u64, points: u64, cases: u32) {
    let mut random = Random(seed);
    let mut inside = [0; 4];
    let bits = 20;
    let step = ((1u64 << bits) - 1) / points;
    for case in 0..cases {
        let name = format!("{points}, round {case}");
        let [(solids_a, a), (solids_b, b)] =
            [(); 2].map(|()| random_heap(&mut random, points, step as i32, bits));
        let results = Results::of([&a, &b], [1, 2, 4, 7, 8], &name);
        results.assert_add_up(&name);
        for (operation, result) in results.results {
            for _ in 0..40 {
                let point = [0; 3].map(|_| random.below(points * step * 8) as f64 / 8.0 + 0.0123);
                if result.model.nearest(point).unwrap().is_some_and(|nearest| nearest.distance < 4.0) {
                    continue;
                }
                let is_in = |solids: &[Vec<Triangle>]| solids.iter().any(|solid| winding(solid, point) > 0.5);
                let inside_flags = [is_in(&solids_a), is_in(&solids_b)];
                assert_eq!(
                    result.is_inside(point),
                    holds(operation, inside_flags),
                    "{name}, {operation} at {point:?}"
                );
                inside[usize::from(inside_flags[0]) + 2 * usize::from(inside_flags[1])] += 1;
            }
        }
    }
    assert!(inside.iter().all(|count| *count > 10), "{inside:?}");
}

#[test]
fn heaps_on_lattices() {
    heaps(2, 100, 20);
}

#[test]
fn heaps_on_fine_lattices() {
    heaps(3, 1001, 20);
}

/// Swapping operands in general position gives the same number of faces, and the same volume up to
/// the order of summation.
#[test]
fn the_order_of_bodies_does_not_matter() {
    let mut random = Random(6);
    for case in 0..20 {
        let mut body = || Body::of(&random_tetrahedron(&mut random, 1 << 20, 1), 20);
        let (a, b) = (body(), body());
        for operation in ALL {
            let one = combined(operation, &[&a, &b]);
            let other = combined(exchanged(operation), &[&b, &a]);
            let name = format!("{case}, operation {operation}");
            assert_eq!(one.model.len(), other.model.len(), "{name}");
            let scale = one.volume().abs().max(1.0);
            assert!((one.volume() - other.volume()).abs() <= 1e-14 * scale, "{name}");
        }
    }
}

/// Returns the symmetries of the cube: the source of each axis, and whether it is mirrored.
fn symmetries() -> Vec<([usize; 3], [bool; 3])> {
    let orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let mirrors = (0..8).map(|number| [0, 1, 2].map(|axis| number >> axis & 1 > 0));
    mirrors.flat_map(|mirror| orders.map(|order| (order, mirror))).collect()
}

/// Applies a symmetry to faces in a cube with side `side`.
fn symmetric(faces: &Solid, (order, mirror): ([usize; 3], [bool; 3]), side: i32) -> Solid {
    let faces = mapped(faces, |point| {
        [0, 1, 2].map(|axis| if mirror[axis] { side - point[order[axis]] } else { point[order[axis]] })
    });
    let mirrors = mirror.iter().filter(|is| **is).count();
    let is_odd = (order[1] + 3 - order[0]) % 3 == 2;
    if (mirrors % 2 == 1) != is_odd { turned(faces) } else { faces }
}

#[test]
fn symmetries_of_the_cube_do_not_matter() {
    let side = 1 << 12;
    let mut random = Random(8);
    let mut heap = || -> [Solid; 2] { [(); 2].map(|()| random_tetrahedron(&mut random, 1 << 12, 1)) };
    let boxes =
        || [cuboid([100, 200, 300], [2000, 2500, 2600]), cuboid([1500, 200, 900], [4000, 2600, 2700])];
    for (pair, is_whole) in [(heap(), false), (boxes(), true)] {
        let mut first: Option<Vec<f64>> = None;
        for symmetry in symmetries() {
            let [a, b] = pair.each_ref().map(|faces| Body::of(&symmetric(faces, symmetry, side), 13));
            let volumes: Vec<f64> =
                [1, 2, 7, 8].map(|operation| combined(operation, &[&a, &b]).volume()).to_vec();
            let first = first.get_or_insert_with(|| volumes.clone());
            for (found, expected) in volumes.iter().zip(first) {
                let error = (found - *expected).abs();
                let most = if is_whole { 0.0 } else { 1e-12 * f64::from(side).powi(3) };
                assert!(error <= most, "{symmetry:?}: {found} {expected}");
            }
        }
    }
}

/// Repeated operations on rotated octahedra: numbers keep their width, and files stay small.
#[test]
fn turned_bodies_one_after_the_other() {
    let mut random = Random(12);
    let bits = 16;
    let side = 1u64 << bits;
    let mut octahedron = |size: u64| {
        let centre = [0; 3].map(|_| (size + random.below(side - 2 * size)) as i32);
        let corners: Vec<[i32; 3]> = (0..6)
            .map(|corner| {
                let mut at = centre.map(|at| at + random.below(size / 2) as i32 - (size / 4) as i32);
                let far = (size / 2 + random.below(size / 5)) as i32;
                at[corner / 2] = centre[corner / 2] + if corner % 2 == 0 { far } else { -far };
                at
            })
            .collect();
        let octant = |octant: usize| {
            let [a, b, c] = [0, 1, 2].map(|axis| corners[2 * axis + (octant >> axis & 1)]);
            vec![if octant.count_ones().is_multiple_of(2) { vec![a, b, c] } else { vec![a, c, b] }]
        };
        (0..8).map(octant).collect::<Solid>()
    };
    let first = cuboid([1 << 12; 3], [3 << 14; 3]);
    let mut body = Body::of(&first, bits);
    let points: Vec<[f64; 3]> = {
        let mut random = Random(13);
        (0..300).map(|_| [0; 3].map(|_| random.below(side * 8) as f64 / 8.0 + 0.01)).collect()
    };
    let mut is_in: Vec<bool> = points.iter().map(|point| winding(&triangles(&first), *point) > 0.5).collect();
    let mut most = 0;
    for step in 0..40 {
        let next = octahedron(side / 3);
        let operation = [2, 7][step % 2];
        let walls = triangles(&next);
        for (is_in, point) in is_in.iter_mut().zip(&points) {
            *is_in = holds(operation, [*is_in, winding(&walls, *point) > 0.5]);
        }
        body = combined(operation, &[&body, &Body::of(&next, bits)]);
        most = most.max(body.bytes.len());
        if step % 10 == 9 {
            for (point, expected) in points.iter().zip(&is_in) {
                if body.model.nearest(*point).unwrap().is_some_and(|nearest| nearest.distance > 4.0) {
                    assert_eq!(body.is_inside(*point), *expected, "step {step} at {point:?}");
                }
            }
        }
    }
    println!("{} faces, {most} bytes", body.model.len());
    assert!(most < 2 << 20, "{most} bytes");
}

#[test]
fn heaps_on_coarse_lattices() {
    heaps(1, 11, 20);
}

/// The grid has only the lattice points: new vertices move far, and volumes are still right.
#[test]
fn heaps_on_grids_as_coarse_as_their_lattices() {
    let mut random = Random(4);
    for case in 0..16 {
        let bits = [4, 6, 8, 10][case % 4];
        let mut body = || random_heap(&mut random, 1 << bits, 1, bits).1;
        let (a, b) = (body(), body());
        let name = format!("{bits} bits, round {case}");
        Results::of([&a, &b], ALL, &name).assert_add_up(&name);
    }
}

/// Three tetrahedra on a lattice of four points: the second operation has an operand with off-grid
/// vertices.
#[test]
fn second_operations_on_a_small_lattice() {
    let cases = [
        [
            [[0, 2, 1], [0, 3, 2], [2, 1, 2], [3, 1, 0]],
            [[0, 0, 1], [1, 1, 3], [2, 3, 3], [3, 2, 2]],
            [[1, 0, 0], [2, 0, 2], [2, 2, 0], [3, 2, 3]],
        ],
        [
            [[2, 2, 0], [2, 3, 2], [2, 3, 3], [3, 0, 1]],
            [[0, 0, 2], [0, 2, 3], [1, 2, 3], [3, 2, 0]],
            [[0, 3, 3], [2, 3, 0], [3, 0, 0], [3, 3, 2]],
        ],
    ];
    for (number, bodies) in cases.into_iter().enumerate() {
        let [a, b, c] = bodies.map(|corners| Body::of(&tetrahedron(corners).unwrap(), 2));
        let name = format!("case {number}");
        Results::of([&combined(2, &[&a, &b]), &c], ALL, &name).assert_add_up(&name);
    }
}
