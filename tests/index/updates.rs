//! Updates of indexes: the bytes are those of a new index, and only changed files are read.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use spinney::raw::import::raster::UpdateReport;
use spinney::{Error, Output, Progress};

use crate::common::command::{command, complaint, spinney, stderr};
use crate::common::{Random, with};
use crate::compare::{Directory, MEMORY, assert_equal, index, open, segments, tree, update};
use crate::targets::seal;
use crate::tiffs::{Chunks, Samples, Tiff};

/// Sources in a directory `sources`, and an index of them, `x.goblin`.
struct Sources {
    directory: Directory,
    paths: Vec<PathBuf>,
    /// Seconds of the next modification time.
    time: u64,
}

impl Sources {
    fn new(count: usize) -> Sources {
        let directory = Directory::new();
        fs::create_dir(directory.path("sources")).unwrap();
        let mut sources = Sources { directory, paths: Vec::new(), time: 0 };
        (0..count).for_each(|number| sources.add(number));
        index(&sources.paths, &sources.index());
        sources
    }

    fn index(&self) -> PathBuf {
        self.directory.path("x.goblin")
    }

    /// Returns a file with its own position, by number.
    fn tiff(number: usize, seed: u64) -> Tiff {
        let origin = Some([(number % 3 * 200) as i64, (number / 3 * 190) as i64]);
        Tiff { origin, nodata: Some("0"), ..Tiff::new([300, 280], seed) }
    }

    fn add(&mut self, number: usize) {
        self.paths.push(self.directory.path(&format!("sources/{number}.tif")));
        self.write(self.paths.len() - 1, &Sources::tiff(number, number as u64));
    }

    /// Writes a file, with a modification time that no file had before.
    fn write(&mut self, number: usize, tiff: &Tiff) {
        tiff.write(&self.paths[number]);
        self.time += 1;
        let file = fs::File::options().append(true).open(&self.paths[number]).unwrap();
        file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(1_700_000_000 + self.time)).unwrap();
    }

    /// Checks that the index has the bytes of a new one, and the cells of the files.
    fn assert_fresh(&self, what: &str) {
        let [fresh, whole] = ["fresh.goblin", "whole.goblin"].map(|name| self.directory.path(name));
        index(&self.paths, &fresh);
        assert_same_bytes(&self.index(), &fresh, what);
        assert!(fs::read(self.index()).unwrap() == fs::read(&fresh).unwrap(), "{what}");
        tree(&self.paths, &whole);
        assert_equal(&self.index(), &whole, what);
    }

    fn update(&self) -> spinney::Result<[usize; 4]> {
        update(&self.index(), &self.index(), |_| {}).map(counts)
    }

    /// Updates the index to the present files.
    fn update_files(&self) -> spinney::Result<[usize; 4]> {
        update(&self.index(), &self.index(), |it| it.sources = Some(self.paths.clone())).map(counts)
    }
}

/// Checks that an updated index has the bytes of a new one. (The provenance may name other paths to
/// the same files.)
fn assert_same_bytes(updated: &Path, fresh: &Path, what: &str) {
    let contents = |path: &Path| {
        let bytes = fs::read(path).unwrap();
        let section = |tag| {
            let (_, start, length) = seal::section(&bytes, tag).unwrap();
            bytes[start..start + length].to_vec()
        };
        let sections = [section(b"SRCS"), section(b"SRCP")];
        (segments(path), sections, open(path).metadata().clone())
    };
    let ((segments, sections, mut metadata), fresh) = (contents(updated), contents(fresh));
    metadata.provenance = fresh.2.provenance.clone();
    assert!(segments == fresh.0, "{what}: other segments");
    assert!(sections == fresh.1, "{what}: other sources");
    assert_eq!(metadata, fresh.2, "{what}");
}

fn counts(report: UpdateReport) -> [usize; 4] {
    [report.unchanged, report.changed, report.added, report.removed]
}

