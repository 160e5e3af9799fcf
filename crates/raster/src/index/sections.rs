//! The sections of an index, from the records of its files.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::names::name_in_index;
use super::{IndexPlan, RecordedImage};
use crate::import::{ImportOptions, plan};
use spinney_base::io::FileStat;
use spinney_base::sort;
use spinney_base::space::{Dimension, morton_encode};
use spinney_base::{Error, Progress, Result};
use spinney_references::{
    DescribedSource, IndexedFile, IndexedSource, LayerCells, MappedWindow, SourceImage, SourceList,
    write_pages,
};

/// Makes the sections of an index from the plans of its layers, which share a recorder: the list of
/// sources, and the pages that describe these.
///
/// # Errors
/// If a file was changed while it was read, or a name is not possible.
pub(crate) fn write_sections(
    index: &Path,
    layers: &[&IndexPlan],
    progress: &dyn Progress,
) -> Result<(Vec<u8>, Vec<u8>)> {
    let IndexPlan { recorder, access, .. } = layers[0];
    let order = in_order_of_cells(layers);
    let numbers: HashMap<usize, u32> = order.iter().copied().zip(0..).collect();
    let mut list = SourceList::default();
    // Numbers of the lists of channels, of which there may be as many as bands.
    let mut channel_lists: HashMap<&[usize], u32> = HashMap::new();
    for IndexPlan { windows, nodata, value, .. } in layers {
        let mut placements: Vec<MappedWindow> = windows
            .iter()
            .map(|window| MappedWindow {
                source: numbers[&window.source],
                channels: *channel_lists.entry(&window.channels).or_insert_with(|| {
                    list.channels.push(window.channels.iter().map(|channel| *channel as u16).collect());
                    list.channels.len() as u32 - 1
                }),
                rule: number_of(&mut list.rules, &window.rule),
                cells: window.cells,
                from: window.from,
            })
            .collect();
        let nodata = nodata.map(|nodata| nodata.to_bytes()[..value.size()].to_vec());
        // (Equal ones would take so few bytes that readers refuse them.)
        placements.dedup();
        list.layers.push(LayerCells::new(nodata, &placements));
    }
    for number in &order {
        let source = recorder.get(*number);
        for image in source.images() {
            number_of(&mut list.formats, &image.format);
        }
    }
    for (path, FileStat { length, version }) in recorder.virtual_rasters() {
        list.virtual_rasters.push(IndexedFile { name: name_in_index(index, &path)?, length, version });
    }
    let formats = list.formats.clone();
    recorder.complete(&order, access, progress)?;
    let mut sources = order.into_iter();
    write_pages(index, list, &mut || {
        let Some(number) = sources.next() else { return Ok(None) };
        progress.check()?;
        let recorded = recorder.get(number);
        let image = |image: &RecordedImage| {
            let format = formats.iter().position(|format| *format == image.format);
            SourceImage::new(format.expect("all formats are listed") as u32)
        };
        let source = IndexedSource {
            name: name_in_index(index, &recorded.path)?,
            length: recorded.stat.length,
            page: recorded.page,
            version: recorded.stat.version.clone(),
            size: recorded.size,
            image: image(&recorded.image),
            mask: recorded.mask.as_ref().map(image),
            hole: recorded.hole.clone(),
            decoder: recorded.image.format.lossy_decoder().map(str::to_string),
        };
        let mask = recorded.mask.as_ref().map_or(Vec::new(), |mask| mask.chunks.chunks());
        let described: DescribedSource = (source, [recorded.image.chunks.chunks(), mask]);
        Ok(Some(described))
    })
}

/// Returns the number of an item in a list, to which it is added if it is new.
fn number_of<T: Clone + PartialEq>(known: &mut Vec<T>, item: &T) -> u32 {
    let found = known.iter().position(|other| other == item);
    found.unwrap_or_else(|| {
        known.push(item.clone());
        known.len() - 1
    }) as u32
}

/// Makes the sections of an index that was built in shards: `checksums` are those that the shards
/// have recorded, with the files' names. Chunks that no shard has read are read.
///
/// # Errors
/// Those of [`plan`]; also if checksums are corrupt, or a file was changed.
pub fn sections_of_shards(
    index: &Path,
    inputs: &[PathBuf],
    options: &ImportOptions,
    checksums: &mut dyn Iterator<Item = Result<(PathBuf, Vec<u8>)>>,
    progress: &dyn Progress,
) -> Result<(Vec<u8>, Vec<u8>)> {
    let import = plan(inputs, options)?;
    let layer = import.index.as_ref().ok_or_else(|| {
        Error::unsupported(index, "shards that are not those of an index", "plan them again")
    })?;
    for read in checksums {
        let (path, bytes) = read?;
        layer.recorder.restore(&path, &bytes)?;
    }
    write_sections(index, &[layer], progress)
}

/// Returns the numbers of the files in the order of their cells, so that those near each other are
/// described together.
fn in_order_of_cells(layers: &[&IndexPlan]) -> Vec<usize> {
    // (Files are recorded in any order, so a file's first window decides between equal positions.)
    let mut firsts: HashMap<usize, (u64, usize)> = HashMap::new();
    for (number, window) in layers.iter().flat_map(|layer| &layer.windows).enumerate() {
        let spread = |at: u64| morton_encode(Dimension::Quad, at as u32);
        let (x, y) = (window.cells.x + window.cells.width / 2, window.cells.y + window.cells.height / 2);
        let at = spread(x) | spread(y) << 1;
        let first = firsts.entry(window.source).or_insert((at, number));
        first.0 = at.min(first.0);
    }
    let mut order: Vec<(usize, (u64, usize))> = firsts.into_iter().collect();
    sort::by(&mut order, &mut |a, b| a.1.cmp(&b.1));
    order.into_iter().map(|(number, _)| number).collect()
}
