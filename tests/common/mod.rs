//! Helpers shared by the integration tests.
#![allow(dead_code, unreachable_pub)] // each test program uses some of them

pub mod brep_file;
pub mod command;
pub mod directory;
#[cfg(feature = "mesh")]
pub mod exact;
pub mod gltf_file;
pub mod line_features;
pub mod mesh_file;
pub mod octree;
pub mod reference;
#[cfg(feature = "mesh")]
pub mod sets;
pub mod solid;
pub mod tiff_file;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use spinney::raw::dataset;
use spinney::raw::ops::{self, Combined, View, ViewSource};
use spinney::raw::space::Cell;
use spinney::raw::store::goblin::Goblin;
use spinney::raw::store::{build_tree, depth_for};
use spinney::raw::tree::no_children;
use spinney::tree::{Child, MemTree, Slab, Slabs, Source, build_slabs};
use spinney::{
    BuildOptions, Code, CombineOperation, DataKind, Dataset, Dimension, Frame, Metadata, OpenOptions, Output,
    Result, Rule, SampleType, SetOperation, TreeType, Value, ValueType,
};

/// The image of the ten-record tables in the literature, row 0 in the north.
pub const CLASSIC: [[u8; 8]; 8] = [
    [1, 1, 1, 3, 3, 1, 1, 1],
    [1, 1, 3, 3, 3, 3, 1, 1],
    [1, 1, 3, 3, 3, 2, 1, 1],
    [1, 1, 1, 2, 2, 2, 2, 2],
    [1, 1, 1, 1, 2, 2, 2, 2],
    [1, 1, 1, 1, 2, 2, 2, 2],
    [1, 1, 1, 1, 1, 1, 1, 2],
    [1, 1, 1, 1, 1, 1, 1, 1],
];

/// Values of one byte.
pub const BYTE: ValueType = ValueType::new(SampleType::U8, 1);
/// Quadtrees of bytes.
pub const QUAD: TreeType = TreeType::new(Dimension::Quad, BYTE);
/// Octrees of bytes.
pub const OCT: TreeType = TreeType::new(Dimension::Oct, BYTE);

/// Returns the quadtree type with `channels` samples of a type.
pub const fn quad(sample: SampleType, channels: u8) -> TreeType {
    TreeType::new(Dimension::Quad, ValueType::new(sample, channels))
}

/// Returns the octree type with `channels` samples of a type.
pub const fn oct(sample: SampleType, channels: u8) -> TreeType {
    TreeType::new(Dimension::Oct, ValueType::new(sample, channels))
}

/// Returns all value types of trees.
pub fn value_types() -> Vec<ValueType> {
    let of = |sample| (1..=4).map(move |channels| ValueType::new(sample, channels));
    let types: Vec<_> =
        SampleType::ALL.into_iter().flat_map(of).filter(|value| value.is_supported()).collect();
    assert_eq!(types.len(), 19);
    types
}

/// A byte as a value.
pub fn byte(number: u8) -> Value {
    Value::from([number])
}

/// A value of one byte as a number.
pub fn as_byte(value: Value) -> u8 {
    value.to_bytes()[0]
}

/// Returns the optional test data directory: `$SPINNEY_DATA`, or `../shared/data`.
pub fn shared_data() -> Option<PathBuf> {
    let directory = std::env::var_os("SPINNEY_DATA").map(PathBuf::from);
    let directory =
        directory.unwrap_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"));
    if !directory.is_dir() {
        eprintln!("skipped: {} is not there", directory.display());
        return None;
    }
    Some(directory)
}

/// Returns the models of public bug reports, if the test data has them.
pub fn reported_models() -> Option<PathBuf> {
    let models = shared_data()?.join("hostile/reports/models");
    if !models.is_dir() {
        eprintln!("skipped: {} is not there", models.display());
        return None;
    }
    Some(models)
}

/// Deterministic pseudorandom numbers (splitmix64).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number below `bound`.
    pub fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound
    }
}

/// Cells of a box in an array: the simplest reference model of a tree.
#[derive(Clone)]
pub struct Cells {
    pub form: TreeType,
    pub size: [u64; 3],
    pub cells: Vec<Option<Value>>,
}