#[test]
fn changed_files_are_read_again() {
    let mut sources = Sources::new(4);
    assert_eq!(sources.update().unwrap(), [4, 0, 0, 0]);
    sources.assert_fresh("nothing");
    let mut random = Random(3);
    for round in 0..6 {
        let number = random.below(4) as usize;
        let mut tiff = Sources::tiff(number, number as u64);
        // One tile, all tiles, and other chunks.
        match round % 3 {
            0 => tiff.fill([48, 96], [20, 30], 5),
            1 => tiff = Sources::tiff(number, 50 + round),
            _ => tiff.chunks = Chunks::Strips(11),
        }
        sources.write(number, &tiff);
        assert_eq!(sources.update().unwrap(), [3, 1, 0, 0], "round {round}");
        sources.assert_fresh(&format!("round {round}"));
    }
}

#[test]
fn unchanged_files_are_not_read() {
    let mut sources = Sources::new(3);
    let tiff = with(Sources::tiff(1, 9), |it| it.fill([0, 0], [300, 280], 4));
    sources.write(1, &tiff);
    // Files of the same length and time whose cells do not overlap the changed file.
    let mut alone = Sources::new(2);
    let bytes = fs::read(&alone.paths[0]).unwrap();
    let time = fs::metadata(&alone.paths[0]).unwrap().modified().unwrap();
    let far = Tiff { origin: Some([512, 512]), ..Tiff::new([100, 100], 1) };
    alone.paths[1] = alone.directory.path("sources/far.tif");
    alone.write(1, &far);
    index(&alone.paths, &alone.index());
    fs::write(&alone.paths[0], vec![0; bytes.len()]).unwrap();
    fs::File::options().append(true).open(&alone.paths[0]).unwrap().set_modified(time).unwrap();
    alone.write(1, &with(far, |it| it.fill([3, 3], [9, 9], 8)));
    assert_eq!(alone.update().unwrap(), [1, 1, 0, 0]);
    fs::write(&alone.paths[0], bytes).unwrap();
    fs::File::options().append(true).open(&alone.paths[0]).unwrap().set_modified(time).unwrap();
    alone.assert_fresh("zeros in between");
    assert_eq!(sources.update().unwrap(), [2, 1, 0, 0]);
    sources.assert_fresh("neighbours");
}

#[test]
fn files_are_added_and_removed() {
    let mut sources = Sources::new(2);
    sources.add(5);
    assert_eq!(sources.update_files().unwrap(), [2, 0, 1, 0]);
    sources.assert_fresh("added");
    let removed = sources.paths.remove(1);
    assert_eq!(sources.update_files().unwrap(), [2, 0, 0, 1]);
    sources.assert_fresh("removed");
    fs::remove_file(removed).unwrap();
    sources.add(4);
    sources.paths.remove(0);
    // (The first file defined the index's corner.)
    match sources.update_files() {
        Ok(found) => {
            assert_eq!(found, [1, 0, 1, 1]);
            let whole = sources.directory.path("whole.goblin");
            tree(&sources.paths, &whole);
        }
        Err(error) => assert!(error.to_string().contains("spinney index"), "{error}"),
    }
}

#[test]
fn the_order_of_files_is_that_of_the_update() {
    // (The files overlap.)
    let mut sources = Sources::new(3);
    sources.paths.reverse();
    sources.update_files().unwrap();
    sources.assert_fresh("reversed");
    sources.add(4);
    let added = sources.paths.pop().unwrap();
    sources.paths.insert(0, added);
    sources.update_files().unwrap();
    sources.assert_fresh("below");
}

