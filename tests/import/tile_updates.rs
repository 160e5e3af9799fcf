//! Updates of exported tiles: killed at every file operation, concurrent, after the percentiles of
//! values have changed, and the number of tiles drawn.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use spinney::edit::{CellValue, Edit, FillRegion, Note, edit};
use spinney::export::{TileRequest, export_tiles};
use spinney::raw::dataset::open;
use spinney::raw::export::tiles::{
    GeographicExtent, Pmtiles, TileArchiveSummary, TileContent, TileId, TilePainter, TileRange, TileSamples,
    TileSource, TileTarget, TileUpdate, TreeTiles, UpdateOptions, verify_tiles,
};
use spinney::raw::space::web_mercator;
use spinney::style::Style;
use spinney::{
    Bounds, Code, DataKind, Dataset, Error, Metadata, Output, Progress, Result, Rule, SampleType, TreeType,
    ValueType, WriteOptions, convert,
};

use crate::common::{Cells, QUAD, options, value, with, write_cells};

/// A directory with a tree and its tiles: `w.autumn`, a world of 1024 cells per side, of which the
/// south-east is empty.
struct TestDirectory(tempfile::TempDir);

impl TestDirectory {
    fn new(form: TreeType, kind: DataKind) -> TestDirectory {
        let temp = TestDirectory(tempfile::tempdir().unwrap());
        let side = 1024u64;
        let mut cells = Cells::random(form, 5, [side, side, 1], 7, false);
        for (at, cell) in cells.cells.iter_mut().enumerate() {
            let (x, y) = (at as u64 % side, at as u64 / side);
            let is_empty = x >= side / 2 && y >= side / 2;
            *cell = (!is_empty).then(|| value(form.value, (x % 41 + y % 5 + x / 256 + y / 256) % 200));
        }
        let rule = if kind == DataKind::Categorical { Rule::Majority } else { Rule::Mean };
        let metadata = Metadata { frame: web_mercator(10), ..Metadata::default() };
        let goblin = temp.path("w.goblin");
        write_cells(&goblin, &cells, &options(rule, kind, 10).metadata(metadata));
        convert(&goblin, false, Output::create(&temp.tree()).unwrap(), WriteOptions::new(64 << 20), &())
            .unwrap();
        std::fs::remove_file(goblin).unwrap();
        temp
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn tree(&self) -> PathBuf {
        self.path("w.autumn")
    }

    fn map(&self) -> Dataset {
        open(&self.tree(), &Default::default()).unwrap()
    }

    /// Returns a tile directory, or an archive.
    fn target(&self, name: &str) -> TileTarget {
        let name = if name.contains('.') { self.path(name) } else { self.path(name).join("{z}/{x}/{y}.png") };
        TileTarget::of(&name).unwrap().unwrap()
    }

    fn fill(&self, [x, y]: [u64; 2], [width, height]: [u64; 2], number: Option<f64>) {
        let bounds = Bounds { min: [x, y, 0], max: [x + width, y + height, 1] };
        self.edit(Edit::Fill(FillRegion::Box(bounds), number.map(|number| vec![number.into()])));
    }

    fn edit(&self, one: Edit) {
        let note = Note { time: Some(1), author: "test".into(), message: "t".into() };
        edit(&self.tree(), [Ok(one)], note, 64 << 20, &()).unwrap();
    }

    /// Removes a tile, adds one, and changes one.
    fn change(&self) {
        self.fill([256, 0], [256, 256], None);
        self.fill([800, 800], [3, 3], Some(5.0));
        self.fill([10, 20], [70, 30], Some(9.0));
    }

    /// Reverts that.
    fn take_back(&self) {
        let mut cells = Vec::new();
        for (min, size) in [([256, 0], [256, 256]), ([10, 20], [70, 30])] {
            for (x, y) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (min[0] + x, min[1] + y))) {
                let number = (x % 41 + y % 5 + x / 256 + y / 256) % 200;
                cells.push(([x, y, 0], Some(vec![number.into()])));
            }
        }
        let cells: Vec<CellValue> = cells;
        self.edit(Edit::Set(cells));
        self.fill([800, 800], [3, 3], None);
    }

    fn style(&self) -> Style {
        Style::default_for(&self.map())
    }

    fn export(&self, name: &str) -> TileArchiveSummary {
        let map = self.map();
        let painter = TilePainter::new(&self.style(), &map, &()).unwrap();
        let source = TreeTiles::world(&map).unwrap();
        let request = TileRequest::new(&map).unwrap();
        export_tiles(&source, &painter, &request, &self.target(name), &()).unwrap()
    }

    fn update(&self, name: &str, progress: &dyn Progress) -> Result<TileArchiveSummary> {
        let map = self.map();
        let update = TileUpdate::open(&self.target(name), None, progress)?;
        let painter = update.painter(&self.style(), &map, progress)?;
        let source = TreeTiles::world(&map).unwrap();
        update.run(&map, &source, &painter, &TileRequest::new(&map)?, &UpdateOptions::default(), progress)
    }

    fn restyle(&self, name: &str) -> TileArchiveSummary {
        let map = self.map();
        let update = TileUpdate::open(&self.target(name), None, &()).unwrap();
        let painter = TilePainter::new(&self.style(), &map, &()).unwrap();
        let (source, request) = (TreeTiles::world(&map).unwrap(), TileRequest::new(&map).unwrap());
        let options = with(UpdateOptions::default(), |options| options.restyle = true);
        update.run(&map, &source, &painter, &request, &options, &()).unwrap()
    }
}

