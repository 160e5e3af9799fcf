//! Writer of stacks.

use std::path::Path;

use super::super::build::RequestedCells;
use super::layer::index_plans;
use super::shared::{SharedRaster, alike};
use super::{Stack, StackLayer};
use crate::index::write_sections;
use spinney_base::io::{Output, directory_of};
use spinney_base::space::Dimension;
use spinney_base::{Progress, Result, SubProgress, TreeType};
use spinney_container::Metadata;
use spinney_engine::store::{BuildOptions, TreeWriter};

/// Writes a stack to a file, layer by layer, on the threads of the current rayon pool; progress
/// counts cells of all layers. The file of a layer is open only while the layer is written.
///
/// # Errors
/// If a file cannot be read or has changed, the output cannot be written, or on cancellation.
/// Nothing is left then.
pub fn write_stack(stack: &Stack, output: Output, progress: &dyn Progress) -> Result<()> {
    let scratch_directory = directory_of(output.path()).to_path_buf();
    let path = output.path().to_path_buf();
    let plans = stack.recorder.as_ref().map(|recorder| index_plans(&stack.layers, recorder)).transpose()?;
    let mut file = TreeWriter::create(output, (Dimension::Quad, stack.depth), stack.layers.len() as u32)?;
    write_layers(stack, &mut file, &scratch_directory, progress)?;
    if let Some(plans) = plans {
        let (sources, pages) = write_sections(&path, &plans.iter().collect::<Vec<_>>(), progress)?;
        file.set_references(sources, pages);
    }
    file.finish()
}

/// Writes the layers of a stack, or the requested range of them, to a file without layers.
/// Temporary files are created in the directory `scratch_directory`.
///
/// # Errors
/// Those of [`write_stack`].
pub fn write_layers(
    stack: &Stack,
    file: &mut TreeWriter,
    scratch_directory: &Path,
    progress: &dyn Progress,
) -> Result<()> {
    stack.remarks.iter().for_each(|(path, remark)| progress.warn(path, remark));
    let cells =
        |layer: &StackLayer| layer.extent.iter().fold(1u64, |cells, side| cells.saturating_mul(*side));
    let total = stack.layers.iter().fold(0, |total: u64, layer| total.saturating_add(cells(layer)));
    // The raster shared by this layer and others, with the numbers of these before and after it.
    let mut shared: Option<(SharedRaster, usize, usize)> = None;
    for (number, layer) in stack.layers.iter().enumerate() {
        let progress = &SubProgress::new(progress, cells(layer), total);
        // A single layer needs no name.
        let name = if stack.layers.len() > 1 { layer.name.clone() } else { String::new() };
        let metadata = Metadata {
            name,
            repeated: u32::try_from(layer.repeat).unwrap_or(u32::MAX),
            ..layer.metadata.clone()
        };
        let options = BuildOptions::new(layer.kind, stack.depth - layer.coarser)
            .rule(layer.rule)
            .memory(stack.memory / 4)
            .metadata(metadata)
            .share(stack.share)
            .time(stack.time)
            .packing(stack.packing)
            .referenced(stack.referenced);
        let form = TreeType::new(Dimension::Quad, layer.value);
        if file.run().is_none() {
            file.write_layer_header(form, layer.extent, &options)?;
            continue;
        }
        let requested = RequestedCells::by(file, options.depth);
        let scratch = (scratch_directory, stack.memory / 2);
        if shared.as_ref().is_none_or(|(_, _, left)| *left == 0) {
            let layers = &stack.layers[number..];
            let layers = &layers[..alike(layers)];
            shared = match layers.len() {
                1 => None,
                count => Some((SharedRaster::open(layers, requested, scratch, progress)?, 0, count)),
            };
        }
        let raster = shared.as_mut().and_then(|(raster, before, left)| {
            (*before, *left) = (*before + 1, *left - 1);
            raster.of_layer(*before - 1, layer)
        });
        let mut slabs = match raster {
            Some(raster) => layer.slabs_of(raster, requested, scratch, progress)?,
            None => layer.slabs_for(requested, scratch, progress)?,
        };
        let nodata = layer.nodata.and_then(|number| layer.value.splat(number));
        file.slabs(form, &mut slabs, nodata, &options, progress)?;
    }
    Ok(())
}
