//! Hot paths of Goblin files: building blocks, descending to cells, drawing tiles, searching the
//! segment index.
//!
//! `cargo bench --bench goblin`

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use spinney::raw::store::depth_for;
use spinney::raw::store::goblin::Goblin;
use spinney::tree::{Slab, Slabs, build_slabs};
use spinney::{
    Bounds, BuildOptions, Code, DataKind, Dimension, Output, Result, SampleType, TreeType, Value, ValueType,
};

const SIDE: u64 = 4096;

/// Quadtrees of bytes.
const FORM: TreeType = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));

/// Rasters of `SIDE` cells per axis.
#[derive(Clone, Copy)]
enum TestRaster {
    Uniform,
    /// Two classes and a fractal border between them.
    Coastline,
    /// Twelve random classes.
    Speckle,
    /// A smooth field with noise in the low bits.
    Photograph,
}

fn mix(x: u64, y: u64) -> u64 {
    let mut z = x.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z ^ (z >> 31)
}

fn sample(raster: TestRaster, x: u64, y: u64) -> u8 {
    match raster {
        TestRaster::Uniform => 7,
        TestRaster::Coastline => {
            let wave =
                |period: f64, size: f64| ((x as f64 / period).sin() + (y as f64 / period * 1.3).cos()) * size;
            (wave(700.0, 1.0) + wave(150.0, 0.4) + wave(31.0, 0.15) + wave(7.0, 0.06) > 0.4) as u8
        }
        TestRaster::Speckle => (mix(x, y) % 12) as u8,
        TestRaster::Photograph => ((x / 37 + y / 23) % 200 + mix(x, y) % 5) as u8,
    }
}

struct Rows {
    samples: Vec<u8>,
    next: u64,
}

impl Rows {
    fn new(raster: TestRaster) -> Rows {
        let samples = (0..SIDE * SIDE).map(|i| sample(raster, i % SIDE, i / SIDE)).collect();
        Rows { samples, next: 0 }
    }
}

impl Slabs for Rows {
    fn extent(&self) -> [u64; 3] {
        [SIDE, SIDE, 1]
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        if self.next == SIDE {
            return Ok(false);
        }
        slab.origin = [0, self.next, 0];
        slab.size = [SIDE, 256, 1];
        let start = (self.next * SIDE) as usize;
        slab.bytes.clear();
        slab.bytes.extend_from_slice(&self.samples[start..start + 256 * SIDE as usize]);
        self.next += 256;
        Ok(true)
    }
}

fn build(rows: &mut Rows, kind: DataKind) -> Vec<u8> {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let path = directory.path().join("bench.goblin");
    let options = BuildOptions::new(kind, depth_for(rows.extent()));
    let output = Output::create(&path).expect("a file");
    build_slabs(FORM, rows, None, &options, output, &()).expect("built");
    std::fs::read(&path).expect("read")
}

const RASTERS: [(&str, TestRaster, DataKind); 4] = [
    ("uniform", TestRaster::Uniform, DataKind::Categorical),
    ("coastline", TestRaster::Coastline, DataKind::Categorical),
    ("speckle", TestRaster::Speckle, DataKind::Categorical),
    ("photograph", TestRaster::Photograph, DataKind::Continuous),
];

/// Time per raster of 256 blocks, on one thread.
fn building(c: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let mut group = c.benchmark_group("build");
    group.sample_size(10).throughput(Throughput::Elements(SIDE * SIDE));
    for (name, raster, kind) in RASTERS {
        let rows = Rows::new(raster);
        group.bench_function(name, |b| {
            b.iter_batched_ref(
                || Rows { samples: rows.samples.clone(), next: 0 },
                |rows| pool.install(|| build(rows, kind)),
                BatchSize::PerIteration,
            );
        });
    }
}

fn reading(c: &mut Criterion) {
    for (name, raster, kind) in RASTERS.into_iter().skip(1) {
        let file = Goblin::from_bytes(build(&mut Rows::new(raster), kind)).expect("open");
        let depth = depth_for([SIDE, SIDE, 1]);
        let mut n = 0u64;
        let mut random = move || {
            n += 1;
            mix(n, 1)
        };
        let code = |random: u64| {
            let cell = [(random % SIDE) as u32, (random >> 32) as u32 % SIDE as u32, 0];
            Code::from_cell(FORM.dimension, depth, cell).expect("inside")
        };
        let mut group = c.benchmark_group(format!("read {name}"));
        group.throughput(Throughput::Elements(1));
        group.bench_function("cell", |b| {
            b.iter(|| black_box(file.value_at(code(random())).expect("good")));
        });
        group.bench_function("directory", |b| {
            b.iter(|| black_box(file.find_segment(code(random())).unwrap()));
        });
        let mut tile = vec![0; 1 << 16];
        let fill = Value::from([255u8]);
        group.throughput(Throughput::Elements(1 << 16));
        for level in [depth, depth - 1, depth - 2] {
            group.bench_function(format!("tile at level {level}"), |b| {
                b.iter(|| {
                    let tiles = 1u64 << (level - 8);
                    let r = random();
                    let (x, y) = (r % tiles, (r >> 32) % tiles);
                    let bounds = Bounds { min: [x << 8, y << 8, 0], max: [(x + 1) << 8, (y + 1) << 8, 1] };
                    file.window(level, &bounds, fill, &mut tile, None).expect("good");
                    black_box(tile[0])
                });
            });
        }
    }
}

criterion_group!(benches, building, reading);
criterion_main!(benches);
