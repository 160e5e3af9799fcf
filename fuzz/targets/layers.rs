//! Files of several layers: each layer is queried; the file is verified, converted, combined,
//! edited, and its layers are dropped.

use std::path::{Path, PathBuf};

use spinney::edit::{Edit, Editor, Note};
use spinney::raw::dataset;
use spinney::raw::ops::{self, apply_edits};
use spinney::raw::store::FileReference;
use spinney::raw::store::autumnal::{CompactOptions, History, Keep, compact};
use spinney::{
    Bounds, CombineOperation, CombineOptions, Dataset, Error, FileView, Header, OpenOptions, Output, Result,
    WriteOptions,
};

use super::files::in_file;
use super::seal;
use super::trees::{MAX_RECORDS, fast_queries, is_good, slow_queries};

/// Maximum number of layers that are queried.
const MAX_LAYERS: usize = 8;
const MEMORY: u64 = 1 << 20;

/// A Goblin file of any number of layers, whose checksums are corrected.
pub fn goblin_layers(bytes: &[u8]) {
    let mut file = bytes.to_vec();
    seal::goblin_end(&mut file);
    seal::goblin(&mut file);
    query_goblin_layers(&file);
}

/// Runs all queries of a Goblin file and its layers.
pub fn query_goblin_layers(file: &[u8]) {
    in_file("layers.goblin", file, |path| query_layers(path, "converted.autumn"));
}

/// An Autumnal file of any number of layers, packed (see [`seal::packed`]), whose checksums are
/// corrected.
pub fn autumnal_layers(bytes: &[u8]) {
    if let Some(file) = seal::unpacked(bytes) {
        query_autumnal_layers(&file);
    }
}

/// Runs all queries of an Autumnal file and its layers, and edits them.
pub fn query_autumnal_layers(file: &[u8]) {
    in_file("layers.autumn", file, |path| query_layers(path, "converted.goblin"));
}

fn open(path: &Path) -> Result<Dataset> {
    dataset::open(path, &OpenOptions::new())
}

/// Returns the number of layers of a file, and the first few of them opened.
fn layers(tree: &Dataset) -> Result<(usize, Vec<Dataset>)> {
    let layers = tree.layers()?;
    let opened = layers.iter().take(MAX_LAYERS).map(|layer| tree.layer(&layer.name));
    Ok((layers.len(), opened.collect::<Result<_>>()?))
}

/// Runs all queries of a file. If verification finds no defects, no query may fail, and files
/// derived from it have the same cells.
fn query_layers(path: &Path, converted: &str) {
    let Ok(tree) = open(path) else { return };
    let (count, trees) = match layers(&tree) {
        Ok(layers) => layers,
        Err(_) => {
            // The layers that can still be opened.
            (0..MAX_LAYERS).for_each(|number| {
                if let Ok(layer) = tree.layer(&number.to_string()) {
                    let _ = fast_queries(&layer);
                }
            });
            return;
        }
    };
    let quick: Vec<Result<bool>> = trees.iter().map(fast_queries).collect();
    let is_small = |tree: &Dataset| {
        matches!(tree.level_counts(MAX_RECORDS, &()), Ok(Some(_))) && tree.stored_records() <= MAX_RECORDS
    };
    if count > MAX_LAYERS || !trees.iter().all(is_small) {
        return;
    }
    let slow: Vec<Result<bool>> = trees.iter().map(slow_queries).collect();
    let was_good = is_good(&tree);
    if was_good {
        assert!(quick.into_iter().all(Result::unwrap), "a window and a point differ");
        assert!(slow.into_iter().all(Result::unwrap), "statistics and counts differ");
    }
    let target = |name: &str| {
        let target = path.with_file_name(name);
        let _ = std::fs::remove_file(&target);
        target
    };
    let other = target(converted);
    let made = Output::create(&other)
        .and_then(|output| spinney::convert(path, false, output, WriteOptions::new(MEMORY), &()));
    if was_good {
        made.unwrap();
        same(&other, &trees, "conversion");
    }
    // (The metadata of the frame may not allow it.)
    let (joined, files) = (target("combined.goblin"), [path, path].map(PathBuf::from));
    let _ = Output::create(&joined).and_then(|output| {
        spinney::combine(
            CombineOperation::Over,
            CombineOptions::default(),
            &files,
            output,
            WriteOptions::new(MEMORY),
            &(),
        )
    });
    let has_changed = match converted.ends_with("goblin") {
        true => change_autumnal(path, was_good, &trees),
        false => change_goblin(path, &trees),
    };
    if was_good {
        has_changed.unwrap();
        assert!(is_good(&open(path).unwrap()), "a valid file is corrupt after a change");
    }
}

