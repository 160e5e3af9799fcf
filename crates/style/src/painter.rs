//! Painters: styles resolved for a tree, and the blocks that they paint.

use super::Style;
use super::blend::{Blend, share};
use super::coat::{Coat, Rows, Scratch, stretched};
use super::domain::PercentileNumbers;
use super::ground::Ground;
use super::indices::Indices;
use super::legend::Legend;
use super::resolve::coats;
use spinney_base::value::{SampleType, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_engine::dataset::Dataset;

/// A rectangle of samples to paint, with a margin of cells around it that painting may need.
#[derive(Clone, Copy, Debug)]
pub struct SampleBlock<'a> {
    /// Columns of the painted block.
    pub width: usize,
    /// Rows of the painted block.
    pub height: usize,
    /// Width of the margin in cells; at least [`StylePainter::margin`].
    pub margin: usize,
    /// Samples of the tree's type, margin included: rows from the top, interleaved by pixel,
    /// little-endian.
    pub bytes: &'a [u8],
    /// Whether each pixel has a value, margin included; false if it is VOID or outside the raster.
    pub valid: &'a [bool],
    /// Metres to the east and north from a pixel to the next one in its row, and to the one below:
    /// one entry per row, or a single one for all. See [`Ground`](super::Ground).
    pub ground: &'a [[[f64; 2]; 2]],
}

/// A style resolved for one tree. Threads can share it.
///
/// A pixel's colour depends only on its own samples, and for relief layers on those of its eight
/// neighbours. It does not depend on the block in which it is painted.
#[derive(Debug)]
pub struct StylePainter {
    value: ValueType,
    coats: Vec<Coat>,
    void: [u8; 4],
    title: String,
    /// Opacity channel, and the sample value that is opaque.
    alpha: Option<(usize, f64)>,
    margin: usize,
    /// Precomputed colours of all values, if there are few.
    table: Option<ColourTable>,
    indices: Option<Indices>,
}

/// Colours of a single sample of at most 16 bits, indexed by its bits.
#[derive(Debug)]
struct ColourTable {
    colours: Vec<[u8; 4]>,
    /// Palette indices of the colours.
    indices: Vec<u8>,
}

/// Numbers per channel in memory at a time: blocks are painted in strips of rows.
const NUMBERS: usize = 1 << 15;

impl StylePainter {
    /// Resolves a style for a tree.
    ///
    /// Computes the percentiles that the style uses, from at most 4 Mi cells.
    ///
    /// # Errors
    /// If the tree lacks channels that the style uses, or is corrupt, or on cancellation.
    pub fn new(style: &Style, tree: &Dataset, progress: &dyn Progress) -> Result<StylePainter> {
        StylePainter::with_numbers(style, tree, None, progress).map(|(painter, _)| painter)
    }

    /// Resolves a style with known percentiles, and returns all percentiles that it uses. `given`
    /// may contain some of them.
    ///
    /// # Errors
    /// Those of [`StylePainter::new`].
    pub fn with_numbers(
        style: &Style,
        tree: &Dataset,
        given: Option<&PercentileNumbers>,
        progress: &dyn Progress,
    ) -> Result<(StylePainter, PercentileNumbers)> {
        let value = tree.header().form.value;
        let (coats, numbers) = coats(style, tree, given, progress)?;
        let opaque = match value.sample {
            SampleType::U8 => f64::from(u8::MAX),
            SampleType::U16 => f64::from(u16::MAX),
            _ => 1.0,
        };
        let alpha =
            tree.metadata().alpha.map(usize::from).filter(|alpha| alpha + 1 == usize::from(value.channels));
        let margin = usize::from(coats.iter().any(Coat::needs_neighbours));
        let alpha = alpha.map(|channel| (channel, opaque));
        let title = style.title.clone().unwrap_or_default();
        let mut painter =
            StylePainter { value, coats, void: style.void, title, alpha, margin, table: None, indices: None };
        painter.table = painter.tabulate();
        // With encoded heights, VOID pixels of tiles get the colours of their neighbours.
        painter.indices = if painter.encodes_heights() { None } else { painter.palette_of() };
        if let (Some(table), Some(indices)) = (&mut painter.table, &painter.indices) {
            table.indices = table.colours.iter().map(|colour| indices.index(*colour)).collect();
        }
        Ok((painter, numbers))
    }

