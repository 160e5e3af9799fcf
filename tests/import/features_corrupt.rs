//! Corrupt feature files: they end soon, use little memory, and do not panic.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use spinney::export::VectorFormat;
use spinney::import::feature::FeatureOptions;
use spinney::raw::export::vector::{AttributeType, AttributeValue, GeometryKind, VectorLayer, VectorWriter};
use spinney::raw::import::feature::open_features;
use spinney::{Crs, Error, Output, Result};

fn count(path: &Path) -> Result<usize> {
    let mut reader = open_features(path, &FeatureOptions { memory: 1 << 20, ..FeatureOptions::default() })?;
    let mut count = 0;
    while let Some(feature) = reader.next()? {
        assert_eq!(feature.attributes.len(), reader.schema().attributes.len());
        count += 1;
    }
    Ok(count)
}

/// Returns a small polygon file of our own writer, with its sidecars.
fn fixture(directory: &Path, ending: &str) -> Vec<PathBuf> {
    let path = directory.join(format!("a.{ending}"));
    let layer = VectorLayer {
        name: "things".into(),
        kind: Some(GeometryKind::Polygon),
        is_multi: false,
        has_z: false,
        attributes: vec![("size".into(), AttributeType::Number), ("name".into(), AttributeType::Text)],
        crs: Some(Crs::epsg(25832)),
        bounds: [[0.0, 0.0], [10.0, 10.0]],
    };
    let format: VectorFormat = ending.parse().unwrap();
    let mut writer = VectorWriter::create(Output::create(&path).unwrap(), format, layer).unwrap();
    for number in 0..4 {
        let x = f64::from(number);
        let square = |at: f64, size: f64| {
            let [low, high] = [at, at + size];
            [[low, 0.5], [high, 0.5], [high, size], [low, size], [low, 0.5]]
                .map(|[x, y]| [x, y, 0.0])
                .to_vec()
        };
        let rings = [square(x, 4.0), square(x + 1.0, 1.5)];
        let name = format!("no. {number}: \"é\", ü");
        writer.write(&rings, &[AttributeValue::Number(x / 2.0), AttributeValue::Text(&name)]).unwrap();
    }
    writer.finish(&()).unwrap();
    assert_eq!(count(&path).unwrap(), 4, "{ending}");
    let endings = if ending == "shp" { &["shp", "shx", "dbf", "cpg", "prj"][..] } else { &[ending][..] };
    endings.iter().map(|ending| path.with_extension(ending)).collect()
}

struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % limit.max(1)
    }
}

/// Changes some bytes, or removes or duplicates a range.
fn mutate(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + random.below(3) {
        let at = random.below(bytes.len());
        match random.below(6) {
            0 => bytes.truncate(at),
            1 => {
                let end = (at + random.below(64)).min(bytes.len());
                let part = bytes[at..end].to_vec();
                bytes.splice(at..at, part);
            }
            2 => {
                let word = [[0xff; 4], [0, 0, 0, 0x80], [0xff, 0xff, 0xff, 0x7f], [0; 4]][random.below(4)];
                bytes.iter_mut().skip(at).zip(word).for_each(|(byte, new)| *byte = new);
            }
            3 => {
                let letter = b"{}[]\",:()0;e-\n"[random.below(14)];
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = letter;
                }
            }
            _ => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << random.below(8);
                }
            }
        }
        if bytes.is_empty() {
            break;
        }
    }
    bytes
}

