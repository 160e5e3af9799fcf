//! Edits of Autumnal files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

use super::affine::{AffineMap, View, align};
use super::combine::Combined;
use super::files::FileView;
use super::operation::CombineOperation;
use super::patch::{CellPatch, FillPatch, FillRegion, Patch};
use super::patched::Patched;
use super::tree_file::TreeFile;
use super::view_source::{ViewSource, check_form};
use crate::store::Packing;
use crate::store::autumnal::{Autumnal, Commit, Editor, Note};
use crate::tree::Source;
use spinney_base::space::Bounds;
use spinney_base::value::{Number, Value, ValueType};
use spinney_base::{Error, Progress, Result};

/// A change to a tree.
#[derive(Clone, Debug)]
pub enum Edit {
    /// Puts another tree over a part of it.
    Paste {
        /// The other tree: a file and the steps done to it.
        patch: FileView,
        /// The cell that its first one goes to; where it lies in the world if none is given.
        at: Option<[i64; 3]>,
        /// Only where the other tree is not VOID.
        where_valid: bool,
    },
    /// Fills a region with one value (a sample per channel, or one for all), or makes it VOID.
    Fill(FillRegion, Option<Vec<Number>>),
    /// Gives single cells new values.
    Set(Vec<CellValue>),
    /// Makes it what an operation makes of it and another tree, which lies where it lies in the world.
    Apply(CombineOperation, PathBuf),
    /// Puts a tree on the same cells over it, where that has something.
    Cover(Arc<ViewSource>),
    /// Makes it what an operation makes of it and a tree on the same cells.
    Merge(CombineOperation, Arc<ViewSource>),
    /// Makes it what it was in another commit.
    Revert(u64),
}

/// A cell and its value: a sample per channel, or VOID.
pub type CellValue = ([u64; 3], Option<Vec<Number>>);