#[test]
fn directories_move() {
    let sources = Sources::new(2);
    let directory = &sources.directory;
    // Index and sources together.
    fs::create_dir(directory.path("moved")).unwrap();
    for name in ["sources", "x.goblin"] {
        fs::rename(directory.path(name), directory.path(&format!("moved/{name}"))).unwrap();
    }
    let moved: Vec<PathBuf> =
        (0..2).map(|number| directory.path(&format!("moved/sources/{number}.tif"))).collect();
    let [index, whole] = ["moved/x.goblin", "whole.goblin"].map(|name| directory.path(name));
    tree(&moved, &whole);
    assert_equal(&index, &whole, "moved");
    assert_eq!(update(&index, &index, |_| {}).map(counts).unwrap(), [2, 0, 0, 0]);
    assert_equal(&index, &whole, "moved and updated");
    // The sources alone.
    fs::rename(directory.path("moved/sources"), directory.path("other")).unwrap();
    let error = update(&index, &index, |_| {}).unwrap_err().to_string();
    assert!(error.contains("0.tif") && error.contains("--update"), "{error}");
    let name = index.to_str().unwrap();
    spinney(&["-q", "index", "--update", name, "--source-prefix", "sources=../other"]).success();
    assert_equal(&index, &whole, "other prefix");
    let old = with(sources, |it| {
        it.paths = (0..2).map(|number| it.directory.path(&format!("other/{number}.tif"))).collect();
    });
    let fresh = old.directory.path("moved/fresh.goblin");
    crate::compare::index(&old.paths, &fresh);
    assert_same_bytes(&index, &fresh, "another prefix");
}

#[test]
fn refused_updates_leave_the_index() {
    let mut sources = Sources::new(3);
    let before = fs::read(sources.index()).unwrap();
    let unchanged = |sources: &Sources, error: Error, about: &str| {
        let text = error.to_string();
        assert!(text.contains(about) && text.contains("spinney index"), "{text}");
        assert!(fs::read(sources.index()).unwrap() == before, "{about}");
        let left: Vec<_> = fs::read_dir(sources.directory.path(".")).unwrap().collect();
        assert_eq!(left.len(), 2, "{about}: {left:?}");
    };
    let original = Sources::tiff(1, 1);
    for (about, changed) in [
        ("georeference", Tiff { origin: Some([201, 0]), ..original.clone() }),
        ("size", Tiff { origin: original.origin, ..Tiff::new([290, 280], 1) }),
        ("type", Tiff { samples: Samples::Int(16), ..original.clone() }.filled(1)),
    ] {
        sources.write(1, &changed);
        unchanged(&sources, sources.update().unwrap_err(), about);
    }
    sources.write(1, &Tiff { channels: 3, ..original.clone() }.filled(1));
    match sources.update() {
        // (The first channel of several is that of a new index with this band.)
        Ok(_) => fs::write(sources.index(), &before).unwrap(),
        Err(error) => unchanged(&sources, error, "1.tif"),
    }
    sources.write(1, &original);
    fs::rename(&sources.paths[2], sources.directory.path("2.tif")).unwrap();
    let error = sources.update().unwrap_err();
    fs::rename(sources.directory.path("2.tif"), &sources.paths[2]).unwrap();
    unchanged(&sources, error, "2.tif");
    // A corrupt file, and one that does not fit.
    let mut bytes = original.bytes();
    bytes[8..200].fill(0);
    fs::write(&sources.paths[1], bytes).unwrap();
    let error = sources.update().unwrap_err();
    assert!(matches!(error, Error::Corrupt { .. }) && error.to_string().contains("1.tif"), "{error}");
    assert!(fs::read(sources.index()).unwrap() == before);
    sources.write(1, &original);
    sources.add(4);
    sources.write(3, &Tiff { origin: None, ..Sources::tiff(4, 1) });
    assert!(sources.update_files().is_err());
    sources.write(3, &Tiff { origin: Some([-300, 0]), ..Sources::tiff(4, 1) });
    let error = sources.update_files().unwrap_err();
    assert!(error.to_string().contains("north or west"), "{error}");
    assert!(fs::read(sources.index()).unwrap() == before);
    let name = sources.directory.name("whole.goblin");
    tree(&sources.paths[..1], Path::new(&name));
    let message = complaint(&["index", "--update", &name], 1);
    assert!(message.contains("not an index"), "{message}");
}

/// Cancels after some checks.
struct Cancelled(std::sync::atomic::AtomicI64);

impl Progress for Cancelled {
    fn interrupted(&self) -> bool {
        self.0.fetch_sub(1, std::sync::atomic::Ordering::Relaxed) <= 0
    }
}

