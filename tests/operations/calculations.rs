//! Trees of calculations against a naive model, and against files written from them.

use std::path::{Path, PathBuf};

use spinney::query::{Condition, EdgeRule, FoundBlock, Polygon};
use spinney::raw::dataset;
use spinney::raw::space::Cell;
use spinney::raw::store::{build_tree, depth_for};
use spinney::tree::MemTree;
use spinney::{
    Bounds, BuildOptions, DataKind, Dataset, Dimension, FileView, Frame, Metadata, Number, OpenOptions,
    Output, Result, Rule, SampleType, TreeType, Value, ValueType, ViewOperation, WriteOptions, transform,
};

/// Returns a cell's number: large patches, some alike, some noise; some cells are VOID.
fn number(seed: u64, [x, y, z]: Cell) -> Option<u64> {
    let mix = |seed: u64, x: u32, y: u32, z: u32| {
        let mixed = (u64::from(x) << 42 ^ u64::from(y) << 21 ^ u64::from(z)).wrapping_add(seed << 7);
        let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (mixed ^ mixed >> 32).wrapping_mul(0x94d0_49bb_1331_11eb) >> 40
    };
    let patch = mix(seed, x / 32, y / 32, z / 32);
    match patch % 4 {
        0 => None,
        1 => Some(patch >> 3 & 127),
        _ => {
            let noise = mix(seed ^ 99, x, y, z);
            (!noise.is_multiple_of(5)).then_some(noise >> 3 & 127)
        }
    }
}

/// A file of such numbers in a directory.
struct TestFile {
    path: PathBuf,
    value: ValueType,
    seed: u64,
}

impl TestFile {
    fn new(
        directory: &Path,
        name: &str,
        (dimension, value): (Dimension, ValueType),
        (extent, frame): ([u64; 3], Frame),
        bands: &[&str],
    ) -> TestFile {
        let path = directory.join(name);
        let seed = name.len() as u64 + u64::from(name.as_bytes()[0]);
        let depth = depth_for(extent);
        let cell = |cell: Cell| {
            let inside = (0..3).all(|axis| u64::from(cell[axis]) < extent[axis]);
            // The second channel has other numbers.
            let samples = |channel: usize| number(seed + channel as u64 * 5, cell).unwrap_or(3) as f64;
            (inside && number(seed, cell).is_some()).then(|| value.nearest(samples))
        };
        let tree = MemTree::from_cells(TreeType::new(dimension, value), depth, Rule::Mean, &cell);
        let metadata = Metadata {
            frame,
            band_names: bands.iter().map(ToString::to_string).collect(),
            ..Metadata::default()
        };
        let options = BuildOptions::new(DataKind::Continuous, depth).metadata(metadata);
        build_tree(&tree, extent, &options, Output::create(&path).unwrap(), &()).unwrap();
        TestFile { path, value, seed }
    }

    fn open(&self) -> Dataset {
        dataset::open(&self.path, &OpenOptions::default()).unwrap()
    }
}

/// Returns one channel of a box of cells of a level; `None` where they are VOID or outside of the
/// space.
fn numbers(tree: &Dataset, level: u8, bounds: &Bounds, channel: usize) -> Vec<Option<f64>> {
    let value = tree.header().form.value;
    let cells = bounds.volume() as usize;
    let (mut bytes, mut valid) = (vec![0; cells * value.size()], vec![false; cells]);
    tree.window(level, bounds, 7.0, &mut bytes, Some(&mut valid)).unwrap();
    let cells = bytes.chunks_exact(value.size()).zip(valid);
    cells
        .map(|(bytes, valid)| {
            let number = value.samples(Value::from_bytes(bytes))[channel];
            assert!(valid || number == 7.0);
            valid.then_some(number)
        })
        .collect()
}

fn view(tree: &TestFile, steps: &[&str]) -> Result<Dataset> {
    let steps: Result<Vec<ViewOperation>> = steps.iter().map(|step| step.parse()).collect();
    tree.open().view(&steps?)
}

