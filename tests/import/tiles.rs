//! Tiles in archives and directories, against windows of their source trees.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use spinney::edit::{Edit, FillRegion, Note, edit};
use spinney::export::{
    Detail, TileEncoding, TileFormat, TileRequest, WindowRequest, export_pmtiles, export_tiles, export_window,
};
use spinney::raw::dataset::open;
use spinney::raw::export::image::Format;
use spinney::raw::export::tiles::{
    Pmtiles, TileId, TilePainter, TileTarget, TileUpdate, TreeTiles, verify_tiles,
};
use spinney::raw::io::Faults;
use spinney::raw::space::web_mercator;
use spinney::raw::value::Palette;
use spinney::style::Style;
use spinney::{
    Bounds, DataKind, Dataset, Error, Metadata, Output, Progress, Result, Rule, WriteOptions, convert,
};

use crate::common::{Cells, QUAD, options, value, write_cells};

/// Returns a world of 2^depth cells per side: noise, patches, and an empty and a uniform quadrant.
fn world(path: &Path, depth: u8) -> Dataset {
    let side = 1u64 << depth;
    let mut cells = Cells::random(QUAD, 5, [side, side, 1], 7, true);
    for y in 0..side {
        for x in 0..side {
            let at = (y * side + x) as usize;
            if x >= side / 2 && y < side / 2 {
                cells.cells[at] = None;
            } else if x >= side / 2 {
                cells.cells[at] = Some(value(QUAD.value, 3));
            }
        }
    }
    let colours = (0..=255u8).map(|number| [number, 255 - number, number.wrapping_mul(7), 255]).collect();
    let metadata = Metadata {
        frame: web_mercator(depth),
        palette: Some(Palette { colours }),
        nodata: Some(250.0.into()),
        ..Metadata::default()
    };
    write_cells(path, &cells, &options(Rule::Majority, DataKind::Categorical, depth).metadata(metadata));
    open(path, &Default::default()).unwrap()
}

fn painter(map: &Dataset) -> TilePainter {
    TilePainter::new(&Style::default_for(map), map, &()).unwrap()
}

fn export(
    map: &Dataset,
    request: &TileRequest,
    target: &str,
) -> Result<spinney::raw::export::tiles::TileArchiveSummary> {
    let target = TileTarget::of(target.as_ref())?.unwrap();
    export_tiles(&TreeTiles::world(map).unwrap(), &painter(map), request, &target, &())
}

/// Returns the values and flags of a tile from the tree.
fn window(map: &Dataset, tile: TileId, side: u64) -> (Vec<u8>, Vec<bool>) {
    let level = tile.zoom + side.trailing_zeros() as u8;
    let (x, y) = (u64::from(tile.column) * side, u64::from(tile.row) * side);
    let bounds = Bounds { min: [x, y, 0], max: [x + side, y + side, 1] };
    let (mut values, mut valid) = (vec![0; (side * side) as usize], vec![false; (side * side) as usize]);
    map.window(level, &bounds, 250.0, &mut values, Some(&mut valid)).unwrap();
    (values, valid)
}

/// Returns red, green, blue and opacity of a PNG file's pixels.
fn decoded(bytes: &[u8]) -> Vec<[u8; 4]> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::ALPHA);
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    match info.color_type.samples() {
        2 => pixels.as_chunks::<2>().0.iter().map(|[grey, alpha]| [*grey, *grey, *grey, *alpha]).collect(),
        samples => {
            assert_eq!(samples, 4);
            pixels.as_chunks::<4>().0.to_vec()
        }
    }
}

fn tiles(zooms: std::ops::RangeInclusive<u8>) -> impl Iterator<Item = TileId> {
    let zoom_tiles = |zoom: u8| {
        let side = 1u32 << zoom;
        (0..side * side).map(move |at| TileId { zoom, column: at % side, row: at / side })
    };
    zooms.flat_map(zoom_tiles)
}

