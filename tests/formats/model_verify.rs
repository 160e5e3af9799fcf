//! Verification of exact models: single changes to valid files, with valid checksums, are found and
//! reported by their nature. Files that pass verification give results that pass it.

use spinney::brep::combine;
use spinney::{ExactModel, Output, SetOperation};

use super::attack_model::{CROSSINGS, house, one_leaf, tetrahedron};
use crate::common::Random;
use crate::common::brep_file::BrepFile;
use crate::common::command::is_alone;
use crate::common::exact::{cuboid, turned};
use crate::common::sets::Body;
use crate::targets::seal;

/// Faces as rings of vertices.
type Faces = Vec<Vec<Vec<[i32; 3]>>>;

const MEMORY: u64 = 1 << 20;

/// Returns the findings of a file as text.
fn findings(file: &BrepFile) -> String {
    let found = ExactModel::from_bytes(file.bytes()).unwrap().verify(MEMORY, &()).unwrap();
    found.iter().map(|finding| format!("{}: {}\n", finding.place, finding.problem)).collect()
}

/// Offsets of the words and of the leaves of a segment.
fn lists(segment: &[u8]) -> (usize, usize) {
    let words = 16 + 4 * (seal::short(segment, 0) + seal::short(segment, 4)) as usize;
    (words, words + 4 * seal::short(segment, 8) as usize)
}

/// Returns a segment's first word with a state.
fn word_of(segment: &[u8], state: u32) -> usize {
    let (words, leaves) = lists(segment);
    (words..leaves).step_by(4).find(|at| seal::short(segment, *at) & 7 == state).unwrap()
}

#[test]
fn nodes_that_are_not_those_of_the_faces_are_found() {
    let good = BrepFile::of(&house(4));
    assert_eq!(findings(&good), "");
    let changed = |change: &dyn Fn(&mut Vec<u8>), expected: &str| {
        let mut file = good.clone();
        change(&mut file.segments[0].1);
        let found = findings(&file);
        assert!(found.starts_with("node ") && found.contains(expected), "{expected}: {found}");
    };
    changed(
        &|segment| {
            let at = word_of(segment, 0);
            segment[at] = 1;
        },
        "is FULL, expected VOID from the faces",
    );
    changed(
        &|segment| {
            let at = word_of(segment, 1);
            segment[at] = 0;
        },
        "is VOID, expected FULL from the faces",
    );
    changed(
        &|segment| {
            let at = lists(segment).1;
            segment[at] ^= 16;
        },
        "a leaf whose minimum corner is",
    );
    changed(
        &|segment| {
            let at = lists(segment).1;
            segment[at] ^= 1;
        },
        "a leaf of kind",
    );
    changed(
        &|segment| {
            let at = lists(segment).1;
            let rule = segment[at] >> 2 & 3;
            segment[at] = segment[at] & !12 | if rule == 0 { 1 << 2 } else { 0 };
        },
        "a leaf with the rule",
    );
    // Replace a face of the first leaf.
    changed(
        &|segment| {
            let faces = seal::short(segment, 0) as usize;
            let used: Vec<u32> = (0..faces).map(|face| seal::short(segment, 16 + 4 * face)).collect();
            let other = (0..200).find(|face| !used.contains(face));
            // All faces are present: swap two.
            match other.filter(|face| *face < 16) {
                Some(face) => seal::set_short(segment, 16, face),
                None => {
                    seal::set_short(segment, 16, used[faces - 1]);
                    seal::set_short(segment, 16 + 4 * (faces - 1), used[0]);
                }
            }
        },
        "a leaf with",
    );
    let mut file = good.clone();
    file.model[56] ^= 1;
    assert!(findings(&file).starts_with("model: "), "{}", findings(&file));
    // Outside becomes inside.
    let mut file = good;
    file.model[1] = 1;
    assert!(findings(&file).contains("from the faces around it"), "{}", findings(&file));
}

