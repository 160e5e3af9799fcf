//! Disks that fail at each write and each sync in turn: the error reports it, no temporary file
//! remains, and the old file is unchanged.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use spinney::edit::{Edit, FillRegion, Note, edit};
use spinney::export::{CogRequest, MeshFormat, MeshRequest, export_cog, export_mesh};
use spinney::raw::dataset::open;
use spinney::raw::export::image::{ImageSpec, create, format_of};
use spinney::raw::io::Faults;
use spinney::raw::store::autumnal::{CompactOptions, Keep, compact};
use spinney::tree::build_slabs;
use spinney::{
    Bounds, DataKind, Error, OpenOptions, Output, Result, Rule, SampleType, ValueType, WriteOptions, convert,
};

use crate::common::{Cells, OCT, QUAD, Random, options, value, write_cells};

/// Kind of failure of a write or sync.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Failure {
    Error(io::ErrorKind),
    /// Half of it arrives, and the next write fails.
    Short(io::ErrorKind),
    /// Each write transfers half of its bytes and reports success for those.
    Slow,
}

/// A disk that fails at one of its writes or syncs.
struct Failing {
    at: usize,
    failure: Failure,
    calls: AtomicUsize,
}

impl Failing {
    fn next(&self, length: usize) -> io::Result<usize> {
        let number = self.calls.fetch_add(1, Ordering::Relaxed);
        match self.failure {
            Failure::Error(kind) if number >= self.at => Err(kind.into()),
            Failure::Short(kind) if number > self.at => Err(kind.into()),
            Failure::Short(_) if number == self.at => Ok(length.div_ceil(2)),
            Failure::Slow => Ok(length.div_ceil(2)),
            _ => Ok(length),
        }
    }
}

impl Faults for Failing {
    fn write(&self, length: usize) -> io::Result<usize> {
        self.next(length)
    }

    fn sync(&self) -> io::Result<()> {
        self.next(1).map(drop)
    }
}

fn files(directory: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let entries = std::fs::read_dir(directory).unwrap();
    let mut files: Vec<_> = entries
        .map(|entry| entry.unwrap().path())
        .map(|path| (path.clone(), std::fs::read(path).unwrap()))
        .collect();
    files.sort();
    files
}

/// Writes a file once for every possible failure.
fn fails_well(name: &str, write: &dyn Fn(Output) -> Result<()>) {
    use io::ErrorKind::{Other, StorageFull};
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    // Autumnal files are not replaced.
    let keeps_old = !name.ends_with(".autumn");
    if keeps_old {
        std::fs::write(&path, "what was there").unwrap();
    }
    let before = files(directory.path());
    let try_with = |failure, at| {
        let disk = Arc::new(Failing { at, failure, calls: AtomicUsize::new(0) });
        let done = write(Output::create(&path).unwrap().with_faults(disk.clone()));
        (done, disk.calls.load(Ordering::Relaxed))
    };
    for failure in [Failure::Error(StorageFull), Failure::Error(Other), Failure::Short(StorageFull)] {
        let mut failures = 0;
        for at in 0.. {
            let (done, calls) = try_with(failure, at);
            let Err(error) = done else {
                // The failure was not reached, or only one more byte was due.
                assert!(calls <= at + 1, "{name}: {failure:?} at {at} of {calls} was no error");
                std::fs::remove_file(&path).unwrap();
                break;
            };
            failures += 1;
            let (Failure::Error(kind) | Failure::Short(kind)) = failure else { unreachable!() };
            match &error {
                Error::Io { path: reported_path, cause, .. } => {
                    assert_eq!((reported_path, cause.kind()), (&path, kind), "{name}: {error}");
                }
                other => panic!("{name}, {failure:?} at {at}: {other}"),
            }
            assert!(
                files(directory.path()) == before,
                "{name}, {failure:?} at {at}: {:?}",
                files(directory.path()).len()
            );
        }
        assert!(failures > 1, "{name}: {failures} writes and syncs");
        if keeps_old {
            std::fs::write(&path, "what was there").unwrap();
        }
    }
    // Short writes are not failures and do not change the result.
    try_with(Failure::Slow, 0).0.unwrap();
    let slow = std::fs::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    write(Output::create(&path).unwrap()).unwrap();
    assert!(std::fs::read(&path).unwrap() == slow, "{name}: short writes make other bytes");
}

