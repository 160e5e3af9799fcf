//! Settings of file access: each access is independent, and files inherit the access of the file
//! that names them.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use spinney::import::raster::{ImportOptions, plan};
use spinney::raw::io::{
    Fetch, FileStat, FileVersion, RangeCache, RangeFile, ReadBackend, RemoteFiles, RemoteWriter,
};
use spinney::raw::manifest::list_files;
use spinney::raw::shards::{Job, JobSpec, plan as plan_job};
use spinney::raw::store::goblin::Goblin;
use spinney::{DataKind, Dataset, Error, FileAccess, OpenOptions, Output, Result, Rule, WriteOptions};

use super::packed::packed;
use crate::common::{Cells, QUAD, goblin_bytes};

/// A host that serves files from memory, by URL.
#[derive(Default)]
struct Host(Arc<Mutex<BTreeMap<String, Arc<Vec<u8>>>>>);

/// One of its files.
struct HostFile(Arc<Vec<u8>>);

impl Fetch for HostFile {
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        Ok(ranges.iter().map(|range| self.0[range.start as usize..range.end as usize].to_vec()).collect())
    }
}

/// A file being uploaded.
struct Upload(Host, String, Vec<u8>);

impl Write for Upload {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.2.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl RemoteWriter for Upload {
    fn expect(&mut self, _: u64) {}

    fn commit(self: Box<Self>, _: bool) -> Result<()> {
        let Upload(host, url, bytes) = *self;
        host.put(&url, bytes);
        Ok(())
    }
}

impl Host {
    fn put(&self, url: &str, bytes: Vec<u8>) {
        self.0.lock().unwrap().insert(url.into(), Arc::new(bytes));
    }

    fn get(&self, url: &str) -> Option<Arc<Vec<u8>>> {
        self.0.lock().unwrap().get(url).cloned()
    }

    /// Returns an access with its own client for the same files.
    fn access(&self) -> FileAccess {
        FileAccess::new().remote(Arc::new(Host(self.0.clone())))
    }
}

impl RemoteFiles for Host {
    fn open(&self, url: &str, _: &[(String, String)], access: &FileAccess) -> Result<Box<dyn ReadBackend>> {
        let missing = || Error::io(url, "open")(io::ErrorKind::NotFound.into());
        let bytes = self.get(url).ok_or_else(missing)?;
        let (length, cache) = (bytes.len() as u64, (access.ranges().clone(), RangeCache::file_number()));
        Ok(Box::new(RangeFile::new(Path::new(url), length, Box::new(HostFile(bytes)), cache, 0)))
    }

    fn stat(&self, urls: &[&str]) -> Result<Vec<Result<Option<FileStat>>>> {
        let stat = |bytes: Arc<Vec<u8>>| {
            let (length, version) = (bytes.len() as u64, FileVersion::Tag(String::new()));
            FileStat { length, version }
        };
        Ok(urls.iter().map(|url| Ok(self.get(url).map(stat))).collect())
    }

    fn write(&self, url: &str, _: &FileAccess) -> Result<Box<dyn RemoteWriter>> {
        Ok(Box::new(Upload(Host(self.0.clone()), url.into(), Vec::new())))
    }

