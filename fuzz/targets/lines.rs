//! Reads of line trees: opened, queried, verified, and written as features.

use std::path::Path;

use spinney::export::VectorFormat;
use spinney::lines::LineTree;
use spinney::raw::lines::{NearestLines, export_lines};
use spinney::{Error, OpenOptions, Output, Result};

use super::files::in_file;
use super::{seal, trees};

/// A file of a line tree, whose checksums are corrected.
pub fn lines_read(bytes: &[u8]) {
    let mut file = bytes.to_vec();
    seal::goblin_end(&mut file);
    seal::goblin(&mut file);
    query_lines(file);
}

/// Runs all queries of a line tree's file. If verification finds no defects, no query may fail.
pub fn query_lines(file: Vec<u8>) {
    let checksum = crc32c::crc32c(&file);
    let Ok(tree) = LineTree::from_backend(Path::new("(fuzz)"), trees::backend(file), &OpenOptions::new())
    else {
        return;
    };
    let outcome = fast_queries(&tree);
    // (Only for some files.)
    if checksum.is_multiple_of(32) {
        in_file("lines.geojson", b"", |path| {
            let output = Output::create(path).unwrap();
            let _ = export_lines(&tree, None, None, output, VectorFormat::GeoJson, &());
        });
    }
    if tree.verify(1 << 20, &()).unwrap().is_empty() {
        outcome.unwrap();
    }
}

/// Runs all fast queries.
fn fast_queries(tree: &LineTree) -> Result<()> {
    let grid = tree.grid();
    let _ = (tree.len(), tree.segments(), tree.leaf_size(), tree.bytes(), tree.attributes(), tree.metadata());
    let mut done = Ok(());
    let mut note = |result: Result<()>| {
        if done.is_ok() {
            done = result;
        }
    };
    note(tree.length().map(drop));
    note(tree.levels().map(drop));
    let found = tree.bounds();
    let [low, high] = found.as_ref().ok().copied().flatten().unwrap_or([grid.to_world([0; 3]); 2]);
    note(found.map(drop));
    let middle = [0, 1, 2].map(|axis| low[axis] / 2.0 + high[axis] / 2.0);
    let all = [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]];
    for window in [[low, high], [middle, high], [middle; 2], all] {
        note(tree.window(window, &()).map(drop));
    }
    let flat = |[x, y, _]: [f64; 3]| [x, y, f64::NAN];
    let lines = [vec![low, high], vec![[low[0], high[1], low[2]], middle, high], vec![flat(low), flat(high)]];
    for within in [0.0, grid.scale[0]] {
        note(tree.crossings(&lines, within, &()).map(drop));
    }
    // (Points too distant for exact comparison are refused.)
    let fits = |error: Error| if matches!(error, Error::Invalid { .. }) { Ok(()) } else { Err(error) };
    let nearest = NearestLines::new(tree, 1 << 16).and_then(|nearest| {
        nearest.find(&[low, middle, high, flat(middle)], 1, f64::INFINITY, &())?;
        nearest.find(&[middle, low], 20, 5.0, &()).map(drop)
    });
    note(nearest.or_else(fits));
    note(tree.features(&mut (0..tree.len().min(1 << 12)), &mut |number, feature| {
        assert!(number < tree.len() && feature.lines.iter().all(|line| line.len() >= 2));
        Ok(())
    }));
    done
}