/// Returns all files below a directory with their bytes, and all directories.
fn contents(directory: &Path) -> BTreeMap<PathBuf, Option<Vec<u8>>> {
    let mut found = BTreeMap::new();
    let mut pending = vec![directory.to_path_buf()];
    while let Some(next) = pending.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(directory).unwrap().to_path_buf();
            let bytes = (!path.is_dir()).then(|| std::fs::read(&path).unwrap());
            if bytes.is_none() {
                pending.push(path);
            }
            found.insert(name, bytes);
        }
    }
    found
}

/// Replaces the contents of a directory.
fn restore(directory: &Path, contents: &BTreeMap<PathBuf, Option<Vec<u8>>>) {
    let _ = std::fs::remove_dir_all(directory);
    std::fs::create_dir(directory).unwrap();
    for (name, bytes) in contents {
        match bytes {
            None => std::fs::create_dir(directory.join(name)).unwrap(),
            Some(bytes) => std::fs::write(directory.join(name), bytes).unwrap(),
        }
    }
}

/// Records all states of a directory during an operation: what remains if the operation is killed.
struct Watch {
    directory: PathBuf,
    seen: Mutex<Vec<BTreeMap<PathBuf, Option<Vec<u8>>>>>,
}

impl Watch {
    fn compare(&self) {
        let mut seen = self.seen.lock().unwrap();
        let now = contents(&self.directory);
        if seen.last() != Some(&now) {
            seen.push(now);
        }
    }
}

impl Progress for Watch {
    fn advance(&self, _: u64, _: u64) {
        self.compare();
    }

    fn interrupted(&self) -> bool {
        self.compare();
        false
    }
}

#[test]
fn an_update_repairs_a_directory_whose_update_was_killed() {
    let temp = TestDirectory::new(QUAD, DataKind::Categorical);
    temp.export("a");
    let directory = temp.path("a");
    temp.change();
    let changed = std::fs::read(temp.tree()).unwrap();
    temp.export("fresh");
    temp.take_back();
    let taken_back = std::fs::read(temp.tree()).unwrap();
    temp.export("back");
    let [fresh, back] = ["fresh", "back"].map(|name| contents(&temp.path(name)));
    assert!(fresh != back);
    std::fs::write(temp.tree(), &changed).unwrap();
    let watch = Watch { directory: directory.clone(), seen: Mutex::default() };
    temp.update("a", &watch).unwrap();
    assert!(contents(&directory) == fresh);
    let seen = watch.seen.into_inner().unwrap();
    let is_pending = |state: &BTreeMap<PathBuf, _>| state.contains_key(Path::new(".update/journal"));
    let pending = seen.iter().filter(|state| is_pending(state)).count();
    assert!(pending > 4 && seen.len() > pending + 4, "{pending} of {}", seen.len());
    for state in &seen {
        for (tree, expected) in [(&changed, &fresh), (&taken_back, &back)] {
            std::fs::write(temp.tree(), tree).unwrap();
            restore(&directory, state);
            let findings = verify_tiles(&directory, &()).unwrap();
            assert_eq!(
                findings.iter().any(|found| found.problem.contains("completes it")),
                is_pending(state)
            );
            assert_eq!(
                findings.is_empty(),
                !state.keys().any(|name| name.starts_with(".update") || name == Path::new(".lock"))
            );
            temp.update("a", &()).unwrap();
            assert!(contents(&directory) == *expected, "{:?}", state.keys());
            assert_eq!(verify_tiles(&directory, &()).unwrap(), []);
        }
    }
}

