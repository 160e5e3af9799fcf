//! Sources that are missing, truncated, replaced or corrupt: results that do not need them come,
//! and others are errors.

use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime};

use spinney::{Bounds, Dataset, Error, FileAccess, OpenOptions};

use crate::common::command::{complaint, spinney, stderr, stdout};
use crate::compare::{Directory, assert_equal, index, open, tree, update, window};
use crate::tiffs::{Chunks, Packing, Tiff};

/// Cells along a side of a block.
const BLOCK: u64 = 256;

/// An index of a file of 700 x 600 pixels, and the tree.
struct Case {
    directory: Directory,
    tiff: Tiff,
    whole: Dataset,
}

/// Warnings of a file that was opened.
type Warnings = Arc<Mutex<Vec<String>>>;

impl Case {
    fn new(packing: Packing) -> Case {
        let directory = Directory::new();
        // (Noise: no block has one value.)
        let mut tiff = Tiff { packing, chunks: Chunks::Tiles(64, 64), ..Tiff::new([700, 600], 2) };
        for (at, sample) in tiff.pixels.iter_mut().enumerate() {
            *sample = ((at as u64 * 2_654_435_761) >> 20) % 9;
        }
        let [source, made, whole] = ["a.tif", "x.goblin", "whole.goblin"].map(|name| directory.path(name));
        tiff.write(&source);
        index(std::slice::from_ref(&source), &made);
        tree(&[source], &whole);
        let whole = open(&whole);
        Case { directory, tiff, whole }
    }

    /// Opens the index with caches of its own, and records warnings.
    fn open(&self) -> (Dataset, Warnings) {
        let warnings = Warnings::default();
        let known = warnings.clone();
        let note =
            move |file: &Path, text: &str| known.lock().unwrap().push(format!("{}: {text}", file.display()));
        let access = FileAccess::new().unpacked_cache(16 << 20).on_warning(Arc::new(note));
        let options = OpenOptions::new().access(access);
        (spinney::open_with(self.directory.path("x.goblin"), &options).unwrap(), warnings)
    }

    /// Runs queries: those without cells must succeed; returns the blocks whose cells cannot be
    /// read. Their errors contain all of some words.
    fn failures(&self, words: &[&str]) -> Vec<[u64; 2]> {
        let (tree, _) = self.open();
        let (depth, extent) = (tree.depth(), tree.header().extent);
        for level in 0..=depth - 2 {
            let all = tree.extent_at(level);
            assert!(window(&tree, level, &all).unwrap() == window(&self.whole, level, &all).unwrap());
        }
        let all = Bounds::of_extent(extent);
        for bounds in [None, Some(all), Some(Bounds { min: [0; 3], max: [512, 256, 1] })] {
            let sums = |tree: &Dataset| {
                let found = tree.statistics(bounds, &()).unwrap();
                (found.cells, found.classes, found.channels)
            };
            assert_eq!(sums(&tree), sums(&self.whole));
        }
        let mut failures = Vec::new();
        let check = |error: Error| {
            let text = error.to_string();
            assert!(words.iter().all(|word| text.contains(word)), "{text}");
        };
        for y in (0..extent[1]).step_by(BLOCK as usize) {
            for x in (0..extent[0]).step_by(BLOCK as usize) {
                let max = [(x + BLOCK).min(extent[0]), (y + BLOCK).min(extent[1]), 1];
                let bounds = Bounds { min: [x, y, 0], max };
                let expected = window(&self.whole, depth, &bounds).unwrap();
                match window(&tree, depth, &bounds) {
                    Ok(found) => assert!(found == expected, "{bounds:?}: other cells"),
                    Err(error) => {
                        check(error);
                        failures.push([x / BLOCK, y / BLOCK]);
                    }
                }
                // (Half the way down, cells are needed as well.)
                let half = Bounds {
                    min: bounds.min.map(|at| at / 2),
                    max: [max[0].div_ceil(2), max[1].div_ceil(2), 1],
                };
                let is_bad = failures.last() == Some(&[x / BLOCK, y / BLOCK]);
                match window(&tree, depth - 1, &half) {
                    Ok(found) => assert!(!is_bad && found == window(&self.whole, depth - 1, &half).unwrap()),
                    Err(error) => {
                        assert!(is_bad);
                        check(error);
                    }
                }
            }
        }
        assert_eq!(window(&tree, depth, &all).is_err(), !failures.is_empty());
        let findings = tree.verify(1 << 20, &());
        assert_eq!(findings.is_ok_and(|findings| findings.is_empty()), failures.is_empty());
        failures
    }
}

/// All blocks of the case's index.
const ALL: [[u64; 2]; 9] = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1], [0, 2], [1, 2], [2, 2]];

#[test]
fn a_missing_source_fails_only_queries_of_cells() {
    let case = Case::new(Packing::Deflate);
    assert_eq!(case.failures(&[]), [] as [[u64; 2]; 0]);
    fs::remove_file(case.directory.path("a.tif")).unwrap();
    assert_eq!(case.failures(&["a.tif"]), ALL);
    let (name, quick) = (case.directory.name("x.goblin"), ["verify", "--quick"]);
    let message = stdout_of_failure(&[quick[0], quick[1], &name]);
    assert!(message.contains("a.tif") && message.contains("missing"), "{message}");
    spinney(&["stats", &name, "--bins", "0"]).success();
    let message = complaint(&["get", &name, &case.directory.name("o.npy")], 1);
    assert!(message.contains("a.tif"), "{message}");
}