/// Does some edits, one after the other, and makes them one commit; `None` if nothing has changed. [`Editor::open_with`] and
/// [`apply_edits`] do the same with another access to files than the default.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::edit::{Edit, Note};
/// use spinney::raw::ops;
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("history.autumn");
/// # std::fs::copy("fixtures/v1/history.autumn", &path).unwrap();
/// let edits = [Edit::Set(vec![([0, 0, 0], Some(vec![7.into()]))])];
/// let commit = spinney::edit::edit(&path, edits.map(Ok), Note::default(), 64 << 20, &())?;
/// assert!(commit.is_some());
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If another process edits the file, an edit cannot be done, the file not be written, or on interruption.
/// The file's last commit is then what it was.
pub fn edit(
    path: &Path,
    edits: impl IntoIterator<Item = Result<Edit>>,
    note: Note,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Option<Commit>> {
    let mut editor = Editor::open(path, memory)?;
    apply_edits(&mut editor, &mut edits.into_iter(), progress)?;
    editor.commit(note)
}

/// Does some edits, one after the other, in a file that is open for editing; nobody sees them before they are
/// committed.
///
/// # Errors
/// If an edit cannot be done, the file not be written, or on interruption.
pub fn apply_edits(
    editor: &mut Editor,
    edits: &mut dyn Iterator<Item = Result<Edit>>,
    progress: &dyn Progress,
) -> Result<()> {
    let tree = editor.tree();
    if let Some(remark) = tree.remark() {
        progress.warn(tree.path(), remark);
    }
    drop(tree);
    for edit in edits {
        match edit? {
            Edit::Revert(number) => editor.revert(number)?,
            edit => {
                let changed = changed(editor.tree(), edit)?;
                editor.replace(&changed, Packing::default(), progress)?;
            }
        }
        progress.check()?;
    }
    Ok(())
}

/// The tree after an edit, as a source; nodes that stay are the tree's own, with their stored records.
fn changed(tree: Arc<Autumnal>, edit: Edit) -> Result<Combined> {
    let (form, depth, extent) = (tree.header().form, tree.header().depth(), tree.header().extent);
    let value_type = form.value;
    let (operation, views) = match edit {
        Edit::Revert(_) => unreachable!("is no new tree"),
        Edit::Fill(region, value) => {
            let value = value_or_void(value_type, &value)?.filter(|value| !value_type.is_nan(*value));
            (CombineOperation::Over, vec![patched(&tree, Arc::new(FillPatch::new(region, extent, value)?))?])
        }
        Edit::Set(cells) => {
            let cells = cells.iter().map(|(cell, value)| Ok((*cell, value_or_void(value_type, value)?)));
            let cells = cells.collect::<Result<Vec<_>>>()?;
            (
                CombineOperation::Over,
                vec![patched(&tree, Arc::new(CellPatch::new(form, depth, extent, cells)?))?],
            )
        }
        Edit::Paste { patch, at, where_valid } => {
            (CombineOperation::Over, pasted(&tree, &patch, at, where_valid)?)
        }
        Edit::Apply(operation, path) => {
            let file = TreeFile::open_only(&path, &tree.access().into())?;
            check_form((&path, file.form()), (tree.path(), form))?;
            let whole_file = View::whole(file.into())?;
            let (view, bounds) = aligned(whole_file, &tree, &path)?;
            check_place(&bounds, extent, &path)?;
            (operation, vec![View::whole(tree.into())?.opaque()?, view.deepened(depth)?.opaque()?])
        }
        Edit::Cover(other) => {
            (CombineOperation::Over, vec![View::new(other, extent)?, View::whole(tree.into())?])
        }
        Edit::Merge(operation, other) => {
            (operation, vec![View::whole(tree.into())?.opaque()?, View::new(other, extent)?.opaque()?])
        }
    };
    Combined::new(views, operation, extent)
}

/// All of a tree with a patch on it.
fn patched(tree: &Arc<Autumnal>, patch: Arc<dyn Patch>) -> Result<View> {
    View::whole(Patched::new(tree.clone(), patch).into())
}

/// Views for a paste: the pasted tree first, then the tree that it goes over.
fn pasted(
    tree: &Arc<Autumnal>,
    patch: &FileView,
    at: Option<[i64; 3]>,
    where_valid: bool,
) -> Result<Vec<View>> {
    let (depth, extent) = (tree.header().depth(), tree.header().extent);
    let view = patch.open()?;
    check_form((&patch.path, view.form()), (tree.path(), tree.header().form))?;
    let (view, bounds) = match at {
        Some(at) => {
            let size = view.extent();
            let moved = AffineMap::translation(at.map(|cells| cells as f64));
            let end = |axis: usize| at[axis].saturating_add_unsigned(size[axis]).max(0) as u64;
            let min = at.map(|cell| cell.max(0) as u64);
            (view.onto(&moved, extent)?, Bounds { min, max: std::array::from_fn(end) })
        }
        None => aligned(view, tree, &patch.path)?,
    };
    let bounds = check_place(&bounds, extent, &patch.path)?;
    let (view, below) = if where_valid {
        (view.opaque()?, View::whole(tree.clone().into())?)
    } else {
        // What is VOID in the patch becomes VOID in the tree: first all of the box does.
        (view, patched(tree, Arc::new(FillPatch::new(FillRegion::Box(bounds), extent, None)?))?)
    };
    Ok(vec![view.deepened(depth)?, below])
}

/// The part of a box of cells that lies in a tree; an error if nothing does.
fn check_place(bounds: &Bounds, extent: [u64; 3], path: &Path) -> Result<Bounds> {
    let inside = bounds.intersect(&Bounds::picture(extent));
    if inside.is_empty() {
        let found = "a place outside of the tree";
        return Err(Error::invalid(path.display().to_string(), found, "one that is at least partly inside"));
    }
    Ok(inside)
}

/// A view resampled to the cell grid of a tree by both frames, and its box of cells there.
fn aligned(view: View, tree: &Autumnal, path: &Path) -> Result<(View, Bounds)> {
    let (frame, extent) = (view.frame(false), tree.header().extent);
    let (own, name) = (tree.path().display().to_string(), path.display().to_string());
    let alignments = align(&[(&own, &tree.metadata().frame, extent), (&name, &frame, view.extent())])?;
    // `align` maps both to a common grid that has room for both and the finer of their cells: from the view's
    // cells to that grid and back to the tree's cells.
    let back = alignments[0].map.inverse()?;
    let map = alignments[1].map.then(&back);
    let end = DVec3::from(view.extent().map(|cells| cells as f64));
    let (low, high) = map.bounding_box(DVec3::ZERO, end);
    let cell = |number: f64| number.round().max(0.0) as u64;
    let bounds = Bounds { min: low.to_array().map(cell), max: high.to_array().map(cell) };
    Ok((view.onto(&map, extent)?, bounds))
}

/// The value with these samples, or with one sample for all channels.
fn value_of(value_type: ValueType, samples: &[Number]) -> Result<Value> {
    let ValueType { sample, channels, .. } = value_type;
    let fits = samples.len() == 1 || samples.len() == usize::from(channels);
    let exact = samples.iter().all(|number| sample.can_hold(*number) || sample.is_float());
    if !fits || !exact {
        let expected = format!("1 or {channels} numbers that {value_type} can hold");
        let found = samples.iter().map(Number::to_string).collect::<Vec<_>>().join(", ");
        return Err(Error::invalid("value", format!("[{found}]"), expected));
    }
    Ok(value_type.nearest_numbers(|channel| *samples.get(channel).unwrap_or(&samples[0])))
}

fn value_or_void(value_type: ValueType, samples: &Option<Vec<Number>>) -> Result<Option<Value>> {
    samples.as_ref().map(|samples| value_of(value_type, samples)).transpose()
}