#[test]
fn cancelled_updates_leave_the_index() {
    let mut sources = Sources::new(3);
    let before = fs::read(sources.index()).unwrap();
    sources.write(0, &Sources::tiff(0, 8));
    let mut cancelled = 0;
    for checks in 0..200 {
        let progress = Cancelled(checks.into());
        let change = with(spinney::raw::import::raster::IndexUpdate::default(), |it| it.memory = 64 << 20);
        let output = Output::create(&sources.index()).unwrap();
        match spinney::raw::import::raster::update_index(&sources.index(), &change, output, &progress) {
            Err(Error::Interrupted) => {
                assert!(fs::read(sources.index()).unwrap() == before);
                let left: Vec<_> = fs::read_dir(sources.directory.path(".")).unwrap().collect();
                assert_eq!(left.len(), 2, "{left:?}");
                cancelled += 1;
            }
            done => {
                done.unwrap();
                break;
            }
        }
    }
    assert!(cancelled > 3, "{cancelled}");
    sources.assert_fresh("after cancellations");
}

#[test]
fn updates_of_other_options() {
    let directory = Directory::new();
    let name = |name: &str| directory.name(name);
    let (a, made, fresh) = (name("a.tif"), name("x.goblin"), name("fresh.goblin"));
    let tiff = Tiff { channels: 3, is_planar: true, nodata: Some("1"), ..Tiff::new([290, 300], 1) }.filled(2);
    for options in [
        &["--band", "2"][..],
        &["--stored-level", "1", "--kind", "continuous"],
        &["--nodata", "4"],
        &["--stack"],
    ] {
        tiff.write(Path::new(&a));
        spinney(&[&["-q", "index", &a, "-o", &made], options].concat()).success();
        let mut changed = tiff.clone();
        changed.fill([100, 100], [30, 30], 6);
        fs::write(&a, [changed.bytes(), vec![0]].concat()).unwrap();
        let text = stderr(spinney(&["index", "--update", &made]).success());
        assert!(text.contains("1 changed"), "{text}");
        spinney(&[&["-q", "index", &a, "-o", &fresh], options].concat()).success();
        assert!(fs::read(&made).unwrap() == fs::read(&fresh).unwrap(), "{options:?}");
        open(Path::new(&made));
    }
}

#[test]
fn nodata_numbers_differ() {
    let tiff = |number, nodata| Tiff { nodata, ..Sources::tiff(number, 7 + number as u64) };
    for numbers in
        [[None, Some("0"), Some("5")], [Some("0"), Some("5"), None], [Some("2"), Some("3"), Some("2")]]
    {
        let mut sources = Sources::new(2);
        (0..2).for_each(|number| sources.write(number, &tiff(number, numbers[number])));
        index(&sources.paths, &sources.index());
        sources.add(3);
        sources.write(2, &tiff(3, numbers[2]));
        assert_eq!(sources.update_files().unwrap(), [2, 0, 1, 0]);
        sources.assert_fresh(&format!("{numbers:?}"));
    }
    // A file that gets a number among others without one.
    let mut sources = Sources::new(2);
    (0..2).for_each(|number| sources.write(number, &tiff(number, None)));
    index(&sources.paths, &sources.index());
    sources.write(1, &tiff(1, Some("0")));
    assert_eq!(sources.update().unwrap(), [1, 1, 0, 0]);
    sources.assert_fresh("a new number");
    // A single file leaves nodata to the layer; one of several does not.
    let mut sources = Sources::new(1);
    sources.write(0, &tiff(0, None));
    index(&sources.paths, &sources.index());
    sources.add(1);
    assert_eq!(sources.update_files().unwrap(), [1, 0, 1, 0]);
    sources.assert_fresh("one without a number");
    sources.paths.pop();
    assert_eq!(sources.update_files().unwrap(), [1, 0, 0, 1]);
    let fresh = sources.directory.path("fresh.goblin");
    index(&sources.paths, &fresh);
    assert_eq!(open(&sources.index()).metadata().provenance, open(&fresh).metadata().provenance);
}