fn f32_of(number: Option<f64>) -> Option<f64> {
    number.map(|number| f64::from(number as f32))
}

fn ndvi(red: Option<f64>, near: Option<f64>) -> Option<f64> {
    let (red, near) = (red?, near?);
    (near + red != 0.0).then(|| (near - red) / (near + red))
}

const EXTENT: [u64; 3] = [330, 271, 1];

fn two_channels(directory: &Path) -> TestFile {
    let form = (Dimension::Quad, ValueType::new(SampleType::U16, 2));
    TestFile::new(
        directory,
        "base.goblin",
        form,
        (EXTENT, Frame::planar([1.0, 0.0, 0.0, 0.0, -1.0, 0.0])),
        &["red", "near infrared"],
    )
}

#[test]
fn windows_at_every_level_are_arithmetic_on_windows() {
    let directory = tempfile::tempdir().unwrap();
    let base = two_channels(directory.path());
    let file = base.open();
    let tree = view(&base, &["calc='(b2-red)/(\"near infrared\"+b1)'"]).unwrap();
    assert_eq!(tree.header().form.value, ValueType::new(SampleType::F32, 1));
    for level in 0..=tree.depth() {
        assert_eq!(tree.is_approximate(level), level < tree.depth());
        let mut bounds = tree.extent_at(level);
        // Including some cells beyond the extent.
        bounds.max[0] = (bounds.max[0] + 3).min(1 << level);
        let (red, near) = (numbers(&file, level, &bounds, 0), numbers(&file, level, &bounds, 1));
        let expected: Vec<Option<f64>> =
            red.iter().zip(&near).map(|(red, near)| f32_of(ndvi(*red, *near))).collect();
        assert_eq!(numbers(&tree, level, &bounds, 0), expected, "level {level}");
        let size = bounds.size();
        for index in [0, expected.len() / 2, expected.len() - 1] {
            let cell = [index as u64 % size[0], index as u64 / size[0], 0];
            let mut value = [Number::default(); 4];
            let found = tree.point(cell, level, &mut value).unwrap();
            assert_eq!(found.then_some(value[0].to_f64()), expected[index], "level {level}, {cell:?}");
        }
        // A window of it is the same.
        let part =
            Bounds { min: bounds.max.map(|cell| cell / 3), max: bounds.max.map(|cell| cell.div_ceil(2)) };
        let all = |x: u64, y: u64| expected[(y * size[0] + x) as usize];
        let cells = (part.min[1]..part.max[1]).flat_map(|y| (part.min[0]..part.max[0]).map(move |x| (x, y)));
        let of_part: Vec<_> = cells.map(|(x, y)| all(x, y)).collect();
        assert_eq!(numbers(&tree, level, &part, 0), of_part);
    }
    assert!(!file.is_approximate(0));
}

