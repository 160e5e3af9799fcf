//! Compares sharded builds with single-process builds.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use super::cut::subsets_of;
use super::units::{PointTotals, Units, find_summary};
use super::{PointCut, PointShard, build_shard, cut, find_shard, merge_shards, write_head};
use crate::attribute::position_of;
use crate::build::Encoder;
use crate::import::{PointImport, PointImportOptions, plan_files, plan_points};
use crate::las::tests::{las_bytes, records};
use crate::query::{PointCondition, Relation};
use crate::source::{PointSchema, PointSource, PointSubset, both_bounds, bounds_of};
use crate::store::{PointTree, is_point_file};
use crate::tests::{clumped_positions, layout, random, rows, scattered_positions};
use spinney_base::io::{FileAccess, Output};
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_container::{OpenOptions, Shard, ShardRange, SummaryWriter};

/// Points in memory, divided into subsets.
struct SubsetRows {
    schema: PointSchema,
    rows: Vec<Vec<u8>>,
    subsets: Vec<PointSubset>,
    /// Index of the next subset, and the offset of its first unread byte.
    next: (usize, usize),
}

impl SubsetRows {
    fn new(dimension: Dimension, rows: Vec<Vec<u8>>) -> SubsetRows {
        let mut schema = PointSchema::new(layout(), dimension);
        let size = schema.layout.size;
        let subset = |rows: &Vec<u8>| {
            let bounds = bounds_of(rows, size).unwrap_or([[0; 3]; 2]);
            PointSubset { count: (rows.len() / size) as u64, bounds }
        };
        let subsets: Vec<PointSubset> = rows.iter().map(subset).collect();
        let bounds = rows.iter().fold(None, |bounds, rows| both_bounds(bounds, bounds_of(rows, size)));
        schema.bounds = bounds.unwrap_or([[0; 3]; 2]);
        schema.count = Some(subsets.iter().map(|subset| subset.count).sum());
        SubsetRows { schema, rows, subsets, next: (0, 0) }
    }
}

impl PointSource for SubsetRows {
    fn schema(&self) -> &PointSchema {
        &self.schema
    }

    fn read(&mut self, rows: &mut Vec<u8>, most: usize) -> Result<usize> {
        let size = self.schema.layout.size;
        while let Some(subset) = self.rows.get(self.next.0) {
            let rest = &subset[self.next.1..];
            let bytes = rest.len().min(most * size);
            if bytes > 0 {
                rows.extend_from_slice(&rest[..bytes]);
                self.next.1 += bytes;
                return Ok(bytes / size);
            }
            self.next = (self.next.0 + 1, 0);
        }
        Ok(0)
    }

    fn subsets(&self) -> &[PointSubset] {
        &self.subsets
    }

    fn subset(&self, number: usize) -> Result<Box<dyn PointSource>> {
        let (schema, rows) = (self.schema.clone(), vec![self.rows[number].clone()]);
        Ok(Box::new(SubsetRows { schema, rows, subsets: vec![self.subsets[number]], next: (0, 0) }))
    }
}

fn options(leaf_size: usize, memory: u64) -> PointImportOptions {
    let mut options = PointImportOptions::default();
    (options.build.leaf_size, options.build.memory) = (leaf_size, memory);
    options
}

/// Returns the bytes of a single-process build.
fn whole(import: PointImport) -> Vec<u8> {
    let memory_output = MemoryOutput::default();
    import.build(memory_output.output(Path::new("whole.goblin")), &()).unwrap();
    memory_output.bytes()
}

/// In-memory output, which avoids waiting for the disk.
#[derive(Clone, Default)]
struct MemoryOutput(Arc<Mutex<Vec<u8>>>);

impl MemoryOutput {
    fn output(&self, name: &Path) -> Output {
        Output::to_writer(name, Box::new(self.clone()))
    }

    fn bytes(&self) -> Vec<u8> {
        self.0.lock().unwrap().clone()
    }
}