#[test]
fn options_of_the_index_count_for_added_files() {
    let directory = Directory::new();
    let names = ["a.tif", "b.tif", "c.tif"].map(|name| directory.name(name));
    let (made, fresh) = (directory.name("x.goblin"), directory.name("fresh.goblin"));
    let tiff = |column, nodata| Tiff {
        nodata,
        origin: Some([column, 0]),
        ..Tiff::new([290, 300], 1 + column as u64)
    };
    for options in
        [&["--nodata", "3"][..], &["--crs", "EPSG:32633"], &["--kind", "categorical"], &["--band", "1"]]
    {
        let numbers = if options[0] == "--nodata" { [None, Some("1"), Some("7")] } else { [Some("7"); 3] };
        for (number, name) in names.iter().enumerate() {
            tiff(number as i64 * 200, numbers[number]).write(Path::new(name));
        }
        spinney(&[&["-q", "index", &names[0], &names[1], "-o", &made], options].concat()).success();
        fs::write(&names[1], [fs::read(&names[1]).unwrap(), vec![0]].concat()).unwrap();
        let all = [&names[0], &names[1], &names[2]].map(String::as_str);
        let text = stderr(spinney(&[&["index", "--update", &made], &all[..]].concat()).success());
        assert!(text.contains("1 changed, 1 added"), "{text}");
        spinney(&[&["-q", "index", "-o", &fresh], &all[..], options].concat()).success();
        assert!(fs::read(&made).unwrap() == fs::read(&fresh).unwrap(), "{options:?}");
    }
}

#[test]
fn the_first_file_describes_the_layer() {
    let mut sources = Sources::new(2);
    let describe = |sources: &Sources, number: usize| {
        let name = sources.directory.path(&format!("sources/{number}.tif.aux.xml"));
        let text = format!(
            "<PAMDataset><Metadata><MDI key=\"about\">{number}</MDI></Metadata>\
             <PAMRasterBand band=\"1\"><Description>band {number}</Description></PAMRasterBand></PAMDataset>"
        );
        fs::write(name, text).unwrap();
    };
    (0..2).for_each(|number| describe(&sources, number));
    sources.write(1, &Sources::tiff(1, 5));
    sources.update().unwrap();
    assert!(open(&sources.index()).metadata().tags.is_empty());
    sources.write(0, &Sources::tiff(0, 5));
    sources.update().unwrap();
    sources.assert_fresh("changed");
    sources.paths.reverse();
    assert_eq!(sources.update_files().unwrap(), [2, 0, 0, 0]);
    sources.assert_fresh("reversed");
    assert_eq!(open(&sources.index()).metadata().tags["about"], "1");
}

#[test]
fn a_file_that_is_listed_twice_counts_once() {
    let mut sources = Sources::new(2);
    sources.add(4);
    let paths = sources.paths.clone();
    let twice = [&paths[..], &paths[2..]].concat();
    let report = update(&sources.index(), &sources.index(), |it| it.sources = Some(twice)).unwrap();
    assert_eq!(counts(report), [2, 0, 1, 0]);
    sources.assert_fresh("twice");
}

#[test]
fn removals_keep_the_first_cell_and_the_levels() {
    let mut sources = Sources::new(3);
    sources.paths.pop();
    sources.update_files().unwrap();
    let [fresh, found] = {
        let fresh = sources.directory.path("fresh.goblin");
        index(&sources.paths, &fresh);
        [open(&fresh), open(&sources.index())]
    };
    assert_eq!(found.header().extent, fresh.header().extent);
    assert!(found.depth() >= fresh.depth());
    let extent = found.header().extent;
    sources.paths.remove(0);
    sources.update_files().unwrap();
    let found = open(&sources.index());
    assert_eq!(found.header().extent, extent);
    assert_eq!(found.verify(1 << 20, &()).unwrap(), []);
}

