//! A window of several layers as one image with one band per channel of each layer.

use super::grid::OutputGrid;
use super::sampler::{Sampler, flip_rows};
use super::{Detail, VoidCells, WindowRequest, image_spec, rows_at_a_time};
use crate::image::{Format, ImageSpec, create, write_sidecar};
use spinney_base::io::Output;
use spinney_base::value::{Rule, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_engine::dataset::Dataset;

/// Maximum number of bands of an image.
const MAX_BANDS: usize = 255;

/// Writes a window of several layers to an image or array file, one band per channel of each layer.
/// All samples must have the same type. The window is in cells of the first layer; the other layers
/// must lie on its grid ([`Dataset::aligned_layer`]).
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::raw::export::image::Format;
/// use spinney::export::{Detail, WindowRequest};
/// use spinney::raw::export::export_layers;
/// use spinney::{Bounds, Output};
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("part.tif");
/// let layers = [
///     spinney::open("fixtures/v1/classes.goblin")?, spinney::open("fixtures/v1/classes.goblin")?];
/// let request =
///     WindowRequest::new(Bounds { min: [8, 8, 0], max: [40, 40, 1] }, Detail::Size(16, 16));
/// export_layers(&layers, &request, Output::create(&path)?, Format::Tiff, &())?;
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// Those of [`export_window`](super::export_window); also if sample types differ, there are more
/// than 255 bands, or no number is free for VOID.
pub fn export_layers(
    layers: &[Dataset],
    request: &WindowRequest,
    output: Output,
    format: Format,
    progress: &dyn Progress,
) -> Result<()> {
    let Some(first) = layers.first() else { return Err(Error::invalid("layers", "none", "at least one")) };
    let sample = first.header().form.value.sample;
    for layer in layers {
        let other = layer.header().form.value.sample;
        if other != sample {
            let found = format!("layers of {} and of {} in one image", sample.name(), other.name());
            return Err(Error::unsupported(first.name(), found, "select layers of one type (--layer A,B)"));
        }
    }
    let channels: usize = layers.iter().map(|layer| usize::from(layer.header().form.value.channels)).sum();
    if channels > MAX_BANDS {
        let found = format!("an image of {channels} bands");
        return Err(Error::unsupported(first.name(), found, "select fewer layers (--layer A,B)"));
    }
    let value = ValueType::new(sample, channels as u8);
    let all = VoidCells::of(layers, request.bounds, request.nodata)?;
    let grids = layers.iter().map(|layer| OutputGrid::of(layer, &request_for(layer, first, request)));
    let grids = grids.collect::<Result<Vec<_>>>()?;
    let (width, height) = (grids[0].width, grids[0].height);
    let spec = spec_of(layers, &grids[0], &all, value);
    // The memory budget covers the rows of each layer and the interleaved rows of all of them.
    let share = WindowRequest { memory: request.memory / (2 * layers.len() as u64), ..request.clone() };
    let rows = layers.iter().zip(&grids).map(|(layer, grid)| rows_at_a_time(layer, &share, grid));
    let rows = rows.collect::<Result<Vec<u64>>>()?.into_iter().min().unwrap_or(1);
    let (path, access) = (output.path().to_path_buf(), output.access().clone());
    if all.needs_mask() {
        // A TIFF has one mask for all bands, but each layer has VOID cells of its own.
        let found = "VOID cells of several layers without a number that none of them has,";
        return Err(Error::unsupported(
            first.name(),
            found,
            "select one layer (--layer): its file has a mask",
        ));
    }
    all.check((&path, sample), format, progress)?;
    let mut writer = create(output, format, &spec)?;
    let is_upright = grids[0].across != 2 && !matches!(format, Format::Npy | Format::Raw);
    let samplers: Vec<Sampler<'_>> = layers
        .iter()
        .zip(grids)
        .map(|(tree, grid)| {
            // In trees of occupancy an empty cell is 0, whatever VOID is in other layers.
            let is_occupancy = tree.header().rule == Rule::Occupancy;
            let fill = if is_occupancy { None } else { all.fill };
            Sampler { tree, grid, fill: fill.unwrap_or_default() }
        })
        .collect();
    let mut pixels = Vec::new();
    let mut row = 0;
    while row < height {
        progress.check()?;
        let count = rows.min(height - row);
        let first_row = if is_upright { height - row - count } else { row };
        pixels.resize((count * width) as usize * value.size(), 0);
        let mut start = 0;
        for sampler in &samplers {
            let (bytes, _) = sampler.band(first_row, count, progress)?;
            let size = sampler.tree.header().form.value.size();
            for (pixel, samples) in pixels.chunks_exact_mut(value.size()).zip(bytes.chunks_exact(size)) {
                pixel[start..start + size].copy_from_slice(samples);
            }
            start += size;
        }
        if is_upright {
            flip_rows(&mut pixels, width as usize * value.size());
        }
        writer.write_rows(&pixels, None)?;
        progress.advance(count * width, height.saturating_mul(width));
        row += count;
    }
    layers.iter().try_for_each(Dataset::check_unchanged)?;
    writer.finish()?;
    write_sidecar((&path, &access), format, &spec.metadata, progress)
}

/// The request for one layer. Its pixels are those of the first layer, even if the request gives a
/// size.
fn request_for(layer: &Dataset, first: &Dataset, request: &WindowRequest) -> WindowRequest {
    let detail = match request.detail {
        // All layers on the grid of the first one have the same levels.
        Detail::Level(level) => Detail::Level(level.min(layer.depth()).min(first.depth())),
        size => size,
    };
    WindowRequest { detail, ..request.clone() }
}

/// The specification of the image of all layers.
fn spec_of(layers: &[Dataset], grid: &OutputGrid, void: &VoidCells, value: ValueType) -> ImageSpec {
    let mut spec = image_spec(&layers[0], grid, void);
    spec.value = value;
    spec.alpha = false;
    let (mut names, mut scales, mut units, mut roles) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for layer in layers {
        let metadata = layer.metadata();
        let layer_roles = metadata.colour_roles();
        for channel in 0..usize::from(layer.header().form.value.channels) {
            let band = metadata.band_names.get(channel).filter(|name| !name.is_empty());
            names.push(match (&*metadata.name, band) {
                ("", band) => band.cloned().unwrap_or_default(),
                (name, None) => name.into(),
                (name, Some(band)) if layer.header().form.value.channels == 1 => {
                    if band.is_empty() {
                        name.into()
                    } else {
                        band.clone()
                    }
                }
                (name, Some(band)) => format!("{name}.{band}"),
            });
            scales.push(metadata.scale_offset.get(channel).copied().unwrap_or((1.0, 0.0)));
            units.push(metadata.units.get(channel).cloned().unwrap_or_default());
            roles.push(layer_roles.get(channel).map_or(String::new(), |role| (*role).to_string()));
        }
    }
    let metadata = &mut spec.metadata;
    metadata.palette = None;
    metadata.class_names.clear();
    metadata.alpha = None;
    metadata.band_names = if names.iter().all(String::is_empty) { Vec::new() } else { names };
    metadata.scale_offset = if scales.iter().all(|scale| *scale == (1.0, 0.0)) { Vec::new() } else { scales };
    metadata.units = if units.iter().all(String::is_empty) { Vec::new() } else { units };
    metadata.nodata = void.fill.filter(|_| void.may_be);
    metadata.set_colour_roles(&roles);
    spec
}
