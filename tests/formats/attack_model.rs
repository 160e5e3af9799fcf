//! Sets fields of exact model files to malicious values with valid checksums: all fields of small
//! files, and a sample in larger ones. An error or a harmless result is required. Also tests faces,
//! grids and lists that no builder writes.

use std::time::{Duration, Instant};

use spinney::brep::{Faces, Grid, Location, MassProperties};
use spinney::raw::brep::{FaceList, ModelBuilder};
use spinney::{ExactModel, Metadata, Output};

use super::attack_goblin::{Field, HEADER_FIELDS, changed, fields};
use crate::common::Random;
use crate::common::brep_file::BrepFile;
use crate::common::command::{is_alone, own_peak_memory};
use crate::common::exact::{built, cuboid, prism, push, turned};
use crate::targets::models::{fast_queries, query_model};
use crate::targets::seal::{self, END, SECTION, TRAILER};

/// Returns a grid of 2^bits steps of 1.
fn grid(bits: u8) -> Grid {
    Grid { bits, origin: [0; 3], step: 1.0, divisor: 1.0 }
}

/// Returns the file of a tetrahedron on a grid of `bits` bits; section 33 of `formats.md` has one
/// such file.
pub(crate) fn tetrahedron(bits: u8) -> Vec<u8> {
    let at = (1 << bits) - 1;
    let [o, x, y, z] = [[0; 3], [at, 0, 0], [0, at, 0], [0, 0, at]];
    let mut list = FaceList::new(grid(bits), vec!["mesh".into()]);
    for ring in [[o, y, x], [o, x, z], [o, z, y], [x, y, z]] {
        push(&mut list, &[ring.to_vec()], 0, None);
    }
    built(&list, 1 << 20, 0).0.unwrap()
}

/// Returns a file of two parts with colours, a through hole and a cavity.
pub(crate) fn house(bits: u8) -> Vec<u8> {
    let square = |low: i32, high: i32| vec![[low, low], [high, low], [high, high], [low, high]];
    let hole: Vec<[i32; 2]> = square(4, 6).into_iter().rev().collect();
    let mut list = FaceList::new(grid(bits), vec!["wall".into(), "roof".into()]);
    let cavity = turned(cuboid([8, 8, 3], [9, 9, 4]));
    for (number, rings) in prism(&[square(1, 11), hole], 2, 7).iter().chain(&cavity).enumerate() {
        push(&mut list, rings, u32::from(number > 3), Some([number as u8, 2, 3]));
    }
    let corners = [[12, 12, 12], [14, 12, 13], [12, 15, 12], [13, 13, 15]];
    for [a, b, c] in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
        push(&mut list, &[vec![corners[a], corners[b], corners[c]]], 1, Some([9; 3]));
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("house.goblin");
    let output = Output::create(&path).unwrap();
    let mut builder = ModelBuilder::new(output, grid(bits), 1 << 20).unwrap().leaf_size(3);
    list.each(&mut |face| {
        builder.push(face)?;
        if face.number % 3 == 0 { builder.face_value("material", &face.number.to_string()) } else { Ok(()) }
    })
    .unwrap();
    builder.part("wall", Some("{\"type\":\"Wall\",\"attributes\":{\"a\":1,\"b\":[]}}")).unwrap();
    builder.part("roof", Some("{\"attributes\":{\"b\":2.50},\"type\":\"Roof\"}")).unwrap();
    builder.about_file("{\"metadata\":{}}").unwrap();
    let mut metadata = Metadata::default();
    assert_eq!(builder.finish(&mut metadata, &()).unwrap().defects, []);
    std::fs::read(&path).unwrap()
}

