//! Indexes and sources on hosts: a client in memory records what is requested.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex};

use spinney::import::raster::StackOptions;
use spinney::raw::io::{
    Fetch, FileStat, FileVersion, RangeCache, RangeFile, ReadBackend, RemoteFiles, RemoteWriter,
};
use spinney::{Bounds, Dataset, Error, FileAccess, OpenOptions, Result};

use crate::common::with;
use crate::compare::{Directory, assert_equal_trees, build, index, indexed, open, stack, tree, window};
use crate::tiffs::{Chunks, Tiff};

/// URLs that were requested, and the ranges; none for an opened file.
type Requests = Arc<Mutex<Vec<(String, Vec<Range<u64>>)>>>;

/// A host: files by URL, and the requests.
#[derive(Default)]
struct Host {
    files: BTreeMap<String, Arc<Vec<u8>>>,
    requests: Requests,
}

/// A file of a host.
struct HostFile {
    url: String,
    bytes: Arc<Vec<u8>>,
    requests: Requests,
}

impl Fetch for HostFile {
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        self.requests.lock().unwrap().push((self.url.clone(), ranges.to_vec()));
        let bytes =
            |range: &Range<u64>| self.bytes.get(range.start as usize..range.end as usize).map(<[u8]>::to_vec);
        let short = || Error::corrupt(&self.url, "length", "fewer bytes", "the requested ranges");
        ranges.iter().map(|range| bytes(range).ok_or_else(short)).collect()
    }
}

impl Host {
    fn opened(&self, url: &str, length: Option<u64>, access: &FileAccess) -> Result<Box<dyn ReadBackend>> {
        let Some(bytes) = self.files.get(url) else {
            let cause = std::io::Error::from(std::io::ErrorKind::NotFound);
            return Err(Error::io(Path::new(url), "open")(cause));
        };
        let file = HostFile { url: url.into(), bytes: bytes.clone(), requests: self.requests.clone() };
        let cache = (access.ranges().clone(), RangeCache::file_number());
        let length = length.unwrap_or(bytes.len() as u64);
        Ok(Box::new(RangeFile::new(Path::new(url), length, Box::new(file), cache, 1 << 10)))
    }
}

impl RemoteFiles for Host {
    fn open(&self, url: &str, _: &[(String, String)], access: &FileAccess) -> Result<Box<dyn ReadBackend>> {
        self.requests.lock().unwrap().push((url.into(), Vec::new()));
        self.opened(url, None, access)
    }

    fn open_known(&self, url: &str, known: &FileStat, access: &FileAccess) -> Result<Box<dyn ReadBackend>> {
        self.opened(url, Some(known.length), access)
    }

    fn stat(&self, urls: &[&str]) -> Result<Vec<Result<Option<FileStat>>>> {
        let stat = |bytes: &Arc<Vec<u8>>| FileStat {
            length: bytes.len() as u64,
            version: FileVersion::Tag("t".into()),
        };
        Ok(urls.iter().map(|url| Ok(self.files.get(*url).map(stat))).collect())
    }

    fn write(&self, url: &str, _: &FileAccess) -> Result<Box<dyn RemoteWriter>> {
        Err(Error::unsupported(url, "writing", "read"))
    }

    fn remove(&self, _: &[&str]) -> Result<()> {
        Ok(())
    }
}

const URL: &str = "https://host/maps/x.goblin";

/// Makes a file, its index and its tree.
fn files() -> Directory {
    let directory = Directory::new();
    let source = directory.path("a.tif");
    let mut tiff = Tiff { chunks: Chunks::Tiles(64, 64), ..Tiff::new([700, 600], 2) };
    for (at, sample) in tiff.pixels.iter_mut().enumerate() {
        *sample = ((at as u64 * 2_654_435_761) >> 20) % 9;
    }
    tiff.write(&source);
    index(std::slice::from_ref(&source), &directory.path("x.goblin"));
    tree(&[source], &directory.path("whole.goblin"));
    directory
}

/// Returns a host with the files, whose index has some bytes.
fn host(directory: &Directory, index: Vec<u8>) -> Host {
    let source = std::fs::read(directory.path("a.tif")).unwrap();
    let files = [(URL, index), ("https://host/maps/a.tif", source)];
    let files = files.map(|(url, bytes)| (url.to_string(), Arc::new(bytes)));
    Host { files: files.into(), ..Host::default() }
}

/// Opens the index of a host.
fn opened(host: Host) -> Result<Dataset> {
    let access = FileAccess::new().unpacked_cache(8 << 20).remote(Arc::new(host));
    spinney::open_with(URL, &OpenOptions::new().access(access))
}

