//! Files of format version 1 are read as ever, and building the same gives the same bytes.

#[path = "../examples/make_fixtures/frozen.rs"]
mod frozen;
#[path = "../examples/make_fixtures/island.rs"]
mod island;

use std::path::{Path, PathBuf};

use spinney::space::{Code, Dimension, Oct, Quad};
use spinney::store::autumnal::{Autumnal, History};
use spinney::store::goblin::{Goblin, Header, Layout, OpenOptions};
use spinney::tree::MemTree;
use spinney::value::{Kind, Rule, SampleType, Value, ValueType};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1").join(format!("{name}.goblin"))
}

/// A frozen file, found to be in order.
fn open<D: Layout, V: Value>(name: &str) -> Goblin<D, V> {
    let positioned =
        Goblin::<D, V>::open(&fixture(name), &OpenOptions { positioned: true, ..OpenOptions::default() });
    assert_eq!(positioned.unwrap().verify(1 << 24, &()).unwrap(), []);
    let file = Goblin::<D, V>::open(&fixture(name), &OpenOptions::default()).unwrap();
    assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
    file
}

fn cell<D: Layout, V: Value>(file: &Goblin<D, V>, level: u8, cell: [u32; 3]) -> Option<V> {
    file.value_at(Code::<D>::from_cell(level, cell).unwrap()).unwrap()
}

/// Axes, type, rule, kind, depth, reach, stride, light, extent.
fn numbers(header: &Header) -> (u8, ValueType, Rule, Kind, [u32; 4], [u64; 3]) {
    let shape = header.shape;
    let shape = [shape.depth as u32, shape.reach as u32, shape.stride as u32, shape.light];
    (header.axes, header.value, header.rule, header.kind, shape, header.extent)
}

#[test]
fn the_same_bytes_are_built_today() {
    let folder = tempfile::tempdir().unwrap();
    let island = island::make();
    for name in frozen::FILES {
        let path = folder.path().join(name);
        frozen::make(name, &island, &path).unwrap();
        assert!(std::fs::read(&path).unwrap() == std::fs::read(fixture(name)).unwrap(), "{name} differs");
    }
}

#[test]
fn history() {
    let frozen_path = fixture("history").with_extension("autumn");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("history.autumn");
    frozen::make_history(&island::make(), &path).unwrap();
    assert!(std::fs::read(&path).unwrap() == std::fs::read(&frozen_path).unwrap(), "history differs");
    let cell = |number: u64, x: u32, y: u32| match (number, x, y) {
        (3, 0, 0) => None,
        (3, 7, 7) => Some([2]),
        (2 | 3, 2..=5, 1..=4) => Some([3]),
        _ => Some([frozen::CLASSIC[y as usize][x as usize]]),
    };
    let history = History::open(&frozen_path, &OpenOptions::default()).unwrap();
    let told: Vec<_> = history
        .commits()
        .map(|commit| {
            let commit = commit.unwrap();
            (commit.number, commit.note.time, commit.note.message, commit.cells, commit.records)
        })
        .collect();
    let records = |number| {
        let tree = MemTree::<Quad, _>::from_cells(3, Rule::Dominant, |[x, y, _]| cell(number, x, y));
        tree.inner_nodes() as u64
    };
    let expected = [
        (4, Some(3), "Back to the beginning".to_string(), 64, 10),
        (3, Some(2), "Set two cells".to_string(), 63, records(3)),
        (2, Some(1), "Fill a box".to_string(), 64, records(2)),
        (1, None, String::new(), 64, 10),
    ];
    assert_eq!(told, expected);
    for number in 1..=4 {
        let name = format!("{}@{number}", frozen_path.display());
        let file = Autumnal::<Quad, [u8; 1]>::open(name.as_ref(), &OpenOptions::default()).unwrap();
        assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
        for (x, y) in (0..64).map(|i| (i % 8, i / 8)) {
            let code = Code::from_cell(3, [x, y, 0]).unwrap();
            assert_eq!(file.value_at(code).unwrap(), cell(number, x, y), "{x}, {y} in commit {number}");
        }
    }
}