impl Cells {
    pub fn get(&self, [x, y, z]: [u64; 3]) -> Option<Value> {
        let inside = x < self.size[0] && y < self.size[1] && z < self.size[2];
        if inside { self.cells[((z * self.size[1] + y) * self.size[0] + x) as usize] } else { None }
    }

    /// Random patches of few values, some VOID, with some noise.
    pub fn random(form: TreeType, seed: u64, size: [u64; 3], values: u64, void: bool) -> Cells {
        let mut random = Random(seed);
        let side = 1 + random.below(24);
        let noise = random.below(3);
        let mut cells = Vec::new();
        for z in 0..size[2] {
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let patch = Random(seed ^ (x / side + 1000 * (y / side) + 1_000_000 * (z / side))).next();
                    let noisy = noise > 0 && patch % 7 < 2;
                    let number = if noisy { random.next() } else { patch >> 8 };
                    let is_void = void && number % 5 == 0;
                    cells.push((!is_void).then(|| value(form.value, number / 5 % values)));
                }
            }
        }
        Cells { form, size, cells }
    }

    /// Returns the value of a cell; `None` outside the box.
    pub fn at(&self, cell: [i64; 3]) -> Option<Value> {
        let inside = cell.iter().all(|cell| *cell >= 0);
        if inside { self.get(cell.map(|cell| cell as u64)) } else { None }
    }

    /// Random cells without spatial correlation, one in five VOID, so that a wrong position changes
    /// the result.
    pub fn noise(form: TreeType, seed: u64, size: [u64; 3], values: u64) -> Cells {
        let mut random = Random(seed);
        let cells = (0..size.iter().product()).map(|_| {
            let number = random.next();
            (!number.is_multiple_of(5)).then(|| value(form.value, number / 5 % values))
        });
        Cells { form, size, cells: cells.collect() }
    }

    /// The cells as slabs of rows of blocks.
    pub fn slabs(&self, nodata: Value) -> CellSlabs<'_> {
        let block = if self.form.dimension == Dimension::Quad { 256 } else { 64 };
        CellSlabs { cells: self, block, next: [0; 3], nodata }
    }

    /// Depth of the smallest tree that contains all cells.
    pub fn depth(&self) -> u8 {
        depth_for(self.size)
    }

    /// The smallest tree that contains all cells.
    pub fn tree(&self, rule: Rule) -> MemTree {
        self.tree_of_depth(self.depth(), rule)
    }

    pub fn tree_of_depth(&self, depth: u8, rule: Rule) -> MemTree {
        MemTree::from_cells(self.form, depth, rule, &|cell| self.get(cell.map(u64::from)))
    }

    /// Cells that are not VOID.
    pub fn count(&self) -> usize {
        self.cells.iter().flatten().count()
    }
}

/// Returns a value for a number. Different numbers below 2^8 give different values.
pub fn value(value_type: ValueType, number: u64) -> Value {
    match value_type.sample {
        // Consecutive integers that are equal as f64.
        SampleType::U64 => return Value::from([(1 << 63) + 3 + number]),
        SampleType::I64 => return Value::from([(1 << 53) - i64::MAX + number as i64]),
        _ => {}
    }
    value_type.nearest(|channel| {
        let number = number as f64 + 10.0 * channel as f64;
        match value_type.sample {
            SampleType::U8 => number % 251.0,
            SampleType::I8 => number % 251.0 - 125.0,
            SampleType::F32 | SampleType::F64 => number * 0.37 - 11.5,
            SampleType::I16 | SampleType::I32 => number * 3.0 - 100.0,
            _ => number,
        }
    })
}

pub struct CellSlabs<'a> {
    cells: &'a Cells,
    block: u64,
    next: [u64; 3],
    nodata: Value,
}

impl Slabs for CellSlabs<'_> {
    fn extent(&self) -> [u64; 3] {
        self.cells.size
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        let (size, width) = (self.cells.size, self.cells.form.width());
        if self.next[2] >= size[2] {
            return Ok(false);
        }
        slab.origin = self.next;
        slab.size = [size[0], self.block.min(size[1] - self.next[1]), self.block.min(size[2] - self.next[2])];
        slab.bytes.clear();
        for z in 0..slab.size[2] {
            for y in 0..slab.size[1] {
                for x in 0..slab.size[0] {
                    let cell = [slab.origin[0] + x, slab.origin[1] + y, slab.origin[2] + z];
                    let value = self.cells.get(cell).unwrap_or(self.nodata);
                    slab.bytes.extend_from_slice(&value.to_bytes()[..width]);
                }
            }
        }
        self.next[1] += self.block;
        if self.next[1] >= size[1] {
            self.next = [0, 0, self.next[2] + self.block];
        }
        Ok(true)
    }
}