    /// Precomputes the colours of all values, if they depend on one sample of at most 16 bits.
    fn tabulate(&self) -> Option<ColourTable> {
        let bits = match self.value.sample {
            SampleType::U8 => 8,
            SampleType::U16 | SampleType::I16 => 16,
            _ => return None,
        };
        if self.value.channels > 1 || self.margin > 0 {
            return None;
        }
        let values = 0..1u32 << bits;
        let bytes: Vec<u8> =
            values.clone().flat_map(|value| value.to_le_bytes().into_iter().take(bits / 8)).collect();
        let valid = vec![true; values.len()];
        let mut rgba = vec![0; 4 * values.len()];
        let block = SampleBlock {
            width: values.len(),
            height: 1,
            margin: 0,
            bytes: &bytes,
            valid: &valid,
            ground: &[Ground::PIXEL],
        };
        self.paint(&block, &mut rgba).ok()?;
        Some(ColourTable { colours: rgba.as_chunks::<4>().0.to_vec(), indices: Vec::new() })
    }

    /// The palette, if it is known and has at most 256 colours.
    fn palette_of(&self) -> Option<Indices> {
        // Transparent colours come first: PNG then stores few opacities.
        if let Some(table) = &self.table {
            return Indices::new([self.void].into_iter().chain(table.colours.iter().copied()));
        }
        match (&self.coats[..], self.alpha) {
            ([coat], None) => {
                // Pixels with a value only in another channel are transparent.
                let none = self.value.is_masked().then_some([0; 4]);
                Indices::new([self.void].into_iter().chain(none).chain(coat.colours()?))
            }
            _ => None,
        }
    }

    /// Width of the margin that painting needs: 1 for slopes, aspects, hillshades and contours,
    /// else 0.
    pub fn margin(&self) -> u64 {
        self.margin as u64
    }

    /// The colour of VOID.
    pub fn void(&self) -> [u8; 4] {
        self.void
    }

    /// Returns whether colours encode heights and VOID is transparent. Readers that ignore opacity
    /// would decode the colour of VOID as a height.
    pub fn encodes_heights(&self) -> bool {
        self.void[3] == 0 && matches!(&self.coats[..], [coat] if coat.encodes_heights())
    }

    /// Returns whether all pixels except VOID are guaranteed to be opaque.
    pub fn is_opaque(&self) -> bool {
        match &self.table {
            Some(table) => table.colours.iter().all(|colour| colour[3] == 255),
            // A sample may be missing in a single channel.
            None => {
                let may_lack = self.alpha.is_some() || self.value.is_masked();
                !may_lack && self.coats.iter().any(Coat::is_opaque)
            }
        }
    }

    /// Returns whether all pixels are guaranteed to be grey, including VOID unless it is
    /// transparent.
    pub fn is_grey(&self) -> bool {
        let [red, green, blue, alpha] = self.void;
        (alpha == 0 || red == green && green == blue) && self.coats.iter().all(Coat::is_grey)
    }

    /// Returns all colours of images, if they are known and at most 256. The first one is that of
    /// VOID. [`StylePainter::paint_indices`] writes indices of this palette.
    pub fn palette(&self) -> Option<&[[u8; 4]]> {
        self.indices.as_ref().map(|indices| &indices.colours[..])
    }

    /// Returns the legend. `tree` must be the tree that the painter was created for.
    ///
    /// # Errors
    /// If the tree is corrupt: listing its classes may read it.
    pub fn legend(&self, tree: &Dataset) -> Result<Legend> {
        Legend::new(&self.title, &self.coats, tree)
    }

    /// Paints a block as RGBA with straight alpha, 8 bits per channel.
    ///
    /// # Errors
    /// If a buffer has the wrong size, or the margin is too small.
    pub fn paint(&self, block: &SampleBlock<'_>, rgba: &mut [u8]) -> Result<()> {
        self.check(block, rgba.len(), 4)?;
        let (out, _) = rgba.as_chunks_mut::<4>();
        match &self.table {
            Some(table) => self.paint_by_table(block, &table.colours, self.void, out),
            None => self.compute(block, &mut |first, colours| {
                out[first..first + colours.len()].copy_from_slice(colours);
            }),
        }
        Ok(())
    }

    /// Paints a block as palette indices.
    ///
    /// # Errors
    /// If there is no palette, a buffer has the wrong size, or the margin is too small.
    pub fn paint_indices(&self, block: &SampleBlock<'_>, out: &mut [u8]) -> Result<()> {
        self.check(block, out.len(), 1)?;
        let Some(indices) = &self.indices else {
            return Err(Error::invalid("palette", "a style of more than 256 colours", "one of at most 256"));
        };
        match &self.table {
            Some(table) => self.paint_by_table(block, &table.indices, 0, out),
            None => self.compute(block, &mut |first, colours| {
                for (out, colour) in out[first..].iter_mut().zip(colours) {
                    *out = indices.index(*colour);
                }
            }),
        }
        Ok(())
    }

