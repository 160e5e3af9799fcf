//! Chains of operations from file to file, each of which changes few faces of a model: blocks and
//! segments of all others are copied.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use super::tests::{Tetrahedron, is_in, model, random, set, tetrahedron};
use super::*;
use crate::query::Location;

const SIDE: i32 = 400;
const DIFFERENCE: u8 = 2;
const UNION: u8 = 7;

type Triangles = Vec<[[i32; 3]; 3]>;

/// A tetrahedron that is small against the space.
fn tool(number: &mut impl FnMut(i32) -> i32) -> Triangles {
    let [x, y, z] = [0; 3].map(|_| number(SIDE - 20));
    let s = 30 + number(50);
    let corners: Tetrahedron =
        [[x, y, z], [x + s, y + 1, z + 2], [x + 2, y + s, z + 1], [x + 1, y + 2, z + s]];
    tetrahedron(corners).unwrap()
}

/// A box around most of the space.
fn cube() -> Triangles {
    let at = |corner: usize| [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { SIDE } else { 10 });
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|face| face.map(at)).collect()
}

/// Writes the result of an operation; returns the bytes of the file.
fn written(operation: u8, models: [&ExactModel; 2], codec: Codec, memory: u64) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.goblin");
    let output = Output::create(&path).unwrap();
    combine(set(operation), &models, output, codec, memory, &()).unwrap();
    std::fs::read(path).unwrap()
}

/// The classification of points by a chain's result is that of the operations applied to each
/// body's classification; and at every stage, stored sums and octree are those of the faces (which
/// `verify` computes), whatever was copied.
fn check_chain(first: Triangles, operations: &[u8], codec: Codec, seed: u64) {
    const COUNT: usize = 48;
    let mut number = random(seed);
    let mut all = model(&first);
    let mut steps = vec![(UNION, first)];
    for step in 0..COUNT {
        let faces = tool(&mut number);
        let (operation, other) = (operations[step % operations.len()], model(&faces));
        let bytes = written(operation, [&all, &other], codec, 64 << 20);
        if step % 12 == 11 {
            for memory in [8 << 20, 256 << 20] {
                assert!(bytes == written(operation, [&all, &other], codec, memory), "{seed}, {step}");
            }
        }
        all = ExactModel::from_bytes(bytes).unwrap();
        if step % 6 == 5 {
            assert_eq!(all.verify(64 << 20, &()).unwrap(), [], "{seed}, {step}");
        }
        steps.push((operation, faces));
    }
    assert!(all.exact_faces().0 > 25, "{seed}: {:?}", all.exact_faces());
    // Blocks do not become smaller with each operation.
    let [exact, faces] = [&all.exact_faces().0, &all.len()].map(|count| count / 8 + 2);
    let mut blocks = [0u64; 2];
    all.each_exact_block(&mut |_, _| {
        blocks[0] += 1;
        Ok(())
    })
    .unwrap();
    all.each_block(&mut |_, _| {
        blocks[1] += 1;
        Ok(())
    })
    .unwrap();
    assert!(blocks[0] <= exact && blocks[1] <= faces, "{seed}: {blocks:?} of {exact} and {faces}");
    let mut seen = [0; 2];
    for _ in 0..4000 {
        // Near the mean of four vertices of one body.
        let corners = steps[number(steps.len() as i32) as usize].1.as_flattened();
        let chosen: [_; 4] = std::array::from_fn(|_| corners[number(corners.len() as i32) as usize]);
        let point =
            [0, 1, 2].map(|axis| chosen.iter().map(|corner| corner[axis]).sum::<i32>() + number(61) - 30);
        let are_inside: Option<Vec<bool>> = steps.iter().map(|(_, faces)| is_in(faces, point)).collect();
        let Some(are_inside) = are_inside else { continue };
        let expected =
            steps.iter().zip(are_inside).fold(false, |all, ((operation, _), is_inside)| match *operation {
                UNION => all || is_inside,
                _ => all && !is_inside,
            });
        let location = all.locate(point.map(|at| f64::from(at) / 4.0)).unwrap();
        assert_eq!(location == Location::Inside, expected, "{seed}: {point:?} is {location:?}");
        seen[usize::from(expected)] += 1;
    }
    assert!(seen[0] > 20 && seen[1] > 20, "{seed}: {seen:?}");
}

#[test]
fn tetrahedra_taken_from_a_box() {
    check_chain(cube(), &[DIFFERENCE], Codec::Plain, 1);
}

#[test]
fn tetrahedra_united_and_taken_away() {
    let first = tool(&mut random(2));
    check_chain(first, &[UNION, UNION, DIFFERENCE], Codec::Plain, 3);
}

#[test]
fn packed_chains() {
    check_chain(cube(), &[DIFFERENCE, DIFFERENCE, UNION], Codec::Packed, 4);
}

/// Cancels after a number of checks.
struct Impatient {
    patience: u64,
    checks: AtomicU64,
}

impl Progress for Impatient {
    fn interrupted(&self) -> bool {
        self.checks.fetch_add(1, Ordering::Relaxed) >= self.patience
    }
}

/// A cancelled operation of a chain leaves the last result, and no other file; the chain can go on.
#[test]
fn cancelled_operations_keep_the_last_result() {
    let mut number = random(5);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("whole.goblin");
    let mut all = model(&cube());
    let run = |all: &ExactModel, other: &ExactModel, path: &Path, patience: u64| {
        let progress = Impatient { patience, checks: AtomicU64::new(0) };
        let output = Output::create(path).unwrap();
        let done = combine(set(DIFFERENCE), &[all, other], output, Codec::Plain, 64 << 20, &progress);
        (done.map(|_| ()), progress.checks.into_inner())
    };
    for step in 0..12 {
        let other = model(&tool(&mut number));
        let before = if step == 0 { None } else { Some(std::fs::read(&path).unwrap()) };
        let (done, checks) = run(&all, &other, &directory.path().join("other.goblin"), u64::MAX);
        done.unwrap();
        let expected = std::fs::read(directory.path().join("other.goblin")).unwrap();
        std::fs::remove_file(directory.path().join("other.goblin")).unwrap();
        if let Some(before) = &before {
            for patience in [0, 1, checks / 3, checks / 2, checks - 2, checks - 1] {
                let (done, _) = run(&all, &other, &path, patience);
                assert!(matches!(done, Err(Error::Interrupted)), "{step}, {patience} of {checks}: {done:?}");
                assert!(std::fs::read(&path).unwrap() == *before, "{step}, {patience}");
                assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1, "{step}, {patience}");
            }
        }
        run(&all, &other, &path, u64::MAX).0.unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes == expected, "{step}");
        all = ExactModel::from_bytes(bytes).unwrap();
    }
    assert_eq!(all.verify(64 << 20, &()).unwrap(), []);
}