impl Write for MemoryOutput {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A sharded build in a directory: its head and its shards.
struct Job {
    directory: tempfile::TempDir,
    cut: PointCut,
    shards: Vec<PointShard>,
}

impl Job {
    fn plan(import: &PointImport, shards: u32) -> Job {
        let directory = tempfile::tempdir().unwrap();
        write_head(import, Output::create(&directory.path().join("head.goblin")).unwrap()).unwrap();
        let cut = cut(import, shards).unwrap();
        let shard = |(number, run): (usize, &Option<_>)| {
            let (directory, number, access) =
                (directory.path().to_path_buf(), number as u32, FileAccess::default());
            let ranges = run.iter().map(|run| ShardRange { layer: 0, run: *run }).collect();
            PointShard { shard: Shard { directory, job: 77, number, ranges, access }, level: cut.level }
        };
        let shards = cut.runs.iter().enumerate().map(shard).collect();
        Job { directory, cut, shards }
    }

    fn head(&self) -> PathBuf {
        self.directory.path().join("head.goblin")
    }

    fn build(&self, import: &PointImport, number: usize) -> Result<()> {
        build_shard(import, (&self.head(), &self.shards[number]), &|| Ok(()), &())
    }

    fn merge(&self) -> Result<Vec<u8>> {
        let memory_output = MemoryOutput::default();
        let output = memory_output.output(&self.directory.path().join("merged.goblin"));
        merge_shards(&self.head(), &self.shards, self.cut.points, (output, 1 << 16), &())?;
        Ok(memory_output.bytes())
    }

    /// Reads a shard's summary, and returns the number of points in its units.
    fn read(&self, shard: &PointShard) -> Result<u64> {
        let head = PointTree::open(&self.head(), &OpenOptions::default())?;
        let encoder = Encoder::new(head.layout().clone(), head.grid().clone());
        let Some(summary) = find_summary(shard)? else { return Ok(0) };
        let mut units = Units::new(summary, shard, &encoder, head.summary().leaf_size as usize)?;
        let mut points = 0;
        while let Some(unit) = units.next()? {
            points += unit.points;
        }
        Ok(points)
    }

