//! Reads of both formats: opened, queried, verified.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use spinney::query::{Condition, PointSamples};
use spinney::raw::io::ReadBackend;
use spinney::raw::store::autumnal::Autumnal;
use spinney::raw::store::goblin::Goblin;
use spinney::{Bounds, Dataset, Number, OpenOptions, Result};

use super::batches::range_file;
use super::seal;

/// Bytes that must be copied, as those of files that are read at offsets.
pub struct Copied(pub Vec<u8>);

impl ReadBackend for Copied {
    fn len(&self) -> u64 {
        self.0.len() as u64
    }

    fn bytes(&self) -> Option<&[u8]> {
        None
    }

    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
        self.0.read(offset, length).map(|bytes| Cow::Owned(bytes.into_owned()))
    }
}

/// Returns one of several backends; the choice depends only on the bytes.
pub fn backend(file: Vec<u8>) -> Box<dyn ReadBackend> {
    let file_length = file.len();
    match crc32c::crc32c(&file) % 4 {
        0 => Box::new(Copied(file)),
        // (A cache that hardly any range fits into, or a large one.)
        1 => Box::new(range_file(Arc::new(file), 1 << 10 << (file_length % 11), 64)),
        _ => Box::new(file),
    }
}

/// A Goblin file, whose checksums are corrected.
pub fn goblin_read(bytes: &[u8]) {
    let mut file = bytes.to_vec();
    seal::goblin_end(&mut file);
    seal::goblin(&mut file);
    query_goblin(file);
}

/// Runs all queries of a Goblin file.
pub fn query_goblin(file: Vec<u8>) {
    spinney::raw::register();
    let Ok(file) = Goblin::from_backend(Path::new("(fuzz)"), backend(file), &OpenOptions::new()) else {
        return;
    };
    if let Ok(tree) = Dataset::of(file.into()) {
        query_tree(&tree);
    }
}

/// An Autumnal file, packed (see [`seal::packed`]), whose checksums are corrected.
pub fn autumnal_read(bytes: &[u8]) {
    if let Some(file) = seal::unpacked(bytes) {
        query_autumnal(file);
    }
}

/// Runs all queries of an Autumnal file.
pub fn query_autumnal(file: Vec<u8>) {
    let Ok(file) = Autumnal::from_bytes(file) else { return };
    if let Ok(tree) = Dataset::of(Arc::new(file).into()) {
        query_tree(&tree);
    }
}

/// Maximum number of records of trees that are queried completely: with shared subtrees a small
/// file can have exponentially many.
pub(super) const MAX_RECORDS: u64 = 1 << 14;
/// Cells of a window along an axis.
const SIDE: u64 = 24;

/// Runs all queries of a tree. If verification finds no defects, no query may fail, and the results
/// must be consistent.
pub fn query_tree(tree: &Dataset) {
    let is_small =
        matches!(tree.level_counts(MAX_RECORDS, &()), Ok(Some(_))) && tree.stored_records() <= MAX_RECORDS;
    let quick = fast_queries(tree);
    if !is_small {
        return;
    }
    let slow = slow_queries(tree);
    if is_good(tree) {
        assert!(quick.unwrap(), "a window and a point differ");
        assert!(slow.unwrap(), "statistics and counts differ");
    }
}

/// Returns whether verification finds no defects.
pub fn is_good(tree: &Dataset) -> bool {
    tree.verify(1 << 20, &()).is_ok_and(|findings| findings.is_empty())
}

/// Returns a box of cells in the middle of a raster, along no axis longer than `max_cells`.
fn middle(size: [u64; 3], max_cells: u64) -> Bounds {
    let min = size.map(|cells| cells / 3);
    Bounds { min, max: std::array::from_fn(|axis| size[axis].min(min[axis] + max_cells)) }
}

/// Runs queries that are fast whatever the tree is; returns whether the results are consistent.
pub(super) fn fast_queries(tree: &Dataset) -> Result<bool> {
    let header = tree.header();
    let (depth, width) = (tree.depth(), header.form.width());
    let (mut done, mut fits) = (Ok(()), true);
    let mut note = |result: Result<()>| {
        if done.is_ok() {
            done = result;
        }
    };
    let all = Bounds::of_extent(header.extent);
    for level in [0, depth / 2, depth] {
        let size = tree.extent_at(level).max;
        for bounds in [middle(size, SIDE), Bounds { min: [0; 3], max: size.map(|cells| cells.min(SIDE)) }] {
            let mut bytes = vec![0; bounds.volume() as usize * width];
            let mut valid = vec![false; bounds.volume() as usize];
            let drawn = tree.window(level, &bounds, 7.0, &mut bytes, Some(&mut valid));
            // The first cell equals the point query.
            let mut value = [Number::default(); 4];
            let point = tree.point(bounds.min, level, &mut value);
            if let (Ok(()), Ok(found)) = (&drawn, &point) {
                fits &= valid[0] == *found;
            }
            note(drawn);
            note(point.map(|_| ()));
            let cells = [bounds.min, size.map(|cells| cells - 1), [u64::MAX; 3]];
            let mut samples = PointSamples::default();
            note(tree.points(&cells, level, &mut samples));
        }
    }
    let _ = tree.metadata().counts.records();
    let _ = (tree.sections(), tree.remark(), tree.commit(), tree.segments());
    note(tree.statistics(None, &()).map(|_| ()));
    note(tree.value_bounds().map(|_| ()));
    note(tree.statistics(Some(middle(header.extent, SIDE)), &()).map(|_| ()));
    note(tree.may_have_void(all).map(|_| ()));
    done.map(|()| fits)
}

/// Runs queries that may read every node; returns whether the results are consistent.
pub(super) fn slow_queries(tree: &Dataset) -> Result<bool> {
    let all = Bounds::of_extent(tree.header().extent);
    let mut count = 0;
    tree.find(Condition::Above(1.0.into()), None, &(), &mut |_| {
        count += 1;
        Ok(count < 10_000)
    })?;
    tree.histogram(&all, 0.0, 9.0, 9, &())?;
    let [known, counted] = [tree.statistics(None, &())?, tree.statistics(Some(all), &())?];
    // (These refuse trees that are too large for them.)
    let _ = tree.df_text(1000);
    let _ = tree.classic_table(1000);
    let _ = tree.leaf_codes(1000);
    Ok((known.cells, known.void_cells) == (counted.cells, counted.void_cells))
}
