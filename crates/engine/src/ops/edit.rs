//! Edits of Autumnal files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::affine::View;
use super::combine::Combined;
use super::files::FileView;
use super::operation::CombineOperation;
use super::patch::{CellPatch, FillPatch, FillRegion, Patch};
use super::patched::Patched;
use super::reconcile::{
    Conversion, Description, Needs, OutputExtent, Position, ReconcileOptions, Target, reconcile,
};
use super::tree_file::TreeFile;
use super::view_source::ViewSource;
use crate::store::Packing;
use crate::store::autumnal::{Autumnal, Commit, Editor, Note};
use spinney_base::space::Bounds;
use spinney_base::value::{Number, Value, ValueType};
use spinney_base::{Error, Progress, Result};

/// Change to a tree.
#[derive(Clone, Debug)]
pub enum Edit {
    /// Pastes another tree over a region.
    Paste {
        /// Tree to paste: a file and the operations on it.
        patch: FileView,
        /// Cell that the first pasted cell goes to; by default, its position in the world decides.
        at: Option<[i64; 3]>,
        /// Whether VOID cells of the pasted tree make cells VOID within its extent; else the
        /// existing cells stay.
        void: bool,
        /// Options for converting the pasted tree's values.
        options: ReconcileOptions,
    },
    /// Fills a region with one value (a sample per channel, or one for all), or makes it VOID.
    Fill(FillRegion, Option<Vec<Number>>),
    /// Sets single cells.
    Set(Vec<CellValue>),
    /// Replaces the tree by the result of an operation with another tree, which is aligned by world
    /// coordinates.
    Apply(CombineOperation, PathBuf, ReconcileOptions),
    /// Overlays a tree on the same cells, where that is not VOID.
    Cover(Arc<ViewSource>),
    /// Replaces the tree by the result of an operation with a tree on the same cells.
    Merge(CombineOperation, Arc<ViewSource>),
    /// Restores the state of another commit.
    Revert(u64),
}

/// Cell and its value: a sample per channel, or VOID.
pub type CellValue = ([u64; 3], Option<Vec<Number>>);

/// Applies edits in order and commits them as one; returns `None` if nothing has changed.
/// [`Editor::open_with`] and [`apply_edits`] do the same with a file access other than the default.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::edit::{Edit, Note};
/// use spinney::raw::ops;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("history.autumn");
/// # std::fs::copy("fixtures/v1/history.autumn", &path).unwrap();
/// let edits = [Edit::Set(vec![([0, 0, 0], Some(vec![7.into()]))])];
/// let commit = spinney::edit::edit(&path, edits.map(Ok), Note::default(), 64 << 20, &())?;
/// assert!(commit.is_some());
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If another process edits the file, an edit cannot be applied, the file cannot be written, or on
/// cancellation. The file's last commit is then unchanged.
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

/// Applies edits in order to a file that is open for editing. They become visible to readers with
/// the commit.
///
/// # Errors
/// If an edit cannot be applied, the file cannot be written, or on cancellation.
pub fn apply_edits(
    editor: &mut Editor,
    edits: &mut dyn Iterator<Item = Result<Edit>>,
    progress: &dyn Progress,
) -> Result<Vec<Conversion>> {
    let mut conversions = Vec::new();
    let tree = editor.tree();
    if let Some(remark) = tree.remark() {
        progress.warn(tree.path(), remark);
    }
    drop(tree);
    for edit in edits {
        match edit? {
            Edit::Revert(number) => editor.revert(number)?,
            edit => {
                let (changed, description, converted) = changed(editor.tree(), edit, progress)?;
                conversions.extend(converted);
                editor.replace(&changed, Packing::default(), progress)?;
                // (New classes add names and colours.)
                let mut metadata = editor.tree().metadata().clone();
                description.describe(&mut metadata);
                if metadata != *editor.tree().metadata() {
                    editor.set_metadata(metadata)?;
                }
            }
        }
        progress.check()?;
    }
    Ok(conversions)
}

