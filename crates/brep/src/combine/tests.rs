//! The algebra of sets, in rational arithmetic: volumes modulo a prime, where every fraction has an
//! exact representation.

use std::collections::HashMap;

use bnum::cast::As;
use bnum::types::I256;

use super::*;
use crate::arrangement::ExactFace;
use crate::exact::normal::ring_normal;
use crate::query::Location;
use crate::{Face, FaceList, LEAF_SIZE};

/// The prime.
const P: i128 = (1 << 61) - 1;

pub(super) type Tetrahedron = [[i32; 3]; 4];

pub(super) fn random(seed: u64) -> impl FnMut(i32) -> i32 {
    let mut state = seed;
    move |below| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 33) as i32).rem_euclid(below)
    }
}

/// Builds and opens a model of triangles.
pub(super) fn model(triangles: &[[[i32; 3]; 3]]) -> ExactModel {
    model_of_leaves(triangles, LEAF_SIZE)
}

/// [`model`] with a given maximum of faces per leaf.
pub(super) fn model_of_leaves(triangles: &[[[i32; 3]; 3]], leaf_size: usize) -> ExactModel {
    model_on(Grid { bits: 26, origin: [0; 3], step: 1.0, divisor: 1.0 }, triangles, leaf_size)
}

/// [`model_of_leaves`] on a given grid.
pub(super) fn model_on(grid: Grid, triangles: &[[[i32; 3]; 3]], leaf_size: usize) -> ExactModel {
    let mut list = FaceList::new(grid.clone(), vec!["body".into()]);
    for (source, points) in (0..).zip(triangles) {
        list.push(&Face { number: 0, points, ring_ends: &[3], colours: &[], part: 0, source });
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.goblin");
    let builder = ModelBuilder::new(Output::create(&path).unwrap(), grid, 64 << 20).unwrap();
    let mut builder = builder.leaf_size(leaf_size);
    list.each(&mut |face| builder.push(face)).unwrap();
    let report = builder.finish(&mut Metadata::default(), &()).unwrap();
    assert_eq!(report.defects, []);
    ExactModel::from_bytes(std::fs::read(path).unwrap()).unwrap()
}

/// A tetrahedron's faces, oriented outwards; `None` if it is flat.
pub(super) fn tetrahedron([a, b, c, d]: Tetrahedron) -> Option<Vec<[[i32; 3]; 3]>> {
    let normal = ring_normal(&[a, b, c]);
    let height: i128 = (0..3).map(|axis| i128::from(normal[axis]) * i128::from(d[axis] - a[axis])).sum();
    let faces = [[a, b, c], [a, d, b], [b, d, c], [c, d, a]];
    match height.signum() {
        0 => None,
        -1 => Some(faces.to_vec()),
        _ => Some(faces.iter().map(|[a, b, c]| [*c, *b, *a]).collect()),
    }
}

/// The result of an operation, written to a file and checked.
pub(super) fn combined(operation: u8, models: &[&ExactModel]) -> ExactModel {
    let model = result(operation, models);
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
    model
}

/// The operation with an index.
pub(super) fn set(index: u8) -> SetOperation {
    SetOperation::from_index(index).unwrap()
}

pub(super) fn result(operation: u8, models: &[&ExactModel]) -> ExactModel {
    ExactModel::from_bytes(result_in(operation, models, 64 << 20)).unwrap()
}

/// The file of an operation's result, computed with a given memory.
pub(super) fn result_in(operation: u8, models: &[&ExactModel], memory: u64) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.goblin");
    combine(set(operation), models, Output::create(&path).unwrap(), Codec::Plain, memory, &())
        .unwrap_or_else(|error| panic!("{operation}: {error}"));
    std::fs::read(path).unwrap()
}

fn reduced(number: I256) -> i128 {
    let prime: I256 = P.as_();
    number.rem_euclid(prime).as_()
}

fn power(mut base: i128, mut exponent: i128) -> i128 {
    let mut result = 1;
    while exponent > 0 {
        if exponent & 1 == 1 {
            result = result * base % P;
        }
        base = base * base % P;
        exponent >>= 1;
    }
    result
}