#[test]
fn tiles_are_the_nodes_of_the_tree() {
    let directory = tempfile::tempdir().unwrap();
    let map = world(&directory.path().join("w.goblin"), 11);
    for side in [256, 512] {
        let archive = directory.path().join(format!("{side}.pmtiles"));
        let mut request = TileRequest::new(&map).unwrap();
        request.side = side;
        let stored = export(&map, &request, archive.to_str().unwrap()).unwrap();
        let archive = Pmtiles::open(&archive).unwrap();
        assert_eq!(archive.verify(&()).unwrap(), []);
        let zooms = 0..=if side == 256 { 3 } else { 2 };
        let (mut found, mut contents) = (0, BTreeMap::new());
        for tile in tiles(zooms) {
            let (values, valid) = window(&map, tile, side as u64);
            let bytes = archive.tile(tile).unwrap();
            assert_eq!(bytes.is_some(), valid.contains(&true), "{tile:?}");
            let Some(bytes) = bytes else { continue };
            let palette = &map.metadata().palette.as_ref().unwrap().colours;
            let colour =
                |(value, valid): (&u8, &bool)| if *valid { palette[usize::from(*value)] } else { [0; 4] };
            let expected: Vec<_> = values.iter().zip(&valid).map(colour).collect();
            let mut seen = decoded(&bytes);
            // Fully transparent pixels may have any colour.
            seen.iter_mut().filter(|pixel| pixel[3] == 0).for_each(|pixel| *pixel = [0; 4]);
            assert!(seen == expected, "{tile:?}");
            found += 1;
            contents.insert(bytes, ());
        }
        assert_eq!((stored.tiles, stored.contents), (found, contents.len() as u64));
        assert!(stored.contents < stored.tiles);
        assert_eq!(archive.tile(TileId { zoom: 4, column: 0, row: 0 }).unwrap(), None);
    }
}

#[test]
fn archives_and_directories_have_the_same_tiles() {
    let directory = tempfile::tempdir().unwrap();
    let map = world(&directory.path().join("w.goblin"), 10);
    for (format, end) in [
        (TileFormat::Png, "png"),
        (TileFormat::Webp, "webp"),
        (TileFormat::Npy, "npy"),
        (TileFormat::Tiff, "tif"),
        (TileFormat::Jpeg, "jpg"),
    ] {
        let mut request = TileRequest::new(&map).unwrap();
        request.encoding = TileEncoding { format, ..TileEncoding::default() };
        let name = |end: &str| format!("{}/{end}", directory.path().display());
        let archive = name(&format!("{end}.pmtiles"));
        let stored = export(&map, &request, &archive).unwrap();
        let pattern = name(&format!("{end}/{{z}}/{{x}}/{{y}}.{end}"));
        assert_eq!(export(&map, &request, &pattern).unwrap().tiles, stored.tiles);
        assert_eq!(verify_tiles(name(end).as_ref(), &()).unwrap(), []);
        let archive = Pmtiles::open(archive.as_ref()).unwrap();
        for tile in tiles(0..=2) {
            let TileId { zoom, column, row } = tile;
            let file = std::fs::read(name(&format!("{end}/{zoom}/{column}/{row}.{end}"))).ok();
            assert_eq!(file, archive.tile(tile).unwrap(), "{tile:?}");
            if format == TileFormat::Npy
                && let Some(file) = file
            {
                assert_eq!(file[file.len() - (1 << 16)..], window(&map, tile, 256).0);
            }
        }
        #[cfg(feature = "mbtiles")]
        {
            let database = name(&format!("{end}.mbtiles"));
            assert_eq!(export(&map, &request, &database).unwrap().tiles, stored.tiles);
            assert_eq!(verify_tiles(database.as_ref(), &()).unwrap(), []);
        }
    }
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 16);
}