const MEMORY: u64 = 1 << 20;

/// Returns a tree file of noise, large enough for a few writes.
fn noise(directory: &Path, name: &str) -> PathBuf {
    let path = directory.join(name);
    let cells = Cells::noise(QUAD, 1, [300, 250, 1], 200);
    write_cells(&path, &cells, &options(Rule::Mean, DataKind::Continuous, 9));
    path
}

#[test]
fn builds() {
    let cells = Cells::noise(QUAD, 1, [300, 250, 1], 200);
    for name in ["t.goblin", "t.autumn"] {
        fails_well(name, &|output| {
            let nodata = value(QUAD.value, 250);
            let options = options(Rule::Mean, DataKind::Continuous, 9);
            build_slabs(QUAD, &mut cells.slabs(nodata), Some(nodata), &options, output, &())
        });
    }
}

#[test]
fn conversions_and_compaction() {
    let directory = tempfile::tempdir().unwrap();
    let (goblin, autumn) = (noise(directory.path(), "a.goblin"), noise(directory.path(), "a.autumn"));
    let region = FillRegion::Box(Bounds { min: [1, 1, 0], max: [99, 77, 1] });
    edit(&autumn, [Ok(Edit::Fill(region, Some(vec![3.0.into()])))], Note::default(), MEMORY, &()).unwrap();
    fails_well("t.autumn", &|output| convert(&goblin, false, output, WriteOptions::new(MEMORY), &()));
    fails_well("t.goblin", &|output| convert(&autumn, false, output, WriteOptions::new(MEMORY), &()));
    fails_well("t.autumn", &|output| {
        compact(&autumn, &CompactOptions::new(&Keep::Last(2), MEMORY).share(true), output, &()).map(|_| ())
    });
}

#[test]
fn images() {
    for (name, sample) in [
        ("t.png", SampleType::U8),
        ("t.tif", SampleType::U8),
        ("t.exr", SampleType::F32),
        ("t.npy", SampleType::U8),
        ("t.raw", SampleType::U8),
    ] {
        let value = ValueType::new(sample, 1);
        let (width, height) = (600, 400);
        let spec =
            ImageSpec { width, height, value, alpha: false, void: false, metadata: Default::default() };
        let mut random = Random(1);
        // The bytes are valid numbers in every type.
        let bytes: Vec<u8> =
            (0..(width * height) as usize * value.size()).map(|_| random.next() as u8 & 0x3f).collect();
        fails_well(name, &|output| {
            let mut writer = create(output, format_of(name.as_ref()).unwrap(), &spec)?;
            bytes.chunks(width as usize * value.size()).try_for_each(|row| writer.write_rows(row, None))?;
            writer.finish()
        });
    }
}

#[test]
fn cloud_optimized_geotiff() {
    let directory = tempfile::tempdir().unwrap();
    let tree = open(&noise(directory.path(), "a.goblin"), &OpenOptions::new()).unwrap();
    let mut request = CogRequest::new();
    (request.tile_size, request.memory) = (64, 1 << 16);
    fails_well("t.tif", &|output| export_cog(&tree, &request, output, &()).map(|_| ()));
}

#[test]
fn meshes() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.goblin");
    let cells = Cells::random(OCT, 5, [30, 20, 25], 9, true);
    write_cells(&path, &cells, &options(Rule::Mean, DataKind::Continuous, 5));
    let tree = open(&path, &OpenOptions::new()).unwrap();
    for name in ["t.obj", "t.ply", "t.stl", "t.off"] {
        let format = MeshFormat::of(name.as_ref()).unwrap();
        fails_well(name, &|output| export_mesh(&tree, &MeshRequest::new(), output, format, &()).map(|_| ()));
    }
}
