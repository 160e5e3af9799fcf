//! Manifests of many files, against one file of the same cells: windows at all levels, cells,
//! statistics, zones, trees built from them; corruption and changes.

use std::path::{Path, PathBuf};

use spinney::query::PointSamples;
use spinney::raw::dataset;
use spinney::raw::manifest::{ListedFile, Manifest, list_files};
use spinney::{
    Bounds, DataKind, Dataset, Error, FileView, Frame, OpenOptions, Output, Rule, SampleType, TreeType,
    WriteOptions,
};

use crate::common::{Cells, OCT, Random, made, quad, write_goblin};

/// Files of boxes in a space of cells, and their union.
struct Mosaic {
    directory: tempfile::TempDir,
    whole: Cells,
    manifest: PathBuf,
}

const CELL: f64 = 10.0;

/// Returns the frame of a file that begins at a cell.
fn frame([x, y, z]: [u64; 3]) -> Frame {
    let mut frame =
        Frame::planar([CELL, 0.0, 5000.0 + CELL * x as f64, 0.0, -CELL, 9000.0 - CELL * y as f64]);
    frame.matrix[2][3] = z as f64;
    frame
}

fn open(path: &Path) -> Dataset {
    dataset::open(path, &OpenOptions::default()).unwrap()
}

impl Mosaic {
    /// Writes files of the boxes, later ones on top. Cells are those of one file if boxes do not
    /// overlap, otherwise each box has its own.
    fn new(form: TreeType, (rule, kind): (Rule, DataKind), boxes: &[Bounds], seed: u64) -> Mosaic {
        let directory = tempfile::tempdir().unwrap();
        let size = boxes.iter().fold([1; 3], |size: [u64; 3], bounds| {
            std::array::from_fn(|axis| size[axis].max(bounds.max[axis]))
        });
        let mut parts = Vec::new();
        let mut names = Vec::new();
        for (number, bounds) in boxes.iter().enumerate() {
            let part = Cells::random(form, seed + number as u64, bounds.size(), 9, true);
            let path = directory.path().join(format!("part{number}.goblin"));
            write_goblin(&path, &part, (rule, kind), frame(bounds.min));
            names.push(path);
            parts.push((*bounds, part));
        }
        let whole = made(form, size, |cell| {
            let inside = |bounds: &Bounds| {
                (0..3).all(|axis| (bounds.min[axis]..bounds.max[axis]).contains(&cell[axis]))
            };
            let mut above = parts.iter().rev().filter(|(bounds, _)| inside(bounds));
            above.find_map(|(bounds, part)| {
                part.get(std::array::from_fn(|axis| cell[axis] - bounds.min[axis]))
            })
        });
        write_goblin(&directory.path().join("whole.goblin"), &whole, (rule, kind), frame([0; 3]));
        let manifest = directory.path().join("all.manifest.json");
        list_files(&manifest, false, &names, &[], &Default::default(), &()).unwrap();
        Mosaic { directory, whole, manifest }
    }

    fn datasets(&self) -> (Dataset, Dataset) {
        (open(&self.manifest), open(&self.directory.path().join("whole.goblin")))
    }