#[test]
fn zooms_and_boxes_leave_tiles_out() {
    let directory = tempfile::tempdir().unwrap();
    let map = world(&directory.path().join("w.goblin"), 11);
    let path = directory.path().join("t.pmtiles");
    let mut request = TileRequest::new(&map).unwrap();
    request.zooms = Some(1..=2);
    // A box in the north-western quadrant that is within one tile of zoom 2, and touches no other.
    request.degrees = Some([-170.0, 70.0, -100.0, 75.0]);
    let stored = export(&map, &request, path.to_str().unwrap()).unwrap();
    let archive = Pmtiles::open(&path).unwrap();
    let there: Vec<_> = tiles(0..=3).filter(|tile| archive.tile(*tile).unwrap().is_some()).collect();
    assert_eq!(there, [TileId { zoom: 1, column: 0, row: 0 }, TileId { zoom: 2, column: 0, row: 0 }]);
    assert_eq!((stored.tiles, archive.verify(&()).unwrap()), (2, vec![]));
    // One zoom deeper than the cells: each is four pixels.
    request.zooms = Some(4..=4);
    request.degrees = Some([-179.0, 84.0, -178.0, 84.5]);
    request.encoding.format = TileFormat::Npy;
    export(&map, &request, path.to_str().unwrap()).unwrap();
    let deep = Pmtiles::open(&path).unwrap().tile(TileId { zoom: 4, column: 0, row: 0 }).unwrap().unwrap();
    let (values, _) = window(&map, TileId { zoom: 3, column: 0, row: 0 }, 256);
    let deep = &deep[deep.len() - (1 << 16)..];
    for (x, y) in [(0, 0), (1, 0), (17, 101), (254, 255), (255, 255)] {
        assert_eq!(deep[y * 256 + x], values[y / 2 * 256 + x / 2], "{x}, {y}");
    }
    for bad in [[10.0, 0.0, 5.0, 1.0], [0.0, 0.0, 400.0, 1.0]] {
        request.degrees = Some(bad);
        assert!(matches!(export(&map, &request, path.to_str().unwrap()), Err(Error::Invalid { .. })));
    }
}

/// Cancels after a number of checks.
struct Patience(AtomicU64);

impl Progress for Patience {
    fn interrupted(&self) -> bool {
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).is_err()
    }
}

/// Returns a world of 2^depth cells per side in squares of `square` cells per side, with different
/// values in adjacent squares. In every eighth square all cells differ.
fn many(path: &Path, depth: u8, square: u64) -> Dataset {
    let side = 1u64 << depth;
    let mut cells = Cells::random(QUAD, 5, [side, side, 1], 7, false);
    for (at, cell) in cells.cells.iter_mut().enumerate() {
        let (x, y) = (at as u64 % side, at as u64 / side);
        let size = if (x / square + y / square).is_multiple_of(8) { 1 } else { square };
        let at = y / size * (side / size) + x / size;
        *cell = Some(value(QUAD.value, (at % 41 + y / size % 5) % 200));
    }
    let metadata = Metadata { frame: web_mercator(depth), ..Metadata::default() };
    write_cells(path, &cells, &options(Rule::Mean, DataKind::Continuous, depth).metadata(metadata));
    open(path, &Default::default()).unwrap()
}

#[test]
fn threads_do_not_change_bytes_and_cancelled_exports_resume() {
    let directory = tempfile::tempdir().unwrap();
    // More tiles than between checkpoints: those of the last zoom have 2 by 2 cells each, and most
    // of them are uniform.
    let map = many(&directory.path().join("w.goblin"), 7, 2);
    let source = TreeTiles::world(&map).unwrap();
    let painter = painter(&map);
    let mut request = TileRequest::new(&map).unwrap();
    request.zooms = Some(0..=6);
    let ends = if cfg!(feature = "mbtiles") { &["pmtiles", "mbtiles"][..] } else { &["pmtiles"][..] };
    for end in ends {
        let whole = directory.path().join(format!("whole.{end}"));
        let bytes: Vec<Vec<u8>> = [1, 8]
            .into_iter()
            .map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| export(&map, &request, whole.to_str().unwrap()).unwrap());
                std::fs::read(&whole).unwrap()
            })
            .collect();
        assert!(bytes[0] == bytes[1], "{end}");
        request.resume = true;
        let part = directory.path().join(format!("part.{end}"));
        let target = TileTarget::of(&part).unwrap().unwrap();
        let mut starts = 0;
        loop {
            starts += 1;
            let patience = Patience(AtomicU64::new(4500));
            match export_tiles(&source, &painter, &request, &target, &patience) {
                Ok(_) => break,
                Err(Error::Interrupted) => assert!(!part.exists() && starts < 20),
                Err(other) => panic!("{other}"),
            }
            // It does not resume with other options.
            let mut other = request.clone();
            other.side = 512;
            loop {
                match export_tiles(&source, &painter, &other, &target, &()) {
                    Err(Error::Unsupported { .. }) => break,
                    // A process that another test starts briefly holds a copy of the file
                    // descriptor, and of its lock.
                    Err(Error::Locked { .. }) => std::thread::yield_now(),
                    other => panic!("{:?}", other.map(|_| "an export that went on")),
                }
            }
        }
        assert!(starts > 1);
        request.resume = false;
        assert!(std::fs::read(&part).unwrap() == bytes[0], "{end} after {starts} starts");
        assert_eq!(verify_tiles(&part, &()).unwrap(), []);
        // Without resuming nothing remains.
        let gone = directory.path().join(format!("gone.{end}"));
        let target = TileTarget::of(&gone).unwrap().unwrap();
        let patience = Patience(AtomicU64::new(100));
        let interrupted = export_tiles(&source, &painter, &request, &target, &patience);
        assert!(matches!(interrupted, Err(Error::Interrupted)));
    }
    let pattern = directory.path().join("gone/{z}/{x}/{y}.png");
    let target = TileTarget::of(&pattern).unwrap().unwrap();
    let interrupted = export_tiles(&source, &painter, &request, &target, &Patience(AtomicU64::new(100)));
    assert!(matches!(interrupted, Err(Error::Interrupted)));
    let left: Vec<_> =
        std::fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left.len(), 1 + 2 * ends.len(), "{left:?}");
}