/// The tree after an edit, as a source. Unchanged nodes are the tree's own, with their stored
/// records.
fn changed(
    tree: Arc<Autumnal>,
    edit: Edit,
    progress: &dyn Progress,
) -> Result<(Combined, Description, Vec<Conversion>)> {
    let (form, depth, extent) = (tree.header().form, tree.header().depth(), tree.header().extent);
    let value_type = form.value;
    let (mut description, mut conversions) = (Description::default(), Vec::new());
    let (operation, views) = match edit {
        Edit::Revert(_) => unreachable!("a revert makes no new tree"),
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
        Edit::Paste { patch, at, void, options } => {
            let name = patch.name.as_ref().unwrap_or(&patch.path);
            let brought =
                brought(&tree, (name, patch.open()?), at, CombineOperation::Over, &options, progress)?;
            (description, conversions) = (brought.description, brought.conversions);
            (CombineOperation::Over, pasted(&tree, brought.view, brought.bounds, void)?)
        }
        Edit::Apply(operation, path, options) => {
            let file = TreeFile::open_only(&path, &tree.access().into())?;
            let other = View::whole(file.into())?;
            let brought = brought(&tree, (&path, other), None, operation, &options, progress)?;
            (description, conversions) = (brought.description, brought.conversions);
            (operation, vec![View::whole(tree.into())?.opaque()?, brought.view.deepened(depth)?.opaque()?])
        }
        Edit::Cover(other) => {
            (CombineOperation::Over, vec![View::new(other, extent)?, View::whole(tree.into())?])
        }
        Edit::Merge(operation, other) => {
            (operation, vec![View::whole(tree.into())?.opaque()?, View::new(other, extent)?.opaque()?])
        }
    };
    Ok((Combined::new(views, operation, extent)?, description, conversions))
}

/// The whole tree with a patch applied.
fn patched(tree: &Arc<Autumnal>, patch: Arc<dyn Patch>) -> Result<View> {
    View::whole(Patched::new(tree.clone(), patch).into())
}

/// Views for a paste: the pasted tree first, then the tree below it.
fn pasted(tree: &Arc<Autumnal>, view: View, bounds: Bounds, void: bool) -> Result<Vec<View>> {
    let (depth, extent) = (tree.header().depth(), tree.header().extent);
    let (view, below) = match void {
        false => (view.opaque()?, View::whole(tree.clone().into())?),
        // VOID cells of the patch make cells VOID: clear the whole box first.
        true => (view, patched(tree, Arc::new(FillPatch::new(FillRegion::Box(bounds), extent, None)?))?),
    };
    Ok(vec![view.deepened(depth)?, below])
}

/// View on the cells of a tree, with values that mean the same as the tree's.
struct Brought {
    view: View,
    /// Box of the view's cells in the tree.
    bounds: Bounds,
    description: Description,
    conversions: Vec<Conversion>,
}

/// Aligns a view with a tree's cells and converts its values. The view's first cell goes to the
/// cell `at`, or to its position in the world.
fn brought(
    tree: &Arc<Autumnal>,
    (path, view): (&Path, View),
    at: Option<[i64; 3]>,
    operation: CombineOperation,
    options: &ReconcileOptions,
    progress: &dyn Progress,
) -> Result<Brought> {
    let extent = tree.header().extent;
    let own = (tree.path().display().to_string(), View::whole(tree.clone().into())?);
    let needs = |number: usize| match operation.takes_values_of(number, false) || number == 0 {
        true => Needs::Values,
        false => Needs::Presence,
    };
    let position = at.map_or(Position::World, Position::Cell);
    let options = ReconcileOptions { extent: OutputExtent::A, ..*options };
    let target = Target { is_fixed: true, position };
    let mut reconciled = reconcile(vec![own, (path.display().to_string(), view)], &needs, &options, target)?;
    reconciled.warn_resampled(progress);
    let bounds = reconciled.grid.box_of(1).intersect(&Bounds::of_extent(extent));
    if bounds.is_empty() {
        let found = "a raster outside of the tree";
        return Err(Error::invalid(path.display().to_string(), found, "a raster that overlaps the tree"));
    }
    let view = reconciled.views.swap_remove(1);
    let (description, conversions) = (reconciled.description, reconciled.conversions);
    Ok(Brought { view, bounds, description, conversions })
}

/// Value with these samples, or with one sample for all channels.
fn value_of(value_type: ValueType, samples: &[Number]) -> Result<Value> {
    let ValueType { sample, channels, .. } = value_type;
    let fits = samples.len() == 1 || samples.len() == usize::from(channels);
    let exact = samples.iter().all(|number| sample.can_hold(*number) || sample.is_float());
    if !fits || !exact {
        let expected = match channels {
            1 => format!("a number that {value_type} can store"),
            _ => format!("1 or {channels} numbers that {value_type} can store"),
        };
        let found = samples.iter().map(Number::to_string).collect::<Vec<_>>().join(",");
        return Err(Error::invalid("value", found, expected));
    }
    Ok(value_type.nearest_numbers(|channel| *samples.get(channel).unwrap_or(&samples[0])))
}

fn value_or_void(value_type: ValueType, samples: &Option<Vec<Number>>) -> Result<Option<Value>> {
    samples.as_ref().map(|samples| value_of(value_type, samples)).transpose()
}
