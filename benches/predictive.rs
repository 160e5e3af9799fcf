//! Predictive quadtree construction (item 16 of docs/literature.md) compared with the builder, on
//! one thread, with cells in memory.
//!
//! `cargo bench --bench predictive`
//!
//! Prints the processor time of predictive construction alone, without values of inner nodes; of
//! construction and writing the file; and of the builder's file of the same cells; the best of some
//! runs each. Files go to `/dev/shm` if it exists.

#[allow(dead_code)] // neither random numbers nor medians are needed here
mod measuring;
#[path = "../tests/literature/predictive/tree.rs"]
mod tree;

use std::path::Path;

use measuring::{Outcome, seconds};
use spinney::raw::store::depth_for;
use spinney::tree::{Slab, Slabs, Source as _, build_slabs, build_source};
use spinney::{BuildOptions, Code, DataKind, Dimension, Output, SampleType, TreeType, Value, ValueType};
use tree::{PredictedSource, PredictiveTree};

const RUNS: usize = 5;
const SIDE: u64 = 8192;

/// Bit above a cell's bytes that marks VOID.
const VOID: u64 = 1 << 40;

/// Cells of a raster, row by row.
struct Raster<T> {
    form: TreeType,
    kind: DataKind,
    size: [u64; 3],
    cells: Vec<T>,
    outside: T,
    value: fn(T) -> Option<Value>,
}

impl<T: Copy + Eq + Sync> Raster<T> {
    fn options(&self) -> BuildOptions {
        BuildOptions::new(self.kind, depth_for(self.size))
    }

    fn predicted(&self) -> PredictedSource<T> {
        let tree = PredictiveTree::of(&self.cells, self.size[0] as usize, self.outside);
        PredictedSource { tree, form: self.form, value: self.value }
    }

    fn build_predicted(&self, path: &Path) -> Outcome<()> {
        build_source(&self.predicted(), self.size, &self.options(), Output::create(path)?, &())?;
        Ok(())
    }

    /// Builds from bytes in rows, as raster readers return them.
    fn build(&self, bytes: &[u8], valid: Option<&[bool]>, path: &Path) -> Outcome<()> {
        let mut rows = Rows { size: self.size, bytes, valid, next: 0 };
        build_slabs(self.form, &mut rows, None, &self.options(), Output::create(path)?, &())?;
        Ok(())
    }

    /// Measures a row of the table.
    fn measure(&self, name: &str, directory: &Path) -> Outcome<()> {
        let value = |cell: &T| (self.value)(*cell);
        let width = self.form.width();
        let bytes: Vec<u8> = self
            .cells
            .iter()
            .flat_map(|cell| value(cell).unwrap_or_default().to_bytes().into_iter().take(width))
            .collect();
        let valid: Vec<bool> = self.cells.iter().map(|cell| value(cell).is_some()).collect();
        let valid = Some(&valid[..]).filter(|valid| valid.contains(&false));
        let [ours, theirs] = ["predicted.goblin", "built.goblin"].map(|name| directory.join(name));
        let mut best = [f64::INFINITY; 3];
        let mut nodes = 0;
        for _ in 0..RUNS {
            let took = [
                seconds(|| {
                    nodes = self.predicted().tree.len();
                    Ok(())
                })?,
                seconds(|| self.build_predicted(&ours))?,
                seconds(|| self.build(&bytes, valid, &theirs))?,
            ];
            best.iter_mut().zip(took).for_each(|(best, took)| *best = best.min(took));
        }
        assert!(std::fs::read(&ours)? == std::fs::read(&theirs)?, "{name}");
        let [x, y, _] = self.size;
        let [tree, file, builder] = best.map(|seconds| seconds * 1e3);
        println!(
            "| {name} | {x} x {y}, {} | {nodes} | {tree:.2} | {file:.2} | {builder:.2} |",
            self.form.value
        );
        Ok(())
    }
}

/// Rows of a raster in memory.
struct Rows<'p> {
    size: [u64; 3],
    bytes: &'p [u8],
    valid: Option<&'p [bool]>,
    next: u64,
}

