//! Remote files that are read in ranges: the same results as from mapped files, in few batches.

use std::fmt::Debug;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, LazyLock, Mutex};

use spinney::query::{Condition, EdgeRule, PointSamples, Polygon, ZonalRequest, ZoneMeasure};
use spinney::raw::io::batch::{run_batched, try_once};
use spinney::raw::io::{Fetch, RangeCache, RangeFile};
use spinney::raw::store::ByteSource;
use spinney::raw::store::goblin::Goblin;
use spinney::{
    Bounds, Code, DataKind, Dataset, Dimension, Error, OpenOptions, Output, Result, Rule, SampleType,
    WriteOptions,
};

use crate::common::{BYTE, Cells, QUAD, Random, goblin_bytes, oct, quad};

/// Batches that were fetched: requests and bytes of each.
pub(super) type Batches = Arc<Mutex<Vec<(usize, u64)>>>;

/// Bytes in memory, and the batches in which they were requested.
struct Far {
    bytes: Arc<Vec<u8>>,
    batches: Batches,
}

impl Fetch for Far {
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        let bytes = ranges.iter().map(|range| range.end - range.start).sum();
        self.batches.lock().unwrap().push((ranges.len(), bytes));
        Ok(ranges.iter().map(|range| self.bytes[range.start as usize..range.end as usize].to_vec()).collect())
    }
}

/// Returns the file as a remote file with a cache of `cache` bytes, without merging of nearby
/// ranges.
pub(super) fn far(bytes: &Arc<Vec<u8>>, cache: u64) -> (RangeFile, Batches) {
    let batches = Batches::default();
    let fetch = Box::new(Far { bytes: bytes.clone(), batches: batches.clone() });
    let cache = (Arc::new(RangeCache::new(cache)), RangeCache::file_number());
    (RangeFile::new(Path::new("far"), bytes.len() as u64, fetch, cache, 0), batches)
}

pub(super) fn opened(file: RangeFile) -> Result<Dataset> {
    Dataset::of(Goblin::from_backend(Path::new("far"), Box::new(file), &OpenOptions::new())?.into())
}