#[test]
fn changed_files_of_all_formats_come_to_an_end() {
    let directory = tempfile::tempdir().unwrap();
    let mut random = Random(7);
    for ending in ["geojson", "csv", "gpkg", "fgb", "shp"] {
        let files = fixture(directory.path(), ending);
        let (mut read, mut refused) = (0, 0);
        let start = Instant::now();
        for file in &files {
            let bytes = std::fs::read(file).unwrap();
            let times = if ending == "gpkg" { 150 } else { 300 };
            for _ in 0..times {
                std::fs::write(file, mutate(&bytes, &mut random)).unwrap();
                match count(&files[0]) {
                    Ok(_) => read += 1,
                    Err(error) => {
                        refused += 1;
                        let said = error.to_string();
                        let has_name = matches!(error, Error::Invalid { .. }) || said.contains("a.");
                        assert!(has_name, "{ending}: {said}");
                    }
                }
            }
            std::fs::write(file, &bytes).unwrap();
        }
        assert!(read > 0 && refused > 0, "{ending}: {read} read, {refused} refused");
        assert!(start.elapsed() < Duration::from_secs(120), "{ending}: {:?}", start.elapsed());
    }
}

#[test]
fn decompression_bombs_are_rejected() {
    let directory = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = directory.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let refused = |name: &str, text: &str, expected: &str| {
        let start = Instant::now();
        let said = count(&write(name, text)).unwrap_err().to_string();
        assert!(said.contains(expected), "{said}");
        assert!(start.elapsed() < Duration::from_secs(20), "{name}: {:?}", start.elapsed());
    };
    // Unbounded nesting.
    refused("a.geojson", &"{\"a\":".repeat(100_000), "deep");
    let deep = "{\"type\":\"GeometryCollection\",\"geometries\":[".repeat(30);
    refused("a.geojson", &format!("{{\"type\":\"Feature\",\"geometry\":{deep}{}}}", "]}".repeat(30)), "deep");
    // A distinct attribute name in each feature gives quadratically many values.
    let feature = |index: usize| {
        format!("{{\"type\":\"Feature\",\"geometry\":null,\"properties\":{{\"n{index}\":1}}}}\n")
    };
    refused("a.geojson", &(0..10_000).map(feature).collect::<String>(), "4096 names");
    // A quote without an end.
    refused("a.csv", &format!("x,y,t\n1,2,\"{}", "a,\n".repeat(1_000_000)), "memory");
    refused("a.csv", "x,y,t\n1,2,\"a", "quote");
    refused("a.csv", &format!("x,y{}\n", ",c".repeat(5000)), "5002 columns");
    refused("a.geojson", "", "first bytes");
    refused("a.geojson", "[1, 2]", "first bytes");
    refused("a.geojson", "{\"type\":\"FeatureCollection\",\"features\":[", "end of the file");
    refused("a.csv", "", "columns");
}

#[test]
fn counts_of_shapefiles_are_held_to_their_files() {
    let directory = tempfile::tempdir().unwrap();
    let files = fixture(directory.path(), "shp");
    let [shapes, index_file, table] = [0, 1, 2].map(|index| std::fs::read(&files[index]).unwrap());
    // A table with more rows than shapes.
    let mut longer = table.clone();
    longer[4] = 9;
    std::fs::write(&files[2], &longer).unwrap();
    let said = count(&files[0]).unwrap_err().to_string();
    assert!(said.contains("4 shapes, and 9 rows"), "{said}");
    // Without an index file shapes are read consecutively; without a table they have no attributes.
    std::fs::write(&files[2], &table).unwrap();
    std::fs::remove_file(&files[1]).unwrap();
    assert_eq!(count(&files[0]).unwrap(), 4);
    std::fs::write(&files[2], &longer).unwrap();
    let said = count(&files[0]).unwrap_err().to_string();
    assert!(said.contains("feature 5") && said.contains("end of the file"), "{said}");
    std::fs::remove_file(&files[2]).unwrap();
    assert_eq!(count(&files[0]).unwrap(), 4);
    // An offset outside of the file.
    let mut outside = index_file;
    outside[100..104].copy_from_slice(&u32::MAX.to_be_bytes());
    std::fs::write(&files[1], outside).unwrap();
    let said = count(&files[0]).unwrap_err().to_string();
    assert!(said.contains("feature 1") && said.contains(&shapes.len().to_string()), "{said}");
}
