//! Files of format version 1 remain readable, and building the same input gives the same bytes.

use std::path::{Path, PathBuf};

use spinney::brep::{FaceBuffer, Faces, Location, MassProperties};
use spinney::raw::brep::topology::Topology;
use spinney::raw::store::autumnal::{Autumnal, History};
use spinney::raw::store::goblin::Goblin;
use spinney::raw::value::{DoubleDouble, Sums};
use spinney::tree::MemTree;
use spinney::{
    Code, Codec, DataKind, ExactModel, Header, OpenOptions, Result, Rule, SampleType, TreeType, Value,
    ValueType,
};

use crate::common::{OCT, QUAD, byte, quad};
use crate::frozen_files as frozen;
use crate::island;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/v1").join(format!("{name}.goblin"))
}

/// Opens and verifies a frozen file.
fn open(name: &str) -> Goblin {
    let positioned = Goblin::open(&fixture(name), &OpenOptions::new().positioned(64 << 20));
    assert_eq!(positioned.unwrap().verify(1 << 24, &()).unwrap(), []);
    let file = Goblin::open(&fixture(name), &OpenOptions::new()).unwrap();
    assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
    file
}

fn cell(file: &Goblin, level: u8, cell: [u32; 3]) -> Option<Value> {
    let dimension = file.header().form.dimension;
    file.value_at(Code::from_cell(dimension, level, cell).unwrap()).unwrap()
}

/// Form, rule, kind, depth, reach, stride, heavy threshold, extent.
fn numbers(header: &Header) -> (TreeType, Rule, DataKind, [u32; 4], [u64; 3]) {
    let shape = header.shape;
    let shape = [shape.depth as u32, shape.reach as u32, shape.stride as u32, shape.heavy_threshold];
    (header.form, header.rule, header.kind, shape, header.extent)
}

#[test]
fn the_same_bytes_are_built_today() {
    let directory = tempfile::tempdir().unwrap();
    let island = island::make();
    for name in frozen::FILES {
        let path = directory.path().join(name);
        frozen::make(name, &island, &path).unwrap();
        assert!(std::fs::read(&path).unwrap() == std::fs::read(fixture(name)).unwrap(), "{name} differs");
    }
}

#[test]
fn stacks() {
    let directory = tempfile::tempdir().unwrap();
    let island = island::make();
    for name in frozen::STACKS {
        let (path, frozen_path) = (directory.path().join(name), fixture("classic").with_file_name(name));
        frozen::make_stack(&island, &path).unwrap();
        assert!(std::fs::read(&path).unwrap() == std::fs::read(&frozen_path).unwrap(), "{name} differs");
        let file = spinney::open(&frozen_path).unwrap();
        assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
        let layers: Vec<_> =
            file.layers().unwrap().into_iter().map(|layer| (layer.name, layer.header.depth())).collect();
        let depth = file.depth();
        let expected = [("cover", depth), ("height", depth - 2), ("colour", depth - 2), ("label", depth)];
        assert!(layers.iter().map(|(name, depth)| (&**name, *depth)).eq(expected), "{layers:?}");
        let label = file.layer("label").unwrap().statistics(None, &()).unwrap().channels[0].min;
        assert!(label.to_integer().unwrap() > 1 << 63);
        assert_eq!(file.layer("height").unwrap().metadata().time.as_deref(), Some("2020-06-21"));
    }
}