#[test]
fn an_update_is_like_doing_it_again() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("w.autumn");
    let goblin = directory.path().join("w.goblin");
    drop(world(&goblin, 11));
    convert(&goblin, false, Output::create(&path).unwrap(), WriteOptions::new(64 << 20), &()).unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let map = open(&path, &Default::default()).unwrap();
    let targets = |part: &str| {
        let mut all = vec![name(&format!("{part}.pmtiles")), name(&format!("{part}/{{z}}/{{x}}/{{y}}.png"))];
        if cfg!(feature = "mbtiles") {
            all.push(name(&format!("{part}.mbtiles")));
        }
        all
    };
    for target in targets("a") {
        export(&map, &TileRequest::new(&map).unwrap(), &target).unwrap();
    }
    // A hole, a spot in an empty area, and a new uniform tile.
    let regions = [
        ([100, 100], [300, 420], None),
        ([1500, 200], [1503, 204], Some(5.0)),
        ([512, 1024], [768, 1280], Some(6.0)),
    ];
    for (min, max, number) in regions {
        let bounds = Bounds { min: [min[0], min[1], 0], max: [max[0], max[1], 1] };
        let edits = [Ok(Edit::Fill(FillRegion::Box(bounds), number.map(|number: f64| vec![number.into()])))];
        edit(&path, edits, Note { time: Some(1), author: "test".into(), message: "t".into() }, 64 << 20, &())
            .unwrap();
    }
    let map = open(&path, &Default::default()).unwrap();
    let source = TreeTiles::world(&map).unwrap();
    let painter = painter(&map);
    let request = TileRequest::new(&map).unwrap();
    for (target, again) in targets("a").into_iter().zip(targets("b")) {
        let to = TileTarget::of(target.as_ref()).unwrap().unwrap();
        let update = TileUpdate::open(&to, None, &()).unwrap();
        let stored = update.run(&map, &source, &painter, &request, &Default::default(), &()).unwrap();
        let exported = export(&map, &request, &again).unwrap();
        assert_eq!(stored.tiles, exported.tiles, "{target}");
        assert_eq!(verify_tiles(to.path(), &()).unwrap(), [], "{target}");
        let other = TileTarget::of(again.as_ref()).unwrap().unwrap();
        match &to {
            TileTarget::Pmtiles(_) => {
                assert!(stored.copied > 0);
                assert!(std::fs::read(to.path()).unwrap() == std::fs::read(other.path()).unwrap());
            }
            TileTarget::Directory(_) => {
                for TileId { zoom, column, row } in tiles(0..=3) {
                    let [here, there] = ["a", "b"]
                        .map(|part| std::fs::read(name(&format!("{part}/{zoom}/{column}/{row}.png"))).ok());
                    assert!(here == there, "{zoom}/{column}/{row}");
                }
                let [here, there] = ["a", "b"]
                    .map(|part| std::fs::read_to_string(name(&format!("{part}/tiles.json"))).unwrap());
                assert_eq!(here, there);
            }
            #[allow(unreachable_patterns)]
            _ => assert_eq!(stored.contents, exported.contents),
        }
        // Tiles made with other options are not mixed.
        let mut smaller = request.clone();
        smaller.encoding.png_effort = Some(9);
        let update = TileUpdate::open(&to, None, &()).unwrap();
        let refused = update.run(&map, &source, &painter, &smaller, &Default::default(), &());
        let Err(Error::Invalid { found, expected, .. }) = refused else { panic!("{target}") };
        assert!(found == "png-effort 9" && expected.ends_with(": png-effort none"), "{found}, {expected}");
    }
}

