//! Updates of indexes: only sources that were changed or added are read.

mod files;
mod layer;
mod properties;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use self::files::{FileFinder, UpdatedFiles};
use self::layer::{LayerPlanner, UpdatedLayer};
use self::properties::LayerProperties;
use super::{IndexPlan, write_sections};
use spinney_base::io::Output;
use spinney_base::space::{Dimension, Region};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Header, Section};
use spinney_engine::ops::write_updated_layer;
use spinney_engine::store::goblin::{Goblin, ReferringFile};
use spinney_engine::store::{BuildOptions, TreeWriter};
use spinney_references::{IndexContents, PixelRule};

/// Options of an update of an index.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct IndexUpdate {
    /// The files that the index has afterwards, those on top last; `None` keeps them. A file that
    /// is listed twice counts once, at its last position.
    pub sources: Option<Vec<PathBuf>>,
    /// Beginnings of names of sources, and their replacements.
    pub prefixes: Vec<(String, String)>,
    /// Memory budget in bytes.
    pub memory: u64,
}

/// Numbers of files by what an update did with them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct UpdateReport {
    /// Files that were not read.
    pub unchanged: usize,
    /// Files that had changed.
    pub changed: usize,
    /// Files that were added.
    pub added: usize,
    /// Files that were removed.
    pub removed: usize,
}

/// Writes an index again, in which only the cells of sources that were changed, added or removed
/// are computed again. Cells, statistics and metadata are those of a new index of all sources.
///
/// The first cell and the number of levels stay the same after a removal, also if a new index
/// would begin further to the south or east, or have fewer levels. Files next to a source, such as
/// `.aux.xml`, are read again if the source was changed or added.
///
/// # Errors
/// If a source is missing or does not fit, a source begins to the north or west of the index, a
/// new index would have another type, kind, nodata number or other layers, or the output cannot be
/// written.
pub fn update_index(
    index: &Path,
    update: &IndexUpdate,
    output: Output,
    progress: &dyn Progress,
) -> Result<UpdateReport> {
    let access = output.access().clone();
    let old = Goblin::open(index, &(&access).into())?;
    let contents = old.referring(IndexContents::read).ok_or_else(|| {
        Error::unsupported(index, "a tree that is not an index", "build it again from its input")
    })??;
    let memory = update.memory;
    let old_layers =
        (0..old.layers().len()).map(|number| old.open_layer(number)).collect::<Result<Vec<_>>>()?;
    let finder = FileFinder { index, access: &access, recorder: &Arc::default(), update };
    let mut report = UpdateReport::default();
    let files = finder.find(&contents, &old_layers, &mut report)?;
    let plan = |number: usize| {
        let (old, placements) = (&old_layers[number], &*contents.layers[number]);
        let properties = LayerProperties::of(old);
        LayerPlanner { finder: &finder, contents: &contents, files: &files, old, placements, properties }
            .plan()
    };
    let layers = (0..old_layers.len()).map(plan).collect::<Result<Vec<_>>>()?;
    check_order(index, &layers, &files)?;
    let (headers, plans): (Vec<Header>, Vec<&IndexPlan>) =
        layers.iter().map(|layer| (layer.header.clone(), &layer.plan)).unzip();
    let (list, pages) = write_sections(output.path(), &plans, progress)?;
    let path = output.path().to_path_buf();
    let depth = headers.iter().map(Header::depth).max().unwrap_or(0);
    let mut file = TreeWriter::create(output, (Dimension::Quad, depth), headers.len() as u32)?;
    let bytes: Vec<u8> = [&list[..], &pages].concat();
    let section = |offset: usize, bytes: &[u8]| Section {
        offset: offset as u64,
        length: bytes.len() as u64,
        checksum: crc32c::crc32c(bytes),
    };
    let (sources, page_section) = (section(0, &list), section(list.len(), &pages));
    let cells = spinney_references::open(&ReferringFile {
        path: &path,
        bytes: &bytes,
        access: &access,
        sources,
        pages: page_section,
        headers: &headers,
    })?;
    for (number, (layer, old)) in layers.iter().zip(&old_layers).enumerate() {
        let UpdatedLayer { header, metadata, new_cells, .. }: &UpdatedLayer = layer;
        let is_new = |region: &Region| !new_cells.touching(region).is_empty();
        let options =
            BuildOptions::like(header, memory / 4).metadata(metadata.clone()).referenced(header.shape.stride);
        let new_cells = ((&*cells as _, &bytes as _, number), &is_new as _);
        write_updated_layer(&mut file, old, new_cells, (&options, header.extent), progress)?;
    }
    file.set_references(list, pages);
    file.finish()?;
    Ok(report)
}

/// Checks that listed files are in the order of the layers of a stack.
fn check_order(index: &Path, layers: &[UpdatedLayer], files: &UpdatedFiles) -> Result<()> {
    if files.is_listed && !layers.is_sorted_by_key(|layer| layer.position) {
        return Err(refused(index, "the sources of its layers in another order"));
    }
    Ok(())
}

/// Whether a placement's rule is one of a virtual raster. A virtual raster does not use the masks
/// of its sources, whereas those of files count; so only its rules ignore masks.
fn is_of_virtual_raster(rule: &PixelRule) -> bool {
    rule.ignores_mask
}

/// Returns the error for sources whose index must be a new one.
fn refused(path: &Path, found: impl Into<String>) -> Error {
    Error::unsupported(path, found, "make the index again (`spinney index`)")
}