#[test]
fn history() {
    let frozen_path = fixture("history").with_extension("autumn");
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("history.autumn");
    frozen::make_history(&island::make(), &path).unwrap();
    assert!(std::fs::read(&path).unwrap() == std::fs::read(&frozen_path).unwrap(), "history differs");
    let cell = |number: u64, x: u32, y: u32| match (number, x, y) {
        (3, 0, 0) => None,
        (3, 7, 7) => Some(byte(2)),
        (2 | 3, 2..=5, 1..=4) => Some(byte(3)),
        _ => Some(byte(frozen::CLASSIC[y as usize][x as usize])),
    };
    let history = History::open(&frozen_path, &OpenOptions::default()).unwrap();
    let found: Vec<_> = history
        .commits()
        .map(|commit| {
            let commit = commit.unwrap();
            (commit.number, commit.note.time, commit.note.message, commit.cells, commit.inner_nodes)
        })
        .collect();
    let records = |number| {
        let tree = MemTree::from_cells(QUAD, 3, Rule::Dominant, &|[x, y, _]| cell(number, x, y));
        tree.inner_nodes() as u64
    };
    let expected = [
        (4, Some(3), "Back to the beginning".to_string(), 64, 10),
        (3, Some(2), "Set two cells".to_string(), 63, records(3)),
        (2, Some(1), "Fill a box".to_string(), 64, records(2)),
        (1, None, String::new(), 64, 10),
    ];
    assert_eq!(found, expected);
    for number in 1..=4 {
        let name = format!("{}@{number}", frozen_path.display());
        let file = Autumnal::open(name.as_ref(), &OpenOptions::default()).unwrap();
        assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
        for (x, y) in (0..64).map(|i| (i % 8, i / 8)) {
            let code = Code::from_cell(QUAD.dimension, 3, [x, y, 0]).unwrap();
            assert_eq!(file.value_at(code).unwrap(), cell(number, x, y), "{x}, {y} in commit {number}");
        }
    }
}

#[test]
fn classic() {
    let file = open("classic");
    let expected = (QUAD, Rule::Dominant, DataKind::Categorical, [3, 8, 2, 4096], [8, 8, 1]);
    assert_eq!(numbers(file.header()), expected);
    assert_eq!((file.segments(), file.stored_records(), file.file_size()), (1, 10, 594));
    assert_eq!(file.zone(0).unwrap().classes, [(byte(1), 40), (byte(2), 15), (byte(3), 9)]);
    let child = |i| file.value_at(Code::root(QUAD.dimension).child(i)).unwrap();
    assert_eq!([0, 1, 2, 3].map(child), [1, 1, 1, 2].map(byte).map(Some));
    for (y, row) in frozen::CLASSIC.iter().enumerate() {
        for (x, class) in row.iter().enumerate() {
            assert_eq!(cell(&file, 3, [x as u32, y as u32, 0]), Some(byte(*class)));
        }
    }
}

#[test]
fn large() {
    let file = open("large");
    let expected = (quad(SampleType::F64, 1), Rule::Mean, DataKind::Continuous, [6, 8, 2, 4096], [50, 30, 1]);
    assert_eq!(numbers(file.header()), expected);
    // Of halved values, which are exact.
    let cells = (0..1500).map(|index| 2.0 * (frozen::large(index % 50, index / 50) - 4e15));
    let (sum, squares) = cells.fold((0.0, 0.0), |(sum, squares), half| (sum + half, squares + half * half));
    let variance = (squares / 1500.0 - (sum / 1500.0f64).powi(2)) / 4.0;
    let zone = file.zone(0).unwrap();
    let found = Sums::variance(&zone.sum, &zone.squares, 0, zone.cells);
    assert!((found / variance - 1.0).abs() < 1e-13, "{found} {variance}");
}

#[test]
fn classes() {
    let file = open("classes");
    let expected = (QUAD, Rule::Majority, DataKind::Categorical, [8, 8, 2, 4096], [256, 200, 1]);
    assert_eq!(numbers(file.header()), expected);
    let metadata = file.metadata();
    assert_eq!(metadata.frame, frozen::frame());
    assert_eq!(metadata.nodata, Some(0.0.into()));
    assert_eq!(metadata.class_names[&4.into()], "forest");
    assert_eq!(metadata.palette.as_ref().unwrap().colours, island::COLOURS);
    assert_eq!(metadata.band_names, ["land cover"]);
    assert_eq!(metadata.provenance, ["made by examples/make_fixtures"]);
    assert_eq!(metadata.tags["AREA_OR_POINT"], "Area");
    let zone = file.zone(0).unwrap();
    assert_eq!(zone.classes, CLASSES.map(|(class, cells)| (byte(class), cells)));
    assert_eq!(zone.cells, CLASSES.iter().map(|(_, cells)| cells).sum::<u64>());
    assert_eq!(cell(&file, 0, [0; 3]), Some(byte(1)));
    assert_eq!(cell(&file, 8, [0, 199, 0]), None);
    assert_eq!(cell(&file, 8, [27, 78, 0]), Some(byte(island::Cover::Lake as u8)));
    assert_eq!(cell(&file, 8, [100, 70, 0]), Some(byte(island::Cover::Snow as u8)));
    assert_eq!(cell(&file, 8, [255, 255, 0]), None);
    // Dense blocks take fewer records than nodes would.
    assert_eq!((metadata.counts.records(), file.stored_records()), (3191, 3145));
}