    /// Checks the sizes of a block's buffers.
    fn check(&self, block: &SampleBlock<'_>, out: usize, bytes: usize) -> Result<()> {
        let SampleBlock { width, height, margin, .. } = *block;
        let wrong = |what: &str, found: String, expected: String| Err(Error::invalid(what, found, expected));
        if margin < self.margin {
            return wrong("margin", margin.to_string(), format!("at least {}", self.margin));
        }
        let sides = [width, height].map(|side| margin.checked_mul(2).and_then(|both| both.checked_add(side)));
        let cells = sides[0].and_then(|columns| columns.checked_mul(sides[1]?));
        let samples = cells.and_then(|cells| cells.checked_mul(self.value.size()));
        if cells != Some(block.valid.len()) || samples != Some(block.bytes.len()) {
            let found = format!("{} bytes, {} flags", block.bytes.len(), block.valid.len());
            return wrong(
                "block",
                found,
                format!("those of {width} x {height} pixels with a margin of {margin}"),
            );
        }
        // Cannot overflow: there are at least as many cells.
        if out != width * height * bytes {
            return wrong(
                "output buffer",
                format!("{out} bytes"),
                format!("{bytes} bytes for each of {width} x {height} pixels"),
            );
        }
        if block.ground.len() != 1 && block.ground.len() != height {
            return wrong("ground", format!("{} sizes", block.ground.len()), format!("1 or {height}"));
        }
        Ok(())
    }

    /// Looks up the value of each pixel in a table.
    fn paint_by_table<T: Copy>(&self, block: &SampleBlock<'_>, table: &[T], void: T, out: &mut [T]) {
        let SampleBlock { width, margin, bytes, valid, .. } = *block;
        let size = self.value.size();
        let columns = width + 2 * margin;
        for (row, out) in out.chunks_exact_mut(width.max(1)).enumerate() {
            let first = (row + margin) * columns + margin;
            let (bytes, valid) = (&bytes[first * size..][..width * size], &valid[first..][..width]);
            if size == 1 {
                for ((out, byte), valid) in out.iter_mut().zip(bytes).zip(valid) {
                    *out = if *valid { table[usize::from(*byte)] } else { void };
                }
            } else {
                let (samples, _) = bytes.as_chunks::<2>();
                for ((out, sample), valid) in out.iter_mut().zip(samples).zip(valid) {
                    *out = if *valid { table[usize::from(u16::from_le_bytes(*sample))] } else { void };
                }
            }
        }
    }

    /// Computes the colours of a block. Passes them to `each` row by row, with the index of the
    /// row's first pixel.
    fn compute(&self, block: &SampleBlock<'_>, each: &mut dyn FnMut(usize, &[[u8; 4]])) {
        let SampleBlock { width, height, margin, bytes, valid, ground } = *block;
        if width == 0 {
            return;
        }
        let around = self.margin;
        let columns = width + 2 * margin;
        let strip_columns = width + 2 * around;
        let strip = (NUMBERS / strip_columns).max(1);
        let size = self.value.size();
        let channels = usize::from(self.value.channels);
        let mut numbers: [Vec<f64>; 4] = Default::default();
        let mut scratch = Scratch::default();
        let (mut row_colours, mut layer) = (vec![[0; 4]; width], vec![[0; 4]; width]);
        for first in (0..height).step_by(strip) {
            let rows = strip.min(height - first);
            for (channel, numbers) in numbers.iter_mut().enumerate().take(channels) {
                numbers.clear();
                if !self.reads(channel) {
                    continue;
                }
                for row in 0..rows + 2 * around {
                    let start = (first + margin - around + row) * columns + margin - around;
                    let bytes = &bytes[start * size..][..strip_columns * size];
                    let before = numbers.len();
                    self.value.push_numbers(channel, bytes, numbers);
                    let valid = &valid[start..][..strip_columns];
                    for (number, valid) in numbers[before..].iter_mut().zip(valid) {
                        *number = if *valid { *number } else { f64::NAN };
                    }
                }
            }
            for row in 0..rows {
                let line = |channel: usize, row: usize| {
                    numbers[channel].get(row * strip_columns..(row + 1) * strip_columns).unwrap_or_default()
                };
                let rows = Rows {
                    here: std::array::from_fn(|channel| line(channel, row + around)),
                    around: std::array::from_fn(|channel| {
                        [line(channel, row), line(channel, row + 2 * around)]
                    }),
                    edges: ground[if ground.len() == 1 { 0 } else { first + row }],
                };
                let start = (first + margin + row) * columns + margin;
                let valid = &valid[start..start + width];
                self.compute_row(&rows, valid, &mut scratch, &mut layer, &mut row_colours);
                each((first + row) * width, &row_colours);
            }
        }
    }