#[test]
fn provenance_names_the_listed_files() {
    let directory = Directory::new();
    fs::create_dir(directory.path("out")).unwrap();
    fs::create_dir(directory.path("tiles")).unwrap();
    for number in 0..3 {
        Sources::tiff(0, number).write(&directory.path(&format!("tiles/{number}.tif")));
    }
    let run = |arguments: &[&str]| {
        command(&[&["-q", "index"], arguments].concat()).current_dir(directory.path(".")).assert().success();
    };
    run(&["tiles/0.tif", "tiles/1.tif", "-o", "out/x.goblin"]);
    for files in [&["tiles/1.tif"][..], &["tiles/2.tif", "tiles/1.tif"], &["tiles/1.tif", "tiles/0.tif"]] {
        run(&[&["--update", "out/x.goblin"], files].concat());
        run(&[files, &["-o", "out/fresh.goblin"]].concat());
        let [found, fresh] = ["out/x.goblin", "out/fresh.goblin"].map(|name| directory.path(name));
        assert!(fs::read(&found).unwrap() == fs::read(&fresh).unwrap(), "{files:?}");
        assert_eq!(open(&found).metadata().provenance.len(), files.len());
    }
}

#[test]
fn virtual_rasters_keep_their_size() {
    let directory = Directory::new();
    let [raster, made, fresh, source] =
        ["v.vrt", "x.goblin", "fresh.goblin", "a.tif"].map(|name| directory.path(name));
    let text = "<VRTDataset rasterXSize=\"400\" rasterYSize=\"300\"><VRTRasterBand dataType=\"Byte\" band=\"1\">\
                <SimpleSource><SourceFilename relativeToVRT=\"1\">a.tif</SourceFilename><SourceBand>1</SourceBand>\
                <SrcRect xOff=\"3\" yOff=\"4\" xSize=\"50\" ySize=\"40\"/>\
                <DstRect xOff=\"20\" yOff=\"30\" xSize=\"50\" ySize=\"40\"/></SimpleSource></VRTRasterBand></VRTDataset>";
    fs::write(&raster, text).unwrap();
    Tiff::new([90, 80], 1).write(&source);
    index(std::slice::from_ref(&raster), &made);
    fs::write(&source, [Tiff::new([90, 80], 2).bytes(), vec![0]].concat()).unwrap();
    assert_eq!(update(&made, &made, |_| {}).map(counts).unwrap(), [0, 1, 0, 0]);
    index(std::slice::from_ref(&raster), &fresh);
    assert!(fs::read(&made).unwrap() == fs::read(&fresh).unwrap());

    // A virtual raster that arranges other files is noticed; without it, the index still works.
    fs::write(&raster, text.replace("xSize=\"50\"", "xSize=\"49\"")).unwrap();
    let error = update(&made, &made, |_| {}).unwrap_err().to_string();
    assert!(error.contains("v.vrt: a virtual raster that was changed"), "{error}");
    let findings = open(&made).verify_quickly(MEMORY, &()).unwrap();
    assert!(findings.len() == 1 && findings[0].place.contains("v.vrt"), "{findings:?}");
    fs::remove_file(&raster).unwrap();
    assert_eq!(update(&made, &made, |_| {}).map(counts).unwrap(), [1, 0, 0, 0]);
    assert!(fs::read(&made).unwrap() == fs::read(&fresh).unwrap());
}

#[cfg(unix)]
#[test]
fn more_files_than_a_process_may_open() {
    let directory = Directory::new();
    let mut names = Vec::new();
    for number in 0..300 {
        let origin = Some([number % 20 * 8, number / 20 * 8]);
        names.push(directory.name(&format!("{number}.tif")));
        Tiff { origin, ..Tiff::new([8, 8], number as u64) }.write(Path::new(&names[number as usize]));
    }
    let made = directory.name("x.goblin");
    spinney(&["-q", "index", &names[0], "-o", &made]).success();
    fs::write(&names[0], [fs::read(&names[0]).unwrap(), vec![0]].concat()).unwrap();
    // (Readers of an index keep up to 128 of its sources open.)
    let status = std::process::Command::new("sh")
        .args(["-c", "ulimit -n 192; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_spinney")])
        .args(["-q", "index", "--update", &made])
        .args(&names)
        .status()
        .unwrap();
    assert!(status.success());
    let fresh = directory.path("fresh.goblin");
    index(&names.iter().map(PathBuf::from).collect::<Vec<_>>(), &fresh);
    assert_same_bytes(Path::new(&made), &fresh, "many files");
}