/// Six times the volume, modulo the prime: the sum of cones over the faces. For an open surface, it
/// depends on the body's position.
pub(super) fn six_volumes(model: &ExactModel) -> i128 {
    let mut sum = 0;
    let mut add = |ring: &[[i128; 3]]| {
        for i in 2..ring.len() {
            let (a, b, c) = (ring[0], ring[i - 1], ring[i]);
            let minor = |u: usize, v: usize| (b[u] * c[v] - b[v] * c[u]).rem_euclid(P);
            let cone = a[0] * minor(1, 2) % P + a[1] * minor(2, 0) % P + a[2] * minor(0, 1) % P;
            sum = (sum + cone) % P;
        }
    };
    model
        .each_face(&mut |face, is_proxy| {
            if !is_proxy {
                for ring in face.rings() {
                    add(&ring.iter().map(|point| point.map(i128::from)).collect::<Vec<_>>());
                }
            }
            Ok(())
        })
        .unwrap();
    let origin = model.grid().origin;
    assert_eq!(origin, [0; 3]);
    let mut exact = Vec::new();
    let mut take = |face| {
        exact.push(face);
        Ok(())
    };
    model.each_exact(&mut take).unwrap();
    for face in &exact {
        for ring in ExactFace::rings(face) {
            let point = |at: &[I256; 3], weight: I256| {
                let inverse = power(reduced(weight), P - 2);
                at.map(|at| reduced(at) * inverse % P)
            };
            add(&ring.iter().map(|corner| point(&corner.point.at, corner.point.weight)).collect::<Vec<_>>());
        }
    }
    sum.rem_euclid(P)
}

/// Random bodies: tetrahedra, some with shared vertices.
fn bodies(seed: u64, far: i32, count: usize) -> Vec<ExactModel> {
    let mut number = random(seed);
    let mut known: Vec<[i32; 3]> = Vec::new();
    let mut found = Vec::new();
    while found.len() < count {
        let corners: Tetrahedron = std::array::from_fn(|_| match number(3) {
            0 if !known.is_empty() => known[number(known.len() as i32) as usize],
            _ => [number(far), number(far), number(far)],
        });
        if let Some(faces) = tetrahedron(corners) {
            known.extend(corners);
            found.push(model(&faces));
        }
    }
    found
}

/// Grid sizes: few points, so that many faces are coplanar, up to the maximum.
const SIZES: [i32; 4] = [4, 9, 1000, (1 << 26) - 1];

/// The surface of a block with a side of 800 grid units: triangles with vertices that are moved a
/// little, in all layers or one.
pub(super) fn block(seed: u64, from: [i32; 3], layer: Option<i32>) -> Vec<[[i32; 3]; 3]> {
    const PARTS: i32 = 10;
    let mut number = random(seed);
    let mut moved: HashMap<[i32; 3], [i32; 3]> = HashMap::new();
    let mut corner = |at: [i32; 3]| {
        *moved.entry(at).or_insert_with(|| {
            let most = if layer.is_none_or(|layer| at[0] == layer) { 31 } else { 1 };
            [0, 1, 2].map(|axis| from[axis] + 800 / PARTS * at[axis] + number(most))
        })
    };
    let mut faces = Vec::new();
    for axis in 0..3 {
        for (side, u, v) in [0, PARTS]
            .into_iter()
            .flat_map(|side| (0..PARTS).flat_map(move |u| (0..PARTS).map(move |v| (side, u, v))))
        {
            let mut at = |u: i32, v: i32| {
                let mut at = [0; 3];
                (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (side, u, v);
                corner(at)
            };
            let [a, b, c, d] = [at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)];
            match side {
                0 => faces.extend([[a, c, b], [a, d, c]]),
                _ => faces.extend([[a, b, c], [a, c, d]]),
            }
        }
    }
    faces
}