#[test]
fn cells_come_from_the_sources_ranges() {
    let directory = files();
    let host = host(&directory, std::fs::read(directory.path("x.goblin")).unwrap());
    let requests = host.requests.clone();
    let found = opened(host).unwrap();
    let expected = open(&directory.path("whole.goblin"));
    let opening = std::mem::take(&mut *requests.lock().unwrap());
    assert!(opening.iter().all(|(url, _)| url == URL), "{opening:?}");
    // Coarse levels and statistics need no source; a window needs its tiles.
    found.statistics(None, &()).unwrap();
    for level in 0..=found.depth() - 2 {
        window(&found, level, &found.extent_at(level)).unwrap();
    }
    let coarse = std::mem::take(&mut *requests.lock().unwrap());
    assert!(coarse.iter().all(|(url, _)| url == URL), "{coarse:?}");
    let bounds = Bounds { min: [20, 30, 0], max: [60, 50, 1] };
    assert!(
        window(&found, found.depth(), &bounds).unwrap() == window(&expected, found.depth(), &bounds).unwrap()
    );
    let fetched = std::mem::take(&mut *requests.lock().unwrap());
    let of_source: Vec<_> = fetched.iter().filter(|(url, _)| url.ends_with("a.tif")).collect();
    let bytes: u64 =
        of_source.iter().flat_map(|(_, ranges)| ranges).map(|range| range.end - range.start).sum();
    let source = std::fs::metadata(directory.path("a.tif")).unwrap().len();
    // (A block of 16 tiles of 110.)
    assert!(of_source.len() == 1 && bytes > 0 && bytes < source / 4, "{fetched:?} of {source}");
    assert_equal_trees(&found, &expected, "remote");
}

/// Sources that others hide are not even fetched ahead.
#[test]
fn hidden_sources_are_not_fetched() {
    let directory = files();
    let [first, second] = ["a.tif", "b.tif"].map(|name| directory.path(name));
    std::fs::copy(&first, &second).unwrap();
    index(&[first, second], &directory.path("x.goblin"));
    let mut host = host(&directory, std::fs::read(directory.path("x.goblin")).unwrap());
    host.files.insert("https://host/maps/b.tif".into(), host.files["https://host/maps/a.tif"].clone());
    let requests = host.requests.clone();
    let found = opened(host).unwrap();
    assert_equal_trees(&found, &open(&directory.path("whole.goblin")), "hidden");
    let requests = requests.lock().unwrap();
    assert!(requests.iter().any(|(url, _)| url.ends_with("b.tif")));
    assert!(!requests.iter().any(|(url, _)| url.ends_with("a.tif")), "{requests:?}");
}

/// Many remote files, and a virtual raster of them under GDAL's names: a file is opened for its
/// header, and again for its cells.
#[test]
fn remote_mosaics() {
    let directory = Directory::new();
    let mut host = Host::default();
    let (mut local, mut remote, mut sources) = (Vec::new(), Vec::new(), String::new());
    for number in 0..40u64 {
        let at = [number % 8 * 100, number / 8 * 90];
        let path = directory.path(&format!("{number}.tif"));
        let origin = Some(at.map(|at| at as i64));
        Tiff { origin, ..Tiff::new([100, 90], 3) }.filled(number + 1).write(&path);
        let url = format!("https://host/maps/{number}.tif");
        host.files.insert(url.clone(), Arc::new(std::fs::read(&path).unwrap()));
        let [x, y] = at;
        write!(
            sources,
            "<SimpleSource><SourceFilename>/vsicurl/{url}</SourceFilename><SourceBand>1</SourceBand>\
             <DstRect xOff=\"{x}\" yOff=\"{y}\" xSize=\"100\" ySize=\"90\"/></SimpleSource>"
        )
        .unwrap();
        local.push(path);
        remote.push(url.into());
    }
    let whole = directory.path("whole.goblin");
    tree(&local, &whole);
    let list = directory.path("list.vrt");
    let band = format!("<VRTRasterBand dataType=\"Byte\" band=\"1\">{sources}</VRTRasterBand>");
    std::fs::write(&list, format!("<VRTDataset rasterXSize=\"800\" rasterYSize=\"450\">{band}</VRTDataset>"))
        .unwrap();
    let requests = host.requests.clone();
    let access = FileAccess::new().unpacked_cache(8 << 20).remote(Arc::new(host));
    let options = with(indexed(2), |it| it.access = access.clone());
    for inputs in [remote, vec![list]] {
        let made = directory.path("x.goblin");
        build(&inputs, &made, &options).unwrap();
        let opened = requests.lock().unwrap().iter().filter(|(_, ranges)| ranges.is_empty()).count();
        // (The header is opened to find the format, and to read it.)
        assert!(opened <= 4 * 40, "{opened}");
        requests.lock().unwrap().clear();
        let found = spinney::open_with(&made, &OpenOptions::new().access(access.clone())).unwrap();
        let all = Bounds::of_extent([800, 450, 1]);
        assert!(
            window(&found, found.depth(), &all).unwrap()
                == window(&open(&whole), found.depth(), &all).unwrap()
        );
        let sums = |tree: &Dataset| tree.statistics(None, &()).unwrap().classes;
        assert_eq!(sums(&found), sums(&open(&whole)));
        requests.lock().unwrap().clear();
    }
}