/// A disk that is full after a number of bytes.
struct Full(AtomicU64);

impl Faults for Full {
    fn write(&self, length: usize) -> std::io::Result<usize> {
        let take = |left: u64| left.checked_sub(length as u64);
        let taken = self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take);
        taken.map(|_| length).map_err(|_| std::io::ErrorKind::StorageFull.into())
    }

    fn sync(&self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_leaves_no_file() {
    let directory = tempfile::tempdir().unwrap();
    let map = world(&directory.path().join("w.goblin"), 10);
    let (source, painter) = (TreeTiles::world(&map).unwrap(), painter(&map));
    let request = TileRequest::new(&map).unwrap();
    let path = directory.path().join("t.pmtiles");
    let length =
        export_pmtiles(&source, &painter, &request, Output::create(&path).unwrap(), &()).unwrap().bytes;
    std::fs::remove_file(&path).unwrap();
    // The file's start is written twice.
    for space in [0, 1000, 20_000, length - 10, length + 10, length + 16_000] {
        let output = Output::create(&path).unwrap().with_faults(std::sync::Arc::new(Full(space.into())));
        let done = export_pmtiles(&source, &painter, &request, output, &());
        let is_full =
            matches!(&done, Err(Error::Io { cause, .. }) if cause.kind() == std::io::ErrorKind::StorageFull);
        assert_eq!(is_full, space <= length + 10, "{space} of {length}: {done:?}");
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), if is_full { 1 } else { 2 });
    }
}

#[test]
fn corruption_is_detected_and_malicious_archives_end_soon() {
    let directory = tempfile::tempdir().unwrap();
    let map = world(&directory.path().join("w.goblin"), 10);
    let path = directory.path().join("t.pmtiles");
    export(&map, &TileRequest::new(&map).unwrap(), path.to_str().unwrap()).unwrap();
    let good = std::fs::read(&path).unwrap();
    let check = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        verify_tiles(&path, &()).map(|findings| findings.len())
    };
    // Any bit of the tiles, and each byte of the header and the root directory.
    for at in (16_384..good.len() - 2000).step_by(1997) {
        let mut bad = good.clone();
        bad[at] ^= 4;
        assert!(!matches!(check(&bad), Ok(0)), "byte {at}");
    }
    for at in (0..400).step_by(3) {
        for with in [0, 0x7f, 0xff] {
            let mut bad = good.clone();
            bad[at] = with;
            let _ = check(&bad);
        }
    }
    for length in [0, 7, 126, 127, 16_384, good.len() - 1] {
        assert!(check(&good[..length]).is_err(), "{length} bytes");
    }
    #[cfg(feature = "mbtiles")]
    {
        let path = directory.path().join("t.mbtiles");
        export(&map, &TileRequest::new(&map).unwrap(), path.to_str().unwrap()).unwrap();
        let good = std::fs::read(&path).unwrap();
        for at in (0..good.len()).step_by(9973) {
            let mut bad = good.clone();
            bad[at] ^= 0x55;
            std::fs::write(&path, &bad).unwrap();
            let _ = verify_tiles(&path, &());
        }
        std::fs::write(&path, &good[..good.len() / 2]).unwrap();
        assert!(!matches!(verify_tiles(&path, &()).as_deref(), Ok([])));
    }
    let base = directory.path().join("f");
    let pattern = directory.path().join("f/{z}/{x}/{y}.png");
    export(&map, &TileRequest::new(&map).unwrap(), pattern.to_str().unwrap()).unwrap();
    std::fs::write(base.join("1/0/stranger.png"), b"?").unwrap();
    assert_eq!(verify_tiles(&base, &()).unwrap().len(), 1);
    std::fs::remove_file(base.join("1/0/stranger.png")).unwrap();
    std::fs::remove_file(base.join("1/0/0.png")).unwrap();
    assert_eq!(verify_tiles(&base, &()).unwrap().len(), 1);
}

