//! Updates of indexes that a new index would differ from are refused, and leave the index.

use std::fs;
use std::path::PathBuf;

use spinney::Error;
use spinney::import::raster::StackOptions;
use spinney::raw::import::raster::IndexUpdate;

use crate::common::with;
use crate::compare::{Directory, build, index, indexed, stack, update};
use crate::tiffs::{Chunks, Samples, Tiff, pages};

/// Files `0.tif`, `1.tif` and so on, and an index of them, `x.goblin`.
struct Indexed {
    directory: Directory,
    paths: Vec<PathBuf>,
}

impl Indexed {
    fn files(tiffs: &[Tiff]) -> Indexed {
        let mut made = Indexed { directory: Directory::new(), paths: Vec::new() };
        tiffs.iter().for_each(|tiff| made.add(tiff));
        made
    }

    fn of(tiffs: &[Tiff]) -> Indexed {
        let made = Indexed::files(tiffs);
        index(&made.paths, &made.index());
        made
    }

    fn stack(tiffs: &[Tiff]) -> Indexed {
        let made = Indexed::files(tiffs);
        let options = with(StackOptions::new(), |it| it.import = indexed(2));
        stack(&made.paths, &made.index(), &options).unwrap();
        made
    }

    fn index(&self) -> PathBuf {
        self.directory.path("x.goblin")
    }

    fn add(&mut self, tiff: &Tiff) {
        let path = self.directory.path(&format!("{}.tif", self.paths.len()));
        tiff.write(&path);
        self.paths.push(path);
    }

    /// Writes a file so that it counts as changed.
    fn change(&self, number: usize, tiff: &Tiff) {
        fs::write(&self.paths[number], [tiff.bytes(), vec![0; 3]].concat()).unwrap();
    }

    /// Writes the sidecar of a file, with elements of its first band.
    fn describe(&self, number: usize, band: &str) {
        let text = format!("<PAMDataset><PAMRasterBand band=\"1\">{band}</PAMRasterBand></PAMDataset>");
        fs::write(self.directory.path(&format!("{number}.tif.aux.xml")), text).unwrap();
    }

    /// Checks that an update to the files is refused.
    fn assert_refused(&self, is_listed: bool, about: &str) {
        let before = fs::read(self.index()).unwrap();
        let result = update(&self.index(), &self.index(), |it| {
            it.sources = is_listed.then(|| self.paths.clone());
        });
        let error = match result {
            Ok(report) => panic!("{about}: {report:?}"),
            Err(error) => error.to_string(),
        };
        assert!(error.contains(about) && error.contains("`spinney index`"), "{about}: {error}");
        assert!(fs::read(self.index()).unwrap() == before, "{about}");
    }
}

/// Returns a file at a column of the grid.
fn at(column: i64, nodata: Option<&'static str>) -> Tiff {
    Tiff { origin: Some([column, 0]), nodata, ..Tiff::new([90, 80], 1 + column.unsigned_abs()) }
}

#[test]
fn other_nodata_numbers() {
    for (before, added, samples) in [
        (Some("0"), Some("255"), Samples::Uint(8)),
        (Some("0"), None, Samples::Uint(8)),
        (Some("nan"), Some("0"), Samples::Float(32)),
    ] {
        let tiff = |column, nodata| Tiff { samples, ..at(column, nodata) }.filled(4);
        let mut made = Indexed::of(&[tiff(0, before)]);
        made.add(&tiff(90, added));
        made.assert_refused(true, "nodata");
    }
    // What is left has one number.
    let mut made = Indexed::of(&[at(0, Some("0")), at(90, Some("255"))]);
    made.paths.pop();
    made.assert_refused(true, "one nodata number");
    // A changed file, by its tag and by its sidecar.
    for (before, now) in [(None, Some("0")), (Some("0"), None), (Some("0"), Some("7"))] {
        let made = Indexed::of(&[at(0, before)]);
        made.change(0, &at(0, now));
        made.assert_refused(false, "nodata");
    }
    let made = Indexed::of(&[at(0, Some("0")), at(90, Some("0"))]);
    made.change(1, &at(90, Some("7")));
    made.assert_refused(false, "nodata 7");
    let made = Indexed::of(&[at(0, None)]);
    made.describe(0, "<NoDataValue>3</NoDataValue>");
    made.change(0, &at(0, None));
    made.assert_refused(false, "nodata 3");
}

#[test]
fn other_opacity_scale_and_kind() {
    let colours =
        |column, has_alpha| Tiff { channels: 4, has_alpha, is_planar: true, ..at(column, None) }.filled(3);
    // An image keeps the colours of its transparent pixels; several do not.
    let mut made = Indexed::of(&[colours(0, true)]);
    made.add(&colours(90, true));
    made.assert_refused(true, "opacity");
    let mut made = Indexed::of(&[colours(0, true), colours(90, true)]);
    made.paths.pop();
    made.assert_refused(true, "opacity");
    for (before, now) in [(true, false), (false, true)] {
        let made = Indexed::of(&[colours(0, before), colours(90, before)]);
        made.change(1, &colours(90, now));
        made.assert_refused(false, "opacity");
        let mut made = Indexed::of(&[colours(0, before), colours(90, before)]);
        made.add(&colours(180, now));
        made.assert_refused(true, "opacity");
    }
    let scale = "<Offset>3</Offset><Scale>0.5</Scale>";
    let mut made = Indexed::of(&[at(0, None), at(90, None)]);
    made.add(&at(180, None));
    made.describe(2, scale);
    made.assert_refused(true, "scale or offset");
    made.paths.pop();
    made.describe(1, scale);
    made.change(1, &at(90, None));
    made.assert_refused(true, "scale or offset");
    // Colours of classes.
    let made = Indexed::of(&[at(0, None)]);
    made.change(0, &Tiff { has_palette: true, ..at(0, None) });
    made.assert_refused(false, "kind");
}