/// Returns all fields of the file itself, and all or one in `every` fields of its blocks, segments
/// and entries, and bytes of its metadata.
fn all_fields(file: &[u8], every: usize) -> Vec<Field> {
    let mut details = Vec::new();
    let mut all = fields("the header", 0, &HEADER_FIELDS);
    let trailer = seal::trailer(file).unwrap();
    all.extend(fields("the trailer", trailer, &[&HEADER_FIELDS[..], &[4, 8, 4]].concat()));
    all.extend(fields("the end", file.len() - END, &[4, 4, 8]));
    let sections = (0..seal::short(file, trailer + seal::SECTIONS) as usize)
        .map(|section| trailer + TRAILER + section * SECTION);
    let model = sections.clone().find(|at| file[*at..].starts_with(b"BREP")).unwrap();
    let is_packed = file[seal::long(file, model + 8) as usize + 2] == 1;
    for at in sections {
        all.extend(fields("a section", at, &[4, 4, 8, 8]));
        let (start, length) = (seal::long(file, at + 8) as usize, seal::long(file, at + 16) as usize);
        match &file[at..at + 4] {
            b"BREP" => all.extend(fields("the model", start, &[&[1, 1, 1, 5][..], &[8; 16]].concat())),
            b"META" => details.extend(fields("the metadata", start, &vec![1; length])),
            b"FORM" => details.extend(fields("the formula", start, &vec![1; length])),
            b"SUMS" => details.extend(fields("the sums", start, &vec![1; length])),
            _ => {
                for entry in (start..start + length).step_by(24) {
                    details.extend(fields("an entry", entry, &[8, 8, 4, 4]));
                    let (from, bytes) =
                        (seal::long(file, entry + 8) as usize, seal::short(file, entry + 16) as usize);
                    if is_packed {
                        // The first byte; of packed blocks the checksum, length, states and some
                        // words.
                        let most = (bytes - 1) / 4;
                        let sizes = [&[1, 4, 4][..], &[8, 8], &[4; 8]].concat();
                        details.extend(fields(
                            "a packed chunk",
                            from,
                            &sizes[..sizes.len().min(1 + most / 2)],
                        ));
                        continue;
                    }
                    if [b"OBJE", b"FVAL"].contains(&file[at..at + 4].try_into().unwrap()) {
                        let sizes = [vec![4; 2], vec![1; bytes - 8]].concat();
                        details.extend(fields("a chunk of a table", from, &sizes));
                        continue;
                    }
                    // Numbers of four bytes, then leaves or vertices.
                    let words = match &file[at..at + 4] {
                        b"DIRE" => (0..3).map(|count| seal::short(file, from + 4 * count)).sum::<u32>() + 4,
                        _ => 5 + 3 * seal::short(file, from + 4),
                    };
                    let words = words as usize;
                    let sizes = [vec![4; words], vec![1; bytes - 4 * words]].concat();
                    details.extend(fields("a block or segment", from, &sizes));
                }
            }
        }
    }
    all.extend(details.into_iter().step_by(every));
    all
}

/// Changes fields of a file, one in `every` of those of blocks and segments, and runs all queries.
fn attack(file: &[u8], every: usize) {
    let (mut cases, start) = (0u64, Instant::now());
    for field in all_fields(file, every) {
        changed(file, &field, &mut |mut file, what| {
            let case = Instant::now();
            seal::goblin(&mut file);
            query_model(file);
            assert!(case.elapsed() < Duration::from_secs(10), "{what} took {:?}", case.elapsed());
            cases += 1;
        });
    }
    println!("{cases} cases in {:?}", start.elapsed());
    assert!(own_peak_memory() < 256 << 20, "{} bytes", own_peak_memory());
}

#[test]
fn fields_of_small_models() {
    if is_alone("attack_model::fields_of_small_models") {
        attack(&tetrahedron(1), 1);
        attack(&BrepFile::of(&tetrahedron(2)).cut_everywhere().bytes(), 1);
    }
}

#[test]
fn fields_of_models_with_holes_and_parts() {
    if is_alone("attack_model::fields_of_models_with_holes_and_parts") {
        // Fields of each kind occur many times.
        attack(&house(4), 15);
    }
}

#[test]
fn fields_of_packed_models() {
    if is_alone("attack_model::fields_of_packed_models") {
        // Single bytes of packed blocks carry little meaning.
        attack(include_bytes!("../../fixtures/v1/crossing_packed.goblin"), 61);
    }
}

/// Files with a segment for every INNER node return the same results as the builder's, also on the
/// finest grid.
#[test]
fn files_cut_everywhere_say_the_same() {
    for file in [house(4), tetrahedron(26), tetrahedron(5)] {
        let cut = BrepFile::of(&file).cut_everywhere().bytes();
        let [expected, found] = [file, cut].map(|file| ExactModel::from_bytes(file).unwrap());
        let segments = expected.nodes().inner as usize;
        assert_eq!((found.segments(), found.verify(64 << 20, &()).unwrap()), (segments.max(1), vec![]));
        let mut random = Random(9);
        let side = 1 << (found.grid().bits + 2);
        let mut inside = 0;
        for _ in 0..500 {
            let point = [(); 3].map(|()| random.below(side) as f64 / 4.0);
            let location = found.locate(point).unwrap();
            assert_eq!(location, expected.locate(point).unwrap());
            assert_eq!(found.signed_distance(point).unwrap(), expected.signed_distance(point).unwrap());
            inside += usize::from(location == Location::Inside);
        }
        assert!(inside > 0);
    }
}