    /// Returns whether any layer reads a channel.
    fn reads(&self, channel: usize) -> bool {
        self.alpha.is_some_and(|alpha| alpha.0 == channel)
            || self.coats.iter().any(|coat| coat.reads(channel))
    }

    fn compute_row(
        &self,
        rows: &Rows<'_>,
        valid: &[bool],
        scratch: &mut Scratch,
        layer: &mut [[u8; 4]],
        out: &mut [[u8; 4]],
    ) {
        for (index, coat) in self.coats.iter().enumerate() {
            if index == 0 {
                coat.row(rows, scratch, out);
                continue;
            }
            coat.row(rows, scratch, layer);
            blend_rows(coat.blend, out, layer);
        }
        if let Some((channel, opaque)) = self.alpha {
            let here = rows.here[channel];
            let around = (here.len() - out.len()) / 2;
            for (out, alpha) in out.iter_mut().zip(&here[around..]) {
                let alpha = stretched(*alpha, [0.0, opaque]);
                out[3] = share(u32::from(out[3]) * u32::from(alpha)) as u8;
            }
        }
        for (out, valid) in out.iter_mut().zip(valid) {
            *out = if *valid { *out } else { self.void };
        }
    }
}

/// Blends a row of colours over another.
fn blend_rows(blend: Blend, below: &mut [[u8; 4]], above: &[[u8; 4]]) {
    for (below, above) in below.iter_mut().zip(above) {
        *below = blend.over(*below, *above);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spinney_engine::dataset;

    #[test]
    fn fixtures_have_their_colours() {
        let open = |name: &str| {
            dataset::open(
                format!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/v1/{}"), name).as_ref(),
                &Default::default(),
            )
            .unwrap()
        };
        let tree = open("classes.goblin");
        let painter = StylePainter::new(&Style::default_for(&tree), &tree, &()).unwrap();
        let palette = &tree.metadata().palette.as_ref().unwrap().colours;
        let block = SampleBlock {
            width: 3,
            height: 1,
            margin: 0,
            bytes: &[1, 4, 4],
            valid: &[true, true, false],
            ground: &[Ground::PIXEL],
        };
        let (mut rgba, mut indices) = ([0; 12], [0; 3]);
        painter.paint(&block, &mut rgba).unwrap();
        painter.paint_indices(&block, &mut indices).unwrap();
        let colours = indices.map(|index| painter.palette().unwrap()[usize::from(index)]);
        assert_eq!(rgba.as_chunks::<4>().0, colours);
        assert_eq!(colours, [palette[1], palette[4], [0; 4]]);
    }

    #[test]
    fn wrong_buffer_sizes_are_rejected() {
        let tree = dataset::open(
            concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/v1/classes.goblin").as_ref(),
            &Default::default(),
        )
        .unwrap();
        let painter = StylePainter::new(&Style::parse("hillshade").unwrap(), &tree, &()).unwrap();
        assert_eq!(painter.margin(), 1);
        let block = SampleBlock {
            width: 2,
            height: 1,
            margin: 1,
            bytes: &[0; 12],
            valid: &[true; 12],
            ground: &[Ground::PIXEL],
        };
        painter.paint(&block, &mut [0; 8]).unwrap();
        for wrong in [
            SampleBlock { margin: 0, ..block },
            SampleBlock { width: 3, ..block },
            SampleBlock { width: usize::MAX, ..block },
            SampleBlock { bytes: &[0; 11], ..block },
            SampleBlock { valid: &[true; 11], ..block },
            SampleBlock { ground: &[], ..block },
        ] {
            assert!(painter.paint(&wrong, &mut [0; 8]).is_err(), "{wrong:?}");
        }
        assert!(painter.paint(&block, &mut [0; 9]).is_err());
        assert!(painter.paint_indices(&block, &mut [0; 2]).is_ok());
    }
}