#[test]
fn changed_and_missing_sources_of_a_host() {
    let directory = files();
    let bytes = std::fs::read(directory.path("x.goblin")).unwrap();
    let source = "https://host/maps/a.tif".to_string();
    let original = std::fs::read(directory.path("a.tif")).unwrap();
    for (what, changed) in [
        ("other", Some(with(original.clone(), |it| it[10..].fill(1)))),
        ("short", Some(original[..100].to_vec())),
        ("none", None),
    ] {
        let mut host = host(&directory, bytes.clone());
        match changed {
            Some(changed) => host.files.insert(source.clone(), Arc::new(changed)),
            None => host.files.remove(&source),
        };
        let found = opened(host).unwrap();
        found.statistics(None, &()).unwrap();
        let error = window(&found, found.depth(), &found.extent_at(found.depth())).unwrap_err().to_string();
        assert!(error.contains("host/maps/a.tif"), "{what}: {error}");
    }
}

#[test]
fn a_remote_index_names_no_local_files() {
    let directory = files();
    let path = directory.path("x.goblin");
    let local = directory.name("a.tif");
    let relative = format!("../../../../../../../../..{local}");
    for name in
        [&local, &format!("file://{local}"), &format!("file:{local}"), &format!("FILE://{local}"), &relative]
    {
        let host = host(&directory, crate::malicious::renamed(&path, name));
        let requests = host.requests.clone();
        let found = opened(host).unwrap();
        let error = window(&found, found.depth(), &found.extent_at(found.depth())).unwrap_err();
        let is_typed = matches!(error, Error::Unsupported { .. } | Error::Io { .. });
        assert!(is_typed, "{name}: {error:?}");
        assert!(requests.lock().unwrap().iter().all(|(url, _)| url == URL), "{name}");
    }
    // Another host may be named; without remote files none is requested.
    let far = "https://other/a.tif";
    let mut host = host(&directory, crate::malicious::renamed(&path, far));
    host.files.insert(far.into(), host.files["https://host/maps/a.tif"].clone());
    let expected = open(&directory.path("whole.goblin"));
    let found = opened(host).unwrap();
    let all = found.extent_at(found.depth());
    assert!(window(&found, found.depth(), &all).unwrap() == window(&expected, found.depth(), &all).unwrap());
    let changed = directory.path("changed.goblin");
    std::fs::write(&changed, crate::malicious::renamed(&path, far)).unwrap();
    let access = FileAccess::new().unpacked_cache(8 << 20).remote(Arc::new(Host::default())).no_remote();
    let found = spinney::open_with(&changed, &OpenOptions::new().access(access)).unwrap();
    let error = window(&found, found.depth(), &all).unwrap_err().to_string();
    assert!(error.contains("--no-remote"), "{error}");
}

#[test]
fn a_file_is_opened_once_for_all_of_its_bands() {
    for is_planar in [false, true] {
        let directory = Directory::new();
        let tiff = Tiff { channels: 300, is_planar, ..Tiff::new([20, 10], 1) }.filled(1);
        let url = "https://host/maps/a.tif";
        let host = Host { files: [(url.into(), Arc::new(tiff.bytes()))].into(), ..Host::default() };
        let requests = host.requests.clone();
        let options = with(StackOptions::new(), |it| {
            it.import = indexed(2);
            it.import.access = FileAccess::new().remote(Arc::new(host));
        });
        let made = directory.path("x.goblin");
        stack(&[url.into()], &made, &options).unwrap();
        assert_eq!(open(&made).layers().unwrap().len(), 300);
        let requests = requests.lock().unwrap();
        let opened = requests.iter().filter(|(of, ranges)| of == url && ranges.is_empty()).count();
        assert!((1..10).contains(&opened), "opened {opened} times");
    }
}