#[test]
fn classic() {
    let file = open::<Quad, [u8; 1]>("classic");
    let value = ValueType { sample: SampleType::U8, channels: 1 };
    let expected = (2, value, Rule::Dominant, Kind::Categorical, [3, 8, 2, 4096], [8, 8, 1]);
    assert_eq!(numbers(file.header()), expected);
    assert_eq!((file.segments(), file.stored_records(), file.file_size()), (1, 10, 516));
    assert_eq!(file.zone(0).unwrap().classes, [([1], 40), ([2], 15), ([3], 9)]);
    let level_1: Vec<_> = (0..4).map(|i| file.value_at(Code::ROOT.child(i)).unwrap().unwrap()[0]).collect();
    assert_eq!(level_1, [1, 1, 1, 2]);
    for (y, row) in frozen::CLASSIC.iter().enumerate() {
        for (x, class) in row.iter().enumerate() {
            assert_eq!(cell(&file, 3, [x as u32, y as u32, 0]), Some([*class]));
        }
    }
}

#[test]
fn classes() {
    let file = open::<Quad, [u8; 1]>("classes");
    let value = ValueType { sample: SampleType::U8, channels: 1 };
    let expected = (2, value, Rule::Majority, Kind::Categorical, [8, 8, 2, 4096], [256, 200, 1]);
    assert_eq!(numbers(file.header()), expected);
    let metadata = file.metadata();
    assert_eq!(metadata.frame, frozen::frame());
    assert_eq!(metadata.nodata, Some(0.0));
    assert_eq!(metadata.class_names[&4], "forest");
    assert_eq!(metadata.palette.as_ref().unwrap().colours, island::COLOURS);
    assert_eq!(metadata.band_names, ["land cover"]);
    assert_eq!(metadata.provenance, ["made by examples/make_fixtures"]);
    assert_eq!(metadata.tags["AREA_OR_POINT"], "Area");
    let zone = file.zone(0).unwrap();
    let classes: Vec<_> = zone.classes.iter().map(|([class], cells)| (*class, *cells)).collect();
    assert_eq!(classes, CLASSES);
    assert_eq!(zone.cells, CLASSES.iter().map(|(_, cells)| cells).sum::<u64>());
    assert_eq!(cell(&file, 0, [0; 3]), Some([1]));
    assert_eq!(cell(&file, 8, [0, 199, 0]), None);
    assert_eq!(cell(&file, 8, [27, 78, 0]), Some([island::Cover::Lake as u8]));
    assert_eq!(cell(&file, 8, [100, 70, 0]), Some([island::Cover::Snow as u8]));
    assert_eq!(cell(&file, 8, [255, 255, 0]), None);
    assert_eq!(metadata.counts.records(), file.stored_records());
}

const CLASSES: [(u8, u64); 7] =
    [(1, 11450), (2, 1466), (3, 10281), (4, 9549), (5, 2961), (6, 4639), (7, 299)];

