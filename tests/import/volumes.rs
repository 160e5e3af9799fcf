//! Volumes in NPY files: every type, VOID, levels of detail, and invalid files.

use std::fs;
use std::path::Path;

use spinney::export::{ArrayRequest, export_array};
use spinney::import::volume::{VolumeOptions, plan};
use spinney::raw::dataset;
use spinney::raw::export::image::Format;
use spinney::raw::import::volume::is_volume;
use spinney::{Bounds, DataKind, Dataset, Error, OpenOptions, Output, Result, Rule, SampleType};
use tempfile::TempDir;

use crate::common::{Random, with};

/// Returns an array as `numpy.save` writes it.
fn npy(version: u8, descr: &str, shape: &[u64], samples: &[u8]) -> Vec<u8> {
    let lengths: Vec<String> = shape.iter().map(u64::to_string).collect();
    let shape = lengths.join(", ");
    let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
    file(version, &format!("{text:<117}\n"), samples)
}

/// Returns a file with any header.
fn file(version: u8, header: &str, samples: &[u8]) -> Vec<u8> {
    let mut bytes = [&b"\x93NUMPY"[..], &[version, 0]].concat();
    let length = (header.len() as u32).to_le_bytes();
    bytes.extend(&length[..if version == 1 { 2 } else { 4 }]);
    [bytes, header.into(), samples.into()].concat()
}

/// Returns a number as a little-endian sample of a type.
fn sample(name: &str, number: f64) -> Vec<u8> {
    match name {
        "b1" | "u1" => vec![number as u8],
        "i1" => (number as i8).to_le_bytes().into(),
        "u2" => (number as u16).to_le_bytes().into(),
        "i2" => (number as i16).to_le_bytes().into(),
        "u4" => (number as u32).to_le_bytes().into(),
        "i4" => (number as i32).to_le_bytes().into(),
        "u8" => (number as u64).to_le_bytes().into(),
        "i8" => (number as i64).to_le_bytes().into(),
        // Only small integers.
        "f2" => {
            let bits = (number as f32).to_bits();
            let half =
                (bits >> 16 & 0x8000) | ((bits >> 23 & 0xff).wrapping_sub(112) << 10) | (bits >> 13 & 0x3ff);
            (if number == 0.0 { 0 } else { half as u16 }).to_le_bytes().into()
        }
        "f4" => (number as f32).to_le_bytes().into(),
        _ => number.to_le_bytes().into(),
    }
}

fn build(directory: &TempDir, array: &[u8], options: &VolumeOptions) -> Result<Dataset> {
    let (input, path) = (directory.path().join("volume.npy"), directory.path().join("volume.goblin"));
    fs::write(&input, array).unwrap();
    plan(&input, options)?.build(Output::create(&path)?, &())?;
    dataset::open(&path, &OpenOptions::new())
}

fn get(tree: &Dataset, out: &Path) -> Vec<u8> {
    let request = ArrayRequest::new(tree.extent_at(tree.depth()), tree.depth());
    export_array(tree, &request, Output::create(out).unwrap(), Format::Npy, &()).unwrap();
    fs::read(out).unwrap()
}

const TYPES: [(&str, &str, SampleType); 12] = [
    ("b1", "|u1", SampleType::U8),
    ("u1", "|u1", SampleType::U8),
    ("i1", "|i1", SampleType::I8),
    ("u2", "<u2", SampleType::U16),
    ("i2", "<i2", SampleType::I16),
    ("u4", "<u4", SampleType::U32),
    ("i4", "<i4", SampleType::I32),
    ("u8", "<u8", SampleType::U64),
    ("i8", "<i8", SampleType::I64),
    ("f2", "<f4", SampleType::F32),
    ("f4", "<f4", SampleType::F32),
    ("f8", "<f8", SampleType::F64),
];

#[test]
fn all_types_round_trip() {
    let directory = tempfile::tempdir().unwrap();
    let [width, height, planes] = [67, 5, 66];
    for (name, back, sample_type) in TYPES {
        let (range, least) = match name {
            "b1" => (2, 0.0),
            name if name.starts_with('u') => (250, 0.0),
            _ => (250, -125.0),
        };
        let mut random = Random(7);
        let numbers: Vec<f64> =
            (0..width * height * planes).map(|_| random.below(range) as f64 + least).collect();
        let bytes = |name: &str| numbers.iter().flat_map(|number| sample(name, *number)).collect::<Vec<u8>>();
        let mut stored = bytes(name);
        for (order, version) in [('<', 1), ('>', 2), ('|', 3)] {
            let size = stored.len() / numbers.len();
            match order {
                '>' => stored.chunks_exact_mut(size).for_each(<[u8]>::reverse),
                '|' if size > 1 => continue,
                _ => {}
            }
            let array = npy(version, &format!("{order}{name}"), &[planes, height, width], &stored);
            let tree = build(&directory, &array, &VolumeOptions::new()).unwrap();
            assert_eq!(tree.verify(1 << 20, &()).unwrap(), []);
            let header = tree.header();
            assert_eq!((header.extent, header.form.value.sample), ([width, height, planes], sample_type));
            assert_eq!((header.kind, header.rule), (DataKind::Continuous, Rule::Mean));
            let found = get(&tree, &directory.path().join("back.npy"));
            let text = String::from_utf8_lossy(&found[..128]);
            assert!(text.contains(&format!("'{back}'")) && text.contains("(66, 5, 67)"), "{text}");
            assert!(found[128..] == bytes(&back[1..]), "{order}{name}");
        }
    }
}