#[test]
fn invalid_faces_are_detected() {
    let cube = cuboid([2; 3], [9; 3]);
    let of = |faces: &[Vec<Vec<[i32; 3]>>], head: u8| findings(&one_leaf(4, faces, head));
    assert_eq!(of(&cube, CROSSINGS), "");
    let changed = |change: &dyn Fn(&mut Faces), expected: &str| {
        let mut faces = cube.clone();
        change(&mut faces);
        let found = of(&faces, CROSSINGS);
        assert!(found.contains(expected), "{expected}: {found}");
    };
    changed(&|faces| faces[0][0][1][2] += 1, "expected all vertices in one plane");
    changed(
        &|faces| {
            faces[0][0].swap(0, 1);
            // The halves of a bow tie would cancel.
            faces[0][0][0][0] = 5;
        },
        "rings that cross",
    );
    changed(&|faces| faces[0][0].reverse(), "2 times more often than its reverse");
    changed(&|faces| drop(faces.pop()), "1 times more often than its reverse");
    changed(&|faces| *faces = turned(faces.clone()), "winding number -1, expected 0 or 1, at ");
    changed(&|faces| faces.extend(cuboid([4; 3], [7; 3])), "winding number 2, expected 0 or 1, at ");
    changed(&|faces| faces.extend(cuboid([4; 3], [12; 3])), "faces that intersect at ");
    changed(&|faces| faces.extend(cuboid([2; 3], [9; 3])), "faces that overlap at ");
}

/// Also with vertices at multiples of 16, where sample points of faces lie on cell walls.
#[test]
fn cubes_that_are_inside_out_are_found() {
    for side in [15, 16, 32, 48] {
        let cube = turned(cuboid([0; 3], [side; 3]));
        let list = crate::common::exact::model_on(crate::common::sets::grid(6), &cube);
        let (file, report) = crate::common::exact::built(&list, MEMORY, 12);
        assert!(file.is_none() && report.defect_count > 0, "{side}");
    }
}

/// Models with random bytes changed, with valid checksums: files that pass verification give
/// results that pass it, and other failures are errors. Octrees are trusted where no face changes,
/// so results of invalid files may be equally invalid.
#[test]
fn results_of_valid_models_are_valid() {
    if !is_alone("model_verify::results_of_valid_models_are_valid") {
        return;
    }
    let other = Body::of(&cuboid([3; 3], [12, 9, 14]), 4).model;
    let directory = tempfile::tempdir().unwrap();
    let target = directory.path().join("x.goblin");
    let files = [house(4), tetrahedron(4), Body::of(&cuboid([2; 3], [9; 3]), 4).bytes];
    let mut random = Random(21);
    let (mut good, mut made, mut refused) = (0, 0, 0);
    for round in 0..600 {
        let mut file = BrepFile::of(&files[round % 3]);
        for _ in 0..1 + random.below(2) {
            let bytes = match random.below(8) {
                0 => &mut file.model,
                1..=4 => &mut file.blocks[0].1,
                _ => &mut file.segments[0].1,
            };
            let at = random.below(bytes.len() as u64) as usize;
            bytes[at] = match random.below(3) {
                0 => bytes[at].wrapping_add(1),
                1 => bytes[at] ^ 1 << random.below(8),
                _ => bytes[random.below(bytes.len() as u64) as usize],
            };
        }
        let Ok(model) = ExactModel::from_bytes(file.bytes()) else { continue };
        let is_good = model.verify(MEMORY, &()).unwrap().is_empty();
        good += usize::from(is_good);
        for (operation, models) in [
            (SetOperation::Union, [&model, &other]),
            (SetOperation::Intersection, [&model, &other]),
            (SetOperation::Difference, [&other, &model]),
        ] {
            match combine(
                operation,
                &models,
                Output::create(&target).unwrap(),
                spinney::Codec::Plain,
                16 << 20,
                &(),
            ) {
                Ok(_) => {
                    made += 1;
                    let result = ExactModel::from_bytes(std::fs::read(&target).unwrap()).unwrap();
                    let found = result.verify(MEMORY, &()).unwrap();
                    assert!(!is_good || found.is_empty(), "round {round}, operation {operation}: {found:?}");
                }
                Err(error) => {
                    refused += 1;
                    // Grids and parts may have become incompatible with the other operands.
                    let is_other = file.model != BrepFile::of(&files[round % 3]).model;
                    assert!(!is_good || is_other, "round {round}, operation {operation}: {error}");
                }
            }
        }
    }
    println!("{good} good, {made} made, {refused} refused");
    assert!(good > 20 && made > 60 && refused > 100);
}