/// Writes a file from operations, and runs the same queries on it and on the view.
fn check_file_and_view(directory: &Path, base: &TestFile, steps: &[&str]) -> Dataset {
    let tree = view(base, steps).unwrap();
    let path = directory.join("made.goblin");
    let mut chain = FileView::of(&base.path);
    chain.steps = steps.iter().map(|step| step.parse().unwrap()).collect();
    let outcome =
        transform(&chain, Output::create(&path).unwrap(), WriteOptions::new(64 << 20), &()).unwrap();
    let made = dataset::open(&path, &OpenOptions::default()).unwrap();
    assert!(made.verify(64 << 20, &()).unwrap().is_empty());
    assert_eq!(made.header().form, tree.header().form);
    assert_eq!((made.header().rule, made.header().kind), (tree.header().rule, tree.header().kind));
    assert_eq!((made.metadata().frame.matrix, made.depth()), (tree.metadata().frame.matrix, tree.depth()));
    let (depth, whole) = (tree.depth(), tree.header().extent_bounds());
    assert_eq!(made.header().extent_bounds(), whole);
    assert_eq!(numbers(&tree, depth, &whole, 0), numbers(&made, depth, &whole, 0), "{steps:?}");
    // Results reported as exact are exact.
    let part =
        Bounds { min: whole.max.map(|cell| cell / 4), max: whole.max.map(|cell| (cell * 3).div_ceil(4)) };
    for bounds in [whole, part] {
        let (a, b) =
            (tree.statistics(Some(bounds), &()).unwrap(), made.statistics(Some(bounds), &()).unwrap());
        assert_eq!((a.cells, a.void_cells, &a.classes), (b.cells, b.void_cells, &b.classes));
        for (a, b) in a.channels.iter().zip(&b.channels) {
            assert!(a.min == b.min && a.max == b.max && (a.mean - b.mean).abs() < 1e-9, "{a:?} {b:?}");
        }
        let histogram = |tree: &Dataset| tree.histogram(&bounds, -1.0, 60.0, 7, &()).unwrap();
        assert_eq!(histogram(&tree), histogram(&made));
        if bounds == whole {
            assert_eq!(a.cells, outcome.after);
        }
    }
    let found = |tree: &Dataset| {
        let mut cells = 0;
        let mut count = |block: FoundBlock| {
            cells += block.bounds.volume();
            Ok(true)
        };
        let condition = Condition::Above(0.25.into());
        tree.find(condition, None, &(), &mut count).unwrap();
        cells
    };
    assert_eq!(found(&tree), found(&made));
    if tree.header().form.axes() == 2 {
        let triangle = Polygon::new(&[vec![[10.3, 7.1], [290.0, 60.0], [90.0, 270.0]]]).unwrap();
        let zones = |tree: &Dataset| {
            tree.zonal(std::slice::from_ref(&triangle), &EdgeRule::Area.into(), &()).unwrap()
        };
        let (a, b) = (zones(&tree), zones(&made));
        assert!((a[0].cells - b[0].cells).abs() < 1e-6, "{} {}", a[0].cells, b[0].cells);
    }
    assert_eq!(tree.data_box().unwrap(), made.data_box().unwrap());
    tree
}

#[test]
fn files_and_views_agree() {
    let directory = tempfile::tempdir().unwrap();
    let base = two_channels(directory.path());
    let calc = "calc='(b2-b1)/(b2+b1)'";
    for steps in [
        &[calc][..],
        &["calc=where(b1>60,b1,b2/2),type=u8"],
        &["calc=count(b1,b2)"],
        &["calc=5,type=i16"],
        &["calc=b1*0+3"],
        &["calc=sqrt(-b1)"],
        &["reduce=median"],
        &["calc=max(b1,b2,100)", "calc=b1/2"],
        &[calc, "window=33,17,200,230"],
        &[calc, "tree-depth=10"],
        &["window=33,17,200,230", calc],
        &[calc, "mirror=x"],
        &["rotate=30", "calc=b2-b1"],
        &["scale=0.5", "calc=b2-b1"],
        &["tree-depth=10", "calc=count(b1)"],
        &[calc, "depth=6"],
    ] {
        check_file_and_view(directory.path(), &base, steps);
    }
}