/// Cancels after a number of checks, and collects warnings.
#[derive(Default)]
struct Patience(AtomicU64, Mutex<Vec<String>>);

impl Progress for Patience {
    fn warn(&self, _: &Path, text: &str) {
        self.1.lock().unwrap().push(text.into());
    }

    fn interrupted(&self) -> bool {
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).is_err()
    }
}

#[test]
fn a_cancelled_update_changes_nothing_or_warns_that_it_has_begun() {
    let temp = TestDirectory::new(QUAD, DataKind::Categorical);
    temp.export("a");
    let directory = temp.path("a");
    let before = contents(&directory);
    temp.change();
    temp.export("fresh");
    let fresh = contents(&temp.path("fresh"));
    let (mut untouched, mut begun) = (0, 0);
    for patience in 0.. {
        let patience = Patience(AtomicU64::new(patience), Mutex::default());
        match temp.update("a", &patience) {
            Err(Error::Interrupted) => {}
            done => {
                done.unwrap();
                break;
            }
        }
        let warnings = patience.1.into_inner().unwrap();
        if warnings.iter().any(|text| text.contains("has begun to change tiles")) {
            begun += 1;
            let resumed = Patience(AtomicU64::new(u64::MAX), Mutex::default());
            temp.update("a", &resumed).unwrap();
            let resumed = resumed.1.into_inner().unwrap();
            let states = "an update from commit 1 of w.autumn to commit 4 of w.autumn was interrupted";
            assert!(resumed.len() == 1 && resumed[0].starts_with(states), "{resumed:?}");
            assert!(contents(&directory) == fresh);
            restore(&directory, &before);
        } else {
            untouched += 1;
            assert!(contents(&directory) == before);
        }
    }
    assert!(untouched > 4 && begun > 4, "{untouched}, {begun}");
    assert!(contents(&directory) == fresh);
}

#[test]
fn the_second_of_two_concurrent_updates_is_rejected() {
    let temp = TestDirectory::new(QUAD, DataKind::Categorical);
    let mut names = vec!["a"];
    if cfg!(feature = "mbtiles") {
        names.push("a.mbtiles");
    }
    for name in &names {
        temp.export(name);
    }
    temp.change();
    for name in names {
        let target = temp.target(name);
        let first = TileUpdate::open(&target, None, &()).unwrap();
        let second = temp.update(name, &());
        assert!(matches!(&second, Err(Error::Locked { path, .. }) if path == target.path()), "{second:?}");
        if name == "a" {
            assert!(matches!(verify_tiles(target.path(), &()), Err(Error::Locked { .. })));
        }
        drop(first);
        temp.update(name, &()).unwrap();
        assert_eq!(verify_tiles(target.path(), &()).unwrap(), []);
    }
}

#[test]
#[cfg(unix)]
fn updates_do_not_follow_links_out_of_the_directory() {
    let temp = TestDirectory::new(QUAD, DataKind::Categorical);
    temp.export("a");
    temp.export("other");
    let [directory, other] = ["a", "other"].map(|name| temp.path(name));
    let precious = contents(&other);
    temp.change();
    for name in ["2", "2/1", "2/1/0.png", "2/3/3.png", "tiles.json", ".lock", ".update"] {
        let backup = contents(&directory);
        let (link, there) = (directory.join(name), other.join(name));
        let _ = std::fs::remove_file(&link).or_else(|_| std::fs::remove_dir_all(&link));
        std::os::unix::fs::symlink(if there.exists() { &there } else { &other }, &link)
            .or_else(|_| {
                std::fs::create_dir_all(link.parent().unwrap())?;
                std::os::unix::fs::symlink(&other, &link)
            })
            .unwrap();
        let updated = temp.update("a", &());
        assert!(matches!(updated, Err(Error::Unsupported { .. })), "{name}: {updated:?}");
        assert!(contents(&other) == precious, "{name}");
        std::fs::remove_dir_all(&directory).unwrap();
        restore(&directory, &backup);
    }
}