/// Returns the standard output of a run that fails.
fn stdout_of_failure(arguments: &[&str]) -> String {
    String::from_utf8(spinney(arguments).code(1).get_output().stdout.clone()).unwrap()
}

const CHANGED: [&str; 2] = ["a.tif", "spinney index --update"];

#[test]
fn truncated_sources() {
    for packing in [Packing::None, Packing::Deflate] {
        let case = Case::new(packing);
        let bytes = case.tiff.bytes();
        for part in [0, 8, bytes.len() / 2, bytes.len() * 2 / 3, bytes.len() - 1] {
            fs::write(case.directory.path("a.tif"), &bytes[..part]).unwrap();
            let failures = case.failures(&CHANGED);
            // (The last bytes are tags, which are not read.)
            match part {
                0..=8 => assert_eq!(failures, ALL),
                _ if part == bytes.len() - 1 => assert_eq!(failures, [] as [[u64; 2]; 0]),
                _ => assert!(!failures.is_empty() && failures.len() < ALL.len(), "{part}: {failures:?}"),
            }
        }
    }
}

#[test]
fn replaced_sources() {
    for packing in [Packing::None, Packing::Deflate] {
        let case = Case::new(packing);
        let source = case.directory.path("a.tif");
        // Other pixels in the same layout; without compression even the same bytes of tags.
        let mut other = case.tiff.clone();
        other.pixels.iter_mut().for_each(|sample| *sample += 1);
        other.write(&source);
        assert_eq!(case.failures(&CHANGED), ALL);
        // Another layout.
        Tiff { chunks: Chunks::Strips(10), ..case.tiff.clone() }.write(&source);
        assert_eq!(case.failures(&CHANGED), ALL);
        fs::write(&source, "text").unwrap();
        assert_eq!(case.failures(&CHANGED), ALL);
        // Other pixels in one tile.
        let mut other = case.tiff.clone();
        other.fill([300, 20], [5, 5], 77);
        other.write(&source);
        let failures = case.failures(&CHANGED);
        match packing {
            Packing::None => assert_eq!(failures, [[1, 0]]),
            // (All later tiles are at other offsets.)
            _ => assert!(failures.contains(&[1, 0]) && failures.contains(&[2, 2]), "{failures:?}"),
        }
        let [made, whole] = ["x.goblin", "whole.goblin"].map(|name| case.directory.path(name));
        update(&made, &made, |_| {}).unwrap();
        tree(&[source], &whole);
        assert_equal(&made, &whole, "updated");
    }
}

#[test]
fn a_corrupt_tile_fails_only_its_blocks() {
    let case = Case::new(Packing::Deflate);
    let source = case.directory.path("a.tif");
    let bytes = case.tiff.bytes();
    // (Tiles come first, row by row.)
    for (at, failed) in [(10, &[[0, 0]][..]), (bytes.len() * 3 / 4, &[])] {
        let mut corrupt = bytes.clone();
        corrupt[at] ^= 4;
        fs::write(&source, corrupt).unwrap();
        let failures = case.failures(&CHANGED);
        assert!(failures.len() == 1 && (failed.is_empty() || failures == failed), "{failures:?}");
    }
    // One bit of any byte: the tile that has it, or none.
    for at in (0..bytes.len()).step_by(bytes.len() / 20) {
        let mut corrupt = bytes.clone();
        corrupt[at] ^= 1;
        fs::write(&source, corrupt).unwrap();
        assert!(case.failures(&CHANGED).len() <= 2, "byte {at}");
    }
}

#[test]
fn touched_and_copied_sources_work_with_a_warning() {
    let case = Case::new(Packing::Lzw);
    let source = case.directory.path("a.tif");
    let read_all = |tree: &Dataset| {
        for x in [0, 100, 300, 600] {
            let bounds = Bounds { min: [x, x / 2, 0], max: [x + 50, x / 2 + 60, 1] };
            let found = window(tree, tree.depth(), &bounds).unwrap();
            assert!(found == window(&case.whole, tree.depth(), &bounds).unwrap());
        }
    };
    let (tree, warnings) = case.open();
    read_all(&tree);
    assert_eq!(*warnings.lock().unwrap(), [] as [String; 0]);
    let time = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000);
    let touch =
        |path: &Path| fs::File::options().append(true).open(path).unwrap().set_modified(time).unwrap();
    touch(&source);
    let (tree, warnings) = case.open();
    read_all(&tree);
    {
        let warnings = warnings.lock().unwrap();
        assert!(warnings.len() == 1 && warnings[0].contains("a.tif"), "{warnings:?}");
    }
    fs::create_dir(case.directory.path("copy")).unwrap();
    for name in ["a.tif", "x.goblin"] {
        fs::copy(case.directory.path(name), case.directory.path(&format!("copy/{name}"))).unwrap();
    }
    let name = case.directory.name("copy/x.goblin");
    let output = case.directory.name("o.npy");
    let said = stderr(spinney(&["get", &name, &output]).success());
    assert_eq!(said.matches("checksums in the index").count(), 1, "{said}");
    assert!(stdout(&["verify", &name]).contains("good"));
    // A coarse view reads no source.
    let said = stderr(spinney(&["get", &name, &output, "--level", "5"]).success());
    assert!(!said.contains("a.tif"), "{said}");
}