#[test]
fn other_bands_and_pages() {
    let mut made = Indexed::of(&[at(0, None)]);
    made.add(&Tiff { channels: 3, ..at(90, None) }.filled(1));
    made.assert_refused(true, "number of bands");
    // A new index refuses a file of several pages, too.
    made.paths.pop();
    made.add(&at(90, None));
    let bytes = pages(&[at(90, None), at(90, None)]);
    fs::write(&made.paths[1], &bytes).unwrap();
    let refused = |made: &Indexed, path: &PathBuf| {
        let sources = made.paths.clone();
        let error = update(&made.index(), &made.index(), |it| it.sources = Some(sources)).unwrap_err();
        let fresh = build(&made.paths, &made.directory.path("fresh.goblin"), &indexed(2)).unwrap_err();
        assert_eq!(error.to_string(), fresh.to_string());
        assert!(error.to_string().contains(&path.display().to_string()), "{error}");
    };
    refused(&made, &made.paths[1]);
    made.paths.pop();
    fs::write(&made.paths[0], &bytes).unwrap();
    refused(&made, &made.paths[0]);
}

#[test]
fn stacks() {
    let mut made = Indexed::stack(&[at(0, None), at(0, Some("0"))]);
    let removed = made.paths.pop().unwrap();
    made.assert_refused(true, "a layer without sources (1)");
    made.paths.insert(0, removed);
    made.assert_refused(true, "another order");
    made.paths.reverse();
    made.change(1, &at(0, Some("2")));
    made.assert_refused(false, "nodata");
    // Names of layers are made of descriptions, and opacity of one band hides others.
    let two = |has_alpha| Tiff { channels: 2, has_alpha, ..at(0, None) }.filled(3);
    let made = Indexed::stack(&[two(false), at(0, None)]);
    made.describe(0, "<Description>red</Description>");
    made.change(0, &two(false));
    made.assert_refused(false, "names");
    fs::remove_file(made.directory.path("0.tif.aux.xml")).unwrap();
    made.change(0, &two(true));
    made.assert_refused(false, "opacity");
}

#[test]
fn pages_of_a_stack() {
    let made = Indexed::files(&[at(0, None)]);
    let page = |seed| Tiff::new([60, 50], seed);
    fs::write(&made.paths[0], pages(&[page(1), page(2)])).unwrap();
    let options = with(StackOptions::new(), |it| (it.import, it.every_page) = (indexed(2), true));
    stack(&made.paths, &made.index(), &options).unwrap();
    fs::write(&made.paths[0], pages(&[page(1), page(2), page(3)])).unwrap();
    made.assert_refused(false, "3 pages");
}

#[test]
fn files_that_are_too_far_away() {
    for column in [600_000_000, 3_000_000_000, 5_000_000_000_000] {
        let mut made = Indexed::of(&[at(0, None)]);
        made.add(&at(column, None));
        let sources = made.paths.clone();
        let error = update(&made.index(), &made.index(), |it| it.sources = Some(sources)).unwrap_err();
        assert!(error.to_string().contains("at most 2^29 cells per side"), "{error}");
        assert!(build(&made.paths, &made.directory.path("fresh.goblin"), &indexed(2)).is_err());
    }
}

#[test]
fn memory_is_that_of_the_update() {
    let mut made = Indexed::of(&[at(0, None)]);
    let chunks = Chunks::Tiles(1024, 1024);
    made.add(&Tiff { chunks, ..at(90, None) });
    let result = |memory| {
        let sources = made.paths.clone();
        let change = |it: &mut IndexUpdate| {
            (it.sources, it.memory) = (Some(sources), memory);
        };
        update(&made.index(), &made.directory.path("y.goblin"), change)
    };
    let error = result(1 << 20).unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
    result(64 << 20).unwrap();
    // A new index has the same limit.
    let options = |memory| with(indexed(2), |it| it.memory = Some(memory));
    assert!(build(&made.paths, &made.directory.path("z.goblin"), &options(1 << 20)).is_err());
}

#[test]
fn no_sources_and_unknown_prefixes() {
    let made = Indexed::of(&[Tiff::new([20, 10], 1)]);
    type Change<'a> = &'a dyn Fn(&mut IndexUpdate);
    let changes: [(Change<'_>, &str); 2] = [
        (&|it| it.sources = Some(Vec::new()), "sources"),
        (&|it| it.prefixes = vec![("typo/".into(), "x/".into())], "`typo/`"),
    ];
    for (change, expected) in changes {
        let before = fs::read(made.index()).unwrap();
        let error = update(&made.index(), &made.index(), change).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
        assert!(fs::read(made.index()).unwrap() == before);
    }
}