/// Returns a model whose root is a leaf with some faces. The vertices of all rings are in one
/// block.
pub(crate) fn one_leaf(bits: u8, faces: &[Vec<Vec<[i32; 3]>>], head: u8) -> BrepFile {
    let mut file = BrepFile::of(&tetrahedron(bits));
    let rings: Vec<&Vec<[i32; 3]>> = faces.iter().flatten().collect();
    let corners: Vec<[i32; 3]> = rings.iter().copied().flatten().copied().collect();
    let ends = |counts: &mut dyn Iterator<Item = usize>| -> Vec<u32> {
        let mut end = 0;
        counts.map(|count| (end += count as u32, end).1).collect()
    };
    let counts = [faces.len(), corners.len(), rings.len(), corners.len(), 0].map(|count| count as u32);
    let mut words = counts.to_vec();
    words.extend(corners.as_flattened().iter().map(|at| *at as u32));
    words.extend(ends(&mut faces.iter().map(Vec::len)));
    words.extend(ends(&mut rings.iter().map(|ring| ring.len())));
    words.push(0);
    let mut block: Vec<u8> = words.into_iter().flat_map(u32::to_le_bytes).collect();
    block.extend((0..corners.len() as u16).flat_map(u16::to_le_bytes));
    file.blocks = vec![(0, block)];
    let count = faces.len() as u32;
    assert!(count < 128);
    let mut leaf = vec![head, count as u8];
    leaf.extend(vec![0; faces.len()]);
    let mut words = vec![count, 0, 1, leaf.len() as u32];
    words.extend(0..count);
    words.push(4);
    let segment = [words.into_iter().flat_map(u32::to_le_bytes).collect(), leaf].concat();
    file.segments = vec![(0, segment)];
    file.sums.clear();
    let mut model = file.model[..56].to_vec();
    model[48..56].copy_from_slice(&u64::from(count).to_le_bytes());
    let nodes = [0, 0, 0, 0, 0, 0, 1u64].map(|nodes| nodes * u64::from(head & 3 == 3));
    model.extend(nodes.into_iter().chain([0, 0, 1]).flat_map(u64::to_le_bytes));
    file.model = model;
    file
}

pub(crate) const CROSSINGS: u8 = 3 | 2 << 2;

/// Faces that no builder accepts: not planar, folded, self-intersecting or intersecting, on the
/// finest grid.
#[test]
fn invalid_faces_are_rejected() {
    if !is_alone("attack_model::invalid_faces_are_rejected") {
        return;
    }
    let mut random = Random(11);
    for round in 0..400 {
        let bits = [26, 25, 3, 1][round % 4];
        let most = (1u64 << bits) - 1;
        let mut faces = Vec::new();
        for _ in 0..1 + random.below(6) {
            let mut rings = Vec::new();
            for _ in 0..1 + random.below(3) {
                let mut ring = Vec::new();
                for _ in 0..3 + random.below(6) {
                    // Coordinates are often at the limits, and often equal.
                    let mut at = || match random.below(4) {
                        0 => 0,
                        1 => most as i32,
                        2 => (most / 2) as i32,
                        _ => random.below(most + 1) as i32,
                    };
                    ring.push([at(), at(), at()]);
                }
                rings.push(ring);
            }
            faces.push(rings);
        }
        let head = [CROSSINGS, CROSSINGS | 16, 3, 3 | 1 << 2, 0, 1, 2 | 16][round % 7];
        let file = one_leaf(bits, &faces, head).bytes();
        let model = ExactModel::from_bytes(file.clone()).unwrap();
        assert_ne!(model.verify(1 << 20, &()).unwrap(), []);
        query_model(file);
    }
}

