//! Files of several layers: listing, adding and dropping layers.

use std::path::{Path, PathBuf};

use super::affine::View;
use super::files::FileView;
use super::reconcile::{CommonGrid, Located, OutputExtent, Position};
use super::tree_file::TreeFile;
use crate::store::autumnal::{Commit, Editor, Note};
use crate::store::{BuildOptions, Packing, TreeWriter, WriteOptions};
use crate::tree::Source;
use spinney_base::io::{FileAccess, ReplaceLock, shown, without_query};
use spinney_base::{Error, Progress, Result};
use spinney_container::{FileReference, Header, Metadata};
use spinney_crs::Frame;

/// Memory in bytes for building a layer whose cells are in other files.
const MEMORY: u64 = 256 << 20;

/// Paths of the layers that a path refers to: all of a file, or the one that it names. The path of
/// a file with one layer is returned unchanged.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// let map = "fixtures/v1/classes.goblin".as_ref();
/// assert_eq!(spinney::raw::ops::layer_paths(map, &Default::default())?, [map]);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the file cannot be read.
pub fn layer_paths(path: &Path, access: &FileAccess) -> Result<Vec<PathBuf>> {
    let place = FileReference::of(path);
    if place.layer.is_some() {
        return Ok(vec![path.into()]);
    }
    let layers = TreeFile::open(path, &access.into())?.layers()?;
    Ok(match &layers[..] {
        [_] => vec![path.into()],
        layers => layers.iter().map(|layer| place.of_layer(&layer.name)).collect(),
    })
}

/// Checks that a path refers to one layer.
///
/// # Errors
/// If it refers to a file of several layers without naming one, or the file cannot be read.
pub fn only_layer(path: &Path, access: &FileAccess) -> Result<()> {
    TreeFile::open_only(path, &access.into()).map(|_| ())
}

/// Maximum depth of some trees: the depth of a file that has them as layers.
pub(super) fn file_depth<'h>(headers: impl IntoIterator<Item = &'h Header>) -> u8 {
    headers.into_iter().map(Header::depth).max().unwrap_or(0)
}

/// Adds the view to a file as a layer. A Goblin file is rewritten, with the bytes of its other
/// layers unchanged. An Autumnal file gets a commit, which is returned. The file is opened with the
/// view's access.
///
/// # Errors
/// If the tree does not lie in the file's space, a layer of that name exists, the file cannot be
/// written, or on cancellation.
pub fn add_layer(
    path: &Path,
    name: &str,
    chain: &FileView,
    note: Note,
    how: WriteOptions,
    progress: &dyn Progress,
) -> Result<Option<Commit>> {
    let access = &chain.access;
    let (file, _lock) = open_to_change(path, access)?;
    let layers = file.layers()?;
    if name.is_empty() || layers.iter().any(|layer| layer.name == name) {
        return Err(Error::invalid("layer name", format!("`{name}`"), "a name that no other layer has"));
    }
    let view = chain.open()?;
    let depth = file_depth(layers.iter().map(|layer| &layer.header));
    let finest = layers.iter().position(|layer| layer.header.depth() == depth).unwrap_or(0);
    let finest = file.open_layer(finest)?;
    let frame = finest.metadata().frame.clone();
    let axes = view.form().axes();
    let coarser = coarser_by(&frame, &view.frame(chain.moves), (axes, depth));
    let (view, coarser) = match coarser {
        Some(coarser) => (view, coarser),
        None => (on_cells_of(finest, path, (&chain.path, view), progress)?, 0),
    };
    let metadata = Metadata { name: name.into(), ..view.metadata(chain.moves) };
    let layer_depth = depth - coarser;
    if view.extent().iter().any(|cells| *cells > 1 << layer_depth) {
        let found = format!("{:?} cells", view.extent());
        return Err(Error::invalid(
            "layer",
            found,
            format!("at most {} along each axis; {}", 1u64 << layer_depth, cut(path, &chain.path)),
        ));
    }
    let (extent, header) = (view.extent(), view.source().header().clone());
    let view = view.deepened(layer_depth)?;
    let options = BuildOptions { depth: layer_depth, metadata, ..BuildOptions::written_like(&header, how) };
    let source = super::combine::Combined::new(vec![view], super::operation::CombineOperation::Over, extent)?;
    match &file {
        TreeFile::Autumnal(_) => {
            let mut editor = Editor::open_with(&FileReference::of(path).file, how.memory, access)?;
            let header = options.header(header.form, extent)?;
            editor.name_layer(&stem(path))?;
            let mut metadata = options.metadata;
            how.packing.record_in(&mut metadata);
            editor.add_layer(&header, metadata)?;
            editor.replace(&source, how.packing, progress)?;
            editor.commit(note)
        }
        TreeFile::Goblin(_) => {
            let dimension = header.form.dimension;
            let output = access.create(&FileReference::of(path).file)?;
            let mut writer = TreeWriter::create(output, (dimension, depth), layers.len() as u32 + 1)?;
            copy_layers(&file, &mut writer, progress, &|_| true, &stem(path))?;
            writer.source(&source, extent, &options, progress)?;
            writer.finish()?;
            Ok(None)
        }
        TreeFile::Mosaic(_) => Err(only_listed(path)),
    }
}

