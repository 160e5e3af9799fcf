//! Compares sharded builds with single-process builds.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use super::cut::parts_of;
use super::units::{PointTotals, Units, find_summary};
use super::{PointCut, PointShard, build_shard, cut, find_shard, merge_shards, write_head};
use crate::attribute::place_of;
use crate::build::Encoder;
use crate::import::{PointImport, PointImportOptions, plan_files, plan_points};
use crate::las::tests::{las_bytes, records};
use crate::query::{PointCondition, Relation};
use crate::source::{PointPart, PointSchema, PointSource, both_bounds, bounds_of};
use crate::store::{PointTree, is_point_file};
use crate::tests::{all_places, clumped_places, layout, random, rows};
use spinney_base::io::{FileAccess, Output};
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_container::{OpenOptions, Shard, ShardPiece, SummaryWriter};

/// Points in memory, divided into parts.
struct PartRows {
    schema: PointSchema,
    rows: Vec<Vec<u8>>,
    parts: Vec<PointPart>,
    /// Index of the next part, and the offset of its first unread byte.
    next: (usize, usize),
}

impl PartRows {
    fn new(dimension: Dimension, rows: Vec<Vec<u8>>) -> PartRows {
        let mut schema = PointSchema::new(layout(), dimension);
        let size = schema.layout.size;
        let part = |rows: &Vec<u8>| {
            let bounds = bounds_of(rows, size).unwrap_or([[0; 3]; 2]);
            PointPart { count: (rows.len() / size) as u64, bounds }
        };
        let parts: Vec<PointPart> = rows.iter().map(part).collect();
        let bounds = rows.iter().fold(None, |bounds, rows| both_bounds(bounds, bounds_of(rows, size)));
        schema.bounds = bounds.unwrap_or([[0; 3]; 2]);
        schema.count = Some(parts.iter().map(|part| part.count).sum());
        PartRows { schema, rows, parts, next: (0, 0) }
    }
}

impl PointSource for PartRows {
    fn schema(&self) -> &PointSchema {
        &self.schema
    }

