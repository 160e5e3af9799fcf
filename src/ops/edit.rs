//! Edits of Autumnal files of any type.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::align::align;
use super::combine::{Combined, Operation};
use super::files::{Chain, chained};
use super::map::Map;
use super::patch::{CellPatch, FillPatch, FillRegion};
use super::view::View;
use crate::space::Bounds;
use crate::store::autumnal::{Autumnal, Commit, Editor, Note};
use crate::store::goblin::{Layout, OpenOptions};
use crate::store::{File, Typed, typed};
use crate::tree::{Patch, Patched};
use crate::value::{Sample, Value};
use crate::{Error, Progress, Result};

/// A change to a tree.
#[derive(Clone, Debug)]
pub enum Edit {
    /// Puts another tree over a part of it.
    Paste {
        /// The other tree, perhaps seen through steps.
        patch: Chain,
        /// The cell that its first one goes to; where it lies in the world if none is given.
        at: Option<[i64; 3]>,
        /// Only where the other tree is not VOID.
        where_valid: bool,
    },
    /// Fills a region with one value (a sample per channel, or one for all), or makes it VOID.
    Fill(FillRegion, Option<Vec<f64>>),
    /// Gives single cells new values.
    Set(Vec<CellValue>),
    /// Makes it what an operation makes of it and another tree, which lies where it lies in the world.
    Apply(Operation, PathBuf),
    /// Makes it what it was in another commit.
    Revert(u64),
}

/// A cell and its value: a sample per channel, or VOID.
pub type CellValue = ([u64; 3], Option<Vec<f64>>);

/// Does some edits, one after the other, and makes them one commit; `None` if nothing has changed.
///
/// # Errors
/// If another process edits the file, an edit cannot be done, the file not be written, or on interruption. The file's last
/// commit is then what it was.
pub fn edit(
    path: &Path,
    edits: impl IntoIterator<Item = Result<Edit>>,
    note: Note,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Option<Commit>> {
    let edits = &mut edits.into_iter();
    typed(path, Editing { path, edits, note, memory, progress })
}

struct Editing<'a> {
    path: &'a Path,
    edits: &'a mut dyn Iterator<Item = Result<Edit>>,
    note: Note,
    memory: u64,
    progress: &'a dyn Progress,
}

impl Typed for Editing<'_> {
    type Out = Option<Commit>;

    fn of<D: Layout, V: Value>(self) -> Result<Option<Commit>> {
        let mut editor = Editor::<D, V>::open(self.path, self.memory)?;
        for edit in self.edits {
            one(&mut editor, edit?, self.progress)?;
            self.progress.check()?;
        }
        editor.commit(self.note)
    }
}

/// The value with these samples, or with one sample for all channels.
fn value_of<V: Value>(samples: &[f64]) -> Result<V> {
    let sample = |channel: usize| *samples.get(channel).or(samples.first()).unwrap_or(&f64::NAN);
    let fits = samples.len() == 1 || samples.len() == V::CHANNELS;
    let exact =
        samples.iter().all(|number| V::Sample::from_f64(*number).is_some() || V::TYPE.sample.is_float());
    if !fits || !exact {
        let expected = format!("1 or {} numbers that {} can hold", V::CHANNELS, V::TYPE);
        return Err(Error::invalid("value", format!("{samples:?}"), expected));
    }
    Ok(V::from_channels(|channel| V::Sample::from_f64_lossy(sample(channel))))
}

fn value_or_void<V: Value>(samples: &Option<Vec<f64>>) -> Result<Option<V>> {
    samples.as_ref().map(|samples| value_of(samples)).transpose()
}

/// Does one edit. All of them are the same kind of source, so that it is compiled once for each type of trees.
fn one<D: Layout, V: Value>(editor: &mut Editor<D, V>, edit: Edit, progress: &dyn Progress) -> Result<()> {
    let tree = editor.tree();
    let header = tree.header().clone();
    let (depth, extent) = (header.shape.depth, header.extent);
    let base = |file: File<D, V>| View::new(Arc::new(file), extent)?.deepened(depth);
    let patched = |patch: Arc<dyn Patch<D, V>>| base(File::Patched(Patched::new(tree.clone(), patch)));
    let (operation, views) = match edit {
        Edit::Revert(number) => return editor.revert(number),
        Edit::Fill(region, value) => {
            let value = value_or_void::<V>(&value)?.filter(|value| !value.is_nan());
            (Operation::Over, vec![patched(Arc::new(FillPatch::new(region, extent, value)))?])
        }
        Edit::Set(cells) => {
            let cells = cells.iter().map(|(cell, value)| Ok((*cell, value_or_void::<V>(value)?)));
            let cells = cells.collect::<Result<Vec<_>>>()?;
            (Operation::Over, vec![patched(Arc::new(CellPatch::<D, V>::new(depth, extent, cells)?))?])
        }
        Edit::Paste { patch, at, where_valid } => {
            let file = Arc::new(File::<D, V>::open(&patch.path, &OpenOptions::default())?);
            let view = chained(&patch, file)?;
            let (view, bounds) = match at {
                Some(at) => {
                    let size = view.extent();
                    let moved = Map::translation(at.map(|cells| cells as f64));
                    let end = |axis: usize| at[axis].saturating_add_unsigned(size[axis]).max(0) as u64;
                    let min = at.map(|cell| cell.max(0) as u64);
                    (view.onto(&moved, extent)?, Bounds { min, max: std::array::from_fn(end) })
                }
                None => placed(view, &tree, &patch.path)?,
            };
            let bounds = bounds.intersect(&Bounds { min: [0; 3], max: extent });
            if bounds.is_empty() {
                let name = patch.path.display().to_string();
                let found = "a place outside of the tree";
                return Err(Error::invalid(name, found, "one that is at least partly inside"));
            }
            let below = if where_valid {
                base(File::Autumnal(tree.clone()))?
            } else {
                patched(Arc::new(FillPatch::new(FillRegion::Box(bounds), extent, None)))?
            };
            (Operation::Over, vec![view.deepened(depth)?, below])
        }
        Edit::Apply(operation, path) => {
            let file = Arc::new(File::<D, V>::open(&path, &OpenOptions::default())?);
            let view = View::new(file.clone(), file.header().extent)?;
            let (view, _) = placed(view, &tree, &path)?;
            (operation, vec![base(File::Autumnal(tree.clone()))?, view.deepened(depth)?])
        }
    };
    editor.replace(&Combined::new(views, operation, extent)?, progress)
}

type FileView<D, V> = View<Arc<File<D, V>>>;

/// A view of a file on the cells of a tree, where it lies in the world, and its box there.
fn placed<D: Layout, V: Value>(
    view: FileView<D, V>,
    tree: &Autumnal<D, V>,
    path: &Path,
) -> Result<(FileView<D, V>, Bounds)> {
    let (frame, extent) = (view.frame(&view.source().metadata().frame, false), tree.header().extent);
    let (own, name) = (tree.path().display().to_string(), path.display().to_string());
    let alignments = align(&[(&own, &tree.metadata().frame, extent), (&name, &frame, view.extent())])?;
    // The grid has room for both, and the finer cells of both.
    let back = alignments[0].map.inverse()?;
    let map = alignments[1].map.then(&back);
    let end = glam::DVec3::from(view.extent().map(|cells| cells as f64));
    let (low, high) = map.bounding_box(glam::DVec3::ZERO, end);
    let cell = |number: f64| number.round().max(0.0) as u64;
    let bounds = Bounds { min: low.to_array().map(cell), max: high.to_array().map(cell) };
    Ok((view.onto(&map, extent)?, bounds))
}