/// A ring that traverses the whole grid's border a thousand times: twice its area needs more than
/// 64 bits.
#[test]
fn rings_of_many_turns() {
    let most = (1 << 26) - 1;
    let square = [[0, 0, 5], [most, 0, 5], [most, most, 5], [0, most, 5]];
    let slanted = [[0, 0, 0], [most, 0, most], [most, most, most], [0, most, 0]];
    for corners in [square, slanted] {
        let ring: Vec<[i32; 3]> = corners.into_iter().cycle().take(4 * 1100).collect();
        let file = one_leaf(26, &[vec![ring.clone()], vec![ring[..4].to_vec(), ring]], CROSSINGS).bytes();
        let model = ExactModel::from_bytes(file).unwrap();
        assert!(model.verify(1 << 20, &()).unwrap()[0].problem.contains("more than eight turns"));
        assert!(MassProperties::of(&model, &()).unwrap().area > 0.0);
        // A section of a non-solid may fail.
        let _ = fast_queries(&model);
    }
}

/// Grid steps and origins at the limits of the format.
#[test]
fn grids_at_the_limits() {
    let far = 1i64 << 53;
    for (step, divisor) in [
        (1e300, 1.0),
        (f64::MIN_POSITIVE, 1.0),
        (f64::MAX, 1.0),
        (f64::MAX, f64::MAX),
        (f64::MIN_POSITIVE, f64::MIN_POSITIVE),
        (1e-300, 1e-300),
        (1.0, 1e300),
    ] {
        for origin in [0, far, -far] {
            for bits in [1, 26] {
                let mut file = BrepFile::of(&tetrahedron(bits));
                for axis in 0..3 {
                    file.model[8 + 8 * axis..][..8].copy_from_slice(&origin.to_le_bytes());
                }
                file.model[32..40].copy_from_slice(&step.to_le_bytes());
                file.model[40..48].copy_from_slice(&divisor.to_le_bytes());
                query_model(file.bytes());
            }
        }
    }
}

/// A few bytes of a file must not represent many faces and nodes.
#[test]
fn each_block_may_be_listed_only_once() {
    let file = BrepFile::of(&tetrahedron(1));
    let faces = |file: &mut BrepFile, count: u64| file.model[48..56].copy_from_slice(&count.to_le_bytes());
    // Two copies in the file are valid, but for the sums of one.
    let mut twice = file.clone();
    twice.sums.clear();
    faces(&mut twice, 8);
    twice.blocks.push((4, file.blocks[0].1.clone()));
    let model = ExactModel::from_bytes(twice.bytes()).unwrap();
    assert_eq!(model.len(), 8);
    assert!(model.verify(1 << 20, &()).unwrap()[0].problem.contains("a leaf without face"));
    // The second entry gets the first one's offset.
    let mut bytes = twice.bytes();
    let trailer = seal::trailer(&bytes).unwrap();
    let list = seal::long(&bytes, trailer + TRAILER + 8) as usize;
    assert_eq!(&bytes[trailer + TRAILER..][..4], b"FACE");
    twice.blocks[1].1.clear();
    let mut folded = twice.bytes();
    let at = seal::long(&folded, seal::trailer(&folded).unwrap() + TRAILER + 8) as usize;
    folded.copy_within(at + 8..at + 24, at + 32);
    seal::goblin(&mut folded);
    let error = ExactModel::from_bytes(folded).err().unwrap().to_string();
    assert!(error.contains("lists: ") && error.contains("before the lists"), "{error}");
    // Keys in descending order.
    bytes[list..list + 48].rotate_left(24);
    seal::goblin(&mut bytes);
    let error = ExactModel::from_bytes(bytes).err().unwrap().to_string();
    assert!(error.contains("keys that ascend"), "{error}");
}

/// A segment must not list a face under two numbers: a leaf could then hold it as often as it has
/// bytes.
#[test]
fn faces_of_a_segment_are_there_once() {
    let ring = vec![[0, 0, 0], [1, 0, 0], [0, 1, 0]];
    let mut file = one_leaf(1, &[vec![ring.clone()], vec![ring]], CROSSINGS);
    let found = ExactModel::from_bytes(file.bytes()).unwrap().verify(1 << 20, &()).unwrap();
    assert!(found[0].problem.contains("more often than its reverse"), "of the surface alone: {found:?}");
    file.segments[0].1[20..24].fill(0);
    let found = ExactModel::from_bytes(file.bytes()).unwrap().verify(1 << 20, &()).unwrap();
    assert_eq!(found.len(), 1);
    assert!(found[0].problem.contains("face 0 twice"), "{found:?}");
}