const CLASSES: [(u8, u64); 7] =
    [(1, 11450), (2, 1466), (3, 10281), (4, 9549), (5, 2961), (6, 4639), (7, 299)];

#[test]
fn elevation() {
    let file = open("elevation");
    let expected = (quad(SampleType::F32, 1), Rule::Mean, DataKind::Continuous, [6, 8, 2, 4096], [64, 50, 1]);
    assert_eq!(numbers(file.header()), expected);
    assert_eq!(file.metadata().nodata, Some((-9999.0).into()));
    assert_eq!(file.metadata().scale_offset, [(1.0, 0.0)]);
    let zone = file.zone(0).unwrap();
    let height = |metres: f32| Some(Value::from([metres]));
    assert_eq!((zone.cells, Some(zone.min), Some(zone.max)), (1820, height(0.0), height(2885.75)));
    assert_eq!(zone.sum, Sums::Double([876_617.25, 0.0, 0.0, 0.0].map(DoubleDouble::from)));
    assert_eq!(cell(&file, 0, [0; 3]), height((876_617.25f64 / 1820.0) as f32));
    assert_eq!(cell(&file, 6, [25, 18, 0]), height(1381.875));
    assert_eq!(cell(&file, 6, [0, 0, 0]), None);
    // Heights are eighths of a metre, so this sum is exact in any order.
    let elevation = island::make().elevation();
    let index = |x: usize, y: usize| y * frozen::STEP * island::WIDTH + x * frozen::STEP;
    let below: Vec<f64> =
        (0..256).filter_map(|i| elevation[index(16 + i % 16, 16 + i / 16)]).map(f64::from).collect();
    let mean = below.iter().sum::<f64>() / below.len() as f64;
    assert_eq!(cell(&file, 2, [1, 1, 0]), height(mean as f32));
    assert_eq!(mean as f32, 1192.4966);
}

#[test]
fn rgb() {
    let file = open("rgb");
    let expected = (quad(SampleType::U8, 3), Rule::Mean, DataKind::Continuous, [6, 8, 2, 4096], [64, 50, 1]);
    assert_eq!(numbers(file.header()), expected);
    assert_eq!(file.metadata().band_names, ["red", "green", "blue"]);
    let colour = |channels: [u8; 3]| Some(Value::from(channels));
    let zone = file.zone(0).unwrap();
    assert_eq!((zone.cells, zone.sum), (3200, Sums::Exact([277_839, 390_006, 347_226, 0])));
    assert_eq!(cell(&file, 0, [0; 3]), colour([87, 122, 109]));
    assert_eq!(cell(&file, 6, [25, 18, 0]), colour([255, 255, 255]));
    assert_eq!(cell(&file, 6, [45, 20, 0]), colour([139, 170, 85]));
    assert_eq!(cell(&file, 6, [63, 50, 0]), None);
}

