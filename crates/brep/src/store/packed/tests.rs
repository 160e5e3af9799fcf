//! Round trips of chunks of all kinds, and packed files.

use super::super::block::BlockBuilder;
use super::super::segment::{INNER, LEAF, push_leaf};
use super::*;
use crate::query::Location;
use crate::{ExactModel, Face, Faces as _, Grid, ModelBuilder, combine};
use spinney_base::io::Output;
use spinney_base::{Error, Result, SetOperation};
use spinney_container::{Codec, Metadata};

fn random(seed: u64) -> impl FnMut(u64) -> u64 {
    let mut state = seed;
    move |below| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) % below
    }
}

const BITS: u8 = 14;

/// A bumpy ball: triangles around its poles, bands of triangles between.
fn ball(middle: [i32; 3], radius: f64) -> Vec<[[i32; 3]; 3]> {
    const ROWS: usize = 12;
    let at = |row: usize, column: usize| {
        let (a, b) =
            (row as f64 / ROWS as f64 * std::f64::consts::PI, column as f64 / 12.0 * std::f64::consts::PI);
        let bump = radius * (1.0 + 0.1 * (5.0 * b).sin() * a.sin());
        let [x, y, z] = [a.sin() * b.cos(), a.sin() * b.sin(), a.cos()].map(|at| (at * bump).round() as i32);
        [middle[0] + x, middle[1] + y, middle[2] + z]
    };
    let mut all = Vec::new();
    for row in 0..ROWS {
        for column in 0..24 {
            let next = (column + 1) % 24;
            let [a, b, c, d] = [at(row, column), at(row + 1, column), at(row + 1, next), at(row, next)];
            all.extend([[a, b, c], [a, c, d]].into_iter().filter(|[a, b, c]| a != b && b != c && a != c));
        }
    }
    all
}

/// A file of triangles with colours and two parts.
fn built(triangles: &[[[i32; 3]; 3]], codec: Codec) -> Vec<u8> {
    let grid = Grid { bits: BITS, origin: [0; 3], step: 1.0, divisor: 1.0 };
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.goblin");
    let builder = ModelBuilder::new(Output::create(&path).unwrap(), grid, 64 << 20).unwrap();
    let mut builder = builder.codec(codec).leaf_size(6);
    for (number, points) in (0..).zip(triangles) {
        let colours = [[number as u8, 7, 200]; 3];
        let part = u32::from(points[0][2] > 5000);
        let face = Face { number, points, ring_ends: &[3], colours: &colours, part, source: number / 2 };
        builder.push(&face).unwrap();
        builder.face_value("material", &format!("\"stone {}\"", number % 7)).unwrap();
    }
    for name in ["below", "above"] {
        let text = format!(
            "{{\"type\":\"Part\",\"attributes\":{{\"height\":{},\"note\":\"{}\"}}}}",
            name.len(),
            name.repeat(99)
        );
        builder.part(name, Some(&text)).unwrap();
    }
    let report = builder.finish(&mut Metadata::default(), &()).unwrap();
    assert_eq!(report.defects, []);
    std::fs::read(path).unwrap()
}

fn opened(file: &[u8]) -> ExactModel {
    ExactModel::from_bytes(file.to_vec()).unwrap()
}

/// The difference of two balls: faces have off-grid vertices.
fn bitten(codec: Codec) -> Vec<u8> {
    let [a, b] = [([5000; 3], 3000.0), ([7000, 6500, 6100], 2400.0)]
        .map(|(middle, radius)| opened(&built(&ball(middle, radius), codec)));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.goblin");
    combine(SetOperation::Difference, &[&a, &b], Output::create(&path).unwrap(), codec, 64 << 20, &())
        .unwrap();
    std::fs::read(path).unwrap()
}

/// Sections of a file: tags, offsets, and lengths.
fn sections(file: &[u8]) -> Vec<([u8; 4], usize, usize)> {
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    let trailer = file.len() - 16 - word(file.len() - 16);
    let section = |number| {
        let at = trailer + 36 + 24 * number;
        (file[at..at + 4].try_into().unwrap(), word(at + 8), word(at + 16))
    };
    (0..word(trailer + 32)).map(section).collect()
}

/// Chunks of all lists of a file.
fn chunks(file: &[u8]) -> Vec<(List, Vec<u8>)> {
    let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    let mut all = Vec::new();
    for (tag, start, length) in sections(file) {
        let tags = [b"FACE", b"DIRE", b"EXAC", b"OBJE", b"FVAL"];
        let list = tags.iter().position(|known| **known == tag).map(|index| List::ALL[index]);
        for entry in (start..start + length).step_by(24).filter(|_| list.is_some()) {
            let (from, length) = (word(entry + 8), word(entry + 16));
            all.extend(list.map(|list| (list, file[from..from + length].to_vec())));
        }
    }
    all
}