#[test]
fn channels_round_trip() {
    let directory = tempfile::tempdir().unwrap();
    let samples: Vec<u8> = (0..5 * 6 * 7 * 3u32).map(|i| (i * i / 7) as u8).collect();
    let tree = build(&directory, &npy(1, "|u1", &[5, 6, 7, 3], &samples), &VolumeOptions::new()).unwrap();
    assert_eq!(tree.header().form.value.channels, 3);
    assert!(get(&tree, &directory.path().join("back.npy"))[128..] == samples);
}

/// Returns integer cell values, some NaN, so that their sums are exact.
fn numbers(size: [u64; 3]) -> Vec<f64> {
    let mut random = Random(3);
    let number = |_| match random.below(6) {
        0 => f64::NAN,
        1 => -1.0,
        _ => random.below(1000) as f64,
    };
    (0..size.iter().product()).map(number).collect()
}

#[test]
fn coarser_levels_have_means_of_what_is_there() {
    let directory = tempfile::tempdir().unwrap();
    let size = [70, 33, 66];
    let numbers = numbers(size);
    let samples: Vec<u8> = numbers.iter().flat_map(|number| number.to_be_bytes()).collect();
    let matrix = [[0.5, 0.0, 0.0, 10.0], [0.0, 0.5, 0.0, 20.0], [0.0, 0.0, 2.0, 30.0]];
    let options = with(VolumeOptions::new(), |it| {
        it.nodata = Some((-1.0).into());
        it.transform = Some(matrix);
        it.depth = Some(8);
    });
    let tree = build(&directory, &npy(1, ">f8", &[size[2], size[1], size[0]], &samples), &options).unwrap();
    assert_eq!((tree.depth(), tree.metadata().nodata), (8, Some((-1).into())));
    assert_eq!(tree.metadata().frame.matrix, matrix);
    for level in [0, 3, 5, 6, 7, 8] {
        let bounds = tree.extent_at(level);
        let side = 1 << (8 - level);
        let mut bytes = vec![0; bounds.volume() as usize * 8];
        let mut valid = vec![false; bounds.volume() as usize];
        tree.window(level, &bounds, -5.0, &mut bytes, Some(&mut valid)).unwrap();
        let [width, height, _] = bounds.size();
        for (index, (found, valid)) in (0..).zip(bytes.as_chunks().0.iter().zip(valid)) {
            let cell = [index % width, index / width % height, index / width / height];
            let cells = Bounds {
                min: cell.map(|at| at * side),
                max: std::array::from_fn(|axis| size[axis].min((cell[axis] + 1) * side)),
            };
            let (mut sum, mut count) = (0.0, 0);
            for z in cells.min[2]..cells.max[2] {
                for y in cells.min[1]..cells.max[1] {
                    for x in cells.min[0]..cells.max[0] {
                        let number = numbers[((z * size[1] + y) * size[0] + x) as usize];
                        if !number.is_nan() && number != -1.0 {
                            (sum, count) = (sum + number, count + 1);
                        }
                    }
                }
            }
            assert_eq!(valid, count > 0, "level {level}, {cell:?}");
            if valid {
                assert_eq!(f64::from_le_bytes(*found), sum / f64::from(count), "level {level}, {cell:?}");
            }
        }
    }
}

#[test]
fn threads_and_memory_do_not_change_the_bytes() {
    let directory = tempfile::tempdir().unwrap();
    let size = [300, 70, 130];
    let samples: Vec<u8> = numbers(size).iter().flat_map(|number| (*number as f32).to_le_bytes()).collect();
    let array = npy(1, "<f4", &[size[2], size[1], size[0]], &samples);
    let mut expected: Option<Vec<u8>> = None;
    for (threads, memory) in [(1, 0), (2, 1 << 20), (4, 32 << 20), (3, 1 << 30)] {
        let options = with(VolumeOptions::new(), |it| it.memory = Some(memory));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| build(&directory, &array, &options)).unwrap();
        let found = fs::read(directory.path().join("volume.goblin")).unwrap();
        assert!(expected.get_or_insert_with(|| found.clone()) == &found, "{threads} threads, {memory} bytes");
    }
}

