//! Export of windows painted in a style.

use super::super::image::{Format, ImageSpec, create};
use super::WindowRequest;
use super::grid::OutputGrid;
use super::rows_at_a_time;
use super::sampler::{Sampler, flip_rows};
use spinney_base::io::Output;
use spinney_base::value::{Number, Palette, SampleType, ValueType};
use spinney_base::{Progress, Result};
use spinney_container::Metadata;
use spinney_engine::dataset::Dataset;
use spinney_style::{Ground, SampleBlock, StylePainter};

/// A window to be painted.
pub(super) struct PaintedWindow<'a> {
    tree: &'a Dataset,
    /// The image's pixels and the margin around them, as far as the tree extends.
    grid: OutputGrid,
    /// Width of this margin in pixels: left, above, right, below.
    around: [u64; 4],
    painter: &'a StylePainter,
    ground: Ground,
    samples: Samples,
    spec: ImageSpec,
}

/// Samples of a painted pixel.
#[derive(Clone, Copy, PartialEq)]
enum Samples {
    /// Number of channels: grey, grey and opacity, RGB, or RGBA.
    Channels(u8),
    /// Indices of palette colours.
    Indices,
}

impl<'a> PaintedWindow<'a> {
    /// An image with the pixels of a grid. `spec` is the specification of the unpainted values.
    pub(super) fn new(
        tree: &'a Dataset,
        grid: &OutputGrid,
        painter: &'a StylePainter,
        mut spec: ImageSpec,
        format: Format,
    ) -> PaintedWindow<'a> {
        let (grid, around) = grid.extended(tree, painter.margin());
        let ground = Ground::new(&spec.metadata.frame, spec.width);
        let is_opaque = painter.is_opaque() && (!spec.void || painter.void()[3] == 255);
        // Choose the encoding with the fewest bytes per pixel.
        let samples = match (painter.is_grey(), is_opaque, painter.palette()) {
            (true, true, _) => Samples::Channels(1),
            (_, _, Some(_)) if format == Format::Png => Samples::Indices,
            (true, false, _) => Samples::Channels(2),
            (false, true, _) => Samples::Channels(3),
            (false, false, _) => Samples::Channels(4),
        };
        let channels = if let Samples::Channels(channels) = samples { channels } else { 1 };
        spec.value = ValueType::new(SampleType::U8, channels);
        spec.alpha = channels % 2 == 0;
        spec.void = false;
        let palette = painter.palette().filter(|_| samples == Samples::Indices);
        // Metadata that describe values do not apply to colours.
        let Metadata { frame, control_points, provenance, .. } = spec.metadata;
        spec.metadata = Metadata {
            frame,
            control_points,
            provenance,
            palette: palette.map(|colours| Palette { colours: colours.to_vec() }),
            alpha: spec.alpha.then_some(channels - 1),
            ..Metadata::default()
        };
        PaintedWindow { tree, grid, around, painter, ground, samples, spec }
    }

    /// Metadata of the image.
    pub(super) fn metadata(&self) -> &Metadata {
        &self.spec.metadata
    }

    /// Writes the image.
    pub(super) fn export(
        &self,
        request: &WindowRequest,
        output: Output,
        format: Format,
        progress: &dyn Progress,
    ) -> Result<()> {
        let (width, height) = (self.spec.width, self.spec.height);
        let mut writer = create(output, format, &self.spec)?;
        let is_upright = self.grid.across != 2 && !matches!(format, Format::Npy | Format::Raw);
        // Colours take about twice the memory of values.
        let rows = (rows_at_a_time(self.tree, request, &self.grid)? / 3).clamp(1, height);
        let sampler = Sampler { tree: self.tree, grid: OutputGrid { ..self.grid }, fill: Number::default() };
        let mut row = 0;
        while row < height {
            progress.check()?;
            let count = rows.min(height - row);
            let first = if is_upright { height - row - count } else { row };
            let mut samples = self.band(&sampler, first, count, progress)?;
            if is_upright {
                flip_rows(&mut samples, width as usize * self.spec.value.size());
            }
            writer.write_rows(&samples, None)?;
            progress.advance(count * width, height.saturating_mul(width));
            row += count;
        }
        writer.finish()
    }

    /// The samples of some rows of the image.
    fn band(
        &self,
        sampler: &Sampler<'_>,
        first: u64,
        count: u64,
        progress: &dyn Progress,
    ) -> Result<Vec<u8>> {
        let margin = self.painter.margin();
        let [left, above, _, _] = self.around;
        // Rows of the grid that are needed, and the columns and rows missing before them.
        let start = (first + above).saturating_sub(margin);
        let end = (first + above + count + margin).min(self.grid.height);
        let missing = [margin - left, margin - (first + above - start)].map(|pixels| pixels as usize);
        let (bytes, valid) = sampler.band(start, end - start, progress)?;
        let (width, height) = (self.spec.width as usize, count as usize);
        let sides = [width, height].map(|side| side + 2 * margin as usize);
        let columns = self.grid.width as usize;
        let framed = sides != [columns, (end - start) as usize];
        let bytes = if framed {
            frame(&bytes, columns, self.tree.header().form.width(), sides, missing)
        } else {
            bytes
        };
        let valid = if framed { frame(&valid, columns, 1, sides, missing) } else { valid };
        let ground = self.ground.rows(first as f64, height);
        let block = SampleBlock {
            width,
            height,
            margin: margin as usize,
            bytes: &bytes,
            valid: &valid,
            ground: &ground,
        };
        let Samples::Channels(channels) = self.samples else {
            let mut indices = vec![0; width * height];
            self.painter.paint_indices(&block, &mut indices)?;
            return Ok(indices);
        };
        let mut rgba = vec![0; 4 * width * height];
        self.painter.paint(&block, &mut rgba)?;
        let (pixels, _) = rgba.as_chunks::<4>();
        Ok(match channels {
            1 => pixels.iter().map(|pixel| pixel[0]).collect(),
            2 => chosen(pixels, |pixel| [pixel[0], pixel[3]]),
            3 => chosen(pixels, |[red, green, blue, _]| [red, green, blue]),
            _ => rgba,
        })
    }
}

/// Selects some samples of each pixel.
fn chosen<const N: usize>(pixels: &[[u8; 4]], choose: impl Fn([u8; 4]) -> [u8; N]) -> Vec<u8> {
    let mut samples = vec![0; N * pixels.len()];
    let (chunks, _) = samples.as_chunks_mut::<N>();
    for (chunk, pixel) in chunks.iter_mut().zip(pixels) {
        *chunk = choose(*pixel);
    }
    samples
}

/// Surrounds cells of `items` items each by default values. `missing` is the number of columns and
/// rows added before them.
fn frame<T: Copy + Default>(
    cells: &[T],
    columns: usize,
    items: usize,
    sides: [usize; 2],
    missing: [usize; 2],
) -> Vec<T> {
    let mut framed = vec![T::default(); sides[0] * sides[1] * items];
    let rows = framed.chunks_exact_mut(sides[0] * items).skip(missing[1]);
    for (to, from) in rows.zip(cells.chunks_exact(columns * items)) {
        to[missing[0] * items..][..columns * items].copy_from_slice(from);
    }
    framed
}