#[test]
fn chunks_of_all_kinds_are_packed_and_unpacked_losslessly() {
    let mut seen = [0; 5];
    for file in [built(&ball([6000; 3], 5000.0), Codec::Plain), bitten(Codec::Plain)] {
        for (list, plain) in chunks(&file) {
            let packed = pack(list, &plain);
            let most = match list {
                List::Faces | List::Segments | List::Exact => plain.len() / 2,
                List::Objects | List::FaceValues | List::Clusters | List::LevelFaces => plain.len() + 1,
            };
            assert!(packed.len() <= most, "{list:?}: {} of {}", packed.len(), plain.len());
            if packed[0] == PACKED {
                seen[list as usize] += 1;
                assert_eq!(unpack(list, &packed), Ok(plain));
            } else {
                assert!(packed[1..] == plain);
            }
        }
    }
    assert!(seen.iter().all(|seen| *seen > 0), "{seen:?}");
}

/// Faces with holes, of several parts, with arbitrary sources and random vertices.
#[test]
fn unusual_blocks_are_packed_losslessly() {
    let mut random = random(7);
    for round in 0..60 {
        let mut builder = BlockBuilder::default();
        let (reach, count) = (2 + random(1 << (1 + round % 26)), 1 + random(200));
        let is_coloured = round % 3 == 0;
        for number in 0..count {
            let rings =
                if round % 2 == 0 { vec![3] } else { (0..1 + random(3)).map(|_| 3 + random(4)).collect() };
            let corners: u64 = rings.iter().sum();
            let points: Vec<[i32; 3]> = (0..corners).map(|_| [0; 3].map(|_| random(reach) as i32)).collect();
            let mut end = 0;
            let ring_ends: Vec<usize> = rings
                .iter()
                .map(|ring| {
                    end += *ring as usize;
                    end
                })
                .collect();
            let colours = vec![[random(256) as u8; 3]; if is_coloured { points.len() } else { 0 }];
            let source = if round % 5 == 0 { u64::MAX - random(1 << 30) } else { number };
            let part = random(1 + round % 4) as u32 * 0x5555_5555;
            let face =
                Face { number, points: &points, ring_ends: &ring_ends, colours: &colours, part, source };
            builder.push(&face, round % 7 == 0 && random(3) == 0);
        }
        let (_, plain) = builder.finish();
        let packed = pack(List::Faces, &plain);
        assert!(packed[0] == PACKED || plain.len() < 200, "round {round}: {} bytes", plain.len());
        if packed[0] == PACKED {
            assert_eq!(unpack(List::Faces, &packed), Ok(plain));
        }
    }
}

/// Lists that the writer does not produce are stored unchanged.
#[test]
fn unordered_lists_are_stored_plain() {
    let mut random = random(3);
    let stay = |list: List, plain: &[u8]| {
        let packed = pack(list, plain);
        assert!(packed[0] == PLAIN && packed[1..] == *plain, "{list:?}");
    };
    for list in List::ALL {
        stay(list, &[]);
        for length in [1, 16, 20, 32, 400] {
            let noise: Vec<u8> = (0..length).map(|_| random(256) as u8).collect();
            stay(list, &noise);
        }
    }
    // A block whose only face has its vertices in reverse order, and a segment with reversed faces
    // in a leaf.
    let words = |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|word| word.to_le_bytes()).collect() };
    let mut block = words(&[1, 3, 1, 3, 4]);
    block.extend(words(&[1 << 20, 2, 3, 4, 5, 6, 7, 8, 9, 0]));
    block.extend([2u16, 1, 0].iter().flat_map(|corner| corner.to_le_bytes()));
    stay(List::Faces, &block);
    for number in [7, 1 << 20] {
        let mut segment = words(&[2, 0, 9, 0, 7, 9, 1 << 3 | INNER, LEAF]);
        let mut leaves = Vec::new();
        push_leaf(&mut leaves, 0, &[1], &[]);
        segment.extend(words(&[(number << 3) | LEAF, 0, 0, 0, 0, 0, 0]));
        push_leaf(&mut leaves, 0, &[0], &[]);
        segment[12] = leaves.len() as u8;
        segment.extend(leaves);
        stay(List::Segments, &segment);
    }
}

