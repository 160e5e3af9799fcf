//! Operations on real rasters, cell by cell: against arrays of the files' contents, and against
//! NumPy if it is installed.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use spinney::export::{Detail, WindowRequest, export_window};
use spinney::import::raster::ImportOptions;
use spinney::raw::dataset;
use spinney::raw::export::image::Format;
use spinney::raw::import::raster::{self, Pixels, RasterOptions};
use spinney::raw::ops::{ClassMatching, Prefer, ReconcileOptions};
use spinney::{
    CombineOperation, CombineOptions, Crs, DataKind, FileView, Output, Region, SampleType, SetOperation,
    Value, WriteOptions,
};
use tempfile::TempDir;

use crate::common::{Cells, made, quad, set_operation, shared_data, with};

/// Samples of any type.
type Grid = Cells;

fn grid(size: [u64; 3], cells: Vec<Option<Value>>) -> Grid {
    Cells { form: quad(SampleType::F64, 1), size, cells }
}

fn value(number: f64) -> Value {
    Value::from([number])
}

fn number(value: Value) -> f64 {
    f64::from_le_bytes(value.to_bytes()[..8].try_into().unwrap())
}

const MEMORY: u64 = 64 << 20;

/// A tree, its expected contents, and the nodata value of arrays exported from it.
struct Tree {
    file: PathBuf,
    grid: Grid,
    sample: SampleType,
}

impl Tree {
    /// Returns a value that no cell has.
    fn void(&self) -> f64 {
        match self.sample {
            SampleType::U8 => 255.0,
            SampleType::U16 => 65535.0,
            SampleType::I16 => -32768.0,
            _ => -1e6,
        }
    }

    /// Returns the allowed difference: means of floating-point samples are rounded once, from sums
    /// in any order.
    fn tolerance(&self) -> f64 {
        if self.sample.is_float() { 1e-3 } else { 0.0 }
    }
}

/// Files, and checks for NumPy to repeat.
struct Bench {
    data: PathBuf,
    directory: TempDir,
    cases: String,
    made: usize,
}