fn header(descr: &str, order: &str, shape: &str) -> String {
    format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}}}")
}

#[test]
fn bad_files_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let refuse = |bytes: &[u8], expected: &str| {
        let text = build(&directory, bytes, &VolumeOptions::new()).unwrap_err().to_string();
        assert!(text.contains(expected), "{text}");
        assert!(!directory.path().join("volume.goblin").exists());
    };
    let good = npy(1, "<f4", &[2, 3, 4], &[0; 96]);
    for end in 0..128 {
        refuse(&good[..end], if end < 8 { "header" } else { "the end of the file" });
    }
    refuse(&good[..good.len() - 1], "found 223 bytes, expected 224");
    refuse(&[&good[..], &[0]].concat(), "found 225 bytes, expected 224");
    refuse(&file(4, "", &[]), "version 4.0");
    refuse(&file(2, &" ".repeat(65537), &[]), "65537 bytes");
    refuse(&[&b"\x93NUMPY\x02\0\xff\xff\xff\xff"[..], &[b' '; 64]].concat(), "4294967295 bytes");
    refuse(b"GARBAGE!garbage", "other first bytes");
    for (descr, order, shape, expected) in [
        ("'<f4'", "True", "(2, 3, 4)", "ascontiguousarray"),
        ("'<f4'", "False", "(6, 4)", "(6, 4)"),
        ("'<f4'", "False", "()", "()"),
        ("'<f4'", "False", "(2, 3, 4, 5)", "(2, 3, 4, 5)"),
        ("'<f4'", "False", "(1, 2, 3, 4, 1)", "(1, 2, 3, 4, 1)"),
        ("'<f8'", "False", "(2, 3, 4, 2)", "2 channels of float64"),
        ("'<f4'", "False", "(0, 3, 4)", "an empty array"),
        ("'<f4'", "False", "(4294967296, 4294967296, 4294967296)", "a 64-bit number"),
        ("'<f4'", "False", "(1, 1, 4611686018427387903)", "a 64-bit number"),
        ("'<f4'", "False", "(1, 1, 18446744073709551615)", "a 64-bit number"),
        ("'<f4'", "False", "(1, 1, 18446744073709551616)", "a dictionary"),
        ("'<f4'", "False", "(1000000, 1000000, 1000000)", "224 bytes"),
        ("'<f4'", "False", "(-1, 1, 1)", "a dictionary"),
        ("'<f4'", "0", "(2, 3, 4)", "a dictionary"),
        ("'|f4'", "False", "(2, 3, 4)", "`|f4`"),
        ("'=f4'", "False", "(2, 3, 4)", "`=f4`"),
        ("'f4'", "False", "(2, 3, 4)", "`f4`"),
        ("''", "False", "(2, 3, 4)", "``"),
        ("'é4'", "False", "(2, 3, 4)", "astype"),
        ("'<c8'", "False", "(2, 3, 4)", "astype"),
        ("'<f16'", "False", "(2, 3, 4)", "astype"),
        ("'|O'", "False", "(2, 3, 4)", "astype"),
        ("'<U3'", "False", "(2, 3, 4)", "astype"),
        ("[('a', '<f4')]", "False", "(2, 3, 4)", "records"),
        ("__import__('os').abort()", "False", "(2, 3, 4)", "a dictionary"),
    ] {
        let text = header(descr, order, shape);
        let length = 117 - (text.len() - text.chars().count());
        refuse(&file(1, &format!("{text:<length$}\n"), &[0; 96]), expected);
    }
    let turned = with(VolumeOptions::new(), |it| it.transform = Some([[0.0; 4]; 3]));
    assert!(
        build(&directory, &good, &turned).is_err_and(|error| error.to_string().contains("an invertible map"))
    );
    let shallow = with(VolumeOptions::new(), |it| it.depth = Some(1));
    assert!(build(&directory, &good, &shallow).is_err_and(|error| error.to_string().contains("2 to 19")));
}

#[test]
fn a_file_that_shrinks_is_an_error() {
    let directory = tempfile::tempdir().unwrap();
    let (input, path) = (directory.path().join("volume.npy"), directory.path().join("volume.goblin"));
    fs::write(&input, npy(1, "|u1", &[70, 70, 70], &[7; 343_000])).unwrap();
    assert!(is_volume(&input) && !is_volume(directory.path()) && !is_volume(&path));
    let import = plan(&input, &VolumeOptions::new()).unwrap();
    fs::File::options().write(true).open(&input).unwrap().set_len(300_000).unwrap();
    let error = import.build(Output::create(&path).unwrap(), &()).unwrap_err();
    assert!(matches!(error, Error::Corrupt { .. }), "{error}");
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
}
