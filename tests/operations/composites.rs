//! Composites of layers against a naive model, cell by cell.

use std::path::{Path, PathBuf};

use spinney::edit::Note;
use spinney::raw::ops::add_layer;
use spinney::raw::store::TreeWriter;
use spinney::{
    Bounds, DataKind, Dataset, Dimension, FileView, Frame, Metadata, Output, Rule, SampleType, Value,
    ViewOperation, WriteOptions, transform,
};

use crate::common::{Cells, goblin_from_tree, options, quad, value};

const DEPTH: u8 = 7;
const SIZE: [u64; 3] = [90, 80, 1];

/// Cells of a layer, 2^coarser times as large as the finest.
type Layer = (Cells, u8);

/// Writes layers `l0`, `l1`, ..., each with the nodata value, if given.
fn write(path: &Path, layers: &[Layer], nodata: Option<f64>) {
    let output = Output::create(path).unwrap();
    let mut file = TreeWriter::create(output, (Dimension::Quad, DEPTH), layers.len() as u32).unwrap();
    for (number, (cells, coarser)) in layers.iter().enumerate() {
        let metadata = Metadata {
            name: format!("l{number}"),
            frame: Frame::identity().coarser(*coarser),
            nodata: nodata.map(Into::into),
            units: vec![format!("unit {number}")],
            ..Metadata::default()
        };
        let options = options(Rule::Mean, DataKind::Continuous, DEPTH - coarser).metadata(metadata);
        let void = value(cells.form.value, 250);
        file.slabs(cells.form, &mut cells.slabs(void), Some(void), &options, &()).unwrap();
    }
    file.finish().unwrap();
}

fn layers(sample: SampleType, seed: u64, has_void: bool) -> Vec<Layer> {
    let cells = |seed: u64, [width, height]: [u64; 2]| {
        Cells::random(quad(sample, 1), seed, [width, height, 1], 200, has_void)
    };
    vec![
        (cells(seed, [90, 80]), 0),
        (cells(seed + 1, [45, 40]), 1),
        (cells(seed + 2, [90, 80]), 0),
        (cells(seed + 3, [23, 20]), 2),
    ]
}

fn composite(path: &Path, names: &str) -> spinney::Result<Dataset> {
    spinney::open(path)?.view(&[format!("composite={names}").parse()?])
}

/// Returns all cells of a level; `None` is VOID.
fn cells_of(tree: &Dataset, level: u8) -> (Bounds, Vec<Option<Value>>) {
    let bounds = tree.extent_at(level);
    let (cells, width) = (bounds.volume() as usize, tree.header().form.width());
    let (mut bytes, mut valid) = (vec![0; cells * width], vec![false; cells]);
    tree.window(level, &bounds, 0.0, &mut bytes, Some(&mut valid)).unwrap();
    let cells =
        bytes.chunks_exact(width).zip(valid).map(|(bytes, valid)| valid.then(|| Value::from_bytes(bytes)));
    (bounds, cells.collect())
}

/// Returns the composite of some layers' samples, of which `None` are VOID.
fn expected(tree: &Dataset, samples: &[Option<Value>]) -> Option<Value> {
    let value = tree.header().form.value;
    let size = value.sample.size();
    let is_void = match value.is_masked() {
        true => samples.iter().all(Option::is_none),
        false => samples.iter().any(Option::is_none),
    };
    let bytes = samples.iter().flat_map(|sample| {
        let sample = sample.or(value.all_missing()).unwrap_or_default();
        sample.to_bytes()[..size].to_vec()
    });
    (!is_void).then(|| Value::from_bytes(&bytes.collect::<Vec<u8>>()))
}