#[test]
fn volumes_add_up() {
    for seed in 0..20 {
        let bodies = bodies(seed, SIZES[seed as usize % 4], 2);
        let [a, b] = [&bodies[0], &bodies[1]];
        let volumes: Vec<i128> = (0..16).map(|n| six_volumes(&combined(n, &[a, b]))).collect();
        // (A complement has the negative volume of what it leaves out.)
        for number in 0..16usize {
            let parts = if number & 8 == 0 { number } else { 15 - number };
            let sum: i128 = (0..3).filter(|bit| parts >> bit & 1 == 1).map(|bit| volumes[1 << bit]).sum();
            let expected = if number & 8 == 0 { sum } else { -sum };
            assert_eq!(volumes[number], expected.rem_euclid(P), "{seed}: operation {number}");
        }
        assert_eq!(volumes[3], six_volumes(a), "{seed}");
        assert_eq!((volumes[1] + volumes[7]) % P, (six_volumes(a) + six_volumes(b)) % P, "{seed}");
    }
}

/// Fails unless two bodies are equal.
pub(super) fn assert_same(a: &ExactModel, b: &ExactModel, what: &str) {
    let difference = combined(6, &[a, b]);
    assert_eq!((difference.len(), difference.is_unbounded()), (0, false), "{what}");
    assert_eq!(difference.exact_faces().0, 0, "{what}");
}

#[test]
fn laws_of_sets_hold() {
    for seed in 100..112 {
        let bodies = bodies(seed, SIZES[seed as usize % 4], 3);
        let [a, b, c] = [&bodies[0], &bodies[1], &bodies[2]];
        let what = |law: &str| format!("{seed}: {law}");
        let not = |x: &ExactModel| combined(12, &[x]);
        let (and, or) = (
            |x: &ExactModel, y: &ExactModel| combined(1, &[x, y]),
            |x: &ExactModel, y: &ExactModel| combined(7, &[x, y]),
        );
        // (Operations that several laws need are computed once.)
        let (not_b, a_and_b, a_or_b, b_or_c) = (&not(b), &and(a, b), &or(a, b), &or(b, c));
        let a_minus_b = &combined(2, &[a, b]);
        assert_same(a, a, &what("A xor A"));
        assert_same(&not(a_or_b), &and(&not(a), not_b), &what("De Morgan"));
        assert_same(&or(a, a_and_b), a, &what("absorption"));
        assert_same(&and(a, a_or_b), a, &what("absorption"));
        assert_same(&and(a, b_or_c), &or(a_and_b, &and(a, c)), &what("distribution"));
        assert_same(a_minus_b, &and(a, not_b), &what("difference"));
        assert_same(&or(a_minus_b, a_and_b), a, &what("parts"));
        assert_same(&combined(6, &[&combined(6, &[a, b]), b]), a, &what("xor twice"));
        assert_same(&combined(7, &[a, b, c]), &or(a, b_or_c), &what("union of three"));
        assert_same(&combined(2, &[a, b, c]), &combined(2, &[a_minus_b, c]), &what("minus both"));
    }
}

/// Operations on results, on lattices of few points, where many planes share an edge.
#[test]
fn volumes_of_results_add_up() {
    let of = |corners: Tetrahedron| model(&tetrahedron(corners).unwrap());
    let check = |a: &ExactModel, b: &ExactModel, c: &ExactModel, what: &str| {
        for operation in [1, 2, 6, 7] {
            let x = combined(operation, &[a, b]);
            let [both, any] = [1, 7].map(|operation| six_volumes(&combined(operation, &[&x, c])));
            assert_eq!((both + any) % P, (six_volumes(&x) + six_volumes(c)) % P, "{what}, {operation}");
        }
    };
    check(
        &of([[0, 2, 1], [0, 3, 2], [2, 1, 2], [3, 1, 0]]),
        &of([[0, 0, 1], [1, 1, 3], [2, 3, 3], [3, 2, 2]]),
        &of([[1, 0, 0], [2, 0, 2], [2, 2, 0], [3, 2, 3]]),
        "first",
    );
    check(
        &of([[2, 2, 0], [2, 3, 2], [2, 3, 3], [3, 0, 1]]),
        &of([[0, 0, 2], [0, 2, 3], [1, 2, 3], [3, 2, 0]]),
        &of([[0, 3, 3], [2, 3, 0], [3, 0, 0], [3, 3, 2]]),
        "second",
    );
    for seed in 200..216 {
        let bodies = bodies(seed, [4, 5, 6, 12][seed as usize % 4], 3);
        check(&bodies[0], &bodies[1], &bodies[2], &format!("{seed}"));
    }
}