    fn remove(&self, urls: &[&str]) -> Result<()> {
        let mut files = self.0.lock().unwrap();
        urls.iter().for_each(|url| drop(files.remove(*url)));
        Ok(())
    }
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

fn open(path: &Path, access: &FileAccess) -> Result<Dataset> {
    spinney::open_with(path, &OpenOptions::new().access(access.clone()))
}

/// All cells.
fn cells(tree: &Dataset) -> Result<Vec<u8>> {
    let bounds = tree.header().extent_bounds();
    let mut values = vec![0; bounds.volume() as usize * tree.header().form.width()];
    tree.window(tree.depth(), &bounds, 0.0, &mut values, None).map(|_| values)
}

#[test]
fn accesses_in_one_process_have_settings_and_caches_of_their_own() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.goblin");
    let random = Cells::random(QUAD, 8, [2100, 1500, 1], 200, false);
    std::fs::write(&path, packed(&goblin_bytes(&random, Rule::Mean, DataKind::Continuous))).unwrap();
    let small = FileAccess::new().positioned(1 << 16).unpacked_cache(1 << 20);
    let large = FileAccess::new().unpacked_cache(64 << 20);
    let [first, second] = [&small, &large].map(|access| Goblin::open(&path, &access.into()).unwrap());
    assert!(first.access() == &small && second.access() == &large && small != large);
    let [first, second] = [first, second].map(|file| Dataset::of(file.into()).unwrap());
    assert!(cells(&first).unwrap() == cells(&second).unwrap());
    // A cache always holds its newest entry, here a segment of less than 512 KiB.
    assert!((1..=3 << 19).contains(&small.unpacked().held()), "{}", small.unpacked().held());
    assert!(large.unpacked().held() > 2 << 20, "{}", large.unpacked().held());
    // A changed clone is a different access and keeps all other settings.
    let other = small.clone().positioned(1 << 10);
    assert!(other != small && Arc::ptr_eq(other.unpacked(), small.unpacked()));
    assert!(small.is_positioned() && !large.is_positioned());
    // Closing a file drops its cache entries, in this access only.
    drop(first);
    assert!(small.unpacked().held() == 0 && large.unpacked().held() > 0);
    // Files that are opened without options share one pair of caches.
    assert_eq!(OpenOptions::new().access, FileAccess::default());
}

#[test]
fn members_of_a_manifest_are_opened_as_the_manifest_is() {
    let (directory, host) = (tempfile::tempdir().unwrap(), Host::default());
    let (local, url) = (fixture("v1/elevation.goblin"), "https://host/elevation.goblin");
    host.put(url, std::fs::read(&local).unwrap());
    let manifest = directory.path().join("all.manifest.json");
    let member = [PathBuf::from(url)];
    let refused = list_files(&manifest, false, &member, &[], &FileAccess::default(), &()).unwrap_err();
    assert!(matches!(refused, Error::Unsupported { .. }), "{refused}");
    let access = host.access();
    list_files(&manifest, false, &member, &[], &access, &()).unwrap();

    let expected = cells(&spinney::open(&local).unwrap()).unwrap();
    assert!(cells(&open(&manifest, &access).unwrap()).unwrap() == expected);
    let refused = spinney::open(&manifest).and_then(|tree| cells(&tree)).unwrap_err();
    assert!(matches!(refused, Error::Unsupported { .. }), "{refused}");
    // The same holds for files that an operation names.
    let view = open(&manifest, &access).unwrap().view(&[format!("like={url}").parse().unwrap()]).unwrap();
    assert!(cells(&view).unwrap() == expected);
    let like = spinney::open(&local).unwrap().view(&[format!("like={url}").parse().unwrap()]);
    assert!(matches!(like, Err(Error::Unsupported { .. })));

    // Requests are counted, and ranges are cached, per access.
    let before = access.traffic();
    assert!(before.requests > 0 && before.bytes > 0);
    let other = host.access().range_cache(1 << 14);
    assert_eq!((other.traffic().requests, other.ranges().held()), (0, 0));
    assert!(cells(&open(&manifest, &other).unwrap()).unwrap() == expected);
    assert!(other.traffic().requests > 0 && other.ranges().limit() == 1 << 14);
    assert_eq!(access.traffic(), before);
    assert_eq!(FileAccess::default().traffic().requests, 0);
}

#[test]
fn sources_and_sidecars_of_a_raster_are_opened_as_the_raster_is() {
    let (directory, host) = (tempfile::tempdir().unwrap(), Host::default());
    let url = "https://host/a.tif";
    host.put(url, std::fs::read(fixture("island_elevation.tif")).unwrap());
    let sidecar = "<PAMDataset><PAMRasterBand band=\"1\"><Description>relief</Description></PAMRasterBand></PAMDataset>";
    host.put(&format!("{url}.aux.xml"), sidecar.into());
    let mut options = ImportOptions::new();
    options.access = host.access();
    let build = |input: &Path, options: &ImportOptions| -> Result<Vec<u8>> {
        let path = directory.path().join("out.goblin");
        plan(&[input.to_path_buf()], options)?.build(Output::create(&path)?, &())?;
        cells(&spinney::open(&path)?)
    };
    let expected = build(&fixture("island_elevation.tif"), &ImportOptions::new()).unwrap();
    let [width, height, _] = spinney::open(directory.path().join("out.goblin")).unwrap().header().extent;
    let virtual_raster = |source: &str, name: &str| {
        let text = format!(
            "<VRTDataset rasterXSize=\"{width}\" rasterYSize=\"{height}\"><VRTRasterBand dataType=\"Float32\" band=\"1\">\
             <SimpleSource><SourceFilename relativeToVRT=\"0\">{source}</SourceFilename><SourceBand>1</SourceBand>\
             </SimpleSource></VRTRasterBand></VRTDataset>"
        );
        let path = directory.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let local = virtual_raster(fixture("island_elevation.tif").to_str().unwrap(), "local.vrt");
    let remote = virtual_raster(url, "remote.vrt");
    // A virtual raster has no nodata value unless it declares one.
    let of_sources = build(&local, &ImportOptions::new()).unwrap();
    for (input, expected) in [(Path::new(url), expected), (&remote, of_sources)] {
        assert!(build(input, &options).unwrap() == expected, "{}", input.display());
        let refused = build(input, &ImportOptions::new()).unwrap_err();
        assert!(matches!(refused, Error::Unsupported { .. }), "{refused}");
    }
    let import = plan(&[url.into()], &options).unwrap();
    assert_eq!(import.info().band_names, ["relief"]);
    assert!(options.access.traffic().requests > 0);
}

#[test]
fn outputs_and_jobs_go_where_their_access_leads() {
    let (directory, host) = (tempfile::tempdir().unwrap(), Host::default());
    let (access, how) = (host.access(), WriteOptions::new(64 << 20));
    let local = fixture("v1/classes.goblin");
    let expected = cells(&spinney::open(&local).unwrap()).unwrap();
    // Files that an operation reads are opened with the access of its output.
    let url = Path::new("https://host/copy.goblin");
    assert!(matches!(Output::create(url), Err(Error::Unsupported { .. })));
    spinney::convert(&local, false, access.create(url).unwrap(), how, &()).unwrap();
    assert!(cells(&open(url, &access).unwrap()).unwrap() == expected);
    let copy = directory.path().join("copy.goblin");
    spinney::convert(url, false, access.create(&copy).unwrap(), how, &()).unwrap();
    assert!(cells(&spinney::open(&copy).unwrap()).unwrap() == expected);
    let refused = spinney::convert(url, false, Output::create(&copy).unwrap(), how, &()).unwrap_err();
    assert!(matches!(refused, Error::Unsupported { .. }), "{refused}");

    // A job uses one access for its files and its inputs, also if its plan was reloaded.
    let input = "https://host/a.tif";
    host.put(input, std::fs::read(fixture("island_classes.tif")).unwrap());
    let (spec, job) = (
        JobSpec::Rasters { inputs: vec![input.into()], options: ImportOptions::new() },
        Path::new("https://host/job"),
    );
    plan_job(&spec, job, Some(2), &access, &()).unwrap();
    assert!(matches!(Job::open(job), Err(Error::Unsupported { .. })));
    let opened = || Job::open_with(job, &access).unwrap();
    for number in 0..2 {
        opened().build(number, 64 << 20, &()).unwrap();
    }
    let merged = directory.path().join("merged.goblin");
    opened().merge(Output::create(&merged).unwrap().into(), 64 << 20, &()).unwrap();
    let whole = directory.path().join("whole.goblin");
    let mut options = ImportOptions::new();
    options.access = access.clone();
    plan(&[input.into()], &options).unwrap().build(Output::create(&whole).unwrap(), &()).unwrap();
    assert!(std::fs::read(merged).unwrap() == std::fs::read(whole).unwrap());
    opened().remove().unwrap();
    assert!(host.get("https://host/job/plan.json").is_none());
}