    fn window(tree: &Dataset, level: u8, bounds: &Bounds) -> (Vec<u8>, Vec<bool>) {
        let cells = bounds.volume() as usize;
        let (mut bytes, mut valid) = (vec![0; cells * tree.header().form.width()], vec![false; cells]);
        tree.window(level, bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
        (bytes, valid)
    }

    /// Compares all exact results, and coarser levels if `levels` is set.
    fn check(&self, levels: bool) {
        let (found, expected) = self.datasets();
        assert_eq!(found.header().extent, expected.header().extent);
        assert_eq!(found.depth(), expected.depth());
        assert_eq!(found.metadata().frame, expected.metadata().frame);
        assert_eq!(found.is_approximate(0), !levels);
        for level in 0..=found.depth() {
            let all = found.extent_at(level);
            let (values, valid) = Mosaic::window(&found, level, &all);
            let (right, right_valid) = Mosaic::window(&expected, level, &all);
            if level == found.depth() || levels {
                assert_eq!(valid, right_valid, "level {level}");
                assert!(values == right, "level {level}");
            } else {
                // Nodes with cells have values, nodes without have none, except nodes that extend
                // partially beyond.
                let differ = valid.iter().zip(&right_valid).filter(|(a, b)| a != b).count();
                assert!(differ * 4 <= valid.len(), "level {level}: {differ} of {}", valid.len());
            }
        }
        let mut random = Random(5);
        let size = self.whole.size;
        for _ in 0..20 {
            let min: [u64; 3] = size.map(|size| random.below(size));
            let max = std::array::from_fn(|axis| min[axis] + 1 + random.below(size[axis] - min[axis]));
            let part = Bounds { min, max };
            let depth = found.depth();
            assert_eq!(Mosaic::window(&found, depth, &part), Mosaic::window(&expected, depth, &part));
            let statistics = |tree: &Dataset| {
                let statistics = tree.statistics(Some(part), &()).unwrap();
                let channels: Vec<_> =
                    statistics.channels.iter().map(|of| (of.cells, of.min, of.max)).collect();
                (statistics.cells, statistics.void_cells, channels, statistics.classes)
            };
            assert_eq!(statistics(&found), statistics(&expected), "{part:?}");
        }
        let cells: Vec<[u64; 3]> = (0..200).map(|_| size.map(|size| random.below(size + 1))).collect();
        let (mut some, mut others) = (PointSamples::default(), PointSamples::default());
        found.points(&cells, found.depth(), &mut some).unwrap();
        expected.points(&cells, found.depth(), &mut others).unwrap();
        for at in 0..cells.len() {
            assert_eq!(some.get(at), others.get(at));
        }
        // A single file built from it equals the file of the whole.
        let one = self.directory.path().join("one.goblin");
        let output = Output::create(&one).unwrap();
        spinney::transform(&FileView::of(&self.manifest), output, WriteOptions::new(64 << 20), &()).unwrap();
        let (one, depth) = (open(&one), expected.depth());
        for level in 0..=depth {
            let all = one.extent_at(level);
            assert_eq!(Mosaic::window(&one, level, &all), Mosaic::window(&expected, level, &all), "{level}");
        }
        assert!(found.verify(64 << 20, &()).unwrap().is_empty());
        found.check_unchanged().unwrap();
    }
}

fn part(min: [u64; 2], size: [u64; 2]) -> Bounds {
    Bounds { min: [min[0], min[1], 0], max: [min[0] + size[0], min[1] + size[1], 1] }
}

const CLASSES: (Rule, DataKind) = (Rule::Majority, DataKind::Categorical);
const MEANS: (Rule, DataKind) = (Rule::Mean, DataKind::Continuous);

#[test]
fn a_manifest_of_one_file_equals_the_file() {
    Mosaic::new(quad(SampleType::U8, 1), CLASSES, &[part([0, 0], [300, 200])], 1).check(true);
}

#[test]
fn files_side_by_side_are_one() {
    let parts: Vec<Bounds> = [[0, 0], [128, 0], [0, 128], [128, 128]].map(|min| part(min, [128, 128])).into();
    Mosaic::new(quad(SampleType::U8, 1), CLASSES, &parts, 2).check(true);
    Mosaic::new(quad(SampleType::I16, 1), MEANS, &parts, 3).check(true);
    Mosaic::new(quad(SampleType::U8, 1), (Rule::Max, DataKind::Continuous), &parts, 4).check(true);
}

#[test]
fn thirty_files_with_gaps_are_one() {
    let mut parts = Vec::new();
    for number in (0..42).filter(|number| number % 7 != 3 && number % 11 != 5) {
        parts.push(part([number % 7 * 64, number / 7 * 64], [64 - number % 3, 64 - number % 5]));
    }
    assert!(parts.len() >= 30);
    Mosaic::new(quad(SampleType::U8, 1), CLASSES, &parts, 5).check(true);
    Mosaic::new(quad(SampleType::U16, 1), MEANS, &parts, 6).check(true);
}

#[test]
fn files_that_begin_anywhere_and_overlap_have_exact_cells() {
    let mut random = Random(9);
    let mut parts = vec![part([0, 0], [40, 40])];
    for _ in 0..12 {
        parts.push(part(
            [random.below(300), random.below(200)],
            [1 + random.below(150), 1 + random.below(120)],
        ));
    }
    Mosaic::new(quad(SampleType::U8, 1), CLASSES, &parts, 7).check(false);
    Mosaic::new(quad(SampleType::F32, 1), MEANS, &parts, 8).check(false);
}

#[test]
fn octrees_are_one() {
    let cube = |min: [u64; 3]| Bounds { min, max: min.map(|cell| cell + 16) };
    let cubes = [cube([0; 3]), cube([16, 0, 0]), cube([0, 16, 16])];
    Mosaic::new(OCT, CLASSES, &cubes, 10).check(true);
}

#[test]
fn ten_thousand_files_are_listed_without_being_opened() {
    let directory = tempfile::tempdir().unwrap();
    let first = directory.path().join("0.goblin");
    let cells = Cells::random(quad(SampleType::U8, 1), 1, [64, 64, 1], 9, false);
    write_goblin(&first, &cells, CLASSES, frame([0; 3]));
    let path = directory.path().join("all.manifest.json");
    let mut manifest = list_files(&path, false, &[first], &[], &Default::default(), &()).unwrap();
    let entry = manifest.entries[0].clone();
    manifest.entries = (0..10_000)
        .map(|number| ListedFile {
            path: format!("{number}.goblin"),
            bounds: part([number % 100 * 64, number / 100 * 64], [64, 64]),
            ..entry.clone()
        })
        .collect();
    (manifest.header.extent, manifest.header.shape.depth) = ([6400, 6400, 1], 13);
    std::fs::write(&path, manifest.to_text()).unwrap();
    assert_eq!(Manifest::open(&path, &Default::default()).unwrap(), manifest);
    // Only the first file exists: queries that touch it alone succeed, others report the missing
    // file.
    let tree = open(&path);
    let (bytes, _) = Mosaic::window(&tree, 13, &part([3, 5], [20, 30]));
    assert_eq!(bytes[0], cells.get([3, 5, 0]).unwrap().to_bytes()[0]);
    let error = tree.statistics(Some(part([60, 0], [10, 10])), &()).unwrap_err();
    assert!(matches!(&error, Error::Io { path, .. } if path.ends_with("1.goblin")), "{error}");
    let said = format!("{error:?}");
    assert!(said.contains("lists it") && said.contains("--remove 1.goblin"), "{said}");
}

#[test]
fn files_that_changed_or_are_others_are_named() {
    let mosaic =
        Mosaic::new(quad(SampleType::U8, 1), CLASSES, &[part([0, 0], [64, 64]), part([64, 0], [64, 64])], 11);
    let other = mosaic.directory.path().join("part1.goblin");
    let cells = Cells::random(quad(SampleType::U8, 1), 99, [64, 64, 1], 5, true);
    write_goblin(&other, &cells, CLASSES, frame([64, 0, 0]));
    let tree = open(&mosaic.manifest);
    Mosaic::window(&tree, 7, &part([0, 0], [64, 64]));
    let error = tree.statistics(None, &()).unwrap_err().to_string();
    assert!(error.contains("part1.goblin") && error.contains("--add"), "{error}");
    // Listing it again restores it, at its position.
    list_files(&mosaic.manifest, true, std::slice::from_ref(&other), &[], &Default::default(), &()).unwrap();
    assert!(open(&mosaic.manifest).statistics(None, &()).unwrap().cells > 0);
    assert_eq!(Manifest::open(&mosaic.manifest, &Default::default()).unwrap().entries.len(), 2);
    // Files of another tree type or grid, or that are not trees.
    let wide = mosaic.directory.path().join("wide.goblin");
    write_goblin(
        &wide,
        &Cells::random(quad(SampleType::U16, 1), 1, [9, 9, 1], 5, true),
        CLASSES,
        frame([0; 3]),
    );
    let askew = mosaic.directory.path().join("askew.goblin");
    let mut half = frame([0; 3]);
    half.matrix[0][3] += CELL / 2.0;
    write_goblin(&askew, &cells, CLASSES, half);
    let coarse = mosaic.directory.path().join("coarse.goblin");
    write_goblin(&coarse, &cells, CLASSES, frame([0; 3]).coarser(1));
    let before = std::fs::read(&mosaic.manifest).unwrap();
    for bad in [wide, askew, coarse, mosaic.manifest.clone()] {
        let error =
            list_files(&mosaic.manifest, true, std::slice::from_ref(&bad), &[], &Default::default(), &())
                .unwrap_err();
        let name = bad.file_name().unwrap().to_str().unwrap();
        assert!(error.to_string().contains(name), "{error}");
        assert_eq!(std::fs::read(&mosaic.manifest).unwrap(), before);
    }
}

#[test]
fn files_come_and_go() {
    let mosaic = Mosaic::new(
        quad(SampleType::U8, 1),
        CLASSES,
        &[part([64, 64], [64, 64]), part([128, 64], [64, 64])],
        12,
    );
    assert_eq!(open(&mosaic.manifest).header().extent, [128, 64, 1]);
    let west = mosaic.directory.path().join("west.goblin");
    let cells = Cells::random(quad(SampleType::U8, 1), 1, [64, 64, 1], 9, false);
    write_goblin(&west, &cells, CLASSES, frame([0; 3]));
    list_files(&mosaic.manifest, true, &[west], &[], &Default::default(), &()).unwrap();
    let tree = open(&mosaic.manifest);
    assert_eq!((tree.header().extent, &tree.metadata().frame), ([192, 128, 1], &frame([0; 3])));
    let gone = mosaic.directory.path().join("part1.goblin").to_str().unwrap().to_string();
    list_files(&mosaic.manifest, true, &[], std::slice::from_ref(&gone), &Default::default(), &()).unwrap();
    assert_eq!(open(&mosaic.manifest).header().extent, [128, 128, 1]);
    assert!(list_files(&mosaic.manifest, true, &[], &[gone], &Default::default(), &()).is_err());
    // Concurrent updates are rejected.
    let inner = Manifest::update(&mosaic.manifest, true, &Default::default(), &mut |manifest| {
        let other = list_files(&mosaic.manifest, true, &[], &[], &Default::default(), &());
        assert!(matches!(other, Err(Error::Locked { .. })));
        Ok(manifest.unwrap())
    });
    inner.unwrap();
}

#[test]
fn corrupt_manifests_are_rejected() {
    let mosaic = Mosaic::new(quad(SampleType::U8, 1), CLASSES, &[part([0, 0], [64, 64])], 13);
    let text = std::fs::read_to_string(&mosaic.manifest).unwrap();
    let path = mosaic.directory.path().join("bad.manifest.json");
    let try_open = |text: &str| {
        std::fs::write(&path, text).unwrap();
        dataset::open(&path, &OpenOptions::default()).map(|_| ())
    };
    try_open(&text).unwrap();
    let changes = [
        ("\"spinney_manifest\":1", "\"spinney_manifest\":2"),
        ("\"spinney_manifest\": 1", "\"spinney_manifest\": 2"),
        ("\"size\":[64,64,1]", "\"size\":[64,18446744073709551615,1]"),
        ("\"size\":[64,64,1]", "\"size\":[0,64,1]"),
        ("\"at\":[0,0,0]", "\"at\":[1,0,0]"),
        ("\"depth\":6,\"bytes\"", "\"depth\":255,\"bytes\""),
        ("\"depth\": 6", "\"depth\": 200"),
        ("\"extent\": [64,64,1]", "\"extent\": [0,64,1]"),
        ("\"axes\": 2", "\"axes\": 9"),
        ("majority", "most"),
        ("\"tag\":\"", "\"tag\":\"x"),
        ("\"path\":\"", "\"paths\":\""),
        ("\"files\": [", "\"files\": [], \"more\": ["),
    ];
    for (from, to) in changes.iter().skip(1) {
        assert!(text.contains(from), "{from} in {text}");
        let error = try_open(&text.replacen(from, to, 1)).unwrap_err();
        assert!(error.to_string().contains("bad.manifest.json"), "{error}");
    }
    for end in (1..text.len()).step_by(7) {
        assert!(try_open(&text[..end - 1]).is_err() || text[end - 1..].trim().is_empty(), "{end}");
    }
}