#[test]
fn elevation() {
    let file = open::<Quad, [f32; 1]>("elevation");
    let value = ValueType { sample: SampleType::F32, channels: 1 };
    let expected = (2, value, Rule::Mean, Kind::Continuous, [6, 8, 2, 4096], [64, 50, 1]);
    assert_eq!(numbers(file.header()), expected);
    assert_eq!(file.metadata().nodata, Some(-9999.0));
    assert_eq!(file.metadata().scale_offset, [(1.0, 0.0)]);
    let zone = file.zone(0).unwrap();
    assert_eq!((zone.cells, zone.min, zone.max, zone.sum), (1820, [0.0], [2885.75], [876_617.25]));
    assert_eq!(cell(&file, 0, [0; 3]), Some([(876_617.25f64 / 1820.0) as f32]));
    assert_eq!(cell(&file, 6, [25, 18, 0]), Some([1381.875]));
    assert_eq!(cell(&file, 6, [0, 0, 0]), None);
    // Heights are eighths of a metre, so this sum is exact in any order.
    let elevation = island::make().elevation();
    let place = |x: usize, y: usize| y * frozen::STEP * island::WIDTH + x * frozen::STEP;
    let below: Vec<f64> =
        (0..256).filter_map(|i| elevation[place(16 + i % 16, 16 + i / 16)]).map(f64::from).collect();
    let mean = below.iter().sum::<f64>() / below.len() as f64;
    assert_eq!(cell(&file, 2, [1, 1, 0]), Some([mean as f32]));
    assert_eq!(mean as f32, 1192.4966);
}

#[test]
fn rgb() {
    let file = open::<Quad, [u8; 3]>("rgb");
    let value = ValueType { sample: SampleType::U8, channels: 3 };
    let expected = (2, value, Rule::Mean, Kind::Continuous, [6, 8, 2, 4096], [64, 50, 1]);
    assert_eq!(numbers(file.header()), expected);
    assert_eq!(file.metadata().band_names, ["red", "green", "blue"]);
    let zone = file.zone(0).unwrap();
    assert_eq!((zone.cells, zone.sum), (3200, [277_839, 390_006, 347_226]));
    assert_eq!(cell(&file, 0, [0; 3]), Some([87, 122, 109]));
    assert_eq!(cell(&file, 6, [25, 18, 0]), Some([255, 255, 255]));
    assert_eq!(cell(&file, 6, [45, 20, 0]), Some([139, 170, 85]));
    assert_eq!(cell(&file, 6, [63, 50, 0]), None);
}

#[test]
fn ball() {
    let file = open::<Oct, [u8; 1]>("ball");
    let value = ValueType { sample: SampleType::U8, channels: 1 };
    let expected = (3, value, Rule::Mean, Kind::Continuous, [5, 6, 2, 4096], [32, 32, 32]);
    assert_eq!(numbers(file.header()), expected);
    assert_eq!(cell(&file, 0, [0; 3]), Some([255]));
    assert_eq!((cell(&file, 5, [0; 3]), cell(&file, 5, [16; 3])), (None, Some([255])));
    // As full as it looks: 4/3 pi r^3 for r = 14.5.
    let cells = file.zone(0).unwrap().cells;
    assert_eq!(cells, 12_712);
    assert!((cells as f64 - 12_770.0).abs() < 200.0);
    for octant in 0..Oct::CHILDREN {
        assert_eq!(file.value_at(Code::ROOT.child(octant)).unwrap(), Some([255]));
    }
}

#[test]
fn segments() {
    let file = open::<Quad, [u8; 1]>("segments");
    let value = ValueType { sample: SampleType::U8, channels: 1 };
    let expected = (2, value, Rule::Mean, Kind::Continuous, [10, 8, 2, 4096], [1000, 300, 1]);
    assert_eq!(numbers(file.header()), expected);
    let codes: Vec<String> = (0..file.segments()).map(|i| file.entry(i).unwrap().code.to_string()).collect();
    assert_eq!(codes, ["/", "/01"]);
    assert!(file.stored_records() > file.metadata().counts.records(), "upper levels are stored twice");
    assert_eq!(cell(&file, 10, [256, 0, 0]), Some([0]));
    assert_eq!(cell(&file, 10, [258, 0, 0]), Some([100]));
    assert_eq!(cell(&file, 8, [64, 0, 0]), Some([50]));
    assert_eq!(cell(&file, 10, [999, 299, 0]), Some([120]));
    assert_eq!(cell(&file, 10, [1000, 299, 0]), None);
    let zone = file.zone(0).unwrap();
    assert_eq!((zone.cells, zone.min, zone.max), (300_000, [0], [120]));
}