/// A query with its result as text.
pub(super) type Query = (&'static str, Box<dyn Fn(&Dataset) -> Result<String>>);

pub(super) fn query<T: Debug>(
    name: &'static str,
    run_batched: impl Fn(&Dataset) -> Result<T> + 'static,
) -> Query {
    (name, Box::new(move |tree| run_batched(tree).map(|result| format!("{result:?}"))))
}

/// Returns a box near the middle of an image, not aligned.
fn middle(tree: &Dataset, level: u8) -> Bounds {
    let all = tree.extent_at(level);
    let axis = |axis: usize, part: u64| (all.max[axis] * part / 16).max(u64::from(part > 8));
    Bounds {
        min: [0, 1, 2].map(|at| axis(at, 5)),
        max: [0, 1, 2].map(|at| axis(at, 11).max(axis(at, 5) + 1)),
    }
}

fn window(tree: &Dataset, level: u8) -> Result<(Vec<u8>, Vec<bool>)> {
    let bounds = middle(tree, level);
    let cells = bounds.volume() as usize;
    let (mut values, mut valid) = (vec![0; cells * tree.header().form.width()], vec![false; cells]);
    tree.window(level, &bounds, 0.0, &mut values, Some(&mut valid))?;
    Ok((values, valid))
}

fn points(tree: &Dataset) -> Result<Vec<Option<spinney::Value>>> {
    let mut random = Random(7);
    let size = tree.header().extent;
    let cells: Vec<[u64; 3]> = (0..2000).map(|_| size.map(|cells| random.below(cells + 1))).collect();
    let mut samples = PointSamples::default();
    tree.points(&cells, tree.depth(), &mut samples)?;
    Ok((0..cells.len()).map(|index| samples.value(index)).collect())
}

fn zones(tree: &Dataset, request: &ZonalRequest) -> Result<Vec<spinney::query::ZoneStatistics>> {
    let [width, height, _] = tree.header().extent.map(|cells| cells as f64);
    let ring = |x: f64, y: f64, side: f64| {
        vec![[x, y], [x + side, y + side / 3.0], [x + side / 2.0, y + side], [x - side / 5.0, y + side / 2.0]]
    };
    let polygons = (0..7).map(|zone| {
        let at = f64::from(zone) / 8.0;
        Polygon::new(&[ring(width * at, height * (1.0 - at) / 2.0, height / 3.0)])
    });
    tree.zonal(&polygons.collect::<Result<Vec<_>>>()?, request, &())
}

pub(super) fn queries() -> Vec<Query> {
    let rotated = |tree: &Dataset| -> Result<Dataset> {
        let path = tree.whole_source().expect("a tree without steps");
        Dataset::of(Arc::try_unwrap(path).unwrap_or_else(|_| panic!("one owner")))?
            .view(&["rotate=20".parse()?])
    };
    let mut measured = ZonalRequest::from(EdgeRule::Area);
    measured.measures = vec![ZoneMeasure::Median, ZoneMeasure::Variety];
    vec![
        query("window", |tree| window(tree, tree.depth())),
        query("window of a coarse level", |tree| window(tree, tree.depth() - 3)),
        query("points", points),
        query("point", |tree| {
            let mut value = Default::default();
            tree.point([17, 33, 0], tree.depth(), &mut value).map(|found| (found, value))
        }),
        query("node", |tree| tree.node(Code::from_cell(tree.header().form.dimension, 3, [3, 2, 0]).unwrap())),
        query("statistics", |tree| tree.statistics(None, &())),
        query("statistics of a box", |tree| tree.statistics(Some(middle(tree, tree.depth())), &())),
        query("histogram", |tree| tree.histogram(&middle(tree, tree.depth()), 0.0, 50.0, 10, &())),
        query("extremes", |tree| tree.exact_bounds()),
        query("VOID", |tree| tree.may_have_void(middle(tree, tree.depth()))),
        query("search", |tree| {
            let mut found = Vec::new();
            let take = &mut |block| {
                found.push(block);
                Ok(found.len() < 5000)
            };
            tree.find(Condition::Above(100.0.into()), None, &(), take).map(|()| found)
        }),
        query("zones", |tree| zones(tree, &EdgeRule::Centre.into())),
        query("zones by area", move |tree| zones(tree, &measured)),
        query("a rotated view", move |tree| window(&rotated(tree)?, tree.depth())),
        query("verification", |tree| tree.verify_quickly(64 << 20, &())),
    ]
}

/// Returns a file of many segments in which all cells differ.
fn large() -> Arc<Vec<u8>> {
    static LARGE: LazyLock<Arc<Vec<u8>>> = LazyLock::new(|| {
        let cells = Cells::random(QUAD, 8, [2100, 1500, 1], 200, false);
        Arc::new(goblin_bytes(&cells, Rule::Mean, DataKind::Continuous))
    });
    LARGE.clone()
}

#[test]
fn mapped_positioned_and_remote_files_have_the_same_results() {
    let directory = tempfile::tempdir().unwrap();
    let small = |form, size, kind| {
        let rule = if kind == DataKind::Categorical { Rule::Majority } else { Rule::Mean };
        Arc::new(goblin_bytes(&Cells::random(form, 3, size, 30, true), rule, kind))
    };
    let files = [
        large(),
        small(QUAD, [700, 900, 1], DataKind::Categorical),
        small(quad(SampleType::F32, 2), [600, 500, 1], DataKind::Continuous),
        small(oct(SampleType::U16, 1), [130, 90, 100], DataKind::Continuous),
    ];
    for (number, bytes) in files.iter().enumerate() {
        let path = directory.path().join(format!("{number}.goblin"));
        std::fs::write(&path, &**bytes).unwrap();
        let mapped = spinney::raw::dataset::open(&path, &OpenOptions::new()).unwrap();
        let positioned = spinney::raw::dataset::open(&path, &OpenOptions::new().positioned(1 << 20)).unwrap();
        for (name, query) in queries() {
            let expected = query(&mapped).map_err(|error| error.to_string());
            let same = query(&positioned).map_err(|error| error.to_string());
            assert!(same == expected, "{name} of file {number}, positioned");
            // Each with an empty cache, and with a cache that holds hardly anything.
            for cache in [64 << 20, 200_000] {
                let (file, _) = far(bytes, cache);
                let found = opened(file).and_then(|tree| query(&tree)).map_err(|error| error.to_string());
                assert!(found == expected, "{name} of file {number} with {cache} bytes");
            }
        }
    }
}

/// An Autumnal file is read extent by extent: a window of 256 x 256 cells needs the extents of the
/// records on its path, and its own.
#[test]
fn autumnal_files_are_read_in_few_batches() {
    let directory = tempfile::tempdir().unwrap();
    let [goblin, path] = ["a.goblin", "a.autumn"].map(|name| directory.path().join(name));
    std::fs::write(&goblin, &**large()).unwrap();
    spinney::convert(&goblin, false, Output::create(&path).unwrap(), WriteOptions::new(64 << 20), &())
        .unwrap();
    let bytes = Arc::new(std::fs::read(&path).unwrap());
    let near = spinney::raw::dataset::open(&path, &OpenOptions::new()).unwrap();
    let open = |cache: u64| {
        let (file, batches) = far(&bytes, cache);
        let source = ByteSource::new(move |_| Ok(Box::new(file.clone())));
        let tree = spinney::raw::dataset::open(Path::new("far"), &OpenOptions::new().source(source));
        (tree, batches)
    };
    for (name, query) in queries() {
        let expected = query(&near).map_err(|error| error.to_string());
        for cache in [64 << 20, 300_000] {
            let found = open(cache).0.and_then(|tree| query(&tree)).map_err(|error| error.to_string());
            assert!(found == expected, "{name} with {cache} bytes");
        }
    }
    let mut random = Random(2);
    let mut values = vec![0u8; 1 << 16];
    for _ in 0..30 {
        let min = [random.below(1800), random.below(1200), 0];
        let bounds = Bounds { min, max: [min[0] + 256, min[1] + 256, 1] };
        let (tree, batches) = open(64 << 20);
        let tree = tree.unwrap();
        assert!(batches.lock().unwrap().len() <= 4, "opening: {batches:?}");
        batches.lock().unwrap().clear();
        tree.window(tree.depth(), &bounds, 0.0, &mut values, None).unwrap();
        let batches = batches.lock().unwrap();
        let (requests, read) = batches.iter().fold((0, 0), |sum, batch| (sum.0 + batch.0, sum.1 + batch.1));
        assert!(batches.len() <= 8 && requests <= 30 && read < 4 << 20, "{bounds:?}: {batches:?}");
    }
}

/// Batches per query: the segment index, and one per level of segments on the path.
#[test]
fn queries_take_few_batches() {
    let bytes = large();
    for (name, query) in queries() {
        let (file, batches) = far(&bytes, 64 << 20);
        let tree = opened(file).unwrap();
        let opening = std::mem::take(&mut *batches.lock().unwrap());
        assert!(opening.len() <= 3, "opening: {opening:?}");
        query(&tree).unwrap();
        let cold = std::mem::take(&mut *batches.lock().unwrap());
        let most = match name {
            "point" | "points" | "node" => 2,
            "verification" => 40,
            "a rotated view" => 9,
            _ => 6,
        };
        assert!(cold.len() <= most, "{name}: {cold:?}");
        query(&tree).unwrap();
        assert_eq!(batches.lock().unwrap().len(), 0, "{name} is held by now");
    }
}

/// A window of 256 x 256 cells needs one or two pages of the segment index, and the same segments
/// as in a mapped file, each once.
#[test]
fn windows_read_no_segment_too_many() {
    let bytes = large();
    let (file, batches) = far(&bytes, 64 << 20);
    let tree = opened(file).unwrap();
    // The segment index first.
    let all = tree.header().extent_bounds();
    let pages = |level| Bounds { min: [0; 3], max: tree.extent_at(level).max };
    for level in 0..=4 {
        let mut values = vec![0; pages(level).volume() as usize];
        tree.window(level, &pages(level), 0.0, &mut values, None).unwrap();
    }
    let mut random = Random(3);
    let mut values = vec![0u8; 1 << 16];
    for _ in 0..100 {
        let level = 8 + random.below(u64::from(tree.depth()) - 7) as u8;
        let limit = tree.extent_at(level).max.map(|end| end.saturating_sub(256) + 1);
        let min = [random.below(limit[0]), random.below(limit[1]), 0];
        let bounds = Bounds { min, max: [min[0] + 256, min[1] + 256, 1] };
        let (file, batches) = far(&bytes, 64 << 20);
        let cold = opened(file).unwrap();
        batches.lock().unwrap().clear();
        cold.window(level, &bounds, 0.0, &mut values, None).unwrap();
        let batches = batches.lock().unwrap();
        let requests: usize = batches.iter().map(|(requests, _)| requests).sum();
        assert!(batches.len() <= 2 && requests <= 9 + 4, "level {level}, {bounds:?}: {batches:?}");
    }
    assert!(!all.is_empty() && !batches.lock().unwrap().is_empty());
}

/// Callers without blocking threads, such as a page in a browser, fetch what a pass reports as
/// missing, and run the query again.
#[test]
fn batches_can_be_driven_by_the_caller() {
    let bytes = large();
    let (file, batches) = far(&bytes, 64 << 20);
    let mut values = None;
    let mut passes = 0;
    loop {
        let (result, missing) = try_once(&mut || {
            let tree = opened(file.clone())?;
            values = Some(window(&tree, tree.depth())?);
            Ok(())
        });
        if missing.is_empty() {
            result.unwrap();
            break;
        }
        passes += 1;
        assert!(passes < 8 && matches!(result, Err(Error::NotFetched)), "{passes}");
        for part in missing {
            let range = part.range.start as usize..part.range.end as usize;
            part.file.supply(part.range.start, bytes[range].to_vec());
        }
    }
    assert_eq!(batches.lock().unwrap().len(), 0, "nothing was fetched by the library");
    let mapped = Dataset::of(Goblin::from_bytes(bytes.to_vec()).unwrap().into()).unwrap();
    assert_eq!(values.unwrap(), window(&mapped, mapped.depth()).unwrap());
}

/// Changed bytes at any offset give an error or the right result, with a bounded number of batches.
#[test]
fn malicious_files_end_after_few_batches() {
    let bytes =
        goblin_bytes(&Cells::random(QUAD, 5, [900, 700, 1], 90, true), Rule::Majority, DataKind::Categorical);
    let mut random = Random(11);
    for _ in 0..60 {
        let mut changed = bytes.clone();
        // The segment index and the bytes after it hold all offsets.
        let end = changed.len() as u64;
        let offset = end - 1 - random.below(end / 8);
        changed[offset as usize] ^= 1 << random.below(8);
        let changed = Arc::new(changed);
        let (file, batches) = far(&changed, 4 << 20);
        let Ok(tree) = opened(file) else { continue };
        for (_, query) in queries() {
            let _ = query(&tree);
        }
        let batches = batches.lock().unwrap().len();
        assert!(batches < 15 * 70, "{batches} rounds with byte {offset} changed");
    }
}

/// Batches of one thread do not affect those of other threads.
#[test]
fn threads_query_concurrently() {
    let bytes = large();
    let (file, _) = far(&bytes, 3 << 20);
    let tree = opened(file).unwrap();
    let mapped = Dataset::of(Goblin::from_bytes(bytes.to_vec()).unwrap().into()).unwrap();
    std::thread::scope(|scope| {
        for thread in 0..8u64 {
            let (tree, mapped) = (&tree, &mapped);
            scope.spawn(move || {
                let mut random = Random(thread + 1);
                let (mut found, mut expected) = (vec![0u8; 1 << 14], vec![0u8; 1 << 14]);
                for _ in 0..20 {
                    let min = [random.below(1900), random.below(1300), 0];
                    let bounds = Bounds { min, max: [min[0] + 128, min[1] + 128, 1] };
                    tree.window(tree.depth(), &bounds, 0.0, &mut found, None).unwrap();
                    mapped.window(tree.depth(), &bounds, 0.0, &mut expected, None).unwrap();
                    assert!(found == expected);
                    let zones = run_batched(|| zones(tree, &EdgeRule::Centre.into())).unwrap();
                    assert_eq!(zones.len(), 7);
                }
            });
        }
    });
    assert_eq!(tree.header().form.value, BYTE);
    assert_eq!(tree.header().form.dimension, Dimension::Quad);
}
