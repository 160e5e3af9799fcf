//! Edited Autumnal files: a valid file stays valid, and has the result of the edits.

use std::sync::Arc;

use spinney::edit::{Edit, Editor, FillRegion, Note};
use spinney::raw::dataset;
use spinney::raw::ops::apply_edits;
use spinney::raw::store::autumnal::{Autumnal, CompactOptions, History, Keep, compact, recover};
use spinney::{Bounds, Dataset, Error, Number, OpenOptions, Output, Result};

use super::disk::Disk;
use super::files::in_file;
use super::seal;
use super::trees::is_good;

/// Bytes before the file that describe the edits.
const SCRIPT: usize = 8;
/// Maximum number of cells along an axis of files whose cells are compared.
const SIDE: u64 = 16;
const MEMORY: u64 = 1 << 20;
/// Maximum number of records of trees that are verified: with shared subtrees a small file can have
/// exponentially many.
const MAX_RECORDS: u64 = 1 << 12;

/// A script of edits and an Autumnal file, packed (see [`seal::packed`]): edited on a disk in
/// memory, and verified.
pub fn autumnal_edit(bytes: &[u8]) {
    let Some((script, packed)) = bytes.split_at_checked(SCRIPT) else { return };
    if let Some(file) = seal::unpacked(packed) {
        edit_as(script, file);
    }
}

/// Edits a file by a script, on a disk in memory.
pub fn edit_as(script: &[u8], file: Vec<u8>) {
    // (An editor waits for a moment if another process seems to be writing to the file.)
    if Autumnal::from_bytes(file.clone()).is_err() && !crc32c::crc32c(&file).is_multiple_of(32) {
        return;
    }
    let was_good = open(&file).is_some_and(|tree| is_good(&tree));
    let before = open(&file).and_then(|tree| cells(&tree));
    let disk = Disk::new(file);
    let Ok(mut editor) = disk.editor() else { return };
    let changed = change(&mut editor, script, before);
    drop(editor);
    let file = disk.state().bytes.clone();
    if was_good {
        let expected = changed.unwrap();
        let tree = Autumnal::from_bytes(file).and_then(|file| Dataset::of(Arc::new(file).into())).unwrap();
        assert_eq!(tree.verify(MEMORY, &()).unwrap(), [], "a valid file is corrupt after an edit");
        assert_eq!(cells(&tree), expected, "the cells after an edit differ");
    }
}

/// Returns the newest commit of a file, unless its tree is too large to be read.
fn open(file: &[u8]) -> Option<Dataset> {
    let file = Autumnal::from_bytes(file.to_vec()).ok()?;
    file.level_counts(MAX_RECORDS, &()).ok()??;
    Dataset::of(Arc::new(file).into()).ok()
}

/// Applies a script; returns the expected cells.
fn change(editor: &mut Editor, script: &[u8], cells: Option<EditedCells>) -> Result<Option<EditedCells>> {
    let mut cells = cells;
    for step in script.chunks(4) {
        let [what, x, y, value] = step.try_into().unwrap_or_default();
        let extent = editor.tree().header().extent;
        let at: [u64; 3] = [x, y, y].map(u64::from);
        let at = std::array::from_fn(|axis| at[axis] % extent[axis]);
        match what % 4 {
            0 => {
                let set = Edit::Set(vec![(at, sample(value))]);
                apply_edits(editor, &mut [Ok(set)].into_iter(), &())?;
                fill(&mut cells, Bounds { min: at, max: at.map(|at| at + 1) }, value);
            }
            1 | 2 => {
                let added = u64::from(what);
                let max = std::array::from_fn(|axis| (at[axis] + 1 + added).min(extent[axis]));
                let bounds = Bounds { min: at, max };
                let edit = Edit::Fill(FillRegion::Box(bounds), sample(value));
                apply_edits(editor, &mut [Ok(edit)].into_iter(), &())?;
                fill(&mut cells, bounds, value);
            }
            _ => {
                // The cells of another commit are not known here.
                apply_edits(editor, &mut [Ok(Edit::Revert(value.into()))].into_iter(), &()).or_else(
                    |error| {
                        if matches!(error, Error::Invalid { .. }) { Ok(Vec::new()) } else { Err(error) }
                    },
                )?;
                cells = Dataset::of(editor.tree().into()).ok().and_then(|tree| self::cells(&tree));
            }
        }
        if what & 128 != 0 {
            editor.commit(Note::default())?;
        }
    }
    editor.commit(Note::default())?;
    Ok(cells)
}