impl Slabs for Rows<'_> {
    fn extent(&self) -> [u64; 3] {
        self.size
    }

    fn next(&mut self, slab: &mut Slab) -> spinney::Result<bool> {
        let [columns, rows, _] = self.size;
        let count = (rows - self.next).min(256);
        slab.origin = [0, self.next, 0];
        slab.size = [columns, count, 1];
        let part = |length: usize| {
            let row = length / rows as usize;
            self.next as usize * row..(self.next + count) as usize * row
        };
        slab.bytes.clear();
        slab.bytes.extend_from_slice(&self.bytes[part(self.bytes.len())]);
        slab.valid = self.valid.map(|valid| valid[part(valid.len())].to_vec());
        self.next += count;
        Ok(count > 0)
    }
}

fn fixture(name: &str) -> Outcome<Raster<u64>> {
    let directory = tempfile::tempdir()?;
    let built = directory.path().join("built.goblin");
    spinney::build(Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name), &built)?;
    let file = spinney::open(&built)?;
    let (header, tree) = (file.header(), file.in_memory(1 << 20)?);
    let [columns, rows, _] = header.extent;
    let mut cells = Vec::new();
    for y in 0..rows as u32 {
        for x in 0..columns as u32 {
            let code = Code::from_cell(Dimension::Quad, tree.depth(), [x, y, 0]).expect("a cell of the tree");
            let bytes = tree.value_at(code).map(|value| value.to_bytes());
            let bytes = bytes.map(|bytes| bytes.first_chunk().copied().unwrap_or_default());
            cells.push(bytes.map_or(VOID, u64::from_le_bytes));
        }
    }
    let value = |cell| (cell != VOID).then(|| Value::from(u64::to_le_bytes(cell)));
    Ok(Raster { form: header.form, kind: header.kind, size: header.extent, cells, outside: VOID, value })
}

/// Returns land cover: patches of some classes with borders as rough as a shoreline, and `speckles`
/// cells of other classes per million.
fn classes(speckles: u64) -> Raster<u8> {
    let cell = |i: u64| {
        let (x, y) = (i % SIDE, i / SIDE);
        let chance = mix(x, y);
        let class = (fractal(x, y) * 8.0) as u8;
        if chance % 1_000_000 < speckles { (chance >> 40) as u8 % 8 } else { class }
    };
    let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
    Raster {
        form,
        kind: DataKind::Categorical,
        size: [SIDE, SIDE, 1],
        cells: (0..SIDE * SIDE).map(cell).collect(),
        outside: 0,
        value: |cell| Some(Value::from([cell])),
    }
}

fn mix(x: u64, y: u64) -> u64 {
    let mut z = x.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z ^ (z >> 31)
}

/// Returns fractal noise between 0 and 1, with wavelengths from 2048 to 16 cells; amplitude halves
/// with wavelength.
fn fractal(x: u64, y: u64) -> f64 {
    let mut sum = 0.0;
    for octave in 0..8 {
        let period = 2048 >> octave;
        let at = |dx, dy| {
            (mix((x / period + dx) ^ octave << 40, y / period + dy) >> 40) as f64 / f64::from(1 << 24)
        };
        let [right, down] = [x, y].map(|at| (at % period) as f64 / period as f64);
        let top = at(0, 0) * (1.0 - right) + at(1, 0) * right;
        let bottom = at(0, 1) * (1.0 - right) + at(1, 1) * right;
        sum += (top * (1.0 - down) + bottom * down) * 0.5f64.powi(octave as i32 + 1);
    }
    sum
}

fn main() -> Outcome<()> {
    let memory = Path::new("/dev/shm");
    let directory = if memory.is_dir() { tempfile::tempdir_in(memory)? } else { tempfile::tempdir()? };
    let path = directory.path();
    let print = || -> Outcome<()> {
        println!("| raster | cells | nodes | predicted tree, ms | and its file | file by the builder |");
        println!("| --- | --- | --- | --- | --- | --- |");
        for name in ["classic.png", "island_classes.tif", "island_elevation.tif", "island_rgb.png"] {
            fixture(name)?.measure(&format!("`{name}`"), path)?;
        }
        classes(0).measure("classes", path)?;
        classes(1000).measure("classes, a cell in 1000 another one", path)?;
        classes(50_000).measure("classes, a cell in 20 another one", path)
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    Ok(pool.install(|| print().map_err(|error| error.to_string()))?)
}