/// Checks the composite of the numbered layers: cells against the model, upper levels against the
/// layers' own levels.
fn check(tree: &Dataset, file: &Dataset, numbers: &[usize], layers: &[Layer]) {
    let (bounds, found) = cells_of(tree, DEPTH);
    assert_eq!(bounds.max, SIZE);
    for (index, found) in found.iter().enumerate() {
        let [x, y] = [index as u64 % SIZE[0], index as u64 / SIZE[0]];
        let sample = |number: &usize| {
            let (cells, coarser) = &layers[*number];
            cells.get([x >> coarser, y >> coarser, 0])
        };
        let samples: Vec<Option<Value>> = numbers.iter().map(sample).collect();
        assert_eq!(*found, expected(tree, &samples), "{x}, {y}");
    }
    for level in [DEPTH - 1, 5, 3, 0] {
        assert!(!tree.is_approximate(level));
        let (bounds, found) = cells_of(tree, level);
        let of_layers: Vec<(Bounds, Vec<Option<Value>>, u8)> = numbers
            .iter()
            .map(|number| {
                let layer = file.layer(&number.to_string()).unwrap();
                let own = level.min(layer.depth());
                let (bounds, cells) = cells_of(&layer, own);
                (bounds, cells, level - own)
            })
            .collect();
        for (index, found) in found.iter().enumerate() {
            let [x, y] = [index as u64 % bounds.size()[0], index as u64 / bounds.size()[0]];
            let sample = |(bounds, cells, shift): &(Bounds, Vec<Option<Value>>, u8)| {
                cells[((y >> shift) * bounds.size()[0] + (x >> shift)) as usize]
            };
            let samples: Vec<Option<Value>> = of_layers.iter().map(sample).collect();
            assert_eq!(*found, expected(tree, &samples), "level {level}: {x}, {y}");
        }
    }
}

#[test]
fn composites_are_their_layers_side_by_side() {
    let directory = tempfile::tempdir().unwrap();
    for (round, sample) in [SampleType::U8, SampleType::U16, SampleType::F32].into_iter().enumerate() {
        for (name, nodata, has_void) in
            [("a.goblin", Some(250.0), true), ("b.autumn", None, true), ("c.goblin", None, false)]
        {
            let path = directory.path().join(format!("{round}{name}"));
            let layers = layers(sample, 10 * round as u64, has_void);
            write(&path, &layers, nodata);
            let file = spinney::open(&path).unwrap();
            for (names, numbers) in [
                ("l0,l1,l2", &[0, 1, 2][..]),
                ("l3, l0", &[3, 0]),
                ("l2,l2,l1,l3", &[2, 2, 1, 3]),
                ("b1,b4,b2", &[0, 3, 1]),
            ] {
                let tree = composite(&path, names).unwrap();
                let value = tree.header().form.value;
                assert_eq!((value.sample, usize::from(value.channels)), (sample, numbers.len()));
                // The layer of 23 x 20 larger cells extends beyond the others.
                assert_eq!(value.is_masked(), has_void);
                check(&tree, &file, numbers, &layers);
                let names: Vec<String> = numbers.iter().map(|number| format!("l{number}")).collect();
                assert_eq!(tree.metadata().band_names, names);
                assert_eq!(tree.metadata().units[0], format!("unit {}", numbers[0]));
                assert_eq!(tree.metadata().nodata.is_some(), has_void);
            }
        }
    }
}

/// Writes a file from a view.
fn made(path: &Path, steps: &[&str], name: &str) -> PathBuf {
    let steps: Vec<ViewOperation> = steps.iter().map(|step| step.parse().unwrap()).collect();
    let out = path.with_file_name(name);
    transform(
        &FileView { steps, ..FileView::of(path) },
        Output::create(&out).unwrap(),
        WriteOptions::new(1 << 24),
        &(),
    )
    .unwrap();
    out
}