/// View resampled to the grid of a file's layer, from the layer's first cell on.
fn on_cells_of(
    layer: TreeFile,
    path: &Path,
    (other, view): (&Path, View),
    progress: &dyn Progress,
) -> Result<View> {
    let (dimension, expected) = (view.form().dimension, layer.form().dimension);
    if dimension != expected {
        let expected = format!("{}, like {}", expected.tree_name(), path.display());
        return Err(Error::invalid(other.display().to_string(), dimension.tree_name(), expected));
    }
    let target = View::whole(layer.into())?;
    let (name, own) = (path.display().to_string(), other.display().to_string());
    let operands = [Located::of(&name, &target), Located::of(&own, &view)];
    let grid = CommonGrid::of(&operands, dimension, OutputExtent::Union, Position::World)?;
    if grid.shift(0) != Some([0; 3]) {
        let expected =
            format!("an extent that starts at or after the first cell of {name}; {}", cut(path, other));
        return Err(Error::invalid(format!("extent of {own}"), "cells before its first cell", expected));
    }
    if let Some(text) = grid.resampled(1, &view) {
        progress.warn(other, &text);
    }
    grid.bring(1, view)
}

/// Advice for a tree that reaches beyond a file.
fn cut(path: &Path, other: &Path) -> String {
    format!(
        "to crop it: `spinney transform {} like={},extent=a -o cut.goblin`",
        other.display(),
        path.display()
    )
}

/// Drops a layer of a file. A Goblin file is rewritten; an Autumnal file gets a commit without the
/// layer, which is returned.
///
/// # Errors
/// If there is no layer of that name, or no other layer, the file cannot be written, or on
/// cancellation.
pub fn drop_layer(
    path: &Path,
    name: &str,
    note: Note,
    access: &FileAccess,
    progress: &dyn Progress,
) -> Result<Option<Commit>> {
    let (file, _lock) = open_to_change(path, access)?;
    let layers = file.layers()?;
    let place = FileReference { layer: Some(name.into()), ..FileReference::of(path) };
    let dropped = place.layer_number(layers.iter().map(|layer| &*layer.name))?;
    if layers.len() == 1 {
        return Err(Error::unsupported(path, "dropping the only layer", "remove the file instead"));
    }
    match &file {
        TreeFile::Autumnal(_) => {
            // (No nodes are built, so no memory is needed.)
            let mut editor = Editor::open_with(&place.file, 0, access)?;
            editor.drop_layer(&layers[dropped].name)?;
            editor.commit(note)
        }
        TreeFile::Goblin(_) => {
            let depth = file_depth(layers.iter().map(|layer| &layer.header));
            let dimension = layers[0].header.form.dimension;
            let output = access.create(&place.file)?;
            let mut writer = TreeWriter::create(output, (dimension, depth), layers.len() as u32 - 1)?;
            copy_layers(&file, &mut writer, progress, &|number| number != dropped, &stem(path))?;
            writer.finish()?;
            Ok(None)
        }
        TreeFile::Mosaic(_) => Err(only_listed(path)),
    }
}

