//! Colours of tiles: a style, painted tile by tile.

use super::making::Colours;
use super::place::TileId;
use super::source::TileSamples;
use crate::style::{Ground, PercentileNumbers, SampleBlock, Style, StylePainter};
use spinney_base::{Progress, Result};
use spinney_crs::web_mercator;
use spinney_engine::dataset::Dataset;

/// Pixels of a tile; its rows follow each other without a margin.
#[derive(Clone, Debug, Default)]
pub(super) struct TilePixels {
    /// Numbers of colours, if the painter has a palette.
    pub(super) indices: Vec<u8>,
    /// Else red, green, blue and opacity of each pixel.
    pub(super) colours: Vec<[u8; 4]>,
}

/// A style made ready for the tiles of a tree.
///
/// Tiles without any value are left out, also if the style has a colour for VOID.
#[derive(Debug)]
pub struct TilePainter {
    painter: StylePainter,
    palette: Option<Box<[[u8; 4]; 256]>>,
    colours: Colours,
}

impl TilePainter {
    /// Makes a style ready.
    ///
    /// # Errors
    /// Those of [`StylePainter::new`].
    pub fn new(style: &Style, tree: &Dataset, progress: &dyn Progress) -> Result<TilePainter> {
        TilePainter::with_numbers(style, tree, None, progress)
    }

    /// Makes a style ready, with numbers that its percentiles are.
    pub(super) fn with_numbers(
        style: &Style,
        tree: &Dataset,
        given: Option<&PercentileNumbers>,
        progress: &dyn Progress,
    ) -> Result<TilePainter> {
        let (painter, percentiles) = StylePainter::with_numbers(style, tree, given, progress)?;
        let palette = painter.palette().map(|colours| {
            let mut all = Box::new([[0; 4]; 256]);
            all.iter_mut().zip(colours).for_each(|(to, from)| *to = *from);
            all
        });
        let look = format!("{:016x}", xxhash_rust::xxh3::xxh3_64(format!("{painter:?}").as_bytes()));
        let colours = Colours { style: style.json().to_owned(), percentiles, look };
        Ok(TilePainter { painter, palette, colours })
    }

    /// The painter.
    pub fn painter(&self) -> &StylePainter {
        &self.painter
    }

    /// Cells around a tile that its pixels depend on.
    pub(super) fn margin(&self) -> usize {
        self.painter.margin() as usize
    }

    /// The colours whose numbers it paints; `None` if it paints colours.
    pub(super) fn palette(&self) -> Option<&[[u8; 4]; 256]> {
        self.palette.as_deref()
    }

    /// What an archive says of the colours.
    pub(super) fn colours(&self) -> &Colours {
        &self.colours
    }

    /// Paints a tile, of which there are the samples with the margin's cells around it.
    pub(super) fn paint(&self, tile: TileId, samples: &TileSamples, pixels: &mut TilePixels) -> Result<()> {
        let margin = self.margin();
        let side = samples.side - 2 * margin;
        let ground = if margin == 0 {
            vec![[1.0; 2]]
        } else {
            let depth = tile.zoom + side.trailing_zeros() as u8;
            let first = f64::from(tile.row) * side as f64;
            Ground::new(&web_mercator(depth), 1 << depth).rows(first, side)
        };
        let block = SampleBlock {
            width: side,
            height: side,
            margin,
            bytes: &samples.values,
            valid: &samples.valid,
            ground: &ground,
        };
        if self.palette.is_some() {
            pixels.indices.resize(side * side, 0);
            self.painter.paint_indices(&block, &mut pixels.indices)
        } else {
            pixels.colours.resize(side * side, [0; 4]);
            self.painter.paint(&block, pixels.colours.as_flattened_mut())
        }
    }
}