#[test]
fn composites_and_files_of_them_have_the_same_results() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("s.goblin");
    let layers = layers(SampleType::U16, 5, true);
    write(&path, &layers, None);
    let tree = composite(&path, "l0,l1,l2").unwrap();
    let file = spinney::open(made(&path, &["composite=l0,l1,l2"], "made.goblin")).unwrap();
    assert_eq!(file.verify(1 << 24, &()).unwrap(), []);
    assert_eq!(cells_of(&file, DEPTH), cells_of(&tree, DEPTH));
    let part = Bounds { min: [7, 11, 0], max: [71, 64, 1] };
    for bounds in [None, Some(part)] {
        let [mut found, mut expected] = [&tree, &file].map(|tree| tree.statistics(bounds, &()).unwrap());
        (found.segments_read, expected.segments_read) = (0, 0);
        assert_eq!(found, expected);
    }
    // Each channel has the statistics of its layer, without VOID cells.
    let found = tree.statistics(None, &()).unwrap();
    for (number, channel) in [0, 2].into_iter().zip([0, 2]) {
        let layer = spinney::open(&path).unwrap().layer(&number.to_string()).unwrap();
        let own = layer.statistics(None, &()).unwrap();
        let (a, b) = (&found.channels[channel], &own.channels[0]);
        assert_eq!((a.cells, a.min, a.max, a.mean), (b.cells, b.min, b.max, b.mean));
    }
    // Operations before and after it apply to it.
    let turned = spinney::open(made(&path, &["composite=l0,l1,l2", "rotate=90"], "turned.goblin")).unwrap();
    let again = file.view(&["rotate=90".parse().unwrap()]).unwrap();
    assert_eq!(cells_of(&turned, DEPTH), cells_of(&again, DEPTH));
    let cut = spinney::open(made(&path, &["window=8,4,40,50", "composite=l0,l1,l2"], "cut.goblin")).unwrap();
    let again = composite(&path, "l0,l1,l2").unwrap().view(&["window=8,4,40,50".parse().unwrap()]).unwrap();
    let (bounds, found) = cells_of(&cut, cut.depth());
    assert_eq!((bounds, found), cells_of(&again, again.depth()));
}

#[test]
fn numbers_in_use_are_not_nodata() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("l0.goblin");
    // All bytes occur, and VOID: no nodata value is free, and cells are VOID if one layer is.
    let cell = |number: u64| (!number.is_multiple_of(7)).then(|| Value::from([(number % 256) as u8]));
    let cells = |first: u64| Cells {
        form: quad(SampleType::U8, 1),
        size: SIZE,
        cells: (0..SIZE[0] * SIZE[1]).map(|number| cell(number + first)).collect(),
    };
    let layers = [(cells(0), 0), (cells(3), 0), (cells(1), 0)];
    for (number, (cells, _)) in layers.iter().enumerate() {
        let tree = cells.tree_of_depth(DEPTH, Rule::Mean);
        let own = directory.path().join(format!("l{number}.goblin"));
        std::fs::write(&own, goblin_from_tree(&tree, SIZE, Rule::Mean, DataKind::Continuous)).unwrap();
        if number > 0 {
            add_layer(
                &path,
                &format!("l{number}"),
                &FileView::of(&own),
                Note::default(),
                WriteOptions::new(1 << 24),
                &(),
            )
            .unwrap();
        }
    }
    let tree = composite(&path, "l0,l1,l2").unwrap();
    assert!(!tree.header().form.value.is_masked());
    check(&tree, &spinney::open(&path).unwrap(), &[0, 1, 2], &layers);
}

#[test]
fn invalid_composites_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("s.goblin");
    let cells =
        |sample: SampleType, channels: u8| (Cells::random(quad(sample, channels), 3, SIZE, 9, true), 0);
    let layers = [
        cells(SampleType::U8, 1),
        cells(SampleType::U16, 1),
        cells(SampleType::I16, 1),
        cells(SampleType::U8, 3),
    ];
    write(&path, &layers, None);
    for (names, expected) in [
        ("l0,l1", "`l0` of u8, `l1` of u16, expected layers of one type: u8, u16 or f32; to convert a layer"),
        ("l2,l2", "`l2` of i16"),
        ("l0,x", "`x`"),
        ("l0,l3", "l3.b1, l3.b2, l3.b3"),
        ("l0", "1 layers"),
        ("l0,l0,l0,l0,l0", "2 to 4 layers"),
        ("l0,l3.b7", "`l3.b7`"),
    ] {
        let error = composite(&path, names).unwrap_err().to_string();
        assert!(error.contains(expected), "{names}: {error}");
    }
    let tree = composite(&path, "l3.b3,l0").unwrap();
    assert_eq!(tree.metadata().band_names, ["l3", "l0"]);
}