#[test]
fn rgba() {
    let file = open("rgba");
    let value_type = ValueType::new(SampleType::U8, 4).with_alpha();
    let form = TreeType { value: value_type, ..quad(SampleType::U8, 4) };
    let expected = (form, Rule::Mean, DataKind::Continuous, [6, 8, 2, 4096], [64, 50, 1]);
    assert_eq!(numbers(file.header()), expected);
    assert_eq!(file.metadata().alpha, Some(3));
    let island = island::make();
    let image = island.image();
    let mut sums = [0; 4];
    let mut seen = 0;
    for (y, x) in (0..50).flat_map(|y| (0..64).map(move |x| (y, x))) {
        let index = y * frozen::STEP * island::WIDTH + x * frozen::STEP;
        let value = frozen::rgba(island.cover[index], image[index]);
        assert_eq!(cell(&file, 6, [x as u32, y as u32, 0]), Some(value), "{x}, {y}");
        let samples: [u8; 4] = value.to_bytes()[..4].try_into().unwrap();
        if samples[3] > 0 {
            seen += 1;
            sums.iter_mut().zip(samples).for_each(|(sum, sample)| *sum += i128::from(sample));
        }
    }
    let zone = file.zone(0).unwrap();
    assert!(seen < zone.cells);
    assert_eq!((zone.cells, zone.present, zone.sum), (3200, [seen; 4], Sums::Exact(sums)));
    let mean = sums.map(|sum| ((2 * sum + i128::from(seen)) / (2 * i128::from(seen))) as u8);
    assert_eq!(cell(&file, 0, [0; 3]), Some(Value::from(mean)));
}

#[test]
fn ball() {
    let file = open("ball");
    let expected = (OCT, Rule::Mean, DataKind::Continuous, [5, 6, 2, 4096], [32, 32, 32]);
    assert_eq!(numbers(file.header()), expected);
    assert_eq!(cell(&file, 0, [0; 3]), Some(byte(255)));
    assert_eq!((cell(&file, 5, [0; 3]), cell(&file, 5, [16; 3])), (None, Some(byte(255))));
    // The volume of a ball: 4/3 pi r^3 for r = 14.5.
    let cells = file.zone(0).unwrap().cells;
    assert_eq!(cells, 12_712);
    assert!((cells as f64 - 12_770.0).abs() < 200.0);
    for octant in 0..8 {
        assert_eq!(file.value_at(Code::root(OCT.dimension).child(octant)).unwrap(), Some(byte(255)));
    }
}

#[test]
fn segments() {
    let file = open("segments");
    let expected = (QUAD, Rule::Mean, DataKind::Continuous, [10, 8, 2, 4096], [1000, 300, 1]);
    assert_eq!(numbers(file.header()), expected);
    let codes: Vec<String> = (0..file.segments()).map(|i| file.entry(i).unwrap().code.to_string()).collect();
    assert_eq!(codes, ["/", "/01"]);
    assert!(file.stored_records() > file.metadata().counts.records(), "upper levels are stored twice");
    assert_eq!(cell(&file, 10, [256, 0, 0]), Some(byte(0)));
    assert_eq!(cell(&file, 10, [258, 0, 0]), Some(byte(100)));
    assert_eq!(cell(&file, 8, [64, 0, 0]), Some(byte(50)));
    assert_eq!(cell(&file, 10, [999, 299, 0]), Some(byte(120)));
    assert_eq!(cell(&file, 10, [1000, 299, 0]), None);
    let zone = file.zone(0).unwrap();
    assert_eq!((zone.cells, zone.min, zone.max), (300_000, byte(0), byte(120)));
}

/// Opens a frozen exact model, plain and packed, mapped and with positioned reads, and checks that
/// it equals a new build.
fn models(name: &str, make: fn(&Path, Codec) -> Result<()>) -> Vec<ExactModel> {
    let mut models = Vec::new();
    for (codec, end) in frozen::CODECS {
        let path = fixture(&format!("{name}{end}"));
        let directory = tempfile::tempdir().unwrap();
        let made = directory.path().join("model.goblin");
        make(&made, codec).unwrap();
        assert!(std::fs::read(&made).unwrap() == std::fs::read(&path).unwrap(), "{name}{end} differs");
        for options in [OpenOptions::new().positioned(64 << 20), OpenOptions::new()] {
            let model = ExactModel::open(&path, &options).unwrap();
            assert_eq!(model.codec(), codec);
            models.push(model);
        }
    }
    models
}