/// Error for a change to the layers of a manifest.
#[cold]
fn only_listed(path: &Path) -> Error {
    let advice = "edit its files, or convert it to one file: `spinney convert`";
    Error::unsupported(path, "changing the layers of a manifest", advice)
}

/// Opens a file whose layers are to change. A Goblin file is rewritten, so it is locked until the
/// returned lock is dropped: changes by other processes between reading and replacing the file
/// would be lost. (An Autumnal file is locked by its editor.)
fn open_to_change(path: &Path, access: &FileAccess) -> Result<(TreeFile, Option<ReplaceLock>)> {
    match TreeFile::open(path, &access.into())? {
        TreeFile::Goblin(index) if index.path() != &*FileReference::of(path).file => {
            let found = format!("changing the layers of a raster through its index {}", shown(index.path()));
            Err(Error::unsupported(path, found, "give the name of the index"))
        }
        TreeFile::Goblin(_) => {
            let lock = ReplaceLock::take(&FileReference::of(path).file)?;
            Ok((TreeFile::open(path, &access.into())?, Some(lock)))
        }
        file @ TreeFile::Autumnal(_) => Ok((file, None)),
        TreeFile::Mosaic(_) => Err(only_listed(path)),
    }
}

/// Name that an unnamed only layer gets when another layer is added.
fn stem(path: &Path) -> String {
    let file = FileReference::of(path).file;
    without_query(&file)
        .file_stem()
        .map_or_else(|| "layer".into(), |stem| stem.to_string_lossy().into_owned())
}

/// Copies layers of a Goblin file, selected by index; an unnamed layer gets the name `unnamed`.
fn copy_layers(
    file: &TreeFile,
    writer: &mut TreeWriter,
    progress: &dyn Progress,
    is_kept: &dyn Fn(usize) -> bool,
    unnamed: &str,
) -> Result<()> {
    for number in (0..file.layers()?.len()).filter(|number| is_kept(*number)) {
        if let TreeFile::Goblin(layer) = file.open_layer(number)? {
            let mut metadata = layer.metadata().clone();
            if metadata.name.is_empty() {
                metadata.name = unnamed.into();
            }
            // Cells that are in other files are read from these.
            if !writer.copy(&layer, &metadata, progress)? {
                let header = layer.header();
                let options =
                    BuildOptions::like(header, MEMORY).metadata(metadata).packing(Packing::packed());
                writer.source(&*layer, header.extent, &options, progress)?;
            }
        }
    }
    Ok(())
}

/// Number of halvings from one frame's cells to another's, if both begin at the same position.
fn coarser_by(fine: &Frame, coarse: &Frame, (axes, most): (usize, u8)) -> Option<u8> {
    let is_same = |shift: &u8| {
        let frame = fine.coarser(*shift);
        let size =
            frame.matrix.iter().flat_map(|row| &row[..3]).fold(0.0, |size: f64, part| size.max(part.abs()));
        // (A quadtree's cells have no height.)
        let numbers = |frame: &Frame| -> Vec<f64> {
            let row = |row: [f64; 4]| row.into_iter().enumerate().filter(|(at, _)| *at < axes || *at == 3);
            frame.matrix.into_iter().take(axes).flat_map(row).map(|(_, number)| number).collect()
        };
        let mut pairs = numbers(&frame).into_iter().zip(numbers(coarse));
        frame.crs == coarse.crs && pairs.all(|(a, b)| (a - b).abs() <= 1e-6 * size)
    };
    (0..=most).find(is_same)
}
