//! Sets every field of blocks of faces with off-grid vertices to malicious values with valid
//! checksums, and random bytes. Files are rejected, or return results and are combined again or
//! rejected.

use std::path::Path;
use std::time::{Duration, Instant};

use spinney::brep::combine;
use spinney::{ExactModel, OpenOptions, Output, SetOperation};

use super::attack_goblin::{Field, changed, fields};
use crate::common::Random;
use crate::common::brep_file::section;
use crate::common::command::{is_alone, own_peak_memory};
use crate::common::exact::{cuboid, model_on, push};
use crate::common::sets::{Body, combined, grid, tetrahedron};
use crate::targets::models::query_model;
use crate::targets::seal::{self, SECTION, SECTIONS, TRAILER};

/// Returns the union of two bodies that intersect in all kinds of planes, with or without colours.
fn crossing(is_coloured: bool) -> Vec<u8> {
    let colour = is_coloured.then_some([1, 2, 3]);
    let of = |faces: Vec<Vec<Vec<[i32; 3]>>>| {
        let mut list = model_on(grid(5), &[]);
        faces.iter().for_each(|rings| push(&mut list, rings, 0, colour));
        Body::of_list(&list)
    };
    let a = of(cuboid([3; 3], [20, 21, 19]));
    let b = of(tetrahedron([[1, 12, 11], [29, 9, 2], [12, 30, 9], [14, 7, 28]]).unwrap());
    combined(7, &[&a, &b]).bytes
}

/// Returns the ranges of the block list and of the only block.
fn list_and_block(file: &[u8]) -> [(usize, usize); 2] {
    let trailer = seal::trailer(file).unwrap();
    let mut sections =
        (0..seal::short(file, trailer + SECTIONS) as usize).map(|i| trailer + TRAILER + SECTION * i);
    let at = sections.find(|at| file[*at..].starts_with(b"EXAC")).unwrap();
    let list = (seal::long(file, at + 8) as usize, seal::long(file, at + 16) as usize);
    assert_eq!(list.1, 24);
    [list, (seal::long(file, list.0 + 8) as usize, seal::short(file, list.0 + 16) as usize)]
}

/// Returns all fields of the list and the block, of the leaves and of the flags of proxy faces.
/// Numbers wider than eight bytes are split.
fn all_fields(file: &[u8]) -> Vec<Field> {
    let [(list, _), (start, length)] = list_and_block(file);
    let count = |word: usize| seal::short(file, start + 4 * word) as usize;
    let [faces, planes, grid_points, vertices, rings, corners] = [0, 1, 2, 3, 4, 5].map(count);
    let [part, product, coordinate, weight] = [28, 29, 30, 31].map(|at| usize::from(file[start + at]));
    let cut = |width: usize| [vec![8; width / 8], vec![1; width % 8]].concat();
    let numbers = |short: usize, long: usize| [vec![cut(short); 3], vec![cut(long)]].concat().concat();
    let mut all = fields("the list", list, &[8, 8, 4, 4]);
    all.extend(fields("the head", start, &[&[4; 7][..], &[1; 4]].concat()));
    let mut at = start + 32;
    let has_colours = count(6) & 1 == 1;
    for (name, times, sizes) in [
        ("a plane", planes, &numbers(part, product)[..]),
        ("a vertex on the grid", grid_points, &[4; 3]),
        ("a vertex", vertices, &numbers(coordinate, weight)),
        ("the plane of a face", faces, &[2]),
        ("a part", if count(6) & 4 == 0 { 1 } else { faces }, &[4]),
        ("a source", faces, &[8]),
        ("the ends of faces", faces, &[4]),
        ("the ends of rings", rings, &[4]),
        ("a corner", corners, &[2, 2]),
        ("a colour", if has_colours { corners } else { 0 }, &[1, 1, 1]),
    ] {
        for _ in 0..times {
            all.extend(fields(name, at, sizes));
            at += sizes.iter().sum::<usize>();
        }
    }
    assert_eq!(at, start + length);
    for (tag, name) in [(b"DIRE", "a segment"), (b"BREP", "the model")] {
        let section = section(file, tag).unwrap();
        let (start, length) = match tag {
            b"DIRE" => (seal::long(section, 8) as usize, seal::short(section, 16) as usize),
            _ => (section.as_ptr() as usize - file.as_ptr() as usize, section.len()),
        };
        all.extend(fields(name, start, &cut(length)));
        all.extend(fields(name, start, &vec![1; length]));
    }
    let trailer = seal::trailer(file).unwrap();
    for section in 0..seal::short(file, trailer + SECTIONS) as usize {
        all.extend(fields("a section", trailer + TRAILER + section * SECTION, &[4, 4, 8, 8]));
    }
    all
}

