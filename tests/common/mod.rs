//! Helpers shared by the integration tests.
#![allow(dead_code, unreachable_pub)] // each test file uses some of them

pub mod command;
pub mod octree;
pub mod solid;

use std::path::{Path, PathBuf};

use spinney::Result;
use spinney::space::{Cell, Code, Dimension, Frame};
use spinney::store::Output;
use spinney::store::build::{BuildOptions, Slab, Slabs, build, build_slabs, depth_for};
use spinney::store::goblin::{Goblin, Layout, Metadata};
use spinney::tree::{Child, MemTree, Source};
use spinney::value::{Kind, Rule, Sample, SampleType, Value};
use zerocopy::IntoBytes;

/// The picture behind the literature's two ten-record tables, row 0 in the north.
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

/// Test data that may be absent: `../shared/data`, or where `SPINNEY_DATA` points.
pub fn shared_data() -> Option<PathBuf> {
    let folder = std::env::var_os("SPINNEY_DATA").map(PathBuf::from);
    let folder = folder.unwrap_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"));
    if !folder.is_dir() {
        eprintln!("skipped: {} is not there", folder.display());
        return None;
    }
    Some(folder)
}

/// Small numbers that look random but are the same every time (splitmix64).
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

/// Cells of a box, in an array: the simplest model of a tree.
#[derive(Clone)]
pub struct Cells<V> {
    pub size: [u64; 3],
    pub cells: Vec<Option<V>>,
}

impl<V: Value> Cells<V> {
    pub fn get(&self, [x, y, z]: [u64; 3]) -> Option<V> {
        let inside = x < self.size[0] && y < self.size[1] && z < self.size[2];
        if inside { self.cells[((z * self.size[1] + y) * self.size[0] + x) as usize] } else { None }
    }

    /// Patches of few values, some VOID, with noise in places: something of everything.
    pub fn random(seed: u64, size: [u64; 3], values: u64, void: bool) -> Cells<V> {
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
                    cells.push((!is_void).then(|| value(number / 5 % values)));
                }
            }
        }
        Cells { size, cells }
    }

    /// A cell that may lie outside.
    pub fn at(&self, cell: [i64; 3]) -> Option<V> {
        let inside = cell.iter().all(|cell| *cell >= 0);
        if inside { self.get(cell.map(|cell| cell as u64)) } else { None }
    }

    /// Every cell for itself, one in five VOID: nothing is like its neighbours, so that no two places can be confused.
    pub fn noise(seed: u64, size: [u64; 3], values: u64) -> Cells<V> {
        let mut random = Random(seed);
        let cells = (0..size.iter().product()).map(|_| {
            let number = random.next();
            (!number.is_multiple_of(5)).then(|| value(number / 5 % values))
        });
        Cells { size, cells: cells.collect() }
    }

    /// As slabs of rows of blocks.
    pub fn slabs(&self, block: u64, nodata: V) -> CellSlabs<'_, V> {
        CellSlabs { cells: self, block, next: [0; 3], nodata }
    }
}

/// Some value for a number; different numbers below 2^8 give different values.
pub fn value<V: Value>(number: u64) -> V {
    V::from_channels(|channel| {
        let number = number as f64 + 10.0 * channel as f64;
        let number = match V::Sample::TYPE {
            SampleType::U8 => number % 251.0,
            SampleType::F32 | SampleType::F64 => number * 0.37 - 11.5,
            SampleType::I16 | SampleType::I32 => number * 3.0 - 100.0,
            _ => number,
        };
        V::Sample::from_f64_lossy(number)
    })
}

pub struct CellSlabs<'a, V> {
    cells: &'a Cells<V>,
    block: u64,
    next: [u64; 3],
    nodata: V,
}

impl<V: Value> Slabs for CellSlabs<'_, V> {
    fn extent(&self) -> [u64; 3] {
        self.cells.size
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        let size = self.cells.size;
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
                    slab.bytes.extend_from_slice(value.to_wire().as_bytes());
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

pub fn options(rule: Rule, kind: Kind, depth: u8) -> BuildOptions {
    BuildOptions { rule, kind, depth, memory: 64 << 20, metadata: Metadata::default(), share: false }
}

/// Makes a file of cells, by way of slabs.
pub fn write_goblin<D: Layout, V: Value>(
    path: &Path,
    cells: &Cells<V>,
    (rule, kind): (Rule, Kind),
    frame: Frame,
) {
    let nodata = value(250);
    let mut options = options(rule, kind, depth_for(cells.size));
    options.metadata.frame = frame;
    let mut slabs = cells.slabs(1 << D::REACH, nodata);
    let output = Output::create(path).unwrap();
    build_slabs::<D, V>(&mut slabs, Some(nodata), &options, output, &()).unwrap();
}

/// The bytes of the file that slabs make.
pub fn goblin_bytes<D: Layout, V: Value>(cells: &Cells<V>, rule: Rule, kind: Kind) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.goblin");
    write_goblin::<D, V>(&path, cells, (rule, kind), Frame::identity());
    std::fs::read(&path).unwrap()
}