#[test]
fn files_with_other_extents_types_and_cells_are_operands() {
    let directory = tempfile::tempdir().unwrap();
    let base = two_channels(directory.path());
    let quad = |sample| (Dimension::Quad, ValueType::new(sample, 1));
    // Cells twice as large, of which the last extends beyond the other tree.
    let coarse = Frame::planar([2.0, 0.0, 0.0, 0.0, -2.0, 0.0]);
    let coarse =
        TestFile::new(directory.path(), "coarse.goblin", quad(SampleType::U8), ([165, 136, 1], coarse), &[]);
    // Forty cells to the left, and ten above.
    let moved = Frame::planar([1.0, 0.0, -40.0, 0.0, -1.0, 10.0]);
    let moved = TestFile::new(
        directory.path(),
        "moved, b.goblin",
        quad(SampleType::F32),
        ([250, 200, 1], moved),
        &[],
    );
    let step =
        format!("calc=where(c>60,b1-c,max(m,b2)),c={},m=\"{}\"", coarse.path.display(), moved.path.display());
    let tree = check_file_and_view(directory.path(), &base, &[&step]);
    assert_eq!(tree.header().extent, [370, 282, 1]);
    assert_eq!(tree.metadata().frame.matrix[0][3], -40.0);
    let cell_of = |file: &TestFile, x: i64, y: i64, extent: [u64; 3], channel: u64| -> Option<f64> {
        let inside = x >= 0 && y >= 0 && (x as u64) < extent[0] && (y as u64) < extent[1];
        let cell = [x as u32, y as u32, 0];
        let there = inside && number(file.seed, cell).is_some();
        there.then(|| {
            let number = number(file.seed + 5 * channel, cell).unwrap_or(3);
            file.value.sample.nearest((number as f64).into()).to_f64()
        })
    };
    let whole = tree.header().extent_bounds();
    let found = numbers(&tree, tree.depth(), &whole, 0);
    let mut present = 0;
    for (index, found) in found.into_iter().enumerate() {
        let (x, y) = (index as i64 % 370 - 40, index as i64 / 370 - 10);
        let b = |channel| cell_of(&base, x, y, EXTENT, channel);
        let c = cell_of(&coarse, x.div_euclid(2), y.div_euclid(2), [165, 136, 1], 0);
        let m = cell_of(&moved, x + 40, y + 10, [250, 200, 1], 0);
        let most = [m, b(1)].into_iter().flatten().reduce(f64::max);
        let expected = c.and_then(|c| if c > 60.0 { b(0).map(|b| b - c) } else { most });
        assert_eq!(found, expected, "{x} {y}");
        present += usize::from(expected.is_some());
    }
    assert!(present > 20_000);
    // Coarser cells take precedence: the result has these, and means of the finer ones.
    let step = format!("calc=b1+b.red,b={}", base.path.display());
    let tree = view(&coarse, &[&step]).unwrap();
    assert_eq!(tree.header().extent, [165, 136, 1]);
    // If levels are aligned, the calculation uses the level's own values.
    let (level, bounds) = (tree.depth() - 2, Bounds::of_extent([41, 34, 1]));
    let (base, coarse) = (base.open(), coarse.open());
    let (a, b) =
        (numbers(&coarse, coarse.depth() - 2, &bounds, 0), numbers(&base, base.depth() - 3, &bounds, 0));
    let expected: Vec<Option<f64>> =
        a.iter().zip(&b).map(|(a, b)| f32_of(a.zip(*b).map(|(a, b)| a + b))).collect();
    assert_eq!(numbers(&tree, level, &bounds, 0), expected);
}

#[test]
fn coarser_cells_of_a_file_are_made_of_its_cells() {
    let directory = tempfile::tempdir().unwrap();
    let base = two_channels(directory.path());
    let calc = "calc='(b2-b1)/(b2+b1)'";
    let cells = check_file_and_view(directory.path(), &base, &[calc]);
    let coarse = check_file_and_view(directory.path(), &base, &[calc, "scale=0.125"]);
    let fine = numbers(&cells, cells.depth(), &Bounds::of_extent([328, 264, 1]), 0);
    let found = numbers(&coarse, coarse.depth(), &Bounds::of_extent([41, 33, 1]), 0);
    let approximate = numbers(&cells, cells.depth() - 3, &Bounds::of_extent([41, 33, 1]), 0);
    let mut off = 0;
    for (index, found) in found.iter().enumerate() {
        let (x, y) = (index % 41 * 8, index / 41 * 8);
        let block = (y..y + 8).flat_map(|y| fine[y * 328 + x..][..8].iter().flatten());
        let (count, sum) = block.fold((0.0, 0.0), |(count, sum), number| (count + 1.0, sum + number));
        assert!(found.map_or(count == 0.0, |found| (found - sum / count).abs() < 1e-6), "{x} {y}");
        off += usize::from(approximate[index] != *found);
    }
    assert!(off > 100);
}

