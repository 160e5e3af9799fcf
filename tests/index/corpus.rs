//! Indexes of the files of other projects' tests equal the trees of these files.

use std::fs;
use std::path::{Path, PathBuf};

use spinney::import::raster::StackOptions;
use spinney::raw::import::raster::{self, RasterOptions, needs_layers};
use spinney::{Bounds, Dataset, Error};

use crate::common::{shared_data, with};
use crate::compare::{Directory, MEMORY, build, indexed, open, stack, window};
use spinney::import::raster::ImportOptions;

/// Size in bytes of files that take too long here.
const MAX_BYTES: u64 = 1 << 20;
/// Cells of such files.
const MAX_CELLS: u64 = 1 << 22;

/// Lists the TIFF files below a directory.
fn list(directory: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> =
        fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let name = path.to_string_lossy().to_lowercase();
        if path.is_dir() {
            list(&path, found);
        } else if [".tif", ".tiff", ".vrt"].iter().any(|extension| name.ends_with(extension))
            && fs::metadata(&path).is_ok_and(|file| file.len() <= MAX_BYTES)
        {
            found.push(path);
        }
    }
}

/// Makes a tree or an index of a file, with layers if it needs them.
fn make(source: &Path, output: &Path, options: ImportOptions) -> Result<Dataset, Error> {
    let source = [source.to_path_buf()];
    match needs_layers(&source, &options)? {
        true => stack(&source, output, &with(StackOptions::new(), |it| it.import = options))?,
        false => build(&source, output, &options)?,
    }
    Ok(open(output))
}

/// Compares the cells of all levels, and statistics.
fn assert_equal_cells(index: &Dataset, tree: &Dataset, what: &str) {
    for level in 0..=tree.depth() {
        let [width, height, _] = tree.extent_at(level).max;
        for top in (0..height).step_by(512) {
            let bounds = Bounds { min: [0, top, 0], max: [width, (top + 512).min(height), 1] };
            let [found, expected] = [index, tree].map(|tree| window(tree, level, &bounds).unwrap());
            assert!(found == expected, "{what}: level {level}");
        }
    }
    // (NaN is not equal to itself.)
    let sums = |tree: &Dataset| with(tree.statistics(None, &()).unwrap(), |it| it.segments_read = 0);
    assert_eq!(format!("{:?}", sums(index)), format!("{:?}", sums(tree)), "{what}");
}

/// Compares a file's index with its tree. Returns what happened.
fn check(source: &Path, directory: &Directory) -> &'static str {
    let what = source.display().to_string();
    let size = raster::open(source, &RasterOptions::new()).map(|it| it.info().width * it.info().height);
    if size.is_ok_and(|cells| cells > MAX_CELLS) {
        return "large";
    }
    let [made, whole] = ["x.goblin", "whole.goblin"].map(|name| directory.path(name));
    let Ok(tree) = make(source, &whole, ImportOptions::new()) else { return "no tree" };
    let index = match make(source, &made, indexed(2)) {
        Ok(index) => index,
        Err(error @ Error::Unsupported { .. }) => {
            println!("{error}");
            return "no index";
        }
        Err(error) => panic!("{what}: {error:?}"),
    };
    for layer in tree.layers().unwrap() {
        let [index, tree] = [&index, &tree].map(|file| file.layer(&layer.name).unwrap());
        assert_eq!(index.verify(MEMORY, &()).unwrap(), [], "{what}");
        assert_equal_cells(&index, &tree, &what);
    }
    "equal"
}

#[test]
fn real_files() {
    let Some(data) = shared_data() else { return };
    let mut files = Vec::new();
    list(&data.join("raster"), &mut files);
    let directory = Directory::new();
    let mut counts = std::collections::BTreeMap::new();
    for file in &files {
        let found = check(file, &directory);
        *counts.entry(found).or_insert(0) += 1;
    }
    println!("{counts:?}");
    assert!(
        files.is_empty() || counts["equal"] > counts.get("no index").copied().unwrap_or(0) * 5,
        "{counts:?}"
    );
}
