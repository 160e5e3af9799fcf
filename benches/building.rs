//! Rates of building: rasters in memory become Goblin files, on one thread, without decoding.
//!
//! `cargo bench --bench building -- [--keep DIRECTORY] [CASE...]`
//!
//! Prints millions of cells per second of processor time, the best of some runs. Files are written
//! to `/dev/shm` if it exists, so that disks do not count, and removed unless a directory is given
//! to keep them.

#[allow(dead_code)] // no randomness is needed here
mod measuring;

use std::path::{Path, PathBuf};

use measuring::{Outcome, seconds};
use spinney::raw::store::depth_for;
use spinney::tree::{Slab, Slabs, build_slabs};
use spinney::{BuildOptions, DataKind, Dimension, Output, Result, SampleType, TreeType, ValueType};

const SIDE: u64 = 4096;
const RUNS: usize = 5;

/// Appends the bytes of a cell at a column and a row.
type Cell = fn(u64, u64, &mut Vec<u8>);

/// Name, sample type, data kind, cells.
const CASES: [(&str, SampleType, DataKind, Cell); 6] = [
    // A smooth field with noise in its low bits.
    ("photograph", SampleType::U8, DataKind::Continuous, |x, y, bytes| {
        bytes.push((fractal(x, y, 7) * 200.0) as u8 + (mix(x, y) % 5) as u8);
    }),
    ("relief", SampleType::I16, DataKind::Continuous, |x, y, bytes| {
        bytes.extend(((fractal(x, y, 9) * 4000.0) as i16 - 500).to_le_bytes());
    }),
    ("noise12", SampleType::U8, DataKind::Categorical, |x, y, bytes| bytes.push((mix(x, y) % 12) as u8)),
    // One class, and some cells of others.
    ("speckle", SampleType::U8, DataKind::Categorical, |x, y, bytes| {
        let chance = mix(x, y);
        bytes.push(if chance.is_multiple_of(20) { (chance >> 32) as u8 % 11 + 1 } else { 0 });
    }),
    ("floats", SampleType::F32, DataKind::Continuous, |x, y, bytes| {
        bytes.extend((fractal(x, y, 9) as f32 * 4000.0 - 500.0).to_le_bytes());
    }),
    // Five classes with borders between them.
    ("shoreline", SampleType::U8, DataKind::Categorical, |x, y, bytes| {
        bytes.push((fractal(x, y, 10) * 5.0) as u8);
    }),
];

fn mix(x: u64, y: u64) -> u64 {
    let mut z = x.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z ^ (z >> 31)
}

/// Returns fractal noise between 0 and 1: `octaves` octaves, starting at 1024 cells; amplitude
/// halves with wavelength.
fn fractal(x: u64, y: u64, octaves: u32) -> f64 {
    let at = |x: u64, y: u64, octave: u64| (mix(x ^ octave << 40, y) >> 40) as f64 / (1u64 << 24) as f64;
    let mut sum = 0.0;
    for octave in 0..octaves {
        let period = 1024 >> octave;
        let (column, row) = (x / period, y / period);
        let smooth = |part: u64| {
            let part = part as f64 / period as f64;
            part * part * (3.0 - 2.0 * part)
        };
        let (right, down) = (smooth(x % period), smooth(y % period));
        let corner = |dx: u64, dy: u64| at(column + dx, row + dy, octave.into());
        let top = corner(0, 0) * (1.0 - right) + corner(1, 0) * right;
        let bottom = corner(0, 1) * (1.0 - right) + corner(1, 1) * right;
        sum += (top * (1.0 - down) + bottom * down) * 0.5f64.powi(octave as i32 + 1);
    }
    sum
}

/// Rows of a raster in memory.
struct Rows<'p> {
    samples: &'p [u8],
    width: u64,
    next: u64,
}

impl Slabs for Rows<'_> {
    fn extent(&self) -> [u64; 3] {
        [SIDE, SIDE, 1]
    }

    fn next(&mut self, slab: &mut Slab) -> Result<bool> {
        if self.next == SIDE {
            return Ok(false);
        }
        slab.origin = [0, self.next, 0];
        slab.size = [SIDE, 256, 1];
        let bytes = |row: u64| (row * SIDE * self.width) as usize;
        slab.bytes.clear();
        slab.bytes.extend_from_slice(&self.samples[bytes(self.next)..bytes(self.next + 256)]);
        self.next += 256;
        Ok(true)
    }
}

fn build(samples: &[u8], sample: SampleType, kind: DataKind, path: &Path) -> Outcome<()> {
    let form = TreeType::new(Dimension::Quad, ValueType::new(sample, 1));
    let mut rows = Rows { samples, width: form.width() as u64, next: 0 };
    let options = BuildOptions::new(kind, depth_for(rows.extent()));
    build_slabs(form, &mut rows, None, &options, Output::create(path)?, &())?;
    Ok(())
}

fn main() -> Outcome<()> {
    let (mut only, mut keep) = (Vec::new(), None);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--bench" => {}
            "--keep" => {
                keep =
                    Some(PathBuf::from(arguments.next().ok_or("--keep: got no value, expected a directory")?))
            }
            _ => only.push(argument),
        }
    }
    let memory = Path::new("/dev/shm");
    let directory = if memory.is_dir() { tempfile::tempdir_in(memory)? } else { tempfile::tempdir()? };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    println!("case        Mcells per CPU s       MB");
    for (name, sample, kind, cell) in CASES {
        if !only.is_empty() && !only.iter().any(|only| only == name) {
            continue;
        }
        let mut samples = Vec::new();
        (0..SIDE * SIDE).for_each(|i| cell(i % SIDE, i / SIDE, &mut samples));
        let path = keep.as_deref().unwrap_or(directory.path()).join(name).with_extension("goblin");
        let mut best = f64::INFINITY;
        for _ in 0..RUNS {
            let took = pool.install(|| {
                let took = seconds(|| build(&samples, sample, kind, &path));
                took.map_err(|error| error.to_string())
            })?;
            best = best.min(took);
        }
        let bytes = std::fs::metadata(&path)?.len();
        println!("{name:12}{:16.1}{:9.1}", (SIDE * SIDE) as f64 / best * 1e-6, bytes as f64 * 1e-6);
    }
    Ok(())
}
