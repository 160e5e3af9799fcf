//! The algebra of sets, in rational numbers: volumes modulo a prime, where every fraction has its exact place.

use bnum::cast::As;
use bnum::types::I256;

use super::*;
use crate::arrangement::ExactFace;
use crate::exact::normal::ring_normal;
use crate::{Face, FaceList};

/// The prime.
const P: i128 = (1 << 61) - 1;

type Tetrahedron = [[i32; 3]; 4];

fn random(seed: u64) -> impl FnMut(i32) -> i32 {
    let mut state = seed;
    move |below| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 33) as i32).rem_euclid(below)
    }
}

/// A file of triangles, open.
fn model(triangles: &[[[i32; 3]; 3]]) -> ExactModel {
    let grid = Grid { bits: 26, origin: [0; 3], step: 1.0, divisor: 1.0 };
    let mut list = FaceList::new(grid.clone(), vec!["body".into()]);
    for (source, points) in (0..).zip(triangles) {
        list.push(&Face { number: 0, points, ring_ends: &[3], colours: &[], part: 0, source });
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.goblin");
    let mut builder = ModelBuilder::new(Output::create(&path).unwrap(), grid, 64 << 20).unwrap();
    list.each(&mut |face| builder.push(face)).unwrap();
    let report = builder.finish(&mut Metadata::default(), &(), &mut |_, _| ()).unwrap();
    assert_eq!(report.defects, []);
    ExactModel::from_bytes(std::fs::read(path).unwrap()).unwrap()
}

/// A tetrahedron's faces, turned outwards; `None` if it is flat.
fn tetrahedron([a, b, c, d]: Tetrahedron) -> Option<Vec<[[i32; 3]; 3]>> {
    let normal = ring_normal(&[a, b, c]);
    let height: i128 = (0..3).map(|axis| i128::from(normal[axis]) * i128::from(d[axis] - a[axis])).sum();
    let faces = [[a, b, c], [a, d, b], [b, d, c], [c, d, a]];
    match height.signum() {
        0 => None,
        -1 => Some(faces.to_vec()),
        _ => Some(faces.iter().map(|[a, b, c]| [*c, *b, *a]).collect()),
    }
}

fn combined(operation: u8, models: &[&ExactModel]) -> ExactModel {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.goblin");
    combine(operation, models, Output::create(&path).unwrap(), Codec::Plain, 64 << 20, &())
        .unwrap_or_else(|error| panic!("{operation}: {error}"));
    let model = ExactModel::from_bytes(std::fs::read(path).unwrap()).unwrap();
    assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
    model
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

/// Six times the volume, modulo the prime: the sum of cones over the faces. It also depends on where the body lies if the
/// surface is open.
fn six_volumes(model: &ExactModel) -> i128 {
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
        .each_face(&mut |face, stands_in| {
            if !stands_in {
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

/// Random bodies: tetrahedra, some with corners of others.
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

/// Grids of few points, where much is in one plane, and of all.
const SIZES: [i32; 4] = [4, 9, 1000, (1 << 26) - 1];

#[test]
fn volumes_add_up() {
    for seed in 0..20 {
        let bodies = bodies(seed, SIZES[seed as usize % 4], 2);
        let [a, b] = [&bodies[0], &bodies[1]];
        let volumes: Vec<i128> = (0..16).map(|n| six_volumes(&combined(n, &[a, b]))).collect();
        // (A complement has the volume of what it leaves out, as less than nothing.)
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

/// Fails unless two bodies are the same.
fn assert_same(a: &ExactModel, b: &ExactModel, what: &str) {
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
        assert_same(a, a, &what("A xor A"));
        assert_same(&not(&or(a, b)), &and(&not(a), &not(b)), &what("De Morgan"));
        assert_same(&or(a, &and(a, b)), a, &what("absorption"));
        assert_same(&and(a, &or(a, b)), a, &what("absorption"));
        assert_same(&and(a, &or(b, c)), &or(&and(a, b), &and(a, c)), &what("distribution"));
        assert_same(&combined(2, &[a, b]), &and(a, &not(b)), &what("difference"));
        assert_same(&or(&combined(2, &[a, b]), &and(a, b)), a, &what("parts"));
        assert_same(&combined(6, &[&combined(6, &[a, b]), b]), a, &what("xor twice"));
        assert_same(&combined(7, &[a, b, c]), &or(a, &or(b, c)), &what("union of three"));
        assert_same(&combined(2, &[a, b, c]), &combined(2, &[&combined(2, &[a, b]), c]), &what("minus both"));
    }
}

/// Operations on results, on lattices of few points, where many planes go through one edge.
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