/// Whether a point, in quarters of a grid unit, is in a tetrahedron with faces as from
/// [`tetrahedron`]; `None` if it is closer than two grid units to one of its planes.
pub(super) fn is_in(faces: &[[[i32; 3]; 3]], point: [i32; 3]) -> Option<bool> {
    let mut is_inside = true;
    for face in faces {
        let normal = ring_normal(face).map(i128::from);
        let height: i128 =
            (0..3).map(|axis| normal[axis] * i128::from(point[axis] - 4 * face[0][axis])).sum();
        let length = normal.iter().map(|part| part * part).sum::<i128>();
        if height * height < 64 * length {
            return None;
        }
        is_inside &= height < 0;
    }
    Some(is_inside)
}

/// Chains of operations: volumes add up each time, and a point is inside if the operations on its
/// states in the operands say so.
#[test]
fn chains_of_operations() {
    const SIDE: i32 = 400;
    for seed in [300, 301] {
        let mut number = random(seed);
        let mut body = |size: i32| loop {
            let from: [i32; 3] = std::array::from_fn(|_| number(SIDE - size + 1));
            let corners: Tetrahedron = std::array::from_fn(|_| from.map(|at| at + number(size)));
            if let Some(faces) = tetrahedron(corners) {
                break faces;
            }
        };
        let first = body(SIDE);
        let mut all = model(&first);
        let mut steps = vec![(7, first)];
        for step in 0..16 {
            let faces = body(if step % 8 == 0 { 300 } else { 120 });
            let other = model(&faces);
            let operation = [7, 7, 2, 6][step % 4];
            let found = combined(operation, &[&all, &other]);
            let [a, b, both] = [&all, &other, &combined(1, &[&all, &other])].map(six_volumes);
            let expected = match operation {
                7 => a + b - both,
                2 => a - both,
                _ => a + b - 2 * both,
            };
            assert_eq!(six_volumes(&found), expected.rem_euclid(P), "{seed}, {step}: operation {operation}");
            all = found;
            steps.push((operation, faces));
        }
        let mut seen = [0; 2];
        for _ in 0..1000 {
            // Near the mean of four vertices of one body.
            let corners = steps[number(steps.len() as i32) as usize].1.as_flattened();
            let chosen: [_; 4] = std::array::from_fn(|_| corners[number(corners.len() as i32) as usize]);
            let point = [0, 1, 2]
                .map(|axis| chosen.iter().map(|corner| corner[axis]).sum::<i32>() + number(121) - 60);
            let are_inside: Option<Vec<bool>> = steps.iter().map(|(_, faces)| is_in(faces, point)).collect();
            let Some(are_inside) = are_inside else { continue };
            let expected =
                steps.iter().zip(are_inside).fold(
                    false,
                    |all, ((operation, _), is_inside)| match operation {
                        7 => all || is_inside,
                        2 => all && !is_inside,
                        _ => all != is_inside,
                    },
                );
            let location = all.locate(point.map(|at| f64::from(at) / 4.0)).unwrap();
            assert_eq!(location == Location::Inside, expected, "{seed}: {point:?} is {location:?}");
            seen[usize::from(expected)] += 1;
        }
        assert!(seen[0] > 30 && seen[1] > 30, "{seed}: {seen:?}");
    }
}

/// Faces far from the other body are not arranged, even if earlier operations left off-grid
/// vertices.
#[test]
fn only_what_is_near_is_arranged() {
    let mut all = model(&block(7, [100; 3], None));
    for (step, at) in
        [[85, 300, 300], [300, 85, 420], [480, 333, 85], [300, 300, 300]].into_iter().enumerate()
    {
        let corner = |more: [i32; 3]| [0, 1, 2].map(|axis| at[axis] + more[axis]);
        let solid = [[0, 0, 0], [61, 3, 2], [2, 59, 5], [4, 1, 63]].map(corner);
        let other = model(&tetrahedron(solid).unwrap());
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("x.goblin");
        // (Too little to divide all faces again.)
        let memory = 512 << 10;
        let report =
            combine(set(2), &[&all, &other], Output::create(&path).unwrap(), Codec::Plain, memory, &())
                .unwrap();
        // (The last operand is within the body, and all its faces are reversed.)
        let expected = if step < 3 { 5..60 } else { 0..1 };
        assert!(expected.contains(&report.near), "{step}: {} of {}", report.near, report.after);
        all = ExactModel::from_bytes(std::fs::read(path).unwrap()).unwrap();
        assert_eq!(all.verify(64 << 20, &()).unwrap(), [], "{step}");
        assert!(report.after > 1200 && all.exact_faces().0 > 0, "{step}");
    }
}