/// Runs all queries on a file, and combines it with another.
fn query_all(file: Vec<u8>, other: &ExactModel, target: &Path, what: &str) {
    let case = Instant::now();
    query_model(file.clone());
    let opened = ExactModel::from_backend(Path::new("(changed)"), Box::new(file), &OpenOptions::new());
    if let Ok(model) = opened {
        let is_good = model.verify(64 << 20, &()).unwrap().is_empty();
        for (operation, models) in
            [(SetOperation::Union, [&model, other]), (SetOperation::Difference, [other, &model])]
        {
            let result = combine(
                operation,
                &models,
                Output::create(target).unwrap(),
                spinney::Codec::Plain,
                16 << 20,
                &(),
            );
            // If the input is not a closed surface, the operation may fail.
            if result.is_ok() && is_good {
                ExactModel::from_bytes(std::fs::read(target).unwrap()).unwrap();
            }
        }
    }
    assert!(case.elapsed() < Duration::from_secs(10), "{what} took {:?}", case.elapsed());
}

fn attack(test: &str, is_coloured: bool, share: u64) {
    if !is_alone(&format!("attack_exact_faces::{test}")) {
        return;
    }
    let file = crossing(is_coloured);
    let other = Body::of(&cuboid([8; 3], [26, 12, 30]), 5).model;
    let directory = tempfile::tempdir().unwrap();
    let target = directory.path().join("x.goblin");
    let mut random = Random(7);
    let (mut cases, start) = (0u64, Instant::now());
    for field in all_fields(&file) {
        changed(&file, &field, &mut |mut file, what| {
            // A random sample, to limit the run time.
            if random.below(share) == 0 {
                seal::goblin(&mut file);
                query_all(file, &other, &target, &what);
                cases += 1;
            }
        });
    }
    println!("{cases} cases in {:?}", start.elapsed());
    assert!(own_peak_memory() < 256 << 20, "{} bytes", own_peak_memory());
}

#[test]
fn fields_of_exact_faces() {
    attack("fields_of_exact_faces", false, 64);
}

#[test]
fn fields_of_coloured_exact_faces() {
    attack("fields_of_coloured_exact_faces", true, 64);
}

#[test]
fn bytes_at_random() {
    if !is_alone("attack_exact_faces::bytes_at_random") {
        return;
    }
    let good = crossing(true);
    let [_, (start, length)] = list_and_block(&good);
    let other = Body::of(&cuboid([8; 3], [26, 12, 30]), 5).model;
    let directory = tempfile::tempdir().unwrap();
    let target = directory.path().join("x.goblin");
    let mut random = Random(8);
    for round in 0..200 {
        let mut file = good.clone();
        for _ in 0..1 + random.below(4) {
            let at = start + random.below(length as u64) as usize;
            match random.below(4) {
                0 => file[at] = random.next() as u8,
                1 => file[at] = file[at].wrapping_add(1),
                2 => file[at] = 0,
                // A few bytes from another position of the file.
                _ => {
                    let from = start + random.below(length as u64 - 8) as usize;
                    let to = at.min(start + length - 8);
                    file.copy_within(from..from + 8, to);
                }
            }
        }
        seal::goblin(&mut file);
        query_all(file, &other, &target, &format!("round {round}"));
    }
    assert!(own_peak_memory() < 256 << 20, "{} bytes", own_peak_memory());
}