pub fn options(rule: Rule, kind: DataKind, depth: u8) -> BuildOptions {
    BuildOptions::new(kind, depth).rule(rule).memory(64 << 20)
}

/// Returns options, or any other value, with a change.
pub fn with<T>(mut it: T, change: impl FnOnce(&mut T)) -> T {
    change(&mut it);
    it
}

/// Writes cells to a file as slabs. The file name selects the format.
pub fn write_cells(path: &Path, cells: &Cells, options: &BuildOptions) {
    let nodata = value(cells.form.value, 250);
    let output = Output::create(path).unwrap();
    build_slabs(cells.form, &mut cells.slabs(nodata), Some(nodata), options, output, &()).unwrap();
}

/// Writes cells with a frame to a Goblin file, as slabs.
pub fn write_goblin(path: &Path, cells: &Cells, (rule, kind): (Rule, DataKind), frame: Frame) {
    let metadata = Metadata { frame, ..Metadata::default() };
    write_cells(path, cells, &options(rule, kind, cells.depth()).metadata(metadata));
}

/// Returns the bytes of a file that a function writes.
pub fn bytes_of(write: impl FnOnce(&Path)) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.goblin");
    write(&path);
    std::fs::read(&path).unwrap()
}

/// Returns the bytes of a Goblin file written from slabs.
pub fn goblin_bytes(cells: &Cells, rule: Rule, kind: DataKind) -> Vec<u8> {
    bytes_of(|path| write_goblin(path, cells, (rule, kind), Frame::identity()))
}

/// Returns the bytes of a Goblin file written from a tree.
pub fn goblin_from_tree(tree: &MemTree, extent: [u64; 3], rule: Rule, kind: DataKind) -> Vec<u8> {
    bytes_of(|path| {
        let output = Output::create(path).unwrap();
        build_tree(tree, extent, &options(rule, kind, tree.depth()), output, &()).unwrap();
    })
}

/// Returns the bytes of a Goblin file written from combined trees.
pub fn goblin_from_combined(source: &Combined, rule: Rule, kind: DataKind) -> Vec<u8> {
    bytes_of(|path| {
        let output = Output::create(path).unwrap();
        ops::build(source, &options(rule, kind, source.depth()), output, &()).unwrap();
    })
}

/// Returns the bytes of a Goblin file written from a view.
pub fn goblin_from_view(view: &View, rule: Rule, kind: DataKind) -> Vec<u8> {
    goblin_from_combined(&combined(vec![view.clone()], CombineOperation::Over, view.extent()), rule, kind)
}

pub fn goblin(cells: &Cells, rule: Rule, kind: DataKind) -> Goblin {
    Goblin::from_bytes(goblin_bytes(cells, rule, kind)).unwrap()
}

/// Writes cells to a file and opens it as a dataset.
pub fn dataset(cells: &Cells, rule: Rule, kind: DataKind) -> Dataset {
    opened(|path| write_goblin(path, cells, (rule, kind), Frame::identity()))
}

/// Opens a file that a function writes as a dataset.
pub fn opened(write: impl FnOnce(&Path)) -> Dataset {
    // The mapping stays valid after the file is removed.
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.goblin");
    write(&path);
    dataset::open(&path, &OpenOptions::new()).unwrap()
}

/// A view of a tree in memory.
pub fn view_of(tree: &MemTree, extent: [u64; 3]) -> View {
    view_of_file(tree.clone(), extent)
}

/// A view of cells.
pub fn view_of_cells(cells: &Cells) -> View {
    view_of(&cells.tree(Rule::Mean), cells.size)
}

/// A view of cells with a frame.
pub fn view_in(cells: &Cells, frame: &Frame) -> View {
    let write = |path: &Path| write_goblin(path, cells, (Rule::Mean, DataKind::Continuous), frame.clone());
    view_of_file(Goblin::from_bytes(bytes_of(write)).unwrap(), cells.size)
}