/// The exact model: a nave with a passage and a crypt, and a hollow dome.
#[test]
fn chapel() {
    for model in models(frozen::MODEL, frozen::make_model) {
        assert_eq!(model.verify(16 << 20, &()).unwrap(), []);
        assert_eq!(
            (model.parts(), model.metadata().tags["unit"].as_str()),
            (&frozen::PARTS.map(String::from)[..], "m")
        );
        assert_eq!(model.metadata().frame.crs.as_ref().unwrap().to_string(), "EPSG:2056");
        assert!(model.segments() > 1, "{} segments", model.segments());
        let mut buffer = FaceBuffer::default();
        model.face(0, &mut buffer).unwrap();
        let gable = buffer.face();
        assert_eq!((gable.rings().count(), gable.points.len(), gable.colours[0]), (2, 9, frozen::PAINT[0]));
        model.face(model.len() - 1, &mut buffer).unwrap();
        let last = buffer.face();
        assert_eq!((last.part, last.source, last.colours[2]), (1, last.number + 2, frozen::PAINT[1]));
        // One component with a through hole and a cavity, and a dome with another cavity.
        let euler = Topology::of(&model, &Default::default(), &()).unwrap().euler();
        assert_eq!((euler.shells, euler.genus, euler.rings, euler.boundaries), (4, Some(1), 2, 0));
        let nave = 20.0 * (10.0 * 8.0 + 10.0 * 5.0 / 2.0 - 4.0 * 4.0) - 2.0 * 4.0;
        let dome = DOME as f64 / 6e6;
        let volume = MassProperties::of(&model, &()).unwrap().volume;
        assert!((volume - nave - dome).abs() < 1e-9, "{volume}");
        let at = |x: f64, y: f64, z: f64| model.locate([2_650_000.0 + x, 1_250_000.0 + y, z - 1.0]).unwrap();
        for (point, location) in [
            ([2.0, 2.0, 2.0], Location::Inside),
            ([6.0, 10.0, 5.0], Location::Outside),
            ([2.0, 7.0, 2.0], Location::Outside),
            ([6.0, 5.0, 13.99], Location::Inside),
            ([6.0, 5.0, 14.01], Location::Outside),
            ([6.0, 5.0, 14.0], Location::Boundary),
            ([24.0, 12.0, 4.99], Location::Inside),
            ([24.0, 12.0, 4.0], Location::Outside),
            ([28.0, 12.0, 1.0], Location::Boundary),
            ([28.0, 12.0, 3.0], Location::Outside),
        ] {
            assert_eq!(at(point[0], point[1], point[2]), location, "{point:?}");
        }
    }
}

/// The model with off-grid vertices, and all metadata of its parts.
#[test]
fn crossing() {
    for model in models(frozen::CROSSING, frozen::make_crossing) {
        assert_eq!(model.verify(16 << 20, &()).unwrap(), []);
        let (exact, proxies) = model.exact_faces();
        assert!(exact > 8 && proxies >= exact, "{exact} {proxies}");
        assert_eq!(model.parts(), frozen::ABOUT.map(|(name, _)| name));
        for (part, (name, about)) in (0..).zip(frozen::ABOUT) {
            assert_eq!(model.part_attributes(part).unwrap().as_deref(), about);
            assert_eq!(model.part_number(name).unwrap(), Some(part));
        }
        assert_eq!(model.file_attributes().unwrap(), [frozen::ABOUT_FILE]);
        let formula = r#"(op2 (op7 "(memory)" "(memory)" "(memory)" "(memory)") "(memory)")"#;
        assert_eq!(model.formula().unwrap().as_deref(), Some(formula));
        let volume = MassProperties::of(&model, &()).unwrap().volume;
        assert!((volume - CROSSING).abs() < 1e-9 * CROSSING, "{volume}");
    }
}

/// Its volume, computed in rational numbers from the volumes of its convex components and their
/// intersections, and that of two cubes next to them.
const CROSSING: f64 = 4656.597168299902 + 2.0 * 1.5 * 1.5 * 1.5;

/// Six times the dome's volume in cubic centimetres: the sum of the determinants of its triangles.
const DOME: i64 = 164_519_480;