#[test]
fn octrees_are_calculated_with() {
    let directory = tempfile::tempdir().unwrap();
    let form = (Dimension::Oct, ValueType::new(SampleType::F32, 1));
    let a = TestFile::new(directory.path(), "a.goblin", form, ([66, 35, 40], Frame::identity()), &[]);
    let b = TestFile::new(directory.path(), "other.goblin", form, ([66, 35, 40], Frame::identity()), &[]);
    let step = format!("calc=where(b1>b,b1,-b),b={}", b.path.display());
    let tree = check_file_and_view(directory.path(), &a, &[&step]);
    let (first, second) = (a.open(), b.open());
    for level in [3, tree.depth() - 1, tree.depth()] {
        let bounds = tree.extent_at(level);
        let (a, b) = (numbers(&first, level, &bounds, 0), numbers(&second, level, &bounds, 0));
        let expected: Vec<Option<f64>> =
            a.iter().zip(&b).map(|(a, b)| a.zip(*b).map(|(a, b)| if a > b { a } else { -b })).collect();
        assert_eq!(numbers(&tree, level, &bounds, 0), expected);
    }
    let quad = two_channels(directory.path());
    let step = format!("calc=b,b={}", quad.path.display());
    assert!(view(&a, &[&step]).unwrap_err().to_string().contains("quadtree"));
}

#[test]
fn unknown_names_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let base = two_channels(directory.path());
    let path = base.path.display();
    for (step, expected) in [
        (
            "calc=green".to_string(),
            "`red`, `near infrared`, b1 to b2; or a file after the expression: green=FILE",
        ),
        ("calc=b3".into(), "`b3`"),
        ("calc=b0".into(), "`b0`"),
        ("calc=x.red".into(), "`x.red`"),
        (format!("calc=x,x={path}"), "x.red, x.near infrared"),
        (format!("calc=x.blue,x={path}"), "red, near infrared"),
        (format!("calc=b1,x={path}"), "the unused file `x`"),
        ("calc=x,x=/nowhere/x.goblin".into(), "nowhere"),
    ] {
        let error = view(&base, &[&step]).unwrap_err().to_string();
        assert!(error.contains(expected), "{step}: {error}");
    }
    // Files take precedence.
    let step = format!("calc=red.b2-b2,red={path}");
    let tree = view(&base, &[&step]).unwrap();
    let statistics = tree.statistics(None, &()).unwrap();
    assert_eq!((statistics.channels[0].min, statistics.channels[0].max), (0.into(), 0.into()));
}

#[test]
fn whole_numbers_of_classes_are_classes() {
    let directory = tempfile::tempdir().unwrap();
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
    let cell = |[x, y, _]: Cell| Some(Value::from([(x / 16 + y / 16) as u8]));
    let tree = MemTree::from_cells(form, 7, Rule::Majority, &cell);
    let path = directory.path().join("classes.goblin");
    let options = BuildOptions::new(DataKind::Categorical, 7);
    build_tree(&tree, [128, 128, 1], &options, Output::create(&path).unwrap(), &()).unwrap();
    let open = || dataset::open(&path, &OpenOptions::default()).unwrap();
    let classes = open().view(&["calc=where(b1==3,7,b1),type=u8".parse().unwrap()]).unwrap();
    assert_eq!((classes.header().kind, classes.header().rule), (DataKind::Categorical, Rule::Majority));
    assert!(!classes.statistics(None, &()).unwrap().classes.iter().any(|(class, _)| *class == 3.0));
    let share = open().view(&["calc=b1==3".parse().unwrap()]).unwrap();
    assert_eq!((share.header().kind, share.header().rule), (DataKind::Continuous, Rule::Mean));
}