#[test]
fn exports_resume_only_their_own_partial_output() {
    let temp = TestDirectory::new(QUAD, DataKind::Categorical);
    let map = temp.map();
    let (source, mut request) = (TreeTiles::world(&map).unwrap(), TileRequest::new(&map).unwrap());
    let painter = TilePainter::new(&temp.style(), &map, &()).unwrap();
    request.resume = true;
    let mut names = vec!["r", "r.pmtiles"];
    if cfg!(feature = "mbtiles") {
        names.push("r.mbtiles");
    }
    for name in names {
        let target = temp.target(name);
        let partial = temp.path(&format!("{name}.partial"));
        let go = || export_tiles(&source, &painter, &request, &target, &());
        let refused = |what: &str| match go() {
            Err(Error::Unsupported { .. }) => {}
            other => panic!("{name}, {what}: {other:?}"),
        };
        let journal = if name == "r" {
            partial.join(".journal")
        } else {
            temp.path(&format!("{name}.partial.journal"))
        };
        // A file or directory of the user.
        if name == "r" {
            std::fs::create_dir(&partial).unwrap();
            std::fs::write(partial.join("diary"), "precious").unwrap();
        } else {
            std::fs::write(&partial, "precious").unwrap();
        }
        let before = contents(temp.0.path());
        refused("another program's file");
        assert!(contents(temp.0.path()) == before, "{name}");
        if name == "r" {
            std::fs::remove_dir_all(&partial).unwrap();
        } else {
            std::fs::remove_file(&partial).unwrap();
        }
        // A journal of the user.
        if name != "r.mbtiles" {
            if name == "r" {
                std::fs::create_dir(&partial).unwrap();
            }
            std::fs::write(&journal, "dear").unwrap();
            refused("another program's journal");
            assert_eq!(std::fs::read(&journal).unwrap(), b"dear");
            std::fs::remove_file(&journal).unwrap();
            let _ = std::fs::remove_dir(&partial).or_else(|_| std::fs::remove_file(&partial));
        }
        #[cfg(unix)]
        {
            let outside = temp.path("outside");
            if name == "r" { std::fs::create_dir(&outside) } else { std::fs::write(&outside, "") }.unwrap();
            std::os::unix::fs::symlink(&outside, &partial).unwrap();
            refused("a link");
            assert!(contents(temp.0.path())[Path::new("outside")].as_ref().is_none_or(Vec::is_empty));
            std::fs::remove_file(&partial).unwrap();
            let _ = std::fs::remove_dir(&outside).or_else(|_| std::fs::remove_file(&outside));
        }
        go().unwrap();
        let left = std::fs::read_dir(temp.0.path()).unwrap();
        let left: Vec<_> =
            left.map(|entry| entry.unwrap().file_name()).filter(|left| left != "w.autumn").collect();
        assert_eq!(left, [name]);
        let _ = std::fs::remove_dir_all(temp.path(name)).or_else(|_| std::fs::remove_file(temp.path(name)));
    }
}

#[test]
fn colours_stay_when_percentiles_move_until_all_tiles_are_redrawn() {
    let u16s = TreeType { value: ValueType::new(SampleType::U16, 1), ..QUAD };
    let temp = TestDirectory::new(u16s, DataKind::Continuous);
    let mut names = vec!["a", "a.pmtiles"];
    if cfg!(feature = "mbtiles") {
        names.push("a.mbtiles");
    }
    for name in &names {
        temp.export(name);
    }
    let tile = |name: &str| std::fs::read(temp.path(name).join("2/1/1.png")).unwrap();
    let before = tile("a");
    // The upper end of the grey range changes considerably.
    temp.fill([0, 0], [256, 256], Some(60_000.0));
    temp.export("fresh");
    let fresh = tile("fresh");
    assert!(fresh != before, "the percentiles have moved");
    for name in names {
        let target = temp.target(name);
        let warnings = Patience(AtomicU64::new(u64::MAX), Mutex::default());
        temp.update(name, &warnings).unwrap();
        let warnings = warnings.1.into_inner().unwrap();
        let words = ["band 1: 98 % is ", "(now: 60000)", "--restyle"];
        assert!(warnings.len() == 1 && words.iter().all(|text| warnings[0].contains(text)), "{warnings:?}");
        assert_eq!(verify_tiles(target.path(), &()).unwrap(), []);
        if name == "a" {
            assert!(tile("a") == before, "what was not touched keeps its colours");
        }
        // It does not mix colours unless requested.
        let map = temp.map();
        let update = TileUpdate::open(&target, None, &()).unwrap();
        let painter = TilePainter::new(&temp.style(), &map, &()).unwrap();
        let (source, request) = (TreeTiles::world(&map).unwrap(), TileRequest::new(&map).unwrap());
        let mixed = update.run(&map, &source, &painter, &request, &UpdateOptions::default(), &());
        let Err(Error::Unsupported { found, .. }) = mixed else { panic!("{name}: {mixed:?}") };
        assert!(found.contains("other percentiles: band 1: 98 % is"), "{found}");
        let update = TileUpdate::open(&target, None, &()).unwrap();
        let other = update.painter(&Style::parse("viridis").unwrap(), &map, &());
        assert!(matches!(other, Err(Error::Invalid { .. })));
        drop(update);
        // Another tile changes, and one is removed; all are drawn.
        temp.restyle(name);
        assert_eq!(verify_tiles(target.path(), &()).unwrap(), []);
        if name == "a.pmtiles" {
            temp.export("fresh.pmtiles");
            assert!(
                std::fs::read(target.path()).unwrap() == std::fs::read(temp.path("fresh.pmtiles")).unwrap()
            );
        }
    }
    assert!(contents(&temp.path("a")) == contents(&temp.path("fresh")));
    // Also with changes to the tree that remove tiles.
    temp.fill([256, 0], [256, 256], None);
    temp.restyle("a");
    temp.export("again");
    assert!(contents(&temp.path("a")) == contents(&temp.path("again")));
}