/// The bytes of the file that a source makes.
pub fn goblin_from_source<S>(source: &S, extent: [u64; 3], rule: Rule, kind: Kind) -> Vec<u8>
where
    S: Source + Sync,
    S::Dim: Layout,
{
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.goblin");
    let output = Output::create(&path).unwrap();
    build(source, extent, &options(rule, kind, source.depth()), output, &()).unwrap();
    std::fs::read(&path).unwrap()
}

pub fn goblin<D: Layout, V: Value>(cells: &Cells<V>, rule: Rule, kind: Kind) -> Goblin<D, V> {
    Goblin::from_bytes(goblin_bytes::<D, V>(cells, rule, kind)).unwrap()
}

/// The node's cells, the slow way.
pub fn cells_below<D: Dimension>(code: Code<D>, depth: u8) -> impl Iterator<Item = Cell> {
    let side = 1u32 << (depth - code.level());
    let [x, y, z] = code.cell();
    let deep = if D::AXES > 2 { side } else { 1 };
    let z0 = if D::AXES > 2 { z * side } else { 0 };
    (0..deep).flat_map(move |k| {
        (0..side).flat_map(move |j| (0..side).map(move |i| [x * side + i, y * side + j, z0 + k]))
    })
}

/// All cells of a source, by walking it.
pub fn cells_of<S: Source>(source: &S, extent: [u64; 3]) -> Cells<S::Value> {
    let tree = MemTree::<S::Dim, S::Value>::from_source(source, Rule::Nearest).unwrap();
    let at = |cell: [u64; 3]| {
        let code = Code::<S::Dim>::from_cell(source.depth(), cell.map(|cell| cell as u32)).unwrap();
        tree.value_at(code)
    };
    made(extent, at)
}

/// The cells that a function gives.
pub fn made<V: Value>(size: [u64; 3], cell: impl Fn([u64; 3]) -> Option<V>) -> Cells<V> {
    let mut cells = Vec::new();
    for z in 0..size[2] {
        for y in 0..size[1] {
            cells.extend((0..size[0]).map(|x| cell([x, y, z])));
        }
    }
    Cells { size, cells }
}

pub fn same<V: Value>(a: Option<V>, b: Option<V>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => a.same(b),
        (None, None) => true,
        _ => false,
    }
}

pub fn assert_same<V: Value>(found: &Cells<V>, expected: &Cells<V>, what: &str) {
    assert_eq!(found.size, expected.size, "{what}");
    for (i, (found, expected)) in found.cells.iter().zip(&expected.cells).enumerate() {
        assert!(same(*found, *expected), "{what}: cell number {i}: {found:?}, expected {expected:?}");
    }
}

/// A small size.
pub fn quad_size(random: &mut Random) -> [u64; 3] {
    [1 + random.below(60), 1 + random.below(60), 1]
}

pub fn oct_size(random: &mut Random) -> [u64; 3] {
    std::array::from_fn(|_| 1 + random.below(14))
}

/// Compares every node of two sources.
pub fn same_trees<A, B>(a: &A, b: &B)
where
    A: Source,
    B: Source<Dim = A::Dim, Value = A::Value>,
{
    let mut pending = vec![(Code::<A::Dim>::ROOT, a.root().unwrap(), b.root().unwrap())];
    while let Some((code, a_place, b_place)) = pending.pop() {
        match (a_place, b_place) {
            (Child::Void, Child::Void) => {}
            (Child::Leaf(x), Child::Leaf(y)) => assert!(x.same(y), "{code}: {x:?} and {y:?}"),
            (Child::Inner { representative: x, node: m }, Child::Inner { representative: y, node: n }) => {
                assert!(x.same(y), "{code}: representatives {x:?} and {y:?}");
                let (m, n) = (a.children(&m).unwrap(), b.children(&n).unwrap());
                let pairs = m.as_ref().iter().zip(n.as_ref()).enumerate();
                pending.extend(pairs.map(|(i, (m, n))| (code.child(i), m.clone(), n.clone())));
            }
            other => panic!("{code}: {other:?}"),
        }
    }
}