/// Returns a number as all samples of a value; multiples of 8 are VOID.
fn sample(value: u8) -> Option<Vec<Number>> {
    (!value.is_multiple_of(8)).then(|| vec![value.into()])
}

/// The cells of a small tree: its size, bytes of the values, and which cells are not VOID.
#[derive(Clone, Debug, PartialEq)]
struct EditedCells {
    size: [u64; 3],
    values: Vec<Vec<u8>>,
    /// Bytes of the value for each number that a script can have.
    of_number: Vec<Vec<u8>>,
}

/// Returns all cells of a tree, if they are few.
fn cells(tree: &Dataset) -> Option<EditedCells> {
    let (header, size) = (tree.header(), tree.header().extent);
    if size.iter().any(|cells| *cells > SIDE) {
        return None;
    }
    let (bounds, width) = (Bounds::of_extent(size), header.form.width());
    let count = bounds.volume() as usize;
    let (mut bytes, mut valid) = (vec![0; count * width], vec![false; count]);
    tree.window(tree.depth(), &bounds, 0.0, &mut bytes, Some(&mut valid)).ok()?;
    let values =
        bytes.chunks(width).zip(valid).map(|(value, valid)| if valid { value.to_vec() } else { vec![] });
    let of_number = (0..=255u8).map(|number| match number % 8 {
        0 => vec![],
        _ => header.form.value.nearest(|_| f64::from(number)).to_bytes()[..width].to_vec(),
    });
    Some(EditedCells { size, values: values.collect(), of_number: of_number.collect() })
}

fn fill(cells: &mut Option<EditedCells>, bounds: Bounds, number: u8) {
    let Some(cells) = cells else { return };
    let value = cells.of_number[usize::from(number)].clone();
    for z in bounds.min[2]..bounds.max[2] {
        for y in bounds.min[1]..bounds.max[1] {
            for x in bounds.min[0]..bounds.max[0] {
                cells.values[((z * cells.size[1] + y) * cells.size[0] + x) as usize] = value.clone();
            }
        }
    }
}

/// A script and an Autumnal file, packed, on a real disk: its commits are listed, it is recovered,
/// edited, compacted and verified.
pub fn autumnal_file(bytes: &[u8]) {
    let Some((script, packed)) = bytes.split_at_checked(SCRIPT) else { return };
    let Some(file) = seal::unpacked(packed) else { return };
    let is_small = open(&file).is_some();
    if Autumnal::from_bytes(file.clone()).is_err() && !crc32c::crc32c(&file).is_multiple_of(32) {
        return;
    }
    in_file("t.autumn", &file, |path| {
        if let Ok(history) = History::open(path, &OpenOptions::new()) {
            history.commits().take(100).for_each(drop);
            let _ = history.commit(script[0].into());
        }
        if recover(path, (script[0] % 8).into(), &Default::default(), &()).is_ok() {
            Autumnal::open(path, &OpenOptions::new()).unwrap();
        }
        if !is_small {
            return;
        }
        let Ok(tree) = dataset::open(path, &OpenOptions::new()) else { return };
        let was_good = is_good(&tree);
        drop(tree);
        let edited = Editor::open(path, MEMORY).and_then(|mut editor| change(&mut editor, script, None));
        let small = path.with_file_name("small.autumn");
        let _ = std::fs::remove_file(&small);
        let keep = Keep::Last(1 + u64::from(script[1] % 4));
        let pack = script[2] & 2 == 0;
        let options = CompactOptions::new(&keep, MEMORY).share(script[2] % 2 == 0).pack(pack);
        let made = Output::create(&small).and_then(|output| compact(path, &options, output, &()));
        if was_good {
            edited.unwrap();
            let made = made.unwrap();
            let tree = dataset::open(&small, &OpenOptions::new()).unwrap();
            assert!(is_good(&tree), "the compacted file is corrupt");
            assert_eq!(tree.commit().map(|commit| commit.number), made.last().map(|commit| commit.number));
        }
        let _ = std::fs::remove_file(&small);
    });
}