/// Faces of the base are renumbered where some are removed, reversed or kept.
#[test]
fn numbers_of_faces_that_stay_are_those_of_leaves() {
    let bodies: Vec<[[i32; 3]; 3]> = (0..6)
        .flat_map(|place| {
            let corner = |more: [i32; 3]| [1000 * place + more[0] + 100, more[1] + 100, more[2] + 100];
            tetrahedron([[0, 0, 0], [61, 3, 2], [2, 59, 5], [4, 1, 63]].map(corner)).unwrap()
        })
        .collect();
    let all = model(&bodies);
    // Around the second and third body, whose faces have lower numbers than those of the later
    // ones.
    let around = |low: i32, size: i32| {
        let corner = |more: [i32; 3]| [0, 1, 2].map(|axis| [low, 0, 0][axis] + more[axis] * size);
        tetrahedron([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]].map(corner)).unwrap()
    };
    let other = model(&around(1000, 3000));
    for operation in 0..16 {
        let of_both = combined(operation, &[&all, &other]);
        let of_swapped = combined(set(operation).exchanged().index(), &[&other, &all]);
        assert_eq!(of_both.len(), of_swapped.len(), "{operation}");
    }
}

/// Two tetrahedra with a common face, and the coincident faces between the cavities that they leave
/// in another body: the outside is on both sides, and a third body may touch them.
#[test]
fn walls_between_cavities_have_the_outside_on_both_sides() {
    let of = |corners: &[Tetrahedron]| -> ExactModel {
        model(&corners.iter().flat_map(|corners| tetrahedron(*corners).unwrap()).collect::<Vec<_>>())
    };
    let [p, q, r] = [[32, 16, 16], [32, 48, 16], [32, 16, 48]];
    let around = of(&[[[0, 0, 0], [400, 0, 0], [0, 400, 0], [0, 0, 400]]]);
    let cavities = of(&[[p, q, r, [16, 20, 20]], [p, q, r, [48, 20, 20]]]);
    let inside = of(&[[[32, 20, 20], [32, 30, 20], [32, 20, 30], [40, 21, 21]]]);
    let hollow = combined(2, &[&around, &cavities]);
    let sum = (six_volumes(&hollow) + six_volumes(&inside)) % P;
    assert_eq!(six_volumes(&combined(7, &[&hollow, &inside])), sum);
    assert_eq!(combined(1, &[&hollow, &inside]).len(), 0);
}

/// A face between a sample and the end of its leaf, less than the margin of a millionth above the
/// sample, in no cell above: with other leaves, the result is the same.
#[test]
fn faces_next_to_the_end_of_a_leaf_count() {
    const FAR: i32 = 1 << 25;
    // Cells are 128 units wide. At `x`, the body's upper face is just below a wall.
    let x = FAR / 2;
    let of = |corners: Tetrahedron| tetrahedron(corners).unwrap();
    let mut body = of([[0, 0, 127], [FAR, 0, 128], [FAR, 4096, 128], [FAR, 0, 0]]);
    for from in [x - 240, x - 220] {
        body.extend(of([[from, 540, 180], [from + 9, 540, 180], [from, 549, 180], [from, 540, 189]]));
    }
    let below = model(&of([[0, 512, 127], [FAR, 512, 128], [0, 512 + FAR, 126], [0, 512, 0]]));
    let small = [[x - 20, 514, 100], [x - 2, 514, 100], [x - 2, 522, 100], [x - 6, 516, 160]];
    let small = model(&of(small));
    let volume = |leaf_size: usize| {
        let body = model_of_leaves(&body, leaf_size);
        six_volumes(&combined(1, &[&below, &body, &small]))
    };
    assert_eq!(volume(0), volume(LEAF_SIZE));
}