#[test]
fn corrupt_chunks_are_reported() {
    let mut random = random(11);
    for (list, plain) in chunks(&bitten(Codec::Plain)) {
        let packed = pack(list, &plain);
        for length in 0..packed.len().min(64) {
            assert!(unpack(list, &packed[..length]).is_err());
        }
        for _ in 0..40 {
            let mut corrupt = packed.clone();
            for _ in 0..1 + random(3) {
                let at = random(corrupt.len() as u64) as usize;
                corrupt[at] ^= 1 << random(8);
            }
            // (Some bits do not matter: the result is then the same chunk.)
            assert!(
                unpack(list, &corrupt).is_ok_and(|unpacked| unpacked == plain)
                    || unpack(list, &corrupt).is_err()
            );
        }
        for _ in 0..40 {
            // Any checksum, and any declared length.
            let length = [0, 20, 1 << 16, 1 << 20, u32::MAX][random(5) as usize];
            let mut noise = vec![PACKED, 1, 2, 3, 4];
            noise.extend(u32::to_le_bytes(length));
            noise.extend((0..4 * random(100)).map(|_| random(256) as u8));
            assert!(unpack(list, &noise).is_err());
        }
    }
}

fn faces(model: &ExactModel) -> Vec<String> {
    let mut all = Vec::new();
    model
        .each(&mut |face| {
            all.push(format!("{face:?}"));
            Ok(())
        })
        .unwrap();
    all
}

#[test]
fn packed_files_give_the_same_results_as_plain_ones() {
    let ball = |codec| built(&ball([6000; 3], 5000.0), codec);
    for [plain, packed] in
        [[Codec::Plain, Codec::Packed].map(ball), [Codec::Plain, Codec::Packed].map(bitten)]
    {
        assert!(packed.len() < 3 * plain.len() / 4, "{} of {}", packed.len(), plain.len());
        let [plain, packed] = [plain, packed].map(|file| opened(&file));
        assert_eq!([plain.codec(), packed.codec()], [Codec::Plain, Codec::Packed]);
        for model in [&plain, &packed] {
            assert_eq!(model.verify(64 << 20, &()).unwrap(), []);
        }
        assert_eq!(faces(&plain), faces(&packed));
        assert_eq!((plain.nodes(), plain.parts()), (packed.nodes(), packed.parts()));
        assert_eq!(plain.part_attributes(0).unwrap(), packed.part_attributes(0).unwrap());
        let mut random = random(5);
        let points: Vec<[f64; 3]> = (0..2000).map(|_| [0; 3].map(|_| random(1 << 16) as f64 / 4.0)).collect();
        let locations = |model: &ExactModel| {
            points.iter().map(|point| model.locate(*point)).collect::<Result<Vec<Location>>>().unwrap()
        };
        assert_eq!(locations(&plain), locations(&packed));
    }
}

/// Recomputes the checksums of a file's lists and sections after a change.
fn sealed(mut file: Vec<u8>) -> Vec<u8> {
    let word = |file: &[u8], at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    let lists = [*b"FACE", *b"DIRE", *b"EXAC", *b"OBJE", *b"FVAL"];
    for (tag, start, length) in sections(&file) {
        for entry in (start..start + length).step_by(24).filter(|_| lists.contains(&tag)) {
            let (from, length) = (word(&file, entry + 8), word(&file, entry + 16));
            let Some(chunk) = file.get(from..from + length) else { continue };
            let checksum = crc32c::crc32c(chunk);
            file[entry + 20..entry + 24].copy_from_slice(&checksum.to_le_bytes());
        }
    }
    let end = file.len() - 16;
    let trailer = end - word(&file, end);
    for (number, (_, start, length)) in sections(&file).into_iter().enumerate() {
        let checksum = crc32c::crc32c(&file[start..start + length]);
        let at = trailer + 36 + 24 * number + 4;
        file[at..at + 4].copy_from_slice(&checksum.to_le_bytes());
    }
    let checksum = crc32c::crc32c(&file[trailer..end]);
    file[end + 4..end + 8].copy_from_slice(&checksum.to_le_bytes());
    file
}

#[test]
fn malicious_files_are_rejected() {
    let file = bitten(Codec::Packed);
    assert_eq!(sealed(file.clone()), file);
    let (_, model, _) = sections(&file).into_iter().find(|(tag, ..)| tag == b"BREP").unwrap();
    for codec in [2, 255] {
        let mut other = file.clone();
        other[model + 2] = codec;
        let refused = ExactModel::from_bytes(sealed(other)).err().unwrap();
        assert!(matches!(&refused, Error::Unsupported { .. }), "{refused}");
    }
    let mut random = random(13);
    for _ in 0..120 {
        let mut malicious = file.clone();
        let at = 24 + random((model - 24) as u64) as usize;
        malicious[at] ^= 1 + random(255) as u8;
        let Ok(model) = ExactModel::from_bytes(sealed(malicious)) else { continue };
        // (Irrelevant bytes may be changed without effect.)
        let findings = model.verify(64 << 20, &()).unwrap();
        let is_corrupt =
            model.each(&mut |_| Ok(())).is_err_and(|error| matches!(error, Error::Corrupt { .. }));
        assert!(!is_corrupt || !findings.is_empty());
    }
}