    /// Builds all shards, from the last to the first, and returns the merged tree.
    fn all(&self, import: &dyn Fn() -> PointImport) -> Vec<u8> {
        for number in (0..self.shards.len()).rev() {
            self.build(&import(), number).unwrap();
        }
        self.merge().unwrap()
    }
}

/// Divides rows into tiles by x; some rows are in two tiles.
fn tiles(rows: &[u8], count: usize) -> Vec<Vec<u8>> {
    let mut tiles = vec![Vec::new(); count + 1];
    for (number, row) in rows.chunks_exact(layout().size).enumerate() {
        let tile = ((position_of(row)[0].max(0) as usize * count) >> 20).min(count - 1);
        tiles[tile].extend_from_slice(row);
        if number % 50 == 0 {
            tiles[count / 2].extend_from_slice(row);
        }
    }
    tiles
}

#[test]
fn sharded_builds_have_the_bytes_of_single_builds() {
    let sets = [
        (clumped_positions(12_000, 4), 4),
        (scattered_positions(8000, 9), 5),
        (scattered_positions(300, 2), 1),
        (vec![[7, 8, 9]; 70], 1),
        (vec![], 2),
    ];
    for dimension in [Dimension::Oct, Dimension::Quad] {
        for (positions, count) in &sets {
            let tiles = tiles(&rows(positions.iter().copied(), &layout()), *count);
            // Few shards in total, since each waits for the disk.
            for (leaf_size, memory, some) in
                [(20, 1, &[1, 7][..]), (700, 1 << 20, &[2, 64]), (50_000, 1 << 28, &[3])]
            {
                let import = || {
                    let source = Box::new(SubsetRows::new(dimension, tiles.clone()));
                    plan_points(source, &["a.las".into()], vec![], &options(leaf_size, memory)).unwrap()
                };
                let expected = whole(import());
                for shards in some.iter().copied() {
                    let job = Job::plan(&import(), shards);
                    let about =
                        format!("{dimension:?} {} {leaf_size} {shards} {}", positions.len(), job.cut.level);
                    assert!(job.all(&import) == expected, "{about}");
                    let runs = job.cut.runs.iter().flatten().count();
                    assert!(
                        runs >= 1 && (runs > shards as usize / 2 || positions.len() < 8000),
                        "{about} {runs}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_shard_reads_only_the_subsets_that_touch_it() {
    let tiles = tiles(&rows(scattered_positions(20_000, 9), &layout()), 16);
    let source = Box::new(SubsetRows::new(Dimension::Quad, tiles));
    let import = plan_points(source, &["a.las".into()], vec![], &options(100, 1 << 20)).unwrap();
    let job = Job::plan(&import, 8);
    let read: Vec<usize> = job.shards.iter().map(|shard| subsets_of(&import, shard).len()).collect();
    // One subset has points all over space.
    assert!(
        read.iter().filter(|subsets| **subsets < 12).count() > 5 && read.iter().sum::<usize>() >= 16,
        "{read:?}"
    );
}

/// LAS files of several formats and grids, adjacent and overlapping, one of which is empty.
fn scans(directory: &Path) -> Vec<PathBuf> {
    let scan = |name: &str, format: u8, count: usize, (x, y): (i32, i32), scale: f64| {
        let mut rows = records(format, 0, count);
        let size = rows.len().checked_div(count).unwrap_or(0).max(1);
        for row in rows.chunks_exact_mut(size) {
            let position = position_of(row);
            for (axis, step) in [position[0] + x, position[1] + y, position[2] / 8].into_iter().enumerate() {
                row[4 * axis..4 * axis + 4].copy_from_slice(&step.to_le_bytes());
            }
        }
        let path = directory.join(name);
        fs::write(&path, las_bytes(format, &rows, &[], scale)).unwrap();
        path
    };
    vec![
        scan("a.las", 3, 6000, (0, 0), 0.01),
        scan("b.las", 8, 5000, (6000, 300), 0.01),
        scan("empty.las", 3, 0, (0, 0), 0.01),
        scan("again.las", 3, 6000, (0, 0), 0.01),
        scan("c.las", 6, 3000, (900, 90_000), 0.005),
    ]
}

#[test]
fn sharded_las_files_have_the_bytes_of_a_single_build() {
    let directory = tempfile::tempdir().unwrap();
    let paths = scans(directory.path());
    let condition = PointCondition { attribute: 0, relation: Relation::Less, number: 30_000.0 };
    for (paths, conditions, attributes, some) in [
        (&paths[..], vec![], None, &[1, 2, 7, 64][..]),
        (&paths[..1], vec![], None, &[5]),
        (&paths[..], vec![condition], Some(vec!["classification".to_string(), "gps_time".into()]), &[3]),
    ] {
        let import = || {
            let options = PointImportOptions { attributes: attributes.clone(), ..options(150, 1 << 20) };
            plan_files(paths, &mut |_| Ok(conditions.clone()), &options).unwrap()
        };
        let expected = whole(import());
        for shards in some.iter().copied() {
            let job = Job::plan(&import(), shards);
            assert_eq!(job.cut.points.is_some(), conditions.is_empty());
            assert!(job.all(&import) == expected, "{} files, {shards} shards", paths.len());
        }
    }
}

fn small(leaf_size: usize, points: usize) -> PointImport {
    let tiles = tiles(&rows(clumped_positions(points, 4), &layout()), 3);
    let source = Box::new(SubsetRows::new(Dimension::Oct, tiles));
    plan_points(source, &["a.las".into()], vec![], &options(leaf_size, 1 << 20)).unwrap()
}

#[test]
fn missing_corrupt_and_foreign_shards_are_refused() {
    let import = || small(20, 4000);
    let expected = whole(import());
    let job = Job::plan(&import(), 3);
    assert_eq!(find_shard(&job.shards[1]).unwrap(), None);
    assert!(job.all(&import) == expected);
    let bytes = |number: &usize| find_shard(&job.shards[*number]).unwrap();
    let number = (0..3).max_by_key(bytes).unwrap();
    let shard = &job.shards[number];
    let [run, summary] = [shard.shard.run_path(0), shard.shard.summary_path()];
    let [first, known] = [&run, &summary].map(|path| fs::read(path).unwrap());
    assert!(!first.is_empty() && bytes(&number) == Some(first.len() as u64));
    // A shard that was aborted leaves at most a run file, which is rebuilt.
    fs::remove_file(&summary).unwrap();
    fs::write(&run, b"half of it").unwrap();
    let error = job.merge().unwrap_err().to_string();
    assert!(error.contains(&format!("000{number}.summary")), "{error}");
    // Building twice yields the same bytes.
    for _ in 0..2 {
        job.build(&import(), number).unwrap();
        assert!([&run, &summary].map(|path| fs::read(path).unwrap()) == [first.clone(), known.clone()]);
        assert!(job.merge().unwrap() == expected);
    }

    fs::write(&run, &first[..first.len() - 1]).unwrap();
    assert_eq!(find_shard(shard).unwrap(), None);
    assert!(job.merge().is_err());
    for byte in (0..first.len()).step_by(371) {
        let mut corrupted = first.clone();
        corrupted[byte] ^= 4;
        fs::write(&run, corrupted).unwrap();
        assert!(matches!(job.merge(), Err(Error::Corrupt { .. })), "{byte}");
    }
    fs::write(&run, &first).unwrap();
    for changed in [
        PointShard { shard: Shard { job: 78, ..shard.shard.clone() }, ..*shard },
        PointShard { level: shard.level - 1, ..shard.clone() },
        PointShard {
            shard: Shard { ranges: job.shards[(number + 1) % 3].shard.ranges.clone(), ..shard.shard.clone() },
            ..*shard
        },
    ] {
        assert!(matches!(find_shard(&changed), Err(Error::Unsupported { .. })));
    }
    fs::copy(job.shards[(number + 1) % 3].shard.summary_path(), &summary).unwrap();
    assert!(find_shard(shard).is_err());
    fs::write(&summary, &known).unwrap();
    // Shards with a gap, and too few points.
    let gap = merge_shards(
        &job.head(),
        &job.shards[1..],
        None,
        (MemoryOutput::default().output(Path::new("gap.goblin")), 0),
        &(),
    );
    assert!(gap.unwrap_err().to_string().contains("shards of"));
    let output = MemoryOutput::default().output(Path::new("few.goblin"));
    assert!(merge_shards(&job.head(), &job.shards, Some(1), (output, 0), &()).is_err());
    assert!(!is_point_file(&summary, &FileAccess::default()).unwrap());
    assert!(PointTree::open(&summary, &OpenOptions::default()).is_err());
    assert!(job.merge().unwrap() == expected);
}

#[test]
fn inputs_that_differ_from_the_plan_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let paths = scans(directory.path());
    let import = |leaf_size| plan_files(&paths, &mut |_| Ok(vec![]), &options(leaf_size, 1 << 20)).unwrap();
    let job = Job::plan(&import(100), 2);
    assert!(matches!(job.build(&import(101), 0), Err(Error::PlanMismatch { .. })));
    // A different position changes the grid; other points in the same box, with another count, do
    // not.
    let bytes = fs::read(&paths[4]).unwrap();
    fs::write(&paths[4], las_bytes(6, &records(6, 0, 3000), &[], 0.01)).unwrap();
    assert!(matches!(job.build(&import(100), 0), Err(Error::PlanMismatch { .. })));
    fs::write(&paths[4], &bytes).unwrap();
    // A header with wrong bounds: some points would be in no shard.
    let mut wrong = bytes.clone();
    let max_y = 195;
    wrong[max_y..max_y + 8].copy_from_slice(&460.0f64.to_le_bytes());
    fs::write(&paths[4], &wrong).unwrap();
    let job = Job::plan(&import(100), 2);
    let errors: Vec<_> = (0..2).filter_map(|shard| job.build(&import(100), shard).err()).collect();
    assert!(
        !errors.is_empty() && errors.iter().all(|error| error.to_string().contains("its header declares")),
        "{errors:?}"
    );
    let tree = fs::read_dir(job.directory.path()).unwrap().count();
    assert!(job.merge().is_err() && tree < 6);
}

#[test]
fn corrupt_summaries_are_refused() {
    let import = || small(20, 300);
    let job = Job::plan(&import(), 2);
    let expected = job.all(&import);
    let summary = job.shards[1].shard.summary_path();
    let bytes = fs::read(&summary).unwrap();
    let mut random = random(3);
    // Every byte after the blocks, and many bytes of the blocks.
    for byte in (0..bytes.len()).filter(|byte| byte % 5 == 0 || byte + 2000 > bytes.len()) {
        let mut corrupted = bytes.clone();
        corrupted[byte] ^= 1 << (random() % 8);
        fs::write(&summary, &corrupted).unwrap();
        // Changes in optional contents are no corruption.
        let is_read = job.read(&job.shards[1]).is_ok();
        assert!(!is_read || job.merge().is_ok_and(|merged| merged == expected), "{byte}");
    }
    for length in (0..bytes.len()).step_by(11) {
        fs::write(&summary, &bytes[..length]).unwrap();
        assert!(job.read(&job.shards[1]).is_err(), "{length}");
    }
}

/// Returns the bytes of a shard's units, and their totals.
fn units_of(shard: &PointShard) -> (Vec<u8>, u64, PointTotals) {
    let summary = find_summary(shard).unwrap().unwrap();
    let mut range = summary.bytes_of(&summary.ranges[0]).unwrap();
    let mut bytes = Vec::new();
    while !range.is_over() {
        bytes.extend(range.take(1).unwrap());
    }
    (bytes, summary.run_bytes(), summary.ranges[0].totals)
}

/// Writes a summary with other bytes and valid checksums.
fn forge(shard: &Shard, bytes: &[u8], run_bytes: u64, totals: PointTotals) {
    let mut writer = SummaryWriter::new(shard).unwrap();
    writer.begin(shard.ranges[0]);
    writer.write(bytes).unwrap();
    writer.end(run_bytes, totals).unwrap();
    writer.finish().unwrap();
}

#[test]
fn forged_summaries_do_no_harm() {
    let import = || small(20, 600);
    let job = Job::plan(&import(), 2);
    let expected = job.all(&import);
    let shard = &job.shards[1];
    let path = shard.shard.summary_path();
    let known = fs::read(&path).unwrap();
    let (bytes, run_bytes, totals) = units_of(shard);
    forge(&shard.shard, &bytes, run_bytes, totals);
    assert!(fs::read(&path).unwrap() == known && job.merge().unwrap() == expected);
    let mut random = random(8);
    let mut refused = 0;
    for _ in 0..900 {
        let mut forged = bytes.clone();
        let number = random();
        let at = (number >> 8) as usize % bytes.len();
        match number & 7 {
            0 => forged[at] ^= 1 << (random() & 7),
            1 => forged[at..].iter_mut().take(4).for_each(|byte| *byte = 0xff),
            2 => forged[at..].iter_mut().take(8).for_each(|byte| *byte = 0),
            3 => forged.truncate(at),
            4 => drop(forged.drain(at..(at + 30).min(bytes.len()))),
            5 => forged.extend_from_within(at..),
            _ => forged[at] = forged[at].wrapping_add(1),
        }
        forge(&shard.shard, &forged, run_bytes, totals);
        // Statistics that no reader verifies are accepted without consequences.
        refused += u32::from(job.read(shard).is_err() || job.merge().is_err());
    }
    assert!(refused > 450, "{refused}");
    let PointTotals { points, .. } = totals;
    for wrong in [
        PointTotals { points: points + 1, ..totals },
        PointTotals { points: u64::MAX, ..totals },
        PointTotals { duplicates: points + 1, ..totals },
        PointTotals { level: 200, ..totals },
    ] {
        forge(&shard.shard, &bytes, run_bytes, wrong);
        assert!(job.merge().is_err(), "{wrong:?}");
    }
    forge(&shard.shard, &bytes, u64::MAX, totals);
    assert!(job.merge().is_err());
}
