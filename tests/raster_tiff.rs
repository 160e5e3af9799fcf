//! TIFF files of every kind against what GDAL reads from them.

use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use spinney::Result;
use spinney::import::raster::{self, OpenOptions, Order, Pixels, Raster, RasterInfo};
use spinney::space::Region;
use spinney::value::SampleType;

fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("SPINNEY_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let folder = folder.join("raster");
    if !folder.is_dir() {
        eprintln!("skipped: no test data in {}", folder.display());
        return None;
    }
    Some(folder)
}

/// One line of the table of what GDAL reads.
struct Expected<'a> {
    file: &'a str,
    size: [u64; 2],
    bands: usize,
    dtype: &'a str,
    nodata: Option<f64>,
    epsg: Option<u32>,
    transform: Option<[f64; 6]>,
    hash: &'a str,
}

impl Expected<'_> {
    fn parse(line: &str) -> Option<Expected<'_>> {
        let fields: Vec<_> = line.split('\t').collect();
        let &[file, width, height, bands, dtype, nodata, epsg, transform, _, hash, ..] = fields.as_slice() else {
            return None;
        };
        let transform: Vec<f64> = transform.split(',').filter_map(|number| number.parse().ok()).collect();
        Some(Expected {
            file,
            size: [width.parse().ok()?, height.parse().ok()?],
            bands: bands.parse().ok()?,
            dtype,
            nodata: nodata.parse().ok(),
            epsg: epsg.parse().ok(),
            transform: transform.try_into().ok(),
            hash,
        })
    }
}

/// All samples of a raster, read by regions of at most this size.
fn read_by(raster: &mut dyn Raster, [width, height]: [u64; 2]) -> Result<Vec<u8>> {
    let info = raster.info().clone();
    let pixel = info.sample.size() * info.channels;
    let mut all = vec![0; info.width as usize * info.height as usize * pixel];
    let mut pixels = Pixels::default();
    for y in (0..info.height).step_by(height as usize) {
        for x in (0..info.width).step_by(width as usize) {
            let region = Region::new(x, y, width.min(info.width - x), height.min(info.height - y));
            raster.read(region, &mut pixels)?;
            assert_eq!(pixels.bytes.len() as u64, region.area() * pixel as u64);
            for (i, row) in pixels.bytes.chunks_exact(region.width as usize * pixel).enumerate() {
                let at = ((y as usize + i) * info.width as usize + x as usize) * pixel;
                all[at..at + row.len()].copy_from_slice(row);
            }
        }
    }
    Ok(all)
}

/// The first 16 hexadecimal digits of the hash of all samples: band after band, in GDAL's type.
fn hash(info: &RasterInfo, bytes: &[u8], dtype: &str) -> String {
    let size = info.sample.size();
    let mut hasher = Sha256::new();
    for channel in 0..info.channels {
        let samples = bytes.chunks_exact(size).skip(channel).step_by(info.channels);
        let band: Vec<u8> = match (dtype, info.sample) {
            ("int8", SampleType::I16) => samples.map(|sample| sample[0]).collect(),
            ("uint64", SampleType::F64) => samples
                .flat_map(|sample| (f64::from_le_bytes(sample.try_into().unwrap()) as u64).to_le_bytes())
                .collect(),
            _ => samples.flatten().copied().collect(),
        };
        hasher.update(band);
    }
    hasher.finalize()[..8].iter().map(|byte| format!("{byte:02x}")).collect()
}

fn close(a: f64, b: f64) -> bool {
    a == b || a.is_nan() && b.is_nan() || (a - b).abs() <= 1e-11 * a.abs().max(b.abs())
}

/// What is different from the expected, if anything.
fn differences(expected: &Expected<'_>, path: &Path) -> Result<Vec<String>> {
    let mut raster = raster::open(path, &OpenOptions::default())?;
    let info = raster.info().clone();
    let mut wrong = Vec::new();
    let mut check = |what: &str, same: bool, found: String| {
        if !same {
            wrong.push(format!("{what}: {found}"));
        }
    };
    check("size", [info.width, info.height] == expected.size, format!("{}x{}", info.width, info.height));
    check("bands", info.channels == expected.bands, info.channels.to_string());
    let nodata = match (info.nodata, expected.nodata) {
        (Some(a), Some(b)) => close(a, b),
        (a, b) => a == b,
    };
    check("nodata", nodata, format!("{:?} for {:?}", info.nodata, expected.nodata));
    check("epsg", info.frame.epsg == expected.epsg, format!("{:?} for {:?}", info.frame.epsg, expected.epsg));
    let affine = info.frame.affine();
    let transform = expected.transform.unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    check("transform", affine.iter().zip(transform).all(|(a, b)| close(*a, b)), format!("{affine:?}"));
    let bands = read_by(&mut *raster, [info.width, 50])?;
    check("samples", hash(&info, &bands, expected.dtype) == expected.hash, "another hash".into());
    // Windows that no chunk fits, small enough to come back to most chunks.
    let step = |length: u64| if length > 300 { 277 } else { 13 };
    let odd = read_by(&mut *raster, [step(info.width), step(info.height)])?;
    check("odd regions", odd == bands, "other samples".into());
    Ok(wrong)
}

#[test]
fn files_read_as_gdal_reads_them() {
    let Some(folder) = data() else { return };
    let table = std::fs::read_to_string(folder.join("expected.tsv")).unwrap();
    let mut wrong = Vec::new();
    for line in table.lines().skip(1) {
        let file = line.split('\t').next().unwrap();
        if !(file.ends_with(".tif") || file.ends_with(".tiff")) {
            continue;
        }
        let path = folder.join(file);
        let Some(expected) = Expected::parse(line) else {
            // GDAL gives up on these, or the table's maker did: what matters is that we come to an end.
            let read = raster::open(&path, &OpenOptions::default()).and_then(|mut raster| {
                let info = raster.info().clone();
                let region = Region::new(0, 0, info.width.min(2000), info.height.min(2000));
                raster.read(region, &mut Pixels::default())
            });
            println!("{file}: {}", read.map_or_else(|error| error.to_string(), |()| "read".into()));
            continue;
        };
        match differences(&expected, &path) {
            Ok(differences) => wrong.extend(differences.iter().map(|what| format!("{file}: {what}"))),
            Err(error) => wrong.push(format!("{file}: {error}")),
        }
    }
    for line in &wrong { println!("WRONG {line}"); }
    assert!(wrong.is_empty());
}