/// Faces that exceed the memory limit are partitioned in temporary files, with the same findings.
#[test]
fn memory_does_not_matter() {
    let boxes = (0..1000).flat_map(|number| {
        let low = [number % 10, number / 10 % 10, number / 100].map(|at| 6 * at);
        cuboid(low, low.map(|at| at + 3))
    });
    let list = crate::common::exact::model_on(crate::common::sets::grid(6), &boxes.collect::<Vec<_>>());
    let mut file = BrepFile::of(&Body::of_list(&list).bytes);
    for expected in [0, 1] {
        let model = ExactModel::from_bytes(file.bytes()).unwrap();
        let [some, all] = [1 << 18, 64 << 20].map(|memory| model.verify(memory, &()).unwrap());
        assert_eq!((some.len(), &some), (expected, &all));
        let segment = &mut file.segments.last_mut().unwrap().1;
        let at = word_of(segment, 0);
        segment[at] = 1;
    }
}

/// The frozen model with all features: off-grid vertices, and metadata of its parts.
fn crossing() -> BrepFile {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1/crossing.goblin");
    BrepFile::of(&std::fs::read(path).unwrap())
}

#[test]
fn lists_of_exact_faces_that_are_not_those_of_cells_are_found() {
    let good = crossing();
    assert_eq!(findings(&good), "");
    assert_eq!(findings(&good.clone().cut_everywhere()), "", "with a segment for each node");
    // Swap two numbers of exact faces, so that lists refer to others.
    let mut found = 0;
    let segment = &good.segments[0].1;
    let [faces, exact] = [0, 4].map(|at| seal::short(segment, at) as usize);
    for number in 1..exact {
        let mut file = good.clone();
        let [one, other] = [0, number].map(|number| 16 + 4 * (faces + number));
        for byte in 0..4 {
            file.segments[0].1.swap(one + byte, other + byte);
        }
        let problems = findings(&file);
        assert!(problems.is_empty() || problems.contains("exact face"), "{problems}");
        found += usize::from(!problems.is_empty());
    }
    assert!(exact > 4 && found > exact / 2, "{found} of {exact}");
    // A cell near exact faces lists none.
    let mut file = good.clone();
    let segment = &mut file.segments[0].1;
    let leaf = lists(segment).1 + (seal::short(segment, word_of(segment, 4)) >> 3) as usize;
    if segment[leaf] & 32 != 0 {
        segment[leaf] ^= 32;
        assert!(findings(&file).contains("a node"), "{}", findings(&file));
    }
    // Swap the proxy flags of two faces.
    let mut file = good.clone();
    file.model[120] -= 1;
    assert!(findings(&file).contains("proxies, expected"), "{}", findings(&file));
}

#[test]
fn impossible_tables_are_detected() {
    let good = crossing();
    let changed = |from: &str, to: &str, expected: &str| {
        let mut file = good.clone();
        let mut count = 0;
        for (_, bytes) in &mut file.others[1] {
            while let Some(at) = bytes.windows(from.len()).position(|part| part == from.as_bytes()) {
                bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
                count += 1;
            }
        }
        assert!(count > 0, "{from}");
        let found = match ExactModel::from_bytes(file.bytes()) {
            Ok(_) => findings(&file),
            Err(error) => error.to_string(),
        };
        assert!(found.contains(expected), "{expected}: {found}");
    };
    changed("18.50", "18.5x", "not JSON");
    changed("A tower", "A\"tower", "without a JSON object");
    changed("tower", "aower", "of the name order");
    changed("[\"type\"]", "[\"type\",", "without a name");
    let mut file = good.clone();
    file.others[1].retain(|(key, _)| key >> 32 != 16);
    assert!(findings(&file).contains("without a value"), "{}", findings(&file));
    file.others[1].retain(|(key, _)| key >> 32 != 3);
    assert!(findings(&file).contains("without a list of columns"), "{}", findings(&file));
    file.others[1].retain(|(key, _)| key >> 32 != 0);
    let error = ExactModel::from_bytes(file.bytes()).err().unwrap().to_string();
    assert!(error.contains("0 names of 3 parts"), "{error}");
    // Models with templates are rejected.
    let mut bytes = good.bytes();
    let at = bytes.windows(4).rposition(|tag| tag == b"FORM").unwrap();
    bytes[at..at + 4].copy_from_slice(b"INST");
    seal::goblin(&mut bytes);
    let error = ExactModel::from_bytes(bytes).err().unwrap().to_string();
    assert!(error.contains("templates"), "{error}");
}