/// Returns all files below a directory with their bytes.
fn files(directory: &Path) -> BTreeMap<std::path::PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut pending = vec![directory.to_path_buf()];
    while let Some(next) = pending.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => pending.push(path),
                false => {
                    let bytes = std::fs::read(&path).unwrap();
                    found.insert(path.strip_prefix(directory).unwrap().to_path_buf(), bytes);
                }
            }
        }
    }
    found
}

#[test]
fn a_cancelled_directory_export_resumes_to_the_same_files() {
    let directory = tempfile::tempdir().unwrap();
    let map = many(&directory.path().join("w.goblin"), 7, 2);
    let (source, painter) = (TreeTiles::world(&map).unwrap(), painter(&map));
    let mut request = TileRequest::new(&map).unwrap();
    request.zooms = Some(0..=6);
    let target = |name: &str| {
        TileTarget::of(&directory.path().join(name).join("{z}").join("{x}").join("{y}.png")).unwrap().unwrap()
    };
    export_tiles(&source, &painter, &request, &target("whole"), &()).unwrap();
    request.resume = true;
    let mut starts = 0;
    loop {
        starts += 1;
        match export_tiles(&source, &painter, &request, &target("part"), &Patience(AtomicU64::new(4500))) {
            Ok(_) => break,
            Err(Error::Interrupted) => assert!(starts < 20 && !directory.path().join("part").exists()),
            Err(other) => panic!("{other}"),
        }
    }
    assert!(starts > 1);
    let [whole, part] = ["whole", "part"].map(|name| files(&directory.path().join(name)));
    assert!(whole == part, "{} and {} files after {starts} starts", whole.len(), part.len());
    assert_eq!(verify_tiles(&directory.path().join("part"), &()).unwrap(), []);
}

#[test]
fn relief_shading_has_no_seams_between_tiles() {
    let directory = tempfile::tempdir().unwrap();
    let map = many(&directory.path().join("w.goblin"), 10, 1);
    let style = Style::parse(r#"{"draw": "hillshade", "z": 100}"#).unwrap();
    let painter = TilePainter::new(&style, &map, &()).unwrap();
    let target = TileTarget::of(&directory.path().join("tiles/{z}/{x}/{y}.png")).unwrap().unwrap();
    let mut request = TileRequest::new(&map).unwrap();
    request.zooms = Some(2..=2);
    export_tiles(&TreeTiles::world(&map).unwrap(), &painter, &request, &target, &()).unwrap();
    let whole = directory.path().join("whole.png");
    let mut window = WindowRequest::new(map.header().extent_bounds(), Detail::Level(10));
    window.style = Some(style);
    export_window(&map, &window, Output::create(&whole).unwrap(), Format::Png, &()).unwrap();
    let whole = decoded(&std::fs::read(whole).unwrap());
    let mut greys = std::collections::BTreeSet::new();
    for (column, row) in (0..4).flat_map(|row| (0..4).map(move |column| (column, row))) {
        let tile =
            decoded(&std::fs::read(directory.path().join(format!("tiles/2/{column}/{row}.png"))).unwrap());
        for (at, pixel) in tile.iter().enumerate() {
            let (x, y) = (column * 256 + at % 256, row * 256 + at / 256);
            // An image of the whole world ends in the west and east, where tiles continue.
            if x > 0 && x < 1023 {
                let expected = whole[y * 1024 + x];
                let is_close = pixel.iter().zip(&expected).all(|(a, b)| a.abs_diff(*b) <= 1);
                assert!(is_close, "{column}/{row} at {x},{y}: {pixel:?}, not {expected:?}");
                greys.insert(pixel[0]);
            }
        }
    }
    assert!(greys.len() > 10, "{greys:?}");
}