    fn read(&mut self, rows: &mut Vec<u8>, most: usize) -> Result<usize> {
        let size = self.schema.layout.size;
        while let Some(part) = self.rows.get(self.next.0) {
            let rest = &part[self.next.1..];
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

    fn parts(&self) -> &[PointPart] {
        &self.parts
    }

    fn part(&self, number: usize) -> Result<Box<dyn PointSource>> {
        let (schema, rows) = (self.schema.clone(), vec![self.rows[number].clone()]);
        Ok(Box::new(PartRows { schema, rows, parts: vec![self.parts[number]], next: (0, 0) }))
    }
}

fn options(leaf_size: usize, memory: u64) -> PointImportOptions {
    let mut options = PointImportOptions::default();
    (options.build.leaf_size, options.build.memory) = (leaf_size, memory);
    options
}

/// Returns the bytes of a single-process build.
fn whole(import: PointImport) -> Vec<u8> {
    let kept = Kept::default();
    import.build(kept.output(Path::new("whole.goblin")), &()).unwrap();
    kept.bytes()
}

/// In-memory output, which avoids waiting for the disk.
#[derive(Clone, Default)]
struct Kept(Arc<Mutex<Vec<u8>>>);

impl Kept {
    fn output(&self, name: &Path) -> Output {
        Output::to_writer(name, Box::new(self.clone()))
    }

    fn bytes(&self) -> Vec<u8> {
        self.0.lock().unwrap().clone()
    }
}

impl Write for Kept {
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
    folder: tempfile::TempDir,
    cut: PointCut,
    shards: Vec<PointShard>,
}

impl Job {
    fn plan(import: &PointImport, shards: u32) -> Job {
        let folder = tempfile::tempdir().unwrap();
        write_head(import, Output::create(&folder.path().join("head.goblin")).unwrap()).unwrap();
        let cut = cut(import, shards).unwrap();
        let shard = |(number, run): (usize, &Option<_>)| {
            let (folder, number, access) =
                (folder.path().to_path_buf(), number as u32, FileAccess::default());
            let pieces = run.iter().map(|run| ShardPiece { layer: 0, run: *run }).collect();
            PointShard { shard: Shard { folder, job: 77, number, pieces, access }, level: cut.level }
        };
        let shards = cut.runs.iter().enumerate().map(shard).collect();
        Job { folder, cut, shards }
    }

    fn head(&self) -> PathBuf {
        self.folder.path().join("head.goblin")
    }

    fn build(&self, import: &PointImport, number: usize) -> Result<()> {
        build_shard(import, (&self.head(), &self.shards[number]), &|| Ok(()), &())
    }

    fn merge(&self) -> Result<Vec<u8>> {
        let kept = Kept::default();
        let output = kept.output(&self.folder.path().join("merged.goblin"));
        merge_shards(&self.head(), &self.shards, self.cut.points, (output, 1 << 16), &())?;
        Ok(kept.bytes())
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
        let tile = ((place_of(row)[0].max(0) as usize * count) >> 20).min(count - 1);
        tiles[tile].extend_from_slice(row);
        if number % 50 == 0 {
            tiles[count / 2].extend_from_slice(row);
        }
    }
    tiles
}

#[test]
fn bytes_are_those_of_one_go() {
    let sets = [
        (clumped_places(12_000, 4), 4),
        (all_places(8000, 9), 5),
        (all_places(300, 2), 1),
        (vec![[7, 8, 9]; 70], 1),
        (vec![], 2),
    ];
    for dimension in [Dimension::Oct, Dimension::Quad] {
        for (places, count) in &sets {
            let tiles = tiles(&rows(places.iter().copied(), &layout()), *count);
            // Few shards in total, since each waits for the disk.
            for (leaf_size, memory, some) in
                [(20, 1, &[1, 7][..]), (700, 1 << 20, &[2, 64]), (50_000, 1 << 28, &[3])]
            {
                let import = || {
                    let source = Box::new(PartRows::new(dimension, tiles.clone()));
                    plan_points(source, &["a.las".into()], vec![], &options(leaf_size, memory)).unwrap()
                };
                let expected = whole(import());
                for shards in some.iter().copied() {
                    let job = Job::plan(&import(), shards);
                    let about =
                        format!("{dimension:?} {} {leaf_size} {shards} {}", places.len(), job.cut.level);
                    assert!(job.all(&import) == expected, "{about}");
                    let runs = job.cut.runs.iter().flatten().count();
                    assert!(
                        runs >= 1 && (runs > shards as usize / 2 || places.len() < 8000),
                        "{about} {runs}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_shard_reads_the_parts_that_it_has_to_do_with() {
    let tiles = tiles(&rows(all_places(20_000, 9), &layout()), 16);
    let source = Box::new(PartRows::new(Dimension::Quad, tiles));
    let import = plan_points(source, &["a.las".into()], vec![], &options(100, 1 << 20)).unwrap();
    let job = Job::plan(&import, 8);
    let read: Vec<usize> = job.shards.iter().map(|shard| parts_of(&import, shard).len()).collect();
    // One part has points all over space.
    assert!(
        read.iter().filter(|parts| **parts < 12).count() > 5 && read.iter().sum::<usize>() >= 16,
        "{read:?}"
    );
}

/// LAS files of several formats and grids, adjacent and overlapping, one of which is empty.
fn scans(folder: &Path) -> Vec<PathBuf> {
    let scan = |name: &str, format: u8, count: usize, (x, y): (i32, i32), scale: f64| {
        let mut rows = records(format, 0, count);
        let size = rows.len().checked_div(count).unwrap_or(0).max(1);
        for row in rows.chunks_exact_mut(size) {
            let place = place_of(row);
            for (axis, step) in [place[0] + x, place[1] + y, place[2] / 8].into_iter().enumerate() {
                row[4 * axis..4 * axis + 4].copy_from_slice(&step.to_le_bytes());
            }
        }
        let path = folder.join(name);
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
fn scans_become_the_tree_of_one_go() {
    let folder = tempfile::tempdir().unwrap();
    let paths = scans(folder.path());
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
    let tiles = tiles(&rows(clumped_places(points, 4), &layout()), 3);
    let source = Box::new(PartRows::new(Dimension::Oct, tiles));
    plan_points(source, &["a.las".into()], vec![], &options(leaf_size, 1 << 20)).unwrap()
}

#[test]
fn shards_that_are_missing_or_damaged_or_others_are_refused() {
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
        let mut damaged = first.clone();
        damaged[byte] ^= 4;
        fs::write(&run, damaged).unwrap();
        assert!(matches!(job.merge(), Err(Error::Corrupt { .. })), "{byte}");
    }
    fs::write(&run, &first).unwrap();
    for changed in [
        PointShard { shard: Shard { job: 78, ..shard.shard.clone() }, ..*shard },
        PointShard { level: shard.level - 1, ..shard.clone() },
        PointShard {
            shard: Shard { pieces: job.shards[(number + 1) % 3].shard.pieces.clone(), ..shard.shard.clone() },
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
        (Kept::default().output(Path::new("gap.goblin")), 0),
        &(),
    );
    assert!(gap.unwrap_err().to_string().contains("shards of"));
    let output = Kept::default().output(Path::new("few.goblin"));
    assert!(merge_shards(&job.head(), &job.shards, Some(1), (output, 0), &()).is_err());
    assert!(!is_point_file(&summary, &FileAccess::default()).unwrap());
    assert!(PointTree::open(&summary, &OpenOptions::default()).is_err());
    assert!(job.merge().unwrap() == expected);
}

#[test]
fn other_inputs_than_planned_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let paths = scans(folder.path());
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
        !errors.is_empty() && errors.iter().all(|error| error.to_string().contains("header says")),
        "{errors:?}"
    );
    let tree = fs::read_dir(job.folder.path()).unwrap().count();
    assert!(job.merge().is_err() && tree < 6);
}

#[test]
fn summaries_that_are_damaged_are_refused() {
    let import = || small(20, 300);
    let job = Job::plan(&import(), 2);
    let expected = job.all(&import);
    let summary = job.shards[1].shard.summary_path();
    let bytes = fs::read(&summary).unwrap();
    let mut random = random(3);
    // Every byte after the blocks, and many bytes of the blocks.
    for byte in (0..bytes.len()).filter(|byte| byte % 5 == 0 || byte + 2000 > bytes.len()) {
        let mut damaged = bytes.clone();
        damaged[byte] ^= 1 << (random() % 8);
        fs::write(&summary, &damaged).unwrap();
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
    let mut piece = summary.bytes_of(&summary.pieces[0]).unwrap();
    let mut bytes = Vec::new();
    while !piece.is_over() {
        bytes.extend(piece.take(1).unwrap());
    }
    (bytes, summary.run_bytes(), summary.pieces[0].totals)
}

/// Writes a summary with other bytes and valid checksums.
fn forge(shard: &Shard, bytes: &[u8], run_bytes: u64, totals: PointTotals) {
    let mut writer = SummaryWriter::new(shard).unwrap();
    writer.begin(shard.pieces[0]);
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