/// Returns all cells of a view.
pub fn seen(view: &View) -> Cells {
    cells_of(view, view.extent())
}

/// A view of a file.
pub fn view_of_file(source: impl Into<ViewSource>, extent: [u64; 3]) -> View {
    View::new(Arc::new(source.into()), extent).unwrap()
}

/// The set operation with an index.
pub fn set_operation(index: u8) -> SetOperation {
    SetOperation::from_index(index).unwrap()
}

pub fn combined(views: Vec<View>, operation: CombineOperation, extent: [u64; 3]) -> Combined {
    Combined::new(views, operation, extent).unwrap()
}

/// Enumerates the cells of a node, by brute force.
pub fn cells_below(code: Code, depth: u8) -> impl Iterator<Item = Cell> {
    let side = 1u32 << (depth - code.level());
    let [x, y, z] = code.cell();
    let is_octree = code.dimension() == Dimension::Oct;
    let (deep, z0) = if is_octree { (side, z * side) } else { (1, 0) };
    (0..deep).flat_map(move |k| {
        (0..side).flat_map(move |j| (0..side).map(move |i| [x * side + i, y * side + j, z0 + k]))
    })
}

/// Returns the children of an INNER node.
pub fn children<S: Source>(source: &S, node: &S::Node) -> Vec<Child<S::Node>> {
    try_children(source, node).unwrap()
}

pub fn try_children<S: Source>(source: &S, node: &S::Node) -> Result<Vec<Child<S::Node>>> {
    let mut children = no_children();
    source.children(node, &mut children)?;
    Ok(children.into_iter().take(source.form().children()).collect())
}

/// Returns all cells of a source by traversing it.
pub fn cells_of<S: Source>(source: &S, extent: [u64; 3]) -> Cells {
    let tree = MemTree::from_source(source, Rule::Nearest).unwrap();
    let (form, depth) = (tree.form(), tree.depth());
    made(form, extent, |cell| {
        let code = Code::from_cell(form.dimension, depth, cell.map(|cell| cell as u32)).unwrap();
        tree.value_at(code)
    })
}

/// Returns the cells that a function computes.
pub fn made(form: TreeType, size: [u64; 3], cell: impl Fn([u64; 3]) -> Option<Value>) -> Cells {
    let mut cells = Vec::new();
    for z in 0..size[2] {
        for y in 0..size[1] {
            cells.extend((0..size[0]).map(|x| cell([x, y, z])));
        }
    }
    Cells { form, size, cells }
}

pub fn assert_same(found: &Cells, expected: &Cells, what: &str) {
    assert_eq!((found.form, found.size), (expected.form, expected.size), "{what}");
    let value_type = found.form.value;
    for (i, (found, expected)) in found.cells.iter().zip(&expected.cells).enumerate() {
        let show = |value: &Option<Value>| value.map(|value| value_type.numbers(value).to_vec());
        assert!(
            found == expected,
            "{what}: cell number {i}: {:?}, expected {:?}",
            show(found),
            show(expected)
        );
    }
}

/// Returns a small random size.
pub fn quad_size(random: &mut Random) -> [u64; 3] {
    [1 + random.below(60), 1 + random.below(60), 1]
}

pub fn oct_size(random: &mut Random) -> [u64; 3] {
    std::array::from_fn(|_| 1 + random.below(14))
}

/// Compares every node of a source with those of a tree.
pub fn same_trees<S: Source>(source: &S, tree: &MemTree) {
    assert_eq!((source.form(), source.depth()), (tree.form(), tree.depth()));
    let mut pending = vec![(Code::root(tree.form().dimension), source.root().unwrap(), tree.root().unwrap())];
    while let Some((code, found, expected)) = pending.pop() {
        assert_eq!(found.state(), expected.state(), "{code}");
        assert_eq!(found.value(), expected.value(), "{code}");
        if let (Child::Inner { node: m, .. }, Child::Inner { node: n, .. }) = (found, expected) {
            let pairs = children(source, &m).into_iter().zip(children(tree, &n)).enumerate();
            pending.extend(pairs.map(|(i, (m, n))| (code.child(i), m, n)));
        }
    }
}