impl Bench {
    /// Returns `None` without the test rasters.
    fn new() -> Option<Bench> {
        let data = shared_data()?.join("raster");
        Some(Bench { data, directory: tempfile::tempdir().unwrap(), cases: String::new(), made: 0 })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    /// Returns the tree of a raster, and the contents of its own file.
    fn build(&mut self, name: &str, options: &ImportOptions) -> Tree {
        let path = self.data.join(name);
        self.made += 1;
        let file = self.path(&format!("{}.goblin", self.made));
        let import = spinney::import::raster::plan(std::slice::from_ref(&path), options).unwrap();
        import.build(Output::create(&file).unwrap(), &()).unwrap();
        let mut raster = raster::open(&path, &RasterOptions::default()).unwrap();
        let info = raster.info().clone();
        assert_eq!(info.channels, 1, "{name}");
        let mut pixels = Pixels::default();
        raster.read(Region::new(0, 0, info.width, info.height), &mut pixels).unwrap();
        let is_void = |sample: f64| {
            info.nodata.is_some_and(|nodata| sample == nodata.to_f64() || sample.is_nan() && nodata.is_nan())
        };
        let samples = samples(info.sample, &pixels.bytes).into_iter();
        let cells = samples.map(|sample| (!is_void(sample)).then(|| value(sample))).collect();
        let tree = Tree { file, grid: grid([info.width, info.height, 1], cells), sample: info.sample };
        let (some, void) = (tree.grid.cells.iter().flatten(), value(tree.void()));
        assert!(some.clone().count() > 1000 && some.clone().all(|sample| *sample != void), "{name}");
        self.check(name, &tree.file.clone(), &tree, &tree.grid, "", &[]);
        tree
    }

    /// Compares a file's cells, exported as an array, with the expected ones, and adds a NumPy
    /// check if the operands allow it.
    fn check(
        &mut self,
        name: &str,
        file: &Path,
        like: &Tree,
        expected: &Grid,
        expression: &str,
        of: &[&Tree],
    ) {
        let array = export(file, like.void());
        let found = read_npy(&array, like.void());
        assert_eq!(found.size, expected.size, "{name}");
        for (index, (found, expected)) in found.cells.iter().zip(&expected.cells).enumerate() {
            let close = match (found, expected) {
                (Some(found), Some(expected)) => {
                    (number(*found) - number(*expected)).abs() <= like.tolerance()
                }
                (found, expected) => found.is_none() && expected.is_none(),
            };
            let show = |value: &Option<Value>| value.map(number);
            assert!(close, "{name}: cell number {index}: {:?}, expected {:?}", show(found), show(expected));
        }
        if of.is_empty() {
            return;
        }
        let files = of.iter().map(|tree| tree.file.with_extension("npy").display().to_string());
        let files = files.collect::<Vec<_>>().join("\t");
        let (tolerance, void, array) = (like.tolerance(), like.void(), array.display());
        writeln!(self.cases, "{name}\t{tolerance}\t{void}\t{array}\t{expression}\t{files}").unwrap();
    }

    fn transform(&mut self, tree: &Tree, steps: &str, moves: bool) -> PathBuf {
        self.made += 1;
        let out = self.path(&format!("{}.goblin", self.made));
        let steps = steps.split_whitespace().map(|step| step.parse().unwrap()).collect();
        let chain = FileView { steps, moves, ..FileView::of(&tree.file) };
        spinney::transform(&chain, Output::create(&out).unwrap(), WriteOptions::new(MEMORY), &()).unwrap();
        out
    }

    fn combine(&mut self, operation: CombineOperation, a: &Tree, b: &Tree) -> spinney::Result<PathBuf> {
        self.made += 1;
        let out = self.path(&format!("{}.goblin", self.made));
        let files = [a.file.clone(), b.file.clone()];
        // NumPy compares numbers; in the two land cover files one colour has two of them.
        let reconcile = ReconcileOptions { classes: ClassMatching::Number, ..ReconcileOptions::default() };
        let options = CombineOptions { reconcile, ..CombineOptions::default() };
        spinney::combine(
            operation,
            options,
            &files,
            Output::create(&out).unwrap(),
            WriteOptions::new(MEMORY),
            &(),
        )?;
        Ok(out)
    }

    /// Repeats all checks in NumPy.
    fn check_with_numpy(&self) {
        let has_numpy = Command::new("python3").args(["-c", "import numpy"]).output();
        if !has_numpy.is_ok_and(|output| output.status.success()) {
            eprintln!("NumPy is not installed: compared with arrays in Rust alone");
            return;
        }
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/import/real_rasters/referee.py");
        let mut command = Command::new("python3");
        command.arg(script).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        child.stdin.take().unwrap().write_all(self.cases.as_bytes()).unwrap();
        let output = child.wait_with_output().unwrap();
        let say = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        assert!(output.status.success(), "{}{}", say(&output.stdout), say(&output.stderr));
    }
}

fn samples(sample: SampleType, bytes: &[u8]) -> Vec<f64> {
    macro_rules! of {
        ($type:ty) => {
            bytes
                .chunks_exact(size_of::<$type>())
                .map(|bytes| <$type>::from_le_bytes(bytes.try_into().unwrap()) as f64)
                .collect()
        };
    }
    match sample {
        SampleType::U8 => of!(u8),
        SampleType::U16 => of!(u16),
        SampleType::I8 => of!(i8),
        SampleType::U64 => of!(u64),
        SampleType::I64 => of!(i64),
        SampleType::I16 => of!(i16),
        SampleType::U32 => of!(u32),
        SampleType::I32 => of!(i32),
        SampleType::F32 => of!(f32),
        SampleType::F64 => of!(f64),
    }
}

/// Exports a tree as an array file next to it.
fn export(file: &Path, void: f64) -> PathBuf {
    let out = file.with_extension("npy");
    let tree = dataset::open(file, &Default::default()).unwrap();
    let bounds = tree.header().extent_bounds();
    let detail = Detail::Level(tree.depth());
    let request = with(WindowRequest::new(bounds, detail), |it| {
        it.across = 2;
        let number = void.into();
        it.nodata = tree.header().form.value.sample.can_hold(number).then_some(number);
        it.memory = MEMORY;
    });
    export_window(&tree, &request, Output::create(&out).unwrap(), Format::Npy, &()).unwrap();
    out
}

fn read_npy(path: &Path, void: f64) -> Grid {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(bytes[..8], *b"\x93NUMPY\x01\x00");
    let start = 10 + u16::from_le_bytes([bytes[8], bytes[9]]) as usize;
    let header = std::str::from_utf8(&bytes[10..start]).unwrap();
    let after = |key: &str| header.split_once(key).unwrap().1;
    let sample = match after("'descr': '").split('\'').next().unwrap() {
        "|u1" => SampleType::U8,
        "<u2" => SampleType::U16,
        "<i2" => SampleType::I16,
        "<f4" => SampleType::F32,
        "|i1" => SampleType::I8,
        "<u8" => SampleType::U64,
        other => panic!("no raster here has samples of {other}"),
    };
    let shape = after("'shape': (").split(')').next().unwrap();
    let shape: Vec<u64> = shape.split(',').map(|number| number.trim().parse().unwrap()).collect();
    let cells = samples(sample, &bytes[start..]).into_iter();
    let cells = cells.map(|sample| (sample != void).then(|| value(sample))).collect();
    grid([shape[1], shape[0], 1], cells)
}

/// Returns cells taken from the source by column and row.
fn from(grid: &Grid, [width, height]: [u64; 2], cell: impl Fn(i64, i64) -> [i64; 2]) -> Grid {
    made(grid.form, [width, height, 1], |[x, y, _]| {
        let [x, y] = cell(x as i64, y as i64);
        grid.at([x, y, 0])
    })
}

/// Returns one cell for each block of `side` x `side`.
fn blocks(grid: &Grid, side: u64, of: impl Fn(&[f64]) -> f64) -> Grid {
    made(grid.form, [grid.size[0].div_ceil(side), grid.size[1].div_ceil(side), 1], |[x, y, _]| {
        let cells = (0..side * side).filter_map(|i| grid.get([x * side + i % side, y * side + i / side, 0]));
        let values: Vec<f64> = cells.map(number).collect();
        (!values.is_empty()).then(|| value(of(&values)))
    })
}

/// Returns the most frequent value of some cells. Ties are decided by the first of `deciding` that
/// is tied, else by a hash.
fn majority(values: &[f64], deciding: &[f64]) -> f64 {
    let mut counts: BTreeMap<i64, u64> = BTreeMap::new();
    values.iter().for_each(|value| *counts.entry(*value as i64).or_default() += 1);
    let most = *counts.values().max().unwrap();
    let tied: Vec<i64> =
        counts.into_iter().filter(|(_, count)| *count == most).map(|(value, _)| value).collect();
    if let Some(first) = deciding.iter().find(|value| tied.contains(&(**value as i64))) {
        return *first;
    }
    let hash = deciding.iter().fold(most, |hash, value| {
        let hash = (hash ^ *value as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        hash ^ hash >> 32
    });
    tied[(hash % tied.len() as u64) as usize] as f64
}

/// Returns the most frequent value of each block of `side` x `side`. Ties are decided by a node's
/// children, or by the first cell if blocks are not nodes.
fn majorities(grid: &Grid, side: u64) -> Grid {
    if side != 4 {
        return blocks(grid, side, |values| majority(values, values));
    }
    let children = majorities(grid, 2);
    made(grid.form, [grid.size[0].div_ceil(4), grid.size[1].div_ceil(4), 1], |[x, y, _]| {
        let of = |grid: &Grid, side: u64| {
            let cells =
                (0..side * side).filter_map(|i| grid.get([x * side + i % side, y * side + i / side, 0]));
            cells.map(number).collect::<Vec<f64>>()
        };
        let values = of(grid, 4);
        (!values.is_empty()).then(|| value(majority(&values, &of(&children, 2))))
    })
}

/// Checks windows, symmetries and scalings of one raster.
fn one_raster(name: &str, kind: DataKind) {
    let Some(mut bench) = Bench::new() else { return };
    let tree = bench.build(name, &with(ImportOptions::new(), |it| it.kind = Some(kind)));
    let [w, h, _] = tree.grid.size.map(|cells| cells as i64);
    let same = [w as u64, h as u64];
    let across = [h as u64, w as u64];
    let (a, b) = (w / 3, h / 5);
    let mut check = |steps: &str, expression: &str, expected: Grid| {
        let out = bench.transform(&tree, steps, false);
        bench.check(&format!("{name}, {steps}"), &out, &tree, &expected, expression, &[&tree]);
    };
    let grid = &tree.grid;
    check(
        &format!("window={a},{b},{},{}", w / 2, h / 2),
        &format!("a[{b}:{b} + {}, {a}:{a} + {}]", h / 2, w / 2),
        from(grid, [w as u64 / 2, h as u64 / 2], |x, y| [x + a, y + b]),
    );
    let part = [w as u64 / 2 + 20, h as u64 + 11];
    check(
        &format!("window=-7,-3,{},{}", part[0], part[1]),
        &format!("box(a, -7, -3, {}, {})", part[0], part[1]),
        from(grid, part, |x, y| [x - 7, y - 3]),
    );
    // Rows go down: NumPy rotates in the opposite direction.
    check("rotate=90", "np.rot90(a, -1)", from(grid, across, |x, y| [y, h - 1 - x]));
    check("rotate=-90", "np.rot90(a)", from(grid, across, |x, y| [w - 1 - y, x]));
    check("rotate=180", "np.rot90(a, 2)", from(grid, same, |x, y| [w - 1 - x, h - 1 - y]));
    check("mirror=x", "a[:, ::-1]", from(grid, same, |x, y| [w - 1 - x, y]));
    check("mirror=y", "a[::-1]", from(grid, same, |x, y| [x, h - 1 - y]));
    check("transpose", "a.T", from(grid, across, |x, y| [y, x]));
    check(
        &format!("transpose window={b},{a},99,80 mirror=x rotate=90"),
        &format!("np.rot90(a.T[{a}:{a} + 80, {b}:{b} + 99][:, ::-1], -1)"),
        from(grid, [80, 99], |x, y| [79 - x + a, 98 - y + b]),
    );
    check(
        &format!("window={a},{b},90,70 scale=3,2"),
        &format!("enlarge(a[{b}:{b} + 70, {a}:{a} + 90], 3, 2)"),
        from(grid, [270, 140], |x, y| [x / 3 + a, y / 2 + b]),
    );
    for (factor, side) in [("0.5", 2), ("0.25", 4), ("0.2", 5)] {
        let is_float = tree.sample.is_float();
        let mean = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            if is_float { mean } else { (mean + 0.5).floor() }
        };
        let (rule, expected) = match kind {
            DataKind::Categorical => ("majority", majorities(grid, side)),
            DataKind::Continuous => ("mean", blocks(grid, side, mean)),
        };
        check(&format!("scale={factor}"), &format!("{rule}(a, {side})"), expected);
    }
    bench.check_with_numpy();
}

#[test]
fn land_cover() {
    one_raster("nlcd_zion/nlcd.tif", DataKind::Categorical);
    one_raster("epitomes/lc.tif", DataKind::Categorical);
}

#[test]
fn elevations_in_whole_metres() {
    one_raster("spdatalarge/srtm.tif", DataKind::Continuous);
}

#[test]
fn floating_elevations() {
    one_raster("spdatalarge/nz_elev.tif", DataKind::Continuous);
    one_raster("georust_gdal/dem-hills.tiff", DataKind::Continuous);
}

/// Checks all operations on two rasters over the same cells.
fn two_rasters(bench: &mut Bench, name: &str, a: &Tree, b: &Tree, limits: [f64; 2]) {
    type Cell = Option<Value>;
    type Join<'a> = Box<dyn Fn(Cell, Cell) -> Cell + 'a>;
    let set = |number| CombineOperation::set(set_operation(number));
    let on_numbers = |join: fn(f64, f64) -> f64| -> Join<'_> {
        Box::new(move |a, b| Some(value(join(number(a?), number(b?)).clamp(limits[0], limits[1]))))
    };
    let mask = "np.ma.getmaskarray";
    let size = a.grid.size;
    let size = std::array::from_fn(|axis| size[axis].max(b.grid.size[axis]));
    let [first, second] = ["a", "b"].map(|name| format!("box({name}, 0, 0, {}, {})", size[0], size[1]));
    let cases: [(CombineOperation, String, Join<'_>); 10] = [
        (set(7), format!("over({first}, {second})"), Box::new(|a, b| a.or(b))),
        (
            CombineOperation::Set { operation: SetOperation::Union, prefer: Prefer::Second },
            format!("over({second}, {first})"),
            Box::new(|a, b| b.or(a)),
        ),
        (set(1), format!("only({first}, ~{mask}({second}))"), Box::new(|a, b| a.filter(|_| b.is_some()))),
        (set(2), format!("only({first}, {mask}({second}))"), Box::new(|a, b| a.filter(|_| b.is_none()))),
        (set(6), format!("xor({first}, {second})"), Box::new(Option::xor)),
        (CombineOperation::Over, format!("over({first}, {second})"), Box::new(|a, b| a.or(b))),
        (CombineOperation::Min, format!("np.ma.minimum({first}, {second})"), on_numbers(f64::min)),
        (CombineOperation::Max, format!("np.ma.maximum({first}, {second})"), on_numbers(f64::max)),
        (CombineOperation::Subtract, format!("subtract({first}, {second})"), on_numbers(|a, b| a - b)),
        (
            CombineOperation::Equal,
            format!("only({first}, ({first} == {second}).filled(False))"),
            Box::new(|a, b| a.filter(|_| a == b)),
        ),
    ];
    for (operation, expression, join) in cases {
        let out = bench.combine(operation, a, b).unwrap();
        let expected = made(a.grid.form, size, |cell| join(a.grid.get(cell), b.grid.get(cell)));
        bench.check(&format!("{name}, {operation:?}"), &out, a, &expected, &expression, &[a, b]);
    }
}

#[test]
fn land_cover_of_two_years() {
    let Some(mut bench) = Bench::new() else { return };
    let names = ["nlcd_zion/nlcd.tif", "nlcd_zion/nlcd2011.tif"];
    let epsg = |number| with(ImportOptions::new(), |it| it.crs = Some(Crs::epsg(number)));
    let [a, b] = names.map(|name| bench.build(name, &epsg(26912)));
    two_rasters(&mut bench, "land cover", &a, &b, [0.0, 255.0]);
    bench.check_with_numpy();
}

#[test]
fn elevations_of_two_regions() {
    let Some(mut bench) = Bench::new() else { return };
    let names = ["srtm3/N46E008.tif", "srtm3/N49W123.tif"];
    let options = with(ImportOptions::new(), |it| it.transform = Some([1.0, 0.0, 0.0, 0.0, -1.0, 0.0]));
    let [a, b] = names.map(|name| bench.build(name, &options));
    two_rasters(&mut bench, "whole metres", &a, &b, [-32768.0, 32767.0]);
    bench.check_with_numpy();
}

#[test]
fn elevations_and_a_shifted_copy() {
    for (name, limits) in [
        ("spdatalarge/dem.tif", [f64::NEG_INFINITY, f64::INFINITY]),
        ("spdatalarge/srtm.tif", [0.0, 65535.0]),
    ] {
        let Some(mut bench) = Bench::new() else { return };
        let a = bench.build(name, &ImportOptions::default());
        // Not aligned to nodes, with margins on the far sides.
        let file = bench.transform(&a, "translate=13,6", true);
        let size = [a.grid.size[0] + 13, a.grid.size[1] + 6];
        let b = Tree { file, grid: from(&a.grid, size, |x, y| [x - 13, y - 6]), sample: a.sample };
        let expression = format!("box(a, -13, -6, {}, {})", size[0], size[1]);
        bench.check(name, &b.file.clone(), &b, &b.grid, &expression, &[&a]);
        two_rasters(&mut bench, name, &a, &b, limits);
        bench.check_with_numpy();
    }
}

#[test]
fn rasters_of_different_types() {
    let Some(mut bench) = Bench::new() else { return };
    let names = ["epitomes/lc.tif", "epitomes/nlcd.tif"];
    let [a, b] = names.map(|name| bench.build(name, &ImportOptions::default()));
    assert_eq!(a.grid.size, b.grid.size);
    let out = bench.combine(CombineOperation::Over, &a, &b).unwrap();
    let tree = spinney::open(&out).unwrap();
    assert_eq!(tree.header().form.value.sample, SampleType::I16);
}