/// Counts requests to a source.
struct Counted<'a> {
    source: TreeTiles<'a>,
    drawn: AtomicU64,
    blocks: AtomicU64,
}

impl TileSource for Counted<'_> {
    fn value_type(&self) -> ValueType {
        self.source.value_type()
    }

    fn max_zoom(&self, side: usize) -> u8 {
        self.source.max_zoom(side)
    }

    fn degrees(&self) -> [f64; 4] {
        self.source.degrees()
    }

    fn data_place(&self) -> Result<GeographicExtent> {
        self.source.data_place()
    }

    fn content(&self, tile: TileId) -> Result<TileContent> {
        self.source.content(tile)
    }

    fn tile(&self, tile: TileId, side: usize, margin: usize, samples: &mut TileSamples) -> Result<()> {
        self.drawn.fetch_add(1, Ordering::Relaxed);
        self.source.tile(tile, side, margin, samples)
    }

    fn tiles_of(&self, block: Code, zoom: u8) -> TileRange {
        self.blocks.fetch_add(1, Ordering::Relaxed);
        self.source.tiles_of(block, zoom)
    }

    fn block_level(&self, zoom: u8) -> u8 {
        self.source.block_level(zoom)
    }

    fn check_unchanged(&self) -> Result<()> {
        self.source.check_unchanged()
    }
}

#[test]
fn an_update_redraws_each_changed_tile_once() {
    for (cells, tiles) in [
        (vec![[700, 3, 0]], 3),
        ((0..256 * 256).map(|at| [at % 256 * 2, at / 256 * 2, 0]).collect(), 1 + 1 + 4),
    ] {
        let temp = TestDirectory::new(QUAD, DataKind::Categorical);
        temp.export("a");
        temp.export("a.pmtiles");
        let set: Vec<CellValue> = cells.iter().map(|cell| (*cell, Some(vec![199.0.into()]))).collect();
        temp.edit(Edit::Set(set));
        let map = temp.map();
        let painter = TilePainter::new(&temp.style(), &map, &()).unwrap();
        let request = TileRequest::new(&map).unwrap();
        for name in ["a", "a.pmtiles"] {
            let source = TreeTiles::world(&map).unwrap();
            let counted = Counted { source, drawn: AtomicU64::new(0), blocks: AtomicU64::new(0) };
            let update = TileUpdate::open(&temp.target(name), None, &()).unwrap();
            update.run(&map, &counted, &painter, &request, &UpdateOptions::default(), &()).unwrap();
            let counts = [counted.drawn.into_inner(), counted.blocks.into_inner()];
            assert_eq!(counts, [tiles, tiles], "{} cells, {name}", cells.len());
        }
        temp.export("fresh.pmtiles");
        let [updated, fresh] =
            ["a.pmtiles", "fresh.pmtiles"].map(|name| std::fs::read(temp.path(name)).unwrap());
        assert!(updated == fresh);
        let there = Pmtiles::open(&temp.path("a.pmtiles")).unwrap();
        assert!(there.tile(TileId { zoom: 2, column: 2, row: 0 }).unwrap().is_some());
    }
}