/// Asserts that a file has the same cells as some layers, and is valid.
fn same(path: &Path, expected: &[Dataset], what: &str) {
    let tree = open(path).unwrap();
    assert!(is_good(&tree), "{what}: the file is corrupt");
    let (count, found) = layers(&tree).unwrap();
    assert_eq!(count, expected.len(), "{what}");
    for (found, expected) in found.iter().zip(expected) {
        // (The division of a tree into segments depends on the writer.)
        let [a, b] =
            [found, expected].map(|tree| Header { shape: expected.header().shape, ..tree.header().clone() });
        assert!(a == b && found.depth() == expected.depth(), "{what}");
        let cells = |tree: &Dataset| {
            let size = tree.header().extent.map(|cells| cells.min(64));
            let bounds = Bounds::of_extent(size);
            let mut bytes = vec![0; bounds.volume() as usize * tree.header().form.width()];
            tree.window(tree.depth(), &bounds, 0.0, &mut bytes, None).unwrap();
            let statistics = tree.statistics(None, &()).unwrap();
            (bytes, statistics.cells, format!("{:?}", statistics.classes))
        };
        assert!(cells(found) == cells(expected), "{what}: cells differ");
    }
}

/// Drops a layer of a Goblin file, and adds it again.
fn change_goblin(path: &Path, trees: &[Dataset]) -> Result<()> {
    let name = trees[0].metadata().name.clone();
    let copy = path.with_file_name("copy.goblin");
    std::fs::copy(path, &copy).map_err(Error::io(path, "copy"))?;
    if trees.len() > 1 {
        ops::drop_layer(path, &name, Note::default(), &Default::default(), &())?;
    }
    // (Frames may not match.)
    let chain = FileView::of(&FileReference::of(&copy).of_layer(&name));
    let _ = ops::add_layer(path, "again", &chain, Note::default(), WriteOptions::new(MEMORY), &());
    Ok(())
}

/// Edits all layers of an Autumnal file, drops one, reverts, and compacts.
fn change_autumnal(path: &Path, was_good: bool, trees: &[Dataset]) -> Result<()> {
    let history = History::open(path, &OpenOptions::new())?;
    history.commits().take(100).for_each(drop);
    let newest = trees[0].commit().map_or(0, |commit| commit.number);
    drop(history);
    // (There must be a next commit number.)
    if newest > u64::MAX - 8 {
        return Ok(());
    }
    let mut editor = Editor::open(path, MEMORY)?;
    for layer in trees {
        editor.select(&layer.metadata().name)?;
        let set = Edit::Set(vec![([0; 3], Some(vec![7.into()]))]);
        apply_edits(&mut editor, &mut [Ok(set)].into_iter(), &())?;
    }
    editor.commit(Note::default())?;
    if trees.len() > 1 {
        editor.drop_layer(&trees[0].metadata().name)?;
        editor.commit(Note::default())?;
    }
    editor.revert(newest)?;
    editor.commit(Note::default())?;
    drop(editor);
    let small = path.with_file_name("small.autumn");
    let _ = std::fs::remove_file(&small);
    for target in [path, &small] {
        if was_good {
            same(target, trees, "revert");
        }
        if target == path {
            let output = Output::create(&small)?;
            compact(path, &CompactOptions::new(&Keep::Last(2), MEMORY).share(true), output, &())?;
        }
    }
    Ok(())
}
